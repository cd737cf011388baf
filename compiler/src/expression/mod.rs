//! Symbolic expressions: a hash-consed graph with exact numbers, in a canonical form.
//!
//! A [`Pool`] owns all nodes; an [`Expr`] is an index into it. Equal expressions are made once, and a node's children
//! are always older than the node, so that every walk goes over ascending ids and needs no recursion.
//!
//! The canonical form: sums and products are n-ary, sorted and merged; a term of a sum has a number as its coefficient,
//! a factor of a product a rational exponent. Differences, quotients, negation and roots are sums and products too.
//! A number times a sum is distributed, other products are not. Functions of numbers are folded.

mod antiderivative;
mod build;
mod derivative;
mod difference;
mod dissipative;
mod eval;
mod factor;
mod function;
mod greek;
mod kernel;
mod known;
mod latex;
mod lower;
mod node;
mod number;
mod pages;
mod piecewise;
mod polynomial;
mod pool;
mod power;
mod print;
mod pythagoras;
mod series;
mod sign;
mod slopes;
mod substitute;
mod support;
mod table;
mod walk;
mod zone;

pub use greek::greek;
pub use lower::{Below, Lowering};
pub use node::{Expr, Node, Symbol};
pub use number::Number;
pub use polynomial::{Affine, Quadratic};
pub use pool::Pool;
pub(crate) use series::{Taylor, extent, limit, rest};
pub use sign::Sign;
