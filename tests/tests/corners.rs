//! Laws that switch on what only a step tells: dry friction, diodes. Against closed forms, with the steps of every
//! tolerance.

use crate::common::{advance, end, finish, probe, start, text, with};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};

/// Steppers that keep the balance, and one that damps.
const METHODS: [&str; 5] = ["gonzalez", "collocation4", "collocation8", "collocation12", "radau"];
const TOLERANCES: [f64; 3] = [1e-5, 1e-7, 1e-9];

/// What probes come to at an instant.
fn ends(text: &str, method: &str, tolerance: f64, end: f64, names: [&str; 2]) -> [f64; 2] {
    let compiled = with(Options::new().method(method), text);
    let mut sim = start(&compiled, Steps::tolerance(tolerance));
    finish(&mut sim, end);
    names.map(|name| probe(&mut sim, name))
}

/// A block that slides to rest, and stays: after m v / F, at m v^2 / 2F.
#[test]
fn a_block_comes_to_rest() {
    for (speed, force) in [(7.0, 5.886), (2.0, 8.0), (3.0, 5.886)] {
        let text = format!(
            "model Slide {{
  I:block {{ inertia = 2 kg; f0 = {speed} m/s }}
  R:dry {{ e = {force} N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }}
  1:v -> block, dry
  probe speed = v.f
  probe x = integral(v.f, 0 m)
}}"
        );
        for method in METHODS {
            for tolerance in TOLERANCES {
                let [v, x] = ends(&text, method, tolerance, 3.0, ["speed", "x"]);
                let (wanted, what) = (speed * speed / force, format!("{speed}, {method}, {tolerance:e}"));
                assert!(v.abs() < 1e-12, "{what}: it still slides at {v:e} m/s");
                assert!((x / wanted - 1.0).abs() < 1e-9, "{what}: {x} m and {wanted}");
            }
        }
    }
}

/// On a spring each swing is shorter by 2 F/k than the last, until the spring no longer holds against the friction.
#[test]
fn swings_die_out() {
    let text = "model Swing {
  I:block = 1 kg
  C:spring { stiffness = 100 N/m; q0 = 0.17 m }
  R:dry { e = 2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }
  1:v -> block, spring, dry
  probe speed = v.f
  probe x = spring.q
}";
    for method in METHODS {
        for tolerance in TOLERANCES {
            let [v, x] = ends(text, method, tolerance, 3.0, ["speed", "x"]);
            let what = format!("{method}, {tolerance:e}");
            assert!(v.abs() < 1e-12, "{what}: it still slides at {v:e} m/s");
            assert!((x - 0.01).abs() < 50.0 * tolerance, "{what}: it rests at {x} m");
        }
    }
}

/// A body that all but rests sticks in the first step, whatever rounding leaves open of what holds it; and what starts
/// in motion is found to slide.
#[test]
fn what_hardly_moves_sticks() {
    for momentum in [0.0f64, 1e-18, -1e-18, 1e-15, 1e-12, -1e-12, 1e-9, 1e-6, -1e-6, 1e-4] {
        let text = format!(
            "model Block {{
  I:block {{ inertia = 1 kg; p0 = {momentum:e} kg*m/s }}
  C:spring {{ stiffness = 100 N/m; q0 = 0.01 m }}
  R:dry {{ e = 2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }}
  1:v -> block, spring, dry
  probe speed = v.f
}}"
        );
        for method in METHODS {
            let compiled = with(Options::new().method(method), &text);
            for h in [1e-14, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2] {
                let v = end(&compiled, Steps::fixed(h), h, "speed");
                assert!(v.abs() <= 2.0 * momentum.abs() + 1e-15, "{method}, {momentum:e}, {h:e}: {v:e} m/s");
            }
        }
    }
}

/// A coil behind a diode: its current falls to 0, waits until the voltage is positive again, and rises anew.
#[test]
fn a_current_waits_for_its_voltage() {
    let text = "model Coil {
  Se:mains = 10 V * sin(1 rad/s * t)
  R:load = 1 Ohm
  I:coil = 2 H
  R:diode { f = max(s, 0) * 1 A; e = min(s, 0) * 1 V }
  mains -> 1:i -> load, coil, diode
  probe current = i.f
}";
    let after = 9.0 - std::f64::consts::TAU;
    let wanted = 2.0 * (after.sin() - 2.0 * after.cos() + 2.0 * (-after / 2.0).exp());
    for (method, order) in [("gonzalez", 2.0), ("collocation4", 4.0), ("collocation8", 8.0), ("radau", 5.0)] {
        let off = TOLERANCES.map(|tolerance| {
            let [waits, i] = [6.0, 9.0].map(|end| ends(text, method, tolerance, end, ["current", "current"])[0]);
            assert!(waits.abs() < 1e-12, "{method}, {tolerance:e}: {waits:e} A flow through the diode");
            (i / wanted - 1.0).abs()
        });
        for (off, tolerance) in off.iter().zip(TOLERANCES) {
            // The tolerance is that of a step's error, of one order more.
            let most = 10.0 * f64::powf(tolerance, order / (order + 1.0));
            assert!(*off < most, "{method} of order {order}, {tolerance:e}: off by {off:e}");
        }
    }
}

/// A source that nearly cancels at the start counts with one rounding in equations and ledger.
#[test]
fn a_source_that_cancels_needs_no_short_steps() {
    let text = "model Plates {
  Se:u = 40 V * (1 - exp(-(t/(1 ms))))
  R:r = 1 MOhm
  C(q, x):plate { H = q^2*(1 mm + x)/(2*(1e-12 F*m)) }
  I:mass = 1e-3 kg
  C:spring { stiffness = 10 N/m }
  R:damp = 0.05 N*s/m
  u -> 1:i -> r, plate.q
  1:v -> mass, spring, damp, plate.x
  probe x = plate.x
}";
    for tolerance in TOLERANCES {
        let compiled = with(Options::new().method("collocation8"), text);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        finish(&mut sim, 0.05);
        let region = &sim.summary().regions[0];
        assert!(region.steps < 200, "{tolerance:e}: {} steps", region.steps);
        assert!(region.worst_step < 1e-13, "{tolerance:e}: the balance is off by {:e}", region.worst_step);
    }
}

/// A law with an infinite slope at rest whose flow is given: v' = 1 - v^2 from rest, by every stepper.
#[test]
fn a_root_starts_at_its_infinite_slope() {
    let text = "model Root {
  Se:push = 1 N
  I:mass = 1 kg
  R:hole { f = 1 m/(s*N^(1/2)) * sign(e)*sqrt(abs(e)) }
  push -> 1:n -> mass, hole
  probe v = n.f
  probe x = integral(n.f, 0 m)
}";
    for method in METHODS {
        let [v, x] = ends(text, method, 1e-7, 2.0, ["v", "x"]);
        assert!((v - 2f64.tanh()).abs() < 1e-5, "{method}: {v} m/s");
        assert!((x - 2f64.cosh().ln()).abs() < 1e-5, "{method}: {x} m");
        let fixed = end(&with(Options::new().method(method), text), Steps::fixed(0.01), 2.0, "v");
        assert!((fixed - 2f64.tanh()).abs() < 1e-4, "{method}, fixed steps: {fixed} m/s");
    }
}

/// Two tanks that level out in finite time: the head is 0 from then on, to each tolerance, and no time is lost with
/// what rounding makes of it. The root of the head falls evenly: by 2 a/sqrt(r) k/A a second.
#[test]
fn what_has_levelled_out_stays() {
    for law in ["f = 1 m^3/(s*Pa^(1/2)) * sign(e)*sqrt(abs(e))/100", "e = 1e4 Pa*s^2/m^6 * f*abs(f)"] {
        let text = format!(
            "model Tanks {{
  C:high {{ stiffness = 100 Pa/m^3; e0 = 400 Pa }}
  C:low {{ stiffness = 100 Pa/m^3; e0 = 100 Pa }}
  R:hole {{ {law} }}
  high -> 1:q -> hole, low
  probe head = high.e - low.e
  probe upper = high.e
  simulate {{ stop = 90 s }}
}}"
        );
        let over = 300f64.sqrt();
        for tolerance in [1e-4, 1e-6, 1e-9] {
            let compiled = with(Options::new(), &text);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 0.5 * over);
            let head = probe(&mut sim, "head");
            assert!((head / 75.0 - 1.0).abs() < 1e3 * tolerance, "{law}, {tolerance:e}: {head} Pa");
            finish(&mut sim, 5.0 * over);
            let (head, high) = (probe(&mut sim, "head"), probe(&mut sim, "upper"));
            let most = 300.0 * tolerance;
            assert!(head.abs() < most && (high - 250.0).abs() < most, "{law}, {tolerance:e}: {head} Pa of {high}");
            let steps = sim.summary().regions[0].steps;
            assert!(steps < 20_000, "{law}, {tolerance:e}: {steps} steps");
        }
    }
}

/// A tank that is filled to the level of its main: the head is the difference of two large numbers there, and the
/// balance closes all the same, whatever the stepper.
#[test]
fn a_tank_is_filled_to_the_main() {
    let text = "model M {
      Se:main = 1 bar
      R:orifice { f = 1e-6 m^3/s/Pa^(1/2) * sign(e)*sqrt(abs(e)) }
      C:tank = 1e-10 m^3/Pa
      main -> 1:q -> orifice, tank
      probe p = tank.e
    }";
    for method in ["gonzalez", "collocation4", "collocation8", "radau"] {
        for steps in [Steps::fixed(0.01), Steps::tolerance(1e-4), Steps::tolerance(1e-6)] {
            let compiled = with(Options::new().method(method), text);
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 1.0);
            let (summary, p) = (sim.summary(), probe(&mut sim, "p"));
            assert!(summary.passive, "{method}: {:?}", summary.regions);
            assert!((p - 1e5).abs() < 1e3, "{method}: {p}");
        }
    }
}

/// A rectifier whose steps are many time constants of the conducting diode: each has one solution, and far out on the
/// exponential there is none that only seems to be one.
#[test]
fn long_steps_over_a_diode_find_the_solution() {
    for (resistance, exact) in [(0.1, 8.21), (3.0, 7.217)] {
        let text = format!(
            "model M {{
              Se:u = 10 V * sin(2*pi*50 Hz * t)
              R:wire = {resistance} Ohm
              R:diode {{ f = 1e-9 A * (exp(e/0.025 V) - 1) }}
              C:buffer = 1 mF
              R:load = 100 Ohm
              u -> 1:m -> wire, diode
              m -> 0:n -> buffer, load
              probe v = n.e
            }}"
        );
        for method in ["gonzalez", "collocation4", "collocation8", "radau"] {
            for h in [8e-4, 1.3e-3, 3e-3] {
                let compiled = with(Options::new().method(method), &text);
                let mut sim = start(&compiled, Steps::fixed(h));
                finish(&mut sim, 0.2);
                let (summary, v) = (sim.summary(), probe(&mut sim, "v"));
                assert!(summary.passive, "{method}, {h}: {:?}", summary.regions);
                assert!((v - exact).abs() < 1.6, "{method}, {h}: {v} beside {exact}");
            }
        }
    }
}

/// A decay in 10 ns, in a run of 10 s: the first steps are as short as that takes.
#[test]
fn a_stiff_start_is_resolved() {
    let text = "model M {
      C:c { compliance = 10 nF; e0 = 1 V }
      R:r { e = 1 Ohm * f + 1e-9 Ohm/A^2 * f^3 }
      c -> r
      probe v = c.e
      simulate { stop = 10 s }
    }";
    for method in ["gonzalez", "collocation8", "radau"] {
        let compiled = with(Options::new().method(method), text);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        finish(&mut sim, 1e-8);
        let v = probe(&mut sim, "v");
        assert!((v - (-1.0f64).exp()).abs() < 1e-5, "{method}: {v}");
    }
}

/// A block that a swinging force lets go from rest, where the friction's parameter is rounded at its corner: with
/// F = A sin(w t) from w t1 = asin(mu / A) on, p = A/w (cos(w t1) - cos(w t)) - mu (t - t1).
#[test]
fn a_block_is_let_go() {
    for (force, held) in [(3.0, 0.7), (3.0, 1.2), (2.0, 1.2), (4.0, 0.6)] {
        let text = format!(
            "model LetGo {{
  Se:push = {force} N * sin(2 Hz * t)
  I:body = 1 kg
  R:dry {{ e = {held} N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }}
  push -> 1:v -> body, dry
  probe p = body.p
  probe x = integral(v.f, 0 m)
}}"
        );
        let since = f64::asin(held / force) / 2.0;
        let wanted = force / 2.0 * ((2.0 * since).cos() - 2.0f64.cos()) - held * (1.0 - since);
        for method in METHODS {
            for tolerance in [1e-3, 1e-5, 1e-7, 1e-8, 1e-9] {
                let [p, _] = ends(&text, method, tolerance, 1.0, ["p", "x"]);
                let off = (p / wanted - 1.0).abs();
                assert!(off < 100.0 * tolerance, "{force}, {held}, {method}, {tolerance:e}: {p} and {wanted}");
            }
        }
    }
}

/// A block that is pushed to and fro stops for a tenth of a second, and goes on the same way: long enough to count, and
/// shorter than the steps before. It is met however long those are, and where it is held nothing creeps.
#[test]
fn a_short_stop_is_not_stepped_over() {
    let blocks = "model Blocks {
      Se:push = 3 N * sin(1.7 Hz * t) + 1 N
      I:m1 = 1 kg
      I:m2 = 2 kg
      C:k { H = 5 N/m * q^2 + 8 N/m^3 * q^4; q0 = 0 m }
      R:f1 { e = 1.2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*(1 m/s) }
      R:f2 { e = 1.5 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*(1 m/s) }
      push -> 1:v1 -> m1, f1
      1:v2 -> m2, f2
      v1 -> 0:x -> v2
      x -> k
      probe stretch = k.q
      probe p1 = m1.p
      probe way = integral(v1.f, 0 m)
    }";
    for (method, tolerances, most) in [
        ("collocation6", &[1e-3, 1e-5, 1e-7][..], 2e-5),
        ("collocation8", &[1e-3, 1e-4, 1e-5, 1e-8], 2e-5),
        ("collocation12", &[1e-3, 1e-4, 1e-6, 1e-8], 2e-5),
        ("radau", &[1e-5, 1e-8], 2e-5),
        ("gonzalez", &[1e-6], 2e-4),
    ] {
        let compiled = with(Options::new().method(method), blocks);
        for tolerance in tolerances {
            // As its steps are, and with some that end where it is held.
            let title = format!("{method}, tolerance {tolerance:e}");
            let wanted = [("stretch", -0.004_280_452_6), ("p1", -0.126_051_140), ("way", 2.124_669_254)];
            let mut alone = start(&compiled, Steps::tolerance(*tolerance));
            finish(&mut alone, 10.0);
            let off = wanted.map(|(name, wanted)| (probe(&mut alone, name) - wanted).abs());
            assert!(off.iter().all(|x| *x < most), "{title}: off by {off:?} alone");
            let mut sim = start(&compiled, Steps::tolerance(*tolerance));
            for k in 1..=9 {
                advance(&mut sim, 1.325 + 0.01 * f64::from(k));
                let p = probe(&mut sim, "p1");
                assert!(p.abs() < 1e-12, "{title}: at {} s it moves with {p:e} N*s", sim.time());
            }
            advance(&mut sim, 10.0);
            let off = wanted.map(|(name, wanted)| (probe(&mut sim, name) - wanted).abs());
            assert!(off.iter().all(|x| *x < most), "{title}: off by {off:?}");
            // With an energy that is not quadratic it does not claim to be.
            assert_eq!(sim.summary().passive, method != "radau", "{title}: {:?}", sim.summary().reasons);
        }
    }
}

/// A law that jumps where a body would stick has no solution there, and is named; one that is steep has.
#[test]
fn laws_that_jump_are_named() {
    let run = |law: &str| {
        let compiled = text(&format!(
            "model M {{ I:m = 0.1 kg  C:k {{ stiffness = 100 N/m; q0 = 1 m }}  R:dry {{ {law} }}  1:v -> m, k, dry }}"
        ));
        let mut sim = start(&compiled, Steps::fixed(1e-3));
        (compiled.scene().clusters[0].jumps.clone(), sim.finish(5.0))
    };
    for law in ["e = 2 N * sign(f)", "e = if f > 0 then 2 N else -2 N", "e = 2 N * sign(f) + 0.1 N*s/m * f"] {
        let (jumps, result) = run(law);
        assert_eq!(jumps, ["dry"], "{law}");
        let why = result.expect_err(law).to_string();
        assert!(why.contains("the law of `dry` jumps") && why.contains("`{ e = ...; f = ... }` in `s`"), "{why}");
    }
    for law in [
        "e = 1 N * sign(f)*sqrt(abs(f)/(1 m/s))",
        "e = 2 N * tanh(f/(1 um/s))",
        "e = 1 N*s^2/m^2 * f*abs(f)",
        "e = 2 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s",
    ] {
        let (jumps, result) = run(law);
        assert!(jumps.is_empty(), "{law}");
        result.unwrap_or_else(|e| panic!("{law}: {e}"));
    }
}

/// Fixed steps without a solution are halved, each half from its own instant on: the run gets to where the body stops.
#[test]
fn halved_steps_get_to_where_a_body_stops() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model Slide {
  Se:u = sin(3 rad/s * t) * 3 N
  I:m { inertia = 0.1 kg; f0 = 1 m/s }
  R:dry { e = if f > 0 then 2 N else -2 N }
  1:v -> m, dry
  u -> v
}",
    );
    let speed = |t: f64| 1.0 + 10.0 * (1.0 - (3.0 * t).cos()) - 20.0 * t;
    let (mut low, mut high) = (0.0, 0.1);
    while high - low > 1e-12 {
        let middle = 0.5 * (low + high);
        *if speed(middle) > 0.0 { &mut low } else { &mut high } = middle;
    }
    for step in [5e-3, 1e-3] {
        let why = start(&compiled, Steps::fixed(step)).finish(1.0).expect_err("it sticks").to_string();
        let at: f64 = why.split("t = ").nth(1).and_then(|t| t.split(' ').next()?.parse().ok()).expect("an instant");
        assert!((at - low).abs() < 0.5 * step, "steps of {step} s end at {at} s, not at {low} s");
    }
}

/// So it is at the first port of what loses its power as heat, whose short steps would never end.
#[test]
fn laws_that_jump_are_named_where_they_heat() {
    let compiled = text(
        "model Brake { I:disc { inertia = 2 kg*m^2; f0 = 50 rad/s }  RS(r, th):pad { e = 30 N*m * sign(f) }
            C:body { H = 270 kJ * exp(q/(900 J/K)); e0 = 300 K }  1:w -> disc, pad.r  pad.th -> 0:T -> body
            simulate { stop = 5 s } }",
    );
    let why = start(&compiled, Steps::new()).finish(5.0).expect_err("it sticks").to_string();
    assert!(why.contains("the law of `pad` jumps") && !why.contains("end it earlier"), "{why}");
}

/// A Hertz contact written with `max`: beyond the touch its law has no slope, and that of a root of 0 is none of it.
#[test]
fn a_root_of_what_is_cut_off_has_no_slope() {
    let model = "model M {
       C:c { H = 1 J * max(q/(1 m), 0)^2.5; q0 = 1 m }
       I:i { inertia = 1 kg; f0 = 1 m/s }
       1:v -> c, i
       probe q = c.q
       probe left = i.f
     }";
    for method in ["gonzalez", "collocation4", "collocation8", "radau"] {
        for k in 1..=20 {
            let compiled = crate::common::with(bond::Options::new().method(method), model);
            let mut sim = crate::common::start(&compiled, bond::Steps::fixed(0.047 * f64::from(k)));
            sim.finish(4.0).unwrap_or_else(|e| panic!("{method}, {k}: {e}"));
            let left = crate::common::probe(&mut sim, "left");
            // It leaves with all that it had.
            if method != "radau" {
                crate::common::close(left, -(3f64.sqrt()), 1e-11, &format!("{method}, {k}"));
            }
        }
    }
}

/// A diode that blocks in series with a resistor: nothing flows, to the last bit, whatever the numbers, and so no
/// rounding gives energy.
#[test]
fn what_blocks_is_off() {
    for volts in ["-10", "-7.3", "-1", "-10 * cos(1 rad/s * t)"] {
        for ohms in ["1", "2", "3", "10", "0.7"] {
            let text = format!(
                "model Off {{
  Se:u = ({volts}) * 1 V
  R:d {{ e = min(s, 0) * 1 V; f = max(s, 0) * 1 A }}
  R:r = {ohms} Ohm
  u -> 1:j -> d, r
  probe flows = j.f
  simulate {{ stop = 1 s }}
}}"
            );
            let compiled = crate::common::text(&text);
            for steps in [Steps::new(), Steps::fixed(1e-3), Steps::tolerance(1e-9)] {
                let mut sim = start(&compiled, steps);
                finish(&mut sim, 1.0);
                let summary = sim.summary();
                assert!(summary.passive, "{volts}, {ohms}: {:?}", summary.reasons);
                assert!(summary.regions[0].steps < 5000, "{volts}, {ohms}: {} steps", summary.regions[0].steps);
                assert_eq!(probe(&mut sim, "flows"), 0.0, "{volts}, {ohms}");
            }
        }
    }
}

/// Laws with exponentials that what they give has a part in, besides what they receive; and a motor whose field is its
/// own current, with a coil far faster than the steps.
#[test]
fn laws_that_read_what_they_give() {
    let text = "model Heated {
  Se:u = 1 V
  R:a = 1 Ohm
  R:b { f = 1 A * sinh(e/(1 V)) * (1 + (a.P/(1 W))^2) }
  u -> 1:n -> a, b
  probe f = n.f
  simulate { stop = 1 s }
}";
    let f = end(&crate::common::text(text), Steps::new(), 1.0, "f");
    let off = (1.0 - f).sinh() * (1.0 + f.powi(4)) - f;
    assert!(off.abs() < 1e-12, "{f}: off by {off}");
    let motor = "model Motor(L = 1 mH) {
  Se:s = 24 V
  R:r = 5 Ohm
  I:l = L
  MGY:m = 0.05 H * l.f
  I:j = 2e-3 kg*m^2
  R:f = 1e-3 N*m*s
  s -> 1:a -> r, l, m
  m -> 1:w -> j, f
  probe turns = w.f
  probe current = a.f
  simulate { stop = 30 s }
}";
    for steps in [Steps::new(), Steps::tolerance(1e-8)] {
        let compiled = crate::common::text(motor);
        let mut sim = start(&compiled, steps);
        finish(&mut sim, 30.0);
        let (w, i) = (probe(&mut sim, "turns"), probe(&mut sim, "current"));
        // At rest K i^2 = b w and u = R i + K i w.
        let (torque, volts) = (0.05 * i * i - 1e-3 * w, 5.0 * i + 0.05 * i * w - 24.0);
        assert!(torque.abs() < 1e-5 && volts.abs() < 1e-4, "{w} {i}: {torque} {volts}");
    }
}

/// Stribeck's friction has an exponential that never grows: a stop beside it gives back what it was given, and dry
/// friction beside it holds a body that begins at rest.
#[test]
fn a_bell_is_no_knee() {
    let speed = |steps: Steps| {
        let text = "use std.contact
            model Bounce {
              I:mass { inertia = 1 kg; f0 = 1 m/s }
              RigidStop:wall(gap = 10 cm)
              StribeckFriction:guide(Fc = 1 mN, Fs = 1.5 mN, b = 1e-6 N*s/m)
              1:v -> mass, wall.tip, guide.slide
              probe speed = v.f
            }";
        end(&with(Options::new(), text), steps, 0.2, "speed")
    };
    // 0.2 mJ of 500 mJ are lost on the way.
    for steps in [Steps::new(), Steps::tolerance(1e-4), Steps::tolerance(1e-6), Steps::tolerance(1e-8)] {
        let v = speed(steps);
        assert!((v + 0.9998).abs() < 1e-5, "{v} m/s after the stop");
    }
    let pulled = "model Pulled {
          Se:pull = 60 mN
          I:m = 0.8 kg
          R:guide { e = 20 mN * (1 + 0.5*exp(-(f/(20 mm/s))^2))*tanh(f/(2 mm/s)) }
          R:dry { e = 20 mN * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }
          C:k { stiffness = 10 N/m }
          I:n = 0.8 kg
          1:w -> guide, m, dry  1:v -> n  w -> 0:s -> k  s -> v  pull -> v
          probe speed = w.f
        }";
    let exact = end(&with(Options::new(), pulled), Steps::tolerance(1e-8), 1.0, "speed");
    for steps in [Steps::new(), Steps::tolerance(1e-6)] {
        let w = end(&with(Options::new(), pulled), steps, 1.0, "speed");
        assert!((w - exact).abs() < 1e-3 * exact.abs(), "{w} m/s, and {exact} m/s");
    }
}

/// What is told by a very short step is told before an instant at which a source switches, and not beyond: a chopper
/// with a coil that has run empty behind its diode.
#[test]
fn a_chopper_meets_each_turn() {
    let scene = |pulse: &str| {
        let text = format!(
            "use std.electrical
            model Chopper(T = 10 ms) {{
              Se:src = if {pulse} then 5 V else 0 V
              Inductor:coil(L = 30 mH, R = 2 Ohm)
              IdealDiode:d
              Capacitor:cap(C = 4 uF)
              Resistor:load(R = 6 kOhm)
              src -> 1:mesh -> coil.p, d.p, 0:out
              out -> cap.p, load.p
              probe u = cap.p.e
            }}"
        );
        let compiled = with(Options::new(), &text);
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 0.2);
        (probe(&mut sim, "u"), sim.summary().regions[0].steps)
    };
    // The same pulses, by a cosine about the middle of each.
    let (exact, _) = scene("cos(2*pi*(t - 0.1*T)/T) > cos(0.2*pi)");
    let (u, steps) = scene("mod(t, T) < 0.2*T");
    assert!((u - exact).abs() < 1e-4 && steps < 10_000, "{u} V and {exact} V, {steps} steps");
}

/// A bell that is divided by does grow.
#[test]
fn an_inverse_bell_is_a_knee() {
    let text = "model Braked {
      I:m { inertia = 1 kg; f0 = 0.6 m/s }
      R:r { e = 1 N * (f/(1 m/s)) / exp(-(f/(0.05 m/s))^2) }
      1:n -> m, r
      probe speed = m.f
    }";
    // dt = -exp(-(v/0.05)^2)/v dv: Simpson's rule from 0.6 m/s down to where it comes to.
    let v = end(&with(Options::new(), text), Steps::tolerance(1e-9), 0.1, "speed");
    let slope = |v: f64| (-(v / 0.05).powi(2)).exp() / v;
    let (n, h) = (20_000, (0.6 - v) / 20_000.0);
    let weight = |k: i32| if k == 0 || k == n { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
    let time: f64 = (0..=n).map(|k| weight(k) * slope(v + f64::from(k) * h)).sum::<f64>() * h / 3.0;
    assert!((time - 0.1).abs() < 1e-6, "{v} m/s, which takes {time} s");
}

/// Frictions on both sides of a gear: what each holds while both stick is open; sliding they are one, reflected.
#[test]
fn frictions_about_a_gear() {
    let friction = |name: &str, most: f64| {
        format!("R:{name} {{ e = {most} N*m * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 rad/s }}")
    };
    for (ratio, most, sticks) in [(5.0, 2.0, true), (5.0, 20.0, false), (0.2, 0.5, true), (0.2, 2.0, false)] {
        let two = format!(
            "model Two {{
  Se:u = {most} N*m * sin(3 rad/s * t)
  I:rotor = 0.01 kg*m^2
  TF:g = {ratio}
  I:load = 0.2 kg*m^2
  {}
  {}
  u -> 1:w -> rotor, fm
  w -> g -> 1:v -> load, fl
  probe speed = w.f
  probe held = fm.e + {ratio} * fl.e
}}",
            friction("fm", 0.3),
            friction("fl", 1.5)
        );
        let one = format!(
            "model One {{
  Se:u = {most} N*m * sin(3 rad/s * t)
  I:rotor = {} kg*m^2
  {}
  u -> 1:w -> rotor, f
  probe speed = w.f
}}",
            0.01 + 0.2 * ratio * ratio,
            friction("f", 0.3 + 1.5 * ratio)
        );
        for tolerance in [1e-5, 1e-6, 1e-8] {
            let compiled = [&two, &one].map(|text| with(Options::new().method("gonzalez"), text));
            let [mut two, mut one] = [0, 1].map(|k| start(&compiled[k], Steps::tolerance(tolerance)));
            let what = format!("{ratio}, {most} N*m, {tolerance:e}");
            for t in [0.7, 1.3, 2.0] {
                advance(&mut two, t);
                advance(&mut one, t);
                let (v, wanted) = (probe(&mut two, "speed"), probe(&mut one, "speed"));
                assert!((v - wanted).abs() < 1e4 * tolerance, "{what}: {v} and {wanted} rad/s at {t} s");
                if sticks {
                    let (held, u) = (probe(&mut two, "held"), most * (3.0 * t).sin());
                    assert!(v.abs() < 1e-15 && (held - u).abs() < 1e-12, "{what}: {held} of {u} N*m at {t} s");
                }
            }
            let summary = two.summary();
            let region = &summary.regions[0];
            assert!(summary.passive, "{what}: {summary:?}");
            let most = if sticks { 30 } else { 6 } * region.steps;
            assert!(region.newton_iterations < most, "{what}: {} in {}", region.newton_iterations, region.steps);
        }
    }
}

/// A knob that a spring drags breaks away between two ends of steps: no time is lost there, and it moves as it must.
#[test]
fn no_time_passes_at_a_break_away() {
    let text = "model Dragged {
      Sf:hand = 1 rad/s
      C:finger { stiffness = 0.2 N*m }
      I:knob = 2e-5 kg*m^2
      R:dry { e = 5 mN*m * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 rad/s }
      hand -> 0:j -> finger, 1:w
      w -> knob, dry
      probe clock = integral(1, 0 s) - t
      probe v = w.f
    }";
    // From 25 ms on it swings about the hand, at 100 rad/s.
    let wanted = 1.0 - 0.5f64.cos();
    for method in METHODS {
        for tolerance in TOLERANCES {
            let [clock, v] = ends(text, method, tolerance, 0.03, ["clock", "v"]);
            assert!(clock.abs() < 1e-12, "{method}, {tolerance:e}: {clock} s");
            assert!((v - wanted).abs() < 30.0 * tolerance, "{method}, {tolerance:e}: {v} and {wanted} rad/s");
        }
    }
}
