//! What is known of the numbers of a cluster before it runs.

use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;
use rustc_hash::FxHashMap;

impl Cluster {
    /// What is known of its numbers before it runs.
    pub(crate) fn start(&self, model: &Model) -> AtStart {
        let step = match self.sampling {
            Some(s) => model.samplings[s].period,
            None => model.settings.pace,
        };
        let states = self.states.iter().map(|s| (s.symbol, s.initial));
        AtStart { values: states.chain(self.h.map(|h| (h, step))).collect(), step }
    }
}

/// What is known of the numbers of a cluster before it runs.
pub(crate) struct AtStart {
    /// States, and the step's length.
    values: FxHashMap<Symbol, f64>,
    /// The length of a step, or of a long fitted one, s.
    pub(crate) step: f64,
}

impl AtStart {
    /// The value of an expression; what is not known counts as 0.
    pub(crate) fn eval(&self, pool: &Pool, e: Expr) -> f64 {
        pool.eval(e, &|s| self.values.get(&s).copied().or_else(|| pool.value(s)).unwrap_or(0.0))
    }
}
