//! The subcommands, one file each.

pub mod bench;
pub mod build;
pub mod check;
pub mod doc;
pub mod fmt;
pub mod linearize;
pub mod new;
pub mod reduce;
pub mod run;
pub mod serve;
pub mod show;
pub mod test;
