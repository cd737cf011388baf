//! Back onto the energy balance after an explicit step.
//!
//! An explicit step ends off the balance by its error. Its end is moved along a direction `d` until
//! `H(x+) - H(x) = supplied - dissipated` (projection: Hairer, Lubich, Wanner, *Geometric Numerical Integration*, 2nd
//! ed., IV.4). Which direction decides what else is kept. With e = dH/dx, u what sources and ports give, and what
//! storages and resistors receive from these alone,
//!
//! ```text
//! a_C = D_CC e + D_CI u,   a_R = D_RC e + D_RI u,   d = -D_CC W_C a_C - D_CR W_R a_R
//! ```
//!
//! lies in the image of the junction structure. So whatever the structure keeps constant (a momentum, a charge, the
//! difference of a spring and a counter of its flow) is kept as the Runge-Kutta method keeps it. What crosses sources
//! and ports meanwhile is moved along, by `-D_IC W_C a_C - D_IR W_R a_R`. So the slope of the residual is a sum of
//! squares, since D is skew: `a_C^T W_C a_C + a_R^T W_R a_R`. It is 0 only where nothing flows. W has the squares of
//! the largest outputs so far, so that all terms are squares of powers. Entropies move nothing. Storages that sources
//! alone move end where the method says; what crosses the sources, which is a quadrature too, is all that is put right
//! then, each by its power.
//!
//! Each block of storages that the structure joins has a balance of its own. What is left of it after the step is a
//! rounding, which is kept and counts in the next one, so that roundings do not add up. Sums of squares of states that
//! nothing changes (the angular momentum of a body that turns freely) are put back with it, along the states
//! themselves.

use crate::discretise::cluster::{Cluster, Group, missing};
use crate::discretise::equations::inputs::{Inputs, added};
use crate::discretise::equations::{accounts, angle_addition, ledger};
use crate::expression::{Expr, Lowering, Symbol};
use crate::graph::RegionId;
use crate::model::Model;
use crate::structure::{ColumnId, Form, square_casimirs};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// How often an end is moved: of a residual that is a thousandth, a millionth is left by the slope, and by the secants
/// then 1e-9 and 1e-15.
const MOVES: usize = 3;
/// A residual of so many roundings of what is stored and turned over is none.
const ROUNDINGS: f64 = 4.0;

/// Storages that the junction structure joins, directly or through resistors.
pub(crate) struct Block {
    pub(crate) region: RegionId,
    /// States and groups by their place in the cluster.
    states: Vec<usize>,
    groups: Vec<usize>,
    /// The columns by whose outputs storages are moved: storages and resistors that meet others, but for heat.
    movers: Vec<ColumnId>,
    /// Weights of states whose weighted squares sum to a constant.
    squares: Vec<Vec<(usize, f64)>>,
}

/// The blocks of a cluster.
pub(crate) struct Projection {
    pub(crate) blocks: Vec<Block>,
}

/// What a step supplies and dissipates in a region: the difference, and the sum of the magnitudes.
#[derive(Clone, Copy)]
pub(crate) struct Net {
    pub(crate) energy: Value,
    pub(crate) gross: Value,
}

/// The end of a step after the projection.
pub(crate) struct Projected {
    /// Each state, and what rounding took from it.
    pub(crate) states: Vec<(Value, Value)>,
    /// By how much each was moved, where it was.
    pub(crate) moved: Vec<Option<Value>>,
    /// The same of each integral.
    pub(crate) integrals: Vec<Option<Value>>,
    /// For each source or port that was moved along: the integral of what it receives, and its value.
    pub(crate) through: FxHashMap<ColumnId, (Value, Value)>,
    /// What H of each region changed by, and the sum of the magnitudes of what is stored.
    pub(crate) changes: FxHashMap<RegionId, (Value, Value)>,
    /// The largest effort so far of each state that is moved by what it receives.
    pub(crate) sizes: Vec<(usize, Value)>,
    /// What the next step reads.
    pub(crate) memory: Vec<Value>,
}

impl Projection {
    /// Finds the blocks of a cluster.
    ///
    /// # Errors
    /// Why the balance of one cannot be kept so, in words.
    pub(crate) fn of(c: &Cluster, model: &mut Model, form: &Form) -> Result<Self, String> {
        if !c.driving_sources.is_empty() {
            return Err("a storage follows a source".into());
        }
        if let Some(node) = c.nodes.iter().find(|n| n.has_branches()) {
            return Err(format!("`{}` has vertical and horizontal branches", model.pool.name(node.out)));
        }
        let own: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).collect();
        let strange =
            |e: Expr| model.pool.symbols(e).iter().any(|s| model.pool.value(*s).is_none() && !own.contains(s));
        if c.groups.iter().any(|g| strange(g.energy)) {
            return Err("an energy depends on more than its states".into());
        }
        let resistors: Vec<ColumnId> = c.nodes.iter().filter_map(|n| n.resistor()).collect();
        let storages: Vec<(usize, ColumnId)> =
            c.states.iter().enumerate().filter_map(|(i, s)| Some((i, s.column?))).collect();
        let mut joined = Joined::new(storages.iter().map(|s| s.1).chain(resistors.iter().copied()));
        for column in storages.iter().map(|s| s.1).chain(resistors.iter().copied()) {
            form.column(column).row.iter().for_each(|(other, _)| joined.join(column, *other));
        }
        let field = |c: ColumnId| model.element(form.column(c).element).field.map(|f| f.0);
        for (i, a) in resistors.iter().enumerate().filter(|(_, a)| field(**a).is_some()) {
            resistors[..i].iter().filter(|b| field(**b) == field(*a)).for_each(|b| joined.join(*a, *b));
        }
        for g in &c.groups {
            let columns: Vec<ColumnId> = g.states.iter().filter_map(|s| c.states[*s].column).collect();
            columns.windows(2).for_each(|pair| joined.join(pair[0], pair[1]));
        }
        let mut blocks: Vec<Block> = Vec::new();
        let mut place: FxHashMap<usize, usize> = FxHashMap::default();
        for (i, g) in c.groups.iter().enumerate() {
            let Some(column) = g.states.first().and_then(|s| c.states[*s].column) else { continue };
            let at = *place.entry(joined.root(column)).or_insert(blocks.len());
            if at == blocks.len() {
                let (states, groups, movers, squares) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
                blocks.push(Block { region: g.region, states, groups, movers, squares });
            }
            blocks[at].groups.push(i);
            blocks[at].states.extend(&g.states);
        }
        for block in &mut blocks {
            let is_heat = |column: ColumnId| accounts::is_thermal(model, form, column);
            let columns = block.states.iter().filter_map(|s| c.states[*s].column);
            let stored: Vec<ColumnId> = columns.filter(|c| !is_heat(*c)).collect();
            let meet = |with: &[ColumnId]| -> Vec<ColumnId> {
                let meets = |m: &ColumnId| stored.iter().any(|s| form.entry(*s, *m).is_some());
                with.iter().copied().filter(meets).collect()
            };
            let movers: Vec<ColumnId> = stored.iter().chain(&resistors).copied().filter(|c| !is_heat(*c)).collect();
            block.movers = meet(&movers);
            let meets_heat = || {
                resistors.iter().any(|r| {
                    block.states.iter().any(|s| c.states[*s].column.is_some_and(|s| form.entry(s, *r).is_some()))
                })
            };
            if block.movers.is_empty() && meets_heat() {
                let name = block.states.first().map_or("", |s| &c.states[*s].name);
                return Err(format!("nothing but heat moves `{name}`"));
            }
        }
        for r in &c.regions {
            squares(c, model, form, *r, &mut blocks);
        }
        Ok(Self { blocks })
    }

    /// Whether what a block is given is told from its own storages: its region has several, and it is not the first.
    pub(crate) fn is_apart(&self, block: usize) -> bool {
        self.first_of(block) != block
    }

    /// The first block of the region of a block.
    pub(crate) fn first_of(&self, block: usize) -> usize {
        let region = self.blocks[block].region;
        self.blocks.iter().position(|b| b.region == region).unwrap_or(block)
    }

    /// The power that the storages of each block apart take in.
    pub(crate) fn intakes(&self, c: &Cluster, model: &mut Model, form: &Form) -> Vec<Expr> {
        let apart: Vec<&Block> =
            (0..self.blocks.len()).filter(|i| self.is_apart(*i)).map(|i| &self.blocks[i]).collect();
        let power = |block: &Block| {
            let columns = block.states.iter().filter_map(|s| Some((c.states[*s].column?, c.states[*s].rate)));
            let terms: Vec<Expr> = columns
                .map(|(column, rate)| {
                    let effort = model.pool.var(form.column(column).out);
                    model.pool.mul(effort, rate)
                })
                .collect();
            model.pool.sum(&terms)
        };
        apart.into_iter().map(power).collect()
    }

    /// How many numbers are kept: of each block what is left of its balance, and the sizes of its movers.
    pub(crate) fn memory(&self) -> usize {
        self.blocks.iter().map(|b| 1 + b.movers.len()).sum()
    }

    /// Moves the end of a step onto the balance of each block. `last` is the last stage, at the end of the step;
    /// `changes` are those of the states by the method, and `nets` what each block is given.
    pub(crate) fn project(
        &self,
        c: &Cluster,
        (model, form): (&mut Model, &Form),
        b: &mut Builder,
        last: &mut Lowering,
        (inputs, changes): (&Inputs, &[Value]),
        nets: &[Net],
    ) -> Result<Projected, Vec<Diagnostic>> {
        let flat = c.flat_at_instant(&mut model.pool, form);
        let carries: Vec<Value> = inputs.carries.iter().map(|slot| b.load(*slot)).collect();
        let first = b.slots(Array::State, self.memory()).index as usize;
        let mut kept = (first..first + self.memory()).map(|i| Slot::new(Array::State, i));
        let mut found = Projected {
            states: Vec::new(),
            moved: vec![None; c.states.len()],
            integrals: vec![None; c.integrals.len()],
            through: FxHashMap::default(),
            changes: FxHashMap::default(),
            sizes: Vec::new(),
            memory: Vec::new(),
        };
        let step = Step { c, form, inputs, carries: &carries, changes };
        let mut start = step.at(model, b, None)?;
        found.states = (0..c.states.len()).map(|i| step.end(b, i, changes[i])).collect();
        let plain: Vec<Value> = found.states.iter().map(|x| x.0).collect();
        let mut end = step.at(model, b, Some(&plain))?;
        for (block, net) in self.blocks.iter().zip(nets) {
            let slots: Vec<Slot> = kept.by_ref().take(1 + block.movers.len()).collect();
            let left = b.load(slots[0]);
            let before = step.energy(block, model, b, (&mut start, &carries))?;
            let least = step.least_sizes(block, model, b, (&mut start, before))?;
            let direction = step.direction(block, model, b, (last, &flat), (&slots[1..], &least))?;
            let moves = step.moves(block, model, b, &direction, (&mut end, before, left, *net))?;
            let (change, size) = found.changes.get(&block.region).copied().unwrap_or((moves.change, moves.size));
            let of_region = match found.changes.contains_key(&block.region) {
                true => (b.add(change, moves.change), b.add(size, moves.size)),
                false => (change, size),
            };
            found.changes.insert(block.region, of_region);
            found.memory.push(moves.left);
            found.memory.extend(&direction.sizes);
            let movers = block.movers.iter().zip(&direction.sizes);
            let place = |m: &ColumnId| c.states.iter().position(|s| s.column == Some(*m));
            found.sizes.extend(movers.filter_map(|(m, size)| Some((place(m)?, *size))));
            for (i, end, by) in moves.states {
                (found.states[i], found.moved[i]) = (end, Some(by));
            }
            for (i, along) in &direction.integrals {
                let by = b.mul(moves.by, *along);
                let before = found.integrals[*i];
                found.integrals[*i] = Some(before.map_or(by, |x| b.add(x, by)));
            }
            for (column, along, value) in &direction.through {
                let by = b.mul(moves.by, *along);
                let before = found.through.get(column).map(|x| x.0);
                found.through.insert(*column, (before.map_or(by, |x| b.add(x, by)), *value));
            }
        }
        Ok(found)
    }
}

/// Finds sums of squares that nothing changes, and whose states are in one block.
fn squares(c: &Cluster, model: &Model, form: &Form, region: RegionId, blocks: &mut [Block]) {
    let states = &form.regions[region.at()].states;
    let place: FxHashMap<Symbol, usize> = c.states.iter().enumerate().map(|(i, s)| (s.symbol, i)).collect();
    let mut taken: FxHashSet<usize> = FxHashSet::default();
    for weights in square_casimirs(model, form, &form.regions[region.at()]) {
        let of = weights.iter().zip(states).filter(|(w, _)| **w > 0.0);
        let of: Vec<(usize, f64)> = of.filter_map(|(w, s)| Some((*place.get(&s.symbol)?, *w))).collect();
        let block = blocks.iter_mut().find(|b| of.iter().all(|(i, _)| b.states.contains(i)));
        // A single one does not move.
        let (true, Some(block)) = (of.len() > 1 && of.iter().all(|(i, _)| !taken.contains(i)), block) else { continue };
        taken.extend(of.iter().map(|x| x.0));
        block.squares.push(of);
    }
}

/// Which columns belong together.
struct Joined {
    place: FxHashMap<ColumnId, usize>,
    parent: Vec<usize>,
}

impl Joined {
    fn new(columns: impl Iterator<Item = ColumnId>) -> Self {
        let place: FxHashMap<ColumnId, usize> = columns.enumerate().map(|(i, c)| (c, i)).collect();
        Self { parent: (0..place.len()).collect(), place }
    }

    fn root_of(&self, mut i: usize) -> usize {
        while self.parent[i] != i {
            i = self.parent[i];
        }
        i
    }

    fn root(&self, column: ColumnId) -> usize {
        self.place.get(&column).map_or(usize::MAX, |i| self.root_of(*i))
    }

    /// Joins two; one that is neither a storage nor a resistor joins nothing.
    fn join(&mut self, a: ColumnId, b: ColumnId) {
        if let (Some(a), Some(b)) = (self.place.get(&a), self.place.get(&b)) {
            let (a, b) = (self.root_of(*a), self.root_of(*b));
            self.parent[a.max(b)] = a.min(b);
        }
    }
}

/// Where the end of a step may be moved to.
struct Direction {
    /// By state, integral, and source or port with its value: what each changes by along it.
    states: Vec<(usize, Value)>,
    integrals: Vec<(usize, Value)>,
    through: Vec<(ColumnId, Value, Value)>,
    /// The largest output of each mover so far.
    sizes: Vec<Value>,
}

/// How the end of a step was moved.
struct Moves {
    /// How far along the direction.
    by: Value,
    /// Where each state ends, with what rounding took from it, and by how much it was moved.
    states: Vec<(usize, (Value, Value), Value)>,
    /// What is left of the balance.
    left: Value,
    change: Value,
    size: Value,
}

/// A step to be projected.
struct Step<'a> {
    c: &'a Cluster,
    form: &'a Form,
    inputs: &'a Inputs,
    carries: &'a [Value],
    changes: &'a [Value],
}

impl Step<'_> {
    /// The end of a state that changes by so much, and what rounding takes from it.
    fn end(&self, b: &mut Builder, i: usize, change: Value) -> (Value, Value) {
        let (_, next, rest) = added(b, self.inputs.states[i], change, self.carries[i]);
        (next, rest)
    }

    /// Where energies are had at given states, or at the start of the step.
    fn at(&self, model: &mut Model, b: &mut Builder, states: Option<&[Value]>) -> Result<Lowering, Vec<Diagnostic>> {
        let mut at = Lowering::new(self.inputs.env.iter().copied());
        for (s, x) in self.c.states.iter().zip(states.unwrap_or(&self.inputs.states)) {
            at.bind(s.symbol, *x);
        }
        let symbols = self.c.states.iter().map(|s| s.symbol).collect();
        angle_addition::angles(model, b, &mut at, &self.c.energies(), &symbols)?;
        Ok(at)
    }

    fn groups<'b>(&'b self, block: &'b Block) -> impl Iterator<Item = &'b Group> + Clone {
        block.groups.iter().map(|g| &self.c.groups[*g])
    }

    /// H of a block at given states.
    fn energy(
        &self,
        block: &Block,
        model: &mut Model,
        b: &mut Builder,
        (at, rests): (&mut Lowering, &[Value]),
    ) -> Result<Value, Vec<Diagnostic>> {
        let terms: Vec<Expr> = self.groups(block).map(|g| self.c.energy_form(&mut model.pool, g).energy).collect();
        let energy = model.pool.sum(&terms);
        let v = at.lower(&model.pool, b, energy).map_err(|s| missing(model, s))?;
        ledger::with_rests(self.c, model, b, (at, rests), self.groups(block), v)
    }

    /// The square of the effort of each storage of a block that all its energy would give it, by how its own energy
    /// bends at the start, where that is told easily: a body at rest has no flow yet, and is to be moved all the same.
    fn least_sizes(
        &self,
        block: &Block,
        model: &mut Model,
        b: &mut Builder,
        (start, energy): (&mut Lowering, Value),
    ) -> Result<FxHashMap<ColumnId, Value>, Vec<Diagnostic>> {
        let energy = b.unary(Unary::Abs, energy);
        let twice = b.add(energy, energy);
        let own: FxHashSet<Symbol> = self.c.states.iter().map(|s| s.symbol).collect();
        let mut list = FxHashMap::default();
        for g in self.groups(block) {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                let state = &self.c.states[*s];
                let bends = model.pool.derivative(*z, state.symbol);
                let is_easy = g.states.len() == 1 || !model.pool.contains_any(bends, &|s| own.contains(&s));
                if let Some(column) = state.column.filter(|_| is_easy) {
                    let bends = start.lower(&model.pool, b, bends).map_err(|s| missing(model, s))?;
                    let bends = b.unary(Unary::Abs, bends);
                    list.insert(column, b.mul(twice, bends));
                }
            }
        }
        Ok(list)
    }

    /// Where a block may be moved to, by what holds at the last stage; `slots` are the sizes that were kept, `least`
    /// the squares of those that there are at least.
    fn direction(
        &self,
        block: &Block,
        model: &mut Model,
        b: &mut Builder,
        (last, flat): (&mut Lowering, &FxHashMap<Symbol, Expr>),
        (slots, least): (&[Slot], &FxHashMap<ColumnId, Value>),
    ) -> Result<Direction, Vec<Diagnostic>> {
        let Self { c, form, .. } = *self;
        let resistors: FxHashSet<ColumnId> = c.nodes.iter().filter_map(|n| n.resistor()).collect();
        let (mut sizes, mut moved) = (Vec::new(), FxHashMap::default());
        for (m, slot) in block.movers.iter().zip(slots) {
            let column = form.column(*m);
            let terms: Vec<Expr> = (column.row.iter().filter(|(j, _)| !resistors.contains(j)))
                .map(|(j, k)| {
                    let z = model.pool.var(form.column(*j).out);
                    model.pool.mul(*k, z)
                })
                .collect();
            let rate = model.pool.sum(&terms);
            let out = model.pool.var(column.out);
            let [rate, out] = [rate, out].map(|e| model.pool.substitute(e, flat));
            let rate = last.lower(&model.pool, b, rate).map_err(|s| missing(model, s))?;
            let out = last.lower(&model.pool, b, out).map_err(|s| missing(model, s))?;
            let (out, before) = (b.unary(Unary::Abs, out), b.load(*slot));
            let size = b.binary(Binary::Max, before, out);
            sizes.push(size);
            let mut square = b.mul(size, size);
            if let Some(least) = least.get(m) {
                square = b.binary(Binary::Max, square, *least);
            }
            let v = b.mul(square, rate);
            let name = format!("move({})", column.name);
            let symbol = model.pool.symbol(&name);
            last.bind(symbol, v);
            moved.insert(*m, symbol);
        }
        // What a row changes by.
        let mut along = |model: &mut Model,
                         b: &mut Builder,
                         terms: Vec<(ColumnId, Expr)>|
         -> Result<Option<Value>, Vec<Diagnostic>> {
            let terms: Vec<Expr> = (terms.into_iter())
                .filter_map(|(j, k)| {
                    let v = model.pool.var(*moved.get(&j)?);
                    Some(model.pool.mul(k, v))
                })
                .collect();
            if terms.is_empty() {
                return Ok(None);
            }
            let sum = model.pool.sum(&terms);
            let sum = model.pool.substitute(sum, flat);
            let v = last.lower(&model.pool, b, sum).map_err(|s| missing(model, s))?;
            Ok(Some(b.unary(Unary::Neg, v)))
        };
        let (mut states, mut integrals, mut through) = (Vec::new(), Vec::new(), Vec::new());
        for i in &block.states {
            let Some(column) = c.states[*i].column else { continue };
            let moves = along(model, b, form.column(column).row.clone())?;
            states.extend(moves.map(|v| (*i, v)));
        }
        for (i, integral) in c.integrals.iter().enumerate() {
            let outs: Vec<Symbol> = block.movers.iter().map(|m| form.column(*m).out).collect();
            let slopes = model.pool.derivatives(integral.rate, &outs);
            // Only what counts a flow or an effort goes along.
            let is_linear = |k: &Expr| !model.pool.is_zero(*k) && !model.pool.contains_any(*k, &|s| outs.contains(&s));
            let terms: Vec<(ColumnId, Expr)> =
                block.movers.iter().copied().zip(slopes).filter(|(_, k)| is_linear(k)).collect();
            let moves = along(model, b, terms)?;
            integrals.extend(moves.map(|v| (i, v)));
        }
        let given = c.nodes.iter().filter_map(|n| n.source()).chain(c.ports.iter().copied());
        let given: Vec<ColumnId> = given.filter(|i| form.column(*i).region == block.region).collect();
        let mut moves = Vec::new();
        for column in given.iter().filter(|_| !block.movers.is_empty()) {
            moves.extend(along(model, b, form.column(*column).row.clone())?.map(|v| (*column, v)));
        }
        let value = |model: &mut Model, b: &mut Builder, last: &mut Lowering, e: Expr| {
            let e = model.pool.substitute(e, flat);
            last.lower(&model.pool, b, e).map_err(|s| missing(model, s))
        };
        for (column, v) in moves {
            let out = model.pool.var(form.column(column).out);
            through.push((column, v, value(model, b, last, out)?));
        }
        let stored: FxHashSet<ColumnId> = block.states.iter().filter_map(|s| c.states[*s].column).collect();
        for column in given.into_iter().filter(|_| block.movers.is_empty()) {
            let row = form.column(column).row.iter().filter(|(j, _)| stored.contains(j));
            let terms: Vec<Expr> = row
                .map(|(j, k)| {
                    let z = model.pool.var(form.column(*j).out);
                    model.pool.mul(*k, z)
                })
                .collect();
            if terms.is_empty() {
                continue;
            }
            let (flow, out) = (model.pool.sum(&terms), model.pool.var(form.column(column).out));
            let (flow, out) = (value(model, b, last, flow)?, value(model, b, last, out)?);
            // The more power crosses, the more of it is put right; into or out of what is stored.
            let power = b.mul(flow, out);
            let sign = b.unary(Unary::Sign, power);
            let along = b.mul(sign, flow);
            through.push((column, along, out));
        }
        Ok(Direction { states, integrals, through, sizes })
    }

    /// Moves the end of a block until its balance closes. `end` is where the method ends; `before` is what the block
    /// stored, `left` what was left of its balance.
    fn moves(
        &self,
        block: &Block,
        model: &mut Model,
        b: &mut Builder,
        direction: &Direction,
        (end, before, left, net): (&mut Lowering, Value, Value, Net),
    ) -> Result<Moves, Vec<Diagnostic>> {
        let zero = b.number(0.0);
        let (mut by, mut back) = (zero, zero);
        // What crosses sources and ports for each unit along the direction, and the slope of the residual.
        let mut crossing = zero;
        for (_, along, value) in &direction.through {
            let power = b.mul(*along, *value);
            crossing = b.add(crossing, power);
        }
        let mut slope = crossing;
        let efforts: FxHashMap<usize, Expr> =
            self.groups(block).flat_map(|g| g.states.iter().copied().zip(g.coenergy.iter().copied())).collect();
        for (i, along) in &direction.states {
            let e = end.lower(&model.pool, b, efforts[i]).map_err(|s| missing(model, s))?;
            let power = b.mul(e, *along);
            slope = b.add(slope, power);
        }
        let squares: Vec<Value> = block.squares.iter().map(|s| self.square(b, s, &self.inputs.states)).collect();
        let mut stretched: FxHashMap<usize, Value> = FxHashMap::default();
        let (mut last, mut ends) = (None, FxHashMap::default());
        for k in 0..=MOVES {
            for i in &block.states {
                let change = self.changes[*i];
                let change = match (k, direction.states.iter().find(|d| d.0 == *i)) {
                    (0, _) | (_, None) => change,
                    (_, Some((_, along))) => {
                        let moved = b.mul(by, *along);
                        b.add(change, moved)
                    }
                };
                let change = stretched.get(i).map_or(change, |more| b.add(change, *more));
                ends.insert(*i, self.end(b, *i, change));
            }
            for (square, first) in block.squares.iter().zip(&squares) {
                self.stretch(b, (square, *first), &mut ends, &mut stretched);
            }
            let (mut states, mut rests) = (self.inputs.states.clone(), vec![zero; self.c.states.len()]);
            for (i, (x, rest)) in &ends {
                (states[*i], rests[*i]) = (*x, *rest);
            }
            let mut at = self.at(model, b, Some(&states))?;
            let energy = self.energy(block, model, b, (&mut at, &rests))?;
            let change = b.sub(energy, before);
            let crossed = b.mul(by, crossing);
            let off = b.sub(change, net.energy);
            let off = b.add(off, crossed);
            let off = b.add(off, left);
            let size = match last {
                None => {
                    let size = ledger::size(self.c, model, b, &mut at, self.groups(block), &FxHashMap::default())?;
                    b.add(size, net.gross)
                }
                Some((_, _, size)) => size,
            };
            if k < MOVES {
                let least = b.number(ROUNDINGS * f64::EPSILON);
                let least = b.mul(least, size);
                // After the first move by the secant, unless that is of roundings.
                if let Some((_, before, _)) = last {
                    let fallen = b.sub(before, off);
                    let secant = b.div(fallen, back);
                    let fallen = b.unary(Unary::Abs, fallen);
                    let [told, rises] = [(least, fallen), (zero, secant)].map(|(x, y)| b.binary(Binary::Lt, x, y));
                    let counts = b.mul(told, rises);
                    slope = b.select(counts, secant, slope);
                }
                let magnitude = b.unary(Unary::Abs, off);
                let counts = b.binary(Binary::Lt, least, magnitude);
                back = b.div(off, slope);
                back = b.select(counts, back, zero);
                by = b.sub(by, back);
            }
            last = Some((change, off, size));
        }
        let mut states = Vec::new();
        for i in &block.states {
            let along = direction.states.iter().find(|d| d.0 == *i).map(|d| b.mul(by, d.1));
            let moved = match (along, stretched.get(i)) {
                (Some(along), Some(more)) => b.add(along, *more),
                (Some(only), None) => only,
                (None, Some(only)) => *only,
                (None, None) => continue,
            };
            states.push((*i, ends[i], moved));
        }
        let (change, left, size) = last.unwrap_or((zero, zero, zero));
        Ok(Moves { by, states, left, change, size })
    }

    /// A weighted sum of squares.
    fn square(&self, b: &mut Builder, weights: &[(usize, f64)], states: &[Value]) -> Value {
        let mut sum = b.number(0.0);
        for (i, w) in weights {
            let (w, square) = (b.number(*w), b.mul(states[*i], states[*i]));
            let term = b.mul(w, square);
            sum = b.add(sum, term);
        }
        sum
    }

    /// Stretches states so that the sum of their squares is what it was.
    fn stretch(
        &self,
        b: &mut Builder,
        (weights, first): (&[(usize, f64)], Value),
        ends: &mut FxHashMap<usize, (Value, Value)>,
        stretched: &mut FxHashMap<usize, Value>,
    ) {
        let mut states = self.inputs.states.clone();
        weights.iter().for_each(|(i, _)| states[*i] = ends[i].0);
        let now = self.square(b, weights, &states);
        let (zero, two) = (b.number(0.0), b.number(2.0));
        let off = b.sub(first, now);
        let twice = b.mul(two, now);
        let part = b.div(off, twice);
        let (least, magnitude) = (b.number(ROUNDINGS * f64::EPSILON), b.unary(Unary::Abs, off));
        let least = b.mul(least, now);
        let counts = b.binary(Binary::Lt, least, magnitude);
        let part = b.select(counts, part, zero);
        for (i, _) in weights {
            let (x, rest) = ends[i];
            let more = b.mul(part, x);
            let (_, next, rest) = added(b, x, more, rest);
            ends.insert(*i, (next, rest));
            let before = stretched.get(i).copied();
            stretched.insert(*i, before.map_or(more, |s| b.add(s, more)));
        }
    }
}
