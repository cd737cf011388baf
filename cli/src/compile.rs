//! From a file or a text to a compiled model.

use crate::errors::Errors;
use crate::load::{FileLoader, read};
use crate::quantity::{Quantity, quantity};
use crate::simulation::{RunError, Simulation, Steps};
use bond_compiler::discretise::Accuracy;
use bond_compiler::show::{As, Shown, What};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{SourceId, Sources, Span};
use bond_runtime::ir::Program;
use bond_runtime::scene::{Respond, Scene};
use bond_runtime::simulate::Course;
use std::path::{Path, PathBuf};

/// What to compile a model with.
#[derive(Clone, Debug, Default)]
pub struct Options {
    model: Option<String>,
    method: Option<String>,
    accuracy: Accuracy,
    step: Option<f64>,
    stop: Option<f64>,
    set: Vec<(String, Result<Quantity, String>)>,
    without: Vec<String>,
    powers: bool,
    whole: bool,
}

impl Options {
    /// The last model of the file, with its own parameters and methods.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes another model of the file for the scene.
    pub fn model(mut self, name: impl Into<String>) -> Self {
        self.model = Some(name.into());
        self
    }

    /// Lets a tolerance choose the stepper where none is named; as the model's `simulate` says where this is not
    /// called.
    pub fn accuracy(mut self, accuracy: Accuracy) -> Self {
        self.accuracy = accuracy;
        self
    }

    /// Makes ready for steps of this length, or up to it, in s; for those of the model's `simulate` where this is not
    /// called. Any steps may be taken: over far longer ones balances may hold to fewer digits.
    pub fn step(mut self, step: f64) -> Self {
        self.step = Some(step);
        self
    }

    /// Makes ready for the steps of a run to this instant, in s, where no length of steps is told.
    pub fn stop(mut self, stop: f64) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Takes another stepper: one of [`bond_compiler::discretise::Method::ALL`], by name.
    pub fn method(mut self, name: impl Into<String>) -> Self {
        self.method = Some(name.into());
        self
    }

    /// Sets a parameter by its path, to a number with its unit, or in SI.
    pub fn set(mut self, path: impl Into<String>, value: &str) -> Self {
        self.set.push((path.into(), quantity(value)));
        self
    }

    /// Sets a parameter by its path to a number that was read before.
    pub fn set_quantity(mut self, path: impl Into<String>, value: Quantity) -> Self {
        self.set.push((path.into(), Ok(value)));
        self
    }

    /// Leaves out a storage, a resistor or a field by its path: at a 1-junction its effort is 0 then, at a 0-junction its
    /// flow.
    pub fn without(mut self, path: impl Into<String>) -> Self {
        self.without.push(path.into());
        self
    }

    /// Lets the probes end with the power into each of [`bond_compiler::omit::parts`].
    pub fn powers(mut self) -> Self {
        self.powers = true;
        self
    }

    /// Has all of the model run, also what no probe, open port or expectation depends on.
    pub fn whole(mut self) -> Self {
        self.whole = true;
        self
    }

    /// Compiles a file.
    ///
    /// # Errors
    /// All that is wrong with it; also that it cannot be read.
    pub fn compile_file(&self, path: impl AsRef<Path>) -> Result<Compiled, Errors> {
        let path = path.as_ref();
        let name = path.to_string_lossy().into_owned();
        match read(path) {
            Ok(text) => self.compile_str(&name, text),
            Err(e) => Err(lone(&name, "file::read", format!("cannot read {name}: {e}"))),
        }
    }

    /// Compiles a text. The name is shown in messages; files that the text uses are looked for beside it.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn compile_str(&self, name: &str, text: impl Into<String>) -> Result<Compiled, Errors> {
        self.compile_text(&Text::new(name, text))
    }

    /// Compiles a text that was read before: as [`Options::compile_str`], for many options in turn.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn compile_text(&self, text: &Text) -> Result<Compiled, Errors> {
        let mut set = Vec::new();
        for (path, value) in &self.set {
            match value {
                Ok((number, dimension)) => set.push((path.clone(), *number, *dimension)),
                Err(why) => return Err(lone(&text.name, "elaborate::set", format!("the value of `{path}`: {why}"))),
            }
        }
        let options = bond_compiler::Options {
            model: self.model.clone(),
            set,
            method: self.method.clone(),
            accuracy: self.accuracy,
            step: self.step,
            stop: self.stop,
            without: self.without.clone(),
            powers: self.powers,
            whole: self.whole,
        };
        let sources = text.sources.clone();
        match bond_compiler::compile_loaded(&sources, &text.loaded, &options) {
            Ok(inner) => Ok(Compiled { inner, sources, used: text.used.clone() }),
            Err(list) => Err(Errors::new(sources, list)),
        }
    }
}

/// A text and the files that it uses, read and parsed: to be compiled many times, from several threads at once.
///
/// ```
/// let text = bond::Text::new("decay.bond", "
///     model Decay(r = 1 Ohm) {
///       C:cap { compliance = 1 F;  q0 = 1 C }
///       R:loss = r
///       cap -> loss
///       probe q = cap.q
///     }");
/// for r in [1.0, 2.0] {
///     let compiled = bond::Options::new().set_quantity("r", (r, None)).compile_text(&text)?;
///     let mut sim = compiled.simulate(bond::Steps::new())?;
///     sim.advance(1.0)?;
///     assert!((sim.probe("q")? - (-1.0 / r).exp()).abs() < 1e-9);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Text {
    name: String,
    sources: Sources,
    loaded: bond_compiler::Loaded,
    used: Vec<PathBuf>,
}

impl Text {
    /// Reads it. The name is shown in messages; files that the text uses are looked for beside it. What is wrong with
    /// them is said when it is compiled.
    pub fn new(name: &str, text: impl Into<String>) -> Self {
        let mut sources = Sources::new();
        let main = sources.add(name, text);
        let mut loader = FileLoader::new(name);
        let loaded = bond_compiler::load(&mut sources, main, &mut loader);
        Self { name: name.to_string(), sources, loaded, used: loader.used() }
    }

    /// The name under which it is shown.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The names of its functions, where it has no model: nothing to compile, but other files may use it.
    pub fn functions_alone(&self) -> Vec<&str> {
        self.loaded.functions_alone()
    }

    /// The texts of it: its own first, then those of the files that it uses.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// Where the files are that it uses.
    pub fn used(&self) -> &[PathBuf] {
        &self.used
    }
}

/// An error that has no place in the text.
fn lone(name: &str, code: &'static str, message: String) -> Errors {
    let mut sources = Sources::new();
    sources.add(name, "");
    let at = Span { source: SourceId(0), start: 0, end: 0 };
    Errors::new(sources, vec![Diagnostic::error(code, at, message)])
}

/// Compiles a file as it is.
///
/// # Errors
/// All that is wrong with it; also that it cannot be read.
pub fn compile_file(path: impl AsRef<Path>) -> Result<Compiled, Errors> {
    Options::new().compile_file(path)
}

/// Compiles a text as it is. The name is shown in messages; files that the text uses are looked for beside it.
///
/// # Errors
/// All that is wrong with it.
pub fn compile_str(name: &str, text: impl Into<String>) -> Result<Compiled, Errors> {
    Options::new().compile_str(name, text)
}

/// A compiled model, ready to be shown and run.
#[derive(Clone, Debug)]
pub struct Compiled {
    inner: bond_compiler::Compiled,
    sources: Sources,
    used: Vec<PathBuf>,
}

impl Compiled {
    /// The stages of what runs, up to its step programs.
    pub fn stages(&self) -> &bond_compiler::Stages {
        &self.inner.stages
    }

    /// The texts that it was made from.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// Where the files are that its text uses.
    pub fn used(&self) -> &[PathBuf] {
        &self.used
    }

    /// What runs.
    pub fn scene(&self) -> &Scene {
        &self.inner.scene
    }

    /// The names of the probes, in order of declaration.
    pub fn probes(&self) -> &[String] {
        &self.inner.scene.probes.names
    }

    /// A part of it as text, with what is left out of what runs: `all`, `graph`, `causality`, `phs`, `regions`,
    /// `program`. For another word, the text says so.
    pub fn show(&self, what: &str) -> String {
        let Some(what) = What::ALL.into_iter().find(|w| w.name() == what) else {
            let known: Vec<&str> = What::ALL.iter().map(|w| w.name()).collect();
            return format!("there is no `{what}` to show, only {}\n", known.join(", "));
        };
        self.show_as(what, As::Text).unwrap_or_else(|why| why + "\n")
    }

    /// A part of it in a format.
    ///
    /// # Errors
    /// A combination that makes no sense, or a picture that would be too large, in words.
    pub fn show_as(&self, what: What, format: As) -> Result<String, String> {
        let stages = self.inner.whole.as_ref().map_or(&self.inner.stages, |w| &w.stages);
        let mut model = stages.model.clone();
        let programs = programs(&self.inner.scene);
        let shown = Shown {
            model: &mut model,
            graph: &stages.graph,
            causality: &stages.causality,
            form: &stages.form,
            unneeded: self.inner.whole.as_ref().map(|w| &w.unneeded),
            programs: &programs,
        };
        bond_compiler::show::show(shown, what, format)
    }

    /// The linear model around the initial state, or around a state given by the states' names.
    ///
    /// # Errors
    /// In words, where loops of resistors cannot be solved at that state.
    pub fn linearize(
        &self,
        time: f64,
        states: &dyn Fn(&str) -> Option<f64>,
    ) -> Result<bond_compiler::linearize::Linearized, String> {
        bond_compiler::linearize::linearize(&mut self.inner.stages.clone(), time, states)
    }

    /// How fast each state changes, in SI units a second, at a time and at values of the states by name; a state that
    /// is not given is at its start. What sampled regions hold, and open ports, are 0.
    ///
    /// # Errors
    /// In words, where loops of resistors cannot be solved at that state.
    pub fn rates(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Vec<(String, f64)>, String> {
        bond_compiler::rates::rates(&mut self.inner.stages.clone(), time, states)
    }

    /// The energy of each continuous region, J, at a time and at values of the states by name.
    ///
    /// # Errors
    /// In words, where loops of resistors cannot be solved at that state.
    pub fn energies(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Vec<(String, f64)>, String> {
        bond_compiler::rates::energies(&mut self.inner.stages.clone(), time, states)
    }

    /// What has no finite value at a time and at values of the states by name, as a law that takes a root of what is
    /// below 0, in words; of loops nothing is told.
    pub fn undefined(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Option<String> {
        bond_compiler::rates::undefined(&mut self.inner.stages.clone(), time, states)
    }

    /// Puts it at its start. The model's own `simulate` settings hold where `steps` says nothing.
    ///
    /// # Errors
    /// A step length that makes no sense, or a program that fails at the start.
    pub fn simulate(&self, steps: Steps) -> Result<Simulation<'_>, RunError> {
        self.simulate_with(steps, [])
    }

    /// The same with signals given from outside: the path of an `input`, and what it is over time.
    ///
    /// ```
    /// let text = "
    ///     model Charge {
    ///       input u = 0 A
    ///       Sf:source = u
    ///       C:cap = 1 F
    ///       source -> cap
    ///       probe v = cap.e
    ///     }";
    /// let compiled = bond::compile_str("charge.bond", text)?;
    /// let ramp = bond::Course::table(&[0.0, 2.0], &[0.0, 4.0], false)?; // linear from 0 A at 0 s to 4 A at 2 s
    /// let mut sim = compiled.simulate_with(bond::Steps::new(), [("u".to_string(), ramp)])?;
    /// sim.advance(2.0)?;
    /// sim.set_input("u", -1.0)?; // from now on
    /// sim.advance(3.0)?;
    /// assert!((sim.probe("v")? - 3.0).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A step length that makes no sense, a name that there is not, or a program that fails at the start.
    pub fn simulate_with(
        &self,
        steps: Steps,
        inputs: impl IntoIterator<Item = (String, Course)>,
    ) -> Result<Simulation<'_>, RunError> {
        let settings = &self.inner.stages.model.settings;
        let stop = settings.stop.unwrap_or(1.0);
        Simulation::with(&self.inner.scene, &steps.resolve(settings, stop, settings.every)?, inputs)
    }

    /// The paths of the inputs, in order of declaration.
    pub fn inputs(&self) -> Vec<&str> {
        self.inner.scene.inputs.iter().map(|i| i.name.as_str()).collect()
    }
}

/// All programs of a scene, in the order in which they run.
fn programs(scene: &Scene) -> Vec<Program> {
    let mut list = Vec::new();
    for c in &scene.clusters {
        match &c.respond {
            Some(Respond::Last(p) | Respond::Matched(p, ..)) => list.push(p.clone()),
            None => {}
        }
        list.push(c.step.program.clone());
        list.push(c.instant.clone());
    }
    list.extend(scene.probes.program.clone());
    list
}
