//! What several tests need.
#![allow(dead_code)] // not every test file needs all of it

use bond_grammar::ast::File;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Sources;

/// A tree as text without spans and comments, so that two layouts of one model compare equal.
pub fn shape(file: &File) -> String {
    let mut file = file.clone();
    file.comments.clear();
    let text = format!("{file:?}");
    let mut shape = String::new();
    let mut rest = text.as_str();
    while let Some(at) = rest.find("Span { source") {
        shape.push_str(&rest[..at]);
        let end = rest[at..].find('}').map_or(rest.len(), |end| at + end + 1);
        rest = &rest[end..];
    }
    shape + rest
}

/// Reads a text.
pub fn read(text: &str) -> (Sources, File, Vec<Diagnostic>) {
    let mut sources = Sources::new();
    let id = sources.add("test.bond", text);
    let (file, errors) = bond_grammar::parse(&sources, id);
    (sources, file, errors)
}

/// Reads a text that has no errors.
pub fn good(text: &str) -> (Sources, File) {
    let (sources, file, errors) = read(text);
    let told: Vec<String> = errors.iter().map(|error| error.render(&sources)).collect();
    assert!(errors.is_empty(), "{}\n{text}", told.join(""));
    (sources, file)
}

/// The canonical layout of a text, checked: it means the same, keeps the comments and is its own layout.
pub fn formatted(text: &str) -> String {
    let (sources, file) = good(text);
    let first = bond_grammar::format(&sources, file.span.source, &file);
    let (sources, again) = good(&first);
    assert_eq!(shape(&file), shape(&again), "the layout changes the meaning:\n{text}\n---\n{first}");
    let words = |file: &File| {
        let mut words: Vec<String> =
            file.comments.iter().map(|c| c.text.trim_start_matches(['/', '!']).to_string()).collect();
        words.sort();
        words
    };
    assert_eq!(words(&file), words(&again), "a comment is lost:\n{text}\n---\n{first}");
    let second = bond_grammar::format(&sources, again.span.source, &again);
    assert_eq!(first, second, "the layout is not stable:\n{text}");
    first
}

/// The `.bond` files of a folder of this repository, sorted; none where the folder is missing.
pub fn models(folder: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders = vec![std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "bond") {
                let text = std::fs::read_to_string(&path).expect("a model can be read");
                found.push((path.display().to_string(), text));
            }
        }
    }
    found.sort();
    found
}
