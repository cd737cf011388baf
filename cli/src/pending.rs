//! Rows that wait until the run has got there.

use crate::column::Cell;
use crate::stop::Stop;
use crate::table::Table;

/// What takes rows of numbers over time: in each the instant comes first.
pub trait Sink {
    /// Takes a row.
    ///
    /// # Errors
    /// It cannot be written.
    fn row(&mut self, row: &[f64]) -> Result<(), Stop>;

    /// Ends it: its file is there now.
    ///
    /// # Errors
    /// It cannot be written.
    fn commit(self) -> Result<(), Stop>;
}

impl Sink for Table {
    fn row(&mut self, row: &[f64]) -> Result<(), Stop> {
        Table::row(self, row.iter().copied().map(Cell::Number))
    }

    fn commit(self) -> Result<(), Stop> {
        Table::commit(self)
    }
}

/// Rows on their way to a table or a picture. One within a fixed step is looked at before that step is taken, which may
/// fail earlier than the row: it waits for the end of the step.
pub struct Pending<S> {
    sink: S,
    /// Numbers in a row.
    width: usize,
    /// The rows that wait, one after the other, each with its instant first.
    rows: Vec<f64>,
}

impl<S: Sink> Pending<S> {
    /// For rows of this many numbers.
    pub fn new(sink: S, width: usize) -> Self {
        Self { sink, width, rows: Vec::new() }
    }

    /// Adds a row of a run that is sure up to an instant, s.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn row(&mut self, t: f64, values: impl IntoIterator<Item = f64>, sure: f64) -> Result<(), Stop> {
        self.rows.push(t);
        self.rows.extend(values);
        self.write(sure)
    }

    /// Ends it with the rows up to an instant, s: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(mut self, until: f64) -> Result<(), Stop> {
        self.write(until)?;
        self.sink.commit()
    }

    fn write(&mut self, until: f64) -> Result<(), Stop> {
        let sure = reached(&self.rows, self.width, until);
        for row in sure.chunks_exact(self.width) {
            self.sink.row(row)?;
        }
        let count = sure.len();
        self.rows.drain(..count);
        Ok(())
    }
}

/// The first of some rows, those up to an instant, s.
pub fn reached(rows: &[f64], width: usize, until: f64) -> &[f64] {
    let count = rows.chunks_exact(width).take_while(|row| row[0] <= until * (1.0 + 1e-12)).count();
    &rows[..count * width]
}
