//! The output equations: what signals are at one instant, from the states and what comes in. Where a branched law
//! leaves them singular, they are regularised by half a step of the backward Euler method.

use crate::discretise::analysis::relay::{self, Relay};
use crate::discretise::analysis::smoothness;
use crate::discretise::cluster::{self, Cluster, missing};
use crate::discretise::equations::system::System;
use crate::discretise::equations::{constraints, error_weights, newton};
use crate::expression::{Expr, Lowering, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// At most this many loops are solved where laws may leave some undetermined.
const LOOPS: usize = 16;

/// How strongly what an instant does not determine is held to its guess.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pull {
    /// The parameter of a curve.
    pub(crate) curves: f64,
    /// The output of a relay-like law.
    pub(crate) switches: Switched,
}

/// What holds the output of a relay-like law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Switched {
    /// The law alone.
    Free,
    /// What the step found at its end, to `pull` ([`crate::thresholds::RegularThresholds`]) of the law's slope at rest.
    AtEnd,
    /// Where the law has an end, what the step found in its middle, as half a step more by the backward Euler method
    /// leaves it: for a current `i` of a coil that a diode stops, `g(u) + k (u - u_middle) = i` with `k = h / (2 L)`. A
    /// midpoint rule does not damp what is stiff, so that `i` may end where the law has no voltage for it. Where the
    /// law is steep beside `k`, as that of a diode that conducts, it determines `u` by itself, and `k^2 / (k +
    /// g'(u_middle))` stands for `k`. `h` is that of the last step; where it is not known, or 0, that of a long one.
    Midway { last: Option<Value> },
}

/// Solves the loops at one instant, those that `wanted` depends on or all, and gives all outputs' expressions.
pub(crate) fn outputs(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    (guesses, pull): (&[Value], Pull),
    wanted: Option<&[Expr]>,
) -> Result<FxHashMap<Symbol, Expr>, Vec<Diagnostic>> {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let mut now = flat.clone();
    let mut residuals: Vec<Expr> = c.residuals_in(&mut model.pool, &flat);
    let speeds = c.constraints_at_instant(model, form, &mut now, &mut residuals)?;
    let needed = match wanted {
        // Speeds without inertia go with all that ties them.
        Some(wanted) if speeds.now.is_empty() => {
            let wanted: Vec<Expr> = wanted.iter().map(|e| model.pool.substitute(*e, &flat)).collect();
            needed(c, &model.pool, &residuals, wanted)
        }
        Some(_) | None => vec![true; residuals.len()],
    };
    // Where the states alone impose what a curve receives, and it is vertical there, an instant does not determine its
    // parameter: the force that holds a body at rest follows from the whole step. It stays near what the step
    // found.
    let loops: FxHashSet<Symbol> = c.loops.iter().copied().collect();
    let midway = matches!(pull.switches, Switched::Midway { .. });
    let observed = pull.switches != Switched::Free;
    let switches = relay_pulls(c, model, form, pull.switches);
    let last = match pull.switches {
        Switched::Midway { last } => last,
        Switched::Free | Switched::AtEnd => None,
    };
    let mut half: Option<Expr> = None;
    let free = residuals.clone();
    // Laws that may leave their unknowns undetermined, those of them for which the states alone decide that, and
    // whether others do together.
    let (mut bare, mut open, mut coupled) = (Vec::new(), vec![false; c.loops.len()], false);
    for (((((r, z), n), guess), switch), open) in
        residuals.iter_mut().zip(&c.loops).zip(c.loop_nodes()).zip(guesses).zip(switches).zip(&mut open)
    {
        let has_branches = n.has_branches();
        let imposed = || !model.pool.contains_any(*r, &|s| s != *z && loops.contains(&s));
        // The same of a law that all but blocks there: what a diode bears follows from the step too.
        let pull = match n.how {
            Output::Implicit { .. } => switch,
            Output::Curve { .. } | Output::Explicit(_) => has_branches.then_some(pull.curves),
        };
        let may_be_open = if has_branches { observed } else { midway };
        bare.push(has_branches || midway && pull.is_some());
        let alone = imposed() && !reads(c, model, form, n);
        coupled |= has_branches && !alone && c.may_be_undetermined();
        if let Some(pull) = pull
            && alone
        {
            *open = may_be_open;
            let before = bound(model, lowering, &format!("{} before", model.pool.name(*z)), *guess);
            let s = model.pool.var(*z);
            let mut little = model.pool.float(pull);
            if switch.is_some() && midway {
                let half = half.get_or_insert_with(|| half_step(c, model, b, lowering, last));
                little = model.pool.mul(little, *half);
                let slope = model.pool.derivative(*r, *z);
                let slope = model.pool.substitute(slope, &FxHashMap::from_iter([(*z, before)]));
                let slope = model.pool.unary(Unary::Abs, slope);
                let whole = model.pool.add(little, slope);
                let square = model.pool.powi(little, 2);
                let less = model.pool.div(square, whole);
                // By a slope that is infinite, or none, the law determines all.
                let (most, zero) = (model.pool.float(f64::MAX), model.pool.int(0));
                let told = model.pool.binary(Binary::Le, whole, most);
                little = model.pool.select(told, less, zero);
            }
            let off = model.pool.sub(s, before);
            let pull = model.pool.mul(little, off);
            *r = model.pool.add(*r, pull);
        }
    }
    // Power counts here as energy does in a step.
    let one = model.pool.int(1);
    let mut weight = error_weights::weights_of_loops(c, model, form, b, lowering, guesses, one)?;
    let mut scale = error_weights::scales(c, model, form, b, lowering, (&[], &[], guesses), None)?;
    speeds.solve(c, (model, form), (b, lowering), guesses)?;
    let measured = (&mut residuals[..], &mut weight[..], &mut scale[..]);
    constraints::measure_instant(c, (model, form), (b, lowering), guesses, measured)?;
    let mut start = guesses.to_vec();
    for (i, node) in c.loop_nodes().into_iter().enumerate().filter(|(i, _)| needed[*i]) {
        if smoothness::is_flat(node, &mut model.pool) {
            let root = Root { loops: &c.loops, guesses, residual: residuals[i], i };
            (start[i], scale[i]) = root.find(model, b, lowering, scale[i])?;
        }
    }
    if observed && c.loops.len() <= LOOPS && bare.iter().zip(&needed).any(|(bare, needed)| *bare && *needed) {
        let sizes = (&weight[..], &scale[..]);
        let regularised = Regularised { flat: &now, free: &free, held: &residuals, open: &open, coupled, sizes };
        let (found, loops) = regularised.solve((c, model), b, lowering, &start, last)?;
        let known = regularised.unless(found, (c, model, lowering), &residuals, &loops);
        for (value, start) in loops.into_iter().zip(&mut start) {
            *start = b.select(found, value, *start);
        }
        residuals = known;
    }
    let unknowns = kept(&c.loops, &needed);
    let bends = c.exponential_knees().into_iter().filter(|(z, _)| unknowns.contains(z)).collect();
    let system = System {
        start: kept(&start, &needed),
        residuals: kept(&residuals, &needed),
        weight: kept(&weight, &needed),
        scale: kept(&scale, &needed),
        knees: bends,
        unknowns,
        undetermined: c.may_be_undetermined(),
        redundant: c.redundant,
        ..System::default()
    };
    newton::solve(model, b, lowering, system)?;
    speeds.restore(model, b, lowering)?;
    Ok(flat)
}

/// How strongly each loop's unknown is held where its law is relay-like.
fn relay_pulls(c: &Cluster, model: &mut Model, form: &Form, switches: Switched) -> Vec<Option<f64>> {
    match switches {
        Switched::Free => vec![None; c.loops.len()],
        Switched::AtEnd => {
            relay::relays(c, model, form).into_iter().map(|s| Some(c.thresholds.regular.pull * s?.rest)).collect()
        }
        Switched::Midway { .. } => {
            let all = relay::relays(c, model, form);
            let nodes: Vec<_> = c.loop_nodes().into_iter().map(|n| n.resistor()).collect();
            let ends = |(s, column): (Option<Relay>, Option<ColumnId>)| column.filter(|_| s.is_some_and(|s| s.ends));
            all.into_iter().zip(nodes).map(|s| c.stiffness_at_start(model, form, ends(s)?)).collect()
        }
    }
}

/// What a law without a slope at 0 gives, as an orifice, is a root. From a flow of next to nothing it would be sought
/// far beyond, and come back by halves; and by the slope there it would count as found where it is wrong by as much.
struct Root<'a> {
    loops: &'a [Symbol],
    guesses: &'a [Value],
    residual: Expr,
    i: usize,
}

/// How often the size of a root goes half the way, by its logarithm, to what the law's secant from 0 says, from 1 in SI
/// units: of a square once is enough, of a cube what is left is halved each time.
const HALFWAY: usize = 4;

impl Root<'_> {
    /// Where to start, the nearest of the guess and the root's size to both sides, and what it is measured against, no
    /// more than `scale`.
    fn find(
        &self,
        model: &Model,
        b: &mut Builder,
        lowering: &Lowering,
        scale: Value,
    ) -> Result<(Value, Value), Vec<Diagnostic>> {
        let off = |b: &mut Builder, z: Value| {
            let mut at = lowering.clone();
            self.loops.iter().zip(self.guesses).for_each(|(z, guess)| at.bind(*z, *guess));
            at.bind(self.loops[self.i], z);
            at.lower(&model.pool, b, self.residual).map_err(|s| missing(model, s))
        };
        let (zero, mut size) = (b.number(0.0), b.number(1.0));
        let given = off(b, zero)?;
        for _ in 0..HALFWAY {
            let there = off(b, size)?;
            let told = b.sub(there, given);
            let part = b.div(given, told);
            let part = b.unary(Unary::Abs, part);
            let part = b.unary(Unary::Sqrt, part);
            size = b.mul(size, part);
        }
        let most = b.number(model.settings.thresholds.newton.chord.range);
        let told = b.binary(Binary::Lt, size, most);
        size = b.select(told, size, zero);
        let guess = self.guesses[self.i];
        let (mut start, mut least) = (guess, off(b, guess)?);
        least = b.unary(Unary::Abs, least);
        let other = b.unary(Unary::Neg, size);
        for z in [size, other] {
            let r = off(b, z)?;
            let r = b.unary(Unary::Abs, r);
            let nearer = b.binary(Binary::Lt, r, least);
            (start, least) = (b.select(nearer, z, start), b.select(nearer, r, least));
        }
        let guess = b.unary(Unary::Abs, guess);
        let whole = b.add(guess, size);
        let less = b.binary(Binary::Lt, whole, scale);
        Ok((start, b.select(less, whole, scale)))
    }
}

/// A symbol for a value.
fn bound(model: &mut Model, lowering: &mut Lowering, name: &str, value: Value) -> Expr {
    let symbol = model.pool.symbol(name);
    lowering.bind(symbol, value);
    model.pool.var(symbol)
}

/// A law whose slope is less than this part of what it is half a step of the backward Euler method later does not
/// determine its unknown: the motion of the states does.
const TELLS: f64 = 1e-3;

/// So much of what laws in one loop change by half a step later comes to what they are, so often.
const PART: f64 = 1e-2;

const ROUNDS: usize = 3;

/// Loops of which some laws may be in a vertical branch, as dry friction that holds, or in a horizontal one, as a diode
/// that blocks, for what the states impose: what such a law gives follows from where the states go on to. A force that
/// holds a body at rest is what leaves it there.
struct Regularised<'a> {
    flat: &'a FxHashMap<Symbol, Expr>,
    /// The residuals of the instant, and with each law near what the step found.
    free: &'a [Expr],
    held: &'a [Expr],
    /// Laws that are asked for by the states alone, and may be such.
    open: &'a [bool],
    /// Whether several laws stand in one loop, which may leave open together what each of them gives.
    coupled: bool,
    /// Weights and scales.
    sizes: (&'a [Value], &'a [Value]),
}

impl Regularised<'_> {
    /// Whether the loops were solved, and the unknowns: near what the step found; from there with the laws that
    /// determine their unknowns as they are, the others over half a step of the backward Euler method; and those of the
    /// others that determine them then, as where a body is let go, as they are too. Where nothing is found near what
    /// the step found, as of two dry frictions in series at rest, all over half such a step.
    fn solve(
        &self,
        (c, model): (&Cluster, &mut Model),
        b: &mut Builder,
        lowering: &mut Lowering,
        start: &[Value],
        last: Option<Value>,
    ) -> Result<(Value, Vec<Value>), Vec<Diagnostic>> {
        let half = half_step(c, model, b, lowering, last);
        let mut moved = FxHashMap::default();
        for s in c.states.iter().filter(|s| !s.jumps) {
            let rate = model.pool.substitute(s.rate, self.flat);
            let step = model.pool.mul(half, rate);
            let x = model.pool.var(s.symbol);
            moved.insert(s.symbol, model.pool.add(x, step));
        }
        let mut later: Vec<Expr> = self.free.iter().map(|r| model.pool.substitute(*r, &moved)).collect();
        // A source that such a law hands on to a state takes that along.
        if let Some(time) = c.time {
            for (r, later) in self.free.iter().zip(&mut later) {
                let rate = model.pool.derivative(*r, time);
                let change = model.pool.mul(half, rate);
                *later = model.pool.add(*later, change);
            }
        }
        if self.coupled {
            return self.together((c, model), b, lowering, start, &later);
        }
        let (near, mut loops) = self.find((c, model), b, lowering, self.held, start)?;
        let ahead = self.unless(near, (c, model, lowering), &later, &loops);
        let (far, ahead) = self.find((c, model), b, lowering, &ahead, start)?;
        let found = b.binary(Binary::Max, near, far);
        loops = loops.into_iter().zip(ahead).map(|(one, other)| b.select(near, one, other)).collect();
        if !self.open.contains(&true) {
            return Ok((found, loops));
        }
        let mut first: Vec<(Value, Expr)> = Vec::new();
        for round in 0..2 {
            let mut at = lowering.clone();
            c.loops.iter().zip(&loops).for_each(|(z, value)| at.bind(*z, *value));
            let mut residuals = self.free.to_vec();
            let mut k = 0;
            for (((r, later), z), _) in residuals.iter_mut().zip(&later).zip(&c.loops).zip(self.open).filter(|t| *t.1) {
                let pool = &mut model.pool;
                let [now, then] = [*r, *later].map(|r| {
                    let slope = pool.derivative(r, *z);
                    pool.unary(Unary::Abs, slope)
                });
                let part = pool.scale(then, Number::float(TELLS));
                let steep = pool.binary(Binary::Le, part, now);
                let mut steep = at.lower(&model.pool, b, steep).map_err(|s| missing(model, s))?;
                // What the law and the state differ by in the horizontal branch, as what rings by, is none of its way.
                let off = if round == 0 {
                    let off = at.lower(&model.pool, b, *r).map_err(|s| missing(model, s))?;
                    let off = bound(model, lowering, "off", off);
                    first.push((steep, off));
                    off
                } else {
                    steep = b.binary(Binary::Max, steep, first[k].0);
                    k += 1;
                    first[k - 1].1
                };
                let steep = bound(model, lowering, "tells", steep);
                let pool = &mut model.pool;
                let zero = pool.zero();
                let steep = pool.binary(Binary::Lt, zero, steep);
                let onward = pool.sub(*later, off);
                *r = pool.select(steep, *r, onward);
            }
            let (good, now) = self.find((c, model), b, lowering, &residuals, &loops)?;
            let good = b.mul(good, near);
            loops = loops.into_iter().zip(now).map(|(before, now)| b.select(good, now, before)).collect();
        }
        Ok((found, loops))
    }

    /// The same of laws in one loop: which of them determine their unknowns, only all their equations say together. So
    /// it begins where they are half a step later, and each equation gets a part of what that changes by, anew from
    /// where it has led: what is determined comes to what it is, by that part each time, and of what is not that is all
    /// there is.
    fn together(
        &self,
        (c, model): (&Cluster, &mut Model),
        b: &mut Builder,
        lowering: &mut Lowering,
        start: &[Value],
        later: &[Expr],
    ) -> Result<(Value, Vec<Value>), Vec<Diagnostic>> {
        let (mut found, mut loops) = self.find((c, model), b, lowering, later, start)?;
        for _ in 0..ROUNDS {
            let mut there = lowering.clone();
            c.loops.iter().zip(&loops).for_each(|(z, value)| there.bind(*z, *value));
            let mut with = Vec::with_capacity(later.len());
            for (r, later) in self.free.iter().zip(later) {
                let known = there.lower(&model.pool, b, *later).map_err(|s| missing(model, s))?;
                let known = bound(model, lowering, "later there", known);
                let change = model.pool.sub(*later, known);
                with.push(model.pool.combine(&[(*r, Number::ONE), (change, Number::float(PART))]));
            }
            let (good, now) = self.find((c, model), b, lowering, &with, &loops)?;
            found = b.binary(Binary::Max, found, good);
            loops = loops.into_iter().zip(now).map(|(before, now)| b.select(good, now, before)).collect();
        }
        Ok((found, loops))
    }

    /// Residuals that are 0 where the loops were found, and these others where they were not.
    fn unless(
        &self,
        found: Value,
        (c, model, lowering): (&Cluster, &mut Model, &mut Lowering),
        others: &[Expr],
        loops: &[Value],
    ) -> Vec<Expr> {
        let known = bound(model, lowering, "found", found);
        let zero = model.pool.zero();
        let known = model.pool.binary(Binary::Lt, zero, known);
        let mut list = Vec::with_capacity(others.len());
        for ((other, z), value) in others.iter().zip(&c.loops).zip(loops) {
            let there = bound(model, lowering, &format!("{} there", model.pool.name(*z)), *value);
            let z = model.pool.var(*z);
            let off = model.pool.sub(z, there);
            list.push(model.pool.select(known, off, *other));
        }
        list
    }

    /// Solves residuals: whether that was found, and the unknowns.
    fn find(
        &self,
        (c, model): (&Cluster, &mut Model),
        b: &mut Builder,
        lowering: &Lowering,
        residuals: &[Expr],
        start: &[Value],
    ) -> Result<(Value, Vec<Value>), Vec<Diagnostic>> {
        let mut lowering = lowering.clone();
        let flag = b.slot(Array::Local);
        let one = b.number(1.0);
        b.store(flag, one);
        let system = System {
            start: start.to_vec(),
            residuals: residuals.to_vec(),
            weight: self.sizes.0.to_vec(),
            scale: self.sizes.1.to_vec(),
            knees: c.exponential_knees(),
            unknowns: c.loops.clone(),
            flag: Some(flag),
            undetermined: c.may_be_undetermined(),
            redundant: c.redundant,
            ..System::default()
        };
        newton::solve(model, b, &mut lowering, system)?;
        let found = b.load(flag);
        let mut values = Vec::with_capacity(c.loops.len());
        for z in &c.loops {
            let z = model.pool.var(*z);
            values.push(lowering.lower(&model.pool, b, z).map_err(|s| missing(model, s))?);
        }
        Ok((found, values))
    }
}

/// Half the length of the last step, of a long one where that is 0.
fn half_step(c: &Cluster, model: &mut Model, b: &mut Builder, lowering: &mut Lowering, last: Option<Value>) -> Expr {
    let long = 0.5 * c.start(model).step;
    let Some(last) = last else { return model.pool.float(long) };
    let (half, zero, long) = (b.number(0.5), b.number(0.0), b.number(long));
    let known = b.binary(Binary::Lt, zero, last);
    let last = b.mul(half, last);
    let last = b.select(known, last, long);
    bound(model, lowering, "half the last step", last)
}

/// Those of a list that are needed.
fn kept<T: Copy>(all: &[T], needed: &[bool]) -> Vec<T> {
    all.iter().zip(needed).filter(|(_, needed)| **needed).map(|(x, _)| *x).collect()
}

/// The loops that something depends on, and what these depend on.
fn needed(c: &Cluster, pool: &Pool, residuals: &[Expr], mut roots: Vec<Expr>) -> Vec<bool> {
    let at: FxHashMap<Symbol, usize> = c.loops.iter().enumerate().map(|(i, z)| (*z, i)).collect();
    let mut needed = vec![false; c.loops.len()];
    while let Some(e) = roots.pop() {
        for i in pool.symbols(e).iter().filter_map(|s| at.get(s)) {
            if !std::mem::replace(&mut needed[*i], true) {
                roots.push(residuals[*i]);
            }
        }
    }
    needed
}

/// Whether what a resistor receives depends on any output that is computed, and so perhaps on its own.
fn reads(c: &Cluster, model: &mut Model, form: &Form, n: &cluster::Node) -> bool {
    let Some(column) = n.resistor() else { return true };
    let input = form.input(&mut model.pool, column);
    let symbols = model.pool.symbols(input);
    c.nodes.iter().any(|m| m.source().is_none() && symbols.contains(&m.out))
}
