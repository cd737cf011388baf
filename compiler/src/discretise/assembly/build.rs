//! A cluster as a scene has it.

use crate::discretise::analysis::{energy_minimum, fastest_period, fastest_turn, initial_loops, smoothness};
use crate::discretise::assembly::{guards, hold, observation, stored_energy};
use crate::discretise::choice::{self, Accuracy};
use crate::discretise::cluster::{Carries, Cluster, Line};
use crate::discretise::equations::accounts;
use crate::discretise::steppers::label::Step;
use crate::discretise::steppers::{Method, discrete_update, exact, unknown_method};
use crate::expression::Symbol;
use crate::graph::RegionId;
use crate::model::{Hold, Model, Sampling};
use crate::structure::{ColumnId, Form};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::scene;

/// What was asked of all clusters.
pub(crate) struct Asked {
    pub(crate) method: Option<Method>,
    pub(crate) tolerance: Option<f64>,
    pub(crate) accuracy: Accuracy,
    /// The size of the scene's energies, J.
    pub(crate) energy: f64,
}

/// The step of a cluster, and the method that it is by; None of what only discrete updates move.
struct Stepped {
    method: Option<Method>,
    step: Step,
}

/// Writes all programs of a cluster. `shows` are the signals that it has to show, `foreign` says where those of others
/// are.
///
/// # Errors
/// A method that it cannot be stepped by, or a start without a solution.
pub(crate) fn build(
    c: &mut Cluster,
    model: &mut Model,
    form: &Form,
    asked: &Asked,
    shows: &[Symbol],
    foreign: Vec<(usize, usize)>,
) -> Result<scene::Cluster, Vec<Diagnostic>> {
    let sampling = c.sampling.map(|s| model.samplings[s].clone());
    let Stepped { method, step: (step, mut entries) } = match &sampling {
        None => continuous_step(c, model, form, asked)?,
        Some(sampling) => sampled_step(c, model, form, sampling, asked)?,
    };
    for e in &mut entries {
        let groups = c.groups_in(RegionId(e.region as u32)).iter().filter(|g| g.bounded);
        e.floor = groups.clone().map(|g| energy_minimum::reference_energy(model, g, c)).sum();
        if sampling.is_some() {
            e.least = groups.map(|g| energy_minimum::minimum(model, g, c, &[])).sum();
            work_at_start(c, model, form, e);
        }
    }
    let is_ray = method == Some(Method::Ray);
    let holds = accounts::held_ports(c, form);
    let hold = sampling.as_ref().map(|s| if is_ray && !s.hold_given { Hold::Lagged } else { s.hold });
    let respond = hold.map(|hold| hold::write(c, model, form, hold, &holds, is_ray)).transpose()?.flatten();
    let (instant, layout) = observation::write(c, model, form, shows, step.properties.stiffly_accurate)?;
    let lines = lines(c, layout.carried);
    let (mut fastest, mut guards) = (None, None);
    if sampling.is_none() {
        fastest = fastest_period::fastest_period(c, model, &smoothness::laws(c), model.settings.end);
        guards = guards::guards(c, model, form, (method, step.properties), asked.accuracy)?;
    }
    let (initial, names) = state(c, model, form)?;
    let is_linear = sampling.is_none() && step.linear.is_some();
    let fastest_turn = step.linear.as_ref().filter(|_| is_linear).map_or(0.0, fastest_turn::fastest_turn);
    let has_changing_response =
        sampling.is_none() && !is_linear && !c.ports.is_empty() && !exact::is_linear(c, model, form);
    let (states, regions) = (c.states.len(), c.regions.len());
    Ok(scene::Cluster {
        name: c.name(form),
        period: sampling.as_ref().map(|s| s.period),
        hold: hold.map_or("", Hold::name).into(),
        latency: sampling.as_ref().map_or(0.0, |s| s.latency),
        budget: sampling.as_ref().is_some_and(|s| s.budget),
        states,
        integrals: c.integrals.len(),
        guesses: c.loops.len(),
        memory: c.memory,
        recall: c.recalls.filter(|_| c.memory > 0).map(|_| c.slots() - 1),
        initial,
        names,
        step,
        respond,
        instant,
        guards,
        has_exponentials: !c.exponential_arguments().is_empty(),
        is_non_smooth: smoothness::is_non_smooth(c),
        stored: stored_energy::stored(c, model, form, asked.energy)?,
        energies: c.regions.iter().enumerate().map(|(i, r)| (r.at(), i)).collect(),
        curvatures: (0..states).map(|i| regions + i).collect(),
        heats: heats(c, model, form),
        sizes: Vec::new(),
        grains: (0..states).map(|i| regions + states + i).collect(),
        ports: ports(c, (model, form), layout.ports),
        holds,
        foreign,
        foreign_at: 2 + c.ports.len(),
        inputs: c.inputs.iter().map(|i| i.0).collect(),
        lines,
        entries,
        is_linear,
        has_changing_response,
        fastest_turn,
        fastest_period: fastest,
        jumps: c.vertical_laws(model, form),
    })
}

/// What may be drawn as work at the start, and the least that it can be.
fn work_at_start(c: &Cluster, model: &mut Model, form: &Form, e: &mut scene::Entries) {
    let Some(work) = &mut e.work else { return };
    for g in c.working_groups(model, form, RegionId(e.region as u32)) {
        let at = |s: Symbol| c.states.iter().find(|state| state.symbol == s).map_or(0.0, |state| state.initial);
        work.initial += model.pool.eval(g.energy, &at);
        if g.bounded {
            let heats = c.heats(model, form, g);
            work.least += energy_minimum::minimum(model, g, c, &heats);
        }
    }
}

/// The step of a continuous cluster: by the method that was asked for, else by the one that is chosen.
fn continuous_step(c: &mut Cluster, model: &mut Model, form: &Form, asked: &Asked) -> Result<Stepped, Vec<Diagnostic>> {
    if let Some(method) = asked.method.filter(|m| m.is_for_continuous()) {
        return Ok(Stepped { method: Some(method), step: method.write(c, model, form)? });
    }
    let choice = choice::choose(c, model, form, (asked.accuracy, asked.tolerance))?;
    let (mut step, entries) = match choice.step {
        Some(step) => step,
        None => choice.method.write(c, model, form)?,
    };
    step.why = choice.because.into();
    Ok(Stepped { method: Some(choice.method), step: (step, entries) })
}

/// The step of a sampled cluster: by the method that its sampling names, else by one that was asked for and is for
/// nothing else.
fn sampled_step(
    c: &mut Cluster,
    model: &mut Model,
    form: &Form,
    sampling: &Sampling,
    asked: &Asked,
) -> Result<Stepped, Vec<Diagnostic>> {
    let named = |name: &String| Method::named(name).ok_or_else(|| unknown_method(name, sampling.span));
    let own = sampling.method.as_ref().map(named).transpose()?;
    if c.regions.is_empty() {
        return Ok(Stepped { method: None, step: (discrete_update::write(c, model, form)?, Vec::new()) });
    }
    let method = own.or(asked.method.filter(|m| !m.is_for_continuous())).unwrap_or(Method::Gonzalez);
    if !method.is_for_sampled() {
        return Err(method.unfit(model, c, form, "a sampled region takes `gonzalez` or `ray`"));
    }
    Ok(Stepped { method: Some(method), step: method.write(c, model, form)? })
}

/// The numbers that its state starts from, with their names: states, integrals, loops, compensations of the states, and
/// what the stepper keeps of its last step.
fn state(c: &Cluster, model: &mut Model, form: &Form) -> Result<(Vec<f64>, Vec<String>), Vec<Diagnostic>> {
    let mut initial: Vec<f64> = c.states.iter().map(|s| s.initial).collect();
    initial.extend(c.integrals.iter().map(|i| i.start));
    // What a stiffly coupled resistor gives at an instant says nothing of a step.
    let guesses = initial_loops::guesses(c, model, form)?;
    initial.extend(c.loops.iter().zip(guesses).map(|(z, x)| if c.stiffly_coupled.contains(z) { 0.0 } else { x }));
    initial.extend(c.states.iter().map(|_| 0.0));
    initial.extend((0..c.memory).map(|i| c.kept.get(i).copied().unwrap_or(0.0)));
    let mut names: Vec<String> = c.states.iter().map(|s| s.name.clone()).collect();
    names.extend(c.integrals.iter().map(|i| model.pool.name(i.symbol).to_string()));
    names.extend(c.loops.iter().map(|z| model.pool.name(*z).to_string()));
    names.extend(c.states.iter().map(|s| format!("carry({})", s.name)));
    names.extend((0..c.memory).map(|i| format!("of the last step({i})")));
    Ok((initial, names))
}

/// Its delays; what is delayed in continuous time starts at an output of the observation.
fn lines(c: &Cluster, first: usize) -> Vec<scene::Line> {
    let (mut outputs, mut waves) = (first.., c.ports.len()..);
    let line = |line: &Line| scene::Line {
        name: line.name.clone(),
        start: line.start,
        carried: match line.carries {
            Carries::State(state, periods) => scene::Carried::State { state, periods },
            Carries::Wave(_, periods) => scene::Carried::Wave { output: waves.next().unwrap_or_default(), periods },
            Carries::Leaving(_) => scene::Carried::Leaving { output: waves.next().unwrap_or_default() },
            Carries::Signal(_, time) => scene::Carried::Signal { output: outputs.next().unwrap_or(first), time },
        },
    };
    c.lines.iter().map(line).collect()
}

/// Its ports, whose observed variables start at an output.
fn ports(c: &Cluster, (model, form): (&Model, &Form), first: usize) -> Vec<scene::Port> {
    let port = |(i, column): (usize, &ColumnId)| scene::Port {
        name: form.column(*column).name.clone(),
        region: form.column(*column).region.at(),
        input: 2 + i,
        mean: i,
        instant: first + i,
        is_thermal: accounts::is_thermal(model, form, *column),
    };
    c.ports.iter().enumerate().map(port).collect()
}

/// Its states whose bonds are of temperature and entropy.
fn heats(c: &Cluster, model: &Model, form: &Form) -> Vec<usize> {
    let is_heat = |column: ColumnId| accounts::is_thermal(model, form, column);
    c.states.iter().enumerate().filter(|(_, s)| s.column.is_some_and(is_heat)).map(|(i, _)| i).collect()
}
