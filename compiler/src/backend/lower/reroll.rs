//! Large programs: groups of isomorphic computations become loops, so that a ladder's code is as long for 1e5 cells as
//! for ten.
//!
//! What a stretch of straight code gives (what it stores, and the values that are used after it) is cut into cones: a
//! result with all that it is made of, down to what is loaded, to numbers, and to other results. Cones of one shape are
//! a group, and a group is a loop over its members. Where the places that they read and write run evenly these are
//! counted, else they are looked up in a table. What two cones share is computed in both, unless that is dear. A long
//! sum is a group of terms, and a loop that adds them in their order, or several such sums side by side. A matrix that
//! depends on next to nothing, as that of a linear region does on the step alone, is made again, and factored, only
//! where that has changed.

mod expression_cone;
mod fixed;
mod isomorphic_group;
mod sum;

use super::newton::{Statements, places};
use super::recorder::Recorder;
use super::writer::{At, Vector, Writer, scratch};
use super::{ELIMINATED, Places};
use crate::backend::code::{Memory, Place, Stmt};
use bond_runtime::ir::{self, Array, Binary, Inst, Op, Program, Unary};
use expression_cone::Cone;
use fixed::Fixed;
use isomorphic_group::Watch;
use rustc_hash::FxHashSet;
use sum::{Sum, Total};

/// Writes a large program where the writer stands, and whether it did: some programs have a form that this cannot say.
pub(super) fn write(mut w: Writer, program: &Program, mut places: Places) -> (Writer, bool) {
    let before = w.scratch;
    places[Array::Local as usize] = (Memory::Scratch, w.room(program.size(Array::Local)));
    let n = program.values as usize;
    let (memory, base) = places[Array::Next as usize];
    let watch = Watch::new(&mut w, memory, base, program.size(Array::Next));
    let mut reroller = Reroller {
        places,
        ops: vec![Op::Const(0.0); n],
        home: vec![0; n],
        uses: vec![0; n],
        kept: vec![None; n],
        level: vec![0; n],
        skipped: vec![false; n],
        segments: vec![Segment::default()],
        loops: Vec::new(),
        linear: Vec::new(),
        stored: FxHashSet::default(),
        outputs: program.size(Array::Output),
        solved: vec![false; n],
        watch,
        totals: Vec::new(),
        w,
    };
    let gathered = reroller.gather(&program.body, false);
    reroller.unwatched();
    if gathered.and_then(|()| reroller.fixed()).and_then(|()| reroller.plan()).is_none() {
        reroller.w.scratch = before;
        return (reroller.w, false);
    }
    reroller.w.open();
    reroller.write();
    reroller.watch.check(&mut reroller.w);
    let body = reroller.w.close();
    // What sums begin from is put there first of all, so that nothing stands between loops that could be one.
    reroller.totals.iter().chain(reroller.watch.totals()).for_each(|total| total.begin(&mut reroller.w));
    body.into_iter().for_each(|s| reroller.w.push(s));
    (reroller.w, true)
}

/// Something that a segment gives: where to, which value, and whether its negative.
#[derive(Clone)]
struct Root {
    to: Place,
    value: ir::Value,
    negative: bool,
}

/// A stretch of straight code.
#[derive(Default)]
struct Segment {
    roots: Vec<Root>,
    sums: Vec<Sum>,
    /// What follows.
    then: Option<Then>,
}

/// What follows on a stretch of straight code, by its number.
#[derive(Clone, Copy)]
enum Then {
    Loop(usize),
    Linear(usize),
}

/// An iteration, its body's segment, and where its numbers are.
struct Loop<'p> {
    newton: &'p ir::Newton,
    body: usize,
    weight: u32,
    scale: u32,
    residual: u32,
    matrix: u32,
}

/// Linear equations: which segment comes before them, and where their matrix is. They are solved in place.
struct Linear<'p> {
    solve: &'p ir::Solve,
    before: usize,
    matrix: u32,
    /// The matrix, where it hardly ever changes: else the segment before makes it.
    fixed: Option<Fixed>,
}

/// A program on its way.
struct Reroller<'p> {
    places: Places,
    /// By value: how it is computed, in which segment, how often it is used.
    ops: Vec<Op>,
    home: Vec<u32>,
    uses: Vec<u32>,
    /// By value: its place in the scratch, where it is a result; how many results lie below it; whether a sum has
    /// swallowed it.
    kept: Vec<Option<u32>>,
    level: Vec<u32>,
    skipped: Vec<bool>,
    segments: Vec<Segment>,
    loops: Vec<Loop<'p>>,
    linear: Vec<Linear<'p>>,
    /// Slots of the program's scratch that it stores into.
    stored: FxHashSet<u32>,
    /// How many outputs the program has.
    outputs: usize,
    /// By value: whether it is loaded from where linear equations have left it, and nothing else writes.
    solved: Vec<bool>,
    /// The new state.
    watch: Watch,
    /// What sums are added up in.
    totals: Vec<Total>,
    w: Writer,
}

impl<'p> Reroller<'p> {
    /// Sorts instructions into segments.
    fn gather(&mut self, body: &'p [Inst], inside: bool) -> Option<()> {
        for inst in body {
            let here = self.segments.len() - 1;
            match inst {
                Inst::Let(v, op) => {
                    self.ops[v.0 as usize] = *op;
                    self.home[v.0 as usize] = here as u32;
                }
                Inst::Store(slot, v) => {
                    let (memory, base) = self.places[slot.array as usize];
                    if slot.array == Array::Local {
                        self.stored.insert(slot.index);
                    }
                    self.root(here, Place::new(memory, base + slot.index), *v);
                }
                Inst::Newton(newton) if !inside && newton.update.is_empty() && newton.residual.len() > ELIMINATED => {
                    let n = newton.residual.len();
                    self.segments[here].then = Some(Then::Loop(self.loops.len()));
                    let (weight, scale) = if newton.affine { (0, 0) } else { (self.w.room(n), self.w.room(n)) };
                    if !newton.affine {
                        for (i, (x, s)) in newton.weight.iter().zip(&newton.scale).enumerate() {
                            self.root(here, scratch(weight, At::One(i)), *x);
                            self.root(here, scratch(scale, At::One(i)), *s);
                        }
                    }
                    let (residual, matrix) = (self.w.room(n), self.w.room(newton.jacobian.len()));
                    self.segments.push(Segment::default());
                    let body = self.segments.len() - 1;
                    self.loops.push(Loop { newton, body, weight, scale, residual, matrix });
                    self.gather(&newton.body, true)?;
                    for (i, r) in newton.residual.iter().enumerate() {
                        self.root(body, scratch(residual, At::One(i)), *r);
                    }
                    self.segments.push(Segment::default());
                }
                Inst::Solve(solve) if !inside && solve.right.len() > ELIMINATED => {
                    let first = self.places[Array::Local as usize].1 + solve.unknowns;
                    for (i, b) in solve.right.iter().enumerate() {
                        // What is known sooner is put there sooner: no one else looks at the place until then.
                        let segment = if self.is_free(*b) { here } else { self.home[b.0 as usize] as usize };
                        self.root(segment, scratch(first, At::One(i)), *b);
                    }
                    let matrix = self.w.room(solve.values().count());
                    self.segments[here].then = Some(Then::Linear(self.linear.len()));
                    self.linear.push(Linear { solve, before: here, matrix, fixed: None });
                    self.segments.push(Segment::default());
                }
                Inst::Newton(_) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => return None,
            }
        }
        Some(())
    }

    /// Leaves out what need not be watched: what rounding took from a sum is finite where the sum is, which is watched,
    /// and an energy is finite only where all that it is made of are.
    fn unwatched(&mut self) {
        let stored = self.segments.iter().flat_map(|s| &s.roots).filter(|r| self.watch.holds(&r.to));
        let sums: FxHashSet<ir::Value> = stored.clone().map(|r| r.value).collect();
        let sides = |v: ir::Value, f: Binary| match self.ops[v.0 as usize] {
            Op::Binary(g, a, b) if f == g => Some((a, b)),
            Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => None,
        };
        // `y - (n - x)` with `n = x + y`.
        let is_rest = |v: ir::Value| {
            let parts = sides(v, Binary::Sub).and_then(|(y, done)| Some((y, sides(done, Binary::Sub)?)));
            parts.is_some_and(|(y, (n, x))| sums.contains(&n) && sides(n, Binary::Add) == Some((x, y)))
        };
        let mut left: FxHashSet<u32> = stored.clone().filter(|r| is_rest(r.value)).map(|r| r.to.base).collect();
        // A sum of what is stored tells of all that go into it.
        let (memory, base) = self.places[Array::Output as usize];
        let told = base..base + self.outputs as u32;
        let roots = self.segments.iter().flat_map(|s| &s.roots);
        let mut totals = Vec::new();
        for r in roots.filter(|r| r.to.memory == memory && told.contains(&r.to.base) && self.is_long(r.value)) {
            let shown = self.shown(r.value);
            let before = left.len();
            left.extend(stored.clone().filter(|r| shown.contains(&r.value)).map(|r| r.to.base));
            totals.extend((left.len() > before).then(|| r.to.clone()));
        }
        self.watch.leave(left, totals);
    }

    /// Whether a value is a sum of so many terms that it may be a loop.
    fn is_long(&self, v: ir::Value) -> bool {
        let (mut left, mut terms) = (vec![v], 0);
        while let Some(v) = left.pop() {
            match self.ops[v.0 as usize] {
                Op::Binary(Binary::Add, a, b) => left.extend([a, b]),
                Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => terms += 1,
            }
            if terms == self.w.loops.sum_terms {
                return true;
            }
        }
        false
    }

    /// The values that are finite wherever this one is.
    fn shown(&self, v: ir::Value) -> FxHashSet<ir::Value> {
        let (mut left, mut all) = (vec![v], FxHashSet::default());
        while let Some(v) = left.pop() {
            if !all.insert(v) {
                continue;
            }
            match self.ops[v.0 as usize] {
                Op::Binary(Binary::Add | Binary::Sub | Binary::Mul, a, b) => left.extend([a, b]),
                Op::Binary(Binary::Div, a, _) | Op::Unary(Unary::Neg | Unary::Abs | Unary::Sqrt, a) => left.push(a),
                Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => {}
            }
        }
        all
    }

    fn root(&mut self, segment: usize, to: Place, value: ir::Value) {
        self.segments[segment].roots.push(Root { to, value, negative: false });
    }

    /// Whether a value can be had anew anywhere: a number, or what is only read.
    fn is_free(&self, v: ir::Value) -> bool {
        match self.ops[v.0 as usize] {
            Op::Const(_) => true,
            Op::Load(slot) => slot.array != Array::Local || self.solved[v.0 as usize],
            Op::Unary(..) | Op::Binary(..) | Op::Select(..) => false,
        }
    }

    /// Finds long sums, and which values are results.
    fn plan(&mut self) -> Option<()> {
        let (n, options) = (self.ops.len(), self.w.loops);
        // A value that another segment uses.
        let mut outside = vec![false; n];
        for v in 0..n {
            for a in self.ops[v].operands() {
                self.uses[a.0 as usize] += 1;
                outside[a.0 as usize] |= self.home[a.0 as usize] != self.home[v];
            }
        }
        for (s, segment) in self.segments.iter().enumerate() {
            for r in &segment.roots {
                self.uses[r.value.0 as usize] += 1;
                outside[r.value.0 as usize] |= self.home[r.value.0 as usize] != s as u32;
            }
        }
        self.ordered()?;
        self.steady()?;
        let ends = self.sums(&outside);
        let mut size = vec![0u32; n];
        for v in 0..n {
            let value = ir::Value(v as u32);
            if self.skipped[v] || self.is_free(value) {
                size[v] = 1;
                continue;
            }
            let (mut sum, mut level) = (1u32, 0);
            if let Some(&(from, count)) = ends.get(&value) {
                for r in &self.segments[self.home[v] as usize].roots[from..from + count] {
                    level = level.max(self.after(r.value) + 1);
                }
            } else {
                for a in self.ops[v].operands() {
                    level = level.max(if self.home[a.0 as usize] == self.home[v] { self.after(a) } else { 0 });
                    sum = sum.saturating_add(if self.kept[a.0 as usize].is_some() { 1 } else { size[a.0 as usize] });
                }
            }
            (size[v], self.level[v]) = (sum, level);
            let dear = match self.ops[v] {
                Op::Unary(f, _) => !matches!(f, Unary::Neg | Unary::Abs | Unary::Sign | Unary::Not),
                Op::Binary(f, ..) => matches!(f, Binary::Div | Binary::Pow | Binary::Atan2),
                Op::Const(_) | Op::Load(_) | Op::Select(..) => false,
            };
            let shared = dear || sum > options.shared_operations;
            let is_end = ends.contains_key(&value);
            if outside[v] || sum > options.cone_operations || (shared && self.uses[v] > 1) || is_end {
                let at = self.w.room(1);
                self.kept[v] = Some(at);
                if !is_end {
                    self.root(self.home[v] as usize, scratch(at, At::One(0)), value);
                }
            }
        }
        self.level.iter().all(|l| *l <= options.levels).then_some(())
    }

    /// The level from which on a value of the same segment can be used.
    fn after(&self, v: ir::Value) -> u32 {
        let level = self.level[v.0 as usize];
        if self.kept[v.0 as usize].is_some() { level + 1 } else { level }
    }

    /// Finds loads of what linear equations have left where nothing else writes. Fails where such a place is written
    /// besides.
    fn steady(&mut self) -> Option<()> {
        let mut left: rustc_hash::FxHashMap<u32, usize> = rustc_hash::FxHashMap::default();
        for l in &self.linear {
            for k in 0..l.solve.right.len() as u32 {
                let slot = l.solve.unknowns + k;
                if self.stored.contains(&slot) || left.insert(slot, l.before).is_some() {
                    return None;
                }
            }
        }
        for (v, op) in self.ops.iter().enumerate() {
            if let Op::Load(slot) = op
                && slot.array == Array::Local
                && let Some(before) = left.get(&slot.index)
            {
                if self.home[v] as usize <= *before {
                    return None;
                }
                self.solved[v] = true;
            }
        }
        Some(())
    }

    /// Fails where a segment both loads and stores a place of the program's scratch: results are not in the order of
    /// the program.
    fn ordered(&self) -> Option<()> {
        let (_, first) = self.places[Array::Local as usize];
        let loads = self.ops.iter().zip(&self.home).filter_map(|(op, home)| match op {
            Op::Load(slot) if slot.array == Array::Local => Some((*home as usize, first + slot.index)),
            Op::Const(_) | Op::Load(_) | Op::Unary(..) | Op::Binary(..) | Op::Select(..) => None,
        });
        let loads: FxHashSet<(usize, u32)> = loads.collect();
        let clash = |s: usize, r: &Root| r.to.memory == Memory::Scratch && loads.contains(&(s, r.to.base));
        let mut segments = self.segments.iter().enumerate();
        (!segments.any(|(s, segment)| segment.roots.iter().any(|r| clash(s, r)))).then_some(())
    }

    fn write(&mut self) {
        let mut s = 0;
        while s < self.segments.len() {
            self.segment(s);
            match self.segments[s].then {
                Some(Then::Loop(k)) => {
                    self.iteration(k);
                    s = self.loops[k].body;
                }
                Some(Then::Linear(k)) => self.equations(k),
                None => {}
            }
            s += 1;
        }
    }

    fn iteration(&mut self, k: usize) {
        let Loop { newton, body, weight, scale, residual, matrix } = self.loops[k];
        let first = self.places[Array::Local as usize].1;
        let unknowns = (Vector::Memory(first + newton.unknowns), newton.rounding.map(|r| Vector::Memory(first + r)));
        let given = (Vector::Memory(weight), Vector::Memory(scale), None);
        let places = places(&mut self.w, newton, unknowns, given);
        let mut writer = std::mem::take(&mut self.w);
        let equations = Statements::new(&mut writer, newton, Some(matrix), |m, _| {
            m.with(|w| std::mem::swap(w, &mut self.w));
            self.segment(body);
            m.with(|w| std::mem::swap(w, &mut self.w));
            (Vector::Memory(residual), Vec::new())
        });
        let recorder = Recorder::new(writer);
        let good = equations.write(&recorder, places);
        self.w = recorder.into_writer();
        if let (Some(flag), Some(x)) = (newton.flag, good) {
            self.w.push(Stmt::Store(Place::new(Memory::Scratch, first + flag.index), x));
        }
    }

    /// Solves linear equations.
    fn equations(&mut self, k: usize) {
        let Linear { solve, matrix, ref fixed, .. } = self.linear[k];
        let fixed = fixed.clone();
        let same = fixed.as_ref().map(|f| self.remake(f));
        let first = self.places[Array::Local as usize].1;
        let row = self.w.var();
        super::newton::solved_for(&mut self.w, solve, (matrix, first + solve.unknowns), row, same);
        let good = super::newton::ended(&mut self.w, solve, row);
        if let (Some(flag), Some(good)) = (solve.flag, good) {
            self.w.push(Stmt::Store(Place::new(Memory::Scratch, first + flag.index), good));
        }
    }

    /// Writes a segment, level by level.
    fn segment(&mut self, s: usize) {
        let segment = std::mem::take(&mut self.segments[s]);
        let level = |r: &Root| {
            let v = r.value;
            let own = self.kept[v.0 as usize].is_some_and(|at| r.to == scratch(at, At::One(0)));
            match () {
                () if self.home[v.0 as usize] != s as u32 => 0,
                () if own => self.level[v.0 as usize],
                () => self.after(v),
            }
        };
        let last =
            segment.roots.iter().map(level).chain(segment.sums.iter().map(|s| self.level[s.end.0 as usize])).max();
        let mut by: Vec<(Vec<&Root>, Vec<&Sum>)> = (0..=last.unwrap_or(0)).map(|_| (Vec::new(), Vec::new())).collect();
        segment.roots.iter().for_each(|r| by[level(r) as usize].0.push(r));
        segment.sums.iter().for_each(|x| by[self.level[x.end.0 as usize] as usize].1.push(x));
        for (roots, sums) in by {
            for sum in sums {
                self.add_up(sum);
            }
            let cones: Vec<Cone> = roots.iter().map(|r| Cone::new(self, r)).collect();
            isomorphic_group::write(&mut self.w, &mut self.watch, cones);
        }
        self.segments[s].then = segment.then;
    }
}
