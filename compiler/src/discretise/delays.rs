//! Delays in continuous time: within a step, what a signal was a time ago is a polynomial in time, whose coefficients
//! stand still. They come into the step as what other clusters hold does, so that steppers know of no delays: to them
//! it is a source that varies with time.

use crate::expression::{Expr, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::{Form, Output, Role, Row};
use bond_runtime::history::{NODES, SLOTS};
use rustc_hash::FxHashMap;
use std::borrow::Cow;

/// The symbols of what a delay in continuous time is made of, in the order of its input slots: the coefficients, one
/// over the length of what they are for, and the instant from which that is counted. None of a sampled one.
pub(crate) type Coefficients = Vec<Symbol>;

/// A delay as programs have it: its coefficients, and what it is in terms of them; its own symbol where it has none.
pub(crate) type Spread = (Coefficients, Expr);

/// A form in whose continuous parts no delay in continuous time is left, and what all delays are made of.
pub(crate) fn spread<'f>(model: &mut Model, form: &'f Form) -> (Cow<'f, Form>, Vec<Spread>) {
    if model.delays.iter().all(|d| d.periods.is_some()) {
        let all = model.delays.iter().map(|d| (Vec::new(), model.pool.var(d.symbol))).collect();
        return (Cow::Borrowed(form), all);
    }
    let time = model.signals.iter().find(|s| *s.1 == crate::model::Signal::Time).map(|s| *s.0);
    let time = time.unwrap_or_else(|| {
        let time = model.pool.symbol("t");
        model.signals.insert(time, crate::model::Signal::Time);
        time
    });
    let (mut map, mut all) = (FxHashMap::default(), Vec::new());
    for d in &model.delays {
        if d.periods.is_some() {
            all.push((Vec::new(), model.pool.var(d.symbol)));
            continue;
        }
        let name = |i: usize| format!("{}({i})", d.name);
        let symbols: Vec<Symbol> = (0..SLOTS).map(|i| model.pool.symbol(&name(i))).collect();
        let value = polynomial(&mut model.pool, &symbols, time);
        map.insert(d.symbol, value);
        all.push((symbols, value));
    }
    let mut form = form.clone();
    substitute(&mut model.pool, &mut form, &map, |region| region.is_none());
    for (m, law) in model.memories.iter().zip(&mut form.memories) {
        if m.sampling.is_none() {
            *law = model.pool.substitute(*law, &map);
        }
    }
    for (d, signal) in model.delays.iter().zip(&mut form.delays) {
        if d.periods.is_none() {
            *signal = model.pool.substitute(*signal, &map);
        }
    }
    for rate in &mut form.integrals {
        *rate = model.pool.substitute(*rate, &map);
    }
    (Cow::Owned(form), all)
}

/// Newton's form of the polynomial: `a0 + (s - s0) (a1 + (s - s1) (a2 + ...))`.
fn polynomial(pool: &mut Pool, symbols: &[Symbol], time: Symbol) -> Expr {
    let [t, rate, since] = [time, symbols[NODES.len()], symbols[NODES.len() + 1]].map(|s| pool.var(s));
    let past = pool.sub(t, since);
    let s = pool.mul(past, rate);
    let mut value = pool.var(symbols[NODES.len() - 1]);
    let one = pool.int(1);
    for (a, node) in symbols.iter().zip(NODES).take(NODES.len() - 1).rev() {
        let ahead = pool.combine(&[(s, Number::ONE), (one, Number::float(-node))]);
        let more = pool.mul(ahead, value);
        let a = pool.var(*a);
        value = pool.add(a, more);
    }
    value
}

/// Replaces symbols in what the regions of these `sampled` blocks are made of.
fn substitute(pool: &mut Pool, form: &mut Form, map: &FxHashMap<Symbol, Expr>, is_in: impl Fn(Option<usize>) -> bool) {
    let inside: Vec<bool> = form.regions.iter().map(|r| is_in(r.sampling)).collect();
    let mut put = |e: &mut Expr| *e = pool.substitute(*e, map);
    let of_row = |row: &mut Row, put: &mut dyn FnMut(&mut Expr)| row.iter_mut().for_each(|t| put(&mut t.1));
    let of_output = |how: &mut Output, put: &mut dyn FnMut(&mut Expr)| match how {
        Output::Explicit(e) | Output::Implicit { residual: e, .. } => put(e),
        Output::Curve { out, residual, weight, .. } => [out, residual, weight].into_iter().for_each(put),
    };
    for c in form.columns.iter_mut().filter(|c| inside[c.region.at()]) {
        of_row(&mut c.row, &mut put);
        if let Role::Source(value) = &mut c.role {
            put(value);
        }
    }
    for r in form.regions.iter_mut().filter(|r| is_in(r.sampling)) {
        r.groups.iter_mut().flat_map(|g| g.coenergy.iter_mut().chain([&mut g.energy])).for_each(&mut put);
        r.resistors.iter_mut().for_each(|(_, how)| of_output(how, &mut put));
        r.steep.values_mut().chain(r.leaky.values_mut()).for_each(|how| of_output(how, &mut put));
        r.gains.values_mut().for_each(|row| of_row(row, &mut put));
        r.laws.values_mut().for_each(|law| put(&mut law.1));
        r.following.iter_mut().for_each(|f| [&mut f.state, &mut f.rate].into_iter().for_each(&mut put));
    }
    form.loops.iter_mut().filter(|l| inside[l.region.at()]).for_each(|l| put(&mut l.value));
}
