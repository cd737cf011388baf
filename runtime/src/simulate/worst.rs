//! The worst relative error of a run, where each error has a scale of its own and the least scale that counts is known at the end.

/// Binary exponents that share a bin.
const WIDTH: i32 = 32;
const BINS: usize = 2112 / WIDTH as usize;

/// The largest of `error / max(scale, floor)`, the floor being told when it is asked for.
#[derive(Clone, Debug)]
pub(super) struct Worst {
    /// By the exponent of the scale: the largest error, and the largest relative one.
    bins: Box<[(f64, f64)]>,
}

impl Default for Worst {
    fn default() -> Self {
        Self { bins: vec![(0.0, 0.0); BINS].into_boxed_slice() }
    }
}

/// The bin of a scale; 0 and the subnormal ones come first.
fn bin(scale: f64) -> usize {
    (scale.to_bits() >> 52 & 0x7ff) as usize / WIDTH as usize
}

impl Worst {
    /// Adds an error, 0 or above.
    pub(super) fn add(&mut self, error: f64, scale: f64) {
        let relative = if error > 0.0 { error / scale } else { 0.0 };
        let (e, r) = &mut self.bins[bin(scale)];
        (*e, *r) = (e.max(error), r.max(relative));
    }

    /// The largest; within the bin of the floor it may be counted as somewhat larger than it is.
    pub(super) fn above(&self, floor: f64) -> f64 {
        let at = bin(floor);
        let below = |e: f64| if e > 0.0 { e / floor } else { 0.0 };
        let value = |(i, (e, r)): (usize, &(f64, f64))| match i.cmp(&at) {
            std::cmp::Ordering::Less => below(*e),
            std::cmp::Ordering::Equal => below(*e).min(*r),
            std::cmp::Ordering::Greater => *r,
        };
        self.bins.iter().enumerate().map(value).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_scales_are_measured_against_the_floor() {
        let mut worst = Worst::default();
        worst.add(1e-20, 1e-13);
        worst.add(1e-14, 1.0);
        assert_eq!(worst.above(0.0), 1e-7);
        assert_eq!(worst.above(1e-3), 1e-14);
        worst.add(1e-15, 0.0);
        assert_eq!(worst.above(0.0), f64::INFINITY);
        assert_eq!(worst.above(1e-3), 1e-12);
    }
}
