//! The page: its tables are measured, its words stay.

use super::figure::{self, Figure};
use super::program::{self, Folder};
use super::ways::{Ways, What};
use super::{scene, tables};
use std::fmt::Write;
use std::path::Path;

/// Readings of each way; they go round, so that what disturbs one disturbs all.
const ROUNDS: usize = 5;

/// What one figure came to.
struct Row {
    figure: Figure,
    times: Vec<(What, f64)>,
    missing: Vec<String>,
}

impl Row {
    /// Time of a unit, ns.
    fn time(&self, what: What) -> Option<f64> {
        self.times.iter().find(|(w, _)| *w == what).map(|(_, ns)| *ns)
    }
}

/// Measures all, and writes the page anew.
///
/// # Errors
/// In words; the page then is what it was.
pub fn write(large: bool) -> Result<(), String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/inside/performance.md");
    let mut page = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let folder = Folder::new()?;
    let load = load();
    let chain = |links: &mut Vec<f64>| links.extend(tables::chain(&folder));
    let mut links = Vec::new();
    let mut rows = Vec::new();
    for figure in figure::all() {
        chain(&mut links);
        rows.push(measure(&folder, figure)?);
    }
    chain(&mut links);
    eprintln!("compiling, ensembles, starting");
    let sections = [
        ("machine", machine(&links, &load)),
        ("bars", bars(&rows)),
        ("ways", ways(&rows)),
        ("missing", missing(&rows)),
        ("compiling", tables::compile_times()),
        ("ensembles", tables::ensembles(&folder)),
        ("starting", tables::starts(&folder)),
    ];
    for (name, text) in sections {
        page = replaced(&page, name, &text)?;
    }
    if large {
        page = replaced(&page, "large", &tables::large())?;
    }
    let beside = path.with_extension("md.part");
    std::fs::write(&beside, page).map_err(|e| format!("{}: {e}", beside.display()))?;
    std::fs::rename(&beside, &path).map_err(|e| format!("{}: {e}", path.display()))
}

fn measure(folder: &Folder, figure: Figure) -> Result<Row, String> {
    eprintln!("{}", figure.title);
    let compiled = scene::compile(&figure)?;
    let mut ways = Ways::new(folder, &figure, &compiled, &|name| eprintln!("  {name}"));
    let mut missing = ways.missing;
    for _ in 0..ROUNDS {
        for way in &mut ways.list {
            if let Err(e) = way.read() {
                missing.push(format!("{}: {e}", way.what.name()));
                way.best = f64::NAN;
            }
        }
    }
    missing.dedup();
    let per = figure.per as f64;
    let times = ways.list.iter().filter(|w| w.best.is_finite()).map(|w| (w.what, w.best / per)).collect();
    Ok(Row { figure, times, missing })
}

/// How busy the machine is.
fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().unwrap_or("unknown").to_string()
}

fn machine(links: &[f64], before: &str) -> String {
    let (least, most) = links.iter().fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(*x), b.max(*x)));
    let chain =
        if links.is_empty() { "not measured, there is no `cc`".into() } else { format!("{least:.2} to {most:.2} ns") };
    format!(
        "Measured on {}; load average {before} before and {} after. One link of a chain of dependent multiply-adds: {chain} over the run.\n",
        program::machine(),
        load(),
    )
}

/// A time with three digits, ns.
fn digits(ns: f64) -> String {
    match ns {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        x => format!("{x:.2}"),
    }
}

/// Text that may stand in a table.
pub fn cell(text: &str) -> String {
    text.replace('|', "/").replace('\n', " ")
}

/// Against what is asked for, in times of C by hand: that is measured beside it, on the same machine.
fn bars(rows: &[Row]) -> String {
    let mut out = String::from(
        "| work | C by hand | `bond run` | times C | at most | met | emitted C | times C | at most | met |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows {
        let hand = row.time(What::Hand);
        let emitted = [What::Plain, What::Tuned].into_iter().filter_map(|w| row.time(w)).reduce(f64::min);
        let bars = row.figure.bars;
        let against = |ours: Option<f64>, bar: f64| {
            let (time, most) = (ours.map_or("-".into(), digits), bar / bars.hand);
            let Some(times) = ours.zip(hand).map(|(a, b)| a / b) else { return format!("{time} | - | {most:.2} | -") };
            format!("{time} | {times:.2} | {most:.2} | {}", if times <= most { "yes" } else { "no" })
        };
        let _ = writeln!(
            out,
            "| {}, {} | {} | {} | {} |",
            row.figure.title,
            row.figure.unit,
            hand.map_or("-".into(), digits),
            against(row.time(What::Run), bars.run),
            against(emitted, bars.c),
        );
    }
    out
}

/// All ways.
fn ways(rows: &[Row]) -> String {
    let mut out = String::from("| work |");
    for what in What::ALL {
        let _ = write!(out, " {} |", what.name());
    }
    let _ = writeln!(out, "\n|{}", " --- |".repeat(1 + What::ALL.len()));
    for row in rows {
        let _ = write!(out, "| {} |", row.figure.title);
        for what in What::ALL {
            let _ = write!(out, " {} |", row.time(what).map_or("-".into(), digits));
        }
        out.push('\n');
    }
    out
}

/// Why there are gaps.
fn missing(rows: &[Row]) -> String {
    let mut out = String::new();
    if !program::is_there() {
        return "There was no `cc`, so that all columns of C are left out.\n".into();
    }
    for row in rows {
        for why in &row.missing {
            let _ = writeln!(out, "- {}, {}", row.figure.title, cell(why));
        }
    }
    if out.is_empty() { "Nothing was left out.\n".into() } else { format!("Left out:\n\n{out}") }
}

/// A page with the text between two of its marks made new.
fn replaced(page: &str, name: &str, text: &str) -> Result<String, String> {
    let (from, to) = (format!("<!-- measured: {name} -->\n"), format!("<!-- end of {name} -->"));
    let gone =
        || format!("docs/inside/performance.md has no section `{name}`: it is between {} and {to}", from.trim_end());
    let (before, rest) = page.split_once(&from).ok_or_else(gone)?;
    let (_, after) = rest.split_once(&to).ok_or_else(gone)?;
    Ok(format!("{before}{from}\n{text}\n{to}{after}"))
}
