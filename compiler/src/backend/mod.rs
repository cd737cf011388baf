//! Back ends: what step programs become besides the interpreter's code. [`lower`] makes a program plain, once for all
//! of them.
//!
//! What `bond build --emit` writes is a row of [`EMITTERS`]: a new one is its folder, its module and its row here, and
//! a test.

pub mod c;
pub mod code;
pub mod emitter;
pub mod fmu;
pub mod if_conversion;
mod lower;
#[cfg(feature = "native")]
pub mod native;
pub mod standalone;
pub mod wasm;

pub use lower::{is_large, lower, lower_apart};

/// All forms that a scene is written in, to run without `bond`.
pub const EMITTERS: &[emitter::Emitter] = &[
    c::EMITTER,
    #[cfg(feature = "native")]
    native::EMITTER,
    fmu::EMITTER,
    wasm::EMITTER,
];
