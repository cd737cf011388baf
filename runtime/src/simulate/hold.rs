//! What crosses a double bar, and what a sampled region knows of its other side.

use crate::ledger::Sum;
use serde::{Deserialize, Serialize};

/// So many past intervals tell what the next one's answer will be: two for each way in which the other side can swing.
pub const TERMS: usize = 4;
/// How a port's alpha follows from those before: the weights of that many, what is left of a motion after one interval,
/// how many of the weights count, and after how many intervals what a forecast is off by does.
pub const RECURRENCE: usize = TERMS + 3;
/// What of the worst that a forecast was off by lately still counts after an interval: it is forgotten in some ten.
pub const FORGET: f64 = 0.9;
/// How much less a debtor is trusted after it lost all that it risked: 1 in one more than this.
pub const WARY: f64 = 16.0;
/// What an interval of which nothing was foretold could lose, J: what it does lose says nothing of forecasts, and costs
/// no trust.
pub(super) const UNTOLD: f64 = f64::INFINITY;
/// A loss, or a debt, of less than this part of the most that an interval ever risked, or that crossed and was put in,
/// is rounding, and counts as none.
pub const LOSS: f64 = 1e-12;

/// What of an energy is its rounding. What is stored is no budget as far as it is that: of next to nothing, held
/// against what was not foretold, its root would be given out.
pub const NOISE: f64 = 1e-14;
/// Beside this part of the scene's largest energy a debt counts, where the region's own are smaller: what crosses from
/// there has the rounding of that.
pub const BESIDE: f64 = 1e-2;

/// What the outside tells of an open port's interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// How far it moved: the integral of its flow, or of its effort where the flow is held.
    pub q: f64,
    /// The energy that it put in, J, where what it met was not what is held now; `v q` otherwise.
    pub energy: Option<f64>,
    /// So many intervals before this one were silent, and `q` is over them too.
    pub gap: u32,
    /// Nothing was heard. What is held stays, and what the outside does is not foretold anew.
    pub silent: bool,
}

/// A port that a sampled cluster holds: a double bar's or an open one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Held {
    /// Its cluster's port.
    pub(super) port: usize,
    /// The double bar, if it is one; else the open port.
    pub(super) bar: Option<usize>,
    pub(super) open: Option<usize>,
    /// The held variable.
    pub(super) v: f64,
    /// The answer since the last sample.
    pub(super) q: f64,
    /// Energy that crossed since the last sample, where the other side is sampled too and may have latched earlier
    /// values.
    pub(super) w: f64,
    /// Of a holder that goes by another clock: the answer since that one's last sample; what of it the other side, in
    /// its interval that runs, was taken to give; and what it gave a second in the one before.
    pub(super) got: f64,
    pub(super) ahead: f64,
    pub(super) rate: f64,
    /// Energy that crossed in the interval that ended last.
    pub(super) crossed: f64,
    /// The answer of the last interval.
    pub(super) last_q: f64,
    /// alpha of the last intervals, and what was held in them: the last one first.
    pub(super) alpha: [f64; TERMS + 1],
    pub(super) before: [f64; TERMS + 1],
    /// What alpha is foretold to be in the interval that runs, and what forecasts were off by at most lately.
    pub(super) forecast: f64,
    pub(super) off: f64,
    /// Nothing was heard of the interval that ended: what is held stays.
    pub(super) silent: bool,
    /// How many intervals are over.
    pub(super) intervals: u64,
    /// Energy in, as the holder counts it, and as the other side does.
    pub(super) holder_energy: Sum,
    pub(super) other_energy: Sum,
    pub(super) difference: f64,
}

impl Held {
    /// What the next interval's alpha is foretold to be, from the samples alone: by the recurrence that what the other
    /// side has in it obeys, of the changes of alpha from one interval to the next. So a constant push drops out; what
    /// was held before has its own effect. `r` is this port's recurrence; `changes` is what the changes of what all
    /// ports held will do, by the interval they are of, `held` the same of what they held itself.
    ///
    /// Before there are enough intervals no push is known, and at first no motion but the last.
    pub(super) fn foretold(&self, r: &[f64], held: [f64; TERMS], changes: [f64; TERMS]) -> f64 {
        let order = r[TERMS + 1] as usize;
        let k = self.intervals as usize;
        if k == 0 {
            0.0
        } else if k < order {
            r[TERMS] * self.alpha[0] - held[0]
        } else if k == order {
            let (mut x, mut effect) = (r[0] * self.alpha[0], held[0]);
            for p in 1..order {
                x += r[p] * self.alpha[p];
                effect += held[p];
            }
            x - effect
        } else {
            let (mut x, mut effect) = (self.alpha[0] + r[0] * (self.alpha[0] - self.alpha[1]), changes[0]);
            for p in 1..order {
                x += r[p] * (self.alpha[p] - self.alpha[p + 1]);
                effect += changes[p];
            }
            x - effect
        }
    }

    /// What the foretold alpha of an interval may be off by: what forecasts were off by lately, and while they do not
    /// know enough of the motion, the part of the last one that does not outlast an interval.
    pub(super) fn doubt(&self, r: &[f64]) -> f64 {
        if (self.intervals as f64) < r[TERMS + 1] {
            self.off + (1.0 - r[TERMS]) * self.alpha[0].abs()
        } else {
            self.off
        }
    }

    /// Looks what the last forecast was off by. `r` is the port's recurrence; forecasts count from that many intervals
    /// on, for before they cannot know.
    pub(super) fn review(&mut self, alpha: f64, before: u64, r: &[f64]) {
        let (last, error) = (FORGET * self.off, (alpha - self.forecast).abs());
        self.off = if before as f64 > r[TERMS + 2] && last < error { error } else { last };
    }

    /// Notes an interval that is over: its alpha, and what was held.
    pub(super) fn note(&mut self, alpha: f64, v: f64) {
        self.alpha.rotate_right(1);
        self.before.rotate_right(1);
        (self.alpha[0], self.before[0]) = (alpha, v);
        self.intervals += 1;
    }

    /// Ends an interval: what is known of the other side now. `response` is beta times what was held; `r` is the port's
    /// recurrence.
    pub(super) fn learn(&mut self, response: f64, gap: u32, r: &[f64]) {
        if self.silent {
            return;
        }
        if gap == 0 {
            let alpha = self.q + response;
            self.review(alpha, self.intervals, r);
            self.note(alpha, self.v);
            self.last_q = self.q;
        } else {
            // All that is known of the motion is its mean; a jump in it would be taken for a push.
            let mean = self.q / (f64::from(gap) + 1.0);
            self.alpha = [mean + response; TERMS + 1];
            self.before = [self.v; TERMS + 1];
            self.last_q = mean;
            self.intervals += 1;
        }
    }
}

/// What a sampled cluster still puts at risk that is in debt, or lost something while another that it is joined to was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Caution {
    /// The largest debt since there was none, its own or another's, J.
    pub(super) peak: f64,
    /// The part of what could be risked that is: less after each loss, its own or another's, in proportion to it; 1
    /// where nobody is in debt.
    pub(super) trust: f64,
    /// What the interval that runs could lose, J, were the other side to move against what is held as fast as it is
    /// foretold to move at all.
    pub(super) risk: f64,
    /// The most that it ever was, or that crossed and sources put in in an interval, by magnitude, J.
    pub(super) most: f64,
}

impl Default for Caution {
    fn default() -> Self {
        Self { peak: 0.0, trust: 1.0, risk: 0.0, most: 0.0 }
    }
}

impl Caution {
    /// Whether it lost nothing.
    pub(super) fn is_easy(&self) -> bool {
        self.peak == 0.0 && self.trust == 1.0
    }

    /// Notes an energy of an interval that debts are rounding beside.
    pub(super) fn note(&mut self, energy: f64) {
        self.most = if self.most < energy { energy } else { self.most };
    }

    /// Ends an interval, in which so much came in, with a debt (not above 0 where there is none), and whether nobody
    /// has one. By how much it is trusted less for what it lost: 1 where it lost nothing.
    pub(super) fn settle(&mut self, (debt, free): (f64, bool), crossed: f64) -> f64 {
        if free {
            (self.peak, self.trust) = (0.0, 1.0);
            return 1.0;
        }
        let out = -crossed;
        let lost = if debt < out { debt } else { out };
        let mut cost = 1.0;
        if lost > LOSS * self.most {
            let part = lost / self.risk;
            let part = if part < 1.0 { part } else { 1.0 };
            cost = 1.0 + WARY * part;
            self.trust /= cost;
        }
        self.peak = if self.peak < debt { debt } else { self.peak };
        cost
    }

    /// In debt, or distrusted, scales held variables down until no more is at risk than was repaid since the debt was
    /// largest (or is stored besides), or than is trusted: of what they put at risk, W(s) = s u + s^2 b at s times
    /// them, where `doubt` is what each alpha may be off by.
    pub(super) fn restrain(
        &mut self,
        v: &mut [f64],
        alpha: &[f64],
        doubt: impl Iterator<Item = f64>,
        beta: &[f64],
        stored: f64,
    ) {
        let u: f64 = v.iter().zip(alpha).zip(doubt).map(|((v, a), d)| v.abs() * (a.abs() + d)).sum();
        let b = given_way(v, beta);
        let b = if b > 0.0 { b } else { 0.0 };
        let all = u + b;
        self.risk = all;
        self.note(all);
        if stored < 0.0 || self.trust < 1.0 {
            let (trusted, repaid) = (self.trust * all, self.peak + stored);
            let most = if trusted < repaid { repaid } else { trusted };
            if most < all {
                let s = 2.0 * most / (u + (u * u + 4.0 * b * most).sqrt());
                let s = if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 };
                v.iter_mut().for_each(|v| *v *= s);
                self.risk = most;
            }
        }
    }
}

/// What the other side gives way by itself, v beta v.
fn given_way(v: &[f64], beta: &[f64]) -> f64 {
    let n = v.len();
    let mut b = 0.0;
    for i in 0..n {
        for j in 0..n {
            b += v[i] * beta[i * n + j] * v[j];
        }
    }
    b
}

/// Scales held variables down until the energy that the interval is foretold to give back is at most `room`, and be
/// each alpha off by `doubt` of what it is foretold to be, against what is held.
///
/// The energy in is v (alpha - beta v), concave along the ray of v, and 0 at its start.
pub(super) fn within_budget(v: &mut [f64], alpha: &[f64], doubt: impl Iterator<Item = f64>, beta: &[f64], room: f64) {
    let a: f64 = v.iter().zip(alpha).map(|(v, a)| v * a).sum();
    let less: f64 = v.iter().zip(doubt).map(|(v, d)| v.abs() * d).sum();
    let (a, b) = (a - less, given_way(v, beta));
    if a - b >= -room {
        return;
    }
    let s = if b > 0.0 { (a + (a * a + 4.0 * b * room).sqrt()) / (2.0 * b) } else { room / -a };
    let s = if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 };
    for v in v {
        *v *= s;
    }
}
