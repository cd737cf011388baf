//! Numbers: exact rationals as long as they fit, floating point beyond.

use std::cmp::Ordering;
use std::hash::{Hash, Hasher};

/// A number of an expression. Made by the functions below, so that equal values have one form:
/// ratios are reduced with a positive denominator, floats that are short decimals or binary fractions are ratios.
#[derive(Clone, Copy, Debug)]
pub enum Number {
    /// Numerator and denominator: coprime, the denominator positive, neither `i64::MIN`.
    Ratio(i64, i64),
    /// Anything else, infinities and NaN included.
    Float(f64),
}

impl PartialEq for Number {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Number::Ratio(a, b), Number::Ratio(c, d)) => a == c && b == d,
            (Number::Float(x), Number::Float(y)) => x.to_bits() == y.to_bits(),
            (Number::Ratio(..), Number::Float(_)) | (Number::Float(_), Number::Ratio(..)) => false,
        }
    }
}

impl Eq for Number {}

impl Hash for Number {
    fn hash<H: Hasher>(&self, state: &mut H) {
        match self {
            Number::Ratio(a, b) => (a, b).hash(state),
            Number::Float(x) => x.to_bits().hash(state),
        }
    }
}

impl From<i64> for Number {
    fn from(i: i64) -> Self {
        Number::ratio(i, 1)
    }
}

/// Decimals with more digits are taken for doubles that were written out.
const DIGITS: usize = 12;

fn gcd(mut a: u128, mut b: u128) -> u128 {
    if let (Ok(mut a), Ok(mut b)) = (u64::try_from(a), u64::try_from(b)) {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        return u128::from(a);
    }
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The root of a perfect power.
fn exact_root(n: u64, degree: u32) -> Option<u64> {
    let guess = libm::pow(n as f64, 1.0 / f64::from(degree)).round() as u64;
    (guess.saturating_sub(1)..=guess + 1).find(|r| r.checked_pow(degree) == Some(n))
}

impl Number {
    /// 0
    pub const ZERO: Number = Number::Ratio(0, 1);
    /// 1
    pub const ONE: Number = Number::Ratio(1, 1);
    /// -1
    pub const MINUS_ONE: Number = Number::Ratio(-1, 1);
    /// 1/2
    pub const HALF: Number = Number::Ratio(1, 2);

    /// A fraction, reduced. Division by 0 gives an infinity or NaN.
    pub fn ratio(n: i64, d: i64) -> Number {
        Self::exact(i128::from(n), i128::from(d))
    }

    fn exact(n: i128, d: i128) -> Number {
        if d == 1
            && let Ok(n) = i64::try_from(n)
            && n != i64::MIN
        {
            return Number::Ratio(n, 1);
        }
        if d == 0 {
            return Number::Float(n as f64 / 0.0);
        }
        // Those have no opposite.
        if n == i128::MIN || d == i128::MIN {
            return Self::float(n as f64 / d as f64);
        }
        let g = gcd(n.unsigned_abs(), d.unsigned_abs()).max(1) as i128;
        let (n, d) = if d < 0 { (-n / g, -d / g) } else { (n / g, d / g) };
        match (i64::try_from(n), i64::try_from(d)) {
            (Ok(n), Ok(d)) if n != i64::MIN => Number::Ratio(n, d),
            (Ok(_) | Err(_), Ok(_) | Err(_)) => Self::float(n as f64 / d as f64),
        }
    }

    /// A floating-point number; integers, short binary fractions and decimals of up to 12 digits become exact.
    pub fn float(x: f64) -> Number {
        if x.is_nan() {
            return Number::Float(f64::NAN);
        }
        const LARGEST: f64 = 9_007_199_254_740_992.0;
        for shift in [0, 10, 20] {
            let scale = (1_i64 << shift) as f64;
            let n = x * scale;
            if n.abs() > LARGEST {
                break;
            }
            if n == n.trunc() {
                return Self::ratio(n as i64, 1 << shift);
            }
        }
        Self::short_decimal(&format!("{x:e}")).unwrap_or(Number::Float(x))
    }

    /// A decimal as it is written, `0.5` or `1.5e3`; exact where it fits and has at most 12 digits, else the nearest
    /// double. `None` if it is no number.
    pub fn decimal(digits: &str) -> Option<Number> {
        let value: f64 = digits.parse().ok()?;
        Some(Self::short_decimal(digits).unwrap_or_else(|| Self::float(value)))
    }

    fn short_decimal(digits: &str) -> Option<Number> {
        let (mantissa, exponent) = digits.split_once(['e', 'E']).unwrap_or((digits, "0"));
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let fraction = fraction.trim_end_matches('0');
        let digits = format!("{whole}{fraction}");
        if digits.trim_start_matches(['0', '-']).trim_end_matches('0').len() > DIGITS {
            return None;
        }
        let n: i128 = digits.parse().ok()?;
        let e = exponent.parse::<i32>().ok()?.checked_sub(i32::try_from(fraction.len()).ok()?)?;
        let power = 10_i128.checked_pow(e.unsigned_abs())?;
        let (n, d) = if e >= 0 { (n.checked_mul(power)?, 1) } else { (n, power) };
        let g = i128::try_from(gcd(n.unsigned_abs(), d.unsigned_abs())).ok()?.max(1);
        (i64::try_from(n / g).is_ok() && i64::try_from(d / g).is_ok()).then(|| Self::exact(n, d))
    }

    /// Whether it is a ratio.
    pub fn is_exact(self) -> bool {
        match self {
            Number::Ratio(..) => true,
            Number::Float(_) => false,
        }
    }

    /// The integer it is, if it is one.
    pub fn integer(self) -> Option<i64> {
        match self {
            Number::Ratio(n, 1) => Some(n),
            Number::Ratio(..) | Number::Float(_) => None,
        }
    }

    /// The nearest double.
    pub fn to_f64(self) -> f64 {
        const EXACT: u64 = 1 << 53;
        match self {
            Number::Float(x) => x,
            Number::Ratio(n, d) if n.unsigned_abs() <= EXACT && d.unsigned_abs() <= EXACT => n as f64 / d as f64,
            Number::Ratio(n, d) => {
                // the quotient to at least 65 bits, the lowest bit standing for all that follow
                let n_abs = u128::from(n.unsigned_abs());
                let shift = n_abs.leading_zeros();
                let (n_abs, d) = (n_abs << shift, u128::from(d.unsigned_abs()));
                let sticky = u128::from(!n_abs.is_multiple_of(d));
                let q = ((n_abs / d) | sticky) as f64 * 2.0_f64.powi(-(shift as i32));
                if n < 0 { -q } else { q }
            }
        }
    }

    /// Whether it is 0.
    pub fn is_zero(self) -> bool {
        self == Self::ZERO
    }

    /// Whether it is 1.
    pub fn is_one(self) -> bool {
        self == Self::ONE
    }

    /// Whether it is below 0.
    pub fn is_negative(self) -> bool {
        match self {
            Number::Ratio(n, _) => n < 0,
            Number::Float(x) => x < 0.0,
        }
    }

    /// Whether it is above 0.
    pub fn is_positive(self) -> bool {
        match self {
            Number::Ratio(n, _) => n > 0,
            Number::Float(x) => x > 0.0,
        }
    }

    /// The least whole number by which some numbers are whole, where doubles have all of these.
    pub(super) fn denominator(numbers: impl IntoIterator<Item = Number>) -> Option<i64> {
        const EXACT: i128 = 1 << 53;
        numbers
            .into_iter()
            .try_fold((1i128, 0i128), |(all, most), n| {
                let Number::Ratio(n, d) = n else { return None };
                let (n, d) = (i128::from(n.abs()), i128::from(d));
                let common = all / gcd(all.unsigned_abs(), d.unsigned_abs()) as i128 * d;
                // The largest of the numbers, rounded up.
                let most = most.max(n / d + 1);
                (common <= EXACT && most * common <= EXACT).then_some((common, most))
            })
            .and_then(|(all, _)| i64::try_from(all).ok())
    }

    /// Whether it is neither infinite nor NaN.
    pub fn is_finite(self) -> bool {
        match self {
            Number::Ratio(..) => true,
            Number::Float(x) => x.is_finite(),
        }
    }

    /// The number without its sign.
    pub fn abs(self) -> Number {
        if self.is_negative() { -self } else { self }
    }

    /// 1 over it.
    pub fn recip(self) -> Number {
        match self {
            Number::Ratio(n, d) => Self::ratio(d, n),
            Number::Float(x) => Self::float(1.0 / x),
        }
    }

    /// Its integer power.
    pub fn powi(self, n: i64) -> Number {
        let exact = |base: i64| u32::try_from(n.unsigned_abs()).ok().and_then(|n| i128::from(base).checked_pow(n));
        if let Number::Ratio(a, b) = self
            && let (Some(a), Some(b)) = (exact(a), exact(b))
        {
            return if n >= 0 { Self::exact(a, b) } else { Self::exact(b, a) };
        }
        Self::float(bond_runtime::eval::binary(bond_runtime::ir::Binary::Pow, self.to_f64(), n as f64))
    }

    /// Its power where that is exact.
    pub fn exact_power(self, exponent: Number) -> Option<Number> {
        let (Number::Ratio(a, b), Number::Ratio(n, d)) = (self, exponent) else { return None };
        if d == 1 {
            return Some(self.powi(n)).filter(|p| p.is_exact());
        }
        let degree = u32::try_from(d).ok()?;
        let a = exact_root(u64::try_from(a).ok()?, degree)?;
        let b = exact_root(u64::try_from(b).ok()?, degree)?;
        let root = Self::ratio(i64::try_from(a).ok()?, i64::try_from(b).ok()?);
        Some(root.powi(n)).filter(|p| p.is_exact())
    }

    /// Its power, exact where it can be.
    pub fn pow(self, exponent: Number) -> Number {
        self.exact_power(exponent).unwrap_or_else(|| match exponent.integer() {
            Some(n) => self.powi(n),
            None => {
                Self::float(bond_runtime::eval::binary(bond_runtime::ir::Binary::Pow, self.to_f64(), exponent.to_f64()))
            }
        })
    }

    /// Whether its size is a power of two.
    pub(super) fn is_binary(self) -> bool {
        match self {
            Number::Ratio(n, d) => n.unsigned_abs().is_power_of_two() && d.unsigned_abs().is_power_of_two(),
            Number::Float(_) => false,
        }
    }

    /// Order by value; NaN equals everything.
    pub fn compare(self, other: Number) -> Ordering {
        match (self, other) {
            (Number::Ratio(a, b), Number::Ratio(c, d)) => {
                (i128::from(a) * i128::from(d)).cmp(&(i128::from(c) * i128::from(b)))
            }
            (Number::Ratio(..) | Number::Float(_), Number::Ratio(..) | Number::Float(_)) => {
                self.to_f64().partial_cmp(&other.to_f64()).unwrap_or(Ordering::Equal)
            }
        }
    }
}

impl std::ops::Neg for Number {
    type Output = Number;
    fn neg(self) -> Number {
        match self {
            Number::Ratio(n, d) => Number::Ratio(-n, d),
            Number::Float(x) => Number::float(-x),
        }
    }
}

impl std::ops::Add for Number {
    type Output = Number;
    fn add(self, other: Number) -> Number {
        if self.is_zero() {
            return other;
        }
        if other.is_zero() {
            return self;
        }
        if let (Number::Ratio(a, b), Number::Ratio(c, d)) = (self, other) {
            let [a, b, c, d] = [a, b, c, d].map(i128::from);
            // each product is below 2^126, so is their sum below 2^127
            return Number::exact(a * d + c * b, b * d);
        }
        Number::float(self.to_f64() + other.to_f64())
    }
}

impl std::ops::Mul for Number {
    type Output = Number;
    fn mul(self, other: Number) -> Number {
        if self.is_one() {
            return other;
        }
        if other.is_one() {
            return self;
        }
        if let (Number::Ratio(a, b), Number::Ratio(c, d)) = (self, other) {
            return Number::exact(i128::from(a) * i128::from(c), i128::from(b) * i128::from(d));
        }
        Number::float(self.to_f64() * other.to_f64())
    }
}
