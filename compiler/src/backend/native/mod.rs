//! Machine code by Cranelift: in memory, for this machine ([`jit`]), or as an object file.

mod functions;
pub mod jit;
mod translate;

pub use jit::Jit;
