//! The chord start: two updates with one matrix (the simplified Newton method), how an iteration of few unknowns
//! begins, and mostly ends.
//!
//! # What is done
//! At the start, with residual `r` and Jacobian `J`; the numbers are those of [`ChordOptions`]:
//!
//! 1. `J`, like `r` without what is next to nothing ([`ir::Newton::small`]), is eliminated without pivots (of two
//!    unknowns: by Cramer's rule), and `d = J^-1 r`, `u = u - d`.
//! 2. With `z_i = |u_i| + s_i`, where these are at most 1e100 (else it begins anew as in 5): done where each
//!    `|d_i| <= 4e-16 z_i`, and nothing was left out in 1.
//! 3. The residual there with the same elimination gives `e`. Where a `|d_i|` is above 1e-2 `z_i`: done where no entry
//!    of `J` there is off by more than a tenth, and `|e_i| <= 4e-16 z_i`. Else done where each `|e_i| <= 4e-16 |u_i|`,
//!    which the unknowns hardly show: its opposite becomes their rounding error. The next such update would be near
//!    `2 e_i² / d_i`: so it is done, with `u = u - e`, where for each unknown that is at most a quarter of `left z_i`,
//!    and `|e_i| <= 1e-11 z_i`; or `|e_i| <= 4e-16 z_i`. Each unknown counts by itself, since those that converge at
//!    once say nothing of the others.
//!
//!    Of one equation, where that is not all, and `|e| <= |d| / 10`, `e` becomes `e + 2 e² / d`: the slope there, as
//!    the two residuals determine it, is `(1 - 2 e / d) J`, and the method is of order 4 (Ostrowski, Solution of
//!    equations and systems of equations, 1960). Then the next one would be near `e² / d² e`, but that the third
//!    derivative counts, most so where the second is 0 by chance: so it is done where `|e / d| (|e / d| + |d / z|) |e|`
//!    is at most an eighth of `left z`, and `|e| <= 1e-11 z`: where a law has a corner none of this is so.
//! 4. Else, with `|v| = Σ |v_i| / z_i`, where `10 |e| <= |d|` or rounding alone seems to be left, `|e| <= 1e-12`, the
//!    iteration of [`crate::solve::newton`] goes on from `u - e` as after one that made the update `e`.
//! 5. Else it begins anew from the start that was given apart from a predicted one; where there is none, it goes on
//!    from `u`, as after an iteration that made the update `d`, unless an exponential of an unknown may have taken that
//!    too far ([`ir::Newton::knees`]). Where `|d|` is not finite it begins anew in any case.
//!
//! An elimination without pivots that lost digits shows as an `e` that is not small, or as one that leaves the residual
//! unexplained: it is done only where each `|r_i| <= 2 Σ |J_ij| (|d_j| + 4e-16 z_j)`, which is to be finite, with the
//! residual and the update before the end; else it begins anew as in 5. Far up an exponential the slope is all that is
//! left of the equations, and so it is where a root begins: an update of 0 would look like a solution.
//! What was predicted never decides whether a solution is found: where the iteration fails from 4, it begins anew as
//! in 5.
//!
//! Counted is one iteration.

use super::{DONE, Equations, Iteration, either};
use crate::ir;
use crate::machine::{Exit, Flow, Machine, Number, Variable};
use crate::options::{ChordOptions, NewtonOptions};

/// More unknowns than this do not begin so.
pub const MAX_UNKNOWNS: usize = 8;

/// Which entries of a matrix may be other than 0 in its elimination.
#[derive(Clone, Debug)]
pub struct Pattern {
    n: usize,
    /// Row and column of each entry of the matrix as it is given.
    places: Vec<(u32, u32)>,
    filled: Vec<bool>,
}

impl Pattern {
    /// That of an iteration that begins so; None of others.
    pub fn of(newton: &ir::Newton, options: &ChordOptions) -> Option<Self> {
        let n = newton.residual.len();
        let plain = newton.body.iter().all(|i| !matches!(i, ir::Inst::Newton(_)));
        if !(1..=MAX_UNKNOWNS).contains(&n)
            || newton.affine
            || newton.corners
            || !newton.update.is_empty()
            || newton.body.len() > options.instructions
            || !plain
        {
            return None;
        }
        Self::new(n, newton.jacobian.iter().map(|t| (t.0, t.1)).collect())
    }

    /// That of entries (row, column); None where a pivot is missing whatever the numbers.
    ///
    /// # Panics
    /// Where an entry is not within `n` rows and columns.
    pub fn new(n: usize, places: Vec<(u32, u32)>) -> Option<Self> {
        let mut filled = vec![false; n * n];
        places.iter().for_each(|(i, j)| filled[*i as usize * n + *j as usize] = true);
        if n == 2 {
            return (filled[0] && filled[3] || filled[1] && filled[2]).then_some(Self { n, places, filled });
        }
        for k in 0..n {
            if !filled[k * n + k] {
                return None;
            }
            for i in (k + 1..n).filter(|i| filled[i * n + k]).collect::<Vec<_>>() {
                for j in k + 1..n {
                    filled[i * n + j] |= filled[k * n + j];
                }
            }
        }
        Some(Self { n, places, filled })
    }

    /// Whether an entry may be other than 0.
    fn has(&self, i: usize, j: usize) -> bool {
        self.filled[i * self.n + j]
    }
}

/// Whether all of some conditions hold.
fn all<M: Machine>(m: M, conditions: impl Iterator<Item = M::Condition>) -> M::Condition {
    conditions.fold(m.known(true), |all, c| all & c)
}

/// An eliminated matrix: below the diagonal what rows are taken times, on it one over the pivots. That of two unknowns
/// stays, beside one over the determinant.
struct Eliminated<'p, T, const N: usize> {
    pattern: &'p Pattern,
    a: [[T; N]; N],
    inverse: T,
}

impl<'p, T: Number, const N: usize> Eliminated<'p, T, N> {
    fn new(one: T, pattern: &'p Pattern, mut a: [[T; N]; N]) -> Self {
        if N == 2 {
            let inverse = one / (a[0][0] * a[1][1] - a[0][1] * a[1][0]);
            return Self { pattern, a, inverse };
        }
        for k in 0..N {
            a[k][k] = one / a[k][k];
            for i in (k + 1..N).filter(|i| pattern.has(*i, k)) {
                let l = a[i][k] * a[k][k];
                a[i][k] = l;
                for j in (k + 1..N).filter(|j| pattern.has(k, *j)) {
                    a[i][j] = a[i][j] - l * a[k][j];
                }
            }
        }
        Self { pattern, a, inverse: one }
    }

    fn solve(&self, right: &[T; N]) -> [T; N] {
        let (a, mut x) = (&self.a, *right);
        if N == 2 {
            let (p, q) = (x[0] * a[1][1] - a[0][1] * x[1], a[0][0] * x[1] - x[0] * a[1][0]);
            (x[0], x[1]) = (p * self.inverse, q * self.inverse);
            return x;
        }
        for k in 0..N {
            for i in (k + 1..N).filter(|i| self.pattern.has(*i, k)) {
                x[i] = x[i] - a[i][k] * x[k];
            }
        }
        for k in (0..N).rev() {
            let later = (k + 1..N).filter(|j| self.pattern.has(k, *j));
            x[k] = later.fold(x[k], |rest, j| rest - a[k][j] * x[j]) * a[k][k];
        }
        x
    }
}

/// What is left of the beginning, where that is not all.
pub(super) struct Begun<M: Machine> {
    /// Whether the iteration goes on, rather than begins anew.
    on: M::Variable,
    /// Whether it begins anew where it fails.
    pub(super) again: M::Variable,
    /// Where it begins anew.
    start: [M::Number; MAX_UNKNOWNS],
}

impl<M: Machine> Begun<M> {
    /// Brings the iteration to where it goes on.
    pub(super) fn go_on(&self, it: &Iteration<'_, M>) {
        let (m, (update, residual)) = (it.m, &it.places.begun);
        either(
            m,
            self.on.get().is_set(),
            || {
                m.each(it.method.n, |i| m.put(&it.places.update, i, m.at(update, i)));
                let square = it.weights.square(|i| m.at(update, i));
                it.before.set(square);
                it.least.set(square);
                it.best.set(it.weights.square(|i| m.at(residual, i)));
                it.made.set(m.number(1.0));
            },
            || self.anew(it),
        );
    }

    /// Puts the unknowns where it begins anew.
    pub(super) fn anew(&self, it: &Iteration<'_, M>) {
        (0..it.method.n).for_each(|i| it.put(it.m.place(i), self.start[i]));
    }

    /// Keeps an update, and the residual before it.
    fn keep(&self, it: &Iteration<'_, M>, update: &[M::Number], residual: &[M::Number]) {
        let m = it.m;
        for (i, (d, r)) in update.iter().zip(residual).enumerate() {
            m.put(&it.places.begun.0, m.place(i), *d);
            m.put(&it.places.begun.1, m.place(i), *r);
        }
        self.on.set(m.number(1.0));
    }
}

/// Begins an iteration.
///
/// # Errors
/// Where the equations fail.
pub(super) fn begin<M: Machine>(
    it: &Iteration<'_, M>,
    pattern: &Pattern,
    equations: &mut impl Equations<M>,
) -> Result<Begun<M>, Exit> {
    let (m, zero) = (it.m, it.m.number(0.0));
    let from = it.places.cold.as_ref().unwrap_or(&it.places.unknowns);
    let start = std::array::from_fn(|i| if i < pattern.n { m.at(from, m.place(i)) } else { zero });
    let begun = Begun { on: m.holding(zero), again: m.holding(zero), start };
    it.started();
    m.repeat(|| match pattern.n {
        1 => Start::<M, 1>::run(it, pattern, &begun, equations),
        2 => Start::<M, 2>::run(it, pattern, &begun, equations),
        3 => Start::<M, 3>::run(it, pattern, &begun, equations),
        4 => Start::<M, 4>::run(it, pattern, &begun, equations),
        5 => Start::<M, 5>::run(it, pattern, &begun, equations),
        6 => Start::<M, 6>::run(it, pattern, &begun, equations),
        7 => Start::<M, 7>::run(it, pattern, &begun, equations),
        _ => Start::<M, MAX_UNKNOWNS>::run(it, pattern, &begun, equations),
    })?;
    Ok(begun)
}

/// What `N` equations are somewhere: the residual, and the matrix.
struct Computed<T, const N: usize> {
    residual: [T; N],
    matrix: [[T; N]; N],
}

/// A start of `N` unknowns on its way.
struct Start<'i, 'p, M: Machine, const N: usize> {
    it: &'i Iteration<'p, M>,
    pattern: &'p Pattern,
    m: M,
    /// The sizes of the unknowns after the first update.
    z: [M::Number; N],
}

impl<'i, 'p, M: Machine, const N: usize> Start<'i, 'p, M, N> {
    fn run(
        it: &'i Iteration<'p, M>,
        pattern: &'p Pattern,
        begun: &Begun<M>,
        equations: &mut impl Equations<M>,
    ) -> Flow {
        let (m, o, options) = (it.m, &it.method.options.chord, &it.method.options);
        let rounding = m.tolerance(options.rounding);
        let mut this = Self { it, pattern, m, z: [m.number(0.0); N] };
        let first = this.compute(equations, true)?;
        let matrix = Eliminated::new(m.number(1.0), pattern, first.matrix);
        let d = matrix.solve(&first.residual);
        this.take(&d);
        let there: [M::Number; N] = std::array::from_fn(|i| it.unknown(m.place(i)));
        this.z = std::array::from_fn(|i| there[i].abs() + m.at(&it.places.scale, m.place(i)));
        let this = this;
        let range = m.number(o.range);
        m.when(!all(m, this.z.iter().map(|z| z.at_most(range))), || m.leave())?;
        if !it.method.coarse {
            m.when(this.at_most(&d, rounding), || this.done(&first.matrix, &first.residual, &d, || {}))?;
        }
        let second = this.compute(equations, false)?;
        let e = matrix.solve(&second.residual);
        let near = this.at_most(&d, m.number(o.near));
        let hidden = all(m, (0..N).map(|i| e[i].abs().at_most(rounding * there[i].abs())));
        let done = |e: &[M::Number; N], end: &dyn Fn()| this.done(&first.matrix, &second.residual, e, end);
        // Less than the unknowns can show: so nobody need wait for it.
        m.when(hidden & near.clone(), || done(&e, &|| (0..N).for_each(|i| it.leave(m.place(i), e[i]))))?;
        m.when(
            all(m, (0..N).map(|i| is_last(m, options, (d[i], e[i]), this.z[i], it.method.left))) & near.clone(),
            || done(&e, &|| this.take(&e)),
        )?;
        let mut e = e;
        if N == 1 {
            e[0] = corrected(m, o.corrected, d[0], e[0]);
        }
        // Far from the start it ends where the matrix is still the same, and rounding is left.
        m.when(!near.clone() & this.at_most(&e, rounding), || {
            let alike = pattern.places.iter().map(|&(i, j)| {
                let (a, b) = (second.matrix[i as usize][j as usize], first.matrix[i as usize][j as usize]);
                (a - b).abs().at_most(m.number(o.alike) * b.abs())
            });
            m.when(all(m, alike), || done(&e, &|| this.take(&e)))
        })?;
        if N == 1 {
            m.when(is_last_alone(m, options, (d[0], e[0]), this.z[0], it.method.left) & near, || {
                done(&e, &|| this.take(&e))
            })?;
        }
        let (whole, part) = (this.sum(&d), this.sum(&e));
        m.when(!whole.is_finite(), || m.leave())?;
        let good = part.at_most(m.number(o.good) * whole) | part.at_most(m.tolerance(o.stalled));
        m.branch(
            good,
            || {
                this.take(&e);
                begun.keep(it, &e, &second.residual);
                begun.again.set(m.number(1.0));
                Ok(())
            },
            || {
                if !it.method.predicted && it.method.knees.is_empty() {
                    begun.keep(it, &d, &first.residual);
                }
                Ok(())
            },
        )?;
        m.leave()
    }

    /// The equations at the unknowns as they are.
    fn compute(&self, equations: &mut impl Equations<M>, coarse: bool) -> Result<Computed<M::Number, N>, Exit> {
        let m = self.m;
        equations.evaluate(m, coarse)?;
        let from = equations.residual();
        let residual = std::array::from_fn(|i| m.at(&from, m.place(i)));
        let mut matrix = [[m.number(0.0); N]; N];
        for (k, (i, j)) in self.pattern.places.iter().enumerate() {
            matrix[*i as usize][*j as usize] = equations.entry(m, k);
        }
        Ok(Computed { residual, matrix })
    }

    /// Takes an update off the unknowns.
    fn take(&self, update: &[M::Number; N]) {
        (0..N).for_each(|i| self.it.take(self.m.place(i), update[i]));
    }

    /// Whether an update is at most this part of the sizes.
    fn at_most(&self, update: &[M::Number; N], part: M::Number) -> M::Condition {
        all(self.m, update.iter().zip(&self.z).map(|(d, z)| d.abs().at_most(part * *z)))
    }

    /// `Σ |v_i| / z_i`
    fn sum(&self, v: &[M::Number; N]) -> M::Number {
        v.iter().zip(&self.z).fold(self.m.number(0.0), |sum, (v, z)| sum + v.abs() / *z)
    }

    /// Ends with an update, where it and what rounding leaves of the unknowns come up to the residual; else begins
    /// anew.
    fn done(
        &self,
        matrix: &[[M::Number; N]; N],
        residual: &[M::Number; N],
        update: &[M::Number; N],
        end: impl Fn(),
    ) -> Flow {
        let explained = self.explained(matrix, residual, update);
        self.m.branch(
            explained,
            || {
                end();
                self.it.finish(DONE)
            },
            || self.m.leave(),
        )
    }

    /// Whether an update and what rounding leaves of the unknowns come up to a residual, by a matrix that is finite.
    /// One equation is divided by its slope, which loses nothing; of two an infinite entry leaves no number.
    fn explained(
        &self,
        matrix: &[[M::Number; N]; N],
        residual: &[M::Number; N],
        update: &[M::Number; N],
    ) -> M::Condition {
        let m = self.m;
        if N == 1 {
            return matrix[0][0].is_finite();
        }
        let rounding = m.tolerance(self.it.method.options.rounding);
        let reach: [M::Number; N] = std::array::from_fn(|i| update[i].abs() + rounding * self.z[i]);
        let mut sum = [m.number(0.0); N];
        for &(i, j) in &self.pattern.places {
            let (i, j) = (i as usize, j as usize);
            sum[i] = sum[i] + matrix[i][j].abs() * reach[j];
        }
        let near = sum.iter().zip(residual).map(|(sum, r)| {
            let finite = if N > 2 { sum.is_finite() } else { m.known(true) };
            finite & r.abs().at_most(m.number(2.0) * *sum)
        });
        all(m, near)
    }
}

/// Whether a second update of an unknown is its last, after the first and beside its size, of which a part may be left.
fn is_last<M: Machine>(
    m: M,
    o: &NewtonOptions,
    (first, second): (M::Number, M::Number),
    z: M::Number,
    left: f64,
) -> M::Condition {
    let (first, second) = (first.abs(), second.abs());
    let next = m.number(o.chord.next) * second * second;
    let near = next.at_most(m.tolerance(left) * z * first);
    second.at_most(m.tolerance(o.rounding) * z) | (near & second.at_most(m.tolerance(o.last) * z))
}

/// The second update of one equation by the slope there, as the residuals determine it, where it is at most `part` of
/// the first.
fn corrected<M: Machine>(m: M, part: f64, first: M::Number, second: M::Number) -> M::Number {
    let more = second * second * (m.number(2.0) / first);
    m.select(second.abs().at_most(m.number(part) * first.abs()), second + more, second)
}

/// As [`is_last`], of one equation, whose second update was corrected.
fn is_last_alone<M: Machine>(
    m: M,
    o: &NewtonOptions,
    (first, second): (M::Number, M::Number),
    z: M::Number,
    left: f64,
) -> M::Condition {
    let two = m.number(2.0);
    let (size, part) = (first.abs(), second.abs() * (two / first).abs());
    let second = second.abs();
    let next = second * part * (part + two * (size / z)) * m.number(o.chord.next / 4.0);
    let near = next.at_most(m.tolerance(left) * z)
        & second.at_most(m.number(o.chord.corrected) * size)
        & second.at_most(m.tolerance(o.last) * z);
    second.at_most(m.tolerance(o.rounding) * z) | near
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Real;
    use crate::options::NewtonOptions;
    use crate::solve::testing::Random;

    fn eliminations<const N: usize>(random: &mut Random) {
        for _ in 0..50 {
            let mut places: Vec<(u32, u32)> = Vec::new();
            for k in 0..N * N {
                let (i, j) = (k / N, k % N);
                if i == j || random.next() > 0.2 {
                    places.push((i as u32, j as u32));
                }
            }
            let mut a = [[0.0; N]; N];
            for (i, j) in &places {
                a[*i as usize][*j as usize] = 0.3 * random.next() + if i == j { 3.0 } else { 0.0 };
            }
            let x: [f64; N] = std::array::from_fn(|_| random.next());
            let b = a.map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum::<f64>());
            let pattern = Pattern::new(N, places).expect("there is a diagonal");
            for (x, b) in x.iter().zip(&Eliminated::new(1.0, &pattern, a).solve(&b)) {
                assert!((x - b).abs() < 1e-13, "{N}: {x} {b}");
            }
        }
    }

    #[test]
    fn eliminations_solve() {
        let mut random = Random::new(3);
        eliminations::<1>(&mut random);
        eliminations::<2>(&mut random);
        eliminations::<3>(&mut random);
        eliminations::<5>(&mut random);
        eliminations::<8>(&mut random);
    }

    #[test]
    fn a_pivot_that_is_never_there_is_seen() {
        assert!(Pattern::new(3, vec![(0, 0), (1, 2), (2, 1)]).is_none());
        assert!(Pattern::new(3, vec![(0, 0), (0, 1), (1, 0), (1, 2), (2, 1)]).is_some());
        assert!(Pattern::new(2, vec![(0, 1), (1, 0)]).is_some());
    }

    #[test]
    fn second_updates_of_one_equation_are_of_order_four() {
        // exp(x) = 2, from so far off.
        let corrected = |first, second| corrected(Real::new(), 0.1, first, second);
        let off = |start: f64| {
            let f = |x: f64| crate::eval::unary(crate::ir::Unary::Exp, x) - 2.0;
            let (root, slope) = (std::f64::consts::LN_2, f(start) + 2.0);
            let d = f(start) / slope;
            let e = f(start - d) / slope;
            start - d - corrected(d, e) - root
        };
        let (near, far) = (off(std::f64::consts::LN_2 + 0.01), off(std::f64::consts::LN_2 + 0.02));
        assert!((14.0..18.0).contains(&(far / near)), "{near:e} {far:e}");
        // What is not near is left.
        assert!(corrected(1.0, 0.2) == 0.2 && corrected(0.0, 1.0) == 1.0);
    }

    #[test]
    fn last_updates() {
        let (m, o) = (Real::new(), NewtonOptions::DEFAULT);
        let is_last = |first, second, z| is_last(m, &o, (first, second), z, o.rounding);
        assert!(is_last(1e-4, 1e-11, 1.0) && is_last(1.0, 1e-16, 1.0) && is_last(0.0, 1e-17, 0.1));
        assert!(!is_last(1e-4, 1e-9, 1.0) && !is_last(1e-9, 9e-10, 1.0) && !is_last(0.0, 1e-12, 1.0));
        assert!(!is_last(f64::NAN, 0.1, 1.0) && !is_last(1.0, f64::NAN, 1.0) && !is_last(1.0, 1e-20, f64::NAN));
        let is_last = |first, second| is_last_alone(m, &o, (first, second), 1.0, 1e-20);
        assert!(is_last(1e-5, 1e-12) && is_last(-1e-5, 1e-12) && is_last(1e-4, -1e-14) && is_last(1e-6, 1e-17));
        assert!(!is_last(1e-10, 1e-12) && !is_last(1e-5, 1e-9) && !is_last(1e-9, 1e-9) && !is_last(f64::NAN, 1e-12));
        // Less may be left of what adds up.
        assert!(!super::is_last(m, &o, (1e-4, 1e-11), 1.0, 1e-20));
        assert!(super::is_last(m, &o, (1e-4, 1e-13), 1.0, 1e-20));
    }
}
