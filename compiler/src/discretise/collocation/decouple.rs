//! The simplified Newton method of collocation. With J, the matrix of the rates' derivatives at the middle of the step, the equations
//! of all stages are I ⊗ P + A ⊗ Q, and A's eigenvectors take them apart: a system of the size of one stage for each eigenvalue λ,
//! P + λ Q, of two conjugate ones only one. They are eliminated once a step, and all iterations share the factors.

use super::complex::{Algebra, Cx, Entries, Factors};
use super::modes::{Mode, modes};
use super::tableau::Tableau;
use super::{Plan, is_quadratic};
use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::write::{Inputs, fixed_parts};
use crate::expression::{Expr, Lowering, Pool, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Inst, Newton, Slot, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// Systems of so many unknowns are eliminated in straight code; larger ones by a pattern.
const STRAIGHT: usize = 8;
/// Iterations at most: one that needs more is better off with a shorter step.
const LIMIT: u32 = 20;

/// What the unknowns start from, and what an iteration's numbers are measured by.
pub(super) struct Start {
    pub(super) unknowns: Vec<Symbol>,
    pub(super) residuals: Vec<Expr>,
    pub(super) guesses: Vec<Value>,
    pub(super) weight: Vec<Value>,
    pub(super) scale: Vec<Value>,
}

/// Entries of P and Q, where they are not 0.
struct Matrices {
    n: usize,
    p: Entries,
    q: Entries,
    /// Whether they are the same wherever the state is, so that the equations are linear.
    fixed: bool,
}

/// Solves the equations of a step, all stages at once. `None` where the method's matrix could not be taken apart.
pub(super) fn solve(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    plan: &Plan,
    (start, inputs): (&Start, &Inputs),
) -> Result<Option<()>, Vec<Diagnostic>> {
    let t = &plan.tableau;
    let a: Vec<Vec<f64>> = t.nodes.iter().map(|node| t.integrals(*node)).collect();
    let Some(modes) = modes(&a) else { return Ok(None) };
    let matrices = matrices(c, model, form, b, t, (start, inputs))?;
    let n = matrices.n;
    let size = start.unknowns.len();
    let factors: Option<Vec<Factors>> = (n <= STRAIGHT).then(|| {
        let mut algebra = Algebra { b };
        modes.iter().map(|m| Factors::new(&mut algebra, n, &matrices.p, &matrices.q, m.value)).collect()
    });
    // A small system is cheap to look at again, which takes the rounding of the solution off.
    if matrices.fixed && factors.is_none() {
        return linear(model, b, lowering, start, (&modes, &matrices, factors.as_deref())).map(Some);
    }
    let slots = b.slots(Array::Local, size);
    let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
    for (i, (s, v)) in start.unknowns.iter().zip(&start.guesses).enumerate() {
        b.name(slot(i), model.pool.name(*s));
        b.store(slot(i), *v);
    }
    let unknown: FxHashSet<Symbol> = start.unknowns.iter().copied().collect();
    for e in fixed_parts(&model.pool, start.residuals.iter().copied(), &unknown) {
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
    }
    let mut inside = lowering.clone();
    b.open(slots, size);
    for (i, s) in start.unknowns.iter().enumerate() {
        let v = b.load(slot(i));
        inside.bind(*s, v);
    }
    let mut residual = Vec::with_capacity(size);
    for r in &start.residuals {
        residual.push(inside.lower(&model.pool, b, *r).map_err(|s| missing(model, s))?);
    }
    let update = apart(b, (&modes, &matrices, factors.as_deref()), &residual, true);
    b.close(Newton {
        unknowns: slots.index,
        body: Vec::new(),
        residual,
        jacobian: Vec::new(),
        update,
        weight: start.weight.clone(),
        scale: start.scale.clone(),
        cold: Vec::new(),
        limit: LIMIT,
        affine: false,
        flag: None,
    });
    for (i, s) in start.unknowns.iter().enumerate() {
        let v = b.load(slot(i));
        lowering.bind(*s, v);
    }
    Ok(Some(()))
}

/// What takes the equations apart: modes, matrices, and where there are few unknowns, the factors.
type Parts<'a> = (&'a [Mode], &'a Matrices, Option<&'a [Factors]>);

/// The solution of the linear equations of all stages with a right side.
fn apart(b: &mut Builder, (modes, m, factors): Parts, right: &[Value], inside: bool) -> Vec<Value> {
    let n = m.n;
    let mut sums: Vec<Option<Value>> = vec![None; right.len()];
    for (k, mode) in modes.iter().enumerate() {
        let mut algebra = Algebra { b };
        let right: Vec<Cx> = (0..n).map(|i| part(&mut algebra, mode, right, n, i)).collect();
        let found = match factors {
            Some(list) => list[k].solve(&mut algebra, &right),
            None => by_pattern(b, m, mode, &right, inside),
        };
        let mut algebra = Algebra { b };
        let twice = if mode.is_real() { 1.0 } else { 2.0 };
        for (j, (re, im)) in mode.right.iter().enumerate() {
            for (i, y) in found.iter().enumerate() {
                let (x, z) = (algebra.times(twice * re, y.re), algebra.times(twice * im, y.im));
                let term = algebra.sub(x, z);
                sums[j * n + i] = algebra.add(sums[j * n + i], term);
            }
        }
    }
    let zero = b.number(0.0);
    sums.into_iter().map(|u| u.unwrap_or(zero)).collect()
}

/// The equations of a linear region: solved at once.
fn linear(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    start: &Start,
    parts: Parts,
) -> Result<(), Vec<Diagnostic>> {
    let zero = model.pool.zero();
    let none: FxHashMap<Symbol, Expr> = start.unknowns.iter().map(|u| (*u, zero)).collect();
    let mut right = Vec::with_capacity(start.unknowns.len());
    for r in model.pool.substitute_all(&start.residuals, &none) {
        let v = lowering.lower(&model.pool, b, r).map_err(|s| missing(model, s))?;
        right.push(b.unary(Unary::Neg, v));
    }
    let found = apart(b, parts, &right, false);
    for (s, v) in start.unknowns.iter().zip(found) {
        lowering.bind(*s, v);
    }
    Ok(())
}

/// Whether every energy is quadratic.
fn quadratic(c: &Cluster, pool: &mut Pool) -> bool {
    c.groups.iter().all(|g| is_quadratic(c, pool, g))
}

/// The part of the residuals of all stages along a mode, for the i-th unknown of a stage.
fn part(algebra: &mut Algebra, mode: &Mode, residual: &[Value], n: usize, i: usize) -> Cx {
    let mut sum = Cx::default();
    for (j, (re, im)) in mode.left.iter().enumerate() {
        let r = Some(residual[j * n + i]);
        let (x, y) = (algebra.times(*re, r), algebra.times(*im, r));
        sum = Cx { re: algebra.add(sum.re, x), im: algebra.add(sum.im, y) };
    }
    sum
}

/// Solves (P + λ Q) y = right by an elimination of a fixed pattern: real and imaginary parts as one system.
/// `inside` an iteration a system without a solution ends that; else it fails the step.
fn by_pattern(b: &mut Builder, m: &Matrices, mode: &Mode, right: &[Cx], inside: bool) -> Vec<Cx> {
    let n = m.n;
    let parts = if mode.is_real() { 1 } else { 2 };
    let mut entries: FxHashMap<(u32, u32), Value> = FxHashMap::default();
    let mut put = |b: &mut Builder, i: usize, j: usize, v: Value| {
        let at = entries.entry((i as u32, j as u32)).or_insert(v);
        if *at != v {
            *at = b.add(*at, v);
        }
    };
    for &(i, j, v) in &m.p {
        for k in 0..parts {
            put(b, parts * i + k, parts * j + k, v);
        }
    }
    for &(i, j, v) in &m.q {
        let re = b.number(mode.value.0);
        let re = b.mul(re, v);
        for k in 0..parts {
            put(b, parts * i + k, parts * j + k, re);
        }
        if parts == 2 {
            let im = b.number(mode.value.1);
            let im = b.mul(im, v);
            let less = b.unary(Unary::Neg, im);
            put(b, 2 * i, 2 * j + 1, less);
            put(b, 2 * i + 1, 2 * j, im);
        }
    }
    let mut jacobian: Vec<(u32, u32, Value)> = entries.into_iter().map(|((i, j), v)| (i, j, v)).collect();
    jacobian.sort_unstable_by_key(|e| (e.0, e.1));
    let size = parts * n;
    let (slots, flag) = (b.slots(Array::Local, size), b.slot(Array::Local));
    let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
    let (zero, one) = (b.number(0.0), b.number(1.0));
    let mut residual = Vec::new();
    for x in right {
        for x in [x.re, x.im].into_iter().take(parts) {
            residual.push(x.map_or(zero, |x| b.unary(Unary::Neg, x)));
        }
    }
    for i in 0..size {
        b.store(slot(i), zero);
    }
    let newton = Newton {
        unknowns: slots.index,
        body: Vec::new(),
        residual,
        jacobian,
        update: Vec::new(),
        weight: vec![one; size],
        scale: vec![one; size],
        cold: Vec::new(),
        limit: 1,
        affine: true,
        flag: inside.then_some(flag),
    };
    b.push(Inst::Newton(Box::new(newton)), slots, size + 1);
    let solved = inside.then(|| b.load(flag));
    let none = b.number(f64::NAN);
    let sound = |b: &mut Builder, x: Value| solved.map_or(x, |s| b.select(s, x, none));
    (0..n)
        .map(|i| {
            let re = b.load(slot(parts * i));
            let re = sound(b, re);
            let im = (parts == 2).then(|| b.load(slot(2 * i + 1)));
            Cx { re: Some(re), im }
        })
        .collect()
}

/// P and Q at the middle of the step that the guesses foretell.
fn matrices(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    t: &Tableau,
    (start, inputs): (&Start, &Inputs),
) -> Result<Matrices, Vec<Diagnostic>> {
    let (states, loops) = (c.states.len(), c.loops.len());
    let n = states + loops;
    let map = c.at_instant(&mut model.pool, form);
    let flat = c.flat(&mut model.pool, map);
    let mut rows: Vec<Expr> = c.states.iter().map(|s| model.pool.substitute(s.rate, &flat)).collect();
    for r in c.loop_residuals(&mut model.pool) {
        rows.push(model.pool.substitute(r, &flat));
    }
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let half = b.number(0.5);
    let ahead = b.mul(half, inputs.h);
    if let Some(time) = c.time {
        lowering.bind(time, b.add(inputs.t, ahead));
    }
    for ((_, u, _), (x, slope)) in c.inputs.iter().zip(&inputs.given) {
        let gone = b.mul(ahead, *slope);
        lowering.bind(*u, b.add(*x, gone));
    }
    let weights = t.integrals(0.5);
    for (k, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
        let mut sum = *x;
        for (j, w) in weights.iter().enumerate() {
            let w = b.number(*w);
            let term = b.mul(w, start.guesses[j * n + k]);
            sum = b.add(sum, term);
        }
        lowering.bind(s.symbol, sum);
    }
    let middle = t.stages() / 2;
    for (k, z) in c.loops.iter().enumerate() {
        lowering.bind(*z, start.guesses[middle * n + states + k]);
    }
    let place: FxHashMap<Symbol, usize> =
        c.states.iter().map(|s| s.symbol).chain(c.loops.iter().copied()).enumerate().map(|(i, s)| (s, i)).collect();
    let is_place = |s: Symbol| place.contains_key(&s);
    let fixed = quadratic(c, &mut model.pool);
    let mut m = Matrices { n, p: Entries::new(), q: Entries::new(), fixed };
    let one = b.number(1.0);
    for i in 0..states {
        m.p.push((i, i, one));
    }
    for (i, row) in rows.into_iter().enumerate() {
        let mut by: Vec<(usize, Symbol)> =
            model.pool.symbols(row).into_iter().filter_map(|s| Some((*place.get(&s)?, s))).collect();
        by.sort_unstable();
        let symbols: Vec<Symbol> = by.iter().map(|b| b.1).collect();
        let slopes = model.pool.derivatives(row, &symbols);
        for ((j, _), d) in by.into_iter().zip(slopes) {
            if model.pool.is_zero(d) {
                continue;
            }
            m.fixed &= !model.pool.contains_any(d, &is_place);
            let mut v = lowering.lower(&model.pool, b, d).map_err(|s| missing(model, s))?;
            if i < states {
                let less = b.unary(Unary::Neg, inputs.h);
                v = b.mul(less, v);
            }
            let to = if j < states { &mut m.q } else { &mut m.p };
            to.push((i, j, v));
        }
    }
    m.p.sort_unstable_by_key(|e| (e.0, e.1));
    Ok(m)
}
