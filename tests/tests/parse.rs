//! Text to tree and back.

use crate::common::texts;
use bond_grammar::ast::File;
use bond_grammar::source::Sources;

fn parsed(name: &str, text: &str) -> (Sources, File, Vec<String>) {
    let mut sources = Sources::new();
    let id = sources.add(name, text);
    let (file, errors) = bond_grammar::parse(&sources, id);
    let errors = errors.iter().map(|e| e.render(&sources)).collect();
    (sources, file, errors)
}

/// The canonical layout.
fn laid_out(name: &str, text: &str) -> String {
    let (sources, file, errors) = parsed(name, text);
    assert!(errors.is_empty(), "{name}: {}", errors.join(""));
    bond_grammar::format(&sources, file.span.source, &file)
}

/// A tree without places and comments.
fn shape(file: &File) -> String {
    let mut file = file.clone();
    file.comments.clear();
    let text = format!("{file:?}");
    let mut shape = String::new();
    let mut rest = text.as_str();
    while let Some(at) = rest.find("Span { source") {
        shape.push_str(&rest[..at]);
        let end = rest[at..].find('}').map_or(rest.len(), |e| at + e + 1);
        rest = &rest[end..];
    }
    shape + rest
}

#[test]
fn the_layout_of_every_model_is_stable_and_means_the_same() {
    for folder in ["components", "examples", "elements", "library"] {
        for (path, text) in texts(folder) {
            let name = path.display().to_string();
            let first = laid_out(&name, &text);
            assert_eq!(first, laid_out(&name, &first), "{name}: the layout is not stable");
            let (_, a, _) = parsed(&name, &text);
            let (_, b, _) = parsed(&name, &first);
            assert_eq!(shape(&a), shape(&b), "{name}: the layout changes the meaning");
            let comments = |f: &File| f.comments.iter().map(|c| c.text.clone()).collect::<Vec<_>>();
            assert_eq!(comments(&a).len(), comments(&b).len(), "{name}: a comment is lost");
        }
    }
}

/// Models stand in their canonical layout already.
#[test]
fn every_model_is_laid_out() {
    for folder in ["components", "examples", "elements", "library"] {
        for (path, text) in texts(folder) {
            assert_eq!(text, laid_out(&path.display().to_string(), &text), "{} is not laid out", path.display());
        }
    }
}

#[test]
fn trees() {
    for (name, text) in [
        ("chain", "model M { F -> 1:v -> mass, spring\n v ||> wall.tip\n a ->| b\n a |-> b\n a -[name]-> b }"),
        (
            "quantities",
            "model M(k = 1.5e3 kg*m^2, u = 10 N / m) { Se:F = 6 V * sin(t)  R:r { f = if e > 0 then e^2 else -e } }",
        ),
        (
            "sampled",
            "model M { sampled every 40 ms hold lagged budget off { Wall:w(k = 1 N/m) }\n sampled at 1 kHz method ray { C:c[i] = 1 F } }",
        ),
    ] {
        let (_, file, errors) = parsed(name, text);
        assert!(errors.is_empty(), "{}", errors.join(""));
        insta::assert_snapshot!(format!("tree_{name}"), format!("{text}\n---\n{}", shape(&file)));
    }
}

#[test]
fn layouts() {
    let text = "//! doc\nuse   std.contact;use \"a.bond\"\n/// wall\nmodel   M(k=1 N/m,b=2 N*s/m){ // why\nI:mass={inertia=1 kg;p0=0}\nC:c{H=if q>0 then 0.5*k*q^2 else 0;q0=-0.1 m}\nfor i in 1..3{R:r[i]=b node[i-1]->1:s[i]->r[i]}if k>0{Se:f=1 N}else{Sf:g=1 m/s}\nprobe x=integral(v.f,-0.1 m)\nexpect x at 5 s=0.005 m within 1e-6 m\nsimulate{stop=10 s;step=1 ms} }";
    let text = text.replace("I:mass={", "I:mass{");
    insta::assert_snapshot!("layout", laid_out("layout.bond", &text));
}

/// A keyword is never read as a unit, and newlines separate nothing: any statement may follow a bare number on its
/// line.
#[test]
fn statements_follow_numbers() {
    let starts =
        ["input b = 2", "let b = 2", "probe b = 2", "state b = 2 { rate = 1 Hz }", "port b", "for k in 1..2 { }"];
    for next in starts {
        let (_, file, errors) = parsed("line", &format!("model M {{ let a = 1 {next} }}"));
        assert!(errors.is_empty(), "{next}: {}", errors.join(""));
        let (_, apart, _) = parsed("lines", &format!("model M {{ let a = 1\n {next} }}"));
        assert_eq!(shape(&file), shape(&apart), "{next}");
    }
}
