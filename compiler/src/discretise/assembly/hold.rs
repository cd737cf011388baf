//! What a sampled region holds at its ports: `lagged`, `predicted`, `matched`.

use crate::discretise::cluster::{Cluster, Node, missing, verified};
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::system::System;
use crate::discretise::equations::{accounts, discrete_gradient, error_weights, newton};
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::{Hold, Model};
use crate::structure::{ColumnId, Form};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Program, Slot, Unary};
use bond_runtime::scene::{Respond, Steering};
use rustc_hash::FxHashMap;

/// Writes the program that finds the held variables; `None` where there are none.
pub(crate) fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    hold: Hold,
    holds: &[usize],
    is_ray: bool,
) -> Result<Option<Respond>, Vec<Diagnostic>> {
    if holds.is_empty() {
        return Ok(None);
    }
    let mut program = |hold| respond(c, model, form, hold, holds, is_ray);
    let first = program(hold)?;
    let fallback = if hold == Hold::Matched { Some(program(Hold::Predicted)?) } else { None };
    Ok(Some(Respond { program: first, fallback }))
}

fn respond(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    hold: Hold,
    holds: &[usize],
    is_ray: bool,
) -> Result<Program, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, &format!("{} hold", hold.name())));
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let outs: Vec<Expr> = holds.iter().map(|p| form.input(&mut model.pool, c.ports[*p])).collect();
    // What the step will call for: with a discrete gradient over the step, or at its start (the paper's).
    let over_step = hold != Hold::Lagged && !is_ray;
    let map = if over_step {
        discrete_gradient::midpoint(c, &mut model.pool, form)
    } else {
        c.at_instant(&mut model.pool, form)
    };
    let flat = c.flat(&mut model.pool, map);
    let mut system = if over_step {
        let (unknowns, residuals) = discrete_gradient::system(c, &mut model.pool, &flat);
        let (weight, scale) = discrete_gradient::measures(c, model, form, &mut b, &mut lowering, &inputs)?;
        let zero = b.number(0.0);
        let start = c.states.iter().map(|_| zero).chain(inputs.guesses.iter().copied()).collect();
        System { unknowns, residuals, start, weight, scale, ..System::default() }
    } else {
        let residuals = c.residuals_in(&mut model.pool, &flat);
        let one = model.pool.int(1);
        let weight = error_weights::weights_of_loops(c, model, form, &mut b, &lowering, &inputs.guesses, one)?;
        let scale = error_weights::scales(c, model, form, &mut b, &lowering, (&[], &[], &inputs.guesses), None)?;
        let (unknowns, start) = (c.loops.clone(), inputs.guesses.clone());
        System { unknowns, residuals, start, weight, scale, ..System::default() }
    };
    let matched = hold == Hold::Matched;
    if matched {
        let flat_outs: Vec<Expr> = outs.iter().map(|e| model.pool.substitute(*e, &flat)).collect();
        add_answers((c, model, form), (&mut b, &mut lowering), &inputs, (holds, &flat_outs), &mut system)?;
    }
    let flag = matched.then(|| b.slot(Array::Local));
    system = System {
        h: c.h,
        flag,
        knees: c.exponential_knees(),
        undetermined: c.may_be_undetermined(),
        redundant: c.redundant,
        ..system
    };
    newton::solve(model, &mut b, &mut lowering, system)?;
    for (i, e) in outs.iter().enumerate() {
        let e = model.pool.substitute(*e, &flat);
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, format!("held({})", form.column(c.ports[holds[i]]).name));
        b.store(Slot::new(Array::Output, slot.index as usize), v);
    }
    if let Some(flag) = flag {
        let v = b.load(flag);
        let slot = b.named(Array::Output, "solved");
        b.store(slot, v);
    }
    // What the region's own sources are predicted to put in as work: the budget may spend it.
    let mut supplied = b.number(0.0);
    let counts = |column: &ColumnId| {
        accounts::steering(model, form, *column) != Some(Steering::Drawing)
            && !accounts::is_thermal(model, form, *column)
    };
    let own: Vec<ColumnId> = c.nodes.iter().filter_map(Node::source).filter(counts).collect();
    for column in own {
        let (z, i) = (model.pool.var(form.column(column).out), form.input(&mut model.pool, column));
        let power = model.pool.mul(z, i);
        let power = model.pool.substitute(power, &flat);
        let p = lowering.lower(&model.pool, &mut b, power).map_err(|s| missing(model, s))?;
        let w = b.mul(inputs.h, p);
        supplied = b.sub(supplied, w);
    }
    let slot = b.named(Array::Output, "supplied");
    b.store(slot, supplied);
    verified(model, b.finish())
}

/// Adds the held variables as unknowns. The other side answers with q = alpha - beta v, and a port's own variable is
/// -q/T: u T + alpha - beta v = 0.
fn add_answers(
    (c, model, form): (&Cluster, &mut Model, &Form),
    (b, lowering): (&mut Builder, &mut Lowering),
    inputs: &Inputs,
    (holds, outs): (&[usize], &[Expr]),
    system: &mut System,
) -> Result<(), Vec<Diagnostic>> {
    let n = holds.len();
    let alpha: Vec<Symbol> = (0..n).map(|i| model.pool.symbol(&format!("alpha[{i}]"))).collect();
    let beta: Vec<Symbol> = (0..n * n).map(|i| model.pool.symbol(&format!("beta[{}][{}]", i / n, i % n))).collect();
    for s in alpha.iter().chain(&beta) {
        let slot = b.named(Array::Input, model.pool.name(*s));
        let v = b.load(slot);
        lowering.bind(*s, v);
    }
    let h = c.h.map(|h| model.pool.var(h)).unwrap_or_else(|| model.pool.int(1));
    let env: FxHashMap<Symbol, _> = inputs.env.iter().copied().collect();
    let called = error_weights::called(c, model, form, b, lowering, &inputs.guesses, holds)?;
    for (i, p) in holds.iter().enumerate() {
        let own = form.column(c.ports[*p]).out;
        let u = model.pool.var(own);
        let alpha_i = model.pool.var(alpha[i]);
        let beta_of: Vec<Expr> = (0..n).map(|j| model.pool.var(beta[i * n + j])).collect();
        let mut terms = vec![model.pool.mul(u, h), alpha_i];
        for (beta_ij, v) in beta_of.iter().zip(outs) {
            let t = model.pool.mul(*beta_ij, *v);
            terms.push(model.pool.neg(t));
        }
        system.residuals.push(model.pool.sum(&terms));
        system.unknowns.push(own);
        let begin = env.get(&own).copied().unwrap_or(inputs.t);
        system.start.push(begin);
        // At rest alpha and what is called for cancel: the answer has their rounding.
        let free = lowering.lower(&model.pool, b, alpha_i).map_err(|s| missing(model, s))?;
        let mut size = b.unary(Unary::Abs, free);
        for (beta_ij, v) in beta_of.iter().zip(&called) {
            let yields = lowering.lower(&model.pool, b, *beta_ij).map_err(|s| missing(model, s))?;
            let yields = b.unary(Unary::Abs, yields);
            let part = b.mul(yields, *v);
            size = b.add(size, part);
        }
        let (size, own) = (b.div(size, inputs.h), b.unary(Unary::Abs, begin));
        system.scale.push(b.add(own, size));
        let square = model.pool.powi(h, 2);
        let w = model.pool.div(square, beta_of[i]);
        system.weight.push(lowering.lower(&model.pool, b, w).map_err(|s| missing(model, s))?);
    }
    Ok(())
}
