//! `projected8`: an explicit step of order 8 that is put back on the balance. Its order, what it keeps beside the
//! energy, and that it is passive at any step.

use crate::common::{advance, close, end, file, finish, models, probe, read, start, with};
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use bond_tests::random;

fn projected(model: &str) -> Compiled {
    with(Options::new().method("projected8"), model)
}

const DUFFING: &str = "model Duffing {
  I:m = 1 kg
  C:s { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4;  q0 = 1 m }
  1:v -> m, s
  probe x = s.q
}";

const DRIVEN: &str = "model Driven {
  Se:push = (0.5 N)*cos(1 rad/s * t)
  I:m = 1 kg
  R:d { e = (0.1 N*s/m)*f + (0.05 N*s^3/m^3)*f^3 }
  C:s { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4;  q0 = 1 m }
  push -> 1:v -> m, s, d
  probe x = s.q
}";

/// Two bodies that nothing holds, with a spring between them; the counters tell what the spring is stretched by.
const FREE: &str = "model Free {
  I:a { inertia = 1 kg; f0 = 0.3 m/s }
  I:b { inertia = 2.5 kg; f0 = -0.4 m/s }
  C:s { H = 0.5*(3 N/m)*q^2 + 0.25*(2 N/m^3)*q^4;  q0 = 1 m }
  1:va -> a, f
  0:f -> s
  f -> 1:vb -> b
  probe momentum = a.p + b.p
  probe gap = s.q - integral(a.f, 1 m) + integral(b.f, 0 m)
}";

/// By halving a step twice, against `collocation12` at an eighth of the shortest one.
#[test]
fn it_has_order_8() {
    let of = |name: &str| read(&models().join(format!("classics/{name}.bond")));
    let cases = [
        ("duffing", DUFFING.to_string(), 50.0, 0.2, "x"),
        ("driven and damped", DRIVEN.to_string(), 20.0, 0.4, "x"),
        ("pendulum", of("pendulum"), 10.0, 0.08, "angle"),
        ("henon_heiles", of("henon_heiles"), 20.0, 0.4, "x"),
        ("kepler", of("kepler"), 12.0, 0.06, "y"),
    ];
    let mut wrong = false;
    for (name, model, stop, step, what) in cases {
        let fine = with(Options::new().method("collocation12"), &model);
        let compiled = projected(&model);
        let wanted = end(&fine, Steps::fixed(step / 32.0), stop, what);
        let off = |h: f64| (end(&compiled, Steps::fixed(h), stop, what) - wanted).abs();
        let errors = [step, step / 2.0, step / 4.0].map(off);
        // Below 1e-13 rounding is what is left.
        let pairs = errors.windows(2).filter(|e| e[1] > 1e-13);
        let orders: Vec<f64> = pairs.map(|e| (e[0] / e[1]).log2()).collect();
        println!("{name}: {orders:?} {errors:?}");
        wrong |= orders.is_empty() || orders.iter().any(|o| (o - 8.0).abs() > 0.2);
    }
    assert!(!wrong, "orders that are not 8 within 0.2 are among those above");
}

/// What is linear in the states and constant stays so to rounding, over a million steps, and so does the energy.
#[test]
fn momentum_and_counters_stay_over_a_million_steps() {
    let compiled = projected(FREE);
    let mut sim = start(&compiled, Steps::fixed(0.05));
    let first = probe(&mut sim, "momentum");
    finish(&mut sim, 50_000.0);
    close(probe(&mut sim, "momentum"), first, 1e-12, "momentum");
    close(probe(&mut sim, "gap"), 0.0, 1e-12 * 20_000.0, "the spring against the counters, which go 20 km");
    let summary = sim.summary();
    assert!(summary.passive && summary.regions[0].steps >= 1_000_000, "{:?}", summary.reasons);
    assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-12, "{} {}", summary.worst_step, summary.total);
}

/// The angular momentum of a body that turns freely has a constant square, which a direction along the rates keeps to
/// first order alone.
#[test]
fn angular_momentum_stays_over_a_million_steps() {
    let path = models().join("classics/rigid_body.bond");
    let compiled = file(&path, Options::new().method("projected8"));
    let mut sim = start(&compiled, Steps::fixed(0.02));
    let first = [probe(&mut sim, "momentum"), probe(&mut sim, "energy")];
    finish(&mut sim, 20_000.0);
    close(probe(&mut sim, "momentum"), first[0], 1e-12 * first[0], "momentum");
    close(probe(&mut sim, "energy"), first[1], 1e-12 * first[1], "energy");
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
}

/// A handle on a spring that hardens, at a wall that is held: the held force times the way is what crossed, on both
/// sides.
#[test]
fn what_is_held_is_in_the_balance() {
    let compiled = projected(
        "model Held {
          I:handle { inertia = 1 kg; f0 = 1 m/s }
          C:hand { H = 0.5*(20 N/m)*q^2 + 0.25*(500 N/m^3)*q^4 }
          R:grip { e = (0.5 N*s/m)*f + (0.2 N*s^3/m^3)*f^3 }
          1:v -> handle, hand, grip
          sampled at 200 Hz { C:wall = 0.01 m/N  R:b = 1 N*s/m  1:w -> wall, b }
          v ||> w
          probe x = hand.q
        }",
    );
    for steps in [Steps::new(), Steps::fixed(0.005), Steps::tolerance(1e-8)] {
        let mut sim = start(&compiled, steps);
        finish(&mut sim, 20.0);
        let summary = sim.summary();
        assert!(summary.passive, "{:?}", summary.reasons);
        assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-11, "{} {}", summary.worst_step, summary.total);
        assert!(summary.bars.iter().all(|b| b.difference == 0.0));
    }
}

/// A source alone, or several storages that a source keeps apart: each block has a balance of its own.
#[test]
fn blocks_have_balances_of_their_own() {
    let compiled = projected(
        "model Blocks {
          Sf:shake = (0.3 m/s)*sin(2 rad/s * t)
          I:a = 1 kg
          C:ca { H = 0.5*(2 N/m)*q^2 + 0.25*(3 N/m^3)*q^4;  q0 = 0.3 m }
          I:b = 0.7 kg
          C:cb { H = 0.5*(5 N/m)*q^2 + 0.25*(1 N/m^3)*q^4 }
          C:alone { H = 0.5*(5 N/m)*q^2 + 0.25*(9 N/m^3)*q^4 }
          shake -> 1:v -> alone
          v -> 0:fa -> ca
          fa -> 1:va -> a
          v -> 0:fb -> cb
          fb -> 1:vb -> b
          probe xa = ca.q
          probe xb = cb.q
        }",
    );
    for steps in [Steps::new(), Steps::fixed(0.1), Steps::tolerance(1e-10)] {
        let mut sim = start(&compiled, steps);
        finish(&mut sim, 100.0);
        let summary = sim.summary();
        assert!(summary.passive, "{:?}", summary.reasons);
        assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-11, "{} {}", summary.worst_step, summary.total);
    }
}

/// Friction warms a body: what is moved onto the balance is the motion, so that no entropy falls.
#[test]
fn entropies_do_not_fall() {
    let compiled = projected(
        "use std.thermal
        model Warm {
          I:m = 1 kg
          C:s { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4;  q0 = 1 m }
          RS(r, th):damper = 0.05 N*s/m
          Body:body(C = 1 J/K, T0 = 300 K)
          1:v -> m, s
          v -> damper.r
          damper.th -> 0:T -> body.heat
          probe S = body.entropy.q
          probe x = s.q
        }",
    );
    let mut sim = start(&compiled, Steps::tolerance(1e-6));
    let mut before = probe(&mut sim, "S");
    for n in 1..=2000 {
        advance(&mut sim, 0.05 * f64::from(n));
        let now = probe(&mut sim, "S");
        assert!(now >= before, "{before} -> {now}");
        before = now;
    }
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
}

/// Random graphs that it takes are passive at a step, long or short, and at tolerances. What it does not take it
/// refuses in words.
#[test]
fn random_graphs_are_passive() {
    let mut taken = 0;
    for model in random::graphs(60) {
        let compiled = match Options::new().method("projected8").compile_str("random.bond", &model) {
            Ok(compiled) => compiled,
            Err(errors) => {
                let why = errors.to_string();
                let plain = Options::new().compile_str("random.bond", &model).is_err();
                assert!(plain || why.contains("cannot step the region"), "{why}\n{model}");
                continue;
            }
        };
        for steps in [Steps::fixed(0.01), Steps::fixed(0.2), Steps::tolerance(1e-5), Steps::tolerance(1e-9)] {
            let mut sim = start(&compiled, steps);
            if sim.finish(0.4).is_err() {
                continue;
            }
            let summary = sim.summary();
            assert!(summary.passive, "{:?}\n{model}", summary.reasons);
            assert!(summary.worst_step <= 1e-12, "{}\n{model}", summary.worst_step);
            taken += 1;
        }
    }
    assert!(taken >= 60, "{taken}");
}

/// A soft spring beside one that is a million times as stiff, and damped.
const STIFF: &str = "model Stiff {
  I:m = 1 kg
  C:soft { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4;  q0 = 1 m }
  I:n = 0.1 kg
  C:hard { H = 0.5*(1e6 N/m)*q^2 + 0.25*(1e6 N/m^3)*q^4;  q0 = 1 mm }
  R:damp { e = (1e3 N*s/m)*f + (1e3 N*s^3/m^3)*f^3 }
  1:v -> m, soft
  v -> 0:f -> 1:r -> hard, damp
  f -> 1:w -> n
  probe x = soft.q
}";

/// Steps, and how many of them the fallback took, with a bound of stability so many times as large.
fn fallback_steps(model: &str, tolerance: f64, bound: f64) -> (u64, u64) {
    let compiled = with(Options::new(), model);
    let mut scene = compiled.scene().clone();
    assert_eq!(scene.clusters[0].step.name, "projected8");
    scene.numeric.controller.stable *= bound;
    let settings = &compiled.stages().model.settings;
    let options = Steps::tolerance(tolerance).resolve(settings, 20.0, None).expect("options");
    let mut sim = Simulation::new(&scene, &options).expect("a start");
    sim.finish(20.0).expect("a run");
    let summary = sim.summary();
    assert!(summary.passive && summary.worst_step <= 1e-12, "{:?}", summary.reasons);
    let region = &summary.regions[0];
    (region.steps, region.fallback.as_ref().map_or(0, |f| f.1))
}

/// What is stiff goes to the fallback, which takes a hundredth of the steps; what is not does not. Ten times the bound
/// finds nothing stiff, a tenth of it finds all so.
#[test]
fn stiffness_is_found() {
    let (steps, fallback) = fallback_steps(STIFF, 1e-6, 1.0);
    assert!(steps < 1000 && fallback > 10, "{fallback} of {steps}");
    assert!(fallback_steps(STIFF, 1e-6, 10.0).0 > 4000);
    assert_eq!(fallback_steps(DUFFING, 1e-3, 1.0).1, 0);
    assert!(fallback_steps(DUFFING, 1e-3, 0.1).1 > 0);
}

/// What an explicit step does not take is said, with what is there.
#[test]
fn what_it_refuses_is_said() {
    let refused = |model: &str| match Options::new().method("projected8").compile_str("test.bond", model) {
        Ok(_) => panic!("this compiles, and should not"),
        Err(errors) => errors.to_string(),
    };
    let dry = refused(
        "model Dry { Se:p = 5 N  I:m = 1 kg  R:dry { e = min(max(s, -1), 1)*(3 N); f = (s - min(max(s, -1), 1))*(1 m/s) }
         p -> 1:v -> m, dry }",
    );
    assert!(dry.contains("vertical and horizontal branches"), "{dry}");
    let follows = refused("model Follows { Se:u = 10 V * sin(100 Hz * t)  C:c = 1 uF  u -> c }");
    assert!(follows.contains("a storage follows a source"), "{follows}");
}
