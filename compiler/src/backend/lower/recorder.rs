//! The machine of `bond_runtime::machine` that writes what it is told to do.

use super::writer::{At, ELIMINATED, UNROLLED, Vector, Writer, scratch};
use crate::backend::code::{self, Cond, Op, Stmt, Value, Var};
use bond_runtime::ir::{Binary, Unary};
use bond_runtime::machine::{Bound, Flow, Machine, Number, Variable};
use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Range, Sub};

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

    /// A variable that is known to this machine.
    pub(in crate::backend) fn changing(&self, var: Var) -> Changing<'_> {
        Changing { var, by: self }
    }

    /// A table: the place of its first number.
    pub(in crate::backend) fn table(&self, list: Vec<u32>) -> u32 {
        self.with(|w| {
            let first = w.tables.len() as u32;
            w.tables.extend(list);
            first
        })
    }

    /// A value that is known to this machine.
    pub(in crate::backend) fn value(&self, value: Value) -> Recorded<'_> {
        Recorded { value, by: self }
    }

    /// The counters of a span, where these are known and so few that they are written out.
    fn few<'r>(&'r self, from: Bound<&'r Self>, to: Bound<&'r Self>) -> Option<Range<usize>> {
        let known = |bound: Bound<&'r Self>| match bound {
            Bound::Known(i) => Some(i),
            Bound::Past(At::One(i), more) => Some(i + more),
            Bound::Table(table, At::One(i)) => Some(self.with(|w| w.tables[table as usize + i]) as usize),
            Bound::Past(..) | Bound::Table(..) => None,
        };
        let (from, to) = (known(from)?, known(to)?);
        (to <= ELIMINATED || from >= to).then_some(from..to)
    }

    /// A loop over the counters of a span.
    fn counting<'r>(
        &'r self,
        from: Bound<&'r Self>,
        to: Bound<&'r Self>,
        back: bool,
        mut body: impl FnMut(At) -> Flow,
    ) -> Flow {
        let bound = |bound: Bound<&'r Self>| match bound {
            Bound::Known(i) => code::Bound::Known(i as u32),
            Bound::Past(At::One(i), more) => code::Bound::Known((i + more) as u32),
            Bound::Past(i, more) => code::Bound::Past(i.counter(), more as u32),
            Bound::Table(table, At::One(i)) => code::Bound::Known(self.with(|w| w.tables[table as usize + i])),
            Bound::Table(table, i) => code::Bound::Table(table, i.counter()),
        };
        let (from, to, index) = (bound(from), bound(to), self.with(Writer::index));
        let mut flow = Ok(());
        let block = self.block(|| flow = body(At::Each(index)));
        self.push(Stmt::Span(code::Span { index, from, to, back }, block));
        flow
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
    type Table = u32;

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
            (Vector::Values(list), _) => list[0],
            (Vector::Vars(list), _) => w.get(list[0]),
            (Vector::Memory(base), i) => w.load(scratch(*base, i)),
        }))
    }

    fn put(self, vector: &Vector, i: At, x: Recorded<'r>) {
        self.with(|w| match (vector, i) {
            (Vector::Vars(list), At::One(i)) => w.set(list[i], x.value),
            (Vector::Memory(base), i) => w.push(Stmt::Store(scratch(*base, i), x.value)),
            // Values are only read, and variables not looped over.
            (Vector::Values(_) | Vector::Vars(_), _) => {}
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

    fn tail(self, vector: &Vector, from: usize) -> Vector {
        match vector {
            Vector::Vars(list) => Vector::Vars(list[from..].to_vec()),
            Vector::Values(list) => Vector::Values(list[from..].to_vec()),
            Vector::Memory(base) => Vector::Memory(base + from as u32),
        }
    }

    fn cell(self, i: At, n: usize, j: At) -> At {
        i.cell(n as u32, j)
    }

    fn through(self, table: u32, counter: At) -> At {
        match counter {
            At::One(k) => At::One(self.with(|w| w.tables[table as usize + k]) as usize),
            counter => At::Through(table, counter.counter()),
        }
    }

    fn rest(self, table: u32, from: usize) -> u32 {
        table + from as u32
    }

    fn counted(self, counter: At) -> Recorded<'r> {
        match counter {
            At::One(k) => self.number(k as f64),
            counter => self.value(self.with(|w| w.define(Op::Counter(counter.counter())))),
        }
    }

    fn known_place(self, i: At) -> Option<usize> {
        if let At::One(k) = i { Some(k) } else { None }
    }

    fn inverse_scale(self, x: Recorded<'r>) -> Recorded<'r> {
        self.value(self.with(|w| w.define(Op::InverseScale(x.value))))
    }

    fn span(self, from: Bound<Self>, to: Bound<Self>, mut body: impl FnMut(At) -> Flow) -> Flow {
        match self.few(from, to) {
            Some(mut range) => range.try_for_each(|i| body(At::One(i))),
            None => self.counting(from, to, false, body),
        }
    }

    fn span_back(self, from: Bound<Self>, to: Bound<Self>, mut body: impl FnMut(At) -> Flow) -> Flow {
        match self.few(from, to) {
            Some(range) => range.rev().try_for_each(|i| body(At::One(i))),
            None => self.counting(from, to, true, body),
        }
    }

    fn fold_span<const K: usize>(
        self,
        from: Bound<Self>,
        to: Bound<Self>,
        start: [Recorded<'r>; K],
        mut body: impl FnMut(At, [Recorded<'r>; K]) -> [Recorded<'r>; K],
    ) -> [Recorded<'r>; K] {
        if let Some(range) = self.few(from, to) {
            return range.fold(start, |sum, i| body(At::One(i), sum));
        }
        let sum = start.map(|x| self.holding(x));
        let get = || std::array::from_fn(|k| sum[k].get());
        self.over(from, to, |i| body(i, get()).into_iter().zip(&sum).for_each(|(x, sum)| sum.set(x)));
        get()
    }

    fn chosen(self, which: Recorded<'r>, k: At, n: usize, mut body: impl FnMut(At)) {
        let (from, to) = (Bound::Past(k, 1), Bound::Known(n));
        let mut search = || self.over(from, to, |i| self.only(which.equals(self.counted(i)), || body(i)));
        match self.few(from, to) {
            Some(_) => search(),
            // Mostly it is none of them.
            None => self.only(!which.equals(self.counted(k)), search),
        }
    }

    fn is_positive(self, vector: &Vector) -> bool {
        match vector {
            Vector::Values(list) => self.with(|w| list.iter().all(|x| w.is_positive(*x))),
            Vector::Vars(_) | Vector::Memory(_) => false,
        }
    }
}
