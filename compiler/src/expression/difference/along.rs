//! An expression along a step, and the step.

use crate::expression::{Expr, Symbol};

/// An expression along the step: at its start, at its end, and the divided difference between.
#[derive(Clone, Copy)]
pub(in crate::expression) struct Along {
    pub(in crate::expression) from: Expr,
    pub(in crate::expression) to: Expr,
    pub(in crate::expression) slope: Expr,
}

/// What a divided difference is taken over.
pub(in crate::expression) struct Step {
    pub(in crate::expression) symbol: Symbol,
    pub(in crate::expression) from: Expr,
    pub(in crate::expression) to: Expr,
    pub(in crate::expression) delta: Expr,
    /// `from + delta/2`
    pub(in crate::expression) middle: Expr,
}
