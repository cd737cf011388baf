//! What is measured besides steps: compiling, ensembles, starting.

use super::figure::{LADDER, WALL};
use super::program::{self, Folder};
use super::{clock, scene};
use bond::internal::{Code, CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Simulation, Steps};
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// From a text to machine code that stands at its start, s: the least of some times.
fn compiled(text: &str, method: Option<&str>, cells: Option<usize>, times: usize) -> Result<f64, String> {
    let mut best = f64::INFINITY;
    for _ in 0..times {
        let start = Instant::now();
        let compiled = scene::compile_text(text, method, cells)?;
        let settings = &compiled.stages().model.settings;
        let options = Steps::fixed(1e-3).resolve(settings, 1.0, None).map_err(|e| e.to_string())?;
        let sim = Simulation::on(Code::Native.backend(), compiled.scene(), &options, []).map_err(|e| e.to_string())?;
        best = best.min(start.elapsed().as_secs_f64());
        drop(sim);
    }
    Ok(best)
}

fn row(out: &mut String, name: &str, bar: f64, seconds: Result<f64, String>) {
    let words = |s: f64| if s < 1.0 { format!("{:.1} ms", 1e3 * s) } else { format!("{s:.2} s") };
    let _ = match seconds {
        Ok(s) => writeln!(out, "| {name} | {} | {} | {} |", words(s), words(bar), if s < bar { "yes" } else { "no" }),
        Err(e) => writeln!(out, "| {name} | {} | {} | no |", super::sheet::cell(&e), words(bar)),
    };
}

/// The table of compile times.
pub fn compile_times() -> String {
    let mut out = String::from("| scene | text to machine code | at most | met |\n| --- | --- | --- | --- |\n");
    row(&mut out, "virtual wall", 0.05, compiled(WALL, None, None, 9));
    row(&mut out, "ladder of 10 000 cells", 2.0, compiled(LADDER, Some("gonzalez"), Some(10_000), 2));
    out
}

/// The row of the largest ladder.
pub fn large() -> String {
    let mut out = String::from("| scene | text to machine code | at most | met |\n| --- | --- | --- | --- |\n");
    row(&mut out, "ladder of 100 000 cells", 20.0, compiled(LADDER, Some("gonzalez"), Some(100_000), 1));
    out
}

/// The table of ensembles: processor time of a whole command, by instance.
pub fn ensembles(folder: &Folder) -> String {
    let mut out = String::from(
        "| T | steps | instances | processor time an instance | instances a second and core |\n| --- | --- | --- | --- | --- |\n",
    );
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/examples/duffing.bond");
    for (stop, steps, n) in [("0.1 s", 20, 2000), ("1 s", 200, 2000), ("60 s", 12_000, 150)] {
        let table = folder.at(&format!("q{steps}.csv"));
        let begun = (clock::children(), Instant::now());
        let status = Command::new(env!("CARGO_BIN_EXE_bond"))
            .arg("run")
            .arg(&model)
            .args(["--threads", "1", "--stop", stop, "--sweep", &format!("k=1..10:{n}"), "-o"])
            .arg(&table)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        let spent = match (begun.0, clock::children()) {
            (Some(a), Some(b)) => b - a,
            _ => begun.1.elapsed().as_secs_f64(),
        };
        let _ = match status {
            Ok(s) if s.success() => {
                let each = spent / f64::from(n);
                writeln!(out, "| {stop} | {steps} | {n} | {:.2} ms | {:.0} |", 1e3 * each, 1.0 / each)
            }
            Ok(s) => writeln!(out, "| {stop} | {steps} | {n} | it failed: {s} | |"),
            Err(e) => writeln!(out, "| {stop} | {steps} | {n} | {e} | |"),
        };
    }
    out
}

/// The least time of a command from its call to its end, ms.
fn called(command: impl Fn() -> Command) -> Result<f64, String> {
    let mut best = f64::INFINITY;
    for _ in 0..30 {
        let start = Instant::now();
        let status = command().stdout(Stdio::null()).stderr(Stdio::null()).status().map_err(|e| e.to_string())?;
        if !status.success() {
            return Err(format!("it failed: {status}"));
        }
        best = best.min(1e3 * start.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// The table of starts.
pub fn starts(folder: &Folder) -> String {
    let mut out = String::from("| command | from call to end |\n| --- | --- |\n");
    let bond = env!("CARGO_BIN_EXE_bond");
    let built = folder.put("wall.bond", WALL).and_then(|()| {
        let status = Command::new(bond)
            .current_dir(folder.at(""))
            .args(["build", "wall.bond", "-o", "wall"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        status.map_err(|e| e.to_string())
    });
    let run = ["run", "--stop", "0.04"];
    let list = [
        (
            "a C program that does nothing",
            folder.hand("chain").and_then(|chain| {
                called(|| {
                    let mut c = Command::new(&chain);
                    c.args(["check", "0", "0"]);
                    c
                })
            }),
        ),
        (
            "`bond --version`",
            called(|| {
                let mut c = Command::new(bond);
                c.arg("--version");
                c
            }),
        ),
        (
            "`bond run wall.bond`, one sample",
            called(|| {
                let mut c = Command::new(bond);
                c.args(["run"]).arg(folder.at("wall.bond")).args(&run[1..]);
                c
            }),
        ),
        (
            "the wall as an executable, one sample",
            built.and_then(|_| {
                called(|| {
                    let mut c = Command::new(folder.at("wall"));
                    c.args(run);
                    c
                })
            }),
        ),
    ];
    for (name, time) in list {
        let _ = match time {
            Ok(ms) => writeln!(out, "| {name} | {ms:.1} ms |"),
            Err(e) => writeln!(out, "| {name} | {} |", super::sheet::cell(&e)),
        };
    }
    out
}

/// Time of one link of the chain of multiply-adds, ns.
pub fn chain(folder: &Folder) -> Result<f64, String> {
    let path = folder.hand("chain")?;
    program::time(&path, 1, 2_000_000, 5).map(|ns| ns / 2e6)
}
