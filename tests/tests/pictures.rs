//! Pictures: in those of all models nothing lies on anything else, and what signals drive has an arrow.

use crate::common::{RUN, example, file, scenes_of, text};
use crate::overlaps::look;
use bond::Options;
use bond::internal::CompiledInternals;
use bond_compiler::show::{As, Labels, Picture, What, text_width};
use std::fmt::Write as _;

/// Folders of models besides those that run in a moment.
const MORE: [&str; 2] = ["hard", "mechanisms"];

/// Elements of a model that is drawn with each kind of label; larger ones are drawn once.
const SMALL: usize = 40;

/// Crossings of lines in all pictures without labels. More of them mean a worse layout.
const MOST_CROSSINGS: usize = 300;

#[test]
fn nothing_lies_on_anything_else() {
    let (mut wrong, mut crossings, mut count) = (String::new(), 0, 0);
    let folders = RUN.iter().chain(&MORE);
    for (title, path, scene) in folders.flat_map(|folder| scenes_of(folder)) {
        let compiled = file(&path, Options::new().model(&scene));
        let small = compiled.stages().model.elements.len() <= SMALL;
        for labels in [Labels::None, Labels::Numbers].into_iter().filter(|l| small || *l == Labels::None) {
            let picture = Picture { labels, ..Picture::default() };
            let svg = compiled.show_drawn(What::Causality, As::Svg, picture).unwrap_or_else(|e| panic!("{title}: {e}"));
            let found = look(&svg, &text_width);
            for fault in &found.faults {
                let _ = writeln!(wrong, "{title}, labels {}: {fault}", labels.name());
            }
            count += 1;
            if labels == Labels::None {
                crossings += found.crossings;
            }
            let kinds = ["MTF", "MGY", "MSe", "MSf", "MR", "MRS"];
            for node in found.nodes.iter().filter(|id| kinds.iter().any(|k| id.split('.').next() == Some(k))) {
                if !found.signals.iter().any(|s| s.ends_with(&format!(".{node}"))) {
                    let _ = writeln!(wrong, "{title}: no signal drives {node}");
                }
            }
        }
    }
    assert!(wrong.is_empty(), "of {count} pictures:\n{wrong}");
    assert!(crossings <= MOST_CROSSINGS, "{crossings} crossings");
}

fn svg(compiled: &bond::Compiled, picture: Picture) -> String {
    compiled.show_drawn(What::Causality, As::Svg, picture).unwrap_or_else(|e| panic!("{e}"))
}

/// How often something stands in a text.
fn count(text: &str, what: &str) -> usize {
    text.matches(what).count()
}

#[test]
fn a_bundle_is_a_double_line_between_two_nodes() {
    let compiled = text(
        "model M(m = [1 kg, 2 kg, 3 kg]) {
          Se:push[1..3] = [1 N, 2 N, 3 N]
          I:body[1..3] = m
          push -> 1:v[1..3] -> body
        }",
    );
    let svg = svg(&compiled, Picture::default());
    assert_eq!(count(&svg, "<g class=\"node\""), 3, "{svg}");
    assert_eq!(count(&svg, "<g class=\"bond\""), 2, "{svg}");
    assert_eq!(count(&svg, ">3</text>"), 2, "{svg}");
    assert!(svg.contains("v[1..3]") && !svg.contains(">I:body[1]<"), "{svg}");
    let json: serde_json::Value =
        serde_json::from_str(&compiled.show_as("graph", "json").unwrap_or_default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(json["elements"][0]["bundle"], "push[1..3]");
    assert_eq!(json["bonds"][0]["bundle"], serde_json::json!(["push[1..3]", "v[1..3]"]));
    insta::assert_snapshot!("bundle_graph", compiled.show("graph"));
    let dot = compiled.show_as("causality", "dot").unwrap_or_default();
    assert!(dot.contains("color=\"black:black\"") && dot.contains("I:body[1..3]"), "{dot}");
}

#[test]
fn a_two_port_by_a_matrix_is_one_node() {
    let arm = scenes_of("mechanisms").into_iter().find(|s| s.2 == "PlanarArm").expect("the arm");
    let compiled = file(&arm.1, Options::new().model(&arm.2));
    let svg = svg(&compiled, Picture::default());
    assert!(svg.contains(">MTF:arm<") && !svg.contains("arm[1"), "{svg}");
    assert_eq!(count(&svg, "<g class=\"signal\""), 1, "{svg}");
}

/// A controller is a block: what it reads leads in, what it gives leads out.
#[test]
fn a_controller_is_a_block() {
    let compiled = example("pid_motor", "Continuous");
    let svg = svg(&compiled, Picture::default());
    let found = look(&svg, &text_width);
    let has = |from: &str, to: &str| found.signals.iter().any(|s| s == &format!("signal.{from}.{to}"));
    let block = "block.sum__smooth";
    assert!(has("input.wanted", block) && has("1.motor.shaft", block) && has(block, "MSe.amplifier"), "{found:?}");
    assert_eq!(found.signals.len(), 3);
    assert!(svg.contains(">Motor:motor<") && svg.contains("class=\"part\""), "{svg}");
}

#[test]
fn parts_are_boxes_down_to_a_depth() {
    let compiled = example("pid_motor", "Continuous");
    let picture = Picture { depth: 0, ..Picture::default() };
    let closed = svg(&compiled, picture);
    let found = look(&closed, &text_width);
    assert_eq!(found.faults, Vec::<String>::new());
    assert!(found.nodes.contains(&"Motor.motor".to_string()) && !closed.contains(">I:coil<"), "{closed}");
    // The port is named at the box.
    assert!(closed.contains(">circuit</text>"), "{closed}");
}

#[test]
fn what_is_dependent_is_red() {
    let compiled = file(&crate::common::models().join("hard").join("four_bar.bond"), Options::new().model("FourBar"));
    let svg = svg(&compiled, Picture::default());
    assert_eq!(count(&svg, "<text class=\"derivative\""), 4, "{svg}");
    assert_eq!(count(&svg, "stroke derivative"), 4, "{svg}");
}

#[test]
fn bonds_are_labelled() {
    let compiled = example("virtual_wall", "VirtualWall");
    let with = |labels| svg(&compiled, Picture { labels, ..Picture::default() });
    assert!(with(Labels::Numbers).contains(">1</text>"));
    assert!(
        with(Labels::Variables).contains(">handle.e</text>") && with(Labels::Variables).contains(">handle.f</text>")
    );
}

/// A long chain takes rows, and a large model is drawn in seconds.
#[test]
fn long_chains_are_folded() {
    let compiled = example("lc_line", "LcLine");
    let svg = svg(&compiled, Picture::default());
    let size = |key: &str| -> f64 {
        let rest = svg.split(&format!(" {key}=\"")).nth(1).unwrap_or_default();
        rest.split('"').next().and_then(|x| x.parse().ok()).unwrap_or(f64::NAN)
    };
    assert!(size("width") < 1700.0 && size("height") < 800.0, "{} x {}", size("width"), size("height"));
}
