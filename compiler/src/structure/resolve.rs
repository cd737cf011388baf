//! Signals in values become states, outputs and time.

use super::dependent::Eliminated;
use super::junction::Rows;
use super::{ColumnId, Form, Group, Loop, Output, Region, Role, Row, State, resistor};
use crate::causality::holder;
use crate::expression::{Expr, Symbol};
use crate::graph::{BondGraph, RegionId};
use crate::model::{BondId, ElementId, ExpectationKind, Law, Model, Signal, Variable};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::{FxHashMap, FxHashSet};

pub(super) struct Resolver<'a> {
    pub(super) model: &'a mut Model,
    graph: &'a BondGraph,
    rows: &'a Rows,
    /// Outputs of the columns as the bonds' rows mean them, before storages were merged.
    before: Vec<Symbol>,
    /// The same now.
    out: Vec<Symbol>,
    /// What is already known to be replaced: states and outputs of merged storages.
    fixed: &'a FxHashMap<Symbol, Expr>,
    memo: FxHashMap<(Symbol, Option<RegionId>), Expr>,
    open: Vec<Symbol>,
    /// Signals that depend on themselves; one that was met and not closed yet has no value.
    loops: Vec<Loop>,
    met: Vec<(Symbol, Symbol)>,
}

impl Resolver<'_> {
    /// Replaces all signals of an expression that is read in a region.
    pub(super) fn resolve(&mut self, e: Expr, region: Option<RegionId>, span: Span) -> Result<Expr, Diagnostic> {
        let mut map: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for s in self.model.pool.symbols(e) {
            if let Some(x) = self.symbol(s, region, span)? {
                map.insert(s, x);
            }
        }
        Ok(if map.is_empty() { e } else { self.model.pool.substitute(e, &map) })
    }

    fn symbol(&mut self, s: Symbol, region: Option<RegionId>, span: Span) -> Result<Option<Expr>, Diagnostic> {
        if let Some(l) = self.loops.iter().find(|l| l.signal == s) {
            let unknown = l.unknown;
            return Ok(Some(self.model.pool.var(unknown)));
        }
        if let Some(&x) = self.memo.get(&(s, region)) {
            return Ok(Some(x));
        }
        let found = if let Some(&x) = self.fixed.get(&s) {
            self.guarded(s, x, (region, None), span)?
        } else {
            match self.model.signals.get(&s) {
                Some(Signal::Effort(b)) => self.bond(s, *b, Variable::Effort, region, span)?,
                Some(Signal::Flow(b)) => self.bond(s, *b, Variable::Flow, region, span)?,
                Some(
                    Signal::Time
                    | Signal::State(_)
                    | Signal::Integral(_)
                    | Signal::Argument(_)
                    | Signal::Parameter(_)
                    | Signal::Input(_)
                    | Signal::Slope(_)
                    | Signal::Memory(_),
                )
                | None => {
                    return Ok(None);
                }
            }
        };
        self.memo.insert((s, region), found);
        Ok(Some(found))
    }

    fn bond(
        &mut self,
        s: Symbol,
        b: BondId,
        variable: Variable,
        region: Option<RegionId>,
        span: Span,
    ) -> Result<Expr, Diagnostic> {
        let bond = self.model.bond(b);
        let (tail, head) = (bond.tail, bond.head);
        let at = |end: ElementId| Some(self.graph.region_of[end.at()]) == region;
        let end = if !bond.sampled || at(tail) {
            tail
        } else if at(head) {
            head
        } else {
            // Seen from elsewhere, a double bar shows the held variable and what answers it.
            bond.other(holder(self.model, b))
        };
        let row = self.rows.get(self.model, b, end, variable).clone();
        let e = self.expression(&row, true);
        self.guarded(s, e, (region, Some(b)), span)
    }

    /// A column's row as an expression of outputs.
    pub(super) fn row(&mut self, row: &Row) -> Expr {
        self.expression(row, false)
    }

    fn expression(&mut self, row: &Row, before: bool) -> Expr {
        let pool = &mut self.model.pool;
        let outs = if before { &self.before } else { &self.out };
        let terms: Vec<Expr> = row
            .iter()
            .map(|&(c, k)| {
                let z = pool.var(outs[c.at()]);
                pool.mul(k, z)
            })
            .collect();
        pool.sum(&terms)
    }

    /// Resolves what a signal stands for; a signal of a bond that comes back to itself becomes an unknown.
    fn guarded(
        &mut self,
        s: Symbol,
        e: Expr,
        (region, bond): (Option<RegionId>, Option<BondId>),
        span: Span,
    ) -> Result<Expr, Diagnostic> {
        if self.open.contains(&s) {
            let name = self.model.pool.name(s).to_string();
            if bond.is_none() {
                return Err(Diagnostic::error(
                    "structure::modulation",
                    span,
                    format!(
                        "a loop through modulation: `{name}`, of a storage in derivative causality, depends on itself"
                    ),
                )
                .help(
                    "let the ratio depend on states (`.q`, `.p`) rather than on the efforts and flows that it sets",
                ));
            }
            let unknown = match self.met.iter().find(|m| m.0 == s) {
                Some(m) => m.1,
                None => {
                    let unknown = self.model.pool.symbol(&name);
                    self.met.push((s, unknown));
                    unknown
                }
            };
            return Ok(self.model.pool.var(unknown));
        }
        self.open.push(s);
        let x = self.resolve(e, region, span);
        self.open.pop();
        let x = x?;
        let (Some(i), Some(bond)) = (self.met.iter().position(|m| m.0 == s), bond) else { return Ok(x) };
        let (signal, unknown) = self.met.swap_remove(i);
        let region = region.unwrap_or(self.graph.region_of[self.model.bond(bond).tail.at()]);
        self.loops.push(Loop { signal, unknown, value: x, region, bond });
        Ok(self.model.pool.var(unknown))
    }
}

/// Resolves the ratios that stand in the columns' rows.
pub(super) fn rows(model: &mut Model, graph: &BondGraph, rows: &Rows, form: &mut Form) -> Result<(), Vec<Diagnostic>> {
    let out: Vec<Symbol> = form.columns.iter().map(|c| c.out).collect();
    let fixed = FxHashMap::default();
    let before = out.clone();
    let mut r = Resolver {
        model,
        graph,
        rows,
        before,
        out,
        fixed: &fixed,
        memo: FxHashMap::default(),
        open: vec![],
        loops: vec![],
        met: vec![],
    };
    for c in &mut form.columns {
        let span = r.model.element(c.element).span;
        for (_, k) in &mut c.row {
            *k = r.resolve(*k, Some(c.region), span).map_err(|d| vec![d])?;
        }
    }
    form.loops = r.loops;
    Ok(())
}

/// Makes the regions: states, energies, resistors' outputs; and resolves sources, probes, integrals, expectations.
pub(super) fn outputs(
    model: &mut Model,
    graph: &BondGraph,
    rows: &Rows,
    eliminated: &Eliminated,
    form: &mut Form,
) -> Result<(), Vec<Diagnostic>> {
    let out: Vec<Symbol> = form.columns.iter().map(|c| c.out).collect();
    let mut r = Resolver {
        model,
        graph,
        rows,
        before: eliminated.before.clone(),
        out,
        fixed: &eliminated.fixed,
        memo: FxHashMap::default(),
        open: vec![],
        loops: form.loops.clone(),
        met: vec![],
    };
    let one = |d: Diagnostic| vec![d];
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
    let mut group_of: FxHashMap<usize, usize> = FxHashMap::default();
    let merged_columns: FxHashSet<ColumnId> =
        eliminated.groups.iter().flat_map(|g| g.columns.iter().copied()).collect();
    for (i, c) in form.columns.iter_mut().enumerate() {
        let id = ColumnId(i as u32);
        let region = &mut regions[c.region.at()];
        let element = r.model.element(c.element);
        let span = element.span;
        region.pseudo |= r.model.pseudo[c.bond.at()];
        match c.role {
            Role::Source(v) => {
                c.role = Role::Source(r.resolve(v, Some(c.region), span).map_err(one)?);
                region.inputs.push(id);
            }
            Role::Bar | Role::Open(_) => region.inputs.push(id),
            Role::Dependent => {}
            Role::Storage => {
                let Law::Storage(s) = element.law.clone() else { continue };
                let (e, f) = r.model.units[c.bond.at()];
                let unit =
                    if c.gives == Variable::Effort { f } else { e }.map(|u| u.mul(crate::units::Dimension::SECOND));
                let (symbol, initial, unit) = match eliminated.states.get(&id) {
                    Some(&(symbol, initial, same)) => (symbol, initial, unit.filter(|_| same)),
                    None => (s.state, s.initial, unit),
                };
                let name = r.model.pool.name(symbol).to_string();
                let state = region.states.len();
                let merged = merged_columns.contains(&id);
                // The ports of a field share a group.
                let shared = element.field.map(|f| f.0).and_then(|f| Some((f, *group_of.get(&f)?)));
                match shared {
                    _ if merged => {}
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
                        });
                    }
                }
                region.states.push(State { symbol, name, column: id, unit, initial });
            }
            Role::Resistor => {}
        }
    }
    // Curves that are asked for the same in the same way are at the same place of theirs, as two guides of one body: at
    // rest nothing else would say which of them holds how much.
    let any = r.model.pool.symbol("s");
    let mut places: FxHashMap<Expr, Symbol> = FxHashMap::default();
    for i in 0..form.columns.len() {
        let id = ColumnId(i as u32);
        let c = form.column(id);
        if c.role != Role::Resistor {
            continue;
        }
        let region = c.region.at();
        if let Some(mut found) = resistor::output(&mut r, form, id).map_err(one)? {
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
        region.groups.push(Group { states, energy: g.energy, coenergy: g.coenergy.clone(), bounded: g.bounded });
    }
    for f in &eliminated.following {
        let c = form.column(f.column);
        let (region, sources) = (c.region, c.row.iter().map(|t| t.0).collect());
        let span = r.model.element(c.element).span;
        let rate = r.resolve(f.rate, Some(region), span).map_err(one)?;
        regions[region.at()].following.push(super::Follower { column: f.column, state: f.state, rate, sources });
    }
    form.regions = regions;
    let probes: Vec<(Expr, Span)> = r.model.probes.iter().map(|p| (p.value, p.span)).collect();
    let integrals: Vec<(Expr, Span)> = r.model.integrals.iter().map(|p| (p.rate, p.span)).collect();
    for (e, span) in probes {
        form.probes.push(r.resolve(e, None, span).map_err(one)?);
    }
    for (e, span) in integrals {
        form.integrals.push(r.resolve(e, None, span).map_err(one)?);
    }
    let memories: Vec<(Expr, Span)> = r.model.memories.iter().map(|m| (m.law, m.span)).collect();
    for (e, span) in memories {
        form.memories.push(r.resolve(e, None, span).map_err(one)?);
    }
    for x in r.model.expectations.clone() {
        let list: Vec<Expr> = match &x.kind {
            ExpectationKind::Passive => vec![],
            ExpectationKind::At { value, .. } => vec![*value],
            ExpectationKind::Holds { condition, extremes } => {
                std::iter::once(*condition).chain(extremes.iter().map(|e| e.1)).collect()
            }
        };
        let list = list.into_iter().map(|e| r.resolve(e, None, x.span)).collect::<Result<Vec<_>, _>>().map_err(one)?;
        form.expectations.push(list);
    }
    form.loops = r.loops;
    Ok(())
}
