//! What is stored: energies, how they bend, and what their states are uncertain by.

use crate::discretise::analysis::curvature;
use crate::discretise::cluster::{Cluster, missing, verified};
use crate::discretise::equations::inputs;
use crate::expression::{Expr, Lowering, Node, Pool, Symbol};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Program, Unary};
use rustc_hash::{FxHashMap, FxHashSet};

/// Writes what is stored: H of each region, then the curvature and the resolution of each state. `energy` is the size
/// of the scene's energies.
pub(crate) fn stored(c: &Cluster, model: &mut Model, form: &Form, energy: f64) -> Result<Program, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "what is stored"));
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let mut list: Vec<(String, Expr)> = Vec::new();
    for r in &c.regions {
        list.push((format!("H({})", form.regions[r.at()].name), c.energy(&mut model.pool, *r)));
    }
    let curvatures = curvature::curvatures(c, model);
    let grains = resolutions(c, model, form, (&curvatures, energy));
    list.extend(c.states.iter().zip(curvatures).map(|(s, k)| (format!("curvature({})", s.name), k)));
    list.extend(c.states.iter().zip(grains).map(|(s, k)| (format!("grain({})", s.name), k)));
    for (name, e) in list {
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, name);
        b.store(slot, v);
    }
    verified(model, b.finish())
}

/// What the co-energy variable of each state is uncertain by where a curve has a corner: about there the curve's
/// parameter is rounded by a part of itself, however little it is beyond the corner. A block that dry friction lets go,
/// at s = 1, has no speed between 0 and the rounding of 1. Where multipliers tie storages, forces balance that are as
/// large as those which move the scene: what they keep at rest, as the coupler of a parallelogram, turns by what the
/// speeds of all round to. Of a state without energy, what its rate is uncertain by for that.
fn resolutions(c: &Cluster, model: &mut Model, form: &Form, (curvatures, energy): (&[Expr], f64)) -> Vec<Expr> {
    let mut list = vec![model.pool.int(0); c.states.len()];
    for node in c.loop_nodes() {
        let Output::Curve { residual, parameter, .. } = node.how else { continue };
        let pool = &mut model.pool;
        let corner = corner(pool, residual, parameter);
        let along = pool.derivative(residual, parameter);
        let slope = [1.5, -1.5].map(|part| {
            let beyond = pool.float(part * corner);
            let there = pool.substitute(along, &FxHashMap::from_iter([(parameter, beyond)]));
            pool.constant(there).map_or(0.0, f64::abs)
        });
        let off = 4.0 * f64::EPSILON * corner * slope[0].max(slope[1]);
        if !(off > 0.0 && off.is_finite()) {
            continue;
        }
        for (s, grain) in c.states.iter().zip(&mut list) {
            let Some(column) = s.column else { continue };
            let by = pool.derivative(residual, form.column(column).out);
            if let Some(by) = pool.constant(by).filter(|k| *k != 0.0 && k.is_finite()) {
                let more = pool.float(off / by.abs());
                *grain = pool.add(*grain, more);
            }
        }
    }
    let multipliers: Vec<Symbol> = c.loop_nodes().iter().filter(|n| n.constraint().is_some()).map(|n| n.out).collect();
    let pool = &mut model.pool;
    for ((s, grain), curvature) in c.states.iter().zip(&mut list).zip(curvatures) {
        if multipliers.iter().any(|m| pool.contains(s.rate, *m)) {
            let rounding = pool.float(4.0 * f64::EPSILON * (2.0 * energy).sqrt());
            let bend = pool.unary(Unary::Sqrt, *curvature);
            let more = pool.mul(rounding, bend);
            *grain = pool.add(*grain, more);
        }
    }
    let stores: Vec<bool> = curvatures.iter().map(|k| !pool.is_zero(*k)).collect();
    let mut known: Vec<(Symbol, Expr)> = (c.states.iter().zip(&list).zip(&stores))
        .filter(|((_, grain), stores)| **stores && !pool.is_zero(**grain))
        .filter_map(|((s, grain), _)| Some((form.column(s.column?).out, *grain)))
        .collect();
    let speeds = massless(c, model, form, &known);
    known.extend(speeds);
    let pool = &mut model.pool;
    for ((s, grain), _) in c.states.iter().zip(&mut list).zip(&stores).filter(|(_, stores)| !**stores) {
        let by = pool.derivatives(s.rate, &known.iter().map(|k| k.0).collect::<Vec<_>>());
        let mut parts = Vec::new();
        for (by, (_, grain)) in by.into_iter().zip(&known) {
            if let Some(by) = pool.constant(by) {
                let by = pool.float(by.abs());
                parts.push(pool.mul(by, *grain));
            }
        }
        *grain = pool.sum(&parts);
    }
    list
}

/// What each speed without inertia is uncertain by, as the constraints tell it from what storages are.
fn massless(c: &Cluster, model: &mut Model, form: &Form, known: &[(Symbol, Expr)]) -> Vec<(Symbol, Expr)> {
    let of: FxHashMap<Symbol, Expr> = known.iter().copied().collect();
    let is_state = |s: &Symbol| c.states.iter().any(|state| state.symbol == *s);
    let constraints: Vec<ColumnId> = c.loop_nodes().iter().filter_map(|n| n.constraint()).collect();
    let is_massless = |c: &ColumnId| model.element(form.column(*c).element).is_massless();
    let (speeds, ties): (Vec<ColumnId>, Vec<ColumnId>) = constraints.into_iter().partition(is_massless);
    let mut found = Vec::new();
    for speed in speeds {
        let (mut parts, mut squares) = (Vec::new(), Vec::new());
        for &tie in &ties {
            let Some(a) = form.entry(tie, speed) else { continue };
            let pool = &mut model.pool;
            squares.push(pool.powi(a, 2));
            for (j, k) in &form.column(tie).row {
                let Some(grain) = of.get(&form.column(*j).out) else { continue };
                let k = pool.mul(a, *k);
                let k = pool.unary(Unary::Abs, k);
                parts.push(pool.mul(k, *grain));
            }
        }
        let pool = &mut model.pool;
        let (part, square) = (pool.sum(&parts), pool.sum(&squares));
        let grain = pool.div(part, square);
        if pool.symbols(grain).iter().all(is_state) {
            found.push((form.column(speed).out, grain));
        }
    }
    found
}

/// The largest number, by magnitude, that an expression compares a symbol with.
fn corner(pool: &Pool, e: Expr, with: Symbol) -> f64 {
    let (mut seen, mut stack) = (FxHashSet::default(), vec![e]);
    let mut largest = 0.0f64;
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        let node = pool.node(e);
        if let Node::Binary(Binary::Min | Binary::Max | Binary::Lt | Binary::Le, a, b) = node {
            for (x, y) in [(*a, *b), (*b, *a)] {
                if let Some(k) = pool.constant(y).filter(|_| pool.contains_any(x, &|s| s == with)) {
                    largest = largest.max(k.abs());
                }
            }
        }
        node.each_child(&mut |child| stack.push(child));
    }
    largest
}
