use super::{Folder, OSCILLATOR};

const PENDULUM: &str = "\
model Pendulum {
  C:gravity { H = (1 J)*(1 - cos(q/(1 rad))); q0 = 1 rad }
  I:arm = 1 kg*m^2
  1:w -> gravity, arm
  probe angle = gravity.q
}
";

fn matrix(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn matrices_at_the_start_and_along_the_run() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("p.bond", PENDULUM);
    let json = matrix(&here.bond(&["linearize", "a.bond"]).is(0, &[], &[]).out);
    assert_eq!(json["A"], serde_json::json!([[0.0, 1.0], [-100.0, -0.5]]));
    assert_eq!(json["outputs"], serde_json::json!(["x", "v"]));
    let json = matrix(&here.bond(&["linearize", "a.bond", "--set", "k=400 N/m"]).is(0, &[], &[]).out);
    assert_eq!(json["A"][1][0], -400.0);
    // The slope of the weight's torque is -cos(angle), and the pendulum swings.
    let slope = |args: &[&str]| matrix(&here.bond(args).is(0, &[], &[]).out)["A"][1][0].as_f64().unwrap();
    assert!((slope(&["linearize", "p.bond"]) + 1f64.cos()).abs() < 1e-12);
    let done = here.bond(&["run", "p.bond", "--stop", "1.5", "--at", "1.5", "-o", "-"]).is(0, &[], &[]);
    let angle = done.table().1[0][1];
    assert!((slope(&["linearize", "p.bond", "--at", "1500ms"]) + angle.cos()).abs() < 1e-5);
}

#[test]
fn what_is_wrong_is_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["linearize", "a.bond", "--at", "1kg"]).is(2, &[], &["no time"]);
    here.bond(&["linearize", "a.bond", "--at=-1"]).is(2, &[], &["starts at 0"]);
    here.bond(&["linearize", "none.bond"]).is(2, &[], &["cannot read none.bond"]);
}

/// What a sampled region holds is given: a diode in series with 100 Ohm, at the voltage that is held.
#[test]
fn what_is_held_is_given() {
    let held = "model Held {
        R:r = 100 Ohm  R:d { f = 1e-9 A * (exp(e/(25 mV)) - 1) }  C:c = 1 mF
        sampled every 1 ms hold lagged budget off { Se:u = 5 V  1:b  u -> b }
        b ||> a  1:a -> r, d, c  probe i = d.f }";
    let here = Folder::new().with("held.bond", held).with(
        "own.bond",
        "model Own {
        R:r = 100 Ohm  R:d { f = 1e-9 A * (exp(e/(25 mV)) - 1) }  C:c = 1 mF  Se:u = 5 V
        u -> 1:a -> r, d, c  probe i = d.f }",
    );
    let slope = |file: &str| {
        let done = here.bond(&["linearize", file, "--at", "20ms"]).is(0, &[], &[]);
        matrix(&done.out)["A"][0][0].as_f64().unwrap()
    };
    let (held, own) = (slope("held.bond"), slope("own.bond"));
    assert!((held / own - 1.0).abs() < 1e-4 && held < -9.9, "{held} {own}");
}

/// Dry friction that holds has no slope: its loop is named.
#[test]
fn what_friction_holds_is_named() {
    let stuck = "model Stuck { I:m = 1 kg  C:k = 1 m/N  R:dry { e = max(min(s, 1), -1)*(2 N); f = (s - max(min(s, 1), -1))*(1 m/s) }
        1:v -> m, k, dry  probe x = k.q }";
    let here = Folder::new().with("stuck.bond", stuck);
    let done = here.bond(&["linearize", "stuck.bond"]);
    assert!(done.status != 0 && done.err.contains("dry"), "{done:?}");
}
