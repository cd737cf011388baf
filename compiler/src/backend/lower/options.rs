//! By what loops are found and joined.

/// Sizes that decide how large programs become loops. None changes a number that a program gives.
#[derive(Clone, Copy, Debug)]
pub(in crate::backend) struct LoopOptions {
    /// Operations of an expression cone at most; what goes beyond is a result of its own.
    pub(super) cone_operations: u32,
    /// What two results share is a result of its own where it has more operations than this: to keep a number and have
    /// it again costs some two.
    pub(super) shared_operations: u32,
    /// Levels of results that need one another at most: in a deeper program nothing runs side by side.
    pub(super) levels: u32,
    /// Members of a group at least; fewer are written out.
    pub(super) members: usize,
    /// Even stretches of a group are loops of their own where they have so many members on average,
    pub(super) stretch: usize,
    /// and there are at most so many.
    pub(super) stretches: usize,
    /// A group whose members go by at most so many lists of numbers is one for each list: numbers need no loads then.
    pub(super) number_lists: usize,
    /// Terms from which on a sum is a loop.
    pub(super) sum_terms: usize,
    /// Numbers that a matrix may depend on, where it is kept from step to step.
    pub(super) matrix_keys: usize,
    /// Statements that a loop is moved over at most.
    pub(super) moved_over: usize,
    /// Statements of joined loops at most: more values than there are registers would be written and read again.
    pub(super) joined_statements: usize,
    /// Turns that two loops must have in common to be joined, as a part of those of the longer one.
    pub(super) common_turns: f64,
}

impl Default for LoopOptions {
    fn default() -> Self {
        Self {
            cone_operations: 48,
            shared_operations: 5,
            levels: 100,
            members: 4,
            stretch: 16,
            stretches: 8,
            number_lists: 8,
            sum_terms: 16,
            matrix_keys: 2,
            moved_over: 1000,
            joined_statements: 150,
            common_turns: 0.75,
        }
    }
}
