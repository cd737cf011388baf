//! Where everything of a scene is in its block of numbers.

use super::block::Block;
use super::ledger;
use super::more::More;
use bond_runtime::ir::Array;
use bond_runtime::scene;
use bond_runtime::simulate::{StartCluster, TERMS};

/// Places of a cluster.
#[derive(Clone, Debug, Default)]
pub(super) struct Cluster {
    pub(super) state: usize,
    /// The inputs of its programs, directly followed by alpha and beta of a matched hold.
    pub(super) input: usize,
    /// The largest value that each state had.
    pub(super) largest: usize,
    /// What each port gave out since it was collected.
    pub(super) moved: usize,
    /// Of a sampled one, the number of its next sample, and intervals left to it.
    pub(super) count: usize,
    pub(super) left: usize,
    pub(super) held: Vec<Held>,
    /// What it risks where it is in debt: the largest debt, what is trusted, the risk, the largest risk.
    pub(super) caution: usize,
    /// One ledger for each of its regions.
    pub(super) books: Vec<usize>,
    /// What a run within this program keeps besides, for each of its regions.
    pub(super) more: Vec<More>,
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
}

/// Places of a held port.
#[derive(Clone, Debug, Default)]
pub(super) struct Held {
    pub(super) v: usize,
    pub(super) q: usize,
    pub(super) w: usize,
    pub(super) last_q: usize,
    /// One more than `TERMS` each.
    pub(super) alpha: usize,
    pub(super) before: usize,
    /// What alpha is foretold to be, and what forecasts were off by.
    pub(super) forecast: usize,
    pub(super) intervals: usize,
    /// What crossed in the interval that ended last, and in all (two numbers); only of a run within this program.
    pub(super) crossed: usize,
    pub(super) energy: usize,
}

impl Cluster {
    /// Its places; `full` where all is kept that `bond_runtime::simulate` keeps.
    pub(super) fn new(block: &mut Block, c: &scene::Cluster, start: &StartCluster, full: bool) -> Self {
        let n = start.held.len();
        block.align(start.state.len());
        let state = block.put(&start.state);
        // Sizes of states that nobody looks at are the last inputs; what goes by all of them has them all.
        let looked = if full || n > 0 || c.is_traced() { start.input.len() } else { c.traces_at() };
        let input = block.put(&start.input[..looked]);
        block.take(n); // alpha
        block.put(&start.beta);
        let traced = if c.is_traced() { c.states } else { 0 };
        let sizes: Vec<f64> = start.state[..traced].iter().map(|x| x.abs()).collect();
        let largest = block.put(&sizes);
        let moved = block.take(c.ports.len());
        let count = block.put(&[if c.period.is_some() { 1.0 } else { 0.0 }]);
        let left = block.take(1);
        let held = start
            .held
            .iter()
            .map(|h| Held {
                v: block.put(&[h.value]),
                q: block.take(1),
                w: block.take(1),
                last_q: block.take(1),
                alpha: block.take(TERMS + 1),
                before: block.take(TERMS + 1),
                forecast: block.put(&[h.forecast, 0.0]),
                intervals: block.take(1),
                crossed: block.take(usize::from(full)),
                energy: block.take(if full { 2 } else { 0 }),
            })
            .collect();
        let caution = block.put(&[0.0, 1.0, start.risk, start.most]);
        let books =
            start.energies.iter().zip(&start.least).map(|(h, least)| block.put(&ledger::start(*h, *least))).collect();
        let more = if full { c.entries.iter().map(|e| More::new(block, c, e)).collect() } else { Vec::new() };
        let iterations = full.then(|| block.take(1));
        Self {
            state,
            input,
            largest,
            moved,
            count,
            left,
            held,
            caution,
            books,
            more,
            iterations,
            table: 0,
            next: 0,
            output: 0,
            seen: 0,
            called: 0,
        }
    }

    /// Gives what a step works out its places.
    pub(super) fn work(&mut self, block: &mut Block, c: &scene::Cluster, start: &StartCluster) {
        block.align(start.state.len());
        self.next = block.take(start.state.len());
        self.output = block.take(c.step.program.size(Array::Output));
        self.seen = block.take(c.instant.size(Array::Output));
        self.called = block.take(c.respond.as_ref().map_or(0, |r| {
            let (p, q) = super::programs(r);
            p.size(Array::Output).max(q.map_or(0, |q| q.size(Array::Output)))
        }));
    }
}
