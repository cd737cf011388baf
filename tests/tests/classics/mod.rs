//! The classic systems of `models/classics`, against equations derived by hand.
//!
//! Each is derived from mechanics or circuit theory (Newton, Kirchhoff, Lagrange, balances), not from its bond graph,
//! and compared with the compiled form at random states and times, with the parameters of its file and with others:
//! rates of all states, and the energy.

mod car;
mod circuit;
mod curve;
mod entropy;
mod field;
mod fluid;
mod heat;
mod machine;
mod mechanics;
mod motion;
mod place;
mod run;
mod shaft;
mod slopes;

use crate::common::{file, models, title};
use bond::internal::CompiledInternals;
use bond::{Compiled, Options};
use place::{At, Dice, place, states};
use std::collections::BTreeMap;

/// A system with its derivation.
struct System {
    /// The file's name.
    name: &'static str,
    /// Bounds for each state; indices are left out, `cap.q` is for `cap[1].q` and so on.
    states: &'static [(&'static str, f64, f64)],
    /// Times are taken from 0 to this, s.
    until: f64,
    /// The derivation.
    by_hand: fn(&At) -> Hand,
}

/// What a derivation says.
struct Hand {
    /// d(state)/dt by the state's name.
    rates: Vec<(String, f64)>,
    /// All energy stored.
    energy: f64,
}

/// Rates by name, and the energy.
fn hand<const N: usize>(rates: [(&str, f64); N], energy: f64) -> Hand {
    Hand { rates: rates.map(|(name, rate)| (name.to_string(), rate)).to_vec(), energy }
}

fn all() -> Vec<System> {
    let groups = [
        mechanics::systems(),
        car::systems(),
        shaft::systems(),
        motion::systems(),
        circuit::systems(),
        machine::systems(),
        field::systems(),
        curve::systems(),
        entropy::systems(),
        fluid::systems(),
        heat::systems(),
    ];
    groups.into_iter().flatten().collect()
}

fn compiled(name: &str, options: Options) -> Compiled {
    file(&models().join("classics").join(format!("{name}.bond")), options)
}

/// Compares at 20 places.
fn agrees(system: &System, compiled: &Compiled, dice: &mut Dice) -> Result<(), String> {
    for _ in 0..20 {
        let at = place(system, compiled, dice)?;
        let given = |name: &str| at.values.get(name).copied();
        let wanted = (system.by_hand)(&at);
        let found = compiled.rates(at.t, &given)?;
        let found: BTreeMap<&str, f64> = found.iter().map(|(name, x)| (name.as_str(), *x)).collect();
        let states = states(compiled).len();
        if wanted.rates.len() != states {
            return Err(format!("{} states by hand, {states} in the form", wanted.rates.len()));
        }
        for (name, rate) in &wanted.rates {
            let found = found.get(name.as_str()).ok_or_else(|| format!("the form has no state `{name}`"))?;
            same(&format!("d({name})/dt"), *found, *rate, &at)?;
        }
        let energy = compiled.energies(at.t, &given)?.iter().map(|e| e.1).sum();
        same("H", energy, wanted.energy, &at)?;
    }
    Ok(())
}

fn same(what: &str, found: f64, wanted: f64, at: &At) -> Result<(), String> {
    if (found - wanted).abs() <= 1e-9 * found.abs().max(wanted.abs()) {
        return Ok(());
    }
    Err(format!("{what} is {found:e}, by hand {wanted:e}, at t = {} and {:?}", at.t, at.values))
}

#[test]
fn the_form_is_what_is_derived_by_hand() {
    let mut wrong = Vec::new();
    for (i, system) in all().iter().enumerate() {
        let mut dice = Dice(i as u64);
        if let Err(why) = agrees(system, &compiled(system.name, Options::new()), &mut dice) {
            wrong.push(format!("{}: {why}", system.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Each parameter within a fifth of its value, so that none can hide behind another.
#[test]
fn with_other_parameters_too() {
    let mut wrong = Vec::new();
    for (i, system) in all().iter().enumerate() {
        let usual = compiled(system.name, Options::new());
        for round in 0..3 {
            let mut dice = Dice(1000 + 10 * i as u64 + round);
            let mut options = Options::new();
            // How many pieces there are stays.
            for p in usual.stages().model.parameters.iter().filter(|p| p.name != "n") {
                options = options.set(p.name.clone(), &format!("{:e}", p.value * dice.between(0.8, 1.2)));
            }
            if let Err(why) = agrees(system, &compiled(system.name, options), &mut dice) {
                wrong.push(format!("{}: {why}", system.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The oscillator, with a sign and an error of its energy to choose.
fn oscillator(x: &At, sign: f64, off: f64) -> Hand {
    let v = x["mass.p"] / x["m"];
    let energy = (0.5 * x["m"] * v * v + 0.5 * x["k"] * x["spring.q"].powi(2)) * (1.0 + off);
    let force = x["push"] - x["k"] * x["spring.q"] - sign * x["b"] * v;
    hand([("mass.p", force), ("spring.q", v)], energy)
}

/// What the comparison is worth: a derivation with one sign wrong, and one with an energy that is off by a millionth,
/// are found.
#[test]
fn a_wrong_derivation_is_found() {
    let holds = |by_hand: fn(&At) -> Hand| {
        let states = &[("mass.p", -1.0, 1.0), ("spring.q", -0.1, 0.1)];
        let system = System { name: "mass_spring_damper", states, until: 1.0, by_hand };
        agrees(&system, &compiled(system.name, Options::new()), &mut Dice(1)).is_ok()
    };
    assert!(holds(|x| oscillator(x, 1.0, 0.0)));
    assert!(!holds(|x| oscillator(x, -1.0, 0.0)));
    assert!(!holds(|x| oscillator(x, 1.0, 1e-6)));
}

#[test]
fn every_classic_has_its_derivation() {
    let derived: Vec<String> = all().iter().map(|s| format!("classics/{}", s.name)).collect();
    let files: Vec<String> = crate::common::texts("classics").iter().map(|(path, _)| title(path)).collect();
    for name in &files {
        assert!(derived.contains(name), "{name} has no derivation");
    }
    assert_eq!(derived.len(), files.len(), "a system is derived twice, or has no file");
}

/// docs/reference/classics.md names each with the number of its states.
#[test]
fn every_classic_is_in_the_docs() {
    let docs = crate::common::read(std::path::Path::new("../docs/reference/classics.md"));
    let rows: Vec<Vec<&str>> = docs.lines().map(|l| l.split('|').map(str::trim).collect()).collect();
    let named = rows.iter().filter(|r| r.get(1).is_some_and(|c| c.starts_with('`'))).count();
    let list = all();
    for system in &list {
        let states = states(&compiled(system.name, Options::new())).len();
        let wanted = format!("`{}`", system.name);
        let row = rows.iter().find(|r| r.get(1) == Some(&wanted.as_str()));
        assert_eq!(
            row.and_then(|r| r.get(3)).copied(),
            Some(states.to_string().as_str()),
            "docs/reference/classics.md: {wanted}"
        );
    }
    assert_eq!(named, list.len(), "docs/reference/classics.md names a system that is not there, or one twice");
}
