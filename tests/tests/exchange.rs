//! Scenes that meet an outside over a line that loses, delays, doubles and turns round what it is given: what they give
//! out never exceeds what was put in.

use crate::common::{cases, models, text, with};
use bond::exchange::{Device, Effort, Exchange, Heard, Measurement, OFFERS, PORTS};
use bond::internal::CompiledInternals;
use bond::{Compiled, Options, Steps};
use proptest::prelude::*;

/// Random numbers, the same on every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// From -1 to 1.
    fn swing(&mut self) -> f64 {
        2.0 * self.roll() - 1.0
    }
}

/// A line: what was sent, and when it comes, in ticks.
struct Line<T> {
    under_way: Vec<(u64, T)>,
    bad: f64,
}

impl<T: Copy> Line<T> {
    fn send(&mut self, now: u64, packet: T, dice: &mut Dice) {
        if dice.roll() < self.bad {
            return; // lost
        }
        let delay = |dice: &mut Dice, bad: f64| if dice.roll() < bad { 1 + (dice.roll() * 60.0) as u64 } else { 1 };
        self.under_way.push((now + delay(dice, self.bad), packet));
        if dice.roll() < self.bad {
            self.under_way.push((now + delay(dice, self.bad), packet)); // doubled
        }
    }

    fn come(&mut self, now: u64) -> Vec<T> {
        let (here, rest) = self.under_way.iter().partition(|p: &&(u64, T)| p.0 <= now);
        self.under_way = rest;
        let here: Vec<(u64, T)> = here;
        here.into_iter().map(|p| p.1).collect()
    }
}

/// Who is at the other end.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Who {
    /// A mass that is pushed here and there.
    Mass,
    /// Moves so as to draw energy wherever it is let, now and then the other way.
    Thief,
}

/// What came of it.
#[derive(Debug)]
struct Ending {
    /// Energy that the environment held at the start, J.
    initial: f64,
    put_in: f64,
    given_out: f64,
    /// The worst excess of what was given out over what there was, J.
    excess: f64,
    missing: u64,
    booked: f64,
    /// What the device drew past its limits, as the environment counts it, J.
    overdrawn: f64,
    /// Why the ledger says that it was not passive.
    reasons: Vec<String>,
}

/// Ticks of the device in an interval.
const TICKS: u64 = 8;

/// Lets a scene and a device meet for so many intervals. `honest` devices keep the limit.
fn meet(compiled: &Compiled, who: Who, bad: f64, seed: u64, intervals: u64, honest: bool) -> Ending {
    let mut exchange = Exchange::new(compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
    let n = compiled.scene().open.len();
    let initial: f64 = exchange.summary().regions.iter().map(|r| r.h_initial).sum();
    let period = exchange.period();
    let tick = period / TICKS as f64;
    let mut dice = Dice(seed | 1);
    let mut device = Device::new(n);
    let (mut out, mut back) =
        (Line::<Effort> { under_way: vec![], bad }, Line::<Measurement> { under_way: vec![], bad });
    let (mut speed, mut push) = ([0.0; PORTS], [0.0; PORTS]);
    let mut end = Ending {
        initial,
        put_in: 0.0,
        given_out: 0.0,
        excess: f64::NEG_INFINITY,
        missing: 0,
        booked: 0.0,
        overdrawn: 0.0,
        reasons: vec![],
    };
    let mut own = bond_runtime::ledger::Sum::new();
    out.send(0, *exchange.effort(), &mut dice);
    for now in 1..=intervals * TICKS {
        let t = now as f64 * tick;
        for e in out.come(now) {
            device.receive(&e, t);
        }
        if now % 32 == 1 {
            push.iter_mut().take(n).for_each(|p| *p = 20.0 * dice.swing());
        }
        let mut dq = [0.0; PORTS];
        for i in 0..n {
            let v = device.effort(i, t);
            dq[i] = match who {
                Who::Mass => speed[i] * tick,
                Who::Thief if dice.roll() < 0.7 && v != 0.0 => -v.signum() * 0.02 * dice.roll(),
                Who::Thief => 0.02 * dice.swing(),
            };
        }
        let mut efforts = [0.0; PORTS];
        for i in 0..n {
            let part = if honest { device.part(i, &dq[..n], t) } else { 1.0 };
            efforts[i] = part * device.effort(i, t);
        }
        let energy: f64 = (0..n).map(|i| efforts[i] * dq[i]).sum();
        device.moved(&dq[..n], &efforts);
        for i in 0..n {
            // The effort pushes back on a mass of 0.5 kg with a little drag.
            speed[i] += (push[i] - efforts[i] - speed[i]) * tick / 0.5;
        }
        own.add(energy);
        end.put_in += energy.max(0.0);
        end.given_out += (-energy).max(0.0);
        end.excess = end.excess.max(-own.value() - initial);
        if now % (TICKS / 2) == 1 {
            back.send(now, device.measurement(t), &mut dice);
        }
        for m in back.come(now) {
            exchange.hear(&m);
        }
        if now % TICKS == 0 {
            exchange.tick().unwrap_or_else(|e| panic!("{e}"));
            out.send(now, *exchange.effort(), &mut dice);
        }
    }
    // The last word comes through.
    exchange.hear(&device.measurement(intervals as f64 * period));
    exchange.tick().unwrap_or_else(|e| panic!("{e}"));
    end.missing = exchange.count().missing;
    end.overdrawn = exchange.count().overdrawn;
    end.booked = exchange.energy() - own.value();
    end.reasons = exchange.summary().reasons;
    end
}

fn wall(options: Options) -> Compiled {
    let path = models().join("examples").join("open_port.bond");
    crate::common::file(&path, options)
}

/// A spring that is stretched at the start, and a gyrator between two ports.
const TWO: &str = "
    model Two {
      port left { inertia = 0.2 kg }
      port right
      sampled at 500 Hz {
        C:spring { stiffness = 400 N/m; q0 = 0.05 m }
        R:damper = 2 N*s/m
        C:far { stiffness = 100 N/m; q0 = 0.1 m }
        1:w -> spring, damper
        TF:lever = 2
        lever -> far
        1:z -> lever
      }
      left ||> w
      right ||> z
      simulate { stop = 1 s }
    }";

fn keeps(what: &str, end: &Ending) {
    let scale = end.initial + end.put_in;
    assert!(end.excess <= 1e-12 * scale, "{what}: more was given out than put in: {end:?}");
    assert!(end.booked.abs() <= 1e-12 * scale, "{what}: the two ends count differently: {end:?}");
    // The environment learns of sums, with their rounding: what it owes by that says nothing against it.
    assert!(end.reasons.is_empty() || end.excess <= 1e-15 * scale, "{what}: {end:?}");
    assert!(end.overdrawn <= 1e-11 * scale, "{what}: {end:?}");
}

#[test]
fn nothing_is_given_that_was_not_put_in() {
    for (what, compiled) in [("wall", wall(Options::new())), ("two", text(TWO))] {
        for who in [Who::Mass, Who::Thief] {
            for bad in [0.0, 0.05, 0.5] {
                let mut moved = (0.0, 0.0);
                for seed in 1..=10 {
                    let end = meet(&compiled, who, bad, seed * 7919, 3000, true);
                    let what = format!("{what}, {who:?}, {bad} bad, seed {seed}");
                    keeps(&what, &end);
                    moved = (moved.0 + end.put_in, moved.1 + end.given_out);
                    assert!((bad == 0.0) == (end.missing == 0), "{what}: {end:?}");
                }
                // It was no idle exchange.
                assert!(moved.0 > 0.1 && moved.1 > 1e-3, "{what}, {who:?}, {bad} bad: {moved:?}");
            }
        }
    }
}

/// The limit is what keeps it: a device that does not heed it draws more than there is. It is the device that is named
/// for that, with what it drew too much, and not what it drew from.
#[test]
fn without_the_limit_a_thief_gets_more() {
    for (what, compiled) in [("wall", wall(Options::new())), ("two", text(TWO)), ("steered", text(STEERED))] {
        for seed in [7919, 104_729] {
            let end = meet(&compiled, Who::Thief, 0.05, seed, 3000, false);
            assert!(end.excess > 0.01, "{what}: {end:?}");
            let [why] = &end.reasons[..] else { panic!("{what}: {end:?}") };
            assert!(why.starts_with("the device drew") && why.ends_with("J more than it was allowed"), "{what}: {why}");
            // What was allowed is never more than what there was; measurements do not see all of a dip.
            assert!(end.overdrawn >= 0.9 * end.excess, "{what}: {end:?}");
        }
    }
}

/// A wall that is a source which reads how far the tip moved, with something of the past in it.
const STEERED: &str = "
    model Steered {
      port tip { inertia = 0.2 kg }
      sampled at 500 Hz {
        state late = 0 m { next = place.q }
        C:place { H = 0; q0 = 0 m }
        Se:wall = -(300 N/m)*late - (2 N*s/m)*place.f
        1:w -> place
        wall -> w
      }
      tip ||> w
      simulate { stop = 1 s }
    }";

/// A steered source behind an open port gives out no more than the device put in.
#[test]
fn a_steered_wall_gives_only_what_was_put_in() {
    let compiled = text(STEERED);
    for who in [Who::Mass, Who::Thief] {
        for bad in [0.0, 0.2] {
            let (mut put_in, mut given_out) = (0.0, 0.0);
            for seed in 1..=5 {
                let end = meet(&compiled, who, bad, seed * 7919, 3000, true);
                keeps(&format!("{who:?}, {bad} bad, seed {seed}"), &end);
                (put_in, given_out) = (put_in + end.put_in, given_out + end.given_out);
            }
            assert!(put_in > 0.1 && given_out > 1e-3, "{who:?}, {bad} bad: {put_in} {given_out}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(40), ..ProptestConfig::default() })]

    #[test]
    fn whatever_the_line_does(seed: u64, bad in 0.0f64..0.95, thief: bool, stiffness in 10.0f64..1e5, damping in 0.0f64..200.0, hz in 50.0f64..4000.0) {
        let text = TWO.replace("400 N/m", &format!("{stiffness} N/m")).replace("2 N*s/m", &format!("{damping} N*s/m"))
            .replace("500 Hz", &format!("{hz} Hz"));
        let who = if thief { Who::Thief } else { Who::Mass };
        keeps("two", &meet(&with(Options::new(), &text), who, bad, seed, 400, true));
    }
}

/// The mass comes to rest where the spring bears the push, also over a bad line.
#[test]
fn a_bad_line_changes_little_at_rest() {
    let compiled = wall(Options::new().set("wall.gap", "0 m"));
    for bad in [0.0, 0.05, 0.2] {
        let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
        let (mut device, mut dice) = (Device::new(1), Dice(99));
        let (mut x, mut speed) = (0.0, 0.0);
        let tick = 1e-3 / TICKS as f64;
        for now in 0..3000 * TICKS {
            let t = now as f64 * tick;
            if now % TICKS == 0 {
                if now > 0 {
                    exchange.tick().unwrap_or_else(|e| panic!("{e}"));
                }
                if dice.roll() >= bad {
                    device.receive(exchange.effort(), t);
                }
            }
            let dq = [speed * tick];
            let effort = device.part(0, &dq, t) * device.effort(0, t);
            device.moved(&dq, &[effort]);
            x += dq[0];
            speed += (5.0 - effort) * tick / 0.5;
            if now % TICKS == TICKS - 1 && dice.roll() >= bad {
                exchange.hear(&device.measurement(t));
            }
        }
        // 5 N on 1000 N/m.
        assert!((x - 5e-3).abs() < 2e-4, "with {bad} lost it rests at {x} m");
    }
}

/// A tick allocates nothing.
#[test]
fn nothing_is_allocated_in_a_tick() {
    let compiled = text(TWO);
    let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
    let mut device = Device::new(2);
    let mut buffer = [0; bond::exchange::LONGEST];
    let mut run = |from: u64, to: u64| {
        for k in from..to {
            let t = k as f64 * 2e-3;
            let n = exchange.effort().write(&mut buffer);
            if let Some(e) = Effort::read(&buffer[..n]) {
                device.receive(&e, t);
            }
            let dq = [1e-3 * (t * 30.0).sin(), 1e-4];
            let efforts = [0, 1].map(|i| device.part(i, &dq, t) * device.effort(i, t));
            device.moved(&dq, &efforts);
            let n = device.measurement(t).write(&mut buffer);
            if let Some(m) = Measurement::read(&buffer[..n]).filter(|_| k % 7 > 0) {
                exchange.hear(&m);
            }
            exchange.tick().unwrap_or_else(|e| panic!("{e}"));
        }
    };
    run(0, 50);
    let counted = allocation_counter::measure(|| run(50, 500));
    assert_eq!(counted.count_total, 0);
}

/// A device that starts anew in the middle of a session begins its sums at 0: what the old one drew must not become
/// something put in. It is known by its numbers, and refused from then on.
#[test]
fn a_device_that_starts_anew_is_refused() {
    let compiled = text(TWO);
    let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
    let initial = exchange.effort().stored;
    let told = |exchange: &Exchange<'_>, sequence: u64, w: f64| {
        let mut m =
            Measurement { session: 5, sequence, ports: 2, echo: exchange.effort().sequence, ..Measurement::default() };
        (m.q[0], m.w[0]) = (-1e-3 * sequence as f64, w);
        m
    };
    for k in 1..=20 {
        let m = told(&exchange, k, -0.01 * initial * k as f64);
        assert_eq!(exchange.hear(&m), Heard::New);
        exchange.tick().unwrap_or_else(|e| panic!("{e}"));
    }
    for k in 1..=100 {
        let m = told(&exchange, k, 0.0);
        assert_eq!(exchange.hear(&m), Heard::Foreign, "packet {k} of the new one");
        exchange.tick().unwrap_or_else(|e| panic!("{e}"));
    }
    assert_eq!(exchange.count().put_in, 0.0);
    // One whose first number is 0 is no other one.
    let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
    exchange.tick().unwrap_or_else(|e| panic!("{e}"));
    let first = told(&exchange, 0, 0.0);
    assert_eq!(exchange.hear(&first), Heard::Twice);
    let second = told(&exchange, 1, 0.0);
    assert_eq!(exchange.hear(&second), Heard::New);
    // Sums that no device counts are refused as well.
    let mut exchange = Exchange::new(&compiled, Steps::new(), 6, 3).unwrap_or_else(|e| panic!("{e}"));
    for w in [f64::NAN, f64::INFINITY, 1.7e308, -1e200] {
        let m = Measurement { session: 6, ..told(&exchange, 1, w) };
        assert_eq!(exchange.hear(&m), Heard::Foreign, "{w}");
    }
}

/// A device draws all that it is let and leaves, its last measurements lost; the next one joins and does the same. In
/// all they draw no more than there was and what they put in, whatever was booked when.
#[test]
fn devices_that_follow_each_other_draw_no_more_than_one() {
    let compiled = text(TWO);
    let mut untold = 0.0;
    for seed in 1..=40 {
        let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
        let initial = exchange.effort().stored;
        let (mut dice, mut now) = (Dice(seed * 7919), 0.0);
        let (mut own, mut put_in) = (0.0f64, 0.0f64);
        for life in 1..=4 {
            let (mut device, mut heard) = (Device::new(2), true);
            assert!(device.receive(&exchange.offer(), now));
            for k in 0..100 {
                now += 2e-3;
                let dq = [0, 1].map(|i| match device.effort(i, now) {
                    v if dice.roll() < 0.6 && v != 0.0 => -v.signum() * 0.01 * dice.roll(),
                    _ => 0.01 * dice.swing(),
                });
                let efforts = [0, 1].map(|i| device.part(i, &dq, now) * device.effort(i, now));
                device.moved(&dq, &efforts);
                let energy: f64 = (0..2).map(|i| efforts[i] * dq[i]).sum();
                (own, put_in) = (own + energy, put_in + energy.max(0.0));
                assert!(-own <= initial + 1e-12 * (initial + put_in), "{life}, {k}: {own} J of {initial} J");
                let m = device.measurement(now);
                // From some time on it is not heard any more.
                heard = heard && (k < 2 || dice.roll() < 0.95);
                if heard {
                    let new = if k == 0 { exchange.join(&m) } else { exchange.hear(&m) };
                    assert_eq!(new, Heard::New);
                }
                exchange.tick().unwrap_or_else(|e| panic!("{e}"));
                device.receive(exchange.effort(), now);
            }
            assert_eq!(exchange.count().joined, life);
        }
        untold += exchange.count().untold;
        assert!(put_in > 0.01, "{put_in} J: {:?}", exchange.count());
        assert!(exchange.summary().reasons.is_empty(), "{:?}", exchange.summary().reasons);
    }
    assert!(untold > 0.1, "{untold} J were untold");
}

/// Only what was offered joins: not a session of before, of another offer, or with impossible numbers.
#[test]
fn who_was_offered_nothing_does_not_join() {
    let compiled = text(TWO);
    let mut exchange = Exchange::new(&compiled, Steps::new(), 5, 3).unwrap_or_else(|e| panic!("{e}"));
    let offer = exchange.offer();
    assert_eq!(offer.v, [0.0; PORTS]);
    let m = Measurement { session: offer.session, sequence: 1, ports: 2, ..Measurement::default() };
    let beyond = Measurement { w: [1e200; PORTS], ..m };
    for wrong in [
        Measurement { session: 5, ..m },
        Measurement { session: offer.session + OFFERS, ..m },
        Measurement { sequence: 0, ..m },
        Measurement { ports: 1, ..m },
        Measurement { echo: 1, ..m },
        beyond,
    ] {
        assert_eq!(exchange.join(&wrong), Heard::Foreign, "{wrong:?}");
        assert!(!exchange.is_joined());
    }
    assert_eq!(exchange.join(&Measurement { session: offer.session + OFFERS - 1, ..m }), Heard::New);
    assert_eq!(exchange.join(&m), Heard::Foreign, "that offer is over");
    let next = Measurement { session: exchange.offer().session, ..m };
    let counted = allocation_counter::measure(|| {
        exchange.join(&next);
    });
    assert_eq!((counted.count_total, exchange.count().joined), (0, 2));
}
