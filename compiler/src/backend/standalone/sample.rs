//! Samples of a scene: what crossed is booked, what is held next is found.

use super::Writing;
use crate::backend::code::{Cond, Reason, Routine, Stmt, Value};
use crate::backend::lower::writer::Writer;
use bond_runtime::energy::PortResponse::PortAdmittance;
use bond_runtime::energy::interval;
use bond_runtime::ir::Unary;
use bond_runtime::scene::{Bar, Entries, GIVEN};

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
                w = self.look_ahead(w, i)?;
            }
        }
        Ok(w)
    }

    /// The routine that takes the first samples anew; see [`super::StandaloneModule::begin`].
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
            for h in &place.layout.held {
                w.keep(place.at(h.v), zero);
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
            w = self.look_ahead(w, i)?;
        }
        Ok(Some(w.routine(format!("start of {}", self.scene.name))))
    }

    /// Fails where a sampled cluster has been told what its next step must fail for: a signal from outside that is no
    /// number, or that leads to a next value which is none. What it was told stays until that step is taken, so that
    /// the scene could not go on any more.
    fn look_ahead(&mut self, w: Writer, i: usize) -> Result<Writer, String> {
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
            let met = self.met(w, bar);
            let holder = bar.holder.0;
            let Some(j) = self.start.clusters[holder].held.iter().position(|h| h.bar == Some(k)) else { continue };
            let (place, held) = (&self.clusters[holder], &self.clusters[holder].layout.held[j]);
            let before = w.kept(place.at(held.q));
            let sum = w.add(before, q);
            w.keep(place.at(held.q), sum);
            if self.latches(holder, j) {
                let energy = w.mul(met, q);
                let before = w.kept(place.at(held.w));
                let sum = w.add(before, energy);
                w.keep(place.at(held.w), sum);
            }
        }
    }

    /// What the other side of a bar met in its interval that has just ended.
    fn met(&self, w: &mut Writer, bar: &Bar) -> Value {
        let (cluster, port) = bar.other;
        let input = w.kept(self.clusters[cluster].input + self.scene.clusters[cluster].ports[port].input);
        let sign = w.number(bar.sign);
        w.mul(sign, input)
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
        let period = self.plan.steps[i].h;
        let (zero, length, rate) = (w.number(0.0), w.number(period), w.number(1.0 / period));
        for (k, p) in place.layout.held.iter().enumerate() {
            let counted = self.latches(i, k);
            let bar = self.start.clusters[i].held[k].bar.filter(|_| p.counts.is_some() && !counted);
            let met = bar.map(|b| self.met(&mut w, &self.scene.bars[b]));
            self.on(&mut w, i, |m, block| interval::cross(m, block, p, counted, met.map(|x| m.value(x))));
            let q = w.kept(place.at(p.q));
            let back = w.unary(Unary::Neg, q);
            let flow = w.mul(back, rate);
            w.keep(place.input + c.ports[p.port].input, flow);
        }
        let (count, one) = (w.kept(place.count), w.number(1.0));
        let last = w.sub(count, one);
        let t = w.mul(last, length);
        let mut w = self.one(w, i, t, period, false)?;
        self.settle(&mut w, i);
        let part = place.layout.stake.shortened.map(|at| w.kept(place.at(at)));
        place.lines.iter().for_each(|line| line.turn(&mut w, (place.state, place.output, place.input), part));
        self.within_all_budgets(&mut w, i);
        for at in place.layout.held.iter().flat_map(|p| [p.q, p.w]) {
            w.keep(place.at(at), zero);
        }
        Ok(w)
    }

    /// Begins an interval of a sampled cluster: finds what to hold, and latches what others hold.
    fn respond(&mut self, mut w: Writer, i: usize) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        let place = self.clusters[i].clone();
        let start = &self.start.clusters[i];
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let holder = &self.clusters[bar.holder.0];
            let held = holder.layout.held.iter().find(|p| p.port == bar.holder.1);
            let zero = w.number(0.0);
            let v = held.map_or(zero, |p| w.kept(holder.at(p.v)));
            let sign = w.number(bar.sign);
            let v = w.mul(sign, v);
            w.keep(place.input + c.ports[bar.other.1].input, v);
        }
        let Some(respond) = &c.respond else { return Ok(w) };
        let n = start.held.len();
        let period = self.plan.steps[i].h;
        let (length, rate, now) = (w.number(period), w.number(1.0 / period), w.kept(self.time));
        let free_response: Vec<Value> =
            (0..n).map(|k| self.on(&mut w, i, |m, block| self.holder(i).predicted(m, block, k).value)).collect();
        w.keep(place.input, now);
        w.keep(place.input + 1, length);
        let told = |w: &mut Writer| {
            for p in &place.layout.held {
                let q = w.kept(place.at(p.last_q));
                let back = w.unary(Unary::Neg, q);
                let flow = w.mul(back, rate);
                w.keep(place.input + c.ports[p.port].input, flow);
            }
        };
        told(&mut w);
        let (program, fallback) = (&respond.program, &respond.fallback);
        let extra = place.input + start.input.len();
        if fallback.is_some() {
            for (k, a) in free_response.iter().enumerate() {
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
            let rests = place.layout.held.iter().zip(&free_response).flat_map(|(p, free_response)| {
                let q = w.kept(place.at(p.last_q));
                [w.eq(q, zero), w.eq(*free_response, zero)]
            });
            let rests = Cond::all(rests.collect::<Vec<_>>());
            let found = w.holding(foreseen);
            w.open();
            for (k, p) in place.layout.held.iter().enumerate() {
                let v: Vec<Value> = values.iter().map(|v| w.get(*v)).collect();
                let yielded = self.on(&mut w, i, |m, block| {
                    self.holder(i).yielded(m, block, k, v.into_iter().map(|v| m.value(v))).value
                });
                let flow = w.mul(yielded, rate);
                w.keep(place.input + c.ports[p.port].input, flow);
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
            w = self.search(w, i, fallback, &free_response, &values)?;
            told(&mut w); // the search left trials there, which nobody is to look at
            let body = w.close();
            w.push(Stmt::If(none, body, Vec::new()));
        }
        let mut found: Vec<Value> = values.iter().map(|v| w.get(*v)).collect();
        let sound = Cond::all(found.iter().map(|v| w.finite(*v)).collect::<Vec<_>>());
        w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
        if c.budget {
            found = self.on(&mut w, i, |m, block| {
                let holder = self.holder(i);
                let free_response: Vec<_> = free_response.iter().map(|x| m.value(*x)).collect();
                let mut found: Vec<_> = found.iter().map(|x| m.value(*x)).collect();
                holder.within_budget(m, block, &mut found, &free_response, m.value(foreseen));
                found.iter().map(|x| x.value).collect()
            });
        }
        for ((h, p), v) in start.held.iter().zip(&place.layout.held).zip(found) {
            w.keep(place.at(p.v), v);
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

    /// What to hold where a switched law leaves no solution: by bisection on the jump, one port after the other.
    fn search(
        &mut self,
        mut w: Writer,
        i: usize,
        fallback: &bond_runtime::ir::Program,
        free_response: &[Value],
        values: &[crate::backend::code::Var],
    ) -> Result<Writer, String> {
        let c = &self.scene.clusters[i];
        let place = self.clusters[i].clone();
        let start = self.start.clusters[i].clone();
        let n = values.len();
        let (zero, half, one) = (w.number(0.0), w.number(0.5), w.number(1.0));
        let rate = w.number(1.0 / self.plan.steps[i].h);
        let q: Vec<_> = free_response
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
            let own = self.response(&mut w, i, PortAdmittance, k * n + k);
            let mut pull = None;
            for j in (0..n).filter(|j| *j != k) {
                let (b, v) = (self.response(&mut w, i, PortAdmittance, k * n + j), w.get(values[j]));
                let x = w.mul(b, v);
                pull = Some(pull.map_or(x, |sum| w.add(sum, x)));
            }
            let free = pull.map_or(free_response[k], |p| w.sub(free_response[k], p));
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
}
