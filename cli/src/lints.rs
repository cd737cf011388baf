//! Remarks on a valid model: what it says that the author probably did not mean.

use crate::column;
use crate::summary::MAX_LISTED;
use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_compiler::model::{ElementId, Kind, Model, Variable};
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

/// What the structure of a model says that its author may not know: storages without a state of their own, those that
/// sources alone move, and algebraic loops.
pub fn structure(compiled: &Compiled) -> Vec<String> {
    let stages = compiled.whole();
    let (model, form) = (&stages.model, &stages.form);
    let mut notes = Vec::new();
    for r in &form.regions {
        notes.extend(derivative(model, r));
        notes.extend(driven(model, form, r));
        for members in r.loops(&model.pool, form) {
            let names = listed(members.iter().map(|c| form.column(*c).name.as_str()));
            let linear = members.iter().all(|c| r.gains.contains_key(c));
            let how = if linear { "solved exactly" } else { "solved by iteration in each step" };
            notes.push(format!(
                "{names} determine one another at each instant (an algebraic loop), which is {how}; a storage between \
                them, as real parts have, ends the loop"
            ));
        }
    }
    notes
}

/// Names in a row, of many the first.
fn listed<'n>(names: impl Iterator<Item = &'n str>) -> String {
    let mut names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
    if let Some(more) = names.len().checked_sub(MAX_LISTED).filter(|more| *more > 1) {
        names.truncate(MAX_LISTED);
        names.push(format!("{more} more"));
    }
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => names.join(""),
    }
}

/// Storages in derivative causality, which were merged into others.
fn derivative(model: &Model, r: &Region) -> Option<String> {
    let merged: Vec<_> = r.dependent.iter().filter(|d| !d.into.is_empty()).collect();
    let first = merged.first()?;
    let name = |id: ElementId| model.element(id).name.as_str();
    let follow = {
        let mut states: Vec<&str> = merged.iter().flat_map(|d| &d.into).map(String::as_str).collect();
        states.sort_unstable();
        states.dedup();
        listed(states.iter().map(|s| s.rsplit_once('.').map_or(*s, |(owner, _)| owner)))
    };
    let (is, it, own) = match merged.len() {
        1 => ("is", "it follows", "it"),
        _ => ("are", "they follow", "each"),
    };
    let soft = if model.element(first.element).kind == Kind::I { "a C" } else { "an I" };
    Some(format!(
        "{} {is} in derivative causality: {it} {follow} rigidly, which is computed exactly; {soft} or an R between \
        them would give {own} a state of its own",
        listed(merged.iter().map(|d| name(d.element)))
    ))
}

/// Storages that sources alone move: a capacitor across a source.
fn driven(model: &Model, form: &Form, r: &Region) -> Vec<String> {
    let mut told: Vec<(Kind, &[ColumnId], Vec<&str>)> = Vec::new();
    for f in r.following.iter().filter(|f| !f.sources.is_empty()) {
        let column = form.column(f.column);
        let kind = model.element(column.element).kind;
        match told.iter_mut().find(|t| (t.0, t.1) == (kind, f.sources.as_slice())) {
            Some(same) => same.2.push(&column.name),
            None => told.push((kind, &f.sources, vec![&column.name])),
        }
    }
    let one = |(kind, sources, names): (Kind, &[ColumnId], Vec<&str>)| {
        let sources = listed(sources.iter().map(|c| form.column(*c).name.as_str()));
        let several = names.len() > 1;
        let (is, has, it) = if several { ("are", "have", "they have") } else { ("is", "has", "it has") };
        let (how, what) = match kind == Kind::C {
            true => (format!("{is} across the source {sources}"), "flow"),
            false => (format!("{has} the flow of the source {sources}"), "effort"),
        };
        format!(
            "{} {how}, with nothing between: {it} no state, and the {what} is what the slope of the source asks for, \
            without limit where that jumps; real sources have an R between",
            listed(names.into_iter())
        )
    };
    told.into_iter().map(one).collect()
}
