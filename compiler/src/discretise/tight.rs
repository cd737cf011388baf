//! Resistors that hold storages tightly together, or to a source: what flows through them is an unknown of its own.
//!
//! Over a step far longer than R C the voltage across R is a small difference of large ones, and so known to their
//! rounding: as a current that is h / (R C) times as much of what is stored, and each step's balance would be off by
//! that. As an unknown it has its own digits: what it brings to one side it takes from the other, and it is the law of
//! R that holds to rounding.

use super::cluster::{Cluster, Node};
use super::{measure, stiff};
use crate::expression::{Expr, Pool, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Output, Row};
use rustc_hash::FxHashMap;

/// Steps of so many times R C, from which on the rounding shows: of a large voltage, the same way in each step.
pub(super) const TIGHT: f64 = 30.0;
/// More unknowns than this are left as they are.
const MOST: usize = 8;

impl Cluster {
    /// Finds them, as storages bend at the start, and puts the outputs in order anew.
    pub(super) fn tighten(&mut self, model: &mut Model, form: &Form) {
        if self.states.len() + self.loops.len() >= MOST {
            return;
        }
        let start = self.start(model);
        let mut tight = Vec::new();
        for (i, node) in self.nodes.iter().enumerate() {
            let Output::Explicit(_) = node.how else { continue };
            let Some(pull) = self.pull(model, form, node) else { continue };
            if start.eval(&model.pool, pull) * start.step > TIGHT {
                tight.push(i);
            }
        }
        if tight.is_empty() || self.states.len() + self.loops.len() + tight.len() > MOST {
            return;
        }
        for i in tight {
            let Some(column) = self.nodes[i].resistor() else { continue };
            let Some(k) = gain(form, column) else { continue };
            let input = form.input(&mut model.pool, column);
            let z = model.pool.var(self.nodes[i].out);
            let z = model.pool.div(z, k);
            self.tight.push(self.nodes[i].out);
            self.nodes[i].how = Output::Implicit { residual: model.pool.sub(z, input), bends: None };
        }
        self.order(&mut model.pool);
    }

    /// What is known before it runs.
    pub(super) fn start(&self, model: &Model) -> Start {
        let step = match self.sampling {
            Some(s) => model.samplings[s].period,
            None => model.settings.pace,
        };
        let states = self.states.iter().map(|s| (s.symbol, s.initial));
        Start { values: states.chain(self.h.map(|h| (h, step))).collect(), step }
    }

    /// How fast a linear resistor brings together what it stands between, in 1/s; None where that is nothing that may
    /// cancel.
    pub(super) fn pull(&self, model: &mut Model, form: &Form, node: &Node) -> Option<Expr> {
        let column = node.resistor()?;
        let Law::Resistor(law) = &model.element(form.column(column).element).law else { return None };
        let row = &form.column(column).row;
        if law.linear.is_none() || row.len() < 2 {
            return None;
        }
        let k = match (gain(form, column)?, node.switched) {
            // As it is where it holds more tightly.
            (k, Some(_)) => stiff::steepest(&mut model.pool, k, node.out),
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
        let bends = measure::curvatures(self, model);
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
    pub(super) fn stiffness_at_start(&self, model: &mut Model, form: &Form, column: ColumnId) -> Option<f64> {
        let stiffness = self.stiffness(model, &form.column(column).row)?;
        let start = self.start(model);
        Some(start.eval(&model.pool, stiffness)).filter(|k| *k > 0.0 && k.is_finite())
    }
}

/// What is known of a cluster before it runs.
pub(super) struct Start {
    /// States, and the step's length.
    values: FxHashMap<Symbol, f64>,
    /// The length of a step, or of a long fitted one, s.
    pub(super) step: f64,
}

impl Start {
    /// The value of an expression; what is not known counts as 0.
    pub(super) fn eval(&self, pool: &Pool, e: Expr) -> f64 {
        pool.eval(e, &|s| self.values.get(&s).copied().or_else(|| pool.value(s)).unwrap_or(0.0))
    }
}

/// What a linear resistor gives for what it receives.
pub(super) fn gain(form: &Form, column: ColumnId) -> Option<Expr> {
    let row = form.regions.iter().find_map(|r| r.gains.get(&column))?;
    match row[..] {
        [(own, k)] if own == column => Some(k),
        _ => None,
    }
}
