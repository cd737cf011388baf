//! Double bars whose other side swings, or has a clock of its own: what crosses is bounded, whatever the period.

use crate::common::{advance, close, finish, probe, start, text, with};
use bond::{Compiled, Options, Steps};

/// A mass on a spring, w = 1 rad/s, and what is sampled beside it.
fn beside(sampled: &str, period: f64, hold: &str) -> Compiled {
    text(&format!(
        "model Beside {{
          I:m = 1 kg
          C:k {{ stiffness = 1 N/m; q0 = 1 m }}
          1:v -> m, k
          sampled every {period} s hold {hold} {{ {sampled} }}
          v ||> side
          probe x = k.q
          probe p = m.p
          probe energy = k.H + m.H
        }}"
    ))
}

const DAMPER: &str = "R:side = 1 N*s/m";

/// From the third sample on the forecast is exact: alpha is how far the mass swings freely in T, beta = 1 - cos T.
#[test]
fn a_sampled_damper_takes_from_a_swing_what_it_should() {
    // A damper has nothing to give: it lets go where the swing turns round within an interval and takes back what it
    // put in since the sample, a part of it of the order of the square of the period.
    for (period, off) in [(0.02, 1e-4), (0.1, 1e-3), (0.5, 0.05)] {
        let compiled = beside(DAMPER, period, "matched");
        let mut sim = start(&compiled, Steps::new());
        let (cos, sin) = (f64::cos(period), f64::sin(period));
        let beta = 1.0 - cos;
        // The first two samples know nothing, or not enough.
        advance(&mut sim, 2.0 * period);
        let (mut x, mut p) = (probe(&mut sim, "x"), probe(&mut sim, "p"));
        for k in 3..=40 {
            let e = (x * cos + p * sin - x) / (period + beta);
            (x, p) = ((x + e) * cos + p * sin - e, p * cos - (x + e) * sin);
            advance(&mut sim, f64::from(k) * period);
            let releases: u64 = sim.summary().regions.iter().map(|r| r.releases).sum();
            let most = if releases == 0 { 1e-9 } else { off };
            close(probe(&mut sim, "x"), x, most, &format!("x after {k} intervals of {period} s"));
        }
        let summary = sim.summary();
        let debt = summary.regions.iter().map(|r| r.debt_max).fold(0.0, f64::max);
        assert!(debt == 0.0 && probe(&mut sim, "energy") < 0.5, "T = {period}: a debt of {debt} J");
    }
}

/// Energy never grows beyond what was put in and a debt that is bounded, and the debt does not go on growing.
#[test]
fn no_sampled_side_drives_a_swing() {
    let sides = [
        (DAMPER, 0.5),
        ("R:side = 30 N*s/m", 0.5),
        ("R:side = 0.1 N*s/m", 0.5),
        ("C:side = 0.2 m/N", 0.5),
        ("C:s { stiffness = 1 N/m; q0 = 0.3 m }  R:d = 0.5 N*s/m  1:side -> s, d", 0.545),
        ("C:s = 0.5 m/N  R:d = 2 N*s/m  0:side -> s, d", 0.5),
        ("0:side -> d, b  R:d = 3 N*s/m  1:b -> i, r  I:i = 2 kg  R:r = 0.2 N*s/m", 0.5),
        ("R:side { e = 1 N*s^3/m^3 * f^3 + 0.1 N*s/m * f }", 0.5),
        ("C:side { H = 1 N/m^3 * q^4 }", 0.5),
    ];
    for hold in ["matched", "lagged", "predicted"] {
        for (sampled, put_in) in sides {
            for period in [0.01, 0.1, 0.7, 1.5, 2.0, 3.1, 4.0, 6.3, 10.0] {
                let compiled = beside(sampled, period, hold);
                let mut sim = start(&compiled, Steps::new());
                let what = format!("{hold}, T = {period} s, {sampled}");
                let debt =
                    |sim: &bond::Simulation<'_>| sim.summary().regions.iter().map(|r| r.debt_max).fold(0.0, f64::max);
                finish(&mut sim, 300.0 * period);
                let early = debt(&sim);
                assert!(early <= 8.0 * put_in, "{what}: a debt of {early} J");
                let mut most = 0.0f64;
                for k in 1..=30 {
                    advance(&mut sim, (300.0 + 10.0 * f64::from(k)) * period);
                    most = most.max(probe(&mut sim, "energy"));
                }
                assert!(most <= put_in + debt(&sim) + 1e-9, "{what}: {most} J");
                assert!(debt(&sim) <= 8.0 * put_in, "{what}: a debt of {} J", debt(&sim));
            }
        }
    }
}

/// What swings in three ways has no recurrence of four weights: forecasts are off, what crosses is bounded still.
#[test]
fn a_chain_is_not_driven_by_what_is_foretold_wrong() {
    for hold in ["matched", "lagged", "predicted"] {
        for period in [0.3, 1.0, 1.5, 3.0, 8.0] {
            let compiled = text(&format!(
                "model Chain {{
                  I:a = 1 kg  I:b = 1.5 kg  I:c = 2 kg
                  C:k {{ stiffness = 1 N/m; q0 = 1 m }}
                  C:l = 1.4 m/N  C:m = 1.4 m/N
                  1:va -> a, k  1:vb -> b  1:vc -> c
                  va -> 0:ab -> vb  ab -> l
                  vb -> 0:bc -> vc  bc -> m
                  sampled every {period} s hold {hold} {{ R:side = 1 N*s/m }}
                  va ||> side
                  probe energy = a.H + b.H + c.H + k.H + l.H + m.H
                }}"
            ));
            let mut sim = start(&compiled, Steps::new());
            for k in 1..=60 {
                advance(&mut sim, 20.0 * f64::from(k) * period);
                let energy = probe(&mut sim, "energy");
                assert!(energy <= 5.0, "{hold}, T = {period} s: {energy} J after {k}");
            }
        }
    }
}

/// 1 V behind 1 Ohm at 1 kHz, 1 Ohm and 1 mF in parallel at 700 Hz: half of it.
#[test]
fn two_clocks_come_to_rest() {
    for (fast, slow) in [(1000.0, 700.0), (1000.0, 999.0), (1000.0, 370.0), (900.0, 70.0)] {
        for hold in ["matched", "predicted", "lagged"] {
            let compiled = text(&format!(
                "model Clocks {{
                  sampled at {fast} Hz {{ Se:u = 1 V; R:r = 1 Ohm; u -> 1:j -> r }}
                  sampled at {slow} Hz hold {hold} {{ R:l = 1 Ohm; C:c = 10 mF; 0:k -> l, c }}
                  j ||> k
                  probe x = c.e
                }}"
            ));
            let mut sim = start(&compiled, Steps::new());
            finish(&mut sim, 0.5);
            let summary = sim.summary();
            if hold == "matched" {
                close(probe(&mut sim, "x"), 0.5, 1e-9, &format!("{fast} and {slow} Hz"));
                assert!(summary.passive, "{fast} and {slow} Hz: {:?}", summary.reasons);
            } else {
                close(probe(&mut sim, "x"), 0.5, 1e-3, &format!("{hold}, {fast} and {slow} Hz"));
            }
            assert_eq!(summary.bars[0].difference, 0.0, "{hold}, {fast} and {slow} Hz");
        }
    }
}

/// A mass and its damper on one computer, its spring on another: E = 0.5 exp(-0.02 t).
#[test]
fn two_clocks_keep_an_oscillator() {
    for (mass, spring) in [(0.1, 0.099), (0.099, 0.1), (0.1, 0.0707), (0.1, 0.0314159)] {
        let compiled = text(&format!(
            "model Clocks {{
              sampled every {mass} s {{ I:a = 1 kg; R:d = 0.02 N*s/m; 1:va -> a, d }}
              sampled every {spring} s {{ C:s {{ stiffness = 1 N/m; q0 = 1 m }} }}
              va ||> s
              probe energy = s.H + a.H
            }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        for k in 1..=10 {
            let t = 10.0 * f64::from(k);
            advance(&mut sim, t);
            // The two states are up to a period apart.
            let wanted = 0.5 * (-0.02 * t).exp();
            close(probe(&mut sim, "energy") / wanted, 1.0, 0.3, &format!("{mass} and {spring} s, at {t} s"));
        }
        let summary = sim.summary();
        assert!(summary.passive, "{mass} and {spring} s: {:?}", summary.reasons);
    }
}

/// What is held is of the region, not of what steps it.
#[test]
fn the_answer_of_a_nonlinear_side_is_not_its_steppers() {
    let scene = "model Wall {
      Se:hand = 5 N + 2 N * sin(3 Hz * t)
      I:handle = 1 kg
      C:arm { H = 100 J * (1-cos(q/(1 m))); q0 = 0.05 m }
      R:fr { e = 2 N*s/m * f + 1 N*s^3/m^3 * f^3 }
      sampled at 25 Hz { C:spring = 0.001 m/N  R:damper = 30 N*s/m  1:contact }
      hand -> 1:v -> handle, arm, fr
      contact -> spring, damper
      v ||> contact
      probe f = spring.e
    }";
    let found: Vec<f64> = [("gonzalez", 1e-13), ("collocation4", 1e-11), ("collocation8", 1e-12)]
        .into_iter()
        .map(|(method, tolerance)| {
            let compiled = with(Options::new().method(method), scene);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            // Later the wall lets go, and where it does, small differences become large.
            finish(&mut sim, 1.0);
            probe(&mut sim, "f")
        })
        .collect();
    close(found[1], found[2], 3e-8, "collocation4 and 8");
    close(found[0], found[2], 1e-6, "gonzalez and collocation8");
}
