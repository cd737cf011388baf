//! States that change places: an interval finds them where the one before put them, so that nothing is copied.

use crate::backend::code::{Index, Memory, Place, Routine, Stmt, all};
use crate::backend::standalone::{Late, StandaloneModule};
use rustc_hash::FxHashMap;
use std::ops::Range;

/// The states that change places: those that wait for an interval to end well, where no statement looks at a list of
/// numbers of which some are states and some are not.
pub(super) fn double_buffered(unit: &StandaloneModule) -> &[Late] {
    let apart = |r: &Routine| {
        let mut look = Look { routine: r, late: &unit.late, ranges: FxHashMap::default() };
        all(&r.body, &mut |s| look.statement(s))
    };
    if [&unit.commit, &unit.observe].into_iter().chain(&unit.begin).all(apart) { &unit.late } else { &[] }
}

/// The names, numbers and beginnings of what changes places.
pub(super) fn parts(late: &[Late]) -> impl Iterator<Item = (&'static str, usize, Range<usize>)> {
    late.iter().enumerate().flat_map(|(k, l)| [("p", k, l.state.clone()), ("q", k, l.next..l.next + l.state.len())])
}

/// The first of the numbers that a place may be, as a part is told by it.
pub(super) fn first(p: &Place, tables: &[u32]) -> usize {
    let more = p.through.and_then(|(at, _)| tables.get(at as usize));
    p.base as usize + more.map_or(0, |more| *more as usize)
}

struct Look<'a> {
    routine: &'a Routine,
    late: &'a [Late],
    /// Of the counters of the loops around.
    ranges: FxHashMap<Index, (u32, u32)>,
}

impl Look<'_> {
    fn statement(&mut self, s: &Stmt) -> bool {
        if let Stmt::For(i, from, to, _) = s {
            self.ranges.insert(*i, (*from, *to));
        }
        s.place().is_none_or(|p| self.is_apart(p))
    }

    /// Whether all numbers that a place may be are of the same part.
    fn is_apart(&self, p: &Place) -> bool {
        if p.memory != Memory::State || self.late.is_empty() {
            return true;
        }
        let range = |i: &Index| self.ranges.get(i).copied().unwrap_or((0, 1));
        let ends = |from: u32, to: u32| (from as usize, to.saturating_sub(1).max(from) as usize);
        let (mut low, mut high) = (p.base as usize, p.base as usize);
        let first = first(p, &self.routine.tables);
        for (i, stride) in &p.along {
            let (from, last) = ends(range(i).0, range(i).1);
            (low, high) = (low + from * *stride as usize, high + last * *stride as usize);
        }
        if let Some((at, i)) = p.through {
            let (from, last) = ends(range(&i).0, range(&i).1);
            let Some(list) = self.routine.tables.get(at as usize + from..=at as usize + last) else { return false };
            low += list.iter().min().map_or(0, |x| *x as usize);
            high += list.iter().max().map_or(0, |x| *x as usize);
        }
        if let Some(picked) = p.picked {
            high += (picked.stride * picked.count.saturating_sub(1)) as usize;
        }
        let part = parts(self.late).map(|p| p.2).find(|r| r.contains(&first));
        match part {
            Some(r) => r.contains(&low) && r.contains(&high),
            None => parts(self.late).all(|(.., r)| high < r.start || r.end <= low),
        }
    }
}
