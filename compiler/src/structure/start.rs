//! Where storages that are tied together start: what is stated of them must agree.

use super::dependent::{Tied, stiffness, storage};
use super::{ColumnId, Form, Role};
use crate::expression::{Expr, Symbol};
use crate::model::{Model, Signal};
use bond_grammar::diagnostic::Diagnostic;
use nalgebra::{DMatrix, DVector};

/// Two stated values are the same up to this part of them.
const SAME: f64 = 1e-9;

/// The value of an expression of states and time at the start.
pub(super) fn at_start(model: &Model, form: &Form, e: Expr) -> f64 {
    model.pool.eval(e, &|s: Symbol| match model.signals.get(&s) {
        Some(Signal::State(id)) => storage(model, *id).map_or(f64::NAN, |x| x.initial),
        Some(Signal::Time | Signal::Slope(_)) => 0.0,
        Some(Signal::Input(i)) => model.inputs.get(*i).map_or(f64::NAN, |i| i.value),
        Some(Signal::Memory(i)) => model.memories.get(*i).map_or(f64::NAN, |m| m.start),
        Some(
            Signal::Effort(_) | Signal::Flow(_) | Signal::Integral(_) | Signal::Argument(_) | Signal::Parameter(_),
        )
        | None => form.column_of.get(&s).map_or(f64::NAN, |_| 0.0),
    })
}

/// Co-energy variables of the independent storages at the start: those stated count, those of dependent ones settle what is left.
///
/// # Errors
/// A clash, with the elements.
pub(super) fn initial(model: &mut Model, form: &Form, tied: &Tied) -> Result<Vec<f64>, Vec<Diagnostic>> {
    let mut told = |c: &ColumnId| -> Option<f64> {
        let s = storage(model, form.column(*c).element)?;
        if !s.explicit {
            return None;
        }
        let coenergy = s.coenergy;
        let _ = stiffness(model, form, *c);
        Some(at_start(model, form, coenergy))
    };
    let mut z: Vec<Option<f64>> = tied.independent.iter().map(&mut told).collect();
    let stated: Vec<(usize, f64)> =
        tied.dependent.iter().enumerate().filter_map(|(i, d)| Some((i, told(d)?))).collect();
    let model = &*model;
    let k = |d: usize, i: usize| at_start(model, form, tied.ratio[d][i]);
    // What the sources give.
    let given = |d: usize| -> f64 {
        let value = |c: ColumnId| match form.column(c).role {
            Role::Source(v) => at_start(model, form, v),
            Role::Bar | Role::Open(_) | Role::Storage | Role::Resistor | Role::Dependent => 0.0,
        };
        tied.sources[d].iter().map(|(c, b)| at_start(model, form, *b) * value(*c)).sum()
    };
    loop {
        let mut settled = false;
        for (d, value) in &stated {
            let free: Vec<usize> = (0..z.len()).filter(|i| z[*i].is_none() && k(*d, *i) != 0.0).collect();
            if let [one] = free[..] {
                let known: f64 = (0..z.len()).filter_map(|i| z[i].filter(|x| *x != 0.0).map(|x| k(*d, i) * x)).sum();
                z[one] = Some((value - known - given(*d)) / k(*d, one));
                settled = true;
            }
        }
        if !settled {
            break;
        }
    }
    // Several unknowns at once: the least that fits.
    let free: Vec<usize> = (0..z.len()).filter(|i| z[*i].is_none()).collect();
    let rows: Vec<&(usize, f64)> = stated.iter().filter(|(d, _)| free.iter().any(|i| k(*d, *i) != 0.0)).collect();
    if !rows.is_empty() {
        let a = DMatrix::from_fn(rows.len(), free.len(), |r, c| k(rows[r].0, free[c]));
        let b = DVector::from_fn(rows.len(), |r, _| {
            let (d, value) = *rows[r];
            value - given(d) - (0..z.len()).filter_map(|i| Some(k(d, i) * z[i]?)).sum::<f64>()
        });
        if a.iter().chain(b.iter()).all(|x| x.is_finite())
            && let Ok(x) = a.svd(true, true).solve(&b, 1e-12)
        {
            for (i, x) in free.iter().zip(x.iter()) {
                z[*i] = Some(*x);
            }
        }
    }
    let z: Vec<f64> = z.into_iter().map(|z| z.unwrap_or(0.0)).collect();
    for (d, value) in &stated {
        let terms: Vec<f64> = (0..z.len()).filter(|i| z[*i] != 0.0).map(|i| k(*d, i) * z[i]).collect();
        let follows: f64 = terms.iter().sum::<f64>() + given(*d);
        let size = terms.iter().map(|x| x.abs()).fold(value.abs().max(given(*d).abs()), f64::max);
        if (follows - value).abs() <= SAME * size {
            continue;
        }
        let e = model.element(form.column(tied.dependent[*d]).element);
        let ties: Vec<ColumnId> = (0..z.len())
            .filter(|i| !model.pool.is_zero(tied.ratio[*d][*i]))
            .map(|i| tied.independent[i])
            .chain(tied.sources[*d].iter().map(|t| t.0))
            .collect();
        let mut error = Diagnostic::error(
            "structure::initial",
            e.span,
            format!(
                "inconsistent start: `{}` is tied to {}, which gives it {follows} where {value} is stated",
                e.name,
                ties.iter().map(|c| format!("`{}`", form.column(*c).name)).collect::<Vec<_>>().join(", ")
            ),
        );
        for c in &ties {
            error = error.label(model.element(form.column(*c).element).span, "is what it is tied to");
        }
        return Err(vec![error.help("state the start of one of them and leave the others out")]);
    }
    Ok(z)
}
