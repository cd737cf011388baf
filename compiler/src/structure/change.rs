//! Changes of coordinates of the Dirac structure.

use super::{ColumnId, Form, Row};
use crate::causality::combine;
use crate::expression::{Expr, Pool, Symbol};
use crate::model::{Model, Signal};
use rustc_hash::FxHashMap;

/// A change of coordinates: for each new state (named by its column), the old columns whose rates it is the combination
/// of.
pub(super) type Change = Vec<(ColumnId, Vec<(ColumnId, Expr)>)>;

/// The Dirac structure in new coordinates, D' = T D T^T.
pub(super) fn transform(pool: &mut Pool, form: &mut Form, change: &Change) {
    let one = pool.int(1);
    // z_b = sum over a of T_ab z'_a
    let mut expansion: FxHashMap<ColumnId, Vec<(ColumnId, Expr)>> = FxHashMap::default();
    for (a, terms) in change {
        for (b, k) in terms {
            expansion.entry(*b).or_default().push((*a, *k));
        }
    }
    // D is skew: the rows of the old states tell the columns that see them.
    let mut concerned: Vec<ColumnId> = expansion.keys().flat_map(|b| &form.column(*b).row).map(|t| t.0).collect();
    concerned.sort_unstable();
    concerned.dedup();
    for id in concerned {
        let c = &mut form.columns[id.at()];
        let mut parts: Vec<(Expr, Row)> = Vec::new();
        for (b, k) in &c.row {
            match expansion.get(b) {
                Some(list) => parts.extend(list.iter().map(|(a, t)| (*k, vec![(*a, *t)]))),
                None => parts.push((*k, vec![(*b, one)])),
            }
        }
        c.row = combine(pool, parts.iter().map(|(k, r)| (*k, r)));
    }
    let rows: Vec<(ColumnId, Row)> = change
        .iter()
        .map(|(a, terms)| {
            let parts: Vec<(Expr, Row)> = terms.iter().map(|(b, k)| (*k, form.column(*b).row.clone())).collect();
            (*a, combine(pool, parts.iter().map(|(k, r)| (*k, r))))
        })
        .collect();
    // What two changed rows say of each other is the same but for the sign, and taken from one of them.
    let changed: Vec<ColumnId> = rows.iter().map(|r| r.0).collect();
    for (a, mut row) in rows {
        row.retain(|(b, _)| *b != a && (*b < a || !changed.contains(b)));
        form.columns[a.at()].row = row;
    }
    for &a in &changed {
        let mirrored: Row =
            changed.iter().filter(|b| **b > a).filter_map(|b| Some((*b, pool.neg(form.entry(*b, a)?)))).collect();
        let row = &mut form.columns[a.at()].row;
        row.extend(mirrored);
        row.sort_unstable_by_key(|t| t.0);
    }
}

/// d/dt of an expression of states and time, the rates of the states being rows of outputs.
pub(super) fn rate(model: &mut Model, form: &Form, e: Expr, states: &[(ColumnId, Symbol)]) -> Expr {
    let mut terms = Vec::new();
    for (c, s) in states {
        let d = model.pool.derivative(e, *s);
        if !model.pool.is_zero(d) {
            let f = form.input(&mut model.pool, *c);
            terms.push(model.pool.mul(d, f));
        }
    }
    for s in model.pool.symbols(e) {
        if model.signals.get(&s) == Some(&Signal::Time) {
            terms.push(model.pool.derivative(e, s));
        }
    }
    model.pool.sum(&terms)
}
