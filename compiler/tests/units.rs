//! Units: the table, prefixes, products, names.

use bond_compiler::units::{self, Dimension};
use bond_grammar::ast::Unit;
use bond_grammar::source::{SourceId, Span};

const SPAN: Span = Span { source: SourceId(0), start: 3, end: 5 };

fn unit(factors: &[(&str, (i32, i32))]) -> Unit {
    Unit { factors: factors.iter().map(|&(s, n)| (s.to_string(), n, SPAN)).collect(), span: SPAN }
}

#[test]
fn factors() {
    use std::f64::consts::PI;
    for (symbol, factor, dimension) in [
        ("kg", 1.0, "kg"),
        ("g", 1e-3, "kg"),
        ("mg", 1e-6, "kg"),
        ("m", 1.0, "m"),
        ("mm", 1e-3, "m"),
        ("cm", 1e-2, "m"),
        ("um", 1e-6, "m"),
        ("µm", 1e-6, "m"),
        ("μm", 1e-6, "m"),
        ("nm", 1e-9, "m"),
        ("km", 1e3, "m"),
        ("dam", 10.0, "m"),
        ("s", 1.0, "s"),
        ("ms", 1e-3, "s"),
        ("us", 1e-6, "s"),
        ("ns", 1e-9, "s"),
        ("min", 60.0, "s"),
        ("h", 3600.0, "s"),
        ("d", 86400.0, "s"),
        ("A", 1.0, "A"),
        ("mA", 1e-3, "A"),
        ("K", 1.0, "K"),
        ("mK", 1e-3, "K"),
        ("mol", 1.0, "mol"),
        ("cd", 1.0, "cd"),
        ("N", 1.0, "N"),
        ("kN", 1e3, "N"),
        ("mN", 1e-3, "N"),
        ("J", 1.0, "J"),
        ("kJ", 1e3, "J"),
        ("eV", 1.602176634e-19, "J"),
        ("kWh", 3.6e6, "J"),
        ("W", 1.0, "W"),
        ("MW", 1e6, "W"),
        ("Pa", 1.0, "Pa"),
        ("kPa", 1e3, "Pa"),
        ("mPa", 1e-3, "Pa"),
        ("MPa", 1e6, "Pa"),
        ("GPa", 1e9, "Pa"),
        ("bar", 1e5, "Pa"),
        ("mbar", 100.0, "Pa"),
        ("atm", 101325.0, "Pa"),
        ("V", 1.0, "V"),
        ("mV", 1e-3, "V"),
        ("Ohm", 1.0, "Ohm"),
        ("kOhm", 1e3, "Ohm"),
        ("mOhm", 1e-3, "Ohm"),
        ("MOhm", 1e6, "Ohm"),
        ("Ω", 1.0, "Ohm"),
        ("kΩ", 1e3, "Ohm"),
        ("S", 1.0, "S"),
        ("F", 1.0, "F"),
        ("uF", 1e-6, "F"),
        ("nF", 1e-9, "F"),
        ("pF", 1e-12, "F"),
        ("H", 1.0, "H"),
        ("mH", 1e-3, "H"),
        ("C", 1.0, "C"),
        ("Wb", 1.0, "Wb"),
        ("T", 1.0, "T"),
        ("mT", 1e-3, "T"),
        ("Hz", 1.0, "s^-1"),
        ("kHz", 1e3, "s^-1"),
        ("GHz", 1e9, "s^-1"),
        ("rpm", 0.104_719_755_119_659_78, "s^-1"),
        ("rad", 1.0, "1"),
        ("mrad", 1e-3, "1"),
        ("deg", PI / 180.0, "1"),
        ("°", PI / 180.0, "1"),
        ("rev", 2.0 * PI, "1"),
        ("%", 0.01, "1"),
        ("L", 1e-3, "m^3"),
        ("l", 1e-3, "m^3"),
        ("mL", 1e-6, "m^3"),
        ("ym", 1e-24, "m"),
        ("Ym", 1e24, "m"),
    ] {
        let Some((got, of)) = units::lookup(symbol) else { panic!("{symbol}") };
        assert_eq!(got, factor, "{symbol}");
        assert_eq!(of.to_string(), dimension, "{symbol}");
    }
    for symbol in ["degC", "x", "", "kkg", "kmin", "mdeg", "ohm", "sec", "Nm", "k", "ft", "µ", "kh", "krpm", "n"] {
        assert_eq!(units::lookup(symbol), None, "{symbol}");
    }
}

#[test]
fn products() {
    for (factors, expected, dimension) in [
        (vec![("N", (1, 1)), ("s", (1, 1)), ("m", (-1, 1))], 1.0, "N*s/m"),
        (vec![("kg", (1, 1)), ("m", (2, 1))], 1.0, "kg*m^2"),
        (vec![("km", (1, 1)), ("h", (-1, 1))], 1.0 / 3.6, "m/s"),
        (vec![("L", (1, 1)), ("min", (-1, 1))], 1.0 / 60_000.0, "m^3/s"),
        (vec![("mm", (2, 1))], 1e-6, "m^2"),
        (vec![("um", (3, 1))], 1e-18, "m^3"),
        (vec![("nF", (-1, 1))], 1e9, "F^-1"),
        (vec![("g", (1, 1)), ("cm", (-3, 1))], 1000.0, "kg/m^3"),
        (vec![("m", (1, 2))], 1.0, "m^(1/2)"),
        (vec![("cm", (1, 2))], 0.1, "m^(1/2)"),
        (vec![("mm", (3, 2))], 1e-3_f64.powf(1.5), "m^(3/2)"),
        (vec![("N", (1, 1)), ("m", (1, 1))], 1.0, "J"),
        (vec![("N", (1, 1)), ("m", (1, 1)), ("rad", (-1, 1))], 1.0, "J"),
        (vec![("V", (1, 1)), ("A", (1, 1))], 1.0, "W"),
        (vec![], 1.0, "1"),
    ] {
        let (got, of) = units::of(&unit(&factors)).expect("known");
        assert!((got - expected).abs() <= 1e-16 * expected, "{factors:?}: {got}");
        assert_eq!(of.to_string(), dimension, "{factors:?}");
    }
    // rounded once: 1/7.2 in two steps would be off
    assert_eq!(units::of(&unit(&[("km", (2, 1)), ("h", (-2, 1))])).expect("known").0, 1e6 / 12_960_000.0);
}

/// Decimals of a power of ten are joined to the number's own: there is one rounding.
#[test]
fn literals_are_the_nearest_doubles() {
    for (digits, factors, expected) in [
        ("75.62", vec![("aF", (1, 1))], 75.62e-18),
        ("287", vec![("nm", (2, 1))], 287e-18),
        ("35", vec![("ms", (1, 1))], 0.035),
        ("7.1E-3", vec![("um", (3, 1))], 7.1e-21),
        ("0.3", vec![("PHz", (2, 1))], 0.3e30),
        ("123.4567890123457", vec![("cm", (-1, 2))], 1234.567890123457),
        ("2.9", vec![("g", (1, 1)), ("mL", (-1, 1))], 2900.0),
        ("36", vec![("km", (1, 1)), ("h", (-1, 1))], 10.0),
    ] {
        let factor = units::of(&unit(&factors)).expect("known").0;
        assert_eq!(units::in_si(digits, factor).expect("a number").to_f64(), expected, "{digits} {factors:?}");
    }
    for (prefix, ten) in "y z a f p n u m c d da h k M G T P E Z Y"
        .split(' ')
        .zip([-24, -21, -18, -15, -12, -9, -6, -3, -2, -1, 1, 2, 3, 6, 9, 12, 15, 18, 21, 24])
    {
        for (digits, power) in [("75.62", 1), ("287", 2), ("0.1", -1), ("1.7", 3)] {
            let factor = units::of(&unit(&[(&format!("{prefix}m"), (power, 1))])).expect("known").0;
            let nearest: f64 = format!("{digits}e{}", ten * power).parse().expect("a number");
            let got = units::in_si(digits, factor).expect("a number").to_f64();
            assert_eq!(got, nearest, "{digits} {prefix}m^{power}");
        }
    }
}

#[test]
fn names() {
    use Dimension as D;
    let d = |all: &[(D, i32)]| all.iter().fold(D::DIMENSIONLESS, |d, &(f, n)| d.mul(f.pow(n, 1)));
    for (dimension, name) in [
        (D::DIMENSIONLESS, "1"),
        (d(&[(D::METRE, 1), (D::SECOND, -1)]), "m/s"),
        (d(&[(D::METRE, 1), (D::SECOND, -2)]), "m/s^2"),
        (d(&[(D::NEWTON, 1), (D::SECOND, 1)]), "N*s"),
        (d(&[(D::NEWTON, 1), (D::METRE, -1)]), "N/m"),
        (d(&[(D::PASCAL, 1), (D::SECOND, 1), (D::METRE, -3)]), "Pa*s/m^3"),
        (d(&[(D::METRE, 3), (D::SECOND, -1)]), "m^3/s"),
        (d(&[(D::WATT, 1), (D::KELVIN, -1)]), "W/K"),
        (d(&[(D::VOLT, 1), (D::SECOND, 1)]), "Wb"),
        (d(&[(D::NEWTON, 1), (D::METRE, 1), (D::SECOND, 1)]), "J*s"),
        (d(&[(D::KILOGRAM, 1), (D::METRE, 2), (D::AMPERE, 5)]), "kg*m^2*A^5"),
        (d(&[(D::SECOND, -1)]), "s^-1"),
        (D::OHM.sqrt(), "kg^(1/2)*m/s^(3/2)/A"),
    ] {
        assert_eq!(dimension.to_string(), name);
    }
    assert_eq!(D::NEWTON.mul(D::METRE), D::JOULE);
    assert_eq!(D::JOULE.div(D::SECOND), D::WATT);
    assert_eq!(D::VOLT.div(D::AMPERE), D::OHM);
    assert_eq!(D::OHM.pow(-1, 1), D::SIEMENS);
    assert_eq!(D::FARAD.mul(D::OHM), D::SECOND);
    assert_eq!(D::HENRY.div(D::OHM), D::SECOND);
    assert_eq!(D::OHM.sqrt().pow(2, 1), D::OHM);
    assert_eq!(D::METRE.pow(2, -4), D::METRE.pow(-1, 2));
    assert!(D::METRE.div(D::METRE).is_one());
    // nothing overflows
    let mut large = D::METRE;
    for _ in 0..40 {
        large = large.mul(large);
    }
    assert!(!large.is_one());
}

#[test]
fn suggestions() {
    for (symbol, expected) in [
        ("ohm", Some("Ohm")),
        ("kohm", Some("kOhm")),
        ("sec", Some("s")),
        ("Nm", Some("N*m")),
        ("hz", Some("Hz")),
        ("khz", Some("kHz")),
        ("pa", Some("Pa")),
        ("RPM", Some("rpm")),
        ("Volt", Some("V")),
        ("radd", Some("rad")),
        ("xyzzy", None),
        ("x", None),
    ] {
        let error = units::of(&unit(&[("m", (1, 1)), (symbol, (1, 1))])).expect_err("unknown");
        assert_eq!((error.symbol.as_str(), error.span), (symbol, SPAN));
        assert_eq!(error.suggestion.as_deref(), expected, "{symbol}");
    }
}
