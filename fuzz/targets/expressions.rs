//! Any text as an expression.
//!
//! Its canonical form has the value of the tree as it is written, wherever that is known. So has what is printed and
//! read again, what is factored, and what is lowered to a step program. Its divided difference closes the balance:
//! times the step it is what the value changes by. Derivatives and antiderivatives are taken.
#![no_main]

use bond_compiler::expression::{Expr, Lowering, Pool, Symbol};
use bond_fuzz::bounded::{self, Bounded, GRAIN};
use bond_fuzz::{check_diagnostics, mutate, seeds};
use bond_grammar::ast::{self, ExprKind};
use bond_grammar::source::Sources;
use bond_runtime::ir::{Array, Binary, Builder, Unary};
use bond_runtime::{Interpreter, Kernel};
use libfuzzer_sys::{fuzz_mutator, fuzz_target};

/// Nodes of the largest tree that is looked at.
const MOST: usize = 60;
/// The variables, and the places that are looked at.
const VARIABLES: [&str; 4] = ["q", "p", "x", "y"];
const PLACES: [[f64; 4]; 4] =
    [[0.9, 0.8, 0.7, 0.6], [-1.3, 0.4, 2.5, -0.2], [0.03, -40.0, 1.0, 0.0], [17.0, 1e-3, -0.5, 3.0]];
/// How far `q` goes for a divided difference.
const DELTAS: [f64; 3] = [0.37, -1e-3, 1e-9];
/// How many times as much as values a change may be off by.
const LOST: f64 = 100.0;
/// Parameters and their values.
const PARAMETERS: [(&str, f64); 3] = [("k", 3.0), ("m", 2.0), ("b", 0.5)];

/// Words and signs of expressions.
const PIECES: [&str; 48] = [
    "q",
    "p",
    "x",
    "y",
    "k",
    "m",
    "b",
    "pi",
    "+",
    "-",
    "*",
    "/",
    "^",
    "(",
    ")",
    ",",
    "<",
    "<=",
    ">",
    ">=",
    "==",
    "!=",
    "and",
    "or",
    "not",
    "true",
    "false",
    "if q > 0 then",
    "then",
    "else",
    "sin(",
    "cos(",
    "tan(",
    "exp(",
    "log(",
    "sqrt(",
    "abs(",
    "sign(",
    "atan(",
    "tanh(",
    "cosh(",
    "sinh(",
    "asin(",
    "floor(",
    "min(",
    "max(",
    "atan2(",
    "^-0.5",
];

/// Expressions to begin with.
const SEEDS: [&str; 24] = [
    "p^2/(2*m) + k*q^2/2",
    "if q > 0 then 0.5*k*q^2 else 0",
    "sqrt(q^2 + p^2)",
    "log(cosh(q))",
    "sin(q)*exp(-p)/(1 + q^2)",
    "min(q, p) + max(q^2, p) + atan2(q, p) + abs(q - 1)",
    "q > 0 and p < 1 or not (q == p)",
    "q^p + k^q",
    "q^5 + q^-3 + q^2.5 + q^-0.5 + q^(1/3) + q^100",
    "k*sign(q)*abs(q)^1.5",
    "k*max(q, 0)^1.5",
    "sign(q)*max(abs(q) - 0.5, 0)",
    "if q < -0.5 then k*(q + 0.5) else if q > 0.5 then k*(q - 0.5) else 0",
    "(2/(3 + q))^1.4",
    "1e300*q*1e-200",
    "exp(x)^0.5*(x*y)^3",
    "abs(k*q^2)*sqrt(4*x)/(x - y)^2",
    "(2*x + 2*y)/(x + y)",
    "0.18000000000000005 - 0.6*0.30000000000000004 + x",
    "tan(q/2) + asin(q/3) - acos(q/3)",
    "floor(q) + floor(-p)",
    "1 - 2*sin(q)^2 - cos(q)^2",
    "q/sqrt(1 + q^2)*tanh(q/0.1)",
    "if not (q > 0.2 and q < 0.6) then 3 else q",
];

/// The names in a pool.
struct Names {
    all: Vec<(&'static str, Symbol)>,
}

impl Names {
    fn new(pool: &mut Pool) -> Self {
        let mut all: Vec<_> = VARIABLES.iter().map(|name| (*name, pool.symbol(name))).collect();
        all.extend(PARAMETERS.iter().map(|(name, value)| (*name, pool.parameter(name, *value))));
        Self { all }
    }

    fn symbol(&self, name: &str) -> Option<Symbol> {
        self.all.iter().find(|(n, _)| *n == name).map(|(_, s)| *s)
    }

    /// What a variable is at a place.
    fn at(&self, place: &[f64; 4], s: Symbol) -> f64 {
        VARIABLES.iter().zip(place).find(|(name, _)| self.symbol(name) == Some(s)).map_or(f64::NAN, |(_, x)| *x)
    }
}

/// What a name is at a place.
fn named(place: &[f64; 4], name: &str) -> Option<f64> {
    let variable = VARIABLES.iter().position(|n| *n == name).map(|i| place[i]);
    let parameter = || PARAMETERS.iter().find(|(n, _)| *n == name).map(|(_, x)| *x);
    if name == "pi" { Some(std::f64::consts::PI) } else { variable.or_else(parameter) }
}

/// Counts nodes, down to none.
fn is_small(e: &ast::Expr, left: &mut usize) -> bool {
    let Some(less) = left.checked_sub(1) else { return false };
    *left = less;
    let children: Vec<&ast::Expr> = match &e.kind {
        ExprKind::Number { .. } | ExprKind::Bool(_) | ExprKind::Path(_) => Vec::new(),
        ExprKind::Unary(_, a) | ExprKind::Paren(a) => vec![a],
        ExprKind::Binary(_, a, b) | ExprKind::Range(a, b) => vec![a, b],
        ExprKind::If(c, a, b) => vec![c, a, b],
        ExprKind::Call(_, list) | ExprKind::List(list) => list.iter().collect(),
    };
    children.into_iter().all(|c| is_small(c, left))
}

/// Reads a text as a tree.
fn tree(text: &str) -> Option<ast::Expr> {
    let mut sources = Sources::new();
    let id = sources.add("expression", text);
    match bond_grammar::parse_expr(&sources, id) {
        Ok(tree) => Some(tree),
        Err(e) => {
            check_diagnostics(&sources, &[e]);
            None
        }
    }
}

/// A tree as an expression; `None` where it has what is no expression here: units, lists, other names and functions.
fn build(pool: &mut Pool, names: &Names, e: &ast::Expr) -> Option<Expr> {
    Some(match &e.kind {
        ExprKind::Number { unit: Some(_), .. } | ExprKind::List(_) | ExprKind::Range(..) => return None,
        ExprKind::Number { digits, unit: None } => pool.decimal(digits)?,
        ExprKind::Bool(b) => pool.int(i64::from(*b)),
        ExprKind::Paren(a) => build(pool, names, a)?,
        ExprKind::Path(path) => match &path.segments[..] {
            [one] if one.index.is_empty() && one.name.text == "pi" => pool.pi(),
            [one] if one.index.is_empty() => {
                let symbol = names.symbol(&one.name.text)?;
                pool.var(symbol)
            }
            _ => return None,
        },
        ExprKind::Unary(f, a) => {
            let a = build(pool, names, a)?;
            pool.unary(if *f == ast::Unary::Neg { Unary::Neg } else { Unary::Not }, a)
        }
        ExprKind::Binary(f, a, b) => {
            let (a, b) = (build(pool, names, a)?, build(pool, names, b)?);
            operation(pool, *f, a, b)
        }
        ExprKind::If(c, a, b) => {
            let (c, a, b) = (build(pool, names, c)?, build(pool, names, a)?, build(pool, names, b)?);
            pool.select(c, a, b)
        }
        ExprKind::Call(name, args) => {
            let args: Vec<Expr> = args.iter().map(|a| build(pool, names, a)).collect::<Option<_>>()?;
            match args[..] {
                [a] => pool.unary(Unary::ALL.into_iter().find(|f| f.name() == name.text)?, a),
                [a, b] => {
                    let known = [Binary::Min, Binary::Max, Binary::Atan2];
                    pool.binary(known.into_iter().find(|f| f.name() == name.text)?, a, b)
                }
                _ => return None,
            }
        }
    })
}

fn operation(pool: &mut Pool, f: ast::Binary, a: Expr, b: Expr) -> Expr {
    match f {
        ast::Binary::Add => pool.add(a, b),
        ast::Binary::Sub => pool.sub(a, b),
        ast::Binary::Mul => pool.mul(a, b),
        ast::Binary::Div => pool.div(a, b),
        ast::Binary::Pow => pool.pow(a, b),
        ast::Binary::Lt => pool.binary(Binary::Lt, a, b),
        ast::Binary::Le => pool.binary(Binary::Le, a, b),
        ast::Binary::Gt => pool.binary(Binary::Lt, b, a),
        ast::Binary::Ge => pool.binary(Binary::Le, b, a),
        ast::Binary::Eq => pool.binary(Binary::Eq, a, b),
        ast::Binary::Ne => {
            let same = pool.binary(Binary::Eq, a, b);
            pool.unary(Unary::Not, same)
        }
        ast::Binary::And => pool.binary(Binary::And, a, b),
        ast::Binary::Or => pool.binary(Binary::Or, a, b),
    }
}

/// The values of a step program that computes expressions, at a place.
fn lowered(pool: &Pool, names: &Names, e: Expr, place: &[f64; 4]) -> f64 {
    let mut builder = Builder::new("expression");
    let load = |(name, s): &(&'static str, Symbol)| {
        let is_variable = VARIABLES.contains(name);
        is_variable.then(|| {
            let slot = builder.slot(Array::Input);
            (*s, builder.load(slot))
        })
    };
    let env: Vec<_> = names.all.iter().filter_map(load).collect();
    let out = builder.slot(Array::Output);
    let value = Lowering::new(env).lower(pool, &mut builder, e).unwrap_or_else(|s| panic!("unbound: {s:?}"));
    builder.store(out, value);
    let program = builder.finish();
    program.verify().unwrap_or_else(|e| panic!("{e}"));
    let kernel = Interpreter::new(&program);
    let mut work = kernel.workspace();
    kernel.run(&[], place, &[], &mut work).unwrap_or_else(|e| panic!("{e}"));
    work.output[0]
}

/// Fails where the divided difference does not close the balance.
fn balance(pool: &mut Pool, names: &Names, tree: &ast::Expr, e: Expr) {
    let Some(q) = names.symbol("q") else { return };
    let (from, delta) = (pool.symbol("from"), pool.symbol("delta"));
    let (start, step) = (pool.var(from), pool.var(delta));
    let slope = pool.difference(e, q, start, step);
    for place in &PLACES {
        for d in DELTAS {
            let mut end = *place;
            end[0] += d;
            let [a, b] = [place, &end].map(|p| bounded::value(tree, &|name| named(p, name)));
            let [start, stop] = [place, &end].map(|p| move |name: &str| named(p, name));
            if !a.is_known() || !b.is_known() || !bounded::is_even(tree, [&start, &stop]) {
                continue;
            }
            let found = pool.eval(slope, &|s| match s {
                s if s == from => place[0],
                s if s == delta => d,
                s => names.at(place, s),
            });
            let change = Bounded { at: b.at - a.at, off: LOST * (a.off + b.off) };
            let rounding = GRAIN * found.abs() * (place[0].abs() + end[0].abs());
            assert!(
                Bounded { off: change.off + rounding, ..change }.is_near(found * d),
                "from {place:?} by {d}: {} where {change:?} is wanted: {}",
                found * d,
                pool.print(slope)
            );
        }
    }
}

fn check(text: &str) {
    let Some(tree) = self::tree(text) else { return };
    let mut pool = Pool::new();
    let names = Names::new(&mut pool);
    if !is_small(&tree, &mut MOST.clone()) {
        return;
    }
    let Some(e) = build(&mut pool, &names, &tree) else { return };
    let printed = pool.print(e);
    let again = self::tree(&printed).unwrap_or_else(|| panic!("what is printed cannot be read: {printed}"));
    let again = build(&mut pool, &names, &again).unwrap_or_else(|| panic!("what is printed means nothing: {printed}"));
    let variables = VARIABLES.iter().filter_map(|name| names.symbol(name)).collect();
    let factored = pool.factored(&[e], &variables, false)[0];
    for place in &PLACES {
        let wanted = bounded::value(&tree, &|name| named(place, name));
        if !wanted.is_known() {
            continue;
        }
        let at = |s: Symbol| names.at(place, s);
        let found = pool.eval(e, &at);
        assert!(wanted.is_near(found), "{printed} is {found} at {place:?}, where it is {wanted:?} as written");
        let found = pool.eval(again, &at);
        assert!(wanted.is_near(found), "read again, {printed} is {found} at {place:?} and not {wanted:?}");
        let found = pool.eval(factored, &at);
        let form = || pool.print(factored);
        assert!(wanted.is_near(found), "factored as {}, it is {found} at {place:?} and not {wanted:?}", form());
        let found = lowered(&pool, &names, e, place);
        assert!(wanted.is_near(found), "lowered, {printed} is {found} at {place:?} and not {wanted:?}");
    }
    balance(&mut pool, &names, &tree, e);
    for name in VARIABLES {
        let Some(s) = names.symbol(name) else { continue };
        let d = pool.derivative(e, s);
        pool.print(d);
        pool.antiderivative(e, s);
    }
}

fuzz_target!(
    init: seeds::write("expressions", SEEDS.iter().enumerate().map(|(i, t)| (format!("{i}"), t.as_bytes().to_vec()))),
    |data: &[u8]| {
        if let Ok(text) = std::str::from_utf8(data) {
            check(text);
        }
    }
);

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutate::text(data, size, max_size, seed, &PIECES)
});
