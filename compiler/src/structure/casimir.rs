//! Energies that have a least value on what can be reached: some states stay on an ellipsoid, whatever H is.
//!
//! A Casimir of the form is a function whose rate is 0 for every output. A sum of w x^2 is one if, for every column,
//! the sum of w x k over the states is 0, where k is the column's coefficient in the row of x. The direction of gravity
//! in the frame of a turning body is of that kind: its length stays what it is, and an energy linear in it has a least
//! value there, though not over all numbers.

use super::{ColumnId, Form, Region};
use crate::expression::{Expr, Symbol};
use crate::model::Model;
use rustc_hash::FxHashMap;

/// States of a region beyond which none is looked for.
const MOST: usize = 64;
/// The part of an equation's largest coefficient that is rounding.
const ROUNDING: f64 = 1e-10;

/// Finds where energies without a least value are least on what can be reached, if they are linear, and says that they
/// are bounded.
pub(super) fn bound(model: &Model, form: &mut Form) {
    let found: Vec<(usize, usize, f64)> = form
        .regions
        .iter()
        .enumerate()
        .filter(|(_, r)| r.groups.iter().any(|g| !g.bounded))
        .flat_map(|(i, r)| least_of(model, form, r).into_iter().map(move |(g, x)| (i, g, x)))
        .collect();
    for (region, group, at) in found {
        let group = &mut form.regions[region].groups[group];
        (group.bounded, group.least_at) = (true, Some(at));
    }
}

/// The groups of a region whose energies are least at a value of their one state, and that value.
fn least_of(model: &Model, form: &Form, region: &Region) -> Vec<(usize, f64)> {
    let pool = &model.pool;
    let constant = |e: Expr| pool.symbols(e).iter().all(|s| pool.value(*s).is_some()).then(|| pool.eval(e, &|_| 0.0));
    // Group, state and slope of each linear energy that is not bounded.
    let falling: Vec<(usize, usize, f64)> = region
        .groups
        .iter()
        .enumerate()
        .filter(|(_, g)| !g.bounded)
        .filter_map(|(i, g)| match (&g.states[..], &g.coenergy[..]) {
            (&[state], &[slope]) => Some((i, state, constant(slope)?)),
            _ => None,
        })
        .collect();
    let mut list = Vec::new();
    for weights in square_casimirs(model, form, region) {
        let square: f64 = weights.iter().zip(&region.states).map(|(w, s)| w * s.initial * s.initial).sum();
        let here = falling.iter().filter(|f| weights[f.1] > 0.0 && list.iter().all(|l: &(usize, f64)| l.0 != f.0));
        let here: Vec<&(usize, usize, f64)> = here.collect();
        // Their sum is least where the ellipsoid's normal is along the slopes.
        let steepness: f64 = here.iter().map(|f| f.2 * f.2 / weights[f.1]).sum();
        let scale = -(square / steepness).sqrt();
        if scale.is_finite() {
            list.extend(here.into_iter().map(|f| (f.0, scale * f.2 / weights[f.1])));
        }
    }
    list
}

/// Sums of squares of states that nothing changes: the weights of each, none below 0.
pub(crate) fn square_casimirs(model: &Model, form: &Form, region: &Region) -> Vec<Vec<f64>> {
    let n = region.states.len();
    if n > MOST {
        return Vec::new();
    }
    let mut columns: FxHashMap<ColumnId, Vec<(usize, Expr)>> = FxHashMap::default();
    for (i, s) in region.states.iter().enumerate() {
        for (column, k) in &form.column(s.column).row {
            columns.entry(*column).or_default().push((i, *k));
        }
    }
    let mut columns: Vec<(ColumnId, Vec<(usize, Expr)>)> = columns.into_iter().collect();
    columns.sort_unstable_by_key(|c| c.0);
    let mut places: FxHashMap<Symbol, usize> = region.states.iter().enumerate().map(|(i, s)| (s.symbol, i)).collect();
    for s in columns.iter().flat_map(|c| &c.1).flat_map(|(_, k)| model.pool.symbols(*k)) {
        let next = places.len();
        places.entry(s).or_insert(next);
    }
    // The equations that the weights must meet at some points, reduced; each has its pivot.
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    for point in 0..n + 4 {
        let at = |s: Symbol| places.get(&s).map_or(0.0, |i| coordinate(*i, point));
        for (_, terms) in &columns {
            let mut row = vec![0.0; n];
            for (i, k) in terms {
                row[*i] += coordinate(*i, point) * model.pool.eval(*k, &at);
            }
            if row.iter().any(|x| !x.is_finite()) {
                return Vec::new();
            }
            reduce(&mut rows, row);
        }
    }
    let free = (0..n).filter(|i| rows.iter().all(|r| r.0 != *i));
    let null = free.map(|f| {
        let mut weights = vec![0.0; n];
        weights[f] = 1.0;
        rows.iter().for_each(|(pivot, row)| weights[*pivot] = -row[f]);
        weights.iter_mut().filter(|w| w.abs() <= ROUNDING).for_each(|w| *w = 0.0);
        weights
    });
    null.filter(|weights| weights.iter().all(|w| *w >= 0.0)).collect()
}

/// Adds an equation to those that are reduced, if it says something new.
fn reduce(rows: &mut Vec<(usize, Vec<f64>)>, mut row: Vec<f64>) {
    let size = |row: &[f64]| row.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let before = size(&row);
    for (pivot, other) in rows.iter() {
        let part = row[*pivot];
        row.iter_mut().zip(other).for_each(|(x, y)| *x -= part * y);
    }
    let left = size(&row);
    let Some(pivot) = row.iter().position(|x| x.abs() == left) else { return };
    if left <= ROUNDING * before || left == 0.0 {
        return;
    }
    let by = row[pivot];
    row.iter_mut().for_each(|x| *x /= by);
    for (_, other) in rows.iter_mut() {
        let part = other[pivot];
        other.iter_mut().zip(&row).for_each(|(x, y)| *x -= part * y);
    }
    rows.push((pivot, row));
}

/// A coordinate of a point in general position, of size 1/2 to 3/2.
fn coordinate(axis: usize, point: usize) -> f64 {
    let (i, k) = (axis as f64 + 1.0, point as f64 + 1.0);
    0.5 + (i * k * std::f64::consts::SQRT_2 + i * i * std::f64::consts::E).fract()
}
