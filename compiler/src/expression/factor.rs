//! Sums in which what terms have in common is written once: `a x + b x = (a + b) x`.

use super::{Expr, Node, Number, Pool, Symbol};
use rustc_hash::{FxHashMap, FxHashSet};

/// A number times factors.
type Term = (Number, Vec<(Expr, Number)>);

impl Pool {
    /// The expressions with fewer operations one after the other: of each sum in them the factor that most terms have
    /// is taken out, and so on within and beside; the same but for rounding. Only factors with these variables count:
    /// others are no work where these alone change. With `within`, what is in the list itself stays a sum.
    pub fn factored(&mut self, all: &[Expr], variables: &FxHashSet<Symbol>, within: bool) -> Vec<Expr> {
        let mut new: FxHashMap<Expr, Expr> = FxHashMap::default();
        for e in self.ascending(all, &|_| true) {
            let rebuilt = self.rebuild(e, &|c| new.get(&c).copied().unwrap_or(c));
            let whole = within && all.contains(&e);
            let factored = if whole { rebuilt } else { self.gather(rebuilt, variables) };
            new.insert(e, factored);
        }
        all.iter().map(|e| new.get(e).copied().unwrap_or(*e)).collect()
    }

    /// A sum in factors; other expressions as they are.
    fn gather(&mut self, e: Expr, variables: &FxHashSet<Symbol>) -> Expr {
        let Node::Sum(constant, terms) = self.node(e).clone() else { return e };
        if terms.len() > self.options.terms {
            return e;
        }
        let mut rest: Vec<Term> = terms.iter().map(|&(t, n)| (n, self.factors(t))).collect();
        let mut done: Vec<(Expr, Number)> = Vec::new();
        while let Some(common) = self.commonest(&rest, variables) {
            let (group, others) = rest.into_iter().partition(|(_, t)| exponent(t, common).is_positive());
            rest = others;
            done.push((self.out(group, variables), Number::ONE));
        }
        if done.is_empty() {
            return e;
        }
        for (n, factors) in rest {
            done.push((self.powers(&factors), n));
        }
        done.push((self.numeral(constant), Number::ONE));
        self.combine(&done)
    }

    /// The factors of a term.
    fn factors(&self, t: Expr) -> Vec<(Expr, Number)> {
        match self.node(t) {
            Node::Product(c, factors) if c.is_one() => factors.to_vec(),
            _ => vec![(t, Number::ONE)],
        }
    }

    /// The factor of most terms, of two at least; the oldest of several.
    fn commonest(&self, terms: &[Term], variables: &FxHashSet<Symbol>) -> Option<Expr> {
        let mut factors: Vec<Expr> =
            terms.iter().flat_map(|t| &t.1).filter(|(_, n)| n.is_positive()).map(|(f, _)| *f).collect();
        factors.sort_unstable();
        let mut best: Option<(Expr, usize)> = None;
        for same in factors.chunk_by(|a, b| a == b) {
            let f = same[0];
            if same.len() > best.map_or(1, |b| b.1) && self.contains_any(f, &|s| variables.contains(&s)) {
                best = Some((f, same.len()));
            }
        }
        best.map(|b| b.0)
    }

    /// The sum of terms that have a factor in common, as a product.
    fn out(&mut self, mut group: Vec<Term>, variables: &FxHashSet<Symbol>) -> Expr {
        let mut product: Vec<(Expr, Number)> = group.first().map(|t| t.1.clone()).unwrap_or_default();
        for (f, n) in &mut product {
            *n = group.iter().map(|(_, t)| exponent(t, *f)).fold(*n, |a, b| if b.compare(a).is_lt() { b } else { a });
        }
        product.retain(|(f, n)| n.is_positive() && self.contains_any(*f, &|s| variables.contains(&s)));
        let mut inner = Vec::with_capacity(group.len());
        for (n, factors) in &mut group {
            for (f, m) in factors.iter_mut() {
                *m = *m + -exponent(&product, *f);
            }
            factors.retain(|(_, m)| !m.is_zero());
            inner.push((self.powers(factors), *n));
        }
        let inner = self.combine(&inner);
        product.push((self.gather(inner, variables), Number::ONE));
        self.powers(&product)
    }
}

/// The exponent of a factor; 0 where it is none.
fn exponent(factors: &[(Expr, Number)], f: Expr) -> Number {
    factors.iter().find(|x| x.0 == f).map_or(Number::ZERO, |x| x.1)
}
