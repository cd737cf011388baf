//! Two programs that exchange waves over a bad line: together they are passive, and each of them knows what it gave.

use crate::common::{advance, close, errors, probe, start, text};
use bond::exchange::{END, Heard, LONGEST, Unfit, WaveExchange, Waves};
use bond::{Compiled, Steps};

/// A hand that pushes a handle to and fro, and sends on how it moves.
fn master(z: f64) -> String {
    format!(
        "model Master {{
           Se:hand = 8 N*sin(5 rad/s*t)
           I:handle {{ inertia = 0.5 kg; f0 = 1 m/s }}
           R:arm = 1 N*s/m
           sampled at 1 kHz {{
             port link {{ impedance = {z} N*s/m }}
             1:m -> link
           }}
           hand -> 1:v -> handle, arm
           v ||> m
           probe speed = v.f
           probe stored = handle.H
           probe put_in = integral(hand.e*v.f, 0 J)
         }}"
    )
}

/// A tool between two walls, moved by what comes.
fn slave(k: f64, z: f64) -> String {
    format!(
        "model Slave {{
           I:tool = 0.2 kg
           C:wall {{ stiffness = {k} N/m }}
           sampled at 1 kHz {{
             port link {{ impedance = {z} N*s/m }}
             link -> 1:s
           }}
           1:w -> tool, wall
           w ||> s
           probe speed = w.f
           probe stored = tool.H + wall.H
         }}"
    )
}

/// Both and the line between them, of so many periods.
fn whole(k: f64, z: f64, periods: u32) -> String {
    format!(
        "model Whole {{
           Se:hand = 8 N*sin(5 rad/s*t)
           I:handle {{ inertia = 0.5 kg; f0 = 1 m/s }}
           R:arm = 1 N*s/m
           I:tool = 0.2 kg
           C:wall {{ stiffness = {k} N/m }}
           sampled at 1 kHz {{
             TL(a, b):line {{ impedance = {z} N*s/m; delay = {periods} ms }}
             1:m -> line.a
             line.b -> 1:s
           }}
           hand -> 1:v -> handle, arm
           1:w -> tool, wall
           v ||> m
           w ||> s
           probe near = v.f
           probe far = w.f
         }}"
    )
}

fn exchange(compiled: &Compiled, session: u64, most: u32) -> WaveExchange<'_> {
    WaveExchange::new(compiled, Steps::new(), session, most).unwrap_or_else(|e| panic!("{e}"))
}

/// What comes over a line, each packet at its time.
struct Line {
    under_way: Vec<(u64, Waves)>,
    delay: u64,
    /// The part of the packets that is lost, comes later, or comes twice.
    bad: f64,
    seed: u64,
}

impl Line {
    fn new(delay: u64, bad: f64, seed: u64) -> Self {
        Self { under_way: Vec::new(), delay, bad, seed }
    }

    fn dice(&mut self) -> f64 {
        self.seed ^= self.seed << 13;
        self.seed ^= self.seed >> 7;
        self.seed ^= self.seed << 17;
        (self.seed >> 11) as f64 / (1u64 << 53) as f64
    }

    fn send(&mut self, now: u64, packet: &Waves) {
        let at = now + self.delay;
        let bad = self.dice() < self.bad;
        match (3.0 * self.dice()) as u32 {
            0 if bad => {}
            1 if bad => {
                let later = (40.0 * self.dice()) as u64;
                self.under_way.push((at + later, *packet));
            }
            2 if bad => {
                let again = (40.0 * self.dice()) as u64;
                self.under_way.extend([(at, *packet), (at + again, *packet)]);
            }
            _ => self.under_way.push((at, *packet)),
        }
    }

    fn come(&mut self, now: u64, to: &mut WaveExchange<'_>) {
        for (_, packet) in self.under_way.extract_if(.., |p| p.0 <= now) {
            to.hear(&packet);
        }
    }
}

/// Each has heard of the other.
fn introduce(a: &mut WaveExchange<'_>, b: &mut WaveExchange<'_>) {
    assert_eq!(b.hear(a.waves()), Heard::Asks);
    assert_eq!(a.hear(b.waves()), Heard::New);
    assert_eq!(b.hear(a.waves()), Heard::New);
    assert!(a.is_joined() && b.is_joined());
}

fn value(x: &mut WaveExchange<'_>, compiled: &Compiled, name: &str) -> f64 {
    let at = compiled.probes().iter().position(|p| p == name).unwrap();
    x.probes().unwrap()[at]
}

/// Over a line that loses nothing, two programs are the one with a line as long as that and the two periods that it
/// takes to send what an interval gave, and to begin the next one with what came.
#[test]
fn two_halves_are_a_line() {
    for (delay, k, z) in [(0, 400.0, 20.0), (1, 90.0, 3.0), (18, 4000.0, 20.0)] {
        let (near, far) = (text(&master(z)), text(&slave(k, z)));
        let one = text(&whole(k, z, delay + 2));
        let mut sim = start(&one, Steps::new());
        let (mut a, mut b) = (exchange(&near, 7, 3), exchange(&far, 9, 3));
        introduce(&mut a, &mut b);
        let [mut forth, mut back] = [1, 2].map(|seed| Line::new(u64::from(delay), 0.0, seed));
        for k in 1..=3000u64 {
            forth.come(k - 1, &mut b);
            back.come(k - 1, &mut a);
            a.tick().unwrap();
            b.tick().unwrap();
            forth.send(k, a.waves());
            back.send(k, b.waves());
            advance(&mut sim, k as f64 * 1e-3);
            for (x, compiled, name) in [(&mut a, &near, "near"), (&mut b, &far, "far")] {
                let found = value(x, compiled, "speed");
                assert_eq!(found, probe(&mut sim, name), "{name} at {k} ms");
            }
        }
        assert!(a.summary().passive && b.summary().passive);
        for (x, other) in [(&a, &b), (&b, &a)] {
            assert_eq!(x.count().stale + x.count().joined + x.count().foreign, 0);
            assert!(x.count().missing <= u64::from(delay) + 1);
            let (e, sent) = (x.energy(0), other.energy(0).sent);
            assert!(e.sent > 0.01 && e.received > 0.01 && e.lost < 1e-12 * e.received + 1e-12, "{e:?}");
            assert!(sent >= e.received + e.waiting);
        }
    }
}

/// Against any wall, at 10 and 200 ms each way, with 30 % of the waves lost, delayed or repeated: at no instant is
/// there more energy than there was and was put in, no wave counts twice, and both ledgers close.
#[test]
fn a_teleoperator_over_a_bad_line_is_passive() {
    for (case, k) in [10.0, 300.0, 4000.0, 5e4, 1e6].into_iter().enumerate() {
        for (delay, bad, most) in [(10, 0.3, 3), (200, 0.3, 3), (10, 0.9, 1), (0, 0.3, 16)] {
            let (near, far) = (text(&master(20.0)), text(&slave(k, 20.0)));
            let (mut a, mut b) = (exchange(&near, 7, most), exchange(&far, 9, most));
            introduce(&mut a, &mut b);
            let seed = 1000 * (case as u64 + 1) + delay;
            let (mut forth, mut back) = (Line::new(delay, bad, seed), Line::new(delay, bad, seed + 500));
            let (mut turned, mut worst) = (0.25, f64::NEG_INFINITY);
            for now in 1..=4000 {
                forth.come(now - 1, &mut b);
                back.come(now - 1, &mut a);
                a.tick().unwrap();
                b.tick().unwrap();
                forth.send(now, a.waves());
                back.send(now, b.waves());
                let put_in = value(&mut a, &near, "put_in");
                let stored = value(&mut a, &near, "stored") + value(&mut b, &far, "stored");
                let (x, y) = (a.energy(0), b.energy(0));
                turned = f64::max(turned, put_in.abs() + x.sent + y.sent);
                for (from, to) in [(x, y), (y, x)] {
                    let on_the_way = from.sent - to.received;
                    assert!(on_the_way >= to.waiting - 1e-12 * turned, "{from:?} {to:?}");
                    assert!(to.lost <= on_the_way - to.waiting + 1e-12 * turned, "{from:?} {to:?}");
                }
                let under_way = x.waiting + y.waiting;
                worst = f64::max(worst, stored + under_way - put_in - 0.25);
                assert!(worst <= 1e-9 * turned, "k = {k}, {delay} ms: {worst} J from nowhere at {now} ms");
            }
            assert!(a.energy(0).lost > 1e-3 && b.count().stale > 0 && b.count().missing > 0, "{:?}", b.count());
            for x in [&a, &b] {
                let summary = x.summary();
                assert!(summary.passive, "{k} {delay}: {:?}", summary.reasons);
                assert!(summary.worst_step < 1e-11 && summary.total < 1e-9, "{summary:?}");
                let booked = summary.regions.iter().flat_map(|r| &r.sources).find(|s| s.name == "link").unwrap().energy;
                let e = x.energy(0);
                close(booked, e.received - e.sent, 1e-11 * (e.received + e.sent), "what the ledger has of the port");
            }
        }
    }
}

/// The same with nothing that loses energy but the line, which is stiff beside what moves it: the bars let go, and what
/// leaves is shortened to what there is.
#[test]
fn what_holds_add_does_not_leave() {
    let bare = |z: f64| {
        let text = master(z);
        let text = text.replace("R:arm = 1 N*s/m", "").replace("Se:hand = 8 N*sin(5 rad/s*t)", "");
        text.replace("hand -> 1:v -> handle, arm", "1:v -> handle")
            .replace("probe put_in = integral(hand.e*v.f, 0 J)", "")
    };
    for (z, bad, delay) in [(200.0, 0.0, 10), (20.0, 0.0, 200), (20.0, 0.3, 10), (2000.0, 0.3, 200), (500.0, 0.1, 0)] {
        let (near, far) = (text(&bare(z)), text(&slave(4000.0, z)));
        let (mut a, mut b) = (exchange(&near, 7, 3), exchange(&far, 9, 3));
        introduce(&mut a, &mut b);
        let [mut forth, mut back] = [3, 4].map(|seed| Line::new(delay, bad, seed));
        for now in 1..=3000 {
            forth.come(now - 1, &mut b);
            back.come(now - 1, &mut a);
            a.tick().unwrap();
            b.tick().unwrap();
            forth.send(now, a.waves());
            back.send(now, b.waves());
            let stored = value(&mut a, &near, "stored") + value(&mut b, &far, "stored");
            let (x, y) = (a.energy(0), b.energy(0));
            let all = stored + (x.sent - y.received) + (y.sent - x.received);
            assert!(all <= 0.25 * (1.0 + 1e-9), "{all} J of 0.25 J at {now} ms, {z} N s/m");
        }
        assert!(b.energy(0).received > 0.01 && a.summary().passive && b.summary().passive);
    }
}

/// Too many waves at once come in with their energy, and the line grows no longer than so many may wait.
#[test]
fn waves_that_come_at_once_are_joined() {
    let (near, far) = (text(&master(20.0)), text(&slave(400.0, 20.0)));
    let (mut a, mut b) = (exchange(&near, 7, 3), exchange(&far, 9, 3));
    introduce(&mut a, &mut b);
    let mut sent = Vec::new();
    for _ in 0..50 {
        a.tick().unwrap();
        sent.push(*a.waves());
    }
    sent.iter().for_each(|w| assert_eq!(b.hear(w), Heard::New));
    assert_eq!(b.count().joined, 47);
    let all = a.energy(0).sent;
    close(b.energy(0).waiting, all, 1e-12 * all, "all of it waits");
    // None of them counts again, and 3 intervals later all is in.
    sent.iter().for_each(|w| assert_eq!(b.hear(w), Heard::Overtaken));
    for _ in 0..4 {
        b.tick().unwrap();
    }
    let e = b.energy(0);
    close(e.received, all, 1e-12 * all, "all of it came in");
    assert!(e.waiting == 0.0 && e.lost < 1e-12 * all);
}

/// What others send changes nothing: packets of no session, of earlier ones, of this program itself, with other
/// impedances or periods. What cannot have been sent is told.
#[test]
fn strangers_change_nothing() {
    let (near, far) = (text(&master(20.0)), text(&slave(400.0, 20.0)));
    let (mut a, mut b) = (exchange(&near, 7, 3), exchange(&far, 9, 3));
    introduce(&mut a, &mut b);
    a.tick().unwrap();
    let packet = *a.waves();
    let mut other = |change: fn(&mut Waves)| {
        let mut w = packet;
        w.wave[0] = 100.0;
        change(&mut w);
        b.hear(&w)
    };
    assert_eq!(other(|w| w.session = 0), Heard::Foreign);
    assert_eq!(other(|w| w.session = 9), Heard::Foreign);
    assert_eq!(other(|w| w.session = 6), Heard::Foreign);
    assert_eq!(other(|w| w.answers = 8), Heard::Foreign);
    assert_eq!(other(|w| w.answers = 0), Heard::Foreign);
    assert_eq!(other(|w| w.impedance[0] = 21.0), Heard::Foreign);
    assert_eq!(other(|w| w.impedance[0] = 0.0), Heard::Foreign);
    assert_eq!(other(|w| w.period = 2e-3), Heard::Foreign);
    assert_eq!(other(|w| w.ports = 2), Heard::Foreign);
    assert_eq!((b.count().foreign, b.count().unlike), (5, 4));
    let why = b.misfit().unwrap();
    assert_eq!(why, "at `link` the other program has an impedance of 21, and this one 20 N*s/m");
    assert_eq!((b.energy(0).waiting, b.is_ready()), (0.0, false));
    // A number that no wave has is no packet.
    for x in [f64::NAN, f64::INFINITY, 1e200] {
        let mut buffer = [0; LONGEST];
        let mut w = packet;
        w.wave[0] = x;
        let n = w.write(&mut buffer);
        assert_eq!(Waves::read(&buffer[..n]), None);
    }
    // More than it says that it sent.
    assert_eq!(b.hear(&packet), Heard::New);
    assert!(b.summary().passive);
    let mut more = packet;
    (more.sequence, more.wave[0]) = (2, 1000.0);
    assert_eq!(b.hear(&more), Heard::New);
    assert!(b.summary().reasons[0].contains("more came in than the other program says it sent"));
}

/// A program that restarts joins anew: what it sent before counts no more, and what it sends now counts once.
#[test]
fn a_program_that_restarts_joins_anew() {
    let (near, far) = (text(&master(20.0)), text(&slave(400.0, 20.0)));
    let (mut a, mut b) = (exchange(&near, 7, 3), exchange(&far, 9, 3));
    introduce(&mut a, &mut b);
    a.tick().unwrap();
    let old = *a.waves();
    assert_eq!(b.hear(&old), Heard::New);
    a.tick().unwrap();
    let lost = *a.waves();
    a.tick().unwrap();
    assert_eq!(b.hear(a.waves()), Heard::New);
    let mut again = exchange(&near, 8, 3);
    introduce(&mut again, &mut b);
    assert_eq!(b.hear(&lost), Heard::Foreign);
    again.tick().unwrap();
    assert_eq!(b.hear(again.waves()), Heard::New);
    assert_eq!(b.hear(again.waves()), Heard::Overtaken);
    (0..4).for_each(|_| b.tick().unwrap());
    let e = b.energy(0);
    let all = a.energy(0).sent + again.energy(0).sent;
    close(e.received + e.lost, all, 1e-12 * all, "all that was sent");
    assert!(e.lost > 0.0 && b.count().partners == 2);
    again.end();
    assert!(again.waves().status & END != 0 && !b.is_over());
    assert_eq!(b.hear(again.waves()), Heard::Overtaken);
    assert!(b.is_over());
}

/// Alone, nothing comes back: the port is a damper.
#[test]
fn alone_it_is_a_damper() {
    let compiled = text(
        "model M {
           I:m { inertia = 2 kg; f0 = 1 m/s }
           sampled at 10 kHz {
             port link { impedance = 6 N*s/m }
             1:v -> link
           }
           1:w -> m
           w ||> v
           probe speed = w.f
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    advance(&mut sim, 0.5);
    close(probe(&mut sim, "speed"), (-1.5f64).exp(), 2e-4, "a mass in a dashpot");
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
}

#[test]
fn what_cannot_carry_waves_is_told() {
    for (body, code, words) in [
        ("port p { impedance = 3 N*s/m } I:m = 1 kg p -> m", "elaborate::wave_port", "belongs to no `sampled` block"),
        ("sampled at 1 kHz { port p { impedance = 3 N } I:m = 1 kg p -> m }", "units::mismatch", "the impedance"),
        ("sampled at 1 kHz { port p { impedance = -3 N*s/m } I:m = 1 kg p -> m }", "elaborate::value", "impedance"),
        (
            "sampled at 1 kHz { port p { impedance = 0 N*s/m } I:m = 1 kg p -> m }",
            "elaborate::value",
            "must be positive",
        ),
        (
            "sampled at 1 kHz { port p { impedance = 1 N*s/m; inertia = 1 kg } I:m = 1 kg p -> m }",
            "elaborate::field",
            "and not both",
        ),
        ("sampled at 1 kHz { port p { loss = 1 } I:m = 1 kg p -> m }", "elaborate::field", "no field `loss`"),
    ] {
        let all = errors(&format!("model M {{ {body} }}"));
        assert_eq!(all.list()[0].code, code, "{all}");
        assert!(all.to_string().contains(words), "{all}");
    }
    let unfit = |body: &str| {
        let compiled = text(&format!("model M {{ {body} }}"));
        WaveExchange::new(&compiled, Steps::new(), 1, 3).err().unwrap()
    };
    let port = |name: &str| format!("port {name} {{ impedance = 1 N*s/m }} I:m_{name} = 1 kg {name} -> m_{name}");
    let two = format!("sampled at 1 kHz {{ {} }} sampled at 2 kHz {{ {} }}", port("a"), port("b"));
    assert!(matches!(unfit(&two), Unfit::Periods(..)));
    let mixed = format!("sampled at 1 kHz {{ {} port tip C:c {{ stiffness = 1 N/m }} tip -> c }}", port("a"));
    assert_eq!(unfit(&mixed), Unfit::Mixed("a".into(), "tip".into()));
    assert!(matches!(unfit("sampled at 1 kHz { port tip C:c { stiffness = 1 N/m } tip -> c }"), Unfit::None(_)));
}
