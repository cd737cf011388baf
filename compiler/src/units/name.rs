//! How dimensions are written: familiar names, and base units where there is none.

use super::Dimension as D;
use std::fmt;

/// Named units first, then the combinations that modellers use; the first that fits is taken.
const FAMILIAR: &[(&str, D)] = &[
    ("N", D::NEWTON),
    ("J", D::JOULE),
    ("W", D::WATT),
    ("Pa", D::PASCAL),
    ("V", D::VOLT),
    ("A", D::AMPERE),
    ("Ohm", D::OHM),
    ("S", D::SIEMENS),
    ("F", D::FARAD),
    ("H", D::HENRY),
    ("C", D::COULOMB),
    ("Wb", D::WEBER),
    ("T", D::TESLA),
];

/// Combinations as products of powers of named units.
const COMBINED: &[(&str, &[(D, i32)])] = &[
    ("N*s", &[(D::NEWTON, 1), (D::SECOND, 1)]),
    ("N/m", &[(D::NEWTON, 1), (D::METRE, -1)]),
    ("m/N", &[(D::METRE, 1), (D::NEWTON, -1)]),
    ("N*s/m", &[(D::NEWTON, 1), (D::SECOND, 1), (D::METRE, -1)]),
    ("m/N/s", &[(D::METRE, 1), (D::NEWTON, -1), (D::SECOND, -1)]),
    ("N/m^2", &[(D::NEWTON, 1), (D::METRE, -2)]),
    ("N*m^2", &[(D::NEWTON, 1), (D::METRE, 2)]),
    ("J*s", &[(D::JOULE, 1), (D::SECOND, 1)]),
    ("J/K", &[(D::JOULE, 1), (D::KELVIN, -1)]),
    ("W/K", &[(D::WATT, 1), (D::KELVIN, -1)]),
    ("K/W", &[(D::KELVIN, 1), (D::WATT, -1)]),
    ("W/K^2", &[(D::WATT, 1), (D::KELVIN, -2)]),
    ("K^2/W", &[(D::KELVIN, 2), (D::WATT, -1)]),
    ("J/K^2", &[(D::JOULE, 1), (D::KELVIN, -2)]),
    ("K^2/J", &[(D::KELVIN, 2), (D::JOULE, -1)]),
    ("W/m/K", &[(D::WATT, 1), (D::METRE, -1), (D::KELVIN, -1)]),
    ("J/kg/K", &[(D::JOULE, 1), (D::KILOGRAM, -1), (D::KELVIN, -1)]),
    ("J/mol", &[(D::JOULE, 1), (D::MOLE, -1)]),
    ("J/mol/K", &[(D::JOULE, 1), (D::MOLE, -1), (D::KELVIN, -1)]),
    ("Pa*s", &[(D::PASCAL, 1), (D::SECOND, 1)]),
    ("Pa*s/m^3", &[(D::PASCAL, 1), (D::SECOND, 1), (D::METRE, -3)]),
    ("Pa/m^3", &[(D::PASCAL, 1), (D::METRE, -3)]),
    ("m^3/Pa", &[(D::METRE, 3), (D::PASCAL, -1)]),
    ("Pa*s^2/m^3", &[(D::PASCAL, 1), (D::SECOND, 2), (D::METRE, -3)]),
    ("m^3/Pa/s", &[(D::METRE, 3), (D::PASCAL, -1), (D::SECOND, -1)]),
    ("V/m", &[(D::VOLT, 1), (D::METRE, -1)]),
    ("A/m", &[(D::AMPERE, 1), (D::METRE, -1)]),
    ("V/K", &[(D::VOLT, 1), (D::KELVIN, -1)]),
    ("T*m", &[(D::TESLA, 1), (D::METRE, 1)]),
    ("N/A", &[(D::NEWTON, 1), (D::AMPERE, -1)]),
    ("H/m", &[(D::HENRY, 1), (D::METRE, -1)]),
    ("F/m", &[(D::FARAD, 1), (D::METRE, -1)]),
];

/// The unit of a dimension that has a name of its own, if there is one.
fn named(of: D) -> Option<&'static str> {
    FAMILIAR.iter().find(|(_, d)| *d == of).map(|(name, _)| *name)
}

/// The familiar name of a dimension, if it has one.
fn familiar(of: D) -> Option<&'static str> {
    if let Some(name) = named(of) {
        return Some(name);
    }
    let product = |factors: &[(D, i32)]| factors.iter().fold(D::DIMENSIONLESS, |d, &(f, n)| d.mul(f.pow(n, 1)));
    COMBINED.iter().find(|(_, factors)| product(factors) == of).map(|(name, _)| *name)
}

/// A named unit times powers of s and m, where that is shorter than base units: `V/s`.
fn composed(of: D) -> Option<String> {
    let mut best = (of.length()?, None);
    for (name, unit) in FAMILIAR {
        for (s, m) in (-3..=3).flat_map(|s| (-3..=3).map(move |m| (s, m))) {
            let length = 1 + i32::unsigned_abs(s) as u16 + i32::unsigned_abs(m) as u16;
            if length < best.0 && unit.mul(D::SECOND.pow(s, 1)).mul(D::METRE.pow(m, 1)) == of {
                let factor = |symbol: &str, power: i32| match power {
                    0 => String::new(),
                    1 => format!("*{symbol}"),
                    -1 => format!("/{symbol}"),
                    2.. => format!("*{symbol}^{power}"),
                    _ => format!("/{symbol}^{}", -power),
                };
                best = (length, Some(format!("{name}{}{}", factor("s", s), factor("m", m))));
            }
        }
    }
    best.1
}

impl fmt::Display for D {
    /// A unit of that dimension as it may be written behind a number: `N`, `N*s/m`, `s^-1` and not `1/s`, `V/s` and not
    /// its base units; `1` for none.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(name) = familiar(*self) {
            return f.write_str(name);
        }
        if let Some(name) = named(self.pow(-1, 1)) {
            return write!(f, "{name}^-1");
        }
        let text = composed(*self).unwrap_or_else(|| match (self.product(), self.first_divisor()) {
            (product, Some((divisor, rest))) if product.starts_with("1/") => {
                format!("{divisor}{}", rest.product().trim_start_matches('1'))
            }
            (product, _) => product,
        });
        f.write_str(&text)
    }
}
