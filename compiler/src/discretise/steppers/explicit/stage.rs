//! A stage of an explicit method.

use crate::discretise::cluster::{Cluster, missing};
use crate::discretise::equations::{angle_addition, ledger, output_equations};
use crate::expression::{Expr, Lowering};
use crate::model::{Model, Variable};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Builder, Value};

/// What a stage gives.
pub(super) struct Stage {
    pub(super) rates: Vec<Value>,
    pub(super) integrals: Vec<Value>,
    pub(super) means: Vec<Value>,
    /// Power of each column of the ledger: sources and ports, then resistors, region by region.
    pub(super) powers: Vec<Value>,
    /// What the storages of each block take in, where its region has several.
    pub(super) intakes: Vec<Value>,
    pub(super) loops: Vec<Value>,
}

/// What something changes by in a time `h`, by its rates at the stages with these weights. The last one is added last,
/// with a weight that `h` was multiplied with before: the next stage waits for it, and for nothing else.
pub(super) fn change(
    b: &mut Builder,
    h: Value,
    stages: &[Stage],
    weights: &[f64],
    pick: &dyn Fn(&Stage) -> Value,
) -> Value {
    let of = |b: &mut Builder, weights: &[f64]| {
        let rate = sum(b, stages, weights.iter().copied(), pick);
        b.mul(h, rate)
    };
    let last = weights.iter().rposition(|w| *w != 0.0).unwrap_or(0);
    match weights.split_at_checked(last) {
        Some((before, [w, ..])) if before.iter().any(|w| *w != 0.0) => {
            let d = of(b, before);
            let w = b.number(*w);
            let w = b.mul(h, w);
            let end = b.mul(w, pick(&stages[last]));
            b.add(d, end)
        }
        _ => of(b, weights),
    }
}

/// The sum of something of the stages with these weights; nothing is added where a weight is 0.
pub(super) fn sum(
    b: &mut Builder,
    stages: &[Stage],
    weights: impl Iterator<Item = f64>,
    pick: &dyn Fn(&Stage) -> Value,
) -> Value {
    let mut sum = None;
    for (stage, w) in stages.iter().zip(weights).filter(|(_, w)| *w != 0.0) {
        let w = b.number(w);
        let term = b.mul(w, pick(stage));
        sum = Some(match sum {
            Some(s) => b.add(s, term),
            None => term,
        });
    }
    sum.unwrap_or_else(|| b.number(0.0))
}

/// What a stage gives, at what is bound; the powers of `intakes` are had with it.
pub(super) fn stage(
    c: &Cluster,
    (model, form): (&mut Model, &Form),
    b: &mut Builder,
    lowering: &mut Lowering,
    guesses: &[Value],
    intakes: &[Expr],
) -> Result<Stage, Vec<Diagnostic>> {
    let flat = output_equations::outputs(
        c,
        model,
        form,
        b,
        lowering,
        (
            guesses,
            output_equations::Pull { curves: c.thresholds.regular.pull, switches: output_equations::Switched::Free },
        ),
        None,
    )?;
    let symbols = c.states.iter().map(|s| s.symbol).collect();
    angle_addition::angles(model, b, lowering, &c.energies(), &symbols)?;
    let mut lower = |model: &mut Model, b: &mut Builder, e| {
        let e = model.pool.substitute(e, &flat);
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))
    };
    let mut rates = Vec::new();
    for s in &c.states {
        rates.push(lower(model, b, s.rate)?);
    }
    let mut integrals = Vec::new();
    for i in &c.integrals {
        integrals.push(lower(model, b, i.rate)?);
    }
    let mut means = Vec::new();
    for p in &c.ports {
        let e = form.input(&mut model.pool, *p);
        means.push(lower(model, b, e)?);
    }
    let mut powers = Vec::new();
    for accounts in c.accounts(model, form) {
        let power = accounts.supplied.into_iter().map(|c| vec![c]).chain(accounts.dissipated);
        for columns in power {
            let mut sum = None;
            for column in columns {
                let (z, i) = (model.pool.var(form.column(column).out), form.input(&mut model.pool, column));
                let (z, i) = (lower(model, b, z)?, lower(model, b, i)?);
                let p = b.mul(z, i);
                sum = Some(sum.map_or(p, |s| b.add(s, p)));
            }
            powers.push(sum.unwrap_or_else(|| b.number(0.0)));
        }
        for columns in accounts.produced {
            let mut sum = b.number(0.0);
            for column in &columns {
                let s = ledger::variable(model, form, *column, Variable::Flow);
                let s = lower(model, b, s)?;
                sum = b.sub(sum, s);
            }
            let temperature = ledger::variable(model, form, columns[0], Variable::Effort);
            let temperature = lower(model, b, temperature)?;
            powers.extend([sum, b.mul(sum, temperature)]);
        }
    }
    let mut taken = Vec::new();
    for power in intakes {
        taken.push(lower(model, b, *power)?);
    }
    let mut loops = Vec::new();
    for z in &c.loops {
        let z = model.pool.var(*z);
        loops.push(lower(model, b, z)?);
    }
    Ok(Stage { rates, integrals, means, powers, intakes: taken, loops })
}
