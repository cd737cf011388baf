//! What a sampled region has to give, what it owes, and in which order regions find what they hold.

use crate::common::{advance, close, end, finish, probe, start, text};
use bond::Steps;

/// Two masses and two springs, each sampled, in a ring in which nobody waits for himself: two springs hold for one
/// mass, but one of them for another one too, which holds for the first.
fn ring(period: Option<f64>) -> bond::Compiled {
    let block = |inner: &str| match period {
        Some(t) => format!("sampled every {t} s {{ {inner} }}"),
        None => inner.to_string(),
    };
    let bar = if period.is_some() { "||>" } else { "->" };
    text(&format!(
        "model Ring {{
  {}
  {}
  {}
  {}
  a {bar} b
  b {bar} c
  a {bar} d
  c {bar} d
  probe vm = m.f
  probe vn = n.f
  probe qk = k.q
  probe ql = l.q
  simulate {{ stop = 1 s }}
}}",
        block("C:k = 0.2 m/N  0:d -> k"),
        block("I:m { inertia = 1 kg; f0 = 1 m/s }  1:a -> m"),
        block("C:l = 0.2 m/N  0:b -> l"),
        block("I:n = 1 kg  1:c -> n"),
    ))
}

#[test]
fn a_ring_of_sampled_regions_keeps_its_order() {
    let ends = |period: Option<f64>| {
        let compiled = ring(period);
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 1.0);
        ["vm", "vn", "qk", "ql"].map(|name| probe(&mut sim, name))
    };
    let exact = ends(None);
    let off = |period: f64| ends(Some(period)).iter().zip(exact).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    let [coarse, fine] = [off(0.05), off(0.0125)];
    assert!(coarse < 0.02 && fine < coarse / 8.0, "{coarse} and {fine}");
}

/// A mass that bounces about, with sampled springs and a sampled mass at three rates: which of them has a debt of 1e-18
/// J at a sample must not tell what the others hold.
#[test]
fn rounding_makes_no_debt() {
    let run = |speed: &str| {
        let compiled = text(&format!(
            "model Bounce {{
  I:m {{ inertia = 1 kg; f0 = {speed} m/s }}
  C:stop {{ H = 0.5*(3 N/m)*q^2 + 0.25*(20 N/m^3)*q^4 + (if q > 0.2 m then 0.5*(400 N/m)*(q - 0.2 m)^2 else 0); q0 = 0.1 m }}
  1:v -> m, stop
  sampled every 0.1 s {{ C:k = 0.2 m/N  1:w -> k }}
  sampled every 0.06 s {{ I:j = 0.5 kg }}
  sampled every 0.03 s {{ C:l = 0.1 m/N  0:n -> l }}
  v ||> w
  v ||> n
  n ||> j
  probe q = stop.q
  simulate {{ stop = 3 s }}
}}"
        ));
        end(&compiled, Steps::tolerance(1e-8), 3.0, "q")
    };
    close(run("1.0000000000001"), run("1"), 1e-9, "where it is after 3 s");
}

/// The outside stands still, and then moves with or against the region's own source, which puts in what crosses but for
/// rounding: that nothing was at risk before makes that no debt.
#[test]
fn rounding_of_an_own_source_makes_no_debt() {
    let cases =
        [("", "2 N * sin(40 Hz * t)"), ("", "3 N"), ("hold predicted", "2 N"), ("hold lagged", "2 N * t/(1 s)")];
    for (hold, source) in cases {
        let compiled = text(&format!(
            "model A {{
  port tip
  sampled every 3 ms {hold} {{
    Se:own = 1 N + {source}
    C:k {{ stiffness = 100 N/m }}
    R:b = 4 N*s/m
    own -> 1:v -> k, b
  }}
  tip ||> v
}}"
        ));
        let held = |first: f64| {
            let mut sim = start(&compiled, Steps::new());
            let one = |(k, q): (u32, f64)| {
                sim.report("tip", q).expect("there is a port");
                advance(&mut sim, f64::from(k) * 3e-3);
                sim.held()[0].1
            };
            (1..).zip([0.0, first, 0.91e-3, 0.14e-3, -0.7e-3]).map(one).collect::<Vec<f64>>()
        };
        for k in 0..20 {
            let first = 1e-4 * f64::from(k - 10);
            let wanted = held(first);
            for near in [first * (1.0 + 2.3e-16), first * (1.0 - 2.3e-16), first * (1.0 + 1e-14)] {
                for (x, y) in held(near).iter().zip(&wanted) {
                    close(*x, *y, 1e-9, &format!("what is held after {first} m beside {source} {hold}"));
                }
            }
        }
    }
}

/// A wall far too stiff for its period has H go up and down by 1e13 J: what crosses is not lost in the rounding of H,
/// nor is any of that given out.
#[test]
fn what_crosses_is_not_lost_beside_what_holds_make() {
    let compiled = text(
        "model Wall {
  Se:push = 10.4 N * sin(3.19 rad/s * t)
  I:m { inertia = 1 kg; f0 = 1.58 m/s }
  push -> 1:v -> m
  sampled every 0.5 s { C:s { H = if q > 0 then 0.5*(1e13 N/m)*q^2 else 0 } }
  v ||> s
  simulate { stop = 5 s }
}",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 5.0);
    let summary = sim.summary();
    let wall = summary.regions.iter().find(|r| r.name == "s").expect("the wall has a ledger");
    assert_eq!(wall.supplied, summary.bars[0].holder);
    assert!(summary.passive && wall.h_max > 1e12 && wall.supplied > -1e-9, "{summary:?}");
}

/// Two clocks that differ by as much as is still taken for one.
#[test]
fn clocks_that_all_but_agree() {
    for off in ["1e-12", "1.00001e-12", "-1e-12", "-1.1e-12", "9.9e-13"] {
        let compiled = text(&format!(
            "model Clocks {{
  sampled every 0.1 s {{ I:m {{ inertia = 1 kg; f0 = 1 m/s }}  1:a -> m }}
  sampled every 0.1 s * (1 + {off}) {{ C:k = 0.2 m/N  0:b -> k }}
  a ||> b
  probe q = k.q
  simulate {{ stop = 60 s }}
}}"
        ));
        assert!(end(&compiled, Steps::new(), 60.0, "q").abs() < 0.5, "{off}");
    }
}

/// A mass with a damper, which a sampled region with a source and a resistor of its own moves.
fn moved(hold: &str) -> bond::Compiled {
    text(&format!(
        "model Moved {{
  sampled every 10 ms hold {hold} {{ Se:u = 1 N  R:r = 0.8 N*s/m  1:x  u -> x -> r }}
  I:m = 1 kg
  R:d = 0.5 N*s/m
  1:w -> m, d
  w ||> x
  probe p = m.p
}}"
    ))
}

/// A source of the region's own sets in motion what is at rest, though there is nothing stored: what it puts in is
/// foretold by the motion that begins, not by the one that was.
#[test]
fn a_source_of_its_own_begins_from_rest() {
    // p' = 1 - 1.3 p
    let exact = (1.0 - (-1.3f64 * 2.0).exp()) / 1.3;
    for hold in ["matched", "lagged", "predicted"] {
        let compiled = moved(hold);
        close(end(&compiled, Steps::new(), 2.0, "p"), exact, 3e-3, hold);
    }
}
