//! The controller of adaptive steps, and the buffers of their attempts.

use super::Options;
use super::trial::{Taken, copy, is_stateless};
use crate::ir::Array;
use crate::scene::Cluster;
use serde::{Deserialize, Serialize};

/// The longest step, as a part of the shortest period of what swings in time.
const SWING: f64 = 1.0 / 16.0;
/// The first step, as a part of the usual one.
pub(super) const FIRST: f64 = 1e-2;

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
    /// Attempts that were not kept.
    pub(super) rejected: u64,
    /// Switches of laws that were located.
    pub(super) events: u64,
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
    pub(super) fn new(c: &Cluster, tolerance: f64, options: &Options) -> Self {
        let ahead = FIRST * options.default_step;
        let guards = c.guards.as_ref().map_or(0, |g| g.count);
        let integrals = &c.initial[c.states..c.states + c.integrals];
        // What has no state does not slow down where something is about to happen: it is looked at evenly.
        let most = if is_stateless(c) { options.default_step } else { f64::INFINITY };
        // What swings in time is looked at often enough not to be stepped over, though nothing moves by it just now.
        let most = c.fastest_period.map_or(most, |period| most.min(SWING * period));
        Self {
            tolerance,
            longest: options.longest.unwrap_or(f64::INFINITY).min(most),
            control: Control {
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
                rejected: 0,
                events: 0,
            },
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
        }
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
