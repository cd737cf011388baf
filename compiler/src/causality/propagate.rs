//! The rules that carry strokes on, and what an attempt to assign one comes to.

use super::assignment::Assignment;
use super::conflict::Conflict;
use super::{Cause, matching, modulation};
use crate::model::{BondId, ElementId, Kind, Law, TwoPort, Variable};
use bond_grammar::ast::Stroke;
use bond_grammar::diagnostic::Diagnostic;

impl Assignment<'_> {
    /// Whether a bond that was assigned since a mark is so at one of its ends.
    fn since(&self, mark: usize, is_so: impl Fn(BondId, ElementId) -> bool) -> bool {
        self.trail[mark..].iter().any(|&bond| {
            let b = self.model.bond(bond);
            is_so(bond, b.tail) || is_so(bond, b.head)
        })
    }

    /// Whether a storage lost its integral causality since a mark.
    pub(super) fn costs_storage(&self, mark: usize) -> bool {
        self.since(mark, |bond, end| {
            let wanted = self.model.element(end).kind.integral();
            wanted.is_some() && self.gives(bond, end) != wanted
        })
    }

    /// Whether something is divided by a ratio that may pass 0, by what was assigned since a mark.
    pub(super) fn divides(&self, mark: usize) -> bool {
        self.since(mark, |bond, end| {
            self.gives(bond, end).is_some_and(|gives| modulation::divides(self.model, end, bond, gives))
        })
    }

    /// Whether a curve was asked, since a mark, for another variable than the one that all at its junction have in
    /// common.
    pub(super) fn turns_curve(&self, mark: usize) -> bool {
        self.since(mark, |bond, end| {
            let common = self.model.element(self.model.bond(bond).other(end)).kind.common();
            let is_curve = matches!(&self.model.element(end).law, Law::Resistor(r) if r.curve.is_some());
            is_curve && common.is_some() && self.gives(bond, end) != common
        })
    }

    /// How many of these storages would have no integral causality, by what is assigned so far and each one's wish in
    /// turn; nothing is changed.
    pub(super) fn lost(&mut self, storages: &[(ElementId, BondId)]) -> usize {
        let mark = self.mark();
        for &(id, bond) in storages {
            if let Some(gives) = self.model.element(id).kind.integral() {
                self.prefer(bond, self.stroke_for(bond, id, gives), Cause::Storage(id));
            }
        }
        let lost = |&&(id, bond): &&(ElementId, BondId)| self.gives(bond, id) != self.model.element(id).kind.integral();
        let count = storages.iter().filter(lost).count();
        self.undo(mark);
        count
    }

    /// Assigns a stroke and all that follows from it; on conflict nothing is changed.
    pub(super) fn attempt(&mut self, bond: BondId, stroke: Stroke, cause: Cause) -> Result<(), Conflict> {
        let mark = self.mark();
        let mut result = self.assign_all(bond, stroke, cause);
        if result.is_ok() && self.thorough && !matching::possible(self) {
            result = Err(Conflict::new(self, bond, cause));
        }
        if result.is_err() {
            self.undo(mark);
        }
        result
    }

    /// Assigns a stroke if the bond is free and this leads to no conflict; else the other one, if that does not either.
    pub(super) fn prefer(&mut self, bond: BondId, stroke: Stroke, cause: Cause) {
        if self.strokes[bond.at()].is_none() && self.attempt(bond, stroke, cause).is_err() {
            let other = match stroke {
                Stroke::Head => Stroke::Tail,
                Stroke::Tail => Stroke::Head,
            };
            let _ = self.attempt(bond, other, Cause::Free);
        }
    }

    fn assign_all(&mut self, bond: BondId, stroke: Stroke, cause: Cause) -> Result<(), Conflict> {
        let mut queue = std::collections::VecDeque::from([(bond, stroke, cause)]);
        while let Some((bond, stroke, cause)) = queue.pop_front() {
            match self.strokes[bond.at()] {
                Some(s) if s == stroke => continue,
                Some(_) => return Err(Conflict::new(self, bond, cause)),
                None => {}
            }
            self.strokes[bond.at()] = Some(stroke);
            self.causes[bond.at()] = cause;
            self.trail.push(bond);
            self.count(bond, true);
            let b = self.model.bond(bond);
            for end in [b.tail, b.head] {
                self.follow(end, bond, &mut queue)?;
            }
        }
        Ok(())
    }

    /// The rule of the element at `end`, after `bond` got its stroke.
    fn follow(
        &self,
        end: ElementId,
        bond: BondId,
        queue: &mut std::collections::VecDeque<(BondId, Stroke, Cause)>,
    ) -> Result<(), Conflict> {
        let bonds = &self.graph.bonds_of[end.at()];
        let kind = self.model.element(end).kind;
        let given = self.gives(bond, end);
        match kind {
            Kind::Junction(common) => {
                let giving = self.giving[end.at()];
                if giving > 1 {
                    return Err(Conflict::two_givers(self, end, bond));
                }
                let missing = bonds.len() as u32 - self.assigned[end.at()];
                if self.is_giver(bond, end) {
                    for &other in bonds.iter().filter(|b| self.strokes[b.at()].is_none()) {
                        queue.push_back((other, self.stroke_for(other, end, common), Cause::Rule(end, bond)));
                    }
                } else if giving == 0 && missing == 1 {
                    for &other in bonds.iter().filter(|b| self.strokes[b.at()].is_none()) {
                        queue.push_back((other, self.stroke_for(other, end, common.other()), Cause::Rule(end, bond)));
                    }
                } else if giving == 0 && missing == 0 {
                    return Err(Conflict::no_giver(self, end, bond));
                }
            }
            Kind::TwoPort(two_port) => {
                let Some(&other) = bonds.iter().find(|b| **b != bond) else { return Ok(()) };
                let Some(given) = given else { return Ok(()) };
                let gives = match two_port {
                    TwoPort::Transformer => given.other(),
                    TwoPort::Gyrator => given,
                };
                queue.push_back((other, self.stroke_for(other, end, gives), Cause::Rule(end, bond)));
            }
            Kind::OnePort(_) => {
                if kind.forced().is_some_and(|forced| given != Some(forced)) {
                    return Err(Conflict::new(self, bond, Cause::Source(end)));
                }
            }
        }
        Ok(())
    }

    /// Junctions that no bond gives their common variable, and bonds that no choice fitted.
    pub(super) fn undetermined(&self) -> Vec<Diagnostic> {
        let mut errors = Vec::new();
        for (id, e) in self.model.ids() {
            let bonds = &self.graph.bonds_of[id.at()];
            let free: Vec<BondId> = bonds.iter().copied().filter(|b| self.strokes[b.at()].is_none()).collect();
            let lacks = e.kind.common().filter(|_| self.giving[id.at()] == 0);
            if let Some(common) = lacks {
                let what = if common == Variable::Effort { "effort" } else { "flow" };
                let list: Vec<&str> = if free.is_empty() { bonds } else { &free }
                    .iter()
                    .map(|b| self.model.bond(*b).name.as_str())
                    .collect();
                let mut error = Diagnostic::error(
                    "causality::undetermined",
                    e.span,
                    format!("the graph is not determined: nothing gives the {what} of `{}`", e.name),
                );
                for b in bonds {
                    error = error.label(self.model.bond(*b).span, format!("is the bond {}", self.model.bond(*b).name));
                }
                errors.push(error.help(format!(
                    "the bonds {} leave it free; bond an element that gives {what}, such as {}",
                    list.join(", "),
                    if common == Variable::Effort { "a C or an R" } else { "an I or an R" }
                )));
            }
        }
        if errors.is_empty() {
            for (bond, _) in self.model.bonds.iter().zip(&self.strokes).filter(|(_, stroke)| stroke.is_none()) {
                errors.push(
                    Diagnostic::error(
                        "causality::undetermined",
                        bond.span,
                        format!("the graph is not determined: the bond {} is free", bond.name),
                    )
                    .help("no causal stroke fits it; check the elements at its ends"),
                );
            }
        }
        errors
    }
}
