//! A routine as the body of a function, statement by statement.

use crate::backend::code::{Bound, Cond, Index, Memory, Number, Op, Picked, Place, Routine, Span, Stmt, Value, visit};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;
use std::collections::BTreeSet;
use wasm_encoder::{BlockType, Function, Instruction as I, MemArg, MemArgTarget, ValType};

/// The functions of numbers that a host has to give, as the names of its `Math` are, and how many numbers they take.
pub(super) fn imported(routines: &[&Routine]) -> BTreeSet<(&'static str, usize)> {
    let mut out = BTreeSet::new();
    for routine in routines {
        visit(&routine.body, &mut |s| match s {
            Stmt::Let(_, Op::Unary(f, _)) if f.is_library() => {
                out.insert((f.name(), 1));
            }
            Stmt::Let(_, Op::Binary(f @ (Binary::Pow | Binary::Atan2), ..)) => {
                out.insert((if *f == Binary::Pow { "pow" } else { "atan2" }, 2));
            }
            _ => {}
        });
    }
    out
}

/// Where functions and memories are.
pub(super) struct Printer<'a> {
    /// Number of each function of numbers by its name, `sign` and `power` among them.
    pub(super) functions: &'a FxHashMap<&'static str, u32>,
    /// The first byte of each memory.
    pub(super) memories: &'a dyn Fn(Memory) -> u64,
    /// The first byte of [`Routine::tables`].
    pub(super) tables: u64,
}

/// The function of a routine: it takes nothing, and gives 0 or why it failed.
pub(super) fn function(routine: &Routine, printer: &Printer<'_>) -> Option<Function> {
    let mut body = Body {
        printer,
        numbers: &routine.numbers,
        code: Vec::new(),
        places: FxHashMap::default(),
        free: Vec::new(),
        // Counters come first, then variables.
        indices: routine.indices,
        next: routine.indices + routine.vars,
        depth: 0,
        loops: Vec::new(),
    };
    body.block(&routine.body);
    body.push(I::I32Const(0));
    body.push(I::End);
    // What machines take.
    if body.next > 49_000 {
        return None;
    }
    let mut function = Function::new([(routine.indices, ValType::I32), (body.next - routine.indices, ValType::F64)]);
    body.code.iter().for_each(|i| {
        function.instruction(i);
    });
    (function.byte_len() < 7_000_000).then_some(function)
}

/// A place of the memory; what stands there takes so many bytes, as a power of two.
pub(super) fn place(offset: u64, align: u32) -> MemArg {
    MemArg { offset, align, target: MemArgTarget::Memory(0), ordering: None }
}

struct Body<'a> {
    printer: &'a Printer<'a>,
    numbers: &'a [Option<Number>],
    code: Vec<I<'static>>,
    /// Which local a value has.
    places: FxHashMap<Value, u32>,
    /// Locals whose values are not looked at any more.
    free: Vec<u32>,
    indices: u32,
    next: u32,
    /// How many blocks are open.
    depth: u32,
    /// Of each loop around: how many blocks were open before it.
    loops: Vec<u32>,
}

impl Body<'_> {
    fn push(&mut self, i: I<'static>) {
        self.code.push(i);
    }

    fn block(&mut self, body: &[Stmt]) {
        // The statement after which a value of this block is not looked at.
        let mut last: FxHashMap<Value, usize> = FxHashMap::default();
        for (k, s) in body.iter().enumerate() {
            s.each_value_within(&mut |v| {
                last.insert(v, k);
            });
        }
        let mut ends: Vec<Vec<Value>> = vec![Vec::new(); body.len()];
        for (k, s) in body.iter().enumerate() {
            if let Stmt::Let(v, _) = s {
                ends[last.get(v).copied().unwrap_or(k).max(k)].push(*v);
            }
        }
        for (s, ends) in body.iter().zip(ends) {
            self.statement(s);
            for v in ends {
                self.free.extend(self.places.remove(&v));
            }
        }
    }

    fn statement(&mut self, s: &Stmt) {
        match s {
            Stmt::Let(v, op) => {
                // A number is itself wherever it is looked at.
                if self.numbers[v.0 as usize].is_some() {
                    return;
                }
                self.op(op);
                let local = self.free.pop().unwrap_or_else(|| {
                    self.next += 1;
                    self.next - 1
                });
                self.places.insert(*v, local);
                self.push(I::LocalSet(local));
            }
            Stmt::Set(m, v) => {
                self.value(*v);
                self.push(I::LocalSet(self.indices + m.0));
            }
            Stmt::Store(p, v) => {
                let to = self.address(p);
                self.value(*v);
                self.push(I::F64Store(to));
            }
            Stmt::If(c, yes, no) => {
                self.cond(c);
                self.open(I::If(BlockType::Empty));
                self.block(yes);
                if !no.is_empty() {
                    self.push(I::Else);
                    self.block(no);
                }
                self.close();
            }
            Stmt::Loop(body) => {
                self.loops.push(self.depth);
                self.open(I::Block(BlockType::Empty));
                self.open(I::Loop(BlockType::Empty));
                self.block(body);
                self.push(I::Br(0));
                self.close();
                self.close();
                self.loops.pop();
            }
            Stmt::Break => self.branch(0),
            Stmt::Continue => self.branch(1),
            Stmt::For(i, from, to, body) if from < to => {
                let (counter, to) = (i.0, *to as i32);
                self.push(I::I32Const(*from as i32));
                self.push(I::LocalSet(counter));
                self.open(I::Loop(BlockType::Empty));
                self.block(body);
                self.push(I::LocalGet(counter));
                self.push(I::I32Const(1));
                self.push(I::I32Add);
                self.push(I::LocalTee(counter));
                self.push(I::I32Const(to));
                self.push(I::I32LtU);
                self.push(I::BrIf(0));
                self.close();
            }
            Stmt::For(..) => {}
            Stmt::Span(span, body) => self.span(span, body),
            // Written out before.
            Stmt::Solve { .. } => self.push(I::Unreachable),
            // Who runs a scene by itself reads neither.
            Stmt::Count(_) | Stmt::Note(_) => {}
            Stmt::Fail(reason) => {
                self.push(I::I32Const(reason.code() as i32));
                self.push(I::Return);
            }
        }
    }

    fn span(&mut self, span: &Span, body: &[Stmt]) {
        let counter = span.index.0;
        self.open(I::Block(BlockType::Empty));
        self.bound(if span.back { span.to } else { span.from });
        self.push(I::LocalSet(counter));
        self.open(I::Loop(BlockType::Empty));
        self.push(I::LocalGet(counter));
        self.bound(if span.back { span.from } else { span.to });
        self.push(if span.back { I::I32LeU } else { I::I32GeU });
        self.push(I::BrIf(1));
        let next = |body: &mut Self, by: i32| {
            let steps = [I::LocalGet(counter), I::I32Const(by), I::I32Add, I::LocalSet(counter)];
            steps.into_iter().for_each(|i| body.push(i));
        };
        if span.back {
            next(self, -1);
        }
        self.block(body);
        if !span.back {
            next(self, 1);
        }
        self.push(I::Br(0));
        self.close();
        self.close();
    }

    /// Leaves a bound.
    fn bound(&mut self, bound: Bound) {
        match bound {
            Bound::Known(i) => self.push(I::I32Const(i as i32)),
            Bound::Past(i, more) => {
                self.push(I::LocalGet(i.0));
                self.push(I::I32Const(more as i32));
                self.push(I::I32Add);
            }
            Bound::Table(at, i) => self.listed(at, i),
        }
    }

    /// Leaves a number of the tables.
    fn listed(&mut self, at: u32, i: Index) {
        self.push(I::LocalGet(i.0));
        self.push(I::I32Const(4));
        self.push(I::I32Mul);
        self.push(I::I32Load(place(self.printer.tables + 4 * u64::from(at), 2)));
    }

    fn open(&mut self, i: I<'static>) {
        self.depth += 1;
        self.push(i);
    }

    fn close(&mut self) {
        self.depth -= 1;
        self.push(I::End);
    }

    /// To the end (0) or the start (1) of the innermost loop.
    fn branch(&mut self, which: u32) {
        let before = self.loops.last().copied().unwrap_or(0);
        self.push(I::Br(self.depth - before - 1 - which));
    }

    fn value(&mut self, v: Value) {
        match (self.numbers[v.0 as usize], self.places.get(&v)) {
            (Some(n), _) => self.push(I::F64Const(n.value().into())),
            (None, Some(local)) => self.push(I::LocalGet(*local)),
            // Values are defined before they are used.
            (None, None) => self.push(I::Unreachable),
        }
    }

    /// Leaves what is added to a place that is known, which it gives.
    fn address(&mut self, p: &Place) -> MemArg {
        let start = (self.printer.memories)(p.memory);
        let mut any = false;
        for (i, stride) in &p.along {
            self.push(I::LocalGet(i.0));
            self.push(I::I32Const(8 * *stride as i32));
            self.push(I::I32Mul);
            if any {
                self.push(I::I32Add);
            }
            any = true;
        }
        if let Some((at, i)) = p.through {
            self.listed(at, i);
            self.push(I::I32Const(8));
            self.push(I::I32Mul);
            if any {
                self.push(I::I32Add);
            }
            any = true;
        }
        if let Some(Picked { by, stride, count }) = p.picked {
            let count = f64::from(count);
            self.value(by);
            self.push(I::I32TruncSatF64U);
            self.push(I::I32Const(0));
            self.value(by);
            self.push(I::F64Const(count.into()));
            self.push(I::F64Lt);
            self.push(I::Select);
            self.push(I::I32Const(8 * stride as i32));
            self.push(I::I32Mul);
            if any {
                self.push(I::I32Add);
            }
            any = true;
        }
        if !any {
            self.push(I::I32Const(0));
        }
        place(start + 8 * u64::from(p.base), 3)
    }

    /// Leaves what it comes to.
    fn op(&mut self, op: &Op) {
        match op {
            Op::Load(p) => {
                let from = self.address(p);
                self.push(I::F64Load(from));
            }
            Op::Get(m) => self.push(I::LocalGet(self.indices + m.0)),
            Op::Counter(i) => {
                self.push(I::LocalGet(i.0));
                self.push(I::F64ConvertI32S);
            }
            Op::InverseScale(x) => {
                self.value(*x);
                self.call("inverse_scale");
            }
            Op::Unary(f, x) => {
                if *f == Unary::Not {
                    self.cond(&Cond::Not(Box::new(Cond::True(*x))));
                    return self.truth();
                }
                self.value(*x);
                match f {
                    Unary::Neg => self.push(I::F64Neg),
                    Unary::Abs => self.push(I::F64Abs),
                    Unary::Sqrt => self.push(I::F64Sqrt),
                    Unary::Sign => self.call("sign"),
                    Unary::Floor => self.push(I::F64Floor),
                    _ => self.call(f.name()),
                }
            }
            Op::Binary(f, x, y) => {
                let both = || vec![Cond::True(*x), Cond::True(*y)];
                let condition = match f {
                    Binary::Lt => Some(Cond::Lt(*x, *y)),
                    Binary::Le => Some(Cond::Le(*x, *y)),
                    Binary::Eq => Some(Cond::Eq(*x, *y)),
                    Binary::And => Some(Cond::All(both())),
                    Binary::Or => Some(Cond::Any(both())),
                    Binary::Add
                    | Binary::Sub
                    | Binary::Mul
                    | Binary::Div
                    | Binary::Pow
                    | Binary::Atan2
                    | Binary::Min
                    | Binary::Max => None,
                };
                if let Some(c) = condition {
                    self.cond(&c);
                    return self.truth();
                }
                self.value(*x);
                self.value(*y);
                match f {
                    Binary::Add => self.push(I::F64Add),
                    Binary::Sub => self.push(I::F64Sub),
                    Binary::Mul => self.push(I::F64Mul),
                    Binary::Div => self.push(I::F64Div),
                    Binary::Min => self.push(I::F64Min),
                    Binary::Max => self.push(I::F64Max),
                    Binary::Atan2 => self.call("atan2"),
                    Binary::Pow | Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => self.call("power"),
                }
            }
            Op::Select(c, a, b) => {
                self.value(*a);
                self.value(*b);
                self.cond(c);
                self.push(I::Select);
            }
        }
    }

    fn call(&mut self, name: &str) {
        match self.printer.functions.get(name) {
            Some(f) => self.push(I::Call(*f)),
            None => self.push(I::Unreachable),
        }
    }

    /// A condition as a number: 1 or 0.
    fn truth(&mut self) {
        self.push(I::F64ConvertI32U);
    }

    fn cond(&mut self, c: &Cond) {
        match c {
            Cond::Known(b) => self.push(I::I32Const(i32::from(*b))),
            Cond::True(v) => {
                self.value(*v);
                self.push(I::F64Const(0.0.into()));
                self.push(I::F64Ne);
            }
            Cond::Lt(a, b) | Cond::Le(a, b) | Cond::Eq(a, b) => {
                self.value(*a);
                self.value(*b);
                self.push(match c {
                    Cond::Lt(..) => I::F64Lt,
                    Cond::Le(..) => I::F64Le,
                    _ => I::F64Eq,
                });
            }
            Cond::Finite(v) => {
                self.value(*v);
                self.push(I::F64Abs);
                self.push(I::F64Const(f64::INFINITY.into()));
                self.push(I::F64Lt);
            }
            Cond::Not(c) => {
                self.cond(c);
                self.push(I::I32Eqz);
            }
            Cond::All(list) | Cond::Any(list) => {
                let all = matches!(c, Cond::All(_));
                self.push(I::I32Const(i32::from(all)));
                for c in list {
                    self.cond(c);
                    self.push(if all { I::I32And } else { I::I32Or });
                }
            }
        }
    }
}
