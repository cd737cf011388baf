//! Dependent storages with quadratic energies, of independent ones with any energy, by constant ratios A.
//!
//! With z(x) the co-energy variables of the independent ones, a dependent one has the state x_d = L A z(x), so that
//! (1 + A^T L A dz/dx) dx/dt = F. The states stay; H(x) = H_i(x) + z^T A^T L A z / 2 is the energy of all, and since
//! dz/dx is symmetric dH/dx = N^T z with N = 1 + A^T L A dz/dx: a change of coordinates by N^-1.

use super::change::{self, Change};
use super::dependence::Dependence;
use super::eliminated::{Eliminated, Merged};
use super::explicit::Matrix;
use super::quadratic::no_inertia;
use super::start::{self, Stated, at_start};
use super::storage::{family, stiffness, storage};
use super::{ColumnId, Form, inverse};
use crate::expression::{Expr, Symbol};
use crate::model::{Model, Storage};
use bond_grammar::diagnostic::Diagnostic;

/// Merges them.
pub(super) fn merge(
    model: &mut Model,
    form: &mut Form,
    set: &Dependence,
    start: &[Option<f64>],
    done: &mut Eliminated,
) -> Result<(), Diagnostic> {
    let independent = &set.independent;
    let storages: Vec<Storage> =
        independent.iter().filter_map(|c| storage(model, form.column(*c).element).cloned()).collect();
    let states: Vec<Symbol> = storages.iter().map(|s| s.state).collect();
    let (seen, own) = seen(model, form, set, &storages);
    let back = inverse_slopes(model, set, &states, &own).ok_or_else(|| no_inertia(model, form, set))?;
    coordinates(model, form, independent, &back, done);
    let (energy, bounded) = energy(model, form, set, &storages, (&seen, &own));
    let coenergy: Vec<Expr> = states.iter().map(|s| model.pool.derivative(energy, *s)).collect();
    for (i, c) in independent.iter().enumerate() {
        let tied: Vec<ColumnId> = independent.iter().chain(&set.dependent).copied().collect();
        let initial = start::settled(model, form, &tied, (*c, &storages[i]), start[i])?;
        done.states.insert(*c, (states[i], initial, true));
    }
    let moving: Vec<(ColumnId, Symbol)> = independent.iter().copied().zip(states.iter().copied()).collect();
    let mut dependent = Vec::new();
    for (d, x) in set.dependent.iter().zip(&own) {
        let column = form.column(*d).clone();
        let rate = change::rate(model, form, *x, &moving);
        done.fixed.insert(column.out, rate);
        if let Some(s) = storage(model, column.element) {
            done.fixed.insert(s.state, *x);
        }
        dependent.push((column.element, *x));
    }
    let region = form.column(independent[0]).region;
    let (columns, into) = (independent.clone(), independent.clone());
    done.groups.push(Merged { region, columns, energy, coenergy, bounded, dependent, into });
    Ok(())
}

/// A z and L A z of each dependent storage: its co-energy variable and its state.
fn seen(model: &mut Model, form: &Form, set: &Dependence, storages: &[Storage]) -> (Vec<Expr>, Vec<Expr>) {
    let z: Vec<Expr> = storages.iter().map(|s| s.coenergy).collect();
    let mut softness: Vec<Expr> = Vec::new();
    for d in &set.dependent {
        let k = stiffness(model, form, *d).and_then(|row| row.first().map(|t| t.1));
        let one = model.pool.int(1);
        softness.push(k.map_or(one, |k| model.pool.div(one, k)));
    }
    let pool = &mut model.pool;
    let mut seen: Vec<Expr> = Vec::new();
    for row in &set.ratio {
        let terms: Vec<Expr> = row.iter().zip(&z).map(|(a, z)| pool.mul(*a, *z)).collect();
        seen.push(pool.sum(&terms));
    }
    let own = seen.iter().zip(&softness).map(|(e, l)| pool.mul(*e, *l)).collect();
    (seen, own)
}

/// The inverse of N = 1 + A^T d(x_d)/dx.
fn inverse_slopes(model: &mut Model, set: &Dependence, states: &[Symbol], own: &[Expr]) -> Option<Matrix> {
    let pool = &mut model.pool;
    let (zero, one) = (pool.int(0), pool.int(1));
    let n = states.len();
    let mut matrix = vec![vec![zero; n]; n];
    for (j, s) in states.iter().enumerate() {
        let slopes: Vec<Expr> = own.iter().map(|x| pool.derivative(*x, *s)).collect();
        for (i, row) in matrix.iter_mut().enumerate() {
            let mut terms: Vec<Expr> = set.ratio.iter().zip(&slopes).map(|(r, k)| pool.mul(r[i], *k)).collect();
            if i == j {
                terms.push(one);
            }
            row[j] = pool.sum(&terms);
        }
    }
    inverse(pool, &matrix)
}

/// Changes the coordinates of the Dirac structure; the columns get new outputs.
fn coordinates(model: &mut Model, form: &mut Form, independent: &[ColumnId], back: &Matrix, done: &mut Eliminated) {
    let change: Change = independent
        .iter()
        .enumerate()
        .map(|(i, c)| {
            let terms = independent.iter().enumerate().map(|(j, b)| (*b, back[i][j]));
            (*c, terms.filter(|t| !model.pool.is_zero(t.1)).collect())
        })
        .collect();
    change::transform(&mut model.pool, form, &change);
    let mut outs: Vec<Symbol> = Vec::new();
    for c in independent {
        let name = format!("{}'", model.pool.name(form.column(*c).out));
        outs.push(model.pool.symbol(&name));
    }
    for (j, c) in independent.iter().enumerate() {
        let old = form.column(*c).out;
        let mut terms: Vec<Expr> = Vec::new();
        for (row, out) in back.iter().zip(&outs) {
            let new = model.pool.var(*out);
            terms.push(model.pool.mul(row[j], new));
        }
        let sum = model.pool.sum(&terms);
        done.fixed.insert(old, sum);
        form.columns[c.at()].out = outs[j];
        form.column_of.insert(outs[j], *c);
    }
}

/// The energy of all, and whether it is bounded: the energies of the families, each once, and those of the dependent
/// storages.
fn energy(
    model: &mut Model,
    form: &Form,
    set: &Dependence,
    storages: &[Storage],
    (seen, own): (&[Expr], &[Expr]),
) -> (Expr, bool) {
    let mut terms: Vec<Expr> = Vec::new();
    let mut counted: Vec<ColumnId> = Vec::new();
    let mut bounded = true;
    for (c, s) in set.independent.iter().zip(storages) {
        if !counted.contains(c) {
            counted.extend(family(model, form, *c));
            terms.push(s.energy);
            bounded &= s.bounded;
        }
    }
    let half = model.pool.ratio(1, 2);
    for (e, x) in seen.iter().zip(own) {
        terms.push(model.pool.product(&[half, *e, *x]));
    }
    (model.pool.sum(&terms), bounded)
}

/// The co-energy variables that stated starts determine. Of the ports of a field one may be determined by a dependent
/// storage; otherwise they start at what is stated, or at 0.
///
/// # Errors
/// A clash, with the elements.
pub(super) fn start(model: &Model, form: &Form, set: &Dependence) -> Result<Vec<Option<f64>>, Diagnostic> {
    let n = set.independent.len();
    let mut stated: Vec<Stated> = Vec::new();
    let mut otherwise = vec![0.0; n];
    let explicit = |c: ColumnId| storage(model, form.column(c).element).is_some_and(|s| s.explicit);
    let is_undetermined: Vec<bool> = (0..n)
        .map(|i| {
            let determined = |d: usize| explicit(set.dependent[d]) && !model.pool.is_zero(set.ratio[d][i]);
            !explicit(set.independent[i]) && (0..set.dependent.len()).any(determined)
        })
        .collect();
    for (i, c) in set.independent.iter().enumerate() {
        let Some(s) = storage(model, form.column(*c).element) else { continue };
        otherwise[i] = at_start(model, form, s.coenergy);
        let family = family(model, form, *c);
        let undetermined = (0..n).filter(|j| is_undetermined[*j] && family.contains(&set.independent[*j])).count();
        if s.explicit || (family.len() > 1 && undetermined > 1) {
            let row = (0..n).map(|j| f64::from(u8::from(i == j))).collect();
            stated.push(Stated { column: *c, row, value: otherwise[i], driven: 0.0 });
        }
    }
    for (d, c) in set.dependent.iter().enumerate() {
        let Some(s) = storage(model, form.column(*c).element).filter(|s| s.explicit) else { continue };
        let row = set.ratio[d].iter().map(|k| at_start(model, form, *k)).collect();
        let driven = start::driven(model, form, &set.sources[d]);
        stated.push(Stated { column: *c, row, value: at_start(model, form, s.coenergy) - driven, driven });
    }
    start::solve(model, form, set, &stated, &otherwise)
}
