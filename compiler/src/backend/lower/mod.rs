//! From a step program to a routine: Newton's method, elimination and products become plain statements.
//!
//! Where a program has few numbers, all loops are written out, and its scratch becomes variables; else it stays in
//! memory.

mod dead_code;
mod eliminate;
mod fuse;
mod newton;
mod options;
pub(super) mod recorder;
mod reroll;
mod solvers;
pub(super) mod writer;

pub(super) use fuse::may_pair;
pub(super) use solvers::{Solvers, with_solvers};

use super::code::{Index, Memory, Place, Reason, Routine, Stmt, Value, Var};
use bond_runtime::ir::{self, Array, Inst, Op, Program, Slot};
use rustc_hash::{FxHashMap, FxHashSet};
use writer::{ELIMINATED, UNROLLED, Writer};

/// Products with so many entries at most are written out.
const ENTRIES: usize = 64;
/// Programs of more values than this are looked through for loops.
const STRAIGHT: usize = 3000;

/// Where the arrays of a program are: for each of [`Array::ALL`] a memory and the place of its first number. That of
/// `Local` counts only where the program's scratch is not made of variables.
pub(super) type Places = [(Memory, u32); 6];

/// Each array in the memory of its own name.
const OWN: Places = [
    (Memory::State, 0),
    (Memory::Next, 0),
    (Memory::Input, 0),
    (Memory::Table, 0),
    (Memory::Scratch, 0),
    (Memory::Output, 0),
];

/// The routine of a program. None where an iteration inside another may fail it, which routines have no way to say.
///
/// # Panics
/// Where the program does not pass [`Program::verify`].
pub fn lower(program: &Program) -> Option<Routine> {
    let writer = write(Writer::new(), program, OWN, None)?;
    Some(writer.routine(program.name.clone()))
}

/// A routine that takes [`Program::numbers`] from [`Memory::Data`], and so does for all programs of the same code
/// shape. None as of [`lower`], or where the program is large: then its isomorphic groups take the numbers in which
/// their members differ from there.
///
/// # Panics
/// As [`lower`].
pub fn lower_apart(program: &Program) -> Option<Routine> {
    let mut writer = Writer::new();
    writer.data = program.numbers().into_iter().map(|n| n.1).collect();
    let writer = write(writer, program, OWN, Some(0))?;
    Some(writer.routine(program.name.clone()))
}

/// Writes a program where the writer stands, with its numbers as they are, or as those from this place of
/// [`Memory::Data`] on. None as of [`lower_apart`] or [`lower`].
pub(super) fn write(mut writer: Writer, program: &Program, mut places: Places, numbers: Option<u32>) -> Option<Writer> {
    if nested(&program.body, false) || (numbers.is_some() && is_large(program)) {
        return None;
    }
    if is_large(program) {
        let (back, done) = reroll::write(writer, program, places);
        if done {
            return Some(back);
        }
        writer = back;
    }
    let locals = program.size(Array::Local);
    let local = if is_small(&program.body) {
        Local::Vars((0..locals).map(|_| writer.var()).collect())
    } else {
        let base = writer.room(locals);
        places[Array::Local as usize] = (Memory::Scratch, base);
        Local::Memory(base)
    };
    let values = vec![None; program.values as usize];
    let apart = numbers.map_or_else(FxHashMap::default, |first| {
        let list = program.numbers().into_iter().zip(first..);
        list.map(|((v, x), at)| (v, (at, x))).collect()
    });
    let (once, settled) = (written_once(&program.body), FxHashMap::default());
    let mut lower = Lower { w: writer, values, local, places, apart, once, settled, next: Vec::new() };
    lower.block(&program.body);
    lower.check(program.size(Array::Next));
    Some(lower.w)
}

/// Where the program's scratch is.
enum Local {
    Vars(Vec<Var>),
    /// From this number of the scratch on.
    Memory(u32),
}

/// A program on its way.
struct Lower {
    w: Writer,
    values: Vec<Option<Value>>,
    local: Local,
    places: Places,
    /// Numbers that are kept apart: where, and what this program has there.
    apart: FxHashMap<ir::Value, (u32, f64)>,
    /// Numbers of the scratch that are written once, outside of iterations.
    once: FxHashSet<u32>,
    /// Those of them that are known by now.
    settled: FxHashMap<u32, Value>,
    /// Values written to `Next`, where they are known by name.
    next: Vec<Value>,
}

/// Whether a program has so many values that loops are looked for.
pub fn is_large(program: &Program) -> bool {
    program.values as usize > STRAIGHT
}

/// What of the scratch is written once, outside of iterations.
fn written_once(body: &[Inst]) -> FxHashSet<u32> {
    fn look(body: &[Inst], inside: bool, count: &mut FxHashMap<u32, u32>) {
        let mut written = |first: u32, size: u32| {
            (first..first + size).for_each(|k| *count.entry(k).or_default() += if inside { 2 } else { 1 });
        };
        for inst in body {
            match inst {
                Inst::Store(to, _) | Inst::Quad { to, .. } if to.array == Array::Local => written(to.index, 1),
                Inst::MatVec { to, rows, .. } if to.array == Array::Local => written(to.index, *rows),
                Inst::Solve(s) => written(s.unknowns, s.right.len() as u32),
                Inst::Newton(n) => written(n.unknowns, n.residual.len() as u32),
                Inst::Let(..) | Inst::Store(..) | Inst::Quad { .. } | Inst::MatVec { .. } => {}
            }
        }
        for inst in body {
            let flag = match inst {
                Inst::Newton(n) => {
                    look(&n.body, true, count);
                    n.flag
                }
                Inst::Solve(s) => s.flag,
                Inst::Let(..) | Inst::Store(..) | Inst::Quad { .. } | Inst::MatVec { .. } => None,
            };
            flag.into_iter().for_each(|slot| *count.entry(slot.index).or_default() += 1);
        }
    }
    let mut count = FxHashMap::default();
    look(body, false, &mut count);
    count.into_iter().filter(|(_, times)| *times == 1).map(|(k, _)| k).collect()
}

/// Whether an iteration without a flag is inside another.
fn nested(body: &[Inst], inside: bool) -> bool {
    body.iter().any(|inst| match inst {
        Inst::Newton(n) => (inside && n.flag.is_none()) || nested(&n.body, true),
        Inst::Solve(s) => inside && s.flag.is_none(),
        Inst::Let(..) | Inst::Store(..) | Inst::MatVec { .. } | Inst::Quad { .. } => false,
    })
}

/// Whether all loops are written out.
fn is_small(body: &[Inst]) -> bool {
    body.iter().all(|inst| match inst {
        Inst::Newton(n) => n.residual.len() <= UNROLLED && is_small(&n.body),
        Inst::Solve(s) => s.right.len() <= UNROLLED,
        Inst::MatVec { rows, cols, .. } => (*rows as usize) * (*cols as usize) <= ENTRIES,
        Inst::Quad { n, .. } => (*n as usize) * (*n as usize) <= ENTRIES,
        Inst::Let(..) | Inst::Store(..) => true,
    })
}

impl Lower {
    fn of(&self, v: ir::Value) -> Value {
        self.values[v.0 as usize].unwrap_or(Value(0))
    }

    fn all<'v>(&self, list: impl IntoIterator<Item = &'v ir::Value>) -> Vec<Value> {
        list.into_iter().map(|v| self.of(*v)).collect()
    }

    fn block(&mut self, body: &[Inst]) {
        for inst in body {
            match inst {
                Inst::Let(v, op) => {
                    let value = match *op {
                        Op::Const(_) if let Some(&(at, x)) = self.apart.get(v) => {
                            let kept = self.w.load(Place::new(Memory::Data, at));
                            if x > 0.0 {
                                self.w.positive.insert(kept);
                            }
                            kept
                        }
                        Op::Const(x) if x.to_bits() == f64::EPSILON.to_bits() => self.w.tolerance(x),
                        Op::Const(x) => self.w.number(x),
                        Op::Load(slot) => self.read(slot, 0, None),
                        Op::Unary(f, a) => {
                            let a = self.of(a);
                            self.w.unary(f, a)
                        }
                        Op::Binary(f, a, b) => {
                            let (a, b) = (self.of(a), self.of(b));
                            self.w.binary(f, a, b)
                        }
                        Op::Select(c, a, b) => {
                            let (c, a, b) = (self.of(c), self.of(a), self.of(b));
                            let c = self.w.is_true(c);
                            self.w.select(c, a, b)
                        }
                    };
                    self.values[v.0 as usize] = Some(value);
                }
                Inst::Store(slot, v) => {
                    let v = self.of(*v);
                    self.write(*slot, None, v);
                }
                Inst::Newton(n) => self.newton(n),
                Inst::Solve(s) => self.linear(s),
                Inst::MatVec { to, table, from, rows, cols, low } => {
                    self.product(*to, *table, *from, (*rows as usize, *cols as usize), *low);
                }
                Inst::Quad { to, table, from, n, root } => self.form(*to, *table, *from, *n as usize, *root),
            }
        }
    }

    /// The number `offset` after a slot, and further on by a counter.
    fn read(&mut self, slot: Slot, offset: usize, along: Option<Index>) -> Value {
        let index = slot.index as usize + offset;
        if let (Array::Local, Local::Vars(vars)) = (slot.array, &self.local) {
            let v = vars[index];
            return self.settled.get(&(index as u32)).copied().unwrap_or_else(|| self.w.get(v));
        }
        let along = along.map(|i| (i, 1)).into_iter().collect();
        let (memory, base) = self.places[slot.array as usize];
        self.w.load(Place { along, ..Place::new(memory, base + index as u32) })
    }

    fn write(&mut self, slot: Slot, along: Option<Index>, v: Value) {
        if let (Array::Local, Local::Vars(vars)) = (slot.array, &self.local) {
            let var = vars[slot.index as usize];
            if self.w.known(v).is_some() && self.once.contains(&slot.index) {
                self.settled.insert(slot.index, v);
            }
            return self.w.set(var, v);
        }
        if slot.array == Array::Next && along.is_none() {
            self.next.push(v);
        }
        let along = along.map(|i| (i, 1)).into_iter().collect();
        let (memory, base) = self.places[slot.array as usize];
        self.w.push(Stmt::Store(Place { along, ..Place::new(memory, base + slot.index) }, v));
    }

    /// `to = T from`, each row's sum from left to right.
    fn product(&mut self, to: Slot, table: u32, from: Slot, (rows, cols): (usize, usize), low: bool) {
        let (size, (memory, first)) = ((rows * cols) as u32, self.places[Array::Table as usize]);
        let table = first + table;
        let parts = if low { 2 } else { 1 };
        if rows * cols <= ENTRIES {
            let vector: Vec<Value> = (0..cols).map(|j| self.read(from, j, None)).collect();
            for i in 0..rows {
                let mut sums = Vec::new();
                for part in 0..parts {
                    let mut sum = self.w.number(-0.0);
                    for (j, x) in vector.iter().enumerate() {
                        let base = table + part * size + (i * cols + j) as u32;
                        let entry = self.w.load(Place::new(memory, base));
                        let term = self.w.mul(entry, *x);
                        sum = self.w.add(sum, term);
                    }
                    sums.push(sum);
                }
                let sum = if low { self.w.add(sums[0], sums[1]) } else { sums[0] };
                self.write(Slot { array: to.array, index: to.index + i as u32 }, None, sum);
            }
            return;
        }
        let (row, column) = (self.w.index(), self.w.index());
        let sums: Vec<Var> = (0..parts).map(|_| self.w.var()).collect();
        let zero = self.w.number(-0.0);
        let inner = self.inside(|this| {
            let x = this.read(from, 0, Some(column));
            for (part, var) in sums.iter().enumerate() {
                let base = table + part as u32 * size;
                let along = vec![(row, cols as u32), (column, 1)];
                let entry = this.w.load(Place { along, ..Place::new(memory, base) });
                let term = this.w.mul(entry, x);
                let sum = this.w.get(*var);
                let sum = this.w.add(sum, term);
                this.w.set(*var, sum);
            }
        });
        let outer = self.inside(|this| {
            sums.iter().for_each(|v| this.w.set(*v, zero));
            this.w.push(Stmt::For(column, 0, cols as u32, inner));
            let parts: Vec<Value> = sums.iter().map(|v| this.w.get(*v)).collect();
            let sum = if low { this.w.add(parts[0], parts[1]) } else { parts[0] };
            this.write(to, Some(row), sum);
        });
        self.w.push(Stmt::For(row, 0, rows as u32, outer));
    }

    /// `to = from^T Q from`, as `interpreter::Quad` does it.
    fn form(&mut self, to: Slot, table: u32, from: Slot, n: usize, root: bool) {
        let (memory, first) = self.places[Array::Table as usize];
        let table = first + table;
        let mut sum = self.w.number(-0.0);
        if n * n <= ENTRIES {
            let vector: Vec<Value> = (0..n).map(|j| self.read(from, j, None)).collect();
            let mut at = table;
            for i in 0..n {
                if root {
                    at += i as u32;
                }
                let mut inner = self.w.number(-0.0);
                for x in &vector[i..] {
                    let entry = self.w.load(Place::new(memory, at));
                    at += 1;
                    let term = self.w.mul(entry, *x);
                    inner = self.w.add(inner, term);
                }
                let term = self.w.mul(if root { inner } else { vector[i] }, inner);
                sum = self.w.add(sum, term);
            }
            return self.write(to, None, sum);
        }
        let added = |this: &mut Self, at: Place, x: Value, inner: Var| {
            let entry = this.w.load(at);
            let term = this.w.mul(entry, x);
            let before = this.w.get(inner);
            let after = this.w.add(before, term);
            this.w.set(inner, after);
        };
        if root {
            // Rows of full length, so that all are one loop: what is 0 adds nothing to a square.
            let (row, column, inner) = (self.w.index(), self.w.index(), self.w.var());
            let (none, all) = (sum, self.w.holding(sum));
            let product = self.inside(|this| {
                let x = this.read(from, 0, Some(column));
                let along = vec![(row, n as u32), (column, 1)];
                added(this, Place { along, ..Place::new(memory, table) }, x, inner);
            });
            let square = self.inside(|this| {
                this.w.set(inner, none);
                this.w.push(Stmt::For(column, 0, n as u32, product));
                let (x, before) = (this.w.get(inner), this.w.get(all));
                let term = this.w.mul(x, x);
                let after = this.w.add(before, term);
                this.w.set(all, after);
            });
            self.w.push(Stmt::For(row, 0, n as u32, square));
            sum = self.w.get(all);
            return self.write(to, None, sum);
        }
        let mut at = table;
        for i in 0..n {
            // Rows are of different lengths: each is a loop of its own.
            let (index, inner) = (self.w.index(), self.w.starting(-0.0));
            let body = self.inside(|this| {
                let x = this.read(from, i, Some(index));
                added(this, Place { along: vec![(index, 1)], ..Place::new(memory, at) }, x, inner);
            });
            self.w.push(Stmt::For(index, 0, (n - i) as u32, body));
            at += (n - i) as u32;
            let (x, inner) = (self.read(from, i, None), self.w.get(inner));
            let term = self.w.mul(x, inner);
            sum = self.w.add(sum, term);
        }
        self.write(to, None, sum);
    }

    /// What `f` writes, as a block.
    fn inside(&mut self, f: impl FnOnce(&mut Self)) -> Vec<Stmt> {
        self.w.open();
        f(self);
        self.w.close()
    }

    /// Fails where a number of the new state is not finite.
    fn check(&mut self, n: usize) {
        let (zero, named) = (self.w.number(0.0), std::mem::take(&mut self.next));
        if named.len() != n || n > 4 * ELIMINATED {
            let (memory, base) = self.places[Array::Next as usize];
            return self.w.check(memory, base, n);
        }
        // A sum of finite numbers is finite, unless it overflows: then each is looked at.
        let Some((first, rest)) = named.split_first() else { return };
        let sum = rest.iter().fold(*first, |sum, x| self.w.add(sum, *x));
        let sound = self.w.finite(sum);
        self.w.when(sound.not(), |w| {
            let spoiled = named.iter().fold(zero, |sum, x| {
                let term = w.mul(zero, *x);
                w.add(sum, term)
            });
            let sound = w.eq(spoiled, zero);
            w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
        });
    }
}

impl Writer {
    /// Fails where one of some numbers is not finite. Where there are many, four at a time: additions wait for one
    /// another.
    fn check(&mut self, memory: Memory, base: u32, n: usize) {
        let zero = self.number(0.0);
        let spoil = |w: &mut Self, sum: Value, place: Place| {
            let x = w.load(place);
            let term = w.mul(zero, x);
            w.add(sum, term)
        };
        let spoiled = if n <= UNROLLED {
            (0..n).fold(zero, |sum, i| spoil(self, sum, Place::new(memory, base + i as u32)))
        } else {
            let sums: Vec<Var> = (0..4).map(|_| self.starting(0.0)).collect();
            let index = self.index();
            let body = self.block(|w| {
                for (k, sum) in sums.iter().enumerate() {
                    let before = w.get(*sum);
                    let place = Place { along: vec![(index, 4)], ..Place::new(memory, base + k as u32) };
                    let after = spoil(w, before, place);
                    w.set(*sum, after);
                }
            });
            self.push(Stmt::For(index, 0, n as u32 / 4, body));
            let parts: Vec<Value> = sums.iter().map(|s| self.get(*s)).collect();
            let sum = parts.into_iter().fold(zero, |sum, x| self.add(sum, x));
            (n - n % 4..n).fold(sum, |sum, i| spoil(self, sum, Place::new(memory, base + i as u32)))
        };
        let sound = self.eq(spoiled, zero);
        self.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
    }
}
