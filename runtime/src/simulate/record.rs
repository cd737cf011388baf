//! What is taken down of a step that was taken: the signals that are delayed, at nodes within it. Between its ends they
//! are had as rows of output are, by shorter steps from its beginning.

use super::Error;
use super::cluster::Run;
use crate::history::{JUMP, NODES, SAME, SMOOTH, before_jump, interpolate, tail};
use crate::machine::Real;
use crate::scene::Cluster;

/// How often a step is halved whose signals are too coarse.
const HALVINGS: u32 = 5;

/// A part of a step: where the step begins, where in it the part begins, and how long that is.
type Part = (f64, f64, f64);

impl Run {
    /// Takes the step in the workspace down, which is about to be kept.
    pub(super) fn take_down(&mut self, c: &Cluster, t: f64, h: f64) -> Result<(), Error> {
        if self.signals.lines.pasts.is_empty() {
            return Ok(());
        }
        let room = std::mem::take(&mut self.record.output);
        let output = std::mem::replace(&mut self.step.work.output, room);
        let room = std::mem::take(&mut self.record.next);
        let next = std::mem::replace(&mut self.step.work.next, room);
        let done = self.take_down_to(c, t, h, &next);
        self.record.next = std::mem::replace(&mut self.step.work.next, next);
        self.record.output = std::mem::replace(&mut self.step.work.output, output);
        done
    }

    /// Takes a step down that leads to a state.
    pub(super) fn take_down_to(&mut self, c: &Cluster, t: f64, h: f64, end: &[f64]) -> Result<(), Error> {
        if self.signals.lines.pasts.is_empty() {
            return Ok(());
        }
        let slack = SAME * (t.abs() + h);
        let arrives = self.signals.lines.arrives(t, slack);
        self.part(c, (t, 0.0, h), (end, h), (arrives, 0))
    }

    fn part(
        &mut self,
        c: &Cluster,
        (t, from, length): Part,
        (end, h): (&[f64], f64),
        (arrives, depth): (f64, u32),
    ) -> Result<(), Error> {
        for k in 0..self.record.nodes {
            let ahead = from + NODES[k] * length;
            if ahead >= h {
                self.glanced.copy_from_slice(end);
            } else {
                self.glanced.copy_from_slice(&self.state);
                if ahead > 0.0 {
                    self.glance(c, t, ahead, 0)?;
                }
            }
            self.input[0] = t + ahead;
            let seen = self.instant.run(&self.glanced, &self.input).map(|_| ());
            seen.map_err(|why| self.failure(c, t + ahead, why))?;
            for (values, past) in self.record.values.iter_mut().zip(&self.signals.lines.pasts) {
                values[k] = self.instant.work.output[past.output];
            }
        }
        let n = self.record.nodes;
        // The end of a step may be just past a switch, and what is taken down is what was before.
        if c.guards.is_some() && from + length >= h {
            self.record.values.iter_mut().for_each(|values| before_jump(Real::new(), &mut values[..n]));
        }
        let coarse = |(values, size): (&[f64; NODES.len()], f64)| {
            let mut a = *values;
            interpolate(Real::new(), &mut a[..n]);
            let most = values[..n].iter().fold(size, |most, x| most.max(x.abs()));
            self.record.tolerance.is_some_and(|tolerance| tail(Real::new(), &a[..n]) > tolerance * most)
        };
        let sizes = self.signals.lines.pasts.iter().map(|p| p.history.size());
        if depth < HALVINGS && self.record.values.iter().zip(sizes).any(coarse) {
            let half = 0.5 * length;
            self.part(c, (t, from, half), (end, h), (arrives, depth + 1))?;
            return self.part(c, (t, from + half, half), (end, h), (SMOOTH, depth + 1));
        }
        let tolerance = self.record.tolerance.unwrap_or(JUMP);
        for (values, past) in self.record.values.iter().zip(&mut self.signals.lines.pasts) {
            past.history.take((t + from, length), &values[..n], arrives, tolerance);
        }
        Ok(())
    }
}
