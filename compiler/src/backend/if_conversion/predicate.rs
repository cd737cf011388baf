//! What is known of conditions where the statements have got to.

use super::{Conversion, is_comparison};
use crate::backend::code::{Cond, Number, Op, Value};
use bond_runtime::ir::Binary;

impl Conversion {
    /// The number that a value is, where it is one that double and single numbers have alike.
    pub(super) fn known(&self, v: Value) -> Option<f64> {
        match self.numbers[v.0 as usize] {
            Some(Number::Plain(x)) if f64::from(x as f32) == x || x.is_nan() => Some(x),
            Some(Number::Plain(_) | Number::Tolerance(_)) | None => None,
        }
    }

    /// From here on, whoever gets here has this condition hold, or not.
    pub(super) fn learn(&mut self, c: &Cond, holds: bool) {
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
    pub(super) fn fact(&self, c: &Cond) -> Option<bool> {
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
    pub(super) fn here_is(&self, mut v: Value) -> Value {
        while let Some(Op::Select(c, a, b)) = &self.ops[v.0 as usize]
            && let Some(holds) = self.fact(c)
        {
            v = if holds { *a } else { *b };
        }
        v
    }

    /// Whether a value is 1 or 0 whatever else is.
    pub(super) fn is_truth(&self, v: Value) -> bool {
        match &self.ops[v.0 as usize] {
            Some(Op::Select(_, a, b)) => (*a, *b) == (self.one, self.zero),
            Some(op) => is_comparison(op),
            None => v == self.one || v == self.zero,
        }
    }

    /// What is counted with small numbers, which double and single ones do alike.
    pub(super) fn count(&mut self, op: &Op) -> Option<Value> {
        let Op::Binary(f @ (Binary::Add | Binary::Sub), a, b) = op else { return None };
        let small = |v: Value| self.known(v).filter(|x| x.fract() == 0.0 && x.abs() < 1e6 && !x.is_sign_negative());
        let (a, b) = (small(*a)?, small(*b)?);
        let x = if *f == Binary::Add { a + b } else { a - b };
        self.numbers.push(Some(Number::Plain(x)));
        self.ops.push(None);
        Some(Value(self.numbers.len() as u32 - 1))
    }

    /// A condition of the routine, as it is here.
    pub(super) fn cond(&self, c: &Cond) -> Cond {
        let of = |v: &Value| self.values[v.0 as usize];
        let mut same = c.clone();
        same.each_value_mut(&mut |v| *v = of(v));
        let decided = match &same {
            Cond::True(v) => return self.is_true(*v),
            Cond::Known(_) => None,
            Cond::Lt(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x < y, self.options.depth),
                (Some(x), None) => self.decide(*b, &|y| x < y, self.options.depth),
                (None, None) => None,
            },
            Cond::Le(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x <= y, self.options.depth),
                (Some(x), None) => self.decide(*b, &|y| x <= y, self.options.depth),
                (None, None) => None,
            },
            Cond::Eq(a, b) => match (self.known(*a), self.known(*b)) {
                (_, Some(y)) => self.decide(*a, &|x| x == y, self.options.depth),
                (Some(x), None) => self.decide(*b, &|y| x == y, self.options.depth),
                (None, None) => None,
            },
            Cond::Finite(a) => self.decide(*a, &f64::is_finite, self.options.depth),
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
    pub(super) fn is_true(&self, v: Value) -> Cond {
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
            false => self.decide(v, &|x| x != 0.0, self.options.depth).unwrap_or(Cond::True(v)),
        }
    }

    /// Whether a value passes a test, where that follows from which of some numbers it is.
    pub(super) fn decide(&self, v: Value, test: &dyn Fn(f64) -> bool, depth: usize) -> Option<Cond> {
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
}
