//! Mechanisms with loops of bars, and driven ones: `models/mechanisms/` as each says itself, against published numbers
//! and such as were found by other means.

use crate::common::{advance, close, file, models, probe, read, scenes_of, start, stop, with};
use bond::internal::CompiledInternals;
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

/// A crank, a coupler and a rocker whose pins are bonded: the model tells their speeds alone.
const FOUR_BAR: &str = "
model FourBar(r = 0.1 m, s = 0.3 m, k = 0.25 m) {
  C:a { H = 0; q0 = 1 rad }
  C:b { H = 0; q0 = 0.6 rad }
  C:c { H = 0; q0 = 1.5 rad }
  I:ia { inertia = 0.001 kg*m^2; f0 = 10 rad/s }
  I:ib = 0.003 kg*m^2
  I:ic = 0.002 kg*m^2
  MTF:ax = -r*sin(a.q)
  MTF:ay = r*cos(a.q)
  MTF:bx = -s*sin(b.q)
  MTF:by = s*cos(b.q)
  MTF:cx = k*sin(c.q)
  MTF:cy = -k*cos(c.q)
  1:wa -> a, ia, ax, ay
  1:wb -> b, ib, bx, by
  1:wc -> c, ic, cx, cy
  ax -> 0:x
  bx -> x
  cx -> x
  ay -> 0:y
  by -> y
  cy -> y
  probe x_off = r*cos(a.q) + s*cos(b.q) - k*cos(c.q) - (r*cos(1) + s*cos(0.6) - k*cos(1.5))
  probe y_off = r*sin(a.q) + s*sin(b.q) - k*sin(c.q) - (r*sin(1) + s*sin(0.6) - k*sin(1.5))
}";

#[test]
fn positions_stay_over_many_steps() {
    for (method, most) in [("gonzalez", 1e-12), ("collocation8", 1e-10)] {
        let compiled = with(Options::new().method(method), FOUR_BAR);
        let mut sim = start(&compiled, Steps::fixed(0.01));
        advance(&mut sim, 1000.0);
        for what in ["x_off", "y_off"] {
            close(1.0 + probe(&mut sim, what), 1.0, most, &format!("{what} by {method}"));
        }
        assert!(sim.summary().worst_step < 1e-12 && sim.summary().passive, "{method}");
    }
}

/// A knife edge on a plane ties the speed across it to nothing: no position follows from it. A bar's pin does.
#[test]
fn what_ties_speeds_alone_is_told() {
    let knife = "
model Knife {
  C:turn { H = 0; q0 = 0.3 rad }
  C:x { H = 0 }
  C:y { H = 0 }
  I:mx { inertia = 1 kg; f0 = 1 m/s }
  I:my { inertia = 2 kg }
  I:spin { inertia = 0.1 kg*m^2; f0 = 1 rad/s }
  TF:across = -sin(turn.q)
  TF:beside = cos(turn.q)
  1:vx -> mx, x, across
  1:vy -> my, y, beside
  1:w -> spin, turn
  across -> 0:side
  beside -> side
}";
    for (text, wanted) in [(knife, "speeds alone"), (FOUR_BAR, "(holonomic")] {
        let form = with(Options::new(), text).show("phs");
        assert!(form.contains(wanted), "{form}");
    }
}

/// Three cranks of one coupler, of which two would do, for many steps: nothing grows of what they say twice.
#[test]
fn what_is_said_twice_does_not_grow() {
    for (name, [off, tilt]) in [("parallel_cranks", ["off", "tilt"]), ("cognates", ["rings", "rings"])] {
        let compiled = file(&models().join(format!("mechanisms/{name}.bond")), Options::new());
        let mut sim = start(&compiled, Steps::fixed(0.001));
        advance(&mut sim, 100.0);
        for what in [off, tilt] {
            close(1.0 + probe(&mut sim, what), 1.0, 1e-11, &format!("{what} of {name}"));
        }
        let s = sim.summary();
        assert!(s.passive && s.worst_step < 1e-13, "{name}: a step's balance is off by {:e}", s.worst_step);
    }
}

/// A coupler on three cranks that are not parallel is held fast. The message names what cannot move.
#[test]
fn what_is_held_is_refused() {
    let model = read(&models().join("mechanisms/parallel_cranks.bond"));
    let (head, body) = model.split_once("q0 = 1 rad").expect("it says where cranks start");
    let text = format!("{head}q0 = 1 rad + i*0.2 rad{body}");
    let why = Options::new().compile_str("cranks.bond", &text).expect_err("nothing of it can move").to_string();
    assert!(why.contains("structure::held") && why.contains("at rest"), "{why}");
}

/// The linear model of three cranks, on all that they can do: that of one whose speed w follows from the coupler's
/// momentum p, w = -p/(m r sin a), dp/dt = -m r w^2 cos a.
#[test]
fn the_linear_model_of_what_is_said_twice() {
    let compiled = file(&models().join("mechanisms/parallel_cranks.bond"), Options::new());
    let linear = compiled.linearize(0.0, &|_| None).expect("it has a linear model");
    assert_eq!(linear.states, ["a[1].q", "a[2].q", "a[3].q", "turn.q", "mx.p"]);
    let ((sin, cos), m, r, w) = (1.0_f64.sin_cos(), 2.0, 0.1, 10.0);
    let all = |i: usize| linear.a[(i, 0)] + linear.a[(i, 1)] + linear.a[(i, 2)];
    for i in 0..3 {
        close(all(i), -w * cos / sin, 1e-9, "how fast a crank turns, by the angle of all");
        close(linear.a[(i, 4)], -1.0 / (m * r * sin), 1e-9, "how fast a crank turns, by the momentum");
    }
    close(all(4), m * r * w * w * (sin + 2.0 * cos * cos / sin), 1e-8, "the force, by the angle of all");
    close(linear.a[(4, 4)], 2.0 * w * cos / sin, 1e-8, "the force, by the momentum");
}

/// A source turns one of three cranks: the others follow.
#[test]
fn what_is_said_twice_is_driven() {
    let model = read(&models().join("mechanisms/parallel_cranks.bond"));
    let text =
        model.replace("  C:turn {", "  Sf:drive = 10 rad/s + (5 rad/s)*sin((3 rad/s)*t)\n  drive -> w[1]\n  C:turn {");
    assert_ne!(text, model);
    let compiled = with(Options::new(), &text);
    let mut sim = start(&compiled, Steps::tolerance(1e-8));
    advance(&mut sim, 2.0);
    close(probe(&mut sim, "a1"), 1.0 + 20.0 + 5.0 / 3.0 * (1.0 - 6.0_f64.cos()), 5e-6, "the angle that is driven");
    for what in ["off", "tilt"] {
        close(1.0 + probe(&mut sim, what), 1.0, 1e-11, what);
    }
    assert!(sim.summary().passive && sim.summary().worst_step < 1e-12);
}
