//! A scene whose open ports carry waves, connected to another program of that kind over a line that may lose, delay,
//! duplicate and reorder packets.
//!
//! A wave is energy on its way. It leaves one program once, and comes into the other one at most once: each has a
//! number, and a number counts once. So what has come in is never more than what was sent, whatever the line does, and
//! two passive programs stay passive together; `docs/reference/serve.md` has the argument.

use super::packet::{END, PORTS, Waves};
use super::{Heard, Unfit};
use crate::compile::Compiled;
use crate::failure::RunError;
use crate::steps::Steps;
use bond_runtime::scene::{Scene, WavePort};
use bond_runtime::simulate::{Simulation, Summary};

/// Waves in one interval that came in together, by the number of the last of them.
type Waiting = (u64, [f64; PORTS]);

/// Two programs whose impedances or periods differ by more than this part, which is rounding, do not fit.
const SAME: f64 = 1e-12;
/// What of the energy that the other program says it sent may have come in beyond it: rounding.
const UNTRUE: f64 = 1e-11;

/// Counts of an exchange of waves so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct WaveCount {
    /// Intervals.
    pub intervals: u64,
    /// Intervals after the other program had joined into which no wave came.
    pub missing: u64,
    /// Packets of waves that counted.
    pub heard: u64,
    /// Packets that came twice, or after a later one had come in.
    pub stale: u64,
    /// Packets whose waves were joined with those of another one, because too many waited.
    pub joined: u64,
    /// Packets of other sessions, or that are this program's own.
    pub foreign: u64,
    /// Packets of another period, or of ports with other impedances.
    pub unlike: u64,
    /// How often another program joined.
    pub partners: u64,
}

/// Energies of a port that carries waves, J. `told` is `received`, `waiting` and `lost` in all.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct WaveEnergy {
    /// What left by waves.
    pub sent: f64,
    /// What came in by waves.
    pub received: f64,
    /// What came and has yet to come in, that of the interval that runs included.
    pub waiting: f64,
    /// What the other program sent that did not come: lost on the line, or still on it.
    pub lost: f64,
}

/// The other program.
#[derive(Clone, Copy, Debug)]
struct Partner {
    session: u64,
    /// The number of its newest wave that came in or can no longer come in.
    last: u64,
    /// The newest number heard of it, and whether it has ended.
    newest: u64,
    has_ended: bool,
    /// What it says it sent, and what of that counted, J.
    told: [f64; PORTS],
    counted: [f64; PORTS],
}

impl Partner {
    fn new(session: u64) -> Self {
        Self { session, last: 0, newest: 0, has_ended: false, told: [0.0; PORTS], counted: [0.0; PORTS] }
    }
}

/// A scene that exchanges waves with another program.
pub struct WaveExchange<'a> {
    sim: Simulation<'a>,
    scene: &'a Scene,
    period: f64,
    k: u64,
    /// Whether the other program counts the same intervals.
    lockstep: bool,
    own: Waves,
    partner: Partner,
    /// What came and waits for its interval, by number, and how many may wait.
    queue: Vec<Waiting>,
    most: usize,
    /// What comes in over the interval that runs.
    entering: [f64; PORTS],
    received: [f64; PORTS],
    /// What earlier partners sent that did not count, J.
    lost: [f64; PORTS],
    count: WaveCount,
    /// What did not fit the first packet that did not, in words.
    unlike: Option<Unlike>,
}

/// What does not fit.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Unlike {
    Period(f64),
    Ports(usize),
    Impedance(usize, f64),
}

impl<'a> WaveExchange<'a> {
    /// A model at its start. The session's number is not 0, and higher than those of all sessions before. At most
    /// `most` waves of a port wait for their interval.
    ///
    /// # Errors
    /// See [`Unfit`].
    pub fn new(compiled: &'a Compiled, steps: Steps, session: u64, most: u32) -> Result<Self, Unfit> {
        Self::on(&compiled.inner.scene, &compiled.steps(steps)?, session, most)
    }

    /// A scene at its start; see [`Self::new`].
    ///
    /// # Errors
    /// See [`Unfit`].
    #[doc(hidden)]
    pub fn on(
        scene: &'a Scene,
        options: &bond_runtime::simulate::Options,
        session: u64,
        most: u32,
    ) -> Result<Self, Unfit> {
        let (period, most) = (period(scene)?, most.max(1) as usize);
        let ports = scene.waves.len();
        let mut own = Waves { session, period, ports, ..Waves::default() };
        own.impedance.iter_mut().zip(&scene.waves).for_each(|(z, w)| *z = w.impedance);
        Ok(Self {
            sim: Simulation::new(scene, options).map_err(RunError::from)?,
            scene,
            period,
            k: 0,
            lockstep: false,
            own,
            partner: Partner::new(0),
            queue: Vec::with_capacity(most + 1),
            most,
            entering: [0.0; PORTS],
            received: [0.0; PORTS],
            lost: [0.0; PORTS],
            count: WaveCount::default(),
            unlike: None,
        })
    }

    /// Both programs go without a clock: what left over an interval comes in over the second one after it, and not
    /// before.
    #[must_use]
    pub fn in_lockstep(self) -> Self {
        Self { lockstep: true, ..self }
    }

    /// Length of an interval, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// How many intervals have ended.
    pub fn intervals(&self) -> u64 {
        self.k
    }

    /// The packet to be sent: the waves of the interval that ended, or none before the first one has.
    pub fn waves(&self) -> &Waves {
        &self.own
    }

    /// The counts so far.
    pub fn count(&self) -> &WaveCount {
        &self.count
    }

    /// Whether another program has answered.
    pub fn is_joined(&self) -> bool {
        self.partner.session > 0
    }

    /// Whether the other program has ended, and all that came of it is in.
    pub fn is_over(&self) -> bool {
        self.partner.has_ended && self.queue.is_empty()
    }

    /// Whether there are waves for the next interval.
    pub fn is_ready(&self) -> bool {
        self.queue.first().is_some_and(|w| !self.lockstep || w.0 <= self.k)
    }

    /// The wave that comes in at each port over the interval that runs.
    pub fn entering(&self) -> &[f64] {
        &self.entering[..self.own.ports]
    }

    /// The energies of a port.
    ///
    /// # Panics
    /// If there is no such port.
    pub fn energy(&self, port: usize) -> WaveEnergy {
        let waits = self.queue.iter().map(|w| self.energy_of(port, w.1[port])).sum::<f64>();
        // Sums of the same numbers in another order.
        let lost = (self.partner.told[port] - self.partner.counted[port]).max(0.0);
        WaveEnergy {
            sent: self.own.sent[port],
            received: self.received[port],
            waiting: self.energy_of(port, self.entering[port]) + waits,
            lost: self.lost[port] + lost,
        }
    }

    /// Why packets do not fit, if some did not: words that name what differs.
    pub fn misfit(&self) -> Option<String> {
        let own = |port: &WavePort| format!("{} {}", port.impedance, port.unit.as_deref().unwrap_or("(SI)"));
        Some(match self.unlike? {
            Unlike::Period(other) => {
                format!("the other program has a period of {other} s, and this one {} s", self.period)
            }
            Unlike::Ports(other) => {
                let here = self.scene.waves.len();
                format!("the other program has {other} ports that carry waves, and this one {here}")
            }
            Unlike::Impedance(i, other) => {
                let port = &self.scene.waves[i];
                format!("at `{}` the other program has an impedance of {other}, and this one {}", port.name, own(port))
            }
        })
    }

    /// The ledger, with what the other program cannot have sent.
    pub fn summary(&self) -> Summary {
        let mut summary = self.sim.summary();
        for (i, port) in self.scene.waves.iter().enumerate() {
            let excess = self.partner.counted[i] - self.partner.told[i];
            if excess > UNTRUE * self.partner.counted[i] {
                summary.passive = false;
                summary.reasons.push(format!(
                    "at `{}` {excess:.3e} J more came in than the other program says it sent",
                    port.name
                ));
            }
        }
        summary
    }

    fn energy_of(&self, port: usize, wave: f64) -> f64 {
        self.scene.waves[port].energy(wave, self.period)
    }

    /// What of a packet does not fit.
    fn unlike(&self, m: &Waves) -> Option<Unlike> {
        let differs = |a: f64, b: f64| (a - b).abs() > SAME * b;
        if m.ports != self.own.ports {
            return Some(Unlike::Ports(m.ports));
        }
        if differs(m.period, self.period) {
            return Some(Unlike::Period(m.period));
        }
        let all = self.own.impedance.iter().zip(&m.impedance).take(m.ports).enumerate();
        let (i, (_, other)) = { all }.find(|(_, (own, other))| differs(**other, **own))?;
        Some(Unlike::Impedance(i, *other))
    }

    /// Receives a packet. [`Heard::New`] is one that counts, and [`Heard::Asks`] one of a program that has not heard of
    /// this one: it is answered from the next packet on.
    pub fn hear(&mut self, m: &Waves) -> Heard {
        if m.session == 0 || m.session == self.own.session || m.session < self.partner.session {
            self.count.foreign += 1;
            return Heard::Foreign;
        }
        if let Some(why) = self.unlike(m) {
            self.count.unlike += 1;
            self.unlike.get_or_insert(why);
            return Heard::Foreign;
        }
        if m.session > self.partner.session {
            self.own.answers = m.session;
            if m.answers != self.own.session {
                return Heard::Asks;
            }
            self.meet(m.session);
        } else if m.answers != self.own.session {
            self.count.foreign += 1;
            return Heard::Foreign;
        }
        self.partner.has_ended |= m.status & END != 0;
        if m.sequence >= self.partner.newest {
            (self.partner.newest, self.partner.told) = (m.sequence, m.sent);
        }
        if m.sequence == 0 {
            // Nothing has left it yet.
            return Heard::New;
        }
        self.wait(m)
    }

    /// Another program joined, or the same one that restarted. Numbers start anew.
    fn meet(&mut self, session: u64) {
        for i in 0..self.own.ports {
            self.lost[i] += (self.partner.told[i] - self.partner.counted[i]).max(0.0);
        }
        // What the last one sent is still its own.
        self.queue.iter_mut().for_each(|w| w.0 = 0);
        self.partner = Partner::new(session);
        self.count.partners += 1;
    }

    /// Keeps waves until their interval; each number once.
    fn wait(&mut self, m: &Waves) -> Heard {
        let place = self.queue.partition_point(|w| w.0 < m.sequence);
        let is_known = self.queue.get(place).is_some_and(|w| w.0 == m.sequence);
        if m.sequence <= self.partner.last || is_known {
            self.count.stale += 1;
            return Heard::Overtaken;
        }
        self.queue.insert(place, (m.sequence, m.wave));
        self.count.heard += 1;
        for i in 0..m.ports {
            self.partner.counted[i] += self.energy_of(i, m.wave[i]);
        }
        if self.queue.len() > self.most {
            let (first, old) = self.queue.remove(0);
            let next = &mut self.queue[0].1;
            next.iter_mut().zip(old).take(m.ports).for_each(|(x, y)| *x = together(*x, y));
            self.partner.last = self.partner.last.max(first);
            self.count.joined += 1;
        }
        Heard::New
    }

    /// Ends the interval and begins the next one, into which the oldest waves that wait come. What left over the one
    /// that ended is in [`Self::waves`]. Allocates nothing.
    ///
    /// # Errors
    /// A step that fails.
    pub fn tick(&mut self) -> Result<(), RunError> {
        self.count.intervals += 1;
        let mut waves = [0.0; PORTS];
        if self.is_ready() {
            let (number, came) = self.queue.remove(0);
            self.partner.last = self.partner.last.max(number);
            waves = came;
        } else {
            self.count.missing += u64::from(self.is_joined());
        }
        for (i, wave) in waves.iter().enumerate().take(self.own.ports) {
            self.sim.wave_comes(i, *wave);
        }
        self.k += 1;
        self.sim.advance(self.k as f64 * self.period)?;
        self.own.sequence = self.k;
        let ended = std::mem::replace(&mut self.entering, waves);
        for (i, wave) in ended.iter().enumerate().take(self.own.ports) {
            self.received[i] += self.energy_of(i, *wave);
            self.own.wave[i] = self.sim.wave_left(i);
            self.own.sent[i] += self.energy_of(i, self.own.wave[i]);
        }
        Ok(())
    }

    /// Ends it: the packet says so.
    pub fn end(&mut self) {
        self.own.status |= END;
    }

    /// The values of the probes now.
    ///
    /// # Errors
    /// An observation that fails.
    pub fn probes(&mut self) -> Result<&[f64], RunError> {
        Ok(self.sim.probes()?)
    }
}

/// The wave with the energy of two that have to come in at once.
fn together(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt().copysign(a + b)
}

/// The period of all ports that carry waves, s.
///
/// # Errors
/// See [`Unfit`].
fn period(scene: &Scene) -> Result<f64, Unfit> {
    let of = |w: &WavePort| (w.name.clone(), scene.clusters[w.cluster].period.unwrap_or(0.0));
    if let (Some(wave), Some(open)) = (scene.waves.first(), scene.open.first()) {
        return Err(Unfit::Mixed(wave.name.clone(), open.name.clone()));
    }
    if scene.waves.len() > PORTS {
        return Err(Unfit::Many(scene.waves.len()));
    }
    let Some(first) = scene.waves.first().map(of) else { return Err(Unfit::None(scene.name.clone())) };
    match scene.waves.iter().map(of).find(|other| other.1 != first.1) {
        Some(other) => Err(Unfit::Periods(first, other)),
        None => Ok(first.1),
    }
}
