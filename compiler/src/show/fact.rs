//! What is known of a region's form: skewness, semi-definiteness, bounds, dissipation.

use super::matrix::{Explicit, Matrix};
use super::size::SIZES;
use super::{
    equation::Equations,
    holonomic::{self, Kind},
    name,
};
use crate::expression::{Expr, Pool};
use crate::model::{Law, Model};
use crate::structure::{Form, Region, Role};
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;
use std::fmt::Write;

/// How a claim stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It holds.
    Proved,
    /// It does not.
    Refuted,
    /// Nobody knows.
    Open,
}

impl Verdict {
    /// As `true`, `false` or nothing.
    pub(super) fn decided(self) -> Option<bool> {
        match self {
            Verdict::Proved => Some(true),
            Verdict::Refuted => Some(false),
            Verdict::Open => None,
        }
    }
}

/// The entries that D and -D^T do not share, each pair once; none if D is skew.
pub(super) fn not_skew(pool: &mut Pool, d: &Matrix) -> Vec<(usize, usize)> {
    let at: FxHashMap<(usize, usize), Expr> = d.entries.iter().map(|&(i, j, e)| ((i, j), e)).collect();
    let mut list = Vec::new();
    for &(i, j, e) in &d.entries {
        let cancels = match at.get(&(j, i)) {
            Some(&other) => {
                let sum = pool.add(e, other);
                pool.is_zero(sum) || vanishes(pool, sum, e)
            }
            None => false,
        };
        if !cancels && !list.contains(&(j, i)) {
            list.push((i, j));
        }
    }
    list
}

/// Whether an expression that is not seen to be 0 is so, next to `scale`, at some points.
fn vanishes(pool: &Pool, e: Expr, scale: Expr) -> bool {
    (0..3).all(|k| {
        let values = pool.eval_all(&[e, scale], &|s| 0.3 + 0.17 * f64::from(s.0 % 7) + 0.41 * f64::from(k));
        !values[0].is_finite() || values[0].abs() <= 1e-9 * values[1].abs()
    })
}

/// Whether `[[R, P], [P^T, S]] >= 0`, and why: by its eigenvalues where they are numbers, else since a network without
/// power of its own, closed with resistors that only take power, only takes power.
pub(super) fn semidefinite(
    model: &Model,
    form: &Form,
    region: &Region,
    e: Option<&Explicit>,
) -> (Verdict, &'static str) {
    if let Some(verdict) = e.and_then(|e| by_eigenvalues(&model.pool, e)) {
        return (verdict, "by its eigenvalues");
    }
    let linear = region.resistors.iter().filter_map(|(c, _)| match &model.element(form.column(*c).element).law {
        Law::Resistor(r) if r.linear.is_some() || r.row.is_some() => Some(r.dissipative),
        Law::Resistor(_)
        | Law::Source(_)
        | Law::Storage(_)
        | Law::Ratio(_)
        | Law::Junction
        | Law::Port(_)
        | Law::Multiplier => None,
    });
    if linear.into_iter().all(|d| d == Some(true)) {
        (Verdict::Proved, "every linear resistor takes power, and D is skew")
    } else {
        (Verdict::Open, "the sign of a resistance is not known")
    }
}

fn by_eigenvalues(pool: &Pool, e: &Explicit) -> Option<Verdict> {
    let (nx, nu) = (e.r.rows.len(), e.s.rows.len());
    if nx + nu > 4 * SIZES.dense_states {
        return None;
    }
    let mut a = DMatrix::<f64>::zeros(nx + nu, nx + nu);
    let mut set = |i: usize, j: usize, e: Expr| -> Option<()> {
        let x = pool.constant(e).filter(|x| x.is_finite())?;
        a[(i, j)] = x;
        a[(j, i)] = x;
        Some(())
    };
    for &(i, j, x) in &e.r.entries {
        set(i, j, x)?;
    }
    for &(i, j, x) in &e.p.entries {
        set(i, nx + j, x)?;
    }
    for &(i, j, x) in &e.s.entries {
        set(nx + i, nx + j, x)?;
    }
    if a.is_empty() {
        return Some(Verdict::Proved);
    }
    // Scaled to a unit diagonal, so that rounding is small beside every row.
    let scale: Vec<f64> = (0..nx + nu).map(|i| a[(i, i)].abs().sqrt()).collect();
    for i in 0..nx + nu {
        for j in 0..nx + nu {
            let s = scale[i] * scale[j];
            if s > 0.0 && s.is_finite() {
                a[(i, j)] /= s;
            }
        }
    }
    let largest = a.amax();
    if !largest.is_finite() {
        return None;
    }
    let least = a.symmetric_eigenvalues().min();
    Some(if least >= -1e-10 * largest { Verdict::Proved } else { Verdict::Refuted })
}

/// The facts of a region, a line each.
pub(super) fn lines(
    model: &mut Model,
    form: &Form,
    region: &Region,
    (d, explicit, equations): (&Matrix, Option<&Explicit>, &Equations),
) -> Vec<String> {
    let mut lines = Vec::new();
    let clashes = not_skew(&mut model.pool, d);
    lines.push(if clashes.is_empty() {
        "D is skew (checked): power in = power out".to_string()
    } else {
        let pairs: Vec<String> = clashes.iter().map(|(i, j)| format!("{} / {}", d.rows[*i], d.columns[*j])).collect();
        format!("D is NOT skew at {}", pairs.join(", "))
    });
    let (verdict, why) = semidefinite(model, form, region, explicit);
    lines.push(match verdict {
        Verdict::Proved => format!("[[R, P], [P^T, S]] >= 0: proved ({why})"),
        Verdict::Refuted => format!("[[R, P], [P^T, S]] >= 0: refuted ({why})"),
        Verdict::Open => format!("[[R, P], [P^T, S]] >= 0: not decided ({why})"),
    });
    let free: Vec<&str> = unbounded(region);
    lines.push(match (region.groups.is_empty(), free.is_empty()) {
        (true, _) => "no storage: H = 0".into(),
        (false, true) => "H is bounded below".into(),
        (false, false) => format!("H is not seen to be bounded below, by {}: no claim of passivity", free.join(", ")),
    });
    lines.extend(resistor_lines(model, form, region));
    for d in &region.dependent {
        let e = model.element(d.element);
        let mut line = if d.into.is_empty() {
            format!("{} is dependent: it follows its sources alone, and loads them", name::element(model, e))
        } else {
            format!("{} is dependent: merged into {}", name::element(model, e), d.into.join(", "))
        };
        let letter = if e.kind == crate::model::Kind::I { 'p' } else { 'q' };
        let _ = write!(line, ", {}.{letter} = {}", e.name, name::expression(&model.pool, d.state));
        lines.push(line);
    }
    for (id, _) in region.resistors.iter().filter(|(c, _)| form.column(*c).role == Role::Constraint) {
        let zero = form.input(&mut model.pool, *id);
        let kind = holonomic::kind(&mut model.pool, form, *id);
        let e = model.element(form.column(*id).element);
        let zero = name::expression(&model.pool, zero);
        lines.push(if e.is_massless() {
            format!("{} has no inertia: 0 = {zero}", e.name)
        } else {
            let what = match kind {
                Some(Kind::Holonomic) => " (holonomic: positions keep it too)",
                Some(Kind::SpeedsAlone) => " (no rate of a function of positions: it ties speeds alone)",
                None => "",
            };
            format!("a multiplier at {} has 0 = {zero}{what}", e.name)
        });
    }
    for (members, solved) in &equations.loops {
        if members.iter().all(|c| form.column(*c).role == Role::Constraint) {
            continue;
        }
        let names: Vec<&str> = members.iter().map(|c| form.column(*c).name.as_str()).collect();
        let how = match (solved, names.len()) {
            (true, _) => "linear, eliminated exactly",
            (false, 1) => "its law runs the other way: solved in each step",
            (false, _) => "solved in each step",
        };
        lines.push(format!("algebraic loop through {}: {how}", names.join(", ")));
    }
    if region.pseudo {
        lines.push("pseudo bonds: effort times flow is no power, and H no energy".into());
    }
    lines
}

/// States whose energy was not seen to have a lower bound.
pub(super) fn unbounded(region: &Region) -> Vec<&str> {
    let states = region.groups.iter().filter(|g| !g.bounded).flat_map(|g| &g.states);
    states.filter_map(|s| region.states.get(*s)).map(|s| s.name.as_str()).collect()
}

fn resistor_lines(model: &Model, form: &Form, region: &Region) -> Vec<String> {
    let (mut proved, mut open, mut wrong) = (Vec::new(), Vec::new(), Vec::new());
    for (c, _) in &region.resistors {
        let e = model.element(form.column(*c).element);
        let Law::Resistor(r) = &e.law else { continue };
        if e.line.is_some() {
            continue;
        }
        match (e.active, r.dissipative) {
            (false, Some(true)) => &mut proved,
            (false, None) => &mut open,
            (true, _) | (_, Some(false)) => &mut wrong,
        }
        .push(e.name.clone());
    }
    let mut lines = Vec::new();
    for (names, text) in [
        (proved, "e f >= 0 proved for"),
        (open, "e f >= 0 not proved, watched at run time, for"),
        (wrong, "may give power, so that there is no claim of passivity:"),
    ] {
        match names.len() {
            0 => {}
            n if n > 24 => lines.push(format!("{text} {} and {} more resistors", names[..12].join(", "), n - 12)),
            _ => lines.push(format!("{text} {}", names.join(", "))),
        }
    }
    lines
}
