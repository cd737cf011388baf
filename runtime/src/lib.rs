//! What runs: step programs and their interpreter, solvers, sample and hold, the energy ledger, simulation.
//!
//! It knows nothing of text, graphs or symbols. The compiler hands over a [`Scene`](scene::Scene), and an executable
//! that `bond build` makes needs this crate alone.
//!
//! # From a scene to a ledger
//!
//! | module | does |
//! | --- | --- |
//! | [`scene`] | the compiled model: step programs per *cluster* (what steps together), schedule, ledger entries, probes |
//! | [`ir`] | step programs: instructions, the builder that writes them, the verifier |
//! | [`eval`] | the meaning of every scalar operation: `sign(0)`, `0/0`, `min` with NaN |
//! | [`kernel`] | the interface of a back end: a program, ready to run |
//! | [`interpreter`] | the back end that runs programs as they are |
//! | [`machine`] | the operations that code written once for numbers and for compiled statements may use |
//! | [`solve`] | Newton's method, dense and sparse elimination |
//! | [`history`] | what a signal was, as polynomials over steps: delays in continuous time |
//! | [`exponential`] | the matrix exponential in double-double arithmetic ([`double_double`]) |
//! | [`simulate`] | the schedule, adaptive steps, events, block execution, the summary |
//! | [`energy`] | accounts, held ports, predictions and the energy budget, on a [`machine`] |
//! | [`ledger`] | sums of energy with their rounding errors |
//! | [`envelope`] | values as bytes with a version and a checksum |
//!
//! # When an expression is evaluated
//!
//! A step program is straight code, without branches. Its meaning is that of running each instruction once, in order,
//! and the body of a Newton iteration as often as [`solve::newton`] asks. (That is twice in what counts as the first
//! iteration of few unknowns.) An operation has no effect and cannot fail. So a back end may skip, move or repeat it,
//! as long as all bits stay: the order of stores and loads, and of roundings (no fused multiply-add, no other order of
//! a sum). A value is evaluated
//!
//! - *before a run*, if it depends on no state, input, time or step length: the compiler folds it into a constant;
//! - *when a step length is new*, if it is an entry of a table (the matrices of `exact`). This may be in the middle of
//!   a run, and it allocates; a step of a known length allocates nothing;
//! - *once per step*, outside of an iteration;
//! - *in each iteration*, inside;
//! - *at a look*, in the program of the probes and in a cluster's `instant` (the output equations). A look changes no
//!   state.
//!
//! # What a program may assume
//!
//! - State `x`, inputs `u` and table `c` are only read. The inputs of a step are the time, the step length h, ports,
//!   signals of other clusters, what is given from outside, and traces of states. [`scene::Respond`],
//!   [`scene::Branch`] and [`scene::Probes`] say which others their programs get. The state has states, integrals,
//!   guesses, carries and the stepper's memory; [`scene::Cluster`] says it for each slot. Only `exact` has a table.
//! - Arrays never overlap.
//! - `w` is scratch with any content. A program writes a slot before it reads it; the verifier does not check this.
//! - The results, `n` (the next state) and `y` (what the step reports), are used only if the run returns `Ok`. A run
//!   fails at the first Newton iteration that does not converge, or linear system without a pivot, if neither it nor an
//!   iteration around it has a flag; or at the end, if a number of `n` is not finite. With a flag, the flag becomes 0,
//!   and the program goes on. After a failure nothing in the workspace counts.
//!
//! And what may be assumed of a program that [`ir::Program::verify`] accepts:
//!
//! - Each value is defined once, before its use, and every slot is inside its array. A value of an iteration's body is
//!   not used after the iteration.
//! - A product writes no slot that it reads. The unknowns, the rounding and the flag of an iteration are apart.
//! - Every slot of `n` is written exactly once, outside of iterations; nothing writes `x`, `u` or `c`.
//! - Nothing reads `n` or `y`. A slot of `y` may be written several times, and the last one counts.
//! - The patterns of its matrices are fixed, so that all memory is known before the first step.
//!
//! The compiler verifies what it writes, and [`Scene::validate`](scene::Scene::validate) verifies what is read from a
//! file.
//!
//! # What holds after each stage of a step
//!
//! 1. The kernel ran: the workspace holds the next state; the state itself is unchanged. A failed step leaves it
//!    unchanged too.
//! 2. The step is accepted (its error, its events and its numbers are good): the state is replaced, and the ledger's
//!    entries are booked, by region all or none. If one is not finite, the run ends.
//! 3. At a sample, every due region first ends its interval, then each one determines what it holds next. Both sides of
//!    a double bar have then booked the same energy, bit for bit.
//!
//! Nothing in a step of a known length allocates, reads a clock or depends on a thread.
//!
//! # Example
//!
//! ```
//! use bond_runtime::interpreter::Interpret;
//! use bond_runtime::ir::{Array, Builder};
//! use bond_runtime::kernel::Backend;
//!
//! // One step of explicit Euler for dx/dt = -x: n = x - h x, with the step length h as the first input.
//! let mut b = Builder::new("decay");
//! let (x, h, n) = (b.slot(Array::State), b.slot(Array::Input), b.slot(Array::Next));
//! let (x, h) = (b.load(x), b.load(h));
//! let change = b.mul(h, x);
//! let next = b.sub(x, change);
//! b.store(n, next);
//! let program = b.finish();
//! assert!(program.verify().is_ok());
//!
//! let kernel = Interpret.kernel(&program); // or machine code, from `bond_compiler::backend::native`
//! let mut work = kernel.workspace();
//! kernel.run(&[1.0], &[0.25], &[], &mut work)?;
//! assert_eq!(work.next, [0.75]);
//! # Ok::<(), bond_runtime::Failure>(())
//! ```
//!
//! # How to add a hold
//!
//! A hold decides what a sampled region holds at a double bar until its next sample. The compiler writes it as a
//! program ([`scene::Respond`]): the value to hold, from the state and either the last movement or the response of the
//! other side.
//!
//! 1. The compiler's `model.rs`: a variant of `Hold`, in `Hold::ALL` and `name`.
//! 2. The compiler's `discretise/assembly/hold.rs`: its program. A hold that the fields of [`scene::Respond`] do not
//!    say changes that, `simulate/sampled.rs`, the compiler's `backend/standalone/sample.rs` and
//!    [`envelope::FORMAT`]. That file tests for holds by `==`: look at each place, the compiler lists none.
//! 3. `tests/tests/holds.rs`: passivity under the budget, and order in the period. Budget and tank apply to every hold.
//! 4. `docs/reference/language.md` describes it, `docs/theory/double-bar.md` derives it.
//!
//! # How to add a number of the ledger
//!
//! 1. `energy/layout.rs`: its place, and what it starts as. In [`energy::ACCOUNT`] if stand-alone modules show it, else
//!    in [`energy::DetailPlaces`]. Checkpoints, block execution, C headers and modules then have it.
//! 2. `energy/account.rs` if a step changes it, `energy/interval.rs` if the end of an interval does. Both are written
//!    once, on a [`machine`]: a run gives them numbers, the compiler's `backend/standalone` writes them as statements.
//! 3. `simulate/summary.rs`: the number in [`RegionSummary`](simulate::RegionSummary).
//! 4. The command's `summary.rs` prints it.
//!
//! If it needs a term that no step reports yet, the compiler's `discretise/equations/accounts.rs` adds an output to
//! the steps, and its place to [`scene::Entries`].
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod double_double;
pub mod energy;
pub mod envelope;
pub mod eval;
pub mod exponential;
mod failure;
pub mod history;
pub mod interpreter;
pub mod ir;
pub mod kernel;
pub mod ledger;
pub mod machine;
pub mod options;
pub mod scene;
pub mod simulate;
pub mod solve;

pub use interpreter::Interpreter;
pub use kernel::{Failure, Kernel, Workspace};
