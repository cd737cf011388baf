//! Whether a constraint on speeds is the rate of a constraint on positions.

use crate::expression::{Expr, Node, Pool, Symbol};
use crate::structure::{ColumnId, Form};
use rustc_hash::FxHashMap;

/// What is known of a constraint sum of k_j z_j = 0 whose ratios change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It is d/dt of a function of positions, which stays as it is.
    Holonomic,
    /// It is not: it ties speeds alone. (By another factor it may be: Frobenius' theorem is not asked.)
    SpeedsAlone,
}

/// Decides it where all ratios are functions of the integrals q_j of the speeds z_j: dk_i/dq_j = dk_j/dq_i for all of
/// them (Poincare's lemma).
pub(super) fn kind(pool: &mut Pool, form: &Form, constraint: ColumnId) -> Option<Kind> {
    // Which position a speed moves, and by what sign; states with the same rate count the same.
    let mut moved: FxHashMap<Symbol, (Symbol, bool)> = FxHashMap::default();
    let mut same: FxHashMap<Symbol, Expr> = FxHashMap::default();
    let mut offsets: Vec<Symbol> = Vec::new();
    for s in form.regions.iter().flat_map(|r| &r.states) {
        let rate = form.input(pool, s.column);
        let opposite = pool.neg(rate);
        let (speed, negated) = match (pool.node(rate), pool.node(opposite)) {
            (Node::Symbol(speed), _) => (*speed, false),
            (_, Node::Symbol(speed)) => (*speed, true),
            (_, _) => continue,
        };
        match moved.get(&speed) {
            None => {
                moved.insert(speed, (s.symbol, negated));
            }
            // Two counters of one angle differ by their starts.
            Some((first, sign)) => {
                let first = pool.var(*first);
                let first = if *sign == negated { first } else { pool.neg(first) };
                offsets.push(pool.symbol("the difference of the starts"));
                let offset = pool.var(offsets[offsets.len() - 1]);
                same.insert(s.symbol, pool.add(first, offset));
            }
        }
    }
    let row = form.column(constraint).row.clone();
    let mut slopes: Vec<(Symbol, Expr)> = Vec::new();
    let mut others: Vec<Expr> = Vec::new();
    for (j, k) in row {
        let k = pool.substitute(k, &same);
        match moved.get(&form.column(j).out) {
            Some((q, true)) => slopes.push((*q, pool.neg(k))),
            Some((q, false)) => slopes.push((*q, k)),
            None => others.push(k),
        }
    }
    // Positions that ratios read, and whose speeds are not in the constraint.
    let read: Vec<Symbol> = slopes.iter().flat_map(|(_, k)| pool.symbols(*k)).collect();
    let zero = pool.int(0);
    for (q, _) in
        form.regions.iter().flat_map(|r| &r.states).filter_map(|s| moved.values().find(|(q, _)| *q == s.symbol))
    {
        if read.contains(q) && !slopes.iter().any(|(r, _)| r == q) {
            slopes.push((*q, zero));
        }
    }
    let places: Vec<Symbol> = slopes.iter().map(|s| s.0).collect();
    let varies = |pool: &Pool, e: Expr| pool.contains_any(e, &|s| pool.value(s).is_none());
    if !slopes.iter().any(|(_, k)| varies(pool, *k)) || others.iter().any(|k| varies(pool, *k)) {
        return None;
    }
    let mut kind = Kind::Holonomic;
    for (i, (q, k)) in slopes.iter().enumerate() {
        let is_place = |s: Symbol| pool.value(s).is_some() || places.contains(&s) || offsets.contains(&s);
        if pool.contains_any(*k, &|s| !is_place(s)) {
            return None;
        }
        for (r, l) in &slopes[i + 1..] {
            let (a, b) = (pool.derivative(*k, *r), pool.derivative(*l, *q));
            let curl = pool.sub(a, b);
            if pool.is_zero(curl) {
                continue;
            }
            let differs = (0..3).any(|point| {
                let at = |s: Symbol| pool.value(s).unwrap_or(0.3 + 0.17 * f64::from(s.0 % 7) + 0.41 * f64::from(point));
                let (a, b) = (pool.eval(a, &at), pool.eval(b, &at));
                (a - b).abs() > 1e-9 * (a.abs() + b.abs())
            });
            if !differs {
                return None;
            }
            kind = Kind::SpeedsAlone;
        }
    }
    Some(kind)
}
