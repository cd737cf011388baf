//! Values of expressions.

use super::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};

/// The part of its terms that is rounding of a sum.
pub(super) const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl Pool {
    /// The value where each variable has the value `at` gives it; parameters have their own.
    pub fn eval(&self, e: Expr, at: &dyn Fn(Symbol) -> f64) -> f64 {
        self.eval_all(&[e], at)[0]
    }

    /// The values of several expressions at one place; what they share is computed once.
    pub fn eval_all(&self, all: &[Expr], at: &dyn Fn(Symbol) -> f64) -> Vec<f64> {
        let nodes = self.ascending(all, &|e| self.constant(e).is_none());
        let mut values: Vec<f64> = Vec::with_capacity(nodes.len());
        let get = |values: &[f64], e: Expr| {
            self.constant(e).unwrap_or_else(|| nodes[..values.len()].binary_search(&e).map_or(f64::NAN, |i| values[i]))
        };
        for &e in &nodes {
            let x = self.evaluate(self.node(e), &|c| get(&values, c), at);
            values.push(x);
        }
        all.iter().map(|&e| get(&values, e)).collect()
    }

    /// Whether the value `x` of an expression is no more than what its terms are rounded by: nothing more can be known
    /// of it. A value of no sum is as it is.
    pub fn is_rounding(&self, e: Expr, x: f64, at: &dyn Fn(Symbol) -> f64) -> bool {
        let size = self.size(e, at);
        x == 0.0 || (size.is_finite() && x.abs() <= ROUNDING * size)
    }

    /// What the terms of a sum come to by their magnitudes; 0 of what is none.
    fn size(&self, e: Expr, at: &dyn Fn(Symbol) -> f64) -> f64 {
        let Node::Sum(c, terms) = self.node(e) else { return 0.0 };
        let parts: Vec<Expr> = terms.iter().map(|t| t.0).collect();
        let sizes = self.eval_all(&parts, at).into_iter().zip(terms.iter()).map(|(x, t)| (x * t.1.to_f64()).abs());
        sizes.fold(c.to_f64().abs(), |sum, x| sum + x)
    }

    /// Where an expression is 0 in one symbol, near `x`: by Newton's method, with updates halved until what is left is
    /// no more than before, and defined. `at` has the other symbols' values. None where none was found to 1e-12 of what
    /// its terms are.
    pub fn root(&mut self, e: Expr, z: Symbol, mut x: f64, at: &dyn Fn(Symbol) -> f64) -> Option<f64> {
        let slope = self.derivative(e, z);
        let value = |e: Expr, x: f64| self.eval(e, &|s| if s == z { x } else { at(s) });
        for _ in 0..200 {
            let off = value(e, x);
            let mut d = off / value(slope, x);
            if off == 0.0 || !d.is_finite() {
                break;
            }
            let falls = |d: f64| value(e, x - d).abs() <= off.abs();
            while !falls(d) && d.abs() > 1e-300 {
                d *= 0.5;
            }
            x -= d;
            if d.abs() <= 1e-16 * x.abs() {
                break;
            }
        }
        let size = self.size(e, &|s| if s == z { x } else { at(s) }).max((value(slope, x) * x).abs());
        (size.is_finite() && value(e, x).abs() <= 1e-12 * size).then_some(x)
    }

    /// Whether an expression tells such a root from what lies beside it: a hundredth nearer or further it is another,
    /// beyond rounding. Far out, where a law levels off, it is not. Where 0 is as good, the root is as good as 0.
    pub fn is_told(&self, e: Expr, z: Symbol, x: f64, at: &dyn Fn(Symbol) -> f64) -> bool {
        let of = |x: f64| move |s| if s == z { x } else { at(s) };
        let (here, least) = (self.eval(e, &of(x)), ROUNDING * self.size(e, &of(x)));
        let change = |y: f64| (self.eval(e, &of(y)) - here).abs();
        change(0.99 * x) > least || change(1.01 * x) > least || change(0.0) <= least
    }

    /// The value of one node from those of its children.
    pub(super) fn evaluate(&self, node: &Node, of: &dyn Fn(Expr) -> f64, at: &dyn Fn(Symbol) -> f64) -> f64 {
        match node {
            Node::Number(n) => n.to_f64(),
            Node::Symbol(s) => self.value(*s).unwrap_or_else(|| at(*s)),
            Node::Sum(c, terms) => {
                let mut sum = c.to_f64();
                for &(e, n) in terms.iter() {
                    sum += if n.is_one() { of(e) } else { n.to_f64() * of(e) };
                }
                sum
            }
            Node::Product(c, factors) => {
                let (mut above, mut below) = (c.to_f64(), 1.0);
                for &(e, n) in factors.iter() {
                    let side = if n.is_negative() { &mut below } else { &mut above };
                    *side *= raise(of(e), n.abs());
                }
                if below == 1.0 { above } else { above / below }
            }
            Node::Power(a, b) => eval::binary(Binary::Pow, of(*a), of(*b)),
            Node::Unary(Unary::Floor, a) => {
                let (above, below) = self.fraction(*a, of);
                eval::unary(Unary::Floor, above / below)
            }
            Node::Unary(f, a) => eval::unary(*f, of(*a)),
            Node::Binary(f @ (Binary::Lt | Binary::Le | Binary::Eq), a, b) => {
                let [(a, p), (b, q)] = [*a, *b].map(|e| self.fraction(e, of));
                if p == q { eval::binary(*f, a, b) } else { eval::binary(*f, a * q, b * p) }
            }
            Node::Binary(f, a, b) => eval::binary(*f, of(*a), of(*b)),
            Node::Select(c, a, b) => {
                if of(*c) != 0.0 {
                    of(*a)
                } else {
                    of(*b)
                }
            }
        }
    }

    /// What is rounded or compared, as the value above and a number below: fractions have one denominator, by which is
    /// divided last, so that whole numbers and their ratios come out as they are (a 49th times 49 is less than 1).
    fn fraction(&self, e: Expr, of: &dyn Fn(Expr) -> f64) -> (f64, f64) {
        match self.whole(e) {
            Some((whole, d)) => (self.evaluate(&whole, of, &|_| f64::NAN), d),
            None => (of(e), 1.0),
        }
    }

    /// A sum or product whose numbers are whole, and by what to divide it; None where that is no more than halves.
    pub(super) fn whole(&self, e: Expr) -> Option<(Node, f64)> {
        let by = |d: Option<i64>| d.filter(|d| !d.unsigned_abs().is_power_of_two()).map(Number::from);
        let (whole, d) = match self.node(e) {
            Node::Sum(c, terms) => {
                let d = by(Number::denominator(terms.iter().map(|t| t.1).chain([*c])))?;
                (Node::Sum(*c * d, terms.iter().map(|&(t, n)| (t, n * d)).collect()), d)
            }
            Node::Product(c, factors) => {
                let d = by(Number::denominator([*c]))?;
                (Node::Product(*c * d, factors.clone()), d)
            }
            _ => return None,
        };
        Some((whole, d.to_f64()))
    }
}

pub(super) fn raise(x: f64, n: Number) -> f64 {
    if n.is_one() { x } else { eval::binary(Binary::Pow, x, n.to_f64()) }
}
