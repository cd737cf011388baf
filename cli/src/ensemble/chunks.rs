//! Chunks of consecutive instances.

/// Most chunks of an ensemble.
const CHUNKS: u64 = 1 << 20;

/// Instances in consecutive chunks of one size, so that there are not too many of them to keep account of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunks {
    total: u64,
    size: u64,
}

impl Chunks {
    /// Those of so many instances.
    pub fn new(total: u64) -> Self {
        Self { total, size: total.div_ceil(CHUNKS).max(1) }
    }

    /// How many there are.
    pub fn count(self) -> u64 {
        self.total.div_ceil(self.size)
    }

    /// The instances of a chunk.
    pub fn instances(self, chunk: u64) -> std::ops::Range<u64> {
        let start = chunk.saturating_mul(self.size).min(self.total);
        start..start.saturating_add(self.size).min(self.total)
    }

    /// How many instances a chunk has.
    pub fn size(self, chunk: u64) -> u64 {
        let range = self.instances(chunk);
        range.end - range.start
    }
}

/// What a chunk counts for while it waits.
pub fn weight(bytes: &[u8]) -> usize {
    bytes.len() + 64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_hold_each_instance_once() {
        for total in [1, 2, 1 << 20, (1 << 20) + 1, 3_000_001, 1_000_000_000] {
            let chunks = Chunks::new(total);
            assert!(chunks.count() <= CHUNKS);
            assert_eq!(chunks.instances(0).start, 0);
            let last = chunks.count() - 1;
            assert!(chunks.instances(last).end == total && !chunks.instances(last).is_empty());
            assert_eq!(chunks.instances(last / 2).end, chunks.instances(last / 2 + 1).start);
        }
    }
}
