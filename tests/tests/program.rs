//! Step programs.

use crate::common::{file, models, text};
use bond::internal::CompiledInternals;
use bond::{Compiled, Options};
use bond_runtime::ir::Inst;

#[test]
fn programs() {
    for (element, method) in [("C", "exact"), ("I", "gonzalez"), ("I", "euler")] {
        let compiled = file(&models().join(format!("elements/{element}.bond")), Options::new().method(method));
        insta::assert_snapshot!(format!("program_{element}_{method}"), compiled.show("program"));
    }
}

/// The double pendulum's energy and rates ask for sines and cosines of its two angles and of their difference, and
/// have those of the difference as products: two calls a stage, and two at the end.
#[test]
fn a_difference_of_angles_is_no_call() {
    let path = models().join("../cli/benches/limits/problems/pendulum2.bond");
    for (method, stages) in [("rk4", 4), ("dop853", 12)] {
        let text = file(&path, Options::new().method(method)).show("program");
        let calls = |name: &str| text.matches(&format!(" = {name} ")).count();
        assert_eq!([calls("sin"), calls("cos")], [2 * (stages + 1); 2], "{method}");
    }
}

/// A ladder's program grows with its cells, not with their square.
#[test]
fn the_program_of_a_ladder_grows_with_its_length() {
    let path = models().join("examples/rc_ladder.bond");
    let size = |n: &str| {
        let compiled = file(&path, Options::new().set("n", n).method("gonzalez"));
        compiled.show("program").lines().count()
    };
    let (small, large) = (size("50"), size("200"));
    assert!(large < 5 * small, "{small} lines for 50 cells, {large} for 200");
}

/// What compiling makes: expressions, and of each program its values, its instructions and the entries of its
/// Jacobians.
fn made(compiled: &Compiled) -> Vec<i64> {
    fn entries(body: &[Inst]) -> usize {
        let of = |inst: &Inst| match inst {
            Inst::Newton(newton) => newton.jacobian.len() + newton.body.len() + entries(&newton.body),
            Inst::Solve(solve) => solve.matrix.len(),
            Inst::Let(..) | Inst::Store(..) | Inst::MatVec { .. } | Inst::Quad { .. } => 0,
        };
        body.iter().map(of).sum()
    }
    let mut list = vec![compiled.stages().model.pool.len()];
    for c in &compiled.scene().clusters {
        for p in [&c.step.program, &c.instant, &c.stored] {
            list.extend([p.values as usize, p.body.len(), entries(&p.body)]);
        }
    }
    list.into_iter().map(|n| n as i64).collect()
}

/// Every cell of a graph costs the same, however many there are: what is made is linear in the number of cells of a
/// ladder and of a tree, and of degree 2 in the side of a mesh.
#[test]
fn what_is_made_is_linear_in_the_cells() {
    let cell = "I:l[k] = 10 mH\nC:c[k] { H = q^2/(2*C) + 1 V/C^3 * q^4 }\nR:r[k] = 20 mOhm\n\
                1:s[k] -> l[k]\ns[k] -> r[k]\ns[k] -> 0:p[k] -> c[k]";
    let ladder = |n: usize| {
        format!(
            "model Ladder(n = {n}, C = 10 mF) {{\nSe:u = 1 V\nR:load = 1 Ohm\nfor k in 1..n {{\n{cell}\n}}\n\
             u -> s[1]\nfor k in 2..n {{ p[k-1] -> s[k] }}\np[n] -> load\nsimulate {{ method = gonzalez }}\n}}"
        )
    };
    let tree = |n: usize| {
        format!(
            "model Tree(n = {n}, C = 10 mF) {{\nSe:u = 1 V\nfor k in 1..n {{\n{cell}\n}}\nu -> s[1]\nfor k in 1..n {{\n\
             if 2*k <= n {{ p[k] -> s[2*k] }}\nif 2*k + 1 <= n {{ p[k] -> s[2*k+1] }}\n}}\n\
             simulate {{ method = gonzalez }}\n}}"
        )
    };
    let mesh = |m: usize| {
        format!(
            "model Mesh(m = {m}) {{\nSe:u = 1 V\nR:feed = 1 Ohm\nu -> 1:in -> feed\nin -> p[1,1]\n\
             for i in 1..m {{ for j in 1..m {{\n0:p[i,j]\nC:c[i,j] = 10 mF\nR:g[i,j] = 100 Ohm\n\
             p[i,j] -> c[i,j]\np[i,j] -> g[i,j]\n}} }}\n\
             for i in 1..m {{ for j in 2..m {{\nI:x[i,j] = 10 mH\np[i,j-1] -> 1:a[i,j] -> p[i,j]\na[i,j] -> x[i,j]\n}} }}\n\
             for i in 2..m {{ for j in 1..m {{\nI:y[i,j] = 10 mH\np[i-1,j] -> 1:b[i,j] -> p[i,j]\nb[i,j] -> y[i,j]\n}} }}\n\
             simulate {{ method = gonzalez }}\n}}"
        )
    };
    // The differences of an order that vanish for a polynomial of a lower degree, with their coefficients.
    let vanish = |source: &dyn Fn(usize) -> String, at: &[(usize, i64)]| {
        let all: Vec<(Vec<i64>, i64)> = at.iter().map(|&(n, k)| (made(&text(&source(n))), k)).collect();
        let sums = (0..all[0].0.len()).map(|i| all.iter().map(|(counts, k)| k * counts[i]).sum::<i64>());
        assert!(sums.clone().all(|s| s == 0), "{:?} of {all:?}", sums.collect::<Vec<_>>());
    };
    // The indices are numbers too, and expressions: more than any other number here.
    vanish(&ladder, &[(110, 1), (210, -2), (310, 1)]);
    vanish(&tree, &[(111, 1), (211, -2), (311, 1)]);
    vanish(&mesh, &[(11, 1), (13, -3), (15, 3), (17, -1)]);
}
