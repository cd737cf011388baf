//! Where chunks that are done go while others still run.

use super::chunks::weight;
use super::sheet::Sheet;
use crate::stop::Stop;
use std::collections::BTreeMap;

/// Takes chunks as they come, in any order.
pub trait Collect {
    /// Whether a chunk is there already.
    fn has(&self, chunk: u64) -> bool;

    /// Takes a chunk, and gives the weight of what need not be kept in memory any longer.
    ///
    /// # Errors
    /// It cannot be written.
    fn take(&mut self, chunk: u64, bytes: Vec<u8>) -> Result<usize, Stop>;

    /// Nothing else has come just now.
    ///
    /// # Errors
    /// What has come cannot be written.
    fn pause(&mut self) -> Result<(), Stop>;
}

/// Puts chunks on a sheet at once, those that come before their turn when it comes.
pub struct InOrder<'a> {
    sheet: &'a mut Sheet,
    next: u64,
    early: BTreeMap<u64, Vec<u8>>,
}

impl<'a> InOrder<'a> {
    /// None so far.
    pub fn new(sheet: &'a mut Sheet) -> Self {
        Self { sheet, next: 0, early: BTreeMap::new() }
    }
}

impl Collect for InOrder<'_> {
    fn has(&self, _: u64) -> bool {
        false
    }

    fn take(&mut self, chunk: u64, bytes: Vec<u8>) -> Result<usize, Stop> {
        self.early.insert(chunk, bytes);
        let mut free = 0;
        while let Some(bytes) = self.early.remove(&self.next) {
            self.sheet.put(self.next, &bytes)?;
            self.next += 1;
            free += weight(&bytes);
        }
        Ok(free)
    }

    fn pause(&mut self) -> Result<(), Stop> {
        Ok(())
    }
}
