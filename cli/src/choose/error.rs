//! Finds the cheapest stepper for an error: for each, the coarsest setting that meets it.

use super::thresholds::ErrorThresholds;
use super::{Ask, Tried, attempt};
use crate::bench::{Lost, Reference, Runner, Setting, rough};
use crate::progress::Progress;
use crate::stop::Stop;

/// Chooses.
///
/// # Errors
/// An error that no setting meets, or that cannot be measured.
pub fn choose(
    error: f64,
    ask: &Ask,
    candidates: &[&Runner],
    reference: &Reference,
    progress: &Progress,
) -> Result<(Tried, String), Stop> {
    let limits = &ask.thresholds.error;
    if reference.error > limits.window[2] * error {
        let why = match &reference.failed {
            Some(why) => format!("adaptive steps fail ({why})"),
            None => "the scene may be chaotic, or have jumps that no step meets".to_string(),
        };
        return Err(Stop::Numerics(format!(
            "an error of {error:e} cannot be measured: the best run ({}) is itself known to {:.0e}; {why}; allow a \
            larger error, or give a shorter --stop",
            reference.how, reference.error
        )));
    }
    let mut order: Vec<&Runner> = candidates.to_vec();
    // An order of about 1.2 per digit is usually the cheapest.
    let fit = -1.2 * error.log10();
    order.sort_by(|a, b| {
        let far = |r: &Runner| (f64::from(r.way.order) - fit).abs();
        far(a).total_cmp(&far(b))
    });
    let first = rough(candidates.iter().copied(), ask.stop);
    let (mut best, mut tries): (Option<Tried>, usize) = (None, 0);
    // No run may take longer than the reference. If nothing meets the error so, because the reference was extrapolated
    // from long steps, each may take the most.
    let times = [reference.run.seconds.max(limits.least_time), ask.thresholds.bench.timing.limit];
    for (pass, dear) in times.into_iter().enumerate() {
        let mut late = false;
        for (i, runner) in order.iter().enumerate() {
            progress.at(0.5 + 0.25 * (pass as f64 + i as f64 / order.len() as f64));
            let mut starts = vec![Setting::Step(first)];
            if runner.way.adaptive {
                starts.push(Setting::Tolerance((0.1 * error).max(1e-14)));
            }
            for start in starts {
                let seek = Seek { runner, reference, limits, error, stop: ask.stop, dear };
                let found = seek.run(start, best.as_ref(), (&mut tries, &mut late));
                if let Some(found) = found
                    && best.as_ref().is_none_or(|b| better(&found, b, limits.window[0] * error))
                {
                    best = Some(found);
                }
            }
        }
        if best.is_some() || !late {
            break;
        }
    }
    let Some(best) = best else {
        let names: Vec<&str> = order.iter().map(|r| r.way.name).collect();
        return Err(Stop::Numerics(format!(
            "no setting of {} has an error below {error:e}; allow a larger error, or give a shorter --stop",
            names.join(", ")
        )));
    };
    let of = match ask.method {
        Some(_) => "the coarsest that was found for it".to_string(),
        None => format!("the cheapest that was found of {} that keep the balance, in {tries} runs", candidates.len()),
    };
    let below = if best.error < limits.window[0] * error { "; no coarser setting is as cheap" } else { "" };
    Ok((best, format!("{of}, for an error below {error:e}{below}")))
}

/// Whether one is preferred to another: one whose error is at least `low` to one that is far more exact, otherwise the
/// cheaper one.
fn better(a: &Tried, b: &Tried, low: f64) -> bool {
    let near = |t: &Tried| t.error >= low;
    if near(a) == near(b) { a.seconds < b.seconds } else { near(a) }
}

/// The search of a setting.
struct Seek<'s, 'a> {
    runner: &'s Runner<'a>,
    reference: &'s Reference,
    limits: &'s ErrorThresholds,
    error: f64,
    stop: f64,
    /// Time that a run may take while there is no result, s.
    dear: f64,
}

impl Seek<'_, '_> {
    /// Returns the coarsest setting found that meets the error. Counts the runs, and notes whether one took too long.
    fn run(&self, start: Setting, best: Option<&Tried>, (tries, late): (&mut usize, &mut bool)) -> Option<Tried> {
        let [low, middle, high] = self.limits.window.map(|w| w * self.error);
        let limit = best.map_or(self.dear, |b| (self.limits.slower * b.seconds).max(1e-3));
        // The error goes with the step to the power of the order, and with the tolerance itself.
        let power = match start {
            Setting::Step(_) => f64::from(self.runner.way.order.max(1)),
            Setting::Tolerance(_) => 1.0,
        };
        let (most, least) = match start {
            Setting::Step(_) => (self.stop, self.stop * 1e-9),
            Setting::Tolerance(_) => (0.3, 1e-14),
        };
        let mut setting = start.with(start.value().clamp(least, most));
        let mut coarse: Option<(f64, f64)> = None; // setting and error too large
        let mut fine: Option<Tried> = None;
        for _ in 0..self.limits.runs {
            *tries += 1;
            let x = setting.value();
            let result = attempt(self.runner, setting, self.reference, limit);
            let error = match &result {
                Ok(tried) if tried.keeps => tried.error.max(1e-17),
                Ok(_) | Err(Lost::Failed(_)) => f64::INFINITY,
                Err(Lost::Late) => {
                    *late = true;
                    return fine;
                }
            };
            let next = if error > high {
                if coarse.is_none_or(|c| x < c.0) {
                    coarse = Some((x, error));
                }
                x * (middle / error).powf(1.0 / power).clamp(0.02, 0.7)
            } else {
                if let Ok(tried) = result
                    && fine.as_ref().is_none_or(|f| x > f.setting.value())
                {
                    fine = Some(tried);
                }
                if error >= low || x >= most {
                    return fine;
                }
                x * (middle / error).powf(1.0 / power).clamp(1.4, 50.0)
            };
            let next = match (coarse, &fine) {
                (Some((c, e)), Some(f)) => {
                    let (a, b) = (f.setting.value().ln(), c.ln());
                    if b - a < 0.01 {
                        return fine;
                    }
                    let (ea, eb) = (f.error.max(1e-17).ln(), e.min(1e3).ln());
                    let part = ((middle.ln() - ea) / (eb - ea)).clamp(0.1, 0.9);
                    (a + part * (b - a)).exp()
                }
                _ => next,
            };
            setting = setting.with(next.clamp(least, most));
            if setting.value() == x {
                return fine;
            }
        }
        fine
    }
}
