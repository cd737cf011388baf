//! Sums with common factors taken out.

use super::{Bench, close};
use proptest::prelude::*;
use rustc_hash::FxHashSet;

/// The expression with what terms with `q` and `p` have in common taken out.
fn factored(bench: &mut Bench, text: &str) -> bond_compiler::expression::Expr {
    let e = bench.read(text);
    let variables: FxHashSet<_> = ["q", "p"].into_iter().map(|name| bench.symbol(name)).collect();
    bench.pool.factored(&[e], &variables, false)[0]
}

#[test]
fn once_is_enough() {
    for (text, wanted) in [
        ("q*x + q*y", "q*(x + y)"),
        ("q^3 + p^2*q/4 + q", "q*(1 + q^2 + p^2/4)"),
        ("q - 2*q^2 + 3*q^3", "q*(1 - q*(2 - 3*q))"),
        ("-q*p - q^2*p", "-p*q*(1 + q)"),
        ("x + sin(q)*x + sin(q)*y", "x + (x + y)*sin(q)"),
        ("1/(q*x + q*y)", "1/(q*(x + y))"),
        // What does not move costs nothing where it stands.
        ("x*q + x*p", "q*x + p*x"),
        ("q/p + x/p", "q/p + x/p"),
    ] {
        let mut bench = Bench::new();
        let (found, wanted) = (factored(&mut bench, text), bench.read(wanted));
        assert_eq!(bench.pool.print(found), bench.pool.print(wanted), "{text}");
    }
}

/// A sum of so many terms that the form would be nested too deep stays a sum.
#[test]
fn long_sums_stay() {
    let text: Vec<String> = (1..100).map(|n| format!("q^{n}")).collect();
    let mut bench = Bench::new();
    let e = bench.read(&text.join(" + "));
    assert_eq!(factored(&mut bench, &text.join(" + ")), e);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn values_stay(terms in proptest::collection::vec((1..9_i32, 0..4_i32, 0..4_i32, 0..3_i32, any::<bool>()), 1..12)) {
        let term = |(n, q, p, x, root): &(i32, i32, i32, i32, bool)| {
            let root = if *root { "*sqrt(q + p*q)" } else { "" };
            format!("{n}*q^{q}*p^{p}*x^{x}{root}")
        };
        let text = terms.iter().map(term).collect::<Vec<_>>().join(" + ");
        let mut bench = Bench::new();
        let (e, found) = (bench.read(&text), factored(&mut bench, &text));
        for q in [0.3, 1.7] {
            let (a, b) = (bench.at(e, q), bench.at(found, q));
            prop_assert!(close(a, b, 1e-14), "{text}: {a} and {b}");
        }
    }
}
