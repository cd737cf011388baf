//! What drives a linear cluster, as states of their own.

use crate::expression::{Expr, Node, Number, Pool, Symbol};
use crate::model::Model;
use bond_runtime::ir::{Binary, Unary};
use nalgebra::{DMatrix, DVector};
use rustc_hash::FxHashMap;

/// Something that drives, as a state of its own.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Drive {
    /// 1
    One,
    /// Held over the step: a port's variable or an expression without time.
    Held(Expr),
    /// A value at the start of the step, and what it changes by in a second, which is held over the step.
    Ramp(Expr, Expr),
    /// sin or cos (true: cos) of `rate t + phase`
    Wave(f64, f64, bool),
    /// exp(rate t + phase)
    Growth(f64, f64),
    /// t^n
    Power(u32),
    /// The k-th derivative at the start of the step of the cubic through an expression.
    Cubic(Expr, u32),
}

/// A value as a sum: coefficients of signals of the cluster, and of drives.
#[derive(Default)]
pub(crate) struct Split {
    pub(crate) signals: Vec<(Symbol, f64)>,
    pub(crate) drives: Vec<(usize, f64)>,
}

/// Nodes of the Gauss-Legendre rule of four points on [0, 1].
const NODES: [f64; 4] =
    [0.069_431_844_202_973_71, 0.330_009_478_207_571_87, 0.669_990_521_792_428_1, 0.930_568_155_797_026_3];

/// The drives of a cluster, as they are found.
pub(crate) struct System {
    /// How many states the cluster has.
    pub(crate) n: usize,
    pub(crate) time: Symbol,
    /// What is given from outside, with its slope; and what else is held.
    pub(crate) given: Vec<(Symbol, Symbol)>,
    pub(crate) held: Vec<Symbol>,
    pub(crate) drives: Vec<Drive>,
    /// Coefficients of each drive's derivative.
    pub(crate) moves: Vec<Vec<(usize, f64)>>,
}

impl System {
    /// The number of a drive, which is taken in if it is new.
    pub(crate) fn drive(&mut self, d: Drive) -> usize {
        if let Some(i) = self.drives.iter().position(|x| *x == d) {
            return i;
        }
        let i = self.drives.len();
        self.drives.push(d.clone());
        self.moves.push(Vec::new());
        let moves = match d {
            Drive::One | Drive::Held(_) => vec![],
            Drive::Ramp(_, slope) => vec![(self.drive(Drive::Held(slope)), 1.0)],
            Drive::Wave(rate, phase, cos) => {
                let other = self.drive(Drive::Wave(rate, phase, !cos));
                vec![(other, if cos { -rate } else { rate })]
            }
            Drive::Growth(rate, _) => vec![(i, rate)],
            Drive::Power(0) => vec![],
            Drive::Power(k) => {
                let lower = if k == 1 { self.drive(Drive::One) } else { self.drive(Drive::Power(k - 1)) };
                vec![(lower, f64::from(k))]
            }
            Drive::Cubic(_, 3) => vec![],
            Drive::Cubic(e, k) => {
                let next = self.drive(Drive::Cubic(e, k + 1));
                vec![(next, 1.0)]
            }
        };
        self.moves[i] = moves;
        i
    }

    /// The drive of a signal that comes from outside the cluster.
    pub(crate) fn outer(&mut self, pool: &mut Pool, s: Symbol) -> Option<usize> {
        if s == self.time {
            return Some(self.drive(Drive::Power(1)));
        }
        let value = pool.var(s);
        if let Some(&(_, slope)) = self.given.iter().find(|g| g.0 == s) {
            let slope = pool.var(slope);
            return Some(self.drive(Drive::Ramp(value, slope)));
        }
        self.held.contains(&s).then(|| self.drive(Drive::Held(value)))
    }

    /// Whether an expression may change within a step.
    fn moves(&self, pool: &Pool, e: Expr) -> bool {
        pool.contains_any(e, &|s| s == self.time || self.given.iter().any(|g| g.0 == s))
    }

    /// A value whose dependence on `signals` is linear with constant coefficients; `None` where it is not.
    pub(crate) fn split(&mut self, pool: &mut Pool, value: Expr, signals: &[Symbol]) -> Option<Split> {
        let (linear, rest) = pool.affine(value, signals)?;
        let mut split = Split::default();
        for (i, k) in linear {
            split.signals.push((signals[i], pool.constant(k)?));
        }
        // What comes from outside by itself, then what is left.
        let outer: Vec<Symbol> = self.given.iter().map(|g| g.0).chain(self.held.iter().copied()).collect();
        let parts = pool.affine(rest, &outer);
        let parts = parts.and_then(|(linear, rest)| {
            let linear: Option<Vec<(Symbol, f64)>> =
                linear.into_iter().map(|(i, k)| Some((outer[i], pool.constant(k)?))).collect();
            Some((linear?, rest))
        });
        let (linear, rest) = parts.unwrap_or((Vec::new(), rest));
        for (s, k) in linear {
            split.drives.push((self.outer(pool, s)?, k));
        }
        if !pool.is_zero(rest) {
            split.drives.extend(self.source(pool, rest));
        }
        Some(split)
    }

    /// A value without signals of the cluster as a combination of drives.
    fn source(&mut self, pool: &mut Pool, value: Expr) -> Vec<(usize, f64)> {
        let before = (self.drives.clone(), self.moves.clone());
        if let Some(found) = self.terms(pool, value) {
            return found;
        }
        (self.drives, self.moves) = before;
        vec![(self.drive(Drive::Cubic(value, 0)), 1.0)]
    }

    fn terms(&mut self, pool: &mut Pool, value: Expr) -> Option<Vec<(usize, f64)>> {
        if let Some(x) = pool.constant(value) {
            return Some(vec![(self.drive(Drive::One), x)]);
        }
        if !self.moves(pool, value) {
            return Some(vec![(self.drive(Drive::Held(value)), 1.0)]);
        }
        let time = self.time;
        match pool.node(value).clone() {
            Node::Sum(constant, pairs) => {
                let mut all = Vec::new();
                if !constant.is_zero() {
                    all.push((self.drive(Drive::One), constant.to_f64()));
                }
                for &(e, k) in pairs.iter() {
                    all.extend(self.terms(pool, e)?.into_iter().map(|(d, c)| (d, c * k.to_f64())));
                }
                Some(all)
            }
            Node::Product(k, pairs) => {
                if let Some(waves) = self.waves(pool, value) {
                    return Some(self.sum_of(&waves));
                }
                let mut factor = k.to_f64();
                let mut moving: Option<(Expr, Number)> = None;
                for &(e, n) in pairs.iter() {
                    match pool.constant(e) {
                        Some(x) => factor *= pool_pow(x, n),
                        None if moving.is_none() => moving = Some((e, n)),
                        None => return self.ramp(pool, value),
                    }
                }
                let (e, n) = moving?;
                let found = match n.integer() {
                    Some(1) => self.terms_of_factor(pool, e)?,
                    Some(n) if (2..=6).contains(&n) && matches!(pool.node(e), Node::Symbol(s) if *s == time) => {
                        vec![(self.drive(Drive::Power(n as u32)), 1.0)]
                    }
                    _ => return None,
                };
                Some(found.into_iter().map(|(d, c)| (d, c * factor)).collect())
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => self.terms_of_factor(pool, value),
        }
    }

    /// A product of sines and cosines as a sum of such: each a factor, and what swings where it does.
    fn waves(&self, pool: &mut Pool, e: Expr) -> Option<Waves> {
        if let Some(x) = pool.constant(e) {
            return Some(vec![(x, None)]);
        }
        let list = match pool.node(e).clone() {
            Node::Unary(f @ (Unary::Sin | Unary::Cos), arg) => {
                let (rate, phase) = pool.linear(arg, self.time)?;
                vec![(1.0, Some((pool.constant(rate)?, pool.constant(phase)?, f == Unary::Cos)))]
            }
            Node::Sum(constant, pairs) => {
                let mut list = vec![(constant.to_f64(), None)];
                for &(e, k) in pairs.iter() {
                    list.extend(self.waves(pool, e)?.into_iter().map(|(x, w)| (x * k.to_f64(), w)));
                }
                list
            }
            Node::Product(k, pairs) => {
                let mut list = vec![(k.to_f64(), None)];
                for &(e, n) in pairs.iter() {
                    let factor = self.waves(pool, e)?;
                    let times = match (&factor[..], n.integer()) {
                        ([(x, None)], _) => {
                            let x = pool_pow(*x, n);
                            list.iter_mut().for_each(|l| l.0 *= x);
                            continue;
                        }
                        (_, Some(n)) => u32::try_from(n).ok()?,
                        (_, None) => return None,
                    };
                    for _ in 0..times {
                        let more = factor.iter().flat_map(|f| list.iter().flat_map(|l| product(*l, *f)));
                        list = more.collect();
                        if list.len() > WAVES {
                            return None;
                        }
                    }
                }
                list
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => return None,
        };
        (list.len() <= WAVES).then_some(list)
    }

    fn sum_of(&mut self, waves: &Waves) -> Vec<(usize, f64)> {
        let mut all: Vec<(usize, f64)> = Vec::new();
        for &(x, wave) in waves.iter().filter(|w| w.0 != 0.0) {
            let drive = wave.map_or(Drive::One, |(rate, phase, cos)| Drive::Wave(rate, phase, cos));
            let d = self.drive(drive);
            match all.iter_mut().find(|a| a.0 == d) {
                Some(known) => known.1 += x,
                None => all.push((d, x)),
            }
        }
        all
    }

    /// Whether a cubic is anything else than what it stands for, between switches at known times.
    pub(crate) fn strays(&self, pool: &Pool) -> bool {
        self.drives.iter().any(|d| match d {
            Drive::Cubic(e, 0) => self.degree(pool, *e).is_none_or(|n| n > 3),
            _ => false,
        })
    }

    /// The degree of an expression in time, in pieces that end where time passes a number; none where it is no such
    /// polynomial.
    fn degree(&self, pool: &Pool, e: Expr) -> Option<u32> {
        if !self.moves(pool, e) {
            return Some(0);
        }
        let below = |e: Expr, most: u32| self.degree(pool, e).filter(|n| *n <= most);
        match pool.node(e) {
            Node::Number(_) => Some(0),
            // An input goes straight from row to row.
            Node::Symbol(_) => Some(1),
            Node::Sum(_, pairs) => pairs.iter().try_fold(0, |n, p| Some(n.max(self.degree(pool, p.0)?))),
            Node::Product(_, pairs) => pairs.iter().try_fold(0, |n: u32, (e, power)| {
                let power = u32::try_from(power.integer()?).ok()?;
                n.checked_add(self.degree(pool, *e)?.checked_mul(power)?)
            }),
            Node::Select(c, a, b) => {
                below(*c, 0)?;
                Some(self.degree(pool, *a)?.max(self.degree(pool, *b)?))
            }
            Node::Unary(Unary::Abs, a) => below(*a, 1),
            Node::Unary(Unary::Sign | Unary::Floor, a) => below(*a, 1).map(|_| 0),
            Node::Unary(Unary::Not, a) => below(*a, 0),
            Node::Binary(Binary::Lt | Binary::Le | Binary::Eq, a, b) => below(*a, 1).and(below(*b, 1)).map(|_| 0),
            Node::Binary(Binary::And | Binary::Or, a, b) => below(*a, 0).and(below(*b, 0)),
            Node::Binary(Binary::Min | Binary::Max, a, b) => below(*a, 1).and(below(*b, 1)),
            Node::Power(..) | Node::Unary(..) | Node::Binary(..) => None,
        }
    }

    /// A product of time and what is held.
    fn ramp(&mut self, pool: &mut Pool, value: Expr) -> Option<Vec<(usize, f64)>> {
        let (slope, rest) = pool.linear(value, self.time)?;
        let held = !self.moves(pool, slope) && !self.moves(pool, rest);
        held.then(|| vec![(self.drive(Drive::Ramp(value, slope)), 1.0)])
    }

    fn terms_of_factor(&mut self, pool: &mut Pool, e: Expr) -> Option<Vec<(usize, f64)>> {
        let time = self.time;
        match pool.node(e).clone() {
            Node::Symbol(s) if s != time && self.given.iter().any(|g| g.0 == s) => {
                Some(vec![(self.outer(pool, s)?, 1.0)])
            }
            Node::Symbol(s) if s == time => Some(vec![(self.drive(Drive::Power(1)), 1.0)]),
            Node::Unary(f @ (Unary::Sin | Unary::Cos | Unary::Exp), arg) => {
                let (rate, phase) = pool.linear(arg, time)?;
                let (rate, phase) = (pool.constant(rate)?, pool.constant(phase)?);
                let drive = match f {
                    Unary::Exp => Drive::Growth(rate, phase),
                    _ => Drive::Wave(rate, phase, f == Unary::Cos),
                };
                Some(vec![(self.drive(drive), 1.0)])
            }
            Node::Sum(..) | Node::Product(..) => self.terms(pool, e),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => None,
        }
    }
}

/// A sum: each a factor, and rate, phase and whether it is a cosine; of a constant the factor alone.
type Waves = Vec<(f64, Option<(f64, f64, bool)>)>;

/// No more of them.
const WAVES: usize = 32;

/// The product of two as a sum, by the sine and cosine of sums and differences.
fn product(a: (f64, Option<(f64, f64, bool)>), b: (f64, Option<(f64, f64, bool)>)) -> Waves {
    let x = a.0 * b.0;
    let ((rate, phase, cos), (r, p, c)) = match (a.1, b.1) {
        (None, wave) | (wave, None) => return vec![(x, wave)],
        (Some(a), Some(b)) => (a, b),
    };
    let wave = |x: f64, rate: f64, phase: f64, cos: bool| match rate == 0.0 {
        true => (x * if cos { libm::cos(phase) } else { libm::sin(phase) }, None),
        false => (x, Some((rate, phase, cos))),
    };
    let half = 0.5 * x;
    let (sum, difference) = ((rate + r, phase + p), (rate - r, phase - p));
    match (cos, c) {
        (true, true) => vec![wave(half, difference.0, difference.1, true), wave(half, sum.0, sum.1, true)],
        (false, false) => vec![wave(half, difference.0, difference.1, true), wave(-half, sum.0, sum.1, true)],
        (false, true) => vec![wave(half, sum.0, sum.1, false), wave(half, difference.0, difference.1, false)],
        (true, false) => vec![wave(half, sum.0, sum.1, false), wave(-half, difference.0, difference.1, false)],
    }
}

fn pool_pow(x: f64, n: Number) -> f64 {
    match n.integer() {
        Some(i) if i.unsigned_abs() < 64 => x.powi(i as i32),
        _ => libm::pow(x, n.to_f64()),
    }
}

/// The value of a drive at the start of a step.
pub(crate) fn drive_value(
    model: &mut Model,
    d: &Drive,
    given: &[(Symbol, Symbol)],
    (time, h): (Symbol, Symbol),
) -> Expr {
    let pool = &mut model.pool;
    let t = pool.var(time);
    match d {
        Drive::One => pool.int(1),
        Drive::Held(e) | Drive::Ramp(e, _) => *e,
        Drive::Wave(rate, phase, cos) => {
            let arg = affine(pool, *rate, *phase, t);
            pool.unary(if *cos { Unary::Cos } else { Unary::Sin }, arg)
        }
        Drive::Growth(rate, phase) => {
            let arg = affine(pool, *rate, *phase, t);
            pool.unary(Unary::Exp, arg)
        }
        Drive::Power(n) => pool.powi(t, i64::from(*n)),
        Drive::Cubic(e, k) => {
            let vandermonde = DMatrix::from_fn(4, 4, |i, j| NODES[i].powi(j as i32));
            let unit = |j: usize| DVector::from_fn(4, |i, _| if i == j { 1.0 } else { 0.0 });
            let lu = vandermonde.lu();
            let h = pool.var(h);
            let factorial = [1.0, 1.0, 2.0, 6.0][*k as usize & 3];
            let mut terms = Vec::new();
            for (j, node) in NODES.iter().enumerate() {
                let weight = lu.solve(&unit(j)).map_or(0.0, |v| v[*k as usize & 3]) * factorial;
                let c = pool.float(*node);
                let ahead = pool.mul(c, h);
                let at = pool.add(t, ahead);
                let mut map: FxHashMap<Symbol, Expr> = std::iter::once((time, at)).collect();
                for &(u, du) in given {
                    let (ue, due) = (pool.var(u), pool.var(du));
                    let gone = pool.mul(ahead, due);
                    map.insert(u, pool.add(ue, gone));
                }
                let sample = pool.substitute(*e, &map);
                let weight = pool.float(weight);
                terms.push(pool.mul(weight, sample));
            }
            let sum = pool.sum(&terms);
            let scale = pool.powi(h, i64::from(*k));
            pool.div(sum, scale)
        }
    }
}

fn affine(pool: &mut Pool, rate: f64, phase: f64, t: Expr) -> Expr {
    let rate = pool.float(rate);
    let phase = pool.float(phase);
    let x = pool.mul(rate, t);
    pool.add(x, phase)
}
