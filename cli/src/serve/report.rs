//! The report at the end of an exchange.

use super::End;
use crate::stop::Stop;
use crate::summary::{short, steered, steered_json};
use bond::Summary;
use bond::exchange::{Exchange, WaveExchange};
use bond_runtime::scene::{Scene, WavePort};
use serde_json::{Value, json};
use std::fmt::Write;

/// The results of an exchange.
pub struct Outcome<'a, 'b> {
    /// What met the outside.
    pub scene: &'a Scene,
    /// What was exchanged, and with whom.
    pub met: Met<'a, 'b>,
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

/// An exchange.
#[derive(Clone, Copy)]
pub enum Met<'a, 'b> {
    /// With a device.
    Device(&'a Exchange<'b>),
    /// Of waves, with another program.
    Waves(&'a WaveExchange<'b>),
}

impl Met<'_, '_> {
    fn summary(&self) -> Summary {
        match self {
            Met::Device(x) => x.summary(),
            Met::Waves(x) => x.summary(),
        }
    }

    fn period(&self) -> f64 {
        match self {
            Met::Device(x) => x.period(),
            Met::Waves(x) => x.period(),
        }
    }

    fn intervals(&self) -> u64 {
        match self {
            Met::Device(x) => x.count().intervals,
            Met::Waves(x) => x.count().intervals,
        }
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
    let (t, summary) = (&o.end.times, o.met.summary());
    writeln!(out, "{:11} {}", "scene", o.scene.name)?;
    writeln!(out, "{:11} {}", "line", o.line)?;
    let period = o.met.period();
    writeln!(out, "{:11} {} of {} s, in {} s", "intervals", o.met.intervals(), short(period), short(t.wall))?;
    match o.met {
        Met::Device(x) => heard_of_device(out, o, x)?,
        Met::Waves(x) => heard_of_waves(out, o, x)?,
    }
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
    match o.met {
        Met::Device(x) => energy_of_device(out, x)?,
        Met::Waves(x) => energy_of_waves(out, o.scene, x)?,
    }
    for (i, reason) in summary.reasons.iter().enumerate() {
        writeln!(out, "{:11} {}{reason}", if i == 0 { "passive" } else { "" }, if i == 0 { "NO: " } else { "    " })?;
    }
    if summary.reasons.is_empty() {
        writeln!(out, "{:11} yes", "passive")?;
    }
    for (i, line) in steered(&summary).iter().enumerate() {
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

fn heard_of_device(out: &mut String, o: &Outcome, x: &Exchange) -> std::fmt::Result {
    let c = x.count();
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
    )
}

fn energy_of_device(out: &mut String, x: &Exchange) -> std::fmt::Result {
    let c = x.count();
    writeln!(out, "{:11} {} J put in, {} J given out", "energy", short(c.put_in), short(c.given_out))?;
    if c.joined > 1 {
        let untold = short(c.untold);
        writeln!(out, "{:11} {} joined; those that left may have drawn {untold} J of it untold", "devices", c.joined)?;
    }
    Ok(())
}

fn heard_of_waves(out: &mut String, o: &Outcome, x: &WaveExchange) -> std::fmt::Result {
    let c = x.count();
    writeln!(
        out,
        "{:11} {} waves, {} intervals without; {} doubled or too late, {} joined, {} refused",
        "heard",
        c.heard,
        c.missing,
        c.stale,
        c.joined,
        c.foreign + c.unlike + o.refused
    )?;
    match x.misfit() {
        Some(why) => writeln!(out, "{:11} {} packets: {why}", "do not fit", c.unlike),
        None => Ok(()),
    }
}

fn energy_of_waves(out: &mut String, scene: &Scene, x: &WaveExchange) -> std::fmt::Result {
    for (i, port) in scene.waves.iter().enumerate() {
        let e = x.energy(i);
        writeln!(
            out,
            "{:11} {}: {} J sent, {} J received, {} J waiting, {} J lost on the way here",
            if i == 0 { "waves" } else { "" },
            port.name,
            short(e.sent),
            short(e.received),
            short(e.waiting),
            short(e.lost)
        )?;
    }
    Ok(())
}

/// For programs.
pub fn json(o: &Outcome) -> String {
    let t = &o.end.times;
    let meter = |m: &super::Meter| -> Value {
        json!({ "count": m.count(), "median_us": m.quantile(0.5), "p99_us": m.quantile(0.99), "max_us": m.most() })
    };
    let summary = o.met.summary();
    let region = |r: &bond::RegionSummary| {
        json!({
            "name": r.name, "H_initial": r.h_initial, "H_final": r.h_final, "supplied": r.supplied,
            "dissipated": r.dissipated, "leaked": r.leaked, "debt_max": r.debt_max, "releases": r.releases, "worst_step": r.worst_step,
        })
    };
    let mut value = json!({
        "model": o.scene.name,
        "line": o.line,
        "period": o.met.period(),
        "intervals": o.met.intervals(),
        "wall_seconds": t.wall,
        "missed_deadlines": t.missed,
        "missed_by_own_computing": t.own,
        "jitter": meter(&t.lateness),
        "step": meter(&t.step),
        "answer": meter(&t.work),
        "passive": summary.reasons.is_empty(),
        "reasons": summary.reasons,
        "steered": steered_json(&summary),
        "not_granted": o.without,
        "ledger_rows_lost": o.lost,
        "regions": summary.regions.iter().map(region).collect::<Vec<_>>(),
        "failure": o.end.failure.as_ref().map(ToString::to_string),
        "broken": o.end.broken.as_ref().and_then(Stop::words),
    });
    let own = match o.met {
        Met::Device(x) => {
            let c = x.count();
            json!({
                "latency": x.latency(),
                "devices": c.joined,
                "missing": c.missing,
                "longest_silence": c.silence,
                "late": c.late,
                "doubled": c.twice,
                "overtaken": c.overtaken,
                "refused": c.foreign + o.refused,
                "round_trip": meter(&t.round),
                // A sum that comes to -0 is 0.
                "energy": { "put_in": c.put_in, "given_out": c.given_out, "untold": c.untold, "net": x.energy(), "least_stored": c.least + 0.0, "overdrawn": c.overdrawn },
            })
        }
        Met::Waves(x) => {
            let c = x.count();
            let port = |(i, port): (usize, &WavePort)| {
                let e = x.energy(i);
                json!({
                    "name": port.name, "impedance": port.impedance, "sent": e.sent, "received": e.received,
                    "waiting": e.waiting, "lost": e.lost,
                })
            };
            json!({
                "programs": c.partners,
                "heard": c.heard,
                "missing": c.missing,
                "stale": c.stale,
                "joined": c.joined,
                "refused": c.foreign + c.unlike + o.refused,
                "misfit": x.misfit(),
                "waves": o.scene.waves.iter().enumerate().map(port).collect::<Vec<_>>(),
            })
        }
    };
    if let (Value::Object(all), Value::Object(own)) = (&mut value, own) {
        all.extend(own);
    }
    format!("{value:#}\n")
}
