//! Laws whose slope is infinite where a run begins, as of a hole in an empty tank.

use crate::common::{advance, close, end, probe, run, start, text, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps};
use bond_compiler::discretise::Accuracy;

/// The level of a tank of 1 m^2 at `t`, which 1 m^3/s fills and a hole of 1 m^3/s at 1 m empties: `t = -2 (r + ln(1 -
/// r))` with its root `r`.
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

/// Pipes whose orifices turn over together, and a valve between: the equations of the roots weigh far less than those
/// of the charges, and whole updates are right though what is left grows.
#[test]
fn orifices_take_few_iterations() {
    let valve = |resistance: &str| {
        format!("R:valve {{ e = min(s, 0) * 1 bar + {resistance} * max(s, 0) * 1 L/min; f = max(s, 0) * 1 L/min }}")
    };
    let scenes = [
        // From rest, at once at 1 MPa, into next to nothing.
        format!(
            "Se:pump = if mod(t, 60 ms) < 12 ms then 1 MPa else 0 Pa
            C:c1 = 1.01e-13 m^3/Pa
            C:c2 = 4.47e-13 m^3/Pa
            C:c3 = 4e-13 m^3/Pa
            R:r1 {{ f = 2.12e-8 m^3/(s*Pa^(1/2)) * sign(e) * sqrt(abs(e)) }}
            R:s1 {{ f = 2.12e-8 m^3/(s*Pa^(1/2)) * sign(e) * sqrt(abs(e)) }}
            R:s2 {{ f = 2.12e-8 m^3/(s*Pa^(1/2)) * sign(e) * sqrt(abs(e)) }}
            I:pipe = 32.4e6 kg/m^4
            {}
            pump -> 1:b1 -> r1, 0:n1
            n1 -> 1:b2 -> pipe, 0:n2
            n2 -> 1:b3 -> valve, 0:n3
            n1 -> c1, s1
            n2 -> c2, s2
            n3 -> c3
            simulate {{ stop = 0.2 s }}",
            valve("47.1e9 Pa*s/m^3")
        ),
        format!(
            "Se:pump = 0.1 MPa * sin(2*pi*30 Hz * t)
            C:c2 = 3e-12 m^3/Pa
            C:c3 = 4e-13 m^3/Pa
            C:c4 = 8e-11 m^3/Pa
            R:r1 {{ f = 5e-6 m^3/(s*Pa^(1/2)) * sign(e) * sqrt(abs(e)) }}
            R:leak = 60e6 Pa*s/m^3
            R:r2 = 600e6 Pa*s/m^3
            I:pipe = 2e6 kg/m^4
            {}
            R:s4 {{ f = 2e-6 m^3/(s*Pa^(1/2)) * sign(e) * sqrt(abs(e)) }}
            pump -> 1:b1 -> r1, 0:n1
            n1 -> 1:b2 -> r2, 0:n2
            n2 -> 1:b3 -> pipe, 0:n3
            n3 -> 1:b4 -> valve, 0:n4
            n1 -> leak
            n2 -> c2
            n3 -> c3
            n4 -> c4, s4
            simulate {{ stop = 0.07 s }}",
            valve("60e6 Pa*s/m^3")
        ),
    ];
    for (scene, most) in scenes.iter().zip([45, 400]) {
        let pipes = with(Options::new().method("gonzalez"), &format!("model Pipes {{ {scene} }}"));
        let summary = run(&pipes).unwrap();
        let region = &summary.regions[0];
        assert!(summary.passive && region.worst_step < 1e-13, "{scene}: {summary:?}");
        let (steps, iterations) = (region.steps, region.newton_iterations);
        assert!(10 * iterations < most * steps, "{scene}: {iterations} in {steps}");
    }
}

/// A tank that runs dry, q = (1 - t/2)^2, stays dry: the parabola's other branch fills it again. What flows then is the
/// root of what is left, however little that is.
#[test]
fn a_tank_that_runs_dry_stays_dry() {
    for law in ["e = (1 Pa*s^2/m^6)*f*abs(f)", "f = (1 m^3/(s*Pa^(1/2)))*sign(e)*sqrt(abs(e))"] {
        for tolerance in [1e-5, 1e-6, 1e-7, 1e-8, 1e-9] {
            let model = format!(
                "model M {{ C:tank {{ stiffness = 1 Pa/m^3; q0 = 1 m^3 }}  R:hole {{ {law} }}  tank -> hole
                   probe q = tank.q  probe f = hole.f  simulate {{ stop = 20 s }} }}"
            );
            let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), &model);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            let mut lost = 0.0;
            for k in 1..=80 {
                let t = 0.05 * f64::from(k);
                advance(&mut sim, t);
                let (q, f) = (probe(&mut sim, "q"), probe(&mut sim, "f"));
                let left = (1.0 - 0.5 * t).max(0.0);
                assert!((q - left * left).abs() <= 100.0 * tolerance, "{law}, {tolerance}: {q} at {t} s");
                assert!((f - q.signum() * q.abs().sqrt()).abs() <= 1e-9, "{law}, {tolerance}: {f} of {q} at {t} s");
                let summary = sim.summary();
                assert!(summary.passive && summary.regions[0].dissipated >= lost - 1e-9, "{summary:?}");
                lost = summary.regions[0].dissipated;
            }
        }
    }
}

/// What rows say of a flow through an orifice is the root of the drop that they say, whatever else the law reads, and
/// however the law goes on where it is steep.
#[test]
fn rows_tell_the_root_of_the_drop() {
    let k = |q: f64| 1.0 + q * q;
    let levels = "model M { C:a { stiffness = 1 Pa/m^3; q0 = 1 m^3 }  C:b { stiffness = 1 Pa/m^3 }
      R:hole { e = (1 Pa*s^2/m^6)*(1 + (b.q/(1 m^3))^2)*f*abs(f) }
      a -> 1:m -> hole, b  probe q = b.q  probe e = hole.e  probe f = hole.f  simulate { stop = 8 s } }";
    for tolerance in [1e-5, 1e-6, 1e-7, 1e-9] {
        let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), levels);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        for i in 1..=80 {
            advance(&mut sim, 0.1 * f64::from(i));
            let [q, e, f] = ["q", "e", "f"].map(|name| probe(&mut sim, name));
            // The drop is a difference of levels, known to their rounding.
            let root = |e: f64| e.signum() * (e.abs() / k(q)).sqrt();
            let known = 1e-15;
            assert!(root(e - known) - 1e-9 <= f && f <= root(e + known) + 1e-9, "{tolerance}, {i}: {f} of {e} at {q}");
        }
    }
    for q0 in [0.1f64, 0.6, 0.9, 0.99] {
        let saturates = format!(
            "model M {{ C:a {{ stiffness = 1 Pa/m^3; q0 = {q0} m^3 }}  R:hole {{ e = (1 Pa)*tanh((f/(1 m^3/s))^3) }}
               a -> hole  probe f = hole.f }}"
        );
        let compiled = text(&saturates);
        let mut sim = start(&compiled, Steps::new());
        close(probe(&mut sim, "f"), q0.atanh().cbrt(), 1e-9, &format!("{q0} m^3"));
    }
}
