//! Units in which a matrix is even.

/// Powers of two `d` such that `a_ij d_j / d_i` has rows and columns of like size; what has only a row or only a column
/// is made to count for at most `rate`. After Parlett and Reinsch, Balancing a matrix, 1969.
///
/// # Panics
/// Where `a` is not `n * n` long.
pub(super) fn balance(n: usize, a: &[f64], rate: f64) -> Vec<f64> {
    let mut d = vec![1.0f64; n];
    for _ in 0..100 {
        let mut done = true;
        for i in 0..n {
            let (mut row, mut column) = (0.0f64, 0.0f64);
            for j in (0..n).filter(|&j| j != i) {
                row += (a[i * n + j] * d[j]).abs() / d[i];
                column += (a[j * n + i] * d[i]).abs() / d[j];
            }
            // By how much d_i is to grow.
            let factor = if row > 0.0 && column > 0.0 {
                (row / column).sqrt()
            } else if row > rate {
                row / rate
            } else if column > rate {
                rate / column
            } else {
                1.0
            };
            let power = libm::log2(factor).round();
            if !power.is_finite() || power == 0.0 {
                continue;
            }
            let wanted = d[i] * libm::exp2(power.clamp(-900.0, 900.0));
            let wanted = wanted.clamp(2f64.powi(-300), 2f64.powi(300));
            if wanted != d[i] {
                d[i] = wanted;
                done = false;
            }
        }
        if done {
            break;
        }
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wild_units_become_even() {
        // A spring and a mass with units 1e12 apart, pushed by a constant.
        let a = [0.0, 1e12, 0.0, -1e-12, -0.1, 1e9, 0.0, 0.0, 0.0];
        let d = balance(3, &a, 1.0);
        for i in 0..3 {
            for j in 0..3 {
                assert!((a[3 * i + j] * d[j] / d[i]).abs() <= 2.0);
            }
            assert_eq!(d[i].to_bits() << 12, 0);
        }
    }
}
