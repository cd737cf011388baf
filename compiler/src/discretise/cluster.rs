//! A cluster in the making: regions that step as one, and everything about them as expressions.

use super::choice::Accuracy;
use super::collocation::{self, Nodes};
use super::level::Level;
use super::near::Known;
use super::{
    Method, accounts, ahead, choice, exact, explicit, gonzalez, guard, hold, input_of, instant, is_time, jump, level,
    ray, sav, start, stored, swing, switching, unfit,
};
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{Hold, Model};
use crate::structure::{Bends, ColumnId, Form, Output, Role};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::Program;
use bond_runtime::scene::{self};
use rustc_hash::{FxHashMap, FxHashSet};
use std::cell::{OnceCell, RefCell};

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
    /// H as it is to be computed, once that was asked for.
    pub(super) level: OnceCell<Level>,
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
    /// The curve that it is iterated as, where its law has an exponential.
    pub(super) steep: Option<Output>,
    /// What it is iterated as within a loop, where it is linear and switched by a choice: what is open makes much of the
    /// rounding of a flow, so that what it bears is an unknown of its own, as over a resistor that holds tightly.
    pub(super) switched: Option<Output>,
    /// A resistor whose law is not linear.
    pub(super) curved: bool,
}

impl Node {
    /// One that is linear and iterated as it is.
    fn plain(part: Part, out: Symbol, how: Output) -> Self {
        Self { part, out, how, steep: None, switched: None, curved: false }
    }

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

    /// Whether it is a law that may stand upright or lie flat.
    pub(super) fn is_bare(&self) -> bool {
        matches!(self.how, Output::Curve { bends: None, .. })
    }

    /// What an iteration has to find, if this is in a loop.
    pub(super) fn unknown(&self) -> Symbol {
        self.how.unknown(self.out)
    }
}

/// An integral of a probe.
#[derive(Clone, Debug)]
pub(super) struct Integral {
    pub(super) symbol: Symbol,
    pub(super) rate: Expr,
    pub(super) start: f64,
}

/// How a stepper keeps the length of its last step, last of all that it keeps; 0 where there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recall {
    /// As it is.
    Length,
    /// One over it.
    Rate,
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
    /// Those of them that tight resistors give.
    pub(super) tight: Vec<Symbol>,
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
    /// The states whose changes a step by the discrete gradient foretells.
    pub(super) foretold: Vec<usize>,
    /// How many numbers the stepper keeps of its last step.
    pub(super) memory: usize,
    /// What those are at the start; 0 where it is not said.
    pub(super) kept: Vec<f64>,
    /// Whether an iteration starts by them alone, and from nothing where the last one is 0.
    pub(super) recalls: Option<Recall>,
    /// Whether each step's balance is looked at before it counts.
    pub(super) watched: bool,
    /// Whether steps are fitted to a tolerance.
    pub(super) fitted: bool,
    /// What is known of laws near rest.
    pub(super) near: RefCell<Known>,
}

impl Cluster {
    /// Takes a region in; `loops` are its loops through modulation.
    pub(super) fn add(&mut self, pool: &mut Pool, form: &Form, region: usize, loops: &[usize]) {
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
                level: OnceCell::new(),
                bounded: g.bounded,
            });
        }
        for &c in &r.inputs {
            match form.column(c).role {
                Role::Source(v) => {
                    let how = Output::Explicit(v);
                    self.nodes.push(Node::plain(Part::Source(c), form.column(c).out, how));
                }
                Role::Bar | Role::Open(_) => self.ports.push(c),
                Role::Storage | Role::Resistor | Role::Dependent => {}
            }
        }
        for (c, how) in &r.resistors {
            let steep = r.steep.get(c).copied();
            let out = form.column(*c).out;
            let gain = super::tight::gain(form, *c).filter(|k| pool.is_switched(*k));
            let switched = gain.filter(|_| matches!(how, Output::Explicit(_))).map(|k| {
                let (z, input) = (pool.var(out), form.input(pool, *c));
                let z = pool.div(z, k);
                Output::Implicit { residual: pool.sub(z, input), bends: None }
            });
            self.nodes.push(Node {
                part: Part::Resistor(*c),
                out,
                how: *how,
                steep,
                switched,
                curved: !r.gains.contains_key(c),
            });
        }
        for f in &r.following {
            let how = Output::Explicit(f.rate);
            let part = Part::Follower(f.state);
            self.nodes.push(Node::plain(part, form.column(f.column).out, how));
            self.followed.extend(f.sources.iter().copied());
        }
        for l in loops.iter().map(|l| &form.loops[*l]) {
            let how = Output::Explicit(l.value);
            self.nodes.push(Node {
                part: Part::Signal,
                out: l.unknown,
                how,
                steep: None,
                switched: None,
                curved: true,
            });
        }
    }

    pub(super) fn all_expressions(&self) -> Vec<Expr> {
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

    pub(super) fn find_foreign(&mut self, model: &mut Model, form: &Form) {
        let own: FxHashSet<Symbol> = self.owned(form).into_iter().collect();
        let mut all = self.all_expressions();
        let nodes = self.nodes.iter().filter_map(|n| n.source().or(n.resistor()));
        let columns: Vec<ColumnId> = nodes.chain(self.ports.iter().copied()).collect();
        for c in columns {
            all.push(form.input(&mut model.pool, c));
        }
        let mut foreign: Vec<Symbol> = Vec::new();
        let (mut known, mut given_by) = (FxHashSet::default(), FxHashSet::default());
        for e in all {
            for s in model.pool.symbols(e) {
                if let Some(i) = input_of(model, s) {
                    if given_by.insert(i) {
                        self.inputs.push((i, model.inputs[i].symbol, model.inputs[i].slope));
                    }
                } else if !own.contains(&s) && !is_time(model, s) && known.insert(s) {
                    foreign.push(s);
                }
            }
        }
        self.inputs.sort_unstable();
        self.foreign = foreign;
    }

    /// Expressions of all outputs in terms of states, ports, time, foreign signals and loops. `start` says what the
    /// states and the storages' outputs are; it may move time.
    pub(super) fn flat(&self, pool: &mut Pool, mut map: FxHashMap<Symbol, Expr>) -> FxHashMap<Symbol, Expr> {
        let loops: FxHashSet<Symbol> = self.loops.iter().copied().collect();
        for n in &self.nodes {
            if map.contains_key(&n.out) || (loops.contains(&n.out) && !matches!(n.how, Output::Curve { .. })) {
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
        let sources = self.leaders();
        for g in &self.groups {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                if let Some(c) = self.states[*s].column {
                    map.insert(form.column(c).out, pool.substitute(*z, &sources));
                }
            }
        }
        map
    }

    /// What the sources are that storages follow.
    pub(super) fn leaders(&self) -> FxHashMap<Symbol, Expr> {
        let followed: FxHashSet<ColumnId> = self.followed.iter().copied().collect();
        let given = |n: &Node| match (n.source(), n.how) {
            (Some(c), Output::Explicit(e)) if followed.contains(&c) => Some((n.out, e)),
            _ => None,
        };
        self.nodes.iter().filter_map(given).collect()
    }

    /// Whether a storage follows a source that moves.
    pub(super) fn is_led(&self, pool: &Pool) -> bool {
        let moves = |e: Expr| pool.contains_any(e, &|s| pool.value(s).is_none());
        self.nodes.iter().any(|n| match (n.part, n.how) {
            (Part::Source(c), Output::Explicit(e)) => self.followed.contains(&c) && moves(e),
            (Part::Source(_) | Part::Resistor(_) | Part::Follower(_) | Part::Signal, _) => false,
        })
    }

    /// Whether nothing takes energy out.
    pub(super) fn is_lossless(&self) -> bool {
        self.nodes.iter().all(|n| !matches!(n.part, Part::Resistor(_)))
    }

    /// The nodes that are solved for, in the order of the loops' unknowns.
    pub(super) fn loop_nodes(&self) -> Vec<&Node> {
        let by: FxHashMap<Symbol, &Node> = self.nodes.iter().map(|n| (n.unknown(), n)).collect();
        self.loops.iter().filter_map(|z| by.get(z).copied()).collect()
    }

    /// Whether laws that stand upright or lie flat may leave open how they share a load.
    pub(super) fn is_open(&self) -> bool {
        self.loop_nodes().iter().filter(|n| n.is_bare()).count() > 1
    }

    /// Unknowns that laws with exponentials have as their arguments, and where these grow: of such a law it is its own
    /// unknown or, where it is run backwards, what it gives.
    pub(super) fn bends(&self) -> Vec<(Symbol, Bends)> {
        let bent = |n: &&Node| match n.how {
            Output::Implicit { bends: Some(bends), .. } => Some((n.out, bends)),
            Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. } => None,
        };
        let backwards: Vec<_> = self.loop_nodes().iter().filter_map(bent).collect();
        self.arguments().into_iter().chain(backwards).collect()
    }

    /// Those of them that are their laws' own.
    pub(super) fn arguments(&self) -> Vec<(Symbol, Bends)> {
        let bent = |n: &&Node| match n.how {
            Output::Curve { parameter, bends: Some(bends), .. } => Some((parameter, bends)),
            Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. } => None,
        };
        self.loop_nodes().iter().filter_map(bent).collect()
    }

    /// Residuals of the loops, in order, in terms of outputs.
    pub(super) fn loop_residuals(&self, pool: &mut Pool) -> Vec<Expr> {
        self.loop_nodes()
            .into_iter()
            .map(|n| match n.how {
                Output::Implicit { residual: e, .. } | Output::Curve { residual: e, .. } => e,
                Output::Explicit(e) => {
                    let z = pool.var(n.out);
                    pool.sub(z, e)
                }
            })
            .collect()
    }

    /// The groups of a region, which stand together: regions are added in order.
    pub(super) fn groups_in(&self, region: RegionId) -> &[Group] {
        let first = self.groups.partition_point(|g| g.region.0 < region.0);
        let past = self.groups.partition_point(|g| g.region.0 <= region.0);
        &self.groups[first..past]
    }

    /// The energies of all groups and their derivatives.
    pub(super) fn energies(&self) -> Vec<Expr> {
        let mut all: Vec<Expr> =
            self.groups.iter().flat_map(|g| g.coenergy.iter().copied().chain([g.energy])).collect();
        all.sort_unstable();
        all
    }

    /// H of a region of the cluster.
    pub(super) fn energy(&self, pool: &mut Pool, region: RegionId) -> Expr {
        let groups = self.groups_in(region).iter();
        let terms: Vec<Expr> = groups.map(|g| self.level(pool, g).energy).collect();
        pool.sum(&terms)
    }

    /// H of a group without cancellation.
    pub(super) fn level<'g>(&self, pool: &mut Pool, g: &'g Group) -> &'g Level {
        g.level.get_or_init(|| match (&g.states[..], &g.coenergy[..]) {
            ([only], [law]) => {
                let known = &mut self.near.borrow_mut();
                Level::of(pool, known, self.states[*only].symbol, g.energy, *law)
            }
            _ => {
                let states: Vec<Symbol> = g.states.iter().map(|s| self.states[*s].symbol).collect();
                Level::of_several(pool, &mut self.near.borrow_mut(), &states, g.energy)
            }
        })
    }

    /// Slots of the state: energy states, integrals, what loops start from, what rounding took from the energy states,
    /// and what the stepper keeps of its last step.
    pub(super) fn slots(&self) -> usize {
        self.memory_at() + self.memory
    }

    /// The first slot of what the stepper keeps.
    pub(super) fn memory_at(&self) -> usize {
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
        (method, tolerance, accuracy): (Option<Method>, Option<f64>, Accuracy),
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
                let mut wanted = method.filter(|m| *m != Method::Ray);
                let (mut linear, mut why) = (None, "");
                if wanted.is_none() {
                    let found = exact::write(self, model, form)?;
                    if accuracy.is_fitted()
                        && found.as_ref().is_some_and(|e| e.strays)
                        && let Some((method, reason)) = choice::driven(self)
                    {
                        (wanted, why) = (Some(method), reason);
                    } else if accuracy == Accuracy::Uncut
                        && found.is_some()
                        && self.guards(model, form, Method::Exact.name(), accuracy)?.is_some()
                    {
                        (wanted, why) = (Some(Method::Gonzalez), switching::UNCUT);
                    } else {
                        linear = found.map(|e| e.step);
                        why = "it is linear";
                    }
                }
                if wanted.is_none() && linear.is_none() {
                    let (method, reason) = choice::nonlinear(self, model, form, (accuracy, tolerance));
                    (wanted, why) = (Some(method), reason);
                }
                let (mut step, entries) = match wanted {
                    None => match linear {
                        Some(found) => found,
                        None => self.gonzalez(model, form)?,
                    },
                    Some(Method::Exact) => exact::write(self, model, form)?.map(|e| e.step).ok_or_else(|| {
                        let why = match self.is_led(&model.pool) {
                            true => "one of its storages follows a moving source",
                            false => "it is not linear with a quadratic energy, or too large",
                        };
                        unfit(model, self, form, Method::Exact, why)
                    })?,
                    Some(Method::Gonzalez) => self.gonzalez(model, form)?,
                    Some(Method::Euler) => explicit::write(self, model, form, &explicit::EULER)?,
                    Some(Method::SymplecticEuler) => explicit::write(self, model, form, &explicit::SYMPLECTIC)?,
                    Some(Method::Rk4) => explicit::write(self, model, form, &explicit::RK4)?,
                    Some(Method::Rk45) => explicit::write(self, model, form, &explicit::RK45)?,
                    Some(Method::Dop853) => explicit::write(self, model, form, &explicit::DOP853)?,
                    Some(Method::Ray) => self.gonzalez(model, form)?,
                    Some(Method::Collocation4) => {
                        self.collocation(model, form, Method::Collocation4, Nodes::Gauss(2))?
                    }
                    Some(Method::Collocation6) => {
                        self.collocation(model, form, Method::Collocation6, Nodes::Gauss(3))?
                    }
                    Some(Method::Collocation8) => {
                        self.collocation(model, form, Method::Collocation8, Nodes::Gauss(4))?
                    }
                    Some(Method::Collocation10) => {
                        self.collocation(model, form, Method::Collocation10, Nodes::Gauss(5))?
                    }
                    Some(Method::Collocation12) => {
                        self.collocation(model, form, Method::Collocation12, Nodes::Gauss(6))?
                    }
                    Some(Method::Radau) => self.collocation(model, form, Method::Radau, Nodes::Radau)?,
                    Some(Method::Sav) => sav::write(self, model, form)?,
                };
                step.why = why.into();
                let is_linear = step.linear.is_some();
                (step, entries, is_linear)
            }
            Some(_) if self.regions.is_empty() => (jump::write(self, model, form)?, Vec::new(), false),
            Some(_) => {
                let wanted = own.or(method.filter(|m| *m == Method::Ray));
                let (step, entries) = match wanted {
                    None | Some(Method::Gonzalez) => self.gonzalez(model, form)?,
                    Some(m @ Method::Ray) if !self.followed.is_empty() => {
                        return Err(unfit(
                            model,
                            self,
                            form,
                            m,
                            "one of its storages follows a source, for which the construction along a line is not \
                            defined",
                        ));
                    }
                    Some(Method::Ray) => ray::write(self, model, form)?,
                    Some(
                        m @ (Method::Exact
                        | Method::Collocation4
                        | Method::Collocation6
                        | Method::Collocation8
                        | Method::Collocation10
                        | Method::Collocation12
                        | Method::Radau
                        | Method::Sav
                        | Method::Euler
                        | Method::SymplecticEuler
                        | Method::Rk4
                        | Method::Rk45
                        | Method::Dop853),
                    ) => {
                        return Err(unfit(model, self, form, m, "a sampled region takes `gonzalez` or `ray`"));
                    }
                };
                (step, entries, false)
            }
        };
        let mut entries = entries;
        for e in &mut entries {
            let groups = self.groups_in(RegionId(e.region as u32)).iter().filter(|g| g.bounded);
            e.floor = groups.clone().map(|g| level::least(model, g, self)).sum();
            if sampling.is_some() {
                e.least = groups.map(|g| level::lowest(model, g, self)).sum();
            }
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
        let (instant, layout) = instant::write(self, model, form, shows, &step.name)?;
        let swing = match sampling {
            None => swing::shortest(self, model, &choice::laws(self), model.settings.end),
            Some(_) => None,
        };
        let guards = match sampling {
            None => self.guards(model, form, &step.name, accuracy)?,
            Some(_) => None,
        };
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
        // What a tight resistor gives at an instant says nothing of a step.
        let guesses = start::guesses(self, model, form)?;
        initial.extend(self.loops.iter().zip(guesses).map(|(z, x)| if self.tight.contains(z) { 0.0 } else { x }));
        initial.extend(self.states.iter().map(|_| 0.0));
        initial.extend((0..self.memory).map(|i| self.kept.get(i).copied().unwrap_or(0.0)));
        let mut names: Vec<String> = self.states.iter().map(|s| s.name.clone()).collect();
        names.extend(self.integrals.iter().map(|i| model.pool.name(i.symbol).to_string()));
        names.extend(self.loops.iter().map(|z| model.pool.name(*z).to_string()));
        names.extend(self.states.iter().map(|s| format!("carry({})", s.name)));
        names.extend((0..self.memory).map(|i| format!("of the last step({i})")));
        Ok(scene::Cluster {
            name: self.name(form),
            period: sampling.as_ref().map(|s| s.period),
            hold: hold.map_or("", Hold::name).into(),
            budget: sampling.as_ref().is_some_and(|s| s.budget),
            states: self.states.len(),
            integrals: self.integrals.len(),
            guesses: self.loops.len(),
            memory: self.memory,
            recall: self.recalls.filter(|_| self.memory > 0).map(|_| self.slots() - 1),
            initial,
            names,
            step,
            respond,
            instant,
            guards,
            has_exponentials: !self.arguments().is_empty(),
            has_corners: choice::has_corners(self),
            stored: stored::stored(self, model, form)?,
            energies: self.regions.iter().enumerate().map(|(i, r)| (r.at(), i)).collect(),
            curvatures: (0..self.states.len()).map(|i| self.regions.len() + i).collect(),
            heats: self.heats(model, form),
            grains: (0..self.states.len()).map(|i| self.regions.len() + self.states.len() + i).collect(),
            ports,
            holds,
            foreign,
            foreign_at: 2 + self.ports.len(),
            inputs: self.inputs.iter().map(|i| i.0).collect(),
            entries,
            is_linear,
            swing,
            jumps: self.jumps(model, form),
        })
    }

    /// Its states whose bonds are of temperature and entropy.
    fn heats(&self, model: &Model, form: &Form) -> Vec<usize> {
        let is_heat = |c: ColumnId| accounts::is_thermal(model, form, c);
        self.states.iter().enumerate().filter(|(_, s)| s.column.is_some_and(is_heat)).map(|(i, _)| i).collect()
    }

    /// Where its laws switch, and its step along a branch where that looks beyond them.
    fn guards(
        &self,
        model: &mut Model,
        form: &Form,
        stepper: &str,
        accuracy: Accuracy,
    ) -> Result<Option<scene::Guards>, Vec<Diagnostic>> {
        let found = guard::guards(self, model, form, accuracy == Accuracy::Uncut)?;
        let Some((mut guards, switches)) = found else { return Ok(None) };
        guards.ends = stepper == Method::Radau.name();
        guards.branch = explicit::branch(self, model, form, stepper, &switches)?;
        Ok(Some(guards))
    }

    /// The step by the discrete gradient.
    fn gonzalez(
        &mut self,
        model: &mut Model,
        form: &Form,
    ) -> Result<(scene::Stepper, Vec<scene::Entries>), Vec<Diagnostic>> {
        self.tighten(model, form);
        self.foretold = ahead::foretold(self, model, form);
        self.memory = ahead::memory(self.foretold.len());
        self.recalls = Some(Recall::Rate);
        gonzalez::write(self, model, form, true)
    }

    /// The step of a collocation method.
    fn collocation(
        &mut self,
        model: &mut Model,
        form: &Form,
        method: Method,
        nodes: Nodes,
    ) -> Result<(scene::Stepper, Vec<scene::Entries>), Vec<Diagnostic>> {
        let follows = !self.followed.is_empty();
        let led = nodes == Nodes::Radau && self.is_led(&model.pool);
        if led || (follows && !collocation::all_quadratic(self, &mut model.pool)) {
            let why = "one of its storages follows a moving source; the collocation methods of Gauss take that if \
            all energies are quadratic";
            return Err(unfit(model, self, form, method, why));
        }
        self.tighten(model, form);
        let apart = if follows { None } else { collocation::Apart::new(self, model, form, nodes) };
        // Linear equations are solved at once: from no guess, and by a quadrature that misses nothing.
        let linear = apart.as_ref().is_some_and(|a| a.is_linear());
        self.memory = if linear { 0 } else { collocation::memory(self, nodes) };
        self.recalls = Some(Recall::Length);
        self.watched = nodes != Nodes::Radau && !linear && !follows;
        collocation::write(self, model, form, (method.name(), nodes), apart.as_ref())
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
