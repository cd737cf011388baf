//! Whether the instances are run as machine code or interpreted: whichever is sooner done, as the numbers are the same.

use bond::Code;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

/// Machine code is some 6 times as fast as the interpreter at least. So where making it takes longer than this many times the run
/// itself, the interpreter would have been done before.
const WORTH: u32 = 5;

const OPEN: u8 = 0;
const NATIVE: u8 = 1;
const INTERPRETED: u8 = 2;

/// What is known of that so far; threads may ask and tell at once.
#[derive(Debug)]
pub struct Choice(AtomicU8);

impl Choice {
    /// Nothing is known, or the user wants the interpreter.
    pub fn new(interpret: bool) -> Self {
        Self(AtomicU8::new(if interpret { INTERPRETED } else { OPEN }))
    }

    /// How the next instance is run.
    pub fn code(&self) -> Code {
        if self.0.load(Ordering::Relaxed) == INTERPRETED { Code::Interpreted } else { Code::Native }
    }

    /// An instance has come to its end as machine code: how long that took to make, and then to run.
    pub fn learn(&self, made: Duration, ran: Duration) {
        let choice = if made > ran * WORTH { INTERPRETED } else { NATIVE };
        // The first one counts.
        let _ = self.0.compare_exchange(OPEN, choice, Ordering::Relaxed, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_runs_are_interpreted() {
        let [short, long] = [1, 100].map(Duration::from_millis);
        let choice = Choice::new(false);
        assert_eq!(choice.code(), Code::Native);
        choice.learn(short, long);
        choice.learn(long, short);
        assert_eq!(choice.code(), Code::Native);
        let choice = Choice::new(false);
        choice.learn(long, short);
        choice.learn(short, long);
        assert_eq!(choice.code(), Code::Interpreted);
        assert_eq!(Choice::new(true).code(), Code::Interpreted);
    }
}
