//! Tied storages of which the independent ones have any energy; the dependent ones are quadratic, the ratios A
//! constant.
//!
//! With z(x) the co-energy variables of the independent ones, a dependent one has the state x_d = L A z(x), so that
//! (1 + A^T L A dz/dx) dx/dt = F. The states stay; H(x) = H_i(x) + z^T A^T L A z / 2 is the energy of all, and since
//! dz/dx is symmetric dH/dx = N^T z with N = 1 + A^T L A dz/dx: a change of coordinates by N^-1.

use super::change::{self, Change};
use super::dependent::{Eliminated, Merged, family, stiffness, storage};
use super::quadratic::LARGEST;
use super::start::{self, Stated, at_start};
use super::tied::{Tied, refused};
use super::{ColumnId, Form, inverse};
use crate::expression::{Expr, Symbol};
use crate::model::{Model, Storage};
use bond_grammar::diagnostic::Diagnostic;

/// Merges them.
pub(super) fn merge(
    model: &mut Model,
    form: &mut Form,
    tied: &Tied,
    start: &[Option<f64>],
    done: &mut Eliminated,
) -> Result<(), Diagnostic> {
    let (independent, n) = (&tied.independent, tied.independent.len());
    let refuse = |model: &Model, form: &Form, why: String| refused(model, form, tied.dependent[0], &why, None);
    if n > LARGEST {
        return Err(refuse(
            model,
            form,
            format!("it depends on {n} storages with energies that are not quadratic among them, more than {LARGEST}"),
        ));
    }
    let curved = independent.iter().find(|c| stiffness(model, form, **c).is_none()).copied();
    let curved = curved.map(|c| form.column(c).name.clone()).unwrap_or_default();
    if !tied.others.is_empty() {
        let why =
            format!("it depends on `{curved}`, whose energy is not quadratic, by a ratio that changes with the state");
        return Err(refuse(model, form, why));
    }
    if tied.sources.iter().any(|s| !s.is_empty()) {
        let why = format!("it follows a source and `{curved}`, whose energy is not quadratic");
        return Err(refuse(model, form, why));
    }
    if tied.dependent.iter().any(|d| family(model, form, *d).len() > 1) {
        return Err(refuse(
            model,
            form,
            format!("it is a port of a field, and `{curved}` has an energy that is not quadratic"),
        ));
    }
    let storages: Vec<Storage> =
        independent.iter().filter_map(|c| storage(model, form.column(*c).element).cloned()).collect();
    let states: Vec<Symbol> = storages.iter().map(|s| s.state).collect();
    let z: Vec<Expr> = storages.iter().map(|s| s.coenergy).collect();
    let mut softness: Vec<Expr> = Vec::new();
    for d in &tied.dependent {
        let k = stiffness(model, form, *d).and_then(|row| row.first().map(|t| t.1));
        let one = model.pool.int(1);
        softness.push(k.map_or(one, |k| model.pool.div(one, k)));
    }
    let pool = &mut model.pool;
    let (zero, one) = (pool.int(0), pool.int(1));
    // A z, L A z of each dependent one
    let seen: Vec<Expr> = tied
        .ratio
        .iter()
        .map(|row| {
            let terms: Vec<Expr> = row.iter().zip(&z).map(|(a, z)| pool.mul(*a, *z)).collect();
            pool.sum(&terms)
        })
        .collect();
    let own: Vec<Expr> = seen.iter().zip(&softness).map(|(e, l)| pool.mul(*e, *l)).collect();
    // N = 1 + A^T d(x_d)/dx
    let mut matrix = vec![vec![zero; n]; n];
    for (j, s) in states.iter().enumerate() {
        let slopes: Vec<Expr> = own.iter().map(|x| pool.derivative(*x, *s)).collect();
        for (i, row) in matrix.iter_mut().enumerate() {
            let mut terms: Vec<Expr> = tied.ratio.iter().zip(&slopes).map(|(r, k)| pool.mul(r[i], *k)).collect();
            if i == j {
                terms.push(one);
            }
            row[j] = pool.sum(&terms);
        }
    }
    let Some(back) = inverse(pool, &matrix) else {
        return Err(refuse(model, form, "the storages have no common state".to_string()));
    };
    let change: Change = independent
        .iter()
        .enumerate()
        .map(|(i, c)| {
            let terms = independent.iter().enumerate().map(|(j, b)| (*b, back[i][j]));
            (*c, terms.filter(|t| !model.pool.is_zero(t.1)).collect())
        })
        .collect();
    change::transform(&mut model.pool, form, &change);
    let outs: Vec<Symbol> = independent
        .iter()
        .map(|c| {
            let name = format!("{}'", model.pool.name(form.column(*c).out));
            model.pool.symbol(&name)
        })
        .collect();
    for (j, c) in independent.iter().enumerate() {
        let old = form.column(*c).out;
        let terms: Vec<Expr> = (0..n)
            .map(|i| {
                let new = model.pool.var(outs[i]);
                model.pool.mul(back[i][j], new)
            })
            .collect();
        let sum = model.pool.sum(&terms);
        done.fixed.insert(old, sum);
        form.columns[c.at()].out = outs[j];
        form.column_of.insert(outs[j], *c);
    }
    // The energies of the families, each once.
    let mut terms: Vec<Expr> = Vec::new();
    let mut counted: Vec<ColumnId> = Vec::new();
    let mut bounded = true;
    for (c, s) in independent.iter().zip(&storages) {
        if !counted.contains(c) {
            counted.extend(family(model, form, *c));
            terms.push(s.energy);
            bounded &= s.bounded;
        }
    }
    let half = model.pool.ratio(1, 2);
    for (e, x) in seen.iter().zip(&own) {
        terms.push(model.pool.product(&[half, *e, *x]));
    }
    let energy = model.pool.sum(&terms);
    let coenergy: Vec<Expr> = states.iter().map(|s| model.pool.derivative(energy, *s)).collect();
    for (i, c) in independent.iter().enumerate() {
        let initial = settle(model, form, &storages[i], start[i]).ok_or_else(|| {
            let why = format!("no state of `{}` was found that goes with the stated start", form.column(*c).name);
            refuse(model, form, why)
        })?;
        done.states.insert(*c, (states[i], initial, true));
    }
    let moving: Vec<(ColumnId, Symbol)> = independent.iter().copied().zip(states.iter().copied()).collect();
    let mut list = Vec::new();
    for (d, x) in tied.dependent.iter().zip(&own) {
        let column = form.column(*d).clone();
        let rate = change::rate(model, form, *x, &moving);
        done.fixed.insert(column.out, rate);
        if let Some(s) = storage(model, column.element) {
            done.fixed.insert(s.state, *x);
        }
        list.push((column.element, *x));
    }
    let region = form.column(independent[0]).region;
    done.groups.push(Merged {
        region,
        columns: independent.clone(),
        energy,
        coenergy,
        bounded,
        dependent: list,
        into: independent.clone(),
    });
    Ok(())
}

/// The co-energy variables that what is stated settles. Of the ports of a field one may be settled by what is tied to
/// it; else they start where they say, or at 0.
///
/// # Errors
/// A clash, with the elements.
pub(super) fn start(model: &Model, form: &Form, tied: &Tied) -> Result<Vec<Option<f64>>, Diagnostic> {
    let n = tied.independent.len();
    let mut stated: Vec<Stated> = Vec::new();
    let mut otherwise = vec![0.0; n];
    let explicit = |c: ColumnId| storage(model, form.column(c).element).is_some_and(|s| s.explicit);
    let is_open: Vec<bool> = (0..n)
        .map(|i| {
            let told = |d: usize| explicit(tied.dependent[d]) && !model.pool.is_zero(tied.ratio[d][i]);
            !explicit(tied.independent[i]) && (0..tied.dependent.len()).any(told)
        })
        .collect();
    for (i, c) in tied.independent.iter().enumerate() {
        let Some(s) = storage(model, form.column(*c).element) else { continue };
        otherwise[i] = at_start(model, form, s.coenergy);
        let family = family(model, form, *c);
        let open = (0..n).filter(|j| is_open[*j] && family.contains(&tied.independent[*j])).count();
        if s.explicit || (family.len() > 1 && open > 1) {
            let row = (0..n).map(|j| f64::from(u8::from(i == j))).collect();
            stated.push(Stated { column: *c, row, value: otherwise[i], driven: 0.0 });
        }
    }
    for (d, c) in tied.dependent.iter().enumerate() {
        let Some(s) = storage(model, form.column(*c).element).filter(|s| s.explicit) else { continue };
        let row = tied.ratio[d].iter().map(|k| at_start(model, form, *k)).collect();
        let driven = start::driven(model, form, &tied.sources[d]);
        stated.push(Stated { column: *c, row, value: at_start(model, form, s.coenergy) - driven, driven });
    }
    start::solve(model, form, tied, &stated, &otherwise)
}

/// The initial state: what is stated, or where the co-energy variable is what a dependent storage's start asks for.
fn settle(model: &mut Model, form: &Form, s: &Storage, z: Option<f64>) -> Option<f64> {
    let Some(z) = z.filter(|_| !s.explicit) else { return Some(s.initial) };
    let at = |v: Symbol| start::value(model, form, v);
    let known: Vec<(Symbol, f64)> = model.pool.symbols(s.coenergy).into_iter().map(|v| (v, at(v))).collect();
    let goal = model.pool.float(z);
    let off = model.pool.sub(s.coenergy, goal);
    model.pool.root(off, s.state, s.initial, &|v| known.iter().find(|k| k.0 == v).map_or(f64::NAN, |k| k.1))
}
