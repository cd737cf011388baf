//! What is on its way in the delays of a cluster: of a sampled one numbers in a ring, of a continuous one what the
//! signal was ([`History`]).

use super::Options;
use crate::history::{History, NODES, SLOTS, SMOOTH, Shape};
use crate::scene::{Carried, Cluster};
use serde::{Deserialize, Serialize};

/// How many more numbers a ring has than it delays by: so far it can be turned back.
const SPARE: usize = 4;

/// A signal state, or what a step reported, so many periods ago.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Ring {
    /// Whether it is of what a step reports; which state or output, and the input slot of what it was.
    is_wave: bool,
    from: usize,
    slot: usize,
    periods: usize,
    /// Where the next number goes.
    next: usize,
    values: Vec<f64>,
}

impl Ring {
    /// Takes a number in, and gives the one that was so many periods ago.
    fn turn(&mut self, x: f64) -> f64 {
        let n = self.values.len();
        self.values[self.next] = x;
        let old = (self.next + n - self.periods) % n;
        self.next = (self.next + 1) % n;
        self.values[old]
    }
}

/// What leaves at an open port that carries waves, and what comes in there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Opening {
    /// Which of the cluster's delays it is, what a step reports of it, and the input slot of what comes in.
    line: usize,
    output: usize,
    slot: usize,
    /// What left over the last interval.
    left: f64,
    /// What comes in over the next interval, and which one that is: it comes in once.
    coming: (f64, u64),
    /// The interval that runs.
    interval: u64,
}

/// A signal of continuous time, a while ago.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Past {
    /// Which output of the cluster's observation it is.
    pub(super) output: usize,
    /// The first input slot of what it was.
    slot: usize,
    pub(super) history: History,
}

/// The delays of a cluster.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct DelayLines {
    rings: Vec<Ring>,
    openings: Vec<Opening>,
    pub(super) pasts: Vec<Past>,
}

impl DelayLines {
    /// Those of a cluster at its start.
    pub(super) fn new(c: &Cluster, options: &Options) -> Self {
        let mut lines = Self::default();
        let mut slot = c.lines_at();
        let ring = |is_wave: bool, from: usize, periods: u32, (slot, start): (usize, f64)| {
            let periods = periods as usize;
            Ring { is_wave, from, slot, periods, next: 0, values: vec![start; periods + SPARE] }
        };
        for (k, line) in c.lines.iter().enumerate() {
            match line.carried {
                Carried::State { state, periods } => {
                    lines.rings.push(ring(false, state, periods, (slot, line.start)));
                }
                Carried::Wave { output, periods } => {
                    lines.rings.push(ring(true, output, periods, (slot, line.start)));
                }
                Carried::Leaving { output } => {
                    lines.openings.push(Opening { line: k, output, slot, ..Opening::default() });
                }
                Carried::Signal { output, time } => {
                    let step = options.step.unwrap_or(options.default_step);
                    let jumps = if options.tolerance.is_some() { usize::MAX } else { Shape::jumps(time, step) };
                    let history = History::new((time, line.start), c.nodes(), jumps);
                    lines.pasts.push(Past { output, slot, history });
                }
            }
            slot += line.carried.slots();
        }
        lines
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rings.is_empty() && self.openings.is_empty() && self.pasts.is_empty()
    }

    /// Whether they may stand for others.
    pub(super) fn alike(&self, other: &Self) -> bool {
        let place = |r: &Ring| (r.is_wave, r.from, r.slot, r.periods, r.values.len());
        let rings = self.rings.iter().zip(&other.rings).all(|(a, b)| place(a) == place(b) && a.next < a.values.len());
        let place = |o: &Opening| (o.line, o.output, o.slot);
        let openings = self.openings.iter().map(place).eq(other.openings.iter().map(place));
        let pasts = self.pasts.iter().zip(&other.pasts);
        (self.rings.len(), self.pasts.len()) == (other.rings.len(), other.pasts.len())
            && rings
            && openings
            && pasts.into_iter().all(|(a, b)| (a.output, a.slot) == (b.output, b.slot) && a.history.alike(&b.history))
    }

    /// Tells the programs what has arrived before the first sample.
    pub(super) fn begin(&self, input: &mut [f64]) {
        for ring in &self.rings {
            input[ring.slot] = ring.values[0];
        }
    }

    /// A step of a sampled cluster is over.
    pub(super) fn turn(&mut self, (state, output): (&[f64], &[f64]), input: &mut [f64]) {
        for ring in &mut self.rings {
            let x = if ring.is_wave { output[ring.from] } else { state[ring.from] };
            input[ring.slot] = ring.turn(x);
        }
        for o in &mut self.openings {
            o.left = output[o.output];
            o.interval += 1;
            input[o.slot] = if o.coming.1 == o.interval { o.coming.0 } else { 0.0 };
        }
    }

    /// Shortens the waves that went in last.
    pub(super) fn shorten(&mut self, part: f64, input: &mut [f64]) {
        for ring in self.rings.iter_mut().filter(|ring| ring.is_wave) {
            let n = ring.values.len();
            let newest = (ring.next + n - 1) % n;
            ring.values[newest] *= part;
            if ring.periods == 0 {
                input[ring.slot] = ring.values[newest];
            }
        }
        self.openings.iter_mut().for_each(|o| o.left *= part);
    }

    /// What left over the last interval at the opening that is one of the cluster's delays.
    pub(super) fn left(&self, line: usize) -> f64 {
        self.openings.iter().find(|o| o.line == line).map_or(0.0, |o| o.left)
    }

    /// Tells what comes in over the next interval at the opening that is one of the cluster's delays.
    pub(super) fn comes(&mut self, line: usize, wave: f64) {
        for o in self.openings.iter_mut().filter(|o| o.line == line) {
            o.coming = (wave, o.interval + 1);
        }
    }

    /// The first instant after `t` at which a step has to end.
    pub(super) fn next(&self, t: f64, slack: f64) -> f64 {
        self.pasts.iter().map(|p| p.history.next(t, slack)).fold(f64::INFINITY, f64::min)
    }

    /// Tells the programs what will have been from `t` to `end`. How coarse that is, as a part of the largest values.
    pub(super) fn aim(&self, input: &mut [f64], (t, end): (f64, f64), slack: f64) -> f64 {
        let aim = |p: &Past| p.history.aim((t, end), slack, &mut input[p.slot..p.slot + SLOTS]);
        self.pasts.iter().map(aim).fold(0.0, f64::max)
    }

    /// Tells the programs what arrives at an instant.
    pub(super) fn latch(&self, input: &mut [f64], t: f64, slack: f64) {
        for p in &self.pasts {
            let slots = &mut input[p.slot..p.slot + SLOTS];
            slots.fill(0.0);
            slots[0] = p.history.arriving(t, slack);
            slots[SLOTS - 1] = t;
        }
    }

    /// Which derivative of what arrives may jump at an instant.
    pub(super) fn arrives(&self, t: f64, slack: f64) -> f64 {
        self.pasts.iter().map(|p| p.history.arrives(t, slack)).fold(SMOOTH, f64::min)
    }

    /// Becomes others, as they were a little while ago: of rings it is enough to turn them back.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.rings.iter_mut().zip(&other.rings).for_each(|(to, from)| to.next = from.next);
        self.openings.iter_mut().zip(&other.openings).for_each(|(to, from)| to.clone_from(from));
        self.pasts.iter_mut().zip(&other.pasts).for_each(|(to, from)| to.history.copy_from(&from.history));
    }

    /// As much of it as [`Self::copy_from`] looks at.
    pub(super) fn keep(&mut self, other: &Self) {
        self.rings.resize(other.rings.len(), Ring::default());
        self.openings.resize(other.openings.len(), Opening::default());
        self.pasts.resize(other.pasts.len(), Past::default());
        self.copy_from(other);
    }
}

/// Room for what is taken down, and how well that is to be.
pub(super) struct Record {
    /// By signal, its values at the nodes.
    pub(super) values: Vec<[f64; NODES.len()]>,
    /// The nodes that are taken: as many as the order of the step is worth.
    pub(super) nodes: usize,
    pub(super) tolerance: Option<f64>,
    /// What the step gave, while the way to it is looked at.
    pub(super) next: Vec<f64>,
    pub(super) output: Vec<f64>,
}

impl Record {
    pub(super) fn new(c: &Cluster, tolerance: Option<f64>, outputs: usize) -> Self {
        let count = c.lines.iter().filter(|_| c.period.is_none()).count();
        let room = if count == 0 { 0 } else { outputs };
        Self {
            values: vec![[0.0; NODES.len()]; count],
            nodes: c.nodes(),
            tolerance,
            next: vec![0.0; if count == 0 { 0 } else { c.initial.len() }],
            output: vec![0.0; room],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Ring, SPARE};

    #[test]
    fn a_ring_gives_what_was() {
        for periods in [0, 1, 2, 7] {
            let mut ring = Ring { periods, values: vec![0.0; periods + SPARE], ..Ring::default() };
            for k in 1..40 {
                let back = ring.next;
                let found = ring.turn(k as f64);
                assert_eq!(found, (k as f64 - periods as f64).max(0.0), "{periods} {k}");
                // Taken again after having been turned back.
                ring.next = back;
                assert_eq!(ring.turn(k as f64), found);
            }
        }
    }
}
