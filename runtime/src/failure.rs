//! Why a run of a program gave no result.

use crate::ir::Slot;
use thiserror::Error;

/// Where nothing changed, the iteration never began: the equations have no finite value there.
fn unsettled(iterations: u32, change: f64) -> String {
    if change == 0.0 {
        return "the equations have no finite value where the iteration starts: a number is too large for them, or \
        undefined, such as by a ratio of 0 or the root of a negative number"
            .into();
    }
    format!("no convergence after {iterations} iterations, of which the last changed an unknown by {change:.2e}")
}

/// Why a run gave no result.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Failure {
    /// Newton's method came to its limit.
    #[error("{}", unsettled(*iterations, *change))]
    NoConvergence {
        /// Iterations done.
        iterations: u32,
        /// The slot of `Local` whose last change was largest, measured against itself and its scale.
        unknown: usize,
        /// That change, in the slot's own unit.
        change: f64,
    },
    /// The Jacobian of an iteration can't be solved.
    #[error(
        "singular matrix, at row {row} of the system: its laws leave a variable undetermined there, such as the \
        voltage between ideal diodes that all block; add a small leak or stiffness"
    )]
    Singular {
        /// The row, of the residual, that has no pivot.
        row: usize,
    },
    /// The energy of the step does not balance.
    #[error("the energy of the step does not balance")]
    Balance,
    /// The balance of an exact step is grossly off.
    #[error("the exact step makes or loses what is stored")]
    GrossBalance,
    /// An energy of the step is infinite or NaN.
    #[error("an energy of the step is infinite or undefined")]
    Energy,
    /// A number in the new state is infinite or NaN.
    #[error(
        "a number that it gives is infinite or undefined, such as by a ratio of 0 or the root of a negative \
    number"
    )]
    NotFinite {
        /// The first such slot.
        slot: Slot,
    },
}
