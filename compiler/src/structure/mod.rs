//! The port-Hamiltonian form of a model: from bonds with strokes to the Dirac structure and the energy of each region.
//!
//! Every element that is no junction, TF or GY is a *column*: it gives one variable to the network, its output z, and
//! receives the other, its input. Power is counted into the element, so that the inputs are D(x) z with D skew.

mod casimir;
mod change;
mod constraint;
mod curved;
mod dependence;
mod eliminate;
mod eliminated;
mod explicit;
mod junction;
mod quadratic;
mod region;
mod resistor;
mod resolve;
mod singular;
mod start;
mod steered;
mod storage;

pub(crate) use casimir::square_casimirs;
pub use explicit::{Explicit, explicit, inverse};

use crate::causality::{self, Causality, holder};
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::{BondGraph, RegionId};
use crate::model::{BondId, ElementId, Kind, Law, Model, Variable};
use crate::units::DisplayUnit;
use bond_grammar::diagnostic::{Diagnostic, once};
use eliminate::Tied;
use petgraph::graph::{Graph, NodeIndex};
use rustc_hash::{FxHashMap, FxHashSet};
use std::fmt;

/// What counts as rounding in the elimination, and bounds on its work.
struct Options {
    /// The part of what an equation is made of that is rounding of a pivot, or of a stated start.
    rounding: f64,
    /// Storages that others may depend on by ratios that change: the inverse of their masses is written out.
    tied: usize,
    /// Places at which a divisor is looked at to see whether it passes 0.
    divisor_places: u32,
    /// Halvings by which a zero of a divisor is found.
    divisor_halvings: usize,
    /// The part of the inertia elsewhere below which a mass matrix is singular.
    singular: f64,
    /// What leaks through a curve whose loop has no other start, as a part of its slopes: a flow along its effort.
    /// Circuit simulators put 1e-12 S across each junction (Nagel, SPICE2, 1975).
    leak: f64,
}

const OPTIONS: Options =
    Options { rounding: 1e-9, tied: 8, divisor_places: 40, divisor_halvings: 60, singular: 1e-12, leak: 1e-12 };

/// A column of the Dirac structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ColumnId(pub u32);

impl ColumnId {
    /// As an index.
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// Coefficients of outputs, sorted by column, none of them 0.
pub type Row = Vec<(ColumnId, Expr)>;

/// What a column stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// A source with its value.
    Source(Expr),
    /// The other side of a double bar, seen from this region.
    Bar,
    /// An open port of the scene, with the least inertia of the outside.
    Open(Option<f64>),
    /// A storage in integral causality; the output is its co-energy variable.
    Storage,
    /// A resistor.
    Resistor,
    /// A storage in derivative causality; gone after the elimination, but where it follows a source.
    Dependent,
    /// A multiplier, and the flow of a junction without inertia: what has its input be 0.
    Constraint,
}

/// An element (or the far side of a double bar) as the network sees it.
#[derive(Clone, Debug)]
pub struct Column {
    /// The element's name; of a double bar, the name of the element at its far end.
    pub name: String,
    /// The element; of a double bar, the one at the far end.
    pub element: ElementId,
    /// Its bond.
    pub bond: BondId,
    /// 1 where the bond points at it, -1 where it points away; see [`Column::sign_of`].
    pub sign: i64,
    /// Which variable that sign is on.
    pub sign_on: Variable,
    /// The region.
    pub region: RegionId,
    /// What it is.
    pub role: Role,
    /// Which variable it gives.
    pub gives: Variable,
    /// The symbol of its output.
    pub out: Symbol,
    /// Its input as a combination of outputs.
    pub row: Row,
}

impl Column {
    /// The column's own variable is this times the bond's, so that the product of its pair is the power into it.
    pub fn sign_of(&self, variable: Variable) -> i64 {
        if variable == self.sign_on { self.sign } else { 1 }
    }
}

/// Where the exponentials of a law grow: where they are 1, and the slope of their exponents, to each side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bends {
    /// Towards larger arguments.
    pub above: Option<(f64, f64)>,
    /// Towards smaller ones; its slope is below 0.
    pub below: Option<(f64, f64)>,
}

impl Bends {
    /// Those of two laws: of each side what grows faster.
    pub fn with(self, other: Bends) -> Bends {
        let faster = |a: Option<(f64, f64)>, b: Option<(f64, f64)>| match (a, b) {
            (Some(x), Some(y)) if x.1.abs() < y.1.abs() => Some(y),
            (x, y) => x.or(y),
        };
        Bends { above: faster(self.above, other.above), below: faster(self.below, other.below) }
    }
}

/// A resistor's output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// As an expression of its input and of signals.
    Explicit(Expr),
    /// As the root of a residual.
    Implicit {
        /// What is 0.
        residual: Expr,
        /// Where the exponentials of a law that is run backwards grow, in the output.
        bends: Option<Bends>,
    },
    /// On a curve: the output in its parameter, and the residual that the parameter is the root of.
    Curve {
        /// The unknown.
        parameter: Symbol,
        /// The output.
        out: Expr,
        /// 0 where the curve's other variable is the input; in the unit of the parameter.
        residual: Expr,
        /// Power per square of the parameter.
        weight: Expr,
        /// Where the parameter is the argument of a law with exponentials: where these grow. Else it is a bare number.
        bends: Option<Bends>,
    },
}

impl Output {
    /// What it is made of: the law and, of a curve, its output too.
    pub fn expressions(self) -> impl Iterator<Item = Expr> {
        let (first, second) = match self {
            Output::Explicit(e) | Output::Implicit { residual: e, .. } => (e, None),
            Output::Curve { out, residual, .. } => (residual, Some(out)),
        };
        std::iter::once(first).chain(second)
    }

    /// What an iteration has to find, where one has to: of the column's output or of a curve's parameter.
    pub fn unknown(self, out: Symbol) -> Symbol {
        match self {
            Output::Explicit(_) | Output::Implicit { .. } => out,
            Output::Curve { parameter, .. } => parameter,
        }
    }

    /// Whether it is the root of something, rather than a value.
    pub fn is_root(self) -> bool {
        match self {
            Output::Explicit(_) => false,
            Output::Implicit { .. } | Output::Curve { .. } => true,
        }
    }
}

/// A state of a region.
#[derive(Clone, Debug)]
pub struct State {
    /// Its symbol.
    pub symbol: Symbol,
    /// `spring.q`
    pub name: String,
    /// Its column; the output is dH/dx, the input dx/dt.
    pub column: ColumnId,
    /// Its unit, where determined.
    pub unit: Option<DisplayUnit>,
    /// Initial value, SI.
    pub initial: f64,
}

/// Storages with one energy: one alone, or those into which dependent ones are merged.
#[derive(Clone, Debug)]
pub struct Group {
    /// Indices into the region's states.
    pub states: Vec<usize>,
    /// H, an expression of their symbols.
    pub energy: Expr,
    /// dH/dx of each.
    pub coenergy: Vec<Expr>,
    /// Whether H was seen to have a lower bound.
    pub bounded: bool,
    /// Where H is least on what can be reached, if only that gives it a lower bound: the value of its one state.
    pub least_at: Option<f64>,
}

/// A storage in derivative causality that was merged into others.
#[derive(Clone, Debug)]
pub struct Dependent {
    /// The storage.
    pub element: ElementId,
    /// Its state as an expression of the region's states.
    pub state: Expr,
    /// The states that it was merged into.
    pub into: Vec<String>,
}

/// A dependent storage that follows sources: a load of theirs. Its energy is in a group.
#[derive(Clone, Debug)]
pub struct Follower {
    /// Its column, whose output is d/dt of its state.
    pub column: ColumnId,
    /// Its state, in states and time.
    pub state: Expr,
    /// d/dt of that.
    pub rate: Expr,
    /// The sources.
    pub sources: Vec<ColumnId>,
}

/// A region's part of the form.
#[derive(Clone, Debug)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// The `sampled` block it stands in.
    pub sampling: Option<usize>,
    /// Sources, bars and open ports, in order of declaration.
    pub inputs: Vec<ColumnId>,
    /// States, in order of declaration.
    pub states: Vec<State>,
    /// Energies.
    pub groups: Vec<Group>,
    /// Resistors and constraints, and how their outputs are had.
    pub resistors: Vec<(ColumnId, Output)>,
    /// Laws that grow so fast that their argument is the better unknown, as curves with the argument as parameter.
    pub steep: FxHashMap<ColumnId, Output>,
    /// Curves with a leak, as which the start of a loop is looked for where there is no other.
    pub leaky: FxHashMap<ColumnId, Output>,
    /// Of linear resistors and ports of linear fields: the output as a combination of inputs.
    pub gains: FxHashMap<ColumnId, Row>,
    /// Of resistors of one port that have no gain, and are no curves: the law's argument, and the law in terms of it.
    pub laws: FxHashMap<ColumnId, (Symbol, Expr)>,
    /// Storages that were merged into others.
    pub dependent: Vec<Dependent>,
    /// Dependent storages that follow sources.
    pub following: Vec<Follower>,
    /// Effort times flow is no power here.
    pub pseudo: bool,
}

impl Region {
    /// The resistors and constraints as places in [`Region::resistors`], those first on which others depend; what
    /// depends on one another stands together.
    pub fn components(&self, pool: &Pool, form: &Form) -> Vec<Vec<usize>> {
        let place: FxHashMap<Symbol, usize> = self
            .resistors
            .iter()
            .enumerate()
            .flat_map(|(i, (c, how))| {
                let out = form.column(*c).out;
                [(out, i), (how.unknown(out), i)]
            })
            .collect();
        let mut needs: Graph<(), ()> = Graph::with_capacity(self.resistors.len(), 0);
        for _ in &self.resistors {
            needs.add_node(());
        }
        for (i, (_, how)) in self.resistors.iter().enumerate() {
            for s in how.expressions().flat_map(|e| pool.symbols(e)) {
                if let Some(&j) = place.get(&s) {
                    needs.add_edge(NodeIndex::new(i), NodeIndex::new(j), ());
                }
            }
        }
        let sorted = |component: Vec<NodeIndex>| {
            let mut members: Vec<usize> = component.iter().map(|n| n.index()).collect();
            members.sort_unstable();
            members
        };
        petgraph::algo::kosaraju_scc(&needs).into_iter().map(sorted).collect()
    }

    /// Its algebraic loops: resistors whose outputs depend on one another at each instant.
    pub fn loops(&self, pool: &Pool, form: &Form) -> Vec<Vec<ColumnId>> {
        let mut all = self.components(pool, form);
        all.iter_mut().for_each(|members| {
            members.retain(|i| form.column(self.resistors[*i].0).role == Role::Resistor);
        });
        all.retain(|members| members.len() > 1);
        all.sort();
        all.into_iter().map(|members| members.into_iter().map(|i| self.resistors[i].0).collect()).collect()
    }
}

/// The form of a whole model.
#[derive(Clone, Debug)]
pub struct Form {
    /// All columns.
    pub columns: Vec<Column>,
    /// Regions, as in the graph.
    pub regions: Vec<Region>,
    /// For each double bar, the column on the holder's far side (in the region that sees the held variable), and the
    /// one in the holder's region.
    pub bars: Vec<Bar>,
    /// The column of each element that has one of its own.
    pub column_of_element: Vec<Option<ColumnId>>,
    /// The column whose output a symbol is.
    pub column_of: FxHashMap<Symbol, ColumnId>,
    /// What ratios between dependent storages are divided by, where their mass matrix is singular at its zeros.
    pub poles: Vec<Expr>,
    /// Signals that a ratio depends on and sets itself: unknowns of the step.
    pub loops: Vec<Loop>,
    /// Probes, integrals and conditions in terms of states, outputs and time.
    pub probes: Vec<Expr>,
    /// Rates of the integrals.
    pub integrals: Vec<Expr>,
    /// Laws of the signal states: rates, or what comes next.
    pub memories: Vec<Expr>,
    /// What is delayed.
    pub delays: Vec<Expr>,
    /// The expressions of `expect`, in order: value, or condition and what its extremes are of.
    pub expectations: Vec<Vec<Expr>>,
    /// Sources whose values read the scene's own signals.
    pub steered: FxHashSet<ColumnId>,
    /// Regions with constraints that say the same, as the mechanism starts: what each carries is not determined.
    pub redundant: FxHashSet<RegionId>,
}

/// A loop through modulation: a signal that stands in a ratio and comes out of it.
#[derive(Clone, Copy, Debug)]
pub struct Loop {
    /// The signal.
    pub signal: Symbol,
    /// The unknown that stands for it.
    pub unknown: Symbol,
    /// What it must equal, in terms of itself.
    pub value: Expr,
    /// Where it lies.
    pub region: RegionId,
    /// Its bond.
    pub bond: BondId,
}

/// A double bar.
#[derive(Clone, Copy, Debug)]
pub struct Bar {
    /// The bond.
    pub bond: BondId,
    /// The column in the holder's region: its output is the mean of what the other side reports.
    pub holder: ColumnId,
    /// The column in the other region: its output is the held variable.
    pub held: ColumnId,
}

/// Builds the form. Where storages depend on one another and cannot be merged, multipliers tie them: causality is then
/// assigned again, and the graph is another one.
///
/// # Errors
/// Structures that cannot be made explicit, with the elements.
pub fn build(
    model: &mut Model,
    mut graph: BondGraph,
    mut causality: Causality,
) -> Result<(BondGraph, Causality, Form), Vec<Diagnostic>> {
    let mut columns = columns(model, &graph, &causality);
    let mut rows = junction::rows(model, &graph, &causality, &mut columns)?;
    let mut form = form(model, columns);
    resolve::rows(model, &graph, &rows, &mut form)?;
    let told = |errors: Vec<Diagnostic>, model: &Model, graph: &BondGraph, causality: &Causality| {
        once(errors).into_iter().map(|e| held(model, graph, causality, e)).collect::<Vec<_>>()
    };
    let mut before: FxHashSet<ElementId> = FxHashSet::default();
    let mut at_rest: Vec<ElementId> = Vec::new();
    loop {
        let Tied { storages: tied, held: more } =
            eliminate::tied(model, &form, &before).map_err(|e| told(e, model, &graph, &causality))?;
        if tied.is_empty() {
            break;
        }
        before.extend(&tied);
        at_rest.extend(more);
        (graph, causality) = causality::tie(model, graph, &causality, &tied)?;
        let mut columns = self::columns(model, &graph, &causality);
        rows = junction::rows(model, &graph, &causality, &mut columns)?;
        form = self::form(model, columns);
        resolve::rows(model, &graph, &rows, &mut form)?;
    }
    let eliminated =
        eliminate::eliminate(model, &causality, &mut form, &at_rest).map_err(|e| told(e, model, &graph, &causality))?;
    form.poles.clone_from(&eliminated.poles);
    region::regions(model, &graph, &rows, &eliminated, &mut form)?;
    casimir::bound(model, &mut form);
    form.bars = bars(model, &form);
    let unread = unread(model, &form);
    if !unread.is_empty() {
        return Err(unread);
    }
    form.steered = steered::steered(model, &form);
    form.validate(&model.pool).map_err(|d| vec![Diagnostic::error("structure::skew", model.span, d)])?;
    Ok((graph, causality, form))
}

/// A form of columns alone.
fn form(model: &Model, columns: Vec<Column>) -> Form {
    let mut column_of_element = vec![None; model.elements.len()];
    for (i, c) in columns.iter().enumerate().filter(|(_, c)| c.role != Role::Bar) {
        column_of_element[c.element.at()] = Some(ColumnId(i as u32));
    }
    Form {
        column_of_element,
        column_of: columns.iter().enumerate().map(|(i, c)| (c.out, ColumnId(i as u32))).collect(),
        columns,
        regions: Vec::new(),
        bars: Vec::new(),
        loops: Vec::new(),
        poles: Vec::new(),
        probes: Vec::new(),
        integrals: Vec::new(),
        memories: Vec::new(),
        delays: Vec::new(),
        expectations: Vec::new(),
        steered: FxHashSet::default(),
        redundant: FxHashSet::default(),
    }
}

/// An error of a dependent storage; where that is one only by strokes that the user asserted, it is theirs.
fn held(model: &Model, graph: &BondGraph, causality: &Causality, error: Diagnostic) -> Diagnostic {
    let at = |id: &ElementId| error.labels.first().is_some_and(|l| l.span == model.element(*id).span);
    let Some(storage) = causality.dependent.iter().copied().find(at) else { return error };
    let strokes = causality::holding(model, graph, storage);
    let Some((first, others)) = strokes.split_first() else { return error };
    let (name, bond) = (&model.element(storage).name, model.bond(*first));
    let message = format!(
        "the stroke of the bond {} cannot hold: it puts `{name}` in derivative causality, which cannot be taken there",
        bond.name
    );
    let mut error = Diagnostic::error("causality::stroke", bond.span, message)
        .label(model.element(storage).span, "is in integral causality without the stroke");
    for b in others.iter().take(16) {
        error = error.label(model.bond(*b).span, "is asserted too");
    }
    error.help("reverse the stroke, or remove it: `->`")
}

/// Which variable of an element takes the sign of a half arrow that points away from it: not the one that the user
/// states, which is the value of a source, the argument of a law, `f0` of an inertia, `e0` of a compliance.
fn sign_on(kind: Kind, law: &Law) -> Variable {
    match law {
        Law::Resistor(r) => r.written,
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => {
            kind.forced().or(kind.integral()).map_or(Variable::Flow, Variable::other)
        }
    }
}

/// A column for each 1-port element, and one on each side of each double bar.
fn columns(model: &mut Model, graph: &BondGraph, causality: &Causality) -> Vec<Column> {
    let mut columns = Vec::new();
    let mut is_dependent = vec![false; model.elements.len()];
    causality.dependent.iter().for_each(|d| is_dependent[d.at()] = true);
    let mut pool = std::mem::take(&mut model.pool);
    for (id, e) in model.ids() {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let region = graph.region_of[id.at()];
        let role = match &e.law {
            Law::Source(v) => Role::Source(*v),
            Law::Port(inertia) => Role::Open(*inertia),
            Law::Storage(_) if is_dependent[id.at()] => Role::Dependent,
            Law::Storage(_) => Role::Storage,
            Law::Resistor(_) => Role::Resistor,
            Law::Multiplier => Role::Constraint,
            Law::Ratio(_) | Law::Junction => continue,
        };
        let gives = causality.gives(model, bond, id);
        let sign = if model.bond(bond).head == id { 1 } else { -1 };
        let out = pool.symbol(&format!("{}.{}", e.name, gives.letter()));
        columns.push(Column {
            name: e.name.clone(),
            element: id,
            bond,
            sign,
            sign_on: sign_on(e.kind, &e.law),
            region,
            role,
            gives,
            out,
            row: Vec::new(),
        });
    }
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| b.sampled) {
        let bond = BondId(i as u32);
        for far in [b.head, b.tail] {
            let gives = causality.gives(model, bond, far);
            let near = b.other(far);
            let name = model.element(if is_junction(model, far) { near } else { far }).name.clone();
            let sign = if far == b.head { 1 } else { -1 };
            let out = pool.symbol(&format!("{}.{}", name, gives.letter()));
            let region = graph.region_of[near.at()];
            columns.push(Column {
                name,
                element: far,
                bond,
                sign,
                sign_on: Variable::Flow,
                region,
                role: Role::Bar,
                gives,
                out,
                row: Vec::new(),
            });
        }
    }
    model.pool = pool;
    columns
}

fn is_junction(model: &Model, id: ElementId) -> bool {
    model.element(id).kind.is_junction()
}

/// Double bars whose resolution is of a motion, where an effort is read.
fn unread(model: &Model, form: &Form) -> Vec<Diagnostic> {
    let open = form.columns.iter().filter(|c| matches!(c.role, Role::Open(_)));
    let readers = form.bars.iter().map(|bar| form.column(bar.holder)).chain(open);
    let reads_effort = readers.filter(|c| c.gives == Variable::Effort && model.bond(c.bond).resolution.is_some());
    reads_effort
        .map(|c| {
            let bond = model.bond(c.bond);
            let message =
                format!("`{}` has a resolution of its motion, but its sampled side holds the flow", bond.name);
            Diagnostic::error("structure::resolution", bond.span, message).help(
                "have the sampled side hold the effort, by a spring or a damper at the double bar, or leave it out",
            )
        })
        .collect()
}

fn bars(model: &Model, form: &Form) -> Vec<Bar> {
    let mut bars = Vec::new();
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| b.sampled) {
        let bond = BondId(i as u32);
        let holding = holder(model, bond);
        // The column whose far end is the holder lives in the other region, and gives the held variable.
        let with_far = |far: ElementId| {
            form.columns
                .iter()
                .position(|c| c.role == Role::Bar && c.bond == bond && c.element == far)
                .map(|i| ColumnId(i as u32))
        };
        if let (Some(held), Some(holder)) = (with_far(holding), with_far(b.other(holding))) {
            bars.push(Bar { bond, holder, held });
        }
    }
    bars
}

impl Form {
    /// The column with this id.
    pub fn column(&self, id: ColumnId) -> &Column {
        &self.columns[id.at()]
    }

    /// The input of a column as an expression of outputs.
    pub fn input(&self, pool: &mut Pool, column: ColumnId) -> Expr {
        let row = &self.column(column).row;
        let terms: Vec<Expr> = row
            .iter()
            .map(|(j, k)| {
                let z = pool.var(self.column(*j).out);
                pool.mul(*k, z)
            })
            .collect();
        pool.sum(&terms)
    }

    /// The coefficient of an output in the input of a column.
    pub fn entry(&self, row: ColumnId, column: ColumnId) -> Option<Expr> {
        let row = &self.column(row).row;
        row.binary_search_by_key(&column, |t| t.0).ok().map(|i| row[i].1)
    }

    /// Has another coefficient where there is one.
    pub(crate) fn set_entry(&mut self, row: ColumnId, column: ColumnId, coefficient: Expr) {
        let row = &mut self.columns[row.at()].row;
        if let Ok(i) = row.binary_search_by_key(&column, |t| t.0) {
            row[i].1 = coefficient;
        }
    }

    /// Checks that D is skew: symbolically, and where that does not decide, at points.
    ///
    /// # Errors
    /// Names the two elements whose entries do not cancel.
    pub fn validate(&self, pool: &Pool) -> Result<(), String> {
        for (i, c) in self.columns.iter().enumerate().filter(|(_, c)| c.role != Role::Dependent) {
            for k in 0..3 {
                let at = |s: Symbol| 0.3 + 0.17 * f64::from(s.0 % 7) + 0.41 * f64::from(k);
                let values: Vec<f64> = c.row.iter().map(|t| pool.eval(t.1, &at)).collect();
                let row = values.iter().fold(0.0f64, |m, x| m.max(x.abs()));
                for (&(j, _), x) in c.row.iter().zip(values) {
                    let y = self.entry(j, ColumnId(i as u32)).map_or(0.0, |b| pool.eval(b, &at));
                    // An entry that is 0, as a difference that no rule shows, is the rounding of its row.
                    let most = (1e-9 * (x.abs() + y.abs())).max(1e-12 * row);
                    if x.is_finite() && y.is_finite() && (x + y).abs() > most {
                        return Err(format!(
                            "the Dirac structure is not skew between `{}` and `{}`",
                            c.name,
                            self.column(j).name
                        ));
                    }
                }
            }
        }
        Ok(())
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in &self.columns {
            write!(f, "{}:", c.name)?;
            for (j, _) in &c.row {
                write!(f, " {}", self.column(*j).name)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
