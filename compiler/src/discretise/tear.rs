//! Unknowns of an iteration that follow from the others by a linear equation are taken out of it (tearing: Kron;
//! Elmqvist and Otter, Proc. ESM 1994). Newton's method makes the same updates without them, and solves for fewer; where
//! all follow one after the other there is nothing left to iterate.

use super::write::System;
use crate::expression::{Expr, Pool, Sign, Symbol};
use rustc_hash::FxHashMap;

/// More unknowns than this are left: their elimination finds its order from the pattern.
const MOST: usize = 8;

/// Takes unknowns out of a system: gives them, with what they are in terms of those that stay. `h`, if given, is
/// above 0. Residuals are put in terms of those that stay too, unless that would round coefficients that have to be
/// whole.
pub(super) fn tear(pool: &mut Pool, system: &mut System, h: Option<Symbol>) -> Vec<(Symbol, Expr)> {
    let unknowns = system.unknowns.clone();
    let n = unknowns.len();
    if n > MOST {
        return Vec::new();
    }
    // The rows that are taken: unknown, which others it is made of, and how.
    let mut taken: Vec<(usize, Vec<usize>, Expr)> = Vec::new();
    // Arguments of exponentials stay, unless they are given: with these known the rest is linear.
    let bent = |i: usize| system.bends.iter().any(|b| b.0 == unknowns[i]);
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
        let others: Vec<usize> = linear.iter().map(|t| t.0).filter(|j| *j != i).collect();
        // Of a last one that is more than given an iteration takes the rounding of the solution off.
        let is_given = others.is_empty() && pool.constant(own).is_some();
        let is_last = taken.len() + 1 == n || bent(i);
        if taken.iter().any(|(k, of, _)| others.contains(k) || of.contains(&i)) || (is_last && !is_given) {
            continue;
        }
        let rest = if system.whole {
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
    let stays = |i: usize| taken.iter().all(|t| t.0 != i);
    let kept: Vec<usize> = (0..n).filter(|i| stays(*i)).collect();
    system.unknowns = kept.iter().map(|i| unknowns[*i]).collect();
    let map: FxHashMap<Symbol, Expr> = match system.whole {
        true => FxHashMap::default(),
        false => taken.iter().map(|(i, _, e)| (unknowns[*i], *e)).collect(),
    };
    system.residuals = kept.iter().map(|i| pool.substitute(system.residuals[*i], &map)).collect();
    system.start = kept.iter().map(|i| system.start[*i]).collect();
    system.weight = kept.iter().map(|i| system.weight[*i]).collect();
    system.scale = kept.iter().map(|i| system.scale[*i]).collect();
    taken.into_iter().map(|(i, _, e)| (unknowns[i], e)).collect()
}
