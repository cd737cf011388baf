//! `bond check`: all that is wrong.

use crate::attribution::Attribution;
use crate::drive;
use crate::input::{self, Which};
use crate::lints::{lints, structure};
use crate::output;
use crate::report;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use crate::summary::left_out;
use bond::internal::{CompiledInternals, StepsInternals};
use bond::{Compiled, Steps, Text};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{Sources, Span};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Say all that is wrong with models: text, names, units, causality, form
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  bond check wall.bond\n  bond check models/*.bond --message-format json")]
pub struct Args {
    /// Models; `-` is standard input
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    which: Which,
    /// Text on standard error, or for editors one JSON object per line on standard output
    #[arg(long, value_enum, default_value_t = Format::Text)]
    message_format: Format,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Checks every file, whatever is wrong with those before it.
///
/// # Errors
/// What is wrong.
pub fn check(args: &Args) -> Result<(), Stop> {
    let mut status = 0;
    for path in &args.files {
        let name = input::name(path);
        let text = match input::read(path) {
            Ok(text) => text,
            Err(stop) => {
                status = status.max(alone(args.message_format, path, "file::read", stop)?);
                continue;
            }
        };
        let text = Text::new(&name, text);
        match input::options(&args.which, &input::Set::default())?.compile_text(&text) {
            Ok(compiled) => match feasible(&compiled) {
                Ok(()) => {
                    report::say(&fine(&name, &compiled));
                    let notes = lints(&compiled).into_iter().chain(structure(&compiled));
                    notes.for_each(|r| report::say(&format!("note: {r}")));
                }
                Err(Stop::Placed(placed)) => {
                    tell(args.message_format, &placed.0, std::slice::from_ref(&placed.1))?;
                    status = status.max(1);
                }
                Err(stop) => status = status.max(alone(args.message_format, path, "simulate::steps", stop)?),
            },
            // A file that others use need not have a model.
            Err(errors) if input::functions_alone(&text, &errors) => {
                report::say(&format!("ok: {name} (no model; functions: {})", text.functions_alone().join(", ")));
            }
            Err(errors) => {
                status = status.max(input::status(&errors));
                tell(args.message_format, errors.sources(), errors.list())?;
                errors.note().into_iter().for_each(|note| report::say(&format!("note: {note}")));
            }
        }
    }
    if status == 0 { Ok(()) } else { Err(Stop::Said(status)) }
}

fn fine(name: &str, compiled: &Compiled) -> String {
    let scene = compiled.scene();
    let states: usize = scene.regions.iter().map(|r| r.states).sum();
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let left = left_out(&scene.left_out).map_or_else(String::new, |left| format!("; left out: {left}"));
    format!("ok: {name} ({}: {}, {}{left})", scene.name, count(scene.regions.len(), "region"), count(states, "state"))
}

/// Whether it can be run as it says itself.
fn feasible(compiled: &Compiled) -> Result<(), Stop> {
    let (settings, by) = (&compiled.stages().model.settings, Attribution::Text(compiled));
    let stop = settings.stop.unwrap_or(1.0);
    Rows::new(stop, Grid::asked(None, settings.every, &[]), &[], by)?;
    drive::possible(compiled.scene(), &Steps::new().resolve(settings, stop, settings.every)?, stop, by)
}

/// Says what is wrong with a file at places of its text.
fn tell(format: Format, sources: &Sources, list: &[Diagnostic]) -> Result<(), Stop> {
    match format {
        Format::Text => report::diagnostics(sources, list),
        Format::Json => {
            for d in list {
                line(&Message::new(sources, d))?;
            }
        }
    }
    Ok(())
}

/// Says what is wrong with a file at no place in its text, and gives the status of that.
fn alone(format: Format, path: &Path, code: &'static str, stop: Stop) -> Result<u8, Stop> {
    let (message, status) = match stop {
        Stop::Usage(message) => (message, 2),
        Stop::Model(message) => (message, 1),
        other => return Err(other),
    };
    match format {
        Format::Text => report::error(&message),
        Format::Json => line(&Message {
            code,
            severity: "error",
            message,
            place: Place { file: input::name(path), line: 1, column: 1, end_line: 1, end_column: 1 },
            labels: vec![],
            help: None,
        })?,
    }
    Ok(status)
}

fn line(message: &Message) -> Result<(), Stop> {
    let text = serde_json::to_string(message).map_err(|e| Stop::Usage(e.to_string()))?;
    output::offer(&(text + "\n"))
}

/// A diagnostic for editors. Lines and columns count from 1, columns in characters; the end is exclusive.
#[derive(Serialize)]
struct Message {
    code: &'static str,
    severity: &'static str,
    message: String,
    #[serde(flatten)]
    place: Place,
    labels: Vec<Label>,
    help: Option<String>,
}

#[derive(Serialize)]
struct Place {
    file: String,
    line: usize,
    column: usize,
    end_line: usize,
    end_column: usize,
}

#[derive(Serialize)]
struct Label {
    #[serde(flatten)]
    place: Place,
    text: String,
}

impl Place {
    fn new(sources: &Sources, span: Span) -> Self {
        let (line, column) = sources.position(span);
        let (end_line, end_column) = sources.position(Span { start: span.end.max(span.start), ..span });
        Self { file: sources.get(span.source).name.clone(), line, column, end_line, end_column }
    }
}

impl Message {
    fn new(sources: &Sources, d: &Diagnostic) -> Self {
        let nowhere = || Place { file: String::new(), line: 1, column: 1, end_line: 1, end_column: 1 };
        Self {
            code: d.code,
            severity: if d.warning { "warning" } else { "error" },
            message: d.message.clone(),
            place: d.labels.first().map_or_else(nowhere, |l| Place::new(sources, l.span)),
            labels: d
                .labels
                .iter()
                .map(|l| Label { place: Place::new(sources, l.span), text: l.text.clone() })
                .collect(),
            help: d.help.clone(),
        }
    }
}
