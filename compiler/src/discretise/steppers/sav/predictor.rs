//! The predictor of a step: where its middle lies, by extrapolation of the last two.

use crate::discretise::analysis::initial_loops;
use crate::discretise::cluster::Cluster;
use crate::discretise::equations::inputs::Inputs;
use crate::expression::{Expr, Lowering, Pool, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Value};
use rustc_hash::FxHashMap;

/// What is kept of the last steps, by its place in the memory.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    /// Mean rates of the states in the last step, then those in the one before.
    pub(crate) rates: [usize; 2],
    /// What loops were in the step before the last.
    pub(crate) loops: usize,
    /// Lengths of the last two steps; 0 where there was none.
    pub(crate) lengths: [usize; 2],
    /// Energy of each auxiliary and what rounding took from it.
    pub(crate) auxiliaries: usize,
    /// The largest energy of each region so far.
    pub(crate) sizes: usize,
    /// How many numbers.
    pub(crate) len: usize,
}

impl Layout {
    pub(crate) fn new(c: &Cluster, auxiliaries: usize) -> Self {
        let n = c.states.len();
        let lengths = 2 * n + c.loops.len();
        let auxiliaries_at = lengths + 2;
        let sizes = auxiliaries_at + 2 * auxiliaries;
        Self {
            rates: [0, n],
            loops: 2 * n,
            lengths: [lengths, lengths + 1],
            auxiliaries: auxiliaries_at,
            sizes,
            len: sizes + c.regions.len(),
        }
    }
}

/// A step as it is predicted.
pub(crate) struct Prediction {
    /// What was kept, in order.
    pub(crate) memory: Vec<Value>,
    /// Change of each state.
    pub(crate) changes: Vec<Value>,
    /// What the loops are.
    pub(crate) loops: Vec<Value>,
    /// What everything is in the middle: states, time, loops, and the outputs of the laws as they are.
    pub(crate) star: FxHashMap<Symbol, Expr>,
}

impl Prediction {
    /// Reads the memory, and predicts.
    pub(crate) fn new(
        c: &Cluster,
        (pool, form): (&mut Pool, &Form),
        b: &mut Builder,
        lowering: &mut Lowering,
        inputs: &Inputs,
        layout: Layout,
    ) -> Self {
        let first = b.slots(Array::State, layout.len).index as usize;
        let memory: Vec<Value> = (0..layout.len).map(|i| b.load(Slot::new(Array::State, first + i))).collect();
        let (zero, half, reach) = (b.number(0.0), b.number(0.5), b.number(c.thresholds.predictor.reach));
        let [last, before] = layout.lengths.map(|i| memory[i]);
        let two_done = b.binary(Binary::Lt, zero, before);
        let most = b.mul(reach, last);
        let near = b.binary(Binary::Le, inputs.h, most);
        let both = b.binary(Binary::And, two_done, near);
        // Means over the steps belong to their middles.
        let (ahead, behind) = (b.add(inputs.h, last), b.add(last, before));
        let way = b.div(ahead, behind);
        let way = b.select(both, way, zero);
        let carry_on = |b: &mut Builder, x: Value, y: Value| {
            let rise = b.sub(x, y);
            let more = b.mul(way, rise);
            b.add(x, more)
        };
        let mut changes = Vec::new();
        for i in 0..c.states.len() {
            let rate = carry_on(b, memory[layout.rates[0] + i], memory[layout.rates[1] + i]);
            changes.push(b.mul(inputs.h, rate));
        }
        let loops: Vec<Value> =
            inputs.guesses.iter().enumerate().map(|(i, z)| carry_on(b, *z, memory[layout.loops + i])).collect();
        let mut map: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for ((s, x), d) in c.states.iter().zip(&inputs.states).zip(&changes) {
            let there = b.mul(half, *d);
            let there = b.add(*x, there);
            let symbol = pool.symbol(&format!("{} predicted", s.name));
            lowering.bind(symbol, there);
            map.insert(s.symbol, pool.var(symbol));
        }
        for (z, v) in c.loops.iter().zip(&loops) {
            let symbol = pool.symbol(&format!("{} predicted", pool.name(*z)));
            lowering.bind(symbol, *v);
            map.insert(*z, pool.var(symbol));
        }
        middle(c, pool, &mut map);
        let outs: Vec<(Symbol, Expr)> = c
            .groups
            .iter()
            .flat_map(|g| g.states.iter().zip(&g.coenergy))
            .filter_map(|(s, z)| Some((form.column(c.states[*s].column?).out, pool.substitute(*z, &map))))
            .collect();
        map.extend(outs);
        let star = c.flat(pool, map);
        Self { memory, changes, loops, star }
    }
}

/// The rates of the states at the start, by which the first step is predicted; 0 where they are not finite. Nothing
/// comes in at ports yet.
pub(crate) fn rates(c: &Cluster, model: &mut Model, form: &Form) -> Result<Vec<f64>, Vec<Diagnostic>> {
    let loops = initial_loops::guesses(c, model, form)?;
    let flat = c.flat_at_instant(&mut model.pool, form);
    let rates: Vec<Expr> = c.states.iter().map(|s| model.pool.substitute(s.rate, &flat)).collect();
    let mut known: FxHashMap<Symbol, f64> = c.loops.iter().copied().zip(loops).collect();
    known.extend(c.states.iter().map(|s| (s.symbol, s.initial)));
    known.extend(c.inputs.iter().map(|(i, u, _)| (*u, model.inputs[*i].value)));
    let found = model.pool.eval_all(&rates, &|s| known.get(&s).copied().unwrap_or(0.0));
    Ok(found.into_iter().map(|x| if x.is_finite() { x } else { 0.0 }).collect())
}

/// Time and what is given from outside, in the middle of the step.
pub(crate) fn middle(c: &Cluster, pool: &mut Pool, map: &mut FxHashMap<Symbol, Expr>) {
    let (Some(t), Some(h)) = (c.time, c.h) else { return };
    let (te, he, half) = (pool.var(t), pool.var(h), pool.ratio(1, 2));
    let ahead = pool.mul(half, he);
    map.insert(t, pool.add(te, ahead));
    for &(_, u, du) in &c.inputs {
        let (ue, due) = (pool.var(u), pool.var(du));
        let gone = pool.mul(ahead, due);
        map.insert(u, pool.add(ue, gone));
    }
}
