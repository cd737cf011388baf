//! `bond build`: from a model to what runs without `bond`.

use crate::emit::Emission;
use crate::input::{self, Set, Which};
use crate::stop::Stop;
use bond_compiler::discretise::Method;
use clap::builder::PossibleValuesParser;
use std::path::PathBuf;

/// Build a model into what runs without `bond`
#[derive(clap::Args)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The file to write
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// What to build
    #[arg(long, value_enum, default_value_t = Emit::C)]
    emit: Emit,
    /// Fixed step of continuous regions
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true)]
    step: Option<f64>,
    /// What public names begin with
    #[arg(long, value_name = "NAME", default_value = "bond")]
    prefix: String,
    /// Stepper of every region that can take it
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    method: Option<String>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
}

/// What is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Emit {
    /// C99 source and its header
    C,
}

/// Builds.
///
/// # Errors
/// A command line or a model that is wrong, a file that cannot be written.
pub fn build(args: &Args) -> Result<(), Stop> {
    let mut options = input::options(&args.which, &args.set);
    if let Some(method) = &args.method {
        options = options.method(method);
    }
    let compiled = input::compile(&args.file, &options)?;
    let emission = Emission { file: &args.file, output: args.output.as_deref(), step: args.step, prefix: &args.prefix };
    match args.emit {
        Emit::C => emission.c(&compiled),
    }
}
