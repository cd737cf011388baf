//! The sizes of printed forms and of pictures, beyond which they take another form.

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
    /// Elements of a picture that can be read.
    pub picture: usize,
    /// Elements of a graph from which on it may be a long chain.
    pub chain: usize,
    /// Pixels from one element to the next.
    pub step: f64,
    /// Pixels of the shortest bond that can be seen.
    pub bond: f64,
    /// Pixels between the outermost label and the edge.
    pub margin: f64,
    /// Pixels around the labels of a region.
    pub padding: f64,
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
    picture: 400,
    chain: 24,
    step: 92.0,
    bond: 36.0,
    margin: 28.0,
    padding: 22.0,
};
