//! Whether a partial assignment of strokes can be completed.
//!
//! A 0-junction receives its effort from just one bond, a 1-junction its flow; a TF receives effort at just one of its
//! two ports, a GY effort at its first or flow at its second. A bond brings effort to one end and flow to the other: to
//! a 0- and a 1-junction it brings what they need or it does not, to both alike; of two 0-junctions it serves just one.
//! So completions are the matchings of a graph that cover every junction, TF and GY, and a vertex in the middle of each
//! bond between two that need the same variable.

use super::assignment::Assignment;
use crate::model::{BondId, ElementId, Kind, TwoPort, Variable};
use petgraph::Undirected;
use petgraph::algo::maximum_matching;
use petgraph::graph::{Graph, NodeIndex};

/// What a bond has to bring to an end so that it serves it; nothing to an element with one port, which takes either.
fn need(a: &Assignment, bond: BondId, end: ElementId) -> Option<Variable> {
    match a.model.element(end).kind {
        Kind::Junction(common) => Some(common),
        Kind::TwoPort(TwoPort::Transformer) => Some(Variable::Effort),
        Kind::TwoPort(TwoPort::Gyrator) => {
            let first = a.graph.bonds_of[end.at()].first() == Some(&bond);
            Some(if first { Variable::Effort } else { Variable::Flow })
        }
        Kind::OnePort(_) => None,
    }
}

/// Whether the bonds that are still free can be given strokes.
pub(super) fn possible(a: &Assignment) -> bool {
    let mut graph: Graph<(), (), Undirected> = Graph::default();
    // Two copies, joined where a vertex need not be covered: all of both can be covered just where the rest of one can
    // be.
    let mut pair = || (graph.add_node(()), graph.add_node(()));
    let nodes: Vec<Option<(NodeIndex, NodeIndex)>> = (a.model.ids())
        .map(|(id, e)| {
            let waits = match e.kind {
                Kind::Junction(_) => !a.has_giver(id),
                Kind::TwoPort(_) => a.graph.bonds_of[id.at()].iter().any(|b| a.strokes[b.at()].is_none()),
                Kind::OnePort(_) => false,
            };
            waits.then(&mut pair)
        })
        .collect();
    for (i, bond) in a.model.bonds.iter().enumerate().filter(|(i, _)| a.strokes[*i].is_none()) {
        let id = BondId(i as u32);
        let ends = [bond.tail, bond.head].map(|end| nodes[end.at()].zip(need(a, id, end)));
        match ends {
            [Some((t, wants)), Some((h, other))] if wants != other => {
                graph.add_edge(t.0, h.0, ());
                graph.add_edge(t.1, h.1, ());
            }
            [Some((t, _)), Some((h, _))] => {
                for (t, h) in [(t.0, h.0), (t.1, h.1)] {
                    let middle = graph.add_node(());
                    graph.add_edge(t, middle, ());
                    graph.add_edge(middle, h, ());
                }
            }
            [Some((v, _)), None] | [None, Some((v, _))] => {
                let leaf = (graph.add_node(()), graph.add_node(()));
                graph.add_edge(v.0, leaf.0, ());
                graph.add_edge(v.1, leaf.1, ());
                graph.add_edge(leaf.0, leaf.1, ());
            }
            [None, None] => {}
        }
    }
    maximum_matching(&graph).is_perfect()
}
