//! Strokes, choice by choice: what comes first leaves the rest less freedom.

use super::assignment::Assignment;
use super::laws::{Laws, law};
use super::{Cause, OPTIONS, holder, modulation, one_ports};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Variable};
use bond_grammar::ast::Stroke;
use bond_grammar::diagnostic::Diagnostic;

/// Gives every bond its stroke. These storages and resistors give what is said; a thorough search takes only choices
/// that leave the rest a completion.
pub(super) fn strokes<'a>(
    model: &'a Model,
    graph: &'a BondGraph,
    laws: &Laws,
    given: &[(ElementId, Variable)],
    thorough: bool,
) -> Result<Assignment<'a>, Vec<Diagnostic>> {
    let mut a = Assignment::new(model, graph);
    a.thorough = thorough;
    required(&mut a, given)?;
    let storages = one_ports(model, graph, &Kind::is_storage);
    one_way_laws(&mut a, laws, &storages);
    holds_and_ports(&mut a, &storages);
    integral_causality(&mut a, laws, &storages);
    resistors(&mut a, laws);
    for i in 0..model.bonds.len() {
        if a.strokes[i].is_none() {
            a.prefer(BondId(i as u32), Stroke::Head, Cause::Free);
        }
    }
    let errors = a.undetermined();
    if errors.is_empty() { Ok(a) } else { Err(errors) }
}

/// What leaves no choice: sources and detectors, asserted strokes, and what is given.
fn required(a: &mut Assignment<'_>, given: &[(ElementId, Variable)]) -> Result<(), Vec<Diagnostic>> {
    let (model, graph) = (a.model, a.graph);
    let mut errors = Vec::new();
    let mut seen: Vec<Vec<String>> = Vec::new();
    for (id, bond) in one_ports(model, graph, &|kind| kind.forced().is_some()) {
        let Some(gives) = model.element(id).kind.forced() else { continue };
        if let Err(c) = a.attempt(bond, a.stroke_for(bond, id, gives), Cause::Source(id))
            && !seen.contains(&c.causes())
        {
            seen.push(c.causes());
            errors.push(c.diagnose(a));
        }
    }
    for (i, bond) in model.bonds.iter().enumerate() {
        let Some(stroke) = bond.stroke else { continue };
        if let Err(c) = a.attempt(BondId(i as u32), stroke, Cause::Asserted) {
            errors.push(c.diagnose(a));
        }
    }
    for &(id, gives) in given {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let cause = if model.element(id).kind.integral().is_some() { Cause::Storage(id) } else { Cause::Free };
        if let Err(c) = a.attempt(bond, a.stroke_for(bond, id, gives), cause) {
            errors.push(c.diagnose(a));
        }
    }
    if errors.is_empty() { Ok(()) } else { Err(errors) }
}

/// Laws that cannot be run backwards. One that would leave a storage without integral causality is rather solved the
/// other way.
fn one_way_laws(a: &mut Assignment<'_>, laws: &Laws, storages: &[(ElementId, BondId)]) {
    let model = a.model;
    let few = laws.one_way.iter().filter(|one| **one).count() * storages.len() <= OPTIONS.pairs;
    for (id, bond) in one_ports(model, a.graph, &|kind| kind == Kind::R) {
        let Some(r) = law(model, id).filter(|_| laws.one_way[id.at()]) else { continue };
        let wanted = a.stroke_for(bond, id, r.gives);
        let mark = a.mark();
        let mut fits = a.attempt(bond, wanted, Cause::Law(id)).is_ok() && !a.costs_storage(mark);
        let may_turn = r.curve.is_none() && model.element(id).field.is_none();
        let other = a.stroke_for(bond, id, r.gives.other());
        if fits && may_turn && few {
            // It may show only once the storages are assigned, as of two tanks with a valve between.
            let lost = a.lost(storages);
            a.undo(mark);
            fits = lost == 0 || a.attempt(bond, other, Cause::Law(id)).is_err() || lost <= a.lost(storages);
            a.undo(mark);
            fits = fits && a.attempt(bond, wanted, Cause::Law(id)).is_ok();
        }
        if !fits {
            a.undo(mark);
            a.prefer(bond, if may_turn { other } else { wanted }, Cause::Law(id));
        }
    }
}

/// Double bars and open ports.
fn holds_and_ports(a: &mut Assignment<'_>, storages: &[(ElementId, BondId)]) {
    let model = a.model;
    for (i, bond) in model.bonds.iter().enumerate() {
        let id = BondId(i as u32);
        if bond.sampled && a.strokes[i].is_none() {
            choose(a, storages, id, holder(model, id));
        }
    }
    for (id, bond) in one_ports(model, a.graph, &|kind| kind == Kind::PORT) {
        // The outside of an open port is met as a moving thing: it takes an effort and shows a flow.
        if a.strokes[bond.at()].is_none() {
            choose(a, storages, bond, model.bond(bond).other(id));
        }
    }
}

/// Storages. Of those that depend on one another, the ones with quadratic energies can best be dependent; those of
/// which a ratio reads the state have to keep it. Of the rest, what moves others through ratios that change goes before
/// these: from their speeds it does not follow where such a ratio passes 0.
fn integral_causality(a: &mut Assignment<'_>, laws: &Laws, storages: &[(ElementId, BondId)]) {
    let model = a.model;
    let keeps = |id: ElementId| match &model.element(id).law {
        Law::Storage(s) => {
            !s.massless && s.linear.is_none() && model.element(id).field.is_none_or(|_| !laws.quadratic[id.at()])
        }
        Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => false,
    };
    let mut order = storages.to_vec();
    order.sort_by_key(|s| if keeps(s.0) { None } else { Some(laws.parts.turn(model, s.0)) });
    for (id, bond) in order {
        if let Some(gives) = model.element(id).kind.integral() {
            a.prefer(bond, a.stroke_for(bond, id, gives), Cause::Storage(id));
        }
    }
}

/// Resistors: first those whose law is explicit one way, then linear ones.
fn resistors(a: &mut Assignment<'_>, laws: &Laws) {
    let model = a.model;
    let resistors = one_ports(model, a.graph, &|kind| kind == Kind::R);
    let free = resistors.iter().filter(|(_, bond)| a.strokes[bond.at()].is_none()).count();
    let vanishes = model.ids().any(|(id, _)| modulation::changes(model, id).is_some());
    for linear in [false, true] {
        for &(id, bond) in &resistors {
            let Some(r) = law(model, id).filter(|r| r.linear.is_some() == linear) else { continue };
            // What a curve has at rest is 0 itself, and not the difference of what stands beside it, where it gives its
            // junction what all there have in common. Of many resistors without storages between them, as the cells of
            // an attenuator, each equation then has its neighbours in it, and not all that stand before it.
            let turns = r.linear.map_or(!laws.one_way[id.at()], |k| model.pool.constant(k) != Some(0.0));
            let common = r.curve.is_some() || free > OPTIONS.resistors && turns;
            let gives = match model.element(model.bond(bond).other(id)).kind {
                Kind::Junction(shared) if common => shared,
                _ => r.gives,
            };
            let cause = if linear { Cause::Free } else { Cause::Law(id) };
            let undetermined = vanishes && a.strokes[bond.at()].is_none();
            // One law or the other is solved: rather the one for which nothing is divided by a ratio that may be 0. A
            // curve, as of a diode, is not turned for that.
            let mark = a.mark();
            let mut whole = |gives, turned| {
                let fits = a.attempt(bond, a.stroke_for(bond, id, gives), cause).is_ok()
                    && !a.divides(mark)
                    && !(turned && a.turns_curve(mark));
                a.undo(mark);
                fits
            };
            let turned = undetermined && !whole(gives, false) && whole(gives.other(), true);
            let gives = if turned { gives.other() } else { gives };
            a.prefer(bond, a.stroke_for(bond, id, gives), cause);
        }
    }
}

/// Settles a double bar: the holder gives effort, unless fewer storages are dependent when it gives flow.
fn choose(a: &mut Assignment<'_>, storages: &[(ElementId, BondId)], bond: BondId, holder: ElementId) {
    let model = a.model;
    let mut best: Option<(usize, Stroke)> = None;
    for gives in [Variable::Effort, Variable::Flow] {
        let stroke = a.stroke_for(bond, holder, gives);
        let mark = a.mark();
        if a.attempt(bond, stroke, Cause::Hold).is_ok() {
            let mut lost = 0;
            for &(id, b) in storages {
                let Some(gives) = model.element(id).kind.integral() else { continue };
                let wanted = a.stroke_for(b, id, gives);
                a.prefer(b, wanted, Cause::Storage(id));
                lost += usize::from(a.strokes[b.at()] != Some(wanted));
            }
            if best.is_none_or(|(n, _)| lost < n) {
                best = Some((lost, stroke));
            }
        }
        a.undo(mark);
        if best.is_some_and(|(n, _)| n == 0) {
            break;
        }
    }
    if let Some((_, stroke)) = best {
        a.prefer(bond, stroke, Cause::Hold);
    }
}
