//! How fast what moves in time alone swings: steps that are fitted to a tolerance have to look at least so often.

use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Node};
use crate::model::Model;
use bond_runtime::ir::Unary;
use std::cell::RefCell;
use std::f64::consts::PI;

/// Where in the run a rate that changes is looked at.
const LOOKS: u32 = 61;

/// The shortest period of a sine, cosine or tangent of time, or time between the jumps of `floor`, s; where its
/// argument is no straight line in time, the shortest that is found in a run to `stop`.
pub(crate) fn fastest_period(c: &Cluster, model: &mut Model, laws: &[Expr], stop: f64) -> Option<f64> {
    let time = c.time?;
    let found: RefCell<Vec<(Expr, f64)>> = RefCell::default();
    for law in laws.iter().filter(|e| model.pool.contains(**e, time)) {
        model.pool.any_node(*law, &|n| {
            match n {
                Node::Unary(Unary::Sin | Unary::Cos | Unary::Tan, a) => found.borrow_mut().push((*a, 1.0)),
                Node::Unary(Unary::Floor, a) => found.borrow_mut().push((*a, 2.0 * PI)),
                _ => {}
            }
            false
        });
    }
    let mut arguments = found.into_inner();
    arguments.sort_unstable_by_key(|a| a.0);
    arguments.dedup();
    let mut fastest = 0.0f64;
    for (a, turn) in arguments.into_iter().filter(|a| model.pool.contains(a.0, time)).collect::<Vec<_>>() {
        let rate = model.pool.derivative(a, time);
        if model.pool.symbols(rate).iter().any(|s| *s != time) {
            continue;
        }
        for k in 0..=LOOKS {
            let t = stop * f64::from(k) / f64::from(LOOKS);
            let x = turn * model.pool.eval(rate, &|_| t).abs();
            if x.is_finite() {
                fastest = fastest.max(x);
            }
        }
    }
    (fastest > 0.0).then(|| 2.0 * PI / fastest).filter(|p| *p > 0.0)
}
