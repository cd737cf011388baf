//! Dependent storages with quadratic energies, by ratios that may change with the states of other storages.
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
use super::dependence::Dependence;
use super::eliminated::{Eliminated, Following, Merged};
use super::explicit::Matrix;
use super::start::{self, Stated, at_start};
use super::storage::{family, stiffness, storage};
use super::{ColumnId, Form, Role, inverse, singular};
use crate::expression::{Expr, Node, Pool, Symbol};
use crate::model::{ElementId, Model, Signal};
use bond_grammar::diagnostic::Diagnostic;

/// Merges them.
pub(super) fn merge(
    model: &mut Model,
    form: &mut Form,
    set: &Dependence,
    done: &mut Eliminated,
) -> Result<(), Diagnostic> {
    let independent = &set.independent;
    let all: Vec<ColumnId> = independent.iter().chain(&set.dependent).copied().collect();
    let compliance = compliance(model, form, &all).ok_or_else(|| no_inertia(model, form, set))?;
    let seen = Seen::of(model, form, set);
    let symbols = Symbols::of(model, form, set, &seen);
    let momenta = Momenta::of(&mut model.pool, &compliance, &seen);
    let inverse_mass = inverse_mass(model, form, set, (&seen, &momenta), done)?;
    let start = start(model, form, set, (&seen, &momenta))?;
    let own = Own::of(&mut model.pool, (&seen, &symbols, &momenta), &inverse_mass);
    let (change, touched) = coordinates(model, form, set, (&seen, &own));
    rename(model, form, set, (&seen, &symbols), (&change, &touched), done);
    let (columns, energy, coenergy, bounded) = group(model, form, set, &own, &touched);
    for (i, c) in independent.iter().enumerate() {
        let terms: f64 = (0..independent.len())
            .map(|j| if start[j] == 0.0 { 0.0 } else { at_start(model, form, momenta.mass[i][j]) * start[j] })
            .sum();
        let initial = terms + at_start(model, form, momenta.driven_by_time.1[i]);
        done.states.insert(*c, (symbols.states[i], initial, model.pool.is_one(seen.factors[i])));
    }
    for (c, x) in all.iter().zip(&own.states) {
        if let Some(s) = storage(model, form.column(*c).element) {
            done.fixed.insert(s.state, *x);
        }
    }
    let dependent = rates(model, form, set, (&symbols, &own), done);
    let region = form.column(all[0]).region;
    let into = independent.clone();
    done.groups.push(Merged { region, columns, energy, coenergy, bounded, dependent, into });
    Ok(())
}

/// The co-energy variables that the storages see, z = P w + B u: the independent storages first.
struct Seen {
    /// What the entries of each independent storage's column are divided by, with the powers.
    divisors: Vec<Vec<(Expr, i64)>>,
    /// The products of these: each independent storage's own factor in P.
    factors: Vec<Expr>,
    /// P, by storage.
    p: Matrix,
    /// B u, by storage.
    driven: Vec<Expr>,
    /// The same, with the sources as functions of time.
    driven_by_time: Vec<Expr>,
}

impl Seen {
    fn of(model: &mut Model, form: &Form, set: &Dependence) -> Self {
        let n = set.independent.len();
        let (zero, _) = (model.pool.int(0), model.pool.int(1));
        let is_state = |s: Symbol| matches!(model.signals.get(&s), Some(Signal::State(_)));
        let pool = &mut model.pool;
        let ratio: Matrix =
            set.ratio.iter().map(|row| row.iter().map(|a| expanded(pool, *a, &is_state)).collect()).collect();
        let divisors: Vec<Vec<(Expr, i64)>> =
            (0..n).map(|i| divisors(pool, &ratio.iter().map(|r| r[i]).collect::<Vec<_>>(), &is_state)).collect();
        let product = |pool: &mut Pool, list: &[(Expr, i64)]| {
            let powers: Vec<Expr> = list.iter().map(|(b, n)| pool.powi(*b, *n)).collect();
            pool.product(&powers)
        };
        let factors: Vec<Expr> = divisors.iter().map(|list| product(pool, list)).collect();
        let mut p: Matrix = (0..n).map(|i| (0..n).map(|j| if i == j { factors[i] } else { zero }).collect()).collect();
        for row in &ratio {
            p.push(row.iter().zip(&factors).map(|(a, g)| spread(pool, *a, *g)).collect());
        }
        let mut driven = vec![zero; n + set.dependent.len()];
        let mut driven_by_time = driven.clone();
        for (d, sources) in set.sources.iter().enumerate() {
            for (c, b) in sources {
                let Role::Source(v) = form.column(*c).role else { continue };
                let u = pool.var(form.column(*c).out);
                let (t, s) = (pool.mul(*b, u), pool.mul(*b, v));
                driven[n + d] = pool.add(driven[n + d], t);
                driven_by_time[n + d] = pool.add(driven_by_time[n + d], s);
            }
        }
        Self { divisors, factors, p, driven, driven_by_time }
    }
}

/// The names of what is left. A storage that sees the rest by a factor of its own has another momentum, and its state
/// and output have other names.
struct Symbols {
    states: Vec<Symbol>,
    outs: Vec<Symbol>,
    /// w, the outputs as expressions.
    w: Vec<Expr>,
}

impl Symbols {
    fn of(model: &mut Model, form: &Form, set: &Dependence, seen: &Seen) -> Self {
        let mut states: Vec<Symbol> = Vec::new();
        for (c, g) in set.independent.iter().zip(&seen.factors) {
            let name = storage(model, form.column(*c).element).map(|s| model.pool.name(s.state).to_string());
            let mark = if model.pool.is_one(*g) { "" } else { "'" };
            states.push(model.pool.symbol(&format!("{}{mark}", name.unwrap_or_default())));
        }
        let mut outs: Vec<Symbol> = Vec::new();
        for (c, g) in set.independent.iter().zip(&seen.factors) {
            let out = form.column(*c).out;
            let renamed = !model.pool.is_one(*g);
            outs.push(if renamed { primed(&mut model.pool, out) } else { out });
        }
        let w = outs.iter().map(|s| model.pool.var(*s)).collect();
        Self { states, outs, w }
    }
}

/// The symbol of a name with a prime more.
fn primed(pool: &mut Pool, s: Symbol) -> Symbol {
    let name = format!("{}'", pool.name(s));
    pool.symbol(&name)
}

fn sum_of(pool: &mut Pool, a: &[Expr], b: &[Expr]) -> Expr {
    let terms: Vec<Expr> = a.iter().zip(b).map(|(x, y)| pool.mul(*x, *y)).collect();
    pool.sum(&terms)
}

/// A row of expressions times a vector, plus an offset, for each row.
fn affine(pool: &mut Pool, rows: &Matrix, x: &[Expr], offsets: &[Expr]) -> Vec<Expr> {
    let one = |(row, b): (&Vec<Expr>, &Expr)| {
        let s = sum_of(pool, row, x);
        pool.add(s, *b)
    };
    rows.iter().zip(offsets).map(one).collect()
}

/// The momenta of w, pi = M w + N u.
struct Momenta {
    /// L P
    lp: Matrix,
    /// M = P^T L P
    mass: Matrix,
    /// L B u, and N u = P^T L B u.
    driven: (Vec<Expr>, Vec<Expr>),
    /// The same, with the sources as functions of time.
    driven_by_time: (Vec<Expr>, Vec<Expr>),
}

impl Momenta {
    fn of(pool: &mut Pool, compliance: &Matrix, seen: &Seen) -> Self {
        let n = seen.factors.len();
        let columns = |m: &Matrix| -> Matrix { (0..n).map(|j| m.iter().map(|r| r[j]).collect()).collect() };
        let transposed = columns(&seen.p);
        let product = |pool: &mut Pool, row: &[Expr], columns: &Matrix| -> Vec<Expr> {
            columns.iter().map(|column| sum_of(pool, row, column)).collect()
        };
        let lp: Matrix = compliance.iter().map(|row| product(pool, row, &transposed)).collect();
        let lp_columns = columns(&lp);
        let mass = |row: &Vec<Expr>| {
            let entry = |column: &Vec<Expr>| {
                let sum = sum_of(pool, row, column);
                pool.pythagoras(sum)
            };
            lp_columns.iter().map(entry).collect::<Vec<Expr>>()
        };
        let mass: Matrix = transposed.iter().map(mass).collect();
        let loads = |pool: &mut Pool, driven: &[Expr]| -> (Vec<Expr>, Vec<Expr>) {
            let lb: Vec<Expr> = compliance.iter().map(|row| sum_of(pool, row, driven)).collect();
            let nu = transposed.iter().map(|row| sum_of(pool, row, &lb)).collect();
            (lb, nu)
        };
        let driven = loads(pool, &seen.driven);
        let driven_by_time = loads(pool, &seen.driven_by_time);
        Self { lp, mass, driven, driven_by_time }
    }
}

/// The inverse of M, and where M is singular by a division alone.
fn inverse_mass(
    model: &mut Model,
    form: &Form,
    set: &Dependence,
    (seen, momenta): (&Seen, &Momenta),
    done: &mut Eliminated,
) -> Result<Matrix, Diagnostic> {
    let (n, mass) = (set.independent.len(), &momenta.mass);
    if n > 1 {
        done.poles.extend(singular::poles(&model.pool, seen.divisors.iter().flatten().map(|t| t.0), mass));
    }
    if n == 0 {
        return Ok(Vec::new());
    }
    inverse(&mut model.pool, mass).ok_or_else(|| no_inertia(model, form, set))
}

/// Where w starts: of a storage alone its co-energy variable is compared, of a port of a field its state.
fn start(
    model: &mut Model,
    form: &Form,
    set: &Dependence,
    (seen, momenta): (&Seen, &Momenta),
) -> Result<Vec<f64>, Diagnostic> {
    let mut stated: Vec<Stated> = Vec::new();
    for (i, c) in set.independent.iter().chain(&set.dependent).enumerate() {
        let Some(s) = storage(model, form.column(*c).element).filter(|s| s.explicit) else { continue };
        let value = |e: &Expr| at_start(model, form, *e);
        let alone = family(model, form, *c).len() == 1;
        stated.push(if alone {
            let driven = value(&seen.driven_by_time[i]);
            Stated {
                column: *c,
                row: seen.p[i].iter().map(value).collect(),
                value: value(&s.coenergy) - driven,
                driven,
            }
        } else {
            let driven = value(&momenta.driven_by_time.0[i]);
            let row = momenta.lp[i].iter().map(value).collect();
            Stated { column: *c, row, value: s.initial - driven, driven }
        });
    }
    let start = start::solve(model, form, set, &stated, &vec![0.0; set.independent.len()])?;
    Ok(start.into_iter().map(|w| w.unwrap_or(0.0)).collect())
}

/// What the storages have in terms of the new states.
struct Own {
    /// w, by independent storage.
    coenergy: Vec<Expr>,
    /// x of each storage, in w.
    states: Vec<Expr>,
    /// The same, in new states and time.
    states_by_time: Vec<Expr>,
    /// H of all.
    energy: Expr,
}

impl Own {
    fn of(pool: &mut Pool, (seen, symbols, momenta): (&Seen, &Symbols, &Momenta), inverse_mass: &Matrix) -> Self {
        let pi: Vec<Expr> = symbols.states.iter().map(|s| pool.var(*s)).collect();
        let w_of = |pool: &mut Pool, nu: &[Expr]| -> Vec<Expr> {
            let left: Vec<Expr> = pi.iter().zip(nu).map(|(p, u)| pool.sub(*p, *u)).collect();
            inverse_mass.iter().map(|row| sum_of(pool, row, &left)).collect()
        };
        let coenergy = w_of(pool, &momenta.driven.1);
        let w_by_time = w_of(pool, &momenta.driven_by_time.1);
        let states = affine(pool, &momenta.lp, &symbols.w, &momenta.driven.0);
        let states_by_time = affine(pool, &momenta.lp, &w_by_time, &momenta.driven_by_time.0);
        let half = pool.ratio(1, 2);
        let twice = if seen.driven.iter().all(|e| pool.is_zero(*e)) {
            sum_of(pool, &pi, &coenergy)
        } else {
            let z = affine(pool, &seen.p, &w_by_time, &seen.driven_by_time);
            sum_of(pool, &z, &states_by_time)
        };
        let energy = pool.mul(half, twice);
        Self { coenergy, states, states_by_time, energy }
    }
}

/// The storages whose states the ratios read, with these states.
fn others(model: &Model, form: &Form, set: &Dependence) -> Vec<(ColumnId, Symbol)> {
    set.others.iter().filter_map(|c| Some((*c, storage(model, form.column(*c).element)?.state))).collect()
}

/// Changes the coordinates of the Dirac structure; gives the change, and the other storages that it touches.
fn coordinates(
    model: &mut Model,
    form: &mut Form,
    set: &Dependence,
    (seen, own): (&Seen, &Own),
) -> (Change, Vec<ColumnId>) {
    let mut change: Change = Vec::new();
    let others = others(model, form, set);
    let pool = &mut model.pool;
    for (i, c) in set.independent.iter().enumerate() {
        let mut terms = vec![(*c, seen.factors[i])];
        for (other, q) in &others {
            let slopes: Vec<Expr> = seen.p.iter().map(|row| pool.derivative(row[i], *q)).collect();
            let g = sum_of(pool, &slopes, &own.states);
            let g = pool.pythagoras(g);
            if !pool.is_zero(g) {
                terms.push((*other, g));
            }
        }
        change.push((*c, terms));
    }
    let is_touched = |c: &ColumnId| change.iter().any(|(_, t)| t.iter().any(|(b, _)| b == c));
    let touched: Vec<ColumnId> = others.iter().map(|t| t.0).filter(is_touched).collect();
    let one = pool.int(1);
    for c in &touched {
        change.push((*c, vec![(*c, one)]));
    }
    if !touched.is_empty() || seen.factors.iter().any(|g| !pool.is_one(*g)) {
        change::transform(pool, form, &change);
    }
    (change, touched)
}

/// Gives columns new outputs where these changed, and tells what the old ones are in terms of them.
fn rename(
    model: &mut Model,
    form: &mut Form,
    set: &Dependence,
    (seen, symbols): (&Seen, &Symbols),
    (change, touched): (&Change, &[ColumnId]),
    done: &mut Eliminated,
) {
    for (i, c) in set.independent.iter().enumerate() {
        let (old, new) = (form.column(*c).out, symbols.outs[i]);
        if old != new {
            form.columns[c.at()].out = new;
            form.column_of.insert(new, *c);
            done.fixed.insert(old, model.pool.mul(seen.factors[i], symbols.w[i]));
        }
    }
    for c in touched {
        let old = form.column(*c).out;
        let new = primed(&mut model.pool, old);
        let mut terms = vec![model.pool.var(new)];
        for (i, (_, list)) in change.iter().take(set.independent.len()).enumerate() {
            if let Some((_, g)) = list.iter().find(|(b, _)| b == c) {
                terms.push(model.pool.mul(*g, symbols.w[i]));
            }
        }
        form.columns[c.at()].out = new;
        form.column_of.insert(new, *c);
        let old_in_new = model.pool.sum(&terms);
        done.fixed.insert(old, old_in_new);
    }
}

/// The group that the storages become: columns, energy, its derivatives, and whether it is bounded. The energies of
/// storages on which the masses depend belong to it too.
fn group(
    model: &mut Model,
    form: &Form,
    set: &Dependence,
    own: &Own,
    touched: &[ColumnId],
) -> (Vec<ColumnId>, Expr, Vec<Expr>, bool) {
    let mut columns = set.independent.clone();
    let mut total = vec![own.energy];
    let mut bounded = true;
    let mut families: Vec<Vec<ColumnId>> = touched.iter().map(|c| family(model, form, *c)).collect();
    families.dedup();
    for family in families {
        let Some(s) = family.first().and_then(|c| storage(model, form.column(*c).element)) else { continue };
        bounded &= s.bounded;
        total.push(s.energy);
        columns.extend(family.into_iter().filter(|c| !columns.contains(c)).collect::<Vec<_>>());
    }
    let energy = model.pool.sum(&total);
    let mut coenergy = own.coenergy.clone();
    for c in &columns[set.independent.len()..] {
        let Some(q) = storage(model, form.column(*c).element).map(|s| s.state) else { continue };
        coenergy.push(model.pool.derivative(energy, q));
    }
    (columns, energy, coenergy, bounded)
}

/// What dependent storages give, d/dt of their states; gives these states by element.
fn rates(
    model: &mut Model,
    form: &Form,
    set: &Dependence,
    (symbols, own): (&Symbols, &Own),
    done: &mut Eliminated,
) -> Vec<(ElementId, Expr)> {
    let n = set.independent.len();
    let mut moving: Vec<(ColumnId, Symbol)> =
        set.independent.iter().copied().zip(symbols.states.iter().copied()).collect();
    moving.extend(others(model, form, set));
    let mut list = Vec::new();
    for (d, c) in set.dependent.iter().enumerate() {
        let state = own.states_by_time[n + d];
        let rate = change::rate(model, form, state, &moving);
        done.fixed.insert(form.column(*c).out, rate);
        if !set.sources[d].is_empty() {
            done.following.push(Following { column: *c, state, rate });
        }
        list.push((form.column(*c).element, state));
    }
    list
}

/// The inverse of the second derivatives of H over some storages.
fn compliance(model: &mut Model, form: &Form, all: &[ColumnId]) -> Option<Matrix> {
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

/// Says that they have no common inertia.
pub(super) fn no_inertia(model: &Model, form: &Form, set: &Dependence) -> Diagnostic {
    let first = set.dependent.first().map(|d| form.column(*d));
    let (span, name) = first.map_or((model.span, ""), |c| (model.element(c.element).span, c.name.as_str()));
    Diagnostic::error("structure::singular", span, format!("the storages tied to `{name}` have no common inertia"))
        .help("check their values")
}

/// What the entries are divided by and changes with states, with the power of it.
pub(super) fn divisors(pool: &Pool, entries: &[Expr], is_state: &dyn Fn(Symbol) -> bool) -> Vec<(Expr, i64)> {
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
pub(super) fn expanded(pool: &mut Pool, e: Expr, is_state: &dyn Fn(Symbol) -> bool) -> Expr {
    match pool.node(e).clone() {
        Node::Sum(constant, list) => {
            let mut terms = vec![pool.numeral(constant)];
            for &(t, k) in list.iter() {
                let t = expanded(pool, t, is_state);
                terms.push(pool.scale(t, k));
            }
            pool.sum(&terms)
        }
        Node::Product(_, factors) => {
            let sums = factors.iter().filter(|(f, n)| matches!(pool.node(*f), Node::Sum(..)) && n.to_f64() > 0.0);
            let inner: Vec<Expr> = sums.map(|t| t.0).collect();
            let inner: Vec<Expr> = inner.into_iter().map(|f| expanded(pool, f, is_state)).collect();
            if divisors(pool, &inner, is_state).is_empty() {
                return e;
            }
            pool.expand(e).map_or(e, |e| expanded(pool, e, is_state))
        }
        _ => e,
    }
}

/// `a g`, term by term, so that g cancels what a is divided by.
pub(super) fn spread(pool: &mut Pool, a: Expr, g: Expr) -> Expr {
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
