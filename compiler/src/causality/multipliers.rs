//! Where multipliers stand: the bonds on which causality collides when storages keep their states that depend on one
//! another (residual sinks: Borutzky, Bond Graph Methodology, 2010, ch. 2).
//!
//! All that gives a variable whatever the rest does, sources, double bars, storages, is taken at once, and carried on
//! through junctions, TF and GY, step by step and by products alone. Where both ends of a bond come to give the same
//! variable, one equation is too many: a multiplier holds it instead, and gives both ends the other variable. So a
//! constraint has the coefficients that the model has, of what stands near by, and no division by a ratio that may
//! pass 0.
//!
//! A 1-junction that then still has no flow, and from which others would follow by such a division only, gets a speed
//! of its own.

use super::{Causality, modulation};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, TwoPort, Variable};
use std::collections::VecDeque;

/// What is to be added to a graph.
#[derive(Default)]
pub(super) struct Additions {
    /// Bonds of which both ends give this variable.
    pub(super) multipliers: Vec<(BondId, Variable)>,
    /// 1-junctions that get speeds of their own.
    pub(super) speeds: Vec<ElementId>,
}

/// What an element gives to a bond.
type Wave = (BondId, ElementId, Variable);

struct Waves<'a> {
    model: &'a Model,
    graph: &'a BondGraph,
    /// What the tail of each bond gives, and what its head does.
    given: Vec<[Option<Variable>; 2]>,
    /// Of each junction, the bonds that bring it what it sums.
    brought: Vec<u32>,
    /// Whether a junction has what its bonds share.
    is_set: Vec<bool>,
    waves: VecDeque<Wave>,
    /// What would follow by a division.
    divided: VecDeque<Wave>,
    found: Additions,
}

/// Finds the places where multipliers and speeds are to be added so that these storages keep their states.
pub(super) fn additions(model: &Model, graph: &BondGraph, causality: &Causality, tied: &[ElementId]) -> Additions {
    let mut is_concerned = vec![false; graph.regions.len()];
    tied.iter().for_each(|id| is_concerned[graph.region_of[id.at()].at()] = true);
    let is_concerned = |id: ElementId| is_concerned[graph.region_of[id.at()].at()];
    let mut w = Waves {
        model,
        graph,
        given: vec![[None; 2]; model.bonds.len()],
        brought: vec![0; model.elements.len()],
        is_set: vec![false; model.elements.len()],
        waves: VecDeque::new(),
        divided: VecDeque::new(),
        found: Additions::default(),
    };
    for (id, e) in model.ids().filter(|(id, _)| is_concerned(*id)) {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let gives = match (&e.law, e.kind.integral()) {
            (Law::Source(_) | Law::Multiplier, _) => e.kind.forced(),
            (Law::Port(_), _) => Some(causality.gives(model, bond, id)),
            (Law::Storage(_), gives) if tied.contains(&id) || !causality.dependent.contains(&id) => gives,
            (Law::Storage(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction, _) => None,
        };
        w.waves.extend(gives.map(|gives| (bond, id, gives)));
    }
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| b.sampled) {
        let bond = BondId(i as u32);
        for far in [b.tail, b.head].into_iter().filter(|far| is_concerned(b.other(*far))) {
            w.receive(bond, b.other(far), causality.gives(model, bond, far));
        }
    }
    w.run();
    w.found
}

impl Waves<'_> {
    fn run(&mut self) {
        loop {
            while let Some(wave) = self.waves.pop_front() {
                self.give(wave);
            }
            let Some((bond, from, gives)) = self.divided.pop_front() else { return };
            let far = self.model.bond(bond).other(from);
            let is_one = self.model.element(far).kind == Kind::ONE;
            if gives == Variable::Flow && is_one && !self.is_set[from.at()] && !self.is_set[far.at()] {
                self.found.speeds.push(far);
                self.set(far, None);
            } else {
                self.give((bond, from, gives));
            }
        }
    }

    fn end(&mut self, bond: BondId, end: ElementId) -> &mut Option<Variable> {
        &mut self.given[bond.at()][usize::from(self.model.bond(bond).head == end)]
    }

    /// An element gives a variable to a bond. The other end receives it, unless it gives the same one.
    fn give(&mut self, (bond, from, gives): Wave) {
        let (b, kind) = (self.model.bond(bond), self.model.element(from).kind);
        // A TF or GY is one equation for each variable: it carries what comes to one of its ends on to the other.
        if b.sampled || matches!(kind, Kind::TwoPort(_)) && std::mem::replace(&mut self.is_set[from.at()], true) {
            return;
        }
        self.is_set[from.at()] |= kind.common() == Some(gives.other());
        let before = self.end(bond, from).replace(gives);
        match before {
            None => self.receive(bond, b.other(from), gives),
            Some(before) if before != gives => self.found.multipliers.push((bond, gives)),
            Some(_) => {}
        }
    }

    /// An element receives a variable from a bond, and gives it the other one.
    fn receive(&mut self, bond: BondId, at: ElementId, brings: Variable) {
        *self.end(bond, at) = Some(brings.other());
        match self.model.element(at).kind {
            Kind::Junction(common) if brings == common => {
                if !self.is_set[at.at()] {
                    self.set(at, Some(bond));
                }
            }
            Kind::Junction(_) => {
                self.brought[at.at()] += 1;
                let graph = self.graph;
                let bonds = &graph.bonds_of[at.at()];
                let missing = bonds.len().saturating_sub(self.brought[at.at()] as usize);
                if !self.is_set[at.at()] && missing == 0 {
                    self.waves.push_back((bond, at, brings));
                } else if !self.is_set[at.at()] && missing == 1 {
                    let last = bonds.iter().find(|b| self.end(**b, at).is_none());
                    self.waves.extend(last.map(|b| (*b, at, brings)));
                }
            }
            Kind::TwoPort(two_port) => {
                let Some(&other) = self.graph.bonds_of[at.at()].iter().find(|b| **b != bond) else { return };
                let gives = if two_port == TwoPort::Transformer { brings } else { brings.other() };
                let wave = (other, at, gives);
                let is_divided = modulation::divides(self.model, at, other, gives);
                if is_divided { self.divided.push_back(wave) } else { self.waves.push_back(wave) }
            }
            Kind::OnePort(_) => {}
        }
    }

    /// A junction has what its bonds share: it gives that to all others.
    fn set(&mut self, at: ElementId, by: Option<BondId>) {
        self.is_set[at.at()] = true;
        let Some(common) = self.model.element(at).kind.common() else { return };
        let others = self.graph.bonds_of[at.at()].iter().filter(|b| Some(**b) != by);
        self.waves.extend(others.map(|b| (*b, at, common)));
    }
}
