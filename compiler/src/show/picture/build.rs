//! The diagram of a compiled model.

use super::control::{self, Signals};
use super::diagram::{Bonds, Diagram, Group, Link, Node, Shape};
use crate::model::{Bond, BondId, ElementId, Kind, OnePort, Variable};
use crate::show::node::{self, Nodes};
use crate::show::{Labels, Shown, What, name, region};
use bond_grammar::ast::Stroke;
use rustc_hash::{FxHashMap, FxHashSet};

/// The diagram; `graph` has no causal strokes but those that are asserted.
pub(crate) fn diagram(shown: &Shown<'_>, what: What) -> Diagram {
    let model = &*shown.model;
    let nodes = node::nodes(model, shown.picture.depth);
    let dependent: FxHashSet<ElementId> =
        if what == What::Graph { FxHashSet::default() } else { shown.causality.dependent.iter().copied().collect() };
    let mut diagram = Diagram { name: model.name.clone(), ..Diagram::default() };
    let mut groups = Groups { of_region: vec![None; shown.graph.regions.len()], of_part: FxHashMap::default() };
    for n in &nodes.list {
        let group = groups.of(shown, n, &mut diagram);
        let first = n.members[0];
        let shape = match model.element(first).kind {
            _ if n.is_part => Shape::Block,
            Kind::Junction(_) if n.kind.len() == 1 => Shape::Junction,
            Kind::OnePort(OnePort::Open) => Shape::Open,
            Kind::Junction(_) | Kind::OnePort(_) | Kind::TwoPort(_) => Shape::Element,
        };
        let mut title = format!("{}:{}", n.kind, n.name);
        if let ([one], false) = (&n.members[..], n.is_part) {
            let law = name::law(shown, *one);
            title.push_str(if law.is_empty() || law.len() > 400 { "" } else { ", " });
            title.push_str(if law.len() > 400 { "" } else { &law });
        }
        let derivative = n.members.iter().any(|id| dependent.contains(id));
        title.push_str(if derivative { ", in derivative causality" } else { "" });
        // Within a box a name need not repeat the box's own.
        let around = group.map(|g| diagram.groups[g].path.as_str()).filter(|p| !p.is_empty());
        let short = around.and_then(|p| n.name.strip_prefix(p)).and_then(|rest| rest.strip_prefix('.'));
        let name = short.unwrap_or(&n.name).to_string();
        let id = format!("{}.{}", n.kind, n.name);
        diagram.nodes.push(Node { id, title, shape, kind: n.kind.clone(), name, derivative, group });
    }
    for link in node::links(model, &nodes) {
        diagram.links.push(bonds(shown, what, &link, (&nodes, &dependent)));
    }
    let mut signals = Signals::new(shown, &nodes);
    signals.draw(&mut diagram, &mut |diagram, path, sampling| groups.of_block(shown, path, sampling, diagram));
    control::distinct(&mut diagram);
    diagram
}

/// The boxes, as they are made.
struct Groups {
    of_region: Vec<Option<usize>>,
    of_part: FxHashMap<(String, Option<usize>), usize>,
}

impl Groups {
    /// The innermost box of a node: of its parts, of its sampled region.
    fn of(&mut self, shown: &Shown<'_>, n: &node::Node, diagram: &mut Diagram) -> Option<usize> {
        let region = shown.graph.region_of[n.members[0].at()].at();
        let r = &shown.graph.regions[region];
        let outer = r.sampling.map(|_| {
            *self.of_region[region].get_or_insert_with(|| {
                let name = format!("{}: {}", r.name, region::kind(shown, r));
                diagram.groups.push(Group { name, path: String::new(), parent: None, sampled: true });
                diagram.groups.len() - 1
            })
        });
        self.within(shown, &n.name, outer, diagram)
    }

    /// The innermost box of the parts of a path, within a box.
    fn within(&mut self, shown: &Shown<'_>, path: &str, outer: Option<usize>, diagram: &mut Diagram) -> Option<usize> {
        let mut at = outer;
        for p in shown.model.parts.iter().filter(|p| !p.matrix) {
            let name = node::bundled(shown.model, &p.name);
            if !path.strip_prefix(&name).is_some_and(|rest| rest.starts_with('.')) {
                continue;
            }
            let parent = at;
            at = Some(*self.of_part.entry((name.clone(), outer)).or_insert_with(|| {
                let around = parent.map(|g| diagram.groups[g].path.as_str()).filter(|p| !p.is_empty());
                let short = around.and_then(|a| name.strip_prefix(a)).and_then(|rest| rest.strip_prefix('.'));
                let title = format!("{}:{}", p.kind, short.unwrap_or(&name));
                diagram.groups.push(Group { name: title, path: name.clone(), parent, sampled: false });
                diagram.groups.len() - 1
            }));
        }
        at
    }

    /// The box of a block: with the sampled region that runs with it, where there is one alone.
    fn of_block(
        &mut self,
        shown: &Shown<'_>,
        path: &str,
        sampling: Option<usize>,
        diagram: &mut Diagram,
    ) -> Option<usize> {
        let regions = shown.graph.regions.iter().enumerate();
        let same: Vec<usize> =
            regions.filter(|(_, r)| sampling.is_some() && r.sampling == sampling).map(|(i, _)| i).collect();
        let outer = match same[..] {
            [one] => self.of_region[one],
            _ => None,
        };
        self.within(shown, path, outer, diagram)
    }
}

/// A link of the drawing with its strokes and names.
fn bonds(
    shown: &Shown<'_>,
    what: What,
    link: &node::Link,
    (nodes, dependent): (&Nodes, &FxHashSet<ElementId>),
) -> Link {
    let model = &*shown.model;
    let mut all = Bonds { size: link.bonds.len(), ..Bonds::default() };
    let mut titles = Vec::new();
    for &i in &link.bonds {
        let b = &model.bonds[i];
        let stroke = if what == What::Graph { b.stroke } else { shown.causality.strokes.get(i).copied() };
        match stroke {
            Some(Stroke::Tail) => all.strokes[0] += 1,
            Some(Stroke::Head) => all.strokes[1] += 1,
            None => {}
        }
        all.sampled |= b.sampled;
        all.derivative |= [b.tail, b.head].iter().any(|id| dependent.contains(id));
        titles.push(name::bond(model, BondId(i as u32), stroke));
    }
    let first = &model.bonds[link.bonds[0]];
    let size = if link.bonds.len() > 1 { link.bonds.len().to_string() } else { String::new() };
    let (own, number) = (link.name.clone(), link.bonds[0] + 1);
    let labels = match shown.picture.labels {
        Labels::None => [own.unwrap_or(size), String::new()],
        Labels::Numbers if link.bonds.len() > 1 => {
            [format!("{number}..{}", link.bonds[link.bonds.len() - 1] + 1), String::new()]
        }
        Labels::Numbers => [number.to_string(), String::new()],
        Labels::Variables => variables(shown, first, link, nodes, number),
    };
    let end = |i: usize, id: ElementId| {
        let n = &nodes.list[i];
        let inner = model.element(id).name.strip_prefix(&n.name).and_then(|r| r.strip_prefix('.'));
        inner.filter(|_| n.is_part).unwrap_or_default().to_string()
    };
    let head = name::head_id(model, first);
    let (from, to) = (end(link.tail, first.tail), end(link.head, head));
    titles.truncate(12);
    Link {
        id: format!("bond.{}", number),
        title: titles.join("\n"),
        tail: link.tail,
        head: link.head,
        bonds: Some(all),
        labels,
        ports: [from, to],
    }
}

/// The effort and the flow of a link as they are read in the language: by its own name, or that of a one-port at one
/// of its ends, else by its number.
fn variables(shown: &Shown<'_>, b: &Bond, link: &node::Link, nodes: &Nodes, number: usize) -> [String; 2] {
    let model = &*shown.model;
    let one_port =
        |id: ElementId| matches!(model.element(id).kind, Kind::OnePort(_)) && model.element(id).field.is_none();
    let of = |i: usize| nodes.list[i].name.clone();
    let owner = match name::own_name(model, b) {
        Some(own) if link.bonds.len() == 1 => Some(own.to_string()),
        _ if one_port(b.head) => Some(of(link.head)),
        _ if one_port(b.tail) => Some(of(link.tail)),
        _ => None,
    };
    let name = |v: Variable| match &owner {
        Some(owner) => format!("{owner}.{}", v.letter()),
        None => format!("{}{number}", v.letter()),
    };
    [name(Variable::Effort), name(Variable::Flow)]
}
