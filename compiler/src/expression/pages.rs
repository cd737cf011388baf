//! A map from numbers that lie close together.

/// Numbers to a page.
const PAGE: usize = 256;
const NONE: u32 = u32::MAX;

/// A map between indices: pages that are there once something is in them, so that a few keys of many cost little, and
/// near ones lie near each other.
#[derive(Clone, Default)]
pub(super) struct Pages {
    /// Where each page starts in `cells`.
    index: Vec<u32>,
    cells: Vec<u32>,
}

impl Pages {
    /// What is there.
    pub(super) fn get(&self, key: u32) -> Option<u32> {
        let (page, at) = (key as usize / PAGE, key as usize % PAGE);
        let start = *self.index.get(page).filter(|start| **start != NONE)?;
        Some(self.cells[start as usize * PAGE + at]).filter(|value| *value != NONE)
    }

    /// Whether anything is there.
    pub(super) fn contains(&self, key: u32) -> bool {
        self.get(key).is_some()
    }

    /// Puts a value there.
    pub(super) fn insert(&mut self, key: u32, value: u32) {
        let (page, at) = (key as usize / PAGE, key as usize % PAGE);
        if self.index.len() <= page {
            self.index.resize(page + 1, NONE);
        }
        if self.index[page] == NONE {
            self.index[page] = (self.cells.len() / PAGE) as u32;
            self.cells.resize(self.cells.len() + PAGE, NONE);
        }
        self.cells[self.index[page] as usize * PAGE + at] = value;
    }
}
