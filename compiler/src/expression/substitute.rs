//! Replacing symbols.

use super::{Expr, Node, Pool, Symbol};
use rustc_hash::FxHashMap;

impl Pool {
    /// The expression with symbols replaced, all at once.
    pub fn substitute(&mut self, e: Expr, map: &FxHashMap<Symbol, Expr>) -> Expr {
        let nodes = self.changing(e, map, &|_| true);
        let mut new: Vec<Expr> = Vec::with_capacity(nodes.len());
        for &e in &nodes {
            let child = |c: Expr| nodes[..new.len()].binary_search(&c).map_or(c, |i| new[i]);
            let changed = self.replaced(e, map, &child);
            new.push(changed);
        }
        // The whole is younger than its parts.
        new.last().copied().unwrap_or(e)
    }

    /// The nodes below `e` that may change, in ascending order.
    fn changing(&self, e: Expr, map: &FxHashMap<Symbol, Expr>, enter: &dyn Fn(Expr) -> bool) -> Vec<Expr> {
        // Parameters are in no list of variables, so that a map that has one walks everything.
        let everything = self.has_parameter(e, map);
        let changes = |s: Symbol| map.contains_key(&s);
        self.ascending(&[e], &|e| enter(e) && (everything || self.may_contain(e, &changes)))
    }

    /// A node whose children are replaced.
    fn replaced(&mut self, e: Expr, map: &FxHashMap<Symbol, Expr>, child: &dyn Fn(Expr) -> Expr) -> Expr {
        match self.node(e) {
            Node::Symbol(s) => map.get(s).copied().unwrap_or(e),
            Node::Number(_)
            | Node::Sum(..)
            | Node::Product(..)
            | Node::Power(..)
            | Node::Unary(..)
            | Node::Binary(..)
            | Node::Select(..) => self.rebuild(e, child),
        }
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
        for e in self.changing(e, map, &|e| !memo.contains_key(&e)) {
            let new = self.replaced(e, map, &|c| memo.get(&c).copied().unwrap_or(c));
            memo.insert(e, new);
        }
        memo.get(&e).copied().unwrap_or(e)
    }

    /// The node with other children.
    pub(crate) fn rebuild(&mut self, e: Expr, child: &dyn Fn(Expr) -> Expr) -> Expr {
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
