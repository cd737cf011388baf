use super::{Folder, OSCILLATOR};

#[test]
fn arguments_that_are_no_numbers() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for value in [
        "", " ", "abc", "NaN", "inf", "-inf", "1e999", "0", "-1", "-1s", "1 kg", "1kg", "1 s s", "\u{0}1", "((((",
        "1/0", "💥", "1e", "--",
    ] {
        let value = value.replace('\u{0}', "\u{1}");
        for option in ["--stop", "--step", "--every", "--tolerance"] {
            here.bond(&["run", "a.bond", &format!("{option}={value}")]).is(2, &[], &["error:"]);
        }
    }
    for value in ["-1", "-1e-3", "-1ms", "-.5", "-1e-3 s"] {
        for (option, why) in [("--step", "longer than 0 s"), ("--longest", "longer than 0 s"), ("--budget", "longer")] {
            here.bond(&["run", "a.bond", option, value]).is(2, &[], &[why]);
        }
    }
    for option in ["--tolerance", "--error"] {
        here.bond(&["run", "a.bond", option, "-1e-6"]).is(2, &[], &["between 0 and 1"]);
    }
    for command in ["run", "show", "bench", "linearize", "build"] {
        here.bond(&[command, "a.bond", "--set", "k=1", "--set", "k = 2"]).is(2, &[], &["--set gives `k` twice"]);
    }
    for command in [&["run", "a.bond"][..], &["build", "a.bond", "-o", "a"], &["run", "a.bond", "--error", "1e-3"]] {
        let by_ray = [command, &["--method", "ray"]].concat();
        here.bond(&by_ray).is(2, &[], &["the method `ray` steps sampled regions, and there is none"]);
    }
    here.bond(&["run", "a.bond", "--sweep", "m=1...2:3"]).is(2, &[], &["write m=1..2:3, or m=1..0.2:3"]);
    for value in ["", ",", "0.1,", "0.1,,0.2", "abc", "-1", "2", "NaN", "1e999", "0.1;0.2", "0.1 0.2"] {
        here.bond(&["run", "a.bond", &format!("--at={value}")]).is(2, &[], &["error:"]);
    }
    for value in [
        "", "=", "m", "m=", "=1", "m=x", "m=1 quux", "m=1e999", "none=1", "m==1", "m=1=2", "m.k=2", "m=[1]", "m=true",
        "m=NaN",
    ] {
        here.bond(&["run", "a.bond", "--set", value]).is(2, &[], &[]);
    }
    for args in [["--set", "m=1//2"], ["--stop", "1//2"], ["--sweep", "m=2//3,4"]] {
        here.bond(&[&["run", "a.bond"], &args[..]].concat()).is(2, &[], &["begins a comment; a fraction has one `/`"]);
    }
    here.bond(&["run", "a.bond", "--tolerance", "1"]).is(2, &[], &["between 0 and 1"]);
    here.bond(&["run", "a.bond", "--method", "magic"]).is(2, &[], &["gonzalez"]);
    here.bond(&["run", "a.bond", "--step", "1ms", "--longest", "1ms"]).is(2, &[], &["cannot be used with"]);
    here.bond(&["run", "a.bond", "-o", "x.xlsx"]).is(2, &[], &["cannot be written as `.xlsx`"]);
    here.bond(&["run", "a.bond", "-o", "x.csv", "--ledger", "x.csv"]).is(2, &[], &["same file"]);
    here.bond(&["run", "a.bond", "-o", "-", "--ledger", "-"]).is(2, &[], &["same file"]);
    here.bond(&["run", "a.bond", "--input", "x.csv"]).is(2, &[], &["cannot read x.csv"]);
    assert_eq!(here.list(), ["a.bond"]);
}

#[test]
fn ensembles_that_are_none() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for values in [
        "",
        "..",
        "1..",
        "..2",
        "1..2",
        "1..2:",
        "1..2::",
        "1..2:x",
        "1..2:2:",
        "1..2:2:LOG",
        "1...2..3:4",
        "1:2:3",
        "1..2:-2",
        "1..2:1e3",
        "1..2:99999999999999999999",
        ",",
        "1,",
        ",1",
        "1;2",
        "1..2,3",
        "NaN..1:2",
        "1..inf:2",
        "1..2:\u{1}",
        "()",
        "1 kg..2 m:3",
        "[1,2]",
        "true..false:2",
        "5e-324..1e308:3:log:log",
        "\u{661}..\u{662}:3",
    ] {
        here.bond(&["run", "a.bond", "--sweep", &format!("m={values}")]).is(2, &[], &["error:"]);
    }
    for law in [
        "",
        "(",
        ")",
        "()",
        "uniform",
        "uniform(",
        "uniform)",
        "uniform()",
        "uniform(,)",
        "uniform(1)",
        "uniform(1,2,3)",
        "Uniform(1,2)",
        "uniform(1,2))",
        "uniform((1,2)",
        "uniform(1,2) kg",
        "normal(0,-0)",
        "normal(1,inf)",
        "lognormal(0,1)",
        "triangular(1,0,2)",
        "uniform(1 kg,2 m)",
        "uniform(2,1)",
        "\u{1}(1,2)",
    ] {
        let draw = format!("m={law}");
        here.bond(&["run", "a.bond", "--monte-carlo", "2", "--draw", &draw]).is(2, &[], &["error:"]);
    }
    // What is far, but a number, is run or told of each instance.
    for values in ["5e-324..1e308:3:log", "-1e308..0:3", "1e-300,1e300"] {
        let done = here.bond(&["run", "a.bond", "--sweep", &format!("m={values}"), "--stop", "1ms", "--step", "1ms"]);
        assert!(matches!(done.status, 0 | 3), "{done:?}");
    }
    let wide =
        ["--monte-carlo", "50", "--draw", "m=lognormal(1e300, 100)", "-o", "-", "--stop", "1ms", "--step", "1ms"];
    here.bond(&[&["run", "a.bond"], &wide[..]].concat()).is(
        3,
        &["m = inf is not a finite number"],
        &["instances \
    failed"],
    );
    assert_eq!(here.list(), ["a.bond"]);
}

#[test]
fn values_that_a_parameter_cannot_have() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for value in ["m=-2", "m=0", "m=1 m"] {
        let done = here.bond(&["run", "a.bond", "--set", value, "-o", "-"]);
        assert!(matches!(done.status, 1 | 2) && done.out.is_empty(), "{value}: {done:?}");
    }
    for value in ["m=1e300", "m=1e-300", "k=1e300", "k=1e-300", "m=5e-324"] {
        let done = here.bond(&["run", "a.bond", "--set", value]);
        assert!(matches!(done.status, 0 | 1 | 3), "{value}: {done:?}");
    }
}

#[test]
fn work_without_end_is_refused() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    here.bond(&["run", "a.bond", "--every", "1e-300"]).is(2, &[], &["rows"]);
    here.bond(&["run", "a.bond", "--every", "9ns"]).is(2, &[], &["rows"]);
    here.bond(&["run", "a.bond", "--step", "1e-300"]).is(2, &[], &["steps"]);
    here.bond(&["run", "a.bond", "--longest", "1e-30"]).is(2, &[], &["at most 1e10"]);
    here.bond(&["run", "a.bond", "--step", "1e-30", "--tolerance", "1e-6"]).is(2, &[], &["at most 1e10"]);
    here.bond(&["run", "a.bond", "--stop", "1e300", "--step", "1"]).is(2, &[], &["steps in 1e300 s"]);
    let fast =
        "model A { I:m = 1 kg\n Se:F = 1 N\n F -> 1:v -> m\n sampled every 1e-15 s { R:r = 1 N*s/m }\n v ||> r\n }\n";
    let here = Folder::new().with("a.bond", fast);
    here.bond(&["run", "a.bond", "--stop", "1 h"]).is(2, &[], &["steps"]);
}

/// What the model says is mended in the model; what an option says goes before it.
#[test]
fn work_without_end_that_the_model_asks_for() {
    let model = |settings: &str| OSCILLATOR.replace("stop = 1 s", settings);
    let sampled =
        "model A { I:m = 1 kg\n sampled every 1e-12 s { R:r = 1 N*s/m }\n m ||> r\n simulate { stop = 10 s } }\n";
    let here = Folder::new()
        .with("step.bond", model("stop = 10 s; step = 1e-12 s"))
        .with("every.bond", model("stop = 10 s; every = 1e-15 s"))
        .with("sampled.bond", sampled);
    for (name, what, mend) in [
        ("step", "steps of 1e-12 s", "`step` or a shorter `stop` in `simulate`"),
        ("every", "rows", "`every` in `simulate`"),
        ("sampled", "the period 1e-12 s of `r`", "a longer period"),
    ] {
        let file = format!("{name}.bond");
        let told = [&format!("{file}:"), what, mend];
        here.bond(&["run", &file]).is(1, &[], &told);
        here.bond(&["check", &file]).is(1, &[], &told);
        here.bond(&["bench", &file, "--stop", "1h", "--steps", "1e-12"]).is(2, &[], &["at most"]);
    }
    for file in ["step.bond", "every.bond"] {
        here.bond(&["test", file]).is(1, &["cannot run: "], &[]);
    }
    let place = "\"code\":\"simulate::steps\"";
    for (file, line) in [("step.bond", "\"line\":8"), ("every.bond", "\"line\":8"), ("sampled.bond", "\"line\":2")] {
        here.bond(&["check", file, "--message-format", "json"]).is(1, &[place, line], &[]);
    }
    here.bond(&["run", "step.bond", "--step", "1ms", "--stop", "1s"]).is(0, &[], &[]);
    here.bond(&["run", "every.bond", "--every", "1ms", "--stop", "1s"]).is(0, &[], &[]);
    here.bond(&["run", "step.bond", "--set", "k=1"]).is(2, &[], &["--step"]);
    here.bond(&["run", "step.bond", "--stop", "1h"]).is(2, &[], &["--stop"]);
}

/// Names that lead to names: as deep as the stack allows, and an error with a place beyond.
#[test]
fn values_that_go_through_many_names() {
    let rows = |n: usize, term: &str| -> Vec<String> {
        (0..n).map(|i| format!("a{i} = {}", term.replace('x', &format!("a{}", i + 1)))).collect()
    };
    let lets = |n: usize, term: &str| {
        let rows: Vec<String> = rows(n, term).into_iter().map(|row| format!("let {row}\n")).collect();
        format!("model A {{ Se:u = 1 V * a0\n R:r = 1 Ohm\n u -> r\n {} let a{n} = r.f/1 A }}\n", rows.concat())
    };
    let params = |n: usize| {
        format!("model A({}, a{n} = 1) {{ Se:u = 1 V * a0\n R:r = 1 Ohm\n u -> r }}\n", rows(n, "x + 1").join(", "))
    };
    let here = Folder::new()
        .with("lets.bond", lets(80_000, "x + 1"))
        .with("params.bond", params(80_000))
        .with("fewer.bond", params(20_000));
    for command in ["check", "show", "run"] {
        here.bond(&[command, "lets.bond"]).is(
            1,
            &[],
            &["lets.bond:", "elaborate::limit", "values are nested too deep"],
        );
        here.bond(&[command, "params.bond"]).is(1, &[], &["params.bond:", "values are nested too deep"]);
    }
    here.bond(&["check", "fewer.bond"]).is(0, &[], &[]);
}

#[test]
fn files_that_are_no_models() {
    let here = Folder::new()
        .with("latin.bond", b"model A {\n  // caf\xe9\n}\n")
        .with("zeros.bond", [0u8; 5000])
        .with("empty.bond", "")
        .with("folder/x", "")
        .with("long.bond", format!("model A {{ {} }}", "x ".repeat(100_000)))
        .with("deep.bond", format!("model A {{ let x = {} }}", "(".repeat(100_000)))
        .with("bom.bond", "\u{feff}model A { }");
    for command in ["check", "fmt", "show", "linearize", "run", "test"] {
        here.bond(&[command, "latin.bond"]).is(1, &[], &[]);
        for file in ["zeros.bond", "long.bond", "deep.bond"] {
            here.bond(&[command, file]).is(1, &[], &[file]);
        }
        here.bond(&[command, "none.bond"]).is(2, &[], &["cannot read none.bond"]);
        if command != "fmt" {
            here.bond(&[command, "empty.bond"]).is(1, &[], &["no model in this file"]);
        }
        if command != "test" {
            here.bond(&[command, "folder"]).is(2, &[], &["directory"]);
        }
        here.bond(&[command, "bom.bond"]);
        here.bond(&[command]).is(2, &[], &["required"]);
    }
    here.bond(&["check", "latin.bond"]).is(1, &[], &["latin.bond:2:"]);
}

#[cfg(unix)]
#[test]
fn odd_paths() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let here = Folder::new().with("a b ü.bond", OSCILLATOR).with("-.bond", OSCILLATOR);
    here.bond(&["check", "a b ü.bond"]).is(0, &[], &["ok"]);
    here.bond(&["check", "./-.bond"]).is(0, &[], &["ok"]);
    let name = OsStr::from_bytes(b"x\xff.bond");
    std::fs::write(here.0.join(name), OSCILLATOR).unwrap();
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_bond"))
        .arg("run")
        .arg(name)
        .arg("-o")
        .arg(OsStr::from_bytes(b"y\xff.csv"))
        .current_dir(&here.0)
        .output()
        .unwrap();
    assert_eq!(status.status.code(), Some(0), "{status:?}");
    std::os::unix::fs::symlink("loop.bond", here.0.join("loop.bond")).unwrap();
    here.bond(&["check", "loop.bond"]).is(2, &[], &["cannot read"]);
}

/// Parameters that no physics has end in numbers, or in an error that says which: never in NaN, and never in a row of
/// 300 zeros.
#[test]
fn parameters_of_no_physics() {
    let here = Folder::new();
    let run = |file: &str, set: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/hard").join(file);
        let done = here.bond(&["run", &path.display().to_string(), "--set", set, "-o", "-"]);
        let digits = done.err.split(|c: char| !c.is_ascii_digit()).map(str::len).max();
        assert!(digits < Some(40), "{file} with {set}: {}", done.err);
        done
    };
    for (set, word) in [
        ("m=0", "inertia of `mass` is 0"),
        ("m=-1", "negative inertia"),
        ("m=5e-324", "5e-324"),
        ("b=0", "resistance of `damper` is 0"),
        ("b=-1", "active R:damper"),
    ] {
        run("hostile.bond", set).is(1, &[], &[word]);
    }
    for set in ["m=NaN", "m=inf", "m=1e999"] {
        run("hostile.bond", set).is(2, &[], &["number"]);
    }
    for set in ["beta=1e300", "x0=1e300", "v0=1e300", "u=1e300"] {
        run("hostile.bond", set).is(3, &[], &["no finite value"]);
    }
    for set in ["m=1e-300", "m=1e300", "k=1e-300", "k=1e300", "beta=0", "b=1e-300", "b=1e300", "x0=1e-300", "u=1e-300"]
    {
        let done = run("hostile.bond", set).is(0, &[], &["passive"]);
        assert!(!done.out.contains("NaN") && !done.out.contains("inf"), "{set}: {}", done.out);
    }
    // However long its steps are for such a mass, they balance.
    run("hostile.bond", "m=1e-300").is(0, &[], &["passive     yes"]);
    run("sampled.bond", "ratio=0").is(1, &[], &["a period of 0 s"]);
    run("sampled.bond", "ratio=-1").is(1, &[], &["cannot be run"]);
    run("sampled.bond", "ratio=1e-300").is(2, &[], &["3.16228e-302 s"]);
    run("fput.bond", "n=0").is(1, &[], &["spring[1]"]);
    run("fput.bond", "n=1e300").is(1, &[], &["1e300"]);
}

/// What is drawn of a model steers no terminal.
#[test]
fn models_that_would_steer_a_terminal() {
    let here = Folder::new().with("a.bond", "model M {\n  R:\u{1b}[31mr = 1 Ohm \u{9b}31m \u{0}\n}\n");
    let done = here.bond(&["check", "a.bond"]);
    assert!(done.status == 1 && done.err.contains("?[31mr"), "{done:?}");
    assert!(!done.err.contains(['\u{1b}', '\u{9b}', '\u{0}']), "{done:?}");
}
