//! From syntax trees to the flat [`Model`]: instances, loops, names, units, values.
//!
//! Two walks. The first (`expand`) makes instances and notes names and bonds; only constants are evaluated in it. Then
//! ports are joined (`join`) and, with every bond known, the second turns values into expressions (`express`,
//! [`crate::element`]), and units are solved (`infer`).

mod angle;
mod array;
mod bond;
mod bundle;
mod delay;
mod domain;
mod equation;
mod expand;
mod express;
mod finish;
mod function;
mod infer;
mod join;
mod library;
mod limits;
mod load;
mod matrix;
mod name;
mod reading;
mod resolution;
mod settings;
mod signal;
mod suggest;
mod table;
mod unknown;
mod value;

pub use equation::{Equation, Unit};
pub use infer::Inference;
pub use library::LIBRARY;
pub use limits::Limits;
pub use load::{Files, Loader, NoFiles, load};
pub use suggest::{distance, foreign, meant, nearest};
pub(crate) use value::Value;

use crate::Options;
use crate::expression::{Expr, Pool, Symbol};
use crate::model::{Bond, BondId, Element, ElementId, Exchange, Integral, Kind, Model, Sampling, Signal};
use crate::units::{BaseUnits, Dimension};
use bond_grammar::ast::{self, Stroke};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{SourceId, Sources, Span};
use rustc_hash::{FxHashMap, FxHashSet};

/// A number as messages tell it: with an exponent where it would be a row of zeros.
pub fn told(x: f64) -> String {
    if x == 0.0 || !x.is_finite() || (1e-9..1e15).contains(&x.abs()) { x.to_string() } else { format!("{x:e}") }
}

type ScopeId = usize;

/// An expression and its unit.
#[derive(Clone, Debug)]
pub(crate) struct Typed {
    /// The expression.
    pub expr: Expr,
    /// Its unit.
    pub unit: Unit,
}

#[derive(Clone, Copy, Debug)]
enum Entity {
    Element(ElementId),
    Instance(usize),
    Port(usize),
    Param(usize),
    Let(usize),
    Function(usize),
    /// An index of `raw_bonds`.
    Bond(usize),
    Input(usize),
    Memory(usize),
    /// A multiport field.
    Field(usize),
    /// Entries of a name, `v[1..3]`: an index of `bundles`.
    Bundle(usize),
    /// Declared, but wrong: said already.
    Missing,
}

struct Instance<'a> {
    model: load::ModelRef,
    path: String,
    scope: ScopeId,
    names: FxHashMap<String, (Entity, Span)>,
    /// What it is given, the scope in which that stands, and the `sampled` block there.
    given: (&'a [ast::Field], ScopeId, Option<usize>),
    /// The instance that it stands in; the scene's own is the scene.
    outer: usize,
    /// Where it is declared.
    span: Span,
    /// Names whose declarations could not be made, which is said; without indices.
    lost: FxHashSet<String>,
    /// What a `for` without a round declares: names, and from where to where it counts.
    unmade: Vec<(String, i64, i64)>,
    /// Bonds of it could not be made, which is said: what seems to lack one may have been meant.
    frayed: bool,
    /// Its outputs.
    outputs: Vec<String>,
    /// Of a two-port by a matrix, which is no instance of a model: its kind as written.
    kind: Option<&'a str>,
}

impl Instance<'_> {
    fn new(model: load::ModelRef, path: String, scope: ScopeId, outer: usize, span: Span) -> Self {
        let (names, lost) = (FxHashMap::default(), FxHashSet::default());
        let (given, unmade, outputs) = ((&[][..], scope, None), Vec::new(), Vec::new());
        Self { model, path, scope, names, given, outer, span, lost, unmade, frayed: false, outputs, kind: None }
    }

    /// A name that is not taken, for a mend.
    fn free(&self, wish: &str) -> String {
        let mut numbered = (2..).map(|n| format!("{wish}{n}"));
        match self.names.contains_key(wish) {
            true => numbered.find(|name| !self.names.contains_key(name)).unwrap_or_default(),
            false => wish.to_string(),
        }
    }
}

struct Scope {
    instance: usize,
    parent: Option<ScopeId>,
    loop_variable: Option<(String, i64)>,
    locals: FxHashMap<String, (Entity, Span)>,
    /// In a bundle, which entry the values in it are for.
    entry: Option<bundle::Entry>,
    /// In a two-port by a matrix: which one, and the row and the column of its ratio.
    cell: Option<(usize, usize, usize)>,
}

#[derive(Clone)]
enum ParamState {
    New,
    Open,
    Done(Option<Value>),
}

struct Param<'a> {
    name: String,
    span: Span,
    /// The instance that it is a parameter of.
    instance: usize,
    /// The `sampled` block in which it is given.
    sampling: Option<usize>,
    value: Option<(&'a ast::Expr, ScopeId)>,
    /// Whether the value was given where the instance is made, and is no default.
    given: bool,
    state: ParamState,
    overridden: Option<(f64, Option<Dimension>)>,
}

#[derive(Clone)]
enum LetState {
    New,
    Open,
    Done(Option<Value>),
}

struct Let<'a> {
    value: &'a ast::Expr,
    scope: ScopeId,
    /// The `sampled` block that the value stands in.
    sampling: Option<usize>,
    /// Where it is the input of a part that is given there: what the part says of it.
    input: Option<Box<signal::Bound<'a>>>,
    /// Where it is an output, the place of its name.
    output: Option<Span>,
    state: LetState,
    name: String,
}

/// A declared element whose law is not made yet.
pub(crate) struct Decl<'a> {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) ast: Option<&'a ast::Element>,
    pub(crate) scope: usize,
    pub(crate) sampling: Option<usize>,
    pub(crate) span: Span,
    /// The field that it is a port of, and which one.
    pub(crate) field: Option<(usize, usize)>,
}

/// A multiport field: what its ports are called, and the elements that they are.
pub(crate) struct FieldDecl<'a> {
    pub(crate) name: String,
    pub(crate) ast: &'a ast::Element,
    pub(crate) ports: Vec<String>,
    pub(crate) members: Vec<ElementId>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum RawEnd {
    Element(ElementId),
    /// A port of an instance; true for its inside.
    Port(usize, bool),
}

struct RawBond<'a> {
    tail: RawEnd,
    head: RawEnd,
    sampled: bool,
    /// In what steps its motion is read.
    resolution: Option<(&'a ast::Expr, ScopeId)>,
    stroke: Option<Stroke>,
    name: String,
    span: Span,
}

struct PortDecl {
    name: String,
    span: Span,
    /// Raw bonds on the inside, and whether the port is their tail.
    inside: Vec<(usize, bool)>,
    /// The same on the outside.
    outside: Vec<(usize, bool)>,
    /// The instance that it is a port of.
    instance: usize,
}

/// The elaboration in progress.
pub(crate) struct Elaborator<'a> {
    files: &'a Files,
    sources: &'a Sources,
    limits: Limits,
    pub(crate) pool: Pool,
    pub(crate) errors: Vec<Diagnostic>,
    /// Kinds of elements that are told to be unknown, by where they stand.
    unknown_kinds: FxHashSet<Span>,
    stack: Vec<load::ModelRef>,
    instances: Vec<Instance<'a>>,
    scopes: Vec<Scope>,
    params: Vec<Param<'a>>,
    lets: Vec<Let<'a>>,
    /// Those that are being computed, each for the one before it.
    open_lets: Vec<usize>,
    functions: function::Functions<'a>,
    pub(crate) elements: Vec<Decl<'a>>,
    pub(crate) fields: Vec<FieldDecl<'a>>,
    /// From which index to which bundles go.
    bundles: Vec<(i64, i64)>,
    /// The path of each entry of a bundle, and that of the bundle.
    entries: FxHashMap<String, String>,
    pub(crate) two_ports: Vec<matrix::MatrixTwoPort<'a>>,
    open_ports: Vec<(ElementId, &'a [ast::Field], ScopeId)>,
    /// Those of them that carry waves.
    wave_ports: Vec<ElementId>,
    ports: Vec<PortDecl>,
    raw_bonds: Vec<RawBond<'a>>,
    /// 1-ports in a list that does not end its chain, and the mend.
    listed: FxHashMap<ElementId, String>,
    samplings: Vec<Sampling>,
    /// Name, place, and which `let` it is.
    probes: Vec<(String, Span, usize)>,
    simulate: Vec<(&'a [ast::Field], ScopeId)>,
    expects: Vec<(&'a ast::Expect, Span, ScopeId)>,
    rounds: u64,
    /// What is right and may not be meant: where it stands, the name that it is about, and in words.
    remarks: Vec<(Span, String, String)>,
    /// The texts have errors of their own: what they lack may be what could not be read.
    ruined: bool,
    // known after the bonds are joined
    pub(crate) bonds: Vec<Bond>,
    /// The flat bond of each raw one.
    merged: Vec<Option<BondId>>,
    pub(crate) bonds_of: Vec<Vec<BondId>>,
    /// By element: a bond of it could not be made, which is said.
    torn: Vec<bool>,
    pub(crate) domain_of: Vec<usize>,
    pub(crate) equations: Vec<Equation>,
    /// Units that are written, and whose part in angles follows from their use.
    angles: Vec<angle::Declared>,
    /// The element whose law is being made.
    pub(crate) owner: Option<ElementId>,
    signals: FxHashMap<Symbol, Signal>,
    symbol_of: FxHashMap<Signal, Symbol>,
    integrals: Vec<Integral>,
    inputs: Vec<signal::Given<'a>>,
    memories: Vec<signal::Remembered<'a>>,
    /// The names of all numbers of `inputs` and of `memories`.
    numbers: signal::Numbers,
    /// Outputs of `sampled` blocks that are read outside of these.
    held: Vec<signal::Held>,
    /// The `let`s that are inputs and outputs of parts.
    exchanged: Vec<(usize, Exchange)>,
    /// The `sampled` block that what is being worked out stands in.
    pub(crate) sampling: Option<usize>,
    delays: Vec<delay::Delayed>,
    /// Names that mean something only in the law that is being read: `q`, `f`.
    pub(crate) locals: Vec<(String, Typed)>,
    mode: Mode,
    /// How many expressions are being worked out inside one another, by way of the names in them.
    depth: usize,
    extremes: Vec<(Symbol, Expr, bool)>,
    energies: Vec<Option<Expr>>,
    /// Storages whose energies are being read, each by the law of the one before; whether one of them was asked for
    /// again.
    asked: Vec<ElementId>,
    circular: bool,
    /// What was found wrong in reading them.
    untold: Vec<Diagnostic>,
    /// `--set`, by path.
    overrides: FxHashMap<String, (f64, Option<Dimension>)>,
    base_units: BaseUnits,
}

/// What a name is looked up for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sought {
    /// An element, an instance, a port: the end of a bond, or what has signals.
    Element,
    /// A value: it stands alone in an expression.
    Value,
    /// A part of an instance, behind a dot.
    Part,
}

/// What an expression may name.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Parameters and numbers only; the structure is not there yet.
    Constant,
    /// Signals too.
    Signals,
    /// Signals and `integral`.
    Outputs,
    /// Signals, and `max(x)`, `min(x)` over the run.
    Expect,
}

/// A model with errors.
#[derive(Debug)]
pub struct Broken {
    /// All that is wrong with it.
    pub errors: Vec<Diagnostic>,
    /// What it is apart from its outputs and units, where nothing else is wrong: more can be said of that.
    pub model: Option<Box<Model>>,
}

/// Elaborates the scene of a source.
///
/// # Errors
/// All that is wrong with the text, the names, the values and the units.
pub fn elaborate(
    sources: &Sources,
    main: SourceId,
    files: &Files,
    options: &Options,
    mut errors: Vec<Diagnostic>,
) -> Result<Model, Broken> {
    let at = Span { source: main, start: 0, end: 0 };
    let scene = match scene(files, options, at) {
        Ok(scene) => scene,
        Err(e) => {
            // A file that could not be read to its end may well lack its model.
            if errors.is_empty() {
                errors.push(e);
            }
            return Err(Broken { errors, model: None });
        }
    };
    let e = Elaborator {
        files,
        sources,
        limits: options.limits.clone(),
        pool: Pool::new(),
        ruined: !errors.is_empty(),
        errors,
        unknown_kinds: FxHashSet::default(),
        stack: vec![],
        instances: vec![],
        scopes: vec![],
        params: vec![],
        lets: vec![],
        open_lets: vec![],
        functions: Default::default(),
        elements: vec![],
        fields: vec![],
        bundles: vec![],
        entries: FxHashMap::default(),
        two_ports: vec![],
        open_ports: vec![],
        wave_ports: vec![],
        ports: vec![],
        raw_bonds: vec![],
        listed: FxHashMap::default(),
        samplings: vec![],
        probes: vec![],
        simulate: vec![],
        expects: vec![],
        rounds: 0,
        remarks: vec![],
        bonds: vec![],
        merged: vec![],
        bonds_of: vec![],
        torn: vec![],
        domain_of: vec![],
        equations: vec![],
        owner: None,
        signals: FxHashMap::default(),
        symbol_of: FxHashMap::default(),
        integrals: vec![],
        inputs: vec![],
        memories: vec![],
        numbers: signal::Numbers::default(),
        held: vec![],
        exchanged: vec![],
        sampling: None,
        delays: vec![],
        locals: vec![],
        mode: Mode::Constant,
        depth: 0,
        extremes: vec![],
        energies: vec![],
        asked: vec![],
        circular: false,
        untold: vec![],
        overrides: FxHashMap::default(),
        angles: Vec::new(),
        base_units: options.base_units,
    };
    e.scene(scene, options).map_err(|broken| Broken { errors: once(broken.errors), ..broken })
}

/// The first error of each code at each place: rounds of a loop and instances of a model would only repeat it.
fn once(mut errors: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let mut told = FxHashSet::default();
    // What is given on the command line has no place of its own.
    errors.retain(|e| e.code == "elaborate::set" || told.insert((e.code, e.labels.first().map(|l| l.span))));
    errors
}

fn scene(files: &Files, options: &Options, at: Span) -> Result<load::ModelRef, Diagnostic> {
    let first = files.list.first().map(|f| f.items.as_slice()).unwrap_or(&[]);
    let models = || {
        first.iter().enumerate().filter_map(|(i, item)| match item {
            ast::Item::Model(m) => Some((i, m)),
            ast::Item::Use(_) | ast::Item::Function(_) => None,
        })
    };
    match &options.model {
        None => models().next_back().map(|(i, _)| (0, i)).ok_or_else(|| {
            Diagnostic::error("elaborate::empty", at, "there is no model in this file")
                .help("write `model Name { ... }`")
        }),
        Some(name) => models().rfind(|(_, m)| m.name.text == *name).map(|(i, _)| (0, i)).ok_or_else(|| {
            let known: Vec<&str> = models().map(|(_, m)| m.name.text.as_str()).collect();
            Diagnostic::error("elaborate::model", at, format!("there is no model `{name}` in this file"))
                .help(format!("its models are {}", known.join(", ")))
        }),
    }
}

impl<'a> Elaborator<'a> {
    fn new_scope(&mut self, instance: usize, parent: Option<ScopeId>, loop_variable: Option<(String, i64)>) -> ScopeId {
        let locals = FxHashMap::default();
        self.scopes.push(Scope { instance, parent, loop_variable, locals, entry: None, cell: None });
        self.scopes.len() - 1
    }

    fn scene(mut self, scene: load::ModelRef, options: &Options) -> Result<Model, Broken> {
        let Some(decl) = self.files.model(scene) else { return Err(Broken { errors: self.errors, model: None }) };
        self.pending_overrides(options);
        self.instantiate(scene, String::new(), None, None, decl.name.span);
        self.number_signals();
        if self.errors.iter().any(|e| e.code == "elaborate::limit") {
            // Most of the model may not have been made.
            return Err(Broken { errors: self.errors, model: None });
        }
        self.unknown_overrides(options, decl.name.span);
        self.join_ports();
        self.finish(decl)
    }

    /// Has errors of an element's law stand where the values in it were given, if that is not where its law is.
    fn blame_what_was_given(&mut self, id: ElementId, before: usize) {
        for i in before..self.errors.len() {
            let error = &self.errors[i];
            let Some(place) = error.labels.first().map(|l| l.span) else { continue };
            if !matches!(error.code, "elaborate::value" | "elaborate::law" | "elaborate::initial") {
                continue;
            }
            let decl = &self.elements[id.at()];
            let part = expand::part(&decl.name);
            let given = expand::given(&self.params, self.sources, part, self.sources.slice(place));
            if part.is_empty() || given.is_empty() {
                continue;
            }
            let mut error = domain::at_its_origin(error.clone(), given);
            if error.help.as_ref().is_some_and(|h| h.contains("`active R")) {
                error = error.help("give another value there: a part's own resistors take power");
            }
            self.errors[i] = error;
        }
    }

    /// All elements that could be made, with their laws.
    fn laws(&mut self) -> Vec<Option<Element>> {
        let all = (0..self.elements.len() as u32).map(|i| {
            self.owner = Some(ElementId(i));
            self.sampling = self.elements[i as usize].sampling;
            let before = self.errors.len();
            let law = self.law(ElementId(i));
            self.blame_what_was_given(ElementId(i), before);
            law
        });
        let laws = all.collect();
        (self.owner, self.sampling) = (None, None);
        laws
    }
}
