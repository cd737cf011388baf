//! Eigenvalues and eigenvectors of a method's matrix A: with them the equations of all stages come apart (Butcher, BIT
//! 16, 1976; Hairer and Wanner, Solving Ordinary Differential Equations II, IV.8).

use nalgebra::{Complex, DMatrix, DVector};

/// A part of a number whose other part is the imaginary one.
pub(crate) type Pair = (f64, f64);

/// An eigenvalue of A, of two that are conjugate the one above the real axis, with its eigenvectors.
pub(crate) struct Mode {
    /// The eigenvalue; of a real one the second part is 0.
    pub(crate) value: Pair,
    /// Of the right eigenvector.
    pub(crate) right: Vec<Pair>,
    /// Of the left one, so that left and right have the product 1.
    pub(crate) left: Vec<Pair>,
}

impl Mode {
    /// Whether it is real: it counts once; else its conjugate counts too.
    pub(crate) fn is_real(&self) -> bool {
        self.value.1 == 0.0
    }
}

/// The modes of a square matrix whose eigenvalues are distinct; `None` where one is not found.
pub(crate) fn modes(a: &[Vec<f64>]) -> Option<Vec<Mode>> {
    let n = a.len();
    let real = DMatrix::from_fn(n, n, |i, j| a[i][j]);
    let complex = real.map(|x| Complex::new(x, 0.0));
    let size = real.norm();
    let mut list = Vec::new();
    for value in real.complex_eigenvalues().iter() {
        let value = if value.im.abs() < 1e-9 * size { Complex::new(value.re, 0.0) } else { *value };
        if value.im < 0.0 {
            continue;
        }
        let right = vector(&complex, value, size)?;
        let left = vector(&complex.transpose(), value, size)?;
        let product: Complex<f64> = left.iter().zip(right.iter()).map(|(l, r)| l * r).sum();
        // Rayleigh's quotient has twice the digits of its vectors.
        let image = &complex * &right;
        let value = left.iter().zip(image.iter()).map(|(l, r)| l * r).sum::<Complex<f64>>() / product;
        let value = (value.re, if value.im.abs() < 1e-12 * size { 0.0 } else { value.im });
        let parts = |v: &DVector<Complex<f64>>, by: Complex<f64>| v.iter().map(|x| (x * by).re_im()).collect();
        list.push(Mode { value, right: parts(&right, Complex::new(1.0, 0.0)), left: parts(&left, product.inv()) });
    }
    list.sort_by(|x, y| x.value.0.total_cmp(&y.value.0));
    Some(list)
}

/// The parts of a complex number.
trait Parts {
    fn re_im(self) -> Pair;
}

impl Parts for Complex<f64> {
    fn re_im(self) -> Pair {
        (self.re, self.im)
    }
}

/// The eigenvector of an eigenvalue, by inverse iteration.
fn vector(a: &DMatrix<Complex<f64>>, value: Complex<f64>, size: f64) -> Option<DVector<Complex<f64>>> {
    let n = a.nrows();
    let near = value + Complex::new(1e-10 * size, 0.0);
    let lu = (a - DMatrix::identity(n, n) * near).lu();
    let mut v = DVector::from_fn(n, |i, _| Complex::new(1.0 + 0.3 * i as f64, 0.0));
    for _ in 0..4 {
        v = lu.solve(&v)?;
        let length = v.iter().map(|x| x.norm_sqr()).sum::<f64>().sqrt();
        v /= Complex::new(length, 0.0);
    }
    // Of a real eigenvalue it is real, but for a phase.
    let largest = v.iter().copied().max_by(|x, y| x.norm_sqr().total_cmp(&y.norm_sqr()))?;
    Some(v / largest)
}

#[cfg(test)]
mod tests {
    use super::super::tableau::Tableau;
    use super::*;

    #[test]
    fn modes_make_up_the_matrix() {
        let tableaus = (1..=6).map(Tableau::gauss).chain([Tableau::radau()]);
        for t in tableaus {
            let a = t.matrix();
            let Some(modes) = modes(&a) else { panic!("modes of {} stages", t.stages()) };
            let count: usize = modes.iter().map(|m| if m.is_real() { 1 } else { 2 }).sum();
            assert_eq!(count, t.stages());
            for i in 0..t.stages() {
                for j in 0..t.stages() {
                    let sum: f64 = modes
                        .iter()
                        .map(|m| {
                            let c = |p: Pair| Complex::new(p.0, p.1);
                            let x = c(m.value) * c(m.right[i]) * c(m.left[j]);
                            if m.is_real() { x.re } else { 2.0 * x.re }
                        })
                        .sum();
                    assert!((sum - a[i][j]).abs() < 1e-13, "{i} {j}: {sum} {}", a[i][j]);
                }
            }
        }
    }
}
