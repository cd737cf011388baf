//! Richardson's extrapolation of runs with fixed steps, each half as long as the last.

use super::trial::Run;

/// Runs with steps h, h/2, h/4, ... of a method, and the columns that extrapolation makes of them.
pub struct Tableau {
    /// Order of the first error, and how far apart the orders of those that follow are.
    order: u32,
    apart: u32,
    /// The last row.
    row: Vec<Run>,
}

impl Tableau {
    /// Of a method of this order, whose error has the powers `order`, `order + apart`, ... of the step.
    pub fn new(order: u32, apart: u32) -> Self {
        Self { order, apart, row: Vec::new() }
    }

    /// Takes the next run. Gives for each column that the last row had the values then and now.
    pub fn push(&mut self, run: Run) -> Vec<(Run, Run)> {
        let mut row = vec![run];
        for (k, before) in self.row.iter().enumerate() {
            let power = f64::from(self.order + self.apart * k as u32).exp2();
            row.push(weighed(&row[k], before, 1.0 / (power - 1.0)));
        }
        let last = std::mem::replace(&mut self.row, row);
        last.into_iter().zip(self.row.iter().cloned()).collect()
    }
}

/// `a + w (a - b)` of all values.
fn weighed(a: &Run, b: &Run, w: f64) -> Run {
    let mut run = a.clone();
    let add = |x: &mut Vec<f64>, y: &[f64]| x.iter_mut().zip(y).for_each(|(x, y)| *x += w * (*x - y));
    add(&mut run.end, &b.end);
    for (x, y) in run.rows.iter_mut().zip(&b.rows) {
        add(x, y);
    }
    run
}
