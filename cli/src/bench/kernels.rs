//! Programs that are compiled once and run by many simulations, with or without a deadline.

use super::clock;
use bond_runtime::ir::Program;
use bond_runtime::kernel::{Backend, Failure, Kernel, Workspace};
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Runs of a program between two readings of the clock.
const RUNS_PER_LOOK: u32 = 256;

/// The compiled programs of scenes that differ in their steppers: what these have in common is compiled once.
pub struct Kernels<'a> {
    backend: &'a dyn Backend,
    list: RefCell<Vec<Arc<dyn Kernel>>>,
}

impl<'a> Kernels<'a> {
    /// None yet.
    pub fn new(backend: &'a dyn Backend) -> Self {
        Self { backend, list: RefCell::new(Vec::new()) }
    }

    fn get(&self, program: &Program) -> Arc<dyn Kernel> {
        let mut list = self.list.borrow_mut();
        if let Some(kernel) = list.iter().find(|k| k.program() == program) {
            return kernel.clone();
        }
        let kernel: Arc<dyn Kernel> = Arc::from(self.backend.kernel(program));
        list.push(kernel.clone());
        kernel
    }
}

impl Backend for Kernels<'_> {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        Box::new(Shared(self.get(program)))
    }
}

/// A program that others run too.
struct Shared(Arc<dyn Kernel>);

impl Kernel for Shared {
    fn program(&self) -> &Program {
        self.0.program()
    }

    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure> {
        self.0.run(state, input, table, work)
    }

    fn workspace(&self) -> Workspace {
        self.0.workspace()
    }
}

/// The deadline of a run.
pub struct Guard {
    /// Processor time of the thread that runs, s, as bits.
    deadline: AtomicU64,
    calls: AtomicU32,
    late: AtomicBool,
}

impl Guard {
    /// Without end yet.
    pub fn new() -> Arc<Self> {
        let deadline = AtomicU64::new(f64::INFINITY.to_bits());
        Arc::new(Self { deadline, calls: AtomicU32::new(0), late: AtomicBool::new(false) })
    }

    /// Gives the run this much processor time from now on, s.
    pub fn begin(&self, time: f64) {
        self.deadline.store((clock::now() + time).to_bits(), Ordering::Relaxed);
    }

    /// Whether the time is over.
    pub fn late(&self) -> bool {
        self.late.load(Ordering::Relaxed)
    }

    fn look(&self) -> bool {
        let calls = self.calls.load(Ordering::Relaxed).wrapping_add(1);
        self.calls.store(calls, Ordering::Relaxed);
        if calls.is_multiple_of(RUNS_PER_LOOK) && clock::now() > f64::from_bits(self.deadline.load(Ordering::Relaxed)) {
            self.late.store(true, Ordering::Relaxed);
        }
        self.late()
    }
}

/// The programs of a scene, which fail when the time is over, so that the run ends.
pub struct Guarded<'a>(pub &'a Kernels<'a>, pub Arc<Guard>);

impl Backend for Guarded<'_> {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        Box::new(Watched(self.0.get(program), self.1.clone()))
    }
}

struct Watched(Arc<dyn Kernel>, Arc<Guard>);

impl Kernel for Watched {
    fn program(&self) -> &Program {
        self.0.program()
    }

    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure> {
        if self.1.look() {
            return Err(Failure::NoConvergence { iterations: 0, unknown: 0, change: f64::NAN });
        }
        self.0.run(state, input, table, work)
    }

    fn workspace(&self) -> Workspace {
        self.0.workspace()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bond_runtime::interpreter::Interpret;
    use bond_runtime::ir::{Array, Builder};
    use std::cell::Cell;

    /// Counts what it compiles.
    #[derive(Default)]
    struct Counting(Cell<u32>);

    impl Backend for Counting {
        fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
            self.0.set(self.0.get() + 1);
            Interpret.kernel(program)
        }
    }

    fn program(x: f64) -> Program {
        let mut b = Builder::new("test");
        let (to, x) = (b.slot(Array::Output), b.number(x));
        b.store(to, x);
        b.finish()
    }

    #[test]
    fn each_program_is_compiled_once() {
        let counting = Counting::default();
        let kernels = Kernels::new(&counting);
        // Also one that has no number in it, which is not even like itself.
        for x in [1.0, f64::NAN, 1.0, f64::NAN] {
            kernels.kernel(&program(x));
            Guarded(&kernels, Guard::new()).kernel(&program(x));
        }
        assert_eq!(counting.0.get(), 2);
        // 1/0 and 1/-0 are not alike.
        kernels.kernel(&program(0.0));
        kernels.kernel(&program(-0.0));
        assert_eq!(counting.0.get(), 4);
    }
}
