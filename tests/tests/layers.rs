//! How the code is laid out: no circle between files, no function that is too long to be read, no long lines.
//!
//! Only text is looked at, as rustfmt leaves it: `use` lines, and paths as `module::item`.

use petgraph::algo::tarjan_scc;
use petgraph::graph::{Graph, NodeIndex};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The packages, and what their crates are called in code.
const PACKAGES: [(&str, &str); 4] =
    [("grammar", "bond_grammar"), ("runtime", "bond_runtime"), ("compiler", "bond_compiler"), ("cli", "bond")];

/// Lines that a function may have, from its first to its closing brace.
const MAX_FUNCTION_LINES: usize = 120;
/// Characters that a line of a comment may have.
const MAX_LINE: usize = 120;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_path_buf()
}

/// All files of a folder that end in `.rs`, in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for path in entries.map(|entry| entry.expect("an entry").path()) {
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The code alone: no comments, nothing between quotes, no tests at its end.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let (mut found, mut rest) = (String::new(), text);
    while let Some(c) = rest.chars().next() {
        let name_before = found.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let skipped = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |i| i + 2)
        } else if rest.starts_with('"') {
            quoted(rest)
        } else if !name_before && (rest.starts_with("r\"") || rest.starts_with("r#")) {
            let hashes = rest[1..].chars().take_while(|c| *c == '#').count();
            let end = format!("\"{}", "#".repeat(hashes));
            let from = 2 + hashes;
            if rest[1 + hashes..].starts_with('"') {
                rest[from..].find(&end).map_or(0, |i| from + i + end.len())
            } else {
                0
            }
        } else if let Some(after) = rest.strip_prefix('\'') {
            // A character, and not a lifetime.
            let mut inner = after.char_indices();
            match (inner.next(), inner.next()) {
                (Some((_, '\\')), Some((i, escaped))) => {
                    let from = 1 + i + escaped.len_utf8();
                    rest[from..].find('\'').map_or(0, |j| from + j + 1)
                }
                (Some(_), Some((i, '\''))) => i + 2,
                _ => 0,
            }
        } else {
            0
        };
        if skipped == 0 {
            found.push(c);
        }
        rest = &rest[if skipped == 0 { c.len_utf8() } else { skipped }..];
    }
    found
}

/// How long a text between quotes is that stands first.
fn quoted(text: &str) -> usize {
    let mut escaped = false;
    for (i, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return i + 1,
            _ => {}
        }
    }
    text.len()
}

/// A file as a module.
#[derive(Default)]
struct Module {
    /// What `use` brings in: under which name, and from where.
    imports: Vec<(String, Vec<String>)>,
    /// Whether an import is public: a re-export.
    is_public: Vec<bool>,
    /// Paths in the code.
    paths: Vec<Vec<String>>,
    /// Names that it declares.
    items: BTreeSet<String>,
}

/// The segments of a path.
fn segments(path: &str) -> Vec<String> {
    path.split("::").map(str::trim).filter(|s| !s.is_empty()).map(String::from).collect()
}

/// The paths of a tree as it stands behind `use`, with the names that they get.
fn branches(tree: &str, found: &mut Vec<(String, Vec<String>)>, stem: &[String]) {
    let Some((before, inner)) = tree.split_once('{') else {
        let (path, name) = tree.split_once(" as ").map_or((tree, None), |(path, name)| (path, Some(name.trim())));
        let mut all = [stem, &segments(path)].concat();
        if all.last().is_some_and(|s| s == "self") {
            all.pop();
        }
        let name = name.map(String::from).or_else(|| all.last().cloned()).unwrap_or_default();
        return found.push((name, all));
    };
    let stem = [stem, &segments(before)].concat();
    let inner = inner.trim_end().strip_suffix('}').unwrap_or(inner);
    let (mut depth, mut start) = (0, 0);
    for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let one = inner[start..i].trim();
                if !one.is_empty() {
                    branches(one, found, &stem);
                }
                start = i + 1;
            }
            _ => {}
        }
    }
}

impl Module {
    fn of(text: &str) -> Self {
        let (mut module, mut rest) = (Module::default(), String::new());
        let mut used: Option<(bool, String)> = None;
        for line in code(text).lines() {
            let start = line.trim_start();
            let plain = start.strip_prefix("pub").map_or(start, |s| s.split_once("use ").map_or(start, |_| s));
            let visible = plain.len() < start.len();
            let tree = if visible { plain.split_once("use ").map(|t| t.1) } else { start.strip_prefix("use ") };
            match (&mut used, tree) {
                (Some((_, open)), _) => open.push_str(line),
                (None, Some(tree)) => used = Some((visible, tree.to_string())),
                (None, None) => {
                    rest.push_str(line);
                    rest.push('\n');
                }
            }
            if let Some((visible, tree)) = used.take_if(|u| u.1.contains(';')) {
                branches(tree.split(';').next().unwrap_or_default(), &mut module.imports, &[]);
                module.is_public.resize(module.imports.len(), visible);
            }
        }
        let is_name = |c: char| c.is_alphanumeric() || c == '_' || c == ':' || c == '!';
        let words: Vec<&str> = rest.split(|c| !is_name(c)).filter(|w| !w.is_empty()).collect();
        for pair in words.windows(2) {
            let declares =
                ["fn", "struct", "enum", "type", "const", "static", "trait", "mod", "macro_rules!"].contains(&pair[0]);
            if declares {
                module.items.insert(pair[1].trim_matches(':').to_string());
            }
        }
        module.paths = words.iter().map(|w| segments(w)).filter(|p| p.len() > 1).collect();
        module
    }
}

/// The files of a package as modules, by path; the roots are empty paths.
struct Package {
    name: &'static str,
    modules: BTreeMap<Vec<String>, Module>,
}

impl Package {
    fn read((folder, name): (&'static str, &'static str)) -> Self {
        let src = root().join(folder).join("src");
        let mut modules = BTreeMap::new();
        for path in files(&src) {
            let inner = path.strip_prefix(&src).expect("a file of the folder").with_extension("");
            let mut at: Vec<String> = inner.iter().map(|s| s.to_string_lossy().into_owned()).collect();
            at.pop_if(|last| last == "mod" || last == "lib");
            modules.insert(at, Module::of(&read(&path)));
        }
        Self { name, modules }
    }

    /// Where a path begins that is written in a module, and what of it is left.
    fn begin(&self, module: &[String], path: &[String]) -> Option<(Vec<String>, Vec<String>)> {
        let mut at = if module == ["main"] { Vec::new() } else { module.to_vec() };
        let first = path.first()?;
        if first == "crate" || first == self.name {
            return Some((Vec::new(), path[1..].to_vec()));
        }
        let up = path.iter().take_while(|s| *s == "super" || *s == "self").count();
        path[..up].iter().filter(|s| *s == "super").for_each(|_| _ = at.pop());
        let child = [&at[..], &path[up..=up.min(path.len() - 1)]].concat();
        (up > 0 || self.modules.contains_key(&child)).then(|| (at, path[up..].to_vec()))
    }

    /// The module that declares what a path leads to: imports on the way are followed.
    fn resolve(&self, (mut at, path): (Vec<String>, Vec<String>), depth: usize) -> Option<Vec<String>> {
        let mut left = &path[..];
        while let Some((next, more)) = left.split_first() {
            let child = [&at[..], std::slice::from_ref(next)].concat();
            if !self.modules.contains_key(&child) {
                break;
            }
            (at, left) = (child, more);
        }
        let (Some(module), Some((name, more))) = (self.modules.get(&at), left.split_first()) else { return Some(at) };
        if depth > 0 && !module.items.contains(name) {
            for (as_name, from) in &module.imports {
                let Some((start, mut rest)) = self.begin(&at, from) else { continue };
                if as_name == name {
                    rest.extend_from_slice(more);
                    return self.resolve((start, rest), depth - 1);
                }
                if as_name == "*" {
                    rest.pop();
                    rest.push(name.clone());
                    let found = self.resolve((start, rest), depth - 1)?;
                    if self.modules[&found].items.contains(name) {
                        return Some(found);
                    }
                }
            }
        }
        Some(at)
    }

    /// The modules that one needs, its own ancestors apart.
    fn needs(&self, at: &Vec<String>) -> BTreeSet<Vec<String>> {
        let module = &self.modules[at];
        let mut found = BTreeSet::new();
        let mut add = |path: Option<(Vec<String>, Vec<String>)>| {
            let target = path.and_then(|path| self.resolve(path, 8));
            found.extend(target.filter(|target| target != at && !at.starts_with(target)));
        };
        for ((_, path), is_public) in module.imports.iter().zip(&module.is_public) {
            if !is_public {
                add(self.begin(at, path));
            }
        }
        for path in &module.paths {
            let imported = module.imports.iter().find(|(name, _)| *name == path[0]);
            add(match imported {
                Some((_, from)) => self.begin(at, &[from, &path[1..]].concat()),
                None => self.begin(at, path),
            });
        }
        found
    }
}

/// No files need one another in a circle. A file may need the module that it is a part of, whatever that needs of it,
/// and what a module hands on from its parts is theirs.
#[test]
fn files_need_one_another_in_no_circle() {
    let mut report = String::new();
    for package in PACKAGES {
        let package = Package::read(package);
        let mut graph: Graph<&Vec<String>, ()> = Graph::new();
        let nodes: BTreeMap<&Vec<String>, NodeIndex> =
            package.modules.keys().map(|at| (at, graph.add_node(at))).collect();
        for (at, node) in &nodes {
            for target in package.needs(at) {
                graph.add_edge(*node, nodes[&target], ());
            }
        }
        for circle in tarjan_scc(&graph).into_iter().filter(|circle| circle.len() > 1) {
            let _ = writeln!(report, "{}:", package.name);
            for node in &circle {
                let within = graph.neighbors(*node).filter(|to| circle.contains(to));
                let list: Vec<String> = within.map(|to| graph[to].join("/")).collect();
                let _ = writeln!(report, "    {} needs {}", graph[*node].join("/"), list.join(", "));
            }
        }
    }
    assert!(report.is_empty(), "files need one another in a circle\n{report}");
}

/// The function that a line begins: its name and how far the line is set in.
fn function(line: &str) -> Option<(&str, usize)> {
    let start = line.trim_start();
    let mut rest = start;
    loop {
        let word = rest.split([' ', '(']).next().unwrap_or_default();
        match word {
            "fn" => {
                let name = rest[3..].split(['(', '<']).next()?;
                return Some((name, line.len() - start.len()));
            }
            "pub" if rest.starts_with("pub(") => rest = rest.split_once(") ")?.1,
            "pub" | "const" | "unsafe" | "async" => rest = rest.split_once(' ')?.1,
            "extern" => rest = rest.split_once("\" ")?.1,
            _ => return None,
        }
    }
}

#[test]
fn no_function_is_too_long_to_be_read() {
    let mut report = String::new();
    let packages = PACKAGES.map(|(folder, _)| format!("{folder}/src"));
    for folder in packages.iter().map(String::as_str).chain(["fuzz/src", "fuzz/targets"]) {
        for path in files(&root().join(folder)) {
            let text = read(&path);
            let lines: Vec<&str> = text.lines().collect();
            for (i, line) in lines.iter().enumerate() {
                let Some((name, indent)) = function(line).filter(|_| !line.ends_with(';')) else { continue };
                let close = format!("{}}}", " ".repeat(indent));
                let count = 1 + lines[i..].iter().position(|l| *l == close).unwrap_or(0);
                let path = path.strip_prefix(root()).unwrap_or(&path);
                let place = format!("{name} in {}", path.display());
                if count > MAX_FUNCTION_LINES {
                    let _ = writeln!(report, "    {count} lines: {place}");
                }
            }
        }
    }
    assert!(report.is_empty(), "functions of more than {MAX_FUNCTION_LINES} lines\n{report}");
}

#[test]
fn comments_have_short_lines() {
    let mut report = String::new();
    for folder in ["grammar", "runtime", "compiler", "cli", "tests", "fuzz"] {
        for path in files(&root().join(folder)) {
            let name = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
            if name.contains("/target/") {
                continue;
            }
            for (i, line) in read(&path).lines().enumerate().filter(|(_, line)| line.chars().count() > MAX_LINE) {
                // rustfmt breaks code where it can, but no comments; rows of tables cannot be broken.
                let is_table = line.trim_start().trim_start_matches(['/', '!', ' ']).starts_with('|');
                if line.trim_start().starts_with("//") && !is_table {
                    let _ = writeln!(report, "    {name}:{}: {} characters", i + 1, line.chars().count());
                }
            }
        }
    }
    assert!(report.is_empty(), "comments with lines of more than {MAX_LINE} characters\n{report}");
}
