//! Where in a step a law switches: the guard that changes sign, located by single steps from the start of the step to
//! an instant just past the change.

use super::attempt::Part;
use super::controller::{Control, noise};
use super::guard::Watch;
use super::program::Ready;
use super::stepping::Fitted;
use super::trial::copy;
use crate::kernel::Failure;
use crate::options::EventOptions;
use crate::scene::Cluster;

/// Rounds of a search for a change of sign.
const MAX_ROUNDS: u32 = 60;
/// Searches for an event before one that was located.
const MAX_SOONER: u32 = 16;

/// A point of a guard along the step.
type Point = (f64, f64);

/// Between which points a guard changes sign. Before the switch the guard is smooth along the step, beyond it need not
/// be.
#[derive(Clone, Copy)]
struct Bracket {
    guard: usize,
    low: Point,
    high: Point,
    /// The end of the bracket that was replaced last.
    third: Option<Point>,
    /// Points before `low`, the last one first.
    past: [Option<Point>; 2],
}

impl Bracket {
    fn new(guard: usize, low: Point, high: Point, third: Option<Point>) -> Self {
        Self { guard, low, high, third, past: [None; 2] }
    }

    /// Where the parabola through `low` and two other points is 0 in the bracket.
    fn parabola(&self, p: Point, q: Point) -> Option<f64> {
        let (low, a) = self.low;
        let slope = (p.1 - a) / (p.0 - low);
        let bend = ((q.1 - p.1) / (q.0 - p.0) - slope) / (q.0 - low);
        let tilt = slope - bend * (p.0 - low);
        let root = (tilt * tilt - 4.0 * bend * a).sqrt();
        let k = -0.5 * (tilt + root.copysign(tilt));
        self.inside(a / k).or(self.inside(k / bend))
    }

    fn inside(&self, u: f64) -> Option<f64> {
        (u >= 0.0 && u < self.high.0 - self.low.0).then_some(self.low.0 + u)
    }

    /// The root by both ends of the bracket.
    fn within(&self) -> f64 {
        let ((low, a), (high, b)) = (self.low, self.high);
        let line = || self.inside(-a * (high - low) / (b - a)).unwrap_or(0.5 * (low + high));
        self.third.and_then(|q| self.parabola(self.high, q)).unwrap_or_else(line)
    }

    /// The root by the points before the switch alone, where there are enough.
    fn ahead(&self) -> Option<f64> {
        self.parabola(self.past[0]?, self.past[1]?)
    }
}

/// Where a guard changes its sign.
enum Located {
    /// The length of a step that ends there, and the guard.
    At(f64, usize),
    /// Where the step begins: that guard is let be.
    Stands(usize),
}

impl Fitted<'_> {
    /// Takes down the guards at the start of a step, which will have about this length.
    pub(super) fn guards_before(&mut self, t: f64, h: f64) {
        self.free();
        let Self { c, run, fit } = self;
        let o = fit.numeric.events;
        let Some(guards) = &mut run.guards else { return };
        run.input[0] = t;
        run.input[1] = o.peek * h;
        look(c, guards, &mut run.step, (&run.state, &mut run.input), None, &mut run.before);
        let left = |(k, (x, top)): (usize, (&f64, &f64))| x.abs() <= o.noise_floor * top && guards.is_loop(k);
        if t > 0.0 && fit.control.began == t && run.before.iter().zip(&fit.tops).enumerate().any(left) {
            beyond(c, guards, &mut run.step, (&run.state, &mut run.input), (&fit.tops, &mut run.before), &o);
        }
        fit.tops.iter_mut().zip(&run.before).for_each(|(top, x)| *top = top.max(x.abs()));
        hush(&fit.control, &fit.tops, &mut run.before, &o);
        // The step before this one ended just before its switch.
        if let Some(guard) = fit.control.stood {
            run.before[guard] = 0.0;
        }
    }

    /// Whether laws are kept on the branches that they had at the start of the step, from now on.
    pub(super) fn keep_branches(&mut self, keep: bool) {
        self.fit.branched = keep;
        self.free();
        self.branch();
    }

    /// Has laws look for themselves on which branch they are.
    fn free(&mut self) {
        let at = self.c.branches_at();
        self.run.input[at..].fill(0.0);
    }

    /// Puts laws on the branches that they had at the start of the step, where they are kept there.
    fn branch(&mut self) {
        if !self.fit.branched {
            return;
        }
        let at = self.c.branches_at();
        let sides = self.run.before.iter().map(|x| f64::from(i8::from(*x > 0.0) - i8::from(*x < 0.0)));
        self.run.input[at..].iter_mut().zip(sides).for_each(|(b, side)| *b = side);
    }

    /// Whether a guard all but vanishes where a step starts.
    pub(super) fn is_low(&self, guard: usize) -> bool {
        self.run.before[guard].abs() <= self.fit.numeric.events.noise_floor * self.fit.tops[guard]
    }

    /// Whether a guard that switched in the step all but vanishes.
    pub(super) fn is_faint(&self, guard: usize) -> bool {
        let fit = &*self.fit;
        let most = [&self.run.before, &fit.below, &fit.beyond].iter().fold(0.0f64, |a, list| a.max(list[guard].abs()));
        most <= fit.numeric.events.noise_floor * fit.tops[guard]
    }

    /// Where a law switches in the whole step of length `h` from `t` that was just taken: the length of a step that
    /// ends just past it, which then is the whole step, and the guard. A switch at the very start is let be. Without
    /// one, the first half was taken too, where there are guards. It is first looked for at `aim` from `t`.
    pub(super) fn event(&mut self, t: f64, h: f64, aim: f64) -> Result<Option<(f64, usize)>, Failure> {
        for _ in 0..=self.run.before.len() {
            let Some(bracket) = self.bracket(t, h)? else { return Ok(None) };
            let guard = match self.locate(t, h, aim, bracket)? {
                Located::At(found, guard) => return Ok(Some((found, guard))),
                Located::Stands(guard) => guard,
            };
            // The others may switch all the same.
            self.run.before[guard] = 0.0;
            self.free();
            self.branch();
            self.stride(t, h, Part::Whole)?;
        }
        self.keep_branches(false);
        self.stride(t, h, Part::Whole)?;
        self.stride(t, 0.5 * h, Part::First)?;
        Ok(None)
    }

    /// Locates the switch in a bracket.
    fn locate(&mut self, t: f64, h: f64, aim: f64, mut bracket: Bracket) -> Result<Located, Failure> {
        let floor = (4.0 * f64::EPSILON * (t + h).abs()).max(1e-14 * h);
        let mut past = self.narrow(t, (aim, floor), &mut bracket)?;
        // Another guard may have changed its sign before, and jump back there, as at the end of a turn.
        for _ in 0..if self.c.guards.as_ref().is_some_and(|g| g.jumps) { MAX_SOONER } else { 0 } {
            let Some(sooner) = self.sooner(t, (bracket.low.0, bracket.high.0 - 2.0 * past))? else { break };
            bracket = sooner;
            past = self.narrow(t, (aim, floor), &mut bracket)?;
        }
        let found = bracket.high.0;
        if found < self.fit.numeric.events.start * self.fit.usual && (t + found <= t || !self.jumped()) {
            return Ok(Located::Stands(bracket.guard));
        }
        let before = match &self.c.guards {
            Some(guards) if guards.ends => self.end_before(t, &bracket, (past, floor))?,
            _ => None,
        };
        Ok(Located::At(before.unwrap_or(found), bracket.guard))
    }

    /// Whether a guard is clearly beyond 0 just past a switch: it jumps there, and may jump back within the step.
    fn jumped(&self) -> bool {
        let fit = &*self.fit;
        let mut values = fit.below.iter().zip(&fit.beyond).zip(&fit.tops);
        self.c.guards.as_ref().is_some_and(|g| g.jumps)
            && values.any(|((from, to), top)| from * to < 0.0 && to.abs() > fit.numeric.events.min_jump * top)
    }

    /// The bracket of a guard that changes its sign between where all are as last seen and another place, if one does.
    /// The whole step then ends there.
    fn sooner(&mut self, t: f64, (low, at): (f64, f64)) -> Result<Option<Bracket>, Failure> {
        if at <= low {
            return Ok(None);
        }
        self.stride(t, at, Part::Trial)?;
        self.guards_at(t + at, Part::Trial);
        let o = self.fit.numeric.events;
        let fit = &mut *self.fit;
        let Some(guard) = earliest(&fit.below, &fit.seen).filter(|g| fit.seen[*g].abs() > o.min_jump * fit.tops[*g])
        else {
            return Ok(None);
        };
        std::mem::swap(&mut fit.trial, &mut fit.whole);
        std::mem::swap(&mut fit.seen, &mut fit.beyond);
        Ok(Some(Bracket::new(guard, (low, fit.below[guard]), (at, fit.beyond[guard]), None)))
    }

    /// Narrows a bracket down; how far its end is past the switch.
    fn narrow(&mut self, t: f64, (aim, floor): (f64, f64), bracket: &mut Bracket) -> Result<f64, Failure> {
        let part = self.fit.numeric.events.slow_round;
        let mut past = floor;
        let mut slow = false;
        for round in 0..MAX_ROUNDS {
            let (low, high) = (bracket.low.0, bracket.high.0);
            let within = if round == 0 && aim > low && aim < high { aim } else { bracket.within() };
            if high - within <= 4.0 * past || high - low <= floor {
                break;
            }
            let middle = 0.5 * (low + high);
            let root = match slow {
                true if round % 4 == 3 => middle,
                true => bracket.ahead().unwrap_or(middle),
                false => within,
            };
            if root - low <= past && low > 0.0 {
                past *= 8.0; // missed by rounding alone
            }
            let at = if root + past < high { root + past } else { middle };
            self.stride(t, at, Part::Trial)?;
            self.guards_at(t + at, Part::Trial);
            let fit = &mut *self.fit;
            let least = bracket.low.1.abs().min(bracket.high.1.abs());
            let point;
            if let Some(guard) = earliest(&fit.below, &fit.seen) {
                std::mem::swap(&mut fit.trial, &mut fit.whole);
                std::mem::swap(&mut fit.seen, &mut fit.beyond);
                point = (at, fit.beyond[guard]);
                *bracket = if guard == bracket.guard {
                    Bracket { high: point, third: Some(bracket.high), ..*bracket }
                } else {
                    Bracket::new(guard, (low, fit.below[guard]), point, None)
                };
            } else {
                // A guard that is 0 there has not changed sign yet.
                for (below, seen) in fit.below.iter_mut().zip(&fit.seen).filter(|(_, seen)| **seen != 0.0) {
                    *below = *seen;
                }
                point = (at, fit.seen[bracket.guard]);
                let before = [Some(bracket.low), bracket.past[0]];
                *bracket = Bracket { low: point, third: Some(bracket.low), past: before, ..*bracket };
            }
            slow = bracket.high.0 - bracket.low.0 > part * (high - low) && point.1.abs() > part * least;
        }
        Ok(past)
    }

    /// Ends the whole step just before the switch in a bracket, where a step to there can be had: its length. What is
    /// between is passed over: it has to be rounding.
    fn end_before(&mut self, t: f64, bracket: &Bracket, (past, floor): (f64, f64)) -> Result<Option<f64>, Failure> {
        let (low, high) = (bracket.low.0, bracket.high.0);
        let mut back = 2.0 * past;
        loop {
            let at = low.max(high - back);
            if high - at > self.fit.numeric.events.max_gap * floor || at <= 0.5 * high {
                return Ok(None);
            }
            self.stride(t, at, Part::Trial)?;
            // A look ahead would be beyond the switch.
            self.guards_ahead(t + at, Part::Trial, 0.0);
            let fit = &mut *self.fit;
            if earliest(&self.run.before, &fit.seen).is_none() {
                std::mem::swap(&mut fit.trial, &mut fit.whole);
                fit.stood = Some((bracket.guard, high));
                return Ok(Some(at));
            }
            if at == low {
                return Ok(None);
            }
            back *= 8.0;
        }
    }

    /// When the next switch is foretold after the step of length `h` from `t` that was just found to have none: the
    /// first root of the parabolas through the guards at its start, middle and end; infinite where there is none. And
    /// whether that guard came nearer to 0 in the step, by more than what may be rounding.
    pub(super) fn foretold(&self, t: f64, h: f64) -> (f64, bool) {
        let fit = &*self.fit;
        let o = fit.numeric.events;
        let values = self.run.before.iter().zip(&fit.below).zip(&fit.beyond).zip(&fit.tops);
        let roots = values.filter_map(|(((start, middle), end), top)| {
            let falls = end.abs() < o.approach * start.abs() && start.abs() > o.noise_floor * top;
            next(*start, *middle, *end).map(|u| (t + h + h * u, falls))
        });
        roots.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, false))
    }

    /// Whether a guard all but touches 0 within the step that was just found to have no switch: it may have been beyond
    /// for a while, and a step whose nodes lie on both sides of a switch is none that its order tells the error of.
    pub(super) fn is_near(&self) -> bool {
        let fit = &*self.fit;
        let o = fit.numeric.events;
        let mut values = self.run.before.iter().zip(&fit.below).zip(&fit.beyond).zip(&fit.tops);
        values.any(|(((start, middle), end), top)| {
            start.abs().max(end.abs()) > o.noise_floor * top && touches([*start, *middle, *end], o.touch)
        })
    }

    /// The part of the step in which the first guard changes sign, if one does: what is seen at the end of the step, or
    /// at its middle. The whole step is then the one to the end of that part.
    fn bracket(&mut self, t: f64, h: f64) -> Result<Option<Bracket>, Failure> {
        if self.run.guards.is_none() {
            return Ok(None);
        }
        self.guards_at(t + h, Part::Whole);
        let fit = &mut *self.fit;
        fit.below.copy_from_slice(&self.run.before);
        std::mem::swap(&mut fit.seen, &mut fit.beyond);
        if let Some(guard) = earliest(&fit.below, &fit.beyond) {
            return Ok(Some(Bracket::new(guard, (0.0, fit.below[guard]), (h, fit.beyond[guard]), None)));
        }
        self.middle(t, h)?;
        let fit = &mut *self.fit;
        if let Some(guard) = earliest(&fit.below, &fit.seen) {
            let third = Some((h, fit.beyond[guard]));
            std::mem::swap(&mut fit.seen, &mut fit.beyond);
            copy(&fit.first, &mut fit.whole);
            let (low, high) = ((0.0, fit.below[guard]), (0.5 * h, fit.beyond[guard]));
            return Ok(Some(Bracket::new(guard, low, high, third)));
        }
        std::mem::swap(&mut fit.seen, &mut fit.below);
        // One that changes sign twice to one side of the middle: where the parabola through its three values turns.
        let values = self.run.before.iter().zip(&fit.below).zip(&fit.beyond);
        let turns = values.filter_map(|((start, middle), end)| turn(*start, *middle, *end));
        if let Some(at) = turns.min_by(f64::total_cmp).map(|part| part * h) {
            self.stride(t, at, Part::Trial)?;
            self.guards_at(t + at, Part::Trial);
            let fit = &mut *self.fit;
            if let Some(guard) = earliest(&self.run.before, &fit.seen) {
                std::mem::swap(&mut fit.seen, &mut fit.beyond);
                std::mem::swap(&mut fit.trial, &mut fit.whole);
                let late = at > 0.5 * h;
                if !late {
                    fit.below.copy_from_slice(&self.run.before);
                }
                let low = if late { 0.5 * h } else { 0.0 };
                return Ok(Some(Bracket::new(guard, (low, fit.below[guard]), (at, fit.beyond[guard]), None)));
            }
        }
        // One that changes its sign in the second half, and jumps back right at its end.
        let jumps = self.c.guards.as_ref().is_some_and(|g| g.jumps);
        let min_jump = self.fit.numeric.events.min_jump;
        let is_there = |(x, top): (&f64, &f64)| x.abs() <= min_jump * top;
        if jumps && self.fit.beyond.iter().zip(&self.fit.tops).any(is_there) {
            let at = h - (8.0 * f64::EPSILON * (t + h).abs()).max(1e-13 * h);
            if let Some(bracket) = self.sooner(t, (0.5 * h, at))? {
                return Ok(Some(bracket));
            }
        }
        // A guard that was 0 at the start.
        let fit = &*self.fit;
        let found = earliest(&fit.below, &fit.beyond);
        let ends = |i: usize| ((0.5 * h, fit.below[i]), (h, fit.beyond[i]));
        Ok(found.map(|guard| Bracket::new(guard, ends(guard).0, ends(guard).1, None)))
    }

    /// Looks at the guards in the middle of the whole step: as the step tells it, or else, or where that is beyond a
    /// switch, by a step to there.
    fn middle(&mut self, t: f64, h: f64) -> Result<(), Failure> {
        let n = self.c.states + self.c.integrals;
        if let Some(at) = self.c.branch().and_then(|b| b.middle) {
            let fit = &mut *self.fit;
            fit.first.h = 0.5 * h;
            fit.first.next[..n].copy_from_slice(&fit.whole.output[at..at + n]);
            fit.first.next[n..].copy_from_slice(&fit.whole.next[n..]);
            self.guards_at(t + 0.5 * h, Part::First);
            if earliest(&self.fit.below, &self.fit.seen).is_none() {
                return Ok(());
            }
        }
        self.stride(t, 0.5 * h, Part::First)?;
        self.guards_at(t + 0.5 * h, Part::First);
        Ok(())
    }

    /// Looks at the guards at the end of a step.
    fn guards_at(&mut self, t: f64, part: Part) {
        self.guards_ahead(t, part, self.fit.numeric.events.peek);
    }

    /// Looks at the guards at the end of a step, and ahead by a part of its length for what the end does not tell.
    fn guards_ahead(&mut self, t: f64, part: Part, ahead: f64) {
        self.free();
        let Self { c, run, fit } = self;
        let Some(guards) = &mut run.guards else { return };
        let taken = match part {
            Part::Whole => &fit.whole,
            Part::First => &fit.first,
            Part::Second => &fit.second,
            Part::Trial => &fit.trial,
        };
        run.input[0] = t;
        run.input[1] = ahead * taken.h;
        let step = run.spare.as_mut().filter(|_| fit.spare).unwrap_or(&mut run.step);
        look(c, guards, step, (&taken.next, &mut run.input), Some(&run.before), &mut fit.seen);
        hush(&fit.control, &fit.tops, &mut fit.seen, &fit.numeric.events);
        self.branch();
    }
}

/// Looks at the guards in a state. One that cannot be told switches nothing: it is 0.
fn look(
    c: &Cluster,
    guards: &mut Watch,
    step: &mut Ready,
    (state, input): (&[f64], &mut [f64]),
    start: Option<&[f64]>,
    seen: &mut [f64],
) {
    let (t, peek) = (input[0], input[1]);
    match guards.run(state, input, peek) {
        Ok((open, passed)) => {
            let loops = c.states + c.integrals;
            // What time switches on the way is yet to come.
            input[0] = if passed { (t - peek).max(0.0) } else { t };
            if open && peek > 0.0 && step.run(state, input).is_ok() {
                guards.told(&step.work.next[loops..], &state[loops..], start);
            }
            input[0] = t;
            seen.copy_from_slice(guards.values());
        }
        Err(_) => seen.fill(0.0),
    }
}

/// Where a law has just switched, guards of loops that all but vanish are as the branch tells that was left, which says
/// no more than where it ends: a body that came to rest may be held there for long. Where a very short step leads they
/// may be far from 0 on the same side, and then that is what they are, unless time switches something on the way.
fn beyond(
    c: &Cluster,
    guards: &mut Watch,
    step: &mut Ready,
    (state, input): (&[f64], &mut [f64]),
    (tops, seen): (&[f64], &mut [f64]),
    o: &EventOptions,
) {
    let (t, peek) = (input[0], input[1]);
    if step.run(state, input).is_err() {
        return;
    }
    input[0] = t + peek;
    let found = guards.run(&step.work.next, input, 0.0);
    input[0] = t;
    let times = c.guards.iter().flat_map(|g| &g.times);
    let values = guards.values();
    if found.is_err() || times.clone().any(|k| values[*k] * seen[*k] < 0.0) {
        return;
    }
    let known = |k: usize| times.clone().any(|time| *time == k);
    for (k, ((x, value), top)) in seen.iter_mut().zip(values).zip(tops).enumerate() {
        if x.abs() <= o.noise_floor * top && value.abs() > o.noise_floor * top && *x * value >= 0.0 && !known(k) {
            *x = *value;
        }
    }
}

/// Has guards that go to and fro about 0 vanish; the others, such as a known time that comes near, stay.
fn hush(control: &Control, tops: &[f64], seen: &mut [f64], o: &EventOptions) {
    if control.chatter > o.max_chatter {
        let list = seen.iter_mut().zip(tops).enumerate().filter(|(guard, _)| control.noisy & noise(*guard) != 0);
        list.filter(|(_, (x, top))| x.abs() <= o.noise_floor * **top).for_each(|(_, (x, _))| *x = 0.0);
    }
}

/// The guard that, going from some values to others, changes sign first.
fn earliest(from: &[f64], to: &[f64]) -> Option<usize> {
    let changes =
        from.iter().zip(to).enumerate().filter(|(_, (a, b))| (**a < 0.0 && **b > 0.0) || (**a > 0.0 && **b < 0.0));
    changes.map(|(i, (a, b))| (i, a / (a - b))).min_by(|x, y| x.1.total_cmp(&y.1)).map(|found| found.0)
}

/// Where between 0 and 1 the parabola through three values of one sign, at 0, 1/2 and 1, turns after having changed
/// sign.
fn turn(start: f64, middle: f64, end: f64) -> Option<f64> {
    let (slope, bend) = (4.0 * middle - 3.0 * start - end, 2.0 * (start - 2.0 * middle + end));
    let at = -0.5 * slope / bend;
    let alike = start * middle > 0.0 && middle * end > 0.0;
    (alike && at > 0.0 && at < 1.0 && (start + 0.5 * slope * at) * start < 0.0).then_some(at)
}

/// Whether the parabola through three values of one sign, at 0, 1/2 and 1, turns between them near 0.
fn touches([start, middle, end]: [f64; 3], part: f64) -> bool {
    if !(start * middle > 0.0 && middle * end > 0.0) {
        return false;
    }
    let (slope, bend) = (4.0 * middle - 3.0 * start - end, 2.0 * (start - 2.0 * middle + end));
    let at = -0.5 * slope / bend;
    let least = (start + 0.5 * slope * at).abs().min(middle.abs());
    at > 0.0 && at < 1.0 && bend * start > 0.0 && least < part * start.abs().min(end.abs())
}

/// How far beyond 1 the parabola through three values of one sign at 0, 1/2 and 1 is 0.
fn next(start: f64, middle: f64, end: f64) -> Option<f64> {
    if !(start * end > 0.0 && middle * end > 0.0) {
        return None;
    }
    let (slope, bend) = (3.0 * end - 4.0 * middle + start, 2.0 * (start - 2.0 * middle + end));
    let k = -0.5 * (slope + (slope * slope - 4.0 * bend * end).sqrt().copysign(slope));
    [end / k, k / bend].into_iter().filter(|u| *u > 0.0).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::next;

    #[test]
    fn what_all_but_touches_is_seen() {
        let touches = |start: f64, middle: f64, end: f64| super::touches([start, middle, end], 0.5);
        assert!(touches(-0.0326, -0.0062, -0.0193) && touches(1.0, 0.1, 2.0));
        // What turns away from 0, or far from it, only falls, or goes across.
        assert!(
            !touches(1.0, 2.0, 1.0) && !touches(1.0, 0.7, 1.0) && !touches(1.0, 0.3, 0.1) && !touches(1.0, -0.1, 1.0)
        );
    }

    /// Parabolas whose least is not at one of the three values: 1/10 and 3/10 above 0, beside ends of 7/20 and 11/20.
    #[test]
    fn where_a_parabola_turns_counts() {
        for (least, near) in [(0.1, true), (0.3, false)] {
            let value = |u: f64| 4.0 * (u - 0.25) * (u - 0.25) + least;
            assert_eq!(super::touches([0.0, 0.5, 1.0].map(value), 0.5), near, "{least}");
        }
    }

    #[test]
    fn what_changes_sign_first_is_found() {
        // After a tenth and after half of the way.
        assert_eq!(super::earliest(&[1.0, 2.0], &[-9.0, -2.0]), Some(0));
        assert_eq!(super::earliest(&[-2.0, -1.0], &[2.0, 9.0]), Some(1));
        assert_eq!(super::earliest(&[1.0, 0.0], &[2.0, 1.0]), None);
    }

    #[test]
    fn a_root_beyond_is_foretold() {
        assert_eq!(next(2.5, 2.0, 1.5), Some(1.5));
        // What goes away and comes back, as in flight.
        let flight = |u: f64| (u + 0.1) * (u - 3.0);
        assert!((next(flight(0.0), flight(0.5), flight(1.0)).unwrap() - 2.0).abs() < 1e-14);
        // What only goes away, turns before 0, or has crossed it.
        assert_eq!([next(1.0, 2.0, 3.0), next(4.0, 1.0, 0.9), next(1.0, 0.5, -0.1)], [None; 3]);
    }
}
