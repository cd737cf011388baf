//! The simplified Newton method of collocation. With J, the matrix of the rates' derivatives at the middle of the step,
//! the equations of all stages are I ⊗ P + A ⊗ Q, and A's eigenvectors take them apart: a system of the size of one
//! stage for each eigenvalue λ, P + λ Q, of two conjugate ones only one. They are eliminated once a step, and all
//! iterations share the factors.

use super::complex::{Algebra, Cx, Entries, Factors};
use super::modes::{Mode, modes};
use super::tableau::Tableau;
use super::{BENT, COUPLED, Nodes, is_quadratic};
use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::write::{Inputs, System, fixed_parts};
use crate::expression::{Expr, Lowering, Pool, Symbol};
use crate::model::Model;
use crate::structure::{Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Inst, Newton, Slot, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// Systems of so many unknowns are eliminated in straight code; larger ones by a pattern.
const STRAIGHT: usize = 8;
/// Iterations at most: one that needs more is better off with a shorter step.
const LIMIT: u32 = 20;

/// The equations of all stages, to be taken apart.
pub(in crate::discretise) struct Apart {
    tableau: Tableau,
    modes: Vec<Mode>,
    /// Unknowns of a stage.
    n: usize,
    /// Derivatives of a stage's rates and loop equations: row, unknown, and where they are not 0, what.
    slopes: Vec<(usize, usize, Expr)>,
    /// Whether these are the same wherever the state is, so that the equations are linear.
    fixed: bool,
}

/// Entries of P and Q, where they are not 0.
struct Matrices {
    n: usize,
    p: Entries,
    q: Entries,
}

impl Apart {
    /// None where there are few unknowns, which are solved for together.
    pub(in crate::discretise) fn new(c: &Cluster, model: &mut Model, form: &Form, nodes: Nodes) -> Option<Self> {
        let tableau = nodes.tableau();
        let n = c.states.len() + c.loops.len();
        // What a curve's matrix in the middle tells is not that of its other branches.
        let bends = c.loop_nodes().iter().any(|n| matches!(n.how, Output::Curve { .. }));
        if n * tableau.stages() <= if bends { BENT } else { COUPLED } {
            return None;
        }
        let a: Vec<Vec<f64>> = tableau.nodes.iter().map(|node| tableau.integrals(*node)).collect();
        let modes = modes(&a)?;
        let map = c.at_instant(&mut model.pool, form);
        let flat = c.flat(&mut model.pool, map);
        let mut rows: Vec<Expr> = c.states.iter().map(|s| model.pool.substitute(s.rate, &flat)).collect();
        for r in c.loop_residuals(&mut model.pool) {
            rows.push(model.pool.substitute(r, &flat));
        }
        let places = c.states.iter().map(|s| s.symbol).chain(c.loops.iter().copied());
        let place: FxHashMap<Symbol, usize> = places.enumerate().map(|(i, s)| (s, i)).collect();
        let is_place = |s: Symbol| place.contains_key(&s);
        let mut fixed = quadratic(c, &mut model.pool);
        let mut slopes = Vec::new();
        for (i, row) in rows.into_iter().enumerate() {
            let mut by: Vec<(usize, Symbol)> =
                model.pool.symbols(row).into_iter().filter_map(|s| Some((*place.get(&s)?, s))).collect();
            by.sort_unstable();
            let symbols: Vec<Symbol> = by.iter().map(|b| b.1).collect();
            for ((j, _), d) in by.into_iter().zip(model.pool.derivatives(row, &symbols)) {
                if !model.pool.is_zero(d) {
                    fixed &= !model.pool.contains_any(d, &is_place);
                    slopes.push((i, j, d));
                }
            }
        }
        Some(Self { tableau, modes, n, slopes, fixed })
    }

    /// Whether the equations are linear, and solved as such: a small system is cheap to look at again, which takes the
    /// rounding of the solution off.
    pub(in crate::discretise) fn is_linear(&self) -> bool {
        self.fixed && self.n > STRAIGHT
    }

    /// Solves linear equations.
    pub(super) fn at_once(
        &self,
        c: &Cluster,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        (unknowns, residuals): (&[Symbol], &[Expr]),
        inputs: &Inputs,
    ) -> Result<(), Vec<Diagnostic>> {
        let matrices = self.matrices(c, model, b, inputs, None)?;
        let zero = model.pool.zero();
        let none: FxHashMap<Symbol, Expr> = unknowns.iter().map(|u| (*u, zero)).collect();
        let mut right = Vec::with_capacity(unknowns.len());
        for r in model.pool.substitute_all(residuals, &none) {
            let v = lowering.lower(&model.pool, b, r).map_err(|s| missing(model, s))?;
            right.push(b.unary(Unary::Neg, v));
        }
        let found = apart(b, (&self.modes, &matrices, None), &right, false);
        for (s, v) in unknowns.iter().zip(found) {
            lowering.bind(*s, v);
        }
        Ok(())
    }

    /// Solves the equations of a step by iteration.
    pub(super) fn iterate(
        &self,
        c: &Cluster,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        (system, inputs): (&System, &Inputs),
    ) -> Result<(), Vec<Diagnostic>> {
        let matrices = self.matrices(c, model, b, inputs, Some(&system.start))?;
        let n = self.n;
        let size = system.unknowns.len();
        let factors: Option<Vec<Factors>> = (n <= STRAIGHT).then(|| {
            let mut algebra = Algebra { b };
            self.modes.iter().map(|m| Factors::new(&mut algebra, n, &matrices.p, &matrices.q, m.value)).collect()
        });
        let slots = b.slots(Array::Local, size);
        let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
        for (i, (s, v)) in system.unknowns.iter().zip(&system.start).enumerate() {
            b.name(slot(i), model.pool.name(*s));
            b.store(slot(i), *v);
        }
        let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().collect();
        for e in fixed_parts(&model.pool, system.residuals.iter().copied(), &unknown) {
            lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
        }
        let mut inside = lowering.clone();
        b.open(slots, size);
        for (i, s) in system.unknowns.iter().enumerate() {
            let v = b.load(slot(i));
            inside.bind(*s, v);
        }
        let mut residual = Vec::with_capacity(size);
        for r in &system.residuals {
            residual.push(inside.lower(&model.pool, b, *r).map_err(|s| missing(model, s))?);
        }
        let update = apart(b, (&self.modes, &matrices, factors.as_deref()), &residual, true);
        b.close(Newton {
            unknowns: slots.index,
            body: Vec::new(),
            residual,
            jacobian: Vec::new(),
            update,
            weight: system.weight.clone(),
            scale: system.scale.clone(),
            cold: Vec::new(),
            limit: LIMIT,
            affine: false,
            flag: None,
        });
        for (i, s) in system.unknowns.iter().enumerate() {
            let v = b.load(slot(i));
            lowering.bind(*s, v);
        }
        Ok(())
    }

    /// P and Q at the middle of the step that the guesses foretell, if there are any.
    fn matrices(
        &self,
        c: &Cluster,
        model: &mut Model,
        b: &mut Builder,
        inputs: &Inputs,
        guesses: Option<&[Value]>,
    ) -> Result<Matrices, Vec<Diagnostic>> {
        let (n, states) = (self.n, c.states.len());
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
        if let Some(guesses) = guesses {
            let weights = self.tableau.integrals(0.5);
            for (k, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
                let mut sum = *x;
                for (j, w) in weights.iter().enumerate() {
                    let w = b.number(*w);
                    let term = b.mul(w, guesses[j * n + k]);
                    sum = b.add(sum, term);
                }
                lowering.bind(s.symbol, sum);
            }
            let middle = self.tableau.stages() / 2;
            for (k, z) in c.loops.iter().enumerate() {
                lowering.bind(*z, guesses[middle * n + states + k]);
            }
        }
        let mut m = Matrices { n, p: Entries::new(), q: Entries::new() };
        let one = b.number(1.0);
        m.p.extend((0..states).map(|i| (i, i, one)));
        for &(i, j, d) in &self.slopes {
            let mut v = lowering.lower(&model.pool, b, d).map_err(|s| missing(model, s))?;
            if i < states {
                let less = b.unary(Unary::Neg, inputs.h);
                v = b.mul(less, v);
            }
            let to = if j < states { &mut m.q } else { &mut m.p };
            to.push((i, j, v));
        }
        m.p.sort_unstable_by_key(|e| (e.0, e.1));
        Ok(m)
    }
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
