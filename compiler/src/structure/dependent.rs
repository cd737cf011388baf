//! Storages in derivative causality, merged into those they depend on: which are tied together, whether that can be taken, and
//! what it does to the Dirac structure.
//!
//! A dependent storage gives d(x_d)/dt, which falls back on the storages that it depends on. Taken out (`merge`), that is a change
//! of coordinates: with rates F = D z of what is left, the new states move by T F and the old outputs are z = T^T z', z' = dH/dy,
//! so that D' = T D T^T is skew again. (`quadratic`: energies quadratic, ratios that may change with other states; `curved`: the
//! energies of the independent ones are any, ratios constant.)

use super::junction::combine;
use super::start::initial;
use super::{ColumnId, Form, Role, Row, curved, quadratic};
use crate::causality::Causality;
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{ElementId, Law, Model, Signal, Storage, Variable};
use bond_grammar::diagnostic::Diagnostic;
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
    /// See [`Form::divided`].
    pub(super) divided: bool,
}

/// Storages that are tied together.
pub(super) struct Tied {
    pub(super) independent: Vec<ColumnId>,
    pub(super) dependent: Vec<ColumnId>,
    /// What each dependent one sees of each independent one.
    pub(super) ratio: Vec<Vec<Expr>>,
    /// What each dependent one sees of sources: column and coefficient.
    pub(super) sources: Vec<Vec<(ColumnId, Expr)>>,
    /// Storages on whose states the ratios depend.
    pub(super) others: Vec<ColumnId>,
}

/// A change of coordinates: for each new state (named by its column), the old columns whose rates it is the combination of.
pub(super) type Change = Vec<(ColumnId, Vec<(ColumnId, Expr)>)>;

pub(super) fn storage(model: &Model, id: ElementId) -> Option<&Storage> {
    match &model.element(id).law {
        Law::Storage(s) => Some(s),
        Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => None,
    }
}

/// Merges all dependent storages, and takes their columns out of all rows.
pub(super) fn eliminate(
    model: &mut Model,
    causality: &Causality,
    form: &mut Form,
) -> Result<Eliminated, Vec<Diagnostic>> {
    let mut done = Eliminated { before: form.columns.iter().map(|c| c.out).collect(), ..Eliminated::default() };
    if causality.dependent.is_empty() {
        return Ok(done);
    }
    let dependent = ids(form, Role::Dependent);
    let errors: Vec<Diagnostic> = dependent.iter().filter_map(|d| check(model, form, *d)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    for tied in gather(model, form, &dependent).map_err(|d| vec![d])? {
        let is_quadratic = tied.independent.iter().all(|c| stiffness(model, form, *c).is_some());
        let start = initial(model, form, &tied)?;
        strip(form, &tied);
        if is_quadratic {
            quadratic::merge(model, form, &tied, &start, &mut done).map_err(|d| vec![d])?;
        } else {
            curved::merge(model, form, &tied, &start, &mut done).map_err(|d| vec![d])?;
        }
    }
    // Ratios elsewhere may read what is merged.
    let fixed = &done.fixed;
    let entries = form.columns.iter_mut().flat_map(|c| c.row.iter_mut().map(|t| &mut t.1));
    for k in entries.chain(form.loops.iter_mut().map(|l| &mut l.value)) {
        for _ in 0..8 {
            if !model.pool.contains_any(*k, &|s| fixed.contains_key(&s)) {
                break;
            }
            *k = model.pool.substitute(*k, fixed);
        }
    }
    Ok(done)
}

/// Takes the dependent columns out of all rows but those of the sources that they follow.
fn strip(form: &mut Form, tied: &Tied) {
    let is_source = |c: ColumnId| tied.sources.iter().flatten().any(|(s, _)| *s == c);
    for i in 0..form.columns.len() {
        let id = ColumnId(i as u32);
        if tied.dependent.contains(&id) {
            form.columns[i].row.retain(|(j, _)| is_source(*j));
        } else if !is_source(id) {
            form.columns[i].row.retain(|(j, _)| !tied.dependent.contains(j));
        }
    }
}

pub(super) fn ids(form: &Form, role: Role) -> Vec<ColumnId> {
    (0..form.columns.len() as u32).map(ColumnId).filter(|c| form.column(*c).role == role).collect()
}

/// The columns of the field that a storage is a port of; itself alone where it is none.
pub(super) fn family(model: &Model, form: &Form, id: ColumnId) -> Vec<ColumnId> {
    let Some((f, _)) = model.element(form.column(id).element).field else { return vec![id] };
    let column = |m: &ElementId| {
        form.columns.iter().position(|c| c.element == *m && matches!(c.role, Role::Storage | Role::Dependent))
    };
    model.fields[f].members.iter().filter_map(column).map(|i| ColumnId(i as u32)).collect()
}

/// The second derivatives of a storage's energy with the states of its family, where they are numbers.
pub(super) fn stiffness(model: &mut Model, form: &Form, id: ColumnId) -> Option<Vec<(ColumnId, Expr)>> {
    let found = storage(model, form.column(id).element)?;
    let coenergy = found.coenergy;
    let mut row = Vec::new();
    if found.massless {
        return Some(row);
    }
    let mut rest = coenergy;
    for c in family(model, form, id) {
        let state = storage(model, form.column(c).element)?.state;
        let (k, other) = model.pool.linear(rest, state)?;
        model.pool.constant(k)?;
        rest = other;
        row.push((c, k));
    }
    // A storage without energy has no stiffness to invert.
    let own = row.iter().find(|t| t.0 == id).map(|t| t.1)?;
    (model.pool.is_zero(rest) && !model.pool.is_zero(own)).then_some(row)
}

/// Which storages are tied together, and by what.
fn gather(model: &mut Model, form: &Form, dependent: &[ColumnId]) -> Result<Vec<Tied>, Diagnostic> {
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(form.columns.len());
    for &d in dependent {
        for (c, _) in form.column(d).row.iter().filter(|(c, _)| form.column(*c).role == Role::Storage) {
            sets.union(d.at(), c.at());
        }
    }
    for c in ids(form, Role::Storage).into_iter().chain(dependent.iter().copied()) {
        for f in family(model, form, c) {
            sets.union(c.at(), f.at());
        }
    }
    let mut list: Vec<(usize, Tied)> = Vec::new();
    for &d in dependent {
        let root = sets.find(d.at());
        let at = match list.iter().position(|g| g.0 == root) {
            Some(i) => i,
            None => {
                let independent = ids(form, Role::Storage).into_iter().filter(|c| sets.find(c.at()) == root).collect();
                let tied = Tied { independent, dependent: vec![], ratio: vec![], sources: vec![], others: vec![] };
                list.push((root, tied));
                list.len() - 1
            }
        };
        list[at].1.dependent.push(d);
    }
    let zero = model.pool.int(0);
    for (_, tied) in &mut list {
        for d in &tied.dependent {
            tied.ratio.push(tied.independent.iter().map(|i| form.entry(*d, *i).unwrap_or(zero)).collect());
            let sources = form.column(*d).row.iter().filter(|(c, _)| matches!(form.column(*c).role, Role::Source(_)));
            tied.sources.push(sources.copied().collect());
        }
        tied.others = others(model, form, tied)?;
        if let (Some(source), Some(other)) = (tied.sources.iter().flatten().next(), tied.others.first())
            && let Some(d) = tied.dependent.first()
        {
            let (e, source) = (model.element(form.column(*d).element), form.column(source.0));
            return Err(Diagnostic::error(
                "structure::not_yet",
                e.span,
                format!(
                    "`{}` is in derivative causality, and what is tied to it follows both the source `{}` and ratios that change with `{}`: this version of bond cannot take that",
                    e.name,
                    source.name,
                    form.column(*other).name
                ),
            )
            .label(model.element(source.element).span, "is the source")
            .help("put some resistance between the source and the storages, as the real parts have"));
        }
    }
    Ok(list.into_iter().map(|t| t.1).collect())
}

/// The storages on whose states the ratios depend.
fn others(model: &Model, form: &Form, tied: &Tied) -> Result<Vec<ColumnId>, Diagnostic> {
    let mut others: Vec<ColumnId> = Vec::new();
    let of_sources = tied.sources.iter().flatten().map(|t| t.1);
    let ratios: Vec<Expr> = tied.ratio.iter().flatten().copied().chain(of_sources).collect();
    for e in ratios {
        for s in model.pool.symbols(e) {
            let found = match model.signals.get(&s) {
                Some(Signal::State(id)) => {
                    form.columns.iter().position(|c| c.element == *id && c.role == Role::Storage)
                }
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
            let found = found.map(|i| ColumnId(i as u32)).filter(|c| !tied.independent.contains(c));
            let Some(found) = found else {
                let first =
                    tied.dependent.first().copied().map_or(model.span, |d| model.element(form.column(d).element).span);
                let name = tied.dependent.first().map(|d| form.column(*d).name.clone()).unwrap_or_default();
                return Err(Diagnostic::error(
                    "structure::not_yet",
                    first,
                    format!(
                        "`{name}` is in derivative causality, and its ratio depends on `{}`, which is not the state of another storage: this version of bond cannot take that",
                        model.pool.name(s)
                    ),
                )
                .help("let the ratio depend on the state of a `C`, such as one with `H = 0` that counts the angle"));
            };
            if !others.contains(&found) {
                others.push(found);
            }
        }
    }
    others.sort_unstable();
    Ok(others)
}

/// Why a dependent storage cannot be merged, if so.
fn check(model: &mut Model, form: &Form, d: ColumnId) -> Option<Diagnostic> {
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
    let soft = if column.gives == Variable::Effort { "C" } else { "I" };
    let part = format!("put a stiff {soft} and some resistance between the two, as the real parts have");
    if column.row.is_empty() {
        return refuse("nothing drives it".into(), None, part);
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
                let help = format!("put some resistance between the two, or a {}", if soft == "C" { "I" } else { "C" });
                return refuse(
                    format!("follows `{name}` across a double bar or open port, which jumps"),
                    Some(other.element),
                    help,
                );
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

/// The Dirac structure in new coordinates, D' = T D T^T.
pub(super) fn transform(pool: &mut Pool, form: &mut Form, change: &Change) {
    let one = pool.int(1);
    // z_b = sum over a of T_ab z'_a
    let mut expansion: FxHashMap<ColumnId, Vec<(ColumnId, Expr)>> = FxHashMap::default();
    for (a, terms) in change {
        for (b, k) in terms {
            expansion.entry(*b).or_default().push((*a, *k));
        }
    }
    for c in &mut form.columns {
        if !c.row.iter().any(|(b, _)| expansion.contains_key(b)) {
            continue;
        }
        let mut parts: Vec<(Expr, Row)> = Vec::new();
        for (b, k) in &c.row {
            match expansion.get(b) {
                Some(list) => parts.extend(list.iter().map(|(a, t)| (*k, vec![(*a, *t)]))),
                None => parts.push((*k, vec![(*b, one)])),
            }
        }
        c.row = combine(pool, parts.iter().map(|(k, r)| (*k, r)));
    }
    let rows: Vec<(ColumnId, Row)> = change
        .iter()
        .map(|(a, terms)| {
            let parts: Vec<(Expr, Row)> = terms.iter().map(|(b, k)| (*k, form.column(*b).row.clone())).collect();
            (*a, combine(pool, parts.iter().map(|(k, r)| (*k, r))))
        })
        .collect();
    // What two changed rows say of each other is the same but for the sign, and taken from one of them.
    let changed: Vec<ColumnId> = rows.iter().map(|r| r.0).collect();
    for (a, mut row) in rows {
        row.retain(|(b, _)| *b != a && (*b < a || !changed.contains(b)));
        form.columns[a.at()].row = row;
    }
    for &a in &changed {
        let mirrored: Row =
            changed.iter().filter(|b| **b > a).filter_map(|b| Some((*b, pool.neg(form.entry(*b, a)?)))).collect();
        let row = &mut form.columns[a.at()].row;
        row.extend(mirrored);
        row.sort_unstable_by_key(|t| t.0);
    }
}

/// d/dt of an expression of states and time, the rates of the states being rows of outputs.
pub(super) fn rate(model: &mut Model, form: &Form, e: Expr, states: &[(ColumnId, Symbol)]) -> Expr {
    let mut terms = Vec::new();
    for (c, s) in states {
        let d = model.pool.derivative(e, *s);
        if !model.pool.is_zero(d) {
            let f = form.input(&mut model.pool, *c);
            terms.push(model.pool.mul(d, f));
        }
    }
    for s in model.pool.symbols(e) {
        if model.signals.get(&s) == Some(&Signal::Time) {
            terms.push(model.pool.derivative(e, s));
        }
    }
    model.pool.sum(&terms)
}
