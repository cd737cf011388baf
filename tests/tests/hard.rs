//! The hard cases of `models/hard/`: what of their page can be asserted in a short time.

use crate::common::{file, models, run, scenes, stop, texts, title};
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps, Summary};
use bond_compiler::discretise::Method;

/// Passive steppers that take a whole scene.
fn passive(name: &str, options: &Options) -> Vec<(&'static str, Compiled)> {
    let path = models().join("hard").join(format!("{name}.bond"));
    let by = |m: Method| Some((m.name(), options.clone().method(m.name()).compile_file(&path).ok()?));
    let takes = |(name, c): &(&str, Compiled)| {
        c.scene().clusters.iter().all(|c| c.step.properties.passive && c.step.name == *name)
    };
    let list: Vec<_> = Method::ALL.into_iter().filter_map(by).filter(takes).collect();
    assert!(!list.is_empty(), "{name}: no passive stepper takes it");
    list
}

#[test]
fn every_hard_case_balances() {
    for (path, text) in texts("hard") {
        for scene in scenes(&text) {
            let title = format!("{} {scene}", title(&path));
            let compiled = file(&path, Options::new().model(&scene));
            let summary = run(&compiled).unwrap_or_else(|e| panic!("{title}: {e}"));
            let worst = summary.worst_step;
            assert!(worst <= 1e-12, "{title}: a step's balance is off by {worst:e}");
            for bar in &summary.bars {
                assert_eq!(bar.difference, 0.0, "{title}: the sides of `{}` differ", bar.name);
            }
        }
    }
}

#[test]
fn every_hard_case_is_on_the_page() {
    let page = crate::common::read(std::path::Path::new("../docs/inside/hard-cases.md"));
    for (path, _) in texts("hard") {
        let name = format!("`{}`", path.file_stem().unwrap_or_default().to_string_lossy());
        assert!(page.contains(&name), "docs/inside/hard-cases.md says nothing of {name}");
    }
}

/// Parameters of no physics end in an error, or in numbers that are numbers.
#[test]
fn hostile_parameters_end_clearly() {
    let list = ["1e-300", "1e300", "0", "5e-324", "-1", "1.7976931348623157e308"];
    for name in ["m", "k", "beta", "b", "x0", "v0", "u"] {
        for value in list {
            ends_clearly("hostile", name, value, Some(0.2));
        }
    }
    for value in list {
        ends_clearly("sampled", "ratio", value, Some(0.2));
        ends_clearly("diode_clipper", "v_t", value, Some(1e-4));
        ends_clearly("thermal", "C2", value, Some(1e-3));
        ends_clearly("kepler", "e", value, Some(0.1));
        ends_clearly("coulomb", "F", value, Some(0.1));
        ends_clearly("hertz_chain", "k", value, Some(1e-5));
        ends_clearly("gear_chain", "ratio", value, Some(0.1));
    }
    for value in ["NaN", "nan", "inf", "-inf", "1e999"] {
        let path = models().join("hard/hostile.bond");
        assert!(Options::new().set("m", value).compile_file(&path).is_err(), "m = {value} is taken");
    }
}

fn ends_clearly(name: &str, parameter: &str, value: &str, until: Option<f64>) {
    let title = format!("{name} with {parameter} = {value}");
    let path = models().join("hard").join(format!("{name}.bond"));
    let compiled = match Options::new().set(parameter, value).compile_file(&path) {
        Ok(compiled) => compiled,
        Err(errors) => return assert!(!errors.to_string().trim().is_empty(), "{title}: an error without words"),
    };
    let end = until.unwrap_or_else(|| stop(&compiled));
    let settings = &compiled.stages().model.settings;
    let options = Steps::new().resolve(settings, end, None).unwrap_or_else(|e| panic!("{title}: {e}"));
    // What would make more steps than anybody waits for, the command refuses.
    if compiled.scene().clusters.iter().any(|c| c.period.is_some_and(|p| end / p > 1e6)) {
        return;
    }
    let mut sim = match Simulation::new(compiled.scene(), &options) {
        Ok(sim) => sim,
        Err(e) => return assert!(!e.to_string().is_empty(), "{title}: an error without words"),
    };
    let done = sim.finish(end);
    if let Err(e) = &done {
        assert!(!e.to_string().is_empty(), "{title}: an error without words");
    }
    let summary = sim.summary();
    for r in &summary.regions {
        for x in [r.h_final, r.supplied, r.dissipated, r.worst_step, r.total] {
            assert!(!x.is_nan() || done.is_err(), "{title}: the ledger of `{}` has a NaN", r.name);
        }
    }
    // What expectations look at comes after the probes, and may be 0/0 by what they say.
    let probes = compiled.probes().len();
    if done.is_ok()
        && let Ok(values) = sim.probes()
    {
        assert!(values[..probes].iter().all(|x| !x.is_nan()), "{title}: a probe is NaN");
    }
}

fn take(compiled: &Compiled, title: &str, h: f64, steps: f64) -> (Summary, f64) {
    let mut sim = compiled.simulate(Steps::fixed(h)).unwrap_or_else(|e| panic!("{title}: {e}"));
    let start = sim.summary().regions[0].h_final;
    let mut most = 0.0f64;
    for k in 1..=100 {
        sim.advance(f64::from(k) / 100.0 * steps * h).unwrap_or_else(|e| panic!("{title}: {e}"));
        let now: f64 = sim.summary().regions[0].h_final;
        most = most.max((now - start).abs() / start.abs());
    }
    (sim.summary(), most)
}

/// Time constants 1e12 apart, steps from 1e-3 to 1e3 of the fastest: the balance closes to rounding, and nothing grows.
#[test]
fn stiffness_of_1e12_does_not_grow() {
    for exponent in -3..=3 {
        let h = 1e-12 * 10f64.powi(exponent);
        for (method, compiled) in passive("stiff_circuit", &Options::new()) {
            let title = format!("stiff_circuit, {method}, h = {h:e} s");
            let (s, _) = take(&compiled, &title, h, 2000.0);
            let r = &s.regions[0];
            assert!(s.passive, "{title}: {}", s.reasons.join("; "));
            assert!(s.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", s.worst_step);
            assert!(r.h_final <= (r.h_initial + r.supplied) * (1.0 + 1e-12), "{title}: H grew to {:e}", r.h_final);
        }
        let h = h * 0.5f64.sqrt() * 1e6;
        for scene in ["StiffOscillator", "StiffHardening"] {
            for (method, compiled) in passive("stiff_oscillator", &Options::new().model(scene)) {
                let title = format!("{scene}, {method}, h = {h:e} s");
                let (s, most) = take(&compiled, &title, h, 2000.0);
                assert!(s.passive, "{title}: {}", s.reasons.join("; "));
                assert!(s.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", s.worst_step);
                // Radau's loss is in the ledger.
                assert!(most <= 1e-10 || method == "radau", "{title}: the energy is off by {most:e}");
            }
        }
    }
}

/// Without loss the energy stays, over 1e5 steps: a hundredth of the bar over 1e7 steps, 1e-10.
#[test]
fn energy_does_not_drift() {
    let mut list: Vec<(String, Options, f64, f64)> = Vec::new();
    for w in ["1e-3", "1", "1e3"] {
        list.push(("undamped".into(), Options::new().model("Undamped").set("w", &format!("{w} rad/s")), 1.0, 1e5));
    }
    list.push(("pendulum_over".into(), Options::new(), 0.02, 1e5));
    list.push(("pendulum_over".into(), Options::new().set("excess", "-0.05"), 0.02, 1e5));
    list.push(("fput".into(), Options::new(), 0.1, 1e4));
    list.push(("fput".into(), Options::new().model("FputAlpha"), 0.1, 1e4));
    for (name, options, h, steps) in list {
        for (method, compiled) in passive(&name, &options) {
            let title = format!("{name}, {method}");
            let (s, most) = take(&compiled, &title, h, steps);
            // Far beyond the fastest time a step's equations have rounding of their own; `exact` has not, and is the
            // default there.
            let far = ["undamped, collocation", "undamped, projected8"].iter().any(|t| title.starts_with(t));
            let bar = if far { 1e-8 } else { 1e-10 };
            assert!(most <= bar || method == "radau", "{title}: the energy is off by {most:e}");
            assert!(s.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", s.worst_step);
        }
    }
}

/// Nor have products of coefficients, of numbers whose binary digits repeat, and what an iteration leaves: each of them
/// took 1e-19 and more of the energy of such a spring in each step.
#[test]
fn products_and_iterations_have_no_side() {
    for (mass, stiffness, method) in [
        ("0.7 kg", "0.3 N/m", "gonzalez"),
        ("0.7 kg", "1 N/m", "gonzalez"),
        ("0.7 kg", "0.3 N/m", "collocation4"),
        ("0.7 kg", "1 N/m", "collocation6"),
    ] {
        let title = format!("{mass}, {stiffness}, {method}");
        let text = format!(
            "model Spring() {{\n  I:mass = {mass}\n  C:spring {{ H = 0.5*({stiffness})*q^2 + 0.25*(0.3 N/m^3)*q^4; q0 = 0.1 m }}\n  \
             1:v -> mass, spring\n  simulate {{ stop = 1 s; step = 0.1 s }}\n}}\n"
        );
        let compiled = Options::new().method(method).compile_str("spring.bond", text);
        let compiled = compiled.unwrap_or_else(|e| panic!("{title}: {e}"));
        let (_, most) = take(&compiled, &title, 0.1, 1e6);
        assert!(most <= 6e-14, "{title}: the energy is off by {most:e}");
    }
}

/// The same where each stage is eliminated apart: a chain of such springs in disorder. It was off by 1.3e-14.
#[test]
fn a_chain_in_disorder_has_no_side() {
    let text = "model Chain(n = 32) {\n  for i in 1..n-1 { I:mass[i] = 1 kg }\n  for i in 1..n {\n    \
                C:spring[i] { H = 0.5*(1 N/m)*q^2 + 0.25*(8 N/m^3)*q^4; q0 = (0.07 m)*sin(2.7*i*i) }\n    \
                0:force[i] -> spring[i]\n  }\n  for i in 1..n-1 {\n    1:v[i] -> mass[i], force[i]\n    \
                force[i+1] -> v[i]\n  }\n  simulate { stop = 1 s; step = 0.1 s }\n}\n";
    let compiled = Options::new().method("collocation6").compile_str("chain.bond", text);
    let compiled = compiled.unwrap_or_else(|e| panic!("{e}"));
    let (_, most) = take(&compiled, "chain", 0.1, 2e5);
    assert!(most <= 8e-15, "the energy is off by {most:e}");
}

/// Rounding has no side: 5e5 steps of a pendulum, of which it takes 1e-16 each, come to what it makes at random, also
/// where the angle has grown to 1e5 turns.
#[test]
fn rounding_has_no_side() {
    for (method, h) in [("gonzalez", 0.02), ("gonzalez", 0.1), ("collocation4", 0.1)] {
        for excess in ["-0.05", "0.2"] {
            let title = format!("{method}, excess {excess}, {h} s");
            let options = Options::new().method(method).set("excess", excess);
            let compiled = file(&models().join("hard/pendulum_over.bond"), options);
            let (s, most) = take(&compiled, &title, h, 5e5);
            assert!(most <= 8e-14, "{title}: the energy is off by {most:e}");
            assert!(s.worst_step <= 1e-14, "{title}: a step's balance is off by {:e}", s.worst_step);
        }
    }
}
