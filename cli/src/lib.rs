//! Bond graphs from a program: compile a `.bond` model, look at its form, step it, read its energy ledger.
//!
//! ```
//! let text = "
//!     model Oscillator(k = 100 N/m) {
//!       C:spring { stiffness = k;  q0 = 0.1 m }
//!       I:mass = 1 kg
//!       1:v -> spring, mass
//!       probe x = spring.q
//!     }";
//! let compiled = bond::Options::new().set("k", "400 N/m").compile_str("oscillator.bond", text)?;
//! println!("{}", compiled.show("phs"));
//!
//! let mut sim = compiled.simulate(bond::Steps::fixed(1e-3))?;
//! sim.advance(0.5)?;
//! assert!((sim.probe("x")? - 0.1 * (20.0f64 * 0.5).cos()).abs() < 1e-9);
//! sim.finish(1.0)?;
//! let summary = sim.summary();
//! assert!(summary.passive && summary.worst_step < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! What is wrong with a model comes as [`Errors`], which display as text with file, line and column of each. In a test,
//! `insta::assert_snapshot!(compiled.show("phs"))` keeps an eye on the generated structure.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod compile;
mod errors;
pub mod exchange;
mod given;
mod load;
mod quantity;
mod simulation;

pub use bond_compiler::show::{As, What};
pub use bond_runtime::simulate::{BarSummary, Course, ElementEnergy, Modified, RegionSummary, Summary};
pub use compile::{Compiled, Options, Text, compile_file, compile_str};
pub use errors::Errors;
pub use given::{Given, TableError};
pub use load::{FileLoader, ReadError, read, read_bytes, read_table};
pub use quantity::{Quantity, quantity, seconds};
pub use simulation::{Code, RunError, Simulation, Steps};
