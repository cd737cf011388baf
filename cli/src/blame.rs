//! Who said what cannot be done: the command line, or a model.

use crate::stop::Stop;
use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// Who set a value, and so where it must be changed.
#[derive(Clone, Copy, Debug)]
pub enum By<'a> {
    /// The command line: status 2.
    Line,
    /// A model whose text is not at hand, shown by this name: status 1.
    Model(&'a str),
    /// A model with its text: status 1, at the place that says it.
    Text(&'a Compiled),
}

/// What somebody said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Said {
    /// The length of a step.
    Step,
    /// The distance of rows.
    Every,
    /// The period of a sampled region, s.
    Period(f64),
}

impl By<'_> {
    /// The command line, if it gives one of the conflicting numbers.
    pub fn unless(self, line: bool) -> Self {
        if line { By::Line } else { self }
    }

    /// A setting as it is written there.
    pub fn setting(self, name: &str) -> String {
        match self {
            By::Line => format!("--{name}"),
            By::Model(_) | By::Text(_) => format!("`{name}`"),
        }
    }

    /// The place at which a value is written, to be appended, if it is to be named.
    pub fn place(self) -> &'static str {
        match self {
            By::Line => "",
            By::Model(_) | By::Text(_) => " in `simulate`",
        }
    }

    /// Ends the command with an error in a value, and a suggested fix.
    pub fn refuse(self, said: Said, why: String, fix: String) -> Stop {
        match self {
            By::Line => Stop::Usage(format!("{why}; {fix}")),
            By::Model(name) => Stop::Model(format!("{name}: {why}; {fix}")),
            By::Text(compiled) => {
                let span = place(compiled, said);
                let error = Diagnostic::error("simulate::steps", span, why).help(fix);
                Stop::Placed(Box::new((compiled.sources().clone(), error)))
            }
        }
    }
}

/// The place at which a model gives a value, or the model itself.
fn place(compiled: &Compiled, said: Said) -> Span {
    let model = &compiled.stages().model;
    let span = match said {
        Said::Step => model.settings.step_at,
        Said::Every => model.settings.every_at,
        Said::Period(period) => model.samplings.iter().find(|s| s.period == period).map(|s| s.span),
    };
    span.unwrap_or(model.span)
}
