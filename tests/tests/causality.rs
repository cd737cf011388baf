//! Strokes.

use crate::common::{example, file, models, text};
use bond::Options;

#[test]
fn strokes() {
    for (name, scene) in [
        ("virtual_wall", "VirtualWall"),
        ("quarter_car", "QuarterCar"),
        ("dc_motor", "DcMotor"),
        ("wheatstone", "Wheatstone"),
    ] {
        insta::assert_snapshot!(format!("causality_{name}"), example(name, scene).show("causality"));
    }
}

/// How many storages of a model are dependent, and states it has.
fn counts(text: &str) -> (usize, usize) {
    let compiled = crate::common::text(text);
    let form = &compiled.stages().form;
    (form.regions.iter().map(|r| r.dependent.len()).sum(), form.regions.iter().map(|r| r.states.len()).sum())
}

#[test]
fn dependent_storages_are_merged() {
    assert_eq!(counts("model M { Se:f = 1 N I:a = 1 kg I:b = 2 kg f -> 1:v -> a, b }"), (1, 1));
    assert_eq!(counts("model M { Sf:f = 1 A C:a = 1 F C:b = 2 F C:c = 2 F f -> 0:v -> a, b, c }"), (2, 1));
    // Through a gyrator an inertia shows as a compliance: a mass and a capacitor are one.
    assert_eq!(counts("model M { Sf:f = 1 A C:c = 1 F GY:g = 2 V*s/m I:m = 3 kg f -> 0:v -> c, g g -> m }"), (1, 1));
    assert_eq!(counts("model M { Se:f = 1 N I:a = 1 kg C:b = 2 m/N f -> 1:v -> a, b }"), (0, 2));
}

/// A gyrator swaps the variables: a motor with a mass and one with a coil stay independent.
#[test]
fn independent_storages_stay() {
    assert_eq!(counts("model M { Se:u = 1 V I:l = 1 H GY:g = 2 V*s/m I:m = 3 kg u -> 1:i -> l, g g -> m }"), (0, 2));
}

#[test]
fn asserted_strokes_are_kept() {
    let free = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i -> a, b }");
    let held = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i ->| a i -> b }");
    let other = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i |-> a i -> b }");
    let named = text("model M { Se:u = 1 V R:a = 1 Ohm R:b = 2 Ohm u -> 1:i i -[x]|-> a i -> b probe p = x.P }");
    assert_eq!(other.stages().causality.strokes, named.stages().causality.strokes);
    for c in [&free, &held, &other, &named] {
        let summary = crate::common::run(c).unwrap_or_else(|e| panic!("{e}"));
        crate::common::close(summary.regions[0].dissipated, 1.0 / 3.0, 1e-12, "energy");
    }
    assert_ne!(held.show("causality"), other.show("causality"));
}

/// The bridge with four resistors meeting is a loop, not a conflict.
#[test]
fn resistors_that_meet_are_a_loop() {
    let compiled = file(&models().join("examples/wheatstone.bond"), Options::new());
    assert_eq!(compiled.stages().form.regions.len(), 1);
    assert!(compiled.stages().form.validate(&compiled.stages().model.pool).is_ok());
}
