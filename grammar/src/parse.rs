//! From a text to its tree.
//!
//! A text is first read whole by the strict grammar. If that refuses it, [`crate::recover`] cuts it into items and
//! statements, each of which is read by itself, so that one run finds every error.

use crate::ast::{Expr, File};
use crate::diagnostic::Diagnostic;
use crate::explain;
use crate::limit;
use crate::read::Reader;
use crate::recover;
use crate::scan::Scan;
use crate::source::{SourceId, Sources, Span};

/// Reads a source as it is written: whatever is joined to a number's unit without a space belongs to the unit. Where
/// there are errors, the tree lacks what could not be read.
///
/// # Panics
/// If the id comes from another `Sources`.
pub fn parse(sources: &Sources, id: SourceId) -> (File, Vec<Diagnostic>) {
    parse_with_units(sources, id, &|_| true)
}

/// Reads a source as [`parse`] does, with units that end before their first factor that is no unit: `6 V*x` is then the
/// product of `6 V` and `x`, as `6 V * x` is. A unit whose first factor is none stays whole, and is an error of later.
///
/// # Panics
/// If the id comes from another `Sources`.
pub fn parse_with_units(sources: &Sources, id: SourceId, is_unit: &dyn Fn(&str) -> bool) -> (File, Vec<Diagnostic>) {
    let text = &sources.get(id).text;
    let whole = Span { source: id, start: 0, end: u32::try_from(text.len()).unwrap_or(u32::MAX) };
    let mut file = File { docs: Vec::new(), items: Vec::new(), comments: Vec::new(), gaps: false, span: whole };
    if text.len() > limit::BYTES {
        return (file, vec![limit::too_large(whole)]);
    }
    let scan = Scan::new(id, text);
    file.docs = scan.file_docs();
    file.comments = scan.comments.clone();
    if let Err(diagnostic) = limit::check(&scan) {
        return (file, vec![diagnostic]);
    }
    let mut reader = Reader::new(&scan, is_unit);
    match reader.whole_file() {
        Ok(items) => file.items = items,
        Err(refused) if refused.limit => reader.errors.push(explain::limit_reached(&scan, refused.at)),
        Err(_) if let Some(diagnostic) = explain::other_language(&scan) => {
            reader.errors.push(diagnostic);
            file.gaps = true;
        }
        Err(_) => {
            Reader::tell_places();
            (file.items, file.gaps) = recover::file(&mut reader);
        }
    }
    let mut errors = reader.errors;
    errors.sort_by_key(|error| error.labels.first().map_or(0, |label| label.span.start));
    (file, errors)
}

/// Reads a whole source as one expression, for the command line.
///
/// # Panics
/// If the id comes from another `Sources`.
pub fn parse_expr(sources: &Sources, id: SourceId) -> Result<Expr, Diagnostic> {
    let text = &sources.get(id).text;
    if text.len() > limit::BYTES {
        return Err(limit::too_large(Span { source: id, start: 0, end: 0 }));
    }
    let scan = Scan::new(id, text);
    limit::check(&scan)?;
    let mut reader = Reader::new(&scan, &|_| true);
    Reader::tell_places();
    let expr = match reader.whole_expr() {
        Ok(expr) => expr,
        Err(refused) => {
            let all = 0..scan.tokens.len();
            reader.errors.push(explain::refused(&scan, explain::Piece::Value, all, refused));
            None
        }
    };
    match (expr, reader.errors.into_iter().next()) {
        (Some(expr), None) => Ok(expr),
        (_, Some(error)) => Err(error),
        (None, None) => Err(Diagnostic::error("syntax::value", scan.span_of(0), "a value is missing")),
    }
}
