//! Back ends: what step programs become besides the interpreter's code. [`lower`] makes a program plain, once for all
//! of them.

pub mod c;
pub mod code;
pub mod fmu;
pub mod if_conversion;
mod lower;
#[cfg(feature = "native")]
pub mod native;

pub mod unit;
pub mod wasm;

pub use lower::{is_large, lower, lower_apart};
