//! Derivatives and antiderivatives against difference quotients.

use super::{Bench, close};

const SMOOTH: &[&str] = &[
    "q",
    "k*q^2/2",
    "q^5 - 3*q",
    "1/q",
    "1/(1 + q^2)",
    "sqrt(q)",
    "q^1.5",
    "q^-0.5",
    "q^(1/3)",
    "q^0.3",
    "q^m",
    "m^q",
    "q^q",
    "exp(-q)",
    "log(q)",
    "sin(2*q)",
    "cos(q^2)",
    "tan(q/2)",
    "asin(q/3)",
    "acos(q/3)",
    "atan(2*q)",
    "sinh(q)",
    "cosh(q)",
    "tanh(q)",
    "abs(q - 0.5)",
    "sign(q)*q",
    "atan2(q, p)",
    "atan2(p, q)",
    "min(q, p)",
    "max(q^2, p)",
    "q*sin(q)*exp(q)",
    "if q > 0.2 then q^2 else q",
    "sqrt(q^2 + p^2)",
    "(q + p)^3*(q - p)",
    "q/(p + q)",
    "exp(q*p)/(1 + q)",
    "log(cosh(q))",
];

#[test]
fn derivatives() {
    for text in SMOOTH {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(text), bench.symbol("q"));
        let d = bench.pool.derivative(e, q);
        for x in [0.31, 0.77, 1.3, 2.1] {
            // five points, error h^4
            let h = 1e-3;
            let f = |i: f64| bench.at(e, x + i * h);
            let numeric = (8.0 * (f(1.0) - f(-1.0)) - (f(2.0) - f(-2.0))) / (12.0 * h);
            let got = bench.at(d, x);
            assert!(
                (got - numeric).abs() <= 1e-8 * (1.0 + got.abs()),
                "{text} at {x}: {got}, {numeric}: {}",
                bench.pool.print(d)
            );
        }
    }
}

#[test]
fn derivative_text() {
    for (text, derivative) in [
        ("k*q^2/2", "k*q"),
        ("p^2/(2*m)", "0"),
        ("-b*cos(q)", "b*sin(q)"),
        ("exp(2*q)", "2*exp(2*q)"),
        ("if q > 0 then 0.5*k*q^2 else 0", "if q > 0 then k*q else 0"),
        ("abs(q)", "sign(q)"),
        ("sqrt(1 + q^2)", "q/sqrt(1 + q^2)"),
        ("sign(q)", "0"),
        ("q > 0", "0"),
    ] {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(text), bench.symbol("q"));
        let d = bench.pool.derivative(e, q);
        assert_eq!(bench.pool.print(d), derivative, "{text}");
    }
}

const INTEGRABLE: &[&str] = &[
    "0",
    "k",
    "q",
    "k*q",
    "k*q + b*q^3",
    "sqrt(1 + q)",
    "(2 - q)^-3",
    "1/(4 + 3*q)",
    "1/(1 + 4*q^2)",
    "sin(3*q)",
    "cos(q - 1)",
    "exp(-2*q)",
    "sinh(q)",
    "cosh(2*q)",
    "tanh(q/0.1)",
    "atan(3*q)",
    "tan(q/4)",
    "log(3 + q)",
    "abs(q)",
    "abs(q - 0.5)",
    "sign(q + 1)",
    "q*abs(q)",
    "sign(q)*sqrt(abs(q))",
    "k*sign(q)*abs(q)^1.5",
    "if q > 0 then k*q else 0",
    "if q > 0.5 then k*(q - 0.5) else 0",
    "if q < -0.5 then k*(q + 0.5) else if q > 0.5 then k*(q - 0.5) else 0",
    "if q <= 0.3 then 1 else 5",
    "max(q, 0)",
    "min(k*q, 1)",
    "max(q - 0.2, 0)^2",
    "(q > 0)*k*q",
    "(q + 1)*(q - 2)*(q + 3)",
    "(q + 1)^3*q",
    "q*exp(2*q)",
    "q^2*sin(q)",
    "q/sqrt(1 + q^2)",
    "q/(1 + q^2)",
    "q*exp(-q^2)",
    "q*(1 + q^2)^3",
    "p*q + sin(p)",
    "k*(exp(q/b) - 1)",
    "m^q",
    "(3 + q)^p",
    "min(max(q, -0.4), 0.6)",
    "sin(q)*cos(q)",
    "if p > 0 then q else 2*q",
    "k*max(q, 0)^1.5",
    "asin(q/4)",
    "abs(q)*abs(q - 0.9)",
    "sign(q)*max(abs(q) - 0.5, 0)",
    "k*sign(q)*max(0, abs(q) - 0.5)^1.5",
    "if abs(q) > 0.5 then k*(q - 0.5*sign(q)) else 0",
    "if q > 0.2 and q < 0.6 then 3 else 0",
    "if q < -0.2 or q > 0.6 then 3 else q",
    "if not (q > 0.2 and q < 0.6) then 3 else q",
    "if q^2 > 0.25 then q else 1",
    "if (q - 0.2)*(q + 0.5) > 0 then 1 else q",
    "if q^3 < -1 then 1 else q",
    "if 1/q > 2 then 1 else q",
    "if exp(q) > exp(0.2) then 1 else q",
    "if 3*tanh(q)^3 < 3*tanh(0.3)^3 then 1 else q",
    "if log(q + 3) > log(3.5) then q^2 else q",
    "if cosh(q) > cosh(0.5) and sinh(q) > sinh(-1) then 1 else q",
    "if sqrt(q + 2) > sqrt(1.5) then 1 else q",
    "max(min(q, 0.2), q^2)",
    "q*(if abs(q) < 0.5 then 1 else exp(-q))",
    "q/(3 + q)",
    "q^2/(3 + q)",
    "(q + 1)*sqrt(3 + q)",
    "q*(3 - q)^-1.4",
    "(2/(3 + q))^1.4",
    "(2/(3 + q))^p",
    "q*(2*p/(3 - q))^p",
    "q/(2 + abs(q))",
];

#[test]
fn antiderivatives() {
    for text in INTEGRABLE {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(text), bench.symbol("q"));
        let found = bench.pool.antiderivative(e, q);
        let Some(f) = found.or_else(|| bench.pool.cancelling_antiderivative(e, q)) else { panic!("{text}") };
        assert!(bench.at(f, 0.0).abs() < 1e-14, "{text}: {}", bench.pool.print(f));
        // the integral by Simpson's rule in pieces that end at the kinks used above
        let ends = [-1.2, -1.0, -0.5, -0.4, -0.2, 0.0, 0.1, 0.2, 0.3, 1.0 / 3.0, 0.5, 0.6, 0.9, 1.5];
        for pair in ends.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            if text.contains("sqrt(1 + q)") && a < -1.0 {
                continue;
            }
            let n = 400;
            let h = (b - a) / f64::from(n);
            // midpoints only, so that no kink is hit: the two-point Gauss rule in each piece
            let g = h / (2.0 * 3.0_f64.sqrt());
            let sum: f64 = (0..n)
                .map(|i| a + (f64::from(i) + 0.5) * h)
                .map(|x| (bench.at(e, x - g) + bench.at(e, x + g)) * h / 2.0)
                .sum();
            let got = bench.at(f, b) - bench.at(f, a);
            assert!(
                (got - sum).abs() <= 1e-5 * (1.0 + sum.abs()),
                "{text} from {a} to {b}: {got}, {sum}: {}",
                bench.pool.print(f)
            );
        }
    }
}

#[test]
fn energies() {
    for (law, energy) in [
        ("k*q", "k*q^2/2"),
        ("if q > 0 then k*q else 0", "if q > 0 then k*q^2/2 else 0"),
        ("sin(q)", "1 - cos(q)"),
        ("q^3", "q^4/4"),
        ("sign(q)", "abs(q)"),
        ("q*abs(q)", "abs(q)^3/3"),
    ] {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(law), bench.symbol("q"));
        let f = bench.pool.antiderivative(e, q).expect("integrable");
        assert_eq!(bench.pool.print(f), energy, "{law}");
    }
    for law in ["exp(q^2)", "sin(q)/q", "sin(q^2)", "if sin(q) > 0 then 1 else 0", "abs(sin(q))"] {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(law), bench.symbol("q"));
        assert_eq!(bench.pool.antiderivative(e, q), None, "{law}");
    }
}

/// Laws without a finite integral from 0: their energy has no constant.
#[test]
fn singular_at_zero() {
    for (law, energy) in [
        ("-1/q^2", "1/q"),
        ("3/q", "3*log(abs(q))"),
        ("1/q^2 - 2/q^3", "1/q^2 - 1/q"),
        ("q^-1.5", "-2/sqrt(q)"),
        ("(q - 1)/q^2", "1/q + log(abs(q))"),
    ] {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(law), bench.symbol("q"));
        let f = bench.pool.antiderivative(e, q).expect("integrable");
        assert_eq!(bench.pool.print(f), energy, "{law}");
        for x in [0.3, 0.7, 1.7, 3.0] {
            let h = 1e-3;
            let at = |i: f64| bench.at(f, x + i * h);
            let slope = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h);
            assert!((slope - bench.at(e, x)).abs() < 1e-6, "{law} at {x}: {slope}");
        }
    }
}

/// Far out, where a hyperbolic cosine has no value any more, and with all digits near 0.
#[test]
fn energy_of_a_steep_tanh() {
    let mut bench = Bench::new();
    let (e, q, from, delta) = (bench.read("tanh(q)"), bench.symbol("q"), bench.symbol("x"), bench.symbol("y"));
    let energy = bench.pool.antiderivative(e, q).expect("integrable");
    let (a, d) = (bench.pool.var(from), bench.pool.var(delta));
    let slope = bench.pool.difference(energy, q, a, d);
    for (start, step, wanted) in [
        (1e5, 1.0, 1.0),
        (-1e5, 1e5, -(1e5 - 2.0_f64.ln()) / 1e5),
        (299.9, 0.2, 1.0),
        (-301.0, 602.0, 0.0),
        (1e-9, 1e-9, 1.5e-9),
        (0.5, 1e-7, 0.500_000_05_f64.tanh()),
    ] {
        let found = bench.pool.eval(slope, &|v| if v == from { start } else { step });
        assert!((found - wanted).abs() <= 1e-14 * wanted.abs(), "{start} {step}: {found}");
    }
}

#[test]
fn substitution_is_simultaneous() {
    let mut bench = Bench::new();
    let (e, swapped) = (bench.read("x - 2*y"), bench.read("y - 2*x"));
    let (x, y) = (bench.symbol("x"), bench.symbol("y"));
    let map = [(x, bench.pool.var(y)), (y, bench.pool.var(x))].into_iter().collect();
    assert_eq!(bench.pool.substitute(e, &map), swapped);
    let (k, e, three) = (bench.symbol("k"), bench.read("k*x + k"), bench.read("3*x + 3"));
    let map = [(k, bench.pool.int(3))].into_iter().collect();
    assert_eq!(bench.pool.substitute(e, &map), three);
    assert!(close(1.0, 1.0, 0.0));
}
