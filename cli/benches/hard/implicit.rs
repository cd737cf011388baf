//! Radau IIA with three stages, of order 5, after Hairer and Wanner's RADAU5: a simplified Newton iteration, a Jacobian
//! by differences, their estimate of the error. The linear systems are solved as they stand, real and whole, which
//! costs more than theirs where there are many states.

use super::field::Field;
use super::rival::{Method, Tried};

/// A dense matrix with its elimination.
struct Lu {
    n: usize,
    a: Vec<f64>,
    order: Vec<usize>,
}

impl Lu {
    /// Eliminates; None where it is singular.
    fn new(n: usize, mut a: Vec<f64>) -> Option<Self> {
        let mut order: Vec<usize> = (0..n).collect();
        for k in 0..n {
            let p = (k..n).max_by(|i, j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs()))?;
            if a[p * n + k] == 0.0 || !a[p * n + k].is_finite() {
                return None;
            }
            if p != k {
                (0..n).for_each(|j| a.swap(p * n + j, k * n + j));
                order.swap(p, k);
            }
            for i in k + 1..n {
                let l = a[i * n + k] / a[k * n + k];
                a[i * n + k] = l;
                if l != 0.0 {
                    for j in k + 1..n {
                        a[i * n + j] -= l * a[k * n + j];
                    }
                }
            }
        }
        Some(Self { n, a, order })
    }

    fn solve(&self, b: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut x: Vec<f64> = self.order.iter().map(|i| b[*i]).collect();
        for i in 0..n {
            for j in 0..i {
                x[i] -= self.a[i * n + j] * x[j];
            }
        }
        for i in (0..n).rev() {
            for j in i + 1..n {
                x[i] -= self.a[i * n + j] * x[j];
            }
            x[i] /= self.a[i * n + i];
        }
        x
    }
}

/// The method, with what it keeps between steps.
pub struct Radau {
    n: usize,
    tolerance: f64,
    f: Vec<Vec<f64>>,
    z: Vec<f64>,
    jacobian: Vec<f64>,
    /// For which step length, and with which Jacobian, the systems were eliminated.
    ready: Option<(f64, Lu, Lu)>,
    fresh: bool,
    /// Whether the Jacobian is of this very state.
    here: bool,
    /// The step before was not taken, or there was none.
    careful: bool,
}

impl Radau {
    /// For so many states.
    pub fn new(n: usize, tolerance: f64) -> Self {
        Self {
            n,
            tolerance,
            f: vec![vec![0.0; n]; 4],
            z: vec![0.0; 3 * n],
            jacobian: vec![0.0; n * n],
            ready: None,
            fresh: false,
            here: false,
            careful: true,
        }
    }

    /// df/dx by differences.
    fn differ(&mut self, field: &mut Field, t: f64, x: &[f64], scale: &[f64]) -> Option<()> {
        let (n, mut y, mut g) = (self.n, x.to_vec(), vec![0.0; self.n]);
        for j in 0..n {
            let size = scale[j] / self.tolerance;
            let d = f64::EPSILON.sqrt() * x[j].abs().max(1e-5 * size).max(f64::MIN_POSITIVE * 1e20);
            y[j] = x[j] + d;
            let d = y[j] - x[j];
            field.rates(t, &y, &mut g)?;
            for i in 0..n {
                self.jacobian[i * n + j] = (g[i] - self.f[0][i]) / d;
            }
            y[j] = x[j];
        }
        self.ready = None;
        self.here = true;
        Some(())
    }

    fn eliminate(&self, h: f64) -> Option<(f64, Lu, Lu)> {
        let (n, a) = (self.n, table());
        let mut big = vec![0.0; 9 * n * n];
        let mut small = vec![0.0; n * n];
        for (r, row) in a.iter().enumerate() {
            for (s, w) in row.iter().enumerate() {
                for i in 0..n {
                    for j in 0..n {
                        let unit = if r == s && i == j { 1.0 } else { 0.0 };
                        big[(r * n + i) * 3 * n + s * n + j] = unit - h * w * self.jacobian[i * n + j];
                    }
                }
            }
        }
        for i in 0..n {
            for j in 0..n {
                small[i * n + j] = if i == j { gamma() / h } else { 0.0 } - self.jacobian[i * n + j];
            }
        }
        Some((h, Lu::new(3 * n, big)?, Lu::new(n, small)?))
    }

    /// Newton's method for the stages; the number of iterations.
    fn stages(&mut self, field: &mut Field, t: f64, x: &[f64], h: f64, scale: &[f64]) -> Option<(usize, f64)> {
        let (n, a, c) = (self.n, table(), places());
        let goal = (10.0 * f64::EPSILON / self.tolerance).max(self.tolerance.sqrt().min(0.03));
        self.z.fill(0.0);
        let (mut before, mut y) = (f64::INFINITY, vec![0.0; n]);
        for iteration in 1..=10 {
            let mut work = 0.0;
            for s in 0..3 {
                for i in 0..n {
                    y[i] = x[i] + self.z[s * n + i];
                }
                let power = field.rates(t + c[s] * h, &y, &mut self.f[1 + s])?;
                work += h * a[2][s] * power;
            }
            let mut off = vec![0.0; 3 * n];
            for s in 0..3 {
                for i in 0..n {
                    let sum: f64 = (0..3).map(|r| a[s][r] * self.f[1 + r][i]).sum();
                    off[s * n + i] = h * sum - self.z[s * n + i];
                }
            }
            let d = self.ready.as_ref()?.1.solve(&off);
            let norm = (0..3 * n).map(|k| (d[k] / scale[k % n]).powi(2)).sum::<f64>();
            let norm = (norm / (3 * n) as f64).sqrt();
            if !norm.is_finite() {
                return None;
            }
            self.z.iter_mut().zip(&d).for_each(|(z, d)| *z += d);
            let rate = norm / before;
            if norm == 0.0 || (iteration > 1 && rate < 1.0 && rate / (1.0 - rate) * norm <= goal) {
                return Some((iteration, work));
            }
            if iteration > 1 && rate >= 1.0 {
                return None;
            }
            before = norm;
        }
        None
    }
}

fn table() -> [[f64; 3]; 3] {
    let q = 6f64.sqrt();
    [
        [(88.0 - 7.0 * q) / 360.0, (296.0 - 169.0 * q) / 1800.0, (-2.0 + 3.0 * q) / 225.0],
        [(296.0 + 169.0 * q) / 1800.0, (88.0 + 7.0 * q) / 360.0, (-2.0 - 3.0 * q) / 225.0],
        [(16.0 - q) / 36.0, (16.0 + q) / 36.0, 1.0 / 9.0],
    ]
}

fn places() -> [f64; 3] {
    let q = 6f64.sqrt();
    [(4.0 - q) / 10.0, (4.0 + q) / 10.0, 1.0]
}

/// The real eigenvalue of the table's inverse.
fn gamma() -> f64 {
    30.0 / (6.0 + 81f64.cbrt() - 9f64.cbrt())
}

impl Method for Radau {
    fn step(&mut self, field: &mut Field, t: f64, x: &[f64], h: f64, scale: &[f64], next: &mut [f64]) -> Option<Tried> {
        let n = self.n;
        let mut f0 = vec![0.0; n];
        field.rates(t, x, &mut f0)?;
        self.f[0].copy_from_slice(&f0);
        if !self.fresh {
            self.differ(field, t, x, scale)?;
            self.fresh = true;
        }
        if self.ready.as_ref().is_none_or(|r| r.0 != h) {
            self.ready = self.eliminate(h);
        }
        let Some((iterations, work)) = self.stages(field, t, x, h, scale) else {
            // With an old Jacobian it is tried anew with one of here.
            let old = !self.here;
            self.fresh = false;
            self.careful = true;
            if old {
                self.differ(field, t, x, scale)?;
                self.fresh = true;
                return Some(Tried { error: 1e3, factor: 0.5, work: 0.0 });
            }
            return None;
        };
        for i in 0..n {
            next[i] = x[i] + self.z[2 * n + i];
        }
        let q = 6f64.sqrt();
        let e = [-(13.0 + 7.0 * q) / 3.0, (-13.0 + 7.0 * q) / 3.0, -1.0 / 3.0];
        let slope: Vec<f64> = (0..n).map(|i| (0..3).map(|s| e[s] * self.z[s * n + i]).sum::<f64>() / h).collect();
        let small = &self.ready.as_ref()?.2;
        let norm = |d: &[f64]| ((0..n).map(|i| (d[i] / scale[i]).powi(2)).sum::<f64>() / n as f64).sqrt();
        let right: Vec<f64> = (0..n).map(|i| slope[i] + f0[i]).collect();
        let d = small.solve(&right);
        let mut error = norm(&d);
        if error >= 1.0 && self.careful {
            let y: Vec<f64> = (0..n).map(|i| x[i] + d[i]).collect();
            let mut g = vec![0.0; n];
            if field.rates(t, &y, &mut g).is_some() {
                let right: Vec<f64> = (0..n).map(|i| slope[i] + g[i]).collect();
                error = norm(&small.solve(&right));
            }
        }
        let safe = 0.9 * 21.0 / (20.0 + iterations as f64);
        let mut factor = (safe * error.max(1e-10).powf(-0.25)).clamp(0.125, 5.0);
        self.careful = error > 1.0;
        if error <= 1.0 {
            self.here = false;
            // The Jacobian is kept where Newton's method was quick, and the step where it would grow but little.
            self.fresh = iterations <= 2 && n > 3;
            if (1.0..1.2).contains(&factor) && self.fresh {
                factor = 1.0;
            }
        }
        Some(Tried { error, factor, work })
    }
}
