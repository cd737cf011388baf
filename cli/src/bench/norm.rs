//! The distance between two runs.

use super::trial::Run;
use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_compiler::structure::State;
use bond_compiler::units;
use std::collections::BTreeMap;

/// Least size of a probe, as a part of the largest value of its unit: one that is 0 apart from rounding has no size of
/// its own.
const LEAST_SIZE: f64 = 1e-3;
/// An energy or a power below this part of the scene's is rounding, and is measured relative to the scene's.
const ENERGY_ROUNDING: f64 = 1e-12;

/// The compared quantities: names, and units if known.
pub struct Quantities {
    /// Probes, then states.
    pub names: Vec<String>,
    units: Vec<Option<String>>,
    /// How many of them are probes.
    pub probes: usize,
}

impl Quantities {
    /// The probes of a scene, and the energy and signal states of all its regions.
    pub fn new(compiled: &Compiled) -> Self {
        let scene = compiled.scene();
        let mut names = scene.probes.names.clone();
        let probes = names.len();
        // Angles and bare numbers are of one size.
        let dimension = |u: &String| units::read(u).map_or(u.clone(), |u| u.dimension.to_string());
        let mut units: Vec<Option<String>> =
            (0..probes).map(|i| scene.probes.units.get(i)?.as_ref().map(dimension)).collect();
        let regions = &compiled.stages().form.regions;
        let dimension = |s: &State| s.unit.as_ref().map(|u| u.dimension.to_string());
        let known: BTreeMap<&str, Option<String>> =
            regions.iter().flat_map(|r| &r.states).map(|s| (s.name.as_str(), dimension(s))).collect();
        for name in scene.clusters.iter().flat_map(|c| c.names.iter().take(c.states)) {
            units.push(known.get(name.as_str()).cloned().flatten());
            names.push(name.clone());
        }
        Self { names, units, probes }
    }

    /// The size to which errors are relative: of a state, the largest magnitude of any state or probe of its unit in a
    /// run; of a probe its own, and at least a small part of that.
    pub fn scales(&self, run: &Run) -> Vec<f64> {
        let mut groups: BTreeMap<&str, f64> = BTreeMap::new();
        for (unit, x) in self.units.iter().zip(&run.largest) {
            if let Some(unit) = unit {
                let group = groups.entry(unit).or_insert(0.0);
                *group = group.max(*x);
            }
        }
        let scale = |i: usize| {
            let own = run.largest[i];
            let group = self.units[i].as_deref().and_then(|u| groups.get(u)).copied().unwrap_or(own);
            let scale = own.max(if i < self.probes { LEAST_SIZE * group } else { group });
            let (least, size) = match self.units[i].as_deref().filter(|_| i < self.probes) {
                Some("J") => (ENERGY_ROUNDING * run.energy, run.energy),
                Some("W") => (ENERGY_ROUNDING * run.power, run.power),
                Some(_) | None => (0.0, 1.0),
            };
            if scale > least { scale } else { size.max(f64::MIN_POSITIVE) }
        };
        (0..self.names.len()).map(scale).collect()
    }
}

/// The differences of two runs, relative to scales.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    /// Of each quantity at the end.
    pub end: Vec<f64>,
    /// Of each probe, the largest at a row or the end.
    pub along: Vec<f64>,
}

impl Difference {
    /// Of the ends of two runs, and of the rows where both have them.
    pub fn new(run: &Run, other: &Run, scales: &[f64]) -> Self {
        let end: Vec<f64> = run.end.iter().zip(&other.end).zip(scales).map(|((a, b), s)| (a - b).abs() / s).collect();
        let probes = run.rows.first().map_or(0, Vec::len);
        let mut along: Vec<f64> = end.iter().take(probes).copied().collect();
        for (a, b) in run.rows.iter().zip(&other.rows) {
            for (k, worst) in along.iter_mut().enumerate() {
                *worst = worst.max((a[k] - b[k]).abs() / scales[k]);
            }
        }
        Self { end, along }
    }

    /// The largest at the end.
    pub fn at_end(&self) -> f64 {
        largest(&self.end)
    }

    /// The largest of all.
    pub fn anywhere(&self) -> f64 {
        largest(&self.end).max(largest(&self.along))
    }
}

fn largest(list: &[f64]) -> f64 {
    list.iter().copied().fold(0.0, f64::max)
}
