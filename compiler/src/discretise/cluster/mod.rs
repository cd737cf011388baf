//! A cluster in the making: regions that step as one, and everything about them as expressions.

pub(crate) mod blt_sort;
pub(crate) mod energy_form;
pub(crate) mod maclaurin;
pub(crate) mod partition;

use crate::discretise::delays::Coefficients;
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{Model, Signal};
use crate::structure::{Bends, ColumnId, Form, Output, Role};
use crate::thresholds::Thresholds;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::Program;
use energy_form::EnergyForm;
use maclaurin::Expansions;
use rustc_hash::{FxHashMap, FxHashSet};
use std::cell::{OnceCell, RefCell};

/// A state: that of a storage, or a signal state.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub(crate) symbol: Symbol,
    pub(crate) name: String,
    /// The storage's; a signal state has none.
    pub(crate) column: Option<ColumnId>,
    pub(crate) initial: f64,
    /// dx/dt in terms of outputs; of a state that jumps, what it is after the step.
    pub(crate) rate: Expr,
    /// A signal state of a sampled block.
    pub(crate) jumps: bool,
}

/// Storages with one energy; states by their place in the cluster.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) region: RegionId,
    pub(crate) states: Vec<usize>,
    pub(crate) energy: Expr,
    pub(crate) coenergy: Vec<Expr>,
    /// H as it is to be computed, once that was asked for.
    pub(crate) energy_form: OnceCell<EnergyForm>,
    /// Whether it was seen to have a lower bound.
    pub(crate) bounded: bool,
    /// Where it is least on what can be reached, if only that bounds it: the value of its one state.
    pub(crate) least_at: Option<f64>,
}

/// What an output is of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Part {
    /// A source.
    Source(ColumnId),
    /// A resistor.
    Resistor(ColumnId),
    /// A storage whose state sources determine, and that state.
    SourceDriven(Expr),
    /// A signal that a ratio depends on and sets itself.
    Signal,
    /// The multiplier of a constraint.
    Multiplier(ColumnId),
}

/// An output that is computed.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) part: Part,
    pub(crate) out: Symbol,
    pub(crate) how: Output,
    /// The curve that it is iterated as, where its law has an exponential.
    pub(crate) steep: Option<Output>,
    /// What it is iterated as within a loop, where it is linear and switched by a choice: an open switch amplifies the
    /// rounding of a flow, so that its effort is an unknown of its own, as that of a stiffly coupled resistor.
    pub(crate) switched: Option<Output>,
    /// A resistor whose law is not linear.
    pub(crate) curved: bool,
}

impl Node {
    /// One that is linear and iterated as it is.
    fn plain(part: Part, out: Symbol, how: Output) -> Self {
        Self { part, out, how, steep: None, switched: None, curved: false }
    }

    /// The column of a source.
    pub(crate) fn source(&self) -> Option<ColumnId> {
        match self.part {
            Part::Source(c) => Some(c),
            Part::Resistor(_) | Part::SourceDriven(_) | Part::Signal | Part::Multiplier(_) => None,
        }
    }

    /// The column of a resistor.
    pub(crate) fn resistor(&self) -> Option<ColumnId> {
        match self.part {
            Part::Resistor(c) => Some(c),
            Part::Source(_) | Part::SourceDriven(_) | Part::Signal | Part::Multiplier(_) => None,
        }
    }

    /// The column of a constraint.
    pub(crate) fn constraint(&self) -> Option<ColumnId> {
        match self.part {
            Part::Multiplier(c) => Some(c),
            Part::Source(_) | Part::Resistor(_) | Part::SourceDriven(_) | Part::Signal => None,
        }
    }

    /// Whether it is a law with vertical and horizontal branches.
    pub(crate) fn has_branches(&self) -> bool {
        matches!(self.how, Output::Curve { bends: None, .. })
    }

    /// What an iteration has to find, if this is in a loop.
    pub(crate) fn unknown(&self) -> Symbol {
        self.how.unknown(self.out)
    }
}

/// An integral of a probe.
#[derive(Clone, Debug)]
pub(crate) struct Integral {
    pub(crate) symbol: Symbol,
    pub(crate) rate: Expr,
    pub(crate) start: f64,
}

/// How a stepper keeps the length of its last step, last of all that it keeps; 0 where there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Recall {
    /// As it is.
    Length,
    /// One over it.
    Rate,
}

/// A delay.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    /// What the signal was.
    pub(crate) symbol: Symbol,
    /// The name of it.
    pub(crate) name: String,
    /// Of one in continuous time, what it is made of within a step.
    pub(crate) coefficients: Coefficients,
    /// What the signal was, in terms of these, or its symbol.
    pub(crate) value: Expr,
    /// What it is until the first that is delayed arrives.
    pub(crate) start: f64,
    pub(crate) carries: Carries,
}

/// What is delayed, and by how much.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Carries {
    /// A signal state, by its place in the cluster; so many periods.
    State(usize, u32),
    /// A signal; so long, s.
    Signal(Expr, f64),
    /// What something was over a step; so many periods more than one.
    Wave(Expr, u32),
    /// What leaves over a step; what comes in is told from outside.
    Leaving(Expr),
}

impl Line {
    /// The symbols of its input slots.
    pub(crate) fn slots(&self) -> Vec<Symbol> {
        match self.carries {
            Carries::State(..) | Carries::Wave(..) | Carries::Leaving(_) => vec![self.symbol],
            Carries::Signal(..) => self.coefficients.clone(),
        }
    }
}

/// Regions that step as one.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cluster {
    pub(crate) regions: Vec<RegionId>,
    pub(crate) sampling: Option<usize>,
    pub(crate) states: Vec<State>,
    pub(crate) groups: Vec<Group>,
    pub(crate) integrals: Vec<Integral>,
    /// Sources and resistors, those first on which others depend.
    pub(crate) nodes: Vec<Node>,
    /// Outputs that an iteration has to find, in order.
    pub(crate) loops: Vec<Symbol>,
    /// Those of them that stiffly coupled resistors give.
    pub(crate) stiffly_coupled: Vec<Symbol>,
    /// Sources that determine the states of storages.
    pub(crate) driving_sources: Vec<ColumnId>,
    /// Double bars and open ports.
    pub(crate) ports: Vec<ColumnId>,
    /// Signals of other clusters.
    pub(crate) foreign: Vec<Symbol>,
    /// Inputs that it reads, by number: value and slope.
    pub(crate) inputs: Vec<(usize, Symbol, Symbol)>,
    /// Delays.
    pub(crate) lines: Vec<Line>,
    pub(crate) time: Option<Symbol>,
    pub(crate) h: Option<Symbol>,
    /// Change of each state over a step.
    pub(crate) delta: Vec<Symbol>,
    /// The states whose changes are predicted in a step by the discrete gradient.
    pub(crate) predicted: Vec<usize>,
    /// How many numbers the stepper keeps of its last step.
    pub(crate) memory: usize,
    /// What those are at the start; 0 where it is not said.
    pub(crate) kept: Vec<f64>,
    /// Whether an iteration starts by them alone, and from nothing where the last one is 0.
    pub(crate) recalls: Option<Recall>,
    /// Whether constraints may say the same: how they share what they carry.
    pub(crate) redundant: bool,
    /// Whether each step's balance is looked at before it counts.
    pub(crate) watched: bool,
    /// Whether steps are fitted to a tolerance.
    pub(crate) fitted: bool,
    /// The numbers that its programs are chosen and written by.
    pub(crate) thresholds: Thresholds,
    /// The Maclaurin expansions of laws at rest.
    pub(crate) expansions: RefCell<Expansions>,
}

impl Cluster {
    /// Takes a region in; `loops` are its loops through modulation.
    pub(crate) fn add(&mut self, pool: &mut Pool, form: &Form, region: usize, loops: &[usize]) {
        let r = &form.regions[region];
        self.redundant |= form.redundant.contains(&RegionId(region as u32));
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
                energy_form: OnceCell::new(),
                bounded: g.bounded,
                least_at: g.least_at,
            });
        }
        for &c in &r.inputs {
            match form.column(c).role {
                Role::Source(v) => {
                    let how = Output::Explicit(v);
                    self.nodes.push(Node::plain(Part::Source(c), form.column(c).out, how));
                }
                Role::Bar | Role::Open(_) => self.ports.push(c),
                Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => {}
            }
        }
        for (c, how) in &r.resistors {
            let steep = r.steep.get(c).copied();
            let out = form.column(*c).out;
            if form.column(*c).role == Role::Constraint {
                self.nodes.push(Node { curved: true, ..Node::plain(Part::Multiplier(*c), out, *how) });
                continue;
            }
            let gain = own_gain(form, *c).filter(|k| pool.is_switched(*k));
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
            let part = Part::SourceDriven(f.state);
            self.nodes.push(Node::plain(part, form.column(f.column).out, how));
            self.driving_sources.extend(f.sources.iter().copied());
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

    pub(crate) fn all_expressions(&self) -> Vec<Expr> {
        let mut all: Vec<Expr> = self.states.iter().map(|s| s.rate).collect();
        for n in &self.nodes {
            all.extend(n.how.expressions());
        }
        all.extend(self.integrals.iter().map(|i| i.rate));
        all.extend(self.carried().chain(self.waves()));
        all
    }

    /// The signals that are delayed in continuous time.
    pub(crate) fn carried(&self) -> impl Iterator<Item = Expr> {
        self.lines.iter().filter_map(|line| match line.carries {
            Carries::Signal(e, _) => Some(e),
            Carries::State(..) | Carries::Wave(..) | Carries::Leaving(_) => None,
        })
    }

    /// What is delayed as it was over a step. It is reported after the means at the ports.
    pub(crate) fn waves(&self) -> impl Iterator<Item = Expr> {
        self.lines.iter().filter_map(|line| match line.carries {
            Carries::Wave(e, _) | Carries::Leaving(e) => Some(e),
            Carries::Signal(..) | Carries::State(..) => None,
        })
    }

    /// Symbols that this cluster has values for.
    pub(crate) fn owned(&self, form: &Form) -> Vec<Symbol> {
        let states =
            self.states.iter().flat_map(|s| std::iter::once(s.symbol).chain(s.column.map(|c| form.column(c).out)));
        let ports = self.ports.iter().map(|c| form.column(*c).out);
        states
            .chain(self.nodes.iter().flat_map(|n| [n.out, n.unknown()]))
            .chain(ports)
            .chain(self.integrals.iter().map(|i| i.symbol))
            .chain(self.lines.iter().flat_map(|line| line.coefficients.iter().copied().chain([line.symbol])))
            .collect()
    }

    pub(crate) fn find_foreign(&mut self, model: &mut Model, form: &Form) {
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
    pub(crate) fn flat(&self, pool: &mut Pool, mut map: FxHashMap<Symbol, Expr>) -> FxHashMap<Symbol, Expr> {
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
    pub(crate) fn at_instant(&self, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
        let mut map = FxHashMap::default();
        let sources = self.driving_values();
        for g in &self.groups {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                if let Some(c) = self.states[*s].column {
                    map.insert(form.column(c).out, pool.substitute(*z, &sources));
                }
            }
        }
        map
    }

    /// Expressions of all outputs at one instant.
    pub(crate) fn flat_at_instant(&self, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
        let map = self.at_instant(pool, form);
        self.flat(pool, map)
    }

    /// What the sources give that determine storages.
    pub(crate) fn driving_values(&self) -> FxHashMap<Symbol, Expr> {
        let driving_sources: FxHashSet<ColumnId> = self.driving_sources.iter().copied().collect();
        let given = |n: &Node| match (n.source(), n.how) {
            (Some(c), Output::Explicit(e)) if driving_sources.contains(&c) => Some((n.out, e)),
            _ => None,
        };
        self.nodes.iter().filter_map(given).collect()
    }

    /// Whether a moving source determines the state of a storage.
    pub(crate) fn has_moving_source_driven_storage(&self, pool: &Pool) -> bool {
        let moves = |e: Expr| pool.contains_any(e, &|s| pool.value(s).is_none());
        self.nodes.iter().any(|n| match (n.part, n.how) {
            (Part::Source(c), Output::Explicit(e)) => self.driving_sources.contains(&c) && moves(e),
            (Part::Source(_) | Part::Resistor(_) | Part::SourceDriven(_) | Part::Signal | Part::Multiplier(_), _) => {
                false
            }
        })
    }

    /// Whether nothing takes energy out.
    pub(crate) fn is_lossless(&self) -> bool {
        self.nodes.iter().all(|n| !matches!(n.part, Part::Resistor(_)))
    }

    /// The nodes that are solved for, in the order of the loops' unknowns.
    pub(crate) fn loop_nodes(&self) -> Vec<&Node> {
        let by: FxHashMap<Symbol, &Node> = self.nodes.iter().map(|n| (n.unknown(), n)).collect();
        self.loops.iter().filter_map(|z| by.get(z).copied()).collect()
    }

    /// Whether several branched laws may leave their unknowns undetermined: how they share a load.
    pub(crate) fn may_be_undetermined(&self) -> bool {
        self.loop_nodes().iter().filter(|n| n.has_branches()).count() > 1
    }

    /// Unknowns that appear as exponents, with the knee beyond which the exponential dominates: a law with an
    /// exponential has its argument as the unknown or, where it is inverted, its output.
    pub(crate) fn exponential_knees(&self) -> Vec<(Symbol, Bends)> {
        let bent = |n: &&Node| match n.how {
            Output::Implicit { bends: Some(bends), .. } => Some((n.out, bends)),
            Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. } => None,
        };
        let backwards: Vec<_> = self.loop_nodes().iter().filter_map(bent).collect();
        self.exponential_arguments().into_iter().chain(backwards).collect()
    }

    /// Those of them that are their laws' own.
    pub(crate) fn exponential_arguments(&self) -> Vec<(Symbol, Bends)> {
        let bent = |n: &&Node| match n.how {
            Output::Curve { parameter, bends: Some(bends), .. } => Some((parameter, bends)),
            Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. } => None,
        };
        self.loop_nodes().iter().filter_map(bent).collect()
    }

    /// Residuals of the loops, in order, in terms of outputs.
    pub(crate) fn loop_residuals(&self, pool: &mut Pool) -> Vec<Expr> {
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

    /// The same in terms of what `flat` leaves of outputs.
    pub(crate) fn residuals_in(&self, pool: &mut Pool, flat: &FxHashMap<Symbol, Expr>) -> Vec<Expr> {
        self.loop_residuals(pool).into_iter().map(|r| pool.substitute(r, flat)).collect()
    }

    /// The groups of a region, which stand together: regions are added in order.
    pub(crate) fn groups_in(&self, region: RegionId) -> &[Group] {
        let first = self.groups.partition_point(|g| g.region.0 < region.0);
        let past = self.groups.partition_point(|g| g.region.0 <= region.0);
        &self.groups[first..past]
    }

    /// The energies of all groups and their derivatives.
    pub(crate) fn energies(&self) -> Vec<Expr> {
        let mut all: Vec<Expr> =
            self.groups.iter().flat_map(|g| g.coenergy.iter().copied().chain([g.energy])).collect();
        all.sort_unstable();
        all
    }

    /// H of a region of the cluster.
    pub(crate) fn energy(&self, pool: &mut Pool, region: RegionId) -> Expr {
        let groups = self.groups_in(region).iter();
        let terms: Vec<Expr> = groups.map(|g| self.energy_form(pool, g).energy).collect();
        pool.sum(&terms)
    }

    /// H of a group without cancellation.
    pub(crate) fn energy_form<'g>(&self, pool: &mut Pool, g: &'g Group) -> &'g EnergyForm {
        g.energy_form.get_or_init(|| match (&g.states[..], &g.coenergy[..]) {
            ([only], [law]) => {
                let known = &mut self.expansions.borrow_mut();
                EnergyForm::of(pool, known, self.states[*only].symbol, g.energy, *law)
            }
            _ => {
                let states: Vec<Symbol> = g.states.iter().map(|s| self.states[*s].symbol).collect();
                EnergyForm::of_several(pool, &mut self.expansions.borrow_mut(), &states, g.energy)
            }
        })
    }

    /// Slots of the state: energy states, integrals, what loops start from, what rounding took from the energy states,
    /// and what the stepper keeps of its last step.
    pub(crate) fn slots(&self) -> usize {
        self.memory_at() + self.memory
    }

    /// The first slot of what the stepper keeps.
    pub(crate) fn memory_at(&self) -> usize {
        self.carry_at() + self.states.len()
    }

    /// The first slot of what rounding took.
    pub(crate) fn carry_at(&self) -> usize {
        self.states.len() + self.integrals.len() + self.loops.len()
    }

    /// Its name: that of its first region, else of its first state.
    pub(crate) fn name(&self, form: &Form) -> String {
        let region = self.regions.first().map(|r| form.regions[r.at()].name.clone());
        region.or_else(|| self.states.first().map(|s| s.name.clone())).unwrap_or_default()
    }

    /// Name of the cluster's programs.
    pub(crate) fn title(&self, form: &Form, what: &str) -> String {
        let names: Vec<&str> = self.regions.iter().take(3).map(|r| form.regions[r.at()].name.as_str()).collect();
        if names.is_empty() {
            return format!("{what} of {}", self.name(form));
        }
        format!("{what} of {}{}", names.join(", "), if self.regions.len() > 3 { ", ..." } else { "" })
    }
}

/// An expression that a program could not be written for: a symbol without value. That is a mistake of this crate's.
pub(crate) fn missing(model: &Model, s: Symbol) -> Vec<Diagnostic> {
    vec![Diagnostic::error(
        "discretise::internal",
        model.span,
        format!("`{}` has no value in the step; please report this model", model.pool.name(s)),
    )]
}

/// Checks a program before it leaves.
pub(crate) fn verified(model: &Model, program: Program) -> Result<Program, Vec<Diagnostic>> {
    match program.verify() {
        Ok(()) => Ok(program),
        Err(e) => Err(vec![Diagnostic::error(
            "discretise::internal",
            model.span,
            format!("the program `{}` is not sound: {e}; please report this model", program.name),
        )]),
    }
}

/// Whether a symbol is time.
pub(crate) fn is_time(model: &Model, s: Symbol) -> bool {
    model.signals.get(&s) == Some(&Signal::Time)
}

/// Which input a symbol is, or is the slope of.
pub(crate) fn input_of(model: &Model, s: Symbol) -> Option<usize> {
    match model.signals.get(&s) {
        Some(Signal::Input(i) | Signal::Slope(i)) => Some(*i),
        Some(
            Signal::Time
            | Signal::Effort(_)
            | Signal::Flow(_)
            | Signal::State(_)
            | Signal::Integral(_)
            | Signal::Argument(_)
            | Signal::Parameter(_)
            | Signal::Memory(_)
            | Signal::Delay(_),
        )
        | None => None,
    }
}

/// What a linear resistor gives for what it receives.
pub(crate) fn own_gain(form: &Form, column: ColumnId) -> Option<Expr> {
    let row = form.regions.iter().find_map(|r| r.gains.get(&column))?;
    match row[..] {
        [(own, k)] if own == column => Some(k),
        _ => None,
    }
}
