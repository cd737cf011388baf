//! Signals given from outside, over time: a value, or a table with values between its rows.

use super::Options;
use super::delay_line::DelayLines;
use crate::history::{self, SAME};
use crate::machine::Real;
use crate::scene::{Cluster, GIVEN};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Pieces that are past are forgotten when there are so many.
const PIECES: usize = 16;

/// From an instant on, until the next piece: `value + slope (t - at)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Piece {
    at: f64,
    value: f64,
    slope: f64,
}

/// What a signal is over time. Before the first instant it is what it is there, after the last one too.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputSignal {
    pieces: Vec<Piece>,
}

/// Why instants and values are no signal.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum Unfit {
    /// There is no row.
    #[error("there are no rows")]
    Empty,
    /// Instants and values are not one for one.
    #[error("there are {0} instants and {1} values")]
    Lengths(usize, usize),
    /// A number that is infinite or NaN, in this row.
    #[error("row {0} has a number that is not finite")]
    NotFinite(usize),
    /// This row's instant is not after that of the row before.
    #[error("the instant of row {0} is not after that of the row before")]
    Order(usize),
    /// What lies between this row and the one after it changes faster than numbers tell.
    #[error("between row {0} and row {next} it changes faster than double precision resolves", next = .0 + 1)]
    Steep(usize),
}

/// How fast a value changes from one instant to another.
fn slope((at, value): (f64, f64), (t, x): (f64, f64)) -> f64 {
    let (rise, run) = (x - value, t - at);
    if rise.is_finite() && run.is_finite() {
        return rise / run;
    }
    // Numbers whose difference is too large have halves whose difference is not.
    (0.5 * x - 0.5 * value) / (0.5 * t - 0.5 * at)
}

impl InputSignal {
    /// The same at all times.
    pub fn constant(value: f64) -> Self {
        Self { pieces: vec![Piece { at: 0.0, value, slope: 0.0 }] }
    }

    /// Values (SI) at instants (s) that rise; linear between two of them, or where `hold` is set, that of the earlier
    /// one.
    ///
    /// # Errors
    /// See [`Unfit`]; rows are counted from 0.
    pub fn table(instants: &[f64], values: &[f64], hold: bool) -> Result<Self, Unfit> {
        if instants.len() != values.len() {
            return Err(Unfit::Lengths(instants.len(), values.len()));
        }
        if instants.is_empty() {
            return Err(Unfit::Empty);
        }
        if let Some(row) = instants.iter().zip(values).position(|(t, x)| !t.is_finite() || !x.is_finite()) {
            return Err(Unfit::NotFinite(row));
        }
        if let Some(row) = instants.windows(2).position(|t| t[0] >= t[1]) {
            return Err(Unfit::Order(row + 1));
        }
        let mut pieces = Vec::with_capacity(instants.len());
        for (i, (&at, &value)) in instants.iter().zip(values).enumerate() {
            let next = instants.get(i + 1).zip(values.get(i + 1)).filter(|_| !hold);
            let slope = next.map_or(0.0, |(t, x)| slope((at, value), (*t, *x)));
            if !slope.is_finite() {
                return Err(Unfit::Steep(i));
            }
            pieces.push(Piece { at, value, slope });
        }
        Ok(Self { pieces })
    }

    /// From `now` on it has this value. What was before `past` may be forgotten.
    pub(super) fn set(&mut self, now: f64, value: f64, past: f64) {
        let kept = self.pieces.partition_point(|p| p.at < now);
        self.pieces.truncate(kept);
        if self.pieces.len() >= PIECES {
            let over = self.pieces.partition_point(|p| p.at <= past).saturating_sub(1);
            self.pieces.drain(..over);
        }
        self.pieces.push(Piece { at: now, value, slope: 0.0 });
    }

    /// The piece that an instant lies in, and where it has its value.
    fn piece(&self, t: f64) -> Piece {
        let after = self.pieces.partition_point(|p| p.at <= t);
        match after.checked_sub(1).and_then(|i| self.pieces.get(i)) {
            Some(piece) => *piece,
            None => Piece {
                slope: 0.0,
                ..self.pieces.first().copied().unwrap_or(Piece { at: 0.0, value: 0.0, slope: 0.0 })
            },
        }
    }

    /// Its value at an instant; where it jumps, that after the jump.
    pub fn value(&self, t: f64) -> f64 {
        let p = self.piece(t + SAME * t.abs());
        p.value + p.slope * (t - p.at)
    }

    /// Whether it is the same from an instant on.
    pub(super) fn is_settled(&self, t: f64) -> bool {
        self.pieces.last().is_none_or(|p| p.at <= t && p.slope == 0.0)
    }

    /// The first instant after `t`, by more than `slack`, at which another piece begins.
    fn next(&self, t: f64, slack: f64) -> Option<f64> {
        let i = self.pieces.partition_point(|p| p.at <= t + slack);
        // Before the first piece the value is the same.
        self.pieces.get(i).map(|p| p.at)
    }
}

/// How the signals that a cluster reads come to its programs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct ClusterInputs {
    /// First input slot.
    at: usize,
    signals: Vec<InputSignal>,
    /// What arrives by delays.
    pub(super) lines: DelayLines,
}

impl ClusterInputs {
    /// The defaults.
    pub(super) fn new(c: &Cluster, all: &[InputSignal], options: &Options) -> Self {
        let signals = c.inputs.iter().filter_map(|i| all.get(*i).cloned()).collect();
        Self { at: c.given_at(), signals, lines: DelayLines::new(c, options) }
    }

    /// The same without what is on its way in delays.
    pub(super) fn without_lines(&self) -> Self {
        Self { lines: DelayLines::default(), signals: self.signals.clone(), ..*self }
    }

    /// Whether it feeds as many signals into the same slots, from tables that have rows.
    pub(super) fn alike(&self, other: &Self) -> bool {
        self.at == other.at
            && self.signals.len() == other.signals.len()
            && self.signals.iter().all(|c| !c.pieces.is_empty())
    }

    /// Sets a signal from now on; the cluster itself has come as far as `past`.
    pub(super) fn set(&mut self, k: usize, now: f64, value: f64, past: f64) {
        self.signals[k].set(now, value, past);
    }

    /// Whether all signals are the same from an instant on, and nothing is delayed.
    pub(super) fn is_settled(&self, t: f64) -> bool {
        self.lines.is_empty() && self.signals.iter().all(|c| c.is_settled(t))
    }

    /// The end of the piece of time from `t` on over which each of the signals changes evenly, if it lies before `end`.
    #[inline]
    pub(super) fn cut(&self, t: f64, end: f64) -> Option<f64> {
        if self.signals.is_empty() && self.lines.pasts.is_empty() {
            return None;
        }
        let slack = slack(t, end);
        let given = self.signals.iter().filter_map(|c| c.next(t, slack)).min_by(f64::total_cmp);
        let next = self.lines.next(t, slack).min(given.unwrap_or(f64::INFINITY));
        (next < end - slack).then_some(next)
    }

    /// Tells the programs what holds from `t` to `end`, between which no piece begins.
    #[inline]
    pub(super) fn aim(&self, input: &mut [f64], t: f64, end: f64) {
        self.aim_lines(input, t, end);
        if self.signals.is_empty() {
            return;
        }
        let middle = t + 0.5 * (end - t);
        for (slots, signal) in input[self.at..].chunks_exact_mut(GIVEN).zip(&self.signals) {
            let p = signal.piece(middle.max(t + slack(t, end)));
            slots.copy_from_slice(&[p.value, p.slope, p.at]);
        }
    }

    /// Tells the programs what arrives by delays from `t` to `end`. How coarse that is, as a part of the largest
    /// values.
    #[inline]
    pub(super) fn aim_lines(&self, input: &mut [f64], t: f64, end: f64) -> f64 {
        if self.lines.pasts.is_empty() { 0.0 } else { self.lines.aim(input, (t, end), slack(t, end)) }
    }

    /// Tells the programs what is at an instant, and holds from then on.
    pub(super) fn latch(&self, input: &mut [f64], t: f64) {
        for (slots, signal) in input[self.at..].chunks_exact_mut(GIVEN).zip(&self.signals) {
            slots.copy_from_slice(&[signal.value(t), 0.0, t]);
        }
        self.lines.latch(input, t, SAME * t.abs());
    }
}

/// See [`history::slack`].
fn slack(t: f64, end: f64) -> f64 {
    history::slack(Real::new(), t, end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_and_held() -> Result<(), Unfit> {
        let (t, x) = ([1.0, 2.0, 4.0], [10.0, 20.0, 0.0]);
        let linear = InputSignal::table(&t, &x, false)?;
        let held = InputSignal::table(&t, &x, true)?;
        let cases = [
            (0.0, 10.0, 10.0),
            (1.0, 10.0, 10.0),
            (1.5, 15.0, 10.0),
            (2.0, 20.0, 20.0),
            (3.0, 10.0, 20.0),
            (9.0, 0.0, 0.0),
        ];
        for (at, l, h) in cases {
            assert_eq!((linear.value(at), held.value(at)), (l, h), "at {at}");
        }
        Ok(())
    }

    /// Numbers so large that their difference is none are met halfway all the same.
    #[test]
    fn far_rows() -> Result<(), Unfit> {
        let far = InputSignal::table(&[-1e308, 1e308], &[1.0, 3.0], false)?;
        assert_eq!(far.value(0.0), 2.0);
        let large = InputSignal::table(&[0.0, 2.0], &[-1.5e308, 1.5e308], false)?;
        assert_eq!((large.value(1.0), large.value(2.0)), (0.0, 1.5e308));
        assert_eq!(InputSignal::table(&[0.0, 1e-3], &[0.0, 1e308], false), Err(Unfit::Steep(0)));
        assert!(InputSignal::table(&[0.0, 1e-3], &[0.0, 1e308], true).is_ok());
        Ok(())
    }

    #[test]
    fn what_is_no_table_is_refused() {
        assert_eq!(InputSignal::table(&[], &[], false), Err(Unfit::Empty));
        assert_eq!(InputSignal::table(&[0.0], &[], false), Err(Unfit::Lengths(1, 0)));
        assert_eq!(InputSignal::table(&[0.0, 0.0], &[1.0, 2.0], false), Err(Unfit::Order(1)));
        assert_eq!(InputSignal::table(&[0.0, 1.0], &[1.0, f64::NAN], true), Err(Unfit::NotFinite(1)));
    }

    #[test]
    fn a_value_set_now_leaves_what_was() {
        let mut signal = InputSignal::constant(1.0);
        for k in 1..1000 {
            let now = f64::from(k) * 0.1;
            signal.set(now, f64::from(k), now - 0.25);
            assert_eq!(signal.value(now - 0.05), f64::from(k - 1).max(1.0));
            assert_eq!(signal.value(now + 5.0), f64::from(k));
        }
        assert!(signal.pieces.len() <= PIECES + 1);
    }
}
