//! What sampled sides exchange within the budgets of all.
//!
//! A sampled side meets over its step what another one held when the step began. Inside the step is no instant at which
//! that could be let go. So the steps that end at one instant are first taken as they are. Where that leaves somebody
//! with less than nothing, he is limited from then on, and they are taken again. Who holds is limited by what is met of
//! it: λ times what he holds, and λ the largest number in [0, 1] with which no more crosses than he has. Who meets is
//! limited by what is told of it: a part of what his step gives. At 0 nothing crosses.

use super::Error;
use super::cluster::Run;
use super::kept::Before;
use super::schedule::Simulation;
use crate::energy::interval;
use crate::machine::Real;
use crate::scene::Bar;

/// Halvings of the range of λ: as many as there are digits.
const HALVINGS: u32 = 53;

impl Simulation<'_> {
    /// Ends the intervals of the sampled clusters that are due.
    pub(super) fn end_intervals(&mut self, due: &[usize]) -> Result<(), Error> {
        let mut before = std::mem::take(&mut self.before);
        let result = self.end_within(due, &mut before);
        self.before = before;
        result
    }

    fn end_within(&mut self, due: &[usize], before: &mut Before) -> Result<(), Error> {
        for (i, kept) in &mut before.kept {
            kept.keep(&self.runs[*i], &self.stepping[*i], &self.moved[*i]);
        }
        if !before.kept.is_empty() {
            before.held.clone_from(&self.held);
            before.open.clone_from(&self.open);
        }
        self.limited.fill(false);
        loop {
            self.end_all(due)?;
            let mut is_good = true;
            for (i, _) in &before.kept {
                if self.is_short(*i, due.contains(i)) && !self.limited[*i] {
                    (self.limited[*i], is_good) = (true, false);
                }
            }
            if is_good {
                return Ok(());
            }
            for (i, kept) in &before.kept {
                kept.restore(&mut self.runs[*i], &mut self.stepping[*i], &mut self.moved[*i]);
            }
            self.held.clone_from(&before.held);
            self.open.clone_from(&before.open);
        }
    }

    /// Ends them one after the other: those who answer before those who hold for them.
    fn end_all(&mut self, due: &[usize]) -> Result<(), Error> {
        for i in due.iter().copied() {
            if self.next[i] == 0 {
                continue;
            }
            self.hand_over(i);
            self.commit(i)?;
            self.collect(Some(i));
        }
        Ok(())
    }

    /// Whether a cluster gave more than it had to give: until its interval ended, or in the one that runs.
    fn is_short(&mut self, i: usize, has_ended: bool) -> bool {
        if !self.scene.clusters[i].budget {
            return false;
        }
        match has_ended {
            true => interval::is_short(Real::new(), self.sampling(i), &self.runs[i].layout),
            false => [false, true].into_iter().any(|is_heat| self.left_now((i, is_heat)) < 0.0),
        }
    }

    /// Takes the step of a sampled cluster. It meets less of what those hold who are limited and could not give what
    /// crosses, and answers less where it is limited itself.
    pub(super) fn step_sampled(&mut self, i: usize, (start, period): (f64, f64)) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        self.runs[i].try_whole(c, start, period)?;
        self.parts[i].fill([1.0; 2]);
        if !self.can_be_given(i, period) {
            self.reduce(i, (start, period))?;
        }
        if self.limited[i] && !c.holds.is_empty() {
            [false, true].into_iter().for_each(|is_heat| self.answer_less(i, period, is_heat));
        }
        self.runs[i].keep_step(c, start, period, &mut self.moved[i])?;
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let kept = (1.0 - self.parts[i][bar.other.1][1]) * self.crosses(bar, period);
            let region = c.ports[bar.other.1].region;
            let account = c.entries.iter().position(|e| e.region == region);
            if let Some(p) = account.map(|k| &self.runs[i].layout.accounts[k]).filter(|_| kept != 0.0) {
                interval::keep_back(Real::new(), self.sampling(i), p, (kept, self.is_heat_there(bar)));
            }
        }
        Ok(())
    }

    /// Has a cluster that is limited answer with a part of what its step gives, so that no more crosses than it has:
    /// what its own states moved by stays, and the rest of that energy is lost.
    fn answer_less(&mut self, i: usize, period: f64, is_heat: bool) {
        let scene = self.scene;
        let bars = || scene.bars.iter().filter(|b| b.other.0 == i);
        let (mut given, mut got) = (0.0, 0.0);
        for bar in bars().filter(|b| self.is_heat_there(b) == is_heat) {
            let x = self.crosses(bar, period);
            *if x > 0.0 { &mut given } else { &mut got } += x.abs();
        }
        let there = self.left_at_end(i, is_heat) + got;
        if given <= there {
            return;
        }
        for bar in bars() {
            if self.is_heat_there(bar) == is_heat && self.crosses(bar, period) > 0.0 {
                self.parts[i][bar.other.1][1] = there / given;
                self.count_release(i);
            }
        }
    }

    /// Finds the largest λ, and leaves the step with it in the workspace.
    fn reduce(&mut self, i: usize, (start, period): (f64, f64)) -> Result<(), Error> {
        let c = &self.scene.clusters[i];
        let mut whole = std::mem::take(&mut self.latched);
        whole.clear();
        whole.extend(c.ports.iter().map(|p| self.runs[i].input[p.input]));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let part = 0.5 * (low + high);
            self.latch_part(i, part, &whole);
            let fits = self.runs[i].try_whole(c, start, period).is_ok() && self.can_be_given(i, period);
            *if fits { &mut low } else { &mut high } = part;
        }
        self.latch_part(i, low, &whole);
        self.parts[i].iter_mut().for_each(|part| part[0] = low);
        self.latched = whole;
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            self.count_release(bar.holder.0);
        }
        self.runs[i].try_whole(c, start, period)
    }

    /// Has a cluster meet a part of what others held for it.
    fn latch_part(&mut self, i: usize, part: f64, whole: &[f64]) {
        for bar in self.scene.bars.iter().filter(|b| b.other.0 == i) {
            let port = bar.other.1;
            self.runs[i].input[self.scene.clusters[i].ports[port].input] = part * whole[port];
        }
    }

    /// Whether what the step in a cluster's workspace has cross at its bars can be given by those who hold there, with
    /// what crossed their other bars until now.
    fn can_be_given(&mut self, i: usize, period: f64) -> bool {
        let scene = self.scene;
        [false, true].into_iter().all(|is_heat| {
            scene.bars.iter().filter(|b| b.other.0 == i).all(|bar| {
                let account = (bar.holder.0, is_heat);
                let drawn = -self.crosses_into(i, period, account);
                !(drawn > 0.0 && self.limited[account.0]) || self.left_now(account) >= drawn
            })
        })
    }

    /// The energy into the holder of a bar by the step in the other side's workspace, J.
    fn crosses(&self, bar: &Bar, period: f64) -> f64 {
        let (run, port) = (&self.runs[bar.other.0], &self.scene.clusters[bar.other.0].ports[bar.other.1]);
        run.input[port.input] * (period * run.output()[port.mean])
    }

    /// The same into an account of a holder.
    fn crosses_into(&self, i: usize, period: f64, (holder, is_heat): (usize, bool)) -> f64 {
        let bars = self.scene.bars.iter().enumerate();
        let own = bars.filter(|(k, b)| {
            b.other.0 == i && b.holder.0 == holder && self.held_of_bar(*k).is_some_and(|p| p.is_thermal == is_heat)
        });
        own.map(|(_, b)| self.crosses(b, period)).sum()
    }

    /// Whether what crosses a bar is heat to the other side.
    fn is_heat_there(&self, bar: &Bar) -> bool {
        let (cluster, port) = bar.other;
        let c = &self.scene.clusters[cluster];
        let port = &c.ports[port];
        port.is_thermal && c.entries.iter().any(|e| e.region == port.region && e.work.is_some())
    }

    /// What a cluster can still give at the end of its interval, whose step is in its workspace, J.
    fn left_at_end(&self, i: usize, is_heat: bool) -> f64 {
        let (c, Run { layout, ledger, .. }) = (&self.scene.clusters[i], &self.runs[i]);
        let held = layout.held.iter().filter(|p| p.is_thermal == is_heat);
        let crossed: f64 = held.map(|p| ledger.get(p.crossed)).sum();
        let own = self.runs[i].supplied(c)[usize::from(is_heat)];
        let (m, sampling) = (Real::new(), self.sampling(i));
        let there = match is_heat {
            true => interval::heat(m, sampling, layout),
            false => interval::stored(m, sampling, layout),
        };
        (there + crossed + own.max(0.0) + interval::slack(m, sampling, layout)).max(0.0)
    }
}
