//! Forms in how far the states are from their means over the step.

use super::{Flow, even, multiply};
use crate::twice::{Matrix, Twice};
use std::ops::{Add, Mul};

/// Terms of the series at the small step: `SERIES^17 / 18!` is below 1e-36.
const TERMS: usize = 17;

/// A step of the implicit Euler method in even units.
pub(super) struct Euler {
    /// The change of `w`, as rows over `w`.
    pub rows: Matrix,
    /// What makes of it the step times the rate at the start.
    back: Matrix,
}

/// A pivot that is so much smaller than the largest number of its matrix is taken for 0.
const NONE: f64 = 1e-8;

/// `X` with `A X = B`, by elimination with partial pivoting; none where `A` is all but singular.
fn solved(mut a: Matrix, mut b: Matrix) -> Option<Matrix> {
    let n = a.n;
    for k in 0..n {
        let size = |i: usize| a.get(i, k).high.abs();
        let p = (k..n).max_by(|&i, &j| size(i).total_cmp(&size(j)))?;
        if size(p) <= NONE {
            return None;
        }
        for j in 0..n {
            a.entries.swap(k * n + j, p * n + j);
            b.entries.swap(k * n + j, p * n + j);
        }
        let pivot = a.get(k, k);
        for i in (0..n).filter(|&i| i != k) {
            let f = a.get(i, k).divided(pivot).scale(-1.0);
            if f.high == 0.0 {
                continue;
            }
            for j in 0..n {
                let (x, y) = (a.get(k, j).mul(f), b.get(k, j).mul(f));
                a.entries[i * n + j] = a.get(i, j).add(x);
                b.entries[i * n + j] = b.get(i, j).add(y);
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            b.entries[i * n + j] = b.get(i, j).divided(a.get(i, i));
        }
    }
    b.is_finite().then_some(b)
}

impl Flow {
    /// How far `w` goes in a step of the implicit Euler method, the first `n` of it states: of a motion that dies away
    /// in the step no more than what there is of it, where its rate, mostly rounding, would be far larger.
    pub(super) fn euler(&self, n: usize) -> Euler {
        let doublings = 2f64.powi(self.ladder.len() as i32);
        let mut rows = self.small.clone().map(|x| x.scale(doublings));
        let mut back = Matrix::zero(rows.n);
        for i in 0..n {
            for j in 0..n {
                back.entries[i * rows.n + j] = rows.get(i, j).scale(-1.0);
            }
        }
        let mut back = back.plus_one();
        // Of a motion that grows as fast as that method cannot tell, the rate has to do.
        match solved(back.clone(), rows.clone()) {
            Some(found) => rows = found,
            None => back = Matrix::zero(rows.n).plus_one(),
        }
        Euler { rows, back }
    }

    /// The integral of `(V - V̄)^T M (V - V̄)` with `V(s) = ∫ exp(A r) dr` from 0 to s and its mean `V̄` over the step,
    /// for `M` in the given units, in even ones: with `g = A w` at the start, `V g` is how far `w` went. As a form in
    /// what the implicit Euler method makes of `g`.
    ///
    /// Where the states rest that is 0, and the form too, whatever the rounding of its entries.
    pub(super) fn drift(&self, m: &[Twice], d: &[f64], euler: &Euler) -> Matrix {
        let n = d.len();
        let m = even(m, d);
        let mut powers = vec![Matrix::zero(n).plus_one()];
        for k in 1..TERMS {
            powers.push(multiply(&powers[k - 1], &self.small));
        }
        let sum = |start: Twice, over: &dyn Fn(usize) -> f64| -> Matrix {
            let mut sum = Matrix::zero(n);
            // Divided step by step: the factors of factorials are small whole numbers.
            let mut c = start;
            for (k, power) in powers.iter().enumerate() {
                c = c.over(over(k));
                sum = sum.plus(&power.clone().map(|x| x.mul(c)));
            }
            sum
        };
        // V = t Σ X^k/(k + 1)!, its integral W = t² Σ X^k/(k + 2)!, X = A t.
        let mut t = Twice::new(self.step);
        let mut v = sum(t, &|k| (k + 1) as f64);
        let mut w = sum(t.mul(t).scale(0.5), &|k| if k == 0 { 1.0 } else { (k + 2) as f64 });
        let mut form = Matrix::zero(n);
        // V^T M V = t² Σ X^kᵀ M X^l / ((k + 1)! (l + 1)!), integrated.
        let mut left = t.mul(t).mul(t);
        for (k, power) in powers.iter().enumerate() {
            left = left.over((k + 1) as f64);
            let mut right = Matrix::zero(n);
            let mut c = left;
            for (l, power) in powers.iter().enumerate().take(TERMS - k) {
                c = c.over((l + 1) as f64);
                let c = c.over((k + l + 3) as f64);
                right = right.plus(&power.clone().map(|x| x.mul(c)));
            }
            form = form.plus(&multiply(&power.transposed(), &multiply(&m, &right)));
        }
        // V(t + s) = V(t) + V(s) E(t)
        for e in &self.ladder {
            let left = multiply(&v.transposed(), &m);
            let we = multiply(&w, e);
            let (square, cross) = (multiply(&left, &v), multiply(&left, &we));
            let both = multiply(&e.transposed(), &multiply(&form, e));
            form = form.plus(&square.map(|x| x.mul(t))).plus(&cross.transposed()).plus(&cross).plus(&both);
            w = w.plus(&v.clone().map(|x| x.mul(t))).plus(&we);
            let ve = multiply(&v, e);
            v = v.plus(&ve);
            t = t.scale(2.0);
        }
        // W is the mean of V times the step.
        let mean = multiply(&w.transposed(), &multiply(&m, &w)).map(|x| x.divided(t).scale(-1.0));
        let form = form.plus(&mean);
        let form = multiply(&euler.back.transposed(), &multiply(&form, &euler.back));
        let form = form.map(|x| x.divided(t).divided(t));
        form.transposed().plus(&form).map(|x| x.scale(0.5))
    }
}
