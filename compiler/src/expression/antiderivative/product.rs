//! Antiderivatives of products.

use crate::expression::unary::row;
use crate::expression::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::ir::Unary;

impl Pool {
    /// A product of powers that all have `s` in them.
    pub(super) fn primitive_product(&mut self, factors: &[(Expr, Number)], s: Symbol, depth: usize) -> Option<Expr> {
        let whole = self.powers(factors);
        if let [(f, n)] = *factors {
            if n.is_one() {
                return self.primitive(f, s, depth + 1);
            }
            if let Some(found) = self.primitive_power(f, n, s) {
                return Some(found);
            }
        }
        if let Some(found) = self.primitive_parity(factors, s) {
            return Some(found);
        }
        if let Some(found) = self.primitive_shifted(factors, s) {
            return Some(found);
        }
        // a choice among the factors: the product is done in each branch
        for (i, &(f, n)) in factors.iter().enumerate() {
            if !n.is_positive() {
                continue;
            }
            let choice = match *self.node(f) {
                Node::Select(..) => f,
                Node::Binary(g, a, b) => match self.as_choice(g, (a, b), f) {
                    Some(choice) => choice,
                    None => continue,
                },
                Node::Number(_)
                | Node::Symbol(_)
                | Node::Sum(..)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Unary(..) => continue,
            };
            if let Node::Select(c, a, b) = *self.node(choice) {
                let mut others = factors.to_vec();
                others.remove(i);
                let others = self.powers(&others);
                let [a, b] = [a, b].map(|x| {
                    let power = self.power(x, n);
                    self.mul(power, others)
                });
                return self.primitive_choice(c, a, b, s, depth);
            }
        }
        if let Some(expanded) = self.expand(whole)
            && let Some(found) = self.primitive(expanded, s, depth + 1)
        {
            return Some(found);
        }
        if let Some(found) = self.primitive_inner(factors, s) {
            return Some(found);
        }
        self.primitive_parts(factors, s, depth)
    }

    /// `u^n` with `u` affine; `1/(a + c s^2)`.
    fn primitive_power(&mut self, u: Expr, n: Number, s: Symbol) -> Option<Expr> {
        if let Some((slope, _)) = self.linear(u, s) {
            if self.is_zero(slope) {
                return None;
            }
            let above = if n == Number::MINUS_ONE {
                let size = self.unary(Unary::Abs, u);
                self.unary(Unary::Log, size)
            } else {
                let next = n + Number::ONE;
                let power = self.power(u, next);
                self.scale(power, next.recip())
            };
            return Some(self.div(above, slope));
        }
        if n != Number::MINUS_ONE {
            return None;
        }
        let (square, linear, constant) = self.quadratic(u, &[s])?;
        let [(_, _, c)] = square[..] else { return None };
        if !linear.is_empty() || !self.is_positive(c) || !self.is_positive(constant) {
            return None;
        }
        let x = self.var(s);
        let ratio = self.div(c, constant);
        let ratio = self.sqrt(ratio);
        let angle = self.mul(x, ratio);
        let angle = self.unary(Unary::Atan, angle);
        let below = self.mul(c, constant);
        let below = self.sqrt(below);
        Some(self.div(angle, below))
    }

    /// `P(s) (c u^m)^n` with a polynomial `P`, an affine `u` and numbers or parameters `m`, `n`: as a sum over the
    /// powers of `u` in `P`.
    pub(super) fn primitive_shifted(&mut self, factors: &[(Expr, Number)], s: Symbol) -> Option<Expr> {
        let mut found = None;
        for (i, &(f, n)) in factors.iter().enumerate() {
            if let Some((u, exponent)) = self.affine_power(f, n, s) {
                found = Some((i, u, exponent));
            }
        }
        let (i, u, exponent) = found?;
        let mut rest = factors.to_vec();
        let power = rest.remove(i);
        let power = self.powers(&[power]);
        let mut rest = self.powers(&rest);
        if !self.is_polynomial(rest, s) {
            return None;
        }
        let (slope, constant) = self.linear(u, s)?;
        let root = self.div(constant, slope);
        let root = self.neg(root);
        if !self.cancelling && self.contains(rest, s) && !self.is_zero(root) {
            return None;
        }
        let mut terms = Vec::new();
        let mut factorial = Number::ONE;
        for k in 1..=self.options.rules as i64 {
            let coefficient = self.at(rest, s, root);
            let next = self.int(k);
            let next = self.add(exponent, next);
            let mut term =
                vec![(coefficient, Number::ONE), (slope, Number::from(-k)), (u, Number::from(k)), (power, Number::ONE)];
            if self.constant(next) == Some(0.0) {
                let size = self.unary(Unary::Abs, u);
                term.push((self.unary(Unary::Log, size), Number::ONE));
            } else {
                term.push((next, Number::MINUS_ONE));
            }
            terms.push((self.powers(&term), factorial.recip()));
            rest = self.derivative(rest, s);
            if self.is_zero(rest) {
                return Some(self.combine(&terms));
            }
            factorial = factorial * Number::from(k);
        }
        None
    }

    /// `f^n` as a power of something affine in `s`, but for a constant: that, and the exponent, unless it is a whole
    /// number above 0.
    fn affine_power(&mut self, f: Expr, n: Number, s: Symbol) -> Option<(Expr, Expr)> {
        let (base, exponent) = match *self.node(f) {
            Node::Power(a, b) if !self.contains(b, s) => (a, self.scale(b, n)),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => (f, self.numeral(n)),
        };
        let (u, m) = match self.node(base).clone() {
            Node::Product(_, factors) => {
                let mut inside = factors.iter().filter(|f| self.contains(f.0, s));
                let first = *inside.next()?;
                inside.next().is_none().then_some(first)?
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => (base, Number::ONE),
        };
        let exponent = self.scale(exponent, m);
        if self.number(exponent).is_some_and(|n| n.integer().is_some() && n.is_positive()) {
            return None;
        }
        let (slope, _) = self.linear(u, s)?;
        (!self.is_zero(slope)).then_some((u, exponent))
    }

    /// `u^n |u|^r sign(u)^m` with one affine `u` and whole `n`, `m`: `u |u|^k` or `|u|^(k+1)` over `k + 1`.
    fn primitive_parity(&mut self, factors: &[(Expr, Number)], s: Symbol) -> Option<Expr> {
        let mut base: Option<Expr> = None;
        let (mut power, mut odd) = (Number::ZERO, false);
        for &(f, n) in factors {
            let (u, signed) = match *self.node(f) {
                Node::Unary(Unary::Abs, u) => {
                    power = power + n;
                    (u, false)
                }
                Node::Unary(Unary::Sign, u) => (u, true),
                Node::Symbol(_)
                | Node::Sum(..)
                | Node::Number(_)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => {
                    power = power + n;
                    (f, true)
                }
            };
            if *base.get_or_insert(u) != u {
                return None;
            }
            if signed {
                odd ^= n.integer()? % 2 != 0;
            }
        }
        let u = base?;
        let (slope, _) = self.linear(u, s)?;
        let next = power + Number::ONE;
        if !next.is_positive() {
            return None;
        }
        let size = self.unary(Unary::Abs, u);
        let above = if odd {
            self.power(size, next)
        } else {
            let power = self.power(size, power);
            self.mul(u, power)
        };
        let above = self.scale(above, next.recip());
        Some(self.div(above, slope))
    }

    /// `g' g^n` and `g' f(g)`, where the other factors are the derivative of `g` but for a constant.
    fn primitive_inner(&mut self, factors: &[(Expr, Number)], s: Symbol) -> Option<Expr> {
        for (i, &(f, n)) in factors.iter().enumerate() {
            let mut others = factors.to_vec();
            others.remove(i);
            let mut tries = vec![(f, None)];
            if let Node::Unary(g, u) = *self.node(f)
                && n.is_one()
            {
                tries.push((u, Some(g)));
            }
            for (inner, function) in tries {
                let derivative = self.derivative(inner, s);
                if self.is_zero(derivative) {
                    continue;
                }
                let mut rest = others.clone();
                rest.push((derivative, Number::MINUS_ONE));
                let rest = self.powers(&rest);
                if self.contains(rest, s) {
                    continue;
                }
                // the same in a variable of its own
                let u = self.symbol("");
                let x = self.var(u);
                let outer = match function {
                    Some(g) => self.unary(g, x),
                    None => self.power(x, n),
                };
                if let Some(found) = self.primitive(outer, u, self.options.rules) {
                    let found = self.at(found, u, inner);
                    return Some(self.mul(rest, found));
                }
            }
        }
        None
    }

    /// A power of `s` times a function of an affine argument, by parts.
    fn primitive_parts(&mut self, factors: &[(Expr, Number)], s: Symbol, depth: usize) -> Option<Expr> {
        let x = self.var(s);
        let place = factors.iter().position(|&(f, n)| f == x && n.integer().is_some_and(|n| n > 0))?;
        let mut rest = factors.to_vec();
        let (_, n) = rest.remove(place);
        let [(f, one)] = rest[..] else { return None };
        if !one.is_one() {
            return None;
        }
        if !matches!(*self.node(f), Node::Unary(f, _) if row(f).by_parts) {
            return None;
        }
        let inner = self.primitive(f, s, depth + 1)?;
        let first = self.power(x, n);
        let first = self.mul(first, inner);
        let lower = self.power(x, n + Number::MINUS_ONE);
        let lower = self.mul(lower, inner);
        let second = self.primitive(lower, s, depth + 1)?;
        Some(self.combine(&[(first, Number::ONE), (second, -n)]))
    }
}
