//! Taylor series at 0, from one side: of all that an expression is made of, by the recurrences for their coefficients
//! (Griewank and Walther, Evaluating Derivatives, 2nd ed., ch. 13).

use super::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

/// What is left of a sum where only rounding is, as a part of its terms.
const NOTHING: f64 = 8.0 * f64::EPSILON;

/// What the terms after the first come to at most, of it, where a series is good.
const REST: f64 = 0.5;

/// Coefficients from the constant on.
pub(crate) type Series = Vec<f64>;

/// An expression on one side of 0.
pub(crate) struct Taylor {
    /// Coefficients of powers of `t >= 0`, where the symbol is `scale * t`.
    pub(crate) series: Series,
    /// Nothing switches for smaller `t`.
    pub(crate) reach: f64,
}

impl Pool {
    /// The first `count` coefficients of an expression of one symbol, which is `scale * t`, for `t` from 0 up. `None`
    /// where it depends on other symbols, has no such series, or one that overflows.
    pub(crate) fn series(&self, e: Expr, s: Symbol, scale: f64, count: usize) -> Option<Taylor> {
        let mut reach = f64::INFINITY;
        let mut known: FxHashMap<Expr, Series> = FxHashMap::default();
        let nodes = self.dependents(e, &|x| x == s);
        for &node in &nodes {
            let series = {
                let of = |c: Expr| match known.get(&c) {
                    Some(series) => Some(series.clone()),
                    None => self.constant(c).map(|x| constant(x, count)),
                };
                self.series_of(self.node(node), &of, (scale, count), &mut reach)?
            };
            if series.iter().any(|c| !c.is_finite()) {
                return None;
            }
            known.insert(node, series);
        }
        let series = known.remove(&e).or_else(|| self.constant(e).map(|x| constant(x, count)))?;
        Some(Taylor { series, reach })
    }

    fn series_of(
        &self,
        node: &Node,
        of: &dyn Fn(Expr) -> Option<Series>,
        (scale, count): (f64, usize),
        reach: &mut f64,
    ) -> Option<Series> {
        let mut sign = |u: &[f64]| {
            *reach = reach.min(extent(u));
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
            Node::Unary(f, a) => {
                let u = of(*a)?;
                match f {
                    Unary::Neg => u.iter().map(|x| -x).collect(),
                    Unary::Abs => {
                        let side = sign(&u);
                        u.iter().map(|x| side * x).collect()
                    }
                    Unary::Sign => constant(sign(&u), count),
                    Unary::Floor => {
                        // Where it jumps, on the side that the argument goes to.
                        let whole = eval::unary(*f, u[0]);
                        let past: Series = std::iter::once(u[0] - whole).chain(u.iter().skip(1).copied()).collect();
                        constant(if sign(&past) < 0.0 { whole - 1.0 } else { whole }, count)
                    }
                    Unary::Not => constant(f64::from(sign(&u) == 0.0), count),
                    Unary::Sqrt => power(&u, Number::HALF)?,
                    Unary::Exp => exponential(&u),
                    Unary::Log => logarithm(&u)?,
                    Unary::Sin => turned(&u, -1.0).0,
                    Unary::Cos => turned(&u, -1.0).1,
                    Unary::Sinh => turned(&u, 1.0).0,
                    Unary::Cosh => turned(&u, 1.0).1,
                    Unary::Tan => tangent(&u, 1.0),
                    Unary::Tanh => tangent(&u, -1.0),
                    Unary::Asin => {
                        integral(eval::unary(*f, u[0]), &u, &power(&beside(&u, -1.0), Number::ratio(-1, 2))?)
                    }
                    Unary::Acos => {
                        let slope: Series =
                            power(&beside(&u, -1.0), Number::ratio(-1, 2))?.iter().map(|x| -x).collect();
                        integral(eval::unary(*f, u[0]), &u, &slope)
                    }
                    Unary::Atan => integral(eval::unary(*f, u[0]), &u, &power(&beside(&u, 1.0), Number::MINUS_ONE)?),
                }
            }
            Node::Binary(f, a, b) => {
                let (a, b) = (of(*a)?, of(*b)?);
                let apart: Series = a.iter().zip(&b).map(|(a, b)| sum([*a, -b].into_iter())).collect();
                match f {
                    Binary::Min => {
                        if sign(&apart) < 0.0 {
                            a
                        } else {
                            b
                        }
                    }
                    Binary::Max => {
                        if sign(&apart) > 0.0 {
                            a
                        } else {
                            b
                        }
                    }
                    Binary::Lt => constant(f64::from(sign(&apart) < 0.0), count),
                    Binary::Le => constant(f64::from(sign(&apart) <= 0.0), count),
                    Binary::Eq => constant(f64::from(sign(&apart) == 0.0), count),
                    Binary::And => constant(f64::from(sign(&a) != 0.0 && sign(&b) != 0.0), count),
                    Binary::Or => constant(f64::from(sign(&a) != 0.0 || sign(&b) != 0.0), count),
                    Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow | Binary::Atan2 => return None,
                }
            }
            Node::Select(c, a, b) => {
                let holds = sign(&of(*c)?) != 0.0;
                of(if holds { *a } else { *b })?
            }
        })
    }
}

/// How far from 0 a series is its first term and, of less than that, the others, so that nothing cancels. Infinite where
/// it has one term, or none.
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

fn constant(x: f64, count: usize) -> Series {
    let mut series = vec![0.0; count];
    series[0] = x;
    series
}

/// A sum, 0 where only rounding is left of its terms.
fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut total, mut size) = (0.0, 0.0);
    for x in terms {
        total += x;
        size += f64::abs(x);
    }
    if f64::abs(total) <= NOTHING * size { 0.0 } else { total }
}

fn product(a: &[f64], b: &[f64]) -> Series {
    (0..a.len()).map(|k| sum((0..=k).map(|j| a[j] * b[k - j]))).collect()
}

/// `a^n`; `None` of 0 to a negative power, and of what is not above 0 to a broken one.
fn power(a: &[f64], n: Number) -> Option<Series> {
    if let Some(n) = n.integer().filter(|n| (0..=64).contains(n)) {
        return Some((0..n).fold(constant(1.0, a.len()), |p, _| product(&p, a)));
    }
    let first = a[0];
    if first == 0.0 || (first < 0.0 && n.integer().is_none()) {
        return None;
    }
    let n = n.to_f64();
    let mut p = constant(eval::binary(Binary::Pow, first, n), a.len());
    for k in 1..a.len() {
        let all = (1..=k).map(|j| (n * j as f64 - (k - j) as f64) * a[j] * p[k - j]);
        p[k] = sum(all) / (k as f64 * first);
    }
    Some(p)
}

fn exponential(u: &[f64]) -> Series {
    let mut p = constant(eval::unary(Unary::Exp, u[0]), u.len());
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * p[k - j])) / k as f64;
    }
    p
}

fn logarithm(u: &[f64]) -> Option<Series> {
    if u[0] <= 0.0 {
        return None;
    }
    let mut p = constant(eval::unary(Unary::Log, u[0]), u.len());
    for k in 1..u.len() {
        let all = (1..k).map(|j| -(j as f64) * p[j] * u[k - j] / k as f64);
        p[k] = sum(all.chain([u[k]])) / u[0];
    }
    Some(p)
}

/// Sine and cosine with the sign -1, their hyperbolic ones with 1.
fn turned(u: &[f64], sign: f64) -> (Series, Series) {
    let (sin, cos) = if sign < 0.0 { (Unary::Sin, Unary::Cos) } else { (Unary::Sinh, Unary::Cosh) };
    let (sin, cos) = (eval::unary(sin, u[0]), eval::unary(cos, u[0]));
    let (mut s, mut c) = (constant(sin, u.len()), constant(cos, u.len()));
    for k in 1..u.len() {
        s[k] = sum((1..=k).map(|j| j as f64 * u[j] * c[k - j])) / k as f64;
        c[k] = sign * sum((1..=k).map(|j| j as f64 * u[j] * s[k - j])) / k as f64;
    }
    (s, c)
}

/// The tangent with the sign 1, the hyperbolic one with -1: the slope is 1 + sign p^2.
fn tangent(u: &[f64], sign: f64) -> Series {
    let first = eval::unary(if sign > 0.0 { Unary::Tan } else { Unary::Tanh }, u[0]);
    let (mut p, mut slope) = (constant(first, u.len()), constant(1.0 + sign * first * first, u.len()));
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * slope[k - j])) / k as f64;
        slope[k] = sign * sum((0..=k).map(|j| p[j] * p[k - j]));
    }
    p
}

/// `1 + sign u^2`
fn beside(u: &[f64], sign: f64) -> Series {
    let mut series: Series = product(u, u).iter().map(|x| sign * x).collect();
    series[0] += 1.0;
    series
}

/// What has the value `first` at 0 and the slope `slope` by `u`.
fn integral(first: f64, u: &[f64], slope: &[f64]) -> Series {
    let mut p = constant(first, u.len());
    for k in 1..u.len() {
        p[k] = sum((1..=k).map(|j| j as f64 * u[j] * slope[k - j])) / k as f64;
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
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
                let found = pool.series(e, s, scale, TERMS).unwrap_or_else(|| panic!("{name} has no series"));
                for t in [1e-6, 0.1, 0.5, 0.9].map(|t| t * found.reach.min(1.0)) {
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
            assert!(pool.series(e, s, 1.0, TERMS).is_none(), "{}", pool.print(e));
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
        let found = pool.series(law, s, 1.0, TERMS).map(|t| t.series).unwrap_or_default();
        assert_eq!(found[..3], [0.0, 1.0, 0.5]);
        let r = extent(&found);
        assert!((0.5..=0.77).contains(&r) && rest(&found, 1, 2, r) <= REST, "{r}");
    }
}
