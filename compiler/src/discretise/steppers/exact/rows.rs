//! A linear cluster in numbers: everything in it as a row over w.

use super::drive::{Drive, Split, System};
use crate::discretise::cluster::{Cluster, Part};
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output};
use bond_runtime::double_double::DoubleDouble;
use bond_runtime::exponential::Linear;
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;
use std::ops::{Add, Mul};

/// Largest number of states and drives.
const LARGEST: usize = 128;
/// More outputs than this that follow from one another are not solved for at once.
const OUTPUTS: usize = 500;
/// Rounds of solving for what is left: each finds as many digits as plain numbers have, less those of the condition.
const REFINEMENTS: usize = 3;

/// Rows over w of everything in a linear cluster.
pub(crate) struct Rows {
    pub(crate) linear: Linear,
    pub(crate) system: System,
    /// Rows of outputs' and inputs' columns.
    pub(crate) outputs: FxHashMap<Symbol, Row>,
    pub(crate) inputs: FxHashMap<ColumnId, Row>,
    /// Each integral: row of its linear part, or the full form.
    pub(crate) integrals: Vec<Result<Row, Vec<DoubleDouble>>>,
}

/// A number for each state and drive.
pub(crate) type Row = Vec<DoubleDouble>;

/// `to += k row`
fn add_row(to: &mut [DoubleDouble], k: f64, row: &[DoubleDouble]) {
    for (t, x) in to.iter_mut().zip(row) {
        *t = t.add(x.mul(DoubleDouble::new(k)));
    }
}

/// `to += k`
fn add_one(to: &mut DoubleDouble, k: f64) {
    *to = to.add(DoubleDouble::new(k));
}

impl Rows {
    /// Sources that follow states, or inputs, and rest when those do. Where something is held over a step, or given
    /// from outside, all that move: what one gives may all but be what the other takes, and of what is left nothing may
    /// be lost to a form's rounding.
    pub(crate) fn settling(&self, c: &Cluster, form: &Form) -> Vec<ColumnId> {
        let given = |d: &Drive| matches!(d, Drive::Held(_) | Drive::Ramp(..));
        let meets = !c.ports.is_empty() || self.system.drives.iter().any(given);
        let settles = |i: usize| match i.checked_sub(self.system.n) {
            None => true,
            Some(d) => matches!(self.system.drives.get(d), Some(Drive::Ramp(..))),
        };
        let rests = |row: &Row| meets || row.iter().enumerate().any(|(i, x)| x.high != 0.0 && settles(i));
        let sources = c.nodes.iter().filter_map(|n| n.source());
        sources.filter(|s| self.outputs.get(&form.column(*s).out).is_some_and(rests)).collect()
    }

    /// Sources that are constant over a step.
    pub(crate) fn steady(&self, c: &Cluster, form: &Form) -> Vec<ColumnId> {
        let constant = |i: usize| {
            matches!(self.system.drives.get(i.wrapping_sub(self.system.n)), Some(Drive::One | Drive::Held(_)))
        };
        let is_steady = |row: &Row| row.iter().enumerate().all(|(i, x)| x.high == 0.0 || constant(i));
        let sources = c
            .nodes
            .iter()
            .filter_map(|n| n.source())
            .filter(|s| self.outputs.get(&form.column(*s).out).is_some_and(is_steady));
        sources.collect()
    }
}

/// The numeric rows; `None` where the cluster is not linear or too large.
pub(crate) fn rows(c: &Cluster, model: &mut Model, form: &Form) -> Option<Rows> {
    let time = c.time?;
    let n = c.states.len();
    // What arrives by delays in continuous time is no drive of these.
    if c.carried().next().is_some()
        || n > LARGEST
        || c.nodes.len() > OUTPUTS
        || c.has_moving_source_driven_storage(&model.pool)
    {
        return None;
    }
    let given = c.inputs.iter().map(|(_, u, du)| (*u, *du)).collect();
    let mut system = System { n, time, given, held: c.foreign.clone(), drives: Vec::new(), moves: Vec::new() };
    let mut given = given_outputs(c, model, form, &mut system)?;
    let mut signals: Vec<Symbol> = given.keys().copied().chain(c.nodes.iter().map(|n| n.out)).collect();
    signals.sort_unstable();
    let solved = solved_outputs(c, model, form, (&mut system, &signals), &mut given)?;
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
    let outputs = dense_outputs(c, (n, size), &given, solved)?;
    let inputs = input_rows(c, model, form, size, &outputs)?;
    let row_of = |split: &Split| -> Option<Row> {
        let mut row = vec![DoubleDouble::default(); size];
        for (s, k) in &split.signals {
            add_row(&mut row, *k, outputs.get(s)?);
        }
        split.drives.iter().for_each(|(d, k)| add_one(&mut row[n + d], *k));
        Some(row)
    };
    let mut a = vec![DoubleDouble::default(); size * size];
    let mut rates = rates.iter();
    for (i, s) in c.states.iter().enumerate() {
        let row = match s.column {
            Some(column) => inputs.get(&column)?.clone(),
            None => row_of(rates.next()?)?,
        };
        a[i * size..(i + 1) * size].copy_from_slice(&row);
    }
    for (i, moves) in system.moves.iter().enumerate() {
        for &(j, k) in moves {
            add_one(&mut a[(n + i) * size + n + j], k);
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
        let mut m = vec![DoubleDouble::default(); size * size];
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
    Some(Rows { linear, system, outputs, inputs, integrals })
}

/// Outputs as sparse rows: states by index, drives by n + index.
type Sparse = FxHashMap<Symbol, Vec<(usize, f64)>>;

/// What storages, ports and states themselves give.
fn given_outputs(c: &Cluster, model: &mut Model, form: &Form, system: &mut System) -> Option<Sparse> {
    let n = c.states.len();
    // Where storages follow a source, that is a number.
    let driving_values = c.driving_values();
    let state_symbols: Vec<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    let mut sparse = Sparse::default();
    for g in &c.groups {
        for (s, z) in g.states.iter().zip(&g.coenergy) {
            let z = model.pool.substitute(*z, &driving_values);
            let (linear, rest) = model.pool.affine(z, &state_symbols)?;
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
    Some(sparse)
}

/// What depends on other signals and is solved for: resistors, and sources that do so. Other sources are `given`.
fn solved_outputs(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    (system, signals): (&mut System, &[Symbol]),
    given: &mut Sparse,
) -> Option<Vec<(Symbol, Split)>> {
    let mut solved: Vec<(Symbol, Split)> = Vec::new();
    for node in &c.nodes {
        let Output::Explicit(e) = node.how else { return None };
        // What a source-driven storage gives is the rate of its state.
        if node.source().is_none() && !matches!(node.part, Part::SourceDriven(_)) {
            let column = node.resistor()?;
            for (_, g) in form.regions[form.column(column).region.at()].gains.get(&column)? {
                model.pool.constant(*g)?;
            }
        }
        let split = system.split(&mut model.pool, e, signals)?;
        if node.source().is_none() && !split.drives.is_empty() {
            return None;
        }
        if node.source().is_some() && split.signals.is_empty() {
            given.insert(node.out, split.drives.into_iter().map(|(d, k)| (c.states.len() + d, k)).collect());
        } else {
            solved.push((node.out, split));
        }
    }
    Some(solved)
}

/// All outputs as rows: what is solved for, loops and all, is one linear system.
fn dense_outputs(
    c: &Cluster,
    (n, size): (usize, usize),
    given: &Sparse,
    solved: Vec<(Symbol, Split)>,
) -> Option<FxHashMap<Symbol, Row>> {
    let dense = |row: &[(usize, f64)]| {
        let mut v = vec![DoubleDouble::default(); size];
        row.iter().for_each(|&(i, k)| add_one(&mut v[i], k));
        v
    };
    let mut outputs: FxHashMap<Symbol, Row> = given.iter().map(|(s, row)| (*s, dense(row))).collect();
    let r = solved.len();
    if r == 0 {
        return Some(outputs);
    }
    let place: FxHashMap<Symbol, usize> = solved.iter().enumerate().map(|(i, t)| (t.0, i)).collect();
    let mut matrix = DMatrix::<f64>::identity(r, r);
    let mut right = vec![vec![DoubleDouble::default(); size]; r];
    for (i, (_, split)) in solved.iter().enumerate() {
        for (s, k) in &split.signals {
            if let Some(&j) = place.get(s) {
                matrix[(i, j)] -= k;
            } else {
                add_row(&mut right[i], *k, outputs.get(s)?);
            }
        }
        split.drives.iter().for_each(|(d, k)| add_one(&mut right[i][n + d], *k));
    }
    let acyclic = c.loops.is_empty();
    let found = if acyclic {
        forward(&matrix, right, &c.nodes.iter().filter_map(|n| place.get(&n.out).copied()).collect::<Vec<_>>())
    } else {
        solve(matrix, &right)?
    };
    if found.iter().flatten().any(|x| !x.is_finite()) {
        return None;
    }
    outputs.extend(solved.iter().map(|s| s.0).zip(found));
    Some(outputs)
}

/// What storages, sources, resistors and ports are given, as rows.
fn input_rows(
    c: &Cluster,
    model: &Model,
    form: &Form,
    size: usize,
    outputs: &FxHashMap<Symbol, Row>,
) -> Option<FxHashMap<ColumnId, Row>> {
    let columns = c
        .states
        .iter()
        .filter_map(|s| s.column)
        .chain(c.nodes.iter().filter_map(|n| n.source().or(n.resistor())))
        .chain(c.ports.iter().copied());
    let mut rows = FxHashMap::default();
    for column in columns {
        let mut v = vec![DoubleDouble::default(); size];
        for (j, k) in &form.column(column).row {
            add_row(&mut v, model.pool.constant(*k)?, outputs.get(&form.column(*j).out)?);
        }
        rows.insert(column, v);
    }
    Some(rows)
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
fn forward(matrix: &DMatrix<f64>, mut x: Vec<Row>, order: &[usize]) -> Vec<Row> {
    for (k, &i) in order.iter().enumerate() {
        for &j in &order[..k] {
            let f = -matrix[(i, j)];
            if f != 0.0 {
                let row = x[j].clone();
                add_row(&mut x[i], f, &row);
            }
        }
    }
    x
}

/// Solves a system with the digits of its right side: what the solution in plain numbers leaves is solved for again.
fn solve(matrix: DMatrix<f64>, right: &[Row]) -> Option<Vec<Row>> {
    let (r, size) = (right.len(), right.first().map_or(0, Vec::len));
    let lu = matrix.clone().lu();
    let mut x = vec![vec![DoubleDouble::default(); size]; r];
    for _ in 0..REFINEMENTS {
        let mut left = right.to_vec();
        for (i, row) in left.iter_mut().enumerate() {
            for (j, x) in x.iter().enumerate().filter(|(j, _)| matrix[(i, *j)] != 0.0) {
                add_row(row, -matrix[(i, j)], x);
            }
        }
        let more = lu.solve(&DMatrix::from_fn(r, size, |i, t| left[i][t].high))?;
        for (i, row) in x.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(t, x)| add_one(x, more[(i, t)]));
        }
    }
    Some(x)
}

/// `m += k (a b^T + b a^T) / 2`
pub(crate) fn add_product(m: &mut [DoubleDouble], a: &[DoubleDouble], b: &[DoubleDouble], k: f64) {
    let n = a.len();
    for i in 0..n {
        for j in 0..n {
            let both = a[i].mul(b[j]).add(a[j].mul(b[i]));
            m[i * n + j] = m[i * n + j].add(both.mul(DoubleDouble::new(0.5 * k)));
        }
    }
}
