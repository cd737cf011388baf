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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::hold::Holder;
    use crate::energy::testing::{account, at};
    use crate::energy::{HeldPlaces, Layout, StakePlaces};

    /// What a cluster that holds two ports keeps: its account, what was at stake, and then the ports.
    fn two_ports() -> Layout {
        let held = |port: usize| {
            let first = 20 + port * (6 + 2 * (AR_ORDER + 2));
            HeldPlaces {
                port,
                is_thermal: false,
                v: at(first),
                q: at(first + 1),
                w: at(first + 2),
                last_q: at(first + 3),
                intervals: at(first + 4),
                crossed: at(first + 5),
                free_response: at(first + 6),
                before: at(first + 8 + AR_ORDER),
                counts: None,
            }
        };
        let stake = StakePlaces { most: at(18), releases: None, reserve: None, shortened: None };
        Layout { size: 60, logs: 0, held: vec![held(0), held(1)], stake, accounts: vec![account()] }
    }

    /// Two values are scaled down along their ray until what they give out, v (Y v - a), is just what there is; what
    /// gives out less stays as it is.
    #[test]
    fn two_values_give_out_just_what_there_is() {
        let layout = two_ports();
        let own: Vec<Cell<f64>> = vec![Cell::new(0.0); layout.size];
        let admittance = [2.0, 0.5, -1.0, 3.0];
        let sampling = Sampling { runs: &[], cluster: 0, own: &own, responses: [&admittance, &[], &[]] };
        let holder = Holder { cluster: 0, layout: &layout };
        let free = [1.0, -1.0];
        let given = |v: [f64; 2]| {
            let yielded = [0, 1].map(|i| admittance[2 * i] * v[0] + admittance[2 * i + 1] * v[1]);
            v[0] * (yielded[0] - free[0]) + v[1] * (yielded[1] - free[1])
        };
        let wanted = [1.0, 2.0];
        for there in [0.0, 1e-6, 0.25, 4.0, given(wanted), 2.0 * given(wanted)] {
            own[layout.accounts[0].stored.at].set(there);
            let mut v = wanted;
            holder.within_budget(Real::new(), sampling, &mut v, &free, 0.0);
            assert!((v[1] - 2.0 * v[0]).abs() < 1e-15 && v[0] <= 1.0, "{there}: {v:?}");
            assert!((given(v) - there.min(given(wanted))).abs() < 1e-13, "{there}: {v:?} give {}", given(v));
        }
    }

    /// How far the other sides give way is a product with the port admittance.
    #[test]
    fn the_other_sides_give_way_by_their_admittance() {
        let layout = two_ports();
        let own: Vec<Cell<f64>> = vec![Cell::new(0.0); layout.size];
        let admittance = [2.0, 0.5, -1.0, 3.0];
        let sampling = Sampling { runs: &[], cluster: 0, own: &own, responses: [&admittance, &[], &[]] };
        let holder = Holder { cluster: 0, layout: &layout };
        for (port, x) in [(0, 1.0), (1, 10.0)] {
            own[layout.held[port].v.at].set(x);
        }
        let found = [0, 1].map(|port| holder.yielded_now(Real::new(), sampling, port));
        assert_eq!(found, [7.0, 29.0]);
    }
}
