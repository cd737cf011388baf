//! Where the mass matrix of dependent storages is singular though the masses that it stands for are not.

use super::OPTIONS;
use crate::expression::{Expr, Pool, Symbol};
use std::f64::consts::PI;

/// Of what is divided by, that at whose zeros the mass matrix is singular: there it is so for the division alone.
pub(super) fn poles(pool: &Pool, divisors: impl Iterator<Item = Expr>, mass: &[Vec<Expr>]) -> Vec<Expr> {
    let entries: Vec<Expr> = mass.iter().flatten().copied().collect();
    let usual = pool.eval_all(&entries, &|s| place(s, 1, PI));
    let scale: Vec<f64> = (0..mass.len()).map(|i| 1.0 / usual[i * mass.len() + i].sqrt()).collect();
    let is_pole = |g: &Expr| {
        [PI, 1e3].into_iter().flat_map(|size| (1..OPTIONS.divisor_places).map(move |k| (k, size))).any(|(k, size)| {
            let between = |s: Symbol, t: f64| (1.0 - t) * place(s, k, size) + t * place(s, k + 1, size);
            let at = |t: f64| pool.eval(*g, &|s| between(s, t));
            let (mut from, mut to) = (0.0, 1.0);
            if at(from) * at(to) >= 0.0 {
                return false;
            }
            for _ in 0..OPTIONS.divisor_halvings {
                let middle = f64::midpoint(from, to);
                if at(from) * at(middle) > 0.0 { from = middle } else { to = middle }
            }
            least_pivot(pool.eval_all(&entries, &|s| between(s, from)), &scale) < OPTIONS.singular
        })
    };
    divisors.filter(is_pole).collect()
}

/// Places spread evenly, and otherwise for each state (Weyl).
fn place(s: Symbol, k: u32, size: f64) -> f64 {
    size * (2.0 * (f64::from(k) * f64::from(3 * s.0 + 2).sqrt()).fract() - 1.0)
}

/// The least pivot of a symmetric matrix that is not negative, its largest one first.
fn least_pivot(mut a: Vec<f64>, scale: &[f64]) -> f64 {
    let n = scale.len();
    a.iter_mut().enumerate().for_each(|(k, x)| *x *= scale[k / n] * scale[k % n]);
    let mut left: Vec<usize> = (0..n).collect();
    let mut least = f64::INFINITY;
    while let Some(at) = (0..left.len()).max_by(|i, j| a[left[*i] * (n + 1)].total_cmp(&a[left[*j] * (n + 1)])) {
        let k = left.swap_remove(at);
        let pivot = a[k * (n + 1)];
        least = least.min(pivot);
        for &i in &left {
            for &j in &left {
                a[i * n + j] -= a[i * n + k] * a[k * n + j] / pivot;
            }
        }
    }
    least
}
