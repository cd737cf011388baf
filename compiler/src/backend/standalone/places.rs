//! Where everything of a scene is in its block of numbers.

use super::block::Block;
use super::delay_line::DelayLine;
use super::past::Past;
use bond_runtime::energy::{Layout, Place};
use bond_runtime::ir::Array;
use bond_runtime::scene;
use bond_runtime::simulate::StartCluster;

/// Places of a cluster.
#[derive(Clone, Debug)]
pub(super) struct Cluster {
    pub(super) state: usize,
    /// The inputs of its programs, directly followed by the free responses and the port admittance of a matched hold.
    pub(super) input: usize,
    /// The largest value that each state had.
    pub(super) largest: usize,
    /// What each port gave out since it was collected.
    pub(super) moved: usize,
    /// Of a sampled one, the number of its next sample, and intervals left to it.
    pub(super) count: usize,
    pub(super) left: usize,
    /// What is on its way in its delays.
    pub(super) lines: Vec<DelayLine>,
    /// What signals were that are delayed in continuous time.
    pub(super) pasts: Vec<Past>,
    /// Where the first number of its ledger is, and where the others are from there.
    pub(super) ledger: usize,
    pub(super) layout: Layout,
    /// Iterations of its steps so far; only of a run within this program.
    pub(super) iterations: Option<usize>,
    /// Where its numbers are in the table.
    pub(super) table: usize,
    /// What a step works out, and nothing reads later: the next state and what else it gives.
    pub(super) next: usize,
    pub(super) output: usize,
    /// What its observation and its hold give, to be read at once.
    pub(super) seen: usize,
    pub(super) called: usize,
    /// What a shorter step from its beginning gives, where steps are taken down.
    pub(super) glanced: usize,
    pub(super) glanced_output: usize,
}

impl Cluster {
    /// Its places, for steps of a length, and with the one that was asked for; `full` where all is kept that
    /// `bond_runtime::simulate` keeps.
    pub(super) fn new(
        block: &mut Block,
        (index, c): (usize, &scene::Cluster),
        (start, steps): (&StartCluster, (f64, f64)),
        full: bool,
    ) -> Self {
        let n = start.held.len();
        block.align(start.state.len());
        let state = block.put(&start.state);
        // Sizes of states that nobody looks at are the last inputs; what goes by all of them has them all.
        let looked = if full || n > 0 || c.is_traced() { start.input.len() } else { c.traces_at() };
        let input = block.put(&start.input[..looked]);
        block.take(n); // free responses
        block.put(&start.port_admittance);
        let traced = if c.is_traced() { c.states } else { 0 };
        let sizes: Vec<f64> = start.state[..traced].iter().map(|x| x.abs()).collect();
        let largest = block.put(&sizes);
        let moved = block.take(c.ports.len());
        let count = block.put(&[if c.period.is_some() { 1.0 } else { 0.0 }]);
        let left = block.take(1);
        let lines = DelayLine::all(block, c);
        let pasts = Past::all(block, c, steps);
        let layout = Layout::new(index, c, full);
        let mut numbers = layout.start(c, start.energies.iter().copied());
        for (h, p) in start.held.iter().zip(&layout.held) {
            numbers[p.v.at] = h.value;
        }
        let ledger = block.put(&numbers);
        let iterations = full.then(|| block.take(1));
        Self {
            state,
            input,
            largest,
            moved,
            count,
            left,
            lines,
            pasts,
            ledger,
            layout,
            iterations,
            table: 0,
            next: 0,
            output: 0,
            seen: 0,
            called: 0,
            glanced: 0,
            glanced_output: 0,
        }
    }

    /// Where a number of its ledger is.
    pub(super) fn at(&self, place: Place) -> usize {
        self.ledger + place.at
    }

    /// Gives what a step works out its places.
    pub(super) fn work(&mut self, block: &mut Block, c: &scene::Cluster, start: &StartCluster) {
        block.align(start.state.len());
        self.next = block.take(start.state.len());
        self.output = block.take(c.step.program.size(Array::Output));
        self.seen = block.take(c.instant.size(Array::Output));
        if !self.pasts.is_empty() {
            self.glanced = block.take(start.state.len());
            self.glanced_output = block.take(c.step.program.size(Array::Output));
            self.pasts.iter_mut().for_each(|p| p.work(block));
        }
        let programs = c.respond.iter().flat_map(scene::Respond::programs);
        self.called = block.take(programs.map(|p| p.size(Array::Output)).max().unwrap_or(0));
    }
}
