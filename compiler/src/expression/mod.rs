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
mod free_symbols;
mod function;
mod greek;
mod intern;
mod kernel;
mod landmarks;
mod latex;
mod lower;
mod maclaurin;
mod magnitude;
mod node;
mod number;
mod options;
mod piecewise;
mod polynomial;
mod pool;
mod power;
mod power_series;
mod print;
mod pythagoras;
mod sign;
mod sign_analysis;
mod substitute;
mod surface;
mod table;
mod unary;
mod walk;
mod zone;

pub use greek::greek;
pub use landmarks::Landmarks;
pub use lower::{Below, Lowering};
pub(crate) use maclaurin::{Maclaurin, extent, limit, rest};
pub use node::{Expr, Node, Symbol};
pub use number::Number;
pub use options::Options;
pub use polynomial::{Affine, Quadratic};
pub use pool::Pool;
pub use sign::Sign;
pub(crate) use unary::{Growth, growth, is_piecewise_linear};
