//! Constraints between storages: their rates at an instant, and the end of a step back on them.
//!
//! Within a step a constraint holds as the step takes everything else, in the middle or at the nodes, so that its
//! multiplier does no work. The end of the step is then off by the step's error: it goes back along the multipliers, as
//! by an impulse (projected collocation: Ascher and Petzold, SIAM J. Numer. Anal. 28, 1991; Hairer and Wanner II,
//! VII.4), which is what gives the step its full order. With D's columns of the multipliers, the end x and the impulses
//! nu,
//!
//! ```text
//! c(x + D nu) = 0,     H(x) - H(x + D nu) + supplied = nu . mean of c over the way from x to x + D nu
//! ```
//!
//! The right side, with discrete gradients as the mean, is what the impulse loses: half of nu . c(x) where the energy
//! is quadratic, never negative where it is convex, and of twice the order of the step. It is booked as a numerical
//! loss.

use crate::discretise::analysis::curvature;
use crate::discretise::cluster::{Cluster, Node, missing};
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::system::System;
use crate::discretise::equations::{discrete_gradient, error_weights, newton};
use crate::expression::{Expr, Lowering, Number, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::Model;
use crate::structure::{ColumnId, Form, Role};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::Entries;
use rustc_hash::{FxHashMap, FxHashSet};

/// What an impulse loses, as the ledger calls it.
pub(crate) const LOSS: &str = "numerical loss";

/// Why a stepper that does not put its end on constraints refuses them.
pub(crate) const TIED: &str = "a constraint ties storages of it";

impl Cluster {
    /// Whether constraints tie storages of a region.
    pub(crate) fn is_constrained(&self, form: &Form, region: RegionId) -> bool {
        self.nodes.iter().filter_map(|n| n.constraint()).any(|c| form.column(c).region == region)
    }

    /// Whether constraints tie any of its storages.
    pub(crate) fn has_constraints(&self) -> bool {
        self.nodes.iter().any(|n| n.constraint().is_some())
    }

    /// The multipliers, and the flows or efforts of junctions that no storage gives.
    fn multipliers(&self, model: &Model, form: &Form) -> (Vec<&Node>, Vec<&Node>) {
        let all = self.loop_nodes().into_iter().filter(|n| n.constraint().is_some());
        let is_massless =
            |n: &&Node| n.constraint().is_some_and(|c| model.element(form.column(c).element).is_massless());
        let (free, ties): (Vec<&Node>, Vec<&Node>) = all.partition(is_massless);
        (ties, free)
    }

    /// Has the residuals of loops, in terms of what `flat` leaves, hold at an instant. The states fulfil a constraint
    /// there, so its rate stands for it: the multiplier is what has them go on doing so. One that a multiplier stands
    /// in determines that by itself. A speed without inertia follows from the states, and is known before the
    /// multipliers are; what the loops then find in its place is its rate.
    ///
    /// # Errors
    /// A constraint that reads what an iteration finds, whose rate is not known.
    pub(crate) fn constraints_at_instant(
        &self,
        model: &mut Model,
        form: &Form,
        flat: &mut FxHashMap<Symbol, Expr>,
        residuals: &mut [Expr],
    ) -> Result<Speeds, Vec<Diagnostic>> {
        let mut speeds = Speeds::default();
        if !self.has_constraints() {
            return Ok(speeds);
        }
        let free: Vec<Symbol> = self.multipliers(model, form).1.into_iter().map(|n| n.out).collect();
        if !free.is_empty() {
            speeds = Speeds::of(self, model, form, flat);
            let now: FxHashMap<Symbol, Expr> = speeds.now.iter().map(|(s, now)| (*s, model.pool.var(*now))).collect();
            flat.values_mut().chain(&mut *residuals).for_each(|e| *e = model.pool.substitute(*e, &now));
        }
        let mut rates: Vec<(Symbol, Expr)> = Vec::new();
        for s in self.states.iter().filter(|s| !s.jumps) {
            rates.push((s.symbol, model.pool.substitute(s.rate, flat)));
        }
        let now: FxHashMap<Symbol, Expr> = speeds.now.iter().map(|(s, now)| (*s, model.pool.var(*now))).collect();
        rates.iter_mut().for_each(|(_, rate)| *rate = model.pool.substitute(*rate, &now));
        rates.extend(speeds.now.iter().map(|(s, now)| (*now, model.pool.var(*s))));
        rates.extend(self.inputs.iter().map(|(_, u, slope)| (*u, model.pool.var(*slope))));
        rates.extend(self.time.map(|t| (t, model.pool.int(1))));
        for (node, residual) in self.loop_nodes().into_iter().zip(residuals) {
            let Some(column) = node.constraint() else { continue };
            if free.contains(&node.out) || self.is_algebraic(model, form, *residual) {
                continue;
            }
            let symbols: FxHashSet<Symbol> = model.pool.symbols(*residual).into_iter().collect();
            if let Some(z) = self.loops.iter().find(|z| symbols.contains(z)) {
                return Err(vec![unknown_rate(model, form, column, *z)]);
            }
            let mut terms = Vec::new();
            for (s, rate) in rates.iter().filter(|(s, _)| symbols.contains(s)) {
                let slope = model.pool.derivative(*residual, *s);
                terms.push(model.pool.mul(slope, *rate));
            }
            *residual = model.pool.sum(&terms);
        }
        Ok(speeds)
    }

    /// Whether a constraint, in terms of states and loops, holds at each instant by a multiplier that stands in it.
    fn is_algebraic(&self, model: &Model, form: &Form, constraint: Expr) -> bool {
        let (ties, _) = self.multipliers(model, form);
        ties.into_iter().any(|n| model.pool.contains(constraint, n.out))
    }
}

/// A constraint whose ratio reads the unknown of a loop.
fn unknown_rate(model: &Model, form: &Form, column: ColumnId, z: Symbol) -> Diagnostic {
    let e = model.element(form.column(column).element);
    let what = format!(
        "`{}` is tied to others by a ratio that reads `{}`, whose rate is not known: a loop of laws determines it",
        e.name,
        model.pool.name(z)
    );
    Diagnostic::error("structure::rate", e.span, what)
        .help("have the ratio read a state, such as that of a `C` with `H = 0` that counts the angle")
}

/// The end of a step on its constraints.
#[derive(Default)]
pub(crate) struct Projected {
    /// What sources supplied in that.
    pub(crate) supplied: FxHashMap<ColumnId, Value>,
    /// What was lost in each region.
    pub(crate) losses: FxHashMap<RegionId, Value>,
    /// What the integrals changed by.
    pub(crate) integrals: Vec<Option<Value>>,
}

/// Speeds without inertia at an instant: those by which the states fulfil the constraints, together with the impulses
/// that would have these do so, which are 0.
#[derive(Default)]
pub(crate) struct Speeds {
    /// The loop's unknown, and the symbol of its value.
    pub(crate) now: Vec<(Symbol, Symbol)>,
    /// The values, then the impulses.
    pub(crate) unknowns: Vec<Symbol>,
    pub(crate) residuals: Vec<Expr>,
}

impl Speeds {
    fn of(c: &Cluster, model: &mut Model, form: &Form, flat: &FxHashMap<Symbol, Expr>) -> Self {
        let ties = ties(c, model, form, flat);
        let mut speeds = Speeds::default();
        let mut at: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for s in c.multipliers(model, form).1.into_iter().map(|n| n.out).collect::<Vec<_>>() {
            let now = model.pool.symbol(&format!("{} now", model.pool.name(s)));
            speeds.now.push((s, now));
            at.insert(s, model.pool.var(now));
        }
        let mut residuals = balances(c, (model, form), flat, &ties);
        for tie in &ties {
            for (i, k) in &tie.along {
                let (s, impulse) = (c.states[*i].symbol, model.pool.var(tie.impulse));
                let change = model.pool.mul(*k, impulse);
                let before = at.get(&s).copied().unwrap_or_else(|| model.pool.var(s));
                at.insert(s, model.pool.add(before, change));
            }
        }
        residuals.extend(ties.iter().map(|tie| model.pool.substitute(tie.residual, &at)));
        speeds.residuals = residuals;
        speeds.unknowns = speeds.now.iter().map(|n| n.1).chain(ties.iter().map(|t| t.impulse)).collect();
        speeds
    }

    /// Solves for them, and has the values known.
    pub(crate) fn solve(
        &self,
        c: &Cluster,
        (model, form): (&mut Model, &Form),
        (b, lowering): (&mut Builder, &mut Lowering),
        guesses: &[Value],
    ) -> Result<(), Vec<Diagnostic>> {
        if self.now.is_empty() {
            return Ok(());
        }
        let sizes = Sizes::of(c, (model, form), b, lowering, guesses)?;
        let mut system = System { redundant: c.redundant, ..System::default() };
        let all = sizes.free.iter().map(|s| (s, true)).chain(sizes.ties.iter().map(|s| (s, false)));
        for (((size, is_speed), unknown), residual) in all.zip(&self.unknowns).zip(&self.residuals) {
            let zero = b.number(0.0);
            let start = if is_speed { guesses[size.place] } else { zero };
            system.push((*unknown, *residual), (start, size.weight, size.scale(b, start)));
            size.divide(model, (b, lowering), &mut system, size.energy);
        }
        newton::solve(model, b, lowering, system)?;
        Ok(())
    }

    /// Has the loop's unknowns mean the values again, once what stood for their rates is found.
    pub(crate) fn restore(
        &self,
        model: &mut Model,
        b: &mut Builder,
        lowering: &mut Lowering,
    ) -> Result<(), Vec<Diagnostic>> {
        for (s, now) in &self.now {
            let value = model.pool.var(*now);
            let value = lowering.lower(&model.pool, b, value).map_err(|s| missing(model, s))?;
            lowering.bind(*s, value);
        }
        Ok(())
    }
}

/// How much one multiplier moves, or one speed without inertia.
struct Size {
    /// Which loop it is.
    place: usize,
    /// Energy per square of the impulse of a multiplier, or of the speed.
    energy: Value,
    /// The same as it counts in the iteration.
    weight: Value,
    /// The sum of the magnitudes of what the constraint is the sum of, as an impulse or as a speed.
    terms: Value,
}

impl Size {
    /// What it is measured against.
    fn scale(&self, b: &mut Builder, start: Value) -> Value {
        let start = b.unary(Unary::Abs, start);
        b.add(start, self.terms)
    }

    /// Where constraints say the same, the rounding of what they say moves what one of them carries by as much as the
    /// damping of its pivot lets it, at the cost of another: it counts for so much less. The states tell when it is
    /// found.
    fn share(&mut self, b: &mut Builder, damping: f64) {
        let (square, part) = (b.number(damping * damping), b.number(1.0 / damping));
        self.weight = b.mul(square, self.weight);
        self.terms = b.mul(part, self.terms);
    }

    /// Has the last residual of a system in the unit of its unknown.
    fn divide(&self, model: &mut Model, (b, lowering): (&mut Builder, &mut Lowering), system: &mut System, by: Value) {
        if let Some(residual) = system.residuals.last_mut() {
            *residual = divided(model, (b, lowering), *residual, by);
        }
    }
}

/// An expression by a value.
fn divided(model: &mut Model, (b, lowering): (&mut Builder, &mut Lowering), e: Expr, by: Value) -> Expr {
    let one = b.number(1.0);
    let unit = model.pool.symbol("one over its size");
    lowering.bind(unit, b.div(one, by));
    let unit = model.pool.var(unit);
    model.pool.mul(unit, e)
}

/// The sizes of multipliers and of speeds without inertia.
struct Sizes {
    ties: Vec<Size>,
    free: Vec<Size>,
}

impl Sizes {
    /// At the states that a lowering has, with the loops as they are guessed.
    fn of(
        c: &Cluster,
        (model, form): (&mut Model, &Form),
        b: &mut Builder,
        lowering: &Lowering,
        guesses: &[Value],
    ) -> Result<Self, Vec<Diagnostic>> {
        let flat = c.flat_at_instant(&mut model.pool, form);
        let mut at = lowering.clone();
        c.loops.iter().zip(guesses).for_each(|(z, guess)| at.bind(*z, *guess));
        let place = |s: Symbol| c.loops.iter().position(|z| *z == s).unwrap_or(0);
        let ties = ties(c, model, form, &flat);
        let curvatures = curvature::curvatures(c, model);
        let (zero, one) = (b.number(0.0), b.number(1.0));
        let mut sizes = Sizes { ties: Vec::new(), free: Vec::new() };
        for tie in &ties {
            let squares: Vec<Expr> = tie
                .along
                .iter()
                .map(|(i, k)| {
                    let square = model.pool.powi(*k, 2);
                    model.pool.mul(square, curvatures[*i])
                })
                .collect();
            let energy = model.pool.sum(&squares);
            let energy = at.lower(&model.pool, b, energy).map_err(|s| missing(model, s))?;
            // Where nothing bends, as at the rest of a storage of order four, a unit stands for it.
            let is_known = b.binary(Binary::Lt, zero, energy);
            let energy = b.select(is_known, energy, one);
            let terms = error_weights::terms(model, form, &flat, tie.column);
            let terms = at.lower(&model.pool, b, terms).map_err(|s| missing(model, s))?;
            sizes.ties.push(Size { place: place(tie.out), energy, weight: energy, terms: b.div(terms, energy) });
        }
        for s in c.multipliers(model, form).1.into_iter().map(|n| n.out).collect::<Vec<_>>() {
            let (mut energy, mut terms) = (zero, zero);
            for (tie, size) in ties.iter().zip(&sizes.ties) {
                let k = model.pool.derivative(tie.residual, s);
                if model.pool.is_zero(k) {
                    continue;
                }
                let k = at.lower(&model.pool, b, k).map_err(|s| missing(model, s))?;
                let by = b.div(k, size.energy);
                let part = b.mul(k, by);
                energy = b.add(energy, part);
                let part = b.mul(k, size.terms);
                let part = b.unary(Unary::Abs, part);
                terms = b.add(terms, part);
            }
            let is_known = b.binary(Binary::Lt, zero, energy);
            let energy = b.select(is_known, energy, one);
            sizes.free.push(Size { place: place(s), energy, weight: energy, terms: b.div(terms, energy) });
        }
        if c.redundant {
            sizes.ties.iter_mut().for_each(|size| size.share(b, c.thresholds.iteration.damping));
        }
        Ok(sizes)
    }
}

/// What a step's iteration measures the unknowns of constraints against, and how their equations go with the others.
#[derive(Default)]
pub(crate) struct StepSizes {
    ties: Vec<StepTie>,
    free: Vec<StepSpeed>,
    /// By how much more a state's change over the step is uncertain, for what moves it.
    moved: Vec<(usize, Value)>,
}

/// A constraint in the equations of a step.
struct StepTie {
    place: usize,
    weight: Value,
    scale: Value,
    /// One over the energy per square of its multiplier, by the length of the step.
    unit: Symbol,
    /// How states bend, times how the multiplier moves them, by state.
    bends: Vec<(usize, Symbol)>,
}

/// A speed without inertia in the equations of a step.
struct StepSpeed {
    place: usize,
    weight: Value,
    scale: Value,
    /// The length of the step by the inertia that it has through the constraints.
    unit: Symbol,
    /// By constraint, how it goes with the speed.
    by: Vec<(usize, Symbol)>,
}

impl StepSizes {
    /// At the start of a step. A multiplier moves states by its impulse over the step.
    pub(crate) fn of(
        c: &Cluster,
        (model, form): (&mut Model, &Form),
        (b, lowering): (&mut Builder, &mut Lowering),
        inputs: &Inputs,
    ) -> Result<Self, Vec<Diagnostic>> {
        let mut found = Self::default();
        if !c.has_constraints() {
            return Ok(found);
        }
        let flat = c.flat_at_instant(&mut model.pool, form);
        let ties = ties(c, model, form, &flat);
        let sizes = Sizes::of(c, (model, form), b, lowering, &inputs.guesses)?;
        let curvatures = curvature::curvatures(c, model);
        let mut at = lowering.clone();
        c.loops.iter().zip(&inputs.guesses).for_each(|(z, guess)| at.bind(*z, *guess));
        let mut known = |model: &mut Model, value: Value, what: &str| {
            let s = model.pool.symbol(what);
            lowering.bind(s, value);
            s
        };
        let one = b.number(1.0);
        for (tie, size) in ties.iter().zip(&sizes.ties) {
            let by = b.mul(inputs.h, size.energy);
            let weight = b.mul(inputs.h, size.weight);
            let weight = b.mul(inputs.h, weight);
            let terms = b.div(size.terms, inputs.h);
            let start = b.unary(Unary::Abs, inputs.guesses[size.place]);
            let scale = b.add(start, terms);
            let inverse = b.div(one, by);
            let unit = known(model, inverse, "one over its size");
            let mut bends = Vec::new();
            for (i, k) in &tie.along {
                let bend = model.pool.mul(*k, curvatures[*i]);
                let bend = at.lower(&model.pool, b, bend).map_err(|s| missing(model, s))?;
                bends.push((*i, known(model, bend, "how it bends")));
            }
            found.ties.push(StepTie { place: size.place, weight, scale, unit, bends });
        }
        for size in &sizes.free {
            let scale = size.scale(b, inputs.guesses[size.place]);
            let unit = b.div(inputs.h, size.energy);
            let unit = known(model, unit, "the step by its inertia");
            let mut by = Vec::new();
            for (k, tie) in ties.iter().enumerate() {
                let slope = model.pool.derivative(tie.residual, c.loops[size.place]);
                if model.pool.is_zero(slope) {
                    continue;
                }
                let slope = at.lower(&model.pool, b, slope).map_err(|s| missing(model, s))?;
                by.push((k, known(model, slope, "how it goes")));
            }
            found.free.push(StepSpeed { place: size.place, weight: size.weight, scale, unit, by });
        }
        found.balanced(c, (model, form), (b, &mut at), (&flat, inputs.h))?;
        Ok(found)
    }

    /// Multipliers balance large forces. A bar that they keep from turning has a momentum that is what these round to,
    /// and a speed without inertia is the difference of what its neighbours have: what these move is uncertain by that.
    fn balanced(
        &mut self,
        c: &Cluster,
        (model, form): (&mut Model, &Form),
        (b, at): (&mut Builder, &mut Lowering),
        (flat, h): (&FxHashMap<Symbol, Expr>, Value),
    ) -> Result<(), Vec<Diagnostic>> {
        let curvatures = curvature::curvatures(c, model);
        let mut speeds: FxHashMap<ColumnId, Value> = FxHashMap::default();
        for (j, s) in c.states.iter().enumerate() {
            let Some(column) = s.column else { continue };
            let terms = error_weights::terms(model, form, flat, column);
            let terms = at.lower(&model.pool, b, terms).map_err(|s| missing(model, s))?;
            let bend = at.lower(&model.pool, b, curvatures[j]).map_err(|s| missing(model, s))?;
            let change = b.mul(h, terms);
            speeds.insert(column, b.mul(bend, change));
        }
        for (node, size) in c.multipliers(model, form).1.iter().zip(&self.free) {
            speeds.extend(node.constraint().map(|column| (column, size.scale)));
        }
        for (i, s) in c.states.iter().enumerate() {
            let Some(column) = s.column else { continue };
            for (from, k) in &form.column(column).row {
                let Some(speed) = speeds.get(from) else { continue };
                let k = model.pool.substitute(*k, flat);
                let k = model.pool.unary(Unary::Abs, k);
                let k = at.lower(&model.pool, b, k).map_err(|s| missing(model, s))?;
                let part = b.mul(k, *speed);
                self.moved.push((i, b.mul(h, part)));
            }
        }
        Ok(())
    }

    /// Has them in the weights and scales of a stage, states before loops.
    pub(crate) fn measure(&self, c: &Cluster, b: &mut Builder, weight: &mut [Value], scale: &mut [Value]) {
        for (i, more) in &self.moved {
            scale[*i] = b.add(scale[*i], *more);
        }
        let ties = self.ties.iter().map(|t| (t.place, t.weight, t.scale));
        for (place, w, s) in ties.chain(self.free.iter().map(|f| (f.place, f.weight, f.scale))) {
            weight[c.states.len() + place] = w;
            scale[c.states.len() + place] = s;
        }
    }

    /// Has the residuals of a stage, states before loops, in the units of their unknowns, and with these in them: what
    /// states are off by is taken out of the constraints, as they bend at the start of the step, which leaves the
    /// multipliers, and these are taken out of the balances of speeds in the same way (the Schur complements of the
    /// saddle point). So each unknown is a pivot, in any order. `part` is how far a stage is moved by its own rates.
    pub(crate) fn reduce(&self, c: &Cluster, pool: &mut Pool, part: f64, stage: &mut [Expr]) {
        let states = c.states.len();
        let raw: Vec<Expr> = self.ties.iter().map(|tie| stage[states + tie.place]).collect();
        for speed in &self.free {
            let mut terms = vec![stage[states + speed.place]];
            for (k, slope) in &speed.by {
                let (slope, unit) = (pool.var(*slope), pool.var(self.ties[*k].unit));
                let term = pool.product(&[slope, unit, raw[*k]]);
                terms.push(pool.scale(term, Number::float(-1.0 / part)));
            }
            let (sum, unit) = (pool.sum(&terms), pool.var(speed.unit));
            let sum = pool.mul(unit, sum);
            stage[states + speed.place] = pool.scale(sum, Number::float(-part));
        }
        for (tie, raw) in self.ties.iter().zip(raw) {
            let mut terms = vec![raw];
            for (i, bend) in &tie.bends {
                let bend = pool.var(*bend);
                let term = pool.mul(bend, stage[*i]);
                terms.push(pool.scale(term, Number::float(part)));
            }
            let (sum, unit) = (pool.sum(&terms), pool.var(tie.unit));
            let sum = pool.mul(unit, sum);
            stage[states + tie.place] = pool.scale(sum, Number::float(-1.0 / part));
        }
    }
}

/// Has the residuals of an instant in the units of their unknowns, and measures these.
pub(crate) fn measure_instant(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    (b, lowering): (&mut Builder, &mut Lowering),
    guesses: &[Value],
    (residuals, weight, scale): (&mut [Expr], &mut [Value], &mut [Value]),
) -> Result<(), Vec<Diagnostic>> {
    if !c.has_constraints() {
        return Ok(());
    }
    let sizes = Sizes::of(c, (model, form), b, lowering, guesses)?;
    let mut at = lowering.clone();
    c.loops.iter().zip(guesses).for_each(|(z, guess)| at.bind(*z, *guess));
    for size in sizes.ties.iter().chain(&sizes.free) {
        let terms = error_weights::summands(model, &FxHashMap::default(), residuals[size.place], 1);
        let terms = at.lower(&model.pool, b, terms).map_err(|s| missing(model, s))?;
        let terms = b.div(terms, size.energy);
        let start = b.unary(Unary::Abs, guesses[size.place]);
        scale[size.place] = b.add(start, terms);
        weight[size.place] = size.weight;
        residuals[size.place] = divided(model, (b, lowering), residuals[size.place], size.energy);
    }
    Ok(())
}

/// A constraint at the end of a step.
struct Tie {
    column: ColumnId,
    out: Symbol,
    /// The impulse.
    impulse: Symbol,
    /// c, in terms of states and what is given.
    residual: Expr,
    /// The coefficients of D in the rates of states, by state.
    along: Vec<(usize, Expr)>,
}

/// The constraints that hold at an instant by the states alone.
fn ties(c: &Cluster, model: &mut Model, form: &Form, flat: &FxHashMap<Symbol, Expr>) -> Vec<Tie> {
    let mut list = Vec::new();
    for node in c.multipliers(model, form).0 {
        let Some(column) = node.constraint() else { continue };
        let residual = form.input(&mut model.pool, column);
        let residual = model.pool.substitute(residual, flat);
        if c.is_algebraic(model, form, residual) {
            continue;
        }
        let mut along = Vec::new();
        for (i, s) in c.states.iter().enumerate() {
            let k = model.pool.derivative(s.rate, node.out);
            if !model.pool.is_zero(k) {
                along.push((i, model.pool.substitute(k, flat)));
            }
        }
        let name = format!("impulse of {}", model.pool.name(node.out));
        list.push(Tie { column, out: node.out, impulse: model.pool.symbol(&name), residual, along });
    }
    list
}

/// What the impulses of constraints come to at each speed without inertia: nothing, where they are what they should be.
fn balances(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    flat: &FxHashMap<Symbol, Expr>,
    ties: &[Tie],
) -> Vec<Expr> {
    let mut list = Vec::new();
    for node in c.multipliers(model, form).1 {
        let Some(column) = node.constraint() else { continue };
        let input = form.input(&mut model.pool, column);
        let mut terms = Vec::new();
        for tie in ties {
            let k = model.pool.derivative(input, tie.out);
            let k = model.pool.substitute(k, flat);
            let impulse = model.pool.var(tie.impulse);
            terms.push(model.pool.mul(k, impulse));
        }
        list.push(model.pool.sum(&terms));
    }
    list
}

/// Where expressions are had at the end of a step, but for the states.
fn later(c: &Cluster, b: &mut Builder, inputs: &Inputs, loops: &[(Symbol, Value)]) -> Lowering {
    let mut there = Lowering::new(inputs.env.iter().copied());
    if let Some(t) = c.time {
        there.bind(t, b.add(inputs.t, inputs.h));
    }
    for ((_, u, _), (x, slope)) in c.inputs.iter().zip(&inputs.given) {
        let gone = b.mul(inputs.h, *slope);
        there.bind(*u, b.add(*x, gone));
    }
    loops.iter().for_each(|(z, value)| there.bind(*z, *value));
    there
}

/// States that impulses move.
struct Moved<'a> {
    c: &'a Cluster,
    ties: &'a [Tie],
    /// D's columns of the multipliers, as values.
    fixed: Vec<Vec<(usize, Value)>>,
    /// Speeds without inertia, where their values are looked for from, and what the impulses come to at each.
    free: Vec<(Symbol, Value, Expr)>,
}

impl Moved<'_> {
    /// By how much impulses move each state.
    fn changes(&self, b: &mut Builder, impulses: &[Value]) -> Vec<Option<Value>> {
        let mut changes = vec![None; self.c.states.len()];
        for (along, impulse) in self.fixed.iter().zip(impulses) {
            for (i, k) in along {
                let change = b.mul(*k, *impulse);
                changes[*i] = Some(changes[*i].map_or(change, |sum| b.add(sum, change)));
            }
        }
        changes
    }

    /// The impulses that put the states, which `there` has, on the constraints. It then has the speeds without inertia.
    fn impulses(
        &self,
        (model, form): (&mut Model, &Form),
        (b, there): (&mut Builder, &mut Lowering),
        loops: &[Value],
    ) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let mut at = there.clone();
        let mut ends: FxHashMap<Symbol, Vec<Expr>> = FxHashMap::default();
        for (tie, along) in self.ties.iter().zip(&self.fixed) {
            for (i, value) in along {
                let s = self.c.states[*i].symbol;
                let k = model.pool.symbol(&format!("{} by {}", model.pool.name(s), model.pool.name(tie.impulse)));
                at.bind(k, *value);
                let (k, impulse, x) = (model.pool.var(k), model.pool.var(tie.impulse), model.pool.var(s));
                let change = model.pool.mul(k, impulse);
                ends.entry(s).or_insert_with(|| vec![x]).push(change);
            }
        }
        let ends: FxHashMap<Symbol, Expr> = ends.into_iter().map(|(s, list)| (s, model.pool.sum(&list))).collect();
        let lower = |model: &Model, b: &mut Builder, at: &mut Lowering, e: Expr| {
            at.lower(&model.pool, b, e).map_err(|s| missing(model, s))
        };
        let zero = b.number(0.0);
        let sizes = Sizes::of(self.c, (model, form), b, &at, loops)?;
        let mut system = System { redundant: self.c.redundant, ..System::default() };
        for (tie, size) in self.ties.iter().zip(&sizes.ties) {
            let residual = model.pool.substitute(tie.residual, &ends);
            system.push((tie.impulse, residual), (zero, size.weight, size.terms));
            size.divide(model, (b, &mut at), &mut system, size.energy);
        }
        for ((speed, start, balance), size) in self.free.iter().zip(&sizes.free) {
            system.push((*speed, *balance), (*start, size.weight, size.scale(b, *start)));
            size.divide(model, (b, &mut at), &mut system, size.energy);
        }
        newton::solve(model, b, &mut at, system)?;
        let mut impulses = Vec::new();
        for tie in self.ties {
            let impulse = model.pool.var(tie.impulse);
            impulses.push(lower(model, b, &mut at, impulse)?);
        }
        for (speed, ..) in &self.free {
            let value = model.pool.var(*speed);
            let value = lower(model, b, &mut at, value)?;
            there.bind(*speed, value);
        }
        Ok(impulses)
    }

    /// What an impulse loses, and what sources supply in it. Constraints are taken as the sums of their terms, by the
    /// coefficients that D has at the end of the step, and the means of co-energy variables by the discrete gradient.
    fn energies(
        &self,
        (model, form): (&mut Model, &Form),
        b: &mut Builder,
        there: &mut Lowering,
        (flat, impulses): (&FxHashMap<Symbol, Expr>, &[Value]),
        found: &mut Projected,
    ) -> Result<(), Vec<Diagnostic>> {
        let c = self.c;
        let (mut along, zero) = (there.clone(), b.number(0.0));
        for (d, change) in c.delta.iter().zip(self.changes(b, impulses)) {
            along.bind(*d, change.unwrap_or(zero));
        }
        let means = means(c, model, form);
        for (tie, impulse) in self.ties.iter().zip(impulses) {
            let mut mean: Option<Value> = None;
            for (j, k) in form.column(tie.column).row.clone() {
                let (k, z) = (model.pool.substitute(k, flat), model.pool.var(form.column(j).out));
                let z = model.pool.substitute(z, &means);
                let z = model.pool.substitute(z, flat);
                let k = there.lower(&model.pool, b, k).map_err(|s| missing(model, s))?;
                let z = along.lower(&model.pool, b, z).map_err(|s| missing(model, s))?;
                let term = b.mul(k, z);
                mean = Some(mean.map_or(term, |sum| b.add(sum, term)));
                if let Role::Source(_) = form.column(j).role {
                    let work = b.mul(term, *impulse);
                    let before = found.supplied.get(&j).copied();
                    found.supplied.insert(j, before.map_or(work, |w| b.add(w, work)));
                }
            }
            let Some(mean) = mean else { continue };
            let loss = b.mul(*impulse, mean);
            let region = form.column(tie.column).region;
            let before = found.losses.get(&region).copied();
            found.losses.insert(region, before.map_or(loss, |sum| b.add(sum, loss)));
        }
        Ok(())
    }
}

/// The outputs of storages over a change of their states: discrete gradients.
fn means(c: &Cluster, model: &mut Model, form: &Form) -> FxHashMap<Symbol, Expr> {
    let pool = &mut model.pool;
    let half = pool.ratio(1, 2);
    let mut middle = FxHashMap::default();
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        let d = pool.mul(half, d);
        middle.insert(s.symbol, pool.add(x, d));
    }
    let mut means = FxHashMap::default();
    for g in &c.groups {
        let list = discrete_gradient::gradient(c, pool, g, (&middle, &FxHashSet::default()));
        for (s, z) in g.states.iter().zip(list) {
            means.extend(c.states[*s].column.map(|column| (form.column(column).out, z)));
        }
    }
    means
}

/// Puts the end of a step, each state and what rounding took from it, back on the constraints; None where there are
/// none. `loops` are the unknowns as the step ends.
///
/// # Errors
/// A symbol that means nothing.
pub(crate) fn project(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    b: &mut Builder,
    (inputs, loops): (&Inputs, &[Value]),
    ends: (&mut [Value], &mut [Value]),
) -> Result<Option<Projected>, Vec<Diagnostic>> {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let ties = ties(c, model, form, &flat);
    if ties.is_empty() {
        return Ok(None);
    }
    let speeds: Vec<Symbol> = c.multipliers(model, form).1.into_iter().map(|n| n.out).collect();
    let (free, known): (Vec<_>, Vec<_>) =
        c.loops.iter().copied().zip(loops.iter().copied()).partition(|(z, _)| speeds.contains(z));
    let mut there = later(c, b, inputs, &known);
    c.states.iter().zip(&*ends.0).for_each(|(s, x)| there.bind(s.symbol, *x));
    let mut fixed = Vec::new();
    for tie in &ties {
        let mut list = Vec::new();
        for (i, k) in &tie.along {
            list.push((*i, there.lower(&model.pool, b, *k).map_err(|s| missing(model, s))?));
        }
        fixed.push(list);
    }
    let balances = balances(c, (model, form), &flat, &ties);
    let free = free.into_iter().zip(balances).map(|((speed, start), balance)| (speed, start, balance)).collect();
    let moved = Moved { c, ties: &ties, fixed, free };
    let impulses = moved.impulses((model, form), (b, &mut there), loops)?;
    let mut found = Projected { integrals: vec![None; c.integrals.len()], ..Projected::default() };
    moved.energies((model, form), b, &mut there, (&flat, &impulses), &mut found)?;
    for (integral, change) in c.integrals.iter().zip(&mut found.integrals) {
        for (tie, impulse) in ties.iter().zip(&impulses) {
            let slope = model.pool.derivative(integral.rate, tie.out);
            if model.pool.is_zero(slope) {
                continue;
            }
            let slope = model.pool.substitute(slope, &flat);
            let slope = there.lower(&model.pool, b, slope).map_err(|s| missing(model, s))?;
            let part = b.mul(slope, *impulse);
            *change = Some(change.map_or(part, |sum| b.add(sum, part)));
        }
    }
    let changes = moved.changes(b, &impulses);
    for ((x, rest), change) in ends.0.iter_mut().zip(ends.1).zip(changes) {
        if let Some(change) = change {
            let (_, next, left) = inputs::added(b, *x, change, *rest);
            (*x, *rest) = (next, left);
        }
    }
    Ok(Some(found))
}

impl Projected {
    /// What the energy of a region changes by in it.
    pub(crate) fn change(&self, b: &mut Builder, form: &Form, region: RegionId) -> Value {
        let mut sum = b.number(0.0);
        let mut given: Vec<(&ColumnId, &Value)> = self.supplied.iter().collect();
        given.sort_unstable();
        for (_, work) in given.into_iter().filter(|(column, _)| form.column(**column).region == region) {
            sum = b.add(sum, *work);
        }
        self.losses.get(&region).map_or(sum, |loss| b.sub(sum, *loss))
    }
}

/// Stores what is lost, 0 where the end was not moved.
pub(crate) fn store(c: &Cluster, form: &Form, b: &mut Builder, entries: &[Entries], found: Option<&Projected>) {
    for (e, region) in entries.iter().zip(&c.regions).filter(|(_, r)| c.is_constrained(form, **r)) {
        let Some((_, slot)) = e.dissipated.iter().find(|d| d.0 == LOSS) else { continue };
        let loss = found.and_then(|f| f.losses.get(region).copied()).unwrap_or_else(|| b.number(0.0));
        b.store(Slot::new(Array::Output, *slot), loss);
    }
}
