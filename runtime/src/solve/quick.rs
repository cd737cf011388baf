//! Two updates with one matrix: how an iteration of few unknowns begins, and mostly ends.
//!
//! # What is done
//! At the start, with residual `r` and Jacobian `J`:
//!
//! 1. `J`, like `r` without what is next to nothing ([`ir::Newton::small`]), is eliminated without pivots (of two
//!    unknowns: by Cramer's rule), and `d = J^-1 r`, `u = u - d`.
//! 2. With `z_i = |u_i| + s_i`, where these are at most 1e100 (else it begins anew as in 5): done where each
//!    `|d_i| <= 4e-16 z_i`, and nothing was left out in 1.
//! 3. The residual there with the same elimination gives `e`. Where a `|d_i|` is above 1e-2 `z_i`: done where no entry
//!    of `J` there is off by more than a tenth, and `|e_i| <= 4e-16 z_i`. Else done where each `|e_i| <= 4e-16 |u_i|`,
//!    which the unknowns hardly show: its opposite becomes the rests. The next such update would be near `2 e_i² / d_i`: so it is
//!    done, with `u = u - e`, where for each unknown that is at most a quarter of `left z_i`, and `|e_i| <= 1e-11 z_i`; or
//!    `|e_i| <= 4e-16 z_i`. Each unknown counts by itself, since those that converge at once say nothing of the others.
//!
//!    Of one equation, where that is not all, and `|e| <= |d| / 10`, `e` is sharpened to `e + 2 e² / d`: the slope there, as
//!    the two residuals tell it, is `(1 - 2 e / d) J`, and the method is of order 4 (Ostrowski, Solution of equations and
//!    systems of equations, 1960). Then the next one would be near `e² / d² e`, but that the third derivative counts, most so
//!    where the second is 0 by chance: so it is done where `|e / d| (|e / d| + |d / z|) |e|` is at most an eighth of
//!    `left z`, and `|e| <= 1e-11 z`: where a law bends at a point none of this is so.
//! 4. Else, with `|v| = Σ |v_i| / z_i`, where `10 |e| <= |d|` or rounding alone seems to be left, `|e| <= 1e-12`, the
//!    iteration of [`super::newton`] goes on from `u - e` as after one that made the update `e`.
//! 5. Else it begins anew from the start that was told apart from a foretold one; where there is none, it goes on from
//!    `u`, as after an iteration that made the update `d`, unless an exponential of an unknown may have taken that too
//!    far ([`ir::Newton::bends`]). Where `|d|` is not finite it begins anew in any case.
//!
//! An elimination without pivots that lost digits shows as an `e` that is not small, or as one that leaves the residual
//! unexplained: it is done only where each `|r_i| <= 2 Σ |J_ij| (|d_j| + 4e-16 z_j)`, which is to be finite, with the
//! residual and the update before the end; else it begins anew as in 5. Far up an exponential the slope is all that is
//! left of the equations, and so it is where a root begins: an update of 0 would look like a solution.
//! What was foretold never decides whether a solution is found: where the iteration fails from 4, it begins anew as
//! in 5.
//!
//! Counted is one iteration.

use super::newton::{self, Measure, Scratch, System};
use crate::ir;
use crate::kernel::Failure;

/// More unknowns than this are not begun so.
pub const UNKNOWNS: usize = 8;
/// Nor is a body of more instructions than this, which back ends write anew for it.
pub const INSTRUCTIONS: usize = 2000;
/// The part of the sizes that is rounding.
pub const ROUNDING: f64 = 4e-16;
/// So many times the square of the last update over the one before are at most that.
pub const NEXT: f64 = 8.0;
/// The largest last update.
pub const LAST: f64 = 1e-11;
/// Of one equation a second update is sharpened that is at most this part of the first.
pub const SHARP: f64 = 0.1;
/// The largest size that is taken: squares of larger ones overflow.
pub const RANGE: f64 = 1e100;
/// The largest first update after which the second one may be the last. What is far from where it began says nothing by
/// the matrix from there: of a pendulum over many of its periods a residual may be small by chance, or beside a matrix
/// that was large.
pub const NEAR: f64 = 1e-2;
/// How far an entry of the matrix may be from what it was, where the iteration ends far from its start.
pub const ALIKE: f64 = 0.1;
/// The largest second update that may be rounding alone.
pub const STALLED: f64 = 1e-12;
/// The part of the first update that the second one is at most, where the iteration goes on from it.
pub const GOOD: f64 = 0.1;

/// Which entries of a matrix may be other than 0 in its elimination.
#[derive(Clone, Debug)]
pub struct Pattern {
    n: usize,
    filled: Vec<bool>,
}

impl Pattern {
    /// That of an iteration that begins so; None of others.
    pub fn of(newton: &ir::Newton) -> Option<Self> {
        let n = newton.residual.len();
        let plain = newton.body.iter().all(|i| !matches!(i, ir::Inst::Newton(_)));
        if !(1..=UNKNOWNS).contains(&n)
            || newton.affine
            || newton.corners
            || !newton.update.is_empty()
            || newton.body.len() > INSTRUCTIONS
            || !plain
        {
            return None;
        }
        Self::new(n, newton.jacobian.iter().map(|t| (t.0, t.1)))
    }

    /// That of entries (row, column); None where a pivot is missing whatever the numbers.
    ///
    /// # Panics
    /// Where an entry is not within `n` rows and columns.
    pub fn new(n: usize, entries: impl IntoIterator<Item = (u32, u32)>) -> Option<Self> {
        let mut filled = vec![false; n * n];
        entries.into_iter().for_each(|(i, j)| filled[i as usize * n + j as usize] = true);
        if n == 2 {
            return (filled[0] && filled[3] || filled[1] && filled[2]).then_some(Self { n, filled });
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
        Some(Self { n, filled })
    }

    /// How many unknowns there are.
    pub fn size(&self) -> usize {
        self.n
    }

    /// Whether an entry may be other than 0.
    pub fn has(&self, i: usize, j: usize) -> bool {
        self.filled[i * self.n + j]
    }

    /// Eliminates a matrix in place: below the diagonal what rows are taken times, on it one over the pivots. Of two
    /// unknowns it stays, and its first number beyond becomes one over the determinant.
    fn eliminate(&self, a: &mut [f64]) {
        let n = self.n;
        if n == 2 {
            a[4] = 1.0 / (a[0] * a[3] - a[1] * a[2]);
            return;
        }
        for k in 0..n {
            a[k * n + k] = 1.0 / a[k * n + k];
            for i in (k + 1..n).filter(|i| self.has(*i, k)) {
                let l = a[i * n + k] * a[k * n + k];
                a[i * n + k] = l;
                for j in (k + 1..n).filter(|j| self.has(k, *j)) {
                    a[i * n + j] -= l * a[k * n + j];
                }
            }
        }
    }

    /// Solves with an eliminated matrix, in place.
    fn solve(&self, a: &[f64], x: &mut [f64]) {
        let n = self.n;
        if n == 2 {
            let (p, q) = (x[0] * a[3] - a[1] * x[1], a[0] * x[1] - x[0] * a[2]);
            (x[0], x[1]) = (p * a[4], q * a[4]);
            return;
        }
        for k in 0..n {
            for i in (k + 1..n).filter(|i| self.has(*i, k)) {
                x[i] -= a[i * n + k] * x[k];
            }
        }
        for k in (0..n).rev() {
            let mut rest = x[k];
            for j in (k + 1..n).filter(|j| self.has(k, *j)) {
                rest -= a[k * n + j] * x[j];
            }
            x[k] = rest * a[k * n + k];
        }
    }
}

/// Memory for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Room {
    matrix: Vec<f64>,
    /// The matrix as it was.
    entries: Vec<f64>,
    size: Vec<f64>,
    first: Vec<f64>,
    told: Vec<f64>,
    start: Vec<f64>,
}

impl Room {
    pub(super) fn new(n: usize) -> Self {
        // One more: of two unknowns, the determinant.
        Self {
            matrix: vec![0.0; n * n + 1],
            entries: Vec::with_capacity(n * n),
            size: vec![0.0; n],
            first: vec![0.0; n],
            told: vec![0.0; n],
            start: vec![0.0; n],
        }
    }

    /// Where the iteration begins anew.
    pub(super) fn start(&self) -> &[f64] {
        &self.start
    }
}

/// How it went.
pub(super) enum Begun {
    /// It is done.
    Done,
    /// The iteration begins anew.
    Anew,
    /// It goes on, as after an update with this square and a residual with that; whether it begins anew where it fails.
    On { before: f64, best: f64, again: bool },
}

/// Begins an iteration.
pub(super) fn begin<S: System>(
    pattern: &Pattern,
    (entries, left, bent): (&[(u32, u32)], f64, bool),
    scratch: &mut Scratch,
    system: &mut S,
) -> Result<Begun, Failure> {
    let n = pattern.n;
    let Scratch { weight, scale, cold, residual, jacobian, update, trial, first: unscaled, room, .. } = scratch;
    let foretold = !cold.is_empty();
    room.start.copy_from_slice(if foretold { cold } else { system.unknowns() });
    let left_out = system.coarse(residual, jacobian)?;
    room.entries.clear();
    room.entries.extend_from_slice(jacobian);
    room.matrix.fill(0.0);
    for (&(i, j), v) in entries.iter().zip(jacobian.iter()) {
        room.matrix[i as usize * n + j as usize] = *v;
    }
    pattern.eliminate(&mut room.matrix);
    room.first.copy_from_slice(residual);
    update.copy_from_slice(residual);
    pattern.solve(&room.matrix, update);
    newton::take(system, update);
    for ((z, u), s) in room.size.iter_mut().zip(system.unknowns().iter()).zip(scale.iter()) {
        *z = u.abs() + s;
    }
    let z = &room.size;
    if !z.iter().all(|z| *z <= RANGE) {
        return Ok(Begun::Anew);
    }
    if !left_out && update.iter().zip(z).all(|(d, z)| d.abs() <= ROUNDING * z) {
        let explained = explained(entries, &room.entries, residual, update, z, &mut room.told);
        return Ok(if explained { Begun::Done } else { Begun::Anew });
    }
    system.evaluate(residual, jacobian)?;
    trial.copy_from_slice(residual);
    pattern.solve(&room.matrix, trial);
    let near = update.iter().zip(z).all(|(d, z)| d.abs() <= NEAR * z);
    // Less than the unknowns can show: so nobody need wait for it.
    let unseen = near && trial.iter().zip(system.unknowns().iter()).all(|(e, u)| e.abs() <= ROUNDING * u.abs());
    // Far from the start it ends where the matrix is still the same, and rounding is left.
    let alike = |(a, b): (&f64, &f64)| (a - b).abs() <= ALIKE * b.abs();
    let settled = |e: &[f64]| {
        e.iter().zip(z).all(|(e, z)| e.abs() <= ROUNDING * z) && jacobian.iter().zip(&room.entries).all(alike)
    };
    let last = update.iter().zip(trial.iter()).zip(z).all(|((d, e), z)| is_last(*d, *e, *z, left));
    let mut done = unseen || near && last;
    if let (false, [d], [e], [z]) = (done, &update[..], &mut trial[..], &z[..]) {
        *e = sharpened(*d, *e);
        done = near && is_last_alone(*d, *e, *z, left);
    }
    done |= !near && settled(trial);
    if done && !explained(entries, &room.entries, residual, trial, z, &mut room.told) {
        return Ok(Begun::Anew);
    }
    let (first, second) = (part(update, z), part(trial, z));
    let good = (second <= GOOD * first || second <= STALLED) && first.is_finite();
    if unseen {
        system.pairs().1.iter_mut().zip(trial.iter()).for_each(|(rest, e)| *rest = -e);
    } else if done || good {
        newton::take(system, trial);
    }
    if done {
        return Ok(Begun::Done);
    }
    if !first.is_finite() {
        return Ok(Begun::Anew);
    }
    let measure = Measure::new(weight, scale, unscaled);
    if good {
        update.copy_from_slice(trial);
        return Ok(Begun::On { before: measure.square(trial), best: measure.square(residual), again: true });
    }
    if foretold || bent {
        return Ok(Begun::Anew);
    }
    Ok(Begun::On { before: measure.square(update), best: measure.square(&room.first), again: false })
}

/// Whether an update and what rounding leaves of the unknowns come up to a residual, by a matrix that is finite. One
/// equation is divided by its slope, which loses nothing; of two an infinite entry leaves no number.
fn explained(
    entries: &[(u32, u32)],
    matrix: &[f64],
    residual: &[f64],
    update: &[f64],
    z: &[f64],
    told: &mut [f64],
) -> bool {
    if told.len() == 1 {
        return matrix[0].is_finite();
    }
    told.fill(0.0);
    for (&(i, j), a) in entries.iter().zip(matrix) {
        let j = j as usize;
        told[i as usize] += a.abs() * (update[j].abs() + ROUNDING * z[j]);
    }
    let alone = told.len() == 2;
    residual.iter().zip(told.iter()).all(|(r, told)| r.abs() <= 2.0 * told && (alone || told.is_finite()))
}

/// `Σ |v_i| / z_i`
fn part(v: &[f64], z: &[f64]) -> f64 {
    v.iter().zip(z).fold(0.0, |sum, (v, z)| sum + v.abs() / z)
}

/// Whether a second update of an unknown is its last, after the first and beside its size, of which a part may be left.
fn is_last(first: f64, second: f64, z: f64, left: f64) -> bool {
    let (first, second) = (first.abs(), second.abs());
    second <= ROUNDING * z || (NEXT * second * second <= left * z * first && second <= LAST * z)
}

/// The second update of one equation by the slope there, as the residuals tell it.
fn sharpened(first: f64, second: f64) -> f64 {
    let more = second * second * (2.0 / first);
    if second.abs() <= SHARP * first.abs() { second + more } else { second }
}

/// The same of one equation, whose second update was sharpened.
fn is_last_alone(first: f64, second: f64, z: f64, left: f64) -> bool {
    let (size, second) = (first.abs(), second.abs());
    let part = second * (2.0 / first).abs();
    let next = second * part * (part + 2.0 * (size / z)) * (NEXT / 4.0);
    second <= ROUNDING * z || (next <= left * z && second <= SHARP * size && second <= LAST * z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::testing::Random;

    #[test]
    fn eliminations_solve() {
        let mut random = Random::new(3);
        for n in 1..=UNKNOWNS {
            for _ in 0..50 {
                let mut entries: Vec<(u32, u32)> = Vec::new();
                for k in 0..n * n {
                    let (i, j) = (k / n, k % n);
                    if i == j || random.next() > 0.2 {
                        entries.push((i as u32, j as u32));
                    }
                }
                let pattern = Pattern::new(n, entries.iter().copied()).expect("there is a diagonal");
                let mut a = vec![0.0; n * n + 1];
                for (i, j) in &entries {
                    a[*i as usize * n + *j as usize] = 0.3 * random.next() + if i == j { 3.0 } else { 0.0 };
                }
                let x: Vec<f64> = (0..n).map(|_| random.next()).collect();
                let mut b: Vec<f64> = (0..n).map(|i| (0..n).map(|j| a[i * n + j] * x[j]).sum()).collect();
                pattern.eliminate(&mut a);
                pattern.solve(&a, &mut b);
                for (x, b) in x.iter().zip(&b) {
                    assert!((x - b).abs() < 1e-13, "n {n}: {x} {b}");
                }
            }
        }
    }

    #[test]
    fn a_pivot_that_is_never_there_is_seen() {
        assert!(Pattern::new(3, [(0, 0), (1, 2), (2, 1)]).is_none());
        assert!(Pattern::new(3, [(0, 0), (0, 1), (1, 0), (1, 2), (2, 1)]).is_some());
        assert!(Pattern::new(2, [(0, 1), (1, 0)]).is_some());
    }

    #[test]
    fn second_updates_of_one_equation_are_of_order_four() {
        // exp(x) = 2, from so far off.
        let off = |start: f64| {
            let f = |x: f64| crate::eval::unary(crate::ir::Unary::Exp, x) - 2.0;
            let (root, slope) = (std::f64::consts::LN_2, f(start) + 2.0);
            let d = f(start) / slope;
            let e = f(start - d) / slope;
            start - d - sharpened(d, e) - root
        };
        let (near, far) = (off(std::f64::consts::LN_2 + 0.01), off(std::f64::consts::LN_2 + 0.02));
        assert!((14.0..18.0).contains(&(far / near)), "{near:e} {far:e}");
        // What is not near is left.
        assert!(sharpened(1.0, 0.2) == 0.2 && sharpened(0.0, 1.0) == 1.0);
    }

    #[test]
    fn last_updates() {
        let is_last = |first, second, z| is_last(first, second, z, ROUNDING);
        assert!(is_last(1e-4, 1e-11, 1.0) && is_last(1.0, 1e-16, 1.0) && is_last(0.0, 1e-17, 0.1));
        assert!(!is_last(1e-4, 1e-9, 1.0) && !is_last(1e-9, 9e-10, 1.0) && !is_last(0.0, 1e-12, 1.0));
        assert!(!is_last(f64::NAN, 0.1, 1.0) && !is_last(1.0, f64::NAN, 1.0) && !is_last(1.0, 1e-20, f64::NAN));
        let is_last = |first, second| is_last_alone(first, second, 1.0, 1e-20);
        assert!(is_last(1e-5, 1e-12) && is_last(-1e-5, 1e-12) && is_last(1e-4, -1e-14) && is_last(1e-6, 1e-17));
        assert!(!is_last(1e-10, 1e-12) && !is_last(1e-5, 1e-9) && !is_last(1e-9, 1e-9) && !is_last(f64::NAN, 1e-12));
        // Less may be left of what adds up.
        assert!(!super::is_last(1e-4, 1e-11, 1.0, 1e-20) && super::is_last(1e-4, 1e-13, 1.0, 1e-20));
    }
}
