//! Whether the instances are run as machine code or interpreted: whichever is sooner done, as the numbers are the same.

use bond::Code;
use bond_runtime::kernel::Backend;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// Machine code is some 6 times as fast as the interpreter at least. So where making it takes longer than this many times the run
/// itself, the interpreter would have been done before.
const WORTH: u32 = 5;

/// How the instances are run, and what is known of that so far; threads may ask and tell at once.
pub struct Choice {
    native: Box<dyn Backend + Send + Sync>,
    instances: u64,
    /// Instances that have told how long they took.
    told: AtomicU64,
    interpret: AtomicBool,
}

impl Choice {
    /// Nothing is known of so many instances, or the user wants the interpreter.
    pub fn new(interpret: bool, instances: u64) -> Self {
        let native = Code::Native.shared(instances);
        Self { native, instances, told: AtomicU64::new(0), interpret: AtomicBool::new(interpret) }
    }

    /// How the next instance is run.
    pub fn code(&self) -> Code {
        if self.interpret.load(Ordering::Relaxed) { Code::Interpreted } else { Code::Native }
    }

    /// What runs it.
    pub fn backend(&self, code: Code) -> &dyn Backend {
        match code {
            Code::Native => &*self.native,
            Code::Interpreted => code.backend(),
        }
    }

    /// An instance has come to its end as machine code: how long that took to make, and then to run. What the first one makes serves
    /// the others too, what the second one makes, itself.
    pub fn learn(&self, made: Duration, ran: Duration) {
        let serves = match self.told.fetch_add(1, Ordering::Relaxed) {
            0 => self.instances as f64,
            1 => 1.0,
            _ => return,
        };
        if made.as_secs_f64() > ran.as_secs_f64() * f64::from(WORTH) * serves {
            self.interpret.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_runs_are_interpreted() {
        let [short, long] = [1, 100].map(Duration::from_millis);
        let told = |list: &[(Duration, Duration)]| {
            let choice = Choice::new(false, 10);
            list.iter().for_each(|(made, ran)| choice.learn(*made, *ran));
            choice.code()
        };
        assert_eq!(told(&[]), Code::Native);
        // Ten instances make up for it, unless each makes its own.
        assert_eq!(told(&[(long, short * 3)]), Code::Native);
        assert_eq!(told(&[(long, short * 3), (long, short * 3)]), Code::Interpreted);
        assert_eq!(told(&[(long, short)]), Code::Interpreted);
        assert_eq!(told(&[(long, short * 3), (short, long), (long, short)]), Code::Native);
        assert_eq!(Choice::new(true, 10).code(), Code::Interpreted);
    }
}
