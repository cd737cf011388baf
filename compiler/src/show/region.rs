//! `regions` as text: each region, and the double bars between them.

use super::{Shown, name, table};
use crate::causality::holder;
use crate::graph::Region;
use crate::model::{BondId, ElementId, Hold, Variable};
use std::fmt::Write;

/// `sampled every 0.04 s, hold matched, budget on`, or `continuous`.
pub(super) fn kind(shown: &Shown<'_>, region: &Region) -> String {
    let Some(s) = region.sampling.and_then(|s| shown.model.samplings.get(s)) else { return "continuous".into() };
    let budget = if s.budget { "on" } else { "off" };
    let method = s.method.as_ref().map(|m| format!(", method {m}")).unwrap_or_default();
    let latency = if s.latency > 0.0 { format!(", latency {} s", name::number(s.latency)) } else { String::new() };
    format!("sampled every {} s, hold {}, budget {budget}{method}{latency}", name::number(s.period), s.hold.name())
}

/// What follows where a region does not run.
pub(super) fn left_out(shown: &Shown<'_>, at: usize) -> &'static str {
    if shown.unneeded.is_some_and(|u| u.region(at)) { UNNEEDED } else { "" }
}

/// Why something does not run.
pub(super) const UNNEEDED: &str = ", left out of runs: no probe, open port or expectation depends on it";

/// A double bar: who holds what, and who answers.
pub(super) struct Bar {
    pub(super) bond: BondId,
    pub(super) holder: ElementId,
    pub(super) other: ElementId,
    /// What is held.
    pub(super) held: Variable,
    pub(super) hold: Option<Hold>,
}

/// All double bars, in order of declaration.
pub(super) fn bars(shown: &Shown<'_>) -> Vec<Bar> {
    let model = &*shown.model;
    let sampled = model.bonds.iter().enumerate().filter(|(_, b)| b.sampled);
    sampled
        .map(|(i, b)| {
            let bond = BondId(i as u32);
            let holder = holder(model, bond);
            let hold = model.element(holder).sampling.and_then(|s| model.samplings.get(s)).map(|s| s.hold);
            Bar { bond, holder, other: b.other(holder), held: shown.causality.gives(model, bond, holder), hold }
        })
        .collect()
}

/// `effort` or `flow`.
pub(super) fn word(v: Variable) -> &'static str {
    match v {
        Variable::Effort => "effort",
        Variable::Flow => "flow",
    }
}

/// Regions and double bars.
pub(super) fn text(shown: &Shown<'_>) -> String {
    let model = &*shown.model;
    let regions = &shown.graph.regions;
    let bars = bars(shown);
    let mut text = format!(
        "{}: {} region{}, {} double bar{}\n",
        model.name,
        regions.len(),
        plural(regions.len()),
        bars.len(),
        plural(bars.len())
    );
    for (i, r) in regions.iter().enumerate() {
        let _ = writeln!(text, "\nregion {}: {}{}", r.name, kind(shown, r), left_out(shown, i));
        let elements: Vec<String> = r.elements.iter().map(|e| name::element(model, model.element(*e))).collect();
        text.push_str(&wrap("  ", &elements.join(", ")));
    }
    if !bars.is_empty() {
        text.push_str("\ndouble bars\n");
        let rows: Vec<Vec<String>> = bars.iter().map(|b| bar(shown, b)).collect();
        text.push_str(&table::lines(2, &rows));
    }
    text
}

fn bar(shown: &Shown<'_>, b: &Bar) -> Vec<String> {
    let (name, of) =
        (|id: ElementId| shown.model.element(id).name.clone(), |id: ElementId| shown.graph.region_of[id.at()].at());
    let region = |id: ElementId| shown.graph.regions[of(id)].name.clone();
    let resolution = shown.model.bond(b.bond).resolution;
    let steps = resolution.map(|x| format!(", read in steps of {} (SI)", name::number(x))).unwrap_or_default();
    vec![
        name::bond(shown.model, b.bond, None),
        format!("{} holds its {}", name(b.holder), word(b.held)),
        format!("{} answers with the mean {}{steps}", name(b.other), word(b.held.other())),
        format!("({} | {})", region(b.holder), region(b.other)),
    ]
}

/// `s` where there is not one.
pub(super) fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

/// Breaks text at spaces.
pub(super) fn wrap(indent: &str, text: &str) -> String {
    let (mut all, mut line) = (String::new(), String::new());
    for word in text.split(' ') {
        if !line.is_empty() && line.chars().count() + word.chars().count() > 98 {
            all.push_str(&format!("{indent}{line}\n"));
            line.clear();
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    if !line.is_empty() {
        all.push_str(&format!("{indent}{line}\n"));
    }
    all
}
