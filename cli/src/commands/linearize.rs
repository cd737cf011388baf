//! `bond linearize`: the linear model around a state.

use crate::blame::By;
use crate::drive::{self, Halt, drive};
use crate::input::{self, Set, Which};
use crate::output;
use crate::progress::Progress;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use bond::{Simulation, Steps};
use std::collections::HashMap;
use std::path::PathBuf;

/// Linearize a model: A, B, C and D with the names of states, inputs and outputs, as JSON
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond linearize wall.bond\n  bond linearize pendulum.bond --at 2s -o pendulum.json\n\n`inputs` lists the \
                  scene's inputs, then what is given from outside to the continuous regions: at open ports, and what\nsampled \
                  regions hold at borders (`v.e`, constant over a period). `outputs` are the probes.\nThe state of --at is that of \
                  a run to it with rows each thousandth."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Run to this instant first, and linearize around the state reached
    #[arg(long, value_name = "T", value_parser = input::instant, allow_negative_numbers = true)]
    at: Option<f64>,
    /// Write it to a file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    which: Which,
    #[command(flatten)]
    set: Set,
}

/// Linearizes.
///
/// # Errors
/// A model that is wrong, a run that fails, a state around which it cannot be done.
pub fn linearize(args: &Args) -> Result<(), Stop> {
    if let Some(path) = &args.output {
        output::place(path)?;
        output::not_over(path, &[(&args.file, "the model")])?;
    }
    // A model's modes are those of all of it.
    let compiled = input::compile(&args.file, &input::options(&args.which, &args.set)?.whole())?;
    output::not_over_used(args.output.as_deref(), compiled.used())?;
    let time = args.at.unwrap_or(0.0);
    let mut states: HashMap<String, f64> = HashMap::new();
    if time > 0.0 {
        let settings = &compiled.stages().model.settings;
        let options = Steps::new().resolve(settings, time, None)?;
        drive::possible(compiled.scene(), &options, time, By::Line)?;
        let mut sim = Simulation::new(compiled.scene(), &options)?;
        let progress = Progress::new();
        let row = &mut |_: &mut Simulation<'_>, t: f64| {
            progress.at(t / time);
            Ok(())
        };
        drive(&mut sim, Rows::new(time, Grid::Parts(1000), &[], By::Line)?, time, row).map_err(|halt| match halt {
            Halt::Numerics(e) => Stop::from(e),
            Halt::Stop(stop) => stop,
        })?;
        for name in compiled.scene().clusters.iter().flat_map(|c| &c.names) {
            if let Some(x) = sim.state(name) {
                states.insert(name.clone(), x);
            }
        }
        // What sampled regions hold is given to the others.
        let (model, form) = (&compiled.stages().model, &compiled.stages().form);
        for (k, bar) in compiled.scene().bars.iter().enumerate() {
            if let Some(b) = form.bars.iter().find(|b| model.bond(b.bond).name == bar.name) {
                let column = form.column(b.held);
                states.insert(format!("{}.{}", column.name, column.gives.letter()), sim.held_at_bar(k));
            }
        }
    }
    let linear = compiled.linearize(time, &|name| states.get(name).copied()).map_err(Stop::Numerics)?;
    let text = serde_json::to_string_pretty(&linear.to_json()).map_err(|e| Stop::Usage(e.to_string()))?;
    output::put(args.output.as_deref(), &(text + "\n"))
}
