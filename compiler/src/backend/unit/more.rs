//! What a run within this program keeps of a region besides its ledger: as `bond_runtime::simulate` does.

use super::block::Block;
use crate::backend::code::{Cond, Reason, Stmt, Value};
use crate::backend::lower::writer::Writer;
use bond_runtime::scene::{self, Entries};

/// Places of it.
#[derive(Clone, Debug, Default)]
pub(super) struct More {
    /// The most that it ever had to give.
    pub(super) stored: usize,
    /// The largest energy that crossed its ports in an interval.
    pub(super) crossed: usize,
    /// The largest debt beside the energies that were there then.
    pub(super) owed: usize,
    /// Leaps so far.
    pub(super) leaps: usize,
    /// Which resistor gave most in a step, and how much.
    pub(super) giver: usize,
    /// The errors on top: two pairs each.
    pub(super) worst: usize,
    pub(super) gained: usize,
    /// A sum of two numbers for each source and resistor; None where the only one has the region's own.
    pub(super) sources: Option<usize>,
    pub(super) resistors: Option<usize>,
}

impl More {
    pub(super) fn new(block: &mut Block, c: &scene::Cluster, e: &Entries) -> Self {
        let alone = c.holds.is_empty();
        Self {
            stored: block.take(1),
            crossed: block.take(1),
            owed: block.take(1),
            leaps: block.take(1),
            giver: block.take(2),
            worst: block.take(4),
            gained: block.take(4),
            sources: (!alone || e.supplied.len() > 1).then(|| block.take(2 * e.supplied.len())),
            resistors: (e.dissipated.len() > 1).then(|| block.take(2 * e.dissipated.len())),
        }
    }

    /// Which resistor gave most, where one gave.
    pub(super) fn giver(&self, w: &mut Writer, output: usize, e: &Entries) {
        for (k, (_, slot)) in e.dissipated.iter().enumerate() {
            let (x, most) = (w.kept(output + slot), w.kept(self.giver + 1));
            let more = w.lt(x, most);
            w.when(more, |w| {
                let k = w.number(k as f64);
                w.keep(self.giver, k);
                w.keep(self.giver + 1, x);
            });
        }
    }

    /// Notes an error that is above those on top.
    pub(super) fn worst(
        &self,
        w: &mut Writer,
        at: usize,
        error: Value,
        scale: Value,
        floor: impl FnOnce(&mut Writer) -> Value,
        gross: Option<f64>,
    ) {
        let below = |w: &mut Writer, top: usize| {
            let (e, r) = (w.kept(top), w.kept(top + 1));
            let allowed = w.mul(r, scale);
            Cond::all([w.le(error, e), w.le(error, allowed)])
        };
        let known = Cond::any([below(w, at), below(w, at + 2)]);
        w.when(known.not(), |w| {
            let zero = w.number(0.0);
            let relative = w.div(error, scale);
            let some = w.lt(zero, error);
            let relative = w.select(some, relative, zero);
            let (e, r) = (w.kept(at), w.kept(at + 3));
            let (larger, worse) = (w.lt(e, error), w.lt(r, relative));
            for (more, at) in [(larger, at), (worse, at + 2)] {
                w.when(more, |w| {
                    w.keep(at, error);
                    w.keep(at + 1, relative);
                });
            }
            let floor = floor(w);
            fail_above(w, error, scale, floor, gross);
            let which = w.number(at as f64);
            w.push(Stmt::Note([which, error, scale, floor]));
        });
    }
}

/// Fails where an error is above a part of its scale.
pub(super) fn fail_above(w: &mut Writer, error: Value, scale: Value, floor: Value, part: Option<f64>) {
    if let Some(part) = part {
        let scale = w.larger(scale, floor);
        let part = w.number(part);
        let most = w.mul(part, scale);
        let gross = w.lt(most, error);
        w.when(gross, |w| w.push(Stmt::Fail(Reason::NotFinite)));
    }
}
