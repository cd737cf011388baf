//! `all` as text: what the model is, on a page.

use super::size::SIZES;
use super::{Shown, equation, fact, graph, matrix, name, phs, region, signal, table};
use crate::model::Kind;
use std::fmt::Write;

/// The lines of a list, cut where it is long.
fn cut(mut rows: Vec<Vec<String>>, indent: usize, more: &str) -> String {
    let left = rows.len().saturating_sub(SIZES.list);
    rows.truncate(SIZES.list);
    let mut text = table::lines(indent, &rows);
    if left > 0 {
        let _ = writeln!(text, "{}... and {left} more{more}", " ".repeat(indent));
    }
    text
}

/// The summary.
pub(super) fn text(shown: &mut Shown<'_>) -> String {
    let (model, form) = (&*shown.model, shown.form);
    let mut text = format!("{}\n", model.name);
    for line in &model.docs {
        let _ = writeln!(text, "  {}", line.trim());
    }
    let count = |wanted: fn(Kind) -> bool| model.elements.iter().filter(|e| wanted(e.kind)).count();
    let lines = model.lines.iter().filter(|l| l.ends.len() > 1).count();
    let parts = [
        (count(Kind::is_storage), "storage"),
        (count(|kind| kind == Kind::R) - 2 * lines, "resistor"),
        (lines, "line"),
        (count(Kind::is_source), "source"),
        (count(Kind::is_junction), "junction"),
        (count(|kind| matches!(kind, Kind::TwoPort(_))), "two-port"),
        (count(Kind::is_detector), "detector"),
        (count(|kind| kind == Kind::PORT), "open port"),
        (model.bonds.len(), "bond"),
    ];
    let parts: Vec<String> =
        parts.iter().filter(|p| p.0 > 0).map(|(n, what)| format!("{n} {what}{}", region::plural(*n))).collect();
    let _ = writeln!(text, "  {}", parts.join(", "));
    if !model.parameters.is_empty() {
        let _ = write!(text, "\nparameters\n{}", cut(graph::parameters(shown), 2, ""));
    }
    let names = name::columns(shown.model, form);
    for (i, r) in form.regions.iter().enumerate() {
        let kind = shown.graph.regions.get(i).map(|g| region::kind(shown, g)).unwrap_or_default();
        let _ = writeln!(text, "\nregion {}: {kind}{}", r.name, region::left_out(shown, i));
        one(shown, i, &names, &mut text);
    }
    outputs(shown, &mut text);
    text
}

fn one(shown: &mut Shown<'_>, at: usize, names: &[String], text: &mut String) {
    let (model, form) = (&mut *shown.model, shown.form);
    let r = &form.regions[at];
    let rows: Vec<Vec<String>> = r
        .states
        .iter()
        .map(|s| vec![s.name.clone(), format!("= {} at 0", name::quantity(s.initial, s.unit.as_ref()))])
        .collect();
    if !rows.is_empty() {
        let _ = write!(text, "  states\n{}", cut(rows, 4, ""));
    }
    if r.groups.len() <= SIZES.list {
        let h = matrix::energy(&mut model.pool, r);
        let _ = writeln!(text, "  H = {}", name::expression(&model.pool, h));
    } else {
        let _ = writeln!(text, "  H is a sum of {} terms", r.groups.len());
    }
    let equations = equation::equations(model, form, r, names);
    let pool = &model.pool;
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (s, rate) in r.states.iter().zip(&equations.rates).take(SIZES.list + 1) {
        rows.push(vec![format!("d({})/dt", s.name), format!("= {}", name::expression(pool, *rate))]);
    }
    for u in &equations.unknowns {
        let law = name::expression(pool, u.law);
        rows.push(if u.root {
            vec!["0".into(), format!("= {law}"), format!("gives {}", u.name)]
        } else {
            vec![u.name.clone(), format!("= {law}")]
        });
    }
    if !rows.is_empty() {
        rows.truncate(SIZES.list);
        let left = (r.states.len() + equations.unknowns.len()).saturating_sub(SIZES.list);
        let _ = write!(text, "  equations\n{}", table::lines(4, &rows));
        if left > 0 {
            let _ = writeln!(text, "    ... and {left} more");
        }
    }
    let rows: Vec<Vec<String>> = r
        .inputs
        .iter()
        .map(|c| {
            let (left, right) = phs::source(model, form, names, *c);
            vec![left, format!("= {right}")]
        })
        .collect();
    if !rows.is_empty() {
        let _ = write!(text, "  inputs\n{}", cut(rows, 4, ""));
    }
    let answer = |e| name::expression(&model.pool, e);
    let rows: Vec<Vec<String>> =
        equations.outputs.iter().map(|(left, e)| vec![left.clone(), format!("= {}", answer(*e))]).collect();
    if !rows.is_empty() {
        let _ = write!(text, "  answers\n{}", cut(rows, 4, ""));
    }
    let d = matrix::dirac(form, r, names);
    text.push_str("  facts\n");
    for line in fact::lines(model, form, r, (&d, None, &equations)) {
        let _ = writeln!(text, "    {line}");
    }
}

/// Double bars, probes and what integrals in them mean.
fn outputs(shown: &Shown<'_>, text: &mut String) {
    let model = &*shown.model;
    let bars = region::bars(shown);
    if !bars.is_empty() {
        let rows: Vec<Vec<String>> = bars
            .iter()
            .map(|b| {
                let name = |id| model.element(id).name.clone();
                let held = format!("{} holds its {}", name(b.holder), region::word(b.held));
                vec![name::bond(model, b.bond, None), held, format!("{} answers", name(b.other))]
            })
            .collect();
        let _ = write!(text, "\ndouble bars\n{}", cut(rows, 2, ""));
    }
    text.push_str(&signal::text(shown));
    if !model.probes.is_empty() {
        let rows: Vec<Vec<String>> = model
            .probes
            .iter()
            .map(|p| {
                let unit = p.unit.as_ref().map_or_else(String::new, |u| format!("[{}]", name::in_prose(u)));
                vec![p.name.clone(), format!("= {}", name::expression(&model.pool, p.value)), unit]
            })
            .collect();
        let _ = write!(text, "\nprobes\n{}", cut(rows, 2, ""));
    }
    if !model.integrals.is_empty() {
        let rows: Vec<Vec<String>> = model
            .integrals
            .iter()
            .map(|i| {
                let rate = name::expression(&model.pool, i.rate);
                vec![model.pool.name(i.symbol).to_string(), format!("= integral({rate}, {})", name::number(i.start))]
            })
            .collect();
        let _ = write!(text, "\nintegrals\n{}", cut(rows, 2, ""));
    }
}
