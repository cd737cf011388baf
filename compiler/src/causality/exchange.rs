//! Which of several dependent storages keep their states: small storages follow large ones.

use super::laws::Laws;
use super::{Causality, OPTIONS, assigned};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Variable};
use rustc_hash::FxHashMap;

/// Large storages keep their states. A dependent storage takes the place of one that is smaller by
/// [`Options::smaller`](super::Options), where that makes no other storage dependent: the state of a large storage,
/// found as a difference from the states of small ones, has as many digits less as they are unequal (a node of 200 pF
/// beside 47 uF: five). Of two storages alone, as a motor's rotor and its load, no state is a difference, and the one
/// that was declared first keeps its state. Sizes are compared where constant ratios lead from one storage to the
/// other, each as one flow, or effort, sees it.
pub(super) fn larger_keep_states(
    model: &Model,
    graph: &BondGraph,
    laws: &Laws,
    given: &[(ElementId, Variable)],
    first: Causality,
) -> Causality {
    let size = |id: ElementId| match &model.element(id).law {
        Law::Storage(s) if !s.massless && model.element(id).field.is_none() => {
            s.linear.and_then(|k| model.pool.constant(k)).map(|k| 1.0 / k)
        }
        Law::Storage(_)
        | Law::Source(_)
        | Law::Resistor(_)
        | Law::Ratio(_)
        | Law::Junction
        | Law::Port(_)
        | Law::Multiplier => None,
    };
    let mut best = first;
    let mut given = given.to_vec();
    for id in best.dependent.clone().into_iter().take(OPTIONS.swapped) {
        let (Some(large), Some(gives)) = (size(id), model.element(id).kind.integral()) else { continue };
        if !best.dependent.contains(&id) {
            continue;
        }
        let alike = alike(model, graph, id, gives);
        let is_small = |other: ElementId| {
            let seen = size(other).zip(alike.get(&other)).map(|(x, ratio)| x * ratio * ratio);
            seen.is_some_and(|x| x < OPTIONS.smaller * large)
        };
        if !alike.keys().any(|other| is_small(*other)) {
            continue;
        }
        given.push((id, gives));
        let most = best.dependent.len();
        let attempt = |given: &[(ElementId, Variable)]| {
            assigned(model, graph, laws, given).ok().filter(|c| c.dependent.len() <= most)
        };
        let found = attempt(&given).filter(|c| {
            let fresh: Vec<ElementId> = c.dependent.iter().filter(|d| !best.dependent.contains(d)).copied().collect();
            let third = || attempt(&[&given[..], &fresh.iter().map(|d| (*d, gives)).collect::<Vec<_>>()].concat());
            !c.dependent.contains(&id) && fresh.iter().all(|d| is_small(*d)) && third().is_some()
        });
        match found {
            Some(found) => best = found,
            None => _ = given.pop(),
        }
    }
    best
}

/// The storages of its kind to which junctions and constant ratios lead from a storage, and by how much the variable
/// that each of them gives is its own.
fn alike(model: &Model, graph: &BondGraph, id: ElementId, gives: Variable) -> FxHashMap<ElementId, f64> {
    let mut found = FxHashMap::default();
    let mut seen = vec![false; model.elements.len()];
    let mut to_follow: Vec<(ElementId, BondId, Variable, f64)> =
        graph.bonds_of[id.at()].iter().map(|b| (model.bond(*b).other(id), *b, gives, 1.0)).collect();
    seen[id.at()] = true;
    while let Some((at, from, variable, x)) = to_follow.pop() {
        if std::mem::replace(&mut seen[at.at()], true) || model.bond(from).sampled {
            continue;
        }
        let e = model.element(at);
        let (variable, x) = match &e.law {
            Law::Junction => (variable, x),
            Law::Ratio(v) => {
                let Some(ratio) = model.pool.constant(*v).filter(|v| *v != 0.0) else { continue };
                // Of the flow at the tail a TF makes that at the head by its ratio, of efforts the other way round.
                let times = match (e.kind, variable) {
                    (Kind::TF, Variable::Flow) => model.bond(from).head == at,
                    (Kind::TF, Variable::Effort) => model.bond(from).tail == at,
                    (_, Variable::Flow) => true,
                    (_, Variable::Effort) => false,
                };
                let other = if e.kind == Kind::GY { variable.other() } else { variable };
                (other, if times { x * ratio } else { x / ratio })
            }
            Law::Storage(_) | Law::Source(_) | Law::Resistor(_) | Law::Port(_) | Law::Multiplier => {
                if e.kind == model.element(id).kind && e.kind.integral() == Some(variable) {
                    found.insert(at, x);
                }
                continue;
            }
        };
        let bonds = graph.bonds_of[at.at()].iter().filter(|b| **b != from);
        to_follow.extend(bonds.map(|b| (model.bond(*b).other(at), *b, variable, x)));
    }
    found
}
