//! When sampled clusters sample, and what is handed over between clocks.

use super::cluster::Run;
use super::hold::{Held, Unmet};
use super::rate_transition::SAME;
use super::sampling::Sampling;
use super::schedule::Simulation;
use crate::energy::{HeldPlaces, hold};
use crate::machine::Real;
use crate::scene::Bar;
use std::cell::Cell;

impl Simulation<'_> {
    /// The sample of the root of its clocks at which a sampled cluster's k-th is.
    fn base(&self, i: usize, k: u64) -> u64 {
        let (mut i, mut k) = (i, k);
        while let Some(p) = &self.transitions[i] {
            (i, k) = (p.clock, p.number(k));
        }
        k
    }

    /// The period of that root.
    fn root_step(&self, i: usize) -> f64 {
        let own = self.scene.clusters[i].period.unwrap_or(0.0);
        self.transitions[i].as_ref().map_or(own, |p| p.root.1)
    }

    /// When a sampled cluster's k-th sample is, s.
    pub(super) fn instant(&self, i: usize, k: u64) -> f64 {
        self.base(i, k) as f64 * self.root_step(i)
    }

    /// Length of the interval of a sampled cluster after its k-th sample, s.
    pub(super) fn length(&self, i: usize, k: u64) -> f64 {
        (self.base(i, k + 1) - self.base(i, k)) as f64 * self.root_step(i)
    }

    /// Hands over to those who go by a clock that has just ended an interval, but for those who are due themselves.
    pub(super) fn hand_over_to_others(&mut self, due: &[bool]) {
        for i in 0..self.transitions.len() {
            if self.transitions[i].as_ref().is_some_and(|p| due[p.clock]) && !due[i] {
                self.hand_over(i);
            }
        }
    }

    /// Hands over what those did that a holder holds for, in the interval of its clock that has just ended; it learns
    /// from that.
    pub(super) fn hand_over(&mut self, i: usize) {
        let Some(p) = self.transitions[i].as_ref().filter(|p| self.next[p.clock] > 0) else { return };
        // An interval of a clock that goes by another one is longer than that one's period, or shorter.
        let length = self.length(p.clock, self.next[p.clock] - 1);
        let part = p.step / length;
        for a in 0..self.held[i].len() {
            let Some(bar) = self.held[i][a].bar.map(|b| &self.scene.bars[b]) else { continue };
            let Run { layout, ledger, .. } = &self.runs[i];
            let met = |(h, p): (&Held, &HeldPlaces)| h.met(ledger.get(p.v), length);
            let value = met((&self.held[i][a], &layout.held[a]));
            let all = self.held[i].iter().zip(&layout.held).map(met);
            let response = self.holder(i).yielded(Real::new(), self.sampling(i), a, all);
            let since = self.since(bar.other.0);
            let h = &mut self.held[i][a];
            let ahead = h.rate * since;
            let more = ahead - std::mem::replace(&mut h.ahead, ahead);
            let q = std::mem::take(&mut h.got) + more;
            let moved = q + h.unmet.motion;
            let (p, ledger) = (self.held_places(i, a), &self.runs[i].ledger);
            ledger.set(p.q, ledger.get(p.q) + q);
            hold::note(Real::new(), self.sampling(i), p, part * moved + response, value);
        }
        self.held[i].iter_mut().for_each(|h| h.unmet = Unmet::default());
    }

    /// What the other side of a bar met in its interval that runs, or that has just ended.
    pub(super) fn met(&self, bar: &Bar) -> f64 {
        let (cluster, port) = bar.other;
        bar.sign * self.runs[cluster].input[self.scene.clusters[cluster].ports[port].input]
    }

    /// What is held at a double bar, as the side that it is held for is given it: an effort or a flow.
    ///
    /// # Panics
    /// There is no such double bar.
    pub fn held_at_bar(&self, bar: usize) -> f64 {
        let (cluster, port) = self.scene.bars[bar].other;
        self.runs[cluster].input[self.scene.clusters[cluster].ports[port].input]
    }

    /// What a continuous cluster took at the last sample for a signal of another, by its number in
    /// [`crate::scene::Cluster::foreign`].
    ///
    /// # Panics
    /// There is no such cluster or signal.
    pub fn held_signal(&self, cluster: usize, signal: usize) -> f64 {
        self.runs[cluster].input[self.scene.clusters[cluster].foreign_at + signal]
    }

    /// How long the interval of a side that runs has lasted, s; 0 where it has just ended, and of a continuous one.
    fn since(&self, cluster: usize) -> f64 {
        let next = self.next[cluster];
        if next == 0 || self.instant(cluster, next) <= self.time * (1.0 + SAME) {
            return 0.0;
        }
        self.time - self.instant(cluster, next - 1)
    }

    /// What the free response is predicted to be over all of the interval that begins: interval by interval of the
    /// clock, on a copy of what is known.
    pub(super) fn predict_ahead(
        &self,
        i: usize,
        (free_response, predicted): (&mut Vec<f64>, &mut Vec<f64>),
        ahead: &mut Vec<Cell<f64>>,
    ) {
        let (n, next) = (self.held[i].len(), self.next[i]);
        free_response.resize(n, 0.0);
        ahead.clear();
        ahead.extend_from_slice(&self.runs[i].ledger.numbers);
        let Some(p) = &self.transitions[i] else { return };
        let (m, trial) = (Real::new(), Sampling { own: ahead, ..self.sampling(i) });
        for number in p.number(next)..p.number(next + 1) {
            let part = self.length(p.clock, number) / p.step;
            predicted.clear();
            predicted.extend((0..n).map(|k| self.holder(i).predicted(m, trial, k)));
            let ports = free_response.iter_mut().zip(&*predicted).zip(&self.holder(i).layout.held);
            for ((sum, predicted), places) in ports {
                // What will be held is not known yet: its effect is in the port admittance.
                *sum += part * predicted;
                hold::note(m, trial, places, *predicted, 0.0);
            }
        }
    }

    /// Notes how far the other sides moved in an interval that is over.
    pub(super) fn note_answers(&self, i: usize) {
        let Run { layout, ledger, .. } = &self.runs[i];
        layout.held.iter().for_each(|p| ledger.set(p.last_q, ledger.get(p.q)));
    }
}
