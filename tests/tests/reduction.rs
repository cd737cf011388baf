//! What is left out of models: they stay models, with the same promise.

use crate::common::end;
use bond::internal::CompiledInternals;
use bond::{Options, RunError, Steps, Text};
use bond_compiler::reduction;
use std::fs;
use std::path::Path;

/// Steps of a run.
const STEPS: f64 = 40.0;

/// Whether a run keeps its promise; none where a model without a part has no motion that can be computed.
fn passive(compiled: &bond::Compiled) -> Option<bool> {
    let settings = &compiled.stages().model.settings;
    let stop = 0.02 * settings.stop.unwrap_or(1.0);
    let run = || -> Result<bool, RunError> {
        let mut sim = compiled.simulate(Steps::fixed(stop / STEPS))?;
        sim.advance(stop)?;
        Ok(sim.summary().passive)
    };
    run().ok()
}

/// Whatever is left out of the models of this repository: what compiles runs on without a panic, and is passive where
/// the model as it is was.
#[test]
fn what_was_passive_stays_so() {
    let (mut tried, mut ran) = (0, 0);
    for folder in ["examples", "classics"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(folder);
        let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
        files.sort();
        for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "bond")) {
            let text = Text::new(&path.to_string_lossy(), fs::read_to_string(path).unwrap());
            let whole = Options::new().compile_text(&text).unwrap();
            if passive(&whole) != Some(true) {
                continue;
            }
            for part in reduction::parts(&whole.stages().model).iter().take(12) {
                tried += 1;
                let kept = reduction::kept(&whole.stages().model, &part.name);
                let Ok(rest) = Options::new().without(&part.name).compile_text(&text) else { continue };
                assert_eq!(kept, None, "{}: {}", path.display(), part.name);
                assert_eq!(
                    reduction::parts(&rest.stages().model).len() + 1,
                    reduction::parts(&whole.stages().model).len()
                );
                if let Some(passive) = passive(&rest) {
                    assert!(passive, "{} without {}", path.display(), part.name);
                    ran += 1;
                }
            }
        }
    }
    assert!(tried > 300 && ran > 150, "{ran} of {tried}");
}

/// A part whose law counts for nothing can be left out without a change: the steps are those of the model that never
/// had it.
#[test]
fn left_out_is_as_never_written() {
    let model = |more: &str, bonds: &str| {
        format!(
            "model Chain {{\n  Se:push = 2 N\n  I:m[1] = 1 kg; I:m[2] = 2 kg\n  C:k[1] {{ stiffness = 50 N/m; q0 = 0.1 m }}\n  \
             R:b = 0.3 N*s/m\n{more}  push -> 1:v[1] -> m[1]\n  v[1] -> 0:f -> 1:v[2] -> m[2], b\n  f -> k[1]\n{bonds}  \
             probe x = k[1].q; probe speed = m[2].f\n  simulate {{ stop = 3 s }}\n}}\n"
        )
    };
    let none = Options::new().compile_str("none.bond", model("", "")).unwrap();
    let text = model(
        "  C:extra { e = 3 N/m^3 * q^3 }\n  R:rub { e = 0.1 N*s^2/m^2 * f*abs(f) }\n",
        "  v[1] -> extra\n  v[2] -> rub\n",
    );
    let more = Options::new().without("extra").without("rub").compile_str("more.bond", text).unwrap();
    let end = |compiled: &bond::Compiled| {
        let mut sim = compiled.simulate(Steps::fixed(0.01)).unwrap();
        sim.advance(3.0).unwrap();
        (sim.probe("x").unwrap().to_bits(), sim.probe("speed").unwrap().to_bits())
    };
    assert_eq!(end(&none), end(&more));
    assert_eq!(none.show("phs").lines().count(), more.show("phs").lines().count());
}

/// What cannot be left out names what stands against it.
#[test]
fn refusals() {
    let text = "model M {\n  C:c { compliance = 1 F; q0 = 1 C }\n  R:r = 1 Ohm\n  R:slip { e = c.q*f*1 Ohm/C }\n  C:lone = 1 F; R:own = 1 Ohm\n  \
                c -> 1:i -> r, slip\n  lone -> own\n  probe u = r.e\n}\n";
    let code = |name: &str| {
        let errors = Options::new().without(name).compile_str("m.bond", text).unwrap_err();
        let d = &errors.list()[0];
        (d.code, d.message.clone(), errors.list().len())
    };
    for (name, expected, says) in [
        ("c", "omit::read", "`slip` reads it"),
        ("r", "omit::read", "the probe `u` reads it"),
        ("lone", "omit::bonded", "bonded to `own` itself"),
        ("i", "omit::unknown", "no storage, resistor or field"),
        ("slop", "omit::unknown", "there is no element `slop`"),
    ] {
        let (code, message, count) = code(name);
        assert!(code == expected && message.contains(says) && count == 1, "{name}: {code}, {message}");
    }
    assert!(Options::new().without("slip").compile_str("m.bond", text).is_ok());
}

/// What a junction's bonds have in common is read at those that stay, whichever was bonded first.
#[test]
fn a_probe_of_a_junction_keeps_none_of_its_bonds() {
    let text = "model M {
      Se:u = 4 V  R:leak = 1 GOhm  R:r = 1 Ohm  C:c = 1 F  R:wire = 1 uOhm
      leak -> n  wire -> m  u -> 1:m -> r, 0:n  n -> c
      probe v = n.e  probe i = m.f
      simulate { stop = 1 s }
    }";
    let ends = ["", "leak", "wire"].map(|out| {
        let options = if out.is_empty() { Options::new() } else { Options::new().without(out) };
        let compiled = options.compile_str("m.bond", text).unwrap_or_else(|e| panic!("{out}: {e}"));
        ["v", "i"].map(|probe| end(&compiled, Steps::new(), 1.0, probe))
    });
    for (out, [v, i]) in ["leak", "wire"].iter().zip(&ends[1..]) {
        assert!((v - ends[0][0]).abs() < 1e-5 && (i - ends[0][1]).abs() < 1e-5 && *v != ends[0][0], "{out}: {ends:?}");
    }
}
