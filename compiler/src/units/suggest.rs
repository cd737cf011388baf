//! What a misspelt unit may have meant.

use super::table;
use crate::elaborate::distance;

/// Names that people write for units.
const NAMES: &[(&str, &str)] = &[
    ("sec", "s"),
    ("second", "s"),
    ("seconds", "s"),
    ("msec", "ms"),
    ("usec", "us"),
    ("minute", "min"),
    ("minutes", "min"),
    ("hr", "h"),
    ("hour", "h"),
    ("hours", "h"),
    ("day", "d"),
    ("meter", "m"),
    ("metre", "m"),
    ("meters", "m"),
    ("gram", "g"),
    ("kilogram", "kg"),
    ("newton", "N"),
    ("newtons", "N"),
    ("joule", "J"),
    ("joules", "J"),
    ("watt", "W"),
    ("watts", "W"),
    ("pascal", "Pa"),
    ("volt", "V"),
    ("volts", "V"),
    ("amp", "A"),
    ("amps", "A"),
    ("ampere", "A"),
    ("ohms", "Ohm"),
    ("siemens", "S"),
    ("mho", "S"),
    ("farad", "F"),
    ("henry", "H"),
    ("coulomb", "C"),
    ("weber", "Wb"),
    ("tesla", "T"),
    ("hertz", "Hz"),
    ("kelvin", "K"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("radian", "rad"),
    ("radians", "rad"),
    ("turn", "rev"),
    ("liter", "L"),
    ("litre", "L"),
    ("ton", "t"),
    ("tonne", "t"),
    ("percent", "%"),
    ("lit", "L"),
    ("cc", "cm^3"),
    ("kph", "km/h"),
    ("kmh", "km/h"),
    ("RPM", "rpm"),
];

/// Products that are often run together.
const JOINED: &[(&str, &str)] = &[
    ("Nm", "N*m"),
    ("Ns", "N*s"),
    ("Nms", "N*m*s"),
    ("Js", "J*s"),
    ("Pas", "Pa*s"),
    ("VA", "V*A"),
    ("As", "A*s"),
    ("Vs", "V*s"),
    ("Ws", "W*s"),
];

/// The unit that an unknown symbol may have meant.
pub(super) fn suggest(symbol: &str) -> Option<String> {
    if let Some((_, product)) = JOINED.iter().find(|(joined, _)| *joined == symbol) {
        return Some((*product).to_string());
    }
    if let Some((_, unit)) = NAMES.iter().find(|(name, _)| *name == symbol || name.eq_ignore_ascii_case(symbol)) {
        return Some((*unit).to_string());
    }
    if let Some(power) = power(symbol) {
        return Some(power);
    }
    if let Some(unit) = prefixed(symbol, &|a, b| a.to_lowercase() == b.to_lowercase()) {
        return Some(unit);
    }
    // Of a unit of two letters one that differs is half of it, so that the first has to be the same.
    let like = |a: &str, b: &str| a.chars().count() > 1 && a.chars().next() == b.chars().next() && distance(a, b) == 1;
    let near = if symbol.chars().count() > 2 { prefixed(symbol, &like) } else { None };
    near.or_else(|| run_together(symbol))
}

/// The power of a unit that is written without its sign: `m2`.
fn power(symbol: &str) -> Option<String> {
    let (unit, exponent) = symbol.split_at_checked(symbol.len().checked_sub(1)?)?;
    let told = matches!(exponent, "2" | "3" | "4") && table::find(unit).is_some();
    told.then(|| format!("{unit}^{exponent}"))
}

/// The product of two units whose symbols stand together: `kgm`.
fn run_together(symbol: &str) -> Option<String> {
    let known = |text: &str| table::find(text).is_some();
    let (first, second) =
        symbol.char_indices().skip(1).map(|(at, _)| symbol.split_at(at)).find(|(a, b)| known(a) && known(b))?;
    Some(format!("{first}*{second}"))
}

/// A unit, or a prefix and a unit, whose text is like the symbol's.
fn prefixed(symbol: &str, like: &dyn Fn(&str, &str) -> bool) -> Option<String> {
    if let Some(unit) = table::symbols().find(|u| like(u, symbol)) {
        return Some(unit.to_string());
    }
    symbol.char_indices().nth(1).and_then(|(at, _)| {
        let (prefix, rest) = symbol.split_at(at);
        let unit = table::symbols().find(|u| like(u, rest))?;
        // `KW` for `kW`
        let whole = [prefix.to_string(), prefix.to_lowercase()].map(|prefix| format!("{prefix}{unit}"));
        whole.into_iter().find(|whole| table::find(whole).is_some())
    })
}
