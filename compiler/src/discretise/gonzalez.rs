//! The discrete-gradient step (Gonzalez, J. Nonlinear Sci. 6, 1996): order 2, the balance exact.
//!
//! (x+ - x)/h = D z at the midpoint of states and time, with the co-energy variable of each storage replaced by its discrete
//! gradient, which for one state is the difference quotient of H, written without cancellation. Resistors and loops are
//! solved with it. The unknowns are the changes of the states, so that x+ = x + change is rounded once.

use super::cluster::{Cluster, missing, verified};
use super::write::{self, System};
use crate::expression::{Expr, Lowering, Pool, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Value};
use bond_runtime::scene::{Entries, Stepper};
use rustc_hash::FxHashMap;

/// States at the midpoint, storages' outputs as discrete gradients, time at the midpoint.
pub(super) fn midpoint(c: &Cluster, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
    let mut map = FxHashMap::default();
    let half = pool.ratio(1, 2);
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        let d = pool.mul(half, d);
        map.insert(s.symbol, pool.add(x, d));
    }
    let middle = map.clone();
    for g in &c.groups {
        if let [only] = g.states[..] {
            let s = &c.states[only];
            let Some(column) = s.column else { continue };
            let (x, d) = (pool.var(s.symbol), pool.var(c.delta[only]));
            map.insert(form.column(column).out, pool.difference(g.energy, s.symbol, x, d));
        } else {
            // Merged storages have a quadratic energy, whose gradient at the midpoint is a discrete gradient.
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                let Some(column) = c.states[*s].column else { continue };
                let z = pool.substitute(*z, &middle);
                map.insert(form.column(column).out, z);
            }
        }
    }
    if let (Some(t), Some(h)) = (c.time, c.h) {
        let (te, he) = (pool.var(t), pool.var(h));
        let he = pool.mul(half, he);
        map.insert(t, pool.add(te, he));
        for &(_, u, du) in &c.inputs {
            let (ue, due) = (pool.var(u), pool.var(du));
            let ahead = pool.mul(he, due);
            map.insert(u, pool.add(ue, ahead));
        }
    }
    map
}

/// The step's unknowns with their residuals: changes of the states, then loops.
pub(super) fn system(c: &Cluster, pool: &mut Pool, flat: &FxHashMap<Symbol, Expr>) -> (Vec<Symbol>, Vec<Expr>) {
    let mut unknowns = c.delta.clone();
    let mut residuals = Vec::new();
    if let Some(h) = c.h {
        let h = pool.var(h);
        for (s, d) in c.states.iter().zip(&c.delta) {
            let rate = pool.substitute(s.rate, flat);
            let step = pool.mul(h, rate);
            let d = pool.var(*d);
            residuals.push(pool.sub(d, step));
        }
    }
    for r in c.loop_residuals(pool) {
        residuals.push(pool.substitute(r, flat));
    }
    unknowns.extend(c.loops.iter().copied());
    (unknowns, residuals)
}

/// Weights and scales of the step's unknowns.
pub(super) fn measures(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    inputs: &write::Inputs,
) -> Result<(Vec<Value>, Vec<Value>), Vec<Diagnostic>> {
    let mut weight = Vec::new();
    for k in write::curvatures(c, model) {
        weight.push(lowering.lower(&model.pool, b, k).map_err(|s| missing(model, s))?);
    }
    if let Some(h) = c.h {
        let h = model.pool.var(h);
        weight.extend(write::weights_of_loops(c, model, form, b, lowering, &inputs.guesses, h)?);
    }
    let h = c.h.map(|h| model.pool.var(h));
    let scale = write::scales(c, model, form, b, lowering, (&inputs.states, &inputs.traces, &inputs.guesses), h)?;
    Ok((weight, scale))
}

/// Writes the step.
pub(super) fn write(c: &Cluster, model: &mut Model, form: &Form) -> Result<(Stepper, Vec<Entries>), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "gonzalez step"));
    let entries = c.reserve(&model.pool, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let map = midpoint(c, &mut model.pool, form);
    let flat = c.flat(&mut model.pool, map);
    let (unknowns, residuals) = system(c, &mut model.pool, &flat);
    let (weight, scale) = measures(c, model, form, &mut b, &mut lowering, &inputs)?;
    let zero = b.number(0.0);
    let start = c.states.iter().map(|_| zero).chain(inputs.guesses.iter().copied()).collect();
    write::solve(
        model,
        &mut b,
        &mut lowering,
        System { unknowns: &unknowns, start, residuals, weight, scale, flag: None },
    )?;
    let (mut next, mut rests) = (Vec::new(), Vec::new());
    for (x, d) in inputs.states.iter().zip(&c.delta) {
        let d = model.pool.var(*d);
        let d = lowering.lower(&model.pool, &mut b, d).map_err(|s| missing(model, s))?;
        let carry = b.load(inputs.carries[next.len()]);
        let (v, rest) = write::advance(&mut b, *x, d, carry);
        next.push(v);
        rests.push(rest);
    }
    write::ledger(c, model, form, &mut b, &mut lowering, &flat, &entries, inputs.h)?;
    let first = b.slots(Array::Next, c.slots()).index as usize;
    for (i, v) in rests.iter().enumerate() {
        b.store(Slot::new(Array::Next, c.carry_at() + i), *v);
    }
    for (i, v) in next.iter().enumerate() {
        b.store(Slot::new(Array::Next, first + i), *v);
    }
    for (i, (integral, start)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rate = model.pool.substitute(integral.rate, &flat);
        let rate = lowering.lower(&model.pool, &mut b, rate).map_err(|s| missing(model, s))?;
        let change = b.mul(inputs.h, rate);
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, c.states.len() + i), v);
    }
    for (i, z) in c.loops.iter().enumerate() {
        let z = model.pool.var(*z);
        let v = lowering.lower(&model.pool, &mut b, z).map_err(|s| missing(model, s))?;
        b.store(Slot::new(Array::Next, c.states.len() + c.integrals.len() + i), v);
    }
    write::energies(c, model, &mut b, &next, &entries)?;
    let program = verified(model, b.finish())?;
    Ok((Stepper { name: "gonzalez", order: 2, passive: true, program, linear: None, glance: None }, entries))
}
