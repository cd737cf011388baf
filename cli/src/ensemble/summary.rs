//! The summary of an ensemble, for people and for programs.

use super::job::Job;
use super::statistics::{Moments, Statistics};
use crate::stop::Stop;
use crate::summary::short;
use bond_compiler::units;
use bond_runtime::scene::Scene;
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// Most failures that the text names.
const FAILURES_TOLD: usize = 3;

/// The results of an ensemble.
pub struct Told<'a> {
    /// The common part of the instances.
    pub job: &'a Job,
    /// The scene of one of them.
    pub scene: &'a Scene,
    /// Their statistics.
    pub statistics: &'a Statistics,
    /// How long it took, s.
    pub wall: f64,
    /// Instances that ran in that time; others were there before.
    pub ran: u64,
    /// Threads.
    pub threads: u64,
}

impl Told<'_> {
    /// Instances a second.
    fn pace(&self) -> f64 {
        if self.wall > 0.0 { self.ran as f64 / self.wall } else { f64::INFINITY }
    }

    /// Why it failed, if it did: how many, and the first of them.
    pub fn failure(&self) -> Option<String> {
        let s = self.statistics;
        let list: Vec<String> = s.failures.iter().take(FAILURES_TOLD).map(|(i, why)| self.named(*i, why)).collect();
        let head = format!("{} of {} instances failed", s.failed, s.count);
        match s.failed {
            0 => None,
            n if n as usize <= FAILURES_TOLD => Some(format!("{head}:\n  {}", list.join("\n  "))),
            _ => Some(format!("{head}, the first of them:\n  {}", list.join("\n  "))),
        }
    }

    fn named(&self, instance: u64, why: &str) -> String {
        format!("{}: {why}", self.job.plan.named(instance))
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let s = self.statistics;
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let before = s.count - self.ran;
        let there = if before > 0 { format!(", {before} were there before") } else { String::new() };
        writeln!(out, "{:11} {}", "scene", self.scene.name)?;
        writeln!(
            out,
            "{:11} {}: {} run in {} s of wall time ({} a second, {threads}){there}",
            "instances",
            s.count,
            self.ran,
            short(self.wall),
            short(self.pace()),
        )?;
        writeln!(out, "{:11} {}", "failed", if s.failed == 0 { "none".into() } else { s.failed.to_string() })?;
        let ended = s.count - s.failed;
        let passive = match (s.passive, s.failed) {
            (0, _) if ended == 0 => "none got to the end".into(),
            (n, 0) if n == ended => "yes, all".into(),
            (n, _) if n == ended => format!("yes, all {n} that got to the end"),
            (n, _) => format!("NO: {n} of {ended} that got to the end"),
        };
        writeln!(out, "{:11} {passive}", "passive")?;
        if let Some((worst, instance)) = s.worst {
            writeln!(
                out,
                "{:11} worst step {} (relative), of {}",
                "balance",
                short(worst),
                self.job.plan.named(instance)
            )?;
        }
        if self.job.probes.is_empty() || ended == 0 {
            return Ok(());
        }
        let width = self.job.probes.iter().map(|n| n.chars().count()).max().unwrap_or(0).clamp(11, 40);
        let [min, mean, max, sd] = ["min", "mean", "max", "sd"];
        writeln!(out, "\n{:w$} {min:12} {mean:12} {max:12} {sd}", "at the end", w = width + 2)?;
        for (i, (name, m)) in self.job.probes.iter().zip(&s.probes).enumerate() {
            let unit = self.scene.probes.units.get(i).and_then(Option::as_deref).map_or("", units::in_prose);
            let [min, mean, max, sd] = numbers(m).map(|(_, x)| if x.is_nan() { "-".into() } else { short(x) });
            let row = format!("  {name:width$} {min:12} {mean:12} {max:12} {sd:12} {unit}");
            writeln!(out, "{}", row.trim_end())?;
        }
        Ok(())
    }

    /// For programs.
    ///
    /// # Errors
    /// None that is known.
    pub fn json(&self) -> Result<String, Stop> {
        let s = self.statistics;
        let failures: Vec<Value> = s
            .failures
            .iter()
            .map(|(i, why)| json!({"instance": i, "parameters": self.parameters(*i), "error": why}))
            .collect();
        let probes: Map<String, Value> = self
            .job
            .probes
            .iter()
            .zip(&s.probes)
            .map(|(name, m)| {
                let entries = numbers(m).map(|(what, x)| (what.to_string(), json!(x)));
                (name.clone(), Value::Object(entries.into_iter().collect()))
            })
            .collect();
        let value = json!({
            "model": self.scene.name,
            "instances": s.count,
            "ran": self.ran,
            "failed": s.failed,
            "failures": failures,
            "passive": s.passive,
            "balance": {"worst_step": s.worst.map(|w| w.0), "instance": s.worst.map(|w| w.1)},
            "wall_seconds": self.wall,
            "instances_per_second": self.pace(),
            "threads": self.threads,
            "final": probes,
        });
        serde_json::to_string_pretty(&value).map(|s| s + "\n").map_err(|e| Stop::Usage(e.to_string()))
    }

    fn parameters(&self, instance: u64) -> Map<String, Value> {
        let values = self.job.plan.values(instance);
        self.job.plan.paths().zip(values).map(|(p, (x, _))| (p.to_string(), json!(x))).collect()
    }
}

fn numbers(m: &Moments) -> [(&'static str, f64); 4] {
    [("min", m.min()), ("mean", m.mean()), ("max", m.max()), ("sd", m.sd())]
}
