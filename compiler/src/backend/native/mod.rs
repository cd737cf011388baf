//! Machine code by Cranelift: in memory, for this machine ([`jit`]), or as an object file.

mod double;
mod functions;
pub mod jit;
mod lanes;
mod object;
mod pairs;
mod shared;
mod translate;
mod vector;

pub use jit::{JIT, Jit};
pub use object::object;
pub use shared::Shared;
