//! A routine without control flow: what many scenes do side by side in vector lanes, each to the bits that it has
//! alone.
//!
//! Both ways of a branch are computed, and each number is chosen by the branch's condition where they meet again; so is
//! what a loop leaves that is run through once and left in different places. What would take long or really repeats
//! (an iteration that goes on, an elimination) and what fails is not there: where a scene would get to it, a flag says
//! that it is *slow*, to be done anew by the routine itself from the numbers that the interval found.

mod predicate;
mod shape;
mod walk;

use super::code::{Cond, Memory, Number, Op, Routine, Value};
use bond_runtime::ir::{Binary, Unary};
use shape::is_heavy;
use std::collections::{BTreeMap, BTreeSet};

/// How far if-conversion goes.
#[derive(Clone, Copy, Debug)]
pub struct ConversionOptions {
    /// Statements of a routine at most: a compiler takes long for so many at once.
    pub statements: usize,
    /// Values of a lane form at most.
    pub values: usize,
    /// Values that the form with the turns of iterations may have beyond twice those of the one without.
    pub longer: usize,
    /// Turns of iterations that go on.
    pub turns: usize,
    /// How far back a condition is followed to the numbers that it depends on.
    pub depth: usize,
}

impl Default for ConversionOptions {
    fn default() -> Self {
        Self { statements: 6000, values: 2000, longer: 300, turns: 2, depth: 24 }
    }
}

/// A routine without control flow.
#[derive(Clone, Debug, PartialEq)]
pub struct LaneForm {
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

/// A value of a lane form.
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
        Op::Unary(f, _) => f.is_library() || matches!(f, Unary::Sqrt | Unary::Floor),
        Op::Binary(f, ..) => matches!(f, Binary::Pow | Binary::Atan2),
        Op::Load(_) | Op::Get(_) | Op::Counter(_) | Op::InverseScale(_) | Op::Select(..) => false,
    }
}

/// The lane forms of a routine: one without the turns of iterations that go on, where those that get there are
/// slow, and one with the first turns. Where one of them is all there is, or not worth having, the other; none where it
/// always would be slow.
pub fn lane_forms(routine: &Routine, options: ConversionOptions) -> Vec<LaneForm> {
    if !routine.systems.is_empty() || routine.size() > options.statements || is_heavy(&routine.body, false) {
        return Vec::new();
    }
    let fits = |form: &LaneForm| form.body.len() <= options.values;
    let short = form(routine, ConversionOptions { turns: 0, ..options }).filter(fits);
    let most = short.as_ref().map_or(options.values, |short| 2 * short.body.len() + options.longer);
    let long =
        form(routine, options).filter(fits).filter(|long| long.body.len() <= most && short.as_ref() != Some(long));
    short.into_iter().chain(long).collect()
}

/// The form of a routine, with the first turns of what repeats, or without.
fn form(routine: &Routine, options: ConversionOptions) -> Option<LaneForm> {
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
    let mut way = Conversion {
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
        options,
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
struct Conversion {
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
    options: ConversionOptions,
    /// Whether something has no form here.
    lost: bool,
}

impl Conversion {
    fn define(&mut self, op: Op, when: Option<Value>) -> Value {
        let v = Value(self.numbers.len() as u32);
        self.numbers.push(None);
        self.ops.push(Some(op.clone()));
        self.body.push(Line { value: v, op, when });
        v
    }

    /// What is looked at in the end.
    fn finish(mut self) -> Option<LaneForm> {
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
        Some(LaneForm { numbers: self.numbers, body: self.body, slow, writes, flags })
    }

    /// See [`LaneForm::flags`].
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
                op @ (Op::Load(_)
                | Op::Get(_)
                | Op::Counter(_)
                | Op::InverseScale(_)
                | Op::Unary(..)
                | Op::Binary(..)) => op.each_value(&mut |v| number(&v)),
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
        Op::Load(_) | Op::Get(_) | Op::Counter(_) | Op::InverseScale(_) | Op::Select(..) => false,
    }
}

#[cfg(test)]
mod tests;
