//! What expressions are: nodes of a pool, by their numbers.

use super::Number;
use bond_runtime::ir::{Binary, Unary};
use std::sync::Arc;

/// An expression: an index in its [`Pool`](super::Pool). Equal expressions have equal indices.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Expr(pub(super) u32);

/// A variable or a parameter.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Symbol(pub u32);

/// A list of terms with their coefficients, or of factors with their exponents, sorted by expression.
pub(super) type Pairs = Arc<[(Expr, Number)]>;

/// What an expression is. Children are older than the node.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Node {
    /// A number.
    Number(Number),
    /// A variable or a parameter.
    Symbol(Symbol),
    /// `constant + Σ coefficient * term`; coefficients are not 0, no term is a number, a sum, or a product with a
    /// coefficient of its own. At least two summands.
    Sum(Number, Pairs),
    /// `coefficient * Π factor^exponent`; exponents are ratios and not 0, no factor is a number; more than one factor
    /// alone with coefficient and exponent 1.
    Product(Number, Pairs),
    /// `a^b` with an exponent that is no ratio.
    Power(Expr, Expr),
    /// A function; never `Neg`, which is a product, nor `Sqrt`, which is a power.
    Unary(Unary, Expr),
    /// `Min`, `Max`, `Atan2`, a comparison or a connective; never arithmetic.
    Binary(Binary, Expr, Expr),
    /// The second where the first is not 0, else the third.
    Select(Expr, Expr, Expr),
}

impl Node {
    /// Calls `f` with each child.
    pub fn each_child(&self, f: &mut dyn FnMut(Expr)) {
        match self {
            Node::Number(_) | Node::Symbol(_) => {}
            Node::Sum(_, pairs) | Node::Product(_, pairs) => pairs.iter().for_each(|&(e, _)| f(e)),
            Node::Power(a, b) | Node::Binary(_, a, b) => [*a, *b].into_iter().for_each(f),
            Node::Unary(_, a) => f(*a),
            Node::Select(c, a, b) => [*c, *a, *b].into_iter().for_each(f),
        }
    }
}
