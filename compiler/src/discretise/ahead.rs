//! Where the iteration of a `gonzalez` step starts: the changes of the last steps carried on.
//!
//! The state keeps each state's last three changes d, d', d'', and one over the length of the last step. Where all
//! steps are of one length, the next change is foretold as 3 d - 3 d' + d'', the parabola through them; else as q d,
//! with q the length of the step over that of the last one, and what is kept is stretched likewise.
//! Where that is far from the last change, beside the two before, steps are too long for it, and none is made.
//! It is a guess and no more: the iteration that fails from there, or does not converge at once, starts from no change.

use super::cluster::Cluster;
use super::gonzalez;
use crate::expression::Pool;
use crate::structure::Form;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::solve::quick::UNKNOWNS;

/// Over so many lengths of the last step its change is carried on.
const REACH: f64 = 2.5;
/// Numbers that are kept of each state.
const KEPT: usize = 3;

/// How many numbers a cluster keeps for it: none where its equations are linear, or too many.
pub(super) fn memory(c: &Cluster, pool: &mut Pool, form: &Form) -> usize {
    let n = c.states.len();
    if n == 0 || n + c.loops.len() > UNKNOWNS {
        return 0;
    }
    let map = gonzalez::midpoint(c, pool, form);
    let flat = c.flat(pool, map);
    let (unknowns, residuals) = gonzalez::system(c, pool, &flat);
    let linear = residuals.into_iter().all(|r| {
        let slopes = pool.derivatives(r, &unknowns);
        slopes.into_iter().all(|k| !pool.contains_any(k, &|s| unknowns.contains(&s)))
    });
    if linear { 0 } else { KEPT * n + 1 }
}

/// What was kept, and what it foretells.
pub(super) struct Ahead {
    /// For each state its last changes, as they would be over the length of this step.
    kept: Vec<[Value; 2]>,
    /// One over the step's length.
    inverse: Value,
    /// The changes.
    pub(super) start: Vec<Value>,
}

impl Ahead {
    /// Reads what was kept; None where nothing is.
    pub(super) fn new(b: &mut Builder, c: &Cluster, h: Value) -> Option<Self> {
        let n = c.states.len();
        if c.memory != KEPT * n + 1 {
            return None;
        }
        let first = b.slots(Array::State, c.memory).index as usize;
        let slot = |i: usize| Slot::new(Array::State, first + i);
        let (zero, one, three, reach) = (b.number(0.0), b.number(1.0), b.number(3.0), b.number(REACH));
        let past = b.load(slot(KEPT * n));
        let inverse = b.div(one, h);
        let same = b.binary(Binary::Eq, past, inverse);
        let ratio = b.mul(h, past);
        let near = b.binary(Binary::Le, ratio, reach);
        let ratio = b.select(near, ratio, zero);
        let ratio = b.select(same, one, ratio);
        let (mut kept, mut start) = (Vec::new(), Vec::new());
        let (half, mut even) = (b.number(0.5), one);
        for i in 0..n {
            let [d, d1, d2] = [0, 1, 2].map(|k| b.load(slot(KEPT * i + k)));
            let (line, before) = (b.mul(ratio, d), b.mul(ratio, d1));
            // Of the last change as little as can be waits for it.
            let (thrice, bend) = (b.mul(three, d), b.mul(three, d1));
            let bend = b.sub(d2, bend);
            let curve = b.add(thrice, bend);
            // Steps far longer than what they go through change from one to the next as they like.
            let bent = b.select(same, curve, line);
            let last = b.select(same, d, before);
            let off = b.sub(bent, last);
            let (off, x, y) = (b.unary(Unary::Abs, off), b.unary(Unary::Abs, d1), b.unary(Unary::Abs, d2));
            let sum = b.add(x, y);
            let most = b.mul(half, sum);
            let within = b.binary(Binary::Le, off, most);
            even = b.mul(even, within);
            start.push(bent);
            kept.push([line, before]);
        }
        let start = start.into_iter().map(|x| b.select(even, x, zero)).collect();
        Some(Self { kept, inverse, start })
    }

    /// Keeps the changes of this step.
    pub(super) fn keep(&self, b: &mut Builder, c: &Cluster, changes: &[Value]) {
        let at = c.memory_at();
        for (i, (change, [d, d1])) in changes.iter().zip(&self.kept).enumerate() {
            for (k, v) in [change, d, d1].into_iter().enumerate() {
                b.store(Slot::new(Array::Next, at + KEPT * i + k), *v);
            }
        }
        b.store(Slot::new(Array::Next, at + KEPT * self.kept.len()), self.inverse);
    }
}
