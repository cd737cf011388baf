//! Ways through the graph of an expression, none of them recursive.

use super::{Expr, Node, Pool, Symbol};
use rustc_hash::FxHashSet;

/// So many expressions are looked through one by one.
const FEW: usize = 32;

/// Expressions in order of finding, each once.
#[derive(Default)]
pub(super) struct Found {
    /// In order.
    pub(super) all: Vec<Expr>,
    /// The same, where they are many.
    many: FxHashSet<Expr>,
}

impl Found {
    /// Adds one; whether it is new.
    pub(super) fn add(&mut self, e: Expr) -> bool {
        let is_new = if self.many.is_empty() { !self.all.contains(&e) } else { self.many.insert(e) };
        if is_new {
            self.all.push(e);
            if self.all.len() == FEW {
                self.many.extend(&self.all);
            }
        }
        is_new
    }
}

impl Pool {
    /// The variables that occur, sorted; parameters are not among them.
    pub fn symbols(&self, e: Expr) -> Vec<Symbol> {
        if let Some(few) = self.variables.few(e) {
            return few.to_vec();
        }
        let mut all = FxHashSet::default();
        self.walk(e, &mut |pool, e| match pool.variables.few(e) {
            Some(few) => {
                all.extend(few.iter().copied());
                false
            }
            None => true,
        });
        let mut all: Vec<Symbol> = all.into_iter().collect();
        all.sort_unstable();
        all
    }

    /// Whether a variable occurs.
    pub fn contains(&self, e: Expr, s: Symbol) -> bool {
        self.contains_any(e, &|x| x == s)
    }

    /// Whether any of the variables occurs.
    pub fn contains_any(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> bool {
        let mut found = false;
        self.walk(e, &mut |pool, e| match pool.variables.few(e) {
            Some(few) => {
                found |= few.iter().any(|&s| in_set(s));
                false
            }
            None => !found,
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
        let mut seen = Found::default();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            self.node(e).each_child(&mut |c| {
                if seen.add(c) && enter(self, c) {
                    stack.push(c);
                }
            });
        }
    }

    /// The nodes reachable from `roots` over nodes that `enter` admits, in ascending order: children before parents.
    pub(crate) fn ascending(&self, roots: &[Expr], enter: &dyn Fn(Expr) -> bool) -> Vec<Expr> {
        let mut found = Found::default();
        for &e in roots {
            if enter(e) {
                found.add(e);
            }
        }
        let mut at = 0;
        while let Some(&e) = found.all.get(at) {
            at += 1;
            self.node(e).each_child(&mut |c| {
                if enter(c) {
                    found.add(c);
                }
            });
        }
        found.all.sort_unstable();
        found.all
    }

    /// Whether a variable of the set occurs, as far as can be told at once: never false where one does.
    pub(super) fn may_contain(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> bool {
        self.variables.few(e).is_none_or(|few| few.iter().any(|&s| in_set(s)))
    }

    /// The nodes below `e` (itself included) in which a variable of the set occurs, in ascending order.
    ///
    /// Takes time in proportion to the nodes reachable from `e`.
    pub(crate) fn dependents(&self, e: Expr, in_set: &dyn Fn(Symbol) -> bool) -> Vec<Expr> {
        let candidates = self.ascending(&[e], &|e| self.may_contain(e, in_set));
        if self.variables.few(e).is_some() {
            return candidates;
        }
        let mut yes = FxHashSet::default();
        candidates
            .into_iter()
            .filter(|&e| {
                let mut depends = self.variables.few(e).is_some();
                if !depends {
                    self.node(e).each_child(&mut |c| depends |= yes.contains(&c));
                }
                if depends {
                    yes.insert(e);
                }
                depends
            })
            .collect()
    }
}
