//! The numbers that a run's methods go by: what each means, and of what it is a part.
//!
//! None has a unit. Each is a ratio (of a step to the usual one, of an error to what it is measured against), a count,
//! or a power of a rounding. So a scene that is written in other units takes the same steps.
//!
//! A [`crate::scene::Scene`] carries them, so that the interpreter, machine code and emitted code go by the same ones.
//! The defaults are what models are tested with. Tests and the ablation (`tests/src/bin/ablation.rs`) set others.

use serde::{Deserialize, Serialize};

/// Those of the steps: what a run can be given. Iterations go by the [`NewtonOptions`] that the
/// compiler writes into them, eliminations by [`LinearOptions::DEFAULT`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NumericOptions {
    /// How long steps are that are fitted to a tolerance.
    pub controller: ControllerOptions,
    /// What the error of such a step is measured against, and how long the first one is.
    pub error: ErrorOptions,
    /// Where in a step a law switches.
    pub events: EventOptions,
}

/// More than so many of anything are no count.
const MOST: u32 = 1_000_000;

/// Whether numbers are parts or sizes: finite, and not below 0.
fn are_sizes(list: &[f64]) -> bool {
    list.iter().all(|x| x.is_finite() && *x >= 0.0)
}

/// Whether numbers make shorter what they are multiplied with, and leave something of it.
fn make_shorter(list: &[f64]) -> bool {
    list.iter().all(|x| *x > 0.0 && *x < 1.0)
}

impl NumericOptions {
    /// Whether a run with them comes to an end: what is to be tried again becomes shorter, and counts are not endless.
    pub fn is_sound(&self) -> bool {
        let Self { controller: c, error: e, events: v } = self;
        let counts = [c.max_crawling, c.crawl_refund, c.max_own_failures, c.max_missed, c.stiff, c.calm, v.max_chatter];
        let looks = [e.looks, e.exponential_looks, e.missed_looks];
        let bounded = counts.iter().all(|n| *n <= MOST)
            && c.max_crawling.checked_mul(c.crawl_refund).is_some_and(|n| n < u32::MAX - MOST)
            && looks.iter().all(|n| u32::try_from(*n).is_ok_and(|n| n <= MOST));
        // A step may go past a predicted event by so much; tried again, it has to be shorter all the same.
        let past = (1.0 + c.overshoot_min).powi(2);
        bounded
            && past * c.failure_shrink.max(c.safety) < 1.0
            && make_shorter(&[c.safety, c.max_shrink, c.failure_shrink, e.look_shrink])
            && are_sizes(&[
                c.max_growth,
                c.error_exponent,
                c.previous_error_exponent,
                c.min_previous_error,
                c.min_error,
            ])
            && are_sizes(&[c.first_step, c.period_fraction, c.time_resolution, c.min_step, c.min_step_exponential])
            && are_sizes(&[c.fresh_step, c.crawl, c.endless, c.balance_decay, c.phase_start, c.overshoot_min])
            && are_sizes(&[c.overshoot_max, c.overshoot_drift, c.min_event_cut, c.stable])
            && are_sizes(&[e.state_floor, e.faintest_change, e.max_state_growth])
            && are_sizes(&[e.max_first_move, e.thrown_ratio, e.missed_move])
            && are_sizes(&[v.start, v.peek, v.slow_round, v.noise_floor, v.min_jump, v.max_gap])
            && are_sizes(&[v.approach, v.touch, v.min_pivot])
    }
}

/// The step size controller. The *usual step* is the step that a run takes where nothing else is given: a hundredth of
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerOptions {
    /// Part of the controller's best guess that the next step has.
    pub safety: f64,
    /// Largest ratio of a step to the one before it.
    pub max_growth: f64,
    /// Smallest ratio of a step that is tried again to the one that was refused.
    pub max_shrink: f64,
    /// Ratio of the next attempt to a step that failed, as one whose equations have no solution.
    pub failure_shrink: f64,
    /// Exponent of the step's own error in the next step's length, times the order (Hairer and Wanner, IV.8).
    pub error_exponent: f64,
    /// Exponent of the error of the step before, likewise.
    pub previous_error_exponent: f64,
    /// Least error that a step is remembered by, as a part of the tolerance.
    pub min_previous_error: f64,
    /// Least error that the next step's length goes by, as a part of the tolerance.
    pub min_error: f64,
    /// First step, as a part of the usual one.
    pub first_step: f64,
    /// Longest step, as a part of the shortest period of what swings in time.
    pub period_fraction: f64,
    /// Shortest step, as a part of the time at which it begins.
    pub time_resolution: f64,
    /// Shortest step, as a part of the usual one.
    pub min_step: f64,
    /// The same where laws are exponential: where they begin to move things they may be far faster than later.
    pub min_step_exponential: f64,
    /// Part of the usual step below which a step from rest, that is off by as much as a longer one, is small enough.
    pub fresh_step: f64,
    /// Part of the usual step below which steps crawl.
    pub crawl: f64,
    /// Steps in a row that may crawl and are met only at another attempt; then the run stops.
    pub max_crawling: u32,
    /// How many steps that are met at once make up for one that was not.
    pub crawl_refund: u32,
    /// Part of the usual step of which a run has more steps than it will ever come through.
    pub endless: f64,
    /// Attempts that fail before the fallback stepper tries.
    pub max_own_failures: u32,
    /// Step times largest eigenvalue up to which an explicit step is stable (that of order 8 of Dormand and Prince).
    pub stable: f64,
    /// Steps beyond that, in less than `calm` steps between one another, after which the region is stiff. As many steps
    /// of the fallback stepper that are no longer than such a step show that it is not.
    pub stiff: u32,
    /// Steps in a row within it after which none before them counts.
    pub calm: u32,
    /// Part below which what a balance is off by falls when the step is cut, where a quadrature is why.
    pub balance_decay: f64,
    /// First step after an event, as a part of the last phase of the same kind.
    pub phase_start: f64,
    /// Least part of itself by which a step to a predicted event is longer, so that it goes past it.
    pub overshoot_min: f64,
    /// Largest such part.
    pub overshoot_max: f64,
    /// In between, the part of the last change of the prediction by which it is longer.
    pub overshoot_drift: f64,
    /// Part of its length below which a step is not cut for a predicted event, unless the guard falls.
    pub min_event_cut: f64,
    /// Steps cut in vain for a guard that still falls.
    pub max_missed: u32,
}

impl Default for ControllerOptions {
    fn default() -> Self {
        Self {
            safety: 0.9,
            max_growth: 5.0,
            max_shrink: 0.1,
            failure_shrink: 0.25,
            error_exponent: 0.7,
            previous_error_exponent: 0.4,
            min_previous_error: 1e-4,
            min_error: 1e-10,
            first_step: 1e-2,
            period_fraction: 1.0 / 16.0,
            time_resolution: 1e-13,
            min_step: 1e-12,
            min_step_exponential: 1e-290,
            fresh_step: 1e-3,
            crawl: 1e-5,
            max_crawling: 20_000,
            crawl_refund: 4,
            endless: 1e-7,
            max_own_failures: 6,
            stable: 6.1,
            stiff: 15,
            calm: 6,
            balance_decay: 1.0 / 16.0,
            phase_start: 1.0 / 3.0,
            overshoot_min: 1.0 / 256.0,
            overshoot_max: 0.5,
            overshoot_drift: 0.5,
            min_event_cut: 0.1,
            max_missed: 3,
        }
    }
}

/// The error of a step that is fitted to a tolerance, and the first step of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorOptions {
    /// Least size of a state, as a part of what all energy of its cluster would move it by.
    pub state_floor: f64,
    /// Least change of a state or an integral that counts, as a part of its size ([`crate::scene::Cluster::sizes`]).
    pub faintest_change: f64,
    /// Largest size of a state after an explicit step, as a multiple of its largest value before.
    pub max_state_growth: f64,
    /// Ratio of each step that is looked at before the first one to the one before.
    pub look_shrink: f64,
    /// Such looks for a Gauss method of an even number of stages, which lets stay what is far too fast for it.
    pub looks: i32,
    /// Further looks where laws are exponential, until no state moves by more than `max_first_move`.
    pub exponential_looks: i32,
    /// Largest move of a state in the shortest such step, as a part of its size.
    pub max_first_move: f64,
    /// Ratio of a state's move over one look to that over the next, beyond which it is thrown. The square root of the
    /// time has 16.
    pub thrown_ratio: f64,
    /// Part of what a state begins to move by that it may miss in a step after an event.
    pub missed_move: f64,
    /// How many are tried.
    pub missed_looks: i32,
}

impl Default for ErrorOptions {
    fn default() -> Self {
        Self {
            state_floor: 1e-6,
            faintest_change: 1e-20,
            max_state_growth: 10.0,
            look_shrink: 1.0 / 256.0,
            looks: 4,
            exponential_looks: 110,
            max_first_move: 1.0 / 256.0,
            thrown_ratio: 32.0,
            missed_move: 0.75,
            missed_looks: 10,
        }
    }
}

/// How events are located.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventOptions {
    /// Part of the usual step within which a change of sign is where the step starts, and no event.
    pub start: f64,
    /// Step that tells what the state does not, as a part of the step that is looked at.
    pub peek: f64,
    /// Part of the bracket and of the guard that a round may leave; else one of the other kind follows.
    pub slow_round: f64,
    /// Part of its largest value below which a guard all but vanishes.
    pub noise_floor: f64,
    /// Events in a row of guards below the noise floor, after which these are masked.
    pub max_chatter: u32,
    /// Part of its largest value that a guard has at least, where it jumps beyond 0.
    pub min_jump: f64,
    /// Time that may be passed over at an event, as a multiple of what two instants are told apart by.
    pub max_gap: f64,
    /// Largest part that a guard which comes nearer to 0 leaves in a step.
    pub approach: f64,
    /// Part of its value at both ends of a step below which a guard turns that all but touches 0.
    pub touch: f64,
    /// Least pivot that tells an unknown, as a part of the largest entries.
    pub min_pivot: f64,
}

impl Default for EventOptions {
    fn default() -> Self {
        Self {
            start: 1e-9,
            peek: 1e-4,
            slow_round: 0.25,
            noise_floor: 1e-4,
            max_chatter: 20,
            min_jump: 1e-9,
            max_gap: 1e3,
            approach: 0.75,
            touch: 0.5,
            min_pivot: 1e-9,
        }
    }
}

/// What Newton's method goes by; [`crate::solve::newton`] says where each is used. Norms are the weighted ones of
/// there, all squared, and so are parts of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NewtonOptions {
    /// The part of the unknowns that is rounding.
    pub rounding: f64,
    /// Where else to start, in scales of the unknowns, where the Jacobian at the start cannot be solved.
    pub nudges: [f64; 6],
    /// How often an update that ends where the Jacobian is singular is made longer, to get beyond.
    pub stretches: u32,
    /// The first so many times it is made twice as long: where a flow of next to nothing turns, dry friction goes from
    /// one side to the other by an update of next to nothing.
    pub doublings: u32,
    /// By what it is made longer after that.
    pub stretch: f64,
    /// After so many updates in a row that do not shrink, and are small, rounding moves an unknown that the equations
    /// hardly determine.
    pub stalls: u32,
    /// So many iterations may go by without a residual that falls. Then each update has to make it smaller: about a
    /// steep law that saturates, as friction does, updates may else go from one side to the other for ever, at the same
    /// residual. Of equations that only take power the square of the residual falls along the update.
    pub patience: u32,
    /// The part of the residual's square that a whole update has to take off then; a half one half of it, and so on
    /// (Armijo, Pacific J. Math. 16, 1966).
    pub decrease: f64,
    /// An update that is a smaller part than this of unknowns and scales is let be then: rounding may keep the residual
    /// from falling.
    pub negligible: f64,
    /// How often one update is halved at most.
    pub halvings: u32,
    /// A residual above so many times the smallest so far halves the update.
    pub growth: f64,
    /// But for a residual that is at most this part of the unknowns.
    pub noise: f64,
    /// After so many iterations updates are no longer halved for what the residual becomes: beyond the corner of a law
    /// it may have to be larger first, as where a body that slid one way is to slide the other, or on the way to a
    /// solution of an energy that is not convex, over steps of many turns.
    pub damped: u32,
    /// What converges then needs no more iterations than these.
    pub grace: u32,
    /// The square of an update over that of the one before, at most, after which a residual that is larger says
    /// nothing: its equations weigh more than they determine (a natural test of monotonicity; Deuflhard, Numer. Math.
    /// 22, 1974).
    pub closer: f64,
    /// Of an update that takes back the one before but for this part, half is made.
    pub turned: f64,
    /// An update below this part of the one before shows quadratic convergence.
    pub quadratic: f64,
    /// The largest last update then, as a part of the unknowns.
    pub last: f64,
    /// An update of at least this part of the one before does not shrink.
    pub slow: f64,
    /// The last update that does not shrink, as a part of the unknowns.
    pub stalled: f64,
    /// The same after [`NewtonOptions::stalls`] of them.
    pub hardly_determined: f64,
    /// The same where the residual is rounding.
    pub undetermined: f64,
    /// The part of the unknowns that such a residual is at most.
    pub quiet: f64,
    /// The last update of an iteration that converges linearly, as a part of the unknowns.
    pub linear: f64,
    /// How often the residual is looked at that is left by what was to be the last update.
    pub looks: u32,
    /// The part of the unknowns that this may leave, and the same where it was no more than [`NewtonOptions::growth`]
    /// times as large before.
    pub cleared: (f64, f64),
    /// Updates of an unknown of so many units of an exponent at most are made as they are.
    pub straight: f64,
    /// An update from far up an exponential goes beyond its knee by so many units at most.
    pub beyond_knee: f64,
    /// Of the chord start.
    pub chord: ChordOptions,
}

impl NewtonOptions {
    /// Whether an iteration with them comes to an end soon.
    pub fn is_sound(&self) -> bool {
        let counts =
            [self.stretches, self.doublings, self.stalls, self.patience, self.halvings, self.damped, self.grace];
        counts.iter().chain([&self.looks]).all(|n| *n <= MOST)
    }
}

/// What the chord start goes by; [`crate::solve::iteration::chord`] says where each is used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChordOptions {
    /// Bodies of more instructions than this do not begin so: back ends write them anew for it.
    pub instructions: usize,
    /// So many times the square of the last update over the one before are at most what may be left.
    pub next: f64,
    /// The second update of one equation is corrected where it is at most this part of the first.
    pub corrected: f64,
    /// The largest size that is taken: squares of larger ones overflow.
    pub range: f64,
    /// The largest first update, as a part of the unknowns, after which the second one may be the last. What is far
    /// from where it began says nothing by the matrix from there: of a pendulum over many of its periods a residual may
    /// be small by chance, or beside a matrix that was large.
    pub near: f64,
    /// How far an entry of the matrix may be from what it was, as a part of it, where the iteration ends far from its
    /// start.
    pub alike: f64,
    /// The largest second update that may be rounding alone, as a part of the unknowns.
    pub stalled: f64,
    /// The part of the first update that the second one is at most, where the iteration goes on from it.
    pub good: f64,
}

/// What linear systems are solved by; [`crate::solve::dense`] and [`crate::solve::sparse`] say where each is used. All
/// are parts of entries of the matrix, or of products of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearOptions {
    /// A pivot below this part of its column's largest entry before elimination is taken for 0.
    pub tiny: f64,
    /// Where equations may leave unknowns undetermined, so may a pivot up to this part: rounding leaves that of none.
    pub poor: f64,
    /// What equations that say the same may differ by, as a part of the terms of the right side: in an iteration on its
    /// way to rounding, which is in their last digits. What is left of them is in the next update.
    pub alike: f64,
    /// Two unknowns are solved by Cramer's rule where the determinant is above this part of the sum of its terms,
    pub digits: f64,
    /// and within this range: beyond, products of numbers overflow or lose digits.
    pub range: (f64, f64),
}

impl LinearOptions {
    /// What back ends go by.
    pub const DEFAULT: Self = Self { tiny: 1e-16, poor: 1e-14, alike: 1e-6, digits: 1e-6, range: (1e-200, 1e200) };
}

impl Default for LinearOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl NewtonOptions {
    /// What back ends go by.
    pub const DEFAULT: Self = Self {
        rounding: 4e-16,
        nudges: [1e-3, -1e-3, 2.0, -2.0, 30.0, -30.0],
        stretches: 16,
        doublings: 6,
        stretch: 32.0,
        stalls: 6,
        patience: 12,
        decrease: 0.1,
        negligible: 1e-12,
        halvings: 30,
        growth: 4.0,
        noise: 1e-26,
        damped: 140,
        grace: 20,
        closer: 0.25,
        turned: 0.0625,
        quadratic: 1e-6,
        last: 1e-11,
        slow: 0.25,
        stalled: 1e-12,
        hardly_determined: 1e-10,
        undetermined: 1e-6,
        quiet: 1e-20,
        linear: 1e-12,
        looks: 3,
        cleared: (1e-28, 1e-24),
        straight: 0.125,
        beyond_knee: 1e4,
        chord: ChordOptions {
            instructions: 2000,
            next: 8.0,
            corrected: 0.1,
            range: 1e100,
            near: 1e-2,
            alike: 0.1,
            stalled: 1e-12,
            good: 0.1,
        },
    };

    /// By what an update is made longer after so many times.
    pub fn stretch(&self, times: u32) -> f64 {
        if times < self.doublings { 2.0 } else { self.stretch }
    }

    /// How far all stretches of an update went, as a part of what it is in the end, and how many times as long that is
    /// as it was.
    pub fn stretched(&self) -> (f64, f64) {
        let (mut sum, mut size) = (0.0, 1.0);
        for k in 0..self.stretches {
            size *= self.stretch(k);
            sum += size;
        }
        (sum / size, size)
    }
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
