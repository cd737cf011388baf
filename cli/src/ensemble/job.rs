//! An instance of an ensemble, from its number to its outcome.

use super::choice::Choice;
use super::outcome::Outcome;
use super::plan::Plan;
use crate::attribution::Attribution;
use crate::drive::{self, Halt, Walk, Watch};
use crate::pending::reached;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use bond::internal::{Code, CompiledInternals, OptionsInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Errors, InputSignal, Options, Simulation, Steps, Text};
use std::time::Instant;

/// More numbers than this are not kept of one instance.
pub const NUMBERS_PER_INSTANCE: usize = 1 << 24;

/// All that the instances have in common.
pub struct Job {
    /// The model.
    pub text: Text,
    /// Scene, stepper and the parameters that are the same for all.
    pub options: Options,
    /// The parameters that vary.
    pub plan: Plan,
    /// Steps of continuous regions.
    pub steps: Steps,
    /// End of the run, s; that of the model otherwise.
    pub stop: Option<f64>,
    /// Distance of the rows, s; that of the model otherwise.
    pub every: Option<f64>,
    /// Instants of rows, s.
    pub at: Vec<f64>,
    /// Whether there are rows over time.
    pub over_time: bool,
    /// Inputs over time.
    pub given: Vec<(String, InputSignal)>,
    /// How they are run.
    pub choice: Choice,
    /// The probes, which all instances must have.
    pub probes: Vec<String>,
}

impl Job {
    /// Compiles an instance.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn compile(&self, instance: u64) -> Result<Compiled, Errors> {
        let values = self.plan.values(instance);
        let options = self.plan.paths().zip(values).fold(self.options.clone(), |o, (p, v)| o.set_quantity(p, v));
        options.compile_text(&self.text)
    }

    /// The instants at which an instance is looked at, its steps, and its end, s: those of a run of its own.
    ///
    /// # Errors
    /// Rows, steps or an end that cannot be.
    pub fn course(&self, compiled: &Compiled) -> Result<(Rows, bond_runtime::simulate::Options, f64), Stop> {
        let settings = &compiled.stages().model.settings;
        let stop = self.stop.or(settings.stop).unwrap_or(1.0);
        // The command line sets values of every instance, so an error may be its own.
        let rows =
            Rows::new(stop, Grid::asked(self.every, settings.every, &self.at), &self.at, Attribution::CommandLine)?;
        let steps = self.steps.resolve(settings, stop, self.every.or(settings.every))?;
        drive::possible(compiled.scene(), &steps, stop, Attribution::CommandLine)?;
        Ok((rows, steps, stop))
    }

    /// Runs an instance.
    pub fn run(&self, instance: u64) -> Outcome {
        let failed = |why| Outcome::failed(self.probes.len(), why);
        let compiled = match self.prepare(instance) {
            Ok(compiled) => compiled,
            Err(why) => return failed(why),
        };
        let (code, begun) = (self.choice.code(), Instant::now());
        let (mut walk, mut sim) = match self.begin(&compiled, code) {
            Ok(begun) => begun,
            Err(why) => return failed(why),
        };
        let made = begun.elapsed();
        let mut list = Vec::new();
        let halted = loop {
            match walk.on(&mut sim, &mut Recorder { job: self, list: &mut list }) {
                Ok(true) => {}
                Ok(false) => break None,
                Err(halt) => break Some(halt),
            }
        };
        if code == Code::Native && halted.is_none() {
            self.choice.learn(made, begun.elapsed().saturating_sub(made));
        }
        self.outcome(&list, halted, sim)
    }

    /// Compiles an instance, whose probes must be those of all.
    fn prepare(&self, instance: u64) -> Result<Compiled, String> {
        let names = || self.plan.paths().zip(self.plan.values(instance));
        if let Some((path, (x, _))) = names().find(|(_, (x, _))| !x.is_finite()) {
            return Err(format!("{path} = {x} is not a finite number"));
        }
        let compiled = self.compile(instance).map_err(|errors| first(&errors))?;
        if compiled.probes() != self.probes {
            return Err(format!("its probes are {}, and not those of the others", compiled.probes().join(", ")));
        }
        Ok(compiled)
    }

    /// An instance at its start, and its way.
    fn begin<'a>(&self, compiled: &'a Compiled, code: Code) -> Result<(Walk, Simulation<'a>), String> {
        let (rows, steps, stop) = self.course(compiled).map_err(|stop| words(&stop))?;
        let sim = Simulation::on(self.choice.backend(code), compiled.scene(), &steps, self.given.iter().cloned());
        let sim = sim.map_err(|e| e.to_string())?;
        // Without rows, fixed steps need not end there.
        let rows = if self.over_time || steps.step.is_none() { rows } else { Rows::end(stop) };
        Ok((Walk::new(sim.time(), rows, stop), sim))
    }

    /// The outcome of an instance.
    fn outcome(&self, list: &[f64], halted: Option<Halt>, mut sim: Simulation<'_>) -> Outcome {
        let width = self.probes.len();
        let end = sim.probes().map(|v| v[..width.min(v.len())].to_vec());
        let summary = sim.summary();
        let nothing = || vec![f64::NAN; width];
        let (last, failure, until) = match (halted, end) {
            (None, Ok(values)) => (values, None, None),
            (None, Err(e)) | (Some(Halt::Numerics(e)), _) => (nothing(), Some(e.to_string()), e.time()),
            (Some(Halt::Stop(stop)), _) => (nothing(), Some(words(&stop)), None),
        };
        let passive = summary.passive && failure.is_none();
        let rows = reached(list, 1 + width, until.unwrap_or(f64::INFINITY)).to_vec();
        Outcome { last, rows, passive, worst: summary.worst_step, failure }
    }
}

/// Notes the rows of an instance.
struct Recorder<'a> {
    job: &'a Job,
    list: &'a mut Vec<f64>,
}

impl Watch for Recorder<'_> {
    fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt> {
        if self.job.over_time {
            if self.list.len() > NUMBERS_PER_INSTANCE {
                let why = format!(
                    "more than {NUMBERS_PER_INSTANCE} numbers would be kept of one instance; ask for fewer rows"
                );
                return Err(Halt::Stop(Stop::Usage(why)));
            }
            let values = sim.probes().map_err(Halt::Numerics)?;
            self.list.push(t);
            self.list.extend(values.iter().take(self.job.probes.len()));
        }
        Ok(())
    }

    fn mark(&mut self, _: &Simulation<'_>, _: bool) -> Result<(), Halt> {
        Ok(())
    }
}

/// What is wrong first, on a line.
fn first(errors: &Errors) -> String {
    errors.list().first().map_or_else(String::new, |d| d.message.replace('\n', " "))
}

/// Why it ends, as a text.
fn words(stop: &Stop) -> String {
    match stop {
        Stop::Usage(why) | Stop::Model(why) | Stop::Numerics(why) => why.clone(),
        Stop::Placed(placed) => placed.1.message.clone(),
        Stop::Said(status) => format!("status {status}"),
        Stop::Pipe => "nobody reads".into(),
    }
}
