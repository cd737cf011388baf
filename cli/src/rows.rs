//! The instants of the rows of output.

use crate::attribution::{Attribution, Statement};
use crate::stop::Stop;
use bond_compiler::elaborate::told;

/// More rows than this are refused.
const MAX_ROWS: f64 = 1e8;

/// How rows between named instants are spaced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Grid {
    /// There are none.
    None,
    /// At k times this, and at the end.
    Every(f64),
    /// This many equal parts, and the end.
    Parts(u32),
}

impl Grid {
    /// The grid of a run: what the command line says of the distance of rows, and what the model says of it; none where
    /// instants are named and the command line says nothing else.
    pub fn asked(every: Option<f64>, settings: Option<f64>, at: &[f64]) -> Self {
        match every.or(settings) {
            Some(dt) if at.is_empty() || every.is_some() => Self::Every(dt),
            None if at.is_empty() => Self::Parts(1000),
            Some(_) | None => Self::None,
        }
    }
}

/// Instants in order, each once.
#[derive(Clone, Debug)]
pub struct Rows {
    grid: Grid,
    stop: f64,
    /// Points of the grid before the end.
    count: u64,
    at: Vec<f64>,
    /// Next points of both.
    k: u64,
    i: usize,
}

impl Rows {
    /// The end alone.
    pub fn end(stop: f64) -> Self {
        Self { grid: Grid::None, stop, count: 0, at: Vec::new(), k: 0, i: 0 }
    }

    /// The instants of a run to `stop`: those of the grid, of which somebody said the distance or the end, and those
    /// given.
    ///
    /// # Errors
    /// An instant beyond the end, or too many of them.
    pub fn new(stop: f64, grid: Grid, at: &[f64], by: Attribution) -> Result<Self, Stop> {
        let mut at = at.to_vec();
        at.sort_by(f64::total_cmp);
        if let Some(late) = at.iter().find(|t| **t > stop * (1.0 + 1e-9)) {
            return Err(Stop::Usage(format!(
                "--at {} is beyond the end of the run, {} s; make it longer with --stop",
                told(*late),
                told(stop)
            )));
        }
        // What is beyond by rounding is the end.
        at.iter_mut().for_each(|t| *t = t.min(stop));
        at.dedup();
        let points = match grid {
            Grid::None => 0.0,
            Grid::Every(dt) => (stop / dt * (1.0 - 1e-9)).ceil(),
            Grid::Parts(n) => f64::from(n),
        };
        if points.is_nan() || points > MAX_ROWS {
            let why = format!("that would be {points:.1e} rows, at most {MAX_ROWS:.0e} are written");
            let fix = format!("take a longer {}{}", by.setting("every"), by.place());
            return Err(by.refuse(Statement::Every, why, fix));
        }
        Ok(Self { grid, stop, count: points as u64, at, k: 0, i: 0 })
    }

    fn point(&self) -> Option<f64> {
        match self.grid {
            Grid::None => None,
            _ if self.k > self.count => None,
            _ if self.k == self.count => Some(self.stop),
            Grid::Every(dt) => Some(self.k as f64 * dt),
            Grid::Parts(n) => Some(self.k as f64 * self.stop / f64::from(n)),
        }
    }
}

impl Iterator for Rows {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        let (point, at) = (self.point(), self.at.get(self.i).copied());
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs().max(b.abs());
        match (point, at) {
            (None, None) => None,
            (Some(p), Some(t)) if same(p, t) => {
                self.k += 1;
                self.i += 1;
                Some(t)
            }
            (Some(p), t) if t.is_none_or(|t| p < t) => {
                self.k += 1;
                Some(p)
            }
            (_, t) => {
                self.i += 1;
                t
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_and_at_join() -> Result<(), Stop> {
        let rows: Vec<f64> =
            Rows::new(1.0, Grid::Every(0.3), &[0.5, 0.3, 0.5, 1.0], Attribution::CommandLine)?.collect();
        assert_eq!(rows, [0.0, 0.3, 0.5, 0.6, 3.0 * 0.3, 1.0]);
        let rows: Vec<f64> = Rows::new(0.3, Grid::Every(0.1), &[], Attribution::CommandLine)?.collect();
        assert_eq!(rows, [0.0, 0.1, 0.2, 0.3]);
        let rows: Vec<f64> = Rows::new(0.3, Grid::None, &[0.2, 0.1], Attribution::CommandLine)?.collect();
        assert_eq!(rows, [0.1, 0.2]);
        assert_eq!(Rows::new(3.0, Grid::Parts(1000), &[], Attribution::CommandLine)?.count(), 1001);
        let rows: Vec<f64> = Rows::new(1.0, Grid::Every(5.0), &[], Attribution::CommandLine)?.collect();
        assert_eq!(rows, [0.0, 1.0]);
        Ok(())
    }

    #[test]
    fn too_many_are_refused() {
        assert!(Rows::new(1.0, Grid::Every(1e-300), &[], Attribution::CommandLine).is_err());
        assert!(Rows::new(f64::MAX, Grid::Every(5e-324), &[], Attribution::CommandLine).is_err());
        assert!(Rows::new(1.0, Grid::Every(1.0), &[2.0], Attribution::CommandLine).is_err());
    }
}
