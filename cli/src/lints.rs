//! Remarks on a valid model: what it says that the author probably did not mean.

use crate::column;
use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_compiler::model::{Kind, Model, Variable};
use bond_compiler::structure::{Column, ColumnId, Form, Region, Role};

/// A note for each: storages that a detector holds at rest, pieces that nothing gives power, what `ray` never
/// moves, what gives energy behind a budget that lets none out, what tied storages divide by, and probes whose columns
/// have other names.
pub fn lints(compiled: &Compiled) -> Vec<String> {
    let stages = compiled.stages();
    let (model, form) = (&stages.model, &stages.form);
    let scene = compiled.scene();
    // Regions that nothing asks for do not run.
    let by_ray = |r: &Region| {
        let found = scene.regions.iter().find(|x| x.name == r.name);
        found.is_some_and(|x| scene.clusters[x.cluster].entries.iter().any(|e| e.leap.is_some()))
    };
    let of = |(i, r)| {
        let list = held(model, form, r).into_iter().chain(loose(form, r)).chain(unmoved(model, r, by_ray(r)));
        list.chain(shut_in(model, form, i, r))
    };
    let read = model.remarks.iter().cloned();
    form.regions.iter().enumerate().flat_map(of).chain(divided(model, form)).chain(renamed(model)).chain(read).collect()
}

/// Probes whose columns in the table of a run have other names.
fn renamed(model: &Model) -> Vec<String> {
    let names: Vec<&str> = model.probes.iter().map(|p| p.name.as_str()).collect();
    let other = names.iter().zip(column::over_time(&names)).filter(|(name, column)| **name != *column);
    other
        .map(|(name, column)| {
            format!("the column of the probe `{name}` is `{column}` in the table of a run, where `{name}` is taken; a probe with another name keeps it")
        })
        .collect()
}

/// The divisor of tied storages whose mass matrix is singular where it is 0.
fn divided(model: &Model, form: &Form) -> Option<String> {
    let mut names: Vec<String> = form.poles.iter().map(|e| format!("`{}`", model.pool.print(*e))).collect();
    names.sort();
    names.dedup();
    (!names.is_empty()).then(|| {
        format!(
            "tied storages follow from one another by a division by {}: where it is 0 the run stops or its numbers \
            are wrong; avoid it by an inertia in integral causality on the 1-junction that moves them by this ratio, \
            or by removing asserted strokes",
            names.join(" and by ")
        )
    })
}

/// Storages that receive what detectors alone give: an ideal voltmeter in series, an ideal ammeter across.
fn held(model: &Model, form: &Form, r: &Region) -> Vec<String> {
    let kind = |c: ColumnId| model.element(form.column(c).element).kind;
    let storages = r.states.iter().map(|s| s.column).chain(r.following.iter().map(|f| f.column));
    storages
        .map(|c| form.column(c))
        .filter(|c| c.row.iter().all(|t| kind(t.0).is_detector()))
        .filter_map(|c| {
            let detector = c.row.first()?.0;
            let (junction, kind) = if kind(detector) == Kind::DE { ('0', "De") } else { ('1', "Df") };
            let what = match c.gives {
                Variable::Effort => "flow",
                Variable::Flow => "effort",
            };
            Some(format!(
                "the detector `{}` holds the {what} of `{}` at 0: a {kind} stands on a {junction}-junction, where it changes nothing",
                form.column(detector).name, c.name
            ))
        })
        .collect()
}

/// A region whose state `ray` does not move.
fn unmoved(model: &Model, r: &Region, by_ray: bool) -> Option<String> {
    let first = &r.states.first().filter(|_| by_ray)?.name;
    if r.states.len() > 1 && r.resistors.is_empty() {
        return Some(format!(
            "`ray` does not move in the region of `{first}`, which has several states and loses nothing: its \
            direction is along the level set of H; take another method"
        ));
    }
    let initial = |s| r.states.iter().find(|x| x.symbol == s).map_or(f64::NAN, |x| x.initial);
    let mut slopes = r.groups.iter().flat_map(|g| &g.coenergy);
    let flat = slopes.all(|z| model.pool.eval(*z, &initial) == 0.0);
    flat.then(|| {
        format!("`ray` cannot raise H from a state where dH/dx is 0, and `{first}` starts there; take another method")
    })
}

/// What gives energy in a sampled region that holds something within its budget.
fn shut_in(model: &Model, form: &Form, i: usize, r: &Region) -> Option<String> {
    let budget = r.sampling.is_some_and(|s| model.samplings[s].budget);
    let own = |c: &&Column| c.region.at() == i;
    let holds = form.bars.iter().any(|b| form.column(b.holder).region.at() == i)
        || form.columns.iter().filter(own).any(|c| matches!(c.role, Role::Open(_)));
    if !(budget && holds) {
        return None;
    }
    let gives = |c: &&Column| model.element(c.element).active && c.role == Role::Resistor;
    let active = form.columns.iter().filter(own).find(gives).map(|c| &c.name);
    let unbounded = || r.groups.iter().find(|g| !g.bounded).and_then(|g| Some(&r.states.get(*g.states.first()?)?.name));
    let name = active.or_else(unbounded)?;
    Some(format!(
        "the energy budget of the sampled region of `{name}` gives out only what was put in, so the supply of \
        `{name}` stays inside; `budget off` lets it out"
    ))
}

/// A piece without storage, source, port and double bar.
fn loose(form: &Form, r: &Region) -> Option<String> {
    let dead = r.states.is_empty() && r.inputs.is_empty() && r.following.is_empty();
    let first = r.resistors.first().filter(|_| dead)?.0;
    // A law may give power by itself, or read what gives it.
    let plain = r.resistors.iter().all(|(c, _)| r.gains.contains_key(c));
    let name = &form.column(first).name;
    plain.then(|| {
        format!(
            "nothing gives power to `{name}`: it is connected to no source, storage or port, and stays \
        at 0"
        )
    })
}
