//! Solving systems: linear ones, dense or sparse, and Newton's method on top of them.

pub mod dense;
pub mod direct;
pub mod iteration;
pub mod linear;
pub mod newton;
mod norm;
mod order;
pub mod scalar;
pub mod sparse;

#[cfg(test)]
pub(crate) mod testing;
