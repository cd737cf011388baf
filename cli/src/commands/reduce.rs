//! `bond reduce`: only what the scene needs.

use crate::attribution::Attribution;
use crate::bench::{Setting, Thresholds};
use crate::commands::run::tolerance;
use crate::input::{self, Set, Which};
use crate::progress::Progress;
use crate::reduce::{self, Setup};
use crate::stop::Stop;
use crate::{drive, output, report};
use bond::Text;
use bond::internal::{Code, CompiledInternals, OptionsInternals, StepsInternals};
use bond_compiler::discretise::Accuracy;
use bond_compiler::model::Settings;
use std::path::{Path, PathBuf};

/// Tolerance of the compared runs, per allowed error, and at most.
const TOLERANCE_PER_ERROR: f64 = 0.01;
const MAX_TOLERANCE: f64 = 1e-6;

/// Find the parts of a model that its probes need: leave out the least active ones as far as an error allows
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond reduce car.bond --error 0.01\n  bond reduce car.bond --error 1e-3 --as json -o reduced.json\n\nThe \
                  activity of a part (a storage, a resistor or a field) is the integral of |power| over the run. Parts are left \
                  out,\nthe least active first, and the model runs without them: no probe may change by more than E of its \
                  largest value.\nAt a 1-junction the effort of a part left out is 0, at a 0-junction its flow. Nothing else changes, \
                  so a passive\nmodel stays passive. Parts that a probe, an `expect` or a law reads are kept.\nThe last line is the command \
                  that runs the reduced model; `show`, `linearize`, `bench`,\n`build` and `serve` take --without too."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Largest change of any probe at any row, as a part of its largest value, such as 0.01
    #[arg(long, value_name = "E", value_parser = tolerance, allow_negative_numbers = true)]
    error: f64,
    /// End of the run. Default: that of the model's `simulate`, or 1 s
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true)]
    stop: Option<f64>,
    /// Fixed step of continuous regions. Default: that of the model's `simulate`, or a tolerance of E/100, at most 1e-6
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true)]
    step: Option<f64>,
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
    /// Format of the result
    #[arg(long = "as", value_enum, default_value_t = Format::Text, value_name = "FORMAT")]
    format: Format,
    /// Write it to a file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    /// Tables, and the command that runs the reduced model
    Text,
    /// An object
    Json,
}

/// Reduces.
///
/// # Errors
/// A command line or a model that is wrong, a model that fails as it is.
pub fn reduce(args: &Args) -> Result<(), Stop> {
    if let Some(path) = &args.output {
        output::place(path)?;
        output::not_over(path, &[(&args.file, "the model")])?;
        if let Some(input) = &args.input {
            output::not_over(path, &[(input, "the table of --input")])?;
        }
    }
    if args.file == Path::new("-") && args.input.as_deref() == Some(Path::new("-")) {
        return Err(Stop::Usage("both the model and --input would be read from standard input".into()));
    }
    let text = Text::new(&input::name(&args.file), input::read(&args.file)?);
    output::not_over_used(args.output.as_deref(), text.used())?;
    let mut options = input::options(&args.which, &args.set)?;
    options = args.stop.into_iter().fold(options, bond::Options::stop);
    let compiled = options.compile_text(&text).map_err(|e| input::wrong(&e))?;
    let settings = &compiled.stages().model.settings;
    let stop = args.stop.or(settings.stop).unwrap_or_else(|| {
        report::say("note: neither the model nor --stop gives the end of the run; it is 1 s");
        1.0
    });
    let setting = match args.step.or(settings.step) {
        Some(h) => Setting::Step(h),
        None => Setting::Tolerance(settings.tolerance.unwrap_or(MAX_TOLERANCE).min(TOLERANCE_PER_ERROR * args.error)),
    };
    options = match setting {
        Setting::Step(h) => options.accuracy(Accuracy::Fixed).step(h),
        Setting::Tolerance(x) => options.accuracy(Accuracy::Tolerance(x)),
    };
    let by = Attribution::Model(text.name())
        .or_command_line(args.stop.is_some() || args.step.is_some() || !args.set.set.is_empty());
    drive::possible(compiled.scene(), &setting.steps(None).resolve(&Settings::default(), stop, None)?, stop, by)?;
    let given = match &args.input {
        Some(path) => input::table(path, compiled.scene(), args.input_hold)?,
        None => Vec::new(),
    };
    let backend = Code::Native.backend();
    let setup = Setup {
        text: &text,
        options,
        error: args.error,
        stop,
        setting,
        given,
        backend,
        thresholds: Thresholds::default(),
    };
    let progress = Progress::new();
    let done = reduce::reduce(&setup, &|part| progress.at(part));
    drop(progress);
    let done = done?;
    let text = match args.format {
        Format::Text => reduce::text(&done) + "\n" + &next(args, &done.without()),
        Format::Json => reduce::json(&done)?,
    };
    output::put(args.output.as_deref(), &text)
}

/// The command that runs the reduced model.
fn next(args: &Args, without: &[&str]) -> String {
    if without.is_empty() {
        return "nothing can be left out at this error\n".into();
    }
    let file = args.file.display().to_string();
    // No option, whatever it begins with; `-` alone is standard input.
    let file = if file.len() > 1 && file.starts_with('-') { format!("./{file}") } else { file };
    let mut words = vec!["bond".to_string(), "run".into(), file];
    words.extend(args.which.model.iter().flat_map(|name| ["--model".to_string(), name.clone()]));
    words.extend(args.set.written().flat_map(|(path, value)| ["--set".to_string(), format!("{path}={value}")]));
    let mut all = args.set.without();
    all.extend(without.iter().map(ToString::to_string));
    words.extend(["--without".to_string(), all.join(",")]);
    words.extend(args.input.iter().flat_map(|path| ["--input".to_string(), path.display().to_string()]));
    words.extend(args.input_hold.then(|| "--input-hold".to_string()));
    for (name, seconds) in [("--stop", args.stop), ("--step", args.step)] {
        words.extend(seconds.iter().flat_map(|x| [name.to_string(), format!("{x:?}")]));
    }
    let quoted = |word: &String| {
        let plain = |c: char| c.is_alphanumeric() || "/._-,=+:".contains(c);
        if word.chars().all(plain) { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    words.iter().map(quoted).collect::<Vec<String>>().join(" ") + "\n"
}
