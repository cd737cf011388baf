//! The budget within the interval: a sampled region lets go of what it holds where the other sides of its bars would
//! draw more than it has to give.
//!
//! What its next sample is too late to see is seen on the way. Over an interval that begins at kT, the energy into a
//! holder by its bars is `W(t) = Σ e_j (q_j(t) - q_j(kT))`. At the first instant at which it falls to `-S`, which is
//! what there is to give, all held variables become 0 until the next sample. So W goes no further.
//! (`docs/theory/budget.md` says what follows.)
//!
//! The continuous clusters that meet one holder go to that instant together. Where it is has to be known before anybody
//! looks beyond it: the way to the next sample is first tried, from a copy of what the clusters keep. Between the ends
//! of two steps, W is taken as the cubic through its values and rates at both; where that dips to `-S`, and at the
//! instant itself, W is had by steps to there.

use super::Error;
use super::cluster::Run;
use super::hold::LetGo;
use super::joined::{Account, Foreseen, Joined, Member, Release};
use super::schedule::Simulation;
use crate::energy::{HeldPlaces, interval};
use crate::machine::Real;
use crate::scene::Cluster;

/// A step by which the fastest motion turns further than this, rad, is looked into: a cubic follows no more of it.
const TURN: f64 = 1.0;
/// Into how many pieces at most.
const PIECES: f64 = 64.0;
/// Rounds of a search on the way.
const ROUNDS: u32 = 60;
/// Part of the way between two looks to which the place where W is least is found. Around it W is even, so that W
/// itself is found to the square of that.
const LEAST: f64 = 1e-7;
/// Instants closer to one another than this part of themselves are one.
const SAME: f64 = 1e-12;

/// Where on the way something may happen.
enum Found {
    /// An account is overdrawn at the second instant, and not at the first.
    Short([f64; 2], Account),
    /// W may be least between these, and overdrawn there; which of the accounts it is.
    Dip([f64; 2], usize),
}

impl Simulation<'_> {
    /// Whether steps have to be looked into.
    pub(super) fn looks_within(&self) -> bool {
        let mut clusters = self.joined.iter().flat_map(Joined::clusters);
        clusters.any(|i| pieces(&self.scene.clusters[i], self.runs[i].h) > 1.0)
    }

    /// Brings the continuous clusters of a group to the next sample of any region.
    pub(super) fn meet_joined(&mut self, g: usize, at: f64) -> Result<(), Error> {
        let mut group = std::mem::take(&mut self.joined[g]);
        let result = self.go_on(&mut group, (at, at), true);
        self.joined[g] = group;
        result
    }

    /// Takes the steps of a group that end at `until` or before it; the next sample is at `end`.
    pub(super) fn run_joined(&mut self, g: usize, until: f64, end: f64) -> Result<(), Error> {
        let mut group = std::mem::take(&mut self.joined[g]);
        let result = self.go_on(&mut group, (until, end), false);
        self.joined[g] = group;
        result
    }

    fn go_on(&mut self, group: &mut Joined, (until, end): (f64, f64), meets: bool) -> Result<(), Error> {
        self.begin(group, end);
        loop {
            let known = group.foreseen.filter(|f| f.until == end).map(|f| f.release);
            let release = match known {
                Some(release) => release,
                None if !self.is_at_stake(group) => None,
                None => match self.foresee(group, end, meets)? {
                    None if meets => return Ok(()),
                    found => found,
                },
            };
            group.foreseen = Some(Foreseen { until: end, release });
            match release.filter(|r| r.at <= until * (1.0 + SAME)) {
                Some(release) => {
                    self.bring(group, release.at)?;
                    self.let_go(release);
                    group.forget();
                    group.clusters().for_each(|i| self.stepping[i].lay(&mut self.runs[i], end));
                }
                None => {
                    return group.clusters().try_for_each(|i| {
                        let (c, run, moved) = (&self.scene.clusters[i], &mut self.runs[i], &mut self.moved[i]);
                        match meets {
                            true => self.stepping[i].finish_at(run, c, end, moved),
                            false => self.stepping[i].run_past(run, c, until, moved),
                        }
                    });
                }
            }
        }
    }

    /// Lays the steps to the next sample, where they begin now.
    fn begin(&mut self, group: &Joined, end: f64) {
        for i in group.clusters() {
            if self.runs[i].time() <= self.last_sample * (1.0 + SAME) {
                self.stepping[i].lay(&mut self.runs[i], end);
            }
        }
    }

    /// Whether anything is held at the bars of a group: else nothing crosses.
    fn is_at_stake(&self, group: &Joined) -> bool {
        group.members.iter().flat_map(|m| &m.bars).any(|b| self.met(&self.scene.bars[*b]) != 0.0)
    }

    /// The same at those of an account: where nothing is held, what its sources take back is no draw.
    fn holds_at(&self, group: &Joined, account: Account) -> bool {
        let bars = group.members.iter().flat_map(|m| &m.bars).filter(|b| self.is_of(account, **b));
        bars.into_iter().any(|b| self.held_at_bar(*b) != 0.0)
    }

    /// When a holder of a group lets go before `end`, if one does. The group stays where it is; where none does and it
    /// `meets` the end, it goes there.
    fn foresee(&mut self, group: &mut Joined, end: f64, meets: bool) -> Result<Option<Release>, Error> {
        for m in &mut group.members {
            m.kept.keep(&self.runs[m.cluster], &self.stepping[m.cluster], &self.moved[m.cluster]);
        }
        let tried = group.members.iter_mut().try_for_each(|m| self.try_way(m, end));
        let (mut from, mut looked) = ((f64::NEG_INFINITY, 0), false);
        while let Some(found) = self.next_of(group, from) {
            looked = true;
            let found = match found {
                Found::Short(way, account) => Some((way, account)),
                Found::Dip(way, which) => {
                    from = (way[0], which + 1);
                    let account = group.account(which);
                    self.dip(group, way, account).map(|way| (way, account))
                }
            };
            if let Some((way, account)) = found {
                let release = self.locate(group, way, account);
                self.go_back(group);
                return Ok(Some(release));
            }
        }
        if tried.is_err() && meets && !looked {
            return tried.map(|()| None);
        }
        if !meets || looked {
            self.go_back(group);
        }
        if meets && looked {
            group.clusters().try_for_each(|i| {
                let (c, run) = (&self.scene.clusters[i], &mut self.runs[i]);
                self.stepping[i].finish_at(run, c, end, &mut self.moved[i])
            })?;
        }
        Ok(None)
    }

    /// Goes to `end` step by step, and notes what goes through the ports.
    fn try_way(&mut self, m: &mut Member, end: f64) -> Result<(), Error> {
        m.times.clear();
        m.moved.clear();
        self.look(m);
        let (i, c) = (m.cluster, &self.scene.clusters[m.cluster]);
        let begin = self.runs[i].time();
        let h = self.runs[i].h.min(end - begin);
        let pieces = pieces(c, h);
        if pieces > 1.0 {
            let n = ((end - begin) / h * pieces).ceil();
            for k in 1..n as u32 {
                let at = begin + f64::from(k) / n * (end - begin);
                self.stepping[i].run_up_to(&mut self.runs[i], c, at, &mut self.moved[i])?;
                self.look(m);
            }
            m.kept.restore(&mut self.runs[i], &mut self.stepping[i], &mut self.moved[i]);
            self.stepping[i].finish_at(&mut self.runs[i], c, end, &mut self.moved[i])?;
            self.look(m);
            return Ok(());
        }
        while !self.stepping[i].step_towards(&mut self.runs[i], c, end, &mut self.moved[i])? {
            self.look(m);
        }
        self.look(m);
        Ok(())
    }

    /// Notes what went through a member's ports until now, and how fast it goes; where that cannot be told, it is no
    /// number.
    fn look(&mut self, m: &mut Member) {
        let (c, run) = (&self.scene.clusters[m.cluster], &mut self.runs[m.cluster]);
        let t = run.time();
        m.times.push(t);
        for b in &m.bars {
            m.moved.push([self.moved[m.cluster][self.scene.bars[*b].other.1], f64::NAN]);
        }
        let given = c.given_at()..c.traces_at();
        let before = m.moved.len() - m.bars.len();
        // The steps are told the time, and what is given from outside, anew.
        run.input[0] = t;
        if !given.is_empty() {
            run.signals.latch(&mut run.input, t);
        }
        if let Ok(out) = run.instant.run(&run.state, &run.input) {
            for (x, b) in m.moved[before..].iter_mut().zip(&m.bars) {
                x[1] = out[c.ports[self.scene.bars[*b].other.1].instant];
            }
        }
    }

    /// The first place on the way that was tried where an account may be overdrawn: from an instant on, and there from
    /// one of the accounts on.
    fn next_of(&mut self, group: &mut Joined, (from, first): (f64, usize)) -> Option<Found> {
        let mut looks = std::mem::take(&mut group.looks);
        looks.clear();
        looks.extend(group.members.iter().flat_map(|m| m.times.iter().copied()).filter(|t| *t >= from));
        looks.sort_unstable_by(f64::total_cmp);
        looks.dedup();
        let found = looks.windows(2).find_map(|way| {
            let way = [way[0], way[1]];
            let first = if way[0] == from { first } else { 0 };
            (first..group.accounts()).find_map(|which| {
                let account = group.account(which);
                if !self.holds_at(group, account) {
                    return None;
                }
                let [[x, f], [y, g]] = way.map(|t| self.drawn(group, account, t));
                let (left, room) = self.margin(account, y, |b| group.through(b, way[1]));
                if left < 0.0 {
                    return Some(Found::Short(way, account));
                }
                let h = way[1] - way[0];
                let least = interval::least_between(Real::new(), [x, f * h, y, g * h]);
                (least + room < 0.0).then_some(Found::Dip(way, which))
            })
        });
        group.looks = looks;
        found
    }

    /// W of an account at an instant of the way that was tried, J, and its rate.
    fn drawn(&self, group: &Joined, account: Account, t: f64) -> [f64; 2] {
        let mut sum = [self.booked(account), 0.0];
        for m in &group.members {
            for (k, b) in m.bars.iter().enumerate().filter(|(_, b)| self.is_of(account, **b)) {
                let (held, [moved, rate]) = (self.held_at_bar(*b), m.through(k, t));
                sum = [sum[0] + held * moved, sum[1] + if held == 0.0 { 0.0 } else { held * rate }];
            }
        }
        sum
    }

    /// The same now, W alone.
    fn drawn_now(&self, group: &Joined, account: Account) -> f64 {
        let bars = group.members.iter().flat_map(|m| &m.bars).filter(|b| self.is_of(account, **b));
        let moved = |b: &usize| {
            let (cluster, port) = self.scene.bars[*b].other;
            self.held_at_bar(*b) * self.moved[cluster][port]
        };
        self.booked(account) + bars.map(moved).sum::<f64>()
    }

    /// What crossed an account's bars in the interval that runs, as far as it was handed over.
    fn booked(&self, account: Account) -> f64 {
        let Run { layout, ledger, .. } = &self.runs[account.holder];
        layout.held.iter().filter(|p| p.is_thermal == account.is_heat).map(|p| ledger.get(p.w)).sum()
    }

    /// Places of what is held at a bar.
    pub(super) fn held_of_bar(&self, bar: usize) -> Option<&HeldPlaces> {
        let (holder, port) = self.scene.bars[bar].holder;
        self.runs[holder].layout.held.iter().find(|p| p.port == port)
    }

    fn is_of(&self, account: Account, bar: usize) -> bool {
        self.scene.bars[bar].holder.0 == account.holder
            && self.held_of_bar(bar).is_some_and(|p| p.is_thermal == account.is_heat)
    }

    /// What is left at W, and what there is to give until the next sample: with what the holder's own sources put in by
    /// then where the other sides move no further, where that counts. `moved` is what went through a bar's port since
    /// it was handed over.
    fn margin(&mut self, account: Account, w: f64, moved: impl Fn(usize) -> f64) -> (f64, f64) {
        let Account { holder, is_heat } = account;
        let there = |own: [f64; 2], sim: &Self| {
            let there =
                interval::rooms(Real::new(), sim.sampling(holder), &sim.runs[holder].layout, own)[usize::from(is_heat)];
            (there - sim.miscounted(account)).max(0.0)
        };
        let mut room = there([0.0; 2], self);
        if w + room < 0.0 && self.counts_on_sources(holder) {
            let own = self.put_in(holder, moved);
            room = there(own, self);
        }
        (w + room, room)
    }

    /// What the energy may be wrong by that is counted over an interval at the bars of an account, whose encoders read
    /// each end of a motion to half a step.
    fn miscounted(&self, account: Account) -> f64 {
        let bars = (0..self.scene.bars.len()).filter(|b| self.scene.bars[*b].resolution > 0.0);
        bars.filter(|b| self.is_of(account, *b))
            .map(|b| self.scene.bars[b].resolution * self.held_at_bar(b).abs())
            .fold(0.0, |sum, x| sum + x)
    }

    /// What a holder has left of what there is to give, after what crossed its bars until now.
    pub(super) fn left_now(&mut self, (holder, is_heat): (usize, bool)) -> f64 {
        let account = Account { holder, is_heat };
        let w = self.booked(account);
        self.margin(account, w, |_| 0.0).0
    }

    /// Whether a holder draws on what its own sources put in within the interval. That is looked at until its end where
    /// all bars of the holder lead to continuous regions. Where one leads to a sampled region, a step may turn out
    /// another one; with a latency what is held changes; and an encoder reads another motion than there is. Then what
    /// they put in counts when it is known.
    fn counts_on_sources(&self, holder: usize) -> bool {
        let scene = self.scene;
        let sampled = |i: usize| scene.clusters[i].period.is_some();
        let sources = scene.clusters[holder].entries.iter().any(|e| e.sources().next().is_some());
        let is_looked_at = scene.bars.iter().all(|b| match (b.holder.0 == holder, b.other.0 == holder) {
            (true, _) => !sampled(b.other.0) && b.resolution == 0.0,
            (_, true) => !sampled(b.holder.0),
            (false, false) => true,
        });
        sources && is_looked_at && scene.clusters[holder].latency == 0.0
    }

    /// What a holder's own sources put in over its interval, as work and as heat, J, where the other sides have moved
    /// as they have until an instant, and move no further. 0 where that cannot be told.
    fn put_in(&mut self, holder: usize, moved: impl Fn(usize) -> f64) -> [f64; 2] {
        let last = self.next[holder].saturating_sub(1);
        let (start, period) = (self.instant(holder, last), self.length(holder, last));
        let c = &self.scene.clusters[holder];
        for k in 0..self.held[holder].len() {
            let (h, Run { layout, ledger, input, .. }) = (&self.held[holder][k], &mut self.runs[holder]);
            let p = &layout.held[k];
            let more = h.bar.map_or(0.0, |b| self.scene.bars[b].sign * moved(b));
            input[c.ports[p.port].input] = -(ledger.get(p.q) + h.got + more) / period;
        }
        self.runs[holder].supply(c, (start, period))
    }

    /// Goes back to where the way that was tried began.
    fn go_back(&mut self, group: &Joined) {
        for m in &group.members {
            let i = m.cluster;
            m.kept.restore(&mut self.runs[i], &mut self.stepping[i], &mut self.moved[i]);
        }
    }

    /// Brings all of a group to an instant.
    fn bring(&mut self, group: &Joined, at: f64) -> Result<(), Error> {
        group.clusters().try_for_each(|i| {
            let (c, run) = (&self.scene.clusters[i], &mut self.runs[i]);
            self.stepping[i].run_up_to(run, c, at, &mut self.moved[i])
        })
    }

    /// What is left to an account at an instant, by steps to there; nothing where a step fails.
    fn left_at(&mut self, group: &mut Joined, account: Account, t: f64) -> Option<f64> {
        self.go_back(group);
        self.bring(group, t).ok()?;
        Some(self.left_here(group, account))
    }

    /// The same at the instant that was reached.
    fn left_here(&mut self, group: &mut Joined, account: Account) -> f64 {
        let w = self.drawn_now(group, account);
        for m in &mut group.members {
            m.here.clear();
            m.here.extend(m.bars.iter().map(|b| self.moved[m.cluster][self.scene.bars[*b].other.1]));
        }
        self.margin(account, w, |bar| group.here(bar)).0
    }

    /// How fast W of an account changes at the instant that was reached.
    fn rate_now(&mut self, group: &mut Joined, account: Account) -> f64 {
        let mut rate = 0.0;
        for m in &mut group.members {
            let (looks, numbers) = (m.times.len(), m.moved.len());
            self.look(m);
            for (k, b) in m.bars.iter().enumerate().filter(|(_, b)| self.is_of(account, **b)) {
                rate += self.held_at_bar(*b) * m.moved[numbers + k][1];
            }
            m.times.truncate(looks);
            m.moved.truncate(numbers);
        }
        rate
    }

    /// Whether an account is overdrawn where W is least between two looks: then the way to there.
    fn dip(&mut self, group: &mut Joined, [begin, end]: [f64; 2], account: Account) -> Option<[f64; 2]> {
        let (mut low, mut high) = (begin, end);
        let [mut fall, mut rise] = [low, high].map(|t| self.drawn(group, account, t)[1]);
        for round in 0..ROUNDS {
            if high - low <= LEAST * (end - begin) {
                break;
            }
            let secant = low + (high - low) * fall / (fall - rise);
            let middle = 0.5 * (low + high);
            let t = if round % 3 < 2 && secant > low && secant < high { secant } else { middle };
            if self.left_at(group, account, t).is_none_or(|left| left < 0.0) {
                return Some([begin, t]);
            }
            let rate = self.rate_now(group, account);
            match rate < 0.0 {
                true => (low, fall) = (t, rate),
                false => (high, rise) = (t, rate),
            }
        }
        None
    }

    /// The last instant on the way at which no account is overdrawn, where one is at its end, and who lets go there.
    fn locate(&mut self, group: &mut Joined, [mut low, mut high]: [f64; 2], account: Account) -> Release {
        let mut account = account;
        let slack =
            |sim: &Self, a: Account| interval::slack(Real::new(), sim.sampling(a.holder), &sim.runs[a.holder].layout);
        let mut ends =
            [self.left_at(group, account, low), self.left_at(group, account, high)].map(|x| x.unwrap_or(-1.0));
        for round in 0..ROUNDS {
            // Who has nothing to give, and is given something first, lets go where that is drawn again.
            let is_given = self.drawn(group, account, low)[1] > 0.0;
            let closest = 4.0 * f64::EPSILON * high.abs();
            if high - low <= closest || (!is_given && (0.0..=slack(self, account)).contains(&ends[0])) {
                break;
            }
            let secant = low + (high - low) * ends[0] / (ends[0] - ends[1]);
            let middle = 0.5 * (low + high);
            let t = if !is_given && round % 3 < 2 && secant > low && secant < high { secant } else { middle };
            if t <= low || t >= high {
                break;
            }
            let Some(left) = self.left_at(group, account, t) else {
                (high, ends[1]) = (t, -ends[0].abs().max(f64::MIN_POSITIVE));
                continue;
            };
            // Another one may be overdrawn before.
            let first = (0..group.accounts()).find_map(|which| {
                let a = group.account(which);
                let counts = a != account && self.holds_at(group, a);
                let left = if counts { self.left_here(group, a) } else { 0.0 };
                (left < 0.0).then_some((a, left))
            });
            match first {
                _ if left < 0.0 => (high, ends[1]) = (t, left),
                Some((other, left)) => {
                    (account, high, ends[1]) = (other, t, left);
                    ends[0] = self.left_at(group, account, low).unwrap_or(0.0);
                }
                None => (low, ends[0]) = (t, left),
            }
        }
        Release { at: low, account }
    }

    /// Lets go of what an account's bars hold until the next sample.
    fn let_go(&mut self, Release { at, account }: Release) {
        self.hand_over_moved();
        let i = account.holder;
        let absorbed = self.runs[i].layout.accounts.iter().find_map(|p| p.absorbed);
        if let Some(at) = absorbed.filter(|_| self.counts_on_sources(i)) {
            let own = self.put_in(i, |_| 0.0)[usize::from(account.is_heat)];
            self.runs[i].ledger.set(at.counted_on.plus(usize::from(account.is_heat)), own.max(0.0));
        }
        let last = self.next[i].saturating_sub(1);
        let (period, latency) = (self.length(i, last), self.scene.clusters[i].latency);
        let since = at - self.instant(i, last);
        // What was found a sample before is held until the latency is over, and is known to have been held so long.
        let of_before = self.arrival(i).is_some();
        let part = if of_before { 1.0 + (since - latency) / period } else { (since - latency) / (period - latency) };
        let lasted = part.clamp(0.0, 1.0);
        for k in 0..self.held[i].len() {
            let p = &self.runs[i].layout.held[k];
            // What an outside holds is its own to let go of.
            let Some(b) = self.held[i][k].bar.filter(|_| p.is_thermal == account.is_heat) else { continue };
            let ledger = &self.runs[i].ledger;
            match of_before {
                true => ledger.set(p.before, lasted * ledger.get(p.before)),
                false => self.held[i][k].let_go = Some(LetGo { value: ledger.get(p.v), lasted }),
            }
            ledger.set(p.v, 0.0);
            let (cluster, port) = self.scene.bars[b].other;
            let other = &self.scene.clusters[cluster];
            if other.period.is_none() {
                self.runs[cluster].input[other.ports[port].input] = 0.0;
            }
        }
        self.count_release(i);
    }

    /// Counts that a cluster let go, or held less, within an interval.
    pub(super) fn count_release(&self, i: usize) {
        let Run { layout, ledger, .. } = &self.runs[i];
        layout.stake.releases.into_iter().for_each(|at| ledger.set(at, ledger.get(at) + 1.0));
    }
}

/// Into how many pieces a step of a length is looked into.
fn pieces(c: &Cluster, h: f64) -> f64 {
    (h * c.fastest_turn / TURN).ceil().clamp(1.0, PIECES)
}

impl Run {
    /// What a sampled cluster's own sources would put in over an interval with the inputs that it has, as work and as
    /// heat, J; 0 where its step fails.
    fn supply(&mut self, c: &Cluster, (start, period): (f64, f64)) -> [f64; 2] {
        (self.input[0], self.input[1]) = (start, period);
        let iterations = self.step.work.newton_iterations;
        let done = self.step.prepare(period).is_ok() && self.step.run(&self.state, &self.input).is_ok();
        self.step.work.newton_iterations = iterations;
        if !done {
            return [0.0; 2];
        }
        self.supplied(c)
    }

    /// What a cluster's own sources put in over the step in the workspace, as work and as heat, J.
    pub(super) fn supplied(&self, c: &Cluster) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for e in &c.entries {
            for i in e.sources() {
                let is_heat = e.work.as_ref().is_some_and(|w| w.heats.contains(&i));
                sums[usize::from(is_heat)] += self.output()[e.supplied[i].1];
            }
        }
        sums.map(|x| if x.is_finite() { x } else { 0.0 })
    }
}
