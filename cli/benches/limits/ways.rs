//! The ways in which a figure's work is done, made ready and compared with each other.

use super::clock;
use super::figure::Figure;
use super::program::{self, Folder};
use super::scene::{self, Bare, Driven};
use bond::Compiled;
use bond::internal::{Code, CompiledInternals};
use bond_compiler::backend::{c, standalone};
use std::path::PathBuf;

/// A way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// C by hand.
    Hand,
    /// C by hand with vector lanes.
    Lanes,
    /// Emitted C, `cc -O2`.
    Plain,
    /// Emitted C, compiled for this machine.
    Tuned,
    /// An emitted object file.
    Object,
    /// The compiled step alone.
    Bare,
    /// Machine code under the driver of `bond run`.
    Run,
    /// The same interpreted.
    Interpreted,
}

impl What {
    /// In the order in which they are shown.
    pub const ALL: [What; 8] =
        [What::Hand, What::Lanes, What::Plain, What::Tuned, What::Object, What::Bare, What::Run, What::Interpreted];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            What::Hand => "hand-written C",
            What::Lanes => "hand-written C, lanes",
            What::Plain => "emitted C, -O2",
            What::Tuned => "emitted C, -O3 -march=native",
            What::Object => "object file",
            What::Bare => "machine code, step alone",
            What::Run => "machine code, `bond run`",
            What::Interpreted => "interpreter",
        }
    }
}

/// What does the work.
enum Work<'a> {
    Program(PathBuf, usize),
    Driven(Driven<'a>),
    Bare(Box<Bare>),
}

/// A way that is ready.
pub struct Way<'a> {
    /// Which one.
    pub what: What,
    work: Work<'a>,
    /// How many steps a reading has.
    steps: u64,
    /// How many it has at least: many scenes go on one group after the other, and not for a step alone.
    least: u64,
    /// The least median so far, ns a step.
    pub best: f64,
}

impl Way<'_> {
    /// The median time of so many steps, ns of processor time.
    ///
    /// # Errors
    /// In words.
    pub fn time(&mut self, steps: u64, reps: usize) -> Result<f64, String> {
        if let Work::Program(path, size) = &self.work {
            return program::time(path, *size, steps, reps);
        }
        let mut times = Vec::new();
        for _ in 0..reps {
            let start = clock::now();
            match &mut self.work {
                Work::Driven(d) => d.go(steps)?,
                Work::Bare(b) => b.go(steps)?,
                Work::Program(..) => {}
            }
            times.push(clock::now() - start);
        }
        Ok(clock::median(times))
    }

    /// Takes a reading, of some milliseconds each.
    ///
    /// # Errors
    /// In words.
    pub fn read(&mut self) -> Result<(), String> {
        while self.steps == 0 || self.best.is_nan() {
            let steps = (4 * self.steps).max(self.least);
            let ns = self.time(steps, 1)?;
            self.steps = steps;
            if ns > 1e6 || steps > 1 << 40 {
                self.steps = ((steps as f64 * 6e6 / ns) as u64).max(self.least);
                self.best = f64::INFINITY;
            }
        }
        let ns = self.time(self.steps, 5)? / self.steps as f64;
        self.best = self.best.min(ns);
        Ok(())
    }
}

/// All ways of a figure.
pub struct Ways<'a> {
    /// Those that are ready.
    pub list: Vec<Way<'a>>,
    /// Why others are not.
    pub missing: Vec<String>,
}

impl<'a> Ways<'a> {
    /// Makes them ready. Each must come to what the interpreter comes to; one that does not is left out, with a word.
    pub fn new(folder: &Folder, figure: &Figure, compiled: &'a Compiled, say: &dyn Fn(&str)) -> Self {
        let mut ways = Self { list: Vec::new(), missing: Vec::new() };
        let truth = Driven::new(figure, compiled, Code::Interpreted).and_then(|mut d| {
            d.go(Figure::CHECKED)?;
            d.probes()
        });
        let truth = match truth {
            Ok(truth) => truth,
            Err(e) => {
                ways.missing.push(e);
                return ways;
            }
        };
        for what in What::ALL {
            say(what.name());
            match ways.ready(folder, figure, compiled, what, &truth) {
                Ok(Some(work)) => {
                    let least = if figure.scenes > 1 { 128 } else { 1 };
                    ways.list.push(Way { what, work, steps: 0, least, best: f64::NAN });
                }
                Ok(None) => {}
                Err(e) => ways.missing.push(format!("{}: {e}", what.name())),
            }
        }
        ways
    }

    fn ready(
        &self,
        folder: &Folder,
        figure: &Figure,
        compiled: &'a Compiled,
        what: What,
        truth: &[f64],
    ) -> Result<Option<Work<'a>>, String> {
        let ours = matches!(what, What::Bare | What::Run | What::Interpreted);
        if !ours && !program::is_there() {
            return Err("there is no `cc`".into());
        }
        let slow = |why: &String| why.contains("was stopped");
        if what == What::Tuned && self.missing.iter().any(slow) {
            return Err("not tried, since -O2 took too long".into());
        }
        let tuned = ["-O3", "-march=native", "-ffp-contract=off"];
        let path = match what {
            What::Bare => {
                return Ok(Bare::new(figure, compiled).filter(|_| figure.scenes == 1).map(Box::new).map(Work::Bare));
            }
            What::Run => return Driven::new(figure, compiled, Code::Native).map(Work::Driven).map(Some),
            What::Interpreted => return Driven::new(figure, compiled, Code::Interpreted).map(Work::Driven).map(Some),
            What::Hand => folder.hand(figure.kernel)?,
            What::Lanes => match figure.lanes {
                Some(name) => folder.hand(name)?,
                None => return Ok(None),
            },
            What::Plain => emitted(folder, figure, compiled, &["-O2"], "plain")?,
            What::Tuned => emitted(folder, figure, compiled, &tuned, "tuned")?,
            What::Object => object(folder, figure, compiled)?,
        };
        let seen = program::outcome(&path, figure, Figure::CHECKED)?;
        let size = truth.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (ours, theirs) in seen.iter().zip(truth) {
            let close = (ours - theirs).abs() <= figure.agree * size;
            if !close {
                return Err(format!("it comes to {ours:e} where the interpreter comes to {theirs:e}"));
            }
        }
        Ok(Some(Work::Program(path, figure.size)))
    }
}

/// The scene's unit, with its header in the folder.
fn emit(
    folder: &Folder,
    figure: &Figure,
    compiled: &Compiled,
) -> Result<(standalone::StandaloneModule, c::Options), String> {
    let unit = standalone::module(compiled.scene(), &scene::options(figure, compiled)?)?;
    let options = c::Options { prefix: "bond".into(), header: "scene.h".into(), single: true, begin: false };
    folder.put("scene.h", c::header(&unit, &options))?;
    Ok((unit, options))
}

/// The program around a scene.
fn link(
    folder: &Folder,
    figure: &Figure,
    unit: &standalone::StandaloneModule,
    part: &str,
    name: &str,
    flags: &[&str],
) -> Result<PathBuf, String> {
    let scenes = format!("-DSCENES={}", figure.scenes);
    let mut arguments = flags.to_vec();
    arguments.extend(["-std=gnu99", scenes.as_str(), "scene_main.c", part]);
    if figure.pulls {
        arguments.push("-DPULLS");
    }
    // Objects have no lanes, nor have the vectors that every machine has room for more than two.
    if figure.scenes > 1 && !figure.pulls && name == "tuned" {
        arguments.extend(["-DBESIDE", "-DBOND_LANES=64"]);
    }
    if unit.run.is_some() {
        arguments.push("-DRUNS");
    }
    folder.cc(&arguments, &format!("scene_{name}_{}", figure.title.replace(|c: char| !c.is_ascii_alphanumeric(), "_")))
}

fn emitted(
    folder: &Folder,
    figure: &Figure,
    compiled: &Compiled,
    flags: &[&str],
    name: &str,
) -> Result<PathBuf, String> {
    let (unit, options) = emit(folder, figure, compiled)?;
    folder.put("scene.c", c::source(&unit, &options))?;
    link(folder, figure, &unit, "scene.c", name, flags)
}

#[cfg(feature = "native")]
fn object(folder: &Folder, figure: &Figure, compiled: &Compiled) -> Result<PathBuf, String> {
    let (unit, _) = emit(folder, figure, compiled)?;
    folder.put("scene.o", bond_compiler::backend::native::object(&unit, "bond")?)?;
    link(folder, figure, &unit, "scene.o", "object", &["-O2"])
}

#[cfg(not(feature = "native"))]
fn object(_: &Folder, _: &Figure, _: &Compiled) -> Result<PathBuf, String> {
    Err("it is built without `native`".into())
}
