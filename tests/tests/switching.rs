//! Resistances that switch: contacts, valves, choppers, the legs of bridges.

use crate::common::{BRIDGE, close, end, finish, probe, run, start, text, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps};
use bond_compiler::discretise::Accuracy;

const METHODS: [&str; 5] = ["", "gonzalez", "collocation4", "collocation8", "radau"];

fn by(method: &str) -> Options {
    if method.is_empty() { Options::new() } else { Options::new().method(method) }
}

/// A contact between a source and a capacitor that closes after 5 us, in the ways to write it: `t`, `s` and `u` after
/// 20 us by the charge of `R C = 10 ms`, then of `1 us`.
#[test]
fn a_contact_closes() {
    let contacts = [
        "R:sw = if t < 5 us then 10 kOhm else 1 Ohm",
        "R:sw { conductance = if t < 5 us then 0.1 mS else 1 S }",
        "R:sw { e = (if t < 5 us then 10 kOhm else 1 Ohm)*f }",
        "R:sw { e = f*(10 kOhm - (if t < 5 us then 0 Ohm else 9999 Ohm)) }",
        "let r = if sin(2*pi*t/(10 us)) > 0 then 10 kOhm else 1 Ohm  R:sw = if t < 7 us then r else 1 Ohm",
    ];
    let first = 5.0 * (1.0 - f64::exp(-5e-4));
    let last = 5.0 - (5.0 - first) * f64::exp(-15.0);
    for contact in contacts {
        for method in METHODS {
            let model =
                format!("model M {{ Se:bat = 5 V  {contact}  C:c = 1 uF  bat -> 1:b -> sw, c  probe u = c.e }}");
            let compiled = with(by(method), &model);
            close(end(&compiled, Steps::new(), 20e-6, "u"), last, 1e-6, &format!("{contact}, {method}"));
        }
    }
}

/// A resistance that is nothing after 5 us, and one that is before: `u` of a capacitor behind 1 kOhm, and of one beside
/// it.
#[test]
fn a_contact_may_be_ideal() {
    for (contact, law) in [
        ("series", "= if t < 5 us then 9 kOhm else 0 Ohm"),
        ("series", "{ e = if t < 5 us then 9 kOhm * f else 0 V }"),
        ("beside", "{ conductance = if t < 5 us then 0 S else 1 mS }"),
        ("beside", "{ f = if t > 5 us then 1 mS * e else 0 A }"),
    ] {
        let (graph, before, after) = match contact {
            "series" => ("bat -> 1:b -> sw, r, c", (5.0, 1e-5), (5.0, 1e-6)),
            _ => ("bat -> 1:b -> r, 0:n  n -> sw, c", (5.0, 1e-6), (2.5, 5e-7)),
        };
        let charged = before.0 * (1.0 - f64::exp(-5e-6 / before.1));
        let last = after.0 - (after.0 - charged) * f64::exp(-15e-6 / after.1);
        for method in ["", "gonzalez", "collocation8"] {
            let model =
                format!("model M {{ Se:bat = 5 V  R:sw {law}  R:r = 1 kOhm  C:c = 1 nF  {graph}  probe u = c.e }}");
            let compiled = with(by(method), &model);
            close(end(&compiled, Steps::new(), 20e-6, "u"), last, 2e-6, &format!("{contact} {law}, {method}"));
        }
    }
}

/// The dual: a current source that a coil is switched to by a conductance.
#[test]
fn a_contact_beside_a_coil_opens() {
    for law in ["{ conductance = if t < 5 us then 1 uS else 1 S }", "= if t < 5 us then 1 MOhm else 1 Ohm"] {
        for method in METHODS {
            let model =
                format!("model M {{ Sf:i0 = 2.5 A  R:sw {law}  I:l = 1 uH  i0 -> 0:n -> sw, l  probe i = l.f }}");
            let compiled = with(by(method), &model);
            let last = 2.5 * (1.0 - f64::exp(-15.0) * f64::exp(-5e6));
            close(end(&compiled, Steps::new(), 20e-6, "i"), last, 1e-5, &format!("{law}, {method}"));
        }
    }
}

/// It switches on the voltage that it charges, and on a sample.
#[test]
fn a_contact_switches_on_what_it_does() {
    for method in ["", "gonzalez", "collocation8"] {
        let model =
            "model M { Se:bat = 5 V  R:sw = if c.e > 1 V then 1 MOhm else 1 Ohm  C:c = 1 uF  bat -> 1:b -> sw, c
           probe u = c.e }";
        let compiled = with(by(method), model);
        // 1 V after ln(5/4) us.
        let rest = 20e-6 - 1e-6 * f64::ln(1.25);
        close(end(&compiled, Steps::new(), 20e-6, "u"), 5.0 - 4.0 * f64::exp(-rest), 1e-6, method);
        let model = "model M {
           sampled every 1 ms { state k = 0 { next = 1 - k } }
           Sf:src = 1 A * k  C:c = 1 mF  R:sw = if t < 2 ms then 1 Ohm else 10 kOhm
           src -> 0:n -> c, sw
           probe u = c.e }";
        let compiled = with(by(method), model);
        // R C is 1 ms, and then 10 s; the current flows in every other millisecond.
        let mut u = 1.0 - f64::exp(-1.0);
        for k in 2..10 {
            let (level, part) = (if k % 2 == 1 { 1e4 } else { 0.0 }, f64::exp(-1e-4));
            u = level + (u - level) * part;
        }
        let (mut sim, stop) = (start(&compiled, Steps::new()), 10e-3);
        finish(&mut sim, stop);
        close(probe(&mut sim, "u"), u, 1e-5, &format!("sampled, {method}"));
    }
}

/// A leg of a bridge: `up` opens at 0.1 ms, the current of the coil goes on through the diode, and `dn` closes beside
/// it at 0.12 ms. No step sees the contacts' rounding, whatever they let through while they are open.
#[test]
fn a_leg_hands_its_current_over() {
    for off in ["1e-9", "1e-6", "1e-3"] {
        for (method, step) in METHODS.iter().flat_map(|m| [(m, None), (m, Some(1e-6))]) {
            let model = format!(
                "model Leg {{
                   Se:dc = 300 V  Se:gnd = 0 V
                   R:up {{ conductance = if t < 0.1 ms then 100 S else {off} S }}
                   R:dn {{ conductance = if t > 0.12 ms then 100 S else {off} S }}
                   R:dd {{ e = min(s, 0) * 1 V; f = max(s, 0) * 1 A }}
                   I:l {{ inertia = 5 mH; f0 = 10 A }}
                   R:w = 2 Ohm
                   dc -> 1:ju -> up, 0:a
                   gnd -> 0:n -> 1:fd -> dd, a
                   a -> 1:jd -> dn, n
                   a -> 1:ph -> l, w
                   probe i = ph.f
                 }}"
            );
            let compiled = with(by(method), &model);
            let mut sim = start(&compiled, step.map_or(Steps::new(), Steps::fixed));
            finish(&mut sim, 2e-4);
            let what = format!("{off}, {method}, {step:?}");
            // 2.01 Ohm to 300 V, then 2 Ohm to 0 V, then 2.01 Ohm (the contact is at most 1 mOhm beside an ideal
            // diode).
            let i = 300.0 / 2.01 + (10.0 - 300.0 / 2.01) * f64::exp(-2.01 / 5e-3 * 1e-4);
            let i = i * f64::exp(-2.0 / 5e-3 * 1e-4);
            let leaks = if off == "1e-3" { 5e-3 } else { 2e-5 };
            close(probe(&mut sim, "i"), i, leaks * i, &what);
            let summary = sim.summary();
            assert!(summary.passive, "{what}: {:?}", summary.reasons);
            // 300 V times the charge that the source gave until it was cut off.
            let region = &summary.regions[0];
            assert!(region.supplied < 0.5 && region.dissipated < 0.2, "{what}: {} J", region.supplied);
        }
    }
}

/// Converters of the library's parts keep their balance to rounding.
#[test]
fn converters_are_passive() {
    let parts = [
        "Se:vin = 24 V  Se:gnd = 0 V  Chopper:sw(frequency = 100 kHz)  IdealDiode:d  I:l = 47 uH  C:c = 100 uF  R:load = 2.4 Ohm
         vin -> 1:in -> sw.p, 0:x  gnd -> 1:dm -> d.p, x  x -> 1:il -> l, 0:out  out -> c, load",
        "Se:vin = 12 V  I:l = 100 uH  R:rl = 50 mOhm  Chopper:q(frequency = 50 kHz)  Diode:d  C:c = 100 uF  R:load = 20 Ohm
         vin -> 1:a -> l, rl  a -> 0:sw -> q.p  sw -> 1:dd -> d.p  dd -> 0:o -> c, load",
        "Se:bat = 12 V  R:sw = if t > 1 ms and t < 3 ms then 10 mOhm else 1 GOhm  I:coil = 50 mH  R:rc = 20 Ohm
         R:fly { f = if e > 0 then e/(10 mOhm) else e/(1 GOhm) }  Se:g = 0 V
         bat -> 1:a -> sw, 0:x  x -> 1:m -> coil, rc  g -> 1:b -> fly  b -> x",
        "Se:bat = 24 V  R:q = if sin(2*pi*20 kHz * t) > 0 then 20 mOhm else 1 MOhm  R:d { e = (if f > 0 then 20 mOhm else 1 MOhm)*f }
         I:l = 1 mH  R:r = 1 Ohm  Se:gnd = 0 V  bat -> 1:a -> q, 0:x  gnd -> 1:b -> d  b -> x  x -> 1:m -> l, r",
        "Se:bat = 10 V  R:r1 = 1 Ohm  I:l = 1 mH  R:rr = 0.3 Ohm  R:k = if l.f > 3 A then 2 Ohm else 2 MOhm
         bat -> 1:a -> r1, 0:x  x -> k  x -> 1:m -> l, rr",
        "Se:bat = 24 V  R:hi = if sin(2*pi*20 kHz * t) > 0 then 10 mOhm else 1 MOhm
         R:lo = if sin(2*pi*20 kHz * t) > 0 then 1 MOhm else 10 mOhm  I:l = 100 uH  R:rl = 1 Ohm  Se:gnd = 0 V
         bat -> 1:a -> hi, 0:x  gnd -> 1:b -> lo  b -> x  x -> 1:m -> l, rl",
    ];
    for part in parts {
        let summary = run(&text(&format!("use std.electrical\nmodel M {{ {part} simulate {{ stop = 1 ms }} }}")));
        let summary = summary.unwrap_or_else(|e| panic!("{part}: {e}"));
        assert!(summary.passive, "{part}: {:?}", summary.reasons);
        assert!(summary.worst_step < 1e-13, "{part}: {:e}", summary.worst_step);
    }
}

/// Many conductances that change in time: the matrix of the linear equations is another at each node of a step.
#[test]
fn many_that_change_in_time() {
    let model = "model M { Se:bat = 5 V  0:n0  bat -> 1:b0  b0 -> n0  R:r0 = 1 Ohm  b0 -> r0
       for i in 1..20 {
         R:sw[i] { conductance = 1 S * (1.5 + sin(2*pi*100 kHz * t + i)) }
         C:c[i] = 1 uF
         n0 -> 1:b[i] -> sw[i], c[i]
       }
       probe u = c[20].e }";
    let want = end(&with(by("gonzalez"), model), Steps::fixed(5e-9), 20e-6, "u");
    for method in ["radau", "collocation4", "collocation8"] {
        let compiled = with(by(method), model);
        let mut sim = start(&compiled, Steps::fixed(5e-7));
        finish(&mut sim, 20e-6);
        close(probe(&mut sim, "u"), want, 1e-4, method);
        assert!(sim.summary().worst_step < 1e-12, "{method}: {:e}", sim.summary().worst_step);
    }
}

/// Where fixed steps end just when a contact switches, the step before sees nothing of it.
#[test]
fn fixed_steps_end_before_a_switch() {
    let model =
        "model M { Se:bat = 9 V  R:sw { conductance = if t >= 1 ms and t < 2 ms then 1 S else 1 pS }  R:r = 1 kOhm
       C:c = 1 uF  bat -> 1:b -> sw, r, c  probe u = c.e }";
    for method in METHODS {
        let compiled = with(by(method).accuracy(bond_compiler::discretise::Accuracy::Fixed), model);
        let last = 9.0 * (1.0 - f64::exp(-1.0 / 1.001));
        close(end(&compiled, Steps::fixed(1e-6), 3e-3, "u"), last, 1e-6, method);
    }
}

/// A law of two lines means the same whichever of the two it is solved for: drawn away from the resistor, its argument
/// is that of the bond, and what it gives is against it.
#[test]
fn two_lines_keep_the_sense_of_the_half_arrow() {
    for (law, line) in [
        ("{ e = if f > 0 m/s then b*f else (1e6 N*s/m)*f }", 10.0),
        ("{ e = b*max(f, 0) + (1e6 N*s/m)*min(f, 0) }", 10.0),
    ] {
        for (bond, pull) in [("brake -> 1:v", -1.0), ("1:v -> brake", 1.0)] {
            let model = format!(
                "model M(b = 10 N*s/m) {{ I:m {{ inertia = 1 kg; f0 = 1 m/s }}  R:brake {law}  {bond}  v -> m
                   probe speed = v.f  probe force = brake.e }}"
            );
            for method in METHODS {
                let compiled = with(by(method), &model);
                let what = format!("{law}, {bond}, {method}");
                close(end(&compiled, Steps::tolerance(1e-8), 0.1, "speed"), f64::exp(-0.1 * line), 1e-6, &what);
                close(
                    end(&compiled, Steps::tolerance(1e-8), 0.1, "force"),
                    pull * line * f64::exp(-0.1 * line),
                    1e-5,
                    &what,
                );
            }
        }
    }
    let model = "model M { Sf:g = 1e-3 m^3/s  Se:env = 300 K
        RS(r, th):b { e = if f > 0 then (1e8 Pa*s/m^3)*f else (1e13 Pa*s/m^3)*f }
        b.r -> g  b.th -> env  probe e = b.r.e }";
    close(end(&text(model), Steps::new(), 1.0, "e"), -1e5, 1e-9, "a valve that heats");
}

/// A third line far out is no less of the law.
#[test]
fn a_third_line_counts() {
    let model = "model M { Sf:push = 10 m/s  push -> d  probe e = d.e
        R:d { e = if f < 0 then (10 N*s/m)*f else (if f > 5 m/s and f < 100 m/s then (2e6 N*s/m)*f else (1e6 N*s/m)*f) } }";
    close(end(&text(model), Steps::new(), 1.0, "e"), 2e7, 1e-12, "between 5 and 100 m/s");
}

/// A diode given as a conductance across a capacitor is as much of a switch as one given as a resistance: by scipy's
/// Radau with 1e-9.
#[test]
fn a_conductance_may_be_a_diode() {
    for diode in ["f = if e > 0 then 1000 S * e else 0.001 S * e", "e = if f > 0 then 0.001 Ohm * f else 1000 Ohm * f"]
    {
        let model = format!(
            "model M {{ Se:s = 5 V * sin(2*pi*1 Hz * t)  R:r = 10 Ohm  C:c = 1 mF  R:d {{ {diode} }}
               s -> 1:k -> r  k -> 0:j -> c, d  probe i = d.f }}"
        );
        for tolerance in [1e-6, 1e-8] {
            close(end(&text(&model), Steps::tolerance(tolerance), 1.3, "i"), 0.475482, 2e-5, diode);
        }
    }
}

/// A bridge of ideal diodes behind the inductance of a line: while the current goes over from one pair to the other,
/// all four conduct, and what goes round in them is open. The load's current against that of the two circuits, by
/// turns.
#[test]
fn a_bridge_behind_a_line_commutes() {
    let (line, coil, r, u) = (1e-3, 20e-3, 10.0, |t: f64| 325.0 * f64::sin(100.0 * std::f64::consts::PI * t));
    let (mut i, mut side, mut through, n) = (0.0f64, 1.0f64, None, 1_000_000);
    let h = 0.1 / f64::from(n);
    for k in 0..n {
        let middle = u((f64::from(k) + 0.5) * h);
        let rate = |i: f64| if through.is_some() { -r * i / coil } else { (side * middle - r * i) / (line + coil) };
        i += h * rate(i + 0.5 * h * rate(i));
        through = match through {
            // All four: the line takes what the source has.
            Some(x) if f64::abs(x + h * middle / line) < i => Some(x + h * middle / line),
            Some(x) => {
                side = f64::signum(x + h * middle / line);
                None
            }
            None if coil * side * middle + line * r * i < 0.0 => Some(side * i),
            None => None,
        };
    }
    for (method, tolerance, off) in [
        ("", 1e-6, 1e-3),
        ("", 1e-9, 1e-5),
        ("radau", 1e-6, 1e-4),
        ("collocation4", 1e-8, 1e-5),
        ("gonzalez", 1e-7, 1e-4),
    ] {
        let compiled = with(by(method).accuracy(Accuracy::Tolerance(tolerance)), BRIDGE);
        close(end(&compiled, Steps::tolerance(tolerance), 0.1, "i"), i, off * i, &format!("{method} {tolerance:e}"));
    }
    let compiled = with(Options::new(), BRIDGE);
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    finish(&mut sim, 0.1);
    assert!(sim.summary().passive);
}

/// A bridge of diodes between the inductance of a line and what `plus` feeds.
fn bridge(diode: &str, line: &str, load: &str) -> String {
    format!(
        "model M {{
          Se:mains = 12 V * sin(100*pi*1 Hz * t)
          I:line = {line}
          R:d1 {diode}  R:d2 {diode}  R:d3 {diode}  R:d4 {diode}
          mains -> 1:across -> line, 0:a
          0:b -> across
          a -> 1:m1 -> d1, 0:plus
          b -> 1:m2 -> d2, plus
          1:m3 -> d3, a
          1:m4 -> d4, b
          {load}
        }}"
    )
}

/// A bridge of diodes with a threshold behind a line: nothing tells at its start what lies between diodes that all
/// block.
#[test]
fn a_bridge_with_thresholds_starts() {
    let load = "R:load = 44 Ohm  plus -> load  probe i = line.f  probe u = plus.e";
    let text = bridge("{ e = 0.7 V + min(s, 0)*1 V; f = max(s, 0)*1 A }", "10 mH", load);
    let (mut i, mut at, n) = (0.0f64, Vec::new(), 400_000);
    let h = 0.04 / f64::from(n);
    for k in 0..n {
        let v = 12.0 * f64::sin(100.0 * std::f64::consts::PI * (f64::from(k) + 0.5) * h);
        let side = if i == 0.0 { v.signum() } else { i.signum() };
        let rate = |i: f64| (side * v - 1.4 - 44.0 * i.abs()) / 10e-3;
        let next = i.abs() + h * rate(i.abs() + 0.5 * h * rate(i));
        i = side * next.max(0.0);
        if (k + 1) % (n / 8) == 0 {
            at.push(i);
        }
    }
    // Where the current ends within a step of a fixed length, a part of it is left over.
    let ways = [
        (Accuracy::Tolerance(1e-8), Steps::tolerance(1e-8), 2e-5),
        (Accuracy::AsModel, Steps::new(), 3e-4),
        (Accuracy::Fixed, Steps::fixed(5e-6), 3e-4),
    ];
    for (accuracy, steps, off) in ways {
        let compiled = with(Options::new().accuracy(accuracy), &text);
        let mut sim = start(&compiled, steps);
        for (k, wanted) in at.iter().enumerate() {
            let t = 5e-3 * f64::from(k as u32 + 1);
            sim.advance(t).unwrap_or_else(|e| panic!("{accuracy:?}: {e}"));
            close(probe(&mut sim, "i"), *wanted, off, &format!("{accuracy:?}, {t} s"));
            close(probe(&mut sim, "u"), 44.0 * wanted.abs(), 44.0 * off, &format!("{accuracy:?}, {t} s"));
        }
        assert!(sim.summary().passive, "{:?}", sim.summary());
    }
}

/// Two dry frictions in series, of which nothing tells at the start which one slides: the weaker one does.
#[test]
fn the_weaker_of_two_frictions_slides() {
    let text = "model Series {
      I:a { inertia = 2 kg; f0 = 1 m/s }
      R:r { e = 0.5 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
      R:q { e = 1.6 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
      a -> 1:J -> 0:K -> q, r
      probe v = a.f
      probe F = r.e
    }";
    for method in ["", "radau", "collocation8"] {
        let compiled = with(by(method), text);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        for k in 1..=5 {
            let t = 0.75 * f64::from(k);
            sim.advance(t).unwrap_or_else(|e| panic!("{method}: {e}"));
            close(probe(&mut sim, "v"), 1.0 - 0.25 * t, 1e-9, method);
            close(probe(&mut sim, "F"), 0.5, 1e-9, method);
        }
        sim.finish(5.0).unwrap_or_else(|e| panic!("{method}: {e}"));
        close(probe(&mut sim, "v"), 0.0, 1e-9, method);
    }
}

/// What flows into two diodes that block has nowhere to go, and is not taken for their leak.
#[test]
fn a_flow_into_diodes_that_block_has_no_start() {
    let diode = "{ e = 0.7 V + min(s, 0)*1 V; f = max(s, 0)*1 A }";
    let text = format!("model M {{ Sf:i0 = -1 mA  R:d1 {diode}  R:d2 {diode}  i0 -> 0:j -> d1, d2  probe u = d1.e }}");
    let wrong = Options::new().compile_str("test.bond", &text).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(wrong.contains("no solution was found at the start") && wrong.contains("a small leak"), "{wrong}");
}

/// A coil behind a bridge whose diodes have a threshold and leak a little is fed while the source is above both
/// thresholds, and discharges through all four else, until none is left.
#[test]
fn a_bridge_that_leaks_feeds_a_coil() {
    let diode = "{ e = 0.7 V + min(s, 0)*1 V; f = max(s, 0)*1 A + 1 uA * (0.7 + min(s, 0)) }";
    let load = "I:coil = 12 mH  R:load = 44 Ohm  plus -> 1:out -> load, coil  probe i = coil.f";
    let model = bridge(diode, "1 uH", load);
    let (mut i, mut at, n) = (0.0f64, Vec::new(), 400_000);
    let h = 0.04 / f64::from(n);
    for k in 0..n {
        let u = |t: f64| 12.0 * f64::sin(100.0 * std::f64::consts::PI * t).abs() - 1.4;
        let middle = i + 0.5 * h * (u(f64::from(k) * h) - 44.0 * i) / 12e-3;
        i = (i + h * (u((f64::from(k) + 0.5) * h) - 44.0 * middle) / 12e-3).max(0.0);
        if (k + 1) % (n / 8) == 0 {
            at.push(i);
        }
    }
    for method in ["", "gonzalez", "radau"] {
        let compiled = with(by(method).accuracy(Accuracy::Tolerance(1e-6)), &model);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        for (k, wanted) in at.iter().enumerate() {
            let t = 5e-3 * f64::from(k as u32 + 1);
            sim.advance(t).unwrap_or_else(|e| panic!("{method}: {e}"));
            close(probe(&mut sim, "i"), *wanted, 1e-4, &format!("{method}, {t} s"));
        }
        assert!(sim.summary().passive, "{:?}", sim.summary());
    }
}

/// What hands a source on to a storage, as a bridge of diodes to a capacitor and dry friction to a body that sticks to
/// a belt, is not stepped to and fro about it: each law lets go and takes hold a few times a period.
#[test]
fn a_storage_goes_with_a_source() {
    let diode = "{ e = 0.7 V + min(s, 0)*1 V; f = max(s, 0)*1 A + 1 uA * (0.7 + min(s, 0)) }";
    let bridge = bridge(diode, "1 uH", "C:cap = 1 mF  R:load = 44 Ohm  plus -> load, cap  probe u = cap.e");
    let direct = bridge.replace("I:line = 1 uH", "").replace("across -> line, 0:a", "across -> 0:a");
    let belt = "model Belt {
      Sf:belt = 0.5 m/s * sin(6*pi*1 Hz * t)
      R:rub { e = 15 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
      I:body = 1 kg
      belt -> 0:x -> rub, body
      probe u = body.f
    }";
    let swing = |t: f64| 12.0 * f64::sin(100.0 * std::f64::consts::PI * t) - 1.4;
    let speed = |t: f64| 0.5 * f64::sin(6.0 * std::f64::consts::PI * t);
    for (name, text, at, wanted) in [("bridge", direct.as_str(), 0.045, swing(0.045)), ("belt", belt, 0.4, speed(0.4))]
    {
        for tolerance in [None, Some(1e-6), Some(1e-8)] {
            let accuracy = tolerance.map_or(Accuracy::AsModel, Accuracy::Tolerance);
            let compiled = with(Options::new().accuracy(accuracy), text);
            let mut sim = start(&compiled, tolerance.map_or_else(Steps::new, Steps::tolerance));
            finish(&mut sim, at);
            close(probe(&mut sim, "u"), wanted, 1e-5, &format!("{name}, {tolerance:?}"));
            let summary = sim.summary();
            assert!(summary.passive, "{name}, {tolerance:?}: {:?}", summary.reasons);
            let steps = summary.regions[0].steps;
            assert!(steps < 1000, "{name}, {tolerance:?}: {steps} steps");
        }
    }
}

/// Diodes of two straight pieces, conducting to 10 mOhm and blocking to 10 uS: where a step ends at the corner of one,
/// what rounding leaves there is looked at, and the balance closes.
#[test]
fn corners_of_steep_diodes_balance() {
    let diode = "{ f = if e > 0 V then e/(10 mOhm) else 10 uS * e }";
    let load = "C:cap = 0.1 mF  R:load = 50 Ohm  plus -> load, cap";
    let model = bridge(diode, "1 mH", load).replace("12 V", "325 V");
    for tolerance in [1e-6, 1e-8, 1e-10] {
        let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), &model);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        finish(&mut sim, 0.06);
        let summary = sim.summary();
        assert!(summary.passive, "{tolerance:e}: {:?}", summary.reasons);
    }
}

/// Diodes of the library in a bridge behind a coil: while all of them block, their leak tells what each bears. Steps to
/// a tolerance of 1e-6 look at where on an exponential they end, as those to none that is told.
#[test]
fn diodes_of_the_library_make_a_bridge() {
    let model = |peak: f64| {
        format!(
            "use std.electrical
            model B {{
              Se:mains = {peak} V * sin(100*pi*1 Hz * t)
              I:line = 1 mH  R:wire = 0.1 Ohm
              for k in 1..4 {{ Diode:d[k](Is = 1 nA, n = 1.8) }}
              Se:ground = 0 V  C:cap = 1 mF  R:load = 50 Ohm
              mains -> 1:mesh -> line, wire, 0:a
              0:b -> mesh
              a -> 1:m1 -> d[1].p, 0:plus
              b -> 1:m2 -> d[2].p, plus
              ground -> 0:minus
              minus -> 1:m3 -> d[3].p, a
              minus -> 1:m4 -> d[4].p, b
              plus -> cap, load
            }}"
        )
    };
    for peak in [5.0, 24.0, 325.0] {
        for tolerance in [None, Some(1e-6)] {
            let accuracy = tolerance.map_or(Accuracy::AsModel, Accuracy::Tolerance);
            let compiled = with(Options::new().accuracy(accuracy), &model(peak));
            let mut sim = start(&compiled, tolerance.map_or_else(Steps::new, Steps::tolerance));
            finish(&mut sim, 0.04);
            let summary = sim.summary();
            assert!(summary.passive, "{peak} V, {tolerance:?}: {:?}", summary.reasons);
            assert_eq!(summary.regions[0].stepper, "radau", "{tolerance:?}");
        }
    }
}
