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

/// R in parallel with C behind a source of current: a pole at -1/RC, and a gain R / (1 + j w R C).
#[test]
fn poles_and_response_as_tables() {
    let here = Folder::new().with(
        "rc.bond",
        "model Rc { input u = 0 A  Sf:s = u  R:r = 2 Ohm  C:c = 0.5 F  s -> 0:n -> r, c  probe v = c.e }",
    );
    let table = |args: &[&str]| here.bond(args).is(0, &[], &[]).table();
    let (names, rows) = table(&["linearize", "rc.bond", "--poles"]);
    assert_eq!(names, ["real", "imaginary", "frequency", "damping"]);
    assert_eq!(rows, [[-1.0, 0.0, 1.0 / std::f64::consts::TAU, 1.0]]);
    let (names, rows) = table(&["linearize", "rc.bond", "--bode", "0, 0.15915494309189535"]);
    assert_eq!(names, ["frequency", "v/u", "phase(v/u)"]);
    assert_eq!(rows[0], [0.0, 2.0, 0.0]);
    assert!((rows[1][1] - 2f64.sqrt()).abs() < 1e-14 && (rows[1][2] + 45.0).abs() < 1e-12, "{rows:?}");
    let (_, rows) = table(&["linearize", "rc.bond", "--bode", "1 mHz..1 kHz:7:log"]);
    assert_eq!(rows.iter().map(|r| r[0]).collect::<Vec<_>>(), [1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3]);
    here.bond(&["linearize", "rc.bond", "--poles", "-o", "p.csv"]).is(0, &[], &[]);
    assert_eq!(here.read("p.csv").lines().count(), 2);
    for (text, word) in [("1..10", "how many"), ("1 rad/s,2", "not in `rad`"), ("1 s,2 s", "are in Hz")] {
        here.bond(&["linearize", "rc.bond", "--bode", text]).is(2, &[], &[word]);
    }
    // Nothing moves; and a position that is counted is no pole of the speed.
    let here = here.with("r.bond", "model Rest { input u = 0 V  Se:s = u  R:r = 2 Ohm  s -> r  probe i = r.f }").with(
        "m.bond",
        "model M { input u = 0 N  Se:s = u  I:m = 1 kg  R:r = 4 N*s/m  s -> 1:n -> m, r
               probe v = m.f  probe x = integral(m.f, 0 m) }",
    );
    let table = |args: &[&str]| here.bond(args).is(0, &[], &[]).table();
    assert_eq!(table(&["linearize", "r.bond", "--bode", "1"]).1, [[1.0, 0.5, 0.0]]);
    let (_, rows) = table(&["linearize", "m.bond", "--bode", "0"]);
    assert!(rows[0][1] == 0.25 && rows[0][3].is_infinite(), "{rows:?}");
    let shut = here.with("a.bond", OSCILLATOR);
    shut.bond(&["linearize", "a.bond", "--bode", "1"]).is(1, &[], &["declare both, such as `input u"]);
}

#[test]
fn what_is_wrong_is_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["linearize", "a.bond", "--at", "1kg"]).is(2, &[], &["not a time"]);
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

/// What is sampled is given, and what it is in a run by --at: u^2 drives a mass, u = 3 - 2 v of the last sample.
#[test]
fn what_is_sampled_is_given() {
    let here = Folder::new()
        .with(
            "s.bond",
            "model S {
        sampled every 0.1 s { state u = 0 N { next = 3 N - (2 N*s/m)*v.f } }
        sampled every 0.1 s { Se:s = 3 N - (2 N*s/m)*v.f  R:r = 1 N*s/m  s -> r }
        Se:F = u^2/(1 N)  Se:G = s.e^2/(1 N)  I:m = 2 kg  R:b = 1 N*s/m  F -> 1:v -> m, b  G -> v
        probe speed = v.f  probe l = u  simulate { stop = 0.5 s } }",
        )
        .with("all.bond", "model All { sampled every 0.1 s { state u = 1 { next = u/2 } }  probe p = u }");
    let done = here.bond(&["run", "s.bond", "--at", "0.4,0.45", "-o", "-"]).is(0, &[], &[]);
    let rows = done.table().1;
    let json = matrix(&here.bond(&["linearize", "s.bond", "--at", "0.45"]).is(0, &[], &[]).out);
    assert_eq!(json["inputs"], serde_json::json!(["u", "s.e"]));
    let close = |found: &serde_json::Value, wanted: f64| {
        assert!((found.as_f64().unwrap() - wanted).abs() < 1e-6, "{found} {wanted}: {json}");
    };
    close(&json["B"][0][0], 2.0 * rows[1][2]);
    close(&json["B"][0][1], 2.0 * (3.0 - 2.0 * rows[0][1]));
    close(&json["A"][0][0], -0.5);
    close(&json["D"][1][0], 1.0);
    here.bond(&["linearize", "all.bond"]).is(0, &["\"states\": []"], &["the linear model has no states"]);
    here.bond(&["linearize", "all.bond", "--poles"]).is(0, &["real,"], &["the linear model has no states"]);
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
