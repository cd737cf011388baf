//! The values that a step program starts from, and how states are advanced.

use crate::discretise::cluster::{Cluster, Line, missing};
use crate::expression::{Expr, Lowering, Pool, Symbol};
use crate::model::Model;
use crate::structure::{Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{self, Array, Builder, Slot, Unary, Value};
use bond_runtime::scene::GIVEN;
use rustc_hash::{FxHashMap, FxHashSet};

/// The values that a program starts from.
pub(crate) struct Inputs {
    pub(crate) t: Value,
    pub(crate) h: Value,
    pub(crate) states: Vec<Value>,
    pub(crate) integrals: Vec<Value>,
    pub(crate) guesses: Vec<Value>,
    /// What rounding took from each state.
    pub(crate) carries: Vec<Slot>,
    /// For each state a trace of the largest value it had.
    pub(crate) traces: Vec<Slot>,
    /// Value at the start of the step and slope of what is given from outside.
    pub(crate) given: Vec<(Value, Value)>,
    pub(crate) env: Vec<(Symbol, Value)>,
}

/// Declares a program's inputs and state, and loads them.
pub(crate) fn inputs(b: &mut Builder, c: &Cluster, form: &Form, model: &Model) -> Inputs {
    let t = b.named(Array::Input, "t");
    let h = b.named(Array::Input, "h");
    let mut env = Vec::new();
    for p in &c.ports {
        let slot = b.named(Array::Input, form.column(*p).name.clone());
        env.push((form.column(*p).out, slot));
    }
    for s in &c.foreign {
        env.push((*s, b.named(Array::Input, model.pool.name(*s))));
    }
    let given: Vec<Slot> = c
        .inputs
        .iter()
        .flat_map(|(_, u, _)| ["value", "slope", "since"].map(|what| format!("{what}({})", model.pool.name(*u))))
        .map(|name| b.named(Array::Input, name))
        .collect();
    for s in c.lines.iter().flat_map(Line::slots) {
        env.push((s, b.named(Array::Input, model.pool.name(s))));
    }
    let traces: Vec<Slot> = c.states.iter().map(|s| b.named(Array::Input, format!("trace({})", s.name))).collect();
    let states: Vec<Slot> = c.states.iter().map(|s| b.named(Array::State, s.name.clone())).collect();
    let integrals: Vec<Slot> = c.integrals.iter().map(|i| b.named(Array::State, model.pool.name(i.symbol))).collect();
    let guesses: Vec<Slot> = c.loops.iter().map(|z| b.named(Array::State, model.pool.name(*z))).collect();
    let carries: Vec<Slot> = c.states.iter().map(|s| b.named(Array::State, format!("carry({})", s.name))).collect();
    let (t, h) = (b.load(t), b.load(h));
    let mut env: Vec<(Symbol, Value)> = env.into_iter().map(|(s, slot)| (s, b.load(slot))).collect();
    if let (Some(time), Some(step)) = (c.time, c.h) {
        env.push((time, t));
        env.push((step, h));
    }
    let given: Vec<(Value, Value)> = given
        .chunks_exact(GIVEN)
        .map(|slots| {
            let (value, slope, since) = (b.load(slots[0]), b.load(slots[1]), b.load(slots[2]));
            let past = b.sub(t, since);
            let gone = b.mul(slope, past);
            (b.add(value, gone), slope)
        })
        .collect();
    env.extend(c.inputs.iter().zip(&given).flat_map(|((_, u, du), (x, dx))| [(*u, *x), (*du, *dx)]));
    let load = |b: &mut Builder, list: &[Slot]| -> Vec<Value> { list.iter().map(|s| b.load(*s)).collect() };
    let (states, integrals, guesses) = (load(b, &states), load(b, &integrals), load(b, &guesses));
    env.extend(c.states.iter().map(|s| s.symbol).zip(states.iter().copied()));
    env.extend(c.integrals.iter().map(|i| i.symbol).zip(integrals.iter().copied()));
    Inputs { t, h, states, integrals, guesses, carries, traces, given, env }
}

/// Whether a step has so many states that it does not wait for one of them, see [`advance`].
pub(crate) fn is_many(c: &Cluster) -> bool {
    c.states.len() >= 32
}

/// `x + change` and what rounding takes from it, which is added to the next change (Kahan): without that a state at
/// rest under a flow of energy is off by up to half a digit, and so is each step's balance, always to the same side. A
/// carry from when the state was much larger than it is now is dropped, since the change takes no account of it: a
/// contact that begins after a long way has next to no energy, and what is no rounding beside it.
///
/// Where the change is known but for `low`, that and what of the carry has no place beside the change are kept too.
/// Of `many` states a step has so much to do that it does not wait for one of them.
pub(crate) fn advance(
    b: &mut Builder,
    x: Value,
    (change, low): (Value, Option<Value>),
    carry: Value,
    many: bool,
) -> (Value, Value) {
    let sum = b.add(x, change);
    let (plain, size) = (b.unary(Unary::Abs, sum), b.unary(Unary::Abs, carry));
    let epsilon = b.number(f64::EPSILON);
    let most = b.mul(epsilon, plain);
    let fits = b.binary(ir::Binary::Le, size, most);
    if many && low.is_none() {
        let zero = b.number(0.0);
        let carry = b.select(fits, carry, zero);
        let (_, next, rest) = added(b, x, change, carry);
        return (next, rest);
    }
    // Both ways at once, so that the next step waits for the choice alone.
    let done = b.sub(sum, x);
    let mut without = b.sub(change, done);
    let (y, next, mut rest) = added(b, x, change, carry);
    if let Some(low) = low {
        let kept = b.sub(y, change);
        let left = b.sub(carry, kept);
        let more = b.add(left, low);
        (without, rest) = (b.add(without, low), b.add(rest, more));
    }
    (b.select(fits, next, sum), b.select(fits, rest, without))
}

/// The same where the change is that of `x + carry`, and known but for `low`: nothing is dropped.
pub(crate) fn advance_whole(b: &mut Builder, x: Value, (change, low): (Value, Value), carry: Value) -> (Value, Value) {
    let (y, next, rest) = added(b, x, change, carry);
    // What of the carry had no place beside the change.
    let kept = b.sub(y, change);
    let left = b.sub(carry, kept);
    let rest = b.add(rest, left);
    (next, b.add(rest, low))
}

/// `change + carry`, `x` and that, and what rounding takes from the second sum. Where the energy is a quadratic form
/// this alone is an advance: what a carry does to it is no more than rounding beside what the larger state had.
pub(crate) fn added(b: &mut Builder, x: Value, change: Value, carry: Value) -> (Value, Value, Value) {
    let y = b.add(change, carry);
    let next = b.add(x, y);
    let done = b.sub(next, x);
    (y, next, b.sub(y, done))
}

/// What time and what is given make sources give, as symbols of their own: computed once, so that equations and ledger
/// have it with the same rounding, whatever is left of it where it nearly cancels. `map` says when, and then has the
/// symbols; their values.
pub(crate) fn sources(
    c: &Cluster,
    pool: &mut Pool,
    map: &mut FxHashMap<Symbol, Expr>,
    name: impl Fn(&str) -> String,
) -> Vec<(Symbol, Expr)> {
    let given: FxHashSet<Symbol> = c.inputs.iter().map(|i| i.1).chain(c.time).collect();
    let mut list = Vec::new();
    for n in &c.nodes {
        let (Some(_), Output::Explicit(e)) = (n.source(), n.how) else { continue };
        let symbols = pool.symbols(e);
        if symbols.is_empty() || symbols.iter().any(|s| !given.contains(s)) || map.contains_key(&n.out) {
            continue;
        }
        let name = name(pool.name(n.out));
        let (symbol, value) = (pool.symbol(&name), pool.substitute(e, map));
        map.insert(n.out, pool.var(symbol));
        list.push((symbol, value));
    }
    list
}

/// Has them known.
///
/// # Errors
/// A symbol that means nothing.
pub(crate) fn bind(
    model: &Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    list: &[(Symbol, Expr)],
) -> Result<(), Vec<Diagnostic>> {
    for (s, e) in list {
        let v = lowering.lower(&model.pool, b, *e).map_err(|s| missing(model, s))?;
        lowering.bind(*s, v);
    }
    Ok(())
}

/// For steppers that carry nothing.
pub(crate) fn no_carry(b: &mut Builder, c: &Cluster) {
    let zero = b.number(0.0);
    for i in 0..c.states.len() {
        b.store(Slot::new(Array::Next, c.carry_at() + i), zero);
    }
}

/// For steppers that keep nothing of a step but the state: nothing is left of what another one kept.
pub(crate) fn no_memory(b: &mut Builder, c: &Cluster) {
    let zero = b.number(0.0);
    for i in 0..c.memory {
        b.store(Slot::new(Array::Next, c.memory_at() + i), zero);
    }
}

/// The unknowns of the loops.
pub(crate) fn loops(
    c: &Cluster,
    model: &mut Model,
    (b, lowering): (&mut Builder, &mut Lowering),
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let mut list = Vec::with_capacity(c.loops.len());
    for z in &c.loops {
        let z = model.pool.var(*z);
        list.push(lowering.lower(&model.pool, b, z).map_err(|s| missing(model, s))?);
    }
    Ok(list)
}

/// Stores what the loops of the next step start from.
pub(crate) fn store_loops(c: &Cluster, b: &mut Builder, loops: &[Value]) {
    let first = c.states.len() + c.integrals.len();
    for (i, z) in loops.iter().enumerate() {
        b.store(Slot::new(Array::Next, first + i), *z);
    }
}

/// Stores the waves that go into lines over a step, and the integrals at its end: by their rates over it, and by what
/// they change beside that.
pub(crate) fn store_integrals(
    c: &Cluster,
    model: &mut Model,
    (b, lowering): (&mut Builder, &mut Lowering),
    inputs: &Inputs,
    (flat, more): (&FxHashMap<Symbol, Expr>, &[Option<Value>]),
) -> Result<(), Vec<Diagnostic>> {
    for (i, wave) in c.waves().enumerate() {
        let wave = model.pool.substitute(wave, flat);
        let v = lowering.lower(&model.pool, b, wave).map_err(|s| missing(model, s))?;
        b.store(Slot::new(Array::Output, c.ports.len() + i), v);
    }
    let first = c.states.len();
    for (i, (integral, start)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rate = model.pool.substitute(integral.rate, flat);
        let rate = lowering.lower(&model.pool, b, rate).map_err(|s| missing(model, s))?;
        let mut change = b.mul(inputs.h, rate);
        if let Some(more) = more.get(i).copied().flatten() {
            change = b.add(change, more);
        }
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, first + i), v);
    }
    Ok(())
}
