//! What estimates the error of a step at the nodes of Radau where no energy is to be kept: the difference to a method
//! of order 3 that also sees the rate at the start. One linear system filters it, so that it stays small where the step
//! is long beside what is stiff (Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., IV.8). A
//! step and its halves would not do: with the same start, both may find a solution on another branch.
//!
//! ```text
//! (u I - h J) error = h f(x) + d1 z1 + d2 z2 + d3 z3,      z_i what the state changes by up to the node i
//! ```
//!
//! with u the real eigenvalue of the inverse of A, and J the Jacobian of the rates f at the start.

use super::tableau::Tableau;
use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::equations::inputs::Inputs;
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Solve, Value};

/// The order of the method that the step is compared with.
pub(super) const ORDER: u32 = 3;

/// The real eigenvalue of the inverse of Radau IIA's matrix of 3 stages: 30/(6 + 81^(1/3) - 9^(1/3)).
const EIGENVALUE: f64 = 3.637_834_252_744_496;

/// Stores the errors of states and integrals; the first of the outputs. None where the rates are not known at once.
/// `changes` are the stages' rates times the step, by stage and state, `integrands` those of integrals, by integral and
/// stage.
pub(super) fn store(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    (b, lowering): (&mut Builder, &mut Lowering),
    tableau: &Tableau,
    inputs: &Inputs,
    (changes, integrands): (&[Value], &[Vec<Expr>]),
) -> Result<Option<usize>, Vec<Diagnostic>> {
    if !c.groups.is_empty() || !c.loops.is_empty() || c.states.is_empty() {
        return Ok(None);
    }
    let flat = c.flat_at_instant(&mut model.pool, form);
    let states: Vec<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    let all: Vec<Expr> = c.states.iter().map(|s| s.rate).chain(c.integrals.iter().map(|i| i.rate)).collect();
    let rates: Vec<Expr> = all.into_iter().map(|e| model.pool.substitute(e, &flat)).collect();
    let n = states.len();
    let root = 6f64.sqrt();
    let weights = [-(13.0 + 7.0 * root) / 3.0, (-13.0 + 7.0 * root) / 3.0, -1.0 / 3.0];
    // The weights of the stages' rates in the sum of what the states change by.
    let matrix = tableau.matrix();
    let by_stage: Vec<f64> =
        (0..weights.len()).map(|j| weights.iter().zip(&matrix).map(|(w, row)| w * row[j]).sum()).collect();
    let mut value =
        |model: &mut Model, b: &mut Builder, e: Expr| lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s));
    let mut right = Vec::new();
    for (i, rate) in rates.iter().enumerate() {
        let rate = value(model, b, *rate)?;
        let mut sum = b.mul(inputs.h, rate);
        for (j, w) in by_stage.iter().enumerate() {
            let change = match i.checked_sub(n) {
                None => changes[j * n + i],
                Some(k) => {
                    let rate = value(model, b, integrands[k][j])?;
                    b.mul(inputs.h, rate)
                }
            };
            let w = b.number(*w);
            let term = b.mul(w, change);
            sum = b.add(sum, term);
        }
        right.push(sum);
    }
    let u = b.number(EIGENVALUE);
    let (mut entries, mut rows) = (Vec::new(), Vec::new());
    for (i, rate) in rates.iter().enumerate() {
        let slopes = model.pool.derivatives(*rate, &states);
        let mut row = Vec::new();
        for (j, slope) in slopes.into_iter().enumerate() {
            if model.pool.is_zero(slope) && i != j {
                continue;
            }
            let slope = value(model, b, slope)?;
            let moved = b.mul(inputs.h, slope);
            if i < n {
                let zero = b.number(0.0);
                let from = if i == j { u } else { zero };
                entries.push((i as u32, j as u32, b.sub(from, moved)));
            } else {
                row.push((j, moved));
            }
        }
        rows.push(row);
    }
    let first = b.slots(Array::Local, n);
    let rest = right.split_off(n);
    b.solve(Solve { unknowns: first.index, right, matrix: entries, imaginary: Vec::new(), flag: None });
    let mut errors: Vec<Value> =
        (0..n as u32).map(|i| b.load(Slot { array: Array::Local, index: first.index + i })).collect();
    for (sum, row) in rest.into_iter().zip(&rows[n..]) {
        let mut sum = sum;
        for (j, moved) in row {
            let term = b.mul(*moved, errors[*j]);
            sum = b.add(sum, term);
        }
        errors.push(b.div(sum, u));
    }
    let named = c.integrals.iter().map(|i| model.pool.name(i.symbol).to_string());
    let names = c.states.iter().map(|s| s.name.clone()).chain(named);
    let slots: Vec<Slot> = names.map(|n| b.named(Array::Output, format!("error({n})"))).collect();
    for (slot, error) in slots.iter().zip(errors) {
        b.store(*slot, error);
    }
    Ok(slots.first().map(|s| s.index as usize))
}
