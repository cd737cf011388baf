//! The cheapest stepper for an error: of each, the coarsest setting that meets it is sought, and the cheapest taken.

use super::{Ask, Tried, attempt};
use crate::bench::{Lost, Reference, Runner, Setting, rough};
use crate::progress::Progress;
use crate::stop::Stop;

/// The reference is to be so much better than what is asked for.
pub const SHARPER: f64 = 50.0;
/// What a choice is to have, as parts of the error that is asked for: at least, at best, at most.
const WINDOW: [f64; 3] = [1.0 / 30.0, 1.0 / 6.0, 1.0 / 2.0];
/// Runs for each candidate.
const RUNS: usize = 10;
/// A candidate that takes so many times as long as the best so far is given up.
const LOST: f64 = 3.0;
/// No run may take longer than the reference, or than this, s, where that is more. Where nothing meets the error so
/// (the reference may be extrapolated from long steps), one may take so much.
const LEAST: f64 = 0.05;
const MOST: f64 = super::LIMIT;

/// Chooses.
///
/// # Errors
/// An error that nothing meets, or that cannot be told.
pub fn choose(
    error: f64,
    ask: &Ask,
    candidates: &[&Runner],
    reference: &Reference,
    progress: &Progress,
) -> Result<(Tried, String), Stop> {
    if reference.error > WINDOW[2] * error {
        let why = match &reference.failed {
            Some(why) => format!("steps fitted to a tolerance fail ({why})"),
            None => "the scene may be chaotic, or have jumps that no step meets".to_string(),
        };
        return Err(Stop::Numerics(format!(
            "an error of {error:e} cannot be told: the best run there is ({}) is known to {:.0e} itself; {why}; ask for less, or \
             for a shorter --stop",
            reference.how, reference.error
        )));
    }
    let mut order: Vec<&Runner> = candidates.to_vec();
    // So many digits ask for about that order.
    let fit = -1.2 * error.log10();
    order.sort_by(|a, b| {
        let far = |r: &Runner| (f64::from(r.way.order) - fit).abs();
        far(a).total_cmp(&far(b))
    });
    let first = rough(candidates.iter().copied(), ask.stop);
    let (mut best, mut tries): (Option<Tried>, usize) = (None, 0);
    for (pass, dear) in [reference.run.seconds.max(LEAST), MOST].into_iter().enumerate() {
        let mut late = false;
        for (i, runner) in order.iter().enumerate() {
            progress.at(0.5 + 0.25 * (pass as f64 + i as f64 / order.len() as f64));
            let mut starts = vec![Setting::Step(first)];
            if runner.way.adaptive {
                starts.push(Setting::Tolerance((0.1 * error).max(1e-14)));
            }
            for start in starts {
                let seek = Seek { runner, reference, error, stop: ask.stop, dear };
                let found = seek.run(start, best.as_ref(), (&mut tries, &mut late));
                if let Some(found) = found
                    && best.as_ref().is_none_or(|b| better(&found, b, error))
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
            "no setting of {} has an error below {error:e}; ask for less, or for a shorter --stop",
            names.join(", ")
        )));
    };
    let of = match ask.method {
        Some(_) => "the coarsest that was found for it".to_string(),
        None => format!("the cheapest that was found of {} that keep the balance, in {tries} runs", candidates.len()),
    };
    let below = if best.error < WINDOW[0] * error { "; nothing coarser that is that cheap" } else { "" };
    Ok((best, format!("{of}, for an error below {error:e}{below}")))
}

/// Whether one is to be taken rather than another: one that has about the error asked for goes before one that is far
/// better, else the cheaper.
fn better(a: &Tried, b: &Tried, error: f64) -> bool {
    let near = |t: &Tried| t.error >= WINDOW[0] * error;
    if near(a) == near(b) { a.seconds < b.seconds } else { near(a) }
}

/// The search of a setting.
struct Seek<'s, 'a> {
    runner: &'s Runner<'a>,
    reference: &'s Reference,
    error: f64,
    stop: f64,
    /// What a run may take while there is nothing better, s.
    dear: f64,
}

impl Seek<'_, '_> {
    /// The coarsest setting found whose error is at most that which is asked for; counts the runs, and says whether one
    /// took too long.
    fn run(&self, start: Setting, best: Option<&Tried>, (tries, late): (&mut usize, &mut bool)) -> Option<Tried> {
        let [low, middle, high] = WINDOW.map(|w| w * self.error);
        let limit = best.map_or(self.dear, |b| (LOST * b.seconds).max(1e-3));
        // How the error follows the setting: as the order of the step, as the tolerance itself.
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
        for _ in 0..RUNS {
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
