//! Runs a scene: the multi-rate schedule, sample and hold, adaptive steps, and what is recorded.

mod adaptive;
mod answer;
mod attempt;
mod block_execution;
mod block_routine;
mod clock;
mod cluster;
mod controller;
mod delay_line;
mod encoder;
mod error_scale;
mod event;
mod guard;
mod hold;
mod input_signal;
mod joined;
mod kept;
mod latched;
mod program;
mod rate_transition;
mod record;
mod release;
mod sampled;
mod sampling;
mod save;
mod schedule;
mod start;
mod stepping;
mod summary;
mod tangent;
mod trial;
mod watched;
mod wave;

pub use block_routine::{BlockMaker, BlockRoutine, ClusterPlaces, MakeBlock, Places};
pub use hold::Report;
pub use input_signal::{InputSignal, Unfit};
pub use rate_transition::{paced, uneven};
pub use save::{Refused, made};
pub use summary::{
    BarSummary, ElementEnergy, ElementEntropy, KEPT, LineSummary, Modified, RegionSummary, SteeredSource, Summary,
};
pub use watched::PortPassivity;

use crate::kernel::Failure;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How to run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Fixed step of continuous regions, s.
    pub step: Option<f64>,
    /// Relative error allowed in a step of continuous regions; makes them adaptive.
    pub tolerance: Option<f64>,
    /// Step of continuous regions where neither is given and the method has no error, s; adaptive ones begin with a
    /// small part of it.
    pub default_step: f64,
    /// Longest of the adaptive steps, s; as long as they may be where there is none.
    pub longest: Option<f64>,
}

/// What to do about laws that jump; where there are none, `otherwise`.
fn mend(jumps: &[String], otherwise: &str) -> String {
    if jumps.is_empty() {
        return otherwise.to_string();
    }
    let names: Vec<String> = jumps.iter().map(|j| format!("`{j}`")).collect();
    format!(
        "; the law of {} jumps, and has no solution where it should hold still: give it as a curve, `{{ e = ...; f = \
        ... }}` in `s`",
        names.join(", ")
    )
}

/// A time to be read, s: with its power of ten where it is short or long.
fn instant(time: f64) -> String {
    let plain = time == 0.0 || !time.is_finite() || (1e-5..1e15).contains(&time.abs());
    if plain { format!("{time}") } else { format!("{time:e}") }
}

/// A step to be read, s, which may be too small for any number.
fn length(step: f64) -> String {
    format!("{:.0e}", step.max(f64::from_bits(1)))
}

/// Why a run stopped early.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// A step failed.
    #[error(
        "at t = {} s, a step of `{region}` failed: {why}{}{}",
        instant(*time),
        state.as_ref().map(|s| format!(" (`{s}`)")).unwrap_or_default(),
        mend(jumps, "")
    )]
    Step {
        /// When.
        time: f64,
        /// Where.
        region: String,
        /// The state that is at fault, where one can be named.
        state: Option<String>,
        /// Why.
        why: Failure,
        /// Resistors whose laws jump, where that may be why.
        jumps: Vec<String>,
    },
    /// An adaptive step became too small.
    #[error(
        "at t = {} s, the step of `{region}` would have to be smaller than {} s to meet the tolerance{}; {}, or give a fixed step",
        instant(*time),
        length(*step),
        state.as_ref().map(|s| format!(" of `{s}`")).unwrap_or_default(),
        match (*time == 0.0, *at_once) {
            (true, _) => "it starts so far from rest that a law moves it at once: start it nearer to its equilibrium",
            (false, true) => "a law moves it at once there: add the resistance that the real parts have",
            (false, false) => "a law may switch back and forth there: make it steep instead of a jump",
        }
    )]
    TooSmall {
        /// When.
        time: f64,
        /// Where.
        region: String,
        /// The state that is off most, where one can be named.
        state: Option<String>,
        /// Whether an exponential law may move it so.
        at_once: bool,
        /// The step that failed.
        step: f64,
    },
    /// Adaptive steps are good, and so short that a run would never end.
    #[error(
        "at t = {} s, `{region}` still takes steps of {} s, of which the run would have more than 1e10{}",
        instant(*time),
        length(*step),
        mend(jumps, ": end it earlier, or allow larger errors")
    )]
    Endless {
        /// When.
        time: f64,
        /// Where.
        region: String,
        /// How long they are.
        step: f64,
        /// Resistors whose laws jump, where that may be why.
        jumps: Vec<String>,
    },
    /// An energy is infinite or no number, or no energy.
    #[error("at t = {} s, the ledger of `{region}` fails: {what}", instant(*time))]
    Energy {
        /// When.
        time: f64,
        /// Where.
        region: String,
        /// What is wrong with which energy.
        what: String,
    },
    /// The exact step could not be prepared.
    #[error("the exact step of `{region}` cannot be prepared: {why}")]
    Table {
        /// Where.
        region: String,
        /// Why.
        why: String,
    },
}

pub use schedule::Simulation;
pub use start::{Start, StartCluster, StartHeld};
