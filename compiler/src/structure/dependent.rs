//! Storages in derivative causality, merged into those they depend on.
//!
//! With co-energy variables z of the independent storages (x = z/K), a dependent one sees C z, so that its state is C z/K_d and
//! its output d/dt of that. Since D is skew, dx/dt = rest - C^T d(x_d)/dt, so the state pi = x + C^T x_d = M z has
//! d(pi)/dt = rest, with M = diag(1/K) + C^T diag(1/K_d) C and the energy H = pi^T M^-1 pi / 2 of all of them together.

use super::explicit::inverse;
use super::{ColumnId, Form, Role, Row};
use crate::causality::Causality;
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{ElementId, Law, Model, Storage};
use bond_grammar::diagnostic::Diagnostic;
use rustc_hash::FxHashMap;

/// Storages that became one.
pub(super) struct Merged {
    pub(super) region: RegionId,
    pub(super) columns: Vec<ColumnId>,
    pub(super) energy: Expr,
    pub(super) coenergy: Vec<Expr>,
    pub(super) dependent: Vec<(ElementId, Expr)>,
}

/// What the elimination leaves.
#[derive(Default)]
pub(super) struct Eliminated {
    pub(super) groups: Vec<Merged>,
    /// New state symbol and initial value of the independent ones.
    pub(super) states: FxHashMap<ColumnId, (Symbol, f64)>,
    /// Old states and outputs of dependent storages, in terms of what is left.
    pub(super) fixed: FxHashMap<Symbol, Expr>,
}

fn storage(model: &Model, id: ElementId) -> Option<&Storage> {
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
    let mut done = Eliminated::default();
    if causality.dependent.is_empty() {
        return Ok(done);
    }
    let dependent: Vec<ColumnId> = ids(form, Role::Dependent);
    let errors: Vec<Diagnostic> = dependent.iter().filter_map(|d| check(model, form, *d)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    // Which independent storages are tied together?
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(form.columns.len());
    for &d in &dependent {
        for (c, _) in &form.column(d).row {
            sets.union(d.at(), c.at());
        }
    }
    let mut groups: Vec<(usize, Vec<ColumnId>, Vec<ColumnId>)> = Vec::new();
    for &d in &dependent {
        let root = sets.find(d.at());
        let at = match groups.iter().position(|g| g.0 == root) {
            Some(i) => i,
            None => {
                let members = ids(form, Role::Storage).into_iter().filter(|c| sets.find(c.at()) == root).collect();
                groups.push((root, members, vec![]));
                groups.len() - 1
            }
        };
        groups[at].2.push(d);
    }
    for (_, independent, dependent) in groups {
        merge(model, form, &independent, &dependent, &mut done).map_err(|d| vec![d])?;
    }
    for c in &mut form.columns {
        c.row.retain(|(j, _)| !dependent.contains(j));
    }
    Ok(done)
}

fn ids(form: &Form, role: Role) -> Vec<ColumnId> {
    (0..form.columns.len() as u32).map(ColumnId).filter(|c| form.column(*c).role == role).collect()
}

/// Why a dependent storage cannot be merged, if so.
fn check(model: &Model, form: &Form, d: ColumnId) -> Option<Diagnostic> {
    let column = form.column(d);
    let e = model.element(column.element);
    let not_yet = |why: String, other: Option<ElementId>| {
        let mut error = Diagnostic::error(
            "structure::not_yet",
            e.span,
            format!("`{}` is in derivative causality, and {why}: this version of bond cannot take that", e.name),
        );
        if let Some(o) = other {
            error = error.label(model.element(o).span, "is what it depends on");
        }
        Some(error.help(format!(
            "put a stiff {} and some resistance between the two, as the real parts have",
            if column.gives == crate::model::Variable::Effort { "C" } else { "I" }
        )))
    };
    let linear =
        |id: ElementId| storage(model, id).is_some_and(|s| s.linear.is_some_and(|k| model.pool.constant(k).is_some()));
    if !linear(column.element) {
        return not_yet("its energy is not quadratic".into(), None);
    }
    if column.row.is_empty() {
        return not_yet("nothing drives it".into(), None);
    }
    for (c, k) in &column.row {
        let other = form.column(*c);
        let name = &other.name;
        match other.role {
            Role::Storage if !linear(other.element) => {
                return not_yet(
                    format!("the energy of `{name}`, on which it depends, is not quadratic"),
                    Some(other.element),
                );
            }
            Role::Storage if model.pool.constant(*k).is_none() => {
                return not_yet(
                    format!("the ratio between it and `{name}` changes with the state"),
                    Some(other.element),
                );
            }
            Role::Storage => {}
            Role::Source(_) => {
                return not_yet(format!("follows the source `{name}`, whose derivative it needs"), Some(other.element));
            }
            Role::Bar | Role::Open(_) => {
                return not_yet(format!("follows `{name}` across a double bar, which jumps"), Some(other.element));
            }
            Role::Resistor => return not_yet(format!("depends on the resistor `{name}`"), Some(other.element)),
            Role::Dependent => return not_yet(format!("depends on `{name}`, which is so too"), Some(other.element)),
        }
    }
    None
}

fn merge(
    model: &mut Model,
    form: &Form,
    independent: &[ColumnId],
    dependent: &[ColumnId],
    done: &mut Eliminated,
) -> Result<(), Diagnostic> {
    let initial = initial(model, form, independent, dependent)?;
    let mut pool = std::mem::take(&mut model.pool);
    let stiffness = |c: &ColumnId| storage(model, form.column(*c).element).and_then(|s| s.linear);
    let one = pool.int(1);
    let (n, zero) = (independent.len(), pool.int(0));
    let c: Vec<Vec<Expr>> =
        dependent.iter().map(|d| independent.iter().map(|i| form.entry(*d, *i).unwrap_or(zero)).collect()).collect();
    let inverse_of = |pool: &mut Pool, k: Option<Expr>| k.map_or(zero, |k| pool.div(one, k));
    let mut m = vec![vec![zero; n]; n];
    for i in 0..n {
        for j in 0..n {
            let mut terms = Vec::new();
            if i == j {
                terms.push(inverse_of(&mut pool, stiffness(&independent[i])));
            }
            for (d, row) in dependent.iter().zip(&c) {
                let k = inverse_of(&mut pool, stiffness(d));
                terms.push(pool.product(&[row[i], k, row[j]]));
            }
            m[i][j] = pool.sum(&terms);
        }
    }
    let minv = inverse(&mut pool, &m).ok_or_else(|| {
        let e = model.element(form.column(dependent[0]).element);
        Diagnostic::error(
            "structure::singular",
            e.span,
            format!("the storages tied to `{}` have no common inertia", e.name),
        )
        .help("check their values")
    });
    let minv = match minv {
        Ok(x) => x,
        Err(d) => {
            model.pool = pool;
            return Err(d);
        }
    };
    let symbols: Vec<Symbol> = independent
        .iter()
        .map(|c| {
            let name =
                storage(model, form.column(*c).element).map(|s| pool.name(s.state).to_string()).unwrap_or_default();
            pool.symbol(&name)
        })
        .collect();
    let x: Vec<Expr> = symbols.iter().map(|s| pool.var(*s)).collect();
    let half = pool.ratio(1, 2);
    let mut coenergy = Vec::new();
    let mut energy = Vec::new();
    for i in 0..n {
        let terms: Vec<Expr> = (0..n).map(|j| pool.mul(minv[i][j], x[j])).collect();
        let z = pool.sum(&terms);
        coenergy.push(z);
        energy.push(pool.product(&[half, x[i], z]));
    }
    let energy = pool.sum(&energy);
    let outs: Vec<Expr> = independent.iter().map(|c| pool.var(form.column(*c).out)).collect();
    for (i, column) in independent.iter().enumerate() {
        if let Some(s) = storage(model, form.column(*column).element) {
            let k = inverse_of(&mut pool, s.linear);
            let p = pool.mul(outs[i], k);
            done.fixed.insert(s.state, p);
        }
        let start: f64 = m[i].iter().zip(&initial).map(|(m, z)| pool.constant(*m).unwrap_or(f64::NAN) * z).sum();
        done.states.insert(*column, (symbols[i], start));
    }
    // d(pi_j)/dt without the dependent columns
    let rates: Vec<Expr> = independent
        .iter()
        .map(|c| {
            let row: Row =
                form.column(*c).row.iter().filter(|(j, _)| form.column(*j).role != Role::Dependent).copied().collect();
            let terms: Vec<Expr> = row
                .iter()
                .map(|(j, k)| {
                    let z = pool.var(form.column(*j).out);
                    pool.mul(*k, z)
                })
                .collect();
            pool.sum(&terms)
        })
        .collect();
    let mut list = Vec::new();
    for (d, row) in dependent.iter().zip(&c) {
        let column = form.column(*d);
        let Some(s) = storage(model, column.element) else { continue };
        let k = inverse_of(&mut pool, s.linear);
        let terms: Vec<Expr> = row.iter().zip(&outs).map(|(c, z)| pool.product(&[k, *c, *z])).collect();
        let state = pool.sum(&terms);
        done.fixed.insert(s.state, state);
        let mut terms = Vec::new();
        for i in 0..n {
            for j in 0..n {
                terms.push(pool.product(&[k, row[i], minv[i][j], rates[j]]));
            }
        }
        let output = pool.sum(&terms);
        done.fixed.insert(column.out, output);
        let of_states: FxHashMap<Symbol, Expr> =
            independent.iter().zip(&coenergy).map(|(c, z)| (form.column(*c).out, *z)).collect();
        list.push((column.element, pool.substitute(state, &of_states)));
    }
    let region = form.column(independent[0]).region;
    done.groups.push(Merged { region, columns: independent.to_vec(), energy, coenergy, dependent: list });
    model.pool = pool;
    Ok(())
}

/// Initial co-energy variables of the independent storages: those given count, those of dependent ones settle what is left,
/// and a clash names the elements.
fn initial(
    model: &Model,
    form: &Form,
    independent: &[ColumnId],
    dependent: &[ColumnId],
) -> Result<Vec<f64>, Diagnostic> {
    let start = |c: &ColumnId| {
        storage(model, form.column(*c).element).map(|s| {
            let k = s.linear.and_then(|k| model.pool.constant(k)).unwrap_or(0.0);
            (k * s.initial, s.explicit)
        })
    };
    let mut z: Vec<Option<f64>> = independent.iter().map(|c| start(c).filter(|s| s.1).map(|s| s.0)).collect();
    let told: Vec<(&ColumnId, f64)> =
        dependent.iter().filter_map(|d| start(d).filter(|s| s.1).map(|s| (d, s.0))).collect();
    let coefficient =
        |d: &ColumnId, i: usize| form.entry(*d, independent[i]).and_then(|k| model.pool.constant(k)).unwrap_or(0.0);
    loop {
        let mut settled = false;
        for (d, value) in &told {
            let free: Vec<usize> = (0..z.len()).filter(|i| z[*i].is_none() && coefficient(d, *i) != 0.0).collect();
            if let [one] = free[..] {
                let known: f64 = (0..z.len()).filter_map(|i| Some(coefficient(d, i) * z[i]?)).sum();
                z[one] = Some((value - known) / coefficient(d, one));
                settled = true;
            }
        }
        if !settled {
            break;
        }
    }
    let z: Vec<f64> = z.into_iter().map(|z| z.unwrap_or(0.0)).collect();
    for (d, value) in &told {
        let follows: f64 = (0..z.len()).map(|i| coefficient(d, i) * z[i]).sum();
        if (follows - value).abs() > 1e-9 * follows.abs().max(value.abs()) {
            let e = model.element(form.column(**d).element);
            let mut error = Diagnostic::error(
                "structure::initial",
                e.span,
                format!(
                    "inconsistent start: `{}` is tied to {}, which gives it {follows} where {value} is stated",
                    e.name,
                    independent.iter().map(|c| format!("`{}`", form.column(*c).name)).collect::<Vec<_>>().join(", ")
                ),
            );
            for c in independent {
                let other = model.element(form.column(*c).element);
                error = error.label(other.span, "is what it is tied to");
            }
            return Err(error.help("state the start of one of them and leave the others out"));
        }
    }
    Ok(z)
}
