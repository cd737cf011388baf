//! Antiderivatives: energies from laws.

mod pieces;
mod product;

use super::unary::row;
use super::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

impl Pool {
    /// `F` with `dF/ds = e`, continuous where `e` jumps, and `F = 0` at `s = 0`; without that constant where `F` has no
    /// value at 0. `None` where no rule applies.
    pub fn antiderivative(&mut self, e: Expr, s: Symbol) -> Option<Expr> {
        let primitive = match self.primitive(e, s, 0) {
            Some(primitive) => primitive,
            None => {
                let pieces = self.by_pieces(e, s).filter(|pieces| *pieces != e)?;
                self.primitive(pieces, s, 0)?
            }
        };
        let zero = self.zero();
        let at_zero = self.at(primitive, s, zero);
        if self.constant(at_zero).is_some_and(|x| !x.is_finite()) {
            return Some(primitive);
        }
        Some(self.sub(primitive, at_zero))
    }

    /// [`Pool::antiderivative`] by one rule more, whose sum cancels near 0.
    pub fn cancelling_antiderivative(&mut self, e: Expr, s: Symbol) -> Option<Expr> {
        self.cancelling = true;
        let found = self.antiderivative(e, s);
        self.cancelling = false;
        found
    }

    /// The expression with a number or another expression in the place of `s`.
    pub(super) fn at(&mut self, e: Expr, s: Symbol, value: Expr) -> Expr {
        let map: FxHashMap<_, _> = [(s, value)].into_iter().collect();
        self.substitute(e, &map)
    }

    /// Some antiderivative.
    fn primitive(&mut self, e: Expr, s: Symbol, depth: usize) -> Option<Expr> {
        if depth > self.options.rules {
            return None;
        }
        let x = self.var(s);
        if !self.contains(e, s) {
            return Some(self.mul(e, x));
        }
        match self.node(e).clone() {
            Node::Number(_) => None,
            Node::Symbol(_) => {
                let square = self.powi(x, 2);
                Some(self.scale(square, Number::HALF))
            }
            Node::Sum(c, terms) => {
                let mut all = Vec::with_capacity(terms.len() + 1);
                for &(t, n) in terms.iter() {
                    all.push((self.primitive(t, s, depth + 1)?, n));
                }
                all.push((x, c));
                Some(self.combine(&all))
            }
            Node::Product(c, factors) => {
                let (inside, outside): (Vec<_>, Vec<_>) = factors.iter().partition(|&&(f, _)| self.contains(f, s));
                let primitive = self.primitive_product(&inside, s, depth)?;
                let outside = self.powers(&outside);
                let product = self.mul(outside, primitive);
                Some(self.scale(product, c))
            }
            Node::Power(base, exponent) => {
                if self.contains(exponent, s) {
                    // a^u = exp(u log a)
                    if self.contains(base, s) || !self.is_positive(base) {
                        return None;
                    }
                    let log = self.unary(Unary::Log, base);
                    let exponent = self.mul(exponent, log);
                    let exp = self.unary(Unary::Exp, exponent);
                    return self.primitive(exp, s, depth + 1);
                }
                self.primitive_shifted(&[(e, Number::ONE)], s)
            }
            Node::Unary(f, u) => self.primitive_function(f, u, e, s),
            Node::Binary(f, a, b) => {
                let choice = self.as_choice(f, (a, b), e)?;
                self.primitive(choice, s, depth + 1)
            }
            Node::Select(c, a, b) => self.primitive_choice(c, a, b, s, depth),
        }
    }

    /// A function as a choice: `min`, `max`, and truth values that stand as numbers.
    fn as_choice(&mut self, f: Binary, (a, b): (Expr, Expr), e: Expr) -> Option<Expr> {
        match f {
            Binary::Min | Binary::Max => {
                let less = self.binary(Binary::Lt, a, b);
                Some(if f == Binary::Min { self.select(less, a, b) } else { self.select(less, b, a) })
            }
            Binary::Lt | Binary::Le => {
                let (one, zero) = (self.one(), self.zero());
                Some(self.select(e, one, zero))
            }
            Binary::Atan2
            | Binary::Eq
            | Binary::And
            | Binary::Or
            | Binary::Add
            | Binary::Sub
            | Binary::Mul
            | Binary::Div
            | Binary::Pow => None,
        }
    }

    /// A function of an affine argument, by its slope.
    fn primitive_function(&mut self, f: Unary, u: Expr, e: Expr, s: Symbol) -> Option<Expr> {
        let (slope, _) = self.linear(u, s)?;
        let above = (row(f).antiderivative)(self, u, e)?;
        Some(self.div(above, slope))
    }

    /// `log(cosh(u))`, which is `|u| - log(2)` to rounding long before the cosine overflows.
    pub(in crate::expression) fn log_cosh(&mut self, u: Expr) -> Expr {
        let cosh = self.unary(Unary::Cosh, u);
        let near = self.unary(Unary::Log, cosh);
        let (low, high, two) = (self.int(-300), self.int(300), self.int(2));
        let log = self.unary(Unary::Log, two);
        let [below, above] =
            [Number::MINUS_ONE, Number::ONE].map(|n| self.combine(&[(u, n), (log, Number::MINUS_ONE)]));
        let (is_below, is_near) = (self.binary(Binary::Lt, u, low), self.binary(Binary::Lt, u, high));
        let rest = self.select(is_near, near, above);
        self.select(is_below, below, rest)
    }

    /// A choice by a comparison of something affine in `s` with something free of it, continued across the threshold.
    fn primitive_choice(&mut self, c: Expr, a: Expr, b: Expr, s: Symbol, depth: usize) -> Option<Expr> {
        if !self.contains(c, s) {
            let (a, b) = (self.primitive(a, s, depth + 1)?, self.primitive(b, s, depth + 1)?);
            return Some(self.select(c, a, b));
        }
        let threshold = self.threshold(c, s)?;
        let (a, b) = (self.primitive_from(a, s, threshold, depth)?, self.primitive_from(b, s, threshold, depth)?);
        let (end_a, end_b) = (self.at(a, s, threshold), self.at(b, s, threshold));
        let jump = self.sub(end_a, end_b);
        if self.constant(jump).is_some_and(|x| !x.is_finite()) {
            return None;
        }
        // the constant goes to the branch that does not hold at 0, so that nothing is left over there
        let zero = self.zero();
        let at_zero = self.at(c, s, zero);
        let to_b = self.select(at_zero, jump, zero);
        let to_a = self.sub(to_b, jump);
        let (a, b) = (self.add(a, to_a), self.add(b, to_b));
        Some(self.select(c, a, b))
    }

    /// Some antiderivative of a branch: of one that rises in a straight line from 0 at the threshold the square of the
    /// distance, which has all its digits near there.
    fn primitive_from(&mut self, e: Expr, s: Symbol, threshold: Expr, depth: usize) -> Option<Expr> {
        if let Some((slope, constant)) = self.linear(e, s)
            && !self.is_zero(slope)
        {
            let (rise, x) = (self.mul(slope, threshold), self.var(s));
            let (at, size) = (self.add(rise, constant), self.constant(constant));
            if let (Some(at), Some(size)) = (self.constant(at), size)
                && at.abs() <= 4.0 * f64::EPSILON * size.abs()
            {
                let distance = self.sub(x, threshold);
                let square = self.powi(distance, 2);
                let product = self.mul(slope, square);
                return Some(self.scale(product, Number::HALF));
            }
        }
        self.primitive(e, s, depth + 1)
    }

    /// Where a comparison changes, if it does so once.
    pub(super) fn threshold(&mut self, c: Expr, s: Symbol) -> Option<Expr> {
        match *self.node(c) {
            Node::Binary(Binary::Lt | Binary::Le, l, r) => {
                let difference = self.sub(l, r);
                let (slope, constant) = self.linear(difference, s)?;
                if self.is_zero(slope) {
                    return None;
                }
                let at = self.div(constant, slope);
                Some(self.neg(at))
            }
            Node::Unary(Unary::Not, c) => self.threshold(c, s),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => None,
        }
    }
}
