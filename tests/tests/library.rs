//! The bundled library: each of its parts says what it is, can be used as it is, and has a scene that expects something
//! of it.

use crate::common::{files, models, read, texts};
use bond::Options;
use bond_compiler::elaborate::LIBRARY;
use bond_grammar::ast::{self, End, File, Item, Model, Statement, StatementKind};
use bond_grammar::source::Sources;

fn parsed(name: &str, text: &str) -> File {
    let mut sources = Sources::new();
    let id = sources.add(name, text);
    let (file, errors) = bond_grammar::parse(&sources, id);
    let errors: Vec<String> = errors.iter().map(|e| e.render(&sources)).collect();
    assert!(errors.is_empty(), "{}\n{text}", errors.concat());
    file
}

fn parts(file: &File) -> Vec<&Model> {
    let mut list = Vec::new();
    for item in &file.items {
        match item {
            Item::Model(m) => list.push(m),
            Item::Use(_) | Item::Function(_) => {}
        }
    }
    list
}

/// All parts: library and model.
fn all() -> Vec<(&'static str, Model)> {
    let of = |(name, text): &(&'static str, &str)| {
        let file = parsed(name, text);
        parts(&file).into_iter().map(|m| (*name, m.clone())).collect::<Vec<_>>()
    };
    LIBRARY.iter().flat_map(of).collect()
}

/// The kinds of all elements and instances of a model, those in blocks too.
fn kinds(body: &[Statement], found: &mut Vec<String>) {
    ast::each_statement(body, &mut |s| {
        if let StatementKind::Element(e) = &s.kind {
            found.push(e.kind.text.clone());
        }
        if let StatementKind::Chain(chain) = &s.kind {
            found.extend(chain.groups.iter().flatten().filter_map(|end| match end {
                End::Declare(e) => Some(e.kind.text.clone()),
                End::Path(_) => None,
            }));
        }
    });
}

#[test]
fn every_file_is_bundled_and_has_its_scenes() {
    let bundled: Vec<&str> = LIBRARY.iter().map(|l| l.0).collect();
    for folder in ["library", "components"] {
        let names: Vec<String> =
            files(folder).iter().map(|p| p.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
        assert_eq!(names, bundled, "models/{folder}");
    }
    for (name, text) in LIBRARY {
        assert_eq!(
            text,
            read(&models().join("library").join(format!("{name}.bond"))),
            "{name} is built from an old text"
        );
    }
}

/// A file may use several libraries, and would take the last of two parts with one name.
#[test]
fn names_are_given_once() {
    let mut names: Vec<String> = all().into_iter().map(|(_, m)| m.name.text).collect();
    names.sort();
    for pair in names.windows(2) {
        assert_ne!(pair[0], pair[1], "two parts have one name");
    }
}

#[test]
fn every_part_has_a_doc_with_an_example() {
    for (library, m) in all() {
        let name = &m.name.text;
        let first: Vec<&str> = m.docs.iter().map(String::as_str).take_while(|l| !l.is_empty()).collect();
        assert!(!first.is_empty(), "std.{library}.{name} has no doc");
        let first = first.join(" ");
        let sentence = first.split_once(". ").map_or(first.as_str(), |(head, _)| head);
        assert!(sentence.chars().count() <= 100, "std.{library}.{name}: the first sentence is too long for a list");
        let example: Vec<&str> = m.docs.iter().filter_map(|l| l.strip_prefix("    ")).collect();
        let file = parsed(name, &format!("model Example {{\n{}\n}}", example.join("\n")));
        let mut used = Vec::new();
        kinds(&parts(&file)[0].body, &mut used);
        assert!(used.contains(name), "std.{library}.{name}: the example has no {name}");
    }
}

#[test]
fn every_parameter_has_a_default() {
    for (library, m) in all() {
        for p in &m.params {
            assert!(p.default.is_some(), "std.{library}.{}: {} has no default", m.name.text, p.name.text);
        }
        let gives = |s: &&Statement| matches!(s.kind, StatementKind::Port(..) | StatementKind::Output(_));
        let ports = m.body.iter().filter(gives).count();
        assert!(ports > 0, "std.{library}.{} has neither a port nor an output", m.name.text);
    }
}

/// Its expectations are held in `expectations`.
#[test]
fn every_part_has_a_scene_that_expects_something() {
    for (path, text) in texts("components") {
        for m in parts(&parsed(&path.display().to_string(), &text)) {
            let expects = m.body.iter().filter(|s| matches!(s.kind, StatementKind::Expect(_))).count();
            assert!(expects > 0 && !m.docs.is_empty(), "{}: {} expects nothing", path.display(), m.name.text);
        }
    }
    for (library, m) in all() {
        let path = models().join("components").join(format!("{library}.bond"));
        let mut used = Vec::new();
        for scene in parts(&parsed(library, &read(&path))) {
            kinds(&scene.body, &mut used);
        }
        assert!(used.contains(&m.name.text), "no scene of {} has a {}", path.display(), m.name.text);
    }
}

#[test]
fn an_unknown_library_is_told() {
    let wrong =
        match Options::new().compile_str("t.bond", "use std.electric\nmodel M { Se:u = 1 V R:r = 1 Ohm u -> r }") {
            Ok(_) => panic!("there is no such library"),
            Err(wrong) => wrong.to_string(),
        };
    assert!(wrong.contains("did you mean `use std.electrical`?"), "{wrong}");
}
