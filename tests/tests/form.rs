//! The port-Hamiltonian form: snapshots of small ones, and its facts on all.

use crate::common::{all_scenes, example, file, models, text, with};
use bond::Options;
use bond::internal::CompiledInternals;
use bond_compiler::show::What;

#[test]
fn forms() {
    for (name, scene) in [
        ("virtual_wall", "VirtualWall"),
        ("quarter_car", "QuarterCar"),
        ("dc_motor", "DcMotor"),
        ("wheatstone", "Wheatstone"),
        ("diode_clipper", "DiodeClipper"),
        ("sampled_mass", "SampledMass"),
    ] {
        insta::assert_snapshot!(format!("form_{name}"), example(name, scene).show("phs"));
    }
    for element in ["C", "I", "TF", "GY", "MTF", "R_law", "I_dependent"] {
        let compiled = file(&models().join(format!("elements/{element}.bond")), Options::new());
        insta::assert_snapshot!(format!("form_element_{element}"), compiled.show("phs"));
    }
}

#[test]
fn a_form_as_json() {
    let json = example("quarter_car", "QuarterCar").show_as("phs", "json").unwrap_or_else(|e| panic!("{e}"));
    insta::assert_snapshot!("form_json_quarter_car", json);
}

/// What an entry of a JSON matrix is at parameters of 2, 3, 5 and so on; only sums of products and quotients are read.
fn entries(value: &serde_json::Value) -> Vec<Vec<String>> {
    let row = |r: &serde_json::Value| {
        r.as_array().into_iter().flatten().map(|x| x.as_str().map_or_else(|| x.to_string(), str::to_string)).collect()
    };
    value.as_array().into_iter().flatten().map(row).collect()
}

/// J is skew, R symmetric, as written: `x` stands against `-x`, or both are 0.
#[test]
fn forms_are_skew_and_symmetric_as_written() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let json = compiled.show_as("phs", "json").unwrap_or_else(|e| panic!("{title}: {e}"));
        let json: serde_json::Value = serde_json::from_str(&json).unwrap_or_else(|e| panic!("{title}: {e}"));
        for region in json["regions"].as_array().into_iter().flatten() {
            for (name, skew) in [("J", true), ("R", false), ("M", true), ("S", false)] {
                let m = entries(&region[name]);
                let entry =
                    |i: usize, j: usize| m.get(i).and_then(|r: &Vec<String>| r.get(j)).map_or("", String::as_str);
                for (i, j) in (0..m.len()).flat_map(|i| (0..=i).map(move |j| (i, j))) {
                    let (a, b) = (entry(i, j), entry(j, i));
                    // Sums may be written in another order.
                    let sums = i != j && a.contains([' ', '/', '(']);
                    let negated = a == format!("-{b}") || b == format!("-{a}");
                    let good = (a == "0" && b == "0") || sums || if skew { negated } else { a == b };
                    assert!(good, "{title}: {name}[{i}][{j}] = {a}, {name}[{j}][{i}] = {b}");
                }
            }
        }
    }
}

#[test]
fn every_dirac_structure_is_skew() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let stages = compiled.stages();
        if let Err(why) = stages.form.validate(&stages.model.pool) {
            panic!("{title}: {why}");
        }
    }
}

/// Every combination that can be shown is, and the pictures and the JSON are well formed as far as a glance tells.
#[test]
fn everything_can_be_shown() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        for what in What::ALL {
            assert!(!compiled.show(what.name()).trim().is_empty(), "{title}: {what:?} is empty");
            let json = compiled.show_as(what.name(), "json").unwrap_or_else(|e| panic!("{title}: {what:?}: {e}"));
            if let Err(e) = serde_json::from_str::<serde_json::Value>(&json) {
                panic!("{title}: {what:?} is no JSON: {e}");
            }
        }
        let svg = compiled.show_as("causality", "svg").unwrap_or_else(|e| panic!("{title}: {e}"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{title}: {svg}");
        let dot = compiled.show_as("graph", "dot").unwrap_or_else(|e| panic!("{title}: {e}"));
        assert_eq!(dot.matches('{').count(), dot.matches('}').count(), "{title}: {dot}");
    }
}

/// The mass-spring-damper by hand: J = [[0, 1], [-1, 0]] for (q, p), R = diag(0, b), G = (0, 1).
#[test]
fn the_oscillator_by_hand() {
    let compiled = text(
        "model M(m = 2 kg, k = 8 N/m, b = 3 N*s/m) {
          Se:force = 1 N
          C:spring { stiffness = k }
          I:mass = m
          R:drag = b
          force -> 1:v -> spring, mass, drag
        }",
    );
    let json = compiled.show_as("phs", "json").unwrap_or_else(|e| panic!("{e}"));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap_or_else(|e| panic!("{e}"));
    let region = &json["regions"][0];
    assert_eq!(entries(&region["J"]), [["0", "1"], ["-1", "0"]]);
    assert_eq!(entries(&region["R"]), [["0", "0"], ["0", "b"]]);
    assert_eq!(entries(&region["G"]), [["0"], ["1"]]);
    assert_eq!(entries(&region["P"]), [["0"], ["0"]]);
    assert_eq!(entries(&region["S"]), [["0"]]);
}

/// Energies that fall without end are not taken for bounded, however slowly they fall.
#[test]
fn energies_without_a_lower_bound_are_seen() {
    let bounded = |h: &str| {
        let model = format!("model M {{ C:c {{ H = {h} }} I:m = 1 kg  R:r = 0.1 N*s/m  1:v -> c, m, r }}");
        text(&model).show("phs").contains("H is bounded below")
    };
    for h in [
        "-10 J * log(1 + (q/(1 m))^2)",
        "-1 J * log(1 + abs(q)/(1 m))",
        "1 J * log(1 + exp(q/(1 m))) - 1.5 N * q",
        "1e-200 J/m^3 * q^3",
    ] {
        assert!(!bounded(h), "{h}");
    }
    for h in [
        "-3 J * cos(q/(1 m))",
        "1 J * (1 - exp(-q/(1 m)))^2 - 1 J",
        "0.5 N/m * (q - 3 m)^2 - 8 J",
        "1 J * cosh(q/(1 m)) - 5 N * q",
    ] {
        assert!(bounded(h), "{h}");
    }
}

/// An entry of D that is 0 as a difference that no rule shows is no reason to refuse a model.
#[test]
fn what_cancels_by_rounding_is_skew() {
    let text = "model M {
      1:j0
      0:j1
      0:j2
      GY:g3 = 2.5 N*s/m
      1:j3
      0:j4
      0:j5
      0:j6
      GY:g7 = 0.5 N*s/m
      1:j7
      0:j8
      C:e0 { stiffness = 1 N/m;  q0 = -0.30000000000000004 m }
      I:e1 = 1 kg
      TF:m0 = 1 + 0.3 m^-1 * e0.q
      TF:m1 = 1 + 0.3 m^-1 * e0.q
      R:loss1 = 1 N*s/m
      R:loss2 = 1 N*s/m
      R:loss3 = 5 N*s/m
      R:loss4 = 1 N*s/m
      R:loss5 = 1 N*s/m
      R:loss6 = 1 N*s/m
      R:loss8 = 1 N*s/m
      j0 -> j1
      j0 -> j2
      j0 -> g3 -> j3
      j0 -> j4
      j0 -> j5
      j0 -> j6
      j0 -> g7 -> j7
      j0 -> j8
      j0 -> e0
      j7 -> e1
      j7 -> m0 -> j0
      j0 -> m1 -> j3
      j1 -> loss1
      j2 -> loss2
      j3 -> loss3
      j4 -> loss4
      j5 -> loss5
      j6 -> loss6
      j8 -> loss8
    }";
    let compiled = with(Options::new(), text);
    let stages = compiled.stages();
    assert_eq!(stages.form.validate(&stages.model.pool), Ok(()));
}
