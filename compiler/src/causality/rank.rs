//! What elements give, found by rank: where junctions stand in rings, strokes alone do not show what is tied together.
//!
//! What junctions, TF and GY ask of efforts and flows is a set of linear equations. Elements choose in the order of SCAP:
//! each gives its preferred variable unless that follows, by these equations, from what was given before it, and the
//! other one else. The junction structure being a Dirac structure, one of the two always is free (van der Schaft and
//! Jeltsema, Port-Hamiltonian Systems Theory, 2014), and in the end what all give determines all there is.

use super::{Causality, forced, integral, law, one_way};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Variable};

/// Models of more bonds are not looked at.
const MOST: usize = 5000;
/// A part of the largest coefficient that is rounding.
const ROUNDING: f64 = 1e-9;

/// Linear equations, each free of the pivots of those before it.
struct Echelon {
    rows: Vec<(usize, Vec<(usize, f64)>)>,
    size: usize,
}

impl Echelon {
    /// Takes an equation, unless it follows from the others.
    fn take(&mut self, terms: &[(usize, f64)]) -> bool {
        let mut row = vec![0.0; self.size];
        terms.iter().for_each(|(i, x)| row[*i] += x);
        let size = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (pivot, other) in &self.rows {
            let part = row[*pivot];
            if part != 0.0 {
                other.iter().for_each(|(i, x)| row[*i] -= part * x);
                row[*pivot] = 0.0;
            }
        }
        let largest = (0..self.size).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs()));
        let Some(pivot) = largest.filter(|i| row[*i].abs() > ROUNDING * size) else { return false };
        let scale = 1.0 / row[pivot];
        let left = row.iter().enumerate().filter(|(_, x)| x.abs() > 1e-3 * ROUNDING * size);
        self.rows.push((pivot, left.map(|(i, x)| (i, x * scale)).collect()));
        true
    }
}

/// What the junctions, TF and GY ask for.
fn equations(model: &Model, graph: &BondGraph) -> Echelon {
    use Variable::{Effort, Flow};
    let mut all = Echelon { rows: Vec::new(), size: 4 * model.bonds.len() };
    for (id, e) in model.ids() {
        let bonds = &graph.bonds_of[id.at()];
        let at = |b: BondId, v: Variable| model.place(b, id, v);
        let sign = |b: BondId| if model.bond(b).head == id { 1.0 } else { -1.0 };
        match (e.kind, &e.law) {
            (Kind::Zero | Kind::One, _) => {
                let (common, summed) = if e.kind == Kind::Zero { (Effort, Flow) } else { (Flow, Effort) };
                let sum: Vec<_> = bonds.iter().map(|b| (at(*b, summed), sign(*b))).collect();
                all.take(&sum);
                for pair in bonds.windows(2) {
                    all.take(&[(at(pair[0], common), 1.0), (at(pair[1], common), -1.0)]);
                }
            }
            (Kind::Tf | Kind::Gy, Law::Ratio(v)) => {
                let ends = (bonds.iter().find(|b| sign(**b) > 0.0), bonds.iter().find(|b| sign(**b) < 0.0));
                let (Some(&into), Some(&out)) = ends else { continue };
                let ratio = model.pool.eval(*v, &|s| 0.37 + 0.21 * f64::from(s.0 % 11));
                let ratio = if ratio.is_finite() && ratio != 0.0 { ratio } else { 1.0 };
                if e.kind == Kind::Tf {
                    all.take(&[(at(into, Effort), 1.0), (at(out, Effort), -ratio)]);
                    all.take(&[(at(out, Flow), 1.0), (at(into, Flow), -ratio)]);
                } else {
                    all.take(&[(at(into, Effort), 1.0), (at(out, Flow), -ratio)]);
                    all.take(&[(at(out, Effort), 1.0), (at(into, Flow), -ratio)]);
                }
            }
            (
                Kind::Se
                | Kind::Sf
                | Kind::C
                | Kind::I
                | Kind::R
                | Kind::De
                | Kind::Df
                | Kind::Port
                | Kind::Tf
                | Kind::Gy,
                _,
            ) => {}
        }
    }
    all
}

/// Whether bonds make a ring, in a model that is not too large for [`by_rank`].
pub fn has_rings(model: &Model, graph: &BondGraph) -> bool {
    model.bonds.len() <= MOST && petgraph::algo::is_cyclic_undirected(&graph.graph)
}

/// What each storage and resistor is to give. What sources, double bars, open ports and asserted strokes of elements give
/// is as `causality` has it. None where these contradict one another.
pub fn by_rank(model: &mut Model, graph: &BondGraph, causality: &Causality) -> Option<Vec<(ElementId, Variable)>> {
    let mut pool = std::mem::take(&mut model.pool);
    // In what order they choose: what cannot be turned, then storages, those first that can least be dependent.
    let rank = |pool: &mut crate::expression::Pool, id: ElementId, asserted: bool| match &model.element(id).law {
        Law::Source(_) | Law::Port(_) => 0,
        _ if asserted => 0,
        Law::Resistor(r) if r.curve.is_some() || one_way(pool, r) => 1,
        Law::Storage(s) if s.massless || s.linear.is_none() => 2,
        Law::Storage(_) => 3,
        Law::Resistor(r) if r.linear.is_none() => 4,
        Law::Resistor(_) => 5,
        Law::Ratio(_) | Law::Junction => 6,
    };
    let mut ports = Vec::new();
    for (id, _) in model.ids() {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let rank = rank(&mut pool, id, model.bond(bond).stroke.is_some());
        if rank < 6 {
            ports.push((rank, id, bond));
        }
    }
    model.pool = pool;
    let model = &*model;
    ports.sort_by_key(|p| p.0);
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
    let mut list = Vec::new();
    for (rank, id, bond) in ports {
        let wanted = forced(model.element(id).kind)
            .filter(|_| rank == 0)
            .or_else(|| (rank == 0).then(|| causality.gives(model, bond, id)))
            .or_else(|| integral(model.element(id).kind))
            .or_else(|| law(model, id).map(|r| r.gives))?;
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
