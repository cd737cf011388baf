//! Which values of straight code go side by side in vectors of two numbers, each to the bits that it has alone
//! (superword level parallelism: Larsen and Amarasinghe, PLDI 2000).
//!
//! Values that are made in the same way, from the same or from numbers, are paired: the states at two nodes of a step,
//! two rows of a matrix. What they are made from is paired with them, down to what both share. Then each group of pairs
//! that hang together is weighed: an instruction less a pair, against those that bring numbers into vectors and out.

use super::functions;
use super::vector::VectorOptions;
use crate::backend::code::{Memory, Op, Routine, Stmt, Value, visit};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::{FxHashMap, FxHashSet, FxHasher};
use std::cmp::Reverse;
use std::hash::{Hash, Hasher};

/// The pairs of some statements that come one after the other.
pub(super) struct Pairs {
    /// Where a value is defined.
    pub(super) place: FxHashMap<Value, usize>,
    /// By statement, the one that goes with it, in the order of the vector's numbers.
    pub(super) with: Vec<Option<[usize; 2]>>,
    /// Paired values that are asked for beyond the statements.
    pub(super) kept: Vec<Value>,
}

/// How often each value is looked at.
pub(super) fn uses(routine: &Routine) -> Vec<u32> {
    let mut uses = vec![0; routine.numbers.len()];
    visit(&routine.body, &mut |s| s.each_value(&mut |v| uses[v.0 as usize] += 1));
    uses
}

/// How many statements from the first on may be reordered, as long as each follows what it looks at: they define
/// values, set variables and store, and look at nothing that they set or stored.
pub(super) fn straight_line(body: &[Stmt]) -> usize {
    let (mut set, mut stored) = (FxHashSet::default(), FxHashSet::<Memory>::default());
    let goes = |s: &&Stmt| match s {
        Stmt::Let(_, Op::Load(place)) => !stored.contains(&place.memory),
        Stmt::Let(_, Op::Get(var)) => !set.contains(var),
        Stmt::Set(var, _) => {
            set.insert(*var);
            true
        }
        Stmt::Store(place, _) => {
            stored.insert(place.memory);
            true
        }
        s => s.is_straight(),
    };
    body.iter().take_while(goes).count()
}

/// What a statement does, where two of it may go side by side; the second value is the first again where it has one.
fn parts(s: &Stmt) -> Option<(Value, How, [Value; 2])> {
    match s {
        Stmt::Let(v, Op::Unary(f, a)) => match f {
            Unary::Neg | Unary::Abs | Unary::Sqrt => Some((*v, How::One(*f), [*a, *a])),
            _ => None,
        },
        Stmt::Let(v, Op::Binary(f, a, b)) if functions::binary(*f).is_none() => match f {
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Min | Binary::Max => {
                Some((*v, How::Two(*f), [*a, *b]))
            }
            _ => None,
        },
        _ => None,
    }
}

/// Functions of one and of two numbers.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum How {
    One(Unary),
    Two(Binary),
}

impl How {
    fn is_slow(self) -> bool {
        matches!(self, How::One(Unary::Sqrt) | How::Two(Binary::Div))
    }
}

/// How a value is made: equal ones may go side by side. No value is made from one of its own height, so that none waits
/// for another, and no pair for one that waits for it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Shape {
    height: Reverse<u32>,
    hash: u64,
}

/// Statements on their way to be paired.
struct Search<'a> {
    routine: &'a Routine,
    body: &'a [Stmt],
    place: FxHashMap<Value, usize>,
    with: Vec<Option<[usize; 2]>>,
}

/// The pairs of straight code; None where there are none that are worth it.
pub(super) fn pairs(routine: &Routine, uses: &[u32], body: &[Stmt], options: VectorOptions) -> Option<Pairs> {
    if body.len() < options.straight_statements {
        return None;
    }
    let defined = body.iter().enumerate().filter_map(|(i, s)| match s {
        Stmt::Let(v, _) => Some((*v, i)),
        _ => None,
    });
    let mut search = Search { routine, body, place: defined.collect(), with: vec![None; body.len()] };
    // What both are made from is the same at first, then of the same kind.
    for any in [false, true] {
        search.pair(any);
    }
    search.weigh(uses, options);
    let Search { place, with, .. } = search;
    if with.iter().all(Option::is_none) {
        return None;
    }
    let mut inside: FxHashMap<Value, u32> = FxHashMap::default();
    body.iter().for_each(|s| s.each_value(&mut |v| *inside.entry(v).or_default() += 1));
    let beyond = |v: &Value| uses[v.0 as usize] > inside.get(v).copied().unwrap_or(0);
    let kept = body.iter().zip(&with).filter(|(_, with)| with.is_some()).filter_map(|(s, _)| Some(parts(s)?.0));
    let kept = kept.filter(beyond).collect();
    Some(Pairs { place, with, kept })
}

impl Search<'_> {
    fn is_number(&self, v: Value) -> bool {
        self.routine.numbers[v.0 as usize].is_some()
    }

    /// How each value is made. `any`: whatever is not made here is of one kind.
    fn shapes(&self, any: bool) -> Vec<Shape> {
        let mut shapes: Vec<Shape> = Vec::with_capacity(self.body.len());
        for s in self.body {
            let mut hasher = FxHasher::default();
            let mut height = 0;
            s.each_value(&mut |v| {
                if let Some(&i) = self.place.get(&v) {
                    height = height.max(shapes[i].height.0 + 1);
                }
            });
            match (parts(s), s) {
                (Some((_, how, of)), _) => {
                    how.hash(&mut hasher);
                    for v in of {
                        match self.place.get(&v) {
                            Some(&i) => (2, shapes[i].hash).hash(&mut hasher),
                            None if self.is_number(v) => 1.hash(&mut hasher),
                            None if any => 0.hash(&mut hasher),
                            None => (0, v).hash(&mut hasher),
                        }
                    }
                }
                (None, Stmt::Let(v, _)) if !any => (3, v).hash(&mut hasher),
                (None, _) => (3, height).hash(&mut hasher),
            }
            shapes.push(Shape { height: Reverse(height), hash: hasher.finish() });
        }
        shapes
    }

    fn pair(&mut self, any: bool) {
        let shapes = self.shapes(any);
        let mut order: Vec<usize> = (0..self.body.len()).filter(|i| parts(&self.body[*i]).is_some()).collect();
        order.sort_by_key(|i| (shapes[*i], *i));
        for group in order.chunk_by(|i, j| shapes[*i] == shapes[*j]) {
            let mut first = None;
            for &i in group {
                if self.with[i].is_some() {
                    continue;
                }
                match first.take() {
                    None => first = Some(i),
                    Some(j) => self.join(&shapes, [j, i]),
                }
            }
        }
    }

    /// Pairs two statements, and what they are made from.
    fn join(&mut self, shapes: &[Shape], both: [usize; 2]) {
        let mut open = vec![both];
        while let Some([i, j]) = open.pop() {
            let (Some((_, how, a)), Some((_, as_well, b))) = (parts(&self.body[i]), parts(&self.body[j])) else {
                continue;
            };
            let free = self.with[i].is_none() && self.with[j].is_none();
            if i == j || !free || how != as_well || shapes[i] != shapes[j] {
                continue;
            }
            (self.with[i], self.with[j]) = (Some([i, j]), Some([i, j]));
            for (x, y) in a.into_iter().zip(b) {
                if let (Some(&i), Some(&j)) = (self.place.get(&x), self.place.get(&y)) {
                    open.push([i, j]);
                }
            }
        }
    }

    /// The statement of a pair's first value, where two values are that pair.
    fn joined(&self, [x, y]: [Value; 2]) -> Option<usize> {
        let both = [*self.place.get(&x)?, *self.place.get(&y)?];
        (self.with[both[0]] == Some(both)).then_some(both[0])
    }

    /// Takes pairs that hang together apart again where they cost more than they save.
    fn weigh(&mut self, uses: &[u32], options: VectorOptions) {
        // The pair that stands for those that hang together, by the statement of its first value.
        let mut stands: Vec<usize> = (0..self.body.len()).collect();
        fn of(stands: &mut [usize], mut i: usize) -> usize {
            while stands[i] != i {
                stands[i] = stands[stands[i]];
                i = stands[i];
            }
            i
        }
        let firsts: Vec<[usize; 2]> = (0..self.body.len()).filter_map(|i| self.with[i].filter(|w| w[0] == i)).collect();
        let made =
            |i: usize| parts(&self.body[i]).map_or((How::One(Unary::Not), [Value(0); 2]), |(_, how, of)| (how, of));
        let operands = |[i, j]: [usize; 2]| {
            let ((how, a), (_, b)) = (made(i), made(j));
            let count = if matches!(how, How::One(_)) { 1 } else { 2 };
            a.into_iter().zip(b).take(count).map(|(x, y)| [x, y]).collect::<Vec<_>>()
        };
        let mut within: FxHashMap<Value, u32> = FxHashMap::default();
        for &both in &firsts {
            for operand in operands(both) {
                if let Some(i) = self.joined(operand) {
                    operand.into_iter().for_each(|v| *within.entry(v).or_default() += 1);
                    let (i, j) = (of(&mut stands, i), of(&mut stands, both[0]));
                    stands[i] = j;
                }
            }
        }
        let (mut gains, mut brought) = (vec![0_i64; self.body.len()], FxHashSet::default());
        for &both in &firsts {
            let stand = of(&mut stands, both[0]);
            let mut gain = if made(both[0]).0.is_slow() { options.slow_gain } else { 1 };
            for [x, y] in operands(both) {
                let numbers = self.is_number(x) && self.is_number(y);
                if !numbers && self.joined([x, y]).is_none() && brought.insert((stand, x, y)) {
                    gain -= if x == y { 1 } else { 2 };
                }
            }
            if let Stmt::Let(v, _) = &self.body[both[1]] {
                gain -= i64::from(uses[v.0 as usize] > within.get(v).copied().unwrap_or(0));
            }
            gains[stand] += gain;
        }
        for [i, j] in firsts {
            if gains[of(&mut stands, i)] <= 0 {
                (self.with[i], self.with[j]) = (None, None);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::lower;
    use bond_runtime::ir::{Array, Builder, Slot};

    /// How many statements of a program's code, up to the last test of its results, are paired.
    fn paired(b: Builder) -> usize {
        let routine = lower(&b.finish()).unwrap();
        let body = &routine.body[..straight_line(&routine.body)];
        pairs(&routine, &uses(&routine), body, VectorOptions::default()).map_or(0, |p| p.with.iter().flatten().count())
    }

    /// Sums of the same states with a sum's own weights; every second sum has another number in between.
    fn sums(rows: usize, columns: usize, odd: bool) -> Builder {
        let mut b = Builder::new("sums");
        let (state, next) = (b.slots(Array::State, columns), b.slots(Array::Next, rows));
        let from: Vec<_> = (0..columns).map(|j| b.load(Slot::new(Array::State, state.index as usize + j))).collect();
        for i in 0..rows {
            let mut sum = b.number(i as f64 + 0.5);
            for (j, x) in from.iter().enumerate() {
                let w = b.number((1 + i * columns + j) as f64 / 7.3);
                let term = b.mul(w, *x);
                sum = if odd && i % 2 == 1 && j % 2 == 1 { b.sub(term, sum) } else { b.add(sum, term) };
            }
            b.store(Slot::new(Array::Next, next.index as usize + i), sum);
        }
        b
    }

    #[test]
    fn rows_of_a_matrix_go_side_by_side() {
        assert_eq!(paired(sums(4, 6, false)), 4 * 6 * 2);
        // The fifth has none to go with.
        assert_eq!(paired(sums(5, 6, false)), 4 * 6 * 2);
        // The first goes with the third then.
        assert_eq!(paired(sums(4, 6, true)), 4 * 6 * 2);
    }

    #[test]
    fn what_costs_more_than_it_saves_stays_alone() {
        // Two of four instructions saved, and two more that bring the numbers in and out.
        assert_eq!(paired(sums(2, 1, false)), 0);
        // One long sum: each of its numbers waits for the one before.
        assert_eq!(paired(sums(1, 30, false)), 0);
    }
}
