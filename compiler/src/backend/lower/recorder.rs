//! The machine of `bond_runtime::machine` that writes what it is told to do.

use super::writer::{At, UNROLLED, Vector, Writer, scratch};
use crate::backend::code::{Cond, Stmt, Value, Var};
use bond_runtime::ir::{Binary, Unary};
use bond_runtime::machine::{Flow, Machine, Number, Variable};
use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A writer that many numbers write by.
#[derive(Default)]
pub(in crate::backend) struct Recorder(RefCell<Writer>);

/// A value of a routine.
#[derive(Clone, Copy)]
pub(in crate::backend) struct Recorded<'r> {
    pub(in crate::backend) value: Value,
    by: &'r Recorder,
}

/// A variable of a routine.
#[derive(Clone, Copy)]
pub(in crate::backend) struct Changing<'r> {
    pub(in crate::backend) var: Var,
    by: &'r Recorder,
}

impl Recorder {
    pub(in crate::backend) fn new(writer: Writer) -> Self {
        Self(RefCell::new(writer))
    }

    /// The writer, with all that was written.
    pub(in crate::backend) fn into_writer(self) -> Writer {
        self.0.into_inner()
    }

    /// What is done with the writer.
    pub(in crate::backend) fn with<T>(&self, f: impl FnOnce(&mut Writer) -> T) -> T {
        f(&mut self.0.borrow_mut())
    }

    /// A value that is known to this machine.
    pub(in crate::backend) fn value(&self, value: Value) -> Recorded<'_> {
        Recorded { value, by: self }
    }

    fn push(&self, s: Stmt) {
        self.with(|w| w.push(s));
    }

    /// What `f` writes, as a block.
    fn block(&self, f: impl FnOnce()) -> Vec<Stmt> {
        self.with(Writer::open);
        f();
        self.with(Writer::close)
    }
}

impl<'r> Recorded<'r> {
    fn two(self, other: Self, f: impl FnOnce(&mut Writer, Value, Value) -> Value) -> Self {
        self.by.value(self.by.with(|w| f(w, self.value, other.value)))
    }

    fn compare(self, other: Self, f: impl FnOnce(&Writer, Value, Value) -> Cond) -> Cond {
        self.by.with(|w| f(w, self.value, other.value))
    }
}

impl Add for Recorded<'_> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.two(other, Writer::add)
    }
}

impl Sub for Recorded<'_> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.two(other, Writer::sub)
    }
}

impl Mul for Recorded<'_> {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        self.two(other, Writer::mul)
    }
}

impl Div for Recorded<'_> {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        self.two(other, Writer::div)
    }
}

impl Neg for Recorded<'_> {
    type Output = Self;

    fn neg(self) -> Self {
        Number::unary(self, Unary::Neg)
    }
}

impl Number for Recorded<'_> {
    type Condition = Cond;

    fn below(self, other: Self) -> Cond {
        self.compare(other, Writer::lt)
    }

    fn at_most(self, other: Self) -> Cond {
        self.compare(other, Writer::le)
    }

    fn equals(self, other: Self) -> Cond {
        self.compare(other, Writer::eq)
    }

    fn is_finite(self) -> Cond {
        self.by.with(|w| w.finite(self.value))
    }

    fn is_set(self) -> Cond {
        self.by.with(|w| w.is_true(self.value))
    }

    fn abs(self) -> Self {
        Number::unary(self, Unary::Abs)
    }

    fn unary(self, f: Unary) -> Self {
        self.by.value(self.by.with(|w| w.unary(f, self.value)))
    }

    fn binary(self, f: Binary, other: Self) -> Self {
        self.two(other, |w, a, b| w.binary(f, a, b))
    }
}

impl<'r> Variable<Recorded<'r>> for Changing<'r> {
    fn get(&self) -> Recorded<'r> {
        self.by.value(self.by.with(|w| w.get(self.var)))
    }

    fn set(&self, x: Recorded<'r>) {
        self.by.with(|w| w.set(self.var, x.value));
    }
}

impl<'r> Machine for &'r Recorder {
    type Number = Recorded<'r>;
    type Condition = Cond;
    type Variable = Changing<'r>;
    type Vector = Vector;
    type Index = At;

    fn number(self, x: f64) -> Recorded<'r> {
        self.value(self.with(|w| w.number(x)))
    }

    fn tolerance(self, x: f64) -> Recorded<'r> {
        self.value(self.with(|w| w.tolerance(x)))
    }

    fn known(self, holds: bool) -> Cond {
        Cond::Known(holds)
    }

    fn select(self, condition: Cond, yes: Recorded<'r>, no: Recorded<'r>) -> Recorded<'r> {
        self.value(self.with(|w| w.select(condition, yes.value, no.value)))
    }

    fn variable(self) -> Changing<'r> {
        Changing { var: self.with(Writer::var), by: self }
    }

    fn branch(self, condition: Cond, yes: impl FnOnce() -> Flow, no: impl FnOnce() -> Flow) -> Flow {
        match condition.known() {
            Some(true) => yes(),
            Some(false) => no(),
            None => {
                let (mut first, mut second) = (Ok(()), Ok(()));
                let (yes, no) = (self.block(|| first = yes()), self.block(|| second = no()));
                self.push(Stmt::If(condition, yes, no));
                first.and(second)
            }
        }
    }

    fn repeat(self, mut body: impl FnMut() -> Flow) -> Flow {
        let mut flow = Ok(());
        let block = self.block(|| flow = body());
        self.push(Stmt::Loop(block));
        flow
    }

    fn leave(self) -> Flow {
        self.push(Stmt::Break);
        Ok(())
    }

    fn again(self) -> Flow {
        self.push(Stmt::Continue);
        Ok(())
    }

    fn place(self, i: usize) -> At {
        At::One(i)
    }

    fn at(self, vector: &Vector, i: At) -> Recorded<'r> {
        self.value(self.with(|w| match (vector, i) {
            (Vector::Values(list), At::One(i)) => list[i],
            (Vector::Vars(list), At::One(i)) => w.get(list[i]),
            // Only what is in memory is looped over.
            (Vector::Values(list), At::Each(_)) => list[0],
            (Vector::Vars(list), At::Each(_)) => w.get(list[0]),
            (Vector::Memory(base), i) => w.load(scratch(*base, i)),
        }))
    }

    fn put(self, vector: &Vector, i: At, x: Recorded<'r>) {
        self.with(|w| match (vector, i) {
            (Vector::Vars(list), At::One(i)) => w.set(list[i], x.value),
            (Vector::Memory(base), i) => w.push(Stmt::Store(scratch(*base, i), x.value)),
            // Values are only read, and variables not looped over.
            (Vector::Values(_), _) | (Vector::Vars(_), At::Each(_)) => {}
        });
    }

    fn each(self, n: usize, mut body: impl FnMut(At)) {
        if n <= UNROLLED {
            return (0..n).for_each(|i| body(At::One(i)));
        }
        let index = self.with(Writer::index);
        let block = self.block(|| body(At::Each(index)));
        self.push(Stmt::For(index, 0, n as u32, block));
    }

    fn fold(
        self,
        n: usize,
        start: Recorded<'r>,
        mut body: impl FnMut(At, Recorded<'r>) -> Recorded<'r>,
    ) -> Recorded<'r> {
        if n <= UNROLLED {
            return (0..n).fold(start, |sum, i| body(At::One(i), sum));
        }
        let sum = self.holding(start);
        self.each(n, |i| sum.set(body(i, sum.get())));
        sum.get()
    }

    fn all(self, n: usize, mut condition: impl FnMut(At) -> Cond) -> Cond {
        if n <= UNROLLED {
            return Cond::all((0..n).map(|i| condition(At::One(i))).collect::<Vec<_>>());
        }
        let (one, zero) = (self.number(1.0), self.number(0.0));
        self.fold(n, one, |i, before| self.select(condition(i), before, zero)).is_set()
    }

    fn is_positive(self, vector: &Vector) -> bool {
        match vector {
            Vector::Values(list) => self.with(|w| list.iter().all(|x| w.is_positive(*x))),
            Vector::Vars(_) | Vector::Memory(_) => false,
        }
    }
}
