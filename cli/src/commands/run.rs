//! `bond run`: simulate.

use crate::drive::{self, Halt, drive};
use crate::input::{self, Set, Which};
use crate::progress::Progress;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use crate::summary::{self, Outcome};
use crate::table::{self, Cell, Column, Kind, Table};
use crate::{ensemble, output, report};
use bond::{Code, Compiled, RunError, Simulation, Steps, Summary};
use bond_compiler::discretise::Method;
use clap::builder::PossibleValuesParser;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Simulate a model, and tell what became of the energy
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  bond run wall.bond\n  bond run wall.bond --stop 2s --every 10ms -o wall.csv\n  \
                  bond run wall.bond --set wall.k=2e3 --set \"m=0.5 kg\" --at 40ms,1s -o - --summary json\n  \
                  bond run wall_of_a_house.bond --input weather.csv\n  \
                  bond run wall.bond --sweep \"wall.k=500 N/m..2 kN/m:50\" --sweep m=0.5,1,2 -o wall.parquet\n  \
                  bond run wall.bond --monte-carlo 10000 --draw \"m=normal(1 kg, 50 g)\" --draw \"wall.k=uniform(900, 1100)\" \
                  --seed 7 -o wall.csv\n\nAn ensemble's table has a row an instance (its parameters, the probes at the end, \
                  passive or not, the worst balance, why it failed), or with --every or --at its rows over time. What is done \
                  is kept in FILE.part until the table is written: the same command goes on after a run that was cut off.\nThe table of --input begins with a line such as `t,T_out`: the time in \
                  seconds, and for each column the path of an `input`, in SI units.\nTimes are seconds or carry a unit.")]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// End of the run; that of the model's `simulate` otherwise, or 1 s
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true)]
    stop: Option<f64>,
    /// Fixed step of continuous regions
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true, conflicts_with = "tolerance")]
    step: Option<f64>,
    /// Stepper of every region that can take it
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    method: Option<String>,
    /// Error allowed in a step of continuous regions, relative to the states' size; 1e-6 where neither this nor a step is told
    #[arg(long, value_name = "X", value_parser = tolerance, allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// Distance of the rows of output; a thousandth of the run otherwise
    #[arg(long, value_name = "DT", value_parser = input::span, allow_negative_numbers = true)]
    every: Option<f64>,
    /// Rows at exactly these instants; together with --every, at both
    #[arg(long, value_name = "T1,T2,...", value_delimiter = ',', value_parser = input::instant, allow_negative_numbers = true)]
    at: Vec<f64>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
    /// Read inputs over time from a CSV file: column `t`, and one column an input; linear between rows
    #[arg(long, value_name = "FILE.csv")]
    input: Option<PathBuf>,
    /// Inputs keep the value of a row until the next one
    #[arg(long, requires = "input")]
    input_hold: bool,
    /// Write time and probes to a table, `.csv` or `.parquet`; `-` is CSV to standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the energy ledger over time to a table, `.csv` or `.parquet`
    #[arg(long, value_name = "FILE")]
    ledger: Option<PathBuf>,
    /// How the summary is written; it goes to standard error when standard output has the rows
    #[arg(long, value_enum, default_value_t = Format::Text)]
    summary: Format,
    /// Interpret the step programs instead of compiling them to machine code; the numbers are the same
    #[arg(long)]
    interpret: bool,
    #[command(flatten)]
    ensemble: ensemble::Args,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    Text,
    Json,
}

fn tolerance(text: &str) -> Result<f64, String> {
    match bond::quantity(text)? {
        (x, None) if x > 0.0 && x < 1.0 => Ok(x),
        (_, None) => Err("it must lie between 0 and 1, such as 1e-6".into()),
        (_, Some(_)) => Err("it has no unit".into()),
    }
}

/// Runs.
///
/// # Errors
/// A command line or a model that is wrong, numerics that fail.
pub fn run(args: &Args) -> Result<(), Stop> {
    places(args)?;
    let mut options = input::options(&args.which, &args.set);
    if let Some(method) = &args.method {
        options = options.method(method);
    }
    if args.ensemble.asked() {
        return many(args, options);
    }
    let compiled = input::compile(&args.file, &options)?;
    let (steps, stop, every) = asked(args, &compiled);
    let grid = Grid::asked(args.every, compiled.stages().model.settings.every, &args.at);
    let rows = Rows::new(stop, grid, &args.at)?;
    let options = steps.resolve(&compiled.stages().model.settings, stop, every)?;
    drive::possible(compiled.scene(), &options, stop)?;

    let given = match &args.input {
        Some(path) => input::table(path, &compiled, args.input_hold)?,
        None => Vec::new(),
    };
    let started = Instant::now();
    let code = if args.interpret { Code::Interpreted } else { Code::Native };
    let mut sim = Simulation::on(code.backend(), compiled.scene(), &options, given)?;
    let mut files = Files::open(args, &compiled, &sim)?;
    let progress = Progress::new();
    let halted = drive(&mut sim, rows, stop, &mut |sim, t| {
        progress.at(t / stop);
        files.row(sim, t)
    });
    drop(progress);
    let failure = match halted {
        Ok(()) => None,
        Err(Halt::Numerics(e)) => Some(e),
        Err(Halt::Stop(stop)) => return Err(stop),
    };
    // What was computed is kept, also of a run that failed.
    files.commit()?;
    tell(args, &compiled, &mut sim, stop, started, failure)
}

/// Runs an ensemble.
fn many(args: &Args, options: bond::Options) -> Result<(), Stop> {
    let setup = ensemble::Setup {
        file: &args.file,
        options,
        set: &args.set.set,
        method: args.method.as_deref(),
        step: args.step,
        tolerance: args.tolerance,
        steps: steps(args),
        interpret: args.interpret,
        stop: args.stop,
        every: args.every,
        at: &args.at,
        input: args.input.as_deref().map(|path| (path, args.input_hold)),
        output: args.output.as_deref(),
        json: args.summary == Format::Json,
    };
    ensemble::run(&args.ensemble, setup)
}

/// The summary, and the error of a run that failed.
fn tell(
    args: &Args,
    compiled: &Compiled,
    sim: &mut Simulation<'_>,
    stop: f64,
    started: Instant,
    failure: Option<RunError>,
) -> Result<(), Stop> {
    let shown = compiled.probes().len();
    // A run that got to its end, and whose signals cannot be told there, failed too.
    let (values, failure) = match (sim.probes().map(|v| v[..shown.min(v.len())].to_vec()), failure) {
        (Ok(values), None) => (values, None),
        (Err(e), None) => (vec![f64::NAN; shown], Some(e)),
        (_, failure) => (vec![f64::NAN; shown], failure),
    };
    let outcome = Outcome {
        scene: compiled.scene(),
        stop,
        wall: started.elapsed().as_secs_f64(),
        summary: &sim.summary(),
        values: &values,
        failure: failure.as_ref().map(ToString::to_string),
    };
    let text = match args.summary {
        Format::Text => summary::text(&outcome),
        Format::Json => summary::json(&outcome)?,
    };
    if is_dash(args.output.as_deref()) || is_dash(args.ledger.as_deref()) {
        report::say(text.trim_end());
    } else {
        output::print(&text)?;
    }
    match failure {
        None => Ok(()),
        Some(e) => Err(e.into()),
    }
}

fn is_dash(path: Option<&Path>) -> bool {
    path == Some(Path::new("-"))
}

/// Refuses places of tables that cannot be.
fn places(args: &Args) -> Result<(), Stop> {
    for path in [&args.output, &args.ledger].into_iter().flatten() {
        table::possible(path)?;
    }
    match args.ensemble.idle() {
        Some(option) if !args.ensemble.asked() => {
            return Err(Stop::Usage(format!("{option} is for ensembles; add --sweep or --monte-carlo")));
        }
        _ if args.ensemble.asked() && args.ledger.is_some() => {
            let why =
                "--ledger is for single runs; give the values of one instance with --set, and its ledger is written";
            return Err(Stop::Usage(why.into()));
        }
        Some(_) | None => {}
    }
    if args.file == Path::new("-") && is_dash(args.input.as_deref()) {
        return Err(Stop::Usage("both the model and --input would be read from standard input".into()));
    }
    match (&args.output, &args.ledger) {
        (Some(a), Some(b)) if a == b => Err(Stop::Usage("-o and --ledger name the same file".into())),
        _ => Ok(()),
    }
}

/// Steps, end and distance of rows: the command line goes before the model.
fn asked(args: &Args, compiled: &Compiled) -> (Steps, f64, Option<f64>) {
    let settings = &compiled.stages().model.settings;
    let stop = args.stop.or(settings.stop).unwrap_or_else(|| {
        report::say("note: neither the model nor --stop tells the end of the run; it is 1 s");
        1.0
    });
    (steps(args), stop, args.every.or(settings.every))
}

/// The steps that the command line asks for.
fn steps(args: &Args) -> Steps {
    match (args.step, args.tolerance) {
        (Some(h), _) => Steps::fixed(h),
        (None, Some(x)) => Steps::tolerance(x),
        (None, None) => Steps::new(),
    }
}

/// The tables that a run writes.
struct Files {
    rows: Option<Table>,
    ledger: Option<Table>,
    shown: usize,
}

impl Files {
    fn open(args: &Args, compiled: &Compiled, sim: &Simulation<'_>) -> Result<Self, Stop> {
        let columns = |names: &mut dyn Iterator<Item = &str>| -> Vec<Column> {
            std::iter::once("t").chain(names).map(|name| Column::new(name, Kind::Number)).collect()
        };
        let probes = columns(&mut compiled.probes().iter().map(String::as_str));
        let rows = args.output.as_deref().map(|path| Table::new(path, &probes)).transpose()?;
        let names = ledger_names(&sim.summary());
        let names = columns(&mut names.iter().map(String::as_str));
        let ledger = args.ledger.as_deref().map(|path| Table::new(path, &names)).transpose()?;
        Ok(Self { rows, ledger, shown: compiled.probes().len() })
    }

    fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt> {
        if let Some(table) = &mut self.rows {
            let values = sim.probes().map_err(Halt::Numerics)?;
            let values = values.iter().copied().take(self.shown);
            table.row(std::iter::once(t).chain(values).map(Cell::Number)).map_err(Halt::Stop)?;
        }
        if let Some(table) = &mut self.ledger {
            let values = ledger_values(&sim.summary());
            table.row(std::iter::once(t).chain(values).map(Cell::Number)).map_err(Halt::Stop)?;
        }
        Ok(())
    }

    fn commit(self) -> Result<(), Stop> {
        for table in [self.rows, self.ledger].into_iter().flatten() {
            table.commit()?;
        }
        Ok(())
    }
}

/// The header of the ledger's table without the time: `REGION.H`, `REGION/ELEMENT.supplied`, `BOND.holder`. A region may have an element's name.
fn ledger_names(s: &Summary) -> Vec<String> {
    let mut list = Vec::new();
    for r in &s.regions {
        list.extend(["H", "supplied", "dissipated", "leaked", "residual"].map(|k| format!("{}.{k}", r.name)));
        list.extend(r.sources.iter().map(|e| format!("{}/{}.supplied", r.name, e.name)));
        list.extend(r.resistors.iter().map(|e| format!("{}/{}.dissipated", r.name, e.name)));
    }
    for b in &s.bars {
        list.extend(["holder", "other", "difference"].map(|k| format!("{}.{k}", b.name)));
    }
    list
}

/// A row of it, without the time.
fn ledger_values(s: &Summary) -> Vec<f64> {
    let mut list = Vec::new();
    for r in &s.regions {
        list.extend([r.h_final, r.supplied, r.dissipated, r.leaked, r.total]);
        list.extend(r.sources.iter().chain(&r.resistors).map(|e| e.energy));
    }
    for b in &s.bars {
        list.extend([b.holder, b.other, b.difference]);
    }
    list
}
