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

/// A stepper ready to run, with its tables by step length.
pub(super) struct Ready {
    kernel: Box<dyn Kernel>,
    pub(super) work: Workspace,
    linear: Option<exponential::Linear>,
    /// Tables by step length; the lengths are in order of making.
    tables: Vec<Vec<f64>>,
    pub(super) lengths: Vec<f64>,
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

    /// A length that there is a table for, where one is the same but for the rounding of the instant `t`.
    pub(super) fn known(&self, h: f64, t: f64) -> f64 {
        self.lengths.iter().copied().find(|l| same_length(h, *l, t)).unwrap_or(h)
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
            self.forget();
        }
        self.last = self.tables.len();
        self.tables.push(table);
        self.lengths.push(h);
        Ok(())
    }

    /// Drops all tables.
    pub(super) fn forget(&mut self) {
        self.tables.clear();
        self.lengths.clear();
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
