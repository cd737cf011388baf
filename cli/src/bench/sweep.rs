//! The points of a method, from coarse to fine, until finer settings bring nothing.

use super::point::{Point, measure};
use super::reference::Reference;
use super::setting::Setting;
use super::trial::{Lost, Runner};
/// Why a sweep ended early.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The error is that of the reference.
    Reference,
    /// Only rounding is left.
    Rounding,
}

/// What all sweeps share.
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
    /// This many steps in the run, and twice as many each time.
    Halved(f64),
    /// Tolerances from 1e-2 to 1e-12, two in a decade.
    Tightened,
}

impl Plan {
    /// Its settings, in words.
    pub fn words(&self) -> &'static str {
        match self {
            Plan::Given(_) => "as told",
            Plan::Halved(_) => "steps",
            Plan::Tightened => "tolerances",
        }
    }

    fn settings(&self, stop: f64, points: usize) -> Vec<Setting> {
        match self {
            Plan::Given(list) => list.clone(),
            Plan::Halved(n) => (0..points as i32).map(|k| Setting::Step(stop / (n * f64::from(k).exp2()))).collect(),
            Plan::Tightened => {
                let half = 10f64.sqrt();
                let decade = |k: i32| format!("1e-{k}").parse().unwrap_or(1e-12);
                (2..12).flat_map(|k| [decade(k), decade(k + 1) * half]).chain([1e-12]).map(Setting::Tolerance).collect()
            }
        }
    }
}

impl Sweep<'_> {
    /// Measures a method with each of the settings. `left` is its remaining time, s. Notes say what was skipped. Also
    /// returns why it ended early, if no note says so.
    pub fn run(
        &self,
        runner: &Runner,
        plan: &Plan,
        left: &mut f64,
        notes: &mut Vec<String>,
    ) -> (Vec<Point>, Option<Ended>) {
        let (way, limits) = (runner.way, runner.thresholds().sweep);
        let given = matches!(plan, Plan::Given(_));
        let mut points: Vec<Point> = Vec::new();
        let (mut floors, mut stale, mut failed, mut last_steps, mut best) = (0, 0, 0, 0, f64::INFINITY);
        let finer = if given { "and what follows" } else { "and finer" };
        // Time of the last two points, s.
        let mut took = (0.0, 0.0);
        for setting in plan.settings(self.stop, limits.points) {
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
                // Samples cut steps longer than a period: this would be the same run again.
                if m.steps == last_steps && matches!(setting, Setting::Step(_)) && !given {
                    points.pop();
                }
                last_steps = m.steps;
                floors = if m.floor { floors + 1 } else { 0 };
                // Past the best point, only rounding grows.
                let rounding = (limits.rounding)
                    .max(limits.rounding_per_step * m.steps as f64)
                    .max(limits.rounding_of_reference * self.reference.error);
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
            if failed >= limits.stale {
                notes.push(format!("{}, {} {finer}: skipped, {failed} in a row failed", way.name, setting.words()));
                break;
            }
            if floors >= limits.floors {
                return (points, Some(Ended::Reference));
            }
            if stale >= limits.stale {
                return (points, Some(Ended::Rounding));
            }
        }
        (points, None)
    }
}
