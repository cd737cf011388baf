//! What is said of wrong models. Each file of `models/invalid/` ends with what it must bring, one line an error:
//! `//~ LINE error[CODE] "words" "words"`, all of the words in its message, labels or help, in the order of the file's
//! errors.

use crate::common::{errors, texts, title};
use bond::Options;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Sources;

/// What a line of a file asks for.
struct Wanted {
    line: usize,
    code: String,
    words: Vec<String>,
}

fn wanted(text: &str) -> Vec<Wanted> {
    let one = |line: &str| -> Option<Wanted> {
        let rest = line.strip_prefix("//~ ")?;
        let (number, rest) = rest.split_once(" error[")?;
        let (code, rest) = rest.split_once(']')?;
        let words = rest.split('"').skip(1).step_by(2).map(str::to_string).collect();
        Some(Wanted { line: number.parse().ok()?, code: code.to_string(), words })
    };
    let lines: Vec<&str> = text.lines().filter(|l| l.starts_with("//~")).collect();
    let read: Vec<Wanted> = lines.iter().filter_map(|l| one(l)).collect();
    assert_eq!(lines.len(), read.len(), "a line that begins with //~ cannot be read");
    read
}

fn rendered(d: &Diagnostic, sources: &Sources) -> String {
    d.render(sources).replace("../models/", "models/")
}

fn check(file: &std::path::Path, text: &str) -> String {
    let title = title(file);
    let list = match Options::new().compile_file(file) {
        Ok(_) => panic!("{title} compiles, and should not"),
        Err(list) => list,
    };
    let all: Vec<String> = list.list().iter().map(|d| rendered(d, list.sources())).collect();
    let wanted = wanted(text);
    assert!(!wanted.is_empty(), "{title} does not say what it must bring");
    assert_eq!(wanted.len(), all.len(), "{title} brings another number of errors:\n{}", all.join(""));
    for ((w, d), text) in wanted.iter().zip(list.list()).zip(&all) {
        let line = d.labels.first().map(|l| list.sources().position(l.span).0);
        assert_eq!(line, Some(w.line), "{title}: another line:\n{text}");
        assert_eq!(d.code, w.code, "{title}: another code:\n{text}");
        for word in &w.words {
            assert!(text.contains(word.as_str()), "{title}: {word} is not said:\n{text}");
        }
        assert!(d.help.is_some(), "{title}: there is no mend:\n{text}");
    }
    all.join("")
}

#[test]
fn every_invalid_model_brings_what_it_says() {
    for (path, text) in texts("invalid") {
        let all = check(&path, &text);
        insta::assert_snapshot!(title(&path).replace('/', "_"), all);
    }
}

/// An error of a used file is told in that file.
#[test]
fn errors_of_used_files_are_told_there() {
    let path = crate::common::models().join("invalid/cycle_a.bond");
    let list = Options::new().compile_file(path).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(list.contains("cycle_b.bond:2:1"), "{list}");
}

#[test]
fn empty_and_odd_texts_are_refused() {
    for text in ["", "\n", "model", "}", "\u{feff}", "model M(", "\0", "🙂"] {
        let list = errors(text);
        assert!(!list.list().is_empty());
    }
}

/// Parameters that are no numbers to compute with.
#[test]
fn hostile_parameters_end_in_errors_or_finite_runs() {
    let text = "model M(m = 1 kg, k = 1 N/m) {
      I:mass { inertia = m;  f0 = 1 m/s }
      C:spring { stiffness = k }
      R:drag = 1 N*s/m
      1:v -> mass, spring, drag
      probe x = spring.q
    }";
    let mut ran = 0;
    for m in ["0", "-1", "1e-300", "1e300", "nan", "inf", "1e-320"] {
        for k in ["1", "1e300", "1e-300"] {
            for method in ["exact", "gonzalez", "rk4"] {
                let options = Options::new().set("m", m).set("k", k).method(method);
                let Ok(compiled) = options.compile_str("m.bond", text) else { continue };
                let Ok(mut sim) = compiled.simulate(bond::Steps::fixed(0.01)) else { continue };
                let Ok(()) = sim.finish(1.0) else { continue };
                let x = sim.probe("x").unwrap_or(f64::NAN);
                assert!(x.is_finite(), "m = {m}, k = {k}, {method}: x = {x}, and nobody says so");
                ran += 1;
            }
        }
    }
    assert!(ran > 0, "none runs to its end");
}
