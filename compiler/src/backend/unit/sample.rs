//! Samples of a scene: what crossed is booked, what is held next is found.

use super::apart::Answer;
use super::ledger::{clamped, positive};
use super::{Writing, programs};
use crate::backend::code::{Cond, Reason, Routine, Stmt, Value};
use crate::backend::lower::writer::Writer;
use bond_runtime::ir::Unary;
use bond_runtime::scene::{Entries, GIVEN};
use bond_runtime::simulate::{FORGET, RECURRENCE, TERMS};

impl Writing<'_> {
    /// Takes the samples at the end of the interval.
    pub(super) fn samples(&mut self, mut w: Writer) -> Result<Writer, String> {
        let k = w.kept(self.time + 1);
        let (one, length) = (w.number(1.0), w.number(self.plan.interval));
        let before = k;
        let k = w.add(k, one);
        let counted = w.lt(before, k);
        w.when(counted.not(), |w| w.push(Stmt::Fail(Reason::Clock)));
        let end = w.mul(k, length);
        let at = w.var();
        w.set(at, end);
        w.keep(self.time + 1, k);
        let order = self.start.order.clone();
        for &i in &order {
            if self.plan.ratio[i] > 1 {
                // Of instants that are one, the earliest counts.
                let due = self.due(&mut w, i);
                let (count, period) = (w.kept(self.clusters[i].count), w.number(self.plan.steps[i].h));
                let own = w.mul(count, period);
                let now = w.get(at);
                let earlier = w.lt(own, now);
                w.when(Cond::all([due, earlier]), |w| w.set(at, own));
            }
        }
        let now = w.get(at);
        w.keep(self.time, now);
        // An interval may end where no sample is due: what moved goes on to be summed.
        let dues: Vec<Cond> = order.iter().map(|i| self.due(&mut w, *i)).collect();
        let any = Cond::any(dues);
        w = self.when(w, any.clone(), |this, mut w| {
            this.collect(&mut w, |c| this.scene.clusters[c].period.is_none());
            Ok(w)
        })?;
        for &i in &order {
            w = self.when_due(w, i, |this, w| {
                let mut w = this.settle_interval(w, i)?;
                this.collect(&mut w, |c| c == i);
                Ok(w)
            })?;
        }
        w = self.when(w, any.clone(), |this, w| this.foreign(w))?;
        for &i in order.iter().rev() {
            w = self.when_due(w, i, |this, w| this.respond(w, i))?;
        }
        w = self.when(w, any, |this, w| this.foreign(w))?;
        for &i in &order {
            let ratio = self.plan.ratio[i];
            let (count, left) = (self.clusters[i].count, self.clusters[i].left);
            let due = self.due(&mut w, i);
            let n = w.kept(count);
            let next = w.add(n, one);
            let next = w.select(due.clone(), next, n);
            w.keep(count, next);
            if ratio > 1 {
                let (rest, full) = (w.kept(left), w.number(f64::from(ratio - 1)));
                let less = w.sub(rest, one);
                let rest = w.select(due, full, less);
                w.keep(left, rest);
            }
        }
        // A run within this program says so when it gets there; who sets signals can mend them only before.
        if !self.full {
            for &i in &order {
                w = self.foretell(w, i)?;
            }
        }
        Ok(w)
    }

    /// The routine that takes the first samples anew; see [`super::Unit::begin`].
    pub(super) fn begin(&mut self) -> Result<Option<Routine>, String> {
        let order = self.start.order.clone();
        if self.scene.inputs.is_empty() || order.is_empty() {
            return Ok(None);
        }
        let mut w = Writer::new();
        let zero = w.number(0.0);
        // Nothing is left of the samples that the image has taken.
        for (c, place) in self.scene.clusters.iter().zip(&self.clusters) {
            let ports = c.ports.iter().map(|p| p.input);
            for at in ports.chain(c.foreign_at..c.given_at()) {
                w.keep(place.input + at, zero);
            }
            for at in place.held.iter().flat_map(|h| [h.v, h.forecast]).chain([2, 3].map(|k| place.caution + k)) {
                w.keep(at, zero);
            }
        }
        // All are due.
        for &i in order.iter().filter(|i| self.plan.ratio[**i] > 1) {
            w.keep(self.clusters[i].left, zero);
        }
        w = self.foreign(w)?;
        for &i in order.iter().rev() {
            w = self.respond(w, i)?;
        }
        w = self.foreign(w)?;
        for &i in order.iter().filter(|i| self.plan.ratio[**i] > 1) {
            let full = w.number(f64::from(self.plan.ratio[i] - 1));
            w.keep(self.clusters[i].left, full);
        }
        for &i in &order {
            w = self.foretell(w, i)?;
        }
        Ok(Some(w.routine(format!("start of {}", self.scene.name))))
    }

    /// Fails where a sampled cluster has been told what its next step must fail for: a signal from outside that is no
    /// number, or that leads to a next value which is none. What it was told stays until that step is taken, so that
    /// the scene could not go on any more.
    fn foretell(&mut self, w: Writer, i: usize) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        if c.inputs.is_empty() {
            return Ok(w);
        }
        let (place, period) = (self.clusters[i].clone(), self.plan.steps[i].h);
        self.when_sampled(w, i, |this, mut w| {
            for k in 0..c.inputs.len() {
                let x = w.kept(place.input + c.given_at() + GIVEN * k);
                let sound = w.finite(x);
                w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
            }
            if !c.ports.is_empty() {
                return Ok(w); // what will have moved is not known yet
            }
            let (count, one, length) = (w.kept(place.count), w.number(1.0), w.number(period));
            let last = w.sub(count, one);
            let t = w.mul(last, length);
            w.keep(place.input, t);
            w.keep(place.input + 1, length);
            this.program(w, &c.step.program, place.state, place.next, place.input, place.output, &c.name)
        })
    }

    /// Whether a sampled cluster takes a sample now.
    fn due(&self, w: &mut Writer, i: usize) -> Cond {
        if self.plan.ratio[i] == 1 {
            return Cond::Known(true);
        }
        let (left, zero) = (w.kept(self.clusters[i].left), w.number(0.0));
        w.eq(left, zero)
    }

    fn when_due(
        &mut self,
        mut w: Writer,
        i: usize,
        f: impl FnOnce(&mut Self, Writer) -> Result<Writer, String>,
    ) -> Result<Writer, String> {
        let due = self.due(&mut w, i);
        self.when(w, due, f)
    }

    /// As [`Self::when_due`], once the intervals that are left until the next sample are counted anew.
    fn when_sampled(
        &mut self,
        mut w: Writer,
        i: usize,
        f: impl FnOnce(&mut Self, Writer) -> Result<Writer, String>,
    ) -> Result<Writer, String> {
        let ratio = self.plan.ratio[i];
        let just = match ratio {
            1 => Cond::Known(true),
            _ => {
                let (left, full) = (w.kept(self.clusters[i].left), w.number(f64::from(ratio - 1)));
                w.eq(left, full)
            }
        };
        self.when(w, just, f)
    }

    fn when(
        &mut self,
        mut w: Writer,
        due: Cond,
        f: impl FnOnce(&mut Self, Writer) -> Result<Writer, String>,
    ) -> Result<Writer, String> {
        if due.known().is_some() {
            return f(self, w); // in each interval
        }
        w.open();
        let mut w = f(self, w)?;
        let body = w.close();
        w.push(Stmt::If(due, body, Vec::new()));
        Ok(w)
    }

    /// Hands what some clusters gave out at their ports to those who hold them.
    fn collect(&self, w: &mut Writer, of: impl Fn(usize) -> bool) {
        for (k, bar) in self.scene.bars.iter().enumerate().filter(|(_, b)| of(b.other.0)) {
            let (cluster, port) = bar.other;
            let other = &self.clusters[cluster];
            let m = w.kept(other.moved + port);
            let zero = w.number(0.0);
            w.keep(other.moved + port, zero);
            let sign = w.number(bar.sign);
            let q = w.mul(sign, m);
            let input = w.kept(other.input + self.scene.clusters[cluster].ports[port].input);
            let holder = bar.holder.0;
            let Some(j) = self.start.clusters[holder].held.iter().position(|h| h.bar == Some(k)) else { continue };
            let held = &self.clusters[holder].held[j];
            let before = w.kept(held.q);
            let sum = w.add(before, q);
            w.keep(held.q, sum);
            if self.latches(holder, j) {
                let told = w.mul(sign, input);
                let energy = w.mul(told, q);
                let before = w.kept(held.w);
                let sum = w.add(before, energy);
                w.keep(held.w, sum);
            }
        }
    }

    /// Whether what a held port answers to is itself sampled.
    fn latches(&self, i: usize, k: usize) -> bool {
        let bar = self.start.clusters[i].held[k].bar;
        bar.is_some_and(|b| self.scene.clusters[self.scene.bars[b].other.0].period.is_some())
    }

    /// Ends the interval of a sampled cluster.
    fn settle_interval(&mut self, mut w: Writer, i: usize) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        let place = self.clusters[i].clone();
        let start = &self.start.clusters[i];
        let period = self.plan.steps[i].h;
        let (length, rate) = (w.number(period), w.number(1.0 / period));
        let mut crossed = Vec::with_capacity(start.held.len());
        for (k, (h, held)) in start.held.iter().zip(&place.held).enumerate() {
            let (v, q) = (w.kept(held.v), w.kept(held.q));
            let here = if self.latches(i, k) { w.kept(held.w) } else { w.mul(v, q) };
            crossed.push(here);
            if self.full {
                w.keep(held.crossed, here);
                w.gather(held.energy, here);
            }
            let back = w.unary(Unary::Neg, q);
            let flow = w.mul(back, rate);
            w.keep(place.input + c.ports[h.port].input, flow);
        }
        let (count, one) = (w.kept(place.count), w.number(1.0));
        let last = w.sub(count, one);
        let t = w.mul(last, length);
        let mut w = self.one(w, i, t, period, false)?;
        self.settle(&mut w, i, &crossed);
        for (k, held) in place.held.iter().enumerate() {
            let v: Vec<Value> = place.held.iter().map(|h| w.kept(h.v)).collect();
            let (response, q) = (self.response(&mut w, i, k, &v), w.kept(held.q));
            let alpha = w.add(q, response);
            let (from, intervals) =
                (self.answer(&mut w, i, Answer::Decay, k * RECURRENCE + TERMS + 2), w.kept(held.intervals));
            let told = w.lt(from, intervals);
            let (forecast, off, part) = (w.kept(held.forecast), w.kept(held.forecast + 1), w.number(FORGET));
            let last = w.mul(part, off);
            let error = w.sub(alpha, forecast);
            let error = w.abs(error);
            let worse = Cond::all([told, w.lt(last, error)]);
            let off = w.select(worse, error, last);
            w.keep(held.forecast + 1, off);
            shift(&mut w, held.alpha, alpha);
        }
        let zero = w.number(0.0);
        for held in &place.held {
            let (v, q, k) = (w.kept(held.v), w.kept(held.q), w.kept(held.intervals));
            shift(&mut w, held.before, v);
            w.keep(held.last_q, q);
            w.keep(held.q, zero);
            w.keep(held.w, zero);
            // Only whether there are enough counts.
            let enough = w.number((TERMS + 1) as f64);
            let more = w.add(k, one);
            let few = w.lt(k, enough);
            let k = w.select(few, more, k);
            w.keep(held.intervals, k);
        }
        Ok(w)
    }

    /// Begins an interval of a sampled cluster: finds what to hold, and latches what others hold.
    fn respond(&mut self, mut w: Writer, i: usize) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        let place = self.clusters[i].clone();
        let start = &self.start.clusters[i];
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let holder = &self.start.clusters[bar.holder.0].held;
            let held = holder.iter().position(|h| h.port == bar.holder.1).map(|k| &self.clusters[bar.holder.0].held[k]);
            let zero = w.number(0.0);
            let v = held.map_or(zero, |h| w.kept(h.v));
            let sign = w.number(bar.sign);
            let v = w.mul(sign, v);
            w.keep(place.input + c.ports[bar.other.1].input, v);
        }
        let Some(respond) = &c.respond else { return Ok(w) };
        let n = start.held.len();
        let period = self.plan.steps[i].h;
        let (length, rate, now) = (w.number(period), w.number(1.0 / period), w.kept(self.time));
        let alpha: Vec<Value> = (0..n).map(|k| self.foretold(&mut w, i, k)).collect();
        w.keep(place.input, now);
        w.keep(place.input + 1, length);
        let told = |w: &mut Writer| {
            for (h, held) in start.held.iter().zip(&place.held) {
                let q = w.kept(held.last_q);
                let back = w.unary(Unary::Neg, q);
                let flow = w.mul(back, rate);
                w.keep(place.input + c.ports[h.port].input, flow);
            }
        };
        told(&mut w);
        let (program, fallback) = programs(respond);
        let extra = place.input + start.input.len();
        if fallback.is_some() {
            for (k, a) in alpha.iter().enumerate() {
                w.keep(extra + k, *a);
            }
        }
        let mut w = self.program(w, program, place.state, 0, place.input, place.called, &c.name)?;
        let values: Vec<_> = (0..n)
            .map(|k| {
                let (var, x) = (w.var(), w.kept(place.called + k));
                w.set(var, x);
                var
            })
            .collect();
        let mut foreseen = w.kept(place.called + n + usize::from(fallback.is_some()));
        if c.budget && fallback.is_none() && c.entries.iter().any(Entries::is_driven) {
            // From rest, what its sources put in goes by the motion that begins.
            let zero = w.number(0.0);
            let rests = place.held.iter().zip(&alpha).flat_map(|(held, alpha)| {
                let q = w.kept(held.last_q);
                [w.eq(q, zero), w.eq(*alpha, zero)]
            });
            let rests = Cond::all(rests.collect::<Vec<_>>());
            let found = w.holding(foreseen);
            w.open();
            for (k, h) in start.held.iter().enumerate() {
                let v: Vec<Value> = values.iter().map(|v| w.get(*v)).collect();
                let response = self.response(&mut w, i, k, &v);
                let flow = w.mul(response, rate);
                w.keep(place.input + c.ports[h.port].input, flow);
            }
            w = self.program(w, program, place.state, 0, place.input, place.called, &c.name)?;
            let begun = w.kept(place.called + n);
            w.set(found, begun);
            told(&mut w);
            let body = w.close();
            w.push(Stmt::If(rests, body, Vec::new()));
            foreseen = w.get(found);
        }
        if let Some(fallback) = fallback {
            let (found, zero) = (w.kept(place.called + n), w.number(0.0));
            let none = w.eq(found, zero);
            w.open();
            w = self.search(w, i, fallback, &alpha, &values)?;
            told(&mut w); // the search left trials there, which nobody is to look at
            let body = w.close();
            w.push(Stmt::If(none, body, Vec::new()));
        }
        let mut found: Vec<Value> = values.iter().map(|v| w.get(*v)).collect();
        let sound = Cond::all(found.iter().map(|v| w.finite(*v)).collect::<Vec<_>>());
        w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
        if c.budget {
            let stored = self.stored(&mut w, i);
            let foreseen = positive(&mut w, foreseen);
            let noise = self.noise(&mut w, i);
            let room = w.sub(stored, noise);
            let room = w.add(room, foreseen);
            let room = positive(&mut w, room);
            let two = w.number(2.0);
            let twice = w.mul(two, room);
            let doubt: Vec<Value> = (0..n).map(|k| self.doubt(&mut w, i, k)).collect();
            found = self.within_budget(&mut w, i, (&found, &alpha), None, room);
            found = self.within_budget(&mut w, i, (&found, &alpha), Some(&doubt), twice);
            found = self.restrained(&mut w, i, (&found, &alpha, &doubt), stored);
        }
        for (((h, held), v), alpha) in start.held.iter().zip(&place.held).zip(found).zip(&alpha) {
            w.keep(held.forecast, *alpha);
            w.keep(held.v, v);
            if let Some(b) = h.bar {
                let bar = &self.scene.bars[b];
                let (cluster, port) = bar.other;
                let other = &self.scene.clusters[cluster];
                if other.period.is_none() {
                    let sign = w.number(bar.sign);
                    let v = w.mul(sign, v);
                    w.keep(self.clusters[cluster].input + other.ports[port].input, v);
                }
            }
        }
        Ok(w)
    }

    /// What the next interval's alpha is foretold to be.
    fn foretold(&self, w: &mut Writer, i: usize, k: usize) -> Value {
        let (held, n) = (&self.clusters[i].held[k], self.clusters[i].held.len());
        let rule: Vec<Value> = (0..RECURRENCE).map(|p| self.answer(w, i, Answer::Decay, k * RECURRENCE + p)).collect();
        let (order, left) = (rule[TERMS + 1], rule[TERMS]);
        let known = w.known(order);
        let most = known.map_or(TERMS, |order| order as usize);
        let counts = |w: &mut Writer, p: usize| match known {
            Some(_) => Cond::Known(true),
            None => {
                let p = w.number(p as f64);
                w.lt(p, order)
            }
        };
        // What what was held will do, by the interval it was held in, and what its changes will.
        let effect = |w: &mut Writer, p: usize, changes: bool| {
            let mut sum = None;
            for (j, h) in self.clusters[i].held.iter().enumerate() {
                let mut x = w.kept(h.before + p);
                if changes {
                    let earlier = w.kept(h.before + p + 1);
                    x = w.sub(x, earlier);
                }
                let g = self.answer(w, i, Answer::Gamma, (p * n + k) * n + j);
                let x = w.mul(g, x);
                sum = Some(sum.map_or(x, |sum| w.add(sum, x)));
            }
            sum.unwrap_or_else(|| w.number(0.0))
        };
        let (zero, intervals, last) = (w.number(0.0), w.kept(held.intervals), w.kept(held.alpha));
        let first = effect(w, 0, false);
        let mut plain = (w.mul(rule[0], last), first);
        let earlier = w.kept(held.alpha + 1);
        let change = w.sub(last, earlier);
        let change = w.mul(rule[0], change);
        let mut later = (w.add(last, change), effect(w, 0, true));
        for p in 1..most {
            let counts = counts(w, p);
            let (a, b) = (w.kept(held.alpha + p), w.kept(held.alpha + p + 1));
            let change = w.sub(a, b);
            for (sums, x, changes) in [(&mut plain, a, false), (&mut later, change, true)] {
                let x = w.mul(rule[p], x);
                let x = w.add(sums.0, x);
                let more = effect(w, p, changes);
                let more = w.add(sums.1, more);
                *sums = (w.select(counts.clone(), x, sums.0), w.select(counts.clone(), more, sums.1));
            }
        }
        let (plain, later) = (w.sub(plain.0, plain.1), w.sub(later.0, later.1));
        let just = w.eq(intervals, order);
        let mut some = w.select(just, plain, later);
        if most > 1 {
            let crude = w.mul(left, last);
            let crude = w.sub(crude, first);
            let few = w.lt(intervals, order);
            some = w.select(few, crude, some);
        }
        let none = w.eq(intervals, zero);
        w.select(none, zero, some)
    }

    /// What to hold where a switched law leaves no solution: by bisection on the jump, one port after the other.
    fn search(
        &mut self,
        mut w: Writer,
        i: usize,
        fallback: &bond_runtime::ir::Program,
        alpha: &[Value],
        values: &[crate::backend::code::Var],
    ) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        let place = self.clusters[i].clone();
        let start = self.start.clusters[i].clone();
        let n = values.len();
        let (zero, half, one) = (w.number(0.0), w.number(0.5), w.number(1.0));
        let rate = w.number(1.0 / self.plan.steps[i].h);
        let q: Vec<_> = alpha
            .iter()
            .map(|a| {
                let var = w.var();
                w.set(var, *a);
                var
            })
            .collect();
        let rounds = if n == 1 { 1.0 } else { 20.0 };
        let round = w.starting(0.0);
        w.open();
        let (k, most) = (w.get(round), w.number(rounds));
        let more = w.lt(k, most);
        w.when(more.not(), |w| w.push(Stmt::Break));
        let next = w.add(k, one);
        w.set(round, next);
        for k in 0..n {
            let own = self.answer(&mut w, i, Answer::Beta, k * n + k);
            let mut pull = None;
            for j in (0..n).filter(|j| *j != k) {
                let (b, v) = (self.answer(&mut w, i, Answer::Beta, k * n + j), w.get(values[j]));
                let x = w.mul(b, v);
                pull = Some(pull.map_or(x, |sum| w.add(sum, x)));
            }
            let free = pull.map_or(alpha[k], |p| w.sub(alpha[k], p));
            w.set(q[k], free);
            // Stage 0 asks at the free answer, the others halve.
            let (stage, low, high) = (w.starting(0.0), w.var(), w.var());
            w.open();
            for (h, q) in start.held.iter().zip(&q) {
                let x = w.get(*q);
                let back = w.unary(Unary::Neg, x);
                let flow = w.mul(back, rate);
                w.keep(place.input + c.ports[h.port].input, flow);
            }
            w = self.program(w, fallback, place.state, 0, place.input, place.called, &c.name)?;
            let v = w.kept(place.called + k);
            let s = w.get(stage);
            let asked = w.eq(s, zero);
            let plain = Cond::any([w.eq(own, zero), w.eq(v, zero)]);
            w.branch(
                asked,
                |w| {
                    w.when(plain, |w| {
                        w.set(values[k], v);
                        w.push(Stmt::Break);
                    });
                    let far = w.mul(own, v);
                    let far = w.sub(free, far);
                    let first = w.lt(far, free);
                    let (a, b) = (w.select(first.clone(), far, free), w.select(first, free, far));
                    w.set(low, a);
                    w.set(high, b);
                },
                |w| {
                    let x = w.get(q[k]);
                    let rest = w.sub(x, free);
                    let called = w.mul(own, v);
                    let sum = w.add(rest, called);
                    let above = w.lt(zero, sum);
                    w.branch(above, |w| w.set(high, x), |w| w.set(low, x));
                },
            );
            let s = w.add(s, one);
            w.set(stage, s);
            let limit = w.number(100.0);
            let (a, b) = (w.get(low), w.get(high));
            let sum = w.add(a, b);
            let middle = w.mul(half, sum);
            let over = w.lt(limit, s);
            let stop = Cond::any([over.clone(), w.le(middle, a), w.le(b, middle)]);
            w.when(over.not(), |w| w.set(q[k], middle));
            w.when(stop, |w| {
                let x = w.get(q[k]);
                let rest = w.sub(free, x);
                let v = w.div(rest, own);
                w.set(values[k], v);
                w.push(Stmt::Break);
            });
            let body = w.close();
            w.push(Stmt::Loop(body));
        }
        let body = w.close();
        w.push(Stmt::Loop(body));
        Ok(w)
    }

    /// Samples the signals that clusters read of each other.
    fn foreign(&mut self, mut w: Writer) -> Result<Writer, String> {
        for i in self.start.read.clone() {
            let due = self.scene.clusters[i].period.map(|_| self.due(&mut w, i));
            w = self.look(w, i, due)?;
        }
        for i in 0..self.clusters.len() {
            let c = &self.scene.clusters[i];
            if c.foreign.is_empty() && (c.period.is_none() || c.inputs.is_empty()) {
                continue;
            }
            let due = if c.period.is_some() { self.due(&mut w, i) } else { Cond::Known(true) };
            w.open();
            if c.period.is_some() {
                self.latch(&mut w, i);
            }
            for (k, (cluster, output)) in c.foreign.iter().enumerate() {
                let x = w.kept(self.clusters[*cluster].seen + output);
                w.keep(self.clusters[i].input + c.foreign_at + k, x);
            }
            let body = w.close();
            if due == Cond::Known(true) {
                body.into_iter().for_each(|s| w.push(s));
            } else {
                w.push(Stmt::If(due, body, Vec::new()));
            }
        }
        Ok(w)
    }

    /// How far the other side gives way at a held port, beta v.
    fn response(&self, w: &mut Writer, i: usize, k: usize, v: &[Value]) -> Value {
        let mut sum = None;
        for (j, x) in v.iter().enumerate() {
            let b = self.answer(w, i, Answer::Beta, k * v.len() + j);
            let x = w.mul(b, *x);
            sum = Some(sum.map_or(x, |sum| w.add(sum, x)));
        }
        sum.unwrap_or_else(|| w.number(0.0))
    }

    /// What the other side gives way by itself, v beta v.
    fn given_way(&self, w: &mut Writer, i: usize, v: &[Value]) -> Value {
        let n = v.len();
        let mut b = w.number(0.0);
        for p in 0..n {
            for q in 0..n {
                let k = self.answer(w, i, Answer::Beta, p * n + q);
                let x = w.mul(v[p], k);
                let x = w.mul(x, v[q]);
                b = w.add(b, x);
            }
        }
        b
    }

    /// Scales held variables down until the energy that the interval is foretold to give back is at most `room`, and
    /// be each alpha off by `doubt`; see `bond_runtime::simulate`.
    fn within_budget(
        &self,
        w: &mut Writer,
        i: usize,
        (v, alpha): (&[Value], &[Value]),
        doubt: Option<&[Value]>,
        room: Value,
    ) -> Vec<Value> {
        let (zero, one, two, four) = (w.number(0.0), w.number(1.0), w.number(2.0), w.number(4.0));
        let mut a = None;
        for (v, alpha) in v.iter().zip(alpha) {
            let x = w.mul(*v, *alpha);
            a = Some(a.map_or(x, |sum| w.add(sum, x)));
        }
        let mut a = a.unwrap_or(zero);
        if let Some(doubt) = doubt {
            let mut less = None;
            for (v, doubt) in v.iter().zip(doubt) {
                let size = w.abs(*v);
                let x = w.mul(size, *doubt);
                less = Some(less.map_or(x, |sum| w.add(sum, x)));
            }
            a = w.sub(a, less.unwrap_or(zero));
        }
        let b = self.given_way(w, i, v);
        let given = w.sub(a, b);
        let least = w.unary(Unary::Neg, room);
        let within = w.le(least, given);
        let part = w.var();
        w.set(part, one);
        w.when(within.not(), |w| {
            let aa = w.mul(a, a);
            let four_b = w.mul(four, b);
            let more = w.mul(four_b, room);
            let sum = w.add(aa, more);
            let root = w.unary(Unary::Sqrt, sum);
            let up = w.add(a, root);
            let down = w.mul(two, b);
            let s = w.div(up, down);
            let back = w.unary(Unary::Neg, a);
            let t = w.div(room, back);
            let curved = w.lt(zero, b);
            let s = w.select(curved, s, t);
            let finite = w.finite(s);
            let s = w.select(finite, s, zero);
            let s = clamped(w, s, 0.0, 1.0);
            w.set(part, s);
        });
        let s = w.get(part);
        v.iter().map(|x| w.mul(*x, s)).collect()
    }

    /// What the foretold alpha may be off by.
    fn doubt(&self, w: &mut Writer, i: usize, k: usize) -> Value {
        let held = &self.clusters[i].held[k];
        let order = self.answer(w, i, Answer::Decay, k * RECURRENCE + TERMS + 1);
        let off = w.kept(held.forecast + 1);
        if w.known(order) == Some(1.0) {
            return off; // before the first interval, alpha is 0
        }
        let left = self.answer(w, i, Answer::Decay, k * RECURRENCE + TERMS);
        let (intervals, last, one) = (w.kept(held.intervals), w.kept(held.alpha), w.number(1.0));
        let size = w.abs(last);
        let lost = w.sub(one, left);
        let size = w.mul(lost, size);
        let all = w.add(off, size);
        let few = w.lt(intervals, order);
        w.select(few, all, off)
    }

    /// In debt, scales held variables down until no more is at risk than was repaid or is trusted.
    fn restrained(
        &self,
        w: &mut Writer,
        i: usize,
        (v, alpha, doubt): (&[Value], &[Value], &[Value]),
        stored: Value,
    ) -> Vec<Value> {
        let [peak, trust, risk, largest] = [0, 1, 2, 3].map(|k| self.clusters[i].caution + k);
        let (zero, one, two, four) = (w.number(0.0), w.number(1.0), w.number(2.0), w.number(4.0));
        let mut u = None;
        for ((v, alpha), doubt) in v.iter().zip(alpha).zip(doubt) {
            let (size, far) = (w.abs(*v), w.abs(*alpha));
            let far = w.add(far, *doubt);
            let x = w.mul(size, far);
            u = Some(u.map_or(x, |sum| w.add(sum, x)));
        }
        let u = u.unwrap_or(zero);
        let b = self.given_way(w, i, v);
        let b = positive(w, b);
        let all = w.add(u, b);
        w.keep(risk, all);
        w.raise(largest, all);
        let part = w.var();
        w.set(part, one);
        let trusted = w.kept(trust);
        let wary = [w.lt(stored, zero), w.lt(trusted, one)];
        w.when(Cond::any(wary), |w| {
            let (trust, peak) = (w.kept(trust), w.kept(peak));
            let (trusted, repaid) = (w.mul(trust, all), w.add(peak, stored));
            let more = w.lt(trusted, repaid);
            let most = w.select(more, repaid, trusted);
            let over = w.lt(most, all);
            w.when(over, |w| {
                let up = w.mul(two, most);
                let uu = w.mul(u, u);
                let four_b = w.mul(four, b);
                let rest = w.mul(four_b, most);
                let sum = w.add(uu, rest);
                let root = w.unary(Unary::Sqrt, sum);
                let down = w.add(u, root);
                let s = w.div(up, down);
                let finite = w.finite(s);
                let s = w.select(finite, s, zero);
                let s = clamped(w, s, 0.0, 1.0);
                w.set(part, s);
                w.keep(risk, most);
            });
        });
        let s = w.get(part);
        v.iter().map(|x| w.mul(*x, s)).collect()
    }
}

/// Puts a number before some others, of which the last one goes: one more than [`TERMS`] of them.
fn shift(w: &mut Writer, at: usize, x: Value) {
    let before: Vec<Value> = (0..TERMS).map(|p| w.kept(at + p)).collect();
    w.keep(at, x);
    for (p, x) in before.into_iter().enumerate() {
        w.keep(at + p + 1, x);
    }
}
