//! The explicit form of a region: linear resistors eliminated,
//!
//! dx/dt = (J - R) dH/dx + (G - P) u,  y = (G + P)^T dH/dx + (M + S) u,  supplied power y^T u,
//!
//! with J and M skew and [[R, P], [P^T, S]] >= 0. Resistors with a law that is not linear stay, as inputs of their own.

use super::{ColumnId, Form, OPTIONS, Region};
use crate::expression::{Expr, Pool};
use crate::model::Model;

/// A matrix of expressions.
pub type Matrix = Vec<Vec<Expr>>;

/// The matrices of a region.
#[derive(Clone, Debug)]
pub struct Explicit {
    /// The inputs: sources, bars, open ports, then the resistors that are not linear.
    pub inputs: Vec<ColumnId>,
    /// How many of them are resistors that are not linear.
    pub nonlinear: usize,
    /// Skew.
    pub j: Matrix,
    /// Symmetric, positive semi-definite.
    pub r: Matrix,
    /// Input matrix.
    pub g: Matrix,
    /// Its resistive part.
    pub p: Matrix,
    /// Skew feed-through.
    pub m: Matrix,
    /// Symmetric feed-through.
    pub s: Matrix,
}

/// Inverse by Gauss-Jordan elimination; `None` if singular. What is inverted is a mass matrix, or has a symmetric part
/// above 0 as `1 + S K` and `R - D_R`: its pivots on the diagonal pass 0 nowhere, which one off it may, however large
/// it is where it is looked at. Numbers alone are taken by size.
pub fn inverse(pool: &mut Pool, a: &Matrix) -> Option<Matrix> {
    let n = a.len();
    let (zero, one) = (pool.int(0), pool.int(1));
    // Where an exponential has no number, nearer to rest.
    let value = |pool: &Pool, e: Expr, unit: f64| pool.eval(e, &|s| unit * (0.37 + 0.21 * f64::from(s.0 % 11))).abs();
    let all = |unit: &f64| a.iter().flatten().all(|e| value(pool, *e, *unit).is_finite());
    let unit = [1.0, 1e-3, 1e-6, 1e-9, 1e-12].into_iter().find(all).unwrap_or(1.0);
    let size = |pool: &Pool, e: Expr| {
        let x = value(pool, e, unit);
        if x.is_finite() { x } else { 0.0 }
    };
    let mut w: Matrix =
        (0..n).map(|i| a[i].iter().copied().chain((0..n).map(|j| if i == j { one } else { zero })).collect()).collect();
    for k in 0..n {
        let largest = (k..n).max_by(|i, j| size(pool, w[*i][k]).total_cmp(&size(pool, w[*j][k])))?;
        let numbers = (k..n).all(|i| pool.constant(w[i][k]).is_some());
        let stays = !numbers && size(pool, w[k][k]) > OPTIONS.rounding * size(pool, w[largest][k]);
        let pivot = if stays { k } else { largest };
        if pool.is_zero(w[pivot][k]) || size(pool, w[pivot][k]) == 0.0 {
            return None;
        }
        w.swap(k, pivot);
        let p = w[k][k];
        for j in 0..2 * n {
            w[k][j] = pool.div(w[k][j], p);
        }
        for i in (0..n).filter(|i| *i != k) {
            let f = w[i][k];
            if pool.is_zero(f) {
                continue;
            }
            for j in 0..2 * n {
                let t = pool.mul(f, w[k][j]);
                w[i][j] = pool.sub(w[i][j], t);
            }
        }
    }
    Some(w.into_iter().map(|row| row[n..].to_vec()).collect())
}

/// The explicit form; `None` where the loop of the linear resistors is singular or too large to write out.
pub fn explicit(model: &mut Model, form: &Form, region: &Region) -> Option<Explicit> {
    let mut resistors: Vec<ColumnId> = Vec::new();
    let mut inputs = region.inputs.clone();
    for (c, _) in &region.resistors {
        if region.gains.contains_key(c) { &mut resistors } else { &mut inputs }.push(*c);
    }
    let nonlinear = inputs.len() - region.inputs.len();
    let pool = &mut model.pool;
    let zero = pool.int(0);
    let states: Vec<ColumnId> = region.states.iter().map(|s| s.column).collect();
    let block = |rows: &[ColumnId], columns: &[ColumnId]| -> Matrix {
        rows.iter().map(|r| columns.iter().map(|c| form.entry(*r, *c).unwrap_or(zero)).collect()).collect()
    };
    let gain =
        |r: &ColumnId, c: &ColumnId| -> Option<Expr> { region.gains.get(r)?.iter().find(|t| t.0 == *c).map(|t| t.1) };
    let gains: Matrix =
        resistors.iter().map(|r| resistors.iter().map(|c| gain(r, c).unwrap_or(zero)).collect()).collect();
    // z_R = N (D_RC z_C + D_RI u) with N = (1 - K D_RR)^-1 K; only resistors in loops make the inverse more than 1.
    let n = loop_gain(pool, &block(&resistors, &resistors), &gains)?;
    let (cr, ir) = (block(&states, &resistors), block(&inputs, &resistors));
    let (rc, ri) = (block(&resistors, &states), block(&resistors, &inputs));
    let full = |pool: &mut Pool, direct: Matrix, left: &Matrix, right: &Matrix| {
        let weighted = product(pool, left, &n);
        let via = product(pool, &weighted, right);
        sum(pool, &direct, &via)
    };
    let f_cc = full(pool, block(&states, &states), &cr, &rc);
    let f_ci = full(pool, block(&states, &inputs), &cr, &ri);
    let f_ic = full(pool, block(&inputs, &states), &ir, &rc);
    let f_ii = full(pool, block(&inputs, &inputs), &ir, &ri);
    // dx/dt = F_CC z + F_CI u; the power into the sources' columns is that out of the region: y = -(F_IC z + F_II u).
    let half = |pool: &mut Pool, a: Expr, b: Expr, minus: bool| {
        let b = if minus { pool.neg(b) } else { b };
        let s = pool.add(a, b);
        let h = pool.ratio(1, 2);
        pool.mul(h, s)
    };
    let (nx, nu) = (states.len(), inputs.len());
    let mut e = Explicit {
        inputs,
        nonlinear,
        j: vec![vec![zero; nx]; nx],
        r: vec![vec![zero; nx]; nx],
        g: vec![vec![zero; nu]; nx],
        p: vec![vec![zero; nu]; nx],
        m: vec![vec![zero; nu]; nu],
        s: vec![vec![zero; nu]; nu],
    };
    for i in 0..nx {
        for k in 0..nx {
            e.j[i][k] = half(pool, f_cc[i][k], f_cc[k][i], true);
            let sym = half(pool, f_cc[i][k], f_cc[k][i], false);
            e.r[i][k] = pool.neg(sym);
        }
        for k in 0..nu {
            // G - P = F_CI, G + P = -F_IC^T
            e.g[i][k] = half(pool, f_ci[i][k], f_ic[k][i], true);
            let p = half(pool, f_ci[i][k], f_ic[k][i], false);
            e.p[i][k] = pool.neg(p);
        }
    }
    for i in 0..nu {
        for k in 0..nu {
            let m = half(pool, f_ii[i][k], f_ii[k][i], true);
            e.m[i][k] = pool.neg(m);
            let s = half(pool, f_ii[i][k], f_ii[k][i], false);
            e.s[i][k] = pool.neg(s);
        }
    }
    Some(e)
}

fn product(pool: &mut Pool, a: &Matrix, b: &Matrix) -> Matrix {
    let columns = b.first().map_or(0, Vec::len);
    a.iter()
        .map(|row| {
            (0..columns)
                .map(|j| {
                    let terms: Vec<Expr> = row.iter().zip(b).map(|(x, b)| pool.mul(*x, b[j])).collect();
                    pool.sum(&terms)
                })
                .collect()
        })
        .collect()
}

fn sum(pool: &mut Pool, a: &Matrix, b: &Matrix) -> Matrix {
    a.iter()
        .enumerate()
        .map(|(i, row)| {
            row.iter()
                .enumerate()
                .map(|(j, x)| b.get(i).and_then(|r| r.get(j)).map_or(*x, |y| pool.add(*x, *y)))
                .collect()
        })
        .collect()
}

/// (1 - K D)^-1 K, solved separately for each set of resistors that depend on one another.
fn loop_gain(pool: &mut Pool, d: &Matrix, k: &Matrix) -> Option<Matrix> {
    let n = k.len();
    let (zero, one) = (pool.int(0), pool.int(1));
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(n);
    for (i, row) in d.iter().chain(k).enumerate() {
        for (j, x) in row.iter().enumerate() {
            if !pool.is_zero(*x) {
                sets.union(i % n, j);
            }
        }
    }
    let mut result = vec![vec![zero; n]; n];
    let labels: Vec<usize> = (0..n).map(|i| sets.find(i)).collect();
    for root in 0..n {
        let members: Vec<usize> = (0..n).filter(|i| labels[*i] == root).collect();
        let part =
            |m: &Matrix| -> Matrix { members.iter().map(|&i| members.iter().map(|&j| m[i][j]).collect()).collect() };
        let (own, ties) = (part(k), part(d));
        let loose = ties.iter().flatten().all(|x| pool.is_zero(*x));
        let found = if loose {
            own
        } else if members.len() > 8 {
            return None;
        } else {
            let mut a = product(pool, &own, &ties);
            for (i, row) in a.iter_mut().enumerate() {
                for (j, x) in row.iter_mut().enumerate() {
                    let unit = if i == j { one } else { zero };
                    *x = pool.sub(unit, *x);
                }
            }
            let inv = inverse(pool, &a)?;
            product(pool, &inv, &own)
        };
        for (p, &i) in members.iter().enumerate() {
            for (q, &j) in members.iter().enumerate() {
                result[i][j] = found[p][q];
            }
        }
    }
    Some(result)
}
