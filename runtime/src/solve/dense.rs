//! Small and middling dense systems: Gauss' elimination with scaled partial pivoting, for every [`Machine`].

use super::iteration::{SOLVED, UNDETERMINED};
use crate::machine::{Bound, Flow, Machine, Number, Real, Variable, cells};
use crate::options::LinearOptions;
use std::cell::Cell;

/// Solves `a x = b` in place: `a`, row-major, is destroyed; `b` becomes `x`. Says whether something was left
/// undetermined. It is [`eliminate`] on numbers.
///
/// # Errors
/// The row for which no pivot is found, counted in the order given. `x` may still be infinite or NaN where the matrix
/// held such numbers.
///
/// # Panics
/// Where `a` is shorter than `n * n`, `b` or `scratch` shorter than `n`.
pub fn solve(n: usize, a: &mut [f64], b: &mut [f64], scratch: &mut Scratch, undetermined: bool) -> Result<bool, usize> {
    let (a, b) = (&mut a[..n * n], &mut b[..n]);
    let Scratch { order, column, scale, inverse, parked, sums, matrix, right } = scratch;
    if undetermined {
        matrix.clear();
        matrix.extend_from_slice(a);
        right.clear();
        right.extend_from_slice(b);
    }
    let places = Places {
        matrix: cells(a),
        right: cells(b),
        given: if undetermined { Given::Copied(cells(matrix), cells(right)) } else { Given::There },
        column: cells(column),
        scale: cells(scale),
        inverse: cells(inverse),
        order: cells(order),
        parked: cells(parked),
        sums: cells(sums),
    };
    let row = Cell::new(SOLVED);
    eliminate(Real::new(), n, &places, &row, undetermined);
    match row.get() {
        SOLVED => Ok(false),
        UNDETERMINED => Ok(true),
        row => Err(row as usize),
    }
}

/// Matrix and right side as they are given, which are put in their places first. If something may be left undetermined,
/// that may be done again.
pub enum Given<M: Machine> {
    /// They are in their places.
    There,
    /// All numbers of both.
    Copied(M::Vector, M::Vector),
    /// So many entries of the matrix, each with its place, all others being 0; and the right side, if it is not in its
    /// place.
    Entries(M::Vector, M::Table, usize, Option<M::Vector>),
}

/// Where the numbers of an elimination of `n` unknowns are.
pub struct Places<M: Machine> {
    /// The matrix, row by row. It is destroyed.
    pub matrix: M::Vector,
    /// The right side, which becomes the solution.
    pub right: M::Vector,
    /// The same as they are given.
    pub given: Given<M>,
    /// Room for the largest numbers of the columns.
    pub column: M::Vector,
    /// Room for one over those of the rows.
    pub scale: M::Vector,
    /// Room for one over the pivots.
    pub inverse: M::Vector,
    /// Room for the number of each row as it was given.
    pub order: M::Vector,
    /// Room for whether unknowns are left; used where something may be left undetermined, like the last.
    pub parked: M::Vector,
    /// Room for the sizes of what right sides are made of.
    pub sums: M::Vector,
}

/// Solves `a x = b`. `row` becomes [`SOLVED`], or [`UNDETERMINED`] where something was left so, or the row for which no
/// pivot is found, counted in the order given.
///
/// With `s_i = 1 / max_j |a_ij|` and `c_k = max_i |a_ik| s_i` of the matrix as it is given, for each column `k` in
/// turn: the pivot is the first of the rows from `k` on whose `|a_ik| s_i` is largest, and there is none where that is
/// at most `tiny c_k` ([`LinearOptions`]); it is exchanged with row `k`; with `r_k = 1 / a_kk`, each later row loses
/// `(a_ik r_k)` times row `k`. Then, from the last, `x_k = (b_k - a_k,k+1 x_k+1 - ...) r_k`, subtracted from left to
/// right. One unknown is divided; two are solved by Cramer's rule, where that keeps digits.
///
/// Where equations may leave unknowns `undetermined`, as what two frictions on both sides of a gear hold each, a row of
/// zeros, as of ideal diodes in a ring that all conduct, has `s_i = 0`; and where a pivot is at most `poor c_k`, row
/// `k` is exchanged with the first of the rows from `k` on of which least is left, `max_j>k |a_ij| s_i`, and `r_k =
/// s_k`. It says what other rows said where what is left of it then, `b_k - a_k,k+1 x_k+1 - ...`, is at most `alike`
/// times the sum of `b_k` as it was given and what was taken off it, each by its size; so `x_k = 0`. Else all is done
/// again, as where nothing may be undetermined.
pub fn eliminate<M: Machine>(m: M, n: usize, places: &Places<M>, row: &M::Variable, undetermined: bool) {
    let options = LinearOptions::DEFAULT;
    row.set(m.number(SOLVED));
    let may = undetermined.then(|| m.holding(m.number(1.0)));
    let elimination = Elimination { m, n, places, row, may, options: &options };
    // Nothing in it fails.
    let _ = match n {
        1 => elimination.one(),
        2 => elimination.two(),
        _ => elimination.pivoted(),
    };
}

/// An elimination on its way.
struct Elimination<'e, M: Machine> {
    m: M,
    n: usize,
    places: &'e Places<M>,
    row: &'e M::Variable,
    /// Whether unknowns may be left undetermined, as yet.
    may: Option<M::Variable>,
    options: &'e LinearOptions,
}

/// The larger; where one is no number, the first.
fn larger<M: Machine>(m: M, a: M::Number, b: M::Number) -> M::Number {
    m.select(a.below(b), b, a)
}

impl<M: Machine> Elimination<'_, M> {
    fn get(&self, vector: &M::Vector, i: usize) -> M::Number {
        self.m.at(vector, self.m.place(i))
    }

    fn entry(&self, i: M::Index, j: M::Index) -> M::Number {
        self.m.at(&self.places.matrix, self.m.cell(i, self.n, j))
    }

    /// Goes through rows or columns from one on.
    fn from(&self, first: Bound<M>, body: impl FnMut(M::Index) -> Flow) -> Flow {
        self.m.span(first, Bound::Known(self.n), body)
    }

    /// The same, where nothing leaves.
    fn each_from(&self, first: Bound<M>, body: impl FnMut(M::Index)) {
        self.m.over(first, Bound::Known(self.n), body);
    }

    /// Ends without a solution.
    fn fail(&self, row: M::Number) -> Flow {
        self.row.set(row);
        self.m.leave()
    }

    /// Matrix and right side as they are given.
    fn given(&self) -> (&M::Vector, &M::Vector) {
        match &self.places.given {
            Given::Copied(matrix, right) => (matrix, right),
            Given::There | Given::Entries(..) => {
                self.put_in_place();
                (&self.places.matrix, &self.places.right)
            }
        }
    }

    /// Puts matrix and right side in their places.
    fn put_in_place(&self) {
        let (m, places, all) = (self.m, self.places, Bound::Known(0));
        let put_right = |right: &M::Vector| self.each_from(all, |i| m.put(&places.right, i, m.at(right, i)));
        match &places.given {
            Given::There => {}
            Given::Copied(matrix, right) => {
                self.each_from(all, |i| {
                    self.each_from(all, |j| {
                        let at = m.cell(i, self.n, j);
                        m.put(&places.matrix, at, m.at(matrix, at));
                    });
                });
                put_right(right);
            }
            Given::Entries(values, which, count, right) => {
                m.each(self.n * self.n, |i| m.put(&places.matrix, i, m.number(0.0)));
                m.each(*count, |e| m.put(&places.matrix, m.through(*which, e), m.at(values, e)));
                right.iter().for_each(put_right);
            }
        }
    }

    fn one(&self) -> Flow {
        let (m, (a, b)) = (self.m, self.given());
        let (a, b, zero) = (self.get(a, 0), self.get(b, 0), m.number(0.0));
        m.put(&self.places.right, m.place(0), b / a);
        m.only(a.equals(zero), || self.row.set(zero));
        Ok(())
    }

    /// By Cramer's rule where the determinant has digits, else with pivots.
    fn two(&self) -> Flow {
        let (m, o, (a, b)) = (self.m, self.options, self.given());
        let a: [M::Number; 4] = std::array::from_fn(|i| self.get(a, i));
        let b: [M::Number; 2] = std::array::from_fn(|i| self.get(b, i));
        let (p, q) = (a[0] * a[3], a[1] * a[2]);
        let det = p - q;
        let size = det.abs();
        let digits = (m.number(o.digits) * (p.abs() + q.abs())).below(size);
        let plain = digits & m.number(o.range.0).below(size) & size.below(m.number(o.range.1));
        m.branch(
            plain,
            || {
                let inverse = m.number(1.0) / det;
                let right = &self.places.right;
                m.put(right, m.place(0), (b[0] * a[3] - a[1] * b[1]) * inverse);
                m.put(right, m.place(1), (a[0] * b[1] - b[0] * a[2]) * inverse);
                Ok(())
            },
            || self.pivoted(),
        )
    }

    /// With scaled partial pivoting.
    fn pivoted(&self) -> Flow {
        let (m, all) = (self.m, Bound::Known(0));
        m.repeat(|| {
            self.put_in_place();
            self.scale()?;
            self.from(all, |k| self.column(k))?;
            m.span_back(all, Bound::Known(self.n), |k| self.substitute(k))?;
            m.leave()
        })
    }

    /// How large rows and columns are.
    fn scale(&self) -> Flow {
        let (m, zero, places, all) = (self.m, self.m.number(0.0), self.places, Bound::Known(0));
        self.each_from(all, |j| m.put(&places.column, j, zero));
        self.from(all, |i| {
            let [largest] =
                m.fold_span(all, Bound::Known(self.n), [zero], |j, [most]| [larger(m, most, self.entry(i, j).abs())]);
            let (empty, s) = (largest.equals(zero), m.number(1.0) / largest);
            let (fails, s) = match &self.may {
                // A row that says nothing is never chosen.
                Some(may) => (empty.clone() & !may.get().is_set(), m.select(empty, zero, s)),
                None => (empty, s),
            };
            m.when(fails, || self.fail(m.counted(i)))?;
            let is_first = m.known_place(i) == Some(0);
            self.each_from(all, |j| {
                let before = if is_first { zero } else { m.at(&places.column, j) };
                m.put(&places.column, j, larger(m, before, self.entry(i, j).abs() * s));
            });
            m.put(&places.scale, i, s);
            m.put(&places.order, i, m.counted(i));
            if self.may.is_some() {
                m.put(&places.sums, i, m.at(&places.right, i).abs());
            }
            Ok(())
        })
    }

    /// Finds the pivot of a column, and takes its row off the later ones.
    fn column(&self, k: M::Index) -> Flow {
        let (m, n, places, o) = (self.m, self.n, self.places, self.options);
        let later = Bound::Past(k, 1);
        let size = |i: M::Index| self.entry(i, k).abs() * m.at(&places.scale, i);
        let start = [m.counted(k), size(k)];
        let [mut p, best] = m.fold_span(later, Bound::Known(n), start, |i, [p, best]| {
            let other = size(i);
            let more = best.below(other);
            [m.select(more.clone(), m.counted(i), p), m.select(more, other, best)]
        });
        let column = m.at(&places.column, k);
        let mut none = best.at_most(m.number(o.tiny) * column);
        if let Some(may) = &self.may {
            let park = may.get().is_set() & best.at_most(m.tolerance(o.poor) * column);
            let chosen = m.holding(p);
            m.put(&places.parked, k, m.select(park.clone(), m.number(1.0), m.number(0.0)));
            m.only(park.clone(), || {
                chosen.set(self.emptiest(k));
                self.row.set(m.number(UNDETERMINED));
            });
            p = chosen.get();
            none = !park & none;
        }
        m.when(none, || self.fail(m.at(&places.order, k)))?;
        m.chosen(p, k, n, |i| self.exchange(k, i));
        let mut inverse = m.number(1.0) / self.entry(k, k);
        if self.may.is_some() {
            let parked = m.at(&places.parked, k).is_set();
            inverse = m.select(parked, m.at(&places.scale, k), inverse);
        }
        m.put(&places.inverse, k, inverse);
        let right = m.at(&places.right, k);
        self.each_from(later, |i| {
            let l = self.entry(i, k) * inverse;
            m.take_off(&places.matrix, n, (i, k), l);
            let term = l * right;
            m.put(&places.right, i, m.at(&places.right, i) - term);
            if self.may.is_some() {
                m.put(&places.sums, i, m.at(&places.sums, i) + term.abs());
            }
        });
        Ok(())
    }

    /// Exchanges two rows, of which what is before column `k` counts no more.
    fn exchange(&self, k: M::Index, i: M::Index) {
        let (m, n, places) = (self.m, self.n, self.places);
        let swap = |vector: &M::Vector, i: M::Index, j: M::Index| {
            let (x, y) = (m.at(vector, i), m.at(vector, j));
            m.put(vector, i, y);
            m.put(vector, j, x);
        };
        self.each_from(Bound::Past(k, 0), |j| swap(&places.matrix, m.cell(k, n, j), m.cell(i, n, j)));
        [&places.right, &places.scale, &places.order].into_iter().for_each(|vector| swap(vector, k, i));
        if self.may.is_some() {
            swap(&places.sums, k, i);
        }
    }

    /// The first of the rows from `k` on of which least is left behind column `k`.
    fn emptiest(&self, k: M::Index) -> M::Number {
        let (m, later, end) = (self.m, Bound::Past(k, 1), Bound::Known(self.n));
        let left = |i: M::Index| {
            let start = [m.number(0.0)];
            let [most] = m.fold_span(later, end, start, |j, [most]| [larger(m, most, self.entry(i, j).abs())]);
            most * m.at(&self.places.scale, i)
        };
        let start = [m.counted(k), left(k)];
        let [p, _] = m.fold_span(later, end, start, |i, [p, least]| {
            let other = left(i);
            let less = other.below(least);
            [m.select(less.clone(), m.counted(i), p), m.select(less, other, least)]
        });
        p
    }

    /// Finds an unknown from those after it.
    fn substitute(&self, k: M::Index) -> Flow {
        let (m, n, places) = (self.m, self.n, self.places);
        let right = |i: M::Index| m.at(&places.right, i);
        let [rest] = m.fold_span(Bound::Past(k, 1), Bound::Known(n), [right(k)], |j, [rest]| {
            [rest - self.entry(k, j) * right(j)]
        });
        let mut value = rest * m.at(&places.inverse, k);
        if let Some(may) = &self.may {
            let parked = m.at(&places.parked, k).is_set();
            let bound = m.tolerance(self.options.alike) * m.at(&places.sums, k);
            m.when(parked.clone() & bound.below(rest.abs()), || {
                self.row.set(m.number(SOLVED));
                may.set(m.number(0.0));
                m.again()
            })?;
            value = m.select(parked, m.number(0.0), value);
        }
        m.put(&places.right, k, value);
        Ok(())
    }
}

/// Memory for [`solve`].
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    order: Vec<f64>,
    column: Vec<f64>,
    scale: Vec<f64>,
    inverse: Vec<f64>,
    parked: Vec<f64>,
    sums: Vec<f64>,
    /// Matrix and right side as they were given.
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl Scratch {
    /// Memory for `n` unknowns.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        let (matrix, right) = (Vec::with_capacity(n * n), Vec::with_capacity(n));
        Self {
            order: zeros(),
            column: zeros(),
            scale: zeros(),
            inverse: zeros(),
            parked: zeros(),
            sums: zeros(),
            matrix,
            right,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::testing::Random;

    #[test]
    fn random_systems_with_wild_units() {
        let mut random = Random::new(1);
        for n in 1..=24 {
            for _ in 0..40 {
                let rows: Vec<f64> = (0..n).map(|_| (30.0 * random.next()).exp2()).collect();
                let columns: Vec<f64> = (0..n).map(|_| (30.0 * random.next()).exp2()).collect();
                let a: Vec<f64> = (0..n * n).map(|k| random.next() * rows[k / n] * columns[k % n]).collect();
                let x: Vec<f64> = columns.iter().map(|c| random.next() / c).collect();
                let mut b: Vec<f64> = (0..n).map(|i| (0..n).map(|j| a[i * n + j] * x[j]).sum()).collect();
                let right = b.clone();
                solve(n, &mut a.clone(), &mut b, &mut Scratch::new(n), false).unwrap();
                for i in 0..n {
                    let (mut r, mut size) = (right[i], 0.0);
                    for j in 0..n {
                        r -= a[i * n + j] * b[j];
                        size += (a[i * n + j] * b[j]).abs();
                    }
                    assert!(r.abs() <= 1e-12 * size, "n {n} row {i} residual {r:e} of {size:e}");
                }
            }
        }
    }

    #[test]
    fn what_rows_leave_open_stays() {
        // A momentum, and two frictions about a gear: their rows say the same, to rounding.
        let row = |gear: f64| [-0.3 * gear, 0.0, 0.0];
        let matrix = [[1.0, 1e-6, 3e-7], row(1.0), row(0.7)].concat();
        let mut b = [0.1, -0.06, -0.06 * 0.7];
        let solve_so = |open, b: &mut [f64]| solve(3, &mut matrix.clone(), b, &mut Scratch::new(3), open);
        assert_eq!(solve_so(true, &mut b), Ok(true));
        assert!((b[0] - 0.2).abs() < 1e-15 && (b[1] + 1e5).abs() < 1e-9 && b[2] == 0.0, "{b:?}");
        // Of a row of zeros, as of laws that are all flat, another unknown is told nothing, wherever it stands; and so
        // of one that becomes such.
        for empty in [[0.0; 3], [2.0, -2.0, 0.0]] {
            let rows = [(empty, empty[0] / 2.0), ([1.0, -1.0, 0.0], 0.5), ([0.0, 0.0, 2.0], 3.0)];
            for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                let flat = order.map(|i| rows[i].0).concat();
                let mut b = order.map(|i| rows[i].1);
                let mut none = order.map(|i| if i == 0 { 1.5 } else { 0.5 });
                let mut scratch = Scratch::new(3);
                assert_eq!(solve(3, &mut flat.clone(), &mut b, &mut scratch, true), Ok(true), "{order:?}");
                assert_eq!((b[0] - b[1], b[2]), (0.5, 1.5), "{order:?}");
                assert!(solve(3, &mut flat.clone(), &mut none, &mut scratch, true).is_err(), "{order:?}");
            }
        }
        // Two that don't are left to themselves.
        let (mut b, mut same) = ([0.1, -0.06, 0.05], [0.1, -0.06, 0.05]);
        assert_eq!(solve_so(true, &mut b), solve_so(false, &mut same));
        assert_eq!(b.map(f64::to_bits), same.map(f64::to_bits));
    }

    #[test]
    fn singular_matrices_are_told() {
        for n in 1..8 {
            let mut a = vec![1.0; n * n];
            if n == 1 {
                a[0] = 0.0;
            }
            assert!(solve(n, &mut a, &mut vec![1.0; n], &mut Scratch::new(n), false).is_err(), "{n}");
        }
        // A row that is five times another: the determinant is rounding alone.
        let mut alike = [0.1, 0.3, 0.5, 1.5];
        assert!(alike[0] * alike[3] != alike[1] * alike[2]);
        assert_eq!(solve(2, &mut alike, &mut [1.0, 5.0], &mut Scratch::new(2), false), Err(1));
        let mut zero_row = [1.0, 2.0, 0.0, 0.0];
        assert_eq!(solve(2, &mut zero_row, &mut [1.0, 1.0], &mut Scratch::new(2), false), Err(1));
    }
}
