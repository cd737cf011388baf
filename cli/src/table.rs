//! Tables that are written row by row: as text, or in columns.

use crate::column::{Cell, Column};
use crate::csv;
use crate::output;
#[cfg(feature = "parquet")]
use crate::parquet;
use crate::stop::Stop;
use std::path::Path;

/// A table that is being written; its format is that of its name.
pub enum Table {
    /// As text.
    Csv(csv::Table),
    /// In columns.
    #[cfg(feature = "parquet")]
    Parquet(Box<parquet::Table>),
}

impl Table {
    /// A table with these columns.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn new(path: &Path, columns: &[Column]) -> Result<Self, Stop> {
        #[cfg(feature = "parquet")]
        if extension(path).as_deref() == Some("parquet") {
            return Ok(Self::Parquet(Box::new(parquet::Table::new(path, columns)?)));
        }
        Ok(Self::Csv(csv::Table::new(path, columns)?))
    }

    /// Adds a row, a cell a column.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn row<'a>(&mut self, cells: impl IntoIterator<Item = Cell<'a>>) -> Result<(), Stop> {
        match self {
            Self::Csv(table) => table.row(cells),
            #[cfg(feature = "parquet")]
            Self::Parquet(table) => table.row(cells),
        }
    }

    /// Ends it: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(self) -> Result<(), Stop> {
        match self {
            Self::Csv(table) => table.commit(),
            #[cfg(feature = "parquet")]
            Self::Parquet(table) => table.commit(),
        }
    }
}

/// Refuses a place that cannot be written, that is a model, or whose ending names an unknown format.
///
/// # Errors
/// Status 2, with the formats that there are.
pub fn possible(path: &Path) -> Result<(), Stop> {
    output::place(path)?;
    let known = if cfg!(feature = "parquet") { "`.csv` and `.parquet`" } else { "`.csv`" };
    match extension(path).as_deref() {
        Some("parquet") if cfg!(feature = "parquet") => Ok(()),
        Some("parquet") => Err(Stop::Usage(format!(
            "{}: this build of bond writes only {known}; build it with `--features parquet`",
            path.display()
        ))),
        Some("csv") | None => Ok(()),
        // A pipe or a device may have any name.
        Some(_) if !output::whole(path)? => Ok(()),
        Some(end) => {
            Err(Stop::Usage(format!("{}: a table cannot be written as `.{end}`, only as {known}", path.display())))
        }
    }
}

fn extension(path: &Path) -> Option<String> {
    path.extension().map(|e| e.to_string_lossy().to_lowercase())
}
