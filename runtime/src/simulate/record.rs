//! What is taken down of a step that was taken: the signals that are delayed, at nodes within it. Between its ends they
//! are had as rows of output are, by shorter steps from its beginning.

use super::Error;
use super::cluster::Run;
use crate::history::{NODES, extend, interpolate, tail};
use crate::scene::Cluster;

/// How often a step is halved whose signals are too coarse.
const HALVINGS: u32 = 5;
/// How small a jump is seen where no tolerance says it: that of a run without options.
const USUAL: f64 = 1e-6;

/// Room for what is taken down, and how well that is to be.
pub(super) struct Record {
    /// By signal, its values at the nodes.
    values: Vec<[f64; NODES.len()]>,
    /// The nodes that are taken: as many as the order of the step is worth.
    nodes: usize,
    tolerance: Option<f64>,
    /// What the step gave, while the way to it is looked at.
    next: Vec<f64>,
    output: Vec<f64>,
}

impl Record {
    pub(super) fn new(c: &Cluster, tolerance: Option<f64>, outputs: usize) -> Self {
        let count = c.lines.iter().filter(|_| c.period.is_none()).count();
        let order = if c.step.properties.order == 0 { NODES.len() } else { c.step.properties.order as usize + 2 };
        let room = if count == 0 { 0 } else { outputs };
        Self {
            values: vec![[0.0; NODES.len()]; count],
            nodes: order.clamp(5, NODES.len()),
            tolerance,
            next: vec![0.0; if count == 0 { 0 } else { c.initial.len() }],
            output: vec![0.0; room],
        }
    }
}

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
        let done = self.take_down_to(c, (t, h), &next, false);
        self.record.next = std::mem::replace(&mut self.step.work.next, next);
        self.record.output = std::mem::replace(&mut self.step.work.output, output);
        done
    }

    /// Takes a step down that leads to a state. Where a law has `switched` at its end, that end is just past it, and what
    /// is taken down goes on from what was before.
    pub(super) fn take_down_to(
        &mut self,
        c: &Cluster,
        (t, h): (f64, f64),
        end: &[f64],
        switched: bool,
    ) -> Result<(), Error> {
        if self.signals.lines.pasts.is_empty() {
            return Ok(());
        }
        let slack = 1e-12 * (t.abs() + h);
        let arrives = self.signals.lines.arrives(t, slack);
        self.part(c, (t, 0.0, h), (end, h, switched), (arrives, 0))
    }

    fn part(
        &mut self,
        c: &Cluster,
        (t, from, length): Part,
        (end, h, switched): (&[f64], f64, bool),
        (arrives, depth): (Option<u32>, u32),
    ) -> Result<(), Error> {
        let is_open = switched && from + length >= h;
        for k in (0..self.record.nodes).filter(|k| !(is_open && *k == 1)) {
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
        if is_open {
            self.record.values.iter_mut().for_each(|values| extend(&mut values[..n]));
        }
        let coarse = |(values, size): (&[f64; NODES.len()], f64)| {
            let mut a = *values;
            interpolate(&mut a[..n]);
            let most = values[..n].iter().fold(size, |most, x| most.max(x.abs()));
            self.record.tolerance.is_some_and(|tolerance| tail(&a[..n]) > tolerance * most)
        };
        let sizes = self.signals.lines.pasts.iter().map(|p| p.history.size());
        if depth < HALVINGS && self.record.values.iter().zip(sizes).any(coarse) {
            let half = 0.5 * length;
            self.part(c, (t, from, half), (end, h, switched), (arrives, depth + 1))?;
            return self.part(c, (t, from + half, half), (end, h, switched), (None, depth + 1));
        }
        let tolerance = self.record.tolerance.unwrap_or(USUAL);
        for (values, past) in self.record.values.iter().zip(&mut self.signals.lines.pasts) {
            past.history.take((t + from, length), &values[..n], arrives, tolerance);
        }
        Ok(())
    }
}
