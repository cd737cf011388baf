//! Which stepper a continuous cluster takes where none is named.

use super::cluster::{self, Cluster};
use super::{Method, collocation, exact, stiff, tie};
use crate::expression::{Expr, Node, Pool};
use crate::model::Model;
use crate::structure::{Form, Output};
use bond_runtime::ir::{Binary, Unary};

/// A tolerance above this asks for nothing better than order 2.
const LOOSE: f64 = 1e-3;
/// One at most this asks for order 8, between the two for 6. Measured on smooth problems: Duffing, pendulum, Kepler. Of a
/// region with kinks it asks for order 8 or for none above 2: steps to a looser one are so long that they may pass over what
/// a kink brings, such as the pulse of a diode.
const TIGHT: f64 = 1e-5;
/// The same of a region with laws that are curves with corners. One with exponentials, which may be driven hard, takes
/// `radau` above this.
const CORNERS: f64 = 1e-7;
/// Stages of the method of order 8.
const ORDER_8: usize = 4;
/// Stages of `radau`.
const RADAU: usize = 3;
/// Collocation has so many unknowns in a stage at most; above, the sparse system of order 2 is what is known to be
/// cheap.
const UNKNOWNS: usize = 16;
/// The same by the method of order 6 where the tolerance is at most [`FINE`], or of a region with kinks [`CORNERS`]: far fewer
/// steps then are worth what each and compiling it takes. Of many diodes it would begin in far more.
const LARGE: usize = 512;
/// See [`LARGE`].
const FINE: f64 = 1e-6;
/// The same of a linear region with storages that follow a source which moves: its matrix stays as it is.
const LINEAR: usize = 64;

/// What was asked of a run's accuracy besides the method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Accuracy {
    /// What the model's `simulate` says.
    #[default]
    AsModel,
    /// Nothing: steps are of a fixed length.
    Fixed,
    /// Nothing: steps are of a fixed length, and none is cut where a law switches, as in a program of its own.
    Uncut,
    /// Steps are fitted to this tolerance.
    Tolerance(f64),
}

impl Accuracy {
    /// Whether steps are as long as their error lets them be.
    pub fn is_fitted(self) -> bool {
        matches!(self, Accuracy::AsModel | Accuracy::Tolerance(_))
    }

    /// The tolerance, where one was said.
    pub fn tolerance(self, model: Option<f64>) -> Option<f64> {
        match self {
            Accuracy::AsModel => model,
            Accuracy::Fixed | Accuracy::Uncut => None,
            Accuracy::Tolerance(x) => Some(x),
        }
    }
}

/// The stepper of a cluster that `exact` does not take, and why. Passive always.
pub(super) fn nonlinear(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    (accuracy, tolerance): (Accuracy, Option<f64>),
) -> (Method, &'static str) {
    // A probe is to cost no accuracy.
    if exact::takes_states(c, model, form) {
        return (Method::Collocation8, "it is linear, but for what a probe integrates");
    }
    let small = is_small(c);
    let damps =
        !c.is_led(&model.pool) && collocation::is_coupled(c, RADAU) && collocation::all_quadratic(c, &mut model.pool);
    // Its steps end before a switch. What a state then has to take across, no node may find on either side.
    let damps = damps && !stiff::is_steered(c, model, form);
    if damps && stiff::is_switched(c, model, form) {
        return (Method::Radau, "a law is all but a switch, and what it damps within a step must not ring on");
    }
    if damps && tie::is_tied(c, model, form) {
        return (
            Method::Radau,
            "a law that may stand upright hands a source on to a storage, which must not ring about it",
        );
    }
    // The middle of a step, and of its halves, may all lie below a knee that its end is far beyond.
    let coarse = tolerance.is_none_or(|t| t > CORNERS) && accuracy.is_fitted();
    if damps && coarse && !c.arguments().is_empty() {
        return (Method::Radau, "it has exponentials, and a step must see where on them it ends");
    }
    let laws = laws(c);
    let any = |model: &Model, test: &dyn Fn(&Node) -> bool| laws.iter().any(|e| model.pool.any_node(*e, test));
    let kinked = any(model, &is_kink) || has_corners(c);
    if !c.followed.is_empty() {
        let linear = c.nodes.iter().all(|n| !n.curved);
        let fits = small || linear && count(c) <= LINEAR;
        if !fits || kinked || !collocation::all_quadratic(c, &mut model.pool) {
            return (Method::Gonzalez, "a storage follows a source");
        }
        if linear {
            return (Method::Collocation8, "it is linear, but for a storage that follows a source");
        }
    }
    if !small && c.nodes.iter().all(|n| !n.curved) && collocation::all_quadratic(c, &mut model.pool) {
        return (Method::Gonzalez, "it is linear, and large");
    }
    let Some(tolerance) = tolerance.filter(|t| *t <= LOOSE) else {
        return (Method::Gonzalez, "it is not linear");
    };
    let asks = tolerance <= if kinked { CORNERS } else { FINE };
    let fits = count(c) <= LARGE && c.arguments().is_empty() && !has_corners(c);
    if !(small || asks && fits) {
        return (Method::Gonzalez, "it is not linear, and large");
    }
    // Where curves hold one another, as dry friction on both sides of a gear, only steps of order 2 go on well.
    if kinked && (tolerance > TIGHT || has_corners(c) && tolerance > CORNERS) {
        return (Method::Gonzalez, "it is not linear, and not smooth");
    }
    // A tank that runs dry does so in finite time: nodes that lie on both sides of that take it for filling again.
    if kinked && damps && !c.states.is_empty() && empties(c, &mut model.pool) {
        return (Method::Radau, "it comes to rest by a root, in finite time, and must not go on beyond");
    }
    let apart = kinked && !collocation::is_coupled(c, ORDER_8);
    if apart && (any(model, &is_root) || c.nodes.iter().any(|n| is_flat(n, &mut model.pool))) {
        return (Method::Gonzalez, "it is not linear, and has kinks and a root");
    }
    if !small {
        return (Method::Collocation6, "it is large, and the tolerance asks for order 6");
    }
    if kinked {
        return (Method::Collocation8, "steps end at its kinks, and the tolerance asks for order 8");
    }
    match tolerance <= TIGHT {
        true => (Method::Collocation8, "it is smooth, and the tolerance asks for order 8"),
        false => (Method::Collocation6, "it is smooth, and the tolerance asks for order 6"),
    }
}

/// The stepper of a linear cluster with a source that `exact` does not follow, where steps are fitted, and why; none where
/// it is too large for another of high order, or is sampled, in intervals that are short beside what moves.
pub(super) fn driven(c: &Cluster) -> Option<(Method, &'static str)> {
    // Of an odd number of stages: what is stiff and was set off by a jump of the source is seen to last.
    (is_small(c) && c.ports.is_empty())
        .then_some((Method::Collocation6, "it is linear, but for a source that `exact` does not follow"))
}

/// Whether collocation is cheap. Arguments of exponentials come on top: what they are solved with is linear in the rest.
fn is_small(c: &Cluster) -> bool {
    count(c) <= UNKNOWNS
}

/// Unknowns of a stage, but arguments of exponentials.
fn count(c: &Cluster) -> usize {
    c.states.len() + c.loops.len() - c.arguments().len()
}

/// All that a step is solved for: laws, sources, rates and slopes of energies. What probes integrate is not.
pub(super) fn laws(c: &Cluster) -> Vec<Expr> {
    let energies = c.groups.iter().flat_map(|g| g.coenergy.iter().copied());
    let nodes = c.nodes.iter().flat_map(|n| n.how.expressions());
    energies.chain(nodes).chain(c.states.iter().map(|s| s.rate)).collect()
}

/// Whether a law is a curve with corners, as that of dry friction.
pub(super) fn has_corners(c: &Cluster) -> bool {
    c.nodes.iter().any(|n| n.is_bare())
}

/// Whether something has a kink or a jump.
pub(super) fn is_kink(n: &Node) -> bool {
    match n {
        Node::Select(..) => true,
        Node::Unary(f, _) => matches!(f, Unary::Abs | Unary::Sign | Unary::Floor | Unary::Not),
        Node::Binary(f, ..) => !matches!(f, Binary::Atan2 | Binary::Pow),
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Power(..) => false,
    }
}

/// Whether a law that is solved for what it is given has no slope at 0, so that its inverse is a root.
pub(super) fn is_flat(n: &cluster::Node, pool: &mut Pool) -> bool {
    let Output::Implicit { residual: e, .. } = n.how else { return false };
    let (slope, zero) = (pool.derivative(e, n.out), pool.int(0));
    let slope = pool.substitute(slope, &std::iter::once((n.out, zero)).collect());
    pool.is_zero(slope)
}

/// Whether a law gives the root of what it is given, up to 0, as an orifice does.
fn empties(c: &Cluster, pool: &mut Pool) -> bool {
    let rooted = |n: &Node| match n {
        Node::Product(_, factors) => {
            factors.iter().any(|(base, n)| (f64::EPSILON..1.0).contains(&n.to_f64()) && pool.any_node(*base, &is_kink))
        }
        _ => false,
    };
    let written = c.nodes.iter().flat_map(|n| n.how.expressions()).any(|e| pool.any_node(e, &rooted));
    written || c.nodes.iter().any(|n| is_flat(n, pool))
}

/// Whether something has a root, and so an infinite slope: beyond it a step may have no solution, however near.
fn is_root(n: &Node) -> bool {
    match n {
        Node::Product(_, pairs) => pairs.iter().any(|(_, n)| (f64::EPSILON..1.0).contains(&n.to_f64())),
        Node::Power(..) => true,
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
            false
        }
    }
}
