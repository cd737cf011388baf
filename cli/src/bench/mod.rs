//! Speed against error: every stepper that a model can take, over a range of steps and tolerances, compared with a
//! reference.

pub mod clock;
mod extrapolate;
mod front;
mod json;
mod kernels;
mod norm;
mod picture;
mod point;
mod reference;
mod refine;
mod setting;
mod sweep;
mod table;
mod thresholds;
mod trial;
mod way;

pub use json::json;
pub use kernels::Kernels;
pub use norm::{Difference, Quantities};
pub use picture::picture;
pub use point::{Point, timed};
pub use reference::{Reference, Search};
pub use setting::{Setting, time};
pub use sweep::Plan;
pub use table::text;
pub use thresholds::Thresholds;
pub use trial::{Look, Lost, Run, Runner, Task};
pub use way::{Way, Ways};

use bond::InputSignal;
use bond::internal::CompiledInternals;
use bond_runtime::kernel::Backend;
use sweep::{Ended, Sweep};

/// Rows at which runs are compared before their end.
const ROWS_COMPARED: u32 = 32;
/// The longest adaptive step, as a part of the run.
const LONGEST_PART: f64 = 0.1;

/// A request for a comparison.
pub struct Setup<'a> {
    /// End of the run, s.
    pub stop: f64,
    /// The longest adaptive step, s, if given.
    pub longest: Option<f64>,
    /// Fixed steps, if given, s.
    pub steps: Vec<f64>,
    /// Tolerances, if given.
    pub tolerances: Vec<f64>,
    /// Signals from outside.
    pub given: Vec<(String, InputSignal)>,
    /// Readings of the time of a point.
    pub repeat: usize,
    /// Processor time for a method, s.
    pub limit: f64,
    /// What runs the programs.
    pub backend: &'a dyn Backend,
    /// The numbers by which it decides.
    pub thresholds: Thresholds,
}

/// The result of a comparison.
pub struct Bench {
    /// Name of the model.
    pub model: String,
    /// What the figures are called: the name of the file.
    pub problem: String,
    /// End of the run, s.
    pub stop: f64,
    /// What is compared.
    pub quantities: Quantities,
    /// What errors are measured against.
    pub reference: Reference,
    /// The points, by method.
    pub points: Vec<Point>,
    /// What was left out or skipped, and why.
    pub notes: Vec<String>,
}

/// Compares the ways.
///
/// # Errors
/// In words, if there is no reference.
pub fn bench(ways: &Ways, problem: &str, setup: &Setup, progress: &dyn Fn(f64)) -> Result<Bench, String> {
    let stop = setup.stop;
    let rows = || -> Box<dyn Iterator<Item = (f64, Look)>> {
        Box::new((1..ROWS_COMPARED).map(move |k| (stop * f64::from(k) / f64::from(ROWS_COMPARED), Look::Keep)))
    };
    let longest = setup.longest.unwrap_or(LONGEST_PART * setup.stop);
    let task = Task {
        stop,
        longest: Some(longest),
        every: None,
        given: &setup.given,
        rows: &rows,
        shows: false,
        ledger: true,
        thresholds: setup.thresholds,
    };
    let kernels = Kernels::new(setup.backend);
    let runners: Vec<Runner> = ways.list.iter().map(|w| Runner::new(w, &task, &kernels)).collect();
    let quantities = Quantities::new(&ways.base);
    let search = Search {
        runners: &runners,
        quantities: &quantities,
        target: 0.0,
        limit: setup.limit,
        thresholds: setup.thresholds.reference,
        progress: &|part| progress(0.3 * part),
    };
    let reference = search.find(setup.stop)?;
    let mut notes: Vec<String> = ways.left_out.iter().map(|l| format!("{}: left out, {}", l.name, l.why)).collect();
    if reference.error > 1e-3 {
        notes.push(format!(
            "the reference does not converge (it is known to {:.0e}): the run is chaotic, or too stiff for every \
            stepper; a shorter --stop may help",
            reference.error
        ));
    }
    let asked = !setup.steps.is_empty() || !setup.tolerances.is_empty();
    let coarsest =
        (setup.stop / (setup.thresholds.sweep.coarsest * rough(runners.iter(), setup.stop))).floor().max(1.0);
    let sweep = Sweep { reference: &reference, repeat: setup.repeat, limit: setup.limit, stop: setup.stop };
    let mut points = Vec::new();
    // Remaining time of each method after its sweeps.
    let mut rest = Vec::new();
    let mut ended = Vec::new();
    for (i, runner) in runners.iter().enumerate() {
        progress(0.3 + 0.6 * i as f64 / runners.len() as f64);
        let kept = if asked { 0.0 } else { setup.thresholds.refine.part * setup.limit };
        let mut left = setup.limit - kept;
        let mut plans = Vec::new();
        if asked {
            plans.push(Plan::Given(setup.steps.iter().copied().map(Setting::Step).collect()));
            if runner.way.adaptive {
                plans.push(Plan::Given(setup.tolerances.iter().copied().map(Setting::Tolerance).collect()));
            } else if !setup.tolerances.is_empty() {
                notes.push(format!("{}: no tolerance has an effect on it", runner.way.name));
            }
        } else {
            plans.push(Plan::Halved(if runner.way.adaptive { coarsest } else { 1.0 }));
            if runner.way.adaptive {
                plans.push(Plan::Tightened);
            }
        }
        let share = left / plans.len().max(1) as f64;
        for (k, plan) in plans.iter().enumerate() {
            // The second kind gets what the first leaves of its half.
            let mut own = if k + 1 == plans.len() { left } else { share };
            let before = own;
            let (row, why) = sweep.run(runner, plan, &mut own, &mut notes);
            points.extend(row);
            ended.extend(why.map(|why| (why, format!("{} ({})", runner.way.name, plan.words()))));
            left -= before - own;
        }
        rest.push(left.max(0.0) + kept);
    }
    for (why, what) in [(Ended::Reference, "end at the error of the reference"), (Ended::Rounding, "end at rounding")] {
        let rows: Vec<&str> = ended.iter().filter(|e| e.0 == why).map(|e| e.1.as_str()).collect();
        if !rows.is_empty() {
            notes.push(format!("{} {what}", rows.join(", ")));
        }
    }
    if !asked {
        let progress = |part| progress(0.9 + 0.1 * part);
        refine::refine(&sweep, &runners, &mut points, &mut rest, &mut notes, &progress);
    }
    front::mark(&mut points, reference.error);
    Ok(Bench {
        model: ways.base.scene().name.clone(),
        problem: problem.to_string(),
        stop: setup.stop,
        quantities,
        reference,
        points,
        notes,
    })
}

/// The mean step of a rough adaptive run, s; a hundredth of the run if there is none.
pub fn rough<'r, 'a: 'r>(runners: impl Iterator<Item = &'r Runner<'a>>, stop: f64) -> f64 {
    let mut fitted: Vec<&Runner> = runners.filter(|r| r.way.adaptive).collect();
    // Implicit methods first: stability does not limit their steps.
    fitted.sort_by_key(|r| (!r.way.passive, r.way.order));
    let runs = fitted.iter().filter_map(|r| r.track(Setting::Tolerance(r.thresholds().sweep.rough), 2.0).ok());
    let steps = runs.map(|run| run.steps).find(|s| *s > 0);
    steps.map_or(stop / 100.0, |s| stop / s as f64)
}
