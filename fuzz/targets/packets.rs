//! What comes over the line of `bond serve`: packets, plain and sealed, in any order, from devices and from strangers.
//!
//! Where devices keep the rules, whatever the line does, they draw no more energy than there was and than they put in,
//! and none is said to have drawn too much. Where anybody writes packets with the right checksum, what the environment
//! holds stays finite. What is read is written as it was, and only a key opens what it sealed.
//!
//! Two programs that exchange waves let in no more than was sent, also where somebody writes packets beside them.
#![no_main]

use bond::exchange::{
    Device, DeviceSeal, EFFORT, Effort, Exchange, Heard, Key, LONGEST, LONGEST_SEALED, MEASUREMENT, Measurement,
    OFFERS, PORTS, Sealed, WAVES, WaveExchange, Waves, crc,
};
use bond::{Compiled, Steps};
use bond_fuzz::feed::Feed;
use bond_fuzz::{scenes, seeds};
use bond_runtime::ledger::Sum;
use libfuzzer_sys::fuzz_target;
use std::sync::OnceLock;

/// The session of the first device.
const SESSION: u64 = 5;
/// Intervals for which an effort is held without a newer one.
const HOLD: u32 = 3;
/// Packets that the line keeps; it may give any of them at any time.
const KEPT: usize = 16;
/// Choices that are taken from one input.
const CHOICES: usize = 400;
/// The part of the energies there that is rounding.
const ROUNDING: f64 = 1e-12;
/// The part of the energies there that counts as none drawn past a limit.
const OVERDRAWN: f64 = 1e-11;
/// The farthest that a device moves at once.
const FARTHEST: f64 = 0.02;

fn scene(feed: &mut Feed<'_>) -> Option<&'static Compiled> {
    static SCENES: OnceLock<Vec<Compiled>> = OnceLock::new();
    let texts = [scenes::TWO, scenes::STEERED, scenes::WALL];
    feed.one(SCENES.get_or_init(|| texts.iter().map(|text| scenes::compiled(text)).collect()))
}

fn exchange(compiled: &Compiled) -> Exchange<'_> {
    Exchange::new(compiled, Steps::new(), SESSION, HOLD).unwrap_or_else(|e| panic!("{e}"))
}

/// What is kept of a line, the newest last.
fn keep<T>(line: &mut Vec<T>, packet: T) {
    if line.len() == KEPT {
        line.remove(0);
    }
    line.push(packet);
}

/// Receives as `bond serve` does: a device joins where none is there.
fn receive(exchange: &mut Exchange<'_>, m: &Measurement, is_vacant: bool) -> bool {
    let joins = is_vacant && m.session > exchange.effort().session;
    let heard = if joins { exchange.join(m) } else { exchange.hear(m) };
    heard == Heard::New
}

/// A line between devices that keep the rules, one after the other, and a scene.
struct Line<'a> {
    exchange: Exchange<'a>,
    device: Device,
    /// How many devices there were, and which of them the efforts go to; 0 before the first one joins.
    life: u64,
    place: u64,
    /// Whether the device that had joined has left.
    has_left: bool,
    out: Vec<(u64, Effort)>,
    back: Vec<(u64, Measurement)>,
    now: f64,
    initial: f64,
    put_in: f64,
    own: Sum,
}

impl<'a> Line<'a> {
    fn new(compiled: &'a Compiled) -> Self {
        let exchange = exchange(compiled);
        Self {
            device: Device::new(0),
            life: 0,
            place: 0,
            has_left: true,
            out: Vec::new(),
            back: Vec::new(),
            now: 0.0,
            initial: exchange.effort().stored,
            put_in: 0.0,
            own: Sum::new(),
            exchange,
        }
    }

    fn moves(&mut self, feed: &mut Feed<'_>) {
        let ports = self.exchange.effort().ports;
        let mut dq = [0.0; PORTS];
        dq.iter_mut().take(ports).for_each(|x| *x = FARTHEST * feed.swing());
        let (device, now) = (&self.device, self.now);
        let mut efforts = [0.0; PORTS];
        for i in 0..ports {
            efforts[i] = device.part(i, &dq[..ports], now) * device.effort(i, now);
        }
        let energy: f64 = (0..ports).map(|i| efforts[i] * dq[i]).sum();
        self.device.moved(&dq[..ports], &efforts[..ports]);
        self.own.add(energy);
        self.put_in += energy.max(0.0);
        let drawn = -self.own.value() - self.initial;
        assert!(drawn <= ROUNDING * self.scale(), "the device drew {drawn} J more than there was");
    }

    fn scale(&self) -> f64 {
        self.initial + self.put_in
    }

    /// One device leaves, and another comes that is offered a session.
    fn change(&mut self) {
        self.life += 1;
        self.has_left = true;
        let offer = self.exchange.offer();
        self.device = Device::new(offer.ports);
        self.device.receive(&Effort { session: offer.session | (self.life % OFFERS), ..offer }, self.now);
    }

    fn goes_on(&mut self, feed: &mut Feed<'_>) {
        let period = self.exchange.period();
        match feed.byte() % 8 {
            0 | 1 => {
                self.exchange.tick().unwrap_or_else(|e| panic!("{e}"));
                // Who has not joined hears of no effort.
                keep(&mut self.out, (self.place, *self.exchange.effort()));
                self.now += period;
            }
            2 => {
                let came = feed.one(&self.out).copied();
                if let Some((_, effort)) = came.filter(|(to, _)| *to == self.life) {
                    self.device.receive(&effort, self.now);
                }
            }
            3 => {
                let measurement = self.device.measurement(self.now);
                keep(&mut self.back, (self.life, measurement));
            }
            4 => {
                let is_vacant = !self.exchange.is_joined() || self.has_left;
                let came = feed.one(&self.back).copied();
                if let Some((from, measurement)) = came
                    && receive(&mut self.exchange, &measurement, is_vacant)
                {
                    self.place = from;
                    self.has_left &= from != self.life;
                }
            }
            5 | 6 => self.moves(feed),
            _ if feed.byte() % 16 == 0 => self.change(),
            _ => self.now += period * f64::from(feed.byte()) / 64.0,
        }
    }
}

/// Devices that keep the rules over a line that keeps none.
fn devices(feed: &mut Feed<'_>) {
    let Some(compiled) = scene(feed) else { return };
    let mut line = Line::new(compiled);
    line.change();
    for _ in 0..CHOICES {
        if feed.is_over() {
            break;
        }
        line.goes_on(feed);
    }
    let count = *line.exchange.count();
    assert!(count.overdrawn <= OVERDRAWN * line.scale(), "{count:?}");
    let summary = line.exchange.summary();
    let debt = summary.regions.iter().map(|r| r.debt_max).fold(0.0, f64::max);
    assert!(debt <= ROUNDING * line.scale(), "{:?}: {count:?}", summary.reasons);
    // What is rounding to the device may be all that the environment sees, which then says so.
    assert!(summary.reasons.is_empty() || debt.max(count.overdrawn) > 0.0, "{:?}: {count:?}", summary.reasons);
}

/// Bytes with a mark in front, zeros for what is missing, and the checksum that lets them in.
fn packet(mark: [u8; 4], ports: usize, body: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = [&mark[..], &(ports as u32).to_le_bytes(), body].concat();
    bytes.resize(length - 4, 0);
    let sum = crc(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

/// A measurement that anybody may have written.
fn forged(feed: &mut Feed<'_>, exchange: &Exchange<'_>) -> Measurement {
    let ports = exchange.effort().ports;
    let (offer, effort) = (exchange.offer().session, exchange.effort());
    let mut m = Measurement { ports, ..Measurement::default() };
    m.session = match feed.byte() % 4 {
        0 => feed.word(),
        1 => offer.saturating_add(u64::from(feed.byte())),
        _ => effort.session,
    };
    let near = |x: u64, by: u8| x.saturating_add_signed(i64::from(by as i8));
    (m.sequence, m.echo) = (near(effort.sequence, feed.byte()), near(effort.sequence, feed.byte()));
    if feed.byte() % 16 == 0 {
        (m.sequence, m.echo, m.wait) = (feed.word(), feed.word(), feed.number());
    }
    let is_odd = feed.byte() % 4 == 0;
    for x in m.q.iter_mut().take(ports).chain(m.w.iter_mut().take(ports)) {
        *x = if is_odd { feed.number() } else { feed.swing() };
    }
    m
}

/// Writes and reads a measurement as it goes over the line.
fn over_the_line(m: &Measurement) -> Option<Measurement> {
    let mut buffer = [0; LONGEST];
    let n = m.write(&mut buffer);
    let read = Measurement::read(&buffer[..n]);
    let is_sound = m.q.iter().chain(&m.w).chain([&m.wait]).all(|x| x.is_finite());
    assert_eq!(read, is_sound.then_some(*m));
    assert_eq!(Measurement::session_of(&buffer[..n]), Some(m.session));
    read
}

/// What the environment holds can be held.
fn check(effort: &Effort) {
    assert!(effort.v.iter().all(|v| v.is_finite()), "{effort:?}");
    assert!(!effort.limit.iter().chain([&effort.stored]).any(|x| x.is_nan()), "{effort:?}");
    let mut buffer = [0; LONGEST];
    let n = effort.write(&mut buffer);
    assert_eq!(Effort::read(&buffer[..n]).as_ref(), Some(effort));
}

/// Seals a packet, and opens it again as the environment does; what is changed on the way is not opened.
fn seals(feed: &mut Feed<'_>, packet: &[u8]) {
    let (Ok(key), Ok(other)) = (Key::read(&[7; 32]), Key::read(&[8; 32])) else { return };
    let mut buffer = [0; LONGEST_SEALED];
    let (number, answered) = (feed.word(), feed.word());
    let n = key.seal(number, answered, packet, &mut buffer);
    let Some(sealed) = Sealed::split(&buffer[..n]) else { panic!("what is sealed cannot be taken apart") };
    assert!(key.has_sealed(&sealed) && (sealed.number, sealed.answered) == (number, answered));
    assert!(!other.has_sealed(&sealed), "another key opens it");
    assert_eq!(sealed.packet, &packet[..packet.len().min(LONGEST)]);
    let mut device = DeviceSeal::new(key.clone(), number.wrapping_sub(1));
    let mut own = [0; LONGEST_SEALED];
    device.seal(packet, &mut own);
    let opened = device.open(&buffer[..n]).is_some();
    assert!(!opened || device.open(&buffer[..n]).is_none(), "it is opened twice");
    let (at, by) = (usize::from(feed.byte()) * 7 % n, feed.byte());
    buffer[at] ^= by;
    if let Some(sealed) = Sealed::split(&buffer[..n]) {
        assert_eq!(key.has_sealed(&sealed), by == 0, "what was changed is opened");
    }
}

/// Anybody who knows the layout of packets.
fn strangers(feed: &mut Feed<'_>) {
    let Some(compiled) = scene(feed) else { return };
    let mut exchange = exchange(compiled);
    let ports = exchange.effort().ports;
    let mut device = Device::new(ports);
    let mut now = 0.0;
    for _ in 0..CHOICES {
        if feed.is_over() {
            break;
        }
        match feed.byte() % 8 {
            0 | 1 => {
                // Numbers that overflow may end the run, which is said.
                if exchange.tick().is_err() {
                    break;
                }
                check(exchange.effort());
                now += exchange.period();
            }
            2..=4 => {
                let m = forged(feed, &exchange);
                if let Some(m) = over_the_line(&m) {
                    let is_vacant = feed.byte() % 4 == 0;
                    receive(&mut exchange, &m, is_vacant);
                }
            }
            5 => {
                let length = usize::from(feed.byte());
                let body = feed.bytes(length);
                let bytes = packet(MEASUREMENT, ports, body, bond::exchange::measurement_length(ports));
                if let Some(m) = Measurement::read(&bytes) {
                    receive(&mut exchange, &m, true);
                }
                let (Some(_) | None) = Measurement::read(body);
                seals(feed, body);
            }
            6 => {
                let length = usize::from(feed.byte());
                let body = feed.bytes(length);
                let bytes = packet(EFFORT, ports, body, bond::exchange::effort_length(ports));
                if let Some(effort) = Effort::read(&bytes) {
                    device.receive(&effort, now);
                }
                if let Some(effort) = Effort::read(body) {
                    device.receive(&effort, now);
                }
            }
            _ => {
                let mut dq = [0.0; PORTS];
                dq.iter_mut().take(ports).for_each(|x| *x = feed.swing());
                for i in 0..ports {
                    let part = device.part(i, &dq[..ports], now);
                    assert!((0.0..=1.0).contains(&part), "{part} of {:?}", device.effort(i, now));
                }
            }
        }
    }
    exchange.end();
    check(exchange.effort());
    let summary = exchange.summary();
    assert!(!summary.reasons.iter().any(String::is_empty));
}

/// Two programs that exchange waves over a line that keeps no rules. Where somebody else writes packets, too, that know
/// all sessions, what comes in may be anything, and is counted.
fn programs(feed: &mut Feed<'_>, is_safe: bool) {
    static ENDS: OnceLock<[Compiled; 2]> = OnceLock::new();
    let compiled = ENDS.get_or_init(|| [scenes::NEAR, scenes::FAR].map(scenes::compiled));
    let end = |i: usize| WaveExchange::new(&compiled[i], Steps::new(), SESSION + i as u64, HOLD);
    let mut ends = [0, 1].map(|i| end(i).unwrap_or_else(|e| panic!("{e}")));
    let mut lines: [Vec<Waves>; 2] = [vec![], vec![]];
    for _ in 0..CHOICES {
        if feed.is_over() {
            break;
        }
        let (choice, i) = (feed.byte() % 8, usize::from(feed.byte() % 2));
        match choice {
            0..3 => {
                // Numbers that overflow may end the run, which is said.
                if ends[i].tick().is_err() {
                    assert!(!is_safe);
                    break;
                }
                let packet = *ends[i].waves();
                keep(&mut lines[i], packet);
            }
            3..6 => {
                if let Some(packet) = feed.one(&lines[i]).copied() {
                    ends[1 - i].hear(&packet);
                }
            }
            6 => {
                let packet = *ends[i].waves();
                keep(&mut lines[i], packet);
            }
            _ if is_safe => {}
            _ => {
                let mut packet = *ends[i].waves();
                packet.wave[0] = feed.number();
                packet.sequence = packet.sequence.saturating_add_signed(i64::from(feed.byte() as i8));
                match feed.byte() % 8 {
                    0 => packet.session = feed.word(),
                    1 => packet.answers = feed.word(),
                    2 => packet.sequence = feed.word(),
                    3 => packet.impedance[0] = feed.number(),
                    4 => packet.sent[0] = feed.number(),
                    _ => {}
                }
                let mut buffer = [0; LONGEST];
                let n = packet.write(&mut buffer);
                if let Some(read) = Waves::read(&buffer[..n]) {
                    assert_eq!(read, packet);
                    ends[1 - i].hear(&read);
                }
                let length = usize::from(feed.byte());
                let body = feed.bytes(length);
                if let Some(read) = Waves::read(&self::packet(WAVES, 1, body, bond::exchange::waves_length(1))) {
                    ends[1 - i].hear(&read);
                }
            }
        }
        let [a, b] = [0, 1].map(|i| ends[i].energy(0));
        for (from, to) in [(a, b), (b, a)] {
            let came = to.received + to.waiting;
            assert!(!is_safe || came <= from.sent * (1.0 + ROUNDING), "{came} J came in of {from:?}");
        }
    }
    for end in &ends {
        let summary = end.summary();
        assert!(!is_safe || summary.passive, "{:?}: {:?}", summary.reasons, end.count());
    }
}

fuzz_target!(
    init: {
        let row = |first: u8, step: u8| {
            let choices = (0..200u8).map(move |i| i.wrapping_mul(step) ^ (i >> 2));
            [first, first / 2].into_iter().chain(choices).collect::<Vec<u8>>()
        };
        let list = (0..16).map(|i| (format!("{i}"), row(i, 2 * i + 3)));
        seeds::write("packets", list);
    },
    |data: &[u8]| {
        let mut feed = Feed(data);
        match feed.byte() % 4 {
            0 => devices(&mut feed),
            1 => strangers(&mut feed),
            2 => programs(&mut feed, true),
            _ => programs(&mut feed, false),
        }
    }
);
