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
