//! Where storages that depend on one another start: what is stated of them must agree.

use super::dependence::Dependence;
use super::storage::storage;
use super::{ColumnId, Form, OPTIONS, Role};
use crate::expression::{Expr, Symbol};
use crate::model::{ElementId, Kind, Model, Signal, Storage, Variable};
use bond_grammar::diagnostic::Diagnostic;
use nalgebra::{DMatrix, DVector};

/// What is stated of a storage: a combination of the unknowns has a value.
pub(super) struct Stated {
    pub(super) column: ColumnId,
    pub(super) row: Vec<f64>,
    /// That value, less what sources give.
    pub(super) value: f64,
    /// What they give.
    pub(super) driven: f64,
}

/// The value of an expression of states and time at the start.
pub(super) fn at_start(model: &Model, form: &Form, e: Expr) -> f64 {
    model.pool.eval(e, &|s| value(model, form, s))
}

/// The value of a signal at the start.
pub(super) fn value(model: &Model, form: &Form, s: Symbol) -> f64 {
    match model.signals.get(&s) {
        Some(Signal::State(id)) => storage(model, *id).map_or(f64::NAN, |x| x.initial),
        Some(Signal::Time | Signal::Slope(_)) => 0.0,
        Some(Signal::Integral(i)) => model.integrals[*i].start,
        Some(Signal::Input(i)) => model.inputs[*i].value,
        Some(Signal::Memory(i)) => model.memories[*i].start,
        Some(Signal::Delay(i)) => model.delays[*i].start,
        Some(Signal::Effort(_) | Signal::Flow(_) | Signal::Argument(_) | Signal::Parameter(_)) | None => {
            form.column_of.get(&s).map_or(f64::NAN, |c| given(model, form, *c))
        }
    }
}

/// What a column gives at the start: a source its value, a storage its co-energy variable; 0 of what is not known yet.
pub(super) fn given(model: &Model, form: &Form, c: ColumnId) -> f64 {
    let column = form.column(c);
    match column.role {
        Role::Source(v) => at_start(model, form, v),
        Role::Storage => storage(model, column.element).map_or(0.0, |s| at_start(model, form, s.coenergy)),
        Role::Bar | Role::Open(_) | Role::Resistor | Role::Dependent | Role::Constraint => 0.0,
    }
}

/// What sources give at the start, times a dependent storage's coefficients.
pub(super) fn driven(model: &Model, form: &Form, sources: &[(ColumnId, Expr)]) -> f64 {
    sources.iter().map(|(c, b)| at_start(model, form, *b) * given(model, form, *c)).sum()
}

/// The unknowns that what is stated settles, the first statements first; the rest are `None`, and count as `otherwise`.
///
/// # Errors
/// A clash, with the elements.
pub(super) fn solve(
    model: &Model,
    form: &Form,
    set: &Dependence,
    stated: &[Stated],
    otherwise: &[f64],
) -> Result<Vec<Option<f64>>, Diagnostic> {
    let n = otherwise.len();
    let mut w: Vec<Option<f64>> = vec![None; n];
    let product = |a: f64, x: f64| if a == 0.0 { 0.0 } else { a * x };
    loop {
        let mut settled = false;
        for s in stated {
            let free: Vec<usize> = (0..n).filter(|i| w[*i].is_none() && s.row[*i] != 0.0).collect();
            if let [one] = free[..] {
                let known: f64 = (0..n).filter_map(|i| Some(product(s.row[i], w[i]?))).sum();
                w[one] = Some((s.value - known) / s.row[one]);
                settled = true;
            }
        }
        if !settled {
            break;
        }
    }
    // Several unknowns at once: the least that fits.
    let free: Vec<usize> = (0..n).filter(|i| w[*i].is_none()).collect();
    let undetermined: Vec<&Stated> = stated.iter().filter(|s| free.iter().any(|i| s.row[*i] != 0.0)).collect();
    if !undetermined.is_empty() {
        let a = DMatrix::from_fn(undetermined.len(), free.len(), |r, c| undetermined[r].row[free[c]]);
        let b = DVector::from_fn(undetermined.len(), |r, _| {
            undetermined[r].value - (0..n).filter_map(|i| Some(product(undetermined[r].row[i], w[i]?))).sum::<f64>()
        });
        if a.iter().chain(b.iter()).all(|x| x.is_finite())
            && let Ok(x) = a.svd(true, true).solve(&b, 1e-12)
        {
            for (i, x) in free.iter().zip(x.iter()) {
                w[*i] = Some(*x);
            }
        }
    }
    let all: Vec<f64> = w.iter().zip(otherwise).map(|(w, o)| w.unwrap_or(*o)).collect();
    for s in stated {
        let terms: Vec<f64> = s.row.iter().zip(&all).map(|(a, x)| product(*a, *x)).collect();
        let follows: f64 = terms.iter().sum();
        let size = terms.iter().map(|x| x.abs()).fold(s.value.abs(), f64::max);
        if (follows - s.value).abs() > OPTIONS.rounding * size {
            return Err(clash(model, form, set, s, follows));
        }
    }
    Ok(w)
}

/// A stated start that the others do not allow.
fn clash(model: &Model, form: &Form, set: &Dependence, s: &Stated, follows: f64) -> Diagnostic {
    let follows = follows + s.driven;
    let column = form.column(s.column);
    let ties: Vec<ColumnId> = match set.dependent.iter().position(|d| *d == s.column) {
        Some(d) => (0..set.independent.len())
            .filter(|i| !model.pool.is_zero(set.ratio[d][*i]))
            .map(|i| set.independent[i])
            .chain(set.sources[d].iter().map(|t| t.0))
            .collect(),
        None => set.independent.iter().chain(&set.dependent).copied().filter(|c| *c != s.column).collect(),
    };
    let variable = if model.element(column.element).kind == Kind::C { Variable::Effort } else { Variable::Flow };
    let told = |x: f64| model.quantity(column.bond, variable, x);
    let message = format!(
        "inconsistent start: `{}` is tied to {}, which gives it {} where {} is stated",
        model.element(column.element).name,
        ties.iter().map(|c| format!("`{}`", form.column(*c).name)).collect::<Vec<_>>().join(", "),
        told(follows),
        told(s.value + s.driven)
    );
    let others: Vec<ElementId> = ties.iter().map(|c| form.column(*c).element).collect();
    let error = model.error_of("structure::initial", message, (column.element, &others), "is what it is tied to");
    error.help("state the start of one of them and leave the others out")
}

/// The initial state of a storage: what is stated, or where its co-energy variable is what the storages that it is tied
/// to ask for.
///
/// # Errors
/// Where no state was found that has it, with the elements.
pub(super) fn settled(
    model: &mut Model,
    form: &Form,
    others: &[ColumnId],
    (c, s): (ColumnId, &Storage),
    z: Option<f64>,
) -> Result<f64, Diagnostic> {
    let Some(z) = z.filter(|_| !s.explicit) else { return Ok(s.initial) };
    let known: Vec<(Symbol, f64)> =
        model.pool.symbols(s.coenergy).into_iter().map(|v| (v, value(model, form, v))).collect();
    let goal = model.pool.float(z);
    let off = model.pool.sub(s.coenergy, goal);
    let at = |v: Symbol| known.iter().find(|k| k.0 == v).map_or(f64::NAN, |k| k.1);
    model.pool.root(off, s.state, s.initial, &at).ok_or_else(|| {
        let e = model.element(form.column(c).element);
        let what = format!("no state of `{}` was found that goes with the start of what it is tied to", e.name);
        let mut error = Diagnostic::error("structure::initial", e.span, what);
        for other in others.iter().filter(|other| **other != c) {
            error = error.label(model.element(form.column(*other).element).span, "is tied to it");
        }
        error.help("state the start of one of them, where its energy has a slope")
    })
}
