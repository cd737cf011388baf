//! The invariants of the ledger, on every model: each step's balance closes, and both sides of a double bar count the
//! same.

use crate::common::{all_scenes, file, finish, run, start, stop, with};
use bond::internal::CompiledInternals;
use bond::{Options, Steps, Summary};

fn assert_balanced(title: &str, summary: &Summary) {
    assert!(summary.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", summary.worst_step);
    assert!(summary.total <= 1e-10, "{title}: the total is off by {:e}", summary.total);
    for bar in &summary.bars {
        assert_eq!(bar.difference, 0.0, "{title}: the sides of `{}` differ", bar.name);
        assert_eq!(bar.holder.to_bits(), bar.other.to_bits(), "{title}: the sides of `{}` differ", bar.name);
    }
    for r in &summary.regions {
        // The ledger's own sums: dH = supplied - dissipated, whatever leaked.
        let off = (r.h_final - r.h_initial - r.supplied + r.dissipated - r.leaked).abs();
        let off = off.min((r.h_final - r.h_initial - r.supplied + r.dissipated).abs());
        // Sources that feed each other may turn over much more than they supply together.
        let turned = r.sources.iter().map(|e| e.energy.abs()).sum::<f64>();
        let size = r.h_max.max(turned).max(r.dissipated.abs());
        assert!(off <= 1e-10 * size, "{title}: the sums of `{}` do not close: off by {off:e} of {size:e}", r.name);
        for e in &r.resistors {
            // A field is active by its ports.
            let active = ["`", "."].map(|end| format!("active `{}{end}", e.name));
            let give = summary.reasons.iter().any(|why| active.iter().any(|a| why.contains(a)));
            assert!(give || e.energy >= -1e-12 * size, "{title}: `{}` gave {:e} J", e.name, e.energy);
        }
    }
}

#[test]
fn every_model_balances() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let summary = run(&compiled).unwrap_or_else(|e| panic!("{title}: {e}"));
        assert_balanced(&title, &summary);
    }
}

#[test]
fn every_model_balances_under_gonzalez() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene).method("gonzalez"));
        let end = stop(&compiled);
        let step = compiled.stages().model.settings.step.unwrap_or(end / 2000.0);
        let mut sim = compiled.simulate(Steps::fixed(step)).unwrap_or_else(|e| panic!("{title}: {e}"));
        sim.finish(end).unwrap_or_else(|e| panic!("{title}: {e}"));
        assert_balanced(&title, &sim.summary());
    }
}

/// Every model runs without being told a step or a method, or with the method only.
#[test]
fn every_model_runs_with_fitted_steps() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene).method("gonzalez"));
        let mut sim = compiled.simulate(Steps::tolerance(1e-6)).unwrap_or_else(|e| panic!("{title}: {e}"));
        sim.finish(stop(&compiled)).unwrap_or_else(|e| panic!("{title}: {e}"));
        assert_balanced(&title, &sim.summary());
    }
}

/// Steps that hit no round instant, and that are far too long.
#[test]
fn odd_steps_balance() {
    for (title, path, scene) in all_scenes() {
        for method in [None, Some("gonzalez")] {
            let mut options = Options::new().model(&scene);
            if let Some(m) = method {
                options = options.method(m);
            }
            let compiled = file(&path, options);
            let end = stop(&compiled);
            for parts in [17.3, 311.7] {
                let mut sim = compiled.simulate(Steps::fixed(end / parts)).unwrap_or_else(|e| panic!("{title}: {e}"));
                // A step that is far too long may have no solution; one that was taken balances.
                let _ = sim.finish(end);
                let title = format!("{title} ({parts} steps, {method:?})");
                let summary = sim.summary();
                assert!(summary.worst_step <= 1e-12, "{title}: a step's balance is off by {:e}", summary.worst_step);
                assert!(summary.total <= 1e-10, "{title}: the total is off by {:e}", summary.total);
            }
        }
    }
}

/// The steppers that do not keep the balance say so.
#[test]
fn euler_and_rk4_are_not_called_passive() {
    let path = crate::common::models().join("examples/pendulum.bond");
    for method in ["euler", "symplectic_euler", "rk4", "rk45", "dop853"] {
        let compiled = file(&path, Options::new().method(method));
        let summary = run(&compiled).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            !summary.passive && summary.reasons.iter().any(|r| r.contains(method)),
            "{method}: {:?}",
            summary.reasons
        );
    }
}

/// A short step on a long line: the energies of `exact` are to keep their digits.
#[test]
fn a_long_line_balances_at_short_steps() {
    let path = crate::common::models().join("examples/lc_line.bond");
    let compiled = file(&path, Options::new().set("n", "24"));
    for step in [2e-6, 1e-6, 0.5e-6] {
        let mut sim = compiled.simulate(Steps::fixed(step)).unwrap_or_else(|e| panic!("{e}"));
        sim.finish(1e-3).unwrap_or_else(|e| panic!("{e}"));
        assert_balanced(&format!("lc_line at {step}"), &sim.summary());
    }
}

/// Flows that cancel leave nothing but rounding in the loop of a resistor; the run starts and balances all the same.
#[test]
fn flows_that_cancel() {
    let law = "{ H = 0.5*p^2/5 kg + 0.1 s^2/(kg^3*m^2) * p^4; p0 = 0.2 N*s }";
    let compiled = crate::common::text(&format!(
        "model Cancel {{
          I:x {law}
          I:y {law}
          R:a = 1 N*s/m
          R:b = 1 N*s/m
          1:v -> x, 0:force
          force -> a, b, y
        }}"
    ));
    let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
    crate::common::close(sim.summary().regions[0].h_initial, 0.00832, 1e-15, "H at the start");
    sim.finish(0.5).unwrap_or_else(|e| panic!("{e}"));
    assert_balanced("cancelling flows", &sim.summary());
}

/// A source that is no short decimal cancels out of a flat law: what its rounding leaves does not move the law's root.
#[test]
fn numbers_that_cancel() {
    let compiled = crate::common::text(
        "model Flat {
          I:e0 = 1 kg
          Sf:e2 = 0.30000000000000004 m/s
          R(a, b):f0 {
            a.e = 3 N*s/m * (a.f - b.f)
            b.e = 3 N*s/m * (b.f - a.f) + 0.1 N*s^3/m^3 * b.f^3
          }
          R(a, b):f1 = [[3 N*s/m, 1.5 N*s/m], [-1 N*s/m, 1 N*s/m]]
          R:loss1 = 1 N*s/m
          1:j0 -> e0
          j0 -> 0:j1
          j1 -> e2
          f0.a -> j1
          j1 -> f0.b
          j1 -> f1.a
          j0 -> f1.b
          j1 -> loss1
        }",
    );
    let mut sim = start(&compiled, Steps::fixed(0.01));
    finish(&mut sim, 0.5);
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
    assert_balanced("numbers that cancel", &summary);
}

/// An empty tank with a hole: the root has an infinite slope at 0.
#[test]
fn a_root_law_from_zero() {
    let compiled = crate::common::text(
        "model Tank {
          Sf:tap = 1e-4 m^3/s
          C:tank = 1e-6 m^3/Pa
          R:hole { f = 1e-5 m^3/s * sign(e)*sqrt(abs(e)/1 Pa) }
          tap -> 0:p -> tank, hole
        }",
    );
    let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
    sim.finish(1.0).unwrap_or_else(|e| panic!("{e}"));
    assert_balanced("tank", &sim.summary());
}

/// An active resistor stands in either causality, as any linear one.
#[test]
fn an_active_resistor_on_a_capacitor() {
    let compiled = crate::common::text(
        "model M {
          C:cap { compliance = 0.5 F; e0 = 1 V }
          active R:source = -2 Ohm
          cap -> source
          probe u = cap.e
        }",
    );
    let u = crate::common::end(&compiled, Steps::fixed(0.01), 1.0, "u");
    crate::common::close(u, 1f64.exp(), 1e-12, "u");
    // It is named with what it gave: H = 1/2 C u^2 from 0.25 J on.
    let mut sim = start(&compiled, Steps::fixed(0.01));
    finish(&mut sim, 1.0);
    let gave = 0.25 * (2f64.exp() - 1.0);
    assert_eq!(sim.summary().reasons[0], format!("active `source`, which gave {gave:.3e} J"));
}

/// The same with linear elements alone: two springs that all but balance, at rest.
#[test]
fn efforts_that_cancel() {
    let compiled = crate::common::text(
        "model Cancel {
          C:a { stiffness = 3 N/m; q0 = -0.08769999999999997 m }
          C:b { stiffness = 1 N/m; q0 = -0.26310000000000006 m }
          I:mass = 1 kg
          R:c = 1 N*s/m
          R:d = 1 N*s/m
          b -> 0:left -> 1:v -> a, 0:right
          right -> 1:w -> d
          right -> mass
          v -> 0:side -> c
        }",
    );
    let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
    crate::common::close(sim.summary().regions[0].h_initial, 0.04614774, 1e-12, "H at the start");
    sim.finish(0.5).unwrap_or_else(|e| panic!("{e}"));
    assert_balanced("cancelling efforts", &sim.summary());
}

/// A spring that begins far from where its stroke is counted from holds what the digits of the stroke can tell of how
/// far it is pressed: what rounding took from the stroke counts.
#[test]
fn a_stop_far_off_balances() {
    let stops = "model Stops {
      Se:u = (16.519406 N)*sin(t*(18.591797 rad/s))
      I:m = 1.1729354 kg
      C:near { H = if q > 0 then (67339.5875 N/m)*q^2 else 0 J; q0 = -3.265177402997781 mm }
      C:far { H = (134679.175 N/m)*max(-q - 0.3 m, 0 m)^2 }
      R:d = 0.049 N*s/m
      u -> 1:v -> m, near, far, d
    }";
    for (method, most) in [("gonzalez", 2e-13), ("collocation8", 2e-13)] {
        let compiled = with(Options::new().method(method), stops);
        for tolerance in [1e-4, 3e-5, 1e-5, 3e-6, 1e-6] {
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 3.0);
            let summary = sim.summary();
            assert!(summary.passive && summary.worst_step < most, "{method} {tolerance:e}: {}", summary.worst_step);
        }
    }
}

/// What is no number is no result, and not passive.
#[test]
fn a_source_that_has_no_value_ends_the_run() {
    let compiled = crate::common::text("model M { Se:s = 1 V * sqrt(0.5 - t/(1 s))   R:r = 1 Ohm   s -> r }");
    let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
    let error = sim.finish(1.0).expect_err("there is no root of a negative number").to_string();
    assert!(error.contains("what `s` supplies is not a finite number"), "{error}");
}

/// A controller whose parts all but cancel: at rest the balance is no better than the rounding of its efforts.
#[test]
fn a_servo_that_comes_to_rest() {
    let compiled = crate::common::text(
        "model M {
          C:ang { H = 0 }
          I:J = 0.01 kg*m^2
          R:b = 0.02 N*m*s
          MSe:u = 2 N*m * (1 rad - ang.q) - 0.1 N*m*s * w.f
          u -> 1:w -> ang, J, b
        }",
    );
    for step in [1e-3, 2e-3, 1e-2] {
        let mut sim = compiled.simulate(Steps::fixed(step)).unwrap_or_else(|e| panic!("{e}"));
        sim.finish(20.0).unwrap_or_else(|e| panic!("{e}"));
        assert_balanced("servo", &sim.summary());
    }
}

/// Dry friction that sticks from the start: what a resistor gives by rounding, while nothing has moved yet, is nothing.
#[test]
fn friction_that_sticks_from_rest() {
    let compiled = crate::common::text(
        "model M {
          Se:F = 5 N * sin(3 rad/s * t)
          I:m = 1 kg
          C:k = 0.01 m/N
          R:dry { e = 2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }
          F -> 1:v -> m, dry, k
        }",
    );
    let mut sim = compiled.simulate(Steps::fixed(1e-3)).unwrap_or_else(|e| panic!("{e}"));
    sim.finish(0.2).unwrap_or_else(|e| panic!("{e}"));
    assert_balanced("friction", &sim.summary());
}

/// Steps of hundreds and thousands of turns have many solutions, and Newton's method wanders: what it ends with is one
/// all the same.
#[test]
fn giant_steps_of_pendulums_balance() {
    let one = "model One {
  I:mass = 1 kg
  C:weight { H = 9.81 J * (1 - cos(q/(1 m))); q0 = 2 m }
  1:v -> mass, weight
}";
    let two = "model Two(m = 1 kg, l = 1 m, g = 9.81 m/s^2) {
  IC(I p1, I p2, C q1, C q2):arm {
    H = (p1^2 + 2*p2^2 - 2*p1*p2*cos(q1 - q2)) / (2*m*l^2*(1 + sin(q1 - q2)^2)) - m*g*l*(2*cos(q1) + cos(q2))
    q1_0 = 90 deg;  q2_0 = 90 deg
  }
  1:w1 -> arm.p1, arm.q1
  1:w2 -> arm.p2, arm.q2
}";
    for text in [one, two] {
        let compiled = with(Options::new().method("gonzalez"), text);
        for h in [3.0, 62.5, 200.0, 1000.0, 2238.927065294208, 3093.059959142987, 3648.246828308633, 3e4] {
            let mut sim = start(&compiled, Steps::fixed(h));
            finish(&mut sim, 2000.0 * h);
            let worst = sim.summary().worst_step;
            assert!(worst < 1e-9, "steps of {h} s: off by {worst:e}");
        }
    }
}

/// Two bodies that move together on a soft spring, with a spring between them that is 1e12 times as stiff and not quite
/// linear: its force is the small difference of large motions, and every step balances all the same.
#[test]
fn stiff_springs_that_bend_balance() {
    let text = "model Stiff {
      I:a { inertia = 1 kg; p0 = 1 N*s }
      I:b { inertia = 1 kg; p0 = 0.5 N*s }
      C:soft { H = 0.5 N/m * q^2 + 0.1 N/m^3 * q^4; q0 = 1 m }
      C:hard { H = 1e12 N/m * (0.5 * q^2 + 3/(1 m) * q^3 + 5/(1 m^2) * q^4); q0 = 1e-7 m }
      1:va -> a, soft
      1:vb -> b
      va -> 0:x -> vb
      x -> hard
    }";
    for method in ["gonzalez", "collocation4"] {
        let compiled = with(Options::new().method(method), text);
        for step in [1e-9, 1e-6, 2e-5, 2e-4, 5e-4, 7e-4] {
            let mut sim = start(&compiled, Steps::fixed(step));
            finish(&mut sim, 500.0 * step);
            let summary = sim.summary();
            assert!(summary.passive, "{method}, {step:e} s: {:?}", summary.reasons);
            assert!(summary.worst_step < 1e-12, "{method}, {step:e} s: {:e}", summary.worst_step);
        }
    }
}

/// The storage is named whose energy ends.
#[test]
fn a_storage_that_has_no_energy_ends_the_run() {
    let compiled = crate::common::text(
        "model M {
  I:m { inertia = 1 kg; f0 = 1 m/s }
  C:s { e = (1 N)*sqrt(2 - q/(1 m)) - 1.4142135623730951 N }
  active R:r { e = (-3 N*s/m)*f }
  1:v -> m, s, r
}",
    );
    let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
    let error = sim.finish(3.0).expect_err("q goes beyond 2 m").to_string();
    assert!(error.contains("`s.q`"), "{error}");
}

/// A turn of 1e148 rad in a step says nothing of where it ends.
#[test]
fn an_exact_step_beyond_all_digits_ends_the_run() {
    for (mass, stiffness) in [(1e-300, 4.0), (1.0, 1e300)] {
        let compiled = crate::common::text(&format!(
            "model M {{ I:m = {mass:e} kg  C:s {{ stiffness = {stiffness:e} N/m; q0 = 1 m }}  1:v -> m, s }}"
        ));
        let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap_or_else(|e| panic!("{e}"));
        let error = sim.finish(1.0).expect_err("all digits are lost").to_string();
        assert!(error.contains("too many orders of magnitude"), "{error}");
    }
}

/// A source that moves, and is all but balanced by what is held against it: the balance closes to rounding all the
/// same.
#[test]
fn what_all_but_balances_a_moving_source_balances() {
    let wall = "model A {
       Se:hand = 3 N * sin(0.1 rad/s * t)
       I:mass = 1 kg
       hand -> 1:v -> mass
       sampled at 1 kHz { C:c { stiffness = 1000 N/m }  R:r = 30 N*s/m  1:j -> c, r }
       v ||> j
     }";
    let damper = "model A {
       Se:hand = 1 N * sin(1 rad/s * t)
       R:r = 0.2 N*s/m
       hand -> 1:v -> r
       sampled every 1 ms hold lagged { C:c { stiffness = 20 N/m } }
       v ||> c
     }";
    for text in [wall, damper] {
        let compiled = crate::common::text(text);
        let mut sim = start(&compiled, Steps::default());
        finish(&mut sim, 30.0);
        let summary = sim.summary();
        assert!(summary.worst_step <= 1e-14 && summary.total <= 1e-12, "{summary:?}\n{text}");
    }
}

/// Play as a difference: its energy is that of what is beyond its ends, and not of two springs that cancel.
#[test]
fn play_keeps_no_energy_within_its_ends() {
    let model = "model M {
       I:m { inertia = 1 kg; f0 = 1 mm/s }
       C:play { e = 100 N/m * (q - min(max(q, -10 mm), 10 mm)) }
       R:b = 1 N*s/m
       1:v -> m, play, b
       probe x = play.q
     }";
    let compiled = crate::common::text(model);
    for steps in [Steps::default(), Steps::tolerance(1e-9)] {
        let mut sim = start(&compiled, steps);
        finish(&mut sim, 60.0);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step <= 1e-14, "{summary:?}");
        assert!(summary.regions[0].steps < 60_001, "{summary:?}");
        crate::common::close(crate::common::probe(&mut sim, "x"), 1e-3, 1e-8, "where it stops");
    }
}

/// Beside a store of heat, which is large, no step shows that a resistor gives energy; the sum over all of them does.
#[test]
fn what_gives_little_beside_heat_is_seen() {
    let house = |law: &str| {
        crate::common::text(&format!(
            "use std.thermal
             model House {{
               Body:b(C = 1e7 J/K, T0 = 300 K)
               I:fan {{ inertia = 1 kg; f0 = 1 m/s }}
               1:w -> fan
               RS(f, s):r = 1e-3 N*s/m
               R:a {{ e = -1 N*s/m * {law} * f }}
               w -> r.f, a
               r.s -> b.heat
               probe v = fan.f
             }}"
        ))
    };
    for (law, passive) in [("cos(0.5 Hz * t)", false), ("-cos(0.5 Hz * t)^2", true)] {
        let compiled = house(law);
        let mut sim = crate::common::start(&compiled, Steps::new());
        crate::common::finish(&mut sim, 3.0);
        let summary = sim.summary();
        assert_eq!(summary.passive, passive, "{law}: {:?}", summary.reasons);
        assert!(passive || summary.reasons[0].contains("`a` in `w` gave energy"), "{law}: {:?}", summary.reasons);
    }
}

/// A coil that saturates, behind a diode: far below the knee, where a step begins, the diode's voltage has no weight,
/// and is not left anywhere for that.
#[test]
fn a_diode_that_opens_late_balances() {
    let compiled = crate::common::text(
        "use std.electrical
        model Pulse {
          SineVoltage:u(amplitude = 12 V, frequency = 50 Hz)
          Diode:d
          SaturatingInductor:L
          Capacitor:c(C = 100 uF)
          R:load = 100 Ohm
          u.out -> 1:i -> d.p, L.p
          i -> 0:o -> c.p, load
          simulate { stop = 0.1 s }
        }",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 0.1);
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
}

/// Nothing moves: what a speed of 1e-33 m/s makes of the power is no energy. And coils tied together, one of which
/// saturates, near rest: their energy is not the rounding of `log(cosh(p))`.
#[test]
fn rounding_at_rest_gives_nothing() {
    let held = "model Held {
      Se:push = 1 N
      R:dry { e = 2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
      I:block = 1 kg
      push -> 1:v -> block, dry
      simulate { stop = 1 s; tolerance = 1e-8 }
    }";
    let tied = |law: &str| {
        format!(
            "model Tied {{
              Se:u = 0.6 V * sin(3 Hz * t)
              R:r = 1 Ohm
              I:a {{ f = ({law})*1 A }}
              I:b = 0.94 H
              I:c = 2 H
              u -> 1:v -> r, 0:n
              n -> a, c
              v -> b
              simulate {{ stop = 1 s; step = 1 ms }}
            }}"
        )
    };
    let laws = ["tanh(p/(1 Wb))", "p/(1.92 Wb) + 1.93*tanh(2*p/(1 Wb))", "atan(p/(1 Wb))"].map(tied);
    for scene in std::iter::once(held.to_string()).chain(laws) {
        for method in [None, Some("collocation4")] {
            let compiled = with(method.into_iter().fold(Options::new(), |o, m| o.method(m)), &scene);
            let summary = run(&compiled).unwrap_or_else(|e| panic!("{e}"));
            assert!(summary.passive, "{scene}: {:?}", summary.reasons);
        }
    }
}

/// What is off in a region of tens of thousands of states is the rounding of its sums, and no gain.
#[test]
fn large_regions_are_judged_by_their_sums() {
    let star = "model Star(n = 25600) {
      I:hub { inertia = 1 kg; f0 = 1 m/s }
      1:h -> hub
      for i in 1..n { C:k[i] { stiffness = 10 N/m }  I:m[i] = 1 g  1:v[i] -> m[i]  h -> 0:x[i] -> k[i], v[i] }
    }";
    let compiled = with(Options::new(), star);
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    finish(&mut sim, 0.05);
    let summary = sim.summary();
    assert!(summary.passive && summary.worst_step < 1e-11, "{:e} {:?}", summary.worst_step, summary.reasons);
}
