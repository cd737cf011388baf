//! Bytes of the fuzzer as a row of choices.

/// What is left of the bytes.
pub struct Feed<'a>(pub &'a [u8]);

impl<'a> Feed<'a> {
    /// Whether there is none.
    pub fn is_over(&self) -> bool {
        self.0.is_empty()
    }

    /// So many bytes, fewer at the end.
    pub fn bytes(&mut self, count: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        taken
    }

    /// A byte; 0 at the end.
    pub fn byte(&mut self) -> u8 {
        self.bytes(1).first().copied().unwrap_or(0)
    }

    /// A whole number of eight bytes.
    pub fn word(&mut self) -> u64 {
        let mut word = [0; 8];
        let bytes = self.bytes(8);
        word[..bytes.len()].copy_from_slice(bytes);
        u64::from_le_bytes(word)
    }

    /// Any number: its bits.
    pub fn number(&mut self) -> f64 {
        f64::from_bits(self.word())
    }

    /// A number from -1 to 1.
    pub fn swing(&mut self) -> f64 {
        f64::from(self.byte() as i8) / 128.0
    }

    /// One of a list; `None` if it is empty.
    pub fn one<'l, T>(&mut self, list: &'l [T]) -> Option<&'l T> {
        let at = usize::from(self.byte()) % list.len().max(1);
        list.get(at)
    }
}
