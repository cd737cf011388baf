//! From a file or a text to a compiled model.

use crate::code::Code;
use crate::errors::Errors;
use crate::failure::RunError;
use crate::load::{CarriedTexts, FileLoader, Use, read};
use crate::quantity::{Quantity, quantity};
use crate::simulation::{Simulation, SimulationInternals};
use crate::steps::{Steps, StepsInternals};
use bond_compiler::discretise::Accuracy;
use bond_compiler::linearize::Linearized;
use bond_compiler::show::{As, Picture, Shown, What};
use bond_compiler::thresholds::Thresholds;
use bond_compiler::units::BaseUnits;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{SourceId, Sources, Span};
use bond_runtime::ir::Program;
use bond_runtime::options::NumericOptions;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::InputSignal;
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
    base_units: BaseUnits,
    numeric: NumericOptions,
    thresholds: Thresholds,
}

impl Options {
    /// The last model of the file, with its own parameters and methods.
    pub fn new() -> Self {
        Self::default()
    }

    /// Chooses the scene: a model of the file, by name. The default is the last one.
    pub fn model(mut self, name: impl Into<String>) -> Self {
        self.model = Some(name.into());
        self
    }

    /// Sets the step length, in s, that the step programs are made for: the one length, or the longest. The default is
    /// what the model's `simulate` says. A run may take other steps; with far longer ones balances hold to fewer
    /// digits.
    pub fn step(mut self, step: f64) -> Self {
        self.step = Some(step);
        self
    }

    /// Sets the end of the run, in s, from which a step length follows if neither this nor the model gives one.
    pub fn stop(mut self, stop: f64) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Chooses the stepper by name, such as `gonzalez` or `radau`; `bond run --help` lists them.
    pub fn method(mut self, name: impl Into<String>) -> Self {
        self.method = Some(name.into());
        self
    }

    /// Sets a parameter, by its path, to a number with a unit, such as `2 kg`, or without one, in SI.
    pub fn set(mut self, path: impl Into<String>, value: &str) -> Self {
        self.set.push((path.into(), quantity(value)));
        self
    }

    /// Leaves out a storage, a resistor or a field, by its path. At a 1-junction its effort is then 0, at a 0-junction
    /// its flow.
    pub fn without(mut self, path: impl Into<String>) -> Self {
        self.without.push(path.into());
        self
    }

    /// Runs all of the model, also the parts on which no probe, open port or expectation depends.
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
            base_units: self.base_units,
            numeric: self.numeric,
            thresholds: self.thresholds,
            ..bond_compiler::Options::default()
        };
        let sources = text.sources.clone();
        match bond_compiler::compile_loaded(&sources, &text.loaded, &options) {
            Ok(inner) => Ok(Compiled { inner, sources, used: text.used.clone() }),
            Err(list) => {
                // What cannot be read is wrong in any scene.
                let of_scene = list.iter().any(|d| !d.code.starts_with("syntax::"));
                Err(Errors::new(sources, list).with_note(text.loaded.other_scene(&options).filter(|_| of_scene)))
            }
        }
    }
}

/// Settings of a compilation that only the command makes.
pub trait OptionsInternals {
    /// Sets the accuracy by which a stepper is chosen if none is named. The default is what the model's `simulate`
    /// says.
    fn accuracy(self, accuracy: Accuracy) -> Self;

    /// Sets a parameter by its path to a number that was read before.
    fn set_quantity(self, path: impl Into<String>, value: Quantity) -> Self;

    /// Adds probes behind the others: the power into each of [`bond_compiler::reduction::parts`].
    fn powers(self) -> Self;

    /// Sets other base units than those of SI for all numbers, the times of a run included.
    fn base_units(self, units: BaseUnits) -> Self;

    /// Sets the numbers that numeric methods go by, and that programs are chosen and written by.
    fn numeric(self, numeric: NumericOptions, thresholds: Thresholds) -> Self;
}

impl OptionsInternals for Options {
    fn accuracy(mut self, accuracy: Accuracy) -> Self {
        self.accuracy = accuracy;
        self
    }

    fn set_quantity(mut self, path: impl Into<String>, value: Quantity) -> Self {
        self.set.push((path.into(), Ok(value)));
        self
    }

    fn powers(mut self) -> Self {
        self.powers = true;
        self
    }

    fn base_units(mut self, units: BaseUnits) -> Self {
        self.base_units = units;
        self
    }

    fn numeric(mut self, numeric: NumericOptions, thresholds: Thresholds) -> Self {
        (self.numeric, self.thresholds) = (numeric, thresholds);
        self
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
/// for r in [1.0f64, 2.0] {
///     let compiled = bond::Options::new().set("r", &format!("{r} Ohm")).compile_text(&text)?;
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
    uses: Vec<Use>,
}

impl Text {
    /// Reads it. The name is shown in messages; files that the text uses are looked for beside it. What is wrong with
    /// them is said when it is compiled.
    pub fn new(name: &str, text: impl Into<String>) -> Self {
        let mut sources = Sources::new();
        let main = sources.add(name, text);
        let mut loader = FileLoader::new(name);
        let loaded = bond_compiler::load(&mut sources, main, &mut loader);
        Self { name: name.to_string(), sources, loaded, used: loader.used(), uses: loader.uses() }
    }

    /// The name under which it is shown.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The names of its functions, if it has no model: there is nothing to compile, but other files may use it.
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

/// A text that goes along with a program, away from its files.
pub trait TextInternals: Sized {
    /// It and the files that it uses, but for those of the bundled library.
    fn carry(&self) -> CarriedTexts;

    /// Parses what was carried along.
    fn carried(texts: &CarriedTexts) -> Self;
}

impl TextInternals for Text {
    fn carry(&self) -> CarriedTexts {
        let is_own = |name: &String| *name == self.name || self.uses.iter().any(|u| u.name == *name);
        let own = self.sources.list().iter().filter(|s| is_own(&s.name));
        CarriedTexts { list: own.map(|s| (s.name.clone(), s.text.clone())).collect(), uses: self.uses.clone() }
    }

    fn carried(texts: &CarriedTexts) -> Self {
        let (name, text) = texts.list.first().cloned().unwrap_or_default();
        let mut sources = Sources::new();
        let main = sources.add(name.clone(), text);
        let mut loader = texts;
        let loaded = bond_compiler::load(&mut sources, main, &mut loader);
        Self { name, sources, loaded, used: Vec::new(), uses: texts.uses.clone() }
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
    pub(crate) inner: bond_compiler::Compiled,
    sources: Sources,
    used: Vec<PathBuf>,
}

impl Compiled {
    /// The texts that it was made from.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// Where the files are that its text uses.
    pub fn used(&self) -> &[PathBuf] {
        &self.used
    }

    /// The names of the probes, in order of declaration.
    pub fn probes(&self) -> &[String] {
        &self.inner.scene.probes.names
    }

    /// Prints a part of it as text: `all`, `graph`, `causality`, `phs`, `regions` or `program`. Parts of the model that
    /// do not run are printed too. For another word, the text says so.
    pub fn show(&self, what: &str) -> String {
        self.show_as(what, "text").unwrap_or_else(|why| why + "\n")
    }

    /// Prints a part of it in a format: `text`, `json`, `dot`, `svg` or `latex`, as `bond show` does.
    ///
    /// # Errors
    /// A name that does not exist, a combination that makes no sense, or a picture that would be too large, in words.
    pub fn show_as(&self, what: &str, format: &str) -> Result<String, String> {
        let what = named(what, What::ALL.map(|w| (w.name(), w)))?;
        let format = named(format, As::ALL.map(|a| (a.name(), a)))?;
        show(self, what, format, Picture::default())
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

    /// Names, in words, a law or rate without a finite value at a time and at values of the states by name, such as a
    /// root of a negative number. Loops are not examined.
    pub fn undefined(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Option<String> {
        bond_compiler::rates::undefined(&mut self.inner.stages.clone(), time, states)
    }

    /// Starts a run. The model's own `simulate` settings hold where `steps` says nothing.
    ///
    /// # Errors
    /// A step length that makes no sense, or a program that fails at the start.
    pub fn simulate(&self, steps: Steps) -> Result<Simulation<'_>, RunError> {
        self.simulate_with(steps, [])
    }

    /// Starts a run with input signals: the path of an `input`, and its value over time.
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
    /// let ramp = bond::InputSignal::table(&[0.0, 2.0], &[0.0, 4.0], false)?; // linear from 0 A at 0 s to 4 A at 2 s
    /// let mut sim = compiled.simulate_with(bond::Steps::new(), [("u".to_string(), ramp)])?;
    /// sim.advance(2.0)?;
    /// sim.set_input("u", -1.0)?; // from now on
    /// sim.advance(3.0)?;
    /// assert!((sim.probe("v")? - 3.0).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A step length that makes no sense, an unknown name, or a program that fails at the start.
    pub fn simulate_with(
        &self,
        steps: Steps,
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Simulation<'_>, RunError> {
        Simulation::with(&self.inner.scene, &self.steps(steps)?, inputs)
    }

    /// Continues a run from the bytes that [`Simulation::save`] gave, with its steps and its input signals.
    ///
    /// # Errors
    /// Bytes that are not the state of this very model with these options.
    pub fn resume(&self, bytes: &[u8]) -> Result<Simulation<'_>, RunError> {
        Simulation::resume(Code::default().backend(), &self.inner.scene, bytes, [])
    }

    /// The runtime's options for a run of this model.
    pub(crate) fn steps(&self, steps: Steps) -> Result<bond_runtime::simulate::Options, RunError> {
        let settings = &self.inner.stages.model.settings;
        steps.resolve(settings, settings.stop.unwrap_or(1.0), settings.every)
    }

    /// The paths of the inputs, in order of declaration.
    pub fn inputs(&self) -> Vec<&str> {
        self.inner.scene.inputs.iter().map(|i| i.name.as_str()).collect()
    }
}

/// The compiler's results in a compiled model.
pub trait CompiledInternals {
    /// The stages of what runs, up to its step programs.
    fn stages(&self) -> &bond_compiler::Stages;

    /// The stages of all of the model.
    fn whole(&self) -> &bond_compiler::Stages;

    /// What runs.
    fn scene(&self) -> &Scene;

    /// The linear model around the initial state, or around a state given by the states' names.
    ///
    /// # Errors
    /// In words, where loops of resistors cannot be solved at that state.
    fn linearize(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Linearized, String>;

    /// Prints a part of it in a format, pictures as they are asked for.
    ///
    /// # Errors
    /// A combination that makes no sense, or a picture that would be too large, in words.
    fn show_drawn(&self, what: What, format: As, picture: Picture) -> Result<String, String>;
}

impl CompiledInternals for Compiled {
    fn stages(&self) -> &bond_compiler::Stages {
        &self.inner.stages
    }

    fn whole(&self) -> &bond_compiler::Stages {
        self.inner.whole.as_ref().map_or(&self.inner.stages, |whole| &whole.stages)
    }

    fn scene(&self) -> &Scene {
        &self.inner.scene
    }

    fn linearize(&self, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Linearized, String> {
        bond_compiler::linearize::linearize(&mut self.inner.stages.clone(), time, states)
    }

    fn show_drawn(&self, what: What, format: As, picture: Picture) -> Result<String, String> {
        show(self, what, format, picture)
    }
}

/// Prints a part of a model in a format.
///
/// # Errors
/// A combination that makes no sense, or a picture that would be too large, in words.
fn show(compiled: &Compiled, what: What, format: As, picture: Picture) -> Result<String, String> {
    let (inner, whole) = (&compiled.inner, compiled.inner.whole.as_ref());
    let stages = compiled.whole();
    let shown = Shown {
        model: &mut stages.model.clone(),
        graph: &stages.graph,
        causality: &stages.causality,
        form: &stages.form,
        unneeded: whole.map(|w| &w.unneeded),
        programs: &programs(&inner.scene),
        picture,
    };
    bond_compiler::show::show(shown, what, format)
}

/// All programs of a scene, in the order in which they run.
fn programs(scene: &Scene) -> Vec<Program> {
    let mut list = Vec::new();
    for c in &scene.clusters {
        list.extend(c.respond.iter().map(|r| r.program.clone()));
        list.push(c.step.program.clone());
        list.push(c.instant.clone());
    }
    list.extend(scene.probes.program.clone());
    list
}

/// The one of that name.
fn named<T, const N: usize>(name: &str, list: [(&'static str, T); N]) -> Result<T, String> {
    let known = list.each_ref().map(|(n, _)| *n).join(", ");
    let found = list.into_iter().find(|(n, _)| *n == name);
    found.map(|(_, t)| t).ok_or_else(|| format!("there is no `{name}` to show, only {known}"))
}
