//! Mechanisms with loops of bars, and driven ones: `models/mechanisms/` as each says itself, against published numbers
//! and such as were found by other means.

use crate::common::{advance, close, file, models, probe, read, scenes_of, start, stop, with};
use bond::{Options, Steps};

/// What each is to come to is an expectation of its own (`expectations`).
#[test]
fn every_mechanism_balances() {
    for (title, path, scene) in scenes_of("mechanisms") {
        let compiled = file(&path, Options::new().model(&scene));
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        sim.finish(stop(&compiled)).unwrap_or_else(|e| panic!("{title}: {e}"));
        let summary = sim.summary();
        assert!(summary.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", summary.worst_step);
        assert!(summary.passive, "{title}");
    }
}

/// A chain of n parallelograms moves as one bar: its angle and speed at 0.5 s by the method of Runge and Kutta.
fn one_bar(n: usize) -> (f64, f64) {
    let n = n as f64;
    let fall = 9.81 * ((n + 1.0) / 2.0 + n) / ((n + 1.0) / 3.0 + n);
    let rate = |y: (f64, f64)| (y.1, -fall * y.0.cos());
    let (h, mut y) = (1e-4, (std::f64::consts::FRAC_PI_2, -1.0));
    for _ in 0..5000 {
        let at = |k: (f64, f64), part: f64| (y.0 + part * h * k.0, y.1 + part * h * k.1);
        let a = rate(y);
        let b = rate(at(a, 0.5));
        let c = rate(at(b, 0.5));
        let d = rate(at(c, 1.0));
        let mean = |a: f64, b: f64, c: f64, d: f64| h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
        y = (y.0 + mean(a.0, b.0, c.0, d.0), y.1 + mean(a.1, b.1, c.1, d.1));
    }
    y
}

#[test]
fn chains_of_parallelograms() {
    let model = read(&models().join("mechanisms/n_four_bar.bond"));
    for n in [1, 2, 9, 30] {
        let compiled = with(Options::new().set("n", &n.to_string()), &model);
        let mut sim = start(&compiled, Steps::tolerance(1e-10));
        advance(&mut sim, 0.5);
        let (angle, speed) = one_bar(n);
        close(probe(&mut sim, "a"), angle, 1e-9, &format!("the angle of {n}"));
        close(probe(&mut sim, "w"), speed, 1e-9, &format!("the speed of {n}"));
        assert!(sim.summary().worst_step < 1e-12);
    }
}

/// Where all bars lie in a line the loops could fold; in motion they go through as they came.
#[test]
fn parallelograms_through_their_dead_centres() {
    let model = read(&models().join("mechanisms/n_four_bar.bond"));
    let compiled = with(Options::new().set("n", "2"), &model);
    let mut sim = start(&compiled, Steps::tolerance(1e-9));
    advance(&mut sim, 5.0);
    assert!(probe(&mut sim, "a") < -4.0 * std::f64::consts::PI);
    for what in ["off", "tilt"] {
        close(probe(&mut sim, what) + 1.0, 1.0, 1e-10, what);
    }
    assert!(sim.summary().worst_step < 1e-12);
}

/// Bonds declared in the opposite order, and the model as a part of another: the same numbers.
#[test]
fn neither_order_nor_parts_count() {
    let model = read(&models().join("mechanisms/car_axis.bond"));
    let compiled = with(Options::new().method("collocation8"), &model);
    let mut sim = start(&compiled, Steps::tolerance(1e-10));
    advance(&mut sim, 0.5);
    let wanted = ["xl_at", "yl_at", "xr_at", "yr_at"].map(|p| probe(&mut sim, p));
    // All bonds the other way round in their order, and the model as a part of another.
    let (head, body) = model.split_once("model CarAxis {").expect("the model is there");
    let (body, _) = body.split_once("  simulate").expect("it says how it runs");
    let (bonds, rest): (Vec<&str>, Vec<&str>) = body.lines().partition(|l| l.contains("->"));
    let text = format!("{}\n{}", rest.join("\n"), bonds.into_iter().rev().collect::<Vec<_>>().join("\n"));
    let probes = ["xl", "yl", "xr", "yr"].map(|p| format!("probe {p}_at = car.{p}.q")).join("\n");
    let scene = format!("{head}\nmodel CarAxis {{\n{text}\n}}\nmodel Whole {{\n  CarAxis:car\n{probes}\n}}\n");
    let compiled = with(Options::new().method("collocation8").model("Whole"), &scene);
    let mut sim = start(&compiled, Steps::tolerance(1e-10));
    advance(&mut sim, 0.5);
    for (name, wanted) in ["xl_at", "yl_at", "xr_at", "yr_at"].into_iter().zip(wanted) {
        close(probe(&mut sim, name), wanted, 1e-10, name);
    }
}
