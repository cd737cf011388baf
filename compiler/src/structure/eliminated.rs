//! What the elimination of dependent storages leaves.

use super::ColumnId;
use crate::expression::{Expr, Symbol};
use crate::graph::RegionId;
use crate::model::ElementId;
use rustc_hash::FxHashMap;

/// Storages that became one.
pub(super) struct Merged {
    pub(super) region: RegionId,
    pub(super) columns: Vec<ColumnId>,
    pub(super) energy: Expr,
    pub(super) coenergy: Vec<Expr>,
    pub(super) bounded: bool,
    /// Each dependent storage with its state, and what it is merged into.
    pub(super) dependent: Vec<(ElementId, Expr)>,
    pub(super) into: Vec<ColumnId>,
}

/// A dependent storage that follows sources: its column stays, as a load of theirs.
pub(super) struct Following {
    pub(super) column: ColumnId,
    /// Its state in terms of the new states and time.
    pub(super) state: Expr,
    /// d/dt of that, in terms of outputs too.
    pub(super) rate: Expr,
}

/// What the elimination leaves.
#[derive(Default)]
pub(super) struct Eliminated {
    pub(super) groups: Vec<Merged>,
    /// New state symbol and initial value of the independent ones, and whether the state's unit is the storage's.
    pub(super) states: FxHashMap<ColumnId, (Symbol, f64, bool)>,
    /// Old states and outputs of merged storages, in terms of what is left.
    pub(super) fixed: FxHashMap<Symbol, Expr>,
    /// The outputs of all columns before the change of coordinates.
    pub(super) before: Vec<Symbol>,
    pub(super) following: Vec<Following>,
    /// See [`Form::poles`].
    pub(super) poles: Vec<Expr>,
}
