//! What rows show of laws that the states alone do, or do not, tell.

use crate::common::{BRIDGE, advance, close, probe, start, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps};
use bond_compiler::discretise::Accuracy;

/// Ways to step: the default, to a tolerance, by equal steps of the default method, and by a method that ends on a
/// stage.
fn ways() -> [(Options, Steps, &'static str); 4] {
    [
        (Options::new(), Steps::new(), "default"),
        (Options::new().accuracy(Accuracy::Tolerance(1e-8)), Steps::tolerance(1e-8), "1e-8"),
        (Options::new(), Steps::fixed(0.01), "10 ms"),
        (Options::new().method("radau"), Steps::tolerance(1e-8), "radau"),
    ]
}

/// A probe over a run, at four instants, each way, against what is wanted at an instant.
fn shows(text: &str, name: &str, tolerance: f64, wanted: impl Fn(f64) -> f64) {
    for (options, steps, way) in ways() {
        let compiled = with(options, text);
        let mut sim = start(&compiled, steps);
        for t in [0.45, 1.0, 1.37, 1.9] {
            advance(&mut sim, t);
            // What a stage has found is as exact as the steps are.
            let tolerance = if way == "radau" { tolerance.max(1e-7) } else { tolerance };
            close(probe(&mut sim, name), wanted(t), tolerance, &format!("{name} at {t}, {way}"));
        }
        assert!(way == "radau" || sim.summary().passive, "{name}, {way}: {:?}", sim.summary().reasons);
    }
}

/// Laws that are solved for what the states impose, and steep enough to be told by it, hold in each row, however they
/// are written: one that saturates, one with two slopes as a curve, dry friction of a body that slides.
#[test]
fn laws_hold_in_rows() {
    shows(
        "model Saturates {
          Se:push = 10 N * (t/1 s)*exp(-t/(2 s))
          I:m { f = 1 m/s * (p/(1 N*s) + (p/(1 N*s))^3) }
          R:a { f = 3 m/s * atan(e/(0.3 N)) }
          push -> 1:v -> m, a
          probe off = a.e - 0.3 N * tan(a.f/(3 m/s))
          simulate { stop = 2 s }
        }",
        "off",
        1e-10,
        |_| 0.0,
    );
    shows(
        "model Curve {
          Se:u = 1 V * sin(4 Hz * t)
          R:feed = 1 Ohm
          C:c = 0.1 F
          R:d { e = max(s, 0)*0.01 V + min(s, 0)*1 V; f = max(s, 0)*3 A + min(s, 0)*0.01 A }
          u -> 1:i -> feed, 0:n
          n -> c, d
          probe off = d.f - (if d.e > 0 then 300 S * d.e else 0.01 S * d.e)
          simulate { stop = 2 s }
        }",
        "off",
        1e-10,
        |_| 0.0,
    );
    shows(
        "model Slides {
          Se:push = 6 N + 2 N * sin(3 Hz * t)
          I:m = 1 kg
          R:r { e = 1 N * min(max(s, -1), 1) + 2 N * (s - min(max(s, -1), 1)); f = (s - min(max(s, -1), 1))*1 m/s }
          push -> 1:v -> m, r
          probe off = r.e - 1 N - 2 N*s/m * r.f
          simulate { stop = 2 s }
        }",
        "off",
        1e-10,
        |_| 0.0,
    );
}

/// Where the states leave it open, as the force of dry friction on a body at rest and the voltage of a diode that keeps
/// a coil without current, it is what leaves the states there, at the row and not in the middle of the last step.
#[test]
fn what_holds_is_what_it_holds_against() {
    shows(
        "model Stuck {
          Sf:hand = 1 m/s
          C:spring { stiffness = 2 N/m }
          I:m = 1 kg
          R:dry { e = 4 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
          hand -> 0:f -> spring
          f -> 1:v -> m, dry
          probe friction = dry.e
          simulate { stop = 2 s }
        }",
        "friction",
        1e-9,
        |t| 2.0 * t,
    );
    // At a speed that is not 0, too: no more than 0.5 m/s, which a mass under 1 N has after 0.5 s.
    shows(
        "model Limited {
          Se:push = 1 N
          I:m = 1 kg
          R:limit { e = (s - min(max(s, -1), 1))*1 N; f = min(max(s, -1), 1)*0.5 m/s }
          push -> 1:v -> m, limit
          probe brakes = limit.e
          simulate { stop = 2 s }
        }",
        "brakes",
        1e-9,
        |t| if t > 0.5 { 1.0 } else { 0.0 },
    );
    shows(
        "model Blocked {
          Se:u = -5 V * t/(1 s)
          I:l = 10 mH
          R:d { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
          u -> 1:i -> l, d
          probe bears = d.e
          simulate { stop = 2 s }
        }",
        "bears",
        1e-9,
        |t| -5.0 * t,
    );
}

/// Two diodes that block leave the node between them to the coil without current: it stands at what that is held
/// against. While one conducts, it is the source's, less what a resistance takes.
#[test]
fn a_node_behind_diodes_that_block() {
    let text = |emf: &str| {
        format!(
            "model Dead {{
              Se:mains = 50 V * sin(3 Hz * t)
              R:feed = 2 Ohm
              R:d {{ e = min(s, 0)*1 V; f = max(s, 0)*1 A }}
              R:wheel {{ e = min(s, 0)*1 V; f = max(s, 0)*1 A }}
              I:coil = 30 mH
              R:load = 5 Ohm
              Se:back = {emf}
              mains -> 1:m -> d, feed, 0:n
              1:w -> wheel
              w -> n
              n -> 1:out -> coil, load, back
              probe u = n.e
              probe off = (n.e - mains.e + 2 Ohm * coil.f)/(1 V)
              simulate {{ stop = 2 s }}
            }}"
        )
    };
    shows(&text("100 V + 20 V * sin(7 Hz * t)"), "u", 1e-9, |t| 100.0 + 20.0 * f64::sin(7.0 * t));
    // At 0.45 s and 1.37 s: above 10 V, and below.
    let compiled = with(Options::new(), &text("10 V"));
    let mut sim = start(&compiled, Steps::new());
    advance(&mut sim, 0.45);
    close(probe(&mut sim, "off"), 0.0, 1e-7, "while it conducts");
    advance(&mut sim, 1.37);
    close(probe(&mut sim, "u"), 10.0, 1e-6, "while nothing flows");
}

/// The node of a bridge between the inductance of a line and a coil: the diodes that conduct join these, and it has
/// what is left of the source to the coil, `u = R i + L (|e| - R i)/(L + l)`. One pair carries all of the current, and
/// no diode gives power, but for some 1e-5 of what they pass on.
#[test]
fn a_node_between_two_coils() {
    for (method, tolerance) in [("", 1e-6), ("", 1e-9), ("radau", 1e-6), ("collocation4", 1e-8), ("gonzalez", 1e-7)] {
        let options = if method.is_empty() { Options::new() } else { Options::new().method(method) };
        let compiled = with(options.accuracy(Accuracy::Tolerance(tolerance)), BRIDGE);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        for t in [1e-3, 3e-3, 7e-3, 13e-3, 18e-3, 36e-3, 75e-3] {
            advance(&mut sim, t);
            let (e, i) = (325.0 * f64::sin(100.0 * std::f64::consts::PI * t).abs(), probe(&mut sim, "i"));
            let u = 10.0 * i + 20.0 * (e - 10.0 * i) / 21.0;
            let what = format!("{method}, {tolerance:e}, {t} s");
            close(probe(&mut sim, "u"), u, 1e-5, &what);
            close(probe(&mut sim, "carries"), i, 1e-4, &what);
            assert!(probe(&mut sim, "gives") > -0.05, "{what}: {} W", probe(&mut sim, "gives"));
        }
    }
}

/// What it holds may jump: the friction of a block that is pressed less goes on holding it, with the force that is
/// asked of it, as soon as that is so, for samples too.
#[test]
fn what_holds_while_its_limit_jumps() {
    shows(
        "model Pressed {
          input pull = 5 N
          Se:push = pull
          I:m = 1 kg
          R:dry {
            e = (if t < 1 s then 20 N else 8 N) * min(max(s, -1), 1)
            f = (s - min(max(s, -1), 1))*1 m/s
          }
          push -> 1:v -> m, dry
          sampled at 100 Hz { state least = 5 { next = min(least, dry.e/(1 N)) } }
          probe friction = min(dry.e, least * 1 N)
          simulate { stop = 2 s }
        }",
        "friction",
        1e-9,
        |_| 5.0,
    );
}

/// Two dry frictions in series come to rest, and rows go on: the weaker one holds no more than it can.
#[test]
fn two_frictions_in_series() {
    let text = "model Series {
      I:a { inertia = 2 kg; p0 = 1 N*s }
      R:r { e = 0.5 N * min(max(s, -1), 1) + 0.1 N * (s - min(max(s, -1), 1)); f = (s - min(max(s, -1), 1))*1 m/s }
      R:q { e = 1.6 N * min(max(s, -1), 1) + 0.1 N * (s - min(max(s, -1), 1)); f = (s - min(max(s, -1), 1))*1 m/s }
      a -> 1:J -> 0:K -> q, r
      probe v = a.f
      probe F = r.e
      simulate { stop = 4 s }
    }";
    for (options, steps, way) in ways() {
        let compiled = with(options, text);
        let mut sim = start(&compiled, steps);
        for k in 1..=16 {
            advance(&mut sim, 0.25 * f64::from(k));
            assert!(probe(&mut sim, "F").abs() < 0.7, "{way}: {} N", probe(&mut sim, "F"));
        }
        // Equal steps that go beyond where it stops leave a speed behind.
        close(probe(&mut sim, "v"), 0.0, if way == "10 ms" { 2e-3 } else { 1e-9 }, way);
    }
}

/// Two guides of one body: how they share the force at rest is open, so that they are at the same place of their
/// curves, each with its part of what it can hold.
#[test]
fn two_frictions_on_one_body() {
    let text = "use std.contact
      model Guides {
        Se:u = 4 N/s * t
        I:m = 1 kg
        CoulombFriction:left(Fc = 0.5 N)
        CoulombFriction:right(Fc = 0.8 N)
        u -> 1:w -> m, left.slide, right.slide
        probe v = m.f
        probe shared = left.friction.e/(0.5 N) - right.friction.e/(0.8 N)
        probe held = left.friction.e + right.friction.e
        simulate { stop = 1 s }
      }";
    // From 0.325 s on dv/dt = 4 N/s t - 1.3 N.
    let v = |t: f64| if t < 0.325 { 0.0 } else { 2.0 * (t - 0.325) * (t - 0.325) };
    for tolerance in [1e-6, 1e-7, 1e-9] {
        let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), text);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        for t in [0.1, 0.3, 0.7, 1.0] {
            advance(&mut sim, t);
            close(probe(&mut sim, "v"), v(t), 1e-5, "speed");
            close(probe(&mut sim, "shared"), 0.0, 1e-9, "shared");
            close(probe(&mut sim, "held"), f64::min(4.0 * t, 1.3), 1e-9, "held");
        }
        assert!(sim.summary().passive && sim.summary().regions[0].steps < 200, "{:?}", sim.summary());
    }
}

/// A source that moves takes a state along through a law that stands upright: a body that sticks to a belt, and the
/// charge of a capacitor behind a diode that conducts. What the law gives is what that takes, in rows and where samples
/// read it.
#[test]
fn what_a_source_hands_on() {
    let belt = "model Belt {
      Sf:belt = 1 m/s * sin(2 Hz * t)
      R:rub { e = 15 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
      I:body = 3 kg
      I:cart = 2 kg
      belt -> 0:x -> rub, body
      sampled at 1 kHz { state held = 0 N { next = x.e } }
      MSe:push = held
      push -> 1:v -> cart
      probe force = x.e
      probe speed = cart.f
      simulate { stop = 2 s }
    }";
    let diode = "model Charges {
      Se:u = 10 V * sin(0.5 Hz * t)
      R:d { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
      C:c = 1 F
      R:load = 10 Ohm
      u -> 1:i -> d, 0:n
      n -> c, load
      probe current = d.f
      simulate { stop = 2 s }
    }";
    for way in [None, Some("radau"), Some("collocation8"), Some("gonzalez")] {
        let options = || way.map_or_else(Options::new, |way| Options::new().method(way));
        let steps = || if way == Some("gonzalez") { Steps::fixed(1e-4) } else { Steps::new() };
        let (belt, charges) = (with(options(), belt), with(options(), diode));
        let (mut sticks, mut charged) = (start(&belt, steps()), start(&charges, steps()));
        for t in [0.45, 1.0, 1.37, 1.9] {
            advance(&mut sticks, t);
            close(probe(&mut sticks, "force"), 6.0 * f64::cos(2.0 * t), 1e-4, &format!("force at {t}, {way:?}"));
            // What a sample reads is held from the next one on.
            let speed = 1.5 * f64::sin(2.0 * t);
            close(probe(&mut sticks, "speed"), speed, 1e-2, &format!("cart at {t}, {way:?}"));
            advance(&mut charged, t);
            let current = 5.0 * f64::cos(0.5 * t) + f64::sin(0.5 * t);
            close(probe(&mut charged, "current"), current, 1e-4, &format!("current at {t}, {way:?}"));
        }
    }
}
