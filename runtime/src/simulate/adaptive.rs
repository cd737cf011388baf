//! Steps that are fitted to a tolerance: what is planned, tried and kept.
//!
//! A step that goes beyond the instant to which a cluster is advanced is *planned*: computed and found good, but not
//! kept until the cluster is advanced past its end. So rows of output lie inside of steps, and an input that is set at
//! a row ends the step there. A plan is a cache: the state of a run without it gives the same plan again.

use super::Error;
use super::attempt::Attempt;
use super::cluster::{Run, advance_ports, book_step};
use super::controller::{Accepted, Control, Plan, exp, log};
use super::stepping::Fitted;
use crate::kernel::Failure;
use crate::scene::Cluster;

/// Instants closer to one another than this part of themselves are one.
const SAME: f64 = 1e-12;

/// The length of a step from `t` of length `h` as it meets an end, and that end if it does: two steps of like length
/// rather than one and a splinter.
fn to_end((t, h): (f64, f64), end: Option<f64>) -> (f64, Option<f64>) {
    match end {
        Some(end) if t + h >= end * (1.0 - SAME) => (end - t, Some(end)),
        Some(end) if t + 2.0 * h > end => (0.5 * (end - t), None),
        Some(_) | None => (h, None),
    }
}

/// Steps are so short that the run does not get on: they are good, or else what is off most in the last one says where.
fn too_short(c: &Cluster, time: f64, step: f64, refused: Option<Attempt>, endless: bool) -> Error {
    let region = c.name.clone();
    if endless {
        return Error::Endless { time, region, step, jumps: c.jumps.clone() };
    }
    let state = refused.and_then(|r| c.names.get(r.worst).cloned());
    Error::TooSmall { time, region, state, at_once: c.has_exponentials, step }
}

impl Fitted<'_> {
    /// Drops the planned step: what it was planned with changes.
    pub(super) fn drop_plan(&mut self) {
        if let Some(plan) = self.fit.plan.take() {
            (self.fit.control, self.run.step.work.newton_iterations) = plan.before;
        }
    }

    /// Takes one step, none beyond `end`; whether it ends there.
    pub(super) fn step_towards(&mut self, end: f64, moved: &mut [f64]) -> Result<bool, Error> {
        let is_left = |run: &Run| end - run.time() > SAME * end.abs();
        if is_left(self.run) {
            let mut plan = match self.fit.plan.filter(|_| !self.fit.driven) {
                Some(plan) => plan,
                None => self.plan(Some(end).filter(|_| self.fit.driven))?,
            };
            if plan.end - end > SAME * end.abs() {
                self.drop_plan();
                plan = self.plan(Some(end))?;
            }
            self.keep(plan, moved)?;
        }
        let is_last = !is_left(self.run);
        if is_last {
            (self.run.base, self.run.count) = (end, 0);
        }
        Ok(is_last)
    }

    /// Runs to `end` exactly.
    pub(super) fn run_to(&mut self, end: f64, moved: &mut [f64]) -> Result<(), Error> {
        self.run_past(end, moved)?;
        self.meet(end, moved)
    }

    /// Takes steps of which the last one ends at `end`.
    fn meet(&mut self, end: f64, moved: &mut [f64]) -> Result<(), Error> {
        while end - self.run.time() > SAME * end.abs() {
            self.drop_plan();
            let plan = self.plan(Some(end))?;
            self.keep(plan, moved)?;
        }
        Ok(())
    }

    /// Keeps all steps that end at `until` or before it, and plans the one beyond it.
    pub(super) fn run_past(&mut self, until: f64, moved: &mut [f64]) -> Result<(), Error> {
        if self.fit.driven {
            return self.meet(until, moved);
        }
        while until - self.run.time() > SAME * until.abs() {
            let plan = match self.fit.plan {
                Some(plan) => plan,
                None => self.plan(None)?,
            };
            if plan.end - until > SAME * until.abs() {
                // The look is not needed to go on; where it fails, whoever looks is told.
                let _ = self.look_at(until);
                return Ok(());
            }
            self.keep(plan, moved)?;
        }
        Ok(())
    }

    /// Leaves the state at `t` aside: by steps from the state, or from halfway through the planned one.
    pub(super) fn look_at(&mut self, t: f64) -> Result<(), Error> {
        let Self { c, run, fit } = self;
        if fit.shown == Some(t) {
            return Ok(());
        }
        fit.shown = None;
        run.by_spare = fit.control.stiff;
        let mut now = run.time();
        let least = 1e-12 * t.abs().max(now.abs());
        run.glanced.copy_from_slice(&run.state);
        if t - now <= least {
            return Ok(());
        }
        if fit.is_midway(t - now, least) {
            now += fit.half.h;
            run.glanced.copy_from_slice(&fit.half.next);
        }
        fit.single = run.glance_to(c, now, t)?;
        fit.shown = Some(t);
        let n = fit.output.len();
        fit.output.copy_from_slice(&run.output()[..n]);
        Ok(())
    }

    /// Keeps the planned step; of one whose ledger fails, what comes before that.
    fn keep(&mut self, plan: Plan, moved: &mut [f64]) -> Result<(), Error> {
        let Self { c, run, fit } = self;
        let mut end = run.time();
        fit.plan = None;
        let switched = plan.control.events > plan.before.0.events;
        fit.control = plan.control;
        fit.shown = None;
        fit.midway = false;
        let parts = [&fit.whole, &fit.first, &fit.second];
        let parts = if plan.whole { &parts[..1] } else { &parts[1..] };
        let mut failed = None;
        if !run.signals.lines.pasts.is_empty() {
            run.by_spare = fit.control.stiff;
            run.aim(end, plan.end);
        }
        let at = c.states..c.states + c.integrals;
        for part in parts {
            if let Err(what) = book_step(&run.ledger, &run.layout, c, &part.output) {
                failed = Some((what, end + part.h, part.next.clone()));
                break;
            }
            run.take_down_to(c, end, part.h, &part.next)?;
            end += part.h;
            run.watch(end);
            advance_ports(c, &part.output, part.h, moved);
            for ((m, x), before) in fit.moved.iter_mut().zip(&part.next[at.clone()]).zip(&run.state[at.clone()]) {
                *m += (x - before).abs();
            }
            run.state.copy_from_slice(&part.next);
            run.steps += 1;
        }
        if let Some(length) = c.recall.filter(|_| switched) {
            run.state[length] = 0.0;
        }
        run.base = if failed.is_none() { plan.end } else { end };
        run.count = 0;
        run.track(c);
        failed.map_or(Ok(()), |(what, at, next)| Err(run.unsound(c, (at, &next), &what)))
    }

    /// Finds the next step: one that meets `end`, where one is given, if it comes so far.
    fn plan(&mut self, end: Option<f64>) -> Result<Plan, Error> {
        let before = (self.fit.control, self.run.iterations());
        let result = self.find_step(self.run.time(), end);
        let fit = &mut *self.fit;
        match result {
            Ok((end, whole)) => {
                let control = std::mem::replace(&mut fit.control, before.0);
                let plan = Plan { end, whole, control, before };
                fit.plan = Some(plan);
                Ok(plan)
            }
            Err(e) => {
                fit.control = Control { rejected: fit.control.rejected, ..before.0 };
                Err(e)
            }
        }
    }

    /// Prepares attempts at a step from `t`: what it must meet, the first length to try, and the guards there. `begins`
    /// where a law has switched at `t`.
    fn begin_step(
        &mut self,
        t: f64,
        (end, begins): (Option<f64>, bool),
        control: &mut Control,
    ) -> Result<Option<f64>, Error> {
        let (longest, limit) = (self.fit.longest, self.fit.limit);
        // By exponentials things may go far before the time does.
        if self.run.steps == 0 && control.events == 0
            || begins && (self.c.has_exponentials || self.c.step.properties.l_stable)
        {
            let first = control.ahead.min(longest);
            let Some(found) = self.first_step(t, first) else {
                let (region, step) = (self.c.name.clone(), self.fit.numeric.controller.min_step_exponential * first);
                return Err(Error::TooSmall { time: t, region, state: None, at_once: true, step });
            };
            control.ahead = found;
        }
        let limit = Some(limit).filter(|l| *l > t + SAME * t.abs());
        let end = end.into_iter().chain(limit).min_by(f64::total_cmp);
        // What is given from outside changes evenly until then.
        let far = t + 2.0 * control.ahead.min(longest);
        let horizon = end.map_or(far, |e| e.min(far));
        let cut = self.run.signals.cut(t, horizon);
        self.run.aim(t, cut.unwrap_or(horizon));
        let end = cut.or(end);
        self.guards_before(t, control.ahead.min(longest));
        if control.faint.is_some_and(|guard| !self.is_low(guard)) {
            // It rose between.
            (control.chatter, control.faint, control.noisy) = (0, None, 0);
        }
        Ok(end)
    }

    /// Tries steps from `t` until one is good: where it ends, and whether the whole counts. The controller is then
    /// after it.
    fn find_step(&mut self, t: f64, end: Option<f64>) -> Result<(f64, bool), Error> {
        let o = self.fit.numeric.controller;
        let (tolerance, longest, mut control) = (self.fit.tolerance, self.fit.longest, self.fit.control);
        let mut begins = t > 0.0 && control.began == t;
        let end = self.begin_step(t, (end, begins), &mut control)?;
        let (mut last_failure, mut refused) = (None, None::<Attempt>);
        let usual = self.fit.usual;
        let (mut failures, mut off, mut endless) = (0, None::<f64>, false);
        let (first, mut others_turn) =
            (control.ahead, self.c.step.properties.explicit || self.c.step.fallback.is_none());
        let shortest = match self.c.has_exponentials {
            true => o.min_step_exponential * usual,
            // What is stiff may begin far faster than it goes on.
            false => (o.time_resolution * t.abs()).max(o.min_step * usual.min(t.abs().max(o.min_step * usual))),
        };
        let unsolved = shortest.max(o.min_step * control.ahead.min(longest).min(usual));
        let (smallest, result) = loop {
            // What is stiff is the fallback's, and what one of the two cannot step the other's.
            self.fit.spare = (failures >= o.max_own_failures) != control.stiff;
            let order = f64::from(self.at_work().properties.error_exponent());
            let h = control.ahead.min(longest);
            let aimed = control.aimed((t, h), (shortest.max(self.fit.numeric.events.start * usual), longest), &o);
            let aims = aimed.is_some();
            let (h, last) = to_end((t, aimed.unwrap_or(h)), end);
            if h <= if last_failure.is_some() { unsolved } else { shortest } {
                break (h, None);
            }
            let attempt = match self.attempt(t, h, control.aim - t) {
                Ok(attempt) => attempt,
                Err(why) => {
                    last_failure = Some(why);
                    failures += 1;
                    // What a quadrature misses falls fast with the step. What does not is a kink, or the rounding of H
                    // near 0.
                    let now = (why == Failure::Balance).then_some(self.fit.off);
                    let stuck = off.zip(now).is_some_and(|(off, now)| now > o.balance_decay * off);
                    off = now;
                    if stuck {
                        failures = failures.max(o.max_own_failures);
                    } else {
                        control.ahead = o.failure_shrink * h;
                    }
                    if failures >= o.max_own_failures && !others_turn {
                        // What an implicit step cannot solve may be no matter of the length.
                        (control.ahead, others_turn) = (first, true);
                    }
                    control.rejected += 1;
                    continue;
                }
            };
            let ratio = attempt.error / tolerance;
            // Near a start from rest every step is alike on its own scale, and shrinking it does not help: it is small
            // enough.
            let alike = |longer: &Attempt| attempt.h < 0.5 * longer.h && attempt.error > 0.25 * longer.error;
            let vain = attempt.fresh && attempt.h < o.fresh_step * usual && refused.as_ref().is_some_and(alike);
            if ratio > 1.0 && !vain {
                control.ahead = attempt.h * (o.safety * exp(-log(ratio) / order)).max(o.max_shrink).min(o.safety);
                control.rejected += 1;
                refused = Some(attempt);
                continue;
            }
            if begins && !attempt.event {
                begins = false;
                if let Some(shorter) = self.set_off(t, attempt.h).filter(|h| *h > shortest) {
                    control.ahead = shorter;
                    control.rejected += 1;
                    continue;
                }
            }
            let done = last.filter(|_| attempt.h >= h);
            if done.is_none() && t + attempt.h <= t && !self.c.has_exponentials {
                break (attempt.h, None);
            }
            // What ends just before a switch goes on just past it, where looks at the next step see what holds there.
            let stood = self.fit.stood;
            let ends = t + stood.map_or(attempt.h, |(_, past)| past);
            control.stood = stood.map(|(guard, _)| guard);
            let hard = refused.is_some() || last_failure.is_some() || attempt.event;
            control.crawl = match attempt.h < o.crawl * usual && done.is_none() {
                true if hard || attempt.h < o.endless * usual => control.crawl + o.crawl_refund,
                true => control.crawl.saturating_sub(1),
                false => 0,
            };
            if control.crawl > o.crawl_refund * o.max_crawling {
                endless = !hard;
                break (h, None);
            }
            if self.fit.spare {
                control.by_fallback += if attempt.whole { 1 } else { 2 };
            }
            if attempt.event {
                control.after_event((attempt.h, attempt.faint), (ends, usual), &o);
            } else {
                // What the other stepper took says nothing against longer steps.
                let own = last_failure.is_some() && !self.fit.spare;
                if let Some(slot) = self.c.step.stiffness.filter(|_| control.stiff == self.fit.spare) {
                    let ratio = (!self.fit.spare).then(|| self.fit.whole.output[slot]);
                    control.feel(attempt.h, ratio, &o);
                }
                let most = if refused.is_some() || own { 1.0 } else { o.max_growth };
                let taken = Accepted { t, h, aims, vain, most, error: ratio, order };
                control.after_step(taken, self.foretold(t, h), &o);
            }
            break (h, Some((done.unwrap_or(ends), attempt.whole)));
        };
        self.fit.control = control;
        self.fit.spare = false;
        match (result, last_failure) {
            (Some(found), _) => Ok(found),
            (None, Some(why)) if control.crawl <= o.crawl_refund * o.max_crawling => {
                Err(self.run.failure(self.c, t, why))
            }
            (None, _) => Err(too_short(self.c, t, smallest, refused, endless)),
        }
    }
}
