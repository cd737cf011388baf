//! Diagnostics and messages on standard error.

use crate::text::{Text, shown};
use bond_grammar::diagnostic::{Diagnostic, Label};
use bond_grammar::source::{SourceId, Sources};
use miette::{LabeledSpan, MietteHandler, MietteHandlerOpts, ReportHandler, Severity};
use std::borrow::Cow;
use std::fmt;
use std::io::{IsTerminal, Write};

/// Longest line that is drawn, bytes.
const LONGEST_LINE: usize = 2000;
/// Most lines of a span that is drawn whole; a longer one is drawn at its first line.
const TALLEST_SPAN: usize = 10;

/// Reports an error of the command line, or why the command cannot continue.
pub fn error(message: &str) {
    let [on, off] = if coloured() { ["\x1b[1;31m", "\x1b[0m"] } else { ["", ""] };
    say(&format!("{on}error:{off} {message}"));
}

/// Writes a line to standard error; a closed pipe is not an error.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Whether standard error may have colours.
pub fn coloured() -> bool {
    let forbidden = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
    !forbidden && std::io::stderr().is_terminal()
}

/// Draws diagnostics on standard error.
pub fn diagnostics(sources: &Sources, list: &[Diagnostic]) {
    let texts = Texts::new(sources, list);
    let mut out = std::io::stderr().lock();
    for d in list {
        if write!(out, "{}", drawn(&texts, d)).is_err() {
            return;
        }
    }
}

/// The sources that diagnostics point into, to be shared by all of them.
struct Texts<'a> {
    sources: &'a Sources,
    list: Vec<(SourceId, Text<'a>)>,
}

impl<'a> Texts<'a> {
    fn new(sources: &'a Sources, list: &[Diagnostic]) -> Self {
        let mut ids: Vec<SourceId> = list.iter().flat_map(|d| &d.labels).map(|l| l.span.source).collect();
        ids.sort_unstable();
        ids.dedup();
        let list = ids
            .into_iter()
            .map(|id| {
                let source = sources.get(id);
                (id, Text::new(&source.name, &source.text))
            })
            .collect();
        Self { sources, list }
    }

    fn get(&self, id: SourceId) -> Option<&Text<'a>> {
        self.list.iter().find(|t| t.0 == id).map(|t| &t.1)
    }
}

/// A diagnostic as text.
fn drawn(texts: &Texts, d: &Diagnostic) -> String {
    let long =
        |l: &Label| texts.get(l.span.source).is_some_and(|t| t.around(l.span.start as usize).len() > LONGEST_LINE);
    if d.labels.iter().any(long) {
        return d.render(texts.sources) + "\n";
    }
    let terminal = std::io::stderr().is_terminal();
    let mut options = MietteHandlerOpts::new().force_graphical(true).terminal_links(false).color(coloured());
    if !terminal {
        // Nothing is broken into lines where a program may read it.
        options = options.unicode(true).wrap_lines(false).width(100);
    }
    let shown = Shown(options.build(), Report::new(texts, d));
    let mut text = String::new();
    // A defect of the drawing must not hide what is wrong.
    let good = fmt::Write::write_fmt(&mut text, format_args!("{shown}")).is_ok();
    if good { text + "\n" } else { d.render(texts.sources) + "\n" }
}

struct Shown<'a>(MietteHandler, Report<'a>);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.debug(&self.1, f)
    }
}

/// A diagnostic in miette's terms. Labels in other files are reports of their own, as a report has one source.
#[derive(Debug)]
struct Report<'a> {
    message: String,
    code: Option<&'static str>,
    severity: Severity,
    help: Option<Cow<'a, str>>,
    source: Option<&'a Text<'a>>,
    labels: Vec<LabeledSpan>,
    related: Vec<Report<'a>>,
}

impl<'a> Report<'a> {
    fn new(texts: &'a Texts, d: &'a Diagnostic) -> Self {
        let home = d.labels.first().map(|l| l.span.source);
        let mut report = Self {
            message: shown(&d.message).into_owned(),
            code: Some(d.code),
            severity: if d.warning { Severity::Warning } else { Severity::Error },
            help: d.help.as_deref().map(shown),
            source: home.and_then(|id| texts.get(id)),
            labels: Vec::new(),
            related: Vec::new(),
        };
        for (i, label) in d.labels.iter().enumerate() {
            let Some(source) = texts.get(label.span.source) else { continue };
            let (start, end) = source.clamp(label.span.start as usize, label.span.end as usize, TALLEST_SPAN);
            let text = Some(shown(&label.text).into_owned()).filter(|t| !t.is_empty());
            if Some(label.span.source) == home {
                let make = if i == 0 { LabeledSpan::new_primary_with_span } else { LabeledSpan::new_with_span };
                report.labels.push(make(text, (start, end - start)));
            } else {
                report.related.push(Self {
                    message: format!("see {}", texts.sources.get(label.span.source).name),
                    code: None,
                    severity: Severity::Advice,
                    help: None,
                    source: Some(source),
                    labels: vec![LabeledSpan::new_primary_with_span(text, (start, end - start))],
                    related: Vec::new(),
                });
            }
        }
        report
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Report<'_> {}

impl miette::Diagnostic for Report<'_> {
    fn code<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        self.code.map(|c| Box::new(c) as Box<dyn fmt::Display>)
    }

    fn severity(&self) -> Option<Severity> {
        Some(self.severity)
    }

    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        self.help.as_ref().map(|h| Box::new(h) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.source.map(|s| s as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        (!self.labels.is_empty())
            .then(|| Box::new(self.labels.iter().cloned()) as Box<dyn Iterator<Item = LabeledSpan>>)
    }

    fn related<'b>(&'b self) -> Option<Box<dyn Iterator<Item = &'b dyn miette::Diagnostic> + 'b>> {
        (!self.related.is_empty()).then(|| {
            Box::new(self.related.iter().map(|r| r as &dyn miette::Diagnostic))
                as Box<dyn Iterator<Item = &dyn miette::Diagnostic>>
        })
    }
}
