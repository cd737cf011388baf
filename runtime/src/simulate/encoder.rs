//! An encoder: it reads a motion in steps of its resolution.

use serde::{Deserialize, Serialize};

/// What an encoder has read of a motion since the start.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Encoder {
    /// How far the motion came.
    moved: f64,
    /// The steps that were read of it.
    steps: f64,
    /// The largest that was held against it.
    pub(super) most: f64,
}

impl Encoder {
    /// What is read of a further motion: as much as brings what was read in all to the step that is nearest to all that
    /// was moved. With no resolution that is the motion itself.
    pub(super) fn read(&mut self, moved: f64, resolution: f64) -> f64 {
        if resolution == 0.0 {
            return moved;
        }
        self.moved += moved;
        let steps = (self.moved / resolution).round();
        let read = (steps - self.steps) * resolution;
        self.steps = steps;
        read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was read stays within half a step of the motion, however that is told in pieces.
    #[test]
    fn reads_to_half_a_step() {
        let (mut encoder, mut moved, mut read) = (Encoder::default(), 0.0, 0.0);
        for k in 0..1000 {
            let piece = (f64::from(k) * 0.7).sin() * 0.3;
            moved += piece;
            read += encoder.read(piece, 0.25);
            assert!((moved - read).abs() <= 0.125 + 1e-12, "{moved} {read}");
        }
        assert_eq!(Encoder::default().read(0.3, 0.0), 0.3);
    }
}
