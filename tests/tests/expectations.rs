//! Every file of `models/` is known, and every `expect` holds.

use crate::common::{all_scenes, file, files, models, run, scenes_of, stop, texts};
use bond::internal::CompiledInternals;
use bond::{Compiled, Options, Simulation, Steps, Summary};
use bond_runtime::scene::ExpectationKind;
use bond_runtime::{Interpreter, Kernel};

/// Rows at which conditions and extremes are looked at.
const ROWS: u32 = 1000;

#[test]
fn no_file_is_unknown() {
    for folder in files("") {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name == "embed" {
            // What meets scenes from outside; the command's tests run it.
            let known = |p: &std::path::PathBuf| {
                let name = p.file_name().unwrap_or_default().to_string_lossy();
                ["device.py", "haptic.c", "haptic.mjs", "haptic.py", "many.c"].contains(&&*name)
            };
            assert!(files(&name).iter().all(known), "a file of models/embed is run by no test");
            continue;
        }
        assert!(
            folder.is_dir()
                && ["components", "examples", "elements", "classics", "hard", "invalid", "library", "mechanisms"]
                    .contains(&name.as_str()),
            "models/{name} is run by no test"
        );
        for path in files(&name) {
            let known = path.extension().is_some_and(|e| e == "bond" || e == "snap");
            assert!(known, "{} is run by no test", path.display());
        }
    }
}

#[test]
fn every_model_has_docs() {
    for folder in ["components", "examples", "elements", "classics", "hard", "invalid", "library", "mechanisms"] {
        for (path, text) in texts(folder) {
            assert!(text.starts_with("//! "), "{} does not say what it is", path.display());
        }
    }
}

#[test]
fn every_scene_expects_something() {
    for folder in crate::common::RUN.into_iter().chain(["hard", "mechanisms"]) {
        for (path, _) in texts(folder) {
            let compiled = file(&path, Options::new());
            assert!(!compiled.scene().probes.expectations.is_empty(), "{} expects nothing", path.display());
        }
    }
}

/// The smallest model of each kind that there is.
#[test]
fn every_element_kind_has_its_model() {
    for (kind, _) in bond_compiler::element::ALL {
        let path = models().join("elements").join(format!("{kind}.bond"));
        assert!(path.exists(), "{} is missing", path.display());
        let text = crate::common::read(&path);
        assert!(text.contains(&format!("{kind}:")), "{} has no {kind}", path.display());
    }
}

#[test]
fn every_expectation_holds() {
    let mut broken = Vec::new();
    for (title, path, scene) in all_scenes().into_iter().chain(["hard", "mechanisms"].into_iter().flat_map(scenes_of)) {
        let compiled = file(&path, Options::new().model(&scene));
        for why in check(&compiled) {
            broken.push(format!("{title}: {why}"));
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// Runs a scene and gives what it does not hold of what it expects.
fn check(compiled: &Compiled) -> Vec<String> {
    let expectations = &compiled.scene().probes.expectations;
    let end = stop(compiled);
    let every = compiled.stages().model.settings.every.unwrap_or(end / f64::from(ROWS));
    let mut times: Vec<f64> = (0..).map(|k| f64::from(k) * every).take_while(|t| *t < end * (1.0 - 1e-9)).collect();
    times.push(end);
    for x in expectations {
        if let ExpectationKind::At { time, .. } = x.kind {
            times.push(time);
        }
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut rows: Vec<(f64, Vec<f64>)> = Vec::new();
    let summary = match drive(compiled, &times, end, &mut rows) {
        Ok(summary) => summary,
        Err(why) => return vec![why],
    };
    let holds = |kind: &ExpectationKind| match kind {
        ExpectationKind::Passive => {
            Err(summary.reasons.join("; ")).or_else(|e| if summary.passive { Ok(()) } else { Err(e) })
        }
        ExpectationKind::PassiveAt(i) => {
            let at = &summary.watched[*i];
            at.broken.map_or(Ok(()), |_| Err(format!("{} J of {} J were drawn", at.drawn, at.stored)))
        }
        ExpectationKind::At { output, time, target, tolerance } => {
            let row = rows.iter().find(|r| (r.0 - time).abs() <= 1e-12 * time).ok_or("there is no such row")?;
            let off = (row.1[*output] - target).abs();
            if off <= *tolerance { Ok(()) } else { Err(format!("it is {:e}, off by {off:e}", row.1[*output])) }
        }
        ExpectationKind::Holds { extremes, output, .. } if extremes.is_empty() => {
            let bad = rows.iter().find(|r| r.1[*output] != 1.0);
            bad.map_or(Ok(()), |r| Err(format!("it does not hold at {} s", r.0)))
        }
        ExpectationKind::Holds { extremes, program, .. } => {
            let program = program.as_ref().ok_or("extremes and signals are mixed")?;
            let extreme = |(output, largest): &(usize, bool)| {
                let values = rows.iter().map(|r| r.1[*output]);
                if *largest { values.fold(f64::NEG_INFINITY, f64::max) } else { values.fold(f64::INFINITY, f64::min) }
            };
            let seen: Vec<f64> = extremes.iter().map(extreme).collect();
            let kernel = Interpreter::new(program);
            let mut work = kernel.workspace();
            kernel.run(&[], &seen, &[], &mut work).map_err(|e| e.to_string())?;
            if work.output[0] == 1.0 { Ok(()) } else { Err(format!("the extremes are {seen:?}")) }
        }
    };
    let broken = |x: &bond_runtime::scene::Expectation| holds(&x.kind).err().map(|why| format!("`{}`: {why}", x.text));
    expectations.iter().filter_map(broken).collect()
}

fn drive(compiled: &Compiled, times: &[f64], end: f64, rows: &mut Vec<(f64, Vec<f64>)>) -> Result<Summary, String> {
    let steps = Steps::new().longest(end / f64::from(ROWS));
    let mut sim: Simulation<'_> = compiled.simulate(steps).map_err(|e| e.to_string())?;
    for &t in times {
        if t < end { sim.advance(t) } else { sim.finish(end) }.map_err(|e| e.to_string())?;
        rows.push((t, sim.probes().map_err(|e| e.to_string())?.to_vec()));
    }
    Ok(sim.summary())
}

/// A run from end to end and one with many rows on the way end in one place.
#[test]
fn looking_changes_nothing() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let end = stop(&compiled);
        let mut rows = Vec::new();
        let times: Vec<f64> = (0..=777).map(|k| f64::from(k) * end / 777.0).collect();
        // Where no step is given, it is fitted to the tolerance and to the rows.
        if compiled.stages().model.settings.step.is_none() {
            continue;
        }
        let seen = drive(&compiled, &times, end, &mut rows).unwrap_or_else(|e| panic!("{title}: {e}"));
        let blind = run(&compiled).unwrap_or_else(|e| panic!("{title}: {e}"));
        for (a, b) in seen.regions.iter().zip(&blind.regions) {
            assert_eq!(a.h_final.to_bits(), b.h_final.to_bits(), "{title}: `{}` ends with another energy", a.name);
            assert_eq!(a.steps, b.steps, "{title}: `{}` took other steps", a.name);
        }
    }
}
