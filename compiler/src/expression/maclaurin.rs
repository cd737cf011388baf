//! Taylor series at 0, from one side: of all that an expression is made of, by the recurrences for their coefficients
//! (Griewank and Walther, Evaluating Derivatives, 2nd ed., ch. 13).

use super::power_series::{Series, constant, exponential, logarithm, power, product, sum};
use super::unary::row;
use super::{Expr, Node, Pool, Symbol};
use bond_runtime::ir::Binary;
use rustc_hash::FxHashMap;

/// What the terms after the first come to at most, of it, where a series is good.
const REST: f64 = 0.5;

/// An expression on one side of 0.
pub(crate) struct Maclaurin {
    /// Coefficients of powers of `t >= 0`, where the symbol is `scale * t`.
    pub(crate) series: Series,
    /// Nothing switches for smaller `t`.
    pub(crate) radius: f64,
}

impl Pool {
    /// The first `count` coefficients of an expression of one symbol, which is `scale * t`, for `t` from 0 up. `None`
    /// where it depends on other symbols, has no such series, or one that overflows.
    pub(crate) fn maclaurin(&self, e: Expr, s: Symbol, scale: f64, count: usize) -> Option<Maclaurin> {
        let mut radius = f64::INFINITY;
        let mut known: FxHashMap<Expr, Series> = FxHashMap::default();
        let nodes = self.dependents(e, &|x| x == s);
        for &node in &nodes {
            let series = {
                let of = |c: Expr| match known.get(&c) {
                    Some(series) => Some(series.clone()),
                    None => self.constant(c).map(|x| constant(x, count)),
                };
                self.series_of(self.node(node), &of, (scale, count), &mut radius)?
            };
            if series.iter().any(|c| !c.is_finite()) {
                return None;
            }
            known.insert(node, series);
        }
        let series = known.remove(&e).or_else(|| self.constant(e).map(|x| constant(x, count)))?;
        Some(Maclaurin { series, radius })
    }

    fn series_of(
        &self,
        node: &Node,
        of: &dyn Fn(Expr) -> Option<Series>,
        (scale, count): (f64, usize),
        radius: &mut f64,
    ) -> Option<Series> {
        let mut leads = |u: &[f64]| {
            *radius = radius.min(extent(u));
            u.iter().find(|c| **c != 0.0).map_or(0.0, |c| c.signum())
        };
        Some(match node {
            Node::Number(n) => constant(n.to_f64(), count),
            Node::Symbol(_) => {
                let mut series = constant(0.0, count);
                *series.get_mut(1)? = scale;
                series
            }
            Node::Sum(c, terms) => {
                let mut all = vec![constant(c.to_f64(), count)];
                for &(t, n) in terms.iter() {
                    all.push(of(t)?.iter().map(|x| n.to_f64() * x).collect());
                }
                (0..count).map(|k| sum(all.iter().map(|a| a[k]))).collect()
            }
            Node::Product(c, factors) => {
                let mut total = constant(c.to_f64(), count);
                for &(f, n) in factors.iter() {
                    total = product(&total, &power(&of(f)?, n)?);
                }
                total
            }
            Node::Power(a, b) => exponential(&product(&of(*b)?, &logarithm(&of(*a)?)?)),
            Node::Unary(f, a) => (row(*f).maclaurin)(&of(*a)?, &mut leads)?,
            Node::Binary(f, a, b) => {
                let (a, b) = (of(*a)?, of(*b)?);
                let apart: Series = a.iter().zip(&b).map(|(a, b)| sum([*a, -b].into_iter())).collect();
                match f {
                    Binary::Min => {
                        if leads(&apart) < 0.0 {
                            a
                        } else {
                            b
                        }
                    }
                    Binary::Max => {
                        if leads(&apart) > 0.0 {
                            a
                        } else {
                            b
                        }
                    }
                    Binary::Lt => constant(f64::from(leads(&apart) < 0.0), count),
                    Binary::Le => constant(f64::from(leads(&apart) <= 0.0), count),
                    Binary::Eq => constant(f64::from(leads(&apart) == 0.0), count),
                    Binary::And => constant(f64::from(leads(&a) != 0.0 && leads(&b) != 0.0), count),
                    Binary::Or => constant(f64::from(leads(&a) != 0.0 || leads(&b) != 0.0), count),
                    Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow | Binary::Atan2 => return None,
                }
            }
            Node::Select(c, a, b) => {
                let holds = leads(&of(*c)?) != 0.0;
                of(if holds { *a } else { *b })?
            }
        })
    }
}

/// How far from 0 a series is its first term and, of less than that, the others, so that nothing cancels. Infinite
/// where it has one term, or none.
pub(crate) fn extent(c: &[f64]) -> f64 {
    let Some(m) = c.iter().position(|c| *c != 0.0) else { return f64::INFINITY };
    let mut r = below(c, m, m + 1, REST);
    while r.is_finite() && r > 0.0 && rest(c, m, m + 1, r) > REST {
        r *= 0.9;
    }
    r
}

/// Where the last terms that are known of a series are no longer next to nothing beside the first.
pub(crate) fn limit(c: &[f64]) -> f64 {
    let Some(m) = c.iter().position(|c| *c != 0.0) else { return f64::INFINITY };
    below(c, m, c.len().saturating_sub(8).max(m + 1), 1e-18)
}

/// Where one of the terms from the k-th on is that part of the m-th.
fn below(c: &[f64], m: usize, k: usize, part: f64) -> f64 {
    let root = |k: usize| libm::pow(part * (c[m] / c[k]).abs(), 1.0 / (k - m) as f64);
    (k..c.len()).map(root).fold(f64::INFINITY, f64::min)
}

/// What the terms from the k-th on come to at most at `t`, of the m-th.
pub(crate) fn rest(c: &[f64], m: usize, k: usize, t: f64) -> f64 {
    (k..c.len()).map(|k| (c[k] / c[m]).abs() * t.powi((k - m) as i32)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::Number;
    use bond_runtime::ir::Unary;
    use std::collections::BTreeMap;

    const TERMS: usize = 40;

    /// An expression in `x`, written with a few functions.
    fn cases(pool: &mut Pool, x: Expr) -> BTreeMap<&'static str, Expr> {
        let (one, two) = (pool.one(), pool.int(2));
        let (next, past, square) = (pool.add(one, x), pool.sub(x, two), pool.mul(x, x));
        let far = pool.add(two, x);
        let exponent = pool.ratio(7, 5);
        let mut all: BTreeMap<&'static str, Expr> = Unary::ALL
            .into_iter()
            .filter(|f| !matches!(f, Unary::Asin | Unary::Acos | Unary::Sqrt | Unary::Log))
            .map(|f| (f.name(), pool.unary(f, next)))
            .collect();
        let half = pool.scale(next, Number::HALF);
        for f in [Unary::Asin, Unary::Acos, Unary::Sqrt, Unary::Log] {
            all.insert(f.name(), pool.unary(f, half));
        }
        all.insert("a power", pool.pow(far, exponent));
        all.insert("a power of x", pool.pow(far, next));
        all.insert("a quotient", pool.div(next, past));
        all.insert("a whole power", pool.powi(past, 3));
        all.insert("a size that turns at 0", pool.unary(Unary::Abs, x));
        let less = pool.binary(Binary::Lt, square, x);
        all.insert("a choice", pool.select(less, next, far));
        all.insert("the smaller", pool.binary(Binary::Min, square, x));
        all.insert("the larger", pool.binary(Binary::Max, square, x));
        all
    }

    #[test]
    fn a_series_is_its_function() {
        let mut pool = Pool::new();
        let s = pool.symbol("x");
        let x = pool.var(s);
        for (name, e) in cases(&mut pool, x) {
            for scale in [0.125, -0.125, 1e-3] {
                let found = pool.maclaurin(e, s, scale, TERMS).unwrap_or_else(|| panic!("{name} has no series"));
                for t in [1e-6, 0.1, 0.5, 0.9].map(|t| t * found.radius.min(1.0)) {
                    let (sum, value) =
                        (found.series.iter().rev().fold(0.0, |sum, c| c + t * sum), pool.eval(e, &|_| scale * t));
                    assert!(
                        (sum - value).abs() <= 2e-15 * value.abs().max(1e-3),
                        "{name} at {}: {sum} for {value}",
                        scale * t
                    );
                }
            }
        }
    }

    #[test]
    fn where_there_is_no_series_there_is_none() {
        let mut pool = Pool::new();
        let (s, other) = (pool.symbol("x"), pool.symbol("y"));
        let (x, y) = (pool.var(s), pool.var(other));
        let root = pool.unary(Unary::Sqrt, x);
        let log = pool.unary(Unary::Log, x);
        let one = pool.one();
        let pole = pool.div(one, x);
        let foreign = pool.mul(x, y);
        for e in [root, log, pole, foreign] {
            assert!(pool.maclaurin(e, s, 1.0, TERMS).is_none(), "{}", pool.print(e));
        }
    }

    /// `exp(x) - 1` is x and half of it more at x = 0.93.., and nothing cancels up to there.
    #[test]
    fn what_cancels_is_nothing_and_what_is_left_leads() {
        let mut pool = Pool::new();
        let s = pool.symbol("x");
        let x = pool.var(s);
        let (one, exp) = (pool.one(), pool.unary(Unary::Exp, x));
        let law = pool.sub(exp, one);
        let found = pool.maclaurin(law, s, 1.0, TERMS).map(|t| t.series).unwrap_or_default();
        assert_eq!(found[..3], [0.0, 1.0, 0.5]);
        let r = extent(&found);
        assert!((0.5..=0.77).contains(&r) && rest(&found, 1, 2, r) <= REST, "{r}");
    }
}
