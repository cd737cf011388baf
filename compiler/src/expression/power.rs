//! Powers and roots in canonical form.

use super::build::is_even;
use super::unary::row;
use super::{Expr, Node, Number, Pool, Sign};
use bond_runtime::ir::Unary;

impl Pool {
    /// `a^n` with an integer exponent.
    pub fn powi(&mut self, a: Expr, n: i64) -> Expr {
        self.power(a, Number::from(n))
    }

    /// The square root.
    pub fn sqrt(&mut self, a: Expr) -> Expr {
        self.power(a, Number::HALF)
    }

    /// `a^b`
    pub fn pow(&mut self, a: Expr, b: Expr) -> Expr {
        if let Some(n) = self.number(b) {
            if n.is_exact() {
                return self.power(a, n);
            }
            if let Some(base) = self.number(a) {
                return self.numeral(base.pow(n));
            }
        }
        if self.is_one(a) {
            return a;
        }
        if let Node::Power(base, inner) = *self.node(a)
            && self.is_positive(base)
        {
            let exponent = self.mul(inner, b);
            return self.pow(base, exponent);
        }
        self.intern(Node::Power(a, b))
    }

    /// `a^n` with an exact exponent; with another one it is rounded.
    pub(super) fn power(&mut self, a: Expr, n: Number) -> Expr {
        if n.is_zero() {
            return self.one();
        }
        if n.is_one() {
            return a;
        }
        if let Some(c) = self.number(a) {
            return self.numeral(c.pow(n));
        }
        let Number::Ratio(_, below) = n else {
            let exponent = self.numeral(n);
            return self.intern(Node::Power(a, exponent));
        };
        if below == 1 {
            return self.powers(&[(a, n)]);
        }
        match self.node(a).clone() {
            Node::Product(c, factors) => self.root_of_product(c, &factors, n),
            Node::Power(base, exponent) if self.is_positive(base) => {
                let exponent = self.scale(exponent, n);
                self.pow(base, exponent)
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => self.powers(&[(a, n)]),
        }
    }

    /// A product to a fractional exponent: what cannot be negative is taken out, the rest stays together.
    fn root_of_product(&mut self, c: Number, factors: &[(Expr, Number)], n: Number) -> Expr {
        let Number::Ratio(_, below) = n else { return self.zero() };
        let (mut out, mut inside) = (Vec::new(), Vec::new());
        for &(f, m) in factors {
            let power = m * n;
            let half = match m {
                Number::Ratio(_, d) => d % 2 == 0,
                Number::Float(_) => false,
            };
            if self.is_positive(f) || half {
                out.push((f, power));
            } else if is_even(m) {
                let size = self.unary(Unary::Abs, f);
                out.push((size, power));
            } else {
                inside.push((f, m));
            }
        }
        let mut coefficient = c;
        let root = c.exact_power(n).or_else(|| (inside.is_empty() && c.is_positive()).then(|| c.pow(n)));
        if let Some(root) = root {
            let root = self.numeral(root);
            out.push((root, Number::ONE));
            coefficient = Number::ONE;
        }
        match inside[..] {
            // of an odd power the even root is taken where the base is not negative
            [(f, m)] if coefficient.is_one() && m.integer().is_some() && (below % 2 == 0 || m.is_one()) => {
                out.push((f, m * n));
            }
            [] if coefficient.is_one() => {}
            [..] => {
                let rest = self.make_product(coefficient, inside);
                out.push((rest, n));
            }
        }
        self.powers(&out)
    }

    /// Whether it is seen at once to be positive.
    pub(super) fn is_positive(&self, e: Expr) -> bool {
        match self.node(e) {
            Node::Unary(f, _) if (row(*f).sign)(Sign::Unknown) == Sign::Positive => true,
            _ => self.constant(e).is_some_and(|x| x > 0.0),
        }
    }

    /// Whether it is printed with a minus in front, or is a sum whose first term is.
    pub(super) fn leads_negative(&self, e: Expr) -> bool {
        match self.node(e) {
            Node::Number(n) | Node::Product(n, _) => n.is_negative(),
            Node::Sum(_, terms) => terms[0].1.is_negative(),
            Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => false,
        }
    }
}
