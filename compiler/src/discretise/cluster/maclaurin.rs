//! Maclaurin expansions of laws at rest and of their energies, which replace closed forms that are small differences of
//! large terms.

use crate::expression::{Expr, Maclaurin as Expansion, Node, Pool, Symbol, extent, is_piecewise_linear, limit, rest};
use crate::thresholds::RestThresholds;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;
use std::rc::Rc;

/// Terms of the series that a polynomial is taken from.
const TERMS: usize = 40;
/// Terms from which the length of a law is estimated.
const FEW: usize = 9;
/// How often the way to rest is halved in looking where a closed form is good, and where its digits are looked at
/// first.
const HALVINGS: i32 = 24;
const LOOKS: [i32; 3] = [8, 16, 24];
/// Places within a halving.
const PLACES: [f64; 6] = [1.0, 0.93, 0.87, 0.81, 0.71, 0.59];

/// The expansions found so far, by law and energy, with one common symbol in the place of the state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Expansions {
    symbol: Option<Symbol>,
    found: FxHashMap<(Expr, Expr), Option<Rc<Series>>>,
    /// The numbers that it goes by.
    pub(crate) by: RestThresholds,
}

/// Coefficients of a law from the constant on, above 0 and below it; the radius of the state within which they replace
/// the law; and H at 0.
#[derive(Debug)]
struct Series {
    above: Vec<f64>,
    below: Vec<f64>,
    radius: f64,
    start: f64,
}

/// A law near rest.
#[derive(Clone, Debug)]
pub(crate) struct Maclaurin {
    /// The state.
    at: Expr,
    series: Rc<Series>,
}

impl Maclaurin {
    /// The polynomials of a law of one state and of its energy, where the closed form of either loses digits near 0.
    pub(crate) fn of(pool: &mut Pool, known: &mut Expansions, s: Symbol, law: Expr, energy: Expr) -> Option<Maclaurin> {
        if pool.symbols(law) != [s] || !pool.any_node(law, &is_curved) {
            return None;
        }
        let any = *known.symbol.get_or_insert(s);
        let (at, common) = (pool.var(s), pool.var(any));
        let map = std::iter::once((s, common)).collect();
        let [law, energy] = [law, energy].map(|e| pool.substitute(e, &map));
        let by = known.by;
        let found =
            known.found.entry((law, energy)).or_insert_with(|| Series::of(pool, any, (law, energy), by).map(Rc::new));
        found.clone().map(|series| Maclaurin { at, series })
    }

    /// H: the polynomial where the state is small, `closed` elsewhere.
    pub(crate) fn energy(&self, pool: &mut Pool, closed: Expr) -> Expr {
        let (size, stored) = (pool.unary(Unary::Abs, self.at), self.stored(pool, self.at));
        self.select(pool, size, stored, closed)
    }

    /// The same of the law.
    pub(crate) fn law(&self, pool: &mut Pool, closed: Expr) -> Expr {
        let [above, below] = [&self.series.above, &self.series.below].map(|c| horner(pool, self.at, c));
        let (size, law) = (pool.unary(Unary::Abs, self.at), beside(pool, self.at, above, below));
        self.select(pool, size, law, closed)
    }

    /// The same of the difference quotient of H over a step.
    pub(crate) fn slope(&self, pool: &mut Pool, delta: Expr, closed: Expr) -> Expr {
        let (from, to) = (self.at, pool.add(self.at, delta));
        let [above, below] = self.energies().map(|c| quotient(pool, (from, to), &c));
        let slope = if above == below {
            above
        } else {
            let (start, end) = (self.stored(pool, from), self.stored(pool, to));
            let rise = pool.sub(end, start);
            let across = pool.div(rise, delta);
            let [up, down] = [(above, across), (across, below)].map(|(a, b)| beside(pool, to, a, b));
            beside(pool, from, up, down)
        };
        let sizes = [from, to].map(|x| pool.unary(Unary::Abs, x));
        let size = pool.binary(Binary::Max, sizes[0], sizes[1]);
        self.select(pool, size, slope, closed)
    }

    /// Coefficients of H above and below 0, without its value there.
    fn energies(&self) -> [Vec<f64>; 2] {
        let stored =
            |law: &[f64]| std::iter::once(0.0).chain(law.iter().enumerate().map(|(k, c)| c / (k + 1) as f64)).collect();
        [stored(&self.series.above), stored(&self.series.below)]
    }

    /// H at a small state.
    fn stored(&self, pool: &mut Pool, at: Expr) -> Expr {
        let [above, below] = self.energies().map(|c| horner(pool, at, &c));
        let rise = beside(pool, at, above, below);
        let start = pool.float(self.series.start);
        pool.add(start, rise)
    }

    fn select(&self, pool: &mut Pool, size: Expr, near: Expr, closed: Expr) -> Expr {
        let radius = pool.float(self.series.radius);
        let is_small = pool.binary(Binary::Lt, size, radius);
        pool.select(is_small, near, closed)
    }
}

impl Series {
    fn of(pool: &Pool, s: Symbol, (law, energy): (Expr, Expr), by: RestThresholds) -> Option<Series> {
        let start = pool.eval(energy, &|_| 0.0);
        let radius = |sides: &[(Expansion, f64); 2], of: fn(&[f64]) -> f64| {
            sides.iter().fold(f64::INFINITY, |r, (t, _)| r.min(of(&t.series)).min(t.radius))
        };
        let length = radius(&sides(pool, s, law, (1.0, FEW))?, extent);
        if !(length.is_finite() && length > 0.0 && start.is_finite()) {
            return None;
        }
        // A power of 2, so that nothing is rounded.
        let length = libm::exp2(libm::log2(length).floor());
        let sides = sides(pool, s, law, (length, TERMS))?;
        let far = radius(&sides, |c| extent(c).min(limit(c))).min(1.0);
        // What the closed forms are off by at most, going half the way from `t` to rest.
        let off = |t: f64| {
            let mut worst = 0.0f64;
            for (Expansion { series, .. }, scale) in &sides {
                for t in PLACES.map(|part| part * t) {
                    let values = pool.eval_all(&[law, energy], &|_| scale * t);
                    let sum = |c: &dyn Fn(usize) -> f64| (0..TERMS).rev().fold(0.0, |sum, k| c(k) + t * sum);
                    let rise = scale * t * sum(&|k| series[k] / (k + 1) as f64);
                    for (closed, own) in [(values[0], sum(&|k| series[k])), (values[1], start + rise)] {
                        if closed != own {
                            let part = ((closed - own) / own).abs();
                            worst = worst.max(if part.is_nan() { f64::INFINITY } else { part });
                        }
                    }
                }
            }
            worst
        };
        let halved = |k: i32| far * libm::exp2(f64::from(-k));
        if !(far > 0.0 && off(far) <= by.same) || LOOKS.iter().all(|k| off(halved(*k)) <= by.closed) {
            return None;
        }
        let good = (0..HALVINGS).take_while(|k| off(halved(*k)) <= by.closed).last();
        let t = halved(good.unwrap_or(0));
        let [above, below] = sides.map(|(taylor, scale)| coefficients(&taylor.series, (t, by.truncation), scale));
        let all = above.iter().chain(&below);
        all.clone().all(|c| c.is_finite()).then_some(Series { above, below, radius: t * length, start })
    }
}

/// The series of a law above and below 0, each with the way from rest in which it is.
fn sides(pool: &Pool, s: Symbol, law: Expr, (length, count): (f64, usize)) -> Option<[(Expansion, f64); 2]> {
    let side = |scale: f64| Some((pool.maclaurin(law, s, scale, count)?, scale));
    Some([side(length)?, side(-length)?])
}

/// Coefficients by the state of a series by the state over `scale`, as far as they count up to `t`.
fn coefficients(series: &[f64], (t, left): (f64, f64), scale: f64) -> Vec<f64> {
    let Some(m) = series.iter().position(|c| *c != 0.0) else { return Vec::new() };
    let last = (m + 1..series.len()).find(|k| rest(series, m, *k, t) <= left).unwrap_or(series.len());
    series[..last].iter().enumerate().map(|(k, c)| c / scale.powi(k as i32)).collect()
}

/// One above 0, the other below.
fn beside(pool: &mut Pool, at: Expr, above: Expr, below: Expr) -> Expr {
    let zero = pool.zero();
    let is_above = pool.binary(Binary::Lt, zero, at);
    pool.select(is_above, above, below)
}

/// A polynomial by Horner's rule.
fn horner(pool: &mut Pool, x: Expr, c: &[f64]) -> Expr {
    let mut value = pool.zero();
    for c in c.iter().rev() {
        let (c, step) = (pool.float(*c), pool.mul(x, value));
        value = pool.add(c, step);
    }
    value
}

/// The difference quotient of a polynomial between two places: it is divided by the way from the first one, by Horner's
/// rule, and the quotient taken at the second, by the same.
fn quotient(pool: &mut Pool, (from, to): (Expr, Expr), c: &[f64]) -> Expr {
    let (mut divided, mut value) = (pool.zero(), pool.zero());
    for c in c.iter().skip(1).rev() {
        let (c, step) = (pool.float(*c), pool.mul(from, divided));
        divided = pool.add(c, step);
        let step = pool.mul(to, value);
        value = pool.add(divided, step);
    }
    value
}

/// Whether it is more than a polynomial.
fn is_curved(n: &Node) -> bool {
    match n {
        Node::Unary(f, _) => !is_piecewise_linear(*f),
        Node::Power(..) => true,
        Node::Product(_, factors) => factors.iter().any(|f| f.1.integer().is_none_or(|n| n < 0)),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Binary(..) | Node::Select(..) => false,
    }
}
