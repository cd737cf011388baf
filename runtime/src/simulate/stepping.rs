//! How the steps of a cluster are laid: on a grid, or fitted to a tolerance. Whoever has a cluster run, or looks at it,
//! need not know which.

use super::cluster::{Run, book_step};
use super::controller::{Control, Fit};
use super::error_scale::Scale;
use super::input_signal::InputSignal;
use super::program::same_length;
use super::{Error, Options};
use crate::energy::Ledger;
use crate::kernel::Backend;
use crate::scene::{Cluster, Scene};
use std::borrow::Cow;

/// How the steps of a cluster are laid.
pub(super) enum Stepping {
    /// On a grid, with steps of at most this length, s; where there is none, each is as long as all that is left.
    Fixed(Option<f64>),
    /// Fitted to a tolerance.
    Fitted(Box<Fit>),
}

/// A cluster whose steps are fitted.
pub(super) struct Fitted<'r> {
    pub(super) c: &'r Cluster,
    pub(super) run: &'r mut Run,
    pub(super) fit: &'r mut Fit,
}

impl Stepping {
    /// A cluster at its start, and how its steps are laid.
    ///
    /// # Errors
    /// A program that fails at the start.
    pub(super) fn start(
        (index, c): (usize, &Cluster),
        given: &[InputSignal],
        (options, scene): (&Options, &Scene),
        backend: &dyn Backend,
    ) -> Result<(Run, Self), Error> {
        let is_exact = c.step.linear.is_some();
        let tolerance = options.tolerance.filter(|_| c.period.is_none() && !is_exact);
        let run = Run::new((index, c), given, (options, scene), tolerance.is_some(), backend)?;
        let Some(tolerance) = tolerance else {
            let whole = is_exact && c.step.properties.order == 0;
            return Ok((run, Self::Fixed(options.step.or((!whole).then_some(options.default_step)))));
        };
        let scales = Scale::all(c, &run, scene).map_err(|why| run.failure(c, 0.0, why))?;
        let mut fit = Fit::new(c, tolerance, scales, options, scene);
        // What is driven at a port is driven from the instant on to which it was advanced.
        fit.driven = scene.open.iter().any(|open| open.port.0 == index);
        Ok((run, Self::Fitted(Box::new(fit))))
    }

    /// Runs on its grid, which ends at `end`, to that end.
    pub(super) fn finish_at(&mut self, run: &mut Run, c: &Cluster, end: f64, moved: &mut [f64]) -> Result<(), Error> {
        while !self.step_towards(run, c, end, moved)? {}
        Ok(())
    }

    /// Takes one of the steps of a grid that ends at `end`; whether that was the last one.
    pub(super) fn step_towards(
        &mut self,
        run: &mut Run,
        c: &Cluster,
        end: f64,
        moved: &mut [f64],
    ) -> Result<bool, Error> {
        match self {
            Self::Fixed(_) => {
                if run.time() < end - 1e-9 * run.h {
                    run.next(c, moved)?;
                }
                let is_last = run.time() >= end - 1e-9 * run.h;
                if is_last {
                    (run.base, run.count) = (end, 0);
                }
                Ok(is_last)
            }
            Self::Fitted(fit) => Fitted { c, run, fit }.step_towards(end, moved),
        }
    }

    /// Runs to an instant that the grid need not meet: by its own steps, and then by what is left.
    pub(super) fn run_up_to(&mut self, run: &mut Run, c: &Cluster, at: f64, moved: &mut [f64]) -> Result<(), Error> {
        if let Self::Fixed(_) = self {
            self.run_past(run, c, at, moved)?;
        }
        self.run_to(run, c, at, moved)
    }

    /// Lays the steps anew: from now to `end`.
    pub(super) fn lay(&mut self, run: &mut Run, end: f64) {
        match self {
            Self::Fixed(longest) => {
                let now = run.time();
                let h = (end - now) / steps(end - now, *longest);
                (run.base, run.count) = (now, 0);
                // Intervals differ in their last bits; a step that differs so would need a table of its own.
                if !same_length(h, run.h, end) {
                    run.h = h;
                }
            }
            Self::Fitted(fit) => fit.limit = end,
        }
    }

    /// Runs to `end` exactly.
    pub(super) fn run_to(&mut self, run: &mut Run, c: &Cluster, end: f64, moved: &mut [f64]) -> Result<(), Error> {
        let now = run.time();
        if end - now <= 1e-12 * end.abs().max(now.abs()) {
            return Ok(());
        }
        match self {
            Self::Fixed(longest) => {
                let n = steps(end - now, *longest);
                let h = (end - now) / n;
                (0..n as u64).try_for_each(|i| run.one(c, now + i as f64 * h, h, moved))?;
            }
            Self::Fitted(fit) => Fitted { c, run, fit }.run_to(end, moved)?,
        }
        (run.base, run.count) = (end, 0);
        Ok(())
    }

    /// Takes the steps that end at `until` or before it.
    pub(super) fn run_past(&mut self, run: &mut Run, c: &Cluster, until: f64, moved: &mut [f64]) -> Result<(), Error> {
        match self {
            Self::Fixed(_) => {
                while run.base + (run.count + 1) as f64 * run.h <= until * (1.0 + 1e-12) {
                    run.next(c, moved)?;
                }
                Ok(())
            }
            Self::Fitted(fit) => Fitted { c, run, fit }.run_past(until, moved),
        }
    }

    /// Forgets what was planned with what changes now.
    pub(super) fn drop_plan(&mut self, run: &mut Run, c: &Cluster) {
        if let Self::Fitted(fit) = self {
            Fitted { c, run, fit }.drop_plan();
        }
    }

    /// The controller and the Newton iterations done, without what is only planned.
    pub(super) fn kept(&self, run: &Run) -> (Option<Control>, u64) {
        let Self::Fitted(fit) = self else { return (None, run.iterations()) };
        let (control, iterations) = fit.kept(run.iterations());
        (Some(control), iterations)
    }

    /// Leaves the state at `t` aside: by steps from the state that are not kept. Where the run is beyond that, because
    /// another region failed there, it is the state as it is.
    pub(super) fn look_at(&mut self, run: &mut Run, c: &Cluster, t: f64) -> Result<(), Error> {
        match self {
            Self::Fixed(_) => {
                let now = run.time();
                run.glanced.copy_from_slice(&run.state);
                let lies_within = t - now > 1e-12 * t.abs().max(now.abs()) && c.period.is_none();
                if lies_within { run.glance_to(c, now, t).map(|_| ()) } else { Ok(()) }
            }
            Self::Fitted(fit) => Fitted { c, run, fit }.look_at(t),
        }
    }

    /// Runs the cluster's observation at `t`.
    pub(super) fn observe(&mut self, run: &mut Run, c: &Cluster, t: f64) -> Result<(), Error> {
        self.look_at(run, c, t)?;
        run.input[0] = t;
        if c.period.is_none() {
            run.signals.latch(&mut run.input, t);
        }
        let result = run.instant.run(&run.glanced, &run.input).map(|_| ());
        result.map_err(|why| run.failure(c, t, why))
    }

    /// The state as it was looked at last at `t`, which may lie within a step.
    pub(super) fn state_at<'r>(&self, run: &'r Run, t: f64) -> &'r [f64] {
        match self {
            Self::Fitted(fit) if fit.shown == Some(t) => &run.glanced,
            _ => &run.state,
        }
    }

    /// The ledger at `t`: with the steps to there where it was looked at within a step.
    pub(super) fn ledger_at<'r>(&self, run: &'r Run, c: &Cluster, t: f64) -> Cow<'r, Ledger> {
        if let Self::Fitted(fit) = self
            && fit.shown == Some(t)
            && fit.single
        {
            let ledger = run.ledger.clone();
            let mut outputs = fit.midway.then_some(&fit.half.output).into_iter().chain([&fit.output]);
            // An energy that is no number ends the step that it lies in.
            if outputs.all(|output| book_step(&ledger, &run.layout, c, output).is_ok()) {
                return Cow::Owned(ledger);
            }
        }
        Cow::Borrowed(&run.ledger)
    }
}

/// How many steps of at most the longest go to a length of time; one where there is none.
fn steps(length: f64, longest: Option<f64>) -> f64 {
    (length / longest.unwrap_or(length) - 1e-9).ceil().max(1.0)
}
