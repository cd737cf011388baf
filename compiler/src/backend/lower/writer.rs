//! Writes a routine, statement by statement. What is known is computed at once.

use super::dead_code::remove_dead_code;
use super::fuse::fuse;
use super::options::LoopOptions;
use crate::backend::code::{Cond, Index, Memory, Number, Op, Place, Routine, Stmt, System, Value, Var};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::{FxHashMap, FxHashSet};

/// Loops over so many things at most are written out.
pub(in crate::backend) const UNROLLED: usize = 24;
/// Eliminations of so many unknowns at most are.
pub(in crate::backend) const ELIMINATED: usize = 8;
/// Lists of so many numbers begin at a multiple of
pub(in crate::backend) const MANY: usize = 64;
/// so many, which is what the largest vectors have.
pub(in crate::backend) const TOGETHER: usize = 8;

/// A routine in the making.
#[derive(Clone, Default)]
pub(in crate::backend) struct Writer {
    blocks: Vec<Vec<Stmt>>,
    pub(in crate::backend) numbers: Vec<Option<Number>>,
    known: FxHashMap<(u64, bool), Value>,
    pub(in crate::backend) vars: u32,
    pub(in crate::backend) indices: u32,
    pub(in crate::backend) scratch: u32,
    pub(in crate::backend) systems: Vec<System>,
    pub(in crate::backend) data: Vec<f64>,
    pub(in crate::backend) tables: Vec<u32>,
    /// By what loops are found and joined.
    pub(super) loops: LoopOptions,
    /// Numbers of [`Memory::Data`] that are positive and finite, whatever they are.
    pub(in crate::backend) positive: FxHashSet<Value>,
}

/// Which of some things.
#[derive(Clone, Copy)]
pub(in crate::backend) enum At {
    /// A certain one.
    One(usize),
    /// That which a counter tells,
    Each(Index),
    /// or some with their strides, from a place on,
    Cell(u32, [Option<(Index, u32)>; 2]),
    /// or a table for a counter.
    Through(u32, Index),
}

impl At {
    /// The counter that it is. Loops go over counters alone.
    pub(in crate::backend) fn counter(self) -> Index {
        match self {
            At::Each(index) | At::Through(_, index) | At::Cell(_, [Some((index, _)), _]) => index,
            At::Cell(_, [None, Some((index, _))]) => index,
            At::One(_) | At::Cell(_, [None, None]) => Index(0),
        }
    }

    /// This one times `n` and another.
    pub(in crate::backend) fn cell(self, n: u32, other: At) -> At {
        let parts = |at: At, stride: u32| match at {
            At::One(k) => (k as u32 * stride, None),
            at => (0, Some((at.counter(), stride))),
        };
        let ((first, i), (second, j)) = (parts(self, n), parts(other, 1));
        match (i, j) {
            (None, None) => At::One((first + second) as usize),
            along => At::Cell(first + second, along.into()),
        }
    }
}

/// Some numbers.
#[derive(Clone)]
pub(in crate::backend) enum Vector {
    /// That change, by name.
    Vars(Vec<Var>),
    /// That are only read.
    Values(Vec<Value>),
    /// That lie in the scratch from here on.
    Memory(u32),
}

impl Writer {
    pub(in crate::backend) fn new() -> Self {
        Self { blocks: vec![Vec::new()], ..Self::default() }
    }

    /// What was written.
    pub(in crate::backend) fn routine(mut self, name: String) -> Routine {
        let mut routine = Routine {
            name,
            body: self.close(),
            numbers: self.numbers,
            vars: self.vars,
            indices: self.indices,
            scratch: self.scratch,
            systems: self.systems,
            data: self.data,
            tables: self.tables,
        };
        fuse(&mut routine, self.loops);
        remove_dead_code(&mut routine);
        routine
    }

    /// Goes on with a routine's numbers, variables and memory, to write statements for it.
    pub(super) fn resume(routine: &mut Routine) -> Self {
        Self {
            blocks: vec![Vec::new()],
            numbers: std::mem::take(&mut routine.numbers),
            vars: routine.vars,
            indices: routine.indices,
            scratch: routine.scratch,
            data: std::mem::take(&mut routine.data),
            tables: std::mem::take(&mut routine.tables),
            ..Self::default()
        }
    }

    /// The routine that was gone on with, of these statements.
    pub(super) fn resumed(self, routine: Routine, body: Vec<Stmt>) -> Routine {
        Routine {
            body,
            numbers: self.numbers,
            vars: self.vars,
            indices: self.indices,
            scratch: self.scratch,
            data: self.data,
            tables: self.tables,
            ..routine
        }
    }

    pub(in crate::backend) fn push(&mut self, s: Stmt) {
        if let Some(block) = self.blocks.last_mut() {
            block.push(s);
        }
    }

    /// Opens a block: what is written goes into it.
    pub(in crate::backend) fn open(&mut self) {
        self.blocks.push(Vec::new());
    }

    /// Closes the block opened last: what was written into it.
    pub(in crate::backend) fn close(&mut self) -> Vec<Stmt> {
        self.blocks.pop().unwrap_or_default()
    }

    /// What `f` writes, as a block of its own.
    pub(in crate::backend) fn block(&mut self, f: impl FnOnce(&mut Self)) -> Vec<Stmt> {
        self.open();
        f(self);
        self.close()
    }

    fn fresh(&mut self, number: Option<Number>) -> Value {
        self.numbers.push(number);
        Value(self.numbers.len() as u32 - 1)
    }

    fn constant(&mut self, n: Number) -> Value {
        let key = (n.value().to_bits(), matches!(n, Number::Tolerance(_)));
        if let Some(&v) = self.known.get(&key) {
            return v;
        }
        let v = self.fresh(Some(n));
        self.known.insert(key, v);
        v
    }

    pub(in crate::backend) fn number(&mut self, x: f64) -> Value {
        self.constant(Number::Plain(x))
    }

    pub(in crate::backend) fn tolerance(&mut self, x: f64) -> Value {
        self.constant(Number::Tolerance(x))
    }

    /// Whether a value is known to be positive and finite.
    pub(in crate::backend) fn is_positive(&self, v: Value) -> bool {
        self.positive.contains(&v) || self.known(v).is_some_and(|x| x > 0.0 && x.is_finite())
    }

    /// What is known of a value.
    pub(in crate::backend) fn known(&self, v: Value) -> Option<f64> {
        match self.numbers[v.0 as usize] {
            Some(Number::Plain(x)) => Some(x),
            Some(Number::Tolerance(_)) | None => None,
        }
    }

    pub(in crate::backend) fn define(&mut self, op: Op) -> Value {
        let v = self.fresh(None);
        self.push(Stmt::Let(v, op));
        v
    }

    pub(in crate::backend) fn unary(&mut self, f: Unary, a: Value) -> Value {
        match self.known(a) {
            Some(x) => self.number(eval::unary(f, x)),
            None => self.define(Op::Unary(f, a)),
        }
    }

    pub(in crate::backend) fn binary(&mut self, f: Binary, a: Value, b: Value) -> Value {
        match (f, self.known(a), self.known(b)) {
            (_, Some(x), Some(y)) => self.number(eval::binary(f, x, y)),
            (Binary::Mul, Some(1.0), None) => b,
            // -0 is what adds nothing, not even to -0.
            (Binary::Add, Some(x), None) if x == 0.0 && x.is_sign_negative() => b,
            (Binary::Add, None, Some(y)) if y == 0.0 && y.is_sign_negative() => a,
            (Binary::Sub, None, Some(y)) if y == 0.0 && y.is_sign_positive() => a,
            (Binary::Mul | Binary::Div, None, Some(1.0)) => a,
            (Binary::Pow, None, Some(y)) if eval::Exponent::of(y).is_some() => self.power(a, y),
            _ => self.define(Op::Binary(f, a, b)),
        }
    }

    /// A power that is products and a root, as `eval::Exponent` says.
    fn power(&mut self, a: Value, y: f64) -> Value {
        let Some(e) = eval::Exponent::of(y) else { return a };
        let (mut product, mut square, mut bits) = (None, a, e.whole);
        while bits > 0 {
            if bits & 1 == 1 {
                product = Some(product.map_or(square, |p| self.mul(p, square)));
            }
            bits >>= 1;
            if bits > 0 {
                square = self.mul(square, square);
            }
        }
        let zero = self.number(0.0);
        if e.half {
            let sum = self.add(a, zero);
            let root = self.unary(Unary::Sqrt, sum);
            product = Some(product.map_or(root, |p| self.mul(p, root)));
        }
        let one = self.number(1.0);
        let product = product.unwrap_or(one);
        if e.inverse { self.div(one, product) } else { product }
    }

    pub(in crate::backend) fn add(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Add, a, b)
    }

    pub(in crate::backend) fn sub(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Sub, a, b)
    }

    pub(in crate::backend) fn mul(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Mul, a, b)
    }

    pub(in crate::backend) fn div(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Div, a, b)
    }

    pub(in crate::backend) fn abs(&mut self, a: Value) -> Value {
        self.unary(Unary::Abs, a)
    }

    pub(in crate::backend) fn select(&mut self, c: Cond, a: Value, b: Value) -> Value {
        match c.known() {
            Some(true) => a,
            Some(false) => b,
            None => self.define(Op::Select(c, a, b)),
        }
    }

    pub(in crate::backend) fn is_true(&self, v: Value) -> Cond {
        self.known(v).map_or(Cond::True(v), |x| Cond::Known(x != 0.0))
    }

    pub(in crate::backend) fn lt(&self, a: Value, b: Value) -> Cond {
        match (self.known(a), self.known(b)) {
            (Some(x), Some(y)) => Cond::Known(x < y),
            _ => Cond::Lt(a, b),
        }
    }

    pub(in crate::backend) fn le(&self, a: Value, b: Value) -> Cond {
        match (self.known(a), self.known(b)) {
            (Some(x), Some(y)) => Cond::Known(x <= y),
            _ => Cond::Le(a, b),
        }
    }

    pub(in crate::backend) fn eq(&self, a: Value, b: Value) -> Cond {
        match (self.known(a), self.known(b)) {
            (Some(x), Some(y)) => Cond::Known(x == y),
            _ => Cond::Eq(a, b),
        }
    }

    pub(in crate::backend) fn finite(&self, a: Value) -> Cond {
        self.known(a).map_or(Cond::Finite(a), |x| Cond::Known(x.is_finite()))
    }

    pub(in crate::backend) fn var(&mut self) -> Var {
        self.vars += 1;
        Var(self.vars - 1)
    }

    pub(in crate::backend) fn get(&mut self, v: Var) -> Value {
        self.define(Op::Get(v))
    }

    pub(in crate::backend) fn set(&mut self, v: Var, x: Value) {
        self.push(Stmt::Set(v, x));
    }

    /// A variable that starts as a number.
    pub(in crate::backend) fn starting(&mut self, x: f64) -> Var {
        let (v, x) = (self.var(), self.number(x));
        self.set(v, x);
        v
    }

    /// A variable that is this now.
    pub(in crate::backend) fn holding(&mut self, x: Value) -> Var {
        let v = self.var();
        self.set(v, x);
        v
    }

    pub(in crate::backend) fn load(&mut self, place: Place) -> Value {
        self.define(Op::Load(place))
    }

    pub(in crate::backend) fn when(&mut self, c: Cond, f: impl FnOnce(&mut Self)) {
        self.branch(c, f, |_| {});
    }

    pub(in crate::backend) fn branch(&mut self, c: Cond, yes: impl FnOnce(&mut Self), no: impl FnOnce(&mut Self)) {
        match c.known() {
            Some(true) => yes(self),
            Some(false) => no(self),
            None => {
                let (yes, no) = (self.block(yes), self.block(no));
                self.push(Stmt::If(c, yes, no));
            }
        }
    }

    pub(in crate::backend) fn repeat(&mut self, f: impl FnOnce(&mut Self)) {
        let body = self.block(f);
        self.push(Stmt::Loop(body));
    }

    /// Room in the scratch. Where that is much, it begins at a multiple of as many numbers as processors take at once.
    pub(in crate::backend) fn room(&mut self, n: usize) -> u32 {
        if n >= MANY {
            self.scratch = self.scratch.next_multiple_of(TOGETHER as u32);
        }
        self.scratch += n as u32;
        self.scratch - n as u32
    }

    /// Does something for each of `n`: written out, or as a loop.
    pub(in crate::backend) fn each(&mut self, n: usize, mut f: impl FnMut(&mut Self, At)) {
        if n <= UNROLLED {
            (0..n).for_each(|i| f(self, At::One(i)));
            return;
        }
        let index = self.index();
        let body = self.block(|w| f(w, At::Each(index)));
        self.push(Stmt::For(index, 0, n as u32, body));
    }

    pub(in crate::backend) fn index(&mut self) -> Index {
        self.indices += 1;
        Index(self.indices - 1)
    }

    /// Room for `n` numbers that change: variables where loops are written out.
    pub(in crate::backend) fn vector(&mut self, n: usize) -> Vector {
        if n <= UNROLLED { Vector::Vars((0..n).map(|_| self.var()).collect()) } else { Vector::Memory(self.room(n)) }
    }

    /// Values in a form that can be gone through.
    pub(in crate::backend) fn values(&mut self, list: Vec<Value>) -> Vector {
        if list.len() <= UNROLLED {
            return Vector::Values(list);
        }
        let base = self.room(list.len());
        for (i, v) in list.into_iter().enumerate() {
            self.push(Stmt::Store(scratch(base, At::One(i)), v));
        }
        Vector::Memory(base)
    }
}

/// A place of the scratch.
pub(in crate::backend) fn scratch(base: u32, at: At) -> Place {
    match at {
        At::One(i) => Place::new(Memory::Scratch, base + i as u32),
        At::Each(index) => Place { along: vec![(index, 1)], ..Place::new(Memory::Scratch, base) },
        At::Cell(first, along) => {
            let along = along.into_iter().flatten().collect();
            Place { along, ..Place::new(Memory::Scratch, base + first) }
        }
        At::Through(table, index) => Place { through: Some((table, index)), ..Place::new(Memory::Scratch, base) },
    }
}
