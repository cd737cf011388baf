//! Where energies are least, and how far they stand above 0 without cancellation.

use super::cluster::{Cluster, Group};
use super::near::{Known, Near};
use crate::expression::{Expr, Node, Number, Pool, Sign, Symbol};
use crate::model::Model;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

/// Where the least of an energy is looked for, on both sides of where it is near: powers of ten, in SI units.
const DECADES: std::ops::RangeInclusive<i32> = -9..=9;

/// H of a group as it is to be computed, and where polynomials stand for it.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) energy: Expr,
    /// The part of H that no polynomial stands for; of one state, and where none does, all of it.
    pub(super) rest: Expr,
    /// Terms of one state each.
    pub(super) near: Vec<Term>,
}

/// A term of H that depends on one state alone, and a polynomial near rest.
#[derive(Clone, Debug)]
pub(super) struct Term {
    /// The state, by its place in the group.
    pub(super) place: usize,
    /// The term as it was written, and its derivative.
    pub(super) energy: Expr,
    pub(super) law: Expr,
    pub(super) near: Near,
}

impl Level {
    /// Of one state.
    pub(super) fn of(pool: &mut Pool, known: &mut Known, s: Symbol, energy: Expr, law: Expr) -> Level {
        let closed = self::energy(pool, s, energy);
        let Some(near) = Near::of(pool, known, s, law, closed) else {
            return Level { energy: closed, rest: energy, near: Vec::new() };
        };
        let level = near.energy(pool, closed);
        let rest = pool.zero();
        Level { energy: level, rest, near: vec![Term { place: 0, energy, law, near }] }
    }

    /// Of several states: of the terms of H that depend on one of them alone there may be such polynomials.
    pub(super) fn of_several(pool: &mut Pool, known: &mut Known, states: &[Symbol], energy: Expr) -> Level {
        let mut level = Level { energy, rest: energy, near: Vec::new() };
        let Node::Sum(_, pairs) = pool.node(energy).clone() else { return level };
        for (place, s) in states.iter().enumerate() {
            let is_own = |pool: &Pool, e: Expr| {
                pool.contains(e, *s) && !pool.contains_any(e, &|x| x != *s && states.contains(&x))
            };
            let own: Vec<(Expr, Number)> = pairs.iter().filter(|(e, _)| is_own(pool, *e)).copied().collect();
            let term = pool.combine(&own);
            let law = pool.derivative(term, *s);
            let closed = self::energy(pool, *s, term);
            let near = Near::of(pool, known, *s, law, closed);
            let rise = near.as_ref().map_or(closed, |near| near.energy(pool, closed));
            let others = pool.sub(level.energy, term);
            level.energy = pool.add(others, rise);
            if let Some(near) = near {
                level.rest = pool.sub(level.rest, term);
                level.near.push(Term { place, energy: term, law, near });
            }
        }
        level
    }

    /// The law of the state at a place, with the polynomials in it.
    pub(super) fn law(&self, pool: &mut Pool, place: usize, law: Expr) -> Expr {
        let Some(term) = self.near.iter().find(|t| t.place == place) else { return law };
        let rest = pool.sub(law, term.law);
        let near = term.near.law(pool, term.law);
        pool.add(rest, near)
    }
}

/// H of one state it is H(0) and the change from there, written without
/// cancellation: as in `1 - cos q` near 0, else what H is near its least would be rounding of its largest term. Where H
/// is a polynomial, has a choice in it that is not of the whole, or no value at 0, as it stands; of pieces that is so for
/// the one at 0.
fn energy(pool: &mut Pool, s: Symbol, energy: Expr) -> Expr {
    if !pool.contains(energy, s) {
        return energy;
    }
    if let Node::Select(c, a, b) = *pool.node(energy) {
        let here = pool.eval(c, &|_| 0.0) != 0.0;
        let (a, b) = if here { (self::energy(pool, s, a), b) } else { (a, self::energy(pool, s, b)) };
        return pool.select(c, a, b);
    }
    let plain = without_sizes(pool, energy);
    if !is_smooth(pool, plain) {
        return energy;
    }
    let zero = pool.int(0);
    let map: FxHashMap<Symbol, Expr> = std::iter::once((s, zero)).collect();
    let base = pool.substitute(plain, &map);
    if !pool.constant(base).is_some_and(f64::is_finite) {
        return energy;
    }
    let x = pool.var(s);
    let slope = pool.difference(plain, s, zero, x);
    let rise = pool.mul(x, slope);
    let level = pool.add(base, rise);
    let same = [1e-3, -0.02, 0.3, -1.7, 12.0].iter().all(|at| {
        let values = pool.eval_all(&[energy, level, base], &|t| if t == s { *at } else { 0.7 });
        let (a, b, c) = (values[0], values[1], values[2]);
        !a.is_finite() || (a - b).abs() <= 1e-9 * (a.abs() + c.abs())
    });
    if same { level } else { energy }
}

/// With `log(u)` in the place of `log(abs(u))`, as integrals of slopes over what they are of have it, where u is seen not
/// to be negative; else with `log(u^2)/2`.
fn without_sizes(pool: &mut Pool, energy: Expr) -> Expr {
    let mut new: FxHashMap<Expr, Expr> = FxHashMap::default();
    for e in pool.ascending(&[energy], &|_| true) {
        let size = match pool.node(e) {
            Node::Unary(Unary::Log, a) => match pool.node(*a) {
                Node::Unary(Unary::Abs, u) => Some(*u),
                _ => None,
            },
            _ => None,
        };
        let made = match size {
            Some(u) => {
                let u = new.get(&u).copied().unwrap_or(u);
                if matches!(pool.sign(u, &|_| Sign::Unknown), Sign::Positive | Sign::NonNegative) {
                    pool.unary(Unary::Log, u)
                } else {
                    let square = pool.mul(u, u);
                    let (log, half) = (pool.unary(Unary::Log, square), pool.ratio(1, 2));
                    pool.mul(half, log)
                }
            }
            None => pool.rebuild(e, &|c| new.get(&c).copied().unwrap_or(c)),
        };
        new.insert(e, made);
    }
    new.get(&energy).copied().unwrap_or(energy)
}

/// Whether an expression has a function or a root in it, and no choice.
fn is_smooth(pool: &Pool, e: Expr) -> bool {
    let chooses = |n: &Node| {
        matches!(
            n,
            Node::Select(..)
                | Node::Binary(Binary::Min | Binary::Max | Binary::Lt | Binary::Le | Binary::Eq, ..)
                | Node::Unary(Unary::Abs | Unary::Sign | Unary::Floor | Unary::Not, _)
        )
    };
    let is_curved = |n: &Node| match n {
        Node::Unary(..) | Node::Power(..) => true,
        Node::Product(_, factors) => factors.iter().any(|f| f.1.integer().is_none_or(|n| n < 0)),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Binary(..) | Node::Select(..) => false,
    };
    pool.any_node(e, &is_curved) && !pool.any_node(e, &chooses)
}

/// The least energy of a group near where it starts; where there is none, as of heat, which is least at no temperature,
/// its energy at the start.
pub(super) fn least(model: &mut Model, g: &Group, c: &Cluster) -> f64 {
    bottom(model, g, c).0
}

/// The same, and whether it is a least energy rather than that at the start.
pub(super) fn bottom(model: &mut Model, g: &Group, c: &Cluster) -> (f64, bool) {
    // Of each state its symbol, where the energy is least, and where it starts.
    let at: Vec<(Symbol, f64, f64)> =
        g.states.iter().map(|s| (c.states[*s].symbol, minimum(model, g, c, *s), c.states[*s].initial)).collect();
    let level = |e: Expr, initial: bool| {
        model.pool.eval(e, &|s| at.iter().find(|t| t.0 == s).map_or(0.0, |t| if initial { t.2 } else { t.1 }))
    };
    let rise = (level(g.energy, true) - level(g.energy, false)).abs();
    let flat = g.coenergy.iter().zip(&at).all(|(z, t)| level(*z, false).abs() * (t.2 - t.1).abs() <= 1e-6 * rise);
    let h = level(g.energy, !flat);
    if h.is_finite() { (h, flat) } else { (0.0, false) }
}

/// The state where a storage's energy is least, near where it starts: by walking down and Newton's method.
pub(super) fn minimum(model: &mut Model, g: &Group, c: &Cluster, state: usize) -> f64 {
    if g.states.len() > 1 {
        return down(model, g, c, state);
    }
    let symbol = c.states[state].symbol;
    let Some(&slope) = g.coenergy.first() else { return 0.0 };
    let curvature = model.pool.derivative(slope, symbol);
    let at = |e: Expr, x: f64| model.pool.eval(e, &|_| x);
    if at(slope, 0.0) == 0.0 && at(curvature, 0.0) >= 0.0 {
        return 0.0;
    }
    let x = walk(&model.pool, [g.energy, slope, curvature], c.states[state].initial);
    if x.is_finite() { x } else { 0.0 }
}

/// Where an energy of one state, with its slope and curvature, is least near a value of that.
fn walk(pool: &Pool, [energy, slope, curvature]: [Expr; 3], mut x: f64) -> f64 {
    let at = |e: Expr, x: f64| pool.eval(e, &|_| x);
    for _ in 0..24 {
        let mut d = at(slope, x) / at(curvature, x).abs();
        if !d.is_finite() || d.abs() <= 1e-15 * x.abs() {
            break;
        }
        // What is out of the energy's domain is not lower either.
        let falls = |d: f64| at(energy, x - d) <= at(energy, x);
        while !falls(d) && d.abs() > 1e-300 {
            d *= 0.5;
        }
        x -= d;
    }
    x
}

/// The least that the energy of a group can be, as far as it is seen: near where it starts, and where powers of ten lie
/// beside that and 0. What a sampled region has to give is counted from there: an energy has no zero of its own.
pub(super) fn lowest(model: &mut Model, g: &Group, c: &Cluster) -> f64 {
    if c.time.is_some_and(|t| model.pool.contains(g.energy, t)) {
        return 0.0;
    }
    let start: Vec<(Symbol, f64)> = g.states.iter().map(|s| (c.states[*s].symbol, c.states[*s].initial)).collect();
    let near: Vec<f64> = g.states.iter().map(|s| minimum(model, g, c, *s)).collect();
    let slopes = match (&g.coenergy[..], &start[..]) {
        (&[slope], &[(symbol, _)]) => Some([g.energy, slope, model.pool.derivative(slope, symbol)]),
        _ => None,
    };
    let pool = &model.pool;
    let energy =
        |x: &dyn Fn(usize) -> f64| pool.eval(g.energy, &|s| start.iter().position(|t| t.0 == s).map_or(0.0, x));
    let mut least = f64::INFINITY;
    let mut look = |h: f64| {
        let lower = h < least;
        least = if lower { h } else { least };
        lower
    };
    look(energy(&|i| start[i].1));
    look(energy(&|i| near[i]));
    for base in [&near, &start.iter().map(|s| s.1).collect()] {
        for (k, x) in base.iter().enumerate() {
            for off in DECADES.flat_map(|n| [1.0, -1.0].map(|side| side * libm::exp10(f64::from(n)))) {
                if look(energy(&|i| if i == k { x + off } else { base[i] }))
                    && let Some(slopes) = slopes
                {
                    let x = walk(pool, slopes, x + off);
                    look(energy(&|_| x));
                }
            }
        }
    }
    if least.is_finite() { least } else { 0.0 }
}

/// One coordinate of the state of least energy of several: down along one after the other.
fn down(model: &mut Model, g: &Group, c: &Cluster, state: usize) -> f64 {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    let mut x: Vec<f64> = vec![0.0; symbols.len()];
    let value = |model: &Model, e: Expr, x: &[f64]| {
        model.pool.eval(e, &|s| symbols.iter().position(|t| *t == s).map_or(0.0, |i| x[i]))
    };
    let flat = |model: &Model, x: &[f64]| g.coenergy.iter().all(|z| value(model, *z, x) == 0.0);
    if !flat(model, &x) {
        x = g.states.iter().map(|s| c.states[*s].initial).collect();
        let slopes: Vec<Expr> = g.coenergy.iter().zip(&symbols).map(|(z, s)| model.pool.derivative(*z, *s)).collect();
        for _ in 0..500 {
            let before = x.clone();
            for i in 0..x.len() {
                let mut d = value(model, g.coenergy[i], &x) / value(model, slopes[i], &x).abs();
                let h = value(model, g.energy, &x);
                let from = x[i];
                while d.is_finite() && d != 0.0 && d.abs() > 1e-16 * from.abs() {
                    x[i] = from - d;
                    if value(model, g.energy, &x) <= h {
                        break;
                    }
                    x[i] = from;
                    d *= 0.5;
                }
            }
            if x == before {
                break;
            }
        }
    }
    g.states.iter().position(|s| *s == state).map_or(0.0, |i| if x[i].is_finite() { x[i] } else { 0.0 })
}
