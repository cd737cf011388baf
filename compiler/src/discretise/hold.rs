//! What a sampled region holds at its ports: `lagged`, `predicted`, `matched`.

use super::cluster::{Cluster, missing, verified};
use super::gonzalez;
use super::measure;
use super::write::{self, System};
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::{Hold, Model};
use crate::structure::{ColumnId, Form, Role};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Program, Slot, Unary};
use bond_runtime::scene::Respond;
use rustc_hash::FxHashMap;

/// The ports, by index, whose outgoing variable the cluster holds.
pub(super) fn held_ports(c: &Cluster, form: &Form) -> Vec<usize> {
    if c.sampling.is_none() {
        return Vec::new();
    }
    let holds = |p: &ColumnId| match form.column(*p).role {
        Role::Bar => form.bars.iter().any(|b| b.holder == *p),
        Role::Open(_) => true,
        Role::Source(_) | Role::Storage | Role::Resistor | Role::Dependent => false,
    };
    c.ports.iter().enumerate().filter(|(_, p)| holds(p)).map(|(i, _)| i).collect()
}

/// Writes the program that finds the held variables; `None` where there are none.
pub(super) fn write(
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
    if hold == Hold::Matched {
        let (solves, plain) =
            (respond(c, model, form, hold, holds, is_ray)?, respond(c, model, form, Hold::Predicted, holds, is_ray)?);
        return Ok(Some(Respond::Matched(solves, plain)));
    }
    Ok(Some(Respond::Last(respond(c, model, form, hold, holds, is_ray)?)))
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
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let outs: Vec<Expr> = holds.iter().map(|p| form.input(&mut model.pool, c.ports[*p])).collect();
    // What the step will call for: with a discrete gradient over the step, or at its start (the paper's).
    let over_step = hold != Hold::Lagged && !is_ray;
    let map =
        if over_step { gonzalez::midpoint(c, &mut model.pool, form) } else { c.at_instant(&mut model.pool, form) };
    let flat = c.flat(&mut model.pool, map);
    let (mut unknowns, mut residuals, mut start, mut weight, mut scale) = if over_step {
        let (unknowns, residuals) = gonzalez::system(c, &mut model.pool, &flat);
        let (weight, scale) = gonzalez::measures(c, model, form, &mut b, &mut lowering, &inputs)?;
        let zero = b.number(0.0);
        let start = c.states.iter().map(|_| zero).chain(inputs.guesses.iter().copied()).collect();
        (unknowns, residuals, start, weight, scale)
    } else {
        let residuals =
            c.loop_residuals(&mut model.pool).into_iter().map(|r| model.pool.substitute(r, &flat)).collect();
        let one = model.pool.int(1);
        let weight = measure::weights_of_loops(c, model, form, &mut b, &lowering, &inputs.guesses, one)?;
        let scale = measure::scales(c, model, form, &mut b, &lowering, (&[], &[], &inputs.guesses), None)?;
        (c.loops.clone(), residuals, inputs.guesses.clone(), weight, scale)
    };
    let matched = hold == Hold::Matched;
    if matched {
        // The answer is q = alpha - beta v, and a port's own variable is -q/T: u T + alpha - beta v = 0.
        let n = holds.len();
        let alpha: Vec<Symbol> = (0..n).map(|i| model.pool.symbol(&format!("alpha[{i}]"))).collect();
        let beta: Vec<Symbol> = (0..n * n).map(|i| model.pool.symbol(&format!("beta[{}][{}]", i / n, i % n))).collect();
        for s in alpha.iter().chain(&beta) {
            let slot = b.named(Array::Input, model.pool.name(*s));
            let v = b.load(slot);
            lowering.bind(*s, v);
        }
        let h = c.h.map(|h| model.pool.var(h)).unwrap_or_else(|| model.pool.int(1));
        let flat_outs: Vec<Expr> = outs.iter().map(|e| model.pool.substitute(*e, &flat)).collect();
        let env: FxHashMap<Symbol, _> = inputs.env.iter().copied().collect();
        let called = measure::called(c, model, form, &mut b, &lowering, &inputs.guesses, holds)?;
        for (i, p) in holds.iter().enumerate() {
            let own = form.column(c.ports[*p]).out;
            let u = model.pool.var(own);
            let alpha_i = model.pool.var(alpha[i]);
            let beta_of: Vec<Expr> = (0..n).map(|j| model.pool.var(beta[i * n + j])).collect();
            let mut terms = vec![model.pool.mul(u, h), model.pool.var(alpha[i])];
            for (j, v) in flat_outs.iter().enumerate() {
                let b_ij = model.pool.var(beta[i * n + j]);
                let t = model.pool.mul(b_ij, *v);
                terms.push(model.pool.neg(t));
            }
            residuals.push(model.pool.sum(&terms));
            unknowns.push(own);
            let begin = env.get(&own).copied().unwrap_or(inputs.t);
            start.push(begin);
            // At rest alpha and what is called for cancel: the answer has their rounding.
            let free = lowering.lower(&model.pool, &mut b, alpha_i).map_err(|s| missing(model, s))?;
            let mut size = b.unary(Unary::Abs, free);
            for (j, v) in called.iter().enumerate() {
                let yields = lowering.lower(&model.pool, &mut b, beta_of[j]).map_err(|s| missing(model, s))?;
                let yields = b.unary(Unary::Abs, yields);
                let part = b.mul(yields, *v);
                size = b.add(size, part);
            }
            let (size, own) = (b.div(size, inputs.h), b.unary(Unary::Abs, begin));
            scale.push(b.add(own, size));
            let square = model.pool.powi(h, 2);
            let b_ii = model.pool.var(beta[i * n + i]);
            let w = model.pool.div(square, b_ii);
            weight.push(lowering.lower(&model.pool, &mut b, w).map_err(|s| missing(model, s))?);
        }
    }
    let flag = matched.then(|| b.slot(Array::Local));
    write::solve(
        model,
        &mut b,
        &mut lowering,
        System {
            unknowns,
            h: c.h,
            start,
            residuals,
            weight,
            scale,
            flag,
            bends: c.bends(),
            open: c.is_open(),
            ..System::default()
        },
    )?;
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
    // What the sources of the region are foretold to put in: the budget may spend it.
    let mut supplied = b.number(0.0);
    for column in c.nodes.iter().filter_map(|n| n.source()) {
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
