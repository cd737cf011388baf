//! Newton's iteration, step by step, for every [`Machine`]; [`super::newton`] says what it does and why.

pub mod chord;

use super::norm::Weights;
use crate::ir::{self, Knee, Unary};
use crate::machine::{Flow, Machine, Number, Variable};
use crate::options::NewtonOptions;

/// What [`Iteration::end`] is where a solution was found,
pub const DONE: f64 = 1.0;
/// where none was,
pub const NO_CONVERGENCE: f64 = 2.0;
/// and where the matrix cannot be solved.
pub const SINGULAR: f64 = 3.0;

/// What stands for the row without a pivot where a system was solved,
pub const SOLVED: f64 = -1.0;
/// and where it was, but left something undetermined.
pub const UNDETERMINED: f64 = -2.0;

/// What is known of an iteration before it runs.
#[derive(Clone, Debug)]
pub struct Method {
    /// How many unknowns there are.
    pub n: usize,
    /// Iterations at most.
    pub limit: u32,
    /// Whether the first update is the solution.
    pub affine: bool,
    /// Whether the equations give the update themselves.
    pub given: bool,
    /// The part of the unknowns that may be left.
    pub left: f64,
    /// Whether the start is predicted, and another one given besides.
    pub predicted: bool,
    /// Whether something counts for nothing in a first update.
    pub coarse: bool,
    /// Unknowns that are exponents.
    pub knees: Vec<Knee>,
    /// Whether the matrix may leave unknowns undetermined.
    pub undetermined: bool,
    /// Whether what the last update leaves is looked at.
    pub corners: bool,
    /// Whether an update may be judged by the next one: far up an exponential, and beyond a pole, that is small by
    /// nature.
    pub doubts: bool,
    /// Where it begins with two updates by one matrix.
    pub chord: Option<chord::Pattern>,
    /// The numbers that it goes by.
    pub options: NewtonOptions,
}

impl Method {
    /// That of an iteration of a program.
    pub fn of(newton: &ir::Newton) -> Self {
        let options = newton.options;
        Self {
            n: newton.residual.len(),
            limit: newton.limit,
            affine: newton.affine,
            given: !newton.update.is_empty(),
            left: newton.left,
            predicted: !newton.cold.is_empty(),
            coarse: !newton.small.is_empty(),
            knees: newton.knees.clone(),
            undetermined: newton.undetermined,
            corners: newton.corners,
            doubts: newton.update.is_empty() && newton.knees.is_empty() && !newton.has_poles(),
            chord: chord::Pattern::of(newton, &options.chord),
            options,
        }
    }
}

/// The equations of an iteration, as a back end computes them.
pub trait Equations<M: Machine> {
    /// Computes residual and matrix at the unknowns; `coarse` without what counts for nothing in a first update.
    ///
    /// # Errors
    /// Where an iteration inside this one fails.
    fn evaluate(&mut self, m: M, coarse: bool) -> Flow;

    /// The residual that was computed last.
    fn residual(&self) -> M::Vector;

    /// An entry of that matrix, in the order of its pattern.
    fn entry(&self, m: M, k: usize) -> M::Number;

    /// Whether all of them are finite; of a given update this is not asked.
    fn is_finite(&self, m: M) -> M::Condition;

    /// The update by that matrix and residual, or that which is given. `row` becomes [`SOLVED`], [`UNDETERMINED`], or
    /// the row without a pivot.
    fn solve(&mut self, m: M, row: &M::Variable) -> M::Vector;

    /// Adds to the iterations done.
    fn count(&mut self, m: M, iterations: M::Number);
}

/// Where the numbers of an iteration are. An affine one has unknowns alone.
pub struct Places<M: Machine> {
    /// The unknowns.
    pub unknowns: M::Vector,
    /// What rounding took from them in the update made last, where that is asked for.
    pub rounding: Option<M::Vector>,
    /// Their error weights.
    pub weight: M::Vector,
    /// Their scales.
    pub scale: M::Vector,
    /// Where else to start, where the start is predicted.
    pub cold: Option<M::Vector>,
    /// Room for the weights that count.
    pub room: M::Vector,
    /// Room for the update.
    pub update: M::Vector,
    /// Room for the update and the residual that the chord start hands on, where it begins so.
    pub begun: (M::Vector, M::Vector),
}

/// An iteration on its way.
pub struct Iteration<'p, M: Machine> {
    pub(super) m: M,
    pub(super) method: &'p Method,
    pub(super) places: Places<M>,
    pub(super) weights: Weights<M>,
    /// Iterations so far.
    pub(super) count: M::Variable,
    /// `|r|²`: of the last residual, and the least.
    size: M::Variable,
    pub(super) best: M::Variable,
    /// Whether the update made last waits for the next one to be judged.
    doubted: M::Variable,
    /// `|r|²` before the update made last, and the part of it that is allowed.
    from: M::Variable,
    reach: M::Variable,
    /// Whether an update was made, and its square.
    pub(super) made: M::Variable,
    pub(super) before: M::Variable,
    /// How often the update made last was halved, and made longer.
    halvings: M::Variable,
    stretches: M::Variable,
    nudges: M::Variable,
    /// Updates in a row that were not much smaller than the smallest before, and `|d|²` of that.
    stalls: M::Variable,
    pub(super) least: M::Variable,
    /// Whether an update left something undetermined.
    undetermined: M::Variable,
    /// Whether the update made last was to be the last, whether it has just been looked at, and how often it may be.
    last: M::Variable,
    looked: M::Variable,
    looks: M::Variable,
    /// How it ended.
    pub end: M::Variable,
    /// The row without a pivot, where there is one.
    pub row: M::Variable,
}

impl<'p, M: Machine> Iteration<'p, M> {
    /// An iteration that is to begin.
    pub fn new(m: M, method: &'p Method, places: Places<M>) -> Self {
        let given = (&places.unknowns, &places.weight, &places.scale);
        let weights = Weights::new(m, method.n, given, &places.room);
        let new = || m.variable();
        Self {
            m,
            method,
            places,
            weights,
            count: new(),
            size: new(),
            best: new(),
            doubted: new(),
            from: new(),
            reach: new(),
            made: new(),
            before: new(),
            halvings: new(),
            stretches: new(),
            nudges: new(),
            stalls: new(),
            least: new(),
            undetermined: new(),
            last: new(),
            looked: new(),
            looks: new(),
            end: new(),
            row: new(),
        }
    }

    /// Brings the residual to 0, starting from the unknowns as they are.
    ///
    /// # Errors
    /// Where the equations fail.
    pub fn run(&self, equations: &mut impl Equations<M>) -> Flow {
        let (m, method) = (self.m, self.method);
        self.no_rounding();
        let Some(pattern) = &method.chord else {
            self.prepare();
            return match &self.places.cold {
                Some(cold) => {
                    let again = m.holding(m.number(1.0));
                    self.again(equations, &again, || m.each(method.n, |i| self.put(i, m.at(cold, i))))
                }
                None => m.repeat(|| self.iterate(equations)),
            };
        };
        let begun = chord::begin(self, pattern, equations)?;
        m.when(!self.end.get().equals(m.number(DONE)), || {
            self.prepare();
            self.started();
            begun.go_on(self);
            self.again(equations, &begun.again, || begun.anew(self))
        })
    }

    fn number(&self, x: f64) -> M::Number {
        self.m.number(x)
    }

    /// A number of the unknowns.
    pub(super) fn unknown(&self, i: M::Index) -> M::Number {
        self.m.at(&self.places.unknowns, i)
    }

    /// Puts an unknown somewhere.
    pub(super) fn put(&self, i: M::Index, x: M::Number) {
        self.m.put(&self.places.unknowns, i, x);
    }

    /// A number of the update.
    fn update(&self, i: M::Index) -> M::Number {
        self.m.at(&self.places.update, i)
    }

    fn put_update(&self, i: M::Index, x: M::Number) {
        self.m.put(&self.places.update, i, x);
    }

    /// Makes the weights, and begins.
    fn prepare(&self) {
        self.reset();
        if !self.method.affine {
            self.weights.prepare();
        }
    }

    /// Where no iteration was done.
    fn reset(&self) {
        let (m, zero, infinite) = (self.m, self.number(0.0), self.number(f64::INFINITY));
        for v in [
            &self.count,
            &self.made,
            &self.before,
            &self.halvings,
            &self.stretches,
            &self.nudges,
            &self.stalls,
            &self.end,
        ] {
            v.set(zero);
        }
        if self.method.undetermined {
            self.undetermined.set(zero);
        }
        if self.method.corners {
            self.looks.set(self.number(f64::from(self.method.options.looks)));
            self.last.set(zero);
        }
        for v in [&self.best, &self.from, &self.least] {
            v.set(infinite);
        }
        self.hope();
        self.row.set(self.number(SOLVED));
        if !self.method.affine {
            m.each(self.method.n, |i| self.put_update(i, zero));
        }
    }

    /// Where one iteration is done already, and nothing decided.
    pub(super) fn started(&self) {
        self.count.set(self.number(1.0));
        self.end.set(self.number(0.0));
    }

    /// Iterates, and where that fails once more, if `again` says so, after `anew`.
    fn again(&self, equations: &mut impl Equations<M>, again: &M::Variable, anew: impl Fn()) -> Flow {
        let (m, one) = (self.m, self.number(1.0));
        let over = m.holding(self.number(0.0));
        m.repeat(|| {
            m.repeat(|| self.iterate(equations))?;
            let done = self.end.get().equals(self.number(DONE));
            m.when(done | !again.get().is_set() | over.get().is_set(), || m.leave())?;
            over.set(one);
            equations.count(m, self.count.get());
            self.reset();
            anew();
            Ok(())
        })
    }

    /// One iteration.
    fn iterate(&self, equations: &mut impl Equations<M>) -> Flow {
        let m = self.m;
        let limit = self.number(f64::from(self.method.limit));
        m.when(!self.count.get().below(limit), || self.finish(NO_CONVERGENCE))?;
        self.count.set(self.count.get() + self.number(1.0));
        equations.evaluate(m, false)?;
        if self.method.affine {
            let solution = equations.solve(m, &self.row);
            m.when(!self.row.get().below(self.number(0.0)), || self.finish(SINGULAR))?;
            m.each(self.method.n, |i| self.put(i, self.unknown(i) - m.at(&solution, i)));
            return self.finish(DONE);
        }
        let residual = equations.residual();
        self.judge(&residual)?;
        let solution = equations.solve(m, &self.row);
        let finite = if self.method.given { m.known(true) } else { equations.is_finite(m) };
        self.advance(&residual, &solution, finite)
    }

    fn no_rounding(&self) {
        if let Some(rounding) = &self.places.rounding {
            self.m.each(self.method.n, |i| self.m.put(rounding, i, self.number(0.0)));
        }
    }

    /// Leaves an update to what rounding took, where the unknown does not show it: the residual that it is had from has
    /// seen what rounding took in the update before.
    pub(super) fn leave(&self, i: M::Index, update: M::Number) {
        if let Some(rounding) = &self.places.rounding {
            self.m.put(rounding, i, -update);
        }
    }

    /// Takes an update off an unknown, and keeps what rounding takes (Kahan, Commun. ACM 8, 1965).
    pub(super) fn take(&self, i: M::Index, update: M::Number) {
        let before = self.unknown(i);
        let after = before - update;
        if let Some(rounding) = &self.places.rounding {
            self.m.put(rounding, i, (before - after) - update);
        }
        self.put(i, after);
    }

    /// Ends the iterations.
    pub(super) fn finish(&self, how: f64) -> Flow {
        self.end.set(self.number(how));
        self.m.leave()
    }

    /// Whether one more halving is allowed.
    fn may_halve(&self) -> M::Condition {
        let most = self.number(f64::from(self.method.options.halvings));
        self.made.get().is_set() & self.halvings.get().below(most)
    }

    /// What a whole update has to come to.
    fn hope(&self) {
        self.reach.set(self.number(1.0 - self.method.options.decrease));
    }

    /// Forgets the residuals so far.
    fn forget(&self) {
        self.best.set(self.number(f64::INFINITY));
        self.from.set(self.number(f64::INFINITY));
    }

    /// Takes back half of the update, and begins anew.
    fn halve(&self) -> Flow {
        let (m, half) = (self.m, self.number(0.5));
        self.reach.set(half * self.reach.get() + half);
        m.each(self.method.n, |i| {
            let d = self.update(i) * half;
            self.put_update(i, d);
            self.put(i, self.unknown(i) + d);
        });
        self.halvings.set(self.halvings.get() + self.number(1.0));
        m.again()
    }

    /// Looks at the residual: halves where it got worse, ends where it is 0.
    fn judge(&self, residual: &M::Vector) -> Flow {
        let (m, o, zero) = (self.m, &self.method.options, self.number(0.0));
        let size = self.weights.square(|i| m.at(residual, i));
        self.size.set(size);
        if self.method.corners {
            self.look(size)?;
        }
        let above = (self.number(o.growth) * self.best.get()).below(size);
        self.doubted.set(zero);
        let late = match self.method.given {
            true => m.known(false),
            false => {
                let patient = self.number(f64::from(o.patience)).below(self.count.get());
                patient & (self.reach.get() * self.from.get()).below(size)
            }
        };
        let suspicious = !size.is_finite() | above.clone() | late.clone();
        m.when(suspicious, || self.suspect(size, above, late))?;
        m.when(size.at_most(zero), || {
            let all = m.all(self.method.n, |i| m.at(residual, i).equals(zero));
            m.when(all, || {
                self.no_rounding();
                self.finish(DONE)
            })
        })?;
        let count = self.count.get();
        let (long, longer) = (f64::from(o.damped), f64::from(o.damped + o.grace));
        let last = zero.below(self.stalls.get()) | self.number(longer).below(count);
        let mut many = self.number(long).below(count) & last;
        if self.method.undetermined {
            let patient = self.number(f64::from(o.patience)).below(count);
            many = many | (self.undetermined.get().is_set() & patient);
        }
        m.when(many, || self.rest())
    }

    /// Halves where the residual, which is `above` what is allowed, or has not fallen (`late`), says so.
    fn suspect(&self, size: M::Number, above: M::Condition, late: M::Condition) -> Flow {
        let (m, o, zero) = (self.m, &self.method.options, self.number(0.0));
        let energy = self.weights.energy();
        let noise = m.tolerance(o.noise) * energy;
        let counts = (m.tolerance(o.negligible) * energy).below(self.before.get());
        let early = self.count.get().at_most(self.number(f64::from(o.damped)));
        let mut worse = self.made.get().is_set() & (above.clone() | (late & counts)) & noise.below(size) & early;
        if self.method.corners {
            worse = worse & !self.looked.get().is_set();
        }
        if self.method.doubts {
            // An update that is much smaller than the one before says more than a residual.
            let whole = self.halvings.get().equals(zero) & self.stretches.get().equals(zero);
            let doubted = size.is_finite() & worse.clone() & above & whole;
            m.only(doubted, || self.doubted.set(self.number(1.0)));
            worse = worse & !self.doubted.get().is_set();
        }
        m.when(!size.is_finite() | worse, || {
            m.when(self.may_halve(), || self.halve())?;
            m.when(!size.is_finite(), || {
                // Beside the start there may be no value on one side alone.
                let (nudges, most) = (self.nudges.get(), self.number(o.nudges.len() as f64));
                m.when(zero.below(nudges) & nudges.below(most), || {
                    self.nudge(nudges);
                    m.again()
                })?;
                self.finish(NO_CONVERGENCE)
            })
        })
    }

    /// Ends where what was to be the last update left next to nothing, or no more than rounding that was there before.
    fn look(&self, size: M::Number) -> Flow {
        let (m, o, zero) = (self.m, &self.method.options, self.number(0.0));
        let last = self.last.get();
        self.looked.set(last);
        self.last.set(zero);
        m.when(last.is_set(), || {
            let energy = self.weights.energy();
            let (least, most) = (m.tolerance(o.cleared.0) * energy, m.tolerance(o.cleared.1) * energy);
            let as_before = self.from.get().at_most(self.number(o.growth) * size);
            let clear = energy.equals(zero) | size.at_most(least) | (size.at_most(most) & as_before);
            m.when(clear, || self.finish(DONE))
        })
    }

    /// Ends after an update, or has what it leaves looked at.
    fn settle(&self) -> Flow {
        if !self.method.corners {
            return self.finish(DONE);
        }
        let (looks, limit) = (self.looks.get(), self.number(f64::from(self.method.limit)));
        let no_more = looks.equals(self.number(0.0)) | self.count.get().equals(limit);
        self.m.when(no_more, || self.finish(DONE))?;
        self.looks.set(looks - self.number(1.0));
        self.last.set(self.number(1.0));
        Ok(())
    }

    /// Ends where the residual is what rounding leaves.
    fn rest(&self) -> Flow {
        let rounding = self.method.options.rounding;
        let most = self.m.tolerance(rounding * rounding) * self.weights.energy();
        self.m.when(self.size.get().at_most(most), || {
            self.no_rounding();
            self.finish(DONE)
        })
    }

    /// Takes the solution off the unknowns, and tests; or finds another start, as where the matrix is not finite.
    fn advance(&self, residual: &M::Vector, solution: &M::Vector, finite: M::Condition) -> Flow {
        let (m, o, method) = (self.m, &self.method.options, self.method);
        let solved = self.row.get().below(self.number(0.0));
        self.weights.see(!self.made.get().is_set() & solved.clone(), solution, || {
            self.size.set(self.weights.square(|i| m.at(residual, i)));
            Ok(())
        })?;
        let square = self.weights.square(|i| m.at(solution, i));
        if method.doubts {
            let bound = self.number(o.closer) * self.before.get();
            let closer = solved.clone() & finite.clone() & square.at_most(bound);
            m.when(self.doubted.get().is_set(), || {
                m.when(!closer, || self.halve())?;
                self.best.set(self.size.get());
                Ok(())
            })?;
        }
        let (size, best) = (self.size.get(), self.best.get());
        self.best.set(m.select(size.below(best), size, best));
        self.from.set(size);
        // By an infinite slope the update is 0 whatever the residual.
        m.when(!(solved.clone() & square.is_finite() & finite), || {
            if !method.given {
                return self.rescue(solved);
            }
            m.when(self.may_halve(), || self.halve())?;
            self.finish(NO_CONVERGENCE)
        })?;
        let square = match method.knees.is_empty() {
            true => square,
            false => {
                method.knees.iter().for_each(|knee| self.limit(knee, solution));
                self.weights.square(|i| m.at(solution, i))
            }
        };
        let square = self.make(solution, square);
        if method.given {
            return self.is_linear_done(square);
        }
        self.test(square)?;
        self.after(square);
        self.hope();
        self.stretches.set(self.number(0.0));
        if method.undetermined {
            m.only(self.row.get().equals(self.number(UNDETERMINED)), || {
                self.undetermined.set(self.number(1.0));
                self.forget();
            });
        }
        Ok(())
    }

    /// Makes an update: half of it where it only takes back the one before. Gives the square of what is made.
    fn make(&self, solution: &M::Vector, square: M::Number) -> M::Number {
        let (m, zero, one) = (self.m, self.number(0.0), self.number(1.0));
        let sum = self.weights.square(|i| m.at(solution, i) + self.update(i));
        let bound = self.number(self.method.options.turned) * self.before.get();
        let plain = self.halvings.get().equals(zero) & self.stretches.get().equals(zero);
        let turned = self.made.get().is_set() & plain & sum.at_most(bound);
        let part = m.select(turned.clone(), self.number(0.5), one);
        m.each(self.method.n, |i| {
            let d = part * m.at(solution, i);
            self.put_update(i, d);
            self.take(i, d);
        });
        m.select(turned, self.number(0.25), one) * square
    }

    /// Notes an update that was made.
    fn after(&self, square: M::Number) {
        self.before.set(square);
        self.made.set(self.number(1.0));
        self.halvings.set(self.number(0.0));
    }

    /// Whether the update made last is at most a part of the unknowns.
    fn is_small(&self, part: M::Number) -> M::Condition {
        self.weights.is_small(&self.places.update, part, self.size.get())
    }

    /// Ends after an update that is small enough, or small and shrinks no more.
    fn test(&self, square: M::Number) -> Flow {
        let (m, o, zero) = (self.m, &self.method.options, self.number(0.0));
        let (last, made) = (self.before.get(), self.made.get().is_set());
        let quadratic = made.clone() & self.halvings.get().equals(zero);
        let quadratic = quadratic & square.at_most(self.number(o.quadratic) * last);
        let slow = made & (self.number(o.slow) * last).at_most(square);
        let (most, next) = (m.tolerance(o.last), m.tolerance(self.method.left) * (last / square));
        let t = m.select(next.below(most), next, most);
        let t = m.select(quadratic, t, m.tolerance(o.rounding));
        let t = m.select(slow.clone(), m.tolerance(o.stalled), t);
        m.when(self.is_small(t), || self.settle())?;
        let least = self.least.get();
        let stalls = (self.number(o.slow) * least).at_most(square);
        self.least.set(m.select(square.below(least), square, least));
        m.branch(
            stalls,
            || {
                let k = self.stalls.get() + self.number(1.0);
                self.stalls.set(k);
                let many = slow & self.number(f64::from(o.stalls)).at_most(k);
                m.when(many, || {
                    let tiny = self.is_small(m.tolerance(o.hardly_determined));
                    let near = self.is_small(m.tolerance(o.undetermined));
                    let energy = self.weights.energy();
                    let quiet = self.best.get().at_most(m.tolerance(o.quiet) * energy);
                    let mut stalled = tiny | (near & (energy.equals(zero) | quiet));
                    if self.method.corners {
                        stalled = stalled & !self.last.get().is_set();
                    }
                    m.when(stalled, || self.settle())
                })
            },
            || {
                self.stalls.set(zero);
                Ok(())
            },
        )
    }

    /// Makes an update of an unknown along an exponential of it.
    fn limit(&self, knee: &Knee, solution: &M::Vector) {
        let (m, o, i) = (self.m, &self.method.options, self.m.place(knee.unknown as usize));
        let (rate, zero, one) = (self.number(knee.rate), self.number(0.0), self.number(1.0));
        let before = rate * (self.unknown(i) - self.number(knee.knee));
        let change = -(rate * m.at(solution, i));
        let after = before + change;
        let make = |next: M::Number| m.put(solution, i, (before - next) / rate);
        let curved = || {
            let grown = one + change;
            let log = before + grown.unary(Unary::Log);
            let far = || {
                let (low, least) = (before.unary(Unary::Exp) * grown, self.number(-o.beyond_knee));
                make(m.select(least.below(low), low, least) - one);
            };
            either(m, zero.below(log), || make(log), far);
        };
        let straight = change.abs().at_most(self.number(o.straight));
        either(
            m,
            zero.below(before),
            || m.only(!straight, curved),
            || m.only(zero.below(after), || make((one + after).unary(Unary::Log))),
        );
    }

    /// The test of an iteration that converges linearly, after its update.
    fn is_linear_done(&self, square: M::Number) -> Flow {
        let (m, o) = (self.m, &self.method.options);
        let (last, made) = (self.before.get(), self.made.get().is_set());
        let slow = made.clone() & (self.number(o.slow) * last).at_most(square);
        let most = m.tolerance(o.linear);
        let t = m.tolerance(self.method.left) * ((last / square).unary(Unary::Sqrt) - self.number(1.0));
        let t = m.select(t.below(most), t, most);
        let t = m.select(slow, m.tolerance(o.stalled), t);
        let t = m.select(made, t, m.tolerance(o.rounding));
        m.when(self.is_small(t), || self.finish(DONE))?;
        self.after(square);
        Ok(())
    }

    /// Where the system cannot be solved: further along, back, or beside the start.
    fn rescue(&self, solved: M::Condition) -> Flow {
        let (m, o, n) = (self.m, &self.method.options, self.method.n);
        let (made, stretches, one) = (self.made.get(), self.stretches.get(), self.number(1.0));
        let limit = self.number(f64::from(o.stretches));
        if self.method.undetermined {
            m.when(self.undetermined.get().is_set() & !solved.clone(), || self.rest())?;
        }
        // On the flat part of a law, such as one that sticks: beyond it there may be a slope again.
        m.when(made.is_set() & !solved.clone() & stretches.below(limit), || {
            self.stretches.set(stretches + one);
            let early = stretches.below(self.number(f64::from(o.doublings)));
            let factor = m.select(early, self.number(2.0), self.number(o.stretch));
            m.each(n, |i| {
                let d = self.update(i) * factor;
                self.put_update(i, d);
                self.put(i, self.unknown(i) - d);
            });
            self.forget();
            m.again()
        })?;
        // There was none: back to where the flat part was met.
        m.only(stretches.equals(limit), || {
            self.stretches.set(stretches + one);
            let (part, whole) = o.stretched();
            m.each(n, |i| {
                let d = self.update(i);
                self.put(i, self.unknown(i) + d * self.number(part));
                self.put_update(i, d / self.number(whole));
            });
        });
        m.when(self.may_halve(), || self.halve())?;
        let nudges = self.nudges.get();
        // A law with an infinite slope just where the iteration starts, or none: start beside it.
        m.when(!made.is_set() & nudges.below(self.number(o.nudges.len() as f64)), || {
            self.nudge(nudges);
            self.forget();
            m.again()
        })?;
        m.only(solved, || self.row.set(self.number(0.0)));
        self.finish(SINGULAR)
    }

    /// Moves the start to the next place beside it.
    fn nudge(&self, nudges: M::Number) {
        let (m, zero, one) = (self.m, self.number(0.0), self.number(1.0));
        let (mut side, mut before) = (zero, 0.0);
        for (k, x) in self.method.options.nudges.iter().enumerate() {
            side = m.select(nudges.equals(self.number(k as f64)), self.number(x - before), side);
            before = *x;
        }
        self.nudges.set(nudges + one);
        m.each(self.method.n, |i| {
            let s = m.at(&self.places.scale, i);
            self.put(i, self.unknown(i) + side * m.select(zero.below(s), s, one));
        });
    }

    /// The place of the unknown whose change is largest beside itself, as a number, and the change.
    pub fn worst(&self) -> (M::Number, M::Number) {
        self.weights.worst(&self.places.update)
    }

    /// Adds the iterations to those done.
    pub fn counted(&self, equations: &mut impl Equations<M>) {
        equations.count(self.m, self.count.get());
    }
}

/// One of two things, neither of which leaves what is around it.
pub(super) fn either<M: Machine>(m: M, condition: M::Condition, yes: impl FnOnce(), no: impl FnOnce()) {
    // Such bodies have nothing to hand on.
    let _ = m.branch(
        condition,
        || {
            yes();
            Ok(())
        },
        || {
            no();
            Ok(())
        },
    );
}
