//! Steps of a scene's clusters.

use super::{Late, Steps, Writing};
use crate::backend::code::{Stmt, Value};
use crate::backend::lower::writer::{At, Writer};
use std::ops::Range;

/// So many numbers are gone through one by one.
const WRITTEN: usize = 64;

impl Writing<'_> {
    /// Brings continuous clusters to the end of the interval.
    pub(super) fn steps(&mut self, mut w: Writer) -> Result<Writer, String> {
        let mut drawn = Vec::new();
        for i in 0..self.clusters.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_some() {
                continue;
            }
            let Steps { h, n, own } = self.plan.steps[i];
            let watched;
            (w, watched) = self.watch(w, i)?;
            let (now, length) = (w.kept(self.time), w.number(h));
            if n == 1 {
                w = self.one(w, i, now, h, true)?;
                let place = &self.clusters[i];
                let state = if self.late.iter().any(|l| l.next == place.next) { place.next } else { place.state };
                let end = w.add(now, length);
                w = self.watch_step(w, i, &watched, (end, h, state))?;
                drawn.extend(watched);
                continue;
            }
            // Steps are counted by a number: the time of each is made of it.
            let (count, one, most) = (w.starting(0.0), w.number(1.0), w.number(f64::from(n)));
            let so_far = w.kept(self.time + 1);
            let so_far = w.mul(so_far, most);
            w.open();
            let k = w.get(count);
            let more = w.lt(k, most);
            w.when(more.not(), |w| w.push(Stmt::Break));
            let t = if own {
                let k = w.add(so_far, k);
                w.mul(k, length)
            } else {
                let gone = w.mul(k, length);
                w.add(now, gone)
            };
            w = self.one(w, i, t, h, false)?;
            let (end, state) = (w.add(t, length), self.clusters[i].state);
            w = self.watch_step(w, i, &watched, (end, h, state))?;
            let k = w.add(k, one);
            w.set(count, k);
            let body = w.close();
            w.push(Stmt::Loop(body));
            drawn.extend(watched);
        }
        self.within_budget(&mut w, &drawn);
        Ok(w)
    }

    /// One step of a cluster from `t` on, kept and booked. Where it is the `only` one of the interval, many states are
    /// not kept before its end: what fails until then has left them as they were.
    pub(super) fn one(&mut self, mut w: Writer, i: usize, t: Value, h: f64, only: bool) -> Result<Writer, String> {
        if !self.clusters[i].pasts.is_empty() {
            return self.in_pieces(w, i, t, h);
        }
        let length = w.number(h);
        self.kept(w, i, (t, length), only)
    }

    /// The same of a length that may change.
    pub(super) fn kept(
        &mut self,
        mut w: Writer,
        i: usize,
        (t, length): (Value, Value),
        only: bool,
    ) -> Result<Writer, String> {
        let (c, place) = (&self.scene.clusters[i], self.clusters[i].clone());
        w.keep(place.input, t);
        w.keep(place.input + 1, length);
        w.open();
        let mut w = self.program(w, &c.step.program, place.state, place.next, place.input, place.output, &c.name)?;
        let body = w.close();
        counted(&mut w, body, place.iterations);
        if !place.pasts.is_empty() {
            w = self.take_down(w, i, (t, length))?;
        }
        let n = self.start.clusters[i].state.len();
        if only && n > WRITTEN && !c.is_traced() {
            self.late.push(Late { state: place.state..place.state + n, next: place.next });
        } else {
            keep(&mut w, place.state..place.state + n, place.next);
        }
        self.book_step(&mut w, i);
        for (k, p) in c.ports.iter().enumerate() {
            let (mean, before) = (w.kept(place.output + p.mean), w.kept(place.moved + k));
            let more = w.mul(length, mean);
            let sum = w.add(before, more);
            w.keep(place.moved + k, sum);
        }
        let traced = if c.is_traced() { c.states } else { 0 };
        some(&mut w, traced, |w, at| {
            let (x, most) = (w.read(place.state, at), w.read(place.largest, at));
            let size = w.abs(x);
            let most = w.larger(most, size);
            w.put_at(place.largest, at, most);
            let part = w.number(1e-6);
            let trace = w.mul(part, most);
            w.put_at(place.input + c.traces_at(), at, trace);
        });
        Ok(w)
    }
}

/// Keeps a new state.
pub(super) fn keep(w: &mut Writer, state: Range<usize>, next: usize) {
    some(w, state.len(), |w, at| {
        let x = w.read(next, at);
        w.put_at(state.start, at, x);
    });
}

/// Does something for each of `n` numbers of the block, without a counter where they are not many: then they can be
/// variables.
fn some(w: &mut Writer, n: usize, mut f: impl FnMut(&mut Writer, At)) {
    if n <= WRITTEN {
        return (0..n).for_each(|i| f(w, At::One(i)));
    }
    w.each(n, f);
}

/// Writes statements, whose iterations are counted in the block where there is a place for that.
fn counted(w: &mut Writer, body: Vec<Stmt>, at: Option<usize>) {
    for s in body {
        match (s, at) {
            (Stmt::Count(n), Some(at)) => {
                let before = w.kept(at);
                let after = w.add(before, n);
                w.keep(at, after);
            }
            (Stmt::If(c, yes, no), Some(_)) => {
                let (yes, no) = (w.block(|w| counted(w, yes, at)), w.block(|w| counted(w, no, at)));
                w.push(Stmt::If(c, yes, no));
            }
            (Stmt::Loop(body), Some(_)) => {
                let body = w.block(|w| counted(w, body, at));
                w.push(Stmt::Loop(body));
            }
            (s, _) => w.push(s),
        }
    }
}
