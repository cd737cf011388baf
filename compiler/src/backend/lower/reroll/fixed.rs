//! Matrices that hardly ever change.

use super::{Linear, Loop, Reroller, Segment};
use crate::backend::code::{Cond, Memory, Place, Stmt, Value};
use crate::backend::lower::writer::{At, scratch};
use bond_runtime::ir::{self, Array, Op};

/// How a matrix is made, and when.
#[derive(Clone)]
pub(super) struct Fixed {
    /// The segment that makes it.
    segment: usize,
    /// What it depends on.
    keys: Vec<Place>,
    /// Where it is said that there is one, 1, and of which keys.
    made: u32,
}

impl Reroller<'_> {
    /// Has every matrix made: in a segment of its own where it is fixed, else in the body of its iteration.
    pub(super) fn fixed(&mut self) -> Option<()> {
        let mut uses = vec![0u32; self.ops.len()];
        self.ops.iter().flat_map(Op::operands).for_each(|v| uses[v.0 as usize] += 1);
        self.segments.iter().flat_map(|s| &s.roots).for_each(|r| uses[r.value.0 as usize] += 1);
        for k in 0..self.loops.len() {
            let Loop { newton, matrix, body, .. } = self.loops[k];
            for (i, (.., v)) in newton.jacobian.iter().enumerate() {
                uses[v.0 as usize] += 1;
                self.root(body, scratch(matrix, At::One(i)), *v);
            }
        }
        for l in &self.linear {
            l.solve.values().for_each(|v| uses[v.0 as usize] += 1);
        }
        for k in 0..self.linear.len() {
            let Linear { solve, matrix, before, .. } = self.linear[k];
            let values: Vec<_> = solve.values().collect();
            let segment = match self.keys(&values) {
                None => before,
                Some(keys) => {
                    self.segments.push(Segment::default());
                    let segment = self.segments.len() - 1;
                    self.take(&values, &uses, segment);
                    let made = self.w.room(1 + keys.len());
                    self.linear[k].fixed = Some(Fixed { segment, keys, made });
                    segment
                }
            };
            for (i, v) in values.into_iter().enumerate() {
                self.root(segment, scratch(matrix, At::One(i)), v);
            }
        }
        Some(())
    }

    /// The places that values depend on, where these are few, and none is of the program's own scratch.
    fn keys(&self, values: &[ir::Value]) -> Option<Vec<Place>> {
        let mut seen = vec![false; self.ops.len()];
        let mut open: Vec<_> = values.to_vec();
        let mut keys: Vec<(Memory, u32)> = Vec::new();
        while let Some(v) = open.pop() {
            if std::mem::replace(&mut seen[v.0 as usize], true) {
                continue;
            }
            let op = &self.ops[v.0 as usize];
            if let Op::Load(slot) = op {
                let (memory, base) = self.places[slot.array as usize];
                let key = (memory, base + slot.index);
                if slot.array == Array::Local || (keys.len() == self.w.loops.matrix_keys && !keys.contains(&key)) {
                    return None;
                }
                if !keys.contains(&key) {
                    keys.push(key);
                }
            }
            open.extend(op.operands());
        }
        keys.sort_unstable_by_key(|k| k.1);
        Some(keys.into_iter().map(|(memory, at)| Place::new(memory, at)).collect())
    }

    /// Moves what only these values need to a segment.
    fn take(&mut self, values: &[ir::Value], uses: &[u32], segment: usize) {
        let mut here = vec![0u32; self.ops.len()];
        values.iter().for_each(|v| here[v.0 as usize] += 1);
        for v in (0..self.ops.len()).rev() {
            if here[v] > 0 && here[v] == uses[v] {
                self.home[v] = segment as u32;
                self.ops[v].operands().for_each(|a| here[a.0 as usize] += 1);
            }
        }
    }

    /// Makes a matrix where it is not there yet; whether it was.
    pub(super) fn remake(&mut self, fixed: &Fixed) -> Value {
        let w = &mut self.w;
        let place = |i: usize| scratch(fixed.made, At::One(i));
        let (zero, one) = (w.number(0.0), w.number(1.0));
        let made = w.load(place(0));
        let mut same = vec![w.eq(made, one)];
        let mut keys = Vec::new();
        for (i, key) in fixed.keys.iter().enumerate() {
            let (now, then) = (w.load(key.clone()), w.load(place(i + 1)));
            same.push(w.eq(now, then));
            keys.push(now);
        }
        let same = w.select(Cond::all(same), one, zero);
        w.open();
        self.segment(fixed.segment);
        let w = &mut self.w;
        w.push(Stmt::Store(place(0), one));
        keys.into_iter().enumerate().for_each(|(i, key)| w.push(Stmt::Store(place(i + 1), key)));
        let make = w.close();
        w.push(Stmt::If(Cond::Eq(same, zero), make, Vec::new()));
        same
    }
}
