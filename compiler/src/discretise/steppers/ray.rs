//! The paper's own step (Stramigioli, Secchi, van der Schaft, Fantuzzi 2002), section 3: with e_C = dH/dx at x_k,
//! dH = -T f_R^T R f_R - T e_I^T f_I, and the next state is where the line x_k + s f_C meets the level set H(x_k) + dH,
//! the s nearest T. Where it does not meet it, the state leaps to its mirror image on the line through the minimum of
//! H, at the same energy, and the energy that is missing is booked.

use crate::discretise::analysis::energy_minimum;
use crate::discretise::cluster::{Cluster, State, missing, verified};
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::system::System;
use crate::discretise::equations::{accounts, constraints, ledger, newton, output_equations};
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;

use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use rustc_hash::FxHashMap;

/// The step of a cluster.
pub(crate) fn step(label: Label, c: &mut Cluster, model: &mut Model, form: &Form) -> Result<Step, Refusal> {
    if !c.driving_sources.is_empty() {
        let why = "one of its storages follows a source, for which the construction along a line is not defined";
        return Err(Refusal::Unfit(why.into()));
    }
    if c.has_constraints() {
        return Err(Refusal::Unfit(constraints::TIED.into()));
    }
    Ok(write(label, c, model, form)?)
}

/// Writes the step.
fn write(label: Label, c: &Cluster, model: &mut Model, form: &Form) -> Result<Step, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, &format!("{} step", label.name)));
    let mut entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let pull =
        output_equations::Pull { curves: c.thresholds.regular.slight_pull, switches: output_equations::Switched::Free };
    let flat = output_equations::outputs(c, model, form, &mut b, &mut lowering, (&inputs.guesses, pull), None)?;
    ledger::ledger(c, model, form, &mut b, &mut lowering, &[(1.0, &flat)], &entries, (inputs.h, None))?;
    let mut writing = Writing::new((c, model, form), (b, lowering), &inputs, &flat)?;
    let line = writing.line()?;
    let mirror = writing.mirror()?;
    let next = writing.next_states(&line, &mirror)?;
    writing.store(&next, &flat)?;
    let Writing { model, mut b, target, total, zero, .. } = writing;
    ledger::energies(c, (model, form), &mut b, (&next, &[]), &inputs, &entries)?;
    // What a leap missed: H+ - target where there was one.
    let mut at = Lowering::new(c.states.iter().map(|s| s.symbol).zip(next.iter().copied()));
    let after = at.lower(&model.pool, &mut b, total).map_err(|s| missing(model, s))?;
    let miss = b.sub(after, target);
    let leapt = b.unary(Unary::Not, line.met);
    let moving = b.unary(Unary::Not, line.stands);
    let leapt = b.binary(Binary::And, leapt, moving);
    let miss = b.select(leapt, miss, zero);
    let (energy, count) = (b.named(Array::Output, "leap energy"), b.named(Array::Output, "leaps"));
    b.store(energy, miss);
    b.store(count, leapt);
    if let Some(e) = entries.first_mut() {
        e.leap = Some((energy.index as usize, count.index as usize));
    }
    let program = verified(model, b.finish())?;
    Ok((label.stepper(program), entries))
}

/// What writes a step.
struct Writing<'a> {
    c: &'a Cluster,
    model: &'a mut Model,
    form: &'a Form,
    b: Builder,
    lowering: Lowering,
    inputs: &'a Inputs,
    /// The rates of the states at the start.
    rates: Vec<Value>,
    /// The energy, at the start, and as it should be at the end; and the change between.
    total: Expr,
    before: Value,
    target: Value,
    change: Value,
    zero: Value,
}

/// The states along the rate.
struct Line {
    states: FxHashMap<Symbol, Expr>,
    /// Whether they meet the level set.
    met: Value,
    /// Whether they stay, being on the level set already.
    stands: Value,
}

/// The mirror image of the states: x_min - m (x - x_min).
struct Mirror {
    states: Vec<Expr>,
    /// By state, where its energy is least; nothing of an entropy, which stays: heat is not turned into work.
    minimum: Vec<Option<f64>>,
    /// Whether one with the same energy was found.
    found: Value,
}

impl<'a> Writing<'a> {
    fn new(
        (c, model, form): (&'a Cluster, &'a mut Model, &'a Form),
        (mut b, mut lowering): (Builder, Lowering),
        inputs: &'a Inputs,
        flat: &FxHashMap<Symbol, Expr>,
    ) -> Result<Self, Vec<Diagnostic>> {
        let mut rates: Vec<Value> = Vec::new();
        for s in &c.states {
            let e = model.pool.substitute(s.rate, flat);
            rates.push(lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?);
        }
        // The change of energy is the power into the storages times T: their outputs times their rates.
        let mut change: Option<Value> = None;
        for (s, rate) in c.states.iter().zip(&rates) {
            let Some(column) = s.column else { continue };
            let z = model.pool.var(form.column(column).out);
            let z = model.pool.substitute(z, flat);
            let z = lowering.lower(&model.pool, &mut b, z).map_err(|s| missing(model, s))?;
            let p = b.mul(z, *rate);
            let w = b.mul(inputs.h, p);
            change = Some(match change {
                Some(c) => b.add(c, w),
                None => w,
            });
        }
        let zero = b.number(0.0);
        let change = change.unwrap_or(zero);
        let total = c.regions.iter().map(|r| c.energy(&mut model.pool, *r)).collect::<Vec<_>>();
        let total = model.pool.sum(&total);
        let before = lowering.lower(&model.pool, &mut b, total).map_err(|s| missing(model, s))?;
        let target = b.add(before, change);
        Ok(Self { c, model, form, b, lowering, inputs, rates, total, before, target, change, zero })
    }

    fn lower(&mut self, e: Expr) -> Result<Value, Vec<Diagnostic>> {
        self.lowering.lower(&self.model.pool, &mut self.b, e).map_err(|s| missing(self.model, s))
    }

    /// Solves for one number of the size of 1; whether that was found.
    fn solve(&mut self, unknown: Symbol, start: Value, residual: Expr) -> Result<Value, Vec<Diagnostic>> {
        let flag = self.b.slot(Array::Local);
        let unit = self.b.number(1.0);
        let system = System {
            unknowns: vec![unknown],
            start: vec![start],
            residuals: vec![residual],
            weight: vec![unit],
            scale: vec![unit],
            flag: Some(flag),
            ..System::default()
        };
        newton::solve(self.model, &mut self.b, &mut self.lowering, system)?;
        Ok(self.b.load(flag))
    }
    /// Solves for where the line along the rate meets the level set: H(x + s f) = target, with s = T (1 + r).
    fn line(&mut self) -> Result<Line, Vec<Diagnostic>> {
        let (c, pool) = (self.c, &mut self.model.pool);
        let (r, f): (Symbol, Vec<Symbol>) =
            (pool.symbol("r"), c.states.iter().map(|s| pool.symbol(&format!("rate({})", s.name))).collect());
        let goal = pool.symbol("target");
        for (s, v) in f.iter().zip(&self.rates) {
            self.lowering.bind(*s, *v);
        }
        self.lowering.bind(goal, self.target);
        let h = c.h.map(|h| pool.var(h)).unwrap_or_else(|| pool.int(1));
        let one = pool.int(1);
        let along = {
            let r = pool.var(r);
            let s = pool.add(one, r);
            pool.mul(h, s)
        };
        let along_rate = |(s, f): (&State, &Symbol)| {
            let (x, f) = (pool.var(s.symbol), pool.var(*f));
            let d = pool.mul(along, f);
            (s.symbol, pool.add(x, d))
        };
        let states: FxHashMap<Symbol, Expr> = c.states.iter().zip(&f).map(along_rate).collect();
        let moved = pool.substitute(self.total, &states);
        let goal = pool.var(goal);
        let residual = pool.sub(moved, goal);
        let met = self.solve(r, self.zero, residual)?;
        // Where an energy is flat, as beyond a stop, next to no slope is left to go by: what is found has to be on the
        // level.
        let there = self.lower(moved)?;
        let met = on_level(&mut self.b, met, there, self.target, self.before);
        // Without a change of energy the state may go the whole way if that is as high; else it stays, being on the
        // level set already.
        let full: FxHashMap<Symbol, Expr> = std::iter::once((r, self.model.pool.int(0))).collect();
        let off = self.model.pool.substitute(residual, &full);
        let off = self.lower(off)?;
        let level = self.b.binary(Binary::Eq, off, self.zero);
        let uneven = self.b.unary(Unary::Not, level);
        let stands = self.b.binary(Binary::Eq, self.change, self.zero);
        let stands = self.b.binary(Binary::And, stands, uneven);
        Ok(Line { states, met, stands })
    }

    /// Solves for the mirror image at the same energy.
    fn mirror(&mut self) -> Result<Mirror, Vec<Diagnostic>> {
        let c = self.c;
        let mut minimum = vec![Some(0.0); c.states.len()];
        for g in &c.groups {
            for s in &g.states {
                let is_entropy = c.states[*s].column.is_some_and(|c| accounts::is_thermal(self.model, self.form, c));
                minimum[*s] = (!is_entropy).then(|| energy_minimum::state_of_minimum(self.model, g, c, *s));
            }
        }
        let pool = &mut self.model.pool;
        let m = pool.symbol("mirror");
        let mirrored = |(s, low): (&State, &Option<f64>)| {
            let x = pool.var(s.symbol);
            let Some(low) = *low else { return x };
            let (low, m) = (pool.float(low), pool.var(m));
            let off = pool.sub(x, low);
            let back = pool.mul(m, off);
            pool.sub(low, back)
        };
        let states: Vec<Expr> = c.states.iter().zip(&minimum).map(mirrored).collect();
        let map: FxHashMap<Symbol, Expr> = c.states.iter().map(|s| s.symbol).zip(states.iter().copied()).collect();
        let there = pool.substitute(self.total, &map);
        let residual = pool.sub(there, self.total);
        let unit = self.b.number(1.0);
        let found = self.solve(m, unit, residual)?;
        let there = self.lower(there)?;
        let found = on_level(&mut self.b, found, there, self.before, self.before);
        Ok(Mirror { states, minimum, found })
    }

    /// The states at the end: where the line meets the level set, else the mirror image, else the minimum.
    fn next_states(&mut self, line: &Line, mirror: &Mirror) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let c = self.c;
        let one = self.model.pool.int(1);
        let mut next = Vec::new();
        for (i, s) in c.states.iter().enumerate() {
            let on_line = self.lower(*line.states.get(&s.symbol).unwrap_or(&one))?;
            let image = self.lower(mirror.states[i])?;
            let x = self.inputs.states[i];
            let low = mirror.minimum[i].map_or(x, |low| self.b.number(low));
            let leap = self.b.select(mirror.found, image, low);
            let chosen = self.b.select(line.met, on_line, leap);
            if s.column.is_none() {
                // A signal state has no energy, and goes its own way.
                let change = self.b.mul(self.inputs.h, self.rates[i]);
                next.push(self.b.add(x, change));
                continue;
            }
            next.push(self.b.select(line.stands, x, chosen));
        }
        Ok(next)
    }

    /// Stores the state at the end.
    fn store(&mut self, next: &[Value], flat: &FxHashMap<Symbol, Expr>) -> Result<(), Vec<Diagnostic>> {
        self.b.slots(Array::Next, self.c.slots());
        inputs::no_carry(&mut self.b, self.c);
        for (i, v) in next.iter().enumerate() {
            self.b.store(Slot::new(Array::Next, i), *v);
        }
        let writer = (&mut self.b, &mut self.lowering);
        inputs::store_integrals(self.c, self.model, writer, self.inputs, (flat, &[]))?;
        let loops = inputs::loops(self.c, self.model, (&mut self.b, &mut self.lowering))?;
        inputs::store_loops(self.c, &mut self.b, &loops);
        Ok(())
    }
}

/// An energy that differs from what it should be by no more than this part of the larger one is that.
const SAME: f64 = 1e-9;

/// Whether what was found is where the energy is what it should be, beside what there was.
fn on_level(b: &mut Builder, found: Value, there: Value, wanted: Value, before: Value) -> Value {
    let off = b.sub(there, wanted);
    let (off, wanted, before) = (b.unary(Unary::Abs, off), b.unary(Unary::Abs, wanted), b.unary(Unary::Abs, before));
    let (size, part) = (b.binary(Binary::Max, wanted, before), b.number(SAME));
    let most = b.mul(part, size);
    let is_there = b.binary(Binary::Le, off, most);
    b.binary(Binary::And, found, is_there)
}
