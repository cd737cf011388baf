//! The lengths of a run's steps.

use crate::failure::RunError;
use bond_compiler::discretise::DEFAULT_TOLERANCE;
use bond_compiler::model::Settings;
use bond_runtime::simulate;

/// How continuous regions are stepped. Sampled regions step at their period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    step: Option<f64>,
    tolerance: Option<f64>,
    longest: Option<f64>,
}

impl Steps {
    /// What the model's `simulate` says; a tolerance of 1e-6 if it says nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Steps of one length, in s.
    pub fn fixed(step: f64) -> Self {
        Self { step: Some(step), ..Self::default() }
    }

    /// Adaptive steps: the error of each, relative to the size of the states, stays below this.
    pub fn tolerance(tolerance: f64) -> Self {
        Self { tolerance: Some(tolerance), ..Self::default() }
    }

    /// Sets the longest adaptive step, in s.
    pub fn longest(mut self, step: f64) -> Self {
        self.longest = Some(step);
        self
    }
}

/// Least number of steps per run, where nothing gives their length.
const STEPS_PER_RUN: f64 = 1000.0;

/// How a run's steps become options of the runtime.
pub trait StepsInternals {
    /// What is given, by option of the command line.
    fn given(self) -> [(&'static str, Option<f64>); 3];

    /// The runtime's options. What is given here takes precedence over the model's `settings`.
    ///
    /// # Errors
    /// Lengths and tolerances that make no sense.
    fn resolve(self, settings: &Settings, stop: f64, every: Option<f64>) -> Result<simulate::Options, RunError>;
}

impl StepsInternals for Steps {
    fn given(self) -> [(&'static str, Option<f64>); 3] {
        [("--step", self.step), ("--tolerance", self.tolerance), ("--longest", self.longest)]
    }

    fn resolve(self, settings: &Settings, stop: f64, every: Option<f64>) -> Result<simulate::Options, RunError> {
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
            (None, None) => tolerance = Some(DEFAULT_TOLERANCE),
            // With a tolerance, a step can only be the longest one.
            (Some(h), Some(_)) => {
                step = None;
                let longest = longest.map_or(bound(h), |l| l.min(h));
                return Ok(simulate::Options { step, tolerance, default_step: longest, longest: Some(longest) });
            }
            _ => {}
        }
        let usual = every.filter(|e| *e > 0.0).map_or(stop / STEPS_PER_RUN, |e| e.min(stop / STEPS_PER_RUN));
        Ok(simulate::Options { step, tolerance, default_step: longest.unwrap_or(usual), longest })
    }
}
