//! What errors of states and integrals are measured by.

use super::cluster::Run;
use super::program::Look;
use crate::interpreter::Interpret;
use crate::kernel::Failure;
use crate::scene::{Cluster, Scene};

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
    /// Those of a cluster's states, then of its integrals, by what is stored at the start. An error that is next to
    /// nothing beside what is measured is none.
    pub(super) fn all(c: &Cluster, run: &Run, scene: &Scene) -> Result<Vec<Self>, Failure> {
        let part = scene.numeric.error.faintest_change;
        let mut look = Look::new(&c.stored, &Interpret);
        let stored = look.run(&run.state, &run.input)?.to_vec();
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
        let mut scales: Vec<_> = (0..c.states).map(state).chain(c.sizes[c.states..].iter().map(integral)).collect();
        if c.states > FAR || scene.energy <= 0.0 {
            return Ok(scales);
        }
        // Where H does not bend at the start, as of bodies that touch by Hertz' law: how far away the scene's energy
        // lies, by the curvature there. An error of next to nothing would be one of all that there is, else.
        let mut moved = run.state.clone();
        for i in (0..c.states).filter(|i| stored[c.curvatures[*i]] == 0.0) {
            let mut holds = |x: f64| {
                moved[i] = run.state[i] + x;
                let bends = look.run(&moved, &run.input).ok().map(|out| out[c.curvatures[i]]);
                bends.is_some_and(|k| k.is_finite() && 0.5 * k * x * x >= scene.energy)
            };
            let found = (-OCTAVES..=OCTAVES).map(|k| 2f64.powi(k)).find(|x| holds(*x) || holds(-x));
            scales[i].natural = found.map_or(0.0, |x| x / scene.energy.sqrt());
            moved[i] = run.state[i];
        }
        Ok(scales)
    }
}
