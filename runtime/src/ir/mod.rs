//! Step programs: what a stepper writes and a back end translates, and nothing else passes between the two.
//!
//! A [`Program`] is straight code over `f64`: blocks of instructions in static single assignment, of which most compute
//! a value by an [`Op`], and four kinds have structure ([`Inst::Newton`], [`Inst::Solve`], [`Inst::MatVec`],
//! [`Inst::Quad`]). There is no control flow besides. Truth values are 1 and 0. Values print as `v12`, slots as `x[3]`.

mod builder;
mod code_shape;
mod display;
mod op;
mod prune;
mod verify;

pub use builder::{Builder, SIDE_BY_SIDE};
pub use op::{Binary, Unary};
pub use verify::Invalid;

use crate::options::NewtonOptions;
use rustc_hash::FxHashSet;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use std::cell::Cell;
use std::ops::Range;

/// The result of an instruction, numbered through the whole program in order of making.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Value(pub u32);

/// The memories a program works on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Array {
    /// The state at the start of the step; read only. `x`
    State,
    /// The state at its end; written once each. `n`
    Next,
    /// Time, step and what comes from outside; read only. `u`
    Input,
    /// Numbers prepared before the run for a given step length; read only. `c`
    Table,
    /// The program's own scratch, never read across steps. `w`
    Local,
    /// What the step reports: energies, mean outputs, observed signals. `y`
    Output,
}

impl Array {
    /// All arrays, in order.
    pub const ALL: [Array; 6] = [Array::State, Array::Next, Array::Input, Array::Table, Array::Local, Array::Output];

    /// The letter it prints as.
    pub fn letter(self) -> char {
        match self {
            Array::State => 'x',
            Array::Next => 'n',
            Array::Input => 'u',
            Array::Table => 'c',
            Array::Local => 'w',
            Array::Output => 'y',
        }
    }
}

/// A place in an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Slot {
    /// Which memory.
    pub array: Array,
    /// Where in it.
    pub index: u32,
}

impl Slot {
    /// A place in an array.
    pub fn new(array: Array, index: usize) -> Self {
        Slot { array, index: index as u32 }
    }
}

/// How a value is computed.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub enum Op {
    /// A number.
    Const(f64),
    /// What a slot holds now.
    Load(Slot),
    /// A function of one value.
    Unary(Unary, Value),
    /// A function of two values.
    Binary(Binary, Value, Value),
    /// The second where the first is not 0, else the third. Both are computed.
    Select(Value, Value, Value),
}

/// Numbers count by their bits, so that what is known of a program is found again though it has a NaN in it, and code
/// for 0 is not taken for -0.
impl PartialEq for Op {
    fn eq(&self, other: &Self) -> bool {
        match (*self, *other) {
            (Op::Const(x), Op::Const(y)) => x.to_bits() == y.to_bits(),
            (Op::Load(a), Op::Load(b)) => a == b,
            (Op::Unary(f, a), Op::Unary(g, b)) => (f, a) == (g, b),
            (Op::Binary(f, a, b), Op::Binary(g, c, d)) => (f, a, b) == (g, c, d),
            (Op::Select(a, b, c), Op::Select(d, e, f)) => (a, b, c) == (d, e, f),
            (Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..), _) => false,
        }
    }
}

impl Op {
    /// The values that it looks at.
    pub fn operands(&self) -> impl Iterator<Item = Value> + use<> {
        let list = match *self {
            Op::Const(_) | Op::Load(_) => [None, None, None],
            Op::Unary(_, a) => [Some(a), None, None],
            Op::Binary(_, a, b) => [Some(a), Some(b), None],
            Op::Select(c, a, b) => [Some(c), Some(a), Some(b)],
        };
        list.into_iter().flatten()
    }
}

/// One instruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Inst {
    /// Defines a value.
    Let(Value, Op),
    /// Writes a value into a slot of `Next`, `Local` or `Output`.
    Store(Slot, Value),
    /// Solves a square system. In a box, so that the other instructions, which are many, stay small.
    Newton(Box<Newton>),
    /// Solves linear equations. In a box likewise.
    Solve(Box<Solve>),
    /// `to[0..rows] = T from[0..cols]` with the row-major matrix that starts at `table` in the table.
    ///
    /// With `low`, a second matrix of the same shape follows the first: its product, smaller, is summed apart and added
    /// at the end, so that the matrix counts with more digits. (The entries of the first should then be short, see
    /// [`crate::exponential::Layout::exponential`].) Sums run from left to right, starting from their first term.
    MatVec {
        /// First slot written.
        to: Slot,
        /// First entry of the matrix in the table.
        table: u32,
        /// First slot read.
        from: Slot,
        /// Rows of the matrix.
        rows: u32,
        /// Columns of the matrix.
        cols: u32,
        /// Whether a low-order matrix follows.
        low: bool,
    },
    /// `to = v^T Q v` with `v = from[0..n]` and `Q` symmetric, its upper triangle row by row at `table`
    /// (entries off the diagonal already doubled), or that of its root.
    Quad {
        /// Slot written.
        to: Slot,
        /// First entry in the table.
        table: u32,
        /// First slot read.
        from: Slot,
        /// Size.
        n: u32,
        /// Whether the table has the rows of `R` with `Q = R^T R`, upper triangular and `n` numbers each, and `to` is
        /// the sum of the squares of `R v`.
        root: bool,
    },
}

/// The solution `u` of `A u = b`, put into consecutive slots of `Local`. It counts as an iteration where it has no
/// flag.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solve {
    /// First slot of the unknowns, in `Local`.
    pub unknowns: u32,
    /// `b`, one value a row.
    pub right: Vec<Value>,
    /// `A`: row, column, value; sorted by row, then column; each place at most once. The pattern is fixed.
    pub matrix: Vec<(u32, u32, Value)>,
    /// Where the numbers are complex, the imaginary part of each entry of `matrix`, which has the real ones; of `right`
    /// and of the unknowns first the real part stands there then, and after it the imaginary one. Empty else.
    pub imaginary: Vec<Value>,
    /// Where the step fails when there is no pivot in a row; with a slot, the slot (of `Local`) gets 1 or 0 and the
    /// program goes on, with numbers that mean nothing.
    pub flag: Option<Slot>,
}

/// What is known of the matrices of a system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matrix {
    /// Each solution is with another one.
    Changing,
    /// Most solutions are with that of the one before, for whose factors more may be done.
    Kept,
    /// Each solution is with another one, and rows may say the same: what they leave undetermined is 0 then.
    Undetermined,
    /// Of complex numbers: of each value and of each entry of a vector first the real part, then the imaginary one.
    Complex,
}

impl Solve {
    /// Whether the numbers are complex.
    pub fn is_complex(&self) -> bool {
        !self.imaginary.is_empty()
    }

    /// What is known of its matrices: those of linear regions depend on next to nothing but the step.
    pub fn of(&self) -> Matrix {
        if self.is_complex() { Matrix::Complex } else { Matrix::Kept }
    }

    /// How many equations there are.
    pub fn size(&self) -> usize {
        if self.is_complex() { self.right.len() / 2 } else { self.right.len() }
    }

    /// The numbers of the matrix, in the order of [`crate::solve::linear`].
    pub fn values(&self) -> impl Iterator<Item = Value> {
        let both = |(i, e): (usize, &(u32, u32, Value))| [Some(e.2), self.imaginary.get(i).copied()];
        self.matrix.iter().enumerate().flat_map(both).flatten()
    }

    /// Rows and columns of the matrix's entries.
    pub fn pattern(&self) -> Vec<(u32, u32)> {
        self.matrix.iter().map(|e| (e.0, e.1)).collect()
    }
}

/// Newton's method on `n` unknowns that lie in consecutive slots of `Local`, started from what they hold.
///
/// Each iteration runs `body`, which computes residual and Jacobian (d residual / d unknown) at the unknowns, solves
/// `J d = r` and takes `d` off the unknowns. Weights make the measures of an iteration free of units: an unknown's or a
/// residual's square counts times its weight (weights are values defined before the iteration).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Newton {
    /// First slot of the unknowns, in `Local`.
    pub unknowns: u32,
    /// First slot, in `Local`, of what rounding took from each unknown in the update made last (see
    /// [`newton`](crate::solve::newton)), where that is asked for; of affine residuals it is not.
    pub rounding: Option<u32>,
    /// Instructions that compute residual and Jacobian.
    #[serde(deserialize_with = "nested")]
    pub body: Vec<Inst>,
    /// One value a row.
    pub residual: Vec<Value>,
    /// Row, column, value; sorted by row, then column; each place at most once. The pattern is fixed.
    pub jacobian: Vec<(u32, u32, Value)>,
    /// The update itself, one value an unknown, where the body solves with a matrix of its own that is near the
    /// Jacobian (a simplified Newton method); then there is no `jacobian`. Empty else.
    pub update: Vec<Value>,
    /// The part of the unknowns that the iteration may leave;
    /// [`NewtonOptions::rounding`] of what nobody adds up.
    pub left: f64,
    /// One an unknown: energy per square of the unknown; 0 where nothing is known.
    pub weight: Vec<Value>,
    /// One an unknown: size against which a relative change is measured besides the unknown itself.
    pub scale: Vec<Value>,
    /// Where the start of the unknowns is predicted, this is another one, one value per unknown: what was predicted
    /// then never decides whether there is a solution. Empty else.
    pub cold: Vec<Value>,
    /// Values from before the iteration that are next to nothing beside what its body adds them to, as what rounding
    /// took from states: an iteration that begins with two updates has -0 for them in the first, which then does not
    /// wait for them.
    pub small: Vec<Value>,
    /// Unknowns that appear as exponents, with the knees beyond which the exponentials dominate; of up to
    /// [`MAX_KNEES`](crate::solve::newton::MAX_KNEES) unknowns.
    pub knees: Vec<Knee>,
    /// The numbers that the iteration goes by.
    pub options: NewtonOptions,
    /// Iterations at most.
    pub limit: u32,
    /// Whether the residual is affine in the unknowns: the first update is the solution.
    pub affine: bool,
    /// Whether laws that hold at once may leave undetermined how they share the load, as frictions on both sides of a
    /// gear.
    pub undetermined: bool,
    /// Whether laws have corners beyond which they are steeper by orders of magnitude: what an update leaves that was
    /// to be the last is looked at, since it may have passed one.
    pub corners: bool,
    /// Where the step fails when the method does not converge; with a slot, the slot (of `Local`) gets 1 or 0 and the
    /// program goes on with the last iterate.
    pub flag: Option<Slot>,
}

impl Newton {
    /// Whether what an unknown moves may have a pole, beyond which the residual goes on from the other side: something
    /// is divided by it, or raised to a power that need not be above 0.
    pub fn has_poles(&self) -> bool {
        let mut moved: FxHashSet<Value> = FxHashSet::default();
        let mut powers: FxHashSet<Value> = FxHashSet::default();
        for inst in &self.body {
            let Inst::Let(value, op) = inst else {
                // What it gives may be anything.
                if matches!(inst, Inst::Store(..)) {
                    continue;
                }
                return true;
            };
            let is_moved = match op {
                Op::Load(slot) => slot.array == Array::Local,
                Op::Const(x) => {
                    if *x >= 0.0 {
                        powers.insert(*value);
                    }
                    false
                }
                Op::Unary(..) | Op::Binary(..) | Op::Select(..) => op.operands().any(|v| moved.contains(&v)),
            };
            let pole = match op {
                Op::Unary(Unary::Tan, _) => is_moved,
                Op::Binary(Binary::Div, _, b) => moved.contains(b),
                Op::Binary(Binary::Pow, _, b) => is_moved && !powers.contains(b),
                Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => false,
            };
            if pole {
                return true;
            }
            if is_moved {
                moved.insert(*value);
            }
        }
        false
    }
}

/// An exponential of an unknown of an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Knee {
    /// The number of the unknown.
    pub unknown: u32,
    /// Where the exponential is 1.
    pub knee: f64,
    /// Its exponent is this times what the unknown is above the knee: below 0, it grows to the other side.
    pub rate: f64,
}

/// Iterations inside one another, at most, in a program that is read.
const NESTED: u32 = 32;

/// Reads the body of an iteration; one too deep is an error, so that no file can exhaust the stack.
fn nested<'de, D: Deserializer<'de>>(reader: D) -> Result<Vec<Inst>, D::Error> {
    thread_local! {
        static DEPTH: Cell<u32> = const { Cell::new(0) };
    }
    let depth = DEPTH.get();
    if depth >= NESTED {
        return Err(D::Error::custom("iterations are nested too deeply"));
    }
    DEPTH.set(depth + 1);
    let body = Vec::deserialize(reader);
    DEPTH.set(depth);
    body
}

/// A program: what one step of one cluster of regions, or one observation, computes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Program {
    /// What it is, for people: `step of VirtualWall`.
    pub name: String,
    /// Size of each array, in the order of [`Array::ALL`].
    pub sizes: [u32; 6],
    /// The names of the slots of `State`, `Input` and `Output` and of the unknowns, where they have one, for people.
    pub names: Vec<(Slot, String)>,
    /// The instructions.
    pub body: Vec<Inst>,
    /// How many values there are.
    pub values: u32,
}

impl Program {
    /// Size of an array.
    pub fn size(&self, array: Array) -> usize {
        self.sizes[array as usize] as usize
    }

    /// Whether it looks at one of these slots of an array.
    pub fn reads(&self, array: Array, slots: Range<usize>) -> bool {
        fn any(body: &[Inst], within: &impl Fn(Slot, u32) -> bool) -> bool {
            body.iter().any(|inst| match inst {
                Inst::Let(_, Op::Load(slot)) => within(*slot, 1),
                Inst::MatVec { from, cols, .. } => within(*from, *cols),
                Inst::Quad { from, n, .. } => within(*from, *n),
                Inst::Newton(newton) => any(&newton.body, within),
                Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) => false,
            })
        }
        let Range { start, end } = slots;
        any(&self.body, &|slot, n| {
            slot.array == array && (slot.index as usize) < end && slot.index as usize + n as usize > start
        })
    }

    /// The name of a slot, where it has one.
    pub fn name_of(&self, slot: Slot) -> Option<&str> {
        self.names.iter().find(|n| n.0 == slot).map(|n| n.1.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_divided_by_an_unknown_has_a_pole() {
        let unknown = Inst::Let(Value(1), Op::Load(Slot { array: Array::Local, index: 0 }));
        let constant = |x| Inst::Let(Value(2), Op::Const(x));
        let binary = |f, a, b| Inst::Let(Value(3), Op::Binary(f, Value(a), Value(b)));
        let poles = |body: Vec<Inst>| {
            let newton = Newton {
                unknowns: 0,
                rounding: None,
                body,
                residual: vec![Value(3)],
                jacobian: vec![(0, 0, Value(3))],
                update: Vec::new(),
                left: 4e-16,
                weight: vec![Value(0)],
                scale: vec![Value(0)],
                cold: Vec::new(),
                small: Vec::new(),
                knees: Vec::new(),
                options: NewtonOptions::DEFAULT,
                limit: 200,
                affine: false,
                undetermined: false,
                corners: false,
                flag: None,
            };
            newton.has_poles()
        };
        let with = |x, f, a, b| poles(vec![unknown.clone(), constant(x), binary(f, a, b)]);
        assert!(with(2.0, Binary::Div, 2, 1) && with(-1.0, Binary::Pow, 1, 2) && with(2.0, Binary::Pow, 2, 1));
        assert!(!with(2.0, Binary::Div, 1, 2) && !with(3.0, Binary::Pow, 1, 2) && !with(2.0, Binary::Mul, 1, 1));
        // By what comes from an unknown, too; a value of before the iteration is none.
        let square = Inst::Let(Value(2), Op::Binary(Binary::Mul, Value(1), Value(1)));
        assert!(poles(vec![unknown.clone(), square, binary(Binary::Div, 0, 2)]));
        assert!(!poles(vec![unknown.clone(), binary(Binary::Div, 1, 0)]));
    }
}
