//! The book in `docs/`: its pages are in its table of contents, and links lead somewhere. What its commands print is
//! tested in `cli/tests/command/docs.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Files with one of these endings in a folder of the repository, by their paths from its root.
fn files(folder: &str, endings: &[&str]) -> Vec<PathBuf> {
    let mut folders = vec![Path::new("..").join(folder)];
    let mut list = Vec::new();
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        for entry in entries {
            let path = entry.expect("a folder can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| endings.iter().any(|x| e == *x)) {
                list.push(path.strip_prefix("..").expect("it is in the repository").to_path_buf());
            }
        }
    }
    list.sort();
    list
}

/// The pages of the book, and the files of Markdown beside it.
fn pages() -> Vec<PathBuf> {
    let beside = std::fs::read_dir("..").expect("the repository can be listed");
    let beside = beside.filter_map(|e| Some(PathBuf::from(e.ok()?.file_name())));
    let mut list: Vec<PathBuf> = beside.filter(|p| p.extension().is_some_and(|e| e == "md")).collect();
    list.extend(files("docs", &["md"]));
    list
}

fn read(path: &Path) -> String {
    crate::common::read(&Path::new("..").join(path))
}

/// The lines of a page outside of its blocks of code, without code in the line.
fn prose(text: &str) -> Vec<String> {
    let mut inside = false;
    let mut list = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
        } else if !inside && !line.starts_with("    ") {
            list.push(line.split('`').step_by(2).collect::<Vec<_>>().join("``"));
        }
    }
    list
}

/// Targets of the links and pictures of a page.
fn links(text: &str) -> Vec<String> {
    // A link may stand on two lines.
    let text = prose(text).join("\n");
    text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(url, _)| url.to_string()).collect()
}

/// What a heading is called in a link: by mdBook, and by the sites that show Markdown.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut list = BTreeSet::new();
    let mut inside = false;
    for line in text.lines() {
        inside ^= line.starts_with("```");
        let Some(title) = line.strip_prefix('#').filter(|_| !inside).map(|l| l.trim_start_matches('#').trim()) else {
            continue;
        };
        let keep = |c: char| match c {
            ' ' => Some('-'),
            _ => Some(c.to_ascii_lowercase()).filter(|c| c.is_alphanumeric() || "-_".contains(*c)),
        };
        let name: String = title.chars().filter_map(keep).collect();
        let number = (1..).map(|n| format!("{name}-{n}")).find(|n| !list.contains(n));
        list.insert(if list.contains(&name) { number.unwrap_or_default() } else { name });
    }
    list
}

/// A path without `..`; `None` if it leads out of the repository.
fn plain(path: &Path) -> Option<PathBuf> {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => out.pop().then_some(())?,
            Component::CurDir => {}
            _ => out.push(part),
        }
    }
    Some(out)
}

#[test]
fn every_link_leads_somewhere() {
    let pages = pages();
    let known: BTreeMap<PathBuf, BTreeSet<String>> = pages.iter().map(|p| (p.clone(), anchors(&read(p)))).collect();
    let mut wrong = Vec::new();
    for page in &pages {
        let mut say = |url: &str, why: &str| wrong.push(format!("{}: {url} {why}", page.display()));
        for url in links(&read(page)) {
            if url.starts_with("https://") || url.starts_with("http://") {
                continue;
            }
            let (file, anchor) = url.split_once('#').unwrap_or((&url, ""));
            let folder = page.parent().unwrap_or(Path::new(""));
            let target = if file.is_empty() { Some(page.clone()) } else { plain(&folder.join(file)) };
            let Some(target) = target.filter(|t| Path::new("..").join(t).exists()) else {
                say(&url, "is not there");
                continue;
            };
            // The book is built from `docs` alone.
            if page.starts_with("docs") && !target.starts_with("docs") {
                say(&url, "is not in the book");
            }
            if !anchor.is_empty() && !known.get(&target).is_some_and(|list| list.contains(anchor)) {
                say(&url, "has no such heading");
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_page_is_in_the_summary_once() {
    let summary = links(&read(Path::new("docs/SUMMARY.md")));
    let listed: BTreeSet<PathBuf> = summary.iter().map(|l| Path::new("docs").join(l)).collect();
    assert_eq!(listed.len(), summary.len(), "docs/SUMMARY.md lists a page twice");
    let there: BTreeSet<PathBuf> = files("docs", &["md"]).into_iter().filter(|p| !p.ends_with("SUMMARY.md")).collect();
    let missing: Vec<_> = there.difference(&listed).collect();
    let gone: Vec<_> = listed.difference(&there).collect();
    assert!(missing.is_empty() && gone.is_empty(), "docs/SUMMARY.md lacks {missing:?}, and names {gone:?}");
}

/// Pages that the code, its comments and its messages name.
#[test]
fn pages_that_the_code_names_are_there() {
    let mut wrong = Vec::new();
    let folders = ["grammar", "compiler", "runtime", "cli", "tests", "fuzz", "models", ".ci"];
    let mut list: Vec<PathBuf> =
        folders.iter().flat_map(|f| files(f, &["rs", "py", "toml", "bond", "c", "mjs", "md"])).collect();
    list.push(".ci/run".into());
    for path in list.iter().filter(|p| !p.starts_with("fuzz/target")) {
        let text = read(path);
        for (at, _) in text.match_indices("docs/") {
            let name = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
            let named: String = text[at..].chars().take_while(|&c| name(c)).collect();
            let named = named.trim_end_matches('.');
            if named.ends_with(".md") && !Path::new("..").join(named).exists() {
                wrong.push(format!("{}: {named} is not there", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What a page shows as a model is one, also where it has no name and so is not run.
#[test]
fn models_in_the_book_are_read() {
    for page in pages() {
        for block in read(&page).split("\n```bond").skip(1) {
            let block = block.split("\n```").next().unwrap_or_default();
            let Some((_, text)) = block.split_once('\n') else { continue };
            if text.lines().any(|l| l.starts_with("model ")) {
                let mut sources = bond_grammar::source::Sources::new();
                let id = sources.add("page.bond", text);
                let (_, errors) = bond_grammar::parse(&sources, id);
                assert!(errors.is_empty(), "{}: {errors:?}\n{text}", page.display());
            }
        }
    }
}
