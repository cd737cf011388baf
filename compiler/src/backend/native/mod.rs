//! Machine code by Cranelift: in memory, for this machine ([`jit`]), or as an object file.

mod functions;
pub mod jit;
mod object;
mod translate;

pub use jit::Jit;
pub use object::object;
