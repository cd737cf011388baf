//! A scene with held ports and its device, interval by interval.

use super::Meeting;
use super::arrival::{EFFORTS_KEPT, MEASUREMENTS_QUEUED};
use super::clock;
use super::link::Link;
use super::log::Row;
use super::meter::Meter;
use crate::stop::Stop;
use bond::RunError;
use bond::exchange::{Exchange, Heard, LATE, MISSING, SILENT};

/// A device of which nothing new is heard for so long, ns, has left, and another may join.
pub const GONE: f64 = 1e9;
/// At least so many intervals, of which each has a measurement.
pub const GONE_INTERVALS: f64 = 2.0;

/// How long after something new was heard somebody has left, ns, where an interval lasts `period` s.
pub fn patience(period: f64) -> u64 {
    GONE.max(GONE_INTERVALS * period * 1e9) as u64
}

/// A running exchange with a device.
pub struct DeviceMeeting<'a, 'b> {
    exchange: &'a mut Exchange<'b>,
    link: &'a mut Link,
    sent: Vec<u64>,
    /// When something new was heard, and how long after that the device has left, ns.
    heard: u64,
    patience: u64,
}

impl<'a, 'b> DeviceMeeting<'a, 'b> {
    /// Nobody is there yet.
    pub fn new(exchange: &'a mut Exchange<'b>, link: &'a mut Link) -> Self {
        let patience = patience(exchange.period());
        Self { exchange, link, sent: vec![0; EFFORTS_KEPT], heard: clock::now(), patience }
    }

    /// What the line is, in words.
    pub fn name(&self) -> String {
        self.link.name()
    }

    /// Packets that could not be read, or came from somebody else.
    pub fn refused(&self) -> u64 {
        self.link.refused()
    }

    /// Whether no device is there, so that one may join.
    fn is_vacant(&self) -> bool {
        let gone = || clock::now().saturating_sub(self.heard) > self.patience;
        self.link.changes_hands() && (!self.exchange.is_joined() || gone())
    }
}

impl Meeting for DeviceMeeting<'_, '_> {
    fn period(&self) -> f64 {
        self.exchange.period()
    }

    fn latency(&self) -> f64 {
        self.exchange.latency()
    }

    /// Sends what is held.
    fn send(&mut self) -> Result<(), Stop> {
        self.sent[(self.exchange.effort().sequence % EFFORTS_KEPT as u64) as usize] = clock::now();
        self.link.send(self.exchange, self.is_vacant())
    }

    /// Nothing: what was sent last is still offered.
    fn call(&mut self) -> Result<(), Stop> {
        Ok(())
    }

    fn hear(&mut self, round: &mut Meter) -> Result<bool, Stop> {
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
                round.add(arrival.at.saturating_sub(sent).saturating_sub(waited));
            }
        }
        Ok(new)
    }

    fn tick(&mut self) -> Result<(), RunError> {
        self.exchange.tick()
    }

    fn is_over(&self) -> bool {
        self.link.is_over()
    }

    fn end(&mut self) {
        self.exchange.end();
    }

    fn has_farewell(&self) -> bool {
        self.link.changes_hands()
    }

    fn farewell(&mut self) {
        // Who does not hear it any more needs none.
        let _ = self.link.send(self.exchange, false);
    }

    fn row(&self, row: &mut Row) {
        let e = self.exchange.effort();
        let flag = |bit: u32| f64::from(u8::from(e.status & bit != 0));
        row.head = [e.time, flag(MISSING), flag(LATE), flag(SILENT), self.exchange.energy(), e.stored];
        row.count = e.ports;
        for i in 0..e.ports {
            row.ports[i] = [e.v[i], self.exchange.place(i)];
        }
    }
}
