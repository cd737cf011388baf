//! Power series of functions of a power series, by their recurrences (Knuth, The Art of Computer Programming 2, 4.7).

use super::Number;
use super::eval::ROUNDING;
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};

/// Coefficients from the constant on.
pub(crate) type Series = Vec<f64>;

/// Gives the sign that a series has on its side of 0, and bounds the radius by where it keeps it.
pub(super) type Leads<'a> = &'a mut dyn FnMut(&[f64]) -> f64;

/// The series of a constant.
pub(super) fn constant(x: f64, count: usize) -> Series {
    let mut series = vec![0.0; count];
    series[0] = x;
    series
}

/// A sum, 0 where only rounding is left of its terms.
pub(super) fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut total, mut size) = (0.0, 0.0);
    for x in terms {
        total += x;
        size += f64::abs(x);
    }
    if f64::abs(total) <= ROUNDING * size { 0.0 } else { total }
}

pub(super) fn product(a: &[f64], b: &[f64]) -> Series {
    (0..a.len()).map(|k| sum((0..=k).map(|j| a[j] * b[k - j]))).collect()
}

/// `a^n`; `None` of 0 to a negative power, and of what is not above 0 to a broken one.
pub(super) fn power(a: &[f64], n: Number) -> Option<Series> {
    if let Some(n) = n.integer().filter(|n| (0..=64).contains(n)) {
        return Some((0..n).fold(constant(1.0, a.len()), |p, _| product(&p, a)));
    }
    let first = a[0];
    if first == 0.0 || (first < 0.0 && n.integer().is_none()) {
        return None;
    }
    let n = n.to_f64();
    let mut p = constant(eval::binary(Binary::Pow, first, n), a.len());
    for k in 1..a.len() {
        let all = (1..=k).map(|j| (n * j as f64 - (k - j) as f64) * a[j] * p[k - j]);
        p[k] = sum(all) / (k as f64 * first);
    }
    Some(p)
}

pub(super) fn exponential(u: &[f64]) -> Series {
    let mut p = constant(eval::unary(Unary::Exp, u[0]), u.len());
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * p[k - j])) / k as f64;
    }
    p
}

pub(super) fn logarithm(u: &[f64]) -> Option<Series> {
    if u[0] <= 0.0 {
        return None;
    }
    let mut p = constant(eval::unary(Unary::Log, u[0]), u.len());
    for k in 1..u.len() {
        let all = (1..k).map(|j| -(j as f64) * p[j] * u[k - j] / k as f64);
        p[k] = sum(all.chain([u[k]])) / u[0];
    }
    Some(p)
}

/// Sine and cosine with the sign -1, their hyperbolic ones with 1.
pub(super) fn sine_and_cosine(u: &[f64], sign: f64) -> (Series, Series) {
    let (sin, cos) = if sign < 0.0 { (Unary::Sin, Unary::Cos) } else { (Unary::Sinh, Unary::Cosh) };
    let (sin, cos) = (eval::unary(sin, u[0]), eval::unary(cos, u[0]));
    let (mut s, mut c) = (constant(sin, u.len()), constant(cos, u.len()));
    for k in 1..u.len() {
        s[k] = sum((1..=k).map(|j| j as f64 * u[j] * c[k - j])) / k as f64;
        c[k] = sign * sum((1..=k).map(|j| j as f64 * u[j] * s[k - j])) / k as f64;
    }
    (s, c)
}

/// The tangent with the sign 1, the hyperbolic one with -1: the slope is 1 + sign p^2.
pub(super) fn tangent(u: &[f64], sign: f64) -> Series {
    let first = eval::unary(if sign > 0.0 { Unary::Tan } else { Unary::Tanh }, u[0]);
    let (mut p, mut slope) = (constant(first, u.len()), constant(1.0 + sign * first * first, u.len()));
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * slope[k - j])) / k as f64;
        slope[k] = sign * sum((0..=k).map(|j| p[j] * p[k - j]));
    }
    p
}

/// `1 + sign u^2`
pub(super) fn one_plus_square(u: &[f64], sign: f64) -> Series {
    let mut series: Series = product(u, u).iter().map(|x| sign * x).collect();
    series[0] += 1.0;
    series
}

/// `1/sqrt(1 - u^2)`
pub(super) fn inverse_root(u: &[f64]) -> Option<Series> {
    power(&one_plus_square(u, -1.0), Number::ratio(-1, 2))
}

/// `f(u)`, whose derivative by `u` is `slope`.
pub(super) fn integral(f: Unary, u: &[f64], slope: &[f64]) -> Series {
    let mut p = constant(eval::unary(f, u[0]), u.len());
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * slope[k - j])) / k as f64;
    }
    p
}
