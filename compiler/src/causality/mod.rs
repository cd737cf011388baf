//! Sequential assignment of causality (SCAP: Karnopp, Margolis, Rosenberg, System Dynamics).
//!
//! Order: sources and detectors, asserted strokes, one-way laws, sample-and-hold bonds and open ports, storages in
//! integral causality, laws that are explicit one way, resistors, and what is left. Each choice is propagated at once
//! through junctions, TF and GY. Everything runs in declaration order, and the cost is linear in the number of bonds. Of
//! storages that are tied together and very unequal, the large ones keep their states then.

mod complete;
mod conflict;
mod part;
mod propagate;
mod rank;
mod size;

use crate::expression::{Pool, Sign};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Resistor, Variable};
use bond_grammar::ast::Stroke;
use bond_grammar::diagnostic::Diagnostic;
use part::Parts;
pub use part::moves;
use propagate::Assignment;
pub use rank::{by_rank, has_rings, speeds};

/// So many asserted strokes are taken off one by one, to see which of them does it.
const MOST_TRIED: usize = 100;

/// So many pairs of a law that cannot be run backwards and a storage are looked at before the storages are assigned.
const LOOKED_AT: usize = 100_000;
/// More resistors than this, whose causality is free, are many.
const MANY: usize = 64;

/// Why a bond has its stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The element can do no other.
    Source(ElementId),
    /// The user asserted it.
    Asserted,
    /// The law of a resistor is explicit this way.
    Law(ElementId),
    /// A sample-and-hold bond or open port.
    Hold,
    /// A storage in integral causality.
    Storage(ElementId),
    /// Free to choose.
    Free,
    /// The rule of the element, given the stroke of another bond of it.
    Rule(ElementId, BondId),
}

/// The causal stroke of every bond. The end with the stroke receives the effort and gives the flow.
#[derive(Clone, Debug)]
pub struct Causality {
    /// By bond.
    pub strokes: Vec<Stroke>,
    /// By bond.
    pub causes: Vec<Cause>,
    /// Storages in derivative causality, in order of declaration.
    pub dependent: Vec<ElementId>,
    /// Resistors whose law runs the other way than causality asks for, so that it is solved.
    pub implicit: Vec<ElementId>,
}

impl Causality {
    /// Whether an end of a bond receives its effort.
    pub fn receives_effort(&self, model: &Model, bond: BondId, end: ElementId) -> bool {
        let b = model.bond(bond);
        match self.strokes[bond.at()] {
            Stroke::Head => b.head == end,
            Stroke::Tail => b.tail == end,
        }
    }

    /// What the element at an end gives to a bond.
    pub fn gives(&self, model: &Model, bond: BondId, end: ElementId) -> Variable {
        if self.receives_effort(model, bond, end) { Variable::Flow } else { Variable::Effort }
    }
}

/// What a 1-port element must give, whatever else.
fn forced(kind: Kind) -> Option<Variable> {
    match kind {
        Kind::Se | Kind::Df => Some(Variable::Effort),
        Kind::Sf | Kind::De => Some(Variable::Flow),
        Kind::C | Kind::I | Kind::R | Kind::Tf | Kind::Gy | Kind::Zero | Kind::One | Kind::Port => None,
    }
}

/// What a storage gives in integral causality.
pub fn integral(kind: Kind) -> Option<Variable> {
    match kind {
        Kind::C => Some(Variable::Effort),
        Kind::I => Some(Variable::Flow),
        Kind::Se
        | Kind::Sf
        | Kind::R
        | Kind::Tf
        | Kind::Gy
        | Kind::Zero
        | Kind::One
        | Kind::De
        | Kind::Df
        | Kind::Port => None,
    }
}

/// Whether a law cannot be run backwards: its slope is not seen to be positive everywhere.
fn one_way(pool: &mut Pool, r: &Resistor) -> bool {
    if r.curve.is_some() {
        return false; // solved along the curve either way
    }
    let slope = pool.derivative(r.output, r.argument);
    if matches!(pool.sign(slope, &|_| Sign::Unknown), Sign::Positive | Sign::Negative) {
        return false;
    }
    if pool.symbols(r.output).iter().any(|s| *s != r.argument) {
        // A linear law can be run backwards unless its coefficient vanishes, as that of a damper that is off does.
        let Some(k) = r.linear else { return true };
        let points = [0.37, -0.61, 2.3, -3.7, 41.0, -53.0];
        return points.iter().any(|x| pool.eval(k, &|s| x * (1.0 + 0.01 * f64::from(s.0 % 7))) == 0.0);
    }
    // Strictly monotone at every point that was tried will do: the solution is checked in each step.
    let points = [1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0, 1e3, 1e6];
    !points.iter().flat_map(|x| [*x, -*x]).all(|x| {
        let k = pool.eval(slope, &|_| x);
        k > 0.0 || k.is_nan() || (k == 0.0 && x.abs() > 1e2)
    })
}

/// Whether a storage's co-energy variable is linear in the states.
fn quadratic(pool: &mut Pool, law: &Law) -> bool {
    let Law::Storage(s) = law else { return false };
    let symbols = pool.symbols(s.energy);
    pool.affine(s.coenergy, &symbols).is_some_and(|(linear, _)| linear.iter().all(|t| pool.constant(t.1).is_some()))
}

/// The elements of some kinds that have one port, with their bonds.
fn one_ports(model: &Model, graph: &BondGraph, kinds: &[Kind]) -> Vec<(ElementId, BondId)> {
    model
        .ids()
        .filter(|(_, e)| kinds.contains(&e.kind))
        .filter_map(|(id, _)| graph.bonds_of[id.at()].first().map(|b| (id, *b)))
        .collect()
}

/// The law of a resistor.
fn law(model: &Model, id: ElementId) -> Option<&Resistor> {
    match &model.element(id).law {
        Law::Resistor(r) => Some(r),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => None,
    }
}

/// What is known of laws: which cannot be run backwards, which are of quadratic energies, and what moves what.
struct Laws {
    one_way: Vec<bool>,
    quadratic: Vec<bool>,
    parts: Parts,
}

/// Gives every bond its stroke, choice by choice; `thorough` takes only those that leave the rest a completion.
fn strokes<'a>(
    model: &'a Model,
    graph: &'a BondGraph,
    Laws { one_way, quadratic, parts }: &Laws,
    given: &[(ElementId, Variable)],
    thorough: bool,
) -> Result<Assignment<'a>, Vec<Diagnostic>> {
    let mut a = Assignment::new(model, graph);
    a.thorough = thorough;
    let mut errors = Vec::new();
    let mut seen: Vec<Vec<String>> = Vec::new();
    let one_ports = |kinds: &[Kind]| one_ports(model, graph, kinds);
    for (id, bond) in one_ports(&[Kind::Se, Kind::Sf, Kind::De, Kind::Df]) {
        let Some(gives) = forced(model.element(id).kind) else { continue };
        if let Err(c) = a.attempt(bond, a.stroke_for(bond, id, gives), Cause::Source(id))
            && !seen.contains(&c.causes())
        {
            seen.push(c.causes());
            errors.push(c.diagnose(&a));
        }
    }
    for (i, bond) in model.bonds.iter().enumerate() {
        let Some(stroke) = bond.stroke else { continue };
        if let Err(c) = a.attempt(BondId(i as u32), stroke, Cause::Asserted) {
            errors.push(c.diagnose(&a));
        }
    }
    for &(id, gives) in given {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let cause = if integral(model.element(id).kind).is_some() { Cause::Storage(id) } else { Cause::Free };
        if let Err(c) = a.attempt(bond, a.stroke_for(bond, id, gives), cause) {
            errors.push(c.diagnose(&a));
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let resistors = one_ports(&[Kind::R]);
    let storages = one_ports(&[Kind::C, Kind::I]);
    let few = one_way.iter().filter(|one| **one).count() * storages.len() <= LOOKED_AT;
    for &(id, bond) in resistors.iter().filter(|(id, _)| one_way[id.at()]) {
        if let Some(r) = law(model, id) {
            let wanted = a.stroke_for(bond, id, r.gives);
            // A law that would leave a storage without integral causality is rather solved the other way.
            let mark = a.mark();
            let mut fits = a.attempt(bond, wanted, Cause::Law(id)).is_ok() && !a.costs_storage(mark);
            let may_turn = r.curve.is_none() && model.element(id).field.is_none();
            let other = a.stroke_for(bond, id, r.gives.other());
            if fits && may_turn && few {
                // It may show only once the storages are assigned, as of two tanks with a valve between.
                let lost = a.lost(&storages);
                a.undo(mark);
                fits = lost == 0 || a.attempt(bond, other, Cause::Law(id)).is_err() || lost <= a.lost(&storages);
                a.undo(mark);
                fits = fits && a.attempt(bond, wanted, Cause::Law(id)).is_ok();
            }
            if !fits && may_turn {
                a.undo(mark);
                a.prefer(bond, other, Cause::Law(id));
            } else if !fits {
                a.undo(mark);
                a.prefer(bond, wanted, Cause::Law(id));
            }
        }
    }
    let keeps = |id: ElementId| match &model.element(id).law {
        Law::Storage(s) => {
            !s.massless && s.linear.is_none() && model.element(id).field.is_none_or(|_| !quadratic[id.at()])
        }
        Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => false,
    };
    for (i, bond) in model.bonds.iter().enumerate() {
        let id = BondId(i as u32);
        if bond.sampled && a.strokes[i].is_none() {
            let holder = holder(model, id);
            choose(&mut a, model, &storages, id, holder);
        }
    }
    for (id, bond) in one_ports(&[Kind::Port]) {
        // The outside of an open port is met as a moving thing: it takes an effort and shows a flow.
        if a.strokes[bond.at()].is_none() {
            choose(&mut a, model, &storages, bond, model.bond(bond).other(id));
        }
    }
    // Of storages that are tied together, those with quadratic energies can best be the dependent ones; those of which
    // a ratio reads the state have to keep it. Of the rest, what moves others through ratios that change goes before
    // these: from their speeds it does not follow where such a ratio passes 0.
    let mut order = storages.clone();
    order.sort_by_key(|s| if keeps(s.0) { None } else { Some(parts.turn(model, s.0)) });
    for (id, bond) in order {
        if let Some(gives) = integral(model.element(id).kind) {
            a.prefer(bond, a.stroke_for(bond, id, gives), Cause::Storage(id));
        }
    }
    let free = resistors.iter().filter(|(_, bond)| a.strokes[bond.at()].is_none()).count();
    let vanishes = model.ids().any(|(id, _)| part::changes(model, id).is_some());
    for linear in [false, true] {
        for &(id, bond) in &resistors {
            let Some(r) = law(model, id).filter(|r| r.linear.is_some() == linear) else { continue };
            // What a curve has at rest is 0 itself, and not the difference of what stands beside it, where it gives its
            // junction what all there have in common. Of many resistors without storages between them, as the cells of
            // an attenuator, each equation then has its neighbours in it, and not all that stand before it.
            let turns = r.linear.map_or(!one_way[id.at()], |k| model.pool.constant(k) != Some(0.0));
            let common = r.curve.is_some() || free > MANY && turns;
            let gives = match model.element(model.bond(bond).other(id)).kind {
                Kind::One if common => Variable::Flow,
                Kind::Zero if common => Variable::Effort,
                _ => r.gives,
            };
            let cause = if linear { Cause::Free } else { Cause::Law(id) };
            let open = vanishes && a.strokes[bond.at()].is_none();
            // One law or the other is solved: rather the one for which nothing is divided by a ratio that may be 0. A curve,
            // as of a diode, is not turned for that.
            let mark = a.mark();
            let mut whole = |gives, turned| {
                let fits = a.attempt(bond, a.stroke_for(bond, id, gives), cause).is_ok()
                    && !a.divides(mark)
                    && !(turned && a.turns_curve(mark));
                a.undo(mark);
                fits
            };
            let turned = open && !whole(gives, false) && whole(gives.other(), true);
            let gives = if turned { gives.other() } else { gives };
            a.prefer(bond, a.stroke_for(bond, id, gives), cause);
        }
    }
    for i in 0..model.bonds.len() {
        if a.strokes[i].is_none() {
            a.prefer(BondId(i as u32), Stroke::Head, Cause::Free);
        }
    }
    errors.extend(a.undetermined());
    if !errors.is_empty() {
        return Err(errors);
    }
    Ok(a)
}

/// Assigns causality to every bond; these storages and resistors give what is said (see [`by_rank`]).
///
/// # Errors
/// Conflicts, with the chain of bonds, and junctions that nothing determines.
pub fn assign(
    model: &mut Model,
    graph: &BondGraph,
    given: &[(ElementId, Variable)],
) -> Result<Causality, Vec<Diagnostic>> {
    let mut pool = std::mem::take(&mut model.pool);
    let one_way: Vec<bool> =
        model.elements.iter().map(|e| matches!(&e.law, Law::Resistor(r) if one_way(&mut pool, r))).collect();
    let quadratic: Vec<bool> = model.elements.iter().map(|e| quadratic(&mut pool, &e.law)).collect();
    model.pool = pool;
    let model = &*model;
    let laws = Laws { one_way, quadratic, parts: Parts::of(model, graph) };
    let first = assigned(model, graph, &laws, given)?;
    Ok(size::by_size(model, graph, &laws, given, first))
}

/// Assigns causality, in the order of declaration.
fn assigned(
    model: &Model,
    graph: &BondGraph,
    laws: &Laws,
    given: &[(ElementId, Variable)],
) -> Result<Causality, Vec<Diagnostic>> {
    // A choice shows only later that it cannot be completed where junctions stand in rings: then each is looked at more
    // closely.
    let a = strokes(model, graph, laws, given, false)
        .or_else(|errors| strokes(model, graph, laws, given, true).map_err(|_| errors))?;
    let one_ports = |kinds: &[Kind]| one_ports(model, graph, kinds);
    let (resistors, storages) = (one_ports(&[Kind::R]), one_ports(&[Kind::C, Kind::I]));
    let given = |a: &Assignment, id: ElementId, bond: BondId, gives: Variable| {
        a.strokes[bond.at()] == Some(a.stroke_for(bond, id, gives))
    };
    let dependent = storages
        .iter()
        .filter(|(id, bond)| integral(model.element(*id).kind).is_some_and(|g| !given(&a, *id, *bond, g)))
        .map(|s| s.0)
        .collect();
    let implicit = resistors
        .iter()
        .filter(|(id, bond)| law(model, *id).is_some_and(|r| r.linear.is_none() && !given(&a, *id, *bond, r.gives)))
        .map(|s| s.0)
        .collect();
    let strokes = a.strokes.iter().map(|s| s.unwrap_or(Stroke::Head)).collect();
    Ok(Causality { strokes, causes: a.causes, dependent, implicit })
}

/// The asserted strokes without which a dependent storage would not be one: the first that does it alone, or all of
/// them; none where it would be one all the same.
pub fn holding(model: &Model, graph: &BondGraph, storage: ElementId) -> Vec<BondId> {
    let asserted: Vec<BondId> =
        (0..model.bonds.len() as u32).map(BondId).filter(|b| model.bond(*b).stroke.is_some()).collect();
    let free = |without: &[BondId]| {
        let mut model = model.clone();
        for b in without {
            model.bonds[b.at()].stroke = None;
        }
        assign(&mut model, graph, &[]).is_ok_and(|c| !c.dependent.contains(&storage))
    };
    if asserted.is_empty() || !free(&asserted) {
        return Vec::new();
    }
    let alone = asserted.iter().take(MOST_TRIED).find(|b| free(&[**b]));
    alone.map_or(asserted.clone(), |b| vec![*b])
}

/// The end of a double bar that holds its variable: the sampled one; of two, the slower; of two alike, the head.
pub fn holder(model: &Model, bond: BondId) -> ElementId {
    let b = model.bond(bond);
    let period = |id: ElementId| model.element(id).sampling.map_or(0.0, |s| model.samplings[s].period);
    if period(b.tail) > period(b.head) { b.tail } else { b.head }
}

/// Settles a double bar: the holder gives effort, unless fewer storages are dependent when it gives flow.
fn choose(a: &mut Assignment, model: &Model, storages: &[(ElementId, BondId)], bond: BondId, holder: ElementId) {
    let mut best: Option<(usize, Stroke)> = None;
    for gives in [Variable::Effort, Variable::Flow] {
        let stroke = a.stroke_for(bond, holder, gives);
        let mark = a.mark();
        if a.attempt(bond, stroke, Cause::Hold).is_ok() {
            let mut lost = 0;
            for &(id, b) in storages {
                let Some(gives) = integral(model.element(id).kind) else { continue };
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
