//! Machine code in memory. The one file with `unsafe`: calling what was compiled, and giving its memory back.
#![expect(
    unsafe_code,
    reason = "compiled code is called through a pointer, and reads and writes memory through pointers"
)]

use super::functions::{self, SOLVE, TWO};
use super::translate::{REPORT, define};
use crate::backend::code::{Reason, Routine};
use crate::backend::standalone::{self, BlockConstants};
use crate::backend::{is_large, lower};
use bond_runtime::interpreter::Interpreter;
use bond_runtime::ir::{Array, Program, Unary};
use bond_runtime::kernel::{Backend, Failure, Kernel, Workspace};
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{self, BlockRoutine, Options, Places, Start};
use bond_runtime::solve::iteration::UNDETERMINED;
use bond_runtime::solve::linear;
use cranelift_codegen::settings::{self, Configurable};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{Linkage, default_libcall_names};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Statements in a function at most: above, compiling takes longer than it saves.
const MAX_STATEMENTS: usize = 30_000;

/// A scene is compiled as a whole after so many intervals: some milliseconds, at some 50 ns that each then takes less.
pub(super) const WORTH_INTERVALS: u64 = 40_000;

/// Compiles programs to machine code. A program that is too large, or has a form that machine code is not written for,
/// is interpreted; so is all on a machine that Cranelift does not know. Equal ones, as of regions that differ in name
/// alone, are compiled once, as long as one of them is in use.
pub static JIT: Jit = Jit::new();

/// What [`JIT`] is.
#[derive(Default)]
pub struct Jit {
    made: Mutex<Vec<Known>>,
}

/// A program without its names, with its code and the data of that.
struct Known {
    program: Program,
    code: Weak<Code>,
    data: Vec<f64>,
}

impl Jit {
    /// Nothing compiled yet.
    pub const fn new() -> Self {
        Self { made: Mutex::new(Vec::new()) }
    }

    /// How many programs it knows that may be in use.
    pub fn shapes(&self) -> usize {
        self.made.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    fn compiled(&self, program: &Program) -> Option<Compiled> {
        let fresh = || {
            let mut routine = lower(program)?;
            let data = std::mem::take(&mut routine.data);
            Some((Arc::new(Code::new(routine)?), data))
        };
        if is_large(program) {
            let (code, data) = fresh()?;
            return Some(Compiled::of(program, code, data));
        }
        let nameless = Program { name: String::new(), names: Vec::new(), ..program.clone() };
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let known = made.iter().find(|m| m.program == nameless).and_then(|m| Some((m.code.upgrade()?, m.data.clone())));
        if let Some((code, data)) = known {
            return Some(Compiled::of(program, code, data));
        }
        made.retain(|m| m.code.strong_count() > 0);
        let (code, data) = fresh()?;
        made.push(Known { program: nameless, code: Arc::downgrade(&code), data: data.clone() });
        Some(Compiled::of(program, code, data))
    }
}

impl Backend for Jit {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        match self.compiled(program) {
            Some(compiled) => Box::new(compiled),
            None => Box::new(Interpreter::new(program)),
        }
    }

    fn block_maker(&self) -> Option<simulate::BlockMaker> {
        let make = |scene: &Scene, options: &Options, start: &Start| -> Option<Box<dyn BlockRoutine>> {
            let standalone::BlockProgram { mut run, places, table } =
                standalone::block_program(scene, options, start, false)?;
            let own = BlockConstants { places, table, data: std::mem::take(&mut run.data) };
            Some(Box::new(Whole::new(Arc::new(Code::new(run)?), own)))
        };
        Some(simulate::BlockMaker { make: Arc::new(make), worth: WORTH_INTERVALS })
    }
}

/// The signature of a compiled function; see [`define`].
type Function = extern "C" fn(
    *mut f64,
    *const f64,
    *const f64,
    *mut f64,
    *mut f64,
    *mut f64,
    *const f64,
    *mut f64,
    *mut Vec<linear::System>,
    *const u32,
) -> i32;

/// A routine as machine code, without its data.
pub(super) struct Code {
    function: Function,
    scratch: usize,
    systems: Vec<linear::System>,
    tables: Vec<u32>,
    /// Owns the code; taken out when it is freed.
    module: Option<JITModule>,
}

impl Code {
    pub(super) fn new(routine: Routine) -> Option<Self> {
        if routine.size() > MAX_STATEMENTS {
            return None;
        }
        let mut flags = settings::builder();
        for (name, value) in [("opt_level", "speed"), ("enable_verifier", "false"), ("is_pic", "false")] {
            flags.set(name, value).ok()?;
        }
        let isa = cranelift_native::builder().ok()?.finish(settings::Flags::new(flags)).ok()?;
        let mut builder = JITBuilder::with_isa(isa, default_libcall_names());
        for f in Unary::ALL {
            if let Some(name) = functions::unary(f) {
                builder.symbol(name, f.address() as *const u8);
            }
        }
        for (op, f) in TWO {
            builder.symbol(functions::binary(*op)?, *f as *const u8);
        }
        builder.symbol(functions::SIN_COS, functions::sin_cos as *const u8);
        builder.symbol(SOLVE, solve as *const u8);
        let mut module = JITModule::new(builder);
        let id = define(&mut module, "step", &routine, Linkage::Export, |name| name, cfg!(unix)).ok()?;
        module.finalize_definitions().ok()?;
        let code = module.get_finalized_function(id);
        // SAFETY: `define` gives the function this signature, in the platform's C convention, which `extern "C"` is
        // too.
        let function = unsafe { std::mem::transmute::<*const u8, Function>(code) };
        let systems = routine.systems.iter().map(|s| linear::System::new(s.n, s.pattern.clone(), s.matrix)).collect();
        let scratch = routine.scratch as usize;
        Some(Self { function, scratch, systems, tables: routine.tables, module: Some(module) })
    }
}

// SAFETY: the code is never written after it was made, and the module is touched again only when it is dropped.
unsafe impl Send for Code {}
// SAFETY: as above; who calls it reads this and writes memory of his own.
unsafe impl Sync for Code {}

impl Drop for Code {
    fn drop(&mut self) {
        if let Some(module) = self.module.take() {
            // SAFETY: `function` is not called any more, and no other pointer into the code exists.
            unsafe { module.free_memory() };
        }
    }
}

/// A program as machine code.
pub(super) struct Compiled {
    program: Program,
    code: Arc<Code>,
    data: Vec<f64>,
}

impl Compiled {
    /// With code and data that were made for it.
    pub(super) fn of(program: &Program, code: Arc<Code>, data: Vec<f64>) -> Self {
        Self { program: program.clone(), code, data }
    }
}

impl Kernel for Compiled {
    fn program(&self) -> &Program {
        &self.program
    }

    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure> {
        let size = |a: Array| self.program.size(a);
        assert!(
            state.len() >= size(Array::State)
                && input.len() >= size(Array::Input)
                && table.len() >= size(Array::Table)
                && work.next.len() >= size(Array::Next)
                && work.output.len() >= size(Array::Output)
                && work.registers.len() >= self.code.scratch
                && work.systems.len() == self.code.systems.len(),
            "slices are as long as the program's arrays"
        );
        let mut report = [0.0; REPORT as usize / 8];
        // The function reads and writes the arrays within the sizes that were just asserted, which the program's
        // verifier and `lower` keep to; `report` has the places that it writes; the systems are those it was compiled
        // with.
        let code = (self.code.function)(
            state.as_ptr().cast_mut(), // read only, as `lower` writes it
            input.as_ptr(),
            table.as_ptr(),
            work.next.as_mut_ptr(),
            work.output.as_mut_ptr(),
            work.registers.as_mut_ptr(),
            self.data.as_ptr(),
            report.as_mut_ptr(),
            &raw mut work.systems,
            self.code.tables.as_ptr(),
        );
        work.newton_iterations += report[0] as u64;
        match i64::from(code) {
            Reason::NO_CONVERGENCE => Err(Failure::NoConvergence {
                iterations: report[1] as u32,
                unknown: report[2] as usize,
                change: report[3],
            }),
            Reason::SINGULAR => Err(Failure::Singular { row: report[1] as usize }),
            Reason::NOT_FINITE => match work.check() {
                Err(e) => Err(e),
                Ok(()) => Ok(()),
            },
            _ => Ok(()),
        }
    }

    fn workspace(&self) -> Workspace {
        let mut work = Workspace::new(&self.program, &[], self.code.scratch);
        work.systems.clone_from(&self.code.systems);
        work
    }
}

/// A scene as machine code that goes through many intervals.
pub(super) struct Whole {
    code: Arc<Code>,
    own: BlockConstants,
    scratch: Vec<f64>,
    systems: Vec<linear::System>,
}

impl Whole {
    /// With code and numbers that were made for it.
    pub(super) fn new(code: Arc<Code>, own: BlockConstants) -> Self {
        let (scratch, systems) = (vec![0.0; code.scratch], code.systems.clone());
        Self { code, own, scratch, systems }
    }

    /// Goes on; how many intervals it went, whether it went all, and the notes.
    fn go(&mut self, block: &mut [f64], intervals: u64, notes: &mut [f64]) -> (u64, bool, usize) {
        let (most, mut gone, mut report) = ([intervals as f64], [0.0], [0.0; REPORT as usize / 8]);
        // The routine reads and writes the block, its table and scratch within their sizes, which `unit` lays out, its
        // one input and its one output; `report` has the places that it writes; who calls makes room for as many notes
        // as intervals can leave.
        let failed = (self.code.function)(
            block.as_mut_ptr(),
            most.as_ptr(),
            self.own.table.as_ptr(),
            notes.as_mut_ptr(),
            gone.as_mut_ptr(),
            self.scratch.as_mut_ptr(),
            self.own.data.as_ptr(),
            report.as_mut_ptr(),
            &raw mut self.systems,
            self.code.tables.as_ptr(),
        );
        (gone[0] as u64, failed == 0, report[4].to_bits() as usize / 32)
    }
}

impl BlockRoutine for Whole {
    fn places(&self) -> &Places {
        &self.own.places
    }

    fn run(&mut self, block: &mut [f64], intervals: u64, notes: &mut [f64]) -> (u64, usize) {
        let each = self.own.places.notes() as usize;
        let intervals = intervals.min((notes.len() / (4 * each.max(1))) as u64);
        assert!(block.len() >= self.own.places.image.len(), "the block is as long as its image");
        let (gone, good, noted) = self.go(block, intervals, notes);
        if good {
            return (gone, noted);
        }
        // The block is what it was: once more, without the interval that failed.
        let (gone, _, noted) = self.go(block, gone, notes);
        (gone, noted)
    }
}

/// Solves a large system for compiled code: -1, [`UNDETERMINED`], or the row without a pivot. `same` is not 0 where the
/// matrix is that of the last time.
extern "C" fn solve(
    systems: *mut Vec<linear::System>,
    which: usize,
    matrix: *const f64,
    vector: *mut f64,
    same: f64,
) -> f64 {
    // SAFETY: compiled code hands on the pointer that `run` gave it, and numbers of systems of the routine it was made
    // from.
    let Some(system) = (unsafe { &mut *systems }).get_mut(which) else { return 0.0 };
    let (entries, n) = (system.entries(), system.size());
    // SAFETY: `lower` reserves so many numbers of the scratch at these places, apart from one another.
    let (matrix, vector) =
        unsafe { (std::slice::from_raw_parts(matrix, entries), std::slice::from_raw_parts_mut(vector, n)) };
    match system.solve(matrix, vector, same != 0.0) {
        Ok(false) => -1.0,
        Ok(true) => UNDETERMINED,
        Err(row) => row as f64,
    }
}
