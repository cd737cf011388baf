//! The report at the end of an exchange.

use super::End;
use crate::stop::Stop;
use crate::summary::{short, steered, steered_json};
use bond::exchange::Exchange;
use bond_runtime::scene::Scene;
use serde_json::{Value, json};
use std::fmt::Write;

/// The results of an exchange.
pub struct Outcome<'a, 'b> {
    /// What met the outside.
    pub scene: &'a Scene,
    /// The exchange.
    pub exchange: &'a Exchange<'b>,
    /// How it ended.
    pub end: &'a End,
    /// The line, in words.
    pub line: &'a str,
    /// Packets that were refused.
    pub refused: u64,
    /// Whether there was a clock.
    pub paced: bool,
    /// What the system did not grant.
    pub without: &'a [String],
    /// Rows of the ledger that the disk was too slow for.
    pub lost: u64,
}

impl Outcome<'_, '_> {
    /// Why it was not passive; empty if it was.
    fn reasons(&self) -> Vec<String> {
        self.exchange.summary().reasons
    }
}

/// For people.
pub fn text(o: &Outcome) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_text(&mut out, o);
    out
}

fn write_text(out: &mut String, o: &Outcome) -> std::fmt::Result {
    let (c, t) = (o.exchange.count(), &o.end.times);
    writeln!(out, "{:11} {}", "scene", o.scene.name)?;
    writeln!(out, "{:11} {}", "line", o.line)?;
    let period = o.exchange.period();
    writeln!(out, "{:11} {} of {} s, in {} s", "intervals", c.intervals, short(period), short(t.wall))?;
    writeln!(
        out,
        "{:11} {} missing (at most {} in a row), {} late; {} doubled, {} overtaken, {} refused",
        "heard",
        c.missing,
        c.silence,
        c.late,
        c.twice,
        c.overtaken,
        c.foreign + o.refused
    )?;
    if o.paced {
        let own = if t.missed > 0 { format!(", of which {} by its own computing", t.own) } else { String::new() };
        writeln!(out, "{:11} {} missed{own}", "deadlines", t.missed)?;
        let l = &t.lateness;
        writeln!(
            out,
            "{:11} median {} us, 99 % below {} us, worst {} us late",
            "jitter",
            short(l.quantile(0.5)),
            short(l.quantile(0.99)),
            short(l.most())
        )?;
    }
    for (name, m) in [("step", &t.step), ("answer", &t.work), ("round trip", &t.round)] {
        if m.count() > 0 {
            let (half, most) = (short(m.quantile(0.5)), short(m.quantile(0.99)));
            writeln!(out, "{name:11} median {half} us, 99 % below {most} us, worst {} us", short(m.most()))?;
        }
    }
    writeln!(out, "{:11} {} J put in, {} J given out", "energy", short(c.put_in), short(c.given_out))?;
    if c.joined > 1 {
        let untold = short(c.untold);
        writeln!(out, "{:11} {} joined; those that left may have drawn {untold} J of it untold", "devices", c.joined)?;
    }
    for (i, reason) in o.reasons().iter().enumerate() {
        writeln!(out, "{:11} {}{reason}", if i == 0 { "passive" } else { "" }, if i == 0 { "NO: " } else { "    " })?;
    }
    if o.reasons().is_empty() {
        writeln!(out, "{:11} yes", "passive")?;
    }
    for (i, line) in steered(&o.exchange.summary()).iter().enumerate() {
        writeln!(out, "{:11} {line}", if i == 0 { "steered" } else { "" })?;
    }
    for what in o.without {
        writeln!(out, "{:11} {what}", "not granted")?;
    }
    if let Some(e) = &o.end.failure {
        writeln!(out, "{:11} {e}", "failed")?;
    }
    Ok(())
}

/// For programs.
pub fn json(o: &Outcome) -> String {
    let (c, t) = (o.exchange.count(), &o.end.times);
    let meter = |m: &super::Meter| -> Value {
        json!({ "count": m.count(), "median_us": m.quantile(0.5), "p99_us": m.quantile(0.99), "max_us": m.most() })
    };
    let summary = o.exchange.summary();
    let reasons = o.reasons();
    let region = |r: &bond::RegionSummary| {
        json!({
            "name": r.name, "H_initial": r.h_initial, "H_final": r.h_final, "supplied": r.supplied,
            "dissipated": r.dissipated, "leaked": r.leaked, "debt_max": r.debt_max, "releases": r.releases, "worst_step": r.worst_step,
        })
    };
    let value = json!({
        "model": o.scene.name,
        "line": o.line,
        "period": o.exchange.period(),
        "latency": o.exchange.latency(),
        "intervals": c.intervals,
        "devices": c.joined,
        "wall_seconds": t.wall,
        "missing": c.missing,
        "longest_silence": c.silence,
        "late": c.late,
        "doubled": c.twice,
        "overtaken": c.overtaken,
        "refused": c.foreign + o.refused,
        "missed_deadlines": t.missed,
        "missed_by_own_computing": t.own,
        "jitter": meter(&t.lateness),
        "step": meter(&t.step),
        "answer": meter(&t.work),
        "round_trip": meter(&t.round),
        // A sum that comes to -0 is 0.
        "energy": { "put_in": c.put_in, "given_out": c.given_out, "untold": c.untold, "net": o.exchange.energy(), "least_stored": c.least + 0.0, "overdrawn": c.overdrawn },
        "passive": reasons.is_empty(),
        "reasons": reasons,
        "steered": steered_json(&summary),
        "not_granted": o.without,
        "ledger_rows_lost": o.lost,
        "regions": summary.regions.iter().map(region).collect::<Vec<_>>(),
        "failure": o.end.failure.as_ref().map(ToString::to_string),
        "broken": o.end.broken.as_ref().and_then(Stop::words),
    });
    format!("{value:#}\n")
}
