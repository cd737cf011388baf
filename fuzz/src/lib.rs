//! What the fuzz targets share: bytes as choices, envelopes around bytes, changes of texts by words, small scenes, and
//! the seeds that each target writes at its start.

pub mod bounded;
pub mod feed;
pub mod limited;
pub mod mutate;
pub mod scenes;
pub mod seeds;

use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Sources;
use bond_runtime::envelope::{FORMAT, HEAD, Kind, digest};

/// Bytes as the body of an envelope, with the length and the digest that make it whole: what reads it then looks at
/// what the bytes mean.
pub fn sealed(kind: Kind, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD + body.len());
    bytes.extend(kind.magic());
    bytes.extend(FORMAT.to_le_bytes());
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(digest(body).to_le_bytes());
    bytes.extend(body);
    bytes
}

/// Fails where a diagnostic says nothing, or names a place that is not in its text.
///
/// # Panics
/// If one does.
pub fn check_diagnostics(sources: &Sources, list: &[Diagnostic]) {
    for d in list {
        assert!(!d.message.is_empty() && !d.labels.is_empty(), "{d:?} says nothing");
        for label in &d.labels {
            let span = label.span;
            let source = sources.list().get(span.source.0 as usize);
            let text = source.map_or("", |s| &s.text);
            assert!(text.get(span.start as usize..span.end as usize).is_some(), "{d:?} is not in its text");
        }
        assert!(!d.render(sources).is_empty());
    }
}
