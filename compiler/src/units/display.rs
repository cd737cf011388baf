//! How a unit is shown: as people say it, which takes more than its dimension.
//!
//! A radian is 1, so that a torque and an energy are of one dimension, and no check can tell them apart. What is shown
//! counts the radians all the same: a torque is J/rad, said N*m; a rotational stiffness J/rad^2, said N*m/rad; a motor
//! constant V*s/rad, said V/(rad/s). Nothing but the text depends on that count.

use super::Dimension as D;
use bond_grammar::ast::{self, ExprKind};
use bond_grammar::source::Sources;
use std::fmt;
use std::sync::Arc;

/// A rational exponent, with a positive denominator.
type Ratio = (i32, i32);

/// A unit as it is shown behind a number in SI: its dimension, how many radians it counts, and how it was written.
///
/// Its text can be read behind a number, but for that of a bare number, which is `1`.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayUnit {
    /// What it is checked as.
    pub dimension: D,
    radians: Ratio,
    written: Option<Arc<str>>,
}

impl DisplayUnit {
    /// Of a dimension and a power of the radian.
    pub fn new(dimension: D, radians: (i32, i32)) -> Self {
        Self { dimension, radians, written: None }
    }

    /// The same as a model has it, in SI: `V*s/rad` for `mV*s/rad`.
    #[must_use]
    pub fn written(self, text: Option<Arc<str>>) -> Self {
        Self { written: text, ..self }
    }

    /// Of a product.
    #[must_use]
    pub fn mul(&self, other: &DisplayUnit) -> Self {
        self.power(other, 1)
    }

    /// Of a quotient.
    #[must_use]
    pub fn div(&self, other: &DisplayUnit) -> Self {
        self.power(other, -1)
    }

    /// Of the integral over time.
    #[must_use]
    pub fn seconds(&self) -> Self {
        self.mul(&DisplayUnit::from(D::SECOND))
    }

    /// Whether it is a bare number, for which no unit is said.
    pub fn is_one(&self) -> bool {
        self.dimension.is_one() && self.to_string() == "1"
    }

    fn power(&self, other: &DisplayUnit, n: i32) -> Self {
        let ((a, b), (c, d)) = (self.radians, other.radians);
        Self::new(self.dimension.mul(other.dimension.pow(n, 1)), (a * d + n * c * b, b * d))
    }

    /// Its name where the count of radians has a part in it.
    fn angular(&self) -> Option<String> {
        let whole = self.radians.0.checked_div(self.radians.1).filter(|n| n * self.radians.1 == self.radians.0)?;
        match whole {
            0 => None,
            1.. => {
                let below = self.dimension.pow(-1, 1);
                torque(below, -whole).and_then(|name| inverse(&name)).or_else(|| per(whole, self.dimension))
            }
            _ => torque(self.dimension, whole).or_else(|| of_angle(whole, self.dimension)),
        }
    }
}

impl From<D> for DisplayUnit {
    fn from(dimension: D) -> Self {
        Self::new(dimension, (0, 1))
    }
}

impl fmt::Display for DisplayUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.written, self.angular()) {
            (Some(written), _) => f.write_str(written),
            (None, Some(name)) => f.write_str(&name),
            // A radius is in m, although it makes an arc of an angle.
            (None, None) => write!(f, "{}", self.dimension),
        }
    }
}

/// The text of a unit where one is always said: `dimensionless` for the `1` of a bare number.
pub fn in_prose(unit: &str) -> &str {
    if unit == "1" { "dimensionless" } else { unit }
}

/// `symbol`, `symbol^2`; nothing for no power.
fn power(symbol: &str, n: i32) -> Option<String> {
    match n {
        0 => None,
        1 => Some(symbol.to_string()),
        n => Some(format!("{symbol}^{n}")),
    }
}

/// A torque times a power of the time, per power of the angle.
fn torque(dimension: D, radians: i32) -> Option<String> {
    let rest = dimension.div(D::JOULE);
    let seconds = (-3..=3).find(|n| rest == D::SECOND.pow(*n, 1))?;
    if (seconds, radians) == (2, -2) {
        return Some("kg*m^2".into());
    }
    let mut text = "N*m".to_string();
    if let Some(above) = power("s", seconds.max(0)) {
        text = format!("{text}*{above}");
    }
    for below in [power("s", (-seconds).max(0)), power("rad", -1 - radians)].into_iter().flatten() {
        text = format!("{text}/{below}");
    }
    Some(text)
}

/// One over a torque's unit: `rad/(N*m)` for `N*m/rad`.
fn inverse(name: &str) -> Option<String> {
    match name.split_once('/') {
        Some((above, below)) => Some(format!("{below}/({above})")).filter(|_| !below.contains('/')),
        None => Some("N^-1/m".into()).filter(|_| name == "N*m"),
    }
}

/// What is said per angle.
const PER_ANGLE: [(&str, D); 6] =
    [("V", D::VOLT), ("A", D::AMPERE), ("N", D::NEWTON), ("Pa", D::PASCAL), ("K", D::KELVIN), ("m^3", D::VOLUME)];

/// Something per angle, or per a speed of it: `V/(rad/s)`. A volume goes by the angle alone: `m^3/rad`.
fn of_angle(radians: i32, dimension: D) -> Option<String> {
    let below = power("rad", -radians)?;
    let found = |seconds: i32| PER_ANGLE.iter().find(|(_, of)| of.mul(D::SECOND.pow(seconds, 1)) == dimension);
    if let Some((name, _)) = found(0) {
        return Some(format!("{name}/{below}"));
    }
    let rates = [(1, "(rad/s)"), (2, "(rad/s^2)"), (-1, "(rad*s)")].into_iter().filter(|_| radians == -1);
    rates
        .filter_map(|(seconds, text)| found(seconds).map(|f| (f.0, text)))
        .find_map(|(name, text)| (name != "m^3").then(|| format!("{name}/{text}")))
}

/// An angle, its speed or its acceleration, by itself or per something: `rad/s/V`.
fn per(radians: i32, dimension: D) -> Option<String> {
    // What a sensor of torque gives.
    if (radians, dimension) == (1, D::VOLT.div(D::JOULE)) {
        return Some("V/(N*m)".into());
    }
    let above = power("rad", radians)?;
    [(0, above.clone()), (-1, format!("{above}/s")), (-2, format!("{above}/s^2"))].into_iter().find_map(
        |(seconds, text)| match D::SECOND.pow(seconds, 1).div(dimension) {
            D::DIMENSIONLESS => Some(text),
            D::METRE => Some(format!("{text}/m")),
            rest => PER_ANGLE.iter().find(|(_, of)| *of == rest).map(|(name, _)| format!("{text}/{name}")),
        },
    )
}

/// What a unit says about angles, by the way that it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// How many radians it counts; `N*m` is a torque, and `J` is not.
    pub radians: i32,
    /// Whether that is certain: as a radian is 1, `N*m` is written for a stiffness too, `V*s` for a motor constant.
    pub certain: bool,
}

/// What the unit of a number says about angles; that of a bare number says that it counts none.
pub fn reading(unit: Option<&ast::Unit>) -> Reading {
    let Some(unit) = unit else { return Reading { radians: 0, certain: true } };
    let whole = |n: &(i32, i32)| if n.1 == 1 { n.0 } else { 0 };
    let angles: Vec<i32> = unit.factors.iter().filter(|f| is_angular(&f.0)).map(|f| whole(&f.1)).collect();
    let is = |symbol: &str, of: D| super::lookup(symbol).is_some_and(|(_, d)| d == of);
    let powers = |of: D| -> Vec<i32> { unit.factors.iter().filter(|f| is(&f.0, of)).map(|f| whole(&f.1)).collect() };
    let torque = match (&powers(D::NEWTON)[..], &powers(D::METRE)[..]) {
        ([n], [m]) if n == m && n.abs() == 1 => *n,
        _ => 0,
    };
    let counts = |symbol: &str| matches!(symbol, "Hz" | "Bq") || symbol.ends_with("Hz");
    let dimension = super::of(unit).map_or(D::DIMENSIONLESS, |u| u.1);
    let certain =
        !angles.is_empty() || unit.factors.iter().any(|f| counts(&f.0)) || dimension.is_one() || dimension == D::SECOND;
    Reading { radians: angles.iter().sum::<i32>() - torque, certain }
}

/// Whether a symbol is a unit of angle, or of its speed.
fn is_angular(symbol: &str) -> bool {
    symbol.ends_with("rad") || matches!(symbol, "deg" | "°" | "rev" | "rpm")
}

/// The unit of a number of a model, in the words of the model, for the number in SI: `N*m/A` for `mN*m/A`, `rad/s` for
/// `rpm`. None where there is no such.
pub fn as_written(sources: &Sources, value: &ast::Expr) -> Option<Arc<str>> {
    let unit = match &value.kind {
        ExprKind::Number { unit, .. } => unit.as_ref()?,
        ExprKind::Paren(inner) | ExprKind::Unary(_, inner) => return as_written(sources, inner),
        ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => return None,
    };
    let mut text = sources.slice(unit.span).to_string();
    for (symbol, _, span) in unit.factors.iter().rev() {
        let from = span.start.checked_sub(unit.span.start)? as usize;
        let plain = plain(symbol)?;
        // `symbol` is where the factor begins, whether or not its exponent is within the span.
        text.get(from..).filter(|rest| rest.starts_with(symbol.as_str()))?;
        text.replace_range(from..from + symbol.len(), &plain);
    }
    let same = super::of(unit).ok().zip(read(&text)).is_some_and(|((_, d), u)| u.dimension == d && u.factor == 1.0);
    same.then(|| text.into())
}

/// The same of a number as it stands in a text.
pub fn of_number(text: &str) -> Option<Arc<str>> {
    let mut sources = Sources::new();
    let id = sources.add("", text);
    as_written(&sources, &bond_grammar::parse_expr(&sources, id).ok()?)
}

/// The unit in SI that a symbol is a multiple of.
fn plain(symbol: &str) -> Option<String> {
    let (factor, dimension) = super::lookup(symbol)?;
    match symbol {
        "Ω" | "\u{2126}" => Some("Ohm".into()),
        "rpm" => Some("rad/s".into()),
        _ if is_angular(symbol) => Some("rad".into()),
        _ if factor == 1.0 => Some(symbol.into()),
        _ if dimension.is_one() => None,
        _ if symbol.ends_with("Hz") => Some("Hz".into()),
        _ => Some(dimension.to_string()).filter(|name| name.chars().all(char::is_alphabetic)),
    }
}

/// A unit that was read from its text.
pub struct Read {
    /// Its factor to SI.
    pub factor: f64,
    /// Its dimension.
    pub dimension: D,
    /// What it says about angles.
    pub reading: Reading,
    /// The power of the radian as it is written: that of `N*m` is 0.
    pub radians: i32,
}

/// Reads a unit as it stands behind a number of a model.
pub fn read(text: &str) -> Option<Read> {
    let mut sources = Sources::new();
    let id = sources.add("", format!("1 {text}"));
    let expr = bond_grammar::parse_expr(&sources, id).ok()?;
    let ExprKind::Number { unit: Some(unit), .. } = &expr.kind else { return None };
    let (factor, dimension) = super::of(unit).ok()?;
    let radians = unit.factors.iter().filter(|f| is_angular(&f.0) && f.1.1 == 1).map(|f| f.1.0).sum();
    Some(Read { factor, dimension, reading: reading(Some(unit)), radians })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The units of the domains, as they follow from those of a torque and of a speed.
    #[test]
    fn units_are_said_as_they_are() {
        let (torque, speed) = (DisplayUnit::new(D::JOULE, (-1, 1)), DisplayUnit::new(D::HERTZ, (1, 1)));
        let angle = speed.seconds();
        let of = DisplayUnit::from;
        let time = of(D::SECOND);
        for (unit, text) in [
            (torque.clone(), "N*m"),
            (speed.clone(), "rad/s"),
            (angle.clone(), "rad"),
            (speed.div(&time), "rad/s^2"),
            (torque.seconds(), "N*m*s"),
            (torque.div(&angle), "N*m/rad"),
            (angle.div(&torque), "rad/(N*m)"),
            (torque.div(&speed), "N*m*s/rad"),
            (speed.div(&torque), "rad/(N*m*s)"),
            (torque.div(&speed.div(&time)), "kg*m^2"),
            (torque.div(&speed).div(&speed), "N*m*s^2/rad^2"),
            (torque.mul(&speed), "W"),
            (torque.mul(&angle), "J"),
            (of(D::VOLT).div(&speed), "V/(rad/s)"),
            (torque.div(&of(D::AMPERE)), "V/(rad/s)"),
            (of(D::VOLT).div(&angle), "V/rad"),
            (of(D::PASCAL).div(&torque), "rad/m^3"),
            (of(D::VOLUME).div(&angle), "m^3/rad"),
            (speed.div(&of(D::VOLT)), "rad/s/V"),
            (torque.div(&of(D::NEWTON)), "m"),
            (speed.mul(&of(D::METRE)), "m/s"),
            (torque.div(&torque), "1"),
        ] {
            assert_eq!(unit.to_string(), text);
            if text != "1" {
                let read = read(text).unwrap_or_else(|| panic!("{text} is not read"));
                assert_eq!((read.factor, read.dimension), (1.0, unit.dimension), "{text}");
            }
        }
    }
}
