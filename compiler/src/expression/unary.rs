//! What the compiler knows about the functions of one value: one row per function.
//!
//! A new function of a mathematical library is a row of `ir/op.rs` in `bond-runtime` and a row here. A fact that is
//! left out is the one of [`PLAIN`], which is safe for every function but for its derivative.

use super::difference::{Along, Step};
use super::power_series::{
    Leads, Series, constant, exponential, integral, inverse_root, logarithm, one_plus_square, power, sine_and_cosine,
    tangent,
};
use super::{Expr, Number, Pool, Sign};
use bond_runtime::eval;
use bond_runtime::ir::Unary;
use std::f64::consts::{FRAC_PI_2, PI};

/// What happens to the value where the argument changes its sign.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Parity {
    /// Nothing.
    Even,
    /// It changes its sign too.
    Odd,
    /// Something else.
    Neither,
}

/// Where a function is continuous.
#[derive(Clone, Copy)]
pub(super) enum Continuous {
    Everywhere,
    /// At positive arguments.
    Positive,
    /// It has jumps or poles, or an end of its domain.
    Partly,
}

/// How the value grows with its argument.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Growth {
    /// It is bounded, or far smaller than the argument.
    Bounded,
    /// As a power.
    Algebraic,
    /// Exponentially to the positive side.
    Exponential,
    /// Exponentially to both sides.
    ExponentialBothWays,
}

/// The argument of a value.
#[derive(Clone, Copy)]
pub(super) struct Inverse {
    /// Whether the function takes this value.
    pub(super) takes: fn(f64) -> bool,
    /// The argument at `y`, whose value is the number; of two arguments the one that is not negative.
    pub(super) of: fn(&mut Pool, Expr, f64) -> Expr,
}

/// How a formula is set.
#[derive(Clone, Copy)]
pub(super) enum Latex {
    /// By its name in upright letters, with the argument in parentheses.
    Operator,
    /// By the command of this name, with the argument in parentheses.
    Command(&'static str),
    /// Between two delimiters.
    Between(&'static str, &'static str),
    /// As an exponent of e.
    Exponent,
    /// A sign in front.
    Prefix(&'static str),
}

/// The facts of a function `f` of one argument.
#[derive(Clone, Copy)]
pub(super) struct Row {
    /// A leading minus of the argument is taken out or left out by it.
    pub(super) parity: Parity,
    /// Bounds of the value for every argument.
    pub(super) range: (f64, f64),
    /// The sign of the value from that of the argument.
    pub(super) sign: fn(Sign) -> Sign,
    /// Where it is continuous.
    pub(super) continuous: Continuous,
    /// How it grows.
    pub(super) growth: Growth,
    /// Whether it is made of straight lines.
    pub(super) is_piecewise_linear: bool,
    /// The derivative at `a`, where the value is `e`: called with `a` and `e`.
    pub(super) derivative: fn(&mut Pool, Expr, Expr) -> Expr,
    /// An antiderivative, where there is an elementary one: called with `a` and `e`.
    pub(super) antiderivative: fn(&mut Pool, Expr, Expr) -> Option<Expr>,
    /// Whether a power times the function is integrated by parts.
    pub(super) by_parts: bool,
    /// The argument of a value, for a function that turns nowhere but at 0.
    pub(super) inverse: Option<Inverse>,
    /// The divided difference over a step without cancellation: called with the argument and the value at both ends.
    pub(super) difference: fn(&mut Pool, Along, Along, &Step) -> Expr,
    /// The Maclaurin coefficients of `f(u)` from those of `u`.
    pub(super) maclaurin: fn(&[f64], Leads<'_>) -> Option<Series>,
    /// How it is set.
    pub(super) latex: Latex,
}

/// A function that is constant but for jumps.
const PLAIN: Row = Row {
    parity: Parity::Neither,
    range: (f64::NEG_INFINITY, f64::INFINITY),
    sign: |_| Sign::Unknown,
    continuous: Continuous::Partly,
    growth: Growth::Bounded,
    is_piecewise_linear: false,
    derivative: |pool, _, _| pool.zero(),
    antiderivative: |_, _, _| None,
    by_parts: false,
    inverse: None,
    difference: |pool, _, value, step| pool.along_jump((value.from, value.to), step),
    maclaurin: |_, _| None,
    latex: Latex::Operator,
};

const ABS: Row = Row {
    range: (0.0, f64::INFINITY),
    sign: |a| match a {
        Sign::Zero => Sign::Zero,
        Sign::Positive | Sign::Negative => Sign::Positive,
        Sign::NonNegative | Sign::NonPositive | Sign::Unknown => Sign::NonNegative,
    },
    continuous: Continuous::Everywhere,
    growth: Growth::Algebraic,
    is_piecewise_linear: true,
    derivative: |pool, a, _| pool.unary(Unary::Sign, a),
    antiderivative: |pool, a, e| {
        let product = pool.mul(a, e);
        Some(pool.scale(product, Number::HALF))
    },
    difference: Pool::along_abs,
    maclaurin: |u, leads| {
        let side = leads(u);
        Some(u.iter().map(|x| side * x).collect())
    },
    latex: Latex::Between(r"\left|", r"\right|"),
    ..PLAIN
};

const SIGN: Row = Row {
    range: (-1.0, 1.0),
    sign: |a| a,
    is_piecewise_linear: true,
    antiderivative: |pool, a, _| Some(pool.unary(Unary::Abs, a)),
    maclaurin: |u, leads| Some(constant(leads(u), u.len())),
    ..PLAIN
};

const NOT: Row = Row {
    range: (0.0, 1.0),
    sign: |a| match a {
        Sign::Zero => Sign::Positive,
        Sign::Positive | Sign::Negative => Sign::Zero,
        Sign::NonNegative | Sign::NonPositive | Sign::Unknown => Sign::NonNegative,
    },
    is_piecewise_linear: true,
    maclaurin: |u, leads| Some(constant(f64::from(leads(u) == 0.0), u.len())),
    latex: Latex::Prefix(r"\lnot "),
    ..PLAIN
};

const FLOOR: Row = Row {
    sign: |a| if a == Sign::Positive { Sign::NonNegative } else { a },
    growth: Growth::Algebraic,
    is_piecewise_linear: true,
    antiderivative: |pool, a, e| {
        // n a - n (n + 1)/2 with n = floor(a)
        let one = pool.one();
        let next = pool.add(one, e);
        let (all, steps) = (pool.mul(e, a), pool.mul(e, next));
        Some(pool.combine(&[(all, Number::ONE), (steps, -Number::HALF)]))
    },
    maclaurin: |u, leads| {
        // Where it jumps, on the side that the argument goes to.
        let whole = eval::unary(Unary::Floor, u[0]);
        let past: Series = std::iter::once(u[0] - whole).chain(u.iter().skip(1).copied()).collect();
        Some(constant(if leads(&past) < 0.0 { whole - 1.0 } else { whole }, u.len()))
    },
    latex: Latex::Between(r"\left\lfloor ", r" \right\rfloor"),
    ..PLAIN
};

const EXP: Row = Row {
    range: (0.0, f64::INFINITY),
    sign: |_| Sign::Positive,
    continuous: Continuous::Everywhere,
    growth: Growth::Exponential,
    derivative: |_, _, e| e,
    antiderivative: |_, _, e| Some(e),
    by_parts: true,
    inverse: Some(Inverse { takes: |y| y > 0.0, of: |pool, y, _| pool.unary(Unary::Log, y) }),
    difference: |pool, a, _, step| pool.along_exp(a, step),
    maclaurin: |u, _| Some(exponential(u)),
    latex: Latex::Exponent,
    ..PLAIN
};

const LOG: Row = Row {
    continuous: Continuous::Positive,
    derivative: |pool, a, _| pool.powi(a, -1),
    antiderivative: |pool, a, e| {
        let product = pool.mul(a, e);
        Some(pool.sub(product, a))
    },
    inverse: Some(Inverse { takes: |_| true, of: |pool, y, _| pool.unary(Unary::Exp, y) }),
    difference: |pool, a, _, step| pool.along_log(a, step),
    maclaurin: |u, _| logarithm(u),
    latex: Latex::Command("log"),
    ..PLAIN
};

const SIN: Row = Row {
    parity: Parity::Odd,
    range: (-1.0, 1.0),
    sign: |a| if a == Sign::Zero { Sign::Zero } else { Sign::Unknown },
    continuous: Continuous::Everywhere,
    derivative: |pool, a, _| pool.unary(Unary::Cos, a),
    antiderivative: |pool, a, _| {
        let cos = pool.unary(Unary::Cos, a);
        Some(pool.neg(cos))
    },
    by_parts: true,
    difference: |pool, a, _, step| pool.along_sine(Unary::Cos, a, step),
    maclaurin: |u, _| Some(sine_and_cosine(u, -1.0).0),
    latex: Latex::Command("sin"),
    ..PLAIN
};

const COS: Row = Row {
    parity: Parity::Even,
    range: (-1.0, 1.0),
    continuous: Continuous::Everywhere,
    derivative: |pool, a, _| {
        let sin = pool.unary(Unary::Sin, a);
        pool.neg(sin)
    },
    antiderivative: |pool, a, _| Some(pool.unary(Unary::Sin, a)),
    by_parts: true,
    difference: |pool, a, _, step| {
        let slope = pool.along_sine(Unary::Sin, a, step);
        pool.neg(slope)
    },
    maclaurin: |u, _| Some(sine_and_cosine(u, -1.0).1),
    latex: Latex::Command("cos"),
    ..PLAIN
};

const TAN: Row = Row {
    parity: Parity::Odd,
    sign: |a| if a == Sign::Zero { Sign::Zero } else { Sign::Unknown },
    growth: Growth::Algebraic,
    derivative: |pool, _, e| pool.one_plus_square(e, Number::ONE),
    antiderivative: |pool, a, _| {
        let cos = pool.unary(Unary::Cos, a);
        let size = pool.unary(Unary::Abs, cos);
        let log = pool.unary(Unary::Log, size);
        Some(pool.neg(log))
    },
    difference: |pool, a, _, step| pool.along_tan(a, step),
    maclaurin: |u, _| Some(tangent(u, 1.0)),
    latex: Latex::Command("tan"),
    ..PLAIN
};

const ASIN: Row = Row {
    parity: Parity::Odd,
    sign: |a| a,
    derivative: |pool, a, _| {
        let inside = pool.one_plus_square(a, Number::MINUS_ONE);
        pool.power(inside, Number::ratio(-1, 2))
    },
    antiderivative: |pool, a, e| {
        let (product, root) = pool.product_and_root(a, e);
        Some(pool.add(product, root))
    },
    inverse: Some(Inverse { takes: |y| y.abs() < FRAC_PI_2, of: |pool, y, _| pool.unary(Unary::Sin, y) }),
    difference: |pool, a, _, step| {
        let slope = pool.along_half_asin(a, step);
        pool.scale(slope, Number::from(2))
    },
    maclaurin: |u, _| Some(integral(Unary::Asin, u, &inverse_root(u)?)),
    latex: Latex::Command("arcsin"),
    ..PLAIN
};

const ACOS: Row = Row {
    sign: |_| Sign::NonNegative,
    derivative: |pool, a, _| {
        let inside = pool.one_plus_square(a, Number::MINUS_ONE);
        let slope = pool.power(inside, Number::ratio(-1, 2));
        pool.neg(slope)
    },
    antiderivative: |pool, a, e| {
        let (product, root) = pool.product_and_root(a, e);
        Some(pool.sub(product, root))
    },
    inverse: Some(Inverse { takes: |y| (0.0..PI).contains(&y), of: |pool, y, _| pool.unary(Unary::Cos, y) }),
    difference: |pool, a, _, step| {
        let slope = pool.along_half_asin(a, step);
        pool.scale(slope, Number::from(-2))
    },
    maclaurin: |u, _| {
        let slope: Series = inverse_root(u)?.iter().map(|x| -x).collect();
        Some(integral(Unary::Acos, u, &slope))
    },
    latex: Latex::Command("arccos"),
    ..PLAIN
};

const ATAN: Row = Row {
    parity: Parity::Odd,
    sign: |a| a,
    continuous: Continuous::Everywhere,
    derivative: |pool, a, _| {
        let inside = pool.one_plus_square(a, Number::ONE);
        pool.powi(inside, -1)
    },
    antiderivative: |pool, a, e| {
        let product = pool.mul(a, e);
        let sum = pool.one_plus_square(a, Number::ONE);
        let log = pool.unary(Unary::Log, sum);
        let log = pool.scale(log, Number::HALF);
        Some(pool.sub(product, log))
    },
    inverse: Some(Inverse { takes: |y| y.abs() < FRAC_PI_2, of: |pool, y, _| pool.unary(Unary::Tan, y) }),
    difference: |pool, a, _, step| pool.along_atan(a, step),
    maclaurin: |u, _| Some(integral(Unary::Atan, u, &power(&one_plus_square(u, 1.0), Number::MINUS_ONE)?)),
    latex: Latex::Command("arctan"),
    ..PLAIN
};

const SINH: Row = Row {
    parity: Parity::Odd,
    sign: |a| a,
    continuous: Continuous::Everywhere,
    growth: Growth::ExponentialBothWays,
    derivative: |pool, a, _| pool.unary(Unary::Cosh, a),
    antiderivative: |pool, a, _| Some(pool.unary(Unary::Cosh, a)),
    by_parts: true,
    inverse: Some(Inverse { takes: |_| true, of: |pool, y, value| pool.area(y, value, Number::ONE) }),
    difference: |pool, a, _, step| pool.along_hyperbolic_sine(Unary::Cosh, a, step),
    maclaurin: |u, _| Some(sine_and_cosine(u, 1.0).0),
    latex: Latex::Command("sinh"),
    ..PLAIN
};

const COSH: Row = Row {
    parity: Parity::Even,
    range: (1.0, f64::INFINITY),
    sign: |_| Sign::Positive,
    continuous: Continuous::Everywhere,
    growth: Growth::ExponentialBothWays,
    derivative: |pool, a, _| pool.unary(Unary::Sinh, a),
    antiderivative: |pool, a, _| Some(pool.unary(Unary::Sinh, a)),
    by_parts: true,
    inverse: Some(Inverse { takes: |y| y >= 1.0, of: |pool, y, value| pool.area(y, value, Number::MINUS_ONE) }),
    difference: |pool, a, _, step| pool.along_hyperbolic_sine(Unary::Sinh, a, step),
    maclaurin: |u, _| Some(sine_and_cosine(u, 1.0).1),
    latex: Latex::Command("cosh"),
    ..PLAIN
};

const TANH: Row = Row {
    parity: Parity::Odd,
    range: (-1.0, 1.0),
    sign: |a| a,
    continuous: Continuous::Everywhere,
    derivative: |pool, _, e| pool.one_plus_square(e, Number::MINUS_ONE),
    antiderivative: |pool, a, _| Some(pool.log_cosh(a)),
    inverse: Some(Inverse {
        takes: |y| y.abs() < 1.0,
        of: |pool, y, _| {
            let one = pool.one();
            let (above, below) = (pool.add(one, y), pool.sub(one, y));
            let ratio = pool.div(above, below);
            let log = pool.unary(Unary::Log, ratio);
            pool.scale(log, Number::HALF)
        },
    }),
    difference: Pool::along_tanh,
    maclaurin: |u, _| Some(tangent(u, -1.0)),
    latex: Latex::Command("tanh"),
    ..PLAIN
};

/// The facts of a function.
pub(super) fn row(f: Unary) -> &'static Row {
    match f {
        // A product and a power: never functions in the canonical form.
        Unary::Neg | Unary::Sqrt => &PLAIN,
        Unary::Abs => &ABS,
        Unary::Sign => &SIGN,
        Unary::Not => &NOT,
        Unary::Floor => &FLOOR,
        Unary::Exp => &EXP,
        Unary::Log => &LOG,
        Unary::Sin => &SIN,
        Unary::Cos => &COS,
        Unary::Tan => &TAN,
        Unary::Asin => &ASIN,
        Unary::Acos => &ACOS,
        Unary::Atan => &ATAN,
        Unary::Sinh => &SINH,
        Unary::Cosh => &COSH,
        Unary::Tanh => &TANH,
    }
}

/// How a function grows with its argument.
pub(crate) fn growth(f: Unary) -> Growth {
    row(f).growth
}

/// Whether a function is made of straight lines.
pub(crate) fn is_piecewise_linear(f: Unary) -> bool {
    row(f).is_piecewise_linear
}

impl Pool {
    /// `1 + n x^2`
    fn one_plus_square(&mut self, x: Expr, n: Number) -> Expr {
        let one = self.one();
        let square = self.powi(x, 2);
        self.combine(&[(one, Number::ONE), (square, n)])
    }

    /// `a e` and `sqrt(1 - a^2)`
    fn product_and_root(&mut self, a: Expr, e: Expr) -> (Expr, Expr) {
        let product = self.mul(a, e);
        let inside = self.one_plus_square(a, Number::MINUS_ONE);
        (product, self.sqrt(inside))
    }

    /// The area hyperbolic sine with `n` = 1, cosine with -1: `log(|y| + sqrt(y^2 + n))`, with the sign of the value.
    fn area(&mut self, y: Expr, value: f64, n: Number) -> Expr {
        let one = self.one();
        let size = self.unary(Unary::Abs, y);
        let square = self.powi(y, 2);
        let inside = self.combine(&[(square, Number::ONE), (one, n)]);
        let root = self.sqrt(inside);
        let sum = self.add(size, root);
        let log = self.unary(Unary::Log, sum);
        if value < 0.0 { self.neg(log) } else { log }
    }
}
