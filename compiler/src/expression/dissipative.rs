//! Whether a law only takes energy: `law(s) s >= 0` for all `s`.

use super::unary::{Continuous, row};
use super::{Expr, Node, Pool, Sign, Symbol};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

impl Pool {
    /// Whether `law * s >= 0` for all values of `s` and of all other variables: `Some(true)` if that is proved,
    /// `Some(false)` if `law` has no variable but `s` and a value of it refutes, else `None`.
    pub fn dissipative(&mut self, law: Expr, s: Symbol) -> Option<bool> {
        self.dissipative_where(law, s, &|_| Sign::Unknown)
    }

    /// The same, knowing the signs of the other variables.
    pub fn dissipative_where(&mut self, law: Expr, s: Symbol, assume: &dyn Fn(Symbol) -> Sign) -> Option<bool> {
        if self.proves(law, s, assume, 0) {
            return Some(true);
        }
        if self.symbols(law).iter().all(|&x| x == s) && self.refuting(law).is_some() { Some(false) } else { None }
    }

    fn proves(&mut self, law: Expr, s: Symbol, assume: &dyn Fn(Symbol) -> Sign, depth: usize) -> bool {
        if depth > self.options.nesting {
            return false;
        }
        if self.proves_by_sign(law, s, assume) || self.proves_by_slope(law, s, assume) || self.proves_by_pieces(law, s)
        {
            return true;
        }
        match self.node(law).clone() {
            Node::Sum(c, terms) => {
                c.is_zero()
                    && terms.iter().all(|&(t, n)| {
                        let t = self.scale(t, n);
                        self.proves(t, s, assume, depth + 1)
                    })
            }
            Node::Product(c, factors) => {
                // one factor is a law, the others are not negative
                (0..factors.len()).any(|i| {
                    let mut others = factors.to_vec();
                    let (f, n) = others.remove(i);
                    if n.integer().is_none_or(|n| n % 2 == 0) {
                        return false;
                    }
                    let others = self.powers(&others);
                    let others = self.scale(others, c);
                    self.sign(others, &|x| if x == s { Sign::Unknown } else { assume(x) }).is_nonnegative()
                        && self.contains(f, s)
                        && self.proves(f, s, assume, depth + 1)
                })
            }
            Node::Unary(f, a) if keeps_sign(f) => self.proves(a, s, assume, depth + 1),
            Node::Binary(Binary::Min | Binary::Max, a, b) => {
                self.proves(a, s, assume, depth + 1) && self.proves(b, s, assume, depth + 1)
            }
            Node::Select(c, a, b) => {
                (self.proves_away_from_zero(c, true, a, s, assume) || self.proves(a, s, assume, depth + 1))
                    && (self.proves_away_from_zero(c, false, b, s, assume) || self.proves(b, s, assume, depth + 1))
            }
            Node::Number(_) | Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) => false,
        }
    }

    /// A branch that is taken only beyond a threshold, on the side that does not have 0 in it: by its sign there.
    fn proves_away_from_zero(
        &mut self,
        condition: Expr,
        taken: bool,
        law: Expr,
        s: Symbol,
        assume: &dyn Fn(Symbol) -> Sign,
    ) -> bool {
        let Some(threshold) = self.threshold(condition, s) else { return false };
        let Some(at) = self.constant(threshold).filter(|at| at.is_finite()) else { return false };
        // What else it depends on may turn it round.
        if self.symbols(condition).iter().any(|x| *x != s) {
            return false;
        }
        // beyond 0 as seen from the threshold, and further out
        let above = self.eval(condition, &|_| at + at.abs().max(1.0)) != 0.0;
        let below = self.eval(condition, &|_| at - at.abs().max(1.0)) != 0.0;
        let (upper, lower) = (above == taken && below != taken, below == taken && above != taken);
        let x = self.var(s);
        let shifted = self.add(threshold, x);
        let law = self.at(law, s, shifted);
        let with = |sign: Sign| self.sign(law, &|x| if x == s { sign } else { assume(x) });
        if upper && at >= 0.0 {
            with(Sign::NonNegative).is_nonnegative()
        } else if lower && at <= 0.0 {
            with(Sign::NonPositive).is_nonpositive()
        } else {
            false
        }
    }

    /// Not negative where `s` is positive, not positive where it is negative.
    fn proves_by_sign(&self, law: Expr, s: Symbol, assume: &dyn Fn(Symbol) -> Sign) -> bool {
        let with = |sign: Sign| self.sign(law, &|x| if x == s { sign } else { assume(x) });
        with(Sign::Positive).is_nonnegative() && with(Sign::Negative).is_nonpositive()
    }

    /// 0 at 0 and never falling.
    fn proves_by_slope(&mut self, law: Expr, s: Symbol, assume: &dyn Fn(Symbol) -> Sign) -> bool {
        let zero = self.zero();
        let at: FxHashMap<_, _> = [(s, zero)].into_iter().collect();
        let start = self.substitute(law, &at);
        if self.constant(start) != Some(0.0) || !self.is_continuous(law, s, assume) {
            return false;
        }
        let slope = self.derivative(law, s);
        self.sign(slope, &|x| if x == s { Sign::Unknown } else { assume(x) }).is_nonnegative()
    }

    /// Whether it is seen to have neither jumps nor poles in `s`.
    fn is_continuous(&self, e: Expr, s: Symbol, assume: &dyn Fn(Symbol) -> Sign) -> bool {
        let assume = |x: Symbol| if x == s { Sign::Unknown } else { assume(x) };
        self.dependents(e, &|x| x == s).into_iter().all(|e| match self.node(e) {
            Node::Number(_) | Node::Symbol(_) | Node::Sum(..) => true,
            Node::Product(_, factors) => factors.iter().all(|&(f, n)| {
                let whole = n.integer().is_some();
                !self.contains(f, s)
                    || (whole && n.is_positive())
                    || self.sign(f, &assume) == Sign::Positive
                    || (n.is_positive() && self.sign(f, &assume).is_nonnegative())
            }),
            Node::Power(a, b) => !self.contains(*b, s) && self.sign(*a, &assume) == Sign::Positive,
            Node::Unary(f, a) => match row(*f).continuous {
                Continuous::Everywhere => true,
                Continuous::Positive => self.sign(*a, &assume) == Sign::Positive,
                Continuous::Partly => false,
            },
            Node::Binary(f, ..) => *f == Binary::Min || *f == Binary::Max,
            Node::Select(..) => false,
        })
    }

    /// A value of a law's one variable at which it gives power back, and clearly so: by more than the terms' rounding.
    pub fn refuting(&self, law: Expr) -> Option<f64> {
        let mut all = vec![law];
        let mut offset = 0.0;
        if let Node::Sum(c, terms) = self.node(law) {
            offset = c.to_f64().abs();
            all.extend(terms.iter().map(|&(t, _)| t));
        }
        let weight = |i: usize| match self.node(law) {
            Node::Sum(_, terms) => terms[i].1.to_f64().abs(),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => 1.0,
        };
        let tens = (0..=6).flat_map(|k| [k, -k]);
        let sizes = tens.flat_map(|k| [1.0, 2.5, 5.0].map(|m| m * 10.0_f64.powi(k)));
        sizes.flat_map(|x| [x, -x]).find(|&x| {
            let values = self.eval_all(&all, &|_| x);
            let parts = values[1..].iter().enumerate().map(|(i, v)| v.abs() * weight(i));
            let largest = parts.fold(offset, f64::max);
            values[0] * x < 0.0 && values[0].is_finite() && values[0].abs() > 1e-9 * largest
        })
    }
}

/// Whether a function of something is never of the other sign.
fn keeps_sign(f: Unary) -> bool {
    let sign = row(f).sign;
    sign(Sign::Positive).is_nonnegative() && sign(Sign::Negative).is_nonpositive()
}
