//! What makes signals, as blocks, and the signals that lead to the elements that they drive.

use super::diagram::{Diagram, Link, Node, Shape};
use crate::model::{BondId, Delayed, ElementId, Kind, Model, Variable};
use crate::show::modulation::{Origin, drives, reads};
use crate::show::node::{self, Nodes};
use crate::show::{Shown, name};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::{BTreeMap, BTreeSet};

/// Letters of an integrand that is written in its block.
const INTEGRAND: usize = 18;

/// Finds a box for a block: by its path and its `sampled` block.
type Around<'a> = dyn FnMut(&mut Diagram, &str, Option<usize>) -> Option<usize> + 'a;

/// The signals of a model.
pub(super) struct Signals<'a> {
    shown: &'a Shown<'a>,
    nodes: &'a Nodes,
    /// What makes signals, and what it reads: signal states, delays, integrals.
    makers: BTreeMap<Origin, BTreeSet<Origin>>,
    /// The first maker of each one's block.
    block: BTreeMap<Origin, Origin>,
}

impl<'a> Signals<'a> {
    /// Finds what makes signals, and what belongs to one block: what a part with inputs or outputs does, else signal
    /// states and delays of one place that read each other.
    pub(super) fn new(shown: &'a Shown<'a>, nodes: &'a Nodes) -> Self {
        let model = &*shown.model;
        let mut makers: BTreeMap<Origin, BTreeSet<Origin>> = BTreeMap::new();
        for (i, m) in model.memories.iter().enumerate() {
            makers.insert(Origin::Memory(i), reads(model, m.law));
        }
        // Waves on lines are what the lines are; a delay that is no more than its state is that state.
        for (i, d) in model.delays.iter().enumerate().filter(|(_, d)| d.of == Delayed::Signal) {
            makers.insert(Origin::Delay(i), reads(model, d.signal));
        }
        let mut wanted: BTreeSet<Origin> = model.elements.iter().flat_map(|e| drives(model, e)).collect();
        wanted.extend(makers.values().flatten());
        let mut rest: Vec<usize> = (0..model.integrals.len()).rev().collect();
        // An integral may be read by another one.
        while let Some(at) = rest.iter().position(|i| wanted.contains(&Origin::Integral(*i))) {
            let i = rest.remove(at);
            let read = reads(model, model.integrals[i].rate);
            wanted.extend(&read);
            makers.insert(Origin::Integral(i), read);
        }
        let mut signals = Signals { shown, nodes, makers, block: BTreeMap::new() };
        signals.join();
        signals
    }

    fn place(&self, maker: Origin) -> (String, Option<usize>) {
        let model = &*self.shown.model;
        match maker {
            Origin::Memory(i) => (model.memories[i].name.clone(), model.memories[i].sampling),
            Origin::Delay(i) => (model.delays[i].name.clone(), None),
            _ => (String::new(), None),
        }
    }

    /// The part that a maker belongs to, where the part has inputs or outputs, or is not looked into.
    fn part(&self, maker: Origin) -> Option<usize> {
        let model = &*self.shown.model;
        let (name, _) = self.place(maker);
        let mut depth = 0;
        for (i, p) in model.parts.iter().enumerate().filter(|(_, p)| !p.matrix) {
            let within = |path: &str| path.strip_prefix(&p.name).is_some_and(|r| r.starts_with('.'));
            if !within(&name) {
                continue;
            }
            let exchanges = model.exchanged.iter().any(|e| within(&e.name));
            if depth >= self.shown.picture.depth || exchanges && !model.elements.iter().any(|e| within(&e.name)) {
                return Some(i);
            }
            depth += 1;
        }
        None
    }

    fn join(&mut self) {
        let list: Vec<Origin> = self.makers.keys().copied().collect();
        let at: BTreeMap<Origin, usize> = list.iter().enumerate().map(|(i, o)| (*o, i)).collect();
        let mut sets = petgraph::unionfind::UnionFind::<usize>::new(list.len());
        let mut of_part: FxHashMap<usize, usize> = FxHashMap::default();
        let same_place = |a: usize, b: usize, sets: &mut petgraph::unionfind::UnionFind<usize>| {
            let around = |o: Origin| {
                let (name, sampling) = self.place(o);
                (name.rsplit_once('.').map(|n| n.0.to_string()), sampling)
            };
            let integral = |o: Origin| matches!(o, Origin::Integral(_));
            if !integral(list[a]) && !integral(list[b]) && around(list[a]) == around(list[b]) {
                sets.union(a, b);
            }
        };
        for (i, o) in list.iter().enumerate() {
            if let Some(part) = self.part(*o) {
                sets.union(*of_part.entry(part).or_insert(i), i);
                continue;
            }
            for j in self.makers[o].iter().filter_map(|r| at.get(r)) {
                if self.part(list[*j]).is_none() {
                    same_place(i, *j, &mut sets);
                }
            }
        }
        // What one law reads is made by one controller.
        for e in &self.shown.model.elements {
            let makers: Vec<usize> = drives(self.shown.model, e).iter().filter_map(|o| at.get(o).copied()).collect();
            for pair in makers.windows(2) {
                if self.part(list[pair[0]]).is_none() && self.part(list[pair[1]]).is_none() {
                    same_place(pair[0], pair[1], &mut sets);
                }
            }
        }
        let mut first: FxHashMap<usize, Origin> = FxHashMap::default();
        for (i, o) in list.iter().enumerate() {
            let of = *first.entry(sets.find(i)).or_insert(*o);
            self.block.insert(*o, of);
        }
    }

    /// Adds blocks and signals to a diagram.
    pub(super) fn draw(&mut self, diagram: &mut Diagram, around: &mut Around<'_>) {
        let model = &*self.shown.model;
        let mut blocks: BTreeMap<Origin, usize> = BTreeMap::new();
        let firsts: BTreeSet<Origin> = self.block.values().copied().collect();
        for first in firsts {
            let members: Vec<Origin> = self.block.iter().filter(|(_, f)| **f == first).map(|(m, _)| *m).collect();
            let node = self.block_node(&members, diagram, around);
            blocks.insert(first, diagram.nodes.len());
            diagram.nodes.push(node);
        }
        let mut arrows: BTreeSet<(usize, usize)> = BTreeSet::new();
        let mut sources: BTreeMap<(Origin, usize), usize> = BTreeMap::new();
        for (id, e) in model.ids() {
            let read = drives(model, e);
            let target = self.nodes.of[id.at()];
            // A law that reads one block is the last part of it: all that it reads goes into the block.
            let of: BTreeSet<usize> = read.iter().filter_map(|o| self.block.get(o)).map(|f| blocks[f]).collect();
            let through = of.iter().next().copied().filter(|_| of.len() == 1);
            if let Some(block) = through {
                arrows.insert((block, target));
            }
            for o in read {
                match self.block.get(&o) {
                    Some(first) => {
                        arrows.insert((blocks[first], target));
                    }
                    None => {
                        let to = through.unwrap_or(target);
                        if let Some(from) = self.origin(o, to, diagram, &mut sources) {
                            arrows.insert((from, to));
                        }
                    }
                }
            }
        }
        for (maker, read) in &self.makers {
            let to = blocks[&self.block[maker]];
            for o in read {
                let from = match self.block.get(o) {
                    Some(first) => Some(blocks[first]),
                    None => self.origin(*o, to, diagram, &mut sources),
                };
                arrows.extend(from.map(|from| (from, to)));
            }
        }
        for (tail, head) in arrows.into_iter().filter(|(a, b)| a != b) {
            let name = |i: usize| diagram.nodes[i].id.clone();
            let title = format!("signal from {} to {}", diagram.nodes[tail].title, diagram.nodes[head].title);
            let id = format!("signal.{}.{}", name(tail), name(head));
            let (labels, ports) = Default::default();
            diagram.links.push(Link { id, title, tail, head, bonds: None, labels, ports });
        }
    }

    fn block_node(&self, members: &[Origin], diagram: &mut Diagram, around: &mut Around<'_>) -> Node {
        let model = &*self.shown.model;
        let (path, sampling) = self.place(members[0]);
        let sampling = members.iter().find_map(|m| self.place(*m).1).or(sampling);
        let part = self.part(members[0]).map(|p| &model.parts[p]);
        let inside = part.map_or(path.as_str(), |p| p.name.as_str());
        let group = around(diagram, &node::bundled(model, inside), sampling);
        let clock = sampling.and_then(|s| model.samplings.get(s)).filter(|_| group.is_none());
        let clock = clock.map(|s| format!(" every {} s", name::number(s.period))).unwrap_or_default();
        let names: Vec<String> = members.iter().map(|m| self.words(*m)).collect();
        let title = names.join(", ");
        let (kind, name) = match part {
            Some(p) => (p.kind.clone(), format!("{}{clock}", short(diagram, group, &node::bundled(model, &p.name)))),
            None => {
                let list: Vec<String> = names.iter().map(|n| short(diagram, group, n)).collect();
                let more = if list.len() > 3 { format!(", ... ({})", list.len()) } else { String::new() };
                (String::new(), format!("{}{more}{clock}", list[..list.len().min(3)].join(", ")))
            }
        };
        let id = format!("block.{}", if part.is_some() { &name } else { &title });
        Node { id, title, shape: Shape::Block, kind, name, derivative: false, group }
    }

    /// What a maker is called.
    fn words(&self, maker: Origin) -> String {
        let model = &*self.shown.model;
        match maker {
            Origin::Memory(i) => model.memories[i].name.clone(),
            Origin::Delay(i) => match model.delays[i].periods {
                Some(n) => format!("delay {} periods", n + 1),
                None => format!("delay {} s", name::number(model.delays[i].time)),
            },
            Origin::Integral(i) => {
                let rate = name::expression(&model.pool, model.integrals[i].rate);
                if rate.chars().count() <= INTEGRAND { format!("∫ {rate}") } else { "∫".into() }
            }
            Origin::Time | Origin::Element(_) | Origin::Bond(..) | Origin::Input(_) => String::new(),
        }
    }

    /// The node that a signal starts from, which is made where there is none yet.
    fn origin(
        &self,
        origin: Origin,
        to: usize,
        diagram: &mut Diagram,
        made: &mut BTreeMap<(Origin, usize), usize>,
    ) -> Option<usize> {
        let model = &*self.shown.model;
        let new = |id: String, title: String, shape: Shape, name: String, group: Option<usize>| Node {
            id,
            title,
            shape,
            kind: String::new(),
            name,
            derivative: false,
            group,
        };
        match origin {
            Origin::Element(id) => Some(self.nodes.of[id.at()]),
            Origin::Bond(bond, effort) => Some(self.nodes.of[end(model, bond, effort).at()]),
            Origin::Input(i) => Some(*made.entry((origin, 0)).or_insert_with(|| {
                let name = model.inputs[i].name.clone();
                diagram.nodes.push(new(format!("input.{name}"), format!("input {name}"), Shape::Input, name, None));
                diagram.nodes.len() - 1
            })),
            // Each has a clock of its own: arrows from one clock to all would be read as a thing that they share.
            Origin::Time => Some(*made.entry((origin, to)).or_insert_with(|| {
                let (target, group) = (diagram.nodes[to].id.clone(), diagram.nodes[to].group);
                diagram.nodes.push(new(format!("time.{target}"), "time".into(), Shape::Tag, "t".into(), group));
                diagram.nodes.len() - 1
            })),
            Origin::Memory(_) | Origin::Delay(_) | Origin::Integral(_) => None,
        }
    }
}

/// A name within a box that bears its first part.
fn short(diagram: &Diagram, group: Option<usize>, name: &str) -> String {
    let around = group.map(|g| diagram.groups[g].path.as_str()).filter(|p| !p.is_empty());
    let rest = around.and_then(|p| name.strip_prefix(p)).and_then(|rest| rest.strip_prefix('.'));
    rest.unwrap_or(name).to_string()
}

/// Where an effort or a flow is read: at the junction that shares it, else at an element.
fn end(model: &Model, bond: BondId, effort: bool) -> ElementId {
    let b = model.bond(bond);
    let head = name::head_id(model, b);
    let common = Kind::Junction(if effort { Variable::Effort } else { Variable::Flow });
    let kind = |id: ElementId| model.element(id).kind;
    let rank = |id: ElementId| match kind(id) {
        k if k == common => 0,
        Kind::OnePort(_) => 1,
        Kind::TwoPort(_) => 2,
        Kind::Junction(_) => 3,
    };
    if rank(head) < rank(b.tail) { head } else { b.tail }
}

/// Has each node and each link an id of its own that XML takes.
pub(super) fn distinct(diagram: &mut Diagram) {
    let mut taken: FxHashSet<String> = FxHashSet::default();
    let ids = diagram.nodes.iter_mut().map(|n| &mut n.id).chain(diagram.links.iter_mut().map(|l| &mut l.id));
    for id in ids {
        let plain = |c: char| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' };
        let mut own: String = id.chars().map(plain).collect();
        if own.starts_with(|c: char| c.is_ascii_digit()) {
            own.insert(0, '_');
        }
        let (mut name, mut n) = (own.clone(), 2);
        while !taken.insert(name.clone()) {
            name = format!("{own}-{n}");
            n += 1;
        }
        *id = name;
    }
}
