//! From a program to code: registers are given by a scan in order, each free again after its value's last use.

use super::code::{Code, MatVec, Quad};
use super::{Interpreter, Linear, Loop};
use crate::ir::{Array, Binary, Inst, Op, Program, Unary, Value};
use crate::solve::linear::System;
use crate::solve::newton::Plan;
use std::collections::HashMap;

/// The code of a program.
pub(super) fn translate(program: &Program) -> Interpreter {
    let mut lives = Lives::new(program.values as usize);
    lives.block(&program.body);
    let mut writer = Writer {
        last: lives.last,
        register: lives.register,
        free: Vec::new(),
        registers: lives.constants.len() as u32,
        position: 0,
        ends: lives.ends,
        loops: Vec::new(),
        linear: Vec::new(),
        code: Vec::new(),
    };
    let start = writer.block(&program.body);
    let main = start..writer.code.len();
    Interpreter {
        program: program.clone(),
        code: writer.code,
        main,
        loops: writer.loops,
        plans: Plan::all(program),
        linear: writer.linear,
        constants: lives.constants,
        registers: writer.registers as usize,
    }
}

/// No position, no register.
const NONE: u32 = u32::MAX;

/// Where values are used last. Positions count instructions in order, and one more for the end of each iteration.
struct Lives {
    position: u32,
    depth: u32,
    /// How many iterations a value is made inside of.
    made: Vec<u32>,
    last: Vec<u32>,
    /// By depth: values from outside that the iteration open there uses.
    pending: Vec<Vec<Value>>,
    /// By position: what dies there.
    ends: Vec<Vec<Value>>,
    constants: Vec<f64>,
    numbers: HashMap<u64, u32>,
    /// The registers of constants, which never die.
    register: Vec<u32>,
}

impl Lives {
    fn new(values: usize) -> Self {
        Self {
            position: 0,
            depth: 0,
            made: vec![0; values],
            last: vec![NONE; values],
            pending: vec![Vec::new()],
            ends: Vec::new(),
            constants: Vec::new(),
            numbers: HashMap::new(),
            register: vec![NONE; values],
        }
    }

    fn block(&mut self, body: &[Inst]) {
        self.scan(body);
        self.ends = vec![Vec::new(); self.position as usize];
        for (index, &last) in self.last.iter().enumerate() {
            if last != NONE && self.register[index] == NONE {
                self.ends[last as usize].push(Value(index as u32));
            }
        }
    }

    fn scan(&mut self, body: &[Inst]) {
        for inst in body {
            match inst {
                Inst::Let(v, op) => {
                    match *op {
                        Op::Const(x) => self.constant(*v, x),
                        Op::Load(_) => {}
                        Op::Unary(_, a) => self.used(a),
                        Op::Binary(_, a, b) => [a, b].map(|v| self.used(v)).into_iter().collect(),
                        Op::Select(c, a, b) => [c, a, b].map(|v| self.used(v)).into_iter().collect(),
                    }
                    self.made[v.0 as usize] = self.depth;
                    self.last[v.0 as usize] = self.position;
                }
                Inst::Store(_, v) => self.used(*v),
                Inst::Newton(newton) => {
                    let lists = [&newton.weight, &newton.scale, &newton.cold, &newton.small];
                    lists.into_iter().flatten().for_each(|&v| self.used(v));
                    self.depth += 1;
                    self.position += 1;
                    self.pending.push(Vec::new());
                    self.scan(&newton.body);
                    newton.residual.iter().for_each(|&v| self.used(v));
                    newton.jacobian.iter().for_each(|&(_, _, v)| self.used(v));
                    newton.update.iter().for_each(|v| self.used(*v));
                    self.depth -= 1;
                    for v in self.pending.pop().unwrap_or_default() {
                        self.used(v);
                    }
                }
                Inst::Solve(solve) => solve.right.iter().copied().chain(solve.values()).for_each(|v| self.used(v)),
                Inst::MatVec { .. } | Inst::Quad { .. } => {}
            }
            self.position += 1;
        }
    }

    fn used(&mut self, v: Value) {
        let made = self.made[v.0 as usize];
        self.last[v.0 as usize] = self.position;
        if made < self.depth {
            // Lives to the end of the outermost iteration that does not make it.
            self.pending[made as usize + 1].push(v);
        }
    }

    fn constant(&mut self, v: Value, x: f64) {
        let next = self.constants.len() as u32;
        let register = *self.numbers.entry(x.to_bits()).or_insert(next);
        if register == next {
            self.constants.push(x);
        }
        self.register[v.0 as usize] = register;
    }
}

/// Writes code.
struct Writer {
    last: Vec<u32>,
    register: Vec<u32>,
    free: Vec<u32>,
    registers: u32,
    position: u32,
    ends: Vec<Vec<Value>>,
    loops: Vec<Loop>,
    linear: Vec<Linear>,
    code: Vec<Code>,
}

impl Writer {
    /// Writes a block after those inside it; returns where it starts.
    fn block(&mut self, body: &[Inst]) -> usize {
        let mut code = Vec::with_capacity(body.len());
        for inst in body {
            match inst {
                Inst::Let(v, op) => self.operation(*v, *op, &mut code),
                Inst::Store(slot, v) => {
                    let (from, at) = (self.of(*v), slot.index);
                    match slot.array {
                        Array::Next => code.push(Code::StoreNext { slot: at, from }),
                        Array::Local => code.push(Code::StoreLocal { slot: at, from }),
                        Array::Output => code.push(Code::StoreOutput { slot: at, from }),
                        Array::State | Array::Input | Array::Table => {} // refused by the verifier
                    }
                    self.release(None);
                }
                Inst::Newton(newton) => {
                    let k = self.loops.len();
                    let all = |values: &[Value], writer: &Self| values.iter().map(|&v| writer.of(v)).collect();
                    let (weight, scale) = (all(&newton.weight, self), all(&newton.scale, self));
                    let (cold, small) = (all(&newton.cold, self), all(&newton.small, self));
                    self.loops.push(Loop::default());
                    self.release(None);
                    self.position += 1;
                    let start = self.block(&newton.body);
                    let residual = all(&newton.residual, self);
                    let entries = newton.jacobian.iter().map(|&(_, _, v)| v);
                    let jacobian = entries.chain(newton.update.iter().copied()).map(|v| self.of(v)).collect();
                    self.release(None);
                    self.loops[k] =
                        Loop { body: start..self.code.len(), residual, jacobian, weight, scale, cold, small };
                    code.push(Code::Newton(k as u32));
                }
                Inst::Solve(solve) => {
                    code.push(Code::Solve(self.linear.len() as u32));
                    self.linear.push(Linear {
                        unknowns: solve.unknowns as usize,
                        right: solve.right.iter().map(|v| self.of(*v)).collect(),
                        matrix: solve.values().map(|v| self.of(v)).collect(),
                        flag: solve.flag.map(|slot| slot.index as usize),
                        system: System::new(solve.size(), solve.pattern(), solve.of()),
                    });
                    self.release(None);
                }
                Inst::MatVec { to, table, from, rows, cols, low } => {
                    let (table, rows, cols) = (*table as usize, *rows as usize, *cols as usize);
                    code.push(Code::MatVec(Box::new(MatVec { to: *to, table, from: *from, rows, cols, low: *low })));
                }
                Inst::Quad { to, table, from, n, root } => {
                    let (table, n) = (*table as usize, *n as usize);
                    code.push(Code::Quad(Box::new(Quad { to: *to, table, from: *from, n, root: *root })));
                }
            }
            self.position += 1;
        }
        let start = self.code.len();
        self.code.extend(code);
        start
    }

    /// The register of a value.
    fn of(&self, v: Value) -> u32 {
        self.register[v.0 as usize]
    }

    /// Frees the registers of values whose last use is here, but for the one being made.
    fn release(&mut self, made: Option<Value>) {
        for v in std::mem::take(&mut self.ends[self.position as usize]) {
            if Some(v) != made {
                self.free.push(self.register[v.0 as usize]);
            }
        }
    }

    fn operation(&mut self, v: Value, op: Op, code: &mut Vec<Code>) {
        let (a, b, c) = match op {
            Op::Const(_) => return,
            Op::Load(_) => (NONE, NONE, NONE),
            Op::Unary(_, a) => (self.of(a), NONE, NONE),
            Op::Binary(_, a, b) => (self.of(a), self.of(b), NONE),
            Op::Select(c, a, b) => (self.of(a), self.of(b), self.of(c)),
        };
        let fused = self.product_in(op, code);
        self.release(Some(v));
        let to = self.free.pop().unwrap_or_else(|| {
            self.registers += 1;
            self.registers - 1
        });
        self.register[v.0 as usize] = to;
        if self.last[v.0 as usize] == self.position {
            self.free.push(to);
        }
        if let Some((product, first)) = fused {
            code.pop();
            let (x, y, c) = (product.0, product.1, if first { b } else { a });
            code.push(match op {
                Op::Binary(Binary::Sub, ..) if first => Code::MulSub { to, a: x, b: y, c },
                Op::Binary(Binary::Sub, ..) => Code::SubMul { to, a: x, b: y, c },
                Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => {
                    Code::MulAdd { to, a: x, b: y, c }
                }
            });
            return;
        }
        code.push(match op {
            Op::Const(_) => return,
            Op::Load(s) => match s.array {
                Array::State => Code::State { to, slot: s.index },
                Array::Input => Code::Input { to, slot: s.index },
                Array::Table => Code::Table { to, slot: s.index },
                Array::Local => Code::Local { to, slot: s.index },
                Array::Next | Array::Output => return, // refused by the verifier
            },
            Op::Unary(Unary::Neg, _) => Code::Neg { to, a },
            Op::Unary(f, _) => Code::Unary { f, to, a },
            Op::Binary(Binary::Add, ..) => Code::Add { to, a, b },
            Op::Binary(Binary::Sub, ..) => Code::Sub { to, a, b },
            Op::Binary(Binary::Mul, ..) => Code::Mul { to, a, b },
            Op::Binary(Binary::Div, ..) => Code::Div { to, a, b },
            Op::Binary(f, ..) => Code::Binary { f, to, a, b },
            Op::Select(..) => Code::Select { to, c, a, b },
        });
    }

    /// Where a sum or difference uses the product computed just before, and nothing else does: the product's factors,
    /// and whether it comes first. The factors' registers still hold them, the product not having been written.
    fn product_in(&self, op: Op, code: &[Code]) -> Option<((u32, u32), bool)> {
        let Op::Binary(Binary::Add | Binary::Sub, x, y) = op else {
            return None;
        };
        let Some(&Code::Mul { to, a, b }) = code.last() else {
            return None;
        };
        let is = |v: Value| self.of(v) == to && self.last[v.0 as usize] == self.position;
        match (is(x), is(y)) {
            (true, false) => Some(((a, b), true)),
            (false, true) => Some(((a, b), false)),
            (true, true) | (false, false) => None,
        }
    }
}
