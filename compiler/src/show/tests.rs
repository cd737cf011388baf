//! What holds for every printed form of every model here; the looks are left to snapshots.

use super::{As, Shown, What, show, sparse};
use crate::causality::{self, Causality};
use crate::elaborate;
use crate::graph::{self, BondGraph};
use crate::model::Model;
use crate::structure::{self, Form};
use bond_grammar::source::Sources;
use serde_json::Value;

type Compiled = (Model, BondGraph, Causality, Form);

fn compiled(text: &str) -> Compiled {
    let mut sources = Sources::new();
    let id = sources.add("model.bond", text);
    let mut errors = Vec::new();
    let files = elaborate::load(&mut sources, id, &mut elaborate::NoFiles, &mut errors);
    let tell = |e: Vec<bond_grammar::diagnostic::Diagnostic>| -> String {
        e.iter().map(|d| d.render(&sources)).collect::<Vec<_>>().join("\n")
    };
    let mut model = elaborate::elaborate(&sources, id, &files, &crate::Options::default(), errors)
        .map_err(|broken| tell(broken.errors))
        .unwrap_or_else(|e| panic!("{e}"));
    let graph = graph::build(&model);
    let (graph, causality) = causality::assign(&mut model, graph).map_err(tell).unwrap_or_else(|e| panic!("{e}"));
    let (graph, causality, form) =
        structure::build(&mut model, graph, causality).map_err(tell).unwrap_or_else(|e| panic!("{e}"));
    (model, graph, causality, form)
}

/// All that is asked for of one model.
fn shown(text: &str, wanted: &[(What, As)]) -> Vec<Result<String, String>> {
    let (mut model, graph, causality, form) = compiled(text);
    let mut list = Vec::new();
    for (what, format) in wanted {
        let (graph, causality, form) = (&graph, &causality, &form);
        let shown = Shown {
            model: &mut model,
            graph,
            causality,
            form,
            unneeded: None,
            programs: &[],
            picture: super::Picture::default(),
        };
        list.push(show(shown, *what, *format));
    }
    list
}

fn one(text: &str, what: What, format: As) -> String {
    shown(text, &[(what, format)]).remove(0).unwrap_or_else(|e| panic!("{e}"))
}

fn json(text: &str, what: What) -> Value {
    serde_json::from_str(&one(text, what, As::Json)).unwrap_or_else(|e| panic!("{e}"))
}

const WALL: &str = "model Wall(k = 1000 N/m, b = 30 N*s/m, gap = 0.1 m) {
  port tip
  C:spring { H = if q > 0 then 0.5*k*q^2 else 0;  q0 = -gap }
  R:damper { e = if spring.q > 0 then b*f else 0 }
  tip -> 1:contact -> spring, damper
}
model VirtualWall {
  Se:hand = 5 N
  I:handle = 1 kg
  sampled at 25 Hz { Wall:wall }
  hand -> 1:v -> handle
  v ||> wall.tip
  probe x = integral(v.f, -0.1 m)
}";

const LEVER: &str = "model Lever(m1 = 3 kg, m2 = 0.5 kg, ratio = 2.5, k = 200 N/m) {
  I:left = m1
  C:spring { stiffness = k; q0 = 0.05 m }
  TF:lever = ratio
  I:right = m2
  Se:load = 1.2 N
  1:v1 -> left, spring, lever
  lever -> 1:v2 -> right
  load -> v2
}";

const BRIDGE: &str = "model Bridge {
  Sf:feed = 1 A * sin(2 rad/s * t)
  R:r1 = 1 Ohm  R:r2 = 2 Ohm  R:r3 = 3 Ohm  R:r4 = 4 Ohm
  C:detector = 1 uF
  R:diode { f = 1 nA * (exp(e/(25 mV)) - 1) }
  feed -> 0:top -> 1:a -> r1, 0:left
  top -> 1:b -> r3, 0:right
  left -> r2
  right -> r4, diode
  left -> 1:bridge -> detector, right
}";

fn ladder(cells: usize) -> String {
    format!(
        "model Ladder(n = {cells}) {{
  Se:src = 1 V
  src -> s[1]
  for i in 1..n {{
    R:r[i] = 1 Ohm
    C:c[i] = 1 uF
    1:s[i] -> r[i], 0:p[i]
    p[i] -> c[i]
    if i < n {{ p[i] -> s[i+1] }}
  }}
}}"
    )
}

fn every() -> Vec<(What, As)> {
    What::ALL.iter().flat_map(|w| As::ALL.map(|a| (*w, a))).collect()
}

#[test]
fn every_combination_is_the_same_twice_or_refused_in_words() {
    for model in [WALL, LEVER, BRIDGE, &ladder(3), "model Empty {}"] {
        let (first, second) = (shown(model, &every()), shown(model, &every()));
        assert_eq!(first, second);
        for ((what, format), result) in every().into_iter().zip(first) {
            match result {
                Ok(text) => assert!(text.ends_with('\n'), "{what:?} {format:?}"),
                Err(why) => assert!(why.contains("shows only"), "{why}"),
            }
        }
    }
}

#[test]
fn json_of_the_form_has_the_shape_of_the_reference() {
    let all = json(WALL, What::Phs);
    let v = &all["regions"][0];
    assert_eq!(v["kind"], "continuous");
    assert_eq!(v["inputs"], serde_json::json!(["hand.e", "v.e"]));
    assert_eq!(v["outputs"], serde_json::json!(["hand.f", "-v.f"]));
    assert_eq!(v["G"], serde_json::json!([["1", "-1"]]));
    let wall = &all["regions"][1];
    assert_eq!((&wall["kind"], &wall["period"]), (&"sampled".into(), &0.04.into()));
    assert_eq!(wall["states"][0], serde_json::json!({"name": "wall.spring.q", "unit": "m", "initial": -0.1}));
    assert_eq!(wall["dirac"]["resistive"][0]["proved"], true);
    let keys: Vec<&str> = wall.as_object().into_iter().flatten().map(|(k, _)| k.as_str()).collect();
    let wanted =
        "name kind period states dependent inputs outputs H J R G P M S dirac skew semidefinite unbounded pseudo";
    assert_eq!(keys.join(" "), wanted);
}

#[test]
fn a_dependent_storage_is_named_with_what_it_went_into() {
    assert_eq!(json(LEVER, What::Phs)["regions"][0]["dependent"], serde_json::json!(["right"]));
    let text = one(LEVER, What::Phs, As::Text);
    assert!(text.contains("I:right is dependent: merged into left.p, right.p = "), "{text}");
}

#[test]
fn a_flow_source_is_shown_along_its_arrow() {
    let form = &json(BRIDGE, What::Phs)["regions"][0];
    assert_eq!(form["inputs"], serde_json::json!(["feed.f"]));
    assert_eq!(form["outputs"], serde_json::json!(["feed.e"]));
    assert_eq!(form["nonlinear"]["names"].as_array().map(Vec::len), Some(1));
    assert_eq!((&form["skew"], &form["semidefinite"]), (&true.into(), &true.into()));
    let tank = &json("model Tank { Sf:pump = 3 A C:tank = 2 F pump -> tank }", What::Phs)["regions"][0];
    assert_eq!((&tank["G"], &tank["outputs"][0]), (&serde_json::json!([["1"]]), &"pump.e".into()));
    assert_eq!(tank["dirac"]["sources"][0]["law"], "pump.f = 3");
    // Against the arrow, so that the source gives what its flow takes.
    let drain = &json("model Drain { Sf:pump = 3 A C:tank = 2 F tank -> pump }", What::Phs)["regions"][0];
    assert_eq!((&drain["G"], &drain["outputs"][0]), (&serde_json::json!([["-1"]]), &"-pump.e".into()));
}

#[test]
fn an_energy_without_a_floor_is_named() {
    let kepler = "model Kepler { I:body = 1 kg  C:sun { H = -1 N*m^2 / q; q0 = 1 m }  1:r -> body, sun }";
    assert_eq!(json(kepler, What::Phs)["regions"][0]["unbounded"], serde_json::json!(["sun.q"]));
    assert!(one(kepler, What::All, As::Text).contains("not seen to be bounded below, by sun.q"));
}

#[test]
fn a_long_ladder_stays_linear() {
    let sizes: Vec<usize> = [300, 600].map(|n| one(&ladder(n), What::Phs, As::Text).len()).to_vec();
    assert!(sizes[1] < 3 * sizes[0], "{sizes:?}");
    let form = &json(&ladder(100), What::Phs)["regions"][0];
    assert_eq!(form["dirac"]["D"]["shape"], serde_json::json!([201, 201]));
    assert!(one(&ladder(150), What::Graph, As::Svg).contains("</svg>"));
    let refused = shown(&ladder(700), &[(What::Graph, As::Svg)]).remove(0);
    assert!(refused.is_err_and(|e| e.contains("too large")));
    assert!(one(&ladder(150), What::All, As::Text).lines().count() < 120);
}

#[test]
fn the_sparse_form_is_the_dense_one() {
    for text in [WALL, LEVER, BRIDGE, &ladder(5)] {
        let (mut model, _, _, form) = compiled(text);
        for region in &form.regions {
            let dense = structure::explicit(&mut model, &form, region);
            let (Some(dense), Some(sparse)) = (dense, sparse::explicit(&mut model, &form, region)) else {
                panic!("no form of {text}")
            };
            assert_eq!((&dense.inputs, dense.nonlinear), (&sparse.inputs, sparse.nonlinear));
            let all = [&dense.j, &dense.r, &dense.g, &dense.p, &dense.m, &dense.s];
            for (name, (d, s)) in "JRGPMS".chars().zip(all.into_iter().zip(&sparse.matrices)) {
                for (i, row) in d.iter().enumerate() {
                    for (j, e) in row.iter().enumerate() {
                        let at = |e| model.pool.eval(e, &|_| 0.7);
                        let (x, y) = (at(*e), s.get(&(i, j)).map_or(0.0, |e| at(*e)));
                        assert!((x - y).abs() <= 1e-12 * x.abs(), "{name}[{i}, {j}]: {x} {y}\n{text}");
                    }
                }
            }
        }
    }
}

/// LaTeX has no fonts for Greek letters as they are: they are written by their names, as those that are spelled so.
#[test]
fn greek_letters_are_commands() {
    let text = "model A(ω = 2 N/m, β_ρ = 1 kg) { C:ε { stiffness = ω } I:mα1 = β_ρ\n Se:φ2 = 1 N\n R:α = 1 N*s/m\n \
                φ2 -> 1:ω_1 -> ε, mα1, α }";
    let tex = shown(text, &[(What::Phs, As::Latex)]).remove(0).unwrap_or_else(|why| panic!("{why}"));
    for letters in [
        r"\omega",
        r"\beta_{\rho}",
        r"\mathrm{\varepsilon }",
        r"\mathrm{m\alpha 1}",
        r"\texttt{\ensuremath{\omega}\_1}",
    ] {
        assert!(tex.contains(letters), "{letters}: {tex}");
    }
    assert!(tex.is_ascii(), "{tex}");
}
