//! Decides whether instances run as machine code or interpreted: whichever is faster, because the numbers are the same.

use bond::internal::Code;
use bond_runtime::kernel::Backend;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Machine code is at least some 6 times as fast as the interpreter. So if compiling takes more than this many times
/// the run itself, interpreting would have been faster.
const INTERPRETER_COST: u32 = 5;

/// How the instances are run, learned from those that have run. Threads share it.
pub struct Choice {
    native: Box<dyn Backend + Send + Sync>,
    instances: u64,
    taken: Mutex<Taken>,
    interpret: AtomicBool,
}

/// What machine code has taken so far.
#[derive(Default)]
struct Taken {
    /// Instances that it ran.
    instances: u64,
    /// Making it, s.
    made: f64,
    /// Running it, s.
    ran: f64,
}

impl Choice {
    /// A choice for this many instances, of which none has run; or the interpreter, if the user wants it.
    pub fn new(interpret: bool, instances: u64) -> Self {
        let (native, taken) = (Code::Native.shared(instances), Mutex::default());
        Self { native, instances, taken, interpret: AtomicBool::new(interpret) }
    }

    /// How the next instances are run.
    pub fn code(&self) -> Code {
        if self.interpret.load(Ordering::Relaxed) { Code::Interpreted } else { Code::Native }
    }

    /// What runs them.
    pub fn backend(&self, code: Code) -> &dyn Backend {
        match code {
            Code::Native => &*self.native,
            Code::Interpreted => code.backend(),
        }
    }

    /// Learns how long an instance took as machine code, to compile and to run. Code compiled for one mostly serves the
    /// others too. Once compiling has taken longer than interpreting all of them would, the rest is interpreted.
    pub fn learn(&self, made: Duration, ran: Duration) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.instances += 1;
        taken.made += made.as_secs_f64();
        taken.ran += ran.as_secs_f64();
        let all = taken.ran * self.instances as f64 / taken.instances.max(1) as f64;
        if taken.made > all * f64::from(INTERPRETER_COST) {
            self.interpret.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_runs_are_interpreted() {
        let [none, short, long] = [0, 1, 100].map(Duration::from_millis);
        let told = |list: &[(Duration, Duration)]| {
            let choice = Choice::new(false, 40);
            list.iter().for_each(|(made, ran)| choice.learn(*made, *ran));
            choice.code()
        };
        assert_eq!(told(&[]), Code::Native);
        // Forty instances make up for it, unless each makes its own.
        assert_eq!(told(&[(long, short), (none, short)]), Code::Native);
        assert_eq!(told(&[(long, short), (long, short)]), Code::Native);
        assert_eq!(told(&[(long, short), (long, short), (long, short)]), Code::Interpreted);
        assert_eq!(told(&[(short, long), (long, none)]), Code::Native);
        assert_eq!(told(&[(long * 3, short)]), Code::Interpreted);
        assert_eq!(Choice::new(true, 40).code(), Code::Interpreted);
    }
}
