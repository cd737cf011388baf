//! Storages in derivative causality, merged into those they depend on: which are tied together, whether that can be
//! taken, and what it does to the Dirac structure.
//!
//! A dependent storage gives d(x_d)/dt, which falls back on the storages that it depends on. Taken out (`merge`), that
//! is a change of coordinates: with rates F = D z of what is left, the new states move by T F and the old outputs are z
//! = T^T z', z' = dH/dy, so that D' = T D T^T is skew again. (`quadratic`: energies quadratic, ratios that may change
//! with other states; `curved`: the energies of the independent ones are any, ratios constant.)

use super::tied::{self, Tied};
use super::{ColumnId, Form, Role, curved, quadratic};
use crate::causality::Causality;
use crate::expression::{Expr, Symbol};
use crate::graph::RegionId;
use crate::model::{ElementId, Law, Model, Storage};
use bond_grammar::diagnostic::Diagnostic;
use rustc_hash::FxHashMap;

/// Storages that became one.
pub(super) struct Merged {
    pub(super) region: RegionId,
    pub(super) columns: Vec<ColumnId>,
    pub(super) energy: Expr,
    pub(super) coenergy: Vec<Expr>,
    pub(super) bounded: bool,
    /// Each dependent storage with its state, and what it is merged into.
    pub(super) dependent: Vec<(ElementId, Expr)>,
    pub(super) into: Vec<ColumnId>,
}

/// A dependent storage that follows sources: its column stays, as a load of theirs.
pub(super) struct Following {
    pub(super) column: ColumnId,
    /// Its state in terms of the new states and time.
    pub(super) state: Expr,
    /// d/dt of that, in terms of outputs too.
    pub(super) rate: Expr,
}

/// What the elimination leaves.
#[derive(Default)]
pub(super) struct Eliminated {
    pub(super) groups: Vec<Merged>,
    /// New state symbol and initial value of the independent ones, and whether the state's unit is the storage's.
    pub(super) states: FxHashMap<ColumnId, (Symbol, f64, bool)>,
    /// Old states and outputs of merged storages, in terms of what is left.
    pub(super) fixed: FxHashMap<Symbol, Expr>,
    /// The outputs of all columns before the change of coordinates.
    pub(super) before: Vec<Symbol>,
    pub(super) following: Vec<Following>,
    /// See [`Form::divided`].
    pub(super) divided: bool,
    /// See [`Form::poles`].
    pub(super) poles: Vec<Expr>,
}

pub(super) fn storage(model: &Model, id: ElementId) -> Option<&Storage> {
    match &model.element(id).law {
        Law::Storage(s) => Some(s),
        Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => None,
    }
}

/// Merges all dependent storages, and takes their columns out of all rows.
pub(super) fn eliminate(
    model: &mut Model,
    causality: &Causality,
    form: &mut Form,
) -> Result<Eliminated, Vec<Diagnostic>> {
    let mut done = Eliminated { before: form.columns.iter().map(|c| c.out).collect(), ..Eliminated::default() };
    if causality.dependent.is_empty() {
        return Ok(done);
    }
    let dependent = ids(form, Role::Dependent);
    let errors: Vec<Diagnostic> = dependent.iter().filter_map(|d| tied::check(model, form, *d)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    let all = tied::gather(model, form, &dependent).map_err(|d| vec![d])?;
    let starts = all.iter().map(|t| start_of(model, form, t)).collect::<Result<Vec<_>, _>>().map_err(|d| vec![d])?;
    strip(form, &dependent);
    for (tied, start) in all.iter().zip(starts) {
        match start {
            Start::Quadratic => quadratic::merge(model, form, tied, &mut done),
            Start::Curved(z) => curved::merge(model, form, tied, &z, &mut done),
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

/// How tied storages are merged; of curved ones, with the co-energy variables that what is stated settles.
enum Start {
    Quadratic,
    Curved(Vec<Option<f64>>),
}

fn start_of(model: &mut Model, form: &Form, tied: &Tied) -> Result<Start, Diagnostic> {
    let is_quadratic = tied.independent.iter().all(|c| stiffness(model, form, *c).is_some());
    Ok(if is_quadratic { Start::Quadratic } else { Start::Curved(curved::start(model, form, tied)?) })
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

pub(super) fn ids(form: &Form, role: Role) -> Vec<ColumnId> {
    (0..form.columns.len() as u32).map(ColumnId).filter(|c| form.column(*c).role == role).collect()
}

/// The columns of the field that a storage is a port of; itself alone where it is none.
pub(super) fn family(model: &Model, form: &Form, id: ColumnId) -> Vec<ColumnId> {
    let Some((f, _)) = model.element(form.column(id).element).field else { return vec![id] };
    model.fields[f].members.iter().filter_map(|m| form.column_of_element[m.at()]).collect()
}

/// The second derivatives of a storage's energy with the states of its family, where they are numbers.
pub(super) fn stiffness(model: &mut Model, form: &Form, id: ColumnId) -> Option<Vec<(ColumnId, Expr)>> {
    let found = storage(model, form.column(id).element)?;
    let coenergy = found.coenergy;
    let mut row = Vec::new();
    if found.massless {
        return Some(row);
    }
    let mut rest = coenergy;
    for c in family(model, form, id) {
        let state = storage(model, form.column(c).element)?.state;
        let (k, other) = model.pool.linear(rest, state)?;
        model.pool.constant(k)?;
        rest = other;
        row.push((c, k));
    }
    // A storage without energy has no stiffness to invert.
    let own = row.iter().find(|t| t.0 == id).map(|t| t.1)?;
    (model.pool.is_zero(rest) && !model.pool.is_zero(own)).then_some(row)
}
