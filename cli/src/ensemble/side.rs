//! The side file of an ensemble, `FILE.part`: what is done so far, so that a run that was cut off can be gone on with.
//!
//! ```text
//! bond part 1\n
//! length of the fingerprint (8 bytes), its hash (8), the fingerprint
//! for each chunk as it is done: its number (8), length (8), hash of both and of what follows (8), its bytes
//! ```
//!
//! All numbers have the lowest byte first. Chunks are only ever added at the end. What a kill has left of the last one
//! has not the length or the hash that it should have, and is cut off.

use super::chunks::{Chunks, weight};
use super::collect::Collect;
use super::fingerprint::Fingerprint;
use super::sheet::Sheet;
use crate::hash::Hash;
use crate::output::unwritable;
use crate::stop::Stop;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8] = b"bond part 1\n";
/// A fingerprint is a few lines.
const LONGEST: u64 = 64 << 20;
/// Before the bytes of a chunk.
const HEAD: u64 = 24;

/// An open side file, locked against other writers.
pub struct Side {
    file: File,
    path: PathBuf,
    /// Place and number of the bytes of each chunk; 0 bytes if it is missing.
    places: Vec<(u64, u64)>,
    /// Where the next chunk goes.
    end: u64,
    /// Chunks that are not written yet.
    fresh: Vec<u8>,
}

impl Side {
    /// Opens the side file of a table, and takes over what is in it, or begins one.
    ///
    /// # Errors
    /// Status 2: one that cannot be written, that another process writes, that is none, or that belongs to another
    /// ensemble.
    pub fn open(table: &Path, print: &Fingerprint, chunks: Chunks, restart: bool) -> Result<Self, Stop> {
        let path = beside(table);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|e| unwritable(&path, &e))?;
        // Where files cannot be locked, the user takes care.
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(Stop::Usage(format!("{} is being written by another run", path.display())));
        }
        let mut side = Self { file, path, places: vec![(0, 0); chunks.count() as usize], end: 0, fresh: Vec::new() };
        let result = side.take_over(print, restart);
        result.map_err(|e| side.failure(&e))??;
        Ok(side)
    }

    /// Reads the chunks that are there.
    fn take_over(&mut self, print: &Fingerprint, restart: bool) -> io::Result<Result<(), Stop>> {
        let length = self.file.metadata()?.len();
        let head = head(print);
        if length > 0 {
            let mut file = BufReader::new(&self.file);
            let mut magic = Vec::new();
            (&mut file).take(MAGIC.len() as u64).read_to_end(&mut magic)?;
            if !MAGIC.starts_with(&magic) {
                let what = "exists already, and is not a side file of an ensemble; move it away";
                return Ok(Err(Stop::Usage(format!("{} {what}", self.path.display()))));
            }
            if !restart && let Some((older, at)) = fingerprint(&mut file)? {
                let differs = print.against(&older);
                if !differs.is_empty() {
                    return Ok(Err(Stop::Usage(format!(
                        "{} has instances of another ensemble: {differs}. Give --restart to start again, or write to \
                        another file",
                        self.path.display()
                    ))));
                }
                self.end = at;
                while let Some((chunk, n)) = record(&mut file, length - self.end)? {
                    let Some(place) = self.places.get_mut(chunk as usize).filter(|p| p.1 == 0) else { break };
                    *place = (self.end + HEAD, n);
                    self.end += HEAD + n;
                }
            }
        }
        if self.end == 0 {
            self.file.set_len(0)?;
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(&head)?;
            self.end = head.len() as u64;
        }
        self.file.set_len(self.end)?;
        self.file.seek(SeekFrom::Start(self.end))?;
        Ok(Ok(()))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts all chunks on a sheet, in order.
    ///
    /// # Errors
    /// They cannot be read, or the sheet cannot be written.
    pub fn copy(&mut self, sheet: &mut Sheet) -> Result<(), Stop> {
        let mut bytes = Vec::new();
        for (chunk, &(at, n)) in self.places.iter().enumerate() {
            bytes.resize(n as usize, 0);
            let read = self.file.seek(SeekFrom::Start(at)).and_then(|_| self.file.read_exact(&mut bytes));
            read.map_err(|e| self.failure(&e))?;
            sheet.put(chunk as u64, &bytes)?;
        }
        Ok(())
    }

    /// Removes it: the table is there.
    ///
    /// # Errors
    /// It cannot be removed.
    pub fn remove(self) -> Result<(), Stop> {
        let Self { file, path, .. } = self;
        drop(file);
        std::fs::remove_file(&path).map_err(|e| Stop::Usage(format!("cannot remove {}: {e}", path.display())))
    }

    fn failure(&self, e: &io::Error) -> Stop {
        unwritable(&self.path, e)
    }
}

impl Collect for Side {
    fn has(&self, chunk: u64) -> bool {
        self.places.get(chunk as usize).is_some_and(|p| p.1 > 0)
    }

    fn take(&mut self, chunk: u64, bytes: Vec<u8>) -> Result<usize, Stop> {
        if let Some(place) = self.places.get_mut(chunk as usize) {
            *place = (self.end + HEAD, bytes.len() as u64);
        }
        self.end += HEAD + bytes.len() as u64;
        let numbers = [chunk, bytes.len() as u64].map(u64::to_le_bytes);
        let mut hash = Hash::new();
        for part in [&numbers[0][..], &numbers[1], &bytes] {
            hash.add(part);
        }
        for part in [&numbers[0][..], &numbers[1], &hash.value().to_le_bytes(), &bytes] {
            self.fresh.extend(part);
        }
        if self.fresh.len() > 1 << 20 {
            self.pause()?;
        }
        Ok(weight(&bytes))
    }

    fn pause(&mut self) -> Result<(), Stop> {
        let result = self.file.write_all(&self.fresh);
        self.fresh.clear();
        result.map_err(|e| self.failure(&e))
    }
}

/// `FILE.part`.
pub fn beside(table: &Path) -> PathBuf {
    let mut name = table.as_os_str().to_os_string();
    name.push(".part");
    PathBuf::from(name)
}

fn head(print: &Fingerprint) -> Vec<u8> {
    let text = print.text().as_bytes();
    let mut head = MAGIC.to_vec();
    head.extend((text.len() as u64).to_le_bytes());
    head.extend(Hash::of(text).to_le_bytes());
    head.extend(text);
    head
}

/// The fingerprint after the first line, and where it ends; None if it was cut off.
fn fingerprint(file: &mut impl Read) -> io::Result<Option<(Fingerprint, u64)>> {
    let Some([length, hash]) = numbers(file)? else { return Ok(None) };
    let mut bytes = Vec::new();
    file.take(length.min(LONGEST)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != length || Hash::of(&bytes) != hash {
        return Ok(None);
    }
    let end = MAGIC.len() as u64 + 16 + length;
    Ok(String::from_utf8(bytes).ok().map(|text| (Fingerprint::read(text), end)))
}

/// Number and length of the next chunk, which is skipped; None if it is not whole.
fn record(file: &mut impl Read, left: u64) -> io::Result<Option<(u64, u64)>> {
    let Some([chunk, length, expected]) = numbers(file)? else { return Ok(None) };
    if length == 0 || left.checked_sub(HEAD).is_none_or(|left| length > left) {
        return Ok(None);
    }
    let mut hash = Hash::new();
    hash.add(&chunk.to_le_bytes());
    hash.add(&length.to_le_bytes());
    let mut part = [0; 1 << 13];
    let mut rest = length;
    while rest > 0 {
        let n = file.read(&mut part[..rest.min(1 << 13) as usize])?;
        if n == 0 {
            return Ok(None);
        }
        hash.add(&part[..n]);
        rest -= n as u64;
    }
    Ok((hash.value() == expected).then_some((chunk, length)))
}

fn numbers<const N: usize>(file: &mut impl Read) -> io::Result<Option<[u64; N]>> {
    let mut list = [0; N];
    for x in &mut list {
        let mut bytes = [0; 8];
        match file.read_exact(&mut bytes) {
            Ok(()) => *x = u64::from_le_bytes(bytes),
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
            Err(e) => return Err(e),
        }
    }
    Ok(Some(list))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A side file of five chunks, of which chunks 3, 0 and 4 are done, cut off or changed at every byte.
    #[test]
    fn torn_files_keep_their_whole_chunks() {
        let folder = std::env::temp_dir().join(format!("bond-side-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let table = folder.join("a.csv");
        let (print, chunks) = (Fingerprint::read("a: 1\n".into()), Chunks::new(5));
        let list = [(3, vec![7u8; 40]), (0, vec![1, 2, 3]), (4, vec![9; 10])];
        let mut side = Side::open(&table, &print, chunks, false).unwrap();
        let mut ends = vec![side.end];
        for (chunk, bytes) in &list {
            side.take(*chunk, bytes.clone()).unwrap();
            ends.push(side.end);
        }
        side.pause().unwrap();
        drop(side);
        let whole = std::fs::read(beside(&table)).unwrap();
        assert_eq!(whole.len() as u64, ends[3]);
        let check = |bytes: &[u8], wanted: usize| {
            std::fs::write(beside(&table), bytes).unwrap();
            let mut side = Side::open(&table, &print, chunks, false).unwrap();
            let found: Vec<u64> = (0..5).filter(|c| side.has(*c)).collect();
            let mut right: Vec<u64> = list[..wanted].iter().map(|l| l.0).collect();
            right.sort_unstable();
            assert_eq!(found, right, "{} bytes", bytes.len());
            assert_eq!(side.file.metadata().unwrap().len(), ends[wanted]);
            side.take(1, vec![5]).unwrap();
            side.pause().unwrap();
            drop(side);
            let again = Side::open(&table, &print, chunks, false).unwrap();
            assert!(again.has(1) && (0..5).filter(|c| again.has(*c)).count() == wanted + 1);
        };
        for n in 0..=whole.len() {
            check(&whole[..n], ends.iter().skip(1).filter(|e| **e <= n as u64).count());
        }
        for n in ends[0] as usize..whole.len() {
            let mut bytes = whole.clone();
            bytes[n] ^= 0x40;
            check(&bytes, ends.iter().skip(1).filter(|e| **e <= n as u64).count());
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
