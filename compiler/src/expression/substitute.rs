//! Replacing symbols.

use super::{Expr, Node, Pool, Symbol};
use rustc_hash::FxHashMap;

impl Pool {
    /// The expression with symbols replaced, all at once.
    pub fn substitute(&mut self, e: Expr, map: &FxHashMap<Symbol, Expr>) -> Expr {
        let mut memo = FxHashMap::default();
        self.substitute_with(&mut memo, e, map)
    }

    /// The expressions with symbols replaced, all at once; what they share is walked once.
    pub fn substitute_all(&mut self, all: &[Expr], map: &FxHashMap<Symbol, Expr>) -> Vec<Expr> {
        let mut memo = FxHashMap::default();
        all.iter().map(|&e| self.substitute_with(&mut memo, e, map)).collect()
    }

    /// The same with a memory that may be used again with the same map.
    pub(super) fn substitute_with(
        &mut self,
        memo: &mut FxHashMap<Expr, Expr>,
        e: Expr,
        map: &FxHashMap<Symbol, Expr>,
    ) -> Expr {
        if let Some(&known) = memo.get(&e) {
            return known;
        }
        // parameters are in no list of variables, so that a map that has one walks everything
        let everything = self.has_parameter(map);
        let changes = |s: Symbol| map.contains_key(&s);
        let nodes = self.ascending(&[e], &|e| !memo.contains_key(&e) && (everything || self.may_contain(e, &changes)));
        for e in nodes {
            let new = match self.node(e) {
                Node::Symbol(s) => map.get(s).copied().unwrap_or(e),
                Node::Number(_)
                | Node::Sum(..)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => self.rebuild(e, &|c| memo.get(&c).copied().unwrap_or(c)),
            };
            memo.insert(e, new);
        }
        memo.get(&e).copied().unwrap_or(e)
    }

    /// The node with other children.
    pub(super) fn rebuild(&mut self, e: Expr, child: &dyn Fn(Expr) -> Expr) -> Expr {
        match self.node(e).clone() {
            Node::Number(_) | Node::Symbol(_) => e,
            Node::Sum(c, terms) => {
                let mut all: Vec<_> = terms.iter().map(|&(t, n)| (child(t), n)).collect();
                let c = self.numeral(c);
                all.push((c, super::Number::ONE));
                self.combine(&all)
            }
            Node::Product(c, factors) => {
                let mut all: Vec<_> = Vec::with_capacity(factors.len());
                for &(f, n) in factors.iter() {
                    all.push((self.power(child(f), n), super::Number::ONE));
                }
                let product = self.powers(&all);
                self.scale(product, c)
            }
            Node::Power(a, b) => self.pow(child(a), child(b)),
            Node::Unary(f, a) => self.unary(f, child(a)),
            Node::Binary(f, a, b) => self.binary(f, child(a), child(b)),
            Node::Select(c, a, b) => self.select(child(c), child(a), child(b)),
        }
    }
}
