//! The nodes of a picture: a field is one, whatever its ports; what the compiler added is none.

use super::name;
use crate::model::{Bond, Element, ElementId, Model};

/// Nodes in the order of their first elements.
pub(super) struct Nodes {
    /// The node of each element.
    pub(super) of: Vec<usize>,
    /// The first element of each node.
    pub(super) first: Vec<ElementId>,
}

/// The nodes of a model.
pub(super) fn nodes(model: &Model) -> Nodes {
    let mut nodes = Nodes { of: vec![0; model.elements.len()], first: Vec::new() };
    let mut of_field: Vec<Option<usize>> = vec![None; model.fields.len()];
    for (id, e) in model.ids().filter(|(_, e)| !e.added) {
        let known = e.field.and_then(|f| of_field[f.0]);
        nodes.of[id.at()] = known.unwrap_or(nodes.first.len());
        if known.is_none() {
            if let Some((f, _)) = e.field {
                of_field[f] = Some(nodes.first.len());
            }
            nodes.first.push(id);
        }
    }
    // A junction that was put into a bond counts as where the bond goes on to.
    let (within, leaves): (Vec<&Bond>, Vec<&Bond>) =
        model.bonds.iter().filter(|b| hidden(model, b)).partition(|b| !model.element(b.head).added);
    within.iter().for_each(|b| nodes.of[b.tail.at()] = nodes.of[b.head.at()]);
    leaves.iter().for_each(|b| nodes.of[b.head.at()] = nodes.of[b.tail.at()]);
    nodes
}

/// Whether a bond is not drawn: it leads to or from what the compiler added, and is not the first part of a bond that
/// this was put into.
pub(super) fn hidden(model: &Model, b: &Bond) -> bool {
    let head = model.element(b.head);
    model.element(b.tail).added || head.added && !head.kind.is_junction()
}

/// The kind and name of a node.
pub(super) fn title(model: &Model, e: &Element) -> (String, String) {
    match e.field {
        Some((f, _)) => (model.fields[f].kind.clone(), model.fields[f].name.clone()),
        None => (name::kind(e.kind).to_string(), e.name.clone()),
    }
}

/// What a bond is called in a picture: its name, else the port of the field where it ends.
pub(super) fn bond_name<'m>(model: &'m Model, b: &'m Bond) -> Option<&'m str> {
    let port = |id: ElementId| {
        let e = model.element(id);
        e.field.and_then(|_| e.name.rsplit_once('.')).map(|n| n.1)
    };
    name::own_name(model, b).or_else(|| port(b.head)).or_else(|| port(b.tail))
}
