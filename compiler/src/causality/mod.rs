//! Sequential assignment of causality (SCAP: Karnopp, Margolis, Rosenberg, System Dynamics).
//!
//! Order: sources and detectors, asserted strokes, one-way laws, sample-and-hold bonds and open ports, storages in
//! integral causality, laws that are explicit one way, resistors, and what is left. Each choice is propagated at once
//! through junctions, TF and GY. Everything runs in declaration order, and the cost is linear in the number of bonds.
//! Of storages that depend on one another and are very unequal, the large ones keep their states.

mod analysis;
mod assignment;
mod conflict;
mod echelon;
mod exchange;
mod junction;
mod laws;
mod matching;
mod modulation;
mod multipliers;
mod propagate;
mod strokes;
mod structural_rank;

use crate::graph::{self, BondGraph};
use crate::model::{BondId, ElementId, Kind, Model, Variable};
use analysis::Facts;
use assignment::Assignment;
use bond_grammar::ast::Stroke;
use bond_grammar::diagnostic::Diagnostic;
pub(crate) use echelon::Echelon;
pub(crate) use junction::{Given, Undetermined, combine, rows};
use laws::{Laws, law};
pub(crate) use modulation::moves;
use strokes::strokes;

/// Bounds on the work of the assignment, and what counts as small.
struct Options {
    /// Asserted strokes that are taken off one by one to see which of them contradicts the others.
    asserted: usize,
    /// Pairs of a law that cannot be run backwards and a storage that are looked at before the storages are assigned.
    pairs: usize,
    /// Resistors with free causality beyond which each takes the direction that keeps equations short.
    resistors: usize,
    /// Dependent storages that may change places with larger ones.
    swapped: usize,
    /// The size, as a part of another storage's, below which a storage follows that one.
    smaller: f64,
    /// Bonds of a model whose rank is determined.
    ranked_bonds: usize,
    /// The part of the largest coefficient of an equation that is rounding.
    rounding: f64,
}

const OPTIONS: Options = Options {
    asserted: 100,
    pairs: 100_000,
    resistors: 64,
    swapped: 16,
    smaller: 1e-4,
    ranked_bonds: 5000,
    rounding: 1e-9,
};

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

/// The elements of some kinds that have one port, with their bonds.
fn one_ports(model: &Model, graph: &BondGraph, wanted: &dyn Fn(Kind) -> bool) -> Vec<(ElementId, BondId)> {
    model
        .ids()
        .filter(|(_, e)| wanted(e.kind))
        .filter_map(|(id, _)| graph.bonds_of[id.at()].first().map(|b| (id, *b)))
        .collect()
}

/// Assigns causality to every bond. Junctions that need speeds of their own get massless inertias before that, and bars
/// that make a loop get multipliers, so that the graph is another one then.
///
/// # Errors
/// Conflicts, with the chain of bonds, and junctions that nothing determines.
pub fn assign(model: &mut Model, graph: BondGraph) -> Result<(BondGraph, Causality), Vec<Diagnostic>> {
    let causality = match strokes_and_rank(model, &graph) {
        Ok(causality) => causality,
        Err(errors) => return tie_all(model, graph).ok_or(errors),
    };
    if !modulation::moves(model) || causality.dependent.is_empty() {
        return Ok((graph, causality));
    }
    let laws = Laws::of(model, &graph);
    let facts = Facts::of(model, &graph, &laws, &causality);
    if !facts.looped.is_empty() {
        return tie(model, graph, &causality, &facts.looped);
    }
    let is_inertia = |d: &ElementId| model.element(*d).kind == Kind::I;
    if facts.mergeable && !facts.divided || !causality.dependent.iter().any(is_inertia) {
        return Ok((graph, causality));
    }
    let speeds = structural_rank::speeds(model, &graph, &causality);
    if speeds.is_empty() {
        return Ok((graph, causality));
    }
    speeds.iter().for_each(|junction| model.add_massless(*junction));
    let graph = graph::build(model);
    let causality = strokes_and_rank(model, &graph)?;
    Ok((graph, causality))
}

/// Has all storages keep their states, in a model with ratios that change with states for which no strokes were found.
/// Strokes count equations: where constraints say the same, a source drives more equations than there are unknowns, by
/// that count. With a multiplier for each constraint there is an unknown for each equation. None if that fails too.
fn tie_all(model: &mut Model, graph: BondGraph) -> Option<(BondGraph, Causality)> {
    let has_borders = model.bonds.iter().any(|b| b.sampled || b.stroke.is_some());
    if !modulation::moves(model) || has_borders || !one_ports(model, &graph, &|kind| kind == Kind::PORT).is_empty() {
        return None;
    }
    let storages: Vec<ElementId> = one_ports(model, &graph, &Kind::is_storage).into_iter().map(|s| s.0).collect();
    let n = model.bonds.len();
    let none = Causality {
        strokes: vec![Stroke::Head; n],
        causes: vec![Cause::Free; n],
        dependent: Vec::new(),
        implicit: Vec::new(),
    };
    let mut tied = model.clone();
    let found = tie(&mut tied, graph, &none, &storages).ok()?;
    *model = tied;
    Some(found)
}

/// Has storages that depend on one another all keep their states: what they would follow one another by is held by
/// multipliers.
///
/// # Errors
/// As [`assign`].
pub fn tie(
    model: &mut Model,
    graph: BondGraph,
    causality: &Causality,
    tied: &[ElementId],
) -> Result<(BondGraph, Causality), Vec<Diagnostic>> {
    let additions = multipliers::additions(model, &graph, causality, tied);
    additions.speeds.iter().for_each(|junction| model.add_massless(*junction));
    additions.multipliers.iter().for_each(|(bond, both)| model.add_multiplier(*bond, *both));
    let graph = graph::build(model);
    let causality = strokes_and_rank(model, &graph)?;
    Ok((graph, causality))
}

/// Assigns causality. Where junctions stand in rings, strokes may make independent variables depend on one another, or
/// leave dependent ones independent: then what elements give is found by structural rank.
fn strokes_and_rank(model: &mut Model, graph: &BondGraph) -> Result<Causality, Vec<Diagnostic>> {
    let laws = Laws::of(model, graph);
    let first = with_given(model, graph, &laws, &[])?;
    let facts = |model: &Model, causality: &Causality| Facts::of(model, graph, &laws, causality);
    if !structural_rank::has_rings(model, graph) || facts(model, &first).mergeable {
        return Ok(first);
    }
    let second = structural_rank::by_rank(model, graph, &first)
        .and_then(|given| with_given(model, graph, &laws, &given).ok())
        .filter(|second| facts(model, second).determined);
    Ok(second.unwrap_or(first))
}

/// Assigns causality; these storages and resistors give what is said. Large storages keep their states.
fn with_given(
    model: &Model,
    graph: &BondGraph,
    laws: &Laws,
    given: &[(ElementId, Variable)],
) -> Result<Causality, Vec<Diagnostic>> {
    let first = assigned(model, graph, laws, given)?;
    Ok(exchange::larger_keep_states(model, graph, laws, given, first))
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
    let one_ports = |wanted: &dyn Fn(Kind) -> bool| one_ports(model, graph, wanted);
    let (resistors, storages) = (one_ports(&|kind| kind == Kind::R), one_ports(&Kind::is_storage));
    let given = |a: &Assignment, id: ElementId, bond: BondId, gives: Variable| {
        a.strokes[bond.at()] == Some(a.stroke_for(bond, id, gives))
    };
    let dependent = storages
        .iter()
        .filter(|(id, bond)| model.element(*id).kind.integral().is_some_and(|g| !given(&a, *id, *bond, g)))
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
        let laws = Laws::of(&mut model, graph);
        with_given(&model, graph, &laws, &[]).is_ok_and(|c| !c.dependent.contains(&storage))
    };
    if asserted.is_empty() || !free(&asserted) {
        return Vec::new();
    }
    let alone = asserted.iter().take(OPTIONS.asserted).find(|b| free(&[**b]));
    alone.map_or(asserted.clone(), |b| vec![*b])
}

/// The end of a double bar that holds its variable: the sampled one; of two, the slower; of two alike, the head.
pub fn holder(model: &Model, bond: BondId) -> ElementId {
    let b = model.bond(bond);
    let period = |id: ElementId| model.element(id).sampling.map_or(0.0, |s| model.samplings[s].period);
    if period(b.tail) > period(b.head) { b.tail } else { b.head }
}
