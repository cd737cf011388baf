//! A compiled model that runs.

use bond_compiler::model::Settings;
use bond_runtime::interpreter::Interpret;
use bond_runtime::ir::{Array, Slot};
use bond_runtime::kernel::Backend;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{self, Course, Summary};
use thiserror::Error;

/// How continuous regions are stepped. Sampled regions step at their period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    step: Option<f64>,
    tolerance: Option<f64>,
    longest: Option<f64>,
}

impl Steps {
    /// Where nothing tells of their length, a run has so many steps at least.
    const PARTS: f64 = 1000.0;

    /// As the model's `simulate` says, else to a tolerance of 1e-6.
    pub fn new() -> Self {
        Self::default()
    }

    /// All of one length, in s.
    pub fn fixed(step: f64) -> Self {
        Self { step: Some(step), ..Self::default() }
    }

    /// So short that the error of each, relative to the states' size, stays below this.
    pub fn tolerance(tolerance: f64) -> Self {
        Self { tolerance: Some(tolerance), ..Self::default() }
    }

    /// The longest step of those that are fitted to a tolerance, in s.
    pub fn longest(mut self, step: f64) -> Self {
        self.longest = Some(step);
        self
    }

    /// What is given here, by option of the command line.
    pub fn given(self) -> [(&'static str, Option<f64>); 3] {
        [("--step", self.step), ("--tolerance", self.tolerance), ("--longest", self.longest)]
    }

    /// What the runtime is told: what is given here goes before what the model says.
    ///
    /// # Errors
    /// Lengths and tolerances that make no sense.
    pub fn resolve(self, settings: &Settings, stop: f64, every: Option<f64>) -> Result<simulate::Options, RunError> {
        let (mut step, mut tolerance) = match (self.step, self.tolerance) {
            (None, None) => (settings.step, settings.tolerance),
            given => given,
        };
        let positive = |what: &'static str, x: Option<f64>| match x {
            Some(x) if !(x > 0.0 && x.is_finite()) => Err(RunError::Value { what, value: x }),
            _ => Ok(()),
        };
        positive("the step", step)?;
        positive("the tolerance", tolerance)?;
        if let Some(x) = tolerance.filter(|x| *x < 1e-14) {
            return Err(RunError::Tolerance(x));
        }
        positive("the longest step", self.longest)?;
        // What is longer than the run says nothing.
        let bound = |x: f64| if stop > 0.0 { x.min(stop) } else { x };
        let longest = self.longest.map(bound);
        match (step, tolerance) {
            (None, None) => tolerance = Some(1e-6),
            // With a tolerance, a step can only be the longest one.
            (Some(h), Some(_)) => {
                step = None;
                let longest = longest.map_or(bound(h), |l| l.min(h));
                return Ok(simulate::Options { step, tolerance, default_step: longest, longest: Some(longest) });
            }
            _ => {}
        }
        let usual = every.filter(|e| *e > 0.0).map_or(stop / Self::PARTS, |e| e.min(stop / Self::PARTS));
        Ok(simulate::Options { step, tolerance, default_step: longest.unwrap_or(usual), longest })
    }
}

/// How step programs are run. Both give the same numbers, to the last bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Code {
    /// As machine code, where the crate is built with its feature `native` and the machine is known; else interpreted.
    #[default]
    Native,
    /// Interpreted: slower, and nothing is compiled before the first step.
    Interpreted,
}

impl Code {
    /// What makes programs ready to run.
    pub fn backend(self) -> &'static dyn Backend {
        match self {
            #[cfg(feature = "native")]
            Code::Native => &bond_compiler::backend::native::JIT,
            #[cfg(not(feature = "native"))]
            Code::Native => &Interpret,
            Code::Interpreted => &Interpret,
        }
    }

    /// The same for so many scenes that mostly differ in their numbers alone: what they have in common is compiled
    /// once. Threads may share it.
    pub fn shared(self, scenes: u64) -> Box<dyn Backend + Send + Sync> {
        match self {
            #[cfg(feature = "native")]
            Code::Native => Box::new(bond_compiler::backend::native::Shared::new(scenes)),
            #[cfg(not(feature = "native"))]
            Code::Native => Box::new(Interpret),
            Code::Interpreted => Box::new(Interpret),
        }
    }
}

/// Why a run stopped, or could not do what was asked.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RunError {
    /// The numerics failed.
    #[error("{0}")]
    Numerics(#[from] simulate::Error),
    /// A length that is none.
    #[error("{what} is {value}, and must be positive")]
    Value {
        /// Which one.
        what: &'static str,
        /// What it is.
        value: f64,
    },
    /// A tolerance that rounding alone misses.
    #[error("the tolerance is {0:e}; it must be 1e-14 at least, which is rounding")]
    Tolerance(f64),
    /// An instant that is none.
    #[error("{0} is no instant to run to")]
    Instant(f64),
    /// A state that is not this scene's.
    #[error("{0}")]
    Resume(#[from] simulate::Refused),
    /// A state that cannot be written.
    #[error("the state cannot be saved: {0}")]
    Save(String),
    /// A name that there is not.
    #[error("there is no {what} `{name}`; there is {}", if known.is_empty() { "none".to_string() } else { known.join(", ") })]
    Unknown {
        /// A probe, an open port, an input.
        what: &'static str,
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
}

impl RunError {
    /// When the numerics failed, where that can be told, s.
    pub fn time(&self) -> Option<f64> {
        match self {
            RunError::Numerics(e) => match e {
                simulate::Error::Step { time, .. }
                | simulate::Error::TooSmall { time, .. }
                | simulate::Error::Endless { time, .. }
                | simulate::Error::Energy { time, .. } => Some(*time),
                simulate::Error::Table { .. } => None,
            },
            RunError::Value { .. }
            | RunError::Tolerance(_)
            | RunError::Instant(_)
            | RunError::Resume(_)
            | RunError::Save(_)
            | RunError::Unknown { .. } => None,
        }
    }
}

/// A compiled model that runs.
pub struct Simulation<'a> {
    inner: simulate::Simulation<'a>,
    scene: &'a Scene,
}

impl<'a> Simulation<'a> {
    /// A scene at its start.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn new(scene: &'a Scene, options: &simulate::Options) -> Result<Self, RunError> {
        Self::with(scene, options, [])
    }

    /// A scene at its start, with signals given from outside: the path of an `input`, and what it is over time. Others
    /// are what they are by default.
    ///
    /// # Errors
    /// A name that there is not, or a program that fails at the start.
    pub fn with(
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, Course)>,
    ) -> Result<Self, RunError> {
        Self::on(Code::default().backend(), scene, options, inputs)
    }

    /// The same, with programs run by this back end: those of [`Code`], or another.
    ///
    /// # Errors
    /// A name that there is not, or a program that fails at the start.
    pub fn on(
        backend: &dyn Backend,
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, Course)>,
    ) -> Result<Self, RunError> {
        let courses = inputs.into_iter().map(|(name, course)| Ok((input(scene, &name)?, course)));
        let courses = courses.collect::<Result<Vec<_>, RunError>>()?;
        Ok(Self { inner: simulate::Simulation::on(backend, scene, options, courses)?, scene })
    }

    /// A run that goes on from what [`Self::save`] gave, with the step and the tolerance that it had. Signals given
    /// from outside are what they were, but for those named here.
    ///
    /// # Errors
    /// A name that there is not, or bytes that are not the state of this very scene.
    pub fn resume(
        backend: &dyn Backend,
        scene: &'a Scene,
        bytes: &[u8],
        inputs: impl IntoIterator<Item = (String, Course)>,
    ) -> Result<Self, RunError> {
        let courses = inputs.into_iter().map(|(name, course)| Ok((input(scene, &name)?, course)));
        let courses = courses.collect::<Result<Vec<_>, RunError>>()?;
        Ok(Self { inner: simulate::Simulation::resume(backend, scene, bytes, courses)?, scene })
    }

    /// The whole state, as bytes. A run that goes on from them gives the same bits as this one, where the instants to
    /// which the two are advanced are the same.
    ///
    /// # Errors
    /// What cannot be written, in words.
    pub fn save(&self) -> Result<Vec<u8>, RunError> {
        self.inner.save().map_err(RunError::Save)
    }

    /// The steps of continuous regions that it was started with.
    pub fn options(&self) -> &simulate::Options {
        self.inner.options()
    }

    /// Now, s.
    pub fn time(&self) -> f64 {
        self.inner.time()
    }

    /// Up to where steps are taken, s: what is looked at beyond lies within a fixed step, or within the period of a
    /// sampled region, whose step may fail yet.
    pub fn settled(&self) -> f64 {
        self.inner.settled()
    }

    /// Runs to an instant: all samples up to it, that instant's included, are taken. An instant that is past changes
    /// nothing.
    ///
    /// # Errors
    /// A step that fails. What was computed until then stays.
    pub fn advance(&mut self, until: f64) -> Result<(), RunError> {
        if !until.is_finite() {
            return Err(RunError::Instant(until));
        }
        Ok(self.inner.advance(until)?)
    }

    /// Ends the run at an instant: continuous regions with fixed steps take the shorter step that is left, so that the
    /// ledger is of that very instant.
    ///
    /// # Errors
    /// A step that fails. What was computed until then stays.
    pub fn finish(&mut self, at: f64) -> Result<(), RunError> {
        if !(at.is_finite() && at >= self.time()) {
            return Err(RunError::Instant(at));
        }
        Ok(self.inner.finish(at)?)
    }

    /// The value of a probe now, in SI.
    ///
    /// # Errors
    /// A name that there is not, or an observation that fails.
    pub fn probe(&mut self, name: &str) -> Result<f64, RunError> {
        let Some(i) = self.scene.probes.names.iter().position(|n| n == name) else {
            return Err(unknown("probe", name, &self.scene.probes.names));
        };
        Ok(self.inner.probes()?.get(i).copied().unwrap_or(f64::NAN))
    }

    /// All probes now, in order of declaration, then the values that expectations look at.
    ///
    /// # Errors
    /// An observation that fails.
    pub fn probes(&mut self) -> Result<&[f64], RunError> {
        Ok(self.inner.probes()?)
    }

    /// A state by its name, such as `spring`.
    pub fn state(&self, name: &str) -> Option<f64> {
        self.scene.clusters.iter().enumerate().find_map(|(i, c)| {
            let k = c.names.iter().position(|n| n == name)?;
            self.inner.state(i).get(k).copied()
        })
    }

    /// What is held at a double bar of the scene, as the side that it is held for is given it: an effort or a flow.
    ///
    /// # Panics
    /// There is no such double bar.
    pub fn held_at_bar(&self, bar: usize) -> f64 {
        self.inner.held_at_bar(bar)
    }

    /// What continuous parts of the scene took at the last sample for signals of sampled ones, by name.
    pub fn held_signals(&self) -> Vec<(&'a str, f64)> {
        let mut list = Vec::new();
        for (i, c) in self.scene.clusters.iter().enumerate().filter(|(_, c)| c.period.is_none()) {
            for (k, (from, output)) in c.foreign.iter().enumerate() {
                let name = self.scene.clusters[*from].instant.name_of(Slot::new(Array::Output, *output));
                list.extend(name.map(|name| (name, self.inner.held_signal(i, k))));
            }
        }
        list
    }

    /// The energy and signal states of all regions by name. In a run with fixed steps they are those at the end of the
    /// last whole step.
    pub fn states(&self) -> impl Iterator<Item = (&'a str, f64)> {
        let clusters = self.scene.clusters.iter().enumerate();
        clusters.flat_map(|(i, c)| {
            c.names.iter().take(c.states).map(String::as_str).zip(self.inner.state(i).iter().copied())
        })
    }

    /// What the open ports hold now: name and value.
    pub fn held(&self) -> Vec<(&'a str, f64)> {
        self.scene.open.iter().map(|o| o.name.as_str()).zip(self.inner.held()).collect()
    }

    /// Reports how far the outside moved at an open port in the interval that runs.
    ///
    /// # Errors
    /// A name that there is not.
    pub fn report(&mut self, port: &str, q: f64) -> Result<(), RunError> {
        let Some(i) = self.scene.open.iter().position(|o| o.name == port) else {
            let known: Vec<String> = self.scene.open.iter().map(|o| o.name.clone()).collect();
            return Err(unknown("open port", port, &known));
        };
        self.inner.report(i, q);
        Ok(())
    }

    /// Sets what the outside gives at an open port of a continuous region from now on: the effort or the flow that
    /// causality asks of it, along the half arrow, SI.
    ///
    /// # Errors
    /// A name that there is not.
    pub fn drive(&mut self, port: &str, value: f64) -> Result<(), RunError> {
        let Some(i) = self.scene.open.iter().position(|o| o.name == port) else {
            let known: Vec<String> = self.scene.open.iter().map(|o| o.name.clone()).collect();
            return Err(unknown("open port", port, &known));
        };
        self.inner.drive(i, value);
        Ok(())
    }

    /// Sets a signal given from outside, an `input` by its path, from now on, in SI. A sampled region meets it at its
    /// next sample.
    ///
    /// # Errors
    /// A name that there is not.
    pub fn set_input(&mut self, name: &str, value: f64) -> Result<(), RunError> {
        let i = input(self.scene, name)?;
        self.inner.set_input(i, value);
        Ok(())
    }

    /// The ledger now.
    pub fn summary(&self) -> Summary {
        self.inner.summary()
    }
}

/// Which input a path names.
fn input(scene: &Scene, name: &str) -> Result<usize, RunError> {
    scene.inputs.iter().position(|i| i.name == name).ok_or_else(|| {
        let known: Vec<String> = scene.inputs.iter().map(|i| i.name.clone()).collect();
        unknown("input", name, &known)
    })
}

fn unknown(what: &'static str, name: &str, known: &[String]) -> RunError {
    RunError::Unknown { what, name: name.to_string(), known: known.to_vec() }
}
