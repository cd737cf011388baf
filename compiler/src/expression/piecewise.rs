//! Laws that are polynomials between thresholds, such as tables: their sign on each piece, from its Bernstein
//! coefficients.

use super::{Expr, Node, Pool, Symbol};

impl Pool {
    /// Whether a law that is a polynomial on each of finitely many pieces has the sign of `s` there, or is 0, as far as
    /// its coefficients are not rounding. Parameters count as their values.
    pub(super) fn proves_by_pieces(&mut self, law: Expr, s: Symbol) -> bool {
        let mut pieces = Vec::new();
        if !matches!(self.node(law), Node::Select(..) | Node::Sum(..))
            || self.pieces(law, s, (f64::NEG_INFINITY, f64::INFINITY), &mut pieces).is_none()
        {
            return false;
        }
        pieces.into_iter().all(|(law, low, high)| {
            let above = high <= 0.0 || self.keeps_sign(law, s, 1.0, (low.max(0.0), high));
            above && (low >= 0.0 || self.keeps_sign(law, s, -1.0, ((-high).max(0.0), -low)))
        })
    }

    /// The branches, each with the interval on which it is taken.
    fn pieces(
        &mut self,
        law: Expr,
        s: Symbol,
        (low, high): (f64, f64),
        found: &mut Vec<(Expr, f64, f64)>,
    ) -> Option<()> {
        let Node::Select(c, a, b) = *self.node(law) else {
            found.push((law, low, high));
            return (found.len() <= self.options.polynomial_pieces).then_some(());
        };
        let threshold = self.threshold(c, s)?;
        let at = self.constant(threshold).filter(|at| at.is_finite())?;
        // What else it depends on may turn it round.
        if self.contains_any(c, &|x| x != s && self.value(x).is_none()) {
            return None;
        }
        let far = at.abs().max(1.0);
        let (below, above) = (self.eval(c, &|_| at - far) != 0.0, self.eval(c, &|_| at + far) != 0.0);
        if below == above {
            return None;
        }
        let (lower, upper) = if below { (a, b) } else { (b, a) };
        if low < at {
            self.pieces(lower, s, (low, high.min(at)), found)?;
        }
        if high > at {
            self.pieces(upper, s, (low.max(at), high), found)?;
        }
        Some(())
    }

    /// Whether `side * law(side * x) >= 0` on an interval of `x >= 0`.
    fn keeps_sign(&mut self, law: Expr, s: Symbol, side: f64, (low, high): (f64, f64)) -> bool {
        let Some(mut c) = self.taylor(law, s, side * low) else { return false };
        // as a polynomial in the distance from `low`
        for (k, c) in c.iter_mut().enumerate() {
            *c *= if side < 0.0 && k % 2 == 0 { -1.0 } else { 1.0 };
        }
        if !c.iter().all(|c| c.is_finite()) {
            return false;
        }
        if high.is_infinite() {
            let rounding = 16.0 * f64::EPSILON * (c.iter().skip(1).map(|c| c.abs()).sum::<f64>() * low.max(1.0));
            return c.iter().enumerate().all(|(k, c)| *c >= if k == 0 { -rounding } else { 0.0 });
        }
        let h = high - low;
        let degree = c.len() - 1;
        let size: f64 = c.iter().rev().fold(0.0, |sum, c| sum * h + c.abs());
        (0..=degree).all(|j| {
            // b_j = Σ_k binomial(j, k)/binomial(degree, k) c_k h^k
            let (mut sum, mut weight, mut power) = (0.0, 1.0, 1.0);
            for (k, c) in c.iter().enumerate().take(j + 1) {
                sum += weight * c * power;
                weight *= (j - k) as f64 / (degree - k).max(1) as f64;
                power *= h;
            }
            sum >= -16.0 * f64::EPSILON * size
        })
    }

    /// The coefficients of a polynomial in the distance from a place.
    fn taylor(&mut self, e: Expr, s: Symbol, at: f64) -> Option<Vec<f64>> {
        if self.symbols(e).iter().any(|x| *x != s) {
            return None;
        }
        let (mut derivative, mut factorial) = (e, 1.0);
        let mut all = Vec::new();
        for k in 0..=self.options.degree {
            if k > 0 {
                factorial *= k as f64;
            }
            all.push(self.eval(derivative, &|_| at) / factorial);
            derivative = self.derivative(derivative, s);
            if self.is_zero(derivative) {
                return self.is_polynomial(e, s).then_some(all);
            }
        }
        None
    }

    /// Whether it is made of numbers and `s` by sums and products with whole powers alone.
    pub(super) fn is_polynomial(&self, e: Expr, s: Symbol) -> bool {
        self.dependents(e, &|x| x == s).into_iter().all(|e| match self.node(e) {
            Node::Number(_) | Node::Symbol(_) | Node::Sum(..) => true,
            Node::Product(_, factors) => {
                factors.iter().all(|&(f, n)| !self.contains(f, s) || n.integer().is_some_and(|n| n > 0))
            }
            Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => false,
        })
    }
}
