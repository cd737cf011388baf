//! A system of equations that a program solves by Newton's method.

use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Symbol};
use crate::structure::Bends;
use bond_runtime::ir::{Slot, Value};

/// A system of equations to be solved in a program; the default asks for nothing special.
#[derive(Default)]
pub(crate) struct System {
    pub(crate) unknowns: Vec<Symbol>,
    /// The symbol of the step's length, which is above 0.
    pub(crate) h: Option<Symbol>,
    pub(crate) start: Vec<Value>,
    pub(crate) residuals: Vec<Expr>,
    pub(crate) weight: Vec<Value>,
    pub(crate) scale: Vec<Value>,
    pub(crate) flag: Option<Slot>,
    /// Whether it is linear, and solved once.
    pub(crate) once: bool,
    /// Whether its coefficients are not to be multiplied with one another, since the rounding of their products counts.
    pub(crate) exact_coefficients: bool,
    /// Whether what rounding took from the unknowns is asked for.
    pub(crate) rests: bool,
    /// The part of the unknowns that the iteration may leave, where that is less than usual.
    pub(crate) left: Option<f64>,
    /// Values that are next to nothing beside what they are added to.
    pub(crate) small: Vec<Value>,
    /// The states that the unknowns move, where these may be angles.
    pub(crate) states: Vec<(Symbol, Option<Value>)>,
    /// Unknowns that appear as exponents, with the knee beyond which the exponential dominates.
    pub(crate) knees: Vec<(Symbol, Bends)>,
    /// Whether branched laws may leave the unknowns undetermined: how they share a load.
    pub(crate) undetermined: bool,
    /// Whether constraints may say the same: how they share what they carry.
    pub(crate) redundant: bool,
    /// Whether laws are non-smooth: steeper by orders of magnitude beyond a corner.
    pub(crate) non_smooth: bool,
}

impl System {
    /// Takes an unknown in with its residual; it starts somewhere, and has a weight and a scale.
    pub(crate) fn push(&mut self, (unknown, residual): (Symbol, Expr), (start, weight, scale): (Value, Value, Value)) {
        self.unknowns.push(unknown);
        self.residuals.push(residual);
        self.start.push(start);
        self.weight.push(weight);
        self.scale.push(scale);
    }
}

/// The part of the unknowns of a step that its iteration may leave. Where nothing takes energy out it is always on the
/// same side, so that it adds up, and where steps are not fitted there may be 1e7 of them.
pub(crate) fn left(c: &Cluster) -> Option<f64> {
    (c.is_lossless() && !c.fitted).then_some(c.thresholds.iteration.lossless)
}
