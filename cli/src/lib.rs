//! Bond graphs from a program: compile a `.bond` model, look at its form, step it, read its energy ledger.
//!
//! # The way
//!
//! | type | is made by | holds |
//! | --- | --- | --- |
//! | [`Options`] | its methods | the scene, parameters, the stepper |
//! | [`Compiled`] | [`Options::compile_file`], [`Options::compile_str`] | a checked model with its step programs |
//! | [`Simulation`] | [`Compiled::simulate`] | the state of a run, at the start |
//! | [`Summary`] | [`Simulation::summary`] | the ledger, at any time |
//!
//! A wrong model gives [`Errors`], which display as text with file, line and column of each, and a suggested fix. A run
//! that cannot continue gives a [`RunError`]; the state then is that of the last good step. No input panics. The same
//! model with the same options gives the same bits, on every machine.
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
//! # More
//!
//! - Input signals: [`Compiled::simulate_with`], [`Simulation::set_input`], and tables of them by [`Given`].
//! - Open ports: [`Simulation::held`] and [`Simulation::report`] for sampled regions, [`Simulation::drive`] for
//!   continuous ones; [`exchange`] over a line that loses packets.
//! - Saved states: [`Simulation::save`], [`Compiled::resume`].
//! - Many compilations of one text: [`Text`].
//! - Rates and energies at any state, without a run: [`Compiled::rates`], [`Compiled::energies`].
//! - In a test, `insta::assert_snapshot!(compiled.show("phs"))` keeps an eye on the generated structure.
//!
//! The interface hands out no types of the compiler. Its enums and summaries may grow.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod code;
mod compile;
mod draw;
mod errors;
pub mod exchange;
mod failure;
mod given;
mod load;
mod quantity;
mod simulation;
mod steps;

pub use bond_grammar::diagnostic::{Diagnostic, Label};
pub use bond_grammar::source::{Source, SourceId, Sources, Span};
pub use bond_runtime::simulate::{
    BarSummary, ElementEnergy, ElementEntropy, InputSignal, LineSummary, Modified, PortPassivity, RegionSummary,
    SteeredSource, Summary, Unfit,
};
pub use compile::{Compiled, Options, Text, compile_file, compile_str};
pub use errors::Errors;
pub use failure::{NumericsError, ResumeError, RunError};
pub use given::{Given, TableError};
pub use simulation::Simulation;
pub use steps::Steps;

/// What the command, the benchmarks and this repository's tests use besides the interface: types of the compiler and of
/// the runtime. It is not part of the interface, and changes without notice.
#[doc(hidden)]
pub mod internal {
    pub use crate::code::Code;
    pub use crate::compile::{CompiledInternals, OptionsInternals, TextInternals};
    pub use crate::draw::{Anchor, BLACK, COLOURS, Colour, Drawing, GREY, Mark, PALE, PictureFormat, power};
    pub use crate::exchange::ExchangeInternals;
    pub use crate::failure::{failure, refusal};
    pub use crate::load::{CarriedTexts, FileLoader, ReadError, read, read_bytes, read_table};
    pub use crate::quantity::{Quantity, quantity, seconds};
    pub use crate::simulation::SimulationInternals;
    pub use crate::steps::StepsInternals;
}
