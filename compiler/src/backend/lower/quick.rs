//! How an iteration of few unknowns begins, as `bond_runtime::solve::quick` does it; its doc says what and why.

use super::Lower;
use super::newton::{DONE, Iteration};
use super::writer::{At, Values, Writer};
use crate::backend::code::{Cond, Stmt, Value, Var};
use bond_runtime::ir;
use bond_runtime::solve::quick::{ALIKE, GOOD, LAST, NEAR, NEXT, Pattern, RANGE, ROUNDING, SHARP, STALLED};

/// What is left of the beginning, where that is not all.
pub(super) struct Begun {
    /// Whether the iteration goes on, rather than begins anew.
    on: Var,
    /// Whether it begins anew where it fails.
    pub(super) again: Var,
    /// The update made last, and the residual before it.
    update: Vec<Var>,
    residual: Vec<Var>,
    /// Where it begins anew.
    start: Vec<Value>,
}

impl Begun {
    /// Brings the iteration to where it goes on.
    pub(super) fn go_on(&self, w: &mut Writer, it: &Iteration) {
        let on = w.get(self.on);
        w.branch(
            Cond::True(on),
            |w| {
                let update: Vec<Value> = self.update.iter().map(|v| w.get(*v)).collect();
                let residual: Vec<Value> = self.residual.iter().map(|v| w.get(*v)).collect();
                it.resume(w, &update, &residual);
            },
            |w| self.anew(w, it),
        );
    }

    /// Puts the unknowns where it begins anew.
    pub(super) fn anew(&self, w: &mut Writer, it: &Iteration) {
        it.put_all(w, &self.start);
    }
}

/// An eliminated matrix.
struct Eliminated<'a> {
    pattern: &'a Pattern,
    a: Vec<Value>,
    /// One over the determinant of two unknowns.
    inverse: Option<Value>,
}

impl<'a> Eliminated<'a> {
    fn new(w: &mut Writer, pattern: &'a Pattern, entries: &[(u32, u32, Value)]) -> Self {
        let n = pattern.size();
        let (zero, one) = (w.number(0.0), w.number(1.0));
        let mut a = vec![zero; n * n];
        for (i, j, v) in entries {
            a[*i as usize * n + *j as usize] = *v;
        }
        if n == 2 {
            let (p, q) = (w.mul(a[0], a[3]), w.mul(a[1], a[2]));
            let det = w.sub(p, q);
            let inverse = Some(w.div(one, det));
            return Self { pattern, a, inverse };
        }
        for k in 0..n {
            a[k * n + k] = w.div(one, a[k * n + k]);
            for i in (k + 1..n).filter(|i| pattern.has(*i, k)) {
                let l = w.mul(a[i * n + k], a[k * n + k]);
                a[i * n + k] = l;
                for j in (k + 1..n).filter(|j| pattern.has(k, *j)) {
                    let term = w.mul(l, a[k * n + j]);
                    a[i * n + j] = w.sub(a[i * n + j], term);
                }
            }
        }
        Self { pattern, a, inverse: None }
    }

    fn solve(&self, w: &mut Writer, right: &[Value]) -> Vec<Value> {
        let (n, a, mut x) = (self.pattern.size(), &self.a, right.to_vec());
        if let Some(inverse) = self.inverse {
            let (s, t) = (w.mul(x[0], a[3]), w.mul(a[1], x[1]));
            let p = w.sub(s, t);
            let (s, t) = (w.mul(a[0], x[1]), w.mul(x[0], a[2]));
            let q = w.sub(s, t);
            return vec![w.mul(p, inverse), w.mul(q, inverse)];
        }
        for k in 0..n {
            for i in (k + 1..n).filter(|i| self.pattern.has(*i, k)) {
                let term = w.mul(a[i * n + k], x[k]);
                x[i] = w.sub(x[i], term);
            }
        }
        for k in (0..n).rev() {
            let mut rest = x[k];
            for j in (k + 1..n).filter(|j| self.pattern.has(k, *j)) {
                let term = w.mul(a[k * n + j], x[j]);
                rest = w.sub(rest, term);
            }
            x[k] = w.mul(rest, a[k * n + k]);
        }
        x
    }
}

/// `Σ |v_i| / z_i`, of the magnitudes.
fn part(w: &mut Writer, v: &[Value], z: &[Value]) -> Value {
    let zero = w.number(0.0);
    v.iter().zip(z).fold(zero, |sum, (v, z)| {
        let term = w.div(*v, *z);
        w.add(sum, term)
    })
}

/// For each of some magnitudes, whether it is at most this part of a size.
fn at_most(w: &mut Writer, list: &[Value], part: Value, sizes: &[Value]) -> Vec<Cond> {
    let pairs = list.iter().zip(sizes);
    pairs
        .map(|(x, size)| {
            let most = w.mul(part, *size);
            w.le(*x, most)
        })
        .collect()
}

/// Whether an update of these magnitudes and what rounding leaves of the unknowns come up to a residual.
fn explained(w: &mut Writer, entries: &[(u32, u32, Value)], residual: &[Value], update: &[Value], z: &[Value]) -> Cond {
    let n = residual.len();
    if n == 1 {
        return w.finite(entries[0].2);
    }
    let (rounding, two, zero) = (w.tolerance(ROUNDING), w.number(2.0), w.number(0.0));
    let reach: Vec<Value> = (0..n)
        .map(|i| {
            let rest = w.mul(rounding, z[i]);
            w.add(update[i], rest)
        })
        .collect();
    let mut told = vec![zero; n];
    for (i, j, a) in entries {
        let a = w.abs(*a);
        let term = w.mul(a, reach[*j as usize]);
        told[*i as usize] = w.add(told[*i as usize], term);
    }
    let mut all = Vec::new();
    for (r, told) in residual.iter().zip(told) {
        if n > 2 {
            all.push(w.finite(told));
        }
        let (r, most) = (w.abs(*r), w.mul(two, told));
        all.push(w.le(r, most));
    }
    Cond::all(all)
}

/// Whether a second update of an unknown is its last, after the first and beside its size, of which a part may be left.
fn is_last(w: &mut Writer, first: Value, second: Value, z: Value, left: f64) -> Cond {
    let (rounding, last, next) = (w.tolerance(ROUNDING), w.tolerance(LAST), w.number(NEXT));
    let left = w.tolerance(left);
    let (allowed, left) = (w.mul(rounding, z), w.mul(left, z));
    let times = w.mul(next, second);
    let (square, most, largest) = (w.mul(times, second), w.mul(left, first), w.mul(last, z));
    let near = Cond::all([w.le(square, most), w.le(second, largest)]);
    Cond::any([w.le(second, allowed), near])
}

/// The second update of one equation by the slope there, as the residuals tell it; and two over the first one.
fn sharpened(w: &mut Writer, first: Value, second: Value) -> (Value, Value) {
    let (two, sharp) = (w.number(2.0), w.number(SHARP));
    let twice = w.div(two, first);
    let square = w.mul(second, second);
    let more = w.mul(square, twice);
    let (size, most) = (w.abs(second), w.abs(first));
    let most = w.mul(sharp, most);
    let small = w.le(size, most);
    let sum = w.add(second, more);
    (w.select(small, sum, second), twice)
}

/// Whether it is the last one; `twice` is two over the first, and the others are magnitudes.
fn is_last_alone(w: &mut Writer, (first, twice): (Value, Value), second: Value, z: Value, left: f64) -> Cond {
    let (rounding, last, left) = (w.tolerance(ROUNDING), w.tolerance(LAST), w.tolerance(left));
    let (two, next, sharp) = (w.number(2.0), w.number(NEXT / 4.0), w.number(SHARP));
    let twice = w.abs(twice);
    let (part, reach) = (w.mul(second, twice), w.div(first, z));
    let reach = w.mul(two, reach);
    let sum = w.add(part, reach);
    let more = w.mul(second, part);
    let more = w.mul(more, sum);
    let next = w.mul(more, next);
    let (allowed, left) = (w.mul(rounding, z), w.mul(left, z));
    let (most, largest) = (w.mul(sharp, first), w.mul(last, z));
    let near = Cond::all([w.le(next, left), w.le(second, most), w.le(second, largest)]);
    Cond::any([w.le(second, allowed), near])
}

impl Lower {
    /// Begins an iteration.
    pub(super) fn begin(&mut self, newton: &ir::Newton, pattern: &Pattern, it: &Iteration) -> Begun {
        let n = pattern.size();
        let foretold = !newton.cold.is_empty();
        let w = &mut self.w;
        let start = match foretold {
            true => newton.cold.iter().map(|v| self.values[v.0 as usize].unwrap_or(Value(0))).collect(),
            false => it.get_all(w),
        };
        let (on, again) = (w.starting(0.0), w.starting(0.0));
        let vars = |w: &mut Writer| -> Vec<Var> { (0..n).map(|_| w.var()).collect() };
        let begun = Begun { on, again, update: vars(w), residual: vars(w), start };
        let one = w.number(1.0);
        it.started(w);
        let keep = |w: &mut Writer, update: &[Value], residual: &[Value]| {
            begun.update.iter().zip(update).for_each(|(v, x)| w.set(*v, *x));
            begun.residual.iter().zip(residual).for_each(|(v, x)| w.set(*v, *x));
            w.set(begun.on, one);
        };
        let body = self.inside(|this| {
            let (residual, entries) = this.coarse(newton);
            let w = &mut this.w;
            let matrix = Eliminated::new(w, pattern, &entries);
            let update = matrix.solve(w, &residual);
            let before = it.get_all(w);
            let next: Vec<Value> = before.iter().zip(&update).map(|(u, d)| w.sub(*u, *d)).collect();
            it.take(w, (&before, &update, &next));
            let z: Vec<Value> = (0..n)
                .map(|i| {
                    let (u, s) = (w.abs(next[i]), it.scale(w, At::One(i)));
                    w.add(u, s)
                })
                .collect();
            let range = w.number(RANGE);
            let within = Cond::all(z.iter().map(|z| w.le(*z, range)).collect::<Vec<_>>());
            w.when(within.not(), |w| w.push(Stmt::Break));
            let first: Vec<Value> = update.iter().map(|d| w.abs(*d)).collect();
            let rounding = w.tolerance(ROUNDING);
            if newton.small.is_empty() {
                let small = at_most(w, &first, rounding, &z);
                w.when(Cond::all(small), |w| {
                    let explained = explained(w, &entries, &residual, &first, &z);
                    w.branch(explained, |w| it.finish(w, DONE), |w| w.push(Stmt::Break));
                });
            }
            let (left, there) = this.equations(newton);
            let w = &mut this.w;
            let more = matrix.solve(w, &left);
            let second: Vec<Value> = more.iter().map(|d| w.abs(*d)).collect();
            let nearest = w.number(NEAR);
            let near = Cond::all(at_most(w, &first, nearest, &z));
            let sizes: Vec<Value> = next.iter().map(|u| w.abs(*u)).collect();
            let unseen = at_most(w, &second, rounding, &sizes);
            let done = |w: &mut Writer, second: &[Value], last: Option<(&[Value], &[Value], &[Value])>| {
                let explained = explained(w, &entries, &left, second, &z);
                w.branch(
                    explained,
                    |w| {
                        match last {
                            Some(last) => it.take(w, last),
                            None => it.leave(w, &more),
                        }
                        it.finish(w, DONE);
                    },
                    |w| w.push(Stmt::Break),
                );
            };
            w.when(Cond::all(unseen.into_iter().chain([near.clone()])), |w| done(w, &second, None));
            let mut after: Vec<Value> = next.iter().zip(&more).map(|(u, d)| w.sub(*u, *d)).collect();
            let small: Vec<Cond> = (0..n).map(|i| is_last(w, first[i], second[i], z[i], newton.left)).collect();
            w.when(Cond::all(small.into_iter().chain([near.clone()])), |w| {
                done(w, &second, Some((&next, &more, &after)));
            });
            let (mut more, mut second) = (more.clone(), second.clone());
            let twice = (n == 1).then(|| {
                let (sharp, twice) = sharpened(w, update[0], more[0]);
                (more[0], second[0], after[0]) = (sharp, w.abs(sharp), w.sub(next[0], sharp));
                twice
            });
            let last = (&next[..], &more[..], &after[..]);
            let rounded = Cond::all(at_most(w, &second, rounding, &z));
            w.when(Cond::all([near.clone().not(), rounded]), |w| {
                let alike = w.number(ALIKE);
                let changes = there.iter().zip(&entries).map(|((_, _, a), (_, _, b))| {
                    let (off, size) = (w.sub(*a, *b), w.abs(*b));
                    (w.abs(off), size)
                });
                let (off, sizes): (Vec<Value>, Vec<Value>) = changes.unzip();
                let settled = at_most(w, &off, alike, &sizes);
                w.when(Cond::all(settled), |w| done(w, &second, Some(last)));
            });
            if let Some(twice) = twice {
                let small = is_last_alone(w, (first[0], twice), second[0], z[0], newton.left);
                w.when(Cond::all([small, near]), |w| done(w, &second, Some(last)));
            }
            let (first, second) = (part(w, &first, &z), part(w, &second, &z));
            let finite = w.finite(first);
            w.when(finite.not(), |w| w.push(Stmt::Break));
            let good = w.number(GOOD);
            let most = w.mul(good, first);
            let rounding = w.tolerance(STALLED);
            let good = Cond::any([w.le(second, most), w.le(second, rounding)]);
            w.branch(
                good,
                |w| {
                    it.take(w, last);
                    keep(w, &more, &left);
                    w.set(begun.again, one);
                },
                |w| {
                    if !foretold && newton.bends.is_empty() {
                        keep(w, &update, &residual);
                    }
                },
            );
            w.push(Stmt::Break);
        });
        self.w.push(Stmt::Loop(body));
        begun
    }

    /// The same for a first update, without what is next to nothing.
    fn coarse(&mut self, newton: &ir::Newton) -> (Vec<Value>, Vec<(u32, u32, Value)>) {
        let nothing = self.w.number(-0.0);
        let kept: Vec<_> = newton.small.iter().map(|v| self.values[v.0 as usize].replace(nothing)).collect();
        let equations = self.equations(newton);
        newton.small.iter().zip(kept).for_each(|(v, x)| self.values[v.0 as usize] = x);
        equations
    }

    /// The residual and the entries of the matrix, at the unknowns as they are.
    fn equations(&mut self, newton: &ir::Newton) -> (Vec<Value>, Vec<(u32, u32, Value)>) {
        self.block(&newton.body);
        let residual = self.all(&newton.residual);
        let entries = newton.jacobian.iter().map(|(r, c, v)| (*r, *c, self.of(*v))).collect();
        (residual, entries)
    }
}

impl Iteration {
    fn get_all(&self, w: &mut Writer) -> Vec<Value> {
        (0..self.n).map(|i| w.at(&self.unknowns, At::One(i))).collect()
    }

    /// Takes an update off the unknowns: what they were, the update, and what they are then.
    fn take(&self, w: &mut Writer, (before, update, after): (&[Value], &[Value], &[Value])) {
        let all = before.iter().zip(update).zip(after).enumerate();
        all.for_each(|(i, ((u, d), v))| self.put(w, At::One(i), (*u, *d, *v)));
    }

    fn put_all(&self, w: &mut Writer, list: &[Value]) {
        list.iter().enumerate().for_each(|(i, x)| w.put(&self.unknowns, At::One(i), *x));
    }

    /// Where one iteration is done already, and nothing decided.
    pub(super) fn started(&self, w: &mut Writer) {
        let (zero, one) = (w.number(0.0), w.number(1.0));
        w.set(self.count, one);
        w.set(self.end, zero);
    }

    fn scale(&self, w: &mut Writer, at: At) -> Value {
        w.value(&self.scale, at)
    }

    /// Takes an update as made, from where the residual was this.
    fn resume(&self, w: &mut Writer, update: &[Value], residual: &[Value]) {
        let one = w.number(1.0);
        update.iter().enumerate().for_each(|(i, d)| w.put(&self.update, At::One(i), *d));
        let residual = Values::List(residual.to_vec());
        let (before, best) =
            (self.square(w, |w, at| w.at(&self.update, at)), self.square(w, |w, at| w.value(&residual, at)));
        w.set(self.before, before);
        w.set(self.least, before);
        w.set(self.best, best);
        w.set(self.made, one);
    }
}
