//! Whole stretches of a run by one compiled routine, where nobody looks between: the same bits as interval by interval.

use super::cluster::{Book, Run};
use super::hold::{Caution, Held, TERMS};
use super::places::{BookPlaces, ClusterPlaces, HeldPlaces, Places};
use super::worst::Worst;
use super::{Options, Simulation, Start};
use crate::ledger::Sum;
use crate::scene::{Entries, Scene};
use std::sync::Arc;

/// What goes through whole stretches of a scene.
pub trait Stretch: Send + Sync {
    /// Where it has its numbers.
    fn places(&self) -> &Places;

    /// Goes so many intervals on, from what is in the block to what is in it then. Gives how many it went: fewer where
    /// one fails, which then is as if it had not begun; and how many of the notes it left: for each error that may be
    /// the worst, four numbers, the place of those on top that it was compared with, the error, its scale and the
    /// floor.
    fn run(&mut self, block: &mut [f64], intervals: u64, notes: &mut [f64]) -> (u64, usize);
}

/// Makes what goes through stretches of a scene that is run like this and stands here; None where it has no such form.
pub type Make = dyn Fn(&Scene, &Options, &Start) -> Option<Box<dyn Stretch>> + Send + Sync;

/// Makes what goes through stretches of a scene.
#[derive(Clone)]
pub struct Maker {
    /// Makes it.
    pub make: Arc<Make>,
    /// So many intervals that could be gone through at once make up for the time that making it takes.
    pub worth: u64,
}

/// Fewer intervals than this are not worth copying the state.
pub(super) const LEAST: u64 = 4;
/// After so many stretches that failed, no more are tried: what fails is gone through twice.
pub(super) const FAILED: u32 = 50;
/// Notes that a stretch may leave.
pub(super) const NOTES: u64 = 8192;

/// Where a run stands with it.
#[derive(Default)]
pub(super) struct Ahead {
    maker: Option<Maker>,
    stretch: Option<Box<dyn Stretch>>,
    /// Intervals that could have been gone through at once.
    missed: u64,
    block: Vec<f64>,
    notes: Vec<f64>,
    /// Intervals of a stretch at most.
    longest: u64,
    /// Stretches that failed.
    failed: u32,
}

impl Ahead {
    pub(super) fn new(maker: Option<Maker>) -> Self {
        Self { maker, ..Self::default() }
    }
}

impl Simulation<'_> {
    /// How many whole intervals there are to an instant.
    pub(super) fn reach(&self, until: f64) -> u64 {
        let limit = until * (1.0 + 1e-12);
        let length = match (self.order.first(), self.runs.first()) {
            (Some(i), _) => self.scene.clusters[*i].period.unwrap_or(0.0),
            (None, Some(run)) => run.h,
            (None, None) => return 0,
        };
        let gone = self.gone();
        let ends = |n: u64| (gone + n) as f64 * length <= limit;
        // Rounding may make it one too many; one too few is taken by itself.
        let mut wanted = ((limit / length) as u64).saturating_sub(gone);
        while wanted > 0 && !ends(wanted) {
            wanted -= 1;
        }
        wanted
    }

    /// Goes as far towards an instant as can be gone at once; nowhere where something lies between.
    pub(super) fn leap(&mut self, until: f64) {
        if self.ahead.maker.is_none() && self.ahead.stretch.is_none() {
            return;
        }
        let wanted = self.reach(until);
        if wanted < LEAST {
            return;
        }
        if let Some(maker) = &self.ahead.maker {
            self.ahead.missed += wanted;
            if self.ahead.missed < maker.worth {
                return;
            }
            let made = (maker.make)(self.scene, &self.options, &self.start());
            self.ahead.maker = None;
            self.ahead.stretch = made.filter(|s| self.alike(s.places()));
            let Some(stretch) = &self.ahead.stretch else { return };
            let places = stretch.places();
            let each = places.notes().max(1);
            self.ahead.longest = (NOTES / each).max(1);
            self.ahead.notes = vec![0.0; 4 * (self.ahead.longest * each) as usize];
            self.ahead.block.clone_from(&places.image);
        }
        let Some(mut stretch) = self.ahead.stretch.take() else { return };
        if self.ready(stretch.places()) {
            self.go(stretch.as_mut(), wanted);
        }
        if self.ahead.failed < FAILED {
            self.ahead.stretch = Some(stretch);
        }
    }

    /// How many intervals are over.
    fn gone(&self) -> u64 {
        match self.order.first() {
            Some(i) => self.next[*i].saturating_sub(1),
            None => self.runs.first().map_or(0, |r| r.count),
        }
    }

    /// Whether a routine takes what is held for what this run takes it.
    pub(super) fn alike(&self, places: &Places) -> bool {
        let same = |a: &[f64], b: &[f64]| a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()));
        places.clusters.iter().enumerate().all(|(i, p)| {
            same(&p.beta, &self.beta[i]) && same(&p.gamma, &self.gamma[i]) && same(&p.decay, &self.decay[i])
        })
    }

    /// Whether the run stands where a routine can go on.
    pub(super) fn ready(&self, places: &Places) -> bool {
        let sampled = !self.order.is_empty();
        let (gone, now) = (self.gone(), if sampled { self.last_sample } else { self.gone() as f64 * places.interval });
        let clusters = self.scene.clusters.iter().zip(&self.runs).zip(&places.clusters).enumerate();
        let mut steps = clusters.map(|(i, ((c, run), p))| {
            let grid = match (c.period, sampled) {
                (Some(_), _) => self.next[i] == gone + 1 && self.reserve[i] == 0.0,
                (None, true) => run.h == p.h && run.count == 0 && run.base == now,
                (None, false) => run.h == p.h && run.count == gone && run.base == 0.0,
            };
            let held = self.held[i].iter().all(|h| !h.silent && h.holder_energy == h.other_energy);
            grid && held && run.feed.is_settled(now) && self.moved[i].len() == c.ports.len()
        });
        (!sampled || gone as f64 * places.interval == now)
            && self.given.iter().all(|g| g.is_settled(now))
            && steps.all(|good| good)
    }

    /// Goes on by a routine.
    fn go(&mut self, stretch: &mut dyn Stretch, mut wanted: u64) {
        let Ahead { mut block, mut notes, longest, mut failed, .. } = std::mem::take(&mut self.ahead);
        if self.load(stretch.places(), &mut block) {
            while wanted > 0 {
                let part = wanted.min(longest);
                let (gone, noted) = stretch.run(&mut block, part, &mut notes);
                self.take_notes(stretch.places(), &notes[..4 * noted]);
                self.passed(stretch.places(), gone);
                wanted -= part;
                if gone < part {
                    failed += 1;
                    break;
                }
            }
            self.fetch(stretch.places(), &block);
        }
        self.ahead = Ahead { block, notes, longest, failed, ..Ahead::default() };
    }

    /// Puts the run's state into the block; false where a step cannot be prepared.
    pub(super) fn load(&mut self, places: &Places, block: &mut [f64]) -> bool {
        let gone = self.gone();
        block[places.time] = gone as f64 * places.interval;
        block[places.time + 1] = gone as f64;
        for (slot, g) in block[places.given..].iter_mut().zip(&self.given) {
            *slot = g.value(self.time);
        }
        for (i, p) in places.clusters.iter().enumerate() {
            let (c, run) = (&self.scene.clusters[i], &mut self.runs[i]);
            if c.period.is_none() {
                if run.step.prepare(p.h).is_err() {
                    return false;
                }
                let now = run.time();
                run.feed.aim(&mut run.input, now, now + p.h);
            }
            run.put(p, block);
            // What is held is found from the inputs, a foretold alpha for each port, and beta.
            put(block, p.input + run.input.len() + self.held[i].len(), &self.beta[i]);
            put(block, p.moved, &self.moved[i]);
            block[p.count] = self.next[i] as f64;
            let Caution { peak, trust, risk, most } = self.caution[i];
            put(block, p.caution, &[peak, trust, risk, most]);
            for (h, q) in self.held[i].iter().zip(&p.held) {
                h.put(q, block);
            }
            for ((b, q), e) in run.books.iter().zip(&p.books).zip(&c.entries) {
                b.put(q, e, block);
            }
        }
        true
    }

    /// Counts intervals that are over.
    pub(super) fn passed(&mut self, places: &Places, n: u64) {
        let sampled = !self.order.is_empty();
        let now = (self.gone() + n) as f64 * places.interval;
        for (i, p) in places.clusters.iter().enumerate() {
            let run = &mut self.runs[i];
            run.steps += n * u64::from(p.steps);
            if self.scene.clusters[i].period.is_some() {
                self.next[i] += n;
                self.held[i].iter_mut().for_each(|h| h.intervals += n);
            } else if sampled {
                run.base = now;
            } else {
                run.count += n;
            }
        }
        if sampled && n > 0 {
            self.time = now;
            self.last_sample = now;
        }
    }

    /// Gets the run's state out of the block.
    pub(super) fn fetch(&mut self, places: &Places, block: &[f64]) {
        for (i, p) in places.clusters.iter().enumerate() {
            let (c, run) = (&self.scene.clusters[i], &mut self.runs[i]);
            run.fetch(p, block);
            fetch(block, p.moved, &mut self.moved[i]);
            let [peak, trust, risk, most] = [0, 1, 2, 3].map(|k| block[p.caution + k]);
            self.caution[i] = Caution { peak, trust, risk, most };
            for (h, q) in self.held[i].iter_mut().zip(&p.held) {
                h.fetch(q, block);
            }
            for ((b, q), e) in run.books.iter_mut().zip(&p.books).zip(&c.entries) {
                b.fetch(q, e, block);
            }
            if c.period.is_some() {
                run.feed.latch(&mut run.input, self.last_sample);
            }
        }
    }

    /// Adds the errors that a stretch noted.
    pub(super) fn take_notes(&mut self, places: &Places, notes: &[f64]) {
        for note in notes.chunks_exact(4) {
            let at = note[0] as usize;
            for (run, p) in self.runs.iter_mut().zip(&places.clusters) {
                for (b, q) in run.books.iter_mut().zip(&p.books) {
                    if q.worst == at {
                        b.worst.put(note[1], note[2], note[3]);
                    } else if q.gained == at {
                        b.gained.put(note[1], note[2], note[3]);
                    }
                }
            }
        }
    }
}

/// Puts numbers into the block.
fn put(block: &mut [f64], at: usize, numbers: &[f64]) {
    block[at..at + numbers.len()].copy_from_slice(numbers);
}

/// Gets numbers out of the block.
fn fetch(block: &[f64], at: usize, numbers: &mut [f64]) {
    numbers.copy_from_slice(&block[at..at + numbers.len()]);
}

/// A sum of the block.
fn sum(block: &[f64], at: usize) -> Sum {
    Sum::of([block[at], block[at + 1]])
}

impl Run {
    fn put(&self, p: &ClusterPlaces, block: &mut [f64]) {
        put(block, p.state, &self.state);
        put(block, p.input, &self.input);
        put(block, p.largest, &self.largest);
        block[p.iterations] = 0.0;
    }

    fn fetch(&mut self, p: &ClusterPlaces, block: &[f64]) {
        fetch(block, p.state, &mut self.state);
        fetch(block, p.input, &mut self.input);
        fetch(block, p.largest, &mut self.largest);
        self.step.work.newton_iterations += block[p.iterations] as u64;
    }
}

impl Held {
    fn put(&self, p: &HeldPlaces, block: &mut [f64]) {
        for (at, x) in [(p.v, self.v), (p.q, self.q), (p.w, self.w), (p.crossed, self.crossed), (p.last_q, self.last_q)]
        {
            block[at] = x;
        }
        put(block, p.alpha, &self.alpha);
        put(block, p.before, &self.before);
        put(block, p.forecast, &[self.forecast, self.off]);
        block[p.intervals] = self.intervals.min(TERMS as u64 + 1) as f64;
        put(block, p.energy, &self.holder_energy.parts());
    }

    fn fetch(&mut self, p: &HeldPlaces, block: &[f64]) {
        (self.v, self.q, self.w) = (block[p.v], block[p.q], block[p.w]);
        (self.crossed, self.last_q) = (block[p.crossed], block[p.last_q]);
        fetch(block, p.alpha, &mut self.alpha);
        fetch(block, p.before, &mut self.before);
        (self.forecast, self.off) = (block[p.forecast], block[p.forecast + 1]);
        self.holder_energy = sum(block, p.energy);
        self.other_energy = self.holder_energy;
    }
}

impl Book {
    fn put(&self, p: &BookPlaces, e: &Entries, block: &mut [f64]) {
        let numbers = [
            (p.h, self.h),
            (p.h_max, self.h_max),
            (p.h_top, self.h_top),
            (p.least, e.least),
            (p.residual, self.residual),
            (p.turnover, self.turnover_max),
            (p.size, self.size_max),
            (p.stored, self.stored),
            (p.stored_max, self.stored_max),
            (p.debt, self.debt_max),
            (p.owed, self.owed),
            (p.crossed, self.crossed_max),
            (p.leaps, self.leaps as f64),
            (p.giver, self.giver.0 as f64),
            (p.giver + 1, self.giver.1),
        ];
        numbers.into_iter().for_each(|(at, x)| block[at] = x);
        for (at, sum) in [(p.supplied, &self.supplied), (p.dissipated, &self.dissipated), (p.leaked, &self.leaked)] {
            put(block, at, &sum.parts());
        }
        self.worst.put_tops(&mut block[p.worst..]);
        self.gained.put_tops(&mut block[p.gained..]);
        for (at, sums, n) in
            [(p.sources, &self.sources, e.supplied.len()), (p.resistors, &self.resistors, e.dissipated.len())]
        {
            if let Some(at) = at {
                sums.iter().take(n).enumerate().for_each(|(k, s)| put(block, at + 2 * k, &s.parts()));
            }
        }
    }

    fn fetch(&mut self, p: &BookPlaces, e: &Entries, block: &[f64]) {
        (self.h, self.h_max, self.h_top) = (block[p.h], block[p.h_max], block[p.h_top]);
        (self.residual, self.turnover_max, self.size_max) = (block[p.residual], block[p.turnover], block[p.size]);
        (self.stored, self.stored_max) = (block[p.stored], block[p.stored_max]);
        (self.debt_max, self.crossed_max) = (block[p.debt], block[p.crossed]);
        self.owed = block[p.owed];
        self.leaps = block[p.leaps] as u64;
        self.giver = (block[p.giver] as usize, block[p.giver + 1]);
        self.supplied = sum(block, p.supplied);
        self.dissipated = sum(block, p.dissipated);
        self.leaked = sum(block, p.leaked);
        self.worst.fetch_tops(&block[p.worst..]);
        self.gained.fetch_tops(&block[p.gained..]);
        let lists = [
            (p.sources, &mut self.sources, e.supplied.len(), self.supplied),
            (p.resistors, &mut self.resistors, e.dissipated.len(), self.dissipated),
        ];
        for (at, sums, n, whole) in lists {
            for (k, s) in sums.iter_mut().take(n).enumerate() {
                *s = at.map_or(whole, |at| sum(block, at + 2 * k));
            }
        }
    }
}

impl Worst {
    fn put_tops(&self, block: &mut [f64]) {
        for (slots, (error, relative)) in block.chunks_exact_mut(2).zip(&self.tops) {
            slots.copy_from_slice(&[*error, *relative]);
        }
    }

    fn fetch_tops(&mut self, block: &[f64]) {
        for (slots, top) in block.chunks_exact(2).zip(&mut self.tops) {
            *top = (slots[0], slots[1]);
        }
    }
}
