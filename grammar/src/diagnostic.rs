//! Errors and warnings: what is wrong with a model, where, and a suggested fix.

use crate::source::{Sources, Span};
use std::collections::HashSet;
use std::fmt;

/// A place in a text, with a few words about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// Where.
    pub span: Span,
    /// A few words; may be empty.
    pub text: String,
}

/// One error or warning. The first label is the place it is reported at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable name, `stage::what`, such as `causality::conflict`.
    pub code: &'static str,
    /// A warning: the model still has a meaning.
    pub warning: bool,
    /// What is wrong, in a modeller's words, naming the element or bond.
    pub message: String,
    /// The places.
    pub labels: Vec<Label>,
    /// A suggested fix.
    pub help: Option<String>,
}

/// Keeps the first error of each code at the same places: rounds of a loop and instances of a model repeat it.
pub fn once(mut errors: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let mut told = HashSet::new();
    errors.retain(|e| told.insert((e.code, e.labels.iter().map(|l| l.span).collect::<Vec<_>>())));
    errors
}

impl Diagnostic {
    /// An error at a place.
    pub fn error(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        let labels = vec![Label { span, text: String::new() }];
        Self { code, warning: false, message: message.into(), labels, help: None }
    }

    /// A warning at a place.
    pub fn warning(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Self { warning: true, ..Self::error(code, span, message) }
    }

    /// Sets the text of the first label.
    pub fn here(mut self, text: impl Into<String>) -> Self {
        if let Some(first) = self.labels.first_mut() {
            first.text = text.into();
        }
        self
    }

    /// Adds a further place, unless it is there already with the same text.
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Self {
        let label = Label { span, text: text.into() };
        if !self.labels.contains(&label) {
            self.labels.push(label);
        }
        self
    }

    /// Adds a suggested fix.
    pub fn help(mut self, text: impl Into<String>) -> Self {
        self.help = Some(text.into());
        self
    }

    /// Renders it as plain text: `file:line:column: error[code]: message`, then one line per label, then the help.
    pub fn render(&self, sources: &Sources) -> String {
        struct Show<'a>(&'a Diagnostic, &'a Sources);
        impl fmt::Display for Show<'_> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let Show(d, sources) = self;
                let kind = if d.warning { "warning" } else { "error" };
                for (i, label) in d.labels.iter().enumerate() {
                    let (line, column) = sources.position(label.span);
                    let name = &sources.get(label.span.source).name;
                    if i == 0 {
                        writeln!(f, "{name}:{line}:{column}: {kind}[{}]: {}", d.code, d.message)?;
                    }
                    if i > 0 || !label.text.is_empty() {
                        writeln!(
                            f,
                            "  {name}:{line}:{column}: `{}` {}",
                            sources.slice(label.span).lines().next().unwrap_or(""),
                            label.text
                        )?;
                    }
                }
                match &d.help {
                    Some(help) => writeln!(f, "  help: {help}"),
                    None => Ok(()),
                }
            }
        }
        Show(self, sources).to_string()
    }
}
