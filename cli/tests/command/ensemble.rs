use super::{BLOWS_UP, Done, Folder, OSCILLATOR};
use serde_json::Value;

/// An integrator: its charge at 1 s is its parameter, so that a table of probes shows what was drawn.
const CHARGE: &str = "\
model Charge(current = 1 A, offset = 0 C) {
  Sf:source = current
  C:cap { compliance = 1 F; q0 = offset }
  source -> cap
  probe q = cap.q
  probe u = cap.e
  simulate { stop = 1 s; step = 0.1 s }
}
";

/// One that takes a few milliseconds an instance.
const SLOW: &[&str] = &["--stop", "20ms", "--step", "1us", "--method", "gonzalez"];

fn run(here: &Folder, args: &[&str]) -> Done {
    here.bond(&[&["run", "a.bond"], args].concat())
}

/// Columns of a table whose status is last and empty.
fn columns(done: &Done) -> Vec<Vec<f64>> {
    let mut lines = done.out.lines();
    let width = lines.next().unwrap().split(',').count() - 1;
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').take(width).map(|x| x.parse().unwrap()).collect()).collect();
    (0..width).map(|i| rows.iter().map(|r| r[i]).collect()).collect()
}

#[test]
fn a_grid_has_a_row_a_point() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let done =
        run(&here, &["--sweep", "m=1 kg..3 kg:3", "--sweep", "k=50,100", "-o", "-"]).is(0, &[], &["instances   6"]);
    assert_eq!(done.out.lines().next(), Some("instance,m,k,x,v,passive,worst_balance,status"));
    let c = columns(&done);
    assert_eq!(c[0], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(c[1], [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
    assert_eq!(c[2], [50.0, 100.0, 50.0, 100.0, 50.0, 100.0]);
    assert_eq!(c[5], [1.0; 6]);
    for i in 0..6 {
        let (m, k, d) = (c[1][i], c[2][i], 0.25 / c[1][i]);
        let w = (k / m - d * d).sqrt();
        let x = 0.1 * (-d).exp() * (w.cos() + d / w * w.sin());
        assert!((c[3][i] - x).abs() < 1e-12 && c[6][i] < 1e-12);
    }
}

#[test]
fn an_instance_is_a_run_with_its_values() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for more in [&[][..], &["--method", "gonzalez", "--tolerance", "1e-7"], &["--method", "rk4", "--step", "3ms"]] {
        let args =
            [&["--sweep", "m=1..2:3", "--monte-carlo", "2", "--draw", "k=normal(100 N/m, 5 N/m)", "-o", "-"], more];
        let done = run(&here, &args.concat()).is(0, &[], &[]);
        for line in done.out.lines().skip(1) {
            let c: Vec<&str> = line.split(',').collect();
            let (m, k) = (format!("m={}", c[1]), format!("k={}", c[2]));
            let alone = run(&here, &[&["--set", &m, "--set", &k, "-o", "-"], more].concat()).is(0, &[], &[]);
            assert_eq!(alone.out.lines().last(), Some(format!("1,{},{}", c[3], c[4]).as_str()), "{more:?}");
        }
    }
}

#[test]
fn machine_code_and_the_interpreter_give_the_same_table() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    // Short runs and long ones, which are run in different ways.
    for step in ["100ms", "10us"] {
        let args = ["--sweep", "m=1..2:4", "--method", "gonzalez", "--step", step, "-o", "-"];
        let (one, two) = (run(&here, &args), run(&here, &[&args[..], &["--interpret"]].concat()));
        assert_eq!((one.status, one.out), (two.status, two.out));
    }
}

#[test]
fn rows_over_time_are_those_of_single_runs() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let times = ["--every", "0.25", "--at", "0.1", "-o", "-"];
    let done = run(&here, &[&["--sweep", "m=1,4"], &times[..]].concat()).is(0, &[], &[]);
    let mut wanted = "instance,m,t,x,v\n".to_string();
    for (i, m) in ["1", "4"].iter().enumerate() {
        let alone = run(&here, &[&["--set", &format!("m={m}")], &times[..]].concat()).is(0, &[], &[]);
        wanted.extend(alone.out.lines().skip(1).map(|l| format!("{i},{m},{l}\n")));
    }
    assert_eq!(done.out, wanted);
    assert_eq!(wanted.lines().count(), 1 + 2 * 6);
}

#[test]
fn draws_are_those_of_their_distributions() {
    let here = Folder::new().with("a.bond", CHARGE);
    let n = 5_000;
    let moments = |law: &str, seed: &str| {
        let args = ["--monte-carlo", &n.to_string(), "--draw", law, "--seed", seed, "--summary", "json"];
        let done = run(&here, &args).is(0, &[], &[]);
        let json: Value = serde_json::from_str(&done.out).unwrap();
        assert_eq!((json["instances"].as_u64(), json["failed"].as_u64()), (Some(n), Some(0)));
        ["min", "mean", "max", "sd"].map(|what| json["final"]["q"][what].as_f64().unwrap())
    };
    // Five standard errors of a mean, and about as many of a standard deviation.
    let off = 5.0 / (n as f64).sqrt();
    let s = 0.2f64;
    let log_mean = 3.0 * (s * s / 2.0).exp();
    for (law, mean, sd, low, high) in [
        ("current=uniform(2 A, 5 A)", 3.5, 0.75f64.sqrt(), 2.0, 5.0),
        ("current=normal(-1, 0.25)", -1.0, 0.25, -3.0, 1.0),
        ("current=lognormal(3000 mA, 0.2)", log_mean, log_mean * ((s * s).exp() - 1.0).sqrt(), 0.0, 10.0),
        ("current=triangular(0, 1, 3)", 4.0 / 3.0, (7.0f64 / 18.0).sqrt(), 0.0, 3.0),
    ] {
        for seed in ["0", "9"] {
            let [min, m, max, d] = moments(law, seed);
            assert!((m - mean).abs() < off * sd && (d / sd - 1.0).abs() < off, "{law}: {m} {d}, not {mean} {sd}");
            assert!(min >= low && max <= high + 1e-12, "{law}: {min} {max}");
        }
    }
    assert_ne!(moments("current=uniform(2,5)", "0"), moments("current=uniform(2,5)", "1"));
}

#[test]
fn parameters_are_drawn_apart_and_more_draws_go_on() {
    let here = Folder::new().with("a.bond", CHARGE);
    let draws = ["--draw", "current=uniform(0,1)", "--draw", "offset=uniform(0,1)", "-o", "-"];
    let of = |n: &str| run(&here, &[&["--monte-carlo", n], &draws[..]].concat()).is(0, &[], &[]);
    let (few, many) = (of("50"), of("4000"));
    assert!(many.out.starts_with(&few.out));
    let c = columns(&many);
    let mean = |f: &dyn Fn(usize) -> f64| (0..4000).map(f).sum::<f64>() / 4000.0;
    // The correlation of independent numbers has a standard error of 0.016.
    let apart = mean(&|i| (c[1][i] - 0.5) * (c[2][i] - 0.5)) * 12.0;
    let next = mean(&|i| (c[1][i] - 0.5) * (c[1][(i + 1) % 4000] - 0.5)) * 12.0;
    assert!(apart.abs() < 0.08 && next.abs() < 0.08, "{apart} {next}");
    // Draws at the points of a grid are draws of their own.
    let grid =
        run(&here, &["--sweep", "offset=1,2", "--monte-carlo", "2", "--draw", "current=uniform(0,1)", "-o", "-"]);
    let g = columns(&grid.is(0, &[], &[]));
    assert_eq!(g[1], [1.0, 1.0, 2.0, 2.0]);
    assert_eq!(g[2], c[1][..4]);
}

#[test]
fn threads_change_nothing() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let ensemble = ["--sweep", "k=-10..100:12", "--monte-carlo", "20", "--draw", "m=normal(1, 0.5)"];
    let of = |threads: &str, more: &[&str]| {
        let done = run(&here, &[&ensemble[..], &["--threads", threads, "--summary", "json"], more].concat());
        let mut json: Value = serde_json::from_str(if done.out.starts_with('{') { &done.out } else { "{}" }).unwrap();
        for what in ["wall_seconds", "instances_per_second", "threads"] {
            json[what] = Value::Null;
        }
        (done.status, json)
    };
    let mut all = Vec::new();
    for threads in ["1", "2", "3", "7"] {
        let rows = ["--at", "0.5,1", "-o", "t.csv"];
        let mut bytes = Vec::new();
        for (name, more) in [("a.csv", &["-o", "a.csv"][..]), ("t.csv", &rows)] {
            let (status, json) = of(threads, more);
            assert_eq!(status, 3);
            bytes.push((here.read(name), json));
        }
        bytes.push((run(&here, &[&ensemble[..], &["--threads", threads, "-o", "-"]].concat()).out, Value::Null));
        bytes.push((String::new(), of(threads, &[]).1));
        all.push(bytes);
    }
    assert!(all.iter().all(|b| *b == all[0]));
    assert_eq!(all[0][0].0, all[0][2].0);
    assert_eq!(all[0][0].1, all[0][3].1);
    assert!(all[0][0].1["failed"].as_u64() > Some(20));
}

#[test]
fn a_failed_instance_stops_no_other() {
    let here = Folder::new()
        .with("a.bond", OSCILLATOR)
        .with("b.bond", BLOWS_UP.replace("BlowsUp", "BlowsUp(m = 1 kg)").replace("inertia = 1 kg", "inertia = m"));
    let done = run(&here, &["--sweep", "m=-1,1,0", "-o", "a.csv"]).is(
        3,
        &["failed      2", "passive     yes, all 1"],
        &["2 of 3 instances failed", "instance 0 (m = -1): negative inertia", "instance 2 (m = 0): "],
    );
    assert!(!done.out.contains("nan"));
    let text = here.read("a.csv");
    let rows: Vec<&str> = text.lines().collect();
    assert!(rows[1].starts_with("0,-1,nan,nan,0,nan,") && rows[1].contains("negative inertia"), "{text}");
    assert!(rows[2].starts_with("1,1,") && rows[2].ends_with(','), "{text}");
    // The numerics of light masses fail before the end; rows over time are kept until then.
    let args = ["run", "b.bond", "--sweep", "m=1,10", "-o", "b.csv"];
    here.bond(&args).is(3, &["passive     NO: 0 of 1"], &["instance 0 (m = 1): ", "t = 0.99"]);
    assert!(here.read("b.csv").lines().nth(1).unwrap().contains("t = 0.99"));
    here.bond(&[&args[..], &["--every", "0.5"]].concat()).is(3, &[], &[]);
    let text = here.read("b.csv");
    let times: Vec<&str> = text.lines().skip(1).map(|l| l.split(',').nth(2).unwrap()).collect();
    assert_eq!(times, ["0", "0.5", "0", "0.5", "1", "1.5", "2"]);
    assert_eq!(here.list(), ["a.bond", "a.csv", "b.bond", "b.csv"]);
}

#[test]
fn an_instance_with_other_probes_failed() {
    let text = "model Chain(n = 2) {\n  for i in 1..n { I:m[i] { inertia = 1 kg; f0 = 1 m/s }\n  Se:f[i] = 0 N\n  f[i] -> m[i]\n  probe v = m[i].f }\n}\n";
    let here = Folder::new().with("a.bond", text);
    let done = run(&here, &["--sweep", "n=2,3", "--stop", "1", "-o", "-"]);
    done.is(
        3,
        &["instance,n,v[1],v[2],passive", "\n0,2,1,1,1,"],
        &["its probes are v[1], v[2], v[3], and not those of the others"],
    );
}

#[test]
fn nonsense_is_refused() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    for (args, status, words) in [
        (&["--sweep", "zz=1,2"][..], 2, "no parameter `zz`"),
        (&["--sweep", "m=1 N,2 N"], 2, "the value is in N, and `m` is in kg"),
        (&["--sweep", "m=1..2"], 2, "how many values"),
        (&["--sweep", "m=1..2:0"], 2, "empty"),
        (&["--sweep", "m=1..nan:3"], 2, "`nan` is no number"),
        (&["--sweep", "m=1,2", "--set", "m=3"], 2, "`m` is in --set and in --sweep"),
        (&["--sweep", "m=1,2", "--sweep", "m=3"], 2, "two --sweep"),
        (&["--sweep", "m=1..2:100000", "--sweep", "k=1..2:100000"], 2, "too many instances"),
        (&["--sweep", "m=1,2", "--ledger", "l.csv"], 2, "--ledger is for single runs"),
        (&["--sweep", "m=1,2", "--at", "5"], 2, "beyond the end"),
        (&["--sweep", "m=1,2", "--every", "1e-8", "-o", "x.csv"], 2, "longer --every"),
        (&["--sweep", "m=1,2", "--step", "1e-30"], 2, "at most 1e10"),
        (&["--sweep", "m=1,2", "--threads", "0"], 2, "1..=256"),
        (&["--sweep", "m=1,2", "-o", "."], 2, "directory"),
        (&["--sweep", "m=1,2", "-o", "none/a.csv"], 2, "cannot write"),
        (&["--sweep", "m=1,2", "-o", "a.xlsx"], 2, "`.xlsx`"),
        (&["--monte-carlo", "0", "--draw", "m=uniform(1,2)"], 2, "1..=1000000000"),
        (&["--monte-carlo", "2000000000", "--draw", "m=uniform(1,2)"], 2, "1..=1000000000"),
        (&["--monte-carlo", "3"], 2, "--draw"),
        (&["--draw", "m=uniform(1,2)"], 2, "--draw is for drawn parameters; add --monte-carlo N"),
        (&["--sweep", "m=1,2", "--seed", "3"], 2, "--seed is for drawn parameters; add --monte-carlo N"),
        (&["--seed", "3"], 2, "--seed is for drawn parameters; add --monte-carlo N"),
        (&["--monte-carlo", "-3", "--draw", "m=uniform(1,2)"], 2, "a whole number in 1..=1000000000"),
        (&["--monte-carlo", "3", "--draw", "m=uniform(1,2)", "--seed", "-1"], 2, "a whole number, at least 0"),
        (&["--sweep", "m=1,2", "--threads", "-1"], 2, "a whole number in 1..=256"),
        (&["--monte-carlo", "3", "--draw", "m=uniform(2,1)"], 2, "empty"),
        (&["--monte-carlo", "3", "--draw", "m=cauchy(2,1)"], 2, "no distribution `cauchy`"),
        (&["--threads", "2"], 2, "--sweep or --monte-carlo"),
        (&["--restart"], 2, "--sweep or --monte-carlo"),
    ] {
        let done = run(&here, args).is(status, &[], &[words]);
        assert_eq!(done.out, "");
    }
    assert_eq!(here.list(), ["a.bond"]);
}

#[test]
fn names_of_the_table_are_told_apart() {
    let text = "model Odd(t = 1 kg, status = 1 N) {\n  I:mass = t\n  Se:F = status\n  F -> mass\n  probe passive = mass.f\n}\n";
    let here = Folder::new().with("a.bond", text);
    let header = |more: &[&str]| {
        let args = [&["--sweep", "t=1,2", "--sweep", "status=1", "--stop", "1", "-o", "-"], more].concat();
        run(&here, &args).is(0, &[], &[]).out.lines().next().unwrap().to_string()
    };
    assert_eq!(header(&[]), "instance,t,status_,passive_,passive,worst_balance,status");
    assert_eq!(header(&["--at", "1"]), "instance,t_,status,t,passive");
}

#[cfg(unix)]
mod killed {
    use super::*;
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    const SWEEP: [&str; 4] = ["--sweep", "k=10..100:300", "-o", "a.csv"];

    /// Starts an ensemble, and kills it when its side file is that long.
    fn kill(here: &Folder, threads: &str, length: u64) {
        let args = [&["run", "a.bond", "--threads", threads], &SWEEP[..], SLOW].concat();
        let mut child = Command::new(env!("CARGO_BIN_EXE_bond"))
            .args(args)
            .current_dir(&here.0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (side, begun) = (here.0.join("a.csv.part"), Instant::now());
        while std::fs::metadata(&side).map_or(0, |m| m.len()) < length {
            assert!(begun.elapsed() < Duration::from_secs(120) && child.try_wait().unwrap().is_none());
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(here.list(), ["a.bond", "a.csv.part"]);
    }

    #[test]
    fn what_was_cut_off_is_gone_on_with() {
        let here = Folder::new().with("a.bond", OSCILLATOR);
        let whole = [&SWEEP[..], SLOW, &["--summary", "json"]].concat();
        let json = |done: &Done| serde_json::from_str::<Value>(&done.out).unwrap();
        let straight = json(&run(&here, &whole).is(0, &[], &[]));
        assert_eq!((straight["ran"].as_u64(), here.list().len()), (Some(300), 2));
        let wanted = here.read("a.csv");
        std::fs::remove_file(here.0.join("a.csv")).unwrap();
        kill(&here, "1", 1500);
        kill(&here, "2", 4000);
        kill(&here, "3", 8000);
        // A kill in the middle of a chunk, and a disk that has torn the last one.
        let side = here.0.join("a.csv.part");
        let bytes = std::fs::read(&side).unwrap();
        std::fs::write(&side, &bytes[..bytes.len() - 5]).unwrap();
        let done = run(&here, &whole).is(0, &[], &["of 300 instances are in a.csv.part already"]);
        let resumed = json(&done);
        assert!((1..280).contains(&resumed["ran"].as_u64().unwrap()), "{resumed}");
        assert_eq!(here.read("a.csv"), wanted);
        assert_eq!(here.list(), ["a.bond", "a.csv"]);
        for what in ["instances", "failed", "passive", "balance", "final"] {
            assert_eq!(resumed[what], straight[what]);
        }
    }

    #[test]
    fn what_belongs_to_another_ensemble_is_refused() {
        let here = Folder::new().with("a.bond", OSCILLATOR);
        kill(&here, "2", 1500);
        let kept = std::fs::read(here.0.join("a.csv.part")).unwrap();
        let with = |more: &[&str]| run(&here, &[&SWEEP[..2], &["-o", "a.csv"], SLOW, more].concat());
        with(&["--set", "m=2"]).is(2, &[], &["another ensemble", "--set was not given and is `m=2`", "--restart"]);
        with(&["--at", "10ms"]).is(2, &[], &["--at was not given and is `0.01`"]);
        let other = ["--sweep", "k=10..100:301", "-o", "a.csv"];
        run(&here, &[&other[..], SLOW].concat()).is(2, &[], &["--sweep was `k=10..100:300` and is `k=10..100:301`"]);
        let fitted = ["--stop", "20ms", "--method", "gonzalez", "--tolerance", "1e-2", "--longest", "1ms"];
        run(&here, &[&SWEEP[..2], &["-o", "a.csv"], &fitted].concat()).is(
            2,
            &[],
            &["--step was `0.000001` and is not given", "--longest was not given and is `0.001`"],
        );
        std::fs::write(here.0.join("a.bond"), OSCILLATOR.replace("0.5 N*s/m", "0.6 N*s/m")).unwrap();
        with(&[]).is(2, &[], &["the text of the model is another one"]);
        assert_eq!(std::fs::read(here.0.join("a.csv.part")).unwrap(), kept);
        run(&here, &["--sweep", "k=1,2", "-o", "a.csv", "--restart"]).is(0, &["instances   2: 2 run"], &[]);
        assert_eq!(here.list(), ["a.bond", "a.csv"]);
        // A file that is none is never written over.
        let here = here.with("b.csv.part", "mine\n");
        for more in [&[][..], &["--restart"]] {
            let args = [&["--sweep", "k=1,2", "-o", "b.csv"], more].concat();
            run(&here, &args).is(2, &[], &["b.csv.part", "not a side file"]);
        }
        assert_eq!(here.read("b.csv.part"), "mine\n");
    }
}

#[cfg(feature = "parquet")]
mod parquet {
    use super::*;
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use ::parquet::record::Field;

    /// Header and rows of a file, the numbers as they would stand in a CSV file.
    fn read(here: &Folder, name: &str) -> (Vec<String>, Vec<Vec<Field>>) {
        let file = std::fs::File::open(here.0.join(name)).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let schema = reader.metadata().file_metadata().schema_descr();
        let header = schema.columns().iter().map(|c| c.name().to_string()).collect();
        let rows = reader.get_row_iter(None).unwrap();
        (header, rows.map(|r| r.unwrap().get_column_iter().map(|(_, f)| f.clone()).collect()).collect())
    }

    /// Asserts that a Parquet file is a CSV table, to the bit.
    fn same(here: &Folder, name: &str, csv: &str) {
        let (header, rows) = read(here, name);
        let mut lines = csv.lines();
        assert_eq!(header.join(","), lines.next().unwrap().replace('"', ""));
        assert_eq!(rows.len(), csv.lines().count() - 1);
        for (row, line) in rows.iter().zip(lines) {
            let mut left = line.splitn(row.len(), ',');
            for field in row {
                let text = left.next().unwrap();
                let equal = match field {
                    Field::Double(x) => {
                        text.parse::<f64>().is_ok_and(|y| x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan())
                    }
                    Field::Long(n) => text.parse() == Ok(*n),
                    Field::Str(s) => text.trim_matches('"') == s,
                    other => panic!("{other}"),
                };
                assert!(equal, "{field} is not {text} in {line}");
            }
        }
    }

    #[test]
    fn single_runs_are_written_too() {
        let here = Folder::new().with("a.bond", OSCILLATOR);
        // More rows than a group has.
        let rows = ["--every", "10us"];
        run(&here, &[&["-o", "a.csv", "--ledger", "l.csv"], &rows[..]].concat()).is(0, &[], &[]);
        run(&here, &[&["-o", "a.parquet", "--ledger", "l.Parquet"], &rows[..]].concat()).is(0, &[], &[]);
        same(&here, "a.parquet", &here.read("a.csv"));
        same(&here, "l.Parquet", &here.read("l.csv"));
        let size = |name: &str| std::fs::metadata(here.0.join(name)).unwrap().len();
        assert!(size("a.parquet") * 2 < size("a.csv"));
        run(&here, &["-o", "none/a.parquet"]).is(2, &[], &["cannot write"]);
        assert_eq!(here.list(), ["a.bond", "a.csv", "a.parquet", "l.Parquet", "l.csv"]);
    }

    #[test]
    fn failed_runs_keep_their_rows() {
        let here = Folder::new().with("a.bond", BLOWS_UP);
        run(&here, &["-o", "a.parquet"]).is(3, &[], &[]);
        let csv = run(&here, &["-o", "-"]).is(3, &[], &[]);
        same(&here, "a.parquet", &csv.out);
    }

    #[test]
    fn ensembles_are_the_same_in_both_formats() {
        let here = Folder::new().with("a.bond", OSCILLATOR);
        for more in [&[][..], &["--at", "0.1,1"]] {
            let args =
                [&["--sweep", "m=-1..3:9", "--monte-carlo", "3", "--draw", "k=lognormal(100 N/m, 0.1)"], more].concat();
            run(&here, &[&args[..], &["-o", "a.parquet"]].concat()).is(3, &[], &["9 of 27 instances failed"]);
            run(&here, &[&args[..], &["-o", "a.csv"]].concat()).is(3, &[], &[]);
            same(&here, "a.parquet", &here.read("a.csv"));
        }
        assert_eq!(here.list(), ["a.bond", "a.csv", "a.parquet"]);
    }

    #[cfg(unix)]
    #[test]
    fn pipes_are_written_to() {
        let here = Folder::new().with("a.bond", OSCILLATOR);
        run(&here, &["--sweep", "m=1,2", "-o", "/dev/null"]).is(0, &["instances   2"], &[]);
        assert_eq!(here.list(), ["a.bond"]);
    }
}
