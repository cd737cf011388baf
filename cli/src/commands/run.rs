//! `bond run`: simulate.

use crate::attribution::Attribution;
use crate::bench::Ways;
use crate::checkpoint::Checkpoints;
use crate::choose::{Ask, Chosen, Target};
use crate::column::{self, Column, Kind};
use crate::drive::{self, Halt, Watch};
use crate::input::{self, Set, Which};
use crate::lints::lints;
use crate::pending::{Pending, Sink};
use crate::plot::Plot;
use crate::progress::Progress;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use crate::summary::{self, Early, Outcome};
use crate::table::{self, Table};
use crate::{checkpoint, choose, ensemble, output, picture, report, signal};
use bond::internal::{Code, CompiledInternals, OptionsInternals, SimulationInternals, StepsInternals, failure};
use bond::{RunError, Simulation, Steps, Summary, Text};
use bond_compiler::discretise::{Accuracy, Method};
use bond_compiler::elaborate::told;
use bond_compiler::model::Settings;
use bond_runtime::Failure;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::Error as Failed;
use clap::builder::PossibleValuesParser;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Simulate a model, and account for its energy
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond run wall.bond\n  bond run wall.bond --stop 2s --every 10ms -o wall.csv --plot wall.svg\n  \
                  bond run wall.bond --set wall.k=2e3 --set \"m=0.5 kg\" --at 40ms,1s -o - --summary json\n  \
                  bond run wall_of_a_house.bond --input weather.csv\n  \
                  bond run pendulum.bond --error 1e-5\n  bond run wall.bond --budget 50us\n  \
                  bond run wall.bond --sweep \"wall.k=500 N/m..2 kN/m:50\" --sweep m=0.5,1,2 -o wall.parquet\n  \
                  bond run wall.bond --monte-carlo 10000 --draw \"m=normal(1 kg, 50 g)\" --draw \"wall.k=uniform(900, 1100)\" \
                  --seed 7 -o wall.csv\n  bond run wall.bond --stop 4s --every 10ms --longest 10ms --checkpoint wall.state\n  \
                  bond run wall.bond --stop 10s --every 10ms --resume wall.state\n\nThe table of an ensemble has one row per instance: its parameters, the probes at the end, whether it \
                  was passive, the worst balance, and why it failed. With --every or --at it has rows over time. Finished instances \
                  are kept in FILE.part until the table is written; after an interruption the same command continues.\nWith --error or --budget, the steppers that keep the balance (or the one of --method) are tried \
                  first and compared with a far more exact run; the summary says what was chosen, and why. bond bench shows all of them.\nThe table of --input begins with a line such as `t,T_out`: the time in \
                  seconds, and for each column the path of an `input`, in SI units.\nTimes are in seconds or have a unit.\nA resumed run gives the same bits as an uninterrupted one with the same steps, whatever rows either writes. \
                  If neither --step nor --longest is given, some step lengths depend on --stop: those of `exact`, a\n\
                  thousandth of the run, and the first adaptive one. A resumed run keeps the lengths with which it began. \
                  To resume a state that was saved with --error or --budget,\n\
                  give the --method that the summary names as chosen.\nCtrl-C (or TERM) ends a run at the next row: it writes its tables and, with --checkpoint, its state; exit \
                  status 130."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The stepper, for every region that can take it
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    method: Option<String>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
    /// Choose stepper and step so that the relative error of every probe and state is at most E; --method fixes the
    /// stepper
    #[arg(long, value_name = "E", value_parser = tolerance, allow_negative_numbers = true, conflicts_with_all = ["step", "tolerance", "budget", "resume"])]
    error: Option<f64>,
    /// Choose the most exact stepper and step that take at most this processor time per period of the fastest sampled
    /// region, or per simulated second if nothing is sampled
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true, conflicts_with_all = ["step", "tolerance", "resume"])]
    budget: Option<f64>,
    #[command(flatten)]
    how: How,
    #[command(flatten)]
    ensemble: ensemble::Args,
}

/// Options of a run of a compiled scene.
#[derive(clap::Args)]
pub struct How {
    /// End of the run. Default: that of the model's `simulate`, or 1 s
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true)]
    stop: Option<f64>,
    /// Fixed step of continuous regions; with --tolerance, the longest adaptive step
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true)]
    step: Option<f64>,
    /// Largest error of a step of continuous regions, relative to the size of the states. Default, if neither this nor
    /// a step is given: 1e-6
    #[arg(long, value_name = "X", value_parser = tolerance, allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
    /// Longest adaptive step
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true, conflicts_with = "step")]
    longest: Option<f64>,
    /// Time between rows of output. Default: a thousandth of the run
    #[arg(long, value_name = "DT", value_parser = input::span, allow_negative_numbers = true)]
    every: Option<f64>,
    /// Write rows at exactly these instants; with --every, at both
    #[arg(long, value_name = "T1,T2,...", value_delimiter = ',', value_parser = input::instant, allow_negative_numbers = true)]
    at: Vec<f64>,
    /// Read inputs over time from a CSV file: column `t` and one column per input, linear between rows
    #[arg(long, value_name = "FILE.csv")]
    input: Option<PathBuf>,
    /// Keep the value of each row until the next one, instead of interpolating
    #[arg(long, requires = "input")]
    input_hold: bool,
    /// Write time and probes to a table, `.csv` or `.parquet`; `-` is CSV to standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Draw the probes over time as a picture, `.svg` or `.png`, with one panel per unit
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write the energy ledger over time to a table, `.csv` or `.parquet`; a row between two fixed steps shows the
    /// ledger after the first
    #[arg(long, value_name = "FILE")]
    ledger: Option<PathBuf>,
    /// Format of the summary, which goes to standard error if standard output has the rows
    #[arg(long, value_enum, default_value_t = Format::Text)]
    summary: Format,
    /// Interpret the step programs instead of compiling them to machine code; the numbers are the same
    #[arg(long)]
    interpret: bool,
    /// Save the whole state at the end of the run, for --resume
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Also save it during the run, at the first row after each DT of simulated time
    #[arg(long, value_name = "DT", value_parser = input::span, allow_negative_numbers = true, requires = "checkpoint")]
    checkpoint_every: Option<f64>,
    /// Continue from a saved state of the same model with the same parameters, with its step or tolerance; rows begin
    /// after it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["step", "tolerance", "longest"])]
    resume: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    Text,
    Json,
}

impl How {
    /// Whether it runs what is compiled without any of these options.
    pub fn is_as_model(&self) -> bool {
        let Self { step, longest, stop, tolerance, .. } = self;
        [step, longest, stop, tolerance].iter().all(|x| x.is_none()) && self.resume.is_none()
    }

    /// To compile for the accuracy, the steps and the end of this run; where a state is resumed, for those that the
    /// scene was compiled for then.
    ///
    /// # Errors
    /// A state that cannot be read.
    pub fn made_for(&self, options: bond::Options) -> Result<bond::Options, Stop> {
        if let Some(made) = self.resume.as_deref().map(checkpoint::made).transpose()?.flatten() {
            let accuracy = made.tolerance.map_or(Accuracy::Fixed, Accuracy::Tolerance);
            return Ok(options.accuracy(accuracy).step(made.pace));
        }
        let accuracy = match (self.step, self.tolerance) {
            (_, Some(x)) => Accuracy::Tolerance(x),
            (Some(_), None) => Accuracy::Fixed,
            (None, None) => Accuracy::AsModel,
        };
        Ok(self.long(options.accuracy(accuracy)))
    }

    /// To compile for the length of the steps, or of the longest, and for the end of the run, if given.
    fn long(&self, options: bond::Options) -> bond::Options {
        let options = self.step.or(self.longest).into_iter().fold(options, bond::Options::step);
        self.stop.into_iter().fold(options, bond::Options::stop)
    }
}

/// A tolerance.
pub fn tolerance(text: &str) -> Result<f64, String> {
    match bond::internal::quantity(text)? {
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
    signal::listen();
    places(&args.how, Some(&args.file))?;
    if args.file == Path::new("-") && is_dash(args.how.input.as_deref()) {
        return Err(Stop::Usage("both the model and --input would be read from standard input".into()));
    }
    let mut options = input::options(&args.which, &args.set)?;
    if let Some(method) = &args.method {
        options = options.method(method);
    }
    ensembles(args)?;
    if args.ensemble.asked() {
        return many(args, args.how.made_for(options)?);
    }
    let target = match (args.error, args.budget) {
        (Some(e), _) => Some(Target::Error(e)),
        (None, Some(t)) => Some(Target::Budget(t)),
        (None, None) => None,
    };
    if let Some(target) = target {
        return chosen(args, args.how.made_for(options)?, target);
    }
    let compiled = input::compile(&args.file, &args.how.made_for(options)?)?;
    unused(&args.how, compiled.used())?;
    lints(&compiled).iter().for_each(|r| report::say(&format!("note: {r}")));
    let by = Attribution::Text(&compiled).or_command_line(!args.set.set.is_empty());
    simulate(compiled.scene(), &compiled.stages().model.settings, &args.how, by)
}

/// Chooses a stepper and its step, and runs with them.
fn chosen(args: &Args, options: bond::Options, target: Target) -> Result<(), Stop> {
    let how = &args.how;
    let text = Text::new(&input::name(&args.file), input::read(&args.file)?);
    unused(how, text.used())?;
    let ways = Ways::base(&text, &options)?;
    let settings = ways.base.stages().model.settings.clone();
    let (_, stop, every) = asked(how, &settings);
    let by = Attribution::Model(text.name()).or_command_line(!args.set.set.is_empty());
    let rows = rows(how, &settings, stop, by)?;
    let scene = ways.base.scene();
    let (options, own) =
        (steps(how).resolve(&Settings::default(), stop, every)?, by.or_command_line(how.stop.is_some()));
    drive::possible(scene, &options, stop, own)?;
    let given = match &how.input {
        Some(path) if is_dash(Some(path)) => {
            return Err(Stop::Usage("--input is read more than once to choose a stepper; give a file".into()));
        }
        Some(path) => input::table(path, scene, how.input_hold)?,
        None => Vec::new(),
    };
    let ask = Ask {
        target,
        text: &text,
        options: how.long(input::options(&args.which, &args.set)?),
        method: args.method.as_deref(),
        stop,
        rows,
        every,
        longest: how.longest,
        shows: how.output.is_some() || how.plot.is_some(),
        given: &given,
        backend: if how.interpret { Code::Interpreted.backend() } else { Code::Native.backend() },
        thresholds: choose::Thresholds::default(),
    };
    let chosen = choose::choose(&ask, ways)?;
    report::say(&format!("note: choosing {} took {} s", chosen.method, summary::short(chosen.took)));
    go(&chosen.scene, &settings, how, (by, Some(&chosen)))
}

/// Runs a scene whose model has these `settings`. Errors in values that the options do not give are attributed to `by`.
///
/// # Errors
/// A command line that is wrong, settings that cannot be, numerics that fail.
pub fn simulate(scene: &Scene, settings: &Settings, args: &How, by: Attribution) -> Result<(), Stop> {
    go(scene, settings, args, (by, None))
}

/// The instants of the rows of a run to `stop`.
fn rows(args: &How, settings: &Settings, stop: f64, by: Attribution) -> Result<Rows, Stop> {
    let by = by.or_command_line(args.stop.is_some() || args.every.is_some());
    Rows::new(stop, Grid::asked(args.every, settings.every, &args.at), &args.at, by)
}

/// Refuses rows before the time of a resumed state.
fn later(at: &[f64], from: f64) -> Result<(), Stop> {
    match at.iter().find(|t| from > 0.0 && **t <= from * (1.0 + 1e-12)) {
        None => Ok(()),
        Some(t) => Err(Stop::Usage(format!(
            "--at {} is not after {} s, the time of the saved state; remove it, or run without --resume",
            told(*t),
            told(from)
        ))),
    }
}

/// Runs a scene, with chosen or given steps.
fn go(
    scene: &Scene,
    settings: &Settings,
    args: &How,
    (model, chosen): (Attribution, Option<&Chosen>),
) -> Result<(), Stop> {
    places(args, None)?;
    let (steps, stop, every) = asked(args, settings);
    let steps = chosen.map_or(steps, Chosen::steps);
    let rows = rows(args, settings, stop, model)?;
    let by = model.or_command_line(args.stop.is_some() || args.step.is_some() || args.longest.is_some());
    let given = match &args.input {
        Some(path) => input::table(path, scene, args.input_hold)?,
        None => Vec::new(),
    };
    for (holder, other) in bond_runtime::simulate::uneven(scene) {
        let name = |c: usize| &scene.clusters[c].name;
        report::say(&format!(
            "note: `{}` holds for `{}`, whose period divides neither its own nor those of the other sides that it \
            holds for: \
             its predictions are poor, and the motion may be wrong; give them periods in whole ratios",
            name(holder),
            name(other)
        ));
    }
    let started = Instant::now();
    let code = if args.interpret { Code::Interpreted } else { Code::Native };
    // The resumed file may be overwritten during the run.
    let state = args.resume.as_deref().map(|path| Ok::<_, Stop>((path, checkpoint::state(path)?))).transpose()?;
    let begin = || match &state {
        Some((path, bytes)) => {
            let sim = checkpoint::resume(code, (path, bytes), scene, given.clone(), stop)?;
            drive::possible(scene, sim.options(), stop, by)?;
            Ok::<_, Stop>(sim)
        }
        None => {
            let options = steps.resolve(settings, stop, every)?;
            drive::possible(scene, &options, stop, by)?;
            Ok(Simulation::on(code.backend(), scene, &options, given.clone())?)
        }
    };
    let mut sim = begin()?;
    let from = sim.time();
    later(&args.at, from)?;
    let resumed = args.resume.is_some().then_some(from);
    let asked = signal::watch("at the next row");
    let files = Files::open(args, scene, &sim, (resumed, stop))?;
    let checkpoints = args.checkpoint.as_deref().map(|path| Checkpoints::new(path, args.checkpoint_every, from));
    let progress = Progress::new();
    let mut on_the_way = OnTheWay { files, checkpoints, unsaved: None, progress, stop, asked, ends: false };
    let halted = drive::watched(&mut sim, rows.clone(), stop, &mut on_the_way);
    let OnTheWay { files, checkpoints, unsaved, ends, progress, .. } = on_the_way;
    drop(progress);
    let early = match halted {
        Ok(()) => None,
        Err(Halt::Numerics(e)) => Some(Early::Failed(e)),
        Err(Halt::Stop(_)) if ends => Some(Early::Asked(sim.time())),
        Err(Halt::Stop(stop)) => return Err(stop),
    };
    // What was computed is kept, also of a run that failed, and whatever became of the other files.
    let failed = early.as_ref().and_then(Early::failure).and_then(RunError::time).map(|t| t.max(from));
    let kept = unsaved.map_or(Ok(()), Err).and(files.commit(failed.unwrap_or(f64::INFINITY)));
    if let Some(until) = failed.filter(|t| *t < sim.time()) {
        sim = begin()?;
        drive::again(&mut sim, rows, until);
    }
    if early.is_none() && matches!(kept, Err(Stop::Pipe)) {
        return kept;
    }
    let told = tell(args, (scene, model, chosen), &mut sim, (from, stop), started, early);
    if let (Err(Stop::Numerics(_) | Stop::Said(_)), Some(checkpoints)) = (&told, &checkpoints) {
        report::say(&checkpoints.left());
    }
    match (told, kept) {
        (Ok(()), kept) => kept,
        // The status is that of the run.
        (told, Err(Stop::Usage(why))) => {
            report::error(&why);
            told
        }
        (told, _) => told,
    }
}

/// Runs an ensemble.
fn many(args: &Args, options: bond::Options) -> Result<(), Stop> {
    let how = &args.how;
    let setup = ensemble::Setup {
        file: &args.file,
        options,
        set: &args.set.set,
        without: &args.set.without(),
        method: args.method.as_deref(),
        steps: steps(how),
        interpret: how.interpret,
        stop: how.stop,
        every: how.every,
        at: &how.at,
        input: how.input.as_deref().map(|path| (path, how.input_hold)),
        output: how.output.as_deref(),
        json: how.summary == Format::Json,
    };
    ensemble::run(&args.ensemble, setup)
}

/// Refuses options that do not go with an ensemble, or only with one.
fn ensembles(args: &Args) -> Result<(), Stop> {
    let single: [(&str, bool, &str); 6] = [
        ("--plot", args.how.plot.is_some(), "it is drawn"),
        ("--ledger", args.how.ledger.is_some(), "its ledger is written"),
        ("--checkpoint", args.how.checkpoint.is_some(), "its state is saved; an ensemble continues by itself"),
        ("--resume", args.how.resume.is_some(), "it continues; an ensemble continues by itself"),
        (
            "--error",
            args.error.is_some(),
            "a stepper is chosen; then take that with --method and --step or --tolerance",
        ),
        ("--budget", args.budget.is_some(), "a stepper is chosen; then take that with --method and --step"),
    ];
    match args.ensemble.idle() {
        Some((option, what)) => Err(Stop::Usage(format!("{option} is for {what}"))),
        None if args.ensemble.asked() => match single.iter().find(|s| s.1) {
            Some((option, _, then)) => Err(Stop::Usage(format!(
                "{option} is for single runs; give the values of one instance with --set, and {then}"
            ))),
            None => Ok(()),
        },
        None => Ok(()),
    }
}

/// What is done while it runs.
struct OnTheWay<'a> {
    files: Files,
    checkpoints: Option<Checkpoints<'a>>,
    /// Why the last of them could not be saved, which does not end the run.
    unsaved: Option<Stop>,
    progress: Progress,
    stop: f64,
    /// Whether somebody asks for the end, and whether the run ends for it.
    asked: &'a AtomicBool,
    ends: bool,
}

impl Watch for OnTheWay<'_> {
    fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt> {
        self.progress.at(t / self.stop);
        self.files.row(sim, t)?;
        if self.ends { Err(Halt::Stop(Stop::Said(signal::ASKED))) } else { Ok(()) }
    }

    fn mark(&mut self, sim: &Simulation<'_>, end: bool) -> Result<(), Halt> {
        self.ends = !end && self.asked.load(Ordering::Relaxed);
        if let Some(checkpoints) = &mut self.checkpoints {
            match checkpoints.mark(sim, end || self.ends) {
                Ok(true) => self.unsaved = None,
                Ok(false) => {}
                Err(why) => self.unsaved = Some(why),
            }
        }
        Ok(())
    }
}

/// The summary, and the error of a run that failed.
fn tell(
    args: &How,
    (scene, model, chosen): (&Scene, Attribution, Option<&Chosen>),
    sim: &mut Simulation<'_>,
    (from, stop): (f64, f64),
    started: Instant,
    early: Option<Early>,
) -> Result<(), Stop> {
    let shown = scene.probes.names.len();
    // A run that got to its end, and whose signals cannot be told there, failed too.
    let (values, early) = match (sim.probes().map(|v| v[..shown.min(v.len())].to_vec()), early) {
        (Ok(values), early) => (values, early),
        (Err(_), Some(Early::Failed(e))) | (Err(e), _) => (vec![f64::NAN; shown], Some(Early::Failed(e))),
    };
    let outcome = Outcome {
        scene,
        chosen,
        from,
        stop,
        wall: started.elapsed().as_secs_f64(),
        summary: &sim.summary(),
        values: &values,
        early: early.as_ref(),
    };
    let text = match args.summary {
        Format::Text => summary::text(&outcome),
        Format::Json => summary::json(&outcome)?,
    };
    let printed = if is_dash(args.output.as_deref()) || is_dash(args.ledger.as_deref()) {
        report::say(text.trim_end());
        Ok(())
    } else {
        output::print(&text)
    };
    if early.as_ref().and_then(Early::failure).is_none() {
        undefined(&scene.probes.names, &values);
    }
    match early {
        None => printed,
        Some(Early::Failed(e)) => match (cause(&e, model, args, sim), shorter(&e, sim)) {
            (Some(cause), _) => Err(Stop::Numerics(cause)),
            (None, Some(advice)) => Err(Stop::Numerics(format!("{e}; {advice}"))),
            (None, None) => Err(e.into()),
        },
        Some(Early::Asked(_)) => Err(Stop::Said(signal::ASKED)),
    }
}

/// Names the law without a finite value by which a step failed. Values held by samples or imposed from outside are
/// unknown to the model, so then there is none.
fn cause(e: &RunError, model: Attribution, args: &How, sim: &Simulation<'_>) -> Option<String> {
    let (Some(Failed::Step { time, region, why, .. }), Attribution::Text(compiled)) = (failure(e), model) else {
        return None;
    };
    let is_off = match why {
        Failure::NoConvergence { change, .. } => *change == 0.0,
        Failure::NotFinite { .. } => true,
        Failure::Singular { .. } | Failure::Balance | Failure::GrossBalance | Failure::Energy => false,
    };
    let scene = compiled.scene();
    let alone = args.input.is_none() && scene.open.is_empty() && scene.clusters.iter().all(|c| c.period.is_none());
    let what = compiled.undefined(*time, &|name| sim.state(name)).filter(|_| is_off && alone)?;
    Some(format!("at t = {} s, a step of `{region}` failed: {what}", told(*time)))
}

/// Advice if a step of a fixed length failed.
fn shorter(e: &RunError, sim: &Simulation<'_>) -> Option<String> {
    let Some(Failed::Step { region, .. }) = failure(e) else { return None };
    let step = sim.options().step?;
    let steps = |r: &bond::RegionSummary| r.name == *region && r.period.is_none();
    sim.summary().regions.iter().any(steps).then(|| {
        format!("steps of {step:e} s may be too long for it: give `--tolerance 1e-6` for adaptive steps instead")
    })
}

/// Says which probes have no finite value at the end.
fn undefined(names: &[String], values: &[f64]) {
    let list: Vec<String> =
        names.iter().zip(values).filter(|(_, x)| !x.is_finite()).map(|(name, x)| format!("`{name}` is {x}")).collect();
    if !list.is_empty() {
        report::say(&format!(
            "note: at the end {}: a root, logarithm, power or quotient in a probe has no finite value there",
            list.join(", ")
        ));
    }
}

fn is_dash(path: Option<&Path>) -> bool {
    path == Some(Path::new("-"))
}

/// Refuses places of results that cannot be; `model` is none where the scene is part of the program.
fn places(args: &How, model: Option<&Path>) -> Result<(), Stop> {
    for (option, path) in [("--checkpoint", &args.checkpoint), ("--resume", &args.resume)] {
        if is_dash(path.as_deref()) {
            return Err(Stop::Usage(format!("{option} needs a file, because a state is not text")));
        }
    }
    // One that carries a scene would be lost with it.
    let program = std::env::current_exe().ok();
    let read =
        [(model, "the model"), (program.as_deref(), "this program"), (args.input.as_deref(), "the table of --input")];
    let mut read: Vec<_> = read.into_iter().filter_map(|(path, what)| Some((path?, what))).collect();
    // A saved state may replace the one that is resumed.
    if let Some(path) = &args.checkpoint {
        output::place(path)?;
        output::not_over(path, &read)?;
    }
    read.extend(args.resume.as_deref().map(|path| (path, "the state of --resume")));
    for path in [&args.output, &args.ledger].into_iter().flatten() {
        output::not_over(path, &read)?;
        table::possible(path)?;
    }
    if let Some(path) = &args.plot {
        output::place(path)?;
        output::not_over(path, &read)?;
        picture::format(path)?;
    }
    let named =
        [("-o", &args.output), ("--plot", &args.plot), ("--ledger", &args.ledger), ("--checkpoint", &args.checkpoint)];
    let named: Vec<_> = named.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?))).collect();
    output::different(&named)
}

/// Refuses to write over files that the model uses.
fn unused(args: &How, used: &[PathBuf]) -> Result<(), Stop> {
    let results = [&args.output, &args.plot, &args.ledger, &args.checkpoint];
    results.into_iter().try_for_each(|path| output::not_over_used(path.as_deref(), used))
}

/// Steps, end and distance of rows: the command line goes before the model.
fn asked(args: &How, settings: &Settings) -> (Steps, f64, Option<f64>) {
    let stop = args.stop.or(settings.stop).unwrap_or_else(|| {
        report::say("note: neither the model nor --stop gives the end of the run; it is 1 s");
        1.0
    });
    (steps(args), stop, args.every.or(settings.every))
}

/// The steps that the command line asks for.
fn steps(args: &How) -> Steps {
    let steps = match (args.step, args.tolerance) {
        (Some(h), None) => Steps::fixed(h),
        (Some(h), Some(x)) => Steps::tolerance(x).longest(h),
        (None, Some(x)) => Steps::tolerance(x),
        (None, None) => Steps::new(),
    };
    args.longest.map_or(steps, |h| steps.longest(h))
}

/// The tables and the picture that a run writes.
struct Files {
    rows: Option<Pending<Table>>,
    plot: Option<Pending<Plot>>,
    ledger: Option<Pending<Table>>,
    shown: usize,
    /// The time of the resumed state, whose row was written before.
    resumed: Option<f64>,
}

impl Files {
    fn open(
        args: &How,
        scene: &Scene,
        sim: &Simulation<'_>,
        (resumed, stop): (Option<f64>, f64),
    ) -> Result<Self, Stop> {
        let columns = |names: Vec<&str>| -> Vec<Column> {
            let names = std::iter::once("t".to_string()).chain(column::over_time(&names));
            names.map(|name| Column::new(name, Kind::Number)).collect()
        };
        let table = |path: Option<&Path>, columns: &[Column]| match path {
            Some(path) => Table::new(path, columns).map(|table| Some(Pending::new(table, columns.len()))),
            None => Ok(None),
        };
        let shown = scene.probes.names.len();
        let rows = table(args.output.as_deref(), &columns(scene.probes.names.iter().map(String::as_str).collect()))?;
        let span = (resumed.unwrap_or(0.0), stop);
        let plot = args.plot.clone().map(|path| Plot::new(path, &scene.name, &scene.probes, span)).transpose()?;
        if let Some(left) = plot.as_ref().map(Plot::left).filter(|left| *left > 0) {
            report::say(&format!("note: the picture has no room for {left} of {shown} probes"));
        }
        let plot = plot.map(|plot| Pending::new(plot, 1 + shown));
        let names = ledger_names(&sim.summary());
        let ledger = table(args.ledger.as_deref(), &columns(names.iter().map(String::as_str).collect()))?;
        Ok(Self { rows, plot, ledger, shown, resumed })
    }

    fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt> {
        if self.resumed.is_some_and(|from| t <= from * (1.0 + 1e-12)) {
            return Ok(());
        }
        let sure = sim.settled();
        if self.rows.is_some() || self.plot.is_some() {
            let values = sim.probes().map_err(Halt::Numerics)?;
            let values = values.iter().copied().take(self.shown);
            put(&mut self.rows, t, values.clone(), sure)?;
            put(&mut self.plot, t, values, sure)?;
        }
        if self.ledger.is_some() {
            put(&mut self.ledger, t, ledger_values(&sim.summary()).into_iter(), sure)?;
        }
        Ok(())
    }

    /// Ends them, with the rows up to an instant, s.
    fn commit(self, until: f64) -> Result<(), Stop> {
        let kept = [end(self.rows, until), end(self.plot, until), end(self.ledger, until)];
        kept.into_iter().collect()
    }
}

/// Adds a row of a run that is sure up to an instant, s.
fn put<S: Sink>(to: &mut Option<Pending<S>>, t: f64, values: impl Iterator<Item = f64>, sure: f64) -> Result<(), Halt> {
    to.as_mut().map_or(Ok(()), |to| to.row(t, values, sure).map_err(Halt::Stop))
}

/// Ends it, with the rows up to an instant, s.
fn end<S: Sink>(what: Option<Pending<S>>, until: f64) -> Result<(), Stop> {
    what.map_or(Ok(()), |what| what.commit(until))
}

/// The header of the ledger's table without the time: `REGION.H`, `REGION/ELEMENT.supplied`, `BOND.holder`. A region
/// may have an element's name.
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
