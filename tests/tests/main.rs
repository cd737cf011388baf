//! The tests of the whole way, one module a stage. What they run are the models of `models/`.

mod collocation;
mod common;
mod corners;

mod adaptive;
mod allocation;
mod backend;
mod bounds;
mod causality;
mod classics;
mod determinism;
mod diagnostics;
mod elaborate;
mod emitted;
mod exchange;
mod expectations;
mod form;
mod hard;
mod holds;
mod image;
mod lanes;
mod laws;
mod ledger;
mod library;
mod linearize;
mod multiports;
mod mutations;
mod orders;
mod parse;
mod program;
mod random;
mod sav;
mod save;
mod signals;
mod solutions;
mod values;
