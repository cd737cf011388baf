//! Accounts of energy, holds and their budget: written once, for runs and for the back ends of the compiler.
//!
//! What is here is generic over a [`Machine`]. A run gives it numbers, which are in a block of each cluster
//! (`Ledger`); `backend/standalone` of the compiler writes the same operations down as statements, on a block of the
//! same [`Layout`].
//!
//! Sums start from -0, which adds nothing to any number, not even to -0.

pub mod account;
pub mod hold;
pub mod interval;
mod layout;
mod ledger;
#[cfg(test)]
pub(crate) mod testing;
mod worst;

pub use layout::{
    ACCOUNT, AR_COEFFICIENTS, AR_ORDER, AbsorbedPlaces, AccountPlaces, CountPlaces, DetailPlaces, ErrorPlaces,
    HeldPlaces, Layout, Place, StakePlaces, Waves, WorkPlaces,
};
pub(crate) use ledger::{Booking, Ledger};
pub(crate) use worst::Worst;

use crate::kernel::Failure;
use crate::machine::{Flow, Machine, Number};

/// The memory of the machine in which accounts and holds are.
pub trait Memory<M: Machine>: Copy {
    /// The number at a place.
    fn load(self, at: Place) -> M::Number;

    /// Replaces the number at a place.
    fn store(self, at: Place, x: M::Number);

    /// An output of the cluster's last step.
    fn output(self, slot: usize) -> M::Number;

    /// What `body` makes of some numbers and one output after the other.
    fn fold<const N: usize>(
        self,
        slots: &[(String, usize)],
        start: [M::Number; N],
        body: impl Fn(M::Number, [M::Number; N]) -> [M::Number; N],
    ) -> [M::Number; N];

    /// Notes an error that is not below the largest ones: the number of its log, where those are kept, the error, its
    /// scale, and the least scale that counts.
    fn note(self, log: usize, tops: Place, numbers: [M::Number; 3]);

    /// Ends the step where a condition does not hold.
    ///
    /// # Errors
    /// It does not hold.
    fn require(self, holds: M::Condition, failure: Failure) -> Flow;

    /// Keeps the larger of a number that is kept and another one.
    fn raise(self, m: M, at: Place, x: M::Number) {
        let before = self.load(at);
        self.store(at, larger(m, before, x));
    }

    /// Adds to a number that is kept.
    fn add(self, at: Place, x: M::Number) {
        self.store(at, self.load(at) + x);
    }

    /// A compensated sum.
    fn sum(self, at: Place) -> M::Number {
        self.load(at) + self.load(at.plus(1))
    }

    /// Adds to a compensated sum.
    fn gather(self, at: Place, x: M::Number) {
        let [sum, rest] = compensated([self.load(at), self.load(at.plus(1))], x);
        self.store(at, sum);
        self.store(at.plus(1), rest);
    }
}

/// A memory that has how the other sides respond, too.
pub trait Responses<M: Machine>: Memory<M> {
    /// A number of how the other sides respond to what a cluster holds.
    fn response(self, cluster: usize, which: PortResponse, at: usize) -> M::Number;

    /// Order of the autoregressive model of a held port, where it is known before anything runs.
    fn ar_order(self, cluster: usize, port: usize) -> Option<usize>;
}

/// Which numbers of how the other sides respond to what a cluster holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortResponse {
    /// How the answer over an interval falls with what is held: a matrix of the held ports.
    PortAdmittance,
    /// How the answers of the intervals after do, apart from what follows from the answers before: [`AR_ORDER`]
    /// matrices.
    DelayedResponse,
    /// [`AR_COEFFICIENTS`] numbers per held port.
    ArCoefficients,
}

impl PortResponse {
    /// All of them.
    pub const ALL: [PortResponse; 3] =
        [PortResponse::PortAdmittance, PortResponse::DelayedResponse, PortResponse::ArCoefficients];
}

/// Adds a term to a sum and to what rounding took from it (Knuth's two-sum).
#[inline]
pub fn compensated<N: Number>([sum, rest]: [N; 2], x: N) -> [N; 2] {
    let total = sum + x;
    let added = total - sum;
    [total, rest + ((sum - (total - added)) + (x - added))]
}

/// The larger number; the first where one is NaN.
#[inline]
pub fn larger<M: Machine>(m: M, a: M::Number, b: M::Number) -> M::Number {
    m.select(a.below(b), b, a)
}

/// The smaller number; the first where one is NaN.
#[inline]
pub fn smaller<M: Machine>(m: M, a: M::Number, b: M::Number) -> M::Number {
    m.select(b.below(a), b, a)
}

/// The number where it is above 0, else 0.
#[inline]
pub fn positive<M: Machine>(m: M, x: M::Number) -> M::Number {
    let zero = m.number(0.0);
    m.select(zero.below(x), x, zero)
}
