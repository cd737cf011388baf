//! Small systems written out: `bond_runtime::solve::dense` on a [`Recorder`].

use super::recorder::{Changing, Recorder};
use super::writer::{Vector, Writer};
use crate::backend::code::{System, Value};
use bond_runtime::solve::dense::{Given, Places, eliminate};
use bond_runtime::solve::linear::Matrix;

impl Writer {
    /// The number of a system that is solved elsewhere.
    pub(super) fn system(&mut self, n: usize, pattern: Vec<(u32, u32)>, matrix: Matrix) -> u32 {
        self.systems.push(System { n, pattern, matrix });
        self.systems.len() as u32 - 1
    }
}

/// Solves a system of the entries (row, column, value). `row` tells how it went.
pub(super) fn solve<'r>(
    m: &'r Recorder,
    entries: &[(u32, u32, Value)],
    right: Vec<Value>,
    row: &Changing<'r>,
    undetermined: bool,
) -> Vector {
    let n = right.len();
    let places = m.with(|w| {
        let mut matrix = vec![w.number(0.0); n * n];
        entries.iter().for_each(|(i, j, v)| matrix[*i as usize * n + *j as usize] = *v);
        let mut vars = |n: usize| Vector::Vars((0..n).map(|_| w.var()).collect());
        Places {
            matrix: vars(n * n),
            right: vars(n),
            given: Given::Copied(Vector::Values(matrix), Vector::Values(right)),
            column: vars(n),
            scale: vars(n),
            inverse: vars(n),
            order: vars(n),
            parked: vars(n),
            sums: vars(n),
        }
    });
    eliminate(m, n, &places, row, undetermined);
    places.right
}
