//! Bounds on the work of symbolic rules.

/// How far rules go. Each is a count; what is beyond stays as it is, or is not found.
#[derive(Clone, Debug)]
pub struct Options {
    /// Rules that may follow each other in the search for an antiderivative.
    pub rules: usize,
    /// Functions within one another that are inverted, choices within one another in a quadratic form, and steps of a
    /// proof of dissipation.
    pub nesting: usize,
    /// Pieces into which a law with kinks is taken apart.
    pub pieces: usize,
    /// Pieces of a piecewise polynomial whose sign is looked at.
    pub polynomial_pieces: usize,
    /// Degree of such a polynomial.
    pub degree: usize,
    /// Terms of a sum in which common factors, or `exp(x) - 1`, are looked for.
    pub terms: usize,
    /// Terms of a product of sums that is multiplied out.
    pub product_terms: usize,
    /// Letters of a part of a printed expression: parts that are used again and again can make a text that no memory
    /// holds.
    pub letters: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rules: 100,
            nesting: 32,
            pieces: 256,
            polynomial_pieces: 100_000,
            degree: 8,
            terms: 64,
            product_terms: 400,
            letters: 1_000_000,
        }
    }
}
