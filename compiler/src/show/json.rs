//! Everything as JSON.

use super::json_form::form;
use super::object::object;
use super::{Shown, What, causality, name, region, signal};
use crate::model::{BondId, Law};
use bond_grammar::ast::Stroke;
use serde_json::{Map, Value, json};

/// What is asked for, as indented JSON with a line end.
pub(super) fn text(shown: &mut Shown<'_>, what: What) -> String {
    let value = match what {
        What::All => {
            let mut all = object! { "model": shown.model.name, "docs": shown.model.docs };
            all.insert("graph".into(), graph(shown));
            all.insert("causality".into(), strokes(shown));
            if let Value::Object(regions) = regions(shown) {
                all.extend(regions);
            }
            all.insert("phs".into(), forms(shown));
            all.insert("probes".into(), probes(shown));
            all.insert("programs".into(), programs(shown)["programs"].take());
            Value::Object(all)
        }
        What::Graph => graph(shown),
        What::Causality => strokes(shown),
        What::Phs => forms(shown),
        What::Regions => regions(shown),
        What::Program => programs(shown),
    };
    let mut text = String::new();
    write(&value, 0, &mut text);
    text.push('\n');
    text
}

/// Indented, with lists of plain values on one line.
fn write(value: &Value, depth: usize, text: &mut String) {
    let plain = |v: &Value| !v.is_array() && !v.is_object();
    let indent = |d: usize| format!("\n{}", "  ".repeat(d));
    match value {
        Value::Array(all) if !all.iter().all(plain) => {
            text.push('[');
            for (i, v) in all.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { "," });
                text.push_str(&indent(depth + 1));
                write(v, depth + 1, text);
            }
            text.push_str(&indent(depth));
            text.push(']');
        }
        Value::Array(all) => {
            let all: Vec<String> = all.iter().map(Value::to_string).collect();
            text.push_str(&format!("[{}]", all.join(", ")));
        }
        Value::Object(map) if !map.is_empty() => {
            text.push('{');
            for (i, (k, v)) in map.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { "," });
                text.push_str(&format!("{}{}: ", indent(depth + 1), Value::from(k.as_str())));
                write(v, depth + 1, text);
            }
            text.push_str(&indent(depth));
            text.push('}');
        }
        Value::Object(_) | Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {
            text.push_str(&value.to_string());
        }
    }
}

fn graph(shown: &Shown<'_>) -> Value {
    let model = &*shown.model;
    let elements: Vec<Value> = model
        .ids()
        .filter(|(_, e)| !e.added)
        .map(|(id, e)| {
            let region = &shown.graph.regions[shown.graph.region_of[id.at()].at()];
            let mut o = object! { "name": e.name, "kind": name::kind(model, e), "law": name::law(shown, id), "region": region.name };
            if let Law::Storage(s) = &e.law {
                let unit = shown.graph.bonds_of[id.at()].first().and_then(|b| super::graph::state_unit(shown, id, *b));
                o.insert("state".into(), json!(model.pool.name(s.state)));
                o.insert("unit".into(), unit.map_or(Value::Null, |u| json!(u.to_string())));
                o.insert("initial".into(), json!(s.initial));
            }
            let bundle = super::node::bundled(model, &e.name);
            if bundle != e.name {
                o.insert("bundle".into(), json!(bundle));
            }
            if e.active {
                o.insert("active".into(), json!(true));
            }
            Value::Object(o)
        })
        .collect();
    let bonds: Vec<Value> = model
        .bonds
        .iter()
        .enumerate()
        .filter(|(_, b)| !super::node::hidden(model, b))
        .map(|(i, b)| {
            let unit = |v| name::bond_unit(model, BondId(i as u32), v).map(|u| u.to_string());
            let units = [unit(crate::model::Variable::Effort), unit(crate::model::Variable::Flow)];
            let ends = [&model.element(b.tail).name, &name::head(model, b).name];
            let mut o = object! { "name": b.name, "tail": ends[0], "head": ends[1],
            "sampled": b.sampled, "asserted": b.stroke.map(stroke), "effort": units[0], "flow": units[1] };
            let bundle = ends.map(|name| super::node::bundled(model, name));
            if bundle[0] != *ends[0] || bundle[1] != *ends[1] {
                o.insert("bundle".into(), json!(bundle));
            }
            Value::Object(o)
        })
        .collect();
    let parameters: Vec<Value> = model
        .parameters
        .iter()
        .map(|p| json!(object! { "name": p.name, "value": p.value, "unit": p.unit.as_ref().map(ToString::to_string) }))
        .collect();
    let diagram = super::picture::diagram(shown, What::Graph);
    let signals = diagram.links.iter().filter(|l| l.bonds.is_none());
    let name = |i: usize| diagram.nodes[i].label();
    let signals: Vec<Value> = signals.map(|l| json!(object! { "from": name(l.tail), "to": name(l.head) })).collect();
    json!(object! { "elements": elements, "bonds": bonds, "signals": signals, "parameters": parameters })
}

fn stroke(s: Stroke) -> &'static str {
    match s {
        Stroke::Head => "head",
        Stroke::Tail => "tail",
    }
}

fn strokes(shown: &Shown<'_>) -> Value {
    let model = &*shown.model;
    let bonds: Vec<Value> = model.bonds.iter().enumerate().map(|(i, b)| {
        let s = shown.causality.strokes.get(i).copied().map(stroke);
        json!(object! { "name": b.name, "tail": model.element(b.tail).name, "head": name::head(model, b).name, "stroke": s,
            "cause": causality::reason(shown, BondId(i as u32)) })
    }).collect();
    let list =
        |ids: &[crate::model::ElementId]| ids.iter().map(|id| model.element(*id).name.clone()).collect::<Vec<_>>();
    json!(
        object! { "bonds": bonds, "dependent": list(&shown.causality.dependent), "implicit": list(&shown.causality.implicit) }
    )
}

/// Name, kind, and period of a region.
fn head(shown: &Shown<'_>, at: usize) -> Map<String, Value> {
    let r = &shown.form.regions[at];
    let sampling = r.sampling.and_then(|s| shown.model.samplings.get(s));
    let mut o = object! { "name": r.name, "kind": if sampling.is_some() { "sampled" } else { "continuous" } };
    if let Some(s) = sampling {
        o.insert("period".into(), json!(s.period));
    }
    if shown.unneeded.is_some_and(|u| u.region(at)) {
        o.insert("left_out".into(), json!(true));
    }
    o
}

fn regions(shown: &Shown<'_>) -> Value {
    let model = &*shown.model;
    let name = |id: crate::model::ElementId| model.element(id).name.clone();
    let regions: Vec<Value> = (0..shown.form.regions.len().min(shown.graph.regions.len()))
        .map(|i| {
            let r = &shown.graph.regions[i];
            let mut o = head(shown, i);
            if let Some(s) = r.sampling.and_then(|s| model.samplings.get(s)) {
                o.extend(object! { "hold": s.hold.name(), "budget": s.budget, "method": s.method });
                if s.latency > 0.0 {
                    o.insert("latency".into(), json!(s.latency));
                }
            }
            o.insert("elements".into(), json!(r.elements.iter().map(|e| name(*e)).collect::<Vec<_>>()));
            o.insert("pseudo".into(), json!(shown.form.regions[i].pseudo));
            Value::Object(o)
        })
        .collect();
    let bars: Vec<Value> = region::bars(shown)
        .iter()
        .map(|b| {
            let mut o = object! { "bond": model.bond(b.bond).name, "holder": name(b.holder), "holds": region::word(b.held),
            "answers": name(b.other), "with": region::word(b.held.other()), "hold": b.hold.map(|h| h.name()) };
            if let Some(resolution) = model.bond(b.bond).resolution {
                o.insert("resolution".into(), json!(resolution));
            }
            Value::Object(o)
        })
        .collect();
    json!(object! { "regions": regions, "bars": bars })
}

fn probes(shown: &Shown<'_>) -> Value {
    let pool = &shown.model.pool;
    let list = shown.model.probes.iter();
    list.map(|p| {
        json!(
            object! { "name": p.name, "value": name::expression(pool, p.value), "unit": p.unit.as_ref().map(ToString::to_string) }
        )
    })
    .collect()
}

fn programs(shown: &Shown<'_>) -> Value {
    let list: Vec<Value> =
        shown.programs.iter().map(|p| json!(object! { "name": p.name, "text": p.to_string() })).collect();
    json!(object! { "programs": list })
}

fn forms(shown: &mut Shown<'_>) -> Value {
    let names = name::columns(shown.model, shown.form);
    let mut list = Vec::new();
    for at in 0..shown.form.regions.len() {
        let mut o = head(shown, at);
        o.extend(form(shown.model, shown.form, &shown.form.regions[at], &names));
        list.push(Value::Object(o));
    }
    let mut all = object! { "regions": list };
    all.extend(signal::fields(shown));
    Value::Object(all)
}
