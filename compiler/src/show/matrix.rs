//! The matrices of a region with the names of their rows and columns.

use super::name;
use crate::expression::{Expr, Pool};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Region, explicit};
use rustc_hash::FxHashMap;

/// A region with more states has no explicit form in print, and its Dirac structure is sparse.
pub(super) const LARGE: usize = 60;

/// A matrix: the entries that are not 0, by rows.
pub(super) struct Matrix {
    pub(super) rows: Vec<String>,
    pub(super) columns: Vec<String>,
    pub(super) entries: Vec<(usize, usize, Expr)>,
}

/// The explicit form, its inputs as signals of their bonds; see [`name::port`].
pub(super) struct Explicit {
    pub(super) j: Matrix,
    pub(super) r: Matrix,
    pub(super) g: Matrix,
    pub(super) p: Matrix,
    pub(super) m: Matrix,
    pub(super) s: Matrix,
    /// Names of the inputs, then of the outputs of resistors that are not linear.
    pub(super) inputs: Vec<String>,
    /// The conjugates, in the same order.
    pub(super) outputs: Vec<String>,
    /// How many of them are no resistors.
    pub(super) real: usize,
}

impl Matrix {
    /// The part with these columns.
    pub(super) fn columns(&self, range: std::ops::Range<usize>) -> Matrix {
        let entries = self.entries.iter().filter(|e| range.contains(&e.1)).map(|&(i, j, e)| (i, j - range.start, e)).collect();
        Matrix { rows: self.rows.clone(), columns: self.columns[range.clone()].to_vec(), entries }
    }

    /// The part with the first rows.
    pub(super) fn top(&self, count: usize) -> Matrix {
        let entries = self.entries.iter().filter(|e| e.0 < count).copied().collect();
        Matrix { rows: self.rows[..count].to_vec(), columns: self.columns.clone(), entries }
    }
}

/// The columns of a region, in the order of print: ports and sources, storages, resistors.
pub(super) fn order(region: &Region) -> Vec<ColumnId> {
    let states = region.states.iter().map(|s| s.column);
    region.inputs.iter().copied().chain(states).chain(region.resistors.iter().map(|r| r.0)).collect()
}

/// The Dirac structure: each element's input by the outputs of all, every flow and power counted into the element.
pub(super) fn dirac(form: &Form, region: &Region, names: &[String]) -> Matrix {
    let order = order(region);
    let place: FxHashMap<ColumnId, usize> = order.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    let mut entries = Vec::new();
    for (i, c) in order.iter().enumerate() {
        let mut row: Vec<(usize, usize, Expr)> =
            form.column(*c).row.iter().filter_map(|(j, e)| Some((i, *place.get(j)?, *e))).collect();
        row.sort_unstable_by_key(|e| e.1);
        entries.extend(row);
    }
    let named = |c: &ColumnId, letter: char| format!("{}.{letter}", names[c.at()]);
    Matrix {
        rows: order.iter().map(|c| named(c, form.column(*c).gives.other().letter())).collect(),
        columns: order.iter().map(|c| named(c, form.column(*c).gives.letter())).collect(),
        entries,
    }
}

/// The explicit form of a region; `None` where it is too large to be written out, or has none.
pub(super) fn explicit_form(model: &mut Model, form: &Form, region: &Region, names: &[String]) -> Option<Explicit> {
    if region.states.len() > LARGE || region.resistors.len() + region.inputs.len() > 2 * LARGE {
        return None;
    }
    let e = explicit(model, form, region)?;
    let ports: Vec<name::Port> = e.inputs.iter().map(|c| name::port(form, names, *c)).collect();
    let turned: Vec<bool> = ports.iter().map(|p| p.turned).collect();
    let straight = vec![false; region.states.len()];
    let states: Vec<String> = region.states.iter().map(|s| s.name.clone()).collect();
    let co: Vec<String> = region.states.iter().map(|s| format!("dH/d({})", s.name)).collect();
    let rates: Vec<String> = states.iter().map(|s| format!("d({s})/dt")).collect();
    let inputs: Vec<String> = ports.iter().map(|p| p.input.clone()).collect();
    let outputs: Vec<String> = ports.iter().map(|p| p.output.clone()).collect();
    let pool = &mut model.pool;
    let mut make = |a: &[Vec<Expr>], rows: &[String], columns: &[String], flip: (&[bool], &[bool])| {
        Matrix { rows: rows.to_vec(), columns: columns.to_vec(), entries: entries(pool, a, flip) }
    };
    Some(Explicit {
        j: make(&e.j, &rates, &co, (&straight, &straight)),
        r: make(&e.r, &rates, &co, (&straight, &straight)),
        g: make(&e.g, &rates, &inputs, (&straight, &turned)),
        p: make(&e.p, &rates, &inputs, (&straight, &turned)),
        m: make(&e.m, &outputs, &inputs, (&turned, &turned)),
        s: make(&e.s, &outputs, &inputs, (&turned, &turned)),
        real: inputs.len().saturating_sub(e.nonlinear),
        inputs,
        outputs,
    })
}

fn entries(pool: &mut Pool, a: &[Vec<Expr>], flip: (&[bool], &[bool])) -> Vec<(usize, usize, Expr)> {
    let mut list = Vec::new();
    for (i, row) in a.iter().enumerate() {
        for (j, &e) in row.iter().enumerate() {
            if !pool.is_zero(e) {
                list.push((i, j, if flip.0[i] == flip.1[j] { e } else { pool.neg(e) }));
            }
        }
    }
    list
}

/// H of a region.
pub(super) fn energy(pool: &mut Pool, region: &Region) -> Expr {
    let all: Vec<Expr> = region.groups.iter().map(|g| g.energy).collect();
    pool.sum(&all)
}
