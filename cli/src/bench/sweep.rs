//! The points of a method: from coarse to fine, until nothing more can be learned.

use super::point::{Point, measure};
use super::reference::Reference;
use super::setting::Setting;
use super::trial::{Lost, Runner};

/// Points of a method and kind at most.
const POINTS: usize = 20;
/// So many points in a row that the reference cannot tell from itself are enough.
const FLOORS: usize = 2;
/// So many points in a row that fail, or are no better than those before where that is rounding, are enough.
const STALE: usize = 3;
/// Rounding is what errors do not fall below where they are less than this, or than so much for each step, or so many
/// times that of the reference. Where they lie higher, as about a kink, finer settings are what helps.
const ROUNDING: (f64, f64, f64) = (1e-10, 1e-15, 100.0);

/// Why a row ended before its settings did.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The reference tells no more.
    Reference,
    /// Rounding is all that is left.
    Rounding,
}

/// What a method is measured with.
pub struct Sweep<'a> {
    /// What errors are measured against.
    pub reference: &'a Reference,
    /// Readings of the time of a point.
    pub repeat: usize,
    /// Processor time for a method, s.
    pub limit: f64,
    /// End of the run, s.
    pub stop: f64,
}

/// The settings of a kind, from coarse to fine.
pub enum Plan {
    /// These, all of them.
    Given(Vec<Setting>),
    /// So many steps in the run, and each time twice as many.
    Halved(f64),
    /// Tolerances from 1e-2 to 1e-12, two in a decade.
    Tightened,
}

impl Plan {
    /// What its settings are.
    pub fn words(&self) -> &'static str {
        match self {
            Plan::Given(_) => "as told",
            Plan::Halved(_) => "steps",
            Plan::Tightened => "tolerances",
        }
    }

    fn settings(&self, stop: f64) -> Vec<Setting> {
        match self {
            Plan::Given(list) => list.clone(),
            Plan::Halved(n) => (0..POINTS as i32).map(|k| Setting::Step(stop / (n * f64::from(k).exp2()))).collect(),
            Plan::Tightened => {
                let half = 10f64.sqrt();
                let decade = |k: i32| format!("1e-{k}").parse().unwrap_or(1e-12);
                (2..12).flat_map(|k| [decade(k), decade(k + 1) * half]).chain([1e-12]).map(Setting::Tolerance).collect()
            }
        }
    }
}

impl Sweep<'_> {
    /// Measures a method with each of the settings. `left` is what is left of its time, s. Notes say what was skipped.
    /// Gives also why it ended early, where that is all that is to be said.
    pub fn run(
        &self,
        runner: &Runner,
        plan: &Plan,
        left: &mut f64,
        notes: &mut Vec<String>,
    ) -> (Vec<Point>, Option<Ended>) {
        let way = runner.way;
        let given = matches!(plan, Plan::Given(_));
        let mut points: Vec<Point> = Vec::new();
        let (mut floors, mut stale, mut failed, mut last_steps, mut best) = (0, 0, 0, 0, f64::INFINITY);
        let finer = if given { "and what follows" } else { "and finer" };
        // What the last two points took.
        let mut took = (0.0, 0.0);
        for setting in plan.settings(self.stop) {
            let growth = if took.1 > 0.0 && took.0 > took.1 { f64::min(took.0 / took.1, 4.0) } else { 1.0 };
            let skip = |notes: &mut Vec<String>| {
                notes.push(format!(
                    "{}, {} {finer}: skipped, it would take more than the {} s of --limit",
                    way.name,
                    setting.words(),
                    self.limit
                ));
            };
            if took.0 * growth > *left {
                skip(notes);
                break;
            }
            let begun = runner.spent();
            let result = measure(runner, setting, self.reference, self.repeat, *left);
            took = (runner.spent() - begun, took.0);
            *left -= took.0;
            let result = match result {
                Ok(m) => Ok(m),
                Err(Lost::Failed(why)) => Err(why),
                Err(Lost::Late) => {
                    skip(notes);
                    break;
                }
            };
            if let Ok(m) = &result {
                // Samples cut steps that are longer than a period: that would be the same run once more.
                if m.steps == last_steps && matches!(setting, Setting::Step(_)) && !given {
                    points.pop();
                }
                last_steps = m.steps;
                floors = if m.floor { floors + 1 } else { 0 };
                // Past its best, rounding is all that grows.
                let (least, step, reference) = ROUNDING;
                let rounding = least.max(step * m.steps as f64).max(reference * self.reference.error);
                stale = if m.worst() < 0.7 * best { 0 } else { stale + usize::from(best < rounding) };
                best = best.min(m.worst());
                failed = 0;
            } else if points.iter().any(|p| p.result.is_ok()) {
                failed += 1;
            }
            points.push(Point {
                method: way.name,
                order: way.order,
                passive: way.passive,
                setting,
                result,
                front: false,
            });
            if given {
                continue;
            }
            if failed >= STALE {
                notes.push(format!("{}, {} {finer}: skipped, {failed} in a row failed", way.name, setting.words()));
                break;
            }
            if floors >= FLOORS {
                return (points, Some(Ended::Reference));
            }
            if stale >= STALE {
                return (points, Some(Ended::Rounding));
            }
        }
        (points, None)
    }
}
