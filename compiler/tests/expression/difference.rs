//! Divided differences: no cancellation, exact balance, the derivative in the limit.

use super::{Bench, close};
use bond_compiler::expression::Expr;

/// Energies, with a range in which they are smooth.
const SMOOTH: &[(&str, f64, f64)] = &[
    ("q", -9.0, 9.0),
    ("k*q^2/2", -9.0, 9.0),
    ("q^2 - 3*q + 1", -9.0, 9.0),
    ("q^3", -9.0, 9.0),
    ("q^4/4 - q^2/2", -9.0, 9.0),
    ("q^7", -3.0, 3.0),
    ("q^8", -3.0, 3.0),
    ("q^11 + q^12", -2.0, 2.0),
    ("1 - cos(q)", -9.0, 9.0),
    ("sin(2*q + 1)", -9.0, 9.0),
    ("cosh(q) - 1", -5.0, 5.0),
    ("sinh(q)", -5.0, 5.0),
    ("exp(-2*q)", -5.0, 5.0),
    ("log(q)", 0.1, 9.0),
    ("-1/q", 0.1, 9.0),
    ("1/q^12 - 1/q^6", 0.5, 3.0),
    ("sqrt(1 + q^2)", -9.0, 9.0),
    ("sqrt(q)", 0.1, 9.0),
    ("q^1.5", 0.1, 9.0),
    ("q^2.5", 0.1, 9.0),
    ("q^(-1.5)", 0.1, 9.0),
    ("q^(4/3)", 0.1, 9.0),
    ("q^-0.3", 0.1, 9.0),
    ("q^m", 0.1, 9.0),
    ("m^q", -3.0, 3.0),
    ("q^p", 0.1, 9.0),
    ("q^q", 0.1, 4.0),
    ("tanh(q)", -5.0, 5.0),
    ("log(cosh(q))", -5.0, 5.0),
    ("tan(q)", -1.5, 1.5),
    ("atan(q)", -9.0, 9.0),
    ("asin(q)", -0.99, 0.99),
    ("acos(q)", -0.99, 0.99),
    ("atan2(q, p)", -9.0, 9.0),
    ("atan2(p, q)", -9.0, 9.0),
    ("q*sin(q)", -9.0, 9.0),
    ("q^2*exp(-q)*cos(q)", -3.0, 3.0),
    ("p^2/(2*(m + b*q^2))", -9.0, 9.0),
    ("(q - p)^2*k/2 + p*q", -9.0, 9.0),
    ("exp(sin(q^2))", -3.0, 3.0),
    ("abs(q)^3", 0.1, 9.0),
    ("sqrt(q^4 + 1)*q", -3.0, 3.0),
];

/// The same with kinks.
const KINKED: &[&str] = &[
    "if q > 0 then k*q^2/2 else 0",
    "abs(q)",
    "abs(q)*q",
    "abs(q)^1.5",
    "abs(q)^2.5",
    "abs(q)^(4/3)",
    "sign(q)",
    "max(q, 0)^2",
    "max(q, 0)^2.5",
    "min(k*q^2, 1)",
    "if q < -0.5 then (q + 0.5)^2 else if q > 0.5 then (q - 0.5)^2 else 0",
    "if p > 0 then q^2 else q",
    "(q > 0)*q^2",
];

fn divided(bench: &mut Bench, text: &str) -> (Expr, Expr, Expr) {
    let (from, delta) = (bench.pool.symbol("from"), bench.pool.symbol("delta"));
    bench.names.push(("from", from));
    bench.names.push(("delta", delta));
    let (e, q) = (bench.read(text), bench.symbol("q"));
    let (from_expr, delta_expr) = (bench.pool.var(from), bench.pool.var(delta));
    let dd = bench.pool.difference(e, q, from_expr, delta_expr);
    let d = bench.pool.derivative(e, q);
    (e, d, dd)
}

fn value(bench: &Bench, dd: Expr, from: f64, delta: f64) -> f64 {
    let (f, d) = (bench.symbol("from"), bench.symbol("delta"));
    bench.pool.eval(dd, &|s| match s {
        s if s == f => from,
        s if s == d => delta,
        s => 0.7 + 0.1 * f64::from(s.0),
    })
}

#[test]
fn balance() {
    let smooth = SMOOTH.iter().map(|&(text, low, high)| (text, low, high));
    for (text, low, high) in smooth.chain(KINKED.iter().map(|&t| (t, -3.0, 3.0))) {
        let mut bench = Bench::new();
        let (e, _, dd) = divided(&mut bench, text);
        for i in 0..=20 {
            let from = low + (high - low) * f64::from(i) / 20.0;
            for exponent in -12..=1 {
                for mantissa in [1.0, -1.0, 3.3] {
                    let delta = mantissa * 10.0_f64.powi(exponent);
                    let to = from + delta;
                    if to < low || to > high {
                        continue;
                    }
                    let (a, b) = (bench.at(e, from), bench.at(e, to));
                    let dd = value(&bench, dd, from, delta);
                    // the rounding of from + delta and of the values themselves
                    let slack = 1e-14 * (a.abs() + b.abs() + 1.0) + 1e-15 * dd.abs() * (from.abs() + to.abs());
                    assert!(
                        (dd * delta - (b - a)).abs() <= slack,
                        "{text} from {from} by {delta}: {} and {}",
                        dd * delta,
                        b - a
                    );
                }
            }
        }
    }
}

#[test]
fn no_cancellation() {
    // the mean of the derivative by Gauss' rule with five points
    let nodes = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683, 0.478_628_670_499_366_47),
        (-0.538_469_310_105_683, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    for &(text, low, high) in SMOOTH {
        let mut bench = Bench::new();
        let (_, d, dd) = divided(&mut bench, text);
        for i in 1..20 {
            let from = low + (high - low) * f64::from(i) / 20.0;
            for delta in [0.0, 1e-300, 1e-14, -1e-12, 1e-9, -1e-6, 1e-4, 1e-3, -1e-2] {
                let exact: f64 = nodes.iter().map(|(x, w)| w / 2.0 * bench.at(d, from + delta / 2.0 * (1.0 + x))).sum();
                let got = value(&bench, dd, from, delta);
                let size =
                    nodes.iter().map(|(x, _)| bench.at(d, from + delta / 2.0 * (1.0 + x)).abs()).fold(0.0, f64::max);
                assert!(
                    (got - exact).abs() <= 3e-13 * (size + 1e-2),
                    "{text} from {from} by {delta}: {got} and {exact}"
                );
            }
        }
    }
}

#[test]
fn jacobian() {
    // the derivative by delta is finite and right where delta is 0: half the second derivative
    for &(text, low, high) in SMOOTH {
        let mut bench = Bench::new();
        let (_, d, dd) = divided(&mut bench, text);
        let (q, delta) = (bench.symbol("q"), bench.symbol("delta"));
        let second = bench.pool.derivative(d, q);
        let slope = bench.pool.derivative(dd, delta);
        for i in 1..10 {
            let from = low + (high - low) * (f64::from(i) + 0.37) / 10.5;
            let (got, half) = (value(&bench, slope, from, 0.0), bench.at(second, from) / 2.0);
            assert!((got - half).abs() <= 1e-9 * (1.0 + half.abs()), "{text} at {from}: {got} and {half}");
            // and elsewhere it is that of the difference quotient
            for by in [0.02 * (high - low), 0.11 * (high - low)] {
                if from + by + 1e-2 > high {
                    continue;
                }
                let h = 1e-4 * by;
                let f = |i: f64| value(&bench, dd, from, by + i * h);
                let numeric = (8.0 * (f(1.0) - f(-1.0)) - (f(2.0) - f(-2.0))) / (12.0 * h);
                let got = value(&bench, slope, from, by);
                assert!(
                    (got - numeric).abs() <= 1e-7 * (1.0 + got.abs() + value(&bench, dd, from, by).abs()),
                    "{text} from {from} by {by}: {got} and {numeric}"
                );
            }
        }
    }
}

#[test]
fn at_rest() {
    // at the kinks themselves, with delta 0: finite, and the derivative of one side
    for text in KINKED {
        let mut bench = Bench::new();
        let (_, _, dd) = divided(&mut bench, text);
        let delta = bench.symbol("delta");
        let slope = bench.pool.derivative(dd, delta);
        for from in [0.0, 0.5, -0.5, 1.0] {
            let got = value(&bench, dd, from, 0.0);
            assert!(got.is_finite(), "{text} at {from}: {got}: {}", bench.pool.print(dd));
            let steep = ["^1.5", "4/3"].iter().any(|t| text.contains(t)) && from == 0.0;
            let slope = value(&bench, slope, from, 0.0);
            assert!(slope.is_finite() || steep, "{text} at {from}: {slope}");
        }
    }
}

#[test]
fn short() {
    for (text, difference) in [
        ("k*q", "k"),
        ("k*q^2/2", "k*(delta/2 + from)"),
        ("p*q", "p"),
        ("k*p", "0"),
        ("if p > 0 then q else 0", "if p > 0 then 1 else 0"),
        ("if q > 0 then q else q", "1"),
    ] {
        let mut bench = Bench::new();
        let (_, _, dd) = divided(&mut bench, text);
        assert_eq!(bench.pool.print(dd), difference, "{text}");
    }
    assert!(close(1.0, 1.0 + 1e-16, 1e-15));
}
