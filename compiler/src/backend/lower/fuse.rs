//! Loops over the same range become one, where none of them needs what a later turn of another gives: what one leaves
//! for the next is then not written and read again, and sums are added up while something else is computed.
//!
//! The order of operations on each number stays as it was, and so do all bits.

use super::options::LoopOptions;
use crate::backend::code::{Index, Memory, Op, Place, Routine, Stmt, Value, Var, retain, visit};
use rustc_hash::{FxHashMap, FxHashSet};

/// Joins the loops of a routine.
pub(super) fn fuse(routine: &mut Routine, options: LoopOptions) {
    let mut body = std::mem::take(&mut routine.body);
    let mut fuse = Fuse { options, tables: &routine.tables, values: routine.numbers.len() as u32, joined: false };
    fuse.block(&mut body);
    let (values, joined) = (fuse.values as usize, fuse.joined);
    routine.numbers.resize(values, None);
    if joined {
        let mut read =
            Read { routine, cells: vec![0; routine.scratch as usize / 64 + 1], ranges: FxHashMap::default() };
        read.block(&body);
        read.clear(&mut body);
    }
    routine.body = body;
}

struct Fuse<'a> {
    options: LoopOptions,
    tables: &'a [u32],
    /// How many values there are.
    values: u32,
    joined: bool,
}

/// Statements that are done with, each with its effects; None where these are not known.
#[derive(Default)]
struct Out {
    list: Vec<Stmt>,
    effects: Vec<Option<Effects>>,
}

impl Out {
    fn push(&mut self, s: Stmt, tables: &[u32]) {
        self.insert(self.list.len(), s, tables);
    }

    fn insert(&mut self, at: usize, s: Stmt, tables: &[u32]) {
        let effects = match &s {
            Stmt::For(index, from, to, body) => Effects::of(body, (Some(*index), *from, *to), tables),
            s => Effects::of(std::slice::from_ref(s), (None, 0, 1), tables),
        };
        self.effects.insert(at, effects);
        self.list.insert(at, s);
    }

    fn remove(&mut self, at: usize) -> Stmt {
        self.effects.remove(at);
        self.list.remove(at)
    }

    /// Whether what has these effects may be moved to just after the statement with this number: those that set
    /// variables which it goes on from, and move with it, the last one first. None of what they pass may look at these
    /// variables.
    fn way(&self, own: &mut Effects, to: usize) -> Option<Vec<usize>> {
        let mut carried: Vec<usize> = Vec::new();
        for k in (to + 1..self.list.len()).rev() {
            if self.effects[k].as_ref().is_some_and(|before| own.may_pass(before)) {
                continue;
            }
            let Stmt::Set(var, v) = &self.list[k] else { return None };
            // What is set again later on, or is looked at on the way, stays where it is.
            if !own.gets.contains(var) || carried.iter().any(|c| self.list[*c].sets() == Some(*var)) {
                return None;
            }
            own.sets.insert(*var);
            own.uses.insert(*v);
            carried.push(k);
        }
        let target = self.effects[to].as_ref();
        target.is_some_and(|target| !own.shares_vars(target)).then_some(carried)
    }
}

/// A loop whose body has no branches.
struct Plain {
    index: Index,
    from: u32,
    to: u32,
    body: Vec<Stmt>,
}

/// A read or write of memory in turns `from..to`.
struct Access {
    write: bool,
    memory: Memory,
    /// The first turn's place, and how far it is from one turn to the next; None where a table says.
    even: Option<(i64, i64)>,
    /// All places.
    low: i64,
    high: i64,
}

/// What a statement has to do with others.
#[derive(Default)]
struct Effects {
    memory: Vec<Access>,
    gets: FxHashSet<Var>,
    sets: FxHashSet<Var>,
    uses: FxHashSet<Value>,
    defines: FxHashSet<Value>,
}

impl Plain {
    fn of(s: Stmt) -> Result<Self, Stmt> {
        match s {
            Stmt::For(index, from, to, body) if body.iter().all(Stmt::is_straight) => {
                Ok(Self { index, from, to, body })
            }
            s => Err(s),
        }
    }

    fn stmt(self) -> Stmt {
        Stmt::For(self.index, self.from, self.to, self.body)
    }
}

impl Effects {
    /// Those of straight statements in turns `from..to` of a loop; None where there are others among them.
    fn of(body: &[Stmt], (index, from, to): (Option<Index>, u32, u32), tables: &[u32]) -> Option<Self> {
        let mut e = Self::default();
        for s in body {
            s.each_value(&mut |v| {
                e.uses.insert(v);
            });
            if !s.is_straight() {
                return None;
            }
            e.defines.extend(s.defines());
            e.sets.extend(s.sets());
            if let Some(p) = s.place() {
                e.memory.push(access(p, s.defines().is_none(), (index, from, to), tables)?);
            }
            if let Stmt::Let(_, Op::Get(var)) = s {
                e.gets.insert(*var);
            }
        }
        Some(e)
    }

    /// Whether what has these effects may change places with what has those, the earlier ones.
    fn may_pass(&self, before: &Self) -> bool {
        let pairs = self.memory.iter().flat_map(|a| before.memory.iter().map(move |b| (a, b)));
        !self.shares_vars(before)
            && self.uses.is_disjoint(&before.defines)
            && !pairs.into_iter().any(|(a, b)| (a.write || b.write) && a.overlaps(b))
    }

    fn shares_vars(&self, other: &Self) -> bool {
        !(self.sets.is_disjoint(&other.sets)
            && self.sets.is_disjoint(&other.gets)
            && self.gets.is_disjoint(&other.sets))
    }

    /// Whether a loop with these effects may go turn by turn with an earlier one with those, over so many turns.
    fn may_join(&self, before: &Self, turns: i64) -> bool {
        let late = |a: &Access, b: &Access| match (a.even, b.even) {
            // The earlier loop comes to the place this many turns after the later one.
            (Some((x, s)), Some((y, t))) if s == t && s > 0 => {
                (x - y) % s == 0 && (x - y) / s > 0 && (x - y) / s < turns
            }
            _ => a.overlaps(b),
        };
        let pairs = self.memory.iter().flat_map(|a| before.memory.iter().map(move |b| (a, b)));
        !self.shares_vars(before)
            && !pairs.into_iter().any(|(a, b)| (a.write || b.write) && a.memory == b.memory && late(a, b))
    }
}

impl Access {
    fn overlaps(&self, other: &Self) -> bool {
        let apart = match (self.even, other.even) {
            (Some((x, s)), Some((y, t))) => s == t && s > 0 && (x - y) % s != 0,
            _ => false,
        };
        self.memory == other.memory && self.low <= other.high && other.low <= self.high && !apart
    }
}

/// Whether any two turns of a loop in a row may go side by side, statement by statement: neither stores what the other
/// looks at or stores, and there are no branches.
pub(in crate::backend) fn may_pair(body: &[Stmt], (index, from, to): (Index, u32, u32), tables: &[u32]) -> bool {
    let Some(effects) = Effects::of(body, (Some(index), from, to), tables) else { return false };
    let meet = |a: &Access, b: &Access| match (a.even, b.even) {
        (Some((x, s)), Some((y, t))) if s == t => (x - y).abs() == s,
        _ => a.overlaps(b),
    };
    let mut writes = effects.memory.iter().filter(|a| a.write);
    !writes.any(|a| effects.memory.iter().any(|b| a.memory == b.memory && meet(a, b)))
}

/// Where a place is in turns of a loop; None where it depends on another one's counter.
fn access(p: &Place, write: bool, (index, from, to): (Option<Index>, u32, u32), tables: &[u32]) -> Option<Access> {
    let mut stride = 0;
    for (i, s) in &p.along {
        if Some(*i) != index {
            return None;
        }
        stride += i64::from(*s);
    }
    let (from, last) = (i64::from(from), i64::from(to) - 1);
    let base = i64::from(p.base);
    let (low, high) = (base + stride * from, base + stride * last);
    if let Some(picked) = p.picked {
        let high = high + i64::from(picked.stride) * i64::from(picked.count.saturating_sub(1));
        return p.through.is_none().then_some(Access { write, memory: p.memory, even: None, low, high });
    }
    match p.through {
        None => Some(Access { write, memory: p.memory, even: Some((base, stride)), low, high }),
        Some((at, i)) if Some(i) == index => {
            let list = tables.get((i64::from(at) + from) as usize..=(i64::from(at) + last) as usize)?;
            let (least, most) = (list.iter().min()?, list.iter().max()?);
            let (low, high) = (low + i64::from(*least), high + i64::from(*most));
            Some(Access { write, memory: p.memory, even: None, low, high })
        }
        Some(_) => None,
    }
}

impl Fuse<'_> {
    fn block(&mut self, body: &mut Vec<Stmt>) {
        let mut out = Out::default();
        for mut s in body.drain(..) {
            if !matches!(s, Stmt::For(..)) {
                s.inner_mut().for_each(|block| self.block(block));
            }
            match Plain::of(s) {
                Ok(l) => {
                    if let Some(rest) = self.join(&mut out, l) {
                        out.push(rest, self.tables);
                    }
                }
                Err(s) => out.push(s, self.tables),
            }
        }
        *body = out.list;
    }

    /// Joins a loop with one before it: what is left of it.
    fn join(&mut self, out: &mut Out, l: Plain) -> Option<Stmt> {
        for k in (out.list.len().saturating_sub(self.options.moved_over)..out.list.len()).rev() {
            let (Stmt::For(_, from, to, body), Some(before)) = (&out.list[k], &out.effects[k]) else {
                match out.effects[k] {
                    Some(_) => continue,
                    None => break,
                }
            };
            let (common, most) = (l.to.min(*to), l.to.max(*to));
            let turns = |to: u32| f64::from(to.saturating_sub(l.from));
            if *from != l.from
                || turns(common) < self.options.common_turns * turns(most)
                || body.len() + l.body.len() > self.options.joined_statements
            {
                continue;
            }
            let Some(mut own) = Effects::of(&l.body, (Some(l.index), l.from, common), self.tables) else { break };
            if own.may_join(before, i64::from(common - l.from))
                && let Some(carried) = out.way(&mut own, k)
                && self.may_split(&own, (&out.list[k], common))
            {
                return self.put(out, k, &carried, l);
            }
        }
        Some(l.stmt())
    }

    /// Whether the turns of a loop from `to` on may come after another one.
    fn may_split(&self, own: &Effects, (s, to): (&Stmt, u32)) -> bool {
        let Stmt::For(index, _, end, body) = s else { return false };
        let rest = || Effects::of(body, (Some(*index), to, *end), self.tables);
        *end <= to || rest().is_some_and(|rest| own.may_pass(&rest))
    }

    /// Puts a loop into the one with this number, and what goes with it before that; what is left of it.
    fn put(&mut self, out: &mut Out, k: usize, carried: &[usize], mut l: Plain) -> Option<Stmt> {
        let Stmt::For(index, from, end, mut body) = std::mem::replace(&mut out.list[k], Stmt::Break) else {
            return Some(l.stmt());
        };
        self.joined = true;
        let common = l.to.min(end);
        // The turns that only one of them has.
        let mut turns = |index: Index, body: &[Stmt], from: u32, to: u32| {
            (from < to).then(|| Stmt::For(index, from, to, self.copy(body, &mut FxHashMap::default())))
        };
        let more = turns(index, &body, common, end);
        let rest = turns(l.index, &l.body, common, l.to);
        l.body.iter_mut().for_each(|s| count_by(s, l.index, index));
        body.append(&mut l.body);
        let body = once(body, (Some(index), from, common), self.tables);
        let moved: Vec<Stmt> = carried.iter().map(|c| out.remove(*c)).collect();
        out.remove(k);
        let all = moved.into_iter().rev().chain([Stmt::For(index, from, common, body)]).chain(more);
        for (i, s) in all.enumerate() {
            out.insert(k + i, s, self.tables);
        }
        rest
    }

    /// The same statements with values of their own.
    fn copy(&mut self, body: &[Stmt], names: &mut FxHashMap<Value, Value>) -> Vec<Stmt> {
        let mut list = body.to_vec();
        for s in &mut list {
            rename(s, names);
            if let Stmt::Let(v, _) = s {
                let name = Value(self.values);
                self.values += 1;
                names.insert(*v, name);
                *v = name;
            }
        }
        list
    }
}

/// Has places of a statement counted by another counter.
fn count_by(s: &mut Stmt, old: Index, new: Index) {
    if let Some(p) = s.place_mut() {
        p.along.iter_mut().filter(|a| a.0 == old).for_each(|a| a.0 = new);
        if let Some((_, i)) = &mut p.through
            && *i == old
        {
            *i = new;
        }
    }
}

/// Gives the values that a straight statement uses other names.
fn rename(s: &mut Stmt, names: &FxHashMap<Value, Value>) {
    let mut to = |v: &mut Value| {
        if let Some(name) = names.get(v) {
            *v = *name;
        }
    };
    match s {
        Stmt::Let(_, op) => op.each_value_mut(&mut to),
        Stmt::Set(_, v) => to(v),
        Stmt::Store(p, v) => {
            p.picked.iter_mut().for_each(|picked| to(&mut picked.by));
            to(v);
        }
        _ => {}
    }
}

/// The body of a loop with everything computed once: what was stored or loaded in the same turn is not loaded again.
fn once(body: Vec<Stmt>, turns: (Option<Index>, u32, u32), tables: &[u32]) -> Vec<Stmt> {
    let mut names: FxHashMap<Value, Value> = FxHashMap::default();
    let mut known: Vec<(Place, Value)> = Vec::new();
    let mut ops: Vec<(Op, Value)> = Vec::new();
    let mut out = Vec::with_capacity(body.len());
    for mut s in body {
        rename(&mut s, &names);
        match &s {
            Stmt::Let(v, Op::Load(p)) => {
                if let Some((_, same)) = known.iter().find(|k| k.0 == *p) {
                    names.insert(*v, *same);
                    continue;
                }
                known.push((p.clone(), *v));
            }
            Stmt::Let(v, op @ (Op::Unary(..) | Op::Binary(..) | Op::Select(..))) => {
                if let Some((_, same)) = ops.iter().find(|o| o.0 == *op) {
                    names.insert(*v, *same);
                    continue;
                }
                ops.push((op.clone(), *v));
            }
            Stmt::Store(p, v) => {
                known.retain(|(q, _)| apart(p, q, turns, tables));
                known.push((p.clone(), *v));
            }
            _ => {}
        }
        out.push(s);
    }
    out
}

/// Whether two places are never the same in one turn.
fn apart(p: &Place, q: &Place, turns: (Option<Index>, u32, u32), tables: &[u32]) -> bool {
    let even = |p: &Place| p.through.is_none() && p.picked.is_none();
    let offset = even(p) && even(q) && p.along == q.along && p.base != q.base;
    let both = access(p, true, turns, tables).zip(access(q, true, turns, tables));
    offset || both.is_some_and(|(a, b)| !a.overlaps(&b))
}

/// Which numbers of the scratch are read at all.
struct Read<'a> {
    routine: &'a Routine,
    /// A bit each.
    cells: Vec<u64>,
    /// Of the counters of the loops around.
    ranges: FxHashMap<Index, (u32, u32)>,
}

impl Read<'_> {
    fn block(&mut self, body: &[Stmt]) {
        visit(body, &mut |s| match s {
            Stmt::Let(_, Op::Load(p)) if p.memory == Memory::Scratch => {
                let mut list = Vec::new();
                self.places(p, &mut |at| list.push(at));
                list.into_iter().for_each(|at| self.mark(at));
            }
            Stmt::Solve { system, matrix, vector, .. } => {
                let s = &self.routine.systems[*system as usize];
                let parts = if s.is_complex() { 2 } else { 1 };
                let (entries, numbers) = (parts * s.pattern.len() as u32, parts * s.n as u32);
                (*matrix..matrix + entries).chain(*vector..vector + numbers).for_each(|at| self.mark(at));
            }
            Stmt::For(i, from, to, _) => {
                self.ranges.insert(*i, (*from, *to));
            }
            _ => {}
        });
    }

    fn mark(&mut self, at: u32) {
        self.cells[at as usize / 64] |= 1 << (at % 64);
    }

    /// Each number that a place may be.
    fn places(&self, p: &Place, f: &mut impl FnMut(u32)) {
        let mut bases = vec![(p.base, None)];
        if let Some((at, i)) = p.through {
            let (from, to) = self.ranges.get(&i).copied().unwrap_or_default();
            bases = (from..to).map(|k| (p.base + self.routine.tables[(at + k) as usize], Some((i, k)))).collect();
        }
        for (i, stride) in &p.along {
            let (from, to) = self.ranges.get(i).copied().unwrap_or_default();
            let turns = |known: Option<(Index, u32)>| match known {
                Some((j, k)) if j == *i => k..k + 1,
                Some(_) | None => from..to,
            };
            bases = bases.iter().flat_map(|&(b, known)| turns(known).map(move |k| (b + stride * k, known))).collect();
        }
        bases.into_iter().for_each(|b| f(b.0));
    }

    /// Takes out what is stored into the scratch and never read.
    fn clear(&mut self, body: &mut Vec<Stmt>) {
        retain(body, &mut |s| {
            if let Stmt::For(i, from, to, _) = s {
                self.ranges.insert(*i, (*from, *to));
            }
            let Stmt::Store(p, _) = s else { return true };
            let mut used = p.memory != Memory::Scratch;
            if !used {
                self.places(p, &mut |at| used |= self.cells[at as usize / 64] >> (at % 64) & 1 == 1);
            }
            used
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::writer::{At, Writer, scratch};
    use super::*;

    /// `to[i] = from[i]` for ten places.
    fn copy(w: &mut Writer, from: Place, to: u32) {
        let index = w.index();
        let body = w.block(|w| {
            let x = w.load(Place { along: vec![(index, 1)], ..from });
            w.push(Stmt::Store(scratch(to, At::Each(index)), x));
        });
        w.push(Stmt::For(index, 0, 10, body));
    }

    fn loops(body: &[Stmt]) -> usize {
        body.iter().filter(|s| matches!(s, Stmt::For(..))).count()
    }

    #[test]
    fn loops_are_joined_where_turns_do_not_wait_for_later_ones() {
        let state = Place::new(Memory::State, 0);
        let next = |w: &mut Writer, from: u32| {
            let index = w.index();
            let body = w.block(|w| {
                let x = w.load(scratch(from, At::Each(index)));
                w.push(Stmt::Store(Place { along: vec![(index, 1)], ..Place::new(Memory::Next, 0) }, x));
            });
            w.push(Stmt::For(index, 0, 10, body));
        };
        // The second loop takes what the first leaves in the same turn, in the one before, in the next.
        for (offset, count) in [(20, 1), (19, 1), (21, 2)] {
            let mut w = Writer::new();
            w.room(64);
            copy(&mut w, state.clone(), 20);
            next(&mut w, offset);
            let routine = w.routine(String::new());
            assert_eq!(loops(&routine.body), count, "from {offset}");
            // What is handed on within a turn is not put down.
            let stores = format!("{:?}", routine.body).matches("Store(Place { memory: Scratch").count();
            assert_eq!(stores, usize::from(offset != 20), "from {offset}");
        }
    }

    #[test]
    fn turns_go_side_by_side_where_neither_waits_for_the_other() {
        // From one place of the scratch to another, so far apart.
        let moves = |to: u32, stride: u32| {
            let mut w = Writer::new();
            let index = w.index();
            let place = |base: u32| Place { along: vec![(index, stride)], ..scratch(base, At::One(0)) };
            let x = w.load(place(40));
            let body = vec![Stmt::Let(x, Op::Load(place(40))), Stmt::Store(place(to), x)];
            may_pair(&body, (index, 0, 20), &[])
        };
        assert!(moves(40, 1) && moves(42, 1) && moves(38, 1) && moves(100, 1) && moves(41, 2) && moves(44, 2));
        assert!(!moves(41, 1) && !moves(39, 1) && !moves(42, 2) && !moves(40, 0));
    }

    #[test]
    fn what_is_looked_at_on_the_way_keeps_its_place() {
        // Two loops that add the same variable, which is set anew between them: the first must not see that.
        for looks in [true, false] {
            let mut w = Writer::new();
            w.room(64);
            let (x, two) = (w.starting(1.0), w.number(2.0));
            let shifted = |w: &mut Writer, to: u32, looks: bool| {
                let index = w.index();
                let body = w.block(|w| {
                    let from = w.load(Place { along: vec![(index, 1)], ..Place::new(Memory::State, 0) });
                    let by = if looks { w.get(x) } else { two };
                    let sum = w.add(from, by);
                    w.push(Stmt::Store(Place { along: vec![(index, 1)], ..Place::new(Memory::Next, to) }, sum));
                });
                w.push(Stmt::For(index, 0, 10, body));
            };
            shifted(&mut w, 0, looks);
            w.set(x, two);
            shifted(&mut w, 10, true);
            assert_eq!(loops(&w.routine(String::new()).body), if looks { 2 } else { 1 }, "{looks}");
        }
        // The same where what looks stands between them.
        let mut w = Writer::new();
        w.room(64);
        let (x, two) = (w.starting(1.0), w.number(2.0));
        copy(&mut w, Place::new(Memory::State, 0), 0);
        let before = w.get(x);
        w.push(Stmt::Store(Place::new(Memory::Output, 0), before));
        w.set(x, two);
        let index = w.index();
        let body = w.block(|w| {
            let (from, by) = (w.load(scratch(0, At::Each(index))), w.get(x));
            let sum = w.add(from, by);
            w.push(Stmt::Store(Place { along: vec![(index, 1)], ..Place::new(Memory::Next, 0) }, sum));
        });
        w.push(Stmt::For(index, 0, 10, body));
        assert_eq!(loops(&w.routine(String::new()).body), 2);
    }

    #[test]
    fn a_sum_is_added_up_beside_what_it_is_of() {
        let mut w = Writer::new();
        w.room(64);
        copy(&mut w, Place::new(Memory::State, 0), 0);
        // Something else between, which neither loop looks at.
        let one = w.number(1.0);
        w.push(Stmt::Store(scratch(40, At::One(0)), one));
        let total = w.starting(0.0);
        let index = w.index();
        let body = w.block(|w| {
            let (sum, x) = (w.get(total), w.load(scratch(0, At::Each(index))));
            let sum = w.add(sum, x);
            w.set(total, sum);
        });
        w.push(Stmt::For(index, 0, 8, body));
        let sum = w.get(total);
        w.push(Stmt::Store(Place::new(Memory::Output, 0), sum));
        let routine = w.routine(String::new());
        // The first loop has two turns more.
        let ranges: Vec<(u32, u32)> = routine
            .body
            .iter()
            .filter_map(|s| if let Stmt::For(_, from, to, _) = s { Some((*from, *to)) } else { None })
            .collect();
        assert_eq!(ranges.first(), Some(&(0, 8)), "{:?}", routine.body);
        assert!(matches!(routine.body.first(), Some(Stmt::Set(..))), "{:?}", routine.body);
    }
}
