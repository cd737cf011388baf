//! Sums of energies.

use crate::energy::compensated;
use serde::{Deserialize, Serialize};

/// A sum that keeps what rounding would lose: what each addition is off by is found without branches (Knuth's two-sum),
/// and summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sum {
    sum: f64,
    rest: f64,
}

impl Sum {
    /// A sum of nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// A sum that goes on from its two numbers.
    pub(crate) fn of([sum, rest]: [f64; 2]) -> Self {
        Self { sum, rest }
    }

    /// Adds a term.
    #[inline]
    pub fn add(&mut self, x: f64) {
        [self.sum, self.rest] = compensated([self.sum, self.rest], x);
    }

    /// The sum so far. Once it overflows it is infinite or NaN for good.
    #[inline]
    pub fn value(&self) -> f64 {
        if self.sum.is_finite() { self.sum + self.rest } else { self.sum }
    }
}

impl Extend<f64> for Sum {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, terms: I) {
        terms.into_iter().for_each(|x| self.add(x));
    }
}

impl FromIterator<f64> for Sum {
    fn from_iter<I: IntoIterator<Item = f64>>(terms: I) -> Self {
        let mut sum = Self::new();
        sum.extend(terms);
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_survive_large_ones() {
        assert_eq!([1.0, 1e100, 1.0, -1e100].into_iter().collect::<Sum>().value(), 2.0);
        assert_eq!(std::iter::repeat_n(0.1, 10_000_000).collect::<Sum>().value(), 1e6);
    }

    #[test]
    fn overflow_stays() {
        let mut sum = Sum::new();
        sum.add(f64::INFINITY);
        sum.add(1.0);
        assert_eq!(sum.value(), f64::INFINITY);
        sum.add(f64::NAN);
        assert!(sum.value().is_nan());
    }
}
