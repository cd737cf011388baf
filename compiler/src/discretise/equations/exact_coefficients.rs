//! Exact coefficients, and states with all their digits, for steps without loss: the rounding of a product of
//! coefficients is the same in each step, and so adds up.

use crate::discretise::analysis::polynomial::is_affine;
use crate::discretise::cluster::Cluster;
use crate::discretise::equations::inputs::Inputs;
use crate::expression::{Expr, Lowering, Node, Pool, Symbol};
use crate::model::Model;
use bond_runtime::ir::{Builder, Unary};
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;

/// Numbers as parameters: what they are multiplied with stays a sum.
#[derive(Default)]
pub(crate) struct Slopes(FxHashMap<u64, Symbol>);

impl Slopes {
    fn of(&mut self, pool: &mut Pool, x: f64) -> Expr {
        let s = *self.0.entry(x.to_bits()).or_insert_with(|| pool.parameter(&format!("{x}"), x));
        pool.var(s)
    }
}

/// A gradient as what of it is linear in the symbols, and what is not. The quadrature of the linear part is its value
/// at the node, so that no product of coefficients, which would be rounded, stands for it.
pub(crate) fn split_affine(pool: &mut Pool, e: Expr, symbols: &[Symbol]) -> (Expr, Expr) {
    if is_affine(pool, e, symbols) {
        return (e, pool.zero());
    }
    let Node::Sum(constant, terms) = pool.node(e).clone() else { return (pool.zero(), e) };
    let (straight, bent): (Vec<_>, Vec<_>) = terms.iter().partition(|t| is_affine(pool, t.0, symbols));
    let (constant, straight) = (pool.numeral(constant), pool.combine(&straight));
    (pool.add(constant, straight), pool.combine(&bent))
}

/// What is linear in the symbols with its slopes as parameters, one a number: they are multiplied with what a state is
/// at a node, and not with each of the coefficients that make it up.
pub(crate) fn with_parameters(pool: &mut Pool, e: Expr, symbols: &[Symbol], slopes: &mut Slopes) -> Expr {
    let Some((linear, constant)) = pool.affine(e, symbols) else { return e };
    let mut terms = vec![constant];
    for (i, slope) in linear {
        let slope = match pool.constant(slope) {
            Some(x) => slopes.of(pool, x),
            None => slope,
        };
        let state = pool.var(symbols[i]);
        terms.push(pool.mul(slope, state));
    }
    pool.sum(&terms)
}

/// Adds the compensation term to each state in some expressions, except inside sine and cosine (see
/// [`super::angle_addition`]): the rounding of half a change beside a state follows from its last digits, and these
/// from the step's length, which may be a number such as 0.1 whose products end alike. For the same reason the
/// coefficient of a state multiplies the state in the middle of the step, and not the state and its change separately.
pub(crate) fn compensated(
    c: &Cluster,
    model: &mut Model,
    b: &mut Builder,
    lowering: &mut Lowering,
    inputs: &Inputs,
    all: &mut [Expr],
) {
    let mut whole = FxHashMap::default();
    for (s, slot) in c.states.iter().zip(&inputs.carries) {
        let carry = model.pool.symbol(&format!("carry({})", s.name));
        let value = b.load(*slot);
        lowering.bind(carry, value);
        let (x, carry) = (model.pool.var(s.symbol), model.pool.var(carry));
        whole.insert(x, model.pool.add(x, carry));
    }
    lowering.last(c.states.iter().map(|s| s.symbol));
    let pool = &mut model.pool;
    let mut slopes = Slopes::default();
    let symbols = c.states.iter().map(|s| s.symbol).chain(c.delta.iter().copied());
    let places: FxHashMap<Symbol, usize> = symbols.zip(0..).collect();
    for e in pool.ascending(all, &|e| !matches!(pool.node(e), Node::Unary(Unary::Sin | Unary::Cos, _))) {
        let new = match whole.get(&e) {
            Some(new) => *new,
            None => {
                let gathered = middles(c, pool, e, (&places, &whole), &mut slopes);
                gathered.unwrap_or_else(|| pool.rebuild(e, &|c| whole.get(&c).copied().unwrap_or(c)))
            }
        };
        whole.insert(e, new);
    }
    all.iter_mut().for_each(|e| *e = whole.get(e).copied().unwrap_or(*e));
}

/// A sum with numbers times states and half their changes as these times what the states are in the middle; None of
/// others.
fn middles(
    c: &Cluster,
    pool: &mut Pool,
    e: Expr,
    (places, whole): (&FxHashMap<Symbol, usize>, &FxHashMap<Expr, Expr>),
    slopes: &mut Slopes,
) -> Option<Expr> {
    let Node::Sum(constant, terms) = pool.node(e).clone() else { return None };
    // Where numbers times symbols stand, by the places of these: states first, then changes.
    let mut of: BTreeMap<usize, (usize, f64)> = BTreeMap::new();
    for (at, (t, n)) in terms.iter().enumerate() {
        if let Some((place, slope)) = number_of(pool, *t, places) {
            of.insert(place, (at, slope * n.to_f64()));
        }
    }
    let mut taken = vec![false; terms.len()];
    let mut parts = vec![pool.numeral(constant)];
    for (&k, &(at, slope)) in of.range(..c.states.len()) {
        let Some(&(by, half)) = of.get(&(c.states.len() + k)) else { continue };
        if half + half != slope || slope.abs() == 1.0 {
            continue;
        }
        (taken[at], taken[by]) = (true, true);
        let (x, d, two) = (pool.var(c.states[k].symbol), pool.var(c.delta[k]), pool.ratio(1, 2));
        let (x, d) = (whole.get(&x).copied().unwrap_or(x), pool.mul(two, d));
        let middle = pool.add(x, d);
        let slope = slopes.of(pool, slope);
        parts.push(pool.mul(slope, middle));
    }
    if taken.iter().all(|taken| !taken) {
        return None;
    }
    for ((t, n), _) in terms.iter().zip(&taken).filter(|(_, taken)| !**taken) {
        let t = whole.get(t).copied().unwrap_or(*t);
        parts.push(pool.scale(t, *n));
    }
    Some(pool.sum(&parts))
}

/// The place of the one symbol that an expression is a number of, and the number.
fn number_of(pool: &mut Pool, e: Expr, places: &FxHashMap<Symbol, usize>) -> Option<(usize, f64)> {
    let symbol = match pool.node(e) {
        Node::Symbol(s) => *s,
        Node::Product(_, factors) => factors.iter().find_map(|(f, _)| match pool.node(*f) {
            Node::Symbol(s) if places.contains_key(s) => Some(*s),
            _ => None,
        })?,
        _ => return None,
    };
    let place = *places.get(&symbol)?;
    let (slope, rest) = pool.linear(e, symbol)?;
    let slope = pool.constant(slope)?;
    pool.is_zero(rest).then_some((place, slope))
}
