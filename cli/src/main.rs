//! The `bond` command.

mod arguments;
mod attribution;
mod bench;
mod checkpoint;
mod choose;
mod column;
mod commands;
mod csv;
mod diff;
mod document;
mod drive;
mod emit;
mod ensemble;
mod environment;
mod expectation;
mod hash;
mod input;
mod lints;
mod output;
#[cfg(feature = "parquet")]
mod parquet;
mod pending;
mod picture;
mod plot;
mod progress;
mod reduce;
mod report;
mod rows;
mod serve;
mod signal;
mod stop;
mod summary;
mod table;
mod text;

use clap::{Parser, Subcommand};
use commands::{
    bench as benching, build, check, doc, fmt, linearize, new, reduce as reducing, run, serve as serving, show, test,
};
use std::process::ExitCode;
use stop::Stop;

/// Bond graphs: check, look at, simulate and test `.bond` models
#[derive(Parser)]
#[command(
    name = "bond",
    version,
    propagate_version = true,
    subcommand_required = true,
    arg_required_else_help = true,
    max_term_width = 100,
    after_help = "Examples:\n  bond new wall                 a starting folder\n  bond check wall/wall.bond     what is wrong with it\n  \
                  bond run wall/wall.bond       simulate it, and see its energy ledger\n\nExit status: 0 done; 1 the model is wrong or an \
                  expectation failed; 2 the command line is wrong; 3 the numerics failed; 130 a run was asked to end."
)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Build(build::Args),
    New(new::Args),
    Check(check::Args),
    Doc(doc::Args),
    Fmt(fmt::Args),
    Show(show::Args),
    Linearize(linearize::Args),
    Run(Box<run::Args>),
    Bench(Box<benching::Args>),
    Reduce(Box<reducing::Args>),
    Serve(serving::Args),
    Test(test::Args),
}

/// Bytes of a thread's stack. Deep models recurse deeply, and memory is only taken where the stack is touched.
const STACK: usize = 256 << 20;

fn main() -> ExitCode {
    let worker = std::thread::Builder::new().stack_size(STACK).spawn(|| match environment::carried() {
        // A file with a scene at its end is that scene's environment.
        Some(scene) => done(scene.and_then(|scene| environment::act(&scene))),
        None => done(command(&Line::parse_from(arguments::words()).command)),
    });
    match worker.map(std::thread::JoinHandle::join) {
        Ok(Ok(status)) => ExitCode::from(status),
        Ok(Err(_)) => ExitCode::from(101),
        Err(e) => {
            report::error(&format!("cannot start: {e}"));
            ExitCode::from(101)
        }
    }
}

/// Does a command.
fn command(command: &Command) -> Result<(), Stop> {
    match command {
        Command::Build(args) => build::build(args),
        Command::New(args) => new::new(args),
        Command::Check(args) => check::check(args),
        Command::Doc(args) => doc::doc(args),
        Command::Fmt(args) => fmt::fmt(args),
        Command::Show(args) => show::show(args),
        Command::Linearize(args) => linearize::linearize(args),
        Command::Run(args) => run::run(args),
        Command::Bench(args) => benching::bench(args),
        Command::Reduce(args) => reducing::reduce(args),
        Command::Serve(args) => serving::serve(args),
        Command::Test(args) => test::test(args),
    }
}

/// Says what went wrong, and gives the exit status.
fn done(result: Result<(), Stop>) -> u8 {
    match result {
        Ok(()) | Err(Stop::Pipe) => 0,
        Err(Stop::Said(status)) => status,
        Err(Stop::Usage(message)) => {
            report::error(&message);
            2
        }
        Err(Stop::Model(message)) => {
            report::error(&message);
            1
        }
        Err(Stop::Placed(placed)) => {
            report::diagnostics(&placed.0, std::slice::from_ref(&placed.1));
            1
        }
        Err(Stop::Numerics(message)) => {
            report::error(&message);
            3
        }
    }
}
