//! The energy of a group as it is computed: without cancellation near its minimum.

use crate::discretise::cluster::maclaurin::{Expansions, Maclaurin};
use crate::expression::{Expr, Node, Number, Pool, Sign, Symbol, is_piecewise_linear};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

/// H of a group as it is to be computed, and the expansions that replace parts of it.
#[derive(Clone, Debug)]
pub(crate) struct EnergyForm {
    pub(crate) energy: Expr,
    /// The part of H that no expansion replaces; of one state, and where none does, all of it.
    pub(crate) rest: Expr,
    /// Terms of one state each.
    pub(crate) near: Vec<Term>,
}

/// A term of H that depends on one state alone, and a polynomial near rest.
#[derive(Clone, Debug)]
pub(crate) struct Term {
    /// The state, by its place in the group.
    pub(crate) place: usize,
    /// The term as it was written, and its derivative.
    pub(crate) energy: Expr,
    pub(crate) law: Expr,
    pub(crate) near: Maclaurin,
}

impl EnergyForm {
    /// Of one state.
    pub(crate) fn of(pool: &mut Pool, known: &mut Expansions, s: Symbol, energy: Expr, law: Expr) -> EnergyForm {
        let closed = self::energy(pool, s, energy);
        let Some(near) = Maclaurin::of(pool, known, s, law, closed) else {
            return EnergyForm { energy: closed, rest: energy, near: Vec::new() };
        };
        let level = near.energy(pool, closed);
        let rest = pool.zero();
        EnergyForm { energy: level, rest, near: vec![Term { place: 0, energy, law, near }] }
    }

    /// Of several states: of the terms of H that depend on one of them alone there may be such polynomials.
    pub(crate) fn of_several(pool: &mut Pool, known: &mut Expansions, states: &[Symbol], energy: Expr) -> EnergyForm {
        let mut level = EnergyForm { energy, rest: energy, near: Vec::new() };
        let Node::Sum(_, pairs) = pool.node(energy).clone() else { return level };
        for (place, s) in states.iter().enumerate() {
            let is_own = |pool: &Pool, e: Expr| {
                pool.contains(e, *s) && !pool.contains_any(e, &|x| x != *s && states.contains(&x))
            };
            let own: Vec<(Expr, Number)> = pairs.iter().filter(|(e, _)| is_own(pool, *e)).copied().collect();
            let term = pool.combine(&own);
            let law = pool.derivative(term, *s);
            let closed = self::energy(pool, *s, term);
            let near = Maclaurin::of(pool, known, *s, law, closed);
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
    pub(crate) fn law(&self, pool: &mut Pool, place: usize, law: Expr) -> Expr {
        let Some(term) = self.near.iter().find(|t| t.place == place) else { return law };
        let rest = pool.sub(law, term.law);
        let near = term.near.law(pool, term.law);
        pool.add(rest, near)
    }
}

/// H of one state it is H(0) and the change from there, written without cancellation: as in `1 - cos q` near 0, else
/// what H is near its least would be rounding of its largest term. Where H is a polynomial, has a choice in it that is
/// not of the whole, or no value at 0, as it stands; of pieces that is so for the one at 0.
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

/// With `log(u)` in the place of `log(abs(u))`, as integrals of slopes over what they are of have it, where u is seen
/// not to be negative; else with `log(u^2)/2`.
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
        matches!(n, Node::Unary(f, _) if is_piecewise_linear(*f))
            || matches!(
                n,
                Node::Select(..) | Node::Binary(Binary::Min | Binary::Max | Binary::Lt | Binary::Le | Binary::Eq, ..)
            )
    };
    let is_curved = |n: &Node| match n {
        Node::Unary(..) | Node::Power(..) => true,
        Node::Product(_, factors) => factors.iter().any(|f| f.1.integer().is_none_or(|n| n < 0)),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Binary(..) | Node::Select(..) => false,
    };
    pool.any_node(e, &is_curved) && !pool.any_node(e, &chooses)
}
