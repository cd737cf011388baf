//! What crosses a double bar, and what a sampled region knows of its other side.

use super::encoder::Encoder;
use serde::{Deserialize, Serialize};

/// What the outside tells of an open port's interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// How far it moved: the integral of its flow, or of its effort where the flow is held.
    pub q: f64,
    /// The energy that it put in, J, where what it met was not what is held now, as with a latency; `v q` otherwise.
    pub energy: Option<f64>,
    /// So many intervals before this one were silent, and `q` is over them too.
    pub gap: u32,
    /// Nothing was heard. What is held stays, and what the outside does is not predicted anew.
    pub silent: bool,
}

/// A port that a sampled cluster holds: a double bar's or an open one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Held {
    /// The double bar, if it is one; else the open port.
    pub(super) bar: Option<usize>,
    pub(super) open: Option<usize>,
    /// Of a holder that goes by another clock: the answer since that one's last sample; what of it the other side, in
    /// its interval that runs, was taken to give; and what it gave a second in the one before.
    pub(super) got: f64,
    pub(super) ahead: f64,
    pub(super) rate: f64,
    /// Nothing was heard of the interval that ended: what is held stays.
    pub(super) silent: bool,
    /// What was held at the start of the interval that runs, where that was let go within it.
    pub(super) let_go: Option<LetGo>,
    /// What a limited sampled side left out, in the interval that runs.
    pub(super) unmet: Unmet,
    /// What was found at the last sample, where that is not yet held.
    pub(super) next: Option<f64>,
    /// What it has read of the other side's motion.
    pub(super) encoder: Encoder,
}

impl Held {
    /// What the other side met on average of a value that was held for a time.
    pub(super) fn met(&self, value: f64, time: f64) -> f64 {
        value * (1.0 - self.unmet.time / time).max(0.0)
    }
}

/// What a sampled side that is limited meets less of what is held for it, and tells less of how it moved.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Unmet {
    /// For so long nothing of it was met, or a part of it for longer, s.
    pub(super) time: f64,
    /// How far it moved that was not told.
    pub(super) motion: f64,
}

/// What was held until it was let go within an interval.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct LetGo {
    pub(super) value: f64,
    /// The part of the interval for which it was held.
    pub(super) lasted: f64,
}

/// How the answer of one other side is taken anew.
#[derive(Debug)]
pub(super) struct Tangent {
    /// The other side.
    pub(super) other: usize,
    /// The ports that are held for it, by their number at the holder.
    pub(super) held: Vec<usize>,
    /// Steps of an interval, of each part of it.
    pub(super) steps: usize,
    pub(super) state: Vec<f64>,
    pub(super) input: Vec<f64>,
    pub(super) answers: Vec<f64>,
    /// The answers of so few steps at the start, and the ones that were measured.
    pub(super) first: Vec<f64>,
    pub(super) measured: Vec<f64>,
}
