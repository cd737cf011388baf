//! Strokes.

use crate::common::{advance, close, example, file, finish, models, probe, start, text};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};

#[test]
fn strokes() {
    for (name, scene) in [
        ("virtual_wall", "VirtualWall"),
        ("quarter_car", "QuarterCar"),
        ("dc_motor", "DcMotor"),
        ("wheatstone", "Wheatstone"),
    ] {
        insta::assert_snapshot!(format!("causality_{name}"), example(name, scene).show("causality"));
    }
}

/// How many storages of a model are dependent, and states it has.
fn counts(text: &str) -> (usize, usize) {
    let compiled = crate::common::text(text);
    let form = &compiled.stages().form;
    (form.regions.iter().map(|r| r.dependent.len()).sum(), form.regions.iter().map(|r| r.states.len()).sum())
}

#[test]
fn dependent_storages_are_merged() {
    assert_eq!(counts("model M { Se:f = 1 N I:a = 1 kg I:b = 2 kg f -> 1:v -> a, b }"), (1, 1));
    assert_eq!(counts("model M { Sf:f = 1 A C:a = 1 F C:b = 2 F C:c = 2 F f -> 0:v -> a, b, c }"), (2, 1));
    // Through a gyrator an inertia shows as a compliance: a mass and a capacitor are one.
    assert_eq!(counts("model M { Sf:f = 1 A C:c = 1 F GY:g = 2 V*s/m I:m = 3 kg f -> 0:v -> c, g g -> m }"), (1, 1));
    assert_eq!(counts("model M { Se:f = 1 N I:a = 1 kg C:b = 2 m/N f -> 1:v -> a, b }"), (0, 2));
}

/// A gyrator swaps the variables: a motor with a mass and one with a coil stay independent.
#[test]
fn independent_storages_stay() {
    assert_eq!(counts("model M { Se:u = 1 V I:l = 1 H GY:g = 2 V*s/m I:m = 3 kg u -> 1:i -> l, g g -> m }"), (0, 2));
}

/// An attenuator whose every cell halves: the rows of its form have their neighbours in them alone, however many there
/// are.
#[test]
fn many_free_resistors() {
    let attenuator = text(
        "model Attenuator {
          Se:u = 1 V
          for i in 1..400 { R:a[i] = 1 Ohm  R:b[i] = 2 Ohm  1:j[i] -> a[i], 0:k[i]  k[i] -> b[i] }
          u -> j[1]
          for i in 1..399 { k[i] -> j[i+1] }
          R:end = 2 Ohm
          k[400] -> end
          probe first = b[1].e
          probe last = b[400].e
        }",
    );
    assert!(attenuator.stages().form.columns.iter().all(|c| c.row.len() <= 3));
    let mut sim = start(&attenuator, Steps::new());
    finish(&mut sim, 1.0);
    close(probe(&mut sim, "first"), 0.5, 1e-15, "first");
    let last = probe(&mut sim, "last") / (-400f64).exp2();
    close(last, 1.0, 1e-12, "last");
    // Laws that can be turned do the same.
    let clamped = text(
        "model Clamped {
          Se:u = 1 V * sin(100 Hz * t)
          for i in 1..100 {
            R:a[i] = 1 Ohm  R:d[i] { f = 1 pA * (exp(e/(25 mV)) - 1) }
            1:j[i] -> a[i], 0:k[i]
            k[i] -> d[i]
          }
          u -> j[1]
          for i in 1..99 { k[i] -> j[i+1] }
          C:c = 1 mF
          k[100] -> c
          probe off = d[1].f - 1 pA * (exp(d[1].e/(25 mV)) - 1)
        }",
    );
    assert!(clamped.stages().form.columns.iter().all(|c| c.row.len() <= 4));
    let mut sim = start(&clamped, Steps::fixed(1e-3));
    finish(&mut sim, 0.05);
    close(probe(&mut sim, "off"), 0.0, 1e-12, "the law of a diode");
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
}

#[test]
fn asserted_strokes_are_kept() {
    let free = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i -> a, b }");
    let held = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i ->| a i -> b }");
    let other = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i |-> a i -> b }");
    let named = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i -[x]|-> a i -> b probe p = x.P }");
    assert_eq!(other.stages().causality.strokes, named.stages().causality.strokes);
    for c in [&free, &held, &other, &named] {
        let summary = crate::common::run(c).unwrap_or_else(|e| panic!("{e}"));
        crate::common::close(summary.regions[0].dissipated, 1.0 / 3.0, 1e-12, "energy");
    }
    assert_ne!(held.show("causality"), other.show("causality"));
}

/// Two junctions side by side between the same two are what one is with both elements on it, though in their ring
/// strokes do not show that the elements are tied together.
#[test]
fn what_stands_side_by_side_in_a_ring_is_as_on_one_junction() {
    let (c, i, r, v) = ("C:NAME = 1 F", "I:NAME = 2 H", "R:NAME = 3 Ohm", "Se:NAME = 1 V");
    let grounds = [("R:g1 = 1 Ohm R:g2 = 2 Ohm", [c, v]), ("I:g1 = 1 H I:g2 = 2 H", [r, i])];
    for (ground, pair) in grounds {
        for (x, y) in [(c, pair[0]), (pair[0], pair[1]), (pair[1], pair[0]), (r, pair[0])] {
            let elements = format!(
                "C:c0 {{ compliance = 1 F; q0 = 1 C }} R:r0 = 5 Ohm {ground} {} {} 0:n1 0:n2 n1 -> g1 n2 -> g2 c0 -> 1:a0 -> n1, r0",
                x.replace("NAME", "x"),
                y.replace("NAME", "y"),
            );
            let scene =
                |way: &str| text(&format!("model M {{ {elements} {way} probe u = n1.e - n2.e probe f = y.f }}"));
            let ring = scene("n1 -> 1:a -> n2 n1 -> 1:b -> n2 a -> x b -> y");
            let plain = scene("n1 -> 1:a -> n2 a -> 0:p -> x, y");
            for name in ["u", "f"] {
                let [a, b] = [&ring, &plain].map(|s| crate::common::end(s, bond::Steps::new(), 1.0, name));
                assert!((a - b).abs() <= 1e-7 * (1.0 + b.abs()), "{elements}: {name} is {a}, not {b}");
            }
            assert!(crate::common::run(&ring).is_ok_and(|s| s.passive), "{elements}");
        }
    }
    // Three in a triangle, and around each of its corners: one is tied to the others.
    let delta = "for k in 1..3 { 0:n[k] R:r[k] = 1 Ohm * k C:c[k] = 1 F * k n[k] -> r[k] n[k] -> 1:d[k] -> c[k] }
        d[1] -> n[2] d[2] -> n[3] d[3] -> n[1]";
    assert_eq!(counts(&format!("model M {{ {delta} }}")), (1, 2));
    assert_eq!(counts(&format!("model M {{ {} }}", delta.replace("C:c[k] = 1 F", "I:c[k] = 1 H"))), (0, 3));
}

/// The bridge with four resistors meeting is a loop, not a conflict.
#[test]
fn resistors_that_meet_are_a_loop() {
    let compiled = file(&models().join("examples/wheatstone.bond"), Options::new());
    assert_eq!(compiled.stages().form.regions.len(), 1);
    assert!(compiled.stages().form.validate(&compiled.stages().model.pool).is_ok());
}

/// Small storages follow large ones, in whatever order they are declared: their voltages keep their digits. The numbers
/// are of the matrix exponential of the circuit in its three voltages.
#[test]
fn small_storages_follow_large_ones() {
    let ordered = |order: [usize; 3]| {
        let storages = ["C:coss = 200 pF", "C:cj = 50 pF", "C:out = 4.7 F"];
        let [a, b, c] = order.map(|i| storages[i]);
        let compiled = text(&format!(
            "model CapLoop {{
              Se:src = 12 V * sin(2*pi*50 Hz * t)
              R:r = 1 Ohm {a} {b} {c}
              R:load = 200 Ohm
              R:bleed = 1 kOhm
              src -> 1:i -> r, 0:x
              x -> coss
              x -> 1:d -> 0:j, 0:o
              j -> cj, bleed
              o -> out, load
              probe vo = o.e
              simulate {{ stop = 5 ms }}
            }}"
        ));
        let stages = compiled.stages();
        let dependent = &stages.causality.dependent;
        let large = dependent.iter().any(|d| stages.model.element(*d).name == "out");
        assert!(dependent.len() == 1 && !large, "{order:?}");
        let mut sim = crate::common::start(&compiled, bond::Steps::new());
        crate::common::finish(&mut sim, 5e-3);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step < 1e-13, "{order:?}: {:?}", summary.reasons);
        crate::common::close(crate::common::probe(&mut sim, "vo"), 8.119_050e-6, 1e-12, "vo");
    };
    [[0, 1, 2], [2, 1, 0], [1, 2, 0], [0, 2, 1]].into_iter().for_each(ordered);
}

/// A law that a signal has a part in cannot be seen to be monotone; between two tanks it is solved all the same, and
/// not left to one of them to have no integral causality.
#[test]
fn modulated_valves_between_two_storages() {
    let tanks = |law: &str, graph: &str| {
        crate::common::text(&format!(
            "model Valve {{
               input u = 0.5
               C:a {{ compliance = 1e-7 m^3/Pa; e0 = 2e4 Pa }}
               C:b {{ compliance = 1e-7 m^3/Pa }}
               MR:valve {{ e = {law} }}
               {graph}
               probe p = b.e
             }}"
        ))
    };
    // The root of the difference falls evenly: by u/(C sqrt k).
    let root = 2e4f64.sqrt() - 0.5 / (1e-7 * 1e9f64.sqrt()) * 0.5;
    let exact = 0.5 * (2e4 - root * root);
    let chain = "a -> 1:j -> valve, b";
    let nodes = "a -> 0:x -> 1:j -> valve  j -> 0:y -> b";
    for (law, graph) in [
        ("1e9 Pa*s^2/m^6 / u^2 * f*abs(f)", chain),
        ("1e9 Pa*s^2/m^6 / u^2 * f*abs(f)", nodes),
        ("1e9 Pa*s^2/m^6 / max(u, 0.01)^2 * f*abs(f)", nodes),
    ] {
        let compiled = tanks(law, graph);
        let p = crate::common::end(&compiled, bond::Steps::tolerance(1e-8), 0.5, "p");
        crate::common::close(p, exact, 1e-2, law);
    }
}

/// A double pendulum by the coordinates of its masses: whichever junction comes first, and where the arms are at right
/// angles, its mass matrix is inverted by what passes 0 nowhere.
#[test]
fn mass_matrices_are_inverted_by_their_diagonals() {
    let junctions = ["1:w1 -> a1, tx1, ty1", "1:w2 -> a2, tx2, ty2"];
    for [first, second] in [[0, 1], [1, 0]] {
        let compiled = text(&format!(
            "model S {{
               C:a1 {{ H = 10 N*m * (1 - cos(q)); q0 = 1 rad }}  C:a2 {{ H = 10 N*m * (1 - cos(q)); q0 = 2 rad }}
               I:x1 = 1 kg  I:y1 = 1 kg  I:x2 = 1 kg  I:y2 = 1 kg
               MTF:tx1 = 1 m * cos(a1.q)  MTF:ty1 = 1 m * sin(a1.q)
               MTF:tx2 = 5 m * cos(a2.q)  MTF:ty2 = 5 m * sin(a2.q)
               {}
               {}
               tx1 -> 1:vx1 -> x1  ty1 -> 1:vy1 -> y1
               tx2 -> 0:sx  vx1 -> sx -> 1:vx2 -> x2
               ty2 -> 0:sy  vy1 -> sy -> 1:vy2 -> y2
               probe q1 = a1.q  probe q2 = a2.q
             }}",
            junctions[first], junctions[second]
        ));
        let mut sim = start(&compiled, Steps::tolerance(1e-9));
        finish(&mut sim, 3.0);
        // By scipy.
        close(probe(&mut sim, "q1"), 1.03368, 1e-5, "q1");
        close(probe(&mut sim, "q2"), 0.00172258, 1e-5, "q2");
        assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
    }
}

/// Of two laws one is solved: the one for which nothing is divided by a ratio that passes 0, whichever stands first.
/// There, at
/// 0.5 s, nothing goes through the transformer, and the inner law alone has the source's 1 V.
#[test]
fn laws_about_a_ratio_that_passes_0_are_solved_without_a_division() {
    let laws = ["R:inner { f = 0.5 A * sinh(e/(1 V)) }", "R:outer { f = 0.5 A/V^3 * e^3 + 0.5 S * e }"];
    for (two_port, at_half) in [
        ("TF:t1 = 0.8*(1 Hz * t - 0.5)", 0.5),
        ("TF:t1 = 0.8*sin(0.8 Hz * t)", 0.0),
        ("MGY:t1 = (2 Ohm)*(1 Hz * t - 0.5)", f64::NAN),
    ] {
        let ends = [[0, 1], [1, 0]].map(|order| {
            let [one, two] = order.map(|k| laws[k]);
            let compiled = text(&format!(
                "model M {{ {one}  {two}  Se:s = 1 V  {two_port}  s -> 1:a -> inner, t1  t1 -> outer  probe i = a.f }}"
            ));
            let mut sim = start(&compiled, Steps::new());
            advance(&mut sim, if at_half == 0.0 { 1e-9 } else { 0.5 });
            if at_half.is_finite() {
                close(probe(&mut sim, "i"), 0.5 * f64::sinh(1.0), 1e-9, two_port);
            }
            finish(&mut sim, 1.0);
            assert!(sim.summary().passive, "{two_port}: {:?}", sim.summary().reasons);
            probe(&mut sim, "i")
        });
        close(ends[0], ends[1], 1e-9, two_port);
    }
}

/// A curve is not turned for that: it gives its junction what all there have in common.
#[test]
fn a_curve_beside_a_changing_ratio_is_not_turned() {
    let compiled = text(
        "model M { TF:t1 = cos(2 Hz * t)  Sf:s = 1 A
           C:b1 { compliance = 0.5 F; e0 = 0.2 V }
           R:c0 { e = (1 V)*tanh(f/(1 A)) + 0.2 Ohm * f }
           R:b0 { f = 0.5 A/V^3 * e^3 + 0.5 S * e }
           R:a1 { f = 0.5 A/V^3 * e^3 + 0.5 S * e }
           R:a0 { e = (0.2 V)*min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 A }
           s -> 0:ja -> a0, a1, t1  t1 -> 1:jb -> b0, b1, c0  probe f = a0.f  probe e = a0.e }",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 0.1);
    assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
    // It yields at 0.2 V, and takes what nothing else does.
    close(probe(&mut sim, "e"), 0.2, 1e-12, "e");
    assert!(probe(&mut sim, "f") > 0.5);
}
