//! The device's end of the line: the rules by which it never draws energy that is not there.

use super::packet::{END, Effort, Measurement, PORTS};

/// A device's end of the line: it holds efforts, and counts its movement and energy.
///
/// Three rules make it passive, whatever the line loses, delays, duplicates or reorders:
///
/// 1. An effort is taken only if its number is higher than that of the one held (or its session is).
/// 2. It is held for at most `lasts`; after that 0 is held.
/// 3. The sum of `w` over the ports of a group never falls below their `limit`: before that, efforts are reduced.
#[derive(Clone, Debug)]
pub struct Device {
    held: Effort,
    came: f64,
    sequence: u64,
    q: [f64; PORTS],
    w: [f64; PORTS],
}

impl Device {
    /// A device that has received nothing.
    pub fn new(ports: usize) -> Self {
        Self::holding(Effort { ports: ports.min(PORTS), ..Effort::default() }, 0.0)
    }

    fn holding(held: Effort, came: f64) -> Self {
        Self { held, came, sequence: 0, q: [0.0; PORTS], w: [0.0; PORTS] }
    }

    /// The session that it is in; 0 before it knows one.
    pub fn session(&self) -> u64 {
        self.held.session
    }

    /// Takes an effort that came at `now`, s of the device's own clock. Whether it counts.
    pub fn receive(&mut self, effort: &Effort, now: f64) -> bool {
        if effort.ports != self.held.ports || effort.session == 0 {
            return false;
        }
        if effort.session > self.held.session {
            // Another run of the environment: all sums start at 0.
            *self = Self::holding(*effort, now);
            return true;
        }
        let newer = effort.session == self.held.session && effort.sequence > self.held.sequence;
        if newer {
            self.held = *effort;
            self.came = now;
        }
        newer
    }

    /// Whether the held effort has expired.
    pub fn is_over(&self, now: f64) -> bool {
        self.held.session == 0 || now - self.came > self.held.lasts || self.held.status & END != 0
    }

    /// The effort at a port, before the limit.
    pub fn effort(&self, port: usize, now: f64) -> f64 {
        if self.is_over(now) || port >= self.held.ports { 0.0 } else { self.held.v[port] }
    }

    /// The part of a port's effort, from 0 to 1, that may be held over a movement `dq` of all ports: less than 1 if the
    /// whole would draw more energy than its group has left.
    pub fn part(&self, port: usize, dq: &[f64], now: f64) -> f64 {
        let e = &self.held;
        let others = || (0..e.ports.min(dq.len())).filter(|i| e.group[*i] == e.group[port]);
        let given: f64 = others().map(|i| self.effort(i, now) * dq[i]).sum();
        let left = others().map(|i| self.w[i]).sum::<f64>() - e.limit[port];
        if given >= 0.0 || left + given >= 0.0 {
            return 1.0;
        }
        // Of energies that overflow nothing is drawn.
        let part = left / -given;
        if part > 0.0 { part.min(1.0) } else { 0.0 }
    }

    /// Counts a movement of all ports and the efforts that they met.
    pub fn moved(&mut self, dq: &[f64], efforts: &[f64]) {
        for (i, (dq, v)) in dq.iter().zip(efforts).enumerate().take(self.held.ports) {
            self.w[i] += v * dq;
            self.q[i] += dq;
        }
    }

    /// The energy that it put into the environment, J.
    pub fn energy(&self) -> f64 {
        self.w.iter().sum()
    }

    /// The measurement to be sent.
    pub fn measurement(&mut self, now: f64) -> Measurement {
        self.sequence += u64::from(self.held.session != 0);
        Measurement {
            session: self.held.session,
            sequence: self.sequence,
            echo: self.held.sequence,
            wait: now - self.came,
            ports: self.held.ports,
            q: self.q,
            w: self.w,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_a_number_though_energies_overflow() {
        let mut device = Device::new(2);
        let mut effort = Effort { session: 1, ports: 2, lasts: 1.0, ..Effort::default() };
        (effort.v[0], effort.v[1]) = (f64::MAX, -f64::MAX);
        assert!(device.receive(&effort, 0.0));
        for dq in [[10.0, 10.0], [-10.0, 10.0], [f64::NAN, 0.0]] {
            assert_eq!(device.part(0, &dq, 0.0), 0.0, "{dq:?}");
        }
        assert_eq!(device.part(0, &[10.0, -10.0], 0.0), 1.0);
    }
}
