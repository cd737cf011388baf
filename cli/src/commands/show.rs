//! `bond show`: the generated structure.

use crate::input::{self, Set, Which};
use crate::output;
use crate::stop::Stop;
use bond_compiler::show::{As, What};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::{Path, PathBuf};

/// Show the generated structure: bond graph, causality, port-Hamiltonian form, regions, step programs
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond show wall.bond\n  bond show wall.bond phs --as latex\n  bond show wall.bond causality --as svg -o wall.svg"
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// What to show
    #[arg(default_value = "all", value_parser = what())]
    what: What,
    /// The format
    #[arg(long = "as", value_name = "FORMAT", default_value = "text", value_parser = format())]
    format: As,
    /// Write it to a file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    which: Which,
    #[command(flatten)]
    set: Set,
}

fn what() -> impl TypedValueParser<Value = What> {
    PossibleValuesParser::new(What::ALL.map(What::name))
        .map(|name| What::ALL.into_iter().find(|w| w.name() == name).unwrap_or(What::All))
}

fn format() -> impl TypedValueParser<Value = As> {
    PossibleValuesParser::new(As::ALL.map(As::name))
        .map(|name| As::ALL.into_iter().find(|a| a.name() == name).unwrap_or(As::Text))
}

/// Refuses a name that ends as another format does.
fn fits(path: &Path, format: As) -> Result<(), Stop> {
    let Some(ending) = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase) else { return Ok(()) };
    let ending_of = |a: &As| match a {
        As::Text => "txt",
        As::Latex => "tex",
        As::Json | As::Dot | As::Svg => a.name(),
    };
    let of_another = As::ALL.iter().any(|a| *a != format && ending_of(a) == ending);
    if of_another || matches!(ending.as_str(), "png" | "jpg" | "jpeg" | "gif" | "pdf") {
        let (what, wanted) = (format.name(), ending_of(&format));
        return Err(Stop::Usage(format!(
            "{}: `--as {what}` does not write .{ending}; name it .{wanted}",
            path.display()
        )));
    }
    Ok(())
}

/// Shows it.
///
/// # Errors
/// A model that is wrong, or a format that cannot show what was asked for.
pub fn show(args: &Args) -> Result<(), Stop> {
    if let Some(path) = &args.output {
        output::place(path)?;
        fits(path, args.format)?;
        output::not_over(path, &[(&args.file, "the model")])?;
    }
    let compiled = input::compile(&args.file, &input::options(&args.which, &args.set)?)?;
    output::not_over_used(args.output.as_deref(), compiled.used())?;
    let mut text = compiled.show_as(args.what.name(), args.format.name()).map_err(Stop::Usage)?;
    if !text.ends_with('\n') {
        text.push('\n');
    }
    output::put(args.output.as_deref(), &text)
}
