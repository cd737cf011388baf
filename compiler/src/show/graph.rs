//! `graph` as text: elements with their laws, bonds, parameters.

use super::{Shown, What, name, node, picture, table};
use crate::model::{BondId, Law, Variable};
use crate::units::DisplayUnit;
use std::fmt::Write;

/// Elements, bonds and parameters.
pub(super) fn text(shown: &Shown<'_>) -> String {
    let model = &*shown.model;
    let elements = || model.ids().filter(|(_, e)| !e.added);
    let drawn = model.bonds.iter().filter(|b| !node::hidden(model, b)).count();
    let mut text = format!("{}: {} elements, {drawn} bonds\n", model.name, elements().count());
    let rows: Vec<Vec<String>> = elements()
        .map(|(id, e)| {
            let bond = shown.graph.bonds_of[id.at()].first().copied();
            vec![name::element(model, e), name::law(shown, id), start(shown, id, bond), units(shown, bond)]
        })
        .collect();
    let _ = write!(text, "\nelements\n{}", table::lines(2, &rows));
    let _ = write!(text, "\nbonds\n{}", bonds(shown));
    let diagram = picture::diagram(shown, What::Graph);
    let signals: Vec<Vec<String>> = diagram
        .links
        .iter()
        .filter(|l| l.bonds.is_none())
        .map(|l| {
            let name = |i: usize| diagram.nodes[i].label();
            vec![name(l.tail), "-->".into(), name(l.head)]
        })
        .collect();
    if !signals.is_empty() {
        let _ = write!(text, "\nsignals\n{}", table::lines(2, &signals));
    }
    if !model.parameters.is_empty() {
        let _ = write!(text, "\nparameters\n{}", table::lines(2, &parameters(shown)));
    }
    text
}

/// Initial state of a storage.
fn start(shown: &Shown<'_>, id: crate::model::ElementId, bond: Option<BondId>) -> String {
    let Law::Storage(s) = &shown.model.element(id).law else { return String::new() };
    format!(
        "{} = {} at 0",
        shown.model.pool.name(s.state),
        name::quantity(s.initial, bond.and_then(|b| state_unit(shown, id, b)).as_ref())
    )
}

/// The unit of a storage's state.
pub(super) fn state_unit(shown: &Shown<'_>, id: crate::model::ElementId, bond: BondId) -> Option<DisplayUnit> {
    let c = shown.model.element(id).kind == crate::model::Kind::C;
    let rate = name::bond_unit(shown.model, bond, if c { Variable::Flow } else { Variable::Effort });
    rate.map(DisplayUnit::seconds)
}

/// The units of a bond, `N, m/s`.
fn units(shown: &Shown<'_>, bond: Option<BondId>) -> String {
    let Some(bond) = bond else { return String::new() };
    let unit = |v| name::bond_unit(shown.model, bond, v).map_or("?".to_string(), name::in_prose);
    format!("[{}, {}]", unit(Variable::Effort), unit(Variable::Flow))
}

/// The bonds, a line each, as they may be written: those of a bundle as one.
fn bonds(shown: &Shown<'_>) -> String {
    let model = &*shown.model;
    let nodes = node::all(model);
    let rows: Vec<Vec<String>> = node::links(model, &nodes)
        .iter()
        .map(|link| {
            let b = &model.bonds[link.bonds[0]];
            let (tail, head) = (model.element(b.tail), name::head(model, b));
            let ends = if link.bonds.len() > 1 {
                [tail, head].map(|e| {
                    let own = name::element(model, e);
                    own.strip_suffix(&e.name)
                        .map_or(own.clone(), |kind| kind.to_string() + &node::bundled(model, &e.name))
                })
            } else {
                [tail, head].map(|e| name::element(model, e))
            };
            let mut notes = Vec::new();
            if b.stroke.is_some() {
                notes.push("asserted".to_string());
            }
            if link.bonds.len() > 1 {
                notes.push(format!("{} bonds", link.bonds.len()));
            }
            let [tail, head] = ends;
            vec![tail, name::arrow(model, b, b.stroke), head, notes.join(", ")]
        })
        .collect();
    table::lines(2, &rows)
}

/// Name, value, unit.
pub(super) fn parameters(shown: &Shown<'_>) -> Vec<Vec<String>> {
    let all = &shown.model.parameters;
    all.iter().map(|p| vec![p.name.clone(), format!("= {}", name::quantity(p.value, p.unit.as_ref()))]).collect()
}
