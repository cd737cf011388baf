//! Continuous clusters and the sampled ones that hold for them under a budget, and the way to the next sample that they
//! try.

use super::kept::Kept;
use crate::scene::Scene;

/// Continuous clusters and the sampled ones that hold for them under a budget, as far as double bars join them.
#[derive(Debug, Default)]
pub(super) struct Joined {
    pub(super) members: Vec<Member>,
    pub(super) holders: Vec<usize>,
    /// What is known of the way to the next sample.
    pub(super) foreseen: Option<Foreseen>,
    /// Room for the instants at which one of them was looked at.
    pub(super) looks: Vec<f64>,
}

/// A continuous cluster of those.
#[derive(Debug, Default)]
pub(super) struct Member {
    pub(super) cluster: usize,
    /// Double bars at which somebody holds for it under a budget.
    pub(super) bars: Vec<usize>,
    /// What it kept where the way that is tried began.
    pub(super) kept: Kept,
    /// Instants on that way, and for each of them and each bar what went through the port until then, and how fast.
    pub(super) times: Vec<f64>,
    pub(super) moved: Vec<[f64; 2]>,
    /// What went through the ports until the instant that was reached.
    pub(super) here: Vec<f64>,
}

/// Up to an instant, when somebody lets go for the first time, if anybody does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foreseen {
    pub(super) until: f64,
    pub(super) release: Option<Release>,
}

/// A holder lets go: of the bars of temperature, or of all others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Release {
    pub(super) at: f64,
    pub(super) account: Account,
}

/// What a holder has to give, as work or as heat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Account {
    pub(super) holder: usize,
    pub(super) is_heat: bool,
}

impl Member {
    /// What went through a bar's port until an instant of the way that was tried, and how fast: by the cubic between
    /// two looks.
    pub(super) fn through(&self, bar: usize, t: f64) -> [f64; 2] {
        let (n, after) = (self.bars.len(), self.times.partition_point(|x| *x < t));
        let at = |k: usize| self.moved[k * n + bar];
        if after == 0 || after == self.times.len() {
            return at(after.min(self.times.len() - 1));
        }
        let (begin, h) = (self.times[after - 1], self.times[after] - self.times[after - 1]);
        let ([x, f], [y, g], u) = (at(after - 1), at(after), (t - begin) / h);
        if u >= 1.0 {
            return [y, g];
        }
        let [a, b] = [h * f - (y - x), (y - x) - h * g];
        let w = 1.0 - u;
        let value = w * x + u * y + u * w * (w * a + u * b);
        let rate = ((y - x) + (1.0 - 2.0 * u) * (w * a + u * b) + u * w * (b - a)) / h;
        [value, rate]
    }
}

impl Joined {
    /// All groups of a scene.
    pub(super) fn all(scene: &Scene) -> Vec<Self> {
        let guarded = |b: &usize| {
            let (holder, other) = (&scene.clusters[scene.bars[*b].holder.0], &scene.clusters[scene.bars[*b].other.0]);
            holder.budget && holder.period.is_some() && other.period.is_none()
        };
        /// Holders, and the others.
        type Group = (Vec<usize>, Vec<usize>);
        let mut groups: Vec<Group> = Vec::new();
        for b in (0..scene.bars.len()).filter(guarded) {
            let (holder, other) = (scene.bars[b].holder.0, scene.bars[b].other.0);
            let (mut joined, rest): (Vec<_>, Vec<_>) =
                groups.into_iter().partition(|(holders, others)| holders.contains(&holder) || others.contains(&other));
            joined.push((vec![holder], vec![other]));
            groups = rest;
            let merged = |k: fn(&Group) -> &Vec<usize>| {
                let mut list: Vec<usize> = joined.iter().flat_map(|g| k(g).iter().copied()).collect();
                list.sort_unstable();
                list.dedup();
                list
            };
            groups.push((merged(|g| &g.0), merged(|g| &g.1)));
        }
        groups.sort_unstable();
        let member = |cluster: usize| {
            let bars = (0..scene.bars.len()).filter(|b| guarded(b) && scene.bars[*b].other.0 == cluster).collect();
            Member { cluster, bars, ..Member::default() }
        };
        let group = |(holders, others): (Vec<usize>, Vec<usize>)| Self {
            members: others.into_iter().map(member).collect(),
            holders,
            ..Self::default()
        };
        groups.into_iter().map(group).collect()
    }

    /// Its continuous clusters.
    pub(super) fn clusters(&self) -> impl Iterator<Item = usize> {
        self.members.iter().map(|m| m.cluster)
    }

    /// What went through a bar's port until an instant of the way that was tried.
    pub(super) fn through(&self, bar: usize, t: f64) -> f64 {
        let member = self.members.iter().find_map(|m| Some((m, m.bars.iter().position(|b| *b == bar)?)));
        member.map_or(0.0, |(m, at)| m.through(at, t)[0])
    }

    /// The same until the instant that was reached.
    pub(super) fn here(&self, bar: usize) -> f64 {
        let at = |m: &Member| m.bars.iter().position(|b| *b == bar).map(|k| m.here[k]);
        self.members.iter().find_map(at).unwrap_or(0.0)
    }

    pub(super) fn accounts(&self) -> usize {
        2 * self.holders.len()
    }

    pub(super) fn account(&self, which: usize) -> Account {
        Account { holder: self.holders[which / 2], is_heat: which % 2 == 1 }
    }

    /// Forgets what was foreseen with what changes now.
    pub(super) fn forget(&mut self) {
        self.foreseen = None;
    }
}

#[cfg(test)]
mod tests {
    use super::Member;

    /// Between two looks it is the cubic by the values and rates there; before the first and after the last one what
    /// was seen there.
    #[test]
    fn what_went_through_a_port_is_a_cubic() {
        let cubic = |t: f64| [t * t * t - 2.0 * t + 1.0, 3.0 * t * t - 2.0];
        let other = |t: f64| [-t, -1.0];
        let times = vec![1.0, 1.5, 4.0];
        let moved = times.iter().flat_map(|t| [cubic(*t), other(*t)]).collect();
        let member = Member { bars: vec![3, 5], times, moved, ..Member::default() };
        for t in [1.0, 1.125, 1.25, 1.5, 2.0, 3.5, 4.0] {
            for (bar, wanted) in [cubic(t), other(t)].into_iter().enumerate() {
                let found = member.through(bar, t);
                assert!(found.iter().zip(wanted).all(|(x, y)| (x - y).abs() < 1e-13), "{t}: {found:?}, {wanted:?}");
            }
        }
        assert_eq!([member.through(0, 0.0), member.through(0, 5.0)], [cubic(1.0), cubic(4.0)]);
    }
}
