//! Divided differences of functions.

use super::{Along, Step, TWO};
use crate::expression::{Expr, Number, Pool};
use bond_runtime::ir::{Binary, Unary};

impl Pool {
    /// `exp(y)`
    pub(super) fn along_exp(&mut self, y: Along, step: &Step) -> Expr {
        let mean = self.mean(y);
        let exp = self.unary(Unary::Exp, mean);
        let half = self.half_change(y, step);
        let factor = self.sinhc(half);
        self.product(&[exp, factor, y.slope])
    }

    /// `log(y)`: `log(b/a) = 2 atanh(w)` with `w = (b - a)/(a + b)`.
    pub(super) fn along_log(&mut self, y: Along, step: &Step) -> Expr {
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

    /// `f(y)`, whose ends are known.
    pub(super) fn along_function(&mut self, f: Unary, y: Along, ends: Along, step: &Step) -> Expr {
        let of_mean = |pool: &mut Pool, g: Unary| {
            let mean = pool.mean(y);
            pool.unary(g, mean)
        };
        match f {
            Unary::Neg => self.neg(y.slope),
            Unary::Sqrt => self.along_half_power(y, 1, step),
            Unary::Exp => self.along_exp(y, step),
            Unary::Log => self.along_log(y, step),
            Unary::Sin | Unary::Cos => {
                let factor = of_mean(self, if f == Unary::Sin { Unary::Cos } else { Unary::Sin });
                let half = self.half_change(y, step);
                let sinc = self.sinc(half);
                let slope = self.product(&[factor, sinc, y.slope]);
                if f == Unary::Sin { slope } else { self.neg(slope) }
            }
            Unary::Sinh | Unary::Cosh => {
                let factor = of_mean(self, if f == Unary::Sinh { Unary::Cosh } else { Unary::Sinh });
                let half = self.half_change(y, step);
                let sinhc = self.sinhc(half);
                self.product(&[factor, sinhc, y.slope])
            }
            Unary::Tan => {
                // tan b - tan a = sin(b - a)/(cos a cos b)
                let change = self.change(y, step);
                let sinc = self.sinc(change);
                let cosines = [y.from, y.to].map(|x| self.unary(Unary::Cos, x));
                let below = self.product(&cosines);
                let slope = self.mul(sinc, y.slope);
                self.div(slope, below)
            }
            Unary::Tanh => {
                // tanh b - tanh a = tanh(b - a) (1 - tanh a tanh b)
                let change = self.change(y, step);
                let tanhc = self.tanhc(change);
                let product = self.mul(ends.from, ends.to);
                let one = self.one();
                let rest = self.sub(one, product);
                self.product(&[tanhc, rest, y.slope])
            }
            Unary::Atan => {
                let product = self.mul(y.from, y.to);
                let one = self.one();
                let dot = self.add(one, product);
                self.along_angle(y.slope, dot, step)
            }
            Unary::Asin | Unary::Acos => {
                // tan((asin b - asin a)/2) = (b - a)/(cos asin a + cos asin b)
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
                let slope = self.div(slope, both);
                self.scale(slope, if f == Unary::Asin { TWO } else { -TWO })
            }
            Unary::Abs => {
                // |b| - |a| = (b^2 - a^2)/(|a| + |b|)
                let both = self.add(ends.from, ends.to);
                let sum = self.add(y.from, y.to);
                let slope = self.mul(sum, y.slope);
                let slope = self.div(slope, both);
                let zero = self.zero();
                let positive = self.binary(Binary::Lt, zero, both);
                self.select(positive, slope, zero)
            }
            Unary::Sign | Unary::Not | Unary::Floor => self.along_jump((ends.from, ends.to), step),
        }
    }

    /// Something that is constant but for jumps.
    pub(super) fn along_jump(&mut self, (from, to): (Expr, Expr), step: &Step) -> Expr {
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
