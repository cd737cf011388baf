//! What programs of one code shape have in common, and the numbers in which they differ: a model with other parameters
//! mostly gives the same instructions.

use super::{Binary, Inst, Op, Program, Value};

/// Stands for a number, with its sign.
const SOME: f64 = 2.0;

impl Program {
    /// The numbers in which a program of the same shape may differ, in order of appearance: its constants, but for 0, 1
    /// and -1, for what is not finite, for the measure of rounding, and for exponents, all of which decide what is
    /// computed.
    pub fn numbers(&self) -> Vec<(Value, f64)> {
        let fixed = self.exponents();
        let mut list = Vec::new();
        each(&self.body, &mut |v, x| {
            if is_number(x) && !fixed[v.0 as usize] {
                list.push((v, x));
            }
        });
        list
    }

    /// The program with other numbers of the same sign in place of [`Self::numbers`]. Where two have the same code
    /// shape, code that takes these from elsewhere does for both.
    pub fn code_shape(&self) -> Program {
        let (fixed, mut other) = (self.exponents(), self.clone());
        replace(&mut other.body, &mut |v, x| {
            if is_number(x) && !fixed[v.0 as usize] { SOME.copysign(x) } else { x }
        });
        other
    }

    /// By value, whether something is raised to it.
    fn exponents(&self) -> Vec<bool> {
        fn mark(body: &[Inst], list: &mut [bool]) {
            for inst in body {
                match inst {
                    Inst::Let(_, Op::Binary(Binary::Pow, _, b)) => list[b.0 as usize] = true,
                    Inst::Newton(n) => mark(&n.body, list),
                    Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => {}
                }
            }
        }
        let mut list = vec![false; self.values as usize];
        mark(&self.body, &mut list);
        list
    }
}

fn is_number(x: f64) -> bool {
    x.is_finite() && x != 0.0 && x.abs() != 1.0 && x != f64::EPSILON
}

fn each(body: &[Inst], f: &mut impl FnMut(Value, f64)) {
    for inst in body {
        match inst {
            Inst::Let(v, Op::Const(x)) => f(*v, *x),
            Inst::Newton(n) => each(&n.body, f),
            Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => {}
        }
    }
}

fn replace(body: &mut [Inst], f: &mut impl FnMut(Value, f64) -> f64) {
    for inst in body {
        match inst {
            Inst::Let(v, Op::Const(x)) => *x = f(*v, *x),
            Inst::Newton(n) => replace(&mut n.body, f),
            Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::{Array, Builder, Unary};

    fn program(k: f64, exponent: f64, one: f64) -> Program {
        let mut b = Builder::new("test");
        let (x, to) = (b.slot(Array::State), b.slot(Array::Next));
        let x = b.load(x);
        let (k, e, one) = (b.number(k), b.number(exponent), b.number(one));
        let power = b.binary(Binary::Pow, x, e);
        let product = b.binary(Binary::Mul, k, power);
        let sum = b.binary(Binary::Add, product, one);
        let sine = b.unary(Unary::Sin, sum);
        b.store(to, sine);
        b.finish()
    }

    #[test]
    fn numbers_differ_and_what_decides_does_not() {
        let a = program(3.5, 0.3, 1.0);
        assert_eq!(a.numbers().iter().map(|n| n.1).collect::<Vec<_>>(), [3.5]);
        assert_eq!(a.code_shape(), program(7.25, 0.3, 1.0).code_shape());
        assert_ne!(a.code_shape(), program(-3.5, 0.3, 1.0).code_shape());
        assert_ne!(a.code_shape(), program(3.5, 0.7, 1.0).code_shape());
        assert_ne!(a.code_shape(), program(3.5, 0.3, -1.0).code_shape());
        assert_eq!(a.code_shape().code_shape(), a.code_shape());
        // Bits count: NaN is like itself, and 0 is not -0.
        assert_eq!(program(f64::NAN, 0.3, 1.0).code_shape(), program(f64::NAN, 0.3, 1.0).code_shape());
        assert_ne!(program(0.0, 0.3, 1.0).code_shape(), program(-0.0, 0.3, 1.0).code_shape());
    }
}
