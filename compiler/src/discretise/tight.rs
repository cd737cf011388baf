//! Resistors that hold storages tightly together, or to a source: what flows through them is an unknown of its own.
//!
//! Over a step far longer than R C the voltage across R is a small difference of large ones, and so known to their
//! rounding: as a current that is h / (R C) times as much of what is stored, and each step's balance would be off by
//! that. As an unknown it has its own digits: what it brings to one side it takes from the other, and it is the law of
//! R that holds to rounding.

use super::cluster::{Cluster, Part};
use super::write;
use crate::expression::Symbol;
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Output};
use bond_runtime::ir::Unary;
use rustc_hash::FxHashMap;

/// Steps of so many times R C, from which on the rounding shows.
const TIGHT: f64 = 1e3;
/// The part of a run that a fitted step is taken to be.
const PART: f64 = 0.01;
/// More unknowns than this are left as they are.
const MOST: usize = 8;

impl Cluster {
    /// Finds them, as storages bend at the start, and puts the outputs in order anew.
    pub(super) fn tighten(&mut self, model: &mut Model, form: &Form) {
        let step = match self.sampling {
            Some(s) => model.samplings[s].period,
            None => model.settings.step.unwrap_or(PART * model.settings.stop.unwrap_or(1.0)),
        };
        let bends = self.bends_at_start(model);
        let tight: Vec<usize> =
            (0..self.nodes.len()).filter(|i| self.pull(model, form, &bends, *i) * step > TIGHT).collect();
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
            self.nodes[i].how = Output::Implicit(model.pool.sub(z, input));
        }
        self.order(&model.pool);
    }

    /// How storages bend at the start, by the columns of their states.
    fn bends_at_start(&self, model: &mut Model) -> FxHashMap<ColumnId, f64> {
        let start: FxHashMap<Symbol, f64> = self.states.iter().map(|s| (s.symbol, s.initial)).collect();
        let curvatures = write::curvatures(self, model);
        let value = |s: Symbol| start.get(&s).copied().or_else(|| model.pool.value(s)).unwrap_or(0.0);
        let bend = |k| model.pool.eval(k, &value);
        self.states.iter().zip(curvatures).filter_map(|(s, k)| Some((s.column?, bend(k)))).collect()
    }

    /// How fast a linear resistor brings what it stands between together, 1/s; 0 where that is nothing that may cancel.
    fn pull(&self, model: &mut Model, form: &Form, bends: &FxHashMap<ColumnId, f64>, node: usize) -> f64 {
        let node = &self.nodes[node];
        let (Part::Resistor(column), Output::Explicit(_)) = (&node.part, node.how) else { return 0.0 };
        let Law::Resistor(law) = &model.element(form.column(*column).element).law else { return 0.0 };
        let row = &form.column(*column).row;
        if law.linear.is_none() || row.len() < 2 {
            return 0.0;
        }
        let Some(k) = gain(form, *column).and_then(|k| model.pool.constant(k)) else { return 0.0 };
        let mut sum = 0.0;
        for (other, by) in row {
            let Some(bend) = bends.get(other) else { continue };
            let by = model.pool.unary(Unary::Abs, *by);
            let by = model.pool.constant(by).unwrap_or(0.0);
            sum += by * by * bend * k;
        }
        if sum.is_finite() { sum } else { 0.0 }
    }
}

/// What a linear resistor gives for what it receives.
fn gain(form: &Form, column: ColumnId) -> Option<crate::expression::Expr> {
    let row = form.regions.iter().find_map(|r| r.gains.get(&column))?;
    match row[..] {
        [(own, k)] if own == column => Some(k),
        _ => None,
    }
}
