//! Small and middling dense systems: Gauss' elimination with scaled partial pivoting.
//!
//! Back ends repeat [`solve`] operation by operation, so that all of them give the same bits: what is computed, and in
//! which order, is said there.

/// A pivot below this part of its column's largest entry before elimination is taken for 0.
pub const TINY: f64 = 1e-16;

/// Where equations may leave unknowns open, so may a pivot up to this part be: rounding leaves that of none.
pub const POOR: f64 = 1e-14;
/// What equations that say the same may differ by, as a part of the terms of the right side: in an iteration on its way to
/// rounding, which is in their last digits. What is left of them is told by the next update.
pub const ALIKE: f64 = 1e-6;

/// Two unknowns are solved by Cramer's rule where the determinant is above this part of the sum of its terms,
pub const DIGITS: f64 = 1e-6;

/// and within this range.
pub const RANGE: (f64, f64) = (1e-200, 1e200);

/// Solves `a x = b` in place: `a`, row-major, is destroyed; `b` becomes `x`. Says whether something was left open.
///
/// With `s_i = 1 / max_j |a_ij|` and `c_k = max_i |a_ik| s_i` of the matrix as it is given, for each column `k` in
/// turn: the pivot is the first of the rows from `k` on whose `|a_ik| s_i` is largest, and there is none where that is
/// at most [`TINY`] `c_k`; it is exchanged with row `k`; with `r_k = 1 / a_kk`, each later row loses `(a_ik r_k)` times
/// row `k`. Then, from the last, `x_k = (b_k - a_k,k+1 x_k+1 - ...) r_k`, subtracted from left to right. One unknown is
/// divided; for two see [`DIGITS`].
///
/// Where equations may leave unknowns `open`, as what two frictions on both sides of a gear hold each, a row of zeros, as
/// of ideal diodes in a ring that all conduct, has `s_i = 0`; and where a pivot is at most [`POOR`] `c_k`, row `k` is
/// exchanged with the first of the rows from `k` on of which least is left, `max_j>k |a_ij| s_i`, and `r_k = s_k`. It
/// says what other rows said where what is left of it then, `b_k - a_k,k+1 x_k+1 - ...`, is at most [`ALIKE`] times the
/// sum of `b_k` as it was given and what was taken off it, each by its size; so `x_k = 0`. Else all is done again, as
/// where nothing may be open.
///
/// # Errors
/// The row for which no pivot is found, counted in the order given. `x` may still be infinite or NaN where the matrix
/// held such numbers.
///
/// # Panics
/// Where `a` is shorter than `n * n`, `b` or `scratch` shorter than `n`.
pub fn solve(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch, open: bool) -> Result<bool, usize> {
    if n == 1 {
        if a[0] == 0.0 {
            return Err(0);
        }
        b[0] /= a[0];
        return Ok(false);
    }
    let (a, b) = (&mut a[..n * n], &mut b[..n]);
    if n == 2 && cramer(a, b) {
        return Ok(false);
    }
    if !open {
        return eliminate(n, a, b, scratch, false).map(|_| false);
    }
    scratch.matrix.clear();
    scratch.matrix.extend_from_slice(a);
    scratch.right.clear();
    scratch.right.extend_from_slice(b);
    if let Some(left) = eliminate(n, a, b, scratch, true)? {
        return Ok(left);
    }
    a.copy_from_slice(&scratch.matrix);
    b.copy_from_slice(&scratch.right);
    eliminate(n, a, b, scratch, false).map(|_| false)
}

/// Eliminates with pivots; None where what was taken for open is not.
fn eliminate(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch, open: bool) -> Result<Option<bool>, usize> {
    let mut left = false;
    let (order, column) = (&mut scratch.order[..n], &mut scratch.column[..n]);
    let (scale, inverse) = (&mut scratch.scale[..n], &mut scratch.inverse[..n]);
    let (parked, told) = (&mut scratch.parked[..n], &mut scratch.told[..n]);
    told.iter_mut().zip(b.iter()).for_each(|(t, b)| *t = b.abs());
    column.fill(0.0);
    for (i, row) in a.chunks_exact(n).enumerate() {
        order[i] = i;
        let largest = row.iter().fold(0.0f64, |m, x| larger(m, x.abs()));
        if largest == 0.0 && !open {
            return Err(i);
        }
        // A row that says nothing is never chosen.
        scale[i] = if largest == 0.0 { 0.0 } else { 1.0 / largest };
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
        parked[k] = open && best <= POOR * column[k];
        left |= parked[k];
        if parked[k] {
            p = emptiest(n, k, a, scale);
        } else if best <= TINY * column[k] {
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
            told.swap(k, p);
        }
        inverse[k] = if parked[k] { scale[k] } else { 1.0 / pivot_row[k] };
        let tail = &pivot_row[k + 1..n];
        let bk = b[k];
        for ((row, b), told) in lower.chunks_exact_mut(n).zip(b[k + 1..].iter_mut()).zip(&mut told[k + 1..]) {
            let l = row[k] * inverse[k];
            for (x, u) in row[k + 1..].iter_mut().zip(tail) {
                *x -= l * u;
            }
            *b -= l * bk;
            *told += (l * bk).abs();
        }
    }
    for k in (0..n).rev() {
        let row = &a[k * n..(k + 1) * n];
        let rest = row[k + 1..].iter().zip(&b[k + 1..]).fold(b[k], |rest, (a, x)| rest - a * x);
        b[k] = rest * inverse[k];
        if parked[k] {
            if rest.abs() > ALIKE * told[k] {
                return Ok(None);
            }
            b[k] = 0.0;
        }
    }
    Ok(Some(left))
}

/// The first of the rows from `k` on of which least is left behind column `k`.
fn emptiest(n: usize, k: usize, a: &[f64], scale: &[f64]) -> usize {
    let left = |i: usize| a[i * n + k + 1..(i + 1) * n].iter().fold(0.0f64, |m, x| larger(m, x.abs())) * scale[i];
    let (mut p, mut least) = (k, left(k));
    for i in k + 1..n {
        let other = left(i);
        if other < least {
            (p, least) = (i, other);
        }
    }
    p
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
    parked: Vec<bool>,
    told: Vec<f64>,
    /// Matrix and right side as they were given.
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl Scratch {
    /// Memory for `n` unknowns.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        let (matrix, right) = (Vec::with_capacity(n * n), Vec::with_capacity(n));
        Self {
            order: vec![0; n],
            column: zeros(),
            scale: zeros(),
            inverse: zeros(),
            parked: vec![false; n],
            told: zeros(),
            matrix,
            right,
        }
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
                solve(n, &mut a.clone(), &mut b, &mut Scratch::new(n), false).unwrap();
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
    fn what_rows_leave_open_stays() {
        // A momentum, and two frictions about a gear: their rows say the same, to rounding.
        let row = |gear: f64| [-0.3 * gear, 0.0, 0.0];
        let matrix = [[1.0, 1e-6, 3e-7], row(1.0), row(0.7)].concat();
        let mut b = [0.1, -0.06, -0.06 * 0.7];
        let solve_so = |open, b: &mut [f64]| solve(3, &mut matrix.clone(), b, &mut Scratch::new(3), open);
        assert_eq!(solve_so(true, &mut b), Ok(true));
        assert!((b[0] - 0.2).abs() < 1e-15 && (b[1] + 1e5).abs() < 1e-9 && b[2] == 0.0, "{b:?}");
        // Of a row of zeros, as of laws that are all flat, another unknown is told nothing, wherever it stands; and so of
        // one that becomes such.
        for empty in [[0.0; 3], [2.0, -2.0, 0.0]] {
            let rows = [(empty, empty[0] / 2.0), ([1.0, -1.0, 0.0], 0.5), ([0.0, 0.0, 2.0], 3.0)];
            for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                let flat = order.map(|i| rows[i].0).concat();
                let mut b = order.map(|i| rows[i].1);
                let mut none = order.map(|i| if i == 0 { 1.5 } else { 0.5 });
                let mut scratch = Scratch::new(3);
                assert_eq!(solve(3, &mut flat.clone(), &mut b, &mut scratch, true), Ok(true), "{order:?}");
                assert_eq!((b[0] - b[1], b[2]), (0.5, 1.5), "{order:?}");
                assert!(solve(3, &mut flat.clone(), &mut none, &mut scratch, true).is_err(), "{order:?}");
            }
        }
        // Two that don't are left to themselves.
        let (mut b, mut same) = ([0.1, -0.06, 0.05], [0.1, -0.06, 0.05]);
        assert_eq!(solve_so(true, &mut b), solve_so(false, &mut same));
        assert_eq!(b.map(f64::to_bits), same.map(f64::to_bits));
    }

    #[test]
    fn singular_matrices_are_told() {
        for n in 1..8 {
            let mut a = vec![1.0; n * n];
            if n == 1 {
                a[0] = 0.0;
            }
            assert!(solve(n, &mut a, &mut vec![1.0; n], &mut Scratch::new(n), false).is_err(), "{n}");
        }
        let mut zero_row = [1.0, 2.0, 0.0, 0.0];
        assert_eq!(solve(2, &mut zero_row, &mut [1.0, 1.0], &mut Scratch::new(2), false), Err(1));
    }
}
