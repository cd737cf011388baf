//! Long sums: a group of terms, and a loop that adds them, one after the other, or, where the program adds several
//! sums side by side that it then makes one, so, that nothing waits for the term before.

use super::{Reroller, Root};
use crate::backend::code::{Index, Stmt, Value, Var};
use crate::backend::lower::writer::{At, Writer, scratch};
use bond_runtime::ir::{self, Binary, Op, SIDE_BY_SIDE};
use rustc_hash::FxHashMap;

/// A long sum: its last value, where its terms lie, in their order, and whether it is several side by side.
pub(super) struct Sum {
    pub(super) end: ir::Value,
    terms: u32,
    count: u32,
    side_by_side: bool,
}

/// What a loop adds up.
pub(super) enum Total {
    /// All of it, one turn after the other.
    One(Var),
    /// From this place on what each turn leaves, made of what the turn so many before it left; first of all what these
    /// begin from. So turns that follow each other do not wait.
    SideBySide(u32, f64),
}

impl Total {
    /// Of a loop of so many turns, where the order does not matter.
    pub(super) fn of(w: &mut Writer, turns: usize, none: f64) -> Self {
        if turns < w.loops.sum_terms * SIDE_BY_SIDE {
            Self::One(w.starting(none))
        } else {
            Self::side_by_side(w, turns, none)
        }
    }

    fn side_by_side(w: &mut Writer, turns: usize, none: f64) -> Self {
        Self::SideBySide(w.room(turns + SIDE_BY_SIDE), none)
    }

    /// Puts down what it begins from, where that is a place: the loops leave it as it is.
    pub(super) fn begin(&self, w: &mut Writer) {
        if let Self::SideBySide(at, none) = self {
            let (index, none) = (w.index(), w.number(*none));
            let body = vec![Stmt::Store(scratch(*at, At::Each(index)), none)];
            w.push(Stmt::For(index, 0, SIDE_BY_SIDE as u32, body));
        }
    }

    /// Adds a number of this turn.
    pub(super) fn add(&self, w: &mut Writer, index: Index, x: Value) {
        match self {
            Self::One(var) => {
                let before = w.get(*var);
                let after = w.add(before, x);
                w.set(*var, after);
            }
            Self::SideBySide(at, _) => {
                let before = w.load(scratch(*at, At::Each(index)));
                let after = w.add(before, x);
                w.push(Stmt::Store(scratch(at + SIDE_BY_SIDE as u32, At::Each(index)), after));
            }
        }
    }

    /// What so many turns come to.
    pub(super) fn value(&self, w: &mut Writer, turns: usize) -> Value {
        match self {
            Self::One(var) => w.get(*var),
            Self::SideBySide(at, _) => {
                // The last turn of each of them.
                let last = |k: usize| turns + (k + SIDE_BY_SIDE - turns % SIDE_BY_SIDE) % SIDE_BY_SIDE;
                let mut parts: Vec<Value> = (0..SIDE_BY_SIDE).map(|k| w.load(scratch(*at, At::One(last(k))))).collect();
                while parts.len() > 1 {
                    let other = parts.split_off(parts.len() / 2);
                    parts = parts.iter().zip(&other).map(|(a, b)| w.add(*a, *b)).collect();
                }
                parts[0]
            }
        }
    }
}

/// Terms of a sum, each with whether its negative is added.
type Terms = Vec<(ir::Value, bool)>;

impl Reroller<'_> {
    /// Finds long sums: by their last value, the roots of its segment that are its terms.
    pub(super) fn sums(&mut self, outside: &[bool]) -> FxHashMap<ir::Value, (usize, usize)> {
        let mut ends = FxHashMap::default();
        for v in (0..self.ops.len() as u32).rev().map(ir::Value) {
            if let Some((terms, links)) = self.side_by_side(v, outside) {
                links.iter().for_each(|v| self.skipped[v.0 as usize] = true);
                self.sum(v, terms, true, &mut ends);
            }
        }
        let n = self.ops.len();
        let mut length = vec![0; n];
        let mut linked = vec![false; n];
        let known = |s: &Self, v: ir::Value| s.skipped[v.0 as usize] || ends.contains_key(&v);
        for v in 0..n {
            let Some((_, a, _)) = sides(&self.ops[v]).filter(|_| !known(self, ir::Value(v as u32))) else { continue };
            let i = a.0 as usize;
            length[v] = 1;
            if length[i] > 0 && self.is_link(a, v, outside) {
                linked[i] = true;
                length[v] = length[i] + 1;
            }
        }
        for v in 0..n {
            if linked[v] || length[v] < self.w.loops.sum_terms {
                continue;
            }
            let end = ir::Value(v as u32);
            let (terms, links) = self.chain(end, length[v]);
            links.iter().for_each(|v| self.skipped[v.0 as usize] = true);
            self.sum(end, terms, false, &mut ends);
        }
        ends
    }

    /// Whether a value is nothing but a part of the sum that another one is.
    fn is_link(&self, a: ir::Value, of: usize, outside: &[bool]) -> bool {
        let i = a.0 as usize;
        self.uses[i] == 1 && !outside[i] && self.home[i] == self.home[of]
    }

    /// The terms of so many additions, one after the other, that end in a value, in their order; and what stands
    /// between.
    fn chain(&self, end: ir::Value, additions: usize) -> (Terms, Vec<ir::Value>) {
        let (mut terms, mut links, mut at) = (Vec::with_capacity(additions + 1), Vec::new(), end);
        for k in 0..additions {
            let Some((f, a, b)) = sides(&self.ops[at.0 as usize]) else { break };
            terms.push((b, f == Binary::Sub));
            if k + 1 < additions {
                links.push(a);
            }
            at = a;
        }
        terms.push((at, false));
        terms.reverse();
        (terms, links)
    }

    /// The terms of a value that is made of [`SIDE_BY_SIDE`] sums as `Builder::total` makes them, in their order; and
    /// all that stands between.
    fn side_by_side(&self, end: ir::Value, outside: &[bool]) -> Option<(Terms, Vec<ir::Value>)> {
        if self.skipped[end.0 as usize] {
            return None;
        }
        let mut parts = vec![end];
        let mut links = Vec::new();
        while parts.len() < SIDE_BY_SIDE {
            let halves = parts.iter().map(|v| match self.ops[v.0 as usize] {
                Op::Binary(Binary::Add, a, b) => Some((a, b)),
                Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => None,
            });
            let (mut left, right): (Vec<_>, Vec<_>) = halves.collect::<Option<Vec<_>>>()?.into_iter().unzip();
            left.extend(right);
            if !left.iter().all(|v| self.is_link(*v, end.0 as usize, outside)) {
                return None;
            }
            links.extend(&left);
            parts = left;
        }
        let length = |v: &ir::Value| {
            let (mut n, mut at) = (0, *v);
            while let Some((_, a, _)) = sides(&self.ops[at.0 as usize])
                && (n == 0 || self.is_link(at, end.0 as usize, outside))
            {
                (n, at) = (n + 1, a);
            }
            n
        };
        let lengths: Vec<usize> = parts.iter().map(length).collect();
        // So many terms each; the first ones may have one more.
        let least = *lengths.iter().min()?;
        let more = lengths.iter().take_while(|n| **n > least).count();
        if least + 1 < self.w.loops.sum_terms {
            return None;
        }
        let chains = parts.iter().enumerate().map(|(k, v)| self.chain(*v, if k < more { least + 1 } else { least }));
        let (chains, between): (Vec<Terms>, Vec<Vec<ir::Value>>) = chains.unzip();
        links.extend(between.into_iter().flatten());
        let count = SIDE_BY_SIDE * (least + 1) + more;
        Some(((0..count).map(|i| chains[i % SIDE_BY_SIDE][i / SIDE_BY_SIDE]).collect(), links))
    }

    fn sum(
        &mut self,
        end: ir::Value,
        terms: Terms,
        side_by_side: bool,
        ends: &mut FxHashMap<ir::Value, (usize, usize)>,
    ) {
        let base = self.w.room(terms.len());
        let segment = &mut self.segments[self.home[end.0 as usize] as usize];
        let from = segment.roots.len();
        for (i, (value, negative)) in terms.iter().enumerate() {
            segment.roots.push(Root { to: scratch(base, At::One(i)), value: *value, negative: *negative });
        }
        segment.sums.push(Sum { end, terms: base, count: terms.len() as u32, side_by_side });
        ends.insert(end, (from, terms.len()));
    }

    /// Adds the terms of a sum.
    pub(super) fn add_up(&mut self, sum: &Sum) {
        let Some(to) = self.kept[sum.end.0 as usize] else { return };
        let (w, turns) = (&mut self.w, sum.count as usize);
        // -0 is what adds nothing, not even to -0.
        let total = if sum.side_by_side { Total::side_by_side(w, turns, -0.0) } else { Total::One(w.starting(-0.0)) };
        let index = w.index();
        let body = w.block(|w| {
            let term = w.load(scratch(sum.terms, At::Each(index)));
            total.add(w, index, term);
        });
        w.push(Stmt::For(index, 0, sum.count, body));
        let value = total.value(w, turns);
        w.push(Stmt::Store(scratch(to, At::One(0)), value));
        self.totals.push(total);
    }
}

/// The sides of an addition or subtraction.
fn sides(op: &Op) -> Option<(Binary, ir::Value, ir::Value)> {
    match *op {
        Op::Binary(f @ (Binary::Add | Binary::Sub), a, b) => Some((f, a, b)),
        Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => None,
    }
}
