//! Dependent storages (derivative causality) are merged into those they depend on.
//!
//! A dependent storage gives d(x_d)/dt, which falls back on the storages that it depends on. Taken out (`merge`), that
//! is a change of coordinates: with rates F = D z of what is left, the new states move by T F and the old outputs are z
//! = T^T z', z' = dH/dy, so that D' = T D T^T is skew again. `quadratic` takes quadratic energies and ratios that may
//! change with other states; `curved` takes any energy of the independent storages, and constant ratios.

use super::dependence::{self, Dependence};
use super::eliminated::Eliminated;
use super::storage::ids;
use super::{ColumnId, Form, Role, constraint, curved, quadratic};
use crate::causality::{self, Causality};
use crate::model::{ElementId, Model};
use bond_grammar::diagnostic::Diagnostic;
use rustc_hash::FxHashSet;

/// Storages that multipliers are to tie.
#[derive(Default)]
pub(super) struct Tied {
    /// All of them.
    pub(super) storages: Vec<ElementId>,
    /// Those that are held at rest where ratios have just any values. Where these are what the positions of a mechanism
    /// make them, two of its constraints may say the same, and it moves: the start tells ([`constraint::settle`]).
    pub(super) held: Vec<ElementId>,
}

/// Storages that depend on one another and cannot be merged: multipliers are to tie them. `before` were tied already.
///
/// # Errors
/// Storages that nothing can be done for, with the elements.
pub(super) fn tied(model: &mut Model, form: &Form, before: &FxHashSet<ElementId>) -> Result<Tied, Vec<Diagnostic>> {
    let moves = causality::moves(model);
    let may_move = |d: &ColumnId| {
        let column = form.column(*d);
        moves && column.row.is_empty() && !before.contains(&column.element)
    };
    let (held, dependent): (Vec<ColumnId>, Vec<ColumnId>) = ids(form, Role::Dependent).into_iter().partition(may_move);
    let errors: Vec<Diagnostic> = dependent.iter().filter_map(|d| dependence::check(model, form, *d)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    let held: Vec<ElementId> = held.into_iter().map(|d| form.column(d).element).collect();
    let mut tied = held.clone();
    for set in dependence::all(model, form, &dependent) {
        if !set.is_merged(model, form) {
            let again = set.dependent.iter().map(|d| form.column(*d).element).find(|id| before.contains(id));
            if let Some(id) = again {
                let e = model.element(id);
                let what = format!("`{}` cannot keep its state, and depends on others as no model has it", e.name);
                let help = "take the strokes about it away, or put some resistance between it and what it depends on";
                return Err(vec![Diagnostic::error("structure::rate", e.span, what).help(help)]);
            }
            tied.extend(set.independent.iter().chain(&set.dependent).map(|c| form.column(*c).element));
        }
    }
    Ok(Tied { storages: tied, held })
}

/// Merges all dependent storages, and takes their columns out of all rows. What multipliers tie starts where that
/// agrees.
pub(super) fn eliminate(
    model: &mut Model,
    causality: &Causality,
    form: &mut Form,
    held: &[ElementId],
) -> Result<Eliminated, Vec<Diagnostic>> {
    let mut done = Eliminated { before: form.columns.iter().map(|c| c.out).collect(), ..Eliminated::default() };
    let dependent = ids(form, Role::Dependent);
    let all = dependence::all(model, form, &dependent);
    let is_merged = |c: &ColumnId| all.iter().any(|set| set.independent.contains(c));
    for c in ids(form, Role::Storage) {
        // A speed without inertia is what its neighbours let it be: no effort is left at it.
        if model.element(form.column(c).element).is_massless() && !is_merged(&c) {
            form.columns[c.at()].role = Role::Constraint;
        }
    }
    constraint::settle(model, form, held, &mut done)?;
    if causality.dependent.is_empty() {
        return Ok(done);
    }
    let starts = all.iter().map(|t| start_of(model, form, t)).collect::<Result<Vec<_>, _>>().map_err(|d| vec![d])?;
    strip(form, &dependent);
    for (dependence, start) in all.iter().zip(starts) {
        match start {
            Start::Quadratic => quadratic::merge(model, form, dependence, &mut done),
            Start::Curved(z) => curved::merge(model, form, dependence, &z, &mut done),
        }
        .map_err(|d| vec![d])?;
    }
    // Ratios elsewhere may read what is merged, and that other merged storages.
    let fixed = &done.fixed;
    let entries = form.columns.iter_mut().flat_map(|c| c.row.iter_mut().map(|t| &mut t.1));
    for k in entries.chain(form.loops.iter_mut().map(|l| &mut l.value)) {
        // Each round takes one layer of merged storages away.
        for _ in 0..=all.len() {
            if !model.pool.contains_any(*k, &|s| fixed.contains_key(&s)) {
                break;
            }
            *k = model.pool.substitute(*k, fixed);
        }
    }
    Ok(done)
}

/// How storages are merged; of curved ones, with the co-energy variables that the stated starts settle.
enum Start {
    Quadratic,
    Curved(Vec<Option<f64>>),
}

fn start_of(model: &mut Model, form: &Form, dependence: &Dependence) -> Result<Start, Diagnostic> {
    Ok(if dependence.is_quadratic(model, form) {
        Start::Quadratic
    } else {
        Start::Curved(curved::start(model, form, dependence)?)
    })
}

/// Takes the dependent columns out of all rows but those of the sources that they follow.
fn strip(form: &mut Form, dependent: &[ColumnId]) {
    let is_source: Vec<bool> = form.columns.iter().map(|c| matches!(c.role, Role::Source(_))).collect();
    let mut is_dependent = vec![false; form.columns.len()];
    dependent.iter().for_each(|d| is_dependent[d.at()] = true);
    for (i, c) in form.columns.iter_mut().enumerate() {
        if is_dependent[i] {
            c.row.retain(|(j, _)| is_source[j.at()]);
        } else if !is_source[i] {
            c.row.retain(|(j, _)| !is_dependent[j.at()]);
        }
    }
}
