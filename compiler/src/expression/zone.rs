//! Dead zones: `x - min(max(x, low), high)`.

use super::{Expr, Node, Number, Pool};
use bond_runtime::ir::Binary;
use rustc_hash::FxHashMap;

/// The terms of a sum that is `n (x - cut(x))` and more: each `x`, `cut(x)`, which takes the larger or the smaller of
/// it and a number, and `n`.
pub(super) fn zones(pool: &Pool, terms: &[(Expr, Number)]) -> Vec<(Expr, Expr, Number)> {
    let mut zones: Vec<(Expr, Expr, Number)> = Vec::new();
    for &(cut, n) in terms {
        let mut x = cut;
        while let Node::Binary(Binary::Min | Binary::Max, a, b) = pool.node(x) {
            match (pool.constant(*a), pool.constant(*b)) {
                (Some(_), None) => x = *b,
                (None, Some(_)) => x = *a,
                (Some(_), Some(_)) | (None, None) => break,
            }
        }
        // Terms are in the order of their numbers.
        if x != cut
            && let Node::Symbol(_) = pool.node(x)
            && let Ok(at) = terms.binary_search_by_key(&x, |t| t.0)
            && terms[at].1 == -n
            && zones.iter().all(|z| z.0 != x)
        {
            zones.push((x, cut, -n));
        }
    }
    zones
}

impl Pool {
    /// An expression with each dead zone as what there is beyond its ends, `max(x - high, 0) + min(x - low, 0)`: as a
    /// difference its energy would be one of two energies, and have their rounding for its own.
    pub fn beyond_dead_zones(&mut self, e: Expr) -> Expr {
        let mut new: FxHashMap<Expr, Expr> = FxHashMap::default();
        for e in self.ascending(&[e], &|_| true) {
            let rebuilt = match self.node(e).clone() {
                Node::Sum(c, terms) => {
                    let mut all = vec![(self.numeral(c), Number::ONE)];
                    let found = zones(self, &terms);
                    let told: Vec<_> = found.iter().filter_map(|z| Some((self.beyond(z.0, z.1)?, *z))).collect();
                    all.extend(told.iter().map(|(zone, z)| (*zone, z.2)));
                    let rest = terms.iter().filter(|t| told.iter().all(|(_, z)| z.0 != t.0 && z.1 != t.0));
                    all.extend(rest.map(|&(t, n)| (new.get(&t).copied().unwrap_or(t), n)));
                    self.combine(&all)
                }
                _ => self.rebuild(e, &|c| new.get(&c).copied().unwrap_or(c)),
            };
            new.insert(e, rebuilt);
        }
        new.get(&e).copied().unwrap_or(e)
    }

    /// `x - cut(x)` without that difference; None where the ends lie the wrong way round.
    fn beyond(&mut self, x: Expr, cut: Expr) -> Option<Expr> {
        let (mut low, mut high, mut inner) = (None, None, cut);
        while inner != x {
            let Node::Binary(f, a, b) = *self.node(inner) else { return None };
            let (end, rest) = if self.constant(a).is_some() { (a, b) } else { (b, a) };
            let side = if f == Binary::Min { &mut high } else { &mut low };
            if side.replace(end).is_some() {
                return None;
            }
            inner = rest;
        }
        if let (Some(low), Some(high)) = (low, high)
            && self.constant(low)? > self.constant(high)?
        {
            return None;
        }
        let mut parts = Vec::new();
        for (end, f) in [(high, Binary::Max), (low, Binary::Min)] {
            let Some(end) = end else { continue };
            let (off, zero) = (self.sub(x, end), self.zero());
            parts.push(self.binary(f, off, zero));
        }
        Some(self.sum(&parts))
    }
}
