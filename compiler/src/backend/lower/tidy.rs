//! Takes out what nothing uses.

use crate::backend::code::{Op, Reason, Routine, Stmt, Value, Var};

/// Takes values, and settings of variables, out of a routine that nothing looks at.
pub(super) fn tidy(routine: &mut Routine) {
    // A variable counts as read where anything reads it, so that one round may leave work for the next.
    loop {
        let mut used = Used { values: vec![false; routine.numbers.len()], vars: vec![false; routine.vars as usize] };
        used.block(&routine.body);
        if !used.clear(&mut routine.body) {
            return;
        }
    }
}

struct Used {
    values: Vec<bool>,
    vars: Vec<bool>,
}

impl Used {
    fn value(&mut self, v: Value) {
        self.values[v.0 as usize] = true;
    }

    fn var(&mut self, v: Var) {
        self.vars[v.0 as usize] = true;
    }

    /// Marks what a block uses, from its end: what only unused values use is unused.
    fn block(&mut self, body: &[Stmt]) {
        for s in body.iter().rev() {
            match s {
                Stmt::Let(v, op) if self.values[v.0 as usize] => match op {
                    Op::Load(_) => {}
                    Op::Get(var) => self.var(*var),
                    Op::Unary(_, a) => self.value(*a),
                    Op::Binary(_, a, b) => {
                        self.value(*a);
                        self.value(*b);
                    }
                    Op::Select(c, a, b) => {
                        c.each_value(&mut |v| self.value(v));
                        self.value(*a);
                        self.value(*b);
                    }
                },
                Stmt::Let(..) | Stmt::Break | Stmt::Continue => {}
                Stmt::Solve { same, .. } => same.iter().for_each(|v| self.value(*v)),
                Stmt::Set(_, v) | Stmt::Store(_, v) | Stmt::Count(v) => self.value(*v),
                Stmt::Note(list) => list.iter().for_each(|v| self.value(*v)),
                Stmt::If(c, yes, no) => {
                    c.each_value(&mut |v| self.value(v));
                    self.block(no);
                    self.block(yes);
                }
                Stmt::Loop(body) | Stmt::For(_, _, _, body) => self.block(body),
                Stmt::Fail(Reason::NoConvergence(_, a, b)) => {
                    self.value(*a);
                    self.value(*b);
                }
                Stmt::Fail(Reason::Singular(a)) => self.value(*a),
                Stmt::Fail(Reason::NotFinite | Reason::Clock) => {}
            }
        }
    }

    /// Takes out what is not marked; whether there was any.
    fn clear(&self, body: &mut Vec<Stmt>) -> bool {
        let before = body.len();
        let mut changed = false;
        body.retain_mut(|s| match s {
            Stmt::Let(v, _) => self.values[v.0 as usize],
            Stmt::Set(v, _) => self.vars[v.0 as usize],
            Stmt::If(_, yes, no) => {
                changed |= self.clear(yes);
                changed |= self.clear(no);
                !(yes.is_empty() && no.is_empty())
            }
            Stmt::Loop(body) | Stmt::For(_, _, _, body) => {
                changed |= self.clear(body);
                !body.is_empty()
            }
            Stmt::Store(..)
            | Stmt::Break
            | Stmt::Continue
            | Stmt::Solve { .. }
            | Stmt::Count(_)
            | Stmt::Note(_)
            | Stmt::Fail(_) => true,
        });
        changed || body.len() < before
    }
}
