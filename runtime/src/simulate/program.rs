//! Programs ready to run: a stepper with its tables, and a program that is run for its outputs.

use crate::exponential;
use crate::ir::Program;
use crate::kernel::{Backend, Failure, Kernel, Workspace};
use crate::scene::Stepper;

/// Tables for different step lengths kept at most.
const TABLES: usize = 256;

/// Whether two lengths of time differ by no more than the rounding of an instant.
pub(super) fn same_length(a: f64, b: f64, instant: f64) -> bool {
    (a - b).abs() <= (4.0 * f64::EPSILON * instant.abs()).min(1e-6 * a.abs())
}

/// The bits of a number that say which power of two it reaches.
const EXPONENT: u64 = 0x7ff0_0000_0000_0000;

/// A length of time from the instant `t` on, without the digits that are rounding of that instant: rows that lie evenly
/// leave lengths that differ by these alone. It depends on nothing that was done before, so that what is looked at
/// changes no other number.
fn rounded_length(h: f64, t: f64) -> f64 {
    let last = 4.0 * f64::EPSILON * f64::from_bits(t.to_bits() & EXPONENT);
    if last > 0.0 && last <= 1e-6 * h { (h / last).round() * last } else { h }
}

/// A stepper ready to run, with its tables by step length: they are made again where they are not there.
pub(super) struct Ready {
    kernel: Box<dyn Kernel>,
    pub(super) work: Workspace,
    linear: Option<exponential::Linear>,
    /// Tables by step length; the lengths are in order of making.
    tables: Vec<Vec<f64>>,
    lengths: Vec<f64>,
    /// The table that was taken last.
    last: usize,
}

impl Ready {
    pub(super) fn new(stepper: &Stepper, backend: &dyn Backend) -> Self {
        Self::of(&stepper.program, stepper.linear.clone(), backend)
    }

    pub(super) fn of(program: &Program, linear: Option<exponential::Linear>, backend: &dyn Backend) -> Self {
        let kernel = backend.kernel(program);
        let work = kernel.workspace();
        Self { kernel, work, linear, tables: Vec::new(), lengths: Vec::new(), last: 0 }
    }

    /// The length that is stepped by for one from the instant `t` on: a stepper with tables has one table for all that
    /// differ by rounding.
    pub(super) fn length(&self, h: f64, t: f64) -> f64 {
        if self.linear.is_some() { rounded_length(h, t) } else { h }
    }

    /// Makes the table for a step length, if the stepper needs one, and takes it from now on.
    pub(super) fn prepare(&mut self, h: f64) -> Result<(), String> {
        let Some(linear) = &self.linear else { return Ok(()) };
        if self.lengths.get(self.last) == Some(&h) {
            return Ok(());
        }
        if let Some(at) = self.lengths.iter().position(|l| *l == h) {
            self.last = at;
            return Ok(());
        }
        let table = exponential::table(linear, h).map_err(|e| e.to_string())?;
        if self.tables.len() >= TABLES {
            self.tables.clear();
            self.lengths.clear();
        }
        self.last = self.tables.len();
        self.tables.push(table);
        self.lengths.push(h);
        Ok(())
    }

    /// Runs a step of the length that was prepared last.
    pub(super) fn run(&mut self, state: &[f64], input: &[f64]) -> Result<(), Failure> {
        let table = self.tables.get(self.last).map_or(&[][..], Vec::as_slice);
        self.kernel.run(state, input, table, &mut self.work)
    }
}

/// A program that is run for its outputs.
pub(super) struct Look {
    kernel: Box<dyn Kernel>,
    pub(super) work: Workspace,
}

impl Look {
    pub(super) fn new(program: &Program, backend: &dyn Backend) -> Self {
        let kernel = backend.kernel(program);
        let work = kernel.workspace();
        Self { kernel, work }
    }

    pub(super) fn run(&mut self, state: &[f64], input: &[f64]) -> Result<&[f64], Failure> {
        self.kernel.run(state, input, &[], &mut self.work)?;
        Ok(&self.work.output)
    }
}

#[cfg(test)]
mod tests {
    use super::rounded_length;

    #[test]
    fn lengths_between_even_instants_are_one() {
        let mut lengths: Vec<f64> =
            (64..128).map(|k| f64::from(k) * 0.1).map(|t| rounded_length((t + 0.1) - t, t)).collect();
        assert!(lengths.iter().all(|h| (h - 0.1).abs() < 4e-15), "{lengths:?}");
        lengths.dedup();
        assert!(lengths.len() <= 2, "{lengths:?}");
    }

    #[test]
    fn lengths_that_are_told_apart_stay() {
        for (h, t) in [(0.1, 0.0), (1e-12, 1.0), (f64::from_bits(1), 1e300), (1.0, f64::from_bits(1))] {
            assert_eq!(rounded_length(h, t), h);
        }
    }
}
