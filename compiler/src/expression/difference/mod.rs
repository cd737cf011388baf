//! Divided differences without cancellation: the discrete gradients of energies.

mod across;
mod along;
mod function;
mod power;

use super::unary::row;
use super::{Expr, Node, Number, Pool, Symbol};
pub(super) use along::{Along, Step};
use bond_runtime::ir::{Binary, Unary};

const TWO: Number = Number::Ratio(2, 1);
/// The square of what is smaller may be 0.
const NOTHING: f64 = 1e-100;

/// Whether this is a power beyond a square, or with a broken exponent.
fn is_steep(n: &Node) -> bool {
    matches!(n, Node::Product(_, factors) if factors.iter().any(|f| !matches!(f.1, Number::Ratio(..=2, 1))))
}

/// Nodes in ascending order, and the first of them along the step.
struct Ways {
    nodes: Vec<Expr>,
    along: Vec<Along>,
}

impl Ways {
    fn get(&self, e: Expr) -> Option<Along> {
        self.nodes[..self.along.len()].binary_search(&e).ok().map(|i| self.along[i])
    }
}

impl Pool {
    /// `(e[s := from + delta] - e[s := from]) / delta`, without cancellation, and the derivative where `delta` is 0.
    ///
    /// Sums, products, powers and the smooth functions by their own addition formulas; a choice by the difference of
    /// the branch where both ends take the same one, across a single threshold by the pieces on its sides, else by the
    /// quotient; steps such as `sign` by the quotient. An angle `atan2(y, x)` is taken the short way round, without a
    /// jump.
    pub fn difference(&mut self, e: Expr, s: Symbol, from: Expr, delta: Expr) -> Expr {
        let half = self.scale(delta, Number::HALF);
        let to = self.add(from, delta);
        let middle = self.add(from, half);
        let step = Step { symbol: s, from, to, delta, middle };
        let mut ways = Ways { nodes: self.dependents(e, &|x| x == s), along: Vec::new() };
        for i in 0..ways.nodes.len() {
            let node = ways.nodes[i];
            let ends = match self.node(node) {
                Node::Symbol(_) => (from, to),
                Node::Number(_)
                | Node::Sum(..)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => (
                    self.rebuild(node, &|c| ways.get(c).map_or(c, |along| along.from)),
                    self.rebuild(node, &|c| ways.get(c).map_or(c, |along| along.to)),
                ),
            };
            let slope = self.difference_of(node, &step, ends.0, ends.1, &ways);
            ways.along.push(Along { from: ends.0, to: ends.1, slope });
        }
        ways.get(e).map_or_else(|| self.zero(), |along| along.slope)
    }

    /// The divided difference of a node whose children's are known.
    fn difference_of(&mut self, e: Expr, step: &Step, from: Expr, to: Expr, known: &Ways) -> Expr {
        let zero = self.zero();
        let along = |e: Expr| known.get(e).unwrap_or(Along { from: e, to: e, slope: zero });
        match self.node(e).clone() {
            Node::Number(_) => zero,
            Node::Symbol(_) => self.one(),
            Node::Sum(_, terms) => {
                let all: Vec<_> = terms.iter().map(|&(t, n)| (along(t).slope, n)).collect();
                self.combine(&all)
            }
            Node::Product(c, factors) => {
                let (inside, outside): (Vec<_>, Vec<_>) = factors.iter().partition(|(f, _)| known.get(*f).is_some());
                let mut total: Option<Along> = None;
                for (f, n) in inside {
                    let base = along(f);
                    let power = self.along_power(base, n, step);
                    total = Some(match total {
                        None => power,
                        Some(other) => self.along_product(other, power),
                    });
                }
                let slope = total.map_or(zero, |t| t.slope);
                let outside = self.powers(&outside);
                let slope = self.mul(outside, slope);
                self.scale(slope, c)
            }
            Node::Power(a, b) => self.along_general_power(e, (along(a), along(b)), (from, to), step),
            Node::Unary(f, a) => (row(f).difference)(self, along(a), Along { from, to, slope: zero }, step),
            Node::Binary(f, a, b) => self.along_binary(f, along(a), along(b), (from, to), step),
            Node::Select(condition, then, otherwise) => {
                let (c, a, b) = (along(condition), along(then), along(otherwise));
                if c.from == c.to {
                    return self.select(c.from, a.slope, b.slope);
                }
                let slope = match self.across((condition, then, otherwise), step) {
                    Some(across) => self.along_threshold((c.from, c.to), (a, b), across, step),
                    None => self.along_choice((c.from, c.to), a, b, step),
                };
                if self.any_node(e, &is_steep) {
                    self.beyond_nothing((e, step.symbol), slope, step.from, step.delta)
                } else {
                    slope
                }
            }
        }
    }

    /// A divided difference; over next to nothing, where the slopes of quotients are none, the derivative at the start.
    /// A row of bodies that touch moves its last ones by such: each contact passes on a power of what the one before
    /// does.
    pub(crate) fn beyond_nothing(&mut self, (e, s): (Expr, Symbol), slope: Expr, from: Expr, delta: Expr) -> Expr {
        let derivative = self.derivative(e, s);
        let start = [(s, from)].into_iter().collect();
        let derivative = self.substitute(derivative, &start);
        let (size, nothing) = (self.unary(Unary::Abs, delta), self.float(NOTHING));
        let moves = self.binary(Binary::Lt, nothing, size);
        self.select(moves, slope, derivative)
    }

    /// A choice whose condition may change within the step.
    fn along_choice(&mut self, (start, end): (Expr, Expr), a: Along, b: Along, step: &Step) -> Expr {
        let down = self.sub(b.to, a.from);
        let down = self.div(down, step.delta);
        let up = self.sub(a.to, b.from);
        let up = self.div(up, step.delta);
        let held = self.select(end, a.slope, down);
        let free = self.select(end, up, b.slope);
        self.select(start, held, free)
    }

    /// `slope * delta`, the change without cancellation.
    fn change(&mut self, y: Along, step: &Step) -> Expr {
        self.mul(y.slope, step.delta)
    }

    fn mean(&mut self, y: Along) -> Expr {
        self.combine(&[(y.from, Number::HALF), (y.to, Number::HALF)])
    }

    fn along_product(&mut self, a: Along, b: Along) -> Along {
        let (mean_a, mean_b) = (self.mean(a), self.mean(b));
        let left = self.mul(a.slope, mean_b);
        let right = self.mul(mean_a, b.slope);
        Along { from: self.mul(a.from, b.from), to: self.mul(a.to, b.to), slope: self.add(left, right) }
    }

    fn half_change(&mut self, y: Along, step: &Step) -> Expr {
        let change = self.change(y, step);
        self.scale(change, Number::HALF)
    }
}
