//! Values of trees as they are written, each with how far any other way to compute it may be off.
//!
//! Every number and every result is taken to be uncertain by [`GRAIN`] of itself, and what follows from that is carried
//! along. So what an equal expression gives lies within, whatever it rounds. Where a little may make a jump, or where
//! numbers leave the usual sizes, nothing is known.

use bond_grammar::ast::{self, Expr, ExprKind};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};

/// The part of each number and result that may be rounding: hundreds of units in the last place.
pub const GRAIN: f64 = 256.0 * f64::EPSILON;
/// What rounds at most so much of itself is as it was written.
const WRITTEN: f64 = 2.0 * GRAIN;
/// Numbers whose products and quotients neither overflow nor lose digits.
const USUAL: std::ops::Range<f64> = 1e-100..1e100;
/// The largest exponent for which the factors of a base may be raised one by one.
const LARGEST_EXPONENT: f64 = 100.0;
/// The largest part of a number, or of what a function turns by, for which its slope tells what it is off by.
const SMALL: f64 = 0.05;

/// A value, and by how much it may be off; infinite where nothing is known.
#[derive(Clone, Copy, Debug)]
pub struct Bounded {
    /// The value.
    pub at: f64,
    /// How far another way to compute it may be from there.
    pub off: f64,
}

impl Bounded {
    const UNKNOWN: Self = Self { at: f64::NAN, off: f64::INFINITY };

    /// A result, and what it is off by for what its arguments are.
    fn new(at: f64, off: f64) -> Self {
        if at == 0.0 { Self { at, off } } else { Self::not_zero(at, off) }
    }

    /// The same of what is 0 only if it is too small.
    fn not_zero(at: f64, off: f64) -> Self {
        let off = off + GRAIN * at.abs();
        if USUAL.contains(&at.abs()) && off.is_finite() { Self { at, off } } else { Self::UNKNOWN }
    }

    /// One of a few values that are apart from each other.
    fn exact(at: f64) -> Self {
        Self { at, off: 0.0 }
    }

    /// Whether something is known.
    pub fn is_known(self) -> bool {
        self.at.is_finite() && self.off.is_finite()
    }

    /// Whether another value may be the same one.
    pub fn is_near(self, other: f64) -> bool {
        (self.at - other).abs() <= self.off
    }

    /// Whether it is not 0, where that is known.
    fn truth(self) -> Option<bool> {
        let sure = self.is_known() && (self.at.abs() > self.off || self.off == 0.0);
        sure.then_some(self.at != 0.0)
    }

    /// Whether it is surely above 0, and by far more than it is off.
    fn is_positive(self) -> bool {
        self.at > 0.0 && self.off <= SMALL * self.at
    }
}

fn truth(x: Option<bool>) -> Bounded {
    x.map_or(Bounded::UNKNOWN, |x| Bounded::exact(f64::from(u8::from(x))))
}

fn add(a: Bounded, b: Bounded) -> Bounded {
    Bounded::new(a.at + b.at, a.off + b.off + GRAIN * (a.at.abs() + b.at.abs()))
}

fn mul(a: Bounded, b: Bounded) -> Bounded {
    let off = a.at.abs() * b.off + b.at.abs() * a.off + a.off * b.off;
    if a.at == 0.0 || b.at == 0.0 { Bounded { at: 0.0, off } } else { Bounded::not_zero(a.at * b.at, off) }
}

fn div(a: Bounded, b: Bounded) -> Bounded {
    if b.off > SMALL * b.at.abs() || b.at == 0.0 {
        return Bounded::UNKNOWN;
    }
    let q = a.at / b.at;
    let off = 2.0 * (a.off + q.abs() * b.off) / b.at.abs();
    if a.at == 0.0 { Bounded { at: 0.0, off } } else { Bounded::not_zero(q, off) }
}

fn pow(a: Bounded, b: Bounded) -> Bounded {
    let is_whole = b.at == b.at.trunc() && b.off <= WRITTEN * b.at.abs() && b.at.abs() < 1e6;
    if b.at.abs() > LARGEST_EXPONENT {
        return Bounded::UNKNOWN;
    }
    let r = eval::binary(Binary::Pow, a.at, b.at);
    let size = Bounded { at: a.at.abs(), off: a.off };
    // Where the slope has no bound, nothing is said.
    if size.at == 0.0 && size.off == 0.0 && b.at >= 1.0 {
        return Bounded::exact(0.0);
    }
    if is_whole && b.at == 0.0 {
        return Bounded::exact(1.0);
    }
    if !size.is_positive() || (a.at < 0.0 && !is_whole) {
        return Bounded::UNKNOWN;
    }
    let turns = b.at.abs() * a.off / size.at + if is_whole { 0.0 } else { size.at.ln().abs() * (b.off + GRAIN) };
    if turns > SMALL { Bounded::UNKNOWN } else { Bounded::not_zero(r, r.abs() * (2.0 * turns + GRAIN * b.at.abs())) }
}

fn atan2(y: Bounded, x: Bounded) -> Bounded {
    let square = x.at * x.at + y.at * y.at;
    let cut = x.at <= x.off && y.at.abs() <= y.off;
    if cut || x.off + y.off > SMALL * square.sqrt() {
        return Bounded::UNKNOWN;
    }
    let slope = 2.0 * (x.at.abs() * y.off + y.at.abs() * x.off) / square;
    Bounded::new(eval::binary(Binary::Atan2, y.at, x.at), slope)
}

/// A function whose slope near the argument is at most `slope`.
fn smooth(f: Unary, a: Bounded, slope: f64) -> Bounded {
    if a.off * slope.max(1.0) > SMALL {
        Bounded::UNKNOWN
    } else {
        Bounded::new(eval::unary(f, a.at), 2.0 * slope * a.off)
    }
}

fn unary(f: Unary, a: Bounded) -> Bounded {
    if !a.is_known() {
        return Bounded::UNKNOWN;
    }
    let x = a.at;
    match f {
        Unary::Neg => Bounded { at: -x, ..a },
        Unary::Abs => Bounded { at: x.abs(), ..a },
        Unary::Sign if a.truth().is_some() => Bounded::exact(eval::unary(f, x)),
        Unary::Sqrt if a.is_positive() => Bounded::new(x.sqrt(), a.off / x.sqrt()),
        Unary::Log if a.is_positive() => Bounded::new(eval::unary(f, x), 2.0 * a.off / x),
        Unary::Exp if a.off <= SMALL => Bounded::not_zero(x.exp(), 2.0 * a.off * x.exp()),
        Unary::Sin | Unary::Cos | Unary::Atan | Unary::Tanh => smooth(f, a, 1.0),
        Unary::Tan => smooth(f, a, 1.0 + x.tan() * x.tan()),
        Unary::Asin | Unary::Acos if 1.0 - x.abs() > 20.0 * a.off => smooth(f, a, 1.0 / (1.0 - x * x).sqrt()),
        Unary::Sinh | Unary::Cosh if a.off <= SMALL => Bounded::new(eval::unary(f, x), 2.0 * a.off * x.cosh()),
        Unary::Not => truth(a.truth().map(|t| !t)),
        Unary::Floor if (x - x.round()).abs() > a.off => Bounded::new(x.floor(), 0.0),
        Unary::Sign
        | Unary::Sqrt
        | Unary::Log
        | Unary::Exp
        | Unary::Asin
        | Unary::Acos
        | Unary::Sinh
        | Unary::Cosh
        | Unary::Floor => Bounded::UNKNOWN,
    }
}

/// A comparison, where it is known: whether `holds` of the difference.
fn compared(a: Bounded, b: Bounded, holds: fn(f64) -> bool) -> Bounded {
    let off = a.off + b.off + if a.off + b.off > 0.0 { GRAIN * (a.at.abs() + b.at.abs()) } else { 0.0 };
    let difference = a.at - b.at;
    let sure = a.is_known() && b.is_known() && (off == 0.0 || difference.abs() > off);
    truth(sure.then(|| holds(difference)))
}

fn binary(f: ast::Binary, a: Bounded, b: Bounded) -> Bounded {
    match f {
        ast::Binary::Add => add(a, b),
        ast::Binary::Sub => add(a, unary(Unary::Neg, b)),
        ast::Binary::Mul => mul(a, b),
        ast::Binary::Div => div(a, b),
        ast::Binary::Pow => pow(a, b),
        ast::Binary::Lt => compared(a, b, |d| d < 0.0),
        ast::Binary::Le => compared(a, b, |d| d <= 0.0),
        ast::Binary::Gt => compared(a, b, |d| d > 0.0),
        ast::Binary::Ge => compared(a, b, |d| d >= 0.0),
        ast::Binary::Eq => compared(a, b, |d| d == 0.0),
        ast::Binary::Ne => compared(a, b, |d| d != 0.0),
        ast::Binary::And => truth(a.truth().zip(b.truth()).map(|(a, b)| a && b)),
        ast::Binary::Or => truth(a.truth().zip(b.truth()).map(|(a, b)| a || b)),
    }
}

/// The value of a tree whose names have values.
pub fn value(e: &Expr, names: &dyn Fn(&str) -> Option<f64>) -> Bounded {
    let of = |e: &Expr| value(e, names);
    let number = |x: Option<f64>| x.map_or(Bounded::UNKNOWN, |x| Bounded::new(x, 0.0));
    match &e.kind {
        ExprKind::Number { digits, .. } => number(digits.parse().ok()),
        ExprKind::Bool(b) => Bounded::exact(f64::from(u8::from(*b))),
        ExprKind::Path(path) => match &path.segments[..] {
            [one] => number(names(&one.name.text)),
            _ => Bounded::UNKNOWN,
        },
        ExprKind::Unary(f, a) => unary(if *f == ast::Unary::Neg { Unary::Neg } else { Unary::Not }, of(a)),
        ExprKind::Binary(f, a, b) => {
            let (a, b) = (of(a), of(b));
            if a.is_known() && b.is_known() { binary(*f, a, b) } else { Bounded::UNKNOWN }
        }
        ExprKind::If(c, a, b) => match of(c).truth() {
            Some(true) => of(a),
            Some(false) => of(b),
            None => Bounded::UNKNOWN,
        },
        ExprKind::Call(name, args) => match &args[..] {
            [a] => {
                let f = Unary::ALL.into_iter().find(|f| f.name() == name.text);
                f.map_or(Bounded::UNKNOWN, |f| unary(f, of(a)))
            }
            [a, b] => {
                let (a, b) = (of(a), of(b));
                let off = a.off.max(b.off);
                match name.text.as_str() {
                    _ if !a.is_known() || !b.is_known() => Bounded::UNKNOWN,
                    "min" => Bounded { at: a.at.min(b.at), off },
                    "max" => Bounded { at: a.at.max(b.at), off },
                    "atan2" => atan2(a, b),
                    _ => Bounded::UNKNOWN,
                }
            }
            _ => Bounded::UNKNOWN,
        },
        ExprKind::Paren(a) => of(a),
        ExprKind::List(_) | ExprKind::Range(..) => Bounded::UNKNOWN,
    }
}

/// How much larger the factors of a product may be, at the one end or the other, than the product.
const UNEVEN: f64 = 100.0;

/// Whether no product or quotient in a tree is far smaller than what its factors are at one or the other of two places:
/// a product rule that takes both from there cancels.
pub fn is_even(e: &Expr, ends: [&dyn Fn(&str) -> Option<f64>; 2]) -> bool {
    let even = |list: &[&Expr]| list.iter().all(|e| is_even(e, ends));
    let largest = |e: &Expr| ends.map(|names| value(e, names).at.abs()).into_iter().fold(0.0, f64::max);
    let smallest = |e: &Expr| ends.map(|names| value(e, names).at.abs()).into_iter().fold(f64::INFINITY, f64::min);
    match &e.kind {
        ExprKind::Number { .. } | ExprKind::Bool(_) | ExprKind::Path(_) => true,
        ExprKind::Binary(f, a, b) => {
            let size = match f {
                ast::Binary::Mul => largest(a) * largest(b),
                ast::Binary::Div => largest(a) / smallest(b),
                _ => 0.0,
            };
            size <= UNEVEN * largest(e) && even(&[a, b])
        }
        ExprKind::Unary(_, a) | ExprKind::Paren(a) => even(&[a]),
        ExprKind::Range(a, b) => even(&[a, b]),
        ExprKind::If(c, a, b) => even(&[c, a, b]),
        ExprKind::Call(_, list) | ExprKind::List(list) => even(&list.iter().collect::<Vec<_>>()),
    }
}
