//! The port-Hamiltonian form of a region as JSON, in the shape that the command's reference fixes.

use super::matrix::{self, Matrix};
use super::object::object;
use super::size::SIZES;
use super::{fact, name, phs};
use crate::expression::Pool;
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Region, Role};
use serde_json::{Map, Value, json};

/// The form; the matrices of a large region are sparse, and null where there is no explicit form.
pub(super) fn form(model: &mut Model, form: &Form, r: &Region, names: &[String]) -> Map<String, Value> {
    let explicit = matrix::explicit_form(model, form, r, names);
    let d = matrix::dirac(form, r, names);
    let h = matrix::energy(&mut model.pool, r);
    let skew = fact::not_skew(&mut model.pool, &d).is_empty();
    let semidefinite = fact::semidefinite(model, form, r, explicit.as_ref()).0;
    let ports: Vec<name::Port> = r.inputs.iter().map(|c| name::port(form, names, *c)).collect();
    let states: Vec<Value> = r
        .states
        .iter()
        .map(|s| {
            json!(object! { "name": s.name, "unit": s.unit.as_ref().map(ToString::to_string), "initial": s.initial })
        })
        .collect();
    let large = r.states.len() > SIZES.dense_states;
    let mut o = object! {
        "states": states,
        "dependent": r.dependent.iter().map(|d| model.element(d.element).name.clone()).collect::<Vec<_>>(),
        "inputs": ports.iter().map(|p| p.input.clone()).collect::<Vec<_>>(),
        "outputs": ports.iter().map(|p| p.output.clone()).collect::<Vec<_>>(),
        "H": name::expression(&model.pool, h),
    };
    let laws: Vec<Value> = r.inputs.iter().map(|c| source(model, form, names, *c)).collect();
    let resistive = resistive(model, form, r);
    let pool = &model.pool;
    match &explicit {
        Some(e) => {
            let u = e.real;
            for (key, m) in [("J", &e.j), ("R", &e.r)] {
                o.insert(key.into(), table(pool, m, large));
            }
            for (key, m) in [("G", &e.g), ("P", &e.p)] {
                o.insert(key.into(), table(pool, &m.columns(0..u), large));
            }
            for (key, m) in [("M", &e.m), ("S", &e.s)] {
                o.insert(key.into(), table(pool, &m.top(u).columns(0..u), large));
            }
            if u < e.inputs.len() {
                let rest = |m: &Matrix| table(pool, &m.columns(u..e.inputs.len()), large);
                // G and P: the further columns; M and S: the further columns, their rows those of all outputs.
                let more = object! { "names": e.inputs[u..], "outputs": e.outputs[u..], "G": rest(&e.g), "P": rest(&e.p),
                "M": rest(&e.m), "S": rest(&e.s) };
                o.insert("nonlinear".into(), Value::Object(more));
            }
        }
        None => {
            for key in ["J", "R", "G", "P", "M", "S"] {
                o.insert(key.into(), Value::Null);
            }
        }
    }
    let dirac = object! { "rows": d.rows, "columns": d.columns, "D": table(pool, &d, large || d.rows.len() > 2 * SIZES.dense_states),
    "sources": laws, "resistive": resistive };
    o.insert("dirac".into(), Value::Object(dirac));
    o.extend(object! { "skew": skew, "semidefinite": semidefinite.decided(), "unbounded": fact::unbounded(r), "pseudo": r.pseudo });
    o
}

/// What a source, bar or open port gives.
fn source(model: &Model, form: &Form, names: &[String], c: ColumnId) -> Value {
    let (left, right) = phs::source(model, form, names, c);
    let law = match form.column(c).role {
        Role::Source(_) => format!("{left} = {right}"),
        Role::Bar | Role::Open(_) | Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => right,
    };
    json!(object! { "name": names[c.at()], "law": law })
}

fn resistive(model: &mut Model, form: &Form, r: &Region) -> Vec<Value> {
    let mut list = Vec::new();
    for (c, _) in &r.resistors {
        let id = form.column(*c).element;
        let Some((left, right)) = name::resistor(model, id) else { continue };
        let e = model.element(id);
        let Law::Resistor(law) = &e.law else { continue };
        let text = format!("{left} = {}", name::expressions(&model.pool, &right));
        let linear = law.linear.is_some() || law.row.is_some();
        let mut one = object! { "name": e.name, "law": text, "linear": linear, "proved": law.dissipative };
        if let Some(line) = e.line.and_then(|l| model.lines.get(l)) {
            one.insert("line".into(), json!(line.name));
        }
        list.push(json!(one));
    }
    list
}

/// A matrix as rows of expressions, or sparse where it is large.
fn table(pool: &Pool, m: &Matrix, large: bool) -> Value {
    if large {
        let entries: Vec<Value> = m.entries.iter().map(|(i, j, e)| json!([i, j, name::expression(pool, *e)])).collect();
        return json!(object! { "sparse": entries, "shape": [m.rows.len(), m.columns.len()] });
    }
    let mut rows = vec![vec!["0".to_string(); m.columns.len()]; m.rows.len()];
    for (i, j, e) in &m.entries {
        rows[*i][*j] = name::expression(pool, *e);
    }
    json!(rows)
}
