//! What the steppers share: inputs of a program, iterations, the ledger's terms.

use super::cluster::{Cluster, Group, missing};
use super::root::Roots;
use super::tear::{Torn, tear};
use super::turn::Turns;
use crate::expression::{Below, Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::{Model, Variable};
use crate::structure::{Bends, ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{self, Array, Builder, Knee, Newton, Slot, Unary, Value};
use bond_runtime::options::NewtonOptions;
use bond_runtime::scene::{Entries, GIVEN};
use bond_runtime::solve::newton::MAX_KNEES;
use rustc_hash::{FxHashMap, FxHashSet};

/// The values that a program starts from.
pub(super) struct Inputs {
    pub(super) t: Value,
    pub(super) h: Value,
    pub(super) states: Vec<Value>,
    pub(super) integrals: Vec<Value>,
    pub(super) guesses: Vec<Value>,
    /// What rounding took from each state.
    pub(super) carries: Vec<Slot>,
    /// For each state a trace of the largest value it had.
    pub(super) traces: Vec<Slot>,
    /// Value at the start of the step and slope of what is given from outside.
    pub(super) given: Vec<(Value, Value)>,
    pub(super) env: Vec<(Symbol, Value)>,
}

/// Declares a program's inputs and state, and loads them.
pub(super) fn inputs(b: &mut Builder, c: &Cluster, form: &Form, model: &Model) -> Inputs {
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
pub(super) fn is_many(c: &Cluster) -> bool {
    c.states.len() >= 32
}

/// `x + change` and what rounding takes from it, which is added to the next change (Kahan): without that a state at
/// rest under a flow of energy is off by up to half a digit, and so is each step's balance, always to the same side. A
/// carry from when the state was much larger than it is now is dropped, since the change takes no account of it: a
/// contact that begins after a long way has next to no energy, and what is no rounding beside it.
///
/// Where the change is known but for `low`, that and what of the carry has no place beside the change are kept too.
/// Of `many` states a step has so much to do that it does not wait for one of them.
pub(super) fn advance(
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
pub(super) fn advance_whole(b: &mut Builder, x: Value, (change, low): (Value, Value), carry: Value) -> (Value, Value) {
    let (y, next, rest) = added(b, x, change, carry);
    // What of the carry had no place beside the change.
    let kept = b.sub(y, change);
    let left = b.sub(carry, kept);
    let rest = b.add(rest, left);
    (next, b.add(rest, low))
}

/// `change + carry`, `x` and that, and what rounding takes from the second sum. Where the energy is a quadratic form
/// this alone is an advance: what a carry does to it is no more than rounding beside what the larger state had.
pub(super) fn added(b: &mut Builder, x: Value, change: Value, carry: Value) -> (Value, Value, Value) {
    let y = b.add(change, carry);
    let next = b.add(x, y);
    let done = b.sub(next, x);
    (y, next, b.sub(y, done))
}

/// What time and what is given make sources give, as symbols of their own: computed once, so that equations and ledger
/// have it with the same rounding, whatever is left of it where it nearly cancels. `map` says when, and then has the
/// symbols; their values.
pub(super) fn sources(
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
pub(super) fn bind(
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
pub(super) fn no_carry(b: &mut Builder, c: &Cluster) {
    let zero = b.number(0.0);
    for i in 0..c.states.len() {
        b.store(Slot::new(Array::Next, c.carry_at() + i), zero);
    }
}

/// For steppers that keep nothing of a step but the state: nothing is left of what another one kept.
pub(super) fn no_memory(b: &mut Builder, c: &Cluster) {
    let zero = b.number(0.0);
    for i in 0..c.memory {
        b.store(Slot::new(Array::Next, c.memory_at() + i), zero);
    }
}

/// An iteration starts at most so many units up an exponent, where that is still a number in single precision.
const STEEP: f64 = 80.0;
/// Of more unknowns than this an affine system is solved once.
const LARGE: usize = 64;

/// What is left of the unknowns of a step where nothing takes energy out of it: it is always on the same side, so that it
/// adds up, and where steps are not fitted there may be 1e7 of them.
const LEAST: f64 = 1e-20;

/// A system of equations to be solved in a program; what is not asked for is left as it is by default.
#[derive(Default)]
pub(super) struct System {
    pub(super) unknowns: Vec<Symbol>,
    /// The symbol of the step's length, which is above 0.
    pub(super) h: Option<Symbol>,
    pub(super) start: Vec<Value>,
    pub(super) residuals: Vec<Expr>,
    pub(super) weight: Vec<Value>,
    pub(super) scale: Vec<Value>,
    pub(super) flag: Option<Slot>,
    /// Whether it is linear, and solved once.
    pub(super) once: bool,
    /// Whether its coefficients are to be taken as they stand: what their products would be rounded by counts.
    pub(super) whole: bool,
    /// Whether what rounding took from the unknowns is asked for.
    pub(super) rests: bool,
    /// The part of the unknowns that the iteration may leave, where that is less than usual.
    pub(super) left: Option<f64>,
    /// Values that are next to nothing beside what they are added to.
    pub(super) small: Vec<Value>,
    /// The states that the unknowns move, where these may be angles.
    pub(super) states: Vec<(Symbol, Option<Value>)>,
    /// Unknowns that exponentials are of, and where these grow.
    pub(super) bends: Vec<(Symbol, Bends)>,
    /// Whether laws that hold at once may leave open how they share the load.
    pub(super) open: bool,
    /// Whether laws have corners beyond which they are steeper by orders of magnitude.
    pub(super) corners: bool,
}

/// The part of the unknowns of a step that its iteration may leave.
pub(super) fn left(c: &Cluster) -> Option<f64> {
    (c.is_lossless() && !c.fitted).then_some(LEAST)
}

/// Solves a system; afterwards `lowering` has the values of the unknowns. What rounding took from these, where that is
/// asked for and known.
pub(super) fn solve(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    system: System,
) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
    solve_from(model, b, lowering, (system, true), Vec::new())
}

/// Solves a system whose start is foretold: `cold` is where else it starts, empty where it is not. Unknowns that follow
/// linearly from the others are taken out where it says so. What rounding took from unknowns, where that is asked for and
/// known.
pub(super) fn solve_from(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    (mut system, apart): (System, bool),
    mut cold: Vec<Value>,
) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
    let h = system.h;
    let roots = Roots::of(model, b, lowering, &mut system, &mut cold)?;
    let all = system.unknowns.clone();
    let Torn { before, unknowns: torn } = if apart { tear(&mut model.pool, &mut system, h) } else { Torn::default() };
    bind(model, b, lowering, &before)?;
    let inside = if system.whole { &torn[..] } else { &[] };
    if !cold.is_empty() {
        let by: FxHashMap<Symbol, Value> = all.into_iter().zip(cold).collect();
        cold = system.unknowns.iter().filter_map(|s| by.get(s).copied()).collect();
    }
    let mut rests = iterate(model, b, lowering, (system, inside), cold)?;
    bind(model, b, lowering, &torn)?;
    roots.bind(&mut model.pool, b, lowering).map_err(|s| missing(model, s))?;
    // Of what was taken out, by its slopes.
    let mut more = Vec::new();
    for (s, e) in torn.iter().filter(|_| !rests.is_empty()) {
        let by: Vec<Symbol> = model.pool.symbols(*e).into_iter().filter(|s| rests.contains_key(s)).collect();
        let mut sum = None;
        for (slope, u) in model.pool.derivatives(*e, &by).into_iter().zip(by) {
            let slope = lowering.lower(&model.pool, b, slope).map_err(|s| missing(model, s))?;
            let term = b.mul(slope, rests[&u]);
            sum = Some(sum.map_or(term, |sum| b.add(sum, term)));
        }
        more.extend(sum.map(|sum| (*s, sum)));
    }
    rests.extend(more);
    Ok(rests)
}

/// The unknowns that an iteration solves for, where it is as [`solve_from`] makes it.
pub(super) fn solved_for(pool: &mut Pool, mut system: System, apart: bool) -> Vec<Symbol> {
    if apart && !Roots::are_in(pool, &system) {
        let (h, none) = (system.h, vec![Value(0); system.unknowns.len()]);
        (system.start, system.weight, system.scale) = (none.clone(), none.clone(), none);
        tear(pool, &mut system, h);
    }
    system.unknowns
}

/// Where an iteration starts: arguments of exponentials at what changes of the states alone, which `known` are, make of
/// them there.
pub(super) fn foretold(
    model: &mut Model,
    b: &mut Builder,
    lowering: &Lowering,
    (unknowns, residuals): (&[Symbol], &[Expr]),
    bends: &[(Symbol, Bends)],
    known: &FxHashSet<Symbol>,
    mut start: Vec<Value>,
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let mut at = lowering.clone();
    unknowns.iter().zip(&start).for_each(|(u, v)| at.bind(*u, *v));
    for (z, _) in bends {
        let Some(k) = unknowns.iter().position(|u| u == z) else { continue };
        // Behind a resistor of its own it is not what the states leave: that would be far up an exponential.
        let slope = model.pool.derivative(residuals[k], *z);
        if model.pool.contains(slope, *z) {
            continue;
        }
        let none = FxHashMap::from_iter([(*z, model.pool.zero())]);
        let input = model.pool.substitute(residuals[k], &none);
        let input = model.pool.neg(input);
        if model.pool.contains_any(input, &|s| unknowns.contains(&s) && !known.contains(&s)) {
            continue;
        }
        start[k] = at.lower(&model.pool, b, input).map_err(|s| missing(model, s))?;
    }
    Ok(start)
}

/// Newton's method on a system, with what was taken out of it as variables that follow from its unknowns. What rounding
/// took from these, where that is asked for and known.
fn iterate(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    (mut system, torn): (System, &[(Symbol, Expr)]),
    mut cold: Vec<Value>,
) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
    let n = system.unknowns.len();
    if n == 0 {
        return Ok(FxHashMap::default());
    }
    let slots = b.slots(Array::Local, n);
    for (i, s) in system.unknowns.iter().enumerate() {
        b.name(Slot::new(Array::Local, slots.index as usize + i), model.pool.name(*s));
    }
    let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
    let place: FxHashMap<Symbol, u32> = system.unknowns.iter().enumerate().map(|(i, s)| (*s, i as u32)).collect();
    let followers: Vec<Vec<(u32, Expr)>> = torn.iter().map(|(_, e)| slopes(&mut model.pool, *e, &place)).collect();
    let torn_at: FxHashMap<Symbol, u32> = torn.iter().enumerate().map(|(k, t)| (t.0, k as u32)).collect();
    let mut jacobian: Vec<(u32, u32, Expr)> = Vec::new();
    for (i, r) in system.residuals.iter().enumerate() {
        let mut row = slopes(&mut model.pool, *r, &place);
        for (k, by) in slopes(&mut model.pool, *r, &torn_at) {
            for &(j, with) in &followers[k as usize] {
                let d = model.pool.mul(by, with);
                match row.iter_mut().find(|e| e.0 == j) {
                    Some(e) => e.1 = model.pool.add(e.1, d),
                    None => row.push((j, d)),
                }
            }
        }
        row.sort_unstable_by_key(|e| e.0);
        jacobian.extend(row.into_iter().filter(|e| !model.pool.is_zero(e.1)).map(|(j, d)| (i as u32, j, d)));
    }
    let is_unknown = |s: Symbol| place.contains_key(&s) || torn_at.contains_key(&s);
    let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().chain(torn.iter().map(|t| t.0)).collect();
    if n <= LARGE {
        system.residuals = model.pool.factored(&system.residuals, &unknown, system.whole);
        let entries: Vec<Expr> = jacobian.iter().map(|e| e.2).collect();
        for (e, new) in jacobian.iter_mut().zip(model.pool.factored(&entries, &unknown, false)) {
            e.2 = new;
        }
    }
    // Few unknowns are cheap to look at again, which takes the rounding of the solution off.
    let affine = (n > LARGE || system.once) && jacobian.iter().all(|t| !model.pool.contains_any(t.2, &is_unknown));
    if affine && !system.once {
        at_once(model, b, lowering, &system, slots, &jacobian)?;
        return Ok(FxHashMap::default());
    }
    let rests = (system.rests && !affine).then(|| b.slots(Array::Local, n));
    let knees = if n <= MAX_KNEES { knees(&system) } else { Vec::new() };
    // An argument near 0 is told no better than to the rounding of the exponential, which is 1 there.
    for knee in &knees {
        let one = b.number(1.0 / knee.rate.abs());
        let scale = &mut system.scale[knee.unknown as usize];
        *scale = b.add(*scale, one);
    }
    for list in [&mut system.start, &mut cold] {
        for knee in &knees {
            let Some(x) = list.get_mut(knee.unknown as usize) else { continue };
            let most = b.number(knee.knee + STEEP / knee.rate);
            *x = b.binary(if knee.rate > 0.0 { ir::Binary::Min } else { ir::Binary::Max }, *x, most);
        }
    }
    for (i, v) in system.start.iter().enumerate() {
        b.store(slot(i), *v);
    }
    // What does not change in the iteration is computed before it.
    let all: Vec<Expr> = system.residuals.iter().copied().chain(jacobian.iter().map(|t| t.2)).collect();
    for e in fixed_parts(&model.pool, torn.iter().map(|t| t.1).chain(all.iter().copied()), &unknown) {
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
    }
    let turns = Turns::of(&mut model.pool, &all, &unknown, &system.states);
    let before = turns.as_ref().map(|t| t.before(model, b, lowering, &system.states)).transpose()?;
    let shared = shared(&mut model.pool, &all, &unknown);
    let mut shares = Vec::with_capacity(shared.len());
    for (below, outside) in shared {
        let value = match outside {
            Some(e) => Some(lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?),
            None => None,
        };
        shares.push((below, value));
    }
    // What was taken out is computed in and after the iteration, and has to be the same to the last digit: by a rounding
    // between the two the energy goes one way.
    lowering.share(shares);
    lowering.begin(b);
    let mut inside = lowering.clone();
    b.open(slots, n);
    for (i, s) in system.unknowns.iter().enumerate() {
        let v = b.load(slot(i));
        inside.bind(*s, v);
    }
    bind(model, b, &mut inside, torn)?;
    if let (Some(turns), Some(before)) = (&turns, &before) {
        turns.write(model, b, &mut inside, before)?;
    }
    let mut residual = Vec::with_capacity(n);
    for r in &system.residuals {
        residual.push(inside.lower(&model.pool, b, *r).map_err(|s| missing(model, s))?);
    }
    let mut entries = Vec::with_capacity(jacobian.len());
    for (i, j, d) in jacobian {
        entries.push((i, j, inside.lower(&model.pool, b, d).map_err(|s| missing(model, s))?));
    }
    b.close(Newton {
        unknowns: slots.index,
        rounding: rests.map(|r| r.index),
        body: Vec::new(),
        residual,
        jacobian: entries,
        update: Vec::new(),
        left: system.left.unwrap_or(NewtonOptions::DEFAULT.rounding),
        weight: system.weight,
        scale: system.scale,
        cold,
        small: system.small,
        knees,
        limit: 200,
        affine,
        undetermined: system.open && !affine,
        corners: system.corners && !affine,
        flag: system.flag,
    });
    for (i, s) in system.unknowns.iter().enumerate() {
        let v = b.load(slot(i));
        lowering.bind(*s, v);
    }
    Ok(taken(b, &system.unknowns, rests))
}

/// What rounding took from unknowns, from where an iteration leaves it.
pub(super) fn taken(b: &mut Builder, unknowns: &[Symbol], rests: Option<Slot>) -> FxHashMap<Symbol, Value> {
    let Some(first) = rests else { return FxHashMap::default() };
    let slot = |i: usize| Slot { array: Array::Local, index: first.index + i as u32 };
    unknowns.iter().enumerate().map(|(i, s)| (*s, b.load(slot(i)))).collect()
}

/// The knees of a system's unknowns, by their numbers.
fn knees(system: &System) -> Vec<Knee> {
    let place = |s: Symbol| system.unknowns.iter().position(|u| *u == s);
    let sides = |(s, b): &(Symbol, Bends)| {
        let unknown = place(*s).map(|i| i as u32);
        let all = unknown.into_iter().flat_map(|unknown| {
            let one = move |(knee, rate)| Knee { unknown, knee, rate };
            [b.above, b.below].into_iter().flatten().map(one)
        });
        all.collect::<Vec<_>>()
    };
    system.bends.iter().flat_map(sides).collect()
}

/// The derivatives of an expression by the symbols that have a place, where they are not 0.
fn slopes(pool: &mut Pool, e: Expr, place: &FxHashMap<Symbol, u32>) -> Vec<(u32, Expr)> {
    let mut by: Vec<(u32, Symbol)> = pool.symbols(e).into_iter().filter_map(|s| Some((*place.get(&s)?, s))).collect();
    by.sort_unstable();
    let symbols: Vec<Symbol> = by.iter().map(|b| b.1).collect();
    let slopes = pool.derivatives(e, &symbols);
    by.into_iter().zip(slopes).filter(|(_, d)| !pool.is_zero(*d)).map(|((j, _), d)| (j, d)).collect()
}

/// Solves a large linear system: J u = -r, with the residual r where all unknowns are 0.
fn at_once(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    system: &System,
    slots: Slot,
    jacobian: &[(u32, u32, Expr)],
) -> Result<(), Vec<Diagnostic>> {
    let right = opposite(model, b, lowering, (&system.unknowns, &system.residuals))?;
    let mut matrix = Vec::with_capacity(jacobian.len());
    for &(i, j, d) in jacobian {
        matrix.push((i, j, lowering.lower(&model.pool, b, d).map_err(|s| missing(model, s))?));
    }
    b.solve(ir::Solve { unknowns: slots.index, right, matrix, imaginary: Vec::new(), flag: system.flag });
    for (i, s) in system.unknowns.iter().enumerate() {
        let v = b.load(Slot { array: Array::Local, index: slots.index + i as u32 });
        lowering.bind(*s, v);
    }
    Ok(())
}

/// What residuals are where all unknowns are 0, with the opposite sign.
pub(super) fn opposite(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    (unknowns, residuals): (&[Symbol], &[Expr]),
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let zero = model.pool.zero();
    let none: FxHashMap<Symbol, Expr> = unknowns.iter().map(|u| (*u, zero)).collect();
    let mut list = Vec::with_capacity(unknowns.len());
    for r in model.pool.substitute_all(residuals, &none) {
        let r = model.pool.neg(r);
        list.push(lowering.lower(&model.pool, b, r).map_err(|s| missing(model, s))?);
    }
    Ok(list)
}

/// What products within an iteration divide by, where one division does for several: with one over it, where that does
/// not change in the iteration. Where there are choices, a division for two is better had where it is asked for.
fn shared(pool: &mut Pool, all: &[Expr], unknown: &FxHashSet<Symbol>) -> Vec<(Below, Option<Expr>)> {
    let (mut seen, mut stack) = (FxHashSet::default(), all.to_vec());
    let mut list: Vec<Below> = Vec::new();
    let mut choices = false;
    while let Some(e) = stack.pop() {
        if !seen.insert(e) || !pool.contains_any(e, &|s| unknown.contains(&s)) {
            continue;
        }
        choices |= matches!(pool.node(e), Node::Select(..));
        list.extend(Lowering::below(pool, e));
        pool.node(e).each_child(&mut |c| stack.push(c));
    }
    list.sort_unstable();
    let mut shared = Vec::new();
    for same in list.chunk_by(|a, b| a == b) {
        let Some(below) = same.first() else { continue };
        if !below.iter().any(|(f, _)| pool.contains_any(*f, &|s| unknown.contains(&s))) {
            let factors: Vec<(Expr, Number)> = below.iter().map(|(f, (n, d))| (*f, Number::ratio(*n, *d))).collect();
            shared.push((below.clone(), Some(pool.powers(&factors))));
        } else if same.len() > if choices { 2 } else { 1 } {
            shared.push((below.clone(), None));
        }
    }
    shared
}

/// The largest parts of expressions that hold none of the unknowns (and are more than a number or a symbol).
pub(super) fn fixed_parts(pool: &Pool, all: impl IntoIterator<Item = Expr>, unknown: &FxHashSet<Symbol>) -> Vec<Expr> {
    let mut seen: FxHashSet<Expr> = FxHashSet::default();
    let mut stack: Vec<Expr> = all.into_iter().collect();
    let mut parts = Vec::new();
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        let node = pool.node(e);
        if pool.contains_any(e, &|s| unknown.contains(&s)) {
            node.each_child(&mut |c| stack.push(c));
        } else if pool.constant(e).is_none() && !matches!(node, Node::Symbol(_)) {
            parts.push(e);
        }
    }
    parts.sort_unstable();
    parts
}

/// Stores the ledger's terms of a step, and the port means. The outputs over the step are given by some instants of it,
/// or means, each with its weight.
#[expect(clippy::too_many_arguments, reason = "the pieces of one step")]
pub(super) fn ledger(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    stages: &[(f64, &FxHashMap<Symbol, Expr>)],
    entries: &[Entries],
    h: Value,
) -> Result<(), Vec<Diagnostic>> {
    let mut value = |model: &mut Model, b: &mut Builder, flat: &FxHashMap<Symbol, Expr>, e: Expr| {
        let e = model.pool.substitute(e, flat);
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))
    };
    // Σ weight of what `one` gives at each.
    type One<'a> = dyn FnMut(&mut Model, &mut Builder, &FxHashMap<Symbol, Expr>) -> Result<Value, Vec<Diagnostic>> + 'a;
    let mean = |model: &mut Model, b: &mut Builder, one: &mut One| -> Result<Value, Vec<Diagnostic>> {
        let mut sum = None;
        for (weight, flat) in stages {
            let mut v = one(model, b, flat)?;
            if *weight != 1.0 {
                let weight = b.number(*weight);
                v = b.mul(weight, v);
            }
            sum = Some(sum.map_or(v, |s| b.add(s, v)));
        }
        Ok(sum.unwrap_or_else(|| b.number(0.0)))
    };
    for (i, p) in c.ports.iter().enumerate() {
        let e = form.input(&mut model.pool, *p);
        let v = mean(model, b, &mut |model, b, flat| value(model, b, flat, e))?;
        b.store(Slot::new(Array::Output, i), v);
    }
    let mut power = |model: &mut Model, b: &mut Builder, columns: &[ColumnId]| {
        mean(model, b, &mut |model, b, flat| {
            let mut sum = None;
            for column in columns {
                let (z, i) = (model.pool.var(form.column(*column).out), form.input(&mut model.pool, *column));
                let (z, i) = (value(model, b, flat, z)?, value(model, b, flat, i)?);
                let p = b.mul(z, i);
                sum = Some(sum.map_or(p, |s| b.add(s, p)));
            }
            Ok(sum.unwrap_or_else(|| b.number(0.0)))
        })
    };
    let all = c.accounts(model, form);
    for (e, accounts) in entries.iter().zip(&all) {
        for ((_, slot), column) in e.supplied.iter().zip(&accounts.supplied) {
            let p = power(model, b, &[*column])?;
            let w = b.mul(h, p);
            let w = b.unary(Unary::Neg, w);
            b.store(Slot::new(Array::Output, *slot), w);
        }
        for ((_, slot), columns) in e.dissipated.iter().zip(&accounts.dissipated) {
            let p = power(model, b, columns)?;
            let w = b.mul(h, p);
            b.store(Slot::new(Array::Output, *slot), w);
        }
    }
    for (e, accounts) in entries.iter().zip(&all) {
        for (produced, columns) in e.produced.iter().zip(&accounts.produced) {
            for (slot, warm) in [(produced.entropy, false), (produced.heat, true)] {
                let sum = mean(model, b, &mut |model, b, flat| {
                    let mut sum = b.number(0.0);
                    for column in columns {
                        let s = variable(model, form, *column, Variable::Flow);
                        let s = value(model, b, flat, s)?;
                        sum = b.sub(sum, s);
                    }
                    if warm {
                        let temperature = variable(model, form, columns[0], Variable::Effort);
                        let temperature = value(model, b, flat, temperature)?;
                        sum = b.mul(sum, temperature);
                    }
                    Ok(sum)
                })?;
                let w = b.mul(h, sum);
                b.store(Slot::new(Array::Output, slot), w);
            }
        }
    }
    Ok(())
}

/// One of the two variables of a column.
pub(super) fn variable(model: &mut Model, form: &Form, column: ColumnId, variable: Variable) -> Expr {
    match form.column(column).gives == variable {
        true => model.pool.var(form.column(column).out),
        false => form.input(&mut model.pool, column),
    }
}

/// Stores H of each region at given values of the states. Where an energy has angles in it, which may grow to many
/// turns, or a spring begins far from where its stroke is counted from, what rounding took from the states (`rests`)
/// counts to first order: else each step's balance would be off by the rounding of the angle or stroke.
pub(super) fn energies(
    c: &Cluster,
    model: &mut Model,
    b: &mut Builder,
    (states, rests): (&[Value], &[Value]),
    inputs: &Inputs,
    entries: &[Entries],
) -> Result<(), Vec<Diagnostic>> {
    let mut at = Lowering::new(inputs.env.iter().copied());
    for (s, x) in c.states.iter().zip(states) {
        at.bind(s.symbol, *x);
    }
    // The energy of what follows a source depends on the time.
    let mut end: FxHashMap<Symbol, Expr> = FxHashMap::default();
    if let (Some(t), Some(h)) = (c.time, c.h) {
        let (te, he) = (model.pool.var(t), model.pool.var(h));
        end.insert(t, model.pool.add(te, he));
    }
    let symbols: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    super::turn::angles(model, b, &mut at, &c.energies(), &symbols)?;
    for (e, r) in entries.iter().zip(&c.regions) {
        let h = c.energy(&mut model.pool, *r);
        let later = model.pool.substitute(h, &end);
        let mut v = at.lower(&model.pool, b, later).map_err(|s| missing(model, s))?;
        let of_states =
            |z: &Expr| model.pool.symbols(*z).iter().all(|s| model.pool.value(*s).is_some() || symbols.contains(s));
        let moves = |e: Expr| model.pool.contains_any(e, &|s| symbols.contains(&s));
        let is_offset = |c: &Number, terms: &[(Expr, Number)]| {
            let moving = terms.iter().filter(|t| moves(t.0)).count();
            moving > 0 && (moving < terms.len() || !c.is_zero())
        };
        let is_coarse = |n: &Node| match n {
            Node::Unary(Unary::Sin | Unary::Cos, _) => true,
            Node::Sum(c, terms) => is_offset(c, terms),
            _ => false,
        };
        let coarse = |g: &&Group| model.pool.any_node(g.energy, &is_coarse) && g.coenergy.iter().all(of_states);
        for g in c.groups_in(*r).iter().filter(coarse) {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                let Some(rest) = rests.get(*s) else { continue };
                let z = at.lower(&model.pool, b, *z).map_err(|s| missing(model, s))?;
                let more = b.mul(z, *rest);
                v = b.add(v, more);
            }
        }
        b.store(Slot::new(Array::Output, e.energy), v);
        if let Some(slot) = e.before {
            let mut start = Lowering::new(inputs.env.iter().copied());
            let v = start.lower(&model.pool, b, h).map_err(|s| missing(model, s))?;
            b.store(Slot::new(Array::Output, slot), v);
        }
        if e.size == e.energy {
            continue;
        }
        let mut size = b.number(0.0);
        for g in c.groups_in(*r) {
            // What several states share may cancel within itself, as the double pendulum's kinetic energy and its
            // height do.
            let parts = if g.states.len() > 1 {
                super::measure::summands(model, &end, g.energy, super::measure::DEEP)
            } else {
                let level = c.level(&mut model.pool, g).energy;
                let later = model.pool.substitute(level, &end);
                let size = model.pool.unary(Unary::Abs, later);
                // Where it passes 0 on its way up from its least, it is there all the same.
                match super::level::bottom(model, g, c) {
                    (least, true) if least != 0.0 => {
                        let least = model.pool.float(least);
                        let above = model.pool.sub(later, least);
                        let above = model.pool.unary(Unary::Abs, above);
                        model.pool.add(size, above)
                    }
                    (_, _) => size,
                }
            };
            let v = at.lower(&model.pool, b, parts).map_err(|s| missing(model, s))?;
            size = b.add(size, v);
        }
        b.store(Slot::new(Array::Output, e.size), size);
    }
    Ok(())
}
