//! The block of numbers of a scene, as it is laid out.

use crate::backend::lower::writer::{MANY, TOGETHER};

/// A block in the making.
#[derive(Default)]
pub(super) struct Block {
    /// What it holds at the start.
    pub(super) image: Vec<f64>,
}

impl Block {
    /// Room for some numbers.
    pub(super) fn take(&mut self, n: usize) -> usize {
        self.put(&vec![0.0; n])
    }

    /// Room for some numbers, with what they start as.
    pub(super) fn put(&mut self, numbers: &[f64]) -> usize {
        let at = self.image.len();
        self.image.extend_from_slice(numbers);
        at
    }

    /// Has what follows begin, where that are many numbers, at a multiple of as many as processors take at once.
    pub(super) fn align(&mut self, n: usize) {
        if n >= MANY {
            self.image.resize(self.image.len().next_multiple_of(TOGETHER), 0.0);
        }
    }
}
