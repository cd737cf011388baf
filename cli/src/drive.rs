//! Runs a simulation through the instants of its rows.

use crate::rows::Rows;
use crate::stop::Stop;
use bond::{RunError, Simulation};
use bond_runtime::scene::Scene;
use bond_runtime::simulate::Options;

/// More steps than this are refused.
const STEPS: f64 = 1e10;

/// Refuses runs that would take for ever.
///
/// # Errors
/// A step or a period that is tiny against the run.
pub fn possible(scene: &Scene, options: &Options, stop: f64) -> Result<(), Stop> {
    let refuse = |steps: f64, what: String| {
        // Written so that NaN is refused too.
        if steps <= STEPS {
            return Ok(());
        }
        Err(Stop::Usage(format!("{what} would make {steps:.1e} steps in {stop} s, at most {STEPS:.0e} are done")))
    };
    if let Some(h) = options.step {
        refuse(stop / h, format!("steps of {h} s"))?;
    }
    for c in &scene.clusters {
        if let Some(period) = c.period {
            refuse(stop / period, format!("the period {period} s of `{}`", c.name))?;
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
    for t in rows {
        if t >= stop * (1.0 - 1e-12) {
            finish(sim, stop)?;
        } else {
            sim.advance(t).map_err(Halt::Numerics)?;
        }
        row(sim, t)?;
    }
    finish(sim, stop)
}

fn finish(sim: &mut Simulation<'_>, stop: f64) -> Result<(), Halt> {
    if sim.time() > stop {
        return Ok(());
    }
    sim.finish(stop).map_err(Halt::Numerics)
}
