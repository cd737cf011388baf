//! Derivatives.

use super::unary::row;
use super::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

impl Pool {
    /// The derivative with respect to a variable, piecewise at kinks: that of a sign or a comparison is 0.
    /// Derivatives are remembered for as long as the pool lives.
    pub fn derivative(&mut self, e: Expr, s: Symbol) -> Expr {
        if let Some(known) = self.remembered(e, s) {
            return known;
        }
        let zero = self.zero();
        if !self.contains(e, s) {
            return zero;
        }
        // The derivative of the variable by itself is not worth remembering.
        let one = self.one();
        if let Node::Symbol(_) = self.node(e) {
            return one;
        }
        self.differentiate_all(self.dependents(e, &|x| x == s), s);
        self.remembered(e, s).unwrap_or(zero)
    }

    /// The derivatives with respect to several variables, as [`Pool::derivative`] gives them one by one: of a long sum,
    /// each looks only at the terms that it is in.
    pub fn derivatives(&mut self, e: Expr, all: &[Symbol]) -> Vec<Expr> {
        if self.variables.few(e).is_some() {
            return all.iter().map(|&s| self.derivative(e, s)).collect();
        }
        if let Some((before, sum)) = self.scaled_sum(e, all) {
            let slopes = self.derivatives(sum, all);
            let scaled = all.iter().zip(slopes).map(|(&s, slope)| {
                let slope = self.mul(before, slope);
                self.derivatives.insert((e, s), slope);
                slope
            });
            return scaled.collect();
        }
        let Node::Sum(_, terms) = self.node(e).clone() else {
            return all.iter().map(|&s| self.derivative(e, s)).collect();
        };
        let place: FxHashMap<Symbol, usize> = all.iter().enumerate().map(|(i, &s)| (s, i)).collect();
        let mut terms_of: Vec<Vec<(Expr, Number)>> = vec![Vec::new(); all.len()];
        for &(t, n) in terms.iter() {
            let own: Vec<Symbol> = self.symbols(t).into_iter().filter(|s| place.contains_key(s)).collect();
            for s in &own {
                terms_of[place[s]].push((t, n));
            }
            if self.variables.few(t).is_none() && self.scaled_sum(t, &own).is_some() {
                self.derivatives(t, &own);
            }
        }
        let zero = self.zero();
        let mut list = Vec::with_capacity(all.len());
        for (&s, terms) in all.iter().zip(&terms_of) {
            let slope = match self.remembered(e, s) {
                Some(known) => known,
                None if terms.is_empty() => zero,
                None => {
                    self.one();
                    let new = terms.iter().filter(|t| self.remembered(t.0, s).is_none());
                    let mut nodes: Vec<Expr> = new.flat_map(|t| self.dependents(t.0, &|x| x == s)).collect();
                    nodes.sort_unstable();
                    nodes.dedup();
                    self.differentiate_all(nodes, s);
                    let parts: Vec<_> =
                        terms.iter().map(|&(t, n)| (self.slope_of(t, s), n)).filter(|&(d, _)| d != zero).collect();
                    let slope = self.combine(&parts);
                    self.derivatives.insert((e, s), slope);
                    slope
                }
            };
            list.push(slope);
        }
        list
    }

    /// What stands before a long sum that is all of a product that the variables are in.
    fn scaled_sum(&mut self, e: Expr, all: &[Symbol]) -> Option<(Expr, Expr)> {
        let Node::Product(_, factors) = self.node(e) else { return None };
        let is_long = |f: Expr| matches!(self.node(f), Node::Sum(..)) && self.variables.few(f).is_none();
        let sum = factors.iter().find(|(f, n)| n.is_one() && is_long(*f))?.0;
        let before = self.div(e, sum);
        (!self.contains_any(before, &|s| all.contains(&s))).then_some((before, sum))
    }

    /// The derivative, where it was taken before.
    fn remembered(&self, e: Expr, s: Symbol) -> Option<Expr> {
        self.derivatives.get(&(e, s)).copied()
    }

    /// Takes the derivatives of nodes, children first, and remembers them.
    fn differentiate_all(&mut self, nodes: Vec<Expr>, s: Symbol) {
        for e in nodes {
            if !matches!(self.node(e), Node::Symbol(_)) && self.remembered(e, s).is_none() {
                let slope = self.differentiate(e, s);
                self.derivatives.insert((e, s), slope);
            }
        }
    }

    /// The derivative of a node that was differentiated, or that needs not be.
    fn slope_of(&mut self, e: Expr, s: Symbol) -> Expr {
        match self.node(e) {
            Node::Symbol(x) if *x == s => self.one(),
            Node::Number(_) | Node::Symbol(_) => self.zero(),
            Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => match self.remembered(e, s) {
                Some(known) => known,
                None => self.zero(),
            },
        }
    }

    /// The derivatives with respect to several variables that are not 0, in the order of the list. A long sum is gone
    /// through once, not once for each variable.
    pub fn gradient(&mut self, e: Expr, all: &[Symbol]) -> Vec<(usize, Expr)> {
        let Node::Sum(_, terms) = self.node(e).clone() else {
            let mut found = Vec::new();
            for s in self.symbols(e) {
                found.extend(all.iter().position(|&x| x == s));
            }
            found.sort_unstable();
            let all: Vec<_> = found.into_iter().map(|i| (i, self.derivative(e, all[i]))).collect();
            return all.into_iter().filter(|&(_, d)| !self.is_zero(d)).collect();
        };
        let index: FxHashMap<Symbol, usize> = all.iter().enumerate().map(|(i, &s)| (s, i)).collect();
        let mut parts: Vec<Vec<(Expr, Number)>> = vec![Vec::new(); all.len()];
        for &(t, n) in terms.iter() {
            for s in self.symbols(t) {
                if let Some(&i) = index.get(&s) {
                    let d = self.derivative(t, s);
                    parts[i].push((d, n));
                }
            }
        }
        let mut result = Vec::new();
        for (i, part) in parts.into_iter().enumerate() {
            let d = self.combine(&part);
            if !self.is_zero(d) {
                result.push((i, d));
            }
        }
        result
    }

    /// The derivative of a node whose children's are known.
    fn differentiate(&mut self, e: Expr, s: Symbol) -> Expr {
        let zero = self.zero();
        let known = |pool: &mut Pool, c: Expr| pool.slope_of(c, s);
        match self.node(e).clone() {
            Node::Number(_) => zero,
            Node::Symbol(x) => self.int(i64::from(x == s)),
            Node::Sum(_, terms) => {
                let parts: Vec<_> =
                    terms.iter().map(|&(t, n)| (known(self, t), n)).filter(|&(d, _)| d != zero).collect();
                self.combine(&parts)
            }
            Node::Product(c, factors) => {
                let mut parts = Vec::new();
                for (i, &(f, n)) in factors.iter().enumerate() {
                    let d = known(self, f);
                    if d == zero {
                        continue;
                    }
                    if let Some((u, share)) = self.saturating(f).filter(|_| n.is_negative()) {
                        let du = known(self, u);
                        let share = self.mul(du, share);
                        parts.push((self.with(share, &factors), c * n));
                        continue;
                    }
                    let mut all = factors.to_vec();
                    all[i].1 = n + Number::MINUS_ONE;
                    let is_root = all[i].1.is_negative() && all[i].1.integer().is_none();
                    let part = if is_root { self.within_choices(d, &all) } else { self.with(d, &all) };
                    parts.push((part, c * n));
                }
                self.combine(&parts)
            }
            Node::Power(a, b) => {
                let (da, db) = (known(self, a), known(self, b));
                let one = self.one();
                let lower = self.sub(b, one);
                let lower = self.pow(a, lower);
                let base = self.product(&[b, lower, da]);
                if db == zero {
                    return base;
                }
                let log = self.unary(Unary::Log, a);
                let exponent = self.product(&[db, log, e]);
                self.add(base, exponent)
            }
            Node::Unary(f, a) => {
                let d = known(self, a);
                let slope = (row(f).derivative)(self, a, e);
                self.mul(slope, d)
            }
            Node::Binary(f, a, b) => {
                let (da, db) = (known(self, a), known(self, b));
                self.differentiate_binary(f, (a, da), (b, db))
            }
            Node::Select(c, a, b) => {
                let (da, db) = (known(self, a), known(self, b));
                self.select(c, da, db)
            }
        }
    }

    /// Of what grows as an exponential of `u` and is never 0, `u` and its slope there as a part of itself: `a + b
    /// exp(u)` has `b/(b + a exp(-u))` of itself, and `cosh(u)` its `tanh(u)`. Where it is beyond all numbers, as
    /// within a steep logistic, its own slope is so too, and beside its inverse they are none.
    fn saturating(&mut self, e: Expr) -> Option<(Expr, Expr)> {
        match self.node(e).clone() {
            Node::Unary(Unary::Cosh, u) => Some((u, self.unary(Unary::Tanh, u))),
            Node::Sum(a, terms) => {
                let &[(t, b)] = &terms[..] else { return None };
                let &Node::Unary(Unary::Exp, u) = self.node(t) else { return None };
                if a.is_zero() || a.is_negative() != b.is_negative() {
                    return None;
                }
                let back = self.neg(u);
                let back = self.unary(Unary::Exp, back);
                let one = self.one();
                let whole = self.combine(&[(one, b), (back, a)]);
                let inverse = self.powi(whole, -1);
                Some((u, self.scale(inverse, b)))
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => None,
        }
    }

    /// `d` times factors.
    fn with(&mut self, d: Expr, factors: &[(Expr, Number)]) -> Expr {
        let mut all = factors.to_vec();
        all.push((d, Number::ONE));
        self.powers(&all)
    }

    /// `d` times factors that may be infinite where it is 0, as of `sqrt(max(x, 0))`: its choices stay outside, so that
    /// 0 is 0 there.
    fn within_choices(&mut self, d: Expr, factors: &[(Expr, Number)]) -> Expr {
        match *self.node(d) {
            Node::Select(c, a, b) if self.is_zero(a) || self.is_zero(b) => {
                let (a, b) = (self.within_choices(a, factors), self.within_choices(b, factors));
                self.select(c, a, b)
            }
            _ if self.is_zero(d) => d,
            _ => self.with(d, factors),
        }
    }

    fn differentiate_binary(&mut self, f: Binary, (a, da): (Expr, Expr), (b, db): (Expr, Expr)) -> Expr {
        match f {
            Binary::Min | Binary::Max => {
                let less = self.binary(Binary::Lt, a, b);
                let (first, second) = if f == Binary::Min { (da, db) } else { (db, da) };
                self.select(less, first, second)
            }
            Binary::Atan2 => {
                let (left, right) = (self.mul(da, b), self.mul(a, db));
                let above = self.sub(left, right);
                let (a2, b2) = (self.powi(a, 2), self.powi(b, 2));
                let below = self.add(a2, b2);
                self.div(above, below)
            }
            Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => self.zero(),
            // arithmetic is never a node of this kind
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow => self.zero(),
        }
    }
}
