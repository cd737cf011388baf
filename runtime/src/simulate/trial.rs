//! What a step gave that may not be kept.

use crate::ir::Array;
use crate::scene::Cluster;
use serde::{Deserialize, Serialize};

/// What a step gave.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Taken {
    pub(super) h: f64,
    pub(super) next: Vec<f64>,
    pub(super) output: Vec<f64>,
}

impl Taken {
    pub(super) fn new(c: &Cluster) -> Self {
        let program = c.branch().map_or(&c.step.program, |b| &b.program);
        let fallback = c.step.fallback.as_ref().map_or(0, |f| f.program.size(Array::Output));
        Self { h: 0.0, next: c.initial.clone(), output: vec![0.0; program.size(Array::Output).max(fallback)] }
    }
}

pub(super) fn copy(from: &Taken, to: &mut Taken) {
    to.h = from.h;
    to.next.copy_from_slice(&from.next);
    to.output.copy_from_slice(&from.output);
}

/// Whether there is nothing that steps change.
pub(super) fn is_stateless(c: &Cluster) -> bool {
    c.states + c.integrals == 0
}
