//! What crosses a double bar, and what a sampled region knows of its other side.

use crate::ledger::Sum;
use serde::{Deserialize, Serialize};

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
    /// Energy that crossed in the interval that ended last.
    pub(super) crossed: f64,
    /// The answer of the last interval.
    pub(super) last_q: f64,
    /// alpha of the last two intervals, and the held variable of the last two.
    pub(super) alpha: [f64; 2],
    pub(super) before: [f64; 2],
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
    /// What the next interval's alpha is foretold to be, from the samples alone: the last one, moved by the outside
    /// force that its change showed, and by the held variable's own effect after its interval.
    ///
    /// `gamma` is that effect on the next interval (twice beta for a thing that just moves), `decay` how much of a
    /// motion is left after an interval (1 for such a thing). Before there are two intervals no outside force is known.
    pub(super) fn foretold(&self, gamma: &[f64], changes: &[f64], decay: f64) -> f64 {
        let effect: f64 = gamma.iter().zip(changes).map(|(g, c)| g * c).sum();
        match self.intervals {
            0 => 0.0,
            1 => decay * self.alpha[0] - effect,
            _ => self.alpha[0] + decay * (self.alpha[0] - self.alpha[1]) - effect,
        }
    }

    /// Ends an interval: what is known of the other side now. `response` is beta times what was held.
    pub(super) fn learn(&mut self, response: f64, gap: u32) {
        if self.silent {
            return;
        }
        if gap == 0 {
            self.alpha = [self.q + response, self.alpha[0]];
            self.before = [self.v, self.before[0]];
            self.last_q = self.q;
        } else {
            // All that is known of the motion is its mean; a jump in it would be taken for a push.
            let mean = self.q / (f64::from(gap) + 1.0);
            self.alpha = [mean + response; 2];
            self.before = [self.v; 2];
            self.last_q = mean;
        }
        self.intervals += 1;
    }

    /// Change of the held variable over the last two intervals.
    pub(super) fn change(&self) -> f64 {
        self.before[0] - self.before[1]
    }
}

/// Scales held variables down until the energy that the interval is foretold to give back is at most `room`.
///
/// The energy in is v (alpha - beta v), concave along the ray of v, and 0 at its start.
pub(super) fn within_budget(v: &mut [f64], alpha: &[f64], beta: &[f64], room: f64) -> bool {
    let n = v.len();
    let a: f64 = v.iter().zip(alpha).map(|(v, a)| v * a).sum();
    let mut b = 0.0;
    for i in 0..n {
        for j in 0..n {
            b += v[i] * beta[i * n + j] * v[j];
        }
    }
    if a - b >= -room {
        return false;
    }
    let s = if b > 0.0 { (a + (a * a + 4.0 * b * room).sqrt()) / (2.0 * b) } else { room / -a };
    let s = if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 };
    for v in v {
        *v *= s;
    }
    true
}
