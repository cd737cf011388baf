//! Statistics over the instances of an ensemble.

use super::outcome::Outcome;

/// Most failures that are kept, with their reasons.
const FAILURES_KEPT: usize = 100;

/// Counts and moments, taken in order of the instances, so that they are the same however these were run.
#[derive(Clone, Debug)]
pub struct Statistics {
    /// Instances.
    pub count: u64,
    /// Those that failed.
    pub failed: u64,
    /// The first of them, with their reasons.
    pub failures: Vec<(u64, String)>,
    /// Those that got to the end and were passive.
    pub passive: u64,
    /// The worst balance of a step of any, and whose it was.
    pub worst: Option<(f64, u64)>,
    /// The probes at the end of those that got there.
    pub probes: Vec<Moments>,
}

impl Statistics {
    /// Those of no instances, with so many probes.
    pub fn new(width: usize) -> Self {
        let probes = vec![Moments::default(); width];
        Self { count: 0, failed: 0, failures: Vec::new(), passive: 0, worst: None, probes }
    }

    /// Takes an instance in.
    pub fn add(&mut self, instance: u64, o: Outcome) {
        self.count += 1;
        self.passive += u64::from(o.passive);
        if self.worst.is_none_or(|(worst, _)| o.worst > worst) && !o.worst.is_nan() {
            self.worst = Some((o.worst, instance));
        }
        let Some(why) = o.failure else {
            for (moments, x) in self.probes.iter_mut().zip(&o.last) {
                moments.add(*x);
            }
            return;
        };
        self.failed += 1;
        if self.failures.len() < FAILURES_KEPT {
            self.failures.push((instance, why));
        }
    }
}

/// Extremes, mean and standard deviation of numbers as they come (Welford 1962).
#[derive(Clone, Copy, Debug)]
pub struct Moments {
    n: u64,
    min: f64,
    max: f64,
    mean: f64,
    /// Sum of the squares of the distances from the mean.
    squares: f64,
}

impl Default for Moments {
    fn default() -> Self {
        Self { n: 0, min: f64::NAN, max: f64::NAN, mean: 0.0, squares: 0.0 }
    }
}

impl Moments {
    fn add(&mut self, x: f64) {
        self.n += 1;
        self.min = self.min.min(x);
        self.max = self.max.max(x);
        let off = x - self.mean;
        self.mean += off / self.n as f64;
        self.squares += off * (x - self.mean);
    }

    /// The smallest; NaN of none.
    pub fn min(&self) -> f64 {
        self.min
    }

    /// The largest; NaN of none.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// The mean; NaN of none.
    pub fn mean(&self) -> f64 {
        if self.n > 0 { self.mean } else { f64::NAN }
    }

    /// The standard deviation of a sample, with n - 1; NaN of fewer than two.
    pub fn sd(&self) -> f64 {
        if self.n > 1 { (self.squares / (self.n - 1) as f64).sqrt() } else { f64::NAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments() {
        let mut m = Moments::default();
        assert!(m.min().is_nan() && m.mean().is_nan() && m.sd().is_nan());
        for x in [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0] {
            m.add(x);
        }
        assert_eq!((m.min(), m.max(), m.mean()), (2.0, 9.0, 5.0));
        assert!((m.sd() - (32.0f64 / 7.0).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn failures_are_counted_apart() {
        let mut s = Statistics::new(1);
        let good = Outcome { last: vec![3.0], rows: vec![], passive: true, worst: 1e-16, failure: None };
        s.add(0, good.clone());
        s.add(1, Outcome::failed(1, "so".into()));
        s.add(2, Outcome { passive: false, worst: 1e-3, ..good });
        assert_eq!((s.count, s.failed, s.passive, s.worst), (3, 1, 1, Some((1e-3, 2))));
        assert_eq!(s.failures, [(1, "so".to_string())]);
        assert_eq!((s.probes[0].n, s.probes[0].mean()), (2, 3.0));
    }
}
