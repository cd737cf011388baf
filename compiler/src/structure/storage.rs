//! Storages as columns: their laws, the fields that they are ports of, their stiffness.

use super::{ColumnId, Form, Role};
use crate::expression::Expr;
use crate::model::{ElementId, Law, Model, Storage};

/// The law of a storage.
pub(super) fn storage(model: &Model, id: ElementId) -> Option<&Storage> {
    match &model.element(id).law {
        Law::Storage(s) => Some(s),
        Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => None,
    }
}

/// The columns of a role, in order.
pub(super) fn ids(form: &Form, role: Role) -> Vec<ColumnId> {
    (0..form.columns.len() as u32).map(ColumnId).filter(|c| form.column(*c).role == role).collect()
}

/// The columns of the field that a storage is a port of; itself alone where it is none.
pub(super) fn family(model: &Model, form: &Form, id: ColumnId) -> Vec<ColumnId> {
    let Some((f, _)) = model.element(form.column(id).element).field else { return vec![id] };
    model.fields[f].members.iter().filter_map(|m| form.column_of_element[m.at()]).collect()
}

/// The second derivatives of a storage's energy with the states of its family, where they are numbers.
pub(super) fn stiffness(model: &mut Model, form: &Form, id: ColumnId) -> Option<Vec<(ColumnId, Expr)>> {
    let found = storage(model, form.column(id).element)?;
    let coenergy = found.coenergy;
    let mut row = Vec::new();
    if found.massless {
        return Some(row);
    }
    let mut rest = coenergy;
    for c in family(model, form, id) {
        let state = storage(model, form.column(c).element)?.state;
        let (k, other) = model.pool.linear(rest, state)?;
        model.pool.constant(k)?;
        rest = other;
        row.push((c, k));
    }
    // A storage without energy has no stiffness to invert.
    let own = row.iter().find(|t| t.0 == id).map(|t| t.1)?;
    (model.pool.is_zero(rest) && !model.pool.is_zero(own)).then_some(row)
}
