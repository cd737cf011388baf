//! The explicit form of a large region: the same formulas as `structure::explicit`, on rows of entries.

use super::size::SIZES;
use crate::expression::{Expr, Pool};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Region, Row};
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;

/// Entries by row and column.
pub(super) type Entries = BTreeMap<(usize, usize), Expr>;

/// J, R, G, P, M, S, and the columns of the inputs, of which the last `nonlinear` are resistors.
pub(super) struct Sparse {
    pub(super) matrices: [Entries; 6],
    pub(super) inputs: Vec<ColumnId>,
    pub(super) nonlinear: usize,
}

/// The form; `None` where a loop of resistors is singular or large, or the matrices are full.
pub(super) fn explicit(model: &mut Model, form: &Form, region: &Region) -> Option<Sparse> {
    let mut inputs = region.inputs.clone();
    let mut linear: Vec<(ColumnId, Expr)> = Vec::new();
    for (c, _) in &region.resistors {
        match region.gains.get(c).map(Vec::as_slice) {
            Some([(own, k)]) if own == c => linear.push((*c, *k)),
            Some(_) => return None, // a field of resistors
            None => inputs.push(*c),
        }
    }
    let nonlinear = inputs.len() - region.inputs.len();
    let pool = &mut model.pool;
    let outputs = resistors(pool, form, &linear)?;
    let states: Vec<ColumnId> = region.states.iter().map(|s| s.column).collect();
    let n = states.len();
    let place: FxHashMap<ColumnId, usize> = states.iter().chain(&inputs).enumerate().map(|(i, c)| (*c, i)).collect();
    // F: the inputs of storages and sources by their outputs, the linear resistors gone.
    let (mut f, mut count) = (Vec::new(), 0);
    for c in states.iter().chain(&inputs) {
        let row = substitute(pool, &form.column(*c).row, &outputs);
        count += row.len();
        if count > SIZES.sparse_entries * (n + inputs.len()) {
            return None;
        }
        f.push(row);
    }
    let mut entries: Entries = BTreeMap::new();
    for (i, row) in f.iter().enumerate() {
        entries.extend(row.iter().filter_map(|(c, e)| Some(((i, *place.get(c)?), *e))));
    }
    let mut matrices: [Entries; 6] = Default::default();
    let half = pool.ratio(1, 2);
    let keys: Vec<(usize, usize)> = entries.keys().flat_map(|&(i, j)| [(i, j), (j, i)]).collect();
    let zero = pool.zero();
    for (i, j) in keys {
        let (a, b) = (entries.get(&(i, j)).copied().unwrap_or(zero), entries.get(&(j, i)).copied().unwrap_or(zero));
        let (difference, sum) = (pool.sub(a, b), pool.add(a, b));
        let (skew, symmetric) = (pool.mul(half, difference), pool.mul(half, sum));
        let negative = pool.neg(symmetric);
        let mut put = |m: usize, at: (usize, usize), e: Expr| {
            if !pool.is_zero(e) {
                matrices[m].insert(at, e);
            }
        };
        match (i < n, j < n) {
            (true, true) => {
                put(0, (i, j), skew);
                put(1, (i, j), negative);
            }
            (true, false) => {
                put(2, (i, j - n), skew);
                put(3, (i, j - n), negative);
            }
            (false, true) => {}
            (false, false) => {
                let minus = pool.neg(skew);
                put_feed(pool, &mut matrices, (i - n, j - n), minus, negative);
            }
        }
    }
    Some(Sparse { matrices, inputs, nonlinear })
}

fn put_feed(pool: &Pool, matrices: &mut [Entries; 6], at: (usize, usize), m: Expr, s: Expr) {
    for (k, e) in [(4, m), (5, s)] {
        if !pool.is_zero(e) {
            matrices[k].insert(at, e);
        }
    }
}

/// A row in which the outputs of resistors are replaced.
fn substitute(pool: &mut Pool, row: &Row, known: &FxHashMap<ColumnId, Row>) -> Row {
    let mut sums: BTreeMap<ColumnId, Vec<Expr>> = BTreeMap::new();
    for &(c, k) in row {
        match known.get(&c) {
            None => sums.entry(c).or_default().push(k),
            Some(row) => {
                for &(d, a) in row {
                    let e = pool.mul(k, a);
                    sums.entry(d).or_default().push(e);
                }
            }
        }
    }
    let mut row: Row = sums.into_iter().map(|(c, all)| (c, pool.sum(&all))).collect();
    row.retain(|(_, e)| !pool.is_zero(*e));
    row
}

/// The outputs of the linear resistors by those of all other columns. D being skew, what one takes from another goes
/// both ways, so that resistors are alone or in loops.
fn resistors(pool: &mut Pool, form: &Form, linear: &[(ColumnId, Expr)]) -> Option<FxHashMap<ColumnId, Row>> {
    let place: FxHashMap<ColumnId, usize> = linear.iter().enumerate().map(|(i, (c, _))| (*c, i)).collect();
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(linear.len());
    for (i, (c, _)) in linear.iter().enumerate() {
        for j in form.column(*c).row.iter().filter_map(|(j, _)| place.get(j)) {
            sets.union(i, *j);
        }
    }
    let mut loops: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in 0..linear.len() {
        loops.entry(sets.find(i)).or_default().push(i);
    }
    let mut known = FxHashMap::default();
    for members in loops.values() {
        if members.len() > SIZES.linear_loop {
            return None;
        }
        let rows = solve(pool, form, linear, members)?;
        known.extend(members.iter().map(|i| linear[*i].0).zip(rows));
    }
    Some(known)
}

/// (1 - K D) z = K (what comes from outside the loop), by Gauss-Jordan elimination.
fn solve(pool: &mut Pool, form: &Form, linear: &[(ColumnId, Expr)], members: &[usize]) -> Option<Vec<Row>> {
    let (n, zero, one) = (members.len(), pool.zero(), pool.one());
    let size = |pool: &Pool, e: Expr| {
        let x = pool.eval(e, &|s| 0.37 + 0.21 * f64::from(s.0 % 11)).abs();
        if x.is_finite() { x } else { 0.0 }
    };
    let (mut a, mut right): (Vec<Vec<Expr>>, Vec<Row>) = (Vec::new(), Vec::new());
    for (p, &i) in members.iter().enumerate() {
        let (c, k) = linear[i];
        let (mut row, mut rest) = (vec![zero; n], Vec::new());
        row[p] = one;
        for &(j, d) in &form.column(c).row {
            let e = pool.mul(k, d);
            match members.iter().position(|m| linear[*m].0 == j) {
                Some(q) => row[q] = pool.sub(row[q], e),
                None => rest.push((j, e)),
            }
        }
        a.push(row);
        right.push(rest);
    }
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| size(pool, a[*i][k]).total_cmp(&size(pool, a[*j][k])))?;
        if size(pool, a[pivot][k]) == 0.0 {
            return None;
        }
        a.swap(k, pivot);
        right.swap(k, pivot);
        let inverse = pool.div(one, a[k][k]);
        a[k].iter_mut().for_each(|x| *x = pool.mul(*x, inverse));
        right[k].iter_mut().for_each(|(_, x)| *x = pool.mul(*x, inverse));
        let (row, rest) = (a[k].clone(), right[k].clone());
        for i in (0..n).filter(|i| *i != k) {
            let minus = pool.neg(a[i][k]);
            if pool.is_zero(minus) {
                continue;
            }
            for (x, y) in a[i].iter_mut().zip(&row) {
                let t = pool.mul(minus, *y);
                *x = pool.add(*x, t);
            }
            let scaled: Vec<_> = rest.iter().map(|(c, e)| (*c, pool.mul(minus, *e))).collect();
            right[i].extend(scaled);
            right[i] = substitute(pool, &right[i].clone(), &FxHashMap::default());
        }
    }
    Some(right)
}
