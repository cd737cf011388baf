//! What a stepper is called and what is known of it, as a scene says it.

use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::Program;
use bond_runtime::scene::{Entries, Properties, Stepper};

/// The name of a stepper and its properties.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Label {
    pub(crate) name: &'static str,
    pub(crate) properties: Properties,
    /// The stepper that takes the steps that this one cannot take.
    pub(crate) fallback: Option<&'static Label>,
}

impl Label {
    /// A stepper that is its program and nothing else.
    pub(crate) fn stepper(&self, program: Program) -> Stepper {
        Stepper::new(self.name, self.properties, program)
    }
}

/// A stepper of a cluster, and where its program stores the ledger's terms.
pub(crate) type Step = (Stepper, Vec<Entries>);

/// Why there is no step of a cluster by a stepper.
pub(crate) enum Refusal {
    /// The stepper cannot step the cluster, for a reason in words.
    Unfit(String),
    /// Something is wrong with the model, or with this crate.
    Wrong(Vec<Diagnostic>),
}

impl From<Vec<Diagnostic>> for Refusal {
    fn from(list: Vec<Diagnostic>) -> Self {
        Refusal::Wrong(list)
    }
}
