//! An attempt at an adaptive step: what is computed of it, and its estimated error.

use super::cluster::imbalance;
use super::controller::Fit;
use super::stepping::Fitted;
use super::trial::{Taken, is_stateless};
use crate::energy::{AccountPlaces, Ledger};
use crate::ir::{Array, Slot};
use crate::kernel::Failure;
use crate::scene::{Entries, Stepper};

/// The largest energy so far, above the least that there is, J.
fn above(ledger: &Ledger, p: &AccountPlaces, e: &Entries) -> f64 {
    // What is counted as turned over at least says nothing of sizes.
    let turnover = ledger.get(p.turnover_max);
    let turned = if turnover > e.faintest { turnover } else { 0.0 };
    (ledger.get(p.h_top) - e.floor).max(turned).max(0.0)
}

/// Which step is taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// A whole one.
    Whole,
    /// Its first half.
    First,
    /// Its second half, from where the first one ends.
    Second,
    /// A shorter one, to see where a law switches.
    Trial,
}

/// An attempt.
pub(super) struct Attempt {
    /// Its length; shorter than what was asked for where a law switches.
    pub(super) h: f64,
    /// Its error, relative to the states' sizes.
    pub(super) error: f64,
    /// What is off most was next to nothing before: by the step's own work alone its error is measured.
    pub(super) fresh: bool,
    /// What is off most: a state, or an integral after them.
    pub(super) worst: usize,
    /// Whether the whole step counts, or else its halves.
    pub(super) whole: bool,
    /// It ends where a law switches.
    pub(super) event: bool,
    /// The guard that switches there, where it all but vanishes.
    pub(super) faint: Option<usize>,
}

/// What is off most after a step.
struct Estimate {
    error: f64,
    fresh: bool,
    worst: usize,
}

impl Fitted<'_> {
    /// A step of length `h` from `t`, cut to where a law switches, and its error. That is first looked for at `aim`
    /// from `t`, where that lies within the step.
    pub(super) fn attempt(&mut self, t: f64, h: f64, aim: f64) -> Result<Attempt, Failure> {
        self.keep_branches(true);
        self.fit.stood = None;
        let found = self.tried(t, h, aim);
        if found.is_ok() || self.c.branch().is_none() {
            return found;
        }
        // Beyond a switch a branch may have no value, as the root of what is cut off there.
        self.keep_branches(false);
        self.tried(t, h, aim)
    }

    fn tried(&mut self, t: f64, h: f64, aim: f64) -> Result<Attempt, Failure> {
        // What arrives by delays is a polynomial over just this step.
        let coarse = self.run.aim_lines(t, t + h);
        self.stride(t, h, Part::Whole)?;
        let event = self.event(t, h, aim)?;
        let (h, is_event) = (event.map_or(h, |e| e.0), event.is_some());
        let faint = event.map(|e| e.1).filter(|guard| self.is_faint(*guard));
        if self.is_doubled() {
            if is_event || self.run.guards.is_none() {
                self.stride(t, 0.5 * h, Part::First)?;
            }
            self.stride(t + 0.5 * h, 0.5 * h, Part::Second)?;
        }
        // What ends at a switch was found with a whole step, and so that one counts.
        let near = !is_event && self.is_near();
        let Estimate { error, fresh, worst } = self.estimate(is_event, near)?;
        let error = error.max(coarse);
        let whole = is_event || self.estimate_at().is_some();
        let off = self.off(whole);
        if off == 0.0 {
            return Ok(Attempt { h, error, fresh, worst, whole, event: is_event, faint });
        }
        self.fit.off = off;
        Err(Failure::Balance)
    }

    /// The first step of a run, at most `h`: where a method lets stay what is far too fast for it (Gauss' of an even
    /// number of stages does), or damps it (an L-stable one), or a step is of many turns, a whole step and its halves
    /// may say the same, and no estimate tells that both are wrong. By exponentials a state may be moved so far, too,
    /// where it starts, that what all of them say is worth nothing. So steps that are ever shorter are looked at first,
    /// by which no state may move by more than its size in the first. None where the shortest of them still moves one
    /// of them so.
    pub(super) fn first_step(&mut self, t: f64, h: f64) -> Option<f64> {
        let o = self.fit.numeric.error;
        if self.c.step.properties.explicit {
            return Some(self.first_explicit(t, h));
        }
        let stays = self.c.step.properties.keeps_fast_modes();
        let least = if stays { o.looks } else { 0 };
        let looks = if self.c.has_exponentials { o.looks + o.exponential_looks } else { o.looks };
        let root = self.cool(self.above()).sqrt();
        let (mut first, mut most, mut thrown) = (h, 0.0f64, false);
        for k in 1..=looks {
            let short = h * o.look_shrink.powi(k);
            if self.stride(t, short, Part::Trial).is_err() {
                continue;
            }
            let fit = &mut *self.fit;
            most = 0.0;
            let states = self.run.state.iter().zip(&fit.trial.next).zip(&fit.scales).zip(&mut fit.moves);
            for (((x, y), scale), longer) in states {
                let (moved, size) = ((y - x).abs(), x.abs().max(root * scale.natural));
                if size > scale.faintest {
                    first = if moved * first > size * short { size * short / moved } else { first };
                    most = most.max(moved / size);
                } else if moved > 0.0 {
                    // At rest it has no size: what is moved as far by a far shorter step is thrown there.
                    let part = if k == 1 { 1.0 } else { moved / (o.thrown_ratio * *longer) };
                    thrown |= k > 1 && part >= o.max_first_move;
                    most = most.max(part);
                }
                *longer = moved;
            }
            if k >= least && most < o.max_first_move {
                return Some(if thrown { first.min(short) } else { first });
            }
        }
        (!self.c.has_exponentials || most < o.max_first_move).then_some(first.max(h * o.look_shrink.powi(looks)))
    }

    /// Where a law has switched, and a step of a Gauss method that begins there was found good: how long one may be
    /// that sees how the states begin to move, where that one does not. What is far too fast for it stays, or turns
    /// round, and so it does in its halves. None where each moves on as it begins, or in no step that is not far
    /// shorter still.
    pub(super) fn set_off(&mut self, t: f64, h: f64) -> Option<f64> {
        let o = self.fit.numeric.error;
        let is_of = !self.c.is_non_smooth && self.c.step.properties.repeats_fast_modes();
        if !is_of || self.fit.spare {
            return None;
        }
        let shrink = self.fit.numeric.controller.failure_shrink;
        let h_max = self.above();
        let root = self.cool(h_max).sqrt();
        let least = h * o.look_shrink.powi(o.looks);
        self.stride(t, least, Part::Trial).ok()?;
        let fit = &mut *self.fit;
        let states = self.run.state.iter().zip(&fit.trial.next).zip(&mut fit.moves);
        states.for_each(|((x, y), begins)| *begins = y - x);
        if self.goes_on((h, least), root, |fit| &fit.second.next) {
            return None;
        }
        (1..=o.missed_looks).map(|k| h * shrink.powi(k)).find(|length| {
            let found = self.stride(t, *length, Part::Trial).is_ok();
            found && self.goes_on((*length, least), root, |fit| &fit.trial.next)
        })
    }

    /// Whether no state moves by far less in a step of a length than it begins to move by, as over the least step.
    fn goes_on(&self, (length, least): (f64, f64), root: f64, end: impl Fn(&Fit) -> &[f64]) -> bool {
        let fit = &*self.fit;
        let o = &fit.numeric.error;
        let mut states = self.run.state.iter().zip(end(fit)).zip(&fit.moves).zip(&fit.scales).zip(&self.run.largest);
        states.all(|((((x, y), begins), scale), largest)| {
            let (moved, wanted) = (y - x, begins * (length / least));
            let size = x.abs().max(*largest).max(o.state_floor * root * scale.natural);
            let off = (moved - wanted).abs();
            off <= (fit.tolerance * size).max(o.missed_move * wanted.abs()) || moved.abs() >= wanted.abs()
        })
    }

    /// The first step of an explicit method, at most `h`: one that is too long for what is stiff moves states by the
    /// power of its length that the method has stages, and not as they begin to move.
    fn first_explicit(&mut self, t: f64, h: f64) -> f64 {
        let o = self.fit.numeric.error;
        // States begin to move by the 5/2nd power of the time at most: by its square where a source begins at 0.
        let begins = o.look_shrink.powi(2) * o.look_shrink.sqrt();
        let (mut first, mut looked) = (h, false);
        for k in 0..=o.looks {
            let length = h * o.look_shrink.powi(k);
            let done = self.stride(t, length, Part::Trial).is_ok();
            let fit = &mut *self.fit;
            // By how much each was moved by the longer one is kept where halves will be.
            let states = self.run.state.iter().zip(&fit.trial.next).zip(&mut fit.first.next).take(self.c.states);
            for ((x, y), longer) in states {
                let moved = (y - x).abs();
                if !done || looked && *longer * begins > moved {
                    first = length;
                }
                *longer = moved;
            }
            looked = done;
        }
        first
    }

    /// What of an energy may move states that are no heat, J: what is stored as heat does not come back, and is large
    /// beside all else. Where there is any, what the largest values of the other states come to.
    fn cool(&self, energy: f64) -> f64 {
        if self.c.heats.is_empty() {
            return energy;
        }
        let states = self.fit.scales.iter().zip(&self.run.largest).filter(|(s, _)| !s.heat && s.natural > 0.0);
        states.map(|(s, x)| (x / s.natural).powi(2)).sum::<f64>().min(energy)
    }

    /// What the balance of what counts of an attempt is off by, where another stepper could take it; 0 else.
    fn off(&self, whole: bool) -> f64 {
        let fit = &*self.fit;
        if self.run.spare.is_none() || fit.spare {
            return 0.0;
        }
        let of = |(p, e): (&AccountPlaces, &Entries)| {
            let off = |step: &Taken| imbalance(&self.run.ledger, p, e, &step.output);
            if whole { off(&fit.whole) } else { off(&fit.first).max(off(&fit.second)) }
        };
        self.run.layout.accounts.iter().zip(&self.c.entries).map(of).fold(0.0, f64::max)
    }

    /// The largest energy of the cluster so far, above the least that there is, J.
    fn above(&self) -> f64 {
        self.run.layout.accounts.iter().zip(&self.c.entries).map(|(p, e)| above(&self.run.ledger, p, e)).sum()
    }

    /// The error of the whole step that was just taken, or (where it is not what counts) of its halves, relative to the
    /// states' sizes: the embedded estimate, or what the difference of the two tells. Where there is no state, it
    /// is asked of the ledger's energies: they are integrals, and all that a step's length is seen by. Where the step
    /// is `near` a switch, that difference itself.
    fn estimate(&self, whole: bool, near: bool) -> Result<Estimate, Failure> {
        let mut most = Estimate { error: 0.0, fresh: false, worst: usize::MAX };
        let fit = &*self.fit;
        let o = &fit.numeric.error;
        let h_max = self.above();
        let raised = 2f64.powi(self.at_work().properties.order as i32);
        let part = if whole || near { raised } else { 1.0 } / (raised - 1.0).max(1.0);
        // Divided is what is worse than all before.
        let mut tell = |worst: usize, off: f64, before: f64, now: f64| {
            if off > most.error * now {
                let error = if now > 0.0 { off / now } else { f64::INFINITY };
                most = Estimate { error, fresh: before <= 0.1 * now, worst };
            }
        };
        let (root, cool) = (h_max.sqrt(), self.cool(h_max).sqrt());
        // Errors that are rounding beside what is stored are none.
        let apart = o.state_floor.max(8.0 * f64::EPSILON / fit.tolerance);
        // Where nothing has an energy, each state counts by its own size, as it is now.
        let measured = fit.scales.iter().any(|scale| scale.natural > 0.0);
        for (i, scale) in fit.scales.iter().enumerate() {
            let (x, off) = match self.estimate_at() {
                Some(slot) => (fit.whole.next[i], fit.whole.output[slot + i].abs()),
                None => (fit.second.next[i], (fit.second.next[i] - fit.whole.next[i]).abs() * part),
            };
            if !off.is_finite() {
                return Err(Failure::NotFinite { slot: Slot::new(Array::Next, i) });
            }
            // Of what is compared, both are known to that.
            if off <= scale.faintest + 2.0 * scale.drift * fit.whole.h {
                continue;
            }
            let (before, size) = match i.checked_sub(self.c.states) {
                None => {
                    let root = if scale.heat { root } else { cool };
                    let largest = self.run.largest[i].max(apart * root * scale.natural);
                    let before = if measured { largest } else { self.run.state[i].abs().max(apart * largest) };
                    // What an explicit step has thrown far off is no size: beside it, its own error is small.
                    let is_bounded = self.c.step.properties.passive && measured;
                    let most = if is_bounded || largest == 0.0 { f64::INFINITY } else { o.max_state_growth * largest };
                    (before, x.abs().min(most).max(before))
                }
                // An integral is measured against all that went into it and out of it.
                Some(k) => (fit.moved[k], fit.moved[k] + (x - self.run.state[i]).abs()),
            };
            tell(i, off, before, size);
        }
        let accounts = self.run.layout.accounts.iter().zip(&self.c.entries).filter(|_| is_stateless(self.c));
        for (p, e) in accounts {
            let [supplied, dissipated] = [p.supplied, p.dissipated].map(|at| self.run.ledger.sum(at).abs());
            let moved = supplied.max(dissipated).max(above(&self.run.ledger, p, e));
            for (_, slot) in e.supplied.iter().chain(&e.dissipated) {
                let whole = fit.whole.output[*slot];
                let halves = fit.first.output[*slot] + fit.second.output[*slot];
                let off = (halves - whole).abs() * part;
                if off > 0.0 {
                    tell(usize::MAX, off, moved, halves.abs().max(moved));
                }
            }
        }
        most.error = most.error.min(f64::MAX);
        Ok(most)
    }

    /// The first of the outputs by which the step that is at work estimates its own error, where it does.
    fn estimate_at(&self) -> Option<usize> {
        self.at_work().estimate
    }

    /// The stepper that takes the step.
    pub(super) fn at_work(&self) -> &Stepper {
        self.c.step.fallback.as_deref().filter(|_| self.fit.spare).unwrap_or(&self.c.step)
    }

    /// Whether a step is compared with its halves: where it does not estimate its own error, or has no state to do so.
    fn is_doubled(&self) -> bool {
        self.estimate_at().is_none() || is_stateless(self.c)
    }

    /// One step, from the state (or the end of the first half) into one of the buffers.
    pub(super) fn stride(&mut self, t: f64, h: f64, part: Part) -> Result<(), Failure> {
        let fit = &mut *self.fit;
        self.run.input[0] = t;
        self.run.input[1] = h;
        let state = if part == Part::Second { &fit.first.next } else { &self.run.state };
        let spare = self.run.spare.as_mut().filter(|_| fit.spare);
        let ready = spare.unwrap_or(&mut self.run.step);
        let ran = ready.run(state, &self.run.input);
        let iterations = if fit.spare { std::mem::take(&mut ready.work.newton_iterations) } else { 0 };
        self.run.step.work.newton_iterations += iterations;
        ran?;
        let ready = self.run.spare.as_ref().filter(|_| fit.spare).unwrap_or(&self.run.step);
        let work = &ready.work;
        // 0 times a number is 0 unless it is not finite.
        let spoiled: f64 = work.output.iter().map(|x| 0.0 * x).sum();
        if spoiled != 0.0 {
            let index = work.output.iter().position(|x| !x.is_finite()).unwrap_or(0);
            return Err(Failure::NotFinite { slot: Slot::new(Array::Output, index) });
        }
        let into = match part {
            Part::Whole => &mut fit.whole,
            Part::First => &mut fit.first,
            Part::Second => &mut fit.second,
            Part::Trial => &mut fit.trial,
        };
        into.h = h;
        into.next.copy_from_slice(&work.next);
        // Another stepper that takes the step may say less of it.
        let n = into.output.len().min(work.output.len());
        into.output[..n].copy_from_slice(&work.output[..n]);
        Ok(())
    }
}
