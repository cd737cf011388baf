//! Where along one symbol expressions change their character: a law is looked at in ratio to these places, so that it
//! is seen the same in any units.

use super::{Expr, Node, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};

/// The largest and smallest power of four to which places are looked for, on both sides of 0.
const POWERS: i32 = 66;
/// Expressions that are looked at for places.
const MAX_WATCHED: usize = 64;
/// Halvings between two of them: to the last bit.
const HALVINGS: usize = 56;

/// So many times an expression, and what it is compared with.
type Pair = (f64, Expr, Option<Expr>);

/// Where expressions change their character.
#[derive(Clone, Debug, Default)]
pub struct Landmarks {
    /// Where choices switch, ascending.
    pub breaks: Vec<f64>,
    /// Where functions leave the size of 1 and terms of a sum are of one size, ascending.
    pub knees: Vec<f64>,
}

impl Landmarks {
    /// Distances from 0 of the places on one side of it, ascending; of the other side's where there are none.
    fn sizes(&self, side: f64) -> Vec<f64> {
        let all = || self.breaks.iter().chain(&self.knees).filter(|x| **x != 0.0);
        let mut own: Vec<f64> = all().map(|x| x * side).filter(|x| *x > 0.0).collect();
        if own.is_empty() {
            own = all().map(|x| x.abs()).collect();
        }
        own.sort_by(f64::total_cmp);
        own.dedup();
        own
    }

    /// So near to 0 that nothing lies between. What has no places is alike everywhere.
    pub fn rest(&self) -> f64 {
        NEAR * self.extent()[0]
    }

    /// Well within the nearest place, and still no nearer to 0 than it has to be: a root has no slope at 0.
    pub fn within(&self) -> f64 {
        self.extent()[0] / BEYOND[0]
    }

    /// Distances from 0 of the nearest place and of the farthest; 1 where there is none.
    pub fn extent(&self) -> [f64; 2] {
        let mut sizes = [self.sizes(1.0), self.sizes(-1.0)].concat();
        sizes.sort_by(f64::total_cmp);
        [sizes.first(), sizes.last()].map(|x| x.copied().unwrap_or(1.0))
    }

    /// Points on both sides of 0: one between each two places, and some at wider and wider distances beyond all.
    pub fn points(&self) -> Vec<f64> {
        let mut points = Vec::new();
        for side in [1.0, -1.0] {
            let sizes = self.sizes(side);
            let (first, last) = (sizes.first().copied().unwrap_or(1.0), sizes.last().copied().unwrap_or(1.0));
            let between = sizes.windows(2).map(|w| w[0].sqrt() * w[1].sqrt());
            let beyond = BEYOND.into_iter().flat_map(|far| [first / far, last * far]);
            points.extend(between.chain(beyond).map(|x| side * x));
        }
        points
    }

    /// Points just beside each break, on both sides of it.
    pub fn beside_breaks(&self) -> Vec<[f64; 2]> {
        let rest = self.rest();
        let beside = |x: &f64| if *x == 0.0 { rest } else { NEAR * x.abs() };
        self.breaks.iter().map(|x| [x - beside(x), x + beside(x)]).collect()
    }
}

/// A part of a place that is beside it, and of the nearest one that is at rest.
const NEAR: f64 = 1.0 / 1_048_576.0;
/// How far beyond the outermost places, and within the innermost ones, points lie.
const BEYOND: [f64; 3] = [16.0, 1024.0, 1_048_576.0];

impl Pool {
    /// Where expressions change their character along `z`; other symbols have the values that `at` gives them.
    pub fn landmarks(&self, list: &[Expr], z: Symbol, at: &dyn Fn(Symbol) -> f64) -> Landmarks {
        let nodes = self.ascending(list, &|e| self.contains(e, z));
        // What is 0 at a break; what is of the size of what at a knee.
        let (mut zeros, mut pairs): (Vec<Pair>, Vec<Pair>) = (Vec::new(), Vec::new());
        for e in nodes.into_iter().filter(|e| self.contains(*e, z)) {
            match self.node(e) {
                Node::Binary(Binary::Lt | Binary::Le | Binary::Min | Binary::Max, a, b) => {
                    zeros.push((1.0, *a, Some(*b)))
                }
                Node::Unary(Unary::Abs | Unary::Sign, a) => zeros.push((1.0, *a, None)),
                Node::Unary(Unary::Not | Unary::Floor, _) => {}
                Node::Unary(_, a) => pairs.push((1.0, *a, None)),
                Node::Sum(c, terms) => {
                    let moves = terms.iter().filter(|t| self.contains(t.0, z));
                    if terms.len() > 1 || !c.is_zero() {
                        pairs.extend(moves.map(|(t, k)| (2.0 * k.to_f64(), *t, Some(e))));
                    }
                }
                Node::Binary(..) | Node::Number(_) | Node::Symbol(_) => {}
                Node::Product(..) | Node::Power(..) | Node::Select(..) => {}
            }
        }
        zeros.truncate(MAX_WATCHED);
        pairs.truncate(MAX_WATCHED);
        Landmarks { breaks: self.changes(&zeros, z, at, false), knees: self.changes(&pairs, z, at, true) }
    }

    /// Where some times an expression is another one, or 0; of `sizes`, where it is of the size of that, or of 1.
    fn changes(&self, pairs: &[Pair], z: Symbol, at: &dyn Fn(Symbol) -> f64, sizes: bool) -> Vec<f64> {
        if pairs.is_empty() {
            return Vec::new();
        }
        let all: Vec<Expr> = pairs.iter().flat_map(|(_, a, b)| [Some(*a), *b]).flatten().collect();
        let values = |all: &[Expr], x: f64| self.eval_all(all, &|s| if s == z { x } else { at(s) });
        let off = |a: f64, b: Option<f64>| if sizes { a.abs() - b.unwrap_or(1.0).abs() } else { a - b.unwrap_or(0.0) };
        let looked = |x: f64| {
            let mut list = values(&all, x).into_iter();
            let mut of = |(k, _, b): &Pair| {
                let a = k * list.next().unwrap_or(f64::NAN);
                off(a, b.and_then(|_| list.next()))
            };
            pairs.iter().map(&mut of).collect::<Vec<f64>>()
        };
        let one = |i: usize, x: f64| {
            let (k, a, b) = pairs[i];
            let list = values(&[Some(a), b].into_iter().flatten().collect::<Vec<_>>(), x);
            off(k * list[0], b.map(|_| list[1]))
        };
        let mut places = Vec::new();
        if !sizes {
            places.extend(looked(0.0).iter().filter(|x| **x == 0.0).map(|_| 0.0));
        }
        for side in [1.0, -1.0] {
            let mut last: Option<(f64, Vec<f64>)> = None;
            for x in (-POWERS..=POWERS).map(|k| side * libm::exp2(2.0 * f64::from(k))) {
                let here = looked(x);
                if let Some((before, values)) = &last {
                    for i in (0..pairs.len()).filter(|i| values[*i] * here[*i] < 0.0 || here[*i] == 0.0) {
                        let (mut low, mut high) = (*before, x);
                        for _ in 0..HALVINGS {
                            let middle = 0.5 * (low + high);
                            let same = one(i, middle) * values[i] > 0.0;
                            (low, high) = if same { (middle, high) } else { (low, middle) };
                        }
                        places.push(high);
                    }
                }
                last = Some((x, here));
            }
        }
        places.sort_by(f64::total_cmp);
        places.dedup();
        places
    }
}

#[cfg(test)]
mod tests {
    use crate::expression::{Number, Pool};
    use bond_runtime::ir::{Binary, Unary};

    /// The same law in units a thousand times as large has its places a thousand times as near.
    #[test]
    fn places_go_with_the_units() {
        for unit in [1_i32, 1000] {
            let mut pool = Pool::new();
            let z = pool.symbol("z");
            let x = pool.var(z);
            let edge = pool.numeral(Number::ratio(3, i64::from(unit)));
            let test = pool.binary(Binary::Lt, x, edge);
            let scaled = pool.scale(x, Number::from(i64::from(unit)));
            let (curved, zero) = (pool.unary(Unary::Tanh, scaled), pool.zero());
            let law = pool.select(test, curved, zero);
            let found = pool.landmarks(&[law], z, &|_| 0.0);
            let close = |x: f64, y: f64| (x * f64::from(unit) / y - 1.0).abs() < 1e-12;
            assert!(found.breaks.len() == 1 && close(found.breaks[0], 3.0), "{:?}", found.breaks);
            assert!(found.knees.iter().any(|x| close(*x, 1.0)), "{:?}", found.knees);
        }
    }
}
