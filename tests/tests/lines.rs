//! Lossless lines: bounce diagrams, what is on the way, and that nothing comes out that did not go in.

use crate::common::{advance, close, end, errors, finish, probe, start, text, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps};
use bond_compiler::discretise::Accuracy;

/// Reflections of a step at both ends: the effort at the far end after so many delays.
fn bounces(source: f64, load: f64, z: f64, delays: u32) -> [f64; 2] {
    let (back, forth) = ((source - z) / (source + z), (load - z) / (load + z));
    let into = z / (z + source);
    // Waves as e + Z f over 2: what goes out at each end, by interval of a delay.
    let (mut near, mut far) = (vec![into], vec![0.0]);
    for k in 1..=delays as usize {
        let (to_far, to_near) = (near[k - 1], far[k - 1]);
        near.push(into + back * to_near);
        far.push(forth * to_far);
    }
    let k = delays as usize;
    let coming = if k == 0 { [0.0, 0.0] } else { [far[k - 1], near[k - 1]] };
    [near[k] + coming[0], far[k] + coming[1]]
}

fn cable(head: &str, source: f64, load: f64, z: f64, delay: f64) -> String {
    format!(
        "model M {{
           {head} {{
             Se:u = 1 V
             R:r = {source} Ohm
             TL(a, b):line {{ impedance = {z} Ohm; delay = {delay} s }}
             R:load = {load} Ohm
             u -> 1:in -> r, line.a
             line.b -> load
           }}
           probe near = line.a.e
           probe far = line.b.e
         }}"
    )
}

/// With any terminations, over many bounces, to rounding.
#[test]
fn the_bounce_diagram() {
    for (source, load, z, n) in
        [(150.0, 25.0, 50.0, 5), (1e-3, 1e6, 1.0, 1), (7.0, 0.02, 300.0, 12), (50.0, 50.0, 50.0, 2)]
    {
        let compiled = text(&cable("sampled every 1 ms", source, load, z, f64::from(n) * 1e-3));
        let mut sim = start(&compiled, Steps::new());
        for k in 0..60 {
            advance(&mut sim, (f64::from(k * n) + 0.5) * 1e-3);
            let wanted = bounces(source, load, z, k as u32);
            for (name, wanted) in ["near", "far"].into_iter().zip(wanted) {
                close(probe(&mut sim, name), wanted, 1e-12, name);
            }
        }
        let summary = sim.summary();
        assert!(summary.passive, "{:?}", summary.reasons);
        assert!(summary.lines[0].energy > 0.0);
    }
}

/// Masses and springs at both ends, a step that is long for them: all energy is accounted for, and the line never gives
/// more than it has. With nothing that loses any, the whole keeps what it began with.
#[test]
fn a_sampled_line_is_passive() {
    let compiled = text(
        "model M {
           sampled every 20 ms {
             I:m1 { inertia = 1 kg; f0 = 1 m/s }
             C:k1 { stiffness = 90 N/m }
             TL(a, b):line { impedance = 3 N*s/m; delay = 60 ms }
             I:m2 = 0.5 kg
             C:k2 { stiffness = 400 N/m; q0 = 0.1 m }
             1:v1 -> m1, k1
             v1 -> line.a
             line.b -> 1:v2
             v2 -> m2, k2
           }
           probe h = m1.H + k1.H + m2.H + k2.H
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    let total = 0.5 + 2.0;
    for k in 1..=2000 {
        advance(&mut sim, f64::from(k) * 0.02);
        let summary = sim.summary();
        let on_the_way = summary.lines[0].energy;
        assert!(on_the_way >= -1e-14, "{on_the_way}");
        close(probe(&mut sim, "h") + on_the_way, total, 1e-11, "what was there at the start");
        assert!(summary.passive, "{:?}", summary.reasons);
    }
}

/// In continuous time, to the order of the steps: a smooth pulse goes through, is turned round at an open end, and is
/// taken at the near one.
#[test]
fn a_line_in_continuous_time() {
    let model = "model M {
      Se:u = 2 V * exp(-((t - 1 s)/(0.2 s))^2)
      R:r = 4 Ohm
      TL(a, b):line { impedance = 4 Ohm; delay = 1.3 s }
      C:end = 0.05 F
      u -> 1:in -> r, line.a
      line.b -> end
      probe near = line.a.e
      probe lost = integral(r.P, 0 J)
    }";
    let exact = end(&with(fitted(1e-12), model), Steps::tolerance(1e-12), 3.9, "near");
    for (method, order) in [("gonzalez", 2), ("collocation4", 4), ("collocation6", 6)] {
        let compiled = with(Options::new().method(method), model);
        let error = |h: f64| (end(&compiled, Steps::fixed(h), 3.9, "near") - exact).abs();
        let (coarse, fine) = (error(0.05), error(0.025));
        let found = (coarse / fine).log2();
        assert!(found > f64::from(order) - 0.6, "{method}: {coarse:e} {fine:e}, order {found}");
    }
    for steps in [Steps::tolerance(1e-4), Steps::tolerance(1e-9), Steps::fixed(0.05)] {
        let compiled = with(fitted(1e-9), model);
        let mut sim = start(&compiled, steps);
        for k in 1..=90 {
            advance(&mut sim, f64::from(k) * 0.1);
            let summary = sim.summary();
            assert!(summary.lines[0].energy >= -summary.lines[0].rounding, "{:?}", summary.lines);
            assert!(summary.passive, "{:?}", summary.reasons);
        }
        finish(&mut sim, 9.0);
        let summary = sim.summary();
        assert!(summary.lines[0].energy.abs() < 1e-3, "all is out again: {:?}", summary.lines);
    }
}

/// A line that is empty but for the rounding of its sums: what comes out is nothing, and no undefined number, with ends
/// that take all of it.
#[test]
fn an_empty_line_gives_nothing() {
    let model = "model M {
      Se:u = 2 V * (if t < 6 s then sin(37*t/1 s) + (if sin(5*t/1 s) < 0 then 1 else 0) else 0)
      R:r = 4 Ohm
      TL(a, b):line { impedance = 4 Ohm; delay = 0.13 s }
      R:load = 4 Ohm
      u -> 1:in -> r, line.a
      line.b -> load
      probe far = line.b.e
    }";
    for method in ["gonzalez", "collocation4", "collocation8"] {
        let compiled = with(Options::new().method(method), model);
        let mut sim = start(&compiled, Steps::fixed(0.1));
        for k in 1..=400 {
            advance(&mut sim, f64::from(k) * 0.1);
            assert!(probe(&mut sim, "far").is_finite(), "{method}, {k}");
        }
        assert!(probe(&mut sim, "far").abs() < 1e-6, "{method}");
    }
}

fn fitted(tolerance: f64) -> Options {
    Options::new().accuracy(Accuracy::Tolerance(tolerance))
}

/// A teleoperator: two handles over a line of 10 ms each way. By states the same delay gives energy without end; the
/// line gives none.
#[test]
fn a_teleoperator_is_passive() {
    let compiled = text(
        "model M {
           I:master { inertia = 0.5 kg; f0 = 1 m/s }
           I:slave = 0.2 kg
           C:wall { stiffness = 4000 N/m }
           sampled at 1 kHz {
             TL(a, b):line { impedance = 20 N*s/m; delay = 10 ms }
             1:m
             1:s
             m -> line.a
             line.b -> s
           }
           1:v -> master
           1:w -> slave, wall
           v ||> m
           s ||> w
           probe h = master.H + slave.H + wall.H
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    for k in 1..=100 {
        advance(&mut sim, f64::from(k) * 0.02);
        assert!(probe(&mut sim, "h") <= 0.25 * (1.0 + 1e-9));
    }
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
}

/// What is stored at the far end of a line is behind its near end: it may come, and what comes is no more.
#[test]
fn what_is_behind_a_line_may_be_drawn() {
    let compiled = text(
        "model M {
           sampled at 1 kHz {
             Se:hand = 0 N
             R:grip = 2 N*s/m
             C:spring { stiffness = 100 N/m; q0 = 0.1 m }
             TL(a, b):line { impedance = 2 N*s/m; delay = 5 ms }
             hand -> 1:v -> grip, line.a
             line.b -> spring
           }
           expect passive at hand
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 1.0);
    let summary = sim.summary();
    close(summary.watched[0].stored, 0.5, 1e-15, "what the spring holds at the start");
    assert!(summary.watched[0].broken.is_none());
}

/// With nothing that loses energy and a line that is too stiff for what moves it, the bars let go, and a hold adds to
/// steps: what leaves into the line is shortened, so that it takes no more than there is.
#[test]
fn what_holds_add_does_not_go_into_a_line() {
    for (delay, k, z) in [(10, 10.0, 200.0), (200, 4000.0, 20.0), (200, 1e6, 200.0), (1, 4e3, 2e3), (3, 1e6, 50.0)] {
        let compiled = text(&format!(
            "model M {{
               I:master {{ inertia = 0.5 kg; f0 = 1 m/s }}
               I:slave = 0.2 kg
               C:wall {{ stiffness = {k} N/m }}
               sampled at 1 kHz {{
                 TL(a, b):line {{ impedance = {z} N*s/m; delay = {delay} ms }}
                 1:m -> line.a
                 line.b -> 1:s
               }}
               1:v -> master
               1:w -> slave, wall
               v ||> m
               w ||> s
               probe h = master.H + slave.H + wall.H
             }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        for k in 1..=2000 {
            advance(&mut sim, f64::from(k) * 1e-3);
            let all = probe(&mut sim, "h") + sim.summary().lines[0].energy;
            assert!(all <= 0.25 * (1.0 + 1e-9), "{all} J of 0.25 J at {k} ms, {delay} ms {z} N s/m");
        }
        let summary = sim.summary();
        assert!(summary.passive, "{:?}", summary.reasons);
        assert!(summary.lines[0].energy > 0.01, "{:?}", summary.lines);
    }
}

#[test]
fn what_is_no_line() {
    let first = |body: &str| {
        let all = errors(&format!("model M {{ Se:u = 1 V {body} R:r = 1 Ohm u -> l.a l.b -> r }}"));
        (all.list()[0].code.to_string(), all.to_string())
    };
    for (body, code, words) in [
        ("TL(a, b):l { impedance = 50 Ohm }", "elaborate::value", "no delay"),
        ("TL(a, b):l { impedance = 50 Ohm; delay = 1 ms; loss = 1 }", "elaborate::field", "no field `loss`"),
        ("TL(a, b):l { impedance = -50 Ohm; delay = 1 ms }", "elaborate::value", "impedance"),
        ("TL(a, b):l { impedance = 50 N; delay = 1 ms }", "units::mismatch", "the impedance of `l`"),
        ("TL(a, b):l { impedance = 50 Ohm; delay = 1 m }", "units::mismatch", "the delay of `l`"),
        ("TL(a, b, c):l { impedance = 50 Ohm; delay = 1 ms }", "elaborate::field_ports", "two ports"),
    ] {
        let (found, all) = first(body);
        assert_eq!(found, code, "{all}");
        assert!(all.contains(words), "{all}");
    }
    let all = errors(&cable("sampled every 1 ms", 1.0, 1.0, 1.0, 2.5e-3));
    assert_eq!(all.list()[0].code, "elaborate::delay", "{all}");
}
