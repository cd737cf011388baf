//! `bond fmt`: the canonical layout.

use crate::stop::Stop;
use crate::{input, output, report};
use bond_grammar::source::Sources;
use std::path::{Path, PathBuf};

/// Bring models into the canonical layout, in place
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  bond fmt wall.bond\n  bond fmt --check models/*.bond\n  bond fmt - < wall.bond")]
pub struct Args {
    /// Models; `-` formats standard input to standard output
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Change nothing; list the files that would change, with exit status 1 if there are any
    #[arg(long)]
    check: bool,
}

/// Lays out every file, whatever is wrong with those before it.
///
/// # Errors
/// What is wrong.
pub fn fmt(args: &Args) -> Result<(), Stop> {
    let mut status = 0;
    for path in &args.files {
        match one(path, args.check) {
            Ok(true) => {}
            Ok(false) => status = status.max(1),
            Err(Stop::Said(s)) => status = status.max(s),
            Err(Stop::Usage(message)) => {
                report::error(&message);
                status = status.max(2);
            }
            Err(Stop::Model(message)) => {
                report::error(&message);
                status = status.max(1);
            }
            Err(other) => return Err(other),
        }
    }
    if status == 0 { Ok(()) } else { Err(Stop::Said(status)) }
}

/// Formats one file; false if it would change and must not.
fn one(path: &Path, check: bool) -> Result<bool, Stop> {
    let before = input::read(path)?;
    let mut sources = Sources::new();
    let id = sources.add(input::name(path), before.clone());
    let (file, errors) = bond_grammar::parse_with_units(&sources, id, &bond_compiler::units::is_unit);
    if !errors.is_empty() {
        report::diagnostics(&sources, &errors);
        return Err(Stop::Said(1));
    }
    let after = bond_grammar::format(&sources, id, &file);
    if check {
        if after != before {
            output::offer(&format!("{}\n", input::name(path)))?;
        }
        return Ok(after == before);
    }
    if path == Path::new("-") {
        output::print(&after)?;
    } else if after != before {
        output::put(Some(path), &after)?;
    }
    Ok(true)
}
