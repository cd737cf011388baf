//! Collocation: a polynomial over the step whose slope at each node is the rate there.
//!
//! `collocation4` to `collocation12` have the nodes of Gauss and keep the energy (Hairer, J. Numer. Anal. Ind. Appl.
//! Math. 5, 2010; Cohen and Hairer, BIT 51, 2011; Celledoni and Hoiseth, 2017): the co-energy variable of a storage at
//! node i is
//!
//!   e_i = (1/b_i) ∫ l_i(τ) dH/dx(u(τ)) dτ
//!
//! with u the polynomial and l_i that of Lagrange. The rates are what D makes of that and of the resistors at the node,
//! so that H(x+) - H(x) = ∫ dH/dx . u' = h Σ b_i e_i . f_i, and D being skew that is what was supplied less what was
//! dissipated. Of a quadratic H e_i is the gradient at the node, and the method that of Gauss. The integral is had by
//! Gauss's quadrature: exactly of a polynomial; else up to what `QUADRATURE` nodes more than stages leave, and a step
//! whose balance shows that is not taken.
//!
//! All of that holds for the coefficients as they are, not as rounded ones: these give each step the same small error,
//! which adds up to a drift (Hairer, McLachlan and Razakarivony, BIT 48, 2008). Where nothing takes energy out, the
//! states at the points of a step have what rounding took from coefficients and states added, and the step ends with
//! it.
//!
//! `radau` is Radau IIA of three stages (order 5), e_i the gradient at the node. It damps what is stiff (L-stable) at
//! the cost of energy: of a quadratic H it loses ½ w^T Q w with w = Σ d_i D_i in a step, where d d^T = diag(b) A + A^T
//! diag(b) - b b^T (Burrage and Butcher, SIAM J. Numer. Anal. 16, 1979: algebraic stability). That is never negative,
//! and booked under its own name.

mod complex;
mod decouple;
mod filtered_error;
mod modes;
pub(crate) mod tableau;

pub(crate) use decouple::is_coupled;

use crate::discretise::analysis::polynomial::{self, degree, is_quadratic};
use crate::discretise::analysis::relay;
use crate::discretise::analysis::smoothness::{self, is_kink};
use crate::discretise::cluster::{Cluster, Part, Recall, missing, verified};
use crate::discretise::equations::constraints::{self, LOSS, Projected, StepSizes};
use crate::discretise::equations::exact_coefficients::{self, Slopes};
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::system::{self, System};
use crate::discretise::equations::{discrete_gradient, ledger, newton};
use crate::discretise::steppers::gonzalez;
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Expr, Lowering, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::{Bends, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::double_double::DoubleDouble;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::{Entries, Properties, Stepper};
use decouple::Decoupled;
use rustc_hash::{FxHashMap, FxHashSet};
use tableau::{Nodes, Tableau, quadrature};

/// Nodes of the quadrature of an energy that is no polynomial, beyond the number of stages.
const QUADRATURE: usize = 4;

/// Nodes of a quadrature at most.
const NODES: usize = 18;

/// The unknowns of a stage: what each state changes by if its rate there holds over the step; and the loops.
struct Stage {
    change: Vec<Symbol>,
    loops: Vec<Symbol>,
}

/// A point of the step.
struct Point {
    /// How what each state changes by in each stage counts there.
    weights: Vec<DoubleDouble>,
    /// For each state what rounding took from it and takes from the weights, where that counts.
    rests: Vec<Symbol>,
}

/// Everything about a step as expressions.
struct Plan {
    tableau: Tableau,
    stages: Vec<Stage>,
    /// All points whose states are asked for.
    points: Vec<Point>,
    /// Outputs at each node.
    flats: Vec<FxHashMap<Symbol, Expr>>,
    /// What sources give at the nodes.
    sources: Vec<(Symbol, Expr)>,
}

impl Point {
    fn new(c: &Cluster, pool: &mut Pool, tableau: &Tableau, node: DoubleDouble, whole: bool) -> Self {
        let rest = |pool: &mut Pool, s: Symbol| {
            let name = format!("rest of {} at {}", pool.name(s), node.high);
            pool.symbol(&name)
        };
        let rests = if whole { c.states.iter().map(|s| rest(pool, s.symbol)).collect() } else { Vec::new() };
        Self { weights: tableau.integrals(node), rests }
    }

    /// The states there.
    fn states(&self, c: &Cluster, pool: &mut Pool, stages: &[Stage]) -> FxHashMap<Symbol, Expr> {
        let mut map = FxHashMap::default();
        for (k, s) in c.states.iter().enumerate() {
            let changes: Vec<Symbol> = stages.iter().map(|s| s.change[k]).collect();
            let (x, d) = (pool.var(s.symbol), weighted(pool, &self.weights, &changes));
            let at = pool.add(x, d);
            let rest = self.rests.get(k).map(|r| pool.var(*r));
            map.insert(s.symbol, rest.map_or(at, |r| pool.add(at, r)));
        }
        map
    }

    /// Has the rests known, from where the iteration starts: what changes in it is too small to count.
    fn bind(&self, b: &mut Builder, c: &Cluster, lowering: &mut Lowering, inputs: &Inputs, start: &[Value]) {
        let n = c.states.len() + c.loops.len();
        for (k, rest) in self.rests.iter().enumerate() {
            let changes: Vec<Value> = (0..self.weights.len()).map(|j| start[j * n + k]).collect();
            let carry = b.load(inputs.carries[k]);
            let low = lows(b, &self.weights, &changes);
            lowering.bind(*rest, b.add(low, carry));
        }
    }
}

/// What rounding takes from the weights of changes.
fn lows(b: &mut Builder, weights: &[DoubleDouble], changes: &[Value]) -> Value {
    let mut sum = None;
    for (w, d) in weights.iter().zip(changes) {
        let w = b.number(w.low);
        let term = b.mul(w, *d);
        sum = Some(sum.map_or(term, |sum| b.add(sum, term)));
    }
    sum.unwrap_or_else(|| b.number(0.0))
}

/// The same of changes that are known but for what rounding took from them.
fn low(
    b: &mut Builder,
    weights: &[DoubleDouble],
    changes: &[Value],
    names: &[Symbol],
    taken: &FxHashMap<Symbol, Value>,
) -> Value {
    let mut sum = lows(b, weights, changes);
    for (w, s) in weights.iter().zip(names) {
        if let Some(rest) = taken.get(s) {
            let w = b.number(w.high);
            let term = b.mul(w, *rest);
            sum = b.add(sum, term);
        }
    }
    sum
}

impl Plan {
    /// Unknowns that appear as exponents, with the knee beyond which the exponential dominates.
    fn knees(&self, c: &Cluster) -> Vec<(Symbol, Bends)> {
        let knees: FxHashMap<Symbol, Bends> = c.exponential_knees().into_iter().collect();
        let at = |z: &Symbol, at: &Symbol| knees.get(z).map(|b| (*at, *b));
        self.stages.iter().flat_map(|s| c.loops.iter().zip(&s.loops).filter_map(|(z, s)| at(z, s))).collect()
    }

    /// `whole`: whether what rounding takes counts.
    fn new(c: &Cluster, pool: &mut Pool, form: &Form, nodes: Nodes, whole: bool) -> Self {
        let tableau = nodes.tableau();
        let stages: Vec<Stage> = (1..=tableau.stages())
            .map(|i| Stage {
                change: c.delta.iter().map(|d| at_stage(pool, *d, i)).collect(),
                loops: c.loops.iter().map(|z| at_stage(pool, *z, i)).collect(),
            })
            .collect();
        let mut points: Vec<Point> = tableau.nodes().map(|node| Point::new(c, pool, &tableau, node, whole)).collect();
        let mut at_nodes: Vec<FxHashMap<Symbol, Expr>> = points.iter().map(|p| p.states(c, pool, &stages)).collect();
        source_driven(c, pool, form, (&tableau, &stages), &mut at_nodes);
        let gradients = gradients(c, pool, (&tableau, &stages, &at_nodes), (nodes, whole), |pool, node| {
            let point = Point::new(c, pool, &tableau, node, whole);
            let map = point.states(c, pool, &stages);
            points.push(point);
            map
        });
        let (mut flats, mut sources) = (Vec::new(), Vec::new());
        let timed = switches_in_time(c, pool);
        for (i, (node, mut map)) in tableau.nodes().zip(at_nodes).enumerate() {
            for (g, list) in c.groups.iter().zip(&gradients) {
                for (s, z) in g.states.iter().zip(&list[i]) {
                    if let Some(column) = c.states[*s].column {
                        map.insert(form.column(column).out, *z);
                    }
                }
            }
            map.extend(c.loops.iter().zip(&stages[i].loops).map(|(z, at)| (*z, pool.var(*at))));
            let part = if node.high == 1.0 && timed { BEFORE } else { node.high };
            later(c, pool, part, &mut map);
            sources.extend(inputs::sources(c, pool, &mut map, |name| format!("{name} in stage {}", i + 1)));
            flats.push(c.flat(pool, map));
        }
        Self { tableau, stages, points, flats, sources }
    }

    /// Unknowns with their residuals, node by node: changes of the states, then loops.
    fn system(&self, c: &Cluster, pool: &mut Pool) -> (Vec<Symbol>, Vec<Expr>) {
        let (mut unknowns, mut residuals) = (Vec::new(), Vec::new());
        let loops = c.loop_residuals(pool);
        for (stage, flat) in self.stages.iter().zip(&self.flats) {
            unknowns.extend(stage.change.iter().chain(&stage.loops).copied());
            if let Some(h) = c.h {
                let h = pool.var(h);
                for (s, d) in c.states.iter().zip(&stage.change) {
                    let rate = pool.substitute(s.rate, flat);
                    let (step, d) = (pool.mul(h, rate), pool.var(*d));
                    residuals.push(pool.sub(d, step));
                }
            }
            residuals.extend(loops.iter().map(|r| pool.substitute(*r, flat)));
        }
        (unknowns, residuals)
    }
}

impl Plan {
    /// Solves the equations of all stages by iteration, and gives what rounding took from the unknowns, where `whole`
    /// asks for it.
    fn solve(
        &self,
        (c, model, form): (&Cluster, &mut Model, &Form),
        (b, lowering): (&mut Builder, &mut Lowering),
        (unknowns, mut residuals): (&[Symbol], Vec<Expr>),
        inputs: &Inputs,
        (whole, apart, own): (bool, Option<&Decoupled>, bool),
    ) -> Result<FxHashMap<Symbol, Value>, Vec<Diagnostic>> {
        let s = self.tableau.stages();
        let (mut weight, mut scale) = discrete_gradient::measures(c, model, form, b, lowering, inputs)?;
        let sizes = StepSizes::of(c, (model, form), (b, lowering), inputs)?;
        sizes.measure(c, b, &mut weight, &mut scale);
        let n = c.states.len() + c.loops.len();
        for ((i, row), stage) in self.tableau.matrix().into_iter().enumerate().zip(residuals.chunks_mut(n.max(1))) {
            sizes.reduce(c, &mut model.pool, row[i], stage);
        }
        let start = match own {
            true => guesses(b, c, &self.tableau, inputs),
            false => cold(b, c, s, inputs),
        };
        self.points.iter().for_each(|p| p.bind(b, c, lowering, inputs, &start));
        lowering.last(c.states.iter().map(|s| s.symbol));
        let carries = inputs.carries.iter().map(|slot| (!whole).then(|| b.load(*slot)));
        let states = c.states.iter().map(|s| s.symbol).zip(carries).collect();
        let knees = self.knees(c);
        let known = self.stages.iter().flat_map(|stage| stage.change.iter().copied()).collect();
        let start = newton::predict_arguments(model, b, lowering, (unknowns, &residuals), &knees, &known, start)?;
        let system = System {
            unknowns: unknowns.to_vec(),
            h: c.h,
            start,
            residuals,
            weight: weight.repeat(s),
            scale: scale.repeat(s),
            exact_coefficients: whole,
            rests: whole,
            left: system::left(c).filter(|_| whole),
            states,
            knees,
            undetermined: c.may_be_undetermined(),
            redundant: c.redundant,
            non_smooth: smoothness::is_non_smooth(c) || relay::is_steeply_non_smooth(c, model, form),
            ..System::default()
        };
        match apart {
            Some(apart) => apart.iterate(c, model, b, lowering, (&system, inputs)),
            None => newton::solve(model, b, lowering, system),
        }
    }
}

/// The part of a step at whose end a node looks, where something switches in time: the end may be the instant of that,
/// and the step is what comes before.
const BEFORE: f64 = 1.0 - 1.0 / (1_u64 << 36) as f64;

/// Whether a law or a source is one thing or another by the time.
fn switches_in_time(c: &Cluster, pool: &Pool) -> bool {
    let mut all = c.nodes.iter().flat_map(|n| n.how.expressions());
    let Some(t) = c.time else { return false };
    all.any(|e| pool.contains(e, t) && pool.any_node(e, &is_kink))
}

/// A symbol's own one at a stage.
fn at_stage(pool: &mut Pool, s: Symbol, i: usize) -> Symbol {
    let name = format!("{} in stage {i}", pool.name(s));
    pool.symbol(&name)
}

/// `Σ weight d`
fn weighted(pool: &mut Pool, weights: &[DoubleDouble], of: &[Symbol]) -> Expr {
    let terms: Vec<(Expr, Number)> =
        weights.iter().zip(of).map(|(w, d)| (pool.var(*d), Number::float(w.high))).collect();
    pool.combine(&terms)
}

/// Time and what is given from outside, at a part of the step.
fn later(c: &Cluster, pool: &mut Pool, part: f64, map: &mut FxHashMap<Symbol, Expr>) {
    let (Some(t), Some(h)) = (c.time, c.h) else { return };
    let (te, he) = (pool.var(t), pool.var(h));
    let ahead = pool.scale(he, Number::float(part));
    map.insert(t, pool.add(te, ahead));
    for &(_, u, du) in &c.inputs {
        let (ue, due) = (pool.var(u), pool.var(du));
        let gone = pool.mul(ahead, due);
        map.insert(u, pool.add(ue, gone));
    }
}

/// A source that storages follow is a polynomial over the step as the states are: it has the source's slopes at the
/// nodes, and what these miss of its change is shared out evenly. So the energy that follows it, a square, changes by
/// the work done on it at the nodes.
fn source_driven(
    c: &Cluster,
    pool: &mut Pool,
    form: &Form,
    (tableau, stages): (&Tableau, &[Stage]),
    at_nodes: &mut [FxHashMap<Symbol, Expr>],
) {
    let (Some(t), Some(h)) = (c.time, c.h) else { return };
    let he = pool.var(h);
    let at = |pool: &mut Pool, e: Expr, part: f64| {
        let mut map = FxHashMap::default();
        later(c, pool, part, &mut map);
        pool.substitute(e, &map)
    };
    let slopes = |pool: &mut Pool, e: Expr| -> Vec<Expr> {
        let slope = pool.derivative(e, t);
        let list: Vec<Expr> = tableau.nodes().map(|node| at(pool, slope, node.high)).collect();
        let mean: Vec<(Expr, Number)> =
            list.iter().zip(&tableau.weights).map(|(s, w)| (*s, Number::float(w.high))).collect();
        let mean = pool.combine(&mean);
        let end = at(pool, e, 1.0);
        let gone = pool.sub(end, e);
        let gone = pool.div(gone, he);
        let missed = pool.sub(gone, mean);
        list.into_iter().map(|s| pool.add(s, missed)).collect()
    };
    for n in &c.nodes {
        match (n.part, n.how) {
            (Part::Source(column), Output::Explicit(e)) if c.driving_sources.contains(&column) => {
                let slopes = slopes(pool, e);
                for (map, row) in at_nodes.iter_mut().zip(tableau.matrix()) {
                    let terms: Vec<(Expr, Number)> =
                        slopes.iter().zip(row).map(|(s, a)| (*s, Number::float(a))).collect();
                    let mean = pool.combine(&terms);
                    let gone = pool.mul(he, mean);
                    map.insert(form.column(column).out, pool.add(e, gone));
                }
            }
            (Part::SourceDriven(state), _) => {
                let symbols: Vec<Symbol> = c.states.iter().map(|s| s.symbol).collect();
                let of_states = pool.derivatives(state, &symbols);
                let slopes = slopes(pool, state);
                for ((map, stage), slope) in at_nodes.iter_mut().zip(stages).zip(slopes) {
                    let mut terms = vec![slope];
                    for (k, change) in of_states.iter().zip(&stage.change) {
                        let change = pool.var(*change);
                        let rate = pool.div(change, he);
                        terms.push(pool.mul(*k, rate));
                    }
                    map.insert(n.out, pool.sum(&terms));
                }
            }
            (Part::Source(_) | Part::Resistor(_) | Part::Signal | Part::Multiplier(_), _) => {}
        }
    }
}

/// The co-energy variables of each group at each node: by group, node, state. `states` gives the states elsewhere.
fn gradients(
    c: &Cluster,
    pool: &mut Pool,
    (tableau, stages, at_nodes): (&Tableau, &[Stage], &[FxHashMap<Symbol, Expr>]),
    (nodes, whole): (Nodes, bool),
    mut states: impl FnMut(&mut Pool, DoubleDouble) -> FxHashMap<Symbol, Expr>,
) -> Vec<Vec<Vec<Expr>>> {
    let s = stages.len();
    let mut list = Vec::new();
    let mut slopes = Slopes::default();
    let mut at_rules: FxHashMap<usize, Vec<FxHashMap<Symbol, Expr>>> = FxHashMap::default();
    for g in &c.groups {
        let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
        let level = c.energy_form(pool, g);
        let laws: Vec<Expr> = g.coenergy.iter().enumerate().map(|(i, z)| level.law(pool, i, *z)).collect();
        let (mut straight, bent): (Vec<Expr>, Vec<Expr>) = match nodes == Nodes::Radau || is_quadratic(c, pool, g) {
            true => (laws, Vec::new()),
            false => laws.iter().map(|z| exact_coefficients::split_affine(pool, *z, &symbols)).unzip(),
        };
        if whole {
            straight.iter_mut().for_each(|z| *z = exact_coefficients::with_parameters(pool, *z, &symbols, &mut slopes));
        }
        let straight: Vec<Vec<Expr>> =
            at_nodes.iter().map(|map| straight.iter().map(|z| pool.substitute(*z, map)).collect()).collect();
        if bent.is_empty() {
            list.push(straight);
            continue;
        }
        let degree = bent.iter().map(|z| degree(pool, *z, &symbols)).try_fold(0, |most, d| Some(most.max(d?)));
        // The integrand has the degree of the gradient along the polynomial, and that of l_i.
        let count = degree.map_or(s + QUADRATURE, |d| (d as usize * s + s).div_ceil(2));
        let count = count.min(NODES);
        let rule = quadrature(count);
        let maps = at_rules.entry(count).or_insert_with(|| rule.iter().map(|(node, _)| states(pool, *node)).collect());
        let along: Vec<Vec<Expr>> =
            maps.iter().map(|map| bent.iter().map(|z| pool.substitute(*z, map)).collect()).collect();
        let values: Vec<Vec<DoubleDouble>> = rule.iter().map(|(node, _)| tableau.values(*node)).collect();
        let at = (0..s).map(|i| {
            (0..g.states.len())
                .map(|k| {
                    let terms =
                        rule.iter().zip(&values).zip(&along).map(|(((_, w), l), z)| {
                            (z[k], Number::float((*w * l[i]).divided(tableau.weights[i]).high))
                        });
                    let terms: Vec<(Expr, Number)> = terms.collect();
                    let bent = pool.combine(&terms);
                    pool.add(straight[i][k], bent)
                })
                .collect()
        });
        list.push(at.collect());
    }
    list
}

/// Where in the state a method keeps the polynomial of its last step: for each unknown of a stage its Taylor
/// coefficients at the end, then the length of that step; 0 where there was none.
fn memory(c: &Cluster, nodes: Nodes) -> usize {
    (c.states.len() + c.loops.len()) * nodes.stages() + 1
}

/// What the unknowns start from: the last step's polynomial carried on.
fn guesses(b: &mut Builder, c: &Cluster, tableau: &Tableau, inputs: &Inputs) -> Vec<Value> {
    let (s, n) = (tableau.stages(), c.states.len() + c.loops.len());
    let first = b.slots(Array::State, n * s + 1).index as usize;
    let slot = |i: usize| Slot::new(Array::State, first + i);
    let past = b.load(slot(n * s));
    let (zero, reach) = (b.number(0.0), b.number(c.thresholds.predictor.reach));
    let there = b.binary(Binary::Lt, zero, past);
    let most = b.mul(reach, past);
    let near = b.binary(Binary::Le, inputs.h, most);
    let ratio = b.div(inputs.h, past);
    let mut list = Vec::new();
    for node in tableau.nodes() {
        let node = b.number(node.high);
        let theta = b.mul(ratio, node);
        for k in 0..n {
            let last = b.load(slot(k * s));
            let mut sum = b.load(slot(k * s + s - 1));
            for m in (0..s - 1).rev() {
                let a = b.load(slot(k * s + m));
                let term = b.mul(sum, theta);
                sum = b.add(a, term);
            }
            let ahead = b.select(near, sum, last);
            let (ahead, without) = match k.checked_sub(c.states.len()) {
                None => (b.mul(ahead, inputs.h), zero),
                Some(z) => (ahead, inputs.guesses[z]),
            };
            list.push(b.select(there, ahead, without));
        }
    }
    list
}

/// What they start from where nothing is kept.
fn cold(b: &mut Builder, c: &Cluster, stages: usize, inputs: &Inputs) -> Vec<Value> {
    let zero = b.number(0.0);
    let one: Vec<Value> = c.states.iter().map(|_| zero).chain(inputs.guesses.iter().copied()).collect();
    one.repeat(stages)
}

/// Keeps the polynomial of this step.
fn keep(b: &mut Builder, c: &Cluster, tableau: &Tableau, h: Value, found: &[Value]) {
    let (s, n) = (tableau.stages(), c.states.len() + c.loops.len());
    let first = c.memory_at();
    let one = b.number(1.0);
    let inverse = b.div(one, h);
    let expansion = tableau.expansion();
    for k in 0..n {
        for (m, row) in expansion.iter().enumerate() {
            let mut sum = None;
            for (j, w) in row.iter().enumerate() {
                let w = b.number(*w);
                let term = b.mul(w, found[j * n + k]);
                sum = Some(sum.map_or(term, |sum| b.add(sum, term)));
            }
            let sum = sum.unwrap_or(one);
            let a = if k < c.states.len() { b.mul(sum, inverse) } else { sum };
            b.store(Slot::new(Array::Next, first + k * s + m), a);
        }
    }
    b.store(Slot::new(Array::Next, first + n * s), h);
}

/// The step of a cluster with these nodes.
pub(crate) fn step(
    label: Label,
    c: &mut Cluster,
    model: &mut Model,
    form: &Form,
    nodes: Nodes,
) -> Result<Step, Refusal> {
    let follows = !c.driving_sources.is_empty();
    let moves = nodes == Nodes::Radau && c.has_moving_source_driven_storage(&model.pool);
    if moves || (follows && !polynomial::all_quadratic(c, &mut model.pool)) {
        let why = "one of its storages follows a moving source; the collocation methods of Gauss take that if all energies \
            are quadratic";
        return Err(Refusal::Unfit(why.into()));
    }
    if c.redundant {
        let why = "constraints of it say the same, which holds at the ends of steps alone";
        return Err(Refusal::Unfit(why.into()));
    }
    c.couple_stiffly(model, form);
    let decoupled = if follows || c.has_constraints() { None } else { Decoupled::new(c, model, form, nodes) };
    // Linear equations are solved at once: from no guess, and by a quadrature that misses nothing.
    let linear = decoupled.as_ref().is_some_and(|d| d.is_linear());
    c.memory = if linear { 0 } else { memory(c, nodes) };
    c.recalls = Some(Recall::Length);
    c.watched = nodes != Nodes::Radau && !linear && !follows;
    Ok(write(c, model, form, (label, nodes, true), decoupled.as_ref())?)
}

/// The step of a cluster that another stepper steps, for what that cannot. It keeps nothing.
pub(crate) fn write_fallback(
    (label, nodes): (Label, Nodes),
    c: &Cluster,
    model: &mut Model,
    form: &Form,
) -> Result<Step, Vec<Diagnostic>> {
    let decoupled = Decoupled::new(c, model, form, nodes);
    write(c, model, form, (label, nodes, false), decoupled.as_ref())
}

/// Writes the step.
fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    (label, nodes, own): (Label, Nodes, bool),
    apart: Option<&Decoupled>,
) -> Result<Step, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, &format!("{} step", label.name)));
    let mut entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let linear = apart.filter(|a| a.is_linear());
    // What rounding takes from the coefficients is seen where nothing else takes energy.
    let whole = nodes != Nodes::Radau && c.is_lossless() && linear.is_none();
    let plan = Plan::new(c, &mut model.pool, form, nodes, whole);
    inputs::bind(model, &mut b, &mut lowering, &plan.sources)?;
    let tableau = &plan.tableau;
    let s = tableau.stages();
    let (unknowns, residuals) = plan.system(c, &mut model.pool);
    let (known, taken) = match linear {
        Some(linear) => {
            let known = linear.at_once(c, model, &mut b, &mut lowering, (&unknowns, &residuals), &inputs)?;
            (known, FxHashMap::default())
        }
        None => {
            let equations = (&unknowns[..], residuals);
            let taken =
                plan.solve((c, model, form), (&mut b, &mut lowering), equations, &inputs, (whole, apart, own))?;
            (Vec::new(), taken)
        }
    };
    let mut value =
        |model: &mut Model, b: &mut Builder, e: Expr| lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s));
    let (mut next, mut rests, mut steps) = (Vec::new(), Vec::new(), Vec::new());
    let many = inputs::is_many(c);
    for (k, x) in inputs.states.iter().enumerate() {
        let carry = b.load(inputs.carries[k]);
        let (d, low) = match known.get(k) {
            Some(d) => (*d, None),
            None => {
                let changes: Vec<Symbol> = plan.stages.iter().map(|s| s.change[k]).collect();
                let d = weighted(&mut model.pool, &tableau.weights, &changes);
                let mut found = Vec::with_capacity(s);
                for u in &changes {
                    let u = model.pool.var(*u);
                    found.push(value(model, &mut b, u)?);
                }
                let d = value(model, &mut b, d)?;
                (d, whole.then(|| low(&mut b, &tableau.weights, &found, &changes, &taken)))
            }
        };
        steps.push(d);
        let (v, rest) = match low {
            None => inputs::advance(&mut b, *x, (d, None), carry, many),
            Some(low) => inputs::advance_whole(&mut b, *x, (d, low), carry),
        };
        next.push(v);
        rests.push(rest);
    }
    let mut found = Vec::new();
    for u in &unknowns {
        let u = model.pool.var(*u);
        found.push(value(model, &mut b, u)?);
    }
    let last = found.len() - c.loops.len();
    let ends = (&mut next[..], &mut rests[..]);
    let projected = constraints::project(c, (model, form), &mut b, (&inputs, &found[last..]), ends)?;
    b.slots(Array::Next, c.slots());
    for (i, (v, rest)) in next.iter().zip(&rests).enumerate() {
        b.store(Slot::new(Array::Next, i), *v);
        b.store(Slot::new(Array::Next, c.carry_at() + i), *rest);
    }
    let mut integrands = Vec::new();
    for (i, (integral, start)) in c.integrals.iter().zip(&inputs.integrals).enumerate() {
        let rates: Vec<Expr> = plan.flats.iter().map(|flat| model.pool.substitute(integral.rate, flat)).collect();
        integrands.push(rates.clone());
        let weights = tableau.weights.iter().map(|w| Number::float(w.high));
        let terms: Vec<(Expr, Number)> = rates.into_iter().zip(weights).collect();
        let mean = model.pool.combine(&terms);
        let mean = value(model, &mut b, mean)?;
        let mut change = b.mul(inputs.h, mean);
        if let Some(more) = projected.as_ref().and_then(|found| found.integrals[i]) {
            change = b.add(change, more);
        }
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, c.states.len() + i), v);
    }
    inputs::store_loops(c, &mut b, &found[last..]);
    match own {
        true if linear.is_none() => keep(&mut b, c, tableau, inputs.h, &found),
        true => {}
        false => inputs::no_memory(&mut b, c),
    }
    changes(c, (model, form), (&mut b, &mut lowering), (&steps, projected.as_ref()), &entries)?;
    let mut passive = true;
    if nodes == Nodes::Radau {
        passive = losses(c, model, &mut b, &mut lowering, &plan, &mut entries)?;
    }
    let stages: Vec<(f64, &FxHashMap<Symbol, Expr>)> =
        tableau.weights.iter().map(|w| w.high).zip(&plan.flats).collect();
    let over = (inputs.h, projected.as_ref());
    ledger::ledger(c, model, form, &mut b, &mut lowering, &stages, &entries, over)?;
    ledger::energies(c, (model, form), &mut b, (&next, &rests), &inputs, &entries)?;
    let mut estimate = None;
    if nodes == Nodes::Radau {
        let stages = (&found[..], &integrands[..]);
        estimate = filtered_error::store(c, (model, form), (&mut b, &mut lowering), tableau, &inputs, stages)?;
    }
    let program = verified(model, b.finish())?;
    // Linear equations need no other stepper.
    let fallback = label.fallback.filter(|_| linear.is_none());
    let fallback = fallback.map(|label| gonzalez::write(*label, c, model, form, false)).transpose()?;
    let fallback = fallback.map(|step| Box::new(step.0));
    let estimated = if estimate.is_some() { filtered_error::ORDER } else { 0 };
    let label = Label { properties: Properties { passive, estimated, ..label.properties }, ..label };
    Ok((Stepper { fallback, estimate, ..label.stepper(program) }, entries))
}

/// Stores the change of each region's energy, by its discrete gradient and so without cancellation, and the sum of the
/// magnitudes of its parts: against that what the quadrature misses is seen from the first step on, when H is no more
/// than rounding.
fn changes(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    (b, lowering): (&mut Builder, &mut Lowering),
    (steps, projected): (&[Value], Option<&Projected>),
    entries: &[Entries],
) -> Result<(), Vec<Diagnostic>> {
    let half = model.pool.ratio(1, 2);
    let mut middle = FxHashMap::default();
    for ((s, d), step) in c.states.iter().zip(&c.delta).zip(steps) {
        let (x, de) = (model.pool.var(s.symbol), model.pool.var(*d));
        let ahead = model.pool.mul(half, de);
        middle.insert(s.symbol, model.pool.add(x, ahead));
        lowering.bind(*d, *step);
    }
    for (e, r) in entries.iter().zip(&c.regions) {
        let Some((change, exchanged)) = e.change else { continue };
        let (mut sum, mut size) = (b.number(0.0), b.number(0.0));
        for g in c.groups_in(*r) {
            let gradient = discrete_gradient::gradient(c, &mut model.pool, g, (&middle, &FxHashSet::default()));
            for (s, z) in g.states.iter().zip(gradient) {
                let z = lowering.lower(&model.pool, b, z).map_err(|s| missing(model, s))?;
                let d = steps[*s];
                let part = b.mul(z, d);
                sum = b.add(sum, part);
                let part = b.unary(Unary::Abs, part);
                size = b.add(size, part);
            }
        }
        if let Some(projected) = projected {
            let part = projected.change(b, form, *r);
            sum = b.add(sum, part);
            let part = b.unary(Unary::Abs, part);
            size = b.add(size, part);
        }
        b.store(Slot::new(Array::Output, change), sum);
        b.store(Slot::new(Array::Output, exchanged), size);
    }
    Ok(())
}

/// What the three stages of Radau lose of each region's energy; whether that is all, every energy being quadratic.
fn losses(
    c: &Cluster,
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    plan: &Plan,
    entries: &mut [Entries],
) -> Result<bool, Vec<Diagnostic>> {
    let t = &plan.tableau;
    let a: Vec<Vec<DoubleDouble>> = t.nodes().map(|node| t.integrals(node)).collect();
    // m = diag(b) A + A^T diag(b) - b b^T is d d^T.
    let m: Vec<DoubleDouble> = (0..t.stages())
        .map(|j| {
            let (b, b0) = (t.weights[j], t.weights[0]);
            b0 * a[0][j] + b * a[j][0] - b0 * b
        })
        .collect();
    let d: Vec<DoubleDouble> = m.iter().map(|x| x.divided(m[0].sqrt())).collect();
    let moved: Vec<Expr> = (0..c.states.len())
        .map(|k| {
            let changes: Vec<Symbol> = plan.stages.iter().map(|s| s.change[k]).collect();
            weighted(&mut model.pool, &d, &changes)
        })
        .collect();
    let mut whole = true;
    for (e, r) in entries.iter_mut().zip(&c.regions) {
        let mut terms = Vec::new();
        for g in c.groups_in(*r) {
            if !is_quadratic(c, &mut model.pool, g) {
                whole = false;
                continue;
            }
            let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                let Some((linear, _)) = model.pool.affine(*z, &symbols) else { continue };
                for (j, k) in linear {
                    let w = [moved[*s], moved[g.states[j]], k];
                    terms.push((model.pool.product(&w), Number::ratio(1, 2)));
                }
            }
        }
        let loss = model.pool.combine(&terms);
        let loss = lowering.lower(&model.pool, b, loss).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, format!("dissipated({LOSS})"));
        b.store(slot, loss);
        e.dissipated.push((LOSS.into(), slot.index as usize));
    }
    Ok(whole)
}
