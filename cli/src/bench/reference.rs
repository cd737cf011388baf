//! The reference: the run that changes least when its steps are shortened, checked by a second method.

use super::extrapolate::Tableau;
use super::norm::{Difference, Quantities};
use super::setting::Setting;
use super::thresholds::ReferenceThresholds;
use super::trial::{Lost, Run, Runner};
/// Most reasons that a message names.
const MAX_REASONS: usize = 3;

/// A run that others are measured against.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The run.
    pub run: Run,
    /// The size to which differences are relative, by quantity.
    pub scales: Vec<f64>,
    /// Its own error, as estimated, relative.
    pub error: f64,
    /// The method and setting, in words.
    pub how: String,
    /// Another method's run, in words, and its distance.
    pub checked: Option<(String, f64)>,
    /// Why an adaptive run failed, if one did.
    pub failed: Option<String>,
}

/// A candidate: its run, how much it changed when its steps were made shorter, and what it is.
struct Found {
    method: &'static str,
    run: Run,
    change: f64,
    how: String,
}

/// The search for a reference.
pub struct Search<'a> {
    /// The methods.
    pub runners: &'a [Runner<'a>],
    /// What is compared.
    pub quantities: &'a Quantities,
    /// The error that is good enough; 0 for the best that there is.
    pub target: f64,
    /// Processor time for each method, s.
    pub limit: f64,
    /// The numbers by which it decides.
    pub thresholds: ReferenceThresholds,
    /// Called with the finished part.
    pub progress: &'a dyn Fn(f64),
}

impl Search<'_> {
    /// Finds it.
    ///
    /// # Errors
    /// In words, if no method reaches the end with two settings.
    pub fn find(&self, stop: f64) -> Result<Reference, String> {
        let mut order: Vec<&Runner> = self.runners.iter().collect();
        // A method without error goes first, then the higher the order the better; keeps the balance before what
        // does not.
        let rank = |r: &Runner| if r.way.order == 0 { u32::MAX } else { r.way.order };
        order.sort_by_key(|r| (std::cmp::Reverse(rank(r)), !r.way.passive));
        let mut total = self.thresholds.methods * self.limit;
        let mut found: Vec<Found> = Vec::new();
        let mut why: Vec<(String, Vec<&str>)> = Vec::new();
        let mut failed = None;
        for (i, runner) in order.iter().enumerate() {
            (self.progress)(i as f64 / order.len() as f64);
            if self.enough(&found) {
                break;
            }
            match self.within(&mut total, |left| self.refine(runner, stop, left, &mut failed)) {
                Ok(f) => found.push(f),
                Err(e) => {
                    let short = brief(&e);
                    match why.iter_mut().find(|w| w.0 == short) {
                        Some((_, names)) => names.push(runner.way.name),
                        None => why.push((short.to_string(), vec![runner.way.name])),
                    }
                }
            }
        }
        // Extrapolation helps low orders most. If the best run is good already, only the two highest orders are tried.
        let above = |found: &[Found], least: f64| found.iter().all(|f| f.change > self.target.max(least));
        for (i, runner) in order.iter().filter(|r| r.way.order > 0).enumerate() {
            if !above(&found, if i < 2 { self.thresholds.extrapolate_two } else { self.thresholds.extrapolate_all }) {
                break;
            }
            found.extend(self.within(&mut total, |left| self.extrapolate(runner, stop, left)));
        }
        found.sort_by(|a, b| a.change.total_cmp(&b.change));
        let mut found = found.into_iter();
        let Some(best) = found.next() else { return Err(reasons(&why)) };
        let scales = self.quantities.scales(&best.run);
        let second = found.find(|f| f.method != best.method);
        let checked = second.map(|s| {
            let apart = Difference::new(&best.run, &s.run, &scales).anywhere();
            (s, apart)
        });
        let mut error = best.change.max(self.thresholds.rounding);
        if let Some((s, apart)) = &checked
            && *apart > 3.0 * (best.change + s.change)
        {
            error = apart.max(error);
        }
        let checked = checked.map(|(s, apart)| (s.how, apart));
        Ok(Reference { run: best.run, scales, error, how: best.how, checked, failed })
    }

    /// Runs something with the time for a method, as far as the total allows.
    fn within<T>(&self, total: &mut f64, what: impl FnOnce(&mut f64) -> T) -> T {
        let mut left = total.min(self.limit);
        let before = left;
        let result = what(&mut left);
        *total -= before - left;
        result
    }

    /// Whether the best is good enough, and a second method agrees.
    fn enough(&self, found: &[Found]) -> bool {
        let Some(best) = found.iter().min_by(|a, b| a.change.total_cmp(&b.change)) else { return false };
        let good = self.target.max(self.thresholds.good);
        let second = found.iter().filter(|f| f.method != best.method).map(|f| f.change).fold(f64::INFINITY, f64::min);
        best.change <= good && second <= (self.thresholds.second * best.change.max(self.thresholds.rounding)).max(good)
    }

    /// The run of a method that changes least from one setting to the next finer one: tolerances, or fixed steps if
    /// tolerances have no effect.
    fn refine(&self, runner: &Runner, stop: f64, left: &mut f64, failed: &mut Option<String>) -> Result<Found, String> {
        let from = (-self.target.log10()).clamp(5.0, 10.0) as i32 - 1;
        let tolerances = (from..=14).map(|k| Setting::Tolerance(format!("1e-{k}").parse().unwrap_or(1e-12)));
        let tolerances = if runner.way.adaptive { tolerances.collect() } else { Vec::new() };
        let steps = (0..8).map(|k| Setting::Step(stop / 256.0 / f64::from(1 << k))).collect();
        let found = self.finer(runner, tolerances, left);
        if let (Err(Lost::Failed(why)), None) = (&found, &failed) {
            *failed = Some(why.clone());
        }
        if matches!(&found, Ok(Some(_)) | Err(Lost::Late)) { found } else { self.finer(runner, steps, left).or(found) }
            .map_err(|lost| match lost {
                Lost::Failed(why) => why,
                Lost::Late => "it takes too long".to_string(),
            })?
            .ok_or_else(|| "its runs are all the same".to_string())
    }

    /// The best of runs with ever finer settings; None if no two of them differ in their steps.
    fn finer(&self, runner: &Runner, settings: Vec<Setting>, left: &mut f64) -> Result<Option<Found>, Lost> {
        let mut last: Option<Run> = None;
        let mut best: Option<Found> = None;
        let (mut worse, mut failures) = (0, 0);
        let mut lost = None;
        let mut met = None;
        let named = |setting: Setting| format!("{}, {}", runner.way.name, setting.words());
        for setting in settings {
            let run = match self.timed(runner, setting, left) {
                Ok(run) => run,
                Err(Lost::Late) => {
                    lost = Some(Lost::Late);
                    break;
                }
                Err(failed) => {
                    lost = Some(failed);
                    failures += 1;
                    if last.is_none() && failures < self.thresholds.failures { continue } else { break }
                }
            };
            if let Some(last) = &last {
                // Rows or samples may keep the steps so short that the tolerance has no effect.
                if (run.steps as f64) < self.thresholds.finer * last.steps as f64 {
                    // But if the run consists of little more than the switches, at which only adaptive steps end, two
                    // that agree are as exact as their tolerance.
                    if let Setting::Tolerance(x) = setting
                        && run.events > 0
                    {
                        let (change, how) = (self.change(last, &run).max(x), named(setting));
                        met = Some(Found { method: runner.way.name, run, change, how });
                    }
                    continue;
                }
                let change = self.change(last, &run);
                if best.as_ref().is_none_or(|b| change < b.change) {
                    best = Some(Found { method: runner.way.name, run: run.clone(), change, how: named(setting) });
                    worse = 0;
                } else {
                    worse += 1;
                }
                if change <= self.target || worse >= 3 {
                    break;
                }
            }
            last = Some(run);
        }
        match (best, lost) {
            (None, Some(lost)) if last.is_none() || lost == Lost::Late => Err(lost),
            (best, _) => Ok(best.or(met)),
        }
    }

    /// The same of fixed steps that are halved and extrapolated.
    fn extrapolate(&self, runner: &Runner, stop: f64, left: &mut f64) -> Option<Found> {
        let mut best: Option<Found> = None;
        let mut failures = 0;
        let mut tableaus = [1, 2].map(|apart| Tableau::new(runner.way.order, apart));
        for k in 0..self.thresholds.halvings {
            let h = stop / 64.0 / f64::from(1 << k);
            match self.timed(runner, Setting::Step(h), left) {
                Ok(run) => {
                    for tableau in &mut tableaus {
                        for (column, (before, now)) in tableau.push(run.clone()).into_iter().enumerate().skip(1) {
                            let change = self.change(&before, &now);
                            if best.as_ref().is_none_or(|b| change < b.change) {
                                let words = Setting::Step(h).words();
                                let how = format!("{}, {words}, extrapolated {column} times", runner.way.name);
                                best = Some(Found { method: runner.way.name, run: now, change, how });
                            }
                        }
                    }
                }
                Err(Lost::Failed(_)) if failures == self.thresholds.failures => break,
                Err(Lost::Failed(_)) => {
                    failures += 1;
                    tableaus = [1, 2].map(|apart| Tableau::new(runner.way.order, apart));
                }
                Err(Lost::Late) => break,
            }
            if best.as_ref().is_some_and(|b| b.change <= self.target) {
                break;
            }
        }
        best
    }

    /// Runs with at most the remaining time, and subtracts what it took.
    fn timed(&self, runner: &Runner, setting: Setting, left: &mut f64) -> Result<Run, Lost> {
        if *left <= 0.0 {
            return Err(Lost::Late);
        }
        let begun = runner.spent();
        let result = runner.track(setting, *left);
        *left -= runner.spent() - begun;
        match result {
            // Runs of explicit methods that went far off may agree with each other.
            Ok(run) if run.drift > self.thresholds.off_balance => {
                Err(Lost::Failed("its steps do not keep the energy balance at all".to_string()))
            }
            other => other,
        }
    }

    fn change(&self, a: &Run, b: &Run) -> f64 {
        Difference::new(b, a, &self.quantities.scales(b)).anywhere()
    }
}

/// Why methods did not reach the end, the highest orders first.
fn reasons(why: &[(String, Vec<&str>)]) -> String {
    if why.is_empty() {
        return "there is no method".into();
    }
    let told = why.iter().take(MAX_REASONS).map(|(why, names)| format!("{}: {why}", names.join(", ")));
    let others: usize = why.iter().skip(MAX_REASONS).map(|w| w.1.len()).sum();
    let others = (others > 0).then(|| format!("and {others} more"));
    told.chain(others).collect::<Vec<_>>().join("; ")
}

/// Why a run failed, without the instant, which differs, and without advice.
fn brief(why: &str) -> &str {
    let why = why.split_once(", ").filter(|(at, _)| at.starts_with("at t = ")).map_or(why, |(_, rest)| rest);
    why.split(';').next().unwrap_or(why)
}
