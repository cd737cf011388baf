//! How long things took, without keeping each of them.

/// Parts of each factor of two.
const BINS_PER_OCTAVE: u64 = 64;
/// Bins in all.
const BINS: usize = 64 * BINS_PER_OCTAVE as usize;

/// Counts of lengths of time in bins of about 1 %. Adding to it allocates nothing.
#[derive(Clone, Debug)]
pub struct Meter {
    bins: Vec<u64>,
    count: u64,
    most: u64,
}

impl Meter {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { bins: vec![0; BINS], count: 0, most: 0 }
    }

    /// Adds a length of time, ns.
    pub fn add(&mut self, ns: u64) {
        self.bins[bin(ns)] += 1;
        self.count += 1;
        self.most = self.most.max(ns);
    }

    /// How many there were.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest, us.
    pub fn most(&self) -> f64 {
        self.most as f64 / 1e3
    }

    /// The quantile for this part of them, us, to about 1 %; 0 without any.
    pub fn quantile(&self, part: f64) -> f64 {
        let wanted = (part * self.count as f64).ceil() as u64;
        let mut seen = 0;
        for (i, n) in self.bins.iter().enumerate() {
            seen += n;
            if seen >= wanted.max(1) {
                return (top(i) as f64 / 1e3).min(self.most());
            }
        }
        0.0
    }
}

/// The bin of a number: below [`BINS_PER_OCTAVE`] each has its own, above each power of two has [`BINS_PER_OCTAVE`].
fn bin(x: u64) -> usize {
    if x < BINS_PER_OCTAVE {
        return x as usize;
    }
    let shift = x.ilog2() - BINS_PER_OCTAVE.ilog2();
    (u64::from(shift) * BINS_PER_OCTAVE + (x >> shift)) as usize
}

/// The largest number of a bin.
fn top(bin: usize) -> u64 {
    let bin = bin as u64;
    if bin < 2 * BINS_PER_OCTAVE {
        return bin;
    }
    let shift = bin / BINS_PER_OCTAVE - 1;
    ((bin % BINS_PER_OCTAVE + BINS_PER_OCTAVE + 1) << shift) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_follow_each_other() {
        for x in (0..100_000).chain([u64::MAX / 3, u64::MAX >> 2]) {
            assert!(top(bin(x)) >= x && (bin(x) == 0 || top(bin(x) - 1) < x), "{x}");
            assert!(bin(x) < BINS);
        }
    }

    #[test]
    fn quantiles_are_near() {
        let mut m = Meter::new();
        assert_eq!(m.quantile(0.5), 0.0);
        (1..=1000u64).for_each(|k| m.add(k * 1000));
        assert!((m.quantile(0.5) - 500.0).abs() < 10.0 && (m.quantile(0.99) - 990.0).abs() < 20.0);
        assert_eq!((m.most(), m.quantile(1.0), m.count()), (1000.0, 1000.0, 1000));
    }
}
