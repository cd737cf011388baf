//! The ledger of an exchange, interval by interval: written by a thread of its own.

use crate::column::{Cell, Column, Kind};
use crate::stop::Stop;
use crate::table::{Table, possible};
use bond::exchange::{Exchange, LATE, MISSING, PORTS, SILENT};
use bond_runtime::scene::Scene;
use rtrb::{Consumer, Producer, RingBuffer};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::Duration;

/// Rows that wait to be written, at most.
const ROWS_QUEUED: usize = 8192;

/// An interval.
#[derive(Clone, Copy)]
struct Row {
    time: f64,
    status: u32,
    energy: f64,
    stored: f64,
    held: [f64; PORTS],
    place: [f64; PORTS],
}

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
    pub fn new(path: &Path, scene: &Scene) -> Result<Self, Stop> {
        let head = ["t", "missing", "late", "silent", "energy", "stored"].map(String::from).into_iter();
        let ports = scene.open.iter().flat_map(|o| [format!("{}.held", o.name), format!("{}.moved", o.name)]);
        let names: Vec<String> = head.chain(ports).collect();
        let columns: Vec<Column> = names.iter().map(|name| Column::new(name, Kind::Number)).collect();
        possible(path)?;
        let table = Table::new(path, &columns)?;
        let (rows, taken) = RingBuffer::new(ROWS_QUEUED);
        let ports = scene.open.len();
        let thread = std::thread::spawn(move || write(table, taken, ports));
        Ok(Self { rows, thread, lost: 0 })
    }

    /// Adds the interval that begins now, and what is known of the one before.
    pub fn add(&mut self, exchange: &Exchange<'_>) {
        let e = exchange.effort();
        let mut place = [0.0; PORTS];
        place.iter_mut().enumerate().take(e.ports).for_each(|(i, x)| *x = exchange.place(i));
        let row = Row { time: e.time, status: e.status, energy: exchange.energy(), stored: e.stored, held: e.v, place };
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

fn write(mut table: Table, mut rows: Consumer<Row>, ports: usize) -> Result<Table, Stop> {
    loop {
        // Asked before the last look, so that nothing is missed.
        let over = rows.is_abandoned();
        while let Ok(r) = rows.pop() {
            let flag = |bit: u32| f64::from(u8::from(r.status & bit != 0));
            let head = [r.time, flag(MISSING), flag(LATE), flag(SILENT), r.energy, r.stored];
            let both = (0..ports).flat_map(|i| [r.held[i], r.place[i]]);
            table.row(head.into_iter().chain(both).map(Cell::Number))?;
        }
        if over {
            return Ok(table);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
