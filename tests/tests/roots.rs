//! Laws whose slope is infinite where a run begins, as of a hole in an empty tank.

use crate::common::{close, end, with};
use bond::{Options, Steps};

/// The level of a tank of 1 m^2 at `t`, which 1 m^3/s fills and a hole of 1 m^3/s at 1 m empties: `t = -2 (r + ln(1 - r))`
/// with its root `r`.
fn level(t: f64) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0);
    for _ in 0..60 {
        let r = 0.5 * (low + high);
        if -2.0 * (r + (1.0 - r).ln()) < t { low = r } else { high = r }
    }
    low * low
}

/// The ways to write it.
const HOLES: [&str; 7] = [
    "R:hole { f = 1 m^3/(s*Pa^(1/2)) * sqrt(e) } p -> hole",
    "R:hole { f = if e >= 0 Pa then 1 m^3/(s*Pa^(1/2)) * sqrt(e) else -1 m^3/(s*Pa^(1/2)) * sqrt(-e) } p -> hole",
    "R:hole { f = if e < 0 Pa then 0 m^3/s else 1 m^3/(s*Pa^(1/2)) * sqrt(e) } p -> hole",
    "R:hole { f = 1 m^3/(s*Pa^(1/2)) * e^(1/2) } p -> hole",
    "MR:hole { conductance = 1 m^3/(s*Pa^(1/2)) / sqrt(tank.e) } p -> hole",
    "MSf:hole = -1 m^3/(s*Pa^(1/2)) * sqrt(tank.e)  hole -> p",
    "state h = 0 { dh = 1 s^-1 - 1 s^-1 * sqrt(h) }",
];

#[test]
fn an_empty_tank_fills() {
    for hole in HOLES {
        for method in ["", "gonzalez", "collocation6", "radau"] {
            let probed = if hole.contains("state") { "h * 1 m^3" } else { "tank.q" };
            let model = format!(
                "model Tank {{
                  Sf:inflow = 1 m^3/s
                  C:tank = 1 m^3/Pa
                  inflow -> 0:p -> tank
                  {hole}
                  probe x = {probed}
                }}"
            );
            let compiled = with(if method.is_empty() { Options::new() } else { Options::new().method(method) }, &model);
            close(end(&compiled, Steps::new(), 3.0, "x"), level(3.0), 2e-5, &format!("{hole} {method}"));
        }
    }
}

/// The law of a resistor that is solved the other way: a coil's current through `i = e^(1/3)` from 0.
#[test]
fn a_root_that_a_current_is_imposed_on() {
    // di/dt = 1 - i^3, by steps of order 4.
    let (mut i, n) = (0.0f64, 1000);
    let (rate, h) = (|i: f64| 1.0 - i * i * i, 1.0 / f64::from(n));
    for _ in 0..n {
        let a = rate(i);
        let b = rate(i + 0.5 * h * a);
        let c = rate(i + 0.5 * h * b);
        i += h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(i + h * c));
    }
    let model = "model Coil {
      Se:u = 1 V
      I:l = 1 H
      R:r { f = 1 A/V^(1/3) * e^(1/3) }
      u -> 1:j -> l, r
      probe x = l.f
    }";
    for method in ["gonzalez", "collocation6", "radau", "euler"] {
        let compiled = with(Options::new().method(method), model);
        close(end(&compiled, Steps::new(), 1.0, "x"), i, 2e-4, method);
    }
}
