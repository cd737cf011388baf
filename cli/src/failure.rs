//! Why a run stopped.

use bond_runtime::simulate::{self, Refused};
use thiserror::Error;

/// Failed numerics: which step, when, and why. Displays as text.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{0}")]
pub struct NumericsError(simulate::Error);

/// Why a saved state was refused. Displays as text.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{0}")]
pub struct ResumeError(Refused);

/// Why a run stopped, or could not do what was asked.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum RunError {
    /// The numerics failed.
    #[error("{0}")]
    Numerics(NumericsError),
    /// A step length or a tolerance that is not positive and finite.
    #[error("{what} is {value}, and must be positive")]
    Value {
        /// Which one.
        what: &'static str,
        /// What it is.
        value: f64,
    },
    /// A tolerance below rounding.
    #[error("the tolerance is {0:e}; it must be at least 1e-14, because of rounding")]
    Tolerance(f64),
    /// An instant that is not finite, or is past.
    #[error("{0} is not an instant to which a run can go")]
    Instant(f64),
    /// A saved state that is not this scene's.
    #[error("{0}")]
    Resume(ResumeError),
    /// A state that cannot be written.
    #[error("the state cannot be saved: {0}")]
    Save(String),
    /// An unknown name.
    #[error("there is no {what} `{name}`; there is {}", if known.is_empty() { "none".to_string() } else { known.join(", ") })]
    Unknown {
        /// A probe, an open port, an input.
        what: &'static str,
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
}

impl From<simulate::Error> for RunError {
    fn from(e: simulate::Error) -> Self {
        RunError::Numerics(NumericsError(e))
    }
}

impl From<Refused> for RunError {
    fn from(e: Refused) -> Self {
        RunError::Resume(ResumeError(e))
    }
}

impl RunError {
    /// When the numerics failed, s; None for other errors, and where no instant is known.
    pub fn time(&self) -> Option<f64> {
        match self {
            RunError::Numerics(NumericsError(e)) => match e {
                simulate::Error::Step { time, .. }
                | simulate::Error::TooSmall { time, .. }
                | simulate::Error::Endless { time, .. }
                | simulate::Error::Energy { time, .. } => Some(*time),
                simulate::Error::Table { .. } => None,
            },
            RunError::Value { .. }
            | RunError::Tolerance(_)
            | RunError::Instant(_)
            | RunError::Resume(_)
            | RunError::Save(_)
            | RunError::Unknown { .. } => None,
        }
    }
}

/// The runtime's error, if the numerics failed.
pub fn failure(error: &RunError) -> Option<&simulate::Error> {
    match error {
        RunError::Numerics(e) => Some(&e.0),
        _ => None,
    }
}

/// Why a saved state was refused, if that is the error.
pub fn refusal(error: &RunError) -> Option<&Refused> {
    match error {
        RunError::Resume(e) => Some(&e.0),
        _ => None,
    }
}

/// The error of a name that is not among those known.
pub(crate) fn unknown(what: &'static str, name: &str, known: &[String]) -> RunError {
    RunError::Unknown { what, name: name.to_string(), known: known.to_vec() }
}
