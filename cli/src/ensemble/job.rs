//! An instance of an ensemble, from its number to what it came to.

use super::choice::Choice;
use super::outcome::Outcome;
use super::plan::Plan;
use crate::drive::{self, Halt, drive};
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use bond::{Code, Compiled, Course, Errors, Options, Simulation, Steps, Text};
use std::time::Instant;

/// More numbers than this are not kept of one instance.
pub const NUMBERS: usize = 1 << 24;

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
    pub given: Vec<(String, Course)>,
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
        let rows = Rows::new(stop, Grid::asked(self.every, settings.every, &self.at), &self.at)?;
        let steps = self.steps.resolve(settings, stop, self.every.or(settings.every))?;
        drive::possible(compiled.scene(), &steps, stop)?;
        Ok((rows, steps, stop))
    }

    /// Runs an instance.
    pub fn run(&self, instance: u64) -> Outcome {
        let width = self.probes.len();
        let names = || self.plan.paths().zip(self.plan.values(instance));
        if let Some((path, (x, _))) = names().find(|(_, (x, _))| !x.is_finite()) {
            return Outcome::failed(width, format!("{path} = {x} is no finite number"));
        }
        let compiled = match self.compile(instance) {
            Ok(compiled) => compiled,
            Err(errors) => return Outcome::failed(width, first(&errors)),
        };
        if compiled.probes() != self.probes {
            let why = format!("its probes are {}, and not those of the others", compiled.probes().join(", "));
            return Outcome::failed(width, why);
        }
        self.simulate(&compiled).unwrap_or_else(|why| Outcome::failed(width, why))
    }

    fn simulate(&self, compiled: &Compiled) -> Result<Outcome, String> {
        let width = self.probes.len();
        let (rows, steps, stop) = self.course(compiled).map_err(|stop| words(&stop))?;
        let (code, begun) = (self.choice.code(), Instant::now());
        let sim = Simulation::on(self.choice.backend(code), compiled.scene(), &steps, self.given.iter().cloned());
        let mut sim = sim.map_err(|e| e.to_string())?;
        let made = begun.elapsed();
        let mut list = Vec::new();
        let halted = drive(&mut sim, rows, stop, &mut |sim, t| {
            if self.over_time {
                if list.len() > NUMBERS {
                    let why = format!("more than {NUMBERS} numbers would be kept of one instance; ask for fewer rows");
                    return Err(Halt::Stop(Stop::Usage(why)));
                }
                let values = sim.probes().map_err(Halt::Numerics)?;
                list.push(t);
                list.extend(values.iter().take(width));
            }
            Ok(())
        });
        if code == Code::Native && halted.is_ok() {
            self.choice.learn(made, begun.elapsed().saturating_sub(made));
        }
        let end = sim.probes().map(|v| v[..width.min(v.len())].to_vec());
        let summary = sim.summary();
        let (last, failure) = match (halted, end) {
            (Ok(()), Ok(values)) => (values, None),
            (Ok(()), Err(e)) | (Err(Halt::Numerics(e)), _) => (vec![f64::NAN; width], Some(e.to_string())),
            (Err(Halt::Stop(stop)), _) => (vec![f64::NAN; width], Some(words(&stop))),
        };
        let passive = summary.passive && failure.is_none();
        Ok(Outcome { last, rows: list, passive, worst: summary.worst_step, failure })
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
        Stop::Said(status) => format!("status {status}"),
        Stop::Pipe => "nobody reads".into(),
    }
}
