//! Sums and products in canonical form.

use super::node::Pairs;
use super::{Expr, Node, Number, Pool};
use bond_runtime::ir::Unary;

/// So many units in the last place of the largest summand may be what rounding left of summands that cancel.
const LEFT: f64 = 4.0;

/// A sum of numbers in the making.
#[derive(Clone, Copy)]
struct Total {
    sum: Number,
    largest: f64,
}

impl Total {
    const ZERO: Self = Self { sum: Number::ZERO, largest: 0.0 };

    fn add(&mut self, n: Number) {
        self.sum = self.sum + n;
        self.largest = self.largest.max(n.to_f64().abs());
    }

    /// The sum; 0 where only rounding is left of summands that are not exact: as a coefficient it would join what
    /// nothing joins, and as a constant move a root where a law is flat.
    fn value(self) -> Number {
        match self.sum {
            Number::Float(x) if x.abs() <= LEFT * f64::EPSILON * self.largest && x.is_finite() => Number::ZERO,
            Number::Float(_) | Number::Ratio(..) => self.sum,
        }
    }
}

/// Sorts, adds up the numbers of equal expressions, drops zeros.
fn merge(mut pairs: Vec<(Expr, Number)>) -> Vec<(Expr, Number)> {
    pairs.sort_by_key(|&(e, _)| e);
    let mut merged = Vec::with_capacity(pairs.len());
    for same in pairs.chunk_by(|a, b| a.0 == b.0) {
        let mut total = Total::ZERO;
        same.iter().for_each(|&(_, n)| total.add(n));
        merged.push((same[0].0, total.value()));
    }
    merged.retain(|(_, n)| !n.is_zero());
    merged
}

/// Whether a rational exponent is an even integer.
pub(super) fn is_even(n: Number) -> bool {
    n.integer().is_some_and(|n| n % 2 == 0)
}

/// A product in the making.
struct Factors {
    coefficient: Number,
    pairs: Vec<(Expr, Number)>,
}

impl Pool {
    /// `a + b`
    pub fn add(&mut self, a: Expr, b: Expr) -> Expr {
        self.sum(&[a, b])
    }

    /// `a - b`
    pub fn sub(&mut self, a: Expr, b: Expr) -> Expr {
        self.combine(&[(a, Number::ONE), (b, Number::MINUS_ONE)])
    }

    /// `-a`
    pub fn neg(&mut self, a: Expr) -> Expr {
        self.scale(a, Number::MINUS_ONE)
    }

    /// `a * b`
    pub fn mul(&mut self, a: Expr, b: Expr) -> Expr {
        self.product(&[a, b])
    }

    /// `a / b`
    pub fn div(&mut self, a: Expr, b: Expr) -> Expr {
        self.powers(&[(a, Number::ONE), (b, Number::MINUS_ONE)])
    }

    /// The sum of all.
    pub fn sum(&mut self, all: &[Expr]) -> Expr {
        if let [one] = all {
            return *one;
        }
        let all: Vec<_> = all.iter().map(|&e| (e, Number::ONE)).collect();
        self.combine(&all)
    }

    /// The product of all.
    pub fn product(&mut self, all: &[Expr]) -> Expr {
        let all: Vec<_> = all.iter().map(|&e| (e, Number::ONE)).collect();
        self.powers(&all)
    }

    /// A number times an expression.
    pub fn scale(&mut self, a: Expr, by: Number) -> Expr {
        if by.is_one() {
            return a;
        }
        if by.is_zero() {
            return self.numeral(by);
        }
        match self.node(a).clone() {
            Node::Number(n) => self.numeral(n * by),
            Node::Sum(c, terms) => {
                // a coefficient may underflow
                let terms = terms.iter().map(|&(e, n)| (e, n * by)).filter(|(_, n)| !n.is_zero()).collect();
                self.make_sum(c * by, terms)
            }
            Node::Product(c, factors) => self.make_product(c * by, factors),
            Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
                self.intern_product(by, Vec::from([(a, Number::ONE)]))
            }
        }
    }

    /// The sum of all, each times its number.
    pub fn combine(&mut self, all: &[(Expr, Number)]) -> Expr {
        let mut constant = Total::ZERO;
        let mut terms = Vec::with_capacity(all.len());
        for &(e, n) in all {
            if n.is_zero() {
                continue;
            }
            match self.node(e).clone() {
                Node::Number(c) => constant.add(c * n),
                Node::Sum(c, inner) => {
                    constant.add(c * n);
                    terms.extend(inner.iter().map(|&(t, c)| (t, c * n)));
                }
                Node::Product(c, _) if c.is_one() => terms.push((e, n)),
                Node::Product(c, factors) => {
                    let bare = self.make_product(Number::ONE, factors);
                    terms.push((bare, c * n));
                }
                Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
                    terms.push((e, n));
                }
            }
        }
        self.make_sum(constant.value(), merge(terms))
    }

    fn make_sum(&mut self, constant: Number, terms: Vec<(Expr, Number)>) -> Expr {
        match terms[..] {
            [] => self.numeral(constant),
            [(e, n)] if constant.is_zero() => self.scale(e, n),
            [..] => self.intern_sum(constant, terms),
        }
    }

    /// The product of canonical factors; distributes the coefficient over a sum that stands alone.
    pub(super) fn make_product(
        &mut self,
        coefficient: Number,
        factors: impl AsRef<[(Expr, Number)]> + Into<Pairs>,
    ) -> Expr {
        if coefficient.is_zero() || factors.as_ref().is_empty() {
            return self.numeral(coefficient);
        }
        if let &[(e, n)] = factors.as_ref()
            && n.is_one()
        {
            if coefficient.is_one() {
                return e;
            }
            if let Node::Sum(..) = self.node(e) {
                return self.scale(e, coefficient);
            }
        }
        self.intern_product(coefficient, factors)
    }

    /// The product of all, each to its rational exponent.
    pub fn powers(&mut self, all: &[(Expr, Number)]) -> Expr {
        match all {
            [(e, n)] if n.is_one() => return *e,
            // a number times something needs no further look
            [(a, n), (b, m)] if n.is_one() && m.is_one() => {
                if let Some(c) = self.number(*a) {
                    return self.scale(*b, c);
                }
                if let Some(c) = self.number(*b) {
                    return self.scale(*a, c);
                }
            }
            [..] => {}
        }
        let mut product = Factors { coefficient: Number::ONE, pairs: Vec::with_capacity(all.len()) };
        for &(e, n) in all {
            self.collect(&mut product, e, n);
        }
        // merging can make exponents whole, which opens up bases
        for _ in 0..8 {
            product.pairs = merge(product.pairs);
            let open = |&(e, n): &(Expr, Number)| match self.node(e) {
                Node::Number(_) => true,
                Node::Product(..) => n.integer().is_some(),
                Node::Unary(Unary::Abs, _) => is_even(n),
                Node::Power(..) => n.integer().is_some() && !n.is_one(),
                Node::Symbol(_) | Node::Sum(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => false,
            };
            if !product.pairs.iter().any(open) {
                break;
            }
            for (e, n) in std::mem::take(&mut product.pairs) {
                self.collect(&mut product, e, n);
            }
        }
        self.signs_apart(&mut product.pairs);
        self.make_product(product.coefficient, product.pairs)
    }

    /// `x^n |x|^m` with a fractional m is `sign(x)^n |x|^(n + m)`: where x is 0, the slope of one factor has no bound,
    /// and that of the product has.
    fn signs_apart(&mut self, pairs: &mut Vec<(Expr, Number)>) {
        let broken = |m: Number| m.integer().is_none();
        for i in 0..pairs.len() {
            let (size, m) = pairs[i];
            let Node::Unary(Unary::Abs, x) = *self.node(size) else { continue };
            let whole = |p: &(Expr, Number)| p.0 == x && p.1.integer().is_some_and(|n| n > 0);
            let Some(k) = pairs.iter().position(whole).filter(|_| broken(m)) else { continue };
            let n = pairs[k].1;
            pairs[i].1 = m + n;
            if is_even(n) {
                pairs.remove(k);
            } else {
                pairs[k] = (self.unary(Unary::Sign, x), Number::ONE);
            }
            *pairs = merge(std::mem::take(pairs));
            return;
        }
    }

    /// Puts `e^n` into a product.
    fn collect(&mut self, product: &mut Factors, e: Expr, n: Number) {
        if n.is_zero() {
            return;
        }
        let whole = n.integer().is_some();
        match self.node(e).clone() {
            Node::Number(c) => product.coefficient = product.coefficient * c.pow(n),
            Node::Product(c, factors) if whole => {
                product.coefficient = product.coefficient * c.pow(n);
                for &(f, m) in factors.iter() {
                    match m * n {
                        exact @ Number::Ratio(..) => product.pairs.push((f, exact)),
                        Number::Float(_) => product.pairs.push((e, n)),
                    }
                }
            }
            Node::Sum(c, terms) => {
                let content = self.content(c, &terms);
                if content.is_one() {
                    product.pairs.push((e, n));
                } else if whole {
                    product.coefficient = product.coefficient * content.pow(n);
                    let rest = self.divide_sum(c, &terms, content);
                    product.pairs.push((rest, n));
                } else if let Some(root) = content.abs().exact_power(n) {
                    product.coefficient = product.coefficient * root;
                    let rest = self.divide_sum(c, &terms, content.abs());
                    product.pairs.push((rest, n));
                } else {
                    product.pairs.push((e, n));
                }
            }
            Node::Unary(Unary::Abs, inner) if is_even(n) => self.collect(product, inner, n),
            Node::Unary(Unary::Exp, x) if !whole => {
                let x = self.scale(x, n);
                let exp = self.unary(Unary::Exp, x);
                product.pairs.push((exp, Number::ONE));
            }
            Node::Power(a, b) if whole && !n.is_one() => {
                let b = self.scale(b, n);
                let power = self.pow(a, b);
                if let Node::Power(..) = self.node(power) {
                    product.pairs.push((power, Number::ONE));
                } else {
                    self.collect(product, power, Number::ONE);
                }
            }
            Node::Product(..)
            | Node::Symbol(_)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => product.pairs.push((e, n)),
        }
    }

    /// A sum without its content; what is of the content's size becomes 1 exactly.
    fn divide_sum(&mut self, constant: Number, terms: &[(Expr, Number)], content: Number) -> Expr {
        let size = content.abs();
        let divide = |n: Number| match n.abs() == size {
            true if n.is_negative() == content.is_negative() => Number::ONE,
            true => Number::MINUS_ONE,
            false => n * content.recip(),
        };
        let terms = terms.iter().map(|&(e, n)| (e, divide(n))).collect();
        self.make_sum(divide(constant), terms)
    }

    /// What a sum that is a factor gives to the coefficient: the sign of its first term, and the size that most
    /// summands have, the largest of several, where all share it or all are powers of two, so that nothing is rounded.
    fn content(&self, constant: Number, terms: &[(Expr, Number)]) -> Number {
        let sign = if terms[0].1.is_negative() { Number::MINUS_ONE } else { Number::ONE };
        let sizes = || terms.iter().map(|t| t.1.abs()).chain((!constant.is_zero()).then(|| constant.abs()));
        let first = terms[0].1.abs();
        if first.is_finite() && sizes().all(|n| n == first) {
            return first * sign;
        }
        if !sizes().all(Number::is_binary) {
            return sign;
        }
        let mut counts: Vec<(Number, usize)> = Vec::new();
        for size in sizes() {
            match counts.iter_mut().find(|c| c.0 == size) {
                Some(count) => count.1 += 1,
                None => counts.push((size, 1)),
            }
        }
        let most = counts.into_iter().max_by(|a, b| a.1.cmp(&b.1).then(a.0.compare(b.0)));
        most.map_or(sign, |m| m.0 * sign)
    }
}
