//! `bond new`: a starting folder.

use crate::output::{self, unwritable};
use crate::report;
use crate::stop::Stop;
use std::fs;
use std::path::Path;

/// The model of a new folder.
const MODEL: &str = include_str!("new/model.bond");
/// The file beside it, in which `NAME` is replaced.
const README: &str = include_str!("new/README.md");

/// Make a starting folder: a model that runs, with an expectation
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  bond new wall\n  bond run wall/wall.bond\n  bond test wall")]
pub struct Args {
    /// Name of the folder and of the model's file: letters, digits, `-` and `_`
    #[arg(value_name = "NAME", value_parser = name)]
    name: String,
}

fn name(text: &str) -> Result<String, String> {
    if text.chars().count() > 64 {
        return Err("it must not be longer than 64 letters".into());
    }
    if !text.starts_with(|c: char| c.is_alphabetic() || c == '_') {
        return Err("it must begin with a letter".into());
    }
    match text.chars().find(|c| !(c.is_alphanumeric() || matches!(c, '-' | '_'))) {
        Some(c) => Err(format!("it must not contain `{}`, only letters, digits, `-` and `_`", c.escape_default())),
        None => Ok(text.to_string()),
    }
}

/// Makes the folder.
///
/// # Errors
/// It is there already, or cannot be made.
pub fn new(args: &Args) -> Result<(), Stop> {
    let folder = Path::new(&args.name);
    fs::create_dir(folder).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => {
            Stop::Usage(format!("`{}` exists already; nothing was changed", args.name))
        }
        _ => unwritable(folder, &e),
    })?;
    let model = format!("{}.bond", args.name);
    let written = output::put(Some(&folder.join(&model)), MODEL)
        .and_then(|()| output::put(Some(&folder.join("README.md")), &README.replace("NAME", &args.name)));
    if let Err(stop) = written {
        // The folder is new: what is in it is ours.
        let _ = fs::remove_dir_all(folder);
        return Err(stop);
    }
    report::say(&format!("made {0}/{model}; try `bond run {0}/{model}`", args.name));
    Ok(())
}
