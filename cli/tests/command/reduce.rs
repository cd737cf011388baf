use super::{Folder, OSCILLATOR};
use serde_json::Value;

/// A capacitor that empties through a resistor, with a coil and a resistor that hardly count.
const EMPTIES: &str = "\
model Empties(r = 1 Ohm) {
  C:cap { compliance = 1 F; q0 = 2 C }
  R:load = r
  I:lead = 1 nH
  R:wire = 1 uOhm
  cap -> 1:i -> load, lead, wire
  probe q = cap.q
  simulate { stop = 1 s; tolerance = 1e-9 }
}
";

fn reduced(here: &Folder, args: &[&str]) -> Value {
    let done = here.bond(&[&["reduce"], args, &["--as", "json"]].concat());
    let done = done.is(0, &[], &[]);
    serde_json::from_str(&done.out).unwrap()
}

fn names(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|x| x.as_str().unwrap()).collect()
}

/// The activities are those of the closed form, and what is left out is what hardly counts.
#[test]
fn least_active_parts() {
    let here = Folder::new().with("e.bond", EMPTIES);
    let all = reduced(&here, &["e.bond", "--error", "0.01"]);
    assert_eq!(names(&all["without"]), ["lead", "wire"]);
    let part = |name: &str| {
        let list = all["parts"].as_array().unwrap();
        list.iter().find(|p| p["name"] == name).cloned().unwrap()
    };
    // 4 V^2 / (2 Ohm) (1 - exp(-2)) J go from one to the other; in the first row the coil still holds the current up.
    let energy = 2.0 * (1.0 - (-2.0f64).exp());
    for name in ["cap", "load"] {
        let activity = part(name)["activity"].as_f64().unwrap();
        assert!((activity / energy - 1.0).abs() < 1e-3, "{name}: {activity}, {energy}");
    }
    let wire = part("wire")["activity"].as_f64().unwrap();
    assert!((wire / energy * 1e6 - 1.0).abs() < 1e-3, "{wire}");
    assert_eq!(part("cap")["kept_because"], "the probe `q` reads it");
    assert!(part("load")["kept_because"].as_str().unwrap().contains("without it"), "{all}");
    let shares: f64 = all["parts"].as_array().unwrap().iter().map(|p| p["share"].as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-12);
    let order: Vec<f64> = all["parts"].as_array().unwrap().iter().map(|p| p["activity"].as_f64().unwrap()).collect();
    assert!(order.is_sorted());
    assert_eq!((&all["whole"]["states"], &all["reduced"]["states"]), (&2.into(), &1.into()));
    assert_eq!((&all["whole"]["parts"], &all["reduced"]["parts"]), (&4.into(), &2.into()));
    // What moves is told, by no more than was asked.
    assert!((1e-9..=0.01).contains(&all["moved"]["q"].as_f64().unwrap()), "{all}");
    // The wire takes 1e-6 of the current: that is told where less is asked for.
    let close = reduced(&here, &["e.bond", "--error", "1e-7"]);
    assert_eq!(names(&close["without"]), ["lead"], "{close}");
    let all = reduced(&here, &["e.bond", "--error", "1e-10"]);
    assert_eq!(names(&all["without"]), [""; 0], "{all}");
    assert!(all["moved"]["q"] == 0.0 && all["whole"]["states"] == all["reduced"]["states"]);
    let set = reduced(&here, &["e.bond", "--error", "0.01", "--set", "r=1 uOhm", "--stop", "1ms"]);
    assert!(!names(&set["without"]).contains(&"wire"), "{set}");
}

/// The command that it names runs the reduced model, as do the others with the same option.
#[test]
fn what_is_left_runs() {
    let here = Folder::new().with("e.bond", EMPTIES);
    let done = here.bond(&["reduce", "e.bond", "--error", "0.01", "--set", "r=2 Ohm"]);
    let done = done.is(0, &["Empties", "left out", "kept: the probe `q` reads it", "time for a second"], &[]);
    let last = done.out.lines().last().unwrap();
    assert_eq!(last, "bond run e.bond --set 'r=2 Ohm' --without lead,wire");
    let without = ["--set", "r=2 Ohm", "--without", "lead,wire"];
    let run = here.bond(&[&["run", "e.bond"], &without[..]].concat());
    run.is(0, &["passive     yes", "continuous, 1 state"], &[]);
    let shown = here.bond(&[&["show", "e.bond", "regions"], &without[..]].concat());
    assert!(!shown.out.contains("lead") && shown.status == 0, "{shown:?}");
    here.bond(&[&["linearize", "e.bond"], &without[..]].concat()).is(0, &["\"cap.q\""], &[]);
    here.bond(&[&["build", "e.bond", "-o", "e"], &without[..]].concat()).is(0, &[], &["built e"]);
    let built = |args: &[&str]| {
        let done = std::process::Command::new(here.0.join("e")).args(args).current_dir(&here.0).output().unwrap();
        (done.status.code(), String::from_utf8(done.stdout).unwrap() + &String::from_utf8(done.stderr).unwrap())
    };
    let (status, text) = built(&["run"]);
    assert!(status == Some(0) && text.contains("continuous, 1 state"), "{text}");
    assert!(built(&["--help"]).1.contains("Left out when it was built:\n  lead\n  wire"));
    let (status, text) = built(&["run", "--without", "load"]);
    assert!(status == Some(2) && text.contains("--without: model, parameters and methods"), "{text}");
    // Each instance of an ensemble is without it, and another ensemble is another.
    let sweep = ["run", "e.bond", "--sweep", "r=1,2", "--without", "lead", "-o", "s.csv"];
    here.bond(&sweep).is(0, &["2"], &[]);
    here.bond(&["reduce", "e.bond", "--error", "0.01", "--without", "lead", "-o", "r.txt"]).is(0, &[], &[]);
    assert!(here.read("r.txt").ends_with("bond run e.bond --without lead,wire\n"));
}

#[test]
fn what_is_wrong_is_told() {
    let mute = "model Mute {\n  C:c = 1 F; R:r = 1 Ohm\n  c -> 1:i -> r\n}\n";
    let here = Folder::new().with("e.bond", EMPTIES).with("mute.bond", mute).with("o.bond", OSCILLATOR);
    here.bond(&["reduce", "e.bond"]).is(2, &[], &["--error <E>"]);
    here.bond(&["reduce", "e.bond", "--error", "2"]).is(2, &[], &["between 0 and 1"]);
    here.bond(&["reduce", "e.bond", "--error", "0.1", "-o", "e.bond"]).is(2, &[], &["a model"]);
    here.bond(&["reduce", "gone.bond", "--error", "0.1"]).is(2, &[], &["cannot read gone.bond"]);
    here.bond(&["reduce", "mute.bond", "--error", "0.1"]).is(1, &[], &["`Mute` has no probe"]);
    here.bond(&["reduce", "o.bond", "--error", "1e-3"]).is(0, &["nothing can be left out at this error"], &[]);
    here.bond(&["run", "e.bond", "--without", "lad"]).is(2, &[], &["no element `lad`", "did you mean `lead`?"]);
    here.bond(&["run", "e.bond", "--without", "cap"]).is(2, &[], &["--without cap: the probe `q` reads it"]);
    here.bond(&["run", "e.bond", "--without", "lead,,wire"]).is(2, &[], &["the name of an element is missing"]);
    // What an expectation reads stays.
    here.bond(&["run", "o.bond", "--without", "spring"]).is(2, &[], &["reads it"]);
}

/// What no probe depends on is named, and not tried; what is left out has its indices, which the next command takes,
/// with all else that the run was made with. Whatever the file is called, a shell takes the command for what it is.
#[cfg(unix)]
#[test]
fn no_shell_reads_more_into_it() {
    let here = Folder::new();
    for (file, named) in [
        ("my $(touch pwn) car's.bond", "'my $(touch pwn) car'\\''s.bond'"),
        ("a\"b`touch pwn`c$d!.bond", "'a\"b`touch pwn`c$d!.bond'"),
        ("-r.bond", "./-r.bond"),
    ] {
        std::fs::write(here.0.join(file), EMPTIES).unwrap();
        let done = here.bond(&["reduce", "--error", "0.01", "--", file]).is(0, &[], &[]);
        let line = done.out.lines().last().unwrap().to_string();
        assert_eq!(line, format!("bond run {named} --without lead,wire"));
    }
}

#[test]
fn the_last_line_runs() {
    let here = Folder::new().with(
        "grid.bond",
        "model Grid {
           input u = 1 V
           Se:e = u
           e -> 0:top
           for i in 1..2 { for j in 1..2 { R:r[i,j] = 1 Ohm; R:tiny[i,j] = 1e-9 Ohm; top -> 1:b[i,j] -> r[i,j], tiny[i,j] } }
           Sf:alone = 1 A; R:other = 1 Ohm; alone -> other
           state idle = 0 { didle = 1/(1 s) }
           probe x = r[1,1].f
           simulate { stop = 1 s }
         }",
    );
    let left = "left out    the region `alone`, the state `idle`: no probe, open port or expectation depends on them";
    let args = ["grid.bond", "--error", "0.01", "--stop", "2s", "--step", "100ms"];
    let done = here.bond(&[&["reduce"], &args[..]].concat()).is(0, &[left], &[]);
    let line = done.out.lines().last().unwrap_or_default().replace('\'', "");
    assert!(line.contains("tiny[1,1]") && line.ends_with("--stop 2.0 --step 0.1"), "{line}");
    let words: Vec<&str> = line.split(' ').skip(1).collect();
    here.bond(&words).is(0, &["simulated   2 s", left], &[]);
    here.bond(&["run", "grid.bond", "--without", "tiny[1][2], tiny[ 2,1 ]"]).is(0, &["passive     yes"], &[]);
    here.bond(&["check", "grid.bond"]).is(0, &[], &["1 region, 0 states; left out: the region `alone`"]);
    let summary = here.bond(&["run", "grid.bond", "--summary", "json"]).is(0, &[], &[]).out;
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["left_out"], serde_json::json!({"regions": ["alone"], "states": ["idle"]}));
    let linear = here.bond(&["linearize", "grid.bond"]).is(0, &[], &[]).out;
    assert_eq!(serde_json::from_str::<Value>(&linear).unwrap()["states"], serde_json::json!(["idle"]));
}
