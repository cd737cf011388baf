//! Steps that are fitted to a tolerance: what is planned, tried and kept.
//!
//! A step that goes beyond the instant to which a cluster is advanced is *planned*: computed and found good, but not
//! kept until the cluster is advanced past its end. So rows of output lie inside of steps, and an input that is set at
//! a row ends the step there. A plan is a cache: the state of a run without it gives the same plan again.

use super::Error;
use super::attempt::Attempt;
use super::cluster::{Run, advance_ports, book_step};
use super::controller::{Control, FIRST, Plan};
use super::event::{STANDS, noise};
use crate::eval;
use crate::ir::Unary;
use crate::kernel::Failure;
use crate::scene::Cluster;

/// So many steps in a row may be shorter than this part of the usual one and be met only at another attempt; then a run
/// does not get on, and stops. One that is met at once takes back a part of what such a step counts.
const CRAWL: (u32, f64) = (20_000, 1e-5);
const TAKEN_BACK: u32 = 4;
/// Of steps as short as this part of the usual one a run has more than it will ever come through.
const ENDLESS: f64 = 1e-7;
/// No step is shorter than this part of the time that it begins at, nor than that part of the usual step, nor, where
/// longer ones are not solved, than that part of what was tried first.
const RESOLVED: f64 = 1e-13;
const SHORTEST: f64 = 1e-12;
/// No step of exponential laws is shorter than this part of the usual one, whatever the time: where they begin to move
/// things they may be far faster than where they go on.
const AT_ONCE: f64 = 1e-290;
/// What begins at rest moves by less than this part of what a step of twice the length moves it by.
const LESS: f64 = 0.95;
/// What a step is shorter than the controller's best guess.
const SAFE: f64 = 0.9;
/// Steps grow and shrink by no more than this at once.
const GROW: f64 = 5.0;
const SHRINK: f64 = 0.1;
/// Where steps of this part of the usual one have no solution that is found, the other stepper takes them.
const HARD: f64 = 1e-2;
/// Of a step that fails so much is tried next.
const CUT: f64 = 0.25;
/// What a balance is off by should fall below this part when the step is cut.
const FALLS: f64 = 1.0 / 16.0;
/// After so many that fail another stepper tries, where there is one.
const OWN: u32 = 6;
/// The exponents of the controller in the error of a step and of the one before it (Hairer and Wanner, IV.8), times the
/// order of the error.
const PI: (f64, f64) = (0.7, 0.4);
/// The logarithm of an error over the tolerance that is no smaller to the step after it: that of 1e-4.
const LITTLE: f64 = -9.210340371976182;
/// A phase between two switches begins with no more than this part of the last one of its kind: several steps tell
/// where it ends.
const PHASE: f64 = 1.0 / 3.0;
/// A step to a switch that is foretold is longer by at least and at most these parts of itself, so that it rather goes
/// past it; in between by this part of what was foretold before is off by now.
const PAST: (f64, f64) = (1.0 / 256.0, 0.5);
const SHIFT: f64 = 0.5;
/// One that would be shorter than this part of what it might be is not cut for it, unless the guard falls.
const WORTH: f64 = 0.1;
/// What did not come is foretold again where it is nearer than to this many of the step that was cut for it, from its
/// start.
const NEARER: f64 = 1.5;
/// So often, where it does not: while the guard still falls, its parabola says more each time.
const MISSED: u32 = 3;
/// A step to a switch that is shorter than this part of the usual one is taken whatever its error seems to be. (What
/// switches yet sooner is let be.)
const BRIEF: f64 = 1e-8;
/// Instants closer to one another than this part of themselves are one.
const SAME: f64 = 1e-12;

fn exp(x: f64) -> f64 {
    eval::unary(Unary::Exp, x)
}

fn log(x: f64) -> f64 {
    eval::unary(Unary::Log, x)
}

impl Run {
    /// Drops the planned step: what it was planned with changes.
    pub(super) fn drop_plan(&mut self) {
        if let Some(fit) = &mut self.fit
            && let Some(plan) = fit.plan.take()
        {
            fit.control = plan.before.0;
            self.step.work.newton_iterations = plan.before.1;
        }
    }

    /// The controller without what is only planned, and the iterations done.
    pub(super) fn kept(&self) -> (Option<Control>, u64) {
        let iterations = self.iterations();
        let Some(fit) = &self.fit else { return (None, iterations) };
        let (control, iterations) = fit.plan.map_or((fit.control, iterations), |p| p.before);
        (Some(control), iterations)
    }

    /// Runs to `end` exactly.
    pub(super) fn fit_to(&mut self, c: &Cluster, end: f64, moved: &mut Vec<f64>) -> Result<(), Error> {
        self.fit_past(c, end, moved)?;
        while end - self.time() > SAME * end.abs() {
            self.drop_plan();
            self.plan(c, Some(end))?;
            self.keep(c, moved)?;
        }
        Ok(())
    }

    /// Keeps all steps that end at `until` or before it, and plans the one beyond it.
    pub(super) fn fit_past(&mut self, c: &Cluster, until: f64, moved: &mut Vec<f64>) -> Result<(), Error> {
        if self.fit.as_ref().is_some_and(|f| f.driven) {
            while until - self.time() > SAME * until.abs() {
                self.drop_plan();
                self.plan(c, Some(until))?;
                self.keep(c, moved)?;
            }
            return Ok(());
        }
        while until - self.time() > SAME * until.abs() {
            let Some(fit) = &self.fit else { return Ok(()) };
            let end = match fit.plan {
                Some(plan) => plan.end,
                None => self.plan(c, None)?,
            };
            if end - until > SAME * until.abs() {
                // The look is not needed to go on; where it fails, whoever looks is told.
                let _ = self.look_at(c, until);
                return Ok(());
            }
            self.keep(c, moved)?;
        }
        Ok(())
    }

    /// Keeps the planned step; of one whose ledger fails, what comes before that.
    fn keep(&mut self, c: &Cluster, moved: &mut Vec<f64>) -> Result<(), Error> {
        let mut end = self.time();
        let Some(fit) = &mut self.fit else { return Ok(()) };
        let Some(plan) = fit.plan.take() else { return Ok(()) };
        let switched = plan.control.events > plan.before.0.events;
        fit.control = plan.control;
        fit.shown = None;
        fit.midway = false;
        let parts = [&fit.whole, &fit.first, &fit.second];
        let parts = if plan.whole { &parts[..1] } else { &parts[1..] };
        let mut failed = None;
        let at = c.states..c.states + c.integrals;
        for part in parts {
            if let Err(what) = book_step(&self.ledger, &self.layout, c, &part.output) {
                failed = Some((what, end + part.h, part.next.clone()));
                break;
            }
            end += part.h;
            advance_ports(c, &part.output, part.h, moved);
            for ((m, x), before) in fit.moved.iter_mut().zip(&part.next[at.clone()]).zip(&self.state[at.clone()]) {
                *m += (x - before).abs();
            }
            self.state.copy_from_slice(&part.next);
            self.steps += 1;
        }
        if let Some(length) = c.recall.filter(|_| switched) {
            self.state[length] = 0.0;
        }
        self.base = if failed.is_none() { plan.end } else { end };
        self.count = 0;
        self.track(c);
        failed.map_or(Ok(()), |(what, at, next)| Err(self.unsound(c, (at, &next), &what)))
    }

    /// Finds the next step: one that meets `end`, where one is given, if it comes so far. Gives where it ends.
    fn plan(&mut self, c: &Cluster, end: Option<f64>) -> Result<f64, Error> {
        let t = self.time();
        let Some(fit) = &self.fit else { return Ok(t) };
        let before = (fit.control, self.iterations());
        let result = self.fitted(c, t, end);
        let Some(fit) = &mut self.fit else { return Ok(t) };
        match result {
            Ok((end, whole)) => {
                let control = std::mem::replace(&mut fit.control, before.0);
                fit.plan = Some(Plan { end, whole, control, before });
                Ok(end)
            }
            Err(e) => {
                fit.control = Control { rejected: fit.control.rejected, ..before.0 };
                Err(e)
            }
        }
    }

    /// Tries steps from `t` until one is good: where it ends, and whether the whole counts. The controller is then
    /// after it.
    fn fitted(&mut self, c: &Cluster, t: f64, end: Option<f64>) -> Result<(f64, bool), Error> {
        let Some(fit) = &self.fit else { return Ok((t, true)) };
        let (tolerance, longest, limit, mut control) = (fit.tolerance, fit.longest, fit.limit, fit.control);
        let order = f64::from(c.step.properties.order + 1);
        // A law has switched where the step begins. By exponentials things may go far before the time does.
        let mut begins = t > 0.0 && control.began == t;
        if self.steps == 0 && control.events == 0 || begins && (c.has_exponentials || c.step.properties.l_stable) {
            let first = control.ahead.min(longest);
            let Some(found) = self.first_step(c, t, first) else {
                let (region, step) = (c.name.clone(), AT_ONCE * first);
                return Err(Error::TooSmall { time: t, region, state: None, at_once: true, step });
            };
            control.ahead = found;
        }
        let limit = Some(limit).filter(|l| *l > t + SAME * t.abs());
        let end = end.into_iter().chain(limit).min_by(f64::total_cmp);
        // What is given from outside changes evenly until then.
        let far = t + 2.0 * control.ahead.min(longest);
        let horizon = end.map_or(far, |e| e.min(far));
        let cut = self.signals.cut(t, horizon);
        self.signals.aim(&mut self.input, t, cut.unwrap_or(horizon));
        let end = cut.or(end);
        self.guards_before(c, t, control.ahead.min(longest));
        if control.faint.is_some_and(|guard| !self.is_low(guard)) {
            // It rose between.
            (control.chatter, control.faint, control.noisy) = (0, None, 0);
        }
        let (mut last_failure, mut refused) = (None, None::<Attempt>);
        let usual = self.default_step;
        let (mut failures, mut off, mut endless) = (0, None::<f64>, false);
        let shortest = match c.has_exponentials {
            true => AT_ONCE * usual,
            false => (RESOLVED * t.abs()).max(SHORTEST * usual),
        };
        let unsolved = shortest.max(SHORTEST * control.ahead.min(longest).min(usual));
        let (smallest, result) = loop {
            if let Some(fit) = &mut self.fit {
                fit.spare = failures >= OWN;
            }
            let mut h = control.ahead.min(longest);
            let near = control.aim - t;
            let aim = near + (SHIFT * control.shift).min(PAST.1 * near).max(PAST.0 * near);
            // What is foretold next to the end is met as well; what is next to the start, there the step stands.
            let least = near * (1.0 + PAST.0);
            let close = near < h * (1.0 + PAST.0) && near > shortest.max(STANDS * usual) && least <= longest;
            let to = aim.min(h.max(least));
            let aims = close && to != h && (to > WORTH * h || control.falls);
            if aims {
                h = to;
            }
            // Two steps of like length rather than one and a splinter.
            let mut last = None;
            if let Some(end) = end {
                if t + h >= end * (1.0 - SAME) {
                    h = end - t;
                    last = Some(end);
                } else if t + 2.0 * h > end {
                    h = 0.5 * (end - t);
                }
            }
            if h <= if last_failure.is_some() { unsolved } else { shortest } {
                break (h, None);
            }
            let attempt = match self.attempt(c, t, h, control.aim - t) {
                Ok(attempt) => attempt,
                Err(why) => {
                    last_failure = Some(why);
                    failures += 1;
                    // What a quadrature misses falls fast with the step. What does not is a kink, or the rounding of H
                    // near 0.
                    let now = self.fit.as_ref().filter(|_| why == Failure::Balance).map(|f| f.off);
                    let stuck = off.zip(now).is_some_and(|(off, now)| now > FALLS * off);
                    off = now;
                    // Equations that are not solved in steps that short may be in no longer ones than next to nothing.
                    let own = self.fit.as_ref().is_some_and(|f| !f.spare) && self.spare.is_some();
                    let hard = own && matches!(why, Failure::NoConvergence { .. }) && h < HARD * usual;
                    if stuck || hard {
                        failures = failures.max(OWN);
                    } else {
                        control.ahead = CUT * h;
                    }
                    control.rejected += 1;
                    continue;
                }
            };
            let ratio = attempt.error / tolerance;
            // Near a start from rest every step is alike on its own scale, and shrinking it does not help: it is small
            // enough; where far shorter ones can be taken, where it moves by less than a longer one.
            let alike = |longer: &Attempt| {
                let apart = c.has_exponentials && attempt.worst == longer.worst && attempt.size > LESS * longer.size;
                attempt.h < 0.5 * longer.h && attempt.error > 0.25 * longer.error && !apart
            };
            let vain = attempt.fresh && attempt.h < 1e-3 * usual && refused.as_ref().is_some_and(alike);
            // A method that looks at the end of its step sees what holds beyond the switch, however near that is.
            let brief = attempt.event && attempt.h < BRIEF * usual;
            if ratio > 1.0 && !vain && !brief {
                control.ahead = attempt.h * (SAFE * exp(-log(ratio) / order)).clamp(SHRINK, SAFE);
                control.rejected += 1;
                refused = Some(attempt);
                continue;
            }
            if begins && !attempt.event {
                begins = false;
                if let Some(shorter) = self.set_off(c, t, attempt.h).filter(|h| *h > shortest) {
                    control.ahead = shorter;
                    control.rejected += 1;
                    continue;
                }
            }
            let done = last.filter(|_| attempt.h >= h);
            if done.is_none() && t + attempt.h <= t && !c.has_exponentials {
                break (attempt.h, None);
            }
            // What ends just before a switch goes on just past it, where looks at the next step see what holds there.
            let stood = self.fit.as_ref().and_then(|fit| fit.stood);
            let ends = t + stood.map_or(attempt.h, |(_, past)| past);
            control.stood = stood.map(|(guard, _)| guard);
            let hard = refused.is_some() || last_failure.is_some() || attempt.event;
            control.crawl = match attempt.h < CRAWL.1 * usual && done.is_none() {
                true if hard || attempt.h < ENDLESS * usual => control.crawl + TAKEN_BACK,
                true => control.crawl.saturating_sub(1),
                false => 0,
            };
            if control.crawl > TAKEN_BACK * CRAWL.0 {
                endless = !hard;
                break (h, None);
            }
            if attempt.event {
                // Beyond the switch another law holds.
                let most = (GROW * attempt.h).min(PHASE * (ends - control.began));
                let here = control.ahead.min(most.max(FIRST * usual));
                (control.ahead, control.other) = (control.other, here);
                (control.began, control.aim, control.missed) = (ends, f64::INFINITY, 0);
                control.events += 1;
                control.chatter = if attempt.faint.is_some() { control.chatter.saturating_add(1) } else { 0 };
                control.noisy = attempt.faint.map_or(0, |guard| control.noisy | noise(guard));
                control.faint = attempt.faint;
                control.last = 0.0;
            } else {
                // What the other stepper took says nothing against longer steps.
                let other = self.fit.as_ref().is_some_and(|f| f.spare);
                let most = if refused.is_some() || (last_failure.is_some() && !other) { 1.0 } else { GROW };
                let now = log(ratio.max(1e-10));
                let steady = PI.1 * control.last - PI.0 * now;
                let factor = SAFE * exp(steady / order);
                let next = h * if vain { 2.0 } else { factor.clamp(2.0 * SHRINK, most) };
                // A step that an end cut short says little of what comes.
                let cut = h < SAFE * control.ahead;
                control.ahead = if cut { next.max(control.ahead) } else { next };
                control.last = if cut { control.last } else { now.clamp(LITTLE, 0.0) };
                // What was foretold and did not come may be rounding, or a guard that never gets there, unless it comes
                // nearer.
                let (aim, falls) = self.foretold(t, h);
                let further = aims && aim > t + NEARER * h;
                control.missed = match (further, aims) {
                    (true, _) => control.missed.saturating_add(1),
                    (false, true) => 0,
                    (false, false) => control.missed,
                };
                control.falls = falls && control.missed <= MISSED;
                let shift = (aim - control.aim).abs();
                control.shift = if shift.is_finite() { shift } else { 0.0 };
                control.aim = if further && !control.falls { f64::INFINITY } else { aim };
            }
            break (h, Some((done.unwrap_or(ends), attempt.whole)));
        };
        if let Some(fit) = &mut self.fit {
            fit.control = control;
            fit.spare = false;
        }
        match (result, last_failure) {
            (Some(found), _) => Ok(found),
            (None, Some(why)) if control.crawl <= TAKEN_BACK * CRAWL.0 => Err(self.failure(c, t, why)),
            (None, _) => {
                let region = c.name.clone();
                if endless {
                    let jumps = c.jumps.clone();
                    return Err(Error::Endless { time: t, region, step: smallest, jumps });
                }
                let state = refused.and_then(|r| c.names.get(r.worst).cloned());
                Err(Error::TooSmall { time: t, region, state, at_once: c.has_exponentials, step: smallest })
            }
        }
    }
}
