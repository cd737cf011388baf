//! Machine code by Cranelift: in memory, for this machine ([`jit`]), or as an object file.

mod functions;
pub mod jit;
mod loop_vectorizer;
mod object;
mod shared;
mod slp;
mod translate;
mod vector;

use super::c;
use super::emitter::{Emitted, Emitter, Request};

pub use jit::{JIT, Jit};
pub use object::object;
pub use shared::Shared;

/// Object files.
pub const EMITTER: Emitter = Emitter {
    name: "object",
    about: "An object file for machines like this one, and its header",
    extension: "o",
    has_header: true,
    emit,
};

fn emit(r: &Request<'_>) -> Result<Emitted, String> {
    let options = c::Options { prefix: r.prefix.into(), header: r.header.into(), single: false, begin: false };
    Ok(Emitted::WithHeader(object(r.unit, r.prefix)?, c::header(r.unit, &options)))
}
