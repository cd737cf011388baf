//! How stiff a region is beside an explicit step, told by the step itself (Hairer and Wanner, *Solving Ordinary
//! Differential Equations II*, 2nd ed., IV.2): the last stage and the end of a step stand at one instant, in states
//! that differ by the method's error. So
//!
//! ```text
//! h |f(x) - f(y)| / |x - y|,   y the state of the last stage, x that at the end
//! ```
//!
//! is about the step times the largest eigenvalue of the region, along which errors lie. Rates at the end are those of
//! the next step's first stage, which tells it. In the norms each state counts by its largest effort, as in
//! [`super::projection`]: all terms are energies, or powers. Where no energy is put back, each counts by its own size.

use crate::discretise::cluster::Cluster;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};

/// How many numbers are kept: the state and the rates of the last stage, and the length of the step.
pub(crate) fn memory(c: &Cluster) -> usize {
    2 * c.states.len() + 1
}

/// By what each state counts where no energy measures it: one over the larger of its values at the start and at the
/// last stage.
pub(crate) fn own_sizes(b: &mut Builder, (first, last): (&[Value], &[Value])) -> Vec<(usize, Value)> {
    let (zero, one) = (b.number(0.0), b.number(1.0));
    let mut sizes = Vec::new();
    for (i, (x, y)) in first.iter().zip(last).enumerate() {
        let [x, y] = [x, y].map(|v| b.unary(Unary::Abs, *v));
        let size = b.binary(Binary::Max, x, y);
        let is_known = b.binary(Binary::Lt, zero, size);
        let inverse = b.div(one, size);
        sizes.push((i, b.select(is_known, inverse, zero)));
    }
    sizes
}

/// What a step begins with and what its last stage found.
pub(crate) struct Stages<'a> {
    /// State and rates at the start.
    pub(crate) first: (&'a [Value], &'a [Value]),
    /// State and rates at the last stage.
    pub(crate) last: (&'a [Value], &'a [Value]),
    /// The largest effort of each state that counts.
    pub(crate) sizes: &'a [(usize, Value)],
}

/// The ratio, of the step before this one, and what is kept for the next; `first` is the first slot of what was kept.
pub(crate) fn ratio(b: &mut Builder, stages: &Stages, h: Value, first: usize) -> (Value, Vec<Value>) {
    let n = stages.first.0.len();
    let zero = b.number(0.0);
    let (mut rates, mut states) = (zero, zero);
    for (i, size) in stages.sizes {
        for (now, at, sum) in
            [(stages.first.0[*i], first + i, &mut states), (stages.first.1[*i], first + n + i, &mut rates)]
        {
            let before = b.load(Slot::new(Array::State, at));
            let off = b.sub(now, before);
            let off = b.mul(*size, off);
            let square = b.mul(off, off);
            *sum = b.add(*sum, square);
        }
    }
    let length = b.load(Slot::new(Array::State, first + 2 * n));
    let square = b.div(rates, states);
    let is_told = b.binary(Binary::Lt, zero, states);
    let square = b.select(is_told, square, zero);
    let root = b.unary(Unary::Sqrt, square);
    let kept = stages.last.0.iter().chain(stages.last.1).copied().chain([h]).collect();
    (b.mul(length, root), kept)
}
