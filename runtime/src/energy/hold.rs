//! What a sampled cluster knows of its other sides, and how far it may go in what it holds.
//!
//! Over an interval the other side of a held port answers `q = a - Y v`: `v` is what is held, `Y` the port admittance
//! (the step response over one interval), and `a` the free response, which is what it does by itself.

use super::PortResponse::{ArCoefficients, DelayedResponse, PortAdmittance};
use super::{
    AR_COEFFICIENTS, AR_ORDER, HeldPlaces, Layout, Memory, Place, Responses, interval, larger, positive, smaller,
};
use crate::ir::Unary;
use crate::machine::{Machine, Number, Variable};

/// A sampled cluster and its places.
#[derive(Clone, Copy)]
pub struct Holder<'l> {
    /// The cluster.
    pub cluster: usize,
    /// Its places.
    pub layout: &'l Layout,
}

impl Holder<'_> {
    fn ports(&self) -> usize {
        self.layout.held.len()
    }

    /// One of the numbers that predict a port's free response.
    fn ar<M: Machine, K: Responses<M>>(&self, k: K, port: usize, at: usize) -> M::Number {
        k.response(self.cluster, ArCoefficients, port * AR_COEFFICIENTS + at)
    }

    /// How far the other side gives way at a held port where this is held: a row of `Y v`.
    pub fn yielded<M: Machine, K: Responses<M>>(
        &self,
        m: M,
        k: K,
        port: usize,
        held: impl Iterator<Item = M::Number>,
    ) -> M::Number {
        let row = port * self.ports();
        held.enumerate().fold(m.number(-0.0), |sum, (j, v)| sum + k.response(self.cluster, PortAdmittance, row + j) * v)
    }

    /// The same for what was held over the interval that ends.
    pub fn yielded_now<M: Machine, K: Responses<M>>(&self, m: M, k: K, port: usize) -> M::Number {
        self.yielded(m, k, port, self.layout.held.iter().map(|h| k.load(h.v)))
    }

    /// What the free response of a port in the next interval is predicted to be, from the samples alone: by the
    /// autoregressive model of what the other side has in it, from one interval to the next. From where enough
    /// intervals are known it is a model of the second differences, so that a push that changes evenly drops out; what
    /// was held before has its own effect. Before there are enough, it is one of the differences, or of the free
    /// responses themselves, and at first no motion is known but the last.
    pub fn predicted<M: Machine, K: Responses<M>>(&self, m: M, k: K, port: usize) -> M::Number {
        let (h, n) = (&self.layout.held[port], self.ports());
        let known = k.ar_order(self.cluster, port);
        let weight = |p: usize| self.ar(k, port, p);
        let order = self.ar(k, port, AR_ORDER + 1);
        let counts = |p: usize| match known {
            Some(_) => m.known(true),
            None => m.number(p as f64).below(order),
        };
        // A number of some interval and its differences, from those of that one and the two before it.
        let differences = |x: &dyn Fn(usize) -> M::Number| {
            let [now, before, first] = [x(0), x(1), x(2)];
            let change = now - before;
            [now, change, change - (before - first)]
        };
        // What that which was held will do, by the interval it was held in, and what its changes will.
        let effects = |p: usize| {
            let held = self.layout.held.iter().enumerate();
            held.fold([m.number(-0.0); 3], |sums, (j, h)| {
                let response = k.response(self.cluster, DelayedResponse, (p * n + port) * n + j);
                let held = differences(&|more| k.load(h.before.plus(p + more)));
                std::array::from_fn(|d| sums[d] + response * held[d])
            })
        };
        let free = |p: usize| differences(&|more| k.load(h.free_response.plus(p + more)));
        let (zero, one, intervals, last) = (m.number(0.0), m.number(1.0), k.load(h.intervals), free(0));
        let first = effects(0);
        let mut sums: [_; 3] = std::array::from_fn(|d| (weight(0) * last[d], first[d]));
        for p in 1..known.unwrap_or(AR_ORDER) {
            let (counts, free, effects) = (counts(p), free(p), effects(p));
            for (d, sums) in sums.iter_mut().enumerate() {
                let more = (sums.0 + weight(p) * free[d], sums.1 + effects[d]);
                *sums = (m.select(counts.clone(), more.0, sums.0), m.select(counts.clone(), more.1, sums.1));
            }
        }
        let [plain, steady, even] = sums.map(|(follows, effect)| follows - effect);
        let [plain, steady, even] = [plain, last[0] + steady, last[0] + last[1] + even];
        let mut some = m.select(intervals.equals(order + one), steady, even);
        some = m.select(intervals.equals(order), plain, some);
        if known != Some(1) {
            let crude = weight(AR_ORDER) * last[0] - first[0];
            some = m.select(intervals.below(order), crude, some);
        }
        m.select(intervals.equals(zero), zero, some)
    }

    /// Ends an interval: what is known now of the other side of a port.
    pub fn learn<M: Machine, K: Responses<M>>(&self, m: M, k: K, port: usize) {
        let h = &self.layout.held[port];
        let free_response = k.load(h.q) + self.yielded_now(m, k, port);
        note(m, k, h, free_response, k.load(h.v));
        k.store(h.last_q, k.load(h.q));
    }

    /// Scales held variables down to the energy budget: by them the interval is predicted to give back no more than the
    /// cluster has to give, and its sources are `foreseen` to put in. Bars of temperature draw on its heat, all others
    /// on what it has to give as work.
    pub fn within_budget<M: Machine, K: Responses<M>>(
        &self,
        m: M,
        k: K,
        v: &mut [M::Number],
        free_response: &[M::Number],
        foreseen: M::Number,
    ) {
        let thermal = |i: usize| self.layout.held[i].is_thermal;
        if (0..v.len()).any(thermal) {
            let heat = positive(m, interval::heat(m, k, self.layout));
            self.keep_within(m, k, v, free_response, heat, &thermal);
        }
        let stored = interval::stored(m, k, self.layout);
        let room = stored - interval::noise(m, k, self.layout) + positive(m, foreseen);
        self.keep_within(m, k, v, free_response, positive(m, room), &|i| !thermal(i));
    }

    /// Scales the held variables that are `chosen` down until the energy that the interval is predicted to give back by
    /// them is at most `room`.
    ///
    /// The energy in is v (a - Y v), concave along the ray of v, and 0 at its start.
    fn keep_within<M: Machine, K: Responses<M>>(
        &self,
        m: M,
        k: K,
        v: &mut [M::Number],
        free_response: &[M::Number],
        room: M::Number,
        chosen: &dyn Fn(usize) -> bool,
    ) {
        let nothing = m.number(-0.0);
        let picked = || (0..v.len()).filter(|i| chosen(*i));
        let mut a = picked().fold(nothing, |sum, i| sum + v[i] * free_response[i]);
        // What the others hold moves these ports, too.
        for (i, j) in picked().flat_map(|i| (0..v.len()).filter(|j| !chosen(*j)).map(move |j| (i, j))) {
            a = a - v[i] * k.response(self.cluster, PortAdmittance, i * v.len() + j) * v[j];
        }
        let b = self.given_way(m, k, v, chosen);
        let part = m.holding(m.number(1.0));
        m.only(!(-room).at_most(a - b), || {
            let curved = (a + root(a * a + m.number(4.0) * b * room)) / (m.number(2.0) * b);
            let straight = room / -a;
            part.set(fraction(m, m.select(m.number(0.0).below(b), curved, straight)));
        });
        let part = part.get();
        v.iter_mut().enumerate().filter(|(i, _)| chosen(*i)).for_each(|(_, v)| *v = *v * part);
    }

    /// What the other side gives way by itself to what is `chosen`, v Y v.
    fn given_way<M: Machine, K: Responses<M>>(
        &self,
        m: M,
        k: K,
        v: &[M::Number],
        chosen: &dyn Fn(usize) -> bool,
    ) -> M::Number {
        let (mut b, n) = (m.number(0.0), v.len());
        for i in (0..n).filter(|i| chosen(*i)) {
            for j in (0..n).filter(|j| chosen(*j)) {
                b = b + v[i] * k.response(self.cluster, PortAdmittance, i * n + j) * v[j];
            }
        }
        b
    }
}

/// Notes an interval that is over: its free response, and what was held.
pub fn note<M: Machine, K: Memory<M>>(m: M, k: K, h: &HeldPlaces, free_response: M::Number, held: M::Number) {
    shift::<M, K>(k, h.free_response, free_response);
    shift::<M, K>(k, h.before, held);
    k.store(h.intervals, k.load(h.intervals) + m.number(1.0));
}

/// Puts a number before the others that are kept; the last one is dropped.
fn shift<M: Machine, K: Memory<M>>(k: K, at: Place, x: M::Number) {
    for p in (0..=AR_ORDER).rev() {
        k.store(at.plus(p + 1), k.load(at.plus(p)));
    }
    k.store(at, x);
}

/// The square root.
fn root<N: Number>(x: N) -> N {
    x.unary(Unary::Sqrt)
}

/// A number between 0 and 1; 0 where it is none.
fn fraction<M: Machine>(m: M, x: M::Number) -> M::Number {
    let (zero, one) = (m.number(0.0), m.number(1.0));
    smaller(m, larger(m, m.select(x.is_finite(), x, zero), zero), one)
}
