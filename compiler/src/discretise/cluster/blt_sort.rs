//! The BLT sort (block lower triangular) of the outputs of a cluster: the order in which they are computed, and where
//! their loops are cut.

use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Pool, Symbol};
use crate::structure::Output;
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use rustc_hash::FxHashMap;

/// Loops of more nodes are not torn.
const TORN: usize = 32;

impl Cluster {
    /// Sorts the nodes, and finds those that form loops.
    pub(crate) fn blt_sort(&mut self, pool: &mut Pool) {
        self.steepen(pool);
        let places = self.nodes.iter().enumerate().flat_map(|(i, n)| [(n.out, i), (n.unknown(), i)]);
        let index: FxHashMap<Symbol, usize> = places.collect();
        let mut graph: Graph<(), ()> = Graph::new();
        for _ in &self.nodes {
            graph.add_node(());
        }
        let mut own = vec![false; self.nodes.len()];
        for (i, n) in self.nodes.iter().enumerate() {
            for s in n.how.expressions().flat_map(|e| pool.symbols(e)) {
                if let Some(&j) = index.get(&s) {
                    graph.add_edge(NodeIndex::new(i), NodeIndex::new(j), ());
                    own[i] |= i == j;
                }
            }
        }
        let mut order = Vec::new();
        let mut unknown = Vec::new();
        for component in petgraph::algo::kosaraju_scc(&graph) {
            let mut members: Vec<usize> = component.iter().map(|n| n.index()).collect();
            members.sort_unstable();
            let looped = members.len() > 1 || members.iter().any(|m| own[*m] || self.nodes[*m].how.is_root());
            if !looped {
                order.extend(members);
                continue;
            }
            for m in &members {
                let node = &mut self.nodes[*m];
                node.how = node.switched.unwrap_or(node.how);
            }
            let (torn, rest) = self.tear(&graph, &members, &own);
            unknown.extend(torn.iter().copied());
            order.extend(torn.into_iter().chain(rest));
        }
        self.loops = unknown.iter().map(|i| self.nodes[*i].unknown()).collect();
        self.nodes = order.iter().map(|i| self.nodes[*i].clone()).collect();
    }

    /// Has Newton solve for the argument of an exponential law (a diode's voltage), not for its output (the current),
    /// unless the output feeds the law back. Laws that receive the same share one argument.
    fn steepen(&mut self, pool: &mut Pool) {
        let mut found: FxHashMap<Expr, usize> = FxHashMap::default();
        let places: FxHashMap<Symbol, usize> = self.nodes.iter().enumerate().map(|(i, n)| (n.out, i)).collect();
        let turned: Vec<bool> = (0..self.nodes.len())
            .map(|i| match self.nodes[i].steep {
                Some(Output::Curve { out, .. }) => self.reaches(pool, &places, out, i),
                Some(Output::Explicit(_) | Output::Implicit { .. }) | None => false,
            })
            .collect();
        for i in 0..self.nodes.len() {
            let (Some(steep), Output::Explicit(_)) = (self.nodes[i].steep.take(), self.nodes[i].how) else { continue };
            let Output::Curve { parameter, out, residual, bends, .. } = steep else { continue };
            if turned[i] {
                continue;
            }
            let argument = pool.var(parameter);
            let input = pool.sub(argument, residual);
            let first = *found.entry(input).or_insert(i);
            if let Output::Curve { parameter: same, bends: all, .. } = &mut self.nodes[first].how
                && first != i
            {
                *all = all.zip(bends).map(|(a, b)| a.with(b));
                let map = FxHashMap::from_iter([(parameter, pool.var(*same))]);
                self.nodes[i].how = Output::Explicit(pool.substitute(out, &map));
            } else {
                self.nodes[i].how = steep;
            }
        }
    }

    /// Whether an expression depends on what a node gives, through others or by itself.
    fn reaches(&self, pool: &Pool, places: &FxHashMap<Symbol, usize>, e: Expr, goal: usize) -> bool {
        let mut seen = vec![false; self.nodes.len()];
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            for j in pool.symbols(e).iter().filter_map(|s| places.get(s).copied()) {
                if j == goal {
                    return true;
                }
                if !std::mem::replace(&mut seen[j], true) {
                    stack.extend(self.nodes[j].how.expressions());
                }
            }
        }
        false
    }

    /// Parts a loop into the nodes that an iteration finds and those that follow from them, in order. Small loops are
    /// torn at the laws that are roots anyhow, and at as few others as leave no loop; of large ones all are unknowns,
    /// which keeps the system sparse.
    pub(crate) fn tear(&self, graph: &Graph<(), ()>, members: &[usize], own: &[bool]) -> (Vec<usize>, Vec<usize>) {
        if members.len() > TORN {
            return (members.to_vec(), Vec::new());
        }
        let mut torn: Vec<usize> =
            members.iter().copied().filter(|m| self.nodes[*m].how.is_root() || own[*m]).collect();
        loop {
            let mut rest: Vec<usize> = members.iter().copied().filter(|m| !torn.contains(m)).collect();
            let mut done: Vec<usize> = Vec::new();
            loop {
                let ready = |m: &usize| {
                    graph.neighbors(NodeIndex::new(*m)).all(|j| !rest.contains(&j.index()) || done.contains(&j.index()))
                };
                let Some(at) = rest.iter().position(|m| !done.contains(m) && ready(m)) else { break };
                done.push(rest[at]);
            }
            rest.retain(|m| !done.contains(m));
            // A law that is not linear is the better place to cut.
            let curved = rest.iter().copied().find(|m| self.nodes[*m].curved);
            match curved.or(rest.first().copied()) {
                Some(cut) => torn.push(cut),
                None => {
                    torn.sort_unstable();
                    return (torn, done);
                }
            }
        }
    }
}
