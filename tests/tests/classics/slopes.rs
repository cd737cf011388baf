//! The linear model of each system, against its derivation.

use super::place::{At, Dice, place, plain};
use super::{System, all, compiled};
use bond::internal::CompiledInternals;
use bond::{Compiled, Options};
use std::collections::BTreeMap;

/// A of `linearize` against difference quotients.
#[test]
fn the_linear_model_is_the_slope_of_the_derivation() {
    let mut wrong = Vec::new();
    for (i, system) in all().iter().enumerate() {
        let (compiled, mut dice) = (compiled(system.name, Options::new()), Dice(2000 + i as u64));
        for _ in 0..3 {
            if let Err(why) = place(system, &compiled, &mut dice).and_then(|at| slopes_agree(system, &compiled, &at)) {
                wrong.push(format!("{}: {why}", system.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn slopes_agree(system: &System, compiled: &Compiled, at: &At) -> Result<(), String> {
    let linear = compiled.linearize(at.t, &|name| at.values.get(name).copied())?;
    let rates = |values: &BTreeMap<String, f64>| -> BTreeMap<String, f64> {
        (system.by_hand)(&At { t: at.t, values: values.clone() }).rates.into_iter().collect()
    };
    let here = rates(&at.values);
    // Integrals of probes are no states of the derivation.
    let known = |name: &&String| here.contains_key(*name);
    for (j, state) in linear.states.iter().enumerate().filter(|s| known(&s.1)) {
        let short = plain(state);
        let (_, low, high) = system.states.iter().find(|s| s.0 == short).ok_or("a state without bounds")?;
        let h = 1e-5 * (high - low);
        let moved = |by: f64| {
            let mut values = at.values.clone();
            values.entry(state.clone()).and_modify(|x| *x += by);
            rates(&values)
        };
        let (up, down, far_up, far_down) = (moved(h), moved(-h), moved(2.0 * h), moved(-2.0 * h));
        for (i, name) in linear.states.iter().enumerate().filter(|s| known(&s.1)) {
            // Of order 4.
            let wanted = (8.0 * (up[name] - down[name]) - (far_up[name] - far_down[name])) / (12.0 * h);
            // What rounding of the rates leaves in the quotient, and its own error.
            let slack = 1e-12 * (up[name].abs() + down[name].abs()) / h + 1e-6 * wanted.abs();
            let found = linear.a[(i, j)];
            if (found - wanted).abs() > slack {
                return Err(format!("A of {name} by {state} is {found:e}, by hand {wanted:e}, at t = {}", at.t));
            }
        }
    }
    Ok(())
}
