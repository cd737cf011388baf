//! WebAssembly: a unit as a module that needs nothing but a host's functions of numbers, which in JavaScript are those
//! of `Math`. One instance is one scene: its memory holds the state.
//!
//! Source: WebAssembly Core Specification, version 2.0.

mod print;

use super::code::{Memory, Routine};
use super::emitter::{Emitted, Emitter, Request};
use super::lower::{Solvers, with_solvers};
use super::standalone::{NAMES, StandaloneModule};
use bond_runtime::scene::Scene;
use rustc_hash::FxHashMap;
use serde_json::{Value, json};
use std::borrow::Cow;
use wasm_encoder::{
    BlockType, CodeSection, ConstExpr, CustomSection, DataSection, EntityType, ExportKind, ExportSection, Function,
    FunctionSection, GlobalSection, GlobalType, ImportSection, Instruction as I, MemArg, MemorySection, MemoryType,
    Module, TypeSection, ValType,
};

/// Modules.
pub const EMITTER: Emitter = Emitter {
    name: "wasm",
    about: "A WebAssembly module for browsers and other hosts",
    extension: "wasm",
    has_header: false,
    emit,
};

fn emit(r: &Request<'_>) -> Result<Emitted, String> {
    let module = module(r.scene, r.unit)?;
    let size = format!("{} kB", module.len().div_ceil(1000));
    Ok(Emitted::File(module, size))
}

/// Where things are in the memory, in bytes.
struct Places {
    /// Constants: the state at the start, then the numbers and tables of each routine.
    start: u64,
    table: u64,
    data: Vec<u64>,
    tables: Vec<u64>,
    /// What changes.
    state: u64,
    scratch: u64,
    observe_scratch: u64,
    /// What the interval began with, to be put back where it fails.
    backup: u64,
    moved: u64,
    held: u64,
    probed: u64,
    /// How many intervals to go, and how many are gone.
    most: u64,
    gone: u64,
    end: u64,
}

impl Places {
    fn new(unit: &StandaloneModule, routines: &[&Routine]) -> Self {
        let mut at = 16;
        let mut take = |n: usize| {
            let from = at;
            at += 8 * n as u64;
            from
        };
        let start = take(unit.kept);
        let table = take(unit.table.len());
        let data = routines.iter().map(|r| take(r.data.len())).collect();
        let tables = routines.iter().map(|r| take(r.tables.len().div_ceil(2))).collect();
        let state = take(unit.image.len());
        let scratch = take(unit.scratch);
        let observe_scratch = scratch + 8 * unit.observe_scratch as u64;
        let backup = take(if unit.whole { 0 } else { unit.kept });
        let (moved, held) = (take(unit.open.len()), take(unit.open.len()));
        let probed = take(unit.probes.len());
        let (most, gone) = (take(1), take(1));
        Self {
            start,
            table,
            data,
            tables,
            state,
            scratch,
            observe_scratch,
            backup,
            moved,
            held,
            probed,
            most,
            gone,
            end: take(0),
        }
    }

    /// The memories of a routine: of [`StandaloneModule::commit`], [`StandaloneModule::observe`] and
    /// [`StandaloneModule::run`], in this order.
    fn of(&self, routine: usize) -> impl Fn(Memory) -> u64 + '_ {
        move |m| match m {
            Memory::State | Memory::Next => self.state,
            Memory::Input => [self.moved, self.moved, self.most][routine],
            Memory::Output => [self.probed, self.probed, self.gone][routine],
            Memory::Table => self.table,
            Memory::Scratch => [self.scratch, self.observe_scratch, self.scratch][routine],
            Memory::Data => self.data[routine],
        }
    }
}

/// Types of functions, in the order of the module.
#[derive(Clone, Copy)]
enum Type {
    GivesNothing,
    GivesStatus,
    GivesNumber,
    OfOne,
    OfTwo,
    Sets,
    Goes,
    Books,
}

impl Type {
    const ALL: [Type; 8] = [
        Type::GivesNothing,
        Type::GivesStatus,
        Type::GivesNumber,
        Type::OfOne,
        Type::OfTwo,
        Type::Sets,
        Type::Goes,
        Type::Books,
    ];

    /// What it takes and gives.
    fn parts(self) -> (&'static [ValType], &'static [ValType]) {
        match self {
            Type::GivesNothing => (&[], &[]),
            Type::GivesStatus => (&[], &[ValType::I32]),
            Type::GivesNumber => (&[], &[ValType::F64]),
            Type::OfOne => (&[ValType::F64], &[ValType::F64]),
            Type::OfTwo => (&[ValType::F64, ValType::F64], &[ValType::F64]),
            Type::Sets => (&[ValType::I32, ValType::F64], &[]),
            Type::Goes => (&[ValType::I32], &[ValType::I32]),
            Type::Books => (&[ValType::I32, ValType::I32], &[ValType::F64]),
        }
    }
}

/// The module of a scene's unit.
///
/// # Errors
/// In words: memory or code beyond what machines take.
pub fn module(scene: &Scene, unit: &StandaloneModule) -> Result<Vec<u8>, String> {
    let routines = [&unit.commit, &unit.observe].into_iter().chain(&unit.run);
    let routines: Vec<Routine> = routines.map(|r| with_solvers(r.clone(), Solvers::All)).collect();
    let routines: Vec<&Routine> = routines.iter().collect();
    let places = Places::new(unit, &routines);
    if places.end > 1 << 31 {
        return Err("this scene does not fit into the memory of a module: take --emit c".into());
    }
    let imported = print::imported(&routines);
    let mut functions: FxHashMap<&'static str, u32> = FxHashMap::default();
    let (mut module, mut types, mut imports) = (Module::new(), TypeSection::new(), ImportSection::new());
    for (params, results) in Type::ALL.map(Type::parts) {
        types.ty().function(params.iter().copied(), results.iter().copied());
    }
    for (name, arguments) in &imported {
        functions.insert(name, functions.len() as u32);
        imports.import(
            "Math",
            name,
            EntityType::Function(if *arguments == 1 { Type::OfOne } else { Type::OfTwo } as u32),
        );
    }
    let mut writer = Writer {
        functions: FunctionSection::new(),
        codes: CodeSection::new(),
        exports: ExportSection::new(),
        next: imports.len(),
    };
    functions.insert("sign", writer.function(Type::OfOne, sign()));
    functions.insert("inverse_scale", writer.function(Type::OfOne, inverse_scale()));
    if let Some(pow) = functions.get("pow") {
        let power = power(*pow);
        functions.insert("power", writer.function(Type::OfTwo, power));
    }
    let mut inner = Vec::new();
    for (k, r) in routines.iter().enumerate() {
        let printer = print::Printer { functions: &functions, memories: &places.of(k), tables: places.tables[k] };
        let body = print::function(r, &printer)
            .ok_or("this scene's interval is more code than machines take in a function of a module: take --emit c")?;
        inner.push(writer.function(Type::GivesStatus, body));
    }
    writer.interface(unit, &places, &inner);
    let mut globals = GlobalSection::new();
    let numbers = [
        ("state", places.state),
        ("saved", unit.kept as u64),
        ("moved", places.moved),
        ("held", places.held),
        ("probed", places.probed),
    ];
    for (name, x) in numbers {
        writer.exports.export(name, ExportKind::Global, globals.len());
        let constant = GlobalType { val_type: ValType::I32, mutable: false, shared: false };
        globals.global(constant, &ConstExpr::i32_const(x as i32));
    }
    writer.exports.export("memory", ExportKind::Memory, 0);
    let mut memories = MemorySection::new();
    let pages = places.end.div_ceil(1 << 16);
    memories.memory(MemoryType { minimum: pages, maximum: None, memory64: false, shared: false, page_size_log2: None });
    let mut data = DataSection::new();
    let bytes = |list: &[f64]| list.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut put = |at: u64, bytes: Vec<u8>| {
        if !bytes.is_empty() {
            data.active(0, &ConstExpr::i32_const(at as i32), bytes);
        }
    };
    put(places.start, bytes(&unit.image[..unit.kept]));
    put(places.state, bytes(&unit.image[..unit.kept]));
    put(places.table, bytes(&unit.table));
    for (k, r) in routines.iter().enumerate() {
        put(places.data[k], bytes(&r.data));
        put(places.tables[k], r.tables.iter().flat_map(|x| x.to_le_bytes()).collect());
    }
    module.section(&types).section(&imports).section(&writer.functions).section(&memories).section(&globals);
    module.section(&writer.exports).section(&writer.codes).section(&data);
    let about = about(scene, unit).to_string();
    module.section(&CustomSection { name: Cow::Borrowed("bond"), data: Cow::Borrowed(about.as_bytes()) });
    Ok(module.finish())
}

/// What is in the module, for programs that use it: the section `bond`.
fn about(scene: &Scene, unit: &StandaloneModule) -> Value {
    let ports = scene.open.iter().zip(&unit.open).map(|(o, p)| {
        let (gives, takes) = if o.takes_flow { ("e", "f") } else { ("f", "e") };
        json!({ "name": o.name, "gives": gives, "unit": o.unit, "takes": takes, "moved": o.moved, "held": p.held })
    });
    let inputs = scene.inputs.iter().map(|i| json!({ "name": i.name, "unit": i.unit, "start": i.value }));
    let probes = scene.probes.names.iter().zip(&scene.probes.units).map(|(n, u)| json!({ "name": n, "unit": u }));
    json!({
        "name": unit.name,
        "interval": unit.interval,
        "ports": ports.collect::<Value>(),
        "inputs": inputs.collect::<Value>(),
        "probes": probes.collect::<Value>(),
        "regions": unit.regions.iter().map(|r| json!(r.name)).collect::<Value>(),
        "ledger": NAMES,
    })
}

/// A module's functions on their way.
struct Writer {
    functions: FunctionSection,
    codes: CodeSection,
    exports: ExportSection,
    next: u32,
}

/// Where a number of the state is.
fn number(at: u64) -> MemArg {
    print::place(at, 3)
}

/// A function of these instructions.
fn written(locals: &[(u32, ValType)], code: &[I<'_>]) -> Function {
    let mut f = Function::new(locals.iter().copied());
    code.iter().for_each(|i| {
        f.instruction(i);
    });
    f.instruction(&I::End);
    f
}

/// 1, -1 or 0, or what is no number.
fn sign() -> Function {
    let zero = || I::F64Const(0.0.into());
    let choose = |than: I<'static>, x: f64| {
        [I::LocalGet(0), zero(), than, I::If(BlockType::Empty), I::F64Const(x.into()), I::Return, I::End]
    };
    let code: Vec<I> = [choose(I::F64Gt, 1.0), choose(I::F64Lt, -1.0), choose(I::F64Eq, 0.0)].concat();
    written(&[], &[code, vec![I::LocalGet(0)]].concat())
}

/// `bond_runtime::eval::inverse_scale`, by the exponent's bits.
fn inverse_scale() -> Function {
    let exponent = || [I::LocalGet(0), I::I64ReinterpretF64, I::I64Const(52), I::I64ShrU];
    let bits = |exponent: i64| I::I64Const(exponent << 52);
    let code = [
        exponent().to_vec(),
        vec![I::LocalSet(1)],
        // 0, and what is not finite.
        vec![I::LocalGet(0), I::F64Const(0.0.into()), I::F64Eq],
        vec![I::LocalGet(1), I::I64Const(0x7ff), I::I64GeU, I::I32Or, I::If(BlockType::Empty)],
        vec![I::F64Const(1.0.into()), I::Return, I::End],
        // Subnormal numbers, and those whose scale would be one.
        vec![I::LocalGet(1), I::I64Eqz, I::If(BlockType::Empty), bits(2045), I::F64ReinterpretI64, I::Return, I::End],
        vec![I::LocalGet(1), I::I64Const(2046), I::I64Eq, I::If(BlockType::Empty)],
        vec![bits(1), I::F64ReinterpretI64, I::Return, I::End],
        vec![I::I64Const(2046), I::LocalGet(1), I::I64Sub, I::I64Const(52), I::I64Shl, I::F64ReinterpretI64],
    ];
    written(&[(1, ValType::I64)], &code.concat())
}

/// A power; that of 1, and an infinite one of -1, is 1, which `Math.pow` has otherwise.
fn power(pow: u32) -> Function {
    let one = || I::F64Const(1.0.into());
    written(
        &[],
        &[
            I::LocalGet(0),
            one(),
            I::F64Eq,
            I::LocalGet(0),
            I::F64Abs,
            one(),
            I::F64Eq,
            I::LocalGet(1),
            I::F64Abs,
            I::F64Const(f64::INFINITY.into()),
            I::F64Eq,
            I::I32And,
            I::I32Or,
            I::If(BlockType::Empty),
            one(),
            I::Return,
            I::End,
            I::LocalGet(0),
            I::LocalGet(1),
            I::Call(pow),
        ],
    )
}

impl Writer {
    /// Adds a function: its number.
    fn function(&mut self, of: Type, f: Function) -> u32 {
        self.functions.function(of as u32);
        self.codes.function(&f);
        self.next += 1;
        self.next - 1
    }

    /// Adds one that is seen from outside.
    fn public(&mut self, name: &str, of: Type, locals: &[(u32, ValType)], code: &[I<'_>]) {
        let at = self.function(of, written(locals, code));
        self.exports.export(name, ExportKind::Func, at);
    }

    /// What `backend/c/header.rs` declares; `inner` are the routines.
    fn interface(&mut self, unit: &StandaloneModule, places: &Places, inner: &[u32]) {
        let copy = |to: u64, from: u64, n: usize| {
            let [to, from, n] = [to, from, 8 * n as u64].map(|x| I::I32Const(x as i32));
            vec![to, from, n, I::MemoryCopy { src_mem: 0, dst_mem: 0 }]
        };
        let state = |at: usize| places.state + 8 * at as u64;
        let zero = || I::I32Const(0);
        let clear = [
            I::I32Const(places.state as i32),
            zero(),
            I::I32Const((places.most - places.state) as i32),
            I::MemoryFill(0),
        ];
        self.public(
            "init",
            Type::GivesNothing,
            &[],
            &[clear.to_vec(), copy(places.state, places.start, unit.kept)].concat(),
        );
        let mut commit = if unit.whole { Vec::new() } else { copy(places.backup, places.state, unit.kept) };
        commit.extend([I::Call(inner[0]), I::LocalTee(0), I::If(BlockType::Empty)]);
        if !unit.whole {
            commit.extend(copy(places.state, places.backup, unit.kept));
        }
        commit.push(I::Else);
        for late in &unit.late {
            commit.extend(copy(state(late.state.start), state(late.next), late.state.len()));
        }
        commit.extend([I::End, I::LocalGet(0)]);
        self.public("commit", Type::GivesStatus, &[(1, ValType::I32)], &commit);
        if let Some(many) = inner.get(2) {
            let run = [
                zero(),
                I::LocalGet(0),
                I::F64ConvertI32U,
                I::F64Store(number(places.most)),
                I::Call(*many),
                I::LocalTee(1),
                I::If(BlockType::Empty),
                // As many as were gone, again: a failure changes nothing.
                zero(),
                zero(),
                I::F64Load(number(places.gone)),
                I::F64Store(number(places.most)),
                I::Call(*many),
                I::Drop,
                I::End,
                I::LocalGet(1),
            ];
            self.public("run", Type::Goes, &[(1, ValType::I32)], &run);
        }
        self.public("probes", Type::GivesStatus, &[], &[I::Call(inner[1])]);
        let mut output = Vec::new();
        for (k, o) in unit.open.iter().enumerate() {
            output.extend([zero(), zero(), I::F64Load(number(state(o.at)))]);
            output.extend((o.sign < 0.0).then_some(I::F64Neg));
            output.push(I::F64Store(number(places.held + 8 * k as u64)));
        }
        self.public("output", Type::GivesNothing, &[], &output);
        self.public("time", Type::GivesNumber, &[], &[zero(), I::F64Load(number(state(unit.time)))]);
        let mut energy = Vec::new();
        for (k, r) in unit.regions.iter().enumerate() {
            energy.extend([zero(), I::F64Load(number(state(r.at)))]);
            energy.extend((k > 0).then_some(I::F64Add));
        }
        if energy.is_empty() {
            energy.push(I::F64Const(0.0.into()));
        }
        self.public("energy", Type::GivesNumber, &[], &energy);
        let mut ledger = Vec::new();
        for (k, r) in unit.regions.iter().enumerate() {
            ledger.extend([I::LocalGet(0), I::I32Const(k as i32), I::I32Eq]);
            ledger.extend([
                I::LocalGet(1),
                I::I32Const(NAMES.len() as i32),
                I::I32LtU,
                I::I32And,
                I::If(BlockType::Empty),
            ]);
            ledger.extend([
                I::LocalGet(1),
                I::I32Const(8),
                I::I32Mul,
                I::F64Load(number(state(r.at))),
                I::Return,
                I::End,
            ]);
        }
        ledger.push(I::F64Const(f64::NAN.into()));
        self.public("ledger", Type::Books, &[], &ledger);
        let mut input = Vec::new();
        if let Some(first) = unit.inputs.first() {
            input.extend([I::LocalGet(0), I::I32Const(unit.inputs.len() as i32), I::I32LtU, I::If(BlockType::Empty)]);
            input.extend([
                I::LocalGet(0),
                I::I32Const(8),
                I::I32Mul,
                I::LocalGet(1),
                I::F64Store(number(state(first.at))),
            ]);
            input.push(I::End);
        }
        self.public("input", Type::Sets, &[], &input);
    }
}
