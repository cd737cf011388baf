//! The table of an ensemble and its statistics: chunks put on it in their order.

use super::chunks::Chunks;
use super::job::Job;
use super::outcome::Outcome;
use super::statistics::Statistics;
use crate::column::{Cell, Column, Kind, distinct};
use crate::stop::Stop;
use crate::table::Table;
use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

/// Columns that every table has, whatever the model.
const INSTANCE: &str = "instance";
const OVER_TIME: [&str; 2] = [INSTANCE, "t"];
const AT_THE_END: [&str; 4] = [INSTANCE, "passive", "worst_balance", "status"];

/// What is made of the instances.
pub struct Sheet {
    job: Arc<Job>,
    chunks: Chunks,
    table: Option<Table>,
    /// Their statistics.
    pub statistics: Statistics,
}

impl Sheet {
    /// A sheet, with a table where a place is named.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn new(job: &Arc<Job>, chunks: Chunks, path: Option<&Path>) -> Result<Self, Stop> {
        let table = path.map(|path| Table::new(path, &columns(job))).transpose()?;
        Ok(Self { job: job.clone(), chunks, table, statistics: Statistics::new(job.probes.len()) })
    }

    /// Puts the next chunk on it.
    ///
    /// # Errors
    /// The table cannot be written, or the bytes are not those of the chunk.
    pub fn put(&mut self, chunk: u64, mut bytes: &[u8]) -> Result<(), Stop> {
        for instance in self.chunks.instances(chunk) {
            let Some(outcome) = Outcome::decode(&mut bytes, self.job.probes.len()) else {
                return Err(Stop::Usage(format!("instance {instance} cannot be read back; give --restart")));
            };
            self.row(instance, &outcome)?;
            self.statistics.add(instance, outcome);
        }
        Ok(())
    }

    fn row(&mut self, instance: u64, o: &Outcome) -> Result<(), Stop> {
        let Some(table) = &mut self.table else { return Ok(()) };
        let varied = self.job.plan.values(instance);
        let head = std::iter::once(Cell::Whole(instance)).chain(varied.iter().map(|(x, _)| Cell::Number(*x)));
        if self.job.over_time {
            for row in o.rows.chunks_exact(1 + self.job.probes.len()) {
                table.row(head.clone().chain(row.iter().map(|x| Cell::Number(*x))))?;
            }
            return Ok(());
        }
        let tail = [
            Cell::Whole(u64::from(o.passive)),
            Cell::Number(o.worst),
            Cell::Text(o.failure.as_deref().unwrap_or_default()),
        ];
        table.row(head.chain(o.last.iter().map(|x| Cell::Number(*x))).chain(tail))
    }

    /// Ends the table: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(self) -> Result<Statistics, Stop> {
        if let Some(table) = self.table {
            table.commit()?;
        }
        Ok(self.statistics)
    }
}

/// Instance, parameters and probes; between them the time, or after them how it went. Where a parameter or a probe has
/// the name of one of the others, it gets a `_` more.
fn columns(job: &Job) -> Vec<Column> {
    let fixed: &[&str] = if job.over_time { &OVER_TIME } else { &AT_THE_END };
    let mut taken: HashSet<String> = fixed.iter().map(|name| (*name).to_string()).collect();
    let mut free = |name: &str| distinct(&mut taken, name);
    let mut list = vec![Column::new(INSTANCE, Kind::Whole)];
    list.extend(job.plan.paths().map(|p| Column::new(free(p), Kind::Repeated)));
    if job.over_time {
        list.push(Column::new("t", Kind::Number));
    }
    list.extend(job.probes.iter().map(|p| Column::new(free(p), Kind::Number)));
    if !job.over_time {
        list.push(Column::new("passive", Kind::Whole));
        list.push(Column::new("worst_balance", Kind::Number));
        list.push(Column::new("status", Kind::Text));
    }
    list
}
