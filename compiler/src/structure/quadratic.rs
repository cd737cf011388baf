//! Tied storages with quadratic energies, by ratios that may change with the states of others.
//!
//! All of them see z = P w + B u, with w a co-energy variable for each independent one, u the sources' values, and x =
//! L z, L being the inverse of the second derivatives of H. Then pi = P^T x = M w + N u moves by
//!
//! d(pi)/dt = P^T F + sum over k of G_k dq_k/dt,  G_k = sum over c of x_c dP_c/dq_k,
//!
//! with F the rates without the dependent storages; and H = z^T L z / 2 is the energy of all. The G_k are gyroscopic:
//! in the new coordinates they stand in D' = T D T^T with both signs. Where an independent storage is seen through a
//! ratio that passes 0, as the horizontal speed of a pendulum, P takes that ratio as the storage's own factor, so that
//! M stays regular.

use super::change::{self, Change};
use super::dependent::{Eliminated, Following, Merged, family, stiffness, storage};
use super::start::{self, Stated, at_start};
use super::tied::{Tied, refused};
use super::{ColumnId, Form, Role, inverse, singular};
use crate::expression::{Expr, Node, Symbol};
use crate::model::{Model, Signal};
use bond_grammar::diagnostic::Diagnostic;

/// So many storages may be independent where the ratios change: the inverse of their masses is written out.
pub(super) const LARGEST: usize = 8;

/// Merges them.
pub(super) fn merge(model: &mut Model, form: &mut Form, tied: &Tied, done: &mut Eliminated) -> Result<(), Diagnostic> {
    let (independent, n) = (&tied.independent, tied.independent.len());
    let all: Vec<ColumnId> = independent.iter().chain(&tied.dependent).copied().collect();
    let compliance = compliance(model, form, &all).ok_or_else(|| singular(model, form, tied))?;
    let (zero, one) = (model.pool.int(0), model.pool.int(1));
    // P: a factor for each independent storage, and what the dependent ones see of it.
    let is_state = |s: Symbol| matches!(model.signals.get(&s), Some(Signal::State(_)));
    let pool = &mut model.pool;
    let ratio: Vec<Vec<Expr>> =
        tied.ratio.iter().map(|row| row.iter().map(|a| opened(pool, *a, &is_state)).collect()).collect();
    let divisors: Vec<Vec<(Expr, i64)>> =
        (0..n).map(|i| divisors(pool, &ratio.iter().map(|r| r[i]).collect::<Vec<_>>(), &is_state)).collect();
    let product = |pool: &mut crate::expression::Pool, list: &[(Expr, i64)]| {
        let powers: Vec<Expr> = list.iter().map(|(b, n)| pool.powi(*b, *n)).collect();
        pool.product(&powers)
    };
    let factors: Vec<Expr> = divisors.iter().map(|list| product(pool, list)).collect();
    done.divided |= n > 1 && divisors.iter().any(|list| !list.is_empty());
    let mut p: Vec<Vec<Expr>> =
        (0..n).map(|i| (0..n).map(|j| if i == j { factors[i] } else { zero }).collect()).collect();
    for row in &ratio {
        p.push(row.iter().zip(&factors).map(|(a, g)| spread(&mut model.pool, *a, *g)).collect());
    }
    // B u by storage; sources as functions of time.
    let mut driven = vec![zero; all.len()];
    let mut driven_by_time = vec![zero; all.len()];
    for (d, sources) in tied.sources.iter().enumerate() {
        for (c, b) in sources {
            let Role::Source(v) = form.column(*c).role else { continue };
            let u = model.pool.var(form.column(*c).out);
            let (t, s) = (model.pool.mul(*b, u), model.pool.mul(*b, v));
            driven[n + d] = model.pool.add(driven[n + d], t);
            driven_by_time[n + d] = model.pool.add(driven_by_time[n + d], s);
        }
    }
    // A storage that sees the rest by a factor of its own has another momentum, and its state another name.
    let mut states: Vec<Symbol> = Vec::new();
    for (c, g) in independent.iter().zip(&factors) {
        let name = storage(model, form.column(*c).element).map(|s| model.pool.name(s.state).to_string());
        let mark = if model.pool.is_one(*g) { "" } else { "'" };
        states.push(model.pool.symbol(&format!("{}{mark}", name.unwrap_or_default())));
    }
    let outs: Vec<Symbol> = (0..n)
        .map(|i| {
            let out = form.column(independent[i]).out;
            if model.pool.is_one(factors[i]) { out } else { model.pool.symbol(&format!("{}'", model.pool.name(out))) }
        })
        .collect();
    let w: Vec<Expr> = outs.iter().map(|s| model.pool.var(*s)).collect();
    let pool = &mut model.pool;
    let sum_of = |pool: &mut crate::expression::Pool, a: &[Expr], b: &[Expr]| {
        let terms: Vec<Expr> = a.iter().zip(b).map(|(x, y)| pool.mul(*x, *y)).collect();
        pool.sum(&terms)
    };
    // M = P^T L P and N u = P^T L B u
    let lp: Vec<Vec<Expr>> = compliance
        .iter()
        .map(|row| {
            (0..n)
                .map(|j| {
                    let column: Vec<Expr> = p.iter().map(|r| r[j]).collect();
                    sum_of(pool, row, &column)
                })
                .collect()
        })
        .collect();
    let transposed: Vec<Vec<Expr>> = (0..n).map(|i| p.iter().map(|r| r[i]).collect()).collect();
    let m: Vec<Vec<Expr>> = transposed
        .iter()
        .map(|row| {
            (0..n)
                .map(|j| {
                    let column: Vec<Expr> = lp.iter().map(|r| r[j]).collect();
                    let sum = sum_of(pool, row, &column);
                    pool.pythagoras(sum)
                })
                .collect()
        })
        .collect();
    let loads = |pool: &mut crate::expression::Pool, driven: &[Expr]| -> (Vec<Expr>, Vec<Expr>) {
        let lb: Vec<Expr> = compliance.iter().map(|row| sum_of(pool, row, driven)).collect();
        let nu = transposed.iter().map(|row| sum_of(pool, row, &lb)).collect();
        (lb, nu)
    };
    let (lb, nu) = loads(pool, &driven);
    let (lb_t, nu_t) = loads(pool, &driven_by_time);
    if n > 1 {
        done.poles.extend(singular::poles(pool, divisors.iter().flatten().map(|t| t.0), &m));
    }
    let known = m.iter().flatten().all(|e| pool.constant(*e).is_some());
    if n > LARGEST && !known {
        let why = format!("{n} storages are tied together by ratios that change, more than {LARGEST}");
        return Err(refused(model, form, tied.dependent[0], &why, None));
    }
    let minv = if n == 0 { vec![] } else { inverse(pool, &m).ok_or_else(|| singular(model, form, tied))? };
    // Where they start: of a storage alone its co-energy variable is compared, of a port of a field its state.
    let mut stated: Vec<Stated> = Vec::new();
    for (i, c) in all.iter().enumerate() {
        let Some(s) = storage(model, form.column(*c).element).filter(|s| s.explicit) else { continue };
        let value = |e: &Expr| at_start(model, form, *e);
        let alone = family(model, form, *c).len() == 1;
        stated.push(if alone {
            let driven = value(&driven_by_time[i]);
            Stated { column: *c, row: p[i].iter().map(value).collect(), value: value(&s.coenergy) - driven, driven }
        } else {
            let driven = value(&lb_t[i]);
            Stated { column: *c, row: lp[i].iter().map(value).collect(), value: s.initial - driven, driven }
        });
    }
    let start = start::solve(model, form, tied, &stated, &vec![0.0; n])?;
    let start: Vec<f64> = start.into_iter().map(|w| w.unwrap_or(0.0)).collect();
    let pool = &mut model.pool;
    // w as a function of the new states; z and x of all as functions of w, and of the states.
    let pi: Vec<Expr> = states.iter().map(|s| pool.var(*s)).collect();
    let w_of = |pool: &mut crate::expression::Pool, nu: &[Expr]| -> Vec<Expr> {
        let left: Vec<Expr> = pi.iter().zip(nu).map(|(p, u)| pool.sub(*p, *u)).collect();
        minv.iter().map(|row| sum_of(pool, row, &left)).collect()
    };
    let coenergy_w = w_of(pool, &nu);
    let w_time = w_of(pool, &nu_t);
    let x: Vec<Expr> = lp
        .iter()
        .zip(&lb)
        .map(|(row, b)| {
            let s = sum_of(pool, row, &w);
            pool.add(s, *b)
        })
        .collect();
    let x_time: Vec<Expr> = lp
        .iter()
        .zip(&lb_t)
        .map(|(row, b)| {
            let s = sum_of(pool, row, &w_time);
            pool.add(s, *b)
        })
        .collect();
    let half = pool.ratio(1, 2);
    let energy = if driven.iter().all(|e| pool.is_zero(*e)) {
        let s = sum_of(pool, &pi, &coenergy_w);
        pool.mul(half, s)
    } else {
        let z: Vec<Expr> = p
            .iter()
            .zip(&driven_by_time)
            .map(|(row, b)| {
                let s = sum_of(pool, row, &w_time);
                pool.add(s, *b)
            })
            .collect();
        let s = sum_of(pool, &z, &x_time);
        pool.mul(half, s)
    };
    // The change of coordinates.
    let mut change: Change = Vec::new();
    let others: Vec<(ColumnId, Symbol)> =
        tied.others.iter().filter_map(|c| Some((*c, storage(model, form.column(*c).element)?.state))).collect();
    let pool = &mut model.pool;
    for i in 0..n {
        let mut terms = vec![(independent[i], factors[i])];
        for (c, q) in &others {
            let slopes: Vec<Expr> = p.iter().map(|row| pool.derivative(row[i], *q)).collect();
            let g = sum_of(pool, &slopes, &x);
            let g = pool.pythagoras(g);
            if !pool.is_zero(g) {
                terms.push((*c, g));
            }
        }
        change.push((independent[i], terms));
    }
    let touched: Vec<ColumnId> =
        others.iter().map(|t| t.0).filter(|c| change.iter().any(|(_, t)| t.iter().any(|(b, _)| b == c))).collect();
    for c in &touched {
        change.push((*c, vec![(*c, one)]));
    }
    let moved = !touched.is_empty() || factors.iter().any(|g| !pool.is_one(*g));
    if moved {
        change::transform(pool, form, &change);
    }
    // New outputs where they changed, and the old ones in their terms.
    for (i, c) in independent.iter().enumerate() {
        let old = form.column(*c).out;
        if old != outs[i] {
            form.columns[c.at()].out = outs[i];
            form.column_of.insert(outs[i], *c);
            done.fixed.insert(old, model.pool.mul(factors[i], w[i]));
        }
    }
    for c in &touched {
        let old = form.column(*c).out;
        let new = model.pool.symbol(&format!("{}'", model.pool.name(old)));
        let mut terms = vec![model.pool.var(new)];
        for (i, (_, list)) in change.iter().take(n).enumerate() {
            if let Some((_, g)) = list.iter().find(|(b, _)| b == c) {
                terms.push(model.pool.mul(*g, w[i]));
            }
        }
        form.columns[c.at()].out = new;
        form.column_of.insert(new, *c);
        let old_in_new = model.pool.sum(&terms);
        done.fixed.insert(old, old_in_new);
    }
    // The energies of storages on which the masses depend belong to the same group.
    let mut columns = independent.clone();
    let mut total = vec![energy];
    let mut bounded = true;
    if !touched.is_empty() {
        let mut families: Vec<Vec<ColumnId>> = touched.iter().map(|c| family(model, form, *c)).collect();
        families.dedup();
        for family in families {
            let Some(s) = family.first().and_then(|c| storage(model, form.column(*c).element)) else { continue };
            bounded &= s.bounded;
            total.push(s.energy);
            columns.extend(family.into_iter().filter(|c| !columns.contains(c)).collect::<Vec<_>>());
        }
    }
    let energy = model.pool.sum(&total);
    let mut coenergy = coenergy_w.clone();
    for c in &columns[n..] {
        let Some(q) = storage(model, form.column(*c).element).map(|s| s.state) else { continue };
        coenergy.push(model.pool.derivative(energy, q));
    }
    // States, old ones and what dependent storages give.
    for (i, c) in independent.iter().enumerate() {
        let terms: f64 =
            (0..n).map(|j| if start[j] == 0.0 { 0.0 } else { at_start(model, form, m[i][j]) * start[j] }).sum();
        let initial = terms + at_start(model, form, nu_t[i]);
        done.states.insert(*c, (states[i], initial, model.pool.is_one(factors[i])));
    }
    for (c, x) in all.iter().zip(&x) {
        if let Some(s) = storage(model, form.column(*c).element) {
            done.fixed.insert(s.state, *x);
        }
    }
    let mut moving: Vec<(ColumnId, Symbol)> = independent.iter().copied().zip(states.iter().copied()).collect();
    moving.extend(others.iter().copied());
    let mut list = Vec::new();
    for (d, c) in tied.dependent.iter().enumerate() {
        let state = x_time[n + d];
        let rate = change::rate(model, form, state, &moving);
        done.fixed.insert(form.column(*c).out, rate);
        if !tied.sources[d].is_empty() {
            done.following.push(Following { column: *c, state, rate });
        }
        list.push((form.column(*c).element, state));
    }
    let region = form.column(all[0]).region;
    let into = independent.clone();
    done.groups.push(Merged { region, columns, energy, coenergy, bounded, dependent: list, into });
    Ok(())
}

/// The inverse of the second derivatives of H over some storages.
fn compliance(model: &mut Model, form: &Form, all: &[ColumnId]) -> Option<Vec<Vec<Expr>>> {
    let zero = model.pool.int(0);
    // An inertia of 0 has no momentum, whatever its speed.
    let massless = |c: &ColumnId| storage(model, form.column(*c).element).is_some_and(|s| s.massless);
    if let Some(i) = all.iter().position(massless) {
        let rest: Vec<ColumnId> = all.iter().copied().filter(|c| *c != all[i]).collect();
        let mut l = compliance(model, form, &rest)?;
        for row in &mut l {
            row.insert(i, zero);
        }
        l.insert(i, vec![zero; all.len()]);
        return Some(l);
    }
    let mut k = vec![vec![zero; all.len()]; all.len()];
    for (i, c) in all.iter().enumerate() {
        for (other, value) in stiffness(model, form, *c)? {
            let j = all.iter().position(|x| *x == other)?;
            k[i][j] = value;
        }
    }
    if (0..all.len()).all(|i| (0..all.len()).all(|j| i == j || model.pool.is_zero(k[i][j]))) {
        let one = model.pool.int(1);
        for (i, row) in k.iter_mut().enumerate() {
            row[i] = model.pool.div(one, row[i]);
        }
        return Some(k);
    }
    inverse(&mut model.pool, &k)
}

fn singular(model: &Model, form: &Form, tied: &Tied) -> Diagnostic {
    let first = tied.dependent.first().map(|d| form.column(*d));
    let (span, name) = first.map_or((model.span, ""), |c| (model.element(c.element).span, c.name.as_str()));
    Diagnostic::error("structure::singular", span, format!("the storages tied to `{name}` have no common inertia"))
        .help("check their values")
}

/// What the entries are divided by and changes with states, with the power of it.
fn divisors(pool: &crate::expression::Pool, entries: &[Expr], is_state: &dyn Fn(Symbol) -> bool) -> Vec<(Expr, i64)> {
    let mut bases: Vec<(Expr, i64)> = Vec::new();
    for e in entries {
        let terms: Vec<Expr> = match pool.node(*e).clone() {
            Node::Sum(_, list) => list.iter().map(|t| t.0).collect(),
            _ => vec![*e],
        };
        for t in terms {
            let Node::Product(_, factors) = pool.node(t).clone() else { continue };
            for &(base, n) in factors.iter() {
                let Some(n) = n.integer().filter(|n| *n < 0) else { continue };
                if !pool.contains_any(base, is_state) {
                    continue;
                }
                match bases.iter_mut().find(|b| b.0 == base) {
                    Some(b) => b.1 = b.1.max(-n),
                    None => bases.push((base, -n)),
                }
            }
        }
    }
    bases.sort_unstable();
    bases
}

/// A product of sums multiplied out where one of them divides by what changes with states, as `r (1 + b/a)`.
fn opened(pool: &mut crate::expression::Pool, e: Expr, is_state: &dyn Fn(Symbol) -> bool) -> Expr {
    match pool.node(e).clone() {
        Node::Sum(constant, list) => {
            let mut terms = vec![pool.numeral(constant)];
            for &(t, k) in list.iter() {
                let t = opened(pool, t, is_state);
                terms.push(pool.scale(t, k));
            }
            pool.sum(&terms)
        }
        Node::Product(_, factors) => {
            let sums = factors.iter().filter(|(f, n)| matches!(pool.node(*f), Node::Sum(..)) && n.to_f64() > 0.0);
            let inner: Vec<Expr> = sums.map(|t| t.0).collect();
            let inner: Vec<Expr> = inner.into_iter().map(|f| opened(pool, f, is_state)).collect();
            if divisors(pool, &inner, is_state).is_empty() {
                return e;
            }
            pool.expand(e).map_or(e, |e| opened(pool, e, is_state))
        }
        _ => e,
    }
}

/// `a g`, term by term, so that g cancels what a is divided by.
fn spread(pool: &mut crate::expression::Pool, a: Expr, g: Expr) -> Expr {
    match pool.node(a).clone() {
        Node::Sum(constant, list) if !pool.is_one(g) => {
            let mut terms: Vec<Expr> = Vec::new();
            for &(t, k) in list.iter() {
                let t = pool.mul(t, g);
                terms.push(pool.scale(t, k));
            }
            terms.push(pool.scale(g, constant));
            pool.sum(&terms)
        }
        _ => pool.mul(a, g),
    }
}
