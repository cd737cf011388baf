//! Programs from expressions compute the expressions' values.

use super::{Bench, close};
use bond_compiler::expression::Lowering;
use bond_runtime::ir::{Array, Builder, Inst, Op};
use bond_runtime::{Interpreter, Kernel};

const TEXTS: &[&str] = &[
    "3",
    "k*m",
    "q",
    "-q",
    "k*q - p/m + 1",
    "1 - q - p",
    "-q - p",
    "p^2/(2*m) + k*q^2/2",
    "q^5 + q^-3 + q^2.5 + q^-0.5 + q^(1/3) + q^100",
    "sin(q)*exp(-p)/(1 + q^2)",
    "if q > 0.5 then q else -p",
    "min(q, p) + max(q, p) + atan2(q, p) + abs(q - 1)",
    "q > 0 and p < 1 or not (q == p)",
    "q^p + k^q",
    "1/q",
    "x*y/(q*p)",
    "1e300*q*1e-200",
    "-(k*q)/2 - sqrt(q*k)",
];

#[test]
fn values() {
    for text in TEXTS {
        let mut bench = Bench::new();
        let e = bench.read(text);
        let mut builder = Builder::new("test");
        let env: Vec<_> = ["q", "p", "x", "y"]
            .iter()
            .map(|name| {
                let slot = builder.named(Array::Input, *name);
                (bench.symbol(name), builder.load(slot))
            })
            .collect();
        let out = builder.slot(Array::Output);
        let value = Lowering::new(env).lower(&bench.pool, &mut builder, e).expect("bound");
        builder.store(out, value);
        let program = builder.finish();
        let kernel = Interpreter::new(&program);
        let mut work = kernel.workspace();
        let input = [0.9, 0.7 + 0.1, 0.7 + 0.2, 0.7 + 0.1 * 3.0];
        kernel.run(&[], &input, &[], &mut work).expect("runs");
        let expected = bench.at(e, 0.9);
        assert!(close(work.output[0], expected, 1e-14), "{text}: {} and {expected}", work.output[0]);
    }
}

/// How many operations there are besides constants and loads.
fn operations(text: &str) -> usize {
    let mut bench = Bench::new();
    let e = bench.read(text);
    let mut builder = Builder::new("test");
    let env: Vec<_> = ["q", "p"]
        .iter()
        .map(|name| {
            let slot = builder.slot(Array::Input);
            (bench.symbol(name), builder.load(slot))
        })
        .collect();
    let value = Lowering::new(env).lower(&bench.pool, &mut builder, e).expect("bound");
    let slot = builder.slot(Array::Output);
    builder.store(slot, value);
    let program = builder.finish();
    let counts = |inst: &&Inst| matches!(inst, Inst::Let(_, op) if !matches!(op, Op::Const(_) | Op::Load(_)));
    program.body.iter().filter(counts).count()
}

#[test]
fn few_operations() {
    for (text, count) in [
        ("k*m + 1", 0),
        ("k*q", 1),
        ("k*m*q/2", 1),
        ("p/m", 1),
        ("p^2/(2*m)", 2),
        ("k*q + m*p", 3),
        ("q^2.5", 3),
        ("q - p", 1),
        ("-q", 1),
        ("k*q^2/2 + p^2/(2*m)", 5),
        ("q/p", 1),
        ("k/p", 1),
    ] {
        assert_eq!(operations(text), count, "{text}");
    }
}

#[test]
fn unbound() {
    let mut bench = Bench::new();
    let e = bench.read("q + p");
    let q = bench.symbol("q");
    let mut builder = Builder::new("test");
    let slot = builder.slot(Array::Input);
    let value = builder.load(slot);
    assert_eq!(Lowering::new([(q, value)]).lower(&bench.pool, &mut builder, e), Err(bench.symbol("p")));
}
