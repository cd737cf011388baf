//! What errors of states and integrals are measured by.

use crate::energy::FAINTEST;
use crate::scene::Cluster;

/// The part of the faintest energy that is its rounding: an error of a state that is worth less is none.
const ROUNDED: f64 = 1e-15;
/// The same of what has no energy, a state or an integral, in SI units.
const SMALLEST: f64 = 1e-24;

/// What an error of a state or an integral is measured by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// How far an energy of 1 J moves the state, by the curvature of H at the start; 0 where H does not bend.
    pub(super) natural: f64,
    /// Whether it is of a storage of heat.
    pub(super) heat: bool,
    /// An error that is no more is rounding, as all is of a body that is held at rest.
    pub(super) faintest: f64,
    /// The same of a second's change, where the state has no energy: it may count the speed of such a body.
    pub(super) drift: f64,
}

/// States of which it is looked for where their energies bend, at most.
const FAR: usize = 256;

impl Scale {
    /// Those of a cluster's states, then of its integrals, by what `stored` gives at the start.
    pub(super) fn all(c: &Cluster, stored: &[f64]) -> Vec<Self> {
        let state = |(i, (curvature, grain)): (usize, (&usize, &usize))| {
            let (curvature, grain) = (stored[*curvature], stored[*grain]);
            let heat = c.heats.contains(&i);
            if curvature.is_nan() || curvature <= 0.0 {
                let drift = if curvature == 0.0 && grain.is_finite() { grain } else { 0.0 };
                return Self { natural: 0.0, heat, faintest: if curvature == 0.0 { SMALLEST } else { 0.0 }, drift };
            }
            let natural = (2.0 / curvature).sqrt();
            let natural = if natural.is_finite() { natural } else { 0.0 };
            let faintest = (grain / curvature).max((2.0 * ROUNDED * FAINTEST / curvature).sqrt());
            Self { natural, heat, faintest, drift: 0.0 }
        };
        let integral = Self { natural: 0.0, heat: false, faintest: SMALLEST, drift: 0.0 };
        let states = c.curvatures.iter().zip(&c.grains).enumerate().map(state);
        states.chain(std::iter::repeat_n(integral, c.integrals)).collect()
    }

    /// Where H does not bend at the start, as of bodies that touch by Hertz' law: how far away an energy of 1 J lies,
    /// by the curvature there, `bends` of a state and how far it is moved. An error of next to nothing would be one of
    /// all that there is, else.
    pub(super) fn look_further(
        scales: &mut [Self],
        c: &Cluster,
        stored: &[f64],
        mut bends: impl FnMut(usize, f64) -> Option<f64>,
    ) {
        if c.states > FAR {
            return;
        }
        for (i, scale) in scales.iter_mut().enumerate().take(c.states) {
            if stored[c.curvatures[i]] != 0.0 {
                continue;
            }
            let sizes = (-15..=9).map(|k| 10f64.powi(k));
            let mut holds = |x: f64| bends(i, x).is_some_and(|k| k.is_finite() && 0.5 * k * x * x >= 1.0);
            scale.natural = sizes.into_iter().find(|x| holds(*x) || holds(-x)).unwrap_or(0.0);
        }
    }
}
