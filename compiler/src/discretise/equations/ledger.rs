//! The ledger's terms of a step: means at ports, energies supplied, dissipated and stored.

use crate::discretise::analysis::energy_minimum;
use crate::discretise::cluster::{Cluster, Group, missing};
use crate::discretise::equations::constraints::{self, Projected};
use crate::discretise::equations::inputs::Inputs;
use crate::discretise::equations::{angle_addition, error_weights};
use crate::expression::{Expr, Lowering, Node, Number, Symbol};
use crate::model::{Model, Variable};
use crate::structure::{ColumnId, Form};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Unary, Value};
use bond_runtime::scene::Entries;
use rustc_hash::{FxHashMap, FxHashSet};

/// Stores the ledger's terms of a step, and the port means. The outputs over the step are given by some instants of it,
/// or means, each with its weight; what puts the end on constraints comes on top.
#[expect(clippy::too_many_arguments, reason = "the pieces of one step")]
pub(crate) fn ledger(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    stages: &[(f64, &FxHashMap<Symbol, Expr>)],
    entries: &[Entries],
    (h, projected): (Value, Option<&Projected>),
) -> Result<(), Vec<Diagnostic>> {
    let mut value = |model: &mut Model, b: &mut Builder, flat: &FxHashMap<Symbol, Expr>, e: Expr| {
        let e = model.pool.substitute(e, flat);
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))
    };
    // Σ weight of what `one` gives at each.
    type One<'a> = dyn FnMut(&mut Model, &mut Builder, &FxHashMap<Symbol, Expr>) -> Result<Value, Vec<Diagnostic>> + 'a;
    let mean = |model: &mut Model, b: &mut Builder, one: &mut One| -> Result<Value, Vec<Diagnostic>> {
        let mut sum = None;
        for (weight, flat) in stages {
            let mut v = one(model, b, flat)?;
            if *weight != 1.0 {
                let weight = b.number(*weight);
                v = b.mul(weight, v);
            }
            sum = Some(sum.map_or(v, |s| b.add(s, v)));
        }
        Ok(sum.unwrap_or_else(|| b.number(0.0)))
    };
    for (i, p) in c.ports.iter().enumerate() {
        let e = form.input(&mut model.pool, *p);
        let v = mean(model, b, &mut |model, b, flat| value(model, b, flat, e))?;
        b.store(Slot::new(Array::Output, i), v);
    }
    let mut power = |model: &mut Model, b: &mut Builder, columns: &[ColumnId]| {
        mean(model, b, &mut |model, b, flat| {
            let mut sum = None;
            for column in columns {
                let (z, i) = (model.pool.var(form.column(*column).out), form.input(&mut model.pool, *column));
                let (z, i) = (value(model, b, flat, z)?, value(model, b, flat, i)?);
                let p = b.mul(z, i);
                sum = Some(sum.map_or(p, |s| b.add(s, p)));
            }
            Ok(sum.unwrap_or_else(|| b.number(0.0)))
        })
    };
    let all = c.accounts(model, form);
    for (e, accounts) in entries.iter().zip(&all) {
        for ((_, slot), column) in e.supplied.iter().zip(&accounts.supplied) {
            let p = power(model, b, &[*column])?;
            let w = b.mul(h, p);
            let mut w = b.unary(Unary::Neg, w);
            if let Some(more) = projected.and_then(|found| found.supplied.get(column)) {
                w = b.add(w, *more);
            }
            b.store(Slot::new(Array::Output, *slot), w);
        }
        for ((_, slot), columns) in e.dissipated.iter().zip(&accounts.dissipated) {
            let p = power(model, b, columns)?;
            let w = b.mul(h, p);
            b.store(Slot::new(Array::Output, *slot), w);
        }
    }
    constraints::store(c, form, b, entries, projected);
    for (e, accounts) in entries.iter().zip(&all) {
        for (produced, columns) in e.produced.iter().zip(&accounts.produced) {
            for (slot, warm) in [(produced.entropy, false), (produced.heat, true)] {
                let sum = mean(model, b, &mut |model, b, flat| {
                    let mut sum = b.number(0.0);
                    for column in columns {
                        let s = variable(model, form, *column, Variable::Flow);
                        let s = value(model, b, flat, s)?;
                        sum = b.sub(sum, s);
                    }
                    if warm {
                        let temperature = variable(model, form, columns[0], Variable::Effort);
                        let temperature = value(model, b, flat, temperature)?;
                        sum = b.mul(sum, temperature);
                    }
                    Ok(sum)
                })?;
                let w = b.mul(h, sum);
                b.store(Slot::new(Array::Output, slot), w);
            }
        }
    }
    Ok(())
}

/// One of the two variables of a column.
pub(crate) fn variable(model: &mut Model, form: &Form, column: ColumnId, variable: Variable) -> Expr {
    match form.column(column).gives == variable {
        true => model.pool.var(form.column(column).out),
        false => form.input(&mut model.pool, column),
    }
}

/// Stores H of each region at given values of the states. Where an energy has angles in it, which may grow to many
/// turns, or a spring begins far from where its stroke is counted from, what rounding took from the states (`rests`)
/// counts to first order: else each step's balance would be off by the rounding of the angle or stroke.
pub(crate) fn energies(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    b: &mut Builder,
    (states, rests): (&[Value], &[Value]),
    inputs: &Inputs,
    entries: &[Entries],
) -> Result<(), Vec<Diagnostic>> {
    let mut at = Lowering::new(inputs.env.iter().copied());
    for (s, x) in c.states.iter().zip(states) {
        at.bind(s.symbol, *x);
    }
    // The energy of what follows a source depends on the time.
    let mut end: FxHashMap<Symbol, Expr> = FxHashMap::default();
    if let (Some(t), Some(h)) = (c.time, c.h) {
        let (te, he) = (model.pool.var(t), model.pool.var(h));
        end.insert(t, model.pool.add(te, he));
    }
    let symbols: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    angle_addition::angles(model, b, &mut at, &c.energies(), &symbols)?;
    for (e, r) in entries.iter().zip(&c.regions) {
        let h = c.energy(&mut model.pool, *r);
        let later = model.pool.substitute(h, &end);
        let v = at.lower(&model.pool, b, later).map_err(|s| missing(model, s))?;
        let v = with_rests(c, model, b, (&mut at, rests), c.groups_in(*r).iter(), v)?;
        b.store(Slot::new(Array::Output, e.energy), v);
        if let Some(slot) = e.before {
            let mut start = Lowering::new(inputs.env.iter().copied());
            let v = start.lower(&model.pool, b, h).map_err(|s| missing(model, s))?;
            b.store(Slot::new(Array::Output, slot), v);
        }
        if let Some(work) = &e.work {
            let groups = c.working_groups(model, form, *r);
            let terms: Vec<Expr> = groups.into_iter().map(|g| c.energy_form(&mut model.pool, g).energy).collect();
            let sum = model.pool.sum(&terms);
            let later = model.pool.substitute(sum, &end);
            let v = at.lower(&model.pool, b, later).map_err(|s| missing(model, s))?;
            b.store(Slot::new(Array::Output, work.energy), v);
        }
        if e.size != e.energy {
            let size = size(c, model, b, &mut at, c.groups_in(*r).iter(), &end)?;
            b.store(Slot::new(Array::Output, e.size), size);
        }
    }
    Ok(())
}

/// An energy of some groups with what rounding took from their states, where that counts.
pub(crate) fn with_rests<'a>(
    c: &Cluster,
    model: &Model,
    b: &mut Builder,
    (at, rests): (&mut Lowering, &[Value]),
    groups: impl Iterator<Item = &'a Group>,
    energy: Value,
) -> Result<Value, Vec<Diagnostic>> {
    let symbols: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).collect();
    let of_states =
        |z: &Expr| model.pool.symbols(*z).iter().all(|s| model.pool.value(*s).is_some() || symbols.contains(s));
    let moves = |e: Expr| model.pool.contains_any(e, &|s| symbols.contains(&s));
    let is_offset = |c: &Number, terms: &[(Expr, Number)]| {
        let moving = terms.iter().filter(|t| moves(t.0)).count();
        moving > 0 && (moving < terms.len() || !c.is_zero())
    };
    let is_coarse = |n: &Node| match n {
        Node::Unary(Unary::Sin | Unary::Cos, _) => true,
        Node::Sum(c, terms) => is_offset(c, terms),
        _ => false,
    };
    let mut v = energy;
    for g in groups.filter(|g| model.pool.any_node(g.energy, &is_coarse) && g.coenergy.iter().all(of_states)) {
        for (s, z) in g.states.iter().zip(&g.coenergy) {
            let Some(rest) = rests.get(*s) else { continue };
            let z = at.lower(&model.pool, b, *z).map_err(|s| missing(model, s))?;
            let more = b.mul(z, *rest);
            v = b.add(v, more);
        }
    }
    Ok(v)
}

/// The sum of the magnitudes of the energies of some groups, and of how far each is above its least.
pub(crate) fn size<'a>(
    c: &Cluster,
    model: &mut Model,
    b: &mut Builder,
    at: &mut Lowering,
    groups: impl Iterator<Item = &'a Group>,
    end: &FxHashMap<Symbol, Expr>,
) -> Result<Value, Vec<Diagnostic>> {
    let mut size = b.number(0.0);
    for g in groups {
        // What several states share may cancel within itself, as the double pendulum's kinetic energy and its
        // height do.
        let parts = if g.states.len() > 1 {
            error_weights::summands(model, end, g.energy, error_weights::DEEP)
        } else {
            let level = c.energy_form(&mut model.pool, g).energy;
            let later = model.pool.substitute(level, end);
            let size = model.pool.unary(Unary::Abs, later);
            // Where it passes 0 on its way up from its least, it is there all the same.
            match energy_minimum::reference(model, g, c) {
                (least, true) if least != 0.0 => {
                    let least = model.pool.float(least);
                    let above = model.pool.sub(later, least);
                    let above = model.pool.unary(Unary::Abs, above);
                    model.pool.add(size, above)
                }
                (_, _) => size,
            }
        };
        let v = at.lower(&model.pool, b, parts).map_err(|s| missing(model, s))?;
        size = b.add(size, v);
    }
    Ok(size)
}
