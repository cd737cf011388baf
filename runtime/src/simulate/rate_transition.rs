//! Sampled regions whose periods are in no whole ratio, joined by double bars: the holder goes by the other side's
//! clock.
//!
//! The faster side latches what is held at instants of its own, and does what it does over whole intervals of its own.
//! So the holder's k-th sample is at the first such instant at or after kT, and its interval is made of whole ones of
//! the other side: n_k of them, n_k being one of two neighbours. Then what is held is met throughout the interval that
//! it is reckoned with, by all that it is held for, and only the prediction leaks. What the others do is told interval
//! by interval of that clock, and predicted so. A holder of one that goes by another clock goes by it too,
//! and so do the sides of its own period that hold for nobody.
//!
//! Sides that have intervals beside those of the clock are told of as if they went on as they did, until they have
//! ended.

use crate::energy::{AR_COEFFICIENTS, AR_ORDER};
use crate::scene::Scene;

/// Instants so close, as a part of themselves, are one.
pub(super) const SAME: f64 = 1e-12;

/// Of so many times a period one more or less is nothing.
const MANY: f64 = 1e6;

/// A holder that goes by the clock of its other side.
#[derive(Clone, Debug, Default)]
pub(super) struct RateTransition {
    /// The clock's cluster.
    pub(super) clock: usize,
    /// Its period, s.
    pub(super) step: f64,
    /// The holder's own period beside it, a little less: instants that are one must not be told apart by rounding.
    ratio: f64,
    /// The cluster at whose samples those of the clock are, and which goes by no other clock, and its period, s.
    pub(super) root: (usize, f64),
    /// How many intervals of the clock's the shorter ones of its own are made of; the others are of one more.
    low: u64,
    /// The port admittance over each of the two.
    admittances: [Vec<f64>; 2],
}

/// The first sampled cluster that goes by another's clock.
pub fn paced(scene: &Scene) -> Option<usize> {
    RateTransition::all(scene).iter().position(Option::is_some)
}

impl RateTransition {
    /// By cluster, the clock that it goes by: of the sampled sides that it holds for, where one is in no whole ratio to
    /// it or goes by another clock itself, the slowest at whose samples all others sample; the slowest, if there is
    /// none. Sides of its own period that hold for nobody sample when it does, then.
    pub(super) fn all(scene: &Scene) -> Vec<Option<RateTransition>> {
        let mut all: Vec<Option<RateTransition>> = vec![None; scene.clusters.len()];
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
            all[i] = Some(RateTransition { clock, step, ratio: ratio(step), root, low, ..Self::default() });
            for (_, o) in follow {
                let clock =
                    RateTransition { clock: i, step: period, ratio: ratio(period), root, low: 1, ..Self::default() };
                all[o] = Some(clock);
            }
        }
        all
    }

    /// The sample of the clock at which the holder's k-th is. Rounded once, so that each has an interval of its own.
    pub(super) fn number(&self, k: u64) -> u64 {
        (k as f64 * self.ratio).ceil() as u64
    }

    /// Port admittances of so many intervals of the clock, from what one of them and the autoregressive model tell:
    /// what is held goes on to be felt in the later ones.
    pub(super) fn find_port_admittances(
        &mut self,
        n: usize,
        port_admittance: &[f64],
        delayed_response: &[f64],
        ar_coefficients: &[f64],
    ) {
        self.admittances = [vec![0.0; n * n], vec![0.0; n * n]];
        for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
            let rule = &ar_coefficients[a * AR_COEFFICIENTS..(a + 1) * AR_COEFFICIENTS];
            let order = rule[AR_ORDER + 1] as usize;
            let (mut before, mut sum) = ([0.0; AR_ORDER], 0.0);
            for k in 0..=self.low {
                // Held through, it has been held in each of the intervals so far.
                let felt = order.min(k as usize);
                let follows: f64 = (0..order).map(|p| rule[p] * before[p]).sum();
                let own: f64 = (0..felt).map(|p| delayed_response[(p * n + a) * n + b]).sum();
                before.rotate_right(1);
                before[0] = follows + own;
                sum += port_admittance[a * n + b] + before[0];
                if k + 1 == self.low {
                    self.admittances[0][a * n + b] = sum;
                }
            }
            self.admittances[1][a * n + b] = sum;
        }
        for k in 0..n {
            for list in &mut self.admittances {
                let own = &mut list[k * n + k];
                *own = if own.is_finite() { own.max(0.0) } else { 0.0 };
            }
        }
    }
}

/// The port admittance over the interval after the k-th sample; `own` is that of one interval of the clock, or of the
/// cluster's own.
pub(super) fn port_admittance_of<'a>(transition: &'a Option<RateTransition>, own: &'a [f64], k: u64) -> &'a [f64] {
    transition.as_ref().map_or(own, |p| &p.admittances[usize::from(p.number(k + 1) - p.number(k) > p.low)])
}

/// Whether a period is longer than another one, and no multiple of it.
fn is_uneven(period: f64, step: f64) -> bool {
    let ratio = period / step;
    (1.0..MANY).contains(&ratio) && (period - ratio.round() * step).abs() > SAME * period
}

/// Whether a sampled side, by period and cluster, has no instants at all samples of this period.
fn strays(period: f64, (step, other): (f64, usize), all: &[Option<RateTransition>]) -> bool {
    is_uneven(period, step) || all[other].is_some()
}

/// Of sampled sides those that do not sample whenever this one does.
fn astray<'a>(
    clock: (f64, usize),
    others: &'a [(f64, usize)],
    all: &'a [Option<RateTransition>],
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
/// predict of it is poor.
pub fn uneven(scene: &Scene) -> Vec<(usize, usize)> {
    let all = RateTransition::all(scene);
    let mut list = Vec::new();
    for (i, c) in scene.clusters.iter().enumerate() {
        let (Some(period), others) = (c.period, sides(scene, i)) else { continue };
        let clock = all[i].as_ref().map_or((period, i), |p| (p.step, p.clock));
        let follows = |o: usize| all[o].as_ref().is_some_and(|p| p.clock == i);
        list.extend(astray(clock, &others, &all).filter(|o| !follows(o.1)).map(|o| (i, o.1)));
    }
    list
}
