//! Loops whose turns go two at a time, side by side in vectors of two numbers, each to the bits that it has alone.
//!
//! What waits for the turn before, as a sum that is added up, stays a number and is done for one turn after the other,
//! when all else of the two is done.

use super::functions;
use super::translate::Translate;
use super::vector::{self, Kind};
use crate::backend::code::{Cond, Index, Memory, Op, Place, Routine, Stmt, Value};
use crate::backend::lower::may_pair;
use bond_runtime::ir::{Binary, Unary};
use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{self, BlockArg, InstBuilder, MemFlagsData, types};
use cranelift_module::Module;
use rustc_hash::{FxHashMap, FxHashSet};

/// What of a loop goes one turn after the other: values, all else being in vectors. None where the loop has no such
/// form, or much of it would be there.
fn serial(routine: &Routine, turns: (Index, u32, u32), body: &[Stmt]) -> Option<FxHashSet<Value>> {
    if !may_pair(body, turns, &routine.tables) {
        return None;
    }
    let sets: Vec<_> = body.iter().filter_map(Stmt::sets).collect();
    let (mut serial, mut steps) = (FxHashSet::default(), 0);
    for s in body {
        let mut waits = matches!(s, Stmt::Let(_, Op::Get(var)) if sets.contains(var));
        s.each_value(&mut |v| waits |= serial.contains(&v));
        if s.place().is_some_and(|p| p.picked.is_some()) {
            return None;
        }
        match s {
            Stmt::Let(v, op) => {
                let alone = match op {
                    Op::Unary(f, _) => functions::unary(*f).is_some(),
                    Op::Binary(f, ..) => functions::binary(*f).is_some(),
                    Op::Load(_) | Op::Get(_) | Op::Select(..) => false,
                    Op::Counter(_) | Op::InverseScale(_) => true,
                };
                if alone {
                    return None;
                }
                if waits {
                    serial.insert(*v);
                    steps += 1;
                }
            }
            Stmt::Store(..) if waits => return None,
            _ => {}
        }
    }
    (3 * steps <= body.len()).then_some(serial)
}

/// Two turns on their way.
struct Vectorized<'t, 'a, 'f, M> {
    t: &'t mut Translate<'a, 'f, M>,
    index: Index,
    /// A number of each turn.
    values: FxHashMap<Value, ir::Value>,
    /// Comparisons as masks.
    masks: FxHashMap<Value, ir::Value>,
}

impl<M: Module> Translate<'_, '_, M> {
    /// Writes a loop so, where it has that form.
    pub(super) fn vectorized_loop(&mut self, index: Index, (from, to): (u32, u32), body: &[Stmt]) -> bool {
        let options = self.vector_options;
        if to - from < options.turns {
            return false;
        }
        let Some(serial) = serial(self.routine, (index, from, to), body) else { return false };
        let var = self.indices[index.0 as usize];
        let start = self.b.ins().iconst(types::I64, i64::from(from));
        self.b.def_var(var, start);
        let same = self.same(index, body);
        let (head, end) = (self.b.create_block(), self.b.create_block());
        self.b.ins().jump(head, &[] as &[BlockArg]);
        self.b.switch_to_block(head);
        // What it takes to go on with the next ones is done once for several of them.
        let pairs = if to - from < options.long { 1 } else { options.unrolled };
        for _ in 0..pairs {
            let mut two = Vectorized { t: self, index, values: same.clone(), masks: FxHashMap::default() };
            two.turns(body, &serial);
            let i = self.b.use_var(var);
            let i = self.b.ins().iadd_imm_u(i, 2);
            self.b.def_var(var, i);
        }
        let last = from + (to - from) / (2 * pairs) * 2 * pairs;
        let i = self.b.use_var(var);
        let more = self.b.ins().icmp_imm_u(IntCC::UnsignedLessThan, i, i64::from(last));
        self.b.ins().brif(more, head, &[] as &[BlockArg], end, &[] as &[BlockArg]);
        self.b.switch_to_block(end);
        for k in last..to {
            let i = self.b.ins().iconst(types::I64, i64::from(k));
            self.b.def_var(var, i);
            self.block(body);
        }
        true
    }

    /// Loads the numbers that are the same in all turns of a loop.
    fn same(&mut self, index: Index, body: &[Stmt]) -> FxHashMap<Value, ir::Value> {
        let stored = |memory| body.iter().any(|s| matches!(s, Stmt::Store(p, _) if p.memory == memory));
        let mut values = FxHashMap::default();
        for s in body {
            if let Stmt::Let(v, Op::Load(p)) = s
                && p.along.iter().all(|(i, _)| *i != index)
                && p.through.is_none_or(|(_, i)| i != index)
                && !stored(p.memory)
            {
                let (address, offset) = self.address(p);
                let x = self.b.ins().load(types::F64, flags(p.memory), address, offset);
                values.insert(*v, self.b.ins().splat(types::F64X2, x));
            }
        }
        values
    }
}

impl<M: Module> Vectorized<'_, '_, '_, M> {
    fn turns(&mut self, body: &[Stmt], serial: &FxHashSet<Value>) {
        let (mut later, mut wanted) = (Vec::new(), FxHashSet::default());
        for s in body {
            match s {
                Stmt::Let(v, _) if self.values.contains_key(v) => {}
                Stmt::Let(v, op) if !serial.contains(v) => {
                    let x = self.op(*v, op);
                    self.values.insert(*v, x);
                }
                Stmt::Store(place, v) => {
                    let x = self.of(*v);
                    self.store(place, x);
                }
                s => {
                    s.each_value(&mut |v| {
                        wanted.insert(v);
                    });
                    later.push(s);
                }
            }
        }
        for lane in 0..2 {
            for (v, x) in self.values.iter().filter(|(v, _)| wanted.contains(v)) {
                self.t.values[v.0 as usize] = Some(self.t.b.ins().extractlane(*x, lane));
            }
            for s in &later {
                self.t.statements(std::slice::from_ref(s));
            }
        }
        // They mean nothing beyond.
        wanted.iter().filter(|v| self.values.contains_key(v)).for_each(|v| self.t.values[v.0 as usize] = None);
    }

    /// Does something at the place of the second turn.
    fn second<T>(&mut self, f: impl FnOnce(&mut Self) -> T) -> T {
        let var = self.t.indices[self.index.0 as usize];
        let i = self.t.b.use_var(var);
        let next = self.t.b.ins().iadd_imm_u(i, 1);
        self.t.b.def_var(var, next);
        let result = f(self);
        self.t.b.def_var(var, i);
        result
    }

    /// How far it is from one turn's place to the next one's; None where a table says.
    fn stride(&self, place: &Place) -> Option<u32> {
        let own = place.along.iter().filter(|(i, _)| *i == self.index);
        place.through.is_none().then(|| own.map(|(_, s)| s).sum())
    }

    fn load(&mut self, place: &Place) -> ir::Value {
        let kind = if self.stride(place) == Some(1) { types::F64X2 } else { types::F64 };
        let one = |s: &mut Self| {
            let (address, offset) = s.t.address(place);
            s.t.b.ins().load(kind, flags(place.memory), address, offset)
        };
        let first = one(self);
        match self.stride(place) {
            Some(0) => self.t.b.ins().splat(types::F64X2, first),
            Some(1) => first,
            _ => {
                let second = self.second(one);
                let both = self.t.b.ins().scalar_to_vector(types::F64X2, first);
                self.t.b.ins().insertlane(both, second, 1)
            }
        }
    }

    fn store(&mut self, place: &Place, x: ir::Value) {
        let one = |s: &mut Self, x: ir::Value| {
            let (address, offset) = s.t.address(place);
            s.t.b.ins().store(flags(place.memory), x, address, offset);
        };
        if self.stride(place) == Some(1) {
            return one(self, x);
        }
        let first = self.t.b.ins().extractlane(x, 0);
        one(self, first);
        let second = self.t.b.ins().extractlane(x, 1);
        self.second(|s| one(s, second));
    }

    fn number(&mut self, x: f64) -> ir::Value {
        vector::number(&mut self.t.b, x)
    }

    fn of(&mut self, v: Value) -> ir::Value {
        if let Some(&x) = self.values.get(&v) {
            return x;
        }
        let x = match self.t.values[v.0 as usize] {
            Some(x) => self.t.b.ins().splat(types::F64X2, x),
            None => {
                let x = self.t.routine.numbers[v.0 as usize].map_or(0.0, |n| n.value());
                self.number(x)
            }
        };
        self.values.insert(v, x);
        x
    }

    fn op(&mut self, v: Value, op: &Op) -> ir::Value {
        match op {
            Op::Load(place) => self.load(place),
            Op::Get(var) => {
                let x = self.t.b.use_var(self.t.vars[var.0 as usize]);
                self.t.b.ins().splat(types::F64X2, x)
            }
            // Neither is done in vectors: see `serial`.
            Op::Counter(_) => self.of(v),
            Op::InverseScale(a) => self.of(*a),
            Op::Unary(f, a) => self.unary(v, *f, *a),
            Op::Binary(f, a, b) => self.binary(v, *f, *a, *b),
            Op::Select(c, a, b) => {
                let mask = self.cond(c);
                let x = self.of(*a);
                if self.t.routine.numbers[b.0 as usize].is_some_and(|n| n.value().to_bits() == 0) {
                    return vector::only(&mut self.t.b, mask, x);
                }
                let y = self.of(*b);
                self.choose(mask, x, y)
            }
        }
    }

    fn unary(&mut self, v: Value, f: Unary, a: Value) -> ir::Value {
        if f == Unary::Not {
            let mask = self.truth(a);
            let mask = self.t.b.ins().bnot(mask);
            return self.mask(v, mask);
        }
        let x = self.of(a);
        if f == Unary::Abs {
            // With a mask from memory: the code generator's own is made anew each time.
            let mask = vector::constant(&mut self.t.b, types::F64X2, !(1 << 63));
            return self.t.b.ins().band(x, mask);
        }
        vector::unary(&mut self.t.b, f, x)
    }

    fn binary(&mut self, v: Value, f: Binary, a: Value, b: Value) -> ir::Value {
        match vector::binary(f) {
            Kind::Number(make) => {
                let (x, y) = (self.of(a), self.of(b));
                make(&mut self.t.b, x, y)
            }
            Kind::Compared(how) => {
                let mask = self.compare(how, a, b);
                self.mask(v, mask)
            }
            Kind::Joined { both } => {
                let (p, q) = (self.truth(a), self.truth(b));
                let mask = if both { self.t.b.ins().band(p, q) } else { self.t.b.ins().bor(p, q) };
                self.mask(v, mask)
            }
            // Loops with calls have no such form.
            Kind::Call => self.of(a),
        }
    }

    fn choose(&mut self, mask: ir::Value, a: ir::Value, b: ir::Value) -> ir::Value {
        vector::choose(&mut self.t.b, mask, a, b)
    }

    /// A mask as numbers, and kept as a mask.
    fn mask(&mut self, v: Value, mask: ir::Value) -> ir::Value {
        self.masks.insert(v, mask);
        let (one, zero) = (self.number(1.0), self.number(0.0));
        self.choose(mask, one, zero)
    }

    /// Where a value is not 0.
    fn truth(&mut self, v: Value) -> ir::Value {
        if let Some(&mask) = self.masks.get(&v) {
            return mask;
        }
        let (x, zero) = (self.of(v), self.number(0.0));
        self.t.b.ins().fcmp(FloatCC::NotEqual, x, zero)
    }

    fn cond(&mut self, c: &Cond) -> ir::Value {
        match c {
            Cond::Known(on) => vector::constant(&mut self.t.b, types::I64X2, if *on { u64::MAX } else { 0 }),
            Cond::True(v) => self.truth(*v),
            Cond::Lt(a, b) => self.compare(FloatCC::LessThan, *a, *b),
            Cond::Le(a, b) => self.compare(FloatCC::LessThanOrEqual, *a, *b),
            Cond::Eq(a, b) => self.compare(FloatCC::Equal, *a, *b),
            Cond::Finite(v) => {
                let (x, infinite) = (self.of(*v), self.number(f64::INFINITY));
                let size = self.t.b.ins().fabs(x);
                self.t.b.ins().fcmp(FloatCC::LessThan, size, infinite)
            }
            Cond::Not(c) => {
                let mask = self.cond(c);
                self.t.b.ins().bnot(mask)
            }
            Cond::All(list) | Cond::Any(list) => {
                let all = matches!(c, Cond::All(_));
                let mut joined = self.cond(&Cond::Known(all));
                for c in list {
                    let mask = self.cond(c);
                    joined = if all { self.t.b.ins().band(joined, mask) } else { self.t.b.ins().bor(joined, mask) };
                }
                joined
            }
        }
    }

    fn compare(&mut self, how: FloatCC, a: Value, b: Value) -> ir::Value {
        let (x, y) = (self.of(a), self.of(b));
        self.t.b.ins().fcmp(how, x, y)
    }
}

/// What is known of loads and stores of a memory, whose places need not be multiples of a vector.
fn flags(memory: Memory) -> MemFlagsData {
    let flags = MemFlagsData::new().with_notrap();
    match memory {
        Memory::Table | Memory::Data => flags.with_readonly().with_can_move(),
        Memory::State | Memory::Next | Memory::Input | Memory::Scratch | Memory::Output => flags,
    }
}
