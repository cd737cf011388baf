//! Factors of a sparse matrix, and solutions with them.

use super::line::Factors;
use super::{Run, Symbolic};
use crate::eval::inverse_scale;
use crate::solve::scalar::Scalar;

/// A pivot smaller than this part of an entry below it is refused.
pub(super) const TINY: f64 = 1e-13;
/// A multiplier above this asks for a step of refinement.
pub(super) const SUSPICIOUS: f64 = 1e3;
/// What a pivot is raised to by [`Numeric::solve_raised`], the largest entries being near 1.
pub(super) const RAISED: f64 = 1e-8;
/// How many steps of refinement that is given.
pub(super) const STEPS: usize = 8;

/// The factors of a matrix. Lists of values and vectors have as many numbers for each of theirs as [`Scalar::PARTS`]
/// says.
#[derive(Clone, Debug, Default)]
pub struct Numeric<T> {
    lower: Vec<T>,
    /// Rows divided by their pivots.
    upper: Vec<T>,
    /// Of the pivots.
    inverse: Vec<T>,
    /// Of a line, the same numbers in the order of its pairs.
    packed: Vec<[T; 2]>,
    row_scale: Vec<f64>,
    column_scale: Vec<f64>,
    work: Vec<T>,
    /// The right side, and what the solution leaves of it.
    right: Vec<f64>,
    rest: Vec<f64>,
    growth: f64,
    /// The values that were factored last, where that went well.
    factored: Vec<f64>,
}

impl<T: Scalar> Numeric<T> {
    /// Memory for the factors of a pattern.
    pub fn new(symbolic: &Symbolic) -> Self {
        let n = symbolic.n;
        let none = T::default();
        Self {
            lower: vec![none; symbolic.lower.columns.len()],
            upper: vec![none; symbolic.upper.columns.len()],
            inverse: vec![none; n],
            packed: vec![[none; 2]; symbolic.line.map_or(0, |line| line.packed())],
            row_scale: vec![1.0; n],
            column_scale: vec![1.0; n],
            work: vec![none; n],
            right: vec![0.0; T::PARTS * n],
            rest: vec![0.0; T::PARTS * n],
            growth: 0.0,
            factored: Vec::with_capacity(T::PARTS * symbolic.entries.len()),
        }
    }

    /// Factors the matrix with these values, in the order of the pattern; `same` where they are known to be those of
    /// the last call.
    ///
    /// # Errors
    /// A row whose pivot is 0, not finite, or too small beside the entries below it.
    ///
    /// # Panics
    /// Where this was made for another [`Symbolic`], or there are fewer values than the pattern has places.
    pub fn factor(&mut self, symbolic: &Symbolic, values: &[f64], same: bool) -> Result<(), usize> {
        // The matrix of a linear region is the same in every step of one length.
        let values = &values[..T::PARTS * symbolic.entries.len()];
        if self.factored.len() == values.len() && (same || self.factored == values) {
            return Ok(());
        }
        self.factored.clear();
        self.eliminate(symbolic, values, 0.0)?;
        self.factored.extend_from_slice(values);
        Ok(())
    }

    /// Solves where [`Numeric::factor`] fails: pivots that are too small are raised, and the error this makes is
    /// refined away (Li and Demmel, Making sparse Gaussian elimination scalable by static pivoting, 1998).
    ///
    /// # Errors
    /// A row that does not come out right, as where the matrix is singular.
    ///
    /// # Panics
    /// As [`Numeric::factor`], and where `b` is shorter than the matrix.
    pub fn solve_raised(&mut self, symbolic: &Symbolic, values: &[f64], b: &mut [f64]) -> Result<(), usize> {
        self.factored.clear();
        self.eliminate(symbolic, values, RAISED)?;
        self.keep(b);
        self.substitute(symbolic, b);
        let mut change = self.change(symbolic, b);
        for _ in 0..STEPS {
            let (row, part) = self.leave(symbolic, values, b);
            if part <= 1e-15 {
                return Ok(());
            }
            self.correct(symbolic, b);
            let next = self.change(symbolic, &self.rest);
            if part <= 1e-12 && next <= 1e-8 * change {
                return Ok(());
            }
            // Corrections that don't shrink have come down to rounding, or the matrix is singular.
            if next.is_nan() || next > 0.5 * change {
                return if part <= 1e-12 { Ok(()) } else { Err(symbolic.row[row] as usize) };
            }
            change = next;
        }
        let (row, part) = self.leave(symbolic, values, b);
        if part <= 1e-12 { Ok(()) } else { Err(symbolic.row[row] as usize) }
    }

    /// Factors the scaled matrix, with pivots raised to `floor`.
    fn eliminate(&mut self, symbolic: &Symbolic, values: &[f64], floor: f64) -> Result<(), usize> {
        self.scale(symbolic, values);
        self.growth = 0.0;
        let Self { lower, upper, inverse, row_scale, column_scale, work, growth, .. } = self;
        let work = &mut work[..symbolic.n];
        let none = T::default();
        work.fill(none);
        for i in 0..symbolic.n {
            for &(index, k) in symbolic.entries(i) {
                work[k as usize] = T::at(values, index as usize).by(row_scale[i]).by(column_scale[k as usize]);
            }
            let own = work[i].size();
            let range = symbolic.lower.row(i);
            for (&k, l) in symbolic.lower.columns[range.clone()].iter().zip(&mut lower[range]) {
                let k = k as usize;
                let multiplier = work[k].times(inverse[k]);
                work[k] = none;
                *l = multiplier;
                if multiplier == none {
                    continue;
                }
                let magnitude = multiplier.size();
                if magnitude > *growth {
                    *growth = magnitude;
                    if magnitude > 1.0 / TINY {
                        return Err(symbolic.row[k] as usize);
                    }
                }
                let row = symbolic.upper.row(k);
                for (&j, u) in symbolic.upper.columns[row.clone()].iter().zip(&upper[row]) {
                    work[j as usize] = work[j as usize].less(multiplier, *u);
                }
            }
            let pivot = work[i].raised(floor);
            let reciprocal = pivot.inverse();
            let size = pivot.size();
            if !reciprocal.size().is_finite() || !size.is_finite() || size < 1e-15 * own {
                return Err(symbolic.row[i] as usize);
            }
            inverse[i] = reciprocal;
            work[i] = none;
            let range = symbolic.upper.row(i);
            for (&j, u) in symbolic.upper.columns[range.clone()].iter().zip(&mut upper[range]) {
                *u = work[j as usize];
                work[j as usize] = none;
            }
        }
        self.unscale(symbolic);
        Ok(())
    }

    /// Divides rows by their pivots, and takes the scales, powers of two, into the factors: so a solution needs none.
    fn unscale(&mut self, symbolic: &Symbolic) {
        let (row, column) = (&self.row_scale, &self.column_scale);
        let none = T::default();
        for i in 0..symbolic.n {
            let range = symbolic.lower.row(i);
            for (&k, l) in symbolic.lower.columns[range.clone()].iter().zip(&mut self.lower[range]) {
                if *l != none {
                    *l = l.by(row[k as usize] / row[i]);
                }
            }
            let range = symbolic.upper.row(i);
            for (&j, u) in symbolic.upper.columns[range.clone()].iter().zip(&mut self.upper[range]) {
                if *u != none {
                    *u = u.times(self.inverse[i]).by(column[i] / column[j as usize]);
                }
            }
            self.inverse[i] = self.inverse[i].by(row[i]).by(column[i]);
        }
        if let Some(line) = &symbolic.line {
            let (lower, upper) = ((&self.lower[..], &symbolic.lower), (&self.upper[..], &symbolic.upper));
            line.pack(Factors { order: &symbolic.column, lower, upper, inverse: &self.inverse }, &mut self.packed);
        }
    }

    /// Scales such that the largest entry of each row, then of each column, is near 1.
    fn scale(&mut self, symbolic: &Symbolic, values: &[f64]) {
        let largest = &mut self.column_scale[..symbolic.n];
        largest.fill(0.0);
        for i in 0..symbolic.n {
            let entries = symbolic.entries(i);
            let row = entries.iter().fold(0.0f64, |m, &(index, _)| m.max(T::at(values, index as usize).size()));
            let scale = inverse_scale(row);
            self.row_scale[i] = scale;
            for &(index, k) in entries {
                let size = T::at(values, index as usize).by(scale).size();
                if size > largest[k as usize] {
                    largest[k as usize] = size;
                }
            }
        }
        for scale in largest {
            *scale = inverse_scale(*scale);
        }
    }

    /// Solves with the matrix factored last, whose values are given again: `b` becomes `x`.
    ///
    /// One step of refinement is made where the factorisation was not plainly stable.
    ///
    /// # Panics
    /// As [`Numeric::factor`], and where `b` is shorter than the matrix.
    pub fn solve(&mut self, symbolic: &Symbolic, values: &[f64], b: &mut [f64]) {
        let suspicious = self.growth > SUSPICIOUS;
        if suspicious {
            self.keep(b);
        }
        self.substitute(symbolic, b);
        if suspicious {
            self.leave(symbolic, values, b);
            self.correct(symbolic, b);
        }
    }

    /// Keeps the right side, which is looked at again.
    fn keep(&mut self, b: &[f64]) {
        let n = self.right.len();
        self.right.copy_from_slice(&b[..n]);
    }

    /// `rest` becomes what `x` leaves of the right side; returns the step where most is left, beside its terms, and how
    /// much.
    fn leave(&mut self, symbolic: &Symbolic, values: &[f64], x: &[f64]) -> (usize, f64) {
        let mut worst = (0, 0.0);
        for i in 0..symbolic.n {
            let row = symbolic.row[i] as usize;
            let mut rest = T::at(&self.right, row);
            let mut size = rest.size();
            for &(index, k) in symbolic.entries(i) {
                let (a, x) = (T::at(values, index as usize), T::at(x, symbolic.column[k as usize] as usize));
                rest = rest.less(a, x);
                size += a.times(x).size();
            }
            rest.put(&mut self.rest, row);
            let part = if size > 0.0 { rest.size() / size } else { 0.0 };
            if part > worst.1 || part.is_nan() {
                worst = (i, if part.is_nan() { f64::INFINITY } else { part });
            }
        }
        worst
    }

    /// Adds the solution for the right side `rest`.
    fn correct(&mut self, symbolic: &Symbolic, x: &mut [f64]) {
        let mut rest = std::mem::take(&mut self.rest);
        self.substitute(symbolic, &mut rest);
        x.iter_mut().zip(&rest).for_each(|(x, d)| *x += d);
        self.rest = rest;
    }

    /// The largest magnitude in a solution, scaled; NaN where there is one.
    fn change(&self, symbolic: &Symbolic, x: &[f64]) -> f64 {
        let x = symbolic.column.iter().map(|column| T::at(x, *column as usize));
        let sizes = x.zip(&self.column_scale).map(|(x, scale)| x.size() / scale);
        sizes.fold(0.0, |m, x| if x > m || x.is_nan() { x } else { m })
    }

    /// A right side becomes the solution.
    fn substitute(&mut self, symbolic: &Symbolic, b: &mut [f64]) {
        let Self { lower, upper, inverse, work, packed, .. } = self;
        let (n, rows, columns) = (symbolic.n, &symbolic.row[..], &symbolic.column[..]);
        let (work, inverse, b) = (&mut work[..n], &inverse[..n], &mut b[..T::PARTS * n]);
        if let Some(line) = &symbolic.line {
            let (lower, upper) = ((&lower[..], &symbolic.lower), (&upper[..], &symbolic.upper));
            return line.substitute(Factors { order: columns, lower, upper, inverse }, packed, b);
        }
        for run in &symbolic.lower.runs {
            let starts = &symbolic.lower.starts;
            let l = &lower[starts[run.from as usize]..starts[run.to as usize]];
            if run.distance == 0 {
                let columns = &symbolic.lower.columns;
                for i in run.from as usize..run.to as usize {
                    let range = symbolic.lower.row(i);
                    let mut sum = T::at(b, rows[i] as usize);
                    for (&k, l) in columns[range.clone()].iter().zip(&lower[range]) {
                        sum = sum.less(*l, work[k as usize]);
                    }
                    work[i] = sum;
                }
            } else {
                forward(*run, l, rows, b, work);
            }
        }
        for run in symbolic.upper.runs.iter().rev() {
            let starts = &symbolic.upper.starts;
            let u = &upper[starts[run.from as usize]..starts[run.to as usize]];
            if run.distance == 0 {
                for i in (run.from as usize..run.to as usize).rev() {
                    let range = symbolic.upper.row(i);
                    let mut sum = work[i].times(inverse[i]);
                    for (&j, u) in symbolic.upper.columns[range.clone()].iter().zip(&upper[range]) {
                        sum = sum.less(*u, work[j as usize]);
                    }
                    work[i] = sum;
                    sum.put(b, columns[i] as usize);
                }
            } else {
                backward(*run, (u, inverse), columns, work, b);
            }
        }
    }
}

/// Goes down a stretch in which each row has one entry.
fn forward<T: Scalar>(run: Run, lower: &[T], rows: &[u32], b: &[f64], work: &mut [T]) {
    let (from, to, far) = (run.from as usize, run.to as usize, run.distance as usize);
    let rows = &rows[from..to];
    let each = rows.iter().zip(lower);
    match far {
        1 => {
            let mut x = work[from - 1];
            for ((&row, l), to) in each.zip(&mut work[from..to]) {
                x = T::at(b, row as usize).less(*l, x);
                *to = x;
            }
        }
        // From both ends at once: two chains, neither of which waits for the other.
        2 => {
            let mut x = T::two([work[from - 2], work[from - 1]]);
            let (rows, last_row) = rows.as_chunks::<2>();
            let (lower, last_lower) = lower.as_chunks::<2>();
            let (to, last) = work[from..to].as_chunks_mut::<2>();
            for ((row, l), to) in rows.iter().zip(lower).zip(to) {
                x = T::less_two(T::two(row.map(|row| T::at(b, row as usize))), T::two(*l), x);
                *to = T::each(x);
            }
            if let ([last], [row], [l]) = (last, last_row, last_lower) {
                *last = T::at(b, *row as usize).less(*l, T::each(x)[0]);
            }
        }
        far => {
            for (i, (&row, l)) in each.enumerate() {
                work[from + i] = T::at(b, row as usize).less(*l, work[from + i - far]);
            }
        }
    }
}

/// Goes up a stretch in which each row has one entry.
fn backward<T: Scalar>(run: Run, (upper, inverse): (&[T], &[T]), columns: &[u32], work: &mut [T], b: &mut [f64]) {
    let (from, to, far) = (run.from as usize, run.to as usize, run.distance as usize);
    let (columns, inverse) = (&columns[from..to], &inverse[from..to]);
    match far {
        1 => {
            let mut x = work[to];
            let each = columns.iter().zip(upper).zip(inverse).zip(&mut work[from..to]);
            for (((&column, u), inverse), at) in each.rev() {
                x = at.times(*inverse).less(*u, x);
                *at = x;
                x.put(b, column as usize);
            }
        }
        2 => {
            let mut x = T::two([work[to], work[to + 1]]);
            let (first_column, columns) = columns.as_rchunks::<2>();
            let (first_upper, upper) = upper.as_rchunks::<2>();
            let (first_inverse, inverse) = inverse.as_rchunks::<2>();
            let (first, at) = work[from..to].as_rchunks_mut::<2>();
            for (((column, u), inverse), at) in columns.iter().zip(upper).zip(inverse).zip(at).rev() {
                x = T::less_two(T::times_two(T::two(*at), T::two(*inverse)), T::two(*u), x);
                *at = T::each(x);
                at[0].put(b, column[0] as usize);
                at[1].put(b, column[1] as usize);
            }
            if let ([first], [column], [u], [inverse]) = (first, first_column, first_upper, first_inverse) {
                *first = first.times(*inverse).less(*u, T::each(x)[1]);
                first.put(b, *column as usize);
            }
        }
        far => {
            for i in (0..to - from).rev() {
                let x = work[from + i].times(inverse[i]).less(upper[i], work[from + i + far]);
                work[from + i] = x;
                x.put(b, columns[i] as usize);
            }
        }
    }
}
