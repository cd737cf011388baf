//! The most exact stepper for a time: of each, steps are halved while they fit.

use super::{Ask, Tried, attempt};
use crate::bench::{Reference, Runner, Setting, Ways, rough, time, timed};
use crate::progress::Progress;
use crate::stop::Stop;
use bond_runtime::scene::Scene;

/// Errors below this are not told apart.
pub const SHARP: f64 = 1e-12;
/// What of the time is used, so that a slower moment does not break it.
const USED: f64 = 0.7;
/// The longest fixed step that is tried, in steps of a rough fitted run.
const LONG: f64 = 8.0;
/// Readings of the clock for each run that fits, and up to so long, s, with its rows, of runs that seem not to.
const READINGS: usize = 5;
const ROWS: f64 = 0.01;
/// Steps are halved so often at most.
const HALVINGS: i32 = 24;

/// Processor time that a run may take, s: for a period of the fastest sampled region, or for a simulated second, so
/// much.
pub fn allowed(budget: f64, stop: f64, scene: &Scene) -> f64 {
    USED * budget * stop / unit(scene)
}

/// The shortest period of a scene, s; 1 where there is none.
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
    let allowed = allowed(budget, ask.stop, scene);
    let first = LONG * rough(candidates.iter().copied(), ask.stop);
    let mut best: Option<Tried> = None;
    let mut cheapest: Option<Tried> = None;
    // Those of high order find first how exact it can be.
    let mut in_turn = candidates.to_vec();
    in_turn.sort_by_key(|r| std::cmp::Reverse(r.way.order));
    for (i, runner) in in_turn.into_iter().enumerate() {
        progress.at(0.5 + 0.5 * i as f64 / candidates.len() as f64);
        for k in 0..HALVINGS {
            let setting = Setting::Step(first.min(ask.stop) / f64::from(k).exp2());
            // What fails, gives no number or is off its balance at a long step may do at a shorter one; what takes too
            // long only takes longer.
            // Where one is as exact as can be told, the others have to be faster.
            let floor = 10.0 * reference.error;
            let settled = best.as_ref().filter(|b| b.error <= floor).map(|b| b.seconds);
            let most = settled.map_or(allowed, |s| s.min(allowed));
            let mut tried = match attempt(runner, setting, reference, 4.0 * most + 0.01) {
                Ok(tried) if tried.keeps => tried,
                Ok(_) | Err(crate::bench::Lost::Failed(_)) => continue,
                Err(crate::bench::Lost::Late) => break,
            };
            // What rows cost on the way is not the stepper's.
            if tried.seconds < allowed.max(ROWS)
                && let Ok((_, seconds)) = timed(runner, setting, READINGS, allowed.max(ROWS))
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
            "no stepper keeps to {} for {of}; the cheapest found is {} with {}, which takes {}, and a third of a time is kept in hand",
            time(budget),
            c.method,
            c.setting.words(),
            time(c.seconds * unit(scene) / ask.stop)
        ))),
        (None, None) => Err(Stop::Numerics(format!(
            "no stepper comes to the end with its balance kept within {} for {of}",
            time(budget)
        ))),
    }
}
