//! The beginning of each run, against the derivation integrated by itself.

use super::place::{At, states};
use super::{System, all, compiled};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};
use std::collections::BTreeMap;

type States = BTreeMap<String, f64>;

/// The derivation's states after a time, by the classic Runge-Kutta method with n steps.
fn integrated(system: &System, start: &At, states: &States, end: f64, n: u32) -> States {
    let mut at = At { t: 0.0, values: start.values.clone() };
    let mut x = states.clone();
    let h = end / f64::from(n);
    for k in 0..n {
        let mut stage = |slope: Option<&States>, part: f64| -> States {
            at.t = (f64::from(k) + part) * h;
            for (name, x) in &x {
                let moved = x + slope.map_or(0.0, |s| part * h * s[name]);
                at.values.insert(name.clone(), moved);
            }
            (system.by_hand)(&at).rates.into_iter().collect()
        };
        let a = stage(None, 0.0);
        let b = stage(Some(&a), 0.5);
        let c = stage(Some(&b), 0.5);
        let d = stage(Some(&c), 1.0);
        for (name, x) in &mut x {
            *x += h / 6.0 * (a[name] + 2.0 * b[name] + 2.0 * c[name] + d[name]);
        }
    }
    x
}

/// The largest difference, each state relative to its size and its bounds.
fn apart(system: &System, a: &States, b: &States, start: &States) -> (f64, String) {
    let mut worst = (0.0, String::new());
    for (name, x) in a {
        let bounds = system.states.iter().find(|s| s.0 == super::place::plain(name));
        let size = x.abs().max(start[name].abs()) + 1e-2 * bounds.map_or(0.0, |(_, low, high)| high - low);
        let off = (x - b[name]).abs() / size;
        if off > worst.0 || off.is_nan() {
            worst = (off, format!("{name} = {x:e} and {:e}", b[name]));
        }
    }
    worst
}

fn follows(system: &System) -> Result<(), String> {
    let compiled = compiled(system.name, Options::new());
    let stages = compiled.stages();
    // Before any switch.
    let end = f64::min(crate::common::stop(&compiled) / 50.0, system.until / 4.0);
    let values: States = stages.model.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
    let start: States = states(&compiled).into_iter().collect();
    let at = At { t: 0.0, values };
    let (mut n, mut wanted) = (500, integrated(system, &at, &start, end, 250));
    loop {
        let finer = integrated(system, &at, &start, end, n);
        if apart(system, &finer, &wanted, &start).0 < 1e-7 {
            wanted = finer;
            break;
        }
        if n > 20_000 {
            return Err(format!(
                "the derivation's own integration is not settled: {:?}",
                apart(system, &finer, &wanted, &start)
            ));
        }
        (n, wanted) = (2 * n, finer);
    }
    let mut sim = compiled.simulate(Steps::tolerance(1e-10).longest(end / 2000.0)).map_err(|e| e.to_string())?;
    sim.advance(end).map_err(|e| e.to_string())?;
    let mut found = States::new();
    for name in start.keys() {
        found.insert(name.clone(), sim.state(name).ok_or_else(|| format!("the run has no state `{name}`"))?);
    }
    let (off, what) = apart(system, &found, &wanted, &start);
    if off < 1e-5 { Ok(()) } else { Err(format!("off by {off:e} at {end} s: {what} by hand")) }
}

#[test]
fn runs_follow_the_derivation() {
    let mut wrong = Vec::new();
    // What sticks has no speed whose sign would tell the friction: its derivation holds while it slips.
    for system in all().iter().filter(|s| !["stick_slip", "belt_friction"].contains(&s.name)) {
        if let Err(why) = follows(system) {
            wrong.push(format!("{}: {why}", system.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
