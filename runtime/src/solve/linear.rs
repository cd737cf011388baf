//! Linear systems of a known pattern: chooses between dense and sparse elimination.

pub use crate::ir::Matrix;

use super::dense;
use super::scalar::Complex;
use super::sparse::{Numeric, Symbolic};

/// Up to this size elimination is dense.
const DENSE: usize = 16;
/// Up to this size it is dense where the factors are a third full.
const FULL: usize = 64;
/// Up to this size a sparse elimination that meets a bad pivot is done again densely, with pivoting; above, pivots are
/// raised and the solution refined.
const AGAIN: usize = 200;

/// What is known of a system before its numbers.
#[derive(Clone, Debug)]
pub struct Plan {
    n: usize,
    undetermined: bool,
    method: Method,
}

/// How systems of a pattern are solved.
#[derive(Clone, Debug)]
pub(super) enum Method {
    Dense,
    Sparse(Symbolic),
    /// Of complex numbers.
    Complex(Symbolic),
    /// Singular whatever the numbers: this row has no pivot.
    Never(usize),
}

/// Memory for a solution.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    matrix: Vec<f64>,
    dense: dense::Scratch,
    numeric: Numeric<f64>,
    complex: Numeric<Complex>,
}

impl Plan {
    /// The plan for `n` unknowns and a pattern of (row, column), each place at most once. Of complex numbers it is
    /// always sparse, and without a second try where a pivot is bad but that which raises it.
    ///
    /// # Panics
    /// Where the pattern is not within `n` rows and columns.
    pub fn new(n: usize, pattern: &[(u32, u32)], matrix: Matrix) -> Self {
        let method = if matrix == Matrix::Complex {
            Symbolic::analyse(n, pattern, false).map_or_else(Method::Never, Method::Complex)
        } else if n <= DENSE {
            Method::Dense
        } else {
            match Symbolic::analyse(n, pattern, matrix == Matrix::Kept) {
                Ok(symbolic) if n <= FULL && 3 * symbolic.fill() > n * n => Method::Dense,
                Ok(symbolic) => Method::Sparse(symbolic),
                Err(row) => Method::Never(row),
            }
        };
        Self { n, undetermined: matrix == Matrix::Undetermined, method }
    }

    /// Whether rows may say the same.
    pub fn is_undetermined(&self) -> bool {
        self.undetermined
    }

    /// How many unknowns.
    pub fn size(&self) -> usize {
        self.n
    }

    /// The elimination, where the unknowns are a line.
    pub fn line(&self) -> Option<&Symbolic> {
        match &self.method {
            Method::Sparse(symbolic) => symbolic.tables().line.is_some().then_some(symbolic),
            Method::Dense | Method::Complex(_) | Method::Never(_) => None,
        }
    }

    /// Whether a sparse elimination that meets a bad pivot is done again densely.
    pub(super) fn is_dense_again(&self) -> bool {
        self.n <= AGAIN && matches!(self.method, Method::Sparse(_))
    }

    pub(super) fn method(&self) -> &Method {
        &self.method
    }

    /// Memory for it.
    pub fn scratch(&self) -> Scratch {
        let n = self.n;
        let again = if n <= AGAIN { n } else { 0 };
        match &self.method {
            Method::Dense => Scratch { matrix: vec![0.0; n * n], dense: dense::Scratch::new(n), ..Scratch::default() },
            Method::Sparse(symbolic) => Scratch {
                matrix: vec![0.0; again * again],
                dense: dense::Scratch::new(again),
                numeric: Numeric::new(symbolic),
                ..Scratch::default()
            },
            Method::Complex(symbolic) => Scratch { complex: Numeric::new(symbolic), ..Scratch::default() },
            Method::Never(_) => Scratch::default(),
        }
    }

    /// Solves `J x = b`, `b` in and `x` out, with the values of `J` in the order of the pattern given to [`Plan::new`].
    /// `same` where these are known to be those of the last solution with this scratch, whose factors are then good
    /// again. Says whether something was left undetermined.
    ///
    /// # Errors
    /// A row for which no pivot is found; `vector` then means nothing. `x` may be infinite or NaN without an error.
    ///
    /// # Panics
    /// Where pattern or scratch are another plan's, or a slice is too short.
    pub fn solve(
        &self,
        pattern: &[(u32, u32)],
        values: &[f64],
        vector: &mut [f64],
        scratch: &mut Scratch,
        same: bool,
    ) -> Result<bool, usize> {
        match &self.method {
            Method::Dense => self.dense(pattern, values, vector, scratch),
            Method::Sparse(symbolic) => match scratch.numeric.factor(symbolic, values, same) {
                Ok(()) => {
                    scratch.numeric.solve(symbolic, values, vector);
                    Ok(false)
                }
                Err(_) if self.n <= AGAIN => self.dense(pattern, values, vector, scratch),
                Err(_) => scratch.numeric.solve_raised(symbolic, values, vector).map(|()| false),
            },
            Method::Complex(symbolic) => match scratch.complex.factor(symbolic, values, same) {
                Ok(()) => {
                    scratch.complex.solve(symbolic, values, vector);
                    Ok(false)
                }
                Err(_) => scratch.complex.solve_raised(symbolic, values, vector).map(|()| false),
            },
            Method::Never(row) => Err(*row),
        }
    }

    fn dense(
        &self,
        pattern: &[(u32, u32)],
        values: &[f64],
        vector: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<bool, usize> {
        let matrix = &mut scratch.matrix[..self.n * self.n];
        matrix.fill(0.0);
        for (&(row, column), value) in pattern.iter().zip(values) {
            matrix[row as usize * self.n + column as usize] = *value;
        }
        dense::solve(self.n, matrix, vector, &mut scratch.dense, self.undetermined)
    }
}

/// A system with its pattern and memory, for those who keep nothing else of it.
#[derive(Clone, Debug)]
pub struct System {
    plan: Plan,
    pattern: Vec<(u32, u32)>,
    /// Numbers in each value: two of a complex one.
    parts: usize,
    scratch: Scratch,
}

impl System {
    /// The system of `n` unknowns and a pattern of (row, column), each place at most once.
    ///
    /// # Panics
    /// Where the pattern is not within `n` rows and columns.
    pub fn new(n: usize, pattern: Vec<(u32, u32)>, matrix: Matrix) -> Self {
        let plan = Plan::new(n, &pattern, matrix);
        let scratch = plan.scratch();
        Self { plan, pattern, parts: if matrix == Matrix::Complex { 2 } else { 1 }, scratch }
    }

    /// How many numbers its vectors have.
    pub fn size(&self) -> usize {
        self.parts * self.plan.n
    }

    /// How many numbers its matrix has.
    pub fn entries(&self) -> usize {
        self.parts * self.pattern.len()
    }

    /// See [`Plan::solve`].
    ///
    /// # Errors
    /// A row for which no pivot is found.
    ///
    /// # Panics
    /// Where a slice is too short.
    pub fn solve(&mut self, values: &[f64], vector: &mut [f64], same: bool) -> Result<bool, usize> {
        self.plan.solve(&self.pattern, values, vector, &mut self.scratch, same)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::testing::Random;

    /// A matrix whose fixed pivots vanish: the dense elimination takes over.
    #[test]
    fn vanishing_pivots() {
        let n = 40u32;
        let mut entries: Vec<(u32, u32, f64)> = Vec::new();
        for i in 0..n {
            entries.push((i, i, 0.0));
            entries.push((i, (i + 1) % n, 2.0 + 0.1 * f64::from(i)));
            if i % 3 == 0 {
                entries.push((i, (i + 7) % n, 1.0));
            }
        }
        let pattern: Vec<_> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
        let values: Vec<_> = entries.iter().map(|&(.., v)| v).collect();
        let plan = Plan::new(n as usize, &pattern, Matrix::Changing);
        assert!(matches!(plan.method, Method::Sparse(_)));
        let mut random = Random::new(11);
        let right: Vec<f64> = (0..n).map(|_| random.next()).collect();
        let mut x = right.clone();
        assert_eq!(plan.solve(&pattern, &values, &mut x, &mut plan.scratch(), false), Ok(false));
        let mut rest = right;
        for (r, c, v) in entries {
            rest[r as usize] -= v * x[c as usize];
        }
        assert!(rest.iter().all(|r| r.abs() < 1e-12));
    }
}
