//! Where in a step a law switches: the guard that changes sign, located by single steps from the start of the step to an instant just
//! past the change.

use super::adaptive::{Part, Taken};
use super::cluster::Run;
use crate::kernel::Failure;

/// A change of sign sooner than this part of the usual step after its start is where the step stands, and is let be.
const STANDS: f64 = 1e-9;
/// So often is a change of sign looked for at most.
const ROUNDS: u32 = 60;
/// From this round on every other one halves the way.
const PATIENCE: u32 = 12;

/// A point of a guard along the step.
type Point = (f64, f64);

/// Between which points a guard changes sign, and a third point of it.
#[derive(Clone, Copy)]
struct Bracket {
    guard: usize,
    low: Point,
    high: Point,
    third: Option<Point>,
}

impl Bracket {
    /// Where the parabola through the three points is 0, or the line through two.
    fn root(&self) -> f64 {
        let ((low, a), (high, b)) = (self.low, self.high);
        let width = high - low;
        let slope = (b - a) / width;
        let line = -a / slope;
        let inside = |u: f64| (u > 0.0 && u < width).then_some(low + u);
        let parabola = || {
            let (third, c) = self.third?;
            let bend = ((c - b) / (third - high) - slope) / (third - low);
            let tilt = slope - bend * width;
            let root = (tilt * tilt - 4.0 * bend * a).sqrt();
            let q = -0.5 * (tilt + root.copysign(tilt));
            inside(a / q).or(inside(q / bend))
        };
        parabola().or(inside(line)).unwrap_or(low + 0.5 * width)
    }
}

impl Run {
    /// Takes down the guards at the start of a step.
    pub(super) fn guards_before(&mut self, t: f64) {
        if let Some(guards) = &mut self.guards {
            self.input[0] = t;
            if let Ok(out) = guards.run(&self.state, &self.input) {
                self.before.copy_from_slice(out);
            }
        }
    }

    /// Where a law switches in the whole step of length `h` from `t` that was just taken: the length of a step that ends just past
    /// it, which then is the whole step. A switch at the very start is let be. Without one, the first half was taken too, where
    /// there are guards.
    pub(super) fn event(&mut self, t: f64, h: f64) -> Result<Option<f64>, Failure> {
        let Some(mut bracket) = self.bracket(t, h)? else { return Ok(None) };
        let floor = (4.0 * f64::EPSILON * (t + h).abs()).max(1e-14 * h);
        let mut past = floor;
        for round in 0..ROUNDS {
            let root = bracket.root();
            let (low, high) = (bracket.low.0, bracket.high.0);
            if high - root <= 4.0 * past || high - low <= floor {
                break;
            }
            let halves = round >= PATIENCE && round % 2 == 0;
            let at = if halves { 0.5 * (low + high) } else { (root + past).max(low + floor) };
            self.stride(t, at, Part::Trial)?;
            self.guards_at(t + at, Part::Trial);
            let Some(fit) = &mut self.fit else { return Ok(None) };
            match earliest(&fit.below, &fit.seen) {
                Some(guard) => {
                    std::mem::swap(&mut fit.trial, &mut fit.whole);
                    std::mem::swap(&mut fit.seen, &mut fit.beyond);
                    let third = (guard == bracket.guard).then_some(bracket.high);
                    bracket = Bracket {
                        guard,
                        low: (low, fit.below[guard]),
                        high: (at, fit.beyond[guard]),
                        third: third.or(bracket.third.filter(|_| guard == bracket.guard)),
                    };
                }
                None => {
                    std::mem::swap(&mut fit.seen, &mut fit.below);
                    let third = Some(bracket.low);
                    bracket = Bracket { low: (at, fit.below[bracket.guard]), third, ..bracket };
                    // Missed by rounding alone.
                    if bracket.root() - at <= past {
                        past *= 8.0;
                    }
                }
            }
        }
        let found = bracket.high.0;
        if found < STANDS * self.default_step {
            self.stride(t, h, Part::Whole)?;
            self.stride(t, 0.5 * h, Part::First)?;
            return Ok(None);
        }
        Ok(Some(found))
    }

    /// The part of the step in which the first guard changes sign, if one does: what is seen at the end of the step, or at its
    /// middle. The whole step is then the one to the end of that part.
    fn bracket(&mut self, t: f64, h: f64) -> Result<Option<Bracket>, Failure> {
        if self.guards.is_none() {
            return Ok(None);
        }
        self.guards_at(t + h, Part::Whole);
        let Some(fit) = &mut self.fit else { return Ok(None) };
        fit.below.copy_from_slice(&self.before);
        std::mem::swap(&mut fit.seen, &mut fit.beyond);
        if let Some(guard) = earliest(&fit.below, &fit.beyond) {
            return Ok(Some(Bracket {
                guard,
                low: (0.0, fit.below[guard]),
                high: (h, fit.beyond[guard]),
                third: None,
            }));
        }
        self.stride(t, 0.5 * h, Part::First)?;
        self.guards_at(t + 0.5 * h, Part::First);
        let Some(fit) = &mut self.fit else { return Ok(None) };
        if let Some(guard) = earliest(&fit.below, &fit.seen) {
            let third = Some((h, fit.beyond[guard]));
            std::mem::swap(&mut fit.seen, &mut fit.beyond);
            copy(&fit.first, &mut fit.whole);
            let (low, high) = ((0.0, fit.below[guard]), (0.5 * h, fit.beyond[guard]));
            return Ok(Some(Bracket { guard, low, high, third }));
        }
        // A guard that was 0 at the start.
        std::mem::swap(&mut fit.seen, &mut fit.below);
        let found = earliest(&fit.below, &fit.beyond);
        Ok(found.map(|guard| Bracket {
            guard,
            low: (0.5 * h, fit.below[guard]),
            high: (h, fit.beyond[guard]),
            third: None,
        }))
    }

    /// Looks at the guards at the end of a step.
    fn guards_at(&mut self, t: f64, part: Part) {
        let (Some(guards), Some(fit)) = (&mut self.guards, &mut self.fit) else { return };
        self.input[0] = t;
        let state = match part {
            Part::Whole => &fit.whole.next,
            Part::First => &fit.first.next,
            Part::Second => &fit.second.next,
            Part::Trial => &fit.trial.next,
        };
        match guards.run(state, &self.input) {
            Ok(out) => fit.seen.copy_from_slice(out),
            // A guard that cannot be told switches nothing.
            Err(_) => fit.seen.fill(0.0),
        }
    }
}

/// The guard that, going from some values to others, changes sign first.
fn earliest(from: &[f64], to: &[f64]) -> Option<usize> {
    let changes =
        from.iter().zip(to).enumerate().filter(|(_, (a, b))| (**a < 0.0 && **b > 0.0) || (**a > 0.0 && **b < 0.0));
    changes.map(|(i, (a, b))| (i, a / (a - b))).min_by(|x, y| x.1.total_cmp(&y.1)).map(|found| found.0)
}

fn copy(from: &Taken, to: &mut Taken) {
    to.h = from.h;
    to.next.copy_from_slice(&from.next);
    to.output.copy_from_slice(&from.output);
}
