//! How the other side of a double bar answers where it is now: the port admittance of what is not linear, anew at each
//! sample.
//!
//! At the start of a run the answer is measured with all care. A sample can't take so long. So it takes as few steps an
//! interval as all but give that answer at the start, about what is held and the motion of now; what their answer has
//! become since then, as a ratio, the answer has become. So has what follows in the intervals after: of a body that is
//! lighter now, all of its motion is larger.

use super::hold::Tangent;
use super::schedule::Simulation;
use crate::energy::AR_ORDER;

/// What is held more and less, as a part of what is held, or of what would stop the motion of now if that is more.
/// Between the square of it, which a curved law adds, and the rounding of the motion over it.
const CHANGE: f64 = 1e-4;
/// Steps of an interval at most.
const STEPS: usize = 8;
/// What they give is the answer, but for this part of the largest.
const AGREES: f64 = 1e-3;

impl Simulation<'_> {
    /// Whether what a cluster holds is found from the other side's answer at all, and that can be taken anew: of its
    /// own clock's intervals.
    fn is_matched(&self, i: usize) -> bool {
        self.scene.clusters[i].respond.as_ref().is_some_and(|r| r.fallback.is_some()) && self.transitions[i].is_none()
    }

    /// How the answer of another side is taken anew, which was measured at the start by a change of `probe`; None where
    /// that is not needed, or takes more steps than a sample has.
    pub(super) fn tangent(&mut self, i: usize, (other, held): (usize, &[usize]), probe: f64) -> Option<Tangent> {
        let c = &self.scene.clusters[other];
        if !(self.is_matched(i) && c.has_changing_response) {
            return None;
        }
        let n = self.held[i].len();
        let size = |list: &[f64]| list.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let measured: Vec<f64> = held
            .iter()
            .flat_map(|a| held.iter().map(move |b| (a, b)))
            .map(|(a, b)| self.port_admittance[i][a * n + b])
            .collect();
        let (state, input) = (self.runs[other].state.clone(), self.runs[other].input.clone());
        let answers = vec![0.0; held.len() * held.len()];
        let first = answers.clone();
        let mut tangent = Tangent { other, held: held.to_vec(), steps: 1, state, input, answers, first, measured };
        while tangent.steps <= STEPS {
            let found = self.look_along(i, &mut tangent, 0.0, Some(probe)).is_some();
            let (mut pairs, size) = (tangent.answers.iter().zip(&tangent.measured), size(&tangent.measured));
            if found && pairs.all(|(x, y)| (x - y).abs() <= AGREES * size) {
                tangent.first.clone_from(&tangent.answers);
                return Some(tangent);
            }
            tangent.steps *= 2;
        }
        None
    }

    /// Whether answers are taken anew at all.
    pub(super) fn takes_tangents(&self) -> bool {
        self.tangents.iter().any(|list| !list.is_empty())
    }

    /// Takes the answers of the other sides of a cluster anew.
    pub(super) fn take_tangents(&mut self, i: usize, at: f64) {
        let mut list = std::mem::take(&mut self.tangents[i]);
        for tangent in &mut list {
            if self.look_along(i, tangent, at, None).is_some() {
                self.put_answers(i, tangent);
            }
        }
        self.tangents[i] = list;
    }

    fn put_answers(&mut self, i: usize, tangent: &Tangent) {
        let n = self.held[i].len();
        for (r, a) in tangent.held.iter().enumerate() {
            for (s, b) in tangent.held.iter().enumerate() {
                let at = r * tangent.held.len() + s;
                let (answer, first) = (tangent.answers[at], tangent.first[at]);
                let now = if first == 0.0 { answer } else { tangent.measured[at] * (answer / first) };
                let before = std::mem::replace(&mut self.port_admittance[i][a * n + b], now);
                let ratio = if before == 0.0 { 1.0 } else { now / before };
                for p in 0..AR_ORDER {
                    self.delayed_response[i][(p * n + a) * n + b] *= ratio;
                }
                // What it did by itself in the intervals before is seen by the same answer.
                let (of, by) = (self.held_places(i, *a), self.held_places(i, *b));
                let ledger = &self.runs[i].ledger;
                for p in 0..AR_ORDER + 2 {
                    let at = of.free_response.plus(p);
                    ledger.set(at, ledger.get(at) + (now - before) * ledger.get(by.before.plus(p)));
                }
            }
        }
    }

    /// Finds the answers to a change of what is held, over an interval from now; None where a step fails, nothing tells
    /// how large a change is small, or a port does not give way.
    fn look_along(&mut self, i: usize, tangent: &mut Tangent, at: f64, probe: Option<f64>) -> Option<()> {
        let iterations = self.runs[tangent.other].step.work.newton_iterations;
        tangent.answers.fill(0.0);
        let mut done = Some(());
        for s in 0..tangent.held.len() {
            let Some(change) = probe.or_else(|| self.change(i, tangent.held[s])) else {
                done = None;
                break;
            };
            for sign in [1.0, -1.0] {
                done = done.and(self.answer(i, tangent, (s, sign * change), at));
            }
        }
        self.runs[tangent.other].step.work.newton_iterations = iterations;
        let m = tangent.held.len();
        let is_good = tangent.answers.iter().all(|x| x.is_finite()) && (0..m).all(|k| tangent.answers[k * m + k] > 0.0);
        done.filter(|()| is_good)
    }

    /// What is held more and less at a port.
    fn change(&self, i: usize, k: usize) -> Option<f64> {
        let (p, ledger) = (self.held_places(i, k), &self.runs[i].ledger);
        let n = self.held[i].len();
        let stops = ledger.get(p.last_q).abs() / self.port_admittance[i][k * n + k];
        let size = ledger.get(p.v).abs().max(if stops.is_finite() { stops } else { 0.0 });
        (size > 0.0).then_some(CHANGE * size)
    }

    /// Adds what a change at one port makes the other side answer.
    fn answer(&mut self, i: usize, tangent: &mut Tangent, (s, change): (usize, f64), at: f64) -> Option<()> {
        let scene = self.scene;
        let (holder, c) = (&scene.clusters[i], &scene.clusters[tangent.other]);
        let period = holder.period?;
        let bar = |k: usize| self.held[i][k].bar.map(|b| &scene.bars[b]);
        let run = &mut self.runs[tangent.other];
        tangent.state.copy_from_slice(&run.state);
        tangent.input.copy_from_slice(&run.input);
        let own = bar(tangent.held[s])?;
        let place = c.ports[own.other.1].input;
        let met = tangent.input[place];
        let mut begin = at;
        for (length, arrived) in [(holder.latency, 0.0), (period - holder.latency, 1.0)] {
            if length <= 0.0 {
                continue;
            }
            let h = length / tangent.steps as f64;
            run.step.prepare(h).ok()?;
            tangent.input[place] = met + own.sign * arrived * change;
            tangent.input[1] = h;
            for k in 0..tangent.steps {
                tangent.input[0] = begin + k as f64 * h;
                run.step.run(&tangent.state, &tangent.input).ok()?;
                tangent.state.copy_from_slice(&run.step.work.next);
                for (r, a) in tangent.held.iter().enumerate() {
                    let there = bar(*a)?;
                    let q = there.sign * h * run.step.work.output[c.ports[there.other.1].mean];
                    // The free response less what gives way is the answer.
                    tangent.answers[r * tangent.held.len() + s] -= q / (2.0 * change);
                }
            }
            begin += length;
        }
        Some(())
    }
}
