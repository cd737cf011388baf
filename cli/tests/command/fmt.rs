use super::{Folder, OSCILLATOR};

const CRAMPED: &str = "model A{I:m=1 kg\nSe:F=1 N // push\nF->m}";

#[test]
fn files_are_laid_out_in_place() {
    let here = Folder::new().with("a.bond", CRAMPED).with("b.bond", OSCILLATOR);
    here.bond(&["fmt", "--check", "a.bond", "b.bond"]).is(1, &["a.bond\n"], &[]);
    assert_eq!(here.read("a.bond"), CRAMPED);
    here.bond(&["fmt", "a.bond", "b.bond"]).is(0, &[], &[]);
    assert!(here.read("a.bond").contains("// push"));
    assert_eq!(here.read("b.bond"), OSCILLATOR);
    here.bond(&["fmt", "--check", "a.bond", "b.bond"]).is(0, &[], &[]);
    assert_eq!(here.list(), ["a.bond", "b.bond"]);
}

#[test]
fn standard_input_goes_to_standard_output() {
    let here = Folder::new();
    assert_eq!(here.fed(&["fmt", "-"], OSCILLATOR).is(0, &[], &[]).out, OSCILLATOR);
    here.fed(&["fmt", "--check", "-"], CRAMPED).is(1, &["<stdin>"], &[]);
}

#[test]
fn wrong_files_are_left_alone() {
    let wrong = "model A { I:m = }";
    let here = Folder::new().with("a.bond", wrong).with("b.bond", CRAMPED).with("c.bond", b"model A { \xff }");
    here.bond(&["fmt", "a.bond", "c.bond", "b.bond"]).is(1, &[], &["a.bond:1:", "c.bond:1:", "UTF-8"]);
    assert_eq!(here.read("a.bond"), wrong);
    assert_ne!(here.read("b.bond"), CRAMPED);
    here.bond(&["fmt", "."]).is(2, &[], &["directory"]);
}

/// A product behind a unit stays as it is written, and means the same.
#[test]
fn products_behind_units_stay() {
    let model =
        |e: &str| format!("model M(x = 2, m = 3) {{\n  Se:u = 1 V\n  R:r = 1 Ohm\n  u -> r\n  probe y = {e}\n}}\n");
    for (text, laid_out) in [
        ("6 V*x", "6 V*x"),
        ("6 V*x^(1/2)*exp(-x)", "6 V*x^(1/2)*exp(-x)"),
        ("6 V*x^2^x/x^-1", "6 V*x^2^x/x^-1"),
        ("6 V/2 s*x", "6 V/2 s*x"),
        ("6 V * m", "6 V * m"),
        ("6 V*( m )", "6 V * (m)"),
        ("6 V/(m*x)", "6 V / (m*x)"),
        ("6 V*r.e", "6 V*r.e"),
    ] {
        let here = Folder::new().with("a.bond", model(text));
        let value = |here: &Folder| here.bond(&["run", "a.bond"]).is(0, &[], &[]).out;
        let last = |out: String| out.lines().last().unwrap_or_default().to_string();
        let before = last(value(&here));
        here.bond(&["fmt", "a.bond"]).is(0, &[], &[]);
        assert_eq!(here.read("a.bond"), model(laid_out));
        assert_eq!(last(value(&here)), before, "{text}");
        here.bond(&["fmt", "--check", "a.bond"]).is(0, &[], &[]);
    }
}

#[cfg(unix)]
#[test]
fn links_and_permissions_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let here = Folder::new().with("a.bond", CRAMPED);
    let file = here.0.join("a.bond");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o640)).unwrap();
    symlink("a.bond", here.0.join("link.bond")).unwrap();
    here.bond(&["fmt", "link.bond"]).is(0, &[], &[]);
    assert!(here.0.join("link.bond").is_symlink());
    assert_ne!(here.read("a.bond"), CRAMPED);
    assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o640);
}
