//! The sizes of printed forms, beyond which they take another form.

/// See [`SIZES`].
pub(super) struct Sizes {
    /// Lines of a list in the summary; longer ones are cut.
    pub list: usize,
    /// Rows or columns of a matrix that is a table; a larger one is a list of its entries.
    pub table: usize,
    /// Letters of an entry in a table; a longer one stands below it.
    pub entry: usize,
    /// Columns of a matrix in LaTeX; a larger one is a list of its entries.
    pub latex_columns: usize,
    /// States of a region with dense matrices; more have sparse ones.
    pub dense_states: usize,
    /// Entries of a sparse matrix for each state or input.
    pub sparse_entries: usize,
    /// Resistors of an algebraic loop that is solved on paper.
    pub written_loop: usize,
    /// The same, of linear resistors in a sparse form.
    pub linear_loop: usize,
}

/// The sizes of all printed forms.
pub(super) const SIZES: Sizes = Sizes {
    list: 24,
    table: 12,
    entry: 24,
    latex_columns: 20,
    dense_states: 60,
    sparse_entries: 64,
    written_loop: 6,
    linear_loop: 8,
};
