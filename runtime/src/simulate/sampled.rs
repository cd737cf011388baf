//! An interval of a sampled region: what it holds from its start on, and what is booked at its end.

use super::Error;
use super::cluster::Run;
use super::hold::{Held, LetGo, Unmet};
use super::rate_transition::port_admittance_of;
use super::sampling::{Sampling, Scratch};
use super::schedule::Simulation;
use crate::energy::hold::{self, Holder};
use crate::energy::{AR_ORDER, HeldPlaces, Memory, interval};
use crate::kernel::Failure;
use crate::machine::Real;
use crate::scene::Entries;

impl Simulation<'_> {
    /// Whether what a held port answers to is itself sampled, and may have latched an earlier value than the one held
    /// now.
    fn latches(&self, h: &Held) -> bool {
        h.bar.is_some_and(|b| self.scene.clusters[self.scene.bars[b].other.0].period.is_some())
    }

    /// Whether the energy of an interval at a held port is summed up on the way: it is not what is held times what is
    /// read of the other side's motion.
    fn is_summed(&self, i: usize, h: &Held) -> bool {
        let is_late = self.scene.clusters[i].latency > 0.0;
        self.latches(h) || h.let_go.is_some() || h.bar.is_some_and(|b| is_late || self.scene.bars[b].resolution > 0.0)
    }

    /// What a sample of a cluster reads and writes; of one that goes by another's clock, for an interval of that.
    pub(super) fn sampling(&self, i: usize) -> Sampling<'_> {
        let responses = [&self.port_admittance[i], &self.delayed_response[i], &self.ar_coefficients[i]];
        Sampling {
            runs: &self.runs,
            cluster: i,
            own: &self.runs[i].ledger.numbers,
            responses: responses.map(Vec::as_slice),
        }
    }

    /// The same for the interval after its `k`-th sample.
    pub(super) fn sampling_after(&self, i: usize, k: u64) -> Sampling<'_> {
        let mut sampling = self.sampling(i);
        sampling.responses[0] = port_admittance_of(&self.transitions[i], &self.port_admittance[i], k);
        sampling
    }

    /// A sampled cluster and its places.
    pub(super) fn holder(&self, i: usize) -> Holder<'_> {
        Holder { cluster: i, layout: &self.runs[i].layout }
    }

    /// Places of a held port.
    pub(super) fn held_places(&self, i: usize, k: usize) -> &HeldPlaces {
        &self.runs[i].layout.held[k]
    }

    /// Ends the interval of a sampled cluster: its state moves with what was reported.
    pub(super) fn commit(&mut self, i: usize) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let last = self.next[i] - 1;
        let (start, period) = (self.instant(i, last), self.length(i, last));
        let rate = 1.0 / period;
        for k in 0..self.held[i].len() {
            let mut counted = self.is_summed(i, &self.held[i][k]);
            let run = &mut self.runs[i];
            let (h, p) = (&mut self.held[i][k], &run.layout.held[k]);
            if let Some(report) = h.open.map(|o| self.open[o]) {
                h.silent = report.silent;
                run.ledger.set(p.q, report.q);
                if let Some(energy) = report.energy {
                    run.ledger.set(p.w, energy);
                    counted = true;
                }
            }
            run.input[c.ports[p.port].input] = -run.ledger.get(p.q) * rate;
            let met = self.held[i][k].bar.map(|b| self.met(&self.scene.bars[b]));
            interval::cross(Real::new(), self.sampling(i), self.held_places(i, k), counted, met);
        }
        self.step_sampled(i, (start, period))?;
        let layouts = self.scene.clusters.iter().zip(self.runs.iter().map(|run| &run.layout));
        interval::settle(Real::new(), self.sampling(i), i, layouts);
        self.runs[i].shorten_leaving();
        self.runs[i].watch(start + period);
        if self.transitions[i].is_some() {
            self.note_answers(i);
        } else {
            (0..self.held[i].len()).for_each(|k| self.learn(i, k));
        }
        for p in &self.runs[i].layout.held {
            self.runs[i].ledger.set(p.q, 0.0);
            self.runs[i].ledger.set(p.w, 0.0);
        }
        for h in &mut self.held[i] {
            (h.let_go, h.unmet) = (None, Unmet::default());
        }
        Ok(())
    }

    /// Notes what is known of the other side of a held port after an interval.
    fn learn(&mut self, i: usize, k: usize) {
        let h = &self.held[i][k];
        let gap = h.open.map_or(0, |o| std::mem::take(&mut self.open[o]).gap);
        if h.silent {
            return;
        }
        let (sampling, holder) = (self.sampling(i), self.holder(i));
        if self.held[i].iter().any(|h| h.let_go.is_some() || h.unmet.time > 0.0) {
            let (p, length) = (self.held_places(i, k), self.length(i, self.next[i] - 1));
            let moved = self.runs[i].ledger.get(p.q) + self.held[i][k].unmet.motion;
            let free_response = moved + self.yielded_to_pulses(i, k);
            let (value, lasted) = self.pulse(i, k);
            // So much of the period was it held.
            let is_let_go = self.held[i][k].let_go.is_some();
            let part = if is_let_go { lasted * (1.0 - self.scene.clusters[i].latency / length) } else { 1.0 };
            hold::note(Real::new(), sampling, p, free_response, part * value);
            sampling.store(p.last_q, sampling.load(p.q));
            return;
        }
        if gap == 0 {
            holder.learn(Real::new(), sampling, k);
            return;
        }
        // All that is known of the motion is its mean; a jump in it would be taken for a push.
        let (p, ledger) = (self.held_places(i, k), &self.runs[i].ledger);
        let mean = ledger.get(p.q) / (f64::from(gap) + 1.0);
        let free_response = mean + holder.yielded_now(Real::new(), sampling, k);
        for n in 0..AR_ORDER + 2 {
            ledger.set(p.free_response.plus(n), free_response);
            ledger.set(p.before.plus(n), ledger.get(p.v));
        }
        ledger.set(p.last_q, mean);
        ledger.set(p.intervals, ledger.get(p.intervals) + 1.0);
    }

    /// What the other side of a held port met in the interval that ends, and for which part of it.
    fn pulse(&self, i: usize, k: usize) -> (f64, f64) {
        let h = &self.held[i][k];
        match h.let_go {
            Some(LetGo { value, lasted }) => (value, lasted),
            None => (h.met(self.runs[i].ledger.get(self.held_places(i, k).v), self.length(i, self.next[i] - 1)), 1.0),
        }
    }

    /// How far the other sides gave way at a held port to what was held for a part of the interval. What was held for x
    /// of it, and all of it at x = 1, has moved them by `(Y - D/2) x + D/2 x²`: by D they move on in the interval
    /// after, which is 0 of a damper, and 2 Y of a mass.
    fn yielded_to_pulses(&self, i: usize, k: usize) -> f64 {
        let (n, admittances, later) = (self.held[i].len(), &self.port_admittance[i], &self.delayed_response[i]);
        let held = (0..n).map(|j| (j, self.pulse(i, j)));
        held.map(|(j, (value, x))| {
            let (yields, on) = (admittances[k * n + j], 0.5 * later[k * n + j]);
            ((yields - on) * x + on * (2.0 * x - x * x)) * value
        })
        .sum()
    }

    /// Begins an interval: finds what to hold, and latches what others hold.
    pub(super) fn respond(&mut self, i: usize, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let next = self.next[i];
        let period = self.length(i, next);
        let rate = 1.0 / self.length(i, next.saturating_sub(1));
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let Run { layout, ledger, .. } = &self.runs[bar.holder.0];
            let v = layout.held.iter().find(|p| p.port == bar.holder.1).map_or(0.0, |p| ledger.get(p.v));
            self.runs[i].input[c.ports[bar.other.1].input] = bar.sign * v;
        }
        let Some(respond) = &c.respond else { return Ok(()) };
        let n = self.held[i].len();
        self.take_tangents(i, at);
        let Scratch { free_response, values, q, ahead, .. } = scratch;
        free_response.clear();
        match &self.transitions[i] {
            None => {
                let predicted = |k| self.holder(i).predicted(Real::new(), self.sampling(i), k);
                free_response.extend((0..n).map(predicted));
            }
            Some(_) => self.predict_ahead(i, (free_response, q), ahead),
        }
        let input = &mut self.respond_input[i];
        let base = self.runs[i].input.len();
        input[..base].copy_from_slice(&self.runs[i].input);
        input[0] = at;
        input[1] = period;
        for p in &self.runs[i].layout.held {
            input[c.ports[p.port].input] = -self.runs[i].ledger.get(p.last_q) * rate;
        }
        let matched = respond.fallback.is_some();
        if matched {
            input[base..base + n].copy_from_slice(free_response);
            let port_admittance = port_admittance_of(&self.transitions[i], &self.port_admittance[i], next);
            input[base + n..base + n + n * n].copy_from_slice(port_admittance);
        }
        values.clear();
        values.resize(n, 0.0);
        let mut foreseen = 0.0;
        {
            let Run { state, respond, layout, ledger, .. } = &mut self.runs[i];
            if let Some(look) = respond {
                let stopped =
                    |why| Error::Step { time: at, region: c.name.clone(), state: None, why, jumps: Vec::new() };
                let out = look.run(state, input).map_err(stopped)?;
                values.copy_from_slice(&out[..n]);
                foreseen = out[n + usize::from(matched)];
                let lost = matched && out[n] == 0.0;
                let mut rests =
                    layout.held.iter().zip(&*free_response).map(|(p, a)| ledger.get(p.last_q) == 0.0 && *a == 0.0);
                if c.budget && !matched && c.entries.iter().any(Entries::is_driven) && rests.all(|r| r) {
                    // From rest, what its sources put in goes by the motion that begins.
                    let (port_admittance, rate) =
                        (port_admittance_of(&self.transitions[i], &self.port_admittance[i], next), 1.0 / period);
                    for (k, p) in layout.held.iter().enumerate() {
                        let given: f64 = (0..n).map(|j| port_admittance[k * n + j] * values[j]).sum();
                        input[c.ports[p.port].input] = given * rate;
                    }
                    foreseen = look.run(state, input).map_err(stopped)?[n];
                }
                if lost {
                    self.search(i, at, free_response, values, q)?;
                }
            }
        }
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::Step {
                time: at,
                region: c.name.clone(),
                state: Some("what it holds".into()),
                why: Failure::NotFinite { slot: crate::ir::Slot::new(crate::ir::Array::Output, 0) },
                jumps: Vec::new(),
            });
        }
        if c.budget {
            let sampling = self.sampling_after(i, next);
            self.holder(i).within_budget(Real::new(), sampling, values, free_response, foreseen);
        }
        for (k, v) in values.iter().copied().enumerate() {
            if std::mem::take(&mut self.held[i][k].silent) {
                continue;
            }
            match c.latency > 0.0 {
                true => self.held[i][k].next = Some(v),
                false => self.put_in_force(i, k, v),
            }
        }
        Ok(())
    }

    /// Holds a value at a port from now on.
    fn put_in_force(&mut self, i: usize, k: usize, v: f64) {
        let (h, Run { layout, ledger, .. }) = (&mut self.held[i][k], &self.runs[i]);
        ledger.set(layout.held[k].v, v);
        h.encoder.most = h.encoder.most.max(v.abs());
        if let Some(b) = h.bar {
            let bar = &self.scene.bars[b];
            let (cluster, port) = bar.other;
            // A continuous side meets it at once; a sampled one latches it at its own instant.
            if self.scene.clusters[cluster].period.is_none() {
                self.runs[cluster].input[self.scene.clusters[cluster].ports[port].input] = bar.sign * v;
            }
        }
    }

    /// When what a cluster found at its last sample arrives, where that is still to come.
    pub(super) fn arrival(&self, i: usize) -> Option<f64> {
        let waits = self.held[i].iter().any(|h| h.next.is_some());
        waits.then(|| self.instant(i, self.next[i] - 1) + self.scene.clusters[i].latency)
    }

    /// Holds what a cluster found at its last sample.
    pub(super) fn arrive(&mut self, i: usize) {
        for k in 0..self.held[i].len() {
            if let Some(v) = self.held[i][k].next.take() {
                self.put_in_force(i, k, v);
            }
        }
    }

    /// What to hold where a switched law leaves no solution: on the jump of the law, where the answer q is such that
    /// the law calls for less than v = (a - q)/Y on one side of it and for more on the other. One port: by bisection,
    /// v being monotone in q. Several: one after the other, a few times over.
    fn search(
        &mut self,
        i: usize,
        at: f64,
        free_response: &[f64],
        values: &mut [f64],
        q: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let rate = 1.0 / self.length(i, self.next[i]);
        let n = values.len();
        let base = self.runs[i].input.len();
        q.clear();
        q.extend_from_slice(free_response);
        let rounds = if n == 1 { 1 } else { 20 };
        for k in (0..rounds * n).map(|k| k % n) {
            let port_admittance = port_admittance_of(&self.transitions[i], &self.port_admittance[i], self.next[i]);
            let own = port_admittance[k * n + k];
            let pull: f64 = (0..n).filter(|j| *j != k).map(|j| port_admittance[k * n + j] * values[j]).sum();
            let free = free_response[k] - pull;
            let call = |this: &mut Self, q: &[f64]| -> Result<f64, Error> {
                let run = &mut this.runs[i];
                for (p, q) in run.layout.held.iter().zip(q) {
                    this.respond_input[i][c.ports[p.port].input] = -q * rate;
                }
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
