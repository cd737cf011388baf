//! What a flood of datagrams costs a scene that is served at 1 kHz.
//!
//! `cargo bench -p bond --bench flood` serves `models/examples/open_port.bond` to a device, for ten seconds each:
//! without a flood, and with 20 000 datagrams a second of strangers, where the device is known by its place and by a
//! key. It prints the missed deadlines. `-- --rate N` takes another rate, `-- --bond FILE` another executable.

use bond::exchange::{Device, DeviceSeal, Effort, Key, LONGEST, LONGEST_SEALED, Measurement};
use serde_json::Value;
use std::io::{BufRead, BufReader, Error, Result};
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How long each is served, s.
const SECONDS: u64 = 10;
/// Datagrams that are sent without a pause.
const BURST: u64 = 20;

/// Speaks as a device until the end: nothing moves, which costs the environment the same.
fn device(socket: &UdpSocket, to: &str, mut seal: Option<DeviceSeal>, over: &AtomicBool) {
    let (mut device, start) = (Device::new(1), Instant::now());
    let (mut packet, mut buffer) = ([0; LONGEST], [0; LONGEST_SEALED]);
    while !over.load(Ordering::Relaxed) {
        let came = socket.recv_from(&mut buffer).map(|(n, _)| n);
        let now = start.elapsed().as_secs_f64();
        if let Ok(n) = came {
            let opened = match &mut seal {
                Some(seal) => seal.open(&buffer[..n]),
                None => Some(&buffer[..n]),
            };
            opened.and_then(Effort::read).map(|e| device.receive(&e, now));
        }
        let n = device.measurement(now).write(&mut packet);
        let bytes = match &mut seal {
            Some(seal) => {
                let n = seal.seal(&packet[..n], &mut buffer);
                &buffer[..n]
            }
            None => &packet[..n],
        };
        // What is lost is the line's affair.
        let _ = socket.send_to(bytes, to);
    }
}

/// Sends what a stranger can, at a rate, until the end: nonsense, requests, and well-formed packets with a wrong key.
fn flood(to: &str, rate: u64, over: &AtomicBool, sent: &AtomicU64) -> Result<()> {
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    let key = Key::read(&[7; 32]).map_err(Error::other)?;
    let (mut packet, mut sealed) = ([0; LONGEST], [0; LONGEST_SEALED]);
    let n = Measurement { ports: 1, ..Measurement::default() }.write(&mut packet);
    let m = DeviceSeal::new(key, 1).seal(&packet[..n], &mut sealed);
    let kinds: [&[u8]; 3] = [b"nonsense", &packet[..n], &sealed[..m]];
    let start = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let done = sent.load(Ordering::Relaxed);
        let due = Duration::from_secs_f64(done as f64 / rate as f64);
        std::thread::sleep(due.saturating_sub(start.elapsed()));
        for k in 0..BURST {
            let _ = socket.send_to(kinds[((done + k) % 3) as usize], to);
        }
        sent.fetch_add(BURST, Ordering::Relaxed);
    }
    Ok(())
}

/// Serves once: a row of the table.
fn serve(bond: &str, name: &str, rate: u64, keyed: bool) -> Result<String> {
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/examples/open_port.bond");
    let digits = "5a".repeat(32);
    let file = tempfile::NamedTempFile::new()?;
    std::fs::write(file.path(), &digits)?;
    let mut command = Command::new(bond);
    command.args(["serve", scene, "--udp", "127.0.0.1:0", "--report", "json", "--duration", &format!("{SECONDS}s")]);
    if keyed {
        command.arg("--key-file").arg(file.path());
    }
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let mut line = String::new();
    let mut words = BufReader::new(child.stderr.take().ok_or_else(|| Error::other("no standard error"))?);
    words.read_line(&mut line)?;
    let to = line.trim().rsplit(' ').next().unwrap_or_default();
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    socket.set_read_timeout(Some(Duration::from_millis(1)))?;
    let key = Key::read(digits.as_bytes()).map_err(Error::other)?;
    let (over, sent) = (AtomicBool::new(false), AtomicU64::new(0));
    let output = std::thread::scope(|threads| {
        threads.spawn(|| device(&socket, to, keyed.then(|| DeviceSeal::new(key, 1)), &over));
        if rate > 0 {
            threads.spawn(|| flood(to, rate, &over, &sent));
        }
        let output = child.wait_with_output();
        over.store(true, Ordering::Relaxed);
        output
    })?;
    let json: Value = serde_json::from_slice(&output.stdout)?;
    let [jitter, answer] = ["jitter", "answer"].map(|of| format!("{} | {}", json[of]["p99_us"], json[of]["max_us"]));
    Ok(format!(
        "| {name} | {} | {} | {} | {} | {} | {} | {jitter} | {answer} |",
        sent.load(Ordering::Relaxed),
        json["refused"],
        json["intervals"],
        json["missed_deadlines"],
        json["missed_by_own_computing"],
        json["missing"],
    ))
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let option = |name: &str| arguments.iter().position(|a| a == name).and_then(|i| arguments.get(i + 1));
    let rate = option("--rate").and_then(|n| n.parse().ok()).unwrap_or(20_000);
    let bond = option("--bond").map_or(env!("CARGO_BIN_EXE_bond"), String::as_str);
    println!(
        "| | sent | refused | intervals | missed | by own computing | missing | jitter 99 %, us | worst | answer 99 %, us | \
         worst |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for (name, rate, keyed) in
        [("quiet", 0, false), ("quiet, with a key", 0, true), ("flood", rate, false), ("flood, with a key", rate, true)]
    {
        println!("{}", serve(bond, name, rate, keyed)?);
    }
    Ok(())
}
