//! Divided differences across the threshold of a choice: by the pieces beside it, where the quotient would lose its
//! digits.

use super::{Along, Step};
use crate::expression::{Expr, Node, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

/// A side of a threshold.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Below,
    Above,
}

impl Pool {
    /// What the difference of a choice is where the ends lie on its two sides and no other threshold between them: the
    /// mean of the differences from the threshold `T` to each end, weighted by the distances. With it the longest step
    /// for which that is so. `None` where the choice jumps or has no threshold that is known, and where it is 0 there:
    /// then the quotient is good.
    pub(super) fn across(&mut self, (c, a, b): (Expr, Expr, Expr), step: &Step) -> Option<(Expr, f64)> {
        let s = step.symbol;
        let threshold = self.threshold(c, s)?;
        let at = self.constant(threshold).filter(|at| at.is_finite())?;
        let (lower, upper) = if self.holds_below(c, at)? { (a, b) } else { (b, a) };
        let mut longest = f64::INFINITY;
        let lower = self.beside(lower, s, (at, Side::Below), &mut longest)?;
        let upper = self.beside(upper, s, (at, Side::Above), &mut longest)?;
        let ends = [lower, upper].map(|piece| self.at(piece, s, threshold));
        let (p, q) = (self.constant(ends[0])?, self.constant(ends[1])?);
        let far = at + at.abs().max(1.0);
        let size = [p, q, self.eval(lower, &|_| far), self.eval(upper, &|_| far)].map(f64::abs);
        let size = size.into_iter().filter(|x| x.is_finite()).fold(0.0, f64::max);
        // A jump that is rounding alone is none.
        if (p == 0.0 && q == 0.0) || (p - q).abs() > 1e-12 * size {
            return None;
        }
        let low = self.binary(Binary::Min, step.from, step.to);
        let high = self.binary(Binary::Max, step.from, step.to);
        let (before, after) = (self.sub(threshold, low), self.sub(high, threshold));
        let first = self.difference(lower, s, low, before);
        let second = self.difference(upper, s, threshold, after);
        let length = self.unary(Unary::Abs, step.delta);
        let share = self.div(before, length);
        let (zero, one) = (self.zero(), self.one());
        let share = self.binary(Binary::Max, share, zero);
        let share = self.binary(Binary::Min, share, one);
        let rest = self.sub(one, share);
        let (first, second) = (self.mul(share, first), self.mul(rest, second));
        Some((self.add(first, second), longest))
    }

    /// The choice's difference: within a branch, just across the threshold, or by the quotient.
    pub(super) fn along_threshold(
        &mut self,
        (start, end): (Expr, Expr),
        (a, b): (Along, Along),
        (across, longest): (Expr, f64),
        step: &Step,
    ) -> Expr {
        let plain = self.along_choice((start, end), a, b, step);
        let both = self.select(end, a.slope, across);
        let none = self.select(end, across, b.slope);
        let split = self.select(start, both, none);
        if longest.is_infinite() {
            return split;
        }
        let length = self.unary(Unary::Abs, step.delta);
        let longest = self.float(longest);
        let near = self.binary(Binary::Lt, length, longest);
        self.select(near, split, plain)
    }

    /// Whether a comparison with this threshold holds below it; `None` where it does not change there.
    fn holds_below(&self, c: Expr, at: f64) -> Option<bool> {
        let far = at.abs().max(1.0);
        let (below, above) = (self.eval(c, &|_| at - far) != 0.0, self.eval(c, &|_| at + far) != 0.0);
        (below != above).then_some(below)
    }

    /// The expression as it is just beside a place: each choice by its branch there. The distance to the nearest other
    /// threshold on that side shortens `longest`.
    fn beside(&mut self, e: Expr, s: Symbol, (at, side): (f64, Side), longest: &mut f64) -> Option<Expr> {
        let mut known: FxHashMap<Expr, Expr> = FxHashMap::default();
        for node in self.dependents(e, &|x| x == s) {
            let new = match *self.node(node) {
                Node::Select(c, a, b) if self.contains(c, s) => {
                    let threshold = self.threshold(c, s)?;
                    let other = self.constant(threshold).filter(|x| x.is_finite())?;
                    let (lower, upper) = if self.holds_below(c, other)? { (a, b) } else { (b, a) };
                    let from_below = match side {
                        Side::Below => other >= at,
                        Side::Above => other > at,
                    };
                    let beyond = if side == Side::Below { at - other } else { other - at };
                    if beyond > 0.0 {
                        *longest = longest.min(beyond);
                    }
                    let branch = if from_below { lower } else { upper };
                    known.get(&branch).copied().unwrap_or(branch)
                }
                Node::Number(_)
                | Node::Symbol(_)
                | Node::Sum(..)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => self.rebuild(node, &|c| known.get(&c).copied().unwrap_or(c)),
            };
            known.insert(node, new);
        }
        Some(known.get(&e).copied().unwrap_or(e))
    }
}
