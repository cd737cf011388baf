//! Points between those of the sweeps that just meet a decade of error, if they could be the cheapest.

use super::front::{LARGEST_USEFUL_ERROR, decades, met};
use super::point::{Point, measure, takes};
use super::setting::Setting;
use super::sweep::Sweep;
use super::thresholds::RefineThresholds;
use super::trial::{Lost, Runner};

/// A setting between two neighbours, of which only the finer meets a decade.
struct Guess {
    /// Place of the finer one.
    before: usize,
    /// The setting that should meet it too.
    setting: Setting,
    /// Its predicted time, s.
    seconds: f64,
}

/// Adds points, decade by decade, between those of the sweeps: always the one that is predicted to be the cheapest that
/// meets the decade, as long as the prediction is a tenth below the cheapest measured point. `left` is the remaining
/// time of each runner's method, s. Notes say what was skipped.
pub fn refine(
    sweep: &Sweep,
    runners: &[Runner],
    points: &mut Vec<Point>,
    left: &mut [f64],
    notes: &mut Vec<String>,
    progress: &dyn Fn(f64),
) {
    let limits = runners.first().map(|r| r.thresholds().refine).unwrap_or_default();
    let mut late = vec![false; runners.len()];
    let of = |p: &Point| runners.iter().position(|r| r.way.name == p.method);
    let list = decades(points, sweep.reference.error);
    for (k, decade) in list.iter().enumerate() {
        progress(k as f64 / list.len() as f64);
        for passive in [true, false] {
            for _ in 0..limits.tries {
                let open = |p: &Point| (!passive || p.keeps()) && of(p).is_some_and(|i| !late[i]);
                let Some(guess) = best(points, (*decade, &limits), sweep, passive, &open) else { break };
                let fine = &points[guess.before];
                let Some(i) = of(fine) else { break };
                let (runner, setting) = (&runners[i], guess.setting);
                let begun = runner.spent();
                let result = if takes(guess.seconds, sweep.repeat, &runner.thresholds().timing) > left[i] {
                    Err(Lost::Late)
                } else {
                    measure(runner, setting, sweep.reference, sweep.repeat, left[i])
                };
                left[i] -= runner.spent() - begun;
                let result = match result {
                    Ok(m) => Ok(m),
                    Err(Lost::Failed(why)) => Err(why),
                    Err(Lost::Late) => {
                        late[i] = true;
                        notes.push(format!(
                            "{}, {}, between two points for {decade:e}, and others like it: skipped, they would take more than the \
                             {} s of --limit",
                            runner.way.name,
                            setting.words(),
                            sweep.limit
                        ));
                        continue;
                    }
                };
                points.insert(guess.before, Point { setting, result, front: false, ..fine.clone() });
            }
        }
    }
}

/// The guess that is predicted to be the cheapest, if it is worth measuring.
fn best(
    points: &[Point],
    (decade, limits): (f64, &RefineThresholds),
    sweep: &Sweep,
    passive: bool,
    open: &dyn Fn(&Point) -> bool,
) -> Option<Guess> {
    let meets = |p: &Point| met(p, sweep.reference.error).filter(|(e, _)| *e <= decade);
    let own = points.iter().filter(|p| !passive || p.keeps());
    let cheapest = own.filter_map(|p| meets(p).map(|m| m.1)).fold(f64::INFINITY, f64::min);
    let pairs = (1..points.len()).filter(|i| open(&points[*i]));
    let guesses = pairs.filter_map(|i| {
        let (setting, seconds) =
            between(&points[i - 1], &points[i], (decade, limits.aim * decade), sweep.reference.error, sweep.stop)?;
        Some(Guess { before: i, setting, seconds })
    });
    let first = guesses.min_by(|a, b| a.seconds.total_cmp(&b.seconds))?;
    (first.seconds <= limits.worth * cheapest).then_some(first)
}

/// The setting that should just meet a decade, between a point that meets it and its coarser neighbour that does not,
/// and its time, s. Errors and times are taken as powers of the step or tolerance.
fn between(
    coarse: &Point,
    fine: &Point,
    (decade, aim): (f64, f64),
    reference: f64,
    stop: f64,
) -> Option<(Setting, f64)> {
    let (error, seconds) = met(fine, reference).filter(|(e, _)| *e <= decade)?;
    if coarse.method != fine.method {
        return None;
    }
    // A run that failed, or is far off, only shows that it is too coarse: then take the middle.
    let (part, long) = match met(coarse, reference).filter(|(e, _)| *e < LARGEST_USEFUL_ERROR) {
        Some((e, _)) if e <= decade => return None,
        Some((e, s)) => ((e / aim).ln() / (e / error).ln(), s),
        None => (0.5, 0.5 * seconds),
    };
    let mean = |a: f64, b: f64| a.powf(1.0 - part) * b.powf(part);
    let setting = match (coarse.setting, fine.setting) {
        (Setting::Step(a), Setting::Step(b)) => {
            let (least, most) = ((stop / a).round() + 1.0, (stop / b).round() - 1.0);
            let n = (stop / mean(a, b)).ceil().clamp(least, most.max(least));
            (n <= most).then(|| Setting::Step(stop / n))?
        }
        // As many digits as the table shows.
        (Setting::Tolerance(a), Setting::Tolerance(b)) => {
            Setting::Tolerance(format!("{:.2e}", mean(a, b)).parse().ok()?)
        }
        (Setting::Step(_), Setting::Tolerance(_)) | (Setting::Tolerance(_), Setting::Step(_)) => return None,
    };
    (part < 1.0).then(|| (setting, mean(long, seconds)))
}

#[cfg(test)]
mod tests {
    use super::super::norm::Difference;
    use super::super::point::Measured;
    use super::*;

    fn between(coarse: &Point, fine: &Point, decade: f64, reference: f64, stop: f64) -> Option<(Setting, f64)> {
        super::between(coarse, fine, (decade, RefineThresholds::default().aim * decade), reference, stop)
    }

    fn point(method: &'static str, setting: Setting, error: f64, seconds: f64) -> Point {
        let measured = Measured {
            difference: Difference { end: vec![error], along: vec![error] },
            error,
            floor: false,
            drift: 0.0,
            balance: 0.0,
            steps: 1,
            iterations: 0,
            seconds,
        };
        Point { method, order: 2, passive: true, setting, result: Ok(measured), front: false }
    }

    fn steps(n: f64, error: f64, seconds: f64) -> Point {
        point("gonzalez", Setting::Step(1.0 / n), error, seconds)
    }

    #[test]
    fn errors_are_taken_for_powers() {
        // Second order, and time as the number of steps: an error of 0.8e-4 takes sqrt(1e-2 / 0.8e-4) times 10 steps.
        let (coarse, fine) = (steps(10.0, 1e-2, 1.0), steps(160.0, 1e-2 / 256.0, 16.0));
        let (setting, seconds) = between(&coarse, &fine, 1e-4, 1e-15, 1.0).unwrap();
        assert_eq!(setting, Setting::Step(1.0 / 112.0));
        assert!((seconds - 125f64.sqrt()).abs() < 1e-9, "{seconds}");
        // What meets it both, neither, or hardly, has nothing between.
        assert_eq!(between(&coarse, &fine, 1e-1, 1e-15, 1.0), None);
        assert_eq!(between(&coarse, &fine, 1e-5, 1e-15, 1.0), None);
        assert_eq!(between(&coarse, &fine, 4e-5, 1e-15, 1.0), None);
        // Nor is there a number of steps between two that follow each other.
        assert_eq!(between(&steps(10.0, 1e-2, 1.0), &steps(11.0, 1e-6, 1.1), 1e-4, 1e-15, 1.0), None);
        // Tolerances have the digits that are printed; points of other lines do not count.
        let rough = point("gonzalez", Setting::Tolerance(1e-4), 1e-3, 1.0);
        let good = point("gonzalez", Setting::Tolerance(1e-6), 1e-5, 4.0);
        let (setting, _) = between(&rough, &good, 1e-4, 1e-15, 1.0).unwrap();
        assert_eq!(setting, Setting::Tolerance(8e-6));
        assert_eq!(between(&coarse, &good, 1e-4, 1e-15, 1.0), None);
        assert_eq!(between(&point("sav", Setting::Tolerance(1e-4), 1e-3, 1.0), &good, 1e-4, 1e-15, 1.0), None);
    }

    #[test]
    fn what_failed_is_too_coarse() {
        let fine = steps(40.0, 1e-5, 4.0);
        let failed = Point { result: Err("no".into()), ..steps(10.0, 0.0, 0.0) };
        let middle = (Setting::Step(1.0 / 20.0), 4.0 * 0.5f64.sqrt());
        for coarse in [failed, steps(10.0, 1e9, 1.0)] {
            let found = between(&coarse, &fine, 1e-4, 1e-15, 1.0);
            let Some((setting, seconds)) = found else { panic!("a point between") };
            assert_eq!(setting, middle.0);
            assert!((seconds - middle.1).abs() < 1e-12);
        }
    }
}
