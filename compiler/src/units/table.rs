//! The table of units and prefixes.

use super::Dimension as D;
use super::factor::{Factor, PI};

/// How a unit's factor to SI is told: `above/below * 10^ten * pi^pi`.
struct Size {
    above: u64,
    below: u64,
    ten: i32,
    pi: i32,
}

/// A line of the table.
struct Unit {
    symbol: &'static str,
    size: Size,
    dimension: D,
    prefixed: bool,
}

const ONE: Size = Size { above: 1, below: 1, ten: 0, pi: 0 };

const fn whole(above: u64) -> Size {
    Size { above, below: 1, ten: 0, pi: 0 }
}

const fn ten(ten: i32) -> Size {
    Size { above: 1, below: 1, ten, pi: 0 }
}

const fn pi(above: u64, below: u64) -> Size {
    Size { above, below, ten: 0, pi: 1 }
}

/// Takes prefixes.
const fn si(symbol: &'static str, size: Size, dimension: D) -> Unit {
    Unit { symbol, size, dimension, prefixed: true }
}

/// Takes none.
const fn plain(symbol: &'static str, size: Size, dimension: D) -> Unit {
    Unit { symbol, size, dimension, prefixed: false }
}

const UNITS: &[Unit] = &[
    si("g", ten(-3), D::KILOGRAM),
    si("m", ONE, D::METRE),
    si("s", ONE, D::SECOND),
    si("A", ONE, D::AMPERE),
    si("K", ONE, D::KELVIN),
    si("mol", ONE, D::MOLE),
    si("cd", ONE, D::CANDELA),
    si("N", ONE, D::NEWTON),
    si("J", ONE, D::JOULE),
    si("W", ONE, D::WATT),
    si("Pa", ONE, D::PASCAL),
    si("V", ONE, D::VOLT),
    si("Ohm", ONE, D::OHM),
    si("Ω", ONE, D::OHM),
    si("\u{2126}", ONE, D::OHM),
    si("S", ONE, D::SIEMENS),
    si("F", ONE, D::FARAD),
    si("H", ONE, D::HENRY),
    si("C", ONE, D::COULOMB),
    si("Wb", ONE, D::WEBER),
    si("T", ONE, D::TESLA),
    si("Hz", ONE, D::HERTZ),
    si("Bq", ONE, D::HERTZ),
    si("Gy", ONE, D::GRAY),
    si("Sv", ONE, D::GRAY),
    si("kat", ONE, D::KATAL),
    si("lm", ONE, D::CANDELA),
    si("lx", ONE, D::LUX),
    si("rad", ONE, D::DIMENSIONLESS),
    si("sr", ONE, D::DIMENSIONLESS),
    plain("deg", pi(1, 180), D::DIMENSIONLESS),
    plain("°", pi(1, 180), D::DIMENSIONLESS),
    plain("rev", pi(2, 1), D::DIMENSIONLESS),
    plain("rpm", pi(1, 30), D::HERTZ),
    plain("%", ten(-2), D::DIMENSIONLESS),
    si("bar", ten(5), D::PASCAL),
    plain("atm", whole(101_325), D::PASCAL),
    si("L", ten(-3), D::VOLUME),
    si("l", ten(-3), D::VOLUME),
    plain("ha", ten(4), D::AREA),
    plain("min", whole(60), D::SECOND),
    plain("h", whole(3_600), D::SECOND),
    plain("d", whole(86_400), D::SECOND),
    si("eV", Size { above: 1_602_176_634, below: 1, ten: -28, pi: 0 }, D::JOULE),
    si("Wh", whole(3_600), D::JOULE),
    si("Ah", whole(3_600), D::COULOMB),
];

/// Symbols and powers of ten of the prefixes; `da` before `d`.
const PREFIXES: &[(&str, i32)] = &[
    ("da", 1),
    ("y", -24),
    ("z", -21),
    ("a", -18),
    ("f", -15),
    ("p", -12),
    ("n", -9),
    ("u", -6),
    ("µ", -6),
    ("μ", -6),
    ("m", -3),
    ("c", -2),
    ("d", -1),
    ("h", 2),
    ("k", 3),
    ("M", 6),
    ("G", 9),
    ("T", 12),
    ("P", 15),
    ("E", 18),
    ("Z", 21),
    ("Y", 24),
];

/// A symbol's factor to SI and dimension; a unit of its own goes before a prefix: `min` is a minute, `cd` a candela.
pub(super) fn find(symbol: &str) -> Option<(Factor, D)> {
    if let Some(unit) = UNITS.iter().find(|u| u.symbol == symbol) {
        return Some((factor(&unit.size, 0), unit.dimension));
    }
    PREFIXES.iter().find_map(|&(prefix, ten)| {
        let rest = symbol.strip_prefix(prefix)?;
        let unit = UNITS.iter().find(|u| u.prefixed && u.symbol == rest)?;
        Some((factor(&unit.size, ten), unit.dimension))
    })
}

fn factor(size: &Size, prefix: i32) -> Factor {
    let ten = Factor::whole(10).pow((size.ten + prefix).abs(), 1);
    let ratio = Factor::whole(size.above).mul(PI.pow(size.pi, 1));
    let below = Factor::whole(size.below);
    if size.ten + prefix < 0 { ratio.div(below.mul(ten)) } else { ratio.mul(ten).div(below) }
}

/// All symbols without prefix, for suggestions.
pub(super) fn symbols() -> impl Iterator<Item = &'static str> {
    UNITS.iter().map(|u| u.symbol)
}
