//! Two sampled regions whose periods are in no whole ratio, joined by double bars: the holder's interval is made of the
//! other side's own.
//!
//! The faster side latches what is held at instants of its own, and does what it does over whole intervals of its own.
//! So what the holder holds from jT on is met from the first such instant t_j at or after jT, and until t_(j+1): over
//! n_j intervals of the other side, n_j being one of two neighbours. The holder's step is over just these: of length
//! n_j times the other's period, with what crossed in them. Then what is held is met throughout the interval that it is
//! reckoned with, the energy that crosses is v q with both of one interval, and the leak is that of the forecast alone.
//! An interval of the other side that still runs at (j+1)T is worked out then: all that it depends on has been latched.
//! (Of a side that itself holds for a third one, with what that gave last; the rest is handed over when it is known.)

use super::Error;
use super::hold::{Held, RECURRENCE, TERMS};
use super::schedule::Simulation;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Instants so close, as a part of themselves, are one.
const SAME: f64 = 1e-12;

/// A holder that goes by the intervals of its other side.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Pace {
    /// The other side's cluster.
    pub(super) other: usize,
    /// Its period, s.
    pub(super) step: f64,
    /// How many of its intervals have been told of, and how many of them since the holder's last sample.
    pub(super) told: u64,
    pub(super) count: u64,
    /// How many the interval that runs will have.
    pub(super) coming: u64,
    /// Whether the other side's interval that runs was worked out ahead, and what it gave to each held port.
    pub(super) taken: bool,
    pub(super) given: Vec<f64>,
    /// How many of them the holder's interval before had.
    pub(super) last: u64,
    /// beta of an interval of `low` of them, and of one more.
    pub(super) low: u64,
    pub(super) betas: [Vec<f64>; 2],
}

impl Pace {
    /// Of a sampled cluster, where it holds for one other sampled side alone, in no whole ratio to it.
    pub(super) fn of(scene: &Scene, i: usize, held: &[Held]) -> Option<Self> {
        let period = scene.clusters[i].period?;
        let mut others = held.iter().map(|h| h.bar.map(|b| scene.bars[b].other.0));
        let other = others.next()??;
        let step = scene.clusters[other].period?;
        if !is_uneven(period, step) || others.any(|o| o != Some(other)) {
            return None;
        }
        Some(Self {
            other,
            step,
            given: vec![0.0; held.len()],
            last: 1,
            low: (period / step) as u64,
            ..Self::default()
        })
    }

    /// beta of the interval that runs.
    pub(super) fn beta(&self) -> &[f64] {
        &self.betas[usize::from(self.coming > self.low)]
    }

    /// beta of so many intervals of the other side, from what one of them and the recurrence tell: what is held goes on
    /// to be felt in the later ones.
    pub(super) fn find_betas(&mut self, beta: &[f64], gamma: &[f64], decay: &[f64]) {
        let n = self.given.len();
        self.betas = [vec![0.0; n * n], vec![0.0; n * n]];
        for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
            let rule = &decay[a * RECURRENCE..(a + 1) * RECURRENCE];
            let order = rule[TERMS + 1] as usize;
            let (mut before, mut sum) = ([0.0; TERMS], 0.0);
            for k in 0..=self.low {
                // Held through, it has been held in each of the intervals so far.
                let felt = order.min(k as usize);
                let follows: f64 = (0..order).map(|p| rule[p] * before[p]).sum();
                let own: f64 = (0..felt).map(|p| gamma[(p * n + a) * n + b]).sum();
                before.rotate_right(1);
                before[0] = follows + own;
                sum += beta[a * n + b] + before[0];
                if k + 1 == self.low {
                    self.betas[0][a * n + b] = sum;
                }
            }
            self.betas[1][a * n + b] = sum;
        }
        for k in 0..n {
            for list in &mut self.betas {
                let own = &mut list[k * n + k];
                *own = if own.is_finite() { own.max(0.0) } else { 0.0 };
            }
        }
    }
}

/// Whether a period is longer than another one, and no multiple of it.
fn is_uneven(period: f64, step: f64) -> bool {
    let ratio = period / step;
    ratio >= 1.0 && (period - ratio.round() * step).abs() > SAME * period
}

/// Sampled clusters that hold for a faster sampled side in no whole ratio to them, and for others besides, each with that
/// side: what they foretell of it is poor.
pub fn uneven(scene: &Scene) -> Vec<(usize, usize)> {
    let mut list = Vec::new();
    for (i, c) in scene.clusters.iter().enumerate() {
        let Some(period) = c.period else { continue };
        let others: BTreeSet<Option<usize>> = (c.holds.iter())
            .map(|port| scene.bars.iter().find(|b| b.holder == (i, *port)).map(|b| b.other.0))
            .collect();
        let faster =
            others.iter().flatten().filter(|o| scene.clusters[**o].period.is_some_and(|t| is_uneven(period, t)));
        if others.len() > 1 {
            list.extend(faster.map(|o| (i, *o)));
        }
    }
    list
}

impl Simulation<'_> {
    /// Length of the interval of a sampled cluster that runs, s.
    pub(super) fn length(&self, i: usize) -> f64 {
        match &self.pace[i] {
            Some(p) => p.coming as f64 * p.step,
            None => self.scene.clusters[i].period.unwrap_or(0.0),
        }
    }

    /// Lengths of the interval of a sampled cluster that is over, and of the one that begins, s.
    pub(super) fn coming(&mut self, i: usize) -> (f64, f64) {
        let period = self.scene.clusters[i].period.unwrap_or(0.0);
        let end = (self.next[i] + 1) as f64 * period;
        if let Some(p) = &mut self.pace[i] {
            // Intervals of the other side that begin before the next sample.
            let until = (end * (1.0 - SAME) / p.step).ceil() as u64;
            p.coming = until.saturating_sub(p.told).clamp(p.low, p.low + 1);
            let before = p.last as f64 * p.step;
            return (before, self.length(i));
        }
        (period, period)
    }

    /// Where the interval of a sampled cluster that ends now began, and how long it was, s.
    pub(super) fn ended(&mut self, i: usize) -> Result<(f64, f64), Error> {
        let period = self.scene.clusters[i].period.unwrap_or(0.0);
        let now = self.next[i] as f64 * period;
        let Some(p) = &self.pace[i] else { return Ok(((self.next[i] - 1) as f64 * period, period)) };
        let (other, step, taken) = (p.other, p.step, p.taken);
        if self.next[other] as f64 * step - now > SAME * now && !taken {
            self.take_ahead(i, other)?;
        }
        let Some(p) = &self.pace[i] else { return Ok((now, period)) };
        Ok(((p.told - p.count) as f64 * step, p.count.max(1) as f64 * step))
    }

    /// Works out what the other side does in its interval that runs.
    fn take_ahead(&mut self, i: usize, other: usize) -> Result<(), Error> {
        let c = &self.scene.clusters[other];
        let step = c.period.unwrap_or(0.0);
        let begun = (self.next[other] - 1) as f64 * step;
        for h in &self.held[other] {
            self.runs[other].input[c.ports[h.port].input] = -h.last_q / step;
        }
        self.runs[other].try_on(c, &self.names, begun, step)?;
        for k in 0..self.held[i].len() {
            let Some(b) = self.held[i][k].bar else { continue };
            let bar = &self.scene.bars[b];
            let q = bar.sign * (step * self.runs[other].output()[c.ports[bar.other.1].mean]);
            if let Some(p) = &mut self.pace[i] {
                p.given[k] = q;
            }
        }
        self.pass(i, other, false);
        if let Some(p) = &mut self.pace[i] {
            p.taken = true;
        }
        Ok(())
    }

    /// Hands over what a sampled cluster gave in the interval that it has just ended, to those who go by it.
    pub(super) fn hand_over(&mut self, other: usize) {
        for i in 0..self.pace.len() {
            let Some(p) = self.pace[i].as_ref().filter(|p| p.other == other) else { continue };
            let taken = p.taken;
            for k in 0..self.held[i].len() {
                let Some(b) = self.held[i][k].bar else { continue };
                let bar = &self.scene.bars[b];
                let q = bar.sign * std::mem::take(&mut self.moved[other][bar.other.1]);
                if let Some(p) = &mut self.pace[i] {
                    // Of what was worked out ahead, only what it was off by is new.
                    p.given[k] = if taken { q - p.given[k] } else { q };
                }
            }
            self.pass(i, other, taken);
            if let Some(p) = &mut self.pace[i] {
                p.taken = false;
            }
        }
    }

    /// Gives a holder what is given, and lets it learn from that where it is of a whole interval.
    fn pass(&mut self, i: usize, other: usize, rest: bool) {
        let Some(p) = &mut self.pace[i] else { return };
        let n = p.given.len();
        let (scene, runs) = (self.scene, &self.runs);
        let met = |bar: Option<usize>| {
            let bar = bar.map(|b| &scene.bars[b]);
            bar.map_or(0.0, |b| b.sign * runs[other].input[scene.clusters[other].ports[b.other.1].input])
        };
        for k in 0..n {
            let (v, q) = (met(self.held[i][k].bar), p.given[k]);
            let response: f64 = (0..n).map(|j| self.beta[i][k * n + j] * met(self.held[i][j].bar)).sum();
            let h = &mut self.held[i][k];
            h.q += q;
            h.w += v * q;
            if !rest {
                h.note(q + response, v);
            }
        }
        if !rest {
            p.told += 1;
            p.count += 1;
        }
    }

    /// What alpha is foretold to be over all of the interval that begins: interval by interval of the other side.
    pub(super) fn foretell_ahead(&self, i: usize, alpha: &mut Vec<f64>, ahead: &mut Vec<Held>) {
        let n = self.held[i].len();
        alpha.resize(n, 0.0);
        ahead.clear();
        ahead.extend(self.held[i].iter().cloned());
        let coming = self.pace[i].as_ref().map_or(1, |p| p.coming);
        for _ in 0..coming {
            for k in 0..n {
                ahead[k].forecast = self.foretold(i, k, ahead);
            }
            for (sum, h) in alpha.iter_mut().zip(ahead.iter_mut()) {
                // What will be held is not known yet: its effect is in beta.
                *sum += h.forecast;
                h.note(h.forecast, 0.0);
            }
        }
    }

    /// Looks what the forecast of an interval that is over was off by, and begins another.
    pub(super) fn review_pace(&mut self, i: usize) {
        let Some(p) = &mut self.pace[i] else { return };
        let n = p.given.len();
        for k in 0..n {
            let beta = p.beta();
            let response: f64 = (0..n).map(|j| beta[k * n + j] * self.held[i][j].v).sum();
            let rule = &self.decay[i][k * RECURRENCE..(k + 1) * RECURRENCE];
            let h = &mut self.held[i][k];
            h.review(h.q + response, h.intervals.saturating_sub(p.count), rule);
            h.last_q = h.q;
        }
        for h in &mut self.held[i] {
            h.q = 0.0;
            h.w = 0.0;
        }
        p.last = p.count.max(1);
        p.count = 0;
    }
}
