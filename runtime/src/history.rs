//! What a signal was: polynomials over the steps that were taken, and polynomials over a step to come.
//!
//! Both are Newton's interpolation at the same nodes, Chebyshev's of the second kind, in Leja's order: so the first few
//! are good nodes too, and nested products lose no digits.
//!
//! What is here is generic over a [`Machine`]: a run gives it numbers, and `backend/standalone` of the compiler writes
//! the same operations down as statements.

use crate::energy::{larger, positive, smaller};
use crate::ir::Unary;
use crate::machine::{Machine, Number, Real, Variable};
use serde::{Deserialize, Serialize};
use std::cell::Cell;

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

/// Which of [`NODES`] comes first, second and so on in time.
const RISING: [usize; NODES.len()] = [0, 11, 5, 8, 3, 9, 2, 10, 6, 4, 7, 12, 1];

/// Input slots of what a signal was over a step to come: a coefficient a node, then one over the step's length, and
/// the instant at which it begins.
pub const SLOTS: usize = NODES.len() + 2;

/// Places and weights of Gauss' quadrature from 0 to 1: exact for the squares of these polynomials.
pub const EXACT: [(f64, f64); NODES.len()] = [
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

/// Gauss' quadratures of 1 to 6 places: those of the stages of `gonzalez` and `collocation4` to `collocation12`.
pub const STAGES: [Rule; 6] = [
    &[(0.5, 1.0)],
    &[(0.2113248654051871, 0.5), (0.7886751345948129, 0.5)],
    &[(0.11270166537925831, 0.2777777777777778), (0.5, 0.4444444444444444), (0.8872983346207417, 0.2777777777777778)],
    &[
        (0.06943184420297371, 0.17392742256872692),
        (0.33000947820757187, 0.32607257743127305),
        (0.6699905217924281, 0.32607257743127305),
        (0.9305681557970263, 0.17392742256872692),
    ],
    &[
        (0.046910077030668004, 0.11846344252809454),
        (0.23076534494715845, 0.23931433524968324),
        (0.5, 0.28444444444444444),
        (0.7692346550528415, 0.23931433524968324),
        (0.953089922969332, 0.11846344252809454),
    ],
    &[
        (0.03376524289842399, 0.08566224618958518),
        (0.16939530676686773, 0.1803807865240693),
        (0.38069040695840156, 0.23395696728634552),
        (0.6193095930415985, 0.23395696728634552),
        (0.8306046932331322, 0.1803807865240693),
        (0.966234757101576, 0.08566224618958518),
    ],
];

/// That of the stages of `radau`.
pub const RADAU: [(f64, f64); 3] =
    [(0.1550510257216822, 0.37640306270046725), (0.6449489742783178, 0.5124858261884216), (1.0, 0.1111111111111111)];

/// Coefficients of a polynomial, in the order of [`NODES`].
pub type Coefficients<N> = [N; NODES.len()];

/// Places and weights of a quadrature from 0 to 1.
pub type Rule = &'static [(f64, f64)];

/// The mean square of a polynomial from 0 to 1 by a quadrature.
pub fn mean_square<M: Machine>(m: M, a: &Coefficients<M::Number>, rule: Rule) -> M::Number {
    rule.iter().fold(m.number(-0.0), |sum, (s, weight)| {
        let x = value(m, a, m.number(*s));
        sum + m.number(*weight) * (x * x)
    })
}

/// Shortens what comes out of both ends of a line in a step of a length to what is on the way in it: `given` is what
/// each end gave so far, J, and `admittance` one over its impedance. What comes out is told by each of some
/// quadratures, so that it is no more by that which books it.
pub fn shorten<M: Machine>(
    m: M,
    given: [M::Number; 2],
    (length, admittance): (M::Number, f64),
    waves: [Coefficients<M::Number>; 2],
    rules: &[Rule],
) -> [Coefficients<M::Number>; 2] {
    // By the rounding of sums it may be below 0.
    let there = positive(m, -(given[0] + given[1]));
    let squares = rules.iter().fold(m.number(0.0), |most, rule| {
        larger(m, most, mean_square(m, &waves[0], rule) + mean_square(m, &waves[1], rule))
    });
    let out = m.number(0.25 * admittance) * length * squares;
    let (part, one) = ((there / out).unary(Unary::Sqrt), m.number(1.0));
    let part = m.select(there.below(out), part, one);
    waves.map(|a| a.map(|a| a * part))
}

/// From values at the first nodes to coefficients, by divided differences.
pub fn interpolate<M: Machine>(m: M, values: &mut [M::Number]) {
    let n = values.len().min(NODES.len());
    for k in 1..n {
        for i in (k..n).rev() {
            values[i] = (values[i] - values[i - 1]) / m.number(NODES[i] - NODES[i - k]);
        }
    }
}

/// Where the value at the end, the second node, is clearly not what those at the others go on to, it becomes that.
pub fn before_jump<M: Machine>(m: M, values: &mut [M::Number]) {
    let end = values[1];
    let others = || (0..values.len()).filter(|k| *k != 1);
    let weight = |j: usize| -> f64 {
        others().filter(|i| *i != j).map(|i| (NODES[1] - NODES[i]) / (NODES[j] - NODES[i])).product()
    };
    let goes_on = others().fold(m.number(-0.0), |sum, j| sum + m.number(weight(j)) * values[j]);
    values[1] = goes_on;
    let mut coefficients = [goes_on; NODES.len()];
    let coefficients = &mut coefficients[..values.len()];
    coefficients.copy_from_slice(values);
    interpolate(m, coefficients);
    let size = values.iter().fold(end.abs(), |most, x| larger(m, most, x.abs()));
    // By as much are ends that are gone on to less certain, as slopes are.
    let least = m.number(SLOPE) * (tail(m, coefficients) + m.number(f64::EPSILON) * size);
    values[1] = m.select((end - goes_on).abs().at_most(least), end, goes_on);
}

/// The value at a place.
fn value<M: Machine>(m: M, a: &[M::Number], s: M::Number) -> M::Number {
    let last = a.len() - 1;
    (0..last).rev().fold(a[last], |x, k| a[k] + (s - m.number(NODES[k])) * x)
}

/// The slope at a place.
fn slope<M: Machine>(m: M, a: &[M::Number], s: M::Number) -> M::Number {
    let last = a.len() - 1;
    let (_, slope) = (0..last).rev().fold((a[last], m.number(0.0)), |(x, dx), k| {
        let ahead = s - m.number(NODES[k]);
        (a[k] + ahead * x, x + ahead * dx)
    });
    slope
}

/// How much the last two of so many coefficients tell at most: about what an interpolation misses. The product of the
/// distances to n nodes is some 2 / 4^n.
pub(crate) fn tail<M: Machine>(m: M, coefficients: &[M::Number]) -> M::Number {
    let n = coefficients.len();
    let part = |k: usize| coefficients[k].abs() * m.number(2.0 * 0.25f64.powi(k as i32));
    if n < 2 { m.number(0.0) } else { part(n - 1) + part(n - 2) }
}

/// Instants closer to one another than this part of themselves are one.
pub const SAME: f64 = 1e-12;

/// How far the instant of a jump may be off the end of a step from `t` to `end`, by rounding, and count as met.
pub fn slack<M: Machine>(m: M, t: M::Number, end: M::Number) -> M::Number {
    let size = larger(m, t.abs(), end.abs());
    let part = smaller(m, m.number(SAME) * size, m.number(1e-3) * (end - t).abs());
    larger(m, part, m.number(8.0 * f64::EPSILON) * size)
}

/// The derivatives of which jumps are carried on. Higher ones are beyond what steps resolve.
const LEVELS: f64 = 12.0;
/// How small a jump is seen where no tolerance says it: that of a run without options.
pub const JUMP: f64 = 1e-6;
/// Stands for a derivative where none jumps.
pub const SMOOTH: f64 = 1e3;
/// A slope is less certain than a value, by about the square of the degree, and some more.
const SLOPE: f64 = 1e3;
/// At fixed steps so many jumps are carried on at a time beside one a step.
const JUMPS: usize = 16;

/// The size of a history, and where its numbers are: the largest value so far, the ring of the steps that were taken
/// (begin, length and coefficients of each), and the ring of the instants at which what is delayed jumps, or a
/// derivative of it does (instant, and which derivative at least).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// By how long the signal is delayed, s.
    pub delay: f64,
    /// What the signal was before the start.
    pub start: f64,
    /// Coefficients of a step.
    pub nodes: usize,
    /// Steps for which there is room.
    pub pieces: usize,
    /// Jumps for which there is room.
    pub breaks: usize,
}

const LARGEST: usize = 0;
const FIRST_PIECE: usize = 1;
const PIECES: usize = 2;
const FIRST_BREAK: usize = 3;
const BREAKS: usize = 4;
const HEAD: usize = 5;

impl Shape {
    /// How many numbers there are.
    pub fn size(&self) -> usize {
        HEAD + (2 + self.nodes) * self.pieces + 2 * self.breaks
    }

    /// The numbers at the start.
    pub fn image(&self) -> Vec<f64> {
        let mut numbers = vec![0.0; self.size()];
        numbers[LARGEST] = self.start.abs();
        numbers
    }

    /// How many jumps are carried on at a time at fixed steps of this length. What jumps besides is met by the steps
    /// as it comes.
    pub fn jumps(delay: f64, step: f64) -> usize {
        JUMPS.saturating_add((delay / step).ceil() as usize)
    }

    /// Room for all that steps of at most this length read of delays that cut steps for one another, `wanted` being the
    /// step that was asked for.
    pub fn room(delay: f64, (step, wanted): (f64, f64), all: &[f64]) -> usize {
        let parts = |length: f64| (delay / length).ceil() as usize;
        let cuts = all.iter().map(|other| parts(*other).saturating_mul(1 + Self::jumps(*other, wanted)));
        cuts.fold(parts(step).saturating_add(3), usize::saturating_add)
    }

    fn stride(&self) -> usize {
        2 + self.nodes
    }

    fn breaks_at(&self) -> usize {
        HEAD + self.stride() * self.pieces
    }
}

/// Numbers in a machine's memory.
pub trait Numbers<M: Machine>: Copy {
    /// One of them.
    fn load(self, at: usize) -> M::Number;
    /// Replaces one.
    fn store(self, at: usize, x: M::Number);
    /// That at `first + stride * k`, with a whole `k` below `count`; the first one for any other `k`.
    fn pick(self, ring: Ring, k: M::Number) -> M::Number;
    /// Replaces that one.
    fn put(self, ring: Ring, k: M::Number, x: M::Number);
}

/// Numbers that lie a stride apart.
#[derive(Clone, Copy, Debug)]
pub struct Ring {
    /// The first one.
    pub first: usize,
    /// From one to the next.
    pub stride: usize,
    /// How many.
    pub count: usize,
}

/// A history in a machine's memory.
#[derive(Clone, Copy, Debug)]
pub struct Record<'s, M, K> {
    /// The machine.
    pub m: M,
    /// The memory.
    pub numbers: K,
    /// How the numbers lie there.
    pub shape: &'s Shape,
}

impl<M: Machine, K: Numbers<M>> Record<'_, M, K> {
    /// The place in a ring of so many of what comes `k` after the first.
    fn turned(&self, first: usize, k: M::Number, n: usize) -> M::Number {
        let (at, n) = (self.numbers.load(first) + k, self.m.number(n as f64));
        self.m.select(at.below(n), at, at - n)
    }

    /// The field of a piece: 0 its begin, 1 its length, and its coefficients.
    fn ring(&self, field: usize) -> Ring {
        Ring { first: HEAD + field, stride: self.shape.stride(), count: self.shape.pieces }
    }

    fn break_ring(&self, field: usize) -> Ring {
        Ring { first: self.shape.breaks_at() + field, stride: 2, count: self.shape.breaks }
    }

    fn begin(&self, k: M::Number) -> M::Number {
        self.numbers.pick(self.ring(0), self.turned(FIRST_PIECE, k, self.shape.pieces))
    }

    fn end(&self, k: M::Number) -> M::Number {
        let at = self.turned(FIRST_PIECE, k, self.shape.pieces);
        self.numbers.pick(self.ring(0), at) + self.numbers.pick(self.ring(1), at)
    }

    /// Those of a piece; there are as many as nodes.
    fn coefficients(&self, at: M::Number) -> Coefficients<M::Number> {
        let mut list = [self.m.number(0.0); NODES.len()];
        list[..self.shape.nodes].iter_mut().enumerate().for_each(|(k, a)| *a = self.numbers.pick(self.ring(2 + k), at));
        list
    }

    /// The instant of a break.
    fn jump(&self, k: M::Number) -> M::Number {
        self.numbers.pick(self.break_ring(0), self.turned(FIRST_BREAK, k, self.shape.breaks))
    }

    /// How many of some numbers that rise are not above another one.
    fn count_to(&self, n: usize, x: M::Number, at: impl Fn(M::Number) -> M::Number) -> M::Number {
        let m = self.m;
        let (low, high) = (m.holding(m.number(0.0)), m.holding(self.numbers.load(n)));
        // Nothing of it fails.
        let _ = m.repeat(|| {
            let (a, b) = (low.get(), high.get());
            m.when(b.at_most(a), || m.leave())?;
            let middle = (m.number(0.5) * (a + b)).unary(Unary::Floor);
            let is_below = at(middle).at_most(x);
            low.set(m.select(is_below.clone(), middle + m.number(1.0), a));
            high.set(m.select(is_below, b, middle));
            Ok(())
        });
        low.get()
    }

    /// The piece that an instant lies in, or where it begins; -1 before the start.
    fn piece(&self, t: M::Number) -> M::Number {
        self.count_to(PIECES, t, |k| self.begin(k)) - self.m.number(1.0)
    }

    /// What it was at an instant of a piece.
    fn at(&self, k: M::Number, t: M::Number) -> M::Number {
        let (m, at) = (self.m, self.turned(FIRST_PIECE, k, self.shape.pieces));
        let (begin, length) = (self.numbers.pick(self.ring(0), at), self.numbers.pick(self.ring(1), at));
        let value = value(m, &self.coefficients(at)[..self.shape.nodes], (t - begin) / length);
        m.select(k.below(m.number(0.0)), m.number(self.shape.start), value)
    }

    /// The largest that it was.
    pub fn size(&self) -> M::Number {
        self.numbers.load(LARGEST)
    }

    /// The first instant after `t`, by more than `slack`, at which a step has to end: where what arrives jumps, or
    /// where it is not known yet.
    pub fn next(&self, t: M::Number, slack: M::Number) -> M::Number {
        let (m, none) = (self.m, self.m.number(0.0));
        let count = self.numbers.load(PIECES);
        let last = self.end(count - m.number(1.0));
        let known = m.select(none.below(count), last, none) + m.number(self.shape.delay);
        let k = self.count_to(BREAKS, t + slack, |k| self.jump(k));
        let at = self.jump(k);
        let cuts = k.below(self.numbers.load(BREAKS)) & at.below(known);
        m.select(cuts, at, known)
    }

    /// What it was a delay before an instant; where it jumps, after the jump.
    pub fn arriving(&self, t: M::Number, slack: M::Number) -> M::Number {
        let was = t - self.m.number(self.shape.delay);
        self.at(self.piece(was + slack), was)
    }

    /// What it will have been from `t` to `end`, between which no break lies.
    pub fn aim(&self, (t, end): (M::Number, M::Number), slack: M::Number) -> Coefficients<M::Number> {
        let m = self.m;
        let (begin, length) = (t - m.number(self.shape.delay), end - t);
        let first = self.piece(begin + slack);
        let last = larger(m, first, self.piece(begin + length - slack));
        let k = m.holding(first);
        let mut values = [first; NODES.len()];
        for i in RISING {
            let x = begin + m.number(NODES[i]) * length;
            // Nothing of it fails.
            let _ = m.repeat(|| {
                let next = k.get() + m.number(1.0);
                m.when(!(next.at_most(last) & self.begin(next).at_most(x)), || m.leave())?;
                k.set(next);
                Ok(())
            });
            values[i] = self.at(k.get(), x);
        }
        interpolate(m, &mut values);
        values
    }

    /// Which derivative may jump at an instant, as one did a delay ago; [`SMOOTH`] where none does.
    pub fn arrives(&self, t: M::Number, slack: M::Number) -> M::Number {
        let (m, one) = (self.m, self.m.number(1.0));
        let (least, k) = (m.holding(m.number(SMOOTH)), m.holding(self.count_to(BREAKS, t + slack, |k| self.jump(k))));
        // Nothing of it fails.
        let _ = m.repeat(|| {
            let before = k.get() - one;
            m.when(before.below(m.number(0.0)), || m.leave())?;
            m.when(self.jump(before).below(t - slack), || m.leave())?;
            let level = self.numbers.pick(self.break_ring(1), self.turned(FIRST_BREAK, before, self.shape.breaks));
            least.set(smaller(m, least.get(), level));
            k.set(before);
            Ok(())
        });
        least.get()
    }

    /// Takes in what it was over a step that was taken, or over a part of one, by values at the first nodes. `arrives`
    /// is which derivative may jump at its beginning, and `tolerance` the part of its size that tells a jump from none.
    pub fn take(
        &self,
        (begin, length): (M::Number, M::Number),
        values: &[M::Number],
        arrives: M::Number,
        tolerance: f64,
    ) {
        let (m, zero, one) = (self.m, self.m.number(0.0), self.m.number(1.0));
        let largest = values.iter().fold(self.size(), |most, x| larger(m, most, x.abs()));
        self.numbers.store(LARGEST, largest);
        let mut own = [zero; NODES.len()];
        let own = &mut own[..self.shape.nodes];
        own.copy_from_slice(&values[..self.shape.nodes]);
        interpolate(m, own);
        let count = self.numbers.load(PIECES);
        let at = self.turned(FIRST_PIECE, count - one, self.shape.pieces);
        let (last, last_length) = (self.coefficients(at), self.numbers.pick(self.ring(1), at));
        let is_first = count.equals(zero);
        let before = m.select(is_first.clone(), m.number(self.shape.start), value(m, &last[..self.shape.nodes], one));
        let steep = m.select(is_first.clone(), zero, slope(m, &last[..self.shape.nodes], one) / last_length);
        let short = m.select(is_first, length, last_length);
        let least = m.number(tolerance) * largest;
        let jump = (value(m, own, zero) - before).abs();
        let bend = (slope(m, own, zero) / length - steep).abs() * smaller(m, short, length);
        let level = m.select((m.number(SLOPE) * least).below(bend), one, arrives + one);
        let level = m.select(least.below(jump), zero, level);
        self.forget(begin);
        let noted = self.numbers.load(BREAKS);
        let is_carried = level.at_most(m.number(LEVELS)) & noted.below(m.number(self.shape.breaks as f64));
        m.only(is_carried, || {
            let at = self.turned(FIRST_BREAK, noted, self.shape.breaks);
            self.numbers.put(self.break_ring(0), at, begin + m.number(self.shape.delay));
            self.numbers.put(self.break_ring(1), at, level);
            self.numbers.store(BREAKS, noted + one);
        });
        let count = self.numbers.load(PIECES);
        let at = self.turned(FIRST_PIECE, count, self.shape.pieces);
        self.numbers.put(self.ring(0), at, begin);
        self.numbers.put(self.ring(1), at, length);
        own.iter().enumerate().for_each(|(k, a)| self.numbers.put(self.ring(2 + k), at, *a));
        self.numbers.store(PIECES, count + one);
    }

    /// Forgets what no step from `now` on reads; the oldest piece, where there is no room for another one.
    fn forget(&self, now: M::Number) {
        let (m, n) = (self.m, self.shape.pieces);
        let past = now - m.number(self.shape.delay);
        let full = m.number(n as f64);
        self.drop_first((FIRST_PIECE, PIECES, n), |count| self.end(m.number(0.0)).below(past) | full.at_most(count));
        self.drop_first((FIRST_BREAK, BREAKS, self.shape.breaks), |_| self.jump(m.number(0.0)).below(now));
    }

    /// Drops the first of a ring as long as there is one for which a condition holds.
    fn drop_first(&self, (first, count, n): (usize, usize, usize), condition: impl Fn(M::Number) -> M::Condition) {
        let (m, one) = (self.m, self.m.number(1.0));
        // Nothing of it fails.
        let _ = m.repeat(|| {
            let left = self.numbers.load(count);
            m.when(!(m.number(0.0).below(left) & condition(left)), || m.leave())?;
            self.numbers.store(first, self.turned(first, one, n));
            self.numbers.store(count, left - one);
            Ok(())
        });
    }
}

/// A slice of a run's memory.
impl<'a> Numbers<Real<'a>> for &'a [Cell<f64>] {
    fn load(self, at: usize) -> f64 {
        self[at].get()
    }

    fn store(self, at: usize, x: f64) {
        self[at].set(x);
    }

    fn pick(self, ring: Ring, k: f64) -> f64 {
        self[ring.at(k)].get()
    }

    fn put(self, ring: Ring, k: f64, x: f64) {
        self[ring.at(k)].set(x);
    }
}

impl Ring {
    fn at(self, k: f64) -> usize {
        // What is below 0, or no number, becomes 0.
        let k = k as usize;
        self.first + self.stride * if k < self.count { k } else { 0 }
    }
}

/// What a signal was, back to a delay before now, as a run has it: there is always room for another step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct History {
    shape: Shape,
    /// The most jumps that are carried on at a time.
    jumps: usize,
    numbers: Vec<Cell<f64>>,
}

/// Steps and jumps for which there is room from the beginning.
const ROOM: usize = 256;

impl History {
    /// What a signal was before the start, by how long it is delayed, by how many nodes its steps are told, and how
    /// many jumps at most are carried on at a time.
    pub(crate) fn new((delay, start): (f64, f64), nodes: usize, jumps: usize) -> Self {
        let shape = Shape { delay, start, nodes, pieces: ROOM, breaks: ROOM.min(jumps) };
        Self { shape, jumps, numbers: shape.image().into_iter().map(Cell::new).collect() }
    }

    fn record(&self) -> Record<'_, Real<'_>, &[Cell<f64>]> {
        Record { m: Real::new(), numbers: &self.numbers, shape: &self.shape }
    }

    fn count(&self, at: usize) -> usize {
        self.numbers[at].get() as usize
    }

    /// Whether it may stand for another one, and is sound.
    pub(crate) fn alike(&self, other: &Self) -> bool {
        let Shape { delay, start, nodes, pieces, breaks } = self.shape;
        let fits = pieces > 0 && pieces.max(breaks) <= self.numbers.len();
        if (delay, start, nodes) != (other.shape.delay, other.shape.start, other.shape.nodes)
            || !fits
            || self.numbers.len() != self.shape.size()
        {
            return false;
        }
        let rings = [(FIRST_PIECE, PIECES, pieces), (FIRST_BREAK, BREAKS, breaks)];
        let is_whole = |x: f64| x >= 0.0 && x as usize as f64 == x;
        let whole = rings.iter().all(|(first, count, n)| {
            let [first, count] = [first, count].map(|at| self.numbers[*at].get());
            is_whole(first) && is_whole(count) && count as usize <= *n && (first as usize) < (*n).max(1)
        });
        let record = self.record();
        let piece = |k: usize| [record.begin(k as f64), record.end(k as f64)];
        whole
            && (0..self.count(BREAKS)).all(|k| record.jump(k as f64).is_finite())
            && (0..self.count(PIECES)).all(|k| {
                let [begin, end] = piece(k);
                begin < end && end.is_finite() && (k == 0 || piece(k - 1)[0] < begin)
            })
    }

    /// See [`Record::next`].
    pub(crate) fn next(&self, t: f64, slack: f64) -> f64 {
        self.record().next(t, slack)
    }

    /// See [`Record::arriving`].
    pub(crate) fn arriving(&self, t: f64, slack: f64) -> f64 {
        self.record().arriving(t, slack)
    }

    /// What it will have been from `t` to `end`, between which no break lies: slots as [`SLOTS`] says. And how coarse
    /// that is, beside the largest that it was.
    pub(crate) fn aim(&self, (t, end): (f64, f64), slack: f64, slots: &mut [f64]) -> f64 {
        let coefficients = self.record().aim((t, end), slack);
        slots[..NODES.len()].copy_from_slice(&coefficients);
        slots[NODES.len()] = 1.0 / (end - t);
        slots[NODES.len() + 1] = t;
        let coarse = tail(Real::new(), &coefficients);
        if coarse > 0.0 { coarse / self.size().max(coarse) } else { 0.0 }
    }

    /// The largest that it was.
    pub(crate) fn size(&self) -> f64 {
        self.record().size()
    }

    /// See [`Record::arrives`].
    pub(crate) fn arrives(&self, t: f64, slack: f64) -> f64 {
        self.record().arrives(t, slack)
    }

    /// See [`Record::take`].
    pub(crate) fn take(&mut self, step: (f64, f64), values: &[f64], arrives: f64, tolerance: f64) {
        let Shape { pieces, breaks, .. } = self.shape;
        if self.count(PIECES) == pieces || self.count(BREAKS) == breaks && breaks < self.jumps {
            self.grow();
        }
        self.record().take(step, values, arrives, tolerance);
    }

    /// Makes room for twice as many steps and jumps.
    fn grow(&mut self) {
        let old = std::mem::take(self);
        let Shape { pieces, breaks, .. } = old.shape;
        self.jumps = old.jumps;
        self.shape = Shape { pieces: 2 * pieces, breaks: self.jumps.min(2 * breaks), ..old.shape };
        self.numbers = self.shape.image().into_iter().map(Cell::new).collect();
        let (from, to) = (old.record(), self.record());
        for at in [LARGEST, PIECES, BREAKS] {
            to.numbers.store(at, from.numbers.load(at));
        }
        for k in (0..old.count(PIECES)).map(|k| k as f64) {
            let at = from.turned(FIRST_PIECE, k, pieces);
            (0..2 + self.shape.nodes).for_each(|i| to.numbers.put(to.ring(i), k, from.numbers.pick(from.ring(i), at)));
        }
        for k in (0..old.count(BREAKS)).map(|k| k as f64) {
            let at = from.turned(FIRST_BREAK, k, breaks);
            (0..2).for_each(|i| to.numbers.put(to.break_ring(i), k, from.numbers.pick(from.break_ring(i), at)));
        }
    }

    /// Becomes another one, without new room where there is enough.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        (self.shape, self.jumps) = (other.shape, other.jumps);
        self.numbers.clone_from(&other.numbers);
    }
}

#[cfg(test)]
mod tests {
    use super::{History, NODES, SLOTS, SMOOTH, interpolate, slope, tail, value};
    use crate::machine::Real;

    /// A polynomial of the degree of the nodes is met to rounding, and its slope.
    #[test]
    fn polynomials_are_met() {
        let law = |s: f64| 1.0 + (s - 0.3).powi(12) - 2.0 * s.powi(7);
        let rate = |s: f64| 12.0 * (s - 0.3).powi(11) - 14.0 * s.powi(6);
        let mut a = NODES.map(law);
        interpolate(Real::new(), &mut a);
        for k in 0..=50 {
            let s = f64::from(k) / 50.0;
            assert!((value(Real::new(), &a, s) - law(s)).abs() < 1e-14, "{s}");
            assert!((slope(Real::new(), &a, s) - rate(s)).abs() < 1e-12, "{s}");
        }
    }

    /// The end of what jumps there is had without it.
    #[test]
    fn an_end_goes_on_from_the_rest() {
        let law = |s: f64| 1.0 + (s - 0.3).powi(4) - 2.0 * s.powi(3);
        let mut values = NODES.map(law);
        values[1] = 1e6;
        super::before_jump(Real::new(), &mut values[..6]);
        assert!((values[1] - law(1.0)).abs() < 1e-13);
        // What does not jump is left as it is.
        let mut values = NODES.map(|s| (2.0 * s).sin());
        super::before_jump(Real::new(), &mut values);
        assert_eq!(values[1], 2f64.sin());
    }

    #[test]
    fn squares_are_integrated() {
        let mut a = NODES.map(|s| s.powi(12));
        interpolate(Real::new(), &mut a);
        assert!((super::mean_square(Real::new(), &a, &super::EXACT) * 25.0 - 1.0).abs() < 1e-13);
        let mut a = NODES.map(|s| 2.0 * s - 1.0);
        interpolate(Real::new(), &mut a);
        assert!((super::mean_square(Real::new(), &a, &super::EXACT) * 3.0 - 1.0).abs() < 1e-14);
    }

    /// The quadratures of stages are exact for polynomials of their degree.
    #[test]
    fn quadratures_have_their_degrees() {
        let rules = super::STAGES.iter().enumerate().map(|(k, rule)| (2 * k + 1, *rule));
        for (degree, rule) in rules.chain([(4, &super::RADAU[..]), (25, &super::EXACT)]) {
            for n in 0..=degree {
                let sum: f64 = rule.iter().map(|(s, weight)| weight * s.powi(n as i32)).sum();
                assert!((sum * (n as f64 + 1.0) - 1.0).abs() < 1e-14, "{degree} {n}: {sum}");
            }
        }
    }

    /// What the last coefficients tell is about what an interpolation by fewer nodes misses.
    #[test]
    fn the_tail_tells_what_is_missed() {
        for n in [4, 6, 9, 13] {
            let mut a = NODES.map(|s| (3.0 * s).sin());
            interpolate(Real::new(), &mut a[..n]);
            a[n..].fill(0.0);
            let off =
                (0..=100).map(|k| f64::from(k) / 100.0).map(|s| (value(Real::new(), &a, s) - (3.0 * s).sin()).abs());
            let (off, told) = (off.fold(0.0, f64::max), tail(Real::new(), &a[..n]));
            assert!(told > off && told < 1e4 * off.max(1e-16), "{n}: {told} of {off}");
        }
    }

    /// Over pieces of unequal length, across their borders, and before the start.
    #[test]
    fn what_was_is_read_a_delay_later() {
        let mut history = History::new((1.0, 0.0), NODES.len(), usize::MAX);
        let mut t = 0.0;
        for length in [0.25, 0.5, 0.125, 0.0625, 0.3] {
            let values = NODES.map(|s| (t + s * length).sin());
            history.take((t, length), &values, SMOOTH, 1e-12);
            t += length;
        }
        let mut slots = [0.0; SLOTS];
        history.aim((0.5, 1.0), 1e-12, &mut slots);
        assert!(slots[..NODES.len()].iter().all(|a| *a == 0.0), "{slots:?}");
        history.aim((1.0, 2.1), 1e-12, &mut slots);
        for k in 0..=10 {
            let s = f64::from(k) / 10.0;
            let a: [f64; NODES.len()] = std::array::from_fn(|i| slots[i]);
            assert!((value(Real::new(), &a, s) - (1.1 * s).sin()).abs() < 1e-12, "{s}");
            assert_eq!((slots[NODES.len()] * 1.1 - 1.0).abs() < 1e-15, slots[NODES.len() + 1] == 1.0);
        }
    }

    /// A jump at the start arrives a delay later, its traces in the derivatives after that, and then no more.
    #[test]
    fn jumps_are_carried_on() {
        let mut history = History::new((1.0, 0.0), NODES.len(), usize::MAX);
        history.take((0.0, 0.5), &NODES.map(|_| 1.0), SMOOTH, 1e-9);
        assert_eq!(history.next(0.5, 1e-12), 1.0);
        assert_eq!(history.arrives(1.0, 1e-12), 0.0);
        history.take((0.5, 0.5), &NODES.map(|_| 1.0), SMOOTH, 1e-9);
        history.take((1.0, 0.5), &NODES.map(|_| 1.0), 0.0, 1e-9);
        assert_eq!((history.next(1.0, 1e-12), history.arrives(2.0, 1e-12)), (2.0, 1.0));
        history.take((1.5, 0.5), &NODES.map(|_| 1.0), 12.0, 1e-9);
        assert_eq!(history.next(2.0, 1e-12), 3.0, "only as far as it is known");
    }
}
