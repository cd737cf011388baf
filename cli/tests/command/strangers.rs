//! Who may speak: strangers on the line, keys and addresses, devices that come and go.

use super::Folder;
use super::serve::{Pushed, SPRING, first};
use bond::exchange::{Device, DeviceSeal, Effort, Key, LONGEST, LONGEST_SEALED, Measurement};
use serde_json::Value;
use std::net::UdpSocket;
use std::process::{Child, Command};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const KEY: &str = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";
/// Whatever is waited for has come long before, or never comes.
const PATIENCE: Duration = Duration::from_secs(60);
/// What the spring of the scene holds at the start, J.
const STORED: f64 = 0.08;

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    socket
}

fn key(text: &str) -> Key {
    Key::read(text.as_bytes()).unwrap()
}

/// A seal of a device that starts now.
fn seal(text: &str) -> DeviceSeal {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    DeviceSeal::new(key(text), now.as_nanos() as u64)
}

/// A pushed mass with a line.
struct Client {
    socket: UdpSocket,
    to: String,
    seal: Option<DeviceSeal>,
    pushed: Pushed,
    start: Instant,
    last: f64,
    /// Efforts that it took, and what it sent.
    efforts: usize,
    sent: Vec<Vec<u8>>,
}

impl Client {
    fn new(socket: UdpSocket, to: &str, seal: Option<DeviceSeal>) -> Self {
        let (pushed, start, sent) = (Pushed::new(), Instant::now(), vec![]);
        Self { socket, to: to.into(), seal, pushed, start, last: 0.0, efforts: 0, sent }
    }

    /// Listens, moves, and tells.
    fn step(&mut self) {
        let mut buffer = [0; LONGEST_SEALED];
        let now = self.start.elapsed().as_secs_f64();
        if let Ok((n, _)) = self.socket.recv_from(&mut buffer) {
            let packet = match &mut self.seal {
                Some(seal) => seal.open(&buffer[..n]),
                None => Some(&buffer[..n]),
            };
            if let Some(effort) = packet.and_then(Effort::read) {
                self.efforts += usize::from(self.pushed.device.receive(&effort, now));
            }
        }
        self.pushed.step(now, (now - self.last).min(0.01));
        self.last = now;
        let mut packet = [0; LONGEST];
        let n = self.pushed.device.measurement(now).write(&mut packet);
        let bytes = match &mut self.seal {
            Some(seal) => {
                let n = seal.seal(&packet[..n], &mut buffer);
                buffer[..n].to_vec()
            }
            None => packet[..n].to_vec(),
        };
        self.socket.send_to(&bytes, &self.to).unwrap();
        self.sent.push(bytes);
    }

    /// Steps until it has taken so many efforts more.
    fn take(&mut self, efforts: usize, mut beside: impl FnMut(&Self)) {
        let (wanted, begun) = (self.efforts + efforts, Instant::now());
        while self.efforts < wanted {
            assert!(begun.elapsed() < PATIENCE, "it took {} efforts of {wanted}", self.efforts);
            self.step();
            beside(self);
        }
    }

    /// Its own count of what it drew cannot exceed what there was.
    fn drew_what_there_was(&self) {
        let least = -STORED - 1e-12 * self.pushed.turned;
        assert!(self.pushed.lowest >= least, "{} J were drawn", -self.pushed.lowest);
    }
}

/// A scene that is served, and where.
fn served(here: &Folder, options: &[&str]) -> (Child, String) {
    let mut child = here.spawn(&[&["serve", "a.bond", "--report", "json"], options].concat());
    let (line, _) = first(&mut child);
    let address = line.trim().rsplit(' ').next().unwrap_or_default().to_string();
    (child, address)
}

/// Asks it to end: its report.
fn ended(child: Child) -> Value {
    let asked = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(asked.success());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What strangers say: nonsense, that they are here, and what the device itself might say, of any energy.
fn say_much(stranger: &UdpSocket, to: &str, session: u64) -> u64 {
    let mut packet = [0; LONGEST];
    let mut said = 0;
    let mut say = |bytes: &[u8]| {
        stranger.send_to(bytes, to).unwrap();
        said += 1;
    };
    say(b"nonsense");
    for (session, sequence) in [(0, 0), (session, 1), (session, u64::MAX / 2)] {
        let mut m = Measurement { session, sequence, ports: 1, ..Measurement::default() };
        (m.q[0], m.w[0]) = (-1.0, -1e6);
        let n = m.write(&mut packet);
        say(&packet[..n]);
        // Sealed, with another key.
        let mut sealed = [0; LONGEST_SEALED];
        let n = seal(&"f".repeat(64)).seal(&packet[..n], &mut sealed);
        say(&sealed[..n]);
    }
    said
}

#[cfg(unix)]
#[test]
fn strangers_change_nothing_for_who_has_the_key_or_the_address() {
    let here = Folder::new().with("a.bond", SPRING).with("key", KEY);
    for keyed in [true, false] {
        let own = socket();
        let place = own.local_addr().unwrap().to_string();
        let who = if keyed { ["--key-file", "key"] } else { ["--peer", &place] };
        let (child, to) = served(&here, &[&["--udp", "127.0.0.1:0"], &who[..]].concat());
        let stranger = socket();
        let mut said = (0..20).map(|_| say_much(&stranger, &to, 1)).sum::<u64>();
        let mut client = Client::new(own, &to, keyed.then(|| seal(KEY)));
        client.take(100, |_| {});
        client.take(100, |c| said += say_much(&stranger, &to, c.pushed.device.session()));
        client.take(100, |_| {});
        // Whatever strangers said, none of it was answered.
        assert!(stranger.recv_from(&mut [0; LONGEST]).is_err());
        let json = ended(child);
        assert_eq!((&json["devices"], &json["passive"]), (&1.into(), &true.into()), "{json:#}");
        assert!(json["refused"].as_u64().unwrap() > 0 && said > 500, "{json:#}");
        assert!(json["energy"]["given_out"].as_f64().unwrap() < 1e3, "{json:#}");
        client.drew_what_there_was();
    }
}

/// Without a key, on this machine alone, whoever joins is the device; that somebody asked and went keeps nobody out.
#[cfg(unix)]
#[test]
fn who_only_says_that_it_is_there_keeps_nobody_out() {
    let here = Folder::new().with("a.bond", SPRING);
    let (child, to) = served(&here, &["--udp", "127.0.0.1:0"]);
    let stranger = socket();
    let mut packet = [0; LONGEST];
    let n = Device::new(1).measurement(0.0).write(&mut packet);
    stranger.send_to(&packet[..n], &to).unwrap();
    let mut client = Client::new(socket(), &to, None);
    client.take(50, |_| {});
    let json = ended(child);
    assert_eq!((&json["devices"], &json["passive"]), (&1.into(), &true.into()), "{json:#}");
}

#[cfg(unix)]
#[test]
fn replays_are_refused_by_their_number() {
    let here = Folder::new().with("a.bond", SPRING).with("key", KEY);
    let (child, to) = served(&here, &["--udp", "127.0.0.1:0", "--key-file", "key"]);
    let mut client = Client::new(socket(), &to, Some(seal(KEY)));
    client.take(50, |_| {});
    // From elsewhere and from the device's own place, while it goes on.
    let (stranger, recorded) = (socket(), client.sent.clone());
    for bytes in &recorded {
        stranger.send_to(bytes, &to).unwrap();
        client.socket.send_to(bytes, &to).unwrap();
        client.step();
    }
    client.take(50, |_| {});
    let json = ended(child);
    // They came, and none came so far that it was looked into.
    assert!(json["refused"].as_u64().unwrap() > 0, "{json:#}");
    assert_eq!((&json["doubled"], &json["overtaken"], &json["devices"]), (&0.into(), &0.into(), &1.into()));
    client.drew_what_there_was();
    // In another run, what was recorded makes no device: it names no session that this run offered.
    let (child, to) = served(&here, &["--udp", "127.0.0.1:0", "--key-file", "key"]);
    recorded.iter().for_each(|bytes| assert!(stranger.send_to(bytes, &to).is_ok()));
    let mut client = Client::new(socket(), &to, Some(seal(KEY)));
    client.take(50, |_| {});
    assert_eq!(ended(child)["devices"], 1);
}

#[test]
fn another_key_is_no_key() {
    let here = Folder::new().with("a.bond", SPRING).with("key", KEY);
    let (mut child, to) = served(&here, &["--udp", "127.0.0.1:0", "--key-file", "key", "--duration", "0.5s"]);
    let mut clients = [Some(seal(&"1".repeat(64))), None].map(|seal| Client::new(socket(), &to, seal));
    while child.try_wait().unwrap().is_none() {
        clients.iter_mut().for_each(Client::step);
    }
    assert!(clients.iter().all(|c| c.efforts == 0));
    let json: Value = serde_json::from_slice(&child.wait_with_output().unwrap().stdout).unwrap();
    assert_eq!((&json["devices"], &json["intervals"]), (&0.into(), &0.into()), "{json:#}");
    assert!(json["refused"].as_u64().unwrap() > 0, "{json:#}");
}

/// A device that falls silent has left. Another one joins, from elsewhere or as the same one that starts anew. From
/// elsewhere, the two draw no more than there was.
#[cfg(unix)]
#[test]
fn a_device_that_falls_silent_makes_room() {
    let here = Folder::new().with("a.bond", SPRING).with("key", KEY);
    for (keyed, elsewhere) in [(false, true), (false, false), (true, true)] {
        let who: &[&str] = if keyed { &["--key-file", "key"] } else { &[] };
        let (child, to) = served(&here, &[&["--udp", "127.0.0.1:0"], who].concat());
        let mut old = Client::new(socket(), &to, keyed.then(|| seal(KEY)));
        old.take(100, |_| {});
        // As long as it speaks, nobody else joins.
        let mut other = Client::new(socket(), &to, keyed.then(|| seal(KEY)));
        old.take(100, |_| other.step());
        assert_eq!(other.efforts, 0);
        let line = if elsewhere { other.socket } else { old.socket.try_clone().unwrap() };
        let mut new = Client::new(line, &to, keyed.then(|| seal(KEY)));
        let begun = Instant::now();
        // One in the old one's place takes the old session's efforts at first; what it says there is refused.
        while [0, old.pushed.device.session()].contains(&new.pushed.device.session()) {
            assert!(begun.elapsed() < PATIENCE, "no session is offered");
            new.step();
        }
        new.take(100, |_| {});
        let json = ended(child);
        assert_eq!((&json["devices"], &json["passive"]), (&2.into(), &true.into()), "{json:#}");
        let turned = old.pushed.turned + new.pushed.turned;
        let drawn = -old.pushed.own - new.pushed.lowest;
        let bounded = !elsewhere || drawn <= STORED + 1e-12 * turned;
        assert!(bounded && turned > 1e-3, "{drawn} J were drawn: {json:#}");
    }
}

/// A line that was cut for more than a second, and nobody else came: it goes on as before.
#[cfg(unix)]
#[test]
fn the_same_device_goes_on_after_a_silence() {
    let here = Folder::new().with("a.bond", SPRING);
    let (child, to) = served(&here, &["--udp", "127.0.0.1:0"]);
    let mut client = Client::new(socket(), &to, None);
    client.take(50, |_| {});
    let session = client.pushed.device.session();
    std::thread::sleep(Duration::from_millis(1200));
    client.take(50, |_| {});
    assert_eq!(client.pushed.device.session(), session);
    let json = ended(child);
    assert_eq!((&json["devices"], &json["passive"]), (&1.into(), &true.into()), "{json:#}");
    assert_eq!(json["energy"]["untold"], 0.0);
}

/// A new device at the shared file, too; and the file is nobody else's.
#[cfg(unix)]
#[test]
fn a_shared_file_changes_hands() {
    use std::os::unix::fs::{FileExt, PermissionsExt};
    let here = Folder::new().with("a.bond", SPRING);
    let (child, _) = served(&here, &["--shm", "./line"]);
    let file = std::fs::OpenOptions::new().read(true).write(true).open(here.0.join("line")).unwrap();
    assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let (start, mut sessions) = (Instant::now(), vec![]);
    for _ in 0..2 {
        let (mut device, mut buffer, mut taken) = (Device::new(1), [0; LONGEST], 0);
        let last = sessions.last().copied().unwrap_or(0);
        while taken < 50 {
            assert!(start.elapsed() < PATIENCE, "it took {taken} efforts");
            let now = start.elapsed().as_secs_f64();
            let n = bond::exchange::effort_length(1);
            file.read_exact_at(&mut buffer[..n], 0).unwrap();
            let new = Effort::read(&buffer[..n]).is_some_and(|e| device.receive(&e, now));
            device.moved(&[1e-6], &[device.effort(0, now)]);
            let m = device.measurement(now);
            taken += usize::from(new && m.session > last);
            let n = m.write(&mut buffer);
            file.write_all_at(&buffer[..n], 4096).unwrap();
            std::thread::sleep(Duration::from_millis(1));
        }
        sessions.push(device.session());
    }
    let json = ended(child);
    assert_eq!((&json["devices"], &json["passive"]), (&2.into(), &true.into()), "{json:#}");
}

/// Whether or not somebody came.
#[test]
fn the_duration_ends_without_a_device() {
    let here = Folder::new().with("a.bond", SPRING);
    for line in [&["--udp", "127.0.0.1:0"][..], &["--shm", "./line"], &["--stdio"], &["--stdio", "--binary"]] {
        let args = [&["serve", "a.bond", "--duration", "0.1s"], line].concat();
        // Its standard input stays open until it has ended.
        let mut child = here.spawn(&args);
        let begun = Instant::now();
        while child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "{line:?} goes on");
            std::thread::sleep(Duration::from_millis(5));
        }
        let output = child.wait_with_output().unwrap();
        let told = [output.stdout, output.stderr].concat();
        assert!(output.status.success() && String::from_utf8_lossy(&told).contains("intervals   0 of"), "{line:?}");
    }
}

#[test]
fn what_others_can_reach_asks_for_a_key_or_an_address() {
    let here =
        Folder::new().with("a.bond", SPRING).with("short", "0011").with("wrong", "x".repeat(64)).with("key", KEY);
    let serve = |args: &[&str]| here.bond(&[&["serve", "a.bond", "--duration", "0.1s"], args].concat());
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:7000"] {
        let ways = ["--key-file FILE", "--peer ADDRESS", "--udp 127.0.0.1:"];
        serve(&["--udp", address]).is(2, &[], &ways);
    }
    serve(&["--udp", "0.0.0.0:0", "--key-file", "key"]).is(0, &["intervals   0 of"], &[]);
    serve(&["--udp", "0.0.0.0:0", "--peer", "192.0.2.2"]).is(0, &["intervals   0 of"], &[]);
    for (file, why) in [
        ("none", "cannot read none: there is no such file"),
        ("short", "short is no key: it holds 4 bytes, and a key is 32 bytes or 64 hexadecimal digits"),
        ("wrong", "wrong is no key: of its 64 characters, number 1 is no hexadecimal digit"),
    ] {
        serve(&["--udp", "127.0.0.1:0", "--key-file", file]).is(2, &[], &[why]);
    }
    serve(&["--stdio", "--key-file", "key"]).is(2, &[], &["--key-file is for --udp only"]);
    serve(&["--udp", "127.0.0.1:0", "--key-file", "key", "--ledger", "key"]).is(2, &[], &["it is the key itself"]);
    assert_eq!(here.read("key"), KEY);
}
