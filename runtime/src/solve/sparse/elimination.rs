//! [`super::Numeric`] for every machine: the same operations in the same order, as loops over tables.

use super::line::{DOWN, Factors, UP};
use super::numeric::{RAISED, STEPS, SUSPICIOUS, TINY};
use super::{Pattern, Run, Symbolic};
use crate::machine::{Bound, Flow, Machine, Number, Variable};
use crate::solve::iteration::{SOLVED, either};

/// A number, real or complex.
#[derive(Clone, Copy)]
struct Scalar<N> {
    re: N,
    im: Option<N>,
}

impl<N: Number> Scalar<N> {
    fn with(self, other: Self, f: impl Fn(N, N) -> N) -> Self {
        Self { re: f(self.re, other.re), im: self.im.zip(other.im).map(|(x, y)| f(x, y)) }
    }

    fn times(self, x: Self) -> Self {
        match self.im.zip(x.im) {
            Some((im, x_im)) => Self { re: self.re * x.re - im * x_im, im: Some(self.re * x_im + im * x.re) },
            None => Self { re: self.re * x.re, im: None },
        }
    }

    fn by(self, x: N) -> Self {
        Self { re: self.re * x, im: self.im.map(|im| im * x) }
    }

    /// `self - a x`
    fn less(self, a: Self, x: Self) -> Self {
        self.with(a.times(x), |x, y| x - y)
    }

    fn size(self) -> N {
        self.im.map_or(self.re.abs(), |im| self.re.abs() + im.abs())
    }

    fn inverse(self, one: N) -> Self {
        match self.im {
            Some(im) => {
                let one = one / (self.re * self.re + im * im);
                Self { re: self.re * one, im: Some(-(im * one)) }
            }
            None => Self { re: one / self.re, im: None },
        }
    }
}

/// Some numbers, real or complex.
struct Numbers<M: Machine> {
    re: M::Vector,
    im: Option<M::Vector>,
}

impl<M: Machine> Numbers<M> {
    /// Those of a list in which the parts of each stand side by side.
    fn side_by_side(m: M, list: &M::Vector, is_complex: bool) -> Self {
        Self { re: list.clone(), im: is_complex.then(|| m.tail(list, 1)) }
    }

    fn room(n: usize, is_complex: bool, room: &mut impl FnMut(usize) -> M::Vector) -> Self {
        Self { re: room(n), im: is_complex.then(|| room(n)) }
    }

    fn tail(&self, m: M, from: usize) -> Self {
        Self { re: m.tail(&self.re, from), im: self.im.as_ref().map(|im| m.tail(im, from)) }
    }

    fn at(&self, m: M, i: M::Index) -> Scalar<M::Number> {
        Scalar { re: m.at(&self.re, i), im: self.im.as_ref().map(|im| m.at(im, i)) }
    }

    fn put(&self, m: M, i: M::Index, x: Scalar<M::Number>) {
        m.put(&self.re, i, x.re);
        if let Some((im, x)) = self.im.as_ref().zip(x.im) {
            m.put(im, i, x);
        }
    }
}

/// A number that changes.
struct Changing<M: Machine> {
    re: M::Variable,
    im: Option<M::Variable>,
}

impl<M: Machine> Changing<M> {
    fn holding(m: M, x: Scalar<M::Number>) -> Self {
        Self { re: m.holding(x.re), im: x.im.map(|im| m.holding(im)) }
    }

    fn get(&self) -> Scalar<M::Number> {
        Scalar { re: self.re.get(), im: self.im.as_ref().map(Variable::get) }
    }

    fn set(&self, x: Scalar<M::Number>) {
        self.re.set(x.re);
        if let Some((var, im)) = self.im.as_ref().zip(x.im) {
            var.set(im);
        }
    }
}

/// A [`Pattern`] as tables.
struct Triangle<M: Machine> {
    starts: M::Table,
    columns: M::Table,
}

impl<M: Machine> Triangle<M> {
    fn new(pattern: &Pattern, table: &mut impl FnMut(Vec<u32>) -> M::Table) -> Self {
        let starts = table(pattern.starts.iter().map(|x| *x as u32).collect());
        Self { starts, columns: table(pattern.columns.clone()) }
    }

    fn row(&self, m: M, i: M::Index) -> (Bound<M>, Bound<M>) {
        row(m, self.starts, i)
    }
}

/// The entries of a row, by where rows begin.
fn row<M: Machine>(m: M, starts: M::Table, i: M::Index) -> (Bound<M>, Bound<M>) {
    (Bound::Table(starts, i), Bound::Table(m.rest(starts, 1), i))
}

/// What the elimination of a pattern reads and writes.
pub struct Elimination<'s, M: Machine> {
    m: M,
    symbolic: &'s Symbolic,
    is_complex: bool,
    /// By step, the places of its row and of its column in a vector.
    row: M::Table,
    column: M::Table,
    /// Entries of the matrix by step of their row: where they begin, their place, and the step and the place of their
    /// column.
    starts: M::Table,
    entry: M::Table,
    step: M::Table,
    place: M::Table,
    lower: Triangle<M>,
    upper: Triangle<M>,
    /// By entry of the lower factor, where the row of its column begins and ends in the upper one.
    upper_from: M::Table,
    upper_to: M::Table,
    line: Option<Line<M>>,
    l: Numbers<M>,
    u: Numbers<M>,
    inverse: Numbers<M>,
    row_scale: M::Vector,
    column_scale: M::Vector,
    work: Numbers<M>,
    right: M::Vector,
    rest: M::Vector,
    /// The largest multiplier; below 0 where there are no factors.
    growth: M::Vector,
}

/// What is known of a [`super::Line`] besides.
struct Line<M: Machine> {
    /// Lower factor, upper one, inverse pivots and a 0, one after the other.
    factors: M::Vector,
    /// Which of them are packed.
    which: M::Table,
    packed: M::Vector,
    /// By pair, the first of the four unknowns of the right end.
    right: M::Table,
}

/// How an elimination goes.
struct Attempt<'e, M: Machine> {
    /// What the row without a pivot is told to.
    row: &'e M::Variable,
    /// Pivots are raised to this.
    floor: Option<M::Number>,
}

impl<'s, M: Machine> Elimination<'s, M> {
    /// With memory and tables by these.
    pub fn new(
        m: M,
        (symbolic, is_complex): (&'s Symbolic, bool),
        room: &mut impl FnMut(usize) -> M::Vector,
        table: &mut impl FnMut(Vec<u32>) -> M::Table,
    ) -> Self {
        let (s, n, parts) = (symbolic, symbolic.n, if is_complex { 2 } else { 1 });
        let places = |list: &[u32]| list.iter().map(|i| i * parts).collect::<Vec<u32>>();
        let (lower, upper) = (s.lower.columns.len(), s.upper.columns.len());
        let factors = Numbers::<M>::room(lower + upper + n + 1, is_complex, room);
        let ends = |past: usize| {
            let end = |k: &u32| s.upper.starts[*k as usize + past] as u32;
            s.lower.columns.iter().map(end).collect::<Vec<u32>>()
        };
        let line = s.line.map(|line| {
            // Numbers that say where they are, packed.
            let number = |from: usize, count: usize| (from..from + count).map(|i| i as f64 + 1.0).collect::<Vec<f64>>();
            let inverse = number(lower + upper, n);
            let (l, u) = (number(0, lower), number(lower, upper));
            let mut packed = vec![[0.0; 2]; line.packed()];
            let (l, u) = ((&l[..], &s.lower), (&u[..], &s.upper));
            line.pack(Factors { order: &s.column, lower: l, upper: u, inverse: &inverse }, &mut packed);
            let zero = (lower + upper + n) as u32;
            let which = packed.iter().flatten().map(|x| if *x > 0.0 { *x as u32 - 1 } else { zero }).collect();
            let right = (0..line.pairs()).map(|pair| 4 * (line.inner() - 1 - pair) as u32).collect();
            let packed = room(2 * line.packed());
            Line { factors: factors.re.clone(), which: table(which), packed, right: table(right) }
        });
        Self {
            m,
            symbolic,
            is_complex,
            row: table(places(&s.row)),
            column: table(places(&s.column)),
            starts: table(s.starts.clone()),
            entry: table(s.entries.iter().map(|e| e.0 * parts).collect()),
            step: table(s.entries.iter().map(|e| e.1).collect()),
            place: table(s.entries.iter().map(|e| s.column[e.1 as usize] * parts).collect()),
            lower: Triangle::new(&s.lower, table),
            upper: Triangle::new(&s.upper, table),
            upper_from: table(ends(0)),
            upper_to: table(ends(1)),
            line,
            l: factors.tail(m, 0),
            u: factors.tail(m, lower),
            inverse: factors.tail(m, lower + upper),
            row_scale: room(n),
            column_scale: room(n),
            work: Numbers::room(n, is_complex, room),
            right: room(parts as usize * n),
            rest: room(parts as usize * n),
            growth: room(1),
        }
    }

    /// Solves with these entries of the matrix, in the order of the pattern: `vector` becomes the solution. Where
    /// `same` holds, the entries are those of the last solution. `row` becomes -1, or a step without a pivot. Where a
    /// pivot is bad, `again` solves, if there is such a thing; else pivots are raised.
    pub fn solve(
        &self,
        (values, vector): (&M::Vector, &M::Vector),
        row: &M::Variable,
        same: Option<M::Condition>,
        again: Option<impl FnOnce()>,
    ) {
        let (m, zero) = (self.m, self.m.number(0.0));
        row.set(m.number(SOLVED));
        let values = Numbers::side_by_side(m, values, self.is_complex);
        let kept = same.map_or(m.known(false), |same| same & zero.at_most(self.growth()));
        // Pivots are raised to this, once they are.
        let floor = again.is_none().then(|| m.holding(zero));
        // Nothing in it fails.
        let _ = m.when(!kept, || {
            m.repeat(|| {
                self.factor(&values, &Attempt { row, floor: floor.as_ref().map(Variable::get) });
                if let Some(floor) = &floor {
                    m.when(self.growth().below(zero) & floor.get().equals(zero), || {
                        floor.set(m.tolerance(RAISED));
                        row.set(m.number(SOLVED));
                        m.again()
                    })?;
                }
                m.leave()
            })
        });
        either(
            m,
            self.growth().below(zero),
            || again.into_iter().for_each(|again| again()),
            || self.find(&values, vector, row, floor.map_or(m.known(false), |floor| floor.get().is_set())),
        );
    }

    /// The largest multiplier, below 0 where there are no factors.
    fn growth(&self) -> M::Number {
        self.m.at(&self.growth, self.m.place(0))
    }

    /// Solves with the factors, and refines: once where they are not plainly stable, until no more is left than of
    /// rounding where pivots were `raised`, as [`super::Numeric::solve_raised`] does.
    fn find(&self, values: &Numbers<M>, b: &M::Vector, row: &M::Variable, raised: M::Condition) {
        let (m, zero, one) = (self.m, self.m.number(0.0), self.m.number(1.0));
        let looks = m.number(SUSPICIOUS).below(self.growth()) | raised.clone();
        // The next solution is not with factors of raised pivots.
        m.only(raised.clone(), || m.put(&self.growth, m.place(0), m.number(-1.0)));
        m.only(looks.clone(), || self.copy(b, &self.right));
        let [steps, change, worst, part] = [0.0; 4].map(|x| m.holding(m.number(x)));
        // Nothing in it fails.
        let _ = m.repeat(|| {
            self.substitute(b);
            m.when(!looks.clone(), || m.leave())?;
            let (is_first, next) = (steps.get().equals(zero), self.change(b));
            m.when(!is_first.clone(), || {
                // What was found is a correction.
                self.each_number(|i| m.put(b, i, m.at(&self.rest, i) + m.at(b, i)));
                m.when(!raised.clone(), || m.leave())?;
                let (good, before) = (part.get().at_most(m.tolerance(1e-12)), change.get());
                m.when(good.clone() & next.at_most(m.number(1e-8) * before), || m.leave())?;
                // Corrections that don't shrink have come down to rounding, or the matrix is singular.
                m.when(!next.equals(next) | (m.number(0.5) * before).below(next), || {
                    m.only(!good, || row.set(worst.get()));
                    m.leave()
                })
            })?;
            change.set(next);
            self.leave(values, b, (&worst, &part));
            m.when(raised.clone(), || {
                let last = steps.get().equals(m.number(STEPS as f64));
                let good = part.get().at_most(m.tolerance(1e-12));
                m.when(part.get().at_most(m.tolerance(1e-15)) | (last.clone() & good), || m.leave())?;
                m.when(last, || {
                    row.set(worst.get());
                    m.leave()
                })
            })?;
            self.each_number(|i| {
                let x = m.at(b, i);
                m.put(b, i, m.at(&self.rest, i));
                m.put(&self.rest, i, x);
            });
            steps.set(steps.get() + one);
            Ok(())
        });
    }

    /// Goes through the numbers of a vector.
    fn each_number(&self, body: impl FnMut(M::Index)) {
        let n = self.symbolic.n * if self.is_complex { 2 } else { 1 };
        self.m.over(Bound::Known(0), Bound::Known(n), body);
    }

    fn copy(&self, from: &M::Vector, to: &M::Vector) {
        self.each_number(|i| self.m.put(to, i, self.m.at(from, i)));
    }

    fn all(&self, body: impl FnMut(M::Index)) {
        self.m.over(Bound::Known(0), Bound::Known(self.symbolic.n), body);
    }

    /// Goes through the entries of the matrix in the row of a step: their numbers, and themselves.
    fn entries(&self, values: &Numbers<M>, i: M::Index, mut body: impl FnMut(M::Index, Scalar<M::Number>)) {
        let (from, to) = row(self.m, self.starts, i);
        self.m.over(from, to, |e| body(e, values.at(self.m, self.m.through(self.entry, e))));
    }

    /// Scales such that the largest entry of each row, then of each column, is near 1.
    fn scale(&self, values: &Numbers<M>) {
        let (m, zero) = (self.m, self.m.number(0.0));
        self.all(|i| m.put(&self.column_scale, i, zero));
        self.all(|i| {
            let most = m.holding(zero);
            self.entries(values, i, |_, x| {
                let (before, size) = (most.get(), x.size());
                most.set(m.select(before.below(size), size, before));
            });
            let scale = m.inverse_scale(most.get());
            m.put(&self.row_scale, i, scale);
            self.entries(values, i, |e, x| {
                let (k, size) = (m.through(self.step, e), x.by(scale).size());
                let before = m.at(&self.column_scale, k);
                m.put(&self.column_scale, k, m.select(before.below(size), size, before));
            });
        });
        self.all(|i| m.put(&self.column_scale, i, m.inverse_scale(m.at(&self.column_scale, i))));
    }

    /// Factors the scaled matrix.
    fn factor(&self, values: &Numbers<M>, how: &Attempt<'_, M>) {
        let (m, zero, one) = (self.m, self.m.number(0.0), self.m.place(0));
        self.scale(values);
        let none = Scalar { re: zero, im: self.is_complex.then_some(zero) };
        let (growth, most) = (m.holding(zero), m.number(1.0) / m.tolerance(TINY));
        m.put(&self.growth, one, m.number(-1.0));
        self.all(|i| self.work.put(m, i, none));
        // Nothing in it fails.
        let _ = m.repeat(|| {
            m.span(Bound::Known(0), Bound::Known(self.symbolic.n), |i| {
                let scale = m.at(&self.row_scale, i);
                self.entries(values, i, |e, x| {
                    let k = m.through(self.step, e);
                    self.work.put(m, k, x.by(scale).by(m.at(&self.column_scale, k)));
                });
                let own = self.work.at(m, i).size();
                let (from, to) = self.lower.row(m, i);
                m.span(from, to, |e| self.take_row(e, (&growth, most), how))?;
                self.pivot(i, own, how)?;
                let (from, to) = self.upper.row(m, i);
                m.over(from, to, |e| {
                    let j = m.through(self.upper.columns, e);
                    self.u.put(m, e, self.work.at(m, j));
                    self.work.put(m, j, none);
                });
                Ok(())
            })?;
            self.unscale();
            m.put(&self.growth, one, growth.get());
            m.leave()
        });
    }

    /// Takes the row of an entry of the lower factor off what is in `work`.
    fn take_row(&self, e: M::Index, (growth, most): (&M::Variable, M::Number), how: &Attempt<'_, M>) -> Flow {
        let (m, zero) = (self.m, self.m.number(0.0));
        let k = m.through(self.lower.columns, e);
        let multiplier = self.work.at(m, k).times(self.inverse.at(m, k));
        self.work.put(m, k, Scalar { re: zero, im: self.is_complex.then_some(zero) });
        self.l.put(m, e, multiplier);
        m.when(!self.is_zero(multiplier), || {
            let size = multiplier.size();
            m.when(growth.get().below(size), || {
                growth.set(size);
                m.when(most.below(size), || self.fail(e, how))
            })?;
            m.over(Bound::Table(self.upper_from, e), Bound::Table(self.upper_to, e), |q| {
                let j = m.through(self.upper.columns, q);
                self.work.put(m, j, self.work.at(m, j).less(multiplier, self.u.at(m, q)));
            });
            Ok(())
        })
    }

    /// Makes what is in `work` the pivot of a step.
    fn pivot(&self, i: M::Index, own: M::Number, how: &Attempt<'_, M>) -> Flow {
        let (m, zero) = (self.m, self.m.number(0.0));
        let mut pivot = self.work.at(m, i);
        if let Some(floor) = how.floor {
            let small = pivot.size().below(floor);
            let negative = (m.number(1.0) / pivot.re).below(zero);
            let raised = m.select(negative, -floor, floor);
            pivot.re = m.select(small.clone(), raised, pivot.re);
            pivot.im = pivot.im.map(|im| m.select(small, zero, im));
        }
        let (inverse, size) = (pivot.inverse(m.number(1.0)), pivot.size());
        let bad = !inverse.size().is_finite() | !size.is_finite() | size.below(m.tolerance(1e-15) * own);
        m.when(bad, || self.fail(i, how))?;
        self.inverse.put(m, i, inverse);
        self.work.put(m, i, Scalar { re: zero, im: self.is_complex.then_some(zero) });
        Ok(())
    }

    /// Ends without factors.
    fn fail(&self, step: M::Index, how: &Attempt<'_, M>) -> Flow {
        how.row.set(self.m.counted(step));
        self.m.leave()
    }

    fn is_zero(&self, x: Scalar<M::Number>) -> M::Condition {
        let zero = self.m.number(0.0);
        let real = x.re.equals(zero);
        x.im.map_or(real.clone(), |im| real & im.equals(zero))
    }

    /// Divides rows by their pivots, and takes the scales into the factors.
    fn unscale(&self) {
        let m = self.m;
        self.all(|i| {
            let scale = [&self.row_scale, &self.column_scale].map(|list| m.at(list, i));
            let inverse = self.inverse.at(m, i);
            let (from, to) = self.lower.row(m, i);
            m.over(from, to, |e| {
                let x = self.l.at(m, e);
                m.only(!self.is_zero(x), || {
                    let ratio = m.at(&self.row_scale, m.through(self.lower.columns, e)) / scale[0];
                    self.l.put(m, e, x.by(ratio));
                });
            });
            let (from, to) = self.upper.row(m, i);
            m.over(from, to, |e| {
                let x = self.u.at(m, e);
                m.only(!self.is_zero(x), || {
                    let ratio = scale[1] / m.at(&self.column_scale, m.through(self.upper.columns, e));
                    self.u.put(m, e, x.times(inverse).by(ratio));
                });
            });
            self.inverse.put(m, i, inverse.by(scale[0]).by(scale[1]));
        });
        if let (Some(line), Some(of)) = (&self.line, self.symbolic.line) {
            let (l, u) = (self.symbolic.lower.columns.len(), self.symbolic.upper.columns.len());
            m.put(&line.factors, m.place(l + u + self.symbolic.n), m.number(0.0));
            m.over(Bound::Known(0), Bound::Known(2 * of.packed()), |i| {
                m.put(&line.packed, i, m.at(&line.factors, m.through(line.which, i)));
            });
        }
    }

    /// `rest` becomes what `x` leaves of the right side. Tells the step where most is left, beside its terms, and how
    /// much.
    fn leave(&self, values: &Numbers<M>, x: &M::Vector, (worst, most): (&M::Variable, &M::Variable)) {
        let (m, zero) = (self.m, self.m.number(0.0));
        let [x, right, rest] =
            [x, &self.right, &self.rest].map(|list| Numbers::<M>::side_by_side(m, list, self.is_complex));
        [worst, most].into_iter().for_each(|x| x.set(zero));
        self.all(|i| {
            let at = m.through(self.row, i);
            let start = right.at(m, at);
            let (sum, size) = (Changing::<M>::holding(m, start), m.holding(start.size()));
            self.entries(values, i, |e, a| {
                let x = x.at(m, m.through(self.place, e));
                sum.set(sum.get().less(a, x));
                size.set(size.get() + a.times(x).size());
            });
            let (left, size) = (sum.get(), size.get());
            rest.put(m, at, left);
            let part = m.select(zero.below(size), left.size() / size, zero);
            let none = !part.equals(part);
            m.only(most.get().below(part) | none.clone(), || {
                worst.set(m.counted(i));
                most.set(m.select(none, m.number(f64::INFINITY), part));
            });
        });
    }

    /// The largest magnitude in a solution, scaled; NaN where there is one.
    fn change(&self, x: &M::Vector) -> M::Number {
        let m = self.m;
        let x = Numbers::<M>::side_by_side(m, x, self.is_complex);
        let most = m.holding(m.number(0.0));
        self.all(|i| {
            let size = x.at(m, m.through(self.column, i)).size() / m.at(&self.column_scale, i);
            m.only(most.get().below(size) | !size.equals(size), || most.set(size));
        });
        most.get()
    }

    /// A right side becomes the solution.
    fn substitute(&self, b: &M::Vector) {
        if let (Some(line), Some(of)) = (&self.line, self.symbolic.line) {
            return self.along(line, of, b);
        }
        let b = Numbers::side_by_side(self.m, b, self.is_complex);
        self.symbolic.lower.runs.iter().for_each(|run| self.forward(*run, &b));
        self.symbolic.upper.runs.iter().rev().for_each(|run| self.backward(*run, &b));
    }

    /// Goes down a stretch of rows.
    fn forward(&self, run: Run, b: &Numbers<M>) {
        let (m, from, to, far) = (self.m, run.from as usize, run.to as usize, run.distance as usize);
        let right = |i: M::Index| b.at(m, m.through(m.rest(self.row, from), i));
        let (l, work) = (self.l.tail(m, self.symbolic.lower.starts[from]), self.work.tail(m, from));
        let end = Bound::Known(to - from);
        if far == 0 {
            return m.over(Bound::Known(0), end, |i| {
                let sum = Changing::<M>::holding(m, right(i));
                let (first, last) = row(m, m.rest(self.lower.starts, from), i);
                m.over(first, last, |e| {
                    let x = self.work.at(m, m.through(self.lower.columns, e));
                    sum.set(sum.get().less(self.l.at(m, e), x));
                });
                work.put(m, i, sum.get());
            });
        }
        let before = self.work.tail(m, from - far);
        let window = self.window(far, |k| before.at(m, m.place(k)));
        m.over(Bound::Known(0), end, |i| {
            let last = window.first().map_or_else(|| before.at(m, i), Changing::get);
            let x = right(i).less(l.at(m, i), last);
            shift(&window, x);
            work.put(m, i, x);
        });
    }

    /// Goes up a stretch of rows.
    fn backward(&self, run: Run, b: &Numbers<M>) {
        let (m, from, to, far) = (self.m, run.from as usize, run.to as usize, run.distance as usize);
        let (u, work) = (self.u.tail(m, self.symbolic.upper.starts[from]), self.work.tail(m, from));
        let (inverse, column) = (self.inverse.tail(m, from), m.rest(self.column, from));
        let put = |i: M::Index, x: Scalar<M::Number>| {
            work.put(m, i, x);
            b.put(m, m.through(column, i), x);
        };
        let after = self.work.tail(m, (from + far).min(self.symbolic.n));
        let window =
            if far == 0 { Vec::new() } else { self.window(far, |k| self.work.at(m, m.place(to + far - 1 - k))) };
        // Nothing in it leaves.
        let _ = m.span_back(Bound::Known(0), Bound::Known(to - from), |i| {
            let start = work.at(m, i).times(inverse.at(m, i));
            if far == 0 {
                let sum = Changing::<M>::holding(m, start);
                let (first, last) = row(m, m.rest(self.upper.starts, from), i);
                m.over(first, last, |e| {
                    let x = self.work.at(m, m.through(self.upper.columns, e));
                    sum.set(sum.get().less(self.u.at(m, e), x));
                });
                put(i, sum.get());
                return Ok(());
            }
            let last = window.first().map_or_else(|| after.at(m, i), Changing::get);
            let x = start.less(u.at(m, i), last);
            shift(&window, x);
            put(i, x);
            Ok(())
        });
    }

    /// Variables for the last numbers of a chain, so that the next one does not wait for memory; none of a wide one.
    fn window(&self, far: usize, at: impl Fn(usize) -> Scalar<M::Number>) -> Vec<Changing<M>> {
        let far = if far > 2 { 0 } else { far };
        (0..far).map(|k| Changing::holding(self.m, at(k))).collect()
    }

    /// A right side of a line becomes the solution: [`super::Line::substitute`].
    fn along(&self, line: &Line<M>, of: super::Line, b: &M::Vector) {
        let (m, n, pairs, s) = (self.m, self.symbolic.n, of.pairs(), self.symbolic);
        let get = |i: usize| if i < n { m.at(b, m.place(i)) } else { m.number(0.0) };
        let take = |sum: M::Number, (values, pattern): (&M::Vector, &Pattern), step: usize| {
            let entry = |e: usize| (m.at(values, m.place(e)), get(s.column[pattern.columns[e] as usize] as usize));
            pattern.row(step).fold(sum, |sum, e| {
                let (a, x) = entry(e);
                sum - a * x
            })
        };
        let less = |i: usize| m.put(b, m.place(i), take(get(i), (&self.l.re, &s.lower), of.step(i)));
        let find = |i: usize| {
            let own = get(i) * m.at(&self.inverse.re, m.place(of.step(i)));
            m.put(b, m.place(i), take(own, (&self.u.re, &s.upper), of.step(i)));
        };
        let (down, between, up, end) = of.middle_orders();
        less(1);
        if end + 1 < n {
            less(end + 1);
        }
        let two = |x: [usize; 2]| x.map(|i| m.holding(get(i)));
        let (old_outer, old_middle) = (two([2, end]), two([1, end + 1]));
        let chain = [0, 0].map(|_| m.holding(m.number(0.0)));
        let (left, up_factors) = (m.tail(b, 3), m.tail(&line.packed, 2 * DOWN * pairs));
        let cell = |j: M::Index, side: usize, i: usize| match side {
            0 => (left.clone(), m.cell(j, 4, m.place(i))),
            _ => (m.tail(b, 3 - i), m.through(line.right, j)),
        };
        let factor = |list: &M::Vector, count: usize, j: M::Index, i: usize, side: usize| {
            m.at(list, m.cell(j, 2 * count, m.place(2 * i + side)))
        };
        m.over(Bound::Known(0), Bound::Known(pairs), |j| {
            let results = [0, 1].map(|side| {
                let (get, l) = (read(m, j, side, &cell), |i: usize| factor(&line.packed, DOWN, j, i, side));
                let (outer, new_outer) = (get(1), get(3));
                let middle = get(2) - l(0) * outer - l(1) * new_outer;
                let sum = get(0) - l(2) * old_outer[side].get() - l(3) * outer;
                let sum = sum - l(4) * old_middle[side].get() - l(5) * middle;
                (sum - l(6) * chain[side].get(), new_outer, middle)
            });
            for (side, (x, outer, middle)) in results.into_iter().enumerate() {
                chain[side].set(x);
                old_outer[side].set(outer);
                old_middle[side].set(middle);
                for (i, x) in [(0, x), (2, middle)] {
                    let (list, at) = cell(j, side, i);
                    m.put(&list, at, x);
                }
            }
        });
        down.iter().for_each(|i| less(between + i));
        up.iter().for_each(|i| find(between + i));
        chain.iter().zip([between, end - between + 2]).for_each(|(chain, i)| chain.set(get(i)));
        // Nothing in it leaves.
        let _ = m.span_back(Bound::Known(0), Bound::Known(pairs), |j| {
            let results = [0, 1].map(|side| {
                let (get, u) = (read(m, j, side, &cell), |i: usize| factor(&up_factors, UP, j, i, side));
                let last = chain[side].get();
                let inner = get(0) * u(0) - u(1) * last;
                let middle = get(2) * u(2) - u(3) * last - u(4) * inner;
                let far = get(1) * u(5) - u(6) * inner - u(7) * middle;
                [inner, far, middle, get(3) * u(8) - u(9) * last - u(10) * middle]
            });
            for (side, results) in results.into_iter().enumerate() {
                chain[side].set(results[0]);
                for (i, x) in results.into_iter().enumerate() {
                    let (list, at) = cell(j, side, i);
                    m.put(&list, at, x);
                }
            }
            Ok(())
        });
        [1, 0, 2, end + 1, end, end + 2].into_iter().filter(|i| *i < n).for_each(find);
    }
}

/// What reads the unknowns of a cell of a line.
fn read<M: Machine>(
    m: M,
    j: M::Index,
    side: usize,
    cell: &impl Fn(M::Index, usize, usize) -> (M::Vector, M::Index),
) -> impl Fn(usize) -> M::Number {
    move |i| {
        let (list, at) = cell(j, side, i);
        m.at(&list, at)
    }
}

/// Takes the first of the last numbers out, and one more in.
fn shift<M: Machine>(window: &[Changing<M>], x: Scalar<M::Number>) {
    for (k, var) in window.iter().enumerate() {
        var.set(window.get(k + 1).map_or(x, Changing::get));
    }
}
