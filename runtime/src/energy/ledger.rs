//! The ledger of a cluster that runs.

use super::{AccountPlaces, ErrorPlaces, Layout, Memory, Place, Worst, account};
use crate::kernel::Failure;
use crate::ledger::Sum;
use crate::machine::{Exit, Flow, Real};
use crate::scene::Cluster;
use serde::{Deserialize, Serialize};
use std::cell::{Cell, RefCell};

/// The numbers of a cluster's accounts and holds, in the order of a [`Layout`], and what its errors are.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Ledger {
    pub(crate) numbers: Vec<Cell<f64>>,
    errors: RefCell<Vec<Worst>>,
}

impl Ledger {
    /// That of a cluster whose regions start with these energies, J.
    pub(crate) fn new(layout: &Layout, c: &Cluster, energies: impl IntoIterator<Item = f64>) -> Self {
        let numbers = layout.start(c, energies).into_iter().map(Cell::new).collect();
        Self { numbers, errors: RefCell::new(vec![Worst::default(); layout.logs]) }
    }

    /// Whether it is of the same layout as another.
    pub(crate) fn alike(&self, other: &Self) -> bool {
        self.numbers.len() == other.numbers.len() && self.errors.borrow().len() == other.errors.borrow().len()
    }

    /// Becomes as another of its layout is.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.numbers.clone_from(&other.numbers);
        self.errors.get_mut().clone_from(&other.errors.borrow());
    }

    /// The number at a place.
    #[inline]
    pub(crate) fn get(&self, at: Place) -> f64 {
        self.numbers[at.at].get()
    }

    /// Replaces it.
    #[inline]
    pub(crate) fn set(&self, at: Place, x: f64) {
        self.numbers[at.at].set(x);
    }

    /// The sum at a place.
    pub(crate) fn sum(&self, at: Place) -> f64 {
        Sum::of([self.get(at), self.get(at.plus(1))]).value()
    }

    fn maxima(&self, p: &AccountPlaces) -> [f64; 3] {
        [p.h_max, p.turnover_max, p.size_max].map(|at| self.get(at))
    }

    /// The largest energy that a region held, or turned over in a step.
    pub(crate) fn largest(&self, p: &AccountPlaces) -> f64 {
        account::largest(Real::new(), self.maxima(p))
    }

    /// What the balances of a region are measured against at least.
    pub(crate) fn floor(&self, p: &AccountPlaces) -> f64 {
        account::floor(Real::new(), self.maxima(p))
    }

    /// The largest error beside its scale, which counts as so much at least.
    pub(crate) fn error(&self, at: ErrorPlaces, floor: f64) -> f64 {
        match at {
            ErrorPlaces::Ratio(at) => self.get(at),
            ErrorPlaces::Tops(_, log) => self.errors.borrow()[log].above(floor),
        }
    }

    /// Notes an error, its scale and the least scale that counts.
    pub(crate) fn note(&self, log: usize, [error, scale, floor]: [f64; 3]) {
        self.errors.borrow_mut()[log].add(error, scale, floor);
    }
}

/// A cluster's ledger and the outputs of a step, which is booked.
#[derive(Clone, Copy)]
pub(crate) struct Booking<'a> {
    pub(crate) ledger: &'a Ledger,
    pub(crate) output: &'a [f64],
}

impl<'a> Memory<Real<'a>> for Booking<'a> {
    #[inline]
    fn load(self, at: Place) -> f64 {
        self.ledger.get(at)
    }

    #[inline]
    fn store(self, at: Place, x: f64) {
        self.ledger.set(at, x);
    }

    #[inline]
    fn output(self, slot: usize) -> f64 {
        self.output[slot]
    }

    #[inline]
    fn fold<const N: usize>(
        self,
        slots: &[(String, usize)],
        start: [f64; N],
        body: impl Fn(f64, [f64; N]) -> [f64; N],
    ) -> [f64; N] {
        slots.iter().fold(start, |so_far, (_, slot)| body(self.output[*slot], so_far))
    }

    fn note(self, log: usize, _: Place, numbers: [f64; 3]) {
        self.ledger.note(log, numbers);
    }

    #[inline]
    fn require(self, holds: bool, failure: Failure) -> Flow {
        if holds { Ok(()) } else { Err(Exit::Fail(failure)) }
    }
}
