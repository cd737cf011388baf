//! What the command line gives for all instances.

use bond::internal::Quantity;
use bond::{Options, Steps};
use std::path::Path;

/// What the command line gives for all instances.
pub struct Setup<'a> {
    /// The model.
    pub file: &'a Path,
    /// Scene, stepper and parameters.
    pub options: Options,
    /// The parameters again.
    pub set: &'a [(String, Quantity)],
    /// What is left out, again.
    pub without: &'a [String],
    /// The stepper again.
    pub method: Option<&'a str>,
    /// How steps are taken.
    pub steps: Steps,
    /// Whether the interpreter is asked for.
    pub interpret: bool,
    /// End of the run, s.
    pub stop: Option<f64>,
    /// Distance of rows, s.
    pub every: Option<f64>,
    /// Instants of rows, s.
    pub at: &'a [f64],
    /// Table of inputs, and whether they are held.
    pub input: Option<(&'a Path, bool)>,
    /// Where the table goes.
    pub output: Option<&'a Path>,
    /// Whether the summary is for programs.
    pub json: bool,
}
