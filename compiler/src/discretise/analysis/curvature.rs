//! How the energies of a cluster bend.

use crate::discretise::cluster::Cluster;
use crate::expression::Expr;
use crate::model::Model;
use bond_runtime::ir::Unary;

/// |d2H/dx2| of each state, the weights of an iteration.
pub(crate) fn curvatures(c: &Cluster, model: &mut Model) -> Vec<Expr> {
    let mut list = vec![model.pool.int(0); c.states.len()];
    for g in &c.groups {
        for (s, z) in g.states.iter().zip(&g.coenergy) {
            let k = model.pool.derivative(*z, c.states[*s].symbol);
            list[*s] = model.pool.unary(Unary::Abs, k);
        }
    }
    list
}
