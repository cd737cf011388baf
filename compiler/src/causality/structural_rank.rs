//! What elements give, found by structural rank. Where junctions stand in rings, strokes alone do not show which
//! variables depend on one another.
//!
//! What junctions, TF and GY ask of efforts and flows is a set of linear equations. Elements choose in the order of
//! SCAP: each gives its preferred variable unless that follows, by these equations, from what was given before it, and
//! the other one else. The junction structure being a Dirac structure, one of the two always is free (van der Schaft
//! and Jeltsema, Port-Hamiltonian Systems Theory, 2014), and in the end what all give determines all there is.

use super::echelon::Echelon;
use super::laws::{law, one_way};
use super::modulation::Parts;
use super::{Causality, OPTIONS};
use crate::expression::Pool;
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, TwoPort, Variable};

/// The equations of junctions, TF and GY.
fn equations(model: &Model, graph: &BondGraph) -> Echelon {
    use Variable::{Effort, Flow};
    let mut all = Echelon::default();
    for (id, e) in model.ids() {
        let bonds = &graph.bonds_of[id.at()];
        let at = |b: BondId, v: Variable| model.place(b, id, v);
        let sign = |b: BondId| if model.bond(b).head == id { 1.0 } else { -1.0 };
        match (e.kind, &e.law) {
            (Kind::Junction(common), _) => {
                let sum: Vec<_> = bonds.iter().map(|b| (at(*b, common.other()), sign(*b))).collect();
                all.take(&sum);
                for pair in bonds.windows(2) {
                    all.take(&[(at(pair[0], common), 1.0), (at(pair[1], common), -1.0)]);
                }
            }
            (Kind::TwoPort(two_port), Law::Ratio(v)) => {
                let ends = (bonds.iter().find(|b| sign(**b) > 0.0), bonds.iter().find(|b| sign(**b) < 0.0));
                let (Some(&into), Some(&out)) = ends else { continue };
                let ratio = model.pool.eval(*v, &|s| 0.37 + 0.21 * f64::from(s.0 % 11));
                let ratio = if ratio.is_finite() && ratio != 0.0 { ratio } else { 1.0 };
                // The variables at the head that go with the effort and the flow at the tail.
                let (first, second) = match two_port {
                    TwoPort::Transformer => (Effort, Flow),
                    TwoPort::Gyrator => (Flow, Effort),
                };
                all.take(&[(at(into, Effort), 1.0), (at(out, first), -ratio)]);
                all.take(&[(at(out, second), 1.0), (at(into, Flow), -ratio)]);
            }
            (Kind::OnePort(_) | Kind::TwoPort(_), _) => {}
        }
    }
    all
}

/// Whether bonds make a ring, in a model that is not too large for [`by_rank`].
pub(super) fn has_rings(model: &Model, graph: &BondGraph) -> bool {
    model.bonds.len() <= OPTIONS.ranked_bonds && petgraph::algo::is_cyclic_undirected(&graph.graph)
}

/// The elements with one port, by when they choose what they give: first what cannot be turned, then storages, those
/// first that can least be dependent, then resistors; none for what chooses nothing.
fn ports(model: &mut Model, graph: &BondGraph) -> Vec<(usize, ElementId, BondId)> {
    let parts = Parts::of(model, graph);
    let mut pool = std::mem::take(&mut model.pool);
    let rank = |pool: &mut Pool, id: ElementId, asserted: bool| match &model.element(id).law {
        Law::Source(_) | Law::Port(_) | Law::Multiplier => Some(0),
        Law::Ratio(_) | Law::Junction => None,
        _ if asserted => Some(0),
        Law::Resistor(r) if r.curve.is_some() || one_way(pool, r) => Some(1),
        Law::Storage(s) if !s.massless && s.linear.is_none() => Some(2),
        Law::Storage(_) => Some(3),
        Law::Resistor(r) if r.linear.is_none() => Some(4),
        Law::Resistor(_) => Some(5),
    };
    let mut ports = Vec::new();
    for (id, _) in model.ids() {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        ports.extend(rank(&mut pool, id, model.bond(bond).stroke.is_some()).map(|rank| (rank, id, bond)));
    }
    model.pool = pool;
    ports.sort_by_key(|p| (p.0, if p.0 == 3 { parts.turn(model, p.1) } else { 0 }));
    ports
}

/// The equations of junctions, TF, GY and double bars. None where these contradict one another.
fn asked(model: &Model, graph: &BondGraph, causality: &Causality) -> Option<Echelon> {
    let mut known = equations(model, graph);
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| b.sampled) {
        let bond = BondId(i as u32);
        for far in [b.tail, b.head] {
            let gives = causality.gives(model, bond, far);
            if !known.take(&[(model.place(bond, b.other(far), gives), 1.0)]) {
                return None;
            }
        }
    }
    Some(known)
}

/// Which variable an element of this rank is to give, if it can.
fn wish(model: &Model, causality: &Causality, (rank, id, bond): (usize, ElementId, BondId)) -> Option<Variable> {
    let kind = model.element(id).kind;
    (rank == 0)
        .then(|| kind.forced().unwrap_or_else(|| causality.gives(model, bond, id)))
        .or_else(|| kind.integral())
        .or_else(|| law(model, id).map(|r| r.gives))
}

/// What each storage and resistor is to give. What sources, double bars, open ports and asserted strokes of elements
/// give is as `causality` has it. None where these contradict one another.
pub(super) fn by_rank(
    model: &mut Model,
    graph: &BondGraph,
    causality: &Causality,
) -> Option<Vec<(ElementId, Variable)>> {
    let ports = ports(model, graph);
    let mut known = asked(model, graph, causality)?;
    let mut list = Vec::new();
    for (rank, id, bond) in ports {
        let wanted = wish(model, causality, (rank, id, bond))?;
        let free = known.take(&[(model.place(bond, id, wanted), 1.0)]);
        let gives = if free { wanted } else { wanted.other() };
        if !free && (rank == 0 || !known.take(&[(model.place(bond, id, gives), 1.0)])) {
            return None;
        }
        if rank > 0 {
            list.push((id, gives));
        }
    }
    Some(list)
}

/// The 1-junctions that need speeds of their own: the joints of an arm whose masses have Cartesian speeds. Their flows,
/// with those of the inertias of their parts, determine the flows of all that moves others through ratios which change
/// with states. They follow from the storages' flows too, but by a division by such a ratio, which may be 0; those
/// follow from them without one.
pub(super) fn speeds(model: &mut Model, graph: &BondGraph, causality: &Causality) -> Vec<ElementId> {
    let ports = ports(model, graph);
    let parts = Parts::of(model, graph);
    let Some(mut known) = asked(model, graph, causality) else { return Vec::new() };
    let mut all = known.clone();
    let mut order: Vec<(usize, usize, ElementId, BondId)> = Vec::new();
    for &(rank, id, bond) in ports.iter().filter(|p| matches!(p.0, 0 | 2 | 3)) {
        let Some(gives) = wish(model, causality, (rank, id, bond)) else { continue };
        let given = [(model.place(bond, id, gives), 1.0)];
        all.take(&given);
        if rank < 3 {
            known.take(&given);
        } else if parts.turn(model, id) < usize::MAX {
            order.push((parts.turn(model, id), 0, id, bond));
        }
    }
    for (id, _) in model.ids().filter(|(id, e)| e.kind == Kind::ONE && parts.turn(model, *id) < usize::MAX) {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        order.push((parts.turn(model, id), if parts.is_direct(id) { 1 } else { 2 }, id, bond));
    }
    order.sort_by_key(|o| (o.0, o.1));
    let mut list = Vec::new();
    for (_, own, id, bond) in order {
        let flow = [(model.place(bond, id, Variable::Flow), 1.0)];
        if (own == 0 || all.follows(&flow)) && known.take(&flow) && own > 0 {
            list.push(id);
        }
    }
    list
}
