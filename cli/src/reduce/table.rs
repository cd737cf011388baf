//! The results of a reduction as text.

use super::{Reduction, Size, percent};
use crate::bench::time;
use crate::summary::{left_out, short};
use std::fmt::Write;

/// A table of the parts, and both models side by side.
pub fn text(r: &Reduction) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = written(&mut out, r);
    out
}

fn written(out: &mut String, r: &Reduction) -> std::fmt::Result {
    writeln!(out, "scene       {}", r.model)?;
    writeln!(out, "simulated   {} with {}", time(r.stop), r.setting.words())?;
    writeln!(out, "asked       no probe changes by more than {} of its largest value", percent(r.error))?;
    if let Some(left) = left_out(&r.unneeded) {
        writeln!(out, "left out    {left}")?;
    }
    writeln!(out)?;
    let width = r.parts.iter().map(|e| e.part.name.chars().count()).max().unwrap_or(0).max(4);
    writeln!(out, "{:width$}  kind  {:>12}  {:>9}", "part", "activity", "share")?;
    for e in &r.parts {
        let fate = e.kept.as_ref().map_or("left out".to_string(), |why| format!("kept: {why}"));
        let (activity, share) = (format!("{} J", short(e.activity)), percent(e.share));
        writeln!(out, "{:width$}  {:4}  {activity:>12}  {share:>9}  {fate}", e.part.name, e.part.kind)?;
    }
    writeln!(out)?;
    writeln!(out, "{:18}{:>12}  {:>12}", "", "whole", "reduced")?;
    let mut row = |what: &str, of: &dyn Fn(&Size) -> String| {
        writeln!(out, "{what:18}{:>12}  {:>12}", of(&r.whole), of(&r.reduced))
    };
    row("parts", &|s| s.parts.to_string())?;
    row("states", &|s| s.states.to_string())?;
    row("steps", &|s| s.steps.to_string())?;
    row("time for a second", &|s| time(s.seconds))?;
    writeln!(out)?;
    writeln!(out, "moved by")?;
    for (name, moved) in &r.moved {
        writeln!(out, "  {name:16}{:>12}", percent(*moved))?;
    }
    Ok(())
}
