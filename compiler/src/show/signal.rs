//! Signals that no bond carries: what is given from outside, what parts are given and give, signal states, and delays.

use super::object::object;
use super::region::UNNEEDED;
use super::{Shown, name, table};
use crate::expression::Expr;
use crate::model::{Delay, Delayed, Exchange, Memory, Model};
use crate::structure::Form;
use crate::units::DisplayUnit;
use serde_json::{Map, Value, json};

/// `dz/dt` or `next z`, and the period of one that moves from sample to sample.
fn left(shown: &Shown<'_>, m: &Memory) -> (String, Option<f64>) {
    let period = m.sampling.and_then(|s| shown.model.samplings.get(s)).map(|s| s.period);
    (if period.is_some() { format!("next {}", m.name) } else { format!("d({})/dt", m.name) }, period)
}

fn out(shown: &Shown<'_>, memory: usize) -> bool {
    shown.unneeded.is_some_and(|u| u.memory(memory))
}

/// All as lists, nothing where there are none.
pub(super) fn text(shown: &Shown<'_>) -> String {
    let (model, form) = (&*shown.model, shown.form);
    let mut text = String::new();
    let rows: Vec<Vec<String>> = model
        .inputs
        .iter()
        .map(|i| vec![i.name.clone(), format!("= {} where nothing is given", name::quantity(i.value, i.unit.as_ref()))])
        .collect();
    if !rows.is_empty() {
        text.push_str("\ninputs from outside\n");
        text.push_str(&table::lines(2, &rows));
    }
    let unit = |u: &Option<DisplayUnit>| u.as_ref().map_or_else(String::new, |u| format!("[{}]", name::in_prose(u)));
    for (way, title) in [(Exchange::Input, "inputs of parts"), (Exchange::Output, "outputs of parts")] {
        let of_way = model.exchanged.iter().filter(|e| e.way == way);
        let rows: Vec<Vec<String>> =
            of_way.map(|e| vec![e.name.clone(), format!("= {}", e.value), unit(&e.unit)]).collect();
        if !rows.is_empty() {
            text.push_str(&format!("\n{title}\n{}", table::lines(2, &rows)));
        }
    }
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (i, (m, law)) in model.memories.iter().zip(&form.memories).enumerate() {
        let (left, period) = left(shown, m);
        let clock = period.map_or_else(String::new, |p| format!("every {} s", name::number(p)));
        let out = if out(shown, i) { UNNEEDED } else { "" };
        let law = format!("{left} = {}{out}", name::expression(&model.pool, *law));
        rows.push(vec![m.name.clone(), format!("= {} at 0", name::quantity(m.start, m.unit.as_ref())), law, clock]);
    }
    if !rows.is_empty() {
        text.push_str("\nsignal states\n");
        text.push_str(&table::lines(2, &rows));
    }
    let rows: Vec<Vec<String>> = delays(model, form)
        .map(|(d, signal)| {
            let signal = name::expression(&model.pool, *signal);
            vec![d.name.clone(), format!("= {} at 0", name::number(d.start)), format!("then {signal}, {}", by(d))]
        })
        .collect();
    if !rows.is_empty() {
        text.push_str("\ndelays\n");
        text.push_str(&table::lines(2, &rows));
    }
    let rows: Vec<Vec<String>> = leaving(model, form)
        .map(|(d, signal)| {
            let signal = name::expression(&model.pool, *signal);
            vec![d.name.clone(), "comes in from outside".into(), format!("where {signal} leaves")]
        })
        .collect();
    if !rows.is_empty() {
        text.push_str("\nwaves at open ports\n");
        text.push_str(&table::lines(2, &rows));
    }
    text
}

/// What is delayed within the scene, beyond its signal states.
fn delays<'a>(model: &'a Model, form: &'a Form) -> impl Iterator<Item = (&'a Delay, &'a Expr)> {
    model.delays.iter().zip(&form.delays).filter(|(d, _)| !d.is_state() && d.of != Delayed::Leaving)
}

/// What leaves at open ports.
fn leaving<'a>(model: &'a Model, form: &'a Form) -> impl Iterator<Item = (&'a Delay, &'a Expr)> {
    model.delays.iter().zip(&form.delays).filter(|(d, _)| d.of == Delayed::Leaving)
}

/// By how much something is delayed, in words.
fn by(d: &Delay) -> String {
    match d.periods {
        Some(n) => format!("{n} period{} later", if n == 1 { "" } else { "s" }),
        None => format!("{} s later", name::number(d.time)),
    }
}

/// Fields for all, none where there are none.
pub(super) fn fields(shown: &Shown<'_>) -> Map<String, Value> {
    let (model, form) = (&*shown.model, shown.form);
    let mut fields = Map::new();
    let unit = |u: &Option<DisplayUnit>| u.as_ref().map(DisplayUnit::to_string);
    if !model.inputs.is_empty() {
        let list = model.inputs.iter();
        let list: Vec<Value> =
            list.map(|i| json!(object! { "name": i.name, "unit": unit(&i.unit), "default": i.value })).collect();
        fields.insert("inputs".into(), json!(list));
    }
    for (way, key) in [(Exchange::Input, "inputs_of_parts"), (Exchange::Output, "outputs_of_parts")] {
        let of_way = model.exchanged.iter().filter(|e| e.way == way);
        let list: Vec<Value> =
            of_way.map(|e| json!(object! { "name": e.name, "unit": unit(&e.unit), "value": e.value })).collect();
        if !list.is_empty() {
            fields.insert(key.into(), json!(list));
        }
    }
    if !model.memories.is_empty() {
        let list = model.memories.iter().zip(&form.memories);
        let list: Vec<Value> = list
            .enumerate()
            .map(|(i, (m, law))| {
                let period = left(shown, m).1;
                let key = if period.is_some() { "next" } else { "rate" };
                let mut o = object! { "name": m.name, "unit": unit(&m.unit), "initial": m.start };
                o.insert(key.into(), json!(name::expression(&model.pool, *law)));
                o.insert("period".into(), json!(period));
                if out(shown, i) {
                    o.insert("left_out".into(), json!(true));
                }
                Value::Object(o)
            })
            .collect();
        fields.insert("signal_states".into(), json!(list));
    }
    let list: Vec<Value> = delays(model, form)
        .map(|(d, signal)| {
            let signal = name::expression(&model.pool, *signal);
            let time = d.periods.is_none().then_some(d.time);
            json!(object! { "name": d.name, "of": signal, "initial": d.start, "time": time, "periods": d.periods })
        })
        .collect();
    if !list.is_empty() {
        fields.insert("delays".into(), json!(list));
    }
    let list: Vec<Value> = leaving(model, form)
        .map(|(d, signal)| json!(object! { "name": d.name, "leaving": name::expression(&model.pool, *signal) }))
        .collect();
    if !list.is_empty() {
        fields.insert("waves".into(), json!(list));
    }
    fields
}
