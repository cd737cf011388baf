use super::{BLOWS_UP, Folder, OSCILLATOR, WRONG, table};
use serde_json::Value;

#[test]
fn the_summary_goes_to_standard_output() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let done = here.bond(&["run", "a.bond"]).is(0, &["Oscillator", "passive     yes", "dissipated  0.18", "x  "], &[]);
    assert_eq!(done.err, "");
    let done = here.bond(&["run", "a.bond", "--summary", "json"]).is(0, &[], &[]);
    let json: Value = serde_json::from_str(&done.out).unwrap();
    assert_eq!(json["model"], "Oscillator");
    assert_eq!(json["stop"], 1.0);
    assert_eq!(json["passive"], true);
    assert!(json["balance"]["worst_step"].as_f64().unwrap() < 1e-12);
    let region = &json["regions"][0];
    for key in [
        "name",
        "kind",
        "states",
        "stepper",
        "order",
        "steps",
        "newton_iterations",
        "H_initial",
        "H_final",
        "supplied",
        "dissipated",
        "leaked",
        "debt_max",
        "leaps",
    ] {
        assert!(!region[key].is_null(), "{key}");
    }
    assert!(region["period"].is_null());
    assert!(json["final"]["x"].is_f64() && json["final"]["v"].is_f64());
}

#[test]
fn rows_are_where_they_were_asked_for() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let run = |args: &[&str]| {
        here.bond(&[&["run", "a.bond", "-o", "-", "--summary", "json"], args].concat()).is(
            0,
            &[],
            &["\"passive\": true"],
        )
    };
    let times = |args: &[&str]| run(args).table().1.iter().map(|r| r[0]).collect::<Vec<_>>();
    assert_eq!(run(&[]).table().0, ["t", "x", "v"]);
    assert_eq!(times(&[]).len(), 1001);
    assert_eq!(times(&["--at", "300ms,0.1,0,1"]), [0.0, 0.1, 0.3, 1.0]);
    assert_eq!(times(&["--every", "0.3"]), [0.0, 0.3, 0.6, 3.0 * 0.3, 1.0]);
    assert_eq!(times(&["--every", "0.5s", "--at", "0.2,0.5"]), [0.0, 0.2, 0.5, 1.0]);
    assert_eq!(times(&["--stop", "10ms", "--every", "1"]), [0.0, 0.01]);
    // The exact step is exact wherever it is looked at.
    for row in run(&["--at", "0.1,0.5,1"]).table().1 {
        let (w, d) = ((100.0f64 - 0.0625).sqrt(), 0.25);
        let x = 0.1 * (-d * row[0]).exp() * ((w * row[0]).cos() + d / w * (w * row[0]).sin());
        assert!((row[1] - x).abs() < 1e-12, "{row:?}");
    }
}

#[test]
fn parameters_and_methods_are_set() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let last = |args: &[&str]| {
        let done = here.bond(&[&["run", "a.bond", "-o", "-", "--at", "1"], args].concat()).is(0, &[], &[]);
        done.table().1[0][1]
    };
    assert_eq!(last(&["--set", "m=4"]), last(&["--set", "m=4000 g"]));
    assert_ne!(last(&["--set", "m=4"]), last(&[]));
    assert_eq!(last(&["--set", "m=2kg", "--set", "k=5e1"]), last(&["--set", "k=50 N/m", "--set", "m=2"]));
    let exact = last(&[]);
    let off = |h: &str| (last(&["--method", "gonzalez", "--step", h]) - exact).abs();
    let order = (off("2ms") / off("1ms")).log2();
    assert!((order - 2.0).abs() < 0.1, "{order}");
    assert!((last(&["--method", "gonzalez", "--tolerance", "1e-9"]) - exact).abs() < 1e-5);
}

#[test]
fn files_are_written_whole() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["run", "a.bond", "-o", "a.csv", "--ledger", "l.csv", "--every", "0.1"]).is(0, &["Oscillator"], &[]);
    assert_eq!(here.list(), ["a.bond", "a.csv", "l.csv"]);
    let (header, rows) = table(&here.read("l.csv"));
    assert_eq!(header[0], "t");
    assert_eq!(rows.len(), 11);
    let at = |name: &str| header.iter().position(|h| h == name).unwrap();
    for row in &rows {
        let balance = row[at("w.H")] - rows[0][at("w.H")] - row[at("w.supplied")] + row[at("w.dissipated")];
        assert!(balance.abs() < 1e-12, "{row:?}");
        assert_eq!(row[at("w/damper.dissipated")], row[at("w.dissipated")]);
    }
    // Nothing is left of a run that could not begin.
    here.bond(&["run", "a.bond", "-o", "none/a.csv"]).is(
        2,
        &[],
        &["cannot write none/a.csv: its folder does not exist"],
    );
    here.bond(&["run", "a.bond", "-o", "b.csv", "--ledger", "none/l.csv"]).is(2, &[], &["cannot write"]);
    assert_eq!(here.list(), ["a.bond", "a.csv", "l.csv"]);
}

/// A slip of the pen does not cost the text of a model.
#[test]
fn no_result_takes_the_place_of_a_model() {
    let here = Folder::new().with("a.bond", super::OSCILLATOR);
    let slips: [&[&str]; 9] = [
        &["run", "a.bond", "-o", "a.bond"],
        &["run", "a.bond", "--ledger", "./a.bond"],
        &["run", "a.bond", "--checkpoint", "b.BOND"],
        &["run", "a.bond", "--sweep", "m=1,2", "-o", "a.bond"],
        &["bench", "a.bond", "-o", "a.bond"],
        &["show", "a.bond", "-o", "a.bond"],
        &["linearize", "a.bond", "-o", "a.bond"],
        &["build", "a.bond", "-o", "a.bond"],
        &["build", "a.bond", "--emit", "c", "-o", "a.bond"],
    ];
    for slip in slips {
        here.bond(slip).is(2, &[], &[if slip[0] == "build" { "a.bond" } else { "; name another file" }]);
    }
    here.bond(&["build", "a.bond", "-o", "mine.bond"]).is(2, &[], &["that is the name of a model"]);
    assert_eq!((here.list(), here.read("a.bond")), (vec!["a.bond".to_string()], super::OSCILLATOR.to_string()));
}

/// Nor that of anything else that is read, however it is named and spelled.
#[test]
fn no_result_takes_the_place_of_what_is_read() {
    let here = Folder::new().with("a.model", CHARGE).with("a.csv", "t,u\n0,1\n4,1\n").with("folder/x", "");
    here.bond(&["run", "a.model", "--checkpoint", "z.csv"]).is(0, &[], &[]);
    let state = std::fs::read(here.0.join("z.csv")).unwrap();
    let model = "it is the model itself; name another file";
    let table = "it is the table of --input itself; name another file";
    let slips: [(&[&str], &str); 13] = [
        (&["run", "a.model", "-o", "a.model"], model),
        (&["run", "a.model", "--checkpoint", "folder/../a.model"], model),
        (&["run", "a.model", "--ledger", "./a.model"], model),
        (&["run", "a.model", "--sweep", "x=1,2", "-o", "a.model"], model),
        (&["show", "a.model", "-o", "./a.model"], model),
        (&["linearize", "a.model", "-o", "a.model"], model),
        (&["bench", "a.model", "-o", "a.model"], model),
        (&["serve", "a.model", "--stdio", "--ledger", "a.model"], model),
        (&["run", "a.model", "--input", "a.csv", "-o", "./a.csv"], table),
        (&["run", "a.model", "--input", "./a.csv", "--checkpoint", "a.csv"], table),
        (&["run", "a.model", "--input", "a.csv", "--sweep", "x=1,2", "-o", "a.csv"], table),
        (&["bench", "a.model", "--input", "a.csv", "-o", "a.csv"], table),
        (
            &["run", "a.model", "--stop", "3", "--resume", "z.csv", "-o", "./z.csv"],
            "it is the state of --resume itself",
        ),
    ];
    for (slip, why) in slips {
        here.bond(slip).is(2, &[], &[why]);
    }
    assert_eq!(here.read("a.model"), CHARGE);
    assert_eq!(here.read("a.csv"), "t,u\n0,1\n4,1\n");
    assert_eq!(std::fs::read(here.0.join("z.csv")).unwrap(), state);
    // A state may take the place of the one that was gone on from.
    here.bond(&["run", "a.model", "--stop", "3", "--resume", "z.csv", "--checkpoint", "./z.csv"]).is(0, &[], &[]);
    assert_ne!(std::fs::read(here.0.join("z.csv")).unwrap(), state);
    assert_eq!(here.list(), ["a.csv", "a.model", "folder", "z.csv"]);
}

/// Nor where its name is that of something else: what a link points to counts.
#[cfg(unix)]
#[test]
fn no_result_takes_the_place_of_a_model_over_a_link() {
    use std::os::unix::fs::symlink;
    let here = Folder::new().with("a.bond", OSCILLATOR).with("b.bond", OSCILLATOR);
    for link in ["out.csv", "out.c", "out.h", "out.svg", "a.snap"] {
        symlink("b.bond", here.0.join(link)).unwrap();
    }
    symlink("gone.bond", here.0.join("gone.csv")).unwrap();
    let slips: [&[&str]; 11] = [
        &["run", "a.bond", "-o", "out.csv"],
        &["run", "a.bond", "--plot", "out.svg"],
        &["run", "a.bond", "--ledger", "out.csv"],
        &["run", "a.bond", "--checkpoint", "out.csv"],
        &["run", "a.bond", "--sweep", "m=1,2", "-o", "out.csv"],
        &["bench", "a.bond", "-o", "out.csv"],
        &["bench", "a.bond", "--plot", "out.svg"],
        &["show", "a.bond", "-o", "out.csv"],
        &["build", "a.bond", "-o", "out.csv"],
        &["build", "a.bond", "--emit", "c", "--step", "1ms", "-o", "out.c"],
        &["test", "a.bond", "--update"],
    ];
    for slip in slips {
        here.bond(slip).is(2, &[], &["b.bond, a model; name another file"]);
    }
    here.bond(&["run", "a.bond", "-o", "gone.csv"]).is(2, &[], &["gone.bond, a model"]);
    assert_eq!((here.read("a.bond"), here.read("b.bond")), (OSCILLATOR.to_string(), OSCILLATOR.to_string()));
    // A link to what is not there yet stays one: its target is made.
    symlink("rows.csv", here.0.join("link.csv")).unwrap();
    here.bond(&["run", "a.bond", "-o", "link.csv"]).is(0, &[], &[]);
    assert!(here.0.join("link.csv").is_symlink() && here.read("rows.csv").starts_with("t,x,v\n"));
}

#[test]
fn pictures_of_a_run() {
    let here = Folder::new()
        .with("a.bond", OSCILLATOR)
        .with("mute.bond", "model Mute {\n  C:c = 1 F; R:r = 1 Ohm\n  c -> r\n}\n");
    here.bond(&["run", "a.bond", "--plot", "a.svg", "-o", "a.csv"]).is(0, &["passive     yes"], &[]);
    let svg = here.read("a.svg");
    for text in ["Oscillator", ">x<", ">v<", ">m<", ">m/s<", "t, s"] {
        assert!(svg.contains(text), "`{text}` is not in the picture");
    }
    let longest = svg.split("<path").map(|path| path.matches(" L ").count()).max().unwrap();
    assert!(longest >= 1000, "a row each: {longest}");
    // Of more rows than can be seen no more is drawn.
    let size = |every: &str| {
        here.bond(&["run", "a.bond", "--every", every, "--plot", "b.svg"]).is(0, &[], &[]);
        here.read("b.svg").len()
    };
    let (some, many) = (size("0.1ms"), size("0.01ms"));
    assert!(many < some + some / 4, "{some}, {many}");
    here.bond(&["run", "a.bond", "--plot", "a.png"]).is(0, &[], &[]);
    assert!(std::fs::read(here.0.join("a.png")).unwrap().starts_with(b"\x89PNG"));
    here.bond(&["run", "a.bond", "--plot", "a.gif"]).is(2, &[], &["a.gif", ".svg or .png"]);
    here.bond(&["run", "a.bond", "--plot", "-"]).is(2, &[], &["let its name end in .svg or .png"]);
    here.bond(&["run", "mute.bond", "--stop", "1s", "--plot", "m.svg"]).is(2, &[], &["`Mute` has no probe; add one"]);
    let many = ["run", "a.bond", "--sweep", "m=1,2", "--plot", "m.svg"];
    here.bond(&many).is(2, &[], &["--plot is for single runs", "--set, and it is drawn"]);
    // What was computed until numerics fail is drawn.
    let here = here.with("b.bond", BLOWS_UP);
    here.bond(&["run", "b.bond", "--plot", "f.svg"]).is(3, &[], &[]);
    assert!(here.read("f.svg").split("<path").any(|path| path.matches(" L ").count() > 100));
    assert_eq!(here.list(), ["a.bond", "a.csv", "a.png", "a.svg", "b.bond", "b.svg", "f.svg", "mute.bond"]);
}

/// Columns have names of their own, and a large linear region is said to be one.
#[test]
fn names_and_reasons() {
    let ladder = "model Ladder(n = 100) {
      Se:u = 1 V
      u -> 0:node[0]
      for i in 1..n {
        R:r[i] = 1 kOhm
        C:c[i] = 1 uF
        node[i-1] -> 1:s[i] -> r[i]
        s[i] -> 0:node[i] -> c[i]
      }
      probe t = c[1].e
      probe t_ = c[n].e
      simulate { stop = 1 s; step = 10 ms }
    }";
    let here = Folder::new().with("l.bond", ladder);
    here.bond(&["run", "l.bond", "-o", "l.csv"]).is(0, &["because     it is linear, and large"], &[]);
    assert!(here.read("l.csv").starts_with("t,t_,t__\n"));
}

/// A name may be as long as the system takes it.
#[test]
fn long_names() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let name = "x".repeat(251) + ".csv";
    here.bond(&["run", "a.bond", "-o", &name]).is(0, &[], &[]);
    assert!(here.read(&name).starts_with("t,x,v\n"));
}

/// What a model uses is read too, whatever its name.
#[test]
fn no_result_takes_the_place_of_what_a_model_uses() {
    let (parts, used) = ("let twice(x) = 2*x\n", "inner/parts.csv");
    let model = format!("use \"{used}\"\n{}", OSCILLATOR.replace("= 0.5 N", "= twice(0.5) * 1 N"));
    let here = Folder::new().with("a.bond", model).with(used, parts);
    let slips: [&[&str]; 9] = [
        &["show", "a.bond", "-o", used],
        &["linearize", "a.bond", "-o", "./inner/parts.csv"],
        &["build", "a.bond", "-o", used],
        &["bench", "a.bond", "-o", used],
        &["run", "a.bond", "-o", used],
        &["run", "a.bond", "--ledger", used],
        &["run", "a.bond", "--checkpoint", "inner/../inner/parts.csv"],
        &["run", "a.bond", "--sweep", "m=1,2", "-o", used],
        &["run", "a.bond", "--error", "1e-3", "-o", used],
    ];
    for slip in slips {
        here.bond(slip).is(2, &[], &["it is a file that the model uses; name another file"]);
    }
    assert_eq!(here.read(used), parts);
}

#[test]
fn two_results_need_two_files() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("folder/x", "");
    let slips: [(&[&str], &str); 5] = [
        (
            &["run", "a.bond", "--plot", "x.svg", "--checkpoint", "./x.svg"],
            "--plot and --checkpoint name the same file",
        ),
        (&["run", "a.bond", "-o", "x.csv", "--ledger", "./x.csv"], "-o and --ledger name the same file"),
        (&["run", "a.bond", "-o", "./x.csv", "--checkpoint", "x.csv"], "-o and --checkpoint name the same file"),
        (&["run", "a.bond", "-o", "folder/../x.csv", "--ledger", "x.csv"], "-o and --ledger name the same file"),
        (&["bench", "a.bond", "--plot", "x.png", "-o", "./x.png"], "-o and --plot name the same file"),
    ];
    for (slip, why) in slips {
        here.bond(slip).is(2, &[], &[why]);
    }
    assert_eq!(here.list(), ["a.bond", "folder"]);
    here.bond(&["run", "a.bond", "-o", "x.csv", "--ledger", "folder/x.csv"]).is(0, &[], &[]);
}

/// What cannot be written is told before the work, and does not take what can be with it.
#[test]
fn places_are_tried_before_the_work() {
    let here = Folder::new().with("a.bond", OSCILLATOR).with("file", "");
    let slips: [&[&str]; 8] = [
        &["run", "a.bond", "-o", "kept.csv", "--plot", "no/x.png"],
        &["run", "a.bond", "-o", "kept.csv", "--checkpoint", "no/x.state"],
        &["run", "a.bond", "-o", "kept.csv", "--checkpoint", "file/x.state"],
        &["run", "a.bond", "--error", "1e-9", "-o", "no/x.csv"],
        &["bench", "a.bond", "--plot", "no/p.png"],
        &["bench", "a.bond", "-o", "no/p.txt"],
        &["linearize", "a.bond", "--at", "1", "-o", "no/x.json"],
        &["show", "a.bond", "-o", "no/x.txt"],
    ];
    for slip in slips {
        // Before the model is looked at.
        let slip: Vec<&str> = slip.iter().map(|arg| if *arg == "a.bond" { "none.bond" } else { arg }).collect();
        here.bond(&slip).is(2, &[], &["cannot write "]);
    }
    assert_eq!(here.list(), ["a.bond", "file"]);
    here.bond(&["run", "a.bond", "-o", "rows.txt"]).is(2, &[], &["cannot be written as `.txt`, only as `.csv`"]);
    here.bond(&["run", "a.bond", "-o", "rows"]).is(0, &[], &[]);
}

/// What was long in the making is there also where something else cannot be written in the end.
#[cfg(target_os = "linux")]
#[test]
fn what_can_be_written_is_kept() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let done = here.bond(&["run", "a.bond", "-o", "kept.csv", "--checkpoint", "/dev/full"]);
    done.is(2, &["passive     yes"], &["cannot write /dev/full: "]);
    assert_eq!(table(&here.read("kept.csv")).1.len(), 1001);
    std::os::unix::fs::symlink("/dev/full", here.0.join("p.svg")).unwrap();
    let bench = ["bench", "a.bond", "--methods", "gonzalez", "--steps", "10ms", "--repeat", "1", "--plot", "p.svg"];
    here.bond(&bench).is(2, &["to choose"], &["cannot write p.svg: "]);
}

/// Asks a process for its end twice, as soon as a file is there and after pauses in ms: its status, and what it says.
/// None where this process ignores such signals, and with it those that it starts.
#[cfg(target_os = "linux")]
fn asked_to_end(here: &Folder, args: &[&str], there: &str, pauses: [u64; 2]) -> Option<(Option<i32>, String, String)> {
    use std::process::{Command, Stdio};
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).unwrap().trim().to_string();
    if u64::from_str_radix(&ignored, 16).unwrap() & 1 == 1 {
        println!("hanging up is ignored here: left out");
        return None;
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_bond"));
    let child = command.args(args).current_dir(&here.0).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = std::time::Instant::now();
    while !here.list().iter().any(|name| name.contains(there)) {
        assert!(start.elapsed().as_secs() < 60, "{:?}", here.list());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    for pause in pauses {
        std::thread::sleep(std::time::Duration::from_millis(pause));
        Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    }
    let done = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Some((done.status.code(), text(&done.stdout), text(&done.stderr)))
}

/// Before there is anything to keep, it ends at once, and says so.
#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_asked_to_end_before_it_began() {
    // Nothing that can be written is there yet: a pipe that nobody fills keeps it waiting.
    let here = Folder::new().with("a.bond", CHARGE);
    assert!(std::process::Command::new("mkfifo").arg(here.0.join("u.csv")).status().unwrap().success());
    let args = ["run", "a.bond", "--budget", "1ms", "--input", "u.csv"];
    let Some((status, out, err)) = asked_to_end(&here, &args, "a.bond", [300, 0]) else { return };
    assert!(status == Some(130) && out.is_empty() && err.contains("interrupted"), "{status:?} {out} {err}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_asked_to_end_keeps_what_it_has() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    // Days, if nobody asked.
    let long = ["run", "a.bond", "--stop", "1e6", "--step", "1ms", "--every", "100ms", "-o", "a.csv"];
    let long = [&long[..], &["--checkpoint", "s", "--ledger", "l.csv"]].concat();
    // Twice at once is once: `timeout` does so.
    let Some((status, out, err)) = asked_to_end(&here, &long, "l.csv", [200, 0]) else { return };
    assert_eq!(status, Some(130), "{err}");
    assert!(out.contains("of 1e6 s, then it was interrupted") && out.contains("at the end"), "{out}");
    assert!(err.contains("interrupted") && err.contains("s has the state at "), "{err}");
    assert_eq!(here.list(), ["a.bond", "a.csv", "l.csv", "s"]);
    let (_, first) = table(&here.read("a.csv"));
    let end = first.last().unwrap()[0];
    assert_eq!(table(&here.read("l.csv")).1.len(), first.len());
    // It goes on from there, as if it had never stopped.
    let stop = format!("{}", end + 0.5);
    here.bond(&["run", "a.bond", "--stop", &stop, "--every", "100ms", "--resume", "s", "-o", "b.csv"]).is(0, &[], &[]);
    let whole = ["run", "a.bond", "--stop", &stop, "--step", "1ms", "--every", "100ms", "-o", "whole.csv"];
    here.bond(&whole).is(0, &[], &[]);
    let rest = here.read("b.csv");
    let both = here.read("a.csv") + rest.split_once('\n').unwrap().1;
    assert_eq!(both, here.read("whole.csv"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_asked_again_ends_at_once() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    // The next row is far.
    let long = ["run", "a.bond", "--stop", "1e6", "--step", "1ms", "--at", "9e5", "-o", "a.csv"];
    let Some((status, out, err)) = asked_to_end(&here, &long, "a.csv", [200, 700]) else { return };
    assert_eq!((status, out.as_str()), (Some(130), ""), "{err}");
    assert!(err.contains("a second interrupt ends it at once"), "{err}");
    assert_eq!(here.list(), ["a.bond"]);
}

/// What is done of an ensemble is kept, and the same command continues from there.
#[cfg(target_os = "linux")]
#[test]
fn an_ensemble_that_is_asked_to_end_says_what_it_has() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let many = |n: &str| {
        let draw = ["--monte-carlo", n, "--draw", "m=uniform(1,2)", "-o", "a.csv"];
        [&["run", "a.bond", "--stop", "1", "--step", "1ms", "--method", "gonzalez"][..], &draw].concat().join(" ")
    };
    let long = many("1000000");
    let long: Vec<&str> = long.split(' ').collect();
    let Some((status, out, err)) = asked_to_end(&here, &long, "a.csv.part", [300, 0]) else { return };
    assert_eq!((status, out.as_str()), (Some(130), ""), "{err}");
    assert!(err.contains("instances are in a.csv.part; the same command continues from there"), "{err}");
    assert_eq!(here.list(), ["a.bond", "a.csv.part"]);
}

/// What cannot be told is not claimed.
#[test]
fn a_run_without_a_number_for_its_energy_is_not_passive() {
    let text = "model M { C:c { H = 0.5 N/m * q^2; q0 = 1e200 m }\n I:i = 1 kg\n c -> i }";
    let here = Folder::new().with("a.bond", text);
    here.bond(&["run", "a.bond", "--stop", "1"]).is(3, &["passive     NO: H of `c` is not a finite number"], &[]);
}

/// A holder that cannot foretell says so; and periods that are far apart do not keep a short run from its begin.
#[test]
fn periods_that_do_not_go_together() {
    let uneven = "
model M {
  sampled every 3 ms { I:m0 { inertia = 1 kg; f0 = 0.3 m/s } }
  sampled every 7 ms { 0:n1; C:k1 { stiffness = 100 N/m }; n1 -> k1 }
  sampled every 5 ms { I:m1 = 0.5 kg }
  m0 ||> n1
  n1 ||> m1
}";
    let here = Folder::new().with("a.bond", uneven).with("b.bond", uneven.replace("3 ms", "2.5 ms"));
    let said = "note: `n1` holds for `m0`, whose period divides neither its own nor those of the other sides";
    here.bond(&["run", "a.bond", "--stop", "0.1"]).is(0, &[], &[said]);
    let done = here.bond(&["run", "b.bond", "--stop", "0.1"]).is(0, &[], &[]);
    assert!(!done.err.contains("ratio"), "{}", done.err);
    let far = "
model M {
  sampled every 1e9 s { I:mass { inertia = 1 kg; f0 = 1 m/s } }
  sampled every 10 ms { C:spring = 1 m/N }
  mass ||> spring
}";
    here.with("c.bond", far).bond(&["run", "c.bond", "--stop", "20ms"]).is(0, &[], &[]);
}

#[test]
fn a_wrong_model_writes_nothing() {
    let here = Folder::new().with("a.bond", WRONG);
    let done = here.bond(&["run", "a.bond", "-o", "-"]).is(1, &[], &["a.bond:3:"]);
    assert_eq!(done.out, "");
    here.bond(&["run", "a.bond", "-o", "a.csv"]).is(1, &[], &[]);
    assert_eq!(here.list(), ["a.bond"]);
}

#[test]
fn failed_numerics_keep_what_was_computed() {
    let here = Folder::new().with("a.bond", BLOWS_UP);
    let done = here.bond(&["run", "a.bond", "-o", "a.csv", "--summary", "json"]).is(
        3,
        &["\"error\""],
        &["t = 0.99", "error:"],
    );
    let json: Value = serde_json::from_str(&done.out).unwrap();
    let (_, rows) = table(&here.read("a.csv"));
    // The last row is the end of the last good step, of which the summary tells.
    let last = rows.last().unwrap();
    assert!(rows.len() > 400 && last[0] > 0.99 && last[0] < 1.0);
    assert_eq!((json["reached"].as_f64(), json["final"]["v"].as_f64()), (Some(last[0]), Some(last[1])));
    let done = here.bond(&["run", "a.bond", "-o", "-"]).is(3, &["t,v\n0,1\n"], &["t = 0.99", "numerics failed"]);
    assert_eq!(done.table().1.len(), rows.len());
    let switched = "model B { Se:u = 1 V; I:l = 1 H; TF:m = if t < 0.5 s then 1 else 0; u -> m -> 1:j -> l; simulate { stop = 1 s } }";
    here.fed(&["run", "-"], switched).is(3, &[], &["the ratio of `m` is 0 there"]);
    // Steps that were given may be what is wrong.
    here.bond(&["run", "a.bond", "--step", "10ms"]).is(3, &[], &["give `--tolerance 1e-6`"]);
}

/// Rows within a fixed step are looked at before it is taken: of one that fails, those up to the failure are kept.
#[test]
fn no_row_lies_behind_a_failure() {
    let steep = "\
model Steep(q = 3 m) {
  I:m = 1 kg
  C:s { H = (1 J)*(exp((q/(1 m))^2) - 1); q0 = 3 m }
  1:v -> m, s
  probe x = s.q
  simulate { stop = 1 s }
}
";
    let here = Folder::new().with("a.bond", steep);
    for method in ["radau", "rk4"] {
        let args = ["run", "a.bond", "--method", method, "--step", "0.1", "--every", "0.001"];
        let files = ["-o", "a.csv", "--ledger", "l.csv", "--summary", "json"];
        let done = here.bond(&[&args[..], &files].concat()).is(3, &[], &["error: at t = "]);
        let failed = done.err.split_once("at t = ").unwrap().1.split_once(" s,").unwrap().0.parse::<f64>().unwrap();
        let json: Value = serde_json::from_str(&done.out).unwrap();
        assert!(json["reached"].as_f64().unwrap() <= failed, "{json}");
        for name in ["a.csv", "l.csv"] {
            let rows = table(&here.read(name)).1;
            let last = rows.last().unwrap()[0];
            assert!((failed - 0.001..=failed).contains(&last), "{method}, {name}: {last} against {failed}");
        }
        let done = here.bond(&[&args[..], &["--sweep", "q=1,2", "-o", "e.csv"]].concat()).is(3, &[], &["failed"]);
        let rows = here.read("e.csv").lines().filter(|l| l.starts_with("0,")).count();
        assert!(rows as f64 <= failed / 0.001 + 1.0, "{done:?}");
    }
}

#[test]
fn what_has_no_value_at_the_end_is_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR.replace("probe v", "probe y = sqrt(-1)\n  probe v"));
    here.bond(&["run", "a.bond"]).is(0, &["NaN"], &["note: at the end `y` is NaN"]);
    let here = Folder::new().with("a.bond", OSCILLATOR);
    assert!(!here.bond(&["run", "a.bond"]).is(0, &[], &[]).err.contains("note"));
}

#[test]
fn a_model_that_is_not_passive_says_why() {
    let here = Folder::new().with("a.bond", BLOWS_UP);
    here.bond(&["run", "a.bond", "--stop", "0.5"]).is(0, &["NO: ", "engine"], &[]);
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["run", "a.bond", "--method", "rk4"]).is(0, &["NO: ", "rk4", "hint: "], &[]);
}

#[test]
fn the_end_of_the_run_is_told() {
    let here = Folder::new().with("a.bond", OSCILLATOR.replace("simulate { stop = 1 s }", ""));
    here.bond(&["run", "a.bond"]).is(0, &[], &["note: ", "1 s"]);
    here.bond(&["run", "a.bond", "--at", "2"]).is(2, &[], &["beyond the end", "--stop"]);
    here.bond(&["run", "a.bond", "--stop", "2", "--at", "2"]).is(0, &[], &[]);
}

#[test]
fn models_come_from_standard_input_too() {
    let here = Folder::new().with("wheel.bond", "model Wheel { port p\n I:m = 1 kg\n p -> m }\n");
    here.fed(&["run", "-"], OSCILLATOR).is(0, &["Oscillator"], &[]);
    let car = "use \"wheel.bond\"\nmodel Car { Wheel:w\n Se:F = 1 N\n F -> w.p }\n";
    here.fed(&["run", "-", "--stop", "1"], car).is(0, &["Car"], &[]);
    here.fed(&["run", "-"], WRONG).is(1, &[], &["<stdin>:3:"]);
}

#[cfg(unix)]
#[test]
fn a_closed_pipe_ends_it_quietly() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let mut child = Command::new(env!("CARGO_BIN_EXE_bond"))
        .args(["run", "a.bond", "--every", "1us", "-o", "-"])
        .current_dir(&here.0)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line, "t,x,v\n");
    let done = child.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&done.stderr), "");
}

#[cfg(unix)]
#[test]
fn devices_are_written_to_and_stay() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["run", "a.bond", "-o", "/dev/null"]).is(0, &["Oscillator"], &[]);
    assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
}

/// A current source that charges a capacitor: the input's integral.
const CHARGE: &str = "\
model Charge {
  input u = 2 A
  input w = 3 A
  Sf:source = u + w
  C:cap = 1 F
  source -> cap
  probe q = cap.q
  simulate { stop = 2 s }
}
";

#[test]
fn inputs_come_from_a_table() {
    let here = Folder::new().with("a.bond", CHARGE).with("a.csv", "u,t\r\n0,0.5\r\n4,1.5\r\n");
    let run = |args: &[&str]| {
        let done = here.bond(&[&["run", "a.bond", "-o", "-", "--at", "1,2"], args].concat()).is(0, &[], &[]);
        done.table().1.iter().map(|r| r[1]).collect::<Vec<_>>()
    };
    let close = |found: Vec<f64>, wanted: [f64; 2]| {
        assert!(found.iter().zip(wanted).all(|(x, y)| (x - y).abs() < 1e-13), "{found:?} where {wanted:?} is wanted");
    };
    close(run(&[]), [5.0, 10.0]);
    // What no column names keeps its default, 3 A.
    close(run(&["--input", "a.csv"]), [3.5, 10.0]);
    close(run(&["--input", "a.csv", "--input-hold"]), [3.0, 8.0]);
    let piped = here.fed(&["run", "a.bond", "--input", "-", "-o", "-", "--at", "2"], "t,w\n0,0\n");
    assert_eq!(piped.is(0, &[], &[]).table().1[0][1], 4.0);
    here.bond(&["run", "--help"]).is(0, &["--input <FILE.csv>", "--input weather.csv", "--input-hold"], &[]);
}

#[test]
fn wrong_tables_are_refused_with_their_line() {
    let cases = [
        ("", "a.csv:1: the table is empty"),
        ("time,u\n0,1\n", "a.csv:1: there is no column `t`"),
        ("t,v\n0,1\n", "a.csv:1: the model has no input `v`; its inputs are u, w"),
        ("t,u\n0,1\n2,x\n", "a.csv:3: `x` in the column `u` is not a number"),
        ("t,u\n0,1\n0,2\n", "a.csv:3: the time 0 s is not after 0 s"),
        ("t,u\n0,1,2\n", "a.csv:2: this row has 3 numbers, and the header has 2 columns"),
        ("t,u\n", "a.csv:1: there are no rows"),
        ("t;u\n0;1,5\n", "a.csv:1: columns are separated by commas"),
        (
            "t,u\n0,1e308\n1,-1e308\n",
            "a.csv:3: the column `u` changes faster than double precision resolves from \
        line 2",
        ),
    ];
    for (text, words) in cases {
        let here = Folder::new().with("a.bond", CHARGE).with("a.csv", text);
        here.bond(&["run", "a.bond", "--input", "a.csv", "-o", "out.csv"]).is(2, &[], &[words]);
        assert!(!here.list().contains(&"out.csv".to_string()), "{text:?}");
    }
    let here = Folder::new().with("a.bond", CHARGE).with("b.bond", OSCILLATOR).with("a.csv", "t,u\n0,1\n");
    here.bond(&["run", "b.bond", "--input", "a.csv"]).is(2, &[], &["no input `u`", "the model has none"]);
    here.bond(&["run", "a.bond", "--input", "none.csv"]).is(2, &[], &["cannot read none.csv"]);
    here.bond(&["run", "a.bond", "--input-hold"]).is(2, &[], &["--input <FILE.csv>"]);
}

#[test]
fn a_wrong_unit_on_the_command_line_is_told_once() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let said = ["--set m: the value is in N, and `m` is in kg", "give it in kg"];
    let done = here.bond(&["run", "a.bond", "--set", "m=2 N"]).is(2, &[], &said);
    assert_eq!(done.err.matches("×").count(), 1, "{}", done.err);
    here.bond(&["run", "a.bond", "--set", "m=2000 g"]).is(0, &[], &[]);
}

/// A sampled state that cannot be stepped: everything is told as of the last sample that it took.
#[test]
fn a_sample_that_fails_ends_the_run_before_it() {
    let text = "model N { Se:s = z  R:r = 1 Ohm  I:l = 1 H  s -> 1:m -> r, l  sampled every 10 ms { state z = 0 V \
                { next = sqrt(0.035 - t/(1 s)) * 1 V } }  probe i = l.f  probe zz = z  simulate { stop = 0.1 s } }\n";
    let here = Folder::new().with("a.bond", text);
    for (every, last) in [("10ms", 0.04), ("4ms", 0.04), ("3ms", 0.039)] {
        let rows = ["--every", every, "--ledger", "l.csv", "--summary", "json"];
        let done = here.bond(&[&["run", "a.bond", "-o", "a.csv"], &rows[..]].concat()).is(3, &[], &["at t = 0.04 s"]);
        let told: serde_json::Value = serde_json::from_str(&done.out).unwrap();
        assert_eq!(told["reached"], 0.04);
        for file in ["a.csv", "l.csv"] {
            let (_, rows) = table(&here.read(file));
            assert!((rows.last().unwrap()[0] - last).abs() < 1e-12, "{file} every {every}: {rows:?}");
        }
        let here = Folder::new().with("a.bond", text);
        let good = here.bond(&["run", "a.bond", "--stop", "0.04", "--summary", "json"]).is(0, &[], &[]);
        let good: serde_json::Value = serde_json::from_str(&good.out).unwrap();
        for of in ["i", "zz"] {
            let (a, b) = (told["final"][of].as_f64().unwrap(), good["final"][of].as_f64().unwrap());
            assert!((a - b).abs() < 1e-12, "{of}: {a} and {b}");
        }
        let (a, b) = (&told["regions"][0]["H_final"], &good["regions"][0]["H_final"]);
        assert!((a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-15);
    }
}

/// A table whose quotes do not close, or which is no number, is none.
#[test]
fn quotes_of_a_table_of_inputs() {
    let here = Folder::new().with("a.bond", CHARGE);
    for (table, why) in [
        ("t,u\n0,\"1\"2\n1,2\n", "u.csv:2: a comma is missing"),
        ("t,u\n0,\"1\n1,2\n", "u.csv:2: a quote is not closed"),
        ("t,\"u\n0,1\n", "u.csv:1: a quote is not closed"),
        ("t,u\n0,0\n1e-9,1e308\n", "changes faster than double precision resolves"),
    ] {
        let here = Folder::new().with("a.bond", CHARGE).with("u.csv", table);
        here.bond(&["run", "a.bond", "--input", "u.csv"]).is(2, &[], &[why]);
    }
    let here = here.with("u.csv", "t,\"u\"\n0, \"1\" \n\"1\",1\n");
    here.bond(&["run", "a.bond", "--input", "u.csv"]).is(0, &[], &[]);
}

/// What has no finite value is named, where it stands, and not what is solved for.
#[test]
fn what_has_no_value_is_named() {
    let log = "model M(RT = 2478 J/mol, k = 1 mol/s) {
      C:A { e = RT*log(q/1 mol); q0 = 1 mol }
      C:AB { e = RT*log(q/1 mol) }
      R(f, r):re { f.f = k*(exp(f.e/RT) - exp(r.e/RT)); r.f = k*(exp(r.e/RT) - exp(f.e/RT)) }
      A -> re.f
      AB -> re.r
      simulate { stop = 1 s }
    }";
    let root = "model M {
      C:tank1 { compliance = 1e-4 m^3/Pa; e0 = 1000 Pa }
      R:pipe = 1e6 Pa*s/m^3
      C:tank2 { compliance = 1e-4 m^3/Pa; e0 = 500 Pa }
      R:far { f = 1e-6 m^3/(s*Pa^(1/2)) * sqrt(e) }
      C:tank3 { compliance = 1e-4 m^3/Pa; e0 = 800 Pa }
      tank1 -> 0:a -> 1:q -> pipe
      q -> 0:b -> tank2
      b -> 1:q2 -> far
      q2 -> 0:c -> tank3
      simulate { stop = 1 s }
    }";
    let ratio = "model M {
      Se:src = 24 V
      MTF:sw = if mod(t, 20 us) < 10 us then 1 else 0
      I:L1 = 100 uH
      C:C1 = 100 uF
      R:load = 5 Ohm
      src -> sw -> 1:i -> L1
      i -> 0:out -> C1, load
      simulate { stop = 1 ms }
    }";
    // What follows a source has an energy and no state, and is sound here: the loop is not.
    let open = "model M {
      Se:u = 1 V * t/(1 s)
      C:c = 1 F
      Sf:i = 2 A * t/(1 s)
      R:r { f = 1 A * tanh(e/(1 V)) }
      u -> 0:n -> c
      n -> 1:j -> r
      i -> j
      simulate { stop = 4 s }
    }";
    let here = Folder::new().with("log.bond", log).with("root.bond", root).with("ratio.bond", ratio);
    let here = here.with("open.bond", open);
    for (file, told) in [
        ("log.bond", "`AB.e` has no finite value there: it takes the logarithm of `AB.q`, which is 0"),
        ("root.bond", "`far.f` has no finite value there: it takes a root of `tank2.e - tank3.e`, which is -300"),
        ("ratio.bond", "the ratio of `sw` is 0 there"),
        ("open.bond", "a step of `n` failed: singular matrix"),
    ] {
        here.bond(&["run", file]).is(3, &[], &[told]);
    }
}

#[test]
fn large_numbers_are_told_by_their_power() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["run", "a.bond", "--at", "1e300"]).is(2, &[], &["--at 1e300 is beyond the end of the run, 1 s"]);
    // Beyond by rounding: it is the end.
    here.bond(&["run", "a.bond", "--at", "1,1.00000000000001", "-o", "-"]).is(0, &["\n1,"], &[]);
    here.bond(&["run", "a.bond", "--set", "m[1]=2"]).is(2, &[], &["`m` is a number, and no array", "--set m=VALUE"]);
}

/// The wall as most controllers write it: a source that reads the place.
const STEERED: &str = "model Steered(K = 1000 N/m) {
  I:handle { inertia = 1 kg }  R:own = 3 N*s/m  C:place { H = 0; q0 = 0.01 m }
  Se:hand = 20*sin(t*(8 s^-1))*(1 N)
  sampled every 10 ms { Se:wall = -K*place.q }
  1:v -> handle, own, place
  hand -> v
  wall -[bar]||> v
  probe x = place.q
  expect passive at hand
  expect passive at bar
  simulate { stop = 5 s }
}
";

/// A steered wall stores nothing, so the budget holds back what it calls for: the summary says how to write it.
#[test]
fn a_steered_wall_that_is_held_back_says_what_to_do() {
    let text = "model Wall {
  Se:hand = if t < 1 s then 2 N else 0 N
  I:handle = 1 kg
  R:own = 3 N*s/m
  C:place { H = 0; q0 = 0 m }
  sampled every 10 ms { Se:wall = -(1000 N/m)*place.q }
  hand -> 1:v -> handle, own, place
  wall ||> v
  probe x = place.q
  simulate { stop = 5 s }
}";
    let here = Folder::new().with("wall.bond", text);
    here.bond(&["run", "wall.bond"]).is(0, &["returns no more than was put in; write the wall as a `C`"], &[]);
}

/// Steered sources stand beside the verdict, for people and for programs.
#[test]
fn steered_sources_are_listed() {
    let off = STEERED.replace("10 ms {", "10 ms budget off {");
    let active = STEERED.replace("Se:wall", "active Se:wall");
    let here = Folder::new().with("a.bond", STEERED).with("off.bond", &off).with("active.bond", active);
    let line = "J: it reads the scene's own signals; it";
    here.bond(&["run", "a.bond"]).is(0, &[&format!("{line} draws on what was put into `wall`")], &[]);
    here.bond(&["run", "active.bond"]).is(
        0,
        &["NO: active `wall`, which gave", &format!("{line} counts as a source, `active`")],
        &[],
    );
    let told = here.bond(&["run", "off.bond", "--summary", "json"]).is(0, &[], &[]);
    let json: serde_json::Value = serde_json::from_str(&told.out).unwrap();
    let steered = &json["steered"][0];
    assert_eq!(
        (&steered["name"], &steered["region"], &steered["role"]),
        (&"wall".into(), &"wall".into(), &"unbounded".into())
    );
    // Without a budget all that it supplied went out.
    let [gave, crossed] = [&steered["energy"], &json["bars"][0]["holder"]].map(|x| x.as_f64().unwrap());
    assert!(gave > 100.0 && (gave + crossed).abs() < 1e-9 * gave, "{json:#}");
    assert!(
        json["reasons"][0].as_str().unwrap().starts_with("steered `wall` under `budget off`, which gave"),
        "{json:#}"
    );
    // Where it fails, it says when and by how much.
    here.bond(&["test", "off.bond"]).is(
        1,
        &["FAIL", "expect passive at bar", "J too much at t = ", "the first of it at t = "],
        &[],
    );
    let refused = STEERED.replace("at bar", "at handle");
    here.with("wrong.bond", refused).bond(&["check", "wrong.bond"]).is(
        1,
        &[],
        &["`handle` is no source, open port or double bar"],
    );
}
