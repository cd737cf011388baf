//! The matrices of a region with the names of their rows and columns.

use super::name;
use super::size::SIZES;
use super::sparse::{self, Entries, Sparse};
use crate::expression::{Expr, Pool};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Region, Role, explicit};
use rustc_hash::FxHashMap;

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
    /// Which of them are multipliers of constraints.
    pub(super) multipliers: Vec<bool>,
}

impl Matrix {
    /// The part with these columns.
    pub(super) fn columns(&self, range: std::ops::Range<usize>) -> Matrix {
        let entries =
            self.entries.iter().filter(|e| range.contains(&e.1)).map(|&(i, j, e)| (i, j - range.start, e)).collect();
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

/// The Dirac structure: each element's input by the outputs of all, its power counted into it.
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

/// The explicit form of a region; `None` where it has none, or one that is too large to be written out.
pub(super) fn explicit_form(model: &mut Model, form: &Form, region: &Region, names: &[String]) -> Option<Explicit> {
    let large = region.states.len() > SIZES.dense_states
        || region.resistors.len() + region.inputs.len() > 2 * SIZES.dense_states;
    let Sparse { matrices, inputs, nonlinear } = if large {
        sparse::explicit(model, form, region)?
    } else {
        let e = explicit(model, form, region)?;
        let matrices = [&e.j, &e.r, &e.g, &e.p, &e.m, &e.s].map(|m| entries(&model.pool, m));
        Sparse { matrices, inputs: e.inputs, nonlinear: e.nonlinear }
    };
    let ports: Vec<name::Port> = inputs.iter().map(|c| name::port(form, names, *c)).collect();
    let turned: Vec<bool> = ports.iter().map(|p| p.turned).collect();
    let straight = vec![false; region.states.len()];
    let states: Vec<String> = region.states.iter().map(|s| s.name.clone()).collect();
    let co: Vec<String> = region.states.iter().map(|s| format!("dH/d({})", s.name)).collect();
    let rates: Vec<String> = states.iter().map(|s| format!("d({s})/dt")).collect();
    let multipliers = inputs.iter().map(|c| form.column(*c).role == Role::Constraint).collect();
    let inputs: Vec<String> = ports.iter().map(|p| p.input.clone()).collect();
    let outputs: Vec<String> = ports.iter().map(|p| p.output.clone()).collect();
    let real = inputs.len().saturating_sub(nonlinear);
    let pool = &mut model.pool;
    let [j, r, g, p, m, s] = matrices;
    let mut make = |a: Entries, rows: &[String], columns: &[String], flip: (&[bool], &[bool])| {
        let mut turn =
            |((i, j), e): ((usize, usize), Expr)| (i, j, if flip.0[i] == flip.1[j] { e } else { pool.neg(e) });
        let entries = a.into_iter().map(&mut turn).collect();
        Matrix { rows: rows.to_vec(), columns: columns.to_vec(), entries }
    };
    Some(Explicit {
        j: make(j, &rates, &co, (&straight, &straight)),
        r: make(r, &rates, &co, (&straight, &straight)),
        g: make(g, &rates, &inputs, (&straight, &turned)),
        p: make(p, &rates, &inputs, (&straight, &turned)),
        m: make(m, &outputs, &inputs, (&turned, &turned)),
        s: make(s, &outputs, &inputs, (&turned, &turned)),
        real,
        multipliers,
        inputs,
        outputs,
    })
}

fn entries(pool: &Pool, a: &[Vec<Expr>]) -> Entries {
    let all = a.iter().enumerate().flat_map(|(i, row)| row.iter().enumerate().map(move |(j, e)| ((i, j), *e)));
    all.filter(|(_, e)| !pool.is_zero(*e)).collect()
}

/// H of a region.
pub(super) fn energy(pool: &mut Pool, region: &Region) -> Expr {
    let all: Vec<Expr> = region.groups.iter().map(|g| g.energy).collect();
    pool.sum(&all)
}
