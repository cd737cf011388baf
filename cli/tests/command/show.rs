use super::{Folder, OSCILLATOR, WRONG};

#[test]
fn all_parts_are_shown_in_the_formats_that_have_them() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for what in ["all", "graph", "causality", "phs", "regions", "program"] {
        for format in ["text", "json", "dot", "svg", "latex"] {
            let done = here.bond(&["show", "a.bond", what, "--as", format]);
            match done.status {
                0 => assert!(!done.out.is_empty() && done.out.ends_with('\n'), "{what} {format}"),
                2 => assert!(done.err.contains(format), "{done:?}"),
                _ => panic!("{done:?}"),
            }
        }
    }
    here.bond(&["show", "a.bond"]).is(0, &["Oscillator", "spring"], &[]);
    let done = here.bond(&["show", "a.bond", "phs", "--as", "json"]).is(0, &[], &[]);
    let json: serde_json::Value = serde_json::from_str(&done.out).unwrap();
    assert_eq!(json["regions"][0]["states"].as_array().unwrap().len(), 2);
    // All of it has what each part has.
    let held = "model Held { I:m = 1 kg; 1:v -> m; sampled at 1 kHz { C:k = 1 m/N } v ||> k }";
    let done = here.with("b.bond", held).bond(&["show", "b.bond", "--as", "json"]).is(0, &[], &[]);
    let json: serde_json::Value = serde_json::from_str(&done.out).unwrap();
    assert_eq!((json["bars"].as_array().unwrap().len(), json["regions"].as_array().unwrap().len()), (1, 2));
}

#[test]
fn it_goes_to_a_file_too() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    assert_eq!(here.bond(&["show", "a.bond", "graph", "--as", "svg", "-o", "a.svg"]).is(0, &[], &[]).out, "");
    assert!(here.read("a.svg").contains("<svg"));
    here.bond(&["show", "a.bond", "-o", "none/a.txt"]).is(2, &[], &["cannot write"]);
    here.bond(&["show", "a.bond", "-o", "."]).is(2, &[], &["directory"]);
    here.bond(&["show", "a.bond", "graph", "--as", "svg", "-o", "a.png"]).is(2, &[], &["does not write .png", ".svg"]);
    here.bond(&["show", "a.bond", "--as", "text", "-o", "a.svg"]).is(2, &[], &["does not write .svg", "name it .txt"]);
    // The name says the format.
    for (name, start) in [("b.svg", "<svg"), ("b.json", "{"), ("b.dot", "digraph"), ("b.tex", "% \\usepackage{tikz}")] {
        here.bond(&["show", "a.bond", "graph", "-o", name]).is(0, &[], &[]);
        assert!(here.read(name).starts_with(start), "{name}: {}", here.read(name));
    }
    here.bond(&["show", "a.bond", "-o", "c.svg", "--labels", "variables", "--depth", "0"]).is(0, &[], &[]);
    assert!(here.read("c.svg").contains(".e</text>"));
    assert_eq!(here.list(), ["a.bond", "a.svg", "b.dot", "b.json", "b.svg", "b.tex", "c.svg"]);
}

#[test]
fn what_is_wrong_is_told() {
    let here = Folder::new().with("a.bond", WRONG).with("b.bond", OSCILLATOR);
    assert_eq!(here.bond(&["show", "a.bond", "-o", "a.txt"]).is(1, &[], &["a.bond:3:"]).out, "");
    here.bond(&["show", "b.bond", "phsx"]).is(2, &[], &["phs"]);
    here.bond(&["show", "b.bond", "--as", "pdf"]).is(2, &[], &["svg"]);
    here.bond(&["show", "b.bond", "--model", "Other"]).is(2, &[], &["Oscillator"]);
    here.bond(&["show", "b.bond", "--set", "q=1"]).is(2, &[], &["there is no parameter"]);
    assert_eq!(here.list(), ["a.bond", "b.bond"]);
}
