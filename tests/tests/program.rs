//! Step programs.

use crate::common::{file, models};
use bond::Options;

#[test]
fn programs() {
    for (element, method) in [("C", "exact"), ("I", "gonzalez"), ("I", "euler")] {
        let compiled = file(&models().join(format!("elements/{element}.bond")), Options::new().method(method));
        insta::assert_snapshot!(format!("program_{element}_{method}"), compiled.show("program"));
    }
}

/// A ladder's program grows with its cells, not with their square.
#[test]
fn the_program_of_a_ladder_grows_with_its_length() {
    let path = models().join("examples/rc_ladder.bond");
    let size = |n: &str| {
        let compiled = file(&path, Options::new().set("n", n).method("gonzalez"));
        compiled.show("program").lines().count()
    };
    let (small, large) = (size("50"), size("200"));
    assert!(large < 5 * small, "{small} lines for 50 cells, {large} for 200");
}
