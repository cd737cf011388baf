//! C99: one `.c` and one `.h` that need nothing but `libm`.

mod double_buffer;
mod header;
mod lanes;
mod print;
mod solve;
mod source;

pub use header::{goes_with_object, header};
pub(super) use source::early;
pub use source::source;

use super::emitter::{Emitted, Emitter, Request};

/// C text.
pub const EMITTER: Emitter =
    Emitter { name: "c", about: "C99 source and its header", extension: "c", has_header: true, emit };

fn emit(r: &Request<'_>) -> Result<Emitted, String> {
    let options = Options { prefix: r.prefix.into(), header: r.header.into(), single: true, begin: false };
    Ok(Emitted::WithHeader(source(r.unit, &options).into_bytes(), header(r.unit, &options)))
}

/// How the text is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// What public names begin with: `bond` gives `bond_init`.
    pub prefix: String,
    /// Name of the header's file, which the source includes.
    pub header: String,
    /// Whether numbers may be single, by a macro; an object's are double.
    pub single: bool,
    /// Whether there is `bond_begin`, which the header does not declare, where the unit has it: it takes the first
    /// samples anew, after `bond_init` and `bond_input`, and gives what a commit gives.
    pub begin: bool,
}

/// Whether a name can be a prefix.
pub fn is_prefix(name: &str) -> bool {
    let mut letters = name.chars();
    letters.next().is_some_and(|c| c.is_ascii_alphabetic()) && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// A name as a C macro's: `c[1].q` gives `C_1_Q`.
fn constant(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_uppercase());
        } else if !out.ends_with('_') {
            out.push('_');
        }
    }
    let out = out.trim_matches('_').to_string();
    if out.is_empty() { "X".into() } else { out }
}

/// Names as macros', each one once: a second one of the same letters gets its number.
fn constants<'n>(names: impl IntoIterator<Item = &'n str>) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for (i, name) in names.into_iter().enumerate() {
        let mut name = constant(name);
        while list.contains(&name) {
            name = format!("{name}_{i}");
        }
        list.push(name);
    }
    list
}

/// Text that may stand in a comment.
fn comment(text: &str) -> String {
    text.replace("*/", "* /").replace("/*", "/ *").replace(['\n', '\r', '\\'], " ").replace("??", "? ?")
}
