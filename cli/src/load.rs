//! Files of models: reading them, and following `use "path"` from one to the next.

use bond_compiler::elaborate::Loader;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
use thiserror::Error;

/// Most bytes of a text that are read: a little more than the grammar takes, so that the grammar reports the error.
const MAX_TEXT: u64 = 17 << 20;
/// Most bytes of a table or a state.
const MAX_TABLE: u64 = 1 << 30;

/// Why a file could not be read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{0}")]
    Unreadable(String),
    /// It is not UTF-8 text.
    #[error("line {line} is not UTF-8 text")]
    NotText {
        /// The first line that is not UTF-8, from 1.
        line: usize,
    },
}

/// The text of a file, or of standard input where the path is `-`.
///
/// # Errors
/// A file that is not there, is a directory or no UTF-8 text.
pub fn read(path: &Path) -> Result<String, ReadError> {
    let bytes = bytes(path, MAX_TEXT)?;
    if bytes.len() as u64 == MAX_TEXT {
        // It may be cut within a character; the rest is still too large.
        return Ok(String::from_utf8_lossy(&bytes).into_owned());
    }
    text(bytes)
}

/// The text of a table of numbers, or of standard input where the path is `-`.
///
/// # Errors
/// A file that is not there, is a directory, no UTF-8 text or larger than a gigabyte.
pub fn read_table(path: &Path) -> Result<String, ReadError> {
    text(read_bytes(path)?)
}

/// The bytes of a file, such as a saved state, or of standard input where the path is `-`.
///
/// # Errors
/// A file that is not there, is a directory or larger than a gigabyte.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    let bytes = bytes(path, MAX_TABLE + 1)?;
    if bytes.len() as u64 > MAX_TABLE {
        return Err(ReadError::Unreadable("it is larger than a gigabyte".into()));
    }
    Ok(bytes)
}

/// What a file holds, up to a number of bytes.
fn bytes(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    let unreadable = |e: std::io::Error| ReadError::Unreadable(plain(&e));
    let mut bytes = Vec::new();
    if path == Path::new("-") {
        std::io::stdin().lock().take(most).read_to_end(&mut bytes).map_err(unreadable)?;
    } else {
        let file = File::open(path).map_err(unreadable)?;
        if file.metadata().map_err(unreadable)?.is_dir() {
            return Err(ReadError::Unreadable("it is a directory".into()));
        }
        file.take(most).read_to_end(&mut bytes).map_err(unreadable)?;
    }
    Ok(bytes)
}

fn text(bytes: Vec<u8>) -> Result<String, ReadError> {
    String::from_utf8(bytes).map_err(|e| {
        let good = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        ReadError::NotText { line: good.iter().filter(|b| **b == b'\n').count() + 1 }
    })
}

/// An error of the system without its number.
fn plain(e: &std::io::Error) -> String {
    let text = e.to_string();
    let text = text.split(" (os error").next().unwrap_or_default();
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// Loads used files from disk. A path is relative to the file that says `use`; a file that is reached in two ways is
/// one file.
#[derive(Debug)]
pub struct FileLoader {
    /// Where each file that was named so far is, by its shown name.
    places: HashMap<String, PathBuf>,
    /// The shown name of each, by its true path.
    names: HashMap<PathBuf, String>,
    uses: Vec<Use>,
}

/// A use that was followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Use {
    /// The shown name of the file that says it.
    pub from: String,
    /// The path that it says.
    pub path: String,
    /// The shown name of the file that was found there.
    pub name: String,
}

impl FileLoader {
    /// A loader for a main file that is shown as `name`, which is its path too. Where there is no such file (as for
    /// standard input), `use` is relative to the folder that the name stands in.
    pub fn new(name: &str) -> Self {
        let place = std::fs::canonicalize(name).unwrap_or_else(|_| PathBuf::from(name));
        let mut loader = Self { places: HashMap::new(), names: HashMap::new(), uses: Vec::new() };
        loader.places.insert(name.to_string(), place.clone());
        loader.names.insert(place, name.to_string());
        loader
    }

    /// Where the files are that were loaded so far, the main one with them, in order of their paths.
    pub fn used(&self) -> Vec<PathBuf> {
        let mut list: Vec<PathBuf> = self.places.values().cloned().collect();
        list.sort();
        list
    }

    /// What was used so far.
    pub fn uses(self) -> Vec<Use> {
        self.uses
    }

    /// The shown name of a file that `from` uses, by its true path.
    fn name(&mut self, from: &str, path: &str, place: PathBuf) -> String {
        if let Some(name) = self.names.get(&place) {
            return name.clone();
        }
        let mut name = tidy(&Path::new(from).parent().unwrap_or(Path::new("")).join(path));
        // Two files never share a name, and none has one of the bundled library's.
        if self.places.contains_key(&name) || name.starts_with("std/") {
            name = place.to_string_lossy().into_owned();
        }
        self.places.insert(name.clone(), place.clone());
        self.names.insert(place, name.clone());
        name
    }
}

impl Loader for FileLoader {
    fn load(&mut self, from: &str, path: &str) -> Result<(String, String), String> {
        let user = self.places.get(from).cloned().unwrap_or_else(|| PathBuf::from(from));
        let folder = user.parent().unwrap_or(Path::new(""));
        let wanted = folder.join(path);
        let unreadable = |e: ReadError| match e {
            ReadError::Unreadable(_) if !wanted.exists() => "there is no such file".to_string(),
            other => other.to_string(),
        };
        let text = read_file(&wanted).map_err(unreadable)?;
        let place = std::fs::canonicalize(&wanted).unwrap_or(wanted);
        let name = self.name(from, path, place);
        self.uses.push(Use { from: from.into(), path: path.into(), name: name.clone() });
        Ok((name, text))
    }
}

/// Texts that were read before, to be compiled where their files are not: the name and the text of each, the main one
/// first, and which of them uses which.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CarriedTexts {
    /// Names and texts.
    pub list: Vec<(String, String)>,
    /// The uses between them.
    pub uses: Vec<Use>,
}

impl Loader for &CarriedTexts {
    fn load(&mut self, from: &str, path: &str) -> Result<(String, String), String> {
        let used = self.uses.iter().find(|u| u.from == from && u.path == path);
        let found = used.and_then(|u| self.list.iter().find(|(name, _)| *name == u.name));
        found.cloned().ok_or_else(|| "it is not among the texts that were carried along".to_string())
    }
}

/// As [`read`], but `-` is a file of that name.
fn read_file(path: &Path) -> Result<String, ReadError> {
    if path == Path::new("-") { read(Path::new("./-")) } else { read(path) }
}

/// `a/b/../c.bond` as `a/c.bond`.
fn tidy(path: &Path) -> String {
    let mut parts: Vec<Component> = Vec::new();
    for part in path.components() {
        match (part, parts.last()) {
            (Component::CurDir, _) => {}
            (Component::ParentDir, Some(Component::Normal(_))) => {
                parts.pop();
            }
            _ => parts.push(part),
        }
    }
    parts.iter().collect::<PathBuf>().to_string_lossy().into_owned()
}
