//! Guards: the program that says where laws switch, for steps that end there.

use crate::discretise::analysis::switching_conditions::{self, Conditions};
use crate::discretise::choice::Accuracy;
use crate::discretise::cluster::{Cluster, missing, verified};
use crate::discretise::equations::inputs;
use crate::discretise::steppers::Method;
use crate::expression::{Expr, Lowering, Node};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Program, Unary};
use bond_runtime::scene::{Guards, Properties};

/// The guards of a cluster, and its step along one branch where that looks beyond them; None where nothing switches
/// within a step. `method` is None of a stepper that nobody can ask for.
pub(crate) fn guards(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    (method, properties): (Option<Method>, Properties),
    accuracy: Accuracy,
) -> Result<Option<Guards>, Vec<Diagnostic>> {
    let Some(found) = switching_conditions::find(c, model, form, accuracy == Accuracy::Uncut) else { return Ok(None) };
    let wide = found.guards.iter().any(|g| model.pool.contains_any(*g, &|s| found.loops.contains(&s)));
    let program = program(c, model, form, &found, wide)?;
    let is_floor = |n: &Node| matches!(n, Node::Unary(Unary::Floor, _));
    let jumps = found.guards.iter().any(|e| model.pool.any_node(*e, &is_floor));
    let count = found.guards.len();
    let alone = |e: &Expr| model.pool.symbols(*e).iter().all(|s| Some(*s) == c.time);
    let times = (0..count).filter(|k| alone(&found.guards[*k])).collect();
    let at = |(e, guard): &(Expr, Expr)| Some((*e, found.guards.binary_search(guard).ok()?));
    let switches: Vec<(Expr, usize)> = found.switches.iter().filter_map(at).collect();
    let branch = match method {
        Some(method) => method.write_branch(c, model, form, &switches)?,
        None => None,
    };
    let loops = if wide { found.loops.len() } else { 0 };
    Ok(Some(Guards { program, count, loops, times, ends: properties.stiffly_accurate, branch, jumps }))
}

/// The program of the guards; where they depend on loops (`wide`), of the loops' residuals and of the slopes of both
/// too.
fn program(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    found: &Conditions,
    wide: bool,
) -> Result<Program, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "guards"));
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let guards: Vec<(String, Expr)> = found.guards.iter().map(|g| (model.pool.print(*g), *g)).collect();
    let mut list = guards.clone();
    if wide {
        for (z, guess) in found.loops.iter().zip(&inputs.guesses) {
            lowering.bind(*z, *guess);
        }
        let names: Vec<String> = found.loops.iter().map(|z| model.pool.name(*z).to_string()).collect();
        list.extend(names.iter().zip(&found.residuals).map(|(z, r)| (format!("residual of {z}"), *r)));
        for (what, e) in names.iter().cloned().zip(found.residuals.iter().copied()).chain(guards) {
            let slopes = model.pool.derivatives(e, &found.loops);
            list.extend(names.iter().zip(slopes).map(|(z, d)| (format!("d {what} / d {z}"), d)));
        }
    }
    for (name, e) in list {
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, name);
        b.store(slot, v);
    }
    verified(model, b.finish())
}
