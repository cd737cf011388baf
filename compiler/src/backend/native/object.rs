//! Object files: a unit as machine code with the functions that its header declares.

use super::functions;
use super::translate::{Made, REPORT, define};
use crate::backend::c::early;
use crate::backend::code::{Memory, Routine};
use crate::backend::lower::{Solvers, with_solvers};
use crate::backend::standalone::{NAMES, StandaloneModule};
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::{self, AbiParam, BlockArg, InstBuilder, MemFlagsData, StackSlotData, StackSlotKind, types};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_module::{DataDescription, DataId, FuncId, Linkage, Module, default_libcall_names};
use cranelift_object::{ObjectBuilder, ObjectModule};

/// The object file of a unit, for machines like this one; its public names begin with `prefix`.
///
/// # Errors
/// In words: a machine that is not known, or code beyond what it takes.
pub fn object(unit: &StandaloneModule, prefix: &str) -> Result<Vec<u8>, String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let mut flags = settings::builder();
    for (name, value) in [("opt_level", "speed"), ("is_pic", "true")] {
        flags.set(name, value).map_err(|e| text(&e))?;
    }
    let isa = cranelift_native::builder()?.finish(settings::Flags::new(flags)).map_err(|e| text(&e))?;
    let builder = ObjectBuilder::new(isa, unit.name.clone(), default_libcall_names()).map_err(|e| text(&e))?;
    let mut writer = Writer { module: ObjectModule::new(builder), unit, prefix };
    writer.all().map_err(|e| text(&e))?;
    writer.module.finish().emit().map_err(|e| text(&e))
}

/// An object in the making.
struct Writer<'a> {
    module: ObjectModule,
    unit: &'a StandaloneModule,
    prefix: &'a str,
}

/// A routine, with what it reads besides the state.
#[derive(Clone, Copy)]
struct Callee {
    function: FuncId,
    constants: DataId,
    data: DataId,
    tables: DataId,
    /// Where its scratch begins.
    scratch: usize,
}

/// What a public function takes and gives.
struct Face<'n> {
    name: &'n str,
    params: Vec<ir::Type>,
    gives: Option<ir::Type>,
}

impl<'n> Face<'n> {
    fn new(name: &'n str, params: &[ir::Type], gives: Option<ir::Type>) -> Self {
        Self { name, params: params.to_vec(), gives }
    }
}

impl Writer<'_> {
    /// Defines all functions that the header declares.
    fn all(&mut self) -> Made<()> {
        let own = |name: &str| format!("{}_{name}_", self.prefix);
        let (commit, observe, several) = (own("commit"), own("observe"), own("many"));
        let constants = self.numbers("table", &self.unit.table)?;
        let commit = self.routine(&commit, &self.unit.commit, (constants, 0))?;
        let many = self.unit.run.as_ref().map(|many| self.routine(&several, many, (constants, 0))).transpose()?;
        let observe = self.routine(&observe, &self.unit.observe, (constants, self.unit.observe_scratch))?;
        self.state_functions()?;
        self.commit_function(commit)?;
        if let Some(many) = many {
            self.run_function(many)?;
        }
        self.reading_functions(observe)?;
        self.input_function()
    }

    /// Defines a routine, with its numbers and tables.
    fn routine(&mut self, name: &str, routine: &Routine, (constants, scratch): (DataId, usize)) -> Made<Callee> {
        let routine = &with_solvers(routine.clone(), Solvers::All);
        let function = define(&mut self.module, name, routine, Linkage::Local, functions::libm, false)?;
        let data = self.numbers(&format!("{name}data"), &routine.data)?;
        let tables = routine.tables.iter().flat_map(|x| x.to_ne_bytes()).collect();
        let tables = self.constant(&format!("{name}tables"), tables)?;
        Ok(Callee { function, constants, data, tables, scratch })
    }

    /// Bytes of the block and the scratch, without what is put back where an interval fails.
    fn kept(&self) -> i64 {
        8 * (self.unit.image.len() + self.unit.scratch) as i64
    }

    /// Begins, saves and restores.
    fn state_functions(&mut self) -> Made<()> {
        let pointer = self.module.target_config().pointer_type();
        let n = self.unit.kept as i64;
        let start = self.numbers("start", &self.unit.image[..self.unit.kept])?;
        self.function(Face::new("init", &[pointer], None), |w, b, args| {
            let from = w.data(b, start);
            copy(b, args[0], from, n);
            None
        })?;
        let size = if self.unit.whole { self.kept() } else { self.kept() + 8 * n };
        self.function(Face::new("size", &[], Some(pointer)), |_, b, _| Some(b.ins().iconst(pointer, size)))?;
        self.function(Face::new("save", &[pointer, pointer], None), |_, b, args| {
            copy(b, args[1], args[0], n);
            None
        })?;
        self.function(Face::new("restore", &[pointer, pointer], None), |_, b, args| {
            copy(b, args[0], args[1], n);
            None
        })
    }

    /// Goes an interval on.
    fn commit_function(&mut self, commit: Callee) -> Made<()> {
        let pointer = self.module.target_config().pointer_type();
        let kept = self.kept();
        self.function(Face::new("commit", &[pointer, pointer], Some(types::I32)), |w, b, args| {
            if w.unit.whole {
                return Some(w.run(b, commit, args[0], &[(Memory::Input, args[1])]));
            }
            let backup = b.ins().iadd_imm_u(args[0], kept);
            let unit = w.unit;
            let some = |b: &mut FunctionBuilder<'_>, to: ir::Value, from: ir::Value| {
                for r in early(unit) {
                    let [to, from] = [to, from].map(|x| b.ins().iadd_imm_u(x, 8 * r.start as i64));
                    copy(b, to, from, r.len() as i64);
                }
            };
            some(b, backup, args[0]);
            let failed = w.run(b, commit, args[0], &[(Memory::Input, args[1])]);
            let (good, back, end) = (b.create_block(), b.create_block(), b.create_block());
            b.ins().brif(failed, back, &[] as &[BlockArg], good, &[] as &[BlockArg]);
            b.switch_to_block(back);
            some(b, args[0], backup);
            b.ins().jump(end, &[] as &[BlockArg]);
            b.switch_to_block(good);
            for late in &w.unit.late {
                let [to, from] = [late.state.start, late.next].map(|at| b.ins().iadd_imm_u(args[0], 8 * at as i64));
                copy(b, to, from, late.state.len() as i64);
            }
            b.ins().jump(end, &[] as &[BlockArg]);
            b.switch_to_block(end);
            Some(failed)
        })
    }

    /// Goes several intervals on.
    fn run_function(&mut self, many: Callee) -> Made<()> {
        let pointer = self.module.target_config().pointer_type();
        self.function(Face::new("run", &[pointer, types::I64], Some(types::I32)), |w, b, args| {
            let room = b.create_sized_stack_slot(StackSlotData::new(StackSlotKind::ExplicitSlot, 16, 3));
            let most = b.ins().stack_addr(pointer, room, 0);
            let gone = b.ins().iadd_imm_u(most, 8);
            let count = b.ins().fcvt_from_uint(types::F64, args[1]);
            b.ins().store(MemFlagsData::trusted(), count, most, 0);
            let given = [(Memory::Input, most), (Memory::Output, gone)];
            let failed = w.run(b, many, args[0], &given);
            let (back, end) = (b.create_block(), b.create_block());
            b.ins().brif(failed, back, &[] as &[BlockArg], end, &[] as &[BlockArg]);
            b.switch_to_block(back);
            let done = load(b, gone, 0);
            b.ins().store(MemFlagsData::trusted(), done, most, 0);
            w.run(b, many, args[0], &given);
            b.ins().jump(end, &[] as &[BlockArg]);
            b.switch_to_block(end);
            Some(failed)
        })
    }

    /// Gives probes, what ports hold, the time, and what is stored and booked.
    fn reading_functions(&mut self, observe: Callee) -> Made<()> {
        let pointer = self.module.target_config().pointer_type();
        self.function(Face::new("probes", &[pointer, pointer], Some(types::I32)), |w, b, args| {
            Some(w.run(b, observe, args[0], &[(Memory::Output, args[1])]))
        })?;
        self.function(Face::new("output", &[pointer, pointer], None), |w, b, args| {
            for (k, o) in w.unit.open.iter().enumerate() {
                let x = load(b, args[0], o.at);
                let x = if o.sign < 0.0 { b.ins().fneg(x) } else { x };
                b.ins().store(MemFlagsData::trusted(), x, args[1], 8 * k as i32);
            }
            None
        })?;
        self.function(Face::new("time", &[pointer], Some(types::F64)), |w, b, args| {
            Some(load(b, args[0], w.unit.time))
        })?;
        self.function(Face::new("energy", &[pointer], Some(types::F64)), |w, b, args| {
            let mut list = w.unit.regions.iter();
            let mut sum = match list.next() {
                Some(r) => load(b, args[0], r.at),
                None => b.ins().f64const(0.0),
            };
            for r in list {
                let x = load(b, args[0], r.at);
                sum = b.ins().fadd(sum, x);
            }
            Some(sum)
        })?;
        self.function(Face::new("ledger", &[pointer, types::I32, types::I32], Some(types::F64)), |w, b, args| {
            let zero = b.ins().iconst(types::I64, 0);
            let mut at = zero;
            for (k, r) in w.unit.regions.iter().enumerate() {
                let is = b.ins().icmp_imm_u(IntCC::Equal, args[1], k as i64);
                let own = b.ins().iconst(types::I64, r.at as i64);
                at = b.ins().select(is, own, at);
            }
            let there = within(b, args[1], w.unit.regions.len());
            let known = within(b, args[2], NAMES.len());
            let there = b.ins().band(there, known);
            let what = b.ins().uextend(types::I64, args[2]);
            let at = b.ins().iadd(at, what);
            let at = b.ins().select(there, at, zero);
            let at = b.ins().imul_imm_u(at, 8);
            let place = b.ins().iadd(args[0], at);
            let (x, none) = (load(b, place, 0), b.ins().f64const(f64::NAN));
            Some(b.ins().select(there, x, none))
        })
    }

    /// Sets an input.
    fn input_function(&mut self) -> Made<()> {
        let pointer = self.module.target_config().pointer_type();
        self.function(Face::new("input", &[pointer, types::I32, types::F64], None), |w, b, args| {
            let first = w.unit.inputs.first()?;
            let there = within(b, args[1], w.unit.inputs.len());
            let (which, zero) = (b.ins().uextend(types::I64, args[1]), b.ins().iconst(types::I64, 0));
            let which = b.ins().select(there, which, zero);
            let which = b.ins().imul_imm_u(which, 8);
            let place = b.ins().iadd(args[0], which);
            let before = load(b, place, first.at);
            let x = b.ins().select(there, args[2], before);
            b.ins().store(MemFlagsData::trusted(), x, place, 8 * first.at as i32);
            None
        })
    }

    /// Constant numbers.
    fn numbers(&mut self, name: &str, list: &[f64]) -> Made<DataId> {
        self.constant(name, list.iter().flat_map(|x| x.to_ne_bytes()).collect())
    }

    /// Constants.
    fn constant(&mut self, name: &str, mut bytes: Vec<u8>) -> Made<DataId> {
        let id = self.module.declare_data(&format!("{}_{name}_", self.prefix), Linkage::Local, false, false)?;
        let mut data = DataDescription::new();
        bytes.resize(bytes.len().max(8), 0);
        data.define(bytes.into_boxed_slice());
        data.set_align(8);
        self.module.define_data(id, &data)?;
        Ok(id)
    }

    /// The address of constant numbers.
    fn data(&mut self, b: &mut FunctionBuilder<'_>, id: DataId) -> ir::Value {
        let pointer = self.module.target_config().pointer_type();
        let global = self.module.declare_data_in_func(id, b.func);
        b.ins().symbol_value(pointer, global)
    }

    /// Runs a routine on a state, with some of its other memories given.
    fn run(
        &mut self,
        b: &mut FunctionBuilder<'_>,
        callee: Callee,
        state: ir::Value,
        given: &[(Memory, ir::Value)],
    ) -> ir::Value {
        let pointer = self.module.target_config().pointer_type();
        let none = b.ins().iconst(pointer, 0);
        let report = b.create_sized_stack_slot(StackSlotData::new(StackSlotKind::ExplicitSlot, REPORT, 3));
        let report = b.ins().stack_addr(pointer, report, 0);
        let [table, data, tables] = [callee.constants, callee.data, callee.tables].map(|id| self.data(b, id));
        let scratch = b.ins().iadd_imm_u(state, 8 * (self.unit.image.len() + callee.scratch) as i64);
        let mut args: Vec<ir::Value> = Memory::ALL
            .into_iter()
            .map(|m| match m {
                Memory::State => state,
                Memory::Table => table,
                Memory::Scratch => scratch,
                Memory::Data => data,
                Memory::Input | Memory::Next | Memory::Output => given.iter().find(|g| g.0 == m).map_or(none, |g| g.1),
            })
            .collect();
        args.extend([report, none, tables]);
        let f = self.module.declare_func_in_func(callee.function, b.func);
        let call = b.ins().call(f, &args);
        b.inst_results(call)[0]
    }

    /// Defines a public function.
    fn function(
        &mut self,
        face: Face<'_>,
        write: impl FnOnce(&mut Self, &mut FunctionBuilder<'_>, &[ir::Value]) -> Option<ir::Value>,
    ) -> Made<()> {
        let mut signature = self.module.make_signature();
        signature.params = face.params.into_iter().map(AbiParam::new).collect();
        signature.returns = face.gives.into_iter().map(AbiParam::new).collect();
        let name = format!("{}_{}", self.prefix, face.name);
        let id = self.module.declare_function(&name, Linkage::Export, &signature)?;
        let mut context = self.module.make_context();
        context.func.signature = signature;
        let mut frontend = FunctionBuilderContext::new();
        let mut b = FunctionBuilder::new(&mut context.func, &mut frontend);
        let entry = b.create_block();
        b.append_block_params_for_function_params(entry);
        b.switch_to_block(entry);
        let args = b.block_params(entry).to_vec();
        let result = write(self, &mut b, &args);
        b.ins().return_(result.as_slice());
        b.seal_all_blocks();
        let config = self.module.target_config();
        b.finalize(config);
        Ok(self.module.define_function(id, &mut context)?)
    }
}

/// A number of the state.
fn load(b: &mut FunctionBuilder<'_>, state: ir::Value, at: usize) -> ir::Value {
    b.ins().load(types::F64, MemFlagsData::trusted(), state, 8 * at as i32)
}

/// Whether a C int is one of the numbers below `n`.
fn within(b: &mut FunctionBuilder<'_>, x: ir::Value, n: usize) -> ir::Value {
    b.ins().icmp_imm_u(IntCC::UnsignedLessThan, x, n as i64)
}

/// Copies `n` numbers.
fn copy(b: &mut FunctionBuilder<'_>, to: ir::Value, from: ir::Value, n: i64) {
    let i = b.declare_var(types::I64);
    let zero = b.ins().iconst(types::I64, 0);
    b.def_var(i, zero);
    let (head, end) = (b.create_block(), b.create_block());
    b.ins().jump(head, &[] as &[BlockArg]);
    b.switch_to_block(head);
    let at = b.use_var(i);
    let (source, target) = (b.ins().iadd(from, at), b.ins().iadd(to, at));
    let x = b.ins().load(types::F64, MemFlagsData::trusted(), source, 0);
    b.ins().store(MemFlagsData::trusted(), x, target, 0);
    let at = b.ins().iadd_imm_u(at, 8);
    b.def_var(i, at);
    let more = b.ins().icmp_imm_u(IntCC::UnsignedLessThan, at, 8 * n);
    b.ins().brif(more, head, &[] as &[BlockArg], end, &[] as &[BlockArg]);
    b.switch_to_block(end);
}
