//! Explicit methods: Euler's, the classical one of Runge and Kutta, those of Dormand and Prince of order 5 and 8, and
//! the semi-implicit Euler method, to compare with. Their steps do not keep the balance, but for one that is put back
//! on it ([`projection`]).

mod booked;
pub(crate) mod projection;
mod stage;
mod stiffness;
pub(crate) mod tableau;

use crate::discretise::cluster::{Cluster, verified};
use crate::discretise::equations::inputs::Inputs;
use crate::discretise::equations::{constraints, inputs, ledger};
use crate::discretise::steppers::RADAU;
use crate::discretise::steppers::collocation::{self, tableau::Nodes};
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Expr, Lowering};
use crate::model::{Model, Variable};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::{Branch, Entries, Stepper};
use booked::Booked;
use projection::{Projected, Projection};
use stage::{Stage, change, sum};
use tableau::Tableau;

/// The step of a cluster by a method.
pub(crate) fn step(
    label: Label,
    c: &mut Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
) -> Result<Step, Refusal> {
    if c.has_constraints() {
        return Err(Refusal::Unfit(constraints::TIED.into()));
    }
    if method.projected {
        let projection = Projection::of(c, model, form).map_err(Refusal::Unfit)?;
        c.memory = projection.memory() + stiffness::memory(c);
        c.watched = true;
    }
    let (stepper, entries, _) = write(label, c, model, form, method, &[])?;
    // Where there is no energy to be kept, what damps goes on best.
    let fallback =
        label.fallback.map(|label| if c.groups.is_empty() { (RADAU, Nodes::Radau) } else { (*label, Nodes::Gauss(4)) });
    let fallback = fallback.map(|with| collocation::write_fallback(with, c, model, form)).transpose()?;
    let fallback = fallback.map(|step| Box::new(step.0));
    Ok((Stepper { fallback, ..stepper }, entries))
}

/// The step with what `switches` kept on one branch; None of a method that looks at the start of its step alone.
pub(crate) fn branch(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
    switches: &[(Expr, usize)],
) -> Result<Option<Branch>, Vec<Diagnostic>> {
    if method.rows.len() == 1 {
        return Ok(None);
    }
    let (stepper, _, middle) = write(label, c, model, form, method, switches)?;
    Ok(Some(Branch { program: stepper.program, middle }))
}

/// What the stages of a step found.
struct Stages {
    list: Vec<Stage>,
    /// Where expressions are had at the last one, and the state there.
    last: Lowering,
    state: Vec<Value>,
    /// What the loops of the next step start from.
    loops: Vec<Value>,
}

/// A step as it is written.
struct Write<'a> {
    c: &'a Cluster,
    form: &'a Form,
    method: &'a Tableau,
    inputs: Inputs,
    projection: Option<Projection>,
}

/// Writes the step. What `switches` is kept on the branches that inputs behind the traces give; then the state halfway
/// is given, too, from an output on, where the method determines it.
fn write(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
    switches: &[(Expr, usize)],
) -> Result<(Stepper, Vec<Entries>, Option<usize>), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, &format!("{} step", label.name)));
    let entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let projection = method.projected.then(|| Projection::of(c, model, form)).transpose();
    let projection = projection.map_err(|why| internal(model, &why))?;
    let write = Write { c, form, method, inputs, projection };
    let mut stages = write.stages(model, &mut b, switches)?;
    let changes = write.changes(&mut b, &stages.list);
    let weights = method.weights();
    let mean = |b: &mut Builder, i| sum(b, &stages.list, weights.iter().copied(), &|s| s.means[i]);
    let mut means: Vec<Value> = (0..c.ports.len()).map(|i| mean(&mut b, i)).collect();
    let mut booked = booked::book(&mut b, &stages.list, &weights, write.inputs.h, &entries);
    let (found, ratio) = match &write.projection {
        Some(projection) => {
            let (found, ratio) = write.project(projection, model, &mut b, &mut stages, (&changes, &booked))?;
            booked::take_along(&mut b, (c, model, form), &found, (&mut means, &mut booked), write.inputs.h);
            (Some(found), Some(ratio))
        }
        None => (None, None),
    };
    let ends = write.store(&mut b, &changes, &stages.loops, found.as_ref());
    means.iter().enumerate().for_each(|(i, mean)| b.store(Slot::new(Array::Output, i), *mean));
    booked::store(&mut b, &entries, &booked, found.as_ref(), c);
    let rests: Vec<Value> = found.iter().flat_map(|f| f.states.iter().map(|x| x.1)).collect();
    ledger::energies(c, (model, form), &mut b, (&ends[..c.states.len()], &rests), &write.inputs, &entries)?;
    let sound = found.as_ref().map(|_| booked::sound(&mut b, (c, model, form), (&stages.list, &weights), &booked));
    let estimate = write.estimate(model, &mut b, &stages.list, found.as_ref().zip(sound));
    let stiffness = ratio.map(|ratio| {
        let slot = b.named(Array::Output, "stiffness");
        b.store(slot, ratio);
        slot.index as usize
    });
    // Last, so that all else is where a step without it has it.
    let middle = if switches.is_empty() { None } else { write.middle(&mut b, &stages.list) };
    let program = verified(model, b.finish())?;
    Ok((Stepper { estimate, stiffness, ..label.stepper(program) }, entries, middle))
}

/// The rate of a state, or after these of an integral.
fn rate(stage: &Stage, i: usize) -> Value {
    match i.checked_sub(stage.rates.len()) {
        None => stage.rates[i],
        Some(k) => stage.integrals[k],
    }
}

impl Write<'_> {
    /// How many states and integrals there are.
    fn count(&self) -> usize {
        self.c.states.len() + self.c.integrals.len()
    }

    /// States and integrals at the start.
    fn start(&self) -> impl Iterator<Item = &Value> {
        self.inputs.states.iter().chain(&self.inputs.integrals)
    }

    /// Which states the first half of a halved method moves: an I storage integrates an effort and gives a flow.
    fn kicked(&self) -> Vec<bool> {
        let gives_flow = |column| self.form.column(column).gives == Variable::Flow;
        self.c.states.iter().map(|s| s.column.is_some_and(gives_flow)).collect()
    }

    fn stages(
        &self,
        model: &mut Model,
        b: &mut Builder,
        switches: &[(Expr, usize)],
    ) -> Result<Stages, Vec<Diagnostic>> {
        let Self { c, form, method, inputs, .. } = self;
        let count = switches.iter().map(|s| s.1 + 1).max().unwrap_or(0);
        let branches: Vec<Slot> = (0..count).map(|k| b.named(Array::Input, format!("branch({k})"))).collect();
        let branches: Vec<Value> = branches.into_iter().map(|slot| b.load(slot)).collect();
        let kicked = self.kicked();
        let intakes = self.projection.as_ref().map_or_else(Vec::new, |p| p.intakes(c, model, form));
        let (mut last, mut state) = (Lowering::new([]), inputs.states.clone());
        let (mut list, mut loops): (Vec<Stage>, _) = (Vec::new(), inputs.guesses.clone());
        for row in method.rows {
            let f = b.number(row.at);
            let ahead = b.mul(f, inputs.h);
            let time = b.add(inputs.t, ahead);
            last = Lowering::new(inputs.env.iter().copied());
            switches.iter().for_each(|(e, k)| last.branch(*e, branches[*k]));
            if let Some(t) = c.time {
                last.bind(t, time);
            }
            for ((_, u, _), (x, slope)) in c.inputs.iter().zip(&inputs.given) {
                let gone = b.mul(ahead, *slope);
                let x = b.add(*x, gone);
                last.bind(*u, x);
            }
            for (i, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
                if row.from.is_empty() || (method.halved && !kicked[i]) {
                    continue;
                }
                let d = change(b, inputs.h, &list, row.from, &|s| s.rates[i]);
                state[i] = b.add(*x, d);
                last.bind(s.symbol, state[i]);
            }
            let stage = stage::stage(c, (model, form), b, &mut last, &loops, &intakes)?;
            loops.clone_from(&stage.loops);
            list.push(stage);
        }
        Ok(Stages { list, last, state, loops })
    }

    /// What states and integrals change by.
    fn changes(&self, b: &mut Builder, stages: &[Stage]) -> Vec<Value> {
        let (kicked, all) = (self.kicked(), self.method.weights());
        let of = |i: usize| {
            let weights: &[f64] = match (self.method.halved, kicked.get(i)) {
                (false, _) => &all,
                (true, Some(true)) => &[1.0],
                (true, Some(false) | None) => &[0.0, 1.0],
            };
            change(b, self.inputs.h, stages, weights, &|s| rate(s, i))
        };
        (0..self.count()).map(of).collect()
    }

    /// Puts the end on the balance; how stiff the step before was.
    fn project(
        &self,
        projection: &Projection,
        model: &mut Model,
        b: &mut Builder,
        stages: &mut Stages,
        (changes, booked): (&[Value], &[Booked]),
    ) -> Result<(Projected, Value), Vec<Diagnostic>> {
        let Self { c, form, inputs, .. } = self;
        let weights = self.method.weights();
        let nets = booked::nets(b, (c, projection), (&stages.list, &weights), booked, inputs.h);
        let ends = (inputs, &changes[..c.states.len()]);
        let mut found = projection.project(c, (model, form), b, &mut stages.last, ends, &nets)?;
        let first = b.slots(Array::State, stiffness::memory(c)).index as usize;
        let (at_start, at_end) = (&stages.list[0].rates, &stages.list[stages.list.len() - 1].rates);
        let states = (&inputs.states[..], &stages.state[..]);
        let sizes = if found.sizes.is_empty() { stiffness::own_sizes(b, states) } else { found.sizes.clone() };
        let told = stiffness::Stages { first: (states.0, at_start), last: (states.1, at_end), sizes: &sizes };
        let (ratio, kept) = stiffness::ratio(b, &told, inputs.h, first);
        found.memory.extend(kept);
        Ok((found, ratio))
    }

    /// Stores the state at the end of the step; states and integrals there.
    fn store(&self, b: &mut Builder, changes: &[Value], loops: &[Value], found: Option<&Projected>) -> Vec<Value> {
        let c = self.c;
        b.slots(Array::Next, c.slots());
        let mut ends = Vec::new();
        for (i, (x, d)) in self.start().zip(changes).enumerate() {
            let moved = found.and_then(|f| f.integrals.get(i.checked_sub(c.states.len())?).copied().flatten());
            let d = moved.map_or(*d, |by| b.add(*d, by));
            let v = match found.and_then(|f| f.states.get(i)) {
                Some((next, _)) => *next,
                None => b.add(*x, d),
            };
            b.store(Slot::new(Array::Next, i), v);
            ends.push(v);
        }
        for (i, z) in loops.iter().enumerate() {
            b.store(Slot::new(Array::Next, self.count() + i), *z);
        }
        match found {
            None => inputs::no_carry(b, c),
            Some(found) => {
                for (i, (_, rest)) in found.states.iter().enumerate() {
                    b.store(Slot::new(Array::Next, c.carry_at() + i), *rest);
                }
                for (i, v) in found.memory.iter().enumerate() {
                    b.store(Slot::new(Array::Next, c.memory_at() + i), *v);
                }
            }
        }
        ends
    }

    /// Stores what estimates the error, where the method has that; the first of the outputs.
    fn estimate(
        &self,
        model: &Model,
        b: &mut Builder,
        stages: &[Stage],
        found: Option<(&Projected, Value)>,
    ) -> Option<usize> {
        let Self { c, method: Tableau { error, .. }, .. } = self;
        if error.is_empty() {
            return None;
        }
        let integrals = c.integrals.iter().map(|i| model.pool.name(i.symbol).to_string());
        let names = c.states.iter().map(|s| s.name.clone()).chain(integrals);
        let slots: Vec<Slot> = names.map(|n| b.named(Array::Output, format!("error({n})"))).collect();
        for (i, slot) in slots.iter().enumerate() {
            let mut by = error.iter().map(|w| sum(b, stages, w.iter().copied(), &|s| rate(s, i)));
            let (fine, coarse) = (by.next(), by.next());
            let fine = fine.unwrap_or_else(|| b.number(0.0));
            let mut off = b.mul(self.inputs.h, fine);
            if let Some(coarse) = coarse {
                off = sharpened(b, off, fine, coarse);
            }
            if let Some((found, sound)) = found {
                off = with_projection(b, off, found.moved.get(i).copied().flatten(), sound);
            }
            b.store(*slot, off);
        }
        Some(slots.first().map_or(0, |s| s.index as usize))
    }

    /// Stores the state halfway, where the method determines it; the first of the outputs.
    fn middle(&self, b: &mut Builder, stages: &[Stage]) -> Option<usize> {
        let weights = self.method.middle;
        if weights.is_empty() {
            return None;
        }
        let slots: Vec<Slot> = (0..self.count()).map(|i| b.named(Array::Output, format!("middle({i})"))).collect();
        for ((i, slot), x) in slots.iter().enumerate().zip(self.start()) {
            let d = change(b, self.inputs.h, stages, weights, &|s| rate(s, i));
            let v = b.add(*x, d);
            b.store(*slot, v);
        }
        slots.first().map(|s| s.index as usize)
    }
}

/// What a step that could be written cannot be written on a branch for. That is a mistake of this crate's.
fn internal(model: &Model, why: &str) -> Vec<Diagnostic> {
    let what = format!("a branch of the step cannot be written ({why}); please report this model");
    vec![Diagnostic::error("discretise::internal", model.span, what)]
}

/// The error of a state, of which the projection tells a part that an estimate may not; no number where the step does
/// not count.
fn with_projection(b: &mut Builder, off: Value, moved: Option<Value>, sound: Value) -> Value {
    let mut off = off;
    if let Some(moved) = moved {
        let [size, moved] = [off, moved].map(|x| b.unary(Unary::Abs, x));
        off = b.binary(Binary::Max, size, moved);
    }
    let none = b.number(f64::NAN);
    b.select(sound, off, none)
}

/// An estimate of an error by one of order 5 and one of order 3, each of a rate: what the first says, times how far it
/// is below a tenth of the second, which goes down with the order of the method (Hairer, Norsett, Wanner I, II.10, with
/// the sum of sizes for the root of the sum of squares).
fn sharpened(b: &mut Builder, off: Value, fine: Value, coarse: Value) -> Value {
    let (fine, coarse) = (b.unary(Unary::Abs, fine), b.unary(Unary::Abs, coarse));
    let (tenth, least) = (b.number(0.1), b.number(f64::MIN_POSITIVE));
    let coarse = b.mul(tenth, coarse);
    let both = b.add(fine, coarse);
    let both = b.add(both, least);
    let part = b.div(fine, both);
    b.mul(off, part)
}
