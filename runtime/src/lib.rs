//! What runs: step programs, their interpreter, solvers, the energy ledger, sample and hold, simulation.
//!
//! Knows nothing of text, graphs or symbols. A built environment links this crate alone.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod double_double;
pub mod envelope;
pub mod eval;
pub mod exponential;
pub mod interpreter;
pub mod ir;
pub mod kernel;
pub mod ledger;
pub mod machine;
pub mod scene;
pub mod simulate;
pub mod solve;

pub use interpreter::Interpreter;
pub use kernel::{Failure, Kernel, Workspace};
