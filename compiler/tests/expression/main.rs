//! Symbolic expressions against numbers, identities and their own text.

mod calculus;
mod canonical;
mod difference;
mod factor;
mod forms;
mod lower;
mod print;
mod surface;
mod table;

use bond_compiler::expression::{Expr, Pool, Symbol};
use bond_grammar::ast::{self, ExprKind};
use bond_grammar::source::Sources;
use bond_runtime::ir::{Binary, Unary};

/// Reads an expression of the language. Names are looked up among `names`.
fn read(pool: &mut Pool, names: &[(&str, Symbol)], text: &str) -> Expr {
    let mut sources = Sources::new();
    let id = sources.add("test", text);
    let tree = bond_grammar::parse_expr(&sources, id).unwrap_or_else(|e| panic!("{text}: {e:?}"));
    build(pool, names, &tree)
}

fn build(pool: &mut Pool, names: &[(&str, Symbol)], e: &ast::Expr) -> Expr {
    match &e.kind {
        ExprKind::Number { digits, unit } => {
            assert!(unit.is_none());
            pool.decimal(digits).expect("a number")
        }
        ExprKind::Path(path) => {
            let name = path.segments.iter().map(|s| s.name.text.as_str()).collect::<Vec<_>>().join(".");
            if name == "pi" {
                return pool.pi();
            }
            let (_, symbol) = names.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("{name}"));
            pool.var(*symbol)
        }
        ExprKind::Unary(f, a) => {
            let a = build(pool, names, a);
            pool.unary(if *f == ast::Unary::Neg { Unary::Neg } else { Unary::Not }, a)
        }
        ExprKind::Binary(f, a, b) => {
            let (a, b) = (build(pool, names, a), build(pool, names, b));
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
        ExprKind::If(c, a, b) => {
            let [c, a, b] = [c, a, b].map(|x| build(pool, names, x));
            pool.select(c, a, b)
        }
        ExprKind::Call(name, args) => {
            let args: Vec<Expr> = args.iter().map(|a| build(pool, names, a)).collect();
            if let Some(f) = Unary::ALL.into_iter().find(|f| f.name() == name.text) {
                return pool.unary(f, args[0]);
            }
            let f = Binary::ALL.into_iter().find(|f| f.name() == name.text).expect("a function");
            pool.binary(f, args[0], args[1])
        }
        ExprKind::Paren(a) => build(pool, names, a),
        ExprKind::Bool(b) => pool.int(i64::from(*b)),
        ExprKind::List(_) | ExprKind::Range(..) => panic!("a list"),
    }
}

/// A pool with the variables q, p, x, y and the parameters k = 3, m = 2, b = 1/2.
struct Bench {
    pool: Pool,
    names: Vec<(&'static str, Symbol)>,
}

impl Bench {
    fn new() -> Bench {
        let mut pool = Pool::new();
        let mut names = Vec::new();
        for name in ["q", "p", "x", "y"] {
            names.push((name, pool.symbol(name)));
        }
        for (name, value) in [("k", 3.0), ("m", 2.0), ("b", 0.5)] {
            names.push((name, pool.parameter(name, value)));
        }
        Bench { pool, names }
    }

    fn read(&mut self, text: &str) -> Expr {
        read(&mut self.pool, &self.names, text)
    }

    fn symbol(&self, name: &str) -> Symbol {
        self.names.iter().find(|(n, _)| *n == name).map(|(_, s)| *s).expect("declared")
    }

    /// The value with q and the other variables fixed.
    fn at(&self, e: Expr, q: f64) -> f64 {
        let s = self.symbol("q");
        self.pool.eval(e, &|x| if x == s { q } else { 0.7 + 0.1 * f64::from(x.0) })
    }
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    a == b || (a - b).abs() <= relative * a.abs().max(b.abs()) || (a.is_nan() && b.is_nan())
}
