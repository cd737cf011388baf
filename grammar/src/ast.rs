//! The syntax tree of one file, as written: no name is resolved, no instance made, no unit looked up.
//!
//! Made by [`crate::parse`], read by `format` and by the compiler's elaboration. Every node carries its span.
//! Absent on purpose: meaning. A tree may name elements that nobody declared.

use crate::source::Span;

/// An identifier and its place.
#[derive(Clone, Debug, PartialEq)]
pub struct Name {
    /// As written.
    pub text: String,
    /// Where.
    pub span: Span,
}

/// A comment; the formatter puts it back. `///` and `//!` docs are comments here as well as in `docs` fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Comment {
    /// With its slashes, without the newline.
    pub text: String,
    /// Where.
    pub span: Span,
}

/// A file.
#[derive(Clone, Debug, PartialEq)]
pub struct File {
    /// Lines of the `//!` doc, without the slashes.
    pub docs: Vec<String>,
    /// `use`s, functions and models in order.
    pub items: Vec<Item>,
    /// All comments in order of place.
    pub comments: Vec<Comment>,
    /// Whether an item could not be read, which is said.
    pub gaps: bool,
    /// The whole text.
    pub span: Span,
}

/// A declaration of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// `use ...`
    Use(Use),
    /// `model ...`
    Model(Model),
    /// `let f(x) = expr`, for all models of the file.
    Function(Function),
}

/// `use "path.bond"` or `use std.mechanics`.
#[derive(Clone, Debug, PartialEq)]
pub struct Use {
    /// What is used.
    pub target: UseTarget,
    /// The whole declaration.
    pub span: Span,
}

/// What a `use` names.
#[derive(Clone, Debug, PartialEq)]
pub enum UseTarget {
    /// A path relative to the file, without the quotes.
    File(String),
    /// A bundled library, `std.mechanics` as two names.
    Library(Vec<Name>),
}

/// `model Name(params) { body }`.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Lines of the `///` doc, without the slashes.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Name,
    /// Its parameters.
    pub params: Vec<Param>,
    /// Its statements in order.
    pub body: Vec<Statement>,
    /// Names whose declarations could not be read, in order. That is reported, so later stages say nothing of them.
    pub lost: Vec<String>,
    /// The whole declaration.
    pub span: Span,
}

/// A parameter `name = default`.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// Lines of the `///` doc, without the slashes.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Name,
    /// Its default; absent means that every instance must give it.
    pub default: Option<Expr>,
    /// The whole of it.
    pub span: Span,
}

/// `let f(x, y) = value`: a function, evaluated with the arguments of each call.
#[derive(Clone, Debug, PartialEq)]
pub struct Function {
    /// Lines of the `///` doc, without the slashes.
    pub docs: Vec<String>,
    /// Its name.
    pub name: Name,
    /// What its arguments are called.
    pub arguments: Vec<Name>,
    /// What it gives.
    pub value: Expr,
    /// The whole of it.
    pub span: Span,
}

/// A statement of a body, with its doc.
#[derive(Clone, Debug, PartialEq)]
pub struct Statement {
    /// Lines of the `///` doc, without the slashes.
    pub docs: Vec<String>,
    /// What it says.
    pub kind: StatementKind,
    /// The whole of it.
    pub span: Span,
}

/// What a statement says.
#[derive(Clone, Debug, PartialEq)]
pub enum StatementKind {
    /// `I:mass = 1 kg`, `Wall:wall(k = 2 N/m)`, `1:v`.
    Element(Element),
    /// `F -> 1:v -> mass, spring`.
    Chain(Chain),
    /// `port tip { inertia = 0.1 kg }`, `port hand[1..3]`; index and fields may be empty.
    Port(Name, Vec<Expr>, Vec<Field>),
    /// `sampled at 25 Hz hold lagged budget off { ... }`.
    Sampled(Sampled),
    /// `for i in 1..n { ... }`.
    For(For),
    /// `if cond { ... } else { ... }`; `else if` is an `If` alone in the second block.
    If(If),
    /// `input u = 0 N`.
    Input(Definition),
    /// `output u = expr`.
    Output(Definition),
    /// `let x = expr`.
    Let(Definition),
    /// `let f(x) = expr`.
    Function(Function),
    /// `probe x = expr`.
    Probe(Definition),
    /// `state z = z0 { dz = expr }`.
    State(Definition, Vec<Field>),
    /// `simulate { stop = 10 s }`.
    Simulate(Vec<Field>),
    /// `expect ...`.
    Expect(Expect),
}

/// A name and what it stands for: `x = expr`, `x[i] = expr`.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// The name.
    pub name: Name,
    /// `[i]`, `[i, j]`, `[i][j]`; empty for a plain name.
    pub index: Vec<Expr>,
    /// What stands behind the `=`.
    pub value: Expr,
}

/// An element or an instance: `KIND(ports):name[index](args) = value`, or `{ fields }` in the place of the value.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Written `active R:name`.
    pub active: bool,
    /// `I`, `MSe`, `0`, or the name of a model.
    pub kind: Name,
    /// Ports of a multiport field or of a matrix two-port: `C(x, y)`, `IC(I p1, C q1)`, `RS(r, th)`,
    /// `TF(a[1..3], b[1..2])`. Empty for everything else.
    pub ports: Vec<FieldPort>,
    /// Its name.
    pub name: Name,
    /// `[i]`, `[i, j]`, `[i][j]`; empty for a plain name.
    pub index: Vec<Expr>,
    /// Arguments of an instance.
    pub args: Vec<Field>,
    /// `= value`.
    pub value: Option<Expr>,
    /// `{ field = value; ... }`, with the braces' span.
    pub fields: Option<(Vec<Field>, Span)>,
    /// The whole of it.
    pub span: Span,
}

/// A port of a multiport field, `p1`, or `I p1` in a mixed one; of a matrix two-port, `a[1..3]`.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldPort {
    /// `I` or `C` in a mixed field.
    pub kind: Option<Name>,
    /// Its name.
    pub name: Name,
    /// `[1..3]`; empty for a single port.
    pub index: Vec<Expr>,
}

/// `path = value` in braces or parentheses. The path is a name such as `H`, or dotted such as `a.e`.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// What is set.
    pub path: Vec<Name>,
    /// To what.
    pub value: Expr,
    /// The whole of it.
    pub span: Span,
}

impl Field {
    /// The path as it is written.
    pub fn name(&self) -> String {
        self.path.iter().map(|n| n.text.as_str()).collect::<Vec<_>>().join(".")
    }
}

/// Bonds in a row: at least two groups of ends, an arrow between each two neighbours.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// One or more groups; each group is a comma-separated list of ends.
    pub groups: Vec<Vec<End>>,
    /// `groups.len() - 1` arrows.
    pub arrows: Vec<Arrow>,
    /// `resolution 0.05 mm` behind them: in what steps the motion is read at its double bars.
    pub resolution: Option<Expr>,
}

/// An end of a bond.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// A name declared elsewhere: `spring`, `wall.tip`, `c[i-1]`.
    Path(Path),
    /// A declaration where it is first used: `1:v`, `0:node[i]`. Has no args, value or fields.
    Declare(Element),
}

/// A bond's arrow.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrow {
    /// True for `||>`.
    pub sampled: bool,
    /// Asserted causal stroke.
    pub stroke: Option<Stroke>,
    /// Name in `-[name]->`, with its index, if any.
    pub name: Option<(Name, Vec<Expr>)>,
    /// The whole of it.
    pub span: Span,
}

/// Which end of a bond carries the causal stroke, that is, receives the effort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// `->|`
    Head,
    /// `|->`
    Tail,
}

/// `sampled at RATE` or `sampled every PERIOD`, and what is in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampled {
    /// The rate or the period.
    pub clock: Clock,
    /// `hold lagged`.
    pub hold: Option<Name>,
    /// `budget off` gives `Some(false)`, `budget on` `Some(true)`.
    pub budget: Option<bool>,
    /// `method ray` after the hold, if any.
    pub method: Option<Name>,
    /// `latency 0.3 ms`: how long after its samples a value is held that was found there.
    pub latency: Option<Expr>,
    /// Its statements.
    pub body: Vec<Statement>,
}

/// The period of a sampled region, as written.
#[derive(Clone, Debug, PartialEq)]
pub enum Clock {
    /// `at 25 Hz`
    At(Expr),
    /// `every 40 ms`
    Every(Expr),
}

/// `for name in from..to { body }`, both ends included.
#[derive(Clone, Debug, PartialEq)]
pub struct For {
    /// The loop variable.
    pub variable: Name,
    /// First value.
    pub from: Expr,
    /// Last value.
    pub to: Expr,
    /// Its statements.
    pub body: Vec<Statement>,
}

/// `if condition { body } else { otherwise }`.
#[derive(Clone, Debug, PartialEq)]
pub struct If {
    /// The condition.
    pub condition: Expr,
    /// Where it holds.
    pub body: Vec<Statement>,
    /// Where it doesn't.
    pub otherwise: Option<Vec<Statement>>,
}

/// An expectation on a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Expect {
    /// `expect passive`
    Passive,
    /// `expect passive at hand`
    PassiveAt(Path),
    /// `expect value at time = target within tolerance`
    At {
        /// What is looked at.
        value: Expr,
        /// When.
        time: Expr,
        /// What it should be.
        target: Expr,
        /// By how much it may be off.
        tolerance: Expr,
    },
    /// `expect max(abs(x)) < 0.2 m`: a comparison that must hold; `max(x)`, `min(x)` of one argument are over the run.
    Holds(Expr),
}

/// A dotted path, `main.lump[10].p`.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// At least one.
    pub segments: Vec<Segment>,
    /// The whole of it.
    pub span: Span,
}

/// A name of a path with its indices.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// The name.
    pub name: Name,
    /// `[i]`, `[i, j]`, `[i][j]`.
    pub index: Vec<Expr>,
}

/// An expression and its place.
#[derive(Clone, Debug, PartialEq)]
pub struct Expr {
    /// What it is.
    pub kind: ExprKind,
    /// Where; parentheses around it belong to it.
    pub span: Span,
}

/// What an expression is.
#[derive(Clone, Debug, PartialEq)]
pub enum ExprKind {
    /// `1.5e3`, `10 N`.
    Number {
        /// The digits as written.
        digits: String,
        /// The unit as written, with its place.
        unit: Option<Unit>,
    },
    /// `true`, `false`.
    Bool(bool),
    /// A parameter, a `let`, a signal.
    Path(Path),
    /// `-x`, `not x`.
    Unary(Unary, Box<Expr>),
    /// `a + b`, `a < b`, `a and b`.
    Binary(Binary, Box<Expr>, Box<Expr>),
    /// `if c then a else b`.
    If(Box<Expr>, Box<Expr>, Box<Expr>),
    /// `sin(x)`.
    Call(Name, Vec<Expr>),
    /// `[a, b]`, `[[a, b], [c, d]]`.
    List(Vec<Expr>),
    /// `1..3`, both ends included; in an index alone.
    Range(Box<Expr>, Box<Expr>),
    /// `( x )`; kept so that the formatter keeps it.
    Paren(Box<Expr>),
}

/// A unit: a product of powers of symbols.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Symbol, exponent (`kg*m/s^2` as kg 1, m 1, s -2; `m^(1/2)` as 1/2), place of the symbol.
    pub factors: Vec<(String, (i32, i32), Span)>,
    /// The whole of it.
    pub span: Span,
}

/// A prefix operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// `-`
    Neg,
    /// `not`
    Not,
}

/// An infix operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// `+`
    Add,
    /// `-`
    Sub,
    /// `*`
    Mul,
    /// `/`
    Div,
    /// `^`, right-associative, binds tighter than unary minus
    Pow,
    /// `<`
    Lt,
    /// `<=`
    Le,
    /// `>`
    Gt,
    /// `>=`
    Ge,
    /// `==`
    Eq,
    /// `!=`
    Ne,
    /// `and`
    And,
    /// `or`
    Or,
}

/// Walks all statements, also those in blocks.
pub fn each_statement<'a>(body: &'a [Statement], look: &mut dyn FnMut(&'a Statement)) {
    for s in body {
        look(s);
        match &s.kind {
            StatementKind::Sampled(block) => each_statement(&block.body, look),
            StatementKind::For(repeat) => each_statement(&repeat.body, look),
            StatementKind::If(choice) => {
                each_statement(&choice.body, look);
                each_statement(choice.otherwise.as_deref().unwrap_or(&[]), look);
            }
            StatementKind::Element(_)
            | StatementKind::Chain(_)
            | StatementKind::Port(..)
            | StatementKind::Input(_)
            | StatementKind::Output(_)
            | StatementKind::Let(_)
            | StatementKind::Function(_)
            | StatementKind::Probe(_)
            | StatementKind::State(..)
            | StatementKind::Simulate(_)
            | StatementKind::Expect(_) => {}
        }
    }
}
