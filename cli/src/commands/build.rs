//! `bond build`: from a model to what runs without `bond`.

use crate::emit::Emission;
use crate::environment;
use crate::input::{self, Set, Which};
use crate::output;
use crate::report;
use crate::stop::Stop;
use bond::internal::{CompiledInternals, OptionsInternals, StepsInternals, TextInternals};
use bond::{Compiled, Steps, Text};
use bond_compiler::backend::EMITTERS;
use bond_compiler::discretise::{Accuracy, Method};
use clap::builder::{PossibleValue, PossibleValuesParser};
use std::path::{Path, PathBuf};

/// Build a model into what runs without `bond`: an executable file, C source, an object file, an FMU or a WebAssembly
/// module
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond build wall.bond\n  ./wall run --stop 2s -o wall.csv\n  bond build device.bond -o wall --set \
                  wall.k=2e3\n  ./wall serve --udp 127.0.0.1:7000 --duration 60s\n  ./wall --help\n  bond build device.bond --emit c -o wall.c\n  bond build device.bond --emit object \
                  --prefix wall -o wall_object.o\n  bond build device.bond --emit fmu -o wall.fmu\n  bond build device.bond --emit wasm -o wall.wasm\n\nAn executable is a copy of this program with the compiled \
                  scene and the text of the model appended: it runs on machines like this one,\nwith the same numbers as bond run. Its parameters and methods are fixed. C source and objects come with a header that documents their use. They, and FMI 2.0\nunits and WebAssembly modules, take fixed steps."
)]
pub struct Args {
    /// A model; `-` is standard input
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The file to write; C and objects also get a header beside it. Default: the model's name with the usual ending,
    /// in this folder
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// What to build
    #[arg(long, value_name = "EMIT", value_parser = forms(), default_value = EXE)]
    emit: String,
    /// Fixed step of continuous regions, not for executables. Default: that of the model's `simulate`
    #[arg(long, value_name = "H", value_parser = input::span, allow_negative_numbers = true)]
    step: Option<f64>,
    /// Prefix of public names in C and objects
    #[arg(long, value_name = "NAME", default_value = "bond")]
    prefix: String,
    /// The stepper, for every region that can take it
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    method: Option<String>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
}

/// The form that is this program itself.
const EXE: &str = "exe";

/// What `--emit` takes.
fn forms() -> PossibleValuesParser {
    let exe = PossibleValue::new(EXE).help("One file with `run` and, for a scene with open ports, `serve`");
    let others = EMITTERS.iter().map(|e| PossibleValue::new(e.name).help(e.about));
    PossibleValuesParser::new(std::iter::once(exe).chain(others))
}

/// Builds.
///
/// # Errors
/// A command line or a model that is wrong, a file that cannot be written.
pub fn build(args: &Args) -> Result<(), Stop> {
    let mut options = input::options(&args.which, &args.set)?;
    if let Some(method) = &args.method {
        options = options.method(method);
    }
    options = args.step.into_iter().fold(options, bond::Options::step);
    let emitter = EMITTERS.iter().find(|e| e.name == args.emit);
    if emitter.is_some() {
        options = options.accuracy(Accuracy::Uncut);
    }
    let text = Text::new(&input::name(&args.file), input::read(&args.file)?);
    let compiled = options.compile_text(&text).map_err(|e| input::wrong(&e))?;
    let emission = Emission { file: &args.file, output: args.output.as_deref(), step: args.step, prefix: &args.prefix };
    match emitter {
        None if args.step.is_some() || args.prefix != "bond" => Err(Stop::Usage(
            "--step and --prefix are not for executables; an executable takes --step when it runs".into(),
        )),
        None => executable(args, &text, &compiled),
        Some(emitter) if !emitter.has_header && args.prefix != "bond" => {
            let named: Vec<&str> = EMITTERS.iter().filter(|e| e.has_header).map(|e| e.name).collect();
            Err(Stop::Usage(format!("--prefix is for --emit {}; other names are fixed", named.join(" and "))))
        }
        Some(emitter) => emission.write(emitter, &compiled),
    }
}

/// The place of the result: as given, or the model's name with another ending.
fn place(args: &Args, name: &str, ending: &str) -> PathBuf {
    match &args.output {
        Some(path) => path.clone(),
        None => {
            let stem = args.file.file_stem().filter(|_| args.file != Path::new("-"));
            let stem = stem.map_or(name.to_string(), |s| s.to_string_lossy().into_owned());
            PathBuf::from(stem + ending)
        }
    }
}

/// The program itself with the scene and its text at its end.
fn executable(args: &Args, text: &Text, compiled: &Compiled) -> Result<(), Stop> {
    let scene = compiled.scene();
    let out = place(args, &scene.name, std::env::consts::EXE_SUFFIX);
    if out == Path::new("-") {
        return Err(Stop::Usage("an executable needs a file: name it with -o".into()));
    }
    let program = std::env::current_exe().unwrap_or_default();
    output::not_over(&out, &[(&args.file, "the model"), (&program, "this program")])?;
    output::not_over_used(Some(&out), compiled.used())?;
    output::no_model(&out)?;
    let settings = &compiled.stages().model.settings;
    // Report invalid settings now, and not when it runs.
    Steps::new().resolve(settings, settings.stop.unwrap_or(1.0), settings.every)?;
    let set = args.set.written().map(|(path, value)| (path.to_string(), value));
    let carried = environment::Environment {
        version: env!("CARGO_PKG_VERSION").into(),
        texts: text.carry(),
        model: args.which.model.clone(),
        method: args.method.clone(),
        set: set.collect(),
        without: args.set.without(),
        stop: settings.stop,
        step: settings.step,
        tolerance: settings.tolerance,
        every: settings.every,
        scene: scene.clone(),
    };
    let program = environment::program()?;
    let end = carried.end()?;
    output::put_executable(&out, &[&program, &end])?;
    let megabytes = (program.len() + end.len()) as f64 / 1e6;
    let run = if out.is_absolute() { out.clone() } else { Path::new(".").join(&out) };
    report::say(&format!(
        "built {} ({megabytes:.1} MB, of which the scene is {} kB); see `{} --help`",
        out.display(),
        end.len().div_ceil(1000),
        run.display()
    ));
    Ok(())
}
