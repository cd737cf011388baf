//! What laws switch on, at an instant.
//!
//! Some laws switch on what only a step tells: the speed that a curve of dry friction receives, or the current of a
//! diode. The step has solved its equations on one branch of the law, in the mean over its length. Where that branch
//! leads at the step's end is what one step of Newton's method from there says, by the slopes of that branch: 0 where
//! the law must switch, even though beyond there need be no solution on either branch, as of a current that has no way
//! back through a diode. What the end does not tell, as the force that holds a body at rest, a very short step from
//! there does.

use super::program::Look;
use crate::kernel::{Backend, Failure};
use crate::scene::Guards;

/// The guards of a cluster.
pub(super) struct Watch {
    look: Look,
    count: usize,
    loops: usize,
    times: Vec<usize>,
    /// Those that time alone tells, somewhat later.
    later: Vec<f64>,
    /// Residuals and matrix, row by row with the residual at the end.
    rows: Vec<f64>,
    /// By row: its pivot's column, where it has one.
    pivots: Vec<Option<usize>>,
    /// By column: its largest entry.
    largest: Vec<f64>,
    values: Vec<f64>,
    min_pivot: f64,
}

impl Watch {
    pub(super) fn new(guards: &Guards, min_pivot: f64, backend: &dyn Backend) -> Self {
        let m = guards.loops;
        Self {
            look: Look::new(&guards.program, backend),
            count: guards.count,
            loops: m,
            times: guards.times.clone(),
            later: vec![0.0; guards.times.len()],
            rows: vec![0.0; m * (m + 1)],
            pivots: vec![None; m],
            largest: vec![0.0; m],
            values: vec![0.0; guards.count],
            min_pivot,
        }
    }

    /// The guards where they were looked at last.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Whether unknowns of loops move a guard, and not the state alone, where it was looked at last.
    pub(super) fn is_loop(&self, guard: usize) -> bool {
        let (n, m) = (self.count, self.loops);
        let slopes = self.look.work.output[n + m + m * m..].chunks_exact(m.max(1)).nth(guard);
        slopes.is_some_and(|slopes| slopes.iter().any(|x| *x != 0.0))
    }

    /// Looks at the guards: whether there is something that the state does not tell, and whether one that time alone
    /// tells switches within so long a time.
    pub(super) fn run(&mut self, state: &[f64], input: &mut [f64], ahead: f64) -> Result<(bool, bool), Failure> {
        let known = ahead > 0.0 && self.loops > 0 && !self.times.is_empty();
        if known {
            let t = input[0];
            input[0] = t + ahead;
            let out = self.look.run(state, input);
            input[0] = t;
            let out = out?;
            self.later.iter_mut().zip(&self.times).for_each(|(x, k)| *x = out[*k]);
        }
        let (n, m) = (self.count, self.loops);
        let out = self.look.run(state, input)?;
        self.values.copy_from_slice(&out[..n]);
        if m > 0 {
            let (residual, matrix) = out[n..].split_at(m);
            for ((row, r), slopes) in self.rows.chunks_exact_mut(m + 1).zip(residual).zip(matrix.chunks_exact(m)) {
                row[..m].copy_from_slice(slopes);
                row[m] = -r;
            }
            eliminate((m, self.min_pivot), &mut self.rows, &mut self.pivots, &mut self.largest);
            let slopes = &self.look.work.output[n + m + m * m..];
            for (value, slopes) in self.values.iter_mut().zip(slopes.chunks_exact(m)) {
                let moves = self.pivots.iter().zip(self.rows.chunks_exact(m + 1));
                let ahead: f64 = moves.filter_map(|(p, row)| Some(slopes[(*p)?] * row[m])).sum();
                if ahead.is_finite() {
                    *value += ahead;
                }
            }
        }
        let switches =
            |(x, k): (&f64, &usize)| (*x > 0.0 && self.values[*k] < 0.0) || (*x < 0.0 && self.values[*k] > 0.0);
        let passed = known && self.later.iter().zip(&self.times).any(switches);
        Ok((self.pivots.contains(&None), passed))
    }

    /// Has what the state does not tell from a short step, which found these unknowns where the step before found
    /// those; not where that one went beyond the switch, seen from the guards at its `start`.
    pub(super) fn told(&mut self, found: &[f64], before: &[f64], start: Option<&[f64]>) {
        let (n, m) = (self.count, self.loops);
        let slopes = &self.look.work.output[n + m + m * m..];
        for (i, (value, slopes)) in self.values.iter_mut().zip(slopes.chunks_exact(m.max(1))).enumerate() {
            if start.is_some_and(|start| *value * start[i] < 0.0) {
                continue;
            }
            let open = (0..m).filter(|k| !self.pivots.contains(&Some(*k)));
            let moved: f64 = open.map(|k| slopes[k] * (found[k] - before[k])).sum();
            if moved.is_finite() {
                *value += moved;
            }
        }
    }
}

/// Gauss and Jordan's elimination with complete pivoting of scaled rows, each with its right side at its end; rows and
/// columns that are left without a pivot have no part in the solution, which stands in the place of the right sides.
fn eliminate((m, min_pivot): (usize, f64), rows: &mut [f64], pivots: &mut [Option<usize>], largest: &mut [f64]) {
    pivots.fill(None);
    largest.fill(0.0);
    for row in rows.chunks_exact_mut(m + 1) {
        let size = row[..m].iter().fold(0.0f64, |a, x| a.max(x.abs()));
        if size > 0.0 && size.is_finite() {
            row.iter_mut().for_each(|x| *x /= size);
        } else {
            row.fill(0.0);
        }
        largest.iter_mut().zip(&*row).for_each(|(a, x)| *a = a.max(x.abs()));
    }
    for _ in 0..m {
        let mut best = (min_pivot, 0, 0);
        for (i, row) in rows.chunks_exact(m + 1).enumerate().filter(|(i, _)| pivots[*i].is_none()) {
            for (k, (x, size)) in row[..m].iter().zip(&*largest).enumerate() {
                let part = if *size > 0.0 { x.abs() / size } else { 0.0 };
                if part > best.0 && !pivots.contains(&Some(k)) {
                    best = (part, i, k);
                }
            }
        }
        let (part, i, k) = best;
        if part <= min_pivot {
            break;
        }
        pivots[i] = Some(k);
        let pivot = rows[i * (m + 1) + k];
        rows[i * (m + 1)..][..=m].iter_mut().for_each(|x| *x /= pivot);
        for j in (0..m).filter(|j| *j != i) {
            let factor = rows[j * (m + 1) + k];
            for c in 0..=m {
                rows[j * (m + 1) + c] -= factor * rows[i * (m + 1) + c];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::eliminate;

    #[test]
    fn what_has_no_pivot_stays() {
        // x + y = 3, 0 = 1, 1e9 y = 2e9, and an unknown that is in none of them.
        let mut rows = vec![1.0, 1.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1e9, 0.0, 2e9];
        let (mut pivots, mut largest) = (vec![None; 3], vec![0.0; 3]);
        eliminate((3, 1e-9), &mut rows, &mut pivots, &mut largest);
        let mut found = vec![0.0; 3];
        for (p, row) in pivots.iter().zip(rows.chunks_exact(4)) {
            if let Some(k) = p {
                found[*k] = row[3];
            }
        }
        assert_eq!((pivots[1], found), (None, vec![1.0, 2.0, 0.0]));
    }
}
