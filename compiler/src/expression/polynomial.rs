//! Expressions as polynomials: affine and quadratic forms, products multiplied out.

use super::{Expr, Node, Number, Pool, Symbol};
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;

/// Coefficients by place in the list of symbols, sorted, none of them 0; and what is free of the symbols.
pub type Affine = (Vec<(usize, Expr)>, Expr);

/// `Σ q_ij s_i s_j` over `i <= j` as sorted triples, the linear coefficients, and what is free of the symbols.
pub type Quadratic = (Vec<(usize, usize, Expr)>, Vec<(usize, Expr)>, Expr);

/// The symbols that count as variables, with their places.
type Places = FxHashMap<Symbol, usize>;

/// A polynomial of degree 2 in the making: the summands of each coefficient.
#[derive(Default)]
struct Parts {
    square: BTreeMap<(usize, usize), Vec<Expr>>,
    linear: BTreeMap<usize, Vec<Expr>>,
    constant: Vec<Expr>,
}

impl Pool {
    /// `e = Σ a_i s_i + b` with coefficients that are free of all the symbols; `None` where `e` is not seen to be that.
    pub fn affine(&mut self, e: Expr, symbols: &[Symbol]) -> Option<Affine> {
        let (square, linear, constant) = self.quadratic_at(e, &places(symbols), 1, 0)?;
        square.is_empty().then_some((linear, constant))
    }

    /// `e = a s + b` with `a` and `b` free of `s`; `None` where `e` is not seen to be that.
    pub fn linear(&mut self, e: Expr, s: Symbol) -> Option<(Expr, Expr)> {
        let (linear, constant) = self.affine(e, &[s])?;
        let slope = linear.first().map_or_else(|| self.zero(), |&(_, a)| a);
        Some((slope, constant))
    }

    /// `e` as a polynomial of degree 2 at most, with coefficients that are free of all the symbols; `None` where it is
    /// not seen to be one.
    pub fn quadratic(&mut self, e: Expr, symbols: &[Symbol]) -> Option<Quadratic> {
        self.quadratic_at(e, &places(symbols), 2, 0)
    }

    /// Goes from the root down and hands each node the sum of what it is multiplied with. Parents come before children,
    /// since ids descend, so that a node is looked at once.
    fn quadratic_at(&mut self, e: Expr, places: &Places, degree: usize, depth: usize) -> Option<Quadratic> {
        let within = |s: Symbol| places.contains_key(&s);
        let mut parts = Parts::default();
        let mut waiting: BTreeMap<Expr, Vec<Expr>> = BTreeMap::new();
        let one = self.one();
        waiting.insert(e, vec![one]);
        while let Some((e, weights)) = waiting.pop_last() {
            let weight = self.sum(&weights);
            if !self.contains_any(e, &within) {
                parts.constant.push(self.mul(weight, e));
                continue;
            }
            match self.node(e).clone() {
                Node::Symbol(s) => parts.linear.entry(*places.get(&s)?).or_default().push(weight),
                Node::Sum(c, terms) => {
                    parts.constant.push(self.scale(weight, c));
                    for &(t, n) in terms.iter() {
                        let scaled = self.scale(weight, n);
                        // most terms are of one symbol: shorten the way for them
                        if let Node::Symbol(s) = self.node(t)
                            && let Some(&i) = places.get(s)
                        {
                            parts.linear.entry(i).or_default().push(scaled);
                        } else {
                            waiting.entry(t).or_default().push(scaled);
                        }
                    }
                }
                Node::Product(c, factors) => {
                    let (inside, outside): (Vec<_>, Vec<_>) =
                        factors.iter().partition(|&&(f, _)| self.contains_any(f, &within));
                    let mut outside: Vec<(Expr, Number)> = outside;
                    outside.push((weight, Number::ONE));
                    let weight = self.powers(&outside);
                    let weight = self.scale(weight, c);
                    match inside[..] {
                        [(f, n)] if n.is_one() => waiting.entry(f).or_default().push(weight),
                        [(f, n)] if n == Number::Ratio(2, 1) && degree == 2 => {
                            let f = self.quadratic_at(f, places, 1, depth)?;
                            self.multiply_into(&mut parts, &f, &f, weight);
                        }
                        [(f, n), (g, m)] if n.is_one() && m.is_one() && degree == 2 => {
                            let (f, g) =
                                (self.quadratic_at(f, places, 1, depth)?, self.quadratic_at(g, places, 1, depth)?);
                            self.multiply_into(&mut parts, &f, &g, weight);
                        }
                        [..] => return None,
                    }
                }
                Node::Select(c, a, b) if depth < self.options.nesting && !self.contains_any(c, &within) => {
                    let a = self.quadratic_at(a, places, degree, depth + 1)?;
                    let b = self.quadratic_at(b, places, degree, depth + 1)?;
                    self.choose_into(&mut parts, c, &a, &b, weight);
                }
                Node::Number(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
                    return None;
                }
            }
        }
        Some(self.finish_parts(parts))
    }

    fn multiply_into(&mut self, parts: &mut Parts, a: &Quadratic, b: &Quadratic, weight: Expr) {
        for &(i, x) in &a.1 {
            for &(j, y) in &b.1 {
                let product = self.product(&[weight, x, y]);
                parts.square.entry((i.min(j), i.max(j))).or_default().push(product);
            }
            parts.linear.entry(i).or_default().push(self.product(&[weight, x, b.2]));
        }
        for &(j, y) in &b.1 {
            parts.linear.entry(j).or_default().push(self.product(&[weight, y, a.2]));
        }
        parts.constant.push(self.product(&[weight, a.2, b.2]));
    }

    fn choose_into(&mut self, parts: &mut Parts, c: Expr, a: &Quadratic, b: &Quadratic, weight: Expr) {
        let zero = self.zero();
        let mut square: BTreeMap<(usize, usize), [Expr; 2]> = BTreeMap::new();
        let mut linear: BTreeMap<usize, [Expr; 2]> = BTreeMap::new();
        for (side, form) in [a, b].into_iter().enumerate() {
            for &(i, j, x) in &form.0 {
                square.entry((i, j)).or_insert([zero; 2])[side] = x;
            }
            for &(i, x) in &form.1 {
                linear.entry(i).or_insert([zero; 2])[side] = x;
            }
        }
        let choose = |pool: &mut Pool, [a, b]: [Expr; 2]| {
            let choice = pool.select(c, a, b);
            pool.mul(weight, choice)
        };
        for (place, pair) in square {
            parts.square.entry(place).or_default().push(choose(self, pair));
        }
        for (place, pair) in linear {
            parts.linear.entry(place).or_default().push(choose(self, pair));
        }
        parts.constant.push(choose(self, [a.2, b.2]));
    }

    fn finish_parts(&mut self, parts: Parts) -> Quadratic {
        let mut square = Vec::with_capacity(parts.square.len());
        for ((i, j), all) in parts.square {
            let x = self.sum(&all);
            if !self.is_zero(x) {
                square.push((i, j, x));
            }
        }
        let mut linear = Vec::with_capacity(parts.linear.len());
        for (i, all) in parts.linear {
            let x = self.sum(&all);
            if !self.is_zero(x) {
                linear.push((i, x));
            }
        }
        let constant = self.sum(&parts.constant);
        (square, linear, constant)
    }

    /// Products of sums and whole powers of sums multiplied out, at the top of the expression. `None` where that has
    /// too many terms or nothing is to be multiplied.
    pub(crate) fn expand(&mut self, e: Expr) -> Option<Expr> {
        let Node::Product(c, factors) = self.node(e).clone() else { return None };
        let is_open = |pool: &Pool, &(f, n): &(Expr, Number)| {
            matches!(pool.node(f), Node::Sum(..)) && n.integer().is_some_and(|n| (1..=16).contains(&n))
        };
        let (open, closed): (Vec<_>, Vec<_>) = factors.iter().partition(|pair| is_open(self, pair));
        if open.is_empty() {
            return None;
        }
        let closed = self.powers(&closed);
        let mut terms = vec![self.scale(closed, c)];
        for (f, n) in open {
            let Node::Sum(c, inner) = self.node(f).clone() else { return None };
            for _ in 0..n.integer()? {
                if terms.len() * (inner.len() + 1) > self.options.product_terms {
                    return None;
                }
                let mut next = Vec::new();
                for &a in &terms {
                    next.push((a, c));
                    for &(t, m) in inner.iter() {
                        next.push((self.mul(a, t), m));
                    }
                }
                let sum = self.combine(&next);
                terms = match self.node(sum).clone() {
                    Node::Sum(c, terms) => {
                        let mut all = vec![self.numeral(c)];
                        all.extend(terms.iter().map(|&(t, n)| self.scale(t, n)));
                        all
                    }
                    Node::Number(_)
                    | Node::Symbol(_)
                    | Node::Product(..)
                    | Node::Power(..)
                    | Node::Unary(..)
                    | Node::Binary(..)
                    | Node::Select(..) => vec![sum],
                };
            }
        }
        Some(self.sum(&terms))
    }
}

fn places(symbols: &[Symbol]) -> Places {
    symbols.iter().enumerate().map(|(i, &s)| (s, i)).collect()
}
