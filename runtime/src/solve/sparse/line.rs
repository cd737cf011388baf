//! Lines: unknowns each of which is joined to the one before and the next one alone, as those of a ladder, a string or
//! a rod: tridiagonal matrices.
//!
//! Every second unknown is eliminated first, none of which waits for another: the outer ones, `0, 2, 4, ...`. What is
//! left is a line of half the length, of which every second goes next: the middle ones, `1, 5, 9, ...` (two steps of
//! cyclic reduction: Golub and Van Loan, Matrix Computations, 4.5). The rest, the inner ones `3, 7, 11, ...`, are
//! eliminated from both ends at once (a twisted factorisation: Meurant, SIAM J. Matrix Anal. Appl. 13, 1992). So a
//! substitution waits for an eighth of the unknowns each way, and goes by pairs, four unknowns of the left end and four
//! of the right, for which the factors are packed in the order in which they come by.

use super::Pattern;
use crate::solve::scalar::Scalar;

/// Lines of fewer unknowns go as all other patterns.
const LEAST: usize = 16;
/// How many pairs of factors four unknowns of each end take on the way down,
pub(super) const DOWN: usize = 7;
/// and on the way up.
pub(super) const UP: usize = 11;

/// A line of unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    n: usize,
}

/// Factors by rows, in the order of elimination.
#[derive(Clone, Copy)]
pub(super) struct Factors<'a, T> {
    /// The unknown of each step.
    pub(super) order: &'a [u32],
    /// Row by row, as the pattern has them.
    pub(super) lower: (&'a [T], &'a Pattern),
    /// The same.
    pub(super) upper: (&'a [T], &'a Pattern),
    /// Of the pivots.
    pub(super) inverse: &'a [T],
}

impl<T: Scalar> Factors<'_, T> {
    /// A sum less what a row of a factor makes of `b`.
    #[inline(always)]
    fn take(&self, sum: T, (values, pattern): (&[T], &Pattern), step: usize, b: &[f64]) -> T {
        let row = pattern.row(step);
        let each = pattern.columns[row.clone()].iter().zip(&values[row]);
        each.fold(sum, |sum, (&k, a)| sum.less(*a, T::at(b, self.order[k as usize] as usize)))
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

    /// How many are eliminated next.
    fn middle(&self) -> usize {
        (self.n + 2) / 4
    }

    /// How many are left.
    pub(super) fn inner(&self) -> usize {
        self.n / 4
    }

    /// How many times four unknowns of each end come by, before those in between.
    pub(super) fn pairs(&self) -> usize {
        (self.inner() - 1) / 2
    }

    /// How many pairs of numbers the packed factors are.
    pub fn packed(&self) -> usize {
        (DOWN + UP) * self.pairs()
    }

    /// The order of elimination.
    pub(super) fn order(&self) -> Vec<u32> {
        let outer = (0..self.outer()).map(|k| 2 * k);
        let middle = (0..self.middle()).map(|k| 4 * k + 1);
        let end = self.inner() - 1;
        let inner = (0..=end).map(|turn| 4 * if turn.is_multiple_of(2) { turn / 2 } else { end - turn / 2 } + 3);
        outer.chain(middle).chain(inner).map(|i| i as u32).collect()
    }

    /// The step at which an unknown is eliminated.
    pub(super) fn step(&self, unknown: usize) -> usize {
        let (k, end) = (unknown / 4, self.inner() - 1);
        match unknown % 4 {
            0 | 2 => unknown / 2,
            1 => self.outer() + k,
            _ if 2 * k <= end => self.outer() + self.middle() + 2 * k,
            _ => self.outer() + self.middle() + 2 * (end - k) + 1,
        }
    }

    /// Packs factors.
    pub(super) fn pack<T: Scalar>(&self, f: Factors<'_, T>, packed: &mut [[T; 2]]) {
        let (down, up) = packed.split_at_mut(DOWN * self.pairs());
        // What a factor has of an unknown in the row of another; nothing of those beyond the ends.
        let entry = |(values, pattern): (&[T], &Pattern), row: usize, unknown: Option<usize>| {
            let (row, step) = (pattern.row(self.step(row)), self.step(unknown.filter(|i| *i < self.n)?));
            let at = pattern.columns[row.clone()].iter().position(|k| *k as usize == step)?;
            Some(values[row][at])
        };
        let cells = down.as_chunks_mut::<DOWN>().0.iter_mut().zip(up.as_chunks_mut::<UP>().0);
        for (pair, (down, up)) in cells.enumerate() {
            // The inner ones, from which all are counted towards the middle.
            let (a, c) = (4 * pair + 3, 4 * (self.inner() - pair) - 1);
            let both = |factor, row: usize, k: isize| {
                let left = entry(factor, a + row, a.checked_add_signed(k));
                [left, entry(factor, c - row, c.checked_add_signed(-k))].map(Option::unwrap_or_default)
            };
            let l = |row, k| both(f.lower, row, k);
            let u = |row, k| both(f.upper, row, k);
            let own = |row| [a + row, c - row].map(|i| f.inverse[self.step(i)]);
            *down = [l(2, 1), l(2, 3), l(0, -1), l(0, 1), l(0, -2), l(0, 2), l(0, -4)];
            let [inner, middle] = [[own(0), u(0, 4)], [own(2), u(2, 4)]];
            let [far, near] = [[own(1), u(1, 0), u(1, 2)], [own(3), u(3, 4), u(3, 2)]];
            *up =
                [inner[0], inner[1], middle[0], middle[1], u(2, 0), far[0], far[1], far[2], near[0], near[1], near[2]];
        }
    }

    /// In which order what is in between goes down, where it begins, in which order it goes up, and where the right end
    /// begins.
    pub(super) fn middle_orders(&self) -> (&'static [usize], usize, &'static [usize], usize) {
        let (down, up): (&[usize], &[usize]) =
            if self.inner().is_multiple_of(2) { (&[2, 0, 4], &[4, 0, 2, 1, 3]) } else { (&[0], &[0]) };
        (down, 4 * self.pairs() + 3, up, 4 * self.inner())
    }

    /// A right side becomes the solution.
    ///
    /// # Panics
    /// Where the factors are not those of the line, or `b` is shorter than it.
    pub(super) fn substitute<T: Scalar>(&self, f: Factors<'_, T>, packed: &[[T; 2]], b: &mut [f64]) {
        let (n, pairs) = (self.n, self.pairs());
        let b = &mut b[..n * T::PARTS];
        let (down, up) = packed.split_at(DOWN * pairs);
        let less = |i: usize, b: &mut [f64]| f.take(T::at(b, i), f.lower, self.step(i), b).put(b, i);
        let find = |i: usize, b: &mut [f64]| {
            let step = self.step(i);
            f.take(T::at(b, i).times(f.inverse[step]), f.upper, step, b).put(b, i);
        };
        let (between_down, between, between_up, end) = self.middle_orders();
        less(1, b);
        if end + 1 < n {
            less(end + 1, b);
        }
        let beyond = |i: usize, b: &[f64]| if i < n { T::at(b, i) } else { T::default() };
        let mut old_outer = T::two([T::at(b, 2), beyond(end, b)]);
        let mut old_middle = T::two([T::at(b, 1), beyond(end + 1, b)]);
        let mut chain = T::two([T::default(); 2]);
        for mut cell in cells::<T, DOWN>(down, pairs, end, b) {
            let l = |i: usize| T::two(cell.factors[i]);
            let (outer, new_outer) = (cell.get(1), cell.get(3));
            let middle = T::less_two(T::less_two(cell.get(2), l(0), outer), l(1), new_outer);
            let sum = T::less_two(T::less_two(cell.get(0), l(2), old_outer), l(3), outer);
            let sum = T::less_two(T::less_two(sum, l(4), old_middle), l(5), middle);
            chain = T::less_two(sum, l(6), chain);
            (old_outer, old_middle) = (new_outer, middle);
            cell.put(0, chain);
            cell.put(2, middle);
        }
        between_down.iter().for_each(|i| less(between + i, b));
        between_up.iter().for_each(|i| find(between + i, b));
        let mut chain = T::two([T::at(b, between), T::at(b, end - between + 2)]);
        for mut cell in cells::<T, UP>(up, pairs, end, b).rev() {
            let u = |i: usize| T::two(cell.factors[i]);
            let own = |i: usize, inverse| T::times_two(cell.get(i), inverse);
            let inner = T::less_two(own(0, u(0)), u(1), chain);
            let middle = T::less_two(T::less_two(own(2, u(2)), u(3), chain), u(4), inner);
            let far = T::less_two(T::less_two(own(1, u(5)), u(6), inner), u(7), middle);
            let near = T::less_two(T::less_two(own(3, u(8)), u(9), chain), u(10), middle);
            chain = inner;
            cell.put(0, inner);
            cell.put(1, far);
            cell.put(2, middle);
            cell.put(3, near);
        }
        for i in [1, 0, 2, end + 1, end, end + 2].into_iter().filter(|i| *i < n) {
            find(i, b);
        }
    }
}

/// Four unknowns of each end, with the factors for them.
struct Cell<'a, T, const N: usize> {
    factors: &'a [[T; 2]; N],
    left: &'a mut [f64],
    right: &'a mut [f64],
}

impl<T: Scalar, const N: usize> Cell<'_, T, N> {
    /// The i-th of each end, counted from the inner one towards the middle.
    #[inline(always)]
    fn get(&self, i: usize) -> T::Two {
        T::two([T::at(self.left, i), T::at(self.right, 3 - i)])
    }

    /// Becomes the i-th of each end.
    #[inline(always)]
    fn put(&mut self, i: usize, x: T::Two) {
        let [x, y] = T::each(x);
        x.put(self.left, i);
        y.put(self.right, 3 - i);
    }
}

/// All of them, from the ends to the middle.
#[inline(always)]
fn cells<'a, T: Scalar, const N: usize>(
    packed: &'a [[T; 2]],
    pairs: usize,
    end: usize,
    b: &'a mut [f64],
) -> impl DoubleEndedIterator<Item = Cell<'a, T, N>> {
    let (left, right) = b[..end * T::PARTS].split_at_mut((4 * pairs + 3) * T::PARTS);
    let left = left[3 * T::PARTS..].chunks_exact_mut(4 * T::PARTS);
    let from = right.len() - 4 * pairs * T::PARTS;
    let right = right[from..].rchunks_exact_mut(4 * T::PARTS);
    let each = packed.as_chunks::<N>().0.iter().zip(left).zip(right);
    each.map(|((factors, left), right)| Cell { factors, left, right })
}
