//! Constraints: storages that depend on one another, or on sources, and are not merged.
//!
//! Each keeps its own state and energy. A multiplier, put where causality would have them depend on one another, is a
//! column of its own: its output lambda is an effort or a flow at a junction, its input c what that junction sums, and
//!
//! ```text
//! c = sum of k z + b u = 0,     dx/dt = F - k lambda
//! ```
//!
//! with z the co-energy variables of storages near by, and u what sources give. D is skew, so a multiplier does no
//! work: lambda c = 0. Any energies and any ratios can stand there, since nothing is inverted.

use super::eliminated::Eliminated;
use super::start::{self, at_start};
use super::storage::storage;
use super::{ColumnId, Form, OPTIONS, Role, dependence};
use crate::causality::Echelon;
use crate::graph::RegionId;
use crate::model::{ElementId, Law, Model};
use bond_grammar::diagnostic::Diagnostic;
use nalgebra::{DMatrix, DVector};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::BTreeSet;

/// A constraint at the start, in what is not stated.
struct Equation {
    multiplier: ColumnId,
    /// The unknowns, with their coefficients.
    row: Vec<(ColumnId, f64)>,
    /// What these must come to.
    value: f64,
    /// The sum of what that is made of, in size.
    size: f64,
}

/// Finds where tied storages start: what is stated of them holds, and of what then fulfils the constraints, that with
/// the least energy. So does what is set in motion from rest (Kelvin's theorem).
///
/// # Errors
/// A constraint that cannot hold, and stated starts that do not agree, with the elements.
pub(super) fn settle(
    model: &mut Model,
    form: &mut Form,
    held: &[ElementId],
    done: &mut Eliminated,
) -> Result<(), Vec<Diagnostic>> {
    let multipliers: Vec<ColumnId> = (0..form.columns.len() as u32)
        .map(ColumnId)
        .filter(|c| matches!(model.element(form.column(*c).element).law, Law::Multiplier))
        .collect();
    let errors: Vec<Diagnostic> = multipliers.iter().filter_map(|c| check(model, form, *c)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    let rank = Rank::of(model, form, &multipliers);
    let errors = rank.held(model, form, held);
    if !errors.is_empty() {
        return Err(errors);
    }
    form.redundant.extend(rank.redundant);
    let form = &*form;
    let mut equations = Vec::new();
    for &multiplier in &multipliers {
        let mut e = Equation { multiplier, row: Vec::new(), value: 0.0, size: 0.0 };
        for &(c, k) in &form.column(multiplier).row {
            let k = at_start(model, form, k);
            if k != 0.0 && is_unknown(model, form, c) {
                e.row.push((c, k));
            } else if k != 0.0 {
                let part = k * start::given(model, form, c);
                (e.value, e.size) = (e.value - part, e.size + part.abs());
            }
        }
        // What a signal of the run decides is found by the first step.
        if e.value.is_finite() && e.row.iter().all(|(_, k)| k.is_finite()) {
            equations.push(e);
        }
    }
    let found = solve(model, form, &equations);
    for e in &equations {
        let parts: Vec<f64> = e.row.iter().map(|(c, k)| k * found.get(c).copied().unwrap_or(0.0)).collect();
        let size = parts.iter().fold(e.size, |sum, x| sum + x.abs());
        let off = parts.iter().sum::<f64>() - e.value;
        if off.abs() > OPTIONS.rounding * size {
            return Err(vec![clash(model, form, e.multiplier, off)]);
        }
    }
    let mut unknowns: Vec<(ColumnId, f64)> = found.into_iter().collect();
    unknowns.sort_unstable_by_key(|t| t.0);
    for (c, z) in unknowns {
        let Some(s) = storage(model, form.column(c).element).filter(|s| !s.massless).cloned() else { continue };
        let others: Vec<ColumnId> = form.column(c).row.iter().map(|t| t.0).collect();
        let start = start::settled(model, form, &others, (c, &s), Some(z)).map_err(|d| vec![d])?;
        done.states.insert(c, (s.state, start, true));
    }
    Ok(())
}

/// What the constraints leave free where the run starts.
struct Rank {
    rows: Echelon,
    /// By which each column is counted, so that motions of one energy have one size.
    size: FxHashMap<ColumnId, f64>,
    /// Regions with constraints that follow from the others.
    redundant: FxHashSet<RegionId>,
}

impl Rank {
    fn of(model: &mut Model, form: &Form, multipliers: &[ColumnId]) -> Self {
        let mut found = Self { rows: Echelon::default(), size: FxHashMap::default(), redundant: FxHashSet::default() };
        for &multiplier in multipliers {
            let mut row = Vec::new();
            for &(c, k) in &form.column(multiplier).row {
                let size = *found.size.entry(c).or_insert_with(|| 1.0 / inertia(model, form, c).unwrap_or(1.0).sqrt());
                row.push((c.at(), at_start(model, form, k) * size));
            }
            // What a signal of the run decides is found by the first step.
            if row.iter().all(|(_, k)| k.is_finite()) && !found.rows.take(&row) {
                found.redundant.insert(form.column(multiplier).region);
            }
        }
        found
    }

    /// These storages, where the constraints let none of them have a speed. In a mechanism that moves some may be at
    /// rest, as a coupler of parallel cranks that does not turn.
    fn held(&self, model: &Model, form: &Form, storages: &[ElementId]) -> Vec<Diagnostic> {
        let columns: Vec<ColumnId> = storages.iter().filter_map(|id| form.column_of_element[id.at()]).collect();
        let moves = columns.iter().any(|c| !self.rows.follows(&[(c.at(), 1.0)]));
        let held = columns.into_iter().filter(|_| !moves);
        held.map(|c| dependence::held(model, form.column(c))).collect()
    }
}

/// Whether a column is a storage, or a speed without inertia, whose start is not stated.
fn is_unknown(model: &Model, form: &Form, c: ColumnId) -> bool {
    let column = form.column(c);
    match column.role {
        Role::Storage => storage(model, column.element).is_some_and(|s| !s.explicit),
        Role::Constraint => true,
        Role::Source(_) | Role::Bar | Role::Open(_) | Role::Resistor | Role::Dependent => false,
    }
}

/// Solves the equations: what stands alone in one is told by it; of the rest, the least energy.
fn solve(model: &mut Model, form: &Form, equations: &[Equation]) -> FxHashMap<ColumnId, f64> {
    let mut found: FxHashMap<ColumnId, f64> = FxHashMap::default();
    let mut of: FxHashMap<ColumnId, Vec<usize>> = FxHashMap::default();
    for (i, e) in equations.iter().enumerate() {
        e.row.iter().for_each(|(c, _)| of.entry(*c).or_default().push(i));
    }
    // The unknowns of an equation that are left, without those whose coefficients are rounding, and its value.
    let left = |e: &Equation, found: &FxHashMap<ColumnId, f64>| {
        let most = e.row.iter().fold(0.0f64, |most, (_, k)| most.max(k.abs()));
        let (known, unknown): (Vec<_>, Vec<_>) = e.row.iter().partition(|(c, _)| found.contains_key(c));
        let value = known.iter().fold(e.value, |value, (c, k)| value - k * found[c]);
        let unknown: Vec<(ColumnId, f64)> =
            unknown.into_iter().filter(|(_, k)| k.abs() > OPTIONS.rounding * most).collect();
        (unknown, value)
    };
    let mut due: BTreeSet<usize> = (0..equations.len()).collect();
    while let Some(i) = due.pop_first() {
        let (unknown, value) = left(&equations[i], &found);
        if let [(c, k)] = unknown[..] {
            found.insert(c, value / k);
            due.extend(&of[&c]);
        }
    }
    let rest: Vec<(Vec<(ColumnId, f64)>, f64)> =
        equations.iter().map(|e| left(e, &found)).filter(|(row, _)| !row.is_empty()).collect();
    let all: BTreeSet<ColumnId> = rest.iter().flat_map(|(row, _)| row.iter().map(|t| t.0)).collect();
    let place: FxHashMap<ColumnId, usize> = all.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    if rest.iter().all(|(_, value)| *value == 0.0) {
        found.extend(all.into_iter().map(|c| (c, 0.0)));
        return found;
    }
    // In the units in which the energy is half the sum of squares.
    let inertia: Vec<Option<f64>> = all.iter().map(|c| inertia(model, form, *c)).collect();
    let mut a = DMatrix::<f64>::zeros(rest.len(), all.len());
    for (i, (row, _)) in rest.iter().enumerate() {
        row.iter().for_each(|(c, k)| a[(i, place[c])] = *k);
    }
    let weigh = |a: &mut DMatrix<f64>, j: usize, m: f64| a.column_mut(j).scale_mut(1.0 / m.sqrt());
    (0..inertia.len()).for_each(|j| _ = inertia[j].map(|m| weigh(&mut a, j, m)));
    let own = |i: usize, a: &DMatrix<f64>| {
        let heavy = (0..inertia.len()).filter(|j| inertia[*j].is_some());
        heavy.map(|j| a[(i, j)].powi(2)).sum::<f64>()
    };
    let compliance: Vec<f64> = (0..rest.len()).map(|i| own(i, &a)).collect();
    // What has no inertia has next to none of that which the constraints give it, so that it takes no part.
    let mut unit: Vec<f64> = inertia.iter().map(|m| m.unwrap_or(0.0).sqrt()).collect();
    for j in (0..inertia.len()).filter(|j| inertia[*j].is_none()) {
        let seen: f64 =
            (0..rest.len()).filter(|i| compliance[*i] > 0.0).map(|i| a[(i, j)].powi(2) / compliance[i]).sum();
        let m = if seen > 0.0 { OPTIONS.rounding * seen } else { 1.0 };
        weigh(&mut a, j, m);
        unit[j] = m.sqrt();
    }
    let values = DVector::from_iterator(rest.len(), rest.iter().map(|(_, value)| *value));
    if let Some(y) = least(&a, &values) {
        found.extend(all.into_iter().zip(&unit).zip(y.iter()).map(|((c, unit), y)| (c, y / unit)));
    }
    found
}

/// The least solution of equations that agree, by a QR decomposition of their transpose with pivots.
fn least(a: &DMatrix<f64>, values: &DVector<f64>) -> Option<DVector<f64>> {
    let (mut a, mut values) = (a.clone(), values.clone());
    for i in 0..a.nrows() {
        let norm = a.row(i).norm();
        if norm > 0.0 {
            a.row_mut(i).unscale_mut(norm);
            values[i] /= norm;
        }
    }
    let qr = a.transpose().col_piv_qr();
    let (q, r) = (qr.q(), qr.r());
    let first = r.get((0, 0)).copied().unwrap_or(0.0).abs();
    let rank = (0..r.nrows().min(r.ncols())).take_while(|i| r[(*i, *i)].abs() > OPTIONS.rounding * first).count();
    let mut sorted = values.transpose();
    qr.p().permute_columns(&mut sorted);
    let upper = r.view((0, 0), (rank, rank)).transpose();
    let y = upper.solve_lower_triangular(&sorted.transpose().rows(0, rank).into_owned())?;
    Some(q.columns(0, rank) * y)
}

/// The inertia of a flow, or the compliance of an effort: d(state)/d(co-energy variable) at the start; none of what has
/// none.
fn inertia(model: &mut Model, form: &Form, c: ColumnId) -> Option<f64> {
    let s = storage(model, form.column(c).element).filter(|s| !s.massless).cloned()?;
    let slope = model.pool.derivative(s.coenergy, s.state);
    let inertia = 1.0 / at_start(model, form, slope);
    Some(if inertia.is_finite() && inertia > 0.0 { inertia } else { 1.0 })
}

/// What stands in a constraint that none can have: what jumps, and laws of resistors.
fn check(model: &Model, form: &Form, multiplier: ColumnId) -> Option<Diagnostic> {
    let column = form.column(multiplier);
    let e = model.element(column.element);
    let tied: Vec<&str> = column
        .row
        .iter()
        .map(|t| form.column(t.0))
        .filter(|c| c.role == Role::Storage)
        .map(|c| c.name.as_str())
        .collect();
    let storages = || tied.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if !column.row.iter().any(|t| matches!(form.column(t.0).role, Role::Storage | Role::Constraint)) {
        let what = format!("what `{}` sums is imposed by sources alone", e.name);
        let help = "take one of them away, or put a resistor or a storage between them";
        return Some(Diagnostic::error("structure::held", e.span, what).help(help));
    }
    let (c, code, how) = column.row.iter().find_map(|t| match form.column(t.0).role {
        Role::Bar | Role::Open(_) => Some((t.0, "structure::jump", "across a double bar or open port, which jumps")),
        Role::Resistor => Some((t.0, "structure::rate", "through a resistor")),
        Role::Storage | Role::Source(_) | Role::Dependent | Role::Constraint => None,
    })?;
    let other = form.column(c);
    let what = format!("at `{}` {} would have to follow `{}` {how}", e.name, storages(), other.name);
    let error =
        Diagnostic::error(code, e.span, what).label(model.element(other.element).span, "is what they would follow");
    Some(error.help("put some resistance between the two, or a storage of the other kind"))
}

/// Stated starts that a constraint does not allow.
fn clash(model: &Model, form: &Form, multiplier: ColumnId, off: f64) -> Diagnostic {
    let column = form.column(multiplier);
    let e = model.element(column.element);
    let all = || column.row.iter().map(|t| form.column(t.0)).filter(|c| !model.element(c.element).is_massless());
    let names: Vec<String> = all().map(|c| format!("`{}`", c.name)).collect();
    let what = format!(
        "inconsistent start: {} are tied at `{}`, and what is stated of them is off by {}",
        names.join(", "),
        e.name,
        model.quantity(column.bond, column.gives.other(), off.abs())
    );
    let others: Vec<ElementId> = all().map(|c| c.element).collect();
    let error = model.error_of("structure::initial", what, (column.element, &others), "is what it ties");
    error.help(
        "state the start of one of them and leave the others out, or state starts that fit; what a part's own parameter \
         gives is stated, too",
    )
}
