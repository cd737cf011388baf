//! The discrete-gradient step (Gonzalez, J. Nonlinear Sci. 6, 1996): order 2, the balance exact.
//!
//! (x+ - x)/h = D z at the midpoint of states and time, with the co-energy variable of each storage replaced by its
//! discrete gradient, which for one state is the difference quotient of H, written without cancellation. Resistors and
//! loops are solved with it. The unknowns are the changes of the states, so that x+ = x + change is rounded once.

use crate::discretise::analysis::relay;
use crate::discretise::cluster::{Cluster, Node, Recall, missing, verified};
use crate::discretise::equations::constraints::StepSizes;
use crate::discretise::equations::system::{self, System};
use crate::discretise::equations::{
    angle_addition, constraints, discrete_gradient, exact_coefficients, inputs, ledger, newton,
};
use crate::discretise::steppers::kept_positions::{self, KeptPositions};
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::discretise::steppers::mean_ratios::MeanRatios;
use crate::discretise::steppers::predictor::{self, Predictor};
use crate::expression::Lowering;
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Value};

/// The step of a cluster, whose iteration starts from the last steps.
pub(crate) fn step(label: Label, c: &mut Cluster, model: &mut Model, form: &Form) -> Result<Step, Refusal> {
    c.couple_stiffly(model, form);
    c.predicted = predictor::predicted_states(c, model, form);
    if c.redundant {
        c.predicted = Vec::new();
        c.memory = kept_positions::memory(c);
    } else {
        c.memory = predictor::memory(c.predicted.len());
        c.recalls = Some(Recall::Rate);
    }
    Ok(write(label, c, model, form, true)?)
}

/// Writes the step. `own` says that it is the cluster's own, rather than what another stepper falls back to: its memory
/// is then that of [`predictor`], or of [`kept_positions`].
pub(crate) fn write(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    own: bool,
) -> Result<Step, Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, &format!("{} step", label.name)));
    let entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let ratios = MeanRatios::of(c, model, form);
    // What the step's equations are of; `c` and `form` are what holds at an instant.
    let (over, over_form) = ratios.as_ref().map_or((c, form), |r| (&r.cluster, &r.form));
    let mut map = discrete_gradient::midpoint(c, &mut model.pool, form);
    map.extend(ratios.iter().flat_map(|r| r.means.iter().copied()));
    let sources = inputs::sources(c, &mut model.pool, &mut map, |name| format!("{name} in the middle"));
    inputs::bind(model, &mut b, &mut lowering, &sources)?;
    let flat = over.flat(&mut model.pool, map);
    let (unknowns, mut residuals) = discrete_gradient::system(over, &mut model.pool, &flat);
    let symbols = c.states.iter().map(|s| s.symbol).collect();
    angle_addition::angles(model, &mut b, &mut lowering, &c.energies(), &symbols)?;
    let whole = discrete_gradient::keeps_coefficients(c, &mut model.pool);
    if whole {
        exact_coefficients::compensated(c, model, &mut b, &mut lowering, &inputs, &mut residuals);
    }
    let (mut weight, mut scale) = discrete_gradient::measures(c, model, form, &mut b, &mut lowering, &inputs)?;
    let sizes = StepSizes::of(c, (model, form), (&mut b, &mut lowering), &inputs)?;
    sizes.measure(c, &mut b, &mut weight, &mut scale);
    let positions = KeptPositions::of(c, model, (&mut b, &mut lowering), &inputs, &mut residuals);
    sizes.reduce(c, &mut model.pool, 0.5, &mut residuals);
    let zero = b.number(0.0);
    // What constraints that say the same carry together is not determined: from none each time it does not grow.
    let is_shared = |n: &Node| c.redundant && n.constraint().is_some();
    let loops: Vec<Value> =
        c.loop_nodes().into_iter().zip(&inputs.guesses).map(|(n, x)| if is_shared(n) { zero } else { *x }).collect();
    let rest: Vec<Value> = c.states.iter().map(|_| zero).chain(loops.iter().copied()).collect();
    let predictor = if own { Predictor::new(&mut b, c, inputs.h) } else { None };
    let (start, cold) = match &predictor {
        Some(predictor) => {
            let start = predictor.start.iter().chain(&loops).copied().collect();
            let known = c.delta.iter().copied().collect();
            let equations = (&unknowns[..], &residuals[..]);
            (
                newton::predict_arguments(
                    model,
                    &mut b,
                    &lowering,
                    equations,
                    &c.exponential_arguments(),
                    &known,
                    start,
                )?,
                rest,
            )
        }
        None => (rest, Vec::new()),
    };
    let carries: Vec<Value> = inputs.carries.iter().map(|slot| b.load(*slot)).collect();
    let carried: Vec<_> = c.states.iter().map(|s| s.symbol).zip(carries.iter().copied().map(Some)).collect();
    let system = System {
        unknowns,
        h: c.h,
        start,
        residuals,
        weight,
        scale,
        exact_coefficients: whole,
        rests: true,
        left: system::left(c),
        small: if whole { carries } else { Vec::new() },
        states: carried.clone(),
        knees: c.exponential_knees(),
        undetermined: c.may_be_undetermined(),
        redundant: c.redundant,
        non_smooth: relay::is_steeply_non_smooth(c, model, form),
        ..System::default()
    };
    let apart = !discrete_gradient::is_stiff(c, model, form);
    let lows = newton::solve_from(model, &mut b, &mut lowering, (system, apart), cold)?;
    let (mut next, mut rests, mut changes) = (Vec::new(), Vec::new(), Vec::new());
    let many = inputs::is_many(c);
    for (x, change) in inputs.states.iter().zip(&c.delta) {
        let d = model.pool.var(*change);
        let d = lowering.lower(&model.pool, &mut b, d).map_err(|s| missing(model, s))?;
        let carry = b.load(inputs.carries[next.len()]);
        let (v, rest) = match lows.get(change) {
            Some(low) if whole => inputs::advance_whole(&mut b, *x, (d, *low), carry),
            low => inputs::advance(&mut b, *x, (d, low.copied()), carry, many),
        };
        next.push(v);
        rests.push(rest);
        changes.push(d);
    }
    let loops = inputs::loops(c, model, (&mut b, &mut lowering))?;
    let ends = (&mut next[..], &mut rests[..]);
    let projected = constraints::project(c, (model, form), &mut b, (&inputs, &loops), ends)?;
    let projected = projected.as_ref();
    let stages = [(1.0, &flat)];
    ledger::ledger(c, model, over_form, &mut b, &mut lowering, &stages, &entries, (inputs.h, projected))?;
    let first = b.slots(Array::Next, c.slots()).index as usize;
    match &predictor {
        Some(predictor) => predictor.keep(&mut b, c, &changes),
        None if c.redundant => positions.keep(c, model, (&mut b, &mut lowering), (inputs.h, &carried))?,
        None => inputs::no_memory(&mut b, c),
    }
    for (i, v) in rests.iter().enumerate() {
        b.store(Slot::new(Array::Next, c.carry_at() + i), *v);
    }
    for (i, v) in next.iter().enumerate() {
        b.store(Slot::new(Array::Next, first + i), *v);
    }
    let more = projected.map_or(&[][..], |found| &found.integrals);
    inputs::store_integrals(c, model, (&mut b, &mut lowering), &inputs, (&flat, more))?;
    inputs::store_loops(c, &mut b, &loops);
    ledger::energies(c, (model, form), &mut b, (&next, &rests), &inputs, &entries)?;
    let program = verified(model, b.finish())?;
    Ok((label.stepper(program), entries))
}
