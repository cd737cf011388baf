//! `bond doc`: what the bundled library has, and how a part is used.

use crate::document::{Arrow, Component, Document, document};
use crate::input;
use crate::output;
use crate::report;
use crate::stop::Stop;
use bond::internal::FileLoader;
use bond_compiler::elaborate::{LIBRARY, NoFiles, nearest};
use bond_compiler::units;
use bond_grammar::source::Sources;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Say what the bundled library has, or what the models of a file are: docs, ports, parameters, inputs, outputs
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond doc                         every component of the bundled library, one per line\n  \
                  bond doc std.electrical          all of one library\n  bond doc std.electrical.Diode    one component\n  \
                  bond doc wall.bond --as json     the models of a file, for other programs\n  \
                  bond doc wall.bond --as markdown > wall.md"
)]
pub struct Args {
    /// A library, a component or a file (`-` is standard input). Default: all libraries
    #[arg(value_name = "LIBRARY|COMPONENT|FILE")]
    what: Option<String>,
    /// How to say it
    #[arg(long = "as", value_name = "FORMAT", value_enum, default_value_t = Format::Text)]
    format: Format,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    Text,
    Json,
    /// A page, of one library or file
    Markdown,
}

/// What was found.
#[derive(Serialize)]
struct Found {
    libraries: Vec<Document>,
    /// Whether a line is said of each component, not all.
    #[serde(skip)]
    brief: bool,
}

/// Says it.
///
/// # Errors
/// A name that means nothing, a file that cannot be read.
pub fn doc(args: &Args) -> Result<(), Stop> {
    let found = match args.what.as_deref() {
        None | Some("std") => Found { libraries: all()?, brief: true },
        Some(what) if is_file(what) => Found { libraries: vec![file(what)?], brief: false },
        Some(what) => Found { libraries: vec![bundled(what)?], brief: false },
    };
    let text = match args.format {
        Format::Text if found.brief => lines(&found.libraries),
        Format::Text => found.libraries.iter().map(full).collect(),
        Format::Markdown => found.libraries.iter().map(page).collect::<Vec<_>>().join("\n"),
        Format::Json => serde_json::to_string_pretty(&found).map_err(|e| Stop::Usage(e.to_string()))? + "\n",
    };
    output::print(&text)
}

/// A name of the library has neither a slash nor an ending.
fn is_file(what: &str) -> bool {
    what == "-" || what.contains(['/', '\\']) || what.ends_with(".bond")
}

fn file(path: &str) -> Result<Document, Stop> {
    let name = input::name(Path::new(path));
    let mut sources = Sources::new();
    let id = sources.add(name.clone(), input::read(Path::new(path))?);
    document(&name, &mut sources, id, &mut FileLoader::new(&name)).map_err(|errors| {
        report::diagnostics(&sources, &errors);
        Stop::Said(1)
    })
}

fn library((name, text): &(&str, &str)) -> Result<Document, Stop> {
    let mut sources = Sources::new();
    let id = sources.add(format!("std/{name}.bond"), *text);
    document(&format!("std.{name}"), &mut sources, id, &mut NoFiles).map_err(|errors| {
        report::diagnostics(&sources, &errors);
        Stop::Said(1)
    })
}

fn all() -> Result<Vec<Document>, Stop> {
    LIBRARY.iter().map(library).collect()
}

/// `std.electrical`, `std.electrical.Diode`, or either without what goes before it.
fn bundled(what: &str) -> Result<Document, Stop> {
    let short = what.strip_prefix("std.").unwrap_or(what);
    let (first, rest) = short.split_once('.').map_or((short, None), |(a, b)| (a, Some(b)));
    if let Some(found) = LIBRARY.iter().find(|l| l.0 == first) {
        let whole = library(found)?;
        let Some(part) = rest else { return Ok(whole) };
        if !whole.components.iter().any(|c| c.name == part) {
            return Err(unknown(what, std::slice::from_ref(&whole), part));
        }
        return Ok(alone(whole, part));
    }
    let mut list = all()?;
    if let Some(at) = list.iter().position(|l| l.components.iter().any(|c| c.name == short)) {
        return Ok(alone(list.swap_remove(at), short));
    }
    Err(unknown(what, &list, rest.unwrap_or(short)))
}

/// One component, without what its file says of all of them.
fn alone(mut library: Document, part: &str) -> Document {
    library.components.retain(|c| c.name == part);
    library.doc.clear();
    library
}

/// Says that a name means nothing, and which was meant, perhaps.
fn unknown(what: &str, list: &[Document], part: &str) -> Stop {
    let library = what.strip_prefix("std.").unwrap_or(what);
    let library = library.split_once('.').map_or(library, |(a, _)| a);
    let names = || list.iter().flat_map(|l| l.components.iter().map(move |c| (l, c)));
    let known = || names().map(|(_, c)| c.name.as_str());
    let like = known()
        .find(|name| *name == part)
        .or_else(|| nearest(part, known()))
        .and_then(|near| names().find(|(_, c)| c.name == near))
        .map(|(l, c)| format!("{}.{}", l.name, c.name))
        .or_else(|| nearest(library, LIBRARY.iter().map(|l| l.0)).map(|near| format!("std.{near}")));
    let help = match like {
        Some(name) => format!("did you mean `{name}`?"),
        None => "`bond doc` lists all there is; the path of a file ends in .bond".to_string(),
    };
    Stop::Usage(format!("there is no library or component `{what}`: {help}"))
}

/// A line each.
fn lines(list: &[Document]) -> String {
    let widest = list.iter().flat_map(|l| &l.components).map(|c| c.name.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for (i, library) in list.iter().enumerate() {
        let _ = writeln!(text, "{}{}: {}", if i > 0 { "\n" } else { "" }, library.name, sentence(&library.doc));
        for c in &library.components {
            let _ = writeln!(text, "  {:widest$}  {}", c.name, sentence(&c.doc));
        }
    }
    text
}

/// The first sentence of a doc.
fn sentence(doc: &[String]) -> String {
    let first: Vec<&str> = doc.iter().map(|line| line.trim()).take_while(|line| !line.is_empty()).collect();
    let text = first.join(" ");
    text.split_once(". ").map_or(text.clone(), |(head, _)| format!("{head}."))
}

/// All that is known of a file.
fn full(library: &Document) -> String {
    let mut text = String::new();
    let own = !library.name.starts_with("std.");
    if own || !library.doc.is_empty() {
        let _ = writeln!(text, "{}", library.name);
        paragraph(&mut text, "  ", &library.doc);
    }
    if library.components.is_empty() {
        text += "\nIt has no models.\n";
    }
    for c in &library.components {
        let title = if own { c.name.clone() } else { format!("{}.{}", library.name, c.name) };
        let _ = writeln!(text, "{}{title}", if text.is_empty() { "" } else { "\n" });
        component(&mut text, c);
    }
    text
}

fn paragraph(text: &mut String, indent: &str, doc: &[String]) {
    for line in doc {
        let _ = writeln!(text, "{}", format!("{indent}{line}").trim_end());
    }
}

fn component(text: &mut String, c: &Component) {
    paragraph(text, "  ", &c.doc);
    for (title, _, rows) in tables(c) {
        table(text, title, &rows);
    }
}

/// Title, heads of the columns, and rows.
type Table = (&'static str, &'static [&'static str], Vec<Vec<String>>);

/// What a model has, in tables that are not empty.
fn tables(c: &Component) -> Vec<Table> {
    let ports = c.ports.iter().map(|p| {
        let arrow = match p.arrow {
            Some(Arrow::In) => "-> in",
            Some(Arrow::Out) => "out ->",
            None => "",
        };
        let unit = |u: &Option<String>| u.as_deref().map_or("?", units::in_prose).to_string();
        let pair = match (&p.effort, &p.flow) {
            (None, None) => "as bonded".to_string(),
            (e, f) => format!("{}, {}", unit(e), unit(f)),
        };
        vec![p.name.clone(), arrow.to_string(), pair, p.doc.join(" ")]
    });
    let mut list: Vec<Table> = vec![("ports", &["port", "half arrow", "effort, flow", ""], ports.collect())];
    for (title, of) in [("parameters", &c.parameters), ("inputs", &c.inputs)] {
        let rows = of.iter().map(|p| {
            // A default that is not a plain number has its unit beside it.
            let default = p.default.clone().unwrap_or_else(|| "must be given".into());
            let unit = p.unit.clone().filter(|u| u != "1" && !default.contains(' ')).unwrap_or_default();
            vec![p.name.clone(), default, unit, p.doc.join(" ")]
        });
        let heads: &[&str] =
            if title == "inputs" { &["input", "default", "", ""] } else { &["parameter", "default", "", ""] };
        list.push((title, heads, rows.collect()));
    }
    for (title, of) in [("outputs", &c.outputs), ("probes", &c.probes)] {
        let rows = of.iter().map(|p| {
            // What has no unit alone may have that of what it is given.
            let unit = p.unit.clone().filter(|u| u != "1").unwrap_or_default();
            vec![p.name.clone(), unit, p.doc.join(" ")]
        });
        let heads: &[&str] = if title == "outputs" { &["output", "unit", ""] } else { &["probe", "unit", ""] };
        list.push((title, heads, rows.collect()));
    }
    list.retain(|(_, _, rows)| !rows.is_empty());
    list
}

/// Rows under a title, in columns.
fn table(text: &mut String, title: &str, rows: &[Vec<String>]) {
    let mut wide = vec![0; rows.first().map_or(0, Vec::len)];
    for row in rows {
        for (w, cell) in wide.iter_mut().zip(row) {
            *w = (*w).max(cell.chars().count());
        }
    }
    let _ = writeln!(text, "\n  {title}");
    for row in rows {
        let cells: Vec<String> = row.iter().zip(&wide).map(|(cell, &w)| format!("{cell:w$}")).collect();
        let _ = writeln!(text, "    {}", cells.join("  ").trim_end());
    }
}

/// All that is known of a file, as a page of Markdown.
fn page(library: &Document) -> String {
    let mut text = format!("# {}\n\n", library.name);
    prose(&mut text, &library.doc);
    for c in &library.components {
        let _ = writeln!(text, "## {}\n", c.name);
        prose(&mut text, &c.doc);
        for (_, heads, rows) in tables(c) {
            // A column that is empty throughout says nothing.
            let said: Vec<usize> = (0..heads.len()).filter(|&k| rows.iter().any(|r| !r[k].is_empty())).collect();
            let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
            text += &line(said.iter().map(|&k| heads[k].to_string()).collect());
            text += &line(said.iter().map(|_| "---".to_string()).collect());
            for row in &rows {
                text += &line(said.iter().map(|&k| cell(k, &row[k])).collect());
            }
            text.push('\n');
        }
    }
    text.truncate(text.trim_end().len());
    text + "\n"
}

/// Paragraphs; what is indented is an example in the language.
fn prose(text: &mut String, doc: &[String]) {
    let mut inside = false;
    for line in doc.iter().map(String::as_str).chain([""]) {
        let example = line.strip_prefix("    ");
        if example.is_some() != inside {
            text.push_str(if inside { "```\n" } else { "```bond\n" });
            inside = !inside;
        }
        // One empty line at most, as after an example that ends the text.
        if !line.is_empty() || !text.ends_with("\n\n") {
            let _ = writeln!(text, "{}", example.map_or_else(|| plain(line), String::from));
        }
    }
}

/// An entry of a table: a name in the first column, then text.
fn cell(column: usize, text: &str) -> String {
    let text = if column == 0 { format!("`{text}`") } else { plain(text) };
    text.replace('|', "\\|")
}

/// Text in which Markdown sees no marks but those of code.
fn plain(text: &str) -> String {
    let mut code = false;
    let mut out = String::new();
    for c in text.chars() {
        code ^= c == '`';
        if !code && matches!(c, '*' | '_' | '<' | '[' | ']' | '\\') {
            out.push('\\');
        }
        out.push(c);
    }
    out
}
