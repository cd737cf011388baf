//! The meaning of the scalar operations: the functions that the rows of `ir/op.rs` name.
//!
//! The interpreter and the folding of constants call them; every other back end is tested against them. They
//! are deterministic to the bit: no fused multiply-add, fixed orders of multiplication, and transcendental functions in
//! Rust, none of the system's. Exponentials and logarithms are `pxfm`'s, which rounds them correctly; the others are
//! the crate `libm`'s, good to a unit in the last place, in a half to a fifth of the time that correct rounding takes
//! where a fused multiply-add cannot be counted on.
//!
//! A value counts as true where it is not 0; NaN is not 0.

pub(crate) mod functions;

use crate::ir::{Binary, Unary};

/// The largest exponent, in magnitude, for which a power is a product.
pub const PRODUCT_LIMIT: u32 = 64;

/// An exponent for which a power is products and a root: `±(whole + 1/2 if half)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exponent {
    /// The whole part of the magnitude.
    pub whole: u32,
    /// Whether a half is added to it.
    pub half: bool,
    /// Whether the exponent is negative.
    pub inverse: bool,
}

impl Exponent {
    /// The parts of `b`, where it is an integer or a half-integer of magnitude at most [`PRODUCT_LIMIT`].
    pub fn of(b: f64) -> Option<Self> {
        let magnitude = b.abs();
        let twice = magnitude + magnitude;
        if twice <= f64::from(2 * PRODUCT_LIMIT) && twice == twice.trunc() {
            let twice = twice as u32;
            Some(Self { whole: twice / 2, half: twice % 2 == 1, inverse: b < 0.0 })
        } else {
            None
        }
    }

    /// `a` to this exponent.
    ///
    /// In this order: squares of `a`, multiplied up from the lowest bit of `whole`; with a half, times `sqrt(a + 0)`
    /// (the sum turns -0 into 0); with a negative exponent, 1 divided by all that.
    pub fn power(self, a: f64) -> f64 {
        let mut product: Option<f64> = None;
        let mut square = a;
        let mut bits = self.whole;
        while bits > 0 {
            if bits & 1 == 1 {
                product = Some(product.map_or(square, |p| p * square));
            }
            bits >>= 1;
            if bits > 0 {
                square *= square;
            }
        }
        if self.half {
            let root = (a + 0.0).sqrt();
            product = Some(product.map_or(root, |p| p * root));
        }
        let product = product.unwrap_or(1.0);
        if self.inverse { 1.0 / product } else { product }
    }
}

/// Sine and cosine of a number, each to the bit what [`unary`] gives.
#[inline]
pub fn turn(a: f64) -> (f64, f64) {
    libm::sincos(a)
}

/// A function of one value.
#[inline]
pub fn unary(f: Unary, a: f64) -> f64 {
    f.value(a)
}

/// A function of two values.
#[inline]
pub fn binary(f: Binary, a: f64, b: f64) -> f64 {
    f.value(a, b)
}

/// `a` where `c` is not 0, else `b`. NaN is not 0.
#[inline]
pub fn select(c: f64, a: f64, b: f64) -> f64 {
    if c != 0.0 { a } else { b }
}

/// A power of two near `1 / x`, so that scaling with it rounds nothing; 1 where `x` is 0 or not finite. `x` is not
/// below 0.
pub fn inverse_scale(x: f64) -> f64 {
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

    const SPECIALS: [f64; 9] =
        [0.0, -0.0, 1.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, f64::MIN_POSITIVE, 1e300];

    /// Equal to the bit, any NaN being equal to any other.
    fn same(a: f64, b: f64) -> bool {
        a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
    }

    #[test]
    fn turns_are_sines_and_cosines() {
        let mut random = crate::solve::testing::Random::new(11);
        let numbers = (0..200_000).map(|k| random.next() * f64::from(k % 64 - 40).exp2() * 7.0);
        for x in SPECIALS.into_iter().chain(numbers) {
            let (sine, cosine) = turn(x);
            assert!(same(sine, unary(Unary::Sin, x)) && same(cosine, unary(Unary::Cos, x)), "{x:e}");
        }
    }

    #[test]
    fn sign_of_zeros_is_zero() {
        assert!(same(unary(Unary::Sign, 0.0), 0.0));
        assert!(same(unary(Unary::Sign, -0.0), 0.0));
        assert!(unary(Unary::Sign, f64::NAN).is_nan());
        assert_eq!(unary(Unary::Sign, -1e-310), -1.0);
        assert_eq!(unary(Unary::Sign, f64::INFINITY), 1.0);
    }

    #[test]
    fn min_and_max_carry_nan_and_order_zeros() {
        for x in SPECIALS {
            for f in [Binary::Min, Binary::Max] {
                assert!(binary(f, x, f64::NAN).is_nan());
                assert!(binary(f, f64::NAN, x).is_nan());
                assert!(same(binary(f, x, x), x));
            }
        }
        assert!(same(binary(Binary::Min, 0.0, -0.0), -0.0));
        assert!(same(binary(Binary::Min, -0.0, 0.0), -0.0));
        assert!(same(binary(Binary::Max, -0.0, 0.0), 0.0));
        assert!(same(binary(Binary::Max, 0.0, -0.0), 0.0));
        assert_eq!(binary(Binary::Max, f64::NEG_INFINITY, 3.0), 3.0);
    }

    #[test]
    fn truth_is_one_or_zero() {
        for a in SPECIALS {
            for b in SPECIALS {
                for f in [Binary::Lt, Binary::Le, Binary::Eq, Binary::And, Binary::Or] {
                    let t = binary(f, a, b);
                    assert!(same(t, 0.0) || same(t, 1.0));
                }
                if a.is_nan() || b.is_nan() {
                    for f in [Binary::Lt, Binary::Le, Binary::Eq] {
                        assert_eq!(binary(f, a, b), 0.0);
                    }
                }
            }
        }
        assert_eq!(unary(Unary::Not, -0.0), 1.0);
        assert_eq!(unary(Unary::Not, f64::NAN), 0.0);
        assert_eq!(select(-0.0, 1.0, 2.0), 2.0);
        assert_eq!(select(f64::NAN, 1.0, 2.0), 1.0);
    }

    #[test]
    fn transcendentals_at_specials() {
        // `std` follows the C standard's annex F at these points.
        type Function = fn(f64) -> f64;
        let pairs: [(Unary, Function); 14] = [
            (Unary::Abs, f64::abs),
            (Unary::Sqrt, f64::sqrt),
            (Unary::Exp, f64::exp),
            (Unary::Log, f64::ln),
            (Unary::Sin, f64::sin),
            (Unary::Cos, f64::cos),
            (Unary::Tan, f64::tan),
            (Unary::Asin, f64::asin),
            (Unary::Acos, f64::acos),
            (Unary::Atan, f64::atan),
            (Unary::Sinh, f64::sinh),
            (Unary::Cosh, f64::cosh),
            (Unary::Tanh, f64::tanh),
            (Unary::Neg, |x| -x),
        ];
        let mut points = SPECIALS.to_vec();
        points.extend([0.5, -0.5, 2.0, -2.0, 709.0, 711.0, -746.0, 1e-320, 1e-9, 25.0, 1e5]);
        for (f, reference) in pairs {
            for &x in &points {
                let (ours, theirs) = (unary(f, x), reference(x));
                let close = same(ours, theirs)
                    || ((ours - theirs).abs() <= 4e-16 * theirs.abs()
                        && ours.is_sign_negative() == theirs.is_sign_negative())
                    || (f == Unary::Asin && (ours - theirs).abs() <= 4e-16 * theirs.abs());
                assert!(close, "{f:?}({x:e}) = {ours:e}, expected {theirs:e}");
            }
        }
        for a in SPECIALS {
            for b in SPECIALS {
                let (ours, theirs) = (binary(Binary::Atan2, a, b), a.atan2(b));
                assert!(
                    same(ours, theirs) || (ours - theirs).abs() <= 4e-16 * theirs.abs(),
                    "atan2({a:e}, {b:e}) {ours:e} {theirs:e}"
                );
            }
        }
    }

    #[test]
    fn powers() {
        let p = |a, b| binary(Binary::Pow, a, b);
        assert_eq!(p(3.0, 4.0), 81.0);
        assert_eq!(p(3.0, 5.0).to_bits(), (3.0 * 81.0f64).to_bits());
        assert_eq!(p(2.0, -3.0), 0.125);
        assert_eq!(p(4.0, 0.5), 2.0);
        assert_eq!(p(4.0, 1.5), 8.0);
        assert_eq!(p(4.0, -0.5), 0.5);
        assert_eq!(p(f64::NAN, 0.0), 1.0);
        assert_eq!(p(0.0, 0.0), 1.0);
        assert!(same(p(-0.0, 0.5), 0.0));
        assert!(same(p(-0.0, 3.0), -0.0));
        assert_eq!(p(0.0, -1.0), f64::INFINITY);
        assert!(p(-1.0, 0.5).is_nan());
        assert!(p(-2.0, 0.3).is_nan());
        assert_eq!(p(1.0, f64::NAN), 1.0);
        assert_eq!(p(2.0, f64::INFINITY), f64::INFINITY);
        assert_eq!(p(2.0, f64::NEG_INFINITY), 0.0);
        for a in [0.3, 1.7, 12.0] {
            for b in [-2.5, -1.0, 0.1, 1.5, 2.0, 3.7, 20.0, 63.5, 100.0] {
                let (ours, theirs) = (p(a, b), f64::powf(a, b));
                assert!((ours - theirs).abs() <= 2e-14 * theirs, "{a}^{b}");
            }
        }
    }

    #[test]
    fn scales_are_inverse_powers_of_two() {
        for x in [1.0, 1.5, 3e300, 2e-308, f64::MAX, 7e-200] {
            let s = inverse_scale(x);
            assert!(s > 0.0 && s.is_finite() && (0.4..4.1).contains(&(x * s)), "{x:e} {s:e}");
        }
        assert_eq!(inverse_scale(0.0), 1.0);
        assert_eq!(inverse_scale(f64::INFINITY), 1.0);
    }
}
