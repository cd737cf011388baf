//! What a scene comes to here: as its file says, or with another stepper.

use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// What a run came to.
pub struct Ours {
    /// Method of the first region, and how its steps were chosen.
    pub stepper: String,
    /// Steps of all regions.
    pub steps: u64,
    /// Worst balance of a step.
    pub worst: f64,
    /// All that the ledger misses at the end, relative to the largest energy.
    pub total: f64,
    /// The states of continuous regions at the end.
    pub end: Vec<(String, f64)>,
    /// The largest of each on the way.
    pub size: Vec<f64>,
    /// s of wall time, without compiling.
    pub time: f64,
}

/// Rows at which sizes are looked at.
const ROWS: u32 = 1000;

/// How often what is quick is timed; the least counts. What takes longer than this, s, is timed once.
pub const REPEATS: u32 = 5;
/// See [`REPEATS`].
pub const LONG: f64 = 0.3;

/// Compiles.
///
/// # Errors
/// The first line of what is wrong.
pub fn compile(options: &Options, path: &Path) -> Result<Compiled, String> {
    options.compile_file(path).map_err(|e| title(&e.to_string()))
}

/// What a diagnostic says, in one line.
fn title(text: &str) -> String {
    let line = text.lines().map(str::trim).find(|l| l.starts_with("× ") || l.contains(": "));
    line.unwrap_or(text).trim_start_matches("× ").to_string()
}

/// Runs to an instant; `steps` go before what the file says.
///
/// # Errors
/// In words: what failed, and when.
pub fn run(compiled: &Compiled, steps: Steps, until: Option<f64>, names: &[String]) -> Result<Ours, String> {
    let settings = &compiled.stages().model.settings;
    let stop = until.or(settings.stop).unwrap_or(1.0);
    let chosen = steps.resolve(settings, stop, settings.every).map_err(|e| e.to_string())?;
    let look = |sim: &Simulation<'_>, size: &mut [f64]| {
        for (s, name) in size.iter_mut().zip(names) {
            *s = sim.state(name).map_or(*s, |x| s.max(x.abs()));
        }
    };
    // Once to look at how large the states get, once for the time.
    let mut size = vec![0.0; names.len()];
    let mut sim = Simulation::new(compiled.scene(), &chosen).map_err(|e| e.to_string())?;
    for k in 0..ROWS {
        sim.advance(stop * f64::from(k) / f64::from(ROWS)).map_err(|e| e.to_string())?;
        look(&sim, &mut size);
    }
    let (mut sim, mut time) = (sim, f64::INFINITY);
    for _ in 0..REPEATS {
        sim = Simulation::new(compiled.scene(), &chosen).map_err(|e| e.to_string())?;
        let begin = Instant::now();
        sim.finish(stop).map_err(|e| e.to_string())?;
        time = time.min(begin.elapsed().as_secs_f64());
        if time > LONG {
            break;
        }
    }
    look(&sim, &mut size);
    let summary = sim.summary();
    let region = summary.regions.first().ok_or("there is no region")?;
    let how = match (chosen.step, chosen.tolerance) {
        (Some(h), _) => format!("h = {}", super::table::time(h)),
        (None, Some(x)) => format!("tolerance {x:.0e}"),
        (None, None) => String::new(),
    };
    let exact = compiled.scene().clusters.iter().all(|c| c.period.is_some() || c.step.linear.is_some());
    let how = if exact && chosen.step.is_none() { "fitted to rows".into() } else { how };
    Ok(Ours {
        stepper: format!("{}, {how}", region.stepper),
        steps: summary.regions.iter().map(|r| r.steps).sum(),
        worst: summary.regions.iter().map(|r| r.worst_step).fold(0.0, f64::max),
        total: summary.regions.iter().map(|r| r.total).fold(0.0, f64::max),
        end: names.iter().filter_map(|n| Some((n.clone(), sim.state(n)?))).collect(),
        size,
        time,
    })
}

/// What `bond` answers: exit status, and what it says on both streams.
///
/// # Errors
/// That it cannot be started.
pub fn bond(arguments: &[&str]) -> Result<(Option<i32>, String, String), String> {
    let out = Command::new(env!("CARGO_BIN_EXE_bond")).args(arguments).output().map_err(|e| format!("bond: {e}"))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Ok((out.status.code(), text(&out.stdout), text(&out.stderr)))
}

/// How many expectations of a scene hold, of how many.
///
/// # Errors
/// That `bond test` cannot be started.
pub fn expectations(path: &Path, model: Option<&str>) -> Result<(usize, usize), String> {
    let path = path.display().to_string();
    let mut arguments = vec!["test", path.as_str()];
    arguments.extend(model.into_iter().flat_map(|m| ["--model", m]));
    let (_, out, _) = bond(&arguments)?;
    // Where no model is named, others are tested too; only the last one's count.
    let last = out.lines().filter_map(|l| l.split_whitespace().nth(2)).rfind(|m| m.ends_with(':'));
    let own = |l: &&str| l.split_whitespace().nth(2) == last;
    let held = out.lines().filter(own).filter(|l| l.starts_with("pass ")).count();
    Ok((held, out.lines().filter(own).filter(|l| l.starts_with("pass ") || l.starts_with("FAIL ")).count()))
}
