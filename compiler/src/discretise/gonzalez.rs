//! The discrete-gradient step (Gonzalez, J. Nonlinear Sci. 6, 1996): order 2, the balance exact.
//!
//! (x+ - x)/h = D z at the midpoint of states and time, with the co-energy variable of each storage replaced by its
//! discrete gradient, which for one state is the difference quotient of H, written without cancellation. Resistors and
//! loops are solved with it. The unknowns are the changes of the states, so that x+ = x + change is rounded once.

use super::ahead::Ahead;
use super::cluster::{Cluster, Group, Part, missing, verified};
use super::measure;
use super::stiff;
use super::turn;
use super::whole;
use super::write::{self, System};
use crate::expression::{Expr, Lowering, Node, Pool, Symbol};
use crate::model::{Model, Variable};
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Value};
use bond_runtime::scene::{Entries, Stepper};
use rustc_hash::{FxHashMap, FxHashSet};

/// Among more states than this some may be moved by less than has a square.
const FAR: usize = 16;

/// States at the midpoint, storages' outputs as discrete gradients, time at the midpoint (of what is sampled, at its
/// sample).
pub(super) fn midpoint(c: &Cluster, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
    let mut map = FxHashMap::default();
    let half = pool.ratio(1, 2);
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        let d = pool.mul(half, d);
        map.insert(s.symbol, pool.add(x, d));
    }
    follow(c, pool, form, &mut map);
    let sources: FxHashSet<Symbol> = c.nodes.iter().filter(|n| n.source().is_some()).map(|n| n.out).collect();
    let gradients: Vec<Vec<Expr>> = c.groups.iter().map(|g| gradient(c, pool, g, (&map, &sources))).collect();
    for (g, list) in c.groups.iter().zip(gradients) {
        for (s, z) in g.states.iter().zip(list) {
            if let Some(column) = c.states[*s].column {
                map.insert(form.column(column).out, z);
            }
        }
    }
    // What is sampled has time, as all that it is given, from its sample.
    if let (Some(t), Some(h), None) = (c.time, c.h, c.sampling) {
        let (te, he) = (pool.var(t), pool.var(h));
        let he = pool.mul(half, he);
        map.insert(t, pool.add(te, he));
        for &(_, u, du) in &c.inputs {
            let (ue, due) = (pool.var(u), pool.var(du));
            let ahead = pool.mul(he, due);
            map.insert(u, pool.add(ue, ahead));
        }
    }
    map
}

/// The discrete gradient of a group's energy.
///
/// Of one state it is the difference quotient; of a quadratic energy the gradient at the midpoint. Else the coordinate
/// increments of Itoh and Abe (J. Comput. Phys. 76, 1988), which move one state after the other, in the order of the
/// states and in the opposite one: each satisfies g . d = H(x + d) - H(x), and so does their mean, which is symmetric
/// and so of order 2. Unlike Gonzalez' correction along d it asks for no common unit of the states, and each quotient
/// is written without cancellation.
pub(super) fn gradient(
    c: &Cluster,
    pool: &mut Pool,
    g: &Group,
    (middle, sources): (&FxHashMap<Symbol, Expr>, &FxHashSet<Symbol>),
) -> Vec<Expr> {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    // Of storages that follow sources the outputs are no derivatives of H alone: they are quadratic, and so affine.
    let driven = g.coenergy.iter().any(|z| pool.contains_any(*z, &|s| sources.contains(&s)));
    if let ([only], [s], false) = (&g.states[..], &symbols[..], driven) {
        let (x, d) = (pool.var(*s), pool.var(c.delta[*only]));
        let slope = pool.difference(g.energy, *s, x, d);
        // The last of many are moved by powers of what the first are: there even squares are nothing.
        let far = c.states.len() > FAR && pool.any_node(g.energy, &|n| matches!(n, Node::Select(..)));
        let slope = if far { pool.beyond_nothing((g.energy, *s), slope, x, d) } else { slope };
        let near = c.level(pool, g).near.first();
        return vec![near.map_or(slope, |term| term.near.slope(pool, d, slope))];
    }
    if g.coenergy.iter().all(|z| whole::is_straight(pool, *z, &symbols)) {
        return g.coenergy.iter().map(|z| pool.substitute(*z, middle)).collect();
    }
    let half = pool.ratio(1, 2);
    let level = c.level(pool, g);
    let ends: Vec<Expr> = g
        .states
        .iter()
        .map(|s| {
            let (x, d) = (pool.var(c.states[*s].symbol), pool.var(c.delta[*s]));
            pool.add(x, d)
        })
        .collect();
    (0..g.states.len())
        .map(|i| {
            let mut quotient = |moved: std::ops::Range<usize>| {
                let map: FxHashMap<Symbol, Expr> = moved.map(|j| (symbols[j], ends[j])).collect();
                let energy = pool.substitute(level.rest, &map);
                let (x, d) = (pool.var(symbols[i]), pool.var(c.delta[g.states[i]]));
                pool.difference(energy, symbols[i], x, d)
            };
            let (up, down) = (quotient(0..i), quotient(i + 1..g.states.len()));
            let sum = pool.add(up, down);
            let slope = pool.mul(half, sum);
            let Some(term) = level.near.iter().find(|t| t.place == i) else { return slope };
            let (x, d) = (pool.var(symbols[i]), pool.var(c.delta[g.states[i]]));
            let own = pool.difference(term.energy, symbols[i], x, d);
            let own = term.near.slope(pool, d, own);
            pool.add(slope, own)
        })
        .collect()
}

/// A storage that follows sources takes the change of its state over the step; the sources give the mean of their ends,
/// so that the change of its energy, a square, is the work done on it.
fn follow(c: &Cluster, pool: &mut Pool, form: &Form, map: &mut FxHashMap<Symbol, Expr>) {
    let (Some(t), Some(h)) = (c.time, c.h) else { return };
    let (te, he, half) = (pool.var(t), pool.var(h), pool.ratio(1, 2));
    let later = pool.add(te, he);
    let mut end: FxHashMap<Symbol, Expr> = FxHashMap::default();
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        end.insert(s.symbol, pool.add(x, d));
    }
    end.insert(t, later);
    let followed: FxHashSet<ColumnId> = c.followed.iter().copied().collect();
    for n in &c.nodes {
        match (n.part, n.how) {
            (Part::Source(column), Output::Explicit(e)) if followed.contains(&column) => {
                let after = pool.substitute(e, &end);
                let sum = pool.add(e, after);
                map.insert(form.column(column).out, pool.mul(half, sum));
            }
            (Part::Follower(state), _) => {
                let after = pool.substitute(state, &end);
                let change = pool.sub(after, state);
                map.insert(n.out, pool.div(change, he));
            }
            (Part::Source(_) | Part::Resistor(_) | Part::Signal, _) => {}
        }
    }
}

/// The step's unknowns with their residuals: changes of the states, then loops.
pub(super) fn system(c: &Cluster, pool: &mut Pool, flat: &FxHashMap<Symbol, Expr>) -> (Vec<Symbol>, Vec<Expr>) {
    let mut unknowns = c.delta.clone();
    let mut residuals = Vec::new();
    if let Some(h) = c.h {
        let h = pool.var(h);
        for (s, d) in c.states.iter().zip(&c.delta) {
            let rate = pool.substitute(s.rate, flat);
            let step = pool.mul(h, rate);
            let d = pool.var(*d);
            residuals.push(pool.sub(d, step));
        }
    }
    for r in c.loop_residuals(pool) {
        residuals.push(pool.substitute(r, flat));
    }
    unknowns.extend(c.loops.iter().copied());
    (unknowns, residuals)
}

/// Weights and scales of the step's unknowns.
pub(super) fn measures(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    inputs: &write::Inputs,
) -> Result<(Vec<Value>, Vec<Value>), Vec<Diagnostic>> {
    let mut weight = Vec::new();
    for k in measure::curvatures(c, model) {
        weight.push(lowering.lower(&model.pool, b, k).map_err(|s| missing(model, s))?);
    }
    if let Some(h) = c.h {
        let h = model.pool.var(h);
        weight.extend(measure::weights_of_loops(c, model, form, b, lowering, &inputs.guesses, h)?);
    }
    let h = c.h.map(|h| model.pool.var(h));
    let scale = measure::scales(c, model, form, b, lowering, (&inputs.states, &inputs.traces, &inputs.guesses), h)?;
    Ok((weight, scale))
}

/// So many states are many.
const MANY: usize = 64;
/// The largest product of a stiffness and an inverse inertia over the least, from which on a region is stiff.
const STIFF: f64 = 1e8;
/// The same times the square of a step, from which on the step is long.
const LONG: f64 = 1e4;

/// Whether the fastest motion of a region is far faster than the slowest, or than a step, as its energies bend at the
/// start. How far a stiff spring between two bodies is drawn out is a small difference of how far these go in a step:
/// where it follows from their momenta, the rounding of that is a force that the iteration cannot take back; as an
/// unknown of its own it has its own digits.
pub(super) fn is_stiff(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let start = c.start(model);
    // Stiffnesses and inverse inertias: the least and the largest.
    let mut bends = [(f64::INFINITY, 0.0f64); 2];
    for (s, k) in c.states.iter().zip(measure::curvatures(c, model)) {
        let Some(column) = s.column else { continue };
        let k = start.eval(&model.pool, k);
        if k > 0.0 && k.is_finite() {
            let (least, most) = &mut bends[usize::from(form.column(column).gives == Variable::Flow)];
            (*least, *most) = (least.min(k), most.max(k));
        }
    }
    let [(soft, hard), (heavy, light)] = bends;
    hard * light > STIFF * soft * heavy || hard * light * start.step * start.step > LONG
}

/// Whether coefficients are taken as they stand. What rounding takes from states and coefficients is seen where nothing
/// else takes energy; of many states that are linear it is not worth its time.
pub(super) fn is_whole(c: &Cluster, pool: &mut Pool) -> bool {
    c.is_lossless() && (c.states.len() <= MANY || !super::collocation::all_quadratic(c, pool))
}

/// Writes the step. Where it is the cluster's own, rather than what another stepper falls back to, `own` says so: its
/// memory is then that of [`super::ahead`].
pub(super) fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    own: bool,
) -> Result<(Stepper, Vec<Entries>), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "gonzalez step"));
    let entries = c.reserve(model, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let mut map = midpoint(c, &mut model.pool, form);
    let sources = write::sources(c, &mut model.pool, &mut map, |name| format!("{name} in the middle"));
    write::bind(model, &mut b, &mut lowering, &sources)?;
    let flat = c.flat(&mut model.pool, map);
    let (unknowns, mut residuals) = system(c, &mut model.pool, &flat);
    let symbols = c.states.iter().map(|s| s.symbol).collect();
    turn::angles(model, &mut b, &mut lowering, &c.energies(), &symbols)?;
    let whole = is_whole(c, &mut model.pool);
    if whole {
        whole::carried(c, model, &mut b, &mut lowering, &inputs, &mut residuals);
    }
    let (weight, scale) = measures(c, model, form, &mut b, &mut lowering, &inputs)?;
    let zero = b.number(0.0);
    let rest: Vec<Value> = c.states.iter().map(|_| zero).chain(inputs.guesses.iter().copied()).collect();
    let ahead = if own { Ahead::new(&mut b, c, inputs.h) } else { None };
    let (start, cold) = match &ahead {
        Some(ahead) => {
            let start = ahead.start.iter().chain(&inputs.guesses).copied().collect();
            let known = c.delta.iter().copied().collect();
            let equations = (&unknowns[..], &residuals[..]);
            (write::foretold(model, &mut b, &lowering, equations, &c.arguments(), &known, start)?, rest)
        }
        None => (rest, Vec::new()),
    };
    let carries: Vec<Value> = inputs.carries.iter().map(|slot| b.load(*slot)).collect();
    let states = c.states.iter().map(|s| s.symbol).zip(carries.iter().copied().map(Some)).collect();
    let system = System {
        unknowns,
        h: c.h,
        start,
        residuals,
        weight,
        scale,
        whole,
        rests: true,
        left: write::left(c),
        small: if whole { carries } else { Vec::new() },
        states,
        bends: c.bends(),
        open: c.is_open(),
        corners: stiff::has_steep_corners(c, model, form),
        ..System::default()
    };
    let apart = !is_stiff(c, model, form);
    let lows = write::solve_from(model, &mut b, &mut lowering, (system, apart), cold)?;
    let (mut next, mut rests, mut changes) = (Vec::new(), Vec::new(), Vec::new());
    let many = write::is_many(c);
    for (x, change) in inputs.states.iter().zip(&c.delta) {
        let d = model.pool.var(*change);
        let d = lowering.lower(&model.pool, &mut b, d).map_err(|s| missing(model, s))?;
        let carry = b.load(inputs.carries[next.len()]);
        let (v, rest) = match lows.get(change) {
            Some(low) if whole => write::advance_whole(&mut b, *x, (d, *low), carry),
            low => write::advance(&mut b, *x, (d, low.copied()), carry, many),
        };
        next.push(v);
        rests.push(rest);
        changes.push(d);
    }
    write::ledger(c, model, form, &mut b, &mut lowering, &[(1.0, &flat)], &entries, inputs.h)?;
    let first = b.slots(Array::Next, c.slots()).index as usize;
    match &ahead {
        Some(ahead) => ahead.keep(&mut b, c, &changes),
        None => write::no_memory(&mut b, c),
    }
    for (i, v) in rests.iter().enumerate() {
        b.store(Slot::new(Array::Next, c.carry_at() + i), *v);
    }
    for (i, v) in next.iter().enumerate() {
        b.store(Slot::new(Array::Next, first + i), *v);
    }
    for (i, (integral, start)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rate = model.pool.substitute(integral.rate, &flat);
        let rate = lowering.lower(&model.pool, &mut b, rate).map_err(|s| missing(model, s))?;
        let change = b.mul(inputs.h, rate);
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, c.states.len() + i), v);
    }
    for (i, z) in c.loops.iter().enumerate() {
        let z = model.pool.var(*z);
        let v = lowering.lower(&model.pool, &mut b, z).map_err(|s| missing(model, s))?;
        b.store(Slot::new(Array::Next, c.states.len() + c.integrals.len() + i), v);
    }
    write::energies(c, model, &mut b, (&next, &rests), &inputs, &entries)?;
    let program = verified(model, b.finish())?;
    Ok((Stepper::new("gonzalez", 2, true, program), entries))
}
