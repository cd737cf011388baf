//! What moves what through modulated transformers (ratios that change), and where their ratios are divided by.

use crate::expression::{Expr, Node, Pool, Sign, Symbol};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Signal, Variable};
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use petgraph::unionfind::UnionFind;

/// The graph in parts, cut at the ratios that change with states. Within a part flows follow from one another by
/// constants; from one part to the next by a product with such a ratio, and back by a division, which may be by 0.
pub(super) struct Parts {
    /// The part that each element stands in.
    part: Vec<usize>,
    /// Of a part that moves others: how many of those come before it, those that move it among them.
    turn: Vec<Option<usize>>,
    /// What stands at a changing ratio, on the side from where it moves the other one.
    direct: Vec<bool>,
}

/// Whether a ratio changes with states, and if so, whether the flow at its head is the flow at its tail multiplied by
/// what changes, and not divided by it.
fn along(model: &Model, id: ElementId) -> Option<bool> {
    let Law::Ratio(v) = model.element(id).law else { return None };
    let is_state = |s: Symbol| matches!(model.signals.get(&s), Some(Signal::State(_)));
    if model.element(id).kind == Kind::TF { multiplies(&model.pool, v, &is_state) } else { None }
}

/// Whether a ratio changes with some symbols, and if so, whether it is to be multiplied by, rather than divided.
fn multiplies(pool: &Pool, ratio: Expr, symbols: &dyn Fn(Symbol) -> bool) -> Option<bool> {
    if !pool.contains_any(ratio, symbols) {
        return None;
    }
    let Node::Product(_, factors) = pool.node(ratio) else { return Some(true) };
    let changing = || factors.iter().filter(|t| pool.contains_any(t.0, symbols));
    Some(changing().any(|t| t.1.to_f64() > 0.0))
}

/// The same of a ratio that changes with anything, and may pass 0.
pub(super) fn changes(model: &Model, id: ElementId) -> Option<bool> {
    let Law::Ratio(v) = model.element(id).law else { return None };
    let changing = multiplies(&model.pool, v, &|s| model.signals.contains_key(&s))?;
    let sign = model.pool.sign(v, &|_| Sign::Unknown);
    (!matches!(sign, Sign::Positive | Sign::Negative)).then_some(changing)
}

/// Whether what a transformer or gyrator gives to one of its bonds is divided by a ratio that may pass 0.
pub(super) fn divides(model: &Model, id: ElementId, bond: BondId, gives: Variable) -> bool {
    // Of a TF the flow at the head is the ratio times that at the tail, and of efforts the other way round.
    let product = match model.element(id).kind {
        Kind::TF if model.bond(bond).tail == id => Variable::Flow,
        _ => Variable::Effort,
    };
    changes(model, id).is_some_and(|multiplies| (gives == product) != multiplies)
}

/// Whether any ratio changes with states.
pub(crate) fn moves(model: &Model) -> bool {
    model.ids().any(|(id, _)| along(model, id).is_some())
}

impl Parts {
    pub(super) fn of(model: &Model, graph: &BondGraph) -> Self {
        let n = model.elements.len();
        let ratios: Vec<Option<bool>> = model.ids().map(|(id, _)| along(model, id)).collect();
        let mut sets = UnionFind::<usize>::new(n);
        for b in model.bonds.iter().filter(|b| !b.sampled) {
            let cut = |id: ElementId| ratios[id.at()].is_some() || model.element(id).kind == Kind::GY;
            if !cut(b.tail) && !cut(b.head) {
                sets.union(b.tail.at(), b.head.at());
            }
        }
        let part = sets.into_labeling();
        let mut moved: Graph<(), ()> = Graph::new();
        (0..n).for_each(|_| _ = moved.add_node(()));
        let mut direct = vec![false; n];
        for (id, along) in model.ids().filter_map(|(id, _)| Some((id, ratios[id.at()]?))) {
            let far = |points_in: bool| {
                let bond = |b: &&BondId| (model.bond(**b).head == id) == points_in;
                graph.bonds_of[id.at()].iter().find(bond).map(|b| model.bond(*b).other(id).at())
            };
            if let (Some(from), Some(to)) = (far(along), far(!along)) {
                moved.add_edge(NodeIndex::new(part[from]), NodeIndex::new(part[to]), ());
                direct[from] = true;
            }
        }
        let mut turn = vec![None; n];
        // Components come with those first that others move.
        for (i, node) in petgraph::algo::kosaraju_scc(&moved).into_iter().rev().flatten().enumerate() {
            turn[node.index()] = moved.neighbors(node).next().map(|_| i);
        }
        Self { part, turn, direct }
    }

    /// When an inertia, or a junction, has its turn among those that move others; last where it moves none.
    pub(super) fn turn(&self, model: &Model, id: ElementId) -> usize {
        let turn = self.turn[self.part[id.at()]].unwrap_or(usize::MAX);
        if matches!(model.element(id).kind, Kind::I | Kind::ONE) { turn } else { usize::MAX }
    }

    /// Whether a ratio that changes is bonded to an element which moves something by it.
    pub(super) fn is_direct(&self, id: ElementId) -> bool {
        self.direct[id.at()]
    }
}
