//! Whether the instances are run as machine code or interpreted: whichever is sooner done, as the numbers are the same.

use bond::Code;
use bond_runtime::kernel::Backend;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Machine code is some 6 times as fast as the interpreter at least. So where making it takes longer than this many
/// times the run itself, the interpreter would have been done before.
const WORTH: u32 = 5;

/// How the instances are run, and what is known of that so far; threads may ask and tell at once.
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
    /// Nothing is known of so many instances, or the user wants the interpreter.
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

    /// An instance has come to its end as machine code: how long that took to make, and then to run. What is made for
    /// one mostly serves the others too; where making has taken longer than interpreting all of them would, the rest is
    /// interpreted.
    pub fn learn(&self, made: Duration, ran: Duration) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.instances += 1;
        taken.made += made.as_secs_f64();
        taken.ran += ran.as_secs_f64();
        let all = taken.ran * self.instances as f64 / taken.instances.max(1) as f64;
        if taken.made > all * f64::from(WORTH) {
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
