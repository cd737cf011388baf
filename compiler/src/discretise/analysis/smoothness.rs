//! Whether the laws of a cluster are smooth: kinks, jumps, branches and roots in them.

use crate::discretise::cluster::{self, Cluster};
use crate::expression::{Expr, Node, Pool};
use crate::structure::Output;
use bond_runtime::ir::{Binary, Unary};

/// All that a step is solved for: laws, sources, rates and slopes of energies. What probes integrate is not.
pub(crate) fn laws(c: &Cluster) -> Vec<Expr> {
    let energies = c.groups.iter().flat_map(|g| g.coenergy.iter().copied());
    let nodes = c.nodes.iter().flat_map(|n| n.how.expressions());
    energies.chain(nodes).chain(c.states.iter().map(|s| s.rate)).collect()
}

/// Whether a law is a curve with corners, as that of dry friction.
pub(crate) fn is_non_smooth(c: &Cluster) -> bool {
    c.nodes.iter().any(|n| n.has_branches())
}

/// Whether something has a kink or a jump.
pub(crate) fn is_kink(n: &Node) -> bool {
    match n {
        Node::Select(..) => true,
        Node::Unary(f, _) => matches!(f, Unary::Abs | Unary::Sign | Unary::Floor | Unary::Not),
        Node::Binary(f, ..) => !matches!(f, Binary::Atan2 | Binary::Pow),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Power(..) => false,
    }
}

/// Whether a law that is solved for what it is given has no slope at 0, so that its inverse is a root.
pub(crate) fn is_flat(n: &cluster::Node, pool: &mut Pool) -> bool {
    // The multiplier of a constraint is no law.
    let (Output::Implicit { residual: e, .. }, None) = (n.how, n.constraint()) else { return false };
    let (slope, zero) = (pool.derivative(e, n.out), pool.int(0));
    let slope = pool.substitute(slope, &std::iter::once((n.out, zero)).collect());
    pool.is_zero(slope)
}

/// Whether a law gives the root of what it is given, up to 0, as an orifice does.
pub(crate) fn empties(c: &Cluster, pool: &mut Pool) -> bool {
    let rooted = |n: &Node| match n {
        Node::Product(_, factors) => {
            factors.iter().any(|(base, n)| (f64::EPSILON..1.0).contains(&n.to_f64()) && pool.any_node(*base, &is_kink))
        }
        _ => false,
    };
    let written = c.nodes.iter().flat_map(|n| n.how.expressions()).any(|e| pool.any_node(e, &rooted));
    written || c.nodes.iter().any(|n| is_flat(n, pool))
}

/// How many laws of a cluster are vertical on one branch and horizontal on another: a diode that drops a fixed voltage
/// and blocks, dry friction. What several of them share in one loop none of them tells.
pub(crate) fn ideal_laws(c: &Cluster, pool: &mut Pool) -> usize {
    let mut count = 0;
    for n in &c.nodes {
        let Output::Curve { parameter, out, residual, bends: None, .. } = n.how else { continue };
        // The parameter is a bare number; corners are where it is about 1, or 0.
        let mut is_flat = |e: Expr| {
            let slope = pool.derivative(e, parameter);
            [-1e3, -1e-3, 1e-3, 1e3].iter().any(|s| {
                let there = pool.float(*s);
                let at = pool.substitute(slope, &std::iter::once((parameter, there)).collect());
                pool.is_zero(at)
            })
        };
        count += usize::from(is_flat(out) && is_flat(residual));
    }
    count
}

/// Whether something has a root, and so an infinite slope: beyond it a step may have no solution, however near.
pub(crate) fn is_root(n: &Node) -> bool {
    match n {
        Node::Product(_, pairs) => pairs.iter().any(|(_, n)| (f64::EPSILON..1.0).contains(&n.to_f64())),
        Node::Power(..) => true,
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
            false
        }
    }
}
