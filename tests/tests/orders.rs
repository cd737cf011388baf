//! Measured orders of convergence, and what holds over a million steps.

use crate::common::{close, end, example, file, finish, models, probe, start, text, with};
use bond::{Options, Steps};

/// Orders between neighbours of a list of errors, each at half the step of the one before.
fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

#[track_caller]
fn assert_order(what: &str, errors: &[f64], wanted: f64, within: f64) {
    let found = orders(errors);
    assert!(found.iter().all(|o| (o - wanted).abs() <= within), "{what}: orders {found:?} of errors {errors:?}");
}

#[test]
fn gonzalez_has_order_two_on_the_pendulum() {
    let compiled = example("pendulum", "Pendulum");
    // Richardson's limit of two short steps is good to order 4.
    let (a, b) = (end(&compiled, Steps::fixed(2e-4), 2.0, "angle"), end(&compiled, Steps::fixed(1e-4), 2.0, "angle"));
    let wanted = b + (b - a) / 3.0;
    let errors: Vec<f64> = [0.02, 0.01, 0.005, 0.0025]
        .iter()
        .map(|h| (end(&compiled, Steps::fixed(*h), 2.0, "angle") - wanted).abs())
        .collect();
    assert_order("gonzalez", &errors, 2.0, 0.1);
}

#[test]
fn the_pendulum_keeps_its_energy_over_a_million_steps() {
    let compiled = example("pendulum", "Pendulum");
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    let first = probe(&mut sim, "energy");
    for k in 1..=10 {
        finish(&mut sim, f64::from(k) * 100.0);
        close(probe(&mut sim, "energy"), first, 1e-12 * first, &format!("energy after {k} times 100 s"));
    }
    let summary = sim.summary();
    assert!(summary.regions[0].steps >= 1_000_000);
    assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-10, "{} {}", summary.worst_step, summary.total);
}

/// Over the top: the energy is not convex there.
#[test]
fn the_pendulum_goes_over_the_top() {
    let text = crate::common::read(&models().join("examples/pendulum.bond"))
        .replace("I:rotor = m*len^2", "I:rotor { inertia = m*len^2;  f0 = 5 rad/s }");
    let compiled = crate::common::text(&text);
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    let first = probe(&mut sim, "energy");
    finish(&mut sim, 100.0);
    assert!(probe(&mut sim, "angle") > 20.0);
    close(probe(&mut sim, "energy"), first, 1e-12 * first, "energy");
}

#[test]
fn exact_balances_over_a_million_steps() {
    let compiled = text(
        "model Oscillator {
          I:mass = 1 kg
          C:spring { stiffness = 100 N/m;  q0 = 1 m }
          1:v -> mass, spring
          probe energy = mass.H + spring.H
        }",
    );
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    finish(&mut sim, 1000.0);
    close(probe(&mut sim, "energy"), 50.0, 50.0 * 1e-12, "energy");
    let summary = sim.summary();
    assert!(summary.regions[0].steps >= 1_000_000);
    assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-10, "{} {}", summary.worst_step, summary.total);
}

#[test]
fn sampled_steps_balance_over_a_million_steps() {
    let compiled = example("mass_spring_sampled", "MassSpring");
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 500_000.0);
    let summary = sim.summary();
    assert!(summary.regions.iter().all(|r| r.steps >= 1_000_000));
    assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-10, "{} {}", summary.worst_step, summary.total);
    assert_eq!(summary.bars[0].difference, 0.0);
    close(probe(&mut sim, "energy"), 0.5, 1e-4, "energy");
}

const SWING: &str = "model Swing {
  I:mass = 1 kg
  C:spring { stiffness = 4 N/m;  q0 = 1 m }
  R:drag = 0.2 N*s/m
  1:v -> mass, spring, drag
  probe x = spring.q
}";

fn swing(method: &str, steps: &[f64]) -> Vec<f64> {
    let exact = end(&with(Options::new().method("exact"), SWING), Steps::fixed(0.01), 2.0, "x");
    let compiled = with(Options::new().method(method), SWING);
    steps.iter().map(|h| (end(&compiled, Steps::fixed(*h), 2.0, "x") - exact).abs()).collect()
}

#[test]
fn each_method_has_its_order_against_exact() {
    assert_order("euler", &swing("euler", &[0.002, 0.001, 0.0005]), 1.0, 0.1);
    assert_order("gonzalez", &swing("gonzalez", &[0.02, 0.01, 0.005]), 2.0, 0.1);
    assert_order("rk4", &swing("rk4", &[0.04, 0.02, 0.01]), 4.0, 0.15);
    assert_order("rk45", &swing("rk45", &[0.1, 0.05, 0.025]), 5.0, 0.35);
    assert_order("dop853", &swing("dop853", &[0.4, 0.2, 0.1]), 8.0, 0.5);
    assert_order("symplectic_euler", &swing("symplectic_euler", &[0.002, 0.001, 0.0005]), 1.0, 0.1);
}

#[test]
fn exact_and_gonzalez_agree_at_small_steps() {
    for (name, scene, what, stop) in [
        ("dc_motor", "DcMotor", "speed", 0.5),
        ("wheatstone", "Wheatstone", "u_bridge", 1e-3),
        ("rc_ladder", "RcLadder", "last", 0.05),
    ] {
        let path = models().join(format!("examples/{name}.bond"));
        let exact = file(&path, Options::new().model(scene).method("exact"));
        let gonzalez = file(&path, Options::new().model(scene).method("gonzalez"));
        let wanted = end(&exact, Steps::fixed(stop / 100.0), stop, what);
        let errors: Vec<f64> = [2000.0, 4000.0, 8000.0]
            .iter()
            .map(|n| (end(&gonzalez, Steps::fixed(stop / n), stop, what) - wanted).abs())
            .collect();
        assert!(errors[2] <= 1e-5 * wanted.abs(), "{name}: {errors:?}");
        assert_order(name, &errors, 2.0, 0.1);
    }
}

/// A driven Duffing oscillator: order 2 against a fine run of the classical method.
#[test]
fn gonzalez_has_order_two_on_duffing() {
    let path = models().join("examples/duffing.bond");
    let fine = file(&path, Options::new().method("rk4"));
    let wanted = end(&fine, Steps::fixed(1e-3), 5.0, "x");
    let compiled = file(&path, Options::new());
    let errors: Vec<f64> =
        [0.02, 0.01, 0.005].iter().map(|h| (end(&compiled, Steps::fixed(*h), 5.0, "x") - wanted).abs()).collect();
    assert_order("duffing", &errors, 2.0, 0.1);
}
