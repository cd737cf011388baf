//! `graph` as text: elements with their laws, bonds, parameters.

use super::{Shown, name, node, table};
use crate::model::{BondId, Law, Variable};
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
            vec![name::element(e), name::law(shown, id), start(shown, id, bond), units(shown, bond)]
        })
        .collect();
    let _ = write!(text, "\nelements\n{}", table::lines(2, &rows));
    let _ = write!(text, "\nbonds\n{}", bonds(shown));
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
        name::quantity(s.initial, bond.and_then(|b| state_unit(shown, id, b)))
    )
}

/// The unit of a storage's state.
pub(super) fn state_unit(
    shown: &Shown<'_>,
    id: crate::model::ElementId,
    bond: BondId,
) -> Option<crate::units::Dimension> {
    let c = shown.model.element(id).kind == crate::model::Kind::C;
    let rate = name::bond_unit(shown.model, bond, if c { Variable::Flow } else { Variable::Effort });
    rate.map(|u| u.mul(crate::units::Dimension::SECOND))
}

/// The units of a bond, `N, m/s`.
fn units(shown: &Shown<'_>, bond: Option<BondId>) -> String {
    let Some(bond) = bond else { return String::new() };
    let unit = |v| name::bond_unit(shown.model, bond, v).map_or("?".to_string(), |u| u.to_string());
    format!("[{}, {}]", unit(Variable::Effort), unit(Variable::Flow))
}

/// The bonds, a line each, as they may be written.
fn bonds(shown: &Shown<'_>) -> String {
    let model = &*shown.model;
    let rows: Vec<Vec<String>> = model
        .bonds
        .iter()
        .filter(|b| !node::hidden(model, b))
        .map(|b| {
            let ends = (name::element(model.element(b.tail)), name::element(name::head(model, b)));
            let note = if b.stroke.is_some() { "asserted" } else { "" };
            vec![ends.0, name::arrow(model, b, b.stroke), ends.1, note.to_string()]
        })
        .collect();
    table::lines(2, &rows)
}

/// Name, value, unit.
pub(super) fn parameters(shown: &Shown<'_>) -> Vec<Vec<String>> {
    let all = &shown.model.parameters;
    all.iter().map(|p| vec![p.name.clone(), format!("= {}", name::quantity(p.value, p.unit))]).collect()
}
