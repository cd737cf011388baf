//! Text of expressions, and back.

use super::{Bench, close};
use proptest::prelude::*;

#[test]
fn natural() {
    for (text, printed) in [
        ("p^2/(2*m)", "p^2/(2*m)"),
        ("0.5*k*q^2", "k*q^2/2"),
        ("-k*q", "-k*q"),
        ("q*-k + 1", "1 - k*q"),
        ("q - k", "q - k"),
        ("-q - k", "-k - q"),
        ("sqrt(q)", "sqrt(q)"),
        ("1/sqrt(q)", "1/sqrt(q)"),
        ("x/y", "x/y"),
        ("x/(y*q)", "x/(q*y)"),
        ("(x + y)*q", "q*(x + y)"),
        ("x/(x + y)", "x/(x + y)"),
        ("q^1.5", "q^1.5"),
        ("q^(1/3)", "q^(1/3)"),
        ("q^-2", "1/q^2"),
        ("(-q)^p", "(-q)^p"),
        ("2^-q", "2^(-q)"),
        ("if q > 0 then k*q else 0", "if q > 0 then k*q else 0"),
        ("2*(if q > 0 then k else 0)", "2*(if q > 0 then k else 0)"),
        ("if q > 0 then (if p > 0 then 1 else 2) else 3", "if q > 0 then (if p > 0 then 1 else 2) else 3"),
        ("sin(if q > 0 then 1 else p)", "sin(if q > 0 then 1 else p)"),
        ("q <= 1", "q <= 1"),
        ("1 <= q", "q >= 1"),
        ("q > 0 and p > 0 or x > 0", "p > 0 and q > 0 or x > 0"),
        ("not (q > 0)", "not (q > 0)"),
        ("pi*q", "pi*q"),
        ("0.35*q", "0.35*q"),
        ("q/1000", "q/1000"),
        ("2*q/3", "2*q/3"),
        ("2/3", "2/3"),
        ("-2/3", "-2/3"),
        ("0.25", "0.25"),
        ("1e-12*q", "q/1000000000000"),
        ("1e300*q", "1e300*q"),
        ("min(q, p)", "min(p, q)"),
        ("atan2(q, -p)", "atan2(q, -p)"),
        ("abs(q)", "abs(q)"),
        ("(q + 1)^2", "(1 + q)^2"),
        ("exp(-q)", "exp(-q)"),
        ("1 - exp(-q/m)", "1 - exp(-q/m)"),
        ("(x*y)^0.5", "sqrt(x*y)"),
    ] {
        let mut bench = Bench::new();
        let e = bench.read(text);
        assert_eq!(bench.pool.print(e), printed, "{text}");
    }
}

#[test]
fn formulas() {
    let mut bench = Bench::new();
    for (text, formula) in [
        ("p^2/(2*m)", r"\frac{p^{2}}{2\,m}"),
        ("k*sqrt(q)", r"k\,\sqrt{q}"),
        ("-k*sin(q)", r"-k\,\sin\left(q\right)"),
        ("(x + y)^2", r"\left(x + y\right)^{2}"),
    ] {
        let e = bench.read(text);
        assert_eq!(bench.pool.latex(e), formula, "{text}");
    }
    for (name, formula) in [
        ("spring.q", r"q_{\mathrm{spring}}"),
        ("omega", r"\omega"),
        ("k_wall", r"k_{\mathrm{wall}}"),
        ("arm.p1", r"p_{\mathrm{arm},1}"),
        ("mass", r"\mathrm{mass}"),
    ] {
        let s = bench.pool.symbol(name);
        let e = bench.pool.var(s);
        assert_eq!(bench.pool.latex(e), formula);
    }
}

/// Texts of random expressions.
fn text() -> impl Strategy<Value = String> {
    let leaf = prop_oneof![
        Just("q".to_string()),
        Just("p".to_string()),
        Just("x".to_string()),
        Just("k".to_string()),
        Just("m".to_string()),
        Just("pi".to_string()),
        (1..30_i32, 1..30_i32).prop_map(|(a, b)| format!("{a}/{b}")),
        (0.01..1e4_f64).prop_map(|x| format!("{x:?}")),
        (1..99_i32).prop_map(|x| format!("{}", f64::from(x) / 100.0)),
    ];
    leaf.prop_recursive(5, 40, 3, |inner| {
        let pair = (inner.clone(), inner.clone());
        prop_oneof![
            (pair.clone(), prop::sample::select(vec!["+", "-", "*", "/"]))
                .prop_map(|((a, b), op)| format!("({a}) {op} ({b})")),
            (inner.clone(), prop::sample::select(vec!["2", "3", "-1", "-2", "0.5", "1.5", "(1/3)", "q", "m"]))
                .prop_map(|(a, n)| format!("({a})^{n}")),
            (inner.clone(), prop::sample::select(vec!["sin", "exp", "abs", "tanh", "sqrt", "-", "atan", "sign"]))
                .prop_map(|(a, f)| format!("{f}({a})")),
            (pair.clone(), prop::sample::select(vec!["min", "max", "atan2"]))
                .prop_map(|((a, b), f)| format!("{f}({a}, {b})")),
            (inner.clone(), inner.clone(), inner, prop::sample::select(vec!["<", "<=", ">", ">=", "==", "!="]))
                .prop_map(|(a, b, c, op)| format!("(if ({a}) {op} ({b}) and not ({c} > 1) then ({b}) else ({c}))")),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn reads_back(text in text()) {
        let mut bench = Bench::new();
        let e = bench.read(&text);
        let printed = bench.pool.print(e);
        let again = bench.read(&printed);
        for q in [0.3, -1.1] {
            let (a, b) = (bench.at(e, q), bench.at(again, q));
            prop_assert!(close(a, b, 1e-9) || a.abs() > 1e12, "{text}: {printed}: {a} and {b}");
        }
    }

    #[test]
    fn is_stable(text in text()) {
        // what was printed is read as a product of its printed factors, and stays so
        let mut bench = Bench::new();
        let e = bench.read(&text);
        let first = bench.pool.print(e);
        let e = bench.read(&first);
        let second = bench.pool.print(e);
        let e = bench.read(&second);
        prop_assert_eq!(bench.pool.print(e), second);
    }
}
