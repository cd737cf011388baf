//! A scene with open ports, connected to a device over a line that may lose, delay, duplicate and reorder packets.
//!
//! The device sends sums since its start: how far it moved (`q`) and the energy it put in (`w`). The environment books
//! the differences, whenever they arrive, and sends with each effort the least value that `w` may fall to: where all
//! the energy that was put in has been given back. So the energy given out never exceeds the energy put in, whatever
//! the line does; `docs/reference/serve.md` has the argument.

mod device;
mod packet;
mod promise;
mod seal;
mod waves;

pub use device::Device;
pub use packet::{
    EFFORT, END, Effort, LATE, LONGEST, MEASUREMENT, MISSING, Measurement, PORTS, SILENT, WAVES, Waves, crc,
    effort_length, measurement_length, waves_length,
};
pub use waves::{WaveCount, WaveEnergy, WaveExchange};

pub use seal::{DeviceSeal, Key, KeyError, LONGEST_SEALED, SEALED, SEALED_VERSION, Sealed, sealed_length};

use promise::Promises;

use crate::compile::Compiled;
use crate::failure::RunError;
use crate::steps::Steps;
use bond_runtime::scene::{Entries, Open, Scene};
use bond_runtime::simulate::{Options, RegionSummary, Report, Simulation, Summary};
use thiserror::Error;

/// Why a scene cannot be served.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Unfit {
    /// There is no port.
    #[error(
        "`{0}` has no open port; declare one in the scene, such as `port tip {{ inertia = 0.1 kg }}`, and hold it with `tip ||> ...`"
    )]
    None(String),
    /// A port of a continuous region.
    #[error(
        "the open port `{0}` belongs to a continuous region, which holds nothing; put a sampled region behind it \
        with `||>`"
    )]
    Continuous(String),
    /// Ports of several periods.
    #[error("the open ports `{}` and `{}` are held for {} s and {} s; all must have one period", .0.0, .1.0, .0.1, .1.1)]
    Periods((String, f64), (String, f64)),
    /// Ports whose values are held differently late.
    #[error("the open ports `{}` and `{}` have latencies of {} s and {} s; all must have one", .0.0, .1.0, .0.1, .1.1)]
    Latencies((String, f64), (String, f64)),
    /// Ports that carry waves beside ports that hold values.
    #[error(
        "the open port `{0}` carries waves to another program, and `{1}` holds values for a device; a scene is served \
        with one kind alone"
    )]
    Mixed(String, String),
    /// More than a packet holds.
    #[error("there are {0} open ports, and at most {PORTS} are served")]
    Many(usize),
    /// The scene does not start.
    #[error("{0}")]
    Start(#[from] RunError),
}

/// How many sessions are offered at once. Each address is offered another one, so that two devices that ask at the same
/// time are told apart.
pub const OFFERS: u64 = 1 << 16;

/// How a measurement was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Heard {
    /// It is newer than all before.
    New,
    /// It came twice.
    Twice,
    /// A later one came before it.
    Overtaken,
    /// It is of a program that has not heard of this one.
    Asks,
    /// It is of another session or has other ports, comes from a restarted device, or has impossible numbers.
    Foreign,
}

/// Counts of an exchange so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Count {
    /// Intervals.
    pub intervals: u64,
    /// Intervals without a measurement.
    pub missing: u64,
    /// Intervals whose newest measurement named an earlier effort.
    pub late: u64,
    /// Measurements that came twice.
    pub twice: u64,
    /// Measurements that a later one overtook.
    pub overtaken: u64,
    /// Packets that were refused.
    pub foreign: u64,
    /// The longest row of intervals without a measurement.
    pub silence: u64,
    /// Energy that the device put in, J: the sum over the intervals in which it put in more than it drew.
    pub put_in: f64,
    /// Energy that the device drew, J: the sum over the other intervals.
    pub given_out: f64,
    /// Devices that joined.
    pub joined: u64,
    /// The part of `given_out` that nobody told of, J: what devices that left may have drawn after their last
    /// measurement.
    pub untold: f64,
    /// The least energy that the environment could give back at any time, J.
    pub least: f64,
    /// What the device drew past its limits, J.
    pub overdrawn: f64,
}

/// What of the energies there a device may draw past its limits: rounding.
const OVERDRAWN: f64 = 1e-11;

/// Movements and energies by port.
#[derive(Clone, Copy, Debug)]
struct Sums {
    q: [f64; PORTS],
    w: [f64; PORTS],
}

impl Sums {
    const NONE: Self = Self { q: [0.0; PORTS], w: [0.0; PORTS] };
}

/// A scene connected to a device.
pub struct Exchange<'a> {
    sim: Simulation<'a>,
    scene: &'a Scene,
    period: f64,
    latency: f64,
    /// Clusters with open ports; which of them each port has; what each may give back.
    clusters: Vec<usize>,
    group: Vec<usize>,
    rooms: Vec<f64>,
    /// By cluster, its energy at the start, if only its open ports supply energy.
    initial: Vec<Option<f64>>,
    promises: Promises,
    bounded: bool,
    k: u64,
    /// Intervals for which an effort is held without a newer one.
    hold: u32,
    taken: Measurement,
    newest: Measurement,
    fresh: bool,
    /// What devices that left moved and put in, in all; and what of it is to be booked at the next tick.
    former: Sums,
    owed: Sums,
    /// Whether the device restarted: the last movements of the old one are unknown, and the new one has to join.
    replaced: bool,
    silent: u32,
    effort: Effort,
    count: Count,
}

impl<'a> Exchange<'a> {
    /// A model at its start. The session's number is not 0, and higher than those of all sessions before. An effort
    /// stays for at most `hold` intervals without a newer one.
    ///
    /// # Errors
    /// See [`Unfit`].
    pub fn new(compiled: &'a Compiled, steps: Steps, session: u64, hold: u32) -> Result<Self, Unfit> {
        Self::on(&compiled.inner.scene, &compiled.steps(steps)?, session, hold)
    }
}

/// An exchange over a scene that need not come from a [`Compiled`].
pub trait ExchangeInternals<'a>: Sized {
    /// A scene at its start; see [`Exchange::new`].
    ///
    /// # Errors
    /// See [`Unfit`].
    fn on(scene: &'a Scene, options: &Options, session: u64, hold: u32) -> Result<Self, Unfit>;
}

impl<'a> ExchangeInternals<'a> for Exchange<'a> {
    fn on(scene: &'a Scene, options: &Options, session: u64, hold: u32) -> Result<Self, Unfit> {
        let (period, latency) = (period(scene)?, latency(scene)?);
        let mut clusters: Vec<usize> = scene.open.iter().map(|o| o.port.0).collect();
        clusters.sort_unstable();
        clusters.dedup();
        let sim = Simulation::new(scene, options).map_err(RunError::from)?;
        let initial = clusters.iter().map(|c| alone(scene, &sim, *c)).collect();
        let ports = scene.open.len();
        let mut new = Self {
            sim,
            scene,
            period,
            latency,
            bounded: scene.excluded.is_empty() && scene.regions.iter().all(|r| !r.pseudo),
            group: scene.open.iter().map(|o| clusters.iter().position(|c| *c == o.port.0).unwrap_or(0)).collect(),
            initial,
            rooms: vec![0.0; clusters.len()],
            promises: Promises::new(clusters.len()),
            clusters,
            k: 0,
            hold,
            taken: Measurement { session, ports, ..Measurement::default() },
            newest: Measurement { session, ports, ..Measurement::default() },
            fresh: false,
            former: Sums::NONE,
            owed: Sums::NONE,
            replaced: false,
            silent: 0,
            effort: Effort { session, ports, ..Effort::default() },
            count: Count { least: f64::INFINITY, ..Count::default() },
        };
        new.speak(0);
        Ok(new)
    }
}

impl Exchange<'_> {
    /// Length of an interval, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// How long after an interval's start the values in [`Self::effort`] are to be held, s.
    pub fn latency(&self) -> f64 {
        self.latency
    }

    /// The values held from the latency on.
    pub fn effort(&self) -> &Effort {
        &self.effort
    }

    /// The counts so far.
    pub fn count(&self) -> &Count {
        &self.count
    }

    /// Booked energy that devices put in, J.
    pub fn energy(&self) -> f64 {
        self.former.w.iter().sum::<f64>() + self.taken.w.iter().sum::<f64>()
    }

    /// Booked movement of a port.
    pub fn place(&self, port: usize) -> f64 {
        let sum = |list: &[f64; PORTS]| list.get(port).copied().unwrap_or(0.0);
        sum(&self.former.q) + sum(&self.taken.q)
    }

    /// Whether a device has joined.
    pub fn is_joined(&self) -> bool {
        self.newest.sequence > 0
    }

    /// The session whose measurements are received; none where the device restarted, so that none of it counts.
    pub fn session(&self) -> Option<u64> {
        (!self.replaced).then_some(self.newest.session)
    }

    /// What a device gets that may join: nothing to hold, in the first of [`OFFERS`] sessions. A device that was given
    /// any of these sessions joins by its first measurement in it.
    pub fn offer(&self) -> Effort {
        let Effort { time, lasts, ports, group, .. } = self.effort;
        Effort { session: self.offered(), time, lasts, ports, group, status: SILENT, ..Effort::default() }
    }

    /// The first session that is offered: higher than the present one, and than all that were offered with it.
    fn offered(&self) -> u64 {
        (self.newest.session | (OFFERS - 1)).saturating_add(1)
    }

    /// Receives the measurement by which a device joins in a session that [`Self::offer`] gave it. The session before,
    /// if a device was in it, is over: all that this one may have drawn since its last measurement counts as drawn.
    /// The caller makes sure that this one has left.
    pub fn join(&mut self, m: &Measurement) -> Heard {
        let offered = m.session.checked_sub(self.offered()).is_some_and(|n| n < OFFERS);
        let sound = m.ports == self.newest.ports && m.echo <= self.k && m.sequence > 0 && !m.is_beyond();
        if !offered || !sound {
            self.count.foreign += 1;
            return Heard::Foreign;
        }
        if self.is_joined() {
            self.part();
        }
        self.taken = Measurement { session: m.session, ports: m.ports, ..Measurement::default() };
        self.effort.session = m.session;
        self.newest = *m;
        (self.fresh, self.replaced) = (true, false);
        self.count.joined += 1;
        Heard::New
    }

    /// Closes the sums of a device that left. Nobody knows what it drew after its last measurement; it is at most what
    /// the limits let it.
    fn part(&mut self) {
        for i in 0..self.taken.ports {
            self.owed.q[i] += self.newest.q[i] - self.taken.q[i];
            self.owed.w[i] += self.newest.w[i] - self.taken.w[i];
            self.former.q[i] += self.newest.q[i];
            self.former.w[i] += self.newest.w[i];
        }
        for group in 0..self.clusters.len() {
            let least = self.promises.least(group, self.newest.echo);
            let untold = sum(&self.group, &self.newest.w, group) - least;
            // A budget that is off bounds nothing.
            let bound = untold.is_finite() && untold > 0.0;
            if let Some(first) = self.group.iter().position(|g| *g == group).filter(|_| bound) {
                self.owed.w[first] -= untold;
                self.former.w[first] -= untold;
                self.count.untold += untold;
            }
        }
        self.promises.forget();
        // The next device is promised nothing in the interval that runs.
        (0..self.clusters.len()).for_each(|group| self.promises.give(self.k, group, 0.0));
    }

    /// The ledger. Where the device drew past its limits, the verdict says so in the place of what that makes of the
    /// regions it drew from.
    pub fn summary(&self) -> Summary {
        let mut summary = self.sim.summary();
        let (c, stored) = (&self.count, summary.regions.iter().map(|r| r.h_max).sum::<f64>());
        if c.overdrawn <= OVERDRAWN * (c.put_in + c.given_out).max(stored) {
            return summary;
        }
        let ours = |r: &&RegionSummary| {
            let region = self.scene.regions.iter().find(|x| x.name == r.name);
            region.is_some_and(|x| self.clusters.contains(&x.cluster))
        };
        let debts: Vec<String> = summary.regions.iter().filter(ours).map(RegionSummary::debt).collect();
        let owed: f64 = summary.regions.iter().filter(ours).map(|r| r.debt_max).sum();
        if owed <= c.overdrawn * (1.0 + OVERDRAWN) {
            summary.reasons.retain(|why| !debts.contains(why));
        }
        summary.reasons.push(format!("the device drew {:.3e} J more than it was allowed", c.overdrawn));
        summary.passive = false;
        summary
    }

    /// Receives a measurement.
    pub fn hear(&mut self, m: &Measurement) -> Heard {
        let begun = self.is_joined();
        let ours = m.session == self.newest.session && m.ports == self.newest.ports && m.echo <= self.k;
        let heard = if !ours || m.is_beyond() {
            Heard::Foreign
        } else if self.replaced || (begun && m.sequence <= self.newest.sequence && m.echo > self.newest.echo) {
            // One device names no later effort in an earlier measurement: this one counts from the beginning.
            self.replaced = true;
            Heard::Foreign
        } else if m.sequence > self.newest.sequence {
            self.count.joined += u64::from(!begun);
            self.newest = *m;
            self.fresh = true;
            Heard::New
        } else if m.sequence == self.newest.sequence {
            Heard::Twice
        } else {
            Heard::Overtaken
        };
        match heard {
            Heard::New => {}
            Heard::Twice => self.count.twice += 1,
            Heard::Overtaken => self.count.overtaken += 1,
            Heard::Foreign | Heard::Asks => self.count.foreign += 1,
        }
        heard
    }

    /// Ends the interval with the newest measurement, and begins the next one, whose held values are in
    /// [`Self::effort`]. Allocates nothing.
    ///
    /// # Errors
    /// A step that fails.
    pub fn tick(&mut self) -> Result<(), RunError> {
        let mut status = 0;
        self.count.intervals += 1;
        if self.fresh {
            if self.newest.echo < self.k {
                self.count.late += 1;
                status |= LATE;
            }
            self.note_overdrawn();
            let mut net = 0.0;
            for i in 0..self.taken.ports {
                let q = self.newest.q[i] - self.taken.q[i] + self.owed.q[i];
                let w = self.newest.w[i] - self.taken.w[i] + self.owed.w[i];
                net += w;
                self.sim.tell(i, Report { q, energy: Some(w), gap: self.silent, silent: false });
            }
            self.count.put_in += net.max(0.0);
            self.count.given_out += (-net).max(0.0);
            self.taken = self.newest;
            self.owed = Sums::NONE;
            self.silent = 0;
        } else {
            self.count.missing += 1;
            self.silent = self.silent.saturating_add(1);
            self.count.silence = self.count.silence.max(u64::from(self.silent));
            status |= MISSING;
            for i in 0..self.taken.ports {
                self.sim.tell(i, Report { energy: Some(0.0), silent: true, ..Report::default() });
            }
        }
        self.fresh = false;
        for (group, cluster) in self.clusters.iter().enumerate() {
            let kept = sum(&self.group, &self.taken.w, group) - self.promises.least(group, self.taken.echo);
            self.sim.reserve(*cluster, kept);
        }
        self.k += 1;
        self.sim.advance(self.k as f64 * self.period)?;
        self.speak(status);
        Ok(())
    }

    /// Counts what the newest measurement has drawn past the limits of the efforts that the device held for it, and not
    /// before.
    fn note_overdrawn(&mut self) {
        for group in 0..self.clusters.len() {
            let [before, now] = [&self.taken.w, &self.newest.w].map(|w| sum(&self.group, w, group));
            let limit = self.promises.least_until(group, self.taken.echo, self.newest.echo);
            self.count.overdrawn += (limit.min(before) - now).max(0.0);
        }
    }

    /// Ends it: 0 is held.
    pub fn end(&mut self) {
        self.effort.sequence += 1;
        self.effort.v = [0.0; PORTS];
        self.effort.status = END;
    }

    /// Fills in what is held.
    fn speak(&mut self, mut status: u32) {
        let silent = self.silent > self.hold;
        if silent {
            status |= SILENT;
        }
        let stored = self.stored();
        self.count.least = self.count.least.min(stored);
        let e = &mut self.effort;
        for (group, room) in self.rooms.iter().enumerate() {
            // The energy that the device counts is wrong by what its encoder does not tell of the motion.
            let ports = (0..e.ports).filter(|i| self.group[*i] == group);
            let miscounted = ports.map(|i| self.scene.open[i].resolution * self.sim.found_at(i).abs());
            let room = (room - miscounted.fold(0.0, |sum, x| sum + x)).max(0.0);
            let limit = sum(&self.group, &self.taken.w, group) - room;
            self.promises.give(self.k, group, limit);
            for i in (0..e.ports).filter(|i| self.group[*i] == group) {
                e.v[i] = if silent { 0.0 } else { self.sim.found_at(i) };
                e.limit[i] = limit;
                e.group[i] = group as u64;
            }
        }
        e.sequence = self.k;
        e.time = self.k as f64 * self.period;
        e.lasts = f64::from(self.hold.max(1)) * self.period;
        e.stored = stored;
        e.status = status;
    }

    /// What could be given back, J, in all and by each cluster: what it keeps, and together not more than the whole
    /// scene does. Below 0 where more was drawn.
    fn stored(&mut self) -> f64 {
        for (group, (room, c)) in self.rooms.iter_mut().zip(&self.clusters).enumerate() {
            *room = self.sim.kept(*c);
            // The same without what rounding does to a store that is far larger than what was put in.
            if let Some(initial) = self.initial[group] {
                let put_in = sum(&self.group, &self.former.w, group) + sum(&self.group, &self.taken.w, group);
                *room = room.min(initial + put_in);
            }
        }
        let own: f64 = self.rooms.iter().sum();
        let whole: f64 = (0..self.scene.clusters.len()).map(|c| self.sim.kept(c)).sum();
        let positive: f64 = self.rooms.iter().map(|x| x.max(0.0)).sum();
        let is_short = self.bounded && whole < positive && positive > 0.0;
        let share = if is_short { whole.max(0.0) / positive } else { 1.0 };
        for (room, c) in self.rooms.iter_mut().zip(&self.clusters) {
            // Nothing bounds what a budget that is off may give.
            let is_bound = self.scene.clusters[*c].budget;
            *room = if is_bound { share * room.max(0.0) } else { f64::INFINITY };
        }
        if self.bounded { own.min(whole) } else { own }
    }
}

/// What a cluster holds at the start, where only open ports give it energy.
fn alone(scene: &Scene, sim: &Simulation<'_>, cluster: usize) -> Option<f64> {
    let open = scene.open.iter().filter(|o| o.port.0 == cluster).count();
    let own = scene.clusters[cluster].entries.iter().any(Entries::is_driven);
    let held = scene.clusters[cluster].holds.len();
    (!own && held == open).then(|| sim.kept(cluster))
}

/// The sum over a group's ports.
fn sum(groups: &[usize], values: &[f64], group: usize) -> f64 {
    groups.iter().zip(values).filter(|(g, _)| **g == group).map(|(_, x)| *x).sum()
}

/// The period of all open ports, s.
///
/// # Errors
/// See [`Unfit`].
fn period(scene: &Scene) -> Result<f64, Unfit> {
    let mut first: Option<(String, f64)> = None;
    for o in &scene.open {
        let Some(period) = scene.clusters.get(o.port.0).and_then(|c| c.period) else {
            return Err(Unfit::Continuous(o.name.clone()));
        };
        match &first {
            None => first = Some((o.name.clone(), period)),
            Some((_, other)) if *other == period => {}
            Some(other) => return Err(Unfit::Periods(other.clone(), (o.name.clone(), period))),
        }
    }
    if scene.open.len() > PORTS {
        return Err(Unfit::Many(scene.open.len()));
    }
    if let (Some(wave), Some(open)) = (scene.waves.first(), scene.open.first()) {
        return Err(Unfit::Mixed(wave.name.clone(), open.name.clone()));
    }
    first.map(|f| f.1).ok_or_else(|| Unfit::None(scene.name.clone()))
}

/// How late the values of all open ports are held, s.
///
/// # Errors
/// See [`Unfit::Latencies`].
fn latency(scene: &Scene) -> Result<f64, Unfit> {
    let of = |o: &Open| (o.name.clone(), scene.clusters[o.port.0].latency);
    let Some(first) = scene.open.first().map(of) else { return Ok(0.0) };
    match scene.open.iter().map(of).find(|other| other.1 != first.1) {
        Some(other) => Err(Unfit::Latencies(first, other)),
        None => Ok(first.1),
    }
}
