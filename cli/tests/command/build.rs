//! Executables that carry a scene.

use super::{Done, Folder, OSCILLATOR};
use std::process::Command;

/// Runs a file of the folder, without any other program in reach.
fn environment(here: &Folder, name: &str, args: &[&str]) -> Done {
    let file = here.0.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    let mut command = Command::new(file);
    command.args(args).current_dir(&here.0).env("PATH", "");
    // A test beside this one that starts a program just then holds the new file open for a moment.
    let output = loop {
        match command.output() {
            Err(e) if e.kind() == std::io::ErrorKind::ExecutableFileBusy => std::thread::yield_now(),
            other => break other.unwrap(),
        }
    };
    let done = Done {
        status: output.status.code().unwrap_or(-1),
        out: String::from_utf8_lossy(&output.stdout).into_owned(),
        err: String::from_utf8_lossy(&output.stderr).into_owned(),
    };
    assert!(!done.err.contains("panicked"), "{args:?}: {}", done.err);
    done
}

fn steady(json: &str) -> String {
    json.lines().filter(|l| !l.contains("wall_seconds")).collect()
}

#[test]
fn what_is_built_runs_as_the_model_does() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let built = here.bond(&["build", "a.bond", "--set", "k=144 N/m"]).is(0, &[], &["built a (", "the scene is"]);
    assert_eq!(built.out, "");
    // The model is not needed any more.
    let wanted =
        here.bond(&["run", "a.bond", "--set", "k=144", "--summary", "json", "-o", "wanted.csv"]).is(0, &[], &[]);
    std::fs::remove_file(here.0.join("a.bond")).unwrap();
    let found = environment(&here, "a", &["run", "--summary", "json", "-o", "found.csv"]).is(0, &[], &[]);
    assert_eq!(steady(&wanted.out), steady(&found.out));
    assert_eq!(here.read("wanted.csv"), here.read("found.csv"));
    let found =
        environment(&here, "a", &["run", "--stop", "0.1", "--at", "0.05", "-o", "-"]).is(0, &["t,x,v\n0.05,"], &[]);
    assert_eq!(found.out.lines().count(), 2);
    // Nothing is left beside it.
    let suffix = std::env::consts::EXE_SUFFIX;
    assert_eq!(here.list(), [format!("a{suffix}"), "found.csv".into(), "wanted.csv".into()]);
}

/// Step programs are made for the steps and the end of a run, and it takes part in the choice of steppers whether there
/// is a tolerance.
#[test]
fn the_same_options_give_the_same_bytes() {
    let part = "model Swing(E = 1 J) { port tip  C:s { H = E*(1 - cos(q)); q0 = 1 rad }  tip -> s }";
    let scene = "use \"parts/swing.bond\"
model Swinging(r = 1 kOhm) {
  Swing:swing
  I:m = 1 kg*m^2
  1:w -> swing.tip, m
  // What a step goes over decides how its resistor is solved.
  C:c1 { compliance = 1 uF; q0 = 1e-6 C }
  C:c2 = 2 uF
  R:tight = r
  I:l = 1 H
  R:d { e = 1 Ohm * f + 0.1 Ohm/A^2 * f^3 }
  0:a -> c1
  a -> 1:u -> tight
  u -> 0:b -> c2
  b -> 1:n -> l, d
  probe angle = swing.s.q
  probe voltage = c1.e
  simulate { stop = 50 ms; tolerance = 1e-8 }
}
model Other { C:c = 1 F }
";
    let here = Folder::new().with("models/a.bond", scene).with("models/parts/swing.bond", part);
    let choice = ["--model", "Swinging", "--set", "swing.E=2 N*m", "--set", "r=1 mOhm"];
    here.bond(&[&["build", "models/a.bond", "-o", "here"][..], &choice].concat()).is(0, &[], &[]);
    let cases: [&[&str]; 7] = [
        &[],
        &["--step", "50us"],
        &["--step", "1us"],
        &["--tolerance", "1e-4"],
        &["--tolerance", "1e-9", "--longest", "1ms"],
        &["--stop", "20ms"],
        &["--stop", "20ms", "--step", "100us", "--every", "1ms"],
    ];
    let steady = |text: String| text.lines().filter(|l| !l.contains("simulated")).map(String::from).collect::<Vec<_>>();
    let rest = ["-o", "-", "--checkpoint", "s"];
    let wanted: Vec<_> = cases
        .iter()
        .map(|case| {
            let run = [&["run", "models/a.bond"], &choice[..], case, &rest].concat();
            let done = here.bond(&run).is(0, &[], &[]);
            (done.out, steady(done.err), std::fs::read(here.0.join("s")).unwrap())
        })
        .collect();
    std::fs::remove_dir_all(here.0.join("models")).unwrap();
    for (case, wanted) in cases.iter().zip(wanted) {
        let done = environment(&here, "here", &[&["run"], *case, &rest].concat()).is(0, &[], &[]);
        let found = (done.out, steady(done.err), std::fs::read(here.0.join("s")).unwrap());
        assert!(found == wanted, "{case:?}: {:?} and {:?}", found.1, wanted.1);
        let on = ["run", "--resume", "s", "--stop", "60ms"];
        environment(&here, "here", &on).is(0, &["to 0.06 s"], &[]);
    }
}

#[test]
fn it_tells_what_it_is() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["build", "a.bond", "-o", "here", "--set", "m=2kg", "--method", "gonzalez"]).is(0, &[], &[]);
    let told = ["`Oscillator`", "x [m]", "v [m/s]", "m = 2 kg", "method gonzalez", "stop 1 s", "run "];
    environment(&here, "here", &["--help"]).is(0, &told, &[]);
    environment(&here, "here", &[]).is(2, &[], &told);
    // It meets nobody.
    assert!(!environment(&here, "here", &["--help"]).is(0, &[], &[]).out.contains("serve"));
    environment(&here, "here", &["--version"]).is(0, &["Oscillator (bond "], &[]);
    environment(&here, "here", &["run"]).is(0, &["gonzalez (order 2)"], &[]);
    for fixed in [["--set", "k=1"], ["--method", "exact"], ["--model", "Oscillator"]] {
        environment(&here, "here", &["run", fixed[0], fixed[1]]).is(
            2,
            &[],
            &["were fixed when it was built", fixed[0]],
        );
    }
    environment(&here, "here", &["check", "a.bond"]).is(2, &[], &["unrecognized"]);
}

#[test]
fn states_go_from_one_to_the_other() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["build", "a.bond", "-o", "here"]).is(0, &[], &[]);
    here.bond(&["run", "a.bond", "--step", "1ms", "--stop", "0.5", "--checkpoint", "s"]).is(0, &[], &[]);
    let resumed = environment(&here, "here", &["run", "--resume", "s", "--summary", "json"]).is(0, &[], &[]);
    let whole = environment(&here, "here", &["run", "--step", "1ms", "--summary", "json"]).is(0, &[], &[]);
    assert_eq!(steady(&resumed.out), steady(&whole.out));
}

#[test]
fn what_is_damaged_does_not_run() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["build", "a.bond", "-o", "here"]).is(0, &[], &[]);
    let file = here.0.join(format!("here{}", std::env::consts::EXE_SUFFIX));
    let mut bytes = std::fs::read(&file).unwrap();
    let at = bytes.len() - 100;
    bytes[at] ^= 4;
    std::fs::write(&file, &bytes).unwrap();
    environment(&here, "here", &["run"]).is(1, &[], &["is damaged: its bytes are not those that were written"]);
    bytes[at] ^= 4;
    let at = bytes.len() - 15;
    bytes[at] ^= 4;
    std::fs::write(&file, &bytes).unwrap();
    environment(&here, "here", &["run"]).is(1, &[], &["is damaged"]);
}

#[test]
fn it_is_not_written_over_by_what_it_computes() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["build", "a.bond", "-o", "here"]).is(0, &[], &[]);
    let name = format!("./here{}", std::env::consts::EXE_SUFFIX);
    for option in ["-o", "--ledger", "--checkpoint"] {
        environment(&here, "here", &["run", option, &name]).is(2, &[], &["it is this program itself"]);
    }
    let copy = format!("copy{}", std::env::consts::EXE_SUFFIX);
    std::fs::copy(env!("CARGO_BIN_EXE_bond"), here.0.join(&copy)).unwrap();
    environment(&here, "copy", &["build", "a.bond", "-o", &copy]).is(2, &[], &["it is this program itself"]);
    environment(&here, "here", &["run"]).is(0, &["Oscillator"], &[]);
}

/// Without its end it is not taken for `bond`.
#[cfg(target_os = "linux")]
#[test]
fn what_is_cut_off_does_not_run() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["build", "a.bond", "-o", "here"]).is(0, &[], &[]);
    let file = here.0.join("here");
    let whole = std::fs::metadata(&file).unwrap().len();
    let program = std::fs::metadata(env!("CARGO_BIN_EXE_bond")).unwrap().len();
    for length in [whole - 1, whole - 20, (program + whole) / 2, program + 8] {
        std::fs::OpenOptions::new().write(true).open(&file).unwrap().set_len(length).unwrap();
        let done = environment(&here, "here", &["check", "a.bond"]);
        done.is(1, &[], &["the scene at the end of this program is damaged: its end is missing; build it again"]);
    }
}

#[test]
fn wrong_places_are_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("folder/b.bond", OSCILLATOR).with("model", OSCILLATOR);
    here.bond(&["build", "folder/b.bond", "-o", "folder"]).is(
        2,
        &[],
        &["it is a directory; name another file with -o"],
    );
    here.bond(&["build", "a.bond", "-o", "-"]).is(2, &[], &["an executable needs a file"]);
    #[cfg(unix)]
    {
        // What is no file stays what it is.
        let path = here.0.join("socket");
        let socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
        here.bond(&["build", "a.bond", "-o", "socket"]).is(2, &[], &["it is a device or a pipe; name another file"]);
        drop(socket);
        assert!(!std::fs::metadata(&path).unwrap().is_file());
        std::fs::remove_file(path).unwrap();
    }
    here.bond(&["build", "model"]).is(2, &[], &["is the model itself"]);
    here.bond(&["build", "a.bond", "-o", "nowhere/a"]).is(2, &[], &["cannot write nowhere/a"]);
    here.bond(&["build", "a.bond", "--emit", "nonsense"]).is(2, &[], &["nonsense"]);
    assert_eq!(here.list(), ["a.bond", "folder", "model"]);
}

#[cfg(unix)]
#[test]
fn everybody_may_run_it() {
    use std::os::unix::fs::PermissionsExt;
    let here = Folder::new().with("a.bond", OSCILLATOR).with("here", "something else, which nobody may execute");
    here.bond(&["build", "a.bond", "-o", "here"]).is(0, &[], &[]);
    assert_eq!(std::fs::metadata(here.0.join("here")).unwrap().permissions().mode() & 0o777, 0o755);
}
