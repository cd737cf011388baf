//! What back ends translate: a step program made plain. Newton's method, elimination and products have become
//! statements, loops and branches over numbers, so that a back end is a printer of some fifteen forms.
//!
//! Made by [`super::lower`]; each back end says it in its own language and adds nothing. Values are defined once and
//! before their uses, within the block they are used in or around it; variables are set as often as wanted. There are
//! no calls but functions of numbers and [`Stmt::Solve`], which [`super::lower`] writes out.

use bond_runtime::ir::{Binary, Unary};
use bond_runtime::solve::linear::Matrix;

/// A number that is computed once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Value(pub u32);

/// A number that changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Var(pub u32);

/// The counter of a [`Stmt::For`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Index(pub u32);

/// What a routine reads and writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Memory {
    /// The state at the start of the step.
    State,
    /// The state at its end.
    Next,
    /// Time, step and what comes from outside.
    Input,
    /// Numbers prepared for a step length.
    Table,
    /// What the step reports.
    Output,
    /// The routine's own numbers: first the program's scratch, then what elimination needs.
    Scratch,
    /// Numbers in which members of an isomorphic group differ: [`Routine::data`].
    Data,
}

impl Memory {
    /// All of them, in the order in which a compiled function takes them.
    pub const ALL: [Memory; 7] =
        [Memory::State, Memory::Input, Memory::Table, Memory::Next, Memory::Output, Memory::Scratch, Memory::Data];
}

/// A place in a memory: `base + Σ stride index`, with `through` the number of [`Routine::tables`] there besides, and
/// with `picked` what a value tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Which memory.
    pub memory: Memory,
    /// Where all counters are 0.
    pub base: u32,
    /// Counters with their strides.
    pub along: Vec<(Index, u32)>,
    /// A place in the tables, and a counter that is added to it.
    pub through: Option<(u32, Index)>,
    /// One of some places from there on, which a value tells.
    pub picked: Option<Picked>,
}

/// One of `count` places that lie a stride apart: that of the whole number which the value is. Any other value tells
/// the first one, so that no number leads out of the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picked {
    /// Which one.
    pub by: Value,
    /// From one to the next.
    pub stride: u32,
    /// How many.
    pub count: u32,
}

impl Place {
    /// A place that is always the same.
    pub fn new(memory: Memory, base: u32) -> Self {
        Self { memory, base, along: Vec::new(), through: None, picked: None }
    }

    /// Whether it is always the same.
    pub fn is_fixed(&self) -> bool {
        self.along.is_empty() && self.through.is_none() && self.picked.is_none()
    }
}

/// How a value is computed.
#[derive(Clone, Debug, PartialEq)]
pub enum Op {
    /// A place of a memory.
    Load(Place),
    /// What a variable is now.
    Get(Var),
    /// A counter.
    Counter(Index),
    /// `bond_runtime::eval::inverse_scale` of a value.
    InverseScale(Value),
    /// A function of one value, as `bond_runtime::eval` means it.
    Unary(Unary, Value),
    /// A function of two values, as `bond_runtime::eval` means it.
    Binary(Binary, Value, Value),
    /// The first value where the condition holds, else the second.
    Select(Cond, Value, Value),
}

impl Op {
    /// The values it looks at.
    pub fn each_value(&self, f: &mut impl FnMut(Value)) {
        match self {
            Op::Load(p) => p.picked.iter().for_each(|picked| f(picked.by)),
            Op::Get(_) | Op::Counter(_) => {}
            Op::Unary(_, a) | Op::InverseScale(a) => f(*a),
            Op::Binary(_, a, b) => {
                f(*a);
                f(*b);
            }
            Op::Select(c, a, b) => {
                c.each_value(f);
                f(*a);
                f(*b);
            }
        }
    }

    /// The same, to be replaced.
    pub fn each_value_mut(&mut self, f: &mut impl FnMut(&mut Value)) {
        match self {
            Op::Load(p) => p.picked.iter_mut().for_each(|picked| f(&mut picked.by)),
            Op::Get(_) | Op::Counter(_) => {}
            Op::Unary(_, a) | Op::InverseScale(a) => f(a),
            Op::Binary(_, a, b) => {
                f(a);
                f(b);
            }
            Op::Select(c, a, b) => {
                c.each_value_mut(f);
                f(a);
                f(b);
            }
        }
    }
}

/// A condition. Comparisons with a NaN do not hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Cond {
    /// Decided.
    Known(bool),
    /// The value is not 0.
    True(Value),
    /// `a < b`
    Lt(Value, Value),
    /// `a <= b`
    Le(Value, Value),
    /// `a = b`
    Eq(Value, Value),
    /// The value is neither infinite nor NaN.
    Finite(Value),
    /// The opposite.
    Not(Box<Cond>),
    /// All of them.
    All(Vec<Cond>),
    /// One of them at least.
    Any(Vec<Cond>),
}

impl Cond {
    /// The opposite.
    #[expect(clippy::should_implement_trait, reason = "a verb of this form, not of the language's `!`")]
    pub fn not(self) -> Cond {
        match self {
            Cond::Known(b) => Cond::Known(!b),
            Cond::Not(c) => *c,
            c @ (Cond::True(_)
            | Cond::Lt(..)
            | Cond::Le(..)
            | Cond::Eq(..)
            | Cond::Finite(_)
            | Cond::All(_)
            | Cond::Any(_)) => Cond::Not(Box::new(c)),
        }
    }

    /// What it is, where that is decided.
    pub fn known(&self) -> Option<bool> {
        match self {
            Cond::Known(b) => Some(*b),
            Cond::True(_)
            | Cond::Lt(..)
            | Cond::Le(..)
            | Cond::Eq(..)
            | Cond::Finite(_)
            | Cond::Not(_)
            | Cond::All(_)
            | Cond::Any(_) => None,
        }
    }

    /// All of some conditions.
    pub fn all(list: impl IntoIterator<Item = Cond>) -> Cond {
        let list: Vec<Cond> = list.into_iter().filter(|c| *c != Cond::Known(true)).collect();
        match list.len() {
            _ if list.contains(&Cond::Known(false)) => Cond::Known(false),
            0 => Cond::Known(true),
            1 => list.into_iter().next().unwrap_or(Cond::Known(true)),
            _ => Cond::All(list),
        }
    }

    /// Any of some conditions.
    pub fn any(list: impl IntoIterator<Item = Cond>) -> Cond {
        let list: Vec<Cond> = list.into_iter().filter(|c| *c != Cond::Known(false)).collect();
        match list.len() {
            _ if list.contains(&Cond::Known(true)) => Cond::Known(true),
            0 => Cond::Known(false),
            1 => list.into_iter().next().unwrap_or(Cond::Known(false)),
            _ => Cond::Any(list),
        }
    }

    /// The values it looks at, to be named anew.
    pub fn each_value_mut(&mut self, f: &mut impl FnMut(&mut Value)) {
        match self {
            Cond::Known(_) => {}
            Cond::True(a) | Cond::Finite(a) => f(a),
            Cond::Lt(a, b) | Cond::Le(a, b) | Cond::Eq(a, b) => {
                f(a);
                f(b);
            }
            Cond::Not(c) => c.each_value_mut(f),
            Cond::All(list) | Cond::Any(list) => list.iter_mut().for_each(|c| c.each_value_mut(f)),
        }
    }

    /// The values it looks at.
    pub fn each_value(&self, f: &mut impl FnMut(Value)) {
        match self {
            Cond::Known(_) => {}
            Cond::True(a) | Cond::Finite(a) => f(*a),
            Cond::Lt(a, b) | Cond::Le(a, b) | Cond::Eq(a, b) => {
                f(*a);
                f(*b);
            }
            Cond::Not(c) => c.each_value(f),
            Cond::All(list) | Cond::Any(list) => list.iter().for_each(|c| c.each_value(f)),
        }
    }
}

impl std::ops::Not for Cond {
    type Output = Cond;

    fn not(self) -> Cond {
        Cond::not(self)
    }
}

impl std::ops::BitAnd for Cond {
    type Output = Cond;

    fn bitand(self, other: Cond) -> Cond {
        let parts = |c| match c {
            Cond::All(list) => list,
            c => vec![c],
        };
        Cond::all(parts(self).into_iter().chain(parts(other)))
    }
}

impl std::ops::BitOr for Cond {
    type Output = Cond;

    fn bitor(self, other: Cond) -> Cond {
        let parts = |c| match c {
            Cond::Any(list) => list,
            c => vec![c],
        };
        Cond::any(parts(self).into_iter().chain(parts(other)))
    }
}

/// Where a [`Stmt::Span`] begins or ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Always here.
    Known(u32),
    /// So many after a counter.
    Past(Index, u32),
    /// At the number of [`Routine::tables`] at this place, to which a counter is added.
    Table(u32, Index),
}

/// The counters of a [`Stmt::Span`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The counter.
    pub index: Index,
    /// The first.
    pub from: Bound,
    /// One after the last.
    pub to: Bound,
    /// Whether it goes from the last to the first.
    pub back: bool,
}

/// One statement.
#[derive(Clone, Debug, PartialEq)]
pub enum Stmt {
    /// Defines a value.
    Let(Value, Op),
    /// Sets a variable.
    Set(Var, Value),
    /// Writes a place.
    Store(Place, Value),
    /// The first block where the condition holds, else the second.
    If(Cond, Vec<Stmt>, Vec<Stmt>),
    /// Again and again, until [`Stmt::Break`].
    Loop(Vec<Stmt>),
    /// Ends the innermost [`Stmt::Loop`].
    Break,
    /// Begins the innermost [`Stmt::Loop`] anew.
    Continue,
    /// Counts from the first number up to, and without, the second; `Break` and `Continue` do not stand in it for a
    /// loop around it.
    For(Index, u32, u32, Vec<Stmt>),
    /// Counts between bounds that other counters tell; `Break` and `Continue` may stand in it for a loop around it.
    Span(Span, Vec<Stmt>),
    /// Solves the system of [`Routine::systems`] with this number: its matrix entries, in the order of the pattern, and
    /// the right side, which becomes the solution (of complex numbers first the real part, then the imaginary one), are
    /// in [`Memory::Scratch`] from these places on. The variable becomes -1, or the row that has no pivot. Where there
    /// is a value and it is not 0, the matrix is what it was when this was solved last.
    Solve {
        /// Which system.
        system: u32,
        /// First matrix entry.
        matrix: u32,
        /// First entry of the right side.
        vector: u32,
        /// See above.
        row: Var,
        /// See above.
        same: Option<Value>,
    },
    /// Adds to the iterations done.
    Count(Value),
    /// Leaves four numbers for who runs the routine, one after the other in [`Memory::Next`].
    Note([Value; 4]),
    /// Ends the routine without a result.
    Fail(Reason),
}

impl Stmt {
    /// The values it looks at itself, without those that statements inside it look at.
    pub fn each_value(&self, f: &mut impl FnMut(Value)) {
        match self {
            Stmt::Let(_, op) => op.each_value(f),
            Stmt::Set(_, v) | Stmt::Count(v) => f(*v),
            Stmt::Store(p, v) => {
                p.picked.iter().for_each(|picked| f(picked.by));
                f(*v);
            }
            Stmt::Note(list) => list.iter().for_each(|v| f(*v)),
            Stmt::If(c, ..) => c.each_value(f),
            Stmt::Solve { same, .. } => same.iter().for_each(|v| f(*v)),
            Stmt::Fail(reason) => reason.values().into_iter().for_each(f),
            Stmt::Loop(_) | Stmt::For(..) | Stmt::Span(..) | Stmt::Break | Stmt::Continue => {}
        }
    }

    /// The values that it and the statements inside it look at.
    pub fn each_value_within(&self, f: &mut impl FnMut(Value)) {
        visit(std::slice::from_ref(self), &mut |s| s.each_value(f));
    }

    /// The value that it defines.
    pub fn defines(&self) -> Option<Value> {
        if let Stmt::Let(v, _) = self { Some(*v) } else { None }
    }

    /// The variable that it sets.
    pub fn sets(&self) -> Option<Var> {
        match self {
            Stmt::Set(var, _) | Stmt::Solve { row: var, .. } => Some(*var),
            _ => None,
        }
    }

    /// The place that it loads or stores.
    pub fn place(&self) -> Option<&Place> {
        if let Stmt::Let(_, Op::Load(p)) | Stmt::Store(p, _) = self { Some(p) } else { None }
    }

    /// The same, to be replaced.
    pub fn place_mut(&mut self) -> Option<&mut Place> {
        if let Stmt::Let(_, Op::Load(p)) | Stmt::Store(p, _) = self { Some(p) } else { None }
    }

    /// Whether it defines a value, sets a variable or stores, and does nothing else.
    pub fn is_straight(&self) -> bool {
        matches!(self, Stmt::Let(..) | Stmt::Set(..) | Stmt::Store(..))
    }

    /// Whether what follows it in its block is not reached.
    pub fn is_exit(&self) -> bool {
        matches!(self, Stmt::Break | Stmt::Continue | Stmt::Fail(_))
    }

    /// The blocks inside it; empty ones where there are none.
    pub fn inner(&self) -> [&[Stmt]; 2] {
        match self {
            Stmt::If(_, yes, no) => [yes, no],
            Stmt::Loop(body) | Stmt::For(_, _, _, body) | Stmt::Span(_, body) => [body, &[]],
            _ => [&[], &[]],
        }
    }

    /// The same, to be changed.
    pub fn inner_mut(&mut self) -> impl Iterator<Item = &mut Vec<Stmt>> {
        let (first, second) = match self {
            Stmt::If(_, yes, no) => (Some(yes), Some(no)),
            Stmt::Loop(body) | Stmt::For(_, _, _, body) | Stmt::Span(_, body) => (Some(body), None),
            _ => (None, None),
        };
        first.into_iter().chain(second)
    }
}

/// Calls `f` for each statement of a block and of the blocks inside it, an outer statement before those inside it.
pub fn visit<'s>(body: &'s [Stmt], f: &mut impl FnMut(&'s Stmt)) {
    for s in body {
        f(s);
        s.inner().into_iter().for_each(|block| visit(block, f));
    }
}

/// The same, to change statements.
pub fn visit_mut(body: &mut [Stmt], f: &mut impl FnMut(&mut Stmt)) {
    for s in body {
        f(s);
        s.inner_mut().for_each(|block| visit_mut(block, f));
    }
}

/// Whether `f` holds for every statement of a block and of the blocks inside it.
pub fn all(body: &[Stmt], f: &mut impl FnMut(&Stmt) -> bool) -> bool {
    body.iter().all(|s| f(s) && s.inner().into_iter().all(|block| all(block, f)))
}

/// Takes out the statements for which `keep` does not hold, and branches and loops that nothing is left of. Whether
/// there were any. `keep` is asked of an outer statement before those inside it.
pub fn retain(body: &mut Vec<Stmt>, keep: &mut impl FnMut(&Stmt) -> bool) -> bool {
    let mut changed = false;
    body.retain_mut(|s| {
        let mut kept = keep(s);
        if kept && matches!(s, Stmt::If(..) | Stmt::Loop(_) | Stmt::For(..) | Stmt::Span(..)) {
            s.inner_mut().for_each(|block| changed |= retain(block, keep));
            kept = s.inner().into_iter().any(|block| !block.is_empty());
        }
        changed |= !kept;
        kept
    });
    changed
}

/// Why a routine ends without a result; see `bond_runtime::Failure`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// Newton's method came to its limit: iterations, slot of `Local`, change.
    NoConvergence(u32, Value, Value),
    /// No pivot in this row.
    Singular(Value),
    /// A slot of `Next`, or an energy, is not finite.
    NotFinite,
    /// The balance of an exact step is grossly off.
    GrossBalance,
    /// Intervals cannot be counted any more: the number has no digit left for one.
    Clock,
}

impl Reason {
    /// What a routine gives for each reason is its place in this list, counted from 1: the name in C, and why it ended.
    pub const ALL: [(&'static str, &'static str); 5] = [
        ("NO_CONVERGENCE", "an iteration came to its limit"),
        ("SINGULAR", "equations have no solution"),
        ("NOT_FINITE", "a number is not finite"),
        ("CLOCK", "intervals cannot be counted any more (after 2^53 of them; single numbers end at 2^24)"),
        ("GROSS_BALANCE", "an exact step makes or loses what is stored"),
    ];
    /// The code of [`Reason::NoConvergence`].
    pub const NO_CONVERGENCE: i64 = 1;
    /// The code of [`Reason::Singular`].
    pub const SINGULAR: i64 = 2;
    /// The code of [`Reason::NotFinite`].
    pub const NOT_FINITE: i64 = 3;

    /// Its code: 0 is a good end.
    pub fn code(self) -> i64 {
        match self {
            Reason::NoConvergence(..) => Self::NO_CONVERGENCE,
            Reason::Singular(_) => Self::SINGULAR,
            Reason::NotFinite => Self::NOT_FINITE,
            Reason::Clock => 4,
            Reason::GrossBalance => 5,
        }
    }

    /// Its name in C.
    pub fn name(self) -> &'static str {
        Self::ALL[self.code() as usize - 1].0
    }

    /// The values that say more.
    pub fn values(self) -> Vec<Value> {
        match self {
            Reason::NoConvergence(_, unknown, change) => vec![unknown, change],
            Reason::Singular(row) => vec![row],
            Reason::NotFinite | Reason::GrossBalance | Reason::Clock => Vec::new(),
        }
    }
}

/// A system of equations that is too large to be written out: its size, and rows and columns of its matrix's entries.
#[derive(Clone, Debug, PartialEq)]
pub struct System {
    /// How many unknowns.
    pub n: usize,
    /// Row and column of each entry.
    pub pattern: Vec<(u32, u32)>,
    /// What is known of its matrices.
    pub matrix: Matrix,
}

impl System {
    /// Whether its numbers are complex.
    pub fn is_complex(&self) -> bool {
        self.matrix == Matrix::Complex
    }
}

/// A number that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// As it is.
    Plain(f64),
    /// A measure of rounding; where numbers are shorter, it is larger.
    Tolerance(f64),
}

impl Number {
    /// It, with all digits.
    pub fn value(self) -> f64 {
        match self {
            Number::Plain(x) | Number::Tolerance(x) => x,
        }
    }
}

/// A program made plain.
#[derive(Clone, Debug, PartialEq)]
pub struct Routine {
    /// What it is, for people.
    pub name: String,
    /// The statements.
    pub body: Vec<Stmt>,
    /// By value: the number that it is, where it is one. Such a value is defined everywhere.
    pub numbers: Vec<Option<Number>>,
    /// How many variables there are. All are 0 at the start.
    pub vars: u32,
    /// How many counters there are.
    pub indices: u32,
    /// Size of [`Memory::Scratch`].
    pub scratch: u32,
    /// Systems that [`Stmt::Solve`] solves.
    pub systems: Vec<System>,
    /// What [`Memory::Data`] holds.
    pub data: Vec<f64>,
    /// Places that do not run evenly.
    pub tables: Vec<u32>,
}

impl Routine {
    /// How many statements it has, those inside others included.
    pub fn size(&self) -> usize {
        size(&self.body)
    }
}

/// How many statements there are, those inside others included.
pub fn size(body: &[Stmt]) -> usize {
    let mut count = 0;
    visit(body, &mut |_| count += 1);
    count
}
