//! Newton's method, as [`crate::ir::Newton`] means it. [`super::iteration`] is that for every machine, and [`solve`] is
//! it on numbers.
//!
//! # The method
//! Names and numbers are those of [`NewtonOptions`].
//!
//! With unknowns `u`, residual `r(u)`, Jacobian `J(u)`, weights `w` and scales `s`, all norms squared:
//!
//! - `|v|² = Σ w_i v_i²` (a weighted norm; the `w_i` are error weights). A weight that is not finite or not above 0 (as
//!   of a spring that is not in contact yet) is the mean of the other `w_j s_j²` over `s_i²`, so that no equation goes
//!   unseen, and in sums of `u_i² + s_i²` counts `s_i²` alone; without a scale either, as of a root from rest, its
//!   scale is the first update (if that is not one of two to begin with), but in sums it counts nothing; where there is
//!   no weight at all, all are 1.
//! - Up to `limit` times: compute `r`, `J`.
//!   1. Where `|r|²` is not finite, or an update was made and `|r|²` is above 4 times the smallest `|r|²` so far
//!      (from the iteration `patience` on, where the update's `|d|²` was above `negligible` times
//!      `Σ w_i (u_i² + s_i²)`, above `1 - decrease / 2^halvings` times that before the update; not where the update is
//!      given) and above the noise `1e-26 Σ w_i (u_i² + s_i²)` (0 without weights), in the first `damped` iterations,
//!      and the last update was halved fewer than `halvings` times: take half of it back (`d = d / 2`, `u = u + d`) and
//!      start over. Of a whole update that left `|r|²` above 4 times the smallest this waits for the next one: where
//!      that one's `|d|²` is at most `closer` times as large, the iteration converges whatever the residual, whose
//!      equations may weigh little or much, and goes on from there. Not beside an exponential ([`ir::Knee`]) or a pole
//!      ([`ir::Newton::has_poles`]), from beyond which the update is small by nature.
//!   2. Where all of `r` is 0, or after `damped` iterations, once an update is more than half of the smallest before or
//!      after `grace` more, `|r|²` is at most `4e-16² Σ w_i (u_i² + s_i²)`: done. Where a body that all but rests
//!      sticks, rounding leaves open what holds it.
//!   3. Solve `J d = r`. Where that fails, or `J` or `d` is not finite: halve as in 1, if that is still allowed; before
//!      the first update, add 1e-3 of the scale (of 1 where that is 0) to the unknowns and start over, and another
//!      time, or where `|r|²` is not finite there, take 2e-3 of it off, and so on by `nudges`; else fail.
//!   4. Where `|d + e|²` is at most `|e|² / 16`, with the update `e` before, neither halved nor doubled: half of `d`.
//!      It only takes back what `e` did, as about the infinite slope of a root, where such updates go to and fro for
//!      ever.
//!   5. `u = u - d`, then test. Of an unknown that is an exponent ([`ir::Knee`]) the update is limited: made along the
//!      curve of argument and exponential, in a parameter that is the argument before the knee and the exponential
//!      beyond it (Newton's method in the voltage of a junction that blocks, in the current of one that conducts;
//!      Nagel, SPICE2, 1975): else what lies beyond would be overshot, or come back from by one unit of the exponent at
//!      a time. `d` is what was made of it; up to an eighth of a unit it stays.
//! - Where laws may leave `undetermined` how they share a load, so may the matrix ([`super::dense::solve`]): those
//!   unknowns stay, the residual that comes of such an update is not compared with those before, and from then on one
//!   that is rounding, as in 2, is enough after `patience` iterations or where the matrix has no pivot: what is the
//!   same is not to the last digit.
//! - *Small(t)*: each unknown has `|d_i| <= t (|u_i| + s_i)` or, with its weight above 0,
//!   `w_i d_i² <= t² Σ w_j (u_j² + s_j²)`, where `|r|²` is no more than that sum: far out on an exponential one unknown
//!   is too large for another to show.
//! - Where the residual is affine, only `u = u - J^-1 r`, once. Else done where small(4e-16); or, where the update
//!   before, `e`, was not halved and `|d|` is at most 1e-3 `|e|`, small(t) with `t = min(1e-11, left |e|² / |d|²)`:
//!   convergence being quadratic, the next update would be near `d |d|² / |e|²`, below what may be left (`left`, 4e-16
//!   as a rule); or small(1e-12), where `|d|` is at least half of `|e|`: rounding keeps it from falling; or
//!   small(1e-10), where besides it was at least half of the smallest before it `stalls` times in a row: the equations
//!   hardly determine that unknown; or small(1e-6) then, where the smallest `|r|²` so far is at most `1e-20 Σ w_i (u_i²
//!   + s_i²)`, which is rounding.
//!
//! - Where laws have `corners` beyond which they are steeper by orders of magnitude, an update that was to be the last
//!   may have passed one, if it is no more than rounding. So the residual that it leaves is looked at, up to `looks`
//!   times, and where it is above `1e-28 Σ w_i (u_i² + s_i²)` the iteration goes on; above `1e-24` of it, where it was
//!   no more than 4 times as large before.
//!
//! Few unknowns begin with two updates by one matrix, [`super::iteration::chord`], which mostly is all. Where the start
//! was predicted and the iteration fails from there, it begins anew from the other start that is given.
//!
//! Where the body gives the update itself, with a matrix that is near the Jacobian (the simplified method), 3 is what
//! it gave, and fails where `d` is not finite and cannot be halved. Convergence then is linear: with θ = |d|/|e| what
//! is still off is near θ/(1 - θ) d. So it is done where small(t) with `t = min(1e-12, left (1/θ - 1))`, or
//! small(1e-12) where θ is at least a half.
//!
//! Where it is asked for, the rounding error of each unknown `u = v - d` after an update is kept, `(v - u) -
//! d`: the solution is nearer to `u` with it than to `u`. Such a `d` is a residual, some units in the last place of
//! the unknown, over a slope that may be near 1: rounding it goes to the side that the iteration came from, and so
//! does not cancel over many steps. They are 0 where the residual is.
//!
//! What the body wrote to slots other than the unknowns belongs to the iterate before the last update.

use super::iteration::{DONE, Equations, Iteration, Method, Places, SINGULAR, SOLVED, UNDETERMINED};
use super::linear;
use crate::ir;
use crate::kernel::Failure;
use crate::machine::{Exit, Flow, Real, cells};
use crate::options::NewtonOptions;
use std::cell::Cell;

/// More unknowns than this have no knees.
pub const MAX_KNEES: usize = 48;

/// What is known of an iteration before it runs.
#[derive(Clone, Debug)]
pub struct Plan {
    /// First slot of the unknowns, in `Local`.
    pub unknowns: usize,
    /// First slot of their rounding errors, in `Local`, where these are asked for.
    pub rounding: Option<usize>,
    /// Rows and columns of the Jacobian's entries, in the order in which they are computed.
    pub pattern: Vec<(u32, u32)>,
    /// The slot of `Local` that gets 1 or 0 instead of a failure.
    pub flag: Option<usize>,
    /// How many values count for nothing in a first update.
    pub small: usize,
    /// How it goes.
    pub method: Method,
    linear: linear::Plan,
}

impl Plan {
    /// The plan of an iteration.
    pub fn new(newton: &ir::Newton) -> Self {
        let method = Method::of(newton);
        let matrix = if method.undetermined { linear::Matrix::Undetermined } else { linear::Matrix::Changing };
        let pattern: Vec<_> = newton.jacobian.iter().map(|&(row, column, _)| (row, column)).collect();
        let linear = linear::Plan::new(method.n, &pattern, matrix);
        Self {
            unknowns: newton.unknowns as usize,
            rounding: newton.rounding.map(|r| r as usize),
            pattern,
            flag: newton.flag.map(|slot| slot.index as usize),
            small: newton.small.len(),
            method,
            linear,
        }
    }

    /// The plan of equations that are given as they are.
    ///
    /// # Panics
    /// Where the pattern is not within `n` rows and columns.
    pub fn of(n: usize, pattern: Vec<(u32, u32)>, limit: u32, options: NewtonOptions) -> Self {
        let linear = linear::Plan::new(n, &pattern, linear::Matrix::Changing);
        let method = Method {
            n,
            limit,
            affine: false,
            given: false,
            left: options.rounding,
            predicted: false,
            coarse: false,
            knees: Vec::new(),
            undetermined: false,
            corners: false,
            doubts: true,
            chord: None,
            options,
        };
        Self { unknowns: 0, rounding: None, pattern, flag: None, small: 0, method, linear }
    }

    /// The plans of all iterations of a program, in order of appearance, an outer one before those inside it.
    pub fn all(program: &ir::Program) -> Vec<Plan> {
        fn walk(body: &[ir::Inst], plans: &mut Vec<Plan>) {
            for inst in body {
                match inst {
                    ir::Inst::Newton(newton) => {
                        plans.push(Plan::new(newton));
                        walk(&newton.body, plans);
                    }
                    ir::Inst::Let(..)
                    | ir::Inst::Store(..)
                    | ir::Inst::Solve(_)
                    | ir::Inst::MatVec { .. }
                    | ir::Inst::Quad { .. } => {}
                }
            }
        }
        let mut plans = Vec::new();
        walk(&program.body, &mut plans);
        plans
    }

    /// Memory for it.
    pub fn scratch(&self) -> Scratch {
        let n = self.method.n;
        let of = |is: bool| vec![0.0; if is { n } else { 0 }];
        Scratch {
            unknowns: of(true),
            rounding: of(self.rounding.is_some()),
            weight: of(true),
            scale: of(true),
            cold: of(self.method.predicted),
            small: vec![0.0; self.small],
            residual: of(true),
            jacobian: vec![0.0; if self.method.given { n } else { self.pattern.len() }],
            vector: of(true),
            solution: of(true),
            update: of(true),
            room: of(true),
            begun: [of(self.method.chord.is_some()), of(self.method.chord.is_some())],
            linear: self.linear.scratch(),
        }
    }
}

/// Memory of an iteration.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// The unknowns: where to start, to be filled in before [`solve`]; then the solution, or the last iterate.
    pub unknowns: Vec<f64>,
    /// What rounding took from them, where that is asked for.
    pub rounding: Vec<f64>,
    /// The weights; to be filled in before [`solve`].
    pub weight: Vec<f64>,
    /// The scales; to be filled in before [`solve`].
    pub scale: Vec<f64>,
    /// Where else to start, where the start is predicted; to be filled in likewise.
    pub cold: Vec<f64>,
    /// Room for who evaluates: see [`ir::Newton::small`].
    pub small: Vec<f64>,
    residual: Vec<f64>,
    jacobian: Vec<f64>,
    /// The residual, and then the solution, for linear equations.
    vector: Vec<f64>,
    solution: Vec<f64>,
    update: Vec<f64>,
    room: Vec<f64>,
    begun: [Vec<f64>; 2],
    linear: linear::Scratch,
}

/// The equations, on numbers.
pub trait System {
    /// Computes residual and Jacobian, in the order of the plan's pattern, at some unknowns; where the update is given,
    /// that in place of the Jacobian. `coarse` without what counts for nothing in a first update.
    ///
    /// # Errors
    /// Where an iteration inside this one fails.
    fn evaluate(
        &mut self,
        unknowns: &[Cell<f64>],
        residual: &mut [f64],
        jacobian: &mut [f64],
        coarse: bool,
    ) -> Result<(), Failure>;
}

/// Brings the residual to 0, starting from the unknowns as they are; adds the iterations done to `count`.
///
/// # Errors
/// [`Failure::NoConvergence`] and [`Failure::Singular`], whether or not the plan has a flag. The unknowns then hold the
/// last iterate.
///
/// # Panics
/// Where the scratch was made by another plan, or the system has other equations.
pub fn solve<S: System>(plan: &Plan, scratch: &mut Scratch, count: &mut u64, system: &mut S) -> Result<(), Failure> {
    let Scratch { unknowns, rounding, weight, scale, cold, residual, jacobian, vector, .. } = scratch;
    let [first, second] = &mut scratch.begun;
    let unknowns = cells(unknowns);
    let places = Places {
        unknowns,
        rounding: plan.rounding.map(|_| cells(rounding)),
        weight: cells(weight),
        scale: cells(scale),
        cold: plan.method.predicted.then(|| cells(cold)),
        room: cells(&mut scratch.room),
        update: cells(&mut scratch.update),
        begun: (cells(first), cells(second)),
    };
    let mut equations = OnNumbers {
        plan,
        system,
        unknowns,
        residual: cells(residual),
        jacobian,
        vector,
        solution: cells(&mut scratch.solution),
        linear: &mut scratch.linear,
        // A system inside an iteration is a part of that one.
        count: if plan.method.affine && plan.flag.is_some() { &mut 0 } else { count },
    };
    let it = Iteration::new(Real::new(), &plan.method, places);
    let result = it.run(&mut equations);
    it.counted(&mut equations);
    let end = it.end.get();
    match result {
        Err(Exit::Fail(failure)) => Err(failure),
        _ if end == DONE => Ok(()),
        _ if end == SINGULAR => Err(Failure::Singular { row: it.row.get() as usize }),
        Ok(()) | Err(Exit::Leave | Exit::Again) => {
            let (worst, change) = it.worst();
            Err(Failure::NoConvergence {
                iterations: plan.method.limit,
                unknown: plan.unknowns + worst as usize,
                change,
            })
        }
    }
}

/// Equations whose numbers are computed at once.
struct OnNumbers<'a, S> {
    plan: &'a Plan,
    system: &'a mut S,
    unknowns: &'a [Cell<f64>],
    residual: &'a [Cell<f64>],
    jacobian: &'a mut [f64],
    vector: &'a mut [f64],
    solution: &'a [Cell<f64>],
    linear: &'a mut linear::Scratch,
    count: &'a mut u64,
}

/// Copies numbers into cells.
fn copy(from: &[f64], to: &[Cell<f64>]) {
    to.iter().zip(from).for_each(|(to, x)| to.set(*x));
}

impl<'a, S: System> Equations<Real<'a>> for OnNumbers<'a, S> {
    fn evaluate(&mut self, _: Real<'a>, coarse: bool) -> Flow {
        self.system.evaluate(self.unknowns, self.vector, self.jacobian, coarse).map_err(Exit::Fail)?;
        copy(self.vector, self.residual);
        Ok(())
    }

    fn residual(&self) -> &'a [Cell<f64>] {
        self.residual
    }

    fn entry(&self, _: Real<'a>, k: usize) -> f64 {
        self.jacobian[k]
    }

    fn is_finite(&self, _: Real<'a>) -> bool {
        self.jacobian.iter().all(|x| x.is_finite())
    }

    fn solve(&mut self, _: Real<'a>, row: &Cell<f64>) -> &'a [Cell<f64>] {
        if self.plan.method.given {
            copy(self.jacobian, self.solution);
            return self.solution;
        }
        let solved = self.plan.linear.solve(&self.plan.pattern, self.jacobian, self.vector, self.linear, false);
        row.set(match solved {
            Ok(false) => SOLVED,
            Ok(true) => UNDETERMINED,
            Err(row) => row as f64,
        });
        copy(self.vector, self.solution);
        self.solution
    }

    fn count(&mut self, _: Real<'a>, iterations: f64) {
        *self.count += iterations as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::super::iteration::chord;
    use super::*;

    /// Equations as a closure `(u, r, j)`.
    struct Closure<F>(F);

    impl<F: FnMut(&[f64], &mut [f64], &mut [f64])> System for Closure<F> {
        fn evaluate(&mut self, u: &[Cell<f64>], r: &mut [f64], j: &mut [f64], _: bool) -> Result<(), Failure> {
            let u: Vec<f64> = u.iter().map(Cell::get).collect();
            (self.0)(&u, r, j);
            Ok(())
        }
    }

    fn run<F: FnMut(&[f64], &mut [f64], &mut [f64])>(
        start: &[f64],
        weight: f64,
        scale: f64,
        f: F,
    ) -> (Result<(), Failure>, Vec<f64>, u64) {
        let n = start.len();
        let pattern = (0..n * n).map(|k| ((k / n) as u32, (k % n) as u32)).collect();
        let plan = Plan::of(n, pattern, 60, NewtonOptions::DEFAULT);
        let mut scratch = plan.scratch();
        scratch.weight.fill(weight);
        scratch.scale.fill(scale);
        scratch.unknowns.copy_from_slice(start);
        let mut count = 0;
        let result = solve(&plan, &mut scratch, &mut count, &mut Closure(f));
        (result, scratch.unknowns, count)
    }

    #[test]
    fn linear_systems_take_two_iterations() {
        for weight in [0.0, 3.0] {
            let (result, u, count) = run(&[0.0, 0.0, 0.0], weight, 1e-3, |u, r, j| {
                let a = [4.0, 1.0, 0.3, -1.0, 5.0, 0.7, 0.1, -0.4, 3.0];
                for i in 0..3 {
                    r[i] = (0..3).map(|k| a[3 * i + k] * u[k]).sum::<f64>() - [1.0, 0.3, 0.7][i];
                }
                j.copy_from_slice(&a);
            });
            assert_eq!(result, Ok(()));
            assert!(count <= 2, "{count}");
            assert!((4.0 * u[0] + u[1] + 0.3 * u[2] - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn square_root_of_two() {
        let (result, u, count) = run(&[1.0], 1.0, 1.0, |u, r, j| {
            r[0] = u[0] * u[0] - 2.0;
            j[0] = 2.0 * u[0];
        });
        assert_eq!(result, Ok(()));
        assert!((u[0] - 2f64.sqrt()).abs() < 4e-16 && count <= 6, "{count}");
    }

    #[test]
    fn overshoot_is_taken_back() {
        // The first update of an exponential overflows.
        let (result, u, _) = run(&[0.0], 0.0, 1.0, |u, r, j| {
            r[0] = u[0].exp() - 1e3;
            j[0] = u[0].exp();
        });
        assert_eq!(result, Ok(()));
        assert!((u[0] - 1e3f64.ln()).abs() < 4e-15);
        // The logarithm leaves its domain.
        let (result, u, _) = run(&[5.0], 1.0, 1.0, |u, r, j| {
            r[0] = u[0].ln();
            j[0] = 1.0 / u[0];
        });
        assert_eq!(result, Ok(()));
        assert!((u[0] - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_flat_part_is_crossed() {
        // Dry friction along its curve: nothing moves while |s| < 1.
        let (result, u, _) = run(&[-1.3], 0.0, 1.0, |u, r, j| {
            r[0] = u[0] - u[0].clamp(-1.0, 1.0) - 0.1;
            j[0] = if u[0].abs() > 1.0 { 1.0 } else { 0.0 };
        });
        assert_eq!(result, Ok(()));
        assert!((u[0] - 1.1).abs() < 1e-15, "{u:?}");
        // However little that asks for.
        for off in [1e-3, 1e-9, 1e-15] {
            let (result, u, _) = run(&[1.0 + off], 0.0, 1.0, |u, r, j| {
                r[0] = u[0] - u[0].clamp(-1.0, 1.0) + off;
                j[0] = if u[0].abs() > 1.0 { 1.0 } else { 0.0 };
            });
            assert_eq!(result, Ok(()));
            assert!((u[0] + 1.0 + off).abs() < 1e-15, "{u:?}");
        }
    }

    #[test]
    fn an_infinite_slope_is_no_solution() {
        // A root law from 0, whose other side has no value, to each side.
        for side in [1.0, -1.0] {
            let (result, u, _) = run(&[0.0], 0.0, 0.1, |u, r, j| {
                r[0] = side * u[0] + (side * u[0]).sqrt() - 2.0;
                j[0] = side * (1.0 + 0.5 / (side * u[0]).sqrt());
            });
            assert_eq!(result, Ok(()));
            assert!((side * u[0] - 1.0).abs() < 1e-15, "{u:?}");
        }
        // Beside an equation that is solved at once.
        let (result, u, _) = run(&[0.0, 0.0, 0.0], 1.0, 1.0, |u, r, j| {
            (r[0], r[1], r[2]) = (u[0] - 1.0, u[1].cbrt() - 2.0, u[2] - u[1]);
            j.copy_from_slice(&[1.0, 0.0, 0.0, 0.0, 1.0 / (3.0 * u[1].cbrt().powi(2)), 0.0, 0.0, -1.0, 1.0]);
        });
        assert_eq!(result, Ok(()));
        assert!((u[1] - 8.0).abs() < 1e-13 && (u[2] - 8.0).abs() < 1e-13, "{u:?}");
    }

    /// Rosenbrock's valley: a whole update ends far up its side, from where the next one is at the bottom.
    #[test]
    fn a_residual_may_rise() {
        let (result, u, count) = run(&[0.5, 0.25], 1.0, 1.0, |u, r, j| {
            (r[0], r[1]) = (u[0] - 1.0, 1e4 * (u[1] - u[0] * u[0]));
            j.copy_from_slice(&[1.0, 0.0, -2e4 * u[0], 1e4]);
        });
        assert_eq!(result, Ok(()));
        assert!((u[0] - 1.0).abs() < 1e-15 && (u[1] - 1.0).abs() < 1e-15 && count <= 5, "{u:?}, {count}");
    }

    #[test]
    fn no_root_and_no_slope() {
        let (result, ..) = run(&[1.0], 1.0, 1.0, |u, r, j| {
            r[0] = u[0] * u[0] + 1.0;
            j[0] = 2.0 * u[0];
        });
        assert!(result.is_err());
        let (result, ..) = run(&[1.0, 2.0], 1.0, 1.0, |_, r, j| {
            r.fill(1.0);
            j.fill(0.0);
        });
        assert!(matches!(result, Err(Failure::Singular { .. })));
        let (result, ..) = run(&[1.0], 1.0, 1.0, |_, r, j| {
            r[0] = f64::NAN;
            j[0] = 1.0;
        });
        assert!(matches!(result, Err(Failure::NoConvergence { .. })));
    }

    /// A root has no value where it was predicted to be; from the other start it is found.
    #[test]
    fn where_a_prediction_fails_there_is_another_start() {
        let mut plan = Plan::of(2, vec![(0, 0), (0, 1), (1, 0), (1, 1)], 60, NewtonOptions::DEFAULT);
        plan.method.predicted = true;
        let found = |start: f64| {
            let mut scratch = plan.scratch();
            scratch.weight.fill(1.0);
            scratch.scale.fill(1e-3);
            scratch.unknowns.copy_from_slice(&[start, 0.5]);
            scratch.cold.copy_from_slice(&[1.0, 1.0]);
            let mut count = 0;
            let mut system = Closure(|u: &[f64], r: &mut [f64], j: &mut [f64]| {
                (r[0], r[1]) = (u[0].sqrt() - 2.0, u[1] - 0.5 * u[0]);
                j.copy_from_slice(&[0.5 / u[0].sqrt(), 0.0, -0.5, 1.0]);
            });
            let result = solve(&plan, &mut scratch, &mut count, &mut system);
            (result, scratch.unknowns, count)
        };
        for start in [3.9, -5.0] {
            let (result, u, count) = found(start);
            assert_eq!(result, Ok(()), "{start}");
            assert!((u[0] - 4.0).abs() < 1e-14 && (u[1] - 2.0).abs() < 1e-14, "{start}: {u:?}");
            assert!(start < 0.0 || count <= 5, "{start}: {count}");
        }
    }

    /// The first pivot is so small that elimination in one order loses the second equation, in both of the updates that
    /// few unknowns begin with: they are next to nothing, and what is left of the residual is not.
    #[test]
    fn small_updates_that_leave_a_residual_are_no_end() {
        let places = vec![(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)];
        let mut plan = Plan::of(3, places.clone(), 60, NewtonOptions::DEFAULT);
        plan.method.chord = chord::Pattern::new(3, places);
        assert!(plan.method.chord.is_some());
        let mut scratch = plan.scratch();
        scratch.weight.fill(1.0);
        scratch.scale.fill(1.0);
        let mut system = Closure(|u: &[f64], r: &mut [f64], j: &mut [f64]| {
            r.copy_from_slice(&[1e-40 * u[0] + (u[1] - 0.1 - 0.2), u[0] + u[1] - 2.0, u[2] - 1.0]);
            j.copy_from_slice(&[1e-40, 1.0, 1.0, 1.0, 1.0]);
        });
        assert_eq!(solve(&plan, &mut scratch, &mut 0, &mut system), Ok(()));
        let u = &scratch.unknowns;
        assert!((u[0] - 1.7).abs() < 1e-15 && (u[1] - 0.3).abs() < 1e-15 && (u[2] - 1.0).abs() < 1e-15, "{u:?}");
    }

    /// What is named is the unknown that is off most beside itself, however little that is, in the program's count.
    #[test]
    fn the_unknown_that_moves_most_is_named() {
        let pattern = (0..9).map(|k| (k / 3, k % 3)).collect();
        let plan = Plan { unknowns: 5, ..Plan::of(3, pattern, 3, NewtonOptions::DEFAULT) };
        let mut scratch = plan.scratch();
        scratch.weight.fill(1.0);
        scratch.unknowns.copy_from_slice(&[1.0, 2.0, 3.0]);
        // By a double root, of which each update leaves a half.
        let mut system = Closure(|u: &[f64], r: &mut [f64], j: &mut [f64]| {
            (r[0], r[1], r[2]) = (u[0] - 1.0, (u[1] - 1.0) * (u[1] - 1.0), u[2] - 3.0);
            j.copy_from_slice(&[1.0, 0.0, 0.0, 0.0, 2.0 * (u[1] - 1.0), 0.0, 0.0, 0.0, 1.0]);
        });
        let result = solve(&plan, &mut scratch, &mut 0, &mut system);
        assert_eq!(result, Err(Failure::NoConvergence { iterations: 3, unknown: 6, change: 0.125 }));
        assert_eq!(scratch.unknowns, [1.0, 1.125, 3.0]);
    }

    /// A ball that touches a plate: its first equation holds at the start, and what the other one asks for has no
    /// weight yet.
    #[test]
    fn an_unknown_without_a_weight_is_seen() {
        let (m, v, k, h) = (0.01, 2.0, 1e7, 8e-5);
        let plan = Plan::of(2, vec![(0, 0), (0, 1), (1, 0), (1, 1)], 60, NewtonOptions::DEFAULT);
        let mut scratch = plan.scratch();
        scratch.weight.copy_from_slice(&[1.0 / m, 0.0]);
        scratch.scale.copy_from_slice(&[m * v, h * v]);
        let f = |u: &[f64], r: &mut [f64], j: &mut [f64]| {
            let (p, q) = (u[0], u[1].max(0.0));
            r[0] = p + h * 0.4 * k * q.powf(1.5);
            r[1] = u[1] - h * (v + 0.5 * p / m);
            j.copy_from_slice(&[1.0, h * 0.6 * k * q.sqrt(), -0.5 * h / m, 1.0]);
        };
        let mut count = 0;
        assert_eq!(solve(&plan, &mut scratch, &mut count, &mut Closure(f)), Ok(()));
        assert!(count <= 8, "{count}");
        assert!((scratch.unknowns[1] - 1.574706473232915e-4).abs() < 1e-18, "{:e}", scratch.unknowns[1]);
    }
}
