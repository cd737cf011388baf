//! What several commands take: a file, a model of it, values for its parameters.

use crate::report;
use crate::stop::Stop;
use bond::internal::{OptionsInternals, Quantity, ReadError};
use bond::{Compiled, Errors, Given, InputSignal, Options, Text};
use bond_runtime::scene::Scene;
use std::path::Path;

/// `--model`.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Which {
    /// The model of the file to use. Default: the last one
    #[arg(long, value_name = "NAME")]
    pub model: Option<String>,
}

/// `--set` and `--without`: what is changed of a model.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Set {
    /// Set a parameter, such as `m=0.1kg` or `wall.k=2e3`; without a unit in SI; repeatable
    #[arg(long = "set", value_name = "PATH=VALUE", value_parser = assignment, allow_hyphen_values = true)]
    pub set: Vec<(String, Quantity)>,
    /// Leave out storages, resistors or fields, such as `wall.damper`; `bond reduce` finds which matter; repeatable
    #[arg(long = "without", value_name = "PATH,...", value_parser = paths)]
    left_out: Vec<Paths>,
}

/// Paths with commas between them.
#[derive(Clone, Debug)]
struct Paths(Vec<String>);

impl Set {
    /// The parts that are left out.
    pub fn without(&self) -> Vec<String> {
        self.left_out.iter().flat_map(|paths| paths.0.clone()).collect()
    }

    /// The parameters that are set, as path and value with its unit.
    pub fn written(&self) -> impl Iterator<Item = (&str, String)> {
        self.set.iter().map(|(path, (value, unit))| {
            let unit = unit.filter(|u| !u.is_one()).map(|u| format!(" {u}")).unwrap_or_default();
            (path.as_str(), format!("{value}{unit}"))
        })
    }
}

/// The paths of elements; a comma within brackets is one between indices.
fn paths(text: &str) -> Result<Paths, String> {
    let mut depth = 0;
    let between = |c: char| {
        depth += i32::from(c == '[') - i32::from(c == ']');
        c == ',' && depth == 0
    };
    let list: Vec<String> = text.split(between).map(path).collect();
    if list.iter().any(String::is_empty) { Err("the name of an element is missing".into()) } else { Ok(Paths(list)) }
}

/// A path in the form that models use: `cell[1, 2]` and `cell[1][2]` are `cell[1,2]`.
pub fn path(text: &str) -> String {
    text.split_whitespace().collect::<String>().replace("][", ",")
}

/// `path=value`.
fn assignment(text: &str) -> Result<(String, Quantity), String> {
    let (path, value) = text.split_once('=').ok_or("write it as PATH=VALUE, such as m=0.1kg")?;
    let path = self::path(path);
    if path.is_empty() {
        return Err("the name of the parameter is missing".into());
    }
    Ok((path, bond::internal::quantity(value)?))
}

/// A time.
pub fn time(text: &str) -> Result<f64, String> {
    bond::internal::seconds(text)
}

/// A time that is not before the start.
pub fn instant(text: &str) -> Result<f64, String> {
    let t = bond::internal::seconds(text)?;
    if t >= 0.0 { Ok(t) } else { Err("the run starts at 0 s".into()) }
}

/// A length of time.
pub fn span(text: &str) -> Result<f64, String> {
    let t = time(text)?;
    if t > 0.0 { Ok(t) } else { Err("it must be longer than 0 s".into()) }
}

/// A whole number within bounds.
pub fn count(text: &str, bounds: std::ops::RangeInclusive<u64>) -> Result<u64, String> {
    let (low, high) = (bounds.start(), bounds.end());
    text.parse().ok().filter(|n| bounds.contains(n)).ok_or_else(|| {
        if *high == u64::MAX {
            format!("it must be a whole number, at least {low}")
        } else {
            format!("it must be a whole number in {low}..={high}")
        }
    })
}

/// The name under which a file is shown.
pub fn name(path: &Path) -> String {
    if path == Path::new("-") { "<stdin>".into() } else { path.to_string_lossy().into_owned() }
}

/// What it means that a file cannot be read.
pub fn unreadable(path: &Path, e: &std::io::Error) -> Stop {
    let why = match e.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_string(),
        _ => e.to_string(),
    };
    Stop::Usage(format!("cannot read {}: {why}", name(path)))
}

/// Reads a text.
///
/// # Errors
/// Status 2 if the file cannot be read, 1 if it is not text.
pub fn read(path: &Path) -> Result<String, Stop> {
    bond::internal::read(path).map_err(|e| match e {
        ReadError::Unreadable(why) => Stop::Usage(format!("cannot read {}: {why}", name(path))),
        ReadError::NotText { line } => Stop::Model(format!("{}:{line}:1: line {line} is not UTF-8 text", name(path))),
    })
}

/// Options for the compiler.
///
/// # Errors
/// Status 2: a parameter that is set twice.
pub fn options(which: &Which, set: &Set) -> Result<Options, Stop> {
    let mut options = Options::new();
    for (i, (path, _)) in set.set.iter().enumerate() {
        if set.set[..i].iter().any(|(other, _)| other == path) {
            return Err(Stop::Usage(format!("--set gives `{path}` twice; leave one of them out")));
        }
    }
    if let Some(model) = &which.model {
        options = options.model(model);
    }
    for (path, value) in &set.set {
        options = options.set_quantity(path, *value);
    }
    for path in set.without() {
        options = options.without(path);
    }
    Ok(options)
}

/// Compiles a file, and draws what is wrong with it.
///
/// # Errors
/// A file that cannot be read, or a model that is wrong.
pub fn compile(path: &Path, options: &Options) -> Result<Compiled, Stop> {
    let text = read(path)?;
    options.compile_str(&name(path), text).map_err(|e| wrong(&e))
}

/// The inputs of a run, from a table; the column of each must be one of the model's.
///
/// # Errors
/// Status 2, with the line: a file that cannot be read, or is not such a table.
pub fn table(path: &Path, scene: &Scene, hold: bool) -> Result<Vec<(String, InputSignal)>, Stop> {
    let text = bond::internal::read_table(path).map_err(|e| Stop::Usage(format!("cannot read {}: {e}", name(path))))?;
    let wrong = |e: bond::TableError| Stop::Usage(format!("{}:{}: {}", name(path), e.line, e.message));
    let known: Vec<&str> = scene.inputs.iter().map(|i| i.name.as_str()).collect();
    Given::read(&text, &known).and_then(|table| table.signals(hold)).map_err(wrong)
}

/// Draws what is wrong.
pub fn wrong(errors: &Errors) -> Stop {
    report::diagnostics(errors.sources(), errors.list());
    errors.note().into_iter().for_each(|note| report::say(&format!("note: {note}")));
    Stop::Said(status(errors))
}

/// 2 where only what the command line asks for is wrong, else 1.
pub fn status(errors: &Errors) -> u8 {
    let asked = |code: &str| {
        matches!(code, "elaborate::set" | "elaborate::model" | "discretise::asked") || code.starts_with("omit::")
    };
    if !errors.list().is_empty() && errors.list().iter().all(|d| asked(d.code)) { 2 } else { 1 }
}

/// Whether nothing is wrong with a text but that it has no model, and it has functions: for other files.
pub fn functions_alone(text: &Text, errors: &Errors) -> bool {
    !text.functions_alone().is_empty() && errors.list().iter().all(|d| d.code == "elaborate::empty")
}
