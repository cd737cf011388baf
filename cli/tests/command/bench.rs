//! `bond bench`: the points, what they say of themselves, and the pictures of them. No speed is asserted.

use super::{BLOWS_UP, Done, Folder, OSCILLATOR};
use serde_json::Value;

/// It swings far; linear it is not.
pub const PENDULUM: &str = "\
model Pendulum {
  C:gravity { H = (10 J)*(1 - cos(q/(1 rad))); q0 = 2 rad }
  I:arm = 1 kg*m^2
  1:w -> gravity, arm
  probe angle = gravity.q
  probe speed = w.f
  simulate { stop = 2 s }
}
";

/// A diode that steps of 8 ms and more by the discrete gradient do not solve for.
pub const RECTIFIER: &str = "\
model Rectifier {
  Se:s = (5 V)*sin((30 Hz)*t)
  R:rs = 0.5 Ohm
  I:ll = 0.05 H
  C:c1 = 0.01 F
  C:c2 = 0.01 F
  R:d { f = (1e-9 A)*(exp(e/(0.025 V)) - 1) }
  R:ld = 20 Ohm
  s -> 1:m -> rs, ll
  m -> 0:n -> c1
  n -> 1:dd -> d
  dd -> 0:o -> c2, ld
  probe e = c2.e
  simulate { stop = 2 s }
}
";

/// All is computed at 10 Hz.
const SAMPLED: &str = "\
model Sampled {
  sampled at 10 Hz {
    C:c { compliance = 1 F; q0 = 1 C }
    R:r = 1 Ohm
    c -> r
  }
  probe q = c.q
}
";

fn points(done: &Done) -> Vec<Value> {
    serde_json::from_str(&done.out).unwrap()
}

fn of<'a>(points: &'a [Value], method: &str) -> Vec<&'a Value> {
    points.iter().filter(|p| p["method"] == method).collect()
}

fn errors(points: &[&Value]) -> Vec<f64> {
    points.iter().map(|p| p["error"].as_f64().unwrap()).collect()
}

#[test]
fn errors_fall_with_the_order() {
    let here = Folder::new().with("pendulum.bond", PENDULUM);
    let args =
        ["bench", "pendulum.bond", "--methods", "gonzalez,rk4,euler,exact", "--steps", "20ms,10ms,5ms", "--as", "json"];
    let done = here.bond(&args).is(0, &[], &["note: exact: left out", "not linear"]);
    let list = points(&done);
    assert_eq!(list.len(), 9, "{list:?}");
    for (method, order) in [("gonzalez", 2.0), ("rk4", 4.0), ("euler", 1.0)] {
        let own = of(&list, method);
        assert_eq!(own.len(), 3);
        for pair in errors(&own).windows(2) {
            let measured = (pair[0] / pair[1]).log2();
            assert!((measured - order).abs() < 0.35, "{method}: {measured} instead of {order}");
        }
        for p in own {
            assert_eq!((&p["problem"], &p["model"]), (&Value::from("pendulum"), &Value::from("Pendulum")));
            assert_eq!(p["passive_stepper"], method == "gonzalez");
            assert!(p["tolerance"].is_null() && p["step"].as_f64().is_some());
            assert!(p["seconds"].as_f64().unwrap() > 0.0 && p["steps"].as_u64().unwrap() >= 100);
            // The error is the worst of what is told of each probe and state.
            let ends = |what: &str| -> Vec<f64> {
                p[what].as_object().unwrap().values().map(|x| x["end"].as_f64().unwrap()).collect()
            };
            let all: Vec<f64> = [ends("probes"), ends("states")].concat();
            assert_eq!(all.len(), 4);
            assert_eq!(all.iter().copied().fold(0.0, f64::max), p["error"].as_f64().unwrap());
            for probe in p["probes"].as_object().unwrap().values() {
                assert!(probe["largest"].as_f64() >= probe["end"].as_f64());
            }
            assert!(p["reference_error"].as_f64().unwrap() < 1e-9);
        }
    }
    // What keeps the balance keeps it; Euler's method does not.
    assert!(
        of(&list, "gonzalez")
            .iter()
            .all(|p| p["balance"].as_f64().unwrap() < 1e-12 && p["drift"].as_f64().unwrap() < 1e-12)
    );
    assert!(of(&list, "euler").iter().all(|p| p["drift"].as_f64().unwrap() > 1e-3));
}

#[test]
fn the_front_is_a_front() {
    let here = Folder::new().with("pendulum.bond", PENDULUM);
    let done = here.bond(&["bench", "pendulum.bond", "--methods", "gonzalez,rk4", "--repeat", "1", "--as", "json"]).is(
        0,
        &[],
        &[],
    );
    let list = points(&done);
    let place = |p: &Value| {
        let floor = 10.0 * p["reference_error"].as_f64().unwrap();
        Some((p["error"].as_f64()?.max(floor), p["seconds"].as_f64()?))
    };
    let known: Vec<(f64, f64)> = list.iter().filter_map(place).collect();
    assert!(list.iter().any(|p| p["front"] == true) && list.iter().any(|p| p["front"] == false));
    assert!(list.iter().any(|p| !p["tolerance"].is_null()) && list.iter().any(|p| !p["step"].is_null()));
    for p in &list {
        let Some((error, seconds)) = place(p) else { continue };
        let beaten = known.iter().any(|(e, s)| *e <= error && *s <= seconds && (*e < error || *s < seconds));
        if p["front"] == true {
            assert!(!beaten && error < 1.0, "{p}");
        } else if error < 1.0 {
            assert!(beaten || known.iter().filter(|k| **k == (error, seconds)).count() > 1, "{p}");
        }
    }
}

#[test]
fn points_between_just_meet_a_decade() {
    let here = Folder::new().with("pendulum.bond", PENDULUM);
    let done = here.bond(&["bench", "pendulum.bond", "--methods", "gonzalez", "--limit", "1s", "--as", "json"]);
    let list = points(&done.is(0, &[], &[]));
    let counted: Vec<(f64, f64)> =
        list.iter().filter_map(|p| Some((2.0 / p["step"].as_f64()?, p["error"].as_f64()?))).collect();
    // From coarse to fine, those between among the others.
    assert!(counted.windows(2).all(|w| w[0].0 < w[1].0), "{counted:?}");
    let tolerances: Vec<f64> = list.iter().filter_map(|p| p["tolerance"].as_f64()).collect();
    assert!(tolerances.windows(2).all(|w| w[0] > w[1]), "{tolerances:?}");
    // The sweep has 2^k times the first number of steps. Of second order, what is between two of them meets its decade
    // closely.
    let swept = |n: f64| ((n / counted[0].0).log2() - (n / counted[0].0).log2().round()).abs() < 1e-6;
    let between: Vec<f64> = counted.iter().filter(|c| !swept(c.0)).map(|c| c.1).collect();
    assert!(!between.is_empty(), "{counted:?}");
    let close = |error: &f64| {
        let decade = 10f64.powf(error.log10().ceil());
        (0.6..=1.0).contains(&(error / decade))
    };
    assert!(between.iter().filter(|e| close(e)).count() * 2 > between.len(), "{between:?}");
    // Settings that are told are measured as they are told.
    let told = ["bench", "pendulum.bond", "--methods", "gonzalez", "--steps", "20ms,10ms", "--as", "json"];
    assert_eq!(points(&here.bond(&told).is(0, &[], &[])).len(), 2);
}

#[test]
fn a_table_for_people_says_what_to_choose() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let done = here.bond(&["bench", "a.bond", "--methods", "exact,gonzalez", "--repeat", "1"]);
    let done = done.is(0, &["scene       Oscillator", "reference", "to choose", "exact", "gonzalez", "balance"], &[]);
    assert!(done.out.lines().any(|l| l.starts_with("* ")), "{}", done.out);
    let wide = done.out.lines().map(|l| l.chars().count()).max().unwrap();
    assert!(wide <= 140, "{wide} letters wide");
    // Linear and undriven: one step of any length is without error.
    let list =
        points(&here.bond(&["bench", "a.bond", "--methods", "exact,rk4", "--steps", "1s,50ms", "--as", "json"]).is(
            0,
            &[],
            &[],
        ));
    assert!(errors(&of(&list, "exact")).iter().all(|e| *e < 1e-10), "{list:?}");
    assert!(errors(&of(&list, "rk4")).iter().all(|e| *e > 1e-6), "{list:?}");
    // The same to a file.
    here.bond(&["bench", "a.bond", "--methods", "gonzalez", "--steps", "0.01", "-o", "a.txt"]).is(0, &[], &[]);
    assert!(here.read("a.txt").contains("gonzalez"));
}

#[test]
fn a_point_that_fails_is_listed_with_its_reason() {
    // The spring makes Euler's method grow by some 1e3 each step, beyond all numbers.
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let args = ["bench", "a.bond", "--set", "k=1e12 N/m", "--methods", "exact,euler", "--steps", "1ms", "--as", "json"];
    let list = points(&here.bond(&args).is(0, &[], &[]));
    let failed = of(&list, "euler");
    assert_eq!(failed.len(), 1);
    assert!(failed[0]["error"].is_null() && failed[0]["seconds"].is_null() && failed[0]["front"] == false);
    assert!(failed[0]["failed"].as_str().unwrap().contains("finite"), "{list:?}");
}

#[test]
fn pictures() {
    let here = Folder::new().with("p.bond", PENDULUM);
    let args = ["bench", "p.bond", "--methods", "gonzalez,rk4", "--steps", "50ms,25ms,10ms", "--repeat", "1", "--plot"];
    let draw = |name: &str| here.bond(&[&args[..], &[name]].concat());
    draw("p.svg").is(0, &["to choose"], &[]);
    let svg = here.read("p.svg");
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    for text in ["Pendulum: speed against error", "gonzalez", "rk4", "keeps the balance", "10⁻", "front"] {
        assert!(svg.contains(text), "`{text}` is not in the picture");
    }
    draw("p.png").is(0, &[], &[]);
    let png = std::fs::read(here.0.join("p.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n") && png.ends_with(b"IEND\xaeB`\x82") && png.len() > 10_000);
    draw("p.gif").is(2, &[], &["p.gif", ".svg or .png"]);
    assert_eq!(here.list(), ["p.bond", "p.png", "p.svg"]);
}

#[test]
fn what_is_wrong_is_told() {
    let here = Folder::new().with("p.bond", PENDULUM).with("s.bond", SAMPLED).with("b.bond", BLOWS_UP);
    here.bond(&["bench", "p.bond", "--methods", "gonzales"]).is(2, &[], &["gonzales", "gonzalez", "rk4"]);
    here.bond(&["bench", "p.bond", "--methods", "exact"]).is(2, &[], &["no stepper is left", "not linear"]);
    here.bond(&["bench", "p.bond", "--steps", "0"]).is(2, &[], &["longer than 0 s"]);
    here.bond(&["bench", "p.bond", "--steps", "1e-15"]).is(2, &[], &["steps in 2 s"]);
    here.bond(&["bench", "p.bond", "--tolerances", "2"]).is(2, &[], &["between 0 and 1"]);
    here.bond(&["bench", "p.bond", "--plot", "x.svg", "-o", "x.svg"]).is(2, &[], &["the same file"]);
    here.bond(&["bench", "none.bond"]).is(2, &[], &["cannot read none.bond"]);
    here.bond(&["bench", "s.bond"]).is(1, &[], &["no continuous region"]);
    let blown = here.bond(&["bench", "b.bond", "--methods", "gonzalez,rk4"]);
    blown.is(3, &[], &["no stepper gives a run to measure the others against"]);
}

/// What counts is the balance that a run had, not what its stepper is known for; and passive ones have it at any step,
/// over many turns of what a diode lets through.
#[test]
fn what_a_run_kept_is_told() {
    let here = Folder::new().with("r.bond", RECTIFIER);
    let args = ["bench", "r.bond", "--methods", "gonzalez,collocation8,rk4", "--steps", "0.1s,20ms,11.9ms,4ms,1ms"];
    let list = points(&here.bond(&[&args[..], &["--as", "json"]].concat()).is(0, &[], &[]));
    assert!(list.iter().any(|p| p["method"] == "rk4"), "{list:?}");
    for p in &list {
        // That of Runge and Kutta overflows.
        let kept = p["balance"].as_f64().is_some_and(|x| x <= 1e-12);
        assert_eq!(p["keeps_balance"].as_bool().unwrap_or(false), kept, "{p}");
        assert_eq!(kept, p["method"] != "rk4", "{p}");
    }
}

/// A ball between two walls with kinks: errors lie on a plateau over many tolerances before they fall on.
const WALLS: &str = "\
model Walls {
  Se:w = 2 N * sin(1.1 Hz * t) - 1 N
  I:ball { inertia = 1 kg; p0 = 1 N*s }
  C:floor { H = if q < 0 then 160 J * (-q/(1 m))^2.5 else 0; q0 = 0.5 m }
  C:ceil { H = if q > 0 then 50 N/m * q^2 + 3000 N/m^3 * q^4 else 0; q0 = -0.5 m }
  R:pad { e = if floor.q < 0 then 4 N*s/m * f else 0 }
  R:air { e = 0.05 N*s^2/m^2 * f*abs(f) }
  w -> 1:v -> ball, floor, ceil, pad, air
  probe x = floor.q
  probe p = ball.p
  simulate { stop = 10 s }
}
";

/// A plateau is no rounding; where a row ends a note says why; and what is advised for an error meets it on the way.
#[test]
fn rows_go_on_beyond_a_plateau() {
    let here = Folder::new().with("w.bond", WALLS);
    let args = ["bench", "w.bond", "--methods", "collocation6", "--limit", "4s", "--repeat", "1"];
    let done = here.bond(&[&args[..], &["--as", "json"]].concat());
    let list = points(&done.is(0, &[], &["note: collocation6"]));
    let worst = |p: &Value| {
        let along = p["probes"].as_object().unwrap().values().map(|x| x["largest"].as_f64().unwrap());
        along.fold(p["error"].as_f64().unwrap(), f64::max)
    };
    let tolerances: Vec<&Value> = list.iter().filter(|p| !p["tolerance"].is_null()).collect();
    let last = tolerances.last().unwrap();
    let known = last["reference_error"].as_f64().unwrap();
    assert!(worst(last) < (100.0 * known).max(1e-9), "{last}");
    // Of each line of advice, the point.
    let table = here.bond(&args).is(0, &["to choose"], &[]).out;
    let advice = table.lines().skip_while(|l| !l.starts_with("to choose")).skip(1).filter(|l| l.starts_with("  for"));
    let mut checked = 0;
    for line in advice {
        let mut words = line.split_whitespace().skip(1);
        let error: f64 = words.next().unwrap().parse().unwrap();
        let rest: Vec<&str> = words.collect();
        let Some(at) = rest.iter().position(|w| *w == "tolerance") else { continue };
        let row = format!("tol {}", rest[at + 1]);
        let found = table.lines().find(|l| l.split_whitespace().collect::<Vec<_>>().join(" ").contains(&row)).unwrap();
        let numbers: Vec<&str> = found.split(row.as_str()).nth(1).unwrap().split_whitespace().collect();
        let on_way: f64 = numbers[1].parse().unwrap();
        assert!(on_way <= 1.05 * error.max(10.0 * known), "{line}\n{found}");
        checked += 1;
    }
    assert!(checked >= 4, "{table}");
}

/// Its step has an exponential of a difference that is undefined at a point, so that its programs have a NaN in them.
const SOFT: &str = "\
model Soft {
  I:m = 1 kg
  C:s { e = (1 N/m)*q/(1 + 0.3*tanh(q/(1 m))^2); q0 = 1 m }
  1:v -> m, s
  probe x = s.q
  simulate { stop = 10 s }
}
";

#[test]
fn making_code_does_not_count() {
    let here = Folder::new().with("soft.bond", SOFT);
    // The runs themselves take some milliseconds, and 20 with their repetitions; making code anew for each of those
    // takes seconds.
    let args = ["bench", "soft.bond", "--methods", "gonzalez", "--steps", "1s,500ms,250ms,125ms", "--as", "json"];
    let done = here.bond(&[&args[..], &["--limit", "500ms", "--repeat", "1"]].concat()).is(0, &[], &[]);
    assert!(!done.err.contains("skipped"), "{}", done.err);
    assert_eq!(points(&done).len(), 4);
}

#[test]
fn no_step_is_longer_than_the_run() {
    let here = Folder::new().with("pendulum.bond", PENDULUM);
    let args = ["bench", "pendulum.bond", "--methods", "gonzalez", "--steps", "100s,3s,1s", "--as", "json"];
    let done = here.bond(&args).is(0, &[], &["note: a step of 100 s is longer than the run, and taken as one of 2 s"]);
    let steps: Vec<Option<f64>> = points(&done).iter().map(|p| p["step"].as_f64()).collect();
    assert_eq!(steps, [Some(2.0), Some(1.0)]);
}
