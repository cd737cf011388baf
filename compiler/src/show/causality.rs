//! `causality` as text: every bond with its stroke, and why it stands there.

use super::{Shown, name, node, table};
use crate::causality::Cause;
use crate::model::{BondId, Variable};
use bond_grammar::ast::Stroke;
use std::fmt::Write;

/// Why a bond has a stroke that a multiplier gives it.
const MULTIPLIER: &str = "a multiplier, since both ends give the other variable";

/// Why a bond has its stroke, in words.
pub(super) fn reason(shown: &Shown<'_>, bond: BondId) -> String {
    let model = &*shown.model;
    let Some(cause) = shown.causality.causes.get(bond.at()) else { return String::new() };
    match *cause {
        Cause::Source(id) => {
            let e = model.element(id);
            let what = match e.kind.forced() {
                _ if e.is_multiplier() => return MULTIPLIER.into(),
                Some(Variable::Effort) => "gives effort",
                Some(Variable::Flow) => "gives flow",
                None => "can do no other",
            };
            format!("{} {what}", name::element(model, e))
        }
        Cause::Asserted => "asserted".into(),
        Cause::Law(id) => format!("the law of {} is explicit this way", name::element(model, model.element(id))),
        Cause::Hold if model.bond(bond).sampled => "the hold of the double bar".into(),
        Cause::Hold => "an open port".into(),
        Cause::Storage(id) => {
            let e = model.element(id);
            let gives = e.kind.integral().map(|g| shown.causality.gives(model, bond, id) == g);
            let how = if gives == Some(false) { "derivative" } else { "preferred integral" };
            format!("{how} causality of {}", name::element(model, e))
        }
        Cause::Free => "free to choose".into(),
        Cause::Rule(id, from) if model.element(id).added || node::hidden(model, model.bond(from)) => MULTIPLIER.into(),
        Cause::Rule(id, from) => {
            let other = name::bond(model, from, shown.causality.strokes.get(from.at()).copied());
            format!("the rule of {}, from {other}", name::element(model, model.element(id)))
        }
    }
}

/// The strokes with their reasons, dependent storages, laws that are run backwards.
pub(super) fn text(shown: &Shown<'_>) -> String {
    let model = &*shown.model;
    let shown_bonds = || model.bonds.iter().enumerate().filter(|(_, b)| !node::hidden(model, b));
    let rows: Vec<Vec<String>> = shown_bonds()
        .map(|(i, b)| {
            let stroke = shown.causality.strokes.get(i).copied();
            let ends = (model.element(b.tail).name.clone(), name::head(model, b).name.clone());
            let giver = match stroke {
                Some(Stroke::Head) => &ends.0,
                Some(Stroke::Tail) | None => &ends.1,
            };
            let gives = format!("effort from {giver}");
            vec![ends.0.clone(), name::arrow(model, b, stroke), ends.1.clone(), gives, reason(shown, BondId(i as u32))]
        })
        .collect();
    let mut text = format!(
        "{}: {} bonds; the stroke is at the end that receives the effort\n\n",
        model.name,
        shown_bonds().count()
    );
    text.push_str(&table::lines(2, &rows));
    let list = |ids: &[crate::model::ElementId]| {
        ids.iter().map(|id| name::element(model, model.element(*id))).collect::<Vec<_>>().join(", ")
    };
    let dependent = &shown.causality.dependent;
    let _ = match dependent.len() {
        0 => writeln!(text, "\nall storages are in integral causality"),
        _ => writeln!(text, "\nin derivative causality (dependent): {}", list(dependent)),
    };
    let tied: Vec<&str> = model.ids().filter(|(_, e)| e.is_multiplier()).map(|(_, e)| e.name.as_str()).collect();
    if !tied.is_empty() {
        let _ = writeln!(text, "multipliers, where all ends would give the same variable: {}", tied.join(", "));
    }
    if !shown.causality.implicit.is_empty() {
        let _ = writeln!(text, "laws run backwards (implicit): {}", list(&shown.causality.implicit));
    }
    text
}
