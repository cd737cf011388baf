//! Programs that are compiled once and run by many simulations of one scene, with or without an eye on the time.

use super::clock;
use bond_runtime::ir::Program;
use bond_runtime::kernel::{Backend, Failure, Kernel, Workspace};
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Runs of a program between two looks at the clock.
const LOOK: u32 = 256;

/// The compiled programs of a scene.
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

/// Until when a run may go on.
pub struct Guard {
    /// Processor time of the thread that runs, s.
    deadline: f64,
    calls: AtomicU32,
    late: AtomicBool,
}

impl Guard {
    /// A run that may compute for so long from now, s.
    pub fn new(time: f64) -> Arc<Self> {
        Arc::new(Self { deadline: clock::now() + time, calls: AtomicU32::new(0), late: AtomicBool::new(false) })
    }

    /// Whether the time is over.
    pub fn late(&self) -> bool {
        self.late.load(Ordering::Relaxed)
    }

    fn look(&self) -> bool {
        let calls = self.calls.load(Ordering::Relaxed).wrapping_add(1);
        self.calls.store(calls, Ordering::Relaxed);
        if calls.is_multiple_of(LOOK) && clock::now() > self.deadline {
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
