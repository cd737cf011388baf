//! What real loops have: a latency, and an encoder that reads in steps.

use crate::common::{advance, close, errors, finish, models, probe, read, start, text, with};
use bond::exchange::{Exchange, Heard, Measurement};
use bond::{Options, Steps};

/// Whether the hand of an example draws no more than it puts in, where the wall has so much of the stiffness at a known
/// limit.
fn is_passive(model: &str, part: f64) -> bool {
    let whole = read(&models().join("examples/real_loop.bond"));
    let compiled = with(Options::new().model(model), &whole.replace("0.99*", &format!("{part}*")));
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 1.0);
    sim.summary().watched.iter().all(|at| at.broken.is_none())
}

/// Abbott and Okamura's limit of an encoder, 2 fc/step, that of a hand that shakes, 2 b/T, and the one of a latency,
/// b/(T/2 + late): a wall is passive one per cent below, and not one above.
#[test]
fn known_limits_are_met_from_both_sides() {
    for model in ["Encoder", "Late"] {
        assert!(is_passive(model, 0.99) && !is_passive(model, 1.01), "{model}");
    }
    let shaken = |part: f64| {
        let compiled = text(&format!(
            "model Shaken(b = 0.05 N*s/m, T = 1 ms, K = {part}*2*b/T) {{
               Sf:hand = if mod(t, 2*T) < T then 10 mm/s else -10 mm/s
               R:friction = b
               sampled every T hold lagged budget off {{ C:wall {{ stiffness = K }} }}
               hand -> 1:v -> friction
               v ||> wall
               expect passive at hand
               simulate {{ stop = 0.5 s }}
             }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 0.5);
        sim.summary().watched.iter().all(|at| at.broken.is_none())
    };
    assert!(shaken(0.99) && !shaken(1.01));
}

/// A wall behind a hand that moves at 1 m/s: what is found at a sample, k x, is held from the latency on, and both
/// sides book the energy of both parts of each interval.
#[test]
fn what_is_found_at_a_sample_is_held_later() {
    for late in [0.0, 0.25, 0.5, 1.0] {
        let compiled = text(&format!(
            "model Moved {{
               Sf:hand = 1 m/s
               sampled every 8 ms hold lagged budget off latency {late}*(8 ms) {{ C:wall {{ stiffness = 1000 N/m }} }}
               hand -> 1:v -[bar]||> wall
               probe force = bar.e
               simulate {{ stop = 1 s }}
             }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        let mut energy = 0.0;
        for k in 0..10 {
            let found = f64::from(k) * 8.0;
            let held = if late > 0.0 { (found - 8.0).max(0.0) } else { found };
            for part in [0.1, 0.3, 0.7, 0.9] {
                advance(&mut sim, (f64::from(k) + part) * 0.008);
                let wanted = if part < late { held } else { found };
                close(probe(&mut sim, "force"), wanted, 1e-9, &format!("{late}, at {k} + {part} samples"));
            }
            energy += 0.008 * (late * held + (1.0 - late) * found);
        }
        advance(&mut sim, 0.08);
        let bar = &sim.summary().bars[0];
        close(bar.holder, energy, 1e-12, &format!("{late}: what crossed"));
        assert_eq!((bar.difference, bar.holder.to_bits()), (0.0, bar.other.to_bits()));
    }
}

/// The region sees whole steps, the nearest; the energy is that of the motion.
#[test]
fn an_encoder_reads_whole_steps() {
    let compiled = text(
        "model Read {
           Sf:hand = (30 mm/s)*cos(10 rad/s * t)
           sampled every 8 ms hold lagged budget off { C:wall { stiffness = 1000 N/m } }
           hand -> 1:v -[bar]||> wall resolution 0.5 mm
           probe x = integral(v.f, 0 m)
           probe read = wall.q
           probe given = integral(bar.e*v.f, 0 J)
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    for k in 1..=100 {
        advance(&mut sim, f64::from(k) * 0.008);
        let (x, read) = (probe(&mut sim, "x"), probe(&mut sim, "read"));
        assert!((x - read).abs() <= 0.25e-3 * (1.0 + 1e-9), "{k}: {x} {read}");
        close(read / 0.5e-3, (read / 0.5e-3).round(), 1e-9, "whole steps");
    }
    let (given, bar) = (probe(&mut sim, "given"), sim.summary().bars[0].clone());
    close(bar.holder, given, 1e-10, "what crossed");
    assert_eq!(bar.difference, 0.0);
    assert!(bar.miscounted > 0.0 && bar.miscounted <= 3.1 * 0.5e-3);
}

/// Under the budget a wall with both is passive, however stiff, and rests at F/k where it is not too stiff.
#[test]
fn a_real_loop_is_passive() {
    for (stiffness, late, step) in [(1e3, 0.3, 0.01), (1e5, 0.3, 0.01), (1e5, 1.0, 0.1), (1e7, 0.9, 0.01)] {
        let options = Options::new().set("K", &format!("{stiffness} N/m")).set("step", &format!("{step} mm"));
        let whole = read(&models().join("examples/real_loop.bond"));
        let compiled = with(options, &whole.replace("latency 0.3 ms", &format!("latency {late} ms")));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 2.0);
        let summary = sim.summary();
        assert!(summary.passive, "{stiffness}, {late}, {step}: {:?}", summary.reasons);
        if stiffness == 1e3 {
            close(probe(&mut sim, "x"), 5e-3, 0.01e-3, "where it rests");
        }
    }
}

/// What is sent to a device is what is held from the latency on, and the limit is less by what its encoder may miss.
#[test]
fn a_device_is_told_what_comes_and_may_draw_less() {
    let scene = |more: &str, resolution: &str| {
        text(&format!(
            "model Served {{
               port tip {{ inertia = 1 kg }}
               sampled at 1 kHz hold lagged {more} {{ C:wall {{ stiffness = 1000 N/m }} }}
               tip ||> wall {resolution}
             }}"
        ))
    };
    let told = |more: &str, resolution: &str| {
        let compiled = scene(more, resolution);
        let mut exchange = Exchange::new(&compiled, Steps::new(), 1, 3).unwrap_or_else(|e| panic!("{e}"));
        let mut m = Measurement { session: 1, ports: 1, ..Measurement::default() };
        for k in 0..20_u64 {
            m = Measurement { sequence: k + 1, echo: exchange.effort().sequence, ..m };
            m.w[0] += exchange.effort().v[0] * 1e-4;
            m.q[0] += 1e-4;
            assert_eq!(exchange.hear(&m), Heard::New);
            exchange.tick().unwrap_or_else(|e| panic!("{e}"));
        }
        let e = exchange.effort();
        (exchange.latency(), e.v[0], m.w[0] - e.limit[0])
    };
    let (plain, late, coarse) = (told("", ""), told("latency 0.4 ms", ""), told("", "resolution 0.1 mm"));
    assert_eq!((plain.0, late.0), (0.0, 4e-4));
    assert_eq!(plain.1, late.1, "the effort is the same, and is sent later");
    assert!(plain.1 > 1.0);
    close(coarse.2, plain.2 - coarse.1 * 1e-4, 1e-12, "what it may draw");
}

/// What cannot be meant is said, with what to do.
#[test]
fn mistakes_are_named() {
    let scene = |clock: &str, bar: &str| {
        format!(
            "model M {{
               I:m = 1 kg
               1:v -> m
               sampled every 1 ms {clock} {{ C:wall = 1 mm/N }}
               {bar}
             }}"
        )
    };
    for (clock, bar, code) in [
        ("latency 2 ms", "v ||> wall", "elaborate::latency"),
        ("latency -1 us", "v ||> wall", "elaborate::latency"),
        ("latency 1 us latency 2 us", "v ||> wall", "syntax::twice"),
        ("", "v ||> wall resolution 0 m", "elaborate::value"),
        ("", "v ||> wall resolution 1 N", "units::mismatch"),
        ("", "v ||> wall  v -> R:r resolution 1 mm", "syntax::resolution"),
    ] {
        let text = scene(clock, bar);
        let errors = errors(&text).to_string();
        assert!(errors.contains(code), "{code}: {errors}");
    }
    let both = "model M { sampled every 1 ms { I:m = 1 kg 1:v -> m } sampled every 2 ms { C:c = 1 mm/N } v ||> c resolution 1 mm }";
    assert!(errors(both).to_string().contains("elaborate::resolution"));
    let flow = "model M { C:c = 1 mm/N 0:n -> c sampled every 1 ms { I:m = 1 kg 1:w -> m } n ||> w resolution 1 mm }";
    assert!(errors(flow).to_string().contains("structure::resolution"));
}

/// Only the words of the language changed: elements may still have these names.
#[test]
fn their_words_are_names_too() {
    let compiled = text(
        "model M { I:resolution = 1 kg  C:latency = 1 mm/N  1:v  v -> latency
           v -> resolution
           probe x = resolution.f }",
    );
    finish(&mut start(&compiled, Steps::new()), 0.1);
}
