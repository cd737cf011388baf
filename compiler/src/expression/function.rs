//! Functions, comparisons and choices in canonical form.

use super::unary::{Parity, row};
use super::{Expr, Node, Number, Pool};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};

impl Pool {
    /// A function of one expression.
    pub fn unary(&mut self, f: Unary, a: Expr) -> Expr {
        if let Some(n) = self.number(a) {
            return self.numeral(match f {
                Unary::Neg => -n,
                Unary::Abs => n.abs(),
                Unary::Sqrt => n.pow(Number::HALF),
                Unary::Floor => match n {
                    Number::Ratio(n, d) => Number::from(n.div_euclid(d)),
                    Number::Float(x) => Number::float(eval::unary(f, x)),
                },
                _ => Number::float(eval::unary(f, n.to_f64())),
            });
        }
        match f {
            Unary::Neg => self.neg(a),
            Unary::Sqrt => self.sqrt(a),
            Unary::Abs => self.abs(a),
            Unary::Sign => self.sign_of(a),
            Unary::Not => {
                if let Node::Unary(Unary::Not, x) = *self.node(a)
                    && self.is_truth(x)
                {
                    return x;
                }
                match self.constant(a) {
                    Some(x) => self.numeral(Number::float(eval::unary(f, x))),
                    None => self.intern(Node::Unary(f, a)),
                }
            }
            _ => match *self.node(a) {
                Node::Unary(Unary::Exp, x) if f == Unary::Log => x,
                _ => self.function(f, a),
            },
        }
    }

    /// A function of an argument, whose leading minus is taken out of an odd one and left out of an even one.
    fn function(&mut self, f: Unary, a: Expr) -> Expr {
        let parity = row(f).parity;
        if parity == Parity::Neither || !self.leads_negative(a) {
            return self.intern(Node::Unary(f, a));
        }
        let a = self.neg(a);
        let e = self.intern(Node::Unary(f, a));
        if parity == Parity::Odd { self.neg(e) } else { e }
    }

    fn abs(&mut self, a: Expr) -> Expr {
        if let Some(x) = self.constant(a) {
            return if x < 0.0 { self.neg(a) } else { a };
        }
        if self.is_never_negative(a) {
            return a;
        }
        if let Node::Product(c, _) = *self.node(a)
            && !c.abs().is_one()
            && c.is_finite()
        {
            let bare = self.scale(a, c.recip());
            let size = self.abs(bare);
            return self.scale(size, c.abs());
        }
        let a = if self.leads_negative(a) { self.neg(a) } else { a };
        self.intern(Node::Unary(Unary::Abs, a))
    }

    fn sign_of(&mut self, a: Expr) -> Expr {
        if let Some(x) = self.constant(a) {
            return self.numeral(Number::float(eval::unary(Unary::Sign, x)));
        }
        if self.is_positive(a) {
            return self.one();
        }
        if self.leads_negative(a) {
            let a = self.neg(a);
            let sign = self.sign_of(a);
            return self.neg(sign);
        }
        if let Node::Product(c, _) = *self.node(a)
            && !c.is_one()
            && c.is_positive()
        {
            let bare = self.scale(a, c.recip());
            return self.sign_of(bare);
        }
        self.intern(Node::Unary(Unary::Sign, a))
    }

    /// Whether it is seen at once not to be negative.
    fn is_never_negative(&self, e: Expr) -> bool {
        let factor = |e: Expr, n: Number| {
            self.is_positive(e)
                || matches!(self.node(e), Node::Unary(Unary::Abs, _))
                || match n {
                    Number::Ratio(n, d) => n % 2 == 0 || d != 1,
                    Number::Float(_) => true,
                }
        };
        match self.node(e) {
            Node::Product(c, factors) => c.is_positive() && factors.iter().all(|&(e, n)| factor(e, n)),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => factor(e, Number::ONE) || self.is_truth(e),
        }
    }

    /// Whether its values are 0 and 1 alone.
    pub(super) fn is_truth(&self, e: Expr) -> bool {
        match self.node(e) {
            Node::Number(n) => n.is_zero() || n.is_one(),
            Node::Unary(f, _) => *f == Unary::Not,
            Node::Binary(f, ..) => match f {
                Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => true,
                Binary::Add
                | Binary::Sub
                | Binary::Mul
                | Binary::Div
                | Binary::Pow
                | Binary::Min
                | Binary::Max
                | Binary::Atan2 => false,
            },
            Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Power(..) | Node::Select(..) => false,
        }
    }

    /// A function of two expressions; arithmetic is forwarded.
    pub fn binary(&mut self, f: Binary, a: Expr, b: Expr) -> Expr {
        match f {
            Binary::Add => self.add(a, b),
            Binary::Sub => self.sub(a, b),
            Binary::Mul => self.mul(a, b),
            Binary::Div => self.div(a, b),
            Binary::Pow => self.pow(a, b),
            Binary::Min | Binary::Max => self.extreme(f, a, b),
            Binary::Atan2 => match (self.number(a), self.number(b)) {
                (Some(x), Some(y)) => self.numeral(Number::float(eval::binary(f, x.to_f64(), y.to_f64()))),
                (Some(_) | None, Some(_) | None) => self.intern(Node::Binary(f, a, b)),
            },
            Binary::Lt | Binary::Le | Binary::Eq => self.comparison(f, a, b),
            Binary::And | Binary::Or => self.connective(f, a, b),
        }
    }

    fn extreme(&mut self, f: Binary, a: Expr, b: Expr) -> Expr {
        if a == b {
            return a;
        }
        if let (Some(x), Some(y)) = (self.constant(a), self.constant(b))
            && !x.is_nan()
            && !y.is_nan()
        {
            return if (x < y) == (f == Binary::Min) { a } else { b };
        }
        self.intern(Node::Binary(f, a.min(b), a.max(b)))
    }

    fn comparison(&mut self, f: Binary, a: Expr, b: Expr) -> Expr {
        if let (Some(x), Some(y)) = (self.constant(a), self.constant(b)) {
            return self.numeral(Number::float(eval::binary(f, x, y)));
        }
        if a == b {
            return self.int(i64::from(f != Binary::Lt));
        }
        if let Some(simpler) = self.compare_extreme(f, a, b) {
            return simpler;
        }
        let (a, b) = if f == Binary::Eq { (a.min(b), a.max(b)) } else { (a, b) };
        self.intern(Node::Binary(f, a, b))
    }

    /// `max(x, 1) < 2` is `x < 2`: where an extreme with a constant is compared with a constant.
    fn compare_extreme(&mut self, f: Binary, a: Expr, b: Expr) -> Option<Expr> {
        if f == Binary::Eq {
            return None;
        }
        let (extreme, bound) = if self.constant(b).is_some() { (a, b) } else { (b, a) };
        self.constant(bound)?;
        let Node::Binary(g @ (Binary::Min | Binary::Max), x, y) = *self.node(extreme) else { return None };
        if self.constant(x).is_none() && self.constant(y).is_none() {
            return None;
        }
        let [x, y] = [x, y].map(|e| if extreme == a { self.binary(f, e, b) } else { self.binary(f, a, e) });
        let both = (g == Binary::Max) == (extreme == a);
        Some(self.binary(if both { Binary::And } else { Binary::Or }, x, y))
    }

    fn connective(&mut self, f: Binary, a: Expr, b: Expr) -> Expr {
        for (known, other) in [(a, b), (b, a)] {
            let Some(x) = self.constant(known) else { continue };
            let truth = x != 0.0;
            if truth == (f == Binary::Or) {
                return self.int(i64::from(truth));
            }
            if self.is_truth(other) {
                return other;
            }
        }
        if a == b && self.is_truth(a) {
            return a;
        }
        self.intern(Node::Binary(f, a.min(b), a.max(b)))
    }

    /// `if c then a else b`: `a` where `c` is not 0.
    pub fn select(&mut self, c: Expr, a: Expr, b: Expr) -> Expr {
        if let Some(x) = self.constant(c) {
            return if x != 0.0 { a } else { b };
        }
        if let Node::Unary(Unary::Not, inner) = *self.node(c) {
            return self.select(inner, b, a);
        }
        let a = match *self.node(a) {
            Node::Select(c2, a2, _) if c2 == c => a2,
            Node::Select(..)
            | Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..) => a,
        };
        let b = match *self.node(b) {
            Node::Select(c2, _, b2) if c2 == c => b2,
            Node::Select(..)
            | Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..) => b,
        };
        if a == b {
            return a;
        }
        self.intern(Node::Select(c, a, b))
    }
}
