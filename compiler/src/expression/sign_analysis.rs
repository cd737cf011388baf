//! Signs of expressions, from those of their symbols.

use super::unary::row;
use super::{Expr, Node, Number, Pool, Sign, Symbol};
use bond_runtime::ir::Binary;
use rustc_hash::FxHashMap;

impl Pool {
    /// What can be said of the sign of an expression, where each variable has the sign that `assume` gives it;
    /// parameters have that of their value. Values are taken as exact and finite.
    pub fn sign(&self, e: Expr, assume: &dyn Fn(Symbol) -> Sign) -> Sign {
        let mut known: FxHashMap<Expr, Sign> = FxHashMap::default();
        for e in self.ascending(&[e], &|_| true) {
            let sign = match self.constant(e) {
                Some(x) => Sign::of(x),
                None => self.sign_of_node(e, &|c| known.get(&c).copied().unwrap_or(Sign::Unknown), assume),
            };
            known.insert(e, sign);
        }
        known.get(&e).copied().unwrap_or(Sign::Unknown)
    }

    /// Whether a choice has a part in it.
    pub fn is_chosen(&self, e: Expr) -> bool {
        self.any_node(e, &|n| matches!(n, Node::Select(..)))
    }

    /// Whether it is above 0 whatever is chosen in it, by a choice: a resistance that is switched.
    pub fn is_switched(&self, e: Expr) -> bool {
        self.is_chosen(e) && self.sign(e, &|_| Sign::Unknown) == Sign::Positive
    }

    fn sign_of_node(&self, e: Expr, of: &dyn Fn(Expr) -> Sign, assume: &dyn Fn(Symbol) -> Sign) -> Sign {
        match self.node(e) {
            Node::Number(n) => Sign::of(n.to_f64()),
            Node::Symbol(s) => assume(*s),
            Node::Sum(c, terms) => {
                let all = terms.iter().map(|&(t, n)| of(t).times(Sign::of(n.to_f64())));
                let sum = all.fold(Sign::of(c.to_f64()), Sign::plus);
                if sum == Sign::Unknown { self.sign_of_offset(*c, terms) } else { sum }
            }
            Node::Product(c, factors) => {
                let all = factors.iter().map(|&(f, n)| sign_of_power(of(f), n));
                all.fold(Sign::of(c.to_f64()), Sign::times)
            }
            Node::Power(a, _) => {
                if of(*a) == Sign::Positive {
                    Sign::Positive
                } else {
                    Sign::Unknown
                }
            }
            Node::Unary(f, a) => (row(*f).sign)(of(*a)),
            Node::Binary(f, a, b) => sign_of_binary(*f, of(*a), of(*b)),
            Node::Select(c, a, b) => match of(*c) {
                Sign::Zero => of(*b),
                Sign::Positive | Sign::Negative => of(*a),
                Sign::NonNegative | Sign::NonPositive | Sign::Unknown => of(*a).join(of(*b)),
            },
        }
    }

    /// `1 - f` and `1 + f` with `|f| <= 1`; `-1 + f` with `f >= 1`.
    fn sign_of_offset(&self, c: Number, terms: &[(Expr, Number)]) -> Sign {
        let (mut low, mut high) = (c.to_f64(), c.to_f64());
        for &(t, n) in terms {
            let n = n.to_f64();
            let (a, b) = self.bounds(t);
            let (a, b) = if n > 0.0 { (n * a, n * b) } else { (n * b, n * a) };
            low += a;
            high += b;
        }
        if low > 0.0 {
            Sign::Positive
        } else if low == 0.0 {
            Sign::NonNegative
        } else if high < 0.0 {
            Sign::Negative
        } else if high == 0.0 {
            Sign::NonPositive
        } else {
            Sign::Unknown
        }
    }

    /// Bounds that hold for all arguments.
    fn bounds(&self, e: Expr) -> (f64, f64) {
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        if let Some(x) = self.constant(e) {
            return if x.is_nan() { all } else { (x, x) };
        }
        match self.node(e) {
            Node::Unary(f, _) => row(*f).range,
            Node::Product(c, factors) => {
                // an even power of something bounded
                let [(f, n)] = factors[..] else { return all };
                let Some(n) = n.integer().filter(|n| *n > 0) else { return all };
                let (a, b) = self.bounds_of_factor(f);
                let size = libm::pow(a.abs().max(b.abs()), n as f64);
                let (low, high) = if n % 2 == 0 { (0.0, size) } else { (-size, size) };
                let c = c.to_f64();
                if c > 0.0 { (c * low, c * high) } else { (c * high, c * low) }
            }
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Power(..)
            | Node::Binary(..)
            | Node::Select(..) => all,
        }
    }

    fn bounds_of_factor(&self, e: Expr) -> (f64, f64) {
        match self.node(e) {
            Node::Unary(..) => self.bounds(e),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Binary(..)
            | Node::Select(..) => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }
}

fn sign_of_power(base: Sign, n: Number) -> Sign {
    let size = base.join(base.negative());
    let nonnegative = if base.is_nonzero() || n.is_negative() { Sign::Positive } else { Sign::NonNegative };
    match n {
        _ if base == Sign::Zero => {
            if n.is_negative() {
                Sign::Unknown
            } else {
                Sign::Zero
            }
        }
        Number::Ratio(n, 1) if n % 2 == 0 => nonnegative,
        // 1/0 is excluded: values are finite
        Number::Ratio(n, 1) if n < 0 => match base {
            Sign::NonNegative => Sign::Positive,
            Sign::NonPositive => Sign::Negative,
            Sign::Zero | Sign::Positive | Sign::Negative | Sign::Unknown => base,
        },
        Number::Ratio(_, 1) => base,
        // roots have a value where the base is not negative
        Number::Ratio(..) | Number::Float(_) if size.is_nonzero() => Sign::Positive,
        Number::Ratio(..) | Number::Float(_) => nonnegative,
    }
}

fn sign_of_binary(f: Binary, a: Sign, b: Sign) -> Sign {
    // b - a
    let gap = b.plus(a.negative());
    let truth = |yes: bool, no: bool| match (yes, no) {
        (true, _) => Sign::Positive,
        (_, true) => Sign::Zero,
        (false, false) => Sign::NonNegative,
    };
    match f {
        Binary::Lt => truth(gap == Sign::Positive, gap.is_nonpositive()),
        Binary::Le => truth(gap.is_nonnegative(), gap == Sign::Negative),
        Binary::Eq => truth(gap == Sign::Zero, gap.is_nonzero()),
        Binary::And => truth(a.is_nonzero() && b.is_nonzero(), a == Sign::Zero || b == Sign::Zero),
        Binary::Or => truth(a.is_nonzero() || b.is_nonzero(), a == Sign::Zero && b == Sign::Zero),
        Binary::Min if a == Sign::Positive && b == Sign::Positive => Sign::Positive,
        Binary::Min if a.is_nonnegative() && b.is_nonnegative() => a.join(b),
        Binary::Min if a == Sign::Negative || b == Sign::Negative => Sign::Negative,
        Binary::Min if a.is_nonpositive() || b.is_nonpositive() => Sign::NonPositive,
        Binary::Max => sign_of_binary(Binary::Min, a.negative(), b.negative()).negative(),
        Binary::Min | Binary::Atan2 => Sign::Unknown,
        Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow => Sign::Unknown,
    }
}
