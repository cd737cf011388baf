//! Real time: a scene meets an outside, interval by interval, at deadlines that do not move.

mod arrival;
pub mod clock;
pub mod link;
mod listener;
pub mod log;
mod meter;
pub mod peer;
mod pipe;
pub mod report;
mod shared;
mod udp;

pub use listener::Who;
pub use pipe::Pipe;
pub use shared::Shared;
pub use udp::Udp;

use crate::stop::Stop;
use arrival::{EFFORTS_KEPT, MEASUREMENTS_QUEUED};
use bond::RunError;
use bond::exchange::{Exchange, Heard};
use link::Link;
use log::Log;
use meter::Meter;
use std::sync::atomic::{AtomicBool, Ordering};

/// A device of which nothing new is heard for so long, ns, has left, and another may join.
const GONE: f64 = 1e9;
/// At least so many intervals, of which each has a measurement.
const GONE_INTERVALS: f64 = 2.0;
/// How often the last packet is sent, if it may be lost.
const FAREWELLS: u32 = 3;

/// What the clock saw.
pub struct Times {
    /// From the deadline to waking, ns.
    pub lateness: Meter,
    /// Of the step alone, ns.
    pub step: Meter,
    /// From waking to having sent, ns.
    pub work: Meter,
    /// From sending an effort to the measurement that names it, less what the device waited, ns.
    pub round: Meter,
    /// Efforts that were sent after the next deadline.
    pub missed: u64,
    /// Of these: the thread computed longer than an interval in the step itself.
    pub own: u64,
    /// How long it went on, s.
    pub wall: f64,
}

/// When it is over.
pub struct Until<'a> {
    /// How long it goes on, s: by the clock, from the start, whoever comes; without a clock, of the scene's time.
    pub duration: Option<f64>,
    /// Somebody asked for the end.
    pub asked: &'a AtomicBool,
    /// There is no clock: each interval waits for its measurement.
    pub lockstep: bool,
}

/// How it ended.
pub struct End {
    /// What the clock saw.
    pub times: Times,
    /// The step that failed, if one did.
    pub failure: Option<RunError>,
    /// What broke the line, if something did.
    pub broken: Option<Stop>,
}

/// A running exchange.
struct Loop<'a, 'b> {
    exchange: &'a mut Exchange<'b>,
    link: &'a mut Link,
    sent: Vec<u64>,
    times: Times,
    /// When something new was heard, and how long after that the device has left, ns.
    heard: u64,
    patience: u64,
}

impl Loop<'_, '_> {
    /// Whether no device is there, so that one may join.
    fn is_vacant(&self) -> bool {
        let gone = || clock::now().saturating_sub(self.heard) > self.patience;
        self.link.changes_hands() && (!self.exchange.is_joined() || gone())
    }

    /// Sends what is held.
    fn send(&mut self) -> Result<(), Stop> {
        self.sent[(self.exchange.effort().sequence % EFFORTS_KEPT as u64) as usize] = clock::now();
        self.link.send(self.exchange, self.is_vacant())
    }

    /// Takes in what came, a bounded number of packets; whether something new did.
    fn hear(&mut self) -> Result<bool, Stop> {
        let mut new = false;
        for _ in 0..MEASUREMENTS_QUEUED {
            let vacant = self.is_vacant();
            let Some(arrival) = self.link.receive(vacant)? else { break };
            let m = &arrival.measurement;
            // A device that knows no session says that it is there.
            if m.session == 0 {
                continue;
            }
            let joins = vacant && m.session > self.exchange.effort().session;
            let heard = if joins { self.exchange.join(m) } else { self.exchange.hear(m) };
            if heard != Heard::New {
                continue;
            }
            new = true;
            self.heard = arrival.at;
            self.link.accept();
            // What is offered is no effort of an interval, and is not timed.
            if m.echo > 0 && m.echo + (EFFORTS_KEPT as u64) > self.exchange.effort().sequence {
                let sent = self.sent[(m.echo % EFFORTS_KEPT as u64) as usize];
                let waited = (m.wait.max(0.0) * 1e9) as u64;
                self.times.round.add(arrival.at.saturating_sub(sent).saturating_sub(waited));
            }
        }
        Ok(new)
    }

    /// Waits until a device joins; whether one does before the end.
    fn meet(&mut self, period: u64, end: u64, asked: &AtomicBool) -> Result<bool, Stop> {
        self.send()?;
        loop {
            if self.hear()? {
                // The time until the device joins is not a round trip.
                self.times.round = Meter::new();
                return Ok(true);
            }
            let now = clock::now();
            if asked.load(Ordering::Relaxed) || self.link.is_over() || now >= end {
                return Ok(false);
            }
            clock::sleep_until(end.min(now + period.min(1_000_000)));
        }
    }

    /// Waits for a measurement, with no clock; whether one came.
    fn wait(&mut self, asked: &AtomicBool) -> Result<bool, Stop> {
        loop {
            let over = self.link.is_over();
            if self.hear()? {
                return Ok(true);
            }
            if over || asked.load(Ordering::Relaxed) {
                return Ok(false);
            }
            clock::sleep_until(clock::now() + 20_000);
        }
    }
}

/// Exchanges until the end.
pub fn serve(exchange: &mut Exchange<'_>, link: &mut Link, log: Option<&mut Log>, until: &Until<'_>) -> End {
    let period = exchange.period() * 1e9;
    let [lateness, step, work, round] = [(); 4].map(|()| Meter::new());
    let times = Times { lateness, step, work, round, missed: 0, own: 0, wall: 0.0 };
    let mut start = clock::now();
    let patience = GONE.max(GONE_INTERVALS * period) as u64;
    let mut l = Loop { exchange, link, sent: vec![0; EFFORTS_KEPT], times, heard: start, patience };
    let result = l.go(period, &mut start, log, until);
    l.times.wall = (clock::now() - start) as f64 / 1e9;
    l.exchange.end();
    for _ in 0..if l.link.changes_hands() && result.is_ok() { FAREWELLS } else { 0 } {
        // Who does not hear it any more needs no farewell.
        let _ = l.link.send(l.exchange, false);
    }
    let (failure, broken) = match result {
        Ok(failure) => (failure, None),
        Err(why) => (None, Some(why)),
    };
    End { times: l.times, failure, broken }
}

impl Loop<'_, '_> {
    /// Goes on until the end: the step that failed, if one did. `start` becomes that of the first interval.
    ///
    /// # Errors
    /// A line that is broken.
    fn go(
        &mut self,
        period: f64,
        start: &mut u64,
        mut log: Option<&mut Log>,
        until: &Until<'_>,
    ) -> Result<Option<RunError>, Stop> {
        let l = self;
        if let Some(log) = &mut log {
            log.add(l.exchange);
        }
        let span = until.duration.map(|t| t * 1e9);
        let end = span.filter(|_| !until.lockstep).map_or(u64::MAX, |t| start.saturating_add(t as u64));
        let intervals = span.filter(|_| until.lockstep).map_or(u64::MAX, |t| (t / period).round() as u64);
        let begins = l.meet(period as u64, end, until.asked)?;
        *start = clock::now();
        let mut k = 0u64;
        while begins && k < intervals && !until.asked.load(Ordering::Relaxed) {
            k += 1;
            // The first measurement is there already.
            let deadline = if until.lockstep {
                if k > 1 && !l.wait(until.asked)? {
                    break;
                }
                clock::now()
            } else {
                let deadline = *start + (k as f64 * period).round() as u64;
                if deadline > end {
                    clock::sleep_until(end);
                    break;
                }
                clock::sleep_until(deadline);
                deadline
            };
            let woken = clock::now();
            let over = l.link.is_over();
            l.hear()?;
            let (begun, worked) = (clock::now(), clock::worked());
            if let Err(e) = l.exchange.tick() {
                return Ok(Some(e));
            }
            let (worked, stepped) = (clock::worked() - worked, clock::now());
            let latency = (l.exchange.latency() * 1e9).round() as u64;
            if latency > 0 && !until.lockstep {
                clock::sleep_until(deadline + latency);
            }
            let sending = clock::now();
            l.send()?;
            let done = clock::now() - (sending - stepped);
            l.times.lateness.add(woken.saturating_sub(deadline));
            l.times.step.add(stepped - begun);
            l.times.work.add(done - woken);
            // What has a latency has to be known by then, and all else before the next sample.
            let allowed = if latency > 0 { latency as f64 } else { period };
            if !until.lockstep && done as f64 > deadline as f64 + allowed {
                l.times.missed += 1;
                // What it did not compute, it waited for the machine.
                l.times.own += u64::from(worked as f64 > allowed);
            }
            if let Some(log) = &mut log {
                log.add(l.exchange);
            }
            if over {
                break;
            }
        }
        Ok(None)
    }
}
