//! Linear equations in echelon form: which of them follow from the others.

use super::OPTIONS;
use rustc_hash::FxHashMap;
use std::collections::{BTreeMap, BTreeSet};

/// Linear equations, each free of the pivots of those before it.
#[derive(Clone, Default)]
pub(crate) struct Echelon {
    rows: Vec<(usize, Vec<(usize, f64)>)>,
    /// The equation of which a variable is the pivot.
    of: FxHashMap<usize, usize>,
}

impl Echelon {
    /// An equation reduced by the others, without rounding errors; empty where it follows from them.
    fn rest(&self, terms: &[(usize, f64)]) -> BTreeMap<usize, f64> {
        let mut row = BTreeMap::new();
        terms.iter().for_each(|(i, x)| *row.entry(*i).or_insert(0.0) += x);
        let size = row.values().fold(0.0f64, |m, x| m.max(x.abs()));
        let mut due: BTreeSet<usize> = row.keys().filter_map(|i| self.of.get(i)).copied().collect();
        while let Some(k) = due.pop_first() {
            let (pivot, other) = &self.rows[k];
            let part = row.remove(pivot).unwrap_or(0.0);
            if part != 0.0 {
                for (i, x) in other.iter().filter(|t| t.0 != *pivot) {
                    *row.entry(*i).or_insert(0.0) -= part * x;
                    due.extend(self.of.get(i));
                }
            }
        }
        if row.values().all(|x| x.abs() <= OPTIONS.rounding * size) {
            row.clear();
        }
        row.retain(|_, x| x.abs() > 1e-3 * OPTIONS.rounding * size);
        row
    }

    /// Whether an equation follows from the others.
    pub(crate) fn follows(&self, terms: &[(usize, f64)]) -> bool {
        self.rest(terms).is_empty()
    }

    /// Adds an equation, unless it follows from the others.
    pub(crate) fn take(&mut self, terms: &[(usize, f64)]) -> bool {
        let row = self.rest(terms);
        let Some((&pivot, &x)) = row.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else { return false };
        let scale = 1.0 / x;
        self.of.insert(pivot, self.rows.len());
        self.rows.push((pivot, row.into_iter().map(|(i, x)| (i, x * scale)).collect()));
        true
    }
}
