//! A point of the comparison: a method with a setting, its cost and its error.

use super::clock::median;
use super::norm::Difference;
use super::reference::Reference;
use super::setting::Setting;
use super::thresholds::Timing;
use super::trial::{Lost, Run, Runner};
use bond_runtime::simulate::KEPT;
/// An error counts as measured if it is this many times that of the reference.
pub const TIMES_REFERENCE: f64 = 10.0;

/// A method with a setting.
#[derive(Clone, Debug)]
pub struct Point {
    /// `gonzalez`
    pub method: &'static str,
    /// Its order; 0 if it has no error.
    pub order: u32,
    /// Whether its stepper keeps the balance.
    pub passive: bool,
    /// Step or tolerance.
    pub setting: Setting,
    /// What came of it, or why nothing did.
    pub result: Result<Measured, String>,
    /// Nothing is both cheaper and more exact.
    pub front: bool,
}

impl Point {
    /// Whether its run kept the balance, as measured.
    pub fn keeps(&self) -> bool {
        self.passive && self.result.as_ref().is_ok_and(|m| m.balance <= KEPT)
    }
}

impl Measured {
    /// The error at the end or the largest along the run, whichever is larger: a run may end near by luck.
    pub fn worst(&self) -> f64 {
        self.difference.along.iter().copied().fold(self.error, f64::max)
    }
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Differences from the reference, of a run without rows at its end, of a run with rows along it.
    pub difference: Difference,
    /// The largest of them at the end: the error.
    pub error: f64,
    /// Not far above the error of the reference itself: it may be anything below.
    pub floor: bool,
    /// The largest sum of the residuals of a balance on the way, relative to the largest energy.
    pub drift: f64,
    /// The worst balance of a step, relative.
    pub balance: f64,
    /// Steps of continuous regions.
    pub steps: u64,
    /// Newton iterations in them.
    pub iterations: u64,
    /// Processor time of stepping to the end, s.
    pub seconds: f64,
}

/// Processor time of measuring a point whose run takes `seconds`, s: a run with rows, a first one, and the readings.
pub fn takes(seconds: f64, repeat: usize, timing: &Timing) -> f64 {
    2.0 * seconds + repeat as f64 * seconds.max(f64::min(timing.reading, timing.runs as f64 * seconds))
}

/// Measures a point. Gives also the processor time that this took in all, s.
///
/// # Errors
/// A run that fails or takes longer than `limit` seconds.
pub fn measure(
    runner: &Runner,
    setting: Setting,
    reference: &Reference,
    repeat: usize,
    limit: f64,
) -> Result<Measured, Lost> {
    let begun = runner.spent();
    let tracked = runner.track(setting, limit)?;
    let (first, seconds) = timed(runner, setting, repeat, limit - (runner.spent() - begun))?;
    let ends = Difference::new(&first, &reference.run, &reference.scales);
    let mut difference = Difference::new(&tracked, &reference.run, &reference.scales);
    for (along, end) in difference.along.iter_mut().zip(&ends.end) {
        *along = along.max(*end);
    }
    difference.end = ends.end;
    let error = difference.at_end();
    Ok(Measured {
        error,
        floor: error < TIMES_REFERENCE * reference.error,
        difference,
        drift: tracked.drift.max(first.drift),
        balance: tracked.balance.max(first.balance),
        steps: first.steps,
        iterations: first.iterations,
        seconds,
    })
}

/// Runs without rows, `repeat` readings of the clock, or fewer if they take longer than `limit` in all. Returns the
/// first run, and the processor time of one run, s.
///
/// # Errors
/// A run that fails.
pub fn timed(runner: &Runner, setting: Setting, repeat: usize, limit: f64) -> Result<(Run, f64), Lost> {
    let (begun, timing) = (runner.spent(), runner.thresholds().timing);
    let first = runner.plain(setting, 1)?;
    let most = ((timing.set_up / first.made.max(1e-9)) as usize).clamp(1, timing.runs);
    let times = ((timing.reading / first.seconds.max(1e-9)).ceil() as usize).clamp(1, most);
    let mut readings = if times == 1 { vec![first.seconds] } else { Vec::new() };
    while readings.len() < repeat.max(1) && (readings.is_empty() || runner.spent() - begun < limit) {
        readings.push(runner.plain(setting, times)?.seconds);
    }
    Ok((first, median(readings)))
}
