//! From a routine to Cranelift's form, statement by statement.

use super::functions;
use super::slp::{self, Pairs};
use super::vector::{self, Kind, VectorOptions};
use crate::backend::code::{
    Bound, Cond, Index, Memory, Number, Op, Picked, Place, Reason, Routine, Span, Stmt, Value, visit,
};
use bond_runtime::ir::{Binary, Unary};
use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{self, AbiParam, BlockArg, InstBuilder, MemFlagsData, Opcode, types};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext, Variable};
use cranelift_module::{FuncId, Linkage, Module, ModuleError};
use rustc_hash::{FxHashMap, FxHashSet};

/// What Cranelift made, or why it could not.
pub(super) type Made<T> = Result<T, Box<ModuleError>>;

/// Where in the report the size of the notes is, bytes.
const NOTES: i32 = 32;
/// Size of the report, bytes: iterations, three numbers of a failure, the size of the notes.
pub(super) const REPORT: u32 = 40;

/// The signature of the function of a routine; see [`define`].
fn signature<M: Module>(module: &M) -> ir::Signature {
    let pointer = module.target_config().pointer_type();
    let mut signature = module.make_signature();
    signature.params = vec![AbiParam::new(pointer); Memory::ALL.len() + 3];
    signature.returns = vec![AbiParam::new(types::I32)];
    signature
}

/// Defines the function of a routine: pointers to the memories in the order of [`Memory::ALL`], to the report
/// (iterations, then what a failure tells), the context for [`functions::SOLVE`], and the tables; returns 0 or why it
/// failed.
///
/// `names` gives the name of each function of numbers, `sin_cos` says whether [`functions::SIN_COS`] is among
/// them.
pub(super) fn define<M: Module>(
    module: &mut M,
    name: &str,
    routine: &Routine,
    linkage: Linkage,
    names: fn(&'static str) -> &'static str,
    sin_cos: bool,
) -> Made<FuncId> {
    let pointer = module.target_config().pointer_type();
    let signature = signature(module);
    let id = module.declare_function(name, linkage, &signature)?;
    let mut context = module.make_context();
    context.func.signature = signature;
    let mut frontend = FunctionBuilderContext::new();
    let mut b = FunctionBuilder::new(&mut context.func, &mut frontend);
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let params = b.block_params(entry).to_vec();
    let mut t = Translate {
        vars: (0..routine.vars).map(|_| b.declare_var(types::F64)).collect(),
        indices: (0..routine.indices).map(|_| b.declare_var(types::I64)).collect(),
        values: vec![None; routine.numbers.len()],
        flags: FxHashMap::default(),
        functions: FxHashMap::default(),
        loops: Vec::new(),
        sin_cos_of: if sin_cos { sin_cos_arguments(&routine.body) } else { FxHashSet::default() },
        sin_cos_known: Vec::new(),
        uses: slp::uses(routine),
        vectors: Vectors::default(),
        vector_options: VectorOptions::default(),
        names,
        routine,
        params,
        pointer,
        module,
        b,
    };
    let zero = t.b.ins().f64const(0.0);
    for v in t.vars.clone() {
        t.b.def_var(v, zero);
    }
    if !t.block(&routine.body) {
        t.leave(0);
    }
    t.b.seal_all_blocks();
    let config = t.module.target_config();
    t.b.finalize(config);
    module.define_function(id, &mut context)?;
    Ok(id)
}

/// What is known of loads from a memory: no routine writes the table or the data.
fn flags(memory: Memory) -> MemFlagsData {
    match memory {
        Memory::Table | Memory::Data => MemFlagsData::trusted().with_readonly().with_can_move(),
        Memory::State | Memory::Next | Memory::Input | Memory::Scratch | Memory::Output => MemFlagsData::trusted(),
    }
}

/// A routine on its way.
pub(super) struct Translate<'a, 'f, M> {
    module: &'a mut M,
    pub(super) b: FunctionBuilder<'f>,
    names: fn(&'static str) -> &'static str,
    pub(super) routine: &'a Routine,
    params: Vec<ir::Value>,
    pointer: ir::Type,
    pub(super) vars: Vec<Variable>,
    pub(super) indices: Vec<Variable>,
    pub(super) values: Vec<Option<ir::Value>>,
    /// Comparisons as flags.
    flags: FxHashMap<Value, ir::Value>,
    functions: FxHashMap<&'static str, ir::FuncRef>,
    /// Heads and ends of the loops around.
    loops: Vec<(ir::Block, ir::Block)>,
    /// Of what both sine and cosine are asked for, and what they are, where that was computed in this block or one
    /// around it.
    sin_cos_of: FxHashSet<Value>,
    sin_cos_known: Vec<(Value, (ir::Value, ir::Value))>,
    /// How often each value is looked at.
    uses: Vec<u32>,
    vectors: Vectors,
    pub(super) vector_options: VectorOptions,
}

/// What is in vectors of two numbers, within straight code.
#[derive(Default)]
struct Vectors {
    /// Values, as a number of a vector.
    lanes: FxHashMap<Value, (ir::Value, u8)>,
    /// Vectors of two values that were put together.
    brought: FxHashMap<[Value; 2], ir::Value>,
}

/// The values of which both sine and cosine are asked for.
fn sin_cos_arguments(body: &[Stmt]) -> FxHashSet<Value> {
    let (mut sines, mut cosines) = (FxHashSet::default(), FxHashSet::default());
    visit(body, &mut |s| match s {
        Stmt::Let(_, Op::Unary(Unary::Sin, a)) => {
            sines.insert(*a);
        }
        Stmt::Let(_, Op::Unary(Unary::Cos, a)) => {
            cosines.insert(*a);
        }
        _ => {}
    });
    sines.retain(|v| cosines.contains(v));
    sines
}

impl<M: Module> Translate<'_, '_, M> {
    /// Writes a block; true where its end is not reached.
    pub(super) fn block(&mut self, body: &[Stmt]) -> bool {
        let known = self.sin_cos_known.len();
        let ended = self.statements(body);
        self.sin_cos_known.truncate(known);
        ended
    }

    pub(super) fn statements(&mut self, body: &[Stmt]) -> bool {
        let mut rest = body;
        loop {
            let (straight, others) = rest.split_at(slp::straight_line(rest));
            self.straight_line(straight);
            let Some((s, after)) = others.split_first() else { return false };
            if self.statement(s) {
                return true;
            }
            rest = after;
        }
    }

    /// Writes statements as [`slp::straight_line`] finds them.
    fn straight_line(&mut self, body: &[Stmt]) {
        match slp::pairs(self.routine, &self.uses, body, self.vector_options) {
            Some(pairs) => self.paired(body, &pairs),
            None => body.iter().for_each(|s| {
                self.statement(s);
            }),
        }
    }

    /// The same, some of them two at a time: a pair is written where the first of its values stands, and what the
    /// second waits for before it.
    fn paired(&mut self, body: &[Stmt], pairs: &Pairs) {
        let mut done = vec![false; body.len()];
        let mut open = Vec::new();
        for i in 0..body.len() {
            open.push(i);
            while let Some(&i) = open.last() {
                let waiting = open.len();
                for j in pairs.with[i].unwrap_or([i, i]) {
                    body[j].each_value(&mut |v| open.extend(pairs.place.get(&v).filter(|at| !done[**at])));
                }
                if open.len() > waiting && !done[i] {
                    continue;
                }
                open.truncate(waiting - 1);
                if done[i] {
                    continue;
                }
                match pairs.with[i] {
                    Some(both) => {
                        self.two(both.map(|j| &body[j]));
                        both.into_iter().for_each(|j| done[j] = true);
                    }
                    None => {
                        self.statement(&body[i]);
                        done[i] = true;
                    }
                }
            }
        }
        for v in &pairs.kept {
            self.of(*v);
        }
        self.vectors = Vectors::default();
    }

    /// Writes two statements as one.
    fn two(&mut self, both: [&Stmt; 2]) {
        let [Stmt::Let(v, first), Stmt::Let(w, second)] = both else { return };
        let made = match (first, second) {
            (Op::Unary(f, x), Op::Unary(_, y)) => {
                let x = self.vector([*x, *y]);
                vector::unary(&mut self.b, *f, x)
            }
            (Op::Binary(f, a, b), Op::Binary(_, c, d)) => {
                let (x, y) = (self.vector([*a, *c]), self.vector([*b, *d]));
                match vector::binary(*f) {
                    Kind::Number(make) => make(&mut self.b, x, y),
                    Kind::Compared(_) | Kind::Joined { .. } | Kind::Call => return, // not paired
                }
            }
            _ => return, // not paired
        };
        for (v, lane) in [(v, 0), (w, 1)] {
            self.values[v.0 as usize] = None;
            self.vectors.lanes.insert(*v, (made, lane));
        }
    }

    /// Two values as a vector.
    fn vector(&mut self, [x, y]: [Value; 2]) -> ir::Value {
        let lanes = &self.vectors.lanes;
        if let (Some((vector, 0)), Some((other, 1))) = (lanes.get(&x), lanes.get(&y))
            && vector == other
        {
            return *vector;
        }
        if let [Some(p), Some(q)] = [x, y].map(|v| self.routine.numbers[v.0 as usize].map(Number::value)) {
            return vector::numbers(&mut self.b, [p, q]);
        }
        if let Some(&vector) = self.vectors.brought.get(&[x, y]) {
            return vector;
        }
        let first = self.of(x);
        let mut made = self.b.ins().splat(types::F64X2, first);
        if x != y {
            let second = self.of(y);
            made = self.b.ins().insertlane(made, second, 1);
        }
        self.vectors.brought.insert([x, y], made);
        made
    }

    /// Writes a statement; true where what follows is not reached.
    fn statement(&mut self, s: &Stmt) -> bool {
        match s {
            Stmt::Let(v, op) => {
                let x = self.op(*v, op);
                self.values[v.0 as usize] = Some(x);
            }
            Stmt::Set(v, x) => {
                let x = self.of(*x);
                self.b.def_var(self.vars[v.0 as usize], x);
            }
            Stmt::Store(place, x) => {
                let x = self.of(*x);
                let (address, offset) = self.address(place);
                self.b.ins().store(MemFlagsData::trusted(), x, address, offset);
            }
            Stmt::If(c, yes, no) => {
                if self.branch(c, yes, no) {
                    return true;
                }
            }
            Stmt::Loop(body) => {
                let (head, end) = (self.b.create_block(), self.b.create_block());
                self.b.ins().jump(head, &[] as &[BlockArg]);
                self.b.switch_to_block(head);
                self.loops.push((head, end));
                if !self.block(body) {
                    self.b.ins().jump(head, &[] as &[BlockArg]);
                }
                self.loops.pop();
                self.b.switch_to_block(end);
            }
            Stmt::Break | Stmt::Continue => {
                if let Some(&(head, end)) = self.loops.last() {
                    let to = if *s == Stmt::Break { end } else { head };
                    self.b.ins().jump(to, &[] as &[BlockArg]);
                }
                return true;
            }
            Stmt::For(index, from, to, body) if self.vectorized_loop(*index, (*from, *to), body) => {}
            Stmt::For(index, from, to, body) => {
                let var = self.indices[index.0 as usize];
                let start = self.b.ins().iconst(types::I64, i64::from(*from));
                self.b.def_var(var, start);
                let (head, end) = (self.b.create_block(), self.b.create_block());
                self.b.ins().jump(head, &[] as &[BlockArg]);
                self.b.switch_to_block(head);
                self.block(body);
                let i = self.b.use_var(var);
                let i = self.b.ins().iadd_imm_u(i, 1);
                self.b.def_var(var, i);
                let more = self.b.ins().icmp_imm_u(IntCC::UnsignedLessThan, i, i64::from(*to));
                self.b.ins().brif(more, head, &[] as &[BlockArg], end, &[] as &[BlockArg]);
                self.b.switch_to_block(end);
            }
            Stmt::Span(span, body) => self.span(span, body),
            Stmt::Solve { system, matrix, vector, row, same } => {
                self.solve((*system, *matrix, *vector), row.0, *same);
            }
            Stmt::Count(k) => {
                let k = self.of(*k);
                let report = self.params[Memory::ALL.len()];
                let before = self.b.ins().load(types::F64, MemFlagsData::trusted(), report, 0);
                let after = self.b.ins().fadd(before, k);
                self.b.ins().store(MemFlagsData::trusted(), after, report, 0);
            }
            Stmt::Note(list) => self.note(list),
            Stmt::Fail(reason) => {
                self.fail(*reason);
                return true;
            }
        }
        false
    }

    fn span(&mut self, span: &Span, body: &[Stmt]) {
        let none: &[BlockArg] = &[];
        let var = self.indices[span.index.0 as usize];
        let (from, to) = (self.bound(span.from), self.bound(span.to));
        self.b.def_var(var, if span.back { to } else { from });
        let (turn, end) = (self.b.create_block(), self.b.create_block());
        let any = self.b.ins().icmp(IntCC::UnsignedLessThan, from, to);
        self.b.ins().brif(any, turn, none, end, none);
        self.b.switch_to_block(turn);
        let next = |t: &mut Self, by: i64| {
            let i = t.b.use_var(var);
            let by = t.b.ins().iconst(types::I64, by);
            let i = t.b.ins().iadd(i, by);
            t.b.def_var(var, i);
            i
        };
        if span.back {
            next(self, -1);
        }
        if !self.block(body) {
            let more = if span.back {
                let i = self.b.use_var(var);
                self.b.ins().icmp(IntCC::UnsignedGreaterThan, i, from)
            } else {
                let i = next(self, 1);
                self.b.ins().icmp(IntCC::UnsignedLessThan, i, to)
            };
            self.b.ins().brif(more, turn, none, end, none);
        }
        self.b.switch_to_block(end);
    }

    fn bound(&mut self, bound: Bound) -> ir::Value {
        match bound {
            Bound::Known(i) => self.b.ins().iconst(types::I64, i64::from(i)),
            Bound::Past(i, more) => {
                let i = self.b.use_var(self.indices[i.0 as usize]);
                self.b.ins().iadd_imm_u(i, i64::from(more))
            }
            Bound::Table(at, i) => self.listed(at, i),
        }
    }

    /// A number of the tables.
    fn listed(&mut self, at: u32, index: Index) -> ir::Value {
        let (i, tables) = (self.b.use_var(self.indices[index.0 as usize]), self.params[Memory::ALL.len() + 2]);
        let i = self.b.ins().imul_imm_u(i, 4);
        let entry = self.b.ins().iadd(tables, i);
        match i32::try_from(4 * i64::from(at)) {
            Ok(offset) => self.b.ins().uload32(MemFlagsData::trusted(), entry, offset),
            Err(_) => {
                let entry = self.b.ins().iadd_imm_u(entry, 4 * i64::from(at));
                self.b.ins().uload32(MemFlagsData::trusted(), entry, 0)
            }
        }
    }

    /// `bond_runtime::eval::inverse_scale`, by the exponent's bits.
    fn inverse_scale(&mut self, x: ir::Value) -> ir::Value {
        let bits = self.b.ins().bitcast(types::I64, MemFlagsData::new(), x);
        let shift = self.b.ins().iconst(types::I64, 52);
        let exponent = self.b.ins().ushr(bits, shift);
        let (most, least) = (self.b.ins().iconst(types::I64, 2045), self.b.ins().iconst(types::I64, 1));
        let opposite = self.b.ins().iconst(types::I64, 2046);
        let opposite = self.b.ins().isub(opposite, exponent);
        let opposite = self.b.ins().smin(opposite, most);
        let opposite = self.b.ins().smax(opposite, least);
        let opposite = self.b.ins().ishl(opposite, shift);
        let scale = self.b.ins().bitcast(types::F64, MemFlagsData::new(), opposite);
        let (one, zero) = (self.b.ins().f64const(1.0), self.b.ins().f64const(0.0));
        let nothing = self.b.ins().fcmp(FloatCC::Equal, x, zero);
        let endless = self.b.ins().icmp_imm_u(IntCC::UnsignedGreaterThanOrEqual, exponent, 0x7ff);
        let plain = self.b.ins().bor(nothing, endless);
        self.b.ins().select(plain, one, scale)
    }

    /// Leaves numbers behind those before; how many bytes there are is the report's last entry.
    fn note(&mut self, list: &[Value]) {
        let (report, notes) = (self.params[Memory::ALL.len()], Memory::ALL.iter().position(|m| *m == Memory::Next));
        let notes = self.params[notes.unwrap_or(0)];
        let so_far = self.b.ins().load(types::I64, MemFlagsData::trusted(), report, NOTES);
        let to = self.b.ins().iadd(notes, so_far);
        for (k, v) in list.iter().enumerate() {
            let x = self.of(*v);
            self.b.ins().store(MemFlagsData::trusted(), x, to, 8 * k as i32);
        }
        let after = self.b.ins().iadd_imm_u(so_far, 8 * list.len() as i64);
        self.b.ins().store(MemFlagsData::trusted(), after, report, NOTES);
    }

    fn branch(&mut self, c: &Cond, yes: &[Stmt], no: &[Stmt]) -> bool {
        // The jump itself can be the other way about, without a flag that is turned over.
        let (c, turned) = match c {
            Cond::Not(c) => (&**c, true),
            c => (c, false),
        };
        let flag = self.cond(c);
        let (then, other, after) = (self.b.create_block(), self.b.create_block(), self.b.create_block());
        let (met, unmet) = if turned { (other, then) } else { (then, other) };
        self.b.ins().brif(flag, met, &[] as &[BlockArg], unmet, &[] as &[BlockArg]);
        let mut ends = 0;
        for (block, body) in [(then, yes), (other, no)] {
            self.b.switch_to_block(block);
            if self.block(body) {
                ends += 1;
            } else {
                self.b.ins().jump(after, &[] as &[BlockArg]);
            }
        }
        self.b.switch_to_block(after);
        if ends == 2 {
            self.b.ins().trap(ir::TrapCode::unwrap_user(1)); // never reached
        }
        ends == 2
    }

    fn leave(&mut self, code: i64) {
        let code = self.b.ins().iconst(types::I32, code);
        self.b.ins().return_(&[code]);
    }

    fn fail(&mut self, reason: Reason) {
        let mut told: Vec<ir::Value> = reason.values().into_iter().map(|v| self.of(v)).collect();
        if let Reason::NoConvergence(limit, ..) = reason {
            told.insert(0, self.b.ins().f64const(f64::from(limit)));
        }
        let report = self.params[Memory::ALL.len()];
        for (i, x) in told.into_iter().enumerate() {
            self.b.ins().store(MemFlagsData::trusted(), x, report, 8 * (i as i32 + 1));
        }
        self.leave(reason.code());
    }

    /// The value of a value.
    fn of(&mut self, v: Value) -> ir::Value {
        if let Some(x) = self.values[v.0 as usize] {
            return x;
        }
        if let Some(&(vector, lane)) = self.vectors.lanes.get(&v) {
            let x = self.b.ins().extractlane(vector, lane);
            self.values[v.0 as usize] = Some(x);
            return x;
        }
        let x = self.routine.numbers[v.0 as usize].map_or(0.0, Number::value);
        self.b.ins().f64const(x)
    }

    pub(super) fn address(&mut self, place: &Place) -> (ir::Value, i32) {
        let at = Memory::ALL.iter().position(|m| *m == place.memory).unwrap_or(0);
        let mut address = self.params[at];
        for (index, stride) in &place.along {
            let i = self.b.use_var(self.indices[index.0 as usize]);
            let i = self.b.ins().imul_imm_u(i, 8 * i64::from(*stride));
            address = self.b.ins().iadd(address, i);
        }
        if let Some((at, index)) = place.through {
            let entry = self.listed(at, index);
            let entry = self.b.ins().imul_imm_u(entry, 8);
            address = self.b.ins().iadd(address, entry);
        }
        if let Some(Picked { by, stride, count }) = place.picked {
            let x = self.of(by);
            let k = self.b.ins().fcvt_to_uint_sat(types::I64, x);
            let inside = self.b.ins().icmp_imm_u(IntCC::UnsignedLessThan, k, i64::from(count));
            let none = self.b.ins().iconst(types::I64, 0);
            let k = self.b.ins().select(inside, k, none);
            let far = self.b.ins().imul_imm_u(k, 8 * i64::from(stride));
            address = self.b.ins().iadd(address, far);
        }
        match i32::try_from(8 * i64::from(place.base)) {
            Ok(offset) => (address, offset),
            Err(_) => (self.b.ins().iadd_imm_u(address, 8 * i64::from(place.base)), 0),
        }
    }

    fn op(&mut self, v: Value, op: &Op) -> ir::Value {
        match op {
            Op::Load(place) => {
                let (address, offset) = self.address(place);
                self.b.ins().load(types::F64, flags(place.memory), address, offset)
            }
            Op::Get(var) => self.b.use_var(self.vars[var.0 as usize]),
            Op::Counter(index) => {
                let i = self.b.use_var(self.indices[index.0 as usize]);
                self.b.ins().fcvt_from_sint(types::F64, i)
            }
            Op::InverseScale(x) => {
                let x = self.of(*x);
                self.inverse_scale(x)
            }
            Op::Unary(f, a) => self.unary(v, *f, *a),
            Op::Binary(f, x, y) => self.binary(v, *f, *x, *y),
            Op::Select(c, x, y) => {
                let flag = self.cond(c);
                let (x, y) = (self.of(*x), self.of(*y));
                self.b.ins().select(flag, x, y)
            }
        }
    }

    fn unary(&mut self, v: Value, f: Unary, a: Value) -> ir::Value {
        let x = self.of(a);
        match f {
            Unary::Neg => {
                let sign = self.b.ins().f64const(-0.0);
                self.b.ins().bxor(x, sign)
            }
            Unary::Abs => self.abs(x),
            Unary::Sqrt => self.b.ins().sqrt(x),
            Unary::Sign => {
                let (zero, one) = (self.b.ins().f64const(0.0), self.b.ins().f64const(1.0));
                let minus = self.b.ins().f64const(-1.0);
                let (above, below) =
                    (self.b.ins().fcmp(FloatCC::GreaterThan, x, zero), self.b.ins().fcmp(FloatCC::LessThan, x, zero));
                let none = self.b.ins().fcmp(FloatCC::Equal, x, zero);
                let rest = self.b.ins().select(none, zero, x);
                let rest = self.b.ins().select(below, minus, rest);
                self.b.ins().select(above, one, rest)
            }
            Unary::Not => {
                let flag = self.truth(a);
                let flag = self.negate(flag);
                self.flag(v, flag)
            }
            Unary::Sin | Unary::Cos if self.sin_cos_of.contains(&a) => {
                let (sine, cosine) = self.sin_cos(a, x);
                if f == Unary::Sin { sine } else { cosine }
            }
            _ => self.call(functions::unary(f), &[x]),
        }
    }

    /// Sine and cosine of a value.
    fn sin_cos(&mut self, a: Value, x: ir::Value) -> (ir::Value, ir::Value) {
        if let Some(found) = self.sin_cos_known.iter().rev().find(|t| t.0 == a) {
            return found.1;
        }
        let pair = match self.function(functions::SIN_COS, &[types::F64], 2) {
            Some(f) => {
                let call = self.b.ins().call(f, &[x]);
                let results = self.b.inst_results(call);
                (results[0], results[1])
            }
            None => (x, x),
        };
        self.sin_cos_known.push((a, pair));
        pair
    }

    fn binary(&mut self, v: Value, f: Binary, a: Value, b: Value) -> ir::Value {
        let (x, y) = (self.of(a), self.of(b));
        match f {
            Binary::Add | Binary::Mul => {
                let (x, y) = if self.is_read(x) { (y, x) } else { (x, y) };
                if f == Binary::Add { self.b.ins().fadd(x, y) } else { self.b.ins().fmul(x, y) }
            }
            Binary::Sub => self.b.ins().fsub(x, y),
            Binary::Div => self.b.ins().fdiv(x, y),
            Binary::Min => self.b.ins().fmin(x, y),
            Binary::Max => self.b.ins().fmax(x, y),
            Binary::Lt | Binary::Le | Binary::Eq => {
                let how = match f {
                    Binary::Lt => FloatCC::LessThan,
                    Binary::Le => FloatCC::LessThanOrEqual,
                    _ => FloatCC::Equal,
                };
                let flag = self.b.ins().fcmp(how, x, y);
                self.flag(v, flag)
            }
            Binary::And | Binary::Or => {
                let (p, q) = (self.truth(a), self.truth(b));
                let flag = if f == Binary::And { self.b.ins().band(p, q) } else { self.b.ins().bor(p, q) };
                self.flag(v, flag)
            }
            Binary::Pow | Binary::Atan2 => self.call(functions::binary(f), &[x, y]),
        }
    }

    /// Without its sign. The mask is a second operand, which an instruction takes from memory as it is.
    fn abs(&mut self, x: ir::Value) -> ir::Value {
        let mask = self.b.ins().f64const(f64::from_bits(!(1 << 63)));
        self.b.ins().band(x, mask)
    }

    /// Whether a value is had from memory, and so is best a second operand.
    fn is_read(&self, x: ir::Value) -> bool {
        let dfg = &self.b.func.dfg;
        let made = dfg.value_def(x).inst().map(|i| dfg.insts[i].opcode());
        matches!(made, Some(Opcode::Load | Opcode::F64const))
    }

    /// A flag as a number, and kept as a flag.
    fn flag(&mut self, v: Value, flag: ir::Value) -> ir::Value {
        self.flags.insert(v, flag);
        let (one, zero) = (self.b.ins().f64const(1.0), self.b.ins().f64const(0.0));
        self.b.ins().select(flag, one, zero)
    }

    fn negate(&mut self, flag: ir::Value) -> ir::Value {
        self.b.ins().bxor_imm_u(flag, 1)
    }

    /// Whether a value is not 0.
    fn truth(&mut self, v: Value) -> ir::Value {
        if let Some(&flag) = self.flags.get(&v) {
            return flag;
        }
        let (x, zero) = (self.of(v), self.b.ins().f64const(0.0));
        self.b.ins().fcmp(FloatCC::NotEqual, x, zero)
    }

    fn cond(&mut self, c: &Cond) -> ir::Value {
        match c {
            Cond::Known(b) => self.b.ins().iconst(types::I8, i64::from(*b)),
            Cond::True(v) => self.truth(*v),
            Cond::Lt(a, b) => self.compare(FloatCC::LessThan, *a, *b),
            Cond::Le(a, b) => self.compare(FloatCC::LessThanOrEqual, *a, *b),
            Cond::Eq(a, b) => self.compare(FloatCC::Equal, *a, *b),
            Cond::Finite(v) => {
                // What is not finite, less itself, is no number.
                let x = self.of(*v);
                let none = self.b.ins().fsub(x, x);
                self.b.ins().fcmp(FloatCC::Ordered, none, none)
            }
            Cond::Not(c) => {
                let flag = self.cond(c);
                self.negate(flag)
            }
            Cond::All(list) | Cond::Any(list) => {
                let flags: Vec<ir::Value> = list.iter().map(|c| self.cond(c)).collect();
                let all = matches!(c, Cond::All(_));
                let join = |t: &mut Self, a, b| if all { t.b.ins().band(a, b) } else { t.b.ins().bor(a, b) };
                let mut flags = flags.into_iter();
                let Some(first) = flags.next() else { return self.b.ins().iconst(types::I8, i64::from(all)) };
                flags.fold(first, |a, b| join(self, a, b))
            }
        }
    }

    fn compare(&mut self, how: FloatCC, a: Value, b: Value) -> ir::Value {
        let (x, y) = (self.of(a), self.of(b));
        self.b.ins().fcmp(how, x, y)
    }

    /// The function of a name, with parameters of these types and so many results.
    fn function(&mut self, name: &'static str, params: &[ir::Type], results: usize) -> Option<ir::FuncRef> {
        if let Some(&f) = self.functions.get(name) {
            return Some(f);
        }
        let mut signature = self.module.make_signature();
        signature.params = params.iter().map(|t| AbiParam::new(*t)).collect();
        signature.returns = vec![AbiParam::new(types::F64); results];
        let id = self.module.declare_function((self.names)(name), Linkage::Import, &signature).ok()?;
        let f = self.module.declare_func_in_func(id, self.b.func);
        self.functions.insert(name, f);
        Some(f)
    }

    fn call(&mut self, name: Option<&'static str>, args: &[ir::Value]) -> ir::Value {
        let function = name.and_then(|name| self.function(name, &vec![types::F64; args.len()], 1));
        match function {
            Some(f) => {
                let call = self.b.ins().call(f, args);
                self.b.inst_results(call)[0]
            }
            None => args[0],
        }
    }

    fn solve(&mut self, (system, matrix, vector): (u32, u32, u32), row: u32, same: Option<Value>) {
        let pointer = self.pointer;
        let scratch = self.params[Memory::ALL.iter().position(|m| *m == Memory::Scratch).unwrap_or(0)];
        let context = self.params[Memory::ALL.len() + 1];
        let system = self.b.ins().iconst(pointer, i64::from(system));
        let matrix = self.b.ins().iadd_imm_u(scratch, 8 * i64::from(matrix));
        let vector = self.b.ins().iadd_imm_u(scratch, 8 * i64::from(vector));
        let same = match same {
            Some(v) => self.of(v),
            None => self.b.ins().f64const(0.0),
        };
        if let Some(f) = self.function(functions::SOLVE, &[pointer, pointer, pointer, pointer, types::F64], 1) {
            let call = self.b.ins().call(f, &[context, system, matrix, vector, same]);
            let x = self.b.inst_results(call)[0];
            self.b.def_var(self.vars[row as usize], x);
        }
    }
}
