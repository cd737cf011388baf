//! Probes and expectations: a program over signals of all clusters.

use crate::discretise::cluster::{input_of, is_time, verified};
use crate::expression::{Expr, Lowering, Node, Pool, Symbol};
use crate::model::{ExpectationKind, Model};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Program, Unary};
use bond_runtime::scene::{self, Probes};
use rustc_hash::FxHashSet;

/// All symbols that probes and expectations read, in a fixed order, without time.
pub(crate) fn wanted(model: &Model, form: &Form) -> Vec<Symbol> {
    let extremes = model.expectations.iter().filter_map(|x| match &x.kind {
        ExpectationKind::Holds { extremes, .. } => Some(extremes.iter().map(|e| e.0)),
        ExpectationKind::Passive | ExpectationKind::PassiveAt(_) | ExpectationKind::At { .. } => None,
    });
    let mut seen: FxHashSet<Symbol> = extremes.flatten().collect();
    let mut list = Vec::new();
    for e in form.probes.iter().chain(form.expectations.iter().flatten()) {
        for s in model.pool.symbols(*e) {
            if seen.insert(s) && !is_time(model, s) && input_of(model, s).is_none() {
                list.push(s);
            }
        }
    }
    list
}

/// Conditions that compare extremes over the run with what changes in it.
pub(crate) fn mixed(model: &Model, form: &Form) -> Vec<Diagnostic> {
    let what = "this condition mixes an extreme over the run with a signal that changes in it";
    let help = "compare extremes with numbers and with one another: `max(x - 2*y) < 0 m` for `max(x) < 2*y`";
    let is_mixed = |kind: &ExpectationKind, list: &[Expr]| match (kind, list.first()) {
        (ExpectationKind::Holds { extremes, .. }, Some(condition)) if !extremes.is_empty() => {
            of_extremes(model, *condition, extremes).is_none()
        }
        _ => false,
    };
    let all = model.expectations.iter().zip(&form.expectations);
    all.filter(|(x, list)| is_mixed(&x.kind, list))
        .map(|(x, _)| Diagnostic::error("discretise::expect", x.span, what).help(help))
        .collect()
}

/// Writes the program. `place` says which cluster shows a symbol, and as which output of its observation.
pub(crate) fn build(model: &mut Model, form: &Form, place: &dyn Fn(Symbol) -> Option<(usize, usize)>) -> Probes {
    let mut b = Builder::new("probes");
    let t = b.named(Array::Input, "t");
    let t = b.load(t);
    let mut lowering = Lowering::new([]);
    let mut gather = Vec::new();
    for s in wanted(model, form) {
        let Some(at) = place(s) else { continue };
        gather.push(at);
        let slot = b.named(Array::Input, model.pool.name(s));
        let v = b.load(slot);
        lowering.bind(s, v);
    }
    let mut given = Vec::new();
    for (i, input) in model.inputs.iter().enumerate() {
        let slot = b.named(Array::Input, input.name.clone());
        let v = b.load(slot);
        lowering.bind(input.symbol, v);
        given.push(i);
    }
    let time: Vec<Symbol> =
        model.signals.iter().filter(|(_, s)| **s == crate::model::Signal::Time).map(|(s, _)| *s).collect();
    for s in time {
        lowering.bind(s, t);
    }
    let put = |model: &Model, b: &mut Builder, lowering: &mut Lowering, name: &str, e: Expr| -> usize {
        let slot = b.named(Array::Output, name);
        let v = match lowering.lower(&model.pool, b, e) {
            Ok(v) => v,
            Err(_) => b.number(f64::NAN),
        };
        b.store(slot, v);
        slot.index as usize
    };
    let mut probes = Probes::default();
    for (p, e) in model.probes.iter().zip(&form.probes) {
        put(model, &mut b, &mut lowering, &p.name, *e);
        probes.names.push(p.name.clone());
        probes.units.push(p.unit.as_ref().map(ToString::to_string));
    }
    let mut watched = 0;
    for (x, list) in model.expectations.iter().zip(&form.expectations) {
        let kind = match &x.kind {
            ExpectationKind::Passive => scene::ExpectationKind::Passive,
            ExpectationKind::PassiveAt(_) => {
                watched += 1;
                scene::ExpectationKind::PassiveAt(watched - 1)
            }
            ExpectationKind::At { time, target, tolerance, .. } => {
                let output = list.first().map_or(0, |e| put(model, &mut b, &mut lowering, &x.text, *e));
                scene::ExpectationKind::At { output, time: *time, target: *target, tolerance: *tolerance }
            }
            ExpectationKind::Holds { extremes, .. } => {
                let outputs: Vec<(usize, bool)> = extremes
                    .iter()
                    .zip(list.iter().skip(1))
                    .map(|((_, _, largest), e)| (put(model, &mut b, &mut lowering, &x.text, *e), *largest))
                    .collect();
                let Some(&condition) = list.first() else { continue };
                let condition = affirmed(&mut model.pool, condition, true);
                if outputs.is_empty() {
                    let output = put(model, &mut b, &mut lowering, &x.text, condition);
                    scene::ExpectationKind::Holds { extremes: outputs, output, program: None }
                } else {
                    let program = of_extremes(model, condition, extremes);
                    scene::ExpectationKind::Holds { extremes: outputs, output: 0, program }
                }
            }
        };
        probes.expectations.push(scene::Expectation { text: x.text.clone(), kind });
    }
    probes.gather = gather;
    probes.inputs = given;
    probes.program = verified(model, b.finish()).ok();
    probes
}

/// A condition, or its contrary, without the negation of a comparison: of what is no number none holds, `x != 3` as
/// little as `x < 3`.
fn affirmed(pool: &mut Pool, e: Expr, holds: bool) -> Expr {
    match (pool.node(e).clone(), holds) {
        (Node::Unary(Unary::Not, a), _) => affirmed(pool, a, !holds),
        (Node::Binary(f @ (Binary::And | Binary::Or), a, b), _) => {
            let (a, b) = (affirmed(pool, a, holds), affirmed(pool, b, holds));
            let both = (f == Binary::And) == holds;
            pool.binary(if both { Binary::And } else { Binary::Or }, a, b)
        }
        (Node::Binary(Binary::Lt, a, b), false) => pool.binary(Binary::Le, b, a),
        (Node::Binary(Binary::Le, a, b), false) => pool.binary(Binary::Lt, b, a),
        (Node::Binary(Binary::Eq, a, b), false) => {
            let (below, above) = (pool.binary(Binary::Lt, a, b), pool.binary(Binary::Lt, b, a));
            pool.binary(Binary::Or, below, above)
        }
        (_, true) => e,
        (_, false) => pool.unary(Unary::Not, e),
    }
}

/// The condition as a program of the extremes alone; `None` where it reads other signals too.
fn of_extremes(model: &Model, condition: Expr, extremes: &[(Symbol, Expr, bool)]) -> Option<Program> {
    let mut b = Builder::new("expectation");
    let mut lowering = Lowering::new([]);
    for (s, ..) in extremes {
        let slot = b.named(Array::Input, model.pool.name(*s));
        let v = b.load(slot);
        lowering.bind(*s, v);
    }
    let v = lowering.lower(&model.pool, &mut b, condition).ok()?;
    let slot = b.named(Array::Output, "holds");
    b.store(slot, v);
    verified(model, b.finish()).ok()
}
