//! The flat model: every instance made, every name resolved, every value an expression. Elaboration makes it; the
//! graph, causality and structure read it. They add expressions to its pool, and causality may add massless inertias;
//! nothing else of it changes.
//!
//! Invariants: a bond's ends are elements (ports of instances are gone); every element has the bonds its kind asks for;
//! all parameters have values. Absent: causality, regions, matrices.

use crate::expression::{Expr, Pool, Symbol};
use crate::thresholds::Thresholds;
use crate::units::DisplayUnit;
use bond_grammar::ast::Stroke;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashMap;

/// An element of the flat model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ElementId(pub u32);

/// A bond of the flat model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BondId(pub u32);

impl ElementId {
    /// As an index.
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

impl BondId {
    /// As an index.
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// One of the pair of power variables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variable {
    /// e
    Effort,
    /// f
    Flow,
}

impl Variable {
    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Variable::Effort => Variable::Flow,
            Variable::Flow => Variable::Effort,
        }
    }

    /// `e` or `f`.
    pub fn letter(self) -> char {
        match self {
            Variable::Effort => 'e',
            Variable::Flow => 'f',
        }
    }
}

/// What an element is: its topology, and its role there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Kind {
    /// One bond.
    OnePort(OnePort),
    /// A bond in and a bond out, with the same power.
    TwoPort(TwoPort),
    /// Any number of bonds, which share this variable: the effort at a 0-junction, the flow at a 1-junction.
    Junction(Variable),
}

/// The role of an element with one bond.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum OnePort {
    /// It gives this variable whatever the other one is: `Se`, `Sf`.
    Source(Variable),
    /// It measures this variable, and the other one is 0: `De`, `Df`.
    Detector(Variable),
    /// In integral causality it gives this variable, by a state that integrates the other one: `C`, `I`.
    Storage(Variable),
    /// A law between effort and flow: `R`.
    Resistor,
    /// An open port of the scene.
    Open,
    /// It gives this variable, whatever has the other one be 0: a multiplier, which the compiler puts where causality
    /// would have storages depend on one another.
    Multiplier(Variable),
}

/// How an element with two bonds relates their variables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum TwoPort {
    /// Efforts with efforts, flows with flows: `TF`.
    Transformer,
    /// Efforts with flows: `GY`.
    Gyrator,
}

#[expect(missing_docs, reason = "they are called as in the language")]
impl Kind {
    pub const SE: Kind = Kind::OnePort(OnePort::Source(Variable::Effort));
    pub const SF: Kind = Kind::OnePort(OnePort::Source(Variable::Flow));
    pub const DE: Kind = Kind::OnePort(OnePort::Detector(Variable::Effort));
    pub const DF: Kind = Kind::OnePort(OnePort::Detector(Variable::Flow));
    pub const C: Kind = Kind::OnePort(OnePort::Storage(Variable::Effort));
    pub const I: Kind = Kind::OnePort(OnePort::Storage(Variable::Flow));
    pub const R: Kind = Kind::OnePort(OnePort::Resistor);
    pub const PORT: Kind = Kind::OnePort(OnePort::Open);
    pub const TF: Kind = Kind::TwoPort(TwoPort::Transformer);
    pub const GY: Kind = Kind::TwoPort(TwoPort::Gyrator);
    pub const ZERO: Kind = Kind::Junction(Variable::Effort);
    pub const ONE: Kind = Kind::Junction(Variable::Flow);
}

impl Kind {
    /// The variable that the bonds of a junction share.
    pub fn common(self) -> Option<Variable> {
        match self {
            Kind::Junction(common) => Some(common),
            Kind::OnePort(_) | Kind::TwoPort(_) => None,
        }
    }

    /// Whether it is a junction.
    pub fn is_junction(self) -> bool {
        self.common().is_some()
    }

    /// Whether it is a C or an I.
    pub fn is_storage(self) -> bool {
        self.integral().is_some()
    }

    /// Whether it is an `Se` or an `Sf`.
    pub fn is_source(self) -> bool {
        matches!(self, Kind::OnePort(OnePort::Source(_)))
    }

    /// Whether it is a `De` or a `Df`.
    pub fn is_detector(self) -> bool {
        matches!(self, Kind::OnePort(OnePort::Detector(_)))
    }

    /// The variable that a source, a detector or a multiplier must give.
    pub fn forced(self) -> Option<Variable> {
        match self {
            Kind::OnePort(OnePort::Source(given) | OnePort::Multiplier(given)) => Some(given),
            Kind::OnePort(OnePort::Detector(measured)) => Some(measured.other()),
            Kind::OnePort(OnePort::Storage(_) | OnePort::Resistor | OnePort::Open)
            | Kind::TwoPort(_)
            | Kind::Junction(_) => None,
        }
    }

    /// The variable that a storage gives in integral causality.
    pub fn integral(self) -> Option<Variable> {
        match self {
            Kind::OnePort(OnePort::Storage(given)) => Some(given),
            Kind::OnePort(_) | Kind::TwoPort(_) | Kind::Junction(_) => None,
        }
    }
}

/// The law of an element, in its own variables, power counted into it.
#[derive(Clone, Debug)]
pub enum Law {
    /// The value of a source; 0 for a detector.
    Source(Expr),
    /// A storage.
    Storage(Storage),
    /// A resistor.
    Resistor(Resistor),
    /// The modulus of a transformer or gyrator.
    Ratio(Expr),
    /// A junction.
    Junction,
    /// An open port, with the least inertia that the outside has there (SI), if told.
    Port(Option<f64>),
    /// A multiplier.
    Multiplier,
}

/// A storage: state x, energy H(x), co-energy variable dH/dx.
#[derive(Clone, Debug)]
pub struct Storage {
    /// The state, q or p.
    pub state: Symbol,
    /// H, in joule.
    pub energy: Expr,
    /// dH/dx: the effort of a C, the flow of an I.
    pub coenergy: Expr,
    /// k where dH/dx = k x.
    pub linear: Option<Expr>,
    /// Initial state, SI.
    pub initial: f64,
    /// Whether the user gave it.
    pub explicit: bool,
    /// Whether H could be seen to have a lower bound.
    pub bounded: bool,
    /// An inertia of 0, put on a junction by the compiler as the speed that others follow.
    pub massless: bool,
}

/// A multiport field: ports of one energy or of one dissipative law. Each port is an element of its own, `arm.p1`; the
/// energy of a storage field, which its ports share, is the `energy` of each of them.
#[derive(Clone, Debug)]
pub struct Field {
    /// As it is written: `C`, `I`, `IC`, `R`, `RS`.
    pub kind: String,
    /// Its path.
    pub name: String,
    /// Its ports, in order.
    pub members: Vec<ElementId>,
    /// Its declaration.
    pub span: Span,
}

/// A resistor: one variable of its bond as a function of the other.
#[derive(Clone, Debug)]
pub struct Resistor {
    /// The other variable, as the law names it.
    pub argument: Symbol,
    /// The law.
    pub output: Expr,
    /// What the law gives.
    pub gives: Variable,
    /// What it gives as it is written: the other one, where it is turned about.
    pub written: Variable,
    /// A law that is a curve (e(s), f(s)); `output` and `argument` then mean nothing.
    pub curve: Option<Curve>,
    /// Of a port of a linear field, the coefficients of the arguments of all ports, in their order.
    pub row: Option<Vec<Expr>>,
    /// r where the law is r times its argument; r may depend on signals.
    pub linear: Option<Expr>,
    /// Whether e f >= 0 is proved; `None` where it is not known.
    pub dissipative: Option<bool>,
}

/// A law that is a curve: effort and flow as functions of a bare number, so that it may stand upright or lie flat.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    /// The number.
    pub parameter: Symbol,
    /// e(s)
    pub effort: Expr,
    /// f(s)
    pub flow: Expr,
}

/// An element.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its path, `wall.spring` or `c[3]`.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Its law.
    pub law: Law,
    /// The sampled block it stands in.
    pub sampling: Option<usize>,
    /// Written `active`.
    pub active: bool,
    /// The compiler put it there: it is not shown.
    pub added: bool,
    /// The field that it is a port of, and which one.
    pub field: Option<(usize, usize)>,
    /// The line that it is a port of.
    pub line: Option<usize>,
    /// Its declaration.
    pub span: Span,
    /// The part of the scene that it stands in: where its instance is declared.
    pub part: Option<Span>,
}

impl Element {
    /// Whether it is a multiplier.
    pub fn is_multiplier(&self) -> bool {
        matches!(self.law, Law::Multiplier)
    }

    /// Whether it is an inertia of 0 that the compiler put there.
    pub fn is_massless(&self) -> bool {
        matches!(&self.law, Law::Storage(s) if s.massless)
    }
}

/// A bond; positive power flows from tail to head.
#[derive(Clone, Debug)]
pub struct Bond {
    /// Where the half arrow starts.
    pub tail: ElementId,
    /// Where it points.
    pub head: ElementId,
    /// `||>`
    pub sampled: bool,
    /// In what steps a sampled region reads the motion of the other side, in SI units; `None` where it does so
    /// exactly.
    pub resolution: Option<f64>,
    /// An asserted stroke.
    pub stroke: Option<Stroke>,
    /// Its name where it has one, else `tail -> head`.
    pub name: String,
    /// Its arrow.
    pub span: Span,
}

impl Bond {
    /// The end that is not `end`.
    pub fn other(&self, end: ElementId) -> ElementId {
        if self.tail == end { self.head } else { self.tail }
    }
}

/// How a sampled region couples to its surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Hold {
    /// The held value from the last interval's flow.
    Lagged,
    /// The effort the next step would call for at the last flow.
    Predicted,
    /// Solved against the response of the other side.
    #[default]
    Matched,
}

impl Hold {
    /// All of them.
    pub const ALL: [Hold; 3] = [Hold::Lagged, Hold::Predicted, Hold::Matched];

    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Hold::Lagged => "lagged",
            Hold::Predicted => "predicted",
            Hold::Matched => "matched",
        }
    }
}

/// A `sampled` block.
#[derive(Clone, Debug)]
pub struct Sampling {
    /// Period in seconds.
    pub period: f64,
    /// Its hold.
    pub hold: Hold,
    /// Whether the block names it.
    pub hold_given: bool,
    /// Whether the energy budget is on.
    pub budget: bool,
    /// The stepper, where the block names one.
    pub method: Option<String>,
    /// How long after a sample what was found there is held, s.
    pub latency: f64,
    /// Its head.
    pub span: Span,
}

/// What a symbol of the pool stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Signal {
    /// Time.
    Time,
    /// Effort of a bond.
    Effort(BondId),
    /// Flow of a bond, along its half arrow.
    Flow(BondId),
    /// State of a storage.
    State(ElementId),
    /// An `integral(...)`.
    Integral(usize),
    /// The argument of a resistor's law.
    Argument(ElementId),
    /// The parameter of a resistor's law that is a curve.
    Parameter(ElementId),
    /// An `input`.
    Input(usize),
    /// What an `input` changes by in a second.
    Slope(usize),
    /// A signal state.
    Memory(usize),
    /// A `delay(...)`: what a signal was some time ago.
    Delay(usize),
}

/// `input u = value`: a signal given from outside.
#[derive(Clone, Debug)]
pub struct Input {
    /// Its path.
    pub name: String,
    /// Its symbol.
    pub symbol: Symbol,
    /// The symbol of what it changes by in a second, 0 where it jumps.
    pub slope: Symbol,
    /// Its unit, where it is determined.
    pub unit: Option<DisplayUnit>,
    /// What it is where nothing is given, SI.
    pub value: f64,
    /// Its name's place.
    pub span: Span,
}

/// A signal state: `state z = z0 { dz = law }`, in a sampled region `{ next = law }`.
#[derive(Clone, Debug)]
pub struct Memory {
    /// Its path.
    pub name: String,
    /// Its symbol.
    pub symbol: Symbol,
    /// Its unit, where it is determined.
    pub unit: Option<DisplayUnit>,
    /// Value at the start, SI.
    pub start: f64,
    /// dz/dt; of a sampled one, what z is an interval later.
    pub law: Expr,
    /// The sampled block it stands in.
    pub sampling: Option<usize>,
    /// Its name's place.
    pub span: Span,
}

/// `delay(signal, time, start)`.
///
/// In a `sampled` block a signal state holds the signal for the first period, and this is what that state was the
/// other periods ago. In continuous time it is the signal itself, a time ago.
#[derive(Clone, Debug)]
pub struct Delay {
    /// Its name.
    pub name: String,
    /// Its symbol.
    pub symbol: Symbol,
    /// What is delayed: of a sampled one, the signal state.
    pub signal: Expr,
    /// What it is until then, SI.
    pub start: f64,
    /// By how long the signal is delayed, s.
    pub time: f64,
    /// Of a sampled one, by how many periods the signal state is: one less than the signal.
    pub periods: Option<u32>,
    /// What it is of.
    pub of: Delayed,
    /// Where it stands.
    pub span: Span,
}

impl Delay {
    /// Whether it is no more than its signal state.
    pub fn is_state(&self) -> bool {
        self.periods == Some(0) && self.of == Delayed::Signal
    }
}

/// What is delayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delayed {
    /// A signal.
    Signal,
    /// A wave on a line: in a sampled block what went in over an interval comes out over another one.
    Wave,
    /// A wave that leaves at an open port: what comes in there is told from outside.
    Leaving,
}

/// A lossless line, `TL(a, b):line { ... }`, or an open port that carries waves: half a line.
#[derive(Clone, Debug)]
pub struct TransmissionLine {
    /// Its path.
    pub name: String,
    /// Its ports: two, or the open one.
    pub ends: Vec<ElementId>,
}

/// `integral(expr, start)`.
#[derive(Clone, Debug)]
pub struct Integral {
    /// Its symbol.
    pub symbol: Symbol,
    /// What is integrated.
    pub rate: Expr,
    /// Value at the start, SI.
    pub start: f64,
    /// Where it stands.
    pub span: Span,
}

/// A named output.
#[derive(Clone, Debug)]
pub struct Probe {
    /// Its name.
    pub name: String,
    /// What it shows, in SI.
    pub value: Expr,
    /// Its unit, where it is determined.
    pub unit: Option<DisplayUnit>,
    /// Where it stands.
    pub span: Span,
}

/// An `expect`.
#[derive(Clone, Debug)]
pub struct Expectation {
    /// As written.
    pub text: String,
    /// What it asks.
    pub kind: ExpectationKind,
    /// Where it stands.
    pub span: Span,
}

/// Where something drives what is behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meeting {
    /// A source or an open port, which puts in what it supplies.
    Element(ElementId),
    /// A double bar, where what crosses into the holder is put in.
    Bar(BondId),
}

/// What an `expect` asks.
#[derive(Clone, Debug)]
pub enum ExpectationKind {
    /// The ledger shows a passive run.
    Passive,
    /// No more is drawn there than was put in and stored at the start.
    PassiveAt(Meeting),
    /// A value at an instant.
    At {
        /// What is looked at.
        value: Expr,
        /// When, s.
        time: f64,
        /// What it should be.
        target: f64,
        /// By how much it may be off.
        tolerance: f64,
    },
    /// A comparison that holds at every row; extremes over the run were replaced by symbols.
    Holds {
        /// The comparison.
        condition: Expr,
        /// Each symbol, the expression it is an extreme of, and whether it is the largest.
        extremes: Vec<(Symbol, Expr, bool)>,
    },
}

/// What `simulate` says; `None` where it says nothing.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// End of the run, s.
    pub stop: Option<f64>,
    /// Fixed step, s.
    pub step: Option<f64>,
    /// Stepper.
    pub method: Option<(String, Span)>,
    /// Error allowed in a step, relative.
    pub tolerance: Option<f64>,
    /// Distance of the rows of output, s.
    pub every: Option<f64>,
    /// Where `step` is said.
    pub step_at: Option<Span>,
    /// Where `every` is said.
    pub every_at: Option<Span>,
    /// Length of a step, or of a long one of those that are fitted, of the run that programs are made for, s.
    pub pace: f64,
    /// End of the run that programs are made for, s.
    pub end: f64,
    /// The numbers that programs are chosen and written by.
    pub thresholds: Thresholds,
}

/// A parameter of the scene or of an instance.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its path.
    pub name: String,
    /// Its symbol in the pool.
    pub symbol: Symbol,
    /// Its value, SI.
    pub value: f64,
    /// Its unit; `None` for the literal 0, which has every unit.
    pub unit: Option<DisplayUnit>,
}

/// A part of the scene: an instance of a model, or a two-port by a matrix.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its path.
    pub name: String,
    /// Its model; the kind of a two-port by a matrix, as it is written.
    pub kind: String,
    /// Whether it is a two-port by a matrix, `TF(a[1..3], b[1..2]):arm`.
    pub matrix: bool,
}

/// Which way a signal of a part goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exchange {
    /// An `input` that the instance binds.
    Input,
    /// An `output`.
    Output,
}

/// A signal that a part is given, or gives.
#[derive(Clone, Debug)]
pub struct Exchanged {
    /// Its path.
    pub name: String,
    /// Which way it goes.
    pub way: Exchange,
    /// What it is, as written: in the names around the instance if the part is given it, else in those of the part.
    pub value: String,
    /// Its unit; `None` where nothing reads it, or where its entries have several.
    pub unit: Option<DisplayUnit>,
}

/// A flat model.
#[derive(Clone, Debug)]
pub struct Model {
    /// Name of the scene.
    pub name: String,
    /// Doc of the scene.
    pub docs: Vec<String>,
    /// Its declaration.
    pub span: Span,
    /// All expressions.
    pub pool: Pool,
    /// Elements in order of declaration.
    pub elements: Vec<Element>,
    /// Bonds in order of declaration.
    pub bonds: Vec<Bond>,
    /// Multiport fields in order of declaration.
    pub fields: Vec<Field>,
    /// Lossless lines in order of declaration.
    pub lines: Vec<TransmissionLine>,
    /// `sampled` blocks.
    pub samplings: Vec<Sampling>,
    /// Integrals.
    pub integrals: Vec<Integral>,
    /// Inputs in order of declaration.
    pub inputs: Vec<Input>,
    /// Signal states in order of declaration.
    pub memories: Vec<Memory>,
    /// The parts, each after the one that it stands in.
    pub parts: Vec<Part>,
    /// The path of each entry of a bundle, `arm.v[2]`, and that of the bundle, `arm.v[1..3]`.
    pub bundles: FxHashMap<String, String>,
    /// The signals that parts are given and give, in order of declaration.
    pub exchanged: Vec<Exchanged>,
    /// Delays, in the order in which they were met.
    pub delays: Vec<Delay>,
    /// Probes in order of declaration.
    pub probes: Vec<Probe>,
    /// Expectations in order of declaration.
    pub expectations: Vec<Expectation>,
    /// What `simulate` says.
    pub settings: Settings,
    /// Parameters.
    pub parameters: Vec<Parameter>,
    /// What the symbols stand for.
    pub signals: FxHashMap<Symbol, Signal>,
    /// Unit of each bond's effort and flow, where determined.
    pub units: Vec<(Option<DisplayUnit>, Option<DisplayUnit>)>,
    /// For each bond, whether effort times flow is no power.
    pub pseudo: Vec<bool>,
    /// What its text says that the author may not have meant, a sentence each.
    pub remarks: Vec<String>,
}

impl Model {
    /// The element with this id.
    pub fn element(&self, id: ElementId) -> &Element {
        &self.elements[id.at()]
    }

    /// The bond with this id.
    pub fn bond(&self, id: BondId) -> &Bond {
        &self.bonds[id.at()]
    }

    /// The place of a bond's variable, as seen from one of its ends, among four a bond: a double bar has its pair
    /// twice, once on each side.
    pub fn place(&self, bond: BondId, end: ElementId, variable: Variable) -> usize {
        let b = self.bond(bond);
        4 * bond.at() + 2 * usize::from(b.sampled && b.head == end) + usize::from(variable == Variable::Flow)
    }

    /// The bonds of each element, in order of declaration.
    pub fn bonds_of(&self) -> Vec<Vec<BondId>> {
        let mut list = vec![Vec::new(); self.elements.len()];
        for (i, bond) in self.bonds.iter().enumerate() {
            list[bond.tail.at()].push(BondId(i as u32));
            list[bond.head.at()].push(BondId(i as u32));
        }
        list
    }

    /// Puts an inertia of 0 on a 1-junction, whose flow then is a speed of its own.
    pub fn add_massless(&mut self, junction: ElementId) {
        let owner = self.element(junction).clone();
        let state = self.pool.symbol(&format!("{}.p", owner.name));
        let zero = self.pool.int(0);
        self.signals.insert(state, Signal::State(ElementId(self.elements.len() as u32)));
        let law = Law::Storage(Storage {
            state,
            energy: zero,
            coenergy: zero,
            linear: None,
            initial: 0.0,
            explicit: false,
            bounded: true,
            massless: true,
        });
        self.add_at(junction, Kind::I, law, "its speed");
    }

    /// Puts a multiplier on a bond of which both ends would give this variable: the two are to be equal, and the other
    /// variable is what sees to that. Where the bond ends at a junction that sums the variable, the multiplier is
    /// bonded to it; elsewhere to a junction of its own between the two ends.
    pub fn add_multiplier(&mut self, bond: BondId, both: Variable) {
        let (kind, sums) = (Kind::OnePort(OnePort::Multiplier(both.other())), Kind::Junction(both.other()));
        let b = self.bond(bond).clone();
        let own = [b.head, b.tail].into_iter().find(|end| self.element(*end).kind == sums);
        let junction = own.unwrap_or_else(|| {
            let id = ElementId(self.elements.len() as u32);
            let end = self.element(b.head).clone();
            self.elements.push(Element { name: b.name.clone(), kind: sums, law: Law::Junction, added: true, ..end });
            self.bonds[bond.at()].head = id;
            self.bonds.push(Bond { tail: id, stroke: None, ..b });
            self.like(bond);
            id
        });
        self.add_at(junction, kind, Law::Multiplier, "its multiplier");
    }

    /// Bonds an element that the compiler adds to a junction.
    fn add_at(&mut self, junction: ElementId, kind: Kind, law: Law, what: &str) {
        let Some(neighbour) = self.bonds.iter().position(|b| b.tail == junction || b.head == junction) else { return };
        let owner = self.element(junction).clone();
        let bond = Bond {
            tail: junction,
            head: ElementId(self.elements.len() as u32),
            sampled: false,
            resolution: None,
            stroke: None,
            name: format!("{} -> {what}", owner.name),
            span: owner.span,
        };
        self.elements.push(Element { kind, law, active: false, field: None, line: None, added: true, ..owner });
        self.bonds.push(bond);
        self.like(BondId(neighbour as u32));
    }

    /// Has the last bond the units of another one.
    fn like(&mut self, bond: BondId) {
        self.units.push(self.units[bond.at()].clone());
        self.pseudo.push(self.pseudo[bond.at()]);
    }

    /// A value of a bond's variable in words, with its unit.
    pub fn quantity(&self, bond: BondId, variable: Variable, value: f64) -> String {
        let (effort, flow) = self.units.get(bond.at()).cloned().unwrap_or_default();
        let unit = if variable == Variable::Effort { effort } else { flow };
        // Without what is rounding.
        let value: f64 = format!("{value:.11e}").parse().unwrap_or(value);
        match unit.filter(|unit| !unit.is_one()) {
            Some(unit) => format!("{value} {unit}"),
            None => value.to_string(),
        }
    }

    /// An error of an element and of others that it has to do with. Where they stand in several parts of the scene, it
    /// is told there, and not in the models of the parts.
    pub fn error_of(
        &self,
        code: &'static str,
        message: String,
        (first, others): (ElementId, &[ElementId]),
        what: &str,
    ) -> Diagnostic {
        let part = |id: ElementId| self.element(id).part;
        let apart = others.iter().any(|id| part(*id) != part(first));
        let place = |id: ElementId| part(id).filter(|_| apart).unwrap_or(self.element(id).span);
        let mut error = Diagnostic::error(code, place(first), message);
        for id in others {
            let place = place(*id);
            if error.labels.iter().all(|l| l.span != place) {
                error = error.label(place, what);
            }
        }
        let e = self.element(first);
        if place(first) != e.span {
            error = error.label(e.span, format!("`{}` is declared here", e.name));
        }
        error
    }

    /// Elements with their ids.
    pub fn ids(&self) -> impl Iterator<Item = (ElementId, &Element)> {
        self.elements.iter().enumerate().map(|(i, e)| (ElementId(i as u32), e))
    }
}
