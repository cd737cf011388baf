//! Machine code by Cranelift: in memory, for this machine ([`jit`]), or as an object file.

mod functions;
pub mod jit;
mod lanes;
mod loop_vectorizer;
mod object;
mod shared;
mod slp;
mod translate;
mod vector;

pub use jit::{JIT, Jit};
pub use object::object;
pub use shared::Shared;
