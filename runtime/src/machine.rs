//! The small machine that code is written for which must mean the same everywhere.
//!
//! Such code is generic over a [`Machine`]. The runtime gives it [`Real`], where a number is an `f64` and everything
//! happens at once; the compiler gives it one that writes statements, where a number is a value of a routine and a
//! condition is decided when the routine runs. So both compute the same operations in the same order.
//!
//! Loops whose length is known when a routine is written are ordinary loops of Rust, or [`Machine::each`] and
//! [`Machine::span`] where they may become loops of the routine. Control flow that depends on numbers goes through
//! [`Machine::when`], [`Machine::branch`] and [`Machine::repeat`]. Their bodies return a [`Flow`]: to leave a loop
//! early, return what [`Machine::leave`] or [`Machine::again`] gives. In the runtime that is an `Err`, which `?` hands
//! on to the loop. A machine that writes statements returns `Ok`, and what its caller writes from there on is never
//! reached.

use crate::eval;
use crate::ir::{Binary, Unary};
use crate::kernel::Failure;
use std::cell::Cell;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// How code ends that may leave what is around it.
pub type Flow = Result<(), Exit>;

/// Where code goes on that leaves what is around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exit {
    /// After the innermost [`Machine::repeat`].
    Leave,
    /// At the beginning of the innermost [`Machine::repeat`].
    Again,
    /// Nowhere.
    Fail(Failure),
}

/// A number of a machine.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// What comparisons give. None holds with a NaN.
    type Condition;

    /// `self < other`
    fn below(self, other: Self) -> Self::Condition;
    /// `self <= other`
    fn at_most(self, other: Self) -> Self::Condition;
    /// `self = other`
    fn equals(self, other: Self) -> Self::Condition;
    /// Whether it is neither infinite nor NaN.
    fn is_finite(self) -> Self::Condition;
    /// Whether it is not 0.
    fn is_set(self) -> Self::Condition;
    /// The magnitude.
    #[must_use]
    fn abs(self) -> Self;
    /// A function of one number, as [`eval`] means it.
    #[must_use]
    fn unary(self, f: Unary) -> Self;
    /// A function of two numbers, as [`eval`] means it.
    #[must_use]
    fn binary(self, f: Binary, other: Self) -> Self;
}

/// A condition of a machine. Both sides of `&` and `|` are evaluated.
pub trait Condition: Clone + Not<Output = Self> + BitAnd<Output = Self> + BitOr<Output = Self> {}

impl<T: Clone + Not<Output = T> + BitAnd<Output = T> + BitOr<Output = T>> Condition for T {}

/// A number that changes.
pub trait Variable<N> {
    /// What it is now.
    fn get(&self) -> N;
    /// Makes it another number.
    fn set(&self, x: N);
}

/// Where a [`Machine::span`] begins or ends.
#[derive(Clone, Copy, Debug)]
pub enum Bound<M: Machine> {
    /// Always here.
    Known(usize),
    /// So many after a counter.
    Past(M::Index, usize),
    /// At the number of a table that has a counter's place.
    Table(M::Table, M::Index),
}

/// See the module.
pub trait Machine: Copy {
    /// A number that is computed once.
    type Number: Number<Condition = Self::Condition>;
    /// A condition.
    type Condition: Condition;
    /// A number that changes.
    type Variable: Variable<Self::Number>;
    /// Some numbers that change, or that are read.
    type Vector: Clone;
    /// Which of a vector's numbers: a place that is known, a counter, or what is made of counters.
    type Index: Copy;
    /// Whole numbers that are known before anything runs.
    type Table: Copy;

    /// A known number.
    fn number(self, x: f64) -> Self::Number;
    /// A known measure of rounding: larger where numbers have fewer digits.
    fn tolerance(self, x: f64) -> Self::Number;
    /// A known condition.
    fn known(self, holds: bool) -> Self::Condition;
    /// The first number where the condition holds, else the second.
    fn select(self, condition: Self::Condition, yes: Self::Number, no: Self::Number) -> Self::Number;
    /// A variable. What it is at first is not said.
    fn variable(self) -> Self::Variable;

    /// Does something where a condition holds.
    ///
    /// # Errors
    /// Where the body leaves.
    fn when(self, condition: Self::Condition, body: impl FnOnce() -> Flow) -> Flow {
        self.branch(condition, body, || Ok(()))
    }

    /// Does the first thing where a condition holds, else the second.
    ///
    /// # Errors
    /// Where the body leaves.
    fn branch(self, condition: Self::Condition, yes: impl FnOnce() -> Flow, no: impl FnOnce() -> Flow) -> Flow;

    /// Does something again and again, until it leaves.
    ///
    /// # Errors
    /// Where the body fails.
    fn repeat(self, body: impl FnMut() -> Flow) -> Flow;

    /// Leaves the innermost [`Machine::repeat`].
    ///
    /// # Errors
    /// Always, where things happen at once.
    fn leave(self) -> Flow;

    /// Begins the innermost [`Machine::repeat`] anew.
    ///
    /// # Errors
    /// Always, where things happen at once.
    fn again(self) -> Flow;

    /// The place of one number in a vector.
    fn place(self, i: usize) -> Self::Index;
    /// A number of a vector.
    fn at(self, vector: &Self::Vector, i: Self::Index) -> Self::Number;
    /// A vector without so many of its first numbers.
    fn tail(self, vector: &Self::Vector, from: usize) -> Self::Vector;
    /// The place `i * n + j`.
    fn cell(self, i: Self::Index, n: usize, j: Self::Index) -> Self::Index;
    /// The place that a table has for a counter.
    fn through(self, table: Self::Table, counter: Self::Index) -> Self::Index;
    /// A table without so many of its first numbers.
    fn rest(self, table: Self::Table, from: usize) -> Self::Table;
    /// A counter as a number.
    fn counted(self, counter: Self::Index) -> Self::Number;
    /// What a place is, where that is known before anything runs.
    fn known_place(self, i: Self::Index) -> Option<usize>;
    /// [`eval::inverse_scale`]
    fn inverse_scale(self, x: Self::Number) -> Self::Number;
    /// Replaces a number of a vector.
    fn put(self, vector: &Self::Vector, i: Self::Index, x: Self::Number);
    /// Does something for each place of a vector of `n` numbers.
    fn each(self, n: usize, body: impl FnMut(Self::Index));

    /// `start`, and then for each of `n` what `body` makes of it.
    fn fold(
        self,
        n: usize,
        start: Self::Number,
        body: impl FnMut(Self::Index, Self::Number) -> Self::Number,
    ) -> Self::Number;

    /// Whether a condition holds for each of `n`.
    fn all(self, n: usize, condition: impl FnMut(Self::Index) -> Self::Condition) -> Self::Condition;

    /// Whether all numbers of a vector are known to be positive and finite, before anything runs.
    fn is_positive(self, vector: &Self::Vector) -> bool;

    /// Does something for each counter from one bound up to, and without, another.
    ///
    /// # Errors
    /// Where the body leaves.
    fn span(self, from: Bound<Self>, to: Bound<Self>, body: impl FnMut(Self::Index) -> Flow) -> Flow;

    /// The same, from the last to the first.
    ///
    /// # Errors
    /// Where the body leaves.
    fn span_back(self, from: Bound<Self>, to: Bound<Self>, body: impl FnMut(Self::Index) -> Flow) -> Flow;

    /// `start`, and then for each counter of a span what `body` makes of it.
    fn fold_span<const K: usize>(
        self,
        from: Bound<Self>,
        to: Bound<Self>,
        start: [Self::Number; K],
        body: impl FnMut(Self::Index, [Self::Number; K]) -> [Self::Number; K],
    ) -> [Self::Number; K];

    /// Does something for each counter of a span, which leaves nothing around it.
    fn over(self, from: Bound<Self>, to: Bound<Self>, mut body: impl FnMut(Self::Index)) {
        // Such a body has nothing to hand on.
        let _ = self.span(from, to, |i| {
            body(i);
            Ok(())
        });
    }

    /// Does something with that of the counters after `k`, below `n`, which is equal to `which`, if one is.
    fn chosen(self, which: Self::Number, k: Self::Index, n: usize, mut body: impl FnMut(Self::Index)) {
        self.over(Bound::Past(k, 1), Bound::Known(n), |i| self.only(which.equals(self.counted(i)), || body(i)));
    }

    /// Takes row `k` of a matrix of `n` columns times a factor off row `i`, behind column `k`.
    fn take_off(self, matrix: &Self::Vector, n: usize, (i, k): (Self::Index, Self::Index), factor: Self::Number) {
        self.over(Bound::Past(k, 1), Bound::Known(n), |j| {
            let to = self.cell(i, n, j);
            self.put(matrix, to, self.at(matrix, to) - factor * self.at(matrix, self.cell(k, n, j)));
        });
    }

    /// A variable that is this now.
    fn holding(self, x: Self::Number) -> Self::Variable {
        let variable = self.variable();
        variable.set(x);
        variable
    }

    /// Does something where a condition holds, which leaves nothing around it.
    fn only(self, condition: Self::Condition, body: impl FnOnce()) {
        // Such a body has nothing to hand on.
        let _ = self.when(condition, || {
            body();
            Ok(())
        });
    }
}

/// Numbers as they are: everything happens at once. Vectors are cells of the caller's memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Real<'a>(std::marker::PhantomData<&'a Cell<f64>>);

impl Real<'_> {
    /// The machine.
    pub fn new() -> Self {
        Self::default()
    }
}

/// Numbers in memory, as a vector of [`Real`].
pub fn cells(numbers: &mut [f64]) -> &[Cell<f64>] {
    Cell::from_mut(numbers).as_slice_of_cells()
}

impl Number for f64 {
    type Condition = bool;

    #[inline(always)]
    fn below(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn equals(self, other: Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }

    #[inline(always)]
    fn is_set(self) -> bool {
        self != 0.0
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    fn unary(self, f: Unary) -> Self {
        eval::unary(f, self)
    }

    fn binary(self, f: Binary, other: Self) -> Self {
        eval::binary(f, self, other)
    }
}

impl Variable<f64> for Cell<f64> {
    #[inline(always)]
    fn get(&self) -> f64 {
        Cell::get(self)
    }

    #[inline(always)]
    fn set(&self, x: f64) {
        Cell::set(self, x);
    }
}

impl Bound<Real<'_>> {
    #[inline(always)]
    fn place(self) -> usize {
        match self {
            Bound::Known(i) => i,
            Bound::Past(i, more) => i + more,
            Bound::Table(table, i) => table[i] as usize,
        }
    }
}

impl<'a> Machine for Real<'a> {
    type Number = f64;
    type Condition = bool;
    type Variable = Cell<f64>;
    type Vector = &'a [Cell<f64>];
    type Index = usize;
    type Table = &'a [u32];

    #[inline(always)]
    fn number(self, x: f64) -> f64 {
        x
    }

    #[inline(always)]
    fn tolerance(self, x: f64) -> f64 {
        x
    }

    #[inline(always)]
    fn known(self, holds: bool) -> bool {
        holds
    }

    #[inline(always)]
    fn select(self, condition: bool, yes: f64, no: f64) -> f64 {
        if condition { yes } else { no }
    }

    #[inline(always)]
    fn variable(self) -> Cell<f64> {
        Cell::new(0.0)
    }

    #[inline(always)]
    fn branch(self, condition: bool, yes: impl FnOnce() -> Flow, no: impl FnOnce() -> Flow) -> Flow {
        if condition { yes() } else { no() }
    }

    #[inline(always)]
    fn repeat(self, mut body: impl FnMut() -> Flow) -> Flow {
        loop {
            match body() {
                Ok(()) | Err(Exit::Again) => {}
                Err(Exit::Leave) => return Ok(()),
                fail @ Err(Exit::Fail(_)) => return fail,
            }
        }
    }

    #[inline(always)]
    fn leave(self) -> Flow {
        Err(Exit::Leave)
    }

    #[inline(always)]
    fn again(self) -> Flow {
        Err(Exit::Again)
    }

    #[inline(always)]
    fn place(self, i: usize) -> usize {
        i
    }

    #[inline(always)]
    fn at(self, vector: &&'a [Cell<f64>], i: usize) -> f64 {
        vector[i].get()
    }

    #[inline(always)]
    fn put(self, vector: &&'a [Cell<f64>], i: usize, x: f64) {
        vector[i].set(x);
    }

    #[inline(always)]
    fn each(self, n: usize, body: impl FnMut(usize)) {
        (0..n).for_each(body);
    }

    #[inline(always)]
    fn fold(self, n: usize, start: f64, mut body: impl FnMut(usize, f64) -> f64) -> f64 {
        (0..n).fold(start, |sum, i| body(i, sum))
    }

    #[inline(always)]
    fn all(self, n: usize, condition: impl FnMut(usize) -> bool) -> bool {
        (0..n).all(condition)
    }

    #[inline(always)]
    fn tail(self, vector: &&'a [Cell<f64>], from: usize) -> &'a [Cell<f64>] {
        &vector[from..]
    }

    #[inline(always)]
    fn cell(self, i: usize, n: usize, j: usize) -> usize {
        i * n + j
    }

    #[inline(always)]
    fn through(self, table: &'a [u32], counter: usize) -> usize {
        table[counter] as usize
    }

    #[inline(always)]
    fn rest(self, table: &'a [u32], from: usize) -> &'a [u32] {
        &table[from..]
    }

    #[inline(always)]
    fn counted(self, counter: usize) -> f64 {
        counter as f64
    }

    #[inline(always)]
    fn known_place(self, i: usize) -> Option<usize> {
        Some(i)
    }

    #[inline(always)]
    fn inverse_scale(self, x: f64) -> f64 {
        eval::inverse_scale(x)
    }

    #[inline(always)]
    fn span(self, from: Bound<Self>, to: Bound<Self>, body: impl FnMut(usize) -> Flow) -> Flow {
        (from.place()..to.place()).try_for_each(body)
    }

    #[inline(always)]
    fn span_back(self, from: Bound<Self>, to: Bound<Self>, body: impl FnMut(usize) -> Flow) -> Flow {
        (from.place()..to.place()).rev().try_for_each(body)
    }

    #[inline(always)]
    fn fold_span<const K: usize>(
        self,
        from: Bound<Self>,
        to: Bound<Self>,
        start: [f64; K],
        mut body: impl FnMut(usize, [f64; K]) -> [f64; K],
    ) -> [f64; K] {
        (from.place()..to.place()).fold(start, |sum, i| body(i, sum))
    }

    #[inline(always)]
    fn chosen(self, which: f64, k: usize, n: usize, mut body: impl FnMut(usize)) {
        if (k + 1..n).contains(&(which as usize)) {
            body(which as usize);
        }
    }

    #[inline(always)]
    fn take_off(self, matrix: &&'a [Cell<f64>], n: usize, (i, k): (usize, usize), factor: f64) {
        let row = |i: usize| &matrix[i * n + k + 1..(i + 1) * n];
        row(i).iter().zip(row(k)).for_each(|(x, u)| x.set(x.get() - factor * u.get()));
    }

    #[inline(always)]
    fn is_positive(self, vector: &&'a [Cell<f64>]) -> bool {
        vector.iter().all(|x| x.get() > 0.0 && x.get().is_finite())
    }
}
