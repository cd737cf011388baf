//! Where the iteration of a `gonzalez` step starts: the changes of the last steps carried on.
//!
//! Of each state that the iteration solves for the last four changes are kept, d, d', d'', d''', and one over the
//! length of the last step. Where all steps are of one length, the next change is predicted as 4 d - 6 d' + 4 d'' -
//! d''', the cubic through them; else as q d, with q the length of the step over that of the last one, and what is kept
//! is stretched likewise. Where that is far from the last change, beside the last three, steps are too long for it, or
//! a law has switched, and none is made. A change on its way through 0 is on either side of it, and so not far. It is a
//! guess and no more: the iteration that fails from there, or does not converge at once, starts from no change.

use crate::discretise::cluster::Cluster;
use crate::discretise::equations::system::System;
use crate::discretise::equations::{discrete_gradient, newton};
use crate::model::Model;
use crate::structure::Form;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::solve::iteration::chord::MAX_UNKNOWNS;

/// Numbers that are kept of each state.
const KEPT: usize = 4;

/// The states of a cluster whose changes are predicted: those that its iteration solves for, or all where arguments of
/// exponentials start at what follows from them. None where its equations are linear, or too many.
pub(crate) fn predicted_states(c: &Cluster, model: &mut Model, form: &Form) -> Vec<usize> {
    let n = c.states.len();
    if n == 0 || n + c.loops.len() > MAX_UNKNOWNS {
        return Vec::new();
    }
    let pool = &mut model.pool;
    let map = discrete_gradient::midpoint(c, pool, form);
    let flat = c.flat(pool, map);
    let (unknowns, residuals) = discrete_gradient::system(c, pool, &flat);
    let linear = residuals.iter().all(|r| {
        let slopes = pool.derivatives(*r, &unknowns);
        slopes.into_iter().all(|k| !pool.contains_any(k, &|s| unknowns.contains(&s)))
    });
    if linear {
        return Vec::new();
    }
    if !c.exponential_arguments().is_empty() {
        return (0..n).collect();
    }
    let whole = discrete_gradient::keeps_coefficients(c, pool);
    let system =
        System { unknowns, residuals, h: c.h, exact_coefficients: whole, redundant: c.redundant, ..System::default() };
    let apart = !discrete_gradient::is_stiff(c, model, form);
    let solved = newton::solved_for(&mut model.pool, system, apart);
    (0..n).filter(|i| solved.contains(&c.delta[*i])).collect()
}

/// How many numbers are kept per number of states.
pub(crate) fn memory(states: usize) -> usize {
    if states == 0 { 0 } else { KEPT * states + 1 }
}

/// What was kept, and what is predicted from it.
pub(crate) struct Predictor {
    /// For each state that is predicted its last changes, as they would be over the length of this step.
    kept: Vec<[Value; KEPT - 1]>,
    /// One over the step's length.
    inverse: Value,
    /// The changes, those that are not predicted 0.
    pub(crate) start: Vec<Value>,
}

impl Predictor {
    /// Reads what was kept; None where nothing is.
    pub(crate) fn new(b: &mut Builder, c: &Cluster, h: Value) -> Option<Self> {
        let n = c.predicted.len();
        if n == 0 {
            return None;
        }
        let first = b.slots(Array::State, c.memory).index as usize;
        let slot = |i: usize| Slot::new(Array::State, first + i);
        let [zero, one, four, six] = [0.0, 1.0, 4.0, 6.0].map(|x| b.number(x));
        let (reach, far) = (b.number(c.thresholds.predictor.reach), b.number(c.thresholds.predictor.falling));
        let past = b.load(slot(KEPT * n));
        let inverse = b.div(one, h);
        let same = b.binary(Binary::Eq, past, inverse);
        let ratio = b.mul(h, past);
        let near = b.binary(Binary::Le, ratio, reach);
        let ratio = b.select(near, ratio, zero);
        let ratio = b.select(same, one, ratio);
        let (mut kept, mut start) = (Vec::new(), Vec::new());
        let mut even = one;
        for i in 0..n {
            let d: [Value; KEPT] = std::array::from_fn(|k| b.load(slot(KEPT * i + k)));
            let stretched = [0, 1, 2].map(|k| b.mul(ratio, d[k]));
            // Of the last change as little as can be waits for it.
            let (first, third, second) = (b.mul(four, d[0]), b.mul(four, d[2]), b.mul(six, d[1]));
            let before = b.sub(third, second);
            let before = b.sub(before, d[3]);
            let curve = b.add(first, before);
            // Steps far longer than what they go through change from one to the next as they like.
            let off = b.sub(curve, d[0]);
            let [off, last, second, third] = [off, d[0], d[1], d[2]].map(|x| b.unary(Unary::Abs, x));
            let size = b.add(second, third);
            let size = b.add(last, size);
            let most = b.mul(far, size);
            let within = b.binary(Binary::Le, off, most);
            even = b.mul(even, within);
            start.push(b.select(same, curve, stretched[0]));
            kept.push(stretched);
        }
        let mut all = vec![zero; c.states.len()];
        for (i, x) in c.predicted.iter().zip(start) {
            all[*i] = b.select(even, x, zero);
        }
        Some(Self { kept, inverse, start: all })
    }

    /// Keeps the changes of this step.
    pub(crate) fn keep(&self, b: &mut Builder, c: &Cluster, changes: &[Value]) {
        let at = c.memory_at();
        for (i, (state, before)) in c.predicted.iter().zip(&self.kept).enumerate() {
            for (k, v) in std::iter::once(&changes[*state]).chain(before).enumerate() {
                b.store(Slot::new(Array::Next, at + KEPT * i + k), *v);
            }
        }
        b.store(Slot::new(Array::Next, at + KEPT * self.kept.len()), self.inverse);
    }
}
