//! The signal states of a sampled block: at each sample their next values are computed from what is known then, and
//! taken at the sample after it.

use crate::discretise::cluster::{Cluster, missing, verified};
use crate::discretise::equations::inputs;
use crate::expression::Lowering;
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot};
use bond_runtime::scene::{Properties, Stepper};

/// Writes the step of a cluster without regions.
pub(crate) fn write(c: &Cluster, model: &mut Model, form: &Form) -> Result<Stepper, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "next values"));
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    b.slots(Array::Next, c.slots());
    inputs::no_carry(&mut b, c);
    for (i, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
        let mut v = lowering.lower(&model.pool, &mut b, s.rate).map_err(|s| missing(model, s))?;
        if !s.jumps {
            let change = b.mul(inputs.h, v);
            v = b.add(*x, change);
        }
        b.store(Slot::new(Array::Next, i), v);
    }
    for (i, (integral, x)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rate = lowering.lower(&model.pool, &mut b, integral.rate).map_err(|s| missing(model, s))?;
        let change = b.mul(inputs.h, rate);
        let v = b.add(*x, change);
        b.store(Slot::new(Array::Next, c.states.len() + i), v);
    }
    let program = verified(model, b.finish())?;
    Ok(Stepper::new("next", Properties { passive: true, ..Properties::NONE }, program))
}
