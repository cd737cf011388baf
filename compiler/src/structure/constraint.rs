//! Constraints: storages tied to others, or to sources, that are not merged into one.
//!
//! Each storage keeps its own state and energy. What ties a storage d to the others is a column of its own, whose
//! output is the multiplier lambda = dx_d/dt and whose input is how far the others are from it,
//!
//! ```text
//! c = A z + B u - z_d = 0,     dx/dt = F - A^T lambda,     dx_d/dt = lambda
//! ```
//!
//! with z the co-energy variables of the storages that it follows and u what sources give. D stays skew, so the
//! multiplier does no work: lambda c = 0. Any energies and any ratios can stand there, since nothing is inverted.

use super::change::{self, Change};
use super::dependence::Dependence;
use super::eliminated::Eliminated;
use super::start::at_start;
use super::storage::storage;
use super::{Column, ColumnId, Form, Role, Row, curved, start};
use crate::expression::{Expr, Pool};
use crate::model::Model;
use bond_grammar::diagnostic::Diagnostic;

/// Ties the storages of a set by constraints; they start where what is stated of them agrees.
///
/// # Errors
/// Starts that do not agree, with the elements.
pub(super) fn constrain(
    model: &mut Model,
    form: &mut Form,
    set: &Dependence,
    done: &mut Eliminated,
) -> Result<(), Diagnostic> {
    settle(model, form, set, done)?;
    // A speed without inertia is what its neighbours let it be: no effort is left at it.
    for c in &set.independent {
        if model.element(form.column(*c).element).is_massless() {
            form.columns[c.at()].role = Role::Constraint;
        }
    }
    let one = model.pool.int(1);
    let minus = model.pool.neg(one);
    let through = through(model, form, &set.dependent);
    for d in &set.dependent {
        let tie = form.column(*d).clone();
        let name = format!("{}.{}", tie.name, tie.gives.other().letter());
        let (own, out) = (ColumnId(form.columns.len() as u32), model.pool.symbol(&name));
        let role = Role::Storage;
        form.column_of.insert(out, own);
        form.column_of_element[tie.element.at()] = Some(own);
        form.columns.push(Column { role, gives: tie.gives.other(), out, row: vec![(*d, one)], ..tie });
        let tie = &mut form.columns[d.at()];
        tie.role = Role::Constraint;
        tie.row.push((own, minus));
        if let Some(start) = done.starts.remove(d) {
            let symbol = storage(model, form.column(own).element).map(|s| s.state);
            done.states.extend(symbol.map(|s| (own, (s, start, true))));
        }
    }
    follow(model, form, &through, done);
    Ok(())
}

/// Which storage another one follows by less than what imposes its co-energy variable: that of the last body of a
/// chain is that of the one before it and of the joint between. By storage, the other one and the factor.
type Through = Vec<(ColumnId, ColumnId, Expr)>;

/// Finds for each storage the one that leaves the least of its row, among those with shorter ones.
fn through(model: &mut Model, form: &Form, dependent: &[ColumnId]) -> Through {
    let mut order: Vec<ColumnId> = dependent.to_vec();
    order.sort_by_key(|d| (form.column(*d).row.len(), *d));
    let mut found = Vec::new();
    for (i, d) in order.iter().enumerate() {
        let own = &form.column(*d).row;
        let best = order[..i].iter().filter_map(|e| {
            let (factor, same) = likeness(&mut model.pool, own, &form.column(*e).row)?;
            // What the two have in common, less what the other has besides.
            let more = form.column(*e).row.len() - same;
            (same > more + 1).then_some((same - more, *e, factor))
        });
        if let Some((_, e, factor)) = best.max_by_key(|(gain, e, _)| (*gain, *e)) {
            found.push((*d, e, factor));
        }
    }
    found
}

/// The factor by which one row goes into another most, and how many entries they then have in common.
fn likeness(pool: &mut Pool, row: &Row, other: &Row) -> Option<(Expr, usize)> {
    let entry = |c: ColumnId| row.binary_search_by_key(&c, |t| t.0).ok().map(|i| row[i].1);
    let shared: Vec<(Expr, Expr)> = other.iter().filter_map(|(c, k)| Some((entry(*c)?, *k))).collect();
    let (mine, theirs) = *shared.first()?;
    let factor = pool.div(mine, theirs);
    pool.constant(factor)?;
    let same = shared.iter().filter(|(mine, theirs)| pool.mul(factor, *theirs) == *mine).count();
    Some((factor, same))
}

/// Has constraints take their storages' own outputs for what these impose: a combination of constraints, by which the
/// multipliers combine too. Rows then have entries for neighbours alone.
fn follow(model: &mut Model, form: &mut Form, through: &Through, done: &mut Eliminated) {
    if through.is_empty() {
        return;
    }
    let mut change: Change = Vec::new();
    for (d, e, factor) in through {
        let one = model.pool.int(1);
        change.push((*d, vec![(*d, one), (*e, model.pool.neg(*factor))]));
    }
    // The multipliers of those that others follow are theirs and parts of the others'.
    let followed: Vec<ColumnId> = through.iter().map(|t| t.1).filter(|e| !through.iter().any(|t| t.0 == *e)).collect();
    for e in followed {
        if !change.iter().any(|(d, _)| *d == e) {
            let one = model.pool.int(1);
            change.push((e, vec![(e, one)]));
        }
    }
    change::transform(&mut model.pool, form, &change);
    for (e, _) in &change {
        let old = form.column(*e).out;
        let name = format!("{}'", model.pool.name(old));
        let new = model.pool.symbol(&name);
        form.columns[e.at()].out = new;
        form.column_of.insert(new, *e);
    }
    for (e, _) in &change {
        let old = done.before[e.at()];
        let mut terms = vec![model.pool.var(form.column(*e).out)];
        for (d, _, factor) in through.iter().filter(|t| t.1 == *e) {
            let new = model.pool.var(form.column(*d).out);
            let part = model.pool.mul(*factor, new);
            terms.push(model.pool.neg(part));
        }
        let sum = model.pool.sum(&terms);
        done.fixed.insert(old, sum);
    }
}

/// Finds where the storages start, from their co-energy variables: these are tied linearly.
fn settle(model: &mut Model, form: &Form, set: &Dependence, done: &mut Eliminated) -> Result<(), Diagnostic> {
    let found = curved::start(model, form, set)?;
    let mut all = Vec::new();
    for (c, z) in set.independent.iter().zip(found) {
        let Some(s) = storage(model, form.column(*c).element).cloned() else { continue };
        if s.massless {
            all.push(z.unwrap_or(0.0));
            continue;
        }
        all.push(z.unwrap_or_else(|| at_start(model, form, s.coenergy)));
        let start = start::settled(model, form, set, (*c, &s), z)?;
        done.states.insert(*c, (s.state, start, true));
    }
    for (i, d) in set.dependent.iter().enumerate() {
        let Some(s) = storage(model, form.column(*d).element).cloned() else { continue };
        let terms = set.ratio[i].iter().zip(&all).filter(|(k, _)| !model.pool.is_zero(**k));
        let sum: f64 = terms.map(|(k, z)| at_start(model, form, *k) * z).sum();
        let z = sum + start::driven(model, form, &set.sources[i]);
        // What a signal of the run decides is found by the first step.
        let start = start::settled(model, form, set, (*d, &s), Some(z).filter(|z| z.is_finite()))?;
        done.starts.insert(*d, start);
    }
    Ok(())
}
