//! Collocation: its orders, its balance at any step, and what Radau loses.

use crate::common::{all_scenes, close, end, file, finish, models, probe, start, with};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};

const RLC: &str = "model Rlc(phi0 = 1 V*s, Is = 1 A) {
  Se:u = 2 V * sin(1.7 rad/s * t)
  I:coil { H = Is*phi0*log(cosh(p/phi0)) }
  R:res = 0.5 Ohm
  C:cap { H = 0.5*q^2/1 F + 0.25*q^4/(1 C^2*1 F) }
  u -> 1:i -> coil, res, cap
  probe x = cap.q
}";

const DRAG: &str = "model Drag(k = 1 N/m, k3 = 1 N/m^3, b = 0.3 N*s/m, b3 = 0.5 N*s^3/m^3) {
  C:spring { H = 0.5*k*q^2 + 0.25*k3*q^4;  q0 = 1 m }
  I:mass = 1 kg
  R:drag { e = b*f + b3*f^3 }
  1:v -> spring, mass, drag
  probe x = spring.q
}";

const PENDULUM: &str = "model Pendulum {
  I:rotor { inertia = 0.25 kg*m^2 }
  C:gravity { H = 4.9 J * (1 - cos(q)); q0 = 2 rad }
  1:w -> rotor, gravity
  probe x = gravity.q
}";

/// The Gauss methods, with their orders.
const GAUSS: [(&str, f64); 5] = [
    ("collocation4", 4.0),
    ("collocation6", 6.0),
    ("collocation8", 8.0),
    ("collocation10", 10.0),
    ("collocation12", 12.0),
];

/// The orders by halving, as long as differences of the results are above rounding.
fn orders(text: &str, method: &str, first: f64, stop: f64) -> Vec<f64> {
    let compiled = with(Options::new().method(method), text);
    let ends: Vec<f64> = (0..6).map(|k| end(&compiled, Steps::fixed(first / f64::from(1 << k)), stop, "x")).collect();
    let off: Vec<f64> = ends.windows(2).map(|e| (e[0] - e[1]).abs()).take_while(|e| *e > 2e-13).collect();
    off.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

#[test]
fn gauss_has_twice_its_stages_as_order() {
    for (text, first, stop) in [(PENDULUM, 0.2, 5.0), (RLC, 0.2, 4.0), (DRAG, 0.25, 3.0)] {
        for (method, order) in &GAUSS[..3] {
            let found = orders(text, method, first, stop);
            assert!(found.len() >= 2 || *order > 6.0, "{method}: {found:?}");
            if let Some(last) = found.last() {
                assert!((last - order).abs() < 0.1 || (*order > 6.0 && *last > order - 0.5), "{method}: {found:?}");
            }
        }
        let radau = orders(text, "radau", first, stop);
        assert!(radau.last().is_some_and(|o| (o - 5.0).abs() < 0.1), "radau: {radau:?}");
    }
}

/// A condenser across a source, and an inertia that a rack drives, beside what the source drives through resistance.
#[test]
fn what_follows_a_source_keeps_order_and_balance() {
    let text = "model Follows {
      Se:u = (10 V)*sin((100 rad/s)*t)
      C:c = 10 uF
      R:r = 5 Ohm
      I:l = 20 mH
      u -> 0:n -> c
      n -> 1:b -> r, l
      probe x = l.f
      probe i = u.f
    }";
    for (method, order) in &GAUSS[..3] {
        let found = orders(text, method, 0.01, 0.1);
        let near = |o: &f64| (o - order).abs() < 0.3 || (*order > 6.0 && *o > 6.5);
        assert!(found.last().is_some_and(near), "{method}: {found:?}");
    }
    // By default, order 8: Z = R + i w L, and what dies away with R/L.
    let compiled = with(Options::new(), text);
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 0.1);
    let (r, l, w, t) = (5.0f64, 0.02f64, 100.0f64, 0.1f64);
    let through =
        10.0 / (r * r + w * w * l * l) * (r * (w * t).sin() - w * l * (w * t).cos() + w * l * (-r * t / l).exp());
    close(probe(&mut sim, "x"), through, 1e-6, "through the coil");
    close(probe(&mut sim, "i"), through + 1e-5 * 10.0 * w * (w * t).cos(), 1e-6, "from the source");
    let summary = sim.summary();
    assert_eq!(summary.regions[0].stepper, "collocation8");
    assert!(summary.passive && summary.worst_step < 1e-14 && summary.regions[0].steps < 200, "{summary:?}");
}

/// Two condensers in a loop with a source that is a number: `radau` steps what follows it, as the charge of one tells
/// that of the other; of a source that moves it does not.
#[test]
fn a_constant_source_leads_nothing() {
    let text = |law: &str| {
        format!(
            "model Divider {{
              Se:u = {law}
              C:a = 3 uF
              C:b {{ compliance = 1 uF; e0 = 2 V }}
              R:r = 1 kOhm
              u -> 1:loop -> a
              loop -> 0:n -> b, r
              probe x = b.e
              probe i = u.f
            }}"
        )
    };
    let compiled = with(Options::new().method("radau"), &text("5 V"));
    let (t, tau) = (5e-3f64, 4e-3f64);
    let wanted = 2.0 * (-t / tau).exp();
    let off = [1e-3, 5e-4].map(|h| (end(&compiled, Steps::fixed(h), t, "x") - wanted).abs());
    assert!(off[0] < 1e-6 && (off[0] / off[1]).log2() > 4.8, "{off:?}");
    let mut sim = start(&compiled, Steps::fixed(1e-4));
    finish(&mut sim, t);
    // The one that is charged takes what the other loses, and the resistor what flows.
    close(probe(&mut sim, "i"), wanted * 3e-6 / tau, 1e-12, "from the source");
    let summary = sim.summary();
    assert!(summary.passive && summary.worst_step < 1e-14, "{summary:?}");
    let moves = Options::new().method("radau").compile_str("moves.bond", text("5 V * sin(t * 1 rad/s)"));
    assert!(moves.is_err_and(|e| e.list()[0].message.contains("follows a moving source")));
}

/// Fields of several states, which take the stages apart.
#[test]
fn order_eight_on_fields() {
    for (name, scene, stop, first) in [("henon_heiles", "HenonHeiles", 10.0, 0.5), ("kepler", "Kepler", 3.0, 0.2)] {
        let path = models().join(format!("classics/{name}.bond"));
        let compiled = file(&path, Options::new().model(scene).method("collocation8"));
        let ends: Vec<[f64; 2]> = (0..4)
            .map(|k| ["x", "y"].map(|p| end(&compiled, Steps::fixed(first / f64::from(1 << k)), stop, p)))
            .collect();
        let off: Vec<f64> = ends.windows(2).map(|e| (e[0][0] - e[1][0]).abs().max((e[0][1] - e[1][1]).abs())).collect();
        let order = (off[0] / off[1]).log2();
        assert!((order - 8.0).abs() < 0.2, "{name}: {order} of {off:?}");
    }
}

/// Whatever the step: a quadrature that cannot see the energy any more makes the step shorter, or another stepper takes
/// it.
#[test]
fn the_balance_holds_at_any_step() {
    for text in [PENDULUM, RLC, DRAG] {
        for (method, _) in GAUSS {
            let compiled = with(Options::new().method(method), text);
            for h in [0.01, 0.3, 3.0, 40.0, 1000.0] {
                let mut sim = start(&compiled, Steps::fixed(h));
                finish(&mut sim, 50.0 * h);
                let summary = sim.summary();
                assert!(summary.passive, "{method} at {h}: {:?}", summary.reasons);
                assert!(summary.worst_step < 1e-12, "{method} at {h}: {}", summary.worst_step);
            }
        }
    }
}

/// What rounded coefficients take is the same in each step: by them it would go off by up to 4e-12.
#[test]
fn energy_does_not_drift() {
    for (method, _) in GAUSS {
        let compiled = with(Options::new().method(method), PENDULUM);
        let mut sim = start(&compiled, Steps::fixed(0.125));
        finish(&mut sim, 5e4);
        let r = &sim.summary().regions[0];
        let off = (r.h_final - r.h_initial).abs() / r.h_initial;
        assert!(r.steps >= 400_000 && off < 3e-13, "{method}: {off:e}");
    }
}

/// A stiff oscillator beside a slow one: Radau damps it and books what that costs; Gauss keeps it.
#[test]
fn radau_books_its_loss() {
    let text = "model Stiff {
      I:slow = 1 kg
      C:soft { stiffness = 1 N/m;  q0 = 1 m }
      1:v -> slow, soft
      I:fast = 1 kg
      C:hard { stiffness = 1e12 N/m;  q0 = 1e-6 m }
      1:w -> fast, hard
      probe e_slow = soft.H + slow.H
      probe e_fast = hard.H + fast.H
    }";
    let compiled = with(Options::new().method("radau"), text);
    let mut sim = start(&compiled, Steps::fixed(0.01));
    finish(&mut sim, 10.0);
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
    let lost: Vec<f64> = summary.regions.iter().flat_map(|r| &r.resistors).map(|r| r.energy).collect();
    assert!(lost.iter().all(|w| *w >= 0.0) && lost.iter().sum::<f64>() > 0.49, "{lost:?}");
    assert!(summary.regions.iter().flat_map(|r| &r.resistors).all(|r| r.name == "numerical loss"));
    assert!(probe(&mut sim, "e_fast") < 1e-20);
    close(probe(&mut sim, "e_slow"), 0.5, 1e-3, "the slow one's energy");

    let compiled = with(Options::new().method("collocation6"), text);
    let mut sim = start(&compiled, Steps::fixed(0.01));
    finish(&mut sim, 10.0);
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
    close(probe(&mut sim, "e_fast"), 0.5, 1e-9, "the fast one's energy");
}

/// However stiff an oscillator is for the step, rounding is no more than that of its energy.
#[test]
fn stiff_linear_oscillators_keep_the_balance_to_rounding() {
    for stiffness in ["1e4", "1e8", "1e12", "1e15"] {
        let text =
            format!("model Stiff {{ I:m = 1 kg  C:k {{ stiffness = {stiffness} N/m;  q0 = 1 mm }}  1:v -> m, k }}");
        for (method, _) in GAUSS {
            let compiled = with(Options::new().method(method), &text);
            let mut sim = start(&compiled, Steps::fixed(0.01));
            finish(&mut sim, 20.0);
            let summary = sim.summary();
            assert!(summary.passive && summary.worst_step < 1e-13, "{method}, {stiffness} N/m: {}", summary.worst_step);
        }
    }
}

/// Every scene that runs, runs with it: passive wherever the default stepper is.
#[test]
fn every_scene_takes_it() {
    for (title, path, scene) in all_scenes() {
        let by_default = file(&path, Options::new().model(&scene));
        let Ok(compiled) = Options::new().model(&scene).method("collocation6").compile_file(&path) else {
            // A storage that follows a source beside an energy that is not quadratic; the message says so.
            let errors = Options::new().model(&scene).method("collocation6").compile_file(&path).err();
            let text = errors.map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains("follows a source"), "{title}: {text}");
            continue;
        };
        let Some(stop) = by_default.stages().model.settings.stop else { continue };
        let summary = |c: &bond::Compiled| {
            let mut sim = start(c, Steps::fixed(stop / 400.0));
            sim.finish(stop).map(|()| sim.summary())
        };
        if let (Ok(one), Ok(other)) = (summary(&by_default), summary(&compiled)) {
            assert!(other.passive || !one.passive, "{title}: {:?}", other.reasons);
        }
    }
}

/// An angle with a product of states in it moves in more than its changes.
#[test]
fn angles_may_be_products() {
    let text = "model P {
      IC(I p1, I p2, C q1, C q2):arm {
        H = (p1^2 + p2^2)/(2 kg*m^2) + 3 J * (1 - cos(q1 + 0.3*q1*q2)) + 2 J * (1 - cos(q2))
        q1_0 = 90 deg;  q2_0 = 60 deg
      }
      1:w1 -> arm.p1, arm.q1
      1:w2 -> arm.p2, arm.q2
      probe a = arm.q1
    }";
    for (method, _) in GAUSS {
        let compiled = with(Options::new().method(method), text);
        let mut sim = start(&compiled, Steps::fixed(0.01));
        finish(&mut sim, 10.0);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step < 1e-14, "{method}: {}", summary.worst_step);
    }
}
