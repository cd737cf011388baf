//! `bond run --error` and `--budget`: what is chosen is said, and an error that is asked for is met.

use super::bench::{PENDULUM, RECTIFIER};
use super::{Folder, OSCILLATOR, table};
use serde_json::Value;

/// A spring that hardens, with friction, driven: at rest it is not.
const DUFFING: &str = "\
model Duffing {
  Se:drive = (0.5 N)*cos((1.4 rad/s)*t)
  I:mass = 1 kg
  C:spring { e = (1 N/m)*q + (5 N/m^3)*q^3 }
  R:friction = 0.1 N*s/m
  drive -> 1:v -> mass, spring, friction
  probe x = spring.q
  probe speed = v.f
  simulate { stop = 20 s }
}
";

/// The largest difference of two tables of rows, of each column relative to its largest value.
fn apart(a: &str, b: &str) -> f64 {
    let (a, b) = (table(a).1, table(b).1);
    assert_eq!(a.len(), b.len());
    let columns = 1..a[0].len();
    let of = |k: usize| {
        let size = b.iter().map(|r| r[k].abs()).fold(0.0, f64::max);
        a.iter().zip(&b).map(|(x, y)| (x[k] - y[k]).abs() / size).fold(0.0, f64::max)
    };
    columns.map(of).fold(0.0, f64::max)
}

#[test]
fn an_error_that_is_asked_for_is_delivered() {
    let here = Folder::new().with("pendulum.bond", PENDULUM).with("duffing.bond", DUFFING);
    for name in ["pendulum.bond", "duffing.bond"] {
        let run = |args: &[&str]| here.bond(&[&["run", name, "--every", "0.02"], args].concat()).is(0, &[], &[]);
        run(&["--method", "rk4", "--step", "2e-4", "-o", "exact.csv"]);
        let exact = here.read("exact.csv");
        for (asked, method) in [(1e-3, None), (1e-5, None), (1e-7, None), (1e-4, Some("gonzalez")), (1e-6, Some("rk4"))]
        {
            let error = format!("{asked:e}");
            let mut args = vec!["--error", &error, "-o", "x.csv", "--summary", "json"];
            args.extend(method.iter().flat_map(|m| ["--method", m]));
            let summary: Value = serde_json::from_str(&run(&args).out).unwrap();
            let chosen = &summary["chosen"];
            let measured = apart(&here.read("x.csv"), &exact);
            assert!(asked / 100.0 <= measured && measured <= asked, "{name}, {asked:e}: {measured:e} with {chosen}");
            assert_eq!(chosen["method"], summary["regions"][0]["stepper"]);
            assert!(method.is_none_or(|m| chosen["method"] == m), "{chosen}");
            assert!(chosen["step"].is_null() != chosen["tolerance"].is_null(), "{chosen}");
            let estimated = chosen["estimated_error"].as_f64().unwrap();
            assert!(estimated <= asked && estimated >= 0.3 * measured, "{chosen}, {measured:e}");
            if method != Some("rk4") {
                assert_eq!(summary["passive"], true, "{summary}");
            }
        }
    }
}

#[test]
fn what_is_chosen_is_said() {
    let here = Folder::new().with("pendulum.bond", PENDULUM).with("a.bond", OSCILLATOR);
    here.bond(&["run", "pendulum.bond", "--error", "1e-4"]).is(
        0,
        &["\nchosen      ", "keep the balance", "error about", "measured against"],
        &["note: choosing"],
    );
    // Linear: exact, whatever is asked for.
    let done = here.bond(&["run", "a.bond", "--error", "1e-9", "--summary", "json"]).is(0, &[], &[]);
    let chosen = serde_json::from_str::<Value>(&done.out).unwrap()["chosen"].clone();
    assert_eq!(chosen["method"], "exact");
    assert!(chosen["why"].as_str().unwrap().contains("linear") && chosen["estimated_error"].as_f64().unwrap() < 1e-11);
    // A run without a choice says nothing of one.
    let done = here.bond(&["run", "a.bond", "--summary", "json"]).is(0, &[], &[]);
    assert!(serde_json::from_str::<Value>(&done.out).unwrap()["chosen"].is_null());
}

/// A probe that is rounding and nothing else has no error; a search goes on where only a slow stepper applies.
#[test]
fn what_is_only_rounding_does_not_count() {
    let ideal = "model Ideal {
      Se:s = (5 V)*sin((30 Hz)*t)
      I:l = 0.05 H
      R:r = 2 Ohm
      R:d { e = min(s, 0)*(1 V); f = max(s, 0)*(1 A) }
      s -> 1:m -> l, r, d
      probe lost = integral(d.P, 0 J)
      probe i = m.f
      simulate { stop = 1 s }
    }";
    let here = Folder::new().with("ideal.bond", ideal);
    let done = here.bond(&["run", "ideal.bond", "--error", "1e-4", "--summary", "json"]).is(0, &[], &[]);
    let summary: Value = serde_json::from_str(&done.out).unwrap();
    assert!(summary["chosen"]["estimated_error"].as_f64().unwrap() <= 1e-4, "{summary}");
    assert!(summary["final"]["lost"].as_f64().unwrap().abs() < 1e-12, "{summary}");
}

/// Of several methods that fail, each says why.
#[test]
fn all_reasons_are_told() {
    let pole = "model Pole {
      Se:u = (100 N)*t/(2 s - t)
      I:m = 1 kg
      C:k { e = -(1 N)*log(1 - q/(1 m)) }
      u -> 1:v -> m, k
      probe x = k.q
      simulate { stop = 4 s }
    }";
    let here = Folder::new().with("pole.bond", pole);
    let words = ["to measure errors against: collocation12, collocation10, ", "a step of `v` failed"];
    here.bond(&["run", "pole.bond", "--error", "1e-4"]).is(3, &[], &words);
}

/// A start that no fitted step gets away from is named, with the mend; by `--error` too. One that is a quarter as far
/// is run.
#[test]
fn a_start_far_from_rest_is_told() {
    let charged = "model Charged(q0 = 40e-6 C) {
      C:c { compliance = 1 uF; q0 = q0 }
      R:d { f = (1e-14 A)*(exp(e/(0.025 V)) - 1) }
      R:p = 100 Ohm
      0:n -> c, d, p
      simulate { stop = 0.1 ms }
    }";
    let here = Folder::new().with("charged.bond", charged);
    let start = ["at t = 0 s, the step of `n`", "start it nearer to its equilibrium"];
    here.bond(&["run", "charged.bond", "--tolerance", "1e-6", "--set", "q0=10 uC"]).is(0, &["passive     yes"], &[]);
    here.bond(&["run", "charged.bond", "--tolerance", "1e-6"]).is(3, &[], &start);
    let words = [&["cannot be measured", "adaptive steps fail"][..], &start].concat();
    here.bond(&["run", "charged.bond", "--error", "1e-5"]).is(3, &[], &words);
}

/// Whatever steps a machine can afford; one that is too slow for any says so.
#[test]
fn a_budget_keeps_the_balance() {
    let here = Folder::new().with("r.bond", RECTIFIER);
    for budget in ["60us", "1ms"] {
        let done = here.bond(&["run", "r.bond", "--method", "gonzalez", "--budget", budget, "--summary", "json"]);
        match done.status {
            0 => assert!(done.out.contains("\"passive\": true"), "{}", done.out),
            status => assert!(status == 3 && done.err.contains("no stepper takes at most"), "{status:?}: {}", done.err),
        }
    }
}

#[test]
fn a_budget_is_kept_or_refused() {
    let here = Folder::new().with("pendulum.bond", PENDULUM).with("a.bond", OSCILLATOR);
    let done = here.bond(&["run", "pendulum.bond", "--budget", "1s", "--summary", "json"]).is(0, &[], &[]);
    let chosen = serde_json::from_str::<Value>(&done.out).unwrap()["chosen"].clone();
    // A second of computing for a second is much: rounding is what is left.
    assert!(chosen["estimated_error"].as_f64().unwrap() < 1e-9, "{chosen}");
    assert!(chosen["why"].as_str().unwrap().contains("at most 1 s for a simulated second"), "{chosen}");
    here.bond(&["run", "pendulum.bond", "--budget", "1e-13"]).is(3, &[], &["no stepper", "cheapest"]);
    here.bond(&["run", "a.bond", "--budget", "1s"]).is(0, &["exact with steps of", "fit"], &[]);
}

/// Samples cut the steps between them: what is said is what was taken.
#[test]
fn steps_between_samples_are_told_as_they_are() {
    let here = Folder::new();
    here.bond(&["new", "scene"]).is(0, &[], &[]);
    let args = ["run", "scene/scene.bond", "--budget", "1s", "--stop", "3s"];
    here.bond(&args).is(0, &["exact with steps of 1 ms", "3000 steps"], &[]);
}

#[test]
fn what_does_not_go_together_is_told() {
    let here = Folder::new().with("p.bond", PENDULUM);
    for other in [["--step", "1ms"], ["--tolerance", "1e-6"], ["--budget", "1ms"], ["--resume", "x"]] {
        here.bond(&[&["run", "p.bond", "--error", "1e-5"], &other[..]].concat()).is(2, &[], &["cannot be used with"]);
    }
    here.bond(&["run", "p.bond", "--error", "1e-5", "--sweep", "gravity.q0=1,2"]).is(
        2,
        &[],
        &["--error", "single runs"],
    );
    here.bond(&["run", "p.bond", "--error", "2"]).is(2, &[], &["between 0 and 1"]);
    here.bond(&["run", "p.bond", "--error", "1e-5", "--method", "exact"]).is(2, &[], &["not linear"]);
}

/// A kick of 4 ms in 100 s is met by fitted steps alone, which are the same for most tolerances.
#[test]
fn short_kicks_have_a_reference() {
    let kick = "model Kick { Se:hammer = if t > 50.032 s and t < 50.036 s then 1000 N else 0 N
        I:m = 1 kg  R:b = 0.01 N*s/m  hammer -> 1:v -> m, b  probe speed = v.f  simulate { stop = 100 s } }";
    let here = Folder::new().with("kick.bond", kick);
    let done = here.bond(&["run", "kick.bond", "--error", "1e-4", "--summary", "json"]).is(0, &[], &[]);
    let summary: Value = serde_json::from_str(&done.out).unwrap();
    let speed = summary["final"]["speed"].as_f64().unwrap();
    // m v' = -b v from 4 N s on
    let wanted = 1e5 * (f64::exp(0.01 * 0.004) - 1.0) * f64::exp(-0.01 * (100.0 - 50.032));
    assert!((speed / wanted - 1.0).abs() < 1e-4, "{speed}, {wanted}");
}
