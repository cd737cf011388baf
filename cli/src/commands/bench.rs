//! `bond bench`: speed against error.

use crate::attribution::Attribution;
use crate::bench::{self, Setup, Thresholds, Ways};
use crate::input::{self, Set, Which};
use crate::progress::Progress;
use crate::stop::Stop;
use crate::{output, picture, report};
use bond::internal::{Code, CompiledInternals, StepsInternals};
use bond::{Steps, Text};
use bond_compiler::discretise::Method;
use bond_compiler::model::Settings;
use clap::builder::PossibleValuesParser;
use std::path::{Path, PathBuf};

/// Compare the steppers of a model: time against error, and what to choose
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond bench pendulum.bond\n  bond bench pendulum.bond --methods gonzalez,rk4 --plot pendulum.png\n  \
                  bond bench pendulum.bond --stop 10s --steps 1ms,2ms,5ms --as json -o pendulum.json\n\nEvery stepper that can take \
                  the model runs with fixed steps, each half the one before, and with tolerances from 1e-2 to 1e-12, until its error is \
                  rounding or its time is over. Points are then added between two settings if one there could be the \
                  cheapest for an error of 0.1, 0.01 and so on. Errors are measured against a far more exact run, the reference, which \
                  is compared with a run of a second method. The error of a point is the largest over all \
                  probes and states at the end of the run, each relative to its largest magnitude. Time is the processor time of \
                  stepping; what is done once before, such as compiling machine code, does not count. Sampled regions keep their period and \
                  their stepper, which are part of the model.\nExit status: 3 if no stepper gives a reference."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Compare only these steppers. Default: all that can take the model
    #[arg(long, value_name = "A,B,...", value_delimiter = ',', value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    methods: Vec<String>,
    /// Use these fixed steps. Default: a range found by a rough run
    #[arg(long, value_name = "H1,H2,...", value_delimiter = ',', value_parser = input::span, allow_negative_numbers = true)]
    steps: Vec<f64>,
    /// Use these tolerances. Default: from 1e-2 to 1e-12
    #[arg(long, value_name = "X1,X2,...", value_delimiter = ',', value_parser = super::run::tolerance, allow_negative_numbers = true)]
    tolerances: Vec<f64>,
    /// Longest adaptive step. Default: a tenth of the run
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true)]
    longest: Option<f64>,
    /// End of the run. Default: that of the model's `simulate`, or 1 s
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true)]
    stop: Option<f64>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
    /// Read inputs over time from a CSV file: column `t` and one column per input, linear between rows
    #[arg(long, value_name = "FILE.csv")]
    input: Option<PathBuf>,
    /// Keep the value of each row until the next one, instead of interpolating
    #[arg(long, requires = "input")]
    input_hold: bool,
    /// Measurements of the time per point, of which the median counts; a short run is repeated within each
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000), allow_negative_numbers = true)]
    repeat: u32,
    /// Most processor time per method; points that would need more are skipped, and listed
    #[arg(long, value_name = "T", default_value = "10s", value_parser = input::span, allow_negative_numbers = true)]
    limit: f64,
    /// Format of the points
    #[arg(long = "as", value_enum, default_value_t = Format::Text, value_name = "FORMAT")]
    format: Format,
    /// Write them to a file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Draw them to a file, `.svg` or `.png`: error and time on logarithmic axes, one line per method
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Interpret the step programs instead of compiling them to machine code
    #[arg(long)]
    interpret: bool,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    /// A table, and which to choose
    Text,
    /// A list with an object for each point
    Json,
}

/// Compares.
///
/// # Errors
/// A wrong command line or model, or a model without a reference.
pub fn bench(args: &Args) -> Result<(), Stop> {
    places(args)?;
    if args.file == Path::new("-") && args.input.as_deref() == Some(Path::new("-")) {
        return Err(Stop::Usage("both the model and --input would be read from standard input".into()));
    }
    if let Some(x) = args.tolerances.iter().find(|x| **x < 1e-14) {
        return Err(Stop::Usage(format!("the tolerance is {x:e}; it must be 1e-14 at least, which is rounding")));
    }
    let progress = Progress::new();
    let text = Text::new(&input::name(&args.file), input::read(&args.file)?);
    for path in [&args.output, &args.plot] {
        output::not_over_used(path.as_deref(), text.used())?;
    }
    let wanted = |m: Method| args.methods.is_empty() || args.methods.iter().any(|name| name == m.name());
    let options = args.stop.into_iter().fold(input::options(&args.which, &args.set)?, bond::Options::stop);
    let ways = Ways::new(&text, &options, &wanted)?;
    let scene = ways.base.scene();
    if ways.list.is_empty() {
        let why: Vec<String> = ways.left_out.iter().map(|l| format!("{}: {}", l.name, l.why)).collect();
        return Err(Stop::Usage(format!("no stepper is left to compare: {}", why.join("; "))));
    }
    let stop = args.stop.or(ways.base.stages().model.settings.stop).unwrap_or_else(|| {
        report::say("note: neither the model nor --stop gives the end of the run; it is 1 s");
        1.0
    });
    let given = match &args.input {
        Some(path) => input::table(path, scene, args.input_hold)?,
        None => Vec::new(),
    };
    let code = if args.interpret { Code::Interpreted } else { Code::Native };
    let setup = Setup {
        stop,
        longest: args.longest,
        steps: within(&args.steps, stop),
        tolerances: args.tolerances.clone(),
        given,
        repeat: args.repeat as usize,
        limit: args.limit,
        backend: code.backend(),
        thresholds: Thresholds::default(),
    };
    let least = setup.steps.iter().copied().fold(stop, f64::min);
    let by = Attribution::Model(text.name())
        .or_command_line(args.stop.is_some() || !args.steps.is_empty() || !args.set.set.is_empty());
    crate::drive::possible(scene, &Steps::fixed(least).resolve(&Settings::default(), stop, None)?, stop, by)?;
    let problem = match args.file.file_stem() {
        Some(stem) if args.file != Path::new("-") => stem.to_string_lossy().into_owned(),
        Some(_) | None => scene.name.clone(),
    };
    let done = bench::bench(&ways, &problem, &setup, &|part| progress.at(part));
    drop(progress);
    let done =
        done.map_err(|why| Stop::Numerics(format!("no stepper gives a run to measure the others against: {why}")))?;
    // A table that was long in the making is there also where the picture cannot be drawn.
    let drawn = args.plot.as_ref().map_or(Ok(()), |path| picture::put(&bench::picture(&done), path));
    let text = match args.format {
        Format::Text => bench::text(&done),
        Format::Json => {
            done.notes.iter().for_each(|note| report::say(&format!("note: {note}")));
            bench::json(&done)?
        }
    };
    output::put(args.output.as_deref(), &text)?;
    drawn
}

/// The steps that a run takes for these: one that is longer than the run is shortened to it.
fn within(steps: &[f64], stop: f64) -> Vec<f64> {
    let mut list: Vec<f64> = Vec::new();
    for h in steps {
        if *h > stop {
            let (told, run) = (bench::time(*h), bench::time(stop));
            report::say(&format!("note: a step of {told} is longer than the run, and taken as one of {run}"));
        }
        let h = h.min(stop);
        if !list.contains(&h) {
            list.push(h);
        }
    }
    list
}

/// Refuses places of results that cannot be.
fn places(args: &Args) -> Result<(), Stop> {
    if let Some(path) = &args.plot {
        picture::format(path)?;
    }
    let results = [("-o", args.output.as_deref()), ("--plot", args.plot.as_deref())];
    let results: Vec<_> = results.into_iter().filter_map(|(option, path)| Some((option, path?))).collect();
    let mut read = vec![(args.file.as_path(), "the model")];
    read.extend(args.input.as_deref().map(|path| (path, "the table of --input")));
    for (_, path) in &results {
        output::place(path)?;
        output::not_over(path, &read)?;
    }
    output::different(&results)
}
