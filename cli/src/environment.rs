//! An executable virtual environment: this program with a scene at its end. When it starts it looks at the end of its
//! own file, and if there is a scene it is that scene's environment, and nothing else.
//!
//! Step programs are made for the steps that they take: which steppers there are depends on the tolerance, and some
//! numbers in them on the length of the steps and of the run. So the scene has the text with it that it was compiled
//! from, and a run that asks for other steps or another end compiles that: the same options give the same bytes as
//! those of `bond run`.
//!
//! The file is the program, then the scene in its envelope, then the envelope's length (8 bytes, little-endian) and
//! [`MARK`].

use crate::arguments;
use crate::attribution::Attribution;
use crate::commands::{run, serve};
use crate::input;
use crate::stop::Stop;
use bond::internal::{CarriedTexts, CompiledInternals, TextInternals};
use bond::{Compiled, Options, Text};
use bond_compiler::elaborate;
use bond_compiler::model::Settings;
use bond_compiler::units;
use bond_runtime::envelope::{self, Kind};
use bond_runtime::scene::{Input, Open, Scene};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

/// The last bytes of a file that carries a scene.
const MARK: [u8; 8] = *b"bondends";
/// Length of what comes after the envelope, bytes.
const TAIL: u64 = 16;

/// What a built environment carries.
#[derive(Serialize, Deserialize)]
pub struct Environment {
    /// The version that built it.
    pub version: String,
    /// What it was compiled from.
    pub texts: CarriedTexts,
    /// Which of the text's models it is, where that was asked.
    pub model: Option<String>,
    /// The stepper that was asked for.
    pub method: Option<String>,
    /// Parameters that were set: path, and value with its unit.
    pub set: Vec<(String, String)>,
    /// What was left out.
    pub without: Vec<String>,
    /// End of the run, s, as the model says.
    pub stop: Option<f64>,
    /// Step of continuous regions, s.
    pub step: Option<f64>,
    /// Error allowed in a step, relative.
    pub tolerance: Option<f64>,
    /// Distance of rows of output, s.
    pub every: Option<f64>,
    /// What runs, compiled for the steps and the end that the model says.
    pub scene: Scene,
}

impl Environment {
    /// What is put at the end of the program.
    ///
    /// # Errors
    /// What cannot be written, in words.
    pub fn end(&self) -> Result<Vec<u8>, Stop> {
        let mut bytes = envelope::seal(Kind::Built, self).map_err(Stop::Usage)?;
        let length = bytes.len() as u64;
        bytes.extend(length.to_le_bytes());
        bytes.extend(MARK);
        Ok(bytes)
    }

    fn settings(&self) -> Settings {
        let (stop, step, tolerance, every) = (self.stop, self.step, self.tolerance, self.every);
        Settings { stop, step, tolerance, every, ..Settings::default() }
    }

    /// What a run with these options takes, where that is not the scene that is there.
    ///
    /// # Errors
    /// A model that is wrong for these options; a state to be resumed that cannot be read.
    fn compile(&self, how: &run::How) -> Result<Option<Compiled>, Stop> {
        if how.is_as_model() {
            return Ok(None);
        }
        let mut options = Options::new();
        options = self.model.iter().fold(options, |o, model| o.model(model));
        options = self.method.iter().fold(options, |o, method| o.method(method));
        options = self.set.iter().fold(options, |o, (path, value)| o.set(path, value));
        options = self.without.iter().fold(options, |o, path| o.without(path));
        let text = Text::carried(&self.texts);
        how.made_for(options)?.compile_text(&text).map(Some).map_err(|e| input::wrong(&e))
    }
}

/// The file that runs.
fn own() -> io::Result<File> {
    // The file itself, whatever became of its name.
    if cfg!(target_os = "linux")
        && let Ok(file) = File::open("/proc/self/exe")
    {
        return Ok(file);
    }
    File::open(std::env::current_exe()?)
}

/// The length of the program in a file, and of the envelope behind it; `None` without an envelope.
fn split(file: &mut File) -> io::Result<Option<(u64, u64)>> {
    let all = file.seek(SeekFrom::End(0))?;
    if all < TAIL {
        return Ok(None);
    }
    let mut tail = [0; TAIL as usize];
    file.seek(SeekFrom::Start(all - TAIL))?;
    file.read_exact(&mut tail)?;
    let (length, mark) = tail.split_at(8);
    if mark != MARK {
        return Ok(None);
    }
    let length = u64::from_le_bytes(length.try_into().unwrap_or_default());
    // The envelope detects a wrong length.
    Ok(Some(((all - TAIL).saturating_sub(length), length.min(all - TAIL))))
}

/// Whether a file without [`MARK`] at its end has the beginning of a scene all the same: behind the last byte of the
/// program, which in ELF files is that of the table of sections.
fn cut(file: &mut File) -> io::Result<bool> {
    let mut head = [0; 64];
    file.seek(SeekFrom::Start(0))?;
    file.read_exact(&mut head)?;
    // Of 64 bits, with the lowest byte first.
    if !head.starts_with(b"\x7fELF\x02\x01") {
        return Ok(false);
    }
    let number = |at: usize, n: usize| head[at..at + n].iter().rev().fold(0u64, |x, b| x << 8 | u64::from(*b));
    let (table, size, count) = (number(0x28, 8), number(0x3a, 2), number(0x3c, 2));
    let mut magic = [0; 8];
    file.seek(SeekFrom::Start(table.saturating_add(size * count)))?;
    file.read_exact(&mut magic)?;
    Ok(magic == Kind::Built.magic())
}

/// The program without any scene at its end.
///
/// # Errors
/// It cannot be read.
pub fn program() -> Result<Vec<u8>, Stop> {
    let read = || {
        let mut file = own()?;
        let length = match split(&mut file)? {
            Some((program, _)) => program,
            None => file.seek(SeekFrom::End(0))?,
        };
        file.seek(SeekFrom::Start(0))?;
        let mut bytes = Vec::with_capacity(length as usize);
        file.take(length).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_err(|e: io::Error| Stop::Usage(format!("cannot read the program itself: {e}")))
}

/// The scene at the end of this program, if there is one.
pub fn carried() -> Option<Result<Environment, Stop>> {
    // A program that cannot look at itself is taken for `bond`.
    let mut file = own().ok()?;
    let Some((start, length)) = split(&mut file).ok()? else {
        let cut = cut(&mut file).unwrap_or(false);
        let why = "the scene at the end of this program is damaged: its end is missing; build it again";
        return cut.then(|| Err(Stop::Model(why.into())));
    };
    let mut bytes = Vec::new();
    let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.take(length).read_to_end(&mut bytes));
    let damaged =
        |why: String| Stop::Model(format!("the scene at the end of this program is damaged: {why}; build it again"));
    if let Err(e) = read {
        return Some(Err(damaged(e.to_string())));
    }
    let found = envelope::open::<Environment>(Kind::Built, &bytes).map_err(|e| damaged(e.to_string()));
    Some(found.and_then(|e| e.scene.validate().map_err(|why| damaged(why.to_string())).map(|()| e)))
}

/// A virtual environment
#[derive(Parser)]
#[command(name = "environment", subcommand_required = true, arg_required_else_help = true, max_term_width = 100)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate it, and account for its energy
    Run(Run),
    /// Meet a real outside at the open ports, in real time
    Serve(Serve),
}

#[derive(clap::Args)]
#[command(after_help = serve::help(&format!("{} serve", called())))]
struct Serve {
    #[command(flatten)]
    how: serve::How,
    #[command(flatten)]
    fixed: Fixed,
}

#[derive(clap::Args)]
struct Run {
    #[command(flatten)]
    how: run::How,
    #[command(flatten)]
    fixed: Fixed,
}

/// What was decided when it was built.
#[derive(clap::Args)]
struct Fixed {
    #[arg(long, hide = true, value_name = "PATH=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
    #[arg(long, hide = true, value_name = "PATH,...", value_delimiter = ',')]
    without: Vec<String>,
    #[arg(long, hide = true)]
    method: Option<String>,
    #[arg(long, hide = true)]
    model: Option<String>,
}

impl Fixed {
    /// Refuses what cannot be changed.
    fn check(&self) -> Result<(), Stop> {
        let asked = [
            ("--set", !self.set.is_empty()),
            ("--without", !self.without.is_empty()),
            ("--method", self.method.is_some()),
            ("--model", self.model.is_some()),
        ];
        match asked.into_iter().find(|a| a.1) {
            None => Ok(()),
            Some((option, _)) => Err(Stop::Usage(format!(
                "{option}: model, parameters and methods of this environment were fixed when it was built; build another one with \
                 `bond build FILE -o OUT {option} ...`"
            ))),
        }
    }
}

/// Does what the command line asks of the scene.
///
/// # Errors
/// A command line that is wrong, numerics that fail.
pub fn act(e: &Environment) -> Result<(), Stop> {
    let about = format!("The virtual environment `{}`, built by bond {}", e.scene.name, e.version);
    let version = format!("{} (bond {})", e.scene.name, e.version);
    let command = Line::command().about(about).after_help(told(e)).version(version);
    // Without an open port there is nothing to serve.
    let is_closed = e.scene.open.is_empty() && e.scene.waves.is_empty();
    let command = command.mut_subcommand("serve", |c| c.hide(is_closed));
    let line = match command.try_get_matches_from(arguments::words()).and_then(|m| Line::from_arg_matches(&m)) {
        Ok(line) => line,
        Err(e) => e.exit(),
    };
    match line.command {
        Command::Run(args) => {
            args.fixed.check()?;
            let compiled = e.compile(&args.how)?;
            let scene = compiled.as_ref().map_or(&e.scene, Compiled::scene);
            run::simulate(scene, &e.settings(), &args.how, Attribution::Model(&scene.name))
        }
        Command::Serve(args) => {
            args.fixed.check()?;
            serve::meet(&e.scene, &e.settings(), &args.how)
        }
    }
}

/// How this program was called, for examples.
fn called() -> String {
    std::env::args_os().next().map_or("./environment".into(), |name| name.to_string_lossy().into_owned())
}

/// What the environment is, for `--help`.
fn told(e: &Environment) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = tell(&mut text, e);
    text
}

fn tell(out: &mut String, e: &Environment) -> std::fmt::Result {
    let scene = &e.scene;
    let unit = |u: &Option<String>| u.as_ref().map(|u| format!(" {}", units::in_prose(u))).unwrap_or_default();
    let section = |out: &mut String, title: &str, lines: Vec<String>| -> std::fmt::Result {
        if lines.is_empty() {
            return Ok(());
        }
        writeln!(out, "{title}:")?;
        lines.iter().try_for_each(|line| writeln!(out, "  {line}"))?;
        writeln!(out)
    };
    let probes = scene.probes.names.iter().zip(&scene.probes.units);
    section(out, "Probes", probes.map(|(name, u)| format!("{name}{}", bracketed(&unit(u)))).collect())?;
    let input = |i: &Input| format!("{} = {}{} where nothing is given", i.name, i.value, unit(&i.unit));
    section(out, "Inputs", scene.inputs.iter().map(input).collect())?;
    let waves = scene.waves.iter().map(|w| {
        let period = scene.clusters.get(w.cluster).and_then(|c| c.period).unwrap_or(0.0);
        format!("{}: carries waves, impedance {}{}, each of {period} s", w.name, w.impedance, unit(&w.unit))
    });
    section(out, "Open ports", scene.open.iter().map(|o| port(scene, o)).chain(waves).collect())?;
    section(out, "Set when it was built", e.set.iter().map(|(path, value)| format!("{path} = {value}")).collect())?;
    section(out, "Left out when it was built", e.without.clone())?;
    let mut fixed: Vec<String> = e.method.iter().map(|m| format!("method {m}")).collect();
    fixed.extend(e.stop.map(|t| format!("stop {} s", elaborate::told(t))));
    fixed.extend(e.step.map(|h| format!("step {} s", elaborate::told(h))));
    fixed.extend(e.tolerance.map(|x| format!("tolerance {x}")));
    fixed.extend(e.every.map(|t| format!("a row every {} s", elaborate::told(t))));
    section(out, "Where the command line says nothing", fixed)?;
    write!(
        out,
        "Exit status: 0 done; 1 this file is damaged, or cannot be run as it was built; 2 the command line is wrong; 3 the numerics failed; 130 a run was asked to end."
    )
}

/// ` [m]` for ` m`.
fn bracketed(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" [{}]", unit.trim()) }
}

/// An open port in words.
fn port(scene: &Scene, o: &Open) -> String {
    let unit = |u: &Option<String>| bracketed(u.as_deref().map_or("", units::in_prose));
    let word = if o.takes_flow { "effort" } else { "flow" };
    let period = scene.clusters.get(o.port.0).and_then(|c| c.period);
    match period {
        Some(t) => format!(
            "{}: {word}{} is held for {t} s each; the integral of the {}{} comes back",
            o.name,
            unit(&o.unit),
            if o.takes_flow { "flow" } else { "effort" },
            unit(&o.moved)
        ),
        None => format!("{}: of a continuous region", o.name),
    }
}
