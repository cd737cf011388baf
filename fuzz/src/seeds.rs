//! What the fuzzer begins with: made from the models when a target starts, and in no repository.

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Writes the seeds of a target, name and bytes, where the script `run` looks for them.
///
/// # Panics
/// If they cannot be written.
pub fn write(target: &str, list: impl IntoIterator<Item = (String, Vec<u8>)>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds").join(target);
    fs::create_dir_all(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for (name, bytes) in list {
        let path = folder.join(name);
        if fs::read(&path).is_ok_and(|there| there == bytes) {
            continue;
        }
        fs::write(&path, bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
}

/// The models of a folder that have so many bytes at most: name and text.
///
/// # Panics
/// If there is no such folder.
pub fn models(folder: &str, longest: usize) -> Vec<(String, String)> {
    let path = root().join("models").join(folder);
    let entries = fs::read_dir(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut list: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    list.sort();
    list.retain(|path| path.extension().is_some_and(|e| e == "bond"));
    let text = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        Some((format!("{folder}-{name}"), fs::read_to_string(path).ok()?))
    };
    list.iter().filter_map(text).filter(|(_, text)| text.len() <= longest).collect()
}
