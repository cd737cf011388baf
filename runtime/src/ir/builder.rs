//! Makes programs. Equal values of one block are made once.

use super::prune::prune;
use super::{Array, Binary, Inst, Newton, Op, Program, Slot, Solve, Unary, Value};
use crate::eval;
use rustc_hash::FxHashMap;

/// So many sums are added up side by side by [`Builder::total`], where there are many terms.
pub const SIDE_BY_SIDE: usize = 8;
/// So many terms are many.
const MANY: usize = 16 * SIDE_BY_SIDE;

/// An op by its bits, so that it can be looked up.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Key {
    Const(u64),
    Unary(Unary, Value),
    Binary(Binary, Value, Value),
    Select(Value, Value, Value),
}

/// A block that is being written, and the loads and values known in it.
#[derive(Default)]
struct Scope {
    body: Vec<Inst>,
    numbered: FxHashMap<Key, Value>,
    /// Loads apart, for they are forgotten one by one: of each array, what was loaded of each slot.
    loads: [Vec<Option<Value>>; 6],
}

/// Writes a [`Program`] instruction by instruction.
pub struct Builder {
    name: String,
    sizes: [u32; 6],
    names: Vec<(Slot, String)>,
    scopes: Vec<Scope>,
    values: u32,
    numbers: FxHashMap<Value, f64>,
    /// Those of iterations.
    products: FxHashMap<Value, (Value, Value)>,
}

impl Builder {
    /// An empty program.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            sizes: [0; 6],
            names: Vec::new(),
            scopes: vec![Scope::default()],
            values: 0,
            numbers: FxHashMap::default(),
            products: FxHashMap::default(),
        }
    }

    /// Takes the next slot of an array.
    pub fn slot(&mut self, array: Array) -> Slot {
        self.slots(array, 1)
    }

    /// Takes the next `count` slots of an array; the first is returned.
    pub fn slots(&mut self, array: Array, count: usize) -> Slot {
        let index = self.sizes[array as usize];
        self.sizes[array as usize] += count as u32;
        Slot { array, index }
    }

    /// Takes the next slot of an array and names it.
    pub fn named(&mut self, array: Array, name: impl Into<String>) -> Slot {
        let slot = self.slot(array);
        self.names.push((slot, name.into()));
        slot
    }

    /// Names a slot that is there.
    pub fn name(&mut self, slot: Slot, name: impl Into<String>) {
        self.names.push((slot, name.into()));
    }

    /// Size of an array so far.
    pub fn size(&self, array: Array) -> usize {
        self.sizes[array as usize] as usize
    }

    /// The value of an op, made once in its block; a function of numbers is a number.
    pub fn op(&mut self, op: Op) -> Value {
        let known = |v: Value| self.numbers.get(&v).copied();
        let op = match op {
            Op::Unary(f, a) => known(a).map_or(op, |x| Op::Const(eval::unary(f, x))),
            Op::Binary(f, a, b) => match (known(a), known(b)) {
                (Some(x), Some(y)) => Op::Const(eval::binary(f, x, y)),
                _ => op,
            },
            Op::Const(_) | Op::Load(_) | Op::Select(..) => op,
        };
        let key = match op {
            Op::Load(slot) => return self.load(slot),
            Op::Const(x) => Key::Const(x.to_bits()),
            Op::Unary(f, a) => Key::Unary(f, a),
            Op::Binary(f, a, b) => Key::Binary(f, a, b),
            Op::Select(c, a, b) => Key::Select(c, a, b),
        };
        for scope in self.scopes.iter().rev() {
            if let Some(v) = scope.numbered.get(&key) {
                return *v;
            }
        }
        let v = self.define(op);
        // The measure of rounding is another one where numbers are shorter.
        if let Op::Const(x) = op
            && x != f64::EPSILON
        {
            self.numbers.insert(v, x);
        }
        if let Op::Binary(Binary::Mul, a, b) = op
            && self.scopes.len() > 1
        {
            self.products.insert(v, (a, b));
        }
        if let Some(scope) = self.scopes.last_mut() {
            scope.numbered.insert(key, v);
        }
        v
    }

    /// What a value of an iteration's body is the product of, where it is one.
    pub fn factors(&self, v: Value) -> Option<(Value, Value)> {
        self.products.get(&v).copied()
    }

    /// A new value.
    fn define(&mut self, op: Op) -> Value {
        let v = Value(self.values);
        self.values += 1;
        if let Some(scope) = self.scopes.last_mut() {
            scope.body.push(Inst::Let(v, op));
        }
        v
    }

    /// A number.
    pub fn number(&mut self, x: f64) -> Value {
        self.op(Op::Const(x))
    }

    /// What a slot holds now.
    pub fn load(&mut self, slot: Slot) -> Value {
        for scope in self.scopes.iter().rev() {
            if let Some(Some(v)) = scope.loads[slot.array as usize].get(slot.index as usize) {
                return *v;
            }
        }
        let v = self.define(Op::Load(slot));
        if let Some(scope) = self.scopes.last_mut() {
            let (loads, at) = (&mut scope.loads[slot.array as usize], slot.index as usize);
            if loads.len() <= at {
                loads.resize(at + 1, None);
            }
            loads[at] = Some(v);
        }
        v
    }

    /// A function of one value.
    pub fn unary(&mut self, f: Unary, a: Value) -> Value {
        self.op(Op::Unary(f, a))
    }

    /// How many values there are so far: later ones have larger numbers.
    pub fn count(&self) -> u32 {
        self.values
    }

    /// A function of two values.
    pub fn binary(&mut self, f: Binary, a: Value, b: Value) -> Value {
        self.op(Op::Binary(f, a, b))
    }

    /// `a + b`
    pub fn add(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Add, a, b)
    }

    /// The sum of some values; None of none. Of many, each is added to the one [`SIDE_BY_SIDE`] before it, and what
    /// that leaves half to half, so that back ends add several at once.
    pub fn total(&mut self, values: &[Value]) -> Option<Value> {
        let (first, rest) = values.split_at(if values.len() < MANY { 1.min(values.len()) } else { SIDE_BY_SIDE });
        let mut parts = first.to_vec();
        for (k, value) in rest.iter().enumerate() {
            let at = k % first.len();
            parts[at] = self.add(parts[at], *value);
        }
        while parts.len() > 1 {
            let other = parts.split_off(parts.len() / 2);
            parts = parts.iter().zip(&other).map(|(a, b)| self.add(*a, *b)).collect();
        }
        parts.pop()
    }

    /// `a - b`
    pub fn sub(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Sub, a, b)
    }

    /// `a * b`
    pub fn mul(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Mul, a, b)
    }

    /// `a / b`
    pub fn div(&mut self, a: Value, b: Value) -> Value {
        self.binary(Binary::Div, a, b)
    }

    /// `if c then a else b`
    pub fn select(&mut self, c: Value, a: Value, b: Value) -> Value {
        self.op(Op::Select(c, a, b))
    }

    /// Writes a slot; later loads of it see the new value.
    pub fn store(&mut self, slot: Slot, value: Value) {
        self.forget(slot.array, slot.index, 1);
        if let Some(scope) = self.scopes.last_mut() {
            scope.body.push(Inst::Store(slot, value));
        }
    }

    /// Adds a structured instruction that writes `count` slots from `slot` on.
    pub fn push(&mut self, inst: Inst, writes: Slot, count: usize) {
        self.forget(writes.array, writes.index, count as u32);
        if let Some(scope) = self.scopes.last_mut() {
            scope.body.push(inst);
        }
    }

    /// Solves linear equations.
    pub fn solve(&mut self, solve: Solve) {
        if let Some(flag) = solve.flag {
            self.forget(flag.array, flag.index, 1);
        }
        let (first, numbers) = (Slot { array: Array::Local, index: solve.unknowns }, solve.right.len());
        self.push(Inst::Solve(Box::new(solve)), first, numbers);
    }

    /// Opens the body of an iteration on `n` unknowns that start at `unknowns`. Loads of `Local` are made anew inside:
    /// the unknowns change from iteration to iteration, and so may whatever the body stores.
    pub fn open(&mut self, unknowns: Slot, n: usize) {
        let end = unknowns.index.saturating_add(n as u32);
        self.forget(Array::Local, 0, end.max(self.sizes[Array::Local as usize]));
        self.scopes.push(Scope::default());
    }

    /// Closes the body opened last and adds the iteration, whose `body` is filled in.
    pub fn close(&mut self, mut newton: Newton) {
        if self.scopes.len() < 2 {
            return;
        }
        let body = self.scopes.pop().map(|s| s.body).unwrap_or_default();
        let first = newton.unknowns;
        let n = newton.residual.len() as u32;
        let flag = newton.flag;
        newton.body = body;
        self.forget(Array::Local, first, n);
        if let Some(rounding) = newton.rounding {
            self.forget(Array::Local, rounding, n);
        }
        if let Some(f) = flag {
            self.forget(f.array, f.index, 1);
        }
        if let Some(scope) = self.scopes.last_mut() {
            scope.body.push(Inst::Newton(Box::new(newton)));
        }
    }

    /// The finished program.
    pub fn finish(mut self) -> Program {
        while self.scopes.len() > 1 {
            self.scopes.pop();
        }
        let mut body = self.scopes.pop().map(|s| s.body).unwrap_or_default();
        let values = prune(&mut body, self.values);
        Program { name: self.name, sizes: self.sizes, names: self.names, body, values }
    }

    /// Forgets loads of slots that are about to change. What was computed from the old loads keeps its name: values
    /// never change.
    fn forget(&mut self, array: Array, first: u32, count: u32) {
        if array != Array::Local {
            return; // nothing else is both written and read
        }
        for scope in &mut self.scopes {
            let loads = &mut scope.loads[array as usize];
            let last = first.saturating_add(count).min(loads.len() as u32);
            if first < last {
                loads[first as usize..last as usize].fill(None);
            }
        }
    }
}
