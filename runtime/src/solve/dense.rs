//! Small and middling dense systems: Gauss' elimination with row equilibration and partial pivoting.

/// A pivot below this part of its column's largest entry before elimination is taken for 0.
const TINY: f64 = 1e-16;

/// Solves `a x = b` in place: `a`, row-major, is destroyed; `b` becomes `x`.
///
/// # Errors
/// The row for which no pivot is found, counted in the order given. `x` may still be infinite or NaN where the matrix
/// held such numbers.
///
/// # Panics
/// Where `a` is shorter than `n * n`, `b` or `scratch` shorter than `n`.
pub fn solve(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch) -> Result<(), usize> {
    match n {
        0 => Ok(()),
        1 => {
            if a[0] == 0.0 {
                return Err(0);
            }
            b[0] /= a[0];
            Ok(())
        }
        2 => {
            let (a, b) = (&mut a[..4], &mut b[..2]);
            equilibrate::<2>(a, b)?;
            two(a, b)
        }
        3 => {
            let (a, b) = (&mut a[..9], &mut b[..3]);
            equilibrate::<3>(a, b)?;
            three(a, b)
        }
        _ => general(n, &mut a[..n * n], &mut b[..n], scratch),
    }
}

/// Memory for [`solve`].
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    order: Vec<usize>,
    column: Vec<f64>,
}

impl Scratch {
    /// Memory for `n` unknowns.
    pub fn new(n: usize) -> Self {
        Self { order: vec![0; n], column: vec![0.0; n] }
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

/// Scales each row, and its right side, so that its largest entry is near 1.
fn equilibrate<const N: usize>(a: &mut [f64], b: &mut [f64]) -> Result<(), usize> {
    for (i, (row, b)) in a.chunks_exact_mut(N).zip(b.iter_mut()).enumerate() {
        let largest = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if largest == 0.0 {
            return Err(i);
        }
        let scale = inverse_scale(largest);
        row.iter_mut().for_each(|x| *x *= scale);
        *b *= scale;
    }
    Ok(())
}

/// Two unknowns.
fn two(a: &mut [f64], b: &mut [f64]) -> Result<(), usize> {
    let (p, q) = if a[2].abs() > a[0].abs() { (1, 0) } else { (0, 1) };
    let (a00, a01, a10, a11) = (a[2 * p], a[2 * p + 1], a[2 * q], a[2 * q + 1]);
    if a00 == 0.0 {
        return Err(p);
    }
    let l = a10 / a00;
    let pivot = a11 - l * a01;
    if pivot.abs() <= TINY * a01.abs().max(a11.abs()) {
        return Err(q);
    }
    let y = (b[q] - l * b[p]) / pivot;
    let x = (b[p] - a01 * y) / a00;
    b[0] = x;
    b[1] = y;
    Ok(())
}

/// Three unknowns.
fn three(a: &mut [f64], b: &mut [f64]) -> Result<(), usize> {
    let mut p = 0;
    for i in 1..3 {
        if a[3 * i].abs() > a[3 * p].abs() {
            p = i;
        }
    }
    if a[3 * p] == 0.0 {
        return Err(0);
    }
    let largest = [1, 2].map(|j| a[j].abs().max(a[3 + j].abs()).max(a[6 + j].abs()));
    let (q, r) = [(1, 2), (0, 2), (0, 1)][p];
    let (lq, lr) = (a[3 * q] / a[3 * p], a[3 * r] / a[3 * p]);
    for j in 1..3 {
        a[3 * q + j] -= lq * a[3 * p + j];
        a[3 * r + j] -= lr * a[3 * p + j];
    }
    b[q] -= lq * b[p];
    b[r] -= lr * b[p];
    let (q, r) = if a[3 * r + 1].abs() > a[3 * q + 1].abs() { (r, q) } else { (q, r) };
    if a[3 * q + 1].abs() <= TINY * largest[0] {
        return Err(q);
    }
    let l = a[3 * r + 1] / a[3 * q + 1];
    let pivot = a[3 * r + 2] - l * a[3 * q + 2];
    if pivot.abs() <= TINY * largest[1] {
        return Err(r);
    }
    let z = (b[r] - l * b[q]) / pivot;
    let y = (b[q] - a[3 * q + 2] * z) / a[3 * q + 1];
    let x = (b[p] - a[3 * p + 1] * y - a[3 * p + 2] * z) / a[3 * p];
    b[0] = x;
    b[1] = y;
    b[2] = z;
    Ok(())
}

/// Any number of unknowns.
fn general(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch) -> Result<(), usize> {
    let order = &mut scratch.order[..n];
    let column = &mut scratch.column[..n];
    column.fill(0.0);
    for (i, (row, b)) in a.chunks_exact_mut(n).zip(b.iter_mut()).enumerate() {
        order[i] = i;
        let largest = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if largest == 0.0 {
            return Err(i);
        }
        let scale = inverse_scale(largest);
        *b *= scale;
        for (x, c) in row.iter_mut().zip(column.iter_mut()) {
            *x *= scale;
            *c = c.max(x.abs());
        }
    }
    for k in 0..n {
        let mut p = k;
        for i in k + 1..n {
            if a[i * n + k].abs() > a[p * n + k].abs() {
                p = i;
            }
        }
        if a[p * n + k].abs() <= TINY * column[k] {
            return Err(order[k]);
        }
        let (upper, lower) = a.split_at_mut((k + 1) * n);
        let pivot_row = &mut upper[k * n..];
        if p > k {
            let other = (p - k - 1) * n;
            pivot_row[k..n].swap_with_slice(&mut lower[other + k..other + n]);
            b.swap(k, p);
            order.swap(k, p);
        }
        let pivot = pivot_row[k];
        let tail = &pivot_row[k + 1..n];
        let bk = b[k];
        for (row, b) in lower.chunks_exact_mut(n).zip(b[k + 1..].iter_mut()) {
            if row[k] == 0.0 {
                continue;
            }
            let l = row[k] / pivot;
            for (x, u) in row[k + 1..].iter_mut().zip(tail) {
                *x -= l * u;
            }
            *b -= l * bk;
        }
    }
    for k in (0..n).rev() {
        let row = &a[k * n..(k + 1) * n];
        let sum: f64 = row[k + 1..].iter().zip(&b[k + 1..]).map(|(a, x)| a * x).sum();
        b[k] = (b[k] - sum) / row[k];
    }
    Ok(())
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
