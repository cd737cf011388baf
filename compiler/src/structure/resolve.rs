//! Signals in values become states, outputs and time.

use super::dependent::Eliminated;
use super::junction::Rows;
use super::{ColumnId, Form, Group, Output, Region, Role, Row, State};
use crate::causality::holder;
use crate::expression::{Expr, Symbol};
use crate::graph::{BondGraph, RegionId};
use crate::model::{BondId, ElementId, ExpectationKind, Law, Model, Signal, Variable};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashMap;

struct Resolver<'a> {
    model: &'a mut Model,
    graph: &'a BondGraph,
    rows: &'a Rows,
    out: Vec<Symbol>,
    /// What is already known to be replaced: states and outputs of merged storages.
    fixed: &'a FxHashMap<Symbol, Expr>,
    memo: FxHashMap<(Symbol, Option<RegionId>), Expr>,
    open: Vec<Symbol>,
}

impl Resolver<'_> {
    /// Replaces all signals of an expression that is read in a region.
    fn resolve(&mut self, e: Expr, region: Option<RegionId>, span: Span) -> Result<Expr, Diagnostic> {
        let mut map: FxHashMap<Symbol, Expr> = FxHashMap::default();
        for s in self.model.pool.symbols(e) {
            if let Some(x) = self.symbol(s, region, span)? {
                map.insert(s, x);
            }
        }
        Ok(if map.is_empty() { e } else { self.model.pool.substitute(e, &map) })
    }

    fn symbol(&mut self, s: Symbol, region: Option<RegionId>, span: Span) -> Result<Option<Expr>, Diagnostic> {
        if let Some(&x) = self.memo.get(&(s, region)) {
            return Ok(Some(x));
        }
        let found = if let Some(&x) = self.fixed.get(&s) {
            self.guarded(s, x, region, span)?
        } else {
            match self.model.signals.get(&s) {
                Some(Signal::Effort(b)) => self.bond(s, *b, Variable::Effort, region, span)?,
                Some(Signal::Flow(b)) => self.bond(s, *b, Variable::Flow, region, span)?,
                Some(
                    Signal::Time
                    | Signal::State(_)
                    | Signal::Integral(_)
                    | Signal::Argument(_)
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
        let e = self.expression(&row);
        self.guarded(s, e, region, span)
    }

    fn expression(&mut self, row: &Row) -> Expr {
        let pool = &mut self.model.pool;
        let terms: Vec<Expr> = row
            .iter()
            .map(|&(c, k)| {
                let z = pool.var(self.out[c.at()]);
                pool.mul(k, z)
            })
            .collect();
        pool.sum(&terms)
    }

    fn guarded(&mut self, s: Symbol, e: Expr, region: Option<RegionId>, span: Span) -> Result<Expr, Diagnostic> {
        if self.open.contains(&s) {
            let names: Vec<&str> = self.open.iter().map(|s| self.model.pool.name(*s)).collect();
            return Err(Diagnostic::error(
                "structure::modulation",
                span,
                format!(
                    "a loop through modulation: the ratio of a TF or GY depends on itself by way of {}",
                    names.join(", ")
                ),
            )
            .help("let the ratio depend on states (`.q`, `.p`) rather than on the efforts and flows that it sets"));
        }
        self.open.push(s);
        let x = self.resolve(e, region, span);
        self.open.pop();
        x
    }
}

/// Resolves the ratios that stand in the columns' rows.
pub(super) fn rows(model: &mut Model, graph: &BondGraph, rows: &Rows, form: &mut Form) -> Result<(), Vec<Diagnostic>> {
    let out: Vec<Symbol> = form.columns.iter().map(|c| c.out).collect();
    let fixed = FxHashMap::default();
    let mut r = Resolver { model, graph, rows, out, fixed: &fixed, memo: FxHashMap::default(), open: vec![] };
    for c in &mut form.columns {
        let span = r.model.element(c.element).span;
        for (_, k) in &mut c.row {
            *k = r.resolve(*k, Some(c.region), span).map_err(|d| vec![d])?;
        }
    }
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
    let mut r =
        Resolver { model, graph, rows, out, fixed: &eliminated.fixed, memo: FxHashMap::default(), open: vec![] };
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
            dependent: vec![],
            pseudo: false,
        })
        .collect();
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
                let name = r.model.pool.name(s.state).to_string();
                let (symbol, initial) = match eliminated.states.get(&id) {
                    Some(&(symbol, initial)) => (symbol, initial),
                    None => {
                        let states = vec![region.states.len()];
                        region.groups.push(Group {
                            states,
                            energy: s.energy,
                            coenergy: vec![s.coenergy],
                            bounded: s.bounded,
                        });
                        (s.state, s.initial)
                    }
                };
                region.states.push(State { symbol, name, column: id, unit, initial });
            }
            Role::Resistor => {
                let Law::Resistor(law) = element.law.clone() else { continue };
                let row = c.row.clone();
                let input = r.expression(&row);
                let input = r.resolve(input, Some(c.region), span).map_err(one)?;
                let output = r.resolve(law.output, Some(c.region), span).map_err(one)?;
                let pool = &mut r.model.pool;
                let z = pool.var(c.out);
                let with = |pool: &mut crate::expression::Pool, x: Expr| {
                    let map: FxHashMap<Symbol, Expr> = std::iter::once((law.argument, x)).collect();
                    pool.substitute(output, &map)
                };
                let how = if law.gives == c.gives {
                    Output::Explicit(with(pool, input))
                } else if let Some(k) = law.linear.filter(|k| pool.constant(*k).is_some()) {
                    Output::Explicit(pool.div(input, k))
                } else {
                    // The law gives the input; its root is sought.
                    let law_of_z = with(pool, z);
                    Output::Implicit(pool.sub(law_of_z, input))
                };
                region.resistors.push((id, how));
            }
        }
    }
    for g in &eliminated.groups {
        let region = &mut regions[g.region.at()];
        let states: Vec<usize> =
            g.columns.iter().filter_map(|c| region.states.iter().position(|s| s.column == *c)).collect();
        let into: Vec<String> = states.iter().map(|s| region.states[*s].name.clone()).collect();
        for d in &g.dependent {
            region.dependent.push(super::Dependent { element: d.0, state: d.1, into: into.clone() });
        }
        region.groups.push(Group { states, energy: g.energy, coenergy: g.coenergy.clone(), bounded: true });
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
    Ok(())
}
