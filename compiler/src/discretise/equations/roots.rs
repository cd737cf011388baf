//! Laws with an infinite slope, as of an orifice: `sign(x) sqrt(|x|)`.
//!
//! Where `x` is the difference of two large numbers, as the head of a tank that is all but full, its root is a flow
//! that no number of the state resolves. So the root is an unknown `z` of its own, with `z |z| = x`, whose digits are
//! its own; and the slope is finite.

use crate::discretise::cluster::missing;
use crate::discretise::equations::system::System;
use crate::expression::{Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::Model;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Binary, Builder, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// Roots that became unknowns: of what, and as what.
pub(crate) struct Roots(Vec<(Expr, Symbol)>);

/// `x`, where a product has `sign(x)` and `|x|^(1/2)`.
fn radicand(pool: &Pool, factors: &[(Expr, Number)]) -> Option<Expr> {
    factors.iter().find_map(|&(size, n)| match pool.node(size) {
        Node::Unary(Unary::Abs, x) if n == Number::HALF => {
            let sign = |&(f, n): &(Expr, Number)| n.is_one() && *pool.node(f) == Node::Unary(Unary::Sign, *x);
            factors.iter().any(sign).then_some(*x)
        }
        _ => None,
    })
}

impl Roots {
    /// Whether there are such roots in a system.
    pub(crate) fn are_in(pool: &Pool, system: &System) -> bool {
        let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().collect();
        pool.ascending(&system.residuals, &|_| true).into_iter().any(|e| {
            let Node::Product(_, factors) = pool.node(e) else { return false };
            radicand(pool, factors).is_some_and(|x| pool.contains_any(x, &|s| unknown.contains(&s)))
        })
    }

    /// Makes the roots in a system unknowns; `cold` is where else it starts.
    ///
    /// # Errors
    /// A symbol that means nothing.
    pub(crate) fn of(
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        system: &mut System,
        cold: &mut Vec<Value>,
    ) -> Result<Self, Vec<Diagnostic>> {
        let unknown: FxHashSet<Symbol> = system.unknowns.iter().copied().collect();
        let mut roots = Vec::new();
        let mut made: Vec<(Symbol, Expr)> = Vec::new();
        let mut new: FxHashMap<Expr, Expr> = FxHashMap::default();
        for e in model.pool.ascending(&system.residuals, &|_| true) {
            let pool = &mut model.pool;
            let Node::Product(c, factors) = pool.node(e).clone() else {
                let rebuilt = pool.rebuild(e, &|c| new.get(&c).copied().unwrap_or(c));
                new.insert(e, rebuilt);
                continue;
            };
            let found = radicand(pool, &factors).filter(|x| pool.contains_any(*x, &|s| unknown.contains(&s)));
            let mut all: Vec<(Expr, Number)> = vec![(pool.numeral(c), Number::ONE)];
            if let Some(x) = found {
                let z = match roots.iter().find(|r: &&(Expr, Symbol)| r.0 == x) {
                    Some(r) => r.1,
                    None => {
                        let z = pool.symbol(&format!("root[{}]", roots.len() + 1));
                        roots.push((x, z));
                        made.push((z, new.get(&x).copied().unwrap_or(x)));
                        z
                    }
                };
                all.push((pool.var(z), Number::ONE));
            }
            let is_of = |f: Expr| {
                found.is_some_and(|x| matches!(pool.node(f), Node::Unary(Unary::Abs | Unary::Sign, y) if *y == x))
            };
            let rest: Vec<_> = factors.iter().filter(|f| !is_of(f.0)).copied().collect();
            all.extend(rest.into_iter().map(|(f, n)| (new.get(&f).copied().unwrap_or(f), n)));
            let product = pool.powers(&all);
            new.insert(e, product);
        }
        if roots.is_empty() {
            return Ok(Self(roots));
        }
        for r in &mut system.residuals {
            *r = new.get(r).copied().unwrap_or(*r);
        }
        for (z, x) in made {
            let pool = &mut model.pool;
            let sizes = match pool.node(x).clone() {
                Node::Sum(c, terms) => {
                    let mut sizes = vec![pool.numeral(c.abs())];
                    for &(t, n) in terms.iter() {
                        let t = pool.unary(Unary::Abs, t);
                        sizes.push(pool.scale(t, n.abs()));
                    }
                    pool.sum(&sizes)
                }
                _ => pool.unary(Unary::Abs, x),
            };
            let root = |b: &mut Builder, model: &Model, at: &[Value], e: Expr| {
                let mut lowering = lowering.clone();
                system.unknowns.iter().zip(at).for_each(|(s, v)| lowering.bind(*s, *v));
                let x = lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
                let (sign, size) = (b.unary(Unary::Sign, x), b.unary(Unary::Abs, x));
                let size = b.unary(Unary::Sqrt, size);
                Ok::<Value, Vec<Diagnostic>>(b.mul(sign, size))
            };
            let (start, scale) = (root(b, model, &system.start, x)?, root(b, model, &system.start, sizes)?);
            if !cold.is_empty() {
                cold.push(root(b, model, cold, x)?);
            }
            // The rounding of x is to be rounding beside the scale: 1/16 of it, so that it is less than that.
            let (zero, sixteenth) = (b.number(0.0), b.number(0.0625));
            let (some, part) = (b.binary(Binary::Lt, zero, scale), b.div(sixteenth, scale));
            let part = b.select(some, part, sixteenth);
            let pool = &mut model.pool;
            let unit = pool.symbol("1/scale");
            lowering.bind(unit, part);
            let (var, unit) = (pool.var(z), pool.var(unit));
            let size = pool.unary(Unary::Abs, var);
            let square = pool.mul(var, size);
            let off = pool.sub(square, x);
            system.unknowns.push(z);
            system.start.push(start);
            system.residuals.push(pool.mul(off, unit));
            system.scale.push(scale);
            system.weight.push(zero);
        }
        Ok(Self(roots))
    }

    /// Has what they are the roots of follow from them.
    pub(crate) fn bind(self, pool: &mut Pool, b: &mut Builder, lowering: &mut Lowering) -> Result<(), Symbol> {
        for (x, z) in self.0 {
            let z = pool.var(z);
            let z = lowering.lower(pool, b, z)?;
            let size = b.unary(Unary::Abs, z);
            let (value, square, sign) = (b.mul(z, size), b.mul(z, z), b.unary(Unary::Sign, z));
            lowering.know(x, value);
            for (f, value) in [(Unary::Abs, square), (Unary::Sign, sign)] {
                if let Some(e) = pool.existing(f, x) {
                    lowering.know(e, value);
                }
            }
        }
        Ok(())
    }
}
