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
use super::{Column, ColumnId, Form, Role, Row, curved, quadratic, start};
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;
use bond_grammar::diagnostic::Diagnostic;
use rustc_hash::{FxHashMap, FxHashSet};

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
    set.dependent.iter().for_each(|d| clear(model, form, *d, done));
    Ok(())
}

/// Has a constraint without what its ratios are divided by, which may pass 0: at the dead centre of a crank the slider
/// does not say how fast the crank turns, but the crank says that the slider stands still.
fn clear(model: &mut Model, form: &mut Form, d: ColumnId, done: &mut Eliminated) {
    let all = form.column(d).row.iter().flat_map(|t| model.pool.symbols(t.1));
    let moving: FxHashSet<Symbol> = all.filter(|s| model.pool.value(*s).is_none()).collect();
    let moves = |s: Symbol| moving.contains(&s);
    let pool = &mut model.pool;
    let mut row = form.column(d).row.clone();
    row.iter_mut().for_each(|(_, k)| *k = quadratic::expanded(pool, *k, &moves));
    let entries: Vec<Expr> = row.iter().map(|t| t.1).collect();
    let divisors = quadratic::divisors(pool, &entries, &moves);
    if divisors.is_empty() {
        return;
    }
    let powers: Vec<Expr> = divisors.iter().map(|(base, n)| pool.powi(*base, *n)).collect();
    let factor = pool.product(&powers);
    row.iter_mut().for_each(|(_, k)| *k = quadratic::spread(pool, *k, factor));
    for (c, k) in &row {
        let minus = pool.neg(*k);
        if let Some(entry) = form.columns[c.at()].row.iter_mut().find(|t| t.0 == d) {
            entry.1 = minus;
        }
    }
    let old = form.column(d).out;
    let new = pool.symbol(&format!("{}'", pool.name(old)));
    let column = &mut form.columns[d.at()];
    (column.row, column.out) = (row, new);
    form.column_of.insert(new, d);
    let new = pool.var(new);
    let whole = pool.mul(factor, new);
    let map = FxHashMap::from_iter([(old, whole)]);
    done.fixed.values_mut().for_each(|e| *e = pool.substitute(*e, &map));
    done.fixed.insert(old, whole);
}

/// Columns whose rows are told by that of a storage which a constraint ties: the column, the storage, and the factor.
type Through = Vec<(ColumnId, ColumnId, Expr)>;

/// Finds for each column the storage that leaves the least of its row: the last body of a chain goes with the one
/// before it and with the joint between, and what counts the angle of a wheel with the wheel, rather than with the
/// slider by a ratio that passes 0. Among storages that are tied, those with shorter rows.
fn through(model: &mut Model, form: &Form, dependent: &[ColumnId]) -> Through {
    let mut order: Vec<ColumnId> = dependent.to_vec();
    order.sort_by_key(|d| (form.column(*d).row.len(), *d));
    let all = (0..form.columns.len() as u32).map(ColumnId).filter(|c| !order.contains(c));
    let others: Vec<(ColumnId, usize)> = all.map(|c| (c, order.len())).collect();
    let mut found = Vec::new();
    for (c, count) in order.iter().copied().enumerate().map(|(i, d)| (d, i)).chain(others) {
        let own = &form.column(c).row;
        let least = if is_divided(&mut model.pool, own) { 0 } else { 1 };
        let best = order[..count].iter().filter_map(|e| {
            let (factor, same) = likeness(&mut model.pool, own, &form.column(*e).row)?;
            // What the two have in common, less what the other has besides.
            let more = form.column(*e).row.len() - same;
            (same > more + least).then_some((same - more, *e, factor))
        });
        if let Some((_, e, factor)) = best.max_by_key(|(gain, e, _)| (*gain, *e)) {
            found.push((c, e, factor));
        }
    }
    found
}

/// Whether a row has a divisor that moves.
fn is_divided(pool: &mut Pool, row: &Row) -> bool {
    let moving: FxHashSet<Symbol> =
        row.iter().flat_map(|t| pool.symbols(t.1)).filter(|s| pool.value(*s).is_none()).collect();
    let entries: Vec<Expr> = row.iter().map(|t| quadratic::expanded(pool, t.1, &|s| moving.contains(&s))).collect();
    !quadratic::divisors(pool, &entries, &|s| moving.contains(&s)).is_empty()
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

/// Has columns take the storages' own outputs for what these impose: a combination with the constraints, by which the
/// multipliers combine too. Rows then have entries for neighbours alone.
fn follow(model: &mut Model, form: &mut Form, through: &Through, done: &mut Eliminated) {
    if through.is_empty() {
        return;
    }
    let one = model.pool.int(1);
    let mut change: Change = Vec::new();
    for (c, e, factor) in through {
        change.push((*c, vec![(*c, one), (*e, model.pool.neg(*factor))]));
    }
    // The multipliers of those that others follow are theirs and parts of the others' outputs.
    let mut followed: Vec<ColumnId> = through.iter().map(|t| t.1).collect();
    followed.sort_unstable();
    followed.dedup();
    let own = followed.iter().filter(|e| through.iter().all(|t| t.0 != **e));
    change.extend(own.map(|e| (*e, vec![(*e, one)])));
    change::transform(&mut model.pool, form, &change);
    for e in &followed {
        let old = form.column(*e).out;
        let new = model.pool.symbol(&format!("{}'", model.pool.name(old)));
        form.columns[e.at()].out = new;
        form.column_of.insert(new, *e);
    }
    for e in &followed {
        let mut terms = vec![model.pool.var(form.column(*e).out)];
        for (c, _, factor) in through.iter().filter(|t| t.1 == *e) {
            let out = model.pool.var(form.column(*c).out);
            let part = model.pool.mul(*factor, out);
            terms.push(model.pool.neg(part));
        }
        let sum = model.pool.sum(&terms);
        done.fixed.insert(done.before[e.at()], sum);
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
