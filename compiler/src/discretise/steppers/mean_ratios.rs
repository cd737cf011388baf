//! Ratios of constraints over a step by the discrete gradient: their means along the straight way from its start to its
//! end, rather than their values at its middle.
//!
//! Where a constraint is the rate of something, as that two points stay together, then its mean over the step times the
//! change of the states is the change of that exactly: positions hold to rounding over any number of steps, though the
//! model tells speeds alone (Gonzalez, Comput. Methods Appl. Mech. Eng. 174, 1999; Betsch and Steinmann, Int. J. Numer.
//! Methods Eng. 53, 2002). Row and column of the multiplier take the same means, so D stays skew.

use crate::discretise::cluster::Cluster;
use crate::discretise::equations::discrete_gradient;
use crate::discretise::steppers::collocation::tableau;
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;
use crate::structure::{ColumnId, Form, Output, Role};
use rustc_hash::{FxHashMap, FxHashSet};

/// Nodes of the quadrature. By six, the mean of a sine over a step of a quarter of a turn is exact to rounding.
const NODES: usize = 6;

/// The equations of a step with mean ratios.
pub(crate) struct MeanRatios {
    pub(crate) cluster: Cluster,
    pub(crate) form: Form,
    /// Each mean, and what it is in terms of states and their changes.
    pub(crate) means: Vec<(Symbol, Expr)>,
}

impl MeanRatios {
    /// None where no constraint has a ratio that changes.
    pub(crate) fn of(c: &Cluster, model: &mut Model, form: &Form) -> Option<Self> {
        let ties: Vec<ColumnId> = c.nodes.iter().filter_map(|n| n.constraint()).collect();
        let moving: FxHashSet<Symbol> =
            c.states.iter().map(|s| s.symbol).chain(c.time).chain(c.inputs.iter().map(|i| i.1)).collect();
        let pool = &mut model.pool;
        let mut found = Self { cluster: c.clone(), form: form.clone(), means: Vec::new() };
        let mut known: FxHashMap<Expr, Symbol> = FxHashMap::default();
        for tie in ties {
            for (other, k) in form.column(tie).row.clone() {
                // A resistor has its input within its law.
                let (role, back) = (form.column(other).role, form.entry(other, tie));
                let varies = pool.contains_any(k, &|s| moving.contains(&s));
                let is_given = pool.symbols(k).iter().all(|s| moving.contains(s) || pool.value(*s).is_some());
                let (true, true, Some(back)) = (varies && is_given, role != Role::Resistor, back) else { continue };
                let mean = Self::named(pool, &mut known, k);
                let mean_back = if back == k { mean } else { pool.neg(mean) };
                found.form.set_entry(tie, other, mean);
                found.form.set_entry(other, tie, mean_back);
            }
        }
        if known.is_empty() {
            return None;
        }
        let mut all: Vec<(Expr, Symbol)> = known.into_iter().collect();
        all.sort_unstable_by_key(|(_, s)| *s);
        found.means = all.into_iter().map(|(k, s)| (s, mean(c, pool, k))).collect();
        found.rewrite(pool);
        Some(found)
    }

    /// The symbol of a ratio's mean, with its sign: a ratio and its opposite have one.
    fn named(pool: &mut Pool, known: &mut FxHashMap<Expr, Symbol>, k: Expr) -> Expr {
        let opposite = pool.neg(k);
        if let Some(s) = known.get(&opposite) {
            let s = pool.var(*s);
            return pool.neg(s);
        }
        let s = *known.entry(k).or_insert_with(|| pool.symbol("mean ratio"));
        pool.var(s)
    }

    /// Has the cluster's equations read the form's new entries.
    fn rewrite(&mut self, pool: &mut Pool) {
        for s in &mut self.cluster.states {
            if let Some(column) = s.column {
                s.rate = self.form.input(pool, column);
            }
        }
        for n in &mut self.cluster.nodes {
            if let (Some(column), Output::Implicit { residual, .. }) = (n.constraint(), &mut n.how) {
                *residual = self.form.input(pool, column);
            }
        }
    }
}

/// The mean of an expression over a step.
fn mean(c: &Cluster, pool: &mut Pool, k: Expr) -> Expr {
    let mut terms = Vec::new();
    for (node, weight) in tableau::quadrature(NODES) {
        let part = pool.float(node.high);
        let at = discrete_gradient::within(c, pool, part);
        let (value, weight) = (pool.substitute(k, &at), pool.float(weight.high));
        terms.push(pool.mul(weight, value));
    }
    pool.sum(&terms)
}
