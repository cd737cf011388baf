//! Changes of texts by words: what bytes alone seldom change into another text that is read.

use libfuzzer_sys::fuzzer_mutate;

/// Random numbers, the same from the same seed.
struct Dice(u64);

impl Dice {
    /// A number below `n`, which is not 0.
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// Words, numbers, signs and blanks of a text.
fn words(text: &str) -> Vec<&str> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut list = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let end = if is_word(first) {
            rest.find(|c: char| !is_word(c)).unwrap_or(rest.len())
        } else if first.is_whitespace() {
            rest.find(|c: char| !c.is_whitespace()).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let (word, after) = rest.split_at(end);
        list.push(word);
        rest = after;
    }
    list
}

/// Numbers that are often where something goes wrong.
const NUMBERS: [&str; 16] = [
    "0", "1", "2", "-1", "0.5", "1e-9", "1e9", "1e300", "1e-300", "1e400", "1e-400", "3", "64", "65", "1000000", "0.1",
];

/// One change by words: some are taken away, doubled, moved or exchanged, or a piece of `pieces` comes in.
fn changed(text: &str, pieces: &[&str], dice: &mut Dice) -> String {
    let mut list = words(text);
    let n = list.len();
    let at = dice.below(n);
    let count = (1 + dice.below(8)).min(n.saturating_sub(at));
    match dice.below(8) {
        0 => _ = list.drain(at..at + count),
        1 | 2 if !pieces.is_empty() => list.splice(at..at, [" ", pieces[dice.below(pieces.len())], " "]).for_each(drop),
        3 => {
            let run: Vec<&str> = list[at..at + count].to_vec();
            let to = dice.below(n + 1);
            list.splice(to..to, run).for_each(drop);
        }
        4 if n > 0 => list.swap(at, dice.below(n)),
        5 if n > 0 => list[at] = list[dice.below(n)],
        6 if n > 0 && !pieces.is_empty() => list[at] = pieces[dice.below(pieces.len())],
        _ => {
            let is_number = |word: &&str| word.starts_with(|c: char| c.is_ascii_digit());
            let places: Vec<usize> = (0..n).filter(|i| is_number(&list[*i])).collect();
            if let Some(place) = places.get(dice.below(places.len())) {
                list[*place] = NUMBERS[dice.below(NUMBERS.len())];
            }
        }
    }
    list.concat()
}

/// Changes `data[..size]`, a text of at most `max_size` bytes: by words three times of four, else by bytes. The new
/// size.
pub fn text(data: &mut [u8], size: usize, max_size: usize, seed: u32, pieces: &[&str]) -> usize {
    let mut dice = Dice(u64::from(seed) ^ 0x9e37_79b9_7f4a_7c15);
    dice.below(2);
    if dice.below(4) == 0 {
        return fuzzer_mutate(data, size, max_size);
    }
    let Ok(text) = std::str::from_utf8(&data[..size]) else { return fuzzer_mutate(data, size, max_size) };
    let mut text = text.to_string();
    for _ in 0..=dice.below(3) {
        text = changed(&text, pieces, &mut dice);
    }
    let mut end = text.len().min(max_size).min(data.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    data[..end].copy_from_slice(&text.as_bytes()[..end]);
    end
}

/// The pieces of a dictionary as libFuzzer reads it: a quoted text a line, after which comments begin with `#`.
pub fn pieces(dictionary: &'static str) -> Vec<&'static str> {
    let piece = |line: &'static str| line.strip_prefix('"')?.strip_suffix('"');
    dictionary.lines().filter_map(piece).filter(|piece| !piece.contains('\\')).collect()
}
