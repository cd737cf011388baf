//! What several stages need.

use bond::internal::CompiledInternals;
use bond::{Compiled, Errors, Options, RunError, Simulation, Steps, Summary};
use bond_grammar::ast::{Item, StatementKind};
use bond_grammar::source::Sources;
use std::path::{Path, PathBuf};

/// The folder of the models.
pub fn models() -> PathBuf {
    PathBuf::from("../models")
}

/// All files of a folder of models, sorted.
pub fn files(folder: &str) -> Vec<PathBuf> {
    let folder = models().join(folder);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|e| e.expect("a folder can be listed").path()).collect();
    files.sort();
    files
}

/// The models of a folder, sorted: path and text.
pub fn texts(folder: &str) -> Vec<(PathBuf, String)> {
    let is_model = |p: &PathBuf| p.extension().is_some_and(|e| e == "bond");
    files(folder).into_iter().filter(is_model).map(|p| (p.clone(), read(&p))).collect()
}

/// The text of a file.
pub fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// `examples/virtual_wall`
pub fn title(path: &Path) -> String {
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    format!("{folder}/{}", path.file_stem().unwrap_or_default().to_string_lossy())
}

/// The models of a text that are scenes: those with a `simulate`.
pub fn scenes(text: &str) -> Vec<String> {
    let mut sources = Sources::new();
    let id = sources.add("scene.bond", text);
    let (file, _) = bond_grammar::parse(&sources, id);
    let runs = |item: &Item| match item {
        Item::Model(m) if m.body.iter().any(|s| matches!(s.kind, StatementKind::Simulate(_))) => {
            Some(m.name.text.clone())
        }
        Item::Model(_) | Item::Use(_) | Item::Function(_) => None,
    };
    file.items.iter().filter_map(runs).collect()
}

/// Folders of models that run and expect something, by any stepper and step. (`hard` does as it says itself.)
pub const RUN: [&str; 4] = ["examples", "elements", "components", "classics"];

/// All scenes of the examples, the elements, the components and the classics: title, path, model.
pub fn all_scenes() -> Vec<(String, PathBuf, String)> {
    RUN.iter().flat_map(|folder| scenes_of(folder)).collect()
}

/// All scenes of a folder: title, path, model.
pub fn scenes_of(folder: &str) -> Vec<(String, PathBuf, String)> {
    let mut list = Vec::new();
    for (path, text) in texts(folder) {
        for scene in scenes(&text) {
            list.push((format!("{} {scene}", title(&path)), path.clone(), scene));
        }
    }
    list
}

/// Compiles a file; it must compile.
pub fn file(path: &Path, options: Options) -> Compiled {
    match options.compile_file(path) {
        Ok(compiled) => compiled,
        Err(errors) => panic!("{}:\n{errors}", path.display()),
    }
}

/// A scene of the examples.
pub fn example(name: &str, scene: &str) -> Compiled {
    file(&models().join("examples").join(format!("{name}.bond")), Options::new().model(scene))
}

/// Compiles a text; it must compile.
pub fn text(text: &str) -> Compiled {
    with(Options::new(), text)
}

/// Compiles a text with options; it must compile.
pub fn with(options: Options, text: &str) -> Compiled {
    match options.compile_str("test.bond", text) {
        Ok(compiled) => compiled,
        Err(errors) => panic!("{errors}\n{text}"),
    }
}

/// What is wrong with a text.
pub fn errors(text: &str) -> Errors {
    match Options::new().compile_str("test.bond", text) {
        Ok(_) => panic!("this compiles, and should not:\n{text}"),
        Err(errors) => errors,
    }
}

/// Starts a run.
pub fn start(compiled: &Compiled, steps: Steps) -> Simulation<'_> {
    compiled.simulate(steps).unwrap_or_else(|e| panic!("the run does not start: {e}"))
}

/// The value of a probe.
pub fn probe(sim: &mut Simulation<'_>, name: &str) -> f64 {
    sim.probe(name).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Runs on to an instant; nothing may fail.
pub fn advance(sim: &mut Simulation<'_>, until: f64) {
    sim.advance(until).unwrap_or_else(|e| panic!("{e}"));
}

/// The value of a probe at the end of a run.
pub fn end(compiled: &Compiled, steps: Steps, stop: f64, name: &str) -> f64 {
    let mut sim = start(compiled, steps);
    finish(&mut sim, stop);
    probe(&mut sim, name)
}

/// Ends a run; nothing may fail.
pub fn finish(sim: &mut Simulation<'_>, stop: f64) {
    sim.finish(stop).unwrap_or_else(|e| panic!("{e}"));
}

/// The end that `simulate` asks for, s.
pub fn stop(compiled: &Compiled) -> f64 {
    compiled.stages().model.settings.stop.unwrap_or(1.0)
}

/// Runs a scene to its end as it says itself.
pub fn run(compiled: &Compiled) -> Result<Summary, RunError> {
    let mut sim = compiled.simulate(Steps::new())?;
    sim.finish(stop(compiled))?;
    Ok(sim.summary())
}

/// A probe at equal distances over a run: time and value, the start left out.
pub fn trace(compiled: &Compiled, steps: Steps, every: f64, count: u32, name: &str) -> Vec<(f64, f64)> {
    let mut sim = start(compiled, steps);
    let row = |k: u32| {
        let t = f64::from(k) * every;
        advance(&mut sim, t);
        (t, probe(&mut sim, name))
    };
    (1..=count).map(row).collect()
}

/// Fails where two numbers differ by more than `tolerance`.
#[track_caller]
pub fn close(found: f64, wanted: f64, tolerance: f64, what: &str) {
    let off = (found - wanted).abs();
    assert!(off <= tolerance, "{what}: {found:e} where {wanted:e} is wanted, off by {off:e} > {tolerance:e}");
}

/// How many cases a property is tried with; `PROPTEST_CASES` says otherwise.
pub fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// A bridge of ideal diodes between the inductance of a line and a coil.
pub const BRIDGE: &str = "
model Bridge {
  Se:mains = 325 V * sin(100*pi*1 Hz * t)
  I:line = 1 mH
  I:coil = 20 mH
  R:load = 10 Ohm
  R:d1 { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
  R:d2 { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
  R:d3 { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
  R:d4 { e = min(s, 0)*1 V; f = max(s, 0)*1 A }
  mains -> 1:across -> line, 0:a
  0:b -> across
  a -> 1:m1 -> d1
  b -> 1:m2 -> d2
  m1, m2 -> 0:plus -> 1:out -> coil, load
  1:m3 -> d3
  1:m4 -> d4
  m3 -> a
  m4 -> b
  probe i = coil.f
  probe u = coil.e + load.e
  probe carries = max(d1.f, d2.f)
  probe gives = min(min(d1.P, d2.P), min(d3.P, d4.P))
}";
