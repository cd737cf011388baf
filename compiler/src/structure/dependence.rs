//! Which storages depend on which in derivative causality, by which ratios, and whether they can be merged or are tied
//! by constraints.

use super::storage::{family, ids, stiffness};
use super::{Column, ColumnId, Form, OPTIONS, Role, is_junction};
use crate::expression::{Expr, Symbol};
use crate::model::{ElementId, Model, Signal, Variable};
use bond_grammar::diagnostic::Diagnostic;
use petgraph::unionfind::UnionFind;
use rustc_hash::{FxHashMap, FxHashSet};

/// Dependent storages that share independent ones, and these.
#[derive(Default)]
pub(super) struct Dependence {
    pub(super) independent: Vec<ColumnId>,
    pub(super) dependent: Vec<ColumnId>,
    /// What each dependent one sees of each independent one.
    pub(super) ratio: Vec<Vec<Expr>>,
    /// What each dependent one sees of sources: column and coefficient.
    pub(super) sources: Vec<Vec<(ColumnId, Expr)>>,
    /// Storages on whose states the ratios depend.
    pub(super) others: Vec<ColumnId>,
    /// Whether ratios depend on anything else, or on the states of storages that are tied themselves.
    reads: bool,
}

/// All sets of storages that depend on one another. Sets whose ratios read the state of one storage are one set, since
/// that storage's energy then belongs to both.
pub(super) fn all(model: &mut Model, form: &Form, dependent: &[ColumnId]) -> Vec<Dependence> {
    let n = form.columns.len();
    // The second half stands for storages that ratios read.
    let mut sets = UnionFind::<usize>::new(2 * n);
    for &d in dependent {
        for (c, _) in form.column(d).row.iter().filter(|(c, _)| form.column(*c).role == Role::Storage) {
            sets.union(d.at(), c.at());
        }
    }
    let storages = ids(form, Role::Storage);
    for &c in storages.iter().chain(dependent) {
        for f in family(model, form, c) {
            sets.union(c.at(), f.at());
            sets.union(n + c.at(), n + f.at());
        }
    }
    let is_merged: FxHashSet<usize> = dependent.iter().map(|d| sets.find(d.at())).collect();
    let mut read: Vec<(ColumnId, ColumnId)> = Vec::new();
    let mut reads: FxHashSet<ColumnId> = FxHashSet::default();
    for &d in dependent {
        for s in form.column(d).row.iter().flat_map(|(_, k)| model.pool.symbols(*k)) {
            match other(model, form, d, s) {
                Some(q) if !is_merged.contains(&sets.find(q.at())) => read.push((d, q)),
                Some(_) | None if model.pool.value(s).is_some() => {}
                Some(_) | None => _ = reads.insert(d),
            }
        }
    }
    for &(d, q) in &read {
        sets.union(d.at(), n + q.at());
    }
    let mut place: FxHashMap<usize, usize> = FxHashMap::default();
    let mut list: Vec<Dependence> = Vec::new();
    for &d in dependent {
        let at = *place.entry(sets.find(d.at())).or_insert_with(|| {
            list.push(Dependence::default());
            list.len() - 1
        });
        list[at].dependent.push(d);
        list[at].reads |= reads.contains(&d);
    }
    for &c in &storages {
        if let Some(&at) = place.get(&sets.find(c.at())) {
            list[at].independent.push(c);
        }
    }
    for &(d, q) in &read {
        if let Some(&at) = place.get(&sets.find(d.at()))
            && !list[at].others.contains(&q)
        {
            list[at].others.push(q);
        }
    }
    let zero = model.pool.int(0);
    for set in &mut list {
        set.others.sort_unstable();
        for d in &set.dependent {
            set.ratio.push(set.independent.iter().map(|i| form.entry(*d, *i).unwrap_or(zero)).collect());
            let sources = form.column(*d).row.iter().filter(|(c, _)| matches!(form.column(*c).role, Role::Source(_)));
            set.sources.push(sources.copied().collect());
        }
    }
    list
}

/// The storage whose state a symbol is, of the region of a dependent storage.
fn other(model: &Model, form: &Form, d: ColumnId, s: Symbol) -> Option<ColumnId> {
    let Some(Signal::State(id)) = model.signals.get(&s) else { return None };
    let q = form.column_of_element[id.at()].filter(|c| form.column(*c).role == Role::Storage)?;
    (form.column(q).region == form.column(d).region).then_some(q)
}

impl Dependence {
    /// Whether the storages can be merged into the independent ones: what they become is written out.
    pub(super) fn is_merged(&self, model: &mut Model, form: &Form) -> bool {
        let is_time =
            |model: &Model, v: Expr| model.pool.symbols(v).iter().all(|s| model.signals.get(s) == Some(&Signal::Time));
        let is_plain = |model: &Model, (c, k): &(ColumnId, Expr)| match form.column(*c).role {
            Role::Source(v) => is_time(model, v) && model.pool.constant(*k).is_some(),
            Role::Bar | Role::Open(_) | Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => true,
        };
        let sources: Vec<&(ColumnId, Expr)> = self.sources.iter().flatten().collect();
        if self.reads
            || !sources.iter().all(|s| is_plain(model, s))
            || (!sources.is_empty() && !self.others.is_empty())
            || self.dependent.iter().any(|d| stiffness(model, form, *d).is_none())
        {
            return false;
        }
        let is_small = self.independent.len() <= OPTIONS.tied;
        if self.is_quadratic(model, form) {
            return is_small || self.ratio.iter().flatten().all(|k| model.pool.constant(*k).is_some());
        }
        let is_port = |d: &ColumnId| family(model, form, *d).len() > 1;
        is_small && self.others.is_empty() && sources.is_empty() && !self.dependent.iter().any(is_port)
    }

    /// Whether the energies of the independent storages are quadratic.
    pub(super) fn is_quadratic(&self, model: &mut Model, form: &Form) -> bool {
        self.independent.iter().all(|c| stiffness(model, form, *c).is_some())
    }
}

/// The element that would make a dependent storage, which gives this variable, independent.
fn soft(gives: Variable) -> &'static str {
    if gives == Variable::Effort { "C" } else { "I" }
}

/// What a double bar brings where it ends at a junction: what gives that its common variable.
fn beyond<'f>(model: &Model, form: &'f Form, bar: &Column) -> Option<(&'f String, ElementId)> {
    if !is_junction(model, bar.element) {
        return None;
    }
    let far = form.columns.iter().find(|c| c.role == Role::Bar && c.bond == bar.bond && c.element != bar.element)?;
    let giver = form.column(far.row.first()?.0);
    Some((&giver.name, giver.element))
}

/// That a storage is held at rest.
pub(super) fn held(model: &Model, column: &Column) -> Diagnostic {
    let e = model.element(column.element);
    let held = match e.kind.integral().map_or(column.gives, Variable::other) {
        Variable::Effort => "held at rest, by a flow that is always 0",
        Variable::Flow => "held at 0, by an effort that is always 0",
    };
    let what = format!("`{}` is in derivative causality, and {held}", e.name);
    let help = "remove it, correct the ratios that hold it, or bond it to what should drive it";
    Diagnostic::error("structure::held", e.span, what).help(help)
}

/// Why a dependent storage cannot be had at all: what it is held by, or follows, allows none.
pub(super) fn check(model: &Model, form: &Form, d: ColumnId) -> Option<Diagnostic> {
    let column = form.column(d);
    let e = model.element(column.element);
    let soft = soft(column.gives);
    let apart = format!("put some resistance between the two, as the real parts have, or a stiff {soft} with some");
    let refuse = |code: &'static str, why: String, other: Option<ElementId>, help: String| {
        let mut error = Diagnostic::error(code, e.span, format!("`{}` is in derivative causality, and {why}", e.name));
        if let Some(o) = other {
            error = error.label(model.element(o).span, "is what it depends on");
        }
        Some(error.help(help))
    };
    if column.row.is_empty() {
        return Some(held(model, column));
    }
    for (c, _) in &column.row {
        let other = form.column(*c);
        let name = &other.name;
        match other.role {
            Role::Storage | Role::Source(_) => {}
            Role::Bar | Role::Open(_) => {
                let (article, junction) = if soft == "C" { ("a", 0) } else { ("an", 1) };
                let help = format!("put some resistance between the two, or {article} {soft} at a {junction}-junction");
                let (name, element) = beyond(model, form, other).unwrap_or((name, other.element));
                let why = format!("follows `{name}` across a double bar or open port, which jumps");
                return refuse("structure::jump", why, Some(element), help);
            }
            Role::Resistor => {
                let why = format!("depends on the resistor `{name}`");
                return refuse("structure::rate", why, Some(other.element), apart);
            }
            Role::Dependent | Role::Constraint => {
                let why = format!("follows the rate of `{name}`, which follows others itself");
                return refuse("structure::rate", why, Some(other.element), apart);
            }
        }
    }
    None
}
