//! The multi-rate schedule: sampled regions at their instants, continuous ones between.

use super::ahead::Ahead;
use super::cluster::{Book, Look, Run};
use super::given::Course;
use super::hold::{Held, Report, within_budget};
use super::summary::{BarSummary, ElementEnergy, ElementEntropy, Modified, RegionSummary, Summary};
use super::{Error, Options};
use crate::interpreter::Interpret;
use crate::kernel::Backend;
use crate::scene::{Respond, Scene};

/// Energies below this part of the scene's largest are rounding.
const FLOOR: f64 = 1e-14;
/// What a resistor may give in a step, as a part of the energy there: a loop is solved to about 1e-11.
const GAIN: f64 = 1e-9;

/// The clusters of some signals, each once.
fn distinct<'s>(signals: impl IntoIterator<Item = &'s (usize, usize)>) -> Vec<usize> {
    let mut list: Vec<usize> = signals.into_iter().map(|s| s.0).collect();
    list.sort_unstable();
    list.dedup();
    list
}

/// A scene that runs.
pub struct Simulation<'a> {
    pub(super) scene: &'a Scene,
    pub(super) options: Options,
    names: Vec<String>,
    pub(super) runs: Vec<Run>,
    /// By cluster, the ports it holds.
    pub(super) held: Vec<Vec<Held>>,
    /// By cluster, the matrix beta of those ports, its like for the interval after, and what of a motion is left after one.
    pub(super) beta: Vec<Vec<f64>>,
    pub(super) gamma: Vec<Vec<f64>>,
    pub(super) decay: Vec<Vec<f64>>,
    /// By cluster, the next sample's number.
    pub(super) next: Vec<u64>,
    /// Sampled clusters in the order in which they take a common sample: those that answer before those that hold.
    pub(super) order: Vec<usize>,
    /// By cluster, what its tank keeps for an outside that was promised it, J.
    pub(super) reserve: Vec<f64>,
    /// By cluster, whether samples of others concern it.
    pub(super) connected: Vec<bool>,
    pub(super) moved: Vec<Vec<f64>>,
    probes: Option<Look>,
    probe_input: Vec<f64>,
    /// What is given from outside.
    pub(super) given: Vec<Course>,
    /// Answers of open ports for the interval that runs.
    pub(super) open: Vec<Report>,
    pub(super) time: f64,
    pub(super) last_sample: f64,
    respond_input: Vec<Vec<f64>>,
    /// Clusters whose signals others read, and those that probes read.
    pub(super) read: Vec<usize>,
    pub(super) probed: Vec<usize>,
    scratch: Scratch,
    pub(super) ahead: Ahead,
}

/// Room for what a sample works out, so that taking one allocates nothing.
#[derive(Default)]
struct Scratch {
    due: Vec<usize>,
    changes: Vec<f64>,
    alpha: Vec<f64>,
    values: Vec<f64>,
    q: Vec<f64>,
}

impl Scratch {
    /// For so many clusters, and ports held by one of them.
    fn new(clusters: usize, ports: usize) -> Self {
        let room = || Vec::with_capacity(ports);
        Self { due: Vec::with_capacity(clusters), changes: room(), alpha: room(), values: room(), q: room() }
    }
}

impl<'a> Simulation<'a> {
    /// A scene at its start, with the first samples taken.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn new(scene: &'a Scene, options: &Options) -> Result<Self, Error> {
        Self::with(scene, options, Vec::new())
    }

    /// A scene at its start, with the first samples taken. Signals given from outside take the courses listed with their index;
    /// the others are what they are by default. Programs are interpreted.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn with(scene: &'a Scene, options: &Options, courses: Vec<(usize, Course)>) -> Result<Self, Error> {
        Self::on(&Interpret, scene, options, courses)
    }

    /// The same, with programs run by this back end.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn on(
        backend: &dyn Backend,
        scene: &'a Scene,
        options: &Options,
        courses: Vec<(usize, Course)>,
    ) -> Result<Self, Error> {
        let n = scene.clusters.len();
        let names = scene.clusters.iter().map(|c| c.name.clone()).collect();
        let mut given: Vec<Course> = scene.inputs.iter().map(|i| Course::constant(i.value)).collect();
        for (i, course) in courses {
            if let Some(place) = given.get_mut(i) {
                *place = course;
            }
        }
        let runs = scene.clusters.iter().enumerate();
        let runs = runs.map(|(i, c)| Run::new(i, c, &given, options, backend)).collect::<Result<Vec<_>, _>>()?;
        let mut held: Vec<Vec<Held>> = vec![Vec::new(); n];
        for (i, c) in scene.clusters.iter().enumerate() {
            for &port in &c.holds {
                let bar = scene.bars.iter().position(|b| b.holder == (i, port));
                let open = scene.open.iter().position(|o| o.port == (i, port));
                held[i].push(Held { port, bar, open, ..Held::default() });
            }
        }
        let mut connected = vec![false; n];
        for b in &scene.bars {
            connected[b.other.0] = true;
            connected[b.holder.0] = true;
        }
        for (i, c) in scene.clusters.iter().enumerate() {
            connected[i] |= !c.foreign.is_empty();
            for (other, _) in &c.foreign {
                connected[*other] = true;
            }
        }
        let mut order: Vec<usize> = (0..n).filter(|i| scene.clusters[*i].period.is_some()).collect();
        let rank = |i: usize| scene.clusters[i].period.unwrap_or(0.0);
        order.sort_by(|a, b| {
            let answers = |x: usize, y: usize| scene.bars.iter().any(|bar| bar.other.0 == x && bar.holder.0 == y);
            rank(*a).total_cmp(&rank(*b)).then(answers(*b, *a).cmp(&answers(*a, *b))).then(a.cmp(b))
        });
        let respond_input = scene
            .clusters
            .iter()
            .map(|c| {
                c.respond.as_ref().map_or(0, |r| match r {
                    Respond::Last(p) | Respond::Matched(p, _) => p.size(crate::ir::Array::Input),
                })
            })
            .map(|k| vec![0.0; k])
            .collect();
        let mut s = Self {
            scene,
            options: options.clone(),
            names,
            runs,
            beta: vec![Vec::new(); n],
            gamma: vec![Vec::new(); n],
            decay: vec![Vec::new(); n],
            next: vec![0; n],
            order,
            reserve: vec![0.0; n],
            connected,
            moved: scene.clusters.iter().map(|c| vec![0.0; c.ports.len()]).collect(),
            probes: scene.probes.program.as_ref().map(|p| Look::new(p, backend)),
            probe_input: vec![0.0; 1 + scene.probes.gather.len() + scene.probes.inputs.len()],
            given,
            open: vec![Report::default(); scene.open.len()],
            time: 0.0,
            last_sample: 0.0,
            respond_input,
            read: distinct(scene.clusters.iter().flat_map(|c| &c.foreign)),
            probed: distinct(&scene.probes.gather),
            scratch: Scratch::new(n, held.iter().map(Vec::len).max().unwrap_or(0)),
            held,
            ahead: Ahead::new(backend.stretches()),
        };
        // What is driven at a port is driven from the instant on to which it was advanced.
        for open in &scene.open {
            if let Some(fit) = &mut s.runs[open.port.0].fit {
                fit.driven = true;
            }
        }
        for i in s.order.clone() {
            s.find_beta(i);
        }
        s.sample(0.0)?;
        Ok(s)
    }

    /// What it was started with.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Now, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The state of a cluster.
    pub fn state(&self, cluster: usize) -> &[f64] {
        self.runs[cluster].state_at(self.time)
    }

    /// beta of a sampled cluster's ports: how the answer over a period falls with what is held; and gamma, how that over the next
    /// one does.
    fn find_beta(&mut self, i: usize) {
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

    /// Looks again at what lies within steps, as a run that was not interrupted has done.
    pub(super) fn look_again(&mut self) {
        for (c, run) in self.scene.clusters.iter().zip(&mut self.runs).filter(|(_, run)| run.fit.is_some()) {
            let input = run.input.clone();
            let _ = run.look_at(c, &self.names, self.time); // where it fails, whoever looks is told
            run.input = input;
        }
    }

    /// The next sample of any cluster.
    fn next_sample(&self) -> Option<f64> {
        self.order
            .iter()
            .map(|i| self.next[*i] as f64 * self.scene.clusters[*i].period.unwrap_or(0.0))
            .min_by(f64::total_cmp)
    }

    /// Runs to an instant: all samples up to it, that instant's included, are taken.
    ///
    /// # Errors
    /// A step that fails. What was computed until then stays.
    pub fn advance(&mut self, until: f64) -> Result<(), Error> {
        self.leap(until);
        while let Some(at) = self.next_sample().filter(|at| *at <= until * (1.0 + 1e-12)) {
            self.meet(at)?;
            self.sample(at)?;
        }
        let upcoming = self.next_sample();
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_some() {
                continue;
            }
            // Steps of a cluster that samples concern are laid between two samples.
            if let Some(end) = upcoming.filter(|_| self.connected[i])
                && self.runs[i].time() <= self.last_sample * (1.0 + 1e-12)
            {
                self.lay(i, end);
            }
            let mut moved = std::mem::take(&mut self.moved[i]);
            let result = self.runs[i].run_grid(c, &self.names, until, &mut moved);
            self.moved[i] = moved;
            result?;
        }
        self.time = self.time.max(until);
        Ok(())
    }

    /// Lays the steps of a continuous cluster from now to the next sample.
    fn lay(&mut self, i: usize, end: f64) {
        let c = &self.scene.clusters[i];
        let now = self.runs[i].time();
        let whole = c.step.linear.is_some() && c.step.order == 0;
        let wanted = self.runs[i].wanted().unwrap_or(if whole { end - now } else { self.runs[i].usual() });
        self.runs[i].regrid(now, end, wanted);
    }

    /// Brings continuous clusters that a sample concerns to its instant.
    fn meet(&mut self, at: f64) -> Result<(), Error> {
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_some() || !self.connected[i] {
                continue;
            }
            if self.runs[i].time() <= self.last_sample * (1.0 + 1e-12) {
                self.lay(i, at);
            }
            let mut moved = std::mem::take(&mut self.moved[i]);
            let result = self.runs[i].finish_at(c, &self.names, at, &mut moved);
            self.moved[i] = moved;
            result?;
        }
        Ok(())
    }

    /// Takes all samples due at an instant.
    fn sample(&mut self, at: f64) -> Result<(), Error> {
        self.time = at;
        self.last_sample = at;
        self.collect();
        let mut scratch = std::mem::take(&mut self.scratch);
        let result = self.take(at, &mut scratch);
        self.scratch = scratch;
        result
    }

    fn take(&mut self, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
        let instant = |s: &Self, i: usize| s.next[i] as f64 * s.scene.clusters[i].period.unwrap_or(0.0);
        scratch.due.clear();
        scratch.due.extend(self.order.iter().filter(|i| (instant(self, **i) - at).abs() <= 1e-12 * at.abs()));
        for k in 0..scratch.due.len() {
            let i = scratch.due[k];
            if self.next[i] > 0 {
                self.commit(i)?;
                self.collect();
            }
        }
        self.refresh_foreign(at, &scratch.due)?;
        for k in (0..scratch.due.len()).rev() {
            let i = scratch.due[k];
            self.respond(i, at, scratch)?;
            self.next[i] += 1;
        }
        self.refresh_foreign(at, &scratch.due)
    }

    /// Hands what continuous and sampled clusters gave out at their ports to those who hold them.
    fn collect(&mut self) {
        for (k, bar) in self.scene.bars.iter().enumerate() {
            let (cluster, port) = bar.other;
            let m = std::mem::take(&mut self.moved[cluster][port]);
            if m == 0.0 {
                continue;
            }
            let q = bar.sign * m;
            let input = self.runs[cluster].input[self.scene.clusters[cluster].ports[port].input];
            if let Some(h) = self.held[bar.holder.0].iter_mut().find(|h| h.bar == Some(k)) {
                h.q += q;
                // The other side latched `sign * v`, perhaps of an earlier sample of the holder.
                h.w += bar.sign * input * q;
            }
        }
    }

    /// Whether what a held port answers to is itself sampled, and may have latched an earlier value than the one held now.
    fn latches(&self, h: &Held) -> bool {
        h.bar.is_some_and(|b| self.scene.clusters[self.scene.bars[b].other.0].period.is_some())
    }

    /// Ends the interval of a sampled cluster: its state moves with what was reported.
    fn commit(&mut self, i: usize) -> Result<(), Error> {
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
            // Each side counts for itself: the holder what it held times what it was told, the other what it told times what it met.
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

    /// Books what crossed in the place of what the step's own effort would have let in, and what that leaves in the tank.
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
    fn respond(&mut self, i: usize, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
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

    /// What to hold where a switched law leaves no solution: on the jump of the law, where the answer q is such that the law
    /// calls for less than v = (alpha - q)/beta on one side of it and for more on the other. One port: by bisection, v being
    /// monotone in q. Several: one after the other, a few times over.
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

    /// Samples the signals that clusters read of each other, and those given from outside: continuous clusters at each sample,
    /// sampled ones when they are due.
    fn refresh_foreign(&mut self, at: f64, due: &[usize]) -> Result<(), Error> {
        for k in 0..self.read.len() {
            let i = self.read[k];
            self.runs[i].observe(&self.scene.clusters[i], &self.names, at)?;
        }
        for (i, c) in self.scene.clusters.iter().enumerate() {
            if c.period.is_some() && !due.contains(&i) {
                continue;
            }
            let run = &mut self.runs[i];
            if c.period.is_some() {
                run.feed.latch(&mut run.input, at);
            }
            for (k, (cluster, output)) in c.foreign.iter().enumerate() {
                let x = self.runs[*cluster].instant.work.output[*output];
                self.runs[i].input[c.foreign_at + k] = x;
            }
        }
        Ok(())
    }

    /// Probes, then the values of expectations, now.
    ///
    /// # Errors
    /// A program that fails.
    pub fn probes(&mut self) -> Result<&[f64], Error> {
        for k in 0..self.probed.len() {
            let i = self.probed[k];
            self.runs[i].observe(&self.scene.clusters[i], &self.names, self.time)?;
        }
        self.probe_input[0] = self.time;
        for (k, (cluster, output)) in self.scene.probes.gather.iter().enumerate() {
            self.probe_input[1 + k] = self.runs[*cluster].instant.work.output[*output];
        }
        let at = 1 + self.scene.probes.gather.len();
        for (slot, i) in self.probe_input[at..].iter_mut().zip(&self.scene.probes.inputs) {
            *slot = self.given[*i].value(self.time);
        }
        match &mut self.probes {
            None => Ok(&[]),
            Some(look) => look.run(&[], &self.probe_input).map_err(|why| Error::Step {
                time: self.time,
                region: "the probes".into(),
                state: None,
                why,
            }),
        }
    }

    /// Ends the run at an instant: continuous regions take the step that is left.
    ///
    /// # Errors
    /// A step that fails.
    pub fn finish(&mut self, at: f64) -> Result<(), Error> {
        self.advance(at)?;
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_none() {
                let mut moved = std::mem::take(&mut self.moved[i]);
                let result = self.runs[i].run_to(c, &self.names, at, &mut moved);
                self.moved[i] = moved;
                result?;
            }
        }
        self.time = at;
        Ok(())
    }

    /// What the open ports hold now, in the scene's order.
    pub fn held(&self) -> Vec<f64> {
        (0..self.scene.open.len()).map(|o| self.held_at(o)).collect()
    }

    /// What an open port holds now: an effort, or a flow into the scene; 0 where a continuous region meets it.
    pub fn held_at(&self, open: usize) -> f64 {
        let held = self.held.iter().flatten().find(|h| h.open == Some(open));
        held.map_or(0.0, |h| self.scene.open[open].sign() * h.v)
    }

    /// What a sampled cluster could give back of what it was given, J: what it stores, and what it dissipated and keeps in its
    /// tank. Below 0 where it is in debt.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn kept(&self, cluster: usize) -> f64 {
        self.runs[cluster].books.iter().map(|b| b.h + b.tank).sum()
    }

    /// Keeps so much for the outside, J, though the tank be fuller than its cap: it was promised, and may be drawn yet.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn reserve(&mut self, cluster: usize, energy: f64) {
        self.reserve[cluster] = energy;
    }

    /// Reports how far an open port moved in the interval that runs.
    ///
    /// # Panics
    /// If there is no such open port.
    pub fn report(&mut self, open: usize, q: f64) {
        self.tell(open, Report { q, ..Report::default() });
    }

    /// The same in full: of an outside that is behind a line which delays and loses.
    ///
    /// # Panics
    /// If there is no such open port.
    pub fn tell(&mut self, open: usize, report: Report) {
        self.open[open] = Report { q: self.scene.open[open].sign() * report.q, ..report };
    }

    /// Sets what the outside gives at an open port of a continuous region from now on: the effort or flow that causality asks of
    /// it, along the half arrow. A port that a sampled region holds takes [`Self::report`] instead.
    ///
    /// # Panics
    /// If there is no such open port.
    pub fn drive(&mut self, open: usize, value: f64) {
        let (cluster, port) = self.scene.open[open].port;
        let c = &self.scene.clusters[cluster];
        if c.period.is_none() {
            self.runs[cluster].input[c.ports[port].input] = self.scene.open[open].along * value;
        }
    }

    /// Sets a signal given from outside, from now on; a sampled region meets it at its next sample.
    ///
    /// # Panics
    /// If there is no such input.
    pub fn set_input(&mut self, input: usize, value: f64) {
        let now = self.time;
        for (c, run) in self.scene.clusters.iter().zip(&mut self.runs) {
            for k in (0..c.inputs.len()).filter(|k| c.inputs[*k] == input) {
                // A sampled cluster looks at its next sample only.
                let past = if c.period.is_some() { now } else { run.time() };
                run.feed.set(k, now, value, past);
                run.drop_plan();
            }
        }
        self.given[input].set(now, value, now);
    }

    /// The ledger.
    pub fn summary(&self) -> Summary {
        let mut regions = Vec::new();
        let mut gained = Vec::new();
        let books: Vec<_> =
            self.scene.clusters.iter().zip(&self.runs).map(|(c, run)| run.books_at(c, self.time)).collect();
        let largest = books.iter().flat_map(|b| b.iter()).map(Book::largest).fold(0.0, f64::max);
        for (r, region) in self.scene.regions.iter().enumerate() {
            let c = &self.scene.clusters[region.cluster];
            let run = &self.runs[region.cluster];
            let Some(k) = c.entries.iter().position(|e| e.region == r) else { continue };
            let (b, e) = (&books[region.cluster][k], &c.entries[k]);
            let (control, newton_iterations) = run.kept();
            let list = |names: &[(String, usize)], sums: &[crate::ledger::Sum]| {
                names.iter().zip(sums).map(|(n, s)| ElementEnergy { name: n.0.clone(), energy: s.value() }).collect()
            };
            let floor = b.floor().max(FLOOR * largest);
            gained.push((b.gained.above(floor), b.giver, b.crossed_max));
            regions.push(RegionSummary {
                name: region.name.clone(),
                kind: if region.period.is_some() { "sampled" } else { "continuous" },
                period: region.period,
                states: region.states,
                stepper: c.step.name.clone(),
                why: c.step.why.clone(),
                order: c.step.order,
                hold: Some(c.hold.clone()).filter(|h| !h.is_empty() && !c.holds.is_empty()),
                steps: run.steps,
                rejected: control.map_or(0, |k| k.rejected),
                events: control.map_or(0, |k| k.events),
                newton_iterations,
                h_initial: b.h_initial,
                h_final: b.h,
                h_max: b.h_max,
                supplied: b.supplied.value(),
                dissipated: b.dissipated.value(),
                leaked: b.leaked.value(),
                debt_max: b.debt_max,
                tank: b.tank,
                leaps: b.leaps,
                worst_step: b.worst.above(floor),
                total: if b.largest() > 0.0 { b.residual.abs() / b.largest() } else { 0.0 },
                passive_stepper: c.step.passive,
                pseudo: region.pseudo,
                modified: e.modified.map(|_| Modified {
                    difference: b.modified.0,
                    max_difference: b.modified.1,
                    relative: if b.largest() > 0.0 { b.modified.1 / b.largest() } else { 0.0 },
                }),
                sources: list(&e.supplied, &b.sources),
                resistors: list(&e.dissipated, &b.resistors),
                produced: e
                    .produced
                    .iter()
                    .zip(&b.produced)
                    .map(|(n, s)| ElementEntropy { name: n.0.clone(), entropy: s.value() })
                    .collect(),
                sunk: if b.entropy > 0.0 { b.sunk / b.entropy } else { 0.0 },
            });
        }
        let bars = self
            .scene
            .bars
            .iter()
            .enumerate()
            .filter_map(|(i, bar)| {
                let h = self.held.iter().flatten().find(|h| h.bar == Some(i))?;
                Some(BarSummary {
                    name: bar.name.clone(),
                    holder: h.holder_energy.value(),
                    other: h.other_energy.value(),
                    difference: h.difference,
                })
            })
            .collect();
        let mut reasons: Vec<String> = self.scene.excluded.clone();
        for (region, (gained, (giver, least), crossed)) in regions.iter().zip(gained) {
            if !region.passive_stepper {
                reasons.push(format!(
                    "`{}` was stepped by {}, which does not keep the balance",
                    region.name, region.stepper
                ));
            }
            if region.passive_stepper && (region.worst_step > 1e-12 || region.worst_step.is_nan()) {
                reasons
                    .push(format!("the balance of `{}` was off by {:.1e} in a step", region.name, region.worst_step));
            }
            let scale = region.h_max.max(region.supplied.abs()).max(crossed);
            if region.debt_max > (1e-11 * scale).max(10.0 * FLOOR * largest) {
                reasons.push(format!(
                    "`{}` gave out up to {:.3e} J more than it had been given",
                    region.name, region.debt_max
                ));
            }
            if region.sunk > 1e-12 {
                reasons.push(format!("entropy fell in `{}`", region.name));
            }
            if gained > GAIN {
                let name = region.resistors.get(giver).map_or("", |r| &r.name);
                reasons.push(format!("`{name}` in `{}` gave energy, up to {:.1e} J in a step", region.name, -least));
            }
        }
        let passive_ones = || regions.iter().filter(|r| r.passive_stepper);
        Summary {
            time: self.time,
            passive: reasons.is_empty(),
            reasons,
            worst_step: passive_ones().map(|r| r.worst_step).fold(0.0, f64::max),
            total: passive_ones().map(|r| r.total).fold(0.0, f64::max),
            regions,
            bars,
        }
    }
}
