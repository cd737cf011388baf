//! Newton's method as `bond_runtime::solve::newton` does it, step by step; its doc says what and why.

use super::eliminate::LEFT_OPEN;
use super::writer::{At, ELIMINATED, UNROLLED, Values, Vector, Writer, scratch};
use super::{Local, Lower};
use crate::backend::code::{Cond, Reason, Stmt, Value, Var};
use bond_runtime::ir::{self, Array, Bend, Slot};
use bond_runtime::solve::linear::Matrix;
use bond_runtime::solve::newton::{
    CLOSER, DAMPED, FALL, FAR, GRACE, HALVINGS, LOOKS, NUDGES, PATIENT, STALLS, STRAIGHT, STRETCH, STRETCHES, TELLING,
    doubts, stretched,
};
use bond_runtime::solve::quick::{LAST, Pattern};

/// How an iteration ended.
pub(super) const DONE: f64 = 1.0;
const NO_CONVERGENCE: f64 = 2.0;
const SINGULAR: f64 = 3.0;

/// An iteration on its way.
pub(super) struct Iteration {
    pub(super) n: usize,
    pub(super) unknowns: Vector,
    /// What rounding took from them in the update made last, where that is asked for.
    rests: Option<Vector>,
    /// Where the solution of a large system is.
    trial: u32,
    /// Iterations so far.
    pub(super) count: Var,
    pub(super) update: Vector,
    raw_weight: Values,
    weight: Vector,
    /// The same where all of them are numbers that count.
    plain: Option<Vec<Value>>,
    /// 1 where there is a weight at all.
    weighted: Option<Var>,
    /// 1 where an unknown has neither a weight nor a scale, and what one without a weight counts for at its scale.
    blind: Var,
    share: Var,
    pub(super) scale: Values,
    /// `|r|²`: of the last residual, and the least.
    size: Var,
    pub(super) best: Var,
    /// Whether the update made last waits for the next one to be judged.
    doubted: Var,
    /// `|r|²` before the update made last, and the part of it that is allowed.
    from: Var,
    reach: Var,
    /// Whether an update was made, and its square.
    pub(super) made: Var,
    pub(super) before: Var,
    halvings: Var,
    stretches: Var,
    nudges: Var,
    /// Updates in a row that were not much smaller than the smallest before, and `|d|²` of that.
    stalls: Var,
    pub(super) least: Var,
    /// Whether an update left something open.
    opened: Var,
    /// Whether the update made last was to be the last, whether it has just been looked at, and how often it may be.
    last: Var,
    looked: Var,
    looks: Var,
    pub(super) end: Var,
    row: Var,
    bends: Vec<Bend>,
    /// Whether the update is given, and whether the first one is all.
    given: bool,
    affine: bool,
    /// Whether unknowns may be left open.
    open: bool,
    /// Whether what the last update leaves is looked at.
    corners: bool,
    /// Iterations at most.
    limit: u32,
    /// Whether an update may be judged by the next one.
    doubts: bool,
    /// The part of the unknowns that may be left.
    left: f64,
}

/// Whether a weight counts.
fn counts(w: &mut Writer, x: Value) -> Cond {
    let zero = w.number(0.0);
    Cond::all([w.lt(zero, x), w.finite(x)])
}

/// What an iteration works on.
pub(super) struct Numbers {
    pub(super) unknowns: Vector,
    pub(super) rests: Option<Vector>,
    pub(super) weight: Values,
    pub(super) scale: Values,
}

impl Lower {
    pub(super) fn newton(&mut self, newton: &ir::Newton) {
        let n = newton.residual.len();
        let places = |first: u32| match &self.local {
            Local::Vars(vars) => Vector::Vars(vars[first as usize..first as usize + n].to_vec()),
            Local::Memory(base) => Vector::Memory(base + first),
        };
        let (unknowns, rests) = (places(newton.unknowns), newton.rests.map(places));
        let (raw, scale) = (self.all(&newton.weight), self.all(&newton.scale));
        let numbers = if newton.affine {
            Numbers { unknowns, rests, weight: Values::List(Vec::new()), scale: Values::List(Vec::new()) }
        } else {
            Numbers { unknowns, rests, weight: self.w.values(raw), scale: self.w.values(scale) }
        };
        let mut it = Iteration::new(&mut self.w, newton, numbers);
        it.no_rests(&mut self.w);
        match Pattern::of(newton) {
            Some(pattern) => {
                let begun = self.begin(newton, &pattern, &it);
                let rest = self.inside(|this| {
                    it.prepare(&mut this.w);
                    it.started(&mut this.w);
                    begun.go_on(&mut this.w, &it);
                    let body = this.body(newton, &it);
                    it.twice(&mut this.w, body, |w| w.get(begun.again), |w| begun.anew(w, &it));
                });
                let (end, done) = (self.w.get(it.end), self.w.number(DONE));
                let done = self.w.eq(end, done);
                self.w.push(Stmt::If(done.not(), rest, Vec::new()));
            }
            None => {
                it.prepare(&mut self.w);
                let body = self.body(newton, &it);
                if newton.cold.is_empty() {
                    self.w.push(Stmt::Loop(body));
                } else {
                    let (start, again) = (self.all(&newton.cold), self.w.starting(1.0));
                    let start = self.w.values(start);
                    it.twice(&mut self.w, body, |w| w.get(again), |w| it.put_values(w, &start));
                }
            }
        }
        let flag = newton.flag;
        let mut flagged = None;
        it.end(&mut self.w, newton, |_, x| flagged = Some(x));
        if let (Some(flag), Some(x)) = (flag, flagged) {
            self.write(flag, None, x);
        }
    }

    /// Linear equations.
    pub(super) fn linear(&mut self, solve: &ir::Solve) {
        let right = self.all(&solve.right);
        let matrix: Vec<ir::Value> = solve.values().collect();
        let matrix = self.all(&matrix);
        let (w, numbers) = (&mut self.w, right.len());
        let row = w.var();
        let solution = if numbers > ELIMINATED || solve.is_complex() {
            let (entries, vector) = (w.room(matrix.len()), w.room(numbers));
            let all = matrix.iter().enumerate().map(|(i, v)| (entries, i, v));
            for (base, i, v) in all.chain(right.iter().enumerate().map(|(i, v)| (vector, i, v))) {
                w.push(Stmt::Store(scratch(base, At::One(i)), *v));
            }
            solved_for(w, solve, (entries, vector), row, None);
            Vector::Memory(vector)
        } else {
            let entries: Vec<(u32, u32, Value)> =
                solve.matrix.iter().zip(matrix).map(|(&(i, j, _), v)| (i, j, v)).collect();
            w.eliminate(numbers, &entries, &right, (row, false))
        };
        for i in 0..numbers {
            let x = self.w.at(&solution, At::One(i));
            self.write(Slot { array: Array::Local, index: solve.unknowns + i as u32 }, None, x);
        }
        let good = ended(&mut self.w, solve, row);
        if let (Some(flag), Some(good)) = (solve.flag, good) {
            self.write(flag, None, good);
        }
    }

    /// One iteration.
    fn body(&mut self, newton: &ir::Newton, it: &Iteration) -> Vec<Stmt> {
        let n = newton.residual.len();
        let matrix = if n > ELIMINATED { self.w.room(newton.jacobian.len()) } else { 0 };
        self.inside(|this| {
            it.count_up(&mut this.w, newton.limit);
            this.block(&newton.body);
            let residual = this.all(&newton.residual);
            let entries: Vec<(u32, u32, Value)> =
                newton.jacobian.iter().map(|(r, c, v)| (*r, *c, this.of(*v))).collect();
            let update = this.all(&newton.update);
            let w = &mut this.w;
            let residual = w.values(residual);
            if !newton.update.is_empty() {
                it.judge(w, &residual);
                let solution = match n > UNROLLED {
                    true => {
                        for (i, v) in update.into_iter().enumerate() {
                            w.push(Stmt::Store(scratch(it.trial, At::One(i)), v));
                        }
                        Vector::Memory(it.trial)
                    }
                    false => Vector::Vars(update.into_iter().map(|v| w.holding(v)).collect()),
                };
                it.advance(w, &residual, &solution, Cond::all([]));
            } else if n > ELIMINATED {
                for (i, (_, _, v)) in entries.iter().enumerate() {
                    w.push(Stmt::Store(scratch(matrix, At::One(i)), *v));
                }
                it.large(w, newton, &residual, matrix);
            } else {
                if !newton.affine {
                    it.judge(w, &residual);
                }
                let r: Vec<Value> = (0..n).map(|i| w.value(&residual, At::One(i))).collect();
                let solution = w.eliminate(n, &entries, &r, (it.row, it.open));
                if newton.affine {
                    it.once(w, &solution);
                } else {
                    let told: Vec<Cond> = entries.iter().map(|(_, _, x)| w.finite(*x)).collect();
                    it.advance(w, &residual, &solution, Cond::all(told));
                }
            }
        })
    }
}

/// Solves linear equations with these places of the matrix and of the right side.
pub(super) fn solved_for(
    w: &mut Writer,
    solve: &ir::Solve,
    (matrix, vector): (u32, u32),
    row: Var,
    same: Option<Value>,
) {
    let system = w.system(solve.size(), solve.pattern(), solve.of());
    w.push(Stmt::Solve { system, matrix, vector, row, same });
}

/// Fails where linear equations were not solved, or says whether they were, where they have a flag.
pub(super) fn ended(w: &mut Writer, solve: &ir::Solve, row: Var) -> Option<Value> {
    let (row, zero, one) = (w.get(row), w.number(0.0), w.number(1.0));
    let solved = w.lt(row, zero);
    if solve.flag.is_some() {
        return Some(w.select(solved, one, zero));
    }
    w.push(Stmt::Count(one));
    w.when(solved.not(), |w| w.push(Stmt::Fail(Reason::Singular(row))));
    None
}

/// What comes before the loop.
pub(super) fn begin(w: &mut Writer, newton: &ir::Newton, numbers: Numbers) -> Iteration {
    let mut it = Iteration::new(w, newton, numbers);
    it.no_rests(w);
    it.prepare(w);
    it
}

impl Iteration {
    fn new(w: &mut Writer, newton: &ir::Newton, numbers: Numbers) -> Self {
        let (n, affine) = (newton.residual.len(), newton.affine);
        let Numbers { unknowns, rests, weight, scale } = numbers;
        let plain = match &weight {
            Values::List(list) if list.iter().all(|x| w.is_positive(*x)) => Some(list.clone()),
            Values::List(_) | Values::Memory(_) => None,
        };
        let trial = if n > ELIMINATED { w.room(n) } else { 0 };
        Self {
            n,
            unknowns,
            rests,
            trial,
            update: if affine { Vector::Vars(Vec::new()) } else { w.vector(n) },
            weight: if affine { Vector::Vars(Vec::new()) } else { w.vector(n) },
            raw_weight: weight,
            plain,
            weighted: None,
            blind: w.var(),
            share: w.var(),
            scale,
            count: w.var(),
            size: w.var(),
            best: w.var(),
            doubted: w.var(),
            from: w.var(),
            reach: w.var(),
            made: w.var(),
            before: w.var(),
            halvings: w.var(),
            stretches: w.var(),
            nudges: w.var(),
            stalls: w.var(),
            least: w.var(),
            opened: w.var(),
            last: w.var(),
            looked: w.var(),
            looks: w.var(),
            end: w.var(),
            row: w.var(),
            bends: newton.bends.clone(),
            given: !newton.update.is_empty(),
            affine,
            open: newton.open,
            corners: newton.corners,
            limit: newton.limit,
            doubts: doubts(newton),
            left: newton.left,
        }
    }

    /// Makes the measures.
    fn prepare(&mut self, w: &mut Writer) {
        self.reset(w);
        if self.plain.is_none() && !self.affine {
            self.weigh(w);
        }
    }

    /// Where no iteration was done.
    fn reset(&self, w: &mut Writer) {
        let (zero, infinite, none) = (w.number(0.0), w.number(f64::INFINITY), w.number(-1.0));
        let clear =
            [self.count, self.made, self.before, self.halvings, self.stretches, self.nudges, self.stalls, self.end];
        clear.into_iter().for_each(|v| w.set(v, zero));
        if self.open {
            w.set(self.opened, zero);
        }
        if self.corners {
            let looks = w.number(f64::from(LOOKS));
            w.set(self.looks, looks);
            w.set(self.last, zero);
        }
        w.set(self.best, infinite);
        w.set(self.from, infinite);
        w.set(self.least, infinite);
        self.hope(w);
        w.set(self.row, none);
        if !self.affine {
            w.each(self.n, |w, at| w.put(&self.update, at, zero));
        }
    }

    /// Iterates, and where that fails once more, if `again` says so, after `anew`.
    fn twice(
        &self,
        w: &mut Writer,
        body: Vec<Stmt>,
        again: impl FnOnce(&mut Writer) -> Value,
        anew: impl FnOnce(&mut Writer),
    ) {
        let over = w.starting(0.0);
        w.repeat(|w| {
            w.push(Stmt::Loop(body));
            let (end, done, one) = (w.get(self.end), w.number(DONE), w.number(1.0));
            let (again, over_now) = (again(w), w.get(over));
            let enough = Cond::any([w.eq(end, done), Cond::True(again).not(), Cond::True(over_now)]);
            w.when(enough, |w| w.push(Stmt::Break));
            w.set(over, one);
            let k = w.get(self.count);
            w.push(Stmt::Count(k));
            self.reset(w);
            anew(w);
        });
    }

    fn no_rests(&self, w: &mut Writer) {
        let Some(rests) = &self.rests else { return };
        let zero = w.number(0.0);
        w.each(self.n, |w, at| w.put(rests, at, zero));
    }

    /// Leaves an update to the rests, where the unknowns do not show it: the residual that it is had from has seen what
    /// rounding took in the update before.
    pub(super) fn leave(&self, w: &mut Writer, update: &[Value]) {
        let Some(rests) = &self.rests else { return };
        for (i, d) in update.iter().enumerate() {
            let rest = w.unary(ir::Unary::Neg, *d);
            w.put(rests, At::One(i), rest);
        }
    }

    /// Takes an update off an unknown: what it was, the update, and what it is then.
    pub(super) fn put(&self, w: &mut Writer, at: At, (before, d, after): (Value, Value, Value)) {
        if let Some(rests) = &self.rests {
            let made = w.sub(before, after);
            let rest = w.sub(made, d);
            w.put(rests, at, rest);
        }
        w.put(&self.unknowns, at, after);
    }

    fn put_values(&self, w: &mut Writer, list: &Values) {
        w.each(self.n, |w, at| {
            let x = w.value(list, at);
            w.put(&self.unknowns, at, x);
        });
    }

    /// Begins an iteration, or ends them.
    pub(super) fn count_up(&self, w: &mut Writer, limit: u32) {
        let (k, limit, one) = (w.get(self.count), w.number(f64::from(limit)), w.number(1.0));
        let more = w.lt(k, limit);
        w.when(more.not(), |w| self.finish(w, NO_CONVERGENCE));
        let k = w.add(k, one);
        w.set(self.count, k);
    }

    /// An iteration on unknowns that are not written out, after its residual and the entries of its matrix.
    pub(super) fn large(&self, w: &mut Writer, newton: &ir::Newton, residual: &Values, matrix: u32) {
        if !newton.affine {
            self.judge(w, residual);
        }
        w.each(self.n, |w, at| {
            let r = w.value(residual, at);
            w.push(Stmt::Store(scratch(self.trial, at), r));
        });
        let told = match newton.affine {
            true => Cond::all([]),
            false => w.holds(newton.jacobian.len(), |w, at| {
                let x = w.load(scratch(matrix, at));
                w.finite(x)
            }),
        };
        let pattern = newton.jacobian.iter().map(|e| (e.0, e.1)).collect();
        let matrices = if self.open { Matrix::Open } else { Matrix::Changing };
        let system = w.system(self.n, pattern, matrices);
        w.push(Stmt::Solve { system, matrix, vector: self.trial, row: self.row, same: None });
        let solution = Vector::Memory(self.trial);
        if !newton.affine {
            return self.advance(w, residual, &solution, told);
        }
        self.once(w, &solution);
    }

    /// Takes the solution off the unknowns, which is all where the equations are affine.
    fn once(&self, w: &mut Writer, solution: &Vector) {
        let (row, zero) = (w.get(self.row), w.number(0.0));
        let solved = w.lt(row, zero);
        w.when(solved.not(), |w| self.finish(w, SINGULAR));
        w.each(self.n, |w, at| {
            let (d, u) = (w.at(solution, at), w.at(&self.unknowns, at));
            let u = w.sub(u, d);
            w.put(&self.unknowns, at, u);
        });
        self.finish(w, DONE);
    }

    /// What comes after the loop; `flag` is told whether it went well, where the iteration has one.
    pub(super) fn end(&self, w: &mut Writer, newton: &ir::Newton, flag: impl FnOnce(&mut Writer, Value)) {
        if !(newton.affine && newton.flag.is_some()) {
            let k = w.get(self.count);
            w.push(Stmt::Count(k));
        }
        let (end, done) = (w.get(self.end), w.number(DONE));
        let good = w.eq(end, done);
        if newton.flag.is_some() {
            let (one, zero) = (w.number(1.0), w.number(0.0));
            let x = w.select(good, one, zero);
            return flag(w, x);
        }
        w.when(good.not(), |w| {
            let singular = w.number(SINGULAR);
            let is = w.eq(end, singular);
            let first = w.number(f64::from(newton.unknowns));
            if newton.affine {
                let row = w.get(self.row);
                return w.push(Stmt::Fail(Reason::Singular(row)));
            }
            w.when(is, |w| {
                let row = w.get(self.row);
                w.push(Stmt::Fail(Reason::Singular(row)));
            });
            let (worst, change) = self.worst(w);
            let worst = w.add(first, worst);
            w.push(Stmt::Fail(Reason::NoConvergence(newton.limit, worst, change)));
        });
    }

    /// The weights: those that count; for the others the mean share.
    fn weigh(&mut self, w: &mut Writer) {
        let weighted = w.starting(1.0);
        self.weighted = Some(weighted);
        let zero = w.number(0.0);
        w.set(self.blind, zero);
        w.set(self.share, zero);
        w.each(self.n, |w, at| {
            let x = w.value(&self.raw_weight, at);
            w.put(&self.weight, at, x);
        });
        let all = w.holds(self.n, |w, at| {
            let x = w.value(&self.raw_weight, at);
            counts(w, x)
        });
        w.when(all.not(), |w| {
            let (zero, one) = (w.number(0.0), w.number(1.0));
            let count = w.fold(self.n, zero, |w, at, sum| {
                let x = w.value(&self.raw_weight, at);
                let c = counts(w, x);
                let term = w.select(c, one, zero);
                w.add(sum, term)
            });
            let total = w.fold(self.n, zero, |w, at, sum| {
                let (x, s) = (w.value(&self.raw_weight, at), w.value(&self.scale, at));
                let c = counts(w, x);
                let xs = w.mul(x, s);
                let xss = w.mul(xs, s);
                let term = w.select(c, xss, zero);
                w.add(sum, term)
            });
            let share = w.div(total, count);
            w.set(self.share, share);
            let none = w.eq(count, zero);
            w.when(none.clone(), |w| w.set(weighted, zero));
            w.each(self.n, |w, at| {
                let x = self.known(w, at);
                let good = counts(w, x);
                let x = w.select(good, x, zero);
                let x = w.select(none.clone(), one, x);
                w.put(&self.weight, at, x);
            });
            let all = w.holds(self.n, |w, at| {
                let x = self.known(w, at);
                counts(w, x)
            });
            let blind = Cond::all([all.not(), none.not()]);
            w.when(blind, |w| w.set(self.blind, one));
        });
    }

    /// A weight by its own number or by the scale; what need not count.
    fn known(&self, w: &mut Writer, at: At) -> Value {
        let (x, s) = (w.value(&self.raw_weight, at), w.value(&self.scale, at));
        let (share, ss) = (w.get(self.share), w.mul(s, s));
        let part = w.div(share, ss);
        let good = counts(w, x);
        w.select(good, x, part)
    }

    /// Takes an update for the scale of what has none.
    fn see(&self, w: &mut Writer, update: &Vector) {
        w.each(self.n, |w, at| {
            let (known, d, share, zero) = (self.known(w, at), w.at(update, at), w.get(self.share), w.number(0.0));
            let dd = w.mul(d, d);
            let part = w.div(share, dd);
            let good = counts(w, part);
            let part = w.select(good, part, zero);
            let good = counts(w, known);
            let x = w.select(good, known, part);
            w.put(&self.weight, at, x);
        });
    }

    /// Whether an unknown has neither a weight nor a scale.
    fn is_blind(&self, w: &mut Writer) -> Cond {
        match &self.plain {
            Some(_) => Cond::any([]),
            None => Cond::True(w.get(self.blind)),
        }
    }

    fn weight(&self, w: &mut Writer, at: At) -> Value {
        match (&self.plain, at) {
            (Some(list), At::One(i)) => list[i],
            (Some(_), At::Each(_)) | (None, _) => w.at(&self.weight, at),
        }
    }

    /// `Σ w v²`
    pub(super) fn square(&self, w: &mut Writer, mut v: impl FnMut(&mut Writer, At) -> Value) -> Value {
        let zero = w.number(0.0);
        w.fold(self.n, zero, |w, at, sum| {
            let (k, x) = (self.weight(w, at), v(w, at));
            let kx = w.mul(k, x);
            let term = w.mul(kx, x);
            w.add(sum, term)
        })
    }

    /// `Σ w (u² + s²)`; 0 without weights.
    fn energy(&self, w: &mut Writer) -> Value {
        let zero = w.number(0.0);
        let sum = w.fold(self.n, zero, |w, at, sum| {
            let (k, u, s) = (self.weight(w, at), w.at(&self.unknowns, at), w.value(&self.scale, at));
            let (uu, ss) = (w.mul(u, u), w.mul(s, s));
            let uu = match &self.plain {
                Some(_) => uu,
                None => {
                    let raw = w.value(&self.raw_weight, at);
                    let own = counts(w, raw);
                    w.select(own, uu, zero)
                }
            };
            let both = w.add(uu, ss);
            let term = w.mul(k, both);
            w.add(sum, term)
        });
        match self.weighted {
            Some(v) => {
                let v = w.get(v);
                w.select(Cond::True(v), sum, zero)
            }
            None => sum,
        }
    }

    pub(super) fn finish(&self, w: &mut Writer, how: f64) {
        let how = w.number(how);
        w.set(self.end, how);
        w.push(Stmt::Break);
    }

    /// Whether one more halving is allowed.
    fn may_halve(&self, w: &mut Writer) -> Cond {
        let (made, halvings, most) = (w.get(self.made), w.get(self.halvings), w.number(f64::from(HALVINGS)));
        Cond::all([Cond::True(made), w.lt(halvings, most)])
    }

    /// What a whole update has to come to.
    fn hope(&self, w: &mut Writer) {
        let reach = w.number(1.0 - FALL);
        w.set(self.reach, reach);
    }

    /// Takes back half of the update, and begins anew.
    fn halve(&self, w: &mut Writer) {
        let half = w.number(0.5);
        let reach = w.get(self.reach);
        let part = w.mul(half, reach);
        let reach = w.add(part, half);
        w.set(self.reach, reach);
        w.each(self.n, |w, at| {
            let d = w.at(&self.update, at);
            let d = w.mul(d, half);
            w.put(&self.update, at, d);
            let u = w.at(&self.unknowns, at);
            let u = w.add(u, d);
            w.put(&self.unknowns, at, u);
        });
        let (k, one) = (w.get(self.halvings), w.number(1.0));
        let k = w.add(k, one);
        w.set(self.halvings, k);
        w.push(Stmt::Continue);
    }

    /// Looks at the residual: halves where it got worse, ends where it is 0.
    fn judge(&self, w: &mut Writer, residual: &Values) {
        let size = self.square(w, |w, at| w.value(residual, at));
        w.set(self.size, size);
        if self.corners {
            self.look(w, size);
        }
        let (best, four, zero) = (w.get(self.best), w.number(4.0), w.number(0.0));
        let allowed = w.mul(four, best);
        let (finite, above) = (w.finite(size), w.lt(allowed, size));
        w.set(self.doubted, zero);
        let late = match self.given {
            true => Cond::any([]),
            false => {
                let patient = w.number(f64::from(PATIENT));
                let so_far = w.get(self.count);
                let (from, reach) = (w.get(self.from), w.get(self.reach));
                let fallen = w.mul(reach, from);
                Cond::all([w.lt(patient, so_far), w.lt(fallen, size)])
            }
        };
        w.when(Cond::any([finite.clone().not(), above.clone(), late.clone()]), |w| {
            let made = w.get(self.made);
            let energy = self.energy(w);
            let part = w.tolerance(1e-26);
            let noise = w.mul(part, energy);
            let (part, last) = (w.tolerance(TELLING), w.get(self.before));
            let telling = w.mul(part, energy);
            let high = Cond::any([above.clone(), Cond::all([late, w.lt(telling, last)])]);
            let (so_far, damped) = (w.get(self.count), w.number(f64::from(DAMPED)));
            let mut worse = Cond::all([Cond::True(made), high, w.lt(noise, size), w.le(so_far, damped)]);
            if self.corners {
                let looked = w.get(self.looked);
                worse = Cond::all([worse, Cond::True(looked).not()]);
            }
            if self.doubts {
                let (halvings, stretches, one) = (w.get(self.halvings), w.get(self.stretches), w.number(1.0));
                let whole = Cond::all([w.eq(halvings, zero), w.eq(stretches, zero)]);
                let doubted = Cond::all([finite.clone(), worse.clone(), above, whole]);
                w.when(doubted, |w| w.set(self.doubted, one));
                let doubted = w.get(self.doubted);
                worse = Cond::all([worse, Cond::True(doubted).not()]);
            }
            w.when(Cond::any([finite.clone().not(), worse]), |w| {
                let may = self.may_halve(w);
                w.when(may, |w| self.halve(w));
                w.when(finite.not(), |w| {
                    let (nudges, zero, most) = (w.get(self.nudges), w.number(0.0), w.number(NUDGES.len() as f64));
                    let beside = Cond::all([w.lt(zero, nudges), w.lt(nudges, most)]);
                    w.when(beside, |w| {
                        self.nudge(w, nudges);
                        w.push(Stmt::Continue);
                    });
                    self.finish(w, NO_CONVERGENCE);
                });
            });
        });
        let none = w.le(size, zero);
        w.when(none, |w| {
            let all = w.holds(self.n, |w, at| {
                let r = w.value(residual, at);
                w.eq(r, zero)
            });
            w.when(all, |w| {
                self.no_rests(w);
                self.finish(w, DONE);
            });
        });
        let (so_far, long, longer) =
            (w.get(self.count), w.number(f64::from(DAMPED)), w.number(f64::from(DAMPED + GRACE)));
        let stalls = w.get(self.stalls);
        let last = Cond::any([w.lt(zero, stalls), w.lt(longer, so_far)]);
        let mut many = Cond::all([w.lt(long, so_far), last]);
        if self.open {
            let (opened, patient) = (w.get(self.opened), w.number(f64::from(PATIENT)));
            many = Cond::any([many, Cond::all([Cond::True(opened), w.lt(patient, so_far)])]);
        }
        w.when(many, |w| self.rest(w));
    }

    /// Ends where what was to be the last update left next to nothing.
    fn look(&self, w: &mut Writer, size: Value) {
        let (last, zero) = (w.get(self.last), w.number(0.0));
        w.set(self.looked, last);
        w.set(self.last, zero);
        w.when(Cond::True(last), |w| {
            let (energy, least, most) = (self.energy(w), w.tolerance(1e-28), w.tolerance(1e-24));
            let (least, most) = (w.mul(least, energy), w.mul(most, energy));
            let (from, four) = (w.get(self.from), w.number(4.0));
            let as_before = w.mul(four, size);
            let rounding = Cond::all([w.le(size, most), w.le(from, as_before)]);
            let clear = Cond::any([w.eq(energy, zero), w.le(size, least), rounding]);
            w.when(clear, |w| self.finish(w, DONE));
        });
    }

    /// Ends after an update, or has what it leaves looked at.
    fn settle(&self, w: &mut Writer) {
        if !self.corners {
            self.finish(w, DONE);
            return;
        }
        let (looks, so_far, zero, one) = (w.get(self.looks), w.get(self.count), w.number(0.0), w.number(1.0));
        let limit = w.number(f64::from(self.limit));
        let no_more = Cond::any([w.eq(looks, zero), w.eq(so_far, limit)]);
        w.when(no_more, |w| self.finish(w, DONE));
        let looks = w.sub(looks, one);
        w.set(self.looks, looks);
        w.set(self.last, one);
    }

    /// Ends where the residual is what rounding leaves.
    fn rest(&self, w: &mut Writer) {
        let (told, part, size) = (self.energy(w), w.tolerance(1e-32), w.get(self.size));
        let allowed = w.mul(part, told);
        let rounding = w.le(size, allowed);
        w.when(rounding, |w| {
            self.no_rests(w);
            self.finish(w, DONE);
        });
    }

    /// Takes the solution off the unknowns, and tests; or finds another start, as where the matrix is not finite (`told`).
    fn advance(&self, w: &mut Writer, residual: &Values, solution: &Vector, told: Cond) {
        let (row, zero, one) = (w.get(self.row), w.number(0.0), w.number(1.0));
        let solved = w.lt(row, zero);
        let (made, blind) = (w.get(self.made), self.is_blind(w));
        w.when(Cond::all([blind, Cond::True(made).not(), solved.clone()]), |w| {
            self.see(w, solution);
            let size = self.square(w, |w, at| w.value(residual, at));
            w.set(self.size, size);
        });
        let square = self.square(w, |w, at| w.at(solution, at));
        if self.doubts {
            let (doubted, last, part) = (w.get(self.doubted), w.get(self.before), w.number(CLOSER));
            let bound = w.mul(part, last);
            let closer = Cond::all([solved.clone(), told.clone(), w.le(square, bound)]);
            w.when(Cond::True(doubted), |w| {
                w.when(closer.not(), |w| self.halve(w));
                let size = w.get(self.size);
                w.set(self.best, size);
            });
        }
        let (size, best) = (w.get(self.size), w.get(self.best));
        let smaller = w.lt(size, best);
        let least = w.select(smaller, size, best);
        w.set(self.best, least);
        w.set(self.from, size);
        let sound = w.finite(square);
        w.when(Cond::all([solved.clone(), sound, told]).not(), |w| {
            if !self.given {
                return self.rescue(w, solved);
            }
            let may = self.may_halve(w);
            w.when(may, |w| self.halve(w));
            self.finish(w, NO_CONVERGENCE);
        });
        let square = if self.bends.is_empty() {
            square
        } else {
            self.bends.iter().for_each(|b| self.bend(w, b, solution));
            self.square(w, |w, at| w.at(solution, at))
        };
        let (made, last, halvings) = (w.get(self.made), w.get(self.before), w.get(self.halvings));
        let sum = self.square(w, |w, at| {
            let (d, e) = (w.at(solution, at), w.at(&self.update, at));
            w.add(d, e)
        });
        let (sixteenth, stretches) = (w.number(0.0625), w.get(self.stretches));
        let bound = w.mul(sixteenth, last);
        let turned = Cond::all([Cond::True(made), w.eq(halvings, zero), w.eq(stretches, zero), w.le(sum, bound)]);
        let (half, quarter) = (w.number(0.5), w.number(0.25));
        let (part, squared) = (w.select(turned.clone(), half, one), w.select(turned, quarter, one));
        let square = w.mul(squared, square);
        w.each(self.n, |w, at| {
            let (d, u) = (w.at(solution, at), w.at(&self.unknowns, at));
            let d = w.mul(part, d);
            w.put(&self.update, at, d);
            let after = w.sub(u, d);
            self.put(w, at, (u, d, after));
        });
        let (quick, slow) = (w.number(1e-6), w.number(0.25));
        let (quick, slow) = (w.mul(quick, last), w.mul(slow, last));
        let quick = Cond::all([Cond::True(made), w.eq(halvings, zero), w.le(square, quick)]);
        let slow = Cond::all([Cond::True(made), w.le(slow, square)]);
        let (least, most, stalled) = (w.tolerance(4e-16), w.tolerance(LAST), w.tolerance(1e-12));
        let allowed = w.tolerance(self.left);
        let ratio = w.div(last, square);
        if self.given {
            return self.geometric(w, square, ratio, slow);
        }
        let t = w.mul(allowed, ratio);
        let under = w.lt(t, most);
        let t = w.select(under, t, most);
        let t = w.select(quick, t, least);
        let t = w.select(slow.clone(), stalled, t);
        let small = self.small(w, t);
        w.when(small, |w| self.settle(w));
        let smallest = w.get(self.least);
        let part = w.number(0.25);
        let bound = w.mul(part, smallest);
        let stalls = w.le(bound, square);
        let smaller = w.lt(square, smallest);
        let smallest = w.select(smaller, square, smallest);
        w.set(self.least, smallest);
        w.branch(
            stalls,
            |w| {
                let k = w.get(self.stalls);
                let k = w.add(k, one);
                w.set(self.stalls, k);
                let most = w.number(f64::from(STALLS));
                let many = Cond::all([slow, w.le(most, k)]);
                w.when(many, |w| {
                    let (little, few, part) = (w.tolerance(1e-10), w.tolerance(1e-6), w.tolerance(1e-20));
                    let (tiny, near) = (self.small(w, little), self.small(w, few));
                    let (told, best) = (self.energy(w), w.get(self.best));
                    let allowed = w.mul(part, told);
                    let quiet = Cond::any([w.eq(told, zero), w.le(best, allowed)]);
                    let stalled = Cond::any([tiny, Cond::all([near, quiet])]);
                    let stalled = match self.corners {
                        true => Cond::all([stalled, Cond::True(w.get(self.last)).not()]),
                        false => stalled,
                    };
                    w.when(stalled, |w| self.settle(w));
                });
            },
            |w| w.set(self.stalls, zero),
        );
        w.set(self.before, square);
        w.set(self.made, one);
        w.set(self.halvings, zero);
        self.hope(w);
        w.set(self.stretches, zero);
        if self.open {
            let (row, left, infinite) = (w.get(self.row), w.number(LEFT_OPEN), w.number(f64::INFINITY));
            let some = w.eq(row, left);
            w.when(some, |w| {
                w.set(self.opened, one);
                w.set(self.best, infinite);
                w.set(self.from, infinite);
            });
        }
    }

    /// Makes an update along an exponential of its unknown.
    fn bend(&self, w: &mut Writer, bend: &Bend, solution: &Vector) {
        let at = At::One(bend.unknown as usize);
        let (knee, rate, zero, one) = (w.number(bend.knee), w.number(bend.rate), w.number(0.0), w.number(1.0));
        let (u, d) = (w.at(&self.unknowns, at), w.at(solution, at));
        let above = w.sub(u, knee);
        let before = w.mul(rate, above);
        let change = w.mul(rate, d);
        let change = w.unary(ir::Unary::Neg, change);
        let after = w.add(before, change);
        let grown = |w: &mut Writer, x: Value| {
            let x = w.add(one, x);
            (x, w.unary(ir::Unary::Log, x))
        };
        let make = |w: &mut Writer, next: Value| {
            let d = w.sub(before, next);
            let d = w.div(d, rate);
            w.put(solution, at, d);
        };
        let (beyond, over) = (w.lt(zero, before), w.lt(zero, after));
        w.branch(
            beyond,
            |w| {
                let (size, most) = (w.abs(change), w.number(STRAIGHT));
                let straight = w.le(size, most);
                w.when(straight.not(), |w| {
                    let (grown, log) = grown(w, change);
                    let log = w.add(before, log);
                    let stays = w.lt(zero, log);
                    w.branch(
                        stays,
                        |w| make(w, log),
                        |w| {
                            let power = w.unary(ir::Unary::Exp, before);
                            let (low, least) = (w.mul(power, grown), w.number(-FAR));
                            let near = w.lt(least, low);
                            let low = w.select(near, low, least);
                            let next = w.sub(low, one);
                            make(w, next);
                        },
                    );
                });
            },
            |w| {
                w.when(over, |w| {
                    let (_, next) = grown(w, after);
                    make(w, next);
                });
            },
        );
    }

    /// The test of an iteration that converges linearly, after its update.
    fn geometric(&self, w: &mut Writer, square: Value, ratio: Value, slow: Cond) {
        let (first, least) = (w.tolerance(4e-16), w.tolerance(self.left));
        let (most, stalled) = (w.tolerance(1e-12), w.tolerance(1e-14));
        let (zero, one) = (w.number(0.0), w.number(1.0));
        let root = w.unary(ir::Unary::Sqrt, ratio);
        let more = w.sub(root, one);
        let t = w.mul(least, more);
        let under = w.lt(t, most);
        let t = w.select(under, t, most);
        let t = w.select(slow, stalled, t);
        let made = w.get(self.made);
        let t = w.select(Cond::True(made), t, first);
        let small = self.small(w, t);
        w.when(small, |w| self.finish(w, DONE));
        w.set(self.before, square);
        w.set(self.made, one);
        w.set(self.halvings, zero);
    }

    /// Where the system cannot be solved: further along, back, or beside the start.
    fn rescue(&self, w: &mut Writer, solved: Cond) {
        let (made, stretches) = (w.get(self.made), w.get(self.stretches));
        let (one, two, limit) = (w.number(1.0), w.number(2.0), w.number(f64::from(STRETCHES)));
        let infinite = w.number(f64::INFINITY);
        if self.open {
            let opened = w.get(self.opened);
            w.when(Cond::all([Cond::True(opened), solved.clone().not()]), |w| self.rest(w));
        }
        let further = Cond::all([Cond::True(made), solved.clone().not(), w.lt(stretches, limit)]);
        w.when(further, |w| {
            let k = w.add(stretches, one);
            w.set(self.stretches, k);
            let (first, more) = (w.number(f64::from(STRETCH.0)), w.number(STRETCH.1));
            let early = w.lt(stretches, first);
            let factor = w.select(early, two, more);
            w.each(self.n, |w, at| {
                let d = w.at(&self.update, at);
                let d = w.mul(d, factor);
                w.put(&self.update, at, d);
                let u = w.at(&self.unknowns, at);
                let u = w.sub(u, d);
                w.put(&self.unknowns, at, u);
            });
            w.set(self.best, infinite);
            w.set(self.from, infinite);
            w.push(Stmt::Continue);
        });
        let back = w.eq(stretches, limit);
        w.when(back, |w| {
            let k = w.add(stretches, one);
            w.set(self.stretches, k);
            let (part, whole) = stretched();
            let (part, whole) = (w.number(part), w.number(whole));
            w.each(self.n, |w, at| {
                let d = w.at(&self.update, at);
                let more = w.mul(d, part);
                let u = w.at(&self.unknowns, at);
                let u = w.add(u, more);
                w.put(&self.unknowns, at, u);
                let d = w.div(d, whole);
                w.put(&self.update, at, d);
            });
        });
        let may = self.may_halve(w);
        w.when(may, |w| self.halve(w));
        let nudges = w.get(self.nudges);
        let most = w.number(NUDGES.len() as f64);
        let beside = Cond::all([Cond::True(made).not(), w.lt(nudges, most)]);
        w.when(beside, |w| {
            self.nudge(w, nudges);
            w.set(self.best, infinite);
            w.set(self.from, infinite);
            w.push(Stmt::Continue);
        });
        let first = w.number(0.0);
        w.when(solved, |w| w.set(self.row, first));
        self.finish(w, SINGULAR);
    }

    /// Moves the start to the next place beside it.
    fn nudge(&self, w: &mut Writer, nudges: Value) {
        let (zero, one) = (w.number(0.0), w.number(1.0));
        let mut side = zero;
        for (k, x) in NUDGES.iter().enumerate() {
            let before = k.checked_sub(1).map_or(0.0, |k| NUDGES[k]);
            let (k, x) = (w.number(k as f64), w.number(x - before));
            let is = w.eq(nudges, k);
            side = w.select(is, x, side);
        }
        let k = w.add(nudges, one);
        w.set(self.nudges, k);
        w.each(self.n, |w, at| {
            let s = w.value(&self.scale, at);
            let positive = w.lt(zero, s);
            let s = w.select(positive, s, one);
            let more = w.mul(side, s);
            let u = w.at(&self.unknowns, at);
            let u = w.add(u, more);
            w.put(&self.unknowns, at, u);
        });
    }

    /// Whether the update is small beside the unknowns.
    fn small(&self, w: &mut Writer, t: Value) -> Cond {
        let near = |w: &mut Writer, at: At| {
            let (d, u, s) = (w.at(&self.update, at), w.at(&self.unknowns, at), w.value(&self.scale, at));
            let (d, u) = (w.abs(d), w.abs(u));
            let size = w.add(u, s);
            let allowed = w.mul(t, size);
            w.le(d, allowed)
        };
        let one = w.number(1.0);
        let result = w.var();
        w.set(result, one);
        let all = w.holds(self.n, near);
        w.when(all.not(), |w| {
            let zero = w.number(0.0);
            let energy = self.energy(w);
            let tt = w.mul(t, t);
            let (bound, size, none) = (w.mul(tt, energy), w.get(self.size), w.number(-1.0));
            let told = w.le(size, energy);
            let bound = w.select(told, bound, none);
            let all = w.holds(self.n, |w, at| {
                let close = near(w, at);
                let (k, d) = (w.value(&self.raw_weight, at), w.at(&self.update, at));
                let counted = counts(w, k);
                let kd = w.mul(k, d);
                let kdd = w.mul(kd, d);
                let over = w.lt(bound, kdd);
                Cond::any([close, Cond::all([counted, over.not()])])
            });
            let x = w.select(all, one, zero);
            w.set(result, x);
        });
        let x = w.get(result);
        Cond::True(x)
    }

    /// The unknown whose change is largest beside itself, and the change.
    fn worst(&self, w: &mut Writer) -> (Value, Value) {
        let (which, change, part) = (w.starting(0.0), w.starting(0.0), w.starting(-1.0));
        let (number, one) = (w.starting(0.0), w.number(1.0));
        w.each(self.n, |w, at| {
            let (d, u, s) = (w.at(&self.update, at), w.at(&self.unknowns, at), w.value(&self.scale, at));
            let (size, u) = (w.abs(d), w.abs(u));
            let whole = w.add(u, s);
            let ratio = w.div(size, whole);
            let (most, k) = (w.get(part), w.get(number));
            let more = w.lt(most, ratio);
            w.when(more, |w| {
                w.set(which, k);
                w.set(change, d);
                w.set(part, ratio);
            });
            let k = w.add(k, one);
            w.set(number, k);
        });
        (w.get(which), w.get(change))
    }
}
