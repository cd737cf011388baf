//! A file in memory that both ends read and write: the environment writes its effort at the start, the device its
//! measurement from [`PLACE`] on. The device may map it; the environment reads and writes it in single calls. A packet
//! that is half old and half new fails its checksum, and is looked at again.

use super::arrival::Arrival;
use crate::stop::Stop;
use bond::exchange::{Effort, LONGEST, Measurement, measurement_length};
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

/// Where measurements are, bytes.
pub const PLACE: u64 = 4096;
/// How often a packet that fails its checksum is looked at again.
const READ_ATTEMPTS: usize = 3;

/// The file.
pub struct Shared {
    file: File,
    path: PathBuf,
    last: (u64, u64),
    ports: usize,
    buffer: [u8; LONGEST],
}

impl Shared {
    /// Makes the file. A name without `/` is one in `/dev/shm`, or where that is not, in the folder for temporary
    /// files.
    ///
    /// # Errors
    /// It is there already, or cannot be made.
    pub fn new(name: &str, ports: usize) -> Result<Self, Stop> {
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
        let path = if name.contains('/') { PathBuf::from(name) } else { folder.join(name) };
        let failed = |e: io::Error| {
            let fix = match e.kind() {
                io::ErrorKind::AlreadyExists => {
                    "; another environment uses it, or one was killed: remove it or take another name"
                }
                io::ErrorKind::NotFound => "; create its folder first, or give a name without `/`",
                _ => "",
            };
            Stop::Usage(format!("cannot make {}: {e}{fix}", path.display()))
        };
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true);
        // For this user alone: whoever can write it can speak as the device.
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let file = options.open(&path).map_err(failed)?;
        file.set_len(2 * PLACE).map_err(failed)?;
        Ok(Self { file, path, last: (0, 0), ports, buffer: [0; LONGEST] })
    }

    /// Writes what is held.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn send(&mut self, effort: &Effort) -> Result<(), Stop> {
        let n = effort.write(&mut self.buffer);
        write_at(&self.file, &self.buffer[..n], 0)
            .map_err(|e| Stop::Usage(format!("cannot write {}: {e}", self.path.display())))
    }

    /// The measurement that is there, if it is another one than before.
    pub fn receive(&mut self) -> Option<Arrival> {
        let n = measurement_length(self.ports);
        for _ in 0..READ_ATTEMPTS {
            read_at(&self.file, &mut self.buffer[..n], PLACE).ok()?;
            if let Some(m) = Measurement::read(&self.buffer[..n]) {
                let this = (m.session, m.sequence);
                return (this != std::mem::replace(&mut self.last, this)).then(|| Arrival::now(m));
            }
        }
        None
    }

    /// Where it is.
    pub fn name(&self) -> String {
        format!("file {}", self.path.display())
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(not(unix))]
fn write_at(mut file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    use std::io::{Seek, Write};
    file.seek(io::SeekFrom::Start(at))?;
    file.write_all(bytes)
}

#[cfg(not(unix))]
fn read_at(mut file: &File, bytes: &mut [u8], at: u64) -> io::Result<()> {
    use std::io::{Read, Seek};
    file.seek(io::SeekFrom::Start(at))?;
    file.read_exact(bytes)
}
