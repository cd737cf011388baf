//! Tables as text.

use crate::column::{Cell, Column};
use crate::output::Sink;
use crate::stop::Stop;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// A table that is being written, row by row.
pub struct Table {
    sink: Sink,
    line: String,
}

impl Table {
    /// A table with a header.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn new(path: &Path, columns: &[Column]) -> Result<Self, Stop> {
        let mut table = Self { sink: Sink::open(path)?, line: String::new() };
        for (i, column) in columns.iter().enumerate() {
            if i > 0 {
                table.line.push(',');
            }
            table.line.push_str(&quoted(&column.name));
        }
        table.end()?;
        Ok(table)
    }

    /// Adds a row.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn row<'a>(&mut self, cells: impl IntoIterator<Item = Cell<'a>>) -> Result<(), Stop> {
        for (i, cell) in cells.into_iter().enumerate() {
            if i > 0 {
                self.line.push(',');
            }
            match cell {
                Cell::Number(x) => number(&mut self.line, x),
                // Writing to a string cannot fail.
                Cell::Whole(n) => drop(write!(self.line, "{n}")),
                Cell::Text(text) => self.line.push_str(&quoted(text)),
            }
        }
        self.end()
    }

    fn end(&mut self) -> Result<(), Stop> {
        self.line.push('\n');
        let result = self.sink.write_all(self.line.as_bytes());
        self.line.clear();
        result.map_err(|e| self.sink.failure(&e))
    }

    /// Ends it: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(self) -> Result<(), Stop> {
        self.sink.commit()
    }
}

/// A name as a field.
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_string() }
}

/// A number with the fewest digits that read back to the same double.
fn number(line: &mut String, x: f64) {
    let size = x.abs();
    let text = if x.is_nan() {
        "nan".to_string()
    } else if x == 0.0 || (1e-5..1e16).contains(&size) || size.is_infinite() {
        format!("{x}")
    } else {
        format!("{x:e}")
    };
    line.push_str(&text);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back() {
        for x in [
            0.0,
            -0.0,
            1.0,
            0.1,
            1e-5,
            9.99e-6,
            1e16,
            123456789.125,
            1e300,
            5e-324,
            f64::MAX,
            -1.0 / 3.0,
            f64::INFINITY,
        ] {
            let mut line = String::new();
            number(&mut line, x);
            assert_eq!(line.parse::<f64>().map(f64::to_bits), Ok(x.to_bits()), "{line}");
            assert!(line.len() < 26, "{line}");
        }
    }

    #[test]
    fn names_with_commas() {
        assert_eq!(quoted("x[1,2]"), "\"x[1,2]\"");
        assert_eq!(quoted("x"), "x");
    }
}
