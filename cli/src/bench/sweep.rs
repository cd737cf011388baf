//! The points of a method: from coarse to fine, until nothing more can be learned.

use super::point::{Point, measure};
use super::reference::Reference;
use super::setting::Setting;
use super::trial::{Lost, Runner};

/// Points of a method and kind at most.
const POINTS: usize = 20;
/// So many points in a row that the reference cannot tell from itself are enough.
const FLOORS: usize = 2;

/// So many points in a row that fail, or are no better than those before, are enough.
const STALE: usize = 3;

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
    pub fn run(&self, runner: &Runner, plan: &Plan, left: &mut f64, notes: &mut Vec<String>) -> Vec<Point> {
        let way = runner.way;
        let given = matches!(plan, Plan::Given(_));
        let mut points: Vec<Point> = Vec::new();
        let (mut floors, mut stale, mut last_steps, mut best) = (0, 0, 0, f64::INFINITY);
        // What the last two points took.
        let mut took = (0.0, 0.0);
        for setting in plan.settings(self.stop) {
            let growth = if took.1 > 0.0 && took.0 > took.1 { f64::min(took.0 / took.1, 4.0) } else { 1.0 };
            let skip = |notes: &mut Vec<String>| {
                let finer = if given { "and what follows" } else { "and finer" };
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
            let begun = super::clock::now();
            let result = measure(runner, setting, self.reference, self.repeat, *left);
            took = (super::clock::now() - begun, took.0);
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
                stale = if m.error < 0.7 * best { 0 } else { stale + usize::from(best < 1e-6) };
                best = best.min(m.error);
            } else if !points.is_empty() && points.iter().any(|p| p.result.is_ok()) {
                stale += 1;
            }
            points.push(Point {
                method: way.name,
                order: way.order,
                passive: way.passive,
                setting,
                result,
                front: false,
            });
            if (floors >= FLOORS || stale >= STALE) && !given {
                break;
            }
        }
        points
    }
}
