//! Explicit Euler and the classical Runge-Kutta method, to compare with. Their steps do not keep the balance.

use super::Method;
use super::cluster::{Cluster, missing, verified};
use super::{instant, write};
use crate::expression::Lowering;
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Unary, Value};
use bond_runtime::scene::{Entries, Stepper};

/// A stage's time and state: step fraction behind it; and its weight.
const EULER: [(f64, f64); 1] = [(0.0, 1.0)];
const RK4: [(f64, f64); 4] = [(0.0, 1.0 / 6.0), (0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0)];

/// What a stage gives.
struct Stage {
    rates: Vec<Value>,
    integrals: Vec<Value>,
    means: Vec<Value>,
    /// Power of each column of the ledger: sources and ports, then resistors, region by region.
    powers: Vec<Value>,
    loops: Vec<Value>,
}

/// Writes the step.
pub(super) fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: Method,
) -> Result<(Stepper, Vec<Entries>), Vec<Diagnostic>> {
    let tableau: &[(f64, f64)] = if method == Method::Euler { &EULER } else { &RK4 };
    let mut b = Builder::new(c.title(form, &format!("{} step", method.name())));
    let entries = c.reserve(model, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut guesses = inputs.guesses.clone();
    let mut stages: Vec<Stage> = Vec::new();
    for (fraction, _) in tableau {
        let f = b.number(*fraction);
        let ahead = b.mul(f, inputs.h);
        let time = b.add(inputs.t, ahead);
        let mut lowering = Lowering::new(inputs.env.iter().copied());
        if let Some(t) = c.time {
            lowering.bind(t, time);
        }
        for ((_, u, _), (x, slope)) in c.inputs.iter().zip(&inputs.given) {
            let gone = b.mul(ahead, *slope);
            let x = b.add(*x, gone);
            lowering.bind(*u, x);
        }
        if let Some(before) = stages.last() {
            for ((s, x), k) in c.states.iter().zip(&inputs.states).zip(&before.rates) {
                let d = b.mul(ahead, *k);
                let x = b.add(*x, d);
                lowering.bind(s.symbol, x);
            }
        }
        let stage = stage(c, model, form, &mut b, &mut lowering, &guesses)?;
        guesses.clone_from(&stage.loops);
        stages.push(stage);
    }
    let weighted = |b: &mut Builder, pick: &dyn Fn(&Stage) -> Value| -> Value {
        let mut sum = None;
        for (stage, (_, w)) in stages.iter().zip(tableau) {
            let w = b.number(*w);
            let term = b.mul(w, pick(stage));
            sum = Some(match sum {
                Some(s) => b.add(s, term),
                None => term,
            });
        }
        sum.unwrap_or_else(|| b.number(0.0))
    };
    b.slots(Array::Next, c.slots());
    write::no_carry(&mut b, c);
    let mut next = Vec::new();
    for (i, x) in inputs.states.iter().chain(&inputs.integrals).enumerate() {
        let n = c.states.len();
        let rate = weighted(&mut b, &|s| if i < n { s.rates[i] } else { s.integrals[i - n] });
        let d = b.mul(inputs.h, rate);
        let v = b.add(*x, d);
        b.store(Slot::new(Array::Next, i), v);
        next.push(v);
    }
    for (i, z) in guesses.iter().enumerate() {
        b.store(Slot::new(Array::Next, c.states.len() + c.integrals.len() + i), *z);
    }
    for i in 0..c.ports.len() {
        let mean = weighted(&mut b, &|s| s.means[i]);
        b.store(Slot::new(Array::Output, i), mean);
    }
    let mut k = 0;
    for e in &entries {
        let lost = e.dissipated.iter().chain(&e.produced).map(|d| (d.1, false));
        let signs = e.supplied.iter().map(|s| (s.1, true)).chain(lost);
        for (slot, supplied) in signs {
            let p = weighted(&mut b, &|s| s.powers[k]);
            let mut w = b.mul(inputs.h, p);
            if supplied {
                w = b.unary(Unary::Neg, w);
            }
            b.store(Slot::new(Array::Output, slot), w);
            k += 1;
        }
    }
    write::energies(c, model, &mut b, (&next[..c.states.len()], &[]), &inputs, &entries)?;
    let program = verified(model, b.finish())?;
    let order = if method == Method::Euler { 1 } else { 4 };
    Ok((
        Stepper {
            name: method.name().into(),
            order,
            passive: false,
            program,
            linear: None,
            glance: None,
            fallback: None,
        },
        entries,
    ))
}

fn stage(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    guesses: &[Value],
) -> Result<Stage, Vec<Diagnostic>> {
    let flat = instant::outputs(c, model, form, b, lowering, guesses)?;
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
            for column in columns {
                let s = write::flow(model, form, column);
                let s = lower(model, b, s)?;
                sum = b.sub(sum, s);
            }
            powers.push(sum);
        }
    }
    let mut loops = Vec::new();
    for z in &c.loops {
        let z = model.pool.var(*z);
        loops.push(lower(model, b, z)?);
    }
    Ok(Stage { rates, integrals, means, powers, loops })
}
