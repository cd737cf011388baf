//! Divided differences of powers.

use super::{Along, Step, TWO};
use crate::expression::{Expr, Number, Pool};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

/// Powers above this are taken apart into smaller ones.
const LONGEST: i64 = 8;

impl Pool {
    /// `y^n`
    pub(super) fn along_power(&mut self, y: Along, n: Number, step: &Step) -> Along {
        let (from, to) = (self.power(y.from, n), self.power(y.to, n));
        if n.is_one() {
            return y;
        }
        let slope = if n.is_negative() {
            // 1/b - 1/a = -(b - a)/(a b)
            let inverse = self.along_power(y, -n, step);
            let below = [(inverse.from, Number::MINUS_ONE), (inverse.to, Number::MINUS_ONE)];
            let below = self.powers(&below);
            let slope = self.mul(inverse.slope, below);
            self.neg(slope)
        } else {
            match n {
                Number::Ratio(n, 1) => self.along_whole_power(y, n, step),
                Number::Ratio(n, 2) => self.along_half_power(y, n, step),
                Number::Ratio(..) | Number::Float(_) => self.along_rational_power(y, n, (from, to), step),
            }
        };
        Along { from, to, slope }
    }

    /// By the mean `m` and half the change `h`: `((m + h)^n - (m - h)^n) / 2h = Σ binomial(n, k) m^(n-k) h^(k-1)` over
    /// odd `k`, where all terms have one sign.
    pub(super) fn along_whole_power(&mut self, y: Along, n: i64, step: &Step) -> Expr {
        if n > LONGEST {
            let root = self.along_power(y, Number::from(n / 2), step);
            let square = self.along_power(root, TWO, step);
            if n % 2 == 0 {
                return square.slope;
            }
            return self.along_product(square, y).slope;
        }
        let mean = self.mean(y);
        let change = self.change(y, step);
        let half = self.scale(change, Number::HALF);
        let mut terms = Vec::new();
        let mut binomial = Number::ONE;
        for k in 1..=n {
            binomial = binomial * Number::ratio(n + 1 - k, k);
            if k % 2 == 1 {
                let power = self.powers(&[(mean, Number::from(n - k)), (half, Number::from(k - 1))]);
                terms.push((power, binomial));
            }
        }
        let [(first, coefficient)] = terms[..] else {
            let sum = self.combine(&terms);
            return self.mul(y.slope, sum);
        };
        let product = self.mul(y.slope, first);
        self.scale(product, coefficient)
    }

    /// `y^(n/2)` with `n` odd: by the roots `a` and `b` of the ends, `(b^n - a^n)/(b^2 - a^2)`.
    pub(super) fn along_half_power(&mut self, y: Along, n: i64, step: &Step) -> Expr {
        if n > LONGEST {
            let whole = self.along_power(y, Number::from(n / 2), step);
            let root = self.along_power(y, Number::HALF, step);
            return self.along_product(whole, root).slope;
        }
        let (a, b) = (self.sqrt(y.from), self.sqrt(y.to));
        let both = self.add(a, b);
        if n == 1 {
            return self.div(y.slope, both);
        }
        let mut terms = Vec::new();
        for k in 0..n {
            terms.push(self.powers(&[(y.from, Number::ratio(n - 1 - k, 2)), (y.to, Number::ratio(k, 2))]));
        }
        let sum = self.sum(&terms);
        let slope = self.product(&[y.slope, sum]);
        let slope = self.div(slope, both);
        let at_zero = self.power_slope(y, Number::ratio(n, 2));
        let zero = self.zero();
        let positive = self.binary(Binary::Lt, zero, both);
        self.select(positive, slope, at_zero)
    }

    /// The derivative of `y^n` at the mean, times the slope of `y`.
    fn power_slope(&mut self, y: Along, n: Number) -> Expr {
        let mean = self.mean(y);
        let power = self.power(mean, n + Number::MINUS_ONE);
        let slope = self.mul(power, y.slope);
        self.scale(slope, n)
    }

    /// `y^n` with any positive exponent: by `exp` and `log` where the ends are of like size, else by the quotient.
    pub(super) fn along_rational_power(&mut self, y: Along, n: Number, (from, to): (Expr, Expr), step: &Step) -> Expr {
        let log = self.along_log(y, step);
        let (low, high) = (self.unary(Unary::Log, y.from), self.unary(Unary::Log, y.to));
        let exponent = Along { from: self.scale(low, n), to: self.scale(high, n), slope: self.scale(log, n) };
        let near = self.along_exp(exponent, step);
        let change = self.change(y, step);
        let rise = self.sub(to, from);
        let quotient = self.div(rise, change);
        let far = self.mul(quotient, y.slope);
        let derivative = self.power_slope(y, n);
        let size = self.unary(Unary::Abs, change);
        let zero = self.zero();
        let moves = self.binary(Binary::Lt, zero, size);
        let other = self.select(moves, far, derivative);
        let both = self.add(y.from, y.to);
        let limit = self.scale(both, Number::HALF);
        let close = self.binary(Binary::Lt, size, limit);
        self.select(close, near, other)
    }

    /// `a^b` with an exponent that is no number: one that is known as a number counts as that; else by `exp` and `log`.
    pub(super) fn along_general_power(
        &mut self,
        e: Expr,
        (a, b): (Along, Along),
        (from, to): (Expr, Expr),
        step: &Step,
    ) -> Expr {
        if let Some(x) = self.constant(b.from) {
            let n = self.float(x);
            if let Some(n) = self.number(n)
                && n.is_exact()
            {
                return self.along_power(a, n, step).slope;
            }
        }
        let log = Along {
            from: self.unary(Unary::Log, a.from),
            to: self.unary(Unary::Log, a.to),
            slope: self.along_log(a, step),
        };
        let exponent = self.along_product(b, log);
        let near = self.along_exp(exponent, step);
        let rise = self.sub(to, from);
        let quotient = self.div(rise, step.delta);
        let derivative = self.derivative(e, step.symbol);
        let middle: FxHashMap<_, _> = [(step.symbol, step.middle)].into_iter().collect();
        let derivative = self.substitute(derivative, &middle);
        let zero = self.zero();
        let still = self.binary(Binary::Eq, step.delta, zero);
        let other = self.select(still, derivative, quotient);
        let least = self.binary(Binary::Min, a.from, a.to);
        let positive = self.binary(Binary::Lt, zero, least);
        self.select(positive, near, other)
    }
}
