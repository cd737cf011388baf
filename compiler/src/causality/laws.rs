//! What causality has to know of laws: which cannot be run backwards, and which energies are quadratic.

use super::modulation::Parts;
use crate::expression::{Pool, Sign};
use crate::graph::BondGraph;
use crate::model::{ElementId, Law, Model, Resistor};

/// The law of a resistor.
pub(super) fn law(model: &Model, id: ElementId) -> Option<&Resistor> {
    match &model.element(id).law {
        Law::Resistor(r) => Some(r),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => None,
    }
}

/// Of all elements: which laws cannot be run backwards, which energies are quadratic, and what moves what.
pub(super) struct Laws {
    pub(super) one_way: Vec<bool>,
    pub(super) quadratic: Vec<bool>,
    pub(super) parts: Parts,
}

impl Laws {
    pub(super) fn of(model: &mut Model, graph: &BondGraph) -> Self {
        let mut pool = std::mem::take(&mut model.pool);
        let one_way: Vec<bool> =
            model.elements.iter().map(|e| matches!(&e.law, Law::Resistor(r) if one_way(&mut pool, r))).collect();
        let quadratic: Vec<bool> = model.elements.iter().map(|e| quadratic(&mut pool, &e.law)).collect();
        model.pool = pool;
        Self { one_way, quadratic, parts: Parts::of(model, graph) }
    }
}

/// Whether a law cannot be run backwards: its slope is not seen to be positive everywhere.
pub(super) fn one_way(pool: &mut Pool, r: &Resistor) -> bool {
    if r.curve.is_some() {
        return false; // solved along the curve either way
    }
    let slope = pool.derivative(r.output, r.argument);
    if matches!(pool.sign(slope, &|_| Sign::Unknown), Sign::Positive | Sign::Negative) {
        return false;
    }
    if pool.symbols(r.output).iter().any(|s| *s != r.argument) {
        // A linear law can be run backwards unless its coefficient vanishes, as that of a damper that is off does.
        let Some(k) = r.linear else { return true };
        let points = [0.37, -0.61, 2.3, -3.7, 41.0, -53.0];
        return points.iter().any(|x| pool.eval(k, &|s| x * (1.0 + 0.01 * f64::from(s.0 % 7))) == 0.0);
    }
    // Strictly monotone at every point that was tried will do: the solution is checked in each step.
    let points = [1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0, 1e3, 1e6];
    !points.iter().flat_map(|x| [*x, -*x]).all(|x| {
        let k = pool.eval(slope, &|_| x);
        k > 0.0 || k.is_nan() || (k == 0.0 && x.abs() > 1e2)
    })
}

/// Whether a storage's co-energy variable is linear in the states.
fn quadratic(pool: &mut Pool, law: &Law) -> bool {
    let Law::Storage(s) = law else { return false };
    let symbols = pool.symbols(s.energy);
    pool.affine(s.coenergy, &symbols).is_some_and(|(linear, _)| linear.iter().all(|t| pool.constant(t.1).is_some()))
}
