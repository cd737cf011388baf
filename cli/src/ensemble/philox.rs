//! Counter-based random numbers (Philox): a function of the instance and the parameter alone.
//!
//! Philox4x32-10 of J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw, "Parallel random numbers: as easy as 1, 2,
//! 3", 2011.

const MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

/// Two random words for a draw of an instance: of the block at the counter (low and high word of the instance, low and
/// high word of the draw) under the seed as key, words 0 and 1, and 2 and 3, the first of each the lower one.
pub fn words(seed: u64, instance: u64, draw: u64) -> [u64; 2] {
    let [a, b] = halves(instance);
    let [c, d] = halves(draw);
    let [w, x, y, z] = block([a, b, c, d], halves(seed)).map(u64::from);
    [x << 32 | w, z << 32 | y]
}

/// Low and high word.
fn halves(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

/// Ten rounds.
fn block(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let [low0, high0] = halves(u64::from(MULTIPLIERS[0]) * u64::from(counter[0]));
        let [low1, high1] = halves(u64::from(MULTIPLIERS[1]) * u64::from(counter[2]));
        counter = [high1 ^ counter[1] ^ key[0], low1, high0 ^ counter[3] ^ key[1], low0];
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    counter
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answers that the authors' library, Random123, publishes.
    #[test]
    fn known_answers() {
        let cases = [
            ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
            ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
            (
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0],
                [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
            ),
        ];
        for (counter, key, answer) in cases {
            assert_eq!(block(counter, key), answer);
        }
        assert_eq!(words(0, 0, 0), [0xe169_c58d_6627_e8d5, 0x9b00_dbd8_bc57_ac4c]);
    }

    #[test]
    fn places_do_not_share_words() {
        let mut seen = std::collections::HashSet::new();
        for seed in [0, 1, 1 << 40] {
            for instance in [0, 1, 2, 1 << 33] {
                for draw in 0..3 {
                    assert!(seen.insert(words(seed, instance, draw)));
                }
            }
        }
    }
}
