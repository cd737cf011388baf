//! Follows `use`: from one source to all files that it needs.

use super::library::LIBRARY;
use super::suggest::nearest;
use bond_grammar::ast::{self, File, Item, Name, StatementKind, UseTarget};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{SourceId, Sources, Span};
use rustc_hash::FxHashMap;

/// Gives the text of a used file. The compiler itself opens no files.
pub trait Loader {
    /// Name (as it is to be shown, and told apart) and text of `path`, which the file called `from` uses.
    ///
    /// # Errors
    /// A few words about why it can't be had.
    fn load(&mut self, from: &str, path: &str) -> Result<(String, String), String>;
}

/// A loader for models that use no files.
pub struct NoFiles;

impl Loader for NoFiles {
    fn load(&mut self, _: &str, _: &str) -> Result<(String, String), String> {
        Err("this model was not read from a file".into())
    }
}

/// A model, by its file and its place among the file's items.
pub type ModelRef = (usize, usize);

/// What a name of a file means: what the file itself declares by it, or else what the files declare that it uses.
pub type Named = FxHashMap<String, Vec<ModelRef>>;

/// All files of a compilation; the first is the one asked for.
#[derive(Debug, Default)]
pub struct Files {
    /// Their trees.
    pub list: Vec<File>,
    /// For each file the models that can be named in it: its own and those of the files it uses.
    pub visible: Vec<Named>,
    /// The same of functions.
    pub functions: Vec<Named>,
    /// Whether some of what could be named in a file could not be read, which is said.
    pub gaps: Vec<bool>,
}

impl Files {
    /// The model with this reference.
    pub fn model(&self, (file, item): ModelRef) -> Option<&bond_grammar::ast::Model> {
        match self.list.get(file)?.items.get(item)? {
            Item::Model(m) => Some(m),
            Item::Use(_) | Item::Function(_) => None,
        }
    }

    /// The name of an item, where it is declared.
    fn name(&self, (file, item): ModelRef) -> Option<&Name> {
        match self.list.get(file)?.items.get(item)? {
            Item::Model(m) => Some(&m.name),
            Item::Function(f) => Some(&f.name),
            Item::Use(_) => None,
        }
    }

    /// That a name means what several used files declare.
    pub(super) fn ambiguous(&self, sources: &Sources, what: &str, name: &Name, all: &[ModelRef]) -> Diagnostic {
        let places: Vec<Span> = all.iter().filter_map(|item| Some(self.name(*item)?.span)).collect();
        let files: Vec<String> = places.iter().map(|p| format!("\"{}\"", sources.get(p.source).name)).collect();
        let message = format!("`{}` is a {what} of several used files: {}", name.text, files.join(" and "));
        let error = Diagnostic::error("elaborate::ambiguous", name.span, message);
        let error = places.into_iter().fold(error, |error, place| error.label(place, "is one of them"));
        error.help("rename one of them, or use one of the files only; what this file declares itself would come first")
    }

    /// The last model of the file asked for, which is its scene, and others that may be meant as one: they have no
    /// port, and outputs, settings or expectations or else, which is said, an instance of the last one. What that is
    /// made of is none.
    pub fn other_scenes(&self) -> (Option<&str>, Vec<(&str, bool)>) {
        let models: Vec<&ast::Model> =
            self.list.first().into_iter().flat_map(|file| &file.items).filter_map(model).collect();
        let Some((last, others)) = models.split_last() else { return (None, Vec::new()) };
        let named = |name: &str| models.iter().find(|m| m.name.text == name).copied();
        // What a model is made of, in this file.
        let parts = |of: &ast::Model| -> Vec<String> {
            let (mut open, mut found) = (vec![of.name.text.clone()], Vec::new());
            while let Some(name) = open.pop() {
                let Some(m) = named(&name) else { continue };
                ast::each_statement(&m.body, &mut |s| {
                    let StatementKind::Element(e) = &s.kind else { return };
                    if named(&e.kind.text).is_some() && !found.contains(&e.kind.text) {
                        found.push(e.kind.text.clone());
                        open.push(e.kind.text.clone());
                    }
                });
            }
            found
        };
        let own = parts(last);
        let scenes = others.iter().filter(|m| m.name.text != last.name.text && !own.contains(&m.name.text));
        let scenes = scenes.filter_map(|m| {
            let (mut port, mut scene) = (false, false);
            ast::each_statement(&m.body, &mut |s| {
                port |= matches!(s.kind, StatementKind::Port(..));
                scene |=
                    matches!(s.kind, StatementKind::Probe(..) | StatementKind::Simulate(_) | StatementKind::Expect(_));
            });
            let uses = parts(m).contains(&last.name.text);
            (!port && (scene || uses)).then_some((m.name.text.as_str(), uses))
        });
        (Some(&last.name.text), scenes.collect())
    }

    /// The functions of a file, with their places.
    pub fn functions_of(&self, file: usize) -> impl Iterator<Item = (usize, &bond_grammar::ast::Function)> {
        let items = self.list.get(file).map(|f| f.items.as_slice()).unwrap_or(&[]);
        items.iter().enumerate().filter_map(|(i, item)| match item {
            Item::Function(f) => Some((i, f)),
            Item::Use(_) | Item::Model(_) => None,
        })
    }
}

/// The model that an item is.
fn model(item: &Item) -> Option<&ast::Model> {
    match item {
        Item::Model(m) => Some(m),
        Item::Use(_) | Item::Function(_) => None,
    }
}

struct Loading<'a> {
    sources: &'a mut Sources,
    loader: &'a mut dyn Loader,
    errors: &'a mut Vec<Diagnostic>,
    files: Files,
    known: FxHashMap<String, usize>,
    open: Vec<String>,
}

/// Parses a source and everything it uses.
pub fn load(sources: &mut Sources, main: SourceId, loader: &mut dyn Loader, errors: &mut Vec<Diagnostic>) -> Files {
    let name = sources.get(main).name.clone();
    let mut loading =
        Loading { sources, loader, errors, files: Files::default(), known: FxHashMap::default(), open: vec![] };
    loading.file(main, name);
    loading.files
}

impl Loading<'_> {
    fn file(&mut self, id: SourceId, name: String) -> usize {
        let (file, mut wrong) = bond_grammar::parse_with_units(self.sources, id, &crate::units::is_unit);
        self.errors.append(&mut wrong);
        let at = self.files.list.len();
        self.known.insert(name.clone(), at);
        self.files.list.push(file.clone());
        self.files.visible.push(FxHashMap::default());
        self.files.functions.push(FxHashMap::default());
        self.files.gaps.push(file.gaps);
        self.open.push(name);
        let (mut visible, mut functions) = (Named::default(), Named::default());
        for item in &file.items {
            let Item::Use(u) = item else { continue };
            let Some(used) = self.used(id, &u.target, u.span) else {
                self.files.gaps[at] = true;
                continue;
            };
            self.files.gaps[at] |= self.files.list[used].gaps;
            for (i, item) in self.files.list[used].items.iter().enumerate() {
                if let Item::Model(m) = item {
                    known(&mut visible, &m.name.text, (used, i));
                }
            }
            for (i, f) in self.files.functions_of(used) {
                known(&mut functions, &f.name.text, (used, i));
            }
        }
        let mut own: FxHashMap<&str, Span> = FxHashMap::default();
        for (i, item) in file.items.iter().enumerate() {
            let Item::Model(m) = item else { continue };
            if let Some(first) = own.insert(&m.name.text, m.name.span) {
                self.errors.push(twice("model", &m.name, first));
            }
            let name = &m.name.text;
            if crate::element::is_kind(name) {
                let message = format!("`{name}` is a kind of element, and cannot be the name of a model");
                self.errors.push(
                    Diagnostic::error("elaborate::kind", m.name.span, message)
                        .help(format!("`{name}:x` would be that element: choose another name, such as `My{name}`")),
                );
            }
            visible.insert(m.name.text.clone(), vec![(at, i)]);
        }
        let mut own: FxHashMap<&str, Span> = FxHashMap::default();
        for (i, f) in self.files.functions_of(at) {
            if let Some(first) = own.insert(&f.name.text, f.name.span) {
                self.errors.push(twice("function", &f.name, first));
            }
            functions.insert(f.name.text.clone(), vec![(at, i)]);
        }
        self.files.visible[at] = visible;
        self.files.functions[at] = functions;
        self.open.pop();
        at
    }

    fn used(&mut self, from: SourceId, target: &UseTarget, span: Span) -> Option<usize> {
        let (name, text) = match target {
            UseTarget::Library(path) => library(path, span).map_err(|e| self.errors.push(e)).ok()?,
            UseTarget::File(path) => {
                let from = self.sources.get(from).name.clone();
                match self.loader.load(&from, path) {
                    Ok(found) => found,
                    Err(why) => {
                        self.errors.push(
                            Diagnostic::error("elaborate::use", span, format!("cannot use \"{path}\": {why}"))
                                .help("the path is relative to the file that says `use`"),
                        );
                        return None;
                    }
                }
            }
        };
        if let Some(i) = self.open.iter().position(|o| *o == name) {
            let chain: Vec<&str> = self.open[i..].iter().map(String::as_str).chain([name.as_str()]).collect();
            self.errors.push(
                Diagnostic::error("elaborate::cycle", span, format!("cyclic use: {}", chain.join(" uses ")))
                    .help("move what both need into a third file"),
            );
            return None;
        }
        if let Some(&at) = self.known.get(&name) {
            return Some(at);
        }
        if self.open.len() >= 64 {
            self.errors.push(Diagnostic::error("elaborate::limit", span, "`use` is nested more than 64 deep"));
            return None;
        }
        let id = self.sources.add(name.clone(), text);
        Some(self.file(id, name))
    }
}

/// Name and text of a bundled library.
fn library(path: &[Name], span: Span) -> Result<(String, String), Diagnostic> {
    let words: Vec<&str> = path.iter().map(|n| n.text.as_str()).collect();
    let known = || LIBRARY.iter().map(|l| format!("std.{}", l.0)).collect::<Vec<_>>().join(", ");
    if let ["std", name] = words[..]
        && let Some((name, text)) = LIBRARY.iter().find(|l| l.0 == name)
    {
        return Ok((format!("std/{name}.bond"), (*text).to_string()));
    }
    Err(Diagnostic::error("elaborate::use", span, format!("there is no library `{}`", words.join("."))).help(
        match nearest(words.last().unwrap_or(&""), LIBRARY.iter().map(|l| l.0)) {
            Some(near) => format!("did you mean `use std.{near}`?"),
            None => format!("the bundled ones are {}; a file is used by its path in quotes", known()),
        },
    ))
}

/// Makes an item of a used file known by its name. A file that is used twice is one file, and of two items of one file
/// that have one name, which is said, the last is meant.
fn known(names: &mut Named, name: &str, item: ModelRef) {
    let all = names.entry(name.to_string()).or_default();
    match all.iter_mut().find(|other| other.0 == item.0) {
        Some(same) => *same = item,
        None => all.push(item),
    }
}

fn twice(what: &str, name: &Name, first: Span) -> Diagnostic {
    Diagnostic::error("elaborate::twice", name.span, format!("the {what} `{}` is declared twice", name.text))
        .label(first, "is the first one")
        .help("rename one of them")
}
