//! Small systems written out, as `bond_runtime::solve::dense` solves them.

use super::writer::{Vector, Writer};
use crate::backend::code::{Cond, Stmt, System, Value, Var};
use bond_runtime::solve::dense::{ALIKE, POOR, TINY};
use bond_runtime::solve::linear::Matrix;

/// What tells that a system was solved, and left something open.
pub(in crate::backend) const LEFT_OPEN: f64 = -2.0;

impl Writer {
    /// The number of a system that is solved elsewhere.
    pub(super) fn system(&mut self, n: usize, pattern: Vec<(u32, u32)>, matrix: Matrix) -> u32 {
        self.systems.push(System { n, pattern, matrix });
        self.systems.len() as u32 - 1
    }

    /// Solves a system of the entries (row, column, value); `row` becomes -1, [`LEFT_OPEN`] where something may be and was
    /// left open, or the row without a pivot.
    pub(super) fn eliminate(
        &mut self,
        n: usize,
        entries: &[(u32, u32, Value)],
        right: &[Value],
        (row, open): (Var, bool),
    ) -> Vector {
        let zero = self.number(0.0);
        let mut a = vec![zero; n * n];
        for (i, j, v) in entries {
            a[*i as usize * n + *j as usize] = *v;
        }
        let x: Vec<Var> = (0..n).map(|_| self.var()).collect();
        let none = self.number(-1.0);
        self.set(row, none);
        match n {
            1 => {
                let singular = self.eq(a[0], zero);
                let q = self.div(right[0], a[0]);
                self.set(x[0], q);
                self.when(singular, |w| w.set(row, zero));
            }
            2 => self.two(&a, right, &x, (row, open)),
            _ => self.pivoted(n, &a, right, &x, (row, open)),
        }
        Vector::Vars(x)
    }

    /// By Cramer's rule where the determinant has digits, else with pivots.
    fn two(&mut self, a: &[Value], b: &[Value], x: &[Var], how: (Var, bool)) {
        let (p, q) = (self.mul(a[0], a[3]), self.mul(a[1], a[2]));
        let det = self.sub(p, q);
        let (size, p, q) = (self.abs(det), self.abs(p), self.abs(q));
        let sum = self.add(p, q);
        let part = self.number(bond_runtime::solve::dense::DIGITS);
        let least = self.mul(part, sum);
        let (low, high) = bond_runtime::solve::dense::RANGE;
        let (low, high) = (self.number(low), self.number(high));
        let plain = Cond::all([self.lt(least, size), self.lt(low, size), self.lt(size, high)]);
        let (yes, no) = (
            self.block(|w| {
                let one = w.number(1.0);
                let inverse = w.div(one, det);
                let (s, t) = (w.mul(b[0], a[3]), w.mul(a[1], b[1]));
                let first = w.sub(s, t);
                let (s, t) = (w.mul(a[0], b[1]), w.mul(b[0], a[2]));
                let second = w.sub(s, t);
                let (first, second) = (w.mul(first, inverse), w.mul(second, inverse));
                w.set(x[0], first);
                w.set(x[1], second);
            }),
            self.block(|w| w.pivoted(2, a, b, x, how)),
        );
        self.push(Stmt::If(plain, yes, no));
    }

    /// With scaled partial pivoting.
    fn pivoted(&mut self, n: usize, matrix: &[Value], right: &[Value], x: &[Var], (row, open): (Var, bool)) {
        // Whether unknowns may be left open, as yet.
        let may = open.then(|| self.starting(1.0));
        self.repeat(|w| {
            let (zero, one) = (w.number(0.0), w.number(1.0));
            let fail = |w: &mut Writer, at: Value| {
                w.set(row, at);
                w.push(Stmt::Break);
            };
            let larger = |w: &mut Writer, m: Value, x: Value| {
                let more = w.lt(m, x);
                w.select(more, x, m)
            };
            let mut column = vec![zero; n];
            let (mut scale, mut order) = (Vec::new(), Vec::new());
            for i in 0..n {
                let own = &matrix[i * n..(i + 1) * n];
                let sizes: Vec<Value> = own.iter().map(|x| w.abs(*x)).collect();
                let largest = sizes.iter().fold(zero, |m, x| larger(w, m, *x));
                let empty = w.eq(largest, zero);
                let number = w.number(i as f64);
                let mut s = w.div(one, largest);
                let mut fails = empty.clone();
                if let Some(may) = may {
                    s = w.select(empty.clone(), zero, s);
                    let may = w.get(may);
                    fails = Cond::all([empty, Cond::True(may).not()]);
                }
                w.when(fails, |w| fail(w, number));
                for (c, x) in column.iter_mut().zip(&sizes) {
                    let x = w.mul(*x, s);
                    *c = larger(w, *c, x);
                }
                let (sv, ov) = (w.var(), w.var());
                w.set(sv, s);
                w.set(ov, number);
                scale.push(sv);
                order.push(ov);
            }
            let a: Vec<Var> = matrix
                .iter()
                .map(|v| {
                    let var = w.var();
                    w.set(var, *v);
                    var
                })
                .collect();
            for (x, b) in x.iter().zip(right) {
                w.set(*x, *b);
            }
            let size = |b: &Value| {
                let size = w.abs(*b);
                w.holding(size)
            };
            let told: Vec<Var> = if open { right.iter().map(size).collect() } else { Vec::new() };
            let (mut inverse, mut parked) = (Vec::new(), Vec::new());
            for k in 0..n {
                let size = |w: &mut Writer, i: usize| {
                    let (x, s) = (w.get(a[i * n + k]), w.get(scale[i]));
                    let x = w.abs(x);
                    w.mul(x, s)
                };
                let mut best = size(w, k);
                let mut p = w.number(k as f64);
                for i in k + 1..n {
                    let other = size(w, i);
                    let more = w.lt(best, other);
                    let number = w.number(i as f64);
                    p = w.select(more.clone(), number, p);
                    best = w.select(more, other, best);
                }
                let tiny = w.number(TINY);
                let least = w.mul(tiny, column[k]);
                let mut none = w.le(best, least);
                if let Some(may) = may {
                    let (poor, may) = (w.tolerance(POOR), w.get(may));
                    let poor = w.mul(poor, column[k]);
                    let park = Cond::all([Cond::True(may), w.le(best, poor)]);
                    let chosen = w.holding(p);
                    w.when(park.clone(), |w| {
                        let emptiest = emptiest(w, n, k, (&a, &scale), larger);
                        w.set(chosen, emptiest);
                    });
                    p = w.get(chosen);
                    let flag = w.select(park.clone(), one, zero);
                    parked.push(w.holding(flag));
                    let left = w.number(LEFT_OPEN);
                    w.when(park.clone(), |w| w.set(row, left));
                    none = Cond::all([park.not(), none]);
                }
                w.when(none, |w| {
                    let at = w.get(order[k]);
                    fail(w, at);
                });
                for i in k + 1..n {
                    let number = w.number(i as f64);
                    let is = w.eq(p, number);
                    w.when(is, |w| {
                        let pairs = (k..n).map(|j| (a[k * n + j], a[i * n + j]));
                        let rest = [(x[k], x[i]), (scale[k], scale[i]), (order[k], order[i])];
                        let told = told.get(k).copied().zip(told.get(i).copied());
                        for (one, other) in pairs.chain(rest).chain(told) {
                            let (u, v) = (w.get(one), w.get(other));
                            w.set(one, v);
                            w.set(other, u);
                        }
                    });
                }
                let pivot = w.get(a[k * n + k]);
                let mut r = w.div(one, pivot);
                if let Some(flag) = parked.get(k) {
                    let (flag, own) = (w.get(*flag), w.get(scale[k]));
                    r = w.select(Cond::True(flag), own, r);
                }
                inverse.push(r);
                let tail: Vec<Value> = (k + 1..n).map(|j| w.get(a[k * n + j])).collect();
                let bk = w.get(x[k]);
                for i in k + 1..n {
                    let l = w.get(a[i * n + k]);
                    let l = w.mul(l, r);
                    for (j, u) in (k + 1..n).zip(&tail) {
                        let v = w.get(a[i * n + j]);
                        let term = w.mul(l, *u);
                        let v = w.sub(v, term);
                        w.set(a[i * n + j], v);
                    }
                    let v = w.get(x[i]);
                    let term = w.mul(l, bk);
                    let v = w.sub(v, term);
                    w.set(x[i], v);
                    if let Some(told) = told.get(i) {
                        let (t, term) = (w.get(*told), w.abs(term));
                        let t = w.add(t, term);
                        w.set(*told, t);
                    }
                }
            }
            for k in (0..n).rev() {
                let mut rest = w.get(x[k]);
                for j in k + 1..n {
                    let (u, v) = (w.get(a[k * n + j]), w.get(x[j]));
                    let term = w.mul(u, v);
                    rest = w.sub(rest, term);
                }
                let mut value = w.mul(rest, inverse[k]);
                if let (Some(may), Some(flag)) = (may, parked.get(k)) {
                    let flag = w.get(*flag);
                    let flag = Cond::True(flag);
                    let (part, told, size) = (w.tolerance(ALIKE), w.get(told[k]), w.abs(rest));
                    let bound = w.mul(part, told);
                    let other = Cond::all([flag.clone(), w.lt(bound, size)]);
                    w.when(other, |w| {
                        let none = w.number(-1.0);
                        w.set(row, none);
                        w.set(may, zero);
                        w.push(Stmt::Continue);
                    });
                    value = w.select(flag, zero, value);
                }
                w.set(x[k], value);
            }
            w.push(Stmt::Break);
        });
    }
}

/// The first of the rows from `k` on of which least is left behind column `k`.
fn emptiest(
    w: &mut Writer,
    n: usize,
    k: usize,
    (a, scale): (&[Var], &[Var]),
    larger: impl Fn(&mut Writer, Value, Value) -> Value,
) -> Value {
    let left = |w: &mut Writer, i: usize| {
        let zero = w.number(0.0);
        let most = (k + 1..n).fold(zero, |m, j| {
            let x = w.get(a[i * n + j]);
            let x = w.abs(x);
            larger(w, m, x)
        });
        let scale = w.get(scale[i]);
        w.mul(most, scale)
    };
    let (mut p, mut least) = (w.number(k as f64), left(w, k));
    for i in k + 1..n {
        let other = left(w, i);
        let less = w.lt(other, least);
        let number = w.number(i as f64);
        p = w.select(less.clone(), number, p);
        least = w.select(less, other, least);
    }
    p
}
