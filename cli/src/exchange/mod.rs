//! A scene with open ports that meets a real outside, behind a line that loses, delays, doubles and turns round what it
//! is given.
//!
//! The outside tells sums since the start: how far it moved (`q`) and what energy it put in (`w`). The environment
//! books the differences, whenever they come, and says with each effort how far `w` may fall: to where nothing that was
//! put in is left. So what is given out never exceeds what was put in, whatever comes through; `docs/serve.md` has the
//! argument.

mod device;
mod packet;
mod promise;

pub use device::Device;
pub use packet::{
    EFFORT, END, Effort, LATE, LONGEST, MEASUREMENT, MISSING, Measurement, PORTS, SILENT, crc, effort_length,
    measurement_length,
};

use promise::Promises;

use crate::simulation::RunError;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{Options, Report, Simulation, Summary};
use thiserror::Error;

/// Why a scene cannot meet an outside.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Unfit {
    /// There is no port.
    #[error(
        "`{0}` has no open port; declare one in the scene, such as `port tip {{ inertia = 0.1 kg }}`, and hold it with `tip ||> ...`"
    )]
    None(String),
    /// A port that nobody holds.
    #[error(
        "the open port `{0}` is one of a continuous region, which holds nothing; put a sampled region behind it with `||>`"
    )]
    Continuous(String),
    /// Ports of several periods.
    #[error("the open ports `{}` and `{}` are held for {} s and {} s; all must have one period", .0.0, .1.0, .0.1, .1.1)]
    Periods((String, f64), (String, f64)),
    /// More than a packet holds.
    #[error("there are {0} open ports, and at most {PORTS} are served")]
    Many(usize),
    /// The scene does not start.
    #[error("{0}")]
    Start(#[from] RunError),
}

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// It says something new.
    New,
    /// It came twice.
    Twice,
    /// A later one came before it.
    Overtaken,
    /// It is of another session or of other ports, of a device that started anew, or has numbers that no device counts.
    Foreign,
}

/// What was exchanged so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Count {
    /// Intervals.
    pub intervals: u64,
    /// Of these: nothing was heard.
    pub missing: u64,
    /// Of these: what was heard had not met the interval's effort yet.
    pub late: u64,
    /// Measurements that came twice.
    pub twice: u64,
    /// Measurements that a later one overtook.
    pub overtaken: u64,
    /// Packets that are nobody's.
    pub foreign: u64,
    /// The longest row of intervals of which nothing was heard.
    pub silence: u64,
    /// Sum over the intervals in which the outside put energy in, J.
    pub put_in: f64,
    /// Sum over those in which it drew some, J.
    pub given_out: f64,
    /// The least that the environment could give back, J.
    pub least: f64,
}

/// A scene that meets an outside.
pub struct Exchange<'a> {
    sim: Simulation<'a>,
    scene: &'a Scene,
    period: f64,
    /// Clusters with open ports; which of them each port has; what each may give back.
    clusters: Vec<usize>,
    group: Vec<usize>,
    rooms: Vec<f64>,
    /// By cluster, what it held at the start, where nothing but its open ports gives it energy.
    initial: Vec<Option<f64>>,
    promises: Promises,
    bounded: bool,
    k: u64,
    /// Intervals for which an effort stays where nothing newer comes.
    hold: u32,
    taken: Measurement,
    newest: Measurement,
    fresh: bool,
    /// Whether the device started anew: nobody knows what the old one did last.
    replaced: bool,
    silent: u32,
    effort: Effort,
    count: Count,
}

impl<'a> Exchange<'a> {
    /// A scene at its start. A session's number must be higher than that of all before it, and is not 0; an effort
    /// stays for `hold` intervals where nothing newer comes.
    ///
    /// # Errors
    /// See [`Unfit`].
    pub fn new(scene: &'a Scene, options: &Options, session: u64, hold: u32) -> Result<Self, Unfit> {
        let period = period(scene)?;
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
            replaced: false,
            silent: 0,
            effort: Effort { session, ports, ..Effort::default() },
            count: Count { least: f64::INFINITY, ..Count::default() },
        };
        new.speak(0);
        Ok(new)
    }

    /// Length of an interval, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// What is held now.
    pub fn effort(&self) -> &Effort {
        &self.effort
    }

    /// What was exchanged so far.
    pub fn count(&self) -> &Count {
        &self.count
    }

    /// Energy that the outside put in, as far as it is booked, J.
    pub fn energy(&self) -> f64 {
        self.taken.w.iter().sum()
    }

    /// How far a port moved, as far as it is booked.
    pub fn place(&self, port: usize) -> f64 {
        self.taken.q.get(port).copied().unwrap_or(0.0)
    }

    /// The ledger.
    pub fn summary(&self) -> Summary {
        self.sim.summary()
    }

    /// Takes what came in.
    pub fn hear(&mut self, m: &Measurement) -> Heard {
        let begun = self.newest.sequence > 0;
        let ours = m.session == self.newest.session && m.ports == self.newest.ports && m.echo <= self.k;
        let heard = if !ours || m.is_beyond() {
            Heard::Foreign
        } else if self.replaced || (begun && m.sequence <= self.newest.sequence && m.echo > self.newest.echo) {
            // One device names no later effort in an earlier measurement: this one counts from the beginning.
            self.replaced = true;
            Heard::Foreign
        } else if m.sequence > self.newest.sequence {
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
            Heard::Foreign => self.count.foreign += 1,
        }
        heard
    }

    /// Ends the interval with what was heard, and begins the next one: what is then held is in [`Self::effort`].
    /// Allocates nothing.
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
            let mut net = 0.0;
            for i in 0..self.taken.ports {
                let (q, w) = (self.newest.q[i] - self.taken.q[i], self.newest.w[i] - self.taken.w[i]);
                net += w;
                self.sim.tell(i, Report { q, energy: Some(w), gap: self.silent, silent: false });
            }
            self.count.put_in += net.max(0.0);
            self.count.given_out += (-net).max(0.0);
            self.taken = self.newest;
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
            let limit = sum(&self.group, &self.taken.w, group) - room;
            self.promises.give(self.k, group, limit);
            for i in (0..e.ports).filter(|i| self.group[*i] == group) {
                e.v[i] = if silent { 0.0 } else { self.sim.held_at(i) };
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
                *room = room.min(initial + sum(&self.group, &self.taken.w, group));
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
    let given: usize = scene.clusters[cluster].entries.iter().map(|e| e.supplied.len()).sum();
    (given == open).then(|| sim.kept(cluster))
}

/// The sum over a group's ports.
fn sum(groups: &[usize], values: &[f64], group: usize) -> f64 {
    groups.iter().zip(values).filter(|(g, _)| **g == group).map(|(_, x)| *x).sum()
}

/// The period of all open ports, s.
///
/// # Errors
/// See [`Unfit`].
pub fn period(scene: &Scene) -> Result<f64, Unfit> {
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
    first.map(|f| f.1).ok_or_else(|| Unfit::None(scene.name.clone()))
}
