//! What the outside was promised and may not have heard of yet.

/// Intervals that are remembered one by one.
const PROMISES_KEPT: usize = 1024;

/// The limits of the efforts that the device may still hold or receive: those since the one that it named last.
#[derive(Clone, Debug)]
pub(super) struct Promises {
    groups: usize,
    /// By interval modulo [`PROMISES_KEPT`] and group.
    limits: Vec<f64>,
    /// By group, the least of those that were overwritten, and the last interval of them.
    older: Vec<f64>,
    last_older: Option<u64>,
    next: u64,
}

impl Promises {
    pub(super) fn new(groups: usize) -> Self {
        Self {
            groups,
            limits: vec![f64::INFINITY; PROMISES_KEPT * groups],
            older: vec![f64::INFINITY; groups],
            last_older: None,
            next: 0,
        }
    }

    /// Forgets all promises: who they were made to has left.
    pub(super) fn forget(&mut self) {
        self.limits.fill(f64::INFINITY);
        self.older.fill(f64::INFINITY);
    }

    /// The limit of a group in interval `k`; intervals come in order, groups in order in each.
    pub(super) fn give(&mut self, k: u64, group: usize, limit: f64) {
        let place = &mut self.limits[(k % PROMISES_KEPT as u64) as usize * self.groups + group];
        self.older[group] = self.older[group].min(*place);
        *place = limit;
        self.last_older = k.checked_sub(PROMISES_KEPT as u64);
        self.next = k + 1;
    }

    /// The least limit of a group among the intervals from `from` on.
    pub(super) fn least(&mut self, group: usize, from: u64) -> f64 {
        let before = self.last_older.is_some_and(|last| from <= last);
        if !before {
            // None of the forgotten ones can be held any more.
            self.older[group] = f64::INFINITY;
        }
        let first = from.max(self.next.saturating_sub(PROMISES_KEPT as u64));
        let limit = |k: u64| self.limits[(k % PROMISES_KEPT as u64) as usize * self.groups + group];
        (first..self.next).map(limit).fold(self.older[group], f64::min)
    }

    /// The least limit of a group among the intervals from `from` to `last`.
    pub(super) fn least_until(&self, group: usize, from: u64, last: u64) -> f64 {
        let known = self.next.saturating_sub(PROMISES_KEPT as u64);
        let older = if from < known { self.older[group] } else { f64::INFINITY };
        let limit = |k: u64| self.limits[(k % PROMISES_KEPT as u64) as usize * self.groups + group];
        (from.max(known)..self.next.min(last + 1)).map(limit).fold(older, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_that_may_be_held() {
        let mut p = Promises::new(2);
        for k in 0..5000u64 {
            p.give(k, 0, (k as f64 * 0.1).sin());
            p.give(k, 1, -(k as f64));
            if k == 10 {
                assert_eq!(p.least(1, 7), -10.0);
            }
        }
        assert_eq!(p.least_until(1, 4800, 4900), -4900.0);
        assert_eq!(p.least_until(1, 3990, 4000), -4000.0);
        let wanted = (4500..5000).map(|k| (f64::from(k) * 0.1).sin()).fold(f64::INFINITY, f64::min);
        assert_eq!(p.least(0, 4500), wanted);
        assert_eq!(p.least(1, 4500), -4999.0);
        let mut p = Promises::new(1);
        for k in 0..3000u64 {
            p.give(k, 0, k as f64);
        }
        // Long ago is not forgotten as long as it counts.
        assert_eq!(p.least(0, 5), 0.0);
        assert_eq!(p.least(0, 2990), 2990.0);
    }
}
