//! How the other side of a double bar answers to what is held, measured at the start of a run by its own stepper.

use super::cluster::Run;
use super::schedule::Simulation;
use crate::energy::{AR_COEFFICIENTS, AR_ORDER};
use crate::scene::{Bar, Cluster};

/// Intervals after that of the hold that are looked at: as many as weights are found from, and as many again to see
/// whether they hold.
const LATER: usize = 3 * AR_ORDER;
/// How well a recurrence has to give what was measured, as a part of the largest of it: where the answer is linear, and
/// where it is a difference quotient.
const FITS: [f64; 2] = [1e-9, 1e-6];
/// Steps of an interval where none is exact, at first, and how often they are halved at most.
const STEPS: usize = 8;
const HALVINGS: usize = 7;
/// What two answers agree to, as a part of the largest.
const AGREES: f64 = 1e-11;
/// States times steps that a measurement may take: some milliseconds.
const EFFORT: usize = 400_000;

/// The same of a sampled side, whose steps are given: some tenths of a second.
const SAMPLES: usize = 10_000_000;
/// What is held more and less where the other side is not linear, at first, and the part of it that is tried next, so
/// often at most, until it makes no more of a change than that: what is large depends on the scene. Where friction
/// holds, or soon will, it is made larger by that instead, and then by so many times as long as the answer grows by so
/// much.
const PROBE: f64 = 1e-3;
const FINER: f64 = 1e-3;
const MORE: f64 = 10.0;
const GROWS: f64 = 1.01;
const LOOKS: usize = 4;
const SAME: f64 = 1e-3;
/// Of a difference of two answers this part of their size is rounding; and all of one that is no larger than this, by
/// which stages of what friction holds differ.
const ROUNDED: f64 = 64.0 * f64::EPSILON;
const DUST: f64 = 1e-30;
/// An answer so many times that about what is held at the start is none.
const BEYOND: f64 = 100.0;

/// Of samples so close before one, as a part of the latency, it is that one at which something arrives.
const SAMPLE: f64 = 1e-12;

/// By interval, a matrix of the ports.
type Answers = Vec<Vec<f64>>;
/// How long something is held, and how long after an interval's start it arrives, s.
type Pulse = (f64, f64);

impl Simulation<'_> {
    /// Measures how the other sides of a sampled cluster's ports respond: the port admittance, by which the answer over
    /// a period falls with what is held; the delayed response, by which those over the next ones do, apart from what
    /// follows from the answers before; and the autoregressive model that says what follows.
    pub(super) fn measure_port_admittance(&mut self, i: usize) {
        let n = self.held[i].len();
        let own = self.scene.clusters[i].period.unwrap_or(0.0);
        // Of who goes by another's clock the answer to one interval of that is measured, which begins when that does.
        let (period, latency) =
            self.transitions[i].as_ref().map_or((own, self.scene.clusters[i].latency), |p| (p.step, 0.0));
        let mut port_admittance = vec![0.0; n * n];
        let mut delayed_response = vec![0.0; AR_ORDER * n * n];
        let mut ar_coefficients = vec![0.0; AR_COEFFICIENTS * n];
        for r in ar_coefficients.chunks_mut(AR_COEFFICIENTS) {
            (r[0], r[AR_ORDER], r[AR_ORDER + 1]) = (1.0, 1.0, 1.0);
        }
        let mut others: Vec<usize> =
            self.held[i].iter().filter_map(|h| h.bar).map(|b| self.scene.bars[b].other.0).collect();
        others.sort_unstable();
        others.dedup();
        let calls = self.calls(i);
        let mut anew = Vec::new();
        for other in others {
            let mine: Vec<usize> =
                (0..n).filter(|k| self.held[i][*k].bar.is_some_and(|b| self.scene.bars[b].other.0 == other)).collect();
            let bars: Vec<&Bar> =
                mine.iter().filter_map(|k| self.held[i][*k].bar).map(|b| &self.scene.bars[b]).collect();
            let ports: Vec<usize> = bars.iter().map(|b| b.other.1).collect();
            let c = &self.scene.clusters[other];
            let about: Vec<f64> = mine.iter().zip(&bars).map(|(k, bar)| bar.sign * calls[*k]).collect();
            let (answers, probe) = self.runs[other].measured(c, (period, latency), &ports, &about);
            let m = mine.len();
            // q = sign * integral, input = sign * v, and q is the free response less the port admittance times v.
            let fall = |interval: usize, r: usize, s: usize| {
                -bars[r].sign * bars[s].sign * answers.get(interval).map_or(0.0, |x| x[r * m + s])
            };
            for (r, &a) in mine.iter().enumerate() {
                let own: Vec<f64> = (1..answers.len()).map(|j| fall(j, r, r)).collect();
                let rule = recurrence(&own, FITS[usize::from(!c.is_linear)]);
                for (s, &b) in mine.iter().enumerate() {
                    port_admittance[a * n + b] = fall(0, r, s);
                    for p in 0..rule[AR_ORDER + 1] as usize {
                        let follows: f64 = (0..p).map(|j| rule[j] * fall(p - j, r, s)).sum();
                        delayed_response[(p * n + a) * n + b] = fall(p + 1, r, s) - follows;
                    }
                }
                ar_coefficients[a * AR_COEFFICIENTS..(a + 1) * AR_COEFFICIENTS].copy_from_slice(&rule);
            }
            anew.extend(probe.map(|probe| (other, mine, probe)));
        }
        for (k, h) in self.held[i].iter().enumerate() {
            if let Some(inertia) = h.open.and_then(|o| self.scene.open[o].inertia) {
                // A mass that is pushed from the latency on, and for a period.
                let rest = period - latency;
                port_admittance[k * n + k] = rest * rest / (2.0 * inertia);
                delayed_response[k * n + k] = period * period / inertia - latency * latency / (2.0 * inertia);
                if latency > 0.0 {
                    delayed_response[(n + k) * n + k] = latency * latency / (2.0 * inertia);
                    ar_coefficients[k * AR_COEFFICIENTS + AR_ORDER + 1] = 2.0;
                }
            }
        }
        for k in 0..n {
            // A passive other side yields; rounding must not make it push.
            port_admittance[k * n + k] =
                if port_admittance[k * n + k].is_finite() { port_admittance[k * n + k].max(0.0) } else { 0.0 };
        }
        if let Some(p) = &mut self.transitions[i] {
            p.find_port_admittances(n, &port_admittance, &delayed_response, &ar_coefficients);
        }
        self.port_admittance[i] = port_admittance;
        self.delayed_response[i] = delayed_response;
        self.ar_coefficients[i] = ar_coefficients;
        let tangents = anew.iter().filter_map(|(other, held, probe)| self.tangent(i, (*other, held), *probe));
        self.tangents[i] = tangents.collect();
    }
}

impl Simulation<'_> {
    /// What a cluster's ports call for while nothing moves; 0 where that is no number.
    fn calls(&mut self, i: usize) -> Vec<f64> {
        let (c, n) = (&self.scene.clusters[i], self.held[i].len());
        if c.respond.is_none() {
            return vec![0.0; n];
        }
        let mut input = self.respond_input[i].clone();
        let own = self.runs[i].input.len();
        input[..own].copy_from_slice(&self.runs[i].input);
        input[1] = c.period.unwrap_or(0.0);
        let run = &mut self.runs[i];
        let found = run.respond.as_mut().and_then(|look| Some(look.run(&run.state, &input).ok()?[..n].to_vec()));
        let mut calls = found.unwrap_or_else(|| vec![0.0; n]);
        calls.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
        calls
    }
}

impl Run {
    /// The answer ([`Self::response`]) about 0, or `about` what is held at the start where there is none, or one beyond
    /// all others; where friction holds within the hold, to a change that is large enough. And the change that gave it,
    /// where it is in proportion to one about 0 and may be another one later.
    fn measured(&mut self, c: &Cluster, hold: Pulse, ports: &[usize], about: &[f64]) -> (Answers, Option<f64>) {
        let zero = vec![0.0; ports.len()];
        if c.is_linear {
            return (self.response(c, hold, (ports, &zero), 1.0), None);
        }
        let size = |a: &Answers| a.first().map_or(0.0, |m| largest(m));
        let (mut answers, small) = self.in_proportion(c, hold, (ports, &zero));
        let mut about_0 = Some(small);
        if about.iter().any(|v| *v != 0.0) {
            // About 0 a law may have no answer, or one beyond all others, as a conductor of heat at 0 K.
            let (there, _) = self.in_proportion(c, hold, (ports, about));
            if size(&there) > 0.0 && (answers.is_empty() || size(&answers) > BEYOND * size(&there)) {
                (answers, about_0) = (there, None);
            }
        }
        // What friction brings to rest within the hold answers as little as it has way left, and what it holds,
        // nothing.
        let rests = |a: &Answers| size(a) == 0.0 || c.states > 0 && a.iter().skip(1).flatten().all(|x| *x == 0.0);
        let mut probe = PROBE;
        for _ in 0..LOOKS {
            if !rests(&answers) {
                break;
            }
            probe /= FINER;
            let mut larger = self.response(c, hold, (ports, about), probe);
            if size(&larger) <= size(&answers) {
                continue;
            }
            // Of a change that just overcomes what holds, most is held.
            for _ in 0..LOOKS {
                probe *= MORE;
                let more = self.response(c, hold, (ports, about), probe);
                let grows = size(&more) > GROWS * size(&larger);
                if size(&more) > size(&larger) {
                    larger = more;
                }
                if !grows {
                    break;
                }
            }
            (answers, about_0) = (larger, None);
        }
        (answers, about_0)
    }

    /// The answer to a change so small that a smaller one makes no other, and that change.
    fn in_proportion(&mut self, c: &Cluster, hold: Pulse, at: (&[usize], &[f64])) -> (Answers, f64) {
        let mut probe = PROBE;
        let first = self.response(c, hold, at, probe);
        let mut answers = first.clone();
        for _ in 0..LOOKS {
            probe *= FINER;
            let finer = self.response(c, hold, at, probe);
            let most = finer.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
            let pairs = || answers.iter().flatten().zip(finer.iter().flatten());
            if finer.len() == answers.len() && pairs().all(|(x, y)| (x - y).abs() <= SAME * most) {
                return (answers, probe / FINER);
            }
            answers = finer;
        }
        (first, PROBE)
    }

    /// How this cluster answers to what is held at `ports` for one period, from the latency on, and then let go, about
    /// some values that are held all the time: for the interval in which the hold begins and some after it, a matrix of
    /// the change, with each held input, of the integral of what each port gives out. Empty where a step fails.
    ///
    /// `probe` is the size of the change. Where its steps have an error, they are halved, and what they give is
    /// extrapolated (Romberg), until it changes no more: the answer is the region's, not its stepper's.
    fn response(
        &mut self,
        c: &Cluster,
        (period, latency): Pulse,
        (ports, about): (&[usize], &[f64]),
        probe: f64,
    ) -> Answers {
        let at = (ports, about, probe);
        let later = if EFFORT / (LATER * STEPS * ports.len()) < self.state.len() { 2 } else { LATER };
        if let Some(own) = c.period {
            let steps = (period / own).round().max(1.0);
            let most =
                |later: usize| (SAMPLES / (2 * (later + 1) * ports.len() * self.state.len().max(1))).max(1) as f64;
            let later = if steps > most(later) { 2 } else { later };
            // Of an interval of more samples than that the begin has to tell. What arrives between two is met at the
            // later one.
            let steps = steps.min(most(later));
            let late = (latency / own * (1.0 - SAMPLE)).ceil().min(steps);
            let parts = [(own, late as usize), (own, (steps - late) as usize)];
            return self.answers(c, (period, parts), at, later).unwrap_or_default();
        }
        let laid = |steps: usize| {
            [latency, period - latency].map(|length| match length > 0.0 {
                true => (length / steps as f64, steps),
                false => (0.0, 0),
            })
        };
        if c.step.linear.is_some() && c.step.properties.order == 0 {
            return self.answers(c, (period, laid(1)), at, later).unwrap_or_default();
        }
        // Of a symmetric method the error has even powers of the step only; taken for one that is not, these are none.
        let order = c.step.properties.order.max(1);
        let each = 2 - order % 2;
        let (mut rows, mut best): (Vec<Answers>, Option<(f64, Answers)>) = (Vec::new(), None);
        let mut left = EFFORT / self.state.len().max(1);
        for halved in 0..=HALVINGS {
            let steps = STEPS << halved;
            let cost = steps * (later + 1) * 2 * ports.len();
            if halved > 0 && cost > left {
                break;
            }
            left = left.saturating_sub(cost);
            let Some(mut now) = self.answers(c, (period, laid(steps)), at, later) else { break };
            let mut row = vec![now.clone()];
            for (k, coarse) in rows.iter().enumerate() {
                let gain = 2.0f64.powi((order + each * k as u32) as i32) - 1.0;
                for (x, y) in now.iter_mut().flatten().zip(coarse.iter().flatten()) {
                    *x += (*x - y) / gain;
                }
                row.push(now.clone());
            }
            rows = row;
            let size = now.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
            let change = best.as_ref().map_or(f64::INFINITY, |(_, last)| {
                last.iter().flatten().zip(now.iter().flatten()).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()))
            });
            // What has come down to rounding only gets worse.
            if best.as_ref().is_some_and(|(least, _)| change > *least && *least <= 1e-6 * size) {
                break;
            }
            best = Some((change, now));
            if change <= AGREES * size {
                break;
            }
        }
        best.map(|b| b.1).unwrap_or_default()
    }

    /// The same with steps of one length, so many in an interval before what is held arrives, and so many after that.
    fn answers(
        &mut self,
        c: &Cluster,
        (period, parts): (f64, [(f64, usize); 2]),
        (ports, about, probe): (&[usize], &[f64], f64),
        later: usize,
    ) -> Option<Answers> {
        let n = ports.len();
        let mut matrices = vec![vec![0.0; n * n]; later + 1];
        let mut sizes = matrices.clone();
        let iterations = self.step.work.newton_iterations;
        for (j, held) in ports.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let mut state = if c.is_linear { vec![0.0; self.state.len()] } else { self.state.clone() };
                let mut input = self.input.clone();
                for p in &c.ports {
                    input[p.input] = 0.0;
                }
                for (p, v) in ports.iter().zip(about) {
                    input[c.ports[*p].input] = *v;
                }
                for (interval, (matrix, size)) in matrices.iter_mut().zip(&mut sizes).enumerate() {
                    let mut begin = interval as f64 * period;
                    for (part, (h, steps)) in parts.into_iter().enumerate().filter(|(_, (_, steps))| *steps > 0) {
                        // Before it arrives, in the next interval, it is held yet.
                        let is_held = interval == usize::from(part == 0);
                        input[c.ports[*held].input] = about[j] + if is_held { sign * probe } else { 0.0 };
                        input[1] = h;
                        self.step.prepare(h).ok()?;
                        for k in 0..steps {
                            input[0] = begin + k as f64 * h;
                            self.step.run(&state, &input).ok()?;
                            state.copy_from_slice(&self.step.work.next);
                            for (i, p) in ports.iter().enumerate() {
                                let q = h * self.step.work.output[c.ports[*p].mean];
                                matrix[i * n + j] += sign * q / (2.0 * probe);
                                size[i * n + j] += q.abs() / (2.0 * probe);
                            }
                        }
                        begin += steps as f64 * h;
                    }
                }
            }
        }
        self.step.work.newton_iterations = iterations;
        for (x, size) in matrices.iter_mut().flatten().zip(sizes.iter().flatten()).filter(|_| !c.is_linear) {
            if x.abs() <= (ROUNDED * size).max(DUST) {
                *x = 0.0;
            }
        }
        Some(matrices)
    }
}

/// The largest number of a matrix, by its size; what is no number counts for none.
fn largest(matrix: &[f64]) -> f64 {
    matrix.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// The recurrence that a row of answers obeys: with the fewest weights, up to [`AR_ORDER`], that give it to `fits` of
/// its largest. Where none do, one weight, what is left of a motion after the first interval.
fn recurrence(answers: &[f64], fits: f64) -> [f64; AR_COEFFICIENTS] {
    let (first, second) = (answers.first().copied().unwrap_or(0.0), answers.get(1).copied().unwrap_or(0.0));
    let left = if first == 0.0 { 1.0 } else { second / first };
    let left = if left.is_finite() { left.clamp(0.0, 1.0) } else { 1.0 };
    let mut one = [0.0; AR_COEFFICIENTS];
    (one[0], one[AR_ORDER], one[AR_ORDER + 1]) = (left, left, 1.0);
    let size = answers.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let obeys = |rule: &[f64; AR_COEFFICIENTS]| {
        let order = rule[AR_ORDER + 1] as usize;
        (order..answers.len()).all(|j| {
            let told: f64 = (0..order).map(|p| rule[p] * answers[j - 1 - p]).sum();
            (told - answers[j]).abs() <= fits * size
        })
    };
    if obeys(&one) {
        return one;
    }
    (2..=AR_ORDER)
        .filter(|order| answers.len() > 2 * order)
        .find_map(|order| {
            let mut rule = one;
            rule[AR_ORDER + 1] = order as f64;
            weights(answers, &mut rule[..order])?;
            obeys(&rule).then_some(rule)
        })
        .unwrap_or(one)
}

/// Solves for the weights that give the first answers each from those before; None where they leave them open.
fn weights(answers: &[f64], rule: &mut [f64]) -> Option<()> {
    let n = rule.len();
    let mut m = [[0.0; AR_ORDER + 1]; AR_ORDER];
    for (r, row) in m.iter_mut().take(n).enumerate() {
        for p in 0..n {
            row[p] = answers[n + r - 1 - p];
        }
        row[n] = answers[n + r];
    }
    for k in 0..n {
        let pivot = (k..n).max_by(|a, b| m[*a][k].abs().total_cmp(&m[*b][k].abs()))?;
        m.swap(k, pivot);
        for r in k + 1..n {
            let part = m[r][k] / m[k][k];
            let above = m[k];
            m[r].iter_mut().zip(above).skip(k).for_each(|(x, y)| *x -= part * y);
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| m[k][j] * rule[j]).sum();
        rule[k] = (m[k][n] - known) / m[k][k];
    }
    rule.iter().all(|x| x.is_finite()).then_some(())
}

#[cfg(test)]
mod tests {
    use super::{AR_COEFFICIENTS, AR_ORDER, recurrence};

    /// The fewest weights that tell each answer from those before: one of what dies out, two of what swings, and where
    /// nothing answers, all of a motion is left.
    #[test]
    fn the_shortest_recurrence_is_found() {
        let answers = |of: fn(i32) -> f64| (0..=2 * AR_ORDER as i32 + 1).map(of).collect::<Vec<f64>>();
        let found = |of: fn(i32) -> f64| recurrence(&answers(of), 1e-9);
        let rule = |weights: &[f64], left: f64| {
            let mut rule = [0.0; AR_COEFFICIENTS];
            rule[..weights.len()].copy_from_slice(weights);
            (rule[AR_ORDER], rule[AR_ORDER + 1]) = (left, weights.len() as f64);
            rule
        };
        assert_eq!(found(|k| 3.0 * 0.25f64.powi(k)), rule(&[0.25], 0.25));
        assert_eq!(found(|_| 0.0), rule(&[1.0], 1.0));
        let (swings, wanted) = (found(|k| (0.5 * f64::from(k)).cos()), rule(&[2.0 * 0.5f64.cos(), -1.0], 0.5f64.cos()));
        assert!(swings.iter().zip(wanted).all(|(x, y)| (x - y).abs() < 1e-12), "{swings:?}, {wanted:?}");
    }
}
