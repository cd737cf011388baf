//! Signals in values become states, outputs and time.

use super::junction::Rows;
use super::{Form, Loop, Row};
use crate::causality::holder;
use crate::expression::{Expr, Symbol};
use crate::graph::{BondGraph, RegionId};
use crate::model::{BondId, ElementId, Model, Signal, Variable};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashMap;

/// Replaces the signals of expressions.
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
    /// The signals that are being replaced, each for the sake of the one before it.
    resolving: Vec<Symbol>,
    /// Signals that depend on themselves.
    pub(super) loops: Vec<Loop>,
    /// Those that were met and have no value yet, with the unknowns that stand for them.
    met: Vec<(Symbol, Symbol)>,
}

impl<'a> Resolver<'a> {
    /// With the outputs that the bonds' rows mean, and what is known to be replaced.
    pub(super) fn new(
        model: &'a mut Model,
        graph: &'a BondGraph,
        (rows, before): (&'a Rows, Vec<Symbol>),
        fixed: &'a FxHashMap<Symbol, Expr>,
        form: &Form,
    ) -> Self {
        Self {
            model,
            graph,
            rows,
            before,
            out: form.columns.iter().map(|c| c.out).collect(),
            fixed,
            memo: FxHashMap::default(),
            resolving: vec![],
            loops: form.loops.clone(),
            met: vec![],
        }
    }

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
                    | Signal::Memory(_)
                    | Signal::Delay(_),
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
        if self.resolving.contains(&s) {
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
        self.resolving.push(s);
        let x = self.resolve(e, region, span);
        self.resolving.pop();
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
    let fixed = FxHashMap::default();
    let before = form.columns.iter().map(|c| c.out).collect();
    let mut r = Resolver::new(model, graph, (rows, before), &fixed, form);
    for c in &mut form.columns {
        let span = r.model.element(c.element).span;
        for (_, k) in &mut c.row {
            *k = r.resolve(*k, Some(c.region), span).map_err(|d| vec![d])?;
        }
    }
    form.loops = r.loops;
    Ok(())
}
