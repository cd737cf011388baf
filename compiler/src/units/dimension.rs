//! Dimensions: exponents of the seven base units.

use std::fmt;

/// A rational exponent, reduced, with a positive denominator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Exponent {
    above: i16,
    below: i16,
}

impl Exponent {
    const ZERO: Exponent = Exponent { above: 0, below: 1 };

    const fn whole(n: i16) -> Exponent {
        Exponent { above: n, below: 1 }
    }

    /// Reduced; exponents beyond `i16` are cut off there, which no unit of a model comes near to.
    fn new(above: i64, below: i64) -> Exponent {
        let (mut a, mut b) = (above.unsigned_abs(), below.unsigned_abs());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let g = i64::try_from(a.max(1)).unwrap_or(1) * if below < 0 { -1 } else { 1 };
        let cut = |x: i64, least: i16| x.clamp(i64::from(least), i64::from(i16::MAX)) as i16;
        Exponent { above: cut(above / g, -i16::MAX), below: cut(below / g, 1) }
    }

    fn add(self, other: Exponent) -> Exponent {
        let [a, b, c, d] = [self.above, self.below, other.above, other.below].map(i64::from);
        Exponent::new(a * d + c * b, b * d)
    }

    fn times(self, above: i32, below: i32) -> Exponent {
        Exponent::new(i64::from(self.above) * i64::from(above), i64::from(self.below) * i64::from(below))
    }
}

impl fmt::Display for Exponent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exponent { above, below: 1 } => write!(f, "{above}"),
            Exponent { above, below } => write!(f, "({above}/{below})"),
        }
    }
}

/// What kind of quantity something is: kg, m, s, A, K, mol and cd to rational powers.
///
/// Angles have none: `rad` is 1, so that a torque and an energy have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Dimension([Exponent; 7]);

/// The symbols of the base units, in the order of the exponents and of printing.
const BASE: [&str; 7] = ["kg", "m", "s", "A", "K", "mol", "cd"];

#[expect(missing_docs, reason = "the names say it")]
impl Dimension {
    pub const DIMENSIONLESS: Dimension = Dimension([Exponent::ZERO; 7]);
    pub const KILOGRAM: Dimension = Dimension::of([1, 0, 0, 0, 0, 0, 0]);
    pub const METRE: Dimension = Dimension::of([0, 1, 0, 0, 0, 0, 0]);
    pub const SECOND: Dimension = Dimension::of([0, 0, 1, 0, 0, 0, 0]);
    pub const AMPERE: Dimension = Dimension::of([0, 0, 0, 1, 0, 0, 0]);
    pub const KELVIN: Dimension = Dimension::of([0, 0, 0, 0, 1, 0, 0]);
    pub const MOLE: Dimension = Dimension::of([0, 0, 0, 0, 0, 1, 0]);
    pub const CANDELA: Dimension = Dimension::of([0, 0, 0, 0, 0, 0, 1]);
    pub const HERTZ: Dimension = Dimension::of([0, 0, -1, 0, 0, 0, 0]);
    pub const NEWTON: Dimension = Dimension::of([1, 1, -2, 0, 0, 0, 0]);
    pub const JOULE: Dimension = Dimension::of([1, 2, -2, 0, 0, 0, 0]);
    pub const WATT: Dimension = Dimension::of([1, 2, -3, 0, 0, 0, 0]);
    pub const PASCAL: Dimension = Dimension::of([1, -1, -2, 0, 0, 0, 0]);
    pub const VOLT: Dimension = Dimension::of([1, 2, -3, -1, 0, 0, 0]);
    pub const OHM: Dimension = Dimension::of([1, 2, -3, -2, 0, 0, 0]);
    pub const SIEMENS: Dimension = Dimension::of([-1, -2, 3, 2, 0, 0, 0]);
    pub const FARAD: Dimension = Dimension::of([-1, -2, 4, 2, 0, 0, 0]);
    pub const HENRY: Dimension = Dimension::of([1, 2, -2, -2, 0, 0, 0]);
    pub const COULOMB: Dimension = Dimension::of([0, 0, 1, 1, 0, 0, 0]);
    pub const WEBER: Dimension = Dimension::of([1, 2, -2, -1, 0, 0, 0]);
    pub const TESLA: Dimension = Dimension::of([1, 0, -2, -1, 0, 0, 0]);
    pub const AREA: Dimension = Dimension::of([0, 2, 0, 0, 0, 0, 0]);
    pub const VOLUME: Dimension = Dimension::of([0, 3, 0, 0, 0, 0, 0]);
    pub const KATAL: Dimension = Dimension::of([0, 0, -1, 0, 0, 1, 0]);
    pub const LUX: Dimension = Dimension::of([0, -2, 0, 0, 0, 0, 1]);
    pub const GRAY: Dimension = Dimension::of([0, 2, -2, 0, 0, 0, 0]);
}

impl Dimension {
    const fn of(e: [i16; 7]) -> Dimension {
        let mut all = [Exponent::ZERO; 7];
        let mut i = 0;
        while i < 7 {
            all[i] = Exponent::whole(e[i]);
            i += 1;
        }
        Dimension(all)
    }

    /// Of a product.
    #[expect(clippy::should_implement_trait, reason = "reads as `pow` and `sqrt` do, and needs no import")]
    pub fn mul(self, other: Dimension) -> Dimension {
        Dimension(std::array::from_fn(|i| self.0[i].add(other.0[i])))
    }

    /// Of a quotient.
    #[expect(clippy::should_implement_trait, reason = "reads as `pow` and `sqrt` do, and needs no import")]
    pub fn div(self, other: Dimension) -> Dimension {
        self.mul(other.pow(-1, 1))
    }

    /// Of a power with the exponent `above/below`; a denominator of 0 counts as 1.
    pub fn pow(self, above: i32, below: i32) -> Dimension {
        let below = if below == 0 { 1 } else { below };
        Dimension(self.0.map(|e| e.times(above, below)))
    }

    /// The exponents of kg, m, s, A, K, mol and cd, times some numbers, in sum: a whole number, or the one below.
    pub(super) fn dot(self, with: [i32; 7]) -> i32 {
        let terms = self.0.iter().zip(with).map(|(e, k)| e.times(k, 1));
        let sum = terms.fold(Exponent::ZERO, Exponent::add);
        i32::from(sum.above).div_euclid(i32::from(sum.below))
    }

    /// Of the square root.
    pub fn sqrt(self) -> Dimension {
        self.pow(1, 2)
    }

    /// Whether it is none.
    pub fn is_one(self) -> bool {
        self == Dimension::DIMENSIONLESS
    }

    /// The exponents with the symbols of the base units, where all are whole.
    pub fn whole(self) -> Option<[(&'static str, i16); 7]> {
        let whole = self.0.iter().all(|e| e.below == 1);
        whole.then(|| std::array::from_fn(|i| (BASE[i], self.0[i].above)))
    }

    /// The first base unit that it is divided by, with its power, as `s^-1`, and what it is without that.
    pub(super) fn first_divisor(self) -> Option<(String, Dimension)> {
        let i = self.0.iter().position(|e| e.above < 0)?;
        let mut rest = self;
        rest.0[i] = Exponent::ZERO;
        Some((format!("{}^{}", BASE[i], self.0[i]), rest))
    }

    /// How many symbols it takes to write it in base units; None where a power is no whole number.
    pub(super) fn length(self) -> Option<u16> {
        self.whole().map(|all| all.iter().map(|(_, e)| e.unsigned_abs()).sum())
    }

    /// The powers of the base units, as a product: `kg*m^2/s^3`.
    pub(super) fn product(self) -> String {
        let side = |positive: bool| -> Vec<String> {
            let mut all = Vec::new();
            for (e, name) in self.0.into_iter().zip(BASE) {
                if e.above != 0 && (e.above > 0) == positive {
                    let size = Exponent { above: e.above.abs(), below: e.below };
                    all.push(if size == Exponent::whole(1) { name.to_string() } else { format!("{name}^{size}") });
                }
            }
            all
        };
        let (above, below) = (side(true), side(false));
        let mut text = if above.is_empty() { "1".to_string() } else { above.join("*") };
        for b in below {
            text.push('/');
            text.push_str(&b);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::Dimension;
    use proptest::prelude::*;

    #[test]
    fn units_are_written_as_they_are_read() {
        let per_second = Dimension::SECOND.pow(-1, 1);
        assert_eq!(per_second.to_string(), "s^-1");
        assert_eq!(Dimension::VOLT.pow(-1, 1).to_string(), "V^-1");
        assert_eq!(Dimension::METRE.pow(-1, 2).to_string(), "m^(-1/2)");
        assert_eq!(Dimension::METRE.mul(Dimension::SECOND).pow(-1, 1).to_string(), "m^-1/s");
        assert_eq!(Dimension::VOLT.mul(per_second).to_string(), "V/s");
        assert_eq!(Dimension::NEWTON.mul(per_second).to_string(), "N/s");
        assert_eq!(Dimension::KILOGRAM.mul(Dimension::AREA).to_string(), "kg*m^2");
    }

    proptest! {
        /// What is printed is read as what it was.
        #[test]
        fn printed_dimensions_are_read(above in prop::array::uniform7(-4..5_i16), below in 1..4_i32) {
            let dimension = Dimension::of(above).pow(1, below);
            prop_assume!(!dimension.is_one());
            let read = crate::units::read(&dimension.to_string()).map(|u| (u.factor, u.dimension));
            prop_assert_eq!(read, Some((1.0, dimension)));
        }
    }
}
