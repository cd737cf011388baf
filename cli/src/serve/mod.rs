//! Real time: a scene meets an outside, interval by interval, at deadlines that do not move.

mod arrival;
pub mod clock;
mod device;
pub mod link;
mod listener;
pub mod log;
mod meter;
pub mod peer;
mod pipe;
pub mod report;
mod shared;
mod udp;
mod wave_link;

pub use device::DeviceMeeting;
pub use listener::Who;
pub use pipe::Pipe;
pub use shared::Shared;
pub use udp::Udp;
pub use wave_link::WaveMeeting;

use crate::stop::Stop;
use bond::RunError;
use log::{Log, Row};
use meter::Meter;
use std::sync::atomic::{AtomicBool, Ordering};

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

/// A scene and who is at the other end of its line.
pub trait Meeting {
    /// Length of an interval, s.
    fn period(&self) -> f64;
    /// How long after the start of an interval what was found is sent, s.
    fn latency(&self) -> f64;
    /// Sends what belongs to the interval that begins.
    ///
    /// # Errors
    /// A line that is broken.
    fn send(&mut self) -> Result<(), Stop>;
    /// Says that this end is there, while the other one is waited for.
    ///
    /// # Errors
    /// A line that is broken.
    fn call(&mut self) -> Result<(), Stop>;
    /// Takes in what came, a bounded number of packets; whether something new did. `round` is told of round trips.
    ///
    /// # Errors
    /// A line that is broken.
    fn hear(&mut self, round: &mut Meter) -> Result<bool, Stop>;
    /// Ends an interval, and begins the next one.
    ///
    /// # Errors
    /// A step that fails.
    fn tick(&mut self) -> Result<(), RunError>;
    /// Whether the other end has gone for good.
    fn is_over(&self) -> bool;
    /// Ends the exchange.
    fn end(&mut self);
    /// Whether a packet may be lost, so that the last one is sent several times.
    fn has_farewell(&self) -> bool;
    /// Sends the last packet.
    fn farewell(&mut self);
    /// What the ledger has of the interval that begins.
    fn row(&self, row: &mut Row);
}

/// A meeting that runs.
struct Loop<'a> {
    with: &'a mut dyn Meeting,
    times: Times,
}

impl Loop<'_> {
    fn hear(&mut self) -> Result<bool, Stop> {
        self.with.hear(&mut self.times.round)
    }

    /// Waits until somebody is there; whether that is before the end.
    fn meet(&mut self, period: u64, end: u64, asked: &AtomicBool) -> Result<bool, Stop> {
        self.with.send()?;
        loop {
            if self.hear()? {
                // The time until the other end joins is not a round trip.
                self.times.round = Meter::new();
                return Ok(true);
            }
            let now = clock::now();
            if asked.load(Ordering::Relaxed) || self.with.is_over() || now >= end {
                return Ok(false);
            }
            self.with.call()?;
            clock::sleep_until(end.min(now + period.min(1_000_000)));
        }
    }

    /// Waits for what the interval needs, with no clock; whether it came.
    fn wait(&mut self, asked: &AtomicBool) -> Result<bool, Stop> {
        loop {
            let over = self.with.is_over();
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
pub fn serve(with: &mut dyn Meeting, log: Option<&mut Log>, until: &Until<'_>) -> End {
    let period = with.period() * 1e9;
    let [lateness, step, work, round] = [(); 4].map(|()| Meter::new());
    let times = Times { lateness, step, work, round, missed: 0, own: 0, wall: 0.0 };
    let mut start = clock::now();
    let mut l = Loop { with, times };
    let result = l.go(period, &mut start, log, until);
    l.times.wall = (clock::now() - start) as f64 / 1e9;
    l.with.end();
    for _ in 0..if l.with.has_farewell() && result.is_ok() { FAREWELLS } else { 0 } {
        l.with.farewell();
    }
    let (failure, broken) = match result {
        Ok(failure) => (failure, None),
        Err(why) => (None, Some(why)),
    };
    End { times: l.times, failure, broken }
}

impl Loop<'_> {
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
            log.add(&*l.with);
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
            let over = l.with.is_over();
            l.hear()?;
            let (begun, worked) = (clock::now(), clock::worked());
            if let Err(e) = l.with.tick() {
                return Ok(Some(e));
            }
            let (worked, stepped) = (clock::worked() - worked, clock::now());
            let latency = (l.with.latency() * 1e9).round() as u64;
            if latency > 0 && !until.lockstep {
                clock::sleep_until(deadline + latency);
            }
            let sending = clock::now();
            l.with.send()?;
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
                log.add(&*l.with);
            }
            if over {
                break;
            }
        }
        Ok(None)
    }
}
