//! Stiffly coupled resistors, between two storages or a storage and a source: the flow through them is an unknown of
//! its own.
//!
//! Over a step far longer than R C the voltage across R is a small difference of large ones, and so known to their
//! rounding: as a current that is h / (R C) times as much of what is stored, and each step's balance would be off by
//! that. As an unknown it has its own digits: what it brings to one side it takes from the other, and it is the law of
//! R that holds to rounding.

use crate::discretise::analysis::{curvature, relay};
use crate::discretise::cluster::{Cluster, Node, own_gain};
use crate::expression::Expr;
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Output, Row};

/// With more unknowns than this, resistors are left as they are.
const MOST: usize = 8;

impl Cluster {
    /// Finds them, as storages bend at the start, and puts the outputs in order anew.
    pub(crate) fn couple_stiffly(&mut self, model: &mut Model, form: &Form) {
        if self.states.len() + self.loops.len() >= MOST {
            return;
        }
        let start = self.start(model);
        let mut coupled = Vec::new();
        for (i, node) in self.nodes.iter().enumerate() {
            let Output::Explicit(_) = node.how else { continue };
            let Some(rate) = self.coupling_rate(model, form, node) else { continue };
            if start.eval(&model.pool, rate) * start.step > model.settings.thresholds.stiffness.tight {
                coupled.push(i);
            }
        }
        if coupled.is_empty() || self.states.len() + self.loops.len() + coupled.len() > MOST {
            return;
        }
        for i in coupled {
            let Some(column) = self.nodes[i].resistor() else { continue };
            let Some(k) = own_gain(form, column) else { continue };
            let input = form.input(&mut model.pool, column);
            let z = model.pool.var(self.nodes[i].out);
            let z = model.pool.div(z, k);
            self.stiffly_coupled.push(self.nodes[i].out);
            self.nodes[i].how = Output::Implicit { residual: model.pool.sub(z, input), bends: None };
        }
        self.blt_sort(&mut model.pool);
    }

    /// How fast a linear resistor brings together what it stands between, in 1/s; None where that is nothing that may
    /// cancel.
    pub(crate) fn coupling_rate(&self, model: &mut Model, form: &Form, node: &Node) -> Option<Expr> {
        let column = node.resistor()?;
        let Law::Resistor(law) = &model.element(form.column(column).element).law else { return None };
        let row = &form.column(column).row;
        if law.linear.is_none() || row.len() < 2 {
            return None;
        }
        let k = match (own_gain(form, column)?, node.switched) {
            // As it is where it holds more tightly.
            (k, Some(_)) => relay::steepest(&mut model.pool, k, node.out),
            (k, None) => {
                model.pool.constant(k)?;
                k
            }
        };
        let stiffness = self.stiffness(model, row)?;
        Some(model.pool.mul(k, stiffness))
    }

    /// What changes of that which storages give together, in a second and by what they are given together; None where
    /// none has a part in it.
    fn stiffness(&self, model: &mut Model, row: &Row) -> Option<Expr> {
        let bends = curvature::curvatures(self, model);
        let mut terms = Vec::new();
        for (s, bend) in self.states.iter().zip(bends) {
            let Some((_, by)) = row.iter().find(|t| Some(t.0) == s.column) else { continue };
            let square = model.pool.powi(*by, 2);
            terms.push(model.pool.mul(square, bend));
        }
        (!terms.is_empty()).then(|| model.pool.sum(&terms))
    }

    /// What storages change of that which they give a resistor, in a second and by what it gives, at the start; None
    /// where they have none of it.
    pub(crate) fn stiffness_at_start(&self, model: &mut Model, form: &Form, column: ColumnId) -> Option<f64> {
        let stiffness = self.stiffness(model, &form.column(column).row)?;
        let start = self.start(model);
        Some(start.eval(&model.pool, stiffness)).filter(|k| *k > 0.0 && k.is_finite())
    }
}
