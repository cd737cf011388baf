use super::{BLOWS_UP, Folder, OSCILLATOR, WRONG};

#[test]
fn expectations_are_checked() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["test", "a.bond"]).is(0, &["3 passed, 0 failed", "expect passive", "measured max 0.1"], &[]);
    let strict = OSCILLATOR.replace("< 0.2 m", "< 0.02 m").replace("0.1 m within", "0.2 m within");
    let here = Folder::new().with("a.bond", strict);
    here.bond(&["test", "a.bond"]).is(
        1,
        &["1 passed, 2 failed", "FAIL", "measured max 0.1", "measured 0.1, deviation 0.1"],
        &[],
    );
    here.fed(&["test", "-"], OSCILLATOR).is(0, &["3 passed"], &[]);
}

#[test]
fn conditions_hold_at_every_row() {
    let with = |what: &str| Folder::new().with("a.bond", OSCILLATOR.replace("expect passive", what));
    with("expect spring.q < 0.2 m and mass.f < 100 m/s").bond(&["test", "a.bond"]).is(0, &["at 1001 rows"], &[]);
    with("expect spring.q > 0 m").bond(&["test", "a.bond"]).is(1, &["not at t = 0."], &[]);
    with("expect min(spring.q) < 0 m and max(spring.q) > 0.09 m").bond(&["test", "a.bond"]).is(0, &["min -0.0"], &[]);
    with("expect spring.q at 5 s = 0 m within 1 m").bond(&["test", "a.bond"]).is(1, &["the run ends at 1 s"], &[]);
    with("expect spring.q at 0.12345 s = 0 m within 1 m").bond(&["test", "a.bond"]).is(0, &["3 passed"], &[]);
}

/// Of what is no number nothing holds, nor its contrary.
#[test]
fn what_is_no_number_is_as_little_unequal() {
    let with = |what: &str| Folder::new().with("a.bond", OSCILLATOR.replace("expect passive", what));
    let bad = "sqrt(spring.q/(1 m) - 10)";
    let conditions =
        ["B != 3", "not (B < 3)", "not (B <= 3)", "not (B < 3 and B > 2)", "not (B == 3 or B > 4)", "B < 3"];
    for condition in conditions {
        let expect = |of: &str| format!("expect {}", condition.replace('B', of));
        with(&expect(bad)).bond(&["test", "a.bond"]).is(1, &["not at t = 0 s", "2 passed, 1 failed"], &[]);
    }
    let held = "expect not (spring.q > 1 m or spring.q == 2 m) and not not (mass.f != 50 m/s)";
    with(held).bond(&["test", "a.bond"]).is(0, &["3 passed"], &[]);
}

#[test]
fn folders_are_searched() {
    let here = Folder::new()
        .with("models/b/x.bond", OSCILLATOR)
        .with("models/a.bond", "model A { }\n")
        .with("models/.hidden/w.bond", WRONG)
        .with("models/notes.txt", "no model");
    let done = here.bond(&["test", "models"]);
    assert!(done.out.contains("x.bond Oscillator"), "{done:?}");
    assert!(!done.out.contains("hidden") && !done.out.contains("notes"), "{done:?}");
    let here = Folder::new().with("empty/notes.txt", "");
    here.bond(&["test", "empty"]).is(2, &[], &["there is no `*.bond`"]);
    here.bond(&["test", "none"]).is(2, &[], &["cannot read none"]);
}

#[test]
fn one_bad_file_does_not_hide_the_others() {
    let here = Folder::new()
        .with("a.bond", WRONG)
        .with("b.bond", OSCILLATOR)
        .with("c.bond", b"\xff")
        .with("d.bond", BLOWS_UP.replace("simulate", "expect passive simulate"));
    here.bond(&["test", "."]).is(1, &["does not compile", "3 passed, 3 failed", "UTF-8", "t = 0.99"], &["a.bond:3:"]);
}

#[test]
fn every_model_with_an_expectation_is_tested() {
    let other = "model First { I:m = 1 kg\n Se:F = 1 N\n F -> m\n expect m.p at 1 s = 1 N*s within 1e-9 N*s }\nmodel Plain { }\n";
    let here = Folder::new().with("a.bond", format!("{other}{OSCILLATOR}"));
    here.bond(&["test", "a.bond"]).is(0, &["First", "4 passed"], &[]);
    let done = here.bond(&["test", "a.bond", "--model", "First"]).is(0, &["1 passed"], &[]);
    assert!(!done.out.contains("Oscillator"));
}

#[test]
fn snapshots_are_made_compared_and_accepted() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["test", "a.bond"]).is(0, &["3 passed"], &[]);
    assert_eq!(here.list(), ["a.bond"]);
    here.bond(&["test", "a.bond", "--update"]).is(0, &["4 passed", "a.snap"], &[]);
    here.bond(&["test", "a.bond"]).is(0, &["4 passed"], &[]);
    let here = here.with("a.bond", OSCILLATOR.replace("stiffness = k", "stiffness = 2*k"));
    here.bond(&["test", "a.bond"]).is(1, &["3 passed, 1 failed", "--update", "\n- ", "\n+ "], &[]);
    here.bond(&["test", "a.bond", "--update"]).is(0, &["4 passed"], &[]);
    here.bond(&["test", "a.bond"]).is(0, &["4 passed"], &[]);
}

#[test]
fn a_closed_pipe_does_not_make_it_good() {
    let strict = OSCILLATOR.replace("< 0.2 m", "< 0.02 m");
    let here = Folder::new().with("a.bond", strict).with("b.bond", OSCILLATOR);
    assert_eq!(here.unread(&["test", "a.bond", "b.bond"]), (Some(1), String::new()));
    assert_eq!(here.unread(&["test", "b.bond"]), (Some(0), String::new()));
    let here = here.with("fails.bond", BLOWS_UP);
    let (status, told) = here.unread(&["run", "fails.bond"]);
    assert!(status == Some(3) && told.contains("t = 0.99"), "{told}");
}

#[test]
fn an_old_snapshot_may_be_anything() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("a.snap", b"caf\xe9\n");
    here.bond(&["test", "a.bond"]).is(1, &["cannot read a.snap: line 1 is not UTF-8 text"], &[]);
    here.bond(&["test", "a.bond", "--update"]).is(0, &["4 passed", "snapshot written to a.snap"], &[]);
    here.bond(&["test", "a.bond"]).is(0, &["4 passed"], &[]);
}

/// What other files use has nothing to test, and does not fail a folder; a file is tested once.
#[test]
fn files_of_functions_are_left_out() {
    let here = Folder::new().with("m/sq.bond", "let sq(x) = x^2\n").with("m/x.bond", OSCILLATOR);
    here.bond(&["test", "m", "m/x.bond", "./m"]).is(
        0,
        &["skip m/sq.bond: no model; functions: sq", "3 passed, 0"],
        &[],
    );
    here.bond(&["test", "m/sq.bond", "--model", "A"]).is(2, &["1 failed"], &[]);
    let here = here.with("m/bad.bond", "let sq(x) = (\n");
    here.bond(&["test", "m"]).is(1, &["1 failed"], &[]);
}

/// A scene beside the default has a snapshot of its own.
#[test]
fn scenes_have_their_own_snapshots() {
    let other = "model Ray { I:m = 1 kg\n Se:F = 1 N\n F -> m\n expect passive }\n";
    let here = Folder::new().with("a.bond", format!("{other}{OSCILLATOR}"));
    here.bond(&["test", "a.bond", "--update"]).is(0, &["5 passed", "to a.snap"], &[]);
    let first = here.read("a.snap");
    here.bond(&["test", "a.bond", "--model", "Ray"]).is(0, &["1 passed"], &[]);
    here.bond(&["test", "a.bond", "--model", "Ray", "--update"]).is(0, &["to a.Ray.snap"], &[]);
    here.bond(&["test", "a.bond", "--model", "Oscillator"]).is(0, &["4 passed"], &[]);
    here.bond(&["test", "a.bond"]).is(0, &["6 passed"], &[]);
    assert!(here.read("a.snap") == first && here.read("a.Ray.snap") != first);
    // Lines may end in the other way.
    let here = here.with("a.snap", first.replace('\n', "\r\n"));
    here.bond(&["test", "a.bond"]).is(0, &["6 passed"], &[]);
    here.bond(&["test", "a.bond", "--model", "Nope"]).is(2, &["does not compile"], &["Nope"]);
    here.fed(&["test", "-", "--update"], OSCILLATOR).is(2, &[], &["standard input has no place"]);
}
