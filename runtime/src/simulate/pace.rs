//! Sampled regions whose periods are in no whole ratio, joined by double bars: the holder goes by the other side's
//! clock.
//!
//! The faster side latches what is held at instants of its own, and does what it does over whole intervals of its own.
//! So the holder's k-th sample is at the first such instant at or after kT, and its interval is made of whole ones of
//! the other side: n_k of them, n_k being one of two neighbours. Then what is held is met throughout the interval that
//! it is reckoned with, by all that it is held for, and the leak is that of the forecast alone. What the others do is
//! told interval by interval of that clock, and foretold so. A holder of one that goes by another clock goes by it too,
//! and so do the sides of its own period that hold for nobody.
//!
//! Sides that have intervals beside those of the clock are told of as if they went on as they did, until they have
//! ended.

use super::hold::{Held, RECURRENCE, TERMS};
use super::schedule::Simulation;
use crate::scene::{Bar, Scene};

/// Instants so close, as a part of themselves, are one.
const SAME: f64 = 1e-12;

/// Of so many times a period one more or less is nothing.
const MANY: f64 = 1e6;

/// A holder that goes by the clock of its other side.
#[derive(Clone, Debug, Default)]
pub(super) struct Pace {
    /// The clock's cluster.
    clock: usize,
    /// Its period, s.
    pub(super) step: f64,
    /// The holder's own period beside it, a little less: instants that are one must not be told apart by rounding.
    ratio: f64,
    /// The cluster at whose samples those of the clock are, and which goes by no other clock, and its period, s.
    root: (usize, f64),
    /// beta of an interval of `low` of the clock's, and of one more.
    low: u64,
    betas: [Vec<f64>; 2],
}

/// The first sampled cluster that goes by another's clock.
pub fn paced(scene: &Scene) -> Option<usize> {
    Pace::all(scene).iter().position(Option::is_some)
}

impl Pace {
    /// By cluster, the clock that it goes by: of the sampled sides that it holds for, where one is in no whole ratio to
    /// it or goes by another clock itself, the slowest at whose samples all others sample; the slowest, if there is
    /// none. Sides of its own period that hold for nobody sample when it does, then.
    pub(super) fn all(scene: &Scene) -> Vec<Option<Pace>> {
        let mut all: Vec<Option<Pace>> = vec![None; scene.clusters.len()];
        for (period, i) in by_period((0..scene.clusters.len()).collect(), scene) {
            let follows = |o: &(f64, usize)| {
                (o.0 - period).abs() <= SAME * period && sides(scene, o.1).is_empty() && !is_open(scene, o.1)
            };
            let (follow, others): (Vec<_>, Vec<_>) =
                sides(scene, i).into_iter().partition(|o| follows(o) && all[o.1].is_none());
            if is_open(scene, i) || !others.iter().any(|o| strays(period, *o, &all)) {
                continue;
            }
            let leads = |c: &&(f64, usize)| astray(**c, &others, &all).next().is_none();
            let Some(&(step, clock)) = others.iter().rev().find(leads).or(others.last()) else { continue };
            let root = all[clock].as_ref().map_or((clock, step), |p| p.root);
            let low = (period / step * (1.0 + SAME)) as u64;
            let ratio = |step: f64| period / step * (1.0 - SAME);
            all[i] = Some(Pace { clock, step, ratio: ratio(step), root, low, ..Self::default() });
            for (_, o) in follow {
                let clock = Pace { clock: i, step: period, ratio: ratio(period), root, low: 1, ..Self::default() };
                all[o] = Some(clock);
            }
        }
        all
    }

    /// The sample of the clock at which the holder's k-th is. Rounded once, so that each has an interval of its own.
    fn number(&self, k: u64) -> u64 {
        (k as f64 * self.ratio).ceil() as u64
    }

    /// beta of so many intervals of the clock, from what one of them and the recurrence tell: what is held goes on to
    /// be felt in the later ones.
    pub(super) fn find_betas(&mut self, n: usize, beta: &[f64], gamma: &[f64], decay: &[f64]) {
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

/// beta of the interval after the k-th sample; `own` is that of one interval of the clock, or of the cluster's own.
pub(super) fn beta_of<'a>(pace: &'a Option<Pace>, own: &'a [f64], k: u64) -> &'a [f64] {
    pace.as_ref().map_or(own, |p| &p.betas[usize::from(p.number(k + 1) - p.number(k) > p.low)])
}

/// Whether a period is longer than another one, and no multiple of it.
fn is_uneven(period: f64, step: f64) -> bool {
    let ratio = period / step;
    (1.0..MANY).contains(&ratio) && (period - ratio.round() * step).abs() > SAME * period
}

/// Whether a sampled side, by period and cluster, has no instants at all samples of this period.
fn strays(period: f64, (step, other): (f64, usize), all: &[Option<Pace>]) -> bool {
    is_uneven(period, step) || all[other].is_some()
}

/// Of sampled sides those that do not sample whenever this one does.
fn astray<'a>(
    clock: (f64, usize),
    others: &'a [(f64, usize)],
    all: &'a [Option<Pace>],
) -> impl Iterator<Item = &'a (f64, usize)> {
    let meets = move |o: &(f64, usize)| o.0 <= clock.0 && all[clock.1].is_none() && !strays(clock.0, *o, all);
    others.iter().filter(move |o| o.1 != clock.1 && !meets(o))
}

/// Sampled clusters of a list with their periods, the shortest first, each once.
fn by_period(mut list: Vec<usize>, scene: &Scene) -> Vec<(f64, usize)> {
    list.sort_unstable();
    list.dedup();
    let mut list: Vec<(f64, usize)> = list.into_iter().filter_map(|i| Some((scene.clusters[i].period?, i))).collect();
    list.sort_by(|a, b| a.0.total_cmp(&b.0));
    list
}

/// The sampled sides that a cluster holds for.
fn sides(scene: &Scene, i: usize) -> Vec<(f64, usize)> {
    by_period(scene.bars.iter().filter(|b| b.holder.0 == i).map(|b| b.other.0).collect(), scene)
}

/// Whether a cluster holds for the outside, which goes by the cluster's own period.
fn is_open(scene: &Scene, i: usize) -> bool {
    scene.open.iter().any(|o| o.port.0 == i)
}

/// Sampled clusters that hold for a sampled side which does not sample whenever they do, each with that side: what they
/// foretell of it is poor.
pub fn uneven(scene: &Scene) -> Vec<(usize, usize)> {
    let all = Pace::all(scene);
    let mut list = Vec::new();
    for (i, c) in scene.clusters.iter().enumerate() {
        let (Some(period), others) = (c.period, sides(scene, i)) else { continue };
        let clock = all[i].as_ref().map_or((period, i), |p| (p.step, p.clock));
        let follows = |o: usize| all[o].as_ref().is_some_and(|p| p.clock == i);
        list.extend(astray(clock, &others, &all).filter(|o| !follows(o.1)).map(|o| (i, o.1)));
    }
    list
}

impl Simulation<'_> {
    /// The sample of the root of its clocks at which a sampled cluster's k-th is.
    fn base(&self, i: usize, k: u64) -> u64 {
        let (mut i, mut k) = (i, k);
        while let Some(p) = &self.pace[i] {
            (i, k) = (p.clock, p.number(k));
        }
        k
    }

    /// The period of that root.
    fn root_step(&self, i: usize) -> f64 {
        let own = self.scene.clusters[i].period.unwrap_or(0.0);
        self.pace[i].as_ref().map_or(own, |p| p.root.1)
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
        for i in 0..self.pace.len() {
            if self.pace[i].as_ref().is_some_and(|p| due[p.clock]) && !due[i] {
                self.hand_over(i);
            }
        }
    }

    /// Hands over what those did that a holder holds for, in the interval of its clock that has just ended; it learns
    /// from that.
    pub(super) fn hand_over(&mut self, i: usize) {
        let Some(p) = self.pace[i].as_ref().filter(|p| self.next[p.clock] > 0) else { return };
        // An interval of a clock that goes by another one is longer than that one's period, or shorter.
        let part = p.step / self.length(p.clock, self.next[p.clock] - 1);
        let n = self.held[i].len();
        for a in 0..n {
            let Some(bar) = self.held[i][a].bar.map(|b| &self.scene.bars[b]) else { continue };
            let response: f64 = (0..n).map(|b| self.beta[i][a * n + b] * self.held[i][b].v).sum();
            let (met, since) = (self.met(bar), self.since(bar.other.0));
            let h = &mut self.held[i][a];
            let ahead = h.rate * since;
            let more = ahead - std::mem::replace(&mut h.ahead, ahead);
            h.w += met * more;
            let q = std::mem::take(&mut h.got) + more;
            h.q += q;
            h.note(part * q + response, h.v);
        }
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

    /// What alpha is foretold to be over all of the interval that begins: interval by interval of the clock.
    pub(super) fn foretell_ahead(&self, i: usize, alpha: &mut Vec<f64>, ahead: &mut Vec<Held>) {
        let (n, next) = (self.held[i].len(), self.next[i]);
        alpha.resize(n, 0.0);
        ahead.clear();
        ahead.extend(self.held[i].iter().cloned());
        let Some(p) = &self.pace[i] else { return };
        for number in p.number(next)..p.number(next + 1) {
            let part = self.length(p.clock, number) / p.step;
            for k in 0..n {
                ahead[k].forecast = self.foretold(i, k, ahead);
            }
            for (sum, h) in alpha.iter_mut().zip(ahead.iter_mut()) {
                // What will be held is not known yet: its effect is in beta.
                *sum += part * h.forecast;
                h.note(h.forecast, 0.0);
            }
        }
    }

    /// Looks what the forecast of an interval that is over was off by, and begins another.
    pub(super) fn review_pace(&mut self, i: usize) {
        let (n, last) = (self.held[i].len(), self.next[i] - 1);
        let Some(p) = &self.pace[i] else { return };
        let count = p.number(last + 1) - p.number(last);
        for k in 0..n {
            let beta = beta_of(&self.pace[i], &self.beta[i], last);
            let response: f64 = (0..n).map(|j| beta[k * n + j] * self.held[i][j].v).sum();
            let rule = &self.decay[i][k * RECURRENCE..(k + 1) * RECURRENCE];
            let h = &mut self.held[i][k];
            h.review(h.q + response, h.intervals.saturating_sub(count), rule);
            h.last_q = h.q;
        }
        for h in &mut self.held[i] {
            h.q = 0.0;
            h.w = 0.0;
        }
    }
}
