//! The equations of a step by the discrete gradient, and what their iteration measures its unknowns against.

use crate::discretise::analysis::{curvature, polynomial};
use crate::discretise::cluster::{Cluster, Group, Part, missing};
use crate::discretise::equations::error_weights;
use crate::discretise::equations::inputs::Inputs;
use crate::expression::{Expr, Lowering, Node, Pool, Symbol};
use crate::model::{Model, Variable};
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Builder, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// Among more states than this some may be moved by less than has a square.
const FAR: usize = 16;

/// States at the midpoint, storages' outputs as discrete gradients, time at the midpoint (of what is sampled, at its
/// sample).
pub(crate) fn midpoint(c: &Cluster, pool: &mut Pool, form: &Form) -> FxHashMap<Symbol, Expr> {
    let mut map = FxHashMap::default();
    let half = pool.ratio(1, 2);
    states_within(c, pool, half, &mut map);
    source_driven(c, pool, form, &mut map);
    let sources: FxHashSet<Symbol> = c.nodes.iter().filter(|n| n.source().is_some()).map(|n| n.out).collect();
    let gradients: Vec<Vec<Expr>> = c.groups.iter().map(|g| gradient(c, pool, g, (&map, &sources))).collect();
    for (g, list) in c.groups.iter().zip(gradients) {
        for (s, z) in g.states.iter().zip(list) {
            if let Some(column) = c.states[*s].column {
                map.insert(form.column(column).out, z);
            }
        }
    }
    time_within(c, pool, half, &mut map);
    map
}

/// States, time and inputs at a part of the straight way that a step takes.
pub(crate) fn within(c: &Cluster, pool: &mut Pool, part: Expr) -> FxHashMap<Symbol, Expr> {
    let mut map = FxHashMap::default();
    states_within(c, pool, part, &mut map);
    time_within(c, pool, part, &mut map);
    map
}

fn states_within(c: &Cluster, pool: &mut Pool, part: Expr, map: &mut FxHashMap<Symbol, Expr>) {
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        let d = pool.mul(part, d);
        map.insert(s.symbol, pool.add(x, d));
    }
}

/// What is sampled has time, as all that it is given, from its sample.
fn time_within(c: &Cluster, pool: &mut Pool, part: Expr, map: &mut FxHashMap<Symbol, Expr>) {
    let (Some(t), Some(h), None) = (c.time, c.h, c.sampling) else { return };
    let (te, he) = (pool.var(t), pool.var(h));
    let he = pool.mul(part, he);
    map.insert(t, pool.add(te, he));
    for &(_, u, du) in &c.inputs {
        let (ue, due) = (pool.var(u), pool.var(du));
        let ahead = pool.mul(he, due);
        map.insert(u, pool.add(ue, ahead));
    }
}

/// The discrete gradient of a group's energy.
///
/// Of one state it is the difference quotient; of a quadratic energy the gradient at the midpoint. Else the coordinate
/// increments of Itoh and Abe (J. Comput. Phys. 76, 1988), which move one state after the other, in the order of the
/// states and in the opposite one: each satisfies g . d = H(x + d) - H(x), and so does their mean, which is symmetric
/// and so of order 2. Unlike Gonzalez' correction along d it asks for no common unit of the states, and each quotient
/// is written without cancellation.
pub(crate) fn gradient(
    c: &Cluster,
    pool: &mut Pool,
    g: &Group,
    (middle, sources): (&FxHashMap<Symbol, Expr>, &FxHashSet<Symbol>),
) -> Vec<Expr> {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    // Of storages that follow sources the outputs are no derivatives of H alone: they are quadratic, and so affine.
    let driven = g.coenergy.iter().any(|z| pool.contains_any(*z, &|s| sources.contains(&s)));
    if let ([only], [s], false) = (&g.states[..], &symbols[..], driven) {
        let (x, d) = (pool.var(*s), pool.var(c.delta[*only]));
        let slope = pool.difference(g.energy, *s, x, d);
        // The last of many are moved by powers of what the first are: there even squares are nothing.
        let far = c.states.len() > FAR && pool.any_node(g.energy, &|n| matches!(n, Node::Select(..)));
        let slope = if far { pool.beyond_nothing((g.energy, *s), slope, x, d) } else { slope };
        let near = c.energy_form(pool, g).near.first();
        return vec![near.map_or(slope, |term| term.near.slope(pool, d, slope))];
    }
    if g.coenergy.iter().all(|z| polynomial::is_affine(pool, *z, &symbols)) {
        return g.coenergy.iter().map(|z| pool.substitute(*z, middle)).collect();
    }
    let half = pool.ratio(1, 2);
    let level = c.energy_form(pool, g);
    let ends: Vec<Expr> = g
        .states
        .iter()
        .map(|s| {
            let (x, d) = (pool.var(c.states[*s].symbol), pool.var(c.delta[*s]));
            pool.add(x, d)
        })
        .collect();
    (0..g.states.len())
        .map(|i| {
            let mut quotient = |moved: std::ops::Range<usize>| {
                let map: FxHashMap<Symbol, Expr> = moved.map(|j| (symbols[j], ends[j])).collect();
                let energy = pool.substitute(level.rest, &map);
                let (x, d) = (pool.var(symbols[i]), pool.var(c.delta[g.states[i]]));
                pool.difference(energy, symbols[i], x, d)
            };
            let (up, down) = (quotient(0..i), quotient(i + 1..g.states.len()));
            let sum = pool.add(up, down);
            let slope = pool.mul(half, sum);
            let Some(term) = level.near.iter().find(|t| t.place == i) else { return slope };
            let (x, d) = (pool.var(symbols[i]), pool.var(c.delta[g.states[i]]));
            let own = pool.difference(term.energy, symbols[i], x, d);
            let own = term.near.slope(pool, d, own);
            pool.add(slope, own)
        })
        .collect()
}

/// A storage that follows sources takes the change of its state over the step; the sources give the mean of their ends,
/// so that the change of its energy, a square, is the work done on it.
fn source_driven(c: &Cluster, pool: &mut Pool, form: &Form, map: &mut FxHashMap<Symbol, Expr>) {
    let (Some(t), Some(h)) = (c.time, c.h) else { return };
    let (te, he, half) = (pool.var(t), pool.var(h), pool.ratio(1, 2));
    let later = pool.add(te, he);
    let mut end: FxHashMap<Symbol, Expr> = FxHashMap::default();
    for (s, d) in c.states.iter().zip(&c.delta) {
        let (x, d) = (pool.var(s.symbol), pool.var(*d));
        end.insert(s.symbol, pool.add(x, d));
    }
    end.insert(t, later);
    let driving_sources: FxHashSet<ColumnId> = c.driving_sources.iter().copied().collect();
    for n in &c.nodes {
        match (n.part, n.how) {
            (Part::Source(column), Output::Explicit(e)) if driving_sources.contains(&column) => {
                let after = pool.substitute(e, &end);
                let sum = pool.add(e, after);
                map.insert(form.column(column).out, pool.mul(half, sum));
            }
            (Part::SourceDriven(state), _) => {
                let after = pool.substitute(state, &end);
                let change = pool.sub(after, state);
                map.insert(n.out, pool.div(change, he));
            }
            (Part::Source(_) | Part::Resistor(_) | Part::Signal | Part::Multiplier(_), _) => {}
        }
    }
}

/// The step's unknowns with their residuals: changes of the states, then loops.
pub(crate) fn system(c: &Cluster, pool: &mut Pool, flat: &FxHashMap<Symbol, Expr>) -> (Vec<Symbol>, Vec<Expr>) {
    let mut unknowns = c.delta.clone();
    let mut residuals = Vec::new();
    if let Some(h) = c.h {
        let h = pool.var(h);
        for (s, d) in c.states.iter().zip(&c.delta) {
            let rate = pool.substitute(s.rate, flat);
            let step = pool.mul(h, rate);
            let d = pool.var(*d);
            residuals.push(pool.sub(d, step));
        }
    }
    residuals.extend(c.residuals_in(pool, flat));
    unknowns.extend(c.loops.iter().copied());
    (unknowns, residuals)
}

/// Weights and scales of the step's unknowns.
pub(crate) fn measures(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    inputs: &Inputs,
) -> Result<(Vec<Value>, Vec<Value>), Vec<Diagnostic>> {
    let mut weight = Vec::new();
    for k in curvature::curvatures(c, model) {
        weight.push(lowering.lower(&model.pool, b, k).map_err(|s| missing(model, s))?);
    }
    if let Some(h) = c.h {
        let h = model.pool.var(h);
        weight.extend(error_weights::weights_of_loops(c, model, form, b, lowering, &inputs.guesses, h)?);
    }
    let h = c.h.map(|h| model.pool.var(h));
    let scale =
        error_weights::scales(c, model, form, b, lowering, (&inputs.states, &inputs.traces, &inputs.guesses), h)?;
    Ok((weight, scale))
}

/// Number of states above which exact coefficients are not worth their time, where all is linear.
const MANY: usize = 64;

/// Whether the fastest motion of a region is far faster than the slowest, or than a step, as its energies bend at the
/// start. How far a stiff spring between two bodies is drawn out is a small difference of how far these go in a step:
/// where it follows from their momenta, the rounding of that is a force that the iteration cannot take back; as an
/// unknown of its own it has its own digits.
pub(crate) fn is_stiff(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let start = c.start(model);
    // Stiffnesses and inverse inertias: the least and the largest.
    let mut bends = [(f64::INFINITY, 0.0f64); 2];
    for (s, k) in c.states.iter().zip(curvature::curvatures(c, model)) {
        let Some(column) = s.column else { continue };
        let k = start.eval(&model.pool, k);
        if k > 0.0 && k.is_finite() {
            let (least, most) = &mut bends[usize::from(form.column(column).gives == Variable::Flow)];
            (*least, *most) = (least.min(k), most.max(k));
        }
    }
    let [(soft, hard), (heavy, light)] = bends;
    let by = model.settings.thresholds.stiffness;
    hard * light > by.spread * soft * heavy || hard * light * start.step * start.step > by.long
}

/// Whether coefficients are taken as they stand. What rounding takes from states and coefficients is seen where nothing
/// else takes energy; of many states that are linear it is not worth its time.
pub(crate) fn keeps_coefficients(c: &Cluster, pool: &mut Pool) -> bool {
    c.is_lossless() && (c.states.len() <= MANY || !polynomial::all_quadratic(c, pool))
}
