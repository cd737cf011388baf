//! Quotients that are stable at 0: `sin(z)/z` and its like, as expressions.
//!
//! Each is a series for small arguments and the quotient beyond. The threshold is 1/10: below it the series has its
//! full accuracy, above it the quotient and its derivative have lost at most two digits.

use super::{Expr, Number, Pool};
use bond_runtime::ir::{Binary, Unary};

impl Pool {
    /// `sin(z)/z`
    pub(super) fn sinc(&mut self, z: Expr) -> Expr {
        let series = self.sine_series(z, -1);
        let exact = self.unary(Unary::Sin, z);
        self.near_zero(z, series, exact)
    }

    /// `sinh(z)/z`
    pub(super) fn sinhc(&mut self, z: Expr) -> Expr {
        let series = self.sine_series(z, 1);
        let exact = self.unary(Unary::Sinh, z);
        self.near_zero(z, series, exact)
    }

    /// `tanh(z)/z`
    pub(super) fn tanhc(&mut self, z: Expr) -> Expr {
        let series = self.sine_series(z, 1);
        let cosh = self.unary(Unary::Cosh, z);
        let near = self.div(series, cosh);
        let exact = self.unary(Unary::Tanh, z);
        self.near_zero(z, near, exact)
    }

    /// `atan(w)/w`
    pub(super) fn atanc(&mut self, w: Expr) -> Expr {
        let series = self.tangent_series(w, -1);
        let exact = self.unary(Unary::Atan, w);
        self.near_zero(w, series, exact)
    }

    /// `1 ± z^2/3! + z^4/5! ± ...`
    fn sine_series(&mut self, z: Expr, sign: i64) -> Expr {
        let steps = [(2, 3), (4, 5), (6, 7), (8, 9), (10, 11)].map(|(a, b)| Number::ratio(sign, a * b));
        let z2 = self.powi(z, 2);
        // 1 + z2 c1 (1 + z2 c2 (1 + ...))
        let mut sum = self.one();
        for c in steps.into_iter().rev() {
            let next = self.product(&[z2, sum]);
            let one = self.one();
            sum = self.combine(&[(one, Number::ONE), (next, c)]);
        }
        sum
    }

    /// `1 ± w^2/3 + w^4/5 ± ...`
    pub(super) fn tangent_series(&mut self, w: Expr, sign: i64) -> Expr {
        let w2 = self.powi(w, 2);
        let mut sum = self.zero();
        for k in (0..8).rev() {
            let next = self.product(&[w2, sum]);
            let c = self.ratio(if k % 2 == 0 { 1 } else { sign }, 2 * k + 1);
            sum = self.add(c, next);
        }
        sum
    }

    /// The series where `|z|` is small, `exact/z` elsewhere.
    fn near_zero(&mut self, z: Expr, series: Expr, exact: Expr) -> Expr {
        let quotient = self.div(exact, z);
        let limit = self.ratio(1, 10);
        let size = self.unary(Unary::Abs, z);
        let small = self.binary(Binary::Lt, size, limit);
        self.select(small, series, quotient)
    }
}
