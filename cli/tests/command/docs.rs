//! The book and the README: each page's commands are run in an empty folder, and print what the page shows.
//! `CONTRIBUTING.md` says how pages are written.
#![cfg(unix)]

use super::Folder;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

/// A page as it is called in the repository.
fn name(page: &Path) -> String {
    page.strip_prefix(docs().join("..")).or(page.strip_prefix(docs())).unwrap_or(page).display().to_string()
}

/// Whether what is generated is written anew, and what is shown with it.
fn updates() -> bool {
    std::env::var("INSTA_UPDATE").is_ok_and(|v| v == "always")
}

/// All pages, sorted, and the README.
fn pages() -> Vec<PathBuf> {
    let mut folders = vec![docs()];
    let mut list = vec![docs().join("../README.md")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                list.push(path);
            }
        }
    }
    list.sort();
    list
}

/// A part of a page that the test does something about.
enum Piece {
    /// ```` ```bond wall.bond ````: a file that the reader has from here on.
    Text { name: String, text: String },
    /// `<!-- with: models/examples/pendulum.bond as pendulum.bond -->`: a file of the repository.
    With { from: String, to: String },
    /// ```` ```console ````: commands after `$ `, each with what it prints.
    Console { exit: i32, commands: Vec<Shown> },
}

/// A command, and the lines of the page with its output.
struct Shown {
    command: String,
    first: usize,
    end: usize,
}

/// What a page has, in order.
fn pieces(lines: &[String]) -> Result<Vec<Piece>, String> {
    let mut list = Vec::new();
    let mut at = 0;
    while at < lines.len() {
        let line = lines[at].trim();
        at += 1;
        if let Some(what) = line.strip_prefix("<!-- with: ") {
            let what = what.trim_end_matches(" -->");
            let (from, to) = what.split_once(" as ").unwrap_or((what, what));
            list.push(Piece::With { from: from.into(), to: to.into() });
        }
        let Some(info) = line.strip_prefix("```") else { continue };
        let first = at;
        while at < lines.len() && lines[at].trim() != "```" {
            at += 1;
        }
        let end = at;
        at += 1;
        let (language, rest) = info.split_once(' ').unwrap_or((info, ""));
        match language {
            "console" if rest.starts_with("skip: ") => {}
            "console" => {
                let exit = rest.strip_prefix("exit=").map_or(Ok(0), str::parse);
                let exit = exit.map_err(|_| format!("line {first}: `{rest}` after `console`"))?;
                list.push(Piece::Console { exit, commands: commands(lines, first, end)? });
            }
            _ if !rest.is_empty() => {
                list.push(Piece::Text { name: rest.into(), text: lines[first..end].join("\n") + "\n" });
            }
            _ => {}
        }
    }
    Ok(list)
}

fn commands(lines: &[String], first: usize, end: usize) -> Result<Vec<Shown>, String> {
    let mut list: Vec<Shown> = Vec::new();
    let mut at = first;
    while at < end {
        if let Some(command) = lines[at].strip_prefix("$ ") {
            let mut command = command.to_string();
            while command.ends_with('\\') && at + 1 < end {
                at += 1;
                let _ = write!(command, "\n{}", lines[at]);
            }
            list.push(Shown { command, first: at + 1, end: at + 1 });
        } else {
            list.last_mut().ok_or(format!("line {}: output without a command", at + 1))?.end = at + 1;
        }
        at += 1;
    }
    Ok(list)
}

/// Whether two lines are the same, but for rounding. `...` stands for any one word or a part of it, and at the end of a
/// line for all that follows.
fn same(shown: &str, printed: &str) -> bool {
    let words = |line: &str| line.split_whitespace().map(String::from).collect::<Vec<_>>();
    let (shown, printed) = (words(shown), words(printed));
    let open = shown.last().is_some_and(|w| w == "...");
    if printed.len() < shown.len() || (!open && printed.len() > shown.len()) {
        return false;
    }
    shown.iter().zip(&printed).all(|(x, y)| {
        let number = |word: &str| word.trim_matches([',', ';', '(', ')']).parse::<f64>().ok();
        match (number(x), number(y)) {
            (Some(p), Some(q)) => (p - q).abs() <= 1e-5 * p.abs().max(q.abs()) || p.abs().max(q.abs()) < 1e-12,
            _ => fits(x, y),
        }
    })
}

/// Whether a word is one with parts left out.
fn fits(shown: &str, word: &str) -> bool {
    let Some((head, rest)) = shown.split_once("...") else { return shown == word };
    word.strip_prefix(head).is_some_and(|word| {
        if rest.contains("...") {
            word.char_indices().any(|(k, _)| fits(rest, &word[k..]))
        } else {
            word.ends_with(rest)
        }
    })
}

/// Whether lines are those shown, where a line `...` stands for any number of them.
fn matches(shown: &[String], printed: &[&str]) -> bool {
    match shown.split_first() {
        None => printed.is_empty(),
        Some((first, rest)) if first.trim() == "..." => (0..=printed.len()).any(|n| matches(rest, &printed[n..])),
        Some((first, rest)) => printed.split_first().is_some_and(|(p, others)| same(first, p) && matches(rest, others)),
    }
}

/// A shell's answer in a folder, with the tested `bond`: its status, and what both streams say.
fn run(here: &Folder, command: &str) -> (i32, String) {
    let bin = Path::new(env!("CARGO_BIN_EXE_bond")).parent().unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default());
    let out = Command::new("sh")
        .args(["-c", &format!("exec 2>&1\n{command}")])
        .current_dir(&here.0)
        .env("PATH", path)
        .output()
        .unwrap();
    (out.status.code().unwrap_or(-1), String::from_utf8_lossy(&out.stdout).into_owned())
}

/// Does what a page says; what is not as it shows.
fn follow(page: &Path) -> Vec<String> {
    let mut lines: Vec<String> = std::fs::read_to_string(page).unwrap().lines().map(String::from).collect();
    let here = Folder::new();
    let mut wrong = Vec::new();
    let mut anew: Vec<(usize, usize, Vec<String>)> = Vec::new();
    let list = match pieces(&lines) {
        Ok(list) => list,
        Err(e) => return vec![format!("{}: {e}", name(page))],
    };
    for piece in list {
        match piece {
            Piece::Text { name, text } => {
                let path = here.0.join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, text).unwrap();
            }
            Piece::With { from, to } => {
                let from = docs().parent().unwrap().join(from).canonicalize().unwrap();
                std::os::unix::fs::symlink(from, here.0.join(to)).unwrap();
            }
            Piece::Console { exit, commands } => {
                for Shown { command, first, end } in commands {
                    let (status, text) = run(&here, &command);
                    let place = || format!("{}:{first}: $ {command}", name(page));
                    let printed: Vec<&str> = text.lines().collect();
                    let shown = &lines[first..end];
                    if status != exit {
                        wrong.push(format!("{}\nits status is {status}, and not {exit}\n{text}", place()));
                    } else if !shown.is_empty() && !matches(shown, &printed) {
                        if updates() && shown.len() == printed.len() {
                            let line = |(s, p): (&String, &&str)| if same(s, p) { s.clone() } else { p.to_string() };
                            anew.push((first, end, shown.iter().zip(&printed).map(line).collect()));
                        } else {
                            wrong.push(format!("{}\nprints\n{text}and not\n{}\n", place(), shown.join("\n")));
                        }
                    }
                }
            }
        }
    }
    for (first, end, text) in anew.into_iter().rev() {
        lines.splice(first..end, text);
        std::fs::write(page, lines.join("\n") + "\n").unwrap();
    }
    wrong.extend(pictures(page, &lines, &here));
    wrong
}

/// The pictures of a page that its commands draw are those beside it.
fn pictures(page: &Path, lines: &[String], here: &Folder) -> Vec<String> {
    let mut wrong = Vec::new();
    for line in lines.iter().filter(|l| l.starts_with("![")) {
        let Some(link) = line.split_once("](").and_then(|(_, rest)| rest.strip_suffix(')')) else { continue };
        let kept = page.parent().unwrap().join(link);
        let Ok(drawn) = std::fs::read(here.0.join(kept.file_name().unwrap())) else { continue };
        if std::fs::read(&kept).ok().as_ref() == Some(&drawn) {
            continue;
        }
        if updates() {
            std::fs::create_dir_all(kept.parent().unwrap()).unwrap();
            std::fs::write(&kept, drawn).unwrap();
        } else {
            wrong.push(format!("{}: {link} is not what the page's command draws", name(page)));
        }
    }
    wrong
}

const HOW: &str = "`INSTA_UPDATE=always cargo test --release -p bond -- docs::` writes pictures, generated pages and \
                   output of as many lines anew";

#[test]
fn commands_print_what_the_book_shows() {
    let list = Mutex::new(pages());
    let wrong = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let Some(page) = list.lock().unwrap().pop() else { break };
                    let found = follow(&page);
                    wrong.lock().unwrap().extend(found);
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}\n({HOW})", wrong.join("\n"));
}

/// Each part of the book that is generated: its page, and its text.
fn generated() -> Vec<(String, String)> {
    let here = Folder::new();
    let said = |args: &[&str]| here.bond(args).is(0, &[], &[]).out;
    let mut list = Vec::new();
    let all: serde_json::Value = serde_json::from_str(&said(&["doc", "--as", "json"])).unwrap();
    for library in all["libraries"].as_array().unwrap() {
        let name = library["name"].as_str().unwrap();
        let page = said(&["doc", name, "--as", "markdown"]);
        list.push((format!("reference/library/{}.md", name.trim_start_matches("std.")), page));
    }
    let help = said(&["--help"]);
    let mut text = format!("# Commands\n\nWhat `--help` says of each command.\n\n```text\n{}\n```\n", help.trim_end());
    let commands = help.lines().skip_while(|l| *l != "Commands:").skip(1).take_while(|l| !l.is_empty());
    for name in commands.filter_map(|l| l.split_whitespace().next()).filter(|n| *n != "help") {
        let _ = write!(text, "\n## bond {name}\n\n```text\n{}\n```\n", said(&[name, "--help"]).trim_end());
    }
    list.push(("reference/commands.md".into(), text));
    list
}

#[test]
fn generated_pages_are_up_to_date() {
    for (name, text) in generated() {
        let path = docs().join(&name);
        // Lines that end in blanks are lines of help that have no more to say.
        let text: String = text.lines().map(|l| format!("{}\n", l.trim_end())).collect();
        if updates() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, &text).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap_or_default(), text, "docs/{name} is old ({HOW})");
    }
}
