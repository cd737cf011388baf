//! Whether a scene that was read means something: whatever it refers to is there, so that running it cannot fail on
//! that.

use super::{
    Branch, Carried, Cluster, Entries, ExpectationKind, GIVEN, Guards, Leaving, Scene, Stepper, TransmissionLine,
    Watched,
};
use crate::exponential::{Layout, Linear};
use crate::history::SLOTS;
use crate::ir::{Array, Inst, Invalid, Program};
use thiserror::Error;

/// More numbers than this in one array are no scene.
const MOST: usize = 1 << 26;
/// Nor is an iteration that may go round more often.
const MOST_ITERATIONS: u32 = 100_000;

/// What is wrong with a scene. Such a scene is a mistake of whoever made it, never of a user.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Unsound {
    /// A program does not pass its verifier.
    #[error("the program `{0}`: {1}")]
    Program(String, Invalid),
    /// A program's arrays are too large, or do not go with those of its cluster.
    #[error("the program `{0}` does not go with its cluster: its {1}")]
    Sizes(String, &'static str),
    /// Something refers to what there is not.
    #[error("`{0}`: {1}")]
    Reference(String, &'static str),
}

impl Scene {
    /// Checks it.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn validate(&self) -> Result<(), Unsound> {
        for c in &self.clusters {
            Check { scene: self, c }.cluster()?;
        }
        let wrong = |name: &str, what| Err(Unsound::Reference(name.to_string(), what));
        if !self.numeric.is_sound() {
            return wrong(&self.name, "by its numbers a run may have no end");
        }
        let n = self.clusters.len();
        for r in &self.regions {
            if r.cluster >= n {
                return wrong(&r.name, "its cluster is not there");
            }
        }
        let port = |(c, p): (usize, usize)| self.clusters.get(c).is_some_and(|c| p < c.ports.len());
        let held = |(c, p): (usize, usize)| self.clusters.get(c).is_some_and(|c| c.holds.contains(&p));
        for b in &self.bars {
            if !port(b.holder) || !port(b.other) {
                return wrong(&b.name, "a port of the double bar is not there");
            }
            if !held(b.holder) {
                return wrong(&b.name, "nobody holds the double bar");
            }
        }
        for o in &self.open {
            if !port(o.port) {
                return wrong(&o.name, "the open port is not there");
            }
        }
        self.probes()
    }

    /// Checks what is shown, and what is expected.
    fn probes(&self) -> Result<(), Unsound> {
        let p = &self.probes;
        let wrong = |what| Err(Unsound::Reference("the probes".into(), what));
        let shown =
            |(c, out): &(usize, usize)| self.clusters.get(*c).is_some_and(|c| *out < c.instant.size(Array::Output));
        if !p.gather.iter().all(shown) {
            return wrong("a signal that they read is not there");
        }
        let is_end = |&(cluster, entry, at): &(usize, usize, usize)| {
            let entries = self.clusters.get(cluster).and_then(|c| c.entries.get(entry));
            entries.is_some_and(|e| at < e.supplied.len())
        };
        let comes_out = |line: &TransmissionLine| {
            let cluster = self.clusters.get(line.ends[0].0).filter(|_| line.ends[0].0 == line.ends[1].0);
            let room = |c: &Cluster| c.traces_at().checked_sub(SLOTS);
            let fits = |slots: &[usize; 2]| {
                let last = cluster.and_then(room);
                last.is_some_and(|last| slots.iter().all(|slot| *slot <= last))
            };
            line.admittance.is_finite() && line.out.as_ref().is_none_or(fits)
        };
        if !self.lines.iter().all(comes_out) {
            return Err(Unsound::Reference(self.name.clone(), "what comes out of a line is not there"));
        }
        let leaves = |c: &Cluster, e: &Entries| {
            let outputs = c.step.program.size(Array::Output);
            let fits = |x: &Leaving| x.source < e.supplied.len() && x.wave < outputs && x.scale.is_finite();
            e.leaving.iter().all(fits)
        };
        if !self.clusters.iter().all(|c| c.entries.iter().all(|e| leaves(c, e))) {
            return Err(Unsound::Reference(self.name.clone(), "what leaves into a line is not booked"));
        }
        if !self.lines.iter().flat_map(|line| &line.ends).all(is_end) {
            return Err(Unsound::Reference(self.name.clone(), "an end of a line is not booked"));
        }
        for w in &self.waves {
            let line = self.clusters.get(w.cluster).and_then(|c| c.lines.get(w.line));
            let leaves = line.is_some_and(|line| matches!(line.carried, Carried::Leaving { .. }));
            if !(leaves && w.impedance > 0.0 && w.impedance.is_finite()) {
                return Err(Unsound::Reference(w.name.clone(), "the port carries no waves"));
            }
        }
        if p.inputs.iter().any(|i| *i >= self.inputs.len()) {
            return wrong("an input that they read is not there");
        }
        let outputs = match &p.program {
            None => 0,
            Some(program) => {
                sound(program)?;
                fits(program, 0, 1 + p.gather.len() + p.inputs.len(), 0)?;
                program.size(Array::Output)
            }
        };
        if p.units.len() != p.names.len() || p.names.len() > outputs {
            return wrong("there are not as many as there are names");
        }
        let entry = |w: &Watched| self.clusters.get(w.cluster)?.entries.get(w.entry.0)?.supplied.get(w.entry.1);
        if self.watched.iter().any(|w| entry(w).is_none()) {
            return wrong("a place that an expectation looks at is not there");
        }
        for e in &p.expectations {
            let known = match &e.kind {
                ExpectationKind::Passive => true,
                ExpectationKind::PassiveAt(i) => *i < self.watched.len(),
                ExpectationKind::At { output, .. } => *output < outputs,
                ExpectationKind::Holds { extremes, output, program } => {
                    if let Some(program) = program {
                        sound(program)?;
                        fits(program, 0, extremes.len(), 0)?;
                    }
                    let last = if program.is_some() { true } else { *output < outputs };
                    last && extremes.iter().all(|(o, _)| *o < outputs)
                        && program.as_ref().is_none_or(|p| p.size(Array::Output) > 0)
                }
            };
            if !known {
                return Err(Unsound::Reference(e.text.clone(), "what is expected is not computed"));
            }
        }
        Ok(())
    }
}

/// Checks a program for itself.
fn sound(p: &Program) -> Result<(), Unsound> {
    let large = p.sizes.iter().any(|n| *n as usize > MOST);
    if large || p.values as usize > values(&p.body) {
        return Err(Unsound::Sizes(p.name.clone(), "arrays are too large"));
    }
    if !ends(&p.body) {
        return Err(Unsound::Sizes(p.name.clone(), "iterations have no end"));
    }
    p.verify().map_err(|e| Unsound::Program(p.name.clone(), e))
}

/// Whether all iterations of a body come to an end soon.
fn ends(body: &[Inst]) -> bool {
    body.iter().all(|inst| match inst {
        Inst::Newton(newton) => newton.limit <= MOST_ITERATIONS && newton.options.is_sound() && ends(&newton.body),
        Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => true,
    })
}

/// How many values a body defines.
fn values(body: &[Inst]) -> usize {
    body.iter()
        .map(|inst| match inst {
            Inst::Let(..) => 1,
            Inst::Newton(newton) => values(&newton.body),
            Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => 0,
        })
        .sum()
}

/// Checks that a program reads no more than it is given.
fn fits(p: &Program, state: usize, input: usize, table: usize) -> Result<(), Unsound> {
    let bad = |what| Err(Unsound::Sizes(p.name.clone(), what));
    if p.size(Array::State) > state {
        return bad("state is longer");
    }
    if p.size(Array::Input) > input {
        return bad("inputs are more");
    }
    if p.size(Array::Table) > table {
        return bad("table is longer");
    }
    Ok(())
}

/// The length of the table of a linear system whose matrices have the right shapes.
fn table(linear: &Linear) -> Option<usize> {
    let size = linear.n.checked_add(linear.m)?;
    let square = size.checked_mul(size)?;
    let rows = linear.means.iter().all(|c| c.len() == size);
    let matrices = linear.forms.iter().chain(&linear.squares).chain(&linear.drifts).all(|m| m.len() == square);
    (linear.a.len() == square && rows && matrices).then(|| Layout::of(linear).size())
}

/// A walk through a cluster.
struct Check<'a> {
    scene: &'a Scene,
    c: &'a Cluster,
}

/// Numbers that are on their way in the delays of a sampled cluster, at most.
const MOST_DELAYED: usize = 100_000_000;

impl Check<'_> {
    fn wrong(&self, what: &'static str) -> Unsound {
        Unsound::Reference(self.c.name.clone(), what)
    }

    fn that(&self, holds: bool, what: &'static str) -> Result<(), Unsound> {
        if holds { Ok(()) } else { Err(self.wrong(what)) }
    }

    /// How many input slots it has.
    fn inputs(&self) -> Option<usize> {
        let c = self.c;
        let given = GIVEN.checked_mul(c.inputs.len())?;
        let lines = c.lines.len().checked_mul(SLOTS).filter(|n| *n <= MOST)?;
        let arriving = c.lines.iter().map(|line| line.carried.slots()).sum::<usize>().min(lines);
        let traces = c.foreign_at.checked_add(c.foreign.len())?.checked_add(given)?.checked_add(arriving)?;
        traces.checked_add(c.states).filter(|n| *n <= MOST)
    }

    /// Its delays, and what they keep.
    fn lines(&self) -> Result<(), Unsound> {
        let c = self.c;
        let mut kept = 0usize;
        for line in &c.lines {
            self.that(line.start.is_finite(), "a delay begins with no number")?;
            match line.carried {
                Carried::State { state, periods } => {
                    self.that(c.period.is_some() && state < c.states && periods > 0, "a delay has no state")?;
                    kept = kept.saturating_add(periods as usize);
                }
                Carried::Wave { output, periods } => {
                    let is_there = output < c.step.program.size(Array::Output);
                    self.that(c.period.is_some() && is_there, "a wave is not reported")?;
                    kept = kept.saturating_add(periods as usize);
                }
                Carried::Leaving { output } => {
                    let is_there = output < c.step.program.size(Array::Output);
                    self.that(c.period.is_some() && is_there, "a wave that leaves is not reported")?;
                }
                Carried::Signal { output, time } => {
                    let is_there = output < c.instant.size(Array::Output);
                    self.that(c.period.is_none() && is_there, "a delay has no signal")?;
                    self.that(time.is_finite() && time > 0.0, "a delay is not above 0")?;
                }
            }
        }
        self.that(kept <= MOST_DELAYED, "its delays are too long")
    }

    fn cluster(&self) -> Result<(), Unsound> {
        let c = self.c;
        let inputs = self.inputs().ok_or_else(|| self.wrong("it has too many inputs"))?;
        self.that(c.period.is_none_or(|t| t.is_finite() && t > 0.0), "its period is not above 0")?;
        self.that(c.foreign_at >= 2 + c.ports.len(), "its inputs overlap")?;
        let parts = [c.states, c.integrals, c.guesses, c.states, c.memory];
        let total = parts.into_iter().try_fold(0usize, usize::checked_add);
        self.that(total == Some(c.initial.len()) && c.names.len() == c.initial.len(), "its state has another length")?;
        let memory = c.initial.len() - c.memory..c.initial.len();
        self.that(c.recall.is_none_or(|k| memory.contains(&k)), "what it recalls is not there")?;
        self.stepper(&c.step, inputs)?;
        for inner in c.step.glance.iter().chain(&c.step.fallback) {
            self.that(inner.glance.is_none() && inner.fallback.is_none(), "a stepper is nested too deeply")?;
            self.stepper(inner, inputs)?;
        }
        // What estimates the error of a step comes after all that is reported of it.
        let outputs = c.step.estimate.unwrap_or_else(|| c.step.program.size(Array::Output));
        let reports = c.step.fallback.as_ref().is_none_or(|f| f.program.size(Array::Output) >= outputs);
        self.that(reports, "what takes its place reports less")?;
        for program in [&c.instant, &c.stored].into_iter().chain(c.guards.iter().map(|g| &g.program)) {
            self.look(program, inputs)?;
        }
        self.that(c.guards.is_none() || c.period.is_none(), "it is sampled and has guards")?;
        let told = |g: &Guards| {
            let (n, m) = (g.count, g.loops);
            let outputs = g.program.size(Array::Output);
            n <= outputs && m <= outputs && outputs == n + m + m * m + n * m
        };
        self.that(c.guards.as_ref().is_none_or(told), "what its guards tell is not there")?;
        if let (Some(branch), Some(guards)) = (c.branch(), &c.guards) {
            self.branch(branch, inputs.saturating_add(guards.count))?;
        }
        self.respond(inputs)?;
        self.ports(inputs)?;
        let stored = c.stored.size(Array::Output);
        self.that(c.energies.iter().all(|e| e.1 < stored), "an energy is not computed")?;
        self.that(c.curvatures.len() == c.states, "there is not one curvature a state")?;
        self.that(c.curvatures.iter().all(|k| *k < stored), "a curvature is not computed")?;
        self.that(c.grains.len() == c.states, "there is not one grain a state")?;
        self.that(c.sizes.len() == c.states + c.integrals, "there is not one size a state and integral")?;
        self.that(c.grains.iter().all(|k| *k < stored), "a grain is not computed")?;
        let shown = |(k, out): &(usize, usize)| {
            self.scene.clusters.get(*k).is_some_and(|o| *out < o.instant.size(Array::Output))
        };
        self.that(c.foreign.iter().all(shown), "a signal that it reads is not there")?;
        self.lines()?;
        self.that(c.inputs.iter().all(|i| *i < self.scene.inputs.len()), "an input that it reads is not there")?;
        c.entries.iter().try_for_each(|e| self.entries(e))
    }

    fn stepper(&self, s: &Stepper, inputs: usize) -> Result<(), Unsound> {
        let n = self.c.initial.len();
        sound(&s.program)?;
        let table = match &s.linear {
            None => 0,
            Some(linear) => table(linear).ok_or_else(|| self.wrong("its linear system has another shape"))?,
        };
        fits(&s.program, n, inputs, table)?;
        let estimate = s.estimate.map_or(Some(0), |at| at.checked_add(self.c.states)?.checked_add(self.c.integrals));
        let outputs = s.program.size(Array::Output);
        self.that(estimate.is_some_and(|end| end <= outputs), "the error of its step is not computed")?;
        self.that(s.stiffness.is_none_or(|at| at < outputs), "how stiff its step is, is not computed")?;
        self.that(s.program.size(Array::Next) == n, "its step gives another state")
    }

    fn branch(&self, b: &Branch, inputs: usize) -> Result<(), Unsound> {
        let c = self.c;
        sound(&b.program)?;
        fits(&b.program, c.initial.len(), inputs, 0)?;
        let outputs = b.program.size(Array::Output);
        let whole = b.program.size(Array::Next) == c.initial.len() && outputs >= c.step.program.size(Array::Output);
        self.that(whole, "its step along a branch gives less")?;
        let middle = b.middle.map_or(Some(0), |at| at.checked_add(c.states)?.checked_add(c.integrals));
        self.that(middle.is_some_and(|end| end <= outputs), "the middle of its step is not computed")
    }

    fn look(&self, p: &Program, inputs: usize) -> Result<(), Unsound> {
        sound(p)?;
        fits(p, self.c.initial.len(), inputs, 0)
    }

    fn respond(&self, inputs: usize) -> Result<(), Unsound> {
        let n = self.c.holds.len();
        let Some(respond) = &self.c.respond else {
            return self.that(n == 0, "it holds ports and does not say what");
        };
        // The free responses and the port admittance come after the inputs.
        let (first, mut more, mut outputs) = (&respond.program, 0, n + 1);
        if let Some(plain) = &respond.fallback {
            self.look(plain, inputs)?;
            self.that(plain.size(Array::Output) >= n, "what it holds is not computed")?;
            (more, outputs) = (n + n * n, n + 2);
        }
        sound(first)?;
        fits(first, self.c.initial.len(), inputs + more, 0)?;
        let enough = more == 0 || first.size(Array::Input) == inputs + more;
        self.that(enough && first.size(Array::Input) >= inputs, "what it holds is computed from other inputs")?;
        self.that(first.size(Array::Output) >= outputs, "what it holds is not computed")
    }

    fn ports(&self, inputs: usize) -> Result<(), Unsound> {
        let c = self.c;
        for p in &c.ports {
            let there = p.input < inputs
                && p.mean < c.step.program.size(Array::Output)
                && p.instant < c.instant.size(Array::Output)
                && p.region < self.scene.regions.len();
            self.that(there, "a port refers to what is not there")?;
        }
        self.that(c.holds.iter().all(|h| *h < c.ports.len()), "it holds a port that is not there")?;
        self.that(c.holds.is_empty() || c.period.is_some(), "it holds ports and is not sampled")
    }

    fn entries(&self, e: &Entries) -> Result<(), Unsound> {
        let lists = e.supplied.iter().chain(&e.dissipated).map(|x| x.1);
        let lists = lists.chain(e.produced.iter().flat_map(|p| [p.entropy, p.heat]));
        let leap = e.leap.into_iter().chain(e.change).flat_map(|(a, b)| [a, b]);
        let mut slots = lists.chain(e.before).chain(e.modified).chain(leap).chain([e.energy, e.size]);
        let outputs = self.c.step.program.size(Array::Output);
        self.that(slots.all(|s| s < outputs), "an entry of its ledger is not computed")?;
        let sources = e.held.iter().chain(e.steered.iter().map(|s| &s.0));
        self.that(sources.clone().all(|i| *i < e.supplied.len()), "an entry of its ledger is of no source")?;
        self.that(e.region < self.scene.regions.len(), "an entry of its ledger is of no region")
    }
}
