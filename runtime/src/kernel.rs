//! What every back end offers: one program, ready to run.

pub use crate::failure::Failure;
use crate::ir::{Array, Program, Slot};
use crate::simulate;
use crate::solve::{linear, newton};

/// A program that runs.
///
/// A kernel is read only and may be shared by threads; what a run writes is in the [`Workspace`].
pub trait Kernel: Send + Sync {
    /// The program it runs.
    fn program(&self) -> &Program;

    /// Runs the program once. The results are in `work.next` and `work.output`.
    ///
    /// Allocates nothing, locks nothing, writes nothing but the workspace.
    ///
    /// # Errors
    /// Where an iteration that has no flag does not converge, or a number in `work.next` is not finite. What the
    /// workspace then holds means nothing; the state, which is only read, is what it was.
    ///
    /// # Panics
    /// Where a slice is shorter than the program's array of that name, or the workspace is another kernel's.
    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure>;

    /// Memory to run in. The only place that allocates.
    fn workspace(&self) -> Workspace;
}

/// What makes programs ready to run.
pub trait Backend {
    /// A program, ready to run. Where this back end cannot take it, another does it.
    ///
    /// # Panics
    /// Where the program does not pass [`Program::verify`].
    fn kernel(&self, program: &Program) -> Box<dyn Kernel>;

    /// Makes routines for block execution, where this back end has such.
    fn block_maker(&self) -> Option<simulate::BlockMaker> {
        None
    }
}

/// What a run works on besides its arguments. Nothing in it is read by the next run.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// The state at the end of the step.
    pub next: Vec<f64>,
    /// What the step reports.
    pub output: Vec<f64>,
    /// The program's scratch.
    pub local: Vec<f64>,
    /// Iterations of Newton's method so far, over all runs; set it to 0 at will.
    pub newton_iterations: u64,
    /// The back end's own numbers.
    pub registers: Vec<f64>,
    /// Memory of each iteration of the program, in order of appearance, an outer one before those inside it.
    pub newtons: Vec<newton::Scratch>,
    /// Systems that the back end leaves to [`linear`].
    pub systems: Vec<linear::System>,
}

impl Workspace {
    /// Memory for a program whose iterations have the plans given, with so many registers.
    pub fn new(program: &Program, plans: &[newton::Plan], registers: usize) -> Self {
        Self {
            next: vec![0.0; program.size(Array::Next)],
            output: vec![0.0; program.size(Array::Output)],
            local: vec![0.0; program.size(Array::Local)],
            newton_iterations: 0,
            registers: vec![0.0; registers],
            newtons: plans.iter().map(newton::Plan::scratch).collect(),
            systems: Vec::new(),
        }
    }

    /// Fails where a number in `next` is not finite.
    ///
    /// # Errors
    /// [`Failure::NotFinite`] with the first such slot.
    pub fn check(&self) -> Result<(), Failure> {
        // 0 times a number is 0 unless it is not finite: one pass without branches.
        let spoiled: f64 = self.next.iter().map(|x| 0.0 * x).sum();
        if spoiled == 0.0 {
            return Ok(());
        }
        match self.next.iter().position(|x| !x.is_finite()) {
            Some(index) => Err(Failure::NotFinite { slot: Slot::new(Array::Next, index) }),
            None => Ok(()),
        }
    }
}
