//! Steps that are fitted to a tolerance: what is planned, tried and kept.
//!
//! A step that goes beyond the instant to which a cluster is advanced is *planned*: computed and found good, but not
//! kept until the cluster is advanced past its end. So rows of output lie inside of steps, and an input that is set at
//! a row ends the step there. A plan is a cache: the state of a run without it gives the same plan again.

use super::Error;
use super::attempt::Attempt;
use super::cluster::{Run, advance_ports, book_step};
use super::controller::{Accepted, Control, Plan, exp, log};
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
            self.watched.iter_mut().for_each(|drawn| drawn.look((&self.ledger, &self.layout), end));
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

    /// Prepares attempts at a step from `t`: what it must meet, the first length to try, and the guards there. `begins`
    /// where a law has switched at `t`.
    fn begin_step(
        &mut self,
        c: &Cluster,
        t: f64,
        (end, begins): (Option<f64>, bool),
        control: &mut Control,
    ) -> Result<Option<f64>, Error> {
        let Some(fit) = &self.fit else { return Ok(end) };
        let (longest, limit) = (fit.longest, fit.limit);
        // By exponentials things may go far before the time does.
        if self.steps == 0 && control.events == 0 || begins && (c.has_exponentials || c.step.properties.l_stable) {
            let first = control.ahead.min(longest);
            let Some(found) = self.first_step(c, t, first) else {
                let (region, step) = (c.name.clone(), self.numeric.controller.min_step_exponential * first);
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
        Ok(end)
    }

    /// Tries steps from `t` until one is good: where it ends, and whether the whole counts. The controller is then
    /// after it.
    fn fitted(&mut self, c: &Cluster, t: f64, end: Option<f64>) -> Result<(f64, bool), Error> {
        let o = self.numeric.controller;
        let Some(fit) = &self.fit else { return Ok((t, true)) };
        let (tolerance, longest, mut control) = (fit.tolerance, fit.longest, fit.control);
        let order = f64::from(c.step.properties.order + 1);
        let mut begins = t > 0.0 && control.began == t;
        let end = self.begin_step(c, t, (end, begins), &mut control)?;
        let (mut last_failure, mut refused) = (None, None::<Attempt>);
        let usual = self.default_step;
        let (mut failures, mut off, mut endless) = (0, None::<f64>, false);
        let shortest = match c.has_exponentials {
            true => o.min_step_exponential * usual,
            false => (o.time_resolution * t.abs()).max(o.min_step * usual),
        };
        let unsolved = shortest.max(o.min_step * control.ahead.min(longest).min(usual));
        let (smallest, result) = loop {
            if let Some(fit) = &mut self.fit {
                fit.spare = failures >= o.max_own_failures;
            }
            let h = control.ahead.min(longest);
            let aimed = control.aimed((t, h), (shortest.max(self.numeric.events.start * usual), longest), &o);
            let aims = aimed.is_some();
            let (h, last) = to_end((t, aimed.unwrap_or(h)), end);
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
                    let stuck = off.zip(now).is_some_and(|(off, now)| now > o.balance_decay * off);
                    off = now;
                    if stuck {
                        failures = failures.max(o.max_own_failures);
                    } else {
                        control.ahead = o.failure_shrink * h;
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
            // A method that looks at the end of its step sees what holds beyond the switch, however near that is.
            let brief = attempt.event && attempt.h < o.brief_event_step * usual;
            if ratio > 1.0 && !vain && !brief {
                control.ahead = attempt.h * (o.safety * exp(-log(ratio) / order)).max(o.max_shrink).min(o.safety);
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
            control.crawl = match attempt.h < o.crawl * usual && done.is_none() {
                true if hard || attempt.h < o.endless * usual => control.crawl + o.crawl_refund,
                true => control.crawl.saturating_sub(1),
                false => 0,
            };
            if control.crawl > o.crawl_refund * o.max_crawling {
                endless = !hard;
                break (h, None);
            }
            if attempt.event {
                control.after_event((attempt.h, attempt.faint), (ends, usual), &o);
            } else {
                // What the other stepper took says nothing against longer steps.
                let other = self.fit.as_ref().is_some_and(|f| f.spare);
                let most = if refused.is_some() || (last_failure.is_some() && !other) { 1.0 } else { o.max_growth };
                let taken = Accepted { t, h, aims, vain, most, error: ratio, order };
                control.after_step(taken, self.foretold(t, h), &o);
            }
            break (h, Some((done.unwrap_or(ends), attempt.whole)));
        };
        if let Some(fit) = &mut self.fit {
            fit.control = control;
            fit.spare = false;
        }
        match (result, last_failure) {
            (Some(found), _) => Ok(found),
            (None, Some(why)) if control.crawl <= o.crawl_refund * o.max_crawling => Err(self.failure(c, t, why)),
            (None, _) => Err(too_short(c, t, smallest, refused, endless)),
        }
    }
}
