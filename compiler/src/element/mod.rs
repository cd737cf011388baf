//! What each kind of element takes: its fields, its law, its units.

mod field;
mod fields;
mod integral;
mod line;
mod open_port;
mod resistor;
mod source;
mod steep;
mod storage;
mod two_port;

use crate::model::Kind;

/// Every kind that can be written, and how.
pub const ALL: [(&str, Kind); 16] = [
    ("Se", Kind::SE),
    ("MSe", Kind::SE),
    ("Sf", Kind::SF),
    ("MSf", Kind::SF),
    ("C", Kind::C),
    ("I", Kind::I),
    ("R", Kind::R),
    ("MR", Kind::R),
    ("TF", Kind::TF),
    ("MTF", Kind::TF),
    ("GY", Kind::GY),
    ("MGY", Kind::GY),
    ("0", Kind::ZERO),
    ("1", Kind::ONE),
    ("De", Kind::DE),
    ("Df", Kind::DF),
];

/// Whether a word before a colon means an element: one of [`ALL`], or a field that has ports of several kinds.
pub(crate) fn is_kind(word: &str) -> bool {
    matches!(word, "RS" | "IC" | "TL") || ALL.iter().any(|(kind, _)| *kind == word)
}
