//! From the port-Hamiltonian form to step programs: clusters, analysis, choice, steppers, assembly of the scene.

mod analysis;
mod assembly;
mod choice;
mod cluster;
mod delays;
mod equations;
mod steppers;

pub(crate) use assembly::probes::mixed;
pub use assembly::switching::{Switching, is_uncut, switching};
pub use choice::{Accuracy, DEFAULT_TOLERANCE};
pub use steppers::Method;

use crate::Options;
use crate::expression::Symbol;
use crate::model::{ElementId, Law, Model, Signal, Variable};
use crate::structure::{ColumnId, Form, Role};
use crate::units::DisplayUnit;
use analysis::sizes::sizes;
use assembly::build::Asked;
use assembly::{build, probes, watched};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::scene::{self, Excluded, Made, Scene, Steering};
use cluster::partition;
use equations::accounts::{self, Accounts};
use rustc_hash::FxHashMap;
use steppers::{ASKED, NAMED};

/// Where an end of a line is booked: the cluster, which of its entries, and which of `supplied` there; `home` is the
/// cluster of each region.
fn end_of_line(
    model: &Model,
    form: &Form,
    (clusters, home): (&[cluster::Cluster], &[usize]),
    id: ElementId,
) -> Option<(usize, usize, usize)> {
    let column = form.column_of_element[id.at()]?;
    let home = home[form.column(column).region.at()];
    let all = clusters[home].accounts(model, form);
    let place = |(k, a): (usize, &Accounts)| Some((k, a.supplied.iter().position(|c| *c == column)?));
    all.iter().enumerate().find_map(place).map(|(k, at)| (home, k, at))
}

/// What leaves at the ends of lines of sampled regions, as their accounts have it.
fn leaving(
    model: &mut Model,
    form: &Form,
    (clusters, home): (&[cluster::Cluster], &[usize]),
    written: &mut [scene::Cluster],
) {
    for l in &model.lines.clone() {
        for (i, end) in l.ends.iter().enumerate() {
            let place = end_of_line(model, form, (clusters, home), *end);
            // What leaves here comes out at the other end; of an open port it is told by what comes in there.
            let far = l.ends[l.ends.len() - 1 - i];
            let (Some((cluster, entry, source)), Some((admittance, symbol))) = (place, comes_out(model, far)) else {
                continue;
            };
            let c = &mut written[cluster];
            let line = clusters[cluster].lines.iter().position(|line| line.symbol == symbol);
            let carried = line.map(|at| c.lines[at].carried);
            let Some(scene::Carried::Wave { output: wave, .. } | scene::Carried::Leaving { output: wave }) = carried
            else {
                continue;
            };
            let scale = 0.25 * admittance * c.period.unwrap_or(0.0);
            c.entries[entry].leaving.push(scene::Leaving { source, wave, scale });
        }
    }
}

/// The lossless lines; `home` is the cluster of each region.
fn lines(
    model: &mut Model,
    form: &Form,
    (clusters, home): (&[cluster::Cluster], &[usize]),
    written: &[scene::Cluster],
) -> Vec<scene::TransmissionLine> {
    let mut list = Vec::new();
    for l in &model.lines.clone() {
        let end = |id: ElementId| end_of_line(model, form, (clusters, home), id);
        let &[first, second] = &l.ends[..] else { continue };
        let (Some(a), Some(b)) = (end(first), end(second)) else { continue };
        let (Some((admittance, first)), Some((_, second))) = (comes_out(model, first), comes_out(model, second)) else {
            continue;
        };
        let arrives = [first, second];
        let c = &written[a.0];
        let slot = |symbol: Symbol| {
            let at = clusters[a.0].lines.iter().position(|line| line.symbol == symbol)?;
            let before: usize = c.lines.iter().take(at).map(|line| line.carried.slots()).sum();
            Some(c.lines_at() + before)
        };
        let out = match arrives.map(slot) {
            [Some(a), Some(b)] if c.period.is_none() => Some([a, b]),
            _ => None,
        };
        list.push(scene::TransmissionLine { name: l.name.clone(), ends: [a, b], admittance, out });
    }
    list
}

/// One over the impedance at an end of a line, and what comes out there.
fn comes_out(model: &mut Model, end: ElementId) -> Option<(f64, Symbol)> {
    let Law::Resistor(law) = &model.element(end).law else { return None };
    let (output, argument) = (law.output, law.argument);
    let slope = model.pool.derivative(output, argument);
    let is_delay = |s: &Symbol| matches!(model.signals.get(s), Some(Signal::Delay(_)));
    Some((model.pool.constant(slope)?, model.pool.symbols(output).into_iter().find(is_delay)?))
}

/// The open ports that carry waves.
fn waves(model: &mut Model, form: &Form, clusters: &[cluster::Cluster]) -> Vec<scene::WavePort> {
    let mut list = Vec::new();
    for l in &model.lines.clone() {
        let &[end] = &l.ends[..] else { continue };
        let Some((admittance, symbol)) = comes_out(model, end) else { continue };
        let mut place = clusters.iter().enumerate();
        let place = place.find_map(|(c, x)| Some((c, x.lines.iter().position(|line| line.symbol == symbol)?)));
        let (Some((cluster, line)), Some(column)) = (place, form.column_of_element[end.at()]) else { continue };
        let (effort, flow) = model.units.get(form.column(column).bond.at()).cloned().unwrap_or_default();
        let unit = effort.zip(flow).map(|(e, f)| e.div(&f).to_string());
        list.push(scene::WavePort { name: l.name.clone(), cluster, line, impedance: 1.0 / admittance, unit });
    }
    list
}

/// The method that the user or the model names.
///
/// # Errors
/// A name that there is not, or a method for what the model has not.
pub fn method(model: &Model, options: &Options) -> Result<Option<Method>, Vec<Diagnostic>> {
    let (name, span, code) = match (&options.method, &model.settings.method) {
        (Some(name), _) => (name, model.span, ASKED),
        (None, Some((name, span))) => (name, *span, NAMED),
        (None, None) => return Ok(None),
    };
    match Method::named(name) {
        Some(method) if !method.is_for_continuous() && model.samplings.is_empty() => {
            let what = format!("the method `{name}` steps sampled regions, and there is none");
            Err(vec![Diagnostic::error(code, span, what).help(steppers::OTHERWISE)])
        }
        Some(method) => Ok(Some(method)),
        None => Err(steppers::unknown_method(name, span)),
    }
}

/// Writes the programs of a scene. `method` is for all regions that can take it; without one, the accuracy chooses.
///
/// # Errors
/// A method that a region cannot take.
pub fn discretise(
    model: &mut Model,
    form: &Form,
    method: Option<Method>,
    (accuracy, step): (Accuracy, Option<f64>),
) -> Result<Scene, Vec<Diagnostic>> {
    let accuracy = accuracy.of_model(model.settings.tolerance, step.or(model.settings.step));
    let tolerance = accuracy.tolerance();
    let (form, delays) = delays::spread(model, form);
    let form = form.as_ref();
    let mut clusters = partition::partition(model, (form, &delays), method.is_some_and(|m| !m.is_for_continuous()));
    for c in &mut clusters {
        c.thresholds = model.settings.thresholds;
        c.expansions.get_mut().by = c.thresholds.rest;
    }
    let wanted = probes::wanted(model, form);
    // Which signals does each cluster have to show to the others and to the probes?
    let mut shows: Vec<Vec<Symbol>> = vec![Vec::new(); clusters.len()];
    let owner: FxHashMap<Symbol, usize> =
        clusters.iter().enumerate().flat_map(|(i, c)| c.owned(form).into_iter().map(move |s| (s, i))).collect();
    let mut places: FxHashMap<Symbol, (usize, usize)> = FxHashMap::default();
    for s in clusters.iter().flat_map(|c| c.foreign.iter().copied()).chain(wanted) {
        if let Some(&i) = owner.get(&s)
            && !places.contains_key(&s)
        {
            places.insert(s, (i, shows[i].len()));
            shows[i].push(s);
        }
    }
    let sizes = sizes(&clusters, model, form);
    let energy = sizes.energy;
    let asked = Asked { method, tolerance, accuracy, energy };
    let place = |s: Symbol| places.get(&s).copied();
    let made = Made { pace: model.settings.pace, tolerance };
    let mut scene =
        Scene { name: model.name.clone(), excluded: excluded(model, form), made, energy, ..Scene::default() };
    for (i, (c, sizes)) in clusters.iter_mut().zip(sizes.states).enumerate() {
        let foreign = c.foreign.iter().map(|s| place(*s).ok_or_else(|| cluster::missing(model, *s)));
        let foreign = foreign.collect::<Result<Vec<_>, _>>()?;
        c.fitted = tolerance.is_some();
        let cluster = build::build(c, model, form, &asked, &shows[i], foreign)?;
        let faintest = model.settings.thresholds.size.faintest_energy * energy;
        let entries = cluster.entries.into_iter().map(|e| scene::Entries { faintest, ..e }).collect();
        scene.clusters.push(scene::Cluster { sizes, entries, ..cluster });
    }
    for i in &model.inputs {
        let (name, unit) = (i.name.clone(), i.unit.as_ref().map(DisplayUnit::to_string));
        scene.inputs.push(scene::Input { name, unit, value: i.value });
    }
    let mut home = vec![0; form.regions.len()];
    for (i, c) in clusters.iter().enumerate() {
        c.regions.iter().for_each(|r| home[r.at()] = i);
    }
    for (i, r) in form.regions.iter().enumerate() {
        scene.regions.push(scene::Region {
            name: r.name.clone(),
            period: r.sampling.map(|s| model.samplings[s].period),
            states: r.states.len(),
            cluster: home[i],
            pseudo: r.pseudo,
        });
    }
    let ports =
        clusters.iter().enumerate().flat_map(|(i, c)| c.ports.iter().enumerate().map(move |(p, id)| (*id, (i, p))));
    let ports: FxHashMap<ColumnId, (usize, usize)> = ports.collect();
    let port_of = |column: ColumnId| ports.get(&column).copied();
    leaving(model, form, (&clusters, &home), &mut scene.clusters);
    scene.lines = lines(model, form, (&clusters, &home), &scene.clusters);
    scene.waves = waves(model, form, &clusters);
    for bar in &form.bars {
        let (Some(holder), Some(other)) = (port_of(bar.holder), port_of(bar.held)) else { continue };
        let answer = form.column(bar.holder).gives;
        let sign = if answer == Variable::Flow { 1.0 } else { -1.0 };
        let bond = model.bond(bar.bond);
        let resolution = bond.resolution.unwrap_or(0.0);
        scene.bars.push(scene::Bar { name: bond.name.clone(), holder, other, sign, resolution });
    }
    for (i, c) in form.columns.iter().enumerate() {
        if let Role::Open(inertia) = c.role
            && let Some(port) = port_of(ColumnId(i as u32))
        {
            let takes_flow = c.gives == Variable::Flow;
            let other = if takes_flow { Variable::Effort } else { Variable::Flow };
            let (along, answers) = (c.sign_of(c.gives) as f64, c.sign_of(other) as f64);
            let (effort, flow) = model.units.get(c.bond.at()).cloned().unwrap_or_default();
            let (own, other) = if takes_flow { (effort, flow) } else { (flow, effort) };
            scene.open.push(scene::Open {
                name: c.name.clone(),
                port,
                inertia,
                resolution: model.bond(c.bond).resolution.unwrap_or(0.0),
                takes_flow,
                unit: own.map(|u| u.to_string()),
                moved: other.map(|u| u.seconds().to_string()),
                along,
                answers,
            });
        }
    }
    scene.probes = probes::build(model, form, &place);
    scene.watched = watched::watched(model, form, &clusters)?;
    Ok(scene)
}

/// Elements for which no passivity can be claimed.
fn excluded(model: &Model, form: &Form) -> Vec<Excluded> {
    // A field is named once.
    let active = model.elements.iter().filter(|e| e.active && e.field.is_none_or(|f| f.1 == 0));
    let name = |e: &crate::model::Element| e.field.map_or(e.name.clone(), |f| model.fields[f.0].name.clone());
    let excluded = |element: String, why: String| Excluded { element, why };
    let mut list: Vec<Excluded> = active.map(|e| excluded(name(e), format!("active `{}`", name(e)))).collect();
    let columns = (0..form.columns.len()).map(|i| ColumnId(i as u32));
    for source in columns.filter(|c| accounts::steering(model, form, *c) == Some(Steering::Unbounded)) {
        let name = &form.column(source).name;
        list.push(excluded(name.clone(), format!("steered `{name}` under `budget off`")));
    }
    for r in &form.regions {
        for g in r.groups.iter().filter(|g| !g.bounded) {
            for s in &g.states {
                let name = &r.states[*s].name;
                list.push(excluded(name.clone(), format!("`{name}`, whose energy has no lower bound")));
            }
        }
    }
    list
}
