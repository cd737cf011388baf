//! The differential equations of a region, written out: what each state's rate is, in states, inputs and time.

use super::name;
use super::size::SIZES;
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output, Region};
use rustc_hash::FxHashMap;

/// An output that no formula was found for.
pub(super) struct Unknown {
    /// `pipe.f`
    pub(super) name: String,
    /// What it equals, or what is 0.
    pub(super) law: Expr,
    /// True where `law` is what must be 0.
    pub(super) root: bool,
}

/// The equations of a region.
pub(super) struct Equations {
    /// dx/dt of each state.
    pub(super) rates: Vec<Expr>,
    /// The conjugates of the inputs: name and value, as a signal of the bond.
    pub(super) outputs: Vec<(String, Expr)>,
    /// Unknowns that stand in them.
    pub(super) unknowns: Vec<Unknown>,
    /// Resistors that depend on one another, loop by loop, and whether the loop was solved.
    pub(super) loops: Vec<(Vec<ColumnId>, bool)>,
}

/// Writes out the equations of a region.
pub(super) fn equations(model: &mut Model, form: &Form, region: &Region, names: &[String]) -> Equations {
    let pool = &mut model.pool;
    let mut known: FxHashMap<Symbol, Expr> = FxHashMap::default();
    for &c in &region.inputs {
        let port = name::port(form, names, c);
        let u = pool.symbol(&port.input);
        let u = pool.var(u);
        let z = if port.turned { pool.neg(u) } else { u };
        known.insert(form.column(c).out, z);
    }
    for g in &region.groups {
        for (s, z) in g.states.iter().zip(&g.coenergy) {
            known.insert(form.column(region.states[*s].column).out, *z);
        }
    }
    let (unknowns, loops) = resistors(pool, form, region, names, &mut known);
    let mut input = |c: ColumnId| {
        let all = form.input(pool, c);
        replace(pool, all, &known)
    };
    let rates = region.states.iter().map(|s| input(s.column)).collect();
    let inputs: Vec<Expr> = region.inputs.iter().map(|c| input(*c)).collect();
    let outputs = region
        .inputs
        .iter()
        .zip(inputs)
        .map(|(c, e)| {
            let column = form.column(*c);
            let name = format!("{}.{}", names[c.at()], column.gives.other().letter());
            let against = column.sign_of(column.gives.other()) < 0;
            (name, if against { pool.neg(e) } else { e })
        })
        .collect();
    Equations { rates, outputs, unknowns, loops }
}

/// What is known put in. Only what occurs is handed on, since a substitution looks at its whole map.
fn replace(pool: &mut Pool, e: Expr, known: &FxHashMap<Symbol, Expr>) -> Expr {
    let map = pool.symbols(e).into_iter().filter_map(|s| Some((s, *known.get(&s)?))).collect();
    pool.substitute(e, &map)
}

/// Adds the outputs of the resistors to what is known, those first on which others depend.
fn resistors(
    pool: &mut Pool,
    form: &Form,
    region: &Region,
    names: &[String],
    known: &mut FxHashMap<Symbol, Expr>,
) -> (Vec<Unknown>, Vec<(Vec<ColumnId>, bool)>) {
    let law = |i: usize| match region.resistors[i].1 {
        Output::Explicit(e) | Output::Implicit { residual: e, .. } | Output::Curve { residual: e, .. } => e,
    };
    let (mut unknowns, mut loops) = (Vec::new(), Vec::new());
    for members in region.components(pool, form) {
        let outs: Vec<Symbol> = members.iter().map(|i| form.column(region.resistors[*i].0).out).collect();
        let laws: Vec<Expr> = members.iter().map(|i| replace(pool, law(*i), known)).collect();
        let explicit = members.iter().all(|i| matches!(region.resistors[*i].1, Output::Explicit(_)));
        if let (&[law], &[out], true) = (&laws[..], &outs[..], explicit)
            && !pool.contains(law, out)
        {
            known.insert(out, law);
            continue;
        }
        let solved = if explicit && members.len() <= SIZES.written_loop { solve(pool, &laws, &outs) } else { None };
        loops.push((members.iter().map(|i| region.resistors[*i].0).collect(), solved.is_some()));
        match solved {
            Some(values) => known.extend(outs.into_iter().zip(values)),
            None => {
                for (i, law) in members.iter().zip(laws) {
                    let (c, how) = region.resistors[*i];
                    let mut name = format!("{}.{}", names[c.at()], form.column(c).gives.letter());
                    if let Output::Curve { parameter, out, .. } = how {
                        let law = replace(pool, out, known);
                        unknowns.push(Unknown { name, law, root: false });
                        name = pool.name(parameter).to_string();
                    }
                    unknowns.push(Unknown { name, law, root: how.is_root() });
                }
            }
        }
    }
    (unknowns, loops)
}

/// The solution of `z = laws(z)` where the laws are affine in `z`; `None` where they are not, or the system is
/// singular.
fn solve(pool: &mut Pool, laws: &[Expr], outs: &[Symbol]) -> Option<Vec<Expr>> {
    let n = outs.len();
    let (zero, one) = (pool.zero(), pool.one());
    let size = |pool: &Pool, e: Expr| {
        let x = pool.eval(e, &|s| 0.37 + 0.21 * f64::from(s.0 % 11)).abs();
        if x.is_finite() { x } else { 0.0 }
    };
    let mut w: Vec<Vec<Expr>> = Vec::new();
    for (i, law) in laws.iter().enumerate() {
        let (linear, rest) = pool.affine(*law, outs)?;
        let mut row = vec![zero; n + 1];
        for (j, a) in linear {
            row[j] = pool.neg(a);
        }
        row[i] = pool.add(row[i], one);
        row[n] = rest;
        w.push(row);
    }
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| size(pool, w[*i][k]).total_cmp(&size(pool, w[*j][k])))?;
        if size(pool, w[pivot][k]) == 0.0 {
            return None;
        }
        w.swap(k, pivot);
        let p = w[k][k];
        for x in &mut w[k][k..] {
            *x = pool.div(*x, p);
        }
        let row = w[k].clone();
        for (_, other) in w.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let f = other[k];
            for (x, y) in other.iter_mut().zip(&row).skip(k) {
                let t = pool.mul(f, *y);
                *x = pool.sub(*x, t);
            }
        }
    }
    Some(w.into_iter().map(|row| row[n]).collect())
}
