//! `bond linearize`: the linear model around a state, its poles, its answer to sines.

use crate::attribution::Attribution;
use crate::column::{Cell, Column, Kind};
use crate::drive::{self, Halt, drive};
use crate::ensemble::sweep::{self, Sweep};
use crate::input::{self, Set, Which};
use crate::output;
use crate::progress::Progress;
use crate::report;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use crate::table::Table;
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Simulation, Steps};
use bond_compiler::linearize::Linearized;
use bond_compiler::units::{ANGULAR, Dimension};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Linearize a model: A, B, C and D with the names of states, inputs and outputs, as JSON
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond linearize wall.bond\n  bond linearize pendulum.bond --at 2s -o pendulum.json\n  bond \
                  linearize motor.bond --poles\n  bond linearize motor.bond --bode 1..1000:200:log -o bode.csv\n\n`inputs` lists the \
                  scene's inputs, then the other inputs of its continuous regions: open ports, the values that\nsampled \
                  regions hold at double bars (`v.e`, constant over a period), the signal states of `sampled` blocks, and other\nsignals of sampled \
                  regions. Only continuous regions have states and poles. `outputs` are the probes.\nThe state at --at is that of \
                  a run with a row per thousandth."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Run to this instant first, and linearize around the state there
    #[arg(long, value_name = "T", value_parser = input::instant, allow_negative_numbers = true)]
    at: Option<f64>,
    /// Write the poles instead, one per row: 1/s, Hz, and the damping ratio
    #[arg(long, conflicts_with = "bode")]
    poles: bool,
    /// Write the frequency response instead, one row per frequency in Hz: `1..1000:200:log` (by equal factors),
    /// `10..20:11`, or `50,100`; per probe and input, the amplitude and the phase in degrees
    #[arg(long, value_name = "FROM..TO:N:log", value_parser = frequencies)]
    bode: Option<Sweep>,
    /// Write it to a file; tables as CSV, or in the format of the file's ending
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
        drive::possible(compiled.scene(), &options, time, Attribution::CommandLine)?;
        let mut sim = Simulation::new(compiled.scene(), &options)?;
        let progress = Progress::new();
        let row = &mut |_: &mut Simulation<'_>, t: f64| {
            progress.at(t / time);
            Ok(())
        };
        drive(&mut sim, Rows::new(time, Grid::Parts(1000), &[], Attribution::CommandLine)?, time, row).map_err(
            |halt| match halt {
                Halt::Numerics(e) => Stop::from(e),
                Halt::Stop(stop) => stop,
            },
        )?;
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
        states.extend(sim.held_signals().into_iter().map(|(name, x)| (name.to_string(), x)));
    }
    let linear = compiled.linearize(time, &|name| states.get(name).copied()).map_err(Stop::Numerics)?;
    if linear.states.is_empty() && compiled.scene().clusters.iter().any(|c| c.period.is_some()) {
        report::say(
            "note: the linear model has no states: only continuous regions have some, and sampled ones are constant \
            between samples",
        );
    }
    let path = args.output.as_deref();
    if args.poles {
        return poles(&linear, path.unwrap_or(Path::new("-")));
    }
    if let Some(frequencies) = &args.bode {
        return response(&linear, frequencies, path.unwrap_or(Path::new("-")));
    }
    let text = serde_json::to_string_pretty(&linear.to_json()).map_err(|e| Stop::Usage(e.to_string()))?;
    output::put(path, &(text + "\n"))
}

/// The frequencies of `--bode`.
fn frequencies(text: &str) -> Result<Sweep, String> {
    if let Some(unit) = ANGULAR.into_iter().find(|unit| text.contains(unit)) {
        return Err(format!("frequencies are in Hz, turns per second, and not in `{unit}`: 1 Hz is 6.2832 rad/s"));
    }
    let list = sweep::parse(&format!("--bode={text}"))?;
    if list.dimension.is_some_and(|d| d != Dimension::HERTZ) {
        return Err("frequencies are in Hz".into());
    }
    Ok(list)
}

/// A table of the poles.
fn poles(linear: &Linearized, path: &Path) -> Result<(), Stop> {
    let poles = linear.poles().map_err(Stop::Numerics)?;
    let names = ["real", "imaginary", "frequency", "damping"];
    let mut table = Table::new(path, &names.map(|name| Column::new(name, Kind::Number)))?;
    for p in poles {
        let size = p.re.hypot(p.im);
        let damping = if size > 0.0 { 0.0 - p.re / size } else { f64::NAN };
        table.row([p.re, p.im, size / TAU, damping].map(Cell::Number))?;
    }
    table.commit()
}

/// A table of the response to sines.
fn response(linear: &Linearized, frequencies: &Sweep, path: &Path) -> Result<(), Stop> {
    if linear.inputs.is_empty() || linear.outputs.is_empty() {
        return Err(Stop::Model(
            "a response is that of a probe to an input: declare both, such as `input u = 0 V`, `Se:source = u` and \
             `probe i = motor.f`"
                .into(),
        ));
    }
    let pairs = || linear.outputs.iter().flat_map(|y| linear.inputs.iter().map(move |u| format!("{y}/{u}")));
    let names =
        std::iter::once("frequency".to_string()).chain(pairs().flat_map(|p| [p.clone(), format!("phase({p})")]));
    let mut table = Table::new(path, &names.map(|name| Column::new(name, Kind::Number)).collect::<Vec<_>>())?;
    let (rows, columns) = (linear.outputs.len(), linear.inputs.len());
    for f in (0..frequencies.count()).map(|k| frequencies.value(k)) {
        let all = linear.response(f);
        let one = |i: usize, k: usize| {
            let x = all[(i, k)];
            if x.re.is_finite() { [x.norm(), x.arg().to_degrees()] } else { [f64::INFINITY, f64::NAN] }
        };
        let pairs = (0..rows).flat_map(|i| (0..columns).flat_map(move |k| one(i, k)));
        table.row(std::iter::once(f).chain(pairs).map(Cell::Number))?;
    }
    table.commit()
}
