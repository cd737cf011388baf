//! Where results go: standard output, or files that are written whole or not at all.

use crate::stop::Stop;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Stdout, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Files that are being written beside those that they are to be.
static BESIDE: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Most links that are followed one after the other, as systems do.
const LINKS_FOLLOWED: usize = 40;

/// Most bytes of a file's name in the name of its temporary file.
const NAME_BYTES: usize = 200;

/// Removes what is being written: the program ends at once.
pub fn abandon() {
    for path in BESIDE.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        let _ = fs::remove_file(path);
    }
}

/// Writes a text to standard output.
///
/// # Errors
/// Nobody reads it, or it cannot be written.
pub fn print(text: &str) -> Result<(), Stop> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}

/// Writes a text to a file, or to standard output where the path is `-` or absent.
///
/// # Errors
/// A file that cannot be written.
pub fn put(path: Option<&Path>, text: &str) -> Result<(), Stop> {
    match path {
        None => print(text),
        Some(path) => {
            let mut sink = Sink::open(path)?;
            sink.write_all(text.as_bytes()).map_err(|e| sink.failure(&e))?;
            sink.commit()
        }
    }
}

/// Writes bytes to a file.
///
/// # Errors
/// A file that cannot be written.
pub fn put_bytes(path: &Path, bytes: &[u8]) -> Result<(), Stop> {
    let mut sink = Sink::open(path)?;
    sink.write_all(bytes).map_err(|e| sink.failure(&e))?;
    sink.commit()
}

/// Writes a text to standard output. A closed pipe is not an error: the rest of the work goes on.
///
/// # Errors
/// It cannot be written.
pub fn offer(text: &str) -> Result<(), Stop> {
    match print(text) {
        Err(Stop::Pipe) => Ok(()),
        other => other,
    }
}

/// Writes two files, or none of them.
///
/// # Errors
/// One that cannot be written.
pub fn put_both(one: (&Path, &[u8]), two: (&Path, &[u8])) -> Result<(), Stop> {
    let open = |(path, bytes): (&Path, &[u8])| {
        let mut sink = Sink::open(path)?;
        sink.write_all(bytes).map_err(|e| sink.failure(&e))?;
        Ok::<Sink, Stop>(sink)
    };
    let mut both = [open(one)?, open(two)?];
    for sink in &mut both {
        sink.flush().map_err(|e| sink.failure(&e))?;
    }
    both.into_iter().try_for_each(Sink::commit)
}

/// Whether a path is that of a file, there or to be made, and not of standard output, a pipe or a device. What cannot
/// be written is told before any work is done for it.
///
/// # Errors
/// A path that no file can have, a folder in which none can be made.
pub fn whole(path: &Path) -> Result<bool, Stop> {
    if path == Path::new("-") {
        return Ok(false);
    }
    match fs::metadata(path) {
        Ok(m) if m.is_dir() => Err(directory(path)),
        Ok(m) if !m.is_file() => Ok(false),
        Ok(_) | Err(_) => Whole::new(path).map(|_| true),
    }
}

/// A place of a result, before any work is done for it: one that can be written, and no model.
///
/// # Errors
/// Status 2.
pub fn place(path: &Path) -> Result<(), Stop> {
    no_model(path)?;
    whole(path).map(|_| ())
}

/// Refuses to write over what is read: each of these is a path, and what it is.
///
/// # Errors
/// Status 2.
pub fn not_over(path: &Path, read: &[(&Path, &str)]) -> Result<(), Stop> {
    match read.iter().find(|(other, _)| same(path, other)) {
        None => Ok(()),
        Some((_, what)) => {
            Err(Stop::Usage(format!("cannot write {}: it is {what} itself; name another file", path.display())))
        }
    }
}

/// Refuses to write over a file that the model reads by `use`.
///
/// # Errors
/// Status 2.
pub fn not_over_used(path: Option<&Path>, used: &[PathBuf]) -> Result<(), Stop> {
    match path.filter(|path| used.iter().any(|other| same(path, other))) {
        None => Ok(()),
        Some(path) => {
            let shown = path.display();
            Err(Stop::Usage(format!("cannot write {shown}: it is a file that the model uses; name another file")))
        }
    }
}

/// Refuses two results in one file: each is an option, and the path that it names.
///
/// # Errors
/// Status 2.
pub fn different(list: &[(&str, &Path)]) -> Result<(), Stop> {
    for (i, (a, path)) in list.iter().enumerate() {
        if let Some((b, _)) = list[i + 1..].iter().find(|(_, other)| path == other || same(path, other)) {
            return Err(Stop::Usage(format!("{a} and {b} name the same file")));
        }
    }
    Ok(())
}

/// Whether two paths name the same file, however they are spelled. Standard streams and devices do not count.
fn same(a: &Path, b: &Path) -> bool {
    let file = |path: &Path| path != Path::new("-") && fs::metadata(path).map_or(true, |m| m.is_file());
    file(a) && file(b) && spot(a) == spot(b)
}

/// Where a file is; one that is not there yet by its name in its folder. A link stands for what it points to, be that
/// there or not.
fn spot(path: &Path) -> PathBuf {
    if let Ok(place) = path.canonicalize() {
        return place;
    }
    let path = target(path);
    match (folder(&path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        (_, _) => path,
    }
}

/// The folder of a path.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// Where a link to what is not there leads, over the links that it leads to. One of a ring stands for itself.
fn target(path: &Path) -> PathBuf {
    let mut place = path.to_path_buf();
    for _ in 0..LINKS_FOLLOWED {
        match fs::read_link(&place) {
            Ok(next) => place = folder(&place).join(next),
            Err(_) => return place,
        }
    }
    path.to_path_buf()
}

/// Refuses the place of a model: a result there would take the place of a text that somebody wrote.
///
/// # Errors
/// Status 2.
pub fn no_model(path: &Path) -> Result<(), Stop> {
    let model = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bond"));
    let (shown, spot) = (path.display(), spot(path));
    if model(path) {
        return Err(Stop::Usage(format!("cannot write {shown}: that is the name of a model; name another file")));
    }
    if model(&spot) {
        let there = spot.display();
        return Err(Stop::Usage(format!("cannot write {shown}: it leads to {there}, a model; name another file")));
    }
    Ok(())
}

fn directory(path: &Path) -> Stop {
    Stop::Usage(format!("cannot write {}: it is a directory", path.display()))
}

fn nameless(path: &Path) -> Stop {
    Stop::Usage(format!("cannot write {}: it names no file", path.display()))
}

/// Writes bytes to a file that may be executed.
///
/// # Errors
/// A file that cannot be written.
pub fn put_executable(path: &Path, parts: &[&[u8]]) -> Result<(), Stop> {
    if let Some(m) = fs::metadata(path).ok().filter(|m| !m.is_file()) {
        let (name, what) = (path.display(), if m.is_dir() { "directory" } else { "device or a pipe" });
        return Err(Stop::Usage(format!("cannot write {name}: it is a {what}; name another file with -o")));
    }
    let mut whole = Whole::new(path)?;
    whole.executable = true;
    for part in parts {
        whole.file.write_all(part).map_err(|e| unwritable(path, &e))?;
    }
    whole.commit()
}

/// What a result is written to.
pub enum Sink {
    /// Standard output.
    Out(BufWriter<Stdout>),
    /// A device or a pipe that has a name.
    Direct(BufWriter<File>, PathBuf),
    /// A file to be.
    Whole(Whole),
}

impl Sink {
    /// Opens it; `-` is standard output.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn open(path: &Path) -> Result<Self, Stop> {
        if path == Path::new("-") {
            return Ok(Sink::Out(BufWriter::new(io::stdout())));
        }
        match fs::metadata(path) {
            Ok(m) if m.is_dir() => Err(directory(path)),
            Ok(m) if !m.is_file() => {
                let file = OpenOptions::new().write(true).open(path).map_err(|e| unwritable(path, &e))?;
                Ok(Sink::Direct(BufWriter::new(file), path.to_path_buf()))
            }
            Ok(_) | Err(_) => Whole::new(path).map(Sink::Whole),
        }
    }

    /// Ends it: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(self) -> Result<(), Stop> {
        match self {
            Sink::Out(mut out) => Ok(out.flush()?),
            Sink::Direct(mut file, path) => file.flush().map_err(|e| unwritable(&path, &e)),
            Sink::Whole(whole) => whole.commit(),
        }
    }

    /// What it means that it cannot be written.
    pub fn failure(&self, e: &io::Error) -> Stop {
        match self {
            Sink::Out(_) if e.kind() == io::ErrorKind::BrokenPipe => Stop::Pipe,
            Sink::Out(_) => Stop::Usage(format!("cannot write to standard output: {e}")),
            Sink::Direct(_, path) => unwritable(path, e),
            Sink::Whole(whole) => unwritable(&whole.path, e),
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Sink::Out(out) => out.write(bytes),
            Sink::Direct(file, _) => file.write(bytes),
            Sink::Whole(whole) => whole.file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Sink::Out(out) => out.flush(),
            Sink::Direct(file, _) => file.flush(),
            Sink::Whole(whole) => whole.file.flush(),
        }
    }
}

/// A file that appears under its name when it is complete. Dropped before that, it leaves nothing.
pub struct Whole {
    file: BufWriter<File>,
    beside: PathBuf,
    path: PathBuf,
    executable: bool,
    done: bool,
}

impl Whole {
    fn new(path: &Path) -> Result<Self, Stop> {
        // A link stays a link: what it points to is made or replaced.
        let path = fs::canonicalize(path).unwrap_or_else(|_| target(path));
        let Some(name) = path.file_name() else {
            return Err(nameless(&path));
        };
        // A name of the greatest length is cut, to leave room for the suffix.
        let name = name.to_string_lossy();
        let name = &name[..name.floor_char_boundary(NAME_BYTES)];
        for attempt in 0..100 {
            let beside = path.with_file_name(format!(".{name}.{}.{attempt}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&beside) {
                Ok(file) => {
                    BESIDE.lock().unwrap_or_else(PoisonError::into_inner).push(beside.clone());
                    return Ok(Self { file: BufWriter::new(file), beside, path, executable: false, done: false });
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(unwritable(&path, &e)),
            }
        }
        Err(Stop::Usage(format!("cannot write {}: its folder is full of leftovers", path.display())))
    }

    /// Flushes everything to the disk before renaming, so that after a power failure too only a whole file has the
    /// name.
    fn settle(&mut self) -> io::Result<()> {
        self.file.flush()?;
        self.file.get_ref().sync_all()
    }

    fn commit(mut self) -> Result<(), Stop> {
        let result = self.settle().and_then(|()| {
            if self.executable {
                executable(self.file.get_ref())?;
            } else if let Ok(old) = fs::metadata(&self.path) {
                self.file.get_ref().set_permissions(old.permissions())?;
            }
            fs::rename(&self.beside, &self.path)
        });
        self.done = result.is_ok();
        result.map_err(|e| unwritable(&self.path, &e))
    }
}

/// Lets everybody read and execute a file: mode 755.
#[cfg(unix)]
fn executable(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(fs::Permissions::from_mode(0o755))
}

/// Elsewhere the name says it.
#[cfg(not(unix))]
fn executable(_: &File) -> io::Result<()> {
    Ok(())
}

impl Drop for Whole {
    fn drop(&mut self) {
        if !self.done {
            let _ = fs::remove_file(&self.beside);
        }
        BESIDE.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.beside);
    }
}

/// What it means that a file cannot be written.
pub fn unwritable(path: &Path, e: &io::Error) -> Stop {
    let why = match e.kind() {
        io::ErrorKind::NotFound => "its folder does not exist; create it first".to_string(),
        io::ErrorKind::PermissionDenied => {
            "permission denied; name another file, or change the permissions of its folder".to_string()
        }
        _ => e.to_string(),
    };
    Stop::Usage(format!("cannot write {}: {why}", path.display()))
}
