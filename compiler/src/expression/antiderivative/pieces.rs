//! Laws with kinks as choices by plain comparisons of the variable.

use crate::expression::unary::{Inverse, Parity, Row, row};
use crate::expression::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

impl Pool {
    /// The same, but at single points, by choices `s < root` alone: no `abs`, `sign`, `min`, `max` or other comparison
    /// of `s` is left. `None` where it is not found at which places one turns over.
    pub(crate) fn by_pieces(&mut self, e: Expr, s: Symbol) -> Option<Expr> {
        self.cut(e, s, (f64::NEG_INFINITY, f64::INFINITY), &mut 0)
    }

    fn cut(&mut self, e: Expr, s: Symbol, (low, high): (f64, f64), pieces: &mut usize) -> Option<Expr> {
        // Children come first: nothing has a kink in what the first one compares.
        let nodes = self.dependents(e, &|x| x == s);
        let found = nodes.into_iter().find_map(|kink| Some((kink, self.compared(kink)?)));
        let Some((kink, (a, b))) = found else {
            *pieces += 1;
            return (*pieces <= self.options.pieces).then_some(e);
        };
        let u = self.sub(a, b);
        let zero = self.zero();
        let mut roots = Vec::new();
        for root in self.places(u, zero, s)? {
            let x = self.constant(root)?;
            if low < x && x < high {
                roots.push((x, root));
            }
        }
        roots.sort_by(|a, b| a.0.total_cmp(&b.0));
        roots.dedup_by_key(|r| r.0);
        let x = self.var(s);
        let mut whole: Option<Expr> = None;
        let mut end = high;
        for i in (0..=roots.len()).rev() {
            let start = if i == 0 { low } else { roots[i - 1].0 };
            let above = self.is_above(u, start, end);
            let value = self.taken(kink, above)?;
            let piece = self.replace(e, kink, value);
            let piece = self.cut(piece, s, (start, end), pieces)?;
            whole = Some(match whole {
                None => piece,
                Some(rest) => {
                    let below = self.binary(Binary::Lt, x, roots[i].1);
                    self.select(below, piece, rest)
                }
            });
            end = start;
        }
        whole
    }

    /// What a node compares, if it has a kink where the two are equal.
    fn compared(&mut self, e: Expr) -> Option<(Expr, Expr)> {
        let zero = self.zero();
        match *self.node(e) {
            Node::Unary(Unary::Abs | Unary::Sign | Unary::Not, a) | Node::Select(a, ..) => Some((a, zero)),
            Node::Binary(Binary::Atan2, ..) => None,
            Node::Binary(_, a, b) => Some((a, b)),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..) => None,
        }
    }

    /// What it is where the first that it compares is above the second, or is not.
    fn taken(&mut self, kink: Expr, above: bool) -> Option<Expr> {
        Some(match *self.node(kink) {
            Node::Unary(Unary::Abs, a) if above => a,
            Node::Unary(Unary::Abs, a) => self.neg(a),
            Node::Unary(Unary::Sign, _) => self.int(if above { 1 } else { -1 }),
            Node::Binary(Binary::Min, a, b) => {
                if above {
                    b
                } else {
                    a
                }
            }
            Node::Binary(Binary::Max, a, b) => {
                if above {
                    a
                } else {
                    b
                }
            }
            Node::Binary(Binary::Lt | Binary::Le, ..) => self.int(i64::from(!above)),
            Node::Binary(Binary::Eq, ..) => self.zero(),
            Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => return None,
        })
    }

    /// Whether `u` is above 0 between two places, where it has one sign.
    fn is_above(&self, u: Expr, low: f64, high: f64) -> bool {
        let inside = |share: f64| match (low.is_finite(), high.is_finite()) {
            (true, true) => low + share * (high - low),
            (true, false) => low + share * low.abs().max(1.0),
            (false, true) => high - share * high.abs().max(1.0),
            (false, false) => share,
        };
        let mut values = [0.5, 0.9, 0.1, 1e-3, 1e-9].into_iter().map(|share| self.eval(u, &|_| inside(share)));
        values.find(|u| *u != 0.0 && !u.is_nan()).is_none_or(|u| u > 0.0)
    }

    /// The expression with another one in the place of a node.
    fn replace(&mut self, e: Expr, node: Expr, by: Expr) -> Expr {
        let mut new: FxHashMap<Expr, Expr> = [(node, by)].into_iter().collect();
        for x in self.ascending(&[e], &|x| x > node) {
            let rebuilt = self.rebuild(x, &|c| new.get(&c).copied().unwrap_or(c));
            new.insert(x, rebuilt);
        }
        new.get(&e).copied().unwrap_or(e)
    }

    /// Where `u = y`, with `y` free of `s`, and where `u` jumps over it: every place at which `u - y` may change its
    /// sign. `None` where these are not found.
    pub(crate) fn places(&mut self, u: Expr, y: Expr, s: Symbol) -> Option<Vec<Expr>> {
        let mut found = Vec::new();
        self.solve(u, y, s, self.options.nesting, &mut found)?;
        Some(found)
    }

    fn solve(&mut self, u: Expr, y: Expr, s: Symbol, depth: usize, found: &mut Vec<Expr>) -> Option<()> {
        let depth = depth.checked_sub(1)?;
        let value = self.constant(y)?;
        if let Some((square, linear, constant)) = self.quadratic(u, &[s]) {
            let of = |list: Option<Expr>, pool: &mut Pool| list.unwrap_or_else(|| pool.zero());
            let b = of(linear.first().map(|l| l.1), self);
            let c = self.sub(constant, y);
            let Some(&(_, _, a)) = square.first() else {
                let root = self.div(c, b);
                found.push(self.neg(root));
                return Some(());
            };
            // The root that is larger in size first, so that nothing cancels: their product is c/a.
            let (b2, ac) = (self.powi(b, 2), self.mul(a, c));
            let inside = self.combine(&[(b2, Number::ONE), (ac, Number::from(-4))]);
            let root = self.sqrt(inside);
            let side = if self.constant(b)? < 0.0 { Number::ONE } else { Number::MINUS_ONE };
            let twice = self.combine(&[(b, Number::MINUS_ONE), (root, side)]);
            if self.constant(inside)? >= 0.0 && self.constant(twice)? != 0.0 {
                let first = self.div(twice, a);
                found.push(self.scale(first, Number::HALF));
                let second = self.div(c, twice);
                found.push(self.scale(second, Number::from(2)));
            } else if self.constant(inside)? >= 0.0 {
                found.push(twice);
            }
            return Some(());
        }
        match self.node(u).clone() {
            Node::Sum(c, terms) => {
                let (inside, outside): (Vec<_>, Vec<_>) = terms.iter().partition(|t| self.contains(t.0, s));
                let [(t, n)] = inside[..] else { return None };
                let mut rest: Vec<_> = outside.into_iter().map(|(t, n)| (t, -n)).collect();
                let one = self.one();
                rest.extend([(y, Number::ONE), (one, -c)]);
                let rest = self.combine(&rest);
                let y = self.scale(rest, n.recip());
                self.solve(t, y, s, depth, found)
            }
            Node::Product(c, factors) => {
                let (inside, outside): (Vec<(Expr, Number)>, Vec<_>) =
                    factors.iter().partition(|f| self.contains(f.0, s));
                let zero = self.zero();
                for &(f, n) in &inside {
                    if value == 0.0 || n.is_negative() {
                        self.solve(f, zero, s, depth, found)?;
                    }
                }
                if value == 0.0 {
                    return Some(());
                }
                let [(f, n)] = inside[..] else { return None };
                let outside = self.powers(&outside);
                let outside = self.scale(outside, c);
                let y = self.div(y, outside);
                let exponent = self.numeral(n.recip());
                let (even, odd) = (n.integer().is_some_and(|n| n % 2 == 0), n.integer().is_some_and(|n| n % 2 != 0));
                let negative = self.constant(y)? < 0.0;
                if negative && !odd {
                    return Some(());
                }
                let size = self.unary(Unary::Abs, y);
                let root = self.pow(size, exponent);
                let minus = self.neg(root);
                if !negative {
                    self.solve(f, root, s, depth, found)?;
                }
                if negative || even {
                    self.solve(f, minus, s, depth, found)?;
                }
                Some(())
            }
            Node::Power(a, b) if !self.contains(b, s) => {
                let y = if value == 0.0 {
                    y
                } else {
                    let exponent = self.powi(b, -1);
                    self.pow(y, exponent)
                };
                if value < 0.0 { Some(()) } else { self.solve(a, y, s, depth, found) }
            }
            Node::Unary(f, a) => {
                let Row { inverse, parity, .. } = row(f);
                let Inverse { takes, of } = (*inverse)?;
                if !takes(value) {
                    return Some(());
                }
                let inverse = of(self, y, value);
                self.solve(a, inverse, s, depth, found)?;
                if *parity == Parity::Even {
                    let minus = self.neg(inverse);
                    self.solve(a, minus, s, depth, found)?;
                }
                if f == Unary::Log {
                    let zero = self.zero();
                    self.solve(a, zero, s, depth, found)?;
                }
                Some(())
            }
            Node::Number(_) | Node::Symbol(_) | Node::Power(..) | Node::Binary(..) | Node::Select(..) => None,
        }
    }
}
