//! The nodes of a drawing: a bundle is one, and a field, a line, a two-port by a matrix, a part that is not looked
//! into, whatever their ports; what the compiler added is none.

use super::modulation::is_modulated;
use super::name;
use crate::model::{Bond, Element, ElementId, Model, Part};
use rustc_hash::FxHashMap;

/// A node.
pub(super) struct Node {
    /// Its kind, `MTF`, or the model of a part.
    pub(super) kind: String,
    /// Its path, with the range of a bundle.
    pub(super) name: String,
    /// Its elements, in order.
    pub(super) members: Vec<ElementId>,
    /// Whether it is a part that is not looked into.
    pub(super) is_part: bool,
    /// Whether it is a bundle of elements.
    pub(super) is_bundle: bool,
}

/// Nodes in the order of their first elements.
pub(super) struct Nodes {
    /// The node of each element.
    pub(super) of: Vec<usize>,
    /// All of them.
    pub(super) list: Vec<Node>,
}

/// A path in which each entry of a bundle is called as the bundle: `s[1..3].spring`.
pub(super) fn bundled(model: &Model, path: &str) -> String {
    if model.bundles.is_empty() {
        return path.to_string();
    }
    let (mut whole, mut from) = (String::new(), 0);
    for end in path.match_indices('.').map(|m| m.0).chain([path.len()]) {
        let own = model.bundles.get(&path[..end]).and_then(|b| b.get(from..));
        whole.push_str(if from == 0 { "" } else { "." });
        whole.push_str(own.unwrap_or(&path[from..end]));
        from = end + 1;
    }
    whole
}

/// The parts that a path leads through, from the outermost; `arm[2,1]` is in the two-port `arm`.
fn parts_of<'m>(parts: &FxHashMap<&str, &'m Part>, path: &str) -> Vec<&'m Part> {
    let own = path.strip_suffix(']').and_then(|p| p.rfind('['));
    let entry = own.and_then(|i| parts.get(&path[..i]).copied()).filter(|p| p.matrix);
    path.match_indices('.').filter_map(|(i, _)| parts.get(&path[..i]).copied()).chain(entry).collect()
}

/// The parts of a model by their paths.
fn parts(model: &Model) -> FxHashMap<&str, &Part> {
    model.parts.iter().map(|p| (p.name.as_str(), p)).collect()
}

/// The nodes of a model. Parts that are nested deeper than this are one node each.
pub(super) fn nodes(model: &Model, depth: usize) -> Nodes {
    let mut nodes = Nodes { of: vec![0; model.elements.len()], list: Vec::new() };
    let parts = parts(model);
    // A name may stand for several nodes: the field `a` and the element `a` of a part with the same name.
    let mut known: FxHashMap<(String, u8), usize> = FxHashMap::default();
    for (id, e) in model.ids().filter(|(_, e)| !e.added) {
        let through = parts_of(&parts, &e.name);
        let plain = |p: &&Part| !p.matrix;
        let closed = through.iter().copied().filter(plain).nth(depth);
        let matrix = through.iter().copied().find(|p| p.matrix);
        let (kind, path, what) = match (closed, matrix, e.field, e.line) {
            (Some(part), ..) | (None, Some(part), ..) => (part.kind.clone(), part.name.as_str(), u8::from(part.matrix)),
            (_, _, Some((f, _)), _) => (model.fields[f].kind.clone(), model.fields[f].name.as_str(), 2),
            (_, _, _, Some(line)) => ("TL".into(), model.lines[line].name.as_str(), 3),
            (_, _, None, None) => (name::kind(model, e), e.name.as_str(), 4),
        };
        let name = bundled(model, path);
        let at = *known.entry((name.clone(), what)).or_insert(nodes.list.len());
        nodes.of[id.at()] = at;
        if at == nodes.list.len() {
            let is_bundle = what == 4 && model.bundles.contains_key(path);
            nodes.list.push(Node { kind, name, members: Vec::new(), is_part: what == 0, is_bundle });
        }
        let node = &mut nodes.list[at];
        node.members.push(id);
        // One that signals drive has them all be called so.
        if what != 0 && !node.kind.starts_with('M') && is_modulated(model, e) {
            node.kind.insert(0, 'M');
        }
    }
    // A junction that was put into a bond counts as where the bond goes on to.
    let (within, leaves): (Vec<&Bond>, Vec<&Bond>) =
        model.bonds.iter().filter(|b| hidden(model, b)).partition(|b| !model.element(b.head).added);
    within.iter().for_each(|b| nodes.of[b.tail.at()] = nodes.of[b.head.at()]);
    leaves.iter().for_each(|b| nodes.of[b.head.at()] = nodes.of[b.tail.at()]);
    nodes
}

/// Each element as a node of its own.
pub(super) fn all(model: &Model) -> Nodes {
    let list = model.ids().map(|(id, e)| Node {
        kind: name::kind(model, e),
        name: e.name.clone(),
        members: vec![id],
        is_part: false,
        is_bundle: false,
    });
    Nodes { of: (0..model.elements.len()).collect(), list: list.collect() }
}

/// Whether a bond is not drawn: it leads to or from what the compiler added, and is not the first part of a bond that
/// this was put into.
pub(super) fn hidden(model: &Model, b: &Bond) -> bool {
    let head = model.element(b.head);
    model.element(b.tail).added || head.added && !head.kind.is_junction()
}

/// Bonds that are drawn as one.
pub(super) struct Link {
    /// The node where they start.
    pub(super) tail: usize,
    /// The node where they end.
    pub(super) head: usize,
    /// Their places in the model.
    pub(super) bonds: Vec<usize>,
    /// What they are called: the name that the user gave, the port of a field, the entry of a bundle.
    pub(super) name: Option<String>,
}

/// The lines of a drawing: those of a bundle are one, and those within a node none.
pub(super) fn links(model: &Model, nodes: &Nodes) -> Vec<Link> {
    let mut list: Vec<Link> = Vec::new();
    let mut known: FxHashMap<(String, String, bool), usize> = FxHashMap::default();
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| !hidden(model, b)) {
        let (tail, head) = (model.element(b.tail), name::head(model, b));
        let (from, to) = (nodes.of[b.tail.at()], nodes.of[b.head.at()]);
        if from == to {
            continue;
        }
        let ends = [tail, head].map(|e| bundled(model, &e.name));
        let is_bundle = ends[0] != tail.name || ends[1] != head.name;
        let next = list.len();
        let at = if is_bundle {
            let [tail, head] = ends;
            *known.entry((tail, head, b.sampled)).or_insert(next)
        } else {
            next
        };
        if at == next {
            list.push(Link { tail: from, head: to, bonds: Vec::new(), name: None });
        }
        list[at].bonds.push(i);
    }
    for link in &mut list {
        link.name = match link.bonds[..] {
            [one] => bond_name(model, &model.bonds[one], [&nodes.list[link.tail], &nodes.list[link.head]]),
            _ => None,
        };
    }
    list
}

/// What a bond is called in a drawing: its name, else the port of the field, line or two-port where it ends, else the
/// entry of the bundle.
fn bond_name(model: &Model, b: &Bond, ends: [&Node; 2]) -> Option<String> {
    let port = |e: &Element| {
        let path =
            model.parts.iter().find(|p| p.matrix && e.name.strip_prefix(&p.name).is_some_and(|r| r.starts_with('.')));
        let of_field = e.field.is_some() || e.line.is_some() || path.is_some();
        of_field.then(|| e.name.rsplit_once('.').map_or(e.name.clone(), |n| n.1.to_string()))
    };
    let entry = |e: &Element, node: &Node| {
        let whole = node.is_bundle && node.members.len() > 1;
        whole.then(|| e.name.rfind('[').map(|i| e.name[i..].to_string())).flatten()
    };
    let (tail, head) = (model.element(b.tail), name::head(model, b));
    let own = name::own_name(model, b).map(str::to_string);
    let open = |e: &Element, node: &Node| if node.is_part { None } else { port(e) };
    own.or_else(|| open(head, ends[1]))
        .or_else(|| open(tail, ends[0]))
        .or_else(|| entry(tail, ends[0]))
        .or_else(|| entry(head, ends[1]))
}
