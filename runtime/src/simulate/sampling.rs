//! What a sample of a cluster reads and writes, and the room that it works in.

use super::cluster::Run;
use crate::energy::{AR_COEFFICIENTS, AR_ORDER, Memory, Place, PortResponse, Responses};
use crate::kernel::Failure;
use crate::machine::{Exit, Flow, Real};
use std::cell::Cell;

/// Room for what a sample works out, so that taking one allocates nothing.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) due: Vec<usize>,
    /// The same, by cluster.
    pub(super) is_due: Vec<bool>,
    pub(super) free_response: Vec<f64>,
    pub(super) ahead: Vec<Cell<f64>>,
    pub(super) values: Vec<f64>,
    pub(super) q: Vec<f64>,
}

impl Scratch {
    /// For so many clusters, and ports held by one of them.
    pub(super) fn new(clusters: usize, ports: usize) -> Self {
        let room = || Vec::with_capacity(ports);
        Self {
            due: Vec::with_capacity(clusters),
            is_due: vec![false; clusters],
            free_response: room(),
            ahead: Vec::new(),
            values: room(),
            q: room(),
        }
    }
}

/// What a sample of a cluster reads and writes.
#[derive(Clone, Copy)]
pub(super) struct Sampling<'s> {
    pub(super) runs: &'s [Run],
    pub(super) cluster: usize,
    /// The cluster's own block.
    pub(super) own: &'s [Cell<f64>],
    /// How the other sides respond to what it holds, in the order of [`PortResponse`].
    pub(super) responses: [&'s [f64]; 3],
}

impl<'s> Memory<Real<'s>> for Sampling<'s> {
    fn load(self, at: Place) -> f64 {
        if at.cluster == self.cluster { self.own[at.at].get() } else { self.runs[at.cluster].ledger.get(at) }
    }

    fn store(self, at: Place, x: f64) {
        if at.cluster == self.cluster {
            self.own[at.at].set(x);
        } else {
            self.runs[at.cluster].ledger.set(at, x);
        }
    }

    fn output(self, slot: usize) -> f64 {
        self.runs[self.cluster].output()[slot]
    }

    fn fold<const N: usize>(
        self,
        slots: &[(String, usize)],
        start: [f64; N],
        body: impl Fn(f64, [f64; N]) -> [f64; N],
    ) -> [f64; N] {
        slots.iter().fold(start, |so_far, (_, slot)| body(self.output(*slot), so_far))
    }

    fn note(self, log: usize, _: Place, numbers: [f64; 3]) {
        self.runs[self.cluster].ledger.note(log, numbers);
    }

    fn require(self, holds: bool, failure: Failure) -> Flow {
        if holds { Ok(()) } else { Err(Exit::Fail(failure)) }
    }
}

impl<'s> Responses<Real<'s>> for Sampling<'s> {
    fn response(self, _: usize, which: PortResponse, at: usize) -> f64 {
        self.responses[which as usize][at]
    }

    fn ar_order(self, _: usize, port: usize) -> Option<usize> {
        Some(self.responses[PortResponse::ArCoefficients as usize][port * AR_COEFFICIENTS + AR_ORDER + 1] as usize)
    }
}
