//! Chooses a stepper and its step: by the error that a run may have, or by the time that it may take. The choice was
//! tried before, by the very run that follows.

mod budget;
mod error;
mod exact;
mod thresholds;

pub use thresholds::Thresholds;

use crate::bench::{Kernels, Look, Quantities, Reference, Runner, Search, Setting, Task, Way, Ways};
use crate::progress::Progress;
use crate::rows::Rows;
use crate::stop::Stop;
use bond::{InputSignal, Options, Steps, Text};
use bond_compiler::discretise::Method;
use bond_runtime::kernel::Backend;
use bond_runtime::scene::Scene;
use std::time::Instant;

/// About how many rows are compared.
const ROWS_COMPARED: usize = 1000;

/// The target of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// The largest relative error of a probe or state.
    Error(f64),
    /// Processor time per period of the scene, or per simulated second if nothing is sampled, s.
    Budget(f64),
}

/// A request for a choice.
pub struct Ask<'a> {
    /// The target.
    pub target: Target,
    /// The model.
    pub text: &'a Text,
    /// How it is compiled, without a method.
    pub options: Options,
    /// The method, where the user names one.
    pub method: Option<&'a str>,
    /// End of the run, s.
    pub stop: f64,
    /// Rows of the run.
    pub rows: Rows,
    /// Distance of the rows, s, if given.
    pub every: Option<f64>,
    /// The longest adaptive step, s, if given.
    pub longest: Option<f64>,
    /// Probes are written at each row.
    pub shows: bool,
    /// Signals from outside.
    pub given: &'a [(String, InputSignal)],
    /// What runs the programs.
    pub backend: &'a dyn Backend,
    /// The numbers by which it decides.
    pub thresholds: Thresholds,
}

/// The result of a choice.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// `gonzalez`
    pub method: &'static str,
    /// Its step or tolerance.
    pub setting: Setting,
    /// Its measured error, relative.
    pub error: f64,
    /// Why it was chosen, in words.
    pub why: String,
    /// The run against which it was measured, in words.
    pub against: String,
    /// How long choosing took, s.
    pub took: f64,
    /// The scene that runs.
    pub scene: Scene,
    /// The longest adaptive step, s, if given.
    longest: Option<f64>,
}

impl Chosen {
    /// The steps of the run.
    pub fn steps(&self) -> Steps {
        self.setting.steps(self.longest)
    }
}

/// A candidate that was run.
#[derive(Clone, Debug)]
struct Tried {
    method: &'static str,
    setting: Setting,
    error: f64,
    /// Processor time of stepping to the end, s.
    seconds: f64,
    /// Whether its run kept the balance, if its stepper should.
    keeps: bool,
}

/// Chooses. `ways` has the model compiled with its own settings.
///
/// # Errors
/// A wrong model, a model without continuous regions, a target that no setting meets.
pub fn choose(ask: &Ask, mut ways: Ways) -> Result<Chosen, Stop> {
    let begun = Instant::now();
    let without_error = ways.without_error();
    let progress = Progress::new();
    let every = (ask.rows.clone().count() / ROWS_COMPARED).max(1);
    let rows = || -> Box<dyn Iterator<Item = (f64, Look)> + '_> {
        let inside = ask.rows.clone().filter(|t| *t > 0.0 && *t < ask.stop * (1.0 - 1e-12)).enumerate();
        Box::new(inside.map(move |(i, t)| (t, if i % every == 0 { Look::Keep } else { Look::Pass })))
    };
    let task = Task {
        stop: ask.stop,
        longest: ask.longest,
        every: ask.every,
        given: ask.given,
        rows: &rows,
        shows: ask.shows,
        ledger: false,
        thresholds: ask.thresholds.bench,
    };
    let quantities = Quantities::new(&ways.base);
    let kernels = Kernels::new(ask.backend);
    if let Some(way) = &without_error {
        let runner = Runner::new(way, &task, &kernels);
        if let Some((tried, why)) = exact::choose(ask, &runner, &quantities) {
            let against = "itself with steps of half the length".to_string();
            return Ok(chosen(ask, way, &tried, why, against, begun));
        }
    }
    ways.add(ask.text, &ask.options, &|_: Method| true);
    let runners: Vec<Runner> = ways.list.iter().map(|w| Runner::new(w, &task, &kernels)).collect();
    let own = |r: &&Runner| match ask.method {
        Some(name) => r.way.name == name,
        None => r.way.passive && r.way.order > 0,
    };
    let candidates: Vec<&Runner> = runners.iter().filter(own).collect();
    if candidates.is_empty() {
        let name = ask.method.unwrap_or("that keeps the balance");
        return Err(Stop::Usage(format!("there is no stepper {name} to choose a step for")));
    }
    let target = match ask.target {
        Target::Error(e) => e / ask.thresholds.error.sharper,
        Target::Budget(_) => ask.thresholds.budget.sharp,
    };
    let search = Search {
        runners: &runners,
        quantities: &quantities,
        target,
        limit: ask.thresholds.bench.timing.limit,
        thresholds: ask.thresholds.bench.reference,
        progress: &|part| progress.at(0.5 * part),
    };
    let reference = search
        .find(ask.stop)
        .map_err(|why| Stop::Numerics(format!("no stepper gives a run to measure errors against: {why}")))?;
    progress.at(0.5);
    let (tried, why) = match ask.target {
        Target::Error(e) => error::choose(e, ask, &candidates, &reference, &progress)?,
        Target::Budget(t) => budget::choose(t, ask, &ways, &candidates, &reference, &progress)?,
    };
    let way = ways.list.iter().find(|w| w.name == tried.method);
    let way = way.ok_or_else(|| Stop::Usage("the method that was chosen is gone".into()))?;
    Ok(chosen(ask, way, &tried, why, reference.how.clone(), begun))
}

fn chosen(ask: &Ask, way: &Way, tried: &Tried, why: String, against: String, begun: Instant) -> Chosen {
    let setting = match tried.setting {
        Setting::Step(h) => Setting::Step(taken(&way.scene, h)),
        tolerance @ Setting::Tolerance(_) => tolerance,
    };
    Chosen {
        method: tried.method,
        setting,
        error: tried.error,
        why,
        against,
        took: begun.elapsed().as_secs_f64(),
        scene: way.scene.clone(),
        longest: ask.longest,
    }
}

/// The fixed step that is really taken for a given one, s: a whole number of steps lies between two samples if these
/// concern every continuous cluster.
fn taken(scene: &Scene, h: f64) -> f64 {
    let concerned = |i: usize| {
        let reads = |c: usize, other: usize| scene.clusters[c].foreign.iter().any(|f| f.0 == other);
        scene.bars.iter().any(|b| b.holder.0 == i || b.other.0 == i)
            || !scene.clusters[i].foreign.is_empty()
            || (0..scene.clusters.len()).any(|c| reads(c, i))
    };
    let mut clusters = scene.clusters.iter().enumerate();
    let free = clusters.any(|(i, c)| c.period.is_none() && !concerned(i));
    let mut periods = scene.clusters.iter().filter_map(|c| c.period);
    match periods.next() {
        Some(first) if !free && periods.all(|period| period == first) => first / (first / h - 1e-9).ceil().max(1.0),
        Some(_) | None => h,
    }
}

/// A run, its error and its cost.
fn attempt(runner: &Runner, setting: Setting, reference: &Reference, limit: f64) -> Result<Tried, crate::bench::Lost> {
    let run = runner.track(setting, limit)?;
    let error = crate::bench::Difference::new(&run, &reference.run, &reference.scales).anywhere();
    let keeps = !runner.way.passive || run.keeps();
    Ok(Tried { method: runner.way.name, setting, error, seconds: run.seconds, keeps })
}
