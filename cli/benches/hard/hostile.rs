//! What the command answers where a scene cannot be right: sampled walls at any period, parameters of no physics, and
//! the cases where we fail.

use super::case::path;
use super::ours::{bond, compile};
use super::table::{short, table};
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Options, Simulation, Steps};

/// The sampled wall at periods from 1e-4 to 10 times the fastest time.
pub fn sampled() -> String {
    let head = ["period over the fastest time", "pushed", "hold", "passive", "debt", "bars differ", "off its rest"];
    let mut rows = Vec::new();
    for ratio in ["1e-4", "1e-3", "1e-2", "0.1", "0.3", "1", "2", "3", "5", "10"] {
        for (model, pushed) in [("Sampled", false), ("SampledPushed", true)] {
            eprintln!("sampled, {ratio}, {model}");
            let mut cells = vec![ratio.to_string(), if pushed { "5 N" } else { "no" }.into()];
            let run = || -> Result<Vec<String>, String> {
                let options = Options::new().model(model).set("ratio", ratio);
                let compiled = compile(&options, &path("sampled"))?;
                let settings = &compiled.stages().model.settings;
                let options = Steps::new().resolve(settings, 60.0, None).map_err(|e| e.to_string())?;
                let mut sim = Simulation::new(compiled.scene(), &options).map_err(|e| e.to_string())?;
                // It is at rest after 3 s, but for large periods.
                let stop = if ratio.parse::<f64>().unwrap_or(1.0) < 0.05 { 6.0 } else { 60.0 };
                sim.finish(stop).map_err(|e| e.to_string())?;
                let x = sim.probe("x").map_err(|e| e.to_string())?;
                let rest = if pushed { 5e-3 } else { 0.0 };
                let s = sim.summary();
                let debt = s.regions.iter().map(|r| r.debt_max).fold(0.0, f64::max);
                let apart = s.bars.iter().map(|b| b.difference).fold(0.0, f64::max);
                let hold = s.regions.iter().find_map(|r| r.hold.as_ref()).map(ToString::to_string);
                Ok(vec![
                    hold.unwrap_or_default(),
                    if s.passive { "yes" } else { "no" }.into(),
                    format!("{} J", short(debt)),
                    format!("{} J", short(apart)),
                    format!("{} m", short((x - rest).abs())),
                ])
            };
            match run() {
                Ok(found) => cells.extend(found),
                Err(why) => cells.extend([why, "-".into(), "-".into(), "-".into(), "-".into()]),
            }
            rows.push(cells);
        }
    }
    table(&head, &rows)
}

/// What is tried on `hostile.bond`, and on others.
pub const SETTINGS: [(&str, &str); 34] = [
    ("hostile", "m=1e-300"),
    ("hostile", "m=1e300"),
    ("hostile", "m=5e-324"),
    ("hostile", "m=0"),
    ("hostile", "m=-1"),
    ("hostile", "m=NaN"),
    ("hostile", "m=inf"),
    ("hostile", "m=1e999"),
    ("hostile", "k=1e-300"),
    ("hostile", "k=1e300"),
    ("hostile", "k=0"),
    ("hostile", "k=-100"),
    ("hostile", "beta=1e-300"),
    ("hostile", "beta=1e300"),
    ("hostile", "beta=0"),
    ("hostile", "beta=-1e3"),
    ("hostile", "b=1e-300"),
    ("hostile", "b=1e300"),
    ("hostile", "b=0"),
    ("hostile", "b=-1"),
    ("hostile", "x0=1e-300"),
    ("hostile", "x0=1e300"),
    ("hostile", "x0=1e80"),
    ("hostile", "v0=1e-300"),
    ("hostile", "v0=1e300"),
    ("hostile", "u=1e300"),
    ("hostile", "u=1e-300"),
    ("sampled", "ratio=0"),
    ("sampled", "ratio=1e-300"),
    ("sampled", "ratio=1e300"),
    ("sampled", "ratio=-1"),
    ("fput", "n=0"),
    ("fput", "n=1e300"),
    ("diode_clipper", "v_t=1e-300"),
];

/// What a run says, in one line: that it is passive, or why it ended.
fn said(out: &str, error: &str) -> String {
    let wrong = error.lines().map(str::trim).find(|l| l.starts_with("× ") || l.starts_with("error:"));
    let ledger = out.lines().find(|l| l.starts_with("passive "));
    let line = wrong.or(ledger).map_or("nothing", |l| l.trim_start_matches("× "));
    line.split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace("passive yes", "runs; passive")
        .replace("passive NO", "runs; not passive")
}

/// Parameters of no physics.
///
/// # Errors
/// That `bond` cannot be started.
pub fn parameters() -> Result<String, String> {
    let mut rows = Vec::new();
    for (file, set) in SETTINGS {
        let path = path(file).display().to_string();
        let (status, out, error) = bond(&["run", &path, "--set", set])?;
        let status = status.map_or("killed".to_string(), |s| s.to_string());
        rows.push(vec![format!("`{file}`"), format!("`--set {set}`"), status, said(&out, &error)]);
    }
    Ok(table(&["scene", "with", "exit status", "what it says"], &rows))
}

/// Where we fail, by name, file, model, and what it is run with.
const FAILURES: [(&str, &str, &[&str]); 4] = [
    ("double_well", "DoubleWellFromTop", &[]),
    ("diode_bridge", "WithoutLeak", &["--stop", "10ms", "--step", "20us", "--at", "7.8ms", "-o", "-"]),
    ("hertz_chain", "HertzChain", &["--set", "gap=0", "--method", "gonzalez"]),
    ("ring_modulator", "RingModulator", &[]),
];

/// What the failing ones say.
///
/// # Errors
/// That `bond` cannot be started.
pub fn failures() -> Result<String, String> {
    let mut rows = Vec::new();
    for (file, model, more) in FAILURES {
        let path = path(file).display().to_string();
        let (status, out, error) = bond(&[&["run", &path, "--model", model], more].concat())?;
        let status = status.map_or("killed".to_string(), |s| s.to_string());
        rows.push(vec![format!("`{file}` {model} {}", more.join(" ")), status, said(&out, &error)]);
    }
    Ok(table(&["scene", "exit status", "what it says"], &rows))
}
