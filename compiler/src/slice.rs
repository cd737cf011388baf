//! What of a model its scene needs: what its probes, open ports and expectations depend on.
//!
//! What nothing needs is left out of what runs: regions, and signal states. A region is needed as a whole, since its
//! ledger is of all its elements, and so are those that double bars join it to. Without probes, ports and expectations
//! nothing says what is needed, and all is.

use crate::graph::{BondGraph, RegionId};
use crate::model::{ElementId, ExpectationKind, Kind, Meeting, Model, Signal};
use crate::reduction::{Removed, of_expectation, of_law};
use bond_runtime::scene::LeftOut;

/// What nothing needs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Unneeded {
    /// For each region, whether it is.
    regions: Vec<bool>,
    /// For each signal state.
    memories: Vec<bool>,
    /// For each `integral`.
    integrals: Vec<bool>,
    /// For each `delay`.
    delays: Vec<bool>,
}

impl Unneeded {
    /// What of a model nothing needs; `None` where all is needed.
    pub(crate) fn of(model: &Model, graph: &BondGraph) -> Option<Self> {
        let whole = model.expectations.iter().any(|e| matches!(e.kind, ExpectationKind::Passive));
        let ports: Vec<ElementId> = model.ids().filter(|(_, e)| e.kind == Kind::PORT).map(|(id, _)| id).collect();
        if model.probes.is_empty() && model.expectations.is_empty() && ports.is_empty() {
            return None;
        }
        let mut search = Search {
            model,
            graph,
            found: Unneeded {
                regions: vec![true; graph.regions.len()],
                memories: vec![true; model.memories.len()],
                integrals: vec![true; model.integrals.len()],
                delays: vec![true; model.delays.len()],
            },
            next: Vec::new(),
        };
        model.probes.iter().for_each(|p| search.read(p.value));
        model.expectations.iter().flat_map(of_expectation).for_each(|e| search.read(e));
        ports.into_iter().for_each(|id| search.element(id));
        for e in &model.expectations {
            match e.kind {
                ExpectationKind::PassiveAt(Meeting::Element(id)) => search.element(id),
                ExpectationKind::PassiveAt(Meeting::Bar(b)) => search.element(model.bond(b).tail),
                ExpectationKind::Passive | ExpectationKind::At { .. } | ExpectationKind::Holds { .. } => {}
            }
        }
        if whole {
            // What is asserted of the ledger is asserted of all of it.
            (0..graph.regions.len()).for_each(|r| search.need(Part::Region(r)));
        }
        let found = search.all();
        [&found.regions, &found.memories, &found.integrals, &found.delays]
            .iter()
            .any(|list| list.contains(&true))
            .then_some(found)
    }

    /// Whether a region is left out.
    pub fn region(&self, at: usize) -> bool {
        self.regions.get(at).is_some_and(|out| *out)
    }

    /// Whether a signal state is left out.
    pub fn memory(&self, at: usize) -> bool {
        self.memories.get(at).is_some_and(|out| *out)
    }

    /// What is left out, by name.
    pub(crate) fn names(&self, model: &Model, graph: &BondGraph) -> LeftOut {
        fn of<T>(all: &[T], out: &[bool], name: impl Fn(&T) -> &String) -> Vec<String> {
            all.iter().zip(out).filter(|x| *x.1).map(|x| name(x.0).clone()).collect()
        }
        LeftOut {
            regions: of(&graph.regions, &self.regions, |r| &r.name),
            states: of(&model.memories, &self.memories, |m| &m.name),
        }
    }

    /// The model without it.
    pub(crate) fn without(&self, mut model: Model, graph: &BondGraph) -> Model {
        let out = |id: ElementId| self.region(graph.region_of[id.at()].at());
        let gone = Removed {
            elements: model.ids().map(|(id, _)| out(id)).collect(),
            bonds: model.bonds.iter().map(|b| out(b.tail)).collect(),
            memories: self.memories.clone(),
            integrals: self.integrals.clone(),
            delays: self.delays.clone(),
        };
        gone.apply(&mut model);
        model
    }
}

/// What is needed or not.
#[derive(Clone, Copy)]
enum Part {
    Region(usize),
    Memory(usize),
    Integral(usize),
    Delay(usize),
}

/// From what is needed to what that depends on.
struct Search<'a> {
    model: &'a Model,
    graph: &'a BondGraph,
    found: Unneeded,
    /// Needed, but what they read was not looked at yet.
    next: Vec<Part>,
}

impl Search<'_> {
    fn need(&mut self, part: Part) {
        let out = match part {
            Part::Region(i) => self.found.regions.get_mut(i),
            Part::Memory(i) => self.found.memories.get_mut(i),
            Part::Integral(i) => self.found.integrals.get_mut(i),
            Part::Delay(i) => self.found.delays.get_mut(i),
        };
        if let Some(out) = out.filter(|out| **out) {
            *out = false;
            self.next.push(part);
        }
    }

    fn element(&mut self, id: ElementId) {
        let RegionId(region) = self.graph.region_of[id.at()];
        self.need(Part::Region(region as usize));
    }

    fn read(&mut self, e: crate::expression::Expr) {
        for symbol in self.model.pool.symbols(e) {
            match self.model.signals.get(&symbol) {
                Some(Signal::Effort(b) | Signal::Flow(b)) => self.element(self.model.bond(*b).tail),
                Some(Signal::State(id) | Signal::Argument(id) | Signal::Parameter(id)) => self.element(*id),
                Some(Signal::Integral(i)) => self.need(Part::Integral(*i)),
                Some(Signal::Memory(i)) => self.need(Part::Memory(*i)),
                Some(Signal::Delay(i)) => self.need(Part::Delay(*i)),
                Some(Signal::Time | Signal::Input(_) | Signal::Slope(_)) | None => {}
            }
        }
    }

    fn all(mut self) -> Unneeded {
        while let Some(part) = self.next.pop() {
            match part {
                Part::Memory(i) => self.read(self.model.memories[i].law),
                Part::Integral(i) => self.read(self.model.integrals[i].rate),
                Part::Delay(i) => self.read(self.model.delays[i].signal),
                Part::Region(i) => {
                    for &id in &self.graph.regions[i].elements {
                        of_law(&self.model.element(id).law).into_iter().for_each(|e| self.read(e));
                        for &bond in &self.graph.bonds_of[id.at()] {
                            // What a double bar joins is needed on both sides.
                            self.element(self.model.bond(bond).other(id));
                        }
                    }
                }
            }
        }
        self.found
    }
}
