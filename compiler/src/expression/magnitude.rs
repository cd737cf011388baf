//! What an expression would come to if nothing in it cancelled: the size that its rounding goes by.

use super::eval::raise;
use super::{Expr, Node, Pool, Symbol};
use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;

impl Pool {
    /// The magnitudes of expressions at one place, where the terms of each sum add up without their signs, an
    /// oscillation has its amplitude, and a choice has the larger of its cases. Two forces that hold one another at
    /// rest so have their size, and not the difference that rounding leaves.
    pub fn magnitudes(&self, all: &[Expr], at: &dyn Fn(Symbol) -> f64) -> Vec<f64> {
        let nodes = self.ascending(all, &|e| self.constant(e).is_none());
        let values = self.eval_all(&nodes, at);
        let value_of: FxHashMap<Expr, f64> = nodes.iter().copied().zip(values).collect();
        let mut found: FxHashMap<Expr, f64> = FxHashMap::default();
        for &e in &nodes {
            let value = |c: Expr| self.constant(c).or_else(|| value_of.get(&c).copied()).unwrap_or(f64::NAN);
            let size = |c: Expr| self.constant(c).map(f64::abs).or_else(|| found.get(&c).copied()).unwrap_or(f64::NAN);
            let x = match self.node(e) {
                Node::Sum(c, terms) => {
                    terms.iter().fold(c.to_f64().abs(), |sum, (t, k)| sum + k.to_f64().abs() * size(*t))
                }
                // What is divided by is there as it is.
                Node::Product(c, factors) => factors.iter().fold(c.to_f64().abs(), |product, &(f, n)| {
                    product * raise(if n.is_negative() { value(f).abs() } else { size(f) }, n)
                }),
                Node::Unary(Unary::Sin | Unary::Cos, _) => 1.0,
                // A function that amplifies, as an exponential, counts where it is.
                Node::Unary(f, a) => {
                    let far = eval::unary(*f, size(*a)).abs();
                    if far <= size(*a).max(1.0) { far } else { value(e).abs() }
                }
                Node::Binary(Binary::Min | Binary::Max, a, b) => size(*a).max(size(*b)),
                Node::Select(_, a, b) => size(*a).max(size(*b)),
                Node::Power(..) | Node::Binary(..) | Node::Number(_) | Node::Symbol(_) => value(e).abs(),
            };
            found.insert(e, x);
        }
        all.iter().map(|e| self.constant(*e).map(f64::abs).or_else(|| found.get(e).copied()).unwrap_or(0.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::expression::{Number, Pool};
    use bond_runtime::ir::{Binary, Unary};

    /// A push and the friction that holds it cancel, and keep their size; so does what swings, at its zero.
    #[test]
    fn what_cancels_keeps_its_size() {
        let mut pool = Pool::new();
        let [t, s] = ["t", "s"].map(|name| pool.symbol(name));
        let (time, slip) = (pool.var(t), pool.var(s));
        let wave = pool.unary(Unary::Sin, time);
        let push = pool.scale(wave, Number::from(3));
        let one = pool.int(1);
        let held = pool.binary(Binary::Min, slip, one);
        let net = pool.sub(push, held);
        let at = |x: crate::expression::Symbol| if x == s { 3.0 } else { 0.0 };
        assert_eq!(pool.magnitudes(&[net, push], &at), [6.0, 3.0]);
    }
}
