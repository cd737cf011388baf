//! How fast the states of a linear cluster turn.

use bond_runtime::exponential::Linear;
use nalgebra::{DMatrix, Schur};

/// Rounds of the iteration for each eigenvalue; more are never needed but by what is no number.
const ROUNDS: usize = 100;

/// The largest imaginary part of an eigenvalue of the states' matrix, rad/s; 0 where none can be found.
pub(crate) fn fastest_turn(linear: &Linear) -> f64 {
    let (n, columns) = (linear.n, linear.n + linear.m);
    let matrix = DMatrix::from_fn(n, n, |i, j| linear.a[i * columns + j].high);
    if n == 0 || !matrix.iter().all(|x| x.is_finite()) {
        return 0.0;
    }
    let schur = Schur::try_new(matrix, f64::EPSILON, ROUNDS * n);
    schur.map_or(0.0, |s| s.complex_eigenvalues().iter().fold(0.0, |most, x| x.im.abs().max(most)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bond_runtime::double_double::DoubleDouble;

    #[test]
    fn an_oscillator_turns_at_its_own_rate() {
        let a = [0.0, 1.0, -9.0, 0.0].map(|high| DoubleDouble { high, low: 0.0 }).to_vec();
        let linear = Linear { n: 2, a, ..Linear::default() };
        assert!((fastest_turn(&linear) - 3.0).abs() < 1e-14);
        assert_eq!(fastest_turn(&Linear::default()), 0.0);
    }
}
