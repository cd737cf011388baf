//! Attribution of settings that cannot be met: to the command line, or to the model that states them.

use crate::stop::Stop;
use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// Who set a value, and so where it must be changed.
#[derive(Clone, Copy, Debug)]
pub enum Attribution<'a> {
    /// The command line: status 2.
    CommandLine,
    /// A model whose text is not at hand, shown by this name: status 1.
    Model(&'a str),
    /// A model with its text: status 1, at the place that says it.
    Text(&'a Compiled),
}

/// A setting that may be impossible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Statement {
    /// The length of a step.
    Step,
    /// The distance of rows.
    Every,
    /// The period of a sampled region, s.
    Period(f64),
}

impl Attribution<'_> {
    /// The command line, if it gives one of the conflicting numbers.
    pub fn or_command_line(self, states: bool) -> Self {
        if states { Attribution::CommandLine } else { self }
    }

    /// A setting as it is written there.
    pub fn setting(self, name: &str) -> String {
        match self {
            Attribution::CommandLine => format!("--{name}"),
            Attribution::Model(_) | Attribution::Text(_) => format!("`{name}`"),
        }
    }

    /// The place at which a value is written, to be appended, if it is to be named.
    pub fn place(self) -> &'static str {
        match self {
            Attribution::CommandLine => "",
            Attribution::Model(_) | Attribution::Text(_) => " in `simulate`",
        }
    }

    /// Ends the command with an error in a value, and a suggested fix.
    pub fn refuse(self, statement: Statement, why: String, fix: String) -> Stop {
        match self {
            Attribution::CommandLine => Stop::Usage(format!("{why}; {fix}")),
            Attribution::Model(name) => Stop::Model(format!("{name}: {why}; {fix}")),
            Attribution::Text(compiled) => {
                let span = place(compiled, statement);
                let error = Diagnostic::error("simulate::steps", span, why).help(fix);
                Stop::Placed(Box::new((compiled.sources().clone(), error)))
            }
        }
    }
}

/// The place at which a model gives a value, or the model itself.
fn place(compiled: &Compiled, statement: Statement) -> Span {
    let model = &compiled.stages().model;
    let span = match statement {
        Statement::Step => model.settings.step_at,
        Statement::Every => model.settings.every_at,
        Statement::Period(period) => model.samplings.iter().find(|s| s.period == period).map(|s| s.span),
    };
    span.unwrap_or(model.span)
}
