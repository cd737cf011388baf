//! The interpreter, until it has run so often: scenes and states that bytes make may ask for more steps than will ever
//! be taken.

use bond_runtime::interpreter::Interpret;
use bond_runtime::ir::{Array, Program, Slot};
use bond_runtime::kernel::{Backend, Failure, Kernel, Workspace};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Runs of programs that a simulation has.
const RUNS: u64 = 3000;

/// A back end whose kernels fail after so many runs of them all.
pub struct Limited(Arc<AtomicU64>);

impl Default for Limited {
    fn default() -> Self {
        Self(Arc::new(AtomicU64::new(RUNS)))
    }
}

impl Limited {
    /// Whether that was so.
    pub fn is_over(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

struct Limit {
    inner: Box<dyn Kernel>,
    left: Arc<AtomicU64>,
}

impl Backend for Limited {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        Box::new(Limit { inner: Interpret.kernel(program), left: self.0.clone() })
    }
}

impl Kernel for Limit {
    fn program(&self) -> &Program {
        self.inner.program()
    }

    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure> {
        let left = self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1));
        left.map_err(|_| Failure::NotFinite { slot: Slot::new(Array::Next, 0) })?;
        self.inner.run(state, input, table, work)
    }

    fn workspace(&self) -> Workspace {
        self.inner.workspace()
    }
}
