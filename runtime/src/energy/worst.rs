//! The worst relative error of a run, where each error has a scale of its own, and the least scale that counts is known
//! at the end.

use serde::{Deserialize, Serialize};

/// Scales that are told apart: binary orders of magnitude above the floor so far.
const BINS: usize = 32;

/// The largest of `error / max(scale, floor)`; the floor never falls, and is known for good when the largest is asked
/// for.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Worst {
    /// The binary exponent of the floor so far.
    low: i32,
    /// The largest error at a scale below that.
    below: f64,
    /// By the exponent of the scale above `low`: the largest error, and the largest relative one.
    bins: [(f64, f64); BINS],
}

/// The exponent of a number that is not below 0; that of 0 and the subnormal ones is 0.
fn exponent(x: f64) -> i32 {
    (x.to_bits() >> 52) as i32 & 0x7ff
}

impl Worst {
    /// Adds an error, 0 or above. One that is at most another by itself and beside its scale may be left out.
    pub(super) fn add(&mut self, error: f64, scale: f64, floor: f64) {
        let low = exponent(floor);
        if low > self.low {
            let gone = ((low - self.low) as usize).min(BINS);
            self.below = self.bins[..gone].iter().fold(self.below, |m, b| m.max(b.0));
            self.bins.copy_within(gone.., 0);
            self.bins[BINS - gone..].fill((0.0, 0.0));
            self.low = low;
        }
        match usize::try_from(exponent(scale) - self.low) {
            Ok(at) => {
                let relative = if error > 0.0 { error / scale } else { 0.0 };
                let (e, r) = &mut self.bins[at.min(BINS - 1)];
                (*e, *r) = (e.max(error), r.max(relative));
            }
            Err(_) => self.below = self.below.max(error),
        }
    }

    /// The largest. A scale within a factor of 2 of the floor may be taken for smaller than it is, by that factor.
    pub(super) fn above(&self, floor: f64) -> f64 {
        let at = exponent(floor) - self.low;
        let small = |e: f64| if e > 0.0 { e / floor } else { 0.0 };
        let value = |(i, (e, r)): (usize, &(f64, f64))| if i as i32 > at { *r } else { small(*e).min(*r) };
        self.bins.iter().enumerate().map(value).fold(small(self.below), f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_scales_are_measured_against_the_floor() {
        let mut worst = Worst::default();
        let near = |x: f64, y: f64| assert!((x / y - 1.0).abs() < 1e-12, "{x:e} is not {y:e}");
        worst.add(1e-20, 1e-13, 1e-15);
        near(worst.above(1e-15), 1e-7);
        worst.add(1e-14, 1.0, 1e-4);
        near(worst.above(1e-4), 1e-14);
        near(worst.above(1e-3), 1e-14);
        worst.add(1e-14, 1.0, 1e-3);
        near(worst.above(1e-3), 1e-14);
        worst.add(1e-15, 0.0, 1e-3);
        near(worst.above(1e-3), 1e-12);
        near(worst.above(1.0), 1e-14);
    }

    #[test]
    fn nothing_is_measured_against_nothing() {
        let mut worst = Worst::default();
        worst.add(0.0, 0.0, 0.0);
        assert_eq!(worst.above(0.0), 0.0);
        worst.add(1e-30, 0.0, 0.0);
        assert_eq!(worst.above(0.0), f64::INFINITY);
    }
}
