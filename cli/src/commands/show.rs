//! `bond show`: the generated structure.

use crate::input::{self, Set, Which};
use crate::output;
use crate::stop::Stop;
use bond::internal::CompiledInternals;
use bond_compiler::show::{As, Labels, Picture, What};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::{Path, PathBuf};

/// Show the generated structure: bond graph, causality, port-Hamiltonian form, regions, step programs
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond show wall.bond\n  bond show wall.bond phs --as latex\n  bond show wall.bond -o wall.svg\n  bond show robot.bond -o robot.tex causality --labels numbers --depth 1"
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// What to show
    #[arg(default_value = "all", value_parser = what())]
    what: What,
    /// The format. Default: what the name of the output ends in (.txt, .json, .dot, .svg, .tex), else text
    #[arg(long = "as", value_name = "FORMAT", value_parser = format())]
    format: Option<As>,
    /// What is written at the bonds of a picture: their names in the model, numbers, or efforts and flows
    #[arg(long, value_name = "WHAT", default_value = "none", value_parser = labels())]
    labels: Labels,
    /// Draw parts that are nested deeper than this as boxes; 0 draws each part of the scene as one. Default: all is
    /// looked into
    #[arg(long, value_name = "N")]
    depth: Option<usize>,
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

fn labels() -> impl TypedValueParser<Value = Labels> {
    PossibleValuesParser::new(Labels::ALL.map(Labels::name))
        .map(|name| Labels::ALL.into_iter().find(|l| l.name() == name).unwrap_or_default())
}

/// What a file of a format is called.
fn ending_of(format: As) -> &'static str {
    match format {
        As::Text => "txt",
        As::Latex => "tex",
        As::Json | As::Dot | As::Svg => format.name(),
    }
}

/// How a file's name ends, in small letters.
fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase)
}

/// Refuses a name that ends as another format does.
fn fits(path: &Path, format: As) -> Result<(), Stop> {
    let Some(ending) = ending(path) else { return Ok(()) };
    let (name, what, wanted) = (path.display(), format.name(), ending_of(format));
    if matches!(ending.as_str(), "png" | "jpg" | "jpeg" | "gif" | "pdf") {
        return Err(Stop::Usage(format!(
            "{name}: `bond show` does not write .{ending}; name it .svg, which `rsvg-convert` makes a .png or .pdf of"
        )));
    }
    if As::ALL.iter().any(|a| *a != format && ending_of(*a) == ending) {
        return Err(Stop::Usage(format!("{name}: `--as {what}` does not write .{ending}; name it .{wanted}")));
    }
    Ok(())
}

/// Shows it.
///
/// # Errors
/// A model that is wrong, or a format that cannot show what was asked for.
pub fn show(args: &Args) -> Result<(), Stop> {
    let named = args.output.as_deref().and_then(ending);
    let by_name = named.and_then(|end| As::ALL.into_iter().find(|a| ending_of(*a) == end));
    let format = args.format.or(by_name).unwrap_or(As::Text);
    if let Some(path) = &args.output {
        output::place(path)?;
        fits(path, format)?;
        output::not_over(path, &[(&args.file, "the model")])?;
    }
    let picture = Picture { labels: args.labels, depth: args.depth.unwrap_or(usize::MAX) };
    let compiled = input::compile(&args.file, &input::options(&args.which, &args.set)?)?;
    output::not_over_used(args.output.as_deref(), compiled.used())?;
    let mut text = compiled.show_drawn(args.what, format, picture).map_err(Stop::Usage)?;
    if !text.ends_with('\n') {
        text.push('\n');
    }
    output::put(args.output.as_deref(), &text)
}
