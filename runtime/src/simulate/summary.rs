//! What a run did, in numbers.

use std::borrow::Cow;

/// A source's, resistor's or double bar's share.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementEnergy {
    /// The element.
    pub name: String,
    /// J
    pub energy: f64,
}

/// What a resistor with thermal ports produced.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementEntropy {
    /// The element.
    pub name: String,
    /// J/K
    pub entropy: f64,
}

/// How far the energy that a stepper keeps is from H.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modified {
    /// It less H, now, J.
    pub difference: f64,
    /// The largest magnitude of that, J.
    pub max_difference: f64,
    /// The same, as a part of the largest energy that was stored or turned over in a step.
    pub relative: f64,
}

/// A region's ledger at one instant. Energies in J, since the start.
#[derive(Clone, Debug, PartialEq)]
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
    /// The largest fall of entropy in a step, relative to the largest change in one; 0 where none fell.
    pub sunk: f64,
}

/// A double bar's ledger: what crossed, as each side counts it.
#[derive(Clone, Debug, PartialEq)]
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
