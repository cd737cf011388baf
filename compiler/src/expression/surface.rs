//! Surfaces through measured points: monotone piecewise bicubics, after Carlson and Fritsch (SIAM J. Numer. Anal. 22,
//! 1985, and 26, 1989).
//!
//! On each rectangle of the mesh the surface is the bicubic with given values, slopes and cross slopes at its corners.
//! In one direction such a bicubic is a sum, with Bernstein's polynomials as positive weights, of four cubics in the
//! other direction: those along both edges, and two between them. So it rises where all four do, which is a matter of
//! their ends and slopes alone (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980: slopes between 0 and three times
//! the mean slope). And it stays between two values where its sixteen Bernstein coefficients do. Both are inequalities
//! that are linear in the cross slope of each point. Slopes are shortened until all of them can hold.

use super::table::{choices, pieces, slopes};
use super::{Expr, Number, Pool};

/// How often the slopes of a point are halved before they are 0.
const HALVINGS: usize = 10;

impl Pool {
    /// The surface with `heights[j][i]` at `(xs[i], ys[j])`, both rising: once continuously differentiable, within the
    /// four values around it, rising in a direction wherever the values on both edges do. Beyond the mesh straight on.
    /// Along the lines of the mesh it is the curve of [`Pool::table`] where nothing had to be shortened. `None` for
    /// fewer than two places in a direction, for rows of other lengths, or where a coefficient is no number to compute
    /// with.
    pub fn surface(&mut self, (x, y): (Expr, Expr), xs: &[f64], ys: &[f64], heights: &[Vec<f64>]) -> Option<Expr> {
        if xs.len() < 2 || ys.len() < 2 || heights.len() != ys.len() || heights.iter().any(|r| r.len() != xs.len()) {
            return None;
        }
        let mesh = Mesh::new(xs, ys, heights);
        // In each strip of x: the value and slope in y, at each y of the mesh, of each coefficient of the cubic in x.
        let value = |j: usize| pieces(xs, &mesh.z[j], &mesh.zx[j]);
        let slope = |j: usize| pieces(xs, &mesh.zy[j], &mesh.zxy[j]);
        let (values, slopes): (Vec<_>, Vec<_>) = (0..ys.len()).map(|j| (value(j), slope(j))).unzip();
        let straight = |all: &[Vec<(f64, [f64; 4])>]| all.iter().all(|cubics| is_straight(cubics));
        let straight_in_x = xs.len() == 2 && straight(&values) && straight(&slopes);
        let strips = if straight_in_x { 1 } else { xs.len() + 1 };
        let mut columns = Vec::with_capacity(strips);
        for i in 0..strips {
            let at = values[0][i].0;
            let powers: Vec<Vec<(f64, [f64; 4])>> = (0..4)
                .map(|a| {
                    let of = |all: &[Vec<(f64, [f64; 4])>]| -> Vec<f64> { all.iter().map(|c| c[i].1[a]).collect() };
                    pieces(ys, &of(&values), &of(&slopes))
                })
                .collect();
            let straight_in_y = ys.len() == 2 && straight(&powers);
            let count = if straight_in_y { 1 } else { ys.len() + 1 };
            let mut cells = Vec::with_capacity(count);
            for j in 0..count {
                let coefficients: Vec<[f64; 4]> = powers.iter().map(|p| p[j].1).collect();
                if coefficients.iter().flatten().any(|c| !c.is_finite()) {
                    return None;
                }
                cells.push(self.bicubic((x, at), (y, powers[0][j].0), &coefficients));
            }
            columns.push(choices(self, y, ys, &cells));
        }
        Some(choices(self, x, xs, &columns))
    }

    /// The sum of `coefficients[a][b] (x - x0)^a (y - y0)^b`.
    fn bicubic(&mut self, (x, x0): (Expr, f64), (y, y0): (Expr, f64), coefficients: &[[f64; 4]]) -> Expr {
        let (x0, y0) = (self.float(x0), self.float(y0));
        let (s, t) = (self.sub(x, x0), self.sub(y, y0));
        let mut terms = Vec::with_capacity(16);
        for (a, row) in (0..).zip(coefficients) {
            let left = self.powi(s, a);
            for (b, c) in (0..).zip(row) {
                if *c != 0.0 {
                    let right = self.powi(t, b);
                    terms.push((self.mul(left, right), Number::float(*c)));
                }
            }
        }
        self.combine(&terms)
    }
}

/// Whether all pieces are one straight line: what lies between the ends bends nowhere.
fn is_straight(cubics: &[(f64, [f64; 4])]) -> bool {
    cubics.iter().all(|c| c.1[2] == 0.0 && c.1[3] == 0.0)
}

/// A bound `low <= w <= high`.
#[derive(Clone, Copy)]
struct Interval {
    low: f64,
    high: f64,
}

impl Interval {
    /// Keeps what also has `low <= base + factor w <= high`, to rounding.
    fn keep(&mut self, base: f64, factor: f64, (low, high): (f64, f64)) {
        let (a, b) = ((low - base) / factor, (high - base) / factor);
        let blur = 8.0 * f64::EPSILON * ((base.abs() + low.abs().max(high.abs())) / factor).abs();
        self.low = self.low.max(a.min(b) - blur);
        self.high = self.high.min(a.max(b) + blur);
    }
}

/// The points, and the slopes there: `zx[j][i]` by x, `zy[j][i]` by y, `zxy[j][i]` by both.
struct Mesh {
    /// Lengths of the steps in x.
    h: Vec<f64>,
    /// Lengths of the steps in y.
    k: Vec<f64>,
    z: Vec<Vec<f64>>,
    zx: Vec<Vec<f64>>,
    zy: Vec<Vec<f64>>,
    zxy: Vec<Vec<f64>>,
}

impl Mesh {
    fn new(xs: &[f64], ys: &[f64], heights: &[Vec<f64>]) -> Self {
        let steps = |places: &[f64]| -> Vec<f64> { places.windows(2).map(|p| p[1] - p[0]).collect() };
        let along = |places: &[f64], lines: &[Vec<f64>]| -> Vec<Vec<f64>> {
            lines
                .iter()
                .map(|line| slopes(&places.iter().copied().zip(line.iter().copied()).collect::<Vec<_>>()))
                .collect()
        };
        let z = heights.to_vec();
        let zx = along(xs, &z);
        let zy = transposed(&along(ys, &transposed(&z)));
        let zxy = vec![vec![0.0; xs.len()]; ys.len()];
        let mut mesh = Mesh { h: steps(xs), k: steps(ys), z, zx, zy, zxy };
        // The first rounds halve; then each sets a point's slopes to 0 for good, so that this ends.
        let mut round = 0;
        while mesh.limit_and_cross(if round < HALVINGS { 0.5 } else { 0.0 }) {
            round += 1;
        }
        mesh
    }

    /// Shortens slopes so that neighbouring ones go together, and takes the cross slopes. Where there is none for a
    /// point, its slopes are multiplied by a factor, and all has to be done again.
    fn limit_and_cross(&mut self, factor: f64) -> bool {
        self.limit_y();
        self.flip();
        self.limit_y();
        self.flip();
        let guess = self.cross();
        let (rows, columns) = (self.z.len(), self.z[0].len());
        let mut again = false;
        for j in 0..rows {
            for i in 0..columns {
                let Interval { low, high } = self.bounds(i, j);
                // 0 is always one where both slopes are 0; rounding may say otherwise.
                let flat = self.zx[j][i] == 0.0 && self.zy[j][i] == 0.0;
                if low > high && !flat {
                    self.zx[j][i] *= factor;
                    self.zy[j][i] *= factor;
                    again = true;
                } else {
                    self.zxy[j][i] = if low > high { 0.0 } else { guess[j][i].clamp(low, high) };
                }
            }
        }
        again
    }

    /// Exchanges x and y.
    fn flip(&mut self) {
        std::mem::swap(&mut self.h, &mut self.k);
        let (zx, zy) = (transposed(&self.zy), transposed(&self.zx));
        (self.zx, self.zy) = (zx, zy);
        self.z = transposed(&self.z);
        self.zxy = transposed(&self.zxy);
    }

    /// Where a cell's values rise with x on both edges, the cubics between the edges have to end where they may rise,
    /// too: a third of a step along each side, at the same height or above. That compares the slopes in y of neighbours
    /// in x. They are shortened from both ends of a row, as lengths along a path.
    fn limit_y(&mut self) {
        let columns = self.z[0].len();
        for j in 0..self.z.len() {
            for sign in [1.0, -1.0] {
                // By how much `sign zy` at i may be above that at i + 1, and the other way round.
                let mut ahead = vec![f64::INFINITY; columns - 1];
                let mut back = vec![f64::INFINITY; columns - 1];
                for i in 0..columns - 1 {
                    for (other, k, up) in self.beside(j) {
                        let (here, there) = (self.z[j][i + 1] - self.z[j][i], self.z[other][i + 1] - self.z[other][i]);
                        let room = 3.0 * here.abs() / k;
                        // The cubic lies on the side of the neighbouring row.
                        if here >= 0.0 && there >= 0.0 {
                            let bound = if sign * up > 0.0 { &mut ahead[i] } else { &mut back[i] };
                            *bound = bound.min(room);
                        }
                        if here <= 0.0 && there <= 0.0 {
                            let bound = if sign * up > 0.0 { &mut back[i] } else { &mut ahead[i] };
                            *bound = bound.min(room);
                        }
                    }
                }
                shorten(&mut self.zy[j], sign, &ahead, &back);
            }
        }
    }

    /// The rows beside one, each with its distance, and 1 where it is above and -1 where it is below.
    fn beside(&self, j: usize) -> impl Iterator<Item = (usize, f64, f64)> + use<> {
        let below = j.checked_sub(1).map(|b| (b, self.k[b], -1.0));
        let above = self.k.get(j).map(|k| (j + 1, *k, 1.0));
        [below, above].into_iter().flatten()
    }

    /// Cross slopes by parabolas, of the slopes of one kind along the other direction, and the mean of both. Along two
    /// places the surface is straight, which only their own difference keeps.
    fn cross(&self) -> Vec<Vec<f64>> {
        let along_x: Vec<Vec<f64>> = self.zy.iter().map(|line| parabolas(&self.h, line)).collect();
        let along_y: Vec<Vec<f64>> = transposed(&self.zx).iter().map(|line| parabolas(&self.k, line)).collect();
        let along_y = transposed(&along_y);
        if self.h.len() == 1 {
            return along_x;
        }
        if self.k.len() == 1 {
            return along_y;
        }
        let mean = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| 0.5 * a + 0.5 * b).collect();
        along_x.iter().zip(&along_y).map(mean).collect()
    }

    /// What the cross slope of a point may be, by the four cells around it.
    fn bounds(&self, i: usize, j: usize) -> Interval {
        let mut interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
        let left = i.checked_sub(1).map(|l| (l, self.h[l], -1.0));
        let right = self.h.get(i).map(|h| (i + 1, *h, 1.0));
        let (z, zx, zy) = (self.z[j][i], self.zx[j][i], self.zy[j][i]);
        for (n, h, to) in [left, right].into_iter().flatten() {
            for (m, k, up) in self.beside(j) {
                let corners = [z, self.z[j][n], self.z[m][i], self.z[m][n]];
                let range = corners.iter().fold((z, z), |r, c| (r.0.min(*c), r.1.max(*c)));
                let (dx, dy) = (to * h / 3.0, up * k / 3.0);
                interval.keep(z + dx * zx + dy * zy, dx * dy, range);
                // Along x: the cubic a third of a step towards the other row.
                let (edge, far) = (to * (corners[1] - z), to * (corners[3] - corners[2]));
                let rise = edge + to * dy * (self.zy[j][n] - zy);
                if edge >= 0.0 && far >= 0.0 {
                    interval.keep(zx, dy, (0.0, (3.0 * rise / h).max(0.0)));
                }
                if edge <= 0.0 && far <= 0.0 {
                    interval.keep(zx, dy, ((3.0 * rise / h).min(0.0), 0.0));
                }
                // The same along y.
                let (edge, far) = (up * (corners[2] - z), up * (corners[3] - corners[1]));
                let rise = edge + up * dx * (self.zx[m][i] - zx);
                if edge >= 0.0 && far >= 0.0 {
                    interval.keep(zy, dx, (0.0, (3.0 * rise / k).max(0.0)));
                }
                if edge <= 0.0 && far <= 0.0 {
                    interval.keep(zy, dx, ((3.0 * rise / k).min(0.0), 0.0));
                }
            }
        }
        interval
    }
}

/// Shortens the slopes of one sign until none is above its next by more than `ahead`, nor below by more than `back`.
/// Where the next has the other sign, each may take half.
fn shorten(slopes: &mut [f64], sign: f64, ahead: &[f64], back: &[f64]) {
    let n = slopes.len();
    let part = |slopes: &[f64], i: usize| (sign * slopes[i]).max(0.0);
    let opposite = |slopes: &[f64], i: usize| sign * slopes[i] < 0.0;
    for i in 0..n - 1 {
        if part(slopes, i) > 0.0 && opposite(slopes, i + 1) {
            slopes[i] = sign * part(slopes, i).min(0.5 * ahead[i]);
            slopes[i + 1] = -sign * (-sign * slopes[i + 1]).min(0.5 * ahead[i]);
        }
        if part(slopes, i + 1) > 0.0 && opposite(slopes, i) {
            slopes[i + 1] = sign * part(slopes, i + 1).min(0.5 * back[i]);
            slopes[i] = -sign * (-sign * slopes[i]).min(0.5 * back[i]);
        }
    }
    for i in 1..n {
        if part(slopes, i) > 0.0 {
            slopes[i] = sign * part(slopes, i).min(part(slopes, i - 1) + back[i - 1]);
        }
    }
    for i in (0..n - 1).rev() {
        if part(slopes, i) > 0.0 {
            slopes[i] = sign * part(slopes, i).min(part(slopes, i + 1) + ahead[i]);
        }
    }
}

/// The slopes of parabolas through three neighbours; of two points, that between them.
fn parabolas(steps: &[f64], values: &[f64]) -> Vec<f64> {
    let rises: Vec<f64> = values.windows(2).zip(steps).map(|(v, h)| (v[1] - v[0]) / h).collect();
    let n = rises.len();
    if n == 1 {
        return vec![rises[0]; 2];
    }
    let end = |h: f64, next: f64, d: f64, after: f64| d + (d - after) * (h / (h + next));
    let mut found = vec![end(steps[0], steps[1], rises[0], rises[1])];
    for i in 1..n {
        let weight = steps[i] / (steps[i - 1] + steps[i]);
        found.push(rises[i - 1] * weight + rises[i] * (1.0 - weight));
    }
    found.push(end(steps[n - 1], steps[n - 2], rises[n - 1], rises[n - 2]));
    found
}

fn transposed(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let width = rows.first().map_or(0, Vec::len);
    (0..width).map(|i| rows.iter().map(|r| r[i]).collect()).collect()
}
