//! Curves through measured points: the monotone piecewise cubic of Fritsch and Carlson (SIAM J. Numer. Anal. 17, 1980).

use super::{Expr, Number, Pool};
use bond_runtime::ir::Binary;

impl Pool {
    /// The curve through `(x_i, y_i)`, the `x_i` rising: once continuously differentiable, monotone wherever the points
    /// are, straight on with the end's slope beyond the ends. A balanced tree of choices over cubics.
    /// `None` for fewer than two points, or where a coefficient is no number to compute with.
    pub fn table(&mut self, x: Expr, knots: &[(f64, f64)]) -> Option<Expr> {
        if knots.len() < 2 {
            return None;
        }
        let (places, heights): (Vec<f64>, Vec<f64>) = knots.iter().copied().unzip();
        let mut cubics = pieces(&places, &heights, &slopes(knots));
        if knots.len() == 2 {
            cubics.truncate(1); // two points are one straight line
        }
        if cubics.iter().flat_map(|c| c.1).any(|c| !c.is_finite()) {
            return None;
        }
        let pieces: Vec<Expr> = cubics.iter().map(|&(at, c)| self.cubic(x, at, c)).collect();
        Some(choices(self, x, &places, &pieces))
    }

    fn cubic(&mut self, x: Expr, at: f64, coefficients: [f64; 4]) -> Expr {
        let at = self.float(at);
        let s = self.sub(x, at);
        let mut terms = Vec::with_capacity(4);
        for (n, c) in (0..).zip(coefficients) {
            terms.push((self.powi(s, n), Number::float(c)));
        }
        self.combine(&terms)
    }
}

/// `pieces[i]` below `places[i]`, the last one above them all.
pub(super) fn choices(pool: &mut Pool, x: Expr, places: &[f64], pieces: &[Expr]) -> Expr {
    if let [one] = pieces {
        return *one;
    }
    let middle = pieces.len() / 2;
    let below = choices(pool, x, &places[..middle - 1], &pieces[..middle]);
    let above = choices(pool, x, &places[middle..], &pieces[middle..]);
    let place = pool.float(places[middle - 1]);
    let less = pool.binary(Binary::Lt, x, place);
    pool.select(less, below, above)
}

/// The cubics through places, with their slopes there, and the straight lines beyond the ends: one more than places.
/// Each in powers of the distance from a place, which comes with it.
pub(super) fn pieces(places: &[f64], heights: &[f64], slopes: &[f64]) -> Vec<(f64, [f64; 4])> {
    let straight = |i: usize| (places[i], [heights[i], slopes[i], 0.0, 0.0]);
    let mut cubics = vec![straight(0)];
    for i in 1..places.len() {
        let (x0, x1, m0, m1) = (places[i - 1], places[i], slopes[i - 1], slopes[i]);
        let h = x1 - x0;
        let d = (heights[i] - heights[i - 1]) / h;
        let mut bends = [2.0 * (d - m0) + (d - m1), (d - m0) + 2.0 * (d - m1), (m0 - d) + (m1 - d)];
        // What is left of a straight line by rounding is none.
        if bends.iter().all(|b| b.abs() <= 4.0 * f64::EPSILON * (d.abs() + m0.abs() + m1.abs())) {
            bends = [0.0; 3];
        }
        let [first, second, third] = [bends[0], bends[1], bends[2] / h / h];
        // In powers of the distance from the end that is nearer to 0, so that an energy keeps its digits near 0.
        cubics.push(if x0.abs() <= x1.abs() {
            (x0, [heights[i - 1], m0, first / h, third])
        } else {
            (x1, [heights[i], m1, -second / h, third])
        });
    }
    cubics.push(straight(places.len() - 1));
    cubics
}

/// The slopes at the points: those of parabolas through three neighbours, 0 where the points turn, and shortened where
/// the cubic would leave the range of its two points.
pub(super) fn slopes(knots: &[(f64, f64)]) -> Vec<f64> {
    let steps: Vec<f64> = knots.windows(2).map(|k| k[1].0 - k[0].0).collect();
    let rises: Vec<f64> = knots.windows(2).zip(&steps).map(|(k, h)| (k[1].1 - k[0].1) / h).collect();
    if rises.len() < 2 {
        return rises.iter().flat_map(|&d| [d, d]).collect();
    }
    let n = rises.len();
    // At an end: the parabola's slope, unless it points the other way.
    let end = |h: f64, next: f64, d: f64, after: f64| {
        let m = d + (d - after) * (h / (h + next));
        if m * d > 0.0 { m } else { 0.0 }
    };
    let mut slopes = vec![end(steps[0], steps[1], rises[0], rises[1])];
    for i in 1..n {
        let (a, b) = (rises[i - 1], rises[i]);
        let weight = steps[i] / (steps[i - 1] + steps[i]);
        let turns = a == 0.0 || b == 0.0 || (a < 0.0) != (b < 0.0);
        slopes.push(if turns { 0.0 } else { a * weight + b * (1.0 - weight) });
    }
    slopes.push(end(steps[n - 1], steps[n - 2], rises[n - 1], rises[n - 2]));
    for (i, &d) in rises.iter().enumerate() {
        if d == 0.0 {
            (slopes[i], slopes[i + 1]) = (0.0, 0.0);
            continue;
        }
        let (a, b) = (slopes[i] / d, slopes[i + 1] / d);
        let size = libm::hypot(a, b);
        if size > 3.0 {
            (slopes[i], slopes[i + 1]) = (3.0 * a / size * d, 3.0 * b / size * d);
        }
    }
    slopes
}
