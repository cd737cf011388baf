//! `bond test`: what models expect of themselves, and snapshots of their structure.

use crate::attribution::Attribution;
use crate::diff;
use crate::drive::{self, Halt, drive};
use crate::expectation::{Outcome, Watch};
use crate::input::{self, Which};
use crate::output;
use crate::progress::Progress;
use crate::report;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps, Text};
use bond_grammar::ast::{self, Item, Statement, StatementKind};
use bond_grammar::source::Sources;
use bond_runtime::scene::ExpectationKind;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Check what models expect of themselves, and the snapshots of their structure
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond test wall.bond\n  bond test models --update\n\nThe last model of each file is tested, and every other one \
                  that has an `expect`. A model without `expect` is only compiled.\n\
                  The snapshot of NAME.bond is NAME.snap beside it; that of a model M other than the last is \
                  NAME.M.snap.\nIt is compared if it exists, and --update creates or renews it (that of M with \
                  --model M)."
)]
pub struct Args {
    /// Models, and folders to search for `*.bond`
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Accept the present structure: write the snapshots
    #[arg(long)]
    update: bool,
    #[command(flatten)]
    which: Which,
}

/// What is said of a scene that does not run.
const UNRUN: &str = "cannot run";

/// How many checks held.
#[derive(Default)]
struct Count {
    passed: usize,
    failed: usize,
    /// Of those that failed, how many do not have what the command line asks for.
    asked: usize,
}

impl Count {
    /// Says how a check came out.
    fn add(&mut self, good: bool, line: &str) -> Result<(), Stop> {
        if good {
            self.passed += 1;
        } else {
            self.failed += 1;
        }
        output::offer(&format!("{} {line}\n", if good { "pass" } else { "FAIL" }))
    }
}

/// Tests every file, whatever is wrong with those before it.
///
/// # Errors
/// Something failed.
pub fn test(args: &Args) -> Result<(), Stop> {
    let files = files(&args.paths)?;
    if args.update && files.iter().any(|file| file == Path::new("-")) {
        let why =
            "a snapshot is written beside its model, and standard input has no place; name a file, or omit --update";
        return Err(Stop::Usage(why.into()));
    }
    let mut count = Count::default();
    for file in &files {
        one(file, args, &mut count)?;
    }
    output::offer(&format!("{} passed, {} failed\n", count.passed, count.failed))?;
    match count.failed {
        0 => Ok(()),
        n if n == count.asked => Err(Stop::Said(2)),
        _ => Err(Stop::Said(1)),
    }
}

/// The models at some paths, each once.
fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Stop> {
    let (mut files, mut seen) = (Vec::new(), HashSet::new());
    for path in paths {
        let mut here = Vec::new();
        find(path, &mut here, true)?;
        if here.is_empty() {
            return Err(Stop::Usage(format!("there is no `*.bond` in {}", path.display())));
        }
        files.extend(here.into_iter().filter(|file| seen.insert(file.canonicalize().unwrap_or(file.clone()))));
    }
    Ok(files)
}

/// Models at a path, sorted within each folder. Links to folders are not followed.
fn find(path: &Path, files: &mut Vec<PathBuf>, named: bool) -> Result<(), Stop> {
    let unreadable = |e: std::io::Error| input::unreadable(path, &e);
    if path == Path::new("-") || !fs::metadata(path).map_err(unreadable)?.is_dir() {
        files.push(path.to_path_buf());
        return Ok(());
    }
    if !named && fs::symlink_metadata(path).map_err(unreadable)?.is_symlink() {
        return Ok(());
    }
    let mut inside: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(path).map_err(unreadable)? {
        inside.push(entry.map_err(unreadable)?.path());
    }
    inside.sort();
    for entry in inside {
        let hidden = entry.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        let model = entry.extension().is_some_and(|e| e == "bond");
        if !hidden && (model || fs::metadata(&entry).is_ok_and(|m| m.is_dir())) {
            find(&entry, files, false)?;
        }
    }
    Ok(())
}

/// Tests one file.
fn one(path: &Path, args: &Args, count: &mut Count) -> Result<(), Stop> {
    let name = input::name(path);
    let text = match input::read(path) {
        Ok(text) => text,
        Err(Stop::Usage(why) | Stop::Model(why)) => return count.add(false, &why),
        Err(other) => return Err(other),
    };
    let all = scenes(&name, &text);
    let default = all.last().cloned().flatten();
    let scenes = args.which.model.as_ref().map_or(all, |model| vec![Some(model.clone())]);
    let text = Text::new(&name, text);
    for model in scenes {
        let mut options = Options::new();
        if let Some(model) = &model {
            options = options.model(model);
        }
        match options.compile_text(&text) {
            Ok(compiled) => {
                let title = format!("{name} {}", compiled.scene().name);
                scene(&title, &compiled, count)?;
                let (place, own) = snap(path, &compiled.scene().name, default.as_deref());
                // Other scenes than the default are compared if they have a snapshot, and get one on request.
                if path != Path::new("-") && (own || args.which.model.is_some() || place.exists()) {
                    snapshot(&place, &title, &compiled, args.update, count)?;
                }
            }
            // What other files use has nothing to test.
            Err(errors) if model.is_none() && input::functions_alone(&text, &errors) => {
                let functions = text.functions_alone().join(", ");
                output::offer(&format!("skip {name}: no model; functions: {functions}\n"))?;
            }
            Err(errors) => {
                report::diagnostics(errors.sources(), errors.list());
                count.asked += usize::from(input::status(&errors) == 2);
                let title = model.map(|m| format!(" {m}")).unwrap_or_default();
                count.add(false, &format!("{name}{title}: does not compile"))?;
            }
        }
    }
    Ok(())
}

/// The models of a text that are tested: those with an `expect`, and the last.
fn scenes(name: &str, text: &str) -> Vec<Option<String>> {
    let mut sources = Sources::new();
    let id = sources.add(name, text);
    let (file, _) = bond_grammar::parse(&sources, id);
    let models: Vec<_> = file
        .items
        .iter()
        .filter_map(|item| match item {
            Item::Model(m) => Some(m),
            Item::Use(_) | Item::Function(_) => None,
        })
        .collect();
    let Some((last, others)) = models.split_last() else { return vec![None] };
    let mut list: Vec<Option<String>> =
        others.iter().filter(|m| expects(&m.body)).map(|m| Some(m.name.text.clone())).collect();
    list.push(Some(last.name.text.clone()));
    list
}

fn expects(body: &[Statement]) -> bool {
    let mut any = false;
    ast::each_statement(body, &mut |s| any |= matches!(s.kind, StatementKind::Expect(_)));
    any
}

/// Runs a scene, and checks what it expects.
fn scene(title: &str, compiled: &Compiled, count: &mut Count) -> Result<(), Stop> {
    let expectations = &compiled.scene().probes.expectations;
    if expectations.is_empty() {
        return count.add(true, &format!("{title}: compiles"));
    }
    let outcomes = match watched(title, compiled) {
        Ok(outcomes) => outcomes,
        Err(Stop::Usage(why) | Stop::Numerics(why)) => return count.add(false, &format!("{title}: {UNRUN}: {why}")),
        // It names what is wrong.
        Err(Stop::Model(why)) => return count.add(false, &why),
        Err(other) => return Err(other),
    };
    for (expectation, outcome) in expectations.iter().zip(outcomes) {
        let text = expectation.text.split_whitespace().collect::<Vec<_>>().join(" ");
        let text = if text.starts_with("expect") { text } else { format!("expect {text}") };
        match outcome {
            Outcome::Held(what) => count.add(true, &format!("{title}: {text}{}", told(&what)))?,
            Outcome::Broken(what) => count.add(false, &format!("{title}: {text}{}", told(&what)))?,
        }
    }
    Ok(())
}

fn told(what: &str) -> String {
    if what.is_empty() { String::new() } else { format!(" ({what})") }
}

/// Runs a scene as `bond run` would, and watches its expectations.
fn watched(title: &str, compiled: &Compiled) -> Result<Vec<Outcome>, Stop> {
    let scene = compiled.scene();
    let settings = &compiled.stages().model.settings;
    let named = format!("{title}: {UNRUN}");
    let by = Attribution::Model(&named);
    let stop = settings.stop.unwrap_or(1.0);
    let instants: Vec<f64> = scene
        .probes
        .expectations
        .iter()
        .filter_map(|x| match x.kind {
            ExpectationKind::At { time, .. } => Some(time).filter(|t| *t <= stop * (1.0 + 1e-9)),
            ExpectationKind::Passive | ExpectationKind::PassiveAt(_) | ExpectationKind::Holds { .. } => None,
        })
        .collect();
    let rows = Rows::new(stop, settings.every.map_or(Grid::Parts(1000), Grid::Every), &instants, by)?;
    let options = Steps::new().resolve(settings, stop, settings.every)?;
    drive::possible(scene, &options, stop, by)?;
    let mut sim = Simulation::new(scene, &options)?;
    let mut watch = Watch::new(scene, stop);
    let progress = Progress::new();
    let halted = drive(&mut sim, rows, stop, &mut |sim, t| {
        progress.at(t / stop);
        let values = sim.probes().map_err(Halt::Numerics)?;
        watch.row(t, values);
        Ok(())
    });
    let failure = match halted {
        Ok(()) => None,
        Err(Halt::Numerics(e)) => Some(e.to_string()),
        Err(Halt::Stop(stop)) => return Err(stop),
    };
    Ok(watch.outcomes(&sim.summary(), failure.as_deref()))
}

/// The place of a scene's snapshot, and whether it is that of the file: that of its default scene.
fn snap(path: &Path, scene: &str, default: Option<&str>) -> (PathBuf, bool) {
    match default {
        Some(default) if default != scene => (path.with_extension(format!("{scene}.snap")), false),
        Some(_) | None => (path.with_extension("snap"), true),
    }
}

/// Compares the structure with its snapshot, or writes that.
fn snapshot(place: &Path, title: &str, compiled: &Compiled, update: bool, count: &mut Count) -> Result<(), Stop> {
    let new = compiled.show("all");
    let old = match bond::internal::read(place) {
        // Editors and version control may end lines in the other way.
        Ok(old) => Some(old.replace("\r\n", "\n")),
        Err(_) if !place.exists() => None,
        // Whatever it is, the new one takes its place.
        Err(bond::internal::ReadError::NotText { .. }) if update => None,
        Err(e) => return count.add(false, &format!("{title}: cannot read {}: {e}", place.display())),
    };
    match old {
        Some(old) if old == new => count.add(true, &format!("{title}: snapshot")),
        None if !update => Ok(()),
        Some(old) if !update => {
            count.add(
                false,
                &format!("{title}: snapshot ({} differs; `--update` accepts the new one)", place.display()),
            )?;
            output::offer(&diff::lines(&old, &new))
        }
        Some(_) | None => {
            output::no_model(place)?;
            output::put(Some(place), &new)?;
            count.add(true, &format!("{title}: snapshot written to {}", place.display()))
        }
    }
}
