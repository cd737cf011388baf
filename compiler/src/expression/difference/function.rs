//! Divided differences of functions.

use super::{Along, Step, TWO};
use crate::expression::{Expr, Number, Pool};
use bond_runtime::ir::{Binary, Unary};

impl Pool {
    /// `exp(y)`
    pub(in crate::expression) fn along_exp(&mut self, y: Along, step: &Step) -> Expr {
        let mean = self.mean(y);
        let exp = self.unary(Unary::Exp, mean);
        let half = self.half_change(y, step);
        let factor = self.sinhc(half);
        self.product(&[exp, factor, y.slope])
    }

    /// `log(y)`: `log(b/a) = 2 atanh(w)` with `w = (b - a)/(a + b)`.
    pub(in crate::expression) fn along_log(&mut self, y: Along, step: &Step) -> Expr {
        let both = self.add(y.from, y.to);
        let change = self.change(y, step);
        let w = self.div(change, both);
        let series = self.tangent_series(w, 1);
        let near = self.div(series, both);
        let near = self.mul(near, y.slope);
        let near = self.scale(near, TWO);
        let ratio = self.div(y.to, y.from);
        let log = self.unary(Unary::Log, ratio);
        let far = self.div(log, change);
        let far = self.mul(far, y.slope);
        let size = self.unary(Unary::Abs, w);
        let limit = self.ratio(1, 10);
        let small = self.binary(Binary::Lt, size, limit);
        self.select(small, near, far)
    }

    /// `sin(y)` with its derivative, `g` = cos. Of `cos(y)` it is the negative of this with `g` = sin.
    pub(in crate::expression) fn along_sine(&mut self, g: Unary, y: Along, step: &Step) -> Expr {
        let factor = self.of_mean(g, y);
        let half = self.half_change(y, step);
        let sinc = self.sinc(half);
        self.product(&[factor, sinc, y.slope])
    }

    /// `sinh(y)` and `cosh(y)`, each with its derivative `g`.
    pub(in crate::expression) fn along_hyperbolic_sine(&mut self, g: Unary, y: Along, step: &Step) -> Expr {
        let factor = self.of_mean(g, y);
        let half = self.half_change(y, step);
        let sinhc = self.sinhc(half);
        self.product(&[factor, sinhc, y.slope])
    }

    fn of_mean(&mut self, g: Unary, y: Along) -> Expr {
        let mean = self.mean(y);
        self.unary(g, mean)
    }

    /// `tan(y)`: `tan b - tan a = sin(b - a)/(cos a cos b)`.
    pub(in crate::expression) fn along_tan(&mut self, y: Along, step: &Step) -> Expr {
        let change = self.change(y, step);
        let sinc = self.sinc(change);
        let cosines = [y.from, y.to].map(|x| self.unary(Unary::Cos, x));
        let below = self.product(&cosines);
        let slope = self.mul(sinc, y.slope);
        self.div(slope, below)
    }

    /// `tanh(y)`: `tanh b - tanh a = tanh(b - a) (1 - tanh a tanh b)`.
    pub(in crate::expression) fn along_tanh(&mut self, y: Along, value: Along, step: &Step) -> Expr {
        let change = self.change(y, step);
        let tanhc = self.tanhc(change);
        let product = self.mul(value.from, value.to);
        let one = self.one();
        let rest = self.sub(one, product);
        self.product(&[tanhc, rest, y.slope])
    }

    /// `atan(y)`
    pub(in crate::expression) fn along_atan(&mut self, y: Along, step: &Step) -> Expr {
        let product = self.mul(y.from, y.to);
        let one = self.one();
        let dot = self.add(one, product);
        self.along_angle(y.slope, dot, step)
    }

    /// Half of `asin(y)`: `tan((asin b - asin a)/2) = (b - a)/(cos asin a + cos asin b)`.
    pub(in crate::expression) fn along_half_asin(&mut self, y: Along, step: &Step) -> Expr {
        let cosines = [y.from, y.to].map(|x| {
            let one = self.one();
            let (low, high) = (self.sub(one, x), self.add(one, x));
            let square = self.mul(low, high);
            self.sqrt(square)
        });
        let both = self.sum(&cosines);
        let change = self.change(y, step);
        let w = self.div(change, both);
        let factor = self.atanc(w);
        let slope = self.mul(factor, y.slope);
        self.div(slope, both)
    }

    /// `|y|`: `|b| - |a| = (b^2 - a^2)/(|a| + |b|)`.
    pub(in crate::expression) fn along_abs(&mut self, y: Along, value: Along, _: &Step) -> Expr {
        let both = self.add(value.from, value.to);
        let sum = self.add(y.from, y.to);
        let slope = self.mul(sum, y.slope);
        let slope = self.div(slope, both);
        let zero = self.zero();
        let positive = self.binary(Binary::Lt, zero, both);
        self.select(positive, slope, zero)
    }

    /// Something that is constant but for jumps.
    pub(in crate::expression) fn along_jump(&mut self, (from, to): (Expr, Expr), step: &Step) -> Expr {
        let rise = self.sub(to, from);
        let quotient = self.div(rise, step.delta);
        let zero = self.zero();
        let same = self.binary(Binary::Eq, from, to);
        self.select(same, zero, quotient)
    }

    /// The angle whose tangent is `cross delta / dot`, by `delta`.
    pub(super) fn along_angle(&mut self, cross: Expr, dot: Expr, step: &Step) -> Expr {
        let rise = self.mul(cross, step.delta);
        let w = self.div(rise, dot);
        let series = self.tangent_series(w, -1);
        let near = self.div(series, dot);
        let angle = self.binary(Binary::Atan2, rise, dot);
        let far = self.div(angle, rise);
        let size = self.unary(Unary::Abs, rise);
        let limit = self.scale(dot, Number::ratio(1, 10));
        let small = self.binary(Binary::Lt, size, limit);
        let factor = self.select(small, near, far);
        self.mul(factor, cross)
    }

    pub(super) fn along_binary(
        &mut self,
        f: Binary,
        a: Along,
        b: Along,
        (from, to): (Expr, Expr),
        step: &Step,
    ) -> Expr {
        match f {
            Binary::Min | Binary::Max => {
                let [start, end] = [(a.from, b.from), (a.to, b.to)].map(|(x, y)| self.binary(Binary::Lt, x, y));
                if f == Binary::Min {
                    self.along_choice((start, end), a, b, step)
                } else {
                    self.along_choice((start, end), b, a, step)
                }
            }
            Binary::Atan2 => {
                // y above x
                let (mean_a, mean_b) = (self.mean(a), self.mean(b));
                let (left, right) = (self.mul(a.slope, mean_b), self.mul(mean_a, b.slope));
                let cross = self.sub(left, right);
                let (left, right) = (self.mul(a.from, a.to), self.mul(b.from, b.to));
                let dot = self.add(left, right);
                self.along_angle(cross, dot, step)
            }
            Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => self.along_jump((from, to), step),
            // arithmetic is never a node of this kind
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow => self.zero(),
        }
    }
}
