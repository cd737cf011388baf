//! One linear solve a step: the non-iterative stepper, with a quadratised energy.
//!
//! The quadratic energies H_q are taken by the midpoint rule. Any other energy V is kept as a number W of its own,
//! which starts as V(x) and then goes its own way (scalar auxiliary variables: Shen, Xu and Yang, J. Comput. Phys. 353,
//! 2018; for mechanics: Bilbao, Ducceschi and Zama, J. Comput. Phys. 472, 2023). With x* the middle of the step as it
//! is predicted, a shift c, r = sqrt(2 (V(x) + c)) and g = dV/dx(x*) / sqrt(2 (V(x*) + c)),
//!
//!   e = g rbar,  rbar = r + g . d / 2,      W+ = W + ((r + g . d)^2 - r^2) / 2 = W + e . d,      d = x+ - x
//!
//! is linear in d, and e the co-energy variables of an energy that is exactly W. Everything that is not linear stands
//! at x*: ratios, and of each law its chord, z = (law(f*) / f*) f, which is passive where the law is. So what is
//! stored, H_q + W, less what it was, is what was supplied less what was dissipated, of each by its own formula,
//! whatever x* was.
//!
//! With r taken from W, as is usual, a force would be off for good once W is, also at rest. So r is taken from V(x), as
//! long as W is not far below that: r = sqrt(2 (min(V(x), W + s/2) + c)), s = c + min V, where s is the largest energy
//! that the region ever held. Since rbar g . d >= -r^2 / 2, W never falls below -c - s/2. How far W is from V is taken
//! back out of the motion, by adding to g what makes g . d* less by that; it changes a force by a tenth at most.

mod auxiliary_energy;
mod predictor;

use crate::discretise::cluster::{Cluster, Part, missing, verified};
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::system::System;
use crate::discretise::equations::{constraints, discrete_gradient, ledger, newton};
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Expr, Growth, Lowering, Node, Number, Pool, Sign, Symbol, growth};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output, Row};
use auxiliary_energy::{AuxiliaryEnergy, Stores};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::Entries;
use predictor::{Layout, Prediction, middle};
use rustc_hash::{FxHashMap, FxHashSet};

/// What takes the distance of W from V back changes a force by no more than its part 1 / (2 GENTLE).
const GENTLE: f64 = 5.0;

/// What is at hand while a step is written.
struct Writing<'a> {
    c: &'a Cluster,
    model: &'a mut Model,
    form: &'a Form,
    b: &'a mut Builder,
    lowering: &'a mut Lowering,
    predicted: Prediction,
    /// Expressions that have a value before the solution, and the symbols that stand for them.
    held: FxHashMap<Expr, Expr>,
    /// The step's unknowns.
    unknowns: Vec<Symbol>,
    /// Outputs in terms of the unknowns, and the states in the middle.
    map: FxHashMap<Symbol, Expr>,
}

type Found<T> = Result<T, Vec<Diagnostic>>;

impl Writing<'_> {
    fn value(&mut self, e: Expr) -> Found<Value> {
        self.lowering.lower(&self.model.pool, self.b, e).map_err(|s| missing(self.model, s))
    }

    /// A symbol for a value.
    fn call(&mut self, name: &str, value: Value) -> Expr {
        let symbol = self.model.pool.symbol(name);
        self.lowering.bind(symbol, value);
        self.model.pool.var(symbol)
    }

    /// An expression without unknowns, under a symbol of its own.
    fn hold(&mut self, e: Expr) -> Found<Expr> {
        if self.model.pool.constant(e).is_some() {
            return Ok(e);
        }
        if let Some(known) = self.held.get(&e) {
            return Ok(*known);
        }
        let value = self.value(e)?;
        let known = self.call("known", value);
        self.held.insert(e, known);
        Ok(known)
    }

    /// An expression as it is predicted.
    fn tell(&mut self, e: Expr) -> Found<Expr> {
        let e = self.model.pool.substitute(e, &self.predicted.star);
        self.hold(e)
    }

    /// The ratios of the cluster as they are predicted: with these the step is solved and its powers are counted.
    fn ratios(&mut self) -> Found<Vec<(usize, Row)>> {
        let form = self.form;
        let own = form.columns.iter().enumerate().filter(|(_, column)| self.c.regions.contains(&column.region));
        let mut list = Vec::new();
        for (i, column) in own.collect::<Vec<_>>() {
            let told = column.row.iter().map(|(j, k)| Ok((*j, self.tell(*k)?))).collect::<Found<Row>>()?;
            list.push((i, told));
        }
        Ok(list)
    }

    /// What a column receives, in terms of the unknowns.
    fn input(&mut self, column: ColumnId) -> Found<Expr> {
        let form = self.form;
        let mut terms = Vec::new();
        for (j, k) in &form.column(column).row {
            let out = form.column(*j).out;
            let z = self.map.get(&out).copied().unwrap_or_else(|| self.model.pool.var(out));
            terms.push(self.model.pool.mul(*k, z));
        }
        Ok(self.model.pool.sum(&terms))
    }

    /// An expression in terms of the unknowns where it is affine in them, else as it is predicted.
    fn linear(&mut self, e: Expr) -> Found<Expr> {
        let whole = self.model.pool.substitute(e, &self.map);
        let Some((linear, rest)) = self.model.pool.affine(whole, &self.unknowns) else { return self.tell(e) };
        let mut terms = vec![self.hold(rest)?];
        for (j, k) in linear {
            let k = self.hold(k)?;
            let u = self.model.pool.var(self.unknowns[j]);
            terms.push(self.model.pool.mul(k, u));
        }
        Ok(self.model.pool.sum(&terms))
    }

    /// A law as a straight line through what it gives at 0 and at the argument predicted: value at 0, and slope.
    fn chord(&mut self, (argument, law): (Symbol, Expr), at: Expr) -> Found<(Expr, Expr)> {
        let at = self.tell(at)?;
        let y = self.model.pool.symbol("argument");
        let pool = &mut self.model.pool;
        let own = pool.var(y);
        let law = pool.substitute(law, &std::iter::once((argument, own)).collect());
        let law = pool.substitute(law, &self.predicted.star);
        let zero = pool.int(0);
        let slope = pool.difference(law, y, zero, at);
        let base = pool.substitute(law, &std::iter::once((y, zero)).collect());
        let slope = self.value(slope)?;
        // A law whose slope at 0 is infinite gives nothing in the step in which its argument is still 0.
        let none = self.b.number(0.0);
        let test = self.b.mul(none, slope);
        let sound = self.b.binary(Binary::Eq, test, none);
        let slope = self.b.select(sound, slope, none);
        Ok((self.hold(base)?, self.call("chord", slope)))
    }
}

/// What an auxiliary energy gives in a step.
struct Given {
    /// The factor of each state's co-energy variable, and what they all share.
    factors: Vec<Expr>,
    rbar: Expr,
    /// `Σ factor d`
    moved: Expr,
}

impl Writing<'_> {
    /// The co-energy variables of an auxiliary energy.
    fn open(&mut self, v: &AuxiliaryEnergy, w: Value, size: Value) -> Found<Given> {
        let there = self.tell(v.energy)?;
        let there = self.value(there)?;
        let here = self.value(v.energy)?;
        let slopes = v.slopes.iter().map(|z| self.tell(*z)).collect::<Found<Vec<_>>>()?;
        let slopes = slopes.into_iter().map(|z| self.value(z)).collect::<Found<Vec<_>>>()?;
        let mut curvatures = Vec::new();
        for (z, s) in v.slopes.iter().zip(&v.states) {
            // Of one state it cancels out.
            let k = match v.states.len() {
                1 => self.model.pool.one(),
                _ => self.model.pool.derivative(*z, self.c.states[*s].symbol),
            };
            let k = self.tell(k)?;
            curvatures.push(self.value(k)?);
        }
        let changes: Vec<Value> = v.states.iter().map(|s| self.predicted.changes[*s]).collect();
        let b = &mut *self.b;
        let (zero, two, one) = (b.number(0.0), b.number(2.0), b.number(1.0));
        let half = b.number(0.5);
        let room = b.mul(half, size);
        let allowed = b.add(w, room);
        let from = b.binary(Binary::Min, here, allowed);
        let least = match v.least {
            Some(least) => b.number(least),
            None => here,
        };
        let low = b.binary(Binary::Min, least, there);
        let root = |b: &mut Builder, x: Value| {
            let up = b.sub(x, low);
            let up = b.add(up, size);
            let up = b.binary(Binary::Max, up, zero);
            let up = b.mul(two, up);
            b.unary(Unary::Sqrt, up)
        };
        let (r, root) = (root(b, from), root(b, there));
        let some = b.binary(Binary::Lt, zero, root);
        let inverse = b.div(one, root);
        let inverse = b.select(some, inverse, zero);
        // What is added to the forces takes the distance of W from V back from the motion as it is predicted, and stays
        // small beside them.
        let off = b.sub(w, here);
        let mut factors: Vec<Value> = slopes.iter().map(|f| b.mul(*f, inverse)).collect();
        let sizes: Vec<Value> = factors
            .iter()
            .zip(&curvatures)
            .map(|(g, k)| {
                let k = b.unary(Unary::Abs, *k);
                let square = b.mul(*g, *g);
                b.add(k, square)
            })
            .collect();
        let (mut way, mut force) = (zero, zero);
        let mut pulls = Vec::new();
        for ((f, d), m) in slopes.iter().zip(&changes).zip(&sizes) {
            let pull = b.mul(*m, *d);
            let square = b.mul(pull, *d);
            way = b.add(way, square);
            let square = b.mul(*f, *f);
            let square = b.div(square, *m);
            let some = b.binary(Binary::Lt, zero, *m);
            let square = b.select(some, square, zero);
            force = b.add(force, square);
            pulls.push(pull);
        }
        // Nor are they stiffer than the storage itself: at rest they would push to and fro.
        let gentle = b.number(GENTLE);
        let bound = b.mul(gentle, off);
        let bound = b.mul(bound, bound);
        let distance = b.unary(Unary::Abs, off);
        let stiff = b.mul(distance, force);
        let bound = b.add(bound, stiff);
        let sum = b.mul(way, force);
        let sum = b.add(sum, bound);
        let some = b.binary(Binary::Lt, zero, sum);
        let share = b.mul(off, force);
        let share = b.div(share, sum);
        let share = b.select(some, share, zero);
        let share = b.mul(share, inverse);
        for (g, pull) in factors.iter_mut().zip(pulls) {
            let part = b.mul(share, pull);
            *g = b.sub(*g, part);
        }
        let factors: Vec<Expr> = factors.into_iter().map(|g| self.call("factor", g)).collect();
        let r = self.call("root", r);
        let pool = &mut self.model.pool;
        let terms: Vec<Expr> = factors
            .iter()
            .zip(&v.states)
            .map(|(g, s)| {
                let d = pool.var(self.c.delta[*s]);
                pool.mul(*g, d)
            })
            .collect();
        let moved = pool.sum(&terms);
        let half = pool.scale(moved, Number::HALF);
        Ok(Given { factors, rbar: pool.add(r, half), moved })
    }
}

/// Whether something grows exponentially with one of some symbols.
fn grows(pool: &Pool, e: Expr, argument: &dyn Fn(Symbol) -> bool) -> bool {
    // What such a function gives is bounded, or far less than what it is given; so is what is compared.
    let passes = |e: Expr| match pool.node(e) {
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Power(..) | Node::Select(..) => {
            true
        }
        Node::Unary(f, _) => growth(*f) != Growth::Bounded,
        Node::Binary(op, ..) => match op {
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow | Binary::Min | Binary::Max => true,
            Binary::Atan2 | Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => false,
        },
    };
    pool.ascending(&[e], &passes).into_iter().any(|e| match pool.node(e) {
        Node::Power(_, a) => pool.contains_any(*a, argument),
        Node::Unary(f, a) => match growth(*f) {
            Growth::Bounded | Growth::Algebraic => false,
            Growth::Exponential => {
                pool.contains_any(*a, argument) && !pool.sign(*a, &|_| Sign::Unknown).is_nonpositive()
            }
            Growth::ExponentialBothWays => pool.contains_any(*a, argument),
        },
        Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Product(..) | Node::Binary(..) | Node::Select(..) => {
            false
        }
    })
}

/// Why the step cannot be taken, if it cannot.
fn refusal(c: &Cluster, pool: &Pool, form: &Form) -> Option<String> {
    if !c.driving_sources.is_empty() {
        return Some("a storage of it follows a source".into());
    }
    if c.has_constraints() {
        return Some(constraints::TIED.into());
    }
    let stored = c.groups.iter().find_map(|g| {
        let own = |s: Symbol| g.states.iter().any(|i| c.states[*i].symbol == s);
        let grows = g.coenergy.iter().any(|z| grows(pool, *z, &own));
        let column = g.states.iter().find_map(|i| c.states[*i].column);
        grows.then(|| column.map_or("", |column| &form.column(column).name))
    });
    // V at the middle predicted is then many times what is held, and what is kept in its place says nothing of it.
    let stored = stored.map(|name| {
        format!("the energy of `{name}` contains an exponential, whose predicted value may be far from the true one")
    });
    let law = c.nodes.iter().find_map(|n| {
        let column = n.resistor()?;
        let (region, name) = (&form.regions[form.column(column).region.at()], &form.column(column).name);
        if region.gains.contains_key(&column) {
            return None;
        }
        let law = region.laws.get(&column);
        match (law, n.how) {
            (None, Output::Curve { .. }) => {
                Some(format!("the law of `{name}` is a curve, which has no chord on its vertical branch"))
            }
            (None, Output::Explicit(_) | Output::Implicit { .. }) => Some(format!(
                "`{name}` is a port of a field whose laws are not linear, and a chord of each port alone is not passive"
            )),
            // Only the law itself limits how far its argument can get in a step.
            (Some((argument, law)), _) if grows(pool, *law, &|s| s == *argument) => Some(format!(
                "the law of `{name}` contains an exponential, whose chord at the predicted argument may be far from \
                the true value"
            )),
            // The chord is taken at what the step before found, and no storage keeps two steps from going to and fro.
            (Some(_), _) if c.loops.contains(&n.unknown()) => Some(format!(
                "the law of `{name}` has to be inverted, and the chords of successive steps may not converge to its \
                solution"
            )),
            (Some(_), Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. }) => None,
        }
    });
    law.or(stored)
}

/// A step in terms of its unknowns.
pub(crate) struct Plan {
    /// The form with the ratios as predicted.
    form: Form,
    /// Outputs, with states and time in the middle as predicted.
    pub(crate) flat: FxHashMap<Symbol, Expr>,
    pub(crate) unknowns: Vec<Symbol>,
    pub(crate) residuals: Vec<Expr>,
    /// What the unknowns start from.
    pub(crate) start: Vec<Value>,
    /// By auxiliary: the work done on it.
    works: Vec<(Expr, Expr)>,
    memory: Vec<Value>,
}

/// Room for what a cluster keeps of a step, and what it starts as.
pub(crate) fn reserve(c: &mut Cluster, model: &mut Model, form: &Form) -> Found<()> {
    let stores = Stores::new(c, model);
    let layout = Layout::new(c, stores.auxiliaries.len());
    c.memory = layout.len;
    c.kept = vec![0.0; layout.len];
    for (i, v) in stores.auxiliaries.iter().enumerate() {
        c.kept[layout.auxiliaries + 2 * i] = v.start;
    }
    for i in 0..c.regions.len() {
        c.kept[layout.sizes + i] = stores.above(i);
    }
    for (i, rate) in predictor::rates(c, model, form)?.into_iter().enumerate() {
        c.kept[layout.rates[0] + i] = rate;
    }
    Ok(())
}

/// Writes what is known before the solution, and gives the system. `more` are unknowns of the caller's.
pub(crate) fn plan(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    inputs: &Inputs,
    more: &[Symbol],
) -> Found<Plan> {
    let stores = Stores::new(c, model);
    let layout = Layout::new(c, stores.auxiliaries.len());
    let predicted = Prediction::new(c, (&mut model.pool, form), b, lowering, inputs, layout);
    let unknowns: Vec<Symbol> = c.delta.iter().chain(&c.loops).copied().collect();
    let all = unknowns.iter().chain(more).copied().collect();
    let mut map: FxHashMap<Symbol, Expr> = FxHashMap::default();
    let half = model.pool.ratio(1, 2);
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (model.pool.var(s.symbol), model.pool.var(*d));
        let d = model.pool.mul(half, d);
        map.insert(s.symbol, model.pool.add(x, d));
    }
    middle(c, &mut model.pool, &mut map);
    let mut told = form.clone();
    let mut w = Writing { c, model, form, b, lowering, predicted, held: FxHashMap::default(), unknowns: all, map };
    w.ratios()?.into_iter().for_each(|(i, row)| told.columns[i].row = row);
    w.form = &told;
    let works = w.storages(&stores, layout)?;
    w.nodes()?;
    let mut residuals = w.changes()?;
    residuals.extend(w.loops()?);
    let zero = w.b.number(0.0);
    let start = c.states.iter().map(|_| zero).chain(w.predicted.loops.iter().copied()).collect();
    let mut flat = w.map;
    for s in c.states.iter().map(|s| s.symbol) {
        if let Some(there) = w.predicted.star.get(&s) {
            flat.insert(s, *there);
        }
    }
    let memory = w.predicted.memory;
    Ok(Plan { form: told, flat, unknowns, residuals, start, works, memory })
}

impl Writing<'_> {
    /// Outputs of the storages; by auxiliary the work done on it: what its factors share, and their sum times the
    /// changes.
    fn storages(&mut self, stores: &Stores, layout: Layout) -> Found<Vec<(Expr, Expr)>> {
        let mut terms: Vec<Vec<Expr>> = vec![Vec::new(); self.c.states.len()];
        for p in &stores.plain {
            for (s, z) in p.states.iter().zip(&p.slopes) {
                let z = self.linear(*z)?;
                terms[*s].push(z);
            }
        }
        let mut works = Vec::new();
        for (i, v) in stores.auxiliaries.iter().enumerate() {
            let [kept, size] = [layout.auxiliaries + 2 * i, layout.sizes + v.region].map(|k| self.predicted.memory[k]);
            let given = self.open(v, kept, size)?;
            for (s, g) in v.states.iter().zip(&given.factors) {
                let e = self.model.pool.mul(*g, given.rbar);
                terms[*s].push(e);
            }
            works.push((given.rbar, given.moved));
        }
        for (s, list) in terms.into_iter().enumerate() {
            if let Some(column) = self.c.states[s].column {
                let e = self.model.pool.sum(&list);
                self.map.insert(self.form.column(column).out, e);
            }
        }
        Ok(works)
    }

    /// A resistor's line, where its law is not linear: the argument as it is predicted, value at 0, and slope.
    fn line(&mut self, column: ColumnId, how: Output) -> Found<Option<(Expr, Expr)>> {
        let form = self.form;
        let Some(law) = form.regions[form.column(column).region.at()].laws.get(&column).copied() else {
            return Ok(None);
        };
        let at = match how {
            Output::Explicit(_) => form.input(&mut self.model.pool, column),
            Output::Implicit { .. } => self.model.pool.var(form.column(column).out),
            Output::Curve { parameter, .. } => self.model.pool.var(parameter),
        };
        self.chord(law, at).map(Some)
    }

    /// What a resistor gives, in terms of what it receives.
    fn resistor(&mut self, column: ColumnId, how: Output) -> Found<Expr> {
        let form = self.form;
        if let Some((base, slope)) = self.line(column, how)? {
            let input = self.input(column)?;
            let pool = &mut self.model.pool;
            let rise = pool.mul(slope, input);
            return Ok(pool.add(base, rise));
        }
        let gains = form.regions[form.column(column).region.at()].gains.get(&column).cloned().unwrap_or_default();
        let mut terms = Vec::new();
        for (j, k) in gains {
            let (k, input) = (self.tell(k)?, self.input(j)?);
            terms.push(self.model.pool.mul(k, input));
        }
        Ok(self.model.pool.sum(&terms))
    }

    /// Outputs of sources and resistors, those of loops aside.
    fn nodes(&mut self) -> Found<()> {
        let c = self.c;
        let loops: FxHashSet<Symbol> = c.loops.iter().copied().collect();
        for n in &c.nodes {
            let e = match (n.part, n.how) {
                (Part::Resistor(column), Output::Curve { parameter, .. }) => {
                    let Some((base, slope)) = self.line(column, n.how)? else { continue };
                    let pool = &mut self.model.pool;
                    let a = pool.var(parameter);
                    let rise = pool.mul(slope, a);
                    pool.add(base, rise)
                }
                _ if loops.contains(&n.out) => continue,
                (Part::Resistor(column), Output::Explicit(_) | Output::Implicit { .. }) => {
                    self.resistor(column, n.how)?
                }
                (Part::Source(_) | Part::Signal | Part::SourceDriven(_) | Part::Multiplier(_), Output::Explicit(e)) => {
                    self.linear(e)?
                }
                (
                    Part::Source(_) | Part::Signal | Part::SourceDriven(_) | Part::Multiplier(_),
                    Output::Implicit { .. } | Output::Curve { .. },
                ) => {
                    continue;
                }
            };
            self.map.insert(n.out, e);
        }
        Ok(())
    }

    /// `d - h rate` of each state.
    fn changes(&mut self) -> Found<Vec<Expr>> {
        let c = self.c;
        let Some(h) = c.h else { return Ok(Vec::new()) };
        let mut list = Vec::new();
        for (s, d) in c.states.iter().zip(&c.delta) {
            let rate = match s.column {
                Some(column) => self.input(column)?,
                None => self.linear(s.rate)?,
            };
            let pool = &mut self.model.pool;
            let (h, d) = (pool.var(h), pool.var(*d));
            let step = pool.mul(h, rate);
            list.push(pool.sub(d, step));
        }
        Ok(list)
    }

    /// Residuals of the loops.
    fn loops(&mut self) -> Found<Vec<Expr>> {
        let c = self.c;
        let mut list = Vec::new();
        for n in c.loop_nodes() {
            let (one, other) = match (n.part, n.how) {
                (Part::Resistor(column), Output::Curve { parameter, .. }) => {
                    let a = self.model.pool.var(parameter);
                    (a, self.input(column)?)
                }
                (Part::Resistor(column), Output::Implicit { .. }) => {
                    let (base, slope) = match self.line(column, n.how)? {
                        Some(line) => line,
                        None => continue,
                    };
                    let pool = &mut self.model.pool;
                    let z = pool.var(n.out);
                    let rise = pool.mul(slope, z);
                    (pool.add(base, rise), self.input(column)?)
                }
                (Part::Resistor(column), Output::Explicit(_)) => {
                    let z = self.model.pool.var(n.out);
                    (z, self.resistor(column, n.how)?)
                }
                (Part::Source(_) | Part::Signal | Part::SourceDriven(_) | Part::Multiplier(_), how) => {
                    let Output::Explicit(e) = how else { continue };
                    let z = self.model.pool.var(n.out);
                    (z, self.linear(e)?)
                }
            };
            list.push(self.model.pool.sub(one, other));
        }
        Ok(list)
    }
}

/// Writes the step.
pub(crate) fn step(label: Label, c: &mut Cluster, model: &mut Model, form: &Form) -> Result<Step, Refusal> {
    if let Some(why) = refusal(c, &model.pool, form) {
        return Err(Refusal::Unfit(why));
    }
    reserve(c, model, form)?;
    let c = &*c;
    let mut b = Builder::new(c.title(form, "sav step"));
    let mut entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let plan = plan(c, model, form, &mut b, &mut lowering, &inputs, &[])?;
    let (weight, scale) = discrete_gradient::measures(c, model, form, &mut b, &mut lowering, &inputs)?;
    let (unknowns, residuals, start) = (plan.unknowns.clone(), plan.residuals.clone(), plan.start.clone());
    let system = System { unknowns, h: c.h, start, residuals, weight, scale, once: true, ..System::default() };
    let apart = !discrete_gradient::is_stiff(c, model, form);
    newton::solve_from(model, &mut b, &mut lowering, (system, apart), Vec::new())?;
    let mut value =
        |model: &Model, b: &mut Builder, e: Expr| lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s));
    let (mut next, mut rests, mut rates) = (Vec::new(), Vec::new(), Vec::new());
    let many = inputs::is_many(c);
    for (i, (x, d)) in inputs.states.iter().zip(&c.delta).enumerate() {
        let d = model.pool.var(*d);
        let d = value(model, &mut b, d)?;
        let carry = b.load(inputs.carries[i]);
        let (v, rest) = inputs::advance(&mut b, *x, (d, None), carry, many);
        next.push(v);
        rests.push(rest);
        rates.push(b.div(d, inputs.h));
    }
    let stores = Stores::new(c, model);
    let layout = Layout::new(c, stores.auxiliaries.len());
    let mut kept = Vec::new();
    for (i, (rbar, moved)) in plan.works.iter().enumerate() {
        let (rbar, moved) = (value(model, &mut b, *rbar)?, value(model, &mut b, *moved)?);
        let work = b.mul(rbar, moved);
        let [w, carry] = [0, 1].map(|k| plan.memory[layout.auxiliaries + 2 * i + k]);
        kept.push(inputs::advance(&mut b, w, (work, None), carry, many));
    }
    let mut loops = Vec::new();
    for z in &c.loops {
        let z = model.pool.var(*z);
        loops.push(value(model, &mut b, z)?);
    }
    let mut integrals = Vec::new();
    for (integral, start) in c.integrals.iter().zip(&inputs.integrals) {
        let rate = model.pool.substitute(integral.rate, &plan.flat);
        let rate = value(model, &mut b, rate)?;
        let change = b.mul(inputs.h, rate);
        integrals.push(b.add(*start, change));
    }
    ledger::ledger(c, model, &plan.form, &mut b, &mut lowering, &[(1.0, &plan.flat)], &entries, (inputs.h, None))?;
    let sizes = energies(c, model, form, &mut b, &stores, (&next, &rests, &kept), &inputs, &mut entries)?;
    b.slots(Array::Next, c.slots());
    let store = |b: &mut Builder, at: usize, list: &[Value]| {
        for (i, v) in list.iter().enumerate() {
            b.store(Slot::new(Array::Next, at + i), *v);
        }
    };
    let at = c.memory_at();
    store(&mut b, 0, &next);
    store(&mut b, c.states.len(), &integrals);
    store(&mut b, c.states.len() + c.integrals.len(), &loops);
    store(&mut b, c.carry_at(), &rests);
    store(&mut b, at + layout.rates[0], &rates);
    store(&mut b, at + layout.rates[1], &plan.memory[layout.rates[0]..layout.rates[0] + c.states.len()]);
    store(&mut b, at + layout.loops, &inputs.guesses);
    store(&mut b, at + layout.lengths[0], &[inputs.h, plan.memory[layout.lengths[0]]]);
    let kept: Vec<Value> = kept.into_iter().flat_map(|(w, rest)| [w, rest]).collect();
    store(&mut b, at + layout.auxiliaries, &kept);
    let sizes: Vec<Value> =
        sizes.iter().enumerate().map(|(i, s)| b.binary(Binary::Max, plan.memory[layout.sizes + i], *s)).collect();
    store(&mut b, at + layout.sizes, &sizes);
    let program = verified(model, b.finish())?;
    Ok((label.stepper(program), entries))
}

/// Stores what each region holds at the end of the step, as it is kept and as H has it; gives what it holds above where
/// it is least.
#[expect(clippy::too_many_arguments, reason = "the pieces of one step")]
fn energies(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    stores: &Stores,
    (next, rests, kept): (&[Value], &[Value], &[(Value, Value)]),
    inputs: &Inputs,
    entries: &mut [Entries],
) -> Found<Vec<Value>> {
    let mut at = Lowering::new(inputs.env.iter().copied());
    for (s, x) in c.states.iter().zip(next) {
        at.bind(s.symbol, *x);
    }
    let zero = b.number(0.0);
    let (mut sums, mut sizes) = (vec![zero; c.regions.len()], vec![zero; c.regions.len()]);
    for p in &stores.plain {
        let v = at.lower(&model.pool, b, p.energy).map_err(|s| missing(model, s))?;
        let least = b.number(p.least);
        let above = b.sub(v, least);
        sums[p.region] = b.add(sums[p.region], v);
        sizes[p.region] = b.add(sizes[p.region], above);
    }
    for (v, (w, _)) in stores.auxiliaries.iter().zip(kept) {
        let above = match v.least {
            Some(least) => {
                let least = b.number(least);
                b.sub(*w, least)
            }
            None => b.unary(Unary::Abs, *w),
        };
        sums[v.region] = b.add(sums[v.region], *w);
        sizes[v.region] = b.add(sizes[v.region], above);
    }
    for ((i, e), r) in entries.iter_mut().enumerate().zip(&c.regions) {
        if !stores.auxiliaries.iter().any(|v| v.region == i) {
            continue;
        }
        let slot = b.named(Array::Output, format!("H({}) itself", form.regions[r.at()].name)).index as usize;
        // What is kept takes the place of H, and its size is that of H.
        b.store(Slot::new(Array::Output, e.energy), sums[i]);
        e.modified = Some(slot);
        if e.size == e.energy {
            e.size = slot;
        }
    }
    let itself: Vec<Entries> =
        entries.iter().map(|e| Entries { energy: e.modified.unwrap_or(e.energy), ..e.clone() }).collect();
    ledger::energies(c, (model, form), b, (next, rests), inputs, &itself)?;
    Ok(sizes)
}
