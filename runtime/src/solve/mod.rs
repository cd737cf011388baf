//! Solving systems: linear ones, dense or sparse, and Newton's method on top of them.

pub mod dense;
pub mod linear;
pub mod newton;
mod order;
pub mod quick;
pub mod scalar;
pub mod sparse;

#[cfg(test)]
pub(crate) mod testing;
