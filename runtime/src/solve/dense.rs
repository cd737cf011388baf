//! Small and middling dense systems: Gauss' elimination with scaled partial pivoting.
//!
//! Back ends repeat [`solve`] operation by operation, so that all of them give the same bits: what is computed, and in
//! which order, is said there.

/// A pivot below this part of its column's largest entry before elimination is taken for 0.
pub const TINY: f64 = 1e-16;

/// Two unknowns are solved by Cramer's rule where the determinant is above this part of the sum of its terms,
pub const DIGITS: f64 = 1e-6;

/// and within this range.
pub const RANGE: (f64, f64) = (1e-200, 1e200);

/// Solves `a x = b` in place: `a`, row-major, is destroyed; `b` becomes `x`.
///
/// With `s_i = 1 / max_j |a_ij|` and `c_k = max_i |a_ik| s_i` of the matrix as it is given, for each column `k` in
/// turn: the pivot is the first of the rows from `k` on whose `|a_ik| s_i` is largest, and there is none where that is
/// at most [`TINY`] `c_k`; it is exchanged with row `k`; with `r_k = 1 / a_kk`, each later row loses `(a_ik r_k)` times
/// row `k`. Then, from the last, `x_k = (b_k - a_k,k+1 x_k+1 - ...) r_k`, subtracted from left to right. One unknown is
/// divided; for two see [`DIGITS`].
///
/// # Errors
/// The row for which no pivot is found, counted in the order given. `x` may still be infinite or NaN where the matrix
/// held such numbers.
///
/// # Panics
/// Where `a` is shorter than `n * n`, `b` or `scratch` shorter than `n`.
pub fn solve(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch) -> Result<(), usize> {
    if n == 1 {
        if a[0] == 0.0 {
            return Err(0);
        }
        b[0] /= a[0];
        return Ok(());
    }
    let (a, b) = (&mut a[..n * n], &mut b[..n]);
    if n == 2 && cramer(a, b) {
        return Ok(());
    }
    let (order, column) = (&mut scratch.order[..n], &mut scratch.column[..n]);
    let (scale, inverse) = (&mut scratch.scale[..n], &mut scratch.inverse[..n]);
    column.fill(0.0);
    for (i, row) in a.chunks_exact(n).enumerate() {
        order[i] = i;
        let largest = row.iter().fold(0.0f64, |m, x| larger(m, x.abs()));
        if largest == 0.0 {
            return Err(i);
        }
        scale[i] = 1.0 / largest;
        for (x, c) in row.iter().zip(column.iter_mut()) {
            *c = larger(*c, x.abs() * scale[i]);
        }
    }
    for k in 0..n {
        let (mut p, mut best) = (k, a[k * n + k].abs() * scale[k]);
        for i in k + 1..n {
            let size = a[i * n + k].abs() * scale[i];
            if size > best {
                (p, best) = (i, size);
            }
        }
        if best <= TINY * column[k] {
            return Err(order[k]);
        }
        let (upper, lower) = a.split_at_mut((k + 1) * n);
        let pivot_row = &mut upper[k * n..];
        if p > k {
            let other = (p - k - 1) * n;
            pivot_row[k..n].swap_with_slice(&mut lower[other + k..other + n]);
            b.swap(k, p);
            order.swap(k, p);
            scale.swap(k, p);
        }
        inverse[k] = 1.0 / pivot_row[k];
        let tail = &pivot_row[k + 1..n];
        let bk = b[k];
        for (row, b) in lower.chunks_exact_mut(n).zip(b[k + 1..].iter_mut()) {
            let l = row[k] * inverse[k];
            for (x, u) in row[k + 1..].iter_mut().zip(tail) {
                *x -= l * u;
            }
            *b -= l * bk;
        }
    }
    for k in (0..n).rev() {
        let row = &a[k * n..(k + 1) * n];
        let rest = row[k + 1..].iter().zip(&b[k + 1..]).fold(b[k], |rest, (a, x)| rest - a * x);
        b[k] = rest * inverse[k];
    }
    Ok(())
}

/// Two unknowns; false where pivots are asked for.
fn cramer(a: &[f64], b: &mut [f64]) -> bool {
    let (p, q) = (a[0] * a[3], a[1] * a[2]);
    let det = p - q;
    let size = det.abs();
    let plain = DIGITS * (p.abs() + q.abs()) < size && RANGE.0 < size && size < RANGE.1;
    if plain {
        let inverse = 1.0 / det;
        let (x, y) = (b[0] * a[3] - a[1] * b[1], a[0] * b[1] - b[0] * a[2]);
        (b[0], b[1]) = (x * inverse, y * inverse);
    }
    plain
}

/// The larger; where one is no number, the first.
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Memory for [`solve`].
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    order: Vec<usize>,
    column: Vec<f64>,
    scale: Vec<f64>,
    inverse: Vec<f64>,
}

impl Scratch {
    /// Memory for `n` unknowns.
    pub fn new(n: usize) -> Self {
        Self { order: vec![0; n], column: vec![0.0; n], scale: vec![0.0; n], inverse: vec![0.0; n] }
    }
}

/// A power of two near `1 / x`, so that scaling with it rounds nothing; 1 where `x` is 0 or not finite.
pub(super) fn inverse_scale(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52) & 0x7ff;
    if exponent == 0 {
        // 0 or subnormal
        return if x == 0.0 { 1.0 } else { f64::from_bits(2045 << 52) };
    }
    if exponent == 0x7ff { 1.0 } else { f64::from_bits(2046u64.saturating_sub(exponent).max(1) << 52) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::testing::Random;

    #[test]
    fn scales_are_inverse_powers_of_two() {
        for x in [1.0, 1.5, 3e300, 2e-308, f64::MAX, 7e-200] {
            let s = inverse_scale(x);
            assert!(s > 0.0 && s.is_finite() && (0.4..4.1).contains(&(x * s)), "{x:e} {s:e}");
        }
        assert_eq!(inverse_scale(0.0), 1.0);
        assert_eq!(inverse_scale(f64::INFINITY), 1.0);
    }

    #[test]
    fn random_systems_with_wild_units() {
        let mut random = Random::new(1);
        for n in 1..=24 {
            for _ in 0..40 {
                let rows: Vec<f64> = (0..n).map(|_| (30.0 * random.next()).exp2()).collect();
                let columns: Vec<f64> = (0..n).map(|_| (30.0 * random.next()).exp2()).collect();
                let a: Vec<f64> = (0..n * n).map(|k| random.next() * rows[k / n] * columns[k % n]).collect();
                let x: Vec<f64> = columns.iter().map(|c| random.next() / c).collect();
                let mut b: Vec<f64> = (0..n).map(|i| (0..n).map(|j| a[i * n + j] * x[j]).sum()).collect();
                let right = b.clone();
                solve(n, &mut a.clone(), &mut b, &mut Scratch::new(n)).unwrap();
                for i in 0..n {
                    let (mut r, mut size) = (right[i], 0.0);
                    for j in 0..n {
                        r -= a[i * n + j] * b[j];
                        size += (a[i * n + j] * b[j]).abs();
                    }
                    assert!(r.abs() <= 1e-12 * size, "n {n} row {i} residual {r:e} of {size:e}");
                }
            }
        }
    }

    #[test]
    fn singular_matrices_are_told() {
        for n in 1..8 {
            let mut a = vec![1.0; n * n];
            if n == 1 {
                a[0] = 0.0;
            }
            assert!(solve(n, &mut a, &mut vec![1.0; n], &mut Scratch::new(n)).is_err(), "{n}");
        }
        let mut zero_row = [1.0, 2.0, 0.0, 0.0];
        assert_eq!(solve(2, &mut zero_row, &mut [1.0, 1.0], &mut Scratch::new(2)), Err(1));
    }
}
