//! The ledgers and holds of a scene in its block: what `bond_runtime::energy` does to them, as statements.

use super::Writing;
use crate::backend::code::{Cond, Memory as Array, Place as Slot, Reason, Stmt};
use crate::backend::lower::recorder::{Recorded, Recorder};
use crate::backend::lower::writer::{At, Writer, scratch};
use bond_runtime::Failure;
use bond_runtime::energy::hold::Holder;
use bond_runtime::energy::{
    AR_COEFFICIENTS, AR_ORDER, Layout, Memory, Place, PortResponse, Responses, account, interval,
};
use bond_runtime::machine::{Flow, Machine, Variable};
use bond_runtime::scene::Cluster;

/// Fewer outputs are gone through one after the other.
const ROLLED: usize = 64;

/// A cluster's part of the block, to be read and written.
#[derive(Clone, Copy)]
pub(super) struct Block<'r> {
    by: &'r Recorder,
    of: &'r Writing<'r>,
    cluster: usize,
}

impl<'r> Block<'r> {
    fn slot(self, at: Place) -> usize {
        self.of.clusters[at.cluster].at(at)
    }
}

impl<'r> Memory<&'r Recorder> for Block<'r> {
    fn load(self, at: Place) -> Recorded<'r> {
        self.by.value(self.by.with(|w| w.kept(self.slot(at))))
    }

    fn store(self, at: Place, x: Recorded<'r>) {
        self.by.with(|w| w.keep(self.slot(at), x.value));
    }

    fn output(self, slot: usize) -> Recorded<'r> {
        self.by.value(self.by.with(|w| w.kept(self.of.clusters[self.cluster].output + slot)))
    }

    /// Outputs that stand in a row, where they are many, are gone through by a loop, but for where each has a sum.
    fn fold<const N: usize>(
        self,
        slots: &[(String, usize)],
        start: [Recorded<'r>; N],
        body: impl Fn(Recorded<'r>, [Recorded<'r>; N]) -> [Recorded<'r>; N],
    ) -> [Recorded<'r>; N] {
        let first = slots.first().map_or(0, |s| s.1);
        let row = slots.iter().enumerate().all(|(k, (_, slot))| *slot == first + k);
        if slots.len() < ROLLED || !row || self.of.full {
            return slots.iter().fold(start, |so_far, (_, slot)| body(self.output(*slot), so_far));
        }
        let (sums, base) = (start.map(|x| self.by.holding(x)), self.of.clusters[self.cluster].output + first);
        self.by.each(slots.len(), |at: At| {
            let place = Slot { memory: Array::State, ..scratch(base as u32, at) };
            let x = self.by.value(self.by.with(|w| w.load(place)));
            let now = std::array::from_fn(|k| sums[k].get());
            sums.iter().zip(body(x, now)).for_each(|(sum, x)| sum.set(x));
        });
        sums.map(|sum| sum.get())
    }

    fn note(self, log: usize, _: Place, numbers: [Recorded<'r>; 3]) {
        let before: usize = self.of.clusters[..self.cluster].iter().map(|c| c.layout.logs).sum();
        let [error, scale, floor] = numbers.map(|x| x.value);
        self.by.with(|w| {
            let log = w.number((before + log) as f64);
            w.push(Stmt::Note([log, error, scale, floor]));
        });
    }

    fn require(self, holds: Cond, failure: Failure) -> Flow {
        let reason = match failure {
            Failure::GrossBalance => Reason::GrossBalance,
            _ => Reason::NotFinite,
        };
        self.by.only(holds.not(), || self.by.with(|w| w.push(Stmt::Fail(reason))));
        Ok(())
    }
}

impl<'r> Responses<&'r Recorder> for Block<'r> {
    fn response(self, cluster: usize, which: PortResponse, at: usize) -> Recorded<'r> {
        self.by.value(self.by.with(|w| self.of.response(w, cluster, which, at)))
    }

    fn ar_order(self, cluster: usize, port: usize) -> Option<usize> {
        let order = self.response(cluster, PortResponse::ArCoefficients, port * AR_COEFFICIENTS + AR_ORDER + 1);
        self.by.with(|w| w.known(order.value)).map(|order| order as usize)
    }
}

impl Writing<'_> {
    /// Does something with a cluster's part of the block.
    pub(super) fn on<R>(
        &self,
        w: &mut Writer,
        cluster: usize,
        f: impl for<'r> FnOnce(&'r Recorder, Block<'r>) -> R,
    ) -> R {
        let recorder = Recorder::new(std::mem::take(w));
        let result = f(&recorder, Block { by: &recorder, of: self, cluster });
        *w = recorder.into_writer();
        result
    }

    /// A sampled cluster and its places.
    pub(super) fn holder(&self, cluster: usize) -> Holder<'_> {
        Holder { cluster, layout: &self.clusters[cluster].layout }
    }

    /// The clusters and their places.
    pub(super) fn layouts(&self) -> impl Iterator<Item = (&Cluster, &Layout)> + Clone {
        self.scene.clusters.iter().zip(self.clusters.iter().map(|place| &place.layout))
    }

    /// Books the step whose outputs are in the block.
    pub(super) fn book_step(&self, w: &mut Writer, i: usize) {
        let c = &self.scene.clusters[i];
        let how = (c.period.is_some(), c.step.linear.is_some());
        self.on(w, i, |m, block| {
            for (e, p) in c.entries.iter().zip(&self.clusters[i].layout.accounts) {
                // Statements leave nothing.
                let _ = account::book_step(m, block, e, p, how);
            }
        });
    }

    /// Books what crossed held ports, and what was learned from that.
    pub(super) fn settle(&self, w: &mut Writer, i: usize) {
        self.on(w, i, |m, block| {
            interval::settle(m, block, i, self.layouts());
            (0..self.clusters[i].layout.held.len()).for_each(|k| self.holder(i).learn(m, block, k));
        });
    }
}
