//! Forms in how far the states went since the start of the step.

use super::Flow;
use crate::twice::{Matrix, Twice};

/// Terms of the series at the small step: `SERIES^10 / 11!` is below 1e-19.
const TERMS: usize = 10;

impl Flow {
    /// The integral of `V^T M V` with `V(s) = ∫ exp(A r) dr` from 0 to s, for `M` in the given units, in even ones:
    /// with `g = A w` at the start, `V g` is how far `w` went.
    ///
    /// Where the states rest `g` is 0, and the form too, whatever the rounding of its entries.
    pub(super) fn drift(&self, m: &[f64], d: &[f64]) -> Matrix {
        let n = d.len();
        let m: Vec<f64> = (0..n * n).map(|k| m[k] * d[k / n] * d[k % n]).collect();
        let small = plain(&self.small);
        let mut powers = vec![(0..n * n).map(|k| if k / n == k % n { 1.0 } else { 0.0 }).collect::<Vec<f64>>()];
        for k in 1..TERMS {
            powers.push(multiply(n, &powers[k - 1], &small));
        }
        let sum = |coefficient: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let mut sum = vec![0.0; n * n];
            for (k, power) in powers.iter().enumerate() {
                let c = coefficient(k);
                sum.iter_mut().zip(power).for_each(|(s, x)| *s += c * x);
            }
            sum
        };
        let factorial = |k: usize| (1..=k).map(|i| i as f64).product::<f64>();
        // V = t Σ X^k/(k + 1)!, its integral W = t² Σ X^k/(k + 2)!, X = A t.
        let mut t = self.step;
        let mut v = sum(&|k| t / factorial(k + 1));
        let mut w = sum(&|k| t * t / factorial(k + 2));
        let mut form = vec![0.0; n * n];
        for (k, power) in powers.iter().enumerate() {
            let right = sum(&|l| t.powi(3) / (factorial(k + 1) * factorial(l + 1) * (k + l + 3) as f64));
            let product = multiply(n, &transpose(n, power), &multiply(n, &m, &right));
            form.iter_mut().zip(&product).for_each(|(f, x)| *f += x);
        }
        // V(t + s) = V(t) + V(s) E(t)
        for e in &self.ladder {
            let e = &plain(e);
            let left = multiply(n, &transpose(n, &v), &m);
            let we = multiply(n, &w, e);
            let (square, cross) = (multiply(n, &left, &v), multiply(n, &left, &we));
            let both = multiply(n, &transpose(n, e), &multiply(n, &form, e));
            for i in 0..n {
                for j in 0..n {
                    let k = i * n + j;
                    form[k] += t * square[k] + cross[k] + cross[j * n + i] + both[k];
                }
            }
            let ve = multiply(n, &v, e);
            for k in 0..n * n {
                w[k] += t * v[k] + we[k];
                v[k] += ve[k];
            }
            t *= 2.0;
        }
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (form[i * n + j] + form[j * n + i]);
                (form[i * n + j], form[j * n + i]) = (mean, mean);
            }
        }
        Matrix { n, entries: form.into_iter().map(Twice::new).collect() }
    }
}

/// The entries with a double's digits: what a drift is multiplied with is small where they count.
fn plain(m: &Matrix) -> Vec<f64> {
    m.entries.iter().map(|x| x.high).collect()
}

fn multiply(n: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut c = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            let x = a[i * n + k];
            if x != 0.0 {
                for j in 0..n {
                    c[i * n + j] += x * b[k * n + j];
                }
            }
        }
    }
    c
}

fn transpose(n: usize, a: &[f64]) -> Vec<f64> {
    (0..n * n).map(|k| a[(k % n) * n + k / n]).collect()
}
