//! Runs a simulation through the instants of its rows.

use crate::attribution::{Attribution, Statement};
use crate::rows::Rows;
use crate::stop::Stop;
use crate::summary::short;
use bond::{RunError, Simulation};
use bond_runtime::scene::Scene;
use bond_runtime::simulate::Options;

/// More steps than this are refused.
const MAX_STEPS: f64 = 1e10;

/// Refuses runs that would take for ever.
///
/// # Errors
/// A step or a period that is tiny against the run.
pub fn possible(scene: &Scene, options: &Options, stop: f64, by: Attribution) -> Result<(), Stop> {
    let refuse = |steps: f64, what: String, said: Statement, longer: &str| {
        // Written so that NaN is refused too.
        if steps <= MAX_STEPS {
            return Ok(());
        }
        let why = format!("{what} would make {steps:.1e} steps in {} s, at most {MAX_STEPS:.0e} are done", short(stop));
        let fix = format!("take a longer {longer} or a shorter {}{}", by.setting("stop"), by.place());
        Err(by.refuse(said, why, fix))
    };
    if let Some(h) = options.step {
        refuse(stop / h, format!("steps of {} s", short(h)), Statement::Step, &by.setting("step"))?;
    }
    // None of those that are fitted is longer.
    if let Some(h) = options.tolerance.and(options.longest) {
        let what = format!("steps of at most {} s", short(h));
        refuse(stop / h, what, Statement::Step, "bound on them")?;
    }
    for c in &scene.clusters {
        if let Some(period) = c.period {
            let what = format!("the period {} s of `{}`", short(period), c.name);
            refuse(stop / period, what, Statement::Period(period), "period")?;
        }
    }
    Ok(())
}

/// Why a run did not come to its end.
pub enum Halt {
    /// The numerics failed.
    Numerics(RunError),
    /// A row could not be written.
    Stop(Stop),
}

/// Receives the rows of a run.
pub trait Watch {
    /// Called at each row; if the numerics fail, also at the end of the last good step.
    ///
    /// # Errors
    /// What ends the run.
    fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt>;

    /// Called before each row, and at the end before the last, shorter step: a run resumed from there is as if it had
    /// never stopped.
    ///
    /// # Errors
    /// What ends the run.
    fn mark(&mut self, sim: &Simulation<'_>, end: bool) -> Result<(), Halt>;
}

/// Runs to `stop`, and calls `row` at each of the instants.
///
/// # Errors
/// The numerics, or what `row` gives.
pub fn drive(
    sim: &mut Simulation<'_>,
    rows: Rows,
    stop: f64,
    row: &mut dyn FnMut(&mut Simulation<'_>, f64) -> Result<(), Halt>,
) -> Result<(), Halt> {
    struct Rowwise<'a>(&'a mut dyn FnMut(&mut Simulation<'_>, f64) -> Result<(), Halt>);
    impl Watch for Rowwise<'_> {
        fn row(&mut self, sim: &mut Simulation<'_>, t: f64) -> Result<(), Halt> {
            (self.0)(sim, t)
        }

        fn mark(&mut self, _: &Simulation<'_>, _: bool) -> Result<(), Halt> {
            Ok(())
        }
    }
    watched(sim, rows, stop, &mut Rowwise(row))
}

/// Continues a run to `stop`, and calls the watch at each of the instants on the way.
///
/// # Errors
/// The numerics, or what the watch gives.
pub fn watched(sim: &mut Simulation<'_>, rows: Rows, stop: f64, watch: &mut dyn Watch) -> Result<(), Halt> {
    let mut walk = Walk::new(sim.time(), rows, stop);
    loop {
        let before = sim.time();
        match walk.on(sim, watch) {
            Ok(true) => {}
            Ok(false) => return Ok(()),
            Err(Halt::Numerics(e)) => {
                // What was computed after the last row is kept.
                if sim.time() > before {
                    let time = sim.time();
                    let _ = watch.row(sim, time); // the failure goes before
                }
                return Err(Halt::Numerics(e));
            }
            Err(halt) => return Err(halt),
        }
    }
}

/// Runs again to an instant, by the same rows as before: when a region's step failed, others had already gone on, and
/// this finds all of them as they were before.
pub fn again(sim: &mut Simulation<'_>, rows: Rows, until: f64) {
    let from = sim.time() * (1.0 - 1e-12);
    for t in rows.filter(|t| *t >= from).take_while(|t| *t < until).chain([until]) {
        // What did not fail then does not fail now.
        let _ = sim.advance(t);
    }
}

/// A run on its way through the instants of its rows.
pub struct Walk {
    rows: Rows,
    stop: f64,
    /// The next row's instant.
    next: Option<f64>,
    /// Whether the end was one of them.
    ended: bool,
}

impl Walk {
    /// From an instant on.
    pub fn new(from: f64, mut rows: Rows, stop: f64) -> Self {
        let next = rows.find(|t| *t >= from * (1.0 - 1e-12));
        Self { rows, stop, next, ended: false }
    }

    fn is_end(&self, t: f64) -> bool {
        t >= self.stop * (1.0 - 1e-12)
    }

    /// Goes to the next row, or from the last one to the end; whether there is more.
    ///
    /// # Errors
    /// The numerics, or what the watch gives.
    pub fn on(&mut self, sim: &mut Simulation<'_>, watch: &mut dyn Watch) -> Result<bool, Halt> {
        let Some(t) = self.next else {
            if self.ended {
                finish(sim, self.stop)?
            } else {
                end(sim, self.stop, watch)?
            }
            return Ok(false);
        };
        if self.is_end(t) {
            end(sim, self.stop, watch)?;
            self.ended = true;
        } else {
            sim.advance(t).map_err(Halt::Numerics)?;
            watch.mark(sim, false)?;
        }
        watch.row(sim, t)?;
        self.next = self.rows.next();
        Ok(true)
    }
}

fn end(sim: &mut Simulation<'_>, stop: f64, watch: &mut dyn Watch) -> Result<(), Halt> {
    if sim.time() <= stop {
        sim.advance(stop).map_err(Halt::Numerics)?;
    }
    watch.mark(sim, true)?;
    finish(sim, stop)
}

fn finish(sim: &mut Simulation<'_>, stop: f64) -> Result<(), Halt> {
    if sim.time() > stop {
        return Ok(());
    }
    sim.finish(stop).map_err(Halt::Numerics)
}
