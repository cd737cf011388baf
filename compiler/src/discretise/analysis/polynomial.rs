//! Which energies of a cluster are quadratic, and which expressions are polynomials.

use crate::discretise::cluster::{Cluster, Group};
use crate::expression::{Expr, Node, Number, Pool, Symbol};

/// Whether an expression is linear in some symbols.
pub(crate) fn is_affine(pool: &mut Pool, e: Expr, symbols: &[Symbol]) -> bool {
    pool.affine(e, symbols).is_some()
}

/// Whether an energy is quadratic in its states.
pub(crate) fn is_quadratic(c: &Cluster, pool: &mut Pool, g: &Group) -> bool {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    g.coenergy.iter().all(|z| is_affine(pool, *z, &symbols))
}

/// Whether all energies are.
pub(crate) fn all_quadratic(c: &Cluster, pool: &mut Pool) -> bool {
    c.groups.iter().all(|g| is_quadratic(c, pool, g))
}

/// The degree of a polynomial in the symbols; `None` where it is not seen to be one.
pub(crate) fn degree(pool: &Pool, e: Expr, symbols: &[Symbol]) -> Option<u32> {
    if !pool.contains_any(e, &|s| symbols.contains(&s)) {
        return Some(0);
    }
    match pool.node(e) {
        Node::Symbol(_) => Some(1),
        Node::Sum(_, pairs) => pairs.iter().map(|p| degree(pool, p.0, symbols)).try_fold(0, |m, d| Some(m.max(d?))),
        Node::Product(_, pairs) => pairs.iter().try_fold(0, |sum, (f, n)| match degree(pool, *f, symbols)? {
            0 => Some(sum),
            d => match n {
                Number::Ratio(n, 1) if (1..=16).contains(n) => Some(sum + d * *n as u32),
                Number::Ratio(..) | Number::Float(_) => None,
            },
        }),
        Node::Select(test, a, b) if !pool.contains_any(*test, &|s| symbols.contains(&s)) => {
            Some(degree(pool, *a, symbols)?.max(degree(pool, *b, symbols)?))
        }
        Node::Number(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => None,
    }
}
