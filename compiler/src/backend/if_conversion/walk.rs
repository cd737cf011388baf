//! Goes through a routine's statements, both ways of each branch.

use super::shape::{begins_anew, has_effect, has_fail, is_heavy, repeats};
use super::{Conversion, End, Frame, State, is_call};
use crate::backend::code::{Cond, Memory, Op, Place, Stmt, Value};
use std::collections::{BTreeMap, BTreeSet};

impl Conversion {
    pub(super) fn block(&mut self, rest: &[Stmt]) -> End {
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
                    let turns = if again && innermost { self.options.turns } else { 1 };
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
                Stmt::Continue | Stmt::For(..) | Stmt::Span(..) | Stmt::Solve { .. } | Stmt::Fail(_) => {
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
    pub(super) fn fine(&mut self, left: Vec<(Cond, State)>, next: &[Stmt]) -> Vec<(Cond, State)> {
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
                Some(holds) => !is_heavy(if holds { yes } else { no }, self.options.turns > 0),
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
    pub(super) fn meet(&mut self, left: Vec<(Cond, State)>) -> Option<State> {
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

    pub(super) fn branch(&mut self, c: &Cond, yes: &[Stmt], no: &[Stmt]) -> End {
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
    pub(super) fn arm(&mut self, c: Cond, body: &[Stmt]) -> End {
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
        let end = if rare || is_heavy(body, self.options.turns > 0) || (has_fail(body) && !has_effect(body)) {
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

    /// Who gets here is slow.
    pub(super) fn give_up(&mut self) {
        let here = self.here();
        self.slow.push(here);
    }

    /// Whether a scene gets here.
    pub(super) fn here(&self) -> Cond {
        let path = self.frames.iter().flat_map(|f| f.path.iter().cloned());
        let left = self.frames.iter().flat_map(|f| f.left.iter().map(|l| l.0.clone().not()));
        Cond::all(path.chain(left).collect::<Vec<_>>())
    }

    /// A condition as a value that is 1 or 0.
    pub(super) fn flag(&mut self, c: Cond) -> Value {
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

    /// One state or the other.
    pub(super) fn choose(&mut self, c: &Cond, yes: &State, no: &State) -> State {
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
    pub(super) fn either(&mut self, c: &Cond, a: Value, b: Value) -> Value {
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

    pub(super) fn select(&mut self, c: Cond, a: Value, b: Value) -> Value {
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
    pub(super) fn fixed(&mut self, p: &Place) -> (Memory, u32) {
        self.lost |= !p.is_fixed();
        (p.memory, p.base)
    }

    /// What a place holds at the start. None of the scratch, of which nothing is known.
    pub(super) fn initial(&mut self, at: (Memory, u32)) -> Option<Value> {
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

    pub(super) fn op(&mut self, op: &Op) -> Value {
        match op {
            Op::Load(p) => {
                let at = self.fixed(p);
                let found = self.state.places.get(&at).copied().or_else(|| self.initial(at));
                self.lost |= found.is_none();
                found.unwrap_or(self.zero)
            }
            Op::Get(var) => self.here_is(self.state.vars[var.0 as usize]),
            // Only in loops, which have no form here.
            Op::Counter(_) => self.zero,
            Op::Select(c, a, b) => {
                let c = self.cond(c);
                let (a, b) = (self.values[a.0 as usize], self.values[b.0 as usize]);
                self.select(c, a, b)
            }
            Op::Unary(..) | Op::Binary(..) | Op::InverseScale(_) => {
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
}
