//! The multi-rate schedule: sampled regions at their instants, continuous ones between.

use super::block_routine::BlockExecution;
use super::cluster::Run;
use super::hold::{Held, Report, Tangent};
use super::input_signal::InputSignal;
use super::joined::Joined;
use super::kept::Before;
use super::program::Look;
use super::rate_transition::RateTransition;
use super::sampling::Scratch;
use super::stepping::Stepping;
use super::{Error, Options};
use crate::energy::interval;
use crate::interpreter::Interpret;
use crate::kernel::Backend;
use crate::machine::Real;
use crate::scene::Scene;

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
    pub(super) runs: Vec<Run>,
    /// By cluster, how its steps are laid.
    pub(super) stepping: Vec<Stepping>,
    /// By cluster, the ports it holds.
    pub(super) held: Vec<Vec<Held>>,
    /// By cluster, the matrix port_admittance of those ports, its likes for the intervals after, and the recurrence of
    /// each port.
    pub(super) port_admittance: Vec<Vec<f64>>,
    pub(super) delayed_response: Vec<Vec<f64>>,
    pub(super) ar_coefficients: Vec<Vec<f64>>,
    /// Which of them are taken anew at each sample.
    pub(super) tangents: Vec<Vec<Tangent>>,
    /// By cluster, the clock that it goes by, if not its own.
    pub(super) transitions: Vec<Option<RateTransition>>,
    /// By cluster, the next sample's number.
    pub(super) next: Vec<u64>,
    /// What [`Scene::order`] says.
    pub(super) order: Vec<usize>,
    /// By cluster, whether samples of others concern it.
    pub(super) connected: Vec<bool>,
    /// Continuous clusters that meet a budget within the interval, and by cluster whether it is one of them.
    pub(super) joined: Vec<Joined>,
    is_joined: Vec<bool>,
    /// Room for what a sampled cluster meets, and what there was before steps that may have to be taken again.
    pub(super) latched: Vec<f64>,
    pub(super) before: Before,
    /// By cluster and port, which part of what is held for it its last step met, and which part of what the step gave
    /// out was answered.
    pub(super) parts: Vec<Vec<[f64; 2]>>,
    /// By cluster, whether it may give no more than it has at the instant that is: it did when nobody was limited.
    pub(super) limited: Vec<bool>,
    pub(super) moved: Vec<Vec<f64>>,
    probes: Option<Look>,
    probe_input: Vec<f64>,
    /// What is given from outside.
    pub(super) given: Vec<InputSignal>,
    /// Answers of open ports for the interval that runs.
    pub(super) open: Vec<Report>,
    pub(super) time: f64,
    pub(super) last_sample: f64,
    pub(super) respond_input: Vec<Vec<f64>>,
    /// Clusters whose signals others read, and those that probes read.
    pub(super) read: Vec<usize>,
    pub(super) probed: Vec<usize>,
    scratch: Scratch,
    pub(super) block_execution: BlockExecution,
}

impl<'a> Simulation<'a> {
    /// A scene at its start, with the first samples taken.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn new(scene: &'a Scene, options: &Options) -> Result<Self, Error> {
        Self::with(scene, options, Vec::new())
    }

    /// A scene at its start, with the first samples taken. Signals given from outside take the signals listed with
    /// their index; the others are what they are by default. Programs are interpreted.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn with(scene: &'a Scene, options: &Options, signals: Vec<(usize, InputSignal)>) -> Result<Self, Error> {
        Self::on(&Interpret, scene, options, signals)
    }

    /// The same, with programs run by this back end.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub fn on(
        backend: &dyn Backend,
        scene: &'a Scene,
        options: &Options,
        signals: Vec<(usize, InputSignal)>,
    ) -> Result<Self, Error> {
        let n = scene.clusters.len();
        let mut given: Vec<InputSignal> = scene.inputs.iter().map(|i| InputSignal::constant(i.value)).collect();
        for (i, signal) in signals {
            if let Some(place) = given.get_mut(i) {
                *place = signal;
            }
        }
        let clusters = scene.clusters.iter().enumerate();
        let started = clusters.map(|c| Stepping::start(c, &given, (options, scene), backend));
        let (runs, stepping) = started.collect::<Result<(Vec<_>, Vec<_>), _>>()?;
        let mut held: Vec<Vec<Held>> = vec![Vec::new(); n];
        for (i, c) in scene.clusters.iter().enumerate() {
            for &port in &c.holds {
                let bar = scene.bars.iter().position(|b| b.holder == (i, port));
                let open = scene.open.iter().position(|o| o.port == (i, port));
                held[i].push(Held { bar, open, ..Held::default() });
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
        let respond_input = scene
            .clusters
            .iter()
            .map(|c| vec![0.0; c.respond.as_ref().map_or(0, |r| r.program.size(crate::ir::Array::Input))])
            .collect();
        let mut s = Self {
            scene,
            options: options.clone(),
            runs,
            stepping,
            port_admittance: vec![Vec::new(); n],
            delayed_response: vec![Vec::new(); n],
            ar_coefficients: vec![Vec::new(); n],
            tangents: (0..n).map(|_| Vec::new()).collect(),
            transitions: RateTransition::all(scene),
            next: vec![0; n],
            order: scene.order(),
            connected,
            joined: Joined::all(scene),
            is_joined: vec![false; n],
            before: Before::of(scene),
            limited: vec![false; n],
            parts: scene.clusters.iter().map(|c| vec![[1.0; 2]; c.ports.len()]).collect(),
            latched: Vec::with_capacity(scene.clusters.iter().map(|c| c.ports.len()).max().unwrap_or(0)),
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
            block_execution: BlockExecution::new(backend.block_maker()),
        };
        s.joined.iter().flat_map(Joined::clusters).for_each(|i| s.is_joined[i] = true);
        for i in s.order.clone() {
            s.measure_port_admittance(i);
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

    /// Up to where steps are taken, s: what is looked at beyond lies within a fixed step, or within the period of a
    /// sampled region, whose step may fail yet. Fitted steps are tried before.
    pub fn settled(&self) -> f64 {
        let settled = |i: usize| match (self.scene.clusters[i].period, &self.stepping[i]) {
            (Some(_), _) => self.own_time(i, self.time),
            (None, Stepping::Fixed(_)) => self.runs[i].time(),
            (None, Stepping::Fitted(_)) => f64::INFINITY,
        };
        (0..self.runs.len()).map(settled).fold(self.time, f64::min)
    }

    /// The state of a cluster.
    pub fn state(&self, cluster: usize) -> &[f64] {
        self.stepping[cluster].state_at(&self.runs[cluster], self.time)
    }

    /// Looks again at what lies within steps, as a run that was not interrupted has done.
    pub(super) fn look_again(&mut self) {
        for ((c, run), stepping) in self.scene.clusters.iter().zip(&mut self.runs).zip(&mut self.stepping) {
            let input = run.input.clone();
            let _ = stepping.look_at(run, c, self.time); // where it fails, whoever looks is told
            run.input = input;
        }
    }

    /// The next instant at which any cluster samples, or what it found at its last sample arrives.
    fn next_sample(&self) -> Option<f64> {
        let samples = self.order.iter().map(|i| self.instant(*i, self.next[*i]));
        let arrivals = self.order.iter().filter_map(|i| self.arrival(*i));
        samples.chain(arrivals).min_by(f64::total_cmp)
    }

    /// Runs to an instant: all samples up to it, that instant's included, are taken.
    ///
    /// # Errors
    /// A step that fails. What was computed until then stays, and now is the end of the last good step.
    pub fn advance(&mut self, until: f64) -> Result<(), Error> {
        let since = self.time;
        let result = self.run_on(until);
        self.reached(since, result)
    }

    /// After a failure the time is how far all clusters came, and no earlier than it was.
    fn reached(&mut self, since: f64, result: Result<(), Error>) -> Result<(), Error> {
        if result.is_err() {
            let clusters = self.scene.clusters.iter().zip(&self.runs);
            let times = clusters.filter(|(c, _)| c.period.is_none()).map(|(_, run)| run.time());
            let so_far = since.max(self.last_sample);
            self.time = times.min_by(f64::total_cmp).map_or(so_far, |all| so_far.max(all));
        }
        result
    }

    fn run_on(&mut self, until: f64) -> Result<(), Error> {
        let mut failed = self.run_blocks(until);
        while let Some(at) = self.next_sample().filter(|at| *at <= until * (1.0 + 1e-12)) {
            self.meet(at)?;
            self.sample(at)?;
            if failed {
                failed = self.run_blocks(until);
            }
        }
        let upcoming = self.next_sample();
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_some() || self.is_joined[i] {
                continue;
            }
            // Steps of a cluster that samples concern are laid between two samples.
            if let Some(end) = upcoming.filter(|_| self.connected[i])
                && self.runs[i].time() <= self.last_sample * (1.0 + 1e-12)
            {
                self.stepping[i].lay(&mut self.runs[i], end);
            }
            self.stepping[i].run_past(&mut self.runs[i], c, until, &mut self.moved[i])?;
        }
        if let Some(end) = upcoming {
            (0..self.joined.len()).try_for_each(|g| self.run_joined(g, until, end))?;
        }
        self.time = self.time.max(until);
        Ok(())
    }

    /// Brings continuous clusters that a sample concerns to its instant.
    fn meet(&mut self, at: f64) -> Result<(), Error> {
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_some() || !self.connected[i] || self.is_joined[i] {
                continue;
            }
            if self.runs[i].time() <= self.last_sample * (1.0 + 1e-12) {
                self.stepping[i].lay(&mut self.runs[i], at);
            }
            self.stepping[i].finish_at(&mut self.runs[i], c, at, &mut self.moved[i])?;
        }
        (0..self.joined.len()).try_for_each(|g| self.meet_joined(g, at))
    }

    /// Takes all samples due at an instant.
    fn sample(&mut self, at: f64) -> Result<(), Error> {
        self.time = at;
        self.last_sample = at;
        self.joined.iter_mut().for_each(Joined::forget);
        self.hand_over_moved();
        let mut scratch = std::mem::take(&mut self.scratch);
        let result = self.take(at, &mut scratch);
        self.scratch = scratch;
        result
    }

    fn take(&mut self, at: f64, scratch: &mut Scratch) -> Result<(), Error> {
        scratch.due.clear();
        scratch
            .due
            .extend(self.order.iter().filter(|i| (self.instant(**i, self.next[**i]) - at).abs() <= 1e-12 * at.abs()));
        for i in 0..self.runs.len() {
            if self.arrival(i).is_some_and(|arrival| (arrival - at).abs() <= 1e-12 * at.abs()) {
                self.arrive(i);
            }
        }
        if scratch.due.is_empty() {
            return Ok(());
        }
        scratch.is_due.fill(false);
        scratch.due.iter().for_each(|i| scratch.is_due[*i] = true);
        self.end_intervals(&scratch.due)?;
        self.hand_over_to_others(&scratch.is_due);
        self.refresh_foreign(at, &scratch.is_due)?;
        for k in (0..scratch.due.len()).rev() {
            let i = scratch.due[k];
            self.respond(i, at, scratch)?;
            self.next[i] += 1;
        }
        self.refresh_foreign(at, &scratch.is_due)
    }

    /// Hands what continuous clusters gave out at their ports to those who hold them.
    pub(super) fn hand_over_moved(&mut self) {
        self.collect(None);
    }

    /// Hands what continuous and sampled clusters gave out at their ports to those who hold them; of sampled ones, what
    /// the one that has just ended an interval did.
    pub(super) fn collect(&mut self, ended: Option<usize>) {
        for (k, bar) in self.scene.bars.iter().enumerate() {
            let (cluster, port) = bar.other;
            let m = std::mem::take(&mut self.moved[cluster][port]);
            if m == 0.0 && ended != Some(cluster) {
                continue;
            }
            // The other side latched what it met, perhaps of an earlier sample of the holder.
            let met = self.met(bar);
            let rate = match ended {
                Some(_) => bar.sign * self.runs[cluster].output()[self.scene.clusters[cluster].ports[port].mean],
                None => 0.0,
            };
            let by_clock = self.transitions[bar.holder.0].is_some();
            let length = if ended.is_some() { self.length(cluster, self.next[cluster] - 1) } else { 0.0 };
            let Run { layout, ledger, .. } = &self.runs[bar.holder.0];
            let mut held = self.held[bar.holder.0].iter_mut().zip(&layout.held);
            if let Some((h, p)) = held.find(|(h, _)| h.bar == Some(k)) {
                let moved = bar.sign * m;
                let read = h.encoder.read(moved, bar.resolution);
                // Of a held flow that is met less, less is answered, as through a transformer: an impulse without its
                // energy would drive the holder. Who holds an effort follows all of a motion.
                let [met_part, part] = if ended.is_some() { self.parts[cluster][port] } else { [1.0; 2] };
                let told = if bar.holds_flow() { met_part * part } else { 1.0 };
                h.unmet.time += (1.0 - met_part) * length;
                h.unmet.motion += (1.0 - told) * read;
                let q = told * read - std::mem::take(&mut h.ahead);
                if by_clock {
                    h.got += q;
                } else {
                    ledger.set(p.q, ledger.get(p.q) + q);
                }
                h.rate = told * rate;
                ledger.set(p.w, ledger.get(p.w) + met * (part * moved));
            }
        }
    }

    /// What a cluster takes for the time: a sampled one that of its last sample, which it holds.
    fn own_time(&self, i: usize, t: f64) -> f64 {
        match self.scene.clusters[i].period {
            Some(_) => self.instant(i, self.next[i].saturating_sub(1)),
            None => t,
        }
    }

    /// Samples the signals that clusters read of each other, and those given from outside: continuous clusters at each
    /// sample, sampled ones when they are due.
    fn refresh_foreign(&mut self, at: f64, due: &[bool]) -> Result<(), Error> {
        for k in 0..self.read.len() {
            let i = self.read[k];
            let t = if due[i] { at } else { self.own_time(i, at) };
            self.stepping[i].observe(&mut self.runs[i], &self.scene.clusters[i], t)?;
        }
        for (i, c) in self.scene.clusters.iter().enumerate() {
            if c.period.is_some() && !due[i] {
                continue;
            }
            let run = &mut self.runs[i];
            if c.period.is_some() {
                run.signals.latch(&mut run.input, at);
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
            let t = self.own_time(i, self.time);
            self.stepping[i].observe(&mut self.runs[i], &self.scene.clusters[i], t)?;
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
                jumps: Vec::new(),
            }),
        }
    }

    /// Ends the run at an instant: continuous regions take the step that is left.
    ///
    /// # Errors
    /// A step that fails.
    pub fn finish(&mut self, at: f64) -> Result<(), Error> {
        let since = self.time;
        self.advance(at)?;
        for i in 0..self.runs.len() {
            let c = &self.scene.clusters[i];
            if c.period.is_none() {
                let result = self.stepping[i].run_to(&mut self.runs[i], c, at, &mut self.moved[i]);
                if result.is_err() {
                    return self.reached(since, result);
                }
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
        let open = &self.scene.open[open];
        let Run { layout, ledger, .. } = &self.runs[open.port.0];
        let held = layout.held.iter().find(|p| p.port == open.port.1);
        held.map_or(0.0, |p| open.sign() * ledger.get(p.v))
    }

    /// What an open port holds from the latency of its region on, after the last sample: the same where it has none.
    pub fn found_at(&self, open: usize) -> f64 {
        let (cluster, port) = self.scene.open[open].port;
        let mut held = self.held[cluster].iter().zip(&self.runs[cluster].layout.held);
        let found = held.find(|(_, p)| p.port == port).and_then(|(h, _)| h.next);
        found.map_or_else(|| self.held_at(open), |v| self.scene.open[open].sign() * v)
    }

    /// What a sampled cluster could give back of what it was given, J: what it stores, and what it dissipated and keeps
    /// in its tank. Below 0 where it is in debt.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn kept(&self, cluster: usize) -> f64 {
        interval::stored(Real::new(), self.sampling(cluster), &self.runs[cluster].layout)
    }

    /// Keeps so much for the outside, J, though the tank be fuller than its cap: it was promised, and may be drawn yet.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn reserve(&mut self, cluster: usize, energy: f64) {
        let Run { layout, ledger, .. } = &self.runs[cluster];
        layout.stake.reserve.into_iter().for_each(|at| ledger.set(at, energy));
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

    /// Sets what the outside gives at an open port of a continuous region from now on: the effort or flow that
    /// causality asks of it, along the half arrow. A port that a sampled region holds takes [`Self::report`] instead.
    ///
    /// # Panics
    /// If there is no such open port.
    pub fn drive(&mut self, open: usize, value: f64) {
        let (cluster, port) = self.scene.open[open].port;
        let c = &self.scene.clusters[cluster];
        if c.period.is_none() {
            self.runs[cluster].input[c.ports[port].input] = self.scene.open[open].along * value;
            self.joined.iter_mut().for_each(Joined::forget);
        }
    }

    /// The wave that left over the last interval at an open port that carries waves: e + Z f, f counted into the port.
    ///
    /// # Panics
    /// If there is no such port.
    pub fn wave_left(&self, port: usize) -> f64 {
        let w = &self.scene.waves[port];
        self.runs[w.cluster].signals.lines.left(w.line)
    }

    /// Tells the wave that comes in over the next interval at an open port that carries waves, e - Z f there. It comes
    /// in once: where nothing is told, 0 does.
    ///
    /// # Panics
    /// If there is no such port.
    pub fn wave_comes(&mut self, port: usize, wave: f64) {
        let w = &self.scene.waves[port];
        self.runs[w.cluster].signals.lines.comes(w.line, wave);
        self.joined.iter_mut().for_each(Joined::forget);
    }

    /// Sets a signal given from outside, from now on; a sampled region meets it at its next sample.
    ///
    /// # Panics
    /// If there is no such input.
    pub fn set_input(&mut self, input: usize, value: f64) {
        let now = self.time;
        for ((c, run), stepping) in self.scene.clusters.iter().zip(&mut self.runs).zip(&mut self.stepping) {
            for k in (0..c.inputs.len()).filter(|k| c.inputs[*k] == input) {
                // A sampled cluster looks at its next sample only.
                let past = if c.period.is_some() { now } else { run.time() };
                run.signals.set(k, now, value, past);
                stepping.drop_plan(run, c);
            }
        }
        self.joined.iter_mut().for_each(Joined::forget);
        self.given[input].set(now, value, now);
    }
}
