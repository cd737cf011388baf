//! The comparison for people.

use super::Bench;
use super::front::{Advice, advice};
use super::point::{Measured, Point};
use super::setting::time;
use std::fmt::Write;

/// Letters of a reason.
const REASON_LETTERS: usize = 62;

/// All of it.
pub fn text(b: &Bench) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_text(&mut out, b);
    out
}

fn write_text(out: &mut String, b: &Bench) -> std::fmt::Result {
    writeln!(out, "{:11} {}, {} simulated", "scene", b.model, time(b.stop))?;
    let r = &b.reference;
    writeln!(out, "{:11} {}; its error is about {:.0e}", "reference", r.how, r.error)?;
    match &r.checked {
        Some((how, apart)) => writeln!(out, "{:11} {apart:.0e} away from {how}", "")?,
        None => writeln!(out, "{:11} no second method to check it with", "")?,
    }
    writeln!(
        out,
        "\n{:17} {:12} {:>8} {:>8} {:>8} {:>8} {:>9} {:>7} {:>9}",
        "method", "setting", "error", "on way", "drift", "balance", "steps", "Newton", "time/s"
    )?;
    let mut last = "";
    for p in &b.points {
        let name = if p.method == last { "" } else { p.method };
        last = p.method;
        let mark = if p.front { "*" } else { " " };
        match &p.result {
            Ok(m) => {
                writeln!(out, "{mark} {name:15} {:12} {}", p.setting.cell(), row(m, b.stop, p.passive && !p.keeps()))?
            }
            Err(why) => writeln!(out, "{mark} {name:15} {:12} failed: {}", p.setting.cell(), brief(why))?,
        }
    }
    writeln!(
        out,
        "\n*: on the front: no point is both cheaper and more exact. error: the largest of all probes and states at \
        the end, relative\nto its largest magnitude; on way: of the probes, along the run. drift, balance: of the \
        energy, relative. Newton: iterations\nper step. time/s: processor time per simulated second. <: below the \
        error of the reference. !: more than rounding, by a\nstepper that should keep the balance."
    )?;
    choices(out, b)?;
    for note in &b.notes {
        writeln!(out, "note: {note}")?;
    }
    Ok(())
}

/// `off`: the balance is not what the stepper is to keep.
fn row(m: &Measured, stop: f64, off: bool) -> String {
    let newton = if m.iterations == 0 || m.steps == 0 {
        "-".to_string()
    } else {
        format!("{:.2}", m.iterations as f64 / m.steps as f64)
    };
    let error = format!("{}{:.1e}", if m.floor { "<" } else { "" }, m.error);
    let along = m.worst();
    let (drift, balance) = (small(m.drift), small(m.balance) + if off { "!" } else { "" });
    let pace = time(m.seconds / stop);
    format!("{error:>8} {along:>8.1e} {drift:>8} {balance:>8} {:>9} {newton:>7} {pace:>9}", m.steps)
}

/// A size with two digits.
fn small(x: f64) -> String {
    if x == 0.0 { "0".into() } else { format!("{x:.1e}") }
}

fn choices(out: &mut String, b: &Bench) -> std::fmt::Result {
    let list = advice(&b.points, b.reference.error);
    if list.is_empty() {
        return writeln!(out, "\nno point has an error below 0.1");
    }
    writeln!(out, "\n{:10} {:<35} {:>9}   without the balance", "to choose", "keeps the balance", "time/s")?;
    for Advice { error, passive, other } in list {
        let cost = |p: &Point| time(p.result.as_ref().map_or(f64::NAN, |m| m.seconds) / b.stop);
        let name = |p: &Point| format!("{}, {}", p.method, p.setting.words());
        let (own, seconds) = passive.map_or(("nothing".to_string(), String::new()), |p| (name(p), cost(p)));
        let other = other.map_or(String::new(), |p| format!("{} {}", name(p), cost(p)));
        writeln!(out, "{}", format!("  for {error:<5e} {own:<35} {seconds:>9}   {other}").trim_end())?;
    }
    Ok(())
}

/// Why a point failed, on the rest of a line.
fn brief(why: &str) -> String {
    let why = why.split(';').next().unwrap_or(why);
    if why.chars().count() <= REASON_LETTERS {
        why.to_string()
    } else {
        why.chars().take(REASON_LETTERS - 3).chain("...".chars()).collect()
    }
}
