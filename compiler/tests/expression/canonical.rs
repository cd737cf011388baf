//! Equal expressions are one.

use super::Bench;
use bond_compiler::expression::{Node, Number};
use bond_runtime::ir::Unary;

#[test]
fn equal() {
    for (a, b) in [
        ("x - x", "0"),
        ("x*0", "0"),
        ("x/x", "1"),
        ("-(-x)", "x"),
        ("x + y", "y + x"),
        ("x*y", "y*x"),
        ("(x + y) + q", "x + (y + q)"),
        ("2*(x + y)", "2*x + 2*y"),
        ("(2*x + 2*y)/(x + y)", "2"),
        ("x*x", "x^2"),
        ("x^2*x^-2", "1"),
        ("sqrt(x)*sqrt(x)", "x"),
        ("sqrt(x)^2", "x"),
        ("sqrt(x^2)", "abs(x)"),
        ("sqrt(4*x)", "2*sqrt(x)"),
        ("sqrt(k^2*x)", "k*sqrt(x)"),
        ("abs(x)^2", "x^2"),
        ("(x - y)^2", "(y - x)^2"),
        ("(x - y)*(y - x)", "-(x - y)^2"),
        ("(x*y)^3", "x^3*y^3"),
        ("(x^2)^3", "x^6"),
        ("(k^x)^y", "k^(x*y)"),
        ("0.5*x", "x/2"),
        ("0.1 + 0.2", "0.3"),
        // What is not exact may cancel but for its rounding, which is nothing.
        ("0.18000000000000005 - 0.6*0.30000000000000004 + x", "x"),
        ("0.30000000000000004*x + 0.7*y - 0.1*x - 0.2*x", "0.7*y"),
        ("1/3 + 1/6", "1/2"),
        ("sin(-x)", "-sin(x)"),
        ("cos(-x)", "cos(x)"),
        ("abs(-2*x)", "2*abs(x)"),
        ("abs(k*q^2)", "abs(k)*q^2"),
        ("sign(k*x)", "sign(3*k*x)"),
        ("log(exp(x))", "x"),
        ("exp(0)", "1"),
        ("cos(0)", "1"),
        ("2^10", "1024"),
        ("4^0.5", "2"),
        ("(4/9)^1.5", "8/27"),
        ("if 1 < 2 then x else y", "x"),
        ("if k > 0 then x else y", "x"),
        ("if x > 0 then y else y", "y"),
        ("if not (x > 0) then q else y", "if x > 0 then y else q"),
        ("if x > 0 then if x > 0 then q else p else y", "if x > 0 then q else y"),
        ("min(x, x)", "x"),
        ("min(k, m)", "m"),
        ("max(x, y)", "max(y, x)"),
        ("x < x", "0"),
        ("x <= x", "1"),
        ("x > 0 and 1 > 0", "x > 0"),
        ("x > 0 or 1 > 0", "1"),
        ("not not (x > 0)", "x > 0"),
        ("p^2/(2*m)", "0.5*p*p/m"),
        ("x^0", "1"),
        ("1^x", "1"),
        ("exp(x)^0.5", "exp(x/2)"),
    ] {
        let mut bench = Bench::new();
        let (left, right) = (bench.read(a), bench.read(b));
        assert_eq!(left, right, "{a} = {} but {b} = {}", bench.pool.print(left), bench.pool.print(right));
    }
}

#[test]
fn different() {
    for (a, b) in [
        ("sqrt(x^2)", "x"),
        ("(x^2)^0.5", "x"),
        ("(x^0.5)^2", "abs(x)"),
        ("x*(y + q)", "x*y + x*q"),
        ("(x^y)^0.5", "x^(y/2)"),
        ("abs(x)", "x"),
        ("k", "3"),
        ("not not x", "x"),
    ] {
        let mut bench = Bench::new();
        let (left, right) = (bench.read(a), bench.read(b));
        assert_ne!(left, right, "{a} and {b}");
    }
}

#[test]
fn values_are_kept() {
    // the canonical form of random combinations has the value of the combination
    let mut state = 1_u64;
    let mut next = move |n: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    };
    for _ in 0..300 {
        let mut bench = Bench::new();
        let mut all: Vec<(bond_compiler::expression::Expr, f64)> = Vec::new();
        for (text, value) in
            [("q", 0.9), ("p", 0.8), ("k", 3.0), ("m", 2.0), ("3", 3.0), ("-0.5", -0.5), ("2/3", 2.0 / 3.0)]
        {
            all.push((bench.read(text), value));
        }
        for _ in 0..25 {
            let (a, x) = all[next(all.len() as u64) as usize];
            let (b, y) = all[next(all.len() as u64) as usize];
            let pool = &mut bench.pool;
            let (e, z) = match next(9) {
                0 => (pool.add(a, b), x + y),
                1 => (pool.sub(a, b), x - y),
                2 => (pool.mul(a, b), x * y),
                3 => (pool.div(a, b), x / y),
                4 => (pool.powi(a, 2), x * x),
                5 => (pool.powi(a, -3), x.powi(-3)),
                6 => {
                    let size = pool.unary(Unary::Abs, a);
                    (pool.sqrt(size), x.abs().sqrt())
                }
                7 => (pool.unary(Unary::Sin, a), x.sin()),
                _ => {
                    let square = pool.powi(a, 2);
                    let three = pool.ratio(3, 2);
                    (pool.pow(square, three), x.abs().powi(3))
                }
            };
            if z.is_finite() && z.abs() < 1e6 && (z == 0.0 || z.abs() > 1e-3) {
                all.push((e, z));
            }
        }
        for &(e, z) in &all {
            let got = bench.at(e, 0.9);
            assert!((got - z).abs() <= 1e-6 * z.abs().max(1e-3), "{}: {got} and {z}", bench.pool.print(e));
        }
    }
}

#[test]
fn numbers() {
    assert_eq!(Number::decimal("0.5"), Some(Number::ratio(1, 2)));
    assert_eq!(Number::decimal("1.5e3"), Some(Number::ratio(1500, 1)));
    assert_eq!(Number::decimal("1e-3"), Some(Number::ratio(1, 1000)));
    assert_eq!(Number::decimal("1e300"), Some(Number::float(1e300)));
    assert_eq!(Number::decimal("x"), None);
    assert_eq!(Number::decimal("1.602176634e-19").map(Number::to_f64), Some(1.602176634e-19));
    assert_eq!(Number::ratio(1, 10).to_f64(), 0.1);
    assert_eq!(Number::ratio(i64::MAX, 3).to_f64(), i64::MAX as f64 / 3.0);
    assert_eq!(Number::ratio(6, -4), Number::ratio(-3, 2));
    assert_eq!(Number::ratio(1, 0).to_f64(), f64::INFINITY);
    let big = Number::from(i64::MAX) + Number::ONE;
    assert_eq!(big.to_f64(), i64::MAX as f64);
    assert!(!big.is_exact());
    assert_eq!((Number::float(f64::NAN) * Number::ZERO).to_f64().to_bits(), f64::NAN.to_bits());
    // quotients of large integers, against long division
    for (n, d, exact) in
        [(9_007_199_254_740_993, 1, 9_007_199_254_740_992.0), (9_223_372_036_854_775_807, 7, 1317624576693539401.0)]
    {
        assert_eq!(Number::ratio(n, d).to_f64(), exact);
    }
}

#[test]
fn nothing_panics_at_the_edge() {
    let mut bench = Bench::new();
    for text in [
        "0/0",
        "1/0",
        "x/0",
        "0^0",
        "0^-1",
        "x^1e300",
        "1e300*1e300*x",
        "sqrt(-1)",
        "log(0)",
        "(x/0)^2 + x/0",
        "(-8)^(1/3)",
        "abs(sqrt(-1)*x)",
        "abs(1e300*1e300*x)",
        "sign(1e-320*x) + abs(1e-320*x)",
    ] {
        let e = bench.read(text);
        let q = bench.symbol("x");
        let d = bench.pool.derivative(e, q);
        let _ = (bench.pool.print(e), bench.pool.print(d), bench.at(d, 1.0), bench.pool.latex(d));
    }
    let zero = bench.pool.int(0);
    let nothing = bench.pool.sum(&[]);
    assert_eq!(zero, nothing);
    let one = bench.pool.product(&[]);
    assert!(bench.pool.is_one(one));
}

#[test]
fn symbols() {
    let mut bench = Bench::new();
    let e = bench.read("k*x + y^2 - m");
    assert_eq!(bench.pool.symbols(e), [bench.symbol("x"), bench.symbol("y")]);
    assert!(bench.pool.contains(e, bench.symbol("y")));
    assert!(!bench.pool.contains(e, bench.symbol("q")));
    assert!(!bench.pool.contains(e, bench.symbol("k")));
    let e = bench.read("k*m + 1");
    assert_eq!(bench.pool.constant(e), Some(7.0));
    assert_eq!(bench.pool.number(e), None);
    assert!(matches!(bench.pool.node(e), Node::Sum(..)));
}

#[test]
fn deep_and_wide() {
    let mut bench = Bench::new();
    let q = bench.symbol("q");
    let start = bench.read("q");
    let mut e = start;
    for _ in 0..100_000 {
        e = bench.pool.unary(Unary::Sin, e);
        e = bench.pool.add(e, start);
    }
    let d = bench.pool.derivative(e, q);
    assert!(bench.at(d, 0.3).is_finite());
    let map = [(q, bench.pool.int(0))].into_iter().collect();
    let zero = bench.pool.substitute(e, &map);
    assert!(bench.pool.is_zero(zero));
    assert_eq!(bench.pool.symbols(d), [q]);
    assert_eq!(bench.pool.sign(e, &|_| bond_compiler::expression::Sign::Zero), bond_compiler::expression::Sign::Zero);

    // a hundred thousand storages
    let all: Vec<_> = (0..100_000).map(|i| bench.pool.symbol(&format!("q{i}"))).collect();
    let terms: Vec<_> = all
        .iter()
        .map(|&s| {
            let x = bench.pool.var(s);
            let square = bench.pool.powi(x, 2);
            let k = bench.pool.ratio(3, 2);
            bench.pool.mul(k, square)
        })
        .collect();
    let energy = bench.pool.sum(&terms);
    assert_eq!(bench.pool.symbols(energy).len(), 100_000);
    let gradient = bench.pool.gradient(energy, &all);
    assert_eq!(gradient.len(), 100_000);
    let efforts: Vec<_> = gradient.iter().map(|&(_, e)| e).collect();
    let total = bench.pool.sum(&efforts);
    let (coefficients, rest) = bench.pool.affine(total, &all).expect("affine");
    assert_eq!(coefficients.len(), 100_000);
    assert!(bench.pool.is_zero(rest));
    let (square, linear, _) = bench.pool.quadratic(energy, &all).expect("quadratic");
    assert_eq!((square.len(), linear.len()), (100_000, 0));
}
