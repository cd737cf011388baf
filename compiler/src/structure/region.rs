//! The regions of the form: states, energies, outputs of resistors; and what the model reads of them.

use super::eliminated::Eliminated;
use super::junction::Rows;
use super::resolve::Resolver;
use super::{ColumnId, Form, Group, Output, Region, Role, State, resistor};
use crate::expression::{Expr, Symbol};
use crate::graph::BondGraph;
use crate::model::{ExpectationKind, Law, Model, Variable};
use crate::units::DisplayUnit;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::{FxHashMap, FxHashSet};

/// Makes the regions, and resolves sources, probes, integrals, expectations.
pub(super) fn regions(
    model: &mut Model,
    graph: &BondGraph,
    rows: &Rows,
    eliminated: &Eliminated,
    form: &mut Form,
) -> Result<(), Vec<Diagnostic>> {
    let mut r = Resolver::new(model, graph, (rows, eliminated.before.clone()), &eliminated.fixed, form);
    let mut regions: Vec<Region> = graph
        .regions
        .iter()
        .map(|g| Region {
            name: g.name.clone(),
            sampling: g.sampling,
            inputs: vec![],
            states: vec![],
            groups: vec![],
            resistors: vec![],
            gains: FxHashMap::default(),
            laws: FxHashMap::default(),
            steep: FxHashMap::default(),
            leaky: FxHashMap::default(),
            dependent: vec![],
            following: vec![],
            pseudo: false,
        })
        .collect();
    inputs_and_states(&mut r, eliminated, form, &mut regions)
        .and_then(|()| resistors(&mut r, form, &mut regions))
        .and_then(|()| merged(&mut r, eliminated, form, &mut regions))
        .map_err(|d| vec![d])?;
    form.regions = regions;
    signals(&mut r, form).map_err(|d| vec![d])?;
    form.loops = r.loops;
    Ok(())
}

/// Inputs, states, and the energies of storages that are not merged.
fn inputs_and_states(
    r: &mut Resolver<'_>,
    eliminated: &Eliminated,
    form: &mut Form,
    regions: &mut [Region],
) -> Result<(), Diagnostic> {
    let mut group_of: FxHashMap<usize, usize> = FxHashMap::default();
    let merged: FxHashSet<ColumnId> = eliminated.groups.iter().flat_map(|g| g.columns.iter().copied()).collect();
    for (i, c) in form.columns.iter_mut().enumerate() {
        let id = ColumnId(i as u32);
        let region = &mut regions[c.region.at()];
        let element = r.model.element(c.element);
        let span = element.span;
        region.pseudo |= r.model.pseudo[c.bond.at()];
        match c.role {
            Role::Source(v) => {
                c.role = Role::Source(r.resolve(v, Some(c.region), span)?);
                region.inputs.push(id);
            }
            Role::Bar | Role::Open(_) => region.inputs.push(id),
            Role::Dependent | Role::Resistor | Role::Constraint => {}
            Role::Storage => {
                let Law::Storage(s) = element.law.clone() else { continue };
                let (e, f) = &r.model.units[c.bond.at()];
                let unit = if c.gives == Variable::Effort { f } else { e }.as_ref().map(DisplayUnit::seconds);
                let (symbol, initial, unit) = match eliminated.states.get(&id) {
                    Some(&(symbol, initial, same)) => (symbol, initial, unit.filter(|_| same)),
                    None => (s.state, s.initial, unit),
                };
                let name = r.model.pool.name(symbol).to_string();
                let state = region.states.len();
                // The ports of a field share a group.
                let shared = element.field.map(|f| f.0).and_then(|f| Some((f, *group_of.get(&f)?)));
                match shared {
                    _ if merged.contains(&id) => {}
                    Some((_, at)) => {
                        let group: &mut Group = &mut region.groups[at];
                        group.states.push(state);
                        group.coenergy.push(s.coenergy);
                    }
                    None => {
                        group_of.extend(element.field.map(|f| (f.0, region.groups.len())));
                        region.groups.push(Group {
                            states: vec![state],
                            energy: s.energy,
                            coenergy: vec![s.coenergy],
                            bounded: s.bounded,
                            least_at: None,
                        });
                    }
                }
                region.states.push(State { symbol, name, column: id, unit, initial });
            }
        }
    }
    Ok(())
}

/// The outputs of resistors. Curves that are asked for the same in the same way are at the same place of theirs, as two
/// guides of one body: at rest nothing else would say which of them holds how much.
fn resistors(r: &mut Resolver<'_>, form: &Form, regions: &mut [Region]) -> Result<(), Diagnostic> {
    let any = r.model.pool.symbol("s");
    let mut places: FxHashMap<Expr, Symbol> = FxHashMap::default();
    for i in 0..form.columns.len() {
        let id = ColumnId(i as u32);
        let c = form.column(id);
        let region = c.region.at();
        if c.role == Role::Constraint {
            let residual = form.input(&mut r.model.pool, id);
            regions[region].resistors.push((id, Output::Implicit { residual, bends: None }));
        }
        if c.role != Role::Resistor {
            continue;
        }
        if let Some(mut found) = resistor::output(r, form, id)? {
            if let Output::Curve { parameter, out, residual, bends: None, .. } = found.how {
                let mut put = |e: Expr, s: Symbol| {
                    let s = r.model.pool.var(s);
                    r.model.pool.substitute(e, &FxHashMap::from_iter([(parameter, s)]))
                };
                let asked = put(residual, any);
                let first = *places.entry(asked).or_insert(parameter);
                if first != parameter {
                    found.how = Output::Explicit(put(out, first));
                    if let Some(Output::Curve { out, .. }) = found.leaky {
                        found.leaky = Some(Output::Explicit(put(out, first)));
                    }
                }
            }
            regions[region].resistors.push((id, found.how));
            regions[region].gains.extend(found.gain.map(|g| (id, g)));
            regions[region].laws.extend(found.law.map(|l| (id, l)));
            regions[region].steep.extend(found.steep.map(|s| (id, s)));
            regions[region].leaky.extend(found.leaky.map(|s| (id, s)));
        }
    }
    Ok(())
}

/// Storages that were merged, and those that follow sources.
fn merged(
    r: &mut Resolver<'_>,
    eliminated: &Eliminated,
    form: &Form,
    regions: &mut [Region],
) -> Result<(), Diagnostic> {
    for g in &eliminated.groups {
        let region = &mut regions[g.region.at()];
        let places = |list: &[ColumnId]| -> Vec<usize> {
            list.iter().filter_map(|c| region.states.iter().position(|s| s.column == *c)).collect()
        };
        let states = places(&g.columns);
        let into: Vec<String> = places(&g.into).iter().map(|s| region.states[*s].name.clone()).collect();
        for d in &g.dependent {
            region.dependent.push(super::Dependent { element: d.0, state: d.1, into: into.clone() });
        }
        let (energy, coenergy) = (g.energy, g.coenergy.clone());
        region.groups.push(Group { states, energy, coenergy, bounded: g.bounded, least_at: None });
    }
    for f in &eliminated.following {
        let c = form.column(f.column);
        let (region, sources) = (c.region, c.row.iter().map(|t| t.0).collect());
        let span = r.model.element(c.element).span;
        let rate = r.resolve(f.rate, Some(region), span)?;
        regions[region.at()].following.push(super::Follower { column: f.column, state: f.state, rate, sources });
    }
    Ok(())
}

/// What probes, integrals, signal states, delays and expectations read.
fn signals(r: &mut Resolver<'_>, form: &mut Form) -> Result<(), Diagnostic> {
    let probes: Vec<(Expr, Span)> = r.model.probes.iter().map(|p| (p.value, p.span)).collect();
    let integrals: Vec<(Expr, Span)> = r.model.integrals.iter().map(|p| (p.rate, p.span)).collect();
    let memories: Vec<(Expr, Span)> = r.model.memories.iter().map(|m| (m.law, m.span)).collect();
    let delays: Vec<(Expr, Span)> = r.model.delays.iter().map(|d| (d.signal, d.span)).collect();
    for (list, to) in [
        (probes, &mut form.probes),
        (integrals, &mut form.integrals),
        (memories, &mut form.memories),
        (delays, &mut form.delays),
    ] {
        for (e, span) in list {
            to.push(r.resolve(e, None, span)?);
        }
    }
    for x in r.model.expectations.clone() {
        let list: Vec<Expr> = match &x.kind {
            ExpectationKind::Passive | ExpectationKind::PassiveAt(_) => vec![],
            ExpectationKind::At { value, .. } => vec![*value],
            ExpectationKind::Holds { condition, extremes } => {
                std::iter::once(*condition).chain(extremes.iter().map(|e| e.1)).collect()
            }
        };
        form.expectations.push(list.into_iter().map(|e| r.resolve(e, None, x.span)).collect::<Result<Vec<_>, _>>()?);
    }
    Ok(())
}
