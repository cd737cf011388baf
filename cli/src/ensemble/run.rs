//! Runs an ensemble: checks the arguments, runs the instances that are missing, and writes the table.

use super::Args;
use super::choice::Choice;
use super::chunks::Chunks;
use super::collect::{Collect, InOrder};
use super::fingerprint::Fingerprint;
use super::job::{Job, NUMBERS_PER_INSTANCE};
use super::plan::Plan;
use super::pool;
use super::setup::Setup;
use super::sheet::Sheet;
use super::side::Side;
use super::statistics::Statistics;
use super::summary::Told;
use crate::signal::{self, ASKED};
use crate::stop::Stop;
use crate::{input, output, report};
use bond::internal::CompiledInternals;
use bond::{Compiled, Text};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Runs an ensemble.
///
/// # Errors
/// A command line that is wrong, a model that is wrong whatever its parameters, instances that failed.
pub fn run(args: &Args, setup: Setup) -> Result<(), Stop> {
    let plan = Plan::new(args, setup.set)?;
    let text = Text::new(&input::name(setup.file), input::read(setup.file)?);
    output::not_over_used(setup.output, text.used())?;
    let choice = Choice::new(setup.interpret, plan.total());
    let mut job = Job {
        text,
        options: setup.options.clone(),
        plan,
        steps: setup.steps,
        stop: setup.stop,
        every: setup.every,
        at: setup.at.to_vec(),
        // Nobody sees the rows where no table is asked for.
        over_time: setup.output.is_some() && (setup.every.is_some() || !setup.at.is_empty()),
        given: Vec::new(),
        choice,
        probes: Vec::new(),
    };
    let sample = sample(&job)?;
    job.probes = sample.probes().to_vec();
    if job.stop.or(sample.stages().model.settings.stop).is_none() {
        report::say("note: neither the model nor --stop gives the end of the run; it is 1 s");
    }
    let (rows, ..) = job.course(&sample)?;
    if job.over_time && rows.count() * (1 + job.probes.len()) > NUMBERS_PER_INSTANCE {
        let why =
            format!("more than {NUMBERS_PER_INSTANCE} numbers would be kept of one instance; take a longer --every");
        return Err(Stop::Usage(why));
    }
    if let Some((path, hold)) = setup.input {
        job.given = input::table(path, sample.scene(), hold)?;
    }
    let cores = || std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let threads = args.threads.unwrap_or_else(cores).clamp(1, super::THREADS);
    let print = Fingerprint::new(&setup, &job, &sample.scene().name);
    let (job, started) = (Arc::new(job), Instant::now());
    let chunks = Chunks::new(job.plan.total());
    let asked = signal::watch("now, and what is done of a table in a file is kept");
    let crew = Crew { job: &job, chunks, threads, asked };
    let (statistics, ran) = match setup.output {
        Some(path) if output::whole(path)? => kept(&crew, path, &print, args.restart)?,
        Some(_) | None => {
            let mut sheet = Sheet::new(&job, chunks, setup.output)?;
            crew.run(&mut InOrder::new(&mut sheet))?;
            (sheet.commit()?, job.plan.total())
        }
    };
    let wall = started.elapsed().as_secs_f64();
    let told = Told { job: &job, scene: sample.scene(), statistics: &statistics, wall, ran, threads };
    let text = if setup.json { told.json()? } else { told.text() };
    if setup.output == Some(Path::new("-")) {
        report::say(text.trim_end());
    } else {
        output::offer(&text)?;
    }
    told.failure().map_or(Ok(()), |why| Err(Stop::Numerics(why)))
}

/// What runs, and who.
struct Crew<'a> {
    job: &'a Arc<Job>,
    chunks: Chunks,
    threads: u64,
    /// Whether it is asked to end.
    asked: &'a AtomicBool,
}

impl Crew<'_> {
    fn run(&self, collect: &mut dyn Collect) -> Result<(), Stop> {
        pool::run(self.job, self.chunks, self.threads, self.asked, collect)
    }
}

/// Runs what the side file does not have, and makes the table of it. Gives how many instances were run.
fn kept(crew: &Crew, path: &Path, print: &Fingerprint, restart: bool) -> Result<(Statistics, u64), Stop> {
    let chunks = crew.chunks;
    let mut side = Side::open(path, print, chunks, restart)?;
    let total = crew.job.plan.total();
    let missing = |side: &Side| (0..chunks.count()).filter(|c| !side.has(*c)).map(|c| chunks.size(c)).sum::<u64>();
    let left = missing(&side);
    if left < total {
        report::say(&format!(
            "note: {} of {total} instances are in {} already; --restart starts again",
            total - left,
            side.path().display()
        ));
    }
    let ran = crew.run(&mut side);
    if let Err(Stop::Said(ASKED)) = ran {
        side.pause()?;
        report::say(&format!(
            "interrupted: {} of {total} instances are in {}; the same command continues from there",
            total - missing(&side),
            side.path().display()
        ));
    }
    ran?;
    let mut sheet = Sheet::new(crew.job, chunks, Some(path))?;
    side.copy(&mut sheet)?;
    let statistics = sheet.commit()?;
    side.remove()?;
    Ok((statistics, left))
}

/// An instance that compiles, to learn from it what all have in common: the first, the last, or one with the model's
/// own values.
///
/// # Errors
/// An unknown parameter, a wrong unit, or a model that is wrong for all values.
fn sample(job: &Job) -> Result<Compiled, Stop> {
    let first = match job.compile(0) {
        Ok(compiled) => return Ok(compiled),
        Err(errors) => errors,
    };
    // These do not depend on the value.
    let always = |code: &str| code.starts_with("units::") || matches!(code, "elaborate::set" | "elaborate::model");
    let plain = job.options.compile_text(&job.text);
    if first.list().iter().any(|d| always(d.code)) {
        if plain.is_ok() {
            report::say(&format!("note: this is {}, as with --set:", job.plan.named(0)));
        }
        return Err(input::wrong(&first));
    }
    job.compile(job.plan.total() - 1).or(plain).map_err(|_| input::wrong(&first))
}
