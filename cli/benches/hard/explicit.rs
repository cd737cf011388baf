//! Dormand and Prince's pair of order 5(4), as in DOPRI5 and ode45.

use super::field::Field;
use super::rival::{Method, Tried};

const C: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];
const A: [[f64; 6]; 7] = [
    [0.0; 6],
    [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// The weights of order 5 less those of order 4.
const E: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

/// The pair with its stages.
pub struct Pair {
    k: Vec<Vec<f64>>,
    y: Vec<f64>,
}

impl Pair {
    /// For so many states.
    pub fn new(n: usize) -> Self {
        Self { k: vec![vec![0.0; n]; 7], y: vec![0.0; n] }
    }
}

impl Method for Pair {
    fn step(&mut self, field: &mut Field, t: f64, x: &[f64], h: f64, scale: &[f64], next: &mut [f64]) -> Option<Tried> {
        let n = x.len();
        let mut work = 0.0;
        for s in 0..7 {
            for i in 0..n {
                let sum: f64 = (0..s).map(|j| A[s][j] * self.k[j][i]).sum();
                self.y[i] = x[i] + h * sum;
            }
            // The first stage is the last one of the step before only where that was taken; it is cheap to ask anew.
            let power = field.rates(t + C[s] * h, &self.y, &mut self.k[s])?;
            work += h * A[6].get(s).copied().unwrap_or(0.0) * power;
        }
        next.copy_from_slice(&self.y);
        let square = |i: usize| {
            let e: f64 = (0..7).map(|s| E[s] * self.k[s][i]).sum();
            (h * e / scale[i].max(f64::MIN_POSITIVE)).powi(2)
        };
        let error = ((0..n).map(square).sum::<f64>() / n as f64).sqrt();
        Some(Tried { error, factor: (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0), work })
    }
}
