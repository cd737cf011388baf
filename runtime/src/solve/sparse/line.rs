//! Lines: unknowns each of which is joined to the one before and the next one alone, as those of a ladder, a string or
//! a rod: tridiagonal matrices.
//!
//! Every second unknown is eliminated first, none of which waits for another: the outer ones, `0, 2, 4, ...`. What is
//! left, the inner ones `1, 3, 5, ...`, is a line of half the length, which is eliminated from both ends at once (a step
//! of cyclic reduction, and a twisted factorisation: Golub and Van Loan, Matrix Computations, 4.5; Meurant, SIAM J.
//! Matrix Anal. Appl. 13, 1992). So a substitution waits for a quarter of the unknowns each way, and goes by pairs, one
//! unknown of the left end and one of the right, for which the factors are packed in the order in which it comes by.

use super::Pattern;
use crate::solve::scalar::Scalar;

/// Lines of fewer unknowns go as all other patterns.
const LEAST: usize = 16;

/// A line of unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    n: usize,
}

/// Factors by rows, in the order of elimination.
#[derive(Clone, Copy)]
pub(super) struct Factors<'a, T> {
    /// Row by row, as the pattern has them.
    pub(super) lower: (&'a [T], &'a Pattern),
    /// The same.
    pub(super) upper: (&'a [T], &'a Pattern),
    /// Of the pivots.
    pub(super) inverse: &'a [T],
}

impl<T: Scalar> Factors<'_, T> {
    fn lower(&self, step: usize) -> &[T] {
        &self.lower.0[self.lower.1.row(step)]
    }

    fn upper(&self, step: usize) -> &[T] {
        &self.upper.0[self.upper.1.row(step)]
    }
}

impl Line {
    /// The line that unknowns with these neighbours are, if they are one.
    pub(super) fn of(neighbours: &[Vec<u32>]) -> Option<Self> {
        let n = neighbours.len();
        let joined = |i: usize| i.checked_sub(1).into_iter().chain((i + 1 < n).then_some(i + 1));
        let is_line = (0..n).all(|i| neighbours[i].iter().map(|j| *j as usize).eq(joined(i)));
        (n >= LEAST && is_line).then_some(Self { n })
    }

    /// How many unknowns are eliminated first.
    fn outer(&self) -> usize {
        self.n.div_ceil(2)
    }

    /// How many are left.
    fn inner(&self) -> usize {
        self.n / 2
    }

    /// Which of the inner ones, by when it is eliminated: from both ends in turn.
    fn inner_at(&self, turn: usize) -> usize {
        if turn.is_multiple_of(2) { turn / 2 } else { self.inner() - 1 - turn / 2 }
    }

    /// Up to which of the inner ones it goes on from the left.
    fn middle(&self) -> usize {
        (self.inner() - 1) / 2
    }

    /// How many pairs there are on the way down, beside the ends and what is in the middle.
    fn down(&self) -> usize {
        (self.inner() - 3) / 2
    }

    /// How many pairs there are on the way up.
    fn up(&self) -> usize {
        self.inner() - 2 - self.middle()
    }

    /// How many pairs of numbers the packed factors are.
    pub fn packed(&self) -> usize {
        3 * self.down() + 5 * self.up()
    }

    /// The order of elimination.
    pub(super) fn order(&self) -> Vec<u32> {
        let inner = (0..self.inner()).map(|turn| 2 * self.inner_at(turn) + 1);
        (0..self.outer()).map(|k| 2 * k).chain(inner).map(|i| i as u32).collect()
    }

    /// The step at which one of the inner ones is eliminated.
    fn step(&self, inner: usize) -> usize {
        self.outer() + if inner <= self.middle() { 2 * inner } else { 2 * (self.inner() - 1 - inner) + 1 }
    }

    /// What an outer one has of the inner ones beside it, the left and the right.
    fn beside<T: Scalar>(&self, f: Factors<'_, T>, outer: usize) -> [T; 2] {
        match *f.upper(outer) {
            [a, b] if self.step(outer - 1) < self.step(outer) => [a, b],
            [a, b] => [b, a],
            [a] if outer == 0 => [T::default(), a],
            [a] => [a, T::default()],
            _ => [T::default(); 2],
        }
    }

    /// Packs factors.
    pub(super) fn pack<T: Scalar>(&self, f: Factors<'_, T>, packed: &mut [[T; 2]]) {
        let (down, up) = packed.split_at_mut(3 * self.down());
        for (p, to) in down.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (left, right) = (f.lower(self.step(1 + p)), f.lower(self.step(self.inner() - 2 - p)));
            *to = [[left[0], right[1]], [left[1], right[0]], [left[2], right[2]]];
        }
        for (r, to) in up.as_chunks_mut::<5>().0.iter_mut().enumerate() {
            let (a, c) = (self.middle() - 1 - r, self.middle() + 2 + r);
            let (left, right) = (self.step(a), self.step(c));
            // Of the two beside an outer one, that which is nearer to the end is eliminated first.
            let (l, r) = (f.upper(a + 1), f.upper(c));
            let own = [f.inverse[left], f.inverse[right]];
            let between = [f.inverse[a + 1], f.inverse[c]];
            *to = [own, [f.upper(left)[0], f.upper(right)[0]], between, [l[0], r[0]], [l[1], r[1]]];
        }
    }

    /// A right side becomes the solution.
    ///
    /// # Panics
    /// Where the factors are not those of the line, or `b` or `work` is shorter than it.
    pub(super) fn substitute<T: Scalar>(&self, f: Factors<'_, T>, packed: &[[T; 2]], work: &mut [T], b: &mut [f64]) {
        let (inner, m) = (self.inner(), self.middle());
        let (down, up) = packed.split_at(3 * self.down());
        let work = &mut work[..inner];
        // Down, by turns.
        let alone = |turn: usize, work: &[T], b: &[f64]| {
            let (k, row) = (self.inner_at(turn), f.lower(self.outer() + turn));
            let mut sum = T::at(b, 2 * k + 1).less(row[0], T::at(b, 2 * k));
            let mut rest = &row[1..];
            if 2 * k + 2 < self.n {
                sum = sum.less(rest[0], T::at(b, 2 * k + 2));
                rest = &rest[1..];
            }
            for (i, l) in rest.iter().enumerate() {
                sum = sum.less(*l, work[turn - 2 + i]);
            }
            sum
        };
        (work[0], work[1]) = (alone(0, work, b), alone(1, work, b));
        let mut before = T::two([work[0], work[1]]);
        let mut known = T::two([T::at(b, 2), T::at(b, 2 * (inner - 1))]);
        let left = b[3 * T::PARTS..].chunks_exact(2 * T::PARTS);
        let right = b[..2 * (inner - 1) * T::PARTS].rchunks_exact(2 * T::PARTS);
        let to = work[2..].as_chunks_mut::<2>().0;
        for (((to, [first, second, near]), left), right) in
            to.iter_mut().zip(down.as_chunks::<3>().0).zip(left).zip(right)
        {
            let own = T::two([T::at(left, 0), T::at(right, 1)]);
            let next = T::two([T::at(left, 1), T::at(right, 0)]);
            let sum = T::less_two(T::less_two(own, T::two(*first), known), T::two(*second), next);
            before = T::less_two(sum, T::two(*near), before);
            known = next;
            *to = T::each(before);
        }
        for turn in 2 + 2 * self.down()..inner {
            work[turn] = alone(turn, work, b);
        }
        // Up, from the middle.
        let own = |step: usize, work: &[T]| work[step - self.outer()].times(f.inverse[step]);
        let (s, t) = (self.step(m), self.step(m + 1));
        let (first, second) = (s.max(t), s.min(t));
        let x = own(first, work);
        let y = own(second, work).less(f.upper(second)[0], x);
        let [x, y] = if s == first { [x, y] } else { [y, x] };
        let between = |outer: usize, left: T, right: T, b: &mut [f64]| {
            let [l, r] = self.beside(f, outer);
            T::at(b, 2 * outer).times(f.inverse[outer]).less(l, left).less(r, right).put(b, 2 * outer);
        };
        x.put(b, 2 * m + 1);
        y.put(b, 2 * m + 3);
        between(m + 1, x, y, b);
        let mut last = T::two([x, y]);
        let (left, right) = b.split_at_mut((2 * m + 3) * T::PARTS);
        let left = left[..(2 * m + 1) * T::PARTS].rchunks_exact_mut(2 * T::PARTS);
        let right = right[T::PARTS..].chunks_exact_mut(2 * T::PARTS);
        let (lefts, rights) =
            (work[..2 * m].as_chunks::<2>().0.iter().rev(), work[..2 * self.up()].as_chunks::<2>().0.iter().rev());
        for ((((u, l), r), left), right) in up.as_chunks::<5>().0.iter().zip(lefts).zip(rights).zip(left).zip(right) {
            let [own, near, between, new, old] = u.map(T::two);
            let x = T::less_two(T::times_two(T::two([l[0], r[1]]), own), near, last);
            let z = T::times_two(T::two([T::at(left, 1), T::at(right, 0)]), between);
            let z = T::less_two(T::less_two(z, old, last), new, x);
            last = x;
            let ([x, y], [z, w]) = (T::each(x), T::each(z));
            x.put(left, 0);
            z.put(left, 1);
            w.put(right, 0);
            y.put(right, 1);
        }
        if m > self.up() {
            let right = T::at(b, 3);
            let x = own(self.step(0), work).less(f.upper(self.step(0))[0], right);
            x.put(b, 1);
            between(1, x, right, b);
        }
        let x = T::at(b, 1);
        between(0, T::default(), x, b);
        if self.outer() > inner {
            let x = T::at(b, 2 * inner - 1);
            between(inner, x, T::default(), b);
        }
    }
}
