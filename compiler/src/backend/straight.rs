//! A routine without control flow: what many scenes do side by side in vector lanes, each to the bits that it has alone.
//!
//! Both ways of a branch are computed, and each number is chosen by the branch's condition where they meet again; so is
//! what a loop leaves that is run through once and left in different places. What would take long or really repeats
//! (an iteration that goes on, an elimination) and what fails is not there: where a scene would get to it, a flag says
//! that it is *slow*, to be done anew by the routine itself from the numbers that the interval found.

use super::code::{Cond, Memory, Number, Op, Place, Routine, Stmt, Value};
use bond_runtime::ir::{Binary, Unary};
use std::collections::{BTreeMap, BTreeSet};

/// Routines of more statements have no straight form: a compiler takes long for so many at once.
const LARGEST: usize = 6000;
/// Nor have those that would come to more values than this.
const MOST: usize = 2000;
/// Twice as long, and so many values longer, at most is code with the turns of iterations that go on.
const LONGER: usize = 300;
/// Iterations that go on are gone on with so many times.
const TURNS: usize = 2;
/// How far back a condition is followed to the numbers that it depends on.
const DEPTH: usize = 24;

/// A routine without control flow.
#[derive(Clone, Debug, PartialEq)]
pub struct Straight {
    /// By value: the number that it is, where it is one; as [`Routine::numbers`].
    pub numbers: Vec<Option<Number>>,
    /// What is computed, in this order. Loads are of what the block and the input are at the start.
    pub body: Vec<Line>,
    /// Whether the numbers below are not those of the routine.
    pub slow: Cond,
    /// Places of the block, and what is in them at the end.
    pub writes: Vec<(u32, Value)>,
    /// Values that are 1 or 0 and are looked at by conditions alone.
    pub flags: BTreeSet<Value>,
}

/// A value of straight code.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Which one.
    pub value: Value,
    /// How it is computed. No variables.
    pub op: Op,
    /// Of a function that takes long: where this does not hold, nothing looks at it.
    pub when: Option<Value>,
}

/// Whether a function takes long, and is none of those that several numbers take at once.
pub fn is_call(op: &Op) -> bool {
    match op {
        Op::Unary(f, _) => match f {
            Unary::Neg | Unary::Abs | Unary::Sign | Unary::Not => false,
            Unary::Sqrt
            | Unary::Exp
            | Unary::Log
            | Unary::Sin
            | Unary::Cos
            | Unary::Tan
            | Unary::Asin
            | Unary::Acos
            | Unary::Atan
            | Unary::Sinh
            | Unary::Cosh
            | Unary::Tanh => true,
        },
        Op::Binary(f, ..) => matches!(f, Binary::Pow | Binary::Atan2),
        Op::Load(_) | Op::Get(_) | Op::Select(..) => false,
    }
}

/// The straight form of a routine; None where it has none, or always would be slow.
pub fn straight(routine: &Routine) -> Option<Straight> {
    if !routine.systems.is_empty() || routine.size() > LARGEST || is_heavy(&routine.body, false) {
        return None;
    }
    let short = form(routine, 0);
    let long = form(routine, TURNS);
    let form = match (short, long) {
        (Some(short), Some(long)) if long.body.len() > 2 * short.body.len() + LONGER => Some(short),
        (short, long) => long.or(short),
    };
    form.filter(|form| form.body.len() <= MOST)
}

/// The form of a routine, with the first turns of what repeats, or without.
fn form(routine: &Routine, turns: usize) -> Option<Straight> {
    let mut numbers = routine.numbers.clone();
    let mut number = |x: f64| {
        let found = numbers.iter().position(|n| matches!(n, Some(Number::Plain(y)) if y.to_bits() == x.to_bits()));
        Value(found.unwrap_or_else(|| {
            numbers.push(Some(Number::Plain(x)));
            numbers.len() - 1
        }) as u32)
    };
    let (zero, one) = (number(0.0), number(1.0));
    let known = numbers.len();
    let state = State { vars: vec![zero; routine.vars as usize], places: BTreeMap::new() };
    let mut way = Way {
        zero,
        one,
        values: (0..known as u32).map(Value).collect(),
        ops: vec![None; known],
        numbers,
        body: Vec::new(),
        loads: BTreeMap::new(),
        state,
        frames: vec![Frame::default()],
        slow: Vec::new(),
        facts: Vec::new(),
        last: None,
        turns,
        lost: false,
    };
    let end = way.block(&routine.body);
    if end == End::Gone || way.lost {
        return None;
    }
    way.finish()
}

/// What is known where the statements have got to.
#[derive(Clone)]
struct State {
    /// By variable.
    vars: Vec<Value>,
    /// Places that were written.
    places: BTreeMap<(Memory, u32), Value>,
}

/// A loop that is run through once, or the routine.
#[derive(Default)]
struct Frame {
    /// The branches that have led here.
    path: Vec<Cond>,
    /// Whether it may be begun anew.
    again: bool,
    /// Where it was left. The first condition that holds is the place; what comes later may hold by chance.
    left: Vec<(Cond, State)>,
}

/// How a block ends.
#[derive(Clone, Copy, PartialEq)]
enum End {
    /// At its end.
    Reached,
    /// Before.
    Gone,
}

/// A routine on its way.
struct Way {
    numbers: Vec<Option<Number>>,
    zero: Value,
    one: Value,
    /// By value of the routine: what it is here.
    values: Vec<Value>,
    /// By value: how it is computed.
    ops: Vec<Option<Op>>,
    body: Vec<Line>,
    loads: BTreeMap<(Memory, u32), Value>,
    state: State,
    frames: Vec<Frame>,
    slow: Vec<Cond>,
    /// Flags that are known where the statements have got to.
    facts: Vec<(Value, bool)>,
    /// The condition that was made a flag last for what takes long.
    last: Option<(Cond, Value)>,
    /// How many times what repeats is gone through.
    turns: usize,
    /// Whether something has no form here.
    lost: bool,
}

impl Way {
    fn define(&mut self, op: Op, when: Option<Value>) -> Value {
        let v = Value(self.numbers.len() as u32);
        self.numbers.push(None);
        self.ops.push(Some(op.clone()));
        self.body.push(Line { value: v, op, when });
        v
    }

    /// The number that a value is, where it is one that double and single numbers have alike.
    fn known(&self, v: Value) -> Option<f64> {
        match self.numbers[v.0 as usize] {
            Some(Number::Plain(x)) if f64::from(x as f32) == x || x.is_nan() => Some(x),
            Some(Number::Plain(_) | Number::Tolerance(_)) | None => None,
        }
    }

    fn block(&mut self, rest: &[Stmt]) -> End {
        for (k, s) in rest.iter().enumerate() {
            match s {
                Stmt::Let(v, op) => self.values[v.0 as usize] = self.op(op),
                Stmt::Set(var, v) => self.state.vars[var.0 as usize] = self.values[v.0 as usize],
                Stmt::Store(p, v) => {
                    let at = self.fixed(p);
                    self.state.places.insert(at, self.values[v.0 as usize]);
                }
                Stmt::If(c, yes, no) => {
                    if self.branch(c, yes, no) == End::Gone {
                        return End::Gone;
                    }
                }
                Stmt::Loop(body) => {
                    let (again, facts) = (repeats(body), self.facts.len());
                    self.frames.push(Frame { again, ..Frame::default() });
                    let innermost = !body.iter().any(|s| matches!(s, Stmt::Loop(_)));
                    let turns = if again && innermost { self.turns } else { 1 };
                    if (0..turns).all(|_| self.block(body) == End::Reached) {
                        self.give_up();
                    }
                    self.facts.truncate(facts);
                    let left = self.frames.pop().map(|f| f.left).unwrap_or_default();
                    let left = self.fine(left, &rest[k + 1..]);
                    let Some(state) = self.meet(left) else { return End::Gone };
                    self.state = state;
                }
                Stmt::Break => {
                    let Some(frame) = self.frames.last_mut() else { return End::Gone };
                    frame.left.push((Cond::all(frame.path.clone()), self.state.clone()));
                    return End::Gone;
                }
                // Looked for before blocks with them are gone into.
                Stmt::Continue | Stmt::For(..) | Stmt::Solve { .. } | Stmt::Fail(_) => {
                    self.give_up();
                    return End::Gone;
                }
                // For who runs a scene within this program.
                Stmt::Count(_) | Stmt::Note(_) => {}
            }
        }
        End::Reached
    }

    /// Of the places where a loop is left, those from which what comes next is not what has no form here. Nothing that
    /// the others leave behind is computed; who leaves there is slow.
    fn fine(&mut self, left: Vec<(Cond, State)>, next: &[Stmt]) -> Vec<(Cond, State)> {
        let lets = next.iter().take_while(|s| matches!(s, Stmt::Let(_, Op::Get(_)))).count();
        let Some(Stmt::If(c, yes, no)) = next.get(lets) else { return left };
        let mut fine = Vec::new();
        for (_, state) in &left {
            for s in &next[..lets] {
                if let Stmt::Let(v, Op::Get(var)) = s {
                    self.values[v.0 as usize] = state.vars[var.0 as usize];
                }
            }
            fine.push(match self.cond(c).known() {
                Some(holds) => !is_heavy(if holds { yes } else { no }, self.turns > 0),
                None => true,
            });
        }
        if fine.iter().all(|f| *f) || !fine.contains(&true) {
            return left;
        }
        let (mut rest, mut sound) = (left.iter().zip(&fine).rev(), Cond::Known(true));
        if let Some((_, last)) = rest.next() {
            sound = Cond::Known(*last);
        }
        for ((c, _), fine) in rest {
            sound = if *fine { Cond::any([c.clone(), sound]) } else { Cond::all([c.clone().not(), sound]) };
        }
        let slow = Cond::all([self.here(), sound.not()]);
        self.slow.push(slow);
        left.into_iter().zip(fine).filter(|(_, fine)| *fine).map(|(left, _)| left).collect()
    }

    /// What is where a loop has been left, in several places.
    fn meet(&mut self, left: Vec<(Cond, State)>) -> Option<State> {
        let mut rest = left.into_iter().rev();
        let (_, mut state) = rest.next()?;
        for (c, before) in rest {
            let c = match c {
                Cond::All(_) => Cond::True(self.flag(c)),
                c => c,
            };
            state = self.choose(&c, &before, &state);
        }
        Some(state)
    }

    fn branch(&mut self, c: &Cond, yes: &[Stmt], no: &[Stmt]) -> End {
        let mut c = self.cond(c);
        if let Some(holds) = c.known() {
            return self.block(if holds { yes } else { no });
        }
        let (mut yes, mut no) = (yes, no);
        if let Cond::Not(opposite) = c {
            c = *opposite;
            (yes, no) = (no, yes);
        }
        if !matches!(c, Cond::True(_)) {
            c = Cond::True(self.flag(c));
        }
        let before = self.state.clone();
        let first = self.arm(c.clone(), yes);
        let there = std::mem::replace(&mut self.state, before);
        let second = self.arm(c.clone().not(), no);
        match (first, second) {
            (End::Gone, End::Gone) => return End::Gone,
            (End::Gone, End::Reached) => self.learn(&c, false),
            (End::Reached, End::Gone) => {
                self.state = there;
                self.learn(&c, true);
            }
            (End::Reached, End::Reached) => {
                let here = self.state.clone();
                self.state = self.choose(&c, &there, &here);
            }
        }
        End::Reached
    }

    /// One way of a branch.
    fn arm(&mut self, c: Cond, body: &[Stmt]) -> End {
        if body.is_empty() {
            return End::Reached;
        }
        let facts = self.facts.len();
        self.learn(&c, true);
        let mut again = false;
        if let Some(frame) = self.frames.last_mut() {
            frame.path.push(c);
            again = frame.again;
        }
        // What has an iteration go back is not worth its length.
        let rare = again && begins_anew(body);
        let end = if rare || is_heavy(body, self.turns > 0) || (has_fail(body) && !has_effect(body)) {
            self.give_up();
            End::Gone
        } else {
            self.block(body)
        };
        self.facts.truncate(facts);
        if let Some(frame) = self.frames.last_mut() {
            frame.path.pop();
        }
        end
    }

    /// From here on, whoever gets here has this condition hold, or not.
    fn learn(&mut self, c: &Cond, holds: bool) {
        match c {
            Cond::Not(c) => self.learn(c, !holds),
            Cond::True(v) => {
                self.facts.push((*v, holds));
                if self.is_truth(*v)
                    && let Some(Op::Select(c, ..)) = self.ops[v.0 as usize].clone()
                {
                    self.learn(&c, holds);
                }
            }
            Cond::All(list) if holds => list.iter().for_each(|c| self.learn(c, true)),
            Cond::Any(list) if !holds => list.iter().for_each(|c| self.learn(c, false)),
            Cond::Known(_)
            | Cond::Lt(..)
            | Cond::Le(..)
            | Cond::Eq(..)
            | Cond::Finite(_)
            | Cond::All(_)
            | Cond::Any(_) => {}
        }
    }

    /// Whether a condition holds, where that is known here.
    fn fact(&self, c: &Cond) -> Option<bool> {
        match c {
            Cond::Known(holds) => Some(*holds),
            Cond::Not(c) => self.fact(c).map(|holds| !holds),
            Cond::True(v) => self.facts.iter().rev().find(|f| f.0 == *v).map(|f| f.1),
            Cond::All(list) => {
                let all: Option<Vec<bool>> = list.iter().map(|c| self.fact(c)).collect();
                all.map(|all| !all.contains(&false))
            }
            Cond::Any(list) => {
                let all: Option<Vec<bool>> = list.iter().map(|c| self.fact(c)).collect();
                all.map(|all| all.contains(&true))
            }
            Cond::Lt(..) | Cond::Le(..) | Cond::Eq(..) | Cond::Finite(_) => None,
        }
    }

    /// What a value is for whoever gets here.
    fn here_is(&self, mut v: Value) -> Value {
        while let Some(Op::Select(c, a, b)) = &self.ops[v.0 as usize]
            && let Some(holds) = self.fact(c)
        {
            v = if holds { *a } else { *b };
        }
        v
    }

    /// Who gets here is slow.
    fn give_up(&mut self) {
        let here = self.here();
        self.slow.push(here);
    }

    /// Whether a scene gets here.
    fn here(&self) -> Cond {
        let path = self.frames.iter().flat_map(|f| f.path.iter().cloned());
        let left = self.frames.iter().flat_map(|f| f.left.iter().map(|l| l.0.clone().not()));
        Cond::all(path.chain(left).collect::<Vec<_>>())
    }

    /// A condition as a value that is 1 or 0.
    fn flag(&mut self, c: Cond) -> Value {
        match c {
            Cond::Known(true) => self.one,
            Cond::Known(false) => self.zero,
            Cond::True(v) if self.is_truth(v) => v,
            c => {
                let (one, zero) = (self.one, self.zero);
                self.define(Op::Select(c, one, zero), None)
            }
        }
    }

    /// Whether a value is 1 or 0 whatever else is.
    fn is_truth(&self, v: Value) -> bool {
        match &self.ops[v.0 as usize] {
            Some(Op::Select(_, a, b)) => (*a, *b) == (self.one, self.zero),
            Some(op) => is_comparison(op),
            None => v == self.one || v == self.zero,
        }
    }

    /// One state or the other.
    fn choose(&mut self, c: &Cond, yes: &State, no: &State) -> State {
        let pairs: Vec<_> = yes.vars.iter().copied().zip(no.vars.iter().copied()).collect();
        let vars = pairs.into_iter().map(|(a, b)| self.either(c, a, b)).collect();
        let mut places = BTreeMap::new();
        let written: BTreeSet<_> = yes.places.keys().chain(no.places.keys()).copied().collect();
        for at in written {
            let mut of = |s: &State| s.places.get(&at).copied().or_else(|| self.initial(at));
            // What is not known on one way is not read, unless it was there before.
            if let (Some(a), Some(b)) = (of(yes), of(no)) {
                places.insert(at, self.either(c, a, b));
            }
        }
        State { vars, places }
    }

    /// One value or the other, each as it is on its way.
    fn either(&mut self, c: &Cond, a: Value, b: Value) -> Value {
        if a == b {
            return a;
        }
        let facts = self.facts.len();
        self.learn(c, true);
        let a = self.here_is(a);
        self.facts.truncate(facts);
        self.learn(c, false);
        let b = self.here_is(b);
        self.facts.truncate(facts);
        self.select(c.clone(), a, b)
    }

    fn select(&mut self, c: Cond, a: Value, b: Value) -> Value {
        match c.known() {
            _ if a == b => a,
            Some(true) => a,
            Some(false) => b,
            None => match c {
                Cond::Not(c) => self.define(Op::Select(*c, b, a), None),
                c => self.define(Op::Select(c, a, b), None),
            },
        }
    }

    /// Where a place is.
    fn fixed(&mut self, p: &Place) -> (Memory, u32) {
        self.lost |= !p.along.is_empty() || p.through.is_some();
        (p.memory, p.base)
    }

    /// What a place holds at the start. None of the scratch, of which nothing is known.
    fn initial(&mut self, at: (Memory, u32)) -> Option<Value> {
        if at.0 == Memory::Scratch {
            return None;
        }
        if let Some(v) = self.loads.get(&at) {
            return Some(*v);
        }
        let v = self.define(Op::Load(Place::new(at.0, at.1)), None);
        self.loads.insert(at, v);
        Some(v)
    }

    fn op(&mut self, op: &Op) -> Value {
        match op {
            Op::Load(p) => {
                let at = self.fixed(p);
                let found = self.state.places.get(&at).copied().or_else(|| self.initial(at));
                self.lost |= found.is_none();
                found.unwrap_or(self.zero)
            }
            Op::Get(var) => self.here_is(self.state.vars[var.0 as usize]),
            Op::Select(c, a, b) => {
                let c = self.cond(c);
                let (a, b) = (self.values[a.0 as usize], self.values[b.0 as usize]);
                self.select(c, a, b)
            }
            Op::Unary(..) | Op::Binary(..) => {
                let mut op = op.clone();
                op.each_value_mut(&mut |v| *v = self.values[v.0 as usize]);
                if let Some(count) = self.count(&op) {
                    return count;
                }
                let mut when = None;
                if is_call(&op) {
                    let here = self.here();
                    when = match self.last.take().filter(|last| last.0 == here) {
                        Some((_, v)) => Some(v),
                        None => (here.known() != Some(true)).then(|| self.flag(here.clone())),
                    };
                    self.last = when.map(|v| (here, v));
                }
                self.define(op, when)
            }
        }
    }

    /// What is counted with small numbers, which double and single ones do alike.
    fn count(&mut self, op: &Op) -> Option<Value> {
        let Op::Binary(f @ (Binary::Add | Binary::Sub), a, b) = op else { return None };
        let small = |v: Value| self.known(v).filter(|x| x.fract() == 0.0 && x.abs() < 1e6 && !x.is_sign_negative());
        let (a, b) = (small(*a)?, small(*b)?);
        let x = if *f == Binary::Add { a + b } else { a - b };
        self.numbers.push(Some(Number::Plain(x)));
        self.ops.push(None);
        Some(Value(self.numbers.len() as u32 - 1))
    }

    /// A condition of the routine, as it is here.
    fn cond(&self, c: &Cond) -> Cond {
        let of = |v: &Value| self.values[v.0 as usize];
        let mut same = c.clone();
        same.each_value_mut(&mut |v| *v = of(v));
        let decided = match &same {
            Cond::True(v) => return self.is_true(*v),
            Cond::Known(_) => None,
            Cond::Lt(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x < y, DEPTH),
                (Some(x), None) => self.decide(*b, &|y| x < y, DEPTH),
                (None, None) => None,
            },
            Cond::Le(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x <= y, DEPTH),
                (Some(x), None) => self.decide(*b, &|y| x <= y, DEPTH),
                (None, None) => None,
            },
            Cond::Eq(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x == y, DEPTH),
                (Some(x), None) => self.decide(*b, &|y| x == y, DEPTH),
                (None, None) => None,
            },
            Cond::Finite(a) => self.decide(*a, &f64::is_finite, DEPTH),
            Cond::Not(_) | Cond::All(_) | Cond::Any(_) => {
                return match c {
                    Cond::Not(c) => self.cond(c).not(),
                    Cond::All(list) => Cond::all(list.iter().map(|c| self.cond(c)).collect::<Vec<_>>()),
                    Cond::Any(list) => Cond::any(list.iter().map(|c| self.cond(c)).collect::<Vec<_>>()),
                    Cond::Known(_) | Cond::True(_) | Cond::Lt(..) | Cond::Le(..) | Cond::Eq(..) | Cond::Finite(_) => {
                        same
                    }
                };
            }
        };
        decided.unwrap_or(same)
    }

    /// Whether a value is not 0.
    fn is_true(&self, v: Value) -> Cond {
        if let Some(holds) = self.fact(&Cond::True(v)) {
            return Cond::Known(holds);
        }
        if let Some(Op::Binary(Binary::Mul, a, b)) = &self.ops[v.0 as usize]
            && self.is_truth(*a)
            && self.is_truth(*b)
        {
            return Cond::all([self.is_true(*a), self.is_true(*b)]);
        }
        match self.is_truth(v) && self.known(v).is_none() {
            true => Cond::True(v),
            false => self.decide(v, &|x| x != 0.0, DEPTH).unwrap_or(Cond::True(v)),
        }
    }

    /// Whether a value passes a test, where that follows from which of some numbers it is.
    fn decide(&self, v: Value, test: &dyn Fn(f64) -> bool, depth: usize) -> Option<Cond> {
        if let Some(x) = self.known(v) {
            return Some(Cond::Known(test(x)));
        }
        let Some(Op::Select(c, a, b)) = &self.ops[v.0 as usize] else { return None };
        let depth = depth.checked_sub(1)?;
        let (a, b) = (self.decide(*a, test, depth)?, self.decide(*b, test, depth)?);
        let no = || c.clone().not();
        Some(match (a.known(), b.known()) {
            (Some(x), Some(y)) if x == y => Cond::Known(x),
            (Some(true), _) => Cond::any([c.clone(), b]),
            (Some(false), _) => Cond::all([no(), b]),
            (None, Some(true)) => Cond::any([no(), a]),
            (None, Some(false)) => Cond::all([c.clone(), a]),
            (None, None) => Cond::any([Cond::all([c.clone(), a]), Cond::all([no(), b])]),
        })
    }

    /// What is looked at in the end.
    fn finish(mut self) -> Option<Straight> {
        let slow = Cond::any(std::mem::take(&mut self.slow));
        if slow.known() == Some(true) {
            return None;
        }
        let list: Vec<_> = self.state.places.iter().map(|(at, v)| (*at, *v)).collect();
        let mut writes = Vec::new();
        for ((memory, at), v) in list.into_iter().filter(|w| w.0.0 == Memory::State) {
            // A slow scene keeps what was there.
            let before = self.initial((memory, at))?;
            if before != v {
                writes.push((at, v));
            }
        }
        let mut used = vec![false; self.numbers.len()];
        slow.each_value(&mut |v| used[v.0 as usize] = true);
        writes.iter().for_each(|(_, v)| used[v.0 as usize] = true);
        for line in self.body.iter().rev() {
            if used[line.value.0 as usize] {
                line.op.each_value(&mut |v| used[v.0 as usize] = true);
                line.when.iter().for_each(|v| used[v.0 as usize] = true);
            }
        }
        self.body.retain(|l| used[l.value.0 as usize]);
        let flags = self.flags(&slow, &writes);
        Some(Straight { numbers: self.numbers, body: self.body, slow, writes, flags })
    }

    /// See [`Straight::flags`].
    fn flags(&self, slow: &Cond, writes: &[(u32, Value)]) -> BTreeSet<Value> {
        let truths = self.body.iter().filter(|l| self.is_truth(l.value));
        let mut flags: BTreeSet<Value> = truths.map(|l| l.value).collect();
        let mut number = |v: &Value| {
            flags.remove(v);
        };
        writes.iter().for_each(|(_, v)| number(v));
        compared(slow, &mut number);
        for line in &self.body {
            match &line.op {
                Op::Select(c, a, b) => {
                    compared(c, &mut number);
                    number(a);
                    number(b);
                }
                Op::Binary(Binary::And | Binary::Or, ..) | Op::Unary(Unary::Not, _) => {}
                op @ (Op::Load(_) | Op::Get(_) | Op::Unary(..) | Op::Binary(..)) => op.each_value(&mut |v| number(&v)),
            }
        }
        flags
    }
}

/// The values that a condition looks at as numbers.
fn compared(c: &Cond, f: &mut impl FnMut(&Value)) {
    match c {
        Cond::Known(_) | Cond::True(_) => {}
        Cond::Finite(a) => f(a),
        Cond::Lt(a, b) | Cond::Le(a, b) | Cond::Eq(a, b) => {
            f(a);
            f(b);
        }
        Cond::Not(c) => compared(c, f),
        Cond::All(list) | Cond::Any(list) => list.iter().for_each(|c| compared(c, f)),
    }
}

/// Whether an operation tells whether something holds.
pub fn is_comparison(op: &Op) -> bool {
    match op {
        Op::Binary(f, ..) => match f {
            Binary::Lt | Binary::Le | Binary::Eq | Binary::And | Binary::Or => true,
            Binary::Add
            | Binary::Sub
            | Binary::Mul
            | Binary::Div
            | Binary::Pow
            | Binary::Min
            | Binary::Max
            | Binary::Atan2 => false,
        },
        Op::Unary(f, _) => *f == Unary::Not,
        Op::Load(_) | Op::Get(_) | Op::Select(..) => false,
    }
}

/// Whether a block always comes to what has no form here; one turn of what repeats may have one.
fn is_heavy(body: &[Stmt], turns: bool) -> bool {
    body.iter().any(|s| match s {
        Stmt::For(..) | Stmt::Solve { .. } | Stmt::Fail(_) | Stmt::Continue => true,
        Stmt::Loop(body) => !turns && repeats(body) || is_heavy(body, turns),
        Stmt::Let(..)
        | Stmt::Set(..)
        | Stmt::Store(..)
        | Stmt::If(..)
        | Stmt::Break
        | Stmt::Count(_)
        | Stmt::Note(_) => false,
    })
}

/// Whether a loop may be run through more than once.
fn repeats(body: &[Stmt]) -> bool {
    reaches_end(body) || begins_anew(body)
}

/// Whether the end of a block may be reached.
fn reaches_end(body: &[Stmt]) -> bool {
    !body.iter().any(|s| match s {
        Stmt::Break | Stmt::Continue | Stmt::Fail(_) => true,
        Stmt::If(_, yes, no) => !reaches_end(yes) && !reaches_end(no),
        Stmt::Let(..)
        | Stmt::Set(..)
        | Stmt::Store(..)
        | Stmt::Loop(_)
        | Stmt::For(..)
        | Stmt::Solve { .. }
        | Stmt::Count(_)
        | Stmt::Note(_) => false,
    })
}

/// Whether a loop's body begins it anew somewhere.
fn begins_anew(body: &[Stmt]) -> bool {
    body.iter().any(|s| match s {
        Stmt::Continue => true,
        Stmt::If(_, yes, no) => begins_anew(yes) || begins_anew(no),
        Stmt::Let(..)
        | Stmt::Set(..)
        | Stmt::Store(..)
        | Stmt::Loop(_)
        | Stmt::For(..)
        | Stmt::Break
        | Stmt::Solve { .. }
        | Stmt::Count(_)
        | Stmt::Note(_)
        | Stmt::Fail(_) => false,
    })
}

/// Whether a block fails somewhere.
fn has_fail(body: &[Stmt]) -> bool {
    body.iter().any(|s| matches!(s, Stmt::Fail(_)) || s.inner().into_iter().any(has_fail))
}

/// Whether a block changes anything, or is left.
fn has_effect(body: &[Stmt]) -> bool {
    body.iter().any(|s| {
        matches!(s, Stmt::Set(..) | Stmt::Store(..) | Stmt::Break | Stmt::Continue)
            || s.inner().into_iter().any(has_effect)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::code::{Reason, Var};
    use bond_runtime::eval;

    /// Numbers of a routine that runs: values, variables, and the block.
    struct Run<'a> {
        numbers: &'a [Option<Number>],
        values: Vec<f64>,
        vars: Vec<f64>,
        block: Vec<f64>,
        turns: usize,
    }

    impl<'a> Run<'a> {
        fn new(numbers: &'a [Option<Number>], vars: u32, block: &[f64]) -> Self {
            let values = numbers.iter().map(|n| n.map_or(f64::NAN, Number::value)).collect();
            Self { numbers, values, vars: vec![0.0; vars as usize], block: block.to_vec(), turns: 0 }
        }

        fn of(&self, v: Value) -> f64 {
            self.values[v.0 as usize]
        }

        fn cond(&self, c: &Cond) -> bool {
            match c {
                Cond::Known(b) => *b,
                Cond::True(a) => self.of(*a) != 0.0,
                Cond::Lt(a, b) => self.of(*a) < self.of(*b),
                Cond::Le(a, b) => self.of(*a) <= self.of(*b),
                Cond::Eq(a, b) => self.of(*a) == self.of(*b),
                Cond::Finite(a) => self.of(*a).is_finite(),
                Cond::Not(c) => !self.cond(c),
                Cond::All(list) => list.iter().all(|c| self.cond(c)),
                Cond::Any(list) => list.iter().any(|c| self.cond(c)),
            }
        }

        fn define(&mut self, v: Value, op: &Op) {
            assert!(self.numbers[v.0 as usize].is_none());
            self.values[v.0 as usize] = match op {
                Op::Load(p) => self.block[p.base as usize],
                Op::Get(var) => self.vars[var.0 as usize],
                Op::Unary(f, a) => eval::unary(*f, self.of(*a)),
                Op::Binary(f, a, b) => eval::binary(*f, self.of(*a), self.of(*b)),
                Op::Select(c, a, b) => self.of(if self.cond(c) { *a } else { *b }),
            };
        }

        /// The statement that a block ends with, where that is not its end.
        fn go(&mut self, body: &[Stmt]) -> Option<Stmt> {
            for s in body {
                let end = match s {
                    Stmt::Let(v, op) => {
                        self.define(*v, op);
                        None
                    }
                    Stmt::Set(var, v) => {
                        self.vars[var.0 as usize] = self.of(*v);
                        None
                    }
                    Stmt::Store(p, v) => {
                        self.block[p.base as usize] = self.of(*v);
                        None
                    }
                    Stmt::If(c, yes, no) => self.go(if self.cond(c) { yes } else { no }),
                    Stmt::Loop(body) => loop {
                        self.turns += 1;
                        match self.go(body) {
                            Some(Stmt::Break) => break None,
                            None | Some(Stmt::Continue) => {}
                            end => break end,
                        }
                    },
                    end => Some(end.clone()),
                };
                if end.is_some() {
                    return end;
                }
            }
            None
        }
    }

    const N: [f64; 5] = [0.0, 1.0, 2.0, 0.5, 100.0];

    fn routine(body: Vec<Stmt>, values: usize, vars: u32) -> Routine {
        let numbers = N.iter().map(|x| Some(Number::Plain(*x))).chain((0..values).map(|_| None)).collect();
        let (systems, data, tables) = (Vec::new(), Vec::new(), Vec::new());
        Routine { name: String::new(), body, numbers, vars, indices: 0, scratch: 0, systems, data, tables }
    }

    fn v(k: u32) -> Value {
        Value(N.len() as u32 + k)
    }

    fn at(k: u32) -> Place {
        Place::new(Memory::State, k)
    }

    /// Asserts that straight code does what a routine does, or says that it does not; how often it does.
    fn same(routine: &Routine, straight: &Straight) -> usize {
        let mut quick = 0;
        for k in 0..400 {
            let block = [f64::from(k % 21) * 0.25 - 2.0, f64::from(k / 21) * 0.25 - 2.0, 7.0];
            let (mut plain, mut flat) =
                (Run::new(&routine.numbers, routine.vars, &block), Run::new(&straight.numbers, 0, &block));
            let end = plain.go(&routine.body);
            straight.body.iter().for_each(|l| flat.define(l.value, &l.op));
            if flat.cond(&straight.slow) {
                continue;
            }
            assert_eq!(end, None, "{block:?} does not fail");
            let writes: Vec<(u32, f64)> = straight.writes.iter().map(|(at, v)| (*at, flat.of(*v))).collect();
            writes.into_iter().for_each(|(at, x)| flat.block[at as usize] = x);
            let bits = |list: &[f64]| list.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
            assert_eq!(bits(&plain.block), bits(&flat.block), "{block:?}");
            quick += 1;
        }
        quick
    }

    /// A block that is left in three places, branches that set and write, and one that fails.
    #[test]
    fn branches_and_exits_are_choices() {
        let [zero, one, two, half, _] = [0, 1, 2, 3, 4].map(Value);
        let body = vec![
            Stmt::Let(v(0), Op::Load(at(0))),
            Stmt::Let(v(1), Op::Load(at(1))),
            Stmt::Loop(vec![
                Stmt::Let(v(2), Op::Binary(Binary::Mul, v(0), v(1))),
                Stmt::If(Cond::Lt(v(2), zero), vec![Stmt::Set(Var(0), one), Stmt::Break], Vec::new()),
                Stmt::If(
                    Cond::Lt(v(0), v(1)),
                    vec![
                        Stmt::Set(Var(1), v(2)),
                        Stmt::If(Cond::Lt(one, v(2)), vec![Stmt::Set(Var(0), two), Stmt::Break], Vec::new()),
                        Stmt::Store(at(2), v(1)),
                    ],
                    vec![Stmt::Let(v(3), Op::Unary(Unary::Sqrt, v(0))), Stmt::Set(Var(1), v(3))],
                ),
                Stmt::Break,
            ]),
            Stmt::Let(v(4), Op::Get(Var(0))),
            Stmt::If(Cond::Eq(v(4), two), vec![Stmt::Store(at(1), half)], Vec::new()),
            Stmt::Let(v(5), Op::Get(Var(1))),
            Stmt::If(Cond::Lt(two, v(5)), vec![Stmt::Fail(Reason::NotFinite)], Vec::new()),
            Stmt::Store(at(0), v(5)),
        ];
        let routine = routine(body, 6, 2);
        let straight = straight(&routine).expect("it has straight code");
        let quick = same(&routine, &straight);
        assert!(quick > 300 && quick < 400, "{quick} of 400 are not slow");
        assert!(straight.body.iter().any(|l| l.when.is_some()), "a root is taken where it is looked at");
    }

    /// An iteration in a branch is gone on with twice; who goes on further is slow. One that all begin has no form.
    #[test]
    fn iterations_that_go_on_are_slow() {
        let [zero, one, _, half, _] = [0, 1, 2, 3, 4].map(Value);
        let turns = Stmt::Loop(vec![
            Stmt::Let(v(1), Op::Get(Var(0))),
            Stmt::Let(v(2), Op::Binary(Binary::Mul, v(1), half)),
            Stmt::Set(Var(0), v(2)),
            Stmt::If(Cond::Lt(v(2), one), vec![Stmt::Break], Vec::new()),
        ]);
        let start = [Stmt::Let(v(0), Op::Load(at(0))), Stmt::Set(Var(0), v(0))];
        let end = [Stmt::Let(v(3), Op::Get(Var(0))), Stmt::Store(at(2), v(3))];
        let branch = Stmt::If(Cond::Lt(zero, v(0)), vec![turns.clone()], Vec::new());
        let with = |s: Stmt| routine([&start[..], &[s], &end].concat(), 4, 1);
        assert_eq!(straight(&with(turns)), None);
        let routine = with(branch);
        let straight = straight(&routine).expect("it has straight code");
        assert!(same(&routine, &straight) > 380);
        for (x, slow) in [(-1.0, false), (0.5, false), (1.0, false), (3.9, false), (4.0, true), (64.0, true)] {
            let mut run = Run::new(&straight.numbers, 0, &[x, 0.0, 0.0]);
            straight.body.iter().for_each(|l| run.define(l.value, &l.op));
            assert_eq!(run.cond(&straight.slow), slow, "{x}");
        }
    }
}
