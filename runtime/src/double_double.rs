//! Double-double numbers (unevaluated sums of two doubles), and matrices of them.
//!
//! After Dekker, A floating-point technique for extending the available precision, 1971, and Knuth's two-sum.

use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul, Sub};

/// `high + low`, `low` below half a unit in the last place of `high`: some 32 decimal digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DoubleDouble {
    /// The nearest number.
    pub high: f64,
    /// What is left.
    pub low: f64,
}

/// `a + b` and what rounding it lost.
#[inline]
fn two_sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    let t = high - a;
    DoubleDouble { high, low: (a - (high - t)) + (b - t) }
}

/// The same where `a` is the larger.
#[inline]
fn quick_two_sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    DoubleDouble { high, low: b - (high - a) }
}

/// `x` as a sum of two numbers of 26 bits.
#[inline]
fn split(x: f64) -> (f64, f64) {
    let t = 134_217_729.0 * x;
    let high = t - (t - x);
    (high, x - high)
}

/// `a b` and what rounding it lost. Overflows from 2^996 on.
#[inline]
fn two_product(a: f64, b: f64) -> DoubleDouble {
    let high = a * b;
    let ((a1, a2), (b1, b2)) = (split(a), split(b));
    DoubleDouble { high, low: ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2 }
}

impl DoubleDouble {
    /// A number as it is.
    pub fn new(x: f64) -> Self {
        Self { high: x, low: 0.0 }
    }

    /// Whether both parts are finite.
    pub fn is_finite(self) -> bool {
        self.high.is_finite() && self.low.is_finite()
    }

    /// Divided by a small whole number.
    #[must_use]
    pub fn over(self, k: f64) -> Self {
        let high = self.high / k;
        let product = two_product(high, k);
        let rest = ((self.high - product.high) - product.low) + self.low;
        quick_two_sum(high, rest / k)
    }

    /// Divided by a number that is not 0.
    #[must_use]
    pub fn divided(self, other: Self) -> Self {
        let high = self.high / other.high;
        let rest = self.add(other.mul(Self::new(-high)));
        quick_two_sum(high, rest.high / other.high)
    }

    /// The root of a number above 0.
    #[must_use]
    pub fn sqrt(self) -> Self {
        let high = self.high.sqrt();
        let rest = self.add(Self::new(high).mul(Self::new(-high)));
        quick_two_sum(high, 0.5 * rest.high / high)
    }

    /// The same sum with a `high` of 26 bits, so that `low` weighs in whatever is rounded to 53.
    #[must_use]
    pub fn uneven(self) -> Self {
        let (high, rest) = split(self.high);
        if high.is_finite() { Self { high, low: rest + self.low } } else { self }
    }

    /// Times a power of two, or its opposite.
    #[must_use]
    pub fn scale(self, power: f64) -> Self {
        Self { high: self.high * power, low: self.low * power }
    }
}

/// The sum.
impl Add for DoubleDouble {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        let s = two_sum(self.high, other.high);
        let t = two_sum(self.low, other.low);
        let s = quick_two_sum(s.high, s.low + t.high);
        quick_two_sum(s.high, s.low + t.low)
    }
}

/// The difference.
impl Sub for DoubleDouble {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self + other.scale(-1.0)
    }
}

/// The product. Overflows from 2^996 on.
impl Mul for DoubleDouble {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        let p = two_product(self.high, other.high);
        quick_two_sum(p.high, p.low + (self.high * other.low + self.low * other.high))
    }
}

/// A square matrix, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Matrix {
    pub n: usize,
    pub entries: Vec<DoubleDouble>,
}

impl Matrix {
    pub fn zero(n: usize) -> Self {
        Self { n, entries: vec![DoubleDouble::default(); n * n] }
    }

    pub fn get(&self, i: usize, j: usize) -> DoubleDouble {
        self.entries[i * self.n + j]
    }

    pub fn product(&self, other: &Self) -> Self {
        let n = self.n;
        let mut product = Self::zero(n);
        if n == 0 {
            return product;
        }
        let rows = product.entries.chunks_exact_mut(n).zip(self.entries.chunks_exact(n));
        for (to, row) in rows {
            for (a, from) in row.iter().zip(other.entries.chunks_exact(n)) {
                if a.high == 0.0 {
                    continue;
                }
                for (to, b) in to.iter_mut().zip(from) {
                    *to = to.add(a.mul(*b));
                }
            }
        }
        product
    }

    /// The product of the high parts.
    pub fn rough_product(&self, other: &Self) -> Self {
        let n = self.n;
        let from: Vec<f64> = other.entries.iter().map(|x| x.high).collect();
        let mut to = vec![0.0; n * n];
        for i in 0..n {
            let row = &mut to[i * n..(i + 1) * n];
            for k in 0..n {
                let a = self.entries[i * n + k].high;
                if a == 0.0 {
                    continue;
                }
                for (to, b) in row.iter_mut().zip(&from[k * n..(k + 1) * n]) {
                    *to += a * b;
                }
            }
        }
        Self { n, entries: to.into_iter().map(DoubleDouble::new).collect() }
    }

    pub fn transposed(&self) -> Self {
        let n = self.n;
        Self { n, entries: (0..n * n).map(|k| self.entries[k % n * n + k / n]).collect() }
    }

    /// `self + other`
    pub fn plus(mut self, other: &Self) -> Self {
        for (a, b) in self.entries.iter_mut().zip(&other.entries) {
            *a = a.add(*b);
        }
        self
    }

    /// Each entry by `f`.
    pub fn map(mut self, f: impl Fn(DoubleDouble) -> DoubleDouble) -> Self {
        self.entries.iter_mut().for_each(|x| *x = f(*x));
        self
    }

    /// Adds the unit matrix.
    pub fn plus_one(mut self) -> Self {
        for i in 0..self.n {
            let x = &mut self.entries[i * self.n + i];
            *x = x.add(DoubleDouble::new(1.0));
        }
        self
    }

    /// `X` with `self X = right`, by elimination with partial pivoting; none where a pivot is at most `none` in size.
    pub fn solve(mut self, mut right: Self, none: f64) -> Option<Self> {
        let n = self.n;
        for k in 0..n {
            let size = |i: usize| self.get(i, k).high.abs();
            let p = (k..n).max_by(|&i, &j| size(i).total_cmp(&size(j)))?;
            if size(p) <= none {
                return None;
            }
            for j in 0..n {
                self.entries.swap(k * n + j, p * n + j);
                right.entries.swap(k * n + j, p * n + j);
            }
            let pivot = self.get(k, k);
            for i in (0..n).filter(|&i| i != k) {
                let f = self.get(i, k).divided(pivot).scale(-1.0);
                if f.high == 0.0 {
                    continue;
                }
                for j in 0..n {
                    let (x, y) = (self.get(k, j).mul(f), right.get(k, j).mul(f));
                    self.entries[i * n + j] = self.get(i, j).add(x);
                    right.entries[i * n + j] = right.get(i, j).add(y);
                }
            }
        }
        for i in 0..n {
            for j in 0..n {
                right.entries[i * n + j] = right.get(i, j).divided(self.get(i, i));
            }
        }
        right.is_finite().then_some(right)
    }

    pub fn is_finite(&self) -> bool {
        self.entries.iter().all(|x| x.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirds_and_squares() {
        let third = DoubleDouble::new(1.0).over(3.0);
        let one = third.mul(DoubleDouble::new(3.0)).add(DoubleDouble::new(-1.0));
        assert!(one.high.abs() < 1e-31, "{one:?}");
        let x = DoubleDouble::new(1.0 + f64::EPSILON);
        let square = x.mul(x); // 1 + 2 eps + eps²
        assert_eq!(square, DoubleDouble { high: 1.0 + 2.0 * f64::EPSILON, low: f64::EPSILON * f64::EPSILON });
        let root = DoubleDouble::new(2.0).sqrt();
        assert!(root.mul(root).add(DoubleDouble::new(-2.0)).high.abs() < 1e-31, "{root:?}");
        let ratio = third.divided(root).mul(root).add(third.scale(-1.0));
        assert!(ratio.high.abs() < 1e-31, "{ratio:?}");
        assert_eq!(DoubleDouble::new(1e16).add(DoubleDouble::new(1.0)).add(DoubleDouble::new(-1e16)).high, 1.0);
    }
    #[test]
    fn matrices_are_solved_with_all_digits() {
        let hilbert = |i: usize, j: usize| DoubleDouble::new(1.0).over((i + j + 1) as f64);
        let a = Matrix { n: 4, entries: (0..16).map(|k| hilbert(k / 4, k % 4)).collect() };
        let one = Matrix::zero(4).plus_one();
        let inverse = a.clone().solve(one.clone(), 1e-8).expect("pivots are above 1e-4");
        let off = a.product(&inverse).plus(&one.map(|x| x.scale(-1.0)));
        // The condition is 1.6e4.
        assert!(off.entries.iter().all(|x| x.high.abs() < 1e-26), "{off:?}");
        assert!(Matrix::zero(2).solve(Matrix::zero(2), 1e-8).is_none());
    }
}
