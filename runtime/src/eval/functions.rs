//! What the scalar operations compute that are neither instructions nor functions of a library.

use super::Exponent;

/// 1 or 0.
#[inline]
fn truth(holds: bool) -> f64 {
    if holds { 1.0 } else { 0.0 }
}

#[inline]
pub(crate) fn not(a: f64) -> f64 {
    truth(a == 0.0)
}

#[inline]
pub(crate) fn less(a: f64, b: f64) -> f64 {
    truth(a < b)
}

#[inline]
pub(crate) fn less_or_equal(a: f64, b: f64) -> f64 {
    truth(a <= b)
}

#[inline]
pub(crate) fn equal(a: f64, b: f64) -> f64 {
    truth(a == b)
}

#[inline]
pub(crate) fn and(a: f64, b: f64) -> f64 {
    truth(a != 0.0 && b != 0.0)
}

#[inline]
pub(crate) fn or(a: f64, b: f64) -> f64 {
    truth(a != 0.0 || b != 0.0)
}

/// -1, 0 or 1; 0 for either zero; NaN for NaN.
#[inline]
pub(crate) fn sign(a: f64) -> f64 {
    if a > 0.0 {
        1.0
    } else if a < 0.0 {
        -1.0
    } else if a == 0.0 {
        0.0
    } else {
        a
    }
}

/// The smaller, where -0 is smaller than 0; NaN if either is.
#[inline]
pub(crate) fn min(a: f64, b: f64) -> f64 {
    if a < b {
        a
    } else if b < a {
        b
    } else if a == b {
        f64::from_bits(a.to_bits() | b.to_bits())
    } else {
        a + b
    }
}

/// The larger, where 0 is larger than -0; NaN if either is.
#[inline]
pub(crate) fn max(a: f64, b: f64) -> f64 {
    if a > b {
        a
    } else if b > a {
        b
    } else if a == b {
        f64::from_bits(a.to_bits() & b.to_bits())
    } else {
        a + b
    }
}

/// The hyperbolic sine; that of -0 is -0, which `pxfm` loses.
#[inline]
pub(crate) fn sinh(a: f64) -> f64 {
    if a == 0.0 { a } else { pxfm::f_sinh(a) }
}

/// `a^b`: 1 for `a = 1` and any `b`; a product or a root where [`Exponent::of`] knows the exponent, else `libm`'s.
pub(crate) fn pow(a: f64, b: f64) -> f64 {
    match Exponent::of(b) {
        Some(e) => e.power(a),
        None if a == 1.0 => 1.0,
        None => libm::pow(a, b),
    }
}
