//! Checkpoints: states saved during a run, and runs resumed from them.

use crate::input::name;
use crate::output;
use crate::stop::Stop;
use bond::internal::{Code, SimulationInternals};
use bond::{InputSignal, RunError, Simulation};
use bond_compiler::elaborate::told;
use bond_runtime::scene::{Made, Scene};
use bond_runtime::simulate;
use std::path::Path;

/// Saves the state, each time whole or not at all.
pub struct Checkpoints<'a> {
    path: &'a Path,
    every: Option<f64>,
    /// The next instant to save at, s.
    next: f64,
    /// When the last state was saved, s.
    saved: Option<f64>,
}

impl<'a> Checkpoints<'a> {
    /// Saves at the end and, if given, at the first row after each `every` from `from` on, s.
    pub fn new(path: &'a Path, every: Option<f64>, from: f64) -> Self {
        let mut new = Self { path, every, next: f64::INFINITY, saved: None };
        new.wait(from);
        new
    }

    /// The first multiple after an instant.
    fn wait(&mut self, now: f64) {
        if let Some(dt) = self.every {
            let count = (now / dt * (1.0 + 1e-12)).floor() + 1.0;
            self.next = count * dt;
        }
    }

    /// Saves, if it is time to; whether it was.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn mark(&mut self, sim: &Simulation<'_>, end: bool) -> Result<bool, Stop> {
        let due = sim.time() >= self.next * (1.0 - 1e-12);
        if !due && !end {
            return Ok(false);
        }
        self.wait(sim.time());
        output::put_bytes(self.path, &sim.save()?)?;
        self.saved = Some(sim.time());
        Ok(true)
    }

    /// The last saved state of a run that did not reach its end.
    pub fn left(&self) -> String {
        match (self.saved, self.every) {
            (Some(t), _) => {
                format!("note: {} has the state at {} s, for --resume", self.path.display(), told(t))
            }
            (None, None) => "note: no state was saved; --checkpoint-every saves during the run".into(),
            (None, Some(_)) => "note: no state was saved; it was not yet time to".into(),
        }
    }
}

/// The bytes of a state.
///
/// # Errors
/// A file that cannot be read.
pub fn state(path: &Path) -> Result<Vec<u8>, Stop> {
    bond::internal::read_bytes(path).map_err(|e| Stop::Usage(format!("cannot read {}: {e}", name(path))))
}

/// The settings for which the scene of a saved state was compiled; None if it is not a state, which resuming reports.
///
/// # Errors
/// A file that cannot be read.
pub fn made(path: &Path) -> Result<Option<Made>, Stop> {
    Ok(simulate::made(&state(path)?).ok())
}

/// Resumes a run from the bytes of a file.
///
/// # Errors
/// Bytes that are not a state of this scene, or whose time is not before the end.
pub fn resume<'a>(
    code: Code,
    (path, bytes): (&Path, &[u8]),
    scene: &'a Scene,
    given: Vec<(String, InputSignal)>,
    stop: f64,
) -> Result<Simulation<'a>, Stop> {
    let sim = Simulation::resume(code.backend(), scene, bytes, given).map_err(|e| match e {
        RunError::Resume(why) => Stop::Usage(format!("cannot resume {}: {why}", name(path))),
        other => other.into(),
    })?;
    let at = sim.time();
    if at * (1.0 + 1e-12) >= stop {
        return Err(Stop::Usage(format!(
            "{} was saved at {} s, and the run ends at {} s; give a later end with --stop",
            name(path),
            told(at),
            told(stop)
        )));
    }
    Ok(sim)
}
