//! The simplified Newton method of collocation. With J, the matrix of the rates' derivatives at the middle of the step,
//! the equations of all stages are I ⊗ P + A ⊗ Q, and A's eigenvectors take them apart: a system of the size of one
//! stage for each eigenvalue λ, P + λ Q, of two conjugate ones only one. They are eliminated once a step, and all
//! iterations share the factors.

use super::complex::{Algebra, Cx, Entries, Factors};
use super::modes::{Mode, Pair, modes};
use super::tableau::{Nodes, Tableau};

use crate::discretise::analysis::polynomial::all_quadratic;
use crate::discretise::analysis::relay;
use crate::discretise::analysis::smoothness::{is_kink, laws};
use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::equations::angle_addition::AngleSums;
use crate::discretise::equations::inputs::Inputs;
use crate::discretise::equations::newton::{fixed_parts, opposite, taken};
use crate::discretise::equations::system::System;
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::Model;
use crate::structure::{Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::double_double::DoubleDouble;
use bond_runtime::ir::{Array, Binary, Builder, Newton, Slot, Solve, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};
use std::f64::consts::TAU;

/// Systems of at most this many unknowns are eliminated in straight code; larger ones by a pattern.
const STRAIGHT: usize = 8;

/// Up to this many unknowns of a stage a complex system is a real one of twice as many, in which rows are exchanged
/// where a pivot is bad.
const REAL: usize = 32;

/// The part of the unknowns that an iteration may leave.
const LEFT: f64 = 1e-18;

/// Iterations at most: one that needs more is better off with a shorter step.
const LIMIT: u32 = 20;

/// The equations of all stages, to be taken apart.
pub(crate) struct Decoupled {
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

impl Decoupled {
    /// None where there are few unknowns, which are solved for together; not where the equations are linear: taken
    /// apart they keep the balance of a stiff oscillator a hundred times as well, nothing being eliminated by hand.
    pub(crate) fn new(c: &Cluster, model: &mut Model, form: &Form, nodes: Nodes) -> Option<Self> {
        let tableau = nodes.tableau();
        // The matrix in the middle is not that of a curve's other branches, or of a law beyond its kink.
        let curve = c.loop_nodes().iter().any(|n| matches!(n.how, Output::Curve { .. }));
        let bends = curve || laws(c).iter().any(|e| model.pool.any_node(*e, &is_kink));
        let n = c.states.len() + c.loops.len();
        let few = n * tableau.stages() <= COUPLED
            || (is_coupled(c, tableau.stages()) && (bends || relay::has_relay(c, model, form)));
        if few && !all_quadratic(c, &mut model.pool) {
            return None;
        }
        let modes = modes(&tableau.matrix())?;
        let flat = c.flat_at_instant(&mut model.pool, form);
        let mut rows: Vec<Expr> = c.states.iter().map(|s| model.pool.substitute(s.rate, &flat)).collect();
        rows.extend(c.residuals_in(&mut model.pool, &flat));
        let places = c.states.iter().map(|s| s.symbol).chain(c.loops.iter().copied());
        let place: FxHashMap<Symbol, usize> = places.enumerate().map(|(i, s)| (s, i)).collect();
        let is_place = |s: Symbol| place.contains_key(&s);
        let varies = |s: Symbol| Some(s) == c.time || c.inputs.iter().any(|i| i.1 == s);
        // Whether the matrix is another at each node, as that of a resistance that is switched in time.
        let mut timed = false;
        let mut fixed = all_quadratic(c, &mut model.pool);
        let mut slopes = Vec::new();
        for (i, row) in rows.into_iter().enumerate() {
            let mut by: Vec<(usize, Symbol)> =
                model.pool.symbols(row).into_iter().filter_map(|s| Some((*place.get(&s)?, s))).collect();
            by.sort_unstable();
            let symbols: Vec<Symbol> = by.iter().map(|b| b.1).collect();
            for ((j, _), d) in by.into_iter().zip(model.pool.derivatives(row, &symbols)) {
                if !model.pool.is_zero(d) {
                    timed |= model.pool.contains_any(d, &varies);
                    fixed &= !timed && !model.pool.contains_any(d, &is_place);
                    slopes.push((i, j, d));
                }
            }
        }
        let together = few || timed && is_coupled(c, tableau.stages());
        (fixed || !together).then_some(Self { tableau, modes, n, slopes, fixed })
    }

    /// Whether the equations are linear, and solved as such: a small system is cheap to look at again, which takes the
    /// rounding of the solution off.
    pub(crate) fn is_linear(&self) -> bool {
        self.fixed && self.n > STRAIGHT
    }

    /// Solves linear equations; what each state changes by over the step.
    ///
    /// That is Σ b_j D_j, and with D_j = Σ r_j y over the modes a sum of a few numbers for each state: what stages give
    /// is had besides, for who asks for it.
    pub(crate) fn at_once(
        &self,
        c: &Cluster,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        (unknowns, residuals): (&[Symbol], &[Expr]),
        inputs: &Inputs,
    ) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let matrices = self.matrices(c, model, b, inputs, None)?;
        let right = opposite(model, b, lowering, (unknowns, residuals))?;
        let along = along(b, (&self.modes, &matrices, None), &right, false);
        for (s, v) in unknowns.iter().zip(stages(b, &self.modes, &along, unknowns.len())) {
            lowering.bind(*s, v);
        }
        let weights = &self.tableau.weights;
        let total = |mode: &Mode| {
            let parts = weights.iter().zip(&mode.right).map(|(w, (re, im))| (w.high * re, w.high * im));
            parts.fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1))
        };
        let totals: Vec<Pair> = self.modes.iter().map(total).collect();
        let zero = b.number(0.0);
        let change = |k: usize| {
            let mut algebra = Algebra { b };
            let mut sum = None;
            for ((mode, found), by) in self.modes.iter().zip(&along).zip(&totals) {
                let term = share(&mut algebra, mode, *by, found[k]);
                sum = algebra.add(sum, term);
            }
            sum.unwrap_or(zero)
        };
        Ok((0..c.states.len()).map(change).collect())
    }

    /// Solves the equations of a step by iteration.
    pub(crate) fn iterate(
        &self,
        c: &Cluster,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        (system, inputs): (&System, &Inputs),
    ) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
        let matrices = self.matrices(c, model, b, inputs, Some(&system.start))?;
        let n = self.n;
        let size = system.unknowns.len();
        let factors: Option<Vec<Factors>> = (n <= STRAIGHT).then(|| {
            let mut algebra = Algebra { b };
            self.modes.iter().map(|m| Factors::new(&mut algebra, n, &matrices.p, &matrices.q, m.value)).collect()
        });
        let slots = b.slots(Array::Local, size);
        let rests = system.rests.then(|| b.slots(Array::Local, size));
        let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
        for (i, (s, v)) in system.unknowns.iter().zip(&system.start).enumerate() {
            b.name(slot(i), model.pool.name(*s));
            b.store(slot(i), *v);
        }
        let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().collect();
        for e in fixed_parts(&model.pool, system.residuals.iter().copied(), &unknown) {
            lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
        }
        let turns = AngleSums::of(&mut model.pool, &system.residuals, &unknown, &system.states);
        let before = turns.as_ref().map(|t| t.before(model, b, lowering, &system.states)).transpose()?;
        // Of what counts by its sine and cosine alone, however many turns it has made, one is its size.
        let mut scale = system.scale.clone();
        let only = turns.as_ref().map(|t| t.only(&model.pool, &system.residuals)).unwrap_or_default();
        for (k, _) in system.states.iter().enumerate().filter(|(_, (s, _))| only.contains(s)) {
            let turn = b.number(TAU);
            for x in scale.iter_mut().skip(k).step_by(n) {
                let small = b.binary(Binary::Lt, *x, turn);
                *x = b.select(small, *x, turn);
            }
        }
        let mut inside = lowering.clone();
        b.open(slots, size);
        for (i, s) in system.unknowns.iter().enumerate() {
            let v = b.load(slot(i));
            inside.bind(*s, v);
        }
        if let (Some(turns), Some(before)) = (&turns, &before) {
            turns.write(model, b, &mut inside, before)?;
        }
        let mut residual = Vec::with_capacity(size);
        for r in &system.residuals {
            residual.push(inside.lower(&model.pool, b, *r).map_err(|s| missing(model, s))?);
        }
        let along = along(b, (&self.modes, &matrices, factors.as_deref()), &residual, true);
        let update = stages(b, &self.modes, &along, size);
        b.close(Newton {
            unknowns: slots.index,
            rounding: rests.map(|r| r.index),
            body: Vec::new(),
            residual,
            jacobian: Vec::new(),
            update,
            left: system.left.unwrap_or(LEFT),
            weight: system.weight.clone(),
            scale,
            cold: Vec::new(),
            small: Vec::new(),
            knees: Vec::new(),
            options: c.thresholds.newton,
            limit: LIMIT,
            affine: false,
            undetermined: false,
            corners: false,
            flag: None,
        });
        for (i, s) in system.unknowns.iter().enumerate() {
            let v = b.load(slot(i));
            lowering.bind(*s, v);
        }
        Ok(taken(b, &system.unknowns, rests))
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
            let weights = self.tableau.integrals(DoubleDouble::new(0.5));
            for (k, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
                let mut sum = *x;
                for (j, w) in weights.iter().enumerate() {
                    let w = b.number(w.high);
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

/// The solution of the linear equations of all stages with a right side, as its parts along the modes.
fn along(b: &mut Builder, (modes, m, factors): Parts, right: &[Value], inside: bool) -> Vec<Vec<Cx>> {
    let n = m.n;
    let mut algebra = Algebra { b };
    let parts: Vec<Vec<Cx>> =
        modes.iter().map(|mode| (0..n).map(|i| part(&mut algebra, mode, right, n, i)).collect()).collect();
    let solve = |(k, (mode, right)): (usize, (&Mode, Vec<Cx>))| match factors {
        Some(list) => list[k].solve(&mut Algebra { b }, &right),
        None => by_pattern(b, m, mode, &right, inside),
    };
    modes.iter().zip(parts).enumerate().map(solve).collect()
}

/// What the unknowns of all stages, so many, are whose parts along the modes these are.
fn stages(b: &mut Builder, modes: &[Mode], along: &[Vec<Cx>], count: usize) -> Vec<Value> {
    let n = along.first().map_or(0, Vec::len);
    let mut algebra = Algebra { b };
    let mut sums: Vec<Option<Value>> = vec![None; count];
    for (mode, found) in modes.iter().zip(along) {
        for (j, by) in mode.right.iter().enumerate() {
            for (i, y) in found.iter().enumerate() {
                let term = share(&mut algebra, mode, *by, *y);
                sums[j * n + i] = algebra.add(sums[j * n + i], term);
            }
        }
    }
    let zero = b.number(0.0);
    sums.into_iter().map(|u| u.unwrap_or(zero)).collect()
}

/// What a part along a mode adds where it counts by a number, with that of the conjugate mode.
fn share(algebra: &mut Algebra, mode: &Mode, by: Pair, y: Cx) -> Option<Value> {
    let twice = if mode.is_real() { 1.0 } else { 2.0 };
    let (x, z) = (algebra.times(twice * by.0, y.re), algebra.times(twice * by.1, y.im));
    algebra.sub(x, z)
}

/// The part of the residuals of all stages along a mode, for the i-th unknown of a stage.
fn part(algebra: &mut Algebra, mode: &Mode, residual: &[Value], n: usize, i: usize) -> Cx {
    // In linear equations most are the same in each stage.
    let mut distinct: Vec<(Value, Pair)> = Vec::with_capacity(mode.left.len());
    for (j, (re, im)) in mode.left.iter().enumerate() {
        let r = residual[j * n + i];
        match distinct.iter_mut().find(|d| d.0 == r) {
            Some((_, sum)) => *sum = (sum.0 + re, sum.1 + im),
            None => distinct.push((r, (*re, *im))),
        }
    }
    let mut sum = Cx::default();
    for (r, (re, im)) in &distinct {
        let r = Some(*r);
        let (x, y) = (algebra.times(*re, r), algebra.times(*im, r));
        sum = Cx { re: algebra.add(sum.re, x), im: algebra.add(sum.im, y) };
    }
    sum
}

/// Solves (P + λ Q) y = right by an elimination of a fixed pattern.
/// `inside` an iteration a system without a solution ends that; else it fails the step.
fn by_pattern(b: &mut Builder, m: &Matrices, mode: &Mode, right: &[Cx], inside: bool) -> Vec<Cx> {
    let n = m.n;
    let parts = if mode.is_real() { 1 } else { 2 };
    let zero = b.number(0.0);
    let right: Vec<Value> =
        right.iter().flat_map(|x| [x.re, x.im].into_iter().take(parts)).map(|x| x.unwrap_or(zero)).collect();
    let size = parts * n;
    let (slots, flag) = (b.slots(Array::Local, size), b.slot(Array::Local));
    let slot = |i: usize| Slot { array: Array::Local, index: slots.index + i as u32 };
    let (matrix, imaginary) = if parts == 2 && n > REAL { complex(b, m, mode) } else { (real(b, m, mode), Vec::new()) };
    b.solve(Solve { unknowns: slots.index, right, matrix, imaginary, flag: inside.then_some(flag) });
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

/// Entries of a system: row, column, value.
type Sparse = Vec<(u32, u32, Value)>;

/// P + λ Q with real and imaginary parts as unknowns of their own.
fn real(b: &mut Builder, m: &Matrices, mode: &Mode) -> Sparse {
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
    let mut list: Sparse = entries.into_iter().map(|((i, j), v)| (i, j, v)).collect();
    list.sort_unstable_by_key(|e| (e.0, e.1));
    list
}

/// P + λ Q, and the imaginary parts of its entries.
fn complex(b: &mut Builder, m: &Matrices, mode: &Mode) -> (Sparse, Vec<Value>) {
    let zero = b.number(0.0);
    let mut entries: FxHashMap<(u32, u32), (Value, Value)> = FxHashMap::default();
    for &(i, j, v) in &m.p {
        entries.insert((i as u32, j as u32), (v, zero));
    }
    for &(i, j, v) in &m.q {
        let (re, im) = (b.number(mode.value.0), b.number(mode.value.1));
        let (re, im) = (b.mul(re, v), b.mul(im, v));
        let at = entries.entry((i as u32, j as u32)).or_insert((zero, zero));
        at.0 = if at.0 == zero { re } else { b.add(at.0, re) };
        at.1 = im;
    }
    let mut list: Vec<_> = entries.into_iter().collect();
    list.sort_unstable_by_key(|e| e.0);
    list.into_iter().map(|((i, j), (re, im))| ((i, j, re), im)).unzip()
}

/// Up to this many unknowns in all stages, equations that are not linear are solved as one, by Newton's method with its
/// whole matrix.
const COUPLED: usize = 8;

/// The same where a resistor is a curve, or a law has a kink.
const BENT: usize = 48;

/// Whether the stages of a cluster with kinks are solved together.
pub(crate) fn is_coupled(c: &Cluster, stages: usize) -> bool {
    (c.states.len() + c.loops.len()) * stages <= BENT
}
