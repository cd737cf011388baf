//! All that is wrong with a model, with the texts it is written in.

use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Sources;
use std::fmt;

/// What is wrong with a model. Displays as plain text, with file, line and column of each place.
#[derive(Clone, Debug)]
pub struct Errors {
    sources: Sources,
    list: Vec<Diagnostic>,
    note: Option<String>,
}

impl Errors {
    pub(crate) fn new(sources: Sources, list: Vec<Diagnostic>) -> Self {
        Self { sources, list, note: None }
    }

    pub(crate) fn with_note(self, note: Option<String>) -> Self {
        Self { note, ..self }
    }

    /// That another model of the text may have been meant as the scene, if one may.
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// The texts that the diagnostics point into.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// Each of them, in order of place.
    pub fn list(&self) -> &[Diagnostic] {
        &self.list
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, d) in self.list.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            f.write_str(&d.render(&self.sources))?;
        }
        if let Some(note) = &self.note {
            write!(f, "\nnote: {note}\n")?;
        }
        Ok(())
    }
}

impl std::error::Error for Errors {}
