//! A cluster in the making: regions that step as one, and everything about them as expressions.

use super::{Method, exact, explicit, gonzalez, hold, input_of, instant, is_time, jump, level, ray, start, unfit};
use crate::expression::{Expr, Pool, Sign, Symbol};
use crate::graph::RegionId;
use crate::model::{Hold, Model, Signal};
use crate::structure::{ColumnId, Form, Output, Role};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Builder, Program};
use bond_runtime::scene::{self, Entries};
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use rustc_hash::{FxHashMap, FxHashSet};

/// Loops of more nodes are not torn.
const TORN: usize = 32;

/// A state: that of a storage, or a signal state.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) symbol: Symbol,
    pub(super) name: String,
    /// The storage's; a signal state has none.
    pub(super) column: Option<ColumnId>,
    pub(super) initial: f64,
    /// dx/dt in terms of outputs; of a state that jumps, what it is after the step.
    pub(super) rate: Expr,
    /// A signal state of a sampled block.
    pub(super) jumps: bool,
}

/// Storages with one energy; states by their place in the cluster.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) region: RegionId,
    pub(super) states: Vec<usize>,
    pub(super) energy: Expr,
    pub(super) coenergy: Vec<Expr>,
    /// Whether it was seen to have a lower bound.
    pub(super) bounded: bool,
}

/// What an output is of.
#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    /// A source.
    Source(ColumnId),
    /// A resistor.
    Resistor(ColumnId),
    /// A storage that follows sources, and its state.
    Follower(Expr),
    /// A signal that a ratio depends on and sets itself.
    Signal,
}

/// An output that is computed.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) part: Part,
    pub(super) out: Symbol,
    pub(super) how: Output,
    /// How it is rather had in a loop.
    pub(super) steep: Option<Output>,
    /// A resistor whose law is not linear.
    pub(super) curved: bool,
}

impl Node {
    /// The column of a source.
    pub(super) fn source(&self) -> Option<ColumnId> {
        match self.part {
            Part::Source(c) => Some(c),
            Part::Resistor(_) | Part::Follower(_) | Part::Signal => None,
        }
    }

    /// The column of a resistor.
    pub(super) fn resistor(&self) -> Option<ColumnId> {
        match self.part {
            Part::Resistor(c) => Some(c),
            Part::Source(_) | Part::Follower(_) | Part::Signal => None,
        }
    }

    /// What an iteration has to find, if this is in a loop.
    pub(super) fn unknown(&self) -> Symbol {
        self.how.unknown(self.out)
    }
}

/// The columns of a region's entries in the ledger. A field is one entry, of all its ports.
pub(super) struct Accounts {
    /// Sources and ports.
    pub(super) supplied: Vec<ColumnId>,
    /// Resistors.
    pub(super) dissipated: Vec<Vec<ColumnId>>,
    /// The thermal ports of fields, whose entropy is counted.
    pub(super) produced: Vec<Vec<ColumnId>>,
}

/// An integral of a probe.
#[derive(Clone, Debug)]
pub(super) struct Integral {
    pub(super) symbol: Symbol,
    pub(super) rate: Expr,
    pub(super) start: f64,
}

/// Regions that step as one.
#[derive(Clone, Debug, Default)]
pub(super) struct Cluster {
    pub(super) regions: Vec<RegionId>,
    pub(super) sampling: Option<usize>,
    pub(super) states: Vec<State>,
    pub(super) groups: Vec<Group>,
    pub(super) integrals: Vec<Integral>,
    /// Sources and resistors, those first on which others depend.
    pub(super) nodes: Vec<Node>,
    /// Outputs that an iteration has to find, in order.
    pub(super) loops: Vec<Symbol>,
    /// Sources that storages follow.
    pub(super) followed: Vec<ColumnId>,
    /// Double bars and open ports.
    pub(super) ports: Vec<ColumnId>,
    /// Signals of other clusters.
    pub(super) foreign: Vec<Symbol>,
    /// Inputs that it reads, by number: value and slope.
    pub(super) inputs: Vec<(usize, Symbol, Symbol)>,
    pub(super) time: Option<Symbol>,
    pub(super) h: Option<Symbol>,
    /// Change of each state over a step.
    pub(super) delta: Vec<Symbol>,
}

/// What is never torn apart: a region, a signal state of continuous time, or all signal states of a sampled block.
#[derive(Default)]
struct Atom {
    sampling: Option<usize>,
    region: Option<usize>,
    memories: Vec<usize>,
    integrals: Vec<usize>,
}

/// The atoms: regions first, then signal states.
fn atoms(model: &Model, form: &Form) -> Vec<Atom> {
    let regions = form.regions.iter().enumerate();
    let mut atoms: Vec<Atom> =
        regions.map(|(i, r)| Atom { sampling: r.sampling, region: Some(i), ..Atom::default() }).collect();
    for (i, m) in model.memories.iter().enumerate() {
        let block = |a: &&mut Atom| a.region.is_none() && a.sampling.is_some() && a.sampling == m.sampling;
        match atoms.iter_mut().find(block) {
            Some(atom) => atom.memories.push(i),
            None => atoms.push(Atom { sampling: m.sampling, memories: vec![i], ..Atom::default() }),
        }
    }
    if atoms.is_empty() && !model.integrals.is_empty() {
        atoms.push(Atom::default());
    }
    atoms
}

/// All signals that an atom reads, integrals apart; `columns` are those of each region.
fn reads(pool: &Pool, form: &Form, columns: &[Vec<usize>], atom: &Atom) -> Vec<Symbol> {
    let mut read: Vec<Expr> = atom.memories.iter().map(|m| form.memories[*m]).collect();
    if let Some(i) = atom.region {
        for (_, how) in &form.regions[i].resistors {
            read.extend(how.expressions());
        }
        read.extend(form.loops.iter().filter(|l| l.region.at() == i).map(|l| l.value));
        for c in columns[i].iter().map(|c| &form.columns[*c]) {
            read.extend(c.row.iter().map(|t| t.1));
            if let Role::Source(v) = c.role {
                read.push(v);
            }
        }
    }
    read.into_iter().flat_map(|e| pool.symbols(e)).collect()
}

/// All clusters: sampled regions alone, continuous ones with those whose signals they read or that read theirs.
pub(super) fn gather(model: &mut Model, form: &Form) -> Vec<Cluster> {
    let mut atoms = atoms(model, form);
    let mut owner: FxHashMap<Symbol, usize> = FxHashMap::default();
    for (i, r) in form.regions.iter().enumerate() {
        owner.extend(r.states.iter().map(|s| (s.symbol, i)));
    }
    owner.extend(form.columns.iter().map(|c| (c.out, c.region.at())));
    owner.extend(form.loops.iter().map(|l| (l.unknown, l.region.at())));
    for (i, a) in atoms.iter().enumerate() {
        owner.extend(a.memories.iter().map(|m| (model.memories[*m].symbol, i)));
    }
    let mut pool = std::mem::take(&mut model.pool);
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); form.regions.len()];
    for (i, c) in form.columns.iter().enumerate() {
        columns[c.region.at()].push(i);
    }
    let read_by: Vec<Vec<Symbol>> = atoms.iter().map(|a| reads(&pool, form, &columns, a)).collect();
    // An integral belongs with what it reads.
    let mut homes: Vec<usize> = Vec::new();
    for (integral, e) in model.integrals.iter().zip(&form.integrals) {
        let continuous = |i: &usize| atoms[*i].sampling.is_none();
        let mut read: Vec<usize> = pool.symbols(*e).iter().filter_map(|s| owner.get(s).copied()).collect();
        read.sort_unstable();
        let home = read.iter().copied().find(continuous).or(read.first().copied());
        let home = home.or_else(|| (0..atoms.len()).find(continuous)).unwrap_or(0);
        owner.insert(integral.symbol, home);
        homes.push(home);
    }
    for (i, &home) in homes.iter().enumerate() {
        atoms[home].integrals.push(i);
    }
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(atoms.len());
    let mut solved: FxHashSet<Symbol> = FxHashSet::default();
    let of_integrals = homes.iter().zip(&form.integrals).map(|(home, e)| (*home, pool.symbols(*e)));
    for (i, read) in read_by.into_iter().enumerate().chain(of_integrals) {
        for s in read {
            let Some(&j) = owner.get(&s) else { continue };
            solved.insert(s);
            if atoms[i].sampling.is_none() && atoms[j].sampling.is_none() {
                sets.union(i, j);
            }
        }
    }
    let mut clusters: Vec<(usize, Cluster)> = Vec::new();
    for (i, atom) in atoms.iter().enumerate() {
        let root = sets.find(i);
        let at = match clusters.iter().position(|c| c.0 == root) {
            Some(at) => at,
            None => {
                clusters.push((root, Cluster { sampling: atom.sampling, ..Cluster::default() }));
                clusters.len() - 1
            }
        };
        let c = &mut clusters[at].1;
        if let Some(region) = atom.region {
            c.regions.push(RegionId(region as u32));
            c.add(&mut pool, form, region);
        }
    }
    for (i, atom) in atoms.iter().enumerate() {
        let root = sets.find(i);
        let Some((_, c)) = clusters.iter_mut().find(|c| c.0 == root) else { continue };
        for &m in &atom.memories {
            let (m, rate) = (&model.memories[m], form.memories[m]);
            let (symbol, name) = (m.symbol, m.name.clone());
            c.states.push(State { symbol, name, column: None, initial: m.start, rate, jumps: m.sampling.is_some() });
        }
        for &k in &atom.integrals {
            let (integral, rate) = (&model.integrals[k], form.integrals[k]);
            let (symbol, start) = (integral.symbol, integral.start);
            // One that something else reads is solved with it.
            if solved.contains(&symbol) {
                let name = pool.name(symbol).to_string();
                c.states.push(State { symbol, name, column: None, initial: start, rate, jumps: false });
            } else {
                c.integrals.push(Integral { symbol, rate, start });
            }
        }
    }
    let mut clusters: Vec<Cluster> = clusters.into_iter().map(|c| c.1).collect();
    let time = model.signals.iter().find(|(_, s)| **s == Signal::Time).map(|s| *s.0);
    for c in &mut clusters {
        c.time = Some(time.unwrap_or_else(|| pool.symbol("t")));
        c.h = Some(pool.symbol("h"));
        c.delta = c.states.iter().map(|s| pool.symbol(&format!("d({})", s.name))).collect();
        c.order(&pool);
    }
    model.pool = pool;
    for c in &mut clusters {
        c.find_foreign(model, form);
    }
    clusters
}

impl Cluster {
    fn add(&mut self, pool: &mut Pool, form: &Form, region: usize) {
        let r = &form.regions[region];
        let base = self.states.len();
        for s in &r.states {
            let rate = form.input(pool, s.column);
            self.states.push(State {
                symbol: s.symbol,
                name: s.name.clone(),
                column: Some(s.column),
                initial: s.initial,
                rate,
                jumps: false,
            });
        }
        for g in &r.groups {
            self.groups.push(Group {
                region: RegionId(region as u32),
                states: g.states.iter().map(|s| base + s).collect(),
                energy: g.energy,
                coenergy: g.coenergy.clone(),
                bounded: g.bounded,
            });
        }
        for &c in &r.inputs {
            match form.column(c).role {
                Role::Source(v) => {
                    let how = Output::Explicit(v);
                    self.nodes.push(Node {
                        part: Part::Source(c),
                        out: form.column(c).out,
                        how,
                        steep: None,
                        curved: false,
                    });
                }
                Role::Bar | Role::Open(_) => self.ports.push(c),
                Role::Storage | Role::Resistor | Role::Dependent => {}
            }
        }
        for (c, how) in &r.resistors {
            let steep = r.steep.get(c).copied();
            self.nodes.push(Node {
                part: Part::Resistor(*c),
                out: form.column(*c).out,
                how: *how,
                steep,
                curved: !r.gains.contains_key(c),
            });
        }
        for f in &r.following {
            let how = Output::Explicit(f.rate);
            let part = Part::Follower(f.state);
            self.nodes.push(Node { part, out: form.column(f.column).out, how, steep: None, curved: false });
            self.followed.extend(f.sources.iter().copied());
        }
        for l in form.loops.iter().filter(|l| l.region.at() == region) {
            let how = Output::Explicit(l.value);
            self.nodes.push(Node { part: Part::Signal, out: l.unknown, how, steep: None, curved: true });
        }
    }

    /// Sorts the nodes, and finds those that form loops.
    fn order(&mut self, pool: &Pool) {
        let places = self.nodes.iter().enumerate().flat_map(|(i, n)| [(n.out, i), (n.unknown(), i)]);
        let index: FxHashMap<Symbol, usize> = places.collect();
        let mut graph: Graph<(), ()> = Graph::new();
        for _ in &self.nodes {
            graph.add_node(());
        }
        let mut own = vec![false; self.nodes.len()];
        for (i, n) in self.nodes.iter().enumerate() {
            for s in n.how.expressions().flat_map(|e| pool.symbols(e)) {
                if let Some(&j) = index.get(&s) {
                    graph.add_edge(NodeIndex::new(i), NodeIndex::new(j), ());
                    own[i] |= i == j;
                }
            }
        }
        let mut order = Vec::new();
        let mut unknown = Vec::new();
        for component in petgraph::algo::kosaraju_scc(&graph) {
            let mut members: Vec<usize> = component.iter().map(|n| n.index()).collect();
            members.sort_unstable();
            let looped = members.len() > 1 || members.iter().any(|m| own[*m] || self.nodes[*m].how.is_root());
            if !looped {
                order.extend(members);
                continue;
            }
            for m in &members {
                let n = &mut self.nodes[*m];
                if let Some(steep) = n.steep.take().filter(|_| matches!(n.how, Output::Explicit(_))) {
                    n.how = steep;
                }
            }
            let (torn, rest) = self.tear(&graph, &members, &own);
            unknown.extend(torn.iter().copied());
            order.extend(torn.into_iter().chain(rest));
        }
        self.loops = unknown.iter().map(|i| self.nodes[*i].unknown()).collect();
        self.nodes = order.iter().map(|i| self.nodes[*i].clone()).collect();
    }

    /// Parts a loop into the nodes that an iteration finds and those that follow from them, in order. Small loops are torn at the
    /// laws that are roots anyhow, and at as few others as leave no loop; of large ones all are unknowns, which keeps the system
    /// sparse.
    fn tear(&self, graph: &Graph<(), ()>, members: &[usize], own: &[bool]) -> (Vec<usize>, Vec<usize>) {
        if members.len() > TORN {
            return (members.to_vec(), Vec::new());
        }
        let mut torn: Vec<usize> =
            members.iter().copied().filter(|m| self.nodes[*m].how.is_root() || own[*m]).collect();
        loop {
            let mut rest: Vec<usize> = members.iter().copied().filter(|m| !torn.contains(m)).collect();
            let mut done: Vec<usize> = Vec::new();
            loop {
                let ready = |m: &usize| {
                    graph.neighbors(NodeIndex::new(*m)).all(|j| !rest.contains(&j.index()) || done.contains(&j.index()))
                };
                let Some(at) = rest.iter().position(|m| !done.contains(m) && ready(m)) else { break };
                done.push(rest[at]);
            }
            rest.retain(|m| !done.contains(m));
            // A law that is not linear is the better place to cut.
            let curved = rest.iter().copied().find(|m| self.nodes[*m].curved);
            match curved.or(rest.first().copied()) {
                Some(cut) => torn.push(cut),
                None => {
                    torn.sort_unstable();
                    return (torn, done);
                }
            }
        }
    }

    fn all_expressions(&self) -> Vec<Expr> {
        let mut all: Vec<Expr> = self.states.iter().map(|s| s.rate).collect();
        for n in &self.nodes {
            all.extend(n.how.expressions());
        }
        all.extend(self.integrals.iter().map(|i| i.rate));
        all
    }

    /// Symbols that this cluster has values for.
    pub(super) fn owned(&self, form: &Form) -> Vec<Symbol> {
        let states =
            self.states.iter().flat_map(|s| std::iter::once(s.symbol).chain(s.column.map(|c| form.column(c).out)));
        let ports = self.ports.iter().map(|c| form.column(*c).out);
        states
            .chain(self.nodes.iter().flat_map(|n| [n.out, n.unknown()]))
            .chain(ports)
            .chain(self.integrals.iter().map(|i| i.symbol))
            .collect()
    }

    fn find_foreign(&mut self, model: &mut Model, form: &Form) {
        let own: FxHashSet<Symbol> = self.owned(form).into_iter().collect();
        let mut all = self.all_expressions();
        let nodes = self.nodes.iter().filter_map(|n| n.source().or(n.resistor()));
        let columns: Vec<ColumnId> = nodes.chain(self.ports.iter().copied()).collect();
        for c in columns {
            all.push(form.input(&mut model.pool, c));
        }
        let mut foreign: Vec<Symbol> = Vec::new();
        for e in all {
            for s in model.pool.symbols(e) {
                if let Some(i) = input_of(model, s) {
                    let given = (i, model.inputs[i].symbol, model.inputs[i].slope);
                    if !self.inputs.contains(&given) {
                        self.inputs.push(given);
                    }
                } else if !own.contains(&s) && !is_time(model, s) && !foreign.contains(&s) {
                    foreign.push(s);
                }
            }
        }
        self.inputs.sort_unstable();
        self.foreign = foreign;
    }

    /// Expressions of all outputs in terms of states, ports, time, foreign signals and loops. `start` says what the states and
    /// the storages' outputs are; it may move time.
    pub(super) fn flat(&self, pool: &mut Pool, mut map: FxHashMap<Symbol, Expr>) -> FxHashMap<Symbol, Expr> {
        for n in &self.nodes {
            if map.contains_key(&n.out) || (self.loops.contains(&n.out) && !matches!(n.how, Output::Curve { .. })) {
                continue;
            }
            if let Output::Explicit(e) | Output::Curve { out: e, .. } = n.how {
                let value = pool.substitute(e, &map);
                map.insert(n.out, value);
            }
        }
        map
    }

    /// The map for [`Self::flat`] at one instant: co-energies at the states.
    pub(super) fn at_instant(&self, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
        let mut map = FxHashMap::default();
        let mut sources: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for n in &self.nodes {
            if let (Some(c), Output::Explicit(e)) = (n.source(), n.how)
                && self.followed.contains(&c)
            {
                sources.insert(n.out, e);
            }
        }
        for g in &self.groups {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                if let Some(c) = self.states[*s].column {
                    map.insert(form.column(c).out, pool.substitute(*z, &sources));
                }
            }
        }
        map
    }

    /// Residuals of the loops, in order, in terms of outputs.
    pub(super) fn loop_residuals(&self, pool: &mut Pool) -> Vec<Expr> {
        self.loops
            .iter()
            .filter_map(|z| self.nodes.iter().find(|n| n.unknown() == *z))
            .map(|n| match n.how {
                Output::Implicit(e) | Output::Curve { residual: e, .. } => e,
                Output::Explicit(e) => {
                    let z = pool.var(n.out);
                    pool.sub(z, e)
                }
            })
            .collect()
    }

    /// H of a region of the cluster.
    pub(super) fn energy(&self, pool: &mut Pool, region: RegionId) -> Expr {
        let one = |g: &Group| match g.states[..] {
            [only] => Some(self.states[only].symbol),
            _ => None,
        };
        let groups = self.groups.iter().filter(|g| g.region == region);
        let terms: Vec<Expr> = groups.map(|g| level::energy(pool, one(g), g.energy)).collect();
        pool.sum(&terms)
    }

    /// Slots of the state: energy states, integrals, what loops start from, what rounding took from the energy states.
    pub(super) fn slots(&self) -> usize {
        self.carry_at() + self.states.len()
    }

    /// The first slot of what rounding took.
    pub(super) fn carry_at(&self) -> usize {
        self.states.len() + self.integrals.len() + self.loops.len()
    }

    /// The finished cluster.
    pub(super) fn build(
        &mut self,
        model: &mut Model,
        form: &Form,
        method: Option<Method>,
        shows: &[Symbol],
        foreign: Vec<(usize, usize)>,
    ) -> Result<scene::Cluster, Vec<Diagnostic>> {
        let sampling = self.sampling.map(|s| model.samplings[s].clone());
        let mut own = None;
        if let Some(name) = sampling.as_ref().and_then(|s| s.method.as_ref()) {
            own = Some(
                Method::named(name)
                    .ok_or_else(|| unknown_method(name, sampling.as_ref().map_or(model.span, |s| s.span)))?,
            );
        }
        let (step, entries, is_linear) = match &sampling {
            None => {
                let wanted = method.filter(|m| *m != Method::Ray);
                let (step, entries) = match wanted {
                    None => match exact::write(self, model, form)? {
                        Some(found) => found,
                        None => gonzalez::write(self, model, form)?,
                    },
                    Some(Method::Exact) => exact::write(self, model, form)?.ok_or_else(|| {
                        unfit(
                            model,
                            self,
                            form,
                            Method::Exact,
                            "it is not linear with a quadratic energy, or too large",
                        )
                    })?,
                    Some(Method::Gonzalez) => gonzalez::write(self, model, form)?,
                    Some(m @ (Method::Euler | Method::Rk4)) => explicit::write(self, model, form, m)?,
                    Some(Method::Ray) => gonzalez::write(self, model, form)?,
                };
                let is_linear = step.linear.is_some();
                (step, entries, is_linear)
            }
            Some(_) if self.regions.is_empty() => (jump::write(self, model, form)?, Vec::new(), false),
            Some(_) => {
                let wanted = own.or(method.filter(|m| *m == Method::Ray));
                let (step, entries) = match wanted {
                    None | Some(Method::Gonzalez) => gonzalez::write(self, model, form)?,
                    Some(Method::Ray) => ray::write(self, model, form)?,
                    Some(m @ (Method::Exact | Method::Euler | Method::Rk4)) => {
                        return Err(unfit(model, self, form, m, "a sampled region takes `gonzalez` or `ray`"));
                    }
                };
                (step, entries, false)
            }
        };
        let mut entries = entries;
        for e in &mut entries {
            let groups: Vec<Group> =
                self.groups.iter().filter(|g| g.region.at() == e.region && g.bounded).cloned().collect();
            e.floor = groups.iter().map(|g| level::least(model, g, self)).sum();
        }
        let is_ray = step.name == "ray";
        let holds = hold::held_ports(self, form);
        let hold = match &sampling {
            Some(s) if is_ray && !s.hold_given => Some(Hold::Lagged),
            Some(s) => Some(s.hold),
            None => None,
        };
        let respond = match hold {
            Some(hold) => hold::write(self, model, form, hold, &holds, is_ray)?,
            None => None,
        };
        let (instant, layout) = instant::write(self, model, form, shows)?;
        let guards = if sampling.is_none() { instant::guards(self, model, form)? } else { None };
        let ports = self
            .ports
            .iter()
            .enumerate()
            .map(|(i, c)| scene::Port {
                name: form.column(*c).name.clone(),
                region: form.column(*c).region.at(),
                input: 2 + i,
                mean: i,
                instant: layout.ports + i,
            })
            .collect();
        let mut initial: Vec<f64> = self.states.iter().map(|s| s.initial).collect();
        initial.extend(self.integrals.iter().map(|i| i.start));
        initial.extend(start::guesses(self, model, form)?);
        initial.extend(self.states.iter().map(|_| 0.0));
        let mut names: Vec<String> = self.states.iter().map(|s| s.name.clone()).collect();
        names.extend(self.integrals.iter().map(|i| model.pool.name(i.symbol).to_string()));
        names.extend(self.loops.iter().map(|z| model.pool.name(*z).to_string()));
        names.extend(self.states.iter().map(|s| format!("carry({})", s.name)));
        Ok(scene::Cluster {
            name: self.name(form),
            period: sampling.as_ref().map(|s| s.period),
            hold: hold.map_or("", Hold::name),
            budget: sampling.as_ref().is_some_and(|s| s.budget),
            states: self.states.len(),
            integrals: self.integrals.len(),
            guesses: self.loops.len(),
            initial,
            names,
            step,
            respond,
            instant,
            guards,
            stored: instant::stored(self, model, form)?,
            energies: self.regions.iter().enumerate().map(|(i, r)| (r.at(), i)).collect(),
            curvatures: (0..self.states.len()).map(|i| self.regions.len() + i).collect(),
            ports,
            holds,
            foreign,
            foreign_at: 2 + self.ports.len(),
            inputs: self.inputs.iter().map(|i| i.0).collect(),
            entries,
            is_linear,
        })
    }

    /// Names of the ledger's entries, with the outputs reserved in a builder: means first, then for each region H, sources and
    /// ports, resistors.
    pub(super) fn reserve(&self, model: &Model, b: &mut Builder, form: &Form) -> Vec<Entries> {
        use bond_runtime::ir::Array;
        for c in &self.ports {
            b.named(Array::Output, format!("mean({})", form.column(*c).name));
        }
        let mut list = Vec::new();
        for r in &self.regions {
            let name = &form.regions[r.at()].name;
            let mut e = Entries { region: r.at(), ..Entries::default() };
            e.energy = b.named(Array::Output, format!("H({name})")).index as usize;
            let late = |g: &Group| self.time.is_some_and(|t| model.pool.contains(g.energy, t));
            if self.groups.iter().any(|g| g.region == *r && late(g)) {
                e.before = Some(b.named(Array::Output, format!("H({name}) before")).index as usize);
            }
            let signed = |g: &&Group| !model.pool.sign(g.energy, &|_| Sign::Unknown).is_nonnegative();
            e.size = match self.groups.iter().filter(|g| g.region == *r).find(signed) {
                Some(_) => b.named(Array::Output, format!("size({name})")).index as usize,
                None => e.energy,
            };
            let accounts = self.accounts(model, form, r.at());
            for c in accounts.supplied {
                let name = form.column(c).name.clone();
                let slot = b.named(Array::Output, format!("supplied({name})"));
                e.supplied.push((name, slot.index as usize));
            }
            let mut named = |what: &str, members: &[ColumnId]| {
                let first = members.first().map(|c| model.element(form.column(*c).element));
                let name = match first.and_then(|e| e.field) {
                    Some((f, _)) => model.fields[f].name.clone(),
                    None => first.map(|e| e.name.clone()).unwrap_or_default(),
                };
                let slot = b.named(Array::Output, format!("{what}({name})"));
                (name, slot.index as usize)
            };
            e.dissipated.extend(accounts.dissipated.iter().map(|m| named("dissipated", m)));
            e.produced.extend(accounts.produced.iter().map(|m| named("produced", m)));
            list.push(e);
        }
        list
    }

    /// The columns of a region's entries, in the order in which [`Self::reserve`] lists them.
    pub(super) fn accounts(&self, model: &Model, form: &Form, region: usize) -> Accounts {
        let here = |c: &ColumnId| form.column(*c).region.at() == region;
        let sources = self.nodes.iter().filter_map(Node::source);
        let mut supplied: Vec<ColumnId> = sources.chain(self.ports.iter().copied()).filter(here).collect();
        supplied.sort_unstable();
        let mut resistors: Vec<ColumnId> = self.nodes.iter().filter_map(Node::resistor).filter(here).collect();
        resistors.sort_unstable();
        let field = |c: ColumnId| model.element(form.column(c).element).field.map(|f| f.0);
        let mut dissipated: Vec<Vec<ColumnId>> = Vec::new();
        for c in resistors {
            // The ports of a field stand one after the other.
            match dissipated.last_mut().filter(|d| field(c).is_some() && field(d[0]) == field(c)) {
                Some(d) => d.push(c),
                None => dissipated.push(vec![c]),
            }
        }
        let thermal = |c: &&ColumnId| {
            use crate::units::Dimension as D;
            let c = form.column(**c);
            model.units[c.bond.at()] == (Some(D::KELVIN), Some(D::WATT.div(D::KELVIN)))
        };
        let of_field = dissipated.iter().filter(|d| field(d[0]).is_some());
        let produced =
            of_field.map(|d| d.iter().filter(thermal).copied().collect::<Vec<_>>()).filter(|d| !d.is_empty()).collect();
        Accounts { supplied, dissipated, produced }
    }

    /// Its name: that of its first region, else of its first state.
    pub(super) fn name(&self, form: &Form) -> String {
        let region = self.regions.first().map(|r| form.regions[r.at()].name.clone());
        region.or_else(|| self.states.first().map(|s| s.name.clone())).unwrap_or_default()
    }

    /// Name of the cluster's programs.
    pub(super) fn title(&self, form: &Form, what: &str) -> String {
        let names: Vec<&str> = self.regions.iter().take(3).map(|r| form.regions[r.at()].name.as_str()).collect();
        if names.is_empty() {
            return format!("{what} of {}", self.name(form));
        }
        format!("{what} of {}{}", names.join(", "), if self.regions.len() > 3 { ", ..." } else { "" })
    }
}

pub(super) fn unknown_method(name: &str, span: bond_grammar::source::Span) -> Vec<Diagnostic> {
    let known: Vec<&str> = Method::ALL.iter().map(|m| m.name()).collect();
    let e = Diagnostic::error("discretise::method", span, format!("unknown method `{name}`"));
    vec![match crate::elaborate::nearest(name, known.iter().copied()) {
        Some(n) => e.help(format!("did you mean `{n}`?")),
        None => e.help(format!("the methods are {}", known.join(", "))),
    }]
}

/// An expression that a program could not be written for: a symbol without value. That is a mistake of this crate's.
pub(super) fn missing(model: &Model, s: Symbol) -> Vec<Diagnostic> {
    vec![Diagnostic::error(
        "discretise::internal",
        model.span,
        format!("`{}` has no value in the step; please report this model", model.pool.name(s)),
    )]
}

/// Checks a program before it leaves.
pub(super) fn verified(model: &Model, program: Program) -> Result<Program, Vec<Diagnostic>> {
    match program.verify() {
        Ok(()) => Ok(program),
        Err(e) => Err(vec![Diagnostic::error(
            "discretise::internal",
            model.span,
            format!("the program `{}` is not sound: {e}; please report this model", program.name),
        )]),
    }
}
