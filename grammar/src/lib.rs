//! The `.bond` language as text: source files, syntax tree, diagnostics, canonical layout.
//!
//! Knows nothing of physics.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

#[allow(clippy::large_enum_variant)] // a tree is read more often than it is moved
pub mod ast;
mod bracket;
pub mod diagnostic;
mod explain;
mod format;
mod limit;
mod parse;
mod print;
mod recover;
mod scan;
pub mod source;

pub use format::format;
pub use parse::{parse, parse_expr};
