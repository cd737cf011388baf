//! Leaves out what nothing depends on.

use super::{Inst, Op, Value};

/// Takes out of a program's body the values that nothing written depends on, and numbers the others anew, in their
/// order: how many there are.
pub(super) fn prune(body: &mut Vec<Inst>, values: u32) -> u32 {
    let mut needed = Needed(vec![false; values as usize]);
    needed.keep(body);
    let mut numbers = Numbers { of: vec![Value(0); values as usize], next: 0 };
    numbers.block(body);
    numbers.next
}

/// By value, whether something that is written depends on it.
struct Needed(Vec<bool>);

impl Needed {
    fn mark(&mut self, values: impl IntoIterator<Item = Value>) {
        values.into_iter().for_each(|v| self.0[v.0 as usize] = true);
    }

    /// Takes out of a block what nothing depends on; what comes after it is known.
    fn keep(&mut self, body: &mut Vec<Inst>) {
        let mut kept = Vec::with_capacity(body.len());
        for mut inst in body.drain(..).rev() {
            match &mut inst {
                Inst::Let(v, _) if !self.0[v.0 as usize] => continue,
                Inst::Let(_, op) => self.mark(op.operands()),
                Inst::Store(_, v) => self.mark([*v]),
                Inst::Newton(n) => {
                    let lists = [&n.residual, &n.update, &n.weight, &n.scale, &n.cold];
                    self.mark(lists.into_iter().flatten().copied());
                    self.mark(n.jacobian.iter().map(|e| e.2));
                    self.keep(&mut n.body);
                    n.small.retain(|v| self.0[v.0 as usize]);
                }
                Inst::Solve(s) => self.mark(s.right.iter().copied().chain(s.values())),
                Inst::MatVec { .. } | Inst::Quad { .. } => {}
            }
            kept.push(inst);
        }
        kept.reverse();
        *body = kept;
    }
}

/// New numbers of values.
struct Numbers {
    of: Vec<Value>,
    next: u32,
}

impl Numbers {
    fn block(&mut self, body: &mut [Inst]) {
        for inst in body {
            match inst {
                Inst::Let(v, op) => {
                    match op {
                        Op::Const(_) | Op::Load(_) => {}
                        Op::Unary(_, a) => self.rename(a),
                        Op::Binary(_, a, b) => [a, b].into_iter().for_each(|v| self.rename(v)),
                        Op::Select(a, b, c) => [a, b, c].into_iter().for_each(|v| self.rename(v)),
                    }
                    self.define(v);
                }
                Inst::Store(_, v) => self.rename(v),
                Inst::Newton(n) => {
                    let lists = [&mut n.weight, &mut n.scale, &mut n.cold, &mut n.small];
                    lists.into_iter().flatten().for_each(|v| self.rename(v));
                    self.block(&mut n.body);
                    n.residual.iter_mut().chain(&mut n.update).for_each(|v| self.rename(v));
                    n.jacobian.iter_mut().for_each(|e| self.rename(&mut e.2));
                }
                Inst::Solve(s) => {
                    s.right.iter_mut().chain(&mut s.imaginary).for_each(|v| self.rename(v));
                    s.matrix.iter_mut().for_each(|e| self.rename(&mut e.2));
                }
                Inst::MatVec { .. } | Inst::Quad { .. } => {}
            }
        }
    }

    fn define(&mut self, v: &mut Value) {
        let number = Value(self.next);
        self.of[v.0 as usize] = number;
        *v = number;
        self.next += 1;
    }

    fn rename(&self, v: &mut Value) {
        *v = self.of[v.0 as usize];
    }
}
