//! A compiled routine that runs many intervals of a scene: where it has its numbers, what makes it, and where a run
//! stands with it.

use super::Options;
use super::start::Start;
use crate::scene::Scene;
use std::sync::Arc;

/// Places in its block.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// What the block holds at the start of a run.
    pub image: Vec<f64>,
    /// The time, s, and how many intervals are over.
    pub time: usize,
    /// Values of the signals given from outside, in the scene's order.
    pub given: usize,
    /// Length of an interval, s: the period of what is sampled, or the step where nothing is.
    pub interval: f64,
    /// By cluster.
    pub clusters: Vec<ClusterPlaces>,
}

impl Places {
    /// How many notes an interval can leave.
    pub fn notes(&self) -> u64 {
        self.clusters.iter().map(|c| u64::from(c.steps) * c.logs as u64).sum()
    }
}

/// Places of a cluster.
#[derive(Clone, Debug, Default)]
pub struct ClusterPlaces {
    /// The state.
    pub state: usize,
    /// The inputs of its step.
    pub input: usize,
    /// The largest value of each state.
    pub largest: usize,
    /// What each port gave out since it was collected.
    pub moved: usize,
    /// Of a sampled one, the number of its next sample.
    pub count: usize,
    /// Iterations so far.
    pub iterations: usize,
    /// Length of a step, s; no place.
    pub h: f64,
    /// Steps an interval; no place.
    pub steps: u32,
    /// What the routine takes for the answer of what is held, as in [`super::StartCluster`]; no places.
    pub port_admittance: Vec<f64>,
    /// See above.
    pub delayed_response: Vec<f64>,
    /// See above.
    pub ar_coefficients: Vec<f64>,
    /// The numbers of its ledger, in the order of a [`crate::energy::Layout`].
    pub ledger: usize,
    /// How many logs of errors it has; no place.
    pub logs: usize,
}

/// A compiled routine that runs many intervals of a scene.
pub trait BlockRoutine: Send + Sync {
    /// Where it has its numbers.
    fn places(&self) -> &Places;

    /// Goes so many intervals on, from what is in the block to what is in it then. Gives how many it went: fewer where
    /// one fails, which then is as if it had not begun; and how many of the notes it left: for each error that may be
    /// the worst, four numbers, the place of those on top that it was compared with, the error, its scale and the
    /// floor.
    fn run(&mut self, block: &mut [f64], intervals: u64, notes: &mut [f64]) -> (u64, usize);
}

/// Makes the routine of a scene that is run with these options and stands here; None where it has no such form.
pub type MakeBlock = dyn Fn(&Scene, &Options, &Start) -> Option<Box<dyn BlockRoutine>> + Send + Sync;

/// Makes the routine of a scene, where that is worth it.
#[derive(Clone)]
pub struct BlockMaker {
    /// Makes it.
    pub make: Arc<MakeBlock>,
    /// So many intervals that could be gone through at once make up for the time that making it takes.
    pub worth: u64,
}

/// Where a run stands with it.
#[derive(Default)]
pub(super) struct BlockExecution {
    pub(super) maker: Option<BlockMaker>,
    pub(super) routine: Option<Box<dyn BlockRoutine>>,
    /// Intervals that could have been gone through at once.
    pub(super) missed: u64,
    pub(super) block: Vec<f64>,
    pub(super) notes: Vec<f64>,
    /// Most intervals of a block.
    pub(super) longest: u64,
    /// Blocks that failed, and intervals that were gone through by blocks.
    pub(super) failed: u64,
    pub(super) gone: u64,
}

impl BlockExecution {
    pub(super) fn new(maker: Option<BlockMaker>) -> Self {
        Self { maker, ..Self::default() }
    }
}
