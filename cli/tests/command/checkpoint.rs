//! Runs that are saved and go on.

use super::{Folder, OSCILLATOR};

/// Fixed steps, steps fitted to a tolerance, exact ones, and what is sampled.
const NONLINEAR: &str = "\
model Swing {
  C:spring { H = 0.5*(100 N/m)*q^2 + 0.25*(1e4 N/m^3)*q^4; q0 = 0.1 m }
  I:mass = 1 kg
  R:drag { e = (3 N*s^2/m^2)*abs(f)*f }
  input push = 0 N
  MSe:hand = push
  sampled at 30 Hz {
    C:held { stiffness = 40 N/m }
    R:damper = 1 N*s/m
    1:w -> held, damper
  }
  hand -> 1:v -> spring, mass, drag
  v ||> w
  probe x = spring.q
  probe f = held.e
  simulate { stop = 1 s }
}
";

/// A pendulum without friction.
const SWINGING: &str = "\
model Swinging(E = 1 J) {
  C:s { H = E*(1 - cos(q)); q0 = 1 rad }
  I:m = 1 kg*m^2
  s -> 1:w -> m
  probe a = s.q
  simulate { stop = 2 s }
}
";

const PUSH: &str = "t,push\n0,0\n0.3,2\n0.77,-4\n1.9,3\n2.2,0\n";

/// All but the time that it took.
fn steady(json: &str) -> String {
    json.lines().filter(|l| !l.contains("wall_seconds")).collect()
}

#[test]
fn what_is_resumed_is_as_if_it_had_never_stopped() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("b.bond", NONLINEAR).with("push.csv", PUSH);
    // A law that is chosen by the accuracy, or made for a length of steps, is chosen and made anew.
    let here =
        here.with("c.bond", SWINGING).with("d.bond", SWINGING.replace("stop = 2 s", "stop = 2 s; tolerance = 1e-6"));
    let (gonzalez, collocation) = (["--method", "gonzalez"], ["--method", "collocation4"]);
    let cases: [(&str, &[&str], &[&str]); 12] = [
        ("c.bond", &["--tolerance", "1e-5", "--method", "gonzalez", "--longest", "5ms"], &gonzalez),
        ("c.bond", &["--tolerance", "1e-5", "--method", "collocation4", "--longest", "5ms"], &collocation),
        ("c.bond", &["--step", "3ms", "--method", "gonzalez"], &gonzalez),
        ("d.bond", &["--step", "1ms", "--method", "gonzalez"], &gonzalez),
        ("d.bond", &["--step", "1ms"], &[]),
        ("d.bond", &["--longest", "1ms", "--method", "gonzalez"], &gonzalez),
        ("a.bond", &["--longest", "10ms"], &[]),
        ("a.bond", &["--step", "3ms"], &[]),
        ("b.bond", &["--step", "1.3ms", "--input", "push.csv"], &["--input", "push.csv"]),
        ("b.bond", &["--tolerance", "1e-7", "--longest", "5ms", "--input", "push.csv"], &[]),
        ("b.bond", &["--longest", "10ms", "--input", "push.csv", "--input-hold"], &[]),
        ("b.bond", &["--step", "1ms", "--method", "rk4"], &["--method", "rk4"]),
    ];
    let rows = ["--every", "10ms", "--summary", "json"];
    for (file, first, second) in cases {
        let whole =
            here.bond(&[&["run", file, "--stop", "2", "-o", "whole.csv"], &rows[..], first].concat()).is(0, &[], &[]);
        here.bond(
            &[&["run", file, "--stop", "0.8", "-o", "first.csv", "--checkpoint", "s"], &rows[..], first].concat(),
        )
        .is(0, &[], &[]);
        let rest = here
            .bond(&[&["run", file, "--stop", "2", "-o", "rest.csv", "--resume", "s"], &rows[..], second].concat())
            .is(0, &[], &[]);
        assert_eq!(steady(&whole.out), steady(&rest.out), "{file} {first:?}");
        let whole = here.read("whole.csv");
        let (whole, rest) = (whole.lines().collect::<Vec<_>>(), here.read("rest.csv"));
        let rest: Vec<&str> = rest.lines().collect();
        assert_eq!(rest.len(), 121);
        assert_eq!(whole[whole.len() - 120..], rest[1..], "{file} {first:?}");
    }
}

/// Nobody looks at the first leg: what is resumed is the same.
#[test]
fn looking_changes_nothing() {
    let here = Folder::new();
    let model = super::model("examples/virtual_wall.bond");
    let run = |args: &[&str]| {
        here.bond(&[&["run", model.to_str().unwrap(), "--every", "10ms"], args].concat()).is(0, &[], &[]);
    };
    run(&["--stop", "3s", "--longest", "10ms", "-o", "whole.csv", "--checkpoint", "seen"]);
    run(&["--stop", "3s", "--longest", "10ms", "--checkpoint", "unseen"]);
    assert!(std::fs::read(here.0.join("seen")).unwrap() == std::fs::read(here.0.join("unseen")).unwrap());
    run(&["--stop", "1s", "--longest", "10ms", "--checkpoint", "first"]);
    run(&["--stop", "3s", "--resume", "first", "-o", "rest.csv"]);
    let (whole, rest) = (here.read("whole.csv"), here.read("rest.csv"));
    let (whole, rest): (Vec<&str>, Vec<&str>) = (whole.lines().collect(), rest.lines().collect());
    assert_eq!(rest.len(), 201);
    assert_eq!(whole[whole.len() - 200..], rest[1..]);
}

/// What a step goes over decides how tight resistors are solved: a run goes on as it began, to whatever end.
#[test]
fn tight_resistors_go_on_as_they_began() {
    let text = "\
model Tight {
  C:c1 { compliance = 1 uF; q0 = 1e-6 C }
  C:c2 = 2 uF
  R:r = 1e-3 Ohm
  I:l = 1 H
  R:d { e = 1 Ohm * f + 0.1 Ohm/A^2 * f^3 }
  0:a -> c1
  1:m -> r
  a -> m -> 0:b
  b -> c2
  1:n -> l, d
  b -> n
  probe u = c1.e
  simulate { stop = 5 ms; step = 10 us; method = gonzalez }
}
";
    let here = Folder::new().with("a.bond", text);
    let run = |args: &[&str]| here.bond(&[&["run", "a.bond", "--summary", "json"], args].concat()).is(0, &[], &[]).out;
    for step in [&[][..], &["--step", "1us"], &["--step", "1ms"]] {
        run(&[step, &["--checkpoint", "s"]].concat());
        for stop in ["10ms", "1s"] {
            let whole = run(&[step, &["--stop", stop]].concat());
            assert_eq!(steady(&whole), steady(&run(&["--stop", stop, "--resume", "s"])), "{step:?} to {stop}");
        }
    }
}

/// What was made for the steps that the command line told goes on where the model tells others.
#[test]
fn made_for_the_steps_of_the_command_line() {
    let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let here = Folder::new();
    for name in ["classics/accumulator", "classics/dc_generator", "classics/muscle", "hard/henon_heiles"] {
        let file = models.join(name).with_extension("bond").display().to_string();
        here.bond(&["run", &file, "--stop", "10ms", "--longest", "1ms", "--checkpoint", "s"]).is(0, &[], &[]);
        here.bond(&["run", &file, "--stop", "20ms", "--resume", "s"]).is(0, &["from 0.01 s to 0.02 s"], &[]);
    }
}

#[test]
fn states_are_saved_on_the_way() {
    let here = Folder::new().with("b.bond", NONLINEAR);
    let run = |args: &[&str]| here.bond(&[&["run", "b.bond", "--summary", "json"], args].concat()).is(0, &[], &[]).out;
    let whole = run(&["--stop", "2"]);
    // Saving changes nothing.
    assert_eq!(steady(&whole), steady(&run(&["--stop", "2", "--checkpoint", "s", "--checkpoint-every", "130ms"])));
    assert_eq!(here.list(), ["b.bond", "s"]);
    // A run that fails keeps the last state that was saved, and says whether there is one.
    let here = here.with("fails.bond", super::BLOWS_UP);
    here.bond(&["run", "fails.bond", "--checkpoint", "f", "--checkpoint-every", "0.7"]).is(
        3,
        &[],
        &["at t = 0.99", "f has the state at 0.7"],
    );
    here.bond(&["run", "fails.bond", "--checkpoint", "g"]).is(
        3,
        &[],
        &["no state was saved; --checkpoint-every saves during the run"],
    );
    assert!(!here.list().contains(&"g".to_string()));
    here.bond(&["run", "fails.bond", "--stop", "0.95", "--resume", "f"]).is(0, &["from 0.7 s to 0.95 s"], &[]);
}

#[test]
fn what_cannot_go_on_is_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("b.bond", NONLINEAR).with("text", "no state");
    here.bond(&["run", "a.bond", "--checkpoint", "s"]).is(0, &[], &[]);
    let fails = |args: &[&str], why: &str| {
        here.bond(&[&["run"], args].concat()).is(2, &[], &[why]);
    };
    fails(&["a.bond", "--resume", "s"], "saved at 1 s, and the run ends at 1 s; give a later end with --stop");
    fails(&["b.bond", "--resume", "s", "--stop", "2"], "the state of `Oscillator`, and this is `Swing`");
    fails(&["a.bond", "--resume", "s", "--stop", "2", "--set", "k=99"], "a parameter or a method has changed");
    fails(&["a.bond", "--resume", "text", "--stop", "2"], "cannot resume text: it is not the state of a run");
    fails(&["a.bond", "--resume", "nothing", "--stop", "2"], "cannot read nothing");
    fails(&["a.bond", "--resume", ".", "--stop", "2"], "cannot read .: it is a directory");
    fails(&["a.bond", "--resume", "-", "--stop", "2"], "--resume needs a file");
    fails(&["a.bond", "--resume", "s", "--stop", "2", "--step", "1ms"], "cannot be used with '--step");
    fails(&["a.bond", "--checkpoint", "-"], "needs a file");
    fails(&["a.bond", "--resume", "s", "--stop", "2", "--at", "1.5,0.5"], "--at 0.5 is not after 1 s");
    fails(&["a.bond", "--checkpoint", "x", "-o", "x"], "-o and --checkpoint name the same file");
    fails(&["a.bond", "--checkpoint-every", "1s"], "--checkpoint");
    let mut bytes = std::fs::read(here.0.join("s")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(here.0.join("s"), bytes).unwrap();
    fails(&["a.bond", "--resume", "s", "--stop", "2"], "its bytes are not those that were written");
}
