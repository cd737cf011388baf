//! The numbers by which a stepper and its step are chosen, each with its meaning and default.

use crate::bench;

/// The numbers by which a stepper and its step are chosen.
#[derive(Clone, Copy, Debug, Default)]
pub struct Thresholds {
    /// How candidates are measured.
    pub bench: bench::Thresholds,
    /// The choice for an error.
    pub error: ErrorThresholds,
    /// The choice for a time.
    pub budget: BudgetThresholds,
}

/// The choice for an error.
#[derive(Clone, Copy, Debug)]
pub struct ErrorThresholds {
    /// The reference is to be this many times as exact as what is asked for.
    pub sharper: f64,
    /// The error of a choice, as parts of what is asked for: at least, at best, at most.
    pub window: [f64; 3],
    /// Most runs per candidate.
    pub runs: usize,
    /// A candidate is given up if it takes this many times as long as the best so far.
    pub slower: f64,
    /// Time that each run may take, s, even if the reference took less.
    pub least_time: f64,
}

impl Default for ErrorThresholds {
    fn default() -> Self {
        Self { sharper: 50.0, window: [1.0 / 30.0, 1.0 / 6.0, 1.0 / 2.0], runs: 10, slower: 3.0, least_time: 0.05 }
    }
}

/// The choice for a time.
#[derive(Clone, Copy, Debug)]
pub struct BudgetThresholds {
    /// Errors below this are not distinguished.
    pub sharp: f64,
    /// The part of the time that is used, so that a slower moment does not exceed it.
    pub used: f64,
    /// The longest fixed step, in mean steps of a rough adaptive run.
    pub coarsest: f64,
    /// Time, s, up to which a run with rows is timed again without them.
    pub rows: f64,
    /// Most halvings of a fixed step.
    pub halvings: i32,
}

impl Default for BudgetThresholds {
    fn default() -> Self {
        Self { sharp: 1e-12, used: 0.7, coarsest: 8.0, rows: 0.01, halvings: 24 }
    }
}
