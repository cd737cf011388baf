//! Scenes that meet an outside: over datagrams, pipes and a shared file.

use super::Folder;
use bond::exchange::{Device, Effort, LONGEST, Measurement, effort_length};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::UdpSocket;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A spring with a damper that is bent from the start, behind one port.
pub(super) const SPRING: &str = "\
model Spring(k = 400 N/m) {
  port tip { inertia = 0.2 kg }
  sampled at 500 Hz {
    C:spring { stiffness = k; q0 = 0.02 m }
    R:damper = 3 N*s/m
    1:w -> spring, damper
  }
  tip ||> w
  probe x = spring.q
  simulate { stop = 1 s }
}
";

/// Two springs with dampers, behind a port each.
const TWO: &str = "\
model Two {
  port left
  port right
  sampled at 500 Hz {
    C:spring { stiffness = 400 N/m; q0 = 0.02 m }
    C:other { stiffness = 300 N/m }
    R:damper = 3 N*s/m
    R:drag = 2 N*s/m
    1:v -> spring, damper
    1:w -> other, drag
  }
  left ||> v
  right ||> w
  simulate { stop = 1 s }
}
";

/// The first line on standard error, which names the line.
pub(super) fn first(child: &mut Child) -> (String, BufReader<std::process::ChildStderr>) {
    let mut err = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    err.read_line(&mut line).unwrap();
    (line, err)
}

/// Random numbers from 0 to 1.
fn dice(seed: &mut u64) -> f64 {
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// A mass that is pushed about, and now and then moves only to draw energy; what it counted itself.
pub(super) struct Pushed {
    pub(super) device: Device,
    speed: f64,
    seed: u64,
    pub(super) own: f64,
    pub(super) lowest: f64,
    pub(super) turned: f64,
}

impl Pushed {
    pub(super) fn new() -> Self {
        Self { device: Device::new(1), speed: 0.0, seed: 12345, own: 0.0, lowest: 0.0, turned: 0.0 }
    }

    pub(super) fn step(&mut self, now: f64, dt: f64) {
        let v = self.device.effort(0, now);
        let thief = dice(&mut self.seed) < 0.3;
        let dq = if thief { [-v.signum() * 1e-3 * dice(&mut self.seed)] } else { [self.speed * dt] };
        let effort = v * self.device.part(0, &dq, now);
        self.device.moved(&dq, &[effort]);
        self.own += effort * dq[0];
        self.turned += (effort * dq[0]).abs();
        self.lowest = self.lowest.min(self.own);
        self.speed += (10.0 * (2.0 * dice(&mut self.seed) - 1.0) - effort - self.speed) * dt / 0.5;
    }
}

#[test]
fn nothing_is_given_over_a_bad_line_of_datagrams() {
    let here = Folder::new().with("a.bond", SPRING);
    let args =
        ["serve", "a.bond", "--udp", "127.0.0.1:0", "--duration", "1.5s", "--report", "json", "--ledger", "l.csv"];
    let mut child = here.spawn(&args);
    let (line, _err) = first(&mut child);
    let address = line.trim().rsplit(' ').next().unwrap().to_string();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    let mut pushed = Pushed::new();
    let (start, mut late): (Instant, Vec<(f64, Vec<u8>)>) = (Instant::now(), Vec::new());
    let (mut buffer, mut last) = ([0; LONGEST], 0.0);
    while child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(60) {
        let now = start.elapsed().as_secs_f64();
        if let Ok((n, _)) = socket.recv_from(&mut buffer) {
            let bad = dice(&mut pushed.seed);
            if let Some(e) = Effort::read(&buffer[..n]).filter(|_| bad > 0.1) {
                pushed.device.receive(&e, now);
            }
        }
        pushed.step(now, now - last);
        last = now;
        let n = pushed.device.measurement(now).write(&mut buffer);
        let bad = dice(&mut pushed.seed);
        if bad > 0.2 {
            socket.send_to(&buffer[..n], &address).unwrap();
        } else if bad > 0.1 {
            late.push((now + 0.01, buffer[..n].to_vec()));
        }
        late.retain(|(at, bytes)| {
            let stays = *at > now;
            if !stays {
                let _ = socket.send_to(bytes, &address);
                let _ = socket.send_to(b"nonsense", &address);
            }
            stays
        });
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["model"], &json["passive"]), (&"Spring".into(), &true.into()), "{json:#}");
    // The duration counts from the start, and the intervals from the first measurement on.
    let intervals = json["intervals"].as_u64().unwrap();
    assert!((1..=750).contains(&intervals), "{json:#}");
    for told in ["overtaken", "refused"] {
        assert!(json[told].as_u64().unwrap() > 0, "{told}: {json:#}");
    }
    // The spring held 0.08 J.
    assert!(pushed.turned > 0.01, "{} J were exchanged", pushed.turned);
    assert!(pushed.lowest >= -0.08 - 1e-12 * pushed.turned, "{} J were drawn of 0.08 J", -pushed.lowest);
    // What is booked is what the device told last, or a little before.
    let ledger = here.read("l.csv");
    assert!(ledger.starts_with("t,missing,late,silent,energy,stored,tip.held,tip.moved\n0,0,0,0,0,"));
    assert_eq!(ledger.lines().count() as u64, intervals + 2);
    let energies = ledger.lines().skip(1).map(|l| l.split(',').nth(4).unwrap().parse::<f64>().unwrap());
    assert!(energies.fold(0.0, f64::min) >= -0.08 - 1e-12 * pushed.turned);
}

/// Line for line, without a clock, it is the scene itself.
#[test]
fn lines_in_lockstep_are_the_scene() {
    let here = Folder::new().with("a.bond", SPRING);
    let moves: Vec<f64> = (0..300).map(|k| 2e-4 * (f64::from(k) * 0.1).sin()).collect();
    let lines: String = moves.iter().map(|q| format!("{q}\n")).collect();
    let done = here.fed(&["serve", "a.bond", "--stdio", "--lockstep", "--report", "json"], &lines).is(0, &[], &[]);
    let compiled = bond::compile_str("a.bond", SPRING).unwrap();
    let mut sim = compiled.simulate(bond::Steps::new()).unwrap();
    let mut wanted = vec![sim.held()[0].1];
    for (k, q) in moves.iter().enumerate() {
        sim.report("tip", *q).unwrap();
        sim.advance((k + 1) as f64 * 2e-3).unwrap();
        wanted.push(sim.held()[0].1);
    }
    let found: Vec<f64> = done.out.lines().map(|l| l.split(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(found.len(), wanted.len());
    for (k, (a, b)) in found.iter().zip(&wanted).enumerate() {
        // Sums of what moved have the rounding of sums.
        assert!((a - b).abs() <= 1e-9 * b.abs().max(1e-3), "line {k}: {a} and {b}");
    }
    // Standard error has the report, and nothing else.
    let json: Value = serde_json::from_str(&done.err).unwrap_or_else(|e| panic!("{e}: {}", done.err));
    assert_eq!((&json["intervals"], &json["missing"], &json["passive"]), (&300.into(), &0.into(), &true.into()));
}

/// Numbers may stand in columns: any blanks between them are as a comma.
#[test]
fn blanks_are_as_commas() {
    let here = Folder::new().with("a.bond", TWO);
    let out = |lines: &str| here.fed(&["serve", "a.bond", "--stdio", "--lockstep"], lines).is(0, &[], &[]).out;
    let commas = out("1e-4,-1e-4\n0,2e-4\n");
    assert_eq!(commas.lines().count(), 3, "{commas}");
    assert_ne!(commas, out("1e-4,-1e-4\n0,3e-4\n"));
    for blanks in ["1e-4 -1e-4\n0 2e-4\n", " 1e-4   -1e-4\n 0       2e-4 \n", "1e-4\t-1e-4\r\n0\t2e-4\r\n"] {
        assert_eq!(out(blanks), commas, "{blanks:?}");
    }
}

/// What came before a line that is none is in the report.
#[test]
fn a_broken_line_ends_with_the_report() {
    let here = Folder::new().with("a.bond", SPRING);
    let args = ["serve", "a.bond", "--stdio", "--lockstep", "--report", "json", "--ledger", "l.csv"];
    let done = here.fed(&args, "1e-4\n1e-4\nx\n1e-4\n").is(2, &[], &["standard input: line 3: `x` is no number"]);
    assert_eq!(done.out.lines().count(), 3, "{}", done.out);
    let json: Value = serde_json::from_str(&done.err).unwrap_or_else(|e| panic!("{e}: {}", done.err));
    assert_eq!((&json["intervals"], &json["passive"], &json["failure"]), (&2.into(), &true.into(), &Value::Null));
    assert!(json["broken"].as_str().unwrap().contains("line 3"));
    // The spring is bent by 0.02 m, and pushed on by 0.1 mm twice.
    let energy = json["energy"]["put_in"].as_f64().unwrap();
    assert!((energy - 2.0 * 1e-4 * 8.0).abs() < 2e-4, "{energy} J");
    assert_eq!(here.read("l.csv").lines().count(), 4);
}

#[test]
fn what_is_built_serves() {
    let here = Folder::new().with("a.bond", SPRING);
    here.bond(&["build", "a.bond", "-o", "here", "--set", "k=100"]).is(0, &[], &[]);
    let file = here.0.join(format!("here{}", std::env::consts::EXE_SUFFIX));
    let mut child = Command::new(file)
        .args(["serve", "--stdio", "--lockstep"])
        .current_dir(&here.0)
        .env("PATH", "")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::io::Write::write_all(&mut child.stdin.take().unwrap(), b"0\n0\n-1e-4\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && out.lines().count() == 4, "{out}{err}");
    for told in ["scene       Spring", "intervals   3 of 0.002 s", "passive     yes", "0 missing"] {
        assert!(err.contains(told), "{told}: {err}");
    }
}

#[cfg(unix)]
#[test]
fn a_shared_file_is_a_line() {
    use std::os::unix::fs::FileExt;
    let here = Folder::new().with("a.bond", SPRING);
    let mut child = here.spawn(&["serve", "a.bond", "--shm", "./line", "--duration", "0.4", "--report", "json"]);
    let (line, mut err) = first(&mut child);
    assert!(line.contains("file ./line"), "{line}");
    let file = std::fs::OpenOptions::new().read(true).write(true).open(here.0.join("line")).unwrap();
    let (mut pushed, start, mut last) = (Pushed::new(), Instant::now(), 0.0);
    let mut buffer = [0; LONGEST];
    while child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(60) {
        let now = start.elapsed().as_secs_f64();
        let n = effort_length(1);
        file.read_exact_at(&mut buffer[..n], 0).unwrap();
        if let Some(e) = Effort::read(&buffer[..n]) {
            pushed.device.receive(&e, now);
        }
        pushed.step(now, now - last);
        last = now;
        let n = pushed.device.measurement(now).write(&mut buffer);
        file.write_all_at(&buffer[..n], 4096).unwrap();
        std::thread::sleep(Duration::from_micros(300));
    }
    let mut told = String::new();
    err.read_to_string(&mut told).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{told}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((1..=200).contains(&json["intervals"].as_u64().unwrap()), "{json:#}");
    assert_eq!(json["passive"], true, "{json:#}");
    assert!(pushed.lowest >= -0.08 - 1e-12 * pushed.turned && pushed.turned > 1e-3, "{}", pushed.lowest);
    assert!(!here.list().contains(&"line".to_string()), "the file is left");
}

#[test]
fn packets_go_through_pipes() {
    let here = Folder::new().with("a.bond", SPRING);
    let mut child = here.spawn(&["serve", "a.bond", "--stdio", "--binary", "--lockstep"]);
    let (mut input, mut output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let (mut device, mut buffer) = (Device::new(1), [0; LONGEST]);
    for k in 0..100 {
        let n = effort_length(1);
        output.read_exact(&mut buffer[..n]).unwrap();
        let e = Effort::read(&buffer[..n]).unwrap();
        assert_eq!(e.sequence, k);
        assert!(device.receive(&e, k as f64 * 2e-3));
        device.moved(&[-1e-5], &[device.effort(0, k as f64 * 2e-3)]);
        let m: Measurement = device.measurement(k as f64 * 2e-3);
        let n = m.write(&mut buffer);
        std::io::Write::write_all(&mut input, &buffer[..n]).unwrap();
    }
    drop(input);
    let output = child.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && err.contains("intervals   100 of") && err.contains("passive     yes"), "{err}");
}

/// What a line allows is not allowed by the next one too, as long as nobody says that it was not drawn.
#[test]
fn lines_without_an_answer_allow_nothing_more() {
    let here = Folder::new().with("a.bond", SPRING);
    let mut child = here.spawn(&["serve", "a.bond", "--stdio"]);
    let (mut input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let mut lines =
        BufReader::new(output).lines().map(|l| l.unwrap().split(',').nth(1).unwrap().parse::<f64>().unwrap());
    let stored = 0.5 * 400.0 * 0.02 * 0.02;
    assert!((lines.next().unwrap() - stored).abs() < 1e-15);
    // The clock starts; what comes then waits for an answer.
    std::io::Write::write_all(&mut input, b"0\n").unwrap();
    let allowed: Vec<f64> = lines.by_ref().take(20).collect();
    assert!((allowed[0] - stored).abs() < 1e-15 && allowed[1..].iter().all(|x| *x == 0.0), "{allowed:?}");
    // Nothing was drawn under them.
    std::io::Write::write_all(&mut input, &b"0\n".repeat(20)).unwrap();
    assert!(lines.by_ref().take(1000).any(|x| (x - stored).abs() < 1e-15));
    drop(input);
    child.wait().unwrap();
}

/// A wall that is written as a source stands in the report; whoever draws past what it was given is named.
#[test]
fn steered_walls_and_greedy_devices_are_reported() {
    let text = "model M {
      port tip { inertia = 0.2 kg }
      sampled at 500 Hz { C:place { H = 0; q0 = 0.01 m }  Se:wall = -(400 N/m)*place.q  1:w -> place  wall -> w }
      tip ||> w
    }";
    let here = Folder::new().with("a.bond", text);
    let told =
        here.fed(&["serve", "a.bond", "--stdio", "--lockstep", "--report", "json"], "1e-3\n-1e-3\n0\n").is(0, &[], &[]);
    let json: Value = serde_json::from_str(&told.err).unwrap();
    assert_eq!(
        (&json["steered"][0]["name"], &json["steered"][0]["role"]),
        (&"wall".into(), &"draws on the account".into())
    );
    // It was put in without an effort, so that nothing was there to be drawn.
    let energy = |what: &str| json["energy"][what].as_f64().unwrap();
    assert!(energy("given_out") > 1e-3 && energy("overdrawn") == energy("given_out"), "{json:#}");
    let reasons = json["reasons"].as_array().unwrap();
    assert!(reasons.len() == 1 && reasons[0].as_str().unwrap().starts_with("the device drew"), "{json:#}");
    let told = here.fed(&["serve", "a.bond", "--stdio", "--lockstep"], "1e-3\n0\n").is(0, &[], &[]);
    assert!(told.err.contains("steered     `wall`") && told.err.contains("passive     yes"), "{}", told.err);
}

/// Ports of several regions: a line allows what each of them has, and not their sum. How long the device takes to come
/// is no round trip.
#[test]
fn a_line_allows_what_each_region_has() {
    let text = "model M {
      port a
      port b
      sampled at 500 Hz { C:ca { stiffness = 400 N/m; q0 = 0.02 m }  R:ra = 1 N*s/m  1:va -> ca, ra }
      sampled at 500 Hz { C:cb { stiffness = 100 N/m; q0 = 0.01 m }  R:rb = 1 N*s/m  1:vb -> cb, rb }
      a ||> va
      b ||> vb
    }";
    let here = Folder::new().with("a.bond", text);
    let mut child = here.spawn(&["serve", "a.bond", "--stdio", "--lockstep", "--report", "json"]);
    let (mut input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let mut lines = BufReader::new(output).lines().map(|l| l.unwrap());
    let mut allowed = || lines.next().unwrap().split(',').nth(2).unwrap().parse::<f64>().unwrap();
    assert!((allowed() - 0.005).abs() < 1e-15);
    std::thread::sleep(Duration::from_millis(600));
    // The first is bent further, and the second still is what bounds them; then 2 mJ are drawn from that.
    for (line, least) in [("1e-3,0\n", 0.005), ("0,-2e-3\n", 0.003)] {
        std::io::Write::write_all(&mut input, line.as_bytes()).unwrap();
        let x = allowed();
        assert!(x > 0.0 && x <= least * (1.0 + 1e-12), "{line}: {x}");
    }
    drop(input);
    let told = child.wait_with_output().unwrap();
    let json: Value = serde_json::from_slice(&told.stderr).unwrap();
    assert!(json["round_trip"]["max_us"].as_f64().unwrap() < 5e5, "{json:#}");
}

#[test]
fn what_cannot_be_served_is_told() {
    let here = Folder::new()
        .with("a.bond", SPRING)
        .with("none.bond", super::OSCILLATOR)
        .with("continuous.bond", "model Bare {\n  port tip\n  C:spring { stiffness = 1 N/m }\n  tip -> spring\n}\n")
        .with("taken", "");
    let fails = |args: &[&str], input: &str, status: i32, why: &str| {
        here.fed(&[&["serve"], args].concat(), input).is(status, &[], &[why]);
    };
    fails(&["none.bond", "--stdio"], "", 1, "has no open port; declare one");
    fails(&["continuous.bond", "--stdio"], "", 1, "put a sampled region behind it");
    fails(&["a.bond"], "", 2, "--stdio");
    fails(&["a.bond", "--stdio", "--udp", "127.0.0.1:0"], "", 2, "cannot be used with");
    fails(&["a.bond", "--udp", "nonsense"], "", 2, "write an IP address and a port");
    fails(
        &["a.bond", "--udp", "localhost:7500"],
        "",
        2,
        "such as 127.0.0.1:7000 or [::1]:7000; names are not looked up",
    );
    fails(&["a.bond", "--udp", "127.0.0.1:0", "--peer", "localhost:1"], "", 2, "write an IP address, with or without");
    for (option, why) in [("--hold", "-1 is not in 1..=1000000"), ("--duration", "longer than 0 s")] {
        fails(&["a.bond", "--stdio", option, "-1"], "", 2, why);
    }
    fails(&["a.bond", "--udp", "127.0.0.1:0", "--lockstep"], "", 2, "--lockstep is for --stdio only");
    fails(&["a.bond", "--stdio", "--peer", "127.0.0.1:1"], "", 2, "--peer is for --udp only");
    fails(&["a.bond", "--stdio", "--priority", "100"], "", 2, "100 is not in 1..=99");
    fails(&["a.bond", "--shm", "./taken"], "", 2, "another environment uses it");
    fails(&["a.bond", "--stdio", "--lockstep"], "0\nx\n", 2, "line 2: `x` is no number");
    fails(&["a.bond", "--stdio", "--lockstep"], "0,0\n", 2, "there are 2 numbers for 1 open port:");
    fails(&["a.bond", "--stdio", "--lockstep"], "nan\n", 2, "no number");
    fails(&["a.bond", "--stdio", "--lockstep"], "0\n1e300\n0\n", 2, "line 2: a sum since the start");
    // A line without end is not kept, and what is shown of a cell is short.
    fails(&["a.bond", "--stdio", "--lockstep"], &"x".repeat(1 << 20), 2, "line 1: it is longer than 128 bytes");
    fails(
        &["a.bond", "--stdio", "--lockstep"],
        &format!("0\n{}\n", "x".repeat(100)),
        2,
        "line 2: `xxxxxxxxxxxxxxxxxxxxxxxx...` is",
    );
    // Packets may hold any byte, so that standard output is not looked at.
    let mut child = here.spawn(&["serve", "a.bond", "--stdio", "--binary", "--lockstep"]);
    std::io::Write::write_all(&mut child.stdin.take().unwrap(), &[b'x'; 100]).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("64 bytes that are no measurement of 1 ports"));
    // Nobody says anything.
    fails(&["a.bond", "--stdio"], "", 0, "intervals   0 of");
}

/// The device in Python keeps the rules too. Where there is no Python it is left out.
#[test]
fn the_device_in_python_meets_it() {
    if Command::new("python3").arg("--version").output().is_err() {
        return;
    }
    let here = Folder::new().with("a.bond", SPRING);
    let mut child = here.spawn(&["serve", "a.bond", "--udp", "127.0.0.1:0", "--duration", "3s", "--report", "json"]);
    let (line, _err) = first(&mut child);
    let address = line.trim().rsplit(' ').next().unwrap().to_string();
    let device = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/embed/device.py");
    let args = [device, &address, "--drop", "0.05", "--delay", "0.05", "--thief"];
    let told = Command::new("python3").args(args).output().unwrap();
    if !told.status.success() {
        let _ = child.kill();
        panic!("{}", String::from_utf8_lossy(&told.stderr));
    }
    let output = child.wait_with_output().unwrap();
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((1..=1500).contains(&json["intervals"].as_u64().unwrap()), "{json:#}");
    assert_eq!(json["passive"], true, "{json:#}");
    let own: Value = serde_json::from_slice(&told.stdout).unwrap();
    let number = |key: &str| own[key].as_f64().unwrap();
    let turned = number("put_in") + number("given_out");
    // The spring held 0.08 J.
    assert!(number("lowest") >= -0.08 - 1e-12 * turned && turned > 1e-3, "{own}");
}
