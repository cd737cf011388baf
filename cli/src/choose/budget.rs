//! Finds the most exact stepper for a time: for each, the step is halved while the run fits.

use super::thresholds::BudgetThresholds;
use super::{Ask, Tried, attempt};
use crate::bench::{Reference, Runner, Setting, Ways, rough, time, timed};
use crate::progress::Progress;
use crate::stop::Stop;
use bond::internal::CompiledInternals;
use bond_runtime::scene::Scene;

/// Processor time that a run may take, s, from a budget per period of the fastest sampled region, or per simulated
/// second if nothing is sampled.
pub fn allowed(budget: f64, stop: f64, scene: &Scene, limits: &BudgetThresholds) -> f64 {
    limits.used * budget * stop / unit(scene)
}

/// The shortest period of a scene, s; 1 if nothing is sampled.
fn unit(scene: &Scene) -> f64 {
    scene.clusters.iter().filter_map(|c| c.period).min_by(f64::total_cmp).unwrap_or(1.0)
}

/// Chooses.
///
/// # Errors
/// A time that no stepper keeps.
pub fn choose(
    budget: f64,
    ask: &Ask,
    ways: &Ways,
    candidates: &[&Runner],
    reference: &Reference,
    progress: &Progress,
) -> Result<(Tried, String), Stop> {
    let scene = ways.base.scene();
    let limits = &ask.thresholds.budget;
    let allowed = allowed(budget, ask.stop, scene, limits);
    let first = limits.coarsest * rough(candidates.iter().copied(), ask.stop);
    let mut best: Option<Tried> = None;
    let mut cheapest: Option<Tried> = None;
    // High orders first: they find the smallest error.
    let mut in_turn = candidates.to_vec();
    in_turn.sort_by_key(|r| std::cmp::Reverse(r.way.order));
    for (i, runner) in in_turn.into_iter().enumerate() {
        progress.at(0.5 + 0.5 * i as f64 / candidates.len() as f64);
        for k in 0..limits.halvings {
            let setting = Setting::Step(first.min(ask.stop) / f64::from(k).exp2());
            // A candidate that fails or loses its balance with a long step may succeed with a shorter one; one that
            // takes too long only takes longer. Once one is as exact as the reference can measure, the others must be
            // faster.
            let floor = 10.0 * reference.error;
            let settled = best.as_ref().filter(|b| b.error <= floor).map(|b| b.seconds);
            let most = settled.map_or(allowed, |s| s.min(allowed));
            let mut tried = match attempt(runner, setting, reference, 4.0 * most + 0.01) {
                Ok(tried) if tried.keeps => tried,
                Ok(_) | Err(crate::bench::Lost::Failed(_)) => continue,
                Err(crate::bench::Lost::Late) => break,
            };
            // The cost of rows is not the stepper's.
            if tried.seconds < allowed.max(limits.rows)
                && let Ok((_, seconds)) =
                    timed(runner, setting, ask.thresholds.bench.timing.readings, allowed.max(limits.rows))
            {
                tried.seconds = seconds;
            }
            if cheapest.as_ref().is_none_or(|c| tried.seconds < c.seconds) {
                cheapest = Some(tried.clone());
            }
            if tried.seconds > allowed || settled.is_some_and(|s| tried.seconds > s) {
                break;
            }
            let place = |t: &Tried| (t.error.max(floor), t.seconds);
            let wins = |b: &Tried| {
                let ((e, s), (eb, sb)) = (place(&tried), place(b));
                e < eb || (e == eb && s < sb)
            };
            if best.as_ref().is_none_or(wins) {
                best = Some(tried.clone());
            }
            if tried.error <= floor {
                break;
            }
        }
    }
    let of = match scene.clusters.iter().any(|c| c.period.is_some()) {
        true => format!("a period of {}", time(unit(scene))),
        false => "a simulated second".to_string(),
    };
    match (best, cheapest) {
        (Some(tried), _) => {
            let cost = time(tried.seconds * unit(scene) / ask.stop);
            let among = match ask.method {
                Some(_) => "its most exact steps".to_string(),
                None => format!("the most exact of {} that keep the balance", candidates.len()),
            };
            let most = time(budget);
            let why = format!("{among} that take at most {most} for {of}: {cost} on average");
            Ok((tried, why))
        }
        (None, Some(c)) => Err(Stop::Numerics(format!(
            "no stepper takes at most {} for {of}; the cheapest found is {} with {}, which takes {}, and a third of \
            the time is kept in reserve",
            time(budget),
            c.method,
            c.setting.words(),
            time(c.seconds * unit(scene) / ask.stop)
        ))),
        (None, None) => Err(Stop::Numerics(format!(
            "no stepper reaches the end, keeps the balance and takes at most {} for {of}",
            time(budget)
        ))),
    }
}
