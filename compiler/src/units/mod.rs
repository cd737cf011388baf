//! Units: their dimensions and their factors to SI.
//!
//! `of` reads the unit of a literal, [`Dimension`] is what the checker works on, and [`DisplayUnit`] what is shown.

mod dimension;
mod display;
mod factor;
mod name;
mod suggest;
mod table;

pub use dimension::Dimension;
pub use display::{DisplayUnit, Read, Reading, as_written, in_prose, of_number, read, reading};

use crate::expression::Number;
use bond_grammar::ast;
use bond_grammar::source::Span;

/// A symbol that is no unit.
#[derive(Clone, Debug, PartialEq)]
pub struct UnknownSymbol {
    /// As written.
    pub symbol: String,
    /// Where.
    pub span: Span,
    /// What may have been meant.
    pub suggestion: Option<String>,
}

/// Other base units than those of SI, for tests: a scene in them is the same scene, and takes the same steps. By the
/// powers of two that a kg, m, s, A, K, mol and cd are of them; multiples of 6, so that roots of units have whole ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BaseUnits(pub [i32; 7]);

impl BaseUnits {
    /// What one SI unit of a dimension is in these.
    pub fn factor(self, dimension: Dimension) -> Number {
        let k = dimension.dot(self.0);
        let power = 1_i64.checked_shl(k.unsigned_abs()).filter(|_| k.abs() < 62);
        match power {
            Some(power) if k < 0 => Number::ratio(1, power),
            Some(power) => Number::from(power),
            None => Number::float(libm::exp2(f64::from(k))),
        }
    }
}

/// Symbols of angles and angular speeds, in which a rate counts radians, and not turns.
pub const ANGULAR: [&str; 5] = ["rpm", "rad", "mrad", "deg", "°"];

/// Whether a symbol is written for the degree Celsius, which is no unit: it has another zero.
pub fn is_celsius(symbol: &str) -> bool {
    matches!(symbol, "°C" | "degC" | "deg_C" | "celsius" | "Celsius")
}

/// The factor to SI and the dimension of a symbol, with or without a prefix; `None` if it is no unit.
pub fn lookup(symbol: &str) -> Option<(f64, Dimension)> {
    table::find(symbol).map(|(factor, dimension)| (factor.round(), dimension))
}

/// Whether a symbol is a unit, with or without a prefix.
pub fn is_unit(symbol: &str) -> bool {
    table::find(symbol).is_some()
}

/// The unit that a symbol which is none may have been meant for.
pub fn suggest(symbol: &str) -> Option<String> {
    suggest::suggest(symbol)
}

/// A number as it is written, with a unit of that factor, in SI: 7.1 ms are 71/10000 s. The decimals of a power of ten
/// are joined to its own, and rounded with them; another factor below one is the inverse of a rounder number. `None` if
/// it is no number.
pub fn in_si(digits: &str, factor: f64) -> Option<Number> {
    let number = Number::decimal(digits)?;
    let inverse = (1.0 / factor).round();
    if let Some(moved) = moved(digits, factor) {
        Some(moved)
    } else if factor.fract() == 0.0 && factor < 1e15 {
        Some(number * Number::from(factor as i64))
    } else if factor < 1.0 && inverse < 9e15 && 1.0 / inverse == factor {
        Some(number * Number::from(inverse as i64).recip())
    } else {
        Some(Number::float(number.to_f64() * factor))
    }
}

/// The product of a decimal and a power of ten.
fn moved(digits: &str, factor: f64) -> Option<Number> {
    let ten = libm::log10(factor).round() as i32;
    if format!("1e{ten}").parse() != Ok(factor) {
        return None;
    }
    let (mantissa, exponent) = digits.split_once(['e', 'E']).unwrap_or((digits, "0"));
    let exponent = exponent.parse::<i32>().ok()?.checked_add(ten)?;
    Number::decimal(&format!("{mantissa}e{exponent}"))
}

/// The factor to SI, rounded once, and the dimension of a unit.
///
/// # Errors
/// The first symbol that is no unit.
pub fn of(unit: &ast::Unit) -> Result<(f64, Dimension), UnknownSymbol> {
    let (mut above, mut below) = (factor::Factor::whole(1), factor::Factor::whole(1));
    let mut dimension = Dimension::DIMENSIONLESS;
    for (symbol, (n, d), span) in &unit.factors {
        let Some((factor, of)) = table::find(symbol) else {
            return Err(UnknownSymbol { symbol: symbol.clone(), span: *span, suggestion: suggest::suggest(symbol) });
        };
        let (n, d) = if *d < 0 { (n.saturating_neg(), d.saturating_neg()) } else { (*n, *d) };
        let power = factor.pow(n.saturating_abs(), d);
        let side = if n < 0 { &mut below } else { &mut above };
        *side = side.mul(power);
        dimension = dimension.mul(of.pow(n, d));
    }
    Ok((above.div(below).round(), dimension))
}
