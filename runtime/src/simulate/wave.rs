//! What lines take and give: no more than there is.
//!
//! In continuous time, what comes out of one in a step is no more than what is on the way in it.
//!
//! What goes in and what comes out are integrals over steps, by the quadrature at the stages of each. What comes out is
//! a polynomial that passes through what went in, so that its energy is the same to the order of the steps, and not
//! exactly. So it is shortened where it would be more, by that quadrature, than there is: a line gives back what it was
//! given, and never more.

use super::cluster::Run;
use crate::history::{NODES, shorten};
use crate::machine::Real;

impl Run {
    /// Shortens what leaves into the lines of a sampled cluster to what it had to give.
    pub(super) fn shorten_leaving(&mut self) {
        let part = self.layout.stake.shortened.map_or(1.0, |at| self.ledger.get(at));
        if part < 1.0 {
            self.signals.lines.shorten(part, &mut self.input);
        }
    }

    /// Tells the programs what is given and what arrives from `t` to `end`.
    pub(super) fn aim(&mut self, t: f64, end: f64) {
        self.signals.aim(&mut self.input, t, end);
        self.shorten(end - t);
    }

    /// Tells the programs what arrives by delays from `t` to `end`. How coarse that is, as a part of the largest
    /// values.
    pub(super) fn aim_lines(&mut self, t: f64, end: f64) -> f64 {
        let coarse = self.signals.aim_lines(&mut self.input, t, end);
        self.shorten(end - t);
        coarse
    }

    /// Shortens what comes out of lines in a step to what there is.
    fn shorten(&mut self, length: f64) {
        for waves in &self.waves {
            let given = waves.given.map(|at| self.ledger.sum(at));
            let out = waves.slots.map(|at| std::array::from_fn(|k| self.input[at + k]));
            let out = shorten(Real::new(), given, (length, waves.admittance), out, &waves.rules);
            for (at, a) in waves.slots.iter().zip(out) {
                self.input[*at..*at + NODES.len()].copy_from_slice(&a);
            }
        }
    }
}
