//! `bond test`: what models expect of themselves, and snapshots of their structure.

use crate::blame::By;
use crate::diff;
use crate::drive::{self, Halt, drive};
use crate::expectation::{Outcome, Watch};
use crate::input::{self, Which};
use crate::output;
use crate::progress::Progress;
use crate::report;
use crate::rows::{Grid, Rows};
use crate::stop::Stop;
use bond::{Compiled, Options, Simulation, Steps};
use bond_grammar::ast::{self, Item, Statement, StatementKind};
use bond_grammar::source::Sources;
use bond_runtime::scene::ExpectationKind;
use std::fs;
use std::path::{Path, PathBuf};

/// Check what models expect of themselves, and the snapshots of their structure
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  bond test wall.bond\n  bond test models --update\n\nThe last model of each file is tested, and every other one \
                  that has an `expect`. A model without is only compiled.\nThe snapshot of NAME.bond is NAME.snap beside it; it is compared \
                  where it exists, and --update makes or renews it."
)]
pub struct Args {
    /// Models, and folders that are searched for `*.bond`
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Accept the structure as it is: write the snapshots
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
    let mut files = Vec::new();
    for path in &args.paths {
        let before = files.len();
        find(path, &mut files, true)?;
        if files.len() == before {
            return Err(Stop::Usage(format!("there is no `*.bond` in {}", path.display())));
        }
    }
    let mut count = Count::default();
    for file in &files {
        one(file, args, &mut count)?;
    }
    output::offer(&format!("{} passed, {} failed\n", count.passed, count.failed))?;
    if count.failed == 0 { Ok(()) } else { Err(Stop::Said(1)) }
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
    let scenes = match &args.which.model {
        Some(model) => vec![Some(model.clone())],
        None => scenes(&name, &text),
    };
    let last = scenes.len().saturating_sub(1);
    for (i, model) in scenes.into_iter().enumerate() {
        let mut options = Options::new();
        if let Some(model) = &model {
            options = options.model(model);
        }
        match options.compile_str(&name, text.as_str()) {
            Ok(compiled) => {
                let title = format!("{name} {}", compiled.scene().name);
                scene(&title, &compiled, count)?;
                if i == last && path != Path::new("-") {
                    snapshot(path, &title, &compiled, args.update, count)?;
                }
            }
            Err(errors) => {
                report::diagnostics(errors.sources(), errors.list());
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
    let by = By::Model(&named);
    let stop = settings.stop.unwrap_or(1.0);
    let instants: Vec<f64> = scene
        .probes
        .expectations
        .iter()
        .filter_map(|x| match x.kind {
            ExpectationKind::At { time, .. } => Some(time).filter(|t| *t <= stop * (1.0 + 1e-9)),
            ExpectationKind::Passive | ExpectationKind::Holds { .. } => None,
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

/// Compares the structure with its snapshot, or writes that.
fn snapshot(path: &Path, title: &str, compiled: &Compiled, update: bool, count: &mut Count) -> Result<(), Stop> {
    let place = path.with_extension("snap");
    let new = compiled.show("all");
    let old = match bond::read(&place) {
        Ok(old) => Some(old),
        Err(_) if !place.exists() => None,
        // Whatever it is, the new one takes its place.
        Err(bond::ReadError::NotText { .. }) if update => None,
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
            output::put(Some(&place), &new)?;
            count.add(true, &format!("{title}: snapshot written to {}", place.display()))
        }
    }
}
