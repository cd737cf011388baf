//! Forms in how far the states are from their means over the step.

use super::{Flow, even, multiply};
use crate::double_double::{DoubleDouble, Matrix};
use std::ops::Mul;

/// Terms of the series at the small step: `(2 SERIES)^18 / 19!` is below 1e-33.
const TERMS: u32 = 19;

/// A step of the implicit Euler method in even units.
pub(super) struct Euler {
    /// The change of `w`, as rows over `w`.
    pub rows: Matrix,
    /// What makes of it the step times the rate at the start.
    back: Matrix,
}

/// Pivots of up to this size are taken for 0, in even units.
const NONE: f64 = 1e-8;

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
        match back.clone().solve(rows.clone(), NONE) {
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
    pub(super) fn drift(&self, m: &[DoubleDouble], d: &[f64], euler: &Euler) -> Matrix {
        let n = d.len();
        let m = even(m, d);
        // With X = A t: V = t Σ v_k, v_1 = 1, v_k = v_(k-1) X / k. So V' = 1 + A V, and what that makes of the
        // derivative of V^T M V = t² Σ p_k is k p_k = M v_(k-1) + (M v_(k-1))^T + X^T p_(k-1) + p_(k-1) X, p_1 = 0.
        let (mut part, mut power) = (Matrix::zero(n), Matrix::zero(n).plus_one());
        let (mut v, mut w, mut form) = (power.clone(), power.clone().map(|x| x.scale(0.5)), Matrix::zero(n));
        for k in 2..=TERMS {
            let [k, next] = [f64::from(k), f64::from(k + 1)];
            let half = multiply(&m, &power).plus(&multiply(&part, &self.small));
            part = half.transposed().plus(&half).map(|x| x.over(k));
            power = multiply(&power, &self.small).map(|x| x.over(k));
            v = v.plus(&power);
            w = w.plus(&power.clone().map(|x| x.over(next)));
            form = form.plus(&part.clone().map(|x| x.over(next)));
        }
        let mut t = DoubleDouble::new(self.step);
        let times = |matrix: Matrix, powers: i32| (0..powers).fold(matrix, |matrix, _| matrix.map(|x| x.mul(t)));
        let (mut v, mut w, mut form) = (times(v, 1), times(w, 2), times(form, 3));
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
