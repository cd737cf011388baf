//! The choice if every continuous region is linear: the stepper without error, with steps short enough for its sources.

use super::{Ask, Target, Tried};
use crate::bench::{Difference, Quantities, Runner, Setting};

/// Takes the default step; shorter steps if sources that vary by themselves need them, longer ones if the time does not
/// suffice. None if it does not succeed.
pub fn choose(ask: &Ask, runner: &Runner, quantities: &Quantities) -> Option<(Tried, String)> {
    let usual = ask.stop / 1000.0;
    let usual = ask.longest.unwrap_or_else(|| ask.every.map_or(usual, |e| e.min(usual)));
    let halvings = ask.thresholds.bench.reference.halvings;
    let why = "every continuous region is linear: its only error is that of sources that vary by themselves";
    // A run with this step, and how far that is from one with half of it.
    let tried = |h: f64| {
        let [run, finer] = [h, 0.5 * h].map(|h| runner.track(Setting::Step(h), f64::INFINITY).ok());
        let (run, finer) = (run?, finer?);
        let error = Difference::new(&run, &finer, &quantities.scales(&finer)).anywhere();
        let keeps = run.keeps();
        keeps.then_some(Tried {
            method: runner.way.name,
            setting: Setting::Step(h),
            error,
            seconds: run.seconds,
            keeps,
        })
    };
    match ask.target {
        Target::Error(e) => {
            let mut tries = (0..halvings).map_while(|k| tried(usual / f64::from(k).exp2()));
            tries.find(|t| t.error <= 0.5 * e).map(|t| (t, why.to_string()))
        }
        Target::Budget(budget) => {
            let allowed = super::budget::allowed(budget, ask.stop, &runner.way.scene, &ask.thresholds.budget);
            let lengths = (0..=halvings).map(|k| (usual * f64::from(k).exp2()).min(ask.stop));
            let mut tries = lengths.map_while(tried);
            tries.find(|t| t.seconds <= allowed).map(|t| (t, format!("{why}, and these steps fit")))
        }
    }
}
