//! A partial assignment of strokes.

use super::Cause;
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Model, Variable};
use bond_grammar::ast::Stroke;

/// A partial assignment, with a trail so that attempts can be undone.
pub(super) struct Assignment<'a> {
    pub(super) model: &'a Model,
    pub(super) graph: &'a BondGraph,
    pub(super) strokes: Vec<Option<Stroke>>,
    pub(super) causes: Vec<Cause>,
    /// For each junction the bonds that give it its common variable, counted.
    pub(super) giving: Vec<u32>,
    pub(super) assigned: Vec<u32>,
    pub(super) trail: Vec<BondId>,
    /// Whether a choice is taken only where the rest can still be completed.
    pub(super) thorough: bool,
}

impl<'a> Assignment<'a> {
    pub(super) fn new(model: &'a Model, graph: &'a BondGraph) -> Self {
        Self {
            model,
            graph,
            strokes: vec![None; model.bonds.len()],
            causes: vec![Cause::Free; model.bonds.len()],
            giving: vec![0; model.elements.len()],
            assigned: vec![0; model.elements.len()],
            trail: Vec::new(),
            thorough: false,
        }
    }

    /// The stroke with which the element at `end` gives `variable`.
    pub(super) fn stroke_for(&self, bond: BondId, end: ElementId, variable: Variable) -> Stroke {
        let head = self.model.bond(bond).head == end;
        if head == (variable == Variable::Flow) { Stroke::Head } else { Stroke::Tail }
    }

    /// What the element at `end` gives to an assigned bond.
    pub(super) fn gives(&self, bond: BondId, end: ElementId) -> Option<Variable> {
        self.strokes[bond.at()]
            .map(|s| if s == self.stroke_for(bond, end, Variable::Flow) { Variable::Flow } else { Variable::Effort })
    }

    pub(super) fn mark(&self) -> usize {
        self.trail.len()
    }

    pub(super) fn undo(&mut self, mark: usize) {
        while self.trail.len() > mark {
            let Some(bond) = self.trail.pop() else { break };
            self.count(bond, false);
            self.strokes[bond.at()] = None;
        }
    }

    /// Whether some bond gives a junction its common variable.
    pub(super) fn has_giver(&self, junction: ElementId) -> bool {
        self.giving[junction.at()] > 0
    }

    /// Whether a bond gives its end, a junction, the common variable: the junction itself then gives the other one.
    pub(super) fn is_giver(&self, bond: BondId, junction: ElementId) -> bool {
        let common = self.model.element(junction).kind.common();
        common.is_some() && self.gives(bond, junction) == common.map(Variable::other)
    }

    pub(super) fn count(&mut self, bond: BondId, up: bool) {
        let b = self.model.bond(bond);
        for end in [b.tail, b.head] {
            let giver = u32::from(self.is_giver(bond, end));
            let (g, n) = (&mut self.giving[end.at()], &mut self.assigned[end.at()]);
            if up {
                *g += giver;
                *n += 1;
            } else {
                *g -= giver;
                *n -= 1;
            }
        }
    }
}
