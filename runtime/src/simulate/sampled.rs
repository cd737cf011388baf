//! An interval of a sampled region: what it holds from its start on, and what is booked at its end.

use super::Error;
use super::hold::{Held, within_budget};
use super::schedule::Simulation;
use crate::scene::Respond;

/// Room for what a sample works out, so that taking one allocates nothing.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) due: Vec<usize>,
    changes: Vec<f64>,
    alpha: Vec<f64>,
    values: Vec<f64>,
    q: Vec<f64>,
}

impl Scratch {
    /// For so many clusters, and ports held by one of them.
    pub(super) fn new(clusters: usize, ports: usize) -> Self {
        let room = || Vec::with_capacity(ports);
        Self { due: Vec::with_capacity(clusters), changes: room(), alpha: room(), values: room(), q: room() }
    }
}

impl Simulation<'_> {
    /// beta of a sampled cluster's ports: how the answer over a period falls with what is held; and gamma, how that
    /// over the next one does.
    pub(super) fn find_beta(&mut self, i: usize) {
        let n = self.held[i].len();
        let period = self.scene.clusters[i].period.unwrap_or(0.0);
        let mut beta = vec![0.0; n * n];
        let mut gamma = vec![0.0; n * n];
        let mut decay = vec![1.0; n];
        let mut others: Vec<usize> =
            self.held[i].iter().filter_map(|h| h.bar).map(|b| self.scene.bars[b].other.0).collect();
        others.sort_unstable();
        others.dedup();
        for other in others {
            let mine: Vec<usize> =
                (0..n).filter(|k| self.held[i][*k].bar.is_some_and(|b| self.scene.bars[b].other.0 == other)).collect();
            let bars: Vec<&crate::scene::Bar> =
                mine.iter().filter_map(|k| self.held[i][*k].bar).map(|b| &self.scene.bars[b]).collect();
            let ports: Vec<usize> = bars.iter().map(|b| b.other.1).collect();
            let [now, next, later] = self.runs[other].response(&self.scene.clusters[other], period, &ports);
            let m = mine.len();
            for (r, &a) in mine.iter().enumerate() {
                for (s, &b) in mine.iter().enumerate() {
                    // q = sign * integral, input = sign * v, and q = alpha - beta v
                    let sign = -bars[r].sign * bars[s].sign;
                    beta[a * n + b] = sign * now[r * m + s];
                    gamma[a * n + b] = sign * next[r * m + s];
                }
                let (first, second) = (next[r * m + r], later[r * m + r]);
                let left = if first == 0.0 { 1.0 } else { second / first };
                decay[a] = if left.is_finite() { left.clamp(0.0, 1.0) } else { 1.0 };
            }
        }
        for (k, h) in self.held[i].iter().enumerate() {
            if let Some(inertia) = h.open.and_then(|o| self.scene.open[o].inertia) {
                beta[k * n + k] = period * period / (2.0 * inertia);
                gamma[k * n + k] = 2.0 * beta[k * n + k];
            }
        }
        for k in 0..n {
            // A passive other side yields; rounding must not make it push.
            beta[k * n + k] = if beta[k * n + k].is_finite() { beta[k * n + k].max(0.0) } else { 0.0 };
        }
        self.beta[i] = beta;
        self.gamma[i] = gamma;
        self.decay[i] = decay;
    }

    /// Whether what a held port answers to is itself sampled, and may have latched an earlier value than the one held
    /// now.
    fn latches(&self, h: &Held) -> bool {
        h.bar.is_some_and(|b| self.scene.clusters[self.scene.bars[b].other.0].period.is_some())
    }

    /// Ends the interval of a sampled cluster: its state moves with what was reported.
    pub(super) fn commit(&mut self, i: usize) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let period = c.period.unwrap_or(0.0);
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
        let start = (self.next[i] - 1) as f64 * period;
        let mut moved = std::mem::take(&mut self.moved[i]);
        let result = self.runs[i].one(c, &self.names, start, period, &mut moved);
        self.moved[i] = moved;
        result?;
        self.settle(i, crossed);
        let n = self.held[i].len();
        for k in 0..n {
            let response: f64 = (0..n).map(|j| self.beta[i][k * n + j] * self.held[i][j].v).sum();
            let h = &mut self.held[i][k];
            let gap = h.open.map_or(0, |o| std::mem::take(&mut self.open[o]).gap);
            h.learn(response, gap);
        }
        for h in &mut self.held[i] {
            h.q = 0.0;
            h.w = 0.0;
        }
        Ok(())
    }

    /// Books what crossed in the place of what the step's own effort would have let in, and what that leaves in the
    /// tank.
    fn settle(&mut self, i: usize, crossed: f64) {
        let c = &self.scene.clusters[i];
        let run = &mut self.runs[i];
        let out = run.output();
        let called: f64 = self.held[i].iter().map(|h| h.q * out[c.ports[h.port].mean]).sum();
        let leak = called - crossed;
        let dissipated: f64 = c.entries.iter().flat_map(|e| &e.dissipated).map(|d| out[d.1]).sum();
        let leap: f64 = c.entries.iter().filter_map(|e| e.leap).map(|l| out[l.0]).sum();
        for h in &self.held[i] {
            let port = &c.ports[h.port];
            let off = h.crossed - h.q * run.output()[port.mean];
            if let Some(k) = c.entries.first().and_then(|e| e.supplied.iter().position(|s| s.0 == port.name)) {
                run.books[0].sources[k].add(off);
            }
        }
        if let Some(b) = run.books.first_mut() {
            b.supplied.add(-leak);
            b.leaked.add(leak);
            b.crossed_max = b.crossed_max.max(crossed.abs());
            // What was promised is not let go.
            let most = b.h_max.max(self.reserve[i] - b.h);
            b.tank = (b.tank + dissipated - leak - leap).min(most);
            b.debt_max = b.debt_max.max(-(b.h + b.tank));
        }
    }

    /// Begins an interval: finds what to hold, and latches what others hold.
    pub(super) fn respond(&mut self, i: usize, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let period = c.period.unwrap_or(0.0);
        let rate = 1.0 / period;
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let v = self.held[bar.holder.0].iter().find(|h| (bar.holder.0, h.port) == bar.holder).map_or(0.0, |h| h.v);
            self.runs[i].input[c.ports[bar.other.1].input] = bar.sign * v;
        }
        let Some(respond) = &c.respond else { return Ok(()) };
        let n = self.held[i].len();
        let Scratch { changes, alpha, values, q, .. } = scratch;
        changes.clear();
        changes.extend(self.held[i].iter().map(Held::change));
        alpha.clear();
        for (k, h) in self.held[i].iter().enumerate() {
            alpha.push(h.foretold(&self.gamma[i][k * n..(k + 1) * n], changes, self.decay[i][k]));
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
            input[base + n..base + n + n * n].copy_from_slice(&self.beta[i]);
        }
        values.clear();
        values.resize(n, 0.0);
        let mut foreseen = 0.0;
        {
            let run = &mut self.runs[i];
            let state = &run.state;
            if let Some(look) = &mut run.respond {
                let out = look.run(state, input).map_err(|why| Error::Step {
                    time: at,
                    region: self.names.get(i).cloned().unwrap_or_default(),
                    state: None,
                    why,
                })?;
                values.copy_from_slice(&out[..n]);
                foreseen = out[n + usize::from(matched)];
                if matched && out.get(n) == Some(&0.0) {
                    self.search(i, at, alpha, values, q)?;
                }
            }
        }
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::Step {
                time: at,
                region: self.names.get(i).cloned().unwrap_or_default(),
                state: Some("what it holds".into()),
                why: crate::kernel::Failure::NotFinite { slot: crate::ir::Slot::new(crate::ir::Array::Output, 0) },
            });
        }
        if c.budget {
            let stored = self.runs[i].books.first().map_or(0.0, |b| b.h + b.tank);
            within_budget(values, alpha, &self.beta[i], (stored + foreseen.max(0.0)).max(0.0));
        }
        for (h, v) in self.held[i].iter_mut().zip(values.iter().copied()) {
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
        let rate = 1.0 / c.period.unwrap_or(0.0);
        let n = values.len();
        let base = self.runs[i].input.len();
        q.clear();
        q.extend_from_slice(alpha);
        let rounds = if n == 1 { 1 } else { 20 };
        for k in (0..rounds * n).map(|k| k % n) {
            let own = self.beta[i][k * n + k];
            let pull: f64 = (0..n).filter(|j| *j != k).map(|j| self.beta[i][k * n + j] * values[j]).sum();
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
                    region: this.names.get(i).cloned().unwrap_or_default(),
                    state: None,
                    why,
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
