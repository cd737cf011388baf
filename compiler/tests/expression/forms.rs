//! Affine and quadratic forms, signs, dissipative laws.

use super::Bench;
use bond_compiler::expression::Sign;

#[test]
fn affine() {
    for (text, expected) in [
        ("3*x + k*y - m", Some("k*y + 3*x - m")),
        ("k*(x + b*(y - x))", Some("x*(k - b*k) + b*k*y")),
        ("p*x", Some("p*x")),
        ("x/p + p^2", Some("")),
        ("x*y", None),
        ("x^2", None),
        ("sin(x)", None),
        ("if p > 0 then k*x else y", Some("")),
        ("if x > 0 then x else 0", None),
        ("q", Some("q")),
        ("abs(x)", None),
        ("1/x", None),
    ] {
        let mut bench = Bench::new();
        let e = bench.read(text);
        let symbols = [bench.symbol("x"), bench.symbol("y")];
        let found = bench.pool.affine(e, &symbols);
        assert_eq!(found.is_some(), expected.is_some(), "{text}");
        let Some((coefficients, mut sum)) = found else { continue };
        for (i, a) in coefficients {
            assert!(symbols.iter().all(|&s| !bench.pool.contains(a, s)), "{text}");
            let x = bench.pool.var(symbols[i]);
            let term = bench.pool.mul(a, x);
            sum = bench.pool.add(sum, term);
        }
        for at in [0.4, -1.7] {
            let (a, b) = (bench.at(e, at), bench.at(sum, at));
            assert!((a - b).abs() < 1e-14, "{text}: {}", bench.pool.print(sum));
        }
    }
}

#[test]
fn quadratic() {
    for (text, is) in [
        ("k*x^2/2 + x*y - y + 3", true),
        ("k*(x - y)^2/2 + p*(x + 1)*(y - 2)", true),
        ("q^3 + x", true),
        ("x*y*(x + 1)", false),
        ("x^3", false),
        ("if p > 0 then x^2 else y^2 + 1", true),
        ("0", true),
        ("cos(x)", false),
    ] {
        let mut bench = Bench::new();
        let e = bench.read(text);
        let symbols = [bench.symbol("x"), bench.symbol("y")];
        let found = bench.pool.quadratic(e, &symbols);
        assert_eq!(found.is_some(), is, "{text}");
        let Some((square, linear, mut sum)) = found else { continue };
        let x = symbols.map(|s| bench.pool.var(s));
        for (i, j, a) in square {
            assert!(i <= j);
            let term = bench.pool.product(&[a, x[i], x[j]]);
            sum = bench.pool.add(sum, term);
        }
        for (i, a) in linear {
            let term = bench.pool.mul(a, x[i]);
            sum = bench.pool.add(sum, term);
        }
        let (a, b) = (bench.at(e, 0.3), bench.at(sum, 0.3));
        assert!((a - b).abs() < 1e-14, "{text}: {}", bench.pool.print(sum));
    }
}

#[test]
fn linear() {
    let mut bench = Bench::new();
    let (e, q) = (bench.read("k*q + p"), bench.symbol("q"));
    let (a, b) = bench.pool.linear(e, q).expect("linear");
    assert_eq!((bench.pool.print(a), bench.pool.print(b)), ("k".into(), "p".into()));
    let e = bench.read("p");
    let (a, _) = bench.pool.linear(e, q).expect("linear");
    assert!(bench.pool.is_zero(a));
}

#[test]
fn signs() {
    for (text, sign) in [
        ("q^2", Sign::NonNegative),
        ("1 + q^2", Sign::Positive),
        ("-k*q^2", Sign::NonPositive),
        ("exp(q)", Sign::Positive),
        ("abs(q) + sqrt(abs(p))", Sign::NonNegative),
        ("k", Sign::Positive),
        ("b - k", Sign::Negative),
        ("q", Sign::Unknown),
        ("q^3", Sign::Unknown),
        ("x*y", Sign::Unknown),
        ("if q > 0 then 1 else 0", Sign::NonNegative),
        ("1 - cos(q)", Sign::NonNegative),
        ("2 + sin(q)", Sign::Positive),
        ("1 - tanh(q)^2", Sign::NonNegative),
        ("cosh(q) - 1", Sign::NonNegative),
        ("max(q, 1)", Sign::Positive),
        ("min(q, 0)", Sign::NonPositive),
        ("q^2/(1 + q^2)", Sign::NonNegative),
        ("0", Sign::Zero),
        ("0/0", Sign::Unknown),
        ("q - q^2", Sign::Unknown),
        ("1/q", Sign::Unknown),
        ("sqrt(q)", Sign::NonNegative),
    ] {
        let mut bench = Bench::new();
        let e = bench.read(text);
        assert_eq!(bench.pool.sign(e, &|_| Sign::Unknown), sign, "{text}");
    }
    let mut bench = Bench::new();
    let e = bench.read("q^3*p");
    assert_eq!(bench.pool.sign(e, &|_| Sign::Negative), Sign::Positive);
}

#[test]
fn laws() {
    for (text, expected) in [
        ("k*q", Some(true)),
        ("-k*q", Some(false)),
        ("q^3", Some(true)),
        ("0", Some(true)),
        ("sign(q)*sqrt(abs(q))", Some(true)),
        ("k*q*abs(q)", Some(true)),
        ("b*sign(q) + k*q", Some(true)),
        ("1e-12*(exp(q/0.025) - 1)", Some(true)),
        ("b*(exp(40*q) - 1) + q", Some(true)),
        ("k*tanh(q/0.01)", Some(true)),
        ("if q > 0 then k*q else 0", Some(true)),
        ("if q > 0 then k*q else b*q", Some(true)),
        ("if p > 0 then b*q else 0", Some(true)),
        ("if q > 1 then k*(q - 1) else 0", Some(true)),
        ("q*(1 + p^2)", Some(true)),
        ("p*q", None),
        ("q + p", None),
        ("1", Some(false)),
        ("q - 5", Some(false)),
        ("q^2", Some(false)),
        ("sin(q)", Some(false)),
        ("q/(1 + q^2)", Some(true)),
        ("1/(1 - q) - 1", Some(false)),
        ("max(q, 0)", Some(true)),
        ("if q < 1 then q else q - 5", Some(false)),
        ("(b + k*exp(-q^2))*sign(q)", Some(true)),
        ("sinh(q) + atan(q)", Some(true)),
        ("-1/q", Some(false)),
        ("q^3 - q", Some(false)),
        ("q - sin(q)", Some(true)),
    ] {
        let mut bench = Bench::new();
        let (e, q) = (bench.read(text), bench.symbol("q"));
        assert_eq!(bench.pool.dissipative(e, q), expected, "{text}");
    }
}
