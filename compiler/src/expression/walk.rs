//! Ways through the graph of an expression, none of them recursive.

use super::pool::Support;
use super::{Expr, Node, Pool, Symbol};
use rustc_hash::FxHashSet;

impl Pool {
    /// The variables that occur, sorted; parameters are not among them.
    pub fn symbols(&self, e: Expr) -> Vec<Symbol> {
        let mut all = FxHashSet::default();
        self.walk(e, &mut |pool, e| match &pool.support[e.0 as usize] {
            Support::Few(few) => {
                all.extend(few.iter().copied());
                false
            }
            Support::Many => true,
        });
        let mut all: Vec<Symbol> = all.into_iter().collect();
        all.sort_unstable();
        all
    }

    /// Whether a variable occurs.
    pub fn contains(&self, e: Expr, s: Symbol) -> bool {
        let mut found = false;
        self.walk(e, &mut |pool, e| match &pool.support[e.0 as usize] {
            Support::Few(few) => {
                found |= few.contains(&s);
                false
            }
            Support::Many => !found,
        });
        found
    }

    /// Whether any of the variables occurs.
    pub fn contains_any(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> bool {
        let mut found = false;
        self.walk(e, &mut |pool, e| match &pool.support[e.0 as usize] {
            Support::Few(few) => {
                found |= few.iter().any(|&s| in_set(s));
                false
            }
            Support::Many => !found,
        });
        found
    }

    /// Whether any node is such a one.
    pub fn any_node(&self, e: Expr, is: &dyn Fn(&Node) -> bool) -> bool {
        let mut found = false;
        self.walk(e, &mut |pool, e| {
            found |= is(pool.node(e));
            !found
        });
        found
    }

    /// Visits each node once, parents first; goes below a node where `enter` says so.
    fn walk(&self, e: Expr, enter: &mut dyn FnMut(&Pool, Expr) -> bool) {
        if !enter(self, e) {
            return;
        }
        let mut seen = FxHashSet::default();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            self.node(e).each_child(&mut |c| {
                if seen.insert(c) && enter(self, c) {
                    stack.push(c);
                }
            });
        }
    }

    /// The nodes reachable from `roots` over nodes that `enter` admits, in ascending order: children before parents.
    pub(super) fn ascending(&self, roots: &[Expr], enter: &dyn Fn(Expr) -> bool) -> Vec<Expr> {
        let mut seen = FxHashSet::default();
        let mut stack = Vec::new();
        for &e in roots {
            if enter(e) && seen.insert(e) {
                stack.push(e);
            }
        }
        let mut all = stack.clone();
        while let Some(e) = stack.pop() {
            self.node(e).each_child(&mut |c| {
                if enter(c) && seen.insert(c) {
                    stack.push(c);
                    all.push(c);
                }
            });
        }
        all.sort_unstable();
        all
    }

    /// Whether a variable of the set occurs, as far as can be told at once: never false where one does.
    pub(super) fn may_contain(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> bool {
        match &self.support[e.0 as usize] {
            Support::Few(few) => few.iter().any(|&s| in_set(s)),
            Support::Many => true,
        }
    }

    /// The nodes below `e` (itself included) in which a variable of the set occurs, in ascending order.
    ///
    /// Takes time in proportion to the nodes reachable from `e`.
    pub(super) fn dependents(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> Vec<Expr> {
        let candidates = self.ascending(&[e], &|e| self.may_contain(e, in_set));
        let mut yes = FxHashSet::default();
        candidates
            .into_iter()
            .filter(|&e| {
                let depends = match &self.support[e.0 as usize] {
                    Support::Few(_) => true,
                    Support::Many => {
                        let mut any = false;
                        self.node(e).each_child(&mut |c| any |= yes.contains(&c));
                        any
                    }
                };
                if depends {
                    yes.insert(e);
                }
                depends
            })
            .collect()
    }
}
