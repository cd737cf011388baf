//! The controller of adaptive steps, and the buffers of their attempts.

use super::Options;
use super::error_scale::Scale;
use super::trial::{Taken, copy, is_stateless};
use crate::eval;
use crate::ir::{Array, Unary};
use crate::options::{ControllerOptions, NumericOptions};
use crate::scene::{Cluster, Scene};
use serde::{Deserialize, Serialize};

pub(super) fn exp(x: f64) -> f64 {
    eval::unary(Unary::Exp, x)
}

pub(super) fn log(x: f64) -> f64 {
    eval::unary(Unary::Log, x)
}

/// The controller, as it is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Control {
    /// Length of the next step, s.
    pub(super) ahead: f64,
    /// Length of the steps before the last switch of a law: where two laws alternate, as flight and contact do, those
    /// of the one that comes.
    pub(super) other: f64,
    /// When the last switch was, s.
    pub(super) began: f64,
    /// When the next one is foretold, s; infinite where none is.
    pub(super) aim: f64,
    /// By how much that differs from what was foretold a step before, s.
    pub(super) shift: f64,
    /// Whether the guard that is to switch then came nearer to that in the last step.
    pub(super) falls: bool,
    /// So many steps were cut for what then was further off, since one was not, or the last switch.
    pub(super) missed: u32,
    /// The logarithm of the error of the last step over the tolerance; 0 at a fresh start.
    pub(super) last: f64,
    /// Steps in a row that were far smaller than the usual one.
    pub(super) crawl: u32,
    /// Switches in a row of guards that all but vanish.
    pub(super) chatter: u32,
    /// The guard that did so last, as long as it stays so.
    pub(super) faint: Option<usize>,
    /// Which guards did so since one last switched that did not: bits, of which the last is that of all beyond.
    pub(super) noisy: u64,
    /// The guard that the last step ended just before.
    pub(super) stood: Option<usize>,
    /// Whether the region is stiff, so that the fallback stepper takes the steps.
    pub(super) stiff: bool,
    /// Steps that say that this is to change, and steps in a row since that do not.
    pub(super) changing: u32,
    pub(super) calm: u32,
    /// The length of the step at which that changed last, s.
    pub(super) stable: f64,
    /// Steps that the fallback stepper took.
    pub(super) by_fallback: u64,
    /// Attempts that were not kept.
    pub(super) rejected: u64,
    /// Switches of laws that were located.
    pub(super) events: u64,
}

/// A step that was accepted without an event.
pub(super) struct Accepted {
    pub(super) t: f64,
    pub(super) h: f64,
    /// It was cut for a predicted event.
    pub(super) aims: bool,
    /// A shorter one would be no better.
    pub(super) vain: bool,
    /// The most that the next one may be longer by.
    pub(super) most: f64,
    /// Its error over the tolerance, and the order of that plus 1.
    pub(super) error: f64,
    pub(super) order: f64,
}

impl Control {
    /// At the start of a run.
    pub(super) fn new(ahead: f64) -> Self {
        Self {
            ahead,
            other: ahead,
            began: 0.0,
            aim: f64::INFINITY,
            shift: 0.0,
            falls: false,
            missed: 0,
            last: 0.0,
            crawl: 0,
            chatter: 0,
            faint: None,
            noisy: 0,
            stood: None,
            stiff: false,
            changing: 0,
            calm: 0,
            stable: 0.0,
            by_fallback: 0,
            rejected: 0,
            events: 0,
        }
    }

    /// The length of a step from `t`, in the place of `h`, that goes just past the predicted event; none where that is
    /// too far, nearer than `least`, or not worth it.
    pub(super) fn aimed(&self, (t, h): (f64, f64), (least, longest): (f64, f64), o: &ControllerOptions) -> Option<f64> {
        let near = self.aim - t;
        let aim = near + (o.overshoot_drift * self.shift).min(o.overshoot_max * near).max(o.overshoot_min * near);
        // An event predicted next to the end is met as well; one next to the start is where the step stands.
        let past = near * (1.0 + o.overshoot_min);
        let close = near < h * (1.0 + o.overshoot_min) && near > least && past <= longest;
        let to = aim.min(h.max(past));
        (close && to != h && (to > o.min_event_cut * h || self.falls)).then_some(to)
    }

    /// Counts a step of length `h` that an explicit stepper took, with what it says of stiffness, or its fallback. What
    /// is stiff is so until a step of the fallback would have been stable as well.
    pub(super) fn feel(&mut self, h: f64, ratio: Option<f64>, o: &ControllerOptions) {
        let changes = match ratio {
            Some(ratio) => ratio > o.stable,
            None => h <= self.stable,
        };
        if changes {
            (self.changing, self.calm) = (self.changing + 1, 0);
        } else {
            self.calm += 1;
            self.changing = if self.calm >= o.calm { 0 } else { self.changing };
        }
        if self.changing >= o.stiff {
            (self.stiff, self.stable, self.changing, self.calm) = (!self.stiff, h, 0, 0);
        }
    }

    /// Counts a step that an event ends, at `ends`.
    pub(super) fn after_event(
        &mut self,
        (h, faint): (f64, Option<usize>),
        (ends, usual): (f64, f64),
        o: &ControllerOptions,
    ) {
        // Beyond the switch another law holds.
        let most = (o.max_growth * h).min(o.phase_start * (ends - self.began));
        let here = self.ahead.min(most.max(o.first_step * usual));
        (self.ahead, self.other) = (self.other, here);
        (self.began, self.aim, self.missed) = (ends, f64::INFINITY, 0);
        (self.stiff, self.changing, self.calm) = (false, 0, 0);
        self.events += 1;
        self.chatter = if faint.is_some() { self.chatter.saturating_add(1) } else { 0 };
        self.noisy = faint.map_or(0, |guard| self.noisy | noise(guard));
        self.faint = faint;
        self.last = 0.0;
    }

    /// Counts a step without an event; `predicted` is when the next one is, and whether its guard falls.
    pub(super) fn after_step(&mut self, step: Accepted, (aim, falls): (f64, bool), o: &ControllerOptions) {
        let Accepted { t, h, aims, vain, most, error, order } = step;
        let now = log(error.max(o.min_error));
        let steady = o.previous_error_exponent * self.last - o.error_exponent * now;
        let factor = o.safety * exp(steady / order);
        let next = h * if vain { 2.0 } else { factor.max(2.0 * o.max_shrink).min(most) };
        // A step that an end cut short says little of what comes.
        let cut = h < o.safety * self.ahead;
        self.ahead = if cut { next.max(self.ahead) } else { next };
        self.last = if cut { self.last } else { now.max(log(o.min_previous_error)).min(0.0) };
        // What was foretold and did not come may be rounding, or a guard that never gets there, unless it comes
        // nearer.
        let further = aims && aim > t + h;
        self.missed = match (further, aims) {
            (true, _) => self.missed.saturating_add(1),
            (false, true) => 0,
            (false, false) => self.missed,
        };
        self.falls = falls && self.missed <= o.max_missed;
        let shift = (aim - self.aim).abs();
        self.shift = if shift.is_finite() { shift } else { 0.0 };
        self.aim = if further && !self.falls { f64::INFINITY } else { aim };
    }
}

/// A step that was found good.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    pub(super) end: f64,
    /// Whether the step counts as a whole, or else its halves.
    pub(super) whole: bool,
    /// The controller after it.
    pub(super) control: Control,
    /// The controller and the iterations before it.
    pub(super) before: (Control, u64),
}

/// What fits the steps of a cluster to a tolerance.
pub(super) struct Fit {
    pub(super) tolerance: f64,
    pub(super) longest: f64,
    /// The step of a region that has no tolerance, s.
    pub(super) usual: f64,
    pub(super) numeric: NumericOptions,
    /// What an error of each state and integral is measured by.
    pub(super) scales: Vec<Scale>,
    /// Whether laws are kept on the branches that end the inputs.
    pub(super) branched: bool,
    pub(super) control: Control,
    /// The next instant that has to be met.
    pub(super) limit: f64,
    /// It is driven from outside, so that every instant to which it is advanced is met.
    pub(super) driven: bool,
    /// What went into and out of each integral.
    pub(super) moved: Vec<f64>,
    pub(super) plan: Option<Plan>,
    /// Whether the stepper that takes what the first one cannot is at work.
    pub(super) spare: bool,
    /// What the balance of an attempt that was not good for that was off by, J.
    pub(super) off: f64,
    /// A whole step, and its halves.
    pub(super) whole: Taken,
    pub(super) first: Taken,
    pub(super) second: Taken,
    /// A look on the way.
    pub(super) trial: Taken,
    /// By how much each state was moved by a look at a short step.
    pub(super) moves: Vec<f64>,
    /// The guard that the step which is tried ends just before, and the length of a step that ends just past its
    /// change.
    pub(super) stood: Option<(usize, f64)>,
    /// The guards before a switch, beyond it, and where they were looked at last.
    pub(super) below: Vec<f64>,
    pub(super) beyond: Vec<f64>,
    pub(super) seen: Vec<f64>,
    /// The largest that each guard was at the start of a step.
    pub(super) tops: Vec<f64>,
    /// The instant inside of the planned step that was looked at last.
    pub(super) shown: Option<f64>,
    /// What the last step to it gives, and whether that was the only one.
    pub(super) output: Vec<f64>,
    pub(super) single: bool,
    /// Whether it was looked at from halfway through the planned step, and the first half of that.
    pub(super) midway: bool,
    pub(super) half: Taken,
}

impl Fit {
    pub(super) fn new(c: &Cluster, tolerance: f64, scales: Vec<Scale>, options: &Options, scene: &Scene) -> Self {
        let (numeric, o) = (scene.numeric, &scene.numeric.controller);
        let ahead = o.first_step * options.default_step;
        let guards = c.guards.as_ref().map_or(0, |g| g.count);
        let integrals = &c.initial[c.states..c.states + c.integrals];
        // What has no state does not slow down where something is about to happen: it is looked at evenly.
        let most = if is_stateless(c) { options.default_step } else { f64::INFINITY };
        // What swings in time is looked at often enough not to be stepped over, though nothing moves by it just now.
        let most = c.fastest_period.map_or(most, |period| most.min(o.period_fraction * period));
        Self {
            tolerance,
            longest: options.longest.unwrap_or(f64::INFINITY).min(most),
            usual: options.default_step,
            scales,
            branched: false,
            control: Control::new(ahead),
            limit: 0.0,
            driven: false,
            moved: integrals.iter().map(|x| x.abs()).collect(),
            plan: None,
            spare: false,
            off: 0.0,
            whole: Taken::new(c),
            first: Taken::new(c),
            second: Taken::new(c),
            trial: Taken::new(c),
            moves: vec![0.0; c.states],
            stood: None,
            below: vec![0.0; guards],
            beyond: vec![0.0; guards],
            seen: vec![0.0; guards],
            tops: vec![0.0; guards],
            shown: None,
            output: vec![0.0; c.step.program.size(Array::Output)],
            single: false,
            midway: false,
            half: Taken::new(c),
            numeric,
        }
    }

    /// The controller and the iterations, of which so many are done, without what is only planned.
    pub(super) fn kept(&self, iterations: u64) -> (Control, u64) {
        self.plan.map_or((self.control, iterations), |p| p.before)
    }

    /// Whether an instant that lies so far beyond the state is looked at from halfway through the planned step: where
    /// its halves are what will be kept, a look across the middle would be a longer step than they are, and its error
    /// that of the whole step, which is not the one that was tested.
    pub(super) fn is_midway(&mut self, h: f64, least: f64) -> bool {
        if let Some(plan) = self.plan {
            self.midway = !plan.whole;
            if self.midway {
                copy(&self.first, &mut self.half);
            }
        }
        self.midway &= h - self.half.h > least;
        self.midway
    }
}

/// The bit of a guard in [`Control::noisy`].
pub(super) fn noise(guard: usize) -> u64 {
    1 << guard.min(63)
}
