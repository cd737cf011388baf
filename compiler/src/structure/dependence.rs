//! Which storages depend on which in derivative causality, by which ratios, and whether they can be merged.

use super::storage::{family, ids, stiffness};
use super::{Column, ColumnId, Form, Role, is_junction};
use crate::expression::{Expr, Symbol};
use crate::model::{ElementId, Model, Signal, Variable};
use bond_grammar::diagnostic::Diagnostic;
use petgraph::unionfind::UnionFind;
use rustc_hash::FxHashMap;

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
}

/// All sets of storages that depend on one another. Sets whose ratios read the state of one storage are one set, since
/// that storage's energy then belongs to both.
///
/// # Errors
/// Ratios of what they cannot depend on, named.
pub(super) fn all(model: &mut Model, form: &Form, dependent: &[ColumnId]) -> Result<Vec<Dependence>, Diagnostic> {
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
    let is_merged: rustc_hash::FxHashSet<usize> = dependent.iter().map(|d| sets.find(d.at())).collect();
    let mut read: Vec<(ColumnId, ColumnId)> = Vec::new();
    for &d in dependent {
        for (_, k) in &form.column(d).row {
            for s in model.pool.symbols(*k) {
                let q = other(model, form, d, s)?;
                if is_merged.contains(&sets.find(q.at())) {
                    let why = format!("reads the state of `{}`, which is tied to others itself", form.column(q).name);
                    return Err(refused(model, form, d, &why, Some(q)));
                }
                read.push((d, q));
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
        if let (Some(source), Some(q), Some(d)) =
            (set.sources.iter().flatten().next(), set.others.first(), set.dependent.first())
        {
            let (source, q) = (source.0, form.column(*q).name.clone());
            let name = &form.column(source).name;
            let why = format!("is tied to what follows the source `{name}`, by ratios that change with `{q}`");
            return Err(refused(model, form, *d, &why, Some(source)));
        }
    }
    Ok(list)
}

/// The storage whose state is read by a ratio between a dependent storage and what it depends on.
fn other(model: &Model, form: &Form, d: ColumnId, s: Symbol) -> Result<ColumnId, Diagnostic> {
    let found = match model.signals.get(&s) {
        Some(Signal::State(id)) => form.column_of_element[id.at()].filter(|c| form.column(*c).role == Role::Storage),
        Some(
            Signal::Time
            | Signal::Effort(_)
            | Signal::Flow(_)
            | Signal::Integral(_)
            | Signal::Argument(_)
            | Signal::Parameter(_)
            | Signal::Input(_)
            | Signal::Slope(_)
            | Signal::Memory(_),
        )
        | None => None,
    };
    let name = model.pool.name(s);
    match found {
        Some(q) if form.column(q).region == form.column(d).region => Ok(q),
        Some(q) => {
            let why = format!("its ratio depends on `{name}` of another region, from where no bond brings the power");
            Err(refused(model, form, d, &why, Some(q)))
        }
        None => {
            let why = format!("its ratio depends on `{name}`, which is not the state of another storage");
            Err(refused(model, form, d, &why, None))
        }
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

/// What this version does not take.
pub(super) fn refused(model: &Model, form: &Form, d: ColumnId, why: &str, because: Option<ColumnId>) -> Diagnostic {
    let e = model.element(form.column(d).element);
    let mut error = Diagnostic::error(
        "structure::not_yet",
        e.span,
        format!("`{}` is in derivative causality, and {why}: this version of bond cannot take that", e.name),
    );
    if let Some(c) = because {
        error = error.label(model.element(form.column(c).element).span, "is what it depends on");
    }
    let soft = soft(form.column(d).gives);
    error.help(format!(
        "put some resistance between the two, as the real parts have, or a stiff {soft} with some; a ratio may depend on the state of a `C` of its region, such as one with `H = 0` that counts the angle"
    ))
}

/// Why a dependent storage cannot be merged, if so.
pub(super) fn check(model: &mut Model, form: &Form, d: ColumnId) -> Option<Diagnostic> {
    let linear = stiffness(model, form, d).is_some();
    let column = form.column(d);
    let e = model.element(column.element);
    let refuse = |why: String, other: Option<ElementId>, help: String| {
        let mut error = Diagnostic::error(
            "structure::not_yet",
            e.span,
            format!("`{}` is in derivative causality, and {why}: this version of bond cannot take that", e.name),
        );
        if let Some(o) = other {
            error = error.label(model.element(o).span, "is what it depends on");
        }
        Some(error.help(help))
    };
    let soft = soft(column.gives);
    let part = format!("put some resistance between the two, as the real parts have, or a stiff {soft} with some");
    if column.row.is_empty() {
        let part = "remove it, correct the ratios that hold it, or bond it to what should drive it".to_string();
        let held = match column.gives {
            Variable::Effort => "held at rest, by a flow that is always 0",
            Variable::Flow => "held at 0, by an effort that is always 0",
        };
        return refuse(held.into(), None, part);
    }
    if !linear {
        let other = column.row.iter().map(|t| form.column(t.0)).find(|c| c.role == Role::Storage);
        let why = match other {
            Some(c) => format!("neither its energy nor that of `{}`, which it depends on, is quadratic", c.name),
            None => "its energy is not quadratic".to_string(),
        };
        return refuse(why, other.map(|c| c.element), part);
    }
    for (c, k) in &column.row {
        let other = form.column(*c);
        let name = &other.name;
        match other.role {
            Role::Storage => {}
            Role::Source(v) => {
                let time = |s: Symbol| model.signals.get(&s) == Some(&Signal::Time);
                if !model.pool.symbols(v).iter().all(|s| time(*s)) {
                    let help =
                        "give the source a value in time alone, or put some resistance between the two".to_string();
                    return refuse(
                        format!(
                            "follows the source `{name}`, whose derivative is not known, since it depends on signals"
                        ),
                        Some(other.element),
                        help,
                    );
                }
                if model.pool.constant(*k).is_none() {
                    return refuse(
                        format!("follows the source `{name}` by a ratio that changes"),
                        Some(other.element),
                        part,
                    );
                }
            }
            Role::Bar | Role::Open(_) => {
                let (article, junction) = if soft == "C" { ("a", 0) } else { ("an", 1) };
                let help = format!("put some resistance between the two, or {article} {soft} at a {junction}-junction");
                let (name, element) = beyond(model, form, other).unwrap_or((name, other.element));
                let why = format!("follows `{name}` across a double bar or open port, which jumps");
                return refuse(why, Some(element), help);
            }
            Role::Resistor => {
                return refuse(format!("depends on the resistor `{name}`"), Some(other.element), part);
            }
            Role::Dependent => {
                return refuse(format!("depends on `{name}`, which is so too"), Some(other.element), part);
            }
        }
    }
    None
}
