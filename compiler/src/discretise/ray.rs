//! The paper's own step (Stramigioli, Secchi, van der Schaft, Fantuzzi 2002), section 3: with e_C = dH/dx at x_k,
//! dH = -T f_R^T R f_R - T e_I^T f_I, and the next state is where the line x_k + s f_C meets the level set H(x_k) + dH,
//! the s nearest T. Where it does not meet it, the state leaps to its mirror image on the line through the minimum of
//! H, at the same energy, and the energy that is missing is booked.

use super::cluster::{Cluster, missing, verified};
use super::write::{self, System};
use super::{instant, level};
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::{Entries, Stepper};
use rustc_hash::FxHashMap;

/// Writes the step.
pub(super) fn write(c: &Cluster, model: &mut Model, form: &Form) -> Result<(Stepper, Vec<Entries>), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "ray step"));
    let mut entries = c.reserve(model, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let flat = instant::outputs(
        c,
        model,
        form,
        &mut b,
        &mut lowering,
        (&inputs.guesses, instant::Pull { curves: instant::SLIGHT, switches: instant::Switched::Free }),
        None,
    )?;
    write::ledger(c, model, form, &mut b, &mut lowering, &[(1.0, &flat)], &entries, inputs.h)?;
    let n = c.states.len();
    let mut rates: Vec<Value> = Vec::new();
    for s in &c.states {
        let e = model.pool.substitute(s.rate, &flat);
        rates.push(lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?);
    }
    // The change of energy is the power into the storages times T: their outputs times their rates.
    let mut change: Option<Value> = None;
    for (s, rate) in c.states.iter().zip(&rates) {
        let Some(column) = s.column else { continue };
        let z = model.pool.var(form.column(column).out);
        let z = model.pool.substitute(z, &flat);
        let z = lowering.lower(&model.pool, &mut b, z).map_err(|s| missing(model, s))?;
        let p = b.mul(z, *rate);
        let w = b.mul(inputs.h, p);
        change = Some(match change {
            Some(c) => b.add(c, w),
            None => w,
        });
    }
    let zero = b.number(0.0);
    let change = change.unwrap_or(zero);
    let total = c.regions.iter().map(|r| c.energy(&mut model.pool, *r)).collect::<Vec<_>>();
    let total = model.pool.sum(&total);
    let before = lowering.lower(&model.pool, &mut b, total).map_err(|s| missing(model, s))?;
    let target = b.add(before, change);
    // H(x + s f) - target, with s = T (1 + r).
    let (r, f): (Symbol, Vec<Symbol>) =
        (model.pool.symbol("r"), c.states.iter().map(|s| model.pool.symbol(&format!("rate({})", s.name))).collect());
    let goal = model.pool.symbol("target");
    for (s, v) in f.iter().zip(&rates) {
        lowering.bind(*s, *v);
    }
    lowering.bind(goal, target);
    let h = c.h.map(|h| model.pool.var(h)).unwrap_or_else(|| model.pool.int(1));
    let one = model.pool.int(1);
    let along = {
        let r = model.pool.var(r);
        let s = model.pool.add(one, r);
        model.pool.mul(h, s)
    };
    let line: FxHashMap<Symbol, Expr> = c
        .states
        .iter()
        .zip(&f)
        .map(|(s, f)| {
            let (x, f) = (model.pool.var(s.symbol), model.pool.var(*f));
            let d = model.pool.mul(along, f);
            (s.symbol, model.pool.add(x, d))
        })
        .collect();
    let moved = model.pool.substitute(total, &line);
    let goal = model.pool.var(goal);
    let residual = model.pool.sub(moved, goal);
    let flag = b.slot(Array::Local);
    let unit = b.number(1.0);
    let system = System {
        unknowns: vec![r],
        start: vec![zero],
        residuals: vec![residual],
        weight: vec![unit],
        scale: vec![unit],
        flag: Some(flag),
        ..System::default()
    };
    write::solve(model, &mut b, &mut lowering, system)?;
    // Where an energy is flat, as beyond a stop, next to no slope is left to go by: what is found has to be on the level.
    let met = b.load(flag);
    let there = lowering.lower(&model.pool, &mut b, moved).map_err(|s| missing(model, s))?;
    let met = on_level(&mut b, met, there, target, before);
    // Without a change of energy the state may go the whole way if that is as high; else it stays, being on the level
    // set already.
    let full: FxHashMap<Symbol, Expr> = std::iter::once((r, model.pool.int(0))).collect();
    let off = model.pool.substitute(residual, &full);
    let off = lowering.lower(&model.pool, &mut b, off).map_err(|s| missing(model, s))?;
    let level = b.binary(Binary::Eq, off, zero);
    let uneven = b.unary(Unary::Not, level);
    let stands = b.binary(Binary::Eq, change, zero);
    let stands = b.binary(Binary::And, stands, uneven);
    // The mirror image: x_min - m (x - x_min), at the same energy.
    let mut lowest = vec![0.0; n];
    for g in &c.groups {
        for s in &g.states {
            lowest[*s] = level::minimum(model, g, c, *s);
        }
    }
    let minimum = lowest;
    let m = model.pool.symbol("mirror");
    let mirrored: Vec<Expr> = c
        .states
        .iter()
        .zip(&minimum)
        .map(|(s, low)| {
            let (x, low, m) = (model.pool.var(s.symbol), model.pool.float(*low), model.pool.var(m));
            let off = model.pool.sub(x, low);
            let back = model.pool.mul(m, off);
            model.pool.sub(low, back)
        })
        .collect();
    let map: FxHashMap<Symbol, Expr> = c.states.iter().map(|s| s.symbol).zip(mirrored.iter().copied()).collect();
    let there = model.pool.substitute(total, &map);
    let residual = model.pool.sub(there, total);
    let mirror_flag = b.slot(Array::Local);
    let system = System {
        unknowns: vec![m],
        start: vec![unit],
        residuals: vec![residual],
        weight: vec![unit],
        scale: vec![unit],
        flag: Some(mirror_flag),
        ..System::default()
    };
    write::solve(model, &mut b, &mut lowering, system)?;
    let found = b.load(mirror_flag);
    let there = lowering.lower(&model.pool, &mut b, there).map_err(|s| missing(model, s))?;
    let found = on_level(&mut b, found, there, before, before);
    let mut next = Vec::new();
    for ((s, e), low) in c.states.iter().zip(&mirrored).zip(&minimum) {
        let line_of = *line.get(&s.symbol).unwrap_or(&one);
        let on_line = lowering.lower(&model.pool, &mut b, line_of).map_err(|s| missing(model, s))?;
        let mirror = lowering.lower(&model.pool, &mut b, *e).map_err(|s| missing(model, s))?;
        let low = b.number(*low);
        let leap = b.select(found, mirror, low);
        let chosen = b.select(met, on_line, leap);
        let x = inputs.states[next.len()];
        if s.column.is_none() {
            // A signal state has no energy, and goes its own way.
            let change = b.mul(inputs.h, rates[next.len()]);
            next.push(b.add(x, change));
            continue;
        }
        next.push(b.select(stands, x, chosen));
    }
    b.slots(Array::Next, c.slots());
    write::no_carry(&mut b, c);
    for (i, v) in next.iter().enumerate() {
        b.store(Slot::new(Array::Next, i), *v);
    }
    for (i, (integral, start)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rate = model.pool.substitute(integral.rate, &flat);
        let rate = lowering.lower(&model.pool, &mut b, rate).map_err(|s| missing(model, s))?;
        let d = b.mul(inputs.h, rate);
        let v = b.add(*start, d);
        b.store(Slot::new(Array::Next, n + i), v);
    }
    for (i, z) in c.loops.iter().enumerate() {
        let z = model.pool.var(*z);
        let v = lowering.lower(&model.pool, &mut b, z).map_err(|s| missing(model, s))?;
        b.store(Slot::new(Array::Next, n + c.integrals.len() + i), v);
    }
    write::energies(c, model, &mut b, (&next, &[]), &inputs, &entries)?;
    // What a leap missed: H+ - target where there was one.
    let mut at = Lowering::new(c.states.iter().map(|s| s.symbol).zip(next.iter().copied()));
    let after = at.lower(&model.pool, &mut b, total).map_err(|s| missing(model, s))?;
    let miss = b.sub(after, target);
    let leapt = b.unary(Unary::Not, met);
    let moving = b.unary(Unary::Not, stands);
    let leapt = b.binary(Binary::And, leapt, moving);
    let miss = b.select(leapt, miss, zero);
    let (energy, count) = (b.named(Array::Output, "leap energy"), b.named(Array::Output, "leaps"));
    b.store(energy, miss);
    b.store(count, leapt);
    if let Some(e) = entries.first_mut() {
        e.leap = Some((energy.index as usize, count.index as usize));
    }
    let program = verified(model, b.finish())?;
    Ok((Stepper::new("ray", 1, true, program), entries))
}

/// An energy that differs from what it should be by no more than this part of the larger one is that.
const SAME: f64 = 1e-9;

/// Whether what was found is where the energy is what it should be, beside what there was.
fn on_level(b: &mut Builder, found: Value, there: Value, wanted: Value, before: Value) -> Value {
    let off = b.sub(there, wanted);
    let (off, wanted, before) = (b.unary(Unary::Abs, off), b.unary(Unary::Abs, wanted), b.unary(Unary::Abs, before));
    let (size, part) = (b.binary(Binary::Max, wanted, before), b.number(SAME));
    let most = b.mul(part, size);
    let is_there = b.binary(Binary::Le, off, most);
    b.binary(Binary::And, found, is_there)
}
