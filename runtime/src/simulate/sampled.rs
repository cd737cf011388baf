//! An interval of a sampled region: what it holds from its start on, and what is booked at its end.

use super::Error;
use super::cluster::{Book, Run};
use super::hold::{BESIDE, Held, LOSS, NOISE, RECURRENCE, TERMS, UNTOLD, within_budget};
use super::pace::beta_of;
use super::schedule::Simulation;
use crate::scene::{Cluster, Entries, Respond};

/// Room for what a sample works out, so that taking one allocates nothing.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) due: Vec<usize>,
    /// The same, by cluster.
    pub(super) is_due: Vec<bool>,
    alpha: Vec<f64>,
    doubt: Vec<f64>,
    ahead: Vec<Held>,
    values: Vec<f64>,
    q: Vec<f64>,
}

impl Scratch {
    /// For so many clusters, and ports held by one of them.
    pub(super) fn new(clusters: usize, ports: usize) -> Self {
        let room = || Vec::with_capacity(ports);
        Self {
            due: Vec::with_capacity(clusters),
            is_due: vec![false; clusters],
            alpha: room(),
            doubt: room(),
            ahead: Vec::with_capacity(ports),
            values: room(),
            q: room(),
        }
    }
}

/// What regions that hold together have to give is one: where one of them is in debt, the others' tanks cover that, and
/// the cap is on all tanks together.
fn share(books: &mut [Book], entries: &[Entries]) {
    if books.len() < 2 {
        return;
    }
    let (mut there, mut lacking) = (0.0, 0.0);
    for b in books.iter() {
        if b.stored < 0.0 {
            lacking -= b.stored;
        } else {
            there += b.stored;
        }
    }
    if there > 0.0 && lacking > 0.0 {
        let cover = if lacking < there { lacking } else { there };
        let (taken, given) = (cover / there, cover / lacking);
        for b in books.iter_mut() {
            b.stored -= b.stored * if b.stored < 0.0 { given } else { taken };
        }
    }
    let (mut over, mut full) = (0.0, 0.0);
    for (b, e) in books.iter().zip(entries) {
        let tank = b.tank();
        over += tank - b.cap(e);
        full += if tank > 0.0 { tank } else { 0.0 };
    }
    if over > 0.0 {
        let part = over / full;
        for b in books.iter_mut().filter(|b| b.tank() > 0.0) {
            b.stored -= b.tank() * part;
        }
    }
}

impl Simulation<'_> {
    /// Whether what a held port answers to is itself sampled, and may have latched an earlier value than the one held
    /// now.
    fn latches(&self, h: &Held) -> bool {
        h.bar.is_some_and(|b| self.scene.clusters[self.scene.bars[b].other.0].period.is_some())
    }

    /// Ends the interval of a sampled cluster: its state moves with what was reported.
    pub(super) fn commit(&mut self, i: usize) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let last = self.next[i] - 1;
        let (start, period) = (self.instant(i, last), self.length(i, last));
        let (rate, mut crossed) = (1.0 / period, 0.0);
        for k in 0..self.held[i].len() {
            let latches = self.latches(&self.held[i][k]);
            let h = &mut self.held[i][k];
            let mut told = None;
            if let Some(o) = h.open {
                h.q = self.open[o].q;
                h.silent = self.open[o].silent;
                told = self.open[o].energy;
            }
            // Each side counts for itself: the holder what it held times what it was told, the other what it told times
            // what it met.
            let (here, there) = match told {
                Some(w) => (w, w),
                None if latches => (h.w, h.w),
                None => (h.v * h.q, h.q * h.v),
            };
            h.crossed = here;
            h.holder_energy.add(here);
            h.other_energy.add(there);
            h.difference = h.difference.max((h.holder_energy.value() - h.other_energy.value()).abs());
            crossed += here;
            self.runs[i].input[c.ports[h.port].input] = -h.q * rate;
        }
        let mut moved = std::mem::take(&mut self.moved[i]);
        let result = self.runs[i].one(c, start, period, &mut moved);
        self.moved[i] = moved;
        result?;
        self.settle(i, crossed);
        if self.pace[i].is_some() {
            self.review_pace(i);
            return Ok(());
        }
        let n = self.held[i].len();
        for k in 0..n {
            let response: f64 = (0..n).map(|j| self.beta[i][k * n + j] * self.held[i][j].v).sum();
            let h = &mut self.held[i][k];
            let gap = h.open.map_or(0, |o| std::mem::take(&mut self.open[o]).gap);
            h.learn(response, gap, &self.decay[i][k * RECURRENCE..(k + 1) * RECURRENCE]);
        }
        for h in &mut self.held[i] {
            h.q = 0.0;
            h.w = 0.0;
        }
        Ok(())
    }

    /// Books what crossed in the place of what the step's own effort would have let in, and what that leaves in the
    /// tanks; `crossed` is that of all its regions.
    fn settle(&mut self, i: usize, crossed: f64) {
        let c = &self.scene.clusters[i];
        let run = &mut self.runs[i];
        let alone = c.entries.len() == 1;
        let mut turned = 0.0;
        for (r, e) in c.entries.iter().enumerate() {
            let (mut called, mut crossed) = (0.0, 0.0);
            for h in self.held[i].iter().filter(|h| c.ports[h.port].region == e.region) {
                let port = &c.ports[h.port];
                called += h.q * run.output()[port.mean];
                crossed += h.crossed;
                turned += h.crossed.abs();
                if let Some(k) = e.supplied.iter().position(|s| s.0 == port.name) {
                    run.books[r].sources[k].add(h.crossed);
                }
            }
            let out = run.output();
            let sources = e.supplied.iter().enumerate().filter(|(k, _)| !e.held.contains(k));
            let sources = sources.map(|(_, (_, slot))| out[*slot]);
            let own: f64 = sources.clone().sum();
            turned = sources.fold(turned, |sum, x| sum + x.abs());
            let b = &mut run.books[r];
            if !e.held.is_empty() {
                b.supplied.add(crossed);
                b.leaked.add(called - crossed);
                b.crossed_max = b.crossed_max.max(crossed.abs());
            }
            b.stored += crossed;
            b.stored += own;
            if alone {
                // What was promised is not let go; several regions have no open ports.
                let most = (b.h + b.cap(e)).max(self.reserve[i]);
                b.stored = b.stored.min(most);
            }
        }
        if run.books.is_empty() {
            return;
        }
        share(&mut run.books, &c.entries);
        let mut stored = 0.0;
        for b in &mut run.books {
            b.debt_max = b.debt_max.max(-b.stored);
            b.stored_max = b.stored_max.max(b.stored);
            stored += b.stored;
        }
        self.caution[i].note(turned);
        let clear = |j: usize, stored: f64| -stored <= LOSS * self.caution[j].most;
        let easy = self.caution[i].is_easy();
        let free = clear(i, stored) && (easy || self.near[i].iter().all(|j| clear(*j, self.kept(*j))));
        let cost = self.caution[i].settle((-stored, free), crossed);
        if cost > 1.0 {
            // What it gave out, the others may lose too.
            for j in &self.near[i] {
                self.caution[*j].trust /= cost;
            }
        }
        if !free {
            self.owe(i);
        }
    }

    /// Notes what debts are beside the energies that there were until now: what comes later excuses none.
    fn owe(&mut self, i: usize) {
        let clusters = self.runs.iter().zip(&self.scene.clusters);
        let of = |(run, c): (&Run, &Cluster)| {
            // What holds alone have a sampled one store is no energy that was there.
            let largest = |b: &Book| if c.period.is_some() { b.stored_max } else { b.largest() };
            run.books.iter().map(largest).fold(0.0, f64::max)
        };
        let largest = clusters.map(of).fold(0.0, f64::max);
        for b in &mut self.runs[i].books {
            let own = b.stored_max.max(b.supplied.value().abs()).max(b.crossed_max);
            b.owed = b.owed.max(-b.stored / own.max(BESIDE * largest));
        }
    }

    /// What alpha of a held port is foretold to be.
    pub(super) fn foretold(&self, i: usize, k: usize, held: &[Held]) -> f64 {
        let n = held.len();
        let r = &self.decay[i][k * RECURRENCE..(k + 1) * RECURRENCE];
        let effect = |p: usize, of: fn(&Held, usize) -> f64| -> f64 {
            if p as f64 >= r[TERMS + 1] {
                return 0.0;
            }
            let gamma = &self.gamma[i][(p * n + k) * n..(p * n + k + 1) * n];
            gamma.iter().zip(held).map(|(g, h)| g * of(h, p)).sum()
        };
        let all = std::array::from_fn(|p| effect(p, |h, p| h.before[p]));
        let changes = std::array::from_fn(|p| effect(p, |h, p| h.before[p] - h.before[p + 1]));
        held[k].foretold(r, all, changes)
    }

    /// Begins an interval: finds what to hold, and latches what others hold.
    pub(super) fn respond(&mut self, i: usize, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let next = self.next[i];
        let period = self.length(i, next);
        let rate = 1.0 / self.length(i, next.saturating_sub(1));
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let v = self.held[bar.holder.0].iter().find(|h| (bar.holder.0, h.port) == bar.holder).map_or(0.0, |h| h.v);
            self.runs[i].input[c.ports[bar.other.1].input] = bar.sign * v;
        }
        let Some(respond) = &c.respond else { return Ok(()) };
        let n = self.held[i].len();
        let Scratch { alpha, doubt, values, q, ahead, .. } = scratch;
        alpha.clear();
        match &self.pace[i] {
            None => alpha.extend((0..n).map(|k| self.foretold(i, k, &self.held[i]))),
            Some(_) => self.foretell_ahead(i, alpha, ahead),
        }
        let input = &mut self.respond_input[i];
        let base = self.runs[i].input.len();
        input[..base].copy_from_slice(&self.runs[i].input);
        input[0] = at;
        input[1] = period;
        for h in &self.held[i] {
            input[c.ports[h.port].input] = -h.last_q * rate;
        }
        let matched = matches!(respond, Respond::Matched(..));
        if matched {
            input[base..base + n].copy_from_slice(alpha);
            let beta = beta_of(&self.pace[i], &self.beta[i], next);
            input[base + n..base + n + n * n].copy_from_slice(beta);
        }
        values.clear();
        values.resize(n, 0.0);
        let mut foreseen = 0.0;
        {
            let run = &mut self.runs[i];
            let state = &run.state;
            if let Some(look) = &mut run.respond {
                let stopped =
                    |why| Error::Step { time: at, region: c.name.clone(), state: None, why, jumps: Vec::new() };
                let out = look.run(state, input).map_err(stopped)?;
                values.copy_from_slice(&out[..n]);
                foreseen = out[n + usize::from(matched)];
                let lost = matched && out[n] == 0.0;
                let mut rests =
                    self.held[i].iter().zip(alpha.iter()).map(|(h, alpha)| h.last_q == 0.0 && *alpha == 0.0);
                if c.budget && !matched && c.entries.iter().any(Entries::is_driven) && rests.all(|r| r) {
                    // From rest, what its sources put in goes by the motion that begins.
                    let (beta, rate) = (beta_of(&self.pace[i], &self.beta[i], next), 1.0 / period);
                    for (k, h) in self.held[i].iter().enumerate() {
                        let given: f64 = (0..n).map(|j| beta[k * n + j] * values[j]).sum();
                        input[c.ports[h.port].input] = given * rate;
                    }
                    foreseen = look.run(state, input).map_err(stopped)?[n];
                }
                if lost {
                    self.search(i, at, alpha, values, q)?;
                }
            }
        }
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::Step {
                time: at,
                region: c.name.clone(),
                state: Some("what it holds".into()),
                why: crate::kernel::Failure::NotFinite { slot: crate::ir::Slot::new(crate::ir::Array::Output, 0) },
                jumps: Vec::new(),
            });
        }
        if c.budget {
            let (mut stored, mut size) = (0.0, 0.0);
            for b in &self.runs[i].books {
                stored += b.stored;
                size += b.h.abs();
            }
            let room = ((stored - NOISE * size) + foreseen.max(0.0)).max(0.0);
            let rules = self.decay[i].chunks(RECURRENCE);
            doubt.clear();
            doubt.extend(self.held[i].iter().zip(rules).map(|(h, r)| h.doubt(r)));
            let beta = beta_of(&self.pace[i], &self.beta[i], next);
            within_budget(values, alpha, std::iter::repeat(0.0), beta, room);
            within_budget(values, alpha, doubt.iter().copied(), beta, 2.0 * room);
            self.caution[i].restrain(values, alpha, doubt.iter().copied(), beta, stored);
            // Once; where others hold for the same, each would have its own.
            let first = self.held[i].iter().all(|h| h.intervals == 0);
            if first && foreseen > 0.0 && self.near[i].is_empty() {
                self.caution[i].risk = UNTOLD;
            }
        }
        for ((h, v), alpha) in self.held[i].iter_mut().zip(values.iter().copied()).zip(alpha.iter()) {
            h.forecast = *alpha;
            if std::mem::take(&mut h.silent) {
                continue;
            }
            h.v = v;
            if let Some(b) = h.bar {
                let bar = &self.scene.bars[b];
                let (cluster, port) = bar.other;
                // A continuous side meets it at once; a sampled one latches it at its own instant.
                if self.scene.clusters[cluster].period.is_none() {
                    self.runs[cluster].input[self.scene.clusters[cluster].ports[port].input] = bar.sign * v;
                }
            }
        }
        Ok(())
    }

    /// What to hold where a switched law leaves no solution: on the jump of the law, where the answer q is such that
    /// the law calls for less than v = (alpha - q)/beta on one side of it and for more on the other. One port: by
    /// bisection, v being monotone in q. Several: one after the other, a few times over.
    fn search(&mut self, i: usize, at: f64, alpha: &[f64], values: &mut [f64], q: &mut Vec<f64>) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let rate = 1.0 / self.length(i, self.next[i]);
        let n = values.len();
        let base = self.runs[i].input.len();
        q.clear();
        q.extend_from_slice(alpha);
        let rounds = if n == 1 { 1 } else { 20 };
        for k in (0..rounds * n).map(|k| k % n) {
            let beta = beta_of(&self.pace[i], &self.beta[i], self.next[i]);
            let own = beta[k * n + k];
            let pull: f64 = (0..n).filter(|j| *j != k).map(|j| beta[k * n + j] * values[j]).sum();
            let free = alpha[k] - pull;
            let call = |this: &mut Self, q: &[f64]| -> Result<f64, Error> {
                for (h, q) in this.held[i].iter().zip(q) {
                    this.respond_input[i][c.ports[h.port].input] = -q * rate;
                }
                let run = &mut this.runs[i];
                let Some(look) = &mut run.fallback else { return Ok(0.0) };
                let input = &this.respond_input[i][..base];
                look.run(&run.state, input).map(|out| out[k]).map_err(|why| Error::Step {
                    time: at,
                    region: c.name.clone(),
                    state: None,
                    why,
                    jumps: Vec::new(),
                })
            };
            q[k] = free;
            let v = call(self, q)?;
            if own == 0.0 || v == 0.0 {
                values[k] = v;
                continue;
            }
            let (mut low, mut high) = (free.min(free - own * v), free.max(free - own * v));
            for _ in 0..100 {
                q[k] = 0.5 * (low + high);
                if q[k] <= low || q[k] >= high {
                    break;
                }
                let v = call(self, q)?;
                if q[k] - free + own * v > 0.0 {
                    high = q[k];
                } else {
                    low = q[k];
                }
            }
            values[k] = (free - q[k]) / own;
        }
        Ok(())
    }
}
