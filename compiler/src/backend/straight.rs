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
/// So many times as long at most is code with the first turn of iterations that go on.
const LONGER: usize = 2;
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
    match (short, long) {
        (Some(short), Some(long)) if long.body.len() > short.body.len() * LONGER => Some(short),
        (short, long) => long.or(short),
    }
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
                    Cond::Known(_)
                    | Cond::True(_)
                    | Cond::Lt(..)
                    | Cond::Le(..)
                    | Cond::Eq(..)
                    | Cond::Finite(_) => same,
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
