//! Which stepper a continuous cluster takes where none is named.

use super::cluster::Cluster;
use super::{Method, exact};
use crate::expression::{Node, Pool};
use crate::model::Model;
use crate::structure::{Form, Output};
use bond_runtime::ir::{Binary, Unary};

/// A tolerance above this asks for nothing better than order 2.
const LOOSE: f64 = 1e-3;
/// One at most this asks for order 8, between the two for 6. Measured on smooth problems: Duffing, pendulum, Kepler.
const TIGHT: f64 = 1e-5;
/// Collocation has so many unknowns in a stage at most; above, the sparse system of order 2 is what is known to be
/// cheap.
const UNKNOWNS: usize = 16;

/// What was asked of a run's accuracy besides the method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Accuracy {
    /// What the model's `simulate` says.
    #[default]
    AsModel,
    /// Nothing: steps are of a fixed length.
    Fixed,
    /// Steps are fitted to this tolerance.
    Tolerance(f64),
}

impl Accuracy {
    /// The tolerance, where one was said.
    pub fn tolerance(self, model: Option<f64>) -> Option<f64> {
        match self {
            Accuracy::AsModel => model,
            Accuracy::Fixed => None,
            Accuracy::Tolerance(x) => Some(x),
        }
    }
}

/// The stepper of a cluster that `exact` does not take, and why. Passive always.
pub(super) fn nonlinear(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    tolerance: Option<f64>,
) -> (Method, &'static str) {
    // A probe is to cost no accuracy.
    if exact::takes_states(c, model, form) {
        return (Method::Collocation8, "it is linear, but for what a probe integrates");
    }
    let Some(tolerance) = tolerance.filter(|t| *t <= LOOSE) else {
        return (Method::Gonzalez, "it is not linear");
    };
    if !c.followed.is_empty() {
        return (Method::Gonzalez, "it is not linear, and a storage follows a source");
    }
    if c.states.len() + c.loops.len() > UNKNOWNS {
        return (Method::Gonzalez, "it is not linear, and large");
    }
    if !is_smooth(c, &model.pool) {
        return (Method::Gonzalez, "it is not linear, and not smooth");
    }
    match tolerance <= TIGHT {
        true => (Method::Collocation8, "it is smooth, and the tolerance asks for order 8"),
        false => (Method::Collocation6, "it is smooth, and the tolerance asks for order 6"),
    }
}

/// Whether no law and no energy has a kink or a jump.
fn is_smooth(c: &Cluster, pool: &Pool) -> bool {
    let kink = |n: &Node| match n {
        Node::Select(..) => true,
        Node::Unary(f, _) => matches!(f, Unary::Abs | Unary::Sign | Unary::Not),
        Node::Binary(f, ..) => !matches!(f, Binary::Atan2 | Binary::Pow),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Power(..) => false,
    };
    let curve = c.nodes.iter().any(|n| matches!(n.how, Output::Curve { .. }));
    let energies = c.groups.iter().flat_map(|g| g.coenergy.iter().copied());
    !curve && energies.chain(c.all_expressions()).all(|e| !pool.any_node(e, &kink))
}
