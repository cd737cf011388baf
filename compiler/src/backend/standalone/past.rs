//! What signals were that are delayed in continuous time: `bond_runtime::history` in the block. A step is cut where
//! what arrives jumps, is told what arrives as a polynomial, and is taken down at nodes within it.

use super::Writing;
use super::block::Block;
use crate::backend::code::{Cond, Memory, Picked, Place, Stmt, Value};
use crate::backend::lower::recorder::{Recorded, Recorder};
use crate::backend::lower::writer::{At, Writer, scratch};
use bond_runtime::energy::Memory as _;
use bond_runtime::energy::smaller;
use bond_runtime::history::{self, JUMP, NODES, Numbers, Record, Ring, SLOTS, SMOOTH, Shape};
use bond_runtime::machine::{Machine, Number};
use bond_runtime::scene::{self, Carried};
use std::ops::Range;

/// Places of a signal that is delayed.
#[derive(Clone, Debug)]
pub(super) struct Past {
    shape: Shape,
    /// The first of its numbers.
    at: usize,
    /// Which output of the observation is delayed, and the first input slot of what arrives.
    output: usize,
    input: usize,
    /// What it was at the nodes of a step, to be read at once.
    values: usize,
}

/// How long all continuous delays of a cluster are, s.
pub(super) fn delays(c: &scene::Cluster) -> Vec<f64> {
    let delay = |line: &scene::Line| if let Carried::Signal { time, .. } = line.carried { Some(time) } else { None };
    c.lines.iter().filter_map(delay).collect()
}

impl Past {
    /// Gives all delays of a continuous cluster their places, for steps of at most a length where another one was
    /// `wanted`.
    pub(super) fn all(block: &mut Block, c: &scene::Cluster, (step, wanted): (f64, f64)) -> Vec<Self> {
        let (mut input, all, nodes) = (c.lines_at(), delays(c), c.nodes());
        let mut list = Vec::new();
        for line in &c.lines {
            if let Carried::Signal { output, time } = line.carried {
                let (pieces, breaks) = (Shape::room(time, (step, wanted), &all), Shape::jumps(time, wanted));
                let shape = Shape { delay: time, start: line.start, nodes, pieces, breaks };
                list.push(Self { shape, at: block.put(&shape.image()), output, input, values: 0 });
            }
            input += line.carried.slots();
        }
        list
    }

    /// Gives what is read at once its place.
    pub(super) fn work(&mut self, block: &mut Block) {
        self.values = block.take(self.shape.nodes);
    }

    /// Which inputs of the programs are told of it.
    pub(super) fn told(&self) -> Range<usize> {
        self.input..self.input + SLOTS
    }

    fn record<'r>(&'r self, by: &'r Recorder) -> Record<'r, &'r Recorder, Kept<'r>> {
        Record { m: by, numbers: Kept { by, at: self.at }, shape: &self.shape }
    }
}

/// Numbers of the block from a place on.
#[derive(Clone, Copy)]
struct Kept<'r> {
    by: &'r Recorder,
    at: usize,
}

impl Kept<'_> {
    fn place(self, ring: Ring, k: Recorded<'_>) -> Place {
        let picked = Picked { by: k.value, stride: ring.stride as u32, count: ring.count as u32 };
        Place { picked: Some(picked), ..Place::new(Memory::State, (self.at + ring.first) as u32) }
    }
}

impl<'r> Numbers<&'r Recorder> for Kept<'r> {
    fn load(self, at: usize) -> Recorded<'r> {
        self.by.value(self.by.with(|w| w.kept(self.at + at)))
    }

    fn store(self, at: usize, x: Recorded<'r>) {
        self.by.with(|w| w.keep(self.at + at, x.value));
    }

    fn pick(self, ring: Ring, k: Recorded<'r>) -> Recorded<'r> {
        self.by.value(self.by.with(|w| w.load(self.place(ring, k))))
    }

    fn put(self, ring: Ring, k: Recorded<'r>, x: Recorded<'r>) {
        self.by.with(|w| w.push(Stmt::Store(self.place(ring, k), x.value)));
    }
}

impl Writing<'_> {
    /// A step of a cluster with delays: as many as there are jumps that arrive within it, and one more.
    pub(super) fn in_pieces(&mut self, mut w: Writer, i: usize, t: Value, h: f64) -> Result<Writer, String> {
        let length = w.number(h);
        let end = w.add(t, length);
        let (at, later) = (w.holding(t), w.starting(0.0));
        w.open();
        let now = w.get(at);
        let is_later = w.get(later);
        let is_later = w.is_true(is_later);
        let (next, cut) = self.on(&mut w, i, |m, _| {
            let (now, end) = (m.value(now), m.value(end));
            let slack = history::slack(m, now, end);
            let all = self.clusters[i].pasts.iter().map(|p| p.record(m).next(now, slack));
            let next = all.reduce(|a, b| smaller(m, a, b)).unwrap_or(end);
            // The second is so in any block but one that was made up.
            (next.value, next.below(end - slack) & now.below(next))
        });
        let piece = w.select(cut.clone(), next, end);
        let rest = w.sub(piece, now);
        let rest = w.select(Cond::any([cut.clone(), is_later]), rest, length);
        self.aim(&mut w, i, (now, piece));
        let mut w = self.kept(w, i, (now, rest), false)?;
        w.when(cut.not(), |w| w.push(Stmt::Break));
        w.set(at, piece);
        let one = w.number(1.0);
        w.set(later, one);
        let body = w.close();
        w.push(Stmt::Loop(body));
        Ok(w)
    }

    /// Tells a cluster's programs what arrives by its delays in a step.
    fn aim(&self, w: &mut Writer, i: usize, (t, end): (Value, Value)) {
        let place = &self.clusters[i];
        self.on(w, i, |m, block| {
            let (t, end) = (m.value(t), m.value(end));
            let (slack, length) = (history::slack(m, t, end), end - t);
            let tell = |at: usize, x: Recorded<'_>| m.with(|w| w.keep(place.input + at, x.value));
            let mut arriving: Vec<_> = place.pasts.iter().map(|p| (p, p.record(m).aim((t, end), slack))).collect();
            for waves in place.layout.waves(i, self.scene) {
                let given = waves.given.map(|at| block.sum(at));
                let which = waves.slots.map(|at| arriving.iter().position(|(p, _)| p.input == at));
                let [Some(a), Some(b)] = which else { continue };
                let out = [arriving[a].1, arriving[b].1];
                let [x, y] = history::shorten(m, given, (length, waves.admittance), out, &waves.rules);
                (arriving[a].1, arriving[b].1) = (x, y);
            }
            for (p, a) in arriving {
                a.into_iter().enumerate().for_each(|(k, a)| tell(p.input + k, a));
                tell(p.input + NODES.len(), Machine::number(m, 1.0) / length);
                tell(p.input + NODES.len() + 1, t);
            }
        });
    }

    /// Tells a cluster's programs what arrives by its delays at an instant.
    pub(super) fn arriving(&self, w: &mut Writer, i: usize, t: Value) {
        let place = &self.clusters[i];
        self.on(w, i, |m, _| {
            let (t, zero) = (m.value(t), Machine::number(m, 0.0));
            let slack = Machine::number(m, history::SAME) * Number::abs(t);
            for p in &place.pasts {
                let x = p.record(m).arriving(t, slack);
                for at in p.told() {
                    m.with(|w| w.keep(place.input + at, zero.value));
                }
                m.with(|w| w.keep(place.input + p.input, x.value));
                m.with(|w| w.keep(place.input + p.input + SLOTS - 1, t.value));
            }
        });
    }

    /// Takes a step down that is about to be kept.
    pub(super) fn take_down(&mut self, mut w: Writer, i: usize, (t, length): (Value, Value)) -> Result<Writer, String> {
        let (c, place) = (&self.scene.clusters[i], self.clusters[i].clone());
        let (nodes, n) = (c.nodes(), self.start.clusters[i].state.len());
        let (index, zero) = (w.index(), w.number(0.0));
        w.open();
        let node = w.load(Place { memory: Memory::Table, ..scratch(self.nodes as u32, At::Each(index)) });
        let ahead = w.mul(node, length);
        let within = w.lt(ahead, length);
        w.open();
        super::step::keep(&mut w, place.glanced..place.glanced + n, place.state);
        w.open();
        w.keep(place.input, t);
        w.keep(place.input + 1, ahead);
        let program = &c.step.program;
        w = self.program(w, program, place.state, place.glanced, place.input, place.glanced_output, &c.name)?;
        let short = w.close();
        let begun = w.lt(zero, ahead);
        w.push(Stmt::If(begun, short, Vec::new()));
        let inside = w.close();
        let at_end = w.block(|w| super::step::keep(w, place.glanced..place.glanced + n, place.next));
        w.push(Stmt::If(within, inside, at_end));
        let now = w.add(t, ahead);
        w.keep(place.input, now);
        w = self.program(w, &c.instant, place.glanced, 0, place.input, place.seen, &c.name)?;
        for p in &place.pasts {
            let x = w.kept(place.seen + p.output);
            w.put_at(p.values, At::Each(index), x);
        }
        let body = w.close();
        w.push(Stmt::For(index, 0, nodes as u32, body));
        self.on(&mut w, i, |m, _| {
            let (t, length) = (m.value(t), m.value(length));
            let slack = Machine::number(m, history::SAME) * (Number::abs(t) + length);
            let arrives = place.pasts.iter().map(|p| p.record(m).arrives(t, slack));
            let arrives = arrives.fold(Machine::number(m, SMOOTH), |least, level| smaller(m, least, level));
            for p in &place.pasts {
                let mut values: Vec<_> = (0..nodes).map(|k| m.value(m.with(|w| w.kept(p.values + k)))).collect();
                if c.guards.is_some() {
                    history::before_jump(m, &mut values);
                }
                p.record(m).take((t, length), &values, arrives, JUMP);
            }
        });
        Ok(w)
    }
}
