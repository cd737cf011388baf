//! The exact step of a linear system: its exponential, means and integrals of quadratic forms over the step.
//!
//! The exponential is computed in double-double arithmetic, by a Taylor series at a small step and doubling from there.
//! What is doubled is `F = exp(A t) - 1`: `F(2 t) = 2 F + F²`. Rounding that strikes the slow motions of a stiff system
//! doubles each time, so that of some 32 digits about 20 are left at a stiffness ratio of 1e12. The units are made even
//! first, by powers of two.

mod balance;
mod drift;

use crate::double_double::{DoubleDouble, Matrix};
use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul, Sub};
use thiserror::Error;

/// A linear system with what drives it: `dw/dt = A w` for `w = (x, xi)`, and what is wanted of a step.
///
/// All are double-double: over a step of many time constants a current is the small difference of two large ones,
/// and only with these are its own rows, and products of them, what they are by `A`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Linear {
    /// How many states `x`.
    pub n: usize,
    /// How many driving states `xi`.
    pub m: usize,
    /// `A`, row by row, `(n + m)²` entries; the last `m` rows say `d xi/dt` in terms of `xi`.
    pub a: Vec<DoubleDouble>,
    /// Rows `c`, each `n + m` long: the mean over the step of `c w` is wanted.
    pub means: Vec<Vec<DoubleDouble>>,
    /// Symmetric matrices `M`, row by row, each `(n + m)²` long: the integral over the step of `w^T M w` is wanted.
    pub forms: Vec<Vec<DoubleDouble>>,
    /// The same for matrices `M >= 0`, whose integrals are wanted as `Q = R^T R`: a sum of squares keeps its digits
    /// where a form in entries would cancel.
    pub squares: Vec<Vec<DoubleDouble>>,
    /// Symmetric matrices `M`: the integral of `(w(s) - w̄)^T M (w(s) - w̄)` is wanted, with the mean `w̄` over the
    /// step, as a form in how far `w` would go by the implicit Euler method, which is 0 where all rests.
    pub drifts: Vec<Vec<DoubleDouble>>,
    /// Whether the change of the states is wanted where they change little: the rows of `exp(A h)` then lack their 1 on
    /// the diagonal where [`Layout::keep`] says 1.
    pub changes: bool,
}

/// Where things are in a [`table`]. All counts are of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    rows: usize,
    columns: usize,
    means: usize,
    forms: usize,
    squares: usize,
    drifts: usize,
    changes: bool,
}

impl Layout {
    /// The layout of the table of a system.
    pub fn of(linear: &Linear) -> Self {
        Self {
            rows: linear.n,
            columns: linear.n + linear.m,
            means: linear.means.len(),
            forms: linear.forms.len(),
            squares: linear.squares.len(),
            drifts: linear.drifts.len(),
            changes: linear.changes,
        }
    }

    /// Start of the first `n` rows of `exp(A h)`, directly followed by their low-order part.
    ///
    /// An entry is the sum of both. The first is short, 26 bits, and the second has the digits from there on, some 24
    /// decimal ones in all: of `Σ E_ij v_j + Σ low_ij v_j` neither sum then drowns in the other's rounding. (With a
    /// first part of full length it would; each entry's rounding then acts on every step alike, and energy drifts by
    /// some 5e-17 a step.)
    pub fn exponential(&self) -> usize {
        0
    }

    /// Start of the low-order part.
    pub fn low(&self) -> usize {
        self.rows * self.columns
    }

    /// Start of the row, `n + m` long, of mean `k`. Those of all means lie one after the other.
    pub fn mean(&self, k: usize) -> usize {
        2 * self.rows * self.columns + k * self.columns
    }

    /// Start of form `k`: its upper triangle row by row, what is off the diagonal doubled.
    pub fn form(&self, k: usize) -> usize {
        self.mean(self.means) + k * (self.columns * (self.columns + 1) / 2)
    }

    /// Start of square `k`: the matrix `R`, upper triangular, `n + m` rows of `n + m`, those it does not need being 0.
    pub fn square(&self, k: usize) -> usize {
        self.form(self.forms) + k * self.columns * self.columns
    }

    /// Start of the `n + m` rows, each as long, of how far `w` would go by the implicit Euler method; there where there
    /// are drifts.
    pub fn euler(&self) -> usize {
        self.square(self.squares)
    }

    /// Start of drift `k`, laid out as a form is.
    pub fn drift(&self, k: usize) -> usize {
        let rows = if self.drifts > 0 { self.columns } else { 0 };
        self.euler() + rows * self.columns + k * (self.columns * (self.columns + 1) / 2)
    }

    /// Start of the `n` numbers, 1 or 0, that say how much of a state the rows of the exponential leave to be added.
    pub fn keep(&self) -> usize {
        self.drift(self.drifts)
    }

    /// Length of the table.
    pub fn size(&self) -> usize {
        self.keep() + if self.changes { self.rows } else { 0 }
    }
}

/// Why there is no table.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Unfit {
    /// The step is not a number above 0.
    #[error("a step of {0:e} s is not a finite number above 0")]
    Step(f64),
    /// A matrix or row has the wrong length.
    #[error("a matrix or row of the linear system has the wrong length")]
    Shape,
    /// A number of the system is infinite or NaN.
    #[error("the linear system has a coefficient that is not finite")]
    Coefficient,
    /// The system grows, in the step, beyond what numbers hold.
    #[error("the linear system grows beyond all numbers in a step of {0:e} s")]
    Overflow(f64),
}

/// The table of a step of length `h`, laid out as [`Layout`] says: `exp(A h)`, its low-order part, the rows
/// `c Φ` with `Φ = 1/h ∫ exp(A s) ds`, and the forms `∫ exp(A^T s) M exp(A s) ds`, integrals from 0 to `h`.
///
/// # Errors
/// See [`Unfit`].
pub fn table(linear: &Linear, h: f64) -> Result<Vec<f64>, Unfit> {
    let size = linear.n + linear.m;
    let square = size * size;
    if !(h.is_finite() && h > 0.0) {
        return Err(Unfit::Step(h));
    }
    if linear.a.len() != square
        || linear.means.iter().any(|c| c.len() != size)
        || linear.forms.iter().chain(&linear.squares).chain(&linear.drifts).any(|m| m.len() != square)
    {
        return Err(Unfit::Shape);
    }
    let all = linear.means.iter().chain(&linear.forms).chain(&linear.squares).chain(&linear.drifts).flatten();
    let mut numbers = linear.a.iter().chain(all);
    if !numbers.all(|x| x.is_finite()) {
        return Err(Unfit::Coefficient);
    }
    let nearest: Vec<f64> = linear.a.iter().map(|x| x.high).collect();
    let d = balance::balance(size, &nearest, 1.0 / (16.0 * h));
    let flow = Flow::new(size, &linear.a, &d, h).ok_or(Unfit::Overflow(h))?;
    let given = |q: Matrix| -> Vec<f64> {
        q.entries.iter().enumerate().map(|(k, x)| x.high / d[k / size] / d[k % size]).collect()
    };
    let forms: Vec<Vec<f64>> = linear.forms.iter().map(|m| given(flow.form(m, &d))).collect();
    let mut table = Vec::with_capacity(Layout::of(linear).size());
    let stays = |i: usize| linear.changes && (flow.exponential.get(i, i).high - 1.0).abs() <= 0.5;
    let keep: Vec<f64> = (0..linear.n).map(|i| if stays(i) { 1.0 } else { 0.0 }).collect();
    let e: Vec<DoubleDouble> = (0..linear.n * size)
        .map(|k| {
            let (i, j) = (k / size, k % size);
            let entry = flow.exponential.get(i, j).scale(d[i]).scale(1.0 / d[j]);
            let kept = if i == j { keep[i] } else { 0.0 };
            entry.add(DoubleDouble::new(-kept)).uneven()
        })
        .collect();
    table.extend(e.iter().map(|x| x.high));
    table.extend(e.iter().map(|x| x.low));
    for c in &linear.means {
        for j in 0..size {
            let mut sum = DoubleDouble::default();
            for i in (0..size).filter(|&i| c[i].high != 0.0) {
                sum = sum.add(c[i].mul(flow.mean.get(i, j).scale(d[i]).scale(1.0 / d[j])));
            }
            table.push(sum.high);
        }
    }
    let triangle = |table: &mut Vec<f64>, q: &[f64]| {
        for i in 0..size {
            table.push(q[i * size + i]);
            table.extend(q[i * size + i + 1..(i + 1) * size].iter().map(|x| 2.0 * x));
        }
    };
    for q in &forms {
        triangle(&mut table, q);
    }
    for m in &linear.squares {
        let r = root(flow.form(m, &d), size <= FINE);
        table.extend((0..square).map(|k| r[k] / d[k % size]));
    }
    if !linear.drifts.is_empty() {
        let euler = flow.euler(linear.n);
        for i in 0..size {
            table.extend((0..size).map(|j| euler.rows.get(i, j).high * d[i] / d[j]));
        }
        for m in &linear.drifts {
            triangle(&mut table, &given(flow.drift(m, &d, &euler)));
        }
    }
    if linear.changes {
        table.extend(keep);
    }
    if table.iter().all(|x| x.is_finite()) { Ok(table) } else { Err(Unfit::Overflow(h)) }
}

/// Largest norm of `A t` for which the series is used.
const SERIES: f64 = 1.0 / 16.0;
/// Terms of the series of the exponential: `SERIES^19 / 19!` is below 1e-39.
const TERMS: u32 = 18;
/// Terms of the series of a form: `(2 SERIES)^18 / 19!` is below 1e-33.
const FORM_TERMS: u32 = 18;

/// Up to so many states, forms are computed in double-double arithmetic: what a slow motion turns over may be 1e-16 of
/// what a fast one would. Beyond, that would take seconds.
const FINE: usize = 64;

/// A system over the step, in even units.
struct Flow {
    /// `A` times the small step.
    small: Matrix,
    /// The small step.
    step: f64,
    /// `exp(A t)` at the small step and its doubles, the last but one at half the step.
    ladder: Vec<Matrix>,
    exponential: Matrix,
    /// `1/h ∫ exp(A s) ds`
    mean: Matrix,
}

impl Flow {
    /// Nothing where numbers overflow.
    fn new(n: usize, a: &[DoubleDouble], d: &[f64], h: f64) -> Option<Self> {
        let even: Vec<DoubleDouble> = (0..n * n).map(|k| a[k].scale(d[k % n]).scale(1.0 / d[k / n])).collect();
        let norm = norm(n, &even) * h;
        if !norm.is_finite() {
            return None;
        }
        let mut doublings = 0;
        let mut step = h;
        while norm * (step / h) > SERIES {
            step *= 0.5;
            doublings += 1;
        }
        let small = even.iter().map(|x| x.mul(DoubleDouble::new(step))).collect();
        let small = Matrix { n, entries: small };
        // Both series by Horner's rule: F = X (1 + X/2 (1 + X/3 (...))), and the mean 1 + X/2 (1 + X/3 (...)).
        let mut mean = Matrix::zero(n).plus_one();
        for k in (2..=TERMS).rev() {
            mean = small.product(&mean).map(|x| x.over(f64::from(k))).plus_one();
        }
        let mut growth = small.product(&mean);
        let mut ladder = Vec::with_capacity(doublings);
        for _ in 0..doublings {
            ladder.push(growth.clone().plus_one());
            // The mean over twice the time: (Φ + E Φ) / 2 = Φ + F Φ / 2.
            mean = growth.product(&mean).map(|x| x.scale(0.5)).plus(&mean);
            growth = growth.product(&growth).plus(&growth).plus(&growth);
        }
        let exponential = growth.plus_one();
        if !exponential.is_finite() || !mean.is_finite() {
            return None;
        }
        Some(Self { small, step, ladder, exponential, mean })
    }

    /// The integral of `exp(A^T s) M exp(A s)`, for `M` in the given units, in even ones.
    fn form(&self, m: &[DoubleDouble], d: &[f64]) -> Matrix {
        let mut term = even(m, d).map(|x| x.mul(DoubleDouble::new(self.step)));
        let mut sum = term.clone();
        // The terms are t L^k(M) t^k / (k + 1)! with L(M) = A^T M + M A.
        for k in 2..=FORM_TERMS + 1 {
            let product = multiply(&term, &self.small);
            term = product.transposed().plus(&product).map(|x| x.over(f64::from(k)));
            sum = sum.plus(&term);
        }
        for e in &self.ladder {
            let both = multiply(&e.transposed(), &multiply(&sum, e));
            let even = both.transposed().plus(&both).map(|x| x.scale(0.5));
            sum = sum.plus(&even);
        }
        sum
    }
}

/// `R` with `Q = R^T R`, its upper triangle where it belongs and nothing below.
fn root(mut q: Matrix, fine: bool) -> Vec<f64> {
    let n = q.n;
    // Powers of two, so that nothing is rounded.
    let size: Vec<f64> = (0..n).map(|i| power_of_two(q.get(i, i).high.max(0.0).sqrt())).collect();
    for i in 0..n {
        for j in 0..n {
            let s = size[i] * size[j];
            let x = &mut q.entries[i * n + j];
            *x = if s > 0.0 { x.scale(1.0 / size[i]).scale(1.0 / size[j]) } else { DoubleDouble::default() };
        }
    }
    let mut r = factor(q, &size, fine);
    straighten(&mut r, fine);
    (0..n * n).map(|k| r.entries[k].high * size[k % n]).collect()
}

/// `L` with `Q = L^T L`, by Cholesky's method with the largest entry of the diagonal first, as it is where each
/// variable is `size` times as large; of a variable, what is left below rounding beside its own entry is left out.
///
/// Small entries are partly what the series of the form left out, and need not go with each other: they come last, and
/// are kept to what `Q >= 0` allows.
fn factor(mut q: Matrix, size: &[f64], fine: bool) -> Matrix {
    let n = q.n;
    let least = if fine { 1e-29 } else { 4e-15 };
    let mut l = Matrix::zero(n);
    let mut open: Vec<usize> = (0..n).collect();
    for row in 0..n {
        open.retain(|&i| q.get(i, i).high > least);
        let weight = |i: usize| q.get(i, i).high * size[i] * size[i];
        let Some(&p) = open.iter().max_by(|&&i, &&j| weight(i).total_cmp(&weight(j))) else { break };
        let root = q.get(p, p).sqrt();
        let pivot: Vec<DoubleDouble> = (0..n)
            .map(|j| {
                let most = (q.get(j, j).high.max(0.0) + least).sqrt();
                let x = q.get(p, j).divided(root);
                if x.high.abs() <= most { x } else { DoubleDouble::new(x.high.clamp(-most, most)) }
            })
            .collect();
        for i in 0..n {
            for j in 0..n {
                let x = &mut q.entries[i * n + j];
                *x = if fine {
                    x.add(pivot[i].mul(pivot[j]).scale(-1.0))
                } else {
                    DoubleDouble::new(x.high - pivot[i].high * pivot[j].high)
                };
            }
        }
        for i in 0..n {
            q.entries[i * n + p] = DoubleDouble::default();
            q.entries[p * n + i] = DoubleDouble::default();
        }
        l.entries[row * n..(row + 1) * n].copy_from_slice(&pivot);
    }
    l
}

/// Rotates the rows until nothing is left below the diagonal (Givens), which leaves `L^T L`: half the products of a
/// step are enough then.
fn straighten(l: &mut Matrix, fine: bool) {
    let n = l.n;
    for j in 0..n {
        for i in j + 1..n {
            let (a, b) = (l.get(j, j), l.get(i, j));
            let scale = power_of_two(a.high.abs().max(b.high.abs()));
            if b.high == 0.0 || scale == 0.0 {
                continue;
            }
            let (a, b) = (a.scale(1.0 / scale), b.scale(1.0 / scale));
            let norm = a.mul(a).add(b.mul(b)).sqrt();
            let (c, s) = (a.divided(norm), b.divided(norm));
            for k in j..n {
                let (x, y) = (l.get(j, k), l.get(i, k));
                let turned = if fine {
                    [c.mul(x).add(s.mul(y)), c.mul(y).sub(s.mul(x))]
                } else {
                    [c.high * x.high + s.high * y.high, c.high * y.high - s.high * x.high].map(DoubleDouble::new)
                };
                [l.entries[j * n + k], l.entries[i * n + k]] = turned;
            }
            l.entries[i * n + j] = DoubleDouble::default();
        }
    }
}

/// A form in the given units, in even ones.
fn even(m: &[DoubleDouble], d: &[f64]) -> Matrix {
    let n = d.len();
    Matrix { n, entries: (0..n * n).map(|k| m[k].scale(d[k / n]).scale(d[k % n])).collect() }
}

/// `a b`, in double-double arithmetic where that takes no long time.
fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    if a.n <= FINE { a.product(b) } else { a.rough_product(b) }
}

/// The power of two below a number above 0; 0 for 0.
fn power_of_two(x: f64) -> f64 {
    if x > 0.0 && x.is_finite() { libm::exp2(libm::log2(x).floor().clamp(-1000.0, 1000.0)) } else { 0.0 }
}

/// The larger of the largest sums of magnitudes in a row and in a column.
fn norm(n: usize, a: &[DoubleDouble]) -> f64 {
    let row = |i: usize| (0..n).map(|j| a[i * n + j].high.abs()).sum::<f64>();
    let column = |j: usize| (0..n).map(|i| a[i * n + j].high.abs()).sum::<f64>();
    (0..n).fold(0.0, |m, i| m.max(row(i)).max(column(i)))
}

#[cfg(test)]
mod tests;
