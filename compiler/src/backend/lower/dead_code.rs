//! Takes out what nothing uses, and what one branch alone uses into it.

use crate::backend::code::{Op, Routine, Stmt, Value, Var, retain};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::{FxHashMap, FxHashSet};

/// Takes values, and settings of variables, out of a routine that nothing looks at.
pub(super) fn remove_dead_code(routine: &mut Routine) {
    remove_unused(routine);
    sink(&mut routine.body, &mut routine.vars);
}

/// The same, where what one branch alone uses stays before it.
pub(super) fn remove_unused(routine: &mut Routine) {
    // A variable counts as read where anything reads it, so that one round may leave work for the next.
    loop {
        let mut used = Used { values: vec![false; routine.numbers.len()], vars: vec![false; routine.vars as usize] };
        used.block(&routine.body);
        if !used.clear(&mut routine.body) {
            break;
        }
    }
}

/// Where a value is used.
#[derive(Clone, Copy, PartialEq)]
enum Where {
    /// In one branch of the statement with this number: the first one, or the other.
    Branch(usize, bool),
    /// Elsewhere, or in several places.
    Here,
}

/// Moves what is computed for one branch alone into that branch, so that it costs nothing where the other one is taken.
/// A choice between values of which one takes long to compute becomes a branch.
fn sink(body: &mut Vec<Stmt>, vars: &mut u32) {
    let mut places: FxHashMap<Value, Where> = FxHashMap::default();
    let mut moves: Vec<Option<(usize, bool)>> = vec![None; body.len()];
    for (k, s) in body.iter().enumerate().rev() {
        let mut at = Where::Here;
        if let Stmt::Let(v, Op::Unary(..) | Op::Binary(..) | Op::Select(..)) = s
            && let Some(&Where::Branch(i, first)) = places.get(v)
        {
            at = Where::Branch(i, first);
            moves[k] = Some((i, first));
        }
        let mut note = |v: Value, at: Where| {
            let known = places.entry(v).or_insert(at);
            if *known != at {
                *known = Where::Here;
            }
        };
        if let (Stmt::Let(_, Op::Select(c, a, b)), Where::Here) = (s, at) {
            c.each_value(&mut |v| note(v, Where::Here));
            note(*a, Where::Branch(k, true));
            note(*b, Where::Branch(k, false));
        } else if let Stmt::If(c, yes, no) = s {
            c.each_value(&mut |v| note(v, Where::Here));
            yes.iter().for_each(|s| s.each_value_within(&mut |v| note(v, Where::Branch(k, true))));
            no.iter().for_each(|s| s.each_value_within(&mut |v| note(v, Where::Branch(k, false))));
        } else {
            s.each_value_within(&mut |v| note(v, at));
        }
    }
    let long: FxHashSet<usize> =
        body.iter().zip(&moves).filter(|(s, _)| takes_long(s)).filter_map(|(_, to)| Some((*to)?.0)).collect();
    for to in &mut moves {
        // A choice of what is had at once stays one.
        *to = to.filter(|(k, _)| long.contains(k) || matches!(body[*k], Stmt::If(..)));
    }
    let mut taken: FxHashMap<(usize, bool), Vec<Stmt>> = FxHashMap::default();
    let mut rest = Vec::with_capacity(body.len());
    for (k, (s, to)) in std::mem::take(body).into_iter().zip(&moves).enumerate() {
        match (s, to) {
            (s, Some(to)) => taken.entry(*to).or_default().push(s),
            (Stmt::If(c, yes, no), None) => {
                let mut with = |first: bool, block: Vec<Stmt>| {
                    let mut all = taken.remove(&(k, first)).unwrap_or_default();
                    all.extend(block);
                    sink(&mut all, vars);
                    all
                };
                let (yes, no) = (with(true, yes), with(false, no));
                rest.push(Stmt::If(c, yes, no));
            }
            (Stmt::Let(v, Op::Select(c, a, b)), None) if long.contains(&k) => {
                let var = Var(*vars);
                *vars += 1;
                let mut with = |first: bool, x: Value| {
                    let mut all = taken.remove(&(k, first)).unwrap_or_default();
                    all.push(Stmt::Set(var, x));
                    sink(&mut all, vars);
                    all
                };
                let (yes, no) = (with(true, a), with(false, b));
                rest.push(Stmt::If(c, yes, no));
                rest.push(Stmt::Let(v, Op::Get(var)));
            }
            (Stmt::Loop(mut inner), None) => {
                sink(&mut inner, vars);
                rest.push(Stmt::Loop(inner));
            }
            // Loops over many alike are left to who can do several at once.
            (s, None) => rest.push(s),
        }
    }
    *body = rest;
}

/// Whether a statement takes longer than a branch may cost.
fn takes_long(s: &Stmt) -> bool {
    match s {
        Stmt::Let(_, Op::Binary(f, ..)) => matches!(f, Binary::Div | Binary::Pow | Binary::Atan2),
        Stmt::Let(_, Op::Unary(f, _)) => !matches!(f, Unary::Neg | Unary::Abs | Unary::Sign | Unary::Not),
        _ => false,
    }
}

/// What is used: by value, and by variable.
struct Used {
    values: Vec<bool>,
    vars: Vec<bool>,
}

impl Used {
    /// Marks what a block uses, from its end: what only unused values use is unused.
    fn block(&mut self, body: &[Stmt]) {
        for s in body.iter().rev() {
            if let Stmt::Let(v, op) = s {
                if !self.values[v.0 as usize] {
                    continue;
                }
                if let Op::Get(var) = op {
                    self.vars[var.0 as usize] = true;
                }
            }
            s.each_value(&mut |v| self.values[v.0 as usize] = true);
            s.inner().into_iter().rev().for_each(|block| self.block(block));
        }
    }

    /// Takes out what is not marked; whether there was any.
    fn clear(&self, body: &mut Vec<Stmt>) -> bool {
        retain(body, &mut |s| match s {
            Stmt::Let(v, _) => self.values[v.0 as usize],
            Stmt::Set(v, _) => self.vars[v.0 as usize],
            _ => true,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::code::{Cond, Memory, Number, Place, System};

    /// A value that takes long, used in a branch and by a solution besides, is still there for the solution.
    #[test]
    fn what_a_solution_looks_at_stays_before_it() {
        let (x, root) = (Value(0), Value(1));
        let root_of_x = Stmt::Let(root, Op::Unary(Unary::Sqrt, x));
        let solve = Stmt::Solve { system: 0, matrix: 0, vector: 1, row: Var(0), same: Some(root) };
        let branch = Stmt::If(Cond::True(x), vec![Stmt::Store(Place::new(Memory::Next, 0), root)], Vec::new());
        let body = vec![root_of_x, solve, branch];
        let mut routine = Routine {
            name: String::new(),
            body: body.clone(),
            numbers: vec![Some(Number::Plain(2.0)), None],
            vars: 1,
            indices: 0,
            scratch: 2,
            systems: vec![System { n: 1, pattern: vec![(0, 0)], matrix: bond_runtime::solve::linear::Matrix::Kept }],
            data: Vec::new(),
            tables: Vec::new(),
        };
        remove_dead_code(&mut routine);
        assert_eq!(routine.body, body);
    }
}
