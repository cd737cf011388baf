//! Two programs that exchange waves over datagrams, with a bad line between them.

use super::Folder;
use super::serve::first;
use bond::exchange::{LONGEST, Waves};
use serde_json::Value;
use std::io::BufReader;
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, ChildStderr};
use std::time::{Duration, Instant};

/// A hand that pushes a handle.
const MASTER: &str = "\
model Master {
  Se:hand = 8 N*sin(5 rad/s*t)
  I:handle { inertia = 0.5 kg; f0 = 1 m/s }
  R:arm = 1 N*s/m
  sampled at 500 Hz {
    port link { impedance = 20 N*s/m }
    1:m -> link
  }
  hand -> 1:v -> handle, arm
  v ||> m
  probe speed = v.f
}
";

/// A tool at a wall.
const SLAVE: &str = "\
model Slave(k = 4000 N/m) {
  I:tool = 0.2 kg
  C:wall { stiffness = k }
  sampled at 500 Hz {
    port link { impedance = 20 N*s/m }
    link -> 1:s
  }
  1:w -> tool, wall
  w ||> s
  probe speed = w.f
}
";

/// Both, with a line of two periods.
const WHOLE: &str = "\
model Whole {
  Se:hand = 8 N*sin(5 rad/s*t)
  I:handle { inertia = 0.5 kg; f0 = 1 m/s }
  R:arm = 1 N*s/m
  I:tool = 0.2 kg
  C:wall { stiffness = 4000 N/m }
  sampled at 500 Hz {
    TL(a, b):line { impedance = 20 N*s/m; delay = 4 ms }
    1:m -> line.a
    line.b -> 1:s
  }
  hand -> 1:v -> handle, arm
  1:w -> tool, wall
  v ||> m
  w ||> s
  probe near = v.f
  probe far = w.f
}
";

fn folder() -> Folder {
    Folder::new().with("master.bond", MASTER).with("slave.bond", SLAVE).with("whole.bond", WHOLE)
}

/// Where a program listens, as it says first.
fn place(child: &mut Child) -> (SocketAddr, BufReader<ChildStderr>) {
    let (line, err) = first(child);
    (line.trim().rsplit(' ').next().unwrap().parse().unwrap(), err)
}

fn report(child: Child) -> Value {
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(json: &Value, path: &str) -> f64 {
    json.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {json:#}"))
}

/// The sum of what the regions of a program have of something, J.
fn of_regions(json: &Value, what: &str) -> f64 {
    json["regions"].as_array().unwrap().iter().map(|r| r[what].as_f64().unwrap()).sum()
}

/// A bad line, whose dice fall the same way each time: what comes at one end leaves at the other one.
struct BadLine {
    ends: [UdpSocket; 2],
    places: [Option<SocketAddr>; 2],
    under_way: Vec<(Instant, usize, Vec<u8>)>,
    delay: Duration,
    seed: u64,
}

impl BadLine {
    fn new(delay: Duration, seed: u64) -> Self {
        let end = || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        };
        Self { ends: [end(), end()], places: [None, None], under_way: Vec::new(), delay, seed }
    }

    fn dice(&mut self) -> f64 {
        self.seed ^= self.seed << 13;
        self.seed ^= self.seed >> 7;
        self.seed ^= self.seed << 17;
        (self.seed >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Takes in what came, and hands on what is due. Of 100 packets 10 are lost, 10 are late, 10 come twice; one in a
    /// while is nonsense, is changed on the way, or comes back to who sent it.
    fn carry(&mut self) {
        let mut buffer = [0; LONGEST];
        for from in 0..2 {
            while let Ok((n, place)) = self.ends[from].recv_from(&mut buffer) {
                self.places[from] = Some(place);
                let (at, to) = (Instant::now() + self.delay, 1 - from);
                let packet = buffer[..n].to_vec();
                let later = at + Duration::from_secs_f64(0.05 * self.dice());
                match (100.0 * self.dice()) as u32 {
                    0..10 => {}
                    10..20 => self.under_way.push((later, to, packet)),
                    20..30 => self.under_way.extend([(at, to, packet.clone()), (later, to, packet)]),
                    30 => self.under_way.push((at, to, b"nonsense".to_vec())),
                    31 => self.under_way.push((at, from, packet)),
                    32 => self.under_way.push((at, to, forged(&packet, |w| w.wave[0] = f64::NAN))),
                    33 => self.under_way.push((at, to, forged(&packet, |w| w.wave[0] = f64::INFINITY))),
                    34 => self.under_way.push((at, to, forged(&packet, |w| w.wave[0] = 1e300))),
                    35 => self.under_way.push((at, to, forged(&packet, |w| w.impedance[0] = 1.0))),
                    36 => self.under_way.push((at, to, forged(&packet, |w| w.session -= 1))),
                    37 => self.under_way.push((at, to, packet[..n - 1].to_vec())),
                    _ => self.under_way.push((at, to, packet)),
                }
            }
        }
        let now = Instant::now();
        for (_, to, packet) in self.under_way.extract_if(.., |p| p.0 <= now) {
            if let Some(place) = self.places[to] {
                let _ = self.ends[to].send_to(&packet, place);
            }
        }
    }
}

/// A packet that somebody changed who knows the checksum.
fn forged(packet: &[u8], change: fn(&mut Waves)) -> Vec<u8> {
    let mut waves = Waves::read(packet).unwrap();
    change(&mut waves);
    let mut buffer = [0; LONGEST];
    let n = waves.write(&mut buffer);
    buffer[..n].to_vec()
}

#[test]
fn a_teleoperator_of_two_processes_is_passive_over_a_bad_line() {
    for (k, delay, seed) in [("10 N/m", 10, 1), ("1e6 N/m", 10, 2), ("4000 N/m", 200, 3)] {
        let mut line = BadLine::new(Duration::from_millis(delay), seed);
        let [near, far] = [0, 1].map(|i| line.ends[i].local_addr().unwrap().to_string());
        let here = folder();
        let common = ["--duration", "2.5s", "--report", "json", "--udp", "127.0.0.1:0"];
        let master = [&["serve", "master.bond", "--peer", &near, "--ledger", "m.csv"][..], &common].concat();
        let set = format!("k={k}");
        let slave =
            [&["serve", "slave.bond", "--peer", &far, "--set", &set, "--ledger", "s.csv"][..], &common].concat();
        let mut children = [here.spawn(&master), here.spawn(&slave)];
        let mut errs = Vec::new();
        for (i, child) in children.iter_mut().enumerate() {
            let (at, err) = place(child);
            line.places[i] = Some(at);
            errs.push(err);
        }
        let start = Instant::now();
        while children.iter_mut().any(|c| c.try_wait().unwrap().is_none()) && start.elapsed() < Duration::from_secs(60)
        {
            line.carry();
            std::thread::sleep(Duration::from_micros(200));
        }
        let [master, slave] = children.map(report);
        let mut on_the_way = 0.0;
        for (from, to) in [(&master, &slave), (&slave, &master)] {
            assert_eq!((&to["passive"], &to["programs"]), (&true.into(), &1.into()), "{to:#}");
            for told in ["heard", "missing", "stale", "refused"] {
                assert!(number(to, &format!("/{told}")) > 0.0, "{told}: {to:#}");
            }
            let [received, waiting, lost] =
                ["received", "waiting", "lost"].map(|x| number(to, &format!("/waves/0/{x}")));
            let sent = number(from, "/waves/0/sent");
            assert!(received > 0.0 && lost > 0.0, "{to:#}");
            let rest = sent - received - waiting;
            // What the last packets told may not have come.
            assert!(rest >= lost - 1e-12 * sent && lost >= 0.0, "{from:#} {to:#}");
            on_the_way += sent - received;
        }
        // Of each program: H is what it was, and what was supplied and holds added, less what was dissipated.
        let balance = |json: &Value| {
            let [before, after, supplied, dissipated, leaked] =
                ["H_initial", "H_final", "supplied", "dissipated", "leaked"].map(|what| of_regions(json, what));
            let turned = supplied.abs() + dissipated + number(json, "/waves/0/sent");
            assert!((before + supplied - dissipated + leaked - after).abs() < 1e-9 * turned, "{json:#}");
            after
        };
        assert!(balance(&master) + balance(&slave) >= 0.0 && on_the_way >= 0.0);
        // At each instant of the ledgers, what had come in is no more than all that was sent by then.
        let rows = |name: &str| -> Vec<Vec<f64>> {
            let text = here.read(name);
            assert!(
                text.starts_with("t,missing,waiting,sent,received,lost,link.out,link.in\n0,0,0,0,0,0,0,0\n"),
                "{text}"
            );
            text.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
        };
        let [m, s] = ["m.csv", "s.csv"].map(rows);
        for (from, to) in [(&m, &s), (&s, &m)] {
            let all = from.last().unwrap()[3];
            assert!(to.iter().all(|r| r[4] + r[2] <= all * (1.0 + 1e-12)));
            let (mut sent, mut received) = (0.0, 0.0);
            for pair in to.windows(2) {
                // What came in over an interval is booked at its end.
                received += 0.25 * 2e-3 / 20.0 * pair[0][7] * pair[0][7];
                sent += 0.25 * 2e-3 / 20.0 * pair[1][6] * pair[1][6];
                assert!((pair[1][4] - received).abs() <= 1e-12 * (1.0 + received));
                assert!((pair[1][3] - sent).abs() <= 1e-12 * (1.0 + sent));
            }
        }
    }
}

/// Without a clock, and over a line that loses nothing, both together are one scene with a line of two periods.
#[test]
fn two_programs_in_lockstep_are_one_scene() {
    let here = folder();
    let common = ["--lockstep", "--duration", "2s", "--report", "json", "--udp", "127.0.0.1:0"];
    let mut slave = here.spawn(&[&["serve", "slave.bond"][..], &common].concat());
    let (at, _err) = place(&mut slave);
    let at = at.to_string();
    let master = here.spawn(&[&["serve", "master.bond", "--peer", &at][..], &common].concat());
    let [master, slave] = [report(master), report(slave)];
    let whole = here.fed(&["run", "whole.bond", "--stop", "2s", "--summary", "json"], "");
    let whole: Value = serde_json::from_str(&whole.out).unwrap_or_else(|e| panic!("{e}: {}", whole.out));
    let find = |json: &Value, name: &str| {
        let list = json["regions"].as_array().unwrap();
        list.iter().find(|r| r["name"] == name).unwrap_or_else(|| panic!("{name}: {json:#}")).clone()
    };
    for (program, name) in [(&master, "v"), (&slave, "w")] {
        assert_eq!((&program["intervals"], &program["passive"]), (&1000.into(), &true.into()), "{program:#}");
        let (one, other) = (find(program, name), find(&whole, name));
        for what in ["H_final", "dissipated"] {
            let [found, wanted] = [&one, &other].map(|r| r[what].as_f64().unwrap());
            assert!((found - wanted).abs() <= 1e-12 * wanted.abs(), "{name} {what}: {found} {wanted}");
        }
    }
}

/// Sealed packets count, and no others.
#[test]
fn waves_are_sealed() {
    let here = folder().with("a.key", "ab".repeat(32)).with("b.key", "cd".repeat(32));
    let common = ["--lockstep", "--duration", "0.2s", "--report", "json", "--udp", "127.0.0.1:0", "--key-file"];
    let serve = |more: &[&str], key: &str| here.spawn(&[&["serve"][..], more, &common, &[key]].concat());
    let mut slave = serve(&["slave.bond"], "a.key");
    let (at, _err) = place(&mut slave);
    let at = at.to_string();
    // Who has another key is not heard, also not with the right packets.
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut buffer = [0; LONGEST];
    let waves = Waves { session: u64::MAX, period: 2e-3, ports: 1, ..Waves::default() };
    let n = waves.write(&mut buffer);
    for _ in 0..10 {
        stranger.send_to(&buffer[..n], &at).unwrap();
    }
    let master = serve(&["master.bond", "--peer", &at], "a.key");
    let [master, slave] = [report(master), report(slave)];
    assert_eq!((&slave["intervals"], &slave["refused"]), (&100.into(), &10.into()), "{slave:#}");
    assert_eq!((&master["intervals"], &master["passive"]), (&100.into(), &true.into()), "{master:#}");
}

#[test]
fn what_does_not_fit_is_told() {
    let here = folder()
        .with("soft.bond", SLAVE.replace("impedance = 20", "impedance = 2"))
        .with("fast.bond", SLAVE.replace("500 Hz", "1 kHz"));
    let fails = |args: &[&str], status: i32, why: &str| {
        here.fed(&[&["serve"], args].concat(), "").is(status, &[], &[why]);
    };
    fails(&["master.bond", "--stdio"], 2, "`link` carries waves, which go over --udp only");
    fails(&["master.bond", "--udp", "0.0.0.0:0"], 2, "can be reached from other machines");
    fails(&["master.bond", "--udp", "127.0.0.1:0", "--duration", "0.1s"], 0, "");
    for (other, why) in [
        ("soft.bond", "at `link` the other program has an impedance of 20, and this one 2 N*s/m"),
        ("fast.bond", "the other program has a period of 0.002 s, and this one 0.001 s"),
    ] {
        let common = ["--duration", "0.3s", "--report", "json", "--udp", "127.0.0.1:0"];
        let mut one = here.spawn(&[&["serve", other][..], &common].concat());
        let (at, _err) = place(&mut one);
        let at = at.to_string();
        let two = here.spawn(&[&["serve", "master.bond", "--peer", &at][..], &common].concat());
        let [one, _] = [report(one), report(two)];
        assert_eq!((&one["misfit"], &one["intervals"]), (&why.into(), &0.into()), "{one:#}");
    }
    here.fed(&["build", "master.bond", "--emit", "c", "-o", "out.c"], "").is(
        1,
        &[],
        &["the port `link` carries waves"],
    );
}
