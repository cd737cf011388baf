//! What a cluster keeps, as far as steps change it: a way that was tried is gone back by it.

use super::cluster::Run;
use super::controller::Control;
use super::delay_line::DelayLines;
use super::hold::{Held, Report};
use super::stepping::Stepping;
use super::watched::Most;
use crate::energy::Ledger;
use crate::scene::Scene;

/// What a cluster keeps.
#[derive(Debug, Default)]
pub(super) struct Kept {
    state: Vec<f64>,
    input: Vec<f64>,
    largest: Vec<f64>,
    moved: Vec<f64>,
    ledger: Ledger,
    watched: Vec<Most>,
    steps: u64,
    iterations: u64,
    grid: (f64, u64, f64),
    lines: DelayLines,
    /// Where its steps are fitted: the controller, the next instant that is met, what went through integrals, and the
    /// largest that guards were.
    fit: Option<(Control, f64)>,
    through: Vec<f64>,
    tops: Vec<f64>,
}

impl Kept {
    /// Keeps it.
    pub(super) fn keep(&mut self, run: &Run, stepping: &Stepping, moved: &[f64]) {
        let lists =
            [(&mut self.state, &run.state[..]), (&mut self.input, &run.input), (&mut self.largest, &run.largest)];
        lists.into_iter().chain([(&mut self.moved, moved)]).for_each(|(to, from)| copy(to, from));
        self.ledger.copy_from(&run.ledger);
        self.lines.keep(&run.signals.lines);
        self.watched.clear();
        self.watched.extend(run.watched.iter().map(|d| d.most));
        (self.steps, self.grid) = (run.steps, (run.base, run.count, run.h));
        let (control, iterations) = stepping.kept(run);
        self.iterations = iterations;
        if let Stepping::Fitted(fit) = stepping {
            self.fit = control.map(|control| (control, fit.limit));
            copy(&mut self.through, &fit.moved);
            copy(&mut self.tops, &fit.tops);
        }
    }

    /// Has the cluster be as it was.
    pub(super) fn restore(&self, run: &mut Run, stepping: &mut Stepping, moved: &mut [f64]) {
        run.state.copy_from_slice(&self.state);
        run.input.copy_from_slice(&self.input);
        run.largest.copy_from_slice(&self.largest);
        moved.copy_from_slice(&self.moved);
        run.ledger.copy_from(&self.ledger);
        run.signals.lines.copy_from(&self.lines);
        run.watched.iter_mut().zip(&self.watched).for_each(|(d, most)| d.most = *most);
        (run.steps, (run.base, run.count, run.h)) = (self.steps, self.grid);
        run.step.work.newton_iterations = self.iterations;
        if let (Stepping::Fitted(fit), Some((control, limit))) = (stepping, self.fit) {
            (fit.control, fit.limit, fit.plan, fit.shown) = (control, limit, None, None);
            fit.moved.copy_from_slice(&self.through);
            fit.tops.copy_from_slice(&self.tops);
        }
    }
}

fn copy(to: &mut Vec<f64>, from: &[f64]) {
    to.clear();
    to.extend_from_slice(from);
}

/// What there was before the steps that end at an instant; nothing where no sampled sides meet within a budget.
#[derive(Debug, Default)]
pub(super) struct Before {
    pub(super) kept: Vec<(usize, Kept)>,
    pub(super) held: Vec<Vec<Held>>,
    pub(super) open: Vec<Report>,
}

impl Before {
    /// Room for that of a scene.
    pub(super) fn of(scene: &Scene) -> Self {
        let is_sampled = |i: usize| scene.clusters[i].period.is_some();
        let bars = scene.bars.iter().filter(|b| is_sampled(b.other.0));
        let mut within =
            bars.map(|b| [b.holder.0, b.other.0]).filter(|two| two.iter().any(|i| scene.clusters[*i].budget));
        if within.next().is_none() {
            return Self::default();
        }
        let sampled = (0..scene.clusters.len()).filter(|i| is_sampled(*i));
        Self { kept: sampled.map(|i| (i, Kept::default())).collect(), ..Self::default() }
    }
}
