//! The programs that solve a system: Newton's method, or once where it is large and affine.

use crate::discretise::cluster::missing;
use crate::discretise::equations::angle_addition::AngleSums;
use crate::discretise::equations::inputs::bind;
use crate::discretise::equations::roots::Roots;
use crate::discretise::equations::system::System;
use crate::discretise::equations::tearing::{Torn, tear};

use crate::expression::{Below, Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::Bends;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir;
use bond_runtime::ir::{Array, Builder, Knee, Newton, Slot, Value};
use bond_runtime::solve::newton::MAX_KNEES;
use rustc_hash::{FxHashMap, FxHashSet};

/// Of more unknowns than this an affine system is solved once.
const LARGE: usize = 64;

/// Solves a system; afterwards `lowering` has the values of the unknowns. What rounding took from these, where that is
/// asked for and known.
pub(crate) fn solve(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    system: System,
) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
    solve_from(model, b, lowering, (system, true), Vec::new())
}

/// Solves a system with a predicted start: `cold` is where else it starts, empty where the start is not predicted.
/// Unknowns that follow linearly from the others are taken out where it says so. What rounding took from unknowns,
/// where that is asked for and known.
pub(crate) fn solve_from(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    (mut system, apart): (System, bool),
    mut cold: Vec<Value>,
) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
    let h = system.h;
    let roots = Roots::of(model, b, lowering, &mut system, &mut cold)?;
    let all = system.unknowns.clone();
    // What is taken out is taken as it is, without that.
    let apart = apart && !system.redundant;
    let Torn { before, unknowns: torn } = if apart { tear(&mut model.pool, &mut system, h) } else { Torn::default() };
    bind(model, b, lowering, &before)?;
    let inside = if system.exact_coefficients { &torn[..] } else { &[] };
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
pub(crate) fn solved_for(pool: &mut Pool, mut system: System, apart: bool) -> Vec<Symbol> {
    if apart && !system.redundant && !Roots::are_in(pool, &system) {
        let (h, none) = (system.h, vec![Value(0); system.unknowns.len()]);
        (system.start, system.weight, system.scale) = (none.clone(), none.clone(), none);
        tear(pool, &mut system, h);
    }
    system.unknowns
}

/// Where an iteration starts: arguments of exponentials at what changes of the states alone, which `known` are, make of
/// them there.
pub(crate) fn predict_arguments(
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
    let mut jacobian = jacobian_of(&mut model.pool, &system.residuals, &place, torn);
    if system.redundant {
        damp(&mut model.pool, &mut jacobian, model.settings.thresholds.iteration.damping);
    }
    let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().chain(torn.iter().map(|t| t.0)).collect();
    if n <= LARGE {
        system.residuals = model.pool.factored(&system.residuals, &unknown, system.exact_coefficients);
        let entries: Vec<Expr> = jacobian.iter().map(|e| e.2).collect();
        for (e, new) in jacobian.iter_mut().zip(model.pool.factored(&entries, &unknown, false)) {
            e.2 = new;
        }
    }
    // Few unknowns are cheap to look at again, which takes the rounding of the solution off.
    let affine = (n > LARGE || system.once)
        && !system.redundant
        && jacobian.iter().all(|t| !model.pool.contains_any(t.2, &|s| unknown.contains(&s)));
    if affine && !system.once {
        at_once(model, b, lowering, &system, slots, &jacobian)?;
        return Ok(FxHashMap::default());
    }
    let rests = (system.rests && !affine).then(|| b.slots(Array::Local, n));
    let knees = if n <= MAX_KNEES { knees(&system) } else { Vec::new() };
    limit(b, &mut system, &mut cold, (&knees, model.settings.thresholds.iteration.max_exponent));
    for (i, v) in system.start.iter().enumerate() {
        b.store(slot(i), *v);
    }
    // What does not change in the iteration is computed before it.
    let all: Vec<Expr> = system.residuals.iter().copied().chain(jacobian.iter().map(|t| t.2)).collect();
    for e in fixed_parts(&model.pool, torn.iter().map(|t| t.1).chain(all.iter().copied()), &unknown) {
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
    }
    let turns = AngleSums::of(&mut model.pool, &all, &unknown, &system.states);
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
    // What was taken out is computed in and after the iteration, and has to be the same to the last digit: by a
    // rounding between the two the energy goes one way.
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
    let options = model.settings.thresholds.newton;
    b.close(Newton {
        unknowns: slots.index,
        rounding: rests.map(|r| r.index),
        body: Vec::new(),
        residual,
        jacobian: entries,
        update: Vec::new(),
        left: system.left.unwrap_or(options.rounding),
        weight: system.weight,
        scale: system.scale,
        cold,
        small: system.small,
        knees,
        options,
        limit: 200,
        affine,
        undetermined: system.undetermined && !affine,
        corners: system.non_smooth && !affine,
        flag: system.flag,
    });
    for (i, s) in system.unknowns.iter().enumerate() {
        let v = b.load(slot(i));
        lowering.bind(*s, v);
    }
    Ok(taken(b, &system.unknowns, rests))
}

/// Makes pivots larger by a part of them. Where equations say the same, elimination leaves that part of the last one's,
/// and not 0: an update leaves alone what they do not determine.
fn damp(pool: &mut Pool, jacobian: &mut [(u32, u32, Expr)], part: f64) {
    for (_, _, e) in jacobian.iter_mut().filter(|(i, j, _)| i == j) {
        *e = pool.scale(*e, Number::float(1.0 + part));
    }
}

/// The derivatives of residuals by the unknowns that have a place, where they are not 0; through what was taken out,
/// too.
fn jacobian_of(
    pool: &mut Pool,
    residuals: &[Expr],
    place: &FxHashMap<Symbol, u32>,
    torn: &[(Symbol, Expr)],
) -> Vec<(u32, u32, Expr)> {
    let followers: Vec<Vec<(u32, Expr)>> = torn.iter().map(|(_, e)| slopes(pool, *e, place)).collect();
    let torn_at: FxHashMap<Symbol, u32> = torn.iter().enumerate().map(|(k, t)| (t.0, k as u32)).collect();
    let mut jacobian: Vec<(u32, u32, Expr)> = Vec::new();
    for (i, r) in residuals.iter().enumerate() {
        let mut row = slopes(pool, *r, place);
        for (k, by) in slopes(pool, *r, &torn_at) {
            for &(j, with) in &followers[k as usize] {
                let d = pool.mul(by, with);
                match row.iter_mut().find(|e| e.0 == j) {
                    Some(e) => e.1 = pool.add(e.1, d),
                    None => row.push((j, d)),
                }
            }
        }
        row.sort_unstable_by_key(|e| e.0);
        jacobian.extend(row.into_iter().filter(|e| !pool.is_zero(e.1)).map(|(j, d)| (i as u32, j, d)));
    }
    jacobian
}

/// Has an iteration start no further up an exponential than `most` units, and measures its arguments against their
/// units: an argument near 0 is known no better than to the rounding of the exponential, which is 1 there.
fn limit(b: &mut Builder, system: &mut System, cold: &mut [Value], (knees, most): (&[Knee], f64)) {
    for knee in knees {
        let one = b.number(1.0 / knee.rate.abs());
        let scale = &mut system.scale[knee.unknown as usize];
        *scale = b.add(*scale, one);
    }
    for list in [&mut system.start[..], cold] {
        for knee in knees {
            let Some(x) = list.get_mut(knee.unknown as usize) else { continue };
            let most = b.number(knee.knee + most / knee.rate);
            *x = b.binary(if knee.rate > 0.0 { ir::Binary::Min } else { ir::Binary::Max }, *x, most);
        }
    }
}

/// What rounding took from unknowns, from where an iteration leaves it.
pub(crate) fn taken(b: &mut Builder, unknowns: &[Symbol], rests: Option<Slot>) -> FxHashMap<Symbol, Value> {
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
    system.knees.iter().flat_map(sides).collect()
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
pub(crate) fn opposite(
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
pub(crate) fn fixed_parts(pool: &Pool, all: impl IntoIterator<Item = Expr>, unknown: &FxHashSet<Symbol>) -> Vec<Expr> {
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
