//! Sparse systems with a fixed pattern: analysed once, factored again and again without allocation.
//!
//! Pivots are fixed by the pattern alone: the diagonal, or a transversal where the diagonal has holes, in an order that
//! makes little fill. Rows and columns are scaled by powers of two first. That is sound for matrices whose symmetric
//! part is positive definite after scaling, and for most others; where it is not, the factorisation says so.

use super::dense::inverse_scale;
use super::order::{minimum_degree, transversal};

/// A pivot smaller than this part of an entry below it is refused.
const TINY: f64 = 1e-13;
/// A multiplier above this asks for a step of refinement.
const SUSPICIOUS: f64 = 1e3;
/// What a pivot is raised to by [`Numeric::solve_raised`], the largest entries being near 1.
const RAISED: f64 = 1e-8;
/// How many steps of refinement that is given.
const STEPS: usize = 8;

/// The plan for one pattern: order of elimination, and where the factors have entries.
#[derive(Clone, Debug)]
pub struct Symbolic {
    n: usize,
    /// By step: the row and the column of the pivot.
    row: Vec<u32>,
    column: Vec<u32>,
    /// Entries of the matrix by step of their row: index in the pattern, step of their column.
    starts: Vec<u32>,
    entries: Vec<(u32, u32)>,
    lower: Pattern,
    upper: Pattern,
}

/// What a [`Symbolic`] knows, step by step of the elimination.
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a> {
    /// The row of each step's pivot.
    pub row: &'a [u32],
    /// Its column.
    pub column: &'a [u32],
    /// By step, where the entries of its row begin.
    pub starts: &'a [u32],
    /// Index in the pattern, step of the column.
    pub entries: &'a [(u32, u32)],
    /// The lower factor row by row: starts, and the columns in ascending order, without the diagonal.
    pub lower: (&'a [usize], &'a [u32]),
    /// The upper factor likewise.
    pub upper: (&'a [usize], &'a [u32]),
}

/// The pattern of a triangle, row by row, each in ascending order, without the diagonal.
#[derive(Clone, Debug, Default)]
struct Pattern {
    starts: Vec<usize>,
    columns: Vec<u32>,
}

impl Pattern {
    fn row(&self, i: usize) -> std::ops::Range<usize> {
        self.starts[i]..self.starts[i + 1]
    }
}

impl Symbolic {
    /// Analyses a pattern of (row, column), each place at most once.
    ///
    /// # Errors
    /// A row for which there can be no pivot: every matrix of this pattern is singular.
    ///
    /// # Panics
    /// Where an entry is not within `n` rows and columns.
    pub fn analyse(n: usize, pattern: &[(u32, u32)]) -> Result<Self, usize> {
        let row_of = transversal(n, pattern)?;
        let mut node_of_row = vec![0u32; n];
        for (column, &row) in row_of.iter().enumerate() {
            node_of_row[row as usize] = column as u32;
        }
        // Nodes are columns, each with the row of its pivot.
        let mut neighbours = vec![Vec::new(); n];
        for &(row, column) in pattern {
            let node = node_of_row[row as usize];
            if node != column {
                neighbours[node as usize].push(column);
                neighbours[column as usize].push(node);
            }
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let column = minimum_degree(neighbours.clone());
        let upper = fill(&column, &inverted(&column), &neighbours);
        let column = by_level(&column, &upper);
        let step = inverted(&column);
        let upper = fill(&column, &step, &neighbours);
        let lower = transpose(&upper);
        let mut starts = vec![0u32; n + 1];
        for &(r, _) in pattern {
            starts[step[node_of_row[r as usize] as usize] as usize + 1] += 1;
        }
        for k in 0..n {
            starts[k + 1] += starts[k];
        }
        let mut entries = vec![(0, 0); pattern.len()];
        let mut at = starts.clone();
        for (index, &(r, c)) in pattern.iter().enumerate() {
            let place = &mut at[step[node_of_row[r as usize] as usize] as usize];
            entries[*place as usize] = (index as u32, step[c as usize]);
            *place += 1;
        }
        let row = column.iter().map(|&c| row_of[c as usize]).collect();
        Ok(Self { n, row, column, starts, entries, lower, upper })
    }

    /// How many unknowns.
    pub fn size(&self) -> usize {
        self.n
    }

    /// Its tables, for back ends that factor by themselves.
    pub fn tables(&self) -> Tables<'_> {
        Tables {
            row: &self.row,
            column: &self.column,
            starts: &self.starts,
            entries: &self.entries,
            lower: (&self.lower.starts, &self.lower.columns),
            upper: (&self.upper.starts, &self.upper.columns),
        }
    }

    /// How many entries the factors have.
    pub fn fill(&self) -> usize {
        self.n + self.lower.columns.len() + self.upper.columns.len()
    }

    /// Memory for the factors.
    pub fn numeric(&self) -> Numeric {
        let n = self.n;
        Numeric {
            lower: vec![0.0; self.lower.columns.len()],
            upper: vec![0.0; self.upper.columns.len()],
            inverse: vec![0.0; n],
            row_scale: vec![1.0; n],
            column_scale: vec![1.0; n],
            work: vec![0.0; n],
            right: vec![0.0; n],
            growth: 0.0,
            factored: Vec::with_capacity(self.entries.len()),
        }
    }

    /// The entries of the matrix in the row of a step: index in the pattern, step of the column.
    fn entries(&self, k: usize) -> &[(u32, u32)] {
        &self.entries[self.starts[k] as usize..self.starts[k + 1] as usize]
    }
}

/// By column: its step.
fn inverted(column: &[u32]) -> Vec<u32> {
    let mut step = vec![0; column.len()];
    for (k, &c) in column.iter().enumerate() {
        step[c as usize] = k as u32;
    }
    step
}

/// The same elimination in an order in which steps that do not wait for one another stand side by side: by how many lie
/// below them in the tree of elimination, where a step's parent is the first that needs it.
fn by_level(column: &[u32], upper: &Pattern) -> Vec<u32> {
    let mut level = vec![0u32; column.len()];
    for k in 0..column.len() {
        if let Some(&parent) = upper.columns[upper.row(k)].first() {
            level[parent as usize] = level[parent as usize].max(level[k] + 1);
        }
    }
    let mut steps: Vec<usize> = (0..column.len()).collect();
    steps.sort_by_key(|k| level[*k]);
    steps.into_iter().map(|k| column[k]).collect()
}

/// The pattern of the upper factor of a symmetric pattern: each row's own entries, and those of the rows whose first
/// entry it is.
fn fill(order: &[u32], step: &[u32], neighbours: &[Vec<u32>]) -> Pattern {
    let n = order.len();
    let mut pattern = Pattern { starts: vec![0], columns: Vec::new() };
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); n];
    let mut mark = vec![u32::MAX; n];
    for k in 0..n as u32 {
        let start = pattern.columns.len();
        mark[k as usize] = k;
        for &c in &neighbours[order[k as usize] as usize] {
            let j = step[c as usize];
            if j > k && mark[j as usize] != k {
                mark[j as usize] = k;
                pattern.columns.push(j);
            }
        }
        for child in std::mem::take(&mut children[k as usize]) {
            for at in pattern.row(child as usize) {
                let j = pattern.columns[at];
                if mark[j as usize] != k {
                    mark[j as usize] = k;
                    pattern.columns.push(j);
                }
            }
        }
        pattern.columns[start..].sort_unstable();
        if let Some(&parent) = pattern.columns.get(start) {
            children[parent as usize].push(k);
        }
        pattern.starts.push(pattern.columns.len());
    }
    pattern
}

/// The pattern of the lower factor.
fn transpose(upper: &Pattern) -> Pattern {
    let n = upper.starts.len() - 1;
    let mut starts = vec![0usize; n + 1];
    for &j in &upper.columns {
        starts[j as usize + 1] += 1;
    }
    for k in 0..n {
        starts[k + 1] += starts[k];
    }
    let mut columns = vec![0; upper.columns.len()];
    let mut at = starts.clone();
    for i in 0..n {
        for &j in &upper.columns[upper.row(i)] {
            columns[at[j as usize]] = i as u32;
            at[j as usize] += 1;
        }
    }
    Pattern { starts, columns }
}

/// The factors of a matrix.
#[derive(Clone, Debug, Default)]
pub struct Numeric {
    lower: Vec<f64>,
    /// Rows divided by their pivots.
    upper: Vec<f64>,
    /// Of the pivots.
    inverse: Vec<f64>,
    row_scale: Vec<f64>,
    column_scale: Vec<f64>,
    work: Vec<f64>,
    right: Vec<f64>,
    growth: f64,
    /// The values that were factored last, where that went well.
    factored: Vec<f64>,
}

impl Numeric {
    /// Factors the matrix with these values, in the order of the pattern; `same` where they are known to be those of
    /// the last call.
    ///
    /// # Errors
    /// A row whose pivot is 0, not finite, or too small beside the entries below it.
    ///
    /// # Panics
    /// Where this was made by another [`Symbolic`], or there are fewer values than the pattern has places.
    pub fn factor(&mut self, symbolic: &Symbolic, values: &[f64], same: bool) -> Result<(), usize> {
        // The matrix of a linear region is the same in every step of one length.
        let values = &values[..symbolic.entries.len()];
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
        self.first(symbolic, b, true);
        let mut change = largest(&self.work);
        for _ in 0..STEPS {
            let (row, part) = self.rest(symbolic, values, b);
            if part <= 1e-15 {
                return Ok(());
            }
            self.correct(symbolic, b);
            let next = largest(&self.work);
            if part <= 1e-12 && next <= 1e-8 * change {
                return Ok(());
            }
            // Corrections that don't shrink have come down to rounding, or the matrix is singular.
            if next.is_nan() || next > 0.5 * change {
                return if part <= 1e-12 { Ok(()) } else { Err(symbolic.row[row] as usize) };
            }
            change = next;
        }
        let (row, part) = self.rest(symbolic, values, b);
        if part <= 1e-12 { Ok(()) } else { Err(symbolic.row[row] as usize) }
    }

    /// Factors the scaled matrix, with pivots raised to `floor`.
    fn eliminate(&mut self, symbolic: &Symbolic, values: &[f64], floor: f64) -> Result<(), usize> {
        self.scale(symbolic, values);
        self.growth = 0.0;
        let Self { lower, upper, inverse, row_scale, column_scale, work, growth, .. } = self;
        let work = &mut work[..symbolic.n];
        work.fill(0.0);
        for i in 0..symbolic.n {
            for &(index, k) in symbolic.entries(i) {
                work[k as usize] = values[index as usize] * row_scale[i] * column_scale[k as usize];
            }
            let own = work[i].abs();
            let range = symbolic.lower.row(i);
            for (&k, l) in symbolic.lower.columns[range.clone()].iter().zip(&mut lower[range]) {
                let k = k as usize;
                let multiplier = work[k] * inverse[k];
                work[k] = 0.0;
                *l = multiplier;
                if multiplier == 0.0 {
                    continue;
                }
                let magnitude = multiplier.abs();
                if magnitude > *growth {
                    *growth = magnitude;
                    if magnitude > 1.0 / TINY {
                        return Err(symbolic.row[k] as usize);
                    }
                }
                let row = symbolic.upper.row(k);
                for (&j, u) in symbolic.upper.columns[row.clone()].iter().zip(&upper[row]) {
                    work[j as usize] -= multiplier * u;
                }
            }
            let mut pivot = work[i];
            if pivot.abs() < floor {
                pivot = floor.copysign(pivot);
            }
            let reciprocal = 1.0 / pivot;
            if !reciprocal.is_finite() || !pivot.is_finite() || pivot.abs() < 1e-15 * own {
                return Err(symbolic.row[i] as usize);
            }
            inverse[i] = reciprocal;
            work[i] = 0.0;
            let range = symbolic.upper.row(i);
            for (&j, u) in symbolic.upper.columns[range.clone()].iter().zip(&mut upper[range]) {
                *u = work[j as usize];
                work[j as usize] = 0.0;
            }
        }
        for (i, reciprocal) in inverse.iter().enumerate() {
            upper[symbolic.upper.row(i)].iter_mut().for_each(|u| *u *= reciprocal);
        }
        Ok(())
    }

    /// Scales such that the largest entry of each row, then of each column, is near 1.
    fn scale(&mut self, symbolic: &Symbolic, values: &[f64]) {
        let largest = &mut self.work[..symbolic.n];
        largest.fill(0.0);
        for i in 0..symbolic.n {
            let entries = symbolic.entries(i);
            let row = entries.iter().fold(0.0f64, |m, &(index, _)| m.max(values[index as usize].abs()));
            let scale = inverse_scale(row);
            self.row_scale[i] = scale;
            for &(index, k) in entries {
                let size = (values[index as usize] * scale).abs();
                if size > largest[k as usize] {
                    largest[k as usize] = size;
                }
            }
        }
        for (scale, largest) in self.column_scale.iter_mut().zip(largest) {
            *scale = inverse_scale(*largest);
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
        self.first(symbolic, b, suspicious);
        if suspicious {
            self.rest(symbolic, values, b);
            self.correct(symbolic, b);
        }
    }

    /// Solves, and keeps the scaled right side where it is looked at again.
    fn first(&mut self, symbolic: &Symbolic, b: &mut [f64], again: bool) {
        for ((work, scale), &row) in self.work.iter_mut().zip(&self.row_scale).zip(&symbolic.row) {
            *work = b[row as usize] * scale;
        }
        if again {
            self.right.copy_from_slice(&self.work);
        }
        self.substitute(symbolic);
        for k in 0..symbolic.n {
            b[symbolic.column[k] as usize] = self.work[k] * self.column_scale[k];
        }
    }

    /// `work` becomes what `x` leaves of the scaled right side; returns where most is left, beside its terms, and how
    /// much.
    fn rest(&mut self, symbolic: &Symbolic, values: &[f64], x: &[f64]) -> (usize, f64) {
        let mut worst = (0, 0.0);
        for i in 0..symbolic.n {
            let mut rest = self.right[i];
            let mut size = rest.abs();
            for &(index, k) in symbolic.entries(i) {
                let term = values[index as usize] * self.row_scale[i] * x[symbolic.column[k as usize] as usize];
                rest -= term;
                size += term.abs();
            }
            self.work[i] = rest;
            let part = if size > 0.0 { rest.abs() / size } else { 0.0 };
            if part > worst.1 || part.is_nan() {
                worst = (i, if part.is_nan() { f64::INFINITY } else { part });
            }
        }
        worst
    }

    /// Adds the solution for the right side `work`.
    fn correct(&mut self, symbolic: &Symbolic, x: &mut [f64]) {
        self.substitute(symbolic);
        for k in 0..symbolic.n {
            x[symbolic.column[k] as usize] += self.work[k] * self.column_scale[k];
        }
    }

    /// `work` becomes the solution of the scaled system with right side `work`.
    fn substitute(&mut self, symbolic: &Symbolic) {
        let work = &mut self.work[..symbolic.n];
        for i in 0..symbolic.n {
            let range = symbolic.lower.row(i);
            let mut sum = work[i];
            for (&k, l) in symbolic.lower.columns[range.clone()].iter().zip(&self.lower[range]) {
                sum -= l * work[k as usize];
            }
            work[i] = sum;
        }
        for i in (0..symbolic.n).rev() {
            let range = symbolic.upper.row(i);
            let mut sum = work[i] * self.inverse[i];
            for (&j, u) in symbolic.upper.columns[range.clone()].iter().zip(&self.upper[range]) {
                sum -= u * work[j as usize];
            }
            work[i] = sum;
        }
    }
}

/// The largest magnitude; NaN where there is one.
fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |m, x| if x.abs() > m || x.is_nan() { x.abs() } else { m })
}

#[cfg(test)]
mod tests;
