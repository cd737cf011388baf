//! Ensembles: many instances of a model, each with values of its own for some parameters, in one table.
//!
//! `sweep` and `draw` read the arguments and compute values; `plan` gives the values of an instance by its
//! number alone, so that neither threads nor order matter. `job` runs an instance, `pool` spreads them over threads,
//! `side` keeps those that are done in a file, `sheet` puts them in the order of the table, `run` joins all that.

mod choice;
mod chunks;
mod collect;
mod draw;
mod fingerprint;
mod job;
mod outcome;
mod philox;
mod plan;
mod pool;
mod run;
mod setup;
mod sheet;
mod side;
mod statistics;
mod summary;
pub mod sweep;
mod written;

pub use run::run;
pub use setup::Setup;

use crate::input;
use draw::Draw;
use sweep::Sweep;

/// More instances than this are refused.
const INSTANCES: u64 = 1_000_000_000;
/// More threads than this are refused.
const THREADS: u64 = 256;

/// `--sweep`, `--monte-carlo` and what goes with them.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Ensembles")]
#[group(skip)]
pub struct Args {
    /// Run once per value of a parameter: N values, evenly spaced from FROM to TO, both included, or with `:log` by
    /// equal factors; or a list, `m=1,2,5`. Several sweeps give a grid, the last one varying fastest
    #[arg(long, value_name = "PATH=FROM..TO:N", value_parser = sweep::parse, allow_hyphen_values = true)]
    sweep: Vec<Sweep>,
    /// Run N times with random parameters, at each point of the grid if there is one
    #[arg(long, value_name = "N", value_parser = |text: &str| input::count(text, 1..=INSTANCES), requires = "draw", allow_negative_numbers = true)]
    monte_carlo: Option<u64>,
    /// Distribution of a parameter: `uniform(A, B)`, `normal(MEAN, SD)`, `lognormal(MEDIAN, SIGMA)` with the standard
    /// deviation of the logarithm, `triangular(A, MODE, B)`; repeatable
    #[arg(long, value_name = "PATH=DISTRIBUTION", value_parser = draw::parse, allow_hyphen_values = true)]
    draw: Vec<Draw>,
    /// Seed of the random numbers. Default: 0
    #[arg(long, value_name = "S", value_parser = |text: &str| input::count(text, 0..=u64::MAX), allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Instances that run at the same time. Default: one per core. The results do not depend on it
    #[arg(long, value_name = "T", value_parser = |text: &str| input::count(text, 1..=THREADS), allow_negative_numbers = true)]
    threads: Option<u64>,
    /// Start again although an interrupted run left FILE.part, instead of continuing it
    #[arg(long)]
    restart: bool,
}

impl Args {
    /// Whether an ensemble is asked for.
    pub fn asked(&self) -> bool {
        !self.sweep.is_empty() || self.monte_carlo.is_some()
    }

    /// An option that means nothing without another, and which one that is.
    pub fn idle(&self) -> Option<(&'static str, &'static str)> {
        let (ensembles, drawn) = ("ensembles; add --sweep or --monte-carlo", "drawn parameters; add --monte-carlo N");
        let options = [
            ("--threads", ensembles, self.threads.is_some() && !self.asked()),
            ("--restart", ensembles, self.restart && !self.asked()),
            ("--draw", drawn, !self.draw.is_empty() && self.monte_carlo.is_none()),
            ("--seed", drawn, self.seed.is_some() && self.monte_carlo.is_none()),
        ];
        options.into_iter().find(|o| o.2).map(|(option, what, _)| (option, what))
    }
}
