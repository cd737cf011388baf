//! From a routine to a function that does it for several scenes at once, side by side in vector lanes: each to the bits
//! that it has alone.
//!
//! Each number becomes [`PAIRS`] vectors of two. A branch that scenes take differently is gone through on both ways,
//! and what each way sets is set only in the lanes that take it; a loop goes on until the last lane has left it. What
//! is the same in all lanes, such as how many intervals are over, stays a branch.

use super::functions;
use super::translate::{Made, SINGULAR, signature, sin_cos_arguments};
use super::vector::{self, Kind};
use crate::backend::code::{Cond, Memory, Number, Op, Place, Routine, Stmt, Value};
use bond_runtime::ir::{Binary, Unary};
use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{self, AbiParam, BlockArg, Endianness, InstBuilder, MemFlagsData, types};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext, Variable};
use cranelift_module::{FuncId, Linkage, Module};
use rustc_hash::{FxHashMap, FxHashSet};

/// Vectors of two numbers.
const PAIRS: usize = 2;
/// Scenes at once.
pub(super) const LANES: usize = 2 * PAIRS;
/// Bytes of a number of all of them.
const EACH: i64 = 8 * LANES as i64;

/// A number, or a mask, in each lane.
type Lanes = [ir::Value; PAIRS];

/// Whether a routine has a form in lanes: one that solves large systems, or goes by tables, has none.
pub(super) fn fits(body: &[Stmt]) -> bool {
    let even = |p: &Place| p.through.is_none();
    body.iter().all(|s| {
        let own = match s {
            Stmt::Let(_, Op::Load(p)) | Stmt::Store(p, _) => even(p),
            Stmt::Solve { .. } | Stmt::Count(_) => false,
            Stmt::Let(_, Op::Get(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..))
            | Stmt::Set(..)
            | Stmt::If(..)
            | Stmt::Loop(_)
            | Stmt::For(..)
            | Stmt::Break
            | Stmt::Continue
            | Stmt::Note(_)
            | Stmt::Fail(_) => true,
        };
        own && s.inner().into_iter().all(fits)
    })
}

/// Defines the function of a routine that [`fits`], with the parameters of [`super::translate::define`]. All memories
/// have the numbers of the lanes beside one another, but for that of the notes, of which the report tells for each lane
/// how many bytes from its begin the next one goes. Returns 0, or another number where one lane fails, whichever.
pub(super) fn define<M: Module>(module: &mut M, routine: &Routine) -> Made<FuncId> {
    let signature = signature(module);
    let id = module.declare_function("lanes", Linkage::Export, &signature)?;
    let mut context = module.make_context();
    context.func.signature = signature;
    let mut frontend = FunctionBuilderContext::new();
    let mut b = FunctionBuilder::new(&mut context.func, &mut frontend);
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let params = b.block_params(entry).to_vec();
    let mut vector = |t| std::array::from_fn(|_| b.declare_var(t));
    let mut t = Translate {
        vars: (0..routine.vars).map(|_| vector(types::F64X2)).collect(),
        indices: Vec::new(),
        values: vec![None; routine.numbers.len()],
        masks: FxHashMap::default(),
        functions: FxHashMap::default(),
        loops: Vec::new(),
        same: Same::of(routine),
        sin_cos_of: if cfg!(unix) { sin_cos_arguments(&routine.body) } else { FxHashSet::default() },
        sin_cos_known: Vec::new(),
        routine,
        params,
        module,
        b,
    };
    t.indices = (0..routine.indices).map(|_| t.b.declare_var(types::I64)).collect();
    let zero = t.number(0.0);
    for v in t.vars.clone() {
        t.put(v, zero);
    }
    if t.block(&routine.body, Mask::All, None) != Rest::Gone {
        t.leave(0);
    }
    t.b.seal_all_blocks();
    let config = t.module.target_config();
    t.b.finalize(config);
    module.define_function(id, &mut context)?;
    Ok(id)
}

/// What is the same in all lanes.
struct Same {
    values: Vec<bool>,
    vars: Vec<bool>,
}

impl Same {
    /// Of a routine: found by taking all for the same, and going through it until nothing is found to differ.
    fn of(routine: &Routine) -> Self {
        let mut same = Self { values: vec![true; routine.numbers.len()], vars: vec![true; routine.vars as usize] };
        while same.block(&routine.body, true) {}
        same
    }

    /// Whether something was found to differ. `all` says that all lanes get here together.
    fn block(&mut self, body: &[Stmt], all: bool) -> bool {
        let mut found = false;
        for s in body {
            found |= match s {
                Stmt::Let(v, op) => {
                    let same = match op {
                        Op::Load(p) => p.memory == Memory::Input,
                        Op::Get(var) => self.vars[var.0 as usize],
                        Op::Unary(_, a) => self.values[a.0 as usize],
                        Op::Binary(_, a, b) => self.values[a.0 as usize] && self.values[b.0 as usize],
                        Op::Select(c, a, b) => self.cond(c) && self.values[a.0 as usize] && self.values[b.0 as usize],
                    };
                    !same && std::mem::replace(&mut self.values[v.0 as usize], false)
                }
                Stmt::Set(var, v) => {
                    let same = all && self.values[v.0 as usize];
                    !same && std::mem::replace(&mut self.vars[var.0 as usize], false)
                }
                Stmt::If(c, yes, no) => {
                    let all = all && self.cond(c);
                    self.block(yes, all) | self.block(no, all)
                }
                Stmt::Loop(body) => {
                    let all = all && self.together(body, true);
                    self.block(body, all)
                }
                Stmt::For(_, _, _, body) => self.block(body, all),
                Stmt::Store(..)
                | Stmt::Break
                | Stmt::Continue
                | Stmt::Solve { .. }
                | Stmt::Count(_)
                | Stmt::Note(_)
                | Stmt::Fail(_) => false,
            };
        }
        found
    }

    fn cond(&self, c: &Cond) -> bool {
        let mut same = true;
        c.each_value(&mut |v| same &= self.values[v.0 as usize]);
        same
    }

    /// Whether all lanes leave a loop, or begin it anew, together, where `all` of them get to this part of it.
    fn together(&self, body: &[Stmt], all: bool) -> bool {
        body.iter().all(|s| match s {
            Stmt::Break | Stmt::Continue => all,
            Stmt::If(c, yes, no) => {
                let all = all && self.cond(c);
                self.together(yes, all) && self.together(no, all)
            }
            // Whoever ends in an inner loop ends that one.
            Stmt::Loop(_) | Stmt::For(..) => true,
            Stmt::Let(..)
            | Stmt::Set(..)
            | Stmt::Store(..)
            | Stmt::Solve { .. }
            | Stmt::Count(_)
            | Stmt::Note(_)
            | Stmt::Fail(_) => true,
        })
    }
}

/// The lanes that get somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mask {
    /// All of them.
    All,
    /// Some; ones in their lanes.
    Some(Lanes),
}

/// The lanes that get to the end of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Rest {
    /// Those that began it.
    Same,
    /// These of them.
    Some(Lanes),
    /// None: the end is not reached.
    Gone,
}

/// A loop around.
#[derive(Clone, Copy)]
struct Around {
    head: ir::Block,
    end: ir::Block,
    /// The lanes that have not left it; None where all leave it together.
    live: Option<[Variable; PAIRS]>,
}

/// A routine on its way.
struct Translate<'a, 'f, M> {
    module: &'a mut M,
    b: FunctionBuilder<'f>,
    routine: &'a Routine,
    params: Vec<ir::Value>,
    vars: Vec<[Variable; PAIRS]>,
    indices: Vec<Variable>,
    values: Vec<Option<Lanes>>,
    /// Comparisons as masks.
    masks: FxHashMap<Value, Lanes>,
    functions: FxHashMap<&'static str, ir::FuncRef>,
    loops: Vec<Around>,
    same: Same,
    /// As in [`super::translate`].
    sin_cos_of: FxHashSet<Value>,
    sin_cos_known: Vec<(Value, (Lanes, Lanes))>,
}

/// Numbers lie where they lie, not at multiples of a vector's size.
fn flags() -> MemFlagsData {
    MemFlagsData::new().with_notrap()
}

impl<M: Module> Translate<'_, '_, M> {
    fn each(&mut self, mut f: impl FnMut(&mut Self, usize) -> ir::Value) -> Lanes {
        let mut lanes = [ir::Value::from_u32(0); PAIRS];
        for (p, lane) in lanes.iter_mut().enumerate() {
            *lane = f(self, p);
        }
        lanes
    }

    fn put(&mut self, vars: [Variable; PAIRS], x: Lanes) {
        for (v, x) in vars.into_iter().zip(x) {
            self.b.def_var(v, x);
        }
    }

    fn get(&mut self, vars: [Variable; PAIRS]) -> Lanes {
        self.each(|t, p| t.b.use_var(vars[p]))
    }

    /// Two equal words as a vector.
    fn constant(&mut self, kind: ir::Type, word: u64) -> Lanes {
        [vector::constant(&mut self.b, kind, word); PAIRS]
    }

    fn number(&mut self, x: f64) -> Lanes {
        self.constant(types::F64X2, x.to_bits())
    }

    /// A mask of all lanes, or of none.
    fn every(&mut self, on: bool) -> Lanes {
        self.constant(types::I64X2, if on { u64::MAX } else { 0 })
    }

    fn and(&mut self, a: Lanes, b: Lanes) -> Lanes {
        self.each(|t, p| t.b.ins().band(a[p], b[p]))
    }

    fn or(&mut self, a: Lanes, b: Lanes) -> Lanes {
        self.each(|t, p| t.b.ins().bor(a[p], b[p]))
    }

    /// Those of a mask that are not in another.
    fn without(&mut self, a: Lanes, b: Lanes) -> Lanes {
        self.each(|t, p| t.b.ins().band_not(a[p], b[p]))
    }

    /// Whether there is a lane in a mask.
    fn any(&mut self, mask: Lanes) -> ir::Value {
        let [first, rest @ ..] = mask;
        let all = rest.into_iter().fold(first, |a, b| self.b.ins().bor(a, b));
        self.b.ins().vany_true(all)
    }

    fn within(&mut self, mask: Mask, lanes: Lanes) -> Lanes {
        match mask {
            Mask::All => lanes,
            Mask::Some(mask) => self.and(mask, lanes),
        }
    }

    /// One number where a mask has ones, another elsewhere.
    fn choose(&mut self, mask: Lanes, a: Lanes, b: Lanes) -> Lanes {
        self.each(|t, p| vector::choose(&mut t.b, mask[p], a[p], b[p]))
    }

    fn jump(&mut self, to: ir::Block) {
        self.b.ins().jump(to, &[] as &[BlockArg]);
    }

    fn branch(&mut self, flag: ir::Value, yes: ir::Block, no: ir::Block) {
        self.b.ins().brif(flag, yes, &[] as &[BlockArg], no, &[] as &[BlockArg]);
    }

    fn leave(&mut self, code: i64) {
        let code = self.b.ins().iconst(types::I32, code);
        self.b.ins().return_(&[code]);
    }

    /// Writes a block that the lanes of a mask get to, of which there is one at least. Where none is left in the midst
    /// of it, it is left for `out`, which may take a mask of what is left.
    fn block(&mut self, body: &[Stmt], mut mask: Mask, out: Option<ir::Block>) -> Rest {
        let (turned, mut rest) = (self.sin_cos_known.len(), Rest::Same);
        for (k, s) in body.iter().enumerate() {
            let after = self.stmt(s, mask);
            match after {
                Rest::Same => {}
                Rest::Gone => {
                    rest = Rest::Gone;
                    break;
                }
                Rest::Some(lanes) => {
                    (mask, rest) = (Mask::Some(lanes), after);
                    if let Some(out) = out.filter(|_| k + 1 < body.len()) {
                        let (more, any) = (self.b.create_block(), self.any(lanes));
                        let left: Vec<BlockArg> = match self.b.block_params(out).is_empty() {
                            true => Vec::new(),
                            false => lanes.iter().map(|x| BlockArg::Value(*x)).collect(),
                        };
                        self.b.ins().brif(any, more, &[] as &[BlockArg], out, &left);
                        self.b.switch_to_block(more);
                    }
                }
            }
        }
        self.sin_cos_known.truncate(turned);
        rest
    }

    fn stmt(&mut self, s: &Stmt, mask: Mask) -> Rest {
        match s {
            Stmt::Let(v, op) => {
                let x = self.op(*v, op);
                self.values[v.0 as usize] = Some(x);
            }
            Stmt::Set(var, v) => {
                let (var, mut x) = (self.vars[var.0 as usize], self.of(*v));
                if let Mask::Some(mask) = mask {
                    let before = self.get(var);
                    x = self.choose(mask, x, before);
                }
                self.put(var, x);
            }
            Stmt::Store(place, v) => {
                let (x, (address, offset)) = (self.of(*v), self.address(place));
                for (p, mut x) in x.into_iter().enumerate() {
                    let offset = offset + 16 * p as i32;
                    if let Mask::Some(mask) = mask {
                        let before = self.b.ins().load(types::F64X2, flags(), address, offset);
                        let endian = MemFlagsData::new().with_endianness(Endianness::Little);
                        let mask = self.b.ins().bitcast(types::F64X2, endian, mask[p]);
                        x = self.b.ins().bitselect(mask, x, before);
                    }
                    self.b.ins().store(flags(), x, address, offset);
                }
            }
            Stmt::If(c, yes, no) => return self.either(c, (yes, no), mask),
            Stmt::Loop(body) => return self.repeat(body, mask),
            Stmt::Break | Stmt::Continue => return self.end(*s == Stmt::Break, mask),
            Stmt::For(index, from, to, body) => {
                let var = self.indices[index.0 as usize];
                let start = self.b.ins().iconst(types::I64, i64::from(*from));
                self.b.def_var(var, start);
                let (head, end) = (self.b.create_block(), self.b.create_block());
                self.jump(head);
                self.b.switch_to_block(head);
                self.block(body, mask, None);
                let i = self.b.use_var(var);
                let i = self.b.ins().iadd_imm_u(i, 1);
                self.b.def_var(var, i);
                let more = self.b.ins().icmp_imm_u(IntCC::UnsignedLessThan, i, i64::from(*to));
                self.branch(more, head, end);
                self.b.switch_to_block(end);
            }
            Stmt::Note(list) => self.note(list, mask),
            Stmt::Fail(_) => {
                // Which lane failed, and why, is found out by each for itself.
                self.leave(SINGULAR);
                return Rest::Gone;
            }
            // Such routines do not fit.
            Stmt::Solve { .. } | Stmt::Count(_) => {}
        }
        Rest::Same
    }

    /// Two ways of which each lane goes one.
    fn either(&mut self, c: &Cond, (yes, no): (&[Stmt], &[Stmt]), mask: Mask) -> Rest {
        let lanes = self.cond(c);
        if self.same.cond(c) {
            let (then, other, after) = (self.b.create_block(), self.b.create_block(), self.b.create_block());
            let flag = self.any(lanes);
            self.branch(flag, then, other);
            let whole = |t: &mut Self| match mask {
                Mask::All => t.every(true),
                Mask::Some(lanes) => lanes,
            };
            let (mut gone, partly) = (0, self.leaves(yes) || self.leaves(no));
            if partly {
                (0..PAIRS).for_each(|_| {
                    self.b.append_block_param(after, types::I64X2);
                });
            }
            for (block, body) in [(then, yes), (other, no)] {
                self.b.switch_to_block(block);
                let rest = match self.block(body, mask, Some(after)) {
                    Rest::Gone => {
                        gone += 1;
                        continue;
                    }
                    Rest::Some(lanes) => lanes,
                    Rest::Same => {
                        if !partly {
                            self.jump(after);
                            continue;
                        }
                        whole(self)
                    }
                };
                let args: Vec<BlockArg> = rest.iter().map(|x| BlockArg::Value(*x)).collect();
                self.b.ins().jump(after, &args);
            }
            self.b.switch_to_block(after);
            if gone == 2 {
                self.b.ins().trap(ir::TrapCode::unwrap_user(1)); // never reached
                return Rest::Gone;
            }
            if !partly {
                return Rest::Same;
            }
            let left = self.b.block_params(after).to_vec();
            return Rest::Some(std::array::from_fn(|p| left[p]));
        }
        let first = self.within(mask, lanes);
        let second = match mask {
            Mask::All => self.each(|t, p| t.b.ins().bnot(first[p])),
            Mask::Some(mask) => self.without(mask, first),
        };
        let one = self.way(yes, first);
        let other = self.way(no, second);
        match (one, other) {
            (None, None) => Rest::Same,
            (one, other) => Rest::Some(self.or(one.unwrap_or(first), other.unwrap_or(second))),
        }
    }

    /// A way that some lanes go, where there are such; those that get to its end, where these may be others.
    fn way(&mut self, body: &[Stmt], lanes: Lanes) -> Option<Lanes> {
        if body.is_empty() {
            return None;
        }
        let (then, after) = (self.b.create_block(), self.b.create_block());
        let any = self.any(lanes);
        if !self.leaves(body) {
            self.branch(any, then, after);
            self.b.switch_to_block(then);
            // What fails leaves with all lanes.
            if self.block(body, Mask::Some(lanes), None) != Rest::Gone {
                self.jump(after);
            }
            self.b.switch_to_block(after);
            return None;
        }
        (0..PAIRS).for_each(|_| {
            self.b.append_block_param(after, types::I64X2);
        });
        let args = |lanes: Lanes| -> Vec<BlockArg> { lanes.iter().map(|x| BlockArg::Value(*x)).collect() };
        // Where no lane goes it, none is left of it: that is the mask itself.
        self.b.ins().brif(any, then, &[] as &[BlockArg], after, &args(lanes));
        self.b.switch_to_block(then);
        let rest = match self.block(body, Mask::Some(lanes), Some(after)) {
            Rest::Same => Some(lanes),
            Rest::Some(rest) => Some(rest),
            Rest::Gone => None,
        };
        if let Some(rest) = rest {
            self.b.ins().jump(after, &args(rest));
        }
        self.b.switch_to_block(after);
        let left = self.b.block_params(after).to_vec();
        Some(std::array::from_fn(|p| left[p]))
    }

    /// Whether some lanes may end in a block that others get through: by leaving the loop around.
    fn leaves(&self, body: &[Stmt]) -> bool {
        self.loops.last().is_some_and(|l| l.live.is_some()) && ends(body)
    }

    fn repeat(&mut self, body: &[Stmt], mask: Mask) -> Rest {
        let together = mask == Mask::All && self.same.together(body, true);
        let live = (!together).then(|| std::array::from_fn(|_| self.b.declare_var(types::I64X2)));
        if let Some(live) = live {
            let begun = match mask {
                Mask::All => self.every(true),
                Mask::Some(lanes) => lanes,
            };
            self.put(live, begun);
        }
        let [head, latch, end] = [(); 3].map(|()| self.b.create_block());
        self.jump(head);
        self.b.switch_to_block(head);
        self.loops.push(Around { head, end, live });
        let inner = match live {
            Some(live) => Mask::Some(self.get(live)),
            None => mask,
        };
        if self.block(body, inner, Some(latch)) != Rest::Gone {
            self.jump(latch);
        }
        self.loops.pop();
        self.b.switch_to_block(latch);
        match live {
            Some(live) => {
                let left = self.get(live);
                let any = self.any(left);
                self.branch(any, head, end);
            }
            None => self.jump(head),
        }
        self.b.switch_to_block(end);
        Rest::Same
    }

    /// Lanes leave the loop around, or begin it anew.
    fn end(&mut self, leave: bool, mask: Mask) -> Rest {
        let Some(around) = self.loops.last().copied() else { return Rest::Gone };
        let Some(live) = around.live else {
            self.jump(if leave { around.end } else { around.head });
            return Rest::Gone;
        };
        if leave {
            let before = self.get(live);
            let after = match mask {
                Mask::All => self.every(false),
                Mask::Some(lanes) => self.without(before, lanes),
            };
            self.put(live, after);
        }
        Rest::Some(self.every(false))
    }

    /// Leaves numbers of the lanes behind those that each left before.
    fn note(&mut self, list: &[Value], mask: Mask) {
        let report = self.params[Memory::ALL.len()];
        let notes = self.params[Memory::ALL.iter().position(|m| *m == Memory::Next).unwrap_or(0)];
        let list: Vec<Lanes> = list.iter().map(|v| self.of(*v)).collect();
        for lane in 0..LANES {
            let (pair, half, at) = (lane / 2, (lane % 2) as u8, 8 * lane as i32);
            let after = match mask {
                Mask::All => None,
                Mask::Some(mask) => {
                    let (there, after) = (self.b.create_block(), self.b.create_block());
                    let on = self.b.ins().extractlane(mask[pair], half);
                    self.branch(on, there, after);
                    self.b.switch_to_block(there);
                    Some(after)
                }
            };
            let so_far = self.b.ins().load(types::I64, flags(), report, at);
            let to = self.b.ins().iadd(notes, so_far);
            for (k, x) in list.iter().enumerate() {
                let x = self.b.ins().extractlane(x[pair], half);
                self.b.ins().store(flags(), x, to, 8 * k as i32);
            }
            let next = self.b.ins().iadd_imm_u(so_far, 8 * list.len() as i64);
            self.b.ins().store(flags(), next, report, at);
            if let Some(after) = after {
                self.jump(after);
                self.b.switch_to_block(after);
            }
        }
    }

    /// The value of a value.
    fn of(&mut self, v: Value) -> Lanes {
        match self.values[v.0 as usize] {
            Some(x) => x,
            None => self.number(self.routine.numbers[v.0 as usize].map_or(0.0, Number::value)),
        }
    }

    fn address(&mut self, place: &Place) -> (ir::Value, i32) {
        let at = Memory::ALL.iter().position(|m| *m == place.memory).unwrap_or(0);
        let mut address = self.params[at];
        for (index, stride) in &place.along {
            let i = self.b.use_var(self.indices[index.0 as usize]);
            let i = self.b.ins().imul_imm_u(i, EACH * i64::from(*stride));
            address = self.b.ins().iadd(address, i);
        }
        match i32::try_from(EACH * i64::from(place.base) + EACH) {
            Ok(end) => (address, end - EACH as i32),
            Err(_) => (self.b.ins().iadd_imm_u(address, EACH * i64::from(place.base)), 0),
        }
    }

    fn op(&mut self, v: Value, op: &Op) -> Lanes {
        match op {
            Op::Load(place) => {
                let (address, offset) = self.address(place);
                self.each(|t, p| t.b.ins().load(types::F64X2, flags(), address, offset + 16 * p as i32))
            }
            Op::Get(var) => self.get(self.vars[var.0 as usize]),
            Op::Unary(f, a) => self.unary(v, *f, *a),
            Op::Binary(f, x, y) => self.binary(v, *f, *x, *y),
            Op::Select(c, x, y) => {
                let mask = self.cond(c);
                let (x, y) = (self.of(*x), self.of(*y));
                self.choose(mask, x, y)
            }
        }
    }

    fn unary(&mut self, v: Value, f: Unary, a: Value) -> Lanes {
        if f == Unary::Not {
            let mask = self.truth(a);
            let mask = self.each(|t, p| t.b.ins().bnot(mask[p]));
            return self.mask(v, mask);
        }
        let x = self.of(a);
        if matches!(f, Unary::Sin | Unary::Cos) && self.sin_cos_of.contains(&a) {
            let (sine, cosine) = self.sin_cos(a, x);
            return if f == Unary::Sin { sine } else { cosine };
        }
        match functions::unary(f) {
            Some(name) => self.call(Some(name), &[x], 1)[0],
            None => self.each(|t, p| vector::unary(&mut t.b, f, x[p])),
        }
    }

    /// Sine and cosine of a value.
    fn sin_cos(&mut self, a: Value, x: Lanes) -> (Lanes, Lanes) {
        if let Some(found) = self.sin_cos_known.iter().rev().find(|t| t.0 == a) {
            return found.1;
        }
        let [sine, cosine] = self.call(Some(functions::SIN_COS), &[x], 2)[..] else { return (x, x) };
        self.sin_cos_known.push((a, (sine, cosine)));
        (sine, cosine)
    }

    fn binary(&mut self, v: Value, f: Binary, a: Value, b: Value) -> Lanes {
        let (x, y) = (self.of(a), self.of(b));
        match vector::binary(f) {
            Kind::Number(make) => self.each(|t, p| make(&mut t.b, x[p], y[p])),
            Kind::Compared(how) => {
                let mask = self.compare(how, x, y);
                self.mask(v, mask)
            }
            Kind::Joined { both } => {
                let (p, q) = (self.truth(a), self.truth(b));
                let mask = if both { self.and(p, q) } else { self.or(p, q) };
                self.mask(v, mask)
            }
            Kind::Call => self.call(functions::binary(f), &[x, y], 1)[0],
        }
    }

    /// A mask as numbers, and kept as a mask.
    fn mask(&mut self, v: Value, mask: Lanes) -> Lanes {
        self.masks.insert(v, mask);
        let (one, zero) = (self.number(1.0), self.number(0.0));
        self.choose(mask, one, zero)
    }

    /// Where a value is not 0.
    fn truth(&mut self, v: Value) -> Lanes {
        if let Some(&mask) = self.masks.get(&v) {
            return mask;
        }
        let (x, zero) = (self.of(v), self.number(0.0));
        self.compare(FloatCC::NotEqual, x, zero)
    }

    fn cond(&mut self, c: &Cond) -> Lanes {
        match c {
            Cond::Known(b) => self.every(*b),
            Cond::True(v) => self.truth(*v),
            Cond::Lt(a, b) => self.compare_values(FloatCC::LessThan, *a, *b),
            Cond::Le(a, b) => self.compare_values(FloatCC::LessThanOrEqual, *a, *b),
            Cond::Eq(a, b) => self.compare_values(FloatCC::Equal, *a, *b),
            Cond::Finite(v) => {
                let (x, infinite) = (self.of(*v), self.number(f64::INFINITY));
                let size = self.each(|t, p| t.b.ins().fabs(x[p]));
                self.compare(FloatCC::LessThan, size, infinite)
            }
            Cond::Not(c) => {
                let mask = self.cond(c);
                self.each(|t, p| t.b.ins().bnot(mask[p]))
            }
            Cond::All(list) | Cond::Any(list) => {
                let all = matches!(c, Cond::All(_));
                let mut masks: Vec<Lanes> = Vec::with_capacity(list.len());
                for c in list {
                    masks.push(self.cond(c));
                }
                let joined = masks.into_iter().reduce(|a, b| if all { self.and(a, b) } else { self.or(a, b) });
                joined.unwrap_or_else(|| self.every(all))
            }
        }
    }

    fn compare_values(&mut self, how: FloatCC, a: Value, b: Value) -> Lanes {
        let (x, y) = (self.of(a), self.of(b));
        self.compare(how, x, y)
    }

    fn compare(&mut self, how: FloatCC, x: Lanes, y: Lanes) -> Lanes {
        self.each(|t, p| t.b.ins().fcmp(how, x[p], y[p]))
    }

    /// A function of numbers, lane by lane; its results.
    fn call(&mut self, name: Option<&'static str>, args: &[Lanes], results: usize) -> Vec<Lanes> {
        let Some(f) = name.and_then(|name| self.function(name, args.len(), results)) else { return args.to_vec() };
        let mut halves = vec![Vec::with_capacity(LANES); results];
        for lane in 0..LANES {
            let args: Vec<ir::Value> =
                args.iter().map(|x| self.b.ins().extractlane(x[lane / 2], (lane % 2) as u8)).collect();
            let call = self.b.ins().call(f, &args);
            for (list, x) in halves.iter_mut().zip(self.b.inst_results(call)) {
                list.push(*x);
            }
        }
        let join = |list: Vec<ir::Value>| {
            self.each(|t, p| {
                let low = t.b.ins().splat(types::F64X2, list[2 * p]);
                t.b.ins().insertlane(low, list[2 * p + 1], 1)
            })
        };
        halves.into_iter().map(join).collect()
    }

    fn function(&mut self, name: &'static str, params: usize, results: usize) -> Option<ir::FuncRef> {
        if let Some(&f) = self.functions.get(name) {
            return Some(f);
        }
        let mut signature = self.module.make_signature();
        signature.params = vec![AbiParam::new(types::F64); params];
        signature.returns = vec![AbiParam::new(types::F64); results];
        let id = self.module.declare_function(name, Linkage::Import, &signature).ok()?;
        let f = self.module.declare_func_in_func(id, self.b.func);
        self.functions.insert(name, f);
        Some(f)
    }
}

/// Whether a block leaves the loop around it, or begins it anew.
fn ends(body: &[Stmt]) -> bool {
    body.iter().any(|s| match s {
        Stmt::Break | Stmt::Continue => true,
        Stmt::If(_, yes, no) => ends(yes) || ends(no),
        // What they end is their own.
        Stmt::Loop(_) | Stmt::For(..) => false,
        Stmt::Let(..)
        | Stmt::Set(..)
        | Stmt::Store(..)
        | Stmt::Solve { .. }
        | Stmt::Count(_)
        | Stmt::Note(_)
        | Stmt::Fail(_) => false,
    })
}
