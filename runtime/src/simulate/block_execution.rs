//! Block execution: many intervals of a run by one compiled routine, where nobody looks between them. It gives the same
//! bits as a run interval by interval.

use super::block_routine::{BlockExecution, BlockRoutine, ClusterPlaces, Places};
use super::cluster::Run;
use super::schedule::Simulation;
use super::start::{Start, StartCluster, StartHeld};
use crate::energy::Place;

/// Fewer intervals than this are not worth copying the state.
pub(super) const LEAST: u64 = 4;
/// After so many blocks that failed, no more are tried where they go on for fewer intervals than [`WORTH`] each: the
/// one that fails is run twice.
pub(super) const FAILED: u64 = 50;
const WORTH: u64 = 8;
/// Notes that a block may leave.
pub(super) const NOTES: u64 = 8192;

impl Simulation<'_> {
    /// What it starts from, or goes on from.
    pub fn start(&self) -> Start {
        let number = |i: usize, at: Place| self.runs[i].ledger.get(at);
        let cluster = |i: usize| StartCluster {
            state: self.runs[i].state.clone(),
            input: self.runs[i].input.clone(),
            energies: self.runs[i].layout.accounts.iter().map(|p| number(i, p.h)).collect(),
            connected: self.connected[i],
            held: self.held[i]
                .iter()
                .zip(&self.runs[i].layout.held)
                .map(|(h, p)| StartHeld { port: p.port, bar: h.bar, open: h.open, value: number(i, p.v) })
                .collect(),
            port_admittance: self.port_admittance[i].clone(),
            delayed_response: self.delayed_response[i].clone(),
            ar_coefficients: self.ar_coefficients[i].clone(),
        };
        Start {
            clusters: (0..self.runs.len()).map(cluster).collect(),
            order: self.order.clone(),
            read: self.read.clone(),
            probed: self.probed.clone(),
            takes_tangents: self.takes_tangents(),
        }
    }

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

    /// Goes as far towards an instant as can be gone at once; nowhere where something lies between. Whether an interval
    /// has to be gone step by step, after which that can be tried again.
    pub(super) fn run_blocks(&mut self, until: f64) -> bool {
        let none = self.block_execution.maker.is_none() && self.block_execution.routine.is_none();
        // What is drawn within a block is not seen.
        if none || !self.scene.watched.is_empty() || self.looks_within() || self.takes_tangents() {
            return false;
        }
        let wanted = self.reach(until);
        if wanted < LEAST {
            return false;
        }
        if let Some(maker) = &self.block_execution.maker {
            self.block_execution.missed += wanted;
            if self.block_execution.missed < maker.worth {
                return false;
            }
            let made = (maker.make)(self.scene, &self.options, &self.start());
            self.block_execution.maker = None;
            self.block_execution.routine = made.filter(|s| self.alike(s.places()));
            let Some(routine) = &self.block_execution.routine else { return false };
            let places = routine.places();
            let each = places.notes().max(1);
            self.block_execution.longest = (NOTES / each).max(1);
            self.block_execution.notes = vec![0.0; 4 * (self.block_execution.longest * each) as usize];
            self.block_execution.block.clone_from(&places.image);
        }
        let Some(mut routine) = self.block_execution.routine.take() else { return false };
        let failed = self.block_execution.failed;
        if self.ready(routine.places()) {
            self.go(routine.as_mut(), wanted);
        }
        let BlockExecution { failed: now, gone, .. } = self.block_execution;
        if now < FAILED || gone >= WORTH * now {
            self.block_execution.routine = Some(routine);
        }
        now > failed
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
            same(&p.port_admittance, &self.port_admittance[i])
                && same(&p.delayed_response, &self.delayed_response[i])
                && same(&p.ar_coefficients, &self.ar_coefficients[i])
        })
    }

    /// Whether the run stands where a routine can go on.
    pub(super) fn ready(&self, places: &Places) -> bool {
        let sampled = !self.order.is_empty();
        let (gone, now) = (self.gone(), if sampled { self.last_sample } else { self.gone() as f64 * places.interval });
        let clusters = self.scene.clusters.iter().zip(&self.runs).zip(&places.clusters).enumerate();
        let mut steps = clusters.map(|(i, ((c, run), p))| {
            let grid = match (c.period, sampled) {
                (Some(_), _) => self.next[i] == gone + 1,
                (None, true) => run.h == p.h && run.count == 0 && run.base == now,
                (None, false) => run.h == p.h && run.count == gone && run.base == 0.0,
            };
            let held = self.held[i].iter().all(|h| !h.silent);
            grid && held && run.signals.is_settled(now) && self.moved[i].len() == c.ports.len()
        });
        (!sampled || gone as f64 * places.interval == now)
            && self.given.iter().all(|g| g.is_settled(now))
            && steps.all(|good| good)
    }

    /// Goes on by a routine.
    fn go(&mut self, routine: &mut dyn BlockRoutine, mut wanted: u64) {
        let BlockExecution { mut block, mut notes, longest, mut failed, gone: mut done, .. } =
            std::mem::take(&mut self.block_execution);
        if self.load(routine.places(), &mut block) {
            while wanted > 0 {
                let part = wanted.min(longest);
                let (gone, noted) = routine.run(&mut block, part, &mut notes);
                self.take_notes(routine.places(), &notes[..4 * noted]);
                self.passed(routine.places(), gone);
                wanted -= part;
                done += gone;
                if gone < part {
                    failed += 1;
                    break;
                }
            }
            self.fetch(routine.places(), &block);
        }
        self.block_execution =
            BlockExecution { block, notes, longest, failed, gone: done, ..BlockExecution::default() };
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
                run.signals.aim(&mut run.input, now, now + p.h);
            }
            run.put(p, block);
            // What is held is found from the inputs, the predicted free response of each port, and the port admittance.
            put(block, p.input + run.input.len() + self.held[i].len(), &self.port_admittance[i]);
            put(block, p.moved, &self.moved[i]);
            block[p.count] = self.next[i] as f64;
            let numbers = &self.runs[i].ledger.numbers;
            block[p.ledger..].iter_mut().zip(numbers).for_each(|(to, x)| *to = x.get());
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
            block[p.ledger..].iter().zip(&run.ledger.numbers).for_each(|(x, to)| to.set(*x));
            if c.period.is_some() {
                run.signals.latch(&mut run.input, self.last_sample);
            }
        }
    }

    /// Notes the errors that a routine left.
    pub(super) fn take_notes(&mut self, places: &Places, notes: &[f64]) {
        for note in notes.chunks_exact(4) {
            let mut log = note[0] as usize;
            for (run, p) in self.runs.iter().zip(&places.clusters) {
                if log < p.logs {
                    run.ledger.note(log, [note[1], note[2], note[3]]);
                    break;
                }
                log -= p.logs;
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
