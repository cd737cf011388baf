//! What constraints have come to since the start, where some say the same.
//!
//! Each step has its constraints hold to rounding, and so positions. Where constraints say the same they do so on these
//! positions alone: beside them they contradict one another by as much as positions are off, no step fulfils them all,
//! and what one leaves is off by more in the next. So the step keeps the sum of what it has left of each, and the next
//! ones have it in their equations (Baumgarte, Comput. Methods Appl. Mech. Eng. 1, 1972): rounding is put right as fast
//! as the longest step so far, and does not grow. At once, in steps that are far shorter, it would be a jolt.

use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::equations::angle_addition::{AngleSums, Carries};
use crate::discretise::equations::inputs::Inputs;
use crate::expression::{Expr, Lowering};
use crate::model::Model;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Value};

/// The places of the multipliers among the loops of a cluster whose constraints may say the same.
fn ties(c: &Cluster) -> Vec<usize> {
    let nodes = c.loop_nodes();
    (0..nodes.len()).filter(|i| c.redundant && nodes[*i].constraint().is_some()).collect()
}

/// How many numbers are kept: one a constraint, and the longest step.
pub(crate) fn memory(c: &Cluster) -> usize {
    ties(c).len() + 1
}

/// What each constraint is over the step, and the sum of that so far.
pub(crate) struct KeptPositions {
    constraints: Vec<(Expr, Value)>,
    longest: Value,
}

impl KeptPositions {
    /// Has the constraints, among the residuals of a step (those of states before those of loops), put right what was
    /// left of them.
    pub(crate) fn of(
        c: &Cluster,
        model: &mut Model,
        (b, lowering): (&mut Builder, &mut Lowering),
        inputs: &Inputs,
        residuals: &mut [Expr],
    ) -> Self {
        let ties = ties(c);
        if ties.is_empty() {
            return Self { constraints: Vec::new(), longest: inputs.h };
        }
        let first = b.slots(Array::State, c.memory).index as usize;
        let longest = b.load(Slot::new(Array::State, first + ties.len()));
        let longest = b.binary(Binary::Max, longest, inputs.h);
        let mut constraints = Vec::new();
        for (k, place) in ties.into_iter().enumerate() {
            let before = b.load(Slot::new(Array::State, first + k));
            let left = model.pool.symbol("left of a constraint");
            lowering.bind(left, b.div(before, longest));
            let residual = &mut residuals[c.states.len() + place];
            constraints.push((*residual, before));
            let left = model.pool.var(left);
            *residual = model.pool.add(*residual, left);
        }
        Self { constraints, longest }
    }

    /// Keeps the sums, once the step is found. Sines and cosines are had as the iteration has them, of angles and what
    /// rounding took from these (`states`).
    ///
    /// # Errors
    /// A symbol that means nothing.
    pub(crate) fn keep(
        &self,
        c: &Cluster,
        model: &mut Model,
        (b, lowering): (&mut Builder, &mut Lowering),
        (h, states): (Value, &Carries),
    ) -> Result<(), Vec<Diagnostic>> {
        let all: Vec<Expr> = self.constraints.iter().map(|t| t.0).collect();
        let changes = c.delta.iter().copied().collect();
        let mut at = lowering.clone();
        if let Some(turns) = AngleSums::of(&mut model.pool, &all, &changes, states) {
            let before = turns.before(model, b, lowering, states)?;
            turns.write(model, b, &mut at, &before)?;
        }
        for (k, (constraint, before)) in self.constraints.iter().enumerate() {
            let value = at.lower(&model.pool, b, *constraint).map_err(|s| missing(model, s))?;
            let change = b.mul(h, value);
            let sum = b.add(*before, change);
            b.store(Slot::new(Array::Next, c.memory_at() + k), sum);
        }
        b.store(Slot::new(Array::Next, c.memory_at() + self.constraints.len()), self.longest);
        Ok(())
    }
}
