//! Linear systems for every machine, as [`linear`] solves them on numbers: the same operations in the same order.

use super::iteration::SOLVED;
use super::linear::{self, Method};
use super::{dense, sparse};
use crate::machine::{Machine, Variable};

/// A system with its memory on a machine.
pub struct Direct<'p, M: Machine> {
    m: M,
    how: How<'p, M>,
    /// Entries of the matrix, in the order of the pattern.
    values: M::Vector,
    /// The right side, which becomes the solution.
    vector: M::Vector,
}

enum How<'p, M: Machine> {
    Dense(Dense<M>),
    Sparse(Box<sparse::Elimination<'p, M>>, Option<Dense<M>>),
    /// Singular whatever the numbers: this row has no pivot.
    Never(usize),
}

/// A dense system.
struct Dense<M: Machine> {
    n: usize,
    undetermined: bool,
    places: dense::Places<M>,
}

impl<'p, M: Machine> Direct<'p, M> {
    /// A system of a plan and its pattern: the entries of the matrix and the right side are in these lists of numbers.
    /// More memory and tables come from these functions.
    pub fn new(
        m: M,
        (plan, pattern): (&'p linear::Plan, &[(u32, u32)]),
        (values, vector): (M::Vector, M::Vector),
        mut room: impl FnMut(usize) -> M::Vector,
        mut table: impl FnMut(Vec<u32>) -> M::Table,
    ) -> Self {
        let dense = |room: &mut dyn FnMut(usize) -> M::Vector, table: &mut dyn FnMut(Vec<u32>) -> M::Table| {
            Dense::new((plan, pattern), (values.clone(), vector.clone()), room, table)
        };
        let how = match plan.method() {
            Method::Dense => How::Dense(dense(&mut room, &mut table)),
            Method::Never(row) => How::Never(*row),
            Method::Sparse(symbolic) | Method::Complex(symbolic) => {
                let is_complex = matches!(plan.method(), Method::Complex(_));
                let elimination = sparse::Elimination::new(m, (symbolic, is_complex), &mut room, &mut table);
                let again = plan.is_dense_again().then(|| dense(&mut room, &mut table));
                How::Sparse(Box::new(elimination), again)
            }
        };
        Self { m, how, values, vector }
    }

    /// Solves: the right side becomes the solution. Where `same` holds, the entries of the matrix are those of the last
    /// solution. `row` becomes [`SOLVED`] or what it is beside that.
    pub fn solve(&self, row: &M::Variable, same: Option<M::Condition>) {
        row.set(self.m.number(SOLVED));
        match &self.how {
            How::Dense(dense) => dense.solve(self.m, &self.vector, row),
            How::Sparse(sparse, again) => {
                let again = again.as_ref().map(|dense| || dense.solve(self.m, &self.vector, row));
                sparse.solve((&self.values, &self.vector), row, same, again);
            }
            How::Never(without) => row.set(self.m.number(*without as f64)),
        }
    }
}

impl<M: Machine> Dense<M> {
    fn new(
        (plan, pattern): (&linear::Plan, &[(u32, u32)]),
        (values, right): (M::Vector, M::Vector),
        room: &mut dyn FnMut(usize) -> M::Vector,
        table: &mut dyn FnMut(Vec<u32>) -> M::Table,
    ) -> Self {
        let (n, undetermined) = (plan.size(), plan.is_undetermined());
        let which = table(pattern.iter().map(|(i, j)| i * n as u32 + j).collect());
        let given = dense::Given::Entries(values, which, pattern.len(), undetermined.then(|| room(n)));
        let matrix = room(n * n);
        let mut list = || room(n);
        let places = dense::Places {
            matrix,
            right,
            given,
            column: list(),
            scale: list(),
            inverse: list(),
            order: list(),
            parked: list(),
            sums: list(),
        };
        Self { n, undetermined, places }
    }

    fn solve(&self, m: M, vector: &M::Vector, row: &M::Variable) {
        if let dense::Given::Entries(.., Some(right)) = &self.places.given {
            m.each(self.n, |i| m.put(right, i, m.at(vector, i)));
        }
        dense::eliminate(m, self.n, &self.places, row, self.undetermined);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{Real, cells};
    use crate::solve::linear::{Matrix, Plan};
    use crate::solve::testing::Random;
    use std::cell::Cell;

    /// What both ways give for a system: how it went, and the solution's bits.
    fn both(n: usize, pattern: &[(u32, u32)], matrix: Matrix, values: &[f64], right: &[f64]) -> [(bool, Vec<u64>); 2] {
        let plan = Plan::new(n, pattern, matrix);
        let mut expected = right.to_vec();
        let solved = plan.solve(pattern, values, &mut expected, &mut plan.scratch(), false);
        let (mut values, mut vector) = (values.to_vec(), right.to_vec());
        let mut memory = vec![f64::NAN; 12 * (n * n + 100)];
        let row = Cell::new(0.0);
        {
            let (values, vector) = (cells(&mut values), cells(&mut vector));
            let free = Cell::new(cells(&mut memory));
            let room = |n: usize| {
                let (own, others) = free.get().split_at(n);
                free.set(others);
                own
            };
            let direct = Direct::new(Real::new(), (&plan, pattern), (values, vector), room, |list| &*list.leak());
            direct.solve(&row, None);
        }
        let bits = |list: &[f64]| list.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
        let keep = |solved: bool, list: &[f64]| (solved, if solved { bits(list) } else { Vec::new() });
        [keep(solved.is_ok(), &expected), keep(row.get() < 0.0, &vector)]
    }

    /// Every kind of system has the bits that it has on numbers.
    #[test]
    fn on_a_machine_as_on_numbers() {
        let mut random = Random::new(3);
        let line = |n: u32| (0..n).flat_map(|i| [(i, i), (i, i + 1), (i + 1, i)]).filter(move |p| p.0 < n && p.1 < n);
        let sparse =
            |n: u32| (0..n).flat_map(move |i| [(i, i), (i, (i + 1) % n), (i, (i * 7 + 3) % n), ((i * 5) % n, i)]);
        for n in [3u32, 9, 12, 16, 17, 40, 67, 68, 69, 70, 230] {
            for (matrix, is_line) in [
                (Matrix::Changing, false),
                (Matrix::Kept, false),
                (Matrix::Kept, true),
                (Matrix::Undetermined, false),
                (Matrix::Complex, false),
                (Matrix::Complex, true),
            ] {
                let mut pattern: Vec<_> = if is_line { line(n).collect() } else { sparse(n).collect() };
                pattern.sort_unstable();
                pattern.dedup();
                let parts = if matrix == Matrix::Complex { 2 } else { 1 };
                // Plain matrices, some with bad pivots, and one that is singular.
                for diagonal in [4.0, 0.3, 1e-5, 0.0] {
                    let mut values: Vec<f64> = Vec::new();
                    for (i, j) in &pattern {
                        let size = if i == j { diagonal } else { 1.0 };
                        (0..parts).for_each(|_| values.push(size * (2.0 * random.next() - 0.5)));
                    }
                    let right: Vec<f64> = (0..n * parts).map(|_| random.next()).collect();
                    let [ours, theirs] = both(n as usize, &pattern, matrix, &values, &right);
                    assert_eq!(ours, theirs, "{n} unknowns, {matrix:?}, {is_line}, {diagonal}");
                }
            }
        }
    }
}
