//! Numbers of the command line: `40ms`, `0.1 kg`, `-2`, `1/60 s`.

use bond_compiler::expression::Number;
use bond_compiler::units::{self, Dimension};
use bond_grammar::ast::{Binary, Expr, ExprKind, Unary};
use bond_grammar::source::Sources;

/// A number in SI, and its dimension where a unit was given.
pub type Quantity = (f64, Option<Dimension>);

/// Reads a number, with a unit or in SI. Sums, products and powers of numbers are numbers too.
///
/// # Errors
/// In a few words, what is wrong with it.
pub fn quantity(text: &str) -> Result<Quantity, String> {
    if text.trim().is_empty() {
        return Err("a number is missing".into());
    }
    if text.contains("//") {
        return Err("`//` begins a comment; a fraction has one `/`".into());
    }
    // A sign that says nothing, as programs print it: `+2e3`.
    let text = text.trim_start();
    let text = text
        .strip_prefix('+')
        .filter(|rest| rest.starts_with(['.', '0', '1', '2', '3', '4', '5', '6', '7', '8', '9']))
        .unwrap_or(text);
    let mut sources = Sources::new();
    let id = sources.add("", text);
    let expr = bond_grammar::parse_expr(&sources, id).map_err(|d| match d.help {
        Some(help) => format!("{}; {help}", d.message),
        None => d.message,
    })?;
    let (value, dimension) = eval(&expr)?;
    if value.is_finite() { Ok((value, dimension)) } else { Err("this is not a finite number".into()) }
}

/// Reads a time: seconds, or a number with a unit of time.
///
/// # Errors
/// In a few words, what is wrong with it.
pub fn seconds(text: &str) -> Result<f64, String> {
    match quantity(text)? {
        (value, None | Some(Dimension::SECOND)) => Ok(value),
        (_, Some(other)) => Err(format!("this is not a time, but in {other}; write seconds, or a unit such as `40ms`")),
    }
}

fn eval(e: &Expr) -> Result<Quantity, String> {
    match &e.kind {
        ExprKind::Number { digits, unit } => {
            let number =
                |value: Option<Number>| value.map(Number::to_f64).ok_or_else(|| format!("`{digits}` is no number"));
            let Some(unit) = unit else { return Ok((number(Number::decimal(digits))?, None)) };
            let (factor, dimension) = units::of(unit).map_err(|u| match u.suggestion {
                _ if units::is_celsius(&u.symbol) => {
                    "temperatures are in kelvin: add 273.15 and write `K`, as `293.15K` for 20 degrees; a difference of 1 degree is `1K`".to_string()
                }
                Some(s) => format!("there is no unit `{}`; did you mean `{s}`?", u.symbol),
                None => format!("there is no unit `{}`", u.symbol),
            })?;
            Ok((number(units::in_si(digits, factor))?, Some(dimension)))
        }
        ExprKind::Paren(inner) => eval(inner),
        ExprKind::Unary(Unary::Neg, inner) => eval(inner).map(|(x, d)| (-x, d)),
        ExprKind::Path(p)
            if p.segments.len() == 1 && p.segments[0].name.text == "pi" && p.segments[0].index.is_empty() =>
        {
            Ok((std::f64::consts::PI, None))
        }
        ExprKind::Binary(op, a, b) => {
            let ((x, dx), (y, dy)) = (eval(a)?, eval(b)?);
            let of = |d: Option<Dimension>| d.unwrap_or(Dimension::DIMENSIONLESS);
            let both = |d: Dimension| (dx.is_some() || dy.is_some()).then_some(d);
            match op {
                Binary::Mul => Ok((x * y, both(of(dx).mul(of(dy))))),
                Binary::Div => Ok((x / y, both(of(dx).div(of(dy))))),
                Binary::Add | Binary::Sub if of(dx) != of(dy) => Err("the two sides have different units".into()),
                Binary::Add => Ok((x + y, both(of(dx)))),
                Binary::Sub => Ok((x - y, both(of(dx)))),
                Binary::Pow if dx.is_none() && dy.is_none() => {
                    Ok((bond_runtime::eval::binary(bond_runtime::ir::Binary::Pow, x, y), None))
                }
                Binary::Pow => Err("a power of a quantity cannot be given here; write the number and its unit".into()),
                Binary::Lt
                | Binary::Le
                | Binary::Gt
                | Binary::Ge
                | Binary::Eq
                | Binary::Ne
                | Binary::And
                | Binary::Or => Err("this is a condition, not a number".into()),
            }
        }
        ExprKind::Path(p) => {
            let name = p.segments.iter().map(|s| s.name.text.as_str()).collect::<Vec<_>>().join(".");
            Err(format!("`{name}` is no number"))
        }
        ExprKind::Bool(_)
        | ExprKind::Unary(Unary::Not, _)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => Err("this is no number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_units() {
        assert_eq!(quantity("0.1 kg"), Ok((0.1, Some(Dimension::KILOGRAM))));
        assert_eq!(quantity("0.1kg"), Ok((0.1, Some(Dimension::KILOGRAM))));
        assert_eq!(quantity("-2"), Ok((-2.0, None)));
        assert_eq!(quantity(" +2e3"), Ok((2e3, None)));
        assert_eq!(quantity("-3mm"), Ok((-0.003, Some(Dimension::METRE))));
        assert_eq!(seconds("3ms"), Ok(0.003));
        assert_eq!(seconds("7.1ms"), Ok(0.0071));
        assert_eq!(seconds("1.1h"), Ok(3960.0));
        assert_eq!(seconds("0.5 min"), Ok(30.0));
        assert_eq!(seconds("1/4"), Ok(0.25));
        assert_eq!(seconds("2"), Ok(2.0));
    }

    #[test]
    fn nonsense_is_told() {
        for text in [
            "",
            " ",
            "abc",
            "1 kgg",
            "1e999",
            "NaN",
            "inf",
            "1 s 2",
            "true",
            "1 < 2",
            "[1]",
            "1/0",
            "\u{0}",
            "1 m + 1 s",
        ] {
            assert!(quantity(text).is_err(), "{text:?}");
        }
        assert!(seconds("1 kg").unwrap_err().contains("not a time"));
    }
}
