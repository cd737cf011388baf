//! One run of a scene, and its results.

use super::clock;
use super::kernels::{Guard, Guarded, Kernels};
use super::setting::Setting;
use super::thresholds::Thresholds;
use super::way::Way;
use bond::internal::{SimulationInternals, StepsInternals};
use bond::{InputSignal, RunError, Simulation, Summary};
use bond_compiler::model::Settings;
use bond_runtime::kernel::Backend;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{KEPT, Options};
use std::cell::Cell;

/// What all runs of a comparison have in common.
pub struct Task<'a> {
    /// End, s.
    pub stop: f64,
    /// Longest adaptive step, s, if given.
    pub longest: Option<f64>,
    /// Distance of the rows, s, if given.
    pub every: Option<f64>,
    /// Signals from outside.
    pub given: &'a [(String, InputSignal)],
    /// Instants of the way, s, in order.
    pub rows: &'a dyn Fn() -> Box<dyn Iterator<Item = (f64, Look)> + 'a>,
    /// Looking at probes is part of the work, and its time counts.
    pub shows: bool,
    /// The ledger is read at the rows that are kept, and not at the end alone.
    pub ledger: bool,
    /// The numbers by which the comparison decides.
    pub thresholds: Thresholds,
}

/// What is done at a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// The run comes by.
    Pass,
    /// Its probes are kept.
    Keep,
}

impl Task<'_> {
    /// The runtime's options.
    ///
    /// # Errors
    /// A number that makes no sense.
    pub fn options(&self, setting: Setting) -> Result<Options, RunError> {
        setting.steps(self.longest).resolve(&Settings::default(), self.stop, self.every)
    }
}

/// A run that reached its end.
#[derive(Clone, Debug)]
pub struct Run {
    /// Probes, then energy and signal states, at the end.
    pub end: Vec<f64>,
    /// The probes at the rows that are looked at.
    pub rows: Vec<Vec<f64>>,
    /// The largest magnitude of each of `end` at the rows and the end.
    pub largest: Vec<f64>,
    /// The largest sum of residuals of a region's balance at a row, relative to its largest energy.
    pub drift: f64,
    /// The worst balance of a step of any region.
    pub balance: f64,
    /// The largest energy that a region held, or that went into it or was lost there, J, and its mean over the time, W.
    pub energy: f64,
    pub power: f64,
    /// Steps of continuous regions.
    pub steps: u64,
    /// Newton iterations in them.
    pub iterations: u64,
    /// Switches that were met.
    pub events: u64,
    /// Processor time of stepping, s.
    pub seconds: f64,
    /// Processor time of setting it up, s.
    pub made: f64,
}

impl Run {
    /// Whether no step was off its balance.
    pub fn keeps(&self) -> bool {
        self.balance <= KEPT
    }
}

/// Why a run gave nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum Lost {
    /// The numerics failed, or gave a value that is not a number.
    Failed(String),
    /// It exceeded its time.
    Late,
}

/// A way with its compiled programs.
pub struct Runner<'a> {
    /// What runs.
    pub way: &'a Way,
    task: &'a Task<'a>,
    kernels: &'a Kernels<'a>,
    spent: Cell<f64>,
}

impl<'a> Runner<'a> {
    /// What is not among the kernels is compiled for the first run.
    pub fn new(way: &'a Way, task: &'a Task<'a>, kernels: &'a Kernels<'a>) -> Self {
        Self { way, task, kernels, spent: Cell::new(0.0) }
    }

    /// The numbers by which the comparison decides.
    pub fn thresholds(&self) -> &Thresholds {
        &self.task.thresholds
    }

    /// Processor time of its runs until now, s; without that of making code and of setting them up, which is the same
    /// for all settings.
    pub fn spent(&self) -> f64 {
        self.spent.get()
    }

    /// Does what runs, and counts its time.
    fn counted<T>(&self, run: impl FnOnce() -> T) -> T {
        let begun = clock::now();
        let result = run();
        self.spent.set(self.spent.get() + clock::now() - begun);
        result
    }

    fn start(&self, backend: &dyn Backend, setting: Setting) -> Result<Simulation<'a>, RunError> {
        let given = self.task.given.iter().cloned();
        let options = self.task.options(setting)?;
        Simulation::on(backend, &self.way.scene, &options, given)
    }

    /// Runs once through the rows, for `limit` seconds at most.
    ///
    /// # Errors
    /// A run that fails or takes too long.
    pub fn track(&self, setting: Setting, limit: f64) -> Result<Run, Lost> {
        let guard = Guard::new();
        let result = self.start(&Guarded(self.kernels, guard.clone()), setting);
        guard.begin(limit);
        let result = result.and_then(|sim| self.counted(|| self.tracked(sim)));
        if guard.late() { Err(Lost::Late) } else { result.map_err(|e| Lost::Failed(e.to_string())).and_then(sound) }
    }

    fn tracked(&self, mut sim: Simulation<'_>) -> Result<Run, RunError> {
        let shown = self.way.scene.probes.names.len();
        let (mut rows, mut largest, mut drift) = (Vec::new(), Vec::new(), 0.0);
        let begun = clock::now();
        let mut watching = 0.0;
        for (t, look) in (self.task.rows)() {
            sim.advance(t)?;
            if self.task.shows {
                sim.probes()?;
            }
            if look == Look::Keep {
                let from = clock::now();
                let values = sim.probes()?[..shown].to_vec();
                if self.task.ledger {
                    drift = f64::max(drift, drifted(&sim.summary()));
                }
                enlarge(&mut largest, &quantities(&values, &sim));
                rows.push(values);
                watching += clock::now() - from;
            }
        }
        finish(&mut sim, self.task.stop)?;
        let seconds = clock::now() - begun - watching;
        let end = sim.probes()?[..shown].to_vec();
        let end = quantities(&end, &sim);
        enlarge(&mut largest, &end);
        let summary = sim.summary();
        let (steps, iterations, events) = counts(&summary, &self.way.scene);
        let drift = f64::max(drift, drifted(&summary));
        let ((energy, power), balance) = (turned(&summary), balance(&summary));
        Ok(Run { end, rows, largest, drift, balance, energy, power, steps, iterations, events, seconds, made: 0.0 })
    }

    /// Runs once without a row on the way, as often as asked in one reading, and takes the time of one.
    ///
    /// # Errors
    /// A run that fails.
    pub fn plain(&self, setting: Setting, times: usize) -> Result<Run, Lost> {
        self.plainly(setting, times).map_err(|e| Lost::Failed(e.to_string())).and_then(sound)
    }

    fn plainly(&self, setting: Setting, times: usize) -> Result<Run, RunError> {
        let begun = clock::now();
        let sims = (0..times.max(1)).map(|_| self.start(self.kernels, setting));
        let mut sims = sims.collect::<Result<Vec<_>, _>>()?;
        let made = (clock::now() - begun) / sims.len() as f64;
        let begun = clock::now();
        self.counted(|| sims.iter_mut().try_for_each(|sim| finish(sim, self.task.stop)))?;
        let seconds = (clock::now() - begun) / sims.len() as f64;
        let shown = self.way.scene.probes.names.len();
        let sim = &mut sims[0];
        let end = sim.probes()?[..shown].to_vec();
        let end = quantities(&end, sim);
        let summary = sim.summary();
        let (steps, iterations, events) = counts(&summary, &self.way.scene);
        let largest = end.iter().map(|x| x.abs()).collect();
        let (drift, balance, (energy, power)) = (drifted(&summary), balance(&summary), turned(&summary));
        Ok(Run {
            end,
            rows: Vec::new(),
            largest,
            drift,
            balance,
            energy,
            power,
            steps,
            iterations,
            events,
            seconds,
            made,
        })
    }
}

/// Runs to the end, all of it.
fn finish(sim: &mut Simulation<'_>, stop: f64) -> Result<(), RunError> {
    if sim.time() <= stop {
        sim.advance(stop)?;
        sim.finish(stop)?;
    }
    Ok(())
}

/// A run whose numbers are numbers.
fn sound(run: Run) -> Result<Run, Lost> {
    let rows = || run.rows.iter().flatten();
    if run.end.iter().chain(rows()).all(|x| x.is_finite()) {
        return Ok(run);
    }
    Err(Lost::Failed("a value is not a finite number".into()))
}

/// Probes, then states.
fn quantities(probes: &[f64], sim: &Simulation<'_>) -> Vec<f64> {
    probes.iter().copied().chain(sim.states().map(|s| s.1)).collect()
}

fn enlarge(largest: &mut Vec<f64>, values: &[f64]) {
    largest.resize(values.len(), 0.0);
    for (l, x) in largest.iter_mut().zip(values) {
        *l = l.max(x.abs());
    }
}

fn drifted(s: &Summary) -> f64 {
    s.regions.iter().map(|r| r.total).fold(0.0, f64::max)
}

fn balance(s: &Summary) -> f64 {
    s.regions.iter().map(|r| r.worst_step).fold(0.0, f64::max)
}

fn turned(s: &Summary) -> (f64, f64) {
    let of = s.regions.iter().flat_map(|r| [r.h_max, r.supplied.abs(), r.dissipated.abs()]);
    let energy = of.fold(0.0, f64::max);
    (energy, if s.time > 0.0 { energy / s.time } else { 0.0 })
}

/// Steps, Newton iterations and events of continuous clusters; each region reports those of its cluster.
fn counts(s: &Summary, scene: &Scene) -> (u64, u64, u64) {
    let mut seen = vec![false; scene.clusters.len()];
    let (mut steps, mut iterations, mut events) = (0, 0, 0);
    for (r, region) in s.regions.iter().zip(&scene.regions) {
        if r.period.is_none() && !std::mem::replace(&mut seen[region.cluster], true) {
            steps += r.steps;
            iterations += r.newton_iterations;
            events += r.events;
        }
    }
    (steps, iterations, events)
}
