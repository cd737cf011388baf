//! Unknowns of an iteration that follow from the others by a linear equation are taken out of it (tearing: Kron;
//! Elmqvist and Otter, Proc. ESM 1994). Newton's method makes the same updates without them, and solves for fewer;
//! where all follow one after the other there is nothing left to iterate.

use crate::discretise::equations::system::System;
use crate::expression::{Expr, Pool, Sign, Symbol};
use rustc_hash::FxHashMap;

/// More unknowns than this are left: their elimination finds its order from the pattern.
const MOST: usize = 8;
/// The inverse of at most this many linear equations is written out.
const TOGETHER: usize = 4;

/// What was taken out of a system.
#[derive(Default)]
pub(crate) struct Torn {
    /// What is computed before the iteration, in order.
    pub(crate) before: Vec<(Symbol, Expr)>,
    /// The unknowns, with what they are in terms of those that stay.
    pub(crate) unknowns: Vec<(Symbol, Expr)>,
}

/// Takes unknowns out of a system. `h`, if given, is above 0. Residuals are put in terms of those that stay too, unless
/// that would round coefficients that have to be whole.
pub(crate) fn tear(pool: &mut Pool, system: &mut System, h: Option<Symbol>) -> Torn {
    let unknowns = system.unknowns.clone();
    let n = unknowns.len();
    if n > MOST {
        return Torn::default();
    }
    let mut before = Vec::new();
    if let Some(taken) = together(pool, system, &mut before) {
        return Torn { before, unknowns: put(pool, system, taken) };
    }
    // The rows that are taken: unknown, which others it is made of, and how.
    let mut taken: Vec<(usize, Vec<usize>, Expr)> = Vec::new();
    // Arguments of exponentials stay, unless they are given: with these known the rest is linear.
    let bent = |i: usize| system.knees.iter().any(|b| b.0 == unknowns[i]);
    let plain: Vec<usize> = (0..n).filter(|i| !bent(*i)).collect();
    for i in 0..n {
        let of: Vec<usize> = if bent(i) { (0..n).collect() } else { plain.clone() };
        let symbols: Vec<Symbol> = of.iter().map(|i| unknowns[*i]).collect();
        let Some((linear, rest)) = pool.affine(system.residuals[i], &symbols) else { continue };
        let linear: Vec<(usize, Expr)> = linear.into_iter().map(|(j, k)| (of[j], k)).collect();
        let Some(&(_, own)) = linear.iter().find(|t| t.0 == i) else { continue };
        let positive = |s: Symbol| if Some(s) == h { Sign::Positive } else { Sign::Unknown };
        if !matches!(pool.sign(own, &positive), Sign::Positive | Sign::Negative) {
            continue;
        }
        // What is switched off is next to nothing, and to divide by it makes much of rounding.
        if pool.is_chosen(own) {
            continue;
        }
        let others: Vec<usize> = linear.iter().map(|t| t.0).filter(|j| *j != i).collect();
        // Of a last one that is more than given an iteration takes the rounding of the solution off.
        let is_given = others.is_empty() && pool.constant(own).is_some();
        let is_last = taken.len() + 1 == n || bent(i);
        if taken.iter().any(|(k, of, _)| others.contains(k) || of.contains(&i)) || (is_last && !is_given) {
            continue;
        }
        let rest = if system.exact_coefficients || pool.constant(own).is_some() {
            let none = FxHashMap::from_iter([(unknowns[i], pool.zero())]);
            pool.substitute(system.residuals[i], &none)
        } else {
            linear.into_iter().filter(|t| t.0 != i).fold(rest, |sum, (j, k)| {
                let u = pool.var(unknowns[j]);
                let term = pool.mul(k, u);
                pool.add(sum, term)
            })
        };
        let value = pool.div(rest, own);
        taken.push((i, others, pool.neg(value)));
    }
    let taken = taken.into_iter().map(|(i, _, e)| (i, e)).collect();
    Torn { before: Vec::new(), unknowns: put(pool, system, taken) }
}

/// What is linear once arguments of exponentials are known, solved together: None where that is not all the others, or
/// one of them alone.
fn together(pool: &mut Pool, system: &System, before: &mut Vec<(Symbol, Expr)>) -> Option<Vec<(usize, Expr)>> {
    let bent = |s: Symbol| system.knees.iter().any(|b| b.0 == s);
    let plain: Vec<usize> = (0..system.unknowns.len()).filter(|i| !bent(system.unknowns[*i])).collect();
    if system.exact_coefficients || plain.len() < 2 || plain.len() == system.unknowns.len() || plain.len() > TOGETHER {
        return None;
    }
    let symbols: Vec<Symbol> = plain.iter().map(|i| system.unknowns[*i]).collect();
    let (mut matrix, mut rests) = (Vec::new(), Vec::new());
    for i in &plain {
        let (linear, rest) = pool.affine(system.residuals[*i], &symbols)?;
        let mut row = vec![pool.zero(); plain.len()];
        for (j, k) in linear {
            row[j] = k;
        }
        if row.iter().any(|k| pool.contains_any(*k, &|s| bent(s))) {
            return None;
        }
        matrix.push(row);
        rests.push(rest);
    }
    let inverse = inverse(pool, matrix, before)?;
    let all = plain.into_iter().zip(inverse).map(|(i, row)| {
        let terms: Vec<Expr> = row.into_iter().zip(&rests).map(|(k, rest)| pool.mul(k, *rest)).collect();
        let sum = pool.sum(&terms);
        (i, pool.neg(sum))
    });
    Some(all.collect())
}

/// The inverse of a matrix by Gauss and Jordan, without pivots (it is the identity and a step's part of what only takes
/// power); `before` gets what is computed on the way.
fn inverse(pool: &mut Pool, mut a: Vec<Vec<Expr>>, before: &mut Vec<(Symbol, Expr)>) -> Option<Vec<Vec<Expr>>> {
    let n = a.len();
    let mut known = |pool: &mut Pool, e: Expr| {
        if pool.constant(e).is_some() {
            return e;
        }
        let s = pool.symbol(&format!("elimination[{}]", before.len()));
        before.push((s, e));
        pool.var(s)
    };
    for k in 0..n {
        if pool.is_zero(a[k][k]) {
            return None;
        }
        let one = pool.one();
        let over = pool.div(one, a[k][k]);
        let over = known(pool, over);
        a[k][k] = one;
        for j in 0..n {
            let e = pool.mul(a[k][j], over);
            a[k][j] = known(pool, e);
        }
        for i in (0..n).filter(|i| *i != k) {
            let by = a[i][k];
            if pool.is_zero(by) {
                continue;
            }
            a[i][k] = pool.zero();
            for j in 0..n {
                let term = pool.mul(by, a[k][j]);
                let e = pool.sub(a[i][j], term);
                a[i][j] = known(pool, e);
            }
        }
    }
    Some(a)
}

/// Has what is taken out of a system in terms of what stays.
fn put(pool: &mut Pool, system: &mut System, taken: Vec<(usize, Expr)>) -> Vec<(Symbol, Expr)> {
    let unknowns = system.unknowns.clone();
    let stays = |i: usize| taken.iter().all(|t| t.0 != i);
    let kept: Vec<usize> = (0..unknowns.len()).filter(|i| stays(*i)).collect();
    system.unknowns = kept.iter().map(|i| unknowns[*i]).collect();
    let map: FxHashMap<Symbol, Expr> = match system.exact_coefficients {
        true => FxHashMap::default(),
        false => taken.iter().map(|(i, e)| (unknowns[*i], *e)).collect(),
    };
    system.residuals = kept.iter().map(|i| pool.substitute(system.residuals[*i], &map)).collect();
    system.start = kept.iter().map(|i| system.start[*i]).collect();
    system.weight = kept.iter().map(|i| system.weight[*i]).collect();
    system.scale = kept.iter().map(|i| system.scale[*i]).collect();
    taken.into_iter().map(|(i, e)| (unknowns[i], e)).collect()
}
