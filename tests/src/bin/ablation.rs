//! What each numeric threshold is for: sets it to ten times and to a tenth, over the hard cases, random graphs and the
//! models that are named, and writes a page of those that move a result or the work by more than a twentieth.
//!
//!     cargo run --release -p bond-tests --bin ablation -- [--only CONTROLLER] [MODEL.bond...] > thresholds.md
//!
//! Such a page is `docs/inside/thresholds.md`.
//!
//! The thresholds are those of [`NumericOptions`] and [`Thresholds`], each number of them: a new one is covered by
//! itself.

use bond::internal::{CompiledInternals, OptionsInternals, SimulationInternals};
use bond::{Options, Steps};
use bond_compiler::thresholds::Thresholds;
use bond_runtime::options::NumericOptions;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{self, Simulation};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What moves by less than this part does not count.
const MOVES: f64 = 0.05;
/// Random graphs.
const GRAPHS: usize = 300;
/// A scene that takes more steps and iterations by the defaults is left out, and so is said.
const MAX_WORK: u64 = 3_000;
/// Rows that are compared.
const ROWS: u32 = 20;

/// A scene before it is compiled: its title, its text, the name under which files beside it are found, and its model.
struct Text {
    title: String,
    path: String,
    text: String,
    model: Option<String>,
    /// Where its model says no end, s.
    stop: f64,
}

/// What a run came to.
#[derive(Default)]
struct Outcome {
    rows: Vec<Vec<f64>>,
    work: [u64; 2],
    error: bool,
}

impl Text {
    fn compile(&self, (numeric, thresholds): (NumericOptions, Thresholds)) -> Option<Ready> {
        let options = Options::new().numeric(numeric, thresholds);
        let options = self.model.iter().fold(options, |options, model| options.model(model.as_str()));
        let compiled = options.compile_str(&self.path, self.text.as_str()).ok()?;
        let stop = compiled.stages().model.settings.stop.unwrap_or(self.stop);
        let steps = compiled.simulate(Steps::new()).ok()?.options().clone();
        Some(Ready { scene: compiled.scene().clone(), steps, stop })
    }
}

/// A scene that is compared: which text it is of, what it comes to, and by column whether that is rounding alone.
struct Kept {
    text: usize,
    ready: Ready,
    outcome: Outcome,
    rounding: Vec<bool>,
}

/// A scene that is compiled. It is interpreted: most runs are shorter than it takes to make machine code of it.
#[derive(Clone)]
struct Ready {
    scene: Scene,
    steps: simulate::Options,
    stop: f64,
}

impl Ready {
    fn run(&self) -> Outcome {
        let mut outcome = Outcome::default();
        let Ok(mut sim) = Simulation::new(&self.scene, &self.steps) else {
            return Outcome { error: true, ..outcome };
        };
        for k in 0..=ROWS {
            match sim.advance(self.stop * f64::from(k) / f64::from(ROWS)).and_then(|()| Ok(sim.probes()?.to_vec())) {
                Ok(mut row) => {
                    row.extend((0..self.scene.clusters.len()).flat_map(|c| sim.state(c).to_vec()));
                    outcome.rows.push(row);
                }
                Err(_) => {
                    outcome.error = true;
                    break;
                }
            }
            let regions = sim.summary().regions;
            outcome.work =
                [regions.iter().map(|r| r.steps + r.rejected).sum(), regions.iter().map(|r| r.newton_iterations).sum()];
            // Another number may make a scene far slower: it has moved long before it ends.
            if outcome.work.iter().sum::<u64>() > 2 * MAX_WORK {
                break;
            }
        }
        outcome
    }
}

impl Outcome {
    fn column(&self, k: usize) -> impl Iterator<Item = f64> {
        self.rows.iter().map(move |r| r[k])
    }

    /// By column, whether another run's rows differ by more than a twentieth of the largest value.
    fn moved_columns(&self, other: &Outcome) -> Vec<bool> {
        let columns = self.rows.first().map_or(0, Vec::len);
        let moved = |k: usize| {
            let size = self.column(k).fold(0.0f64, |m, x| m.max(x.abs()));
            self.rows.len() != other.rows.len()
                || self.column(k).zip(other.column(k)).any(|(x, y)| (x - y).abs() > MOVES * size)
        };
        (0..columns).map(moved).collect()
    }

    /// Whether another run's results, or its work, differ by more than a twentieth; columns of rounding alone, or of a
    /// chaotic motion, say nothing.
    fn moved(&self, other: &Outcome, rounding: &[bool]) -> [bool; 2] {
        let columns = self.moved_columns(other);
        let results = self.error != other.error || columns.iter().zip(rounding).any(|(moved, noise)| *moved && !noise);
        let more = |(a, b): (&u64, &u64)| a.abs_diff(*b) as f64 > MOVES * (*a).max(20) as f64;
        [results, self.work.iter().zip(&other.work).any(more)]
    }
}

/// The same thresholds, but for rounding: what moves by that says nothing of what another threshold does.
fn nudged((mut numeric, mut thresholds): (NumericOptions, Thresholds)) -> (NumericOptions, Thresholds) {
    numeric.controller.safety *= 1.0 + 1e-9;
    thresholds.newton.last *= 1.5;
    (numeric, thresholds)
}

fn scenes(paths: &[PathBuf]) -> Vec<Text> {
    let mut list = Vec::new();
    for path in paths {
        let Ok(text) = std::fs::read_to_string(path) else { continue };
        let title = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        list.push(Text { title, path: path.to_string_lossy().into_owned(), text, model: None, stop: 1.0 });
    }
    for (i, text) in bond_tests::random::graphs(GRAPHS).into_iter().enumerate() {
        list.push(Text { title: format!("random {i}"), path: "random.bond".into(), text, model: None, stop: 0.5 });
    }
    list
}

/// The numbers of a value, by path.
fn leaves(value: &Value, path: &str, list: &mut Vec<(String, f64)>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                leaves(value, &format!("{path}/{key}"), list);
            }
        }
        Value::Array(array) => {
            for (i, value) in array.iter().enumerate() {
                leaves(value, &format!("{path}/{i}"), list);
            }
        }
        Value::Number(x) => list.extend(x.as_f64().map(|x| (path.to_string(), x))),
        Value::Bool(_) | Value::Null | Value::String(_) => {}
    }
}

/// The defaults with one number replaced; None where that is no such number.
fn with(defaults: &Value, path: &str, x: f64) -> Option<(NumericOptions, Thresholds)> {
    let mut all = defaults.clone();
    let place = all.pointer_mut(path)?;
    *place = if place.is_f64() { Value::from(x) } else { Value::from(x.round() as u64) };
    let part = |key: &str| all.get(key).cloned().unwrap_or(Value::Null);
    Some((serde_json::from_value(part("run")).ok()?, serde_json::from_value(part("compile")).ok()?))
}

/// Does a job for each number below `count`, on all processors.
fn each(count: usize, job: &(dyn Fn(usize) + Sync)) {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|s| {
        for _ in 0..threads {
            s.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count {
                        break;
                    }
                    job(i);
                }
            });
        }
    });
}

fn main() {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let only = words.iter().position(|w| w == "--only").map(|i| {
        words.remove(i);
        words.remove(i)
    });
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir("models/hard").into_iter().flatten().flatten().map(|e| e.path()).collect();
    paths.sort();
    paths.extend(words.into_iter().map(PathBuf::from));
    let (numeric, thresholds) = (NumericOptions::default(), Thresholds::default());
    let defaults = serde_json::json!({ "run": numeric, "compile": thresholds });
    let all = scenes(&paths);
    let kept: Mutex<Vec<Kept>> = Mutex::new(Vec::new());
    let slow: Mutex<Vec<String>> = Mutex::new(Vec::new());
    each(all.len(), &|i| {
        let Some(ready) = all[i].compile((numeric, thresholds)) else { return };
        let outcome = ready.run();
        if outcome.work.iter().sum::<u64>() > MAX_WORK {
            slow.lock().unwrap_or_else(|e| e.into_inner()).push(all[i].title.clone());
        } else if !outcome.error {
            let Some(other) = all[i].compile(nudged((numeric, thresholds))) else { return };
            let rounding = outcome.moved_columns(&other.run());
            let one = Kept { text: i, ready, outcome, rounding };
            kept.lock().unwrap_or_else(|e| e.into_inner()).push(one);
        }
    });
    let mut kept = kept.into_inner().unwrap_or_else(|e| e.into_inner());
    kept.sort_by_key(|k| k.text);
    let mut slow = slow.into_inner().unwrap_or_else(|e| e.into_inner());
    slow.sort();
    let mut numbers = Vec::new();
    leaves(&defaults, "", &mut numbers);
    numbers.retain(|(path, _)| only.as_ref().is_none_or(|only| path.contains(only.as_str())));
    println!("# Thresholds\n");
    println!(
        "Made by `cargo run --release -p bond-tests --bin ablation`. Each number of \n`bond_runtime::options` and \
         `bond_compiler::thresholds` at ten times and at a tenth of its default, over {} scenes: the hard cases, random \
         graphs and others. (A ratio that shortens steps stays below 1.) The columns count the scenes in which a result, or the work (steps and iterations), moved by \
         more than 5 %. An error where there was none counts as a result.\n",
        kept.len()
    );
    println!("| threshold | default | results at 10 | work at 10 | results at 1/10 | work at 1/10 | such as |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut idle = Vec::new();
    for (path, x) in &numbers {
        let (mut counts, mut example) = ([0usize; 4], None);
        // By what a step is multiplied to get a shorter one has to stay below 1.
        let shrinks = path.ends_with("shrink") || path.ends_with("safety");
        let more = if shrinks { (10.0 * x).min(0.5 + 0.5 * x) } else { 10.0 * x };
        for (side, value) in [more, 0.1 * x].into_iter().enumerate() {
            let Some(changed) = with(&defaults, path, value) else { continue };
            let moved: Mutex<Vec<(usize, [bool; 2])>> = Mutex::new(Vec::new());
            each(kept.len(), &|k| {
                let Kept { text, ready, outcome, rounding } = &kept[k];
                let other = if path.starts_with("/run") {
                    Some(Ready { scene: Scene { numeric: changed.0, ..ready.scene.clone() }, ..ready.clone() })
                } else {
                    all[*text].compile(changed)
                };
                let other = other.map_or(Outcome { error: true, ..Outcome::default() }, |other| other.run());
                let found = outcome.moved(&other, rounding);
                if found != [false; 2] {
                    moved.lock().unwrap_or_else(|e| e.into_inner()).push((*text, found));
                }
            });
            let mut moved = moved.into_inner().unwrap_or_else(|e| e.into_inner());
            moved.sort_by_key(|m| m.0);
            for (_, found) in &moved {
                counts[2 * side] += usize::from(found[0]);
                counts[2 * side + 1] += usize::from(found[1]);
            }
            example = example.or(moved.first().map(|m| all[m.0].title.clone()));
        }
        eprintln!("{path} {x:e}: {counts:?}");
        let name = path.trim_start_matches('/').replace('/', ".");
        match example {
            Some(example) => {
                let [a, b, c, d] = counts;
                println!("| `{name}` | {x:e} | {a} | {b} | {c} | {d} | {example} |");
            }
            None => idle.push(format!("`{name}`")),
        }
    }
    println!(
        "\nThese moved nothing in these scenes: {}.\n\nAmong them are caps on sizes and counts, and floors that keep \
         rounding out; a few others have a scene elsewhere in the tests, or act at tolerances that none of these scenes \
         asks for (`choice`). What has none of these reasons is a candidate to go.",
        if idle.is_empty() { "none".into() } else { idle.join(", ") }
    );
    println!("\nLeft out, for they take more than {MAX_WORK} steps and iterations: {}.", slow.join(", "));
}
