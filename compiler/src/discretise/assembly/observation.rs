//! Observation: the program that gives the signals of a cluster at one instant.

use crate::discretise::cluster::{Cluster, Recall, missing, verified};
use crate::discretise::equations::inputs;
use crate::discretise::equations::output_equations::{Pull, Switched, outputs};
use crate::expression::{Expr, Lowering, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Program, Slot, Value};

/// Where things are among the outputs: the signals shown come first.
pub(crate) struct Layout {
    pub(crate) ports: usize,
    /// What is delayed in continuous time.
    pub(crate) carried: usize,
}

/// The length of the last step, where the stepper keeps it.
fn last_length(c: &Cluster, b: &mut Builder) -> Option<Value> {
    let recall = c.recalls.filter(|_| c.memory > 0)?;
    let first = b.slots(Array::State, c.memory).index as usize;
    let kept = b.load(Slot::new(Array::State, first + c.memory - 1));
    Some(match recall {
        Recall::Length => kept,
        Recall::Rate => {
            let (zero, one) = (b.number(0.0), b.number(1.0));
            let (known, length) = (b.binary(Binary::Lt, zero, kept), b.div(one, kept));
            b.select(known, length, zero)
        }
    })
}

/// Writes the observation of the signals `shows`.
pub(crate) fn write(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    shows: &[Symbol],
    stiffly_accurate: bool,
) -> Result<(Program, Layout), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, "observation"));
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    // A last stage at the end of the step has found the answer there.
    let switches = match stiffly_accurate {
        true => Switched::AtEnd,
        false => Switched::Midway { last: last_length(c, &mut b) },
    };
    let pull = Pull { curves: c.thresholds.regular.pull, switches };
    let mut list: Vec<(String, Expr)> = Vec::new();
    for s in shows {
        let arrives = c.lines.iter().find(|line| line.symbol == *s).map(|line| line.value);
        let e = arrives.unwrap_or_else(|| model.pool.var(*s));
        list.push((model.pool.name(*s).to_string(), e));
    }
    let layout = Layout { ports: list.len(), carried: list.len() + c.ports.len() };
    for p in &c.ports {
        let e = form.input(&mut model.pool, *p);
        list.push((format!("out({})", form.column(*p).name), e));
    }
    for (i, e) in c.carried().enumerate() {
        list.push((format!("delayed({})", i + 1), e));
    }
    let wanted: Vec<Expr> = list.iter().map(|l| l.1).collect();
    let flat = outputs(c, model, form, &mut b, &mut lowering, (&inputs.guesses, pull), Some(&wanted))?;
    for (name, e) in list {
        let e = model.pool.substitute(e, &flat);
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, name);
        b.store(Slot::new(Array::Output, slot.index as usize), v);
    }
    Ok((verified(model, b.finish())?, layout))
}
