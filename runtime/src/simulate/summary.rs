//! What a run did, in numbers.

use super::cluster::Run;
use super::schedule::Simulation;
use super::watched::PortPassivity;
use crate::energy::{Ledger, Place};
use crate::scene::{Bar, Excluded, Produced, Steering, TransmissionLine, Watched};
use std::borrow::Cow;

/// What the balance of a step is off by at most, relative, where it is said to be kept.
pub const KEPT: f64 = 1e-12;
/// The same for each state, where there are many: a sum of n terms is rounded by up to n parts in 1e16 of itself
/// (Higham, Accuracy and Stability of Numerical Algorithms, 4.2), and there are two of them in a balance.
const KEPT_EACH: f64 = 2.0 * f64::EPSILON;
/// Energies below this part of the scene's largest are rounding.
const FLOOR: f64 = 1e-14;
/// What H may be above all that was given, as a part of what was held before, where another energy keeps the balance.
const ENERGY_EXCESS: f64 = 0.1;
/// What a region may owe, as a part of the energies there: that much is rounding.
const RELATIVE_DEBT: f64 = 1e-11;
/// What a resistor may give in a step, as a part of the energy there: a loop is solved to about 1e-11.
const GAIN: f64 = 1e-9;
/// What that is a part of at least, as a part of the size of the scene's energies. Where next to nothing moves,
/// rounding of a speed times a force may have any sign.
const STILL: f64 = 4e-21;
/// What a hold may make of the energy inside, as a part of the largest H, while the wall felt is the wall written.
const LEAK: f64 = 0.01;
/// What of the largest energy that crossed in an interval is rounding, where that is far larger than H.
const CROSSED: f64 = 1e-9;
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

/// A lossless line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSummary {
    /// Its name.
    pub name: String,
    /// What is on its way in it: what its ends took in less what they gave out, J.
    pub energy: f64,
    /// What rounding may have made of that, J.
    pub rounding: f64,
}

/// A steered source's share: its value reads the scene's own signals.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SteeredSource {
    /// The element.
    pub name: String,
    /// What it gave, J; below 0: took.
    pub energy: f64,
    /// What it is to the claim of passivity.
    pub steering: Steering,
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
    pub energy_excess: f64,
    /// The same, as a part of the largest energy that was held until then, or given in that step.
    pub relative_energy_excess: f64,
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
    /// Whether its steps follow from rates alone.
    pub explicit: bool,
    /// The hold, of a sampled region.
    pub hold: Option<Cow<'static, str>>,
    /// How long after a sample what was found there is held, s.
    pub latency: f64,
    /// Steps done.
    pub steps: u64,
    /// Those of them that another method took, in adaptive steps, and that method: where a step failed, or an explicit
    /// one found the region stiff.
    pub fallback: Option<(Cow<'static, str>, u64)>,
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
    /// Whether holds created or lost so much inside, beside H, that who meets it feels something else than what is
    /// written.
    pub leaks_much: bool,
    /// Largest debt to the outside; what is rounding beside the energies there is none.
    pub debt_max: f64,
    /// How often it let go of what it held within an interval, or had the other side meet less of it: what it has to
    /// give was drawn. Regions that hold together let go together.
    pub releases: u64,
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
    /// Those of them that are steered.
    pub steered: Vec<SteeredSource>,
    /// By resistor; below 0 where an active one injected energy.
    pub resistors: Vec<ElementEnergy>,
    /// Entropy produced by each field with thermal ports.
    pub produced: Vec<ElementEntropy>,
    /// The largest fall of entropy in a step, times the temperature there, relative to the larger of H and what is
    /// turned over; 0 where none fell.
    pub second_law_violation: f64,
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
    /// In what steps the holder reads the motion of the other side, SI; 0 where it does so exactly.
    pub resolution: f64,
    /// What a device that counts the energy by those steps is wrong by in an interval, at most, J.
    pub miscounted: f64,
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
    /// The lossless lines.
    pub lines: Vec<LineSummary>,
    /// The places at which `expect passive at` looks, in the scene's order.
    pub watched: Vec<PortPassivity>,
}

/// What of a region's ledger only the verdict goes by.
struct Doubts {
    /// The most that a resistor gave in a step, as a part of the energy there.
    gained: f64,
    /// Which one gave most, and how much, below 0.
    most_negative: (usize, f64),
    /// The largest debt, as a part of the energies there.
    relative_debt: f64,
    /// What rounding may have made of a resistor's sum, J.
    rounding: f64,
}

impl RegionSummary {
    /// The reason for a verdict that its debt is, in words.
    pub fn debt(&self) -> String {
        format!("`{}` gave out up to {:.3e} J more than it stored and its tank held", self.name, self.debt_max)
    }

    /// What a steered source or a resistor of the region gave, J.
    fn given_by(&self, element: &str) -> Option<f64> {
        let steered = self.steered.iter().find(|x| x.name == element).map(|x| x.energy);
        steered.or_else(|| self.resistors.iter().find(|x| x.name == element).map(|x| -x.energy))
    }

    /// Adds why the region did not keep the promise.
    fn judge(&self, doubts: &Doubts, reasons: &mut Vec<String>) {
        let name = &self.name;
        if !self.passive_stepper {
            reasons.push(format!("`{name}` was stepped by {}, which does not keep the balance", self.stepper));
        }
        if !(self.h_initial.is_finite() && self.h_final.is_finite()) {
            reasons.push(format!("H of `{name}` is not a finite number"));
        }
        let kept = KEPT.max(KEPT_EACH * self.states as f64);
        if self.passive_stepper && (self.worst_step > kept || self.worst_step.is_nan()) {
            reasons.push(format!("the balance of `{name}` was off by {:.1e} in a step", self.worst_step));
        }
        if let Some(m) = self.modified.filter(|m| m.relative_energy_excess > ENERGY_EXCESS) {
            reasons.push(format!(
                "H of `{name}` was {:.3e} J above what it had been given, {:.1e} of what it had held until then: \
                shorter steps keep it near the modified energy",
                m.energy_excess, m.relative_energy_excess
            ));
        }
        if doubts.relative_debt > RELATIVE_DEBT {
            reasons.push(self.debt());
        }
        if self.second_law_violation > KEPT {
            reasons.push(format!("entropy fell in `{name}`"));
        }
        let (resistor, least) = doubts.most_negative;
        if doubts.gained > GAIN {
            let resistor = self.resistors.get(resistor).map_or("", |r| &r.name);
            reasons.push(format!("`{resistor}` in `{name}` gave energy, up to {:.1e} J in a step", -least));
        } else if let Some(r) = self.resistors.iter().find(|r| -r.energy > doubts.rounding) {
            reasons.push(format!("`{}` in `{name}` gave {:.3e} J in all", r.name, -r.energy));
        }
    }
}

impl Simulation<'_> {
    /// The ledger.
    pub fn summary(&self) -> Summary {
        let runs = self.scene.clusters.iter().zip(&self.runs).zip(&self.stepping);
        let ledgers: Vec<_> = runs.map(|((c, run), stepping)| stepping.ledger_at(run, c, self.time)).collect();
        let all = self.runs.iter().zip(&ledgers).flat_map(|(run, l)| run.layout.accounts.iter().map(|p| l.largest(p)));
        let largest = all.fold(0.0, f64::max);
        let found: Vec<_> = (0..self.scene.regions.len())
            .filter_map(|r| self.region(r, &ledgers[self.scene.regions[r].cluster], largest))
            .collect();
        let given = |x: &Excluded| found.iter().find_map(|(region, _)| region.given_by(&x.element));
        let withdrawn = |x: &Excluded| match given(x) {
            Some(energy) => format!("{}, which gave {energy:.3e} J", x.why),
            None => x.why.clone(),
        };
        let mut reasons: Vec<String> = self.scene.excluded.iter().map(withdrawn).collect();
        found.iter().for_each(|(region, doubts)| region.judge(doubts, &mut reasons));
        let lines: Vec<LineSummary> = self.scene.lines.iter().filter_map(|line| self.line(line, &ledgers)).collect();
        for line in lines.iter().filter(|line| line.energy < -line.rounding) {
            reasons.push(format!("the line `{}` gave {:.3e} J more than it was given", line.name, -line.energy));
        }
        let regions: Vec<RegionSummary> = found.into_iter().map(|(region, _)| region).collect();
        let passive_ones = || regions.iter().filter(|r| r.passive_stepper);
        Summary {
            time: self.time,
            passive: reasons.is_empty(),
            reasons,
            worst_step: passive_ones().map(|r| r.worst_step).fold(0.0, f64::max),
            total: passive_ones().map(|r| r.total).fold(0.0, f64::max),
            bars: self.bars(),
            lines,
            watched: self.scene.watched.iter().filter_map(|w| self.passivity_at(w)).collect(),
            regions,
        }
    }

    /// What its ends have booked of a line.
    fn line(&self, line: &TransmissionLine, ledgers: &[std::borrow::Cow<'_, Ledger>]) -> Option<LineSummary> {
        let given = |&(cluster, entry, at): &(usize, usize, usize)| {
            Some(ledgers[cluster].sum(self.runs[cluster].layout.accounts[entry].sources?.plus(2 * at)))
        };
        let (a, b) = (given(&line.ends[0])?, given(&line.ends[1])?);
        // As of a resistor's sum.
        let rounding = |&(cluster, entry, _): &(usize, usize, usize)| {
            let (run, ledger) = (&self.runs[cluster], &ledgers[cluster]);
            let p = &run.layout.accounts[entry];
            let still = STILL * self.scene.energy;
            run.steps as f64 * (GAIN * ledger.get(p.turnover_max).max(still) + ROUNDING * ledger.largest(p))
        };
        let rounding = line.ends.iter().map(rounding).sum();
        Some(LineSummary { name: line.name.clone(), energy: -(a + b), rounding })
    }

    /// What a region's cluster has booked of it, beside the scene's `largest` energy.
    fn region(&self, r: usize, ledger: &Ledger, largest: f64) -> Option<(RegionSummary, Doubts)> {
        let region = &self.scene.regions[r];
        let (c, run) = (&self.scene.clusters[region.cluster], &self.runs[region.cluster]);
        let k = c.entries.iter().position(|e| e.region == r)?;
        let (p, e) = (&run.layout.accounts[k], &c.entries[k]);
        let (d, own) = (p.detail.as_ref()?, p.sources?);
        let number = |at: Place| ledger.get(at);
        let (control, newton_iterations) = self.stepping[region.cluster].kept(run);
        let list = |names: &[(String, usize)], sums: Place| {
            let energy = |(k, (name, _)): (usize, &(String, usize))| ElementEnergy {
                name: name.clone(),
                energy: ledger.sum(sums.plus(2 * k)),
            };
            names.iter().enumerate().map(energy).collect()
        };
        let entropy = |(k, x): (usize, &Produced)| ElementEntropy {
            name: x.name.clone(),
            entropy: ledger.sum(d.produced.plus(2 * k)),
        };
        let steered = e.steered.iter().map(|(source, steering)| SteeredSource {
            name: e.supplied[*source].0.clone(),
            energy: ledger.sum(own.plus(2 * source)),
            steering: *steering,
        });
        let leaked = ledger.sum(p.leaked);
        let floor = ledger.floor(p).max(FLOOR * largest);
        let part = |x: f64| if ledger.largest(p) > 0.0 { x / ledger.largest(p) } else { 0.0 };
        let still = STILL * self.scene.energy;
        let doubts = Doubts {
            gained: ledger.error(p.gained, floor.max(still)),
            most_negative: (number(d.most_negative_resistor) as usize, number(d.most_negative_resistor.plus(1))),
            relative_debt: number(d.relative_debt),
            // Beside heat, which is large, a step may give much before that is seen.
            rounding: run.steps as f64 * (GAIN * number(p.turnover_max).max(still) + ROUNDING * ledger.largest(p)),
        };
        let summary = RegionSummary {
            name: region.name.clone(),
            kind: if region.period.is_some() { "sampled" } else { "continuous" },
            period: region.period,
            states: region.states,
            stepper: c.step.name.clone(),
            why: c.step.why.clone(),
            order: c.step.properties.order,
            explicit: c.step.properties.explicit,
            hold: Some(c.hold.clone()).filter(|h| !h.is_empty() && !c.holds.is_empty()),
            latency: c.latency,
            steps: run.steps,
            fallback: c
                .step
                .fallback
                .as_ref()
                .zip(control.map(|k| k.by_fallback).filter(|n| *n > 0))
                .map(|(step, n)| (step.name.clone(), n)),
            rejected: control.map_or(0, |k| k.rejected),
            events: control.map_or(0, |k| k.events),
            newton_iterations,
            h_initial: number(p.h_initial),
            h_final: number(p.h),
            h_max: number(p.h_max),
            supplied: ledger.sum(p.supplied),
            dissipated: ledger.sum(p.dissipated),
            leaked,
            leaks_much: !c.holds.is_empty()
                && leaked.abs() > (LEAK * number(p.h_max)).max(CROSSED * number(d.crossed_max)),
            debt_max: if doubts.relative_debt > RELATIVE_DEBT { number(p.debt_max) } else { 0.0 },
            releases: run.layout.stake.releases.map_or(0, |at| number(at) as u64),
            tank: match (&p.work, &e.work) {
                (Some(at), Some(work)) => number(p.stored) - number(at.energy) + work.least,
                _ if region.period.is_some() => number(p.stored) - number(p.h) + e.least,
                _ => 0.0,
            },
            leaps: number(d.leaps) as u64,
            worst_step: ledger.error(p.worst, floor),
            total: part(number(p.residual).abs()),
            passive_stepper: c.step.properties.passive,
            pseudo: region.pseudo,
            modified: e.modified.map(|_| Modified {
                difference: number(d.modified),
                max_difference: number(d.modified.plus(1)),
                relative: part(number(d.modified.plus(1))),
                energy_excess: number(d.energy_excess.plus(1)),
                relative_energy_excess: number(d.energy_excess),
            }),
            steered: steered.collect(),
            sources: list(&e.supplied, own),
            resistors: list(&e.dissipated, d.resistors),
            produced: e.produced.iter().enumerate().map(entropy).collect(),
            second_law_violation: ledger.error(d.second_law_violation, floor),
        };
        Some((summary, doubts))
    }

    /// What was drawn at a place at which an expectation looks.
    fn passivity_at(&self, watched: &Watched) -> Option<PortPassivity> {
        let Run { watched: list, ledger, layout, .. } = &self.runs[watched.cluster];
        Some(list.iter().find(|d| d.is_of(watched))?.passivity(ledger, layout))
    }

    /// What crossed the double bars.
    fn bars(&self) -> Vec<BarSummary> {
        let bar = |bar: &Bar| {
            let Run { layout, ledger, .. } = &self.runs[bar.holder.0];
            let mut held = layout.held.iter().zip(&self.held[bar.holder.0]);
            let (places, held) = held.find(|(p, _)| p.port == bar.holder.1)?;
            let counts = places.counts.as_ref()?;
            Some(BarSummary {
                name: bar.name.clone(),
                holder: ledger.sum(counts.holder),
                other: ledger.sum(counts.other),
                difference: ledger.get(counts.difference),
                resolution: bar.resolution,
                miscounted: bar.resolution * held.encoder.most,
            })
        };
        self.scene.bars.iter().filter_map(bar).collect()
    }
}
