//! The exact step of a linear cluster: the matrix exponential, inputs held, energies integrated exactly.
//!
//! With w = (x, xi), where xi are what drives the sources (constants, powers of t, sines, exponentials; anything else as its
//! cubic through four Gauss nodes of the step), dw/dt = A w; x+ = E w, means and energies are linear and quadratic forms in w.

use super::accounts::Accounts;
use super::cluster::{Cluster, missing, verified};
use super::write;
use crate::expression::{Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::exponential::{Layout, Linear};
use bond_runtime::ir::{Array, Builder, Inst, Slot, Unary};
use bond_runtime::scene::{Entries, Stepper};
use nalgebra::{DMatrix, DVector};
use rustc_hash::FxHashMap;

/// Largest number of states and drives.
const LARGEST: usize = 128;

/// Something that drives, as a state of its own.
#[derive(Clone, Debug, PartialEq)]
enum Drive {
    /// 1
    One,
    /// Held over the step: a port's variable or an expression without time.
    Held(Expr),
    /// A value at the start of the step, and what it changes by in a second, which is held over the step.
    Ramp(Expr, Expr),
    /// sin or cos (true: cos) of `rate t + phase`
    Wave(f64, f64, bool),
    /// exp(rate t + phase)
    Growth(f64, f64),
    /// t^n
    Power(u32),
    /// The k-th derivative at the start of the step of the cubic through an expression.
    Cubic(Expr, u32),
}

/// A value as a sum: coefficients of signals of the cluster, and of drives.
#[derive(Default)]
struct Split {
    signals: Vec<(Symbol, f64)>,
    drives: Vec<(usize, f64)>,
}

/// Nodes of the Gauss-Legendre rule of four points on [0, 1].
const NODES: [f64; 4] =
    [0.069_431_844_202_973_71, 0.330_009_478_207_571_87, 0.669_990_521_792_428_1, 0.930_568_155_797_026_3];

struct System {
    n: usize,
    time: Symbol,
    /// What is given from outside, with its slope; and what else is held.
    given: Vec<(Symbol, Symbol)>,
    held: Vec<Symbol>,
    drives: Vec<Drive>,
    /// Coefficients of each drive's derivative.
    moves: Vec<Vec<(usize, f64)>>,
}

impl System {
    fn drive(&mut self, d: Drive) -> usize {
        if let Some(i) = self.drives.iter().position(|x| *x == d) {
            return i;
        }
        let i = self.drives.len();
        self.drives.push(d.clone());
        self.moves.push(Vec::new());
        let moves = match d {
            Drive::One | Drive::Held(_) => vec![],
            Drive::Ramp(_, slope) => vec![(self.drive(Drive::Held(slope)), 1.0)],
            Drive::Wave(rate, phase, cos) => {
                let other = self.drive(Drive::Wave(rate, phase, !cos));
                vec![(other, if cos { -rate } else { rate })]
            }
            Drive::Growth(rate, _) => vec![(i, rate)],
            Drive::Power(0) => vec![],
            Drive::Power(k) => {
                let lower = if k == 1 { self.drive(Drive::One) } else { self.drive(Drive::Power(k - 1)) };
                vec![(lower, f64::from(k))]
            }
            Drive::Cubic(_, 3) => vec![],
            Drive::Cubic(e, k) => {
                let next = self.drive(Drive::Cubic(e, k + 1));
                vec![(next, 1.0)]
            }
        };
        self.moves[i] = moves;
        i
    }

    /// The drive of a signal that comes from outside the cluster.
    fn outer(&mut self, pool: &mut Pool, s: Symbol) -> Option<usize> {
        if s == self.time {
            return Some(self.drive(Drive::Power(1)));
        }
        let value = pool.var(s);
        if let Some(&(_, slope)) = self.given.iter().find(|g| g.0 == s) {
            let slope = pool.var(slope);
            return Some(self.drive(Drive::Ramp(value, slope)));
        }
        self.held.contains(&s).then(|| self.drive(Drive::Held(value)))
    }

    /// Whether an expression may change within a step.
    fn moves(&self, pool: &Pool, e: Expr) -> bool {
        pool.contains_any(e, &|s| s == self.time || self.given.iter().any(|g| g.0 == s))
    }

    /// A value whose dependence on `signals` is linear with constant coefficients; `None` where it is not.
    fn split(&mut self, pool: &mut Pool, value: Expr, signals: &[Symbol]) -> Option<Split> {
        let (linear, rest) = pool.affine(value, signals)?;
        let mut split = Split::default();
        for (i, k) in linear {
            split.signals.push((signals[i], pool.constant(k)?));
        }
        // What comes from outside by itself, then what is left.
        let outer: Vec<Symbol> = self.given.iter().map(|g| g.0).chain(self.held.iter().copied()).collect();
        let parts = pool.affine(rest, &outer);
        let parts = parts.and_then(|(linear, rest)| {
            let linear: Option<Vec<(Symbol, f64)>> =
                linear.into_iter().map(|(i, k)| Some((outer[i], pool.constant(k)?))).collect();
            Some((linear?, rest))
        });
        let (linear, rest) = parts.unwrap_or((Vec::new(), rest));
        for (s, k) in linear {
            split.drives.push((self.outer(pool, s)?, k));
        }
        if !pool.is_zero(rest) {
            split.drives.extend(self.source(pool, rest));
        }
        Some(split)
    }

    /// A value without signals of the cluster as a combination of drives.
    fn source(&mut self, pool: &mut Pool, value: Expr) -> Vec<(usize, f64)> {
        let before = (self.drives.clone(), self.moves.clone());
        if let Some(found) = self.terms(pool, value) {
            return found;
        }
        (self.drives, self.moves) = before;
        vec![(self.drive(Drive::Cubic(value, 0)), 1.0)]
    }

    fn terms(&mut self, pool: &mut Pool, value: Expr) -> Option<Vec<(usize, f64)>> {
        if let Some(x) = pool.constant(value) {
            return Some(vec![(self.drive(Drive::One), x)]);
        }
        if !self.moves(pool, value) {
            return Some(vec![(self.drive(Drive::Held(value)), 1.0)]);
        }
        let time = self.time;
        match pool.node(value).clone() {
            Node::Sum(constant, pairs) => {
                let mut all = Vec::new();
                if !constant.is_zero() {
                    all.push((self.drive(Drive::One), constant.to_f64()));
                }
                for &(e, k) in pairs.iter() {
                    all.extend(self.terms(pool, e)?.into_iter().map(|(d, c)| (d, c * k.to_f64())));
                }
                Some(all)
            }
            Node::Product(k, pairs) => {
                let mut factor = k.to_f64();
                let mut moving: Option<(Expr, Number)> = None;
                for &(e, n) in pairs.iter() {
                    match pool.constant(e) {
                        Some(x) => factor *= pool_pow(x, n),
                        None if moving.is_none() => moving = Some((e, n)),
                        None => return self.ramp(pool, value),
                    }
                }
                let (e, n) = moving?;
                let found = match n.integer() {
                    Some(1) => self.terms_of_factor(pool, e)?,
                    Some(n) if (2..=6).contains(&n) && matches!(pool.node(e), Node::Symbol(s) if *s == time) => {
                        vec![(self.drive(Drive::Power(n as u32)), 1.0)]
                    }
                    _ => return None,
                };
                Some(found.into_iter().map(|(d, c)| (d, c * factor)).collect())
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => self.terms_of_factor(pool, value),
        }
    }

    /// A product of time and what is held.
    fn ramp(&mut self, pool: &mut Pool, value: Expr) -> Option<Vec<(usize, f64)>> {
        let (slope, rest) = pool.linear(value, self.time)?;
        let held = !self.moves(pool, slope) && !self.moves(pool, rest);
        held.then(|| vec![(self.drive(Drive::Ramp(value, slope)), 1.0)])
    }

    fn terms_of_factor(&mut self, pool: &mut Pool, e: Expr) -> Option<Vec<(usize, f64)>> {
        let time = self.time;
        match pool.node(e).clone() {
            Node::Symbol(s) if s != time && self.given.iter().any(|g| g.0 == s) => {
                Some(vec![(self.outer(pool, s)?, 1.0)])
            }
            Node::Symbol(s) if s == time => Some(vec![(self.drive(Drive::Power(1)), 1.0)]),
            Node::Unary(f @ (Unary::Sin | Unary::Cos | Unary::Exp), arg) => {
                let (rate, phase) = pool.linear(arg, time)?;
                let (rate, phase) = (pool.constant(rate)?, pool.constant(phase)?);
                let drive = match f {
                    Unary::Exp => Drive::Growth(rate, phase),
                    _ => Drive::Wave(rate, phase, f == Unary::Cos),
                };
                Some(vec![(self.drive(drive), 1.0)])
            }
            Node::Sum(..) | Node::Product(..) => self.terms(pool, e),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => None,
        }
    }
}

fn pool_pow(x: f64, n: Number) -> f64 {
    match n.integer() {
        Some(i) if i.unsigned_abs() < 64 => x.powi(i as i32),
        _ => x.powf(n.to_f64()),
    }
}

/// Rows over w of everything in a linear cluster.
struct Rows {
    linear: Linear,
    system: System,
    /// Rows of outputs' and inputs' columns.
    outputs: FxHashMap<Symbol, Vec<f64>>,
    inputs: FxHashMap<ColumnId, Vec<f64>>,
    /// Each integral: row of its linear part, or the full form.
    integrals: Vec<Result<Vec<f64>, Vec<f64>>>,
}

impl Rows {
    /// Sources that follow states, or inputs, and rest when those do.
    fn settling(&self, c: &Cluster, form: &Form) -> Vec<ColumnId> {
        let settles = |i: usize| match i.checked_sub(self.system.n) {
            None => true,
            Some(d) => matches!(self.system.drives.get(d), Some(Drive::Ramp(..))),
        };
        let rests = |row: &Vec<f64>| row.iter().enumerate().any(|(i, x)| *x != 0.0 && settles(i));
        let sources = c.nodes.iter().filter_map(|n| n.source());
        sources.filter(|s| self.outputs.get(&form.column(*s).out).is_some_and(rests)).collect()
    }

    /// Sources that are constant over a step.
    fn steady(&self, c: &Cluster, form: &Form) -> Vec<ColumnId> {
        let constant = |i: usize| {
            matches!(self.system.drives.get(i.wrapping_sub(self.system.n)), Some(Drive::One | Drive::Held(_)))
        };
        let is_steady = |row: &Vec<f64>| row.iter().enumerate().all(|(i, x)| *x == 0.0 || constant(i));
        let sources = c
            .nodes
            .iter()
            .filter_map(|n| n.source())
            .filter(|s| self.outputs.get(&form.column(*s).out).is_some_and(is_steady));
        sources.collect()
    }
}

/// The numeric rows; `None` where the cluster is not linear or too large.
fn rows(c: &Cluster, model: &mut Model, form: &Form) -> Option<Rows> {
    let time = c.time?;
    let n = c.states.len();
    if n > LARGEST {
        return None;
    }
    let state_symbols: Vec<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    let given = c.inputs.iter().map(|(_, u, du)| (*u, *du)).collect();
    let mut system = System { n, time, given, held: c.foreign.clone(), drives: Vec::new(), moves: Vec::new() };
    // Each output as a sparse row: states by index, drives by n + index.
    let mut sparse: FxHashMap<Symbol, Vec<(usize, f64)>> = FxHashMap::default();
    for g in &c.groups {
        for (s, z) in g.states.iter().zip(&g.coenergy) {
            let (linear, rest) = model.pool.affine(*z, &state_symbols)?;
            let mut row =
                linear.into_iter().map(|(i, k)| Some((i, model.pool.constant(k)?))).collect::<Option<Vec<_>>>()?;
            let rest = model.pool.constant(rest)?;
            if rest != 0.0 {
                row.push((n + system.drive(Drive::One), rest));
            }
            // An energy with a kink may have an affine slope in each piece; `affine` refuses those.
            sparse.insert(form.column(c.states[*s].column?).out, row);
        }
    }
    for p in &c.ports {
        let v = model.pool.var(form.column(*p).out);
        let d = system.drive(Drive::Held(v));
        sparse.insert(form.column(*p).out, vec![(n + d, 1.0)]);
    }
    sparse.extend(state_symbols.iter().enumerate().map(|(i, s)| (*s, vec![(i, 1.0)])));
    let mut signals: Vec<Symbol> = sparse.keys().copied().chain(c.nodes.iter().map(|n| n.out)).collect();
    signals.sort_unstable();
    // What depends on other signals is solved for: resistors, and sources that do so.
    let mut solved: Vec<(Symbol, Split)> = Vec::new();
    for node in &c.nodes {
        let Output::Explicit(e) = node.how else { return None };
        if node.source().is_none() {
            let column = node.resistor()?;
            for (_, g) in form.regions[form.column(column).region.at()].gains.get(&column)? {
                model.pool.constant(*g)?;
            }
        }
        let split = system.split(&mut model.pool, e, &signals)?;
        if node.source().is_none() && !split.drives.is_empty() {
            return None;
        }
        if node.source().is_some() && split.signals.is_empty() {
            sparse.insert(node.out, split.drives.into_iter().map(|(d, k)| (n + d, k)).collect());
        } else {
            solved.push((node.out, split));
        }
    }
    let mut rates: Vec<Split> = Vec::new();
    for s in c.states.iter().filter(|s| s.column.is_none()) {
        rates.push(system.split(&mut model.pool, s.rate, &signals)?);
    }
    // The integrals may need drives of their own, so that the sizes are known only after them.
    let mut sums: Vec<Result<Split, Squares>> = Vec::new();
    for i in &c.integrals {
        let linear = system.split(&mut model.pool, i.rate, &signals);
        sums.push(match linear {
            Some(split) => Ok(split),
            None => Err(squares(&mut system, &mut model.pool, i.rate, &signals)?),
        });
    }
    let size = n + system.drives.len();
    if size > LARGEST {
        return None;
    }
    let dense = |row: &[(usize, f64)]| {
        let mut v = vec![0.0; size];
        for &(i, k) in row {
            v[i] += k;
        }
        v
    };
    let mut outputs: FxHashMap<Symbol, Vec<f64>> = sparse.iter().map(|(s, row)| (*s, dense(row))).collect();
    // All that is solved for, loops and all, as one linear system.
    let r = solved.len();
    let place: FxHashMap<Symbol, usize> = solved.iter().enumerate().map(|(i, t)| (t.0, i)).collect();
    let mut matrix = DMatrix::<f64>::identity(r, r);
    let mut right = DMatrix::<f64>::zeros(r, size);
    for (i, (_, split)) in solved.iter().enumerate() {
        for (s, k) in &split.signals {
            if let Some(&j) = place.get(s) {
                matrix[(i, j)] -= k;
            } else {
                let row = outputs.get(s)?;
                for (t, x) in row.iter().enumerate() {
                    right[(i, t)] += k * x;
                }
            }
        }
        for (d, k) in &split.drives {
            right[(i, n + d)] += k;
        }
    }
    if r > 0 {
        let acyclic = c.loops.is_empty();
        let found = if acyclic {
            forward(&matrix, &right, &c.nodes.iter().filter_map(|n| place.get(&n.out).copied()).collect::<Vec<_>>())
        } else {
            matrix.lu().solve(&right)?
        };
        if found.iter().any(|x| !x.is_finite()) {
            return None;
        }
        for (i, (s, _)) in solved.iter().enumerate() {
            outputs.insert(*s, found.row(i).iter().copied().collect());
        }
    }
    let mut input_rows = FxHashMap::default();
    let columns = c
        .states
        .iter()
        .filter_map(|s| s.column)
        .chain(c.nodes.iter().filter_map(|n| n.source().or(n.resistor())))
        .chain(c.ports.iter().copied());
    for column in columns.collect::<Vec<_>>() {
        let mut v = vec![0.0; size];
        for (j, k) in &form.column(column).row {
            let k = model.pool.constant(*k)?;
            for (t, x) in outputs.get(&form.column(*j).out)?.iter().enumerate() {
                v[t] += k * x;
            }
        }
        input_rows.insert(column, v);
    }
    let row_of = |split: &Split| -> Option<Vec<f64>> {
        let mut row = vec![0.0; size];
        for (s, k) in &split.signals {
            for (t, x) in outputs.get(s)?.iter().enumerate() {
                row[t] += k * x;
            }
        }
        for (d, k) in &split.drives {
            row[n + d] += k;
        }
        Some(row)
    };
    let mut a = vec![0.0; size * size];
    let mut rates = rates.iter();
    for (i, s) in c.states.iter().enumerate() {
        let row = match s.column {
            Some(column) => input_rows.get(&column)?.clone(),
            None => row_of(rates.next()?)?,
        };
        a[i * size..(i + 1) * size].copy_from_slice(&row);
    }
    for (i, moves) in system.moves.iter().enumerate() {
        for &(j, k) in moves {
            a[(n + i) * size + n + j] += k;
        }
    }
    let mut integrals = Vec::new();
    for sum in &sums {
        let parts = match sum {
            Ok(split) => {
                integrals.push(Ok(row_of(split)?));
                continue;
            }
            Err(parts) => parts,
        };
        let mut m = vec![0.0; size * size];
        for (s, t, k) in &parts.square {
            add_product(&mut m, &row_of(s)?, &row_of(t)?, *k);
        }
        add_product(&mut m, &row_of(&parts.linear)?, &row_of(&parts.one)?, 1.0);
        integrals.push(Err(m));
    }
    if a.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let linear = Linear { n, m: size - n, a, changes: true, ..Linear::default() };
    Some(Rows { linear, system, outputs, inputs: input_rows, integrals })
}

/// A quadratic rate: products of pairs, the linear part, and 1.
struct Squares {
    square: Vec<(Split, Split, f64)>,
    linear: Split,
    one: Split,
}

/// A rate of second degree in the cluster's signals, time, and what comes from outside; `None` where it is not.
fn squares(system: &mut System, pool: &mut Pool, rate: Expr, signals: &[Symbol]) -> Option<Squares> {
    let outer = system.given.iter().map(|g| g.0).chain(system.held.iter().copied()).chain([system.time]);
    let all: Vec<Symbol> = signals.iter().copied().chain(outer).collect();
    let (square, linear, constant) = pool.quadratic(rate, &all)?;
    let lone = |system: &mut System, pool: &mut Pool, i: usize, k: f64| -> Option<Split> {
        let s = all[i];
        Some(if i < signals.len() {
            Split { signals: vec![(s, k)], drives: vec![] }
        } else {
            Split { signals: vec![], drives: vec![(system.outer(pool, s)?, k)] }
        })
    };
    let mut found = Squares { square: vec![], linear: Split::default(), one: Split::default() };
    for (i, j, k) in square {
        let pair = (lone(system, pool, i, 1.0)?, lone(system, pool, j, 1.0)?, pool.constant(k)?);
        found.square.push(pair);
    }
    for (i, k) in linear {
        let k = pool.constant(k)?;
        let part = lone(system, pool, i, k)?;
        found.linear.signals.extend(part.signals);
        found.linear.drives.extend(part.drives);
    }
    let one = system.drive(Drive::One);
    found.linear.drives.push((one, pool.constant(constant)?));
    found.one.drives.push((one, 1.0));
    Some(found)
}

/// Solves a system whose unknowns, taken in order, depend on earlier ones only.
fn forward(matrix: &DMatrix<f64>, right: &DMatrix<f64>, order: &[usize]) -> DMatrix<f64> {
    let mut x = right.clone();
    for (k, &i) in order.iter().enumerate() {
        for &j in &order[..k] {
            let f = -matrix[(i, j)];
            if f != 0.0 {
                let row = x.row(j).clone_owned();
                let mut target = x.row_mut(i);
                target += row * f;
            }
        }
    }
    x
}

/// `m += k (a b^T + b a^T) / 2`
fn add_product(m: &mut [f64], a: &[f64], b: &[f64], k: f64) {
    let n = a.len();
    for i in 0..n {
        for j in 0..n {
            m[i * n + j] += 0.5 * k * (a[i] * b[j] + a[j] * b[i]);
        }
    }
}

/// Writes the step; `None` where the cluster cannot be stepped so.
pub(super) fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
) -> Result<Option<(Stepper, Vec<Entries>)>, Vec<Diagnostic>> {
    let Some(mut rows) = rows(c, model, form) else { return Ok(None) };
    let size = rows.linear.n + rows.linear.m;
    let forms = c.nodes.len() + rows.integrals.iter().filter(|i| i.is_err()).count();
    if forms * size * size > 2_000_000 || forms * size * size * size > 60_000_000 {
        return Ok(None);
    }
    let time = c.time.ok_or_else(Vec::new)?;
    let cubic = rows.system.drives.iter().any(|d| matches!(d, Drive::Cubic(..)));
    let (program, linear, entries) = program(c, model, form, &mut rows, time, true)?;
    let (glance, glance_linear, _) = self::program(c, model, form, &mut rows, time, false)?;
    let order = if cubic { 4 } else { 0 };
    let stepper = |program, linear, glance| Stepper {
        linear: Some(linear),
        glance,
        ..Stepper::new("exact", order, true, program)
    };
    let glance = stepper(glance, glance_linear, None);
    Ok(Some((stepper(program, linear, Some(Box::new(glance))), entries)))
}

fn program(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    rows: &mut Rows,
    time: Symbol,
    with_ledger: bool,
) -> Result<(bond_runtime::ir::Program, Linear, Vec<Entries>), Vec<Diagnostic>> {
    let mut linear = rows.linear.clone();
    let size = linear.n + linear.m;
    let mut b = Builder::new(c.title(form, if with_ledger { "exact step" } else { "exact glance" }));
    let entries = c.reserve(model, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let w = b.slots(Array::Local, size);
    let at = |k: usize| Slot { array: Array::Local, index: w.index + k as u32 };
    for (i, x) in inputs.states.iter().enumerate() {
        b.store(at(i), *x);
    }
    for (i, d) in rows.system.drives.clone().iter().enumerate() {
        let e = drive_value(model, d, &rows.system.given, (time, c.h.unwrap_or(time)));
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        b.store(at(rows.system.n + i), v);
    }
    // Means: what answers ports and constant sources, then linear integrals. The energy of a constant source is its value times
    // the integral of what answers it, which stays exact where two of them all but cancel.
    let steady: Vec<ColumnId> = c.ports.iter().copied().chain(rows.steady(c, form)).collect();
    linear.means = steady.iter().filter_map(|p| rows.inputs.get(p).cloned()).collect();
    // The energy of a source that may come to rest is h (z i + (mean z - z) i) with z at the start and the mean of what answers,
    // and a form in how far both went: at rest that is a product of two numbers, and no form's rounding adds up.
    let moving: Vec<ColumnId> = rows.settling(c, form).into_iter().filter(|s| !steady.contains(s)).collect();
    let first_moving = linear.means.len();
    if with_ledger && !moving.is_empty() {
        linear.starts = linear.a.chunks_exact(size).map(<[f64]>::to_vec).collect();
        for column in &moving {
            let pair = [rows.outputs.get(&form.column(*column).out), rows.inputs.get(column)];
            linear.starts.extend(pair.iter().copied().flatten().cloned());
            linear.means.extend(pair.iter().copied().flatten().cloned());
        }
    }
    let first_integral = linear.means.len();
    linear.means.extend(rows.integrals.iter().filter_map(|i| i.as_ref().ok().cloned()));
    let accounts: Vec<Accounts> = c.accounts(model, form);
    let mut quads: Vec<Slot> = Vec::new();
    let mut drifts: Vec<(usize, Slot)> = Vec::new();
    let mut sums: Vec<(Slot, f64)> = Vec::new();
    if with_ledger {
        for (e, account) in entries.iter().zip(&accounts) {
            let energy = |columns: &[ColumnId], sign: f64| {
                let mut m = vec![0.0; size * size];
                for column in columns {
                    if let (Some(z), Some(i)) = (rows.outputs.get(&form.column(*column).out), rows.inputs.get(column)) {
                        add_product(&mut m, z, i, sign);
                    }
                }
                m
            };
            for ((_, slot), column) in e.supplied.iter().zip(&account.supplied) {
                let slot = Slot::new(Array::Output, *slot);
                if let Some(k) = moving.iter().position(|m| m == column) {
                    linear.drifts.push(energy(&[*column], -1.0));
                    drifts.push((k, slot));
                } else if !steady.contains(column) {
                    linear.forms.push(energy(&[*column], -1.0));
                    quads.push(slot);
                }
            }
            for ((_, slot), columns) in e.dissipated.iter().zip(&account.dissipated) {
                // An active resistor gives energy: minus a sum of squares.
                let negative =
                    |c: &ColumnId| model.element(form.column(*c).element).active && is_negative(model, form, *c);
                let sign = if columns.iter().any(negative) { -1.0 } else { 1.0 };
                linear.squares.push(energy(columns, sign));
                sums.push((Slot::new(Array::Output, *slot), sign));
            }
        }
    }
    let ledger_forms = linear.forms.len();
    linear.forms.extend(rows.integrals.iter().filter_map(|i| i.as_ref().err().cloned()));
    let layout = Layout::of(&linear);
    b.slots(Array::Table, layout.size());
    let n = linear.n;
    let next = b.slots(Array::Local, n);
    if n > 0 {
        let inst = Inst::MatVec {
            to: next,
            table: layout.exponential() as u32,
            from: w,
            rows: n as u32,
            cols: size as u32,
            low: true,
        };
        b.push(inst, next, n);
    }
    let means = b.slots(Array::Local, linear.means.len());
    if !linear.means.is_empty() {
        let inst = Inst::MatVec {
            to: means,
            table: layout.mean(0) as u32,
            from: w,
            rows: linear.means.len() as u32,
            cols: size as u32,
            low: false,
        };
        b.push(inst, means, linear.means.len());
    }
    if !sums.is_empty() {
        let roots = b.slots(Array::Local, size);
        for (k, (slot, sign)) in sums.iter().enumerate() {
            let table = layout.square(k) as u32;
            b.push(
                Inst::MatVec { to: roots, table, from: w, rows: size as u32, cols: size as u32, low: false },
                roots,
                size,
            );
            let mut sum = b.number(0.0);
            for i in 0..size {
                let x = b.load(Slot { array: Array::Local, index: roots.index + i as u32 });
                let x = b.mul(x, x);
                sum = b.add(sum, x);
            }
            if *sign < 0.0 {
                sum = b.unary(Unary::Neg, sum);
            }
            b.store(*slot, sum);
        }
    }
    let mean = |b: &mut Builder, k: usize| b.load(Slot { array: Array::Local, index: means.index + k as u32 });
    for (k, slot) in quads.iter().enumerate() {
        b.push(Inst::Quad { to: *slot, table: layout.form(k) as u32, from: w, n: size as u32 }, *slot, 1);
    }
    if !drifts.is_empty() {
        let count = linear.starts.len();
        let starts = b.slots(Array::Local, count);
        let from = layout.start(0) as u32;
        b.push(
            Inst::MatVec { to: starts, table: from, from: w, rows: count as u32, cols: size as u32, low: false },
            starts,
            count,
        );
        let start = |b: &mut Builder, k: usize| b.load(Slot { array: Array::Local, index: starts.index + k as u32 });
        for (drift, (k, slot)) in drifts.iter().enumerate() {
            let went = b.slot(Array::Local);
            let table = layout.drift(drift) as u32;
            b.push(Inst::Quad { to: went, table, from: starts, n: size as u32 }, went, 1);
            let (z, i) = (start(&mut b, size + 2 * k), start(&mut b, size + 2 * k + 1));
            let (mean_z, mean_i) = (mean(&mut b, first_moving + 2 * k), mean(&mut b, first_moving + 2 * k + 1));
            let (first, off) = (b.mul(z, mean_i), b.sub(mean_z, z));
            let second = b.mul(off, i);
            let power = b.add(first, second);
            let (into, went) = (b.mul(inputs.h, power), b.load(went));
            let out = b.sub(went, into);
            b.store(*slot, out);
        }
    }
    for (i, _) in c.ports.iter().enumerate() {
        let m = mean(&mut b, i);
        b.store(Slot::new(Array::Output, i), m);
    }
    if with_ledger {
        for (e, account) in entries.iter().zip(&accounts) {
            for ((_, slot), column) in e.supplied.iter().zip(&account.supplied) {
                let Some(i) = steady.iter().position(|p| p == column) else { continue };
                let mut v = None;
                let row = rows.outputs.get(&form.column(*column).out).map(Vec::as_slice).unwrap_or(&[]);
                for (k, x) in row.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                    let (x, drive) = (b.number(*x), b.load(at(k)));
                    let part = b.mul(x, drive);
                    v = Some(match v {
                        Some(v) => b.add(v, part),
                        None => part,
                    });
                }
                let v = v.unwrap_or_else(|| b.number(0.0));
                let m = mean(&mut b, i);
                let q = b.mul(inputs.h, m);
                let e = b.mul(v, q);
                let e = b.unary(Unary::Neg, e);
                b.store(Slot::new(Array::Output, *slot), e);
            }
        }
    }
    b.slots(Array::Next, c.slots());
    let mut values = Vec::new();
    for i in 0..n {
        // Of a state that stays much as it is, the rows give the change.
        let change = b.load(Slot { array: Array::Local, index: next.index + i as u32 });
        let keep = b.load(Slot::new(Array::Table, layout.keep() + i));
        let (base, carry) = (b.mul(keep, inputs.states[i]), b.load(inputs.carries[i]));
        let carry = b.mul(keep, carry);
        let (v, rest) = write::advance(&mut b, base, change, carry);
        b.store(Slot::new(Array::Next, i), v);
        b.store(Slot::new(Array::Next, c.carry_at() + i), rest);
        values.push(v);
    }
    let (mut straight, mut squares) = (first_integral, ledger_forms);
    for (i, (start, kind)) in inputs.integrals.iter().zip(&rows.integrals).enumerate() {
        let change = match kind {
            Ok(_) => {
                let m = mean(&mut b, straight);
                straight += 1;
                b.mul(inputs.h, m)
            }
            Err(_) => {
                let slot = b.slot(Array::Local);
                b.push(Inst::Quad { to: slot, table: layout.form(squares) as u32, from: w, n: size as u32 }, slot, 1);
                squares += 1;
                b.load(slot)
            }
        };
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, n + i), v);
    }
    for (i, z) in inputs.guesses.iter().enumerate() {
        b.store(Slot::new(Array::Next, n + c.integrals.len() + i), *z);
    }
    if with_ledger {
        write::energies(c, model, &mut b, (&values, &[]), &inputs, &entries)?;
    }
    Ok((verified(model, b.finish())?, linear, entries))
}

/// Whether a linear resistor's value is below 0.
fn is_negative(model: &Model, form: &Form, column: ColumnId) -> bool {
    match &model.element(form.column(column).element).law {
        Law::Resistor(r) => r.linear.and_then(|k| model.pool.constant(k)).is_some_and(|k| k < 0.0),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => false,
    }
}

/// The value of a drive at the start of a step.
fn drive_value(model: &mut Model, d: &Drive, given: &[(Symbol, Symbol)], (time, h): (Symbol, Symbol)) -> Expr {
    let pool = &mut model.pool;
    let t = pool.var(time);
    match d {
        Drive::One => pool.int(1),
        Drive::Held(e) | Drive::Ramp(e, _) => *e,
        Drive::Wave(rate, phase, cos) => {
            let arg = affine(pool, *rate, *phase, t);
            pool.unary(if *cos { Unary::Cos } else { Unary::Sin }, arg)
        }
        Drive::Growth(rate, phase) => {
            let arg = affine(pool, *rate, *phase, t);
            pool.unary(Unary::Exp, arg)
        }
        Drive::Power(n) => pool.powi(t, i64::from(*n)),
        Drive::Cubic(e, k) => {
            let vandermonde = DMatrix::from_fn(4, 4, |i, j| NODES[i].powi(j as i32));
            let unit = |j: usize| DVector::from_fn(4, |i, _| if i == j { 1.0 } else { 0.0 });
            let lu = vandermonde.lu();
            let h = pool.var(h);
            let factorial = [1.0, 1.0, 2.0, 6.0][*k as usize & 3];
            let mut terms = Vec::new();
            for (j, node) in NODES.iter().enumerate() {
                let weight = lu.solve(&unit(j)).map_or(0.0, |v| v[*k as usize & 3]) * factorial;
                let c = pool.float(*node);
                let ahead = pool.mul(c, h);
                let at = pool.add(t, ahead);
                let mut map: FxHashMap<Symbol, Expr> = std::iter::once((time, at)).collect();
                for &(u, du) in given {
                    let (ue, due) = (pool.var(u), pool.var(du));
                    let gone = pool.mul(ahead, due);
                    map.insert(u, pool.add(ue, gone));
                }
                let sample = pool.substitute(*e, &map);
                let weight = pool.float(weight);
                terms.push(pool.mul(weight, sample));
            }
            let sum = pool.sum(&terms);
            let scale = pool.powi(h, i64::from(*k));
            pool.div(sum, scale)
        }
    }
}

fn affine(pool: &mut Pool, rate: f64, phase: f64, t: Expr) -> Expr {
    let rate = pool.float(rate);
    let phase = pool.float(phase);
    let x = pool.mul(rate, t);
    pool.add(x, phase)
}
