//! `phs` as text: the port-Hamiltonian form of each region.

use super::matrix::{self, Explicit};
use super::size::SIZES;
use super::{Shown, equation, fact, name, region, signal, table};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Region, Role};
use std::fmt::Write;

/// The form of all regions.
pub(super) fn text(shown: &mut Shown<'_>) -> String {
    let names = name::columns(shown.model, shown.form);
    let mut text = format!("{}: the port-Hamiltonian form\n", shown.model.name);
    for (i, r) in shown.form.regions.iter().enumerate() {
        let kind = shown.graph.regions.get(i).map(|g| region::kind(shown, g)).unwrap_or_default();
        let _ = writeln!(text, "\nregion {}: {kind}", r.name);
        one(shown.model, shown.form, r, &names, &mut text);
    }
    text + &signal::text(shown)
}

fn one(model: &mut Model, form: &Form, r: &Region, names: &[String], text: &mut String) {
    states(r, text);
    energy(model, r, text);
    let explicit = matrix::explicit_form(model, form, r, names);
    match &explicit {
        Some(e) => matrices(model, e, text),
        None => text.push_str(
            "\nthe explicit form is not written out: a loop of its resistors is singular, or it is too large\n",
        ),
    }
    let d = matrix::dirac(form, r, names);
    text.push_str(
        "\nDirac structure [e_I; f_C; e_R] = D [f_I; e_C; f_R], the power e f of each element counted into it\n",
    );
    text.push_str(&table::matrix(&model.pool, "D", &d));
    laws(model, form, r, names, text);
    let equations = equation::equations(model, form, r, names);
    text.push_str("\nfacts\n");
    for line in fact::lines(model, form, r, (&d, explicit.as_ref(), &equations)) {
        let _ = writeln!(text, "  {line}");
    }
}

/// The states with their units and initial values.
pub(super) fn states(r: &Region, text: &mut String) {
    if r.states.is_empty() {
        text.push_str("  no states\n");
        return;
    }
    let _ = writeln!(text, "  {} state{}", r.states.len(), region::plural(r.states.len()));
    let rows: Vec<Vec<String>> = r
        .states
        .iter()
        .map(|s| vec![s.name.clone(), format!("= {} at 0", name::quantity(s.initial, s.unit.as_ref()))])
        .collect();
    text.push_str(&table::lines(4, &rows));
}

/// H, a line a term where there are many.
pub(super) fn energy(model: &mut Model, r: &Region, text: &mut String) {
    if r.groups.len() <= SIZES.table {
        let h = matrix::energy(&mut model.pool, r);
        let _ = writeln!(text, "  H = {}", name::expression(&model.pool, h));
        return;
    }
    text.push_str("  H is the sum of\n");
    for g in &r.groups {
        let _ = writeln!(text, "    {}", name::expression(&model.pool, g.energy));
    }
}

fn matrices(model: &Model, e: &Explicit, text: &mut String) {
    text.push_str("\nexplicit form dx/dt = (J - R) dH/dx + (G - P) u, y = (G + P)^T dH/dx + (M + S) u\n");
    let part = |names: &[String]| if names.is_empty() { "none".to_string() } else { names.join(", ") };
    text.push_str(&region::wrap("  ", &format!("u = {}", part(&e.inputs))));
    text.push_str(&region::wrap("  ", &format!("y = {}", part(&e.outputs))));
    if e.real < e.inputs.len() {
        let (ties, laws): (Vec<usize>, Vec<usize>) = (e.real..e.inputs.len()).partition(|i| e.multipliers[*i]);
        let named = |of: &[String], which: &[usize]| -> String {
            which.iter().map(|i| of[*i].as_str()).collect::<Vec<_>>().join(", ")
        };
        if !laws.is_empty() {
            let _ = writeln!(text, "  of these, the laws of resistors give {}", named(&e.inputs, &laws));
        }
        if !ties.is_empty() {
            let (multipliers, zeros) = (named(&e.inputs, &ties), named(&e.outputs, &ties));
            let _ = writeln!(text, "  of these, constraints give {multipliers}, so that {zeros} stay 0");
        }
    }
    for (title, m) in [("J", &e.j), ("R", &e.r), ("G", &e.g), ("P", &e.p), ("M", &e.m), ("S", &e.s)] {
        if !m.rows.is_empty() && !m.columns.is_empty() {
            text.push_str(&table::matrix(&model.pool, title, m));
        }
    }
}

/// What a source, bar or open port gives.
pub(super) fn source(model: &Model, form: &Form, names: &[String], id: ColumnId) -> (String, String) {
    let c = form.column(id);
    let input = name::port(form, names, id).input;
    let text = match c.role {
        Role::Source(v) => name::expression(&model.pool, v),
        Role::Bar => format!("from the double bar {}", model.bond(c.bond).name),
        Role::Open(_) => "from the outside".to_string(),
        Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => String::new(),
    };
    (input, text)
}

/// The laws of sources and resistors.
fn laws(model: &mut Model, form: &Form, r: &Region, names: &[String], text: &mut String) {
    let mut rows = Vec::new();
    for &c in &r.inputs {
        let (left, right) = source(model, form, names, c);
        let along = if name::port(form, names, c).turned { "along its bond, out of the element" } else { "" };
        rows.push(vec![left, format!("= {right}"), along.to_string()]);
    }
    for (c, how) in &r.resistors {
        let id = form.column(*c).element;
        let Some((left, right)) = name::resistor(model, id) else { continue };
        let Law::Resistor(law) = &model.element(id).law else { continue };
        let mut notes = vec![match law.dissipative {
            _ if model.element(id).line.is_some() => "an end of a lossless line",
            Some(true) => "proved to take power",
            Some(false) => "gives power",
            None => "not proved to take power",
        }];
        if law.curve.is_some() {
            notes.push("a curve, solved in each step");
        } else if how.is_root() {
            notes.push("solved the other way");
        } else if law.gives != form.column(*c).gives {
            notes.push("inverted");
        }
        rows.push(vec![left, format!("= {}", name::expressions(&model.pool, &right)), notes.join(", ")]);
    }
    if !rows.is_empty() {
        text.push_str("  laws\n");
        text.push_str(&table::lines(4, &rows));
    }
}
