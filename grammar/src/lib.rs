//! The `.bond` language as text: sources, syntax tree, diagnostics, canonical layout. It knows nothing of physics.
//!
//! # Stages
//!
//! | stage | from, to | holds afterwards |
//! | --- | --- | --- |
//! | `scan` | text to tokens and comments | it never fails; comments are kept for the layout |
//! | `limit` | tokens | nesting, height of expressions and size are bounded, so recursion over the tree is safe |
//! | `read` | a slice of text to a piece of tree, by the grammar `bond.pest` | every span lies in its source |
//! | `recover` | a refused text to the items and statements that can be read | each was accepted by the strict grammar |
//! | `explain` | a refused slice to a [`Diagnostic`](diagnostic::Diagnostic) | it has a stable code, a place and mostly a fix |
//! | [`format()`] | tree to text | reading the result gives the same tree; formatting it again changes nothing |
//!
//! [`parse()`] runs the first five. It always returns a tree, and all errors of the text in order of place. With
//! errors, the tree lacks what could not be read ([`ast::File::gaps`] says if items are missing). The compiler calls
//! [`parse_with_units()`] and says there which symbols are units, so that `6 V*x` is a product.
//!
//! # What may be assumed of a tree
//!
//! - Names are as written. Nothing has been resolved: a name may not exist, and a unit may be unknown.
//! - Numbers are digits, not `f64`: the compiler converts them once, exactly.
//! - Every node has the [`Span`](source::Span) from which it was read. Spans never cross sources.
//! - Trees are at most as deep as the limits allow, so recursion needs no further guard.
//!
//! # Example
//!
//! ```
//! use bond_grammar::source::Sources;
//!
//! let mut sources = Sources::new();
//! let id = sources.add("spring.bond", "model Spring { C:spring = 1 m/N; R:r = }");
//! let (file, errors) = bond_grammar::parse(&sources, id);
//! assert_eq!(file.items.len(), 1); // the model, without the statement that could not be read
//! assert_eq!(errors.len(), 1);
//! assert!(errors[0].render(&sources).starts_with("spring.bond:1:"));
//! ```
//!
//! # How to add a statement
//!
//! 1. `bond.pest`: its rule, and a place in `statement`.
//! 2. [`ast`]: a variant of [`StatementKind`](ast::StatementKind). The compiler then lists the places that must know
//!    it: `read` makes it, `print` and `format` write it.
//! 3. `explain/statement.rs`: messages for its likely mistakes. `recover` cuts by words that can only begin a
//!    statement; if its first word is one, add it to `bracket::is_strong_start`.
//! 4. `tests/syntax.rs` for its form, `tests/errors.rs` for its mistakes. `tests/generated.rs` formats random trees.

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
mod read;
mod recover;
mod scan;
pub mod source;

pub use format::format;
pub use parse::{parse, parse_expr, parse_with_units};
