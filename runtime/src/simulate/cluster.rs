//! A cluster as it runs: its state, its steps, its ledger.

use super::delay_line::Record;
use super::guard::Watch;
use super::input_signal::{ClusterInputs, InputSignal};
use super::program::{Look, Ready};
use super::watched::Drawn;
use super::{Error, Options};
use crate::energy::{AccountPlaces, Booking, Layout, Ledger, Waves, account};
use crate::interpreter::Interpret;
use crate::ir::{Array, Slot};
use crate::kernel::{Backend, Failure};
use crate::machine::{Exit, Real};
use crate::scene::{Cluster, Entries, Scene};

/// How often a fixed step that fails is halved.
const HALVINGS: u32 = 12;
/// How often before another stepper takes it, where there is one.
const OWN: u32 = 4;
/// What a step's balance may be off by, as a part of the energy there, where another stepper can take the step.
const OFF: f64 = 2e-14;
/// The same of a step that the other stepper took.
const CLOSES: f64 = 2e-13;
/// What is said of an energy that is no number, where it is that of the storages.
const STORED: &str = "what is stored is not a finite number";
/// Below this part of the largest value of a state, a change is as good as none.
const TRACES: f64 = 1e-6;
/// The part of what is looked at that a last step takes, to which nothing happens any more.
const LAST: f64 = 1.0 / 16.0;

/// A cluster that runs.
pub(super) struct Run {
    pub(super) step: Ready,
    pub(super) glance: Option<Ready>,
    /// Takes what the stepper cannot.
    pub(super) spare: Option<Ready>,
    /// Whether that is what looks go by.
    pub(super) by_spare: bool,
    pub(super) instant: Look,
    /// What laws switch on, and its values at the start of the step.
    pub(super) guards: Option<Watch>,
    pub(super) before: Vec<f64>,
    pub(super) respond: Option<Look>,
    /// What a matched hold falls back to.
    pub(super) fallback: Option<Look>,
    pub(super) state: Vec<f64>,
    /// t, h, ports, foreign signals, what is given from outside, traces, branches of laws.
    pub(super) input: Vec<f64>,
    pub(super) signals: ClusterInputs,
    /// Where the numbers of its ledger are.
    pub(super) layout: Layout,
    pub(super) ledger: Ledger,
    /// What was drawn where an expectation looks.
    pub(super) watched: Vec<Drawn>,
    pub(super) steps: u64,
    /// Its own time: `base + count * h`.
    pub(super) base: f64,
    pub(super) count: u64,
    pub(super) h: f64,
    /// The largest value that each state had, where somebody looks at it.
    pub(super) largest: Vec<f64>,
    traced: bool,
    /// What is looked at.
    pub(super) glanced: Vec<f64>,
    /// What is looked at, while something else is.
    aside: Vec<f64>,
    /// Room for what is taken down of signals that are delayed.
    pub(super) record: Record,
    /// Lines whose ends are here.
    pub(super) waves: Vec<Waves>,
}

impl Run {
    pub(super) fn new(
        (index, c): (usize, &Cluster),
        given: &[InputSignal],
        (options, scene): (&Options, &Scene),
        fitted: bool,
        backend: &dyn Backend,
    ) -> Result<Self, Error> {
        let instant = Look::new(&c.instant, backend);
        let mut stored = Look::new(&c.stored, &Interpret); // looked at once
        let state = c.initial.clone();
        let branch = c.branch().filter(|_| fitted);
        let branches = c.guards.as_ref().filter(|_| branch.is_some()).map_or(0, |g| g.count);
        let mut input = vec![0.0; c.branches_at() + branches];
        let signals = ClusterInputs::new(c, given, options);
        signals.latch(&mut input, 0.0);
        signals.lines.begin(&mut input);
        leave_traces(&mut input, &state, c);
        let n = c.states;
        let out = stored.run(&state, &input).map_err(|why| Error::Step {
            time: 0.0,
            region: c.name.clone(),
            state: None,
            why,
            jumps: Vec::new(),
        })?;
        let energy = |e: &Entries| c.energies.iter().find(|x| x.0 == e.region).map_or(0.0, |x| out[x.1]);
        let layout = Layout::new(index, c, true);
        let ledger = Ledger::new(&layout, c, c.entries.iter().map(energy));
        Ok(Self {
            step: branch.map_or_else(|| Ready::new(&c.step, backend), |b| Ready::of(&b.program, None, backend)),
            glance: c.step.glance.as_deref().map(|s| Ready::new(s, backend)),
            spare: c.step.fallback.as_deref().map(|s| Ready::new(s, backend)),
            by_spare: false,
            instant,
            guards: c.guards.as_ref().map(|g| Watch::new(g, scene.numeric.events.min_pivot, backend)),
            before: vec![0.0; c.guards.as_ref().map_or(0, |g| g.count)],
            respond: c.respond.as_ref().map(|r| Look::new(&r.program, backend)),
            fallback: c.respond.as_ref().and_then(|r| r.fallback.as_ref()).map(|p| Look::new(p, backend)),
            largest: state[..n].iter().map(|x| x.abs()).collect(),
            traced: c.is_traced(),
            glanced: state.clone(),
            aside: state.clone(),
            waves: layout.waves(index, scene),
            record: Record::new(c, options.tolerance, c.step.program.size(Array::Output)),
            state,
            input,
            signals,
            layout,
            ledger,
            watched: Drawn::of(scene, index),
            steps: 0,
            base: 0.0,
            count: 0,
            h: options.step.unwrap_or(options.default_step),
        })
    }

    /// Looks at what was drawn where an expectation does, after something was booked.
    pub(super) fn watch(&mut self, now: f64) {
        self.watched.iter_mut().for_each(|drawn| drawn.look((&self.ledger, &self.layout), now));
    }

    /// Newton iterations so far.
    pub(super) fn iterations(&self) -> u64 {
        self.step.work.newton_iterations
    }

    /// Its own time.
    pub(super) fn time(&self) -> f64 {
        self.base + self.count as f64 * self.h
    }

    pub(super) fn failure(&self, c: &Cluster, time: f64, why: Failure) -> Error {
        let state = match why {
            Failure::NotFinite { slot } if slot.array == Array::Output => {
                c.step.program.name_of(slot).map(ToString::to_string)
            }
            // What a stepper keeps for itself has no name that a reader knows.
            Failure::NotFinite { slot } => {
                let known = c.states + c.integrals + c.guesses;
                c.names[..known].get(slot.index as usize).cloned()
            }
            // An unknown is a loop, or the change of a state: `d(mass.p)`.
            Failure::NoConvergence { unknown, .. } => {
                c.step.program.name_of(Slot::new(Array::Local, unknown)).map(|n| {
                    let n = n.split(" in stage ").next().unwrap_or(n);
                    let state = n.strip_prefix("d(").and_then(|n| n.strip_suffix(')'));
                    state.filter(|s| c.names.iter().any(|n| n == s)).unwrap_or(n).to_string()
                })
            }
            Failure::Singular { .. } | Failure::Balance | Failure::Energy | Failure::GrossBalance => None,
        };
        let jumps = if matches!(why, Failure::NoConvergence { .. }) { c.jumps.clone() } else { Vec::new() };
        Error::Step { time, region: c.name.clone(), state, why, jumps }
    }

    /// The failure of a step to a state in which an energy is no number; of what is stored, with the one at fault.
    pub(super) fn unsound(&self, c: &Cluster, (time, next): (f64, &[f64]), what: &str) -> Error {
        let state = if what == STORED { self.beyond(c, next) } else { None };
        let what = state.map_or(what.to_string(), |state| format!("{what} (`{state}`)"));
        Error::Energy { time, region: c.name.clone(), what }
    }

    /// A state that is no number, or at which the energy bends by none.
    fn beyond<'c>(&self, c: &'c Cluster, next: &[f64]) -> Option<&'c String> {
        let mut stored = Look::new(&c.stored, &Interpret);
        let bends = stored.run(next, &self.input).ok()?;
        let sound = |k: usize| next[k].is_finite() && c.curvatures.get(k).is_none_or(|out| bends[*out].is_finite());
        (0..c.states).find(|k| !sound(*k)).and_then(|k| c.names.get(k))
    }

    /// The next step of its grid, kept.
    pub(super) fn next(&mut self, c: &Cluster, moved: &mut [f64]) -> Result<(), Error> {
        self.one(c, self.time(), self.h, moved)?;
        self.count += 1;
        Ok(())
    }

    /// One step, kept.
    pub(super) fn one(&mut self, c: &Cluster, t: f64, h: f64, moved: &mut [f64]) -> Result<(), Error> {
        let end = t + h;
        let (mut at, mut rest) = (t, h);
        loop {
            let cut = self.signals.cut(at, end);
            let piece = cut.unwrap_or(end);
            if cut.is_some() || at > t {
                rest = self.step.length(piece - at, at);
            }
            self.aim(at, piece);
            while let Some(part) = self.switch(c, at, rest) {
                self.split(c, at, part, moved, 0)?;
                at += part;
                rest = piece - at;
            }
            self.split(c, at, rest, moved, 0)?;
            if cut.is_none() {
                return Ok(());
            }
            at = piece;
        }
    }

    /// The way from `t` to just past where a source of a linear cluster first switches, if it does so within `h`: the
    /// exact step takes a source as smooth, so that it is cut there. Seen is what lasts longer than a sixteenth of the
    /// step.
    fn switch(&mut self, c: &Cluster, t: f64, h: f64) -> Option<f64> {
        if !c.is_linear || self.guards.is_none() {
            return None;
        }
        self.guard_at(t);
        for (b, out) in self.before.iter_mut().zip(self.guards.iter().flat_map(|g| g.values())) {
            *b = *out;
        }
        if self.before.contains(&0.0) {
            // It stands on a switch: what counts is the side it goes to.
            self.guard_at(t + 1e-6 * h);
            for (b, out) in self.before.iter_mut().zip(self.guards.iter().flat_map(|g| g.values())) {
                if *b == 0.0 {
                    *b = *out;
                }
            }
        }
        let mut low = 0.0;
        for k in 1..=16 {
            let mut high = h * f64::from(k) / 16.0;
            if !self.switched(t + high) {
                low = high;
                continue;
            }
            loop {
                let middle = 0.5 * (low + high);
                if t + middle <= t + low || t + middle >= t + high {
                    break;
                }
                if self.switched(t + middle) {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            return (h - high > 4.0 * f64::EPSILON * (t + h)).then_some(high);
        }
        None
    }

    pub(super) fn guard_at(&mut self, t: f64) {
        self.input[0] = t;
        if let Some(guards) = &mut self.guards {
            let _ = guards.run(&self.state, &mut self.input, 0.0); // a guard that cannot be told switches nothing
        }
    }

    fn switched(&mut self, t: f64) -> bool {
        self.guard_at(t);
        self.guards.iter().flat_map(|g| g.values()).zip(&self.before).any(|(a, b)| a * b < 0.0)
    }

    /// One step, kept; a step of a continuous cluster that fails is taken as two of half the length, and those
    /// likewise: a law that switches may leave a step without a solution, and then the halves have one.
    fn split(&mut self, c: &Cluster, t: f64, h: f64, moved: &mut [f64], depth: u32) -> Result<(), Error> {
        self.prepare(c, h)?;
        self.input[0] = t;
        self.input[1] = h;
        if let Err(why) = self.try_step(c, depth) {
            if depth >= HALVINGS || c.period.is_some() || c.is_linear {
                return Err(self.failure(c, t, why));
            }
            let half = 0.5 * h;
            self.split(c, t, half, moved, depth + 1)?;
            return self.split(c, t + half, half, moved, depth + 1);
        }
        self.keep_step(c, t, h, moved)
    }

    /// A step of a sampled cluster, into the workspace.
    pub(super) fn try_whole(&mut self, c: &Cluster, t: f64, h: f64) -> Result<(), Error> {
        self.prepare(c, h)?;
        (self.input[0], self.input[1]) = (t, h);
        self.try_step(c, 0).map_err(|why| self.failure(c, t, why))
    }

    /// Books the step in the workspace, and keeps it.
    pub(super) fn keep_step(&mut self, c: &Cluster, t: f64, h: f64, moved: &mut [f64]) -> Result<(), Error> {
        if let Err(what) = book_step(&self.ledger, &self.layout, c, &self.step.work.output) {
            return Err(self.unsound(c, (t + h, &self.step.work.next), &what));
        }
        self.take_down(c, t, h)?;
        // The workspace's numbers mean nothing to the next step.
        std::mem::swap(&mut self.state, &mut self.step.work.next);
        self.signals.lines.turn((&self.state, &self.step.work.output), &mut self.input);
        self.steps += 1;
        self.watch(t + h);
        advance_ports(c, &self.step.work.output, h, moved);
        if self.traced {
            self.track(c);
        }
        Ok(())
    }

    /// A step into the workspace. Where there is another stepper, that one takes a step that was halved often enough,
    /// and a step whose balance is off counts as failed.
    fn try_step(&mut self, c: &Cluster, depth: u32) -> Result<(), Failure> {
        let Some(spare) = &mut self.spare else { return self.step.run(&self.state, &self.input) };
        if depth < OWN {
            self.step.run(&self.state, &self.input)?;
            return if self.keeps(c) { Ok(()) } else { Err(Failure::Balance) };
        }
        spare.run(&self.state, &self.input)?;
        let (to, from) = (&mut self.step.work, &mut spare.work);
        std::mem::swap(&mut to.next, &mut from.next);
        let n = to.output.len().min(from.output.len());
        to.output[..n].copy_from_slice(&from.output[..n]);
        to.newton_iterations += std::mem::take(&mut from.newton_iterations);
        let (ledger, output) = (&self.ledger, &self.step.work.output);
        let closes = self.layout.accounts.iter().zip(&c.entries).all(|(p, e)| closes(ledger, p, e, output));
        if depth >= HALVINGS || closes { Ok(()) } else { Err(Failure::Balance) }
    }

    /// Whether the step in the workspace keeps the balance.
    fn keeps(&self, c: &Cluster) -> bool {
        let (ledger, output) = (&self.ledger, &self.step.work.output);
        self.layout.accounts.iter().zip(&c.entries).all(|(p, e)| imbalance(ledger, p, e, output) == 0.0)
    }

    fn prepare(&mut self, c: &Cluster, h: f64) -> Result<(), Error> {
        self.step.prepare(h).map_err(|why| Error::Table { region: c.name.clone(), why })
    }

    pub(super) fn track(&mut self, c: &Cluster) {
        let traces = &mut self.input[c.traces_at()..];
        for ((l, x), trace) in self.largest.iter_mut().zip(&self.state).zip(traces) {
            let size = x.abs();
            *l = if size > *l { size } else { *l };
            *trace = TRACES * *l;
        }
    }

    /// Moves what is looked at from `now` to `t`. Whether it was one step.
    pub(super) fn glance_to(&mut self, c: &Cluster, now: f64, t: f64) -> Result<bool, Error> {
        let (mut at, mut rest) = (now, t - now);
        let mut single = true;
        loop {
            let cut = self.signals.cut(at, t);
            let piece = cut.unwrap_or(t);
            if cut.is_some() || at > now {
                rest = piece - at;
            }
            self.aim(at, piece);
            while let Some(part) = self.switch(c, at, rest) {
                self.glance(c, at, part, 0)?;
                at += part;
                rest = piece - at;
            }
            single &= at == now;
            let answers = cut.is_none() && self.settle_answers(c, at, rest);
            single &= self.glance(c, at, rest, 0)?;
            if answers {
                let loops = c.states + c.integrals..c.states + c.integrals + c.guesses;
                self.glanced[loops.clone()].copy_from_slice(&self.aside[loops]);
            }
            if cut.is_none() {
                return Ok(single);
            }
            at = piece;
        }
    }

    /// What laws give at the end of what is looked at, left aside, by a last step that is short: where states alone do
    /// not tell it, it is as wrong as the rates at the end of a step, which are right only when nothing switched within
    /// it. Whether there is any.
    fn settle_answers(&mut self, c: &Cluster, at: f64, h: f64) -> bool {
        if c.guesses == 0 || !c.step.properties.stiffly_accurate {
            return false;
        }
        self.aside.copy_from_slice(&self.glanced);
        let most = (1.0 - LAST) * h;
        let done = self.glance(c, at, most, 0).and_then(|_| self.glance(c, at + most, LAST * h, 0));
        std::mem::swap(&mut self.aside, &mut self.glanced);
        done.is_ok()
    }

    /// Moves what is looked at by one step; where that fails, by two halves. Whether it was one.
    pub(super) fn glance(&mut self, c: &Cluster, at: f64, h: f64, depth: u32) -> Result<bool, Error> {
        let iterations = self.step.work.newton_iterations;
        let other = self.spare.as_mut().filter(|_| (depth >= OWN) != self.by_spare).or(self.glance.as_mut());
        let ready = other.unwrap_or(&mut self.step);
        let h = ready.length(h, at);
        self.input[0] = at;
        self.input[1] = h;
        if let Err(why) = ready.prepare(h) {
            return Err(Error::Table { region: c.name.clone(), why });
        }
        let mut result = ready.run(&self.glanced, &self.input);
        let (ledger, accounts) = (&self.ledger, &self.layout.accounts);
        let off = || accounts.iter().zip(&c.entries).any(|(p, e)| imbalance(ledger, p, e, &ready.work.output) > 0.0);
        if result.is_ok() && depth < OWN && c.step.fallback.is_some() && off() {
            result = Err(Failure::Balance);
        }
        if result.is_ok() {
            self.glanced.copy_from_slice(&ready.work.next);
        }
        self.step.work.newton_iterations = iterations;
        match result {
            Ok(()) => Ok(true),
            Err(why) if depth >= HALVINGS || c.is_linear => Err(self.failure(c, at, why)),
            Err(_) => {
                self.glance(c, at, 0.5 * h, depth + 1)?;
                self.glance(c, at + 0.5 * h, 0.5 * h, depth + 1)?;
                Ok(false)
            }
        }
    }

    /// The output of the last step.
    pub(super) fn output(&self) -> &[f64] {
        &self.step.work.output
    }
}

/// Tells the programs a trace of the largest value of each state: below it a change is as good as none.
fn leave_traces(input: &mut [f64], largest: &[f64], c: &Cluster) {
    let at = c.traces_at();
    for (trace, x) in input[at..].iter_mut().zip(&largest[..c.states]) {
        *trace = TRACES * x.abs();
    }
}

/// Whether the balance of a step that was taken in the place of another closes.
fn closes(ledger: &Ledger, p: &AccountPlaces, e: &Entries, out: &[f64]) -> bool {
    let (supplied, dissipated): (f64, f64) =
        (e.supplied.iter().map(|(_, s)| out[*s]).sum(), e.dissipated.iter().map(|(_, s)| out[*s]).sum());
    let before = e.before.map_or(ledger.get(p.h), |slot| out[slot]);
    let scale = out[e.size].abs().max(before.abs()).max(supplied.abs()).max(dissipated.abs()).max(ledger.floor(p));
    (out[e.energy] - before - (supplied - dissipated)).abs() <= CLOSES * scale
}

/// What the balance of a step is off by, where that is looked at; 0 where that is no more than rounding.
pub(super) fn imbalance(ledger: &Ledger, p: &AccountPlaces, e: &Entries, out: &[f64]) -> f64 {
    let Some((change, exchanged)) = e.change else { return 0.0 };
    let (mut net, mut turnover) = (0.0, out[exchanged]);
    for (_, slot) in &e.supplied {
        net += out[*slot];
        turnover += out[*slot].abs();
    }
    for (_, slot) in &e.dissipated {
        net -= out[*slot];
        turnover += out[*slot].abs();
    }
    let scale = out[e.size].abs().max(turnover).max(ledger.floor(p));
    let off = (out[change] - net).abs();
    if !(off.is_finite() && scale.is_finite()) {
        return f64::INFINITY;
    }
    if off <= OFF * scale { 0.0 } else { off }
}

/// Adds a step to the ledger.
///
/// # Errors
/// What of it is no number, or makes no sense.
pub(super) fn book_step(ledger: &Ledger, layout: &Layout, c: &Cluster, output: &[f64]) -> Result<(), String> {
    let (sampled, exact) = (c.period.is_some(), c.step.linear.is_some());
    for (e, p) in c.entries.iter().zip(&layout.accounts) {
        match account::book_step(Real::new(), Booking { ledger, output }, e, p, (sampled, exact)) {
            Ok(()) => {}
            Err(Exit::Fail(Failure::GrossBalance)) => {
                return Err(
                    "the exact step does not keep the stored energy: its stiffnesses, masses and times differ by \
                            too many orders of magnitude; change them, or take another method"
                        .into(),
                );
            }
            Err(_) => return Err(not_finite(e, output)),
        }
    }
    Ok(())
}

/// Which energy of a step is no number, in words.
fn not_finite(e: &Entries, output: &[f64]) -> String {
    let off = |slot: usize| !output[slot].is_finite();
    if let Some((name, _)) = e.supplied.iter().find(|x| off(x.1)) {
        return format!("what `{name}` supplies is not a finite number");
    }
    if let Some((name, _)) = e.dissipated.iter().find(|x| off(x.1)) {
        return format!("what `{name}` dissipates is not a finite number");
    }
    if let Some(p) = e.produced.iter().find(|p| off(p.entropy) || off(p.heat)) {
        return format!("the entropy that `{}` produces is not a finite number", p.name);
    }
    let flows: f64 = e.supplied.iter().chain(&e.dissipated).map(|x| output[x.1].abs()).sum();
    if !off(e.energy) && !(flows + output[e.size].abs()).is_finite() {
        return "what is turned over is not a finite number".into();
    }
    STORED.into()
}

/// Adds to each port the integral of what it gave out.
pub(super) fn advance_ports(c: &Cluster, out: &[f64], h: f64, moved: &mut [f64]) {
    for (m, p) in moved.iter_mut().zip(&c.ports) {
        *m += h * out[p.mean];
    }
}

#[cfg(test)]
mod tests {
    use super::{STORED, not_finite};
    use crate::scene::{Entries, Produced};

    /// What is named is what is no number, be it only one of two.
    #[test]
    fn what_is_no_number_is_named() {
        let produced = vec![Produced { name: "film".into(), entropy: 2, heat: 3 }];
        let (supplied, dissipated) = (vec![("push".into(), 0)], vec![("rub".into(), 1)]);
        let entries = Entries { supplied, dissipated, produced, energy: 4, size: 4, ..Entries::default() };
        let of = |place: usize, x: f64| {
            let mut output = [1.0; 5];
            output[place] = x;
            not_finite(&entries, &output)
        };
        for (place, name) in [(0, "`push`"), (1, "`rub`"), (2, "`film`"), (3, "`film`")] {
            for x in [f64::NAN, f64::INFINITY] {
                assert!(of(place, x).contains(name), "{}", of(place, x));
            }
        }
        assert_eq!(of(4, f64::NAN), STORED);
    }
}
