//! Sines and cosines within an iteration, by the addition formulas.
//!
//! The discrete gradient of an energy with angles asks for sines and cosines of many sums of few angles: of what they
//! are at the start, which an iteration does not change, and of multiples of half their changes. So sine and cosine of
//! each part are had once, and those of the sums are products of them. These are off by rounding of 1, where the sum
//! itself is by rounding of the angle, which may have grown to many turns; the sine of a sum of small angles keeps its
//! digits, as that sum does. What rounding took from an angle counts to first order: of one that has grown to many
//! turns it is many roundings of 1.

use crate::discretise::cluster::missing;
use crate::expression::{Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::Model;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Builder, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// The largest multiple of a part.
const MULTIPLE: i64 = 4;

/// Sine and cosine.
type Pair = (Value, Value);

/// The states, with what rounding took from each where equations leave that out.
pub(crate) type Carries = [(Symbol, Option<Value>)];

/// Angles as sums of multiples of parts.
pub(crate) struct AngleSums {
    /// The parts; those that change in the iteration come last.
    parts: Vec<Expr>,
    /// How many do not.
    fixed: usize,
    /// Sines and cosines as they are asked for: the function, its expression, and how often each part is in its
    /// argument.
    asked: Vec<(Unary, Expr, Vec<i64>)>,
}

impl AngleSums {
    /// Those of some expressions; None where none is a sum of what changes and what does not.
    pub(crate) fn of(pool: &mut Pool, all: &[Expr], unknown: &FxHashSet<Symbol>, states: &Carries) -> Option<Self> {
        let asked = asked(pool, all, unknown);
        Self::multiples(pool, &asked, unknown).or_else(|| Self::apart(pool, &asked, unknown, states))
    }

    /// Each angle as what its states make of it, and all the rest.
    fn apart(
        pool: &mut Pool,
        asked: &[(Unary, Expr, Expr)],
        unknown: &FxHashSet<Symbol>,
        states: &Carries,
    ) -> Option<Self> {
        let mut pairs = Vec::new();
        for (f, e, argument) in asked {
            let (constant, terms) = terms(pool, *argument);
            let of_states = |t: &(Expr, Number)| {
                let has = |test: &dyn Fn(Symbol) -> bool| pool.contains_any(t.0, test);
                has(&|s| states.iter().any(|x| x.0 == s)) && !has(&|s| unknown.contains(&s))
            };
            let (still, moving): (Vec<_>, Vec<_>) = terms.into_iter().partition(of_states);
            if still.is_empty() || moving.is_empty() {
                return None;
            }
            let (constant, still, moving) = (pool.numeral(constant), pool.combine(&still), pool.combine(&moving));
            pairs.push((*f, *e, pool.add(constant, still), moving));
        }
        let once = |mut list: Vec<Expr>| {
            list.sort_unstable();
            list.dedup();
            list
        };
        let still = once(pairs.iter().map(|p| p.2).collect());
        let moving = once(pairs.iter().map(|p| p.3).collect());
        let fixed = still.len();
        let parts: Vec<Expr> = still.into_iter().chain(moving).collect();
        let place: FxHashMap<Expr, usize> = parts.iter().enumerate().map(|(i, e)| (*e, i)).collect();
        let times = |a: &Expr, b: &Expr| {
            let mut times = vec![0; parts.len()];
            [a, b].into_iter().for_each(|e| times[place[e]] = 1);
            times
        };
        let asked = pairs.iter().map(|(f, e, a, b)| (*f, *e, times(a, b))).collect();
        Some(Self { parts, fixed, asked })
    }

    /// Angles as sums of multiples of few parts; None where they are not.
    fn multiples(pool: &mut Pool, asked: &[(Unary, Expr, Expr)], unknown: &FxHashSet<Symbol>) -> Option<Self> {
        let mut sums = Vec::new();
        for (f, e, argument) in asked {
            let (constant, terms) = terms(pool, *argument);
            let (moving, fixed): (Vec<_>, Vec<_>) =
                terms.into_iter().partition(|(t, _)| pool.contains_any(*t, &|s| unknown.contains(&s)));
            let fixed: Vec<(Expr, Number)> = match constant.is_zero() {
                true => fixed,
                false => vec![(
                    {
                        let c = pool.numeral(constant);
                        let f = pool.combine(&fixed);
                        pool.add(c, f)
                    },
                    Number::ratio(1, 1),
                )],
            };
            sums.push((*f, *e, fixed, moving));
        }
        let changing = units(sums.iter().flat_map(|s| &s.3))?;
        let staying = units(sums.iter().flat_map(|s| &s.2))?;
        if sums.iter().all(|s| s.2.is_empty() || s.3.is_empty()) {
            return None;
        }
        let fixed = staying.len();
        let units: Vec<(Expr, Number)> = staying.into_iter().chain(changing).collect();
        let place: FxHashMap<Expr, usize> = units.iter().enumerate().map(|(i, u)| (u.0, i)).collect();
        let mut list = Vec::new();
        for (f, e, still, moving) in sums {
            let mut times = vec![0; units.len()];
            for (t, n) in still.into_iter().chain(moving) {
                let i = place[&t];
                times[i] = multiple(n, units[i].1).filter(|m| m.abs() <= MULTIPLE)?;
            }
            list.push((f, e, times));
        }
        let parts = units.into_iter().map(|(t, n)| pool.scale(t, n)).collect();
        Some(Self { parts, fixed, asked: list })
    }

    /// The symbols that some expressions have within these sines and cosines alone.
    pub(crate) fn only(&self, pool: &Pool, all: &[Expr]) -> FxHashSet<Symbol> {
        let known: FxHashSet<Expr> = self.asked.iter().map(|a| a.1).collect();
        let (mut seen, mut stack, mut outside) = (FxHashSet::default(), all.to_vec(), FxHashSet::default());
        while let Some(e) = stack.pop() {
            if known.contains(&e) || !seen.insert(e) {
                continue;
            }
            if let Node::Symbol(s) = pool.node(e) {
                outside.insert(*s);
            }
            pool.node(e).each_child(&mut |c| stack.push(c));
        }
        let within = self.asked.iter().flat_map(|a| pool.symbols(a.1));
        within.filter(|s| !outside.contains(s)).collect()
    }

    /// Writes what an iteration does not change.
    pub(crate) fn before(
        &self,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        states: &Carries,
    ) -> Result<Vec<Pair>, Vec<Diagnostic>> {
        let mut pairs = Vec::with_capacity(self.fixed);
        for e in &self.parts[..self.fixed] {
            let (sine, cosine) = pair(model, b, lowering, *e)?;
            let mut low = None;
            for (s, carry) in states {
                let (Some(carry), true) = (carry, model.pool.contains_any(*e, &|t| t == *s)) else { continue };
                let slope = model.pool.derivative(*e, *s);
                let slope = lowering.lower(&model.pool, b, slope).map_err(|s| missing(model, s))?;
                let term = b.mul(slope, *carry);
                low = Some(low.map_or(term, |low| b.add(low, term)));
            }
            pairs.push(match low {
                None => (sine, cosine),
                Some(low) => {
                    let (more, less) = (b.mul(low, cosine), b.mul(low, sine));
                    (b.add(sine, more), b.sub(cosine, less))
                }
            });
        }
        Ok(pairs)
    }

    /// Writes the others, and what they come to.
    pub(crate) fn write(
        &self,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
        before: &[Pair],
    ) -> Result<(), Vec<Diagnostic>> {
        let mut pairs = before.to_vec();
        for e in &self.parts[self.fixed..] {
            pairs.push(pair(model, b, lowering, *e)?);
        }
        let mut known = Known { pairs, sums: FxHashMap::default() };
        for (f, e, times) in &self.asked {
            let (sine, cosine) = known.sum(b, times.clone());
            lowering.know(*e, if *f == Unary::Sin { sine } else { cosine });
        }
        Ok(())
    }
}

/// Pairs so far.
struct Known {
    pairs: Vec<Pair>,
    sums: FxHashMap<Vec<i64>, Pair>,
}

impl Known {
    /// The pair of a sum of multiples of parts.
    fn sum(&mut self, b: &mut Builder, times: Vec<i64>) -> Pair {
        if let Some(&found) = self.sums.get(&times) {
            return found;
        }
        let Some(last) = times.iter().rposition(|n| *n != 0) else { return (b.number(0.0), b.number(1.0)) };
        let n = times[last];
        let mut rest = times.clone();
        rest[last] = 0;
        let pair = if rest.iter().any(|n| *n != 0) {
            let mut own = vec![0; times.len()];
            own[last] = n;
            let (p, q) = (self.sum(b, rest), self.sum(b, own));
            added(b, p, q)
        } else if n == 1 {
            self.pairs[last]
        } else if n < 0 {
            rest[last] = -n;
            let (sine, cosine) = self.sum(b, rest);
            (b.unary(Unary::Neg, sine), cosine)
        } else {
            let mut less = rest.clone();
            (rest[last], less[last]) = (n / 2, n - n / 2);
            let (p, q) = (self.sum(b, rest), self.sum(b, less));
            added(b, p, q)
        };
        self.sums.insert(times, pair);
        pair
    }
}

/// The pair of a sum.
fn added(b: &mut Builder, p: Pair, q: Pair) -> Pair {
    let (ss, cc) = (b.mul(p.0, q.0), b.mul(p.1, q.1));
    let (sc, cs) = (b.mul(p.0, q.1), b.mul(p.1, q.0));
    (b.add(sc, cs), b.sub(cc, ss))
}

/// Writes sine and cosine of the angles whose sums and differences some expressions ask for: with them the others are
/// products.
pub(crate) fn angles(
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    all: &[Expr],
    states: &FxHashSet<Symbol>,
) -> Result<(), Vec<Diagnostic>> {
    let (mut single, mut sums, mut parts) = (FxHashSet::default(), FxHashSet::default(), Vec::new());
    for (_, _, argument) in asked(&model.pool, all, states) {
        if !matches!(model.pool.node(argument), Node::Sum(..)) {
            single.insert(argument);
            continue;
        }
        let (constant, terms) = terms(&mut model.pool, argument);
        if !constant.is_zero() || terms.len() != 2 || terms.iter().any(|(_, n)| !n.abs().is_one()) {
            continue;
        }
        sums.insert(argument);
        parts.extend(terms.into_iter().map(|t| t.0));
    }
    parts.sort_unstable();
    parts.dedup();
    // Sine and cosine of one angle are had at once.
    let more = parts.iter().filter(|e| !single.contains(*e)).count();
    if more < sums.len() {
        lowering.turn();
        for e in parts {
            pair(model, b, lowering, e)?;
        }
    }
    Ok(())
}

/// Sine and cosine of an expression.
fn pair(model: &mut Model, b: &mut Builder, lowering: &mut Lowering, e: Expr) -> Result<Pair, Vec<Diagnostic>> {
    let (sine, cosine) = (model.pool.unary(Unary::Sin, e), model.pool.unary(Unary::Cos, e));
    let mut lower = |e| lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s));
    Ok((lower(sine)?, lower(cosine)?))
}

/// All sines and cosines whose arguments change: the function, itself, its argument.
fn asked(pool: &Pool, all: &[Expr], unknown: &FxHashSet<Symbol>) -> Vec<(Unary, Expr, Expr)> {
    let (mut seen, mut stack, mut list) = (FxHashSet::default(), all.to_vec(), Vec::new());
    while let Some(e) = stack.pop() {
        if !seen.insert(e) || !pool.contains_any(e, &|s| unknown.contains(&s)) {
            continue;
        }
        if let Node::Unary(f @ (Unary::Sin | Unary::Cos), argument) = pool.node(e) {
            list.push((*f, e, *argument));
        }
        pool.node(e).each_child(&mut |c| stack.push(c));
    }
    list.sort_unstable_by_key(|t| t.1);
    list
}

/// An expression as a number and terms with their coefficients.
fn terms(pool: &mut Pool, e: Expr) -> (Number, Vec<(Expr, Number)>) {
    match pool.node(e) {
        Node::Sum(c, pairs) => (*c, pairs.to_vec()),
        Node::Product(c, _) if !c.is_one() => {
            let c = *c;
            (Number::ratio(0, 1), vec![(pool.scale(e, c.recip()), c)])
        }
        Node::Number(_)
        | Node::Symbol(_)
        | Node::Product(..)
        | Node::Power(..)
        | Node::Unary(..)
        | Node::Binary(..)
        | Node::Select(..) => (Number::ratio(0, 1), vec![(e, Number::ratio(1, 1))]),
    }
}

/// Each term once, with the largest number that its coefficients are multiples of; None where one is no ratio.
fn units<'a>(all: impl Iterator<Item = &'a (Expr, Number)>) -> Option<Vec<(Expr, Number)>> {
    let mut by: Vec<(Expr, (i64, i64))> = Vec::new();
    for (t, n) in all {
        let Number::Ratio(n, d) = *n else { return None };
        match by.iter_mut().find(|b| b.0 == *t) {
            None => by.push((*t, (n.checked_abs()?, d))),
            Some((_, unit)) => {
                let common = d.checked_mul(unit.1 / gcd(d, unit.1))?;
                let (a, b) = (n.checked_abs()?.checked_mul(common / d)?, unit.0.checked_mul(common / unit.1)?);
                *unit = (gcd(a, b), common);
            }
        }
    }
    by.sort_unstable_by_key(|b| b.0);
    Some(by.into_iter().map(|(t, (n, d))| (t, Number::ratio(n, d))).collect())
}

/// How many times a unit a number is.
fn multiple(n: Number, unit: Number) -> Option<i64> {
    let (Number::Ratio(a, b), Number::Ratio(c, d)) = (n, unit) else { return None };
    let (above, below) = (a.checked_mul(d)?, b.checked_mul(c)?);
    (below != 0 && above % below == 0).then(|| above / below)
}

fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
