//! What crosses a double bar, and what a sampled region knows of its other side.

use crate::ledger::Sum;
use serde::{Deserialize, Serialize};

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
    /// Energy that crossed since the last sample, where the other side is sampled too and may have latched earlier values.
    pub(super) w: f64,
    /// Energy that crossed in the interval that ended last.
    pub(super) crossed: f64,
    /// The answer of the last interval.
    pub(super) last_q: f64,
    /// alpha of the last two intervals, and the held variable of the last two.
    pub(super) alpha: [f64; 2],
    pub(super) before: [f64; 2],
    /// How many intervals are over.
    pub(super) intervals: u64,
    /// Energy in, as the holder counts it, and as the other side does.
    pub(super) holder_energy: Sum,
    pub(super) other_energy: Sum,
    pub(super) difference: f64,
}

impl Held {
    /// What the next interval's alpha is foretold to be, from the samples alone: the last one, moved by the outside force that its
    /// change showed, and by the held variable's own effect after its interval.
    ///
    /// `gamma` is that effect on the next interval (twice beta for a thing that just moves), `decay` how much of a motion is left
    /// after an interval (1 for such a thing). Before there are two intervals no outside force is known.
    pub(super) fn foretold(&self, gamma: &[f64], changes: &[f64], decay: f64) -> f64 {
        let effect: f64 = gamma.iter().zip(changes).map(|(g, c)| g * c).sum();
        match self.intervals {
            0 => 0.0,
            1 => decay * self.alpha[0] - effect,
            _ => self.alpha[0] + decay * (self.alpha[0] - self.alpha[1]) - effect,
        }
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
