//! What a run did, in numbers.

use super::cluster::Book;
use super::schedule::Simulation;
use std::borrow::Cow;

/// What the balance of a step is off by at most, relative, where it is said to be kept.
pub const KEPT: f64 = 1e-12;
/// The same for each state, where there are many: a sum of n terms is rounded by up to n parts in 1e16 of itself
/// (Higham, Accuracy and Stability of Numerical Algorithms, 4.2), and there are two of them in a balance.
const KEPT_EACH: f64 = 2.0 * f64::EPSILON;
/// Energies below this part of the scene's largest are rounding.
const FLOOR: f64 = 1e-14;
/// What H may be above all that was given, as a part of what was held before, where another energy keeps the balance.
const GROWN: f64 = 0.1;
/// What a region may owe, as a part of the energies there: that much is rounding.
const OWED: f64 = 1e-11;
/// What a resistor may give in a step, as a part of the energy there: a loop is solved to about 1e-11.
const GAIN: f64 = 1e-9;
/// J, and what that is a part of at least: k T in a room. Where next to nothing moves, rounding of a speed times a
/// force may have any sign.
const THERMAL: f64 = 4e-21;
/// What rounding may make of an energy in each step.
const ROUNDING: f64 = 1e-15;

/// A source's, resistor's or double bar's share.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ElementEnergy {
    /// The element.
    pub name: String,
    /// J
    pub energy: f64,
}

/// What a resistor with thermal ports produced.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ElementEntropy {
    /// The element.
    pub name: String,
    /// J/K
    pub entropy: f64,
}

/// How far the energy that a stepper keeps is from H.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Modified {
    /// It less H, now, J.
    pub difference: f64,
    /// The largest magnitude of that, J.
    pub max_difference: f64,
    /// The same, as a part of the largest energy that was stored or turned over in a step.
    pub relative: f64,
    /// The most, as the next one measures it, that H was above what it was at the start and what was supplied since
    /// less what was dissipated, J.
    pub grown: f64,
    /// The same, as a part of the largest energy that was held until then, or given in that step.
    pub grown_relative: f64,
}

/// A region's ledger at one instant. Energies in J, since the start.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RegionSummary {
    /// Its name.
    pub name: String,
    /// `continuous` or `sampled`.
    pub kind: &'static str,
    /// s
    pub period: Option<f64>,
    /// Energy states.
    pub states: usize,
    /// The method.
    pub stepper: Cow<'static, str>,
    /// Why it was taken: `it is linear`; empty where there was no choice.
    pub why: Cow<'static, str>,
    /// Its order; 0: no error.
    pub order: u32,
    /// The hold, of a sampled region.
    pub hold: Option<Cow<'static, str>>,
    /// Steps done.
    pub steps: u64,
    /// Attempts at adaptive steps that were not kept.
    pub rejected: u64,
    /// Switches of laws at which adaptive steps were ended.
    pub events: u64,
    /// Newton iterations done in them.
    pub newton_iterations: u64,
    /// At the start.
    pub h_initial: f64,
    /// Now.
    pub h_final: f64,
    /// The largest seen.
    pub h_max: f64,
    /// In through sources, ports and double bars.
    pub supplied: f64,
    /// Lost in resistors.
    pub dissipated: f64,
    /// Created by holds and leaps.
    pub leaked: f64,
    /// Largest debt to the outside.
    pub debt_max: f64,
    /// Energy in the tank.
    pub tank: f64,
    /// Energy leaps of `ray`.
    pub leaps: u64,
    /// Worst residual of a step's balance, relative to the larger of H and what the step turned over.
    pub worst_step: f64,
    /// Sum of the residuals, relative to the largest H.
    pub total: f64,
    /// Whether the stepper keeps the balance by construction.
    pub passive_stepper: bool,
    /// The ledger is of a pseudo energy.
    pub pseudo: bool,
    /// Where the ledger is of an energy that the stepper keeps in the place of H: how far from H that is.
    pub modified: Option<Modified>,
    /// By source, port or double bar.
    pub sources: Vec<ElementEnergy>,
    /// By resistor; below 0 where an active one injected energy.
    pub resistors: Vec<ElementEnergy>,
    /// Entropy produced by each field with thermal ports.
    pub produced: Vec<ElementEntropy>,
    /// The largest fall of entropy in a step, times the temperature there, relative to the larger of H and what is
    /// turned over; 0 where none fell.
    pub sunk: f64,
}

/// A double bar's ledger: what crossed, as each side counts it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BarSummary {
    /// The bond.
    pub name: String,
    /// J into the holder, as the holder counts it.
    pub holder: f64,
    /// J out of the other side, as that counts it.
    pub other: f64,
    /// Largest difference at a sample of the holder; the invariant is exactly 0.
    pub difference: f64,
}

/// The whole ledger at one instant.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// s
    pub time: f64,
    /// Whether the run kept its promise, and nothing was excluded.
    pub passive: bool,
    /// Why not, in words; empty where it did.
    pub reasons: Vec<String>,
    /// Worst residual of a step of any region with a passive stepper.
    pub worst_step: f64,
    /// Largest total residual of any region with a passive stepper.
    pub total: f64,
    /// The regions.
    pub regions: Vec<RegionSummary>,
    /// The double bars.
    pub bars: Vec<BarSummary>,
}

impl Simulation<'_> {
    /// The ledger.
    pub fn summary(&self) -> Summary {
        let mut regions = Vec::new();
        let mut gained = Vec::new();
        let books: Vec<_> =
            self.scene.clusters.iter().zip(&self.runs).map(|(c, run)| run.books_at(c, self.time)).collect();
        let largest = books.iter().flat_map(|b| b.iter()).map(Book::largest).fold(0.0, f64::max);
        for (r, region) in self.scene.regions.iter().enumerate() {
            let c = &self.scene.clusters[region.cluster];
            let run = &self.runs[region.cluster];
            let Some(k) = c.entries.iter().position(|e| e.region == r) else { continue };
            let (b, e) = (&books[region.cluster][k], &c.entries[k]);
            let (control, newton_iterations) = run.kept();
            let list = |names: &[(String, usize)], sums: &[crate::ledger::Sum]| {
                names.iter().zip(sums).map(|(n, s)| ElementEnergy { name: n.0.clone(), energy: s.value() }).collect()
            };
            let floor = b.floor().max(FLOOR * largest);
            // Beside heat, which is large, a step may give much before that is seen.
            let rounding = run.steps as f64 * (GAIN * b.turnover_max.max(THERMAL) + ROUNDING * b.largest());
            gained.push((b.gained.above(floor.max(THERMAL)), b.giver, b.owed, rounding));
            regions.push(RegionSummary {
                name: region.name.clone(),
                kind: if region.period.is_some() { "sampled" } else { "continuous" },
                period: region.period,
                states: region.states,
                stepper: c.step.name.clone(),
                why: c.step.why.clone(),
                order: c.step.properties.order,
                hold: Some(c.hold.clone()).filter(|h| !h.is_empty() && !c.holds.is_empty()),
                steps: run.steps,
                rejected: control.map_or(0, |k| k.rejected),
                events: control.map_or(0, |k| k.events),
                newton_iterations,
                h_initial: b.h_initial,
                h_final: b.h,
                h_max: b.h_max,
                supplied: b.supplied.value(),
                dissipated: b.dissipated.value(),
                leaked: b.leaked.value(),
                debt_max: b.debt_max,
                tank: if region.period.is_some() { b.tank() + e.least } else { 0.0 },
                leaps: b.leaps,
                worst_step: b.worst.above(floor),
                total: if b.largest() > 0.0 { b.residual.abs() / b.largest() } else { 0.0 },
                passive_stepper: c.step.properties.passive,
                pseudo: region.pseudo,
                modified: e.modified.map(|_| Modified {
                    difference: b.modified.0,
                    max_difference: b.modified.1,
                    relative: if b.largest() > 0.0 { b.modified.1 / b.largest() } else { 0.0 },
                    grown: b.grown.1,
                    grown_relative: b.grown.0,
                }),
                sources: list(&e.supplied, &b.sources),
                resistors: list(&e.dissipated, &b.resistors),
                produced: e
                    .produced
                    .iter()
                    .zip(&b.produced)
                    .map(|(p, s)| ElementEntropy { name: p.name.clone(), entropy: s.value() })
                    .collect(),
                sunk: b.sunk.above(floor),
            });
        }
        let bars = self
            .scene
            .bars
            .iter()
            .enumerate()
            .filter_map(|(i, bar)| {
                let h = self.held.iter().flatten().find(|h| h.bar == Some(i))?;
                Some(BarSummary {
                    name: bar.name.clone(),
                    holder: h.holder_energy.value(),
                    other: h.other_energy.value(),
                    difference: h.difference,
                })
            })
            .collect();
        let mut reasons: Vec<String> = self.scene.excluded.clone();
        for (region, (gained, (giver, least), owed, rounding)) in regions.iter().zip(gained) {
            if !region.passive_stepper {
                reasons.push(format!(
                    "`{}` was stepped by {}, which does not keep the balance",
                    region.name, region.stepper
                ));
            }
            if !(region.h_initial.is_finite() && region.h_final.is_finite()) {
                reasons.push(format!("H of `{}` is not a finite number", region.name));
            }
            let kept = KEPT.max(KEPT_EACH * region.states as f64);
            if region.passive_stepper && (region.worst_step > kept || region.worst_step.is_nan()) {
                reasons
                    .push(format!("the balance of `{}` was off by {:.1e} in a step", region.name, region.worst_step));
            }
            if let Some(m) = region.modified.filter(|m| m.grown_relative > GROWN) {
                reasons.push(format!(
                    "H of `{}` was {:.3e} J above what it had been given, {:.1e} of what it had held until then: \
                    shorter steps keep it near the modified energy",
                    region.name, m.grown, m.grown_relative
                ));
            }
            if owed > OWED {
                reasons.push(format!(
                    "`{}` gave out up to {:.3e} J more than it stored and its tank held",
                    region.name, region.debt_max
                ));
            }
            if region.sunk > KEPT {
                reasons.push(format!("entropy fell in `{}`", region.name));
            }
            if gained > GAIN {
                let name = region.resistors.get(giver).map_or("", |r| &r.name);
                reasons.push(format!("`{name}` in `{}` gave energy, up to {:.1e} J in a step", region.name, -least));
            } else if let Some(r) = region.resistors.iter().find(|r| -r.energy > rounding) {
                let (name, energy) = (&r.name, -r.energy);
                reasons.push(format!("`{name}` in `{}` gave {energy:.3e} J in all", region.name));
            }
        }
        let passive_ones = || regions.iter().filter(|r| r.passive_stepper);
        Summary {
            time: self.time,
            passive: reasons.is_empty(),
            reasons,
            worst_step: passive_ones().map(|r| r.worst_step).fold(0.0, f64::max),
            total: passive_ones().map(|r| r.total).fold(0.0, f64::max),
            regions,
            bars,
        }
    }
}
