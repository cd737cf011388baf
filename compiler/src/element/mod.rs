//! What each kind of element takes: its fields, its law, its units.

mod field;
mod fields;
mod integral;
mod resistor;
mod source;
mod storage;
mod two_port;

use crate::model::Kind;

/// Every kind that can be written, and how.
pub const ALL: [(&str, Kind); 16] = [
    ("Se", Kind::Se),
    ("MSe", Kind::Se),
    ("Sf", Kind::Sf),
    ("MSf", Kind::Sf),
    ("C", Kind::C),
    ("I", Kind::I),
    ("R", Kind::R),
    ("MR", Kind::R),
    ("TF", Kind::Tf),
    ("MTF", Kind::Tf),
    ("GY", Kind::Gy),
    ("MGY", Kind::Gy),
    ("0", Kind::Zero),
    ("1", Kind::One),
    ("De", Kind::De),
    ("Df", Kind::Df),
];

/// Whether a word before a colon means an element: one of [`ALL`], or a field that has ports of several kinds.
pub(crate) fn is_kind(word: &str) -> bool {
    matches!(word, "RS" | "IC") || ALL.iter().any(|(kind, _)| *kind == word)
}
