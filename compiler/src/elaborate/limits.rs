//! Bounds on the size of a model and on the work of elaboration.

/// What a model may have at most, and how far its errors are explained. Each is a count.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Elements and bonds.
    pub elements: usize,
    /// Instances.
    pub instances: usize,
    /// Parameters, `let`s, probes, inputs and states.
    pub values: usize,
    /// Rounds of all `for` loops together.
    pub rounds: u64,
    /// Numbers of an array.
    pub entries: usize,
    /// Calls of functions in all.
    pub calls: u64,
    /// Instances within instances, and calls of functions within calls.
    pub nesting: usize,
    /// Expressions that are evaluated within one another by way of names: each takes some of the stack.
    pub depth: usize,
    /// Letters and numbers of unused `let`s that are evaluated, before further rounds of loops are taken to be like the
    /// first.
    pub unused: usize,
    /// Equations of units that are looked at to find the ones that mislead.
    pub equations: usize,
    /// Errors for which a suggested fix is searched for.
    pub explained: usize,
    /// Elements that a suggested fix names.
    pub suggested: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            elements: 2_000_000,
            instances: 1_000_000,
            values: 4_000_000,
            rounds: 4_000_000,
            entries: 10_000,
            calls: 2_000_000,
            nesting: 64,
            depth: 50_000,
            unused: 1_000_000,
            equations: 10_000_000,
            explained: 100,
            suggested: 8,
        }
    }
}
