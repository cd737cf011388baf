//! What a signal was: polynomials over the steps that were taken, and polynomials over a step to come.
//!
//! Both are Newton's interpolation at the same nodes, Chebyshev's of the second kind, in Leja's order: so the first few
//! are good nodes too, and nested products lose no digits.

use serde::{Deserialize, Serialize};

/// The nodes of an interval from 0 to 1.
pub const NODES: [f64; 13] = [
    0.0,
    1.0,
    0.5,
    0.24999999999999994,
    0.8535533905932737,
    0.06698729810778065,
    0.7499999999999999,
    0.9330127018922194,
    0.1464466094067262,
    0.37059047744873963,
    0.6294095225512604,
    0.017037086855465844,
    0.9829629131445341,
];

/// Input slots of what a signal was over a step to come: a coefficient a node, then one over the step's length, and
/// the instant at which it begins.
pub const SLOTS: usize = NODES.len() + 2;

/// Places and weights of Gauss' quadrature from 0 to 1: exact for the squares of these polynomials.
const GAUSS: [(f64, f64); NODES.len()] = [
    (0.007908472640705932, 0.020242002382657907),
    (0.04120080038851098, 0.04606074991886419),
    (0.09921095463334506, 0.0694367551098936),
    (0.17882533027982989, 0.08907299038097284),
    (0.2757536244817766, 0.10390802376844425),
    (0.3847708420224326, 0.11314159013144857),
    (0.5, 0.11627577661543695),
    (0.6152291579775674, 0.11314159013144857),
    (0.7242463755182234, 0.10390802376844425),
    (0.8211746697201701, 0.08907299038097284),
    (0.9007890453666549, 0.0694367551098936),
    (0.9587991996114891, 0.04606074991886419),
    (0.9920915273592941, 0.020242002382657907),
];

/// The mean square of a polynomial.
pub(crate) fn mean_square(a: &[f64]) -> f64 {
    let mut coefficients = [0.0; NODES.len()];
    coefficients.iter_mut().zip(a).for_each(|(to, from)| *to = *from);
    GAUSS.iter().map(|(s, weight)| weight * value(&coefficients, *s).powi(2)).sum()
}

/// Coefficients of a polynomial, in the order of [`NODES`]; those that it does not have are 0.
pub(crate) type Coefficients = [f64; NODES.len()];

/// From values at the first nodes to coefficients, by divided differences.
pub(crate) fn interpolate(values: &mut [f64]) {
    let n = values.len().min(NODES.len());
    for k in 1..n {
        for i in (k..n).rev() {
            values[i] = (values[i] - values[i - 1]) / (NODES[i] - NODES[i - k]);
        }
    }
}

/// Where the value at the end, the second node, is clearly not what those at the others go on to, it becomes that.
pub(crate) fn before_jump(values: &mut [f64]) {
    let end = values[1];
    extend(values);
    let mut coefficients = [0.0; NODES.len()];
    let n = values.len().min(NODES.len());
    coefficients[..n].copy_from_slice(&values[..n]);
    interpolate(&mut coefficients[..n]);
    let size = values.iter().fold(end.abs(), |most, x| most.max(x.abs()));
    // By as much are ends that are gone on to less certain, as slopes are.
    if (end - values[1]).abs() <= SLOPE * (tail(&coefficients[..n]) + f64::EPSILON * size) {
        values[1] = end;
    }
}

/// The value at the end that goes on from those at the others.
fn extend(values: &mut [f64]) {
    let others = || (0..values.len()).filter(|k| *k != 1);
    let weight = |j: usize| -> f64 {
        others().filter(|m| *m != j).map(|m| (NODES[1] - NODES[m]) / (NODES[j] - NODES[m])).product()
    };
    values[1] = others().map(|j| weight(j) * values[j]).sum();
}

/// The value at a place.
fn value(a: &Coefficients, s: f64) -> f64 {
    let last = a.len() - 1;
    (0..last).rev().fold(a[last], |x, k| a[k] + (s - NODES[k]) * x)
}

/// The slope at a place.
fn slope(a: &Coefficients, s: f64) -> f64 {
    let last = a.len() - 1;
    let (_, slope) = (0..last).rev().fold((a[last], 0.0), |(x, dx), k| {
        let ahead = s - NODES[k];
        (a[k] + ahead * x, x + ahead * dx)
    });
    slope
}

/// How much the last two of so many coefficients tell at most: about what an interpolation misses. The product of the
/// distances to n nodes is some 2 / 4^n.
pub(crate) fn tail(coefficients: &[f64]) -> f64 {
    let n = coefficients.len();
    let part = |k: usize| coefficients[k].abs() * 2.0 * 0.25f64.powi(k as i32);
    if n < 2 { 0.0 } else { part(n - 1) + part(n - 2) }
}

/// What a signal was over a step that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Piece {
    begin: f64,
    length: f64,
    coefficients: Coefficients,
}

impl Piece {
    fn at(&self, t: f64) -> f64 {
        value(&self.coefficients, (t - self.begin) / self.length)
    }

    fn end(&self) -> f64 {
        self.begin + self.length
    }
}

/// An instant at which what is delayed jumps, or a derivative of it does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Break {
    at: f64,
    /// Which derivative, at least.
    level: u32,
}

/// The derivatives of which jumps are carried on. Higher ones are beyond what steps resolve.
const LEVELS: u32 = 12;
/// A slope is less certain than a value, by about the square of the degree, and some more.
const SLOPE: f64 = 1e3;

/// What a signal was, back to a delay before now.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct History {
    delay: f64,
    start: f64,
    /// The largest that it was.
    largest: f64,
    /// The pieces from the first one that is still needed on.
    pieces: Vec<Piece>,
    first: usize,
    breaks: Vec<Break>,
}

/// Pieces and breaks for which there is room from the beginning.
const ROOM: usize = 256;

impl History {
    /// Before the start, the signal was this.
    pub(crate) fn new(delay: f64, start: f64) -> Self {
        let (pieces, breaks) = (Vec::with_capacity(ROOM), Vec::with_capacity(ROOM));
        Self { delay, start, largest: start.abs(), pieces, first: 0, breaks }
    }

    /// Whether it may stand for another one, and is sound.
    pub(crate) fn alike(&self, other: &Self) -> bool {
        let rises = self.pieces.windows(2).all(|p| p[0].begin < p[1].begin);
        let sound = |p: &Piece| p.begin.is_finite() && p.length > 0.0 && p.length.is_finite();
        (self.delay, self.start) == (other.delay, other.start)
            && self.first <= self.pieces.len()
            && rises
            && self.pieces.iter().all(sound)
            && self.breaks.iter().all(|b| b.at.is_finite())
    }

    /// Up to when it is known what will have been, s.
    fn known(&self) -> f64 {
        self.pieces.last().map_or(0.0, Piece::end) + self.delay
    }

    /// The first instant after `t`, by more than `slack`, at which a step has to end.
    pub(crate) fn next(&self, t: f64, slack: f64) -> f64 {
        let breaks = self.breaks.iter().map(|b| b.at).filter(|at| *at > t + slack);
        breaks.fold(self.known(), f64::min)
    }

    /// The piece that an instant lies in, or where it begins; none before the start.
    fn piece(&self, t: f64) -> Option<usize> {
        let kept = &self.pieces[self.first..];
        kept.partition_point(|p| p.begin <= t).checked_sub(1).map(|k| self.first + k)
    }

    /// What it was a delay before an instant; where it jumps, after the jump.
    pub(crate) fn arriving(&self, t: f64, slack: f64) -> f64 {
        let was = t - self.delay;
        self.piece(was + slack).map_or(self.start, |k| self.pieces[k].at(was))
    }

    /// What it will have been from `t` to `end`, between which no break lies: slots as [`SLOTS`] says. And how coarse
    /// that is, beside the largest that it was.
    pub(crate) fn aim(&self, (t, end): (f64, f64), slack: f64, slots: &mut [f64]) -> f64 {
        let (begin, length) = (t - self.delay, end - t);
        let within = (self.piece(begin + slack), self.piece(begin + length - slack));
        for (slot, node) in slots.iter_mut().zip(NODES) {
            let x = begin + node * length;
            let piece = self.piece(x).max(within.0).min(within.1.max(within.0));
            *slot = piece.map_or(self.start, |k| self.pieces[k].at(x));
        }
        let coefficients = &mut slots[..NODES.len()];
        interpolate(coefficients);
        let coarse = tail(coefficients);
        slots[NODES.len()] = 1.0 / length;
        slots[NODES.len() + 1] = t;
        if coarse > 0.0 { coarse / self.largest.max(coarse) } else { 0.0 }
    }

    /// The largest that it was.
    pub(crate) fn size(&self) -> f64 {
        self.largest
    }

    /// Which derivative may jump at an instant, as one did a delay ago.
    pub(crate) fn arrives(&self, t: f64, slack: f64) -> Option<u32> {
        self.breaks.iter().filter(|b| (b.at - t).abs() <= slack).map(|b| b.level).min()
    }

    /// Takes in what it was over a step that was taken, or over a part of one, by values at the first nodes. `arrives`
    /// is which derivative may jump at its beginning, and `tolerance` the part of its size that tells a jump from none.
    pub(crate) fn take(&mut self, (begin, length): (f64, f64), values: &[f64], arrives: Option<u32>, tolerance: f64) {
        let mut coefficients = [0.0; NODES.len()];
        let n = values.len().min(NODES.len());
        coefficients[..n].copy_from_slice(&values[..n]);
        self.largest = values.iter().fold(self.largest, |most, x| most.max(x.abs()));
        interpolate(&mut coefficients[..n]);
        let piece = Piece { begin, length, coefficients };
        let (before, steep, short) = match self.pieces.last() {
            Some(last) => (value(&last.coefficients, 1.0), slope(&last.coefficients, 1.0) / last.length, last.length),
            None => (self.start, 0.0, length),
        };
        let least = tolerance * self.largest;
        let jump = (value(&coefficients, 0.0) - before).abs();
        let bend = (slope(&coefficients, 0.0) / length - steep).abs() * short.min(length);
        let level = match arrives {
            _ if jump > least => Some(0),
            _ if bend > SLOPE * least => Some(1),
            Some(level) => Some(level + 1),
            None => None,
        };
        if let Some(level) = level.filter(|l| *l <= LEVELS) {
            self.breaks.push(Break { at: begin + self.delay, level });
        }
        self.forget(begin);
        self.pieces.push(piece);
    }

    /// Forgets what no step from `now` on reads.
    fn forget(&mut self, now: f64) {
        let past = now - self.delay;
        while self.pieces.get(self.first).is_some_and(|p| p.end() < past) {
            self.first += 1;
        }
        if self.first > ROOM && 2 * self.first > self.pieces.len() {
            self.pieces.drain(..self.first);
            self.first = 0;
        }
        self.breaks.retain(|b| b.at >= now);
    }

    /// Becomes another one, without new room where there is enough.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        (self.delay, self.start, self.largest, self.first) = (other.delay, other.start, other.largest, other.first);
        self.pieces.clone_from(&other.pieces);
        self.breaks.clone_from(&other.breaks);
    }
}

#[cfg(test)]
mod tests {
    use super::{History, NODES, SLOTS, interpolate, slope, tail, value};

    /// A polynomial of the degree of the nodes is met to rounding, and its slope.
    #[test]
    fn polynomials_are_met() {
        let law = |s: f64| 1.0 + (s - 0.3).powi(12) - 2.0 * s.powi(7);
        let rate = |s: f64| 12.0 * (s - 0.3).powi(11) - 14.0 * s.powi(6);
        let mut a = NODES.map(law);
        interpolate(&mut a);
        for k in 0..=50 {
            let s = f64::from(k) / 50.0;
            assert!((value(&a, s) - law(s)).abs() < 1e-14, "{s}");
            assert!((slope(&a, s) - rate(s)).abs() < 1e-12, "{s}");
        }
    }

    /// The end of what jumps there is had without it.
    #[test]
    fn an_end_goes_on_from_the_rest() {
        let law = |s: f64| 1.0 + (s - 0.3).powi(4) - 2.0 * s.powi(3);
        let mut values = NODES.map(law);
        values[1] = 1e6;
        super::before_jump(&mut values[..6]);
        assert!((values[1] - law(1.0)).abs() < 1e-13);
        // What does not jump is left as it is.
        let mut values = NODES.map(|s| (2.0 * s).sin());
        super::before_jump(&mut values);
        assert_eq!(values[1], 2f64.sin());
    }

    #[test]
    fn squares_are_integrated() {
        let mut a = NODES.map(|s| s.powi(12));
        interpolate(&mut a);
        assert!((super::mean_square(&a) * 25.0 - 1.0).abs() < 1e-13);
        let mut a = NODES.map(|s| 2.0 * s - 1.0);
        interpolate(&mut a);
        assert!((super::mean_square(&a) * 3.0 - 1.0).abs() < 1e-14);
    }

    /// What the last coefficients tell is about what an interpolation by fewer nodes misses.
    #[test]
    fn the_tail_tells_what_is_missed() {
        for n in [4, 6, 9, 13] {
            let mut a = NODES.map(|s| (3.0 * s).sin());
            interpolate(&mut a[..n]);
            a[n..].fill(0.0);
            let off = (0..=100).map(|k| f64::from(k) / 100.0).map(|s| (value(&a, s) - (3.0 * s).sin()).abs());
            let (off, told) = (off.fold(0.0, f64::max), tail(&a[..n]));
            assert!(told > off && told < 1e4 * off.max(1e-16), "{n}: {told} of {off}");
        }
    }

    /// Over pieces of unequal length, across their borders, and before the start.
    #[test]
    fn what_was_is_read_a_delay_later() {
        let mut history = History::new(1.0, 0.0);
        let mut t = 0.0;
        for length in [0.25, 0.5, 0.125, 0.0625, 0.3] {
            let values = NODES.map(|s| (t + s * length).sin());
            history.take((t, length), &values, None, 1e-12);
            t += length;
        }
        let mut slots = [0.0; SLOTS];
        history.aim((0.5, 1.0), 1e-12, &mut slots);
        assert!(slots[..NODES.len()].iter().all(|a| *a == 0.0), "{slots:?}");
        history.aim((1.0, 2.1), 1e-12, &mut slots);
        for k in 0..=10 {
            let s = f64::from(k) / 10.0;
            let a: [f64; NODES.len()] = std::array::from_fn(|i| slots[i]);
            assert!((value(&a, s) - (1.1 * s).sin()).abs() < 1e-12, "{s}");
            assert_eq!((slots[NODES.len()] * 1.1 - 1.0).abs() < 1e-15, slots[NODES.len() + 1] == 1.0);
        }
    }

    /// A jump at the start arrives a delay later, its traces in the derivatives after that, and then no more.
    #[test]
    fn jumps_are_carried_on() {
        let mut history = History::new(1.0, 0.0);
        history.take((0.0, 0.5), &NODES.map(|_| 1.0), None, 1e-9);
        assert_eq!(history.next(0.5, 1e-12), 1.0);
        assert_eq!(history.arrives(1.0, 1e-12), Some(0));
        history.take((0.5, 0.5), &NODES.map(|_| 1.0), None, 1e-9);
        history.take((1.0, 0.5), &NODES.map(|_| 1.0), Some(0), 1e-9);
        assert_eq!((history.next(1.0, 1e-12), history.arrives(2.0, 1e-12)), (2.0, Some(1)));
        history.take((1.5, 0.5), &NODES.map(|_| 1.0), Some(12), 1e-9);
        assert_eq!(history.next(2.0, 1e-12), 3.0, "only as far as it is known");
    }
}
