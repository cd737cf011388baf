//! A compiled model that runs.

use crate::code::Code;
use crate::failure::{RunError, unknown};
use bond_runtime::ir::{Array, Slot};
use bond_runtime::kernel::Backend;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{self, InputSignal, Summary};

/// A compiled model that runs.
pub struct Simulation<'a> {
    inner: simulate::Simulation<'a>,
    scene: &'a Scene,
}

impl<'a> Simulation<'a> {
    /// The whole state, as bytes. A run that [resumes](crate::Compiled::resume) from them gives the same bits as this
    /// one, if both are advanced to the same instants.
    ///
    /// # Errors
    /// What cannot be written, in words.
    pub fn save(&self) -> Result<Vec<u8>, RunError> {
        self.inner.save().map_err(RunError::Save)
    }

    /// Now, s.
    pub fn time(&self) -> f64 {
        self.inner.time()
    }

    /// The end of the last whole step, s. Values after it are interpolated within a fixed step, or within the period of
    /// a sampled region, and that step may still fail.
    pub fn settled(&self) -> f64 {
        self.inner.settled()
    }

    /// Runs to an instant, s, and takes all samples up to it, including one at that instant. An instant in the past
    /// changes nothing.
    ///
    /// # Errors
    /// A step that fails. The results until then remain.
    pub fn advance(&mut self, until: f64) -> Result<(), RunError> {
        if !until.is_finite() {
            return Err(RunError::Instant(until));
        }
        Ok(self.inner.advance(until)?)
    }

    /// Ends the run at an instant, s. Continuous regions with fixed steps take a last, shorter step, so that the ledger
    /// holds at that very instant.
    ///
    /// # Errors
    /// A step that fails. The results until then remain.
    pub fn finish(&mut self, at: f64) -> Result<(), RunError> {
        if !(at.is_finite() && at >= self.time()) {
            return Err(RunError::Instant(at));
        }
        Ok(self.inner.finish(at)?)
    }

    /// The value of a probe now, in SI.
    ///
    /// # Errors
    /// An unknown name, or an observation that fails.
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

    /// The energy and signal states of all regions, by name. In a run with fixed steps these are the states at the end
    /// of the last whole step.
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

    /// Reports how far the outside moved at an open port during the current interval.
    ///
    /// # Errors
    /// An unknown name.
    pub fn report(&mut self, port: &str, q: f64) -> Result<(), RunError> {
        self.inner.report(open(self.scene, port)?, q);
        Ok(())
    }

    /// Sets what the outside imposes at an open port of a continuous region from now on: its effort or its flow, as
    /// causality assigns it, along the half arrow, SI.
    ///
    /// # Errors
    /// An unknown name.
    pub fn drive(&mut self, port: &str, value: f64) -> Result<(), RunError> {
        self.inner.drive(open(self.scene, port)?, value);
        Ok(())
    }

    /// Sets an `input`, by its path, from now on, in SI. A sampled region reads it at its next sample.
    ///
    /// # Errors
    /// An unknown name.
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

/// A run of a scene that need not come from a [`Compiled`](crate::Compiled), on a back end of choice.
pub trait SimulationInternals<'a>: Sized {
    /// A scene at its start.
    ///
    /// # Errors
    /// A program that fails at the start.
    fn new(scene: &'a Scene, options: &simulate::Options) -> Result<Self, RunError>;

    /// A scene at its start, with input signals by path. Other inputs have their defaults.
    ///
    /// # Errors
    /// An unknown name, or a program that fails at the start.
    fn with(
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError>;

    /// The same, with programs run by this back end: one of [`Code`], or another.
    ///
    /// # Errors
    /// An unknown name, or a program that fails at the start.
    fn on(
        backend: &dyn Backend,
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError>;

    /// A run that continues from what [`Simulation::save`] gave, with the step and the tolerance that it had. Input
    /// signals are those of the saved run, except those given here.
    ///
    /// # Errors
    /// An unknown name, or bytes that are not the state of this very scene.
    fn resume(
        backend: &dyn Backend,
        scene: &'a Scene,
        bytes: &[u8],
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError>;

    /// The options with which it was started.
    fn options(&self) -> &simulate::Options;

    /// What is held at a double bar of the scene, as the side for which it is held receives it: an effort or a flow.
    ///
    /// # Panics
    /// If there is no such double bar.
    fn held_at_bar(&self, bar: usize) -> f64;

    /// What continuous parts of the scene took at the last sample for signals of sampled ones, by name.
    fn held_signals(&self) -> Vec<(&'a str, f64)>;
}

impl<'a> SimulationInternals<'a> for Simulation<'a> {
    fn new(scene: &'a Scene, options: &simulate::Options) -> Result<Self, RunError> {
        Self::with(scene, options, [])
    }

    fn with(
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError> {
        Self::on(Code::default().backend(), scene, options, inputs)
    }

    fn on(
        backend: &dyn Backend,
        scene: &'a Scene,
        options: &simulate::Options,
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError> {
        let signals = signals(scene, inputs)?;
        Ok(Self { inner: simulate::Simulation::on(backend, scene, options, signals)?, scene })
    }

    fn resume(
        backend: &dyn Backend,
        scene: &'a Scene,
        bytes: &[u8],
        inputs: impl IntoIterator<Item = (String, InputSignal)>,
    ) -> Result<Self, RunError> {
        let signals = signals(scene, inputs)?;
        Ok(Self { inner: simulate::Simulation::resume(backend, scene, bytes, signals)?, scene })
    }

    fn options(&self) -> &simulate::Options {
        self.inner.options()
    }

    fn held_at_bar(&self, bar: usize) -> f64 {
        self.inner.held_at_bar(bar)
    }

    fn held_signals(&self) -> Vec<(&'a str, f64)> {
        let mut list = Vec::new();
        for (i, c) in self.scene.clusters.iter().enumerate().filter(|(_, c)| c.period.is_none()) {
            for (k, (from, output)) in c.foreign.iter().enumerate() {
                let name = self.scene.clusters[*from].instant.name_of(Slot::new(Array::Output, *output));
                list.extend(name.map(|name| (name, self.inner.held_signal(i, k))));
            }
        }
        list
    }
}

/// Input signals by number, from those by path.
fn signals(
    scene: &Scene,
    inputs: impl IntoIterator<Item = (String, InputSignal)>,
) -> Result<Vec<(usize, InputSignal)>, RunError> {
    inputs.into_iter().map(|(name, signal)| Ok((input(scene, &name)?, signal))).collect()
}

/// The number of the open port of that name.
fn open(scene: &Scene, name: &str) -> Result<usize, RunError> {
    scene.open.iter().position(|o| o.name == name).ok_or_else(|| {
        let known: Vec<String> = scene.open.iter().map(|o| o.name.clone()).collect();
        unknown("open port", name, &known)
    })
}

/// The number of the input of that path.
fn input(scene: &Scene, name: &str) -> Result<usize, RunError> {
    scene.inputs.iter().position(|i| i.name == name).ok_or_else(|| {
        let known: Vec<String> = scene.inputs.iter().map(|i| i.name.clone()).collect();
        unknown("input", name, &known)
    })
}
