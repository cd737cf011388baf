//! Newton's method, as [`crate::ir::Newton`] means it. Every back end calls [`solve`], or repeats it exactly.
//!
//! # The method
//! With unknowns `u`, residual `r(u)`, Jacobian `J(u)`, weights `w` and scales `s`, all norms squared:
//!
//! - `|v|² = Σ w_i v_i²`. A weight that is not finite or not above 0 (as of a spring that is not in contact yet) is the
//!   mean of the other `w_j s_j²` over `s_i²`, so that no equation goes unseen, and in sums of `u_i² + s_i²` counts
//!   `s_i²` alone; without a scale either, as of a root from rest, its scale is the first update (if that is not one of two
//!   to begin with), but in sums it counts nothing; where there is no weight at all, all are 1.
//! - Up to `limit` times: compute `r`, `J`.
//!   1. Where `|r|²` is not finite, or an update was made and `|r|²` is above 4 times the smallest `|r|²` so far
//!      (from the iteration [`PATIENT`] on, where the update's `|d|²` was above [`TELLING`] times
//!      `Σ w_i (u_i² + s_i²)`, above `1 - FALL / 2^halvings` times that before the update; not where the update is given)
//!      and above the noise `1e-26 Σ w_i (u_i² + s_i²)` (0 without weights), in the first [`DAMPED`] iterations, and the
//!      last update was halved fewer than [`HALVINGS`] times: take half of it back (`d = d / 2`, `u = u + d`) and start
//!      over. Of a whole update that left `|r|²` above 4 times the smallest this waits for the next one: where that one's
//!      `|d|²` is at most [`CLOSER`] times as large, the iteration converges whatever the residual, whose equations may
//!      weigh little or much, and goes on from there. Not beside an exponential ([`Bend`]) or a pole
//!      ([`ir::Newton::has_poles`]), from beyond which the update is small by nature.
//!   2. Where all of `r` is 0, or after [`DAMPED`] iterations, once an update is more than half of the smallest before or
//!      after [`GRACE`] more, `|r|²` is at most `1e-32 Σ w_i (u_i² + s_i²)`: done. Where a body that all but rests sticks,
//!      rounding leaves open what holds it.
//!   3. Solve `J d = r`. Where that fails, or `J` or `d` is not finite: halve as in 1, if that is still allowed; before the
//!      first update, add 1e-3 of the scale (of 1 where that is 0) to the unknowns and start over, and another time, or
//!      where `|r|²` is not finite there, take 2e-3 of it off, and so on by [`NUDGES`]; else fail.
//!   4. Where `|d + e|²` is at most `|e|² / 16`, with the update `e` before, neither halved nor doubled: half of `d`.
//!      It only takes back what `e` did, as about the infinite slope of a root, where such updates go to and fro for
//!      ever.
//!   5. `u = u - d`, then test. Of an unknown that an exponential is of ([`Bend`]) the update is made along the curve
//!      of argument and exponential, in a parameter that is the argument before the knee and the exponential beyond it
//!      (Newton's method in the voltage of a junction that blocks, in the current of one that conducts; Nagel, SPICE2,
//!      1975): else what lies beyond would be overshot, or come back from by one unit of the exponent at a time. `d` is
//!      what was made of it; up to an eighth of a unit it stays.
//! - Where laws may leave `open` how they share a load, so may the matrix ([`super::dense::solve`]): those unknowns stay,
//!   the residual that comes of such an update is not compared with those before, and from then on one that is rounding,
//!   as in 2, is enough after [`PATIENT`] iterations or where the matrix has no pivot: what is the same is not to the
//!   last digit.
//! - *Small(t)*: each unknown has `|d_i| <= t (|u_i| + s_i)` or, with its weight above 0,
//!   `w_i d_i² <= t² Σ w_j (u_j² + s_j²)`, where `|r|²` is no more than that sum: far out on an exponential one unknown
//!   is too large for another to show.
//! - Where the residual is affine, only `u = u - J^-1 r`, once. Else done where small(4e-16); or, where the update
//!   before, `e`, was not halved and `|d|` is at most 1e-3 `|e|`, small(t) with `t = min(1e-11, left |e|² / |d|²)`:
//!   convergence being quadratic, the next update would be near `d |d|² / |e|²`, below what may be left (`left`, 4e-16 as
//!   a rule); or small(1e-12), where `|d|` is at least half of `|e|`: rounding keeps it from falling; or small(1e-10),
//!   where besides it was at least half of the smallest before it [`STALLS`] times in a row: the equations hardly tell
//!   that unknown; or small(1e-6) then, where the smallest `|r|²` so far is at most `1e-20 Σ w_i (u_i² + s_i²)`, which is
//!   rounding.
//!
//! - Where laws have `corners` beyond which they are steeper by orders of magnitude, an update that was to be the last may
//!   have passed one, if it is no more than rounding. So the residual that it leaves is looked at, up to [`LOOKS`] times,
//!   and where it is above `1e-28 Σ w_i (u_i² + s_i²)` the iteration goes on; above `1e-24` of it, where it was no more than
//!   4 times as large before.
//!
//! Few unknowns begin with two updates by one matrix, [`quick`], which mostly is all. Where the start was foretold and
//! the iteration fails from there, it begins anew from the other start that is given.
//!
//! Where the body gives the update itself, with a matrix that is near the Jacobian (the simplified method), 3 is what
//! it gave, and fails where `d` is not finite and cannot be halved. Convergence then is linear: with θ = |d|/|e| what
//! is still off is near θ/(1 - θ) d. So it is done where small(t) with `t = min(1e-12, left (1/θ - 1))`, or
//! small(1e-14) where θ is at least a half.
//!
//! Where it is asked for, the rest of each unknown `u = v - d` after an update is what rounding took from it, `(v - u) -
//! d`: the solution is nearer to `u` and its rest than to `u`. Such a `d` is a residual, some units in the last place of
//! the unknown, over a slope that may be near 1: rounding it goes to the side that the iteration came from, and so
//! does not cancel over many steps. Rests are 0 where the residual is.
//!
//! What the body wrote to slots other than the unknowns belongs to the iterate before the last update.

use super::linear;
use super::quick::{self, Begun};
use crate::eval;
use crate::ir::{self, Bend, Unary};
use crate::kernel::Failure;

/// Where else to start, in scales, where the Jacobian at the start cannot be solved.
pub const NUDGES: [f64; 6] = [1e-3, -1e-3, 2.0, -2.0, 30.0, -30.0];
/// How often an update that ends where the Jacobian is singular is made longer, to get beyond.
pub const STRETCHES: u32 = 16;
/// The first so many times it is made twice as long, and then by the other factor: where a flow of next to nothing turns,
/// dry friction goes from one side to the other by an update of next to nothing.
pub const STRETCH: (u32, f64) = (6, 32.0);
/// So many updates in a row that do not shrink, and are small: rounding moves an unknown that the equations hardly
/// tell.
pub const STALLS: u32 = 6;
/// So many iterations may go by without a residual that falls. Then each update has to make it smaller: about a steep
/// law that saturates, as friction does, updates may else go from one side to the other for ever, at the same residual.
/// Of equations that only take power the square of the residual falls along the update.
pub const PATIENT: u32 = 12;
/// The part of the residual's square that a whole update has to take off then; a half one half of it, and so on (Armijo,
/// Pacific J. Math. 16, 1966).
pub const FALL: f64 = 0.1;
/// An update whose square is a smaller part of that of unknowns and scales is let be: rounding may keep the residual from
/// falling.
pub const TELLING: f64 = 1e-12;
/// How often one update is halved at most.
pub const HALVINGS: u32 = 30;
/// After so many iterations updates are no longer halved for what the residual becomes: beyond the corner of a law it
/// may have to be larger first, as where a body that slid one way is to slide the other, or on the way to a solution of
/// an energy that is not convex, over steps of many turns.
pub const DAMPED: u32 = 140;
/// What converges then needs no more iterations than these.
pub const GRACE: u32 = 20;
/// The square of an update over that of the one before, at most, after which a residual that is larger says nothing: its
/// equations weigh more than they tell (a natural test of monotonicity; Deuflhard, Numer. Math. 22, 1974).
pub const CLOSER: f64 = 0.25;

/// How often the residual is looked at that is left by what was to be the last update.
pub const LOOKS: u32 = 3;

/// More unknowns than this have no bends.
pub const BENT: usize = 48;
/// Updates of so many units of an exponent at most are made as they are.
pub const STRAIGHT: f64 = 0.125;
/// An update from far up an exponential goes beyond its knee by so many units at most.
pub const FAR: f64 = 1e4;

/// What is known of an iteration before it runs.
#[derive(Clone, Debug)]
pub struct Plan {
    /// First slot of the unknowns, in `Local`.
    pub unknowns: usize,
    /// How many there are.
    pub n: usize,
    /// First slot of their rests, in `Local`, where these are asked for.
    pub rests: Option<usize>,
    /// Rows and columns of the Jacobian's entries, in the order in which they are computed.
    pub pattern: Vec<(u32, u32)>,
    /// Iterations at most.
    pub limit: u32,
    /// Whether the first update is the solution.
    pub affine: bool,
    /// Whether the body gives the update itself.
    pub given: bool,
    /// The part of the unknowns that may be left.
    pub left: f64,
    /// The slot of `Local` that gets 1 or 0 instead of a failure.
    pub flag: Option<usize>,
    /// Whether the start is foretold, and another one given besides.
    pub foretold: bool,
    /// How many values count for nothing in a first update.
    pub small: usize,
    /// Unknowns that exponentials are of.
    pub bends: Vec<Bend>,
    /// Whether what the last update leaves is looked at.
    corners: bool,
    /// Whether an update may be judged by the next one.
    doubts: bool,
    /// Where it begins with two updates by one matrix.
    quick: Option<quick::Pattern>,
    linear: linear::Plan,
}

impl Plan {
    /// The plan of an iteration.
    pub fn new(newton: &ir::Newton) -> Self {
        let matrix = if newton.open { linear::Matrix::Open } else { linear::Matrix::Changing };
        let pattern: Vec<_> = newton.jacobian.iter().map(|&(row, column, _)| (row, column)).collect();
        let linear = linear::Plan::new(newton.residual.len(), &pattern, matrix);
        let flag = newton.flag.map(|slot| slot.index as usize);
        let plan = Self::of(newton.unknowns as usize, newton.residual.len(), pattern, newton.limit, flag);
        Self {
            affine: newton.affine,
            given: !newton.update.is_empty(),
            left: newton.left,
            rests: newton.rests.map(|r| r as usize),
            foretold: !newton.cold.is_empty(),
            small: newton.small.len(),
            bends: newton.bends.clone(),
            corners: newton.corners,
            doubts: doubts(newton),
            quick: quick::Pattern::of(newton),
            linear,
            ..plan
        }
    }

    /// The plan of an iteration given by its parts.
    ///
    /// # Panics
    /// Where the pattern is not within `n` rows and columns.
    pub fn of(unknowns: usize, n: usize, pattern: Vec<(u32, u32)>, limit: u32, flag: Option<usize>) -> Self {
        let linear = linear::Plan::new(n, &pattern, linear::Matrix::Changing);
        let (quick, foretold, bends, rests, doubts) = (None, false, Vec::new(), None, true);
        let (affine, given, left) = (false, false, quick::ROUNDING);
        let (small, corners) = (0, false);
        Self {
            unknowns,
            n,
            rests,
            pattern,
            limit,
            affine,
            given,
            left,
            flag,
            foretold,
            small,
            bends,
            corners,
            doubts,
            quick,
            linear,
        }
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
        let n = self.n;
        Scratch {
            weight: vec![0.0; n],
            scale: vec![0.0; n],
            residual: vec![0.0; n],
            jacobian: vec![0.0; if self.given { n } else { self.pattern.len() }],
            update: vec![0.0; n],
            trial: vec![0.0; n],
            first: vec![0.0; n],
            cold: vec![0.0; if self.foretold { n } else { 0 }],
            small: vec![0.0; self.small],
            room: quick::Room::new(self.quick.as_ref().map_or(0, |q| q.size())),
            linear: self.linear.scratch(),
        }
    }
}

/// Memory of an iteration.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// The weights; to be filled in before [`solve`].
    pub weight: Vec<f64>,
    /// The scales; to be filled in before [`solve`].
    pub scale: Vec<f64>,
    /// Where else to start, where the start is foretold; to be filled in likewise.
    pub cold: Vec<f64>,
    /// Room for who evaluates: see [`ir::Newton::small`].
    pub small: Vec<f64>,
    pub(super) residual: Vec<f64>,
    pub(super) jacobian: Vec<f64>,
    pub(super) update: Vec<f64>,
    pub(super) trial: Vec<f64>,
    /// The first update, where the iteration does not begin with two.
    pub(super) first: Vec<f64>,
    pub(super) room: quick::Room,
    linear: linear::Scratch,
}

/// The equations, as a back end computes them.
pub trait System {
    /// Computes residual and Jacobian, in the order of the plan's pattern, at the unknowns; where the update is given,
    /// that in place of the Jacobian.
    ///
    /// # Errors
    /// Where an iteration inside this one fails.
    fn evaluate(&mut self, residual: &mut [f64], jacobian: &mut [f64]) -> Result<(), Failure>;

    /// The same for a first update, and whether something was left out that is next to nothing.
    ///
    /// # Errors
    /// As [`System::evaluate`].
    fn coarse(&mut self, residual: &mut [f64], jacobian: &mut [f64]) -> Result<bool, Failure> {
        self.evaluate(residual, jacobian).map(|()| false)
    }

    /// The unknowns and their rests; of these there are none where nobody asks for them.
    fn pairs(&mut self) -> (&mut [f64], &mut [f64]);

    /// The unknowns.
    fn unknowns(&mut self) -> &mut [f64] {
        self.pairs().0
    }
}

/// Takes an update off the unknowns.
pub(super) fn take<S: System>(system: &mut S, update: &[f64]) {
    let (unknowns, rests) = system.pairs();
    if rests.is_empty() {
        unknowns.iter_mut().zip(update).for_each(|(u, d)| *u -= *d);
        return;
    }
    for ((u, d), rest) in unknowns.iter_mut().zip(update).zip(rests) {
        let next = *u - *d;
        (*rest, *u) = ((*u - next) - *d, next);
    }
}

/// Brings the residual to 0, starting from the unknowns as they are; adds the iterations done to `count`.
///
/// # Errors
/// [`Failure::NoConvergence`] and [`Failure::Singular`], whether or not the plan has a flag. The unknowns then hold the
/// last iterate.
///
/// # Panics
/// Where the scratch was made by another plan, or the system's unknowns are not `n`.
pub fn solve<S: System>(plan: &Plan, scratch: &mut Scratch, count: &mut u64, system: &mut S) -> Result<(), Failure> {
    let n = plan.n;
    if plan.affine {
        // A system inside an iteration is a part of that one.
        *count += u64::from(plan.flag.is_none());
        system.evaluate(&mut scratch.residual[..n], &mut scratch.jacobian)?;
        let update = &mut scratch.residual[..n];
        plan.linear
            .solve(&plan.pattern, &scratch.jacobian, update, &mut scratch.linear, false)
            .map_err(|row| Failure::Singular { row })?;
        for (u, d) in system.unknowns().iter_mut().zip(update) {
            *u -= *d;
        }
        return Ok(());
    }
    // Where no update is made at all, a failure tells none, rather than that of an earlier step.
    scratch.update[..n].fill(0.0);
    scratch.first[..n].fill(0.0);
    system.pairs().1.fill(0.0);
    let (mut way, mut again) = (Way { done: 0, before: None, best: f64::INFINITY }, plan.foretold);
    if let Some(pattern) = &plan.quick {
        way.done = 1;
        *count += 1;
        match quick::begin(pattern, (&plan.pattern, plan.left, !plan.bends.is_empty()), scratch, system)? {
            Begun::Done => return Ok(()),
            Begun::Anew => {
                again = false;
                scratch.update[..n].fill(0.0);
                system.unknowns().copy_from_slice(scratch.room.start());
            }
            Begun::On { before, best, again: more } => {
                again = more;
                (way.before, way.best) = (Some(before), best);
            }
        }
    }
    let result = iterate(plan, scratch, count, system, way);
    if !again || result.is_ok() {
        return result;
    }
    scratch.update[..n].fill(0.0);
    let start = if plan.quick.is_some() { scratch.room.start() } else { &scratch.cold };
    system.unknowns().copy_from_slice(start);
    iterate(plan, scratch, count, system, Way { done: 0, before: None, best: f64::INFINITY })
}

/// Where an iteration is on its way.
struct Way {
    /// Iterations so far.
    done: u32,
    /// `|d|²` of the update made last.
    before: Option<f64>,
    /// The smallest `|r|²` so far.
    best: f64,
}

/// Whether an update may be judged by the next one: far up an exponential, and beyond a pole, that is small by nature.
pub fn doubts(newton: &ir::Newton) -> bool {
    newton.update.is_empty() && newton.bends.is_empty() && !newton.has_poles()
}

/// Iterates.
fn iterate<S: System>(
    plan: &Plan,
    scratch: &mut Scratch,
    count: &mut u64,
    system: &mut S,
    way: Way,
) -> Result<(), Failure> {
    let n = plan.n;
    let Way { done, mut before, mut best } = way;
    let mut measure = Measure::new(&scratch.weight[..n], &scratch.scale[..n], &scratch.first[..n]);
    let mut halvings = 0; // of the update made last
    let mut stretches = 0; // the same, doubled
    let mut nudges = 0;
    let mut opened = false; // whether an update left something open
    let (mut looks, mut last) = (if plan.corners { LOOKS } else { 0 }, false); // at what the last update leaves
    let mut stalls = 0; // updates in a row that were not much smaller than the smallest before
    let mut least = before.unwrap_or(f64::INFINITY); // `|d|²` of that
    let (mut from, mut reach) = (f64::INFINITY, 1.0 - FALL); // `|r|²` before the update made last, and the part allowed
    for k in done..plan.limit {
        *count += 1;
        let residual = &mut scratch.residual[..n];
        system.evaluate(residual, &mut scratch.jacobian)?;
        let size = measure.square(residual);
        let looked = std::mem::take(&mut last);
        if looked && measure.clears(size, from, system.unknowns()) {
            return Ok(());
        }
        let may_halve = before.is_some() && halvings < HALVINGS;
        let late = !plan.given && k >= PATIENT && size > reach * from;
        let up = size > 4.0 * best;
        let worse = (up || late)
            && !looked
            && before.is_some_and(|last| {
                let energy = measure.energy(system.unknowns());
                k < DAMPED && (up || last > TELLING * energy) && size > 1e-26 * energy
            });
        // An update that is much smaller than the one before says more than a residual.
        let doubted = worse && up && halvings == 0 && stretches == 0 && plan.doubts;
        if !size.is_finite() || (worse && !doubted) {
            if may_halve {
                halve(&mut scratch.update, system.unknowns());
                halvings += 1;
                reach = 0.5 * reach + 0.5;
                continue;
            }
            if !size.is_finite() {
                // Beside the start there may be no value on one side alone.
                if (1..NUDGES.len()).contains(&nudges) {
                    nudge(&mut nudges, system.unknowns(), &scratch.scale);
                    continue;
                }
                break;
            }
        }
        // What still converges is not to be left where rounding would allow it.
        let long = (k >= DAMPED && (stalls > 0 || k >= DAMPED + GRACE)) || (opened && k >= PATIENT);
        if residual.iter().all(|&r| r == 0.0) || (long && measure.rounds(size, system.unknowns())) {
            system.pairs().1.fill(0.0);
            return Ok(());
        }
        let trial = &mut scratch.trial[..n];
        let solved = if plan.given {
            trial.copy_from_slice(&scratch.jacobian);
            Ok(false)
        } else {
            trial.copy_from_slice(residual);
            plan.linear.solve(&plan.pattern, &scratch.jacobian, trial, &mut scratch.linear, false)
        };
        let mut size = size;
        if before.is_none() && solved.is_ok() && measure.is_blind() {
            scratch.first[..n].copy_from_slice(trial);
            measure = Measure::new(&scratch.weight[..n], &scratch.scale[..n], &scratch.first[..n]);
            size = measure.square(residual);
        }
        let square = measure.square(trial);
        // By an infinite slope the update is 0 whatever the residual.
        let told = plan.given || scratch.jacobian.iter().all(|x| x.is_finite());
        if let Some(last) = before.filter(|_| doubted) {
            let closer = solved.is_ok() && told && square <= CLOSER * last;
            if !closer {
                halve(&mut scratch.update, system.unknowns());
                halvings += 1;
                reach = 0.5 * reach + 0.5;
                continue;
            }
            best = size;
        }
        best = best.min(size);
        from = size;
        if solved.is_err() || !square.is_finite() || !told {
            if opened && solved.is_err() && measure.rounds(size, system.unknowns()) {
                system.pairs().1.fill(0.0);
                return Ok(());
            }
            if before.is_some() && solved.is_err() && stretches < STRETCHES {
                // On the flat part of a law, such as one that sticks: beyond it there may be a slope again.
                let factor = stretch(stretches);
                stretches += 1;
                for (u, d) in system.unknowns().iter_mut().zip(&mut scratch.update) {
                    *d *= factor;
                    *u -= *d;
                }
                (best, from) = (f64::INFINITY, f64::INFINITY);
                continue;
            }
            if stretches == STRETCHES {
                // There was none: back to where the flat part was met.
                stretches += 1;
                let (part, whole) = stretched();
                for (u, d) in system.unknowns().iter_mut().zip(&mut scratch.update) {
                    *u += *d * part;
                    *d /= whole;
                }
            }
            if may_halve {
                halve(&mut scratch.update, system.unknowns());
                halvings += 1;
                reach = 0.5 * reach + 0.5;
                continue;
            }
            if plan.given {
                break;
            }
            if before.is_none() && nudges < NUDGES.len() {
                // A law with an infinite slope just where the iteration starts, or none: start beside it.
                nudge(&mut nudges, system.unknowns(), &scratch.scale);
                (best, from) = (f64::INFINITY, f64::INFINITY);
                continue;
            }
            return Err(Failure::Singular { row: solved.err().unwrap_or(0) });
        }
        let mut square = square;
        if !plan.bends.is_empty() {
            let u = system.unknowns();
            for bend in &plan.bends {
                let i = bend.unknown as usize;
                trial[i] = bent(bend, u[i], trial[i]);
            }
            square = measure.square(trial);
        }
        let plain = halvings == 0 && stretches == 0;
        if let Some(last) = before.filter(|_| plain)
            && measure.squares(trial.iter().zip(&scratch.update).map(|(d, e)| d + e)) <= 0.0625 * last
        {
            trial.iter_mut().for_each(|d| *d *= 0.5);
            square *= 0.25;
        }
        std::mem::swap(&mut scratch.update, &mut scratch.trial);
        let d = &scratch.update[..n];
        take(system, d);
        let u = system.unknowns();
        let small = |t: f64| measure.small(t, u, d, size);
        let quick = |last: f64| halvings == 0 && square <= 1e-6 * last;
        let t = match before {
            Some(last) if plan.given => geometric(square, last, plan.left),
            Some(last) if 0.25 * last <= square => 1e-12,
            Some(last) if quick(last) => {
                let t = plan.left * (last / square);
                if t < quick::LAST { t } else { quick::LAST }
            }
            Some(_) | None => 4e-16,
        };
        let done = small(t);
        stalls = if !plan.given && square >= 0.25 * least { stalls + 1 } else { 0 };
        least = least.min(square);
        let quiet = || {
            let told = measure.energy(u);
            told == 0.0 || best <= 1e-20 * told
        };
        let slow = before.is_some_and(|last| square >= 0.25 * last);
        if done || (!plan.given && slow && stalls >= STALLS && (small(1e-10) || (small(1e-6) && quiet()))) {
            if looks == 0 || k + 1 == plan.limit {
                return Ok(());
            }
            (looks, last) = (looks - 1, true);
        }
        if solved == Ok(true) {
            opened = true;
            (best, from) = (f64::INFINITY, f64::INFINITY);
        }
        before = Some(square);
        halvings = 0;
        reach = 1.0 - FALL;
        stretches = 0;
    }
    let (worst, change) = measure.worst(system.unknowns(), &scratch.update);
    Err(Failure::NoConvergence { iterations: plan.limit, unknown: plan.unknowns + worst, change })
}

/// Moves the start to the next place beside it.
fn nudge(nudges: &mut usize, unknowns: &mut [f64], scale: &[f64]) {
    let side = NUDGES[*nudges] - nudges.checked_sub(1).map_or(0.0, |k| NUDGES[k]);
    *nudges += 1;
    for (u, s) in unknowns.iter_mut().zip(scale) {
        *u += side * if *s > 0.0 { *s } else { 1.0 };
    }
}

/// By what an update is made longer after so many times.
fn stretch(times: u32) -> f64 {
    if times < STRETCH.0 { 2.0 } else { STRETCH.1 }
}

/// How far all stretches of an update went, as a part of what it is in the end, and how many times as long that is as it
/// was.
pub fn stretched() -> (f64, f64) {
    let (mut sum, mut size) = (0.0, 1.0);
    for k in 0..STRETCHES {
        size *= stretch(k);
        sum += size;
    }
    (sum / size, size)
}

/// The part of the unknowns that the last update may be, of an iteration that converges linearly and may leave a part
/// of them: `square` is its square, `last` that of the one before.
fn geometric(square: f64, last: f64, left: f64) -> f64 {
    if 0.25 * last <= square {
        return 1e-14;
    }
    let t = left * ((last / square).sqrt() - 1.0);
    if t < 1e-12 { t } else { 1e-12 }
}

/// What an update of an unknown becomes along an exponential of it.
fn bent(bend: &Bend, unknown: f64, update: f64) -> f64 {
    let before = bend.rate * (unknown - bend.knee);
    let change = -(bend.rate * update);
    let after = before + change;
    let next = if before > 0.0 {
        if change.abs() <= STRAIGHT {
            return update;
        }
        let grown = 1.0 + change;
        let log = before + eval::unary(Unary::Log, grown);
        if log > 0.0 {
            log
        } else {
            let low = eval::unary(Unary::Exp, before) * grown;
            (if low > -FAR { low } else { -FAR }) - 1.0
        }
    } else if after > 0.0 {
        eval::unary(Unary::Log, 1.0 + after)
    } else {
        return update;
    };
    (before - next) / bend.rate
}

/// Takes back half of an update, and halves it.
fn halve(update: &mut [f64], unknowns: &mut [f64]) {
    for (u, d) in unknowns.iter_mut().zip(update) {
        *d *= 0.5;
        *u += *d;
    }
}

/// The norms of an iteration.
pub(super) struct Measure<'a> {
    weight: &'a [f64],
    scale: &'a [f64],
    weighted: bool,
    /// The mean of `w_j s_j²`: what an unknown without a weight counts for at its scale.
    share: f64,
    /// The first update: the scale of what has none.
    first: &'a [f64],
}

impl<'a> Measure<'a> {
    pub(super) fn new(weight: &'a [f64], scale: &'a [f64], first: &'a [f64]) -> Self {
        let known = || weight.iter().zip(scale).filter(|&(&w, _)| counts(w));
        let count = known().count();
        let share = known().map(|(w, s)| w * s * s).sum::<f64>() / count as f64;
        Self { weight, scale, weighted: count > 0, share, first }
    }

    /// The weight of an unknown; 0 where nothing tells it.
    fn weight(&self, i: usize) -> f64 {
        let known = self.known(i);
        if counts(known) {
            return known;
        }
        let w = self.share / (self.first[i] * self.first[i]);
        if counts(w) { w } else { 0.0 }
    }

    /// That by its own weight or its scale, where it has one.
    fn known(&self, i: usize) -> f64 {
        let (w, s) = (self.weight[i], self.scale[i]);
        if counts(w) { w } else { self.share / (s * s) }
    }

    /// Whether there are unknowns without a weight and without a scale.
    fn is_blind(&self) -> bool {
        self.weighted && (0..self.weight.len()).any(|i| !counts(self.known(i)))
    }

    /// `|v|²`
    pub(super) fn square(&self, v: &[f64]) -> f64 {
        self.squares(v.iter().copied())
    }

    fn squares(&self, v: impl Iterator<Item = f64>) -> f64 {
        if self.weighted {
            // What has no weight must be finite all the same.
            v.enumerate().map(|(i, v)| self.weight(i) * v * v).sum()
        } else {
            v.map(|v| v * v).sum()
        }
    }

    /// `Σ w_i (u_i² + s_i²)`, of what has no weight of its own at its scale alone: where that is next to nothing, it says
    /// nothing of the unknown.
    fn energy(&self, u: &[f64]) -> f64 {
        if !self.weighted {
            return 0.0;
        }
        let own = |i: usize, u: f64| if counts(self.weight[i]) { u * u } else { 0.0 };
        u.iter().zip(self.scale).enumerate().map(|(i, (u, s))| self.weight(i) * (own(i, *u) + s * s)).sum()
    }

    /// Whether `|r|²` is what rounding leaves.
    fn rounds(&self, size: f64, u: &[f64]) -> bool {
        size <= 1e-32 * self.energy(u)
    }

    /// Whether `|r|²` is next to nothing beside the unknowns, or rounding that it was before the update, `from`, as well.
    fn clears(&self, size: f64, from: f64, u: &[f64]) -> bool {
        let energy = self.energy(u);
        energy == 0.0 || size <= 1e-28 * energy || (size <= 1e-24 * energy && from <= 4.0 * size)
    }

    /// Whether an update is small beside the unknowns; `size` is `|r|²` before it.
    fn small(&self, t: f64, u: &[f64], d: &[f64], size: f64) -> bool {
        let mut bound = None;
        let mut bound_of = || {
            let energy = self.energy(u);
            if size <= energy { t * t * energy } else { -1.0 }
        };
        for (i, (u_i, d_i)) in u.iter().zip(d).enumerate() {
            if d_i.abs() <= t * (u_i.abs() + self.scale[i]) {
                continue;
            }
            let w = self.weight[i];
            if !counts(w) || w * d_i * d_i > *bound.get_or_insert_with(&mut bound_of) {
                return false;
            }
        }
        true
    }

    /// The unknown whose change is largest beside itself, and the change.
    fn worst(&self, u: &[f64], d: &[f64]) -> (usize, f64) {
        let mut worst = (0, 0.0, -1.0);
        for (i, (u_i, d_i)) in u.iter().zip(d).enumerate() {
            let part = d_i.abs() / (u_i.abs() + self.scale[i]);
            if part > worst.2 {
                worst = (i, *d_i, part);
            }
        }
        (worst.0, worst.1)
    }
}

/// Whether a weight counts.
fn counts(w: f64) -> bool {
    w > 0.0 && w.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equations as a closure `(u, r, j)`.
    struct Closure<F> {
        u: Vec<f64>,
        f: F,
    }

    impl<F: FnMut(&[f64], &mut [f64], &mut [f64])> System for Closure<F> {
        fn evaluate(&mut self, residual: &mut [f64], jacobian: &mut [f64]) -> Result<(), Failure> {
            (self.f)(&self.u, residual, jacobian);
            Ok(())
        }

        fn pairs(&mut self) -> (&mut [f64], &mut [f64]) {
            (&mut self.u, &mut [])
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
        let plan = Plan::of(0, n, pattern, 60, None);
        let mut scratch = plan.scratch();
        scratch.weight.fill(weight);
        scratch.scale.fill(scale);
        let mut system = Closure { u: start.to_vec(), f };
        let mut count = 0;
        let result = solve(&plan, &mut scratch, &mut count, &mut system);
        (result, system.u, count)
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

    /// A ball that touches a plate: its first equation holds at the start, and what the other one asks for has no
    /// weight yet.
    #[test]
    fn an_unknown_without_a_weight_is_seen() {
        let (m, v, k, h) = (0.01, 2.0, 1e7, 8e-5);
        let plan = Plan::of(0, 2, vec![(0, 0), (0, 1), (1, 0), (1, 1)], 60, None);
        let mut scratch = plan.scratch();
        scratch.weight.copy_from_slice(&[1.0 / m, 0.0]);
        scratch.scale.copy_from_slice(&[m * v, h * v]);
        let f = |u: &[f64], r: &mut [f64], j: &mut [f64]| {
            let (p, q) = (u[0], u[1].max(0.0));
            r[0] = p + h * 0.4 * k * q.powf(1.5);
            r[1] = u[1] - h * (v + 0.5 * p / m);
            j.copy_from_slice(&[1.0, h * 0.6 * k * q.sqrt(), -0.5 * h / m, 1.0]);
        };
        let mut system = Closure { u: vec![0.0, 0.0], f };
        let mut count = 0;
        assert_eq!(solve(&plan, &mut scratch, &mut count, &mut system), Ok(()));
        assert!(count <= 8, "{count}");
        assert!((system.u[1] - 1.574706473232915e-4).abs() < 1e-18, "{:e}", system.u[1]);
    }
}
