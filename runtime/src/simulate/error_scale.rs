//! What errors of states and integrals are measured by.

use crate::scene::Cluster;

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
/// The largest and smallest power of two to which a state is moved for that.
const OCTAVES: i32 = 200;

impl Scale {
    /// Those of a cluster's states, then of its integrals, by what `stored` gives at the start. An error that is less
    /// than a `part` of what is measured is none.
    pub(super) fn all(c: &Cluster, stored: &[f64], part: f64) -> Vec<Self> {
        let state = |i: usize| {
            let (curvature, grain) = (stored[c.curvatures[i]], stored[c.grains[i]]);
            let faintest = part * c.sizes[i];
            let heat = c.heats.contains(&i);
            if curvature.is_nan() || curvature <= 0.0 {
                let drift = if curvature == 0.0 && grain.is_finite() { grain } else { 0.0 };
                return Self { natural: 0.0, heat, faintest: if curvature == 0.0 { faintest } else { 0.0 }, drift };
            }
            let natural = (2.0 / curvature).sqrt();
            let natural = if natural.is_finite() { natural } else { 0.0 };
            let faintest = faintest.max(grain / curvature);
            Self { natural, heat, faintest, drift: 0.0 }
        };
        let integral = |size: &f64| Self { natural: 0.0, heat: false, faintest: part * size, drift: 0.0 };
        (0..c.states).map(state).chain(c.sizes[c.states..].iter().map(integral)).collect()
    }

    /// Where H does not bend at the start, as of bodies that touch by Hertz' law: how far away the scene's `energy`
    /// lies, by the curvature there, `bends` of a state and how far it is moved. An error of next to nothing would be
    /// one of all that there is, else.
    pub(super) fn look_further(
        scales: &mut [Self],
        c: &Cluster,
        (stored, energy): (&[f64], f64),
        mut bends: impl FnMut(usize, f64) -> Option<f64>,
    ) {
        if c.states > FAR || energy <= 0.0 {
            return;
        }
        for (i, scale) in scales.iter_mut().enumerate().take(c.states) {
            if stored[c.curvatures[i]] != 0.0 {
                continue;
            }
            let sizes = (-OCTAVES..=OCTAVES).map(|k| 2f64.powi(k));
            let mut holds = |x: f64| bends(i, x).is_some_and(|k| k.is_finite() && 0.5 * k * x * x >= energy);
            scale.natural = sizes.into_iter().find(|x| holds(*x) || holds(-x)).map_or(0.0, |x| x / energy.sqrt());
        }
    }
}
