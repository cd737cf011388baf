//! The numbers that step programs are chosen and written by: what each means, and of what it is a part. None has a
//! unit. [`crate::Options`] has them beside those of the run ([`bond_runtime::options`]); tests and the ablation
//! (`tests/src/bin/ablation.rs`) set others.

use bond_runtime::options::NewtonOptions;
use serde::{Deserialize, Serialize};

/// All of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Thresholds {
    /// Which stepper a region takes.
    pub choice: ChoiceThresholds,
    /// Relay-like laws, whose slope falls by orders of magnitude.
    pub relay: RelayThresholds,
    /// What is nothing beside the energies of a scene.
    pub size: SizeThresholds,
    /// What is stiff.
    pub stiffness: StiffnessThresholds,
    /// Where loops start.
    pub start: StartThresholds,
    /// Polynomials near rest.
    pub rest: RestThresholds,
    /// The regularised solve of what laws leave undetermined.
    pub regular: RegularThresholds,
    /// Predicted steps.
    pub predictor: PredictorThresholds,
    /// What iterations are measured against.
    pub iteration: IterationThresholds,
    /// When an iteration ends, and how it goes on where it does not converge.
    pub newton: NewtonOptions,
}

/// Which stepper a region takes, by the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChoiceThresholds {
    /// Tolerance above which order 2 is good enough.
    pub order_2: f64,
    /// Tolerance from which down order 8 is taken; between the two order 6. Measured on smooth problems: Duffing,
    /// pendulum, Kepler. A region with kinks takes order 8 or none above 2: longer steps may pass over what a kink
    /// brings, such as the pulse of a diode.
    pub order_8: f64,
    /// The same of a region with non-smooth laws.
    pub corners: f64,
    /// Tolerance above which a region with exponentials, which may be driven hard, takes `radau`.
    pub exponentials: f64,
    /// Tolerance above which a region takes order 2 where several laws have vertical and horizontal branches, so that
    /// they may hold one another.
    pub ideal: f64,
    /// Tolerance from which down a large region takes order 6.
    pub large: f64,
}

impl Default for ChoiceThresholds {
    fn default() -> Self {
        Self { order_2: 1e-3, order_8: 1e-5, corners: 1e-6, exponentials: 1e-7, ideal: 1e-7, large: 1e-6 }
    }
}

/// Relay-like laws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RelayThresholds {
    /// Part of the largest slope of a law below which it is relay-like.
    pub slope: f64,
    /// Part of its slope at rest that its mean slope has at least where the rest of the network holds it, as a
    /// resistor in series with a diode does.
    pub held: f64,
    /// Part of its slope at rest below which a law ends.
    pub end: f64,
}

impl Default for RelayThresholds {
    fn default() -> Self {
        Self { slope: 1e-3, held: 0.1, end: 1e-12 }
    }
}

/// What is nothing beside the energies of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeThresholds {
    /// Least energy that a step turns over, as a part of the size of the scene's energies.
    pub faintest_energy: f64,
}

impl Default for SizeThresholds {
    fn default() -> Self {
        Self { faintest_energy: 1e-25 }
    }
}

/// What is stiff.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StiffnessThresholds {
    /// Steps, in time constants of a resistor between storages, from which on its flow is an unknown of its own.
    pub tight: f64,
    /// Ratio of the largest square of a frequency to the least from which on a region is stiff.
    pub spread: f64,
    /// Largest square of a frequency times the step from which on the step is long.
    pub long: f64,
}

impl Default for StiffnessThresholds {
    fn default() -> Self {
        Self { tight: 30.0, spread: 1e8, long: 1e4 }
    }
}

/// Where loops start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartThresholds {
    /// Relative difference of two solutions below which they are one.
    pub same: f64,
    /// Size of the residual of an ideal law, which is a bare number, up to which it holds.
    pub ideal: f64,
}

impl Default for StartThresholds {
    fn default() -> Self {
        Self { same: 1e-6, ideal: 1e-7 }
    }
}

/// Maclaurin polynomials of laws near rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RestThresholds {
    /// Relative error of a closed form up to which it stands.
    pub closed: f64,
    /// Relative difference of series and closed form where both are the same function.
    pub same: f64,
    /// Relative error of a polynomial.
    pub truncation: f64,
}

impl Default for RestThresholds {
    fn default() -> Self {
        Self { closed: 2e-14, same: 1e-9, truncation: 1e-17 }
    }
}

/// The regularised solve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegularThresholds {
    /// Pull towards what the step found, as a part of a law's slope at rest.
    pub pull: f64,
    /// The same where the step determines all.
    pub slight_pull: f64,
}

impl Default for RegularThresholds {
    fn default() -> Self {
        Self { pull: 1e-2, slight_pull: 1e-9 }
    }
}

/// Predicted steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorThresholds {
    /// Ratio of a step to the last one up to which that predicts it.
    pub reach: f64,
    /// Ratio of the last difference but one to the last up to which differences fall.
    pub falling: f64,
}

impl Default for PredictorThresholds {
    fn default() -> Self {
        Self { reach: 2.5, falling: 0.6 }
    }
}

/// What iterations are measured against.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IterationThresholds {
    /// Units up an exponent at most at which an iteration starts.
    pub max_exponent: f64,
    /// Part of the unknowns that an iteration leaves where nothing takes energy.
    pub lossless: f64,
    /// Ratio of a law's slope where it starts to the one at rest up to which the latter counts.
    pub steeper: f64,
    /// The part by which each update takes pivots for larger where constraints say the same (Marquardt, SIAM J. Appl.
    /// Math. 11, 1963). The equations stay as they are, so that it counts for how soon they are solved alone.
    pub damping: f64,
}

impl Default for IterationThresholds {
    fn default() -> Self {
        Self { max_exponent: 80.0, lossless: 1e-20, steeper: 1e4, damping: 1e-6 }
    }
}
