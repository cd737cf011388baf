//! Runs of several scenes of one code shape, taken through whole stretches side by side: the same bits as one after
//! the other.

use super::ahead::{FAILED, LEAST, NOTES};
use super::{Places, Simulation};
use crate::kernel::Backend;

/// What goes through stretches of several scenes of one code shape at once.
pub trait SimdLanes: Send {
    /// Where the numbers of one of them are.
    fn places(&self, lane: usize) -> &Places;

    /// Goes so many intervals on in each, from what is in its block to what is in it then. Gives how many all of them
    /// went: fewer where one fails, which then is as if it had not begun. What each noted is added to its notes, as
    /// [`super::Stretch::run`] says.
    fn run(&mut self, blocks: &mut [Vec<f64>], intervals: u64, notes: &mut [Vec<f64>]) -> u64;
}

/// Runs that go on side by side.
pub struct Batch {
    lanes: Box<dyn SimdLanes>,
    blocks: Vec<Vec<f64>>,
    notes: Vec<Vec<f64>>,
    /// Intervals of a stretch at most.
    longest: u64,
    /// Stretches that failed.
    failed: u32,
}

impl Batch {
    /// For these runs, which are to go on to that instant, s; None where their code shapes differ, or they would not be
    /// sooner there.
    pub fn new(backend: &dyn Backend, runs: &[&Simulation<'_>], until: f64) -> Option<Self> {
        let intervals = runs.iter().map(|run| run.reach(until)).min()?;
        let scenes: Vec<_> = runs.iter().map(|run| (run.scene, &run.options, run.start())).collect();
        let lanes = backend.batch(&scenes, intervals)?;
        if !runs.iter().enumerate().all(|(k, run)| run.alike(lanes.places(k))) {
            return None;
        }
        let blocks = (0..runs.len()).map(|k| lanes.places(k).image.clone()).collect();
        let each = lanes.places(0).notes().max(1);
        let longest = (NOTES / each).max(1);
        let notes = runs.iter().map(|_| Vec::with_capacity(4 * (longest * each) as usize)).collect();
        Some(Self { lanes, blocks, notes, longest, failed: 0 })
    }

    /// Goes with all of them as far towards an instant, s, as can be gone at once: nowhere where something lies
    /// between, or where they do not stand side by side. They are those that it was made for, in their order.
    pub fn leap(&mut self, runs: &mut [&mut Simulation<'_>], until: f64) {
        let Self { lanes, blocks, notes, longest, failed } = self;
        let mut left = runs.first().map_or(0, |run| run.reach(until));
        let together = runs.len() == blocks.len()
            && runs.iter().enumerate().all(|(k, run)| run.reach(until) == left && run.ready(lanes.places(k)));
        if left < LEAST || *failed >= FAILED || !together {
            return;
        }
        let mut loaded = runs.iter_mut().zip(blocks.iter_mut()).enumerate();
        if !loaded.all(|(k, (run, block))| run.load(lanes.places(k), block)) {
            return;
        }
        while left > 0 {
            let part = left.min(*longest);
            notes.iter_mut().for_each(Vec::clear);
            let gone = lanes.run(blocks, part, notes);
            for (k, (run, notes)) in runs.iter_mut().zip(&*notes).enumerate() {
                run.take_notes(lanes.places(k), notes);
                run.passed(lanes.places(k), gone);
            }
            left -= part;
            if gone < part {
                *failed += 1;
                break;
            }
        }
        for (k, (run, block)) in runs.iter_mut().zip(&*blocks).enumerate() {
            run.fetch(lanes.places(k), block);
        }
    }
}
