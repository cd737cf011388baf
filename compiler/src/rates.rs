//! The continuous regions at a state, by value: what storages, sources and resistors give there, and how fast the
//! states change.

use crate::Stages;
use crate::elaborate::told;
use crate::expression::{Expr, Node, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{Law, Model, Signal};
use crate::structure::{ColumnId, Form, Group, Output, Region, Role};
use bond_runtime::ir::Unary;
use nalgebra::{DMatrix, DVector};
use rustc_hash::{FxHashMap, FxHashSet};

/// Definitions within definitions that a constraint is looked through.
const DEEP: usize = 16;

/// Why a state has no values.
const SINGULAR: &str = "the loops of resistors are singular at this state";
const OPEN: &str = "no solution of the loops of resistors was found at this state";

/// So many variables of loops are named.
const MANY: usize = 5;
/// Expressions of so many letters are shown.
const LONG: usize = 80;
/// Most iterations of a loop (from far up an exponential each goes down by one of its units, and there are some 700),
/// and most halvings of one update.
const ITERATIONS: usize = 800;
const HALVINGS: usize = 40;
/// What drives loops grows by no less than this part of it.
const LEAST: f64 = 1e-6;
/// Solves of what damped pivots leave; each leaves the damping's part of what the one before left.
const REFINEMENTS: usize = 3;

/// What impulses in the place of multipliers come to in an expression that has these.
fn along(pool: &mut Pool, e: Expr, impulses: &[(Symbol, Symbol, bool)]) -> Expr {
    let mut terms = Vec::new();
    for (multiplier, impulse, _) in impulses {
        let k = pool.derivative(e, *multiplier);
        if !pool.is_zero(k) {
            let impulse = pool.var(*impulse);
            terms.push(pool.mul(k, impulse));
        }
    }
    pool.sum(&terms)
}

/// A state of the continuous regions, with all that follows from it.
pub(crate) struct Point {
    /// Energy states, signal states, then integrals: name, symbol, rate.
    pub(crate) states: Vec<(String, Symbol, Expr)>,
    /// What is given from outside, at its default; open ports and what sampled regions hold at borders, at 0; then
    /// sampled signal states and what else continuous parts read of samples: name and symbol.
    pub(crate) inputs: Vec<(String, Symbol)>,
    /// Definitions: outputs of storages, sources and resistors.
    pub(crate) columns: Vec<(Symbol, Expr)>,
    /// By definition, whether it is one of a sampled region, which stands still between samples.
    pub(crate) still: Vec<bool>,
    /// Definitions that need none but those before them, in that order.
    pub(crate) order: Vec<usize>,
    /// Definitions in loops, or behind one.
    pub(crate) looped: Vec<usize>,
    /// 1 less the slopes of the looped definitions by each other.
    pub(crate) loops: DMatrix<f64>,
    /// Multipliers of constraints of which some say the same, and the part by which their pivots are damped.
    shared: (FxHashSet<Symbol>, f64),
    /// What constraints have be 0.
    pub(crate) ties: Vec<Expr>,
    /// The value of each symbol.
    pub(crate) at: FxHashMap<Symbol, f64>,
}

impl Point {
    /// The scene at a time and at values of its states (energy and signal states by name, then `integral[0]` and so
    /// on); a state that is not given is at its start.
    pub(crate) fn new(stages: &mut Stages, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Point, String> {
        let mut point = Point::settled(stages, time, states);
        if let Err(why) = point.solve(&mut stages.model.pool) {
            return Err(point.unsolved(&stages.model.pool, why));
        }
        Ok(point)
    }

    /// The same without what is in loops, or behind one.
    fn settled(stages: &mut Stages, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Point {
        let mut point = Point {
            states: vec![],
            inputs: vec![],
            columns: vec![],
            still: vec![],
            order: vec![],
            looped: vec![],
            loops: DMatrix::zeros(0, 0),
            shared: (FxHashSet::default(), stages.model.settings.thresholds.iteration.damping),
            ties: vec![],
            at: FxHashMap::default(),
        };
        point.define(stages, time, states);
        point.settle(&stages.model.pool);
        point
    }

    /// Says that the loops do not tell what is in them, and names them.
    pub(crate) fn singular(&self, pool: &Pool) -> String {
        self.unsolved(pool, SINGULAR)
    }

    fn unsolved(&self, pool: &Pool, why: &str) -> String {
        let mut names: Vec<&str> = self.looped.iter().take(MANY).map(|i| pool.name(self.columns[*i].0)).collect();
        if self.looped.len() > MANY {
            names.push("others");
        }
        let stuck = match why == SINGULAR {
            true => {
                "; friction that holds at rest has no slope. Take an instant at which it slips (`--at`); have it slip, by \
                a start or a larger source (`--set`); or give it a slope at rest, as `e = F*tanh(f/(1 mm/s))` has"
            }
            false => "",
        };
        format!("{why}: {}{stuck}", names.join(", "))
    }

    /// The value of an expression here.
    pub(crate) fn value(&self, pool: &Pool, e: Expr) -> f64 {
        pool.eval(e, &|s| self.at.get(&s).copied().unwrap_or(0.0))
    }

    /// The first operation within an expression that has no finite value here, though what it is of has one.
    fn break_of(&self, pool: &Pool, mut e: Expr) -> Expr {
        let is_off = |e: Expr| !self.value(pool, e).is_finite();
        loop {
            let mut below = Vec::new();
            match pool.node(e) {
                Node::Select(c, a, b) => below.extend([*c, if self.value(pool, *c) == 0.0 { *b } else { *a }]),
                node => node.each_child(&mut |child| below.push(child)),
            }
            match below.into_iter().find(|child| is_off(*child)) {
                Some(child) => e = child,
                None => return e,
            }
        }
    }

    /// States get their values, everything else its definition.
    fn define(&mut self, stages: &mut Stages, time: f64, states: &dyn Fn(&str) -> Option<f64>) {
        let (model, form) = (&mut stages.model, &stages.form);
        let homes = sampled_integrals(model, form);
        let held = held(model, form, &homes);
        self.at.extend(model.signals.iter().filter(|s| *s.1 == Signal::Time).map(|s| (*s.0, time)));
        for i in &model.inputs {
            self.at.insert(i.symbol, i.value);
            self.inputs.push((i.name.clone(), i.symbol));
        }
        for r in &form.regions {
            let here = r.sampling.is_none();
            for s in &r.states {
                self.at.insert(s.symbol, states(&s.name).unwrap_or(s.initial));
                if here {
                    self.states.push((s.name.clone(), s.symbol, form.input(&mut model.pool, s.column)));
                }
            }
            for g in &r.groups {
                for (s, z) in g.states.iter().zip(&g.coenergy) {
                    self.columns.push((form.column(r.states[*s].column).out, *z));
                }
            }
            for c in &r.inputs {
                let column = form.column(*c);
                match column.role {
                    Role::Source(v) => self.columns.push((column.out, v)),
                    Role::Bar | Role::Open(_) => {
                        let name = format!("{}.{}", column.name, column.gives.letter());
                        self.at.insert(column.out, states(&name).unwrap_or(0.0));
                        if here {
                            self.inputs.push((name, column.out));
                        }
                    }
                    Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => {}
                }
            }
            for (c, how) in &r.resistors {
                let out = form.column(*c).out;
                // Of a root: z - (z - residual), whose derivative is that of the residual.
                let unknown = model.pool.var(how.unknown(out));
                match how {
                    // By its rate, once all that states are moved by is known.
                    Output::Implicit { .. } if form.column(*c).role == Role::Constraint => {}
                    Output::Explicit(e) => self.columns.push((out, *e)),
                    Output::Implicit { residual: e, .. } => self.columns.push((out, model.pool.sub(unknown, *e))),
                    Output::Curve { parameter, out: value, residual, .. } => {
                        self.columns.push((*parameter, model.pool.sub(unknown, *residual)));
                        self.columns.push((out, *value));
                    }
                }
            }
            self.columns.extend(r.following.iter().map(|f| (form.column(f.column).out, f.rate)));
            self.still.resize(self.columns.len(), !here);
        }
        for l in &form.loops {
            self.columns.push((l.unknown, l.value));
            self.still.push(form.regions[l.region.at()].sampling.is_some());
        }
        for (m, law) in model.memories.iter().zip(&form.memories) {
            self.at.insert(m.symbol, states(&m.name).unwrap_or(m.start));
            if m.sampling.is_none() {
                self.states.push((m.name.clone(), m.symbol, *law));
            }
        }
        // What arrives by a delay is an input of the rates.
        for d in &model.delays {
            self.at.insert(d.symbol, states(&d.name).unwrap_or(d.start));
            if !d.is_state() {
                self.inputs.push((d.name.clone(), d.symbol));
            }
        }
        for (i, (integral, rate)) in model.integrals.iter().zip(&form.integrals).enumerate() {
            let name = format!("integral[{i}]");
            self.at.insert(integral.symbol, states(&name).unwrap_or(integral.start));
            if homes[i].is_none() {
                self.states.push((name, integral.symbol, *rate));
            }
        }
        self.constrain(model, form);
        // What is held is what the last sample gave; where none is told, what one would give now.
        let told: FxHashMap<Symbol, f64> = held.iter().filter_map(|(name, s)| Some((*s, states(name)?))).collect();
        let kept: Vec<bool> = self.columns.iter().map(|c| !told.contains_key(&c.0)).collect();
        let mut keep = kept.iter();
        self.columns.retain(|_| keep.next() == Some(&true));
        let mut keep = kept.iter();
        self.still.retain(|_| keep.next() == Some(&true));
        self.at.extend(told);
        self.inputs.extend(held);
    }

    /// The multipliers of constraints: each has its constraint stay fulfilled, which the states are that. Speeds
    /// without inertia are those by which the states fulfil the constraints, with no impulses left at them; their rates
    /// are what leaves no effort at them.
    fn constrain(&mut self, model: &mut Model, form: &Form) {
        let mut constraints = Vec::new();
        for (i, r) in form.regions.iter().enumerate() {
            let of = r.resistors.iter().filter(|(c, _)| form.column(*c).role == Role::Constraint);
            if form.redundant.contains(&RegionId(i as u32)) {
                self.shared.0.extend(of.clone().map(|(c, _)| form.column(*c).out));
            }
            constraints.extend(of.map(|(c, _)| (*c, r.sampling.is_none())));
        }
        if constraints.is_empty() {
            return;
        }
        // What constraints tie in terms of states: what gives it is put in its place, one after the other.
        let known: FxHashMap<Symbol, Expr> =
            self.columns.iter().copied().filter(|(s, e)| !model.pool.contains(*e, *s)).collect();
        let by_states = |model: &mut Model, mut e: Expr| {
            for _ in 0..DEEP {
                if !model.pool.contains_any(e, &|s| known.contains_key(&s)) {
                    break;
                }
                e = model.pool.substitute(e, &known);
            }
            e
        };
        let is_speed = |model: &Model, c: ColumnId| model.element(form.column(c).element).is_massless();
        let (speeds, ties): (Vec<_>, Vec<_>) = constraints.into_iter().partition(|(c, _)| is_speed(model, *c));
        let mut rates: Vec<(Symbol, Expr)> = self.states.iter().map(|(_, s, rate)| (*s, *rate)).collect();
        let one = model.pool.int(1);
        rates.extend(model.signals.iter().filter(|s| *s.1 == Signal::Time).map(|s| (*s.0, one)));
        let mut defined: Vec<(Symbol, Expr, bool)> = Vec::new();
        let mut impulses = Vec::new();
        for (tie, here) in ties.iter().filter(|_| !speeds.is_empty()) {
            let out = form.column(*tie).out;
            impulses.push((out, model.pool.symbol(&format!("impulse of {}", model.pool.name(out))), *here));
        }
        let mut ends: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for (_, s, rate) in self.states.iter().filter(|_| !speeds.is_empty()) {
            let x = model.pool.var(*s);
            let moved = along(&mut model.pool, *rate, &impulses);
            ends.insert(*s, model.pool.add(x, moved));
        }
        for (speed, here) in &speeds {
            let out = form.column(*speed).out;
            let effort = form.input(&mut model.pool, *speed);
            defined.push((out, along(&mut model.pool, effort, &impulses), *here));
            let rate = model.pool.symbol(&format!("rate of {}", model.pool.name(out)));
            rates.push((out, model.pool.var(rate)));
            defined.push((rate, effort, *here));
        }
        rates.sort_unstable_by_key(|r| r.0);
        for (i, (tie, here)) in ties.iter().enumerate() {
            let e = form.input(&mut model.pool, *tie);
            if *here {
                self.ties.push(e);
            }
            let e = by_states(model, e);
            let mut terms = Vec::new();
            for (s, rate) in &rates {
                let slope = model.pool.derivative(e, *s);
                if !model.pool.is_zero(slope) {
                    terms.push(model.pool.mul(slope, *rate));
                }
            }
            defined.push((form.column(*tie).out, model.pool.sum(&terms), *here));
            if let Some((_, impulse, _)) = impulses.get(i) {
                defined.push((*impulse, model.pool.substitute(e, &ends), *here));
            }
        }
        for (s, residual, here) in defined {
            let unknown = model.pool.var(s);
            self.columns.push((s, model.pool.sub(unknown, residual)));
            self.still.push(!here);
        }
    }

    /// Values of the definitions whose symbols all have values, until none is left that can be had so.
    fn settle(&mut self, pool: &Pool) {
        let defined: FxHashMap<Symbol, usize> = self.columns.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
        let mut waits: Vec<usize> = Vec::with_capacity(self.columns.len());
        let mut users: Vec<Vec<usize>> = vec![Vec::new(); self.columns.len()];
        for (i, (_, e)) in self.columns.iter().enumerate() {
            let needs: Vec<usize> = pool.symbols(*e).iter().filter_map(|s| defined.get(s).copied()).collect();
            waits.push(needs.len());
            for j in needs {
                users[j].push(i);
            }
        }
        let mut ready: Vec<usize> = (0..self.columns.len()).filter(|i| waits[*i] == 0).collect();
        while let Some(i) = ready.pop() {
            self.order.push(i);
            let x = self.value(pool, self.columns[i].1);
            self.at.insert(self.columns[i].0, x);
            for &j in &users[i] {
                waits[j] -= 1;
                if waits[j] == 0 {
                    ready.push(j);
                }
            }
        }
        self.looped = (0..self.columns.len()).filter(|i| waits[*i] > 0).collect();
    }

    /// Solves the definitions that wait for each other: by Newton's method from next to nothing, or where that does not
    /// get there, as to a diode that a battery drives hard, by what drives them growing from nothing bit by bit.
    fn solve(&mut self, pool: &mut Pool) -> Result<(), &'static str> {
        let n = self.looped.len();
        self.loops = DMatrix::identity(n, n);
        if n == 0 {
            return Ok(());
        }
        let symbols: Vec<Symbol> = self.looped.iter().map(|i| self.columns[*i].0).collect();
        let laws: Vec<Expr> = self.looped.iter().map(|i| self.columns[*i].1).collect();
        let place: FxHashMap<Symbol, usize> = symbols.iter().enumerate().map(|(k, s)| (*s, k)).collect();
        let mut slopes: Vec<(usize, usize, Expr)> = Vec::new();
        for (k, law) in laws.iter().enumerate() {
            for s in pool.symbols(*law) {
                if let Some(&j) = place.get(&s) {
                    let slope = pool.derivative(*law, s);
                    let own = pool.int(i64::from(k == j));
                    slopes.push((k, j, pool.sub(own, slope)));
                }
            }
        }
        // Of a root z - (z - residual) only the residual is left, with all of its digits.
        let misfits: Vec<Expr> = symbols
            .iter()
            .zip(&laws)
            .map(|(s, law)| {
                let z = pool.var(*s);
                pool.sub(z, *law)
            })
            .collect();
        let given: FxHashSet<Symbol> = laws.iter().flat_map(|law| pool.symbols(*law)).collect();
        let given = given.into_iter().filter(|s| !place.contains_key(s));
        let given: Vec<(Symbol, f64)> = given.filter_map(|s| Some((s, *self.at.get(&s)?))).collect();
        let linear = slopes.iter().all(|(_, _, slope)| !pool.contains_any(*slope, &|s| place.contains_key(&s)));
        let loops = Loops { symbols, misfits, slopes, linear };
        let mut z = DVector::from_element(n, 1e-9);
        let why = match self.newton(pool, &loops, z.clone()) {
            Ok(_) => return Ok(()),
            Err(why) => why,
        };
        let (mut done, mut part) = (0.0, 0.25);
        while done < 1.0 && part > LEAST {
            let goal = f64::min(done + part, 1.0);
            self.at.extend(given.iter().map(|(s, x)| (*s, goal * x)));
            match self.newton(pool, &loops, z.clone()) {
                Ok(found) => (z, done, part) = (found, goal, 2.0 * part),
                Err(_) => part *= 0.25,
            }
        }
        self.at.extend(given);
        if done < 1.0 { Err(why) } else { Ok(()) }
    }

    /// Newton's step. An unknown on a flat piece of its law, as dry friction at rest, moves on by 1 until the law has a
    /// slope.
    fn step(&self, residual: &DVector<f64>) -> Option<DVector<f64>> {
        let (mut slopes, mut residual) = (self.loops.clone(), DMatrix::from_columns(std::slice::from_ref(residual)));
        for k in 0..residual.nrows() {
            if residual[k] != 0.0 && slopes.row(k).iter().all(|d| *d == 0.0) {
                slopes[(k, k)] = 1.0;
                residual[k] = residual[k].signum();
            }
        }
        Some(self.solve_loops(&slopes, &residual)?.column(0).into_owned())
    }

    /// Solves the linear equations of the loops: slopes times the unknowns are the right side. Constraints that say the
    /// same make the slopes singular. Their pivots are damped then, as in steps, and what that leaves of the right side
    /// is solved for in turn: what the constraints carry together has all of its digits.
    pub(crate) fn solve_loops(&self, slopes: &DMatrix<f64>, right: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let (symbols, part) = &self.shared;
        let is_shared = |k: &usize| symbols.contains(&self.columns[self.looped[*k]].0);
        let shared: Vec<usize> = (0..self.looped.len()).filter(is_shared).collect();
        if shared.is_empty() {
            return slopes.clone().lu().solve(right);
        }
        let mut damped = slopes.clone();
        shared.iter().for_each(|k| damped[(*k, *k)] *= 1.0 + part);
        let damped = damped.lu();
        let mut found = damped.solve(right)?;
        for _ in 0..REFINEMENTS {
            found += damped.solve(&(right - slopes * &found))?;
        }
        Some(found)
    }

    /// Newton's method for the definitions from some values; updates that make them fit worse are halved.
    fn newton(&mut self, pool: &Pool, loops: &Loops, mut z: DVector<f64>) -> Result<DVector<f64>, &'static str> {
        let n = z.len();
        let mut residual = self.misfit(pool, loops, &z);
        for _ in 0..ITERATIONS {
            self.loops = DMatrix::identity(n, n);
            for (i, j, d) in &loops.slopes {
                self.loops[(*i, *j)] = self.value(pool, *d);
            }
            let at = |s: Symbol| self.at.get(&s).copied().unwrap_or(0.0);
            let mut all = loops.misfits.iter().zip(residual.iter());
            if !loops.linear && all.all(|(e, r)| pool.is_rounding(*e, *r, &at)) {
                return Ok(z);
            }
            if loops.linear {
                // At once, and what rounding leaves of it: which is all there is where what drives the loop balances.
                for _ in 0..2 {
                    z -= self.step(&residual).ok_or(SINGULAR)?;
                    residual = self.misfit(pool, loops, &z);
                }
                return Ok(z);
            }
            let mut step = self.step(&residual).ok_or(SINGULAR)?;
            let whole = step.amax();
            let mut next = self.misfit(pool, loops, &(&z - &step));
            for _ in 0..HALVINGS {
                if next.norm() <= residual.norm() || step.amax() <= 1e-14 * z.amax() {
                    break;
                }
                step *= 0.5;
                next = self.misfit(pool, loops, &(&z - &step));
            }
            z -= &step;
            residual = next;
            if step.amax() <= 1e-14 * z.amax() {
                // What was halved to nothing is at rounding, or stuck.
                let found = whole <= 1e-9 * z.amax() && residual.norm() <= 1e-6 * z.norm();
                return if found { Ok(z) } else { Err(OPEN) };
            }
        }
        Err(OPEN)
    }

    /// Takes values for the looped outputs, and gives by how much each is off its definition.
    fn misfit(&mut self, pool: &Pool, loops: &Loops, z: &DVector<f64>) -> DVector<f64> {
        self.at.extend(loops.symbols.iter().copied().zip(z.iter().copied()));
        DVector::from_iterator(z.len(), loops.misfits.iter().map(|e| self.value(pool, *e)))
    }
}

/// The sampled region, by index, that each integral is a sum over the steps of: the one whose variables are all that it
/// reads.
fn sampled_integrals(model: &Model, form: &Form) -> Vec<Option<usize>> {
    // Signal states are in no region.
    let mut owner: FxHashMap<Symbol, Option<usize>> = model.memories.iter().map(|m| (m.symbol, None)).collect();
    for (i, r) in form.regions.iter().enumerate() {
        owner.extend(r.states.iter().map(|s| (s.symbol, Some(i))));
    }
    owner.extend(form.columns.iter().map(|c| (c.out, Some(c.region.at()))));
    owner.extend(form.loops.iter().map(|l| (l.unknown, Some(l.region.at()))));
    let flows = |s: &Symbol| matches!(model.signals.get(s), Some(Signal::Time | Signal::Input(_) | Signal::Slope(_)));
    let mut homes = Vec::with_capacity(form.integrals.len());
    for (integral, e) in model.integrals.iter().zip(&form.integrals) {
        let symbols = model.pool.symbols(*e);
        let mut read: Vec<Option<usize>> = symbols.iter().filter_map(|s| owner.get(s).copied()).collect();
        read.dedup();
        let one = read.first().copied().flatten();
        let one = one.filter(|i| form.regions[*i].sampling.is_some() && read.iter().all(|r| *r == Some(*i)));
        let home = one.filter(|_| !symbols.iter().any(flows));
        owner.insert(integral.symbol, home);
        homes.push(home);
    }
    homes
}

/// What samples hold for the continuous parts by signals, name and symbol: the sampled signal states, then what else
/// these parts read of sampled regions.
fn held(model: &Model, form: &Form, homes: &[Option<usize>]) -> Vec<(String, Symbol)> {
    let is_sampled = |region: usize| form.regions[region].sampling.is_some();
    let mut read: Vec<Expr> = Vec::new();
    for c in form.columns.iter().filter(|c| !is_sampled(c.region.at())) {
        read.extend(c.row.iter().map(|t| t.1));
        if let Role::Source(v) = c.role {
            read.push(v);
        }
    }
    for r in form.regions.iter().filter(|r| r.sampling.is_none()) {
        read.extend(r.resistors.iter().flat_map(|(_, how)| how.expressions()));
        read.extend(r.groups.iter().flat_map(|g| g.coenergy.iter().copied()));
        read.extend(r.following.iter().map(|f| f.rate));
    }
    read.extend(form.loops.iter().filter(|l| !is_sampled(l.region.at())).map(|l| l.value));
    read.extend(model.memories.iter().zip(&form.memories).filter(|(m, _)| m.sampling.is_none()).map(|(_, law)| *law));
    read.extend(form.integrals.iter().zip(homes).filter(|(_, home)| home.is_none()).map(|(rate, _)| *rate));
    let read: FxHashSet<Symbol> = read.into_iter().flat_map(|e| model.pool.symbols(e)).collect();
    let sampled = form.regions.iter().filter(|r| r.sampling.is_some());
    let mut others: Vec<Symbol> = sampled.flat_map(|r| r.states.iter().map(|s| s.symbol)).collect();
    others.extend(form.columns.iter().filter(|c| is_sampled(c.region.at())).map(|c| c.out));
    others.extend(form.loops.iter().filter(|l| is_sampled(l.region.at())).map(|l| l.unknown));
    others.extend(model.integrals.iter().zip(homes).filter(|(_, home)| home.is_some()).map(|(i, _)| i.symbol));
    let states = model.memories.iter().filter(|m| m.sampling.is_some()).map(|m| (m.name.clone(), m.symbol));
    let others = others.into_iter().filter(|s| read.contains(s)).map(|s| (model.pool.name(s).to_string(), s));
    states.chain(others).collect()
}

/// Definitions that wait for each other: what they define, by how much that is off, and the slopes of those by what
/// they define.
struct Loops {
    symbols: Vec<Symbol>,
    misfits: Vec<Expr>,
    slopes: Vec<(usize, usize, Expr)>,
    /// Whether the slopes are the same everywhere.
    linear: bool,
}

/// How fast each state of the continuous regions changes, in SI units a second: dx/dt of the energy and signal states
/// by name, then of the integrals `integral[0]` and so on. A state that is not given is at its start.
///
/// # Errors
/// In words, where loops of resistors cannot be solved at that state.
pub fn rates(
    stages: &mut Stages,
    time: f64,
    states: &dyn Fn(&str) -> Option<f64>,
) -> Result<Vec<(String, f64)>, String> {
    let point = Point::new(stages, time, states)?;
    let pool = &stages.model.pool;
    Ok(point.states.iter().map(|(name, _, rate)| (name.clone(), point.value(pool, *rate))).collect())
}

/// The energy H of each continuous region, J: its name and the sum over its storages, at a time and at values of the
/// states as for [`rates`].
///
/// # Errors
/// In words, where loops of resistors cannot be solved at that state.
pub fn energies(
    stages: &mut Stages,
    time: f64,
    states: &dyn Fn(&str) -> Option<f64>,
) -> Result<Vec<(String, f64)>, String> {
    let point = Point::new(stages, time, states)?;
    let energy = |g: &Group| point.value(&stages.model.pool, g.energy);
    let regions = stages.form.regions.iter().filter(|r| r.sampling.is_none());
    Ok(regions.map(|r| (r.name.clone(), r.groups.iter().map(energy).sum())).collect())
}

/// What has no finite value at a time and at values of the states as for [`rates`], though all that it reads has one:
/// a law, an energy or a rate of the continuous regions, in words, with the mend where there is one. Loops are not
/// looked into.
pub fn undefined(stages: &mut Stages, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Option<String> {
    let point = Point::settled(stages, time, states);
    let (model, pool) = (&stages.model, &stages.model.pool);
    let laws = point.order.iter().map(|i| (pool.name(point.columns[*i].0), point.columns[*i].1));
    let regions = stages.form.regions.iter().filter(|r| r.sampling.is_none());
    // What follows a source has no state.
    let name = |r: &'_ Region, g: &Group| g.states.first().map_or(r.name.clone(), |s| r.states[*s].name.clone());
    let energies: Vec<(String, Expr)> = regions.flat_map(|r| r.groups.iter().map(|g| (name(r, g), g.energy))).collect();
    let energies = energies.iter().map(|(name, energy)| (name.as_str(), *energy));
    let rates = point.states.iter().map(|(name, _, rate)| (name.as_str(), *rate));
    let is_told = |e: Expr| pool.symbols(e).iter().all(|s| point.at.contains_key(s));
    let (name, e) = laws
        .map(|law| ("", law))
        .chain(energies.map(|energy| ("the energy of ", energy)))
        .chain(rates.map(|rate| ("the rate of ", rate)))
        .find(|(_, (_, e))| is_told(*e) && !point.value(pool, *e).is_finite())
        .map(|(what, (name, e))| (format!("{what}`{name}`"), point.break_of(pool, e)))?;
    let of = |e: Expr| match (pool.print(e), told(point.value(pool, e))) {
        (text, x) if text.len() <= LONG => format!("`{text}`, which is {x}"),
        (_, x) => format!("what is {x}"),
    };
    let is = |what: String| format!("{name} has no finite value there: it takes {what}");
    if let Node::Unary(Unary::Log, a) = pool.node(e) {
        let what = is(format!("the logarithm of {}", of(*a)));
        return Some(format!("{what}; keep it above 0, by the start or as in `log(max(x, 1e-9))`"));
    }
    let Node::Product(_, pairs) = pool.node(e) else { return Some(is(of(e))) };
    if let Some((x, _)) = pairs.iter().find(|(x, n)| point.value(pool, *x) == 0.0 && n.to_f64() < 0.0) {
        return Some(match model.elements.iter().find(|e| matches!(e.law, Law::Ratio(r) if r == *x)) {
            Some(two_port) => format!(
                "the ratio of `{}` is 0 there, and {name} divides by it; a switch is a resistor, \
                 as in `R:sw = if ... then 1 mOhm else 1 MOhm`",
                two_port.name
            ),
            None => is(format!("something divided by {}", of(*x))),
        });
    }
    let below = pairs.iter().find(|(x, n)| point.value(pool, *x) < 0.0 && n.to_f64().fract() != 0.0);
    Some(match below {
        Some((x, _)) => {
            format!("{}; a root with both signs is `sign(x)*sqrt(abs(x))`", is(format!("a root of {}", of(*x))))
        }
        None => is(of(e)),
    })
}
