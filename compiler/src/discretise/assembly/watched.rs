//! Where `expect passive at` looks: which entry of the ledger has what crosses there, and what is stored behind it.

use crate::discretise::analysis::energy_minimum;
use crate::discretise::cluster::{Cluster, Group};
use crate::expression::Symbol;
use crate::graph::RegionId;
use crate::model::{ExpectationKind, Meeting, Model};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use bond_runtime::scene::Watched;

/// One for each such expectation, in their order.
///
/// # Errors
/// An energy behind it that has no lower bound: there is no end to what may be drawn.
pub(crate) fn watched(model: &mut Model, form: &Form, clusters: &[Cluster]) -> Result<Vec<Watched>, Vec<Diagnostic>> {
    let asked = model.expectations.iter().filter_map(|x| match x.kind {
        ExpectationKind::PassiveAt(at) => Some((at, x.span)),
        ExpectationKind::Passive | ExpectationKind::At { .. } | ExpectationKind::Holds { .. } => None,
    });
    let asked: Vec<(Meeting, Span)> = asked.collect();
    asked.into_iter().map(|(at, span)| one(model, form, clusters, (at, span))).collect()
}

fn one(
    model: &mut Model,
    form: &Form,
    clusters: &[Cluster],
    (at, span): (Meeting, Span),
) -> Result<Watched, Vec<Diagnostic>> {
    let lost = || vec![Diagnostic::error("discretise::expect", span, "nothing crosses there").help("remove it")];
    // Of a double bar the other side books every step; the holder, intervals.
    let (name, column, from, sign) = match at {
        Meeting::Element(id) => {
            let column = form.column_of_element[id.at()].ok_or_else(lost)?;
            (model.element(id).name.clone(), column, form.column(column).region, 1.0)
        }
        Meeting::Bar(bond) => {
            let bar = form.bars.iter().find(|b| b.bond == bond).ok_or_else(lost)?;
            (model.bond(bond).name.clone(), bar.held, form.column(bar.holder).region, -1.0)
        }
    };
    let behind = behind(model, form, from, at);
    let region = form.column(column).region;
    let place = clusters.iter().enumerate().find_map(|(i, c)| {
        let entry = c.regions.iter().position(|r| *r == region)?;
        let source = c.accounts(model, form)[entry].supplied.iter().position(|s| *s == column)?;
        Some((i, (entry, source)))
    });
    let (cluster, entry) = place.ok_or_else(lost)?;
    let mut stored = 0.0;
    for c in clusters {
        for g in c.groups.iter().filter(|g| behind.contains(&g.region)) {
            stored += available(model, form, c, g).map_err(|state| {
                let what = format!(
                    "the energy of `{state}`, behind `{name}`, has no lower bound: there is no end to what may be drawn"
                );
                let help = "give it an energy with a least value, or expect it elsewhere";
                vec![Diagnostic::error("discretise::expect", span, what).help(help)]
            })?;
        }
    }
    Ok(Watched { name, cluster, entry, sign, stored })
}

/// The regions on the far side: all that bonds and lines lead to from there.
fn behind(model: &Model, form: &Form, from: RegionId, at: Meeting) -> Vec<RegionId> {
    let bars = form.bars.iter().filter(|b| at != Meeting::Bar(b.bond));
    let bars = bars.map(|b| [b.holder, b.held].map(|c| form.column(c).region));
    let region = |id: crate::model::ElementId| Some(form.column(form.column_of_element[id.at()]?).region);
    let lines = model.lines.iter().filter_map(|l| match l.ends[..] {
        [a, b] => Some([region(a)?, region(b)?]),
        _ => None,
    });
    let joined: Vec<[RegionId; 2]> = bars.chain(lines).collect();
    let mut found = vec![from];
    let mut next = 0;
    while let Some(&region) = found.get(next) {
        next += 1;
        for &[a, b] in &joined {
            let other = if a == region { b } else { a };
            if (a == region || b == region) && !found.contains(&other) {
                found.push(other);
            }
        }
    }
    found
}

/// What a group stores at the start above its least, entropies staying what they are: heat is not drawn as work.
///
/// # Errors
/// The name of a state whose energy has no lower bound.
fn available(model: &mut Model, form: &Form, c: &Cluster, g: &Group) -> Result<f64, String> {
    let heats = c.heats(model, form, g);
    let Some(first) = g.states.iter().find(|s| !heats.contains(s)) else { return Ok(0.0) };
    if !g.bounded {
        return Err(c.states[*first].name.clone());
    }
    let start = |s: Symbol| c.states.iter().find(|x| x.symbol == s).map_or(0.0, |x| x.initial);
    let stored = model.pool.eval(g.energy, &start) - energy_minimum::minimum(model, g, c, &heats);
    Ok(stored.max(0.0))
}
