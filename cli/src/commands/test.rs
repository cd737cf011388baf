//! `bond test`
use crate::stop::Stop;

/// Check
#[derive(clap::Args)]
pub struct Args {
    /// Its name
    name: String,
}

pub fn test(args: &Args) -> Result<(), Stop> {
    Err(Stop::Usage(crate::diff::lines(&args.name, "")))
}
