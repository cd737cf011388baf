//! The ledger of an exchange, interval by interval: written by a thread of its own.

use super::Meeting;
use crate::column::{Cell, Column, Kind};
use crate::stop::Stop;
use crate::table::{Table, possible};
use bond::exchange::PORTS;
use rtrb::{Consumer, Producer, RingBuffer};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::Duration;

/// Rows that wait to be written, at most.
const ROWS_QUEUED: usize = 8192;

/// An interval.
#[derive(Clone, Copy)]
pub struct Row {
    /// What is known of the interval and the line.
    pub head: [f64; 6],
    /// How many ports.
    pub count: usize,
    /// Two numbers of each port.
    pub ports: [[f64; 2]; PORTS],
}

/// The names of the columns.
pub struct Names {
    /// Those of [`Row::head`].
    pub head: [&'static str; 6],
    /// What follows a port's name in those of [`Row::ports`].
    pub of_port: [&'static str; 2],
}

/// Those of an exchange with a device.
pub const OF_DEVICE: Names =
    Names { head: ["t", "missing", "late", "silent", "energy", "stored"], of_port: ["held", "moved"] };
/// Those of an exchange of waves.
pub const OF_WAVES: Names =
    Names { head: ["t", "missing", "waiting", "sent", "received", "lost"], of_port: ["out", "in"] };

/// The table, as the loop sees it.
pub struct Log {
    rows: Producer<Row>,
    thread: JoinHandle<Result<Table, Stop>>,
    lost: u64,
}

impl Log {
    /// Begins a table.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn new(path: &Path, of: &Names, ports: &[&str]) -> Result<Self, Stop> {
        let head = of.head.map(String::from).into_iter();
        let ports = ports.iter().flat_map(|port| of.of_port.map(|what| format!("{port}.{what}")));
        let names: Vec<String> = head.chain(ports).collect();
        let columns: Vec<Column> = names.iter().map(|name| Column::new(name, Kind::Number)).collect();
        possible(path)?;
        let table = Table::new(path, &columns)?;
        let (rows, taken) = RingBuffer::new(ROWS_QUEUED);
        let thread = std::thread::spawn(move || write(table, taken));
        Ok(Self { rows, thread, lost: 0 })
    }

    /// Adds the interval that begins now, and what is known of the one before.
    pub fn add(&mut self, with: &dyn Meeting) {
        let mut row = Row { head: [0.0; 6], count: 0, ports: [[0.0; 2]; PORTS] };
        with.row(&mut row);
        self.lost += u64::from(self.rows.push(row).is_err());
    }

    /// Ends the table: the file is there now. How many rows were lost because the disk was too slow.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn end(self) -> Result<u64, Stop> {
        let Self { rows, thread, lost } = self;
        drop(rows);
        match thread.join() {
            Ok(table) => table?.commit()?,
            Err(_) => return Err(Stop::Usage("the ledger could not be written".into())),
        }
        Ok(lost)
    }
}

fn write(mut table: Table, mut rows: Consumer<Row>) -> Result<Table, Stop> {
    loop {
        // Asked before the last look, so that nothing is missed.
        let over = rows.is_abandoned();
        while let Ok(r) = rows.pop() {
            let ports = r.ports.into_iter().take(r.count).flatten();
            table.row(r.head.into_iter().chain(ports).map(Cell::Number))?;
        }
        if over {
            return Ok(table);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
