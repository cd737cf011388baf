//! Error weights of unknowns, and the weighted norms of an iteration; [`super::newton`] says what they are.

use crate::machine::{Flow, Machine, Number, Variable};

/// The error weights of an iteration, and what its unknowns are beside their scales.
pub struct Weights<M: Machine> {
    m: M,
    n: usize,
    unknowns: M::Vector,
    /// The weights as they are given.
    given: M::Vector,
    scale: M::Vector,
    /// The weights that count: those given, where all of them are known to be positive.
    weight: M::Vector,
    is_plain: bool,
    /// 1 where there is a weight at all.
    weighted: M::Variable,
    /// 1 where an unknown has neither a weight nor a scale.
    blind: M::Variable,
    /// The mean of `w_j s_j²`: what an unknown without a weight counts for at its scale.
    share: M::Variable,
}

/// Whether a weight counts.
fn counts<M: Machine>(m: M, w: M::Number) -> M::Condition {
    m.number(0.0).below(w) & w.is_finite()
}

impl<M: Machine> Weights<M> {
    /// The weights of `n` unknowns with scales, and room for as many.
    pub fn new(
        m: M,
        n: usize,
        (unknowns, given, scale): (&M::Vector, &M::Vector, &M::Vector),
        room: &M::Vector,
    ) -> Self {
        let is_plain = m.is_positive(given);
        let weight = if is_plain { given.clone() } else { room.clone() };
        let (unknowns, given, scale) = (unknowns.clone(), given.clone(), scale.clone());
        let (weighted, blind, share) = (m.variable(), m.variable(), m.variable());
        Self { m, n, unknowns, given, scale, weight, is_plain, weighted, blind, share }
    }

    /// Makes those that count: of unknowns without a weight the mean share.
    pub fn prepare(&self) {
        if self.is_plain {
            return;
        }
        let (m, n, zero, one) = (self.m, self.n, self.m.number(0.0), self.m.number(1.0));
        self.weighted.set(one);
        self.blind.set(zero);
        self.share.set(zero);
        m.each(n, |i| m.put(&self.weight, i, m.at(&self.given, i)));
        let all = m.all(n, |i| counts(m, m.at(&self.given, i)));
        m.only(!all, || {
            let count = m.fold(n, zero, |i, sum| sum + m.select(counts(m, m.at(&self.given, i)), one, zero));
            let total = m.fold(n, zero, |i, sum| {
                let (w, s) = (m.at(&self.given, i), m.at(&self.scale, i));
                sum + m.select(counts(m, w), w * s * s, zero)
            });
            self.share.set(total / count);
            let none = count.equals(zero);
            m.only(none.clone(), || self.weighted.set(zero));
            m.each(n, |i| {
                let w = self.known(i);
                let w = m.select(counts(m, w), w, zero);
                m.put(&self.weight, i, m.select(none.clone(), one, w));
            });
            let all = m.all(n, |i| counts(m, self.known(i)));
            m.only(!all & !none, || self.blind.set(one));
        });
    }

    /// A weight by its own number or by the scale; what need not count.
    fn known(&self, i: M::Index) -> M::Number {
        let (m, w, s) = (self.m, self.m.at(&self.given, i), self.m.at(&self.scale, i));
        m.select(counts(m, w), w, self.share.get() / (s * s))
    }

    /// Takes an update for the scale of what has none, where a condition holds and there is such an unknown.
    ///
    /// # Errors
    /// Where `then` leaves, which is done after that.
    pub fn see(&self, condition: M::Condition, update: &M::Vector, then: impl FnOnce() -> Flow) -> Flow {
        if self.is_plain {
            return Ok(());
        }
        let m = self.m;
        m.when(self.blind.get().is_set() & condition, || {
            m.each(self.n, |i| {
                let (d, known) = (m.at(update, i), self.known(i));
                let part = self.share.get() / (d * d);
                let part = m.select(counts(m, part), part, m.number(0.0));
                m.put(&self.weight, i, m.select(counts(m, known), known, part));
            });
            then()
        })
    }

    /// `Σ w_i v_i²`
    pub fn square(&self, mut v: impl FnMut(M::Index) -> M::Number) -> M::Number {
        let m = self.m;
        m.fold(self.n, m.number(0.0), |i, sum| {
            let (w, v) = (m.at(&self.weight, i), v(i));
            sum + w * v * v
        })
    }

    /// `Σ w_i (u_i² + s_i²)`, of what has no weight of its own at its scale alone: where that is next to nothing, it
    /// says nothing of the unknown. 0 without weights.
    pub fn energy(&self) -> M::Number {
        let (m, zero) = (self.m, self.m.number(0.0));
        let sum = m.fold(self.n, zero, |i, sum| {
            let (u, s) = (m.at(&self.unknowns, i), m.at(&self.scale, i));
            let own = match self.is_plain {
                true => u * u,
                false => m.select(counts(m, m.at(&self.given, i)), u * u, zero),
            };
            sum + m.at(&self.weight, i) * (own + s * s)
        });
        if self.is_plain { sum } else { m.select(self.weighted.get().is_set(), sum, zero) }
    }

    /// Whether an update is at most a part `t` of the unknowns, or rounding beside all of them; `size` is `|r|²` before
    /// it.
    pub fn is_small(&self, update: &M::Vector, t: M::Number, size: M::Number) -> M::Condition {
        let (m, zero, one) = (self.m, self.m.number(0.0), self.m.number(1.0));
        let near = |i: M::Index| {
            let (u, s) = (m.at(&self.unknowns, i).abs(), m.at(&self.scale, i));
            m.at(update, i).abs().at_most(t * (u + s))
        };
        let small = m.holding(one);
        m.only(!m.all(self.n, near), || {
            let energy = self.energy();
            let bound = m.select(size.at_most(energy), t * t * energy, m.number(-1.0));
            let all = m.all(self.n, |i| {
                let (w, d) = (m.at(&self.given, i), m.at(update, i));
                near(i) | (counts(m, w) & !bound.below(w * d * d))
            });
            small.set(m.select(all, one, zero));
        });
        small.get().is_set()
    }

    /// The place of the unknown whose change is largest beside itself, as a number, and the change.
    pub fn worst(&self, update: &M::Vector) -> (M::Number, M::Number) {
        let (m, zero) = (self.m, self.m.number(0.0));
        let (which, change, most) = (m.holding(zero), m.holding(zero), m.holding(m.number(-1.0)));
        let place = m.holding(zero);
        m.each(self.n, |i| {
            let (d, u, s) = (m.at(update, i), m.at(&self.unknowns, i).abs(), m.at(&self.scale, i));
            let (part, k) = (d.abs() / (u + s), place.get());
            m.only(most.get().below(part), || {
                which.set(k);
                change.set(d);
                most.set(part);
            });
            place.set(k + m.number(1.0));
        });
        (which.get(), change.get())
    }
}
