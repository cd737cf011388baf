//! `bond new`: a starting folder.
use crate::stop::Stop;

/// Make a folder with a model that runs
#[derive(clap::Args)]
pub struct Args {
    /// Its name
    name: String,
}

pub fn new(args: &Args) -> Result<(), Stop> {
    Err(Stop::Usage(args.name.clone()))
}
